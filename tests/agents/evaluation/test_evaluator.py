"""Episodes, their scores, their tracts, their table."""

from __future__ import annotations

import dataclasses
import json

import gymnasium as gym
import numpy as np
import pytest

from agents.catalogue import CONTROLLERS, NOT_OF_TRACTS
from agents.controllers import MaxForce, NetForce
from agents.evaluation.episodes import EVALUATION_SEED
from agents.evaluation.evaluator import Episodes, evaluate, make_batch, paired_ratio, table
from magwire_env import Scenario
from magwire_env.quasistatic.pool import scenario_pool

ID = "MagWire/Steer-v0"


def made(policy: str, time: list[float], **changed: np.ndarray) -> Episodes:
    """Made-up episodes of a steering task; NaN times were not reached."""
    t = np.array(time)
    fields = {f.name: np.zeros(len(t)) for f in dataclasses.fields(Episodes) if f.name != "policy"}
    fields |= {"success": np.isfinite(t), "time": t, "rms_error": np.full(len(t), np.nan), "goal": np.ones(len(t))}
    return Episodes(policy, **fields | changed)


def test_scores_are_pars_time_over_ones_own():
    par = made("Optimal", [6.0, 8.0, 9.0, np.nan])
    own = made("mine", [12.0, 8.0, np.nan, 7.0])
    assert own.score(par)[:3].tolist() == [0.5, 1.0, 0.0]
    assert np.isnan(own.score(par)[3])
    assert own.mean_score(par)[0] == pytest.approx(0.5)
    assert made("mine", [12.0, 8.0]).score(par).tolist() == [0.5, 1.0]


def test_tracking_is_scored_by_its_error():
    par = made("Optimal", [30.0, 30.0], rms_error=np.array([1e-3, 2e-3]))
    own = made("mine", [np.nan, 30.0], rms_error=np.array([8e-3, 2e-3]))
    assert own.score(par) == pytest.approx([0.125, 1.0])


def test_a_par_of_other_episodes_is_refused():
    own = made("mine", [7.0, 7.0])
    with pytest.raises(ValueError, match="same episodes"):
        own.score(made("Optimal", [6.0]))
    with pytest.raises(ValueError, match="same episodes"):
        own.score(made("Optimal", [6.0, 6.0], start=np.array([0.0, 0.01])))


def test_episodes_say_what_happened():
    row = evaluate(MaxForce.from_env, ID, 3)
    env = gym.make(ID)
    controller = MaxForce.from_env(env)
    for i in range(3):
        observation, info = env.reset(seed=EVALUATION_SEED + i)
        assert row.start[i] == env.unwrapped.core.sim.tip_arclength[0]
        assert row.goal[i] == info["target"]
        cost, ended = 0.0, False
        while not ended:
            observation, _, terminated, truncated, info = env.step(controller.predict(observation)[0])
            cost, ended = cost + info["cost"], terminated or truncated
        assert row.cost[i] == pytest.approx(cost, rel=1e-12)
        assert row.path_ratio[i] == pytest.approx(info["path_ratio"])
        assert row.steps[i] == info["summary"]["steps"]
    assert np.isnan(row.rms_error).all()
    assert not row.tracking


def test_tracking_has_an_error_and_no_way():
    row = evaluate(MaxForce.from_env, "MagWire/Track-v0", 2)
    assert row.tracking
    assert np.isnan(row.path_ratio).all()
    assert "RMS error" in table([row])


def test_generated_tracts_are_ridden_once_each_and_in_order():
    env = make_batch("MagWire/SteerAny-v0", 3, {"split": "test", "pool_size": 1})
    assert env.unwrapped.core.sim.scenarios == scenario_pool("SteerAny", "test", 3)
    few, more = (evaluate(NetForce.from_env, "MagWire/SteerAny-v0", n, split="test") for n in (2, 4))
    assert np.array_equal(few.time, more.time[:2])
    assert len(set(more.goal)) == 4


def test_json_keeps_everything():
    row = made("mine", [7.0, np.nan])
    text = json.dumps(row.to_json(made("Optimal", [6.0, 6.0])), allow_nan=False)
    again = Episodes.from_json(json.loads(text))
    for field in dataclasses.fields(Episodes)[1:]:
        assert np.array_equal(getattr(again, field.name), getattr(row, field.name), equal_nan=True), field.name
        whole = field.name in ("steps", "unconverged")
        assert getattr(again, field.name).dtype.kind == getattr(row, field.name).dtype.kind or whole
    assert json.loads(text)["episodes"]["score"] == [pytest.approx(6 / 7), 0.0]


def test_the_table_has_a_score_where_there_is_a_par():
    rows = [made("Optimal", [6.0, 6.0]), made("mine", [7.5, 7.5])]
    text = table(rows, par=rows[0])
    assert "score (95 %)" in text
    assert "0.800 (0.800–0.800)" in text.splitlines()[3]
    assert "score" not in table(rows)
    assert len({line.count("|") for line in text.splitlines()}) == 1


@pytest.fixture(scope="module")
def rows():
    along = {name: c for name, c in CONTROLLERS.items() if name not in NOT_OF_TRACTS}
    return {name: evaluate(c.from_env, ID, 24, name=name) for name, c in along.items()}


def test_the_papers_policy_reaches_the_end_every_time_and_a_blind_one_does_not(rows):
    assert rows["MaxForce"].success.all()
    assert rows["ConstantRotation"].success.mean() < 0.2
    assert rows["Random"].success.mean() < 0.5


def test_evaluation_is_the_same_twice_and_paired(rows):
    again = evaluate(MaxForce.from_env, ID, 24)
    assert np.array_equal(again.time, rows["MaxForce"].time)
    assert paired_ratio(again, rows["MaxForce"]) == 1.0
    # The first lanes of a longer evaluation are the episodes of a shorter one.
    assert np.array_equal(evaluate(MaxForce.from_env, ID, 5).time, again.time[:5])


def test_the_interval_brackets_the_median_and_the_table_shows_all(rows):
    median, low, high = rows["MaxForce"].median_time()
    assert 6.0 < low < median < high < 9.0
    text = table(list(rows.values()))
    assert len(text.splitlines()) == 2 + len(rows)
    assert "| MaxForce | 100.0% |" in text
    assert rows["ConstantRotation"].to_json()["episodes"]["time"].count(None) > 10


def test_steps_that_are_not_to_be_trusted_are_said():
    """One substep of 0.3 s is too long for the wire; with its own choice of steps it is not."""
    slow = Scenario.paper().replace(timing__control_period=0.3)
    rough = slow.replace(timing__substeps=1)
    assert rough.step_too_long
    assert not slow.step_too_long
    found = evaluate(MaxForce.from_env, ID, 4, scenario=rough, time_limit=3.0)
    assert np.array_equal(found.unconverged, found.steps)
    assert found.summary()["untrusted_episodes"] == 4
    assert "MaxForce: 4 of 4 episodes have steps not to be trusted" in table([found])
    back = Episodes.from_json(json.loads(json.dumps(found.to_json())))
    assert np.array_equal(back.unconverged, found.unconverged)
    fine = evaluate(MaxForce.from_env, ID, 4, scenario=slow, time_limit=3.0)
    assert not fine.unconverged.any()
    assert "trusted" not in table([fine])


@pytest.mark.parametrize("name", ["Steer-v1-ppo-seed0", "a_very_long_name_of_a_policy_that_somebody_wrote"])
def test_the_terminals_table_fits_120_columns(rows, name):
    own = dataclasses.replace(rows["MaxForce"], policy=name, cost=np.full(len(rows["MaxForce"].time), 37.3381))
    text = table([own, *rows.values()], par=rows["MaxForce"], markdown=False)
    assert max(map(len, text.splitlines())) <= 120
    assert "37338.1" in text
    assert name[:8] in text
