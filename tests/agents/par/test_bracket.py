"""The bracket: a lower bound, a plan found, and the command that prints both."""

from __future__ import annotations

import pytest

import magwire_env  # noqa: F401  (registers the ids)
from agents.controllers import MaxForce, NetForce
from agents.evaluation.episodes import EVALUATION_SEED
from agents.evaluation.evaluator import evaluate
from agents.par.bound import Fastest
from agents.par.bracket import Bracket, bracket, brackets, least_times, main, nominal
from magwire_env import Scenario
from tests.support.episodes import QUICK, begun

STEER = "MagWire/Steer-v0"


def test_the_papers_bracket_is_narrow_and_holds_every_policy():
    paper = nominal(Scenario.paper(), settings=QUICK)
    assert (paper.lower < paper.upper).all()
    assert paper.gap[0] < 0.02
    found = bracket(episodes=12, settings=QUICK)
    assert isinstance(found, Bracket)
    assert (found.lower < found.upper).all()
    assert found.gap.mean() < 0.03
    for policy in (MaxForce, NetForce):
        time = evaluate(policy.from_env, STEER, 12).time
        assert (time > found.lower).all()
        assert (found.upper <= time).all()


def test_a_targets_bracket():
    found = bracket(task="MagWire/Reach-v0", episodes=4, settings=QUICK)
    assert (found.lower >= 1.0).all()
    assert (found.lower <= found.upper).all()


def test_tasks_without_a_nominal_start_and_no_episodes_are_named():
    with pytest.raises(ValueError, match="task"):
        nominal(Scenario.paper(), "MagWire/Track-v0")
    with pytest.raises(ValueError, match="episodes"):
        bracket(episodes=0)


def test_the_command_prints_the_bracket(capsys, tmp_path):
    main(["--episodes", "2", "--rounds", "2", "--cache", str(tmp_path)])
    printed = capsys.readouterr().out
    assert "magnets at their best" in printed
    assert "mean of 2 evaluation starts, 100.0% reached" in printed


def test_a_targets_bound_is_the_entry_and_the_whole_periods_of_the_hold():
    """Equation 8 of docs/par.md, by counting: no fewer periods let the tip be inside for the whole hold."""
    starts = begun("MagWire/Reach-v0", 20)
    found, task, period = least_times(starts), starts.task, starts.period
    substep = period / starts.library.substeps
    fastest = {direction: Fastest(starts.library.scenarios[0], direction) for direction in (1, -1)}
    for i in range(20):
        direction = 1 if starts.goal[i] > starts.tip[i] else -1
        edge = float(starts.goal[i]) - direction * task.tolerance
        entry = fastest[direction].least(float(starts.tip[i]), edge, float(starts.magnet[i, 0]))
        periods = 1
        # The tip is inside at the end of the first substep of the first held period, and in all later ones.
        while (periods - task.hold_periods(period)) * period + substep < entry - 1e-9:
            periods += 1
        assert found[i] == pytest.approx(periods * period, abs=1e-9)


def test_a_targets_bound_can_be_attained():
    """In every sixth of the evaluation's episodes the par is the bound, to the last period; this is one of them."""
    found = brackets(begun("MagWire/Reach-v0", 1, EVALUATION_SEED + 12), QUICK)
    assert found.upper[0] == pytest.approx(found.lower[0], abs=1e-9)
