"""The wire's spring constants, the two numbers the paper prints, and what it refuses."""

import dataclasses
import math

import pytest

from magwire_env.scenario import Scenario

PAPER = Scenario.paper().wire


def test_the_printed_constants_of_the_paper_come_out_in_newtons():
    """10.79 and 11.78 are E·A with 550 and 600 kPa: E·A/L of a metre of wire."""
    assert PAPER.bending_modulus * PAPER.area == pytest.approx(10.799, abs=5e-4)
    assert PAPER.axial_rigidity == pytest.approx(11.781, abs=5e-4)
    metre = dataclasses.replace(PAPER, length=1.0, segments=10)
    assert metre.axial_spring / metre.segments == pytest.approx(11.781, abs=5e-4)


def test_section_and_rigidities():
    assert PAPER.area == pytest.approx(1.9635e-5, abs=5e-10)
    assert PAPER.second_moment == pytest.approx(3.068e-11, abs=5e-15)
    assert PAPER.bending_rigidity == pytest.approx(1.687e-5, abs=5e-9)
    assert PAPER.mass == pytest.approx(1100 * math.pi * 2.5e-3**2 * 0.1, rel=1e-14)
    ratio = PAPER.bending_modulus * PAPER.area / (PAPER.bending_rigidity / 0.01)
    assert ratio == pytest.approx(6400, rel=1e-12)  # by which 10.79 N·m/rad would be too stiff at 10 mm segments


@pytest.mark.parametrize("segments", [2, 10, 16, 120])
def test_any_mesh_is_the_same_wire(segments):
    """N springs in series are E·A/L and N joints bend to E·I/L; a segment is L/N long."""
    wire = dataclasses.replace(PAPER, segments=segments)
    assert wire.segment_length * segments == pytest.approx(0.1, rel=1e-15)
    assert 1 / sum(1 / wire.axial_spring for _ in range(segments)) == pytest.approx(
        PAPER.axial_rigidity / 0.1, rel=1e-13
    )
    assert 1 / sum(1 / wire.bending_spring for _ in range(segments)) == pytest.approx(
        PAPER.bending_rigidity / 0.1, rel=1e-13
    )


@pytest.mark.parametrize(
    ("field", "value", "named"),
    [
        ("length", 0.0, r"Guidewire\.length must be greater than 0 \(in m\), got 0"),
        ("radius", -2.5e-3, r"Guidewire\.radius must be greater than 0 \(in m\), got -0\.0025"),
        ("axial_modulus", -600e3, r"Guidewire\.axial_modulus must be greater than 0 \(in Pa\), got -600000"),
        ("bending_modulus", -550e3, r"Guidewire\.bending_modulus must be greater than 0 \(in Pa\), got -550000"),
        ("bending_modulus", math.nan, r"Guidewire\.bending_modulus must be finite \(in Pa\), got nan"),
        ("density", math.inf, r"Guidewire\.density must be finite \(in kg/m³\), got inf"),
        ("density", "heavy", r"Guidewire\.density must be a number \(in kg/m³\), got 'heavy'"),
        ("segments", 1, r"Guidewire\.segments must be a whole number of at least 2, got 1"),
        ("segments", 10.5, r"Guidewire\.segments must be a whole number of at least 2, got 10\.5"),
        ("segments", True, r"Guidewire\.segments must be a whole number of at least 2, got True"),
        ("segments", math.nan, r"Guidewire\.segments must be a whole number of at least 2, got nan"),
        ("segments", "ten", r"Guidewire\.segments must be a whole number of at least 2, got 'ten'"),
    ],
)
def test_impossible_wires_are_refused_by_name(field, value, named):
    with pytest.raises(ValueError, match=named):
        dataclasses.replace(PAPER, **{field: value})


def test_a_wire_is_a_value():
    assert dataclasses.replace(PAPER) == PAPER
    assert hash(dataclasses.replace(PAPER)) == hash(PAPER)
    assert dataclasses.replace(PAPER, segments=16.0).segments == 16
    with pytest.raises(dataclasses.FrozenInstanceError):
        PAPER.length = 0.2  # type: ignore[misc]
