"""Large binary PLY files of the usual form, read piece by piece by several threads.

Such a file has vertices of numbers and faces that all have three, or all have four corners. What is
not of this form, or is wrong, is left to `ply`, which finds the words for it. Pieces are read, not
mapped: a mapped file that another program shortens would end the process.
"""

from __future__ import annotations

import os
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

from ..chunks import in_chunks
from ..files import open_regular
from . import ply, polygons

Array = npt.NDArray[Any]
#: Bytes of a file from which on it pays, and of a piece.
LEAST, PIECE = 1 << 18, 1 << 19
MAX_BYTES = 8 * 2**30


class _UnusualError(Exception):
    """The file is for `ply`."""


class Table:
    """A column of numbers that is filled piece by piece, with its extremes."""

    def __init__(self, rows: int, width: int, dtype: Any) -> None:
        self.values = np.empty((rows, width), dtype)
        self.low, self.high = np.inf, -np.inf

    @property
    def extremes(self) -> tuple[float, float]:
        """The least and greatest number."""
        return self.low, self.high

    def add(self, extremes: list[tuple[float, float]]) -> None:
        """Takes the extremes of all pieces; numbers that are not finite make the file unusual."""
        for low, high in extremes:
            if not -np.inf < low <= high < np.inf:
                raise _UnusualError
            self.low, self.high = min(self.low, low), max(self.high, high)


def read(path: Path, most: int) -> tuple[Table, Table, Table | None, Table | None] | None:
    """Vertices (V, 3) float64, triangles (T, 3) uint32 within them, normals (V, 3) float64 and
    texture coordinates (V, 2) float64 or None; no -0. None for a file that is not of the usual
    form, is smaller than LEAST or larger than `most` bytes, or cannot be read."""
    try:
        with open_regular(path) as file:
            size = os.fstat(file.fileno()).st_size
            if LEAST <= size <= most:
                return _read(file.fileno(), size)
    except (OSError, ValueError, _UnusualError, ply.MeshFileError):
        pass
    return None


def _read(file: int, size: int) -> tuple[Table, Table, Table | None, Table | None]:
    head = os.pread(file, 2**16, 0)
    elements, order, rest = ply.header(head)
    at = len(head) - len(rest)
    if not order or [element.name for element in elements] != ["vertex", "face"]:
        raise _UnusualError
    vertex, face = elements
    if not face.rows or not vertex.rows < 2**32:
        raise _UnusualError
    vertices = np.dtype([(k, order + kind) for k, (length, kind) in _numbers(vertex)])
    start = at + vertex.rows * vertices.itemsize
    index, faces = _face(file, face, order, start)
    if start + face.rows * faces.itemsize != size:
        raise _UnusualError

    uv = next((names for names in ply.UV if set(names) <= vertex.properties.keys()), ())
    wanted: list[tuple[str, ...]] = [("x", "y", "z"), ("nx", "ny", "nz"), uv]
    columns: list[tuple[tuple[str, ...], Table]] = [
        (names, Table(vertex.rows, len(names), np.float64))
        for names in wanted
        if names and set(names) <= vertex.properties.keys()
    ]
    if not columns or columns[0][0] != wanted[0]:
        raise _UnusualError

    def place(first: int, last: int) -> list[tuple[float, float]]:
        rows = _rows(file, vertices, at, first, last)
        return [_put(rows, names, table.values[first:last]) for names, table in columns]

    found = in_chunks(place, vertex.rows, max(1, PIECE // vertices.itemsize))
    for (_, table), extremes in zip(columns, zip(*found, strict=True), strict=True):
        table.add(list(extremes))
    corners = faces[index].shape[0]
    triangles = Table(face.rows * (corners - 2), 3, np.uint32)

    def join(first: int, last: int) -> tuple[float, float]:
        rows = _rows(file, faces, start, first, last)
        if (rows[f"#{index}"] != corners).any():
            raise _UnusualError
        out = triangles.values[first * (corners - 2) : last * (corners - 2)]
        given = rows[index]
        low, high = int(given.min()), int(given.max())
        if low < 0 or high >= vertex.rows:
            raise _UnusualError
        out[:: corners - 2] = given[:, :3]
        if corners == 4:
            out[1::2] = given[:, [0, 2, 3]]
            out[:] = polygons.unfolded(columns[0][1].values, out, 2)
        return low, high

    triangles.add(in_chunks(join, face.rows, max(1, PIECE // faces.itemsize)))
    tables = dict(columns)
    return columns[0][1], triangles, tables.get(wanted[1]), tables.get(wanted[2])


def _numbers(element: ply.Element) -> list[tuple[str, tuple[str, str]]]:
    properties = list(element.properties.items())
    if any(length for _, (length, _) in properties):
        raise _UnusualError
    return properties


def _face(file: int, face: ply.Element, order: str, start: int) -> tuple[str, np.dtype[Any]]:
    """The name of the list of corners, and a row of faces that all have as many as the first."""
    lists = [name for name, (length, _) in face.properties.items() if length]
    if len(lists) != 1 or lists[0] not in ply.INDICES or face.properties[lists[0]][1][0] == "f":
        raise _UnusualError
    fields: list[Any] = []
    for name, (length, kind) in face.properties.items():
        if length:
            before = sum(np.dtype(field[1]).itemsize for field in fields)
            count = np.frombuffer(
                os.pread(file, np.dtype(length).itemsize, start + before), order + length
            )
            if count.tolist() not in ([3], [4]):
                raise _UnusualError
            fields.append((f"#{name}", order + length))
            fields.append((name, order + kind, (int(count[0]),)))
        else:
            fields.append((name, order + kind))
    return lists[0], np.dtype(fields)


def _rows(file: int, dtype: np.dtype[Any], start: int, first: int, last: int) -> Array:
    """Rows [first, last) of a table that begins at byte `start`."""
    wanted = (last - first) * dtype.itemsize
    data = os.pread(file, wanted, start + first * dtype.itemsize)
    if len(data) != wanted:
        raise _UnusualError
    return np.frombuffer(data, dtype)


def _put(rows: Array, names: tuple[str, ...], out: Array) -> tuple[float, float]:
    """Copies columns; returns their extremes, NaN if there is one."""
    for k, name in enumerate(names):
        out[:, k] = rows[name]
    out += 0.0  # no -0
    return float(out.min()), float(out.max())
