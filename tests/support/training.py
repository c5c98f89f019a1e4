"""Settings of trainings that take seconds."""

SMALL = {
    "task": "MagWire/Steer-v0",
    "timesteps": 8192,
    "n_envs": 32,
    "evaluations": 2,
    "episodes": 8,
    "progress": False,
}
