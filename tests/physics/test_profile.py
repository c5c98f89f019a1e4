"""Properties along a wire."""

import numpy as np
import pytest

from magwire_env.physics import CylinderMagnet, Guidewire, Profile
from magwire_env.physics.guidewire import CLINICAL


def test_a_profile_is_linear_between_knots_and_jumps_at_doubled_ones():
    profile = Profile((0.0, 0.1, 0.1, 0.3), (1.0, 3.0, 5.0, 5.0))
    assert profile.value([-1.0, 0.05, 0.0999999, 0.1, 0.2, 9.0]).tolist() == pytest.approx([1, 2, 3, 5, 5, 5], abs=1e-4)
    assert profile.mean(np.array([0.0, 0.05]), np.array([0.1, 0.15])) == pytest.approx([2.0, (0.125 + 0.25) / 0.1])
    assert Profile.constant(7.0).value(0.3) == 7.0


def test_springs_in_series_add_their_compliances():
    profile = Profile.steps((0.1, 4.0), (0.1, 1.0))
    assert profile.mean(np.array([0.05]), np.array([0.15]), inverse=True)[0] == pytest.approx(2 / (1 / 4 + 1 / 1))
    ramp = Profile((0.0, 1.0), (1.0, np.e))
    expected = (np.e - 1) / np.log(np.e)  # 1 over the mean of 1/(1 + (e − 1) s)
    assert ramp.mean(np.zeros(1), np.ones(1), inverse=True)[0] == pytest.approx(expected, rel=1e-9)


@pytest.mark.parametrize(
    ("make", "message"),
    [
        (lambda: Profile((0.0, 0.1), (1.0,)), r"Profile\.values must be one for each .*, got 1 for 2"),
        (lambda: Profile((0.1, 0.0), (1.0, 2.0)), r"Profile\.at must ascend"),
        (lambda: Profile((0.0, 0.0, 0.0), (1, 2, 3)), r"no place more than twice"),
        (lambda: Profile((0.0,), (float("nan"),)), r"Profile\.values\[0\] must be finite"),
        (lambda: Profile("ab", (1.0, 2.0)), r"Profile\.at must be numbers, got 'ab'"),
        (lambda: Profile((), ()), r"at least one knot, got 0 for 0"),
    ],
)
def test_bad_profiles_are_refused_by_name(make, message):
    with pytest.raises(ValueError, match=message):
        make()


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"bending": -1.0}, r"Guidewire\.bending must lie in \[1e-15, 1e\+06\] everywhere \(in N·m²\), got -1"),
        ({"axial": "stiff"}, r"Guidewire\.axial must be a number \(in N\), got 'stiff'"),
        ({"bending": Profile((0.0, 0.2), (1.0, 1.0))}, r"Guidewire\.bending must have its knots in \[0, 0\.1\] m"),
        ({"curl": 10.0}, r"Guidewire\.twisting must be given \(in N·m²\) for a wire with natural curvature"),
        ({"outer_radius": 0.0}, r"Guidewire\.outer_radius must lie in \[1e-05, 0\.05\] everywhere"),
    ],
)
def test_impossible_wires_are_refused_by_name(change, message):
    with pytest.raises(ValueError, match=message):
        Guidewire(0.1, 1e-3, 1e6, 1e6, 1000.0, 10, **change)


def test_presets_have_their_sources_numbers():
    core = Guidewire.nitinol()
    assert core.bending_rigidity == pytest.approx(60e9 * np.pi * (0.18e-3) ** 4 / 4)
    assert core.twisting.value(0.1) == pytest.approx(core.bending_rigidity / 1.3)
    for name, modulus in CLINICAL.items():
        assert Guidewire.clinical(name).bending_modulus == modulus
    soft = Guidewire.clinical("amplatz super stiff", floppy=0.05)
    assert soft.bending.value([0.5, 0.58]) == pytest.approx([60.3e9 * np.pi * (0.4445e-3) ** 4 / 4, 2e-5])
    robot = Guidewire.two_rings()
    area = np.pi * (0.665e-3**2 - 0.4e-3**2)
    assert robot.axial.value([0.0, 0.1]) == pytest.approx([170e6 * area, 21e6 * area])
    assert robot.magnetisation.mean(np.zeros(1), np.full(1, 0.1))[0] * 0.1 == pytest.approx(3.73e-3)
    assert CylinderMagnet(1.0145e-3, 4e-3, 1.45).moment == pytest.approx(3.73e-3, rel=1e-3)
    assert robot.mass == pytest.approx(1100 * area * 0.1)
    with pytest.raises(ValueError, match=r"name must be one of 'amplatz'.*, got 'glidewire'"):
        Guidewire.clinical("glidewire")
