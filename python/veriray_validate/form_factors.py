"""Form factors: the share of a surface's diffuse light that reaches another one.

Closed forms with their sources and, for each, a second way to the same number: Lambert's sum over
the edges of a polygon (`lambert`), or quadrature. J. R. Howell, A Catalog of Radiation Heat
Transfer Configuration Factors, 1982, has them under the letters given.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Any

import numpy as np
import numpy.typing as npt

Array = npt.NDArray[np.float64]


def gauss(n: int, low: float = 0.0, high: float = 1.0) -> tuple[Array, Array]:
    """Nodes and weights of Gauss and Legendre's rule on [low, high]."""
    x, w = np.polynomial.legendre.leggauss(n)
    return (high - low) / 2 * (x + 1) + low, (high - low) / 2 * w


# ---- from a point with a normal ----


def lambert(point: Any, normal: Any, polygon: Any) -> float:
    """Form factor of a polygon from a point with a normal: J. H. Lambert, Photometria, 1760.

    1 / (2 pi) sum over edges of (angle subtended) (unit normal of the edge's plane . normal). The
    polygon must lie above the horizon; positive whichever way it runs.
    """
    v = np.asarray(polygon, np.float64) - np.asarray(point, np.float64)
    total = 0.0
    for a, b in zip(v, np.roll(v, -1, axis=0), strict=True):
        c = np.cross(a, b)
        angle = math.atan2(float(np.linalg.norm(c)), float(a @ b))
        total += angle * float(c @ np.asarray(normal)) / float(np.linalg.norm(c))
    return abs(total) / (2 * math.pi)


def rectangle_above_corner(a: float, b: float) -> float:
    """From a point to a x b parallel at height 1 above its corner (B-3)."""
    p, q = math.hypot(1, a), math.hypot(1, b)
    return (a / p * math.atan(b / p) + b / q * math.atan(a / q)) / (2 * math.pi)


def perpendicular_rectangle(a: float, b: float, c: float) -> float:
    """To a rectangle a wide, b high, standing on the plane at distance c, corner opposite (B-4)."""
    s = math.hypot(b, c)
    return (math.atan(a / c) - c / s * math.atan(a / s)) / (2 * math.pi)


def disk_beside(radius: float, height: float, aside: float) -> float:
    """To a disk parallel to the point's plane, its centre `aside` from above the point (B-13)."""
    h, r = height / aside, radius / aside
    z = 1 + h * h + r * r
    return (1 - (z - 2 * r * r) / math.sqrt(z * z - 4 * r * r)) / 2


def disk_upright(radius: float, distance: float, height: float) -> float:
    """To a disk that stands upright, centred `height` above the point's plane (B-15).

    Its axis meets the normal at `distance` from it. The disk is above the plane: height >= radius.
    """
    h, r = distance / height, radius / height
    z = 1 + h * h + r * r
    return h / 2 * (z / math.sqrt(z * z - 4 * r * r) - 1)


def to_disk(centre: Any, a: Any, b: Any, normal: Any, n: int = 200) -> float:
    """From the origin to one side of an ellipse with half axes a and b, by quadrature."""
    c, a, b, up = (np.asarray(v, np.float64) for v in (centre, a, b, normal))
    r, wr = gauss(n)
    phi = (np.arange(4 * n) + 0.5) / (4 * n) * 2 * math.pi
    p = c + (np.multiply.outer(r[:, None] * np.cos(phi), a) + np.multiply.outer(
        r[:, None] * np.sin(phi), b))  # fmt: skip
    d2 = (p * p).sum(-1)
    axis = np.cross(a, b)
    kernel = np.maximum(p @ up, 0) * np.abs(p @ axis) / d2**2
    return float((wr * r) @ kernel.mean(axis=1)) * 2


def cap(theta: float, alpha: float) -> float:
    """Irradiance over radiance of a cone of half angle alpha, its axis theta off the normal."""
    x, w = np.polynomial.legendre.leggauss(200)
    c = 1 - (1 - math.cos(alpha)) * (x + 1) / 2  # cosines within the cone
    phi = (np.arange(400) + 0.5) / 400 * math.pi
    up = c[:, None] * math.cos(theta) + np.sqrt(1 - c * c)[:, None] * math.sin(theta) * np.cos(phi)
    return float((w @ np.maximum(up, 0)).mean() * (1 - math.cos(alpha)) * math.pi)


def above_plane(polygon: Any, point: Any, normal: Any) -> Array:
    """The part of a convex polygon above the plane through `point`: I. E. Sutherland and
    G. W. Hodgman, CACM 17 (1974).
    """
    v = np.asarray(polygon, np.float64)
    h = (v - np.asarray(point, np.float64)) @ np.asarray(normal, np.float64)
    kept = []
    for k in range(len(v)):
        j = (k + 1) % len(v)
        if h[k] >= 0:
            kept.append(v[k])
        if (h[k] > 0 > h[j]) or (h[k] < 0 < h[j]):
            kept.append(v[k] + (v[j] - v[k]) * (h[k] / (h[k] - h[j])))
    return np.array(kept).reshape(-1, 3)


# ---- from a surface ----


def parallel_rectangles(a: float, b: float, c: float) -> float:
    """Between two aligned rectangles a x b at distance c (C-11)."""
    x, y = a / c, b / c
    p, q = 1 + x * x, 1 + y * y
    return 2 / (math.pi * x * y) * (
        math.log(math.sqrt(p * q / (p + q - 1)))
        + x * math.sqrt(q) * math.atan(x / math.sqrt(q))
        + y * math.sqrt(p) * math.atan(y / math.sqrt(p))
        - x * math.atan(x) - y * math.atan(y)
    )  # fmt: skip


def perpendicular_rectangles(width: float, height: float, edge: float) -> float:
    """From edge x width to edge x height, which share the edge at a right angle (C-14)."""
    w, h = width / edge, height / edge
    s, p, q = 1 + w * w + h * h, 1 + w * w, 1 + h * h
    z = w * w + h * h
    logs = (
        math.log(p * q / s)
        + w * w * math.log(w * w * s / (p * z))
        + h * h * math.log(h * h * s / (q * z))
    )
    root = math.sqrt(z)
    angles = w * math.atan(1 / w) + h * math.atan(1 / h) - root * math.atan(1 / root)
    return (angles + logs / 4) / (math.pi * w)


def coaxial_disks(r1: float, r2: float, h: float) -> float:
    """From a disk of radius r1 to one of radius r2, on one axis at distance h (C-41)."""
    x = 1 + (h * h + r2 * r2) / (r1 * r1)
    return (x - math.sqrt(x * x - 4 * (r2 / r1) ** 2)) / 2


def disk_to_sphere(disk: float, radius: float, h: float) -> float:
    """From a disk to a ball on its axis, centred h > radius above it (C-114).

    From the ball the disk takes (1 - cos of its angle) / 2; areas are 4 pi R^2 and pi r^2.
    """
    return 2 * (radius / disk) ** 2 * (1 - 1 / math.sqrt(1 + (disk / h) ** 2))


def mean_over(function: Callable[[float, float], float], a: float, b: float, n: int = 24,
              graded: bool = False) -> float:  # fmt: skip
    """The mean of f(x, y) over [0, a] x [0, b] by quadrature; graded: finer towards x = 0."""
    u, wu = gauss(n)
    x, wx = (a * u**4, 4 * u**3 * wu) if graded else (a * u, wu)
    return float(
        sum(wx[i] * wu[j] * function(float(x[i]), b * float(u[j])) for i in range(n)
            for j in range(n))
    )  # fmt: skip
