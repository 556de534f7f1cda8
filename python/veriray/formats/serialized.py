"""Mitsuba's serialized meshes, versions 3 and 4.

A file is a list of meshes, each behind a header of four bytes and compressed by itself; where they
begin stands at the end of the file. A mesh says how large it is, and no more than that is unpacked.
Vertex colours are left out, and so is the flag for face normals, which Mitsuba 3 ignores too:
face_normals of the shape decides.
"""

from __future__ import annotations

import struct
import zlib
from typing import Any

import numpy as np
import numpy.typing as npt

from .ply import MeshFileError

Array = npt.NDArray[Any]
MAX_BYTES = 2**31  # of an unpacked mesh
_MAGIC = 0x041C
_NORMALS, _UV, _COLOURS, _SINGLE, _DOUBLE = 0x1, 0x2, 0x8, 0x1000, 0x2000
_HEAD = 2**16  # bytes that hold flags, name and counts


def read(data: bytes, index: int) -> tuple[Array, Array, Array | None, Array | None]:
    """Mesh `index` of a file: vertices (V, 3) float64, triangles (T, 3) int64; vertex normals
    (V, 3) and texture coordinates (V, 2) float64, or None.

    Raises MeshFileError for an index that the file does not have, and for any damage.
    """
    version = _version(data, 0)
    offset, end = _place(data, version, index) if index else (0, len(data))
    if index:
        version = _version(data, offset)
    unpack = zlib.decompressobj()
    try:
        head = unpack.decompress(memoryview(data)[offset + 4 : end], _HEAD)
        flags, vertices, triangles, start = _counts(head, version)
        single = "<f4" if not flags & _DOUBLE else "<f8"
        parts = [(single, 3, vertices)]
        for flag, width in ((_NORMALS, 3), (_UV, 2), (_COLOURS, 3)):
            parts.append((single, width, vertices if flags & flag else 0))
        parts.append(("<u4", 3, triangles))
        size = start + sum(np.dtype(kind).itemsize * width * rows for kind, width, rows in parts)
        if size > MAX_BYTES:
            raise MeshFileError(
                f": mesh {index} states {vertices} vertices and {triangles} triangles, together "
                f"{size} bytes; at most {MAX_BYTES} allowed"
            )
        body = head + unpack.decompress(unpack.unconsumed_tail, max(size + 1 - len(head), 1))
    except zlib.error:
        raise MeshFileError(f" is damaged: mesh {index} cannot be unpacked") from None
    if len(body) > size:
        raise MeshFileError(
            f" is damaged: mesh {index} holds more than the {size} bytes that it states"
        )
    if len(body) < size or not unpack.eof:
        raise MeshFileError(f" is damaged: mesh {index} ends within its {size} bytes")
    tables: list[Array] = []
    for kind, width, rows in parts:
        table = np.frombuffer(body, kind, width * rows, start).reshape(rows, width)
        start += table.nbytes
        tables.append(table.astype(np.float64 if kind != "<u4" else np.int64))
    corners, normals, uv, _, faces = tables
    return corners, faces, normals if flags & _NORMALS else None, uv if flags & _UV else None


def _version(data: bytes, offset: int) -> int:
    if len(data) < offset + 4:
        raise MeshFileError(" is not a serialized mesh: it has no header")
    magic, version = struct.unpack_from("<HH", data, offset)
    if magic != _MAGIC or version not in (3, 4):
        raise MeshFileError(
            f" is not a serialized mesh: at byte {offset} stand the format {magic:#06x} and the "
            f"version {version}, expected {_MAGIC:#06x} and 3 or 4"
        )
    return int(version)


def _place(data: bytes, version: int, index: int) -> tuple[int, int]:
    """Where mesh `index` begins, and an end of what it may take, from the end of the file."""
    (count,) = struct.unpack_from("<I", data, len(data) - 4)
    kind = np.dtype("<u8" if version == 4 else "<u4")
    table = len(data) - 4 - count * kind.itemsize
    if count == 0 or table < 4:
        raise MeshFileError(f" is damaged: its end states {count} meshes")
    if index >= count:
        raise MeshFileError(f': "shape_index" = {index} is outside [0, {count - 1}]')
    offset = int(np.frombuffer(data, kind, 1, table + index * kind.itemsize)[0])
    if offset > table - 4:
        raise MeshFileError(f" is damaged: mesh {index} is said to begin at byte {offset}")
    return offset, table


def _counts(head: bytes, version: int) -> tuple[int, int, int, int]:
    """Flags, numbers of vertices and triangles, and where their arrays begin."""
    name = head.find(b"\0", 4) if version == 4 else 3
    if name < 0 or len(head) < name + 17:
        raise MeshFileError(" is damaged: a mesh has no counts of vertices and triangles")
    (flags,) = struct.unpack_from("<I", head)
    vertices, triangles = struct.unpack_from("<QQ", head, name + 1)
    if flags & _SINGLE and flags & _DOUBLE:
        raise MeshFileError(f" is damaged: the flags {flags:#x} state single and double precision")
    return flags, vertices, triangles, name + 17
