"""The simulator's face: state in and out, rollouts, resets, the rig's servos, and what it refuses."""

import dataclasses
import math
import pickle

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from magwire_env.lumen.named import circle
from magwire_env.scenario import ActuatedMagnet, Rig, Scenario, Slide
from magwire_env.simulation import Places, Simulator
from tests.support.scenes import line, world

PAPER = Scenario.paper()
RNG = np.random.default_rng
FIELDS = ("wire", "magnet", "time", "lanes")
LOADS = ("drive_force", "lateral_force", "tip_torque", "wall_force", "tip_force", "tip_field", "tip_position")


def moved(n: int = 3, periods: int = 4) -> Simulator:
    sim = Simulator(PAPER, num_envs=n)
    sim.reset(tip_arclength=np.linspace(0.15, 0.5, n))
    for command in RNG(0).uniform(1, 5, (periods, n, 1)):
        sim.step(command)
    return sim


# --- resting ----------------------------------------------------------------------------------------------------------


@settings(deadline=None, derandomize=True, max_examples=25)
@given(st.floats(0.02, 0.85), st.sampled_from([(16, 0.1), (40, 0.1), (5, 0.05), (60, 0.3)]))
def test_reset_lays_the_wire_at_rest_behind_its_tip(tip, mesh):
    """Every chord at its rest length, every joint on the centreline (or its straight extension), no speed."""
    segments, length = mesh
    sim = Simulator(PAPER.replace(wire__segments=segments, wire__length=length))
    sim.reset(tip_arclength=tip)
    state, points = sim.state(), sim.positions[0]
    assert state.arclengths[0, -1] == sim.tip_arclength[0] == tip
    assert (np.diff(state.arclengths[0]) > 0).all()
    assert np.allclose(points, PAPER.tract.position(state.arclengths[0]), rtol=0, atol=1e-15)
    chords = np.linalg.norm(np.diff(points, axis=0), axis=1)
    assert np.allclose(chords, length / segments, rtol=1e-12)
    assert (state.velocities == 0).all()
    assert state.magnet.tolist() == [[math.pi]]
    assert state.time.tolist() == [0.0]


def test_reset_by_default_stands_just_inside_and_touches_only_its_lanes():
    sim = moved(4)
    before = sim.state()
    sim.reset(lanes=np.array([2]))
    after = sim.state()
    assert sim.tip_arclength[2] == PAPER.wire.length
    assert sim.time.tolist() == [before.time[0], before.time[1], 0.0, before.time[3]]
    for name in FIELDS:
        kept = [0, 1, 3]
        assert np.array_equal(getattr(after, name)[kept], getattr(before, name)[kept])
    sim.reset(tip_arclength=[0.3, 0.4], magnet=[[1.0], [2.0]], lanes=np.array([3, 0]))
    assert sim.tip_arclength[[3, 0]].tolist() == [0.3, 0.4]
    assert sim.magnet[[3, 0]].tolist() == [[1.0], [2.0]]


def test_on_a_loop_the_wire_goes_round_and_round():
    """Arc length counts on; a lap later everything is as it was."""
    loop = world(circle(0.4), rig=Rig((dataclasses.replace(PAPER.rig.magnets[0], position=(0.0, 0.02, 0.09)),)))
    sim = Simulator(loop, num_envs=2)
    sim.reset(tip_arclength=[0.13, 0.13 + loop.tract.length])
    for command in RNG(4).uniform(0, 6, (20, 1, 1)):
        sim.step(np.repeat(command, 2, axis=0))
    assert np.abs(np.diff(sim.tip_arclength) - loop.tract.length).max() <= 1e-10
    assert np.allclose(*sim.positions, rtol=0, atol=1e-10)
    assert np.ptp(sim.remaining_trace) >= 1e-3


# --- state ------------------------------------------------------------------------------------------------------------


def test_a_state_is_a_value():
    sim = moved()
    state = sim.state()
    assert state == sim.state()
    assert state == pickle.loads(pickle.dumps(state))
    assert len(state) == 3
    assert state[1] == sim.state([1])
    assert state[np.array([2, 0])] == sim.state([2, 0])
    for name in FIELDS:
        other = getattr(state, name).copy()
        other.flat[-1] += 1
        assert state != dataclasses.replace(state, **{name: other})
    assert state != "state"
    held = {name: getattr(state, name).copy() for name in FIELDS}
    sim.step(np.zeros((3, 1)))
    sim.reset()
    assert all(np.array_equal(held[name], getattr(state, name)) for name in FIELDS)


def test_load_state_goes_back_in_time():
    """The same future from a loaded state, in this simulator and in another, loads included."""
    sim = moved()
    state, plan = sim.state(), RNG(1).uniform(1, 5, (6, 3, 1))
    there = {name: getattr(sim, name) for name in LOADS}

    def future(simulator: Simulator) -> list:
        for command in plan:
            simulator.step(command)
        return [simulator.state()] + [getattr(simulator, name).tolist() for name in LOADS]

    first = future(sim)
    assert first[0] != state
    sim.load_state(state)
    assert sim.state() == state
    assert all(np.array_equal(there[name], getattr(sim, name)) for name in LOADS)
    assert future(sim) == first
    other = Simulator(PAPER, num_envs=3)
    other.load_state(pickle.loads(pickle.dumps(state)))
    assert future(other) == first


def test_the_state_of_a_single_lane_can_be_loaded_alone():
    sim = moved()
    early = sim.state([1])
    sim.step(np.full((3, 1), 2.0))
    late = sim.state()
    sim.load_state(early)
    assert sim.state([1]) == early
    assert sim.state([0, 2]) == late[np.array([0, 2])]


def test_handed_out_arrays_are_copies():
    sim = moved()
    held = sim.state()
    for name in (
        *LOADS,
        "tip_arclength",
        "tip_velocity",
        "magnet",
        "positions",
        "tip_tangent",
        "remaining_trace",
        "magnet_positions",
    ):
        getattr(sim, name)[...] = 7.0
    for name in FIELDS:
        getattr(sim.state(), name)[...] = 7
    assert sim.state() == held


# --- rollouts ---------------------------------------------------------------------------------------------------------


def test_rollout_is_stepping_and_leaves_the_simulator_alone():
    sim = moved()
    state, plans = sim.state(), RNG(2).uniform(0, 6, (3, 5, 7, 1))
    result = sim.rollout(state, plans)
    assert sim.state() == state
    names = ("tip_arclength", "tip_velocity", "drive_force", "lateral_force", "tip_torque", "wall_force")
    assert all(getattr(result, name).shape == (3, 5, 7) for name in names)
    for plan in range(5):
        sim.load_state(state)
        for period in range(7):
            sim.step(plans[:, plan, period])
            for name in names:
                assert np.array_equal(getattr(sim, name), getattr(result, name)[:, plan, period])
        end = sim.state()
        ours = result.end[np.array([plan, 5 + plan, 10 + plan])]
        assert ours == dataclasses.replace(end, lanes=ours.lanes, time=ours.time)
        assert ours.time == pytest.approx(end.time, rel=1e-14)
    assert result.end.lanes.tolist() == [0] * 5 + [1] * 5 + [2] * 5


def test_rollout_shares_plans_and_drops_the_axis_of_a_single_wire():
    sim = moved()
    state, plans = sim.state(), RNG(3).uniform(0, 6, (4, 3, 1))
    shared = sim.rollout(state, plans)
    assert np.array_equal(shared.tip_arclength, sim.rollout(state, np.broadcast_to(plans, (3, 4, 3, 1))).tip_arclength)
    single = sim.rollout(state[1], plans)
    assert single.tip_arclength.shape == (4, 3)
    assert np.array_equal(single.tip_arclength, shared.tip_arclength[1])


def test_rollout_follows_the_own_scenario_of_each_lane():
    others = [PAPER, PAPER.replace(contact__friction=0.2, wire__segments=9), PAPER.replace(coupling="wrench")]
    sim = Simulator(others)
    sim.reset(tip_arclength=0.4)
    plans = np.full((1, 5, 1), 3.3)
    result = sim.rollout(sim.state([2, 1, 0]), plans)
    for _ in range(5):
        sim.step(np.full((3, 1), 3.3))
    assert np.array_equal(result.tip_arclength[:, 0, -1], sim.tip_arclength[::-1])
    assert len(set(sim.tip_arclength)) == 3


# --- lanes and scenarios ----------------------------------------------------------------------------------------------


def test_assign_gives_a_lane_another_scenario_of_the_pool():
    pool = [PAPER, PAPER.replace(coupling="wrench", wire__length=0.08)]
    sim = Simulator(pool, num_envs=3, lane_scenario=np.array([0, 1, 0]))
    assert [sc.coupling for sc in sim.scenarios] == ["force", "wrench", "force"]
    sim.assign(np.array([0]), np.array([1]))
    sim.reset()
    assert [sc.coupling for sc in sim.scenarios] == ["wrench", "wrench", "force"]
    assert sim.tip_arclength.tolist() == [0.08, 0.08, 0.1]
    for _ in range(3):
        sim.step(np.full((3, 1), 4.0))
    assert sim.tip_arclength[0] == sim.tip_arclength[1] != sim.tip_arclength[2]
    for bad in ([2], [-1]):
        with pytest.raises(ValueError, match=r"scenarios must lie in \[0, 1\]"):
            sim.assign(np.array([0]), np.array(bad))
    assert [sc.coupling for sc in sim.scenarios] == ["wrench", "wrench", "force"]


def test_shorter_wires_have_nan_for_the_nodes_they_lack():
    sim = Simulator([PAPER, PAPER.replace(wire__segments=4)])
    lacking = np.isnan(sim.positions).all(axis=2)
    assert not lacking[0].any()
    assert lacking[1].tolist() == [True] * 12 + [False] * 5


def test_the_way_ahead_and_the_way_left():
    sim = moved()
    points, tangents, _ = sim.ahead([0.0, 0.02])
    assert np.allclose(points, PAPER.tract.position(sim.tip_arclength[:, None] + [0.0, 0.02]), rtol=0, atol=1e-15)
    assert np.allclose(tangents, PAPER.tract.tangent(sim.tip_arclength[:, None] + [0.0, 0.02]), rtol=0, atol=1.5e-5)
    assert np.array_equal(sim.remaining, PAPER.tract.length - sim.travelled)
    sim.set_goal([0, 2], Places([0.3, 0.4]))
    sim.refresh(np.arange(3))
    assert np.array_equal(sim.remaining, [0.3, PAPER.tract.length, 0.4] - sim.travelled)
    assert np.array_equal(sim.goals([2]).s, [0.4])
    sim.step(sim.magnet)
    assert np.array_equal(sim.remaining_trace[:, -1], sim.remaining)


# --- the rig's servos -------------------------------------------------------------------------------------------------


def test_a_turn_goes_the_short_way_round_at_its_speed():
    sim = Simulator(PAPER, num_envs=4)
    start, goal = np.array([0.1, 3.0, 3.0, 1.0]), np.array([-0.1, -3.0, 3.2 + 4 * np.pi, 1.0])
    way = np.array([-0.2, 2 * np.pi - 6.0, 0.2, 0.0])
    sim.reset(magnet=start[:, None])
    sim.step(goal[:, None])
    assert np.allclose(sim.magnet[:, 0], start + way, rtol=0, atol=1e-12)
    sim.reset(magnet=start[:, None])
    sim.step((start + 2.0)[:, None])
    assert np.allclose(sim.magnet[:, 0], start + np.pi * 0.1, rtol=0, atol=1e-12)  # π rad/s for 0.1 s


def test_a_slide_stops_at_its_limits_and_carries_the_magnet():
    slide = ActuatedMagnet(PAPER.rig.magnets[0].magnet, (0.0, 0.0, 0.1), (Slide("x", -0.05, 0.03, speed=0.1),))
    sim = Simulator(PAPER.replace(rig=Rig((slide,))), num_envs=2)
    for _ in range(12):
        sim.step([[1.0], [-1.0]])
    assert np.allclose(sim.magnet[:, 0], [0.03, -0.05], rtol=0, atol=1e-12)
    assert np.allclose(sim.magnet_positions[:, 0], [[0.03, 0, 0.1], [-0.05, 0, 0.1]], rtol=0, atol=1e-12)
    sim.reset()
    sim.step([[1.0], [-1.0]])
    assert np.allclose(sim.magnet[:, 0], [0.01, -0.01], rtol=0, atol=1e-12)


def test_loads_over_a_period_and_the_trace_of_the_way_left():
    """Peaks and means are over the substeps' own loads; the trace starts where the period did."""
    sim = moved()
    before = sim.remaining
    sim.step(np.full((3, 1), 0.5))
    trace = sim.remaining_trace
    assert trace.shape == (3, PAPER.substeps + 1)
    assert np.array_equal(trace[:, 0], before)
    assert np.array_equal(trace[:, -1], sim.remaining)
    assert (sim.peak_wall_force >= sim.mean_wall_force).all()
    assert (sim.mean_wall_force > 0.5 * sim.peak_wall_force).all()
    steady = Simulator(world(line(), rig=PAPER.rig, coupling="force"))
    steady.reset(tip_arclength=0.5)
    steady.load_state(steady.state().replaced(velocities=np.zeros((1, 17))))
    steady.step(steady.magnet)
    assert steady.peak_wall_force[0] == pytest.approx(steady.wall_force[0], rel=0.05)
    assert sim.time == pytest.approx([0.5] * 3)


# --- refusals ---------------------------------------------------------------------------------------------------------


BAD = [
    (lambda sim: sim.step(np.full((3, 1), np.nan)), r"command\[0\] must be finite \(in rad for turns, m for slides\)"),
    (lambda sim: sim.step([[1.0], [2.0], [np.inf]]), r"command\[2\] must be finite"),
    (lambda sim: sim.step(np.zeros(3)), r"command must have shape \(3, 1\), got \(3,\)"),
    (lambda sim: sim.step(np.zeros((2, 1))), r"command must have shape \(3, 1\), got \(2, 1\)"),
    (lambda sim: sim.reset(tip_arclength=[0.1, np.nan, 0.1]), r"tip_arclength must be one finite number or 3"),
    (lambda sim: sim.reset(tip_arclength=[0.1, 0.2]), r"tip_arclength must be one finite number or 3"),
    (lambda sim: sim.reset(0.3, magnet=[[0.0], [np.nan], [0.0]]), r"magnet\[1\] must be finite"),
    (lambda sim: sim.reset(0.3, magnet=[[0.0]]), r"magnet must have shape \(3, 1\), got \(1, 1\)"),
    (lambda sim: sim.rollout(sim.state(), np.full((2, 4, 1), np.nan)), r"plans must be finite"),
    (lambda sim: sim.rollout(sim.state(), np.zeros((2, 4, 2))), r"plans must have shape \(K, H, 1\) or \(3, K, H, 1\)"),
    (lambda sim: sim.rollout(sim.state(), np.zeros((2, 2, 4, 1))), r"plans must have shape"),
    (lambda sim: sim.load_state(Simulator(PAPER.replace(wire__segments=5)).state()), r"wire of shape \(1, 34\)"),
    (
        lambda sim: sim.load_state(dataclasses.replace(sim.state(), lanes=np.array([0, 1, 3]))),
        r"state\.lanes .* \[0, 2\]",
    ),
]


@pytest.mark.parametrize(("act", "named"), BAD, ids=range(len(BAD)))
def test_bad_input_is_refused_before_anything_moves(act, named):
    sim = moved()
    state, loads = sim.state(), [getattr(sim, name).tolist() for name in LOADS]
    with pytest.raises(ValueError, match=named):
        act(sim)
    assert sim.state() == state
    assert [getattr(sim, name).tolist() for name in LOADS] == loads
    sim.step(np.full((3, 1), 2.0))
    twin = moved()
    twin.step(np.full((3, 1), 2.0))
    assert sim.state() == twin.state()


@pytest.mark.parametrize(
    ("build", "named"),
    [
        (lambda: Simulator(PAPER, num_envs=0), r"num_envs must be a whole number of at least 1, got 0"),
        (lambda: Simulator(PAPER, num_envs=2.5), r"num_envs must be a whole number of at least 1, got 2\.5"),
        (lambda: Simulator(PAPER, num_envs=True), r"num_envs must be a whole number"),
        (lambda: Simulator(PAPER, threads=0), r"threads must be a whole number of at least 1, got 0"),
        (
            lambda: Simulator([PAPER, PAPER], num_envs=3),
            r"scenario must be one scenario or 3 \(num_envs\) of them, got 2",
        ),
        (lambda: Simulator([]), r"scenario must be one scenario or a sequence of at least one, got none"),
    ],
)
def test_impossible_simulators_are_refused(build, named):
    with pytest.raises(ValueError, match=named):
        build()
