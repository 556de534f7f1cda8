"""The thin principled sheet, as in Mitsuba 3.9; both sides are alike.

Source: B. Burley, "Extending the Disney BRDF to a BSDF with Integrated Subsurface Scattering",
2015, section 5; how Mitsuba mixes its parts was measured. Light goes through the mirrors of a sheet
as if they reflected it and the far side were folded over; their slopes are then those of roughness
(0.65 eta - 0.35). Of these directions Mitsuba keeps those that the mirror that sends them has on
its own far side. Directions are local (3, n), z along the shading normal, wo above; f is of
radiance, with the cosine of wi. Directions are chosen with the chances of ``chances``, as in
veriray, so that paths end alike; the density is that of all.
"""

from __future__ import annotations

import numpy as np

from reference.materials import fresnel, mirrored
from reference.mirrors import normals, spread, unhidden
from reference.principled import _LUMINANCE, _schlick
from reference.scene import Material
from reference.vectors import dot, unit

#: Parameters and their defaults; diff_trans is up to 2, the others up to 1.
SHARES = {
    "roughness": 0.5, "spec_trans": 0.0, "spec_tint": 0.0, "sheen": 0.0, "sheen_tint": 0.0,
    "flatness": 0.0, "anisotropic": 0.0, "diff_trans": 0.0,
}  # fmt: skip
_FOLD = np.array([[1.0], [1.0], [-1.0]])


class Sheet:
    """One material."""

    def __init__(self, material: Material) -> None:
        for name in SHARES:
            setattr(self, name, material.shares[name])
        self.color, self.index = material.reflectance, float(material.eta[0])
        aspect = np.sqrt(1 - 0.9 * self.anisotropic) ** np.array([[-1.0], [1.0]])
        self.near, self.far = (
            np.maximum(rough**2 * aspect, 1e-3)
            for rough in (self.roughness, self.roughness * (0.65 * self.index - 0.35))
        )
        light = float(self.color @ _LUMINANCE)
        self.hue = self.color / light if light > 0 else np.ones(3)

    def evaluate(self, wo: np.ndarray, wi: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """F (3, n) times the cosine of wi, and the density (n,)."""
        through = wi[2] < 0
        folded = np.where(through, wi * _FOLD, wi)
        with np.errstate(all="ignore"):
            h = wo + folded
            h = unit(h)
            alpha, ggx = np.where(through, self.far, self.near), np.ones(len(through), bool)
            slopes = spread(h, alpha, ggx) * unhidden(wo, alpha, ggx) / (4 * wo[2])
            lobe = slopes * unhidden(folded, alpha, ggx)
            c = np.clip(dot(wo, h), 0, 1)
            f = fresnel(c, self.index)
            bent = np.sqrt(np.maximum(1 - (1 - c * c) / self.index**2, 0))
            lean = _schlick(c if self.index > 1 else bent)
            straight = self.hue[:, None] * ((self.index - 1) / (self.index + 1)) ** 2
            tinted = straight + (1 - straight) * lean
            shine = (1 - self.spec_tint) * f + self.spec_tint * tinted
            sent = np.where(dot(wi, h) < 0, 1 - f, 0) * self.color[:, None]
            value = self.spec_trans * lobe * np.where(through, sent, shine)
            rest = (1 - self.spec_trans) * np.where(
                through,
                self.diff_trans / 2 / np.pi * self.color[:, None] * folded[2],
                (1 - self.diff_trans / 2) * self._matt(wo, wi, c),
            )
        even_up, even_down, mirror, sends = self.chances(wo)
        density = np.where(through, even_down, even_up) * folded[2] / np.pi
        density += np.where(through, sends, mirror) * slopes
        good = folded[2] > 0
        return np.where(good, value + rest, 0), np.where(good, density, 0)

    def _matt(self, wo: np.ndarray, wi: np.ndarray, c: np.ndarray) -> np.ndarray:
        a, b = _schlick(wo[2]), _schlick(wi[2])
        back = 2 * self.roughness * c * c
        burley = (1 - a / 2) * (1 - b / 2) + back * (a + b + a * b * (back - 1))
        within = (1 + (back / 2 - 1) * a) * (1 + (back / 2 - 1) * b)
        within = 1.25 * (within * (1 / (wo[2] + wi[2]) - 0.5) + 0.5)
        diffuse = (1 - self.flatness) * burley + self.flatness * within
        cloth = 1 - self.sheen_tint + self.sheen_tint * self.hue
        out = self.color[:, None] * diffuse / np.pi + self.sheen * cloth[:, None] * _schlick(c)
        return out * wi[2]

    def sample(self, rng: np.random.Generator, wo: np.ndarray) -> np.ndarray:
        """Directions (3, n) with that density; 0 where a mirror sends light to its other side."""
        n = wo.shape[1]
        even_up, even_down, mirror, _ = self.chances(wo)
        select, ggx = rng.random(n), np.ones(n, bool)
        even = select < even_up + even_down
        through = np.where(even, select >= even_up, select >= even_up + even_down + mirror)
        h = normals(wo, np.where(through, self.far, self.near), ggx, *rng.random((3, n)))
        wi = mirrored(-wo, h)
        u, turn = rng.random(n), 2 * np.pi * rng.random(n)
        r = np.sqrt(u)
        cosine = np.stack([r * np.cos(turn), r * np.sin(turn), np.sqrt(1 - u)])
        wi = np.where(even, cosine, np.where(wi[2] > 0, wi, 0.0))
        return np.where(through, wi * _FOLD, wi)

    def chances(self, wo: np.ndarray) -> np.ndarray:
        """Of diffuse light above and below, and of mirrors that reflect and let through (4, n)."""
        f, most = fresnel(wo[2], self.index), self.color.max()
        down = self.diff_trans / 2
        matt, none = (1 - self.spec_trans), np.zeros(wo.shape[1])
        dull = self.index == 1 and self.spec_tint == 0
        weights = np.stack([
            none + matt * (1 - down) * (most + self.sheen / 4),
            none + matt * down * most,
            none if dull else self.spec_trans * np.maximum(f, 1 / 16),
            self.spec_trans * np.maximum(1 - f, 1 / 16) * most,
        ])  # fmt: skip
        total = weights.sum(axis=0)
        return weights / np.where(total > 0, total, 1)
