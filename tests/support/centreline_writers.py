"""Centreline files as their tools write them: CSV, VTK XML PolyData in all its layouts, 3D Slicer markups."""

from __future__ import annotations

import base64
import json
import struct
import zlib

import numpy as np

MISR = "MaximumInscribedSphereRadius"


def vessel(count=500, turn=4.2, noise=0.0):
    """A rising arc of 60 mm radius in mm, and its lumen's radii in mm: what a tool would export."""
    angle = np.linspace(0.0, turn, count)
    xyz = np.stack([60 * np.cos(angle), 60 * np.sin(angle), 8 * angle], axis=1)
    xyz += np.random.default_rng(0).normal(scale=noise, size=xyz.shape) if noise else 0.0
    return xyz, 6 + np.sin(angle)


def csv_text(xyz, radius=None, header="x [mm],y [mm],z [mm],radius [mm]"):
    rows = xyz if radius is None else np.column_stack([xyz, radius])
    names = header.split(",")[: rows.shape[1]]
    return ",".join(names) + "\n" + "".join(",".join(f"{v:.9g}" for v in row) + "\n" for row in rows)


class Vtp:
    """Writes VTK XML PolyData in every layout that VTK's own writer offers."""

    def __init__(
        self, form="binary", compressed=True, header="UInt32", order="LittleEndian", encoding="base64", block=600
    ):
        self.form, self.compressed, self.header, self.order = form, compressed, header, order
        self.encoding, self.block, self.appended = encoding, block, b""
        self.mark = "<" if order == "LittleEndian" else ">"

    def data(self, array):
        plain = array.astype(array.dtype.newbyteorder(self.mark)).tobytes()
        number = self.mark + ("I" if self.header == "UInt32" else "Q")

        def pack(*values):
            return b"".join(struct.pack(number, v) for v in values)

        text = base64.b64encode if self.form == "binary" or self.encoding == "base64" else bytes
        if not self.compressed:
            return text(pack(len(plain)) + plain)
        blocks = [plain[i : i + self.block] for i in range(0, len(plain), self.block)]
        packed = [zlib.compress(b) for b in blocks]
        last = len(blocks[-1]) % self.block if blocks else 0
        return text(pack(len(blocks), self.block, last, *map(len, packed))) + text(b"".join(packed))

    def array(self, name, array, components=1):
        kind = {"f": "Float", "i": "Int", "u": "UInt"}[array.dtype.kind] + str(8 * array.dtype.itemsize)
        opening = f'<DataArray type="{kind}" Name="{name}" NumberOfComponents="{components}" format="{self.form}"'
        if self.form == "ascii":
            return opening.encode() + b">" + " ".join(map(str, array.ravel().tolist())).encode() + b"</DataArray>"
        data = self.data(array.ravel())
        if self.form == "binary":
            return opening.encode() + b">\n  " + data + b"\n</DataArray>"
        opening += f' offset="{len(self.appended)}"/>'
        self.appended += data
        return opening.encode()

    def file(self, lines, radii=None, values=None, connect=None):
        """lines : point arrays (n, 3); radii : one array a line; values, connect : replacements, for broken files."""
        points = np.vstack(lines).astype("f4")
        connectivity = np.arange(len(points), dtype="i8") if connect is None else connect
        offsets = np.cumsum([len(line) for line in lines]).astype("i8")
        radius = np.concatenate(radii).astype("f8") if radii is not None else values
        body = [
            b'<PolyData>\n<Piece NumberOfPoints="%d" NumberOfVerts="0" NumberOfLines="%d">' % (len(points), len(lines)),
            b"<PointData>" + (b"" if radius is None else self.array(MISR, radius)) + b"</PointData>",
            b"<Points>" + self.array("Points", points, 3) + b"</Points>",
            b"<Verts>"
            + self.array("connectivity", np.empty(0, "i8"))
            + self.array("offsets", np.empty(0, "i8"))
            + b"</Verts>",
            b"<Lines>" + self.array("connectivity", connectivity) + self.array("offsets", offsets) + b"</Lines>",
            b"</Piece>\n</PolyData>",
        ]
        head = f'<VTKFile type="PolyData" version="1.0" byte_order="{self.order}" header_type="{self.header}"'
        head += ' compressor="vtkZLibDataCompressor">' if self.compressed else ">"
        tail = b""
        if self.form == "appended":
            tail = b'<AppendedData encoding="%s">\n _%s\n</AppendedData>' % (self.encoding.encode(), self.appended)
        return b'<?xml version="1.0"?>\n' + head.encode() + b"\n" + b"\n".join(body) + tail + b"\n</VTKFile>\n"


def curve(xyz, radius=None, kind="Curve", system="LPS", units="mm", **more):
    turned = [-1, 0, 0, 0, -1, 0, 0, 0, 1]
    points = [
        {"id": str(i), "label": f"C-{i}", "position": p, "orientation": turned, "positionStatus": "defined"}
        for i, p in enumerate(np.asarray(xyz).tolist(), 1)
    ]
    markup = {"type": kind, "coordinateSystem": system, "coordinateUnits": units, "controlPoints": points}
    if radius is not None:
        values = np.asarray(radius).tolist()
        markup["measurements"] = [
            {"name": "length", "enabled": True, "value": 251.0, "units": "mm"},
            {"name": "Radius", "enabled": True, "units": "mm", "controlPointValues": values},
        ]
    return {k: v for k, v in (markup | more).items() if v is not None}


def markups(*curves):
    base = "https://raw.githubusercontent.com/slicer/slicer/master/Modules/Loadable/Markups/Resources/Schema/"
    schema = base + "markups-schema-v1.0.3.json#"
    return json.dumps({"@schema": schema, "markups": list(curves)})


def write(folder, name, content):
    path = folder / name
    path.write_bytes(content if isinstance(content, bytes) else content.encode())
    return path
