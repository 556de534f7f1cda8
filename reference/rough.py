"""Rough surfaces: small mirrors whose slopes follow GGX or Beckmann, as in Mitsuba 3.9.

Directions are local here (3, n), z along the shading normal, x along the growth of u, wo above. f
is of radiance, with the cosine of wi; densities are per solid angle.

=============== ==================================================================================
mirrors         D of the slopes; what others hide of them by Smith's G1 for either direction
                (separable, or correlated by height; of Beckmann by Mitsuba's rational function)
chosen          GGX: of those that wo sees, by E. Heitz, JCGT 7(4), 2018; Beckmann: of all, and
                then it or the one of opposite slope, in proportion to what wo sees of either
roughconductor  reflects, weight F of the complex index, per channel
roughplastic    reflects, or is a matt base of rho / (1 - Fi) / eta^2 T(wo) T(wi) over pi, with the
                probabilities of smooth plastic of F = 1 - T(wo); the density is that of both. T:
                what enters, Fi: what comes back from inside, both of single steps, Mitsuba's tables
roughdielectric reflects with probability F, else refracts
compensation    of both: drawn with the probability of what is lost (``reference/lost.py``)
=============== ==================================================================================
"""

from __future__ import annotations

import functools
from collections.abc import Iterator

import numpy as np

from reference.hair import Fibre
from reference.lost import COSINES, Lost
from reference.materials import (
    HAIR,
    OPEN,
    ROUGH_GLASS,
    ROUGH_METAL,
    ROUGH_PLASTIC,
    SHEET,
    Materials,
    fresnel,
    fresnel_conductor,
    mirrored,
    of_coat,
    refracted,
)
from reference.mirrors import any_normal, both_unhidden, chance, normals, spread, unhidden, visible
from reference.principled import Principled
from reference.principled_thin import Sheet
from reference.scene import Material
from reference.vectors import dot

STEPS = 64  # of Mitsuba's tables for rough coats


@functools.cache
def coat(eta: float, alpha: float, ggx: bool, heights: bool) -> tuple[np.ndarray, float]:
    """What a rough coat lets in at STEPS cosines from 0 to 1, and what it sends back inside.

    The latter is Mitsuba's mean over the same cosines. Gauss-Legendre in the radius, even in angle.
    """
    cosine = np.maximum(np.linspace(0, 1, STEPS), 1e-6)
    through = _share(True, cosine, eta, alpha, ggx, heights)
    inside = _share(False, cosine, 1 / eta, alpha, ggx, heights)
    return through, float(2 * (inside * cosine).mean())


@functools.cache
def sent(through: bool, eta: float | None, alpha: float, ggx: bool, heights: bool) -> np.ndarray:
    """What mirrors send on at COSINES; eta: as in `Share`."""
    return _share(through, np.maximum(COSINES, 1e-7), eta, alpha, ggx, heights)


def _share(
    through: bool, cosines: np.ndarray, eta: float | None, alpha: float, ggx: bool, heights: bool
) -> np.ndarray:
    x, w = np.polynomial.legendre.leggauss(320)
    if ggx:
        u, weight = ((x + 1) / 2) ** 2, w * (x + 1) / 2
    else:
        r = 3 * (x + 1)
        u, weight = -np.expm1(-r * r), w * 3 * 2 * r * np.exp(-r * r)
    u, v = (a.ravel() for a in np.meshgrid(u, (np.arange(64) + 0.5) / 64, indexing="ij"))
    weight = np.repeat(weight / 64, 64)
    rough, smooth = np.full((2, len(u)), alpha), np.full(len(u), ggx)
    out = []
    for cosine in cosines:
        wo = np.empty((3, len(u)))
        wo[:] = np.array([[np.sqrt(1 - cosine * cosine)], [0.0], [cosine]])
        if ggx:
            m, area = visible(wo, rough, u, v), 1.0
        else:
            m = any_normal(rough, u, v)
            area = dot(wo, m) / m[2] / cosine * unhidden(wo, rough, smooth)
        om = dot(wo, m)
        f = 1.0 if eta is None else fresnel(np.clip(om, 0, 1), eta)
        wi = refracted(-wo, m, np.full(len(u), eta)) if through else mirrored(-wo, m)
        side = wi[2] < 0 if through else wi[2] > 0
        own = unhidden(wo, rough, smooth)
        lit = both_unhidden(wo, wi, rough, smooth, np.full(len(u), heights)) / own
        share = (1 - f if through else f) * lit * area
        out.append((weight * share * (side & (om > 0))).sum())
    return np.array(out)


class Rough:
    """The rough ones of a scene's materials; ``m`` in calls is an index of one for each path.

    eta: n beyond / n on wo's side (n,).
    """

    def __init__(self, materials: tuple[Material, ...], smooth: Materials) -> None:
        self.smooth = smooth
        self.alpha = np.array([m.alpha for m in materials]).T.copy()
        self.ggx = np.array([m.distribution == "ggx" for m in materials])
        self.heights = np.array([m.shadowing == "height_correlated" for m in materials])
        self.whole = {
            k: Lost(m, functools.partial(
                sent, alpha=m.alpha[0], ggx=bool(self.ggx[k]), heights=bool(self.heights[k])))
            for k, m in enumerate(materials) if m.whole
        }  # fmt: skip
        self.principled = {
            k: Principled(m)
            for k, m in enumerate(materials)
            if m.kind in ("principled", "principled_open")
        }
        self.sheets = {k: Sheet(m) for k, m in enumerate(materials) if m.kind == "principledthin"}
        self.fibres = {k: Fibre(m) for k, m in enumerate(materials) if m.kind == "hair"}
        self.base, self.coats = np.zeros((3, len(materials))), np.zeros((len(materials), STEPS))
        for k, m in enumerate(materials):
            if m.kind == "roughplastic":
                eta, rho = float(m.eta[0]), m.reflectance
                self.coats[k], inside = coat(
                    eta, m.alpha[0], bool(self.ggx[k]), bool(self.heights[k])
                )
                self.base[:, k] = rho / (1 - (rho * inside if m.nonlinear else inside)) / eta**2

    def eta(self, m: np.ndarray, facing: np.ndarray) -> np.ndarray:
        """N beyond / n on wo's side (n,); plastic's sides are alike, beyond sheet and fibre it is
        equal."""
        kind = self.smooth.kind[m]
        index = np.where(np.isin(kind, (ROUGH_METAL, SHEET, HAIR)), 1.0, self.smooth.index[m])
        return np.where(np.isin(kind, (ROUGH_GLASS, OPEN)) & (facing < 0), 1 / index, index)

    def entering(self, m: np.ndarray, cosine: np.ndarray) -> np.ndarray:
        """T (n,) of rough plastic, linear between the steps."""
        at = np.clip(cosine, 0, 1) * (STEPS - 1)
        cell = np.minimum(at.astype(np.int64), STEPS - 2)
        low, high = self.coats[m, cell], self.coats[m, cell + 1]
        return low + (at - cell) * (high - low)

    def coated(self, m: np.ndarray, through: np.ndarray) -> np.ndarray:
        """The probability (n,) of rough plastic's base, below a coat that lets this through."""
        colour = self.smooth.specular_reflectance[:, m]
        return 1 - of_coat(1 - through, colour, self.base[:, m])

    def evaluate(
        self, m: np.ndarray, eta: np.ndarray, wo: np.ndarray, wi: np.ndarray
    ) -> tuple[np.ndarray, np.ndarray]:
        """F (3, n) times the cosine of wi, and the density (n,); 0 where nothing goes."""
        value, density = self._evaluate(m, eta, wo, wi)
        for whole, at, front in self._whole(m, eta):
            more, share, own = whole.evaluate(front, wo[:, at], wi[:, at])
            value[:, at] += more
            density[at] += share * (own - density[at])
        for one, at, front in self._principled(m, eta):
            value[:, at], density[at] = one.evaluate(front, wo[:, at], wi[:, at])
        for sheet, at in self._sheets(m):
            value[:, at], density[at] = sheet.evaluate(wo[:, at], wi[:, at])
        return value, density

    def _sheets(self, m: np.ndarray) -> Iterator[tuple]:
        """Each thin one, and each fibre, with where it is seen."""
        for number, sheet in (*self.sheets.items(), *self.fibres.items()):
            if len(at := np.flatnonzero(m == number)):
                yield sheet, at

    def _whole(self, m: np.ndarray, eta: np.ndarray) -> Iterator[tuple]:
        """Each that loses no light with where it is seen, and from which side."""
        for number, one in self.whole.items():
            for front in (True,) if one.metal else (True, False):
                side = one.metal or (eta > 1) == ((one.eta > 1) == front)
                at = np.flatnonzero((m == number) & side)
                if len(at):
                    yield one, at, front

    def _principled(self, m: np.ndarray, eta: np.ndarray) -> Iterator[tuple]:
        """Each principled material with where it is seen, and from which side."""
        for number, one in self.principled.items():
            for front, index in ((True, one.index), (False, 1 / one.index)):
                at = np.flatnonzero((m == number) & (eta == index))
                if len(at) and (front or one.index != 1):
                    yield one, at, front

    def _evaluate(
        self, m: np.ndarray, eta: np.ndarray, wo: np.ndarray, wi: np.ndarray
    ) -> tuple[np.ndarray, np.ndarray]:
        kind, alpha, ggx = self.smooth.kind[m], self.alpha[:, m], self.ggx[m]
        mirror, glass = wi[2] > 0, kind == ROUGH_GLASS
        h = wo + np.where(mirror, 1.0, eta) * wi
        length = np.sqrt(dot(h, h))
        h *= np.where(h[2] < 0, -1, 1) / np.where(length > 0, length, 1)
        om, im = dot(wo, h), dot(wi, h)
        ok = (om > 0) & (mirror | (glass & (im < 0))) & (wi[2] != 0)
        with np.errstate(all="ignore"):
            # where e^-x leaves the normal floats of the core, it sends no shadow ray behind
            steep = ((h[:2] / alpha) ** 2).sum(axis=0) / h[2] ** 2 > 126 * np.log(2)
            ok &= mirror | ggx | ~steep
            slopes = spread(h, alpha, ggx) * np.where(
                mirror, 1 / (4 * om), eta**2 * np.abs(im) / (om + eta * im) ** 2
            )
            density = slopes * om * chance(wo, h, alpha, ggx)
            both = both_unhidden(wo, wi, alpha, ggx, self.heights[m])
            value = slopes * om / wo[2] * both
        f = fresnel(np.clip(om, 0, 1), eta)
        colour = self.smooth.specular_reflectance[:, m] * f
        at = kind == ROUGH_METAL
        index, k = self.smooth.eta[:, m[at]], self.smooth.k[:, m[at]]
        colour[:, at] = fresnel_conductor(np.clip(om[at], 0, 1), index, k)
        colour[:, at] *= self.smooth.specular_reflectance[:, m[at]]
        share = np.where(glass, f, 1.0)
        at = ~mirror
        colour[:, at] = self.smooth.specular_transmittance[:, m[at]] * (1 - f[at]) / eta[at] ** 2
        share[at] = 1 - f[at]
        value, density = np.where(ok, colour * value, 0), np.where(ok, share * density, 0)
        at = (kind == ROUGH_PLASTIC) & mirror
        through, matt = self.entering(m[at], wo[2, at]), wi[2, at] / np.pi
        value[:, at] += self.base[:, m[at]] * (through * self.entering(m[at], wi[2, at]) * matt)
        density[at] += self.coated(m[at], through) * (matt - density[at])
        return value, density

    def sample(
        self, rng: np.random.Generator, m: np.ndarray, eta: np.ndarray, wo: np.ndarray
    ) -> np.ndarray:
        """Directions (3, n) with that density."""
        kind, n = self.smooth.kind[m], len(m)
        h = normals(wo, self.alpha[:, m], self.ggx[m], *rng.random((3, n)))
        lobe = rng.random(n)
        wi = mirrored(-wo, h)
        through = (kind == ROUGH_GLASS) & (lobe >= fresnel(np.clip(dot(wo, h), 0, 1), eta))
        wi = np.where(through, refracted(-wo, h, eta), wi)
        matt = (kind == ROUGH_PLASTIC) & (lobe < self.coated(m, self.entering(m, wo[2])))
        r, turn = np.sqrt(rng.random(n)), 2 * np.pi * rng.random(n)
        even = np.stack([r * np.cos(turn), r * np.sin(turn), np.sqrt(1 - r * r)])
        # a mirror's refraction or reflection that leaves on the other side is lost
        lost = ~matt & ((wi[2] > 0) == through)
        wi = np.where(lost, 0.0, np.where(matt, even, wi))
        for whole, at, front in self._whole(m, eta):
            again = rng.random(len(at)) < whole.at(front, wo[2, at])
            across = rng.random(len(at)) < whole.crossing(front)
            turned = whole.directions(*rng.random((2, len(at))))
            turned = turned * np.where(across, [[1], [1], [-1]], 1)
            wi[:, at] = np.where(again, turned, wi[:, at])
        for one, at, front in self._principled(m, eta):
            wi[:, at] = one.sample(rng, front, wo[:, at])
        for sheet, at in self._sheets(m):
            wi[:, at] = sheet.sample(rng, wo[:, at])
        return wi
