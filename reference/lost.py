"""What the small mirrors of a rough surface lose in single steps, and lobes that give it back.

C. Kulla and A. Conty, "Revisiting Physically Based Shading at Imageworks", SIGGRAPH 2017. lost(c)
is 1 less what mirrors that absorb nothing send on of light at a cosine c. Light that meets several
of them leaves by lost(c_i) c_i / (pi mean lost): of a metal times F^2 E / (1 - F (1 - E)), F and E
the means for diffuse light of Fresnel's reflectance and of 1 - lost; of an interface on both sides,
by shares that keep f reciprocal and are as large as they can be, but no larger than those of a
smooth one.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from reference.materials import diffuse_fresnel, fresnel_conductor
from reference.scene import Material

COSINES = np.linspace(0, 1, 129) ** 2
#: What is sent on at COSINES: through or back, by the index beyond over that here, None for mirrors
#: that reflect all.
Share = Callable[[bool, float | None], np.ndarray]


class Lost:
    """Of one material; front: wo is in front."""

    def __init__(self, material: Material, share: Share) -> None:
        self.metal = material.kind == "roughconductor"
        self.width = min(float(material.alpha[0]), 1.0)
        eta = float(material.eta[0])
        self.lost = {}
        for front in (True,) if self.metal else (True, False):
            if self.metal:
                sent = share(False, None)
            else:
                index = eta if front else 1 / eta
                sent = share(False, index) + share(True, index)
            self.lost[front] = np.maximum(1 - sent, 0)
        c, w = np.polynomial.legendre.leggauss(2000)
        c, w = (c + 1) / 2, w / 2
        self.mean = {k: float((2 * c * w * self.at(k, c)).sum()) for k in self.lost}
        if self.metal:
            f = fresnel_conductor(c, material.eta[:, None], material.k[:, None])
            once = material.specular_reflectance * (2 * c * w * f).sum(axis=1)
            left = 1 - self.mean[True]
            self.colours = (once**2 * left / (1 - once * (1 - left)), np.zeros(3))
        else:
            self.colours = (material.specular_reflectance, material.specular_transmittance)
            enters, means = 1 - diffuse_fresnel(eta), self.mean
            self.through = {
                True: enters * min(1, means[False] / means[True]),
                False: enters / eta**2 * min(1, means[True] / means[False]),
            }
            self.eta = eta

    def at(self, front: bool, cosine: np.ndarray) -> np.ndarray:
        """Lost (n,), linear between the roots of cosines."""
        return np.interp(np.sqrt(cosine), np.sqrt(COSINES), self.lost[front])

    def crossing(self, front: bool) -> float:
        """Share of what is lost that goes to the other side."""
        return 0.0 if self.metal else self.through[front]

    def directions(self, u: np.ndarray, v: np.ndarray) -> np.ndarray:
        """Upwards (3, n), with a density in proportion to c / (c^2 + width^2)."""
        cosine = self.width * np.sqrt(np.expm1(u * np.log1p(self.width**-2)))
        sine, turn = np.sqrt(np.maximum(1 - cosine**2, 0)), 2 * np.pi * v
        return np.stack([sine * np.cos(turn), sine * np.sin(turn), cosine])

    def evaluate(self, front: bool, wo: np.ndarray, wi: np.ndarray) -> tuple:
        """F (3, n) of radiance times the cosine of wi; the share (n,) of directions that are drawn
        here, and their density (n,)."""
        own, cosine = self.at(front, wo[2]), np.abs(wi[2])
        up, even = wi[2] > 0, np.abs(wi[2]) / np.pi
        across = self.crossing(front)
        value = self.colours[0][:, None] * (own * (1 - across) * even)
        value = value * self.at(front, cosine) / self.mean[front]
        drawn = even / ((cosine**2 + self.width**2) * np.log1p(self.width**-2))
        density = np.where(up, 1 - across, across) * drawn
        if not self.metal:
            squared = self.eta**2 if front else 1 / self.eta**2
            beyond = self.colours[1][:, None] * (own * across * even / squared)
            beyond = beyond * self.at(not front, cosine) / self.mean[not front]
            value = np.where(up, value, beyond)
        return np.where(up | (not self.metal), value, 0), own, density
