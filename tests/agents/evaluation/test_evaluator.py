"""Statistics against closed forms; episodes, their scores and their tracts; the command's table."""

from __future__ import annotations

import dataclasses
import json

import gymnasium as gym
import numpy as np
import pytest
from scipy.stats import trim_mean

from agents.cli.main import main as magwire
from agents.controllers import MaxForce, NetForce
from agents.evaluation.evaluator import EVALUATION_SEED, Episodes, evaluate, make_batch, table
from agents.evaluation.statistics import interquartile_mean, interval, median, performance_profile, stratified_bootstrap
from magwire_env.quasistatic.pool import scenario_pool

ID = "MagWire/Steer-v0"


def made(policy: str, time: list[float], **changed: np.ndarray) -> Episodes:
    """Made-up episodes of a steering task; NaN times were not reached."""
    t = np.array(time)
    fields = {f.name: np.zeros(len(t)) for f in dataclasses.fields(Episodes) if f.name != "policy"}
    fields |= {"success": np.isfinite(t), "time": t, "rms_error": np.full(len(t), np.nan), "goal": np.ones(len(t))}
    return Episodes(policy, **fields | changed)


@pytest.mark.parametrize("n", [1, 2, 3, 4, 5, 8, 11, 40])
def test_the_interquartile_mean_is_scipys_trimmed_mean(n):
    values = np.random.default_rng(n).standard_normal((3, n))
    assert interquartile_mean(values) == pytest.approx(trim_mean(values, 0.25, axis=1), abs=1e-12)


def test_the_interquartile_mean_of_known_numbers():
    assert interquartile_mean(np.array([100.0, 3.0, 1.0, 2.0, -50.0, 4.0, 0.0, 5.0])) == 2.5


def test_the_bootstrap_interval_covers_the_true_value_as_often_as_it_says():
    rng = np.random.default_rng(0)
    hits = 0
    for i in range(300):
        groups = [rng.normal(centre, 1.0, 30) for centre in (0.0, 3.0)]
        _, low, high = stratified_bootstrap(groups, lambda x: x.mean(axis=-1), resamples=300, seed=i)
        hits += low <= 1.5 <= high
    # 95 % less the bootstrap's known shortfall of √(29/30) in width; three standard errors of 300 trials to each side.
    assert 0.90 < hits / 300 < 0.985


def test_strata_are_resampled_within_themselves():
    groups = [np.zeros(5), np.ones(15)]
    assert stratified_bootstrap(groups, lambda x: x.mean(axis=-1)) == (0.75, 0.75, 0.75)
    value, low, high = stratified_bootstrap([np.concatenate(groups)], lambda x: x.mean(axis=-1))
    assert low < value < high


def test_the_bootstraps_width_is_that_of_the_mean():
    values = np.random.default_rng(3).standard_normal(400)
    _, low, high = stratified_bootstrap([values], lambda x: x.mean(axis=-1), resamples=4000)
    assert high - low == pytest.approx(2 * 1.96 * values.std() / 20, rel=0.05)


def test_intervals_of_nothing_are_not_numbers():
    assert all(np.isnan(interval([], median)))
    assert all(np.isnan(interval([np.empty(0)], median)))
    assert interval([np.empty(0), np.ones(3)], median) == (1.0, 1.0, 1.0)


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (([],), "groups must be arrays"),
        (([np.empty(0)],), "groups must be arrays"),
        (([np.array([1.0, np.nan])],), "got NaN"),
        (([np.ones(3)], median, 100, 1.0), "confidence must lie in"),
        (([np.ones(3)], median, 0), "resamples must be"),
    ],
)
def test_the_bootstrap_refuses_bad_input(arguments, words):
    with pytest.raises(ValueError, match=words):
        stratified_bootstrap(*arguments)


def test_the_performance_profile_is_one_less_the_distribution():
    scores = np.array([0.0, 0.5, 1.0, 1.0])
    assert performance_profile(scores, np.array([-0.1, 0.0, 0.4, 0.5, 1.0])).tolist() == [1.0, 0.75, 0.75, 0.5, 0.0]
    both = performance_profile(np.stack([scores, scores + 1.0]), np.array([0.5]))
    assert both.tolist() == [[0.5], [1.0]]


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
        assert getattr(again, field.name).dtype.kind == getattr(row, field.name).dtype.kind or field.name == "steps"
    assert json.loads(text)["episodes"]["score"] == [pytest.approx(6 / 7), 0.0]


def test_the_table_has_a_score_where_there_is_a_par():
    rows = [made("Optimal", [6.0, 6.0]), made("mine", [7.5, 7.5])]
    text = table(rows, par=rows[0])
    assert "score (95 %)" in text
    assert "0.800 (0.800–0.800)" in text.splitlines()[3]
    assert "score" not in table(rows)
    assert len({line.count("|") for line in text.splitlines()}) == 1


def test_the_command_without_a_par(tmp_path, capsys):
    magwire(["evaluate", "NetForce", "--episodes", "2", "--no-par", "--out", str(tmp_path / "r.json")])
    text = capsys.readouterr().out
    assert "| NetForce | 100.0% |" in text
    assert "| MaxForce | 100.0% |" in text
    assert "score" not in text
    stored = json.loads((tmp_path / "r.json").read_text())["NetForce"]
    assert len(stored["episodes"]["cost"]) == 2
    assert "score" not in stored["summary"]
