"""Policies by name: registered by a user, given as module:Class, or saved in a folder."""

from __future__ import annotations

import sys
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest

from agents.benchmark.jobs import run_cells
from agents.benchmark.plan import Cell, content_of
from agents.catalogue import CONTROLLERS, FLOORS, PAR, REFERENCE, controller, register_controller, resolve
from agents.cli.main import main as magwire
from agents.controllers import Controller, MaxForce
from agents.evaluation.evaluator import evaluate
from tests.support.benchmark import ID, STEER, small

SOURCE = '''
import numpy as np
from agents.controllers import Controller


class Still(Controller):
    """Holds the action 0."""

    plans_online = True

    def act(self, observation, state, starts, deterministic):
        return np.zeros((len(observation), self.core.actuation.space.shape[0]), dtype=np.float32), state
'''


@pytest.fixture
def module(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[str]:
    """The name of an importable module outside the package, with a controller `Still`; workers can import it too."""
    (tmp_path / "own_controllers.py").write_text(SOURCE)
    monkeypatch.syspath_prepend(str(tmp_path))
    monkeypatch.setenv("PYTHONPATH", str(tmp_path))
    yield "own_controllers"
    sys.modules.pop("own_controllers", None)


@pytest.fixture
def registered(monkeypatch: pytest.MonkeyPatch) -> type[Controller]:
    """A controller of a user, registered for one test."""
    monkeypatch.setattr("agents.catalogue.CONTROLLERS", own := dict(CONTROLLERS))

    class Mine(MaxForce):
        pass

    register_controller(Mine)
    assert own["Mine"] is Mine
    return Mine


def test_what_is_listed():
    assert set(CONTROLLERS) >= {PAR, REFERENCE, *FLOORS, "NetForce", "PD", "MPPI", "ExtremumSeeking"}
    assert set(FLOORS) == {
        "HoldHome", "BestConstant", "BestConstantEach", "ConstantRotation", "Random", "untrained",
    }  # fmt: skip
    assert [name for name, kind in CONTROLLERS.items() if getattr(kind, "plans_online", False)] == ["MPPI"]


def test_a_registered_controller_has_a_name_everywhere(registered):
    assert controller("Mine") is registered
    own = resolve("Mine", split="test")
    assert (own.name, own.task, own.settings) == ("Mine", "MagWire/Steer-v1", {})
    assert np.array_equal(
        evaluate(own.policy, "MagWire/Steer-v1", 2).time, evaluate(MaxForce.from_env, "MagWire/Steer-v1", 2).time
    )


def test_registering_refuses_taken_names_bad_names_and_other_things(registered):
    for kind, name, words in (
        (MaxForce, None, "name must not be taken, got 'MaxForce'"),
        (registered, None, "name must not be taken, got 'Mine'"),
        (registered, "a:b", "name must be a word without ':' and '/', got 'a:b'"),
        (registered, "", "name must be a word"),
        (dict, "Dict", "kind must be a class with from_env"),
    ):
        with pytest.raises(ValueError, match=words):
            register_controller(kind, name)


def test_the_command_takes_a_class_from_outside_the_package(module, capsys):
    magwire(["evaluate", f"{module}:Still", "--episodes", "2", "--no-par"])
    assert "\nStill " in capsys.readouterr().out


@pytest.mark.parametrize(
    ("name", "words"),
    [
        ("no_such_module:Thing", "importable module:thing, got 'no_such_module:Thing'"),
        ("own_controllers:Other", "importable module:thing"),
        ("numpy:pi", "must name a class with from_env"),
        ("Nobody", "policy's folder, trained/…, an SB3 .zip, module:thing or one of MaxForce"),
    ],
)
def test_names_of_nothing_are_refused(module, name, words):
    with pytest.raises(ValueError, match=words):
        resolve(name)


def test_the_benchmark_takes_it_in_its_worker_processes(module, tmp_path):
    plan = small(STEER, extra=(f"{module}:Still",), episodes=2)
    cells = [cell for cell in plan.cells() if cell.policy.endswith(":Still")]
    assert [cell.kind for cell in cells] == ["evaluate", "decide"]
    assert not run_cells(plan, cells, tmp_path, workers=1)
    record = plan.record(Cell("evaluate", "Steer", f"{module}:Still"), tmp_path)
    assert record is not None
    assert len(record["episodes"]["success"]) == 2
    with pytest.raises(ValueError, match=r"module:thing or one of MaxForce.*got 'Still'"):
        small(STEER, extra=("Still",))


def test_the_benchmark_takes_files_and_folders_and_knows_them_by_their_content(run, tmp_path):
    own = tmp_path / "mine.py"
    own.write_text("def half(observation):\n    return 0.5 * observation[:, 4:5]\n", encoding="utf-8")
    names = (f"{own}:half", str(run[0]))
    plan = small(STEER, extra=names, episodes=2)
    cells = [cell for cell in plan.cells() if cell.policy in names]
    assert [(cell.kind, cell.policy) for cell in cells] == [("evaluate", name) for name in names]
    assert not run_cells(plan, cells, tmp_path / "out", workers=1)
    for cell in cells:
        assert cell.file(tmp_path / "out").parent == tmp_path / "out" / "evaluate"
        assert len(plan.record(cell, tmp_path / "out")["episodes"]["success"]) == 2
    own.write_text("def half(observation):\n    return 0.4 * observation[:, 4:5]\n", encoding="utf-8")
    content_of.cache_clear()
    assert [plan.state(cell, tmp_path / "out") for cell in cells] == ["outdated", "finished"]


def test_the_benchmark_opens_a_zip_only_where_it_is_trusted(tmp_path):
    (tmp_path / "mine.zip").write_bytes(b"PK")
    with pytest.raises(ValueError, match="--trust"):
        small(STEER, extra=(str(tmp_path / "mine.zip"),))


def test_the_settings_follow_task_scenario_and_split():
    assert resolve("MaxForce", "MagWire/SteerAny-v0", split="ood").settings == {"split": "ood"}
    assert resolve("MaxForce", "MagWire/SteerAny-v0").settings == {}
    own = resolve("MaxForce", "MagWire/SteerAny-v0", "hard", "ood")
    assert own.settings == own.same_episodes == {"scenario": "hard"}


def test_a_run_folder_is_a_policy_with_its_own_env(run):
    own = resolve(str(run[0]))
    assert (own.name, own.task) == ("small", ID)
    assert own.policy.about.algorithm == "ppo"
    assert resolve(str(run[0]), scenario="hard").settings["scenario"] == "hard"
