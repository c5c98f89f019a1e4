"""Fluoroscopic images: where things stand in them, what can be switched, noise by the seed, batch and single alike."""

from __future__ import annotations

import copy
import pickle
from itertools import pairwise

import gymnasium as gym
import numpy as np
import pytest
from gymnasium.utils.env_checker import check_env
from stable_baselines3.common.env_checker import check_env as sb3_check_env

import magwire_env  # noqa: F401  (registers the ids)
from magwire_env import Scenario
from magwire_env.envs.fluoroscope import roadmap
from magwire_env.envs.fluoroscopy import Fluoroscopy, projection
from magwire_env.envs.lanes_state import lanes_state, load_lanes
from magwire_env.lumen import LUMENS
from magwire_env.scenario import Reading

NAVIGATE, STEER = "MagWire/Navigate-v0", "MagWire/Steer-v1"
BARE = {"lumen": False, "target": False}
BRIGHT = 217
"""Grey where nothing absorbs."""


def made(task=STEER, others=(), scenario=None, **options):
    settings = {} if scenario is None else {"scenario": scenario}
    return gym.make(task, observe=(Fluoroscopy(**options), *others), **settings)


def seen_by(env):
    return env.unwrapped.core.shown.fluoroscope.projection_of(0)


def wanted(env, half, magnet_half):
    """The image of the wire alone, pixel by pixel from distances to its segments."""
    sim, size = env.unwrapped.simulator, env.observation_space["image"].shape[1]
    nodes = sim.positions[0]
    nodes = nodes[~np.isnan(nodes[:, 0])]
    places = seen_by(env).place(nodes)
    left = sim.scenarios[0].tip.height
    magnet = [nodes[-1]]
    for a, b in zip(nodes[-2::-1], nodes[:0:-1], strict=True):
        length = np.linalg.norm(a - b)
        magnet.append(b + min(1.0, left / length) * (a - b))
        left -= length
        if left <= 0:
            break
    y, x = np.mgrid[:size, :size] + 0.5
    image = np.full((size, size), float(BRIGHT))
    for chain, h, through in ((places, half, 0.35), (seen_by(env).place(np.array(magnet)), magnet_half, 0.0)):
        for a, b in pairwise(chain):
            way = b - a
            share = np.clip(((x - a[0]) * way[0] + (y - a[1]) * way[1]) / max(way @ way, 1e-12), 0, 1)
            away = np.hypot(x - a[0] - share * way[0], y - a[1] - share * way[1])
            image = np.minimum(image, BRIGHT * (1 - np.clip(h + 0.5 - away, 0, 1) * (1 - through)))
    return image


# --- projection -------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("lao", "cranial", "left", "head", "front"),
    [
        (0, 0, (1, 0), (0, -1), (0, 0)),
        (90, 0, (0, 0), (0, -1), (-1, 0)),  # from the patient's left: the front is at the left of the image
        (-90, 0, (0, 0), (0, -1), (1, 0)),
        (0, 90, (1, 0), (0, 0), (0, 1)),  # from the head: the front is below
        (0, -90, (1, 0), (0, 0), (0, -1)),
        (30, 0, (np.sqrt(3) / 2, 0), (0, -1), (-0.5, 0)),
    ],
)
@pytest.mark.parametrize("axes", ["", "LPS", "RAS"])
def test_the_c_arm_turns_as_its_angles_say(lao, cranial, left, head, front, axes):
    ways = {
        "": ((1, 0, 0), (0, 1, 0), (0, 0, 1)),
        "LPS": ((1, 0, 0), (0, 0, 1), (0, -1, 0)),
        "RAS": ((-1, 0, 0), (0, 0, 1), (0, 1, 0)),
    }[axes]
    seen = projection(LUMENS["fork"]().replace(axes=axes), Fluoroscopy(lao=lao, cranial=cranial))
    shown = (seen.place(1e-2 * np.array(ways)) - seen.shift) * seen.pixel / 1e-2
    assert shown == pytest.approx(np.array([left, head, front]), abs=1e-12)
    assert seen.depth == pytest.approx(np.cross(seen.across, seen.down))


def test_the_anatomy_fills_the_image_and_a_field_of_one_s_own_is_kept():
    lumen = LUMENS["straight"](length=0.1, radius=4e-3)
    seen = projection(lumen, Fluoroscopy(size=50))
    assert seen.place([(-4e-3, 0, 0), (0.104, 0, 0)]) == pytest.approx(np.array([(2, 25), (48, 25)]))
    assert seen.pixel == pytest.approx(0.108 / 46)
    assert projection(lumen, Fluoroscopy(size=50, field=0.2)).pixel == pytest.approx(4e-3)


@pytest.mark.parametrize("options", [{}, {"lao": 40, "cranial": -15}, {"size": 200, "lao": -60}, {"field": 0.05}])
@pytest.mark.parametrize("task", [NAVIGATE, STEER])
def test_the_wire_is_drawn_where_the_projection_puts_it(task, options):
    env = made(task, **BARE, **options)
    env.reset(seed=4)
    for _ in range(3):
        image = env.step(env.action_space.sample())[0]["image"][0]
    half = max(env.unwrapped.simulator.scenarios[0].wire.radius / seen_by(env).pixel, 0.5)
    magnet = max(env.unwrapped.simulator.scenarios[0].tip.diameter / 2 / seen_by(env).pixel, half + 0.6)
    assert np.abs(image - wanted(env, half, magnet)).max() < 0.51
    if not options.get("field"):
        column, row = seen_by(env).place(env.unwrapped.simulator.tip_position[0])
        assert image[int(row), int(column)] < 40
        assert image.max() == BRIGHT


def test_a_quarter_turn_shows_the_other_plane():
    """Two forks: the first parts in x–y, the second in x–z. From the front the second's branches lie in one line, from
    above (cranial 90°) the first's do."""
    lumen = LUMENS["two_forks"]()
    ends = np.array([lumen.position(name) for name in ("upper", "lower", "left", "right")])
    front, above = (projection(lumen, Fluoroscopy(cranial=angle)).place(ends) for angle in (0.0, 90.0))
    assert front[0] == pytest.approx(front[1])
    assert np.linalg.norm(front[2] - front[3]) > 20
    assert above[2, 1] == pytest.approx(above[3, 1])
    assert np.linalg.norm(above[0] - above[1]) > 20
    pictures = [roadmap(lumen, Fluoroscopy(cranial=angle)) for angle in (0.0, 90.0)]
    for place, picture in ((front, pictures[0]), (above, pictures[1])):
        for column, row in place:
            assert picture[int(row), int(column)] < BRIGHT - 30
    assert (pictures[0] != pictures[1]).mean() > 0.05


# --- lumen, target, noise ---------------------------------------------------------------------------------------------


def absorbed(thickness, usual):
    return BRIGHT / 255 / 0.85 * 255 * 0.85 * (1 - 0.55 * (1 - np.exp(-thickness / usual)))


def test_a_tube_is_as_grey_as_it_is_thick():
    radius = 4e-3
    lumen = LUMENS["straight"](length=0.1, radius=radius)
    picture = roadmap(lumen, Fluoroscopy(size=128, field=0.02))  # the middle of the tube
    off = (np.arange(128) + 0.5 - 64) * 0.02 / 128
    chord = 2 * np.sqrt(np.maximum(radius**2 - off**2, 0))
    assert np.abs(picture - absorbed(chord, 2 * radius)[:, None]).max() < 4
    assert (picture[np.abs(off) > radius + 2e-4] == BRIGHT).all()
    assert (roadmap(lumen, Fluoroscopy(size=128, lumen=False)) == BRIGHT).all()


def test_a_wall_of_its_own_counts_in_place_of_the_tubes():
    """The room is as thick everywhere; its branch's tube would be round."""
    room = LUMENS["box"](size=(0.1, 0.06, 0.04))
    seen = projection(room, Fluoroscopy())
    picture = roadmap(room, Fluoroscopy())
    corners = seen.place([(2e-3, 28e-3, 0), (98e-3, 28e-3, 0), (2e-3, -28e-3, 0), (98e-3, -28e-3, 0)])
    greys = {int(picture[int(row), int(column)]) for column, row in corners}
    assert len(greys) == 1
    usual = 2 * float(room.trunk.radius(0.05))
    assert greys.pop() == pytest.approx(absorbed(0.04, usual), abs=3)
    beyond = seen.place([(0.05, 34e-3, 0), (-4e-3, 20e-3, 0)])  # beside the way in
    assert [picture[int(row), int(column)] for column, row in beyond] == [BRIGHT, BRIGHT]


def test_the_target_is_ringed_where_it_is_and_the_ring_can_be_left_out():
    env, without = made(NAVIGATE), made(NAVIGATE, target=False)
    for target in ("RCCA", "LSA"):
        options = {"target": target}
        image = env.reset(seed=0, options=options)[0]["image"][0].astype(int)
        plain = without.reset(seed=0, options=options)[0]["image"][0].astype(int)
        core = env.unwrapped.core
        goal = core.sim.goals()
        column, row = seen_by(env).place(core.sim.scenarios[0].tree.branches[goal.branch[0]].curve.position(goal.s[0]))
        i, j = np.nonzero(image != plain)
        away = np.hypot(j + 0.5 - column, i + 0.5 - row)
        assert (away > 0.5).all()
        assert (away < 84 / 28 + 1.4).all()
        assert (image[i, j] > plain[i, j]).all()
        assert image.max() == 255
        assert plain.max() == BRIGHT
    back = made(STEER)  # the target moves to the way out when the tip has turned
    first = back.reset(seed=0)[0]["image"]
    back.unwrapped.core.sim.set_goal(np.zeros(1, dtype=int), np.array([0.15]))
    assert (back.unwrapped.core.observe()["image"][0] != first).sum() > 20


def test_a_wanted_shape_is_a_white_line():
    shown = [
        gym.make("MagWire/Shape-v0", observe={"lumen": False, "field": 0.25, "target": target})
        for target in (True, False)
    ]
    (with_line, told), (without, _) = (env.reset(seed=1) for env in shown)
    image, plain = with_line["image"][0].astype(int), without["image"][0].astype(int)
    assert plain.max() == BRIGHT  # no ring either: the goal is no place
    places = seen_by(shown[0]).place(told["target"])
    i, j = np.nonzero(image != plain)
    places = np.concatenate([places[:-1] + share * np.diff(places, axis=0) for share in np.linspace(0, 1, 20)])
    away = np.hypot(j[:, None] + 0.5 - places[:, 0], i[:, None] + 0.5 - places[:, 1]).min(axis=1)
    assert len(i) > 30
    assert away.max() < 1.1
    assert image.max() > 245


def test_noise_is_the_seed_s_own_and_as_strong_as_asked_for():
    env, clear = made(NAVIGATE, noise=0.04), made(NAVIGATE)
    action = np.array([0, 0, 0, 0], dtype=np.float32)
    pictures = [env.reset(seed=1)[0]["image"]] + [env.step(action)[0]["image"] for _ in range(2)]
    again = [env.reset(seed=1)[0]["image"]] + [env.step(action)[0]["image"] for _ in range(2)]
    assert all(np.array_equal(a, b) for a, b in zip(pictures, again, strict=True))
    assert np.array_equal(env.unwrapped.core.observe()["image"][0], pictures[-1])  # looking twice shows the same
    bare = clear.reset(seed=1)[0]["image"].astype(float)
    errors = pictures[0] - bare
    assert (errors != pictures[1] - clear.step(action)[0]["image"].astype(float)).mean() > 0.8
    other = env.reset(seed=2, options={"target": "LSA"})[0]["image"]
    assert (other[bare == BRIGHT] != pictures[0][bare == BRIGHT]).mean() > 0.8
    for grey in np.unique(bare):
        own = errors[bare == grey]
        if grey < 220 and len(own) > 300:  # brighter ones are cut at white
            spread = 255 * 0.04 * np.sqrt(grey / 255)
            assert own.std() == pytest.approx(spread, rel=0.12)
            assert abs(own.mean()) < 4 * spread / np.sqrt(len(own)) + 0.05


def test_noise_leaves_the_episode_s_own_draws_alone():
    for task in (NAVIGATE, "MagWire/Reach-v1"):
        told = [made(task, noise=noise).reset(seed=3)[1] for noise in (0.0, 0.1)]
        assert told[0] == told[1]


# --- as an env --------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("task", [NAVIGATE, STEER])
@pytest.mark.parametrize("observe", ["fluoroscopy", ("fluoroscopy", "tip_tangent", "magnet")])
@pytest.mark.filterwarnings("ignore:.*WARN:UserWarning")
def test_the_checkers_pass(task, observe):
    env = gym.make(task, observe=observe)
    names = ["image"] if observe == "fluoroscopy" else ["image", "state"]
    assert list(env.observation_space.spaces) == names
    assert env.observation_space["image"] == gym.spaces.Box(0, 255, (1, 84, 84), np.uint8)
    check_env(env.unwrapped, skip_render_check=True)
    sb3_check_env(env)


@pytest.mark.parametrize(("task", "noise"), [(NAVIGATE, 0.05), (STEER, 0.0), (STEER, 0.05)])
@pytest.mark.parametrize("threads", [1, 2])
def test_a_lane_of_a_batch_sees_what_the_single_env_sees(task, noise, threads):
    observe = (Fluoroscopy(lao=20, noise=noise), "tip_speed")
    envs = gym.make_vec(task, num_envs=5, observe=observe, threads=threads)
    batch, _ = envs.reset(seed=10)
    singles = [gym.make(task, observe=observe) for _ in range(5)]
    alone = [env.reset(seed=10 + i)[0] for i, env in enumerate(singles)]
    for step in range(4):
        assert envs.observation_space.contains(batch)
        for i, one in enumerate(alone):
            assert np.array_equal(one["image"], batch["image"][i]), (step, i)
            assert np.array_equal(one["state"], batch["state"][i])
        actions = envs.action_space.sample()
        batch = envs.step(actions)[0]
        alone = [env.step(actions[i])[0] for i, env in enumerate(singles)]


@pytest.mark.parametrize("mode", ["NextStep", "SameStep"])
def test_the_final_image_is_seen_at_an_episode_s_end(mode):
    observe = (Fluoroscopy(noise=0.03), "tip_speed")
    settings = {"observe": observe, "time_limit": 0.5}
    envs = gym.make_vec(STEER, num_envs=2, autoreset_mode=mode, **settings)
    single = gym.make(STEER, **settings)
    envs.reset(seed=3)
    single.reset(seed=3)
    for _ in range(5):
        batch, _, _, truncated, info = envs.step(np.zeros(envs.action_space.shape, dtype=np.float32))
        last = single.step(np.zeros(2, dtype=np.float32))[0]
    assert truncated.all()
    first = single.reset()[0]
    if mode == "SameStep":
        assert np.array_equal(info["final_obs"][0]["image"], last["image"])
        assert np.array_equal(info["final_obs"][0]["state"], last["state"])
        assert np.array_equal(envs.unwrapped.final_observation["image"][0], last["image"])
    else:
        assert np.array_equal(batch["image"][0], last["image"])
        batch = envs.step(np.zeros(envs.action_space.shape, dtype=np.float32))[0]
    assert np.array_equal(batch["image"][0], first["image"])


@pytest.mark.parametrize("carry", [copy.deepcopy, lambda x: pickle.loads(pickle.dumps(x))])
def test_copies_see_what_their_twin_sees(carry):
    env = made(NAVIGATE, ("tip_speed",), noise=0.05)
    env.reset(seed=0)
    twin = carry(env)
    for _ in range(2):
        action = env.action_space.sample()
        one, other = env.step(action)[0], twin.step(action)[0]
        assert np.array_equal(one["image"], other["image"])


def test_a_batch_goes_on_from_its_stored_state():
    make = lambda: gym.make_vec(STEER, num_envs=3, observe=Fluoroscopy(noise=0.05)).unwrapped  # noqa: E731
    envs, other = make(), make()
    envs.reset(seed=0)
    actions = np.full(envs.action_space.shape, 0.4, dtype=np.float32)
    for _ in range(3):
        envs.step(actions)
    load_lanes(other, lanes_state(envs))
    assert np.array_equal(other.core.observe()["image"], envs.core.observe()["image"])
    assert np.array_equal(other.step(actions)[0]["image"], envs.step(actions)[0]["image"])


def test_tracts_that_differ_are_each_drawn():
    envs = gym.make_vec("MagWire/SteerAny-v1", num_envs=3, observe="fluoroscopy", pool_size=3)
    seen, _ = envs.reset(seed=0)
    core = envs.unwrapped.core
    for lane in range(3):
        lumen = core.sim.scenarios[lane].tree
        same = seen["image"][lane, 0] == roadmap(lumen, Fluoroscopy())
        assert same.mean() > 0.95


def test_sensors_errors_are_the_numbers_own():
    exact, rough = Scenario.paper(), Scenario.paper().replace(sensing__speed=Reading(noise=0.02))
    observe = ("fluoroscopy", "tip_speed")
    seen = [gym.make(STEER, scenario=sc, observe=observe).reset(seed=0)[0] for sc in (exact, rough)]
    assert np.array_equal(seen[0]["image"], seen[1]["image"])
    assert seen[0]["state"] != seen[1]["state"]


@pytest.mark.parametrize(
    ("observe", "words"),
    [
        ({"size": 8}, "Fluoroscopy.size must be a whole number of at least 16, got 8"),
        ({"size": 4096}, "Fluoroscopy.size must be at most 512"),
        ({"size": 84.5}, "Fluoroscopy.size"),
        ({"lao": 200}, r"Fluoroscopy.lao must lie in \[-180, 180\] \(in degrees\), got 200"),
        ({"cranial": np.nan}, "Fluoroscopy.cranial must be finite"),
        ({"noise": -0.1}, r"Fluoroscopy.noise must lie in \[0, 0.5\]"),
        ({"noise": "much"}, "Fluoroscopy.noise must be a number"),
        ({"field": 0}, "Fluoroscopy.field must be greater than 0"),
        ({"lumen": 1}, "Fluoroscopy.lumen must be True or False, got 1"),
        ({"target": "RCCA"}, "Fluoroscopy.target must be True or False"),
        ({"angle": 30}, "Fluoroscopy takes size, lao, .*; got 'angle'"),
        (("fluoroscopy", "fluoroscopy"), "observe must ask for one image at most, got 2"),
        (("fluoroscopy", "x-ray"), "observe must name different channels of .*, fluoroscopy; got 'x-ray'"),
        (("fluoroscopy", 3), "observe must hold channels' names, 'fluoroscopy' or a Fluoroscopy, got 3"),
        ((), "observe must name different channels"),
    ],
)
def test_bad_options_are_refused_by_name(observe, words):
    with pytest.raises(ValueError, match=words):
        gym.make(STEER, observe=observe)


def test_axes_that_say_nothing_of_left_and_head_are_refused():
    with pytest.raises(ValueError, match="axes are one of '', 'LPS', 'RAS', got 'ASL'"):
        projection(LUMENS["fork"]().replace(axes="ASL"), Fluoroscopy())


def test_a_goal_env_refuses_images():
    with pytest.raises(ValueError, match="observe must name channels of numbers alone for a goal env"):
        gym.make("MagWire/ReachGoal-v0", observe="fluoroscopy")


def test_what_is_observed_stands_in_plain_values():
    env = made(STEER, ("magnet",), lao=30)
    assert env.unwrapped.core.shown.plain == ({"lao": 30.0}, "magnet")
    again = gym.make(STEER, observe=list(env.unwrapped.core.shown.plain))
    assert again.observation_space == env.observation_space
    assert again.unwrapped.core.shown.fluoroscope.options == Fluoroscopy(lao=30)
    assert Fluoroscopy().plain() == "fluoroscopy"
