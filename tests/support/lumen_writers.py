"""Small files of every format, written by the tests themselves: a fork as a surface, a mask, and centrelines."""

import base64
import json
import struct
import zlib
from functools import lru_cache

import numpy as np
from skimage.measure import marching_cubes

from magwire_env.lumen.named_trees import fork
from tests.support.volume_writers import mha, nifti, nrrd


@lru_cache
def the_fork():
    """A fork of 4 mm radius; the tests' coordinates are in mm."""
    return fork(35.0, 4e-3, 0.03)


def meshed(lumen, pitch):
    """The closed surface of a lumen, cut flat at its inlet: vertices (n, 3) mm, faces (m, 3) with normals outwards."""
    block = 8
    low, high = lumen.bounds
    low = low - 3 * pitch
    shape = (np.ceil((high - low) / pitch / block).astype(int) + 1) * block
    at, way, mouth = lumen.position("inlet"), lumen.tangent("inlet"), float(lumen.trunk.radius(0.0))

    def depth(xyz):
        cut = np.where(np.linalg.norm(xyz - at, axis=1) < 4 * mouth, (xyz - at) @ way, np.inf)
        return np.minimum(lumen.wall_distance(xyz), cut)

    corner = np.stack(np.meshgrid(*(np.arange(0, n, block) for n in shape), indexing="ij"), axis=-1).reshape(-1, 3)
    far = depth(low + pitch * (corner + block / 2))
    field = np.repeat(np.repeat(np.repeat(far.reshape(shape // block), block, 0), block, 1), block, 2).astype(
        np.float32
    )
    inner = np.stack(np.meshgrid(*(np.arange(block),) * 3, indexing="ij"), axis=-1).reshape(-1, 3)
    for c in corner[np.abs(far) < 1.1 * pitch * block]:
        values = depth(low + pitch * (c + inner))
        field[c[0] : c[0] + block, c[1] : c[1] + block, c[2] : c[2] + block] = values.reshape((block,) * 3)
    vertices, faces, _, _ = marching_cubes(field, 0.0)
    return 1e3 * (low + pitch * vertices), faces[:, ::-1].astype(np.int64)


def opened(lumen, vertices, faces):
    """The faces without those that close the inlet."""
    at, way = 1e3 * lumen.position("inlet"), lumen.tangent("inlet")
    flat = np.abs((vertices - at) @ way) < 2e-3
    flat &= np.linalg.norm(vertices - at, axis=1) < 1.2e3 * float(lumen.trunk.radius(0.0))
    return faces[~flat[faces].all(axis=1)]


@lru_cache
def mesh(pitch=0.8e-3):
    """The fork's surface, of about 3000 triangles."""
    return meshed(the_fork(), pitch)


def stl_ascii(vertices, faces):
    rows = ["solid fork"]
    for a, b, c in vertices[faces]:
        rows.append(" facet normal 0 0 0\n  outer loop")
        rows += [f"   vertex {p[0]:.6f} {p[1]:.6f} {p[2]:.6f}" for p in (a, b, c)]
        rows.append("  endloop\n endfacet")
    return "\n".join([*rows, "endsolid fork", ""]).encode()


def stl_binary(vertices, faces):
    table = np.zeros(len(faces), dtype=[("normal", "<f4", 3), ("corners", "<f4", (3, 3)), ("rest", "<u2")])
    table["corners"] = vertices[faces]
    return b"made by a test".ljust(80) + struct.pack("<I", len(faces)) + table.tobytes()


def obj(vertices, faces):
    rows = ["# a test", "mtllib /etc/passwd", *(f"v {x:.6f} {y:.6f} {z:.6f}" for x, y, z in vertices)]
    rows += [f"f {a}//1 {b}//1 {c}//1" for a, b, c in faces + 1]
    return "\n".join([*rows, ""]).encode()


def ply_ascii(vertices, faces):
    head = ply_head("ascii", vertices, faces)
    rows = [f"{x:.6f} {y:.6f} {z:.6f}" for x, y, z in vertices] + [f"3 {a} {b} {c}" for a, b, c in faces]
    return head + ("\n".join(rows) + "\n").encode()


def ply_binary(vertices, faces):
    table = np.zeros(len(faces), dtype=[("n", "u1"), ("corners", "<i4", 3)])
    table["n"], table["corners"] = 3, faces
    return ply_head("binary_little_endian", vertices, faces) + vertices.astype("<f4").tobytes() + table.tobytes()


def ply_head(form, vertices, faces):
    return (
        f"ply\nformat {form} 1.0\nelement vertex {len(vertices)}\n"
        "property float x\nproperty float y\nproperty float z\n"
        f"element face {len(faces)}\nproperty list uchar int vertex_indices\nend_header\n"
    ).encode()


def vtk_legacy(vertices, faces, binary=False, version="3.0"):
    """A legacy PolyData file; version 5.1 has offsets and connectivity."""
    out = f"# vtk DataFile Version {version}\na test\n{'BINARY' if binary else 'ASCII'}\nDATASET POLYDATA\n".encode()

    def block(numbers, code):
        numbers = np.asarray(numbers)
        if binary:
            return numbers.astype(">" + code).tobytes() + b"\n"
        return (" ".join(map(repr, numbers.ravel().tolist())) + "\n").encode()

    out += f"POINTS {len(vertices)} float\n".encode() + block(vertices.astype("f4"), "f4")
    if version == "3.0":
        cells = np.column_stack([np.full(len(faces), 3), faces])
        out += f"POLYGONS {len(faces)} {cells.size}\n".encode() + block(cells, "i4")
    else:
        out += f"POLYGONS {len(faces) + 1} {faces.size}\nOFFSETS vtktypeint64\n".encode()
        out += block(3 * np.arange(len(faces) + 1), "i8") + b"CONNECTIVITY vtktypeint64\n" + block(faces, "i8")
    out += f"POINT_DATA {len(vertices)}\nSCALARS depth float 1\nLOOKUP_TABLE default\n".encode()
    return out + block(np.zeros(len(vertices)), "f4")


def vtp(points, lines=(), faces=None, point_data=None, cell_data=None, form="ascii", packed=False):
    """A VTP file; form: ascii, binary (base64 in place) or appended (raw)."""
    appended = bytearray()

    def array(name, values, kind, parts=1):
        values = np.ascontiguousarray(values, dtype={"Float64": "<f8", "Int64": "<i8"}[kind])
        head = f'<DataArray type="{kind}" Name="{name}" NumberOfComponents="{parts}" format="{form}"'
        if form == "ascii":
            return f"{head}>{' '.join(map(repr, values.ravel().tolist()))}</DataArray>"
        raw = values.tobytes()
        if packed:
            block = zlib.compress(raw)
            header, raw = struct.pack("<4I", 1, len(raw), 0, len(block)), block
        else:
            header = struct.pack("<I", len(raw))
        if form == "binary":
            text = base64.b64encode(header) + base64.b64encode(raw) if packed else base64.b64encode(header + raw)
            return f"{head}>{text.decode()}</DataArray>"
        offset = len(appended)
        appended.extend(header + raw)
        return f'{head} offset="{offset}"/>'

    points = np.asarray(points, dtype=float)
    faces = np.zeros((0, 3), dtype=int) if faces is None else faces
    body = f'<Piece NumberOfPoints="{len(points)}" NumberOfLines="{len(lines)}" NumberOfPolys="{len(faces)}">'
    body += "<PointData>" + "".join(array(n, v, "Float64") for n, v in (point_data or {}).items()) + "</PointData>"
    body += "<CellData>" + "".join(array(n, v, "Int64") for n, v in (cell_data or {}).items()) + "</CellData>"
    body += f"<Points>{array('Points', points, 'Float64', 3)}</Points>"
    joined = np.concatenate([np.asarray(x) for x in lines]) if len(lines) else np.zeros(0)
    body += (
        "<Lines>"
        + array("connectivity", joined, "Int64")
        + array("offsets", np.cumsum([len(x) for x in lines]), "Int64")
        + "</Lines>"
    )
    body += (
        "<Polys>"
        + array("connectivity", faces.ravel(), "Int64")
        + array("offsets", 3 * np.arange(1, len(faces) + 1), "Int64")
        + "</Polys>"
    )
    more = ' compressor="vtkZLibDataCompressor"' if packed else ""
    head = f'<?xml version="1.0"?>\n<VTKFile type="PolyData" version="0.1" byte_order="LittleEndian"{more}>'
    text = f"{head}<PolyData>{body}</Piece></PolyData>"
    if form == "appended":
        return text.encode() + b'<AppendedData encoding="raw">_' + bytes(appended) + b"</AppendedData></VTKFile>"
    return (text + "</VTKFile>").encode()


# --- lines ------------------------------------------------------------------------------------------------------------


def fork_lines(spacing=1.0):
    """The fork's centrelines: name → (points mm, radii mm)."""
    made = {}
    for b in the_fork().branches:
        s = np.linspace(0, b.length, round(1e3 * b.length / spacing) + 1)
        made[b.name] = 1e3 * b.curve.position(s), 1e3 * b.radius(s)
    return made


def csv(points, radii):
    rows = [
        "x [mm],y [mm],z [mm],radius [mm]",
        *(f"{x:.6f},{y:.6f},{z:.6f},{r:.6f}" for (x, y, z), r in zip(points, radii, strict=True)),
    ]
    return ("\n".join(rows) + "\n").encode()


def markups(lines, unit="mm", system="LPS"):
    curves = []
    for name, (points, radii) in lines.items():
        curves.append({
            "type": "Curve", "name": name, "coordinateSystem": system, "coordinateUnits": unit,
            "controlPoints": [
                {"id": str(i), "position": p, "positionStatus": "defined"} for i, p in enumerate(points.tolist())
            ],
            "measurements": [{"name": "Radius", "units": unit, "controlPointValues": radii.tolist()}],
        })  # fmt: skip
    return json.dumps({"markups": curves}).encode()


def vmtk_whole(form="ascii", packed=False):
    """Centrelines as vmtkcenterlines writes them: each from the inlet to its outlet, so that they overlap."""
    lines = fork_lines()
    points, radii, cells = [], [], []
    for name in ("left", "right"):
        p = np.concatenate([lines["trunk"][0], lines[name][0][1:]])
        r = np.concatenate([lines["trunk"][1], lines[name][1][1:]])
        cells.append(np.arange(len(p)) + sum(map(len, points)))
        points.append(p)
        radii.append(r)
    data = {"MaximumInscribedSphereRadius": np.concatenate(radii)}
    return vtp(np.concatenate(points), cells, point_data=data, form=form, packed=packed)


def vmtk_split():
    """The same split by vmtkbranchextractor: tracts with CenterlineIds, TractIds, GroupIds and Blanking."""
    lines = fork_lines()
    points, radii, cells, ids = [], [], [], {"CenterlineIds": [], "TractIds": [], "GroupIds": [], "Blanking": []}
    for k, name in enumerate(("left", "right")):
        p = np.concatenate([lines["trunk"][0], lines[name][0][1:]])
        r = np.concatenate([lines["trunk"][1], lines[name][1][1:]])
        for tract, (a, b) in enumerate(((0, 26), (25, 36), (35, len(p)))):
            cells.append(np.arange(b - a) + sum(map(len, points)))
            points.append(p[a:b])
            radii.append(r[a:b])
            for key, value in zip(ids, (k, tract, (0, 1, 2 + k)[tract], int(tract == 1)), strict=True):
                ids[key].append(value)
    order = [3, 0, 5, 1, 2, 4]
    data = {"MaximumInscribedSphereRadius": np.concatenate(radii)}
    return vtp(
        np.concatenate(points),
        [cells[i] for i in order],
        point_data=data,
        cell_data={k: np.array(v)[order] for k, v in ids.items()},
    )


def swc():
    rows, number, last = ["# a test"], 0, {}
    for name, parent in (("trunk", None), ("left", "trunk"), ("right", "trunk")):
        points, radii = fork_lines()[name]
        before = last.get(parent, -1)
        for p, r in list(zip(points, radii, strict=True))[0 if parent is None else 1 :]:
            number += 1
            rows.append(f"{number} 2 {p[0]:.5f} {p[1]:.5f} {p[2]:.5f} {r:.5f} {before}")
            before = number
        last[name] = number
    return ("\n".join(rows) + "\n").encode()


def json_graph():
    nodes, edges, last = [], [], {}
    for name, parent in (("trunk", None), ("left", "trunk"), ("right", "trunk")):
        points, radii = fork_lines(3.0)[name]
        before = last.get(parent)
        for p, r in list(zip(points.tolist(), radii.tolist(), strict=True))[0 if parent is None else 1 :]:
            nodes.append({"id": f"n{len(nodes)}", "position": p, "radius": r})
            if before is not None:
                edges.append([before, nodes[-1]["id"]])
            before = nodes[-1]["id"]
        last[name] = before
    return json.dumps({"unit": "mm", "inlet": "n0", "nodes": nodes, "edges": edges}).encode()


def simvascular_path(points, name="a"):
    rows = "".join(
        f'<path_point id="{i}"><pos x="{p[0]:.6f}" y="{p[1]:.6f}" z="{p[2]:.6f}"/></path_point>'
        for i, p in enumerate(points)
    )
    return (
        f'<?xml version="1.0" encoding="UTF-8" ?>\n<format version="1.0" />\n<path id="1" name="{name}">'
        f'<timestep id="0"><path_element><path_points>{rows}</path_points></path_element></timestep></path>'
    ).encode()


def simvascular_contours(points, radii, name="a"):
    rings = []
    tangent = np.gradient(points, axis=0)
    tangent /= np.linalg.norm(tangent, axis=1, keepdims=True)
    for i, (p, t, r) in enumerate(zip(points, tangent, radii, strict=True)):
        n1 = np.cross(t, (0, 0, 1.0))
        n1 /= np.linalg.norm(n1)
        n2 = np.cross(t, n1)
        turn = np.linspace(0, 2 * np.pi, 60, endpoint=False)
        ring = p + r * (np.cos(turn)[:, None] * n1 + np.sin(turn)[:, None] * n2)
        rows = "".join(f'<point id="{k}" x="{q[0]:.6f}" y="{q[1]:.6f}" z="{q[2]:.6f}" />' for k, q in enumerate(ring))
        rings.append(f'<contour id="{i}" type="Circle"><contour_points>{rows}</contour_points></contour>')
    return (
        f'<?xml version="1.0" encoding="UTF-8" ?>\n<format version="1.0" />\n<contourgroup path_name="{name}">'
        f'<timestep id="0">{"".join(rings)}</timestep></contourgroup>'
    ).encode()


@lru_cache
def surfaces():
    """Ending and bytes of every surface format."""
    v, f = mesh()
    return {
        "ascii.stl": stl_ascii(v, f), "binary.stl": stl_binary(v, f), "fork.obj": obj(v, f),
        "ascii.ply": ply_ascii(v, f),
        "binary.ply": ply_binary(v, f), "old_ascii.vtk": vtk_legacy(v, f), "old_binary.vtk": vtk_legacy(v, f, True),
        "new_ascii.vtk": vtk_legacy(v, f, False, "5.1"), "new_binary.vtk": vtk_legacy(v, f, True, "5.1"),
        "ascii.vtp": vtp(v, faces=f), "inline.vtp": vtp(v, faces=f, form="binary"),
        "packed.vtp": vtp(v, faces=f, form="binary", packed=True),
        "appended.vtp": vtp(v, faces=f, form="appended", packed=True),
    }  # fmt: skip


@lru_cache
def volumes():
    """Name and bytes of every volume format: the same fork in anisotropic, turned or flipped voxels."""
    made = {}
    for name, write, affine in (
        ("mask.nii", nifti, _affine(flip=True)), ("packed.nii.gz", lambda v, a: nifti(v, a, True), _affine()),
        ("mask.mha", mha, _affine(turn=0.3)), ("packed.mha", lambda v, a: mha(v, a, True), _affine()),
        ("mask.nrrd", nrrd, _affine(flip=True)), ("packed.nrrd", lambda v, a: nrrd(v, a, "gzip"), _affine(turn=-0.5)),
        ("ascii.nrrd", lambda v, a: nrrd(v, a, "ascii"), _affine()),
    ):  # fmt: skip
        made[name] = write((sampled(affine) > 0).astype(np.uint8), affine)
    level = sampled(_affine()).astype(np.float32)
    made["level.nii"] = nifti(-level, _affine())
    made["level.nrrd"] = nrrd(level, _affine())
    return made


def _affine(flip=False, turn=0.0):
    """Voxels of 0.5 × 0.6 × 0.8 mm about the fork, perhaps flipped in x or turned about z."""
    affine = np.eye(4)
    c, s = np.cos(turn), np.sin(turn)
    affine[:3, :3] = np.array([[c, -s, 0], [s, c, 0], [0, 0, 1]]) @ np.diag([-0.5 if flip else 0.5, 0.6, 0.8])
    middle = 1e3 * np.mean(the_fork().bounds, axis=0)
    affine[:3, 3] = middle - affine[:3, :3] @ (np.array(SHAPE) / 2)
    return affine


SHAPE = (170, 120, 20)


def sampled(affine, inlet=0.0):
    """Depth in the fork, mm, at the voxels of an affine map to mm, cut flat at the inlet."""
    cells = np.stack(np.meshgrid(*map(np.arange, SHAPE), indexing="ij"), axis=-1).reshape(-1, 3)
    xyz = 1e-3 * (cells @ affine[:3, :3].T + affine[:3, 3])
    return 1e3 * np.minimum(the_fork().wall_distance(xyz), xyz[:, 0] - inlet).reshape(SHAPE)


@lru_cache
def trees():
    """Name and bytes of every format of lines; radii and units as each has them."""
    lines = fork_lines()
    whole = (
        np.concatenate([lines["trunk"][0], lines["left"][0][1:]]),
        np.concatenate([lines["trunk"][1], lines["left"][1][1:]]),
    )
    return {
        "one.csv": csv(*whole), "fork.mrk.json": markups(lines), "whole.vtp": vmtk_whole(),
        "packed.vtp": vmtk_whole("binary", True),
        "split.vtp": vmtk_split(), "fork.swc": swc(), "graph.json": json_graph(),
        "path.pth": simvascular_path(whole[0]), "rings.ctgr": simvascular_contours(*whole),
    }  # fmt: skip
