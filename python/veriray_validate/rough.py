"""Rough interfaces by quadrature: what small mirrors send back, or through, in one step.

Slopes follow GGX or Beckmann, and what Smith's G hides is lost: separable as in Mitsuba 3.9, or
correlated by height.
"""

from __future__ import annotations

import functools
import math
from collections.abc import Callable
from typing import Any

import numpy as np
import numpy.typing as npt
from scipy.special import beta

from veriray_validate.fresnel import fresnel, fresnel_conductor

Array = npt.NDArray[Any]
N = 96


#: Of all directions, or along x and y.
Alpha = float | tuple[float, float]


def unhidden(w: Array, alpha: Alpha, ggx: bool) -> Array:
    """Smith's G1 of directions (3, ...); of Beckmann by Mitsuba's rational function."""
    along, across = np.broadcast_to(alpha, 2)
    with np.errstate(divide="ignore"):
        a = np.abs(w[2]) / np.hypot(along * w[0], across * w[1])
        if ggx:
            exact: Array = 2 / (1 + np.sqrt(1 + 1 / a**2))
            return exact
    b = np.minimum(a, 1.6)
    return np.where(a < 1.6, (3.535 * b + 2.181 * b * b) / (1 + 2.276 * b + 2.577 * b * b), 1.0)


def share(mu: float, alpha: Alpha, ggx: bool, reflectance: Callable[[Array], Array],
          eta: float | None = None, azimuth: float = 0.0,
          heights: bool = False, points: int = N) -> float:  # fmt: skip
    """The mean over the slopes that wo sees at a cosine mu, of what goes where wi is not hidden.

    reflectance: of a mirror by its cosine to wo. Through the interface if eta, beyond over here, is
    given, else back. azimuth: of wo, from x towards y. heights: shadows are correlated by them. In
    polar coordinates of the slopes over alpha: Gauss-Legendre in their share, even in angle, with
    this many points. Where light is reflected totally, 96 are up to 3e-4 off.
    """
    x, w = np.polynomial.legendre.leggauss(points)
    if ggx:  # of slopes (p, q): 1 / (pi (1 + p^2 + q^2)^2); tangent of an angle to pi / 2
        angle = (x + 1) * math.pi / 4
        r, weight = np.tan(angle), w * math.pi / 4 * np.sin(2 * angle)
    else:  # exp(-p^2 - q^2) / pi
        r = (x + 1) * 3
        weight = w * 6 * r * np.exp(-r * r)
    turn = (np.arange(2 * points) + 0.5) / points * math.pi
    p, q = np.outer(r, np.cos(turn)), np.outer(r, np.sin(turn))
    along, across = np.broadcast_to(alpha, 2)
    m = np.stack([along * p, across * q, np.ones_like(p)])
    m = m / np.sqrt((m * m).sum(axis=0))
    sine = math.sqrt(1 - mu * mu)
    wo = np.array([sine * math.cos(azimuth), sine * math.sin(azimuth), mu])
    om = np.tensordot(wo, m, 1)
    seen = np.maximum(om, 0) / m[2] / mu * unhidden(wo[:, None, None], alpha, ggx)
    f = reflectance(np.clip(om, 0, 1))
    if eta is None:
        wi = 2 * om * m - wo[:, None, None]
        sent = np.where(wi[2] > 0, f, 0)
    else:
        beyond = np.sqrt(np.maximum(1 - (1 - om * om) / eta**2, 0))
        wi = (om / eta - beyond) * m - wo[:, None, None] / eta
        sent = np.where((wi[2] < 0) & (beyond > 0), 1 - f, 0)
    lit = unhidden(wi, alpha, ggx)
    if heights:
        own = unhidden(wo[:, None, None], alpha, ggx)
        lit = np.where(sent > 0, lit, 1)
        both = lit / (own + lit - own * lit) if eta is None else beta(1 / own, 1 / lit) / own
        lit = np.where(sent > 0, both, 0)
    value = seen * sent * lit
    return float((weight[:, None] * value).sum() / (2 * points))


def returned(
    mu: float, alpha: float, ggx: bool, heights: bool, eta: complex, colour: float
) -> float:
    """What a metal sends on if light that meets several mirrors is not lost (Kulla and Conty).

    eta: its index; colour: a factor on each reflection.
    """

    def white(c: float) -> float:
        return share(c, alpha, ggx, np.ones_like, heights=heights)

    x, w = (a / 2 for a in np.polynomial.legendre.leggauss(64))
    c = x + 0.5
    kept = float((2 * c * w * [white(float(one)) for one in c]).sum())
    once = colour * float((2 * c * w * fresnel_conductor(c, eta)).sum())
    first = colour * share(mu, alpha, ggx, lambda c: fresnel_conductor(c, eta), heights=heights)
    return first + (1 - white(mu)) * once**2 * kept / (1 - once * (1 - kept))


@functools.cache
def coat(eta: float, alpha: float, ggx: bool, heights: bool = False) -> tuple[Array, float]:
    """Mitsuba's tables of a rough coat, at 64 cosines: what it lets in; what it sends back inside.

    The latter is the mean over those cosines.
    """
    cosines = np.maximum(np.linspace(0, 1, 64), 1e-6)
    through = [share(c, alpha, ggx, lambda x: fresnel(x, eta), eta, 0, heights) for c in cosines]
    inside = [
        share(c, alpha, ggx, lambda x: fresnel(x, 1 / eta), None, 0, heights) for c in cosines
    ]
    return np.array(through), float(2 * (np.array(inside) * cosines).mean())
