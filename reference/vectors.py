"""Vectors as arrays (3, ...) float64."""

from __future__ import annotations

import numpy as np


def dot(a: np.ndarray, b: np.ndarray) -> np.ndarray:
    """Scalar products."""
    out = a[0] * b[0]
    out += a[1] * b[1]
    out += a[2] * b[2]
    return out


def cross(a: np.ndarray, b: np.ndarray) -> np.ndarray:
    """Vector products."""
    return np.stack(
        [a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]]
    )


def unit(a: np.ndarray) -> np.ndarray:
    """Vectors of length 1."""
    return a / np.sqrt(dot(a, a))


def unit_sphere(u: np.ndarray, v: np.ndarray) -> np.ndarray:
    """Uniform unit vectors (3, n) from uniform numbers in [0, 1)."""
    z = 1 - 2 * u
    r = np.sqrt(np.maximum(1 - z * z, 0))
    phi = 2 * np.pi * v
    return np.stack([r * np.cos(phi), r * np.sin(phi), z])


def about(axis: np.ndarray, cosine: np.ndarray, phi: np.ndarray) -> np.ndarray:
    """Unit vectors at an angle with the given cosine to unit ``axis`` (3, n), turned by ``phi``.

    Basis of Duff et al. 2017, "Building an orthonormal basis, revisited".
    """
    x, y, z = axis
    sign = np.copysign(1.0, z)
    a = -1 / (sign + z)
    b = x * y * a
    sine = np.sqrt(np.maximum(1 - cosine * cosine, 0))
    p, q = sine * np.cos(phi), sine * np.sin(phi)
    return np.stack(
        [
            p * (1 + sign * x * x * a) + q * b + cosine * x,
            p * sign * b + q * (sign + y * y * a) + cosine * y,
            -p * sign * x - q * y + cosine * z,
        ]
    )
