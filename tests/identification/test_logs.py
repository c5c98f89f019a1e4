"""Logs: CSV there and back, and what is refused."""

import numpy as np
import pytest

from magwire_env import Scenario
from magwire_env.identification import Log, record
from magwire_env.identification.logs import start_of

GOOD = "time,command_0,tip_arclength\n0.0,3.1,0.15\n0.1,3.2,\n0.2,3.3,0.16\n"


def written(tmp_path, text):
    path = tmp_path / "log.csv"
    path.write_text(text, encoding="utf-8")
    return path


def test_a_log_survives_being_saved(tmp_path):
    log = record(Scenario.paper(), seconds=1.0, columns=("tip_x", "tip_speed", "lateral_force"))
    log.save(tmp_path / "log.csv")
    again = Log.load(tmp_path / "log.csv")
    old, new = log.episodes[0], again.episodes[0]
    assert again.columns == log.columns
    np.testing.assert_allclose(new.commands, old.commands, rtol=1e-8)
    np.testing.assert_allclose(new.rig, old.rig, rtol=1e-8)
    for name in log.columns:
        np.testing.assert_allclose(new.measured[name], old.measured[name], rtol=1e-8, atol=1e-12)


def test_an_empty_cell_is_a_moment_without_a_measurement(tmp_path):
    episode = Log.load(written(tmp_path, "# a remark\n" + GOOD)).episodes[0]
    assert np.isnan(episode.measured["tip_arclength"]).tolist() == [False, True, False]
    assert start_of(episode, Scenario.paper()) == 0.15


def test_the_start_is_found_from_the_tip_s_position(tmp_path):
    sc = Scenario.paper()
    log = record(sc, seconds=0.2, start=0.2, noise={})
    assert start_of(log.episodes[0], sc) == pytest.approx(0.2, abs=1e-5)


def test_episodes_are_told_apart_by_their_number(tmp_path):
    text = "episode,time,command_0,tip_arclength\n" + "".join(
        f"{e},{0.1 * k},3.0,0.15\n" for e in (4, 7) for k in range(3)
    )
    assert [len(ep) for ep in Log.load(written(tmp_path, text)).episodes] == [3, 3]


@pytest.mark.parametrize(
    ("text", "told"),
    [
        (GOOD.replace("3.2", "x"), "line 3, column 'command_0' must be a number or empty, got 'x'"),
        (GOOD.replace("3.2", "inf"), "must be finite or empty"),
        (GOOD.replace("3.2", ""), "must have a number in every cell of the column 'command_0'"),
        (GOOD.replace("0.1,3.2,", "0.1,3.2"), "must have 3 cells"),
        (GOOD.replace("tip_arclength", "tip_lenght"), "'tip_lenght'"),
        (GOOD.replace("command_0", "command_1"), "command_0, command_1"),
        (GOOD.replace("0.16", "160"), "in SI units"),
        ("time,command_0\n0.0,3.1\n", "got none"),
        ("time,command_0,tip_x\n", "at least one row"),
    ],
)
def test_what_is_wrong_with_a_log_is_named(tmp_path, text, told):
    with pytest.raises(ValueError, match=told):
        Log.load(written(tmp_path, text))


def test_a_log_of_another_rig_or_period_is_refused(tmp_path):
    log = Log.load(written(tmp_path, GOOD))
    log.fits(Scenario.paper())
    with pytest.raises(ValueError, match=r"control period of 0.05 s"):
        log.fits(Scenario.paper().replace(timing__control_period=0.05))
    two = Log.load(written(tmp_path, "time,command_0,command_1,tip_x\n0,1,1,0.1\n0.1,1,1,0.1\n"))
    with pytest.raises(ValueError, match="each of the 1 degrees of freedom"):
        two.fits(Scenario.paper())


def test_a_log_that_does_not_say_where_the_tip_is_at_first_is_refused(tmp_path):
    log = Log.load(written(tmp_path, GOOD.replace("0.15", "")))
    with pytest.raises(ValueError, match="first row of episode 0 must say where the tip is"):
        start_of(log.episodes[0], Scenario.paper())
