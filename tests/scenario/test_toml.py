"""Scenario files that a person writes: bases, named tracts, files beside them; all problems in one message."""

from __future__ import annotations

import math
import warnings
from pathlib import Path

import gymnasium as gym
import numpy as np
import pytest

import magwire_env
from magwire_env import Scenario, Simulator
from magwire_env.lumen import NAMED, aortic_arch, s_bend, straight
from magwire_env.quasistatic import best_placement
from magwire_env.scenario import ActuatedMagnet, Coil, Contact, Reading, Rig, Slide, plausible
from magwire_env.scenario.plausible import doubts
from tests.scenario.test_scenario import EVERYTHING

PAPER = Scenario.paper()
SHIPPED = Path(magwire_env.__file__).parent / "scenarios"


@pytest.fixture
def write(tmp_path: Path):
    """Writes a file and gives its path."""

    def put(text: str, name: str = "mine.toml") -> Path:
        path = tmp_path / name
        path.parent.mkdir(exist_ok=True)
        path.write_text(text, encoding="utf-8")
        return path

    return put


# --- what is left out comes from a base -------------------------------------------------------------------------------


def test_a_base_and_only_what_differs(write):
    mine = Scenario.load(write('base = "paper"\n\n[contact]\nfriction = 0.1\n\n[wire]\nlength = 0.12\n'))
    assert mine == PAPER.replace(name="mine", contact__friction=0.1, wire__length=0.12)
    named = Scenario.load(write('base = "paper"\nname = "called so"\ncoupling = "wrench"\n'))
    assert named == PAPER.replace(name="called so", coupling="wrench")


def test_a_base_may_be_a_file_beside_it_with_a_base_of_its_own(write):
    write('base = "paper"\n[contact]\nfriction = 0.02\n', "first.toml")
    write('base = "first.toml"\n[contact]\ndrag = 0.7\n', "second.toml")
    third = Scenario.load(write('base = "../second.toml"\n[timing]\ncontrol_period = 0.05\n', "deeper/third.toml"))
    expected = PAPER.replace(name="third", contact__friction=0.02, contact__drag=0.7, timing__control_period=0.05)
    assert third == expected


def test_one_magnet_s_entry_changes_the_keys_it_names(write):
    """The cloud of the base was taken for another distance, and is taken anew."""
    mine = Scenario.load(write('base = "paper"\n[[rig.magnets]]\nposition = [0.0, 0.0, 0.12]\n'))
    (mount,), (theirs,) = mine.rig.magnets, PAPER.rig.magnets
    assert mount.position == (0.0, 0.0, 0.12)
    assert (mount.magnet, mount.dofs) == (theirs.magnet, theirs.dofs)
    fresh = Rig((ActuatedMagnet(theirs.magnet, (0.0, 0.0, 0.12), theirs.dofs),))
    assert mine == PAPER.replace(name="mine", rig=fresh)
    assert mount.dipoles != theirs.dipoles


def test_another_kind_or_another_number_of_magnets_is_not_mixed_with_the_base_s(write):
    point = '[[rig.magnets]]\nmagnet = { kind = "point", strength = 100.0 }\nposition = [0.0, 0.0, 0.2]\n'
    assert Scenario.load(write(f'base = "paper"\n{point}')).rig.magnets[0].magnet.strength == 100.0
    second = point.replace("0.2]", "0.3]") + "dofs = []\n"
    whole = point + "dofs = []\n"
    assert len(Scenario.load(write(f'base = "paper"\n{whole}\n{second}')).rig.magnets) == 2


@pytest.mark.parametrize("name", [name for name in NAMED if name != "circle"])
def test_a_tract_by_its_name(name, write):
    high = "[[rig.magnets]]\nposition = [0.0, 0.0, 0.6]\n"
    mine = Scenario.load(write(f'base = "paper"\n{high}[tract]\nnamed = "{name}"\n'))
    assert mine.tract == NAMED[name]()
    wider = Scenario.load(write(f'base = "paper"\n{high}[tract]\nnamed = "{name}"\nradius = 0.006\nlength = 0.7\n'))
    assert wider.tract == NAMED[name](length=0.7, radius=0.006)


def test_a_tract_from_a_file_beside_it(write):
    rows = "\n".join(f"{20 * i},{10 * math.sin(i)},0,6" for i in range(20))
    write(f"x,y,z,r\n{rows}\n", "parts/line.csv")
    mine = Scenario.load(write('base = "paper"\n[tract]\nfile = "parts/line.csv"\nunit = "mm"\nradius = 0.005\n'))
    assert mine.tract.radius == 5e-3
    assert mine.tract.length > 0.38
    again = Scenario.load(write('base = "../mine.toml"\nname = "mine"\n', "parts/other.toml"))
    assert again.tract == mine.tract


def test_a_text_names_no_files(write):
    """What comes with a stranger's policy is a text."""
    write('base = "paper"\n')
    for text in ('base = "mine.toml"', 'base = "paper"\n[tract]\nfile = "/etc/hostname"'):
        with pytest.raises(ValueError, match="must not name a file in a text that is of no file itself"):
            Scenario.loads(text)
    assert Scenario.loads('base = "paper"\nname = "paper"') == PAPER


# --- what a file may not say ------------------------------------------------------------------------------------------


def test_everything_that_is_wrong_stands_in_one_message(write):
    path = write("name = 7\n[wire]\nlength = 0.1\n[tip]\ndiametr = 3\n[contact]\nfriction = -1\nmu = 2\n")
    with pytest.raises(ValueError, match="lacks the keys 'tract', 'rig'") as caught:
        Scenario.load(path)
    message = str(caught.value)
    for words in (
        'base = "paper" takes all that is left out from there',
        "mine.toml.name must be a string, got 7",
        "wire lacks the keys 'radius', 'axial_modulus', 'bending_modulus', 'density', 'segments'",
        "tip has an unknown key 'diametr'; allowed: diameter, height, remanence, mass",
        "tip lacks the keys 'diameter', 'height', 'remanence'",
        "contact has an unknown key 'mu'",
    ):
        assert words in message
    assert "\n" not in message


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ('base = "papper"', r"base: no file 'papper', and no shipped scenario .*; shipped: hard, paper"),
        ("base = 3", "base must be a shipped scenario's name or a file, got 3"),
        ('base = "none.toml"', r"there is no '.*none\.toml'"),
        ('base = "mine.toml"', "base must end somewhere: 8 files"),
        ('[tract]\nnamed = "s_bent"', r"tract: named must be one of 'paper_spiral', .*, got 's_bent'"),
        ('[tract]\nnamed = "s_bend"\nlenght = 1', "unknown key 'lenght'; allowed here: length, radius"),
        ('[tract]\nnamed = "s_bend"\nlength = -1.0', r"tract: length must be .*, got -1"),
        ('[tract]\nfile = "line.csv"\nunits = "mm"', r"unknown key 'units'; allowed here: unit, line, smooth, spacing"),
        ('[tract]\nfile = "line.csv"', r"tract.file must name a file.*there is no '.*line\.csv'"),
        ('[tract]\nfile = "line.csv"\nnamed = "s_bend"', "must have one of points, named and file, got named and file"),
        ("[tract]\nnamed = 3", "tract.named must be a string, got 3"),
        ('[tract]\nnamed = "aortic_arch"', r"rig\.magnets\[0\]\.position must keep"),
    ],
)
def test_bad_bases_and_tracts_end_in_a_sentence(write, text, words):
    path = write(text if text.startswith("base") else f'base = "paper"\n{text}\n')
    with pytest.raises(ValueError, match=words) as caught:
        Scenario.load(path)
    assert str(path.parent) in str(caught.value)
    assert "lacks the key" not in str(caught.value)


# --- saved files are for people ---------------------------------------------------------------------------------------

COILS = PAPER.replace(rig=Rig((), (Coil("z", uniform=2e-3), Coil("x", gradient=0.1, position=(0.0, 0.1, 0.0)))))
NOISY = PAPER.replace(sensing__force=Reading(noise=1e-3), sensing__delay=2, variation__friction=0.5)


@pytest.mark.parametrize("scenario", [PAPER, EVERYTHING, COILS, NOISY], ids=["paper", "everything", "coils", "noisy"])
def test_a_saved_file_is_short_and_says_the_same(scenario, tmp_path):
    path = tmp_path / "mine.toml"
    scenario.save(path)
    text = path.read_text(encoding="utf-8")
    assert Scenario.load(path) == Scenario.loads(text) == scenario
    lines = text.splitlines()
    assert len(lines) < len(scenario.tract.points) + 80  # it was 710 for the paper's
    assert max(map(len, lines)) <= 200
    assert "length = 0.1" in text
    assert "  # Pa" in text


def test_names_with_quotes_and_odd_signs_survive(tmp_path):
    for name in ('he said "x"', "back\\slash", "tab\tline\nbreak", "äöü 磁 \x7f\x01", ""):
        odd = PAPER.replace(name=name)
        assert Scenario.loads(odd.dumps()) == odd


def test_the_shipped_files_are_what_save_writes_or_begin_from_it():
    assert (SHIPPED / "paper.toml").read_text(encoding="utf-8") == PAPER.dumps()
    assert len((SHIPPED / "hard.toml").read_text(encoding="utf-8").splitlines()) < 15


# --- nonsense ---------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("build", "words"),
    [
        (
            lambda: PAPER.replace(wire__radius=8e-3),
            r"wire\.radius must be less than .* 7\.5 mm, got 8 mm",
        ),
        (lambda: PAPER.replace(tract=straight(0.5, radius=1e-3), wire__radius=2.5e-3), r"radius of 1 mm, got 2\.5 mm"),
        (
            lambda: PAPER.replace(tract=straight(0.5, 1.2e-3), wire__radius=1e-3, tip__diameter=3e-3),
            r"tip\.diam",
        ),
    ],
)
def test_a_wire_thicker_than_the_lumen_is_refused(build, words):
    with pytest.raises(ValueError, match=words):
        build()


@pytest.mark.parametrize(
    ("changes", "words"),
    [
        (
            {"contact__friction": 50},
            r"contact\.friction is 50, which is hardly meant: .* about 0\.02",
        ),
        ({"wire__density": 1.1}, r"wire\.density is 1\.1 kg/m³"),
        ({"tip__remanence": 1.9}, r"tip\.remanence is 1\.9 T"),
        ({"timing__control_period": 2.0}, r"timing\.control_period is 2 s"),
    ],
)
def test_what_is_hardly_meant_is_warned_about_once(changes, words):
    plausible._warn.cache_clear()
    with pytest.warns(UserWarning, match=words):
        once = PAPER.replace(**changes)
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        once.replace(name="again")
    assert not doubts(PAPER)


# --- a tract before its magnet ----------------------------------------------------------------------------------------


def test_a_tract_can_be_replaced_before_the_magnet_is_placed():
    """At its old place the magnet stands 45 mm from the arch: this can be written down, and then placed."""
    arch = PAPER.replace(tract=aortic_arch())
    with pytest.raises(ValueError, match="best_placement finds a place"):
        Simulator(arch)
    with pytest.raises(ValueError, match="best_placement finds a place"):
        gym.make("MagWire/Steer-v0", scenario=arch)
    position, found = best_placement(arch, keep_out=0.09)
    assert best_placement(arch)[1].weakest[1] > 0  # by default just clear of the tract
    assert found.solvable
    placed = arch.replace(rig=arch.rig.moved(position))
    (mount,) = placed.rig.magnets
    placed.check_placed()
    line = placed.tract.position(np.linspace(0.0, placed.tract.length, 2000))
    assert mount.magnet.reach + placed.tract.widest <= placed.rig.magnets[0].distance_to(line) + 1e-6
    Simulator(placed).reset()


def test_slides_and_contacts_are_still_checked_by_name():
    with pytest.raises(ValueError, match="low < high"):
        Slide("x", 0.1, -0.1)
    with pytest.raises(ValueError, match=r"Contact\.friction"):
        Contact(friction=-1)
    assert s_bend().length > 0
