"""The thin principled sheet in float64, and the chances with which the core chooses its lobes.

Directions are local (n, 3), z along the normal on wo's side; both sides are alike. After B. Burley,
"Extending the Disney BRDF to a BSDF with Integrated Subsurface Scattering", 2015, section 5, with
Mitsuba 3's numbers.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
import numpy.typing as npt

from .oracles import dot
from .principled import LUMINANCE, grazing, mix, shifted, unhidden

Array = npt.NDArray[Any]


@dataclass(frozen=True)
class Sheet:
    """A material; eta: of the sheet over what is around it."""

    base: tuple[float, float, float] = (0.5, 0.5, 0.5)
    eta: float = 1.5
    roughness: float = 0.5
    spec_trans: float = 0.0
    spec_tint: float = 0.0
    sheen: float = 0.0
    sheen_tint: float = 0.0
    flatness: float = 0.0
    anisotropic: float = 0.0
    diff_trans: float = 0.0

    @property
    def shares(self) -> tuple[float, ...]:
        """The columns of columns.PRINCIPLED and PRINCIPLED_THIN."""
        return (
            self.roughness, 0.0, self.spec_trans, self.spec_tint, self.sheen, self.sheen_tint,
            self.flatness, 0.0, 0.0, self.anisotropic, self.diff_trans,
        )  # fmt: skip

    def alphas(self, up: bool) -> tuple[float, float]:
        """Slopes of the mirrors that reflect, or of those that let light through."""
        rough = self.roughness * (1 if up else 0.65 * self.eta - 0.35)
        aspect = np.sqrt(1 - 0.9 * self.anisotropic)
        return max(rough**2 / aspect, 1e-3), max(rough**2 * aspect, 1e-3)


def mirrors(p: Sheet, wo: Array, j: Array, m: Array, up: bool) -> tuple[Array, Array]:
    """The reflection of the mirrors without F, times the cosine, and its density."""
    u, v = p.alphas(up)
    slopes = 1 / (np.pi * u * v * ((m[:, 0] / u) ** 2 + (m[:, 1] / v) ** 2 + m[:, 2] ** 2) ** 2)
    drawn = slopes * unhidden(wo, u, v) / (4 * wo[:, 2])
    return drawn * unhidden(j, u, v), drawn


def lobes(p: Sheet, wo: Array, wi: Array, off: float = 0.0) -> tuple[Array, Array]:
    """F cos (n, 3) and the density of samples (n,) for light from wi, seen from wo.

    off: of the mirrors' cosine (less) and reflectance (more), to find what rounding does.
    """
    up = wi[:, 2] > 0
    j = wi * np.where(up[:, None], 1, [1, 1, -1])
    h = wo + j
    m = h / np.sqrt(dot(h, h))[:, None]
    c = np.clip(dot(wo, m) - off, 0, 1)
    r = shifted(c, p.eta, off)
    beyond = np.sqrt(np.maximum(1 - (1 - c * c) / p.eta**2, 0))
    slant = grazing(c if p.eta > 1 else beyond)[:, None]
    base = np.array(p.base)
    light = float(base @ LUMINANCE)
    tint = base / light if light > 0 else np.ones(3)
    dark = ((p.eta - 1) / (p.eta + 1)) ** 2
    co, ci = wo[:, 2], j[:, 2]

    above, drawn = mirrors(p, wo, j, m, True)
    below, passed = mirrors(p, wo, j, m, False)
    below = np.where(dot(wi, m) < 0, below * (1 - r), 0)
    back = 2 * p.roughness * c * c
    o5, i5 = grazing(co), grazing(ci)
    rough = (1 - o5 / 2) * (1 - i5 / 2) + back * (o5 + i5 + o5 * i5 * (back - 1))
    under = mix(1, back / 2, o5) * mix(1, back / 2, i5)
    soft = 1.25 * (under * (1 / (co + ci) - 0.5) + 0.5)
    front, behind = (1 - p.spec_trans) * np.array([1 - p.diff_trans / 2, p.diff_trans / 2])
    clear = mix(r[:, None], mix(tint * dark, 1, slant), p.spec_tint)
    matt = base * (mix(rough, soft, p.flatness) / np.pi)[:, None]
    veil = p.sheen * mix(1, tint, p.sheen_tint) * grazing(c)[:, None]
    reflected = p.spec_trans * clear * above[:, None] + front * (matt + veil) * ci[:, None]
    sent = base * (p.spec_trans * below + behind * ci / np.pi)[:, None]
    chance = chances(p, co, off)
    density = np.where(up, chance[0], chance[1]) * ci / np.pi
    density = density + np.where(up, chance[2] * drawn, chance[3] * passed)
    return np.where(up[:, None], reflected, sent), density


def chances(p: Sheet, co: Array, off: float) -> Array:
    """Of the diffuse lobes above and below, of mirrors that reflect and that let through (4, n)."""
    most, r, none = max(p.base), shifted(co, p.eta, off), 0 * co
    shut, down = 1 - p.spec_trans, p.diff_trans / 2
    mirror = p.spec_trans * np.maximum(r, 1 / 16)
    out = np.stack(
        [
            shut * (1 - down) * (most + p.sheen / 4) + none,
            shut * down * most + none,
            none if p.eta == 1 and p.spec_tint == 0 else mirror,
            p.spec_trans * np.maximum(1 - r, 1 / 16) * most,
        ]
    )
    total = out.sum(axis=0)
    return out / np.where(total > 0, total, 1)
