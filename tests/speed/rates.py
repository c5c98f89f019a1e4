"""Items 1 to 6: env steps a second of the batch, the single env, rollouts, training; against others' envs."""

from __future__ import annotations

import time
import warnings
from collections.abc import Callable

import gymnasium as gym
import numpy as np

import magwire_env  # noqa: F401  (registers the ids)
from magwire_env import Scenario, Simulator
from magwire_env.lumen import generate
from magwire_env.scenario import above
from magwire_env.simulation import best_command
from tests.speed.accuracy import Accuracy, accuracy, five_scenarios, references
from tests.speed.measure import both_rates, number, rate, rates, ratio, table, timed

TASK = "MagWire/Steer-v0"
STEPS = 120
Case = Callable[[], tuple[int, float]]


def max_force_actions(settings: dict, num_envs: int, steps: int = STEPS) -> np.ndarray:
    """Actions of the paper's policy on a batch seeded 0, (steps, num_envs, size), resets as they come."""
    envs = gym.make_vec(TASK, num_envs=num_envs, **settings)
    core = envs.unwrapped.core
    scenario = core.sim.library.scenarios[0]
    grid = np.linspace(0.0, scenario.tract.length, 401 if core.sim.dof == 1 else 81)
    best, _ = best_command(scenario, grid)
    envs.reset(seed=0)
    actions = []
    for _ in range(steps):
        command = np.stack([np.interp(core.sim.tip_arclength, grid, column) for column in best.T], axis=1)
        actions.append(core.actuation.action(command))
        envs.step(actions[-1])
    return np.array(actions)


def replayed(settings: dict, num_envs: int, actions: np.ndarray) -> Case:
    """A case that steps a batch through recorded actions from its seed, so every round does the very same work."""
    envs = gym.make_vec(TASK, num_envs=num_envs, **settings)

    def case() -> tuple[int, float]:
        envs.reset(seed=0)
        start = time.perf_counter()
        for action in actions:
            envs.step(action)
        return num_envs * len(actions), time.perf_counter() - start

    return case


def envpool_case(num_envs: int = 1024) -> Case | str:
    """EnvPool's C++ Pendulum on two threads, or why not."""
    try:
        import envpool
    except ImportError as error:
        return f"skipped: {error}"
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        envs = envpool.make_gymnasium("Pendulum-v1", num_envs=num_envs, num_threads=2)
    envs.reset()
    actions = np.random.default_rng(0).uniform(-2, 2, (STEPS, num_envs, 1)).astype(np.float32)

    def case() -> tuple[int, float]:
        return num_envs * STEPS, timed(lambda: [envs.step(a) for a in actions])

    return case


def worst_accuracy(
    segments: int | None = None, substeps: int | None = None, refs: list | None = None
) -> list[Accuracy]:
    """Errors on the five scenarios at a resolution, by default the scenarios' own."""
    found = []
    for scenario, commands, reference in refs or references():
        if segments:
            scale = scenario.wire.length / 0.1
            scenario = scenario.replace(wire__segments=round(segments * scale), timing__substeps=substeps)
        found.append(accuracy(scenario, commands, reference))
    return found


def said(rows: list[Accuracy]) -> str:
    """The worst of the five scenarios, and whether they pass."""
    s, load = max(r.arclength_error for r in rows), max(r.load_error for r in rows)
    return f"{s * 1e3:.2f} mm, {load:.1%}, {'passes' if all(r.passes for r in rows) else 'does not pass'}"


def batch(refs: list) -> str:
    """Item 1."""
    fine = {"scenario": Scenario.paper().replace(wire__segments=30, timing__substeps=5)}
    actions, fine_actions = max_force_actions({}, 1024), max_force_actions(fine, 1024)
    cases: dict[str, Case] = {
        "1024 lanes": replayed({"threads": 2}, 1024, actions),
        "1024 lanes, one thread": replayed({"threads": 1}, 1024, actions),
        "8 lanes": replayed({}, 8, np.ascontiguousarray(actions[:, :8])),
        "1024 lanes, 31 nodes × 5 substeps": replayed(fine | {"threads": 2}, 1024, fine_actions),
    }
    pool = envpool_case()
    if not isinstance(pool, str):
        cases["EnvPool Pendulum-v1, 1024 lanes"] = pool
    found, busy = both_rates(cases)
    exact = {"31 nodes": said(worst_accuracy(30, 5, refs)), "default": said(worst_accuracy(refs=refs))}
    rows = []
    for name, values in found.items():
        kind = "" if name.startswith("EnvPool") else exact["31 nodes" if "31" in name else "default"]
        rows.append((name, rate(values), rate(busy[name]), kind))
    head = ("batch", "env steps/s, median (range)", "a second of processor time", "accuracy, worst of five scenarios")
    text = table(head, rows)
    if isinstance(pool, str):
        return f"{text}\n\nEnvPool: {pool}."
    theirs = "EnvPool Pendulum-v1, 1024 lanes"
    return (
        f"{text}\n\nOver EnvPool: {ratio(found, '1024 lanes', theirs)}, by processor time "
        f"{ratio(busy, '1024 lanes', theirs)}; wanted 2.5."
    )


def unlike(count: int) -> list[Scenario]:
    """Scenarios that differ in tract, wire and place of the magnet."""
    paper, rng = Scenario.paper(), np.random.default_rng(0)
    tracts = [generate(seed) for seed in range(64)]
    found = []
    for i in range(count):
        x, y, z = above(tracts[i % 64], 0.07)
        mount = paper.rig.magnets[0]
        shift = rng.uniform(0.0, 0.02, 3)
        mount = type(mount)(mount.magnet, (x + shift[0], y + shift[1], z + shift[2]), mount.dofs, ("fitted", 21))
        wire = {"wire__length": rng.uniform(0.08, 0.12), "wire__bending_modulus": rng.uniform(4e5, 7e5)}
        found.append(paper.replace(tract=tracts[i % 64], rig=type(paper.rig)((mount,)), **wire))
    return found


def lanes_that_differ(count: int = 1024) -> str:
    """Item 2."""
    moving = {"scenario": five_scenarios()[-1]}
    actions = max_force_actions({}, count)
    cases = {
        "uniform": replayed({}, count, actions),
        "every lane its own tract, wire and magnet": replayed({"scenario": unlike(count)}, count, actions),
        "a magnet that translates": replayed(moving, count, max_force_actions(moving, count)),
    }
    found = rates(cases)
    rows = [(name, rate(v), ratio(found, name, "uniform")) for name, v in found.items()]
    return table((f"{count} lanes", "env steps/s", "over the uniform batch"), rows) + "\n\nWanted 0.7 and 0.5."


def single(steps: int = 3000) -> str:
    """Item 3."""

    def stepped(env_id: str) -> Case:
        env = gym.make(env_id)
        env.reset(seed=0)
        actions = [env.action_space.sample() for _ in range(steps)]

        def case() -> tuple[int, float]:
            env.reset(seed=0)
            start = time.perf_counter()
            for action in actions:
                _, _, terminated, truncated, _ = env.step(action)
                if terminated or truncated:
                    env.reset()
            return steps, time.perf_counter() - start

        return case

    found = rates({TASK: stepped(TASK), "Pendulum-v1": stepped("Pendulum-v1")})
    rows = [(f'`gym.make("{name}")`', rate(v), ratio(found, name, "Pendulum-v1")) for name, v in found.items()]
    return table(("single env, default wrappers", "env steps/s", "over Pendulum"), rows) + "\n\nWanted 0.4."


def plans(count: int = 512, horizon: int = 20) -> str:
    """Item 4."""
    sim = Simulator(Scenario.paper(), num_envs=1)
    sim.reset(tip_arclength=0.3)
    tried = np.random.default_rng(0).uniform(1.5, 4.5, (count, horizon, 1))
    state = sim.state()
    sim.rollout(state, tried)
    ms = np.array([1e3 * timed(lambda: sim.rollout(state, tried)) for _ in range(40)])
    return (
        f"`Simulator.rollout`, {count} plans × {horizon} control steps: median {np.median(ms):.2f} ms, quartiles "
        f"{np.quantile(ms, 0.25):.2f}–{np.quantile(ms, 0.75):.2f} ms; wanted 8 ms."
    )


def training(lanes: int = 256, rollouts: int = 2) -> str:
    """Item 5."""
    try:
        from stable_baselines3 import PPO
        from stable_baselines3.common.vec_env import VecEnv

        from agents.learning.hyperparameters import hyperparameters
        from agents.learning.sb3 import make_vec_env
    except ImportError as error:
        return f"PPO: skipped: {error}"
    real = make_vec_env(TASK, lanes, seed=0)

    class Nothing(VecEnv):
        """An env of the same spaces that costs nothing: the same arrays every step."""

        def __init__(self) -> None:
            super().__init__(lanes, real.observation_space, real.action_space)
            self._out = np.zeros((lanes, *real.observation_space.shape), dtype=np.float32)
            self._rest = np.zeros(lanes, dtype=np.float32), np.zeros(lanes, dtype=bool), [{}] * lanes

        def reset(self):
            return self._out

        def step_async(self, actions):
            pass

        def step_wait(self):
            return self._out, *self._rest

        def close(self): ...
        def get_attr(self, attr_name, indices=None):
            return [None] * lanes

        def set_attr(self, attr_name, value, indices=None): ...
        def env_method(self, method_name, *args, indices=None, **kwargs): ...
        def env_is_wrapped(self, wrapper_class, indices=None):
            return [False] * lanes

    keys = ("n_steps", "batch_size", "n_epochs")
    settings = {k: v for k, v in hyperparameters("ppo", TASK).items() if k in keys}

    def trained(env) -> Case:
        model = PPO("MlpPolicy", env, device="cpu", seed=0, **settings)

        def case() -> tuple[int, float]:
            steps = rollouts * lanes * model.n_steps
            return steps, timed(lambda: model.learn(steps))

        return case

    found = rates({"Steer-v0": trained(real), "an env that costs nothing": trained(Nothing())}, rounds=3)
    rows = [(name, rate(v), ratio(found, name, "an env that costs nothing")) for name, v in found.items()]
    return table((f"PPO, {lanes} lanes, {settings}", "steps/s", "ratio"), rows) + "\n\nWanted 0.8."


def elastica() -> str:
    """Item 6."""
    try:
        import elastica as ea
    except ImportError as error:
        return f"PyElastica: skipped: {error}"

    class World(ea.BaseSystemCollection, ea.Constraints, ea.Forcing, ea.Damping): ...

    wire, drag = Scenario.paper().wire, Scenario.paper().contact.drag

    def second(step: float, seconds: float = 1.0) -> tuple[float, float]:
        """Wall time of a simulated second, and where the tip ended."""
        world = World()
        rod = ea.CosseratRod.straight_rod(
            wire.segments, np.zeros(3), np.array([1.0, 0, 0]), np.array([0, 0, 1.0]), wire.length, wire.radius,
            wire.density, youngs_modulus=wire.bending_modulus, shear_modulus=wire.bending_modulus / 3,
        )  # fmt: skip
        world.append(rod)
        world.constrain(rod).using(ea.OneEndFixedBC, constrained_position_idx=(0,), constrained_director_idx=(0,))
        world.add_forcing_to(rod).using(ea.EndpointForces, np.zeros(3), np.array([0, 1e-3, 0]), ramp_up_time=0.05)
        damping = drag / (wire.density * wire.area)
        world.dampen(rod).using(ea.AnalyticalLinearDamper, damping_constant=damping, time_step=step)
        world.finalize()
        stepper, at = ea.PositionVerlet(), np.float64(0.0)
        start = time.perf_counter()
        for _ in range(round(seconds / step)):
            at = stepper.step(world, at, np.float64(step))
        return time.perf_counter() - start, float(rod.position_collection[1, -1])

    second(1e-4, 0.01)
    exact = second(2.5e-5)[1]
    stable = max(dt for dt in (1e-4, 1.5e-4, 2e-4, 2.5e-4, 3e-4) if abs(second(dt)[1] / exact - 1) < 0.01)
    actions = max_force_actions({}, 1024, 10)
    period = Scenario.paper().timing.control_period
    one = max_force_actions({}, 1, 10)
    alone, among = replayed({}, 1, one), replayed({}, 1024, actions)
    cases: dict[str, Case] = {
        "PyElastica, one rod": lambda: (1, second(stable)[0]),
        "magwire_env, one lane": lambda: (1, alone()[1] / (10 * period)),
        "magwire_env, a lane of 1024": lambda: (1024, among()[1] / (10 * period)),
    }
    found = rates(cases, rounds=5)
    rows = [(name, number(float(np.median(v))), ratio(found, name, "PyElastica, one rod")) for name, v in found.items()]
    return (
        table((f"one simulated second, {wire.segments} elements", "real-time factor", "over PyElastica"), rows)
        + f"\n\nPyElastica at its largest stable step, {stable:g} s (free Cosserat rod; ours is locked to the tract)."
    )
