"""Mitsuba's grids of numbers in space: .vol files of version 3, and arrays.

A file has a header of 48 bytes: "VOL", the version, the encoding (1: float32), the sizes along x, y
and z, the numbers a cell (channels), and two opposite corners of a box; then the cells, x first.
"""

from __future__ import annotations

import os
import struct
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

from ..errors import SceneError
from ..files import open_regular
from .node import NOT_FETCHED, POINTER, shorten

Array = npt.NDArray[Any]
MAX_SIDE = 1 << 15
MAX_NUMBERS = 1 << 28
_HEADER = struct.Struct("<3sB5i6f")


def read_vol(path: str | Path, where: str = "") -> tuple[Array, Array]:
    """A .vol file: cells (Z, Y, X, channels) float32 and the box (2, 3) float32, its lower corner
    first. What follows the cells is not read, as in Mitsuba.

    Raises SceneError for a file that is missing or damaged, of another version or encoding, too
    large, or that holds numbers that are not finite; `where` is the place that names it.
    """
    name = shorten(path)
    try:
        with open_regular(path) as file:
            size = os.fstat(file.fileno()).st_size
            shape, box = _header(file.read(_HEADER.size))
            need = 4 * shape[0] * shape[1] * shape[2] * shape[3]
            if size < _HEADER.size + need:
                z, y, x, channels = shape
                raise SceneError(
                    f"holds {size} bytes; {x} x {y} x {z} cells of {channels} numbers take "
                    f"{_HEADER.size + need}"
                )
            cells: Array = np.frombuffer(file.read(need), "<f4").reshape(shape)
    except SceneError as error:
        raise SceneError(f"{name}: {error}", where) from None
    except OSError as error:
        raise SceneError(f"cannot read {name}: {error.strerror or error}", where) from None
    except ValueError as error:  # a name with a null character, a file that shrinks
        raise SceneError(f"cannot read {name}: {error}", where) from None
    return _finite(cells.astype(np.float32), name, where), box


def from_array(values: object, where: str) -> Array:
    """The cells (Z, Y, X, channels) float32 of an array (Z, Y, X) or (Z, Y, X, channels).
    Raises SceneError."""
    cells = np.asarray(values)
    cells = cells[..., None] if cells.ndim == 3 else cells
    if cells.ndim != 4 or cells.dtype.kind not in "uif":
        raise SceneError(
            f"a grid of shape {cells.shape} and type {cells.dtype}; expected numbers (Z, Y, X) or "
            "(Z, Y, X, channels)",
            where,
        )
    z, y, x, channels = cells.shape
    try:
        _check_size(x, y, z, channels)
    except SceneError as error:
        raise SceneError(f"the grid: {error}", where) from None
    with np.errstate(over="ignore"):
        return _finite(np.array(cells, np.float32), "the grid", where)


def _header(data: bytes) -> tuple[tuple[int, int, int, int], Array]:
    if data.startswith(POINTER):
        raise SceneError(NOT_FETCHED)
    if len(data) < _HEADER.size or not data.startswith(b"VOL"):
        raise SceneError(
            f'is not a .vol file: it has no header of {_HEADER.size} bytes that begins with "VOL"'
        )
    _, version, encoding, x, y, z, channels, *corners = _HEADER.unpack(data)
    if (version, encoding) != (3, 1):
        raise SceneError(
            f"is a .vol file of version {version} and encoding {encoding}; expected 3 and 1 "
            "(float32)"
        )
    _check_size(x, y, z, channels)
    box = np.array(corners, np.float32).reshape(2, 3)
    if not np.isfinite(box).all():
        raise SceneError(f"its box {box.tolist()} must be finite")
    return (z, y, x, channels), box


def _check_size(x: int, y: int, z: int, channels: int) -> None:
    sides = all(1 <= side <= MAX_SIDE for side in (x, y, z))
    if not (sides and 1 <= channels <= 16 and x * y * z * channels <= MAX_NUMBERS):
        raise SceneError(
            f"{x} x {y} x {z} cells of {channels} numbers; expected 1 to {MAX_SIDE} cells a side, "
            f"1 to 16 numbers a cell and {MAX_NUMBERS} numbers at most"
        )


def _finite(cells: Array, name: str, where: str) -> Array:
    bad = ~np.isfinite(cells)
    if bad.any():
        z, y, x, k = (int(i) for i in np.argwhere(bad)[0])
        raise SceneError(
            f"{name}: number {k} of cell (x {x}, y {y}, z {z}) is {cells[z, y, x, k]}; it must be "
            "finite",
            where,
        )
    cells.setflags(write=False)
    return cells
