"""Disturbances reach the simulator and the readings, and nothing else."""

from __future__ import annotations

import numpy as np
import pytest
from PIL import Image

from agents.controllers import MaxForce, NetForce
from agents.evaluation.evaluator import evaluate, make_batch
from agents.evaluation.robustness import DISTURBANCES, Disturbance, heat_map, sweep, sweep_scores
from magwire_env import Scenario

ID = "MagWire/Steer-v0"
BY_NAME = {one.name: one for one in DISTURBANCES}
NOMINAL = DISTURBANCES[0]
N = 6


def test_the_sweep_covers_what_it_should():
    assert {one.friction for one in DISTURBANCES} >= {0.0, 1.0, 4.0}
    assert {one.remanence for one in DISTURBANCES} >= {0.9, 1.1}
    for axis in range(3):
        assert {one.placement[axis] for one in DISTURBANCES} >= {-0.01, 0.01}
    assert {one.delay for one in DISTURBANCES} == {0, 1, 2, 3}
    assert max(one.force_noise for one in DISTURBANCES) > 0
    assert len(BY_NAME) == len(DISTURBANCES)


def test_disturbances_change_the_motion_and_do_not_add_up():
    names = ("friction × 4", "remanence +10 %", "magnet off in z -10 mm", "magnet off in y +10 mm")
    chosen = [NOMINAL, *(BY_NAME[name] for name in names)]
    again = Disturbance("as modelled", "again")
    found = sweep(MaxForce.from_env, ID, N, "MaxForce", [*chosen, again])
    nominal = evaluate(MaxForce.from_env, ID, N).time
    assert np.array_equal(found[NOMINAL.name].time, nominal)
    assert np.array_equal(found[again.name].time, nominal)
    slower, faster, nearer, aside = (found[name].time for name in names)
    assert (slower > 1.05 * nominal).all()
    assert (faster < 0.97 * nominal).all()
    assert (nearer < 0.9 * nominal).all()
    assert not np.isclose(aside, nominal, rtol=1e-3).any()


@pytest.mark.parametrize(
    ("disturbance", "scenario"),
    [
        (BY_NAME["friction × 2"], Scenario.paper().replace(contact__friction=0.1)),
        (BY_NAME["friction × 0"], Scenario.paper().replace(contact__friction=0.0)),
    ],
)
def test_a_disturbance_is_the_scenario_it_stands_for(disturbance, scenario):
    """MaxForce's table knows no friction, so it cannot tell a disturbed batch from one of such a scenario."""
    found = sweep(MaxForce.from_env, ID, N, disturbances=[disturbance])[disturbance.name]
    assert found.time == pytest.approx(evaluate(MaxForce.from_env, ID, N, scenario=scenario).time, rel=1e-12)


def test_it_lasts_through_the_episode_and_leaves_the_model_alone():
    env = make_batch(ID, 2, {})
    core = env.unwrapped.core
    controller = NetForce.from_env(env)
    known = controller._ways[0]._commands.copy()
    strength = core.sim.rig.magnetics[1].copy()
    evaluate(controller, ID, 2, env=env, disturb=BY_NAME["remanence +10 %"].apply)
    assert np.abs(core.sim.rig.magnetics[1] - strength).max() > 0
    assert core.sim.library.scenarios == (Scenario.paper(),)
    assert np.array_equal(NetForce.from_env(env)._ways[0]._commands, known)
    # What a rollout expects is still what the nominal scenario would do.
    state = core.sim.state()
    plan = np.full((1, 3, 1), 3.0)
    fresh = make_batch(ID, 2, {}).unwrapped.core.sim
    expected = fresh.rollout(state, plan).tip_arclength
    assert np.array_equal(core.sim.rollout(state, plan).tip_arclength, expected)
    core.sim.load_state(state)
    for command in plan[0]:
        core.sim.step(np.tile(command, (2, 1)))
    assert not np.allclose(core.sim.tip_arclength, expected[:, 0, -1], atol=1e-7)


class Recorder:
    """Holds the magnet still and writes down what it sees."""

    def __init__(self):
        self.seen = []

    def predict(self, observation, state=None, episode_start=None, deterministic=True):
        self.seen.append(observation.copy())
        return np.zeros((len(observation), 1), dtype=np.float32), None


def _seen(disturbance: Disturbance) -> np.ndarray:
    recorder = Recorder()
    sweep(recorder, ID, 16, disturbances=[disturbance])
    return np.stack(recorder.seen[:15])  # before the first lane ends and begins another episode


def test_readings_are_noisy_and_late():
    truth, noisy, late = (_seen(one) for one in (NOMINAL, BY_NAME["force noise 1 mN"], BY_NAME["delay 3 steps"]))
    error = 10e-3 * (noisy - truth)[..., 2:4]
    assert error.std() == pytest.approx(1e-3, rel=0.1)
    assert np.array_equal(noisy[..., 0], truth[..., 0])
    assert np.array_equal(late[3:], truth[:-3])


def test_the_first_observation_is_of_the_disturbed_world():
    truth, stronger = (_seen(one)[0] for one in (NOMINAL, BY_NAME["remanence +10 %"]))
    assert stronger[:, 2] == pytest.approx(1.1 * truth[:, 2], rel=1e-5)


def test_the_heat_map_and_its_numbers(tmp_path):
    chosen = [NOMINAL, BY_NAME["friction × 4"], BY_NAME["delay 1 step"]]
    found = sweep(MaxForce.from_env, ID, 3, disturbances=chosen)
    rows = sweep_scores(found, None)
    assert [row["kind"] for row in rows] == ["as modelled", "friction", "delay"]
    assert rows[0]["score"] == 1.0
    assert rows[0]["median_time_s"] == np.median(found[NOMINAL.name].time) < rows[1]["median_time_s"]
    assert rows[1]["score"] < 0.95
    rows[2]["score"] = None
    path = heat_map(rows, "a title", tmp_path / "map.png", {"Source": "abc"})
    with Image.open(path) as picture:
        assert picture.text["Source"] == "abc"
        assert picture.width > 900
