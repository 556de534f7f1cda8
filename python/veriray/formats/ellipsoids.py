"""Ellipsoids, as those that 3D Gaussians have: `ellipsoids` and `ellipsoidsmesh` of Mitsuba.

Each is the image of a unit sphere by its scales times an extent, a turn and a place; of
`ellipsoidsmesh` that of a shell about the sphere, flat. `ellipsoids` are icospheres with their
corners on them and smooth normals, of the first of LEVELS whose triangles are no more than FEW: an
ellipsoid is thinner by up to DEPTHS of its radius in the middle of a face. Mitsuba's are not hit
from within: these are.

A PLY file is one of Gaussians: x, y, z, the logarithms scale_0 to scale_2, the quaternion rot_0
(its real part) to rot_3 of any length, and opacity, whose logistic is the opacity; what else it
holds is colour, which a bsdf does not show. Arrays hold the numbers themselves, quaternions with
the real part last. Exponentials are rounded to float32, which hides how a machine computes them.
"""

from __future__ import annotations

from functools import lru_cache
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

from ..errors import SceneError
from ..numeric import MAX_COORDINATE, sin_cos_degrees
from ..transform import turned
from . import ply
from .mesh import MAX_BYTES, Mesh, unit
from .node import Node, read_bytes, shorten

Array = npt.NDArray[Any]
KINDS = ("ellipsoids", "ellipsoidsmesh")
#: Arrays of a dictionary.
ARRAYS = ("centers", "scales", "quaternions", "data", "opacities", "sh_coeffs")
LEVELS = (6, 5, 4, 3, 2)
#: By level, what a face is inside of the sphere that its corners are on.
DEPTHS = {6: 7.2e-5, 5: 2.9e-4, 4: 1.2e-3, 3: 4.6e-3, 2: 1.8e-2}
FEW, MANY = 2_000_000, 50_000_000  # triangles of a shape: for more, coarser ones; an error
_LEAST_OPACITY = 0.01  # that adaptive clamping shows
_OFF = 1e-3  # of a quaternion's length
_COLUMNS = {
    "center": ("x", "y", "z"),
    "scale": ("scale_0", "scale_1", "scale_2"),
    "turn": ("rot_1", "rot_2", "rot_3", "rot_0"),
}


def surface(node: Node, values: dict[str, Any]) -> tuple[Mesh, str]:
    """The mesh, and a note on it, or ""; values: the checked parameters. Raises SceneError."""
    centers, scales, turns, opacities = _given(node, values)
    if values["scale_factor"] != 1 and values["filename"] is None:
        raise SceneError(
            f"{node}: scale_factor is of files alone", node.values["scale_factor"].where
        )
    scales = scales * values["scale_factor"]
    _check(node, centers, scales, turns)
    count, extents, gone = len(centers), np.full(len(centers), values["extent"]), 0
    if values["extent_adaptive_clamping"]:
        if opacities is None:
            where = node.values["extent_adaptive_clamping"].where
            raise SceneError(f"{node}: extent_adaptive_clamping without opacities", where)
        shown = opacities > _LEAST_OPACITY
        gone = int(count - np.count_nonzero(shown))
        with np.errstate(all="ignore"):
            extents = np.sqrt(2 * np.log(opacities / _LEAST_OPACITY)).astype(np.float32)
        centers, scales, turns, extents = (x[shown] for x in (centers, scales, turns, extents))
    level = None
    if node.plugin == "ellipsoids":
        level = next((n for n in LEVELS if 20 * 4**n * len(centers) <= FEW), LEVELS[-1])
    points, faces = shell(values["shell"]) if level is None else icosphere(level)
    triangles = len(faces) * len(centers)
    if triangles > MANY:
        text = f"{node}: {len(centers)} ellipsoids are {triangles} triangles; at most {MANY}"
        raise SceneError(text, node.where)
    mesh = _placed(centers, scales * extents[:, None], turns, points, faces, level is not None)
    note = f"{gone} of {count} ellipsoids are left out, by their opacity" if gone else ""
    if level is not None and len(centers):
        plural = "s" * (len(centers) != 1)
        text = f"{len(centers)} ellipsoid{plural} rendered as meshes of {len(faces)} triangles, "
        text += (
            f"{triangles} in all, up to {100 * DEPTHS[level]:.2g} % of the radius inside of them"
        )
        note = f"{text}; {note}" if note else text
    return mesh, note


def uneven(matrix: Array) -> bool:
    """Whether a to_world scales or shears ellipsoids unevenly: they are moved as all shapes are,
    while Mitsuba keeps their form and takes the mean of the scales."""
    linear = matrix[:3, :3]
    products = linear.T @ linear
    square = float(np.trace(products)) / 3
    return bool(np.abs(products - square * np.eye(3)).max() > 2e-3 * square)


def _given(node: Node, values: dict[str, Any]) -> tuple[Array, Array, Array, Array | None]:
    """Centres (N, 3), scales (N, 3), quaternions (N, 4) with the real part last, and opacities (N,)
    if there are any, float64."""
    sources = [name for name in ("filename", "data", "centers") if values[name] is not None]
    if len(sources) != 1:
        raise SceneError(
            f"{node}: {' and '.join(sources) or 'no ellipsoids'} given; expected one of filename, "
            "data and centers",
            node.where,
        )
    if sources[0] == "filename":
        return _file(Path(node.folder) / values["filename"], node.values["filename"].where)
    if sources[0] == "data":
        rows = _array(node, "data", values["data"], 10, flat=True)
        found = [rows[:, :3], rows[:, 3:6], rows[:, 6:]]
    else:
        found = []
        for name, width in (("centers", 3), ("scales", 3), ("quaternions", 4)):
            if values[name] is None:
                raise SceneError(f'{node}: "{name}" is missing', node.where)
            found.append(_array(node, name, values[name], width))
        if len({len(one) for one in found}) > 1:
            sizes = ", ".join(str(len(one)) for one in found)
            raise SceneError(
                f"{node}: {sizes} rows of centers, scales and quaternions; expected one number",
                node.where,
            )
    opacities = None
    if values["opacities"] is not None:
        opacities = _array(node, "opacities", values["opacities"], 1)[:, 0]
        where = node.values["opacities"].where
        if len(opacities) != len(found[0]):
            text = f"{len(opacities)} opacities of {len(found[0])} ellipsoids"
            raise SceneError(f"{node}: {text}", where)
        _check_opacities(str(node), opacities, where)
    off = np.abs(np.sqrt((found[2] * found[2]).sum(axis=1)) - 1) > _OFF
    if off.any():
        k = int(np.argmax(off))
        raise SceneError(
            f"{node}: quaternion {k}, {found[2][k].tolist()}, is not of length 1",
            node.values[sources[0] if sources[0] == "data" else "quaternions"].where,
        )
    return found[0], found[1], found[2], opacities


def _array(node: Node, name: str, given: Any, width: int, flat: bool = False) -> Array:
    values = np.asarray(given)
    if flat and values.ndim == 1 and len(values) % width == 0:
        values = values.reshape(-1, width)
    if values.ndim != 2 or values.shape[1] != width or values.dtype.kind not in "uif":
        raise SceneError(
            f'{node}: "{name}" is of shape {values.shape} and type {values.dtype}; expected '
            f"numbers (N, {width})",
            node.values[name].where,
        )
    return values.astype(np.float64)


def _file(path: Path, where: str) -> tuple[Array, Array, Array, Array | None]:
    name = shorten(str(path))
    data = read_bytes(path, MAX_BYTES, where)
    try:
        vertex = ply.elements(data).get("vertex", {})
    except ply.MeshFileError as error:
        raise SceneError(f"{name}{error}", where) from None
    wanted = [column for columns in _COLUMNS.values() for column in columns]
    missing = [
        column
        for column in wanted
        if not (isinstance(vertex.get(column), np.ndarray) and vertex[column].ndim == 1)
    ]
    if missing:
        text = f"{name} holds no Gaussians: its vertices have no {', '.join(missing)}"
        raise SceneError(text, where)
    centers, logs, turns = (
        np.stack([vertex[column] for column in columns], axis=1).astype(np.float64)
        for columns in _COLUMNS.values()
    )
    with np.errstate(all="ignore"):
        scales = np.exp(logs).astype(np.float32).astype(np.float64)
        opacities = None
        if "opacity" in vertex:
            logits = np.asarray(vertex["opacity"], np.float64)
            opacities = (1 / (1 + np.exp(-logits))).astype(np.float32).astype(np.float64)
    if opacities is not None:
        _check_opacities(name, opacities, where)
    return centers, scales, turns, opacities


def _check_opacities(label: str, opacities: Array, where: str) -> None:
    good = np.isfinite(opacities) & (opacities >= 0)
    if not good.all():
        k = int(np.argmin(good))
        raise SceneError(
            f"{label}: opacity {k} is {opacities[k]:g}; expected a finite number of at least 0",
            where,
        )


def _check(node: Node, centers: Array, scales: Array, turns: Array) -> None:
    with np.errstate(all="ignore"):
        good = (np.abs(centers) <= MAX_COORDINATE).all(axis=1)
        good &= ((scales > 0) & (scales <= MAX_COORDINATE)).all(axis=1)
        good &= np.isfinite(turns).all(axis=1) & (turns != 0).any(axis=1)
    if not good.all():
        k = int(np.argmin(good))
        raise SceneError(
            f"{node}: ellipsoid {k} has the center {centers[k].tolist()}, scales "
            f"{scales[k].tolist()} and quaternion {turns[k].tolist()}; expected finite numbers, "
            "scales above 0, and a quaternion that is not 0",
            node.where,
        )
    if not len(centers):
        raise SceneError(f"{node} holds no ellipsoids", node.where)


def _placed(
    centers: Array, scales: Array, turns: Array, points: Array, faces: Array, smooth: bool
) -> Mesh:
    """The images of one mesh."""
    rotations = turned(*(turns / np.sqrt((turns * turns).sum(axis=1))[:, None]).T)
    count, many = len(centers), len(points)
    vertices = np.empty((count, many, 3))
    vertices[:] = centers[:, None]
    normals = np.zeros((count, many, 3)) if smooth else None
    for k in range(3):
        axis = rotations[:, k].T[:, None]
        vertices += scales[:, k, None, None] * axis * points[:, k, None]
        if normals is not None:
            # n ~ R (u / s), by the least scale so that nothing overflows
            share = scales.min(axis=1) / scales[:, k]
            normals += share[:, None, None] * axis * points[:, k, None]
    first = many * np.arange(count)[:, None, None]
    triangles = (faces + first).reshape(-1, 3)
    if normals is None:
        return Mesh(vertices.reshape(-1, 3), triangles, None)
    flat = vertices.reshape(-1, 3)
    return Mesh(flat, triangles, unit(normals.reshape(-1, 3)), np.zeros((len(flat), 2)))


# ---- what is about the unit sphere ----


def _turn(degrees: float) -> tuple[float, float]:
    """Cosine and sine."""
    sine, cosine = sin_cos_degrees(degrees)
    return cosine, sine


def _rings(radius: float, rings: list[tuple[float, float, float]], columns: int) -> Array:
    """A pole at -y, rings of (height, radius, first azimuth from +x to +z) and a pole at +y."""
    points = [[0.0, -radius, 0.0]]
    for height, across, start in rings:
        for k in range(columns):
            cosine, sine = _turn(start + 360.0 * k / columns)
            points.append([across * cosine, height, across * sine])
    return np.array([*points, [0.0, radius, 0.0]])


def _banded(rows: int, columns: int) -> Array:
    """Faces of rings one over the other, fronts outside."""
    k = np.arange(columns)
    after, top = (k + 1) % columns, 1 + rows * columns
    faces = [np.stack([0 * k, 1 + k, 1 + after], axis=1)]
    for row in range(rows - 1):
        low, high = 1 + row * columns, 1 + (row + 1) * columns
        faces.append(np.stack([low + k, high + k, low + after], axis=1))
        faces.append(np.stack([low + after, high + k, high + after], axis=1))
    high = 1 + (rows - 1) * columns
    faces.append(np.stack([high + k, 0 * k + top, high + after], axis=1))
    return np.concatenate(faces)


@lru_cache(maxsize=3)
def shell(name: str) -> tuple[Array, Array]:
    """Points (V, 3) and faces (T, 3) of Mitsuba's shells: an icosahedron about the sphere, a box
    and 72 faces in rows that it is partly within."""
    if name == "box":
        half = 3 / 11**0.5
        corners = np.array([[x, y, z] for x in (-1, 1) for y in (-1, 1) for z in (-1, 1)]) * half
        quads = [(0, 1, 3, 2), (4, 6, 7, 5), (0, 4, 5, 1), (2, 3, 7, 6), (0, 2, 6, 4), (1, 5, 7, 3)]
        faces = [[q[0], q[k], q[k + 1]] for q in quads for k in (1, 2)]
        return corners, np.array(faces)
    if name == "ico_sphere":
        return _icosahedron(1.2584085722)
    radius = 1.103598
    rings = [
        (radius * _turn(angle)[0], radius * _turn(angle)[1], -90.0)
        for angle in (144.0, 108.0, 72.0, 36.0)
    ]
    return _rings(radius, rings, 9), _banded(4, 9)


def _icosahedron(radius: float) -> tuple[Array, Array]:
    """Its upper ring is half a step ahead of the lower one."""
    height = radius / 5**0.5
    rings = [(-height, 2 * height, 36.0), (height, 2 * height, 72.0)]
    return _rings(radius, rings, 5), _banded(2, 5)


@lru_cache(maxsize=len(LEVELS))
def icosphere(level: int) -> tuple[Array, Array]:
    """Points (V, 3) on the unit sphere and faces (T, 3), 20 * 4^level, fronts outside."""
    points, faces = _icosahedron(1.0)
    points = unit(points)
    for _ in range(level):
        edges = np.sort(faces[:, [0, 1, 1, 2, 2, 0]].reshape(-1, 2), axis=1)
        ends, middle = np.unique(edges, axis=0, return_inverse=True)
        a, b, c = faces.T
        ab, bc, ca = len(points) + middle.reshape(-1, 3).T
        points = np.concatenate([points, unit(points[ends[:, 0]] + points[ends[:, 1]])])
        faces = np.concatenate([
            np.stack(corners, axis=1)
            for corners in ((a, ab, ca), (ab, b, bc), (ca, bc, c), (ab, bc, ca))
        ])  # fmt: skip
    return points, faces
