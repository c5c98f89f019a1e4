"""Lane numbers are checked before they reach a kernel; copies act like their twins; NaN is refused."""

import copy
import pickle
import sys
import threading
import time

import gymnasium as gym
import numpy as np
import pytest

import magwire_env  # noqa: F401  (registers the ids)
from magwire_env import Scenario, Simulator
from magwire_env.scenario import Contact, Reading
from magwire_env.simulation import Places

PAPER = Scenario.paper()
ONES = np.ones(1)
ENTRIES = {
    "reset": lambda sim, lanes: sim.reset(tip_arclength=0.3, lanes=lanes),
    "state": lambda sim, lanes: sim.state(lanes),
    "assign": lambda sim, lanes: sim.assign(lanes, [0]),
    "vary": lambda sim, lanes: sim.vary(lanes, ONES, ONES, ONES, np.zeros((1, 1, 3))),
    "set_goal": lambda sim, lanes: sim.set_goal(lanes, Places(ONES)),
    "set_rig": lambda sim, lanes: sim.set_rig(np.ones((1, 1)), lanes),
    "refresh": lambda sim, lanes: sim.refresh(lanes),
}


@pytest.mark.parametrize("entry", ENTRIES)
@pytest.mark.parametrize("lanes", [[-1], [3], [2**40], [0.0], ["0"], [[0]]])
def test_a_lane_that_is_none_is_refused_everywhere(entry, lanes):
    sim = Simulator(PAPER, num_envs=3)
    before = sim.state()
    with pytest.raises(ValueError, match="lanes must"):
        ENTRIES[entry](sim, lanes)
    assert sim.state() == before


def test_a_state_names_lanes_that_exist():
    sim, wide = Simulator(PAPER, num_envs=1), Simulator(PAPER, num_envs=20)
    with pytest.raises(ValueError, match=r"state.lanes must lie in \[0, 0\]"):
        sim.load_state(wide.state([7]))
    with pytest.raises(ValueError, match=r"state.lanes must lie in \[0, 0\]"):
        sim.rollout(wide.state([7]), np.ones((1, 1, 1)))


def played(env: gym.Env, steps: int) -> np.ndarray:
    rows = [np.append(*env.step(np.float32([0.5]))[:2]) for _ in range(steps)]
    return np.array([*rows, np.append(rows[-1][:-1], env.unwrapped.simulator.tip_arclength)])


@pytest.mark.parametrize("name", ["Steer", "Reach", "Track"])
@pytest.mark.parametrize("twin_of", [copy.deepcopy, lambda env: pickle.loads(pickle.dumps(env))])
def test_a_copied_env_has_the_same_future(name, twin_of):
    scenario = PAPER.replace(sensing__force=Reading(noise=1e-3), variation__friction=0.2)
    env = gym.make(f"MagWire/{name}-v0", scenario=scenario, disable_env_checker=True)
    env.reset(seed=0)
    played(env, 3)
    twin = twin_of(env.unwrapped)
    first = played(env.unwrapped, 20)
    assert np.array_equal(played(twin, 20), first)
    assert np.ptp(first[:, 0]) > 0  # it did move
    env.reset()
    twin.reset()
    assert np.array_equal(played(twin, 3), played(env.unwrapped, 3))


@pytest.mark.parametrize("model", ["locked", "free"])
def test_a_copied_batch_and_simulator_have_the_same_future(model):
    envs = gym.make_vec("MagWire/Steer-v0", num_envs=3)
    envs.reset(seed=0)
    twin = copy.deepcopy(envs.unwrapped)
    actions = np.full((3, 1), 0.4, dtype=np.float32)
    for _ in range(5):
        assert np.array_equal(envs.step(actions)[0], twin.step(actions)[0])
    sim = Simulator(PAPER.replace(model=model), num_envs=2)
    sim.step(np.full((2, 1), 2.0))
    other = pickle.loads(pickle.dumps(sim))
    for _ in range(3):
        sim.step(np.full((2, 1), 4.0))
        other.step(np.full((2, 1), 4.0))
    assert other.state() == sim.state()
    assert np.array_equal(other.positions, sim.positions)


@pytest.mark.parametrize(
    "change",
    [
        lambda sim: sim.load_state(sim.state().replaced(arclengths=np.nan)),
        lambda sim: sim.load_state(sim.state().replaced(velocities=np.inf)),
        lambda sim: sim.load_state(sim.state().replaced(magnet=np.full((2, 1), np.nan))),
        lambda sim: sim.vary([0], np.array([np.nan]), ONES, ONES, np.zeros((1, 1, 3))),
        lambda sim: sim.vary([0], ONES, ONES, ONES, np.full((1, 1, 3), np.nan)),
    ],
)
def test_numbers_that_are_none_are_refused_before_anything_is_changed(change):
    sim = Simulator(PAPER, num_envs=2)
    before = sim.state()
    with pytest.raises(ValueError, match="finite"):
        change(sim)
    assert sim.state() == before


@pytest.mark.parametrize("value", [np.zeros(5), np.zeros((3, 17)), np.zeros((2, 17, 1))])
def test_numbers_of_another_shape_are_refused(value):
    state = Simulator(PAPER, num_envs=2).state()
    with pytest.raises(ValueError, match=r"velocities must have shape \(2, 17\), got"):
        state.replaced(velocities=value)


@pytest.mark.parametrize("other", [PAPER.replace(wire__segments=8), PAPER.replace(model="free")])
def test_the_state_of_another_wire_is_refused(other):
    sim = Simulator(PAPER, num_envs=2)
    before = sim.state()
    with pytest.raises(ValueError, match="state must be of this simulator, with wire of shape"):
        sim.load_state(Simulator(other, num_envs=2).state())
    assert sim.state() == before


def test_a_wire_that_diverges_is_named_and_not_hidden_in_an_observation():
    env = gym.make("MagWire/Steer-v0")
    env.reset(seed=0)
    sim = env.unwrapped.simulator
    sim.model._s[...] = np.nan
    with pytest.raises(RuntimeError, match=r"the wire of lane 0 .scenario 'paper'. has diverged"):
        env.step(np.float32([0.0]))


@pytest.fixture
def restless():
    """Threads are switched all the time, as they are on a busy machine now and then."""
    before = sys.getswitchinterval()
    sys.setswitchinterval(1e-6)
    yield
    sys.setswitchinterval(before)


@pytest.mark.usefixtures("restless")
def test_rollouts_side_by_side_are_right():
    sim = Simulator(PAPER, num_envs=8)
    sim.reset(tip_arclength=np.linspace(0.2, 0.5, 8))
    state = sim.state()
    plans = np.random.default_rng(0).uniform(0, 6, (6, 8, 4, 10, 1))
    expected = [sim.rollout(state, plan).travelled for plan in plans]
    found: dict[int, list[np.ndarray]] = {i: [] for i in range(6)}

    def work(number: int) -> None:
        for _ in range(5):
            found[number].append(sim.rollout(state, plans[number]).travelled)

    threads = [threading.Thread(target=work, args=(i,)) for i in range(6)]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    assert all(np.array_equal(got, expected[i]) for i in range(6) for got in found[i])


@pytest.mark.usefixtures("restless")
def test_threads_that_step_one_simulator_take_turns():
    """Without turns, wires move through half a step of each, and under the other thread's command."""
    sim, alone = (Simulator(PAPER, num_envs=64) for _ in range(2))
    for one in (sim, alone):
        one.reset(tip_arclength=np.linspace(0.2, 0.5, 64))
    commands = [np.full((64, 1), angle) for angle in (2.5, 4.5)]
    seen: list[tuple[int, float]] = []
    moved = sim.model.step

    def noted() -> None:
        told = sim.command[0].copy()
        time.sleep(1e-4)  # the other thread would write its command now
        moved()
        seen.append((int(told[0] > 3), float(np.ptp(np.append(told, sim.command[0])))))

    sim.model.step = noted

    def work(number: int) -> None:
        for _ in range(100):
            sim.step(commands[number])

    threads = [threading.Thread(target=work, args=(i,)) for i in range(2)]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    assert [number for number, _ in seen].count(0) == 100
    assert not any(spread for _, spread in seen)
    for number, _ in seen:
        alone.step(commands[number])
    assert sim.state() == alone.state()


@pytest.mark.parametrize("plans", [np.empty((0, 3, 1)), np.empty((2, 0, 1))])
def test_empty_rollouts_are_refused(plans):
    sim = Simulator(PAPER)
    with pytest.raises(ValueError, match="with K and H at least 1"):
        sim.rollout(sim.state(), plans)


def test_a_solve_that_gives_up_says_so():
    """Friction that is all but unsmoothed now and then takes more Newton steps than are allowed."""
    scenario = PAPER.replace(contact=Contact(friction=0.5, stick_speed=1e-12))
    envs = gym.make_vec("MagWire/Steer-v0", num_envs=64, scenario=scenario, time_limit=5.0)
    envs.reset(seed=1)
    seen = np.zeros(64)
    for action in np.random.default_rng(0).uniform(-1, 1, (50, 64, 1)).astype(np.float32):
        *_, info = envs.step(action)
        seen += info["unconverged"]
        assert np.array_equal(info["unconverged"], envs.unwrapped.simulator.unconverged)
    assert seen.sum() > 0
    still_running = info["summary"]["steps"] == 50
    assert still_running.any()
    assert np.array_equal(info["summary"]["unconverged"][still_running], seen[still_running])
