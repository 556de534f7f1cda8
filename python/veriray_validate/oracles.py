"""Exact counterparts, in float64, of the renderer's mappings, phase function and Fresnel equations.

`INVERSE` maps a sampled point to the unit square by its cumulative distribution, where it must be
uniform; densities are per solid angle, per area of the disc and per unit of the weights of the
triangle.
"""

from __future__ import annotations

import functools
import math
from collections.abc import Callable
from typing import Any

import numpy as np
import numpy.typing as npt

Array = npt.NDArray[Any]

#: Random numbers at the ends and in the middle of their range.
CORNERS = (0.0, 2.0**-24, 0.5, 1 - 2.0**-24)


def single(x: Any) -> Array:
    """Rounded to float32, as float64."""
    return np.asarray(x, np.float32).astype(np.float64)


def normalised(v: Array) -> Array:
    """Rows of unit length, (..., 3)."""
    return v / np.sqrt(dot(v, v))[..., None]


def dot(a: Array, b: Array) -> Array:
    """Of rows of three, (..., 3) to (...); faster than a sum along so short an axis."""
    out: Array = a[..., 0] * b[..., 0] + a[..., 1] * b[..., 1] + a[..., 2] * b[..., 2]
    return out


def directions(rng: np.random.Generator, n: int) -> Array:
    """Uniform on the sphere, (n, 3)."""
    return normalised(rng.normal(size=(n, 3)))


def azimuth(p: Array) -> Array:
    """The azimuth of the first two columns, in turns, [0, 1)."""
    return np.arctan2(p[:, 1], p[:, 0]) / (2 * np.pi) % 1.0


def one_minus_cos(p: Array) -> Array:
    """1 - z of unit vectors, without cancellation about +z."""
    r2 = p[:, 0] ** 2 + p[:, 1] ** 2
    return np.where(p[:, 2] > 0, r2 / (1 + np.abs(p[:, 2])), 1 - p[:, 2])


def seen_rectangle(p: Array, corner: Array, e1: Array, e2: Array) -> tuple[Array, Array, Array]:
    """A rectangle in the frame of its edges around points p (n, 3): x0, y0 and height, (n,) each.

    Edges (3,) at right angles, in world units; the height is positive in front, which
    cross(e1, e2) points to.
    """
    to = corner - np.atleast_2d(p)
    n = np.cross(e1, e2)
    x0, y0, z = (to @ (e / np.linalg.norm(e)) for e in (e1, e2, n))
    return x0, y0, -z


def solid_angle(x0: Array, x1: Array, y0: Array, y1: Array, z: Array) -> Array:
    """Solid angle of a rectangle [x0, x1] x [y0, y1] at height z: the sum over the corners of
    +-atan(x y / (z r))."""

    def corner(x: Array, y: Array) -> Array:
        return np.arctan2(x * y, z * np.sqrt(x * x + y * y + z * z))

    return corner(x1, y1) - corner(x0, y1) - corner(x1, y0) + corner(x0, y0)


INVERSE: dict[str, Callable[[Array], tuple[Array, Array]]] = {
    "cosine_hemisphere": lambda p: (1 - p[:, 2] ** 2, azimuth(p)),
    "uniform_triangle": lambda p: (
        (p[:, 0] + p[:, 1]) ** 2,
        p[:, 1] / np.maximum(p[:, 0] + p[:, 1], 1e-30),
    ),
    "uniform_disk": lambda p: (p[:, 0] ** 2 + p[:, 1] ** 2, azimuth(p)),
}


def density(name: str, p: Array) -> Array:
    """Density of a mapping of `INVERSE` at its points."""
    if name == "cosine_hemisphere":
        return p[:, 2] / np.pi
    return np.full(len(p), 2.0 if name == "uniform_triangle" else 1 / np.pi)


def phase(away: Array, g: float) -> Array:
    """L. Henyey, J. Greenstein, Astrophysical Journal 93 (1941), per solid angle.

    away: half the squared distance of the two unit vectors (g < 0: of one and the negative of the
    other), which is 1 - cos without cancellation.
    """
    a = abs(g)
    return (1 - a * a) / (4 * np.pi * ((1 - a) ** 2 + 2 * a * away) ** 1.5)


def phase_inverse(p: Array, g: float) -> tuple[Array, Array]:
    """Maps directions scattered about +z to the unit square.

    For g > 0 the share beyond a cosine is
    (1 - g^2) / (2 g) (1 / (1 - g) - 1 / sqrt(1 + g^2 - 2 g cos)).
    """
    a = abs(g)
    less = one_minus_cos(p * [1, 1, math.copysign(1, g)])
    root = np.sqrt((1 - a) ** 2 + 2 * a * less)
    return np.clip(less * (1 + a) / (root * (root + 1 - a)), 0, 1), azimuth(p)


def fresnel(cos_i: Any, eta: Any, k: Any = 0.0) -> Array:
    """Reflectance for unpolarised light, from complex amplitudes: M. Born, E. Wolf, chapter 14.2.

    eta + ik: index beyond over index here.
    """
    c, n = np.asarray(cos_i, np.float64), np.asarray(eta, np.float64)
    if np.any(k):
        n = n + 1j * np.asarray(k, np.float64)
    square = n * n - (1 - c * c)
    root = np.sqrt(square if np.any(k) else np.maximum(square, 0))  # 0: of total reflection
    with np.errstate(invalid="ignore"):
        s, p = (c - root) / (c + root), (n * n * c - root) / (n * n * c + root)
    total = (n.imag == 0) & (n.real**2 <= 1 - c * c) & (n != 1)
    return np.where(n == 1, 0.0, np.where(total, 1.0, (np.abs(s) ** 2 + np.abs(p) ** 2) / 2))


def refracted(wo: Array, eta: float) -> Array:
    """Snell's law about +z for rows wo with z > 0; eta: index beyond over index here."""
    z2 = 1 - (1 - wo[:, 2:] ** 2) / eta**2
    return np.concatenate([-wo[:, :2] / eta, -np.sqrt(np.maximum(z2, 0))], axis=1)


@functools.lru_cache(maxsize=8)
def _legendre(n: int) -> tuple[Array, Array]:
    return np.polynomial.legendre.leggauss(n)


def gauss(n: int, low: float, high: float) -> tuple[Array, Array]:
    """Nodes and weights of Gauss and Legendre's quadrature."""
    x, w = _legendre(n)
    return (low + high) / 2 + (high - low) / 2 * x, (high - low) / 2 * w
