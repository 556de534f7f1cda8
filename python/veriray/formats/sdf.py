"""The surface of a grid of signed distances, as a mesh.

The grid spans [0, 1]^3; between its numbers the function is trilinear, and its surface is where
that is 0. Marching cubes cut it, on the grid or on one 2, 4 or 8 times finer: the coarsest whose
triangles are in their middles within NEAR of a cell of the surface, unless POINTS or TRIANGLES stop
it before. Corners lie on the surface but for rounding. The front is where the function is above 0.
"""

from __future__ import annotations

import warnings
from itertools import product
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

from ..errors import SceneError, SceneWarning
from ..extras import need
from . import volume_grid
from .mesh import Mesh, dot, unit
from .node import Node

Array = npt.NDArray[Any]
NEAR = 1e-2
POINTS, TRIANGLES = 1 << 24, 2_000_000


def surface(node: Node, values: dict[str, Any]) -> tuple[Mesh, str]:
    """The mesh of an sdfgrid, without triangles if the function is nowhere 0, and how near it is.
    Raises SceneError for a bad file or grid."""
    given = [name for name in ("filename", "grid") if values[name] is not None]
    if len(given) != 1:
        raise SceneError(
            f"{node}: {' and '.join(given) or 'no grid'} given; expected filename or grid",
            node.where,
        )
    where = node.values[given[0]].where
    if values["grid"] is not None:
        cells = volume_grid.from_array(values["grid"], where)
    else:
        cells, _ = volume_grid.read_vol(Path(node.folder) / values["filename"], where)
    if cells.shape[3] != 1 or min(cells.shape[:3]) < 2:
        z, y, x, channels = cells.shape
        raise SceneError(
            f"{node}: {x} x {y} x {z} cells of {channels} numbers; expected 2 cells a side or more "
            "of 1 number",
            where,
        )
    numbers = np.array(cells[..., 0], np.float64).T  # by x, y, z
    if not (numbers.min() < 0 < numbers.max()):
        warnings.warn(
            f"{where}: {node}: the function is nowhere 0: nothing is shown",
            SceneWarning,
            stacklevel=8,
        )
        nothing = np.zeros((0, 3))
        return Mesh(nothing, nothing.astype(np.int64), nothing), "no surface"
    best = _marched(numbers, 1)
    parts, error = 1, _error(numbers, *best)
    while error > NEAR and parts < 8 and 4 * len(best[1]) <= TRIANGLES:
        if np.prod([float(2 * parts * n) for n in numbers.shape]) > POINTS:
            break
        parts *= 2
        best = _marched(numbers, parts)
        error = _error(numbers, *best)
    points, faces = best
    if values["normals"] == "analytic":
        points, faces, normals = _analytic(numbers, points, faces)
    else:
        normals = _smooth(numbers, points)
    sizes = np.array(numbers.shape) - 1.0
    text = f"a mesh of {len(faces)} triangles, within {error:.1g} of a cell of the grid's surface"
    return Mesh(points / sizes, faces, normals, np.zeros((len(points), 2))), text


def _marched(numbers: Array, parts: int) -> tuple[Array, Array]:
    """Vertices (V, 3) in cells of the grid and triangles (T, 3), on a grid `parts` times finer."""
    need("a distance field (sdfgrid)", "formats", "skimage")
    from skimage.measure import marching_cubes  # slow to import, and rarely needed

    fine = numbers
    for axis, count in enumerate(numbers.shape):
        at = np.arange(parts * (count - 1) + 1)
        low = np.minimum(at // parts, count - 2)
        share = ((at - low * parts) / parts).reshape([-1 if k == axis else 1 for k in range(3)])
        fine = fine.take(low, axis) * (1.0 - share) + fine.take(low + 1, axis) * share
    largest = np.abs(numbers).max()
    found, faces, _, _ = marching_cubes(fine / largest, 0.0, gradient_direction="ascent")
    found = _on_edges(fine, found.astype(np.float64))
    faces = faces.astype(np.int64)
    same = [(found[faces[:, k]] == found[faces[:, k - 1]]).all(axis=1) for k in range(3)]
    return found / parts, faces[~(same[0] | same[1] | same[2])]


def _on_edges(fine: Array, found: Array) -> Array:
    """Vertices that are on an edge of the grid, where the function is linear: at its zero, with the
    same bits on every machine. Others, within cells, are rounded."""
    nearest = np.round(found)
    off = np.abs(found - nearest)
    result: Array = np.round(found * 4096.0) / 4096.0
    for axis in range(3):
        rest = np.delete(np.arange(3), axis)
        for shift in (0, -1, 1):
            low = nearest.astype(np.int64)
            low[:, axis] = np.floor(found[:, axis]).astype(np.int64) + shift
            high = low.copy()
            high[:, axis] += 1
            fits = (off[:, rest] < 1e-3).all(axis=1) & (off[:, rest].max(axis=1) <= off[:, axis])
            fits &= (low[:, axis] >= 0) & (high[:, axis] < fine.shape[axis])
            rows = np.flatnonzero(fits)
            a, b = fine[tuple(low[rows].T)], fine[tuple(high[rows].T)]
            crossed = (a != b) & (a * b <= 0)
            rows, a, b = rows[crossed], a[crossed], b[crossed]
            zero = low[rows, axis] + a / (a - b)
            kept = np.abs(zero - found[rows, axis]) < 1e-3
            result[rows[kept]] = nearest[rows[kept]]
            result[rows[kept], axis] = zero[kept]
    return result


def _function(numbers: Array, points: Array, cell: Array | None = None) -> Array:
    """The function at points (N, 3), clamped to the grid as a texture; cell: of that cell's."""
    last = np.array(numbers.shape) - 1
    points = np.clip(points, 0.0, last)
    low = np.minimum(np.floor(points).astype(np.int64), last - 1) if cell is None else cell
    share = points - low
    total = np.zeros(len(points))
    for corner in product((0, 1), repeat=3):
        weight = np.ones(len(points))
        for axis, high in enumerate(corner):
            weight = weight * (share[:, axis] if high else 1.0 - share[:, axis])
        total = total + weight * numbers[tuple((low + np.array(corner)).T)]
    return total


def _slopes(numbers: Array, points: Array, cell: Array) -> Array:
    """The derivatives (N, 3) of the function in cells at points, per length of the whole grid."""
    result = np.empty((len(points), 3))
    for axis, count in enumerate(numbers.shape):
        ends = []
        for shift in (0, 1):
            there = points.copy()
            there[:, axis] = cell[:, axis] + shift
            ends.append(_function(numbers, there, cell))
        result[:, axis] = (ends[1] - ends[0]) * (count - 1)
    return result


def _cells(numbers: Array, points: Array) -> Array:
    last = np.array(numbers.shape) - 2
    return np.clip(np.floor(points).astype(np.int64), 0, last)


def _error(numbers: Array, points: Array, faces: Array) -> float:
    """How far the middles of triangles are from the surface at most, in cells of the grid."""
    middle = (points[faces[:, 0]] + points[faces[:, 1]] + points[faces[:, 2]]) / 3.0
    cell = _cells(numbers, middle)
    slopes = _slopes(numbers, middle, cell) / (np.array(numbers.shape) - 1.0)
    steep = np.sqrt(dot(slopes, slopes))
    value = np.abs(_function(numbers, middle, cell))
    return float((value / np.where(steep > 0, steep, np.inf)).max(initial=0.0))


def _analytic(numbers: Array, points: Array, faces: Array) -> tuple[Array, Array, Array]:
    """The mesh with vertices of their own in each cell, and the gradient of the cell at them."""
    middle = (points[faces[:, 0]] + points[faces[:, 1]] + points[faces[:, 2]]) / 3.0
    cell = _cells(numbers, middle)
    flat = np.ravel_multi_index(tuple(cell.T), numbers.shape)
    pairs = np.stack([faces.ravel(), np.repeat(flat, 3)], axis=1)
    kept, inverse = np.unique(pairs, axis=0, return_inverse=True)
    cells = np.stack(np.unravel_index(kept[:, 1], numbers.shape), axis=1)
    points = points[kept[:, 0]]
    normals = unit(_slopes(numbers, points, cells))
    return points, inverse.reshape(-1, 3), normals


def _smooth(numbers: Array, points: Array) -> Array:
    """Normals after Hansson-Soederlund, Evans and Akenine-Moeller, "Ray Tracing of Signed Distance
    Function Grids", 2022, at the ends of the grid as in Mitsuba: the unit gradients of the eight
    cells around the nearest corner, continued to the point and weighted by its place among their
    middles."""
    corner = np.round(points)
    slopes = np.empty((2, len(points), 3))  # of the cells below and above the corner, along an axis
    for axis, count in enumerate(numbers.shape):
        ends = []
        for shift in (-1, 0, 1):
            there = points.copy()
            there[:, axis] = corner[:, axis] + shift
            ends.append(_function(numbers, there))
        for side in (0, 1):
            slopes[side, :, axis] = (ends[side + 1] - ends[side]) * (count - 1)
    share = np.where(corner == 0, 1.0, points - corner + 0.5)
    total = np.zeros((len(points), 3))
    for sides in product((0, 1), repeat=3):
        gradient = np.stack([slopes[side, :, axis] for axis, side in enumerate(sides)], axis=1)
        weight = np.ones(len(points))
        for axis, high in enumerate(sides):
            weight = weight * (share[:, axis] if high else 1.0 - share[:, axis])
        total += weight[:, None] * unit(gradient)
    return unit(total)
