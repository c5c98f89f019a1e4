"""The free wire behind the simulator: it touches, is fed, reads in newtons, and is put back exactly."""

import copy
import pickle
import subprocess
import sys

import numpy as np
import pytest

from magwire_env import Scenario, Simulator
from magwire_env.lumen.named import straight
from magwire_env.simulation import Places
from magwire_env.simulation.free import layout as at
from magwire_env.simulation.lanes import LANES
from tests.support.free import fed_fork, paper_free, soft_wire

UP = np.pi / 2


def commands(n: int, steps: int, seed: int = 0) -> np.ndarray:
    """Held random commands of the fork's rig with a feed that goes in, (steps, n, 4)."""
    rng = np.random.default_rng(seed)
    turns = rng.uniform(-1.0, 1.0, (steps // 4 + 1, n, 3)).repeat(4, axis=0)[:steps] * (0.5, 1.0, 0.05) + (UP, 0, 0)
    feed = 0.04 + 4e-3 * np.arange(1, steps + 1)[:, None] + 2e-3 * rng.uniform(size=n)
    return np.concatenate([turns, np.minimum(feed, 0.11)[:, :, None]], axis=2)


@pytest.fixture(scope="module")
def moved() -> tuple[Simulator, np.ndarray]:
    """Seventeen wires, so two blocks, after some steps into the fork, and the commands so far."""
    sim = Simulator(fed_fork(), num_envs=17)
    sim.set_goal(np.arange(17), Places(np.full(17, 0.05), np.arange(17) % 2 + 1))
    told = commands(17, 12)
    for command in told:
        sim.step(command)
    return sim, told


# --- what it reads ----------------------------------------------------------------------------------------------------


def test_laid_wires_are_at_rest_on_the_centreline():
    scenario = paper_free()
    sim = Simulator(scenario, num_envs=2)
    sim.reset(tip_arclength=[0.10, 0.30])
    assert sim.tip_position == pytest.approx(scenario.tract.position(np.array([0.10, 0.30])), abs=1e-12)
    assert sim.travelled == pytest.approx([0.10, 0.30], abs=1e-9)
    assert sim.remaining == pytest.approx([0.70, 0.50], abs=1e-9)
    segments = np.linalg.norm(np.diff(sim.positions, axis=1), axis=2)
    assert segments == pytest.approx(np.full(segments.shape, scenario.wire.segment_length), abs=1e-12)
    assert sim.wall_force == pytest.approx([0.0, 0.0], abs=1e-12)
    assert sim.tip_velocity.tolist() == [0.0, 0.0]


def test_the_free_end_of_a_wire_that_is_not_fed_touches_the_wall():
    """Its own weight, fifty-fold and more, presses a soft wire on the wall: the last node of it, too."""
    wire = soft_wire(length=0.1, segments=10)
    scenario = paper_free(tract=straight(0.4), wire=wire, gravity=(0.0, 0.0, -50.0))
    sim = Simulator(scenario)
    sim.reset(tip_arclength=0.2)
    for _ in range(20):
        sim.step(sim.magnet)
    depth = wire.radius - scenario.tree.tubes.distance(sim.positions[0])[0]
    assert depth[0] == pytest.approx(0.0, abs=5e-6)
    assert np.linalg.norm(sim.contact_forces[0, 0]) > 1e-4
    assert depth.max() < 30e-6


def test_the_cell_that_is_fed_never_turns_inside_out():
    """A first guess that would give it a negative length, whose energy falls without end, is cut short."""
    sim = Simulator(fed_fork())
    sim.step(sim.magnet)
    state, kept = sim.state(), sim.model.columns["base"]
    assert state.wire[0, kept.start + 1] == pytest.approx(5e-3, rel=1e-3)  # the cell's length
    state.wire[0, kept.start + 3] = -3.0  # m/s, its speed
    sim.load_state(state)
    sim.step(sim.magnet)
    assert sim.inserted_length == pytest.approx([0.04], abs=1e-6)
    assert sim.unconverged.tolist() == [0]


def test_wall_forces_balance_the_magnet_on_a_wire_at_rest():
    """A wire that hardly moves on the wall of a straight tube: contact and magnetic force add up to nothing."""
    scenario = paper_free(tract=straight(0.4), contact__friction=0.3)
    mount = scenario.rig.magnets[0]
    scenario = scenario.replace(
        rig=type(scenario.rig)((type(mount)(mount.magnet, (0.0, 0.0, 0.06), mount.dofs, ("fitted", 21)),))
    )
    sim = Simulator(scenario)
    sim.reset(tip_arclength=0.2, magnet=np.array([[np.pi / 2]]))
    for _ in range(40):
        sim.step(np.array([[np.pi / 2]]))
    contact = sim.contact_forces[0]
    creeps = scenario.contact.drag * scenario.wire.length * abs(sim.tip_velocity[0])  # N, of drag
    pull = np.linalg.norm(sim.tip_force[0])
    assert creeps < 0.2 * pull
    assert pull > 1e-3
    # A step ends when no node is out of balance by more than a tenth of E I over the wire's length squared.
    tolerance = 0.1 * scenario.wire.bending_rigidity / scenario.wire.length**2
    assert contact.sum(axis=0) == pytest.approx(-sim.tip_force[0], abs=2 * tolerance + creeps)
    # Friction is a part of what each node feels; the wall's normal forces alone are the reading `wall`.
    normal = np.linalg.norm(contact[:, 1:], axis=1).sum()  # the tube lies along x
    assert sim.wall_force[0] == pytest.approx(normal, rel=1e-3)
    # No node is deeper in the wall than the contact's compliance says.
    depth = scenario.wire.radius - scenario.tree.wall_distance(sim.positions[0])
    segment = scenario.wire.segment_length
    assert depth.max() <= np.linalg.norm(contact, axis=1).max() / (scenario.contact.stiffness * segment) * 2 + 1e-6


def test_what_a_feed_inserts_is_read_and_pushed_back(moved):
    sim, told = moved
    asked = np.minimum(told[-1, :, 3], 0.04 + 12 * 4e-3)  # at the drive's speed
    assert sim.inserted_length == pytest.approx(asked, abs=2e-4)
    assert sim.magnet[:, 3] == pytest.approx(asked, abs=2e-4)
    assert sim.base_force.shape == sim.base_torque.shape == (17, 3)
    assert (np.abs(sim.base_force).max(axis=1) > 1e-4).all()
    assert np.isnan(sim.positions[0, 0]).all()
    assert np.isfinite(sim.positions[0, -5:]).all()
    assert sim.unconverged.tolist() == [0] * 17


def test_a_wire_pressed_against_a_dead_end_stays_inside_and_its_base_says_so():
    """Ten seconds of full push: the drive gives way at its limit, nothing leaves, all forces stay finite."""
    scenario = fed_fork().replace(tract=straight(0.06, radius=3e-3))
    sim = Simulator(scenario)
    pushes = []
    for _ in range(60):
        sim.step(np.array([[UP, 0.0, 0.0, 0.12]]))
        pushes.append(np.linalg.norm(sim.base_force[0]))
    nodes = sim.positions[0][~np.isnan(sim.positions[0, :, 0])]
    assert scenario.tree.wall_distance(nodes[1:]).min() > -0.3e-3
    assert np.isfinite(sim.contact_forces).all()
    assert 0.05 < max(pushes) <= scenario.rig.feed.force * 1.01


def test_a_step_takes_few_evaluations(moved):
    """A search on the fork's wall, fed and turned at random: a bounded number of evaluations a step."""
    sim, _ = moved
    lanes = sim.model._views["lane"]
    spent, steps = (lanes[:, field // LANES].reshape(-1)[:17] for field in (at.EVALUATED, at.STEPPED))
    assert (steps >= sim.model._own.steps).all()
    assert 2.0 < spent.sum() / steps.sum() < 16.0


def test_a_wrong_branch_counts_the_way_back():
    sim = Simulator(fed_fork(), num_envs=2)
    for branch, beyond in ((1, 0.02), (2, 0.02)):
        sim.set_goal(np.arange(2), Places(np.full(2, 0.05), np.full(2, branch)))
        sim.reset(places=Places(np.full(2, beyond), np.array([1, 2])))
        right = branch - 1
        assert sim.remaining[right] == pytest.approx(0.03, abs=1.5e-3)
        assert sim.remaining[1 - right] == pytest.approx(0.05 + 0.02, abs=1.5e-3)
        assert sim.travelled[right] == pytest.approx(0.08, abs=1.5e-3)
    assert sim.route_length == pytest.approx([0.12, 0.12], abs=1e-6)
    points, ways, _ = sim.ahead(np.array([0.0, 0.01]))
    assert points[1, 0] == pytest.approx(sim.tip_position[1], abs=1e-3)
    assert np.linalg.norm(ways, axis=2) == pytest.approx(np.ones((2, 2)), abs=1e-4)


def test_a_base_that_turns_is_felt_at_the_tip():
    """A pre-bent tip turns with its base: the twist of a straight wire in a straight tube is passed on."""
    scenario = fed_fork(twist=True).replace(tract=straight(0.1, radius=4e-3))
    scenario = scenario.replace(wire__curl=20.0, contact__friction=0.0, tip__remanence=1e-6)
    sim = Simulator(scenario)
    sides = []
    for step in range(24):
        sim.step(np.array([[UP, 0.0, 0.0, 0.06, 0.0 if step < 8 else np.pi]]))
        sides.append(sim.tip_position[0, 1:])
    before, after = sides[7], sides[-1]
    assert np.linalg.norm(before) > 1e-3
    assert after == pytest.approx(-before, abs=0.15 * np.linalg.norm(before))
    assert sim.magnet[0, 4] == pytest.approx(np.pi)


# --- exactly the same -------------------------------------------------------------------------------------------------


def test_a_state_is_put_back_exactly(moved):
    sim, _ = moved
    state = sim.state()
    told = commands(17, 3, seed=5)
    told[:, :, 3] += 0.04
    first = []
    for command in told:
        sim.step(command)
        first.append((sim.readout[:, :17].copy(), sim.remaining_trace))
    after = sim.state()
    sim.load_state(pickle.loads(pickle.dumps(state)))
    for command, (rows, trace) in zip(told, first, strict=True):
        sim.step(command)
        assert np.array_equal(sim.readout[:, :17], rows)
        assert np.array_equal(sim.remaining_trace, trace)
    assert sim.state() == after
    sim.load_state(state)
    assert sim.state() == state
    assert state.part("positions").shape == (17, 3 * 25)
    with pytest.raises(ValueError, match="state must be of a wire model with 'arclengths', got one with positions"):
        _ = state.arclengths


def test_copies_and_pickles_go_on_alike(moved):
    sim, _ = moved
    command = commands(17, 1, seed=9)[0] + (0, 0, 0, 0.04)
    twins = [copy.deepcopy(sim), pickle.loads(pickle.dumps(sim))]
    for twin in twins:
        twin.step(command)
    assert np.array_equal(twins[0].readout[:, :17], twins[1].readout[:, :17])
    assert twins[0].state() == twins[1].state()


def test_a_lane_does_not_depend_on_its_neighbours():
    """Alone, or among sixteen others that do something else: the same bits."""
    told = commands(17, 10, seed=3)
    many = Simulator(fed_fork(), num_envs=17, threads=2)
    alone = [(lane, Simulator(fed_fork())) for lane in (0, 5, 16)]
    for command in told:
        many.step(command)
        for lane, one in alone:
            one.step(command[lane : lane + 1])
    for lane, one in alone:
        assert np.array_equal(one.readout[:, 0], many.readout[:, lane])
        assert np.array_equal(one.state().wire[0], many.state().wire[lane])


def test_lanes_of_tubes_and_of_trees_stand_in_one_batch():
    tree, tube = fed_fork(), fed_fork().replace(tract=straight(0.15, radius=4e-3))
    told = commands(3, 6, seed=4)
    many = Simulator([tree, tube, tree])
    for lane, scenario in enumerate((tree, tube)):
        one = Simulator(scenario)
        for command in told:
            one.step(command[lane : lane + 1])
            if lane == 0:
                many.step(command)
        assert np.array_equal(one.readout[:, 0], many.readout[:, lane])


def test_another_process_gives_the_same(moved):
    sim = Simulator(fed_fork(), num_envs=3)
    for command in commands(3, 4, seed=8):
        sim.step(command)
    code = (
        "import numpy as np; from tests.simulation.free.test_arrays import commands, fed_fork; "
        "from magwire_env import Simulator; sim = Simulator(fed_fork(), num_envs=3); "
        "[sim.step(c) for c in commands(3, 4, seed=8)]; print(sim.state().wire.tobytes().hex())"
    )
    told = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True).stdout.strip()
    assert told == sim.state().wire.tobytes().hex()


def test_a_rollout_equals_stepping(moved):
    sim, _ = moved
    state = sim.state()[:1]
    plans = commands(4, 3, seed=2).transpose(1, 0, 2)
    plans[:, :, 3] += 0.03
    tried = sim.rollout(state, plans)
    assert tried.remaining.shape == (4, 3)
    one = Simulator(fed_fork())
    one.set_goal(np.arange(1), sim.goals(np.array([0])))
    for k in (0, 3):
        one.load_state(state)
        for step in range(3):
            one.step(plans[k, step][None])
            assert one.remaining[0] == tried.remaining[k, step]
            assert one.wall_force[0] == tried.wall_force[k, step]
    assert sim.state()[:1] == state


# --- what is refused --------------------------------------------------------------------------------------------------


def test_what_the_locked_wire_does_not_know_is_refused_by_name():
    free = fed_fork()
    cases = [
        (free.replace(model="locked"), r"Scenario\.rig\.feed needs a base that can be fed and turned"),
        (
            Scenario.paper().replace(wire__bending=1e-5),
            r"Scenario\.wire\.bending needs properties that change along the wire; .*got 'locked'",
        ),
        (
            Scenario.paper().replace(lumen=free.lumen, wire__length=0.05),
            r"Scenario\.lumen needs a lumen that branches",
        ),
    ]
    for scenario, message in cases:
        with pytest.raises(ValueError, match=message):
            Simulator(scenario)
    with pytest.raises(ValueError, match=r"base_force needs a base that can be fed and turned"):
        _ = Simulator(Scenario.paper()).base_force


def test_a_batch_must_share_what_is_compiled_in():
    free = fed_fork()
    with pytest.raises(ValueError, match=r"scenario\[1\]\.contact\.per_segment must be that of the batch, 1, got 2"):
        Simulator([free, free.replace(contact__per_segment=2)])
    with pytest.raises(ValueError, match=r"scenario\[1\]\.wire\.twisting must be given .* in all scenarios"):
        Simulator([free, free.replace(wire__twisting=1e-6)])


def test_a_place_that_the_feed_cannot_reach_changes_nothing():
    sim = Simulator(fed_fork())
    before = sim.state()
    words = r"tip_arclength must lie where the feed can bring the tip, in \[0\.015, 0\.12\] m"
    with pytest.raises(ValueError, match=words):
        sim.reset(tip_arclength=0.005)
    assert sim.state() == before
