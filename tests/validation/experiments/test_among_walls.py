"""The magnetic continuum robot among walls: it follows poses that it made itself in a bent lumen, and only there."""

import math

import numpy as np
import pytest

from magwire_env.lumen import Lumen
from magwire_env.simulation.simulator import Simulator
from magwire_env.validation.experiments import EXPERIMENTS, among_walls, continuum_robot
from magwire_env.validation.experiments.among_walls import INLET, OFFSET, TURN, commands_of, followed, in_lumen, tips_of
from magwire_env.validation.experiments.continuum_robot import VESSEL, run

FIELD = 0.03
WEIGHTS = (4e-3, math.radians(4.0))


def bent(begin: np.ndarray = INLET) -> Lumen:
    """A tube of 8 mm that turns by 62° one way and back, from the sheath on."""
    turns = np.cumsum([0.0] * 5 + [0.18] * 6 + [-0.18] * 9) + TURN + 0.09
    steps = 0.01 * np.stack([np.sin(turns), np.cos(turns), 0.0 * turns], axis=-1)
    points = [*begin, 0.0] + np.vstack([np.zeros(3), np.cumsum(steps, axis=0)])
    return Lumen.from_lines([("trunk", points, 4e-3, None)])


@pytest.fixture(scope="module")
def poses() -> np.ndarray:
    """(8, 3) in the frame of the lumen: what the robot did under commands that are not told."""
    sim = Simulator(in_lumen(bent()), 1, threads=1)
    lengths, angles = np.linspace(0.02, 0.09, 8), TURN + 0.09 + 0.4 * np.sin(0.8 * np.arange(8))
    found = []
    for length, angle in zip(lengths, angles, strict=True):
        for _ in range(3):
            sim.step(commands_of(np.array([length]), np.array([angle]), FIELD))
        found.append(tips_of(sim)[0])
    return np.array(found)


def test_the_robot_finds_its_own_poses_again(poses):
    gaps, failed = followed(poses, bent(), FIELD, WEIGHTS)
    assert failed == 0
    assert np.hypot(gaps[:, 0], gaps[:, 1]).mean() < 1e-3
    assert np.abs(gaps[:, 2]).mean() < math.radians(2.0)


def test_it_cannot_follow_them_through_another_lumen(poses):
    begin = [*INLET, 0.0]
    way = 0.1 * np.array([math.sin(TURN - 0.5), math.cos(TURN - 0.5), 0.0])
    straight = Lumen.from_lines([("trunk", np.linspace(begin, begin + 2 * way, 9), 2e-3, None)])
    gaps, _ = followed(poses, straight, FIELD, WEIGHTS)
    assert np.hypot(gaps[-1, 0], gaps[-1, 1]) > 10e-3


def test_the_experiment_takes_the_lumen_of_a_file(poses, tmp_path, monkeypatch):
    c, s = math.cos(TURN), math.sin(TURN)
    x, y = poses[:, 0], poses[:, 1]
    in_the_run = np.column_stack([c * x - s * y - OFFSET[0], s * x + c * y - OFFSET[1], poses[:, 2] - TURN])
    lines = ["run,t_s,x_m,y_m,angle_rad"]
    for name, some in ((VESSEL, in_the_run), ("9978_free", np.array([[0.0, 0.0, 0.0], [5e-3, 5e-3, 0.3]]))):
        lines += [f"{name},{k},{a},{b},{angle}" for k, (a, b, angle) in enumerate(some.tolist())]
    data, lumen = tmp_path / "poses.csv", tmp_path / "bent.lumen"
    data.write_text("\n".join(lines), encoding="utf-8")
    bent().save(lumen)
    setting = continuum_robot.Setting(FIELD, 2.4e-3, -74e-3, 0.0)  # the open run here is made up
    monkeypatch.setattr(continuum_robot, "fitted_setting", lambda *_args, **_options: setting)
    outcome = run(data, lumen)
    place, angle = (row for row in outcome.rows if row.quantity.startswith("vessel run, in its lumen"))
    assert place.ours < 1.0  # mm
    assert angle.ours < 2.0  # °


def test_a_lumen_that_does_not_begin_at_the_sheath_is_refused(tmp_path):
    bent(INLET + 0.05).save(tmp_path / "off.lumen")
    with pytest.raises(ValueError, match="lumen must begin within 20 mm of"):
        among_walls.load_lumen(tmp_path / "off.lumen")


def test_an_experiment_without_walls_refuses_a_lumen(tmp_path):
    with pytest.raises(ValueError, match="lumen must be left out, since the experiment 'turning' has no walls"):
        EXPERIMENTS["turning"](tmp_path, tmp_path / "some.lumen")
