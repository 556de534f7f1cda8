"""The small mirrors of rough surfaces: their slopes, their shadows, their choice (``rough.py``).

alpha (2, n): along x and y.
"""

from __future__ import annotations

import numpy as np
from scipy.special import beta

from reference.vectors import dot, unit


def unhidden(w: np.ndarray, alpha: np.ndarray, ggx: np.ndarray) -> np.ndarray:
    """Smith's G1 (n,)."""
    with np.errstate(divide="ignore", invalid="ignore"):
        slope = np.abs(w[2]) / np.hypot(alpha[0] * w[0], alpha[1] * w[1])
        smooth = 2 / (1 + np.sqrt(1 + 1 / slope**2))
        a = np.minimum(slope, 1.6)
        rational = (3.535 * a + 2.181 * a * a) / (1 + 2.276 * a + 2.577 * a * a)
    return np.where(ggx, smooth, np.where(slope < 1.6, rational, 1.0))


def both_unhidden(
    wo: np.ndarray, wi: np.ndarray, alpha: np.ndarray, ggx: np.ndarray, heights: np.ndarray
) -> np.ndarray:
    """Smith's G2 (n,): separable, or where `heights` is set correlated by height (E. Heitz, 2014;
    across the surface E. Heitz et al., 2016)."""
    own, other = unhidden(wo, alpha, ggx), unhidden(wi, alpha, ggx)
    if not heights.any():
        return own * other
    with np.errstate(all="ignore"):
        a, b = 1 / own - 1, 1 / other - 1
        shared = np.where(wo[2] * wi[2] > 0, 1 / (1 + a + b), beta(1 + a, 1 + b))
    return np.where(heights, np.where(own * other > 0, shared, 0), own * other)


def spread(m: np.ndarray, alpha: np.ndarray, ggx: np.ndarray) -> np.ndarray:
    """D (n,), of m above."""
    with np.errstate(divide="ignore", over="ignore"):
        tangent2 = ((m[0] / alpha[0]) ** 2 + (m[1] / alpha[1]) ** 2) / m[2] ** 2
        gauss = np.exp(-tangent2)
        slopes = np.where(ggx, 1 / (1 + tangent2) ** 2, gauss) / (np.pi * alpha[0] * alpha[1])
        return np.where(slopes > 0, slopes / m[2] ** 4, 0)


def chance(wo: np.ndarray, m: np.ndarray, alpha: np.ndarray, ggx: np.ndarray) -> np.ndarray:
    """The density (n,) of choosing m, over D wo.m."""
    area = dot(wo, m) / m[2]
    both = np.maximum(area, 0) + np.maximum(2 * wo[2] - area, 0)
    return np.where(ggx, unhidden(wo, alpha, ggx) / wo[2], 2 / both)


def normals(
    wo: np.ndarray, alpha: np.ndarray, ggx: np.ndarray, u: np.ndarray, v: np.ndarray, w: np.ndarray
) -> np.ndarray:
    """Mirrors (3, n) chosen by three numbers in [0, 1)."""
    one = any_normal(alpha, u, v)
    other = one * [[-1], [-1], [1]]
    seen, seen_too = (np.maximum(dot(wo, m), 0) for m in (one, other))
    one = np.where(w * (seen + seen_too) < seen, one, other)
    return np.where(ggx, visible(wo, alpha, u, v), one)


def any_normal(alpha: np.ndarray, u: np.ndarray, v: np.ndarray) -> np.ndarray:
    """Of all mirrors of Beckmann's slopes."""
    radius, turn = np.sqrt(-np.log1p(-u)), 2 * np.pi * v
    x, y = alpha * radius * [np.cos(turn), np.sin(turn)]
    m = np.stack([x, y, np.ones_like(u)])
    return unit(m)


def visible(wo: np.ndarray, alpha: np.ndarray, u: np.ndarray, v: np.ndarray) -> np.ndarray:
    """Of the mirrors of GGX that wo sees."""
    # the slopes of alpha 1 as points of a disc, seen along the stretched wo
    z = np.stack([alpha[0] * wo[0], alpha[1] * wo[1], wo[2]])
    z /= np.sqrt(dot(z, z))
    x = np.stack([-z[1], z[0], np.zeros_like(u)])
    length = np.hypot(z[0], z[1])
    x = np.where(length > 0, x / np.where(length > 0, length, 1), [[1.0], [0.0], [0.0]])
    y = np.cross(z, x, axis=0)
    r, turn = np.sqrt(u), 2 * np.pi * v
    a, b = r * np.cos(turn), r * np.sin(turn)
    share = (1 + z[2]) / 2
    b = (1 - share) * np.sqrt(np.maximum(1 - a * a, 0)) + share * b
    m = a * x + b * y + np.sqrt(np.maximum(1 - a * a - b * b, 0)) * z
    m = np.stack([alpha[0] * m[0], alpha[1] * m[1], np.maximum(m[2], 0)])
    return unit(m)
