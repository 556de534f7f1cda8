"""A fibre of hair, after M. J.-Y. Chiang, B. Bitterli, C. Tappan, B. Burley, "A Practical and
Controllable Hair and Fur Model for Production Path Tracing", Computer Graphics Forum 35(2), 2016.

Directions are local (3, n), z along the shading normal, y along the fibre, from which slopes theta
are measured; azimuths phi from z towards x. Light leaves where it was met. Four lobes: what the
surface reflects, what goes through, what is reflected once within, and all the rest, which leaves
evenly around the fibre. E. d'Eon et al., "An Energy-Conserving Hair Reflectance Model", EGSR 2011:
the lobes along the fibre, their sampling, and pigments.
"""

from __future__ import annotations

import numpy as np
from scipy.special import i0e

from reference.materials import fresnel
from reference.scene import Material

EUMELANIN = np.array([0.419, 0.697, 1.37])
PHEOMELANIN = np.array([0.187, 0.4, 1.05])
_TILTS = (-2.0, 1.0, 4.0, 0.0)  # of lobes, in angles of the scales
_WIDTHS = (1.0, 0.5, 2.0, 2.0)  # of lobes along the fibre


class Fibre:
    """One material."""

    def __init__(self, material: Material) -> None:
        self.index, self.absorption = float(material.eta[0]), material.k
        along, around, tilt = material.fibre
        root = 0.726 * along + 0.812 * along**2 + 3.7 * along**20
        self.variances = [(width * root) ** 2 for width in _WIDTHS]
        spread = 0.265 * around + 1.194 * around**2 + 5.372 * around**22
        self.scale = np.sqrt(np.pi / 8) * spread
        self.tilts = [factor * np.radians(tilt) for factor in _TILTS]

    def _seen(self, wo: np.ndarray) -> tuple:
        """Of wo: slope; azimuth; its turn at each lobe (3, n); shares of light (4, 3, n)."""
        theta = np.arcsin(np.clip(wo[1], -1, 1))
        gamma = np.arctan2(wo[0], wo[2])
        inside = np.cos(np.arcsin(np.sin(theta) / self.index))
        bent = np.arcsin(np.clip(np.sin(gamma) * np.cos(theta) / (self.index * inside), -1, 1))
        lost = np.exp(-self.absorption[:, None] * (2 * np.cos(bent) / inside))
        f = fresnel(np.clip(wo[2], 0, 1), self.index)
        through = (1 - f) ** 2 * lost
        with np.errstate(invalid="ignore"):
            rest = np.where(f < 1, through * (f * lost) ** 2 / (1 - f * lost), 0)
        shares = np.stack([np.broadcast_to(f, lost.shape), through, through * f * lost, rest])
        turns = np.stack([p * (2 * bent + np.pi) - 2 * gamma for p in range(3)])
        return theta, gamma, turns, shares

    def _around(self, angle: np.ndarray) -> np.ndarray:
        """The logistic on (-pi, pi)."""
        angle = np.remainder(angle + np.pi, 2 * np.pi) - np.pi
        whole = np.tanh(np.pi / (2 * self.scale))
        return 1 / (4 * self.scale * whole * np.cosh(angle / (2 * self.scale)) ** 2)

    def evaluate(self, wo: np.ndarray, wi: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """F (3, n) times the cosine of wi, and the density (n,)."""
        theta, gamma, turns, shares = self._seen(wo)
        chances = shares.sum(axis=1) / shares.sum(axis=(0, 1))
        phi, slope = np.arctan2(wi[0], wi[2]), np.arcsin(np.clip(wi[1], -1, 1))
        value, density = np.zeros(wi.shape), np.zeros(wi.shape[1])
        for k, (v, tilt) in enumerate(zip(self.variances, self.tilts, strict=True)):
            c = np.cos(slope) * np.abs(np.cos(theta + tilt)) / v
            s = np.sin(slope) * np.sin(theta + tilt) / v
            along = i0e(c) * np.exp(c - s - 1 / v) / (v * (1 - np.exp(-2 / v)))
            lobe = along * (self._around(phi - gamma - turns[k]) if k < 3 else 1 / (2 * np.pi))
            value += shares[k] * lobe
            density += chances[k] * lobe
        return value, density

    def sample(self, rng: np.random.Generator, wo: np.ndarray) -> np.ndarray:
        """Directions (3, n) with that density."""
        theta, gamma, turns, shares = self._seen(wo)
        n = len(theta)
        steps = np.cumsum(shares.sum(axis=1), axis=0)
        lobe = np.minimum((rng.random(n) * steps[-1] >= steps).sum(axis=0), 3)
        v, tilted = np.take(self.variances, lobe), theta + np.take(self.tilts, lobe)
        u = 1 - rng.random(n)
        cosine = np.clip(1 + v * np.log(u + (1 - u) * np.exp(-2 / v)), -1, 1)
        across = np.sqrt(1 - cosine**2) * np.cos(2 * np.pi * rng.random(n))
        sine = across * np.abs(np.cos(tilted)) - cosine * np.sin(tilted)
        sine = np.clip(sine, -1, 1)
        whole = np.tanh(np.pi / (2 * self.scale))
        angle = 2 * self.scale * np.arctanh(np.clip(whole * (2 * rng.random(n) - 1), -1, 1))
        even = 2 * np.pi * rng.random(n)
        phi = np.where(lobe < 3, turns[np.minimum(lobe, 2), np.arange(n)] + angle, even) + gamma
        up = np.sqrt(1 - sine**2)
        return np.stack([up * np.sin(phi), sine, up * np.cos(phi)])
