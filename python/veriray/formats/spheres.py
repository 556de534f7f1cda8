"""Spheres of a scene file, in world space."""

from __future__ import annotations

import math
from functools import lru_cache
from typing import Any

import numpy as np
import numpy.typing as npt

from .. import transform
from ..errors import SceneError
from ..numeric import MAX_COORDINATE, sin_cos_degrees
from .mesh import Mesh
from .node import Node

Array = npt.NDArray[Any]
#: Node, to_world, (x, y, z, radius), flipped.
Ball = tuple[Node, Array, tuple[float, ...], bool]
_EVEN = 2e-3  # of the square of a scale
_SIDES = 256
TRIANGLES = _SIDES * (_SIDES - 2)


def evened(given: list[Ball], instanced: set[int], warned: list[tuple[str, str]]) -> list[Ball]:
    """Spheres of which none is scaled unevenly but those that instances show, by their numbers.

    Such a sphere has the scale that it has in Mitsuba, that of x. warned: takes texts and places.
    """
    if not given:
        return given
    rows = np.array([matrix for _, matrix, _, _ in given])[:, :3, :3]
    with np.errstate(all="ignore"):
        products = (rows[:, :, None, :] * rows[:, None, :, :]).sum(axis=3)
        square = products[:, 0, 0]
        off = np.abs(products - square[:, None, None] * np.eye(3)).max(axis=(1, 2))
        uneven = np.flatnonzero(~(off <= _EVEN * square) & np.isfinite(off))
    if not len(uneven):
        return given
    result = list(given)
    for k in sorted(set(uneven.tolist()) - instanced):
        node, matrix, ball, flipped = given[k]
        result[k] = node, even(node, matrix, ball, warned), ball, flipped
    return result


def even(
    node: Node, matrix: Array, ball: tuple[float, ...], warned: list[tuple[str, str]]
) -> Array:
    """The matrix of a sphere that it scales unevenly, with the scale of x; a flat one as it is."""
    axes = _axes(matrix)
    if axes is None:
        return matrix  # refused
    scale = math.sqrt(math.fsum((matrix[:3, 0] * matrix[:3, 0]).tolist()))
    result = np.array(matrix)
    result[:3, :3] = scale * axes
    result[:3, 3] = 0
    centre = np.array(ball[:3])
    result[:3, 3] = transform.apply(matrix, centre) - transform.apply(result, centre)
    text = f"{node}: to_world scales it unevenly; as in Mitsuba it is a sphere of radius "
    warned.append((f"{text}{scale * ball[3]:g}", node.where))
    return result


def is_uneven(matrix: Array) -> bool:
    """Whether a matrix makes something else of a sphere."""
    linear = matrix[:3, :3]
    with np.errstate(all="ignore"):
        products = (linear[:, :, None] * linear[:, None, :]).sum(axis=0)
        off = float(np.abs(products - products[0, 0] * np.eye(3)).max())
    return off > _EVEN * float(products[0, 0]) and math.isfinite(off)


@lru_cache(maxsize=1)
def unit() -> Mesh:
    """The unit sphere as a mesh of TRIANGLES with its own normals, front outside, u and v as of
    spheres. Its corners lie on the sphere; between them it is up to 7.6e-5 of the radius thinner,
    where the sphere becomes an ellipsoid likewise."""
    around = np.array([sin_cos_degrees(360.0 * (k % _SIDES) / _SIDES) for k in range(_SIDES + 1)])
    down = np.array([sin_cos_degrees(360.0 * k / _SIDES) for k in range(_SIDES // 2 + 1)])
    down[[0, -1], 0] = 0.0
    points = np.empty((len(down), len(around), 3))
    points[..., 0] = down[:, :1] * around[:, 1]
    points[..., 1] = down[:, :1] * around[:, 0]
    points[..., 2] = down[:, 1:]
    uv = np.empty((len(down), len(around), 2))
    uv[..., 0] = np.arange(len(around)) / _SIDES
    uv[..., 1] = (np.arange(len(down)) / (len(down) - 1))[:, None]
    uv[[0, -1], :, 0] += 0.5 / _SIDES  # of a pole the middle of the triangle there
    corner = np.arange(len(down) * len(around)).reshape(len(down), len(around))
    a, b, c, d = corner[:-1, :-1], corner[1:, :-1], corner[1:, 1:], corner[:-1, 1:]
    upper, lower = np.stack([a, b, c], axis=-1)[:-1], np.stack([a, c, d], axis=-1)[1:]
    triangles = np.concatenate([upper.reshape(-1, 3), lower.reshape(-1, 3)])
    flat = points.reshape(-1, 3)
    return Mesh(flat, triangles, flat, uv.reshape(-1, 2))


def _axes(matrix: Array) -> Array | None:
    """The columns of a matrix, made orthogonal one after another, of unit length; None if they are
    not independent."""
    found: list[Array] = []
    for column in matrix[:3, :3].T:
        with np.errstate(all="ignore"):
            length = math.sqrt(math.fsum((column * column).tolist()))
            rest = column / length if length else column
            for axis in found:
                rest = rest - axis * math.fsum((rest * axis).tolist())
            length = math.sqrt(math.fsum((rest * rest).tolist()))
        if not 1e-12 < length < math.inf:
            return None
        found.append(rest / length)
    return np.array(found).T


def placed(given: list[Ball]) -> tuple[Array, Array]:
    """Centres and radii (S, 4) in world space, and whether the front is inside, of spheres: node,
    matrix, (x, y, z, radius), flipped. All at once: a file may hold a million."""
    if not given:
        return np.zeros((0, 4)), np.zeros(0, np.bool_)
    nodes, matrices, balls, flipped = zip(*given, strict=True)
    matrix, local = np.array(matrices), np.array(balls, np.float64)
    rows = matrix[:, :3, :3]
    with np.errstate(all="ignore"):
        products = (rows[:, :, None, :] * rows[:, None, :, :]).sum(axis=3)
        square = products[:, 0, 0]
        uneven = np.abs(products - square[:, None, None] * np.eye(3)).max(axis=(1, 2))
        centres = transform.apply(matrix, local[:, :3])
        radii = local[:, 3] * np.sqrt(square)
        inward = np.array(flipped, np.bool_)  # a mirror keeps the front in front
    uniform = uneven <= _EVEN * square
    small = (np.abs(centres) <= MAX_COORDINATE).all(axis=1)
    small &= (radii > 0) & (radii <= MAX_COORDINATE)
    if not (uniform & small).all():
        first = int(np.argmin(uniform & small))
        node = nodes[first]
        if uniform[first]:
            raise SceneError(f"{node}: centre or radius exceeds {MAX_COORDINATE:g}", node.where)
        raise SceneError(
            f'{node}: "to_world" scales a sphere unevenly; allowed: rotation, translation and '
            "the same scale in all directions (or a mesh)",
            (node.values.get("to_world") or node).where,
        )
    return np.column_stack([centres, radii]), inward


def frames(given: list[Ball]) -> Array:
    """Unit axes (S, 3, 3) in world space of spheres, a row each."""
    if not given:
        return np.zeros((0, 3, 3))
    axes = np.array([matrix[:3, :3].T for _, matrix, _, _ in given])
    frames: Array = axes / np.sqrt((axes * axes).sum(axis=2))[:, :, None]
    return frames
