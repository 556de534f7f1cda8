"""The principled surface, as in Mitsuba 3.9.

Source: B. Burley, "Physically-Based Shading at Disney", 2012, and "Extending the Disney BRDF to a
BSDF with Integrated Subsurface Scattering", 2015; how Mitsuba mixes their parts was measured.
Directions are local (3, n), z along the shading normal, wo above; f is of radiance, with the cosine
of wi. A direction is chosen by the cosine, the coat's mirrors or the mirrors that wo sees, with
the chances of ``chances``, as in veriray, so that paths end alike; the density is that of all.
"""

from __future__ import annotations

import numpy as np

from reference.materials import fresnel, mirrored, refracted
from reference.mirrors import normals, spread, unhidden
from reference.scene import Material
from reference.vectors import dot

#: Parameters between 0 and 1, and their defaults.
SHARES = {
    "roughness": 0.5, "metallic": 0.0, "spec_trans": 0.0, "spec_tint": 0.0, "sheen": 0.0,
    "sheen_tint": 0.0, "flatness": 0.0, "clearcoat": 0.0, "clearcoat_gloss": 0.0,
    "anisotropic": 0.0,
}  # fmt: skip
_LUMINANCE = np.array([0.212671, 0.71516, 0.072169])


def _schlick(cosine: np.ndarray) -> np.ndarray:
    return np.clip(1 - cosine, 0, 1) ** 5


class Principled:
    """One material; eta in calls: n beyond / n on wo's side."""

    def __init__(self, material: Material) -> None:
        for name in SHARES:
            setattr(self, name, material.shares[name])
        self.color = material.reflectance
        self.index = float(material.eta[0])
        aspect = np.sqrt(1 - 0.9 * self.anisotropic)
        self.alpha = np.maximum(self.roughness**2 * np.array([[1 / aspect], [aspect]]), 0.001)
        self.gloss = 0.1 * (1 - self.clearcoat_gloss) + 0.001 * self.clearcoat_gloss
        self.glass = (1 - self.metallic) * self.spec_trans
        self.matt = (1 - self.metallic) * (1 - self.spec_trans)
        light = float(self.color @ _LUMINANCE)
        self.hue = self.color / light if light > 0 else np.ones(3)

    def evaluate(
        self, front: bool, wo: np.ndarray, wi: np.ndarray
    ) -> tuple[np.ndarray, np.ndarray]:
        """F (3, n) times the cosine of wi, and the density (n,); 0 where nothing goes."""
        eta = self.index if front else 1 / self.index
        n = wo.shape[1]
        rough, ggx = self.alpha.repeat(n, axis=1), np.ones(n, bool)
        up = wi[2] > 0
        h = wo + np.where(up, 1.0, eta) * wi
        length = np.sqrt(dot(h, h))
        h *= np.where(h[2] < 0, -1, 1) / np.where(length > 0, length, 1)
        om, im = dot(wo, h), dot(wi, h)
        ok = (om > 0) & (up | (self.glass > 0) & (im < 0)) & (wi[2] != 0)
        with np.errstate(all="ignore"):
            f, beyond = self._split(om, eta)
            slopes = spread(h, rough, ggx) * np.where(
                up, 1 / (4 * om), eta**2 * np.abs(im) / (om + eta * im) ** 2
            )
            hidden = unhidden(wo, rough, ggx)
            lobe = slopes * om / wo[2] * hidden * unhidden(wi, rough, ggx)
            lean = _schlick(om if eta > 1 else beyond)
            tint = np.where(
                up, self._mirrors(front, f, lean, eta), self._through(f) / eta**2
            ) * np.where((f > 0) | ~up, lobe, 0)
            chosen = slopes * om * hidden / wo[2] * self._choice(front, up, f)
            if front:
                tint = np.where(up, tint + self._base(wo, wi, h, im, lean), tint)
                coat = self._coat(h) * h[2] / (4 * om)
                even, shiny, small = self.chances(front, wo)
                chosen = small * chosen + np.where(up, even * wi[2] / np.pi + shiny * coat, 0)
        return np.where(ok, tint, 0), np.where(ok, chosen, 0)

    def sample(self, rng: np.random.Generator, front: bool, wo: np.ndarray) -> np.ndarray:
        """Directions (3, n) with that density; 0 where the mirror's other side is met."""
        eta, n = self.index if front else 1 / self.index, wo.shape[1]
        h = normals(wo, self.alpha.repeat(n, axis=1), np.ones(n, bool), *rng.random((3, n)))
        lobe, u, turn = rng.random(n), rng.random(n), 2 * np.pi * rng.random(n)
        even, shiny, _ = self.chances(front, wo)
        select = rng.random(n)
        which = np.where(select < even, 0, np.where(select < even + shiny, 1, 2))
        square = self.gloss**2
        z = np.sqrt((1 - square ** (1 - u)) / (1 - square))
        r = np.sqrt(np.maximum(1 - z * z, 0))
        coat = np.stack([r * np.cos(turn), r * np.sin(turn), z])
        h = np.where(which == 1, coat, h)
        f, _ = self._split(dot(wo, h), eta)
        through = (which == 2) & (lobe >= self._choice(front, np.ones(n, bool), f))
        wi = np.where(through, refracted(-wo, h, np.full(n, eta)), mirrored(-wo, h))
        lost = (wi[2] > 0) == through
        r = np.sqrt(u)
        even = np.stack([r * np.cos(turn), r * np.sin(turn), np.sqrt(1 - u)])
        return np.where(which == 0, even, np.where(lost, 0.0, wi))

    def _split(self, cosine: np.ndarray, eta: float) -> tuple[np.ndarray, np.ndarray]:
        c = np.clip(cosine, 0, 1)
        return fresnel(c, eta), np.sqrt(np.maximum(1 - (1 - c * c) / eta**2, 0))

    def chances(self, front: bool, wo: np.ndarray) -> np.ndarray:
        """Of the three ways to choose a direction (3, n): about what they send back or on."""
        none = np.zeros(wo.shape[1])
        if not front:
            return np.stack([none, none, none + 1])
        f, most = fresnel(wo[2], self.index), self.color.max()
        even = self.matt * most + self.sheen * (1 - self.metallic) / 4
        shiny = self.clearcoat / 4 * (0.04 + 0.96 * _schlick(wo[2]))
        small = np.maximum(f, 1 / 16) + (1 - f) * (self.metallic * most + self.glass)
        weights = np.stack([none + even, shiny, small * (self.index != 1)])
        total = weights.sum(axis=0)
        return weights / np.where(total > 0, total, 1)

    def _choice(self, front: bool, up: np.ndarray, f: np.ndarray) -> np.ndarray:
        """The chance (n,) that mirrors of reflectance f reflect (up) or refract."""
        if self.glass == 0 and (front or self.spec_trans == 0):
            return np.where(up, 1.0, 0.0)
        glass, metal = (self.glass, self.metallic) if front else (1.0, 0.0)
        on = glass * (1 - f)
        on = on / (on + f + metal * (1 - f))
        return np.where(up, 1 - on, on)

    def _mirrors(self, front: bool, f: np.ndarray, lean: np.ndarray, eta: float) -> np.ndarray:
        if not front:
            return np.broadcast_to(self.glass * f, (3, len(f)))
        straight = self.hue * ((eta - 1) / (eta + 1)) ** 2
        metal, tinted = (c[:, None] + (1 - c[:, None]) * lean for c in (self.color, straight))
        plain = (1 - self.spec_tint) * f + self.spec_tint * tinted
        return self.metallic * metal + (1 - self.metallic) * plain

    def _through(self, f: np.ndarray) -> np.ndarray:
        return self.glass * np.sqrt(self.color)[:, None] * (1 - f)

    def _coat(self, h: np.ndarray) -> np.ndarray:
        square = self.gloss**2
        below = 1 + (square - 1) * h[2] ** 2
        return (square - 1) / (np.pi * np.log(square) * below)

    def _base(
        self, wo: np.ndarray, wi: np.ndarray, h: np.ndarray, im: np.ndarray, lean: np.ndarray
    ) -> np.ndarray:
        a, b = _schlick(wo[2]), _schlick(wi[2])
        back = 2 * self.roughness * im * im
        burley = (1 - a / 2) * (1 - b / 2) + back * (a + b + a * b * (back - 1))
        edge = back / 2
        within = (1 + (edge - 1) * a) * (1 + (edge - 1) * b)
        within = 1.25 * (within * (1 / (wo[2] + wi[2]) - 0.5) + 0.5)
        diffuse = (1 - self.flatness) * burley + self.flatness * within
        out = self.matt / np.pi * self.color[:, None] * diffuse
        cloth = 1 - self.sheen_tint + self.sheen_tint * self.hue
        out = out + self.sheen * (1 - self.metallic) * cloth[:, None] * _schlick(im)
        quarter, ggx = np.full((2, len(im)), 0.25), np.ones(len(im), bool)
        both = unhidden(wo, quarter, ggx) * unhidden(wi, quarter, ggx)
        glint = self.clearcoat / 4 * (0.04 + 0.96 * lean) * self._coat(h) * both
        return (out + glint) * wi[2]
