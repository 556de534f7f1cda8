"""Phase functions: values per steradian and random cosines of the turn, where 1 is straight on.

A blend draws from one of two phase functions; its density is the value of their sum. Flakes ask for
the directions themselves: ``between`` and ``onward``.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from reference.vectors import about, dot, unit_sphere


@dataclass(frozen=True)
class HenyeyGreenstein:
    """L. Henyey and J. Greenstein 1941, mean cosine g; isotropic for g = 0."""

    g: float

    def value(self, cosine: np.ndarray) -> np.ndarray:
        """Per steradian."""
        return henyey_greenstein(self.g, cosine)

    def draw(self, rng: np.random.Generator, n: int) -> np.ndarray:
        """Cosines (n,)."""
        return henyey_greenstein_turn(self.g, rng.random(n))


@dataclass(frozen=True)
class Rayleigh:
    """3 / (16 pi) (1 + cos^2)."""

    def value(self, cosine: np.ndarray) -> np.ndarray:
        """Per steradian."""
        return 3 / (16 * math.pi) * (1 + cosine**2)

    def draw(self, rng: np.random.Generator, n: int) -> np.ndarray:
        """c^3 + 3 c + 4 = 8 u by Cardano's formula: its one real root."""
        half = 4 * rng.random(n) - 2
        root = np.cbrt(half + np.sqrt(half**2 + 1))
        return np.clip(root - 1 / root, -1, 1)


@dataclass(frozen=True, eq=False)
class Tabulated:
    """In proportion to values (k,) at cosines from -1 to 1 in equal steps, linear between them.

    That is a sum of k hats, half ones at the ends. A hat is the law of the sum of two uniform
    numbers, so nothing is inverted.
    """

    values: np.ndarray

    def _hats(self) -> tuple[np.ndarray, float]:
        areas = np.array(self.values, np.float64)
        areas[[0, -1]] /= 2
        return areas, 2 / (len(areas) - 1)

    def value(self, cosine: np.ndarray) -> np.ndarray:
        """Per steradian."""
        areas, step = self._hats()
        at = np.linspace(-1, 1, len(areas))
        return np.interp(cosine, at, self.values) / (2 * math.pi * step * areas.sum())

    def draw(self, rng: np.random.Generator, n: int) -> np.ndarray:
        """Cosines (n,)."""
        areas, step = self._hats()
        hat = rng.choice(len(areas), n, p=areas / areas.sum())
        off = rng.random(n) + rng.random(n) - 1
        off[hat == 0] = np.abs(off[hat == 0])
        off[hat == len(areas) - 1] = -np.abs(off[hat == len(areas) - 1])
        return np.clip((hat + off) * step - 1, -1, 1)


@dataclass(frozen=True, eq=False)
class Flakes:
    """Specular microflakes of the matrix (3, 3), positive definite: E. Heitz et al., "The SGGX
    Microflake Distribution", SIGGRAPH 2015.

    Their area along w is sqrt(w S w), D(m) = 1 / (pi sqrt(det S) (m S^-1 m)^2), and light goes on
    with D(h) / (4 area), h halfway between the way back and the way on. Ways on are drawn evenly
    and kept in proportion to that, which is at most where m S^-1 m is least.
    """

    matrix: np.ndarray

    def area(self, direction: np.ndarray) -> np.ndarray:
        """Share (n,) of the extinction that rays along directions (3, n) meet."""
        return np.sqrt(dot(direction, self.matrix @ direction))

    def between(self, direction: np.ndarray, new: np.ndarray) -> np.ndarray:
        """Per steradian; unit vectors (3, n)."""
        half = new - direction
        half = half / np.sqrt(np.maximum(dot(half, half), 1e-300))
        q = dot(half, np.linalg.solve(self.matrix, half))
        root = math.sqrt(np.linalg.det(self.matrix))
        with np.errstate(divide="ignore"):
            return 1 / (4 * math.pi * root * q * q * self.area(direction))

    def onward(self, rng: np.random.Generator, direction: np.ndarray) -> np.ndarray:
        """New directions (3, n)."""
        n = direction.shape[1]
        out, todo = np.empty((3, n)), np.arange(n)
        least = 1 / np.linalg.eigvalsh(self.matrix)[-1]
        root = math.sqrt(np.linalg.det(self.matrix))
        while len(todo):
            old, new = direction[:, todo], unit_sphere(rng.random(len(todo)), rng.random(len(todo)))
            most = 1 / (4 * math.pi * root * least**2 * self.area(old))
            kept = rng.random(len(todo)) * most < self.between(old, new)
            out[:, todo[kept]] = new[:, kept]
            todo = todo[~kept]
        return out


@dataclass(frozen=True)
class Blend:
    """The first one by 1 - weight, the second by weight."""

    first: Phase
    second: Phase
    weight: float

    def value(self, cosine: np.ndarray) -> np.ndarray:
        """Per steradian."""
        one, other = self.first.value(cosine), self.second.value(cosine)
        return (1 - self.weight) * one + self.weight * other

    def draw(self, rng: np.random.Generator, n: int) -> np.ndarray:
        """Cosines (n,)."""
        second = rng.random(n) < self.weight
        out = np.empty(n)
        out[~second] = self.first.draw(rng, n - np.count_nonzero(second))
        out[second] = self.second.draw(rng, np.count_nonzero(second))
        return out


Phase = HenyeyGreenstein | Rayleigh | Tabulated | Flakes | Blend


def has_flakes(phase: Phase) -> bool:
    """Whether directions matter themselves, not their turn alone."""
    if isinstance(phase, Blend):
        return has_flakes(phase.first) or has_flakes(phase.second)
    return isinstance(phase, Flakes)


def between(phase: Phase, direction: np.ndarray, new: np.ndarray) -> np.ndarray:
    """Value (n,) per steradian of any phase function; unit vectors (3, n)."""
    if isinstance(phase, Flakes):
        return phase.between(direction, new)
    if isinstance(phase, Blend):
        one, other = (between(part, direction, new) for part in (phase.first, phase.second))
        return (1 - phase.weight) * one + phase.weight * other
    return phase.value(dot(direction, new))


def onward(phase: Phase, rng: np.random.Generator, direction: np.ndarray) -> np.ndarray:
    """New directions (3, n) of any phase function."""
    n = direction.shape[1]
    if isinstance(phase, Flakes):
        return phase.onward(rng, direction)
    if isinstance(phase, Blend):
        second, out = rng.random(n) < phase.weight, np.empty((3, n))
        for part, at in ((phase.first, ~second), (phase.second, second)):
            out[:, at] = onward(part, rng, direction[:, at])
        return out
    return about(direction, phase.draw(rng, n), 2 * math.pi * rng.random(n))


def henyey_greenstein(g: float | np.ndarray, cosine: np.ndarray) -> np.ndarray:
    """Per steradian."""
    return (1 - g * g) / (4 * math.pi * (1 + g * g - 2 * g * cosine) ** 1.5)


def henyey_greenstein_turn(g: float | np.ndarray, u: np.ndarray) -> np.ndarray:
    """Cosine: the inverse of the cumulative function, with the division by 2 g carried out."""
    x = 2 * u - 1
    cosine = 2 * x + g * (x * x + 3) + 2 * g * g * x + g**3 * (x * x - 1)
    return np.clip(cosine / (2 * (1 + g * x) ** 2), -1, 1)
