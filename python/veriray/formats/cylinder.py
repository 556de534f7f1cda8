"""Cylinders, as prisms of SIDES faces with the cylinder's own normals.

The edges of the prism lie on the cylinder. Where its section is round it is thinner by up to
1 - cos(pi / SIDES) = 7.6e-5 of the radius, in the middle of a face, and its area smaller by
1 - sin(pi / SIDES) / (pi / SIDES) = 2.6e-5; faces turn from the normals by 0.70 degrees at most. A
silhouette is a tenth of a pixel off where the radius is above 1,300 pixels.
"""

from __future__ import annotations

import math
from functools import lru_cache
from typing import Any

import numpy as np
import numpy.typing as npt

from .. import transform
from ..errors import SceneError
from ..numeric import sin_cos_degrees
from .mesh import Mesh
from .node import Node

Array = npt.NDArray[Any]
SIDES = 256
#: Longer ones, in radii, have rings; each is GROWTH times as far from an end or the middle as the
#: one before.
SLENDER, GROWTH = 2.0**12, 8.0


def rings(placed: Array) -> tuple[float, ...]:
    """Where the faces end along the axis, of the unit cylinder that `placed` puts into the world.

    Edges are met to about 2^-30 of their length. So a slender cylinder has rings around its ends
    and its middle, each GROWTH times as far away as the one before: edges are short there.
    """
    x, y, length = np.linalg.norm(placed[:3, :3], axis=0)
    if min(x, y) * SLENDER >= length:
        return 0.0, 1.0
    first = GROWTH * min(x, y) / length
    count = max(math.ceil(math.log(1.0 / (4.0 * max(first, 1e-30)), GROWTH)), 1)
    away = first * GROWTH ** np.arange(count)
    half = [0.0, *away, *(0.5 - away)]
    return tuple(sorted({*half, 0.5, *(1.0 - z for z in half)}))


@lru_cache(maxsize=8)
def unit(along: tuple[float, ...] = (0.0, 1.0)) -> Mesh:
    """About the z axis from 0 to 1, with the radius 1, open at both ends, the front outside.

    u goes once around from +x over +y, v along the axis. along: where its faces end.
    """
    circle = [sin_cos_degrees(360.0 * (k % SIDES) / SIDES)[::-1] for k in range(SIDES + 1)]
    sides = np.tile(np.array(circle), (len(along), 1))
    z = np.repeat(along, SIDES + 1)
    u = np.tile(np.arange(SIDES + 1) / SIDES, len(along))
    first = np.add.outer((SIDES + 1) * np.arange(len(along) - 1), np.arange(SIDES)).ravel()
    a, b = np.stack([first, first + 1, first + SIDES + 2]), [first, first + SIDES + 2]
    triangles = np.stack([*a, *b, first + SIDES + 1], axis=1).reshape(-1, 3)
    return Mesh(
        np.column_stack([sides, z]),
        triangles,
        np.column_stack([sides, np.zeros(len(sides))]),
        np.column_stack([u, z]),
    )


def matrix(node: Node, values: dict[str, Any], to_world: Array) -> Array:
    """From the unit cylinder to world space; values: p0, p1 and radius.

    x and y turn to the axis's orthonormal basis after Duff et al. 2017, as in Mitsuba.
    """
    start, axis = np.array(values["p0"]), np.subtract(values["p1"], values["p0"])
    message = f"{node}: p0 and p1 are the same point"
    x, y, z = transform.unit(axis.tolist(), message, node.where)
    sign = math.copysign(1.0, z)
    a = -1.0 / (sign + z)
    b = x * y * a
    local = np.eye(4)
    local[:3, 0] = 1.0 + sign * x * x * a, sign * b, -sign * x
    local[:3, 1] = b, sign + y * y * a, -y
    local[:3, :2] *= values["radius"]
    local[:3, 2], local[:3, 3] = axis, start
    with np.errstate(all="ignore"):
        placed: Array = transform.compose(to_world, local)
    if not np.isfinite(placed).all():
        raise SceneError(f"{node}: its size or place exceeds the float64 range", node.where)
    return placed
