"""4x4 transforms in float64, column vectors, composed as Mitsuba 3 composes them.

Every product is written out in a fixed order with separate rounding (no BLAS, no fused
multiply-add), so that a scene's vertices have the same bits on every machine.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Any

import numpy as np
import numpy.typing as npt

from .errors import SceneError
from .numeric import determinant, sin_cos_degrees

Array = npt.NDArray[Any]


def compose(a: Array, b: Array) -> Array:
    """The matrix that applies b first, then a; leading axes are broadcast."""
    result: Array = a[..., 0:1] * b[..., 0:1, :]
    for k in (1, 2, 3):
        result = result + a[..., k : k + 1] * b[..., k : k + 1, :]
    return result


def apply(matrix: Array, points: Array) -> Array:
    """Transforms points (..., 3) by affine matrices (..., 4, 4); the leading axes are broadcast."""
    m = matrix[..., :3, :]
    result: Array = points[..., 0:1] * m[..., 0] + points[..., 1:2] * m[..., 1]
    result = result + points[..., 2:3] * m[..., 2]
    result = result + m[..., 3]
    return result


def for_normals(matrix: Array) -> Array:
    """The matrix that turns normals along with points: a multiple > 0 of the inverse transpose."""
    m: Array = matrix[:3, :3] / np.abs(matrix[:3, :3]).max()
    a, b = [1, 2, 0], [2, 0, 1]  # the rows and columns after each, cyclically
    cofactors = m[a][:, a] * m[b][:, b] - m[a][:, b] * m[b][:, a]
    result = np.eye(4)
    result[:3, :3] = -cofactors if determinant(m) < 0 else cofactors
    return result


def translate(v: Sequence[float]) -> Array:
    """Translation by v."""
    matrix = np.eye(4)
    matrix[:3, 3] = v
    return matrix


def scale(v: Sequence[float]) -> Array:
    """Scaling along the axes."""
    return np.diag([*v, 1.0])


def rotate(axis: Sequence[float], angle: float, where: str = "") -> Array:
    """Rotation by `angle` degrees about `axis`, counter-clockwise seen against the axis.

    The axis must have unit length: Mitsuba uses it as given, and any other makes a shear.
    """
    fault = axis_fault(axis)
    if fault:
        raise SceneError(f"rotate: {fault}, expected 1", where)
    return rotate_as_given(axis, angle)


def axis_fault(axis: Sequence[float]) -> str:
    """What is wrong with the length of an axis of rotation, "" if it is 1."""
    x, y, z = axis
    length = math.hypot(x, y, z)
    if abs(length - 1.0) <= 1e-3:
        return ""
    return f"the axis ({x:g}, {y:g}, {z:g}) has length {length:g}"


def rotate_as_given(axis: Sequence[float], angle: float) -> Array:
    """`rotate` about an axis of any length: a shear if it is not 1."""
    x, y, z = axis
    s, c = sin_cos_degrees(angle)
    t = 1.0 - c
    matrix = np.eye(4)
    matrix[:3, :3] = [
        [c + t * x * x, t * x * y - s * z, t * x * z + s * y],
        [t * x * y + s * z, c + t * y * y, t * y * z - s * x],
        [t * x * z - s * y, t * y * z + s * x, c + t * z * z],
    ]
    return matrix


def turned(x: Any, y: Any, z: Any, w: Any) -> Array:
    """The rotations (3, 3, ...) of unit quaternions, numbers or arrays (...); w: real parts."""
    return np.array([
        [1 - 2 * (y * y + z * z), 2 * (x * y - z * w), 2 * (x * z + y * w)],
        [2 * (x * y + z * w), 1 - 2 * (x * x + z * z), 2 * (y * z - x * w)],
        [2 * (x * z - y * w), 2 * (y * z + x * w), 1 - 2 * (x * x + y * y)],
    ])  # fmt: skip


def unit(v: Sequence[float], message: str, where: str = "") -> list[float]:
    """V divided by its length; SceneError(message, where) if that is 0 or not finite."""
    length = math.sqrt(v[0] * v[0] + v[1] * v[1] + v[2] * v[2])
    if not 0.0 < length < math.inf:
        raise SceneError(message, where)
    return [x / length for x in v]


def cross(a: Sequence[float], b: Sequence[float]) -> list[float]:
    """Cross product of a and b."""
    return [
        a[1] * b[2] - a[2] * b[1],
        a[2] * b[0] - a[0] * b[2],
        a[0] * b[1] - a[1] * b[0],
    ]


def look_at(
    origin: Sequence[float], target: Sequence[float], up: Sequence[float], where: str = ""
) -> Array:
    """Local +Z towards the target, +Y up, +X = up x forward (left on a camera's picture)."""
    forward = unit(
        [t - o for t, o in zip(target, origin, strict=True)],
        "lookat: origin and target are the same point",
        where,
    )
    upward = unit(up, "lookat: up has length 0", where)
    side = cross(upward, forward)
    if math.hypot(*side) < 1e-9:
        raise SceneError("lookat: up is parallel to the viewing direction", where)
    left = unit(side, "", where)
    matrix = np.eye(4)
    matrix[:3] = np.array([left, cross(forward, left), forward, list(origin)]).T
    return matrix


def any_up(origin: Sequence[float], target: Sequence[float], where: str = "") -> tuple[float, ...]:
    """An `up` for look_at where none is given: Mitsuba's, of Duff et al., "Building an Orthonormal
    Basis, Revisited" (2017)."""
    x, y, z = unit(
        [t - o for t, o in zip(target, origin, strict=True)],
        "lookat: origin and target are the same point",
        where,
    )
    sign = math.copysign(1.0, z)
    a = -1.0 / (sign + z)
    return sign * (x * x * a) + 1.0, sign * (x * y * a), -sign * x
