"""Spheres of a scene file, in world space."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import numpy.typing as npt

from .. import transform
from ..errors import SceneError
from ..numeric import MAX_COORDINATE
from .node import Node

Array = npt.NDArray[Any]
#: Node, to_world, (x, y, z, radius), flipped.
Ball = tuple[Node, Array, tuple[float, ...], bool]
_EVEN = 2e-3  # of the square of a scale


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
        axes = _axes(matrix)
        if axes is None:
            continue  # refused
        scale = math.sqrt(math.fsum((matrix[:3, 0] * matrix[:3, 0]).tolist()))
        even = np.array(matrix)
        even[:3, :3] = scale * axes
        even[:3, 3] = 0
        centre = np.array(ball[:3])
        even[:3, 3] = transform.apply(matrix, centre) - transform.apply(even, centre)
        result[k] = node, even, ball, flipped
        text = f"{node}: to_world scales it unevenly; as in Mitsuba it is a sphere of radius "
        warned.append((f"{text}{scale * ball[3]:g}", node.where))
    return result


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
