"""A scenario: the paper's numbers, TOML there and back, and what is refused by name."""

import dataclasses
import math
import pickle
import tomllib
from pathlib import Path

import gymnasium as gym
import numpy as np
import pytest
import tomli_w

import magwire_env
from magwire_env import Simulator
from magwire_env.lumen.named import circle, paper_spiral, straight
from magwire_env.physics import BlockMagnet, CylinderMagnet, PointDipole, Tract
from magwire_env.quasistatic import certificate
from magwire_env.scenario import ActuatedMagnet, Contact, Rig, Scenario, Slide, Timing, Turn

PAPER = Scenario.paper()
ID = "MagWire/Steer-v0"
SHIPPED = {path.stem: path for path in (Path(magwire_env.__file__).parent / "scenarios").glob("*.toml")}
CONSTRUCTORS = {"paper": Scenario.paper}

EVERYTHING = Scenario(
    name="every kind of part, äöü 磁",
    tract=dataclasses.replace(circle(0.5), radius=tuple(np.linspace(5e-3, 8e-3, 48))),
    wire=dataclasses.replace(PAPER.wire, length=0.12, segments=23, density=1234.5),
    tip=CylinderMagnet(1e-3, 2e-3, 1.1),
    rig=Rig(
        (
            ActuatedMagnet(BlockMagnet((0.03, 0.04, 0.05), 1.2), (0.0, 0.0, 0.1), (Turn("y"), Turn("z", 0.5, 1.0))),
            ActuatedMagnet(
                CylinderMagnet(0.03, 0.04, 1.3, mass=0.2),
                (0.01, 0.0, -0.12),
                (Slide("x", -0.1, 0.1), Slide("z", -0.02, 0.03, 0.01, 0.5), Turn("x")),
                ("grid", (4, 5, 6)),
            ),
            ActuatedMagnet(PointDipole(12.0), (0.0, 0.3, 0.0), (), ("gauss", 1)),
        )
    ),
    contact=Contact(0.1, 1e-3, 0.2, 8e-3, True, 0.05),
    coupling="wrench",
    gravity=(0.0, 1.0, -9.81),
    timing=Timing(0.05, 7),
)


def tree_of(scenario: Scenario, path: Path) -> dict:
    scenario.save(path)
    return tomllib.loads(path.read_text(encoding="utf-8"))


def put(tree: dict, where: tuple, value) -> None:
    """Set tree[where[0]][where[1]]…; a value of `...` deletes instead."""
    for key in where[:-1]:
        tree = tree[key]
    if value is ...:
        del tree[where[-1]]
    else:
        tree[where[-1]] = value


# --- the paper --------------------------------------------------------------------------------------------------------


def test_every_number_of_the_paper():
    """Section IV, and Section III-C for the rig; what it leaves open is PHYSICS.md's."""
    assert PAPER.tract.length == pytest.approx(8e-1, rel=1e-9)
    assert 2 * PAPER.tract.radius == 1.5e-2
    assert (PAPER.tip.diameter, PAPER.tip.height, PAPER.tip.mass, PAPER.tip.remanence) == (2e-3, 3e-3, 7.2e-5, 1.37)
    assert PAPER.wire.radius == 2.5e-3
    assert (PAPER.wire.bending_modulus, PAPER.wire.axial_modulus) == (550e3, 600e3)
    (mount,) = PAPER.rig.magnets
    assert mount.magnet == BlockMagnet(size=(50.8e-3,) * 3, remanence=1.3)
    assert [(type(d), d.axis) for d in PAPER.rig.dofs] == [(Turn, "y")]
    assert mount.distance_to(PAPER.tract.position(np.linspace(0, 0.8, 8001))) == pytest.approx(0.07, abs=1e-7)
    assert PAPER.coupling == "force"
    assert PAPER.gravity == (0.0, 0.0, 0.0)
    # PHYSICS.md: control at 10 Hz, the servo at most π rad/s, wire 0.1 m of 1100 kg/m³, friction 0.05, drag 0.5.
    assert (PAPER.timing.control_period, mount.dofs[0].speed) == (0.1, math.pi)
    assert (PAPER.wire.length, PAPER.wire.density) == (0.1, 1100.0)
    assert (PAPER.contact.friction, PAPER.contact.drag, PAPER.contact.stick_speed) == (0.05, 0.5, 1e-4)
    assert (PAPER.contact.lever, PAPER.contact.lever_friction) == (10e-3, False)


def test_the_2000_dipoles_of_the_paper_can_be_chosen():
    grid = PAPER.replace(rig=Rig((dataclasses.replace(PAPER.rig.magnets[0], dipoles=("grid", [10, 10, 20])),)))
    mount = grid.rig.magnets[0]
    assert mount.dipoles == ("grid", (10, 10, 20))
    assert len(mount.magnet.dipoles(*mount.dipoles)) == 2000


def test_the_distance_of_the_magnet_is_a_parameter():
    s = np.linspace(0.0, 0.8, 8001)
    for distance, to, expected in ((0.08, "centre", 0.08), (0.07, "face", 0.0954), (0.2, "centre", 0.2)):
        mount = Scenario.paper(distance, to).rig.magnets[0]
        assert mount.distance_to(PAPER.tract.position(s)) == pytest.approx(expected, abs=1e-6)
    with pytest.raises(ValueError, match=r"measured_to must be one of 'centre', 'face', got 'edge'"):
        Scenario.paper(measured_to="edge")
    with pytest.raises(ValueError, match=r"magnet_distance must be greater than 0 \(in m\)"):
        Scenario.paper(-0.07)


def test_the_scenario_records_the_cloud_it_took():
    """The cheapest within 0.5 % at its own smallest distance, slides included; a cloud that is given stays."""
    magnet = PAPER.rig.magnets[0].magnet
    line = straight(0.5)

    def taken(height: float, *dofs, dipoles=()):
        mount = ActuatedMagnet(magnet, (0.0, 0.0, height), dofs, dipoles)
        return PAPER.replace(tract=line, rig=Rig((mount,))).rig.magnets[0].dipoles

    assert len(magnet.dipoles(*taken(0.2))) == 1
    assert taken(0.06) == ("gauss", 5)
    assert taken(0.2, Slide("z", -0.14, 0.0)) == ("gauss", 5)
    assert taken(0.2, Slide("x", -0.14, 0.0)) == taken(0.2)
    assert taken(0.06, dipoles=("gauss", 2)) == ("gauss", 2)


# --- TOML -------------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    "scenario", [PAPER, EVERYTHING, PAPER.replace(tract=straight(0.3))], ids=["paper", "all", "line"]
)
def test_saved_and_loaded_is_equal(scenario, tmp_path):
    path = tmp_path / "mine.toml"
    scenario.save(path)
    again = Scenario.load(path)
    assert again == scenario
    assert hash(again) == hash(scenario)
    assert again.tract.length == scenario.tract.length
    again.save(tmp_path / "again.toml")
    assert (tmp_path / "again.toml").read_bytes() == path.read_bytes()
    assert pickle.loads(pickle.dumps(scenario)) == scenario


def test_what_is_left_out_takes_its_default(tmp_path):
    tree = tree_of(PAPER, tmp_path / "short.toml")
    kept = {key: tree[key] for key in ("name", "tract", "wire", "tip", "rig")}
    del kept["tract"]["radius"], kept["rig"]["magnets"][0]["dipoles"], kept["tip"]["mass"]
    (tmp_path / "short.toml").write_text(tomli_w.dumps(kept), encoding="utf-8")
    short = Scenario.load(tmp_path / "short.toml")
    assert short == PAPER.replace(tip__mass=None)
    assert short.tip.mass == pytest.approx(7500 * math.pi * 3e-9)


def test_the_shipped_scenarios_are_what_their_constructors_give():
    assert set(CONSTRUCTORS) <= set(SHIPPED)
    for name in SHIPPED:
        assert Scenario.load(name).name == name
        if name in CONSTRUCTORS:
            assert Scenario.load(name) == CONSTRUCTORS[name]()


def test_the_hard_scenario_is_the_last_that_its_certificate_lets_through():
    """A long wire whose couple rubs: at the next friction, in steps of 0.005, it no longer passes within 30 s."""
    hard = Scenario.load("hard")
    assert hard == PAPER.replace(
        name="hard", wire__length=0.2, wire__segments=32, contact__friction=0.03, contact__lever_friction=True
    )
    assert certificate(hard, time_limit=30.0).solvable
    assert not certificate(hard.replace(contact__friction=0.035), time_limit=30.0).solvable


def test_the_unmeasured_scenario_is_the_paper_s_in_wide_ranges():
    share = 0.2 * PAPER.wire.bending_rigidity
    stiffness = (PAPER.wire.bending_rigidity - share, PAPER.wire.bending_rigidity + share)
    wide = PAPER.randomised(friction=(0.0, 0.2), bending_rigidity=stiffness, remanence=(0.9, 1.1), placement=0.01)
    found = Scenario.load("unmeasured")
    assert dataclasses.astuple(found.variation) == pytest.approx(dataclasses.astuple(wide.variation))
    expected = PAPER.replace(name="unmeasured", contact__friction=0.1, variation=found.variation)
    assert found.replace(rig=PAPER.rig) == expected  # its magnet may come nearer, so it has more dipoles
    assert found.rig.magnets[0].position == PAPER.rig.magnets[0].position
    assert wide.wire.bending_modulus == pytest.approx(found.wire.bending_modulus)


def test_a_file_that_is_not_there_or_not_toml(tmp_path):
    with pytest.raises(FileNotFoundError, match=r"no shipped scenario of that name; shipped: .*paper"):
        Scenario.load("papper")
    with pytest.raises(FileNotFoundError):
        Scenario.load(tmp_path / "none.toml")
    (tmp_path / "torn.toml").write_text("name = 'x'\n[wire", encoding="utf-8")
    with pytest.raises(ValueError, match=r"torn\.toml is not valid TOML: Expected"):
        Scenario.load(tmp_path / "torn.toml")


MAGNET = ("rig", "magnets", 0)
WRONG = [  # where in the file, what stands there (… for nothing), what the error says
    (("wier",), {}, r"has an unknown key 'wier'; allowed: name, tract"),
    (("wire", "lenght"), 0.1, r"\.wire has an unknown key 'lenght'; allowed: length, radius"),
    (("contact", "mu"), 0.1, r"\.contact has an unknown key 'mu'"),
    ((*MAGNET, "speed"), 1.0, r"\.rig\.magnets\[0\] has an unknown key 'speed'"),
    ((*MAGNET, "dofs", 0, "low"), 0.0, r"\.rig\.magnets\[0\]\.dofs\[0\] has an unknown key 'low'"),
    (("wire", "length"), ..., r"\.wire lacks the key 'length'"),
    (("tract",), ..., r"lacks the key 'tract'"),
    ((*MAGNET, "magnet", "remanence"), ..., r"\.rig\.magnets\[0\]\.magnet lacks the key 'remanence'"),
    ((*MAGNET, "magnet", "kind"), ..., r"\.magnet\.kind must be one of 'block', 'cylinder', 'point', got None"),
    ((*MAGNET, "magnet", "kind"), "ring", r"\.magnet\.kind must be one of .*, got 'ring'"),
    ((*MAGNET, "dofs", 0, "kind"), "roll", r"\.dofs\[0\]\.kind must be one of 'turn', 'slide', got 'roll'"),
    ((*MAGNET, "dofs", 0, "axis"), "w", r"\.dofs\[0\]: Turn\.axis must be one of 'x', 'y', 'z', got 'w'"),
    ((*MAGNET, "dofs"), 3, r"\.magnets\[0\]\.dofs must be a list, got 3"),
    ((*MAGNET, "dipoles"), ["simpson", 4], r"ActuatedMagnet\.dipoles must be one of .*, got 'simpson'"),
    ((*MAGNET, "dipoles"), ["gauss"], r"ActuatedMagnet\.dipoles must be \(rule, n\) or empty"),
    ((*MAGNET, "dipoles"), ["gauss", 0], r"ActuatedMagnet\.dipoles: n must be a whole number of at least 1, got 0"),
    ((*MAGNET, "position"), [0.0, 0.1], r"ActuatedMagnet\.position must be 3 finite numbers \(in m\)"),
    (("rig", "magnets"), [], r"Rig\.magnets .* must hold at least one magnet"),
    (("rig",), "big", r"\.rig must be a table, got 'big'"),
    (("wire", "axial_modulus"), -600e3, r"\.wire: Guidewire\.axial_modulus must be greater than 0 \(in Pa\)"),
    (("wire", "bending_modulus"), -1.0, r"\.wire: Guidewire\.bending_modulus must be greater than 0 \(in Pa\)"),
    (("wire", "segments"), 16.5, r"\.wire: Guidewire\.segments must be a whole number of at least 2, got 16\.5"),
    (("wire", "radius"), "2.5 mm", r"\.wire: Guidewire\.radius must be a number \(in m\), got '2\.5 mm'"),
    (("wire", "radius"), "0.0025", r"\.wire: Guidewire\.radius must be a number \(in m\), got '0\.0025'"),
    (("wire", "density"), math.inf, r"\.wire: Guidewire\.density must be finite"),
    (("tip", "height"), 0.0, r"\.tip: CylinderMagnet\.height must be greater than 0 \(in m\), got 0"),
    (("tip", "mass"), -1e-5, r"\.tip: CylinderMagnet\.mass must be at least 0 \(in kg\)"),
    (("contact", "friction"), -0.1, r"\.contact: Contact\.friction must be at least 0, got -0\.1"),
    (("contact", "friction"), True, r"\.contact: Contact\.friction must be a number, got True"),
    (("contact", "stick_speed"), 0.0, r"\.contact: Contact\.stick_speed must be greater than 0 \(in m/s\)"),
    (("contact", "drag"), -0.5, r"\.contact: Contact\.drag must be at least 0 \(in N·s/m²\)"),
    (("contact", "lever"), 0, r"\.contact: Contact\.lever must be greater than 0 \(in m\)"),
    (("contact", "lever_friction"), 1, r"\.contact\.lever_friction must be true or false, got 1"),
    (("timing", "substeps"), 0, r"\.timing: Timing\.substeps must be a whole number of at least 1, got 0"),
    (("timing", "control_period"), -0.1, r"\.timing: Timing\.control_period must be greater than 0 \(in s\)"),
    (("coupling",), "torque", r"Scenario\.coupling must be one of 'force', 'wrench', got 'torque'"),
    (("name",), 7, r"\.name must be a string, got 7"),
    (("gravity",), [0.0, 0.0], r"Scenario\.gravity must be 3 finite numbers \(in m/s²\)"),
    (("tract", "points", 3), [0.0, 0.0], r"\.tract: "),
    (("tract", "points", 3), "here", r"\.tract\.points\[3\] must be a list, got 'here'"),
    (("tract", "points", 3), [math.nan, 0.0, 0.0], r"\.tract: Tract\.points\[3\] must be finite"),
    (("tract", "radius"), -7.5e-3, r"\.tract: Tract\.radius must be greater than 0 \(in m\)"),
    (("tract", "closed"), "no", r"\.tract\.closed must be true or false, got 'no'"),
]


@pytest.mark.parametrize(("where", "value", "named"), WRONG, ids=[".".join(map(str, w[0])) + f"={w[1]}" for w in WRONG])
def test_a_wrong_entry_is_refused_by_name(where, value, named, tmp_path):
    """With the file's name and the way to the entry; loading again after mending it works."""
    path = tmp_path / "wrong.toml"
    tree = tree_of(PAPER, path)
    put(tree, where, value)
    path.write_text(tomli_w.dumps(tree), encoding="utf-8")
    with pytest.raises(ValueError, match=named) as caught:
        Scenario.load(path)
    assert str(caught.value).startswith(str(path))
    assert Scenario.load("paper") == PAPER


# --- parts that do not fit together -----------------------------------------------------------------------------------


def test_a_tract_shorter_than_the_wire():
    with pytest.raises(ValueError, match=r"Scenario\.wire\.length must be less than the tract's 0\.08 m, got 0\.1 m"):
        PAPER.replace(tract=paper_spiral(length=0.08))
    with pytest.raises(ValueError, match=r"Scenario\.wire\.length must be less than the tract's 0\.8 m, got 0\.8 m"):
        PAPER.replace(wire__length=PAPER.tract.length)


@pytest.mark.parametrize(
    "mount",
    [
        ActuatedMagnet(PAPER.rig.magnets[0].magnet, (0.0, 0.0, 0.0514)),
        ActuatedMagnet(PAPER.rig.magnets[0].magnet, (0.1, 0.0, 0.0)),
        ActuatedMagnet(PAPER.rig.magnets[0].magnet, (0.0, 0.0, 0.2), (Slide("z", -0.15, 0.0),)),
        ActuatedMagnet(PAPER.rig.magnets[0].magnet, (0.0, 0.3, 0.0), (Slide("x", -0.1, 0.1), Slide("y", -0.26, 0.0))),
        ActuatedMagnet(PointDipole(1.0), (0.0, 0.0, 0.0074)),
    ],
)
def test_a_magnet_that_reaches_into_the_tract(mount):
    """It can be written down, and neither simulated nor judged."""
    both = PAPER.replace(tract=straight(0.5), rig=Rig((ActuatedMagnet(PointDipole(1.0), (0.0, 0.0, 0.1)), mount)))
    for use in (
        both.check_placed,
        lambda: Simulator(both),
        lambda: certificate(both),
        lambda: gym.make(ID, scenario=both),
    ):
        with pytest.raises(
            ValueError, match=r"Scenario\.rig\.magnets\[1\]\.position must keep .* or the turning magnet enters"
        ):
            use()


def test_a_magnet_just_clear_of_the_tract():
    """A corner's distance plus the lumen: 51.5 mm from the centreline."""
    magnet = PAPER.rig.magnets[0].magnet
    assert magnet.reach + 7.5e-3 == pytest.approx(0.0515, abs=1e-5)
    rig = Rig((ActuatedMagnet(magnet, (0.0, 0.0, 0.0515), dipoles=("gauss", 8)),))
    assert PAPER.replace(tract=straight(0.5), rig=rig).rig.magnets[0].position == (0.0, 0.0, 0.0515)


def test_force_on_a_closed_tract():
    rig = Rig((ActuatedMagnet(PointDipole(100.0), (0.0, 0.0, 0.1)),))
    with pytest.raises(ValueError, match=r"Scenario\.coupling must be 'wrench' on a closed tract.*got 'force'"):
        PAPER.replace(tract=circle(0.4), rig=rig)
    assert PAPER.replace(tract=circle(0.4), rig=rig, coupling="wrench").tract.closed


@pytest.mark.parametrize(
    ("build", "named"),
    [
        (lambda: Slide("x", 0.1, -0.1), r"Slide\.home must lie in \[low, high\] with low < high"),
        (lambda: Slide("x", -0.1, 0.1, home=0.2), r"Slide\.home must lie in \[low, high\]"),
        (lambda: Slide("x", 0.0, 0.0), r"low < high"),
        (lambda: Slide("q", -0.1, 0.1), r"Slide\.axis must be one of"),
        (lambda: Turn("y", speed=0.0), r"Turn\.speed must be greater than 0 \(in rad/s\)"),
        (lambda: Turn("y", home=math.nan), r"Turn\.home must be finite \(in rad\)"),
        (lambda: ActuatedMagnet(PointDipole(1.0), (0, 0, 1), (Turn(), Turn(), Turn())), r"at most two turns"),
        (
            lambda: ActuatedMagnet(PointDipole(1.0), (0, 0, 1), (Slide("x", 0, 1), Slide("x", 0, 2))),
            r"one slide an axis",
        ),
        (lambda: Rig(()), r"Rig\.magnets .* must hold at least one magnet.*, got none"),
    ],
)
def test_impossible_parts_are_refused(build, named):
    with pytest.raises(ValueError, match=named):
        build()


# --- being a value ----------------------------------------------------------------------------------------------------


def test_replace_changes_a_copy():
    before = hash(PAPER)
    changed = PAPER.replace(contact__friction=0.1, wire__segments=8, name="other", gravity=[0, 0, -9.81])
    assert (changed.contact.friction, changed.wire.segments, changed.name) == (0.1, 8, "other")
    assert changed.gravity == (0.0, 0.0, -9.81)
    assert changed.tract is PAPER.tract
    assert changed.contact.drag == PAPER.contact.drag
    assert Scenario.paper() == PAPER
    assert hash(PAPER) == before
    assert changed != PAPER
    assert len({PAPER, changed, Scenario.paper()}) == 2
    both = PAPER.replace(contact=Contact(friction=0.2), contact__drag=1.0).contact
    assert (both.friction, both.drag) == (0.2, 1.0)


@pytest.mark.parametrize("field", ["frictoin", "contact__mu", "name__first", "gravity__x", "timing__substep"])
def test_replace_refuses_unknown_fields(field):
    with pytest.raises(ValueError, match=f"Scenario.replace got an unknown field.*{field}"):
        PAPER.replace(**{field: 1})


def test_nothing_can_be_changed_in_place():
    with pytest.raises(dataclasses.FrozenInstanceError):
        PAPER.coupling = "wrench"  # type: ignore[misc]
    with pytest.raises(dataclasses.FrozenInstanceError):
        PAPER.contact.friction = 1.0  # type: ignore[misc]
    points = np.array(straight().points)
    tract = Tract.from_points(points)
    points[0] = 9.0
    assert tract == straight()


def test_ranges_become_a_scenario_for_domain_randomisation():
    low, high = 0.8 * PAPER.wire.bending_rigidity, 1.2 * PAPER.wire.bending_rigidity
    drawn = PAPER.randomised(friction=(0.02, 0.06), bending_rigidity=(low, high), remanence=(0.9, 1.1), placement=1e-3)
    assert drawn.contact.friction == pytest.approx(0.04)
    assert drawn.variation.friction == pytest.approx(0.5)
    assert drawn.variation.stiffness == pytest.approx(0.2)
    assert drawn.variation.remanence == pytest.approx(0.1)
    assert drawn.variation.placement == 1e-3
    assert drawn.wire.bending_rigidity == pytest.approx(PAPER.wire.bending_rigidity)
    with pytest.raises(ValueError, match="friction must be"):
        PAPER.randomised(friction=(0.06, 0.02))
