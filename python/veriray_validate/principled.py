"""The principled surface in float64, and the chances with which the core chooses its lobes.

Directions are local (n, 3), z along the normal on wo's side. After B. Burley, "Physically-Based
Shading at Disney", 2012, and "Extending the Disney BRDF to a BSDF", 2015, with Mitsuba 3's numbers.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
import numpy.typing as npt

from .oracles import dot, fresnel

Array = npt.NDArray[Any]
LUMINANCE = np.array([0.212671, 0.71516, 0.072169])


@dataclass(frozen=True)
class Principled:
    """A material; eta: inside over outside."""

    base: tuple[float, float, float] = (0.5, 0.5, 0.5)
    eta: float = 1.5
    roughness: float = 0.5
    metallic: float = 0.0
    spec_trans: float = 0.0
    spec_tint: float = 0.0
    sheen: float = 0.0
    sheen_tint: float = 0.0
    flatness: float = 0.0
    clearcoat: float = 0.0
    clearcoat_gloss: float = 0.0
    anisotropic: float = 0.0

    @property
    def shares(self) -> tuple[float, ...]:
        """The columns of columns.PRINCIPLED and PRINCIPLED_THIN."""
        return (*list(vars(self).values())[2:], 0.0)

    @property
    def open(self) -> bool:
        """Whether it lets light through."""
        return self.spec_trans > 0

    @property
    def opened(self) -> float:
        """Share of what is glass."""
        return (1 - self.metallic) * self.spec_trans

    @property
    def matt(self) -> float:
        """Share of what is diffuse."""
        return (1 - self.metallic) * (1 - self.spec_trans)

    @property
    def alphas(self) -> tuple[float, float]:
        """Slopes of the mirrors along and across the tangent."""
        aspect = np.sqrt(1 - 0.9 * self.anisotropic)
        return max(self.roughness**2 / aspect, 1e-3), max(self.roughness**2 * aspect, 1e-3)

    @property
    def coat_alpha(self) -> float:
        """Slope of the coat's mirrors."""
        return 0.1 + (0.001 - 0.1) * self.clearcoat_gloss


def grazing(c: Array) -> Array:
    """Schlick's (1 - c)^5."""
    return np.clip(1 - c, 0, 1) ** 5


def mix(a: Any, b: Any, t: Any) -> Any:
    """From a to b by t."""
    return a + (b - a) * t


def unhidden(w: Array, along: float, across: float) -> Array:
    """Smith's G1 for GGX."""
    slope2 = ((along * w[:, 0]) ** 2 + (across * w[:, 1]) ** 2) / w[:, 2] ** 2
    root: Array = np.sqrt(1 + slope2)
    return 2 / (1 + root)


def half(wo: Array, wi: Array, eta: float) -> Array:
    """Normals of the mirrors that send wo to wi."""
    h = wo + np.where(wi[:, 2:] > 0, 1.0, eta) * wi
    h *= np.where(h[:, 2:] < 0, -1, 1)
    out: Array = h / np.sqrt(dot(h, h))[:, None]
    return out


def coat_slopes(p: Principled, m: Array) -> Array:
    """Burley's distribution of exponent 1."""
    a2 = p.coat_alpha**2
    tilt = m[:, 0] ** 2 + m[:, 1] ** 2
    out: Array = (a2 - 1) / (np.pi * np.log(a2) * (tilt + a2 * m[:, 2] ** 2))
    return out


def lobes(p: Principled, wo: Array, wi: Array, front: bool, importance: bool = False,
          off: float = 0.0, own: bool = False) -> tuple[Array, Array]:  # fmt: skip
    """F cos (n, 3) and the density of samples (n,) for light from wi, seen from wo.

    off: of the mirrors' cosine (less) and reflectance (more), to find what rounding does. own: F of
    refraction by wo's cosine, as Mitsuba has it, else by the one in the thinner medium.
    """
    eta = p.eta if front else 1 / p.eta
    up = wi[:, 2] > 0
    m = half(wo, wi, eta)
    om, im = dot(wo, m), dot(wi, m)
    co, ci = wo[:, 2], np.abs(wi[:, 2])
    c = np.clip(np.abs(om) - off, 0, 1)
    r = shifted(c, eta, off)
    if eta < 1 and not own:  # next to total reflection the other cosine's last bits would count
        r = np.where(up, r, shifted(np.clip(np.abs(im) - off, 0, 1), 1 / eta, off))
    beyond = np.sqrt(np.maximum(1 - (1 - c * c) / eta**2, 0))
    slant = grazing(c if eta > 1 else beyond)
    base = np.array(p.base)
    light = float(base @ LUMINANCE)
    tint = base / light if light > 0 else np.ones(3)

    u, v = p.alphas
    slopes = 1 / (np.pi * u * v * ((m[:, 0] / u) ** 2 + (m[:, 1] / v) ** 2 + m[:, 2] ** 2) ** 2)
    seen = unhidden(wo, u, v) / co
    wide = np.where(up, 0.25, np.abs(om * im) * eta**2 / (om + eta * im) ** 2)
    sent = up | ((om > 0) & (im < 0))
    mirrors = np.where(sent, slopes * seen * wide, 0)
    dark = ((eta - 1) / (eta + 1)) ** 2
    r_, slant_ = r[:, None], slant[:, None]
    clear = mix(r_, mix(tint * dark, 1, slant_), p.spec_tint)
    shine = p.metallic * mix(base, 1, slant_) + (1 - p.metallic) * clear
    if not front:
        shine = p.opened * r_ * np.ones(3)
    shine = np.where(r_ > 0, shine, 0)
    scale = 1.0 if importance else 1 / eta**2
    through = p.opened * (1 - r_) * np.sqrt(base) * scale
    value = np.where(up[:, None], shine, through) * (mirrors * unhidden(wi, u, v))[:, None]

    chance = chances(p, co, eta, front, off)
    t, s = (p.opened, p.metallic) if front else (1.0, 0.0)
    past = t * (1 - r) if p.open else np.zeros_like(r)
    with np.errstate(invalid="ignore"):
        past = np.where(past > 0, past / (past + mix(r, 1, s)), 0)
    density = chance[2] * mirrors * np.where(up, 1 - past, past)
    if front:
        o5, i5 = grazing(co), grazing(ci)
        back = 2 * p.roughness * im**2
        rough = (1 - o5 / 2) * (1 - i5 / 2) + back * (o5 + i5 + o5 * i5 * (back - 1))
        under = mix(1, back / 2, o5) * mix(1, back / 2, i5)
        soft = 1.25 * (under * (1 / (co + ci) - 0.5) + 0.5)
        matt = p.matt * base * (mix(rough, soft, p.flatness) / np.pi)[:, None]
        veil = p.sheen * (1 - p.metallic) * grazing(im)[:, None]
        matt = matt + veil * mix(1, tint, p.sheen_tint)
        coat = coat_slopes(p, m)
        glint = 0.25 * p.clearcoat * mix(0.04, 1, slant) * coat
        matt = matt + (glint * unhidden(wo, 0.25, 0.25) * unhidden(wi, 0.25, 0.25))[:, None]
        value = value + np.where(up, ci, 0)[:, None] * matt
        others = chance[0] * ci / np.pi + chance[1] * coat * m[:, 2] / (4 * im)
        density = density + np.where(up, others, 0)
    return value, density


def shifted(c: Array, eta: float, off: float) -> Array:
    """Fresnel's reflectance plus off."""
    return fresnel(c, eta) if eta == 1 else np.clip(fresnel(c, eta) + off, 0, 1)


def chances(p: Principled, co: Array, eta: float, front: bool, off: float) -> Array:
    """Of the diffuse lobe, the coat and the mirrors (3, n)."""
    if not front:
        return np.stack([0 * co, 0 * co, 1 + 0 * co])
    most, r = max(p.base), shifted(co, eta, off)
    diffuse = p.matt * most + 0.25 * (1 - p.metallic) * p.sheen
    coat = 0.25 * p.clearcoat * mix(0.04, 1, grazing(co))
    mirrors = np.maximum(r, 1 / 16) + (1 - r) * (p.metallic * most + p.opened)
    out = np.stack([diffuse + 0 * co, coat, mirrors * (eta != 1)])
    total = out.sum(axis=0)
    return out / np.where(total > 0, total, 1)
