"""Settings of trainings that take seconds."""

SMALL = {"timesteps": 8192, "n_envs": 32, "evaluations": 2, "episodes": 8, "progress": False}
