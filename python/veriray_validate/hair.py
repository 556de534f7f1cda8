"""Hair in float64: M. J.-Y. Chiang, B. Bitterli, C. Tappan, B. Burley, "A Practical and
Controllable Hair and Fur Model for Production Path Tracing", Computer Graphics Forum 35(2), 2016.

Local directions: z along the normal, y along the fibre.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np
import numpy.typing as npt
from scipy.special import i0e

from .oracles import fresnel

Array = npt.NDArray[Any]


@dataclass(frozen=True)
class Fibre:
    """Absorption over a radius, index over that outside, variance along the fibre of the light that
    its surface reflects, scale of the logistic around it (radians), sine of the tilt of its scales.
    """

    absorption: tuple[float, ...] = (0.3, 0.6, 1.2)  # of each channel
    eta: float = 1.55
    along: float = 0.1
    around: float = 0.2
    tilt: float = 0.035


class Seen(NamedTuple):
    """What a direction wo (..., 3) makes of the lobes: shares of the light (4, ..., channels), and
    chances (4, ...) that a sample is of one; azimuth of wo, its slope along the fibre and the
    azimuth within, from its place on the surface.
    """

    shares: Array
    chances: Array
    out: Array
    slope: Array
    within: Array


def seen_from(p: Fibre, wo: Array, off: float = 0.0) -> Seen:
    """As `lobes` takes it."""
    shares = light(p, wo, off)
    return Seen(
        shares,
        shares.sum(axis=-1) / shares.sum(axis=(0, -1)),
        np.arctan2(wo[..., 0], wo[..., 2]),
        np.arctan2(wo[..., 1], np.hypot(wo[..., 0], wo[..., 2])),
        np.arcsin(np.clip(wo[..., 0] / _rest(p, wo), -1, 1)),
    )


def lobes(p: Fibre, wo: Array, wi: Array, off: float = 0.0,
          seen: Seen | None = None) -> tuple[Array, Array]:  # fmt: skip
    """F cos (N, channels) and density (N,) of directions wi (N, 3) as seen from wo (3,) or (N, 3).

    off: what the cosine of Fresnel's reflectance has less, and the reflectance more. seen: what
    `seen_from` gives for wo, where it is known.
    """
    seen = seen or seen_from(p, wo, off)
    shares, chances, out, slope, within = seen
    value, density = np.zeros((len(wi), shares.shape[-1])), np.zeros(len(wi))
    about = np.arctan2(wi[:, 0], wi[:, 2]) - out
    up = np.hypot(wi[:, 0], wi[:, 2])
    tilt = np.arcsin(p.tilt)
    turns, widths = (-2, 1, 4, 0), (1, 0.25, 4, 4)
    for k in range(4):
        leans = slope + turns[k] * tilt
        s, c, v = np.sin(leans), abs(np.cos(leans)), widths[k] * p.along
        along = np.exp(-((wi[:, 1] + s) ** 2 + (up - c) ** 2) / (2 * v)) * i0e(up * c / v)
        along /= v * -np.expm1(-2 / v)
        around = np.full(len(wi), 0.5 / np.pi)
        if k < 3:
            turn = about - (2 * k * within - 2 * out + k * np.pi)
            turn -= 2 * np.pi * np.floor(turn / (2 * np.pi) + 0.5)
            e, end = np.exp(-np.abs(turn) / p.around), np.exp(-np.pi / p.around)
            around = e / (p.around * (1 + e) ** 2) * (1 + end) / (1 - end)
        value += shares[k] * (along * around)[:, None]
        density += chances[k] * along * around
    return value, density


def light(p: Fibre, wo: Array, off: float = 0.0) -> Array:
    """Shares of the light that leave by each lobe (4, ..., channels), wo (..., 3)."""
    rest = _rest(p, wo)
    path = 2 * np.sqrt(np.maximum(0.0, 1 - (wo[..., 0] / rest) ** 2)) * p.eta / rest
    t = np.exp(-np.array(p.absorption) * path[..., None])
    r = fresnel(np.clip(wo[..., 2] - off, 0, 1), p.eta)[..., None]
    if p.eta != 1:
        r = np.clip(r + off, 0, 1)
    first, again = (1 - r) ** 2 * t, t * r
    later = first * again**2 / np.maximum(1 - again, 1e-300)
    return np.stack([r + 0 * t, first, first * again, later])


def _rest(p: Fibre, wo: Array) -> Array:
    """Index times the cosine of the slope along the fibre within; 2^-50 where no light enters."""
    rest: Array = np.sqrt(np.maximum(p.eta**2 - wo[..., 1] ** 2, 2.0**-100))
    return rest
