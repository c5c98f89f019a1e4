"""The benchmark's plan, its cells, and their running: resumed, failed, refused."""

from __future__ import annotations

import json

import numpy as np
import pytest

from agents.benchmark import cells as kinds
from agents.benchmark.cells import make
from agents.benchmark.jobs import jobs_of, run_cells, selected
from agents.benchmark.plan import ARENAS, HARD, LEARNERS, Arena, Cell, Learner, Plan
from agents.cli.main import main as magwire
from agents.controllers import CONTROLLERS, MaxForce
from agents.evaluation.evaluator import Episodes, evaluate
from magwire_env.envs.task import TASKS
from magwire_env.scenario import Scenario

ID = "MagWire/Steer-v0"
STEER = Arena("Steer", ID, episodes=4)


def small(*arenas: Arena, learners: tuple[Learner, ...] = (), **changed) -> Plan:
    return Plan(arenas, learners, robustness={}, **changed)


def test_every_registered_task_is_an_arena():
    assert {arena.task for arena in ARENAS} == set(TASKS)
    by_name = {arena.name: arena for arena in ARENAS}
    assert len(by_name) == len(ARENAS)
    for name, task in (("Steer", "MagWire/Steer-v0"), ("Chase", "MagWire/Chase-v0")):
        assert by_name[name].task == task
    for name in ("SteerAny", "Chase"):
        assert (by_name[name].split, by_name[name].episodes) == ("test", 500)
        assert by_name[f"{name} ood"].models == name
    assert by_name["Hard"].scenario == HARD
    Scenario.load(HARD)


def test_the_cells_are_what_was_asked_for():
    plan = Plan()
    cells = plan.cells()
    assert len({cell.name for cell in cells}) == len({cell.file(plan_out := kinds.Path("out")) for cell in cells})
    assert len({cell.log(plan_out) for cell in cells}) == len(set(cells)) == len(cells)
    trained = [cell for cell in cells if cell.kind == "train"]
    for learner in LEARNERS:
        for name in learner.arenas:
            assert sum((c.arena, c.policy) == (name, learner.algorithm) for c in trained) == learner.seeds
    assert not any(cell.arena.endswith("ood") for cell in trained)
    assert sum((c.kind, c.arena, c.policy) == ("evaluate", "Chase ood", "ppo") for c in cells) == 5
    for cell in cells:
        needed = plan.training_of(cell)
        assert (needed is not None) == (cell.kind != "train" and cell.seed is not None)
        assert needed is None or cells.index(needed) < cells.index(cell)
        json.dumps(plan.settings(cell))


def test_every_policy_meets_every_arena():
    cells = Plan().cells()
    for arena in ARENAS:
        if arena.controllers is None:
            met = {cell.policy for cell in cells if cell.arena == arena.name and cell.kind in ("evaluate", "par")}
            assert met >= set(CONTROLLERS), arena.name


def test_patterns_choose_cells():
    cells = Plan().cells()
    assert [c.name for c in selected(cells, ["evaluate Steer NetForce"])] == ["evaluate Steer NetForce"]
    assert {c.kind for c in selected(cells, ["train*ppo", "par Steer"])} == {"train", "par"}
    assert selected(cells, []) == cells
    with pytest.raises(ValueError, match="only must match some cell's name"):
        selected(cells, ["nothing of the kind"])


def test_jobs_hold_every_cell_once_and_wait_for_training():
    plan = Plan()
    cells = plan.cells()
    jobs = jobs_of(plan, cells)
    assert sorted(c.name for job in jobs for c in job.cells) == sorted(c.name for c in cells)
    chase = next(job for job in jobs if Cell("evaluate", "Chase ood", "ppo", 2) in job.cells)
    assert Cell("train", "Chase", "ppo", 2) in chase.needs
    # What is not asked for is not waited for.
    assert not jobs_of(plan, [Cell("evaluate", "Chase ood", "ppo", 2)])[0].needs


@pytest.mark.parametrize("name", ["episodes", "timesteps", "seeds"])
def test_a_plan_refuses_nothing_to_do(name):
    with pytest.raises(ValueError, match=f"{name} must be at least 1, got 0"):
        Plan(**{name: 0})


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


def test_failures_are_reported_and_the_rest_goes_on(tmp_path, capfd):
    bad = Arena("Nowhere", ID, scenario="no-such-scenario", episodes=2)
    plan = small(STEER, bad)
    chosen = [Cell("evaluate", arena, name) for arena in ("Nowhere", "Steer") for name in ("MaxForce", "Random")]
    failed = run_cells(plan, chosen, tmp_path, workers=2)
    assert sorted(cell.name for cell in failed) == ["evaluate Nowhere MaxForce", "evaluate Nowhere Random"]
    assert "no shipped scenario of that name" in failed[0].log(tmp_path).read_text()
    assert "Traceback" in failed[0].log(tmp_path).read_text()
    assert [plan.state(cell, tmp_path) for cell in chosen[2:]] == ["finished"] * 2
    said = capfd.readouterr().out
    assert "FAILED    evaluate Nowhere MaxForce" in said
    assert "done      evaluate Steer Random" in said
    with pytest.raises(ValueError, match="workers must be at least 1, got 0"):
        run_cells(plan, chosen, tmp_path, workers=0)


def test_the_command_lists_makes_and_goes_on(tmp_path, capsys):
    arguments = ["benchmark", "--out", str(tmp_path), "--episodes", "2", "--only", "evaluate Steer MaxForce"]
    magwire([*arguments, "--dry-run"])
    assert capsys.readouterr().out == "missing   evaluate Steer MaxForce\n"
    assert not any(tmp_path.iterdir())
    magwire([*arguments, "--workers", "1"])
    assert "1 cells to make, 0 finished" in capsys.readouterr().out
    written = (tmp_path / "evaluate" / "Steer-MaxForce.json").stat().st_mtime_ns
    magwire([*arguments, "--workers", "1"])
    assert "0 cells to make, 1 finished" in capsys.readouterr().out
    assert (tmp_path / "evaluate" / "Steer-MaxForce.json").stat().st_mtime_ns == written
    page = (tmp_path / "benchmark.md").read_text()
    assert "| MaxForce | 100 % |" in page
    assert "evaluate Steer NetForce" in page.partition("**Missing**")[2].splitlines()[0]
    with pytest.raises(SystemExit, match="only must match some cell's name"):
        magwire([*arguments[:-1], "nonsense"])
