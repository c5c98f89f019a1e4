"""Frames by content: colours are looked for where the state says they must be."""

from __future__ import annotations

import dataclasses
import math

import gymnasium as gym
import numpy as np
import pytest

from magwire_env import Scenario, Simulator
from magwire_env.physics import CylinderMagnet, PointDipole, field
from magwire_env.render import paint
from magwire_env.render.dofs import dofs_of
from magwire_env.render.frames import Frames
from magwire_env.render.panels import History
from magwire_env.render.snapshot import blend, magnet_rotations, snapshots
from magwire_env.scenario.rig import Coil, Rig, Slide, Turn

ID = "MagWire/Steer-v0"


def scene(options=None, **settings):
    """An env just reset, its frame and what draws it."""
    env = gym.make(ID, **settings).unwrapped
    env.reset(seed=1, options=options)
    frames = Frames(env.core)
    image = frames.array()[0]
    return env, image, frames.picture(snapshots(env.core)[0].scenario)


def where(image: np.ndarray, colour, rect) -> np.ndarray:
    """Pixels (n, 2), x and y, of exactly a colour within a rectangle of the frame."""
    part = image[rect.top : rect.bottom, rect.left : rect.right]
    rows, columns = np.nonzero((part == colour).all(axis=2))
    return np.stack([columns + rect.left, rows + rect.top], axis=1)


def middle(pixels: np.ndarray) -> np.ndarray:
    return (pixels.min(axis=0) + pixels.max(axis=0)) / 2


@pytest.mark.parametrize("tip", [0.1, 0.25, 0.4, 0.6, 0.78])
def test_the_tip_is_drawn_where_the_state_says(tip):
    env, image, picture = scene({"tip_arclength": tip, "magnet_angle": 2.0})
    position = env.simulator.tip_position[0]
    for view, rect in zip((picture.views.plan, picture.views.side), picture.views.frames, strict=True):
        found = where(image, paint.TIP, rect)
        assert len(found) > 4
        assert np.abs(middle(found) - view.px(position)).max() < 1.5


def test_the_views_are_to_scale_and_the_right_way_round():
    _, image, picture = scene()
    for view, rect, axes in zip(
        (picture.views.plan, picture.views.side), picture.views.frames, ((0, 1), (0, 2)), strict=True
    ):
        start = view.px(np.zeros(3))
        right, up = (view.px(0.01 * np.eye(3)[a]) - start for a in axes)
        assert right[0] > 0
        assert right[1] == 0
        assert up[1] == pytest.approx(-right[0])  # y down in the picture, the same scale
        # The bar at the lower left, as long as it says: 50 mm in the paper's scenario.
        bar = where(image, paint.INK, rect)
        bar = bar[bar[:, 1] >= rect.bottom - 9]
        line = bar[bar[:, 1] == rect.bottom - 8]
        ends = line[:, 0][: np.flatnonzero(np.diff(line[:, 0]) > 1)[0] + 1 if (np.diff(line[:, 0]) > 1).any() else None]
        assert np.ptp(ends) == pytest.approx(5 * right[0], abs=2)


@pytest.mark.parametrize("degrees", [0, 60, 135, 180, 250, 320])
def test_the_magnet_stands_at_its_angle(degrees):
    angle = math.radians(degrees)
    env, image, picture = scene({"magnet_angle": angle, "tip_arclength": 0.3})
    rect = picture.views.frames[1]
    centre = picture.views.side.px(env.simulator.magnet_positions[0, 0])
    poles = []
    for colour in (paint.NORTH, paint.SOUTH):
        found = where(image, colour, rect)
        near = found[np.hypot(*(found - centre).T) < 40]  # the block, not the tip's own poles
        poles.append(near.mean(axis=0))
    across, down = poles[0] - poles[1]
    assert math.remainder(math.atan2(across, -down) - angle, 2 * math.pi) == pytest.approx(0.0, abs=0.06)


@pytest.mark.parametrize("target", [0.3, 0.55, 0.79])
def test_the_target_is_drawn_across_the_lumen(target):
    _, image, picture = scene({"target": target, "tip_arclength": 0.1})
    for view, rect in zip((picture.views.plan, picture.views.side), picture.views.frames, strict=True):
        found = where(image, paint.TARGET, rect)
        assert np.abs(middle(found) - view.px(picture.scenario.tract.position(target))).max() < 2.5


def test_force_and_projection_point_along_the_forces():
    env, image, picture = scene({"tip_arclength": 0.55, "magnet_angle": 2.3})
    now, view = snapshots(env.core)[0], picture.views.plan
    tip = view.px(now.tip_position)
    for colour, force in ((paint.FORCE, now.tip_force), (paint.DRIVE, now.drive_force * now.tip_tangent)):
        found = where(image, colour, picture.views.frames[0])
        far = found[np.hypot(*(found - tip).T).argmax()] - tip
        wanted = view.direction(force) * 30.0 / picture.views.reference
        assert np.hypot(*(far - wanted)) < 3.5


def test_the_wire_is_shaded_by_the_wall_force():
    seen = []
    for angle in (0.0, 2.0):
        env, image, picture = scene({"tip_arclength": 0.55, "magnet_angle": angle})
        load = float(env.simulator.wall_force[0]) / picture.scenario.contact.wall_force_limit
        assert len(where(image, paint.load_colour(load), picture.views.frames[0])) > 100
        seen.append(paint.load_colour(load))
    assert seen[0] != seen[1]
    # Told apart by lightness alone, too.
    light = [sum(paint.load_colour(x)) for x in np.linspace(0, 1, 11)]
    assert (np.diff(light) > 0).all()


def test_the_map_shows_the_present_point_and_the_way_to_it():
    env, _, picture = scene({"tip_arclength": 0.1, "magnet_angle": 2.0})
    frames = Frames(env.core)
    for _ in range(20):
        env.step(np.array([-0.2], dtype=np.float32))
        image = frames.array()[0]
    panel = picture.map
    box = panel.axes.rect.move(panel.rect.topleft)
    dot = where(image, paint.TIP, box)
    here = (float(env.simulator.tip_arclength[0]), float(env.simulator.magnet[0, 0]))
    assert np.abs(middle(dot) - panel.axes.px(*here) - panel.rect.topleft).max() < 1.5
    assert panel.place(tuple(middle(dot))) == pytest.approx(here, abs=0.03)
    assert panel.place((5.0, 5.0)) is None
    assert len(where(image, paint.INK, box)) > 20


def test_nothing_moves_in_a_frame_drawn_twice():
    env, image, _ = scene()
    assert image.shape == (480, 640, 3)
    assert image.dtype == np.uint8
    frames = Frames(env.core)
    assert np.array_equal(frames.array()[0], frames.array()[0])


def _rigs():
    paper = Scenario.paper()
    mount = paper.rig.magnets[0]
    x, y, z = mount.position
    low, high = dataclasses.replace(mount, position=(x - 0.05, y, z + 0.02)), CylinderMagnet(0.03, 0.05, 1.3)
    return {
        "two turns": Rig((dataclasses.replace(mount, dofs=(Turn("y"), Turn("z"))),)),
        "slides": Rig((dataclasses.replace(mount, dofs=(Slide("x", -0.1, 0.1), Slide("y", -0.1, 0.1), Turn("y"))),)),
        "two magnets": Rig(
            (
                low,
                dataclasses.replace(low, magnet=high, position=(x + 0.05, y, z + 0.02), dofs=(Turn("x"),), dipoles=()),
            )
        ),
        "one slide": Rig(
            (dataclasses.replace(mount, magnet=PointDipole(100.0), dipoles=(), dofs=(Slide("x", -0.1, 0.1),)),)
        ),
        "coils": Rig((), (Coil("x", 1e-3, 0.05), Coil("z", 1e-3, 0.05))),
        "one coil": Rig((), (Coil("x", 0.0, 0.5),)),
        "magnet and coil": Rig((mount,), (Coil("x", 1e-3, 0.05),)),
    }


@pytest.mark.parametrize("name", list(_rigs()))
def test_every_rig_is_drawn_with_a_map_only_if_it_has_one_freedom(name):
    rig = _rigs()[name]
    env, image, picture = scene(scenario=dataclasses.replace(Scenario.paper(), rig=rig), coupling="wrench")
    assert (picture.map is None) == (len(rig.dofs) != 1)
    assert len(where(image, paint.TIP, picture.views.frames[0])) > 4
    texts = [dof.text(v) for dof, v in zip(dofs_of(picture.scenario), env.simulator.magnet[0], strict=True)]
    assert len(set(texts)) == len(rig.dofs)
    assert len(where(image, paint.NORTH, picture.views.frames[1])) > (100 if rig.magnets else 0)


def test_orientations_are_those_the_simulator_uses():
    """The field at the tip, from the magnets' clouds turned as drawn, is the simulator's."""
    rng = np.random.default_rng(3)
    for name in ("two turns", "slides", "two magnets"):
        scenario = dataclasses.replace(Scenario.paper(), rig=_rigs()[name], coupling="wrench")
        sim = Simulator(scenario)
        q = np.array([[rng.uniform(d.low, d.high) for d in dofs_of(scenario)]])
        sim.reset(tip_arclength=0.3, magnet=q)
        flux = np.zeros(3)
        for mount, turn, place in zip(
            scenario.rig.magnets, magnet_rotations(scenario, q[0]), sim.magnet_positions[0], strict=True
        ):
            flux += field(mount.magnet.dipoles(*mount.dipoles).moved(turn, place), sim.tip_position)[0]
        assert sim.tip_field[0] == pytest.approx(flux, rel=1e-6, abs=1e-9)


def test_a_history_ends_with_its_episode():
    env, _, _ = scene({"tip_arclength": 0.1})
    past = History()
    past.add(snapshots(env.core)[0])
    for _ in range(3):
        env.step(np.zeros(1, dtype=np.float32))
        past.add(snapshots(env.core)[0])
        past.add(snapshots(env.core)[0])
    assert len(past.time) == 4
    env.reset(seed=2)
    past.add(snapshots(env.core)[0])
    assert past.time == [0.0]
    assert len(past.force) == len(past.arclength) == len(past.goal) == len(past.command) == 1


def test_between_two_steps_everything_moves_together():
    env, _, _ = scene({"tip_arclength": 0.1, "magnet_angle": 2.0})
    before = snapshots(env.core)[0]
    for _ in range(5):
        env.step(np.zeros(1, dtype=np.float32))
    after = snapshots(env.core)[0]
    half = blend(before, after, 0.5)
    assert half.tip_arclength == pytest.approx((before.tip_arclength + after.tip_arclength) / 2)
    assert half.nodes == pytest.approx((before.nodes + after.nodes) / 2)
    assert blend(before, after, 1.0).time == after.time


def test_the_size_is_checked():
    env, _, _ = scene()
    with pytest.raises(ValueError, match="size must be 4 : 3"):
        Frames(env.core, (640, 640)).array()
    assert Frames(env.core, (960, 720)).array()[0].shape == (720, 960, 3)
