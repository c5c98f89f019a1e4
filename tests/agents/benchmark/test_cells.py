"""What the cells compute, and what they leave behind."""

from __future__ import annotations

import gzip
import json

import numpy as np
import pytest

from agents.benchmark.aggregates import collect, episode_records
from agents.benchmark.cells import make
from agents.benchmark.plan import Arena, Cell, Learner
from agents.benchmark.report import write
from agents.catalogue import CONTROLLERS
from agents.controllers import MaxForce
from agents.evaluation.evaluator import Episodes, evaluate
from agents.par.bracket import bracket
from tests.support.benchmark import ID, STEER, small


def test_a_cell_is_the_evaluation_it_stands_for(tmp_path):
    plan, cell = small(STEER), Cell("evaluate", "Steer", "MaxForce")
    assert plan.state(cell, tmp_path) == "missing"
    make(plan, cell, tmp_path)
    assert plan.state(cell, tmp_path) == "finished"
    stored = Episodes.from_json(plan.record(cell, tmp_path))
    assert np.array_equal(stored.time, evaluate(MaxForce.from_env, ID, 4).time)
    assert [p.name for p in (tmp_path / "evaluate").iterdir()] == ["Steer-MaxForce.json"]
    # Other settings, another result.
    assert small(STEER, episodes=2).state(cell, tmp_path) == "outdated"
    assert small(STEER, episodes=2).record(cell, tmp_path) is None


def test_a_damaged_record_is_named(tmp_path):
    plan, cell = small(STEER), Cell("evaluate", "Steer", "MaxForce")
    cell.file(tmp_path).parent.mkdir()
    cell.file(tmp_path).write_text('{"settings": ')
    with pytest.raises(ValueError, match=r"Steer-MaxForce\.json is damaged, delete it"):
        plan.state(cell, tmp_path)


def test_a_policy_that_refuses_its_arena_says_why(tmp_path, monkeypatch):
    class Picky(MaxForce):
        def __init__(self, env, **settings):
            raise ValueError("env must be of three magnets")

    monkeypatch.setitem(CONTROLLERS, "Picky", Picky)
    plan, cell = small(STEER), Cell("evaluate", "Steer", "Picky")
    assert make(plan, cell, tmp_path)["not_applicable"] == "env must be of three magnets"
    assert plan.state(cell, tmp_path) == "finished"


def test_one_decision_is_timed(tmp_path):
    record = make(small(STEER), Cell("decide", "Steer", "NetForce"), tmp_path)
    times = record["milliseconds"]
    assert 0.0 < times["q05"] <= times["median"] <= times["q95"] <= times["q99"] < record["seconds"] * 1e3


@pytest.mark.parametrize("task", ["MagWire/Steer-v0", "MagWire/Reach-v0"])
def test_the_par_stands_above_its_bound(task, tmp_path, monkeypatch):
    monkeypatch.setenv("MAGWIRE_CACHE", str(tmp_path / "cache"))
    plan = small(Arena("It", task, episodes=2))
    record = make(plan, Cell("par", "It", "Optimal"), tmp_path)
    par, bound = Episodes.from_json(record), np.array(record["lower_bound_s"])
    assert par.success.all()
    assert (bound < par.time).all()
    assert (bound > 0.7 * par.time).all()
    assert np.array_equal(bound, bracket(task=task, episodes=2).lower)  # what `python -m agents.par` prints


def test_training_then_playing(tmp_path):
    plan = small(STEER, learners=(Learner("ppo", ("Steer",), 1),), timesteps=4096)
    training, playing = plan.trained(STEER)["ppo"][0], Cell("evaluate", "Steer", "ppo", 0)
    with pytest.raises(FileNotFoundError, match="'train Steer ppo seed 0' is not finished"):
        make(plan, playing, tmp_path)
    training.run(tmp_path).mkdir(parents=True)  # left by a run that was killed before its first checkpoint
    record = make(plan, training, tmp_path)
    assert record["settings"]["hyperparameters"]["n_timesteps"] == 4096
    assert record["curve"].startswith("timesteps,")
    assert len(make(plan, playing, tmp_path)["episodes"]["success"]) == 4
    # A checkpoint of the same settings is gone on with.
    assert make(plan, training, tmp_path)["resumed"] is True
    # Another training is another model to play with.
    assert small(STEER, learners=plan.learners, timesteps=8192).state(playing, tmp_path) == "outdated"


def test_every_score_can_be_computed_again_from_the_stored_episodes(tmp_path):
    plan = small(STEER)
    for cell in (Cell("evaluate", "Steer", "MaxForce"), Cell("evaluate", "Steer", "HoldHome")):
        make(plan, cell, tmp_path)
    stored = episode_records(plan, tmp_path)
    assert list(stored) == ["evaluate Steer MaxForce", "evaluate Steer HoldHome"]
    write(collect(plan, tmp_path), tmp_path / "docs", episodes=stored)
    packed = gzip.decompress((tmp_path / "docs" / "benchmark_episodes.json.gz").read_bytes())
    again = Episodes.from_json(json.loads(packed)["evaluate Steer MaxForce"])
    assert again.time == pytest.approx(evaluate(MaxForce.from_env, STEER.task, STEER.episodes).time)
    assert "benchmark_episodes.json.gz" in (tmp_path / "docs" / "benchmark.md").read_text()


def test_a_cell_is_outdated_when_the_code_it_stands_on_has_changed(tmp_path, monkeypatch):
    plan, cell = small(STEER), Cell("evaluate", "Steer", "HoldHome")
    make(plan, cell, tmp_path)
    assert plan.state(cell, tmp_path) == "finished"
    monkeypatch.setattr("agents.benchmark.plan.code_digest", lambda learns: "other")
    assert plan.state(cell, tmp_path) == "outdated"


def test_a_controllers_cell_does_not_stand_on_the_code_of_learning():
    plan = small(STEER)

    def code(policy, seed=None, kind="evaluate"):
        return plan.settings(Cell(kind, "Steer", policy, seed))["code"]

    assert code("HoldHome") == code("MPPI") == code("Optimal", kind="par")
    assert code("ppo", 0) == code("ppo", 0, "train") == code("untrained") != code("HoldHome")
