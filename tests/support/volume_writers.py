"""Voxel volumes as files: NIfTI, MetaImage and NRRD, plain and compressed."""

import gzip
import struct
import zlib

import numpy as np


def nifti(values, affine, packed=False, unit=2):
    """A NIfTI-1 file with an sform; unit 2 is mm."""
    codes = {"uint8": 2, "int16": 4, "float32": 16}
    head = bytearray(348)
    struct.pack_into("<i", head, 0, 348)
    struct.pack_into("<8h", head, 40, 3, *values.shape, 1, 1, 1, 1)
    struct.pack_into("<2h", head, 70, codes[values.dtype.name], 8 * values.dtype.itemsize)
    struct.pack_into("<8f", head, 76, 1, *np.linalg.norm(affine[:3, :3], axis=0), 0, 0, 0, 0)
    struct.pack_into("<3f", head, 108, 352, 1, 0)
    head[123] = unit
    struct.pack_into("<2h", head, 252, 0, 1)
    for i in range(3):
        struct.pack_into("<4f", head, 280 + 16 * i, *affine[i])
    head[344:348] = b"n+1\0"
    whole = bytes(head) + b"\0\0\0\0" + values.tobytes(order="F")
    return gzip.compress(whole) if packed else whole


def mha(values, affine, packed=False):
    spacing = np.linalg.norm(affine[:3, :3], axis=0)
    kinds = {"uint8": "MET_UCHAR", "int16": "MET_SHORT", "float32": "MET_FLOAT"}
    turn = " ".join(f"{x:.9g}" for x in (affine[:3, :3] / spacing).T.ravel())
    head = (
        f"ObjectType = Image\nNDims = 3\nBinaryData = True\nBinaryDataByteOrderMSB = False\nCompressedData = {packed}\n"
        f"TransformMatrix = {turn}\nOffset = {' '.join(map(str, affine[:3, 3]))}\n"
        f"ElementSpacing = {' '.join(map(str, spacing))}\n"
        f"DimSize = {' '.join(map(str, values.shape))}\n"
        f"ElementType = {kinds[values.dtype.name]}\nElementDataFile = LOCAL\n"
    )
    raw = values.tobytes(order="F")
    return head.encode() + (zlib.compress(raw) if packed else raw)


def nrrd(values, affine, encoding="raw"):
    kinds = {"uint8": "uchar", "int16": "short", "float32": "float"}
    columns = " ".join("(" + ",".join(f"{x:.9g}" for x in affine[:3, i]) + ")" for i in range(3))
    head = (
        f"NRRD0004\ntype: {kinds[values.dtype.name]}\ndimension: 3\nspace: left-posterior-superior\n"
        f"sizes: {' '.join(map(str, values.shape))}\nspace directions: {columns}\n"
        "kinds: domain domain domain\nendian: little\n"
        f'encoding: {encoding}\nspace units: "mm" "mm" "mm"\n'
        f"space origin: ({','.join(f'{x:.9g}' for x in affine[:3, 3])})\n\n"
    )
    raw = values.tobytes(order="F")
    if encoding == "gzip":
        raw = gzip.compress(raw)
    elif encoding == "ascii":
        raw = " ".join(map(str, values.ravel(order="F").tolist())).encode()
    return head.encode() + raw
