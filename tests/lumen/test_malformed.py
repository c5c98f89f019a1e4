"""Malformed centreline files: each refused, with words that a person can act on."""

from __future__ import annotations

import struct
import tracemalloc
import zlib

import numpy as np
import pytest

from magwire_env.physics import Tract
from tests.support.centreline_writers import MISR, Vtp, csv_text, curve, markups, vessel, write

XYZ, RADIUS = vessel(120)
GAP = np.delete(XYZ, np.s_[40:80], axis=0)
KINK = np.vstack([XYZ[:60], XYZ[59] + np.linspace(1, 80, 60)[:, None] * [0.9, -0.4, 0.2]])
EIGHT = 60 * np.stack([np.sin(a := np.linspace(0.3, 6.4, 300)), np.sin(2 * a) / 2, 0 * a], axis=1)
TEXT = csv_text(XYZ)
GOOD_VTP = Vtp().file([XYZ], [RADIUS])
ASCII_VTP = Vtp("ascii", compressed=False).file([XYZ], [RADIUS])

DATA = zlib.compress(b"\0" * 200_000_000)
BOMB = (
    b'<VTKFile type="PolyData" byte_order="LittleEndian" compressor="vtkZLibDataCompressor"><PolyData>'
    b'<Piece NumberOfPoints="1"><Points><DataArray type="Float64" NumberOfComponents="3" format="appended" offset="0"/>'
    b'</Points></Piece></PolyData><AppendedData encoding="raw">_'
    + struct.pack("<4I", 1, 24, 0, len(DATA)) + DATA + b"</AppendedData></VTKFile>"
)  # fmt: skip


def measured(values):
    return {"measurements": [{"name": "Radius", "enabled": True, "units": "mm", "controlPointValues": values}]}


# What the file holds, the words (a regular expression) of its refusal, and the arguments if not the usual ones.
CSV = {
    "empty": ("", "header line naming x, y and z, such as 'x .mm.,y .mm.,z .mm.', got ''"),
    "no header": ("1,2,3\n4,5,6\n", "must start with a header line naming x, y and z.*got '1,2,3'"),
    "no z": ("x [mm],y [mm]\n1,2\n", "header line naming x, y and z.*got 'x .mm.,y .mm.'"),
    "x twice": ("x [mm],x [mm],y [mm],z [mm]\n1,1,2,3\n", "line 1 must name x once"),
    "no unit": (csv_text(XYZ, header="x,y,z"), r"no unit for x; write it in the header.*'x \[mm\]', or pass unit="),
    "no unit for the radius": (
        csv_text(XYZ, RADIUS, "x [mm],y [mm],z [mm],radius"),
        r"no unit for radius; .*'radius \[mm\]'",
    ),
    "unknown unit": (TEXT.replace("mm", "inch"), "declares x in 'inch'; the unit must be one of 'm', 'cm', 'mm'"),
    "units at odds": (TEXT.replace("y [mm]", "y [m]"), "must declare x, y and z in one unit"),
    "unit twice over": (TEXT, "declares x in 'mm', but unit='m' was passed; leave unit out", {"unit": "m"}),
    "no such unit": (
        csv_text(XYZ, header="x,y,z"),
        "unit must be one of 'm', 'cm', 'mm', 'um', got 'inch'",
        {"unit": "inch"},
    ),
    "a word": (TEXT.replace("\n", "\nfoo,1,2\n", 1), "line 2 must hold numbers for x, y, z, got 'foo,1,2'"),
    "short row": (TEXT + "1,2\n", "line 122 must hold numbers for x, y, z, got '1,2'"),
    "not a number": (TEXT + "1,nan,2\n", r"points\[120\] must be finite"),
    "no points": ("x_mm,y_mm,z_mm\n", "at least 2 different points, got 0"),
    "one point": ("x_mm,y_mm,z_mm\n1,2,3\n1,2,3\n", "at least 2 different points, got 1"),
    "no lumen": (csv_text(XYZ, 0 * RADIUS), r"radius\[0\] must be finite and greater than 0"),
    "not text": (b"x [mm],y [mm],z [mm]\n\xff\xfe1,2,3", "must be UTF-8 text, but byte 21 is not"),
    "gap": (csv_text(GAP), r"a gap of 0.08\d+ m after point 39 .from 0. at .*add the missing points"),
    "kink": (csv_text(KINK), r"a kink of \d+° at .* m, 0.1\d+ m along; at most 75°"),
    "crossing": (csv_text(EIGHT), "comes back into its own lumen: .* m and .* m along.*cut the loop out"),
    "there and back": (csv_text(np.vstack([XYZ, XYZ[-2::-1]])), r"a kink of 1[78]\d° at"),
    "smooth two points": ("x_mm,y_mm,z_mm\n1,2,3\n9,2,3\n", "smooth needs at least 4 points", {"smooth": 1e-3}),
    "negative smooth": (TEXT, r"smooth must be at least 0 \(in m\)", {"smooth": -1e-3}),
    "a line of 1000 km": (
        "x [m],y [m],z [m]\n0,0,0\n1e6,0,0\n",
        "a line of at most 100 m, got 1e.06 m: is its unit right",
    ),
    "a hair's lumen": (
        "x [m],y [m],z [m],radius [m]\n0,0,0,1e-12\n1,0,0,1e-12\n",
        "a lumen of at least 1e-05 m radius for its 1 m, got 1e-12 m",
    ),
    "a field without end": (TEXT.replace("\n", f"\n{'1' * 200_000},0,0\n", 1), "field larger than field limit"),
    "a number of 400 digits": (TEXT.replace("\n", f"\n{'9' * 400},0,0\n", 1), r"points\[0\] must be finite"),
    "no spacing": (TEXT, r"spacing must be greater than 0 \(in m\)", {"spacing": 0.0}),
}

VTK = {
    "vtp without unit": (GOOD_VTP, r"declares no unit for its points .no .vtp file does.; pass unit='mm'", {}),
    "cut off": (GOOD_VTP[:-300], "not well-formed XML .cut off"),
    "not PolyData": (GOOD_VTP.replace(b"PolyData", b"UnstructuredGrid"), "type 'PolyData', got type 'Unst"),
    "not VTK": ("<svg></svg>", "must be a VTKFile of type 'PolyData', got a <svg> document"),
    "other compressor": (GOOD_VTP.replace(b"vtkZLib", b"vtkLZ4"), "'vtkLZ4DataCompressor'; save it again with"),
    "a surface": (GOOD_VTP.replace(b"Lines>", b"Polys>"), "must hold lines, got none .*vmtkcenterlines"),
    "several lines": (
        Vtp().file([XYZ, XYZ[:50]]),
        "holds 2 lines; choose one with line=0 to 1 .line 0: 120 points, 0.25",
    ),
    "no such line": (GOOD_VTP, "line must lie in 0 to 0 .*got 3", {"unit": "mm", "line": 3}),
    "no points array": (GOOD_VTP.replace(b"Points>", b"Pts>"), "lacks its data array Points"),
    "too few radii": (
        Vtp().file([XYZ], values=RADIUS[:7]),
        f"{MISR} must hold one number for each of the 120 points, got 7",
    ),
    "stray connectivity": (
        Vtp().file([XYZ], connect=np.arange(120) + 1),
        "connectivity must name points 0 to 119, got 120",
    ),
    "short connectivity": (Vtp().file([XYZ], connect=np.arange(9)), "offsets must rise to the 9 entries"),
    "damaged zlib": (GOOD_VTP.replace(b"eJ", b"eK", 3), "cannot be read, its binary data are damaged"),
    "damaged ascii": (ASCII_VTP.replace(b">60.0 ", b">sixty "), "Points cannot be read, its ascii data"),
    "odd coordinates": (ASCII_VTP.replace(b">60.0 ", b">"), "Points must hold three numbers a point, got 359"),
    "300 in eight bits": (
        ASCII_VTP.replace(b'Int64" Name="connectivity', b'Int8" Name="connectivity').replace(b" 100 ", b" 300 "),
        "connectivity cannot be read, its ascii data are damaged or cut off.*300 out of bounds for int8",
    ),
    "connectivity of fractions": (
        ASCII_VTP.replace(b'Int64" Name="connectivity', b'Float32" Name="connectivity'),
        "Lines must hold whole numbers, got float32",
    ),
    "a bomb": (BOMB, "Points cannot be read.*24 bytes announced, more found"),
    "odd header": (GOOD_VTP.replace(b"UInt32", b"UInt16"), "header_type UInt32 or UInt64, got .*'UInt16'"),
    "offset outside": (
        Vtp("appended").file([XYZ]).replace(b'offset="0"', b'offset="99999"'),
        "offset 99999 of Points lies outside",
    ),
    "unknown numbers": (GOOD_VTP.replace(b"Float32", b"String"), "Points must be of type .*got 'String'"),
    "negative radius": (
        Vtp().file([XYZ], [np.where(np.arange(120) == 5, -1, RADIUS)]),
        r"line 0 radius\[5\] must be finite and",
    ),
}

SLICER = {
    "not JSON": ("{'markups': []}", "must be JSON, as 3D Slicer writes it"),
    "no markups": ("{}", "must hold a list 'markups'"),
    "points only": (markups({"type": "Fiducial"}), "type 'Curve' or 'ClosedCurve', got 'Fiducial'"),
    "slicer without unit": (markups(curve(XYZ, units=None)), "no unit for coordinateUnits; pass unit='mm'"),
    "slicer in inches": (markups(curve(XYZ, units="[in_i]")), r"declares coordinateUnits in '\[in_i\]'"),
    "slicer unit at odds": (markups(curve(XYZ)), "declares coordinateUnits in 'mm', but unit='m'", {"unit": "m"}),
    "odd system": (markups(curve(XYZ, system="IJK")), "coordinateSystem must be 'LPS' or 'RAS', got 'IJK'"),
    "no control points": (markups(curve(XYZ) | {"controlPoints": []}), "a list 'controlPoints' in its curve"),
    "no position": (markups(curve(XYZ) | {"controlPoints": [{"id": "1"}]}), r"controlPoints\[0\] must have a position"),
    "position of two": (
        markups(curve(XYZ[:, :2])),
        r"controlPoints\[0\] must have a position of three numbers, got \[60",
    ),
    "two curves": (markups(curve(XYZ), curve(XYZ)), "holds 2 lines; choose one with line=0 to 1"),
    "radii missing": (markups(curve(XYZ, RADIUS[:9])), "Radius must hold 120 values, one a control point, got 9"),
    "measurements are a number": (markups(curve(XYZ) | {"measurements": 5}), "measurements must be a list, got 5"),
    "radii are words": (
        markups(curve(XYZ) | measured(["wide"] * 120)),
        r"Radius must hold a list of numbers, got \['w",
    ),
    "a radius is a dict": (markups(curve(XYZ) | measured([{}] * 120)), r"Radius must hold a list of numbers, got \[{}"),
    "radii are a dict": (markups(curve(XYZ) | measured({"a": 1})), "Radius must hold a list of numbers, got {'a': 1}"),
    "100 000 brackets": ('{"markups": ' + "[" * 100_000, "cannot be read as centrelines: .*recursion"),
    "small ring": (markups(curve(XYZ[:3], kind="ClosedCurve")), "at least 4 different points, got 3"),
}

MALFORMED = {
    **{("a.csv", name): (case, {}) for name, case in CSV.items()},
    **{("a.vtp", name): (case, {"unit": "mm"}) for name, case in VTK.items()},
    **{("a.mrk.json", name): (case, {}) for name, case in SLICER.items()},
    ("a.vtk", "other ending"): ((GOOD_VTP, "must be a .csv, .vtp or .mrk.json file, got the ending '.vtk'"), {}),
}


@pytest.mark.parametrize("case", MALFORMED, ids="-".join)
def test_malformed_files_are_refused_with_words_to_act_on(tmp_path, case):
    name, what = case
    (content, words, *more), arguments = MALFORMED[case]
    path = write(tmp_path, name, content)
    tracemalloc.start()
    try:
        with pytest.raises(ValueError, match=words) as refused:
            Tract.load(path, **(more[0] if more else arguments))
        assert tracemalloc.get_traced_memory()[1] < 100e6
    finally:
        tracemalloc.stop()
    # The file is named, unless it is the argument that is wrong.
    assert name in str(refused.value) or what in ("no such unit", "negative smooth", "no spacing")


def test_the_sound_twins_of_the_malformed_files_load(tmp_path):
    for name, content, arguments in (
        ("a.csv", TEXT, {}),
        ("b.vtp", GOOD_VTP, {"unit": "mm"}),
        ("c.vtp", ASCII_VTP, {"unit": "mm"}),
        ("d.mrk.json", markups(curve(XYZ)), {}),
    ):
        assert Tract.load(write(tmp_path, name, content), **arguments).length == pytest.approx(0.2542, rel=1e-3)


def test_a_file_that_is_not_there(tmp_path):
    for name in ("a.csv", "a.vtp", "a.mrk.json"):
        with pytest.raises(FileNotFoundError, match=name):
            Tract.load(tmp_path / name, "mm")
