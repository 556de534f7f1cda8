"""Meshes that the gallery makes itself: closed, with vertex normals, the same on every machine.

Coordinates use only + - * /, sqrt and sines of 50 digits, and are rounded to float32.
"""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

from ..errors import SceneError
from ..extras import need
from ..files import replacing
from ..numeric import sin_cos_degrees
from .own import MARK

Array = npt.NDArray[Any]
Mesh = tuple[Array, Array, Array]  # vertices (V, 3), normals (V, 3), triangles (T, 3)


def write_ply(path: Path, mesh: Mesh) -> None:
    """Writes a binary PLY with vertex normals; the file appears whole or not at all."""
    vertices, normals, triangles = mesh
    names = "x y z nx ny nz".split()
    header = ["ply", "format binary_little_endian 1.0", f"comment {MARK}"]
    header += [f"element vertex {len(vertices)}"]
    header += [f"property float {name}" for name in names]
    header += [f"element face {len(triangles)}", "property list uchar int vertex_indices"]
    faces = np.empty(len(triangles), dtype=[("n", "u1"), ("v", "<i4", 3)])
    faces["n"], faces["v"] = 3, triangles
    with replacing(path) as file:
        file.write("\n".join([*header, "end_header\n"]).encode())
        file.write(np.hstack([vertices, normals]).astype("<f4").tobytes())
        file.write(faces.tobytes())


def standing(path: Path, height: float = 2.25) -> Mesh:
    """A user's mesh file, y up and facing +z, turned to face -z and placed on the plane y = 0.

    Raises SceneError if it cannot be read or is not closed: a medium needs an inside.
    """
    need("a mesh of your own in the gallery", "formats", "trimesh")
    import trimesh

    if not path.is_file():
        raise SceneError(f"{path} is not a file")
    try:
        loaded: Any = trimesh.load(path, force="mesh", process=True)
    except Exception as error:  # trimesh raises whatever its parsers stumble over
        raise SceneError(f"{path} cannot be read as a mesh ({type(error).__name__})") from None
    if not len(loaded.faces) or not loaded.is_watertight:
        raise SceneError(f"{path} is not a closed mesh ({len(loaded.faces)} triangles)")
    if loaded.volume < 0:
        loaded.invert()
    low, high = loaded.bounds
    middle = np.array([(low[0] + high[0]) / 2, low[1], (low[2] + high[2]) / 2])
    turned = np.array([-1.0, 1.0, -1.0])
    vertices = (np.asarray(loaded.vertices) - middle) * turned * (height / (high[1] - low[1]))
    return vertices, np.asarray(loaded.vertex_normals) * turned, np.asarray(loaded.faces)


# ---- the hare: spheres, ellipsoids and cones, blended ----

# Each part: blend radius, ends (x, y, z, radius), and for the second the bulge of the middle.
# All are mirrored in x.
_HARE: tuple[tuple[float, tuple[float, ...], tuple[float, ...]], ...] = (
    (0.00, (0.0, 0.62, 0.16, 0.50), (0.0, 0.60, 0.02, 0.47)),  # hips
    (0.30, (0.0, 0.98, -0.06, 0.35), (0.0, 0.80, 0.00, 0.38)),  # chest
    (0.14, (0.0, 0.30, -0.06, 0.24), (0.0, 0.20, 0.20, 0.24)),  # belly
    (0.16, (0.0, 1.42, -0.19, 0.29), (0.0, 1.37, -0.33, 0.25)),  # head
    (0.10, (0.0, 1.31, -0.47, 0.135), (0.0, 1.30, -0.53, 0.10)),  # muzzle
    (0.08, (0.15, 1.31, -0.34, 0.15), (0.12, 1.29, -0.42, 0.11)),  # cheeks
    (0.10, (0.11, 1.58, -0.12, 0.060), (0.275, 2.23, 0.17, 0.052, 0.055)),  # ears
    (0.14, (0.30, 0.42, -0.02, 0.30), (0.33, 0.30, 0.08, 0.26)),  # thighs
    (0.10, (0.36, 0.115, -0.40, 0.105), (0.35, 0.12, 0.02, 0.12)),  # hind feet
    (0.10, (0.17, 0.78, -0.28, 0.13), (0.16, 0.16, -0.42, 0.085)),  # forelegs
    (0.06, (0.16, 0.095, -0.46, 0.09), (0.155, 0.09, -0.54, 0.075)),  # paws
    (0.06, (0.0, 0.42, 0.70, 0.16), (0.0, 0.46, 0.74, 0.15)),  # tail
    (0.02, (0.175, 1.475, -0.455, 0.05), (0.17, 1.475, -0.45, 0.05)),  # eyes
    (0.03, (0.0, 1.37, -0.625, 0.03), (0.01, 1.37, -0.625, 0.03)),  # nose
)
_SUNK = 0.05  # how far the parts reach below the ground, where the hare is cut flat
_LOW, _HIGH = np.array([-0.75, -0.05, -0.75]), np.array([0.75, 2.45, 1.0])


def _cone(points: Array, a: Array, b: Array, bulge: float = 0.0) -> Array:
    """Distance to the spheres swept from a to b (x, y, z, radius), up to the surface's slant."""
    along = b[:3] - a[:3]
    length = float(along[0] * along[0] + along[1] * along[1] + along[2] * along[2])
    d = [points[..., k] - a[k] for k in range(3)]
    t = (d[0] * along[0] + d[1] * along[1] + d[2] * along[2]) / length
    t = np.minimum(np.maximum(t, 0.0), 1.0)
    d = [d[k] - along[k] * t for k in range(3)]
    radius = a[3] + (b[3] - a[3]) * t + bulge * 4 * t * (1 - t)
    distance: Array = np.sqrt(d[0] * d[0] + d[1] * d[1] + d[2] * d[2]) - radius
    return distance


def hare_distance(points: Array) -> Array:
    """A field on points (..., 3) whose zero set is the hare, negative inside.

    Parts are joined by the polynomial smooth minimum (I. Quilez, "Smooth minimum", 2013), which
    needs no function beyond + - * / and sqrt; the field is continuously differentiable.
    """
    mirrored = points + np.array([0.0, _SUNK, 0.0])
    mirrored[..., 0] = np.abs(mirrored[..., 0])
    field: Array | None = None
    for blend, start, end in _HARE:
        part = _cone(mirrored, np.array(start), np.array(end[:4]), *end[4:])
        if field is None:
            field = part
            continue
        overlap = np.maximum(blend - np.abs(field - part), 0.0) / blend
        field = np.minimum(field, part) - overlap * overlap * (blend / 4)
    assert field is not None
    # a rounded edge towards the flat underside at y = 0
    under = -points[..., 1]
    overlap = np.maximum(0.06 - np.abs(field - under), 0.0) / 0.06
    field = np.maximum(field, under) + overlap * overlap * (0.06 / 4)
    return field


def _gradient(f: Callable[[Array], Array], points: Array, step: float = 2.0**-12) -> Array:
    columns = []
    for axis in range(3):
        offset = np.zeros(3)
        offset[axis] = step
        columns.append((f(points + offset) - f(points - offset)) / (2 * step))
    return np.stack(columns, axis=-1)


def _unit(vectors: Array) -> Array:
    x, y, z = vectors[..., 0], vectors[..., 1], vectors[..., 2]
    length: Array = np.sqrt(x * x + y * y + z * z)
    unit: Array = vectors / length[..., None]
    return unit


def hare(cells: int = 60) -> Mesh:
    """The gallery's animal, 2.3 high, facing -z: about 73,000 triangles at 60 cells per unit."""
    return contour(hare_distance, _LOW, _HIGH, cells)


def contour(field: Callable[[Array], Array], low: Array, high: Array, cells: int) -> Mesh:
    """The zero set of a smooth field in a box, as a closed mesh of even triangles.

    A vertex in each cell that the surface crosses, first at the mean of the crossings on the cell's
    edges (S. Gibson, "Constrained elastic surface nets", 1998), then moved onto the surface by
    Newton's method; two triangles around each crossed edge. The box must hold the whole surface.
    Normals are the field's gradients.
    """
    counts = np.round((high - low) * cells).astype(int) + 1
    axes = [low[k] + np.arange(counts[k]) / cells for k in range(3)]
    grid = np.stack(np.meshgrid(*axes, indexing="ij"), axis=-1)
    values = np.concatenate([field(slab) for slab in np.array_split(grid, 32)])
    inside = values < 0
    total = np.zeros((*(counts - 1), 3))
    number = np.zeros(counts - 1)
    quads = []
    for axis in range(3):
        i, j, k = np.nonzero(np.diff(inside, axis=axis))
        start = np.stack([i, j, k], axis=1)
        end = start + np.eye(3, dtype=int)[axis]
        at_start, at_end = values[tuple(start.T)], values[tuple(end.T)]
        crossing = start.astype(np.float64)
        crossing[:, axis] += at_start / (at_start - at_end)
        ring = []  # the four cells around the edge, counter-clockwise seen from its end
        b, c = np.eye(3, dtype=int)[(axis + 1) % 3], np.eye(3, dtype=int)[(axis + 2) % 3]
        for shift in (-b - c, -c, 0 * b, -b):
            cell = tuple((start + shift).T)
            np.add.at(total, cell, crossing)
            np.add.at(number, cell, 1)
            ring.append(np.ravel_multi_index(cell, number.shape))
        quad = np.stack(ring, axis=1)
        quads.append(np.where((at_start < 0)[:, None], quad, quad[:, ::-1]))
    used = number.ravel() > 0
    index = np.cumsum(used) - 1
    points = (total.reshape(-1, 3)[used] / number.ravel()[used, None]) / cells + low
    for _ in range(3):
        slope = _gradient(field, points)
        squared = (slope[:, 0] ** 2 + slope[:, 1] ** 2 + slope[:, 2] ** 2)[:, None]
        points = points - slope * (field(points)[:, None] / squared)
    quad = index[np.concatenate(quads)]
    triangles = np.concatenate([quad[:, [0, 1, 2]], quad[:, [0, 2, 3]]])
    return points, _unit(_gradient(field, points)), triangles.astype(np.int32)


# ---- curves and sheets ----


def _grid_triangles(rows: int, columns: int, closed: bool) -> Array:
    """Triangles of a grid of rows x columns vertices; joined at both ends if closed."""
    i = np.arange(rows if closed else rows - 1)[:, None]
    j = np.arange(columns if closed else columns - 1)[None, :]
    a, b = i * columns + j, i * columns + (j + 1) % columns
    c, d = (i + 1) % rows * columns + j, (i + 1) % rows * columns + (j + 1) % columns
    faces: Array = np.stack([np.stack([a, b, d], -1), np.stack([a, d, c], -1)], axis=2)
    return faces.reshape(-1, 3).astype(np.int32)


def _circle(count: int, turns: int = 1) -> Array:
    """(count, 2): cosines and sines of `count` equally spaced angles over `turns` turns."""
    pairs = [sin_cos_degrees(360.0 * turns * k / count) for k in range(count)]
    return np.array([(c, s) for s, c in pairs])


def knot(turns: int = 2, around: int = 3, length: int = 720, section: int = 36) -> Mesh:
    """A torus knot of radius 1 about the z axis with a rounded square section that twists.

    Closed by construction: 2 * length * section triangles. The vertex normals are the means of the
    faces around a vertex, weighted by area.
    """
    ring, coil = _circle(length, turns), _circle(length, around)
    inner, outer = 0.30, 0.68
    radius = outer + inner * coil[:, 0]
    centre = np.stack([radius * ring[:, 0], radius * ring[:, 1], inner * coil[:, 1]], axis=1)
    tangent = _unit(np.roll(centre, -1, axis=0) - np.roll(centre, 1, axis=0))
    away = np.stack([coil[:, 0] * ring[:, 0], coil[:, 0] * ring[:, 1], coil[:, 1]], axis=1)
    along = (away * tangent).sum(axis=1)[:, None]
    first = _unit(away - tangent * along)
    second = np.cross(tangent, first)
    twist = _circle(length, 2)
    u = first * twist[:, :1] + second * twist[:, 1:]
    v = second * twist[:, :1] - first * twist[:, 1:]
    c = _circle(section)
    fourth = np.sqrt(np.sqrt(c[:, 0] ** 4 + c[:, 1] ** 4))  # radius of the rounded square
    profile = 0.17 * c / fourth[:, None]
    points = centre[:, None] + u[:, None] * profile[:, :1] + v[:, None] * profile[:, 1:]
    vertices = points.reshape(-1, 3)
    triangles = _grid_triangles(length, section, closed=True)
    corners = vertices[triangles]
    volume = (corners[:, 0] * np.cross(corners[:, 1], corners[:, 2])).sum()
    if volume < 0:
        triangles = triangles[:, ::-1]
        corners = vertices[triangles]
    face = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    normals = np.zeros_like(vertices)
    for corner in range(3):
        np.add.at(normals, triangles[:, corner], face)
    return vertices, _unit(normals), triangles


def sweep(width: float = 60.0, floor: float = 14.0, wall: float = 14.0, bend: float = 5.0) -> Mesh:
    """A photographer's backdrop: the floor y = 0 curves into the wall z = bend by a quarter circle.

    It extends from z = -floor to the wall and up to y = bend + wall; its front faces +y on the
    floor and -z on the wall.
    """
    steps = 96
    quarter = [sin_cos_degrees(90.0 * k / steps) for k in range(steps + 1)]
    path = [(-floor, 0.0, 0.0, 1.0)]
    path += [(bend * s, bend * (1 - c), -s, c) for s, c in quarter]
    path += [(bend, bend + wall, -1.0, 0.0)]
    rows = np.array(path)
    vertices = np.zeros((len(rows), 2, 3))
    vertices[:, 0, 0], vertices[:, 1, 0] = -width / 2, width / 2
    vertices[:, :, 1], vertices[:, :, 2] = rows[:, 1:2], rows[:, 0:1]
    normals = np.zeros_like(vertices)
    normals[:, :, 1], normals[:, :, 2] = rows[:, 3:4], rows[:, 2:3]
    triangles = _grid_triangles(len(rows), 2, closed=False)[:, ::-1]
    return vertices.reshape(-1, 3), normals.reshape(-1, 3), triangles


def tiles(odd: bool, columns: int = 12, rows: int = 14, gap: float = 0.006) -> Mesh:
    """Every other square of a chessboard on y = 0, each 1 x 1 less a gap, centred at the origin."""
    corners: list[tuple[float, float]] = []
    faces: list[tuple[int, int, int]] = []
    for i in range(rows):
        for j in range(columns):
            if (i + j) % 2 == int(odd):
                x, z, n = j - columns / 2, i - rows / 2, len(corners)
                low, high = gap, 1 - gap
                corners += [(x + low, z + low), (x + high, z + low)]
                corners += [(x + high, z + high), (x + low, z + high)]
                faces += [(n, n + 2, n + 1), (n, n + 3, n + 2)]
    plane = np.array(corners)
    vertices = np.stack([plane[:, 0], np.zeros(len(plane)), plane[:, 1]], axis=1)
    return vertices, np.tile([0.0, 1.0, 0.0], (len(vertices), 1)), np.array(faces, np.int32)


#: Generated meshes by the name that scene files use.
MAKERS: dict[str, Callable[[], Mesh]] = {
    "hare": hare,
    "knot": knot,
    "sweep": sweep,
    "tiles_dark": lambda: tiles(True),
    "tiles_light": lambda: tiles(False),
}
