"""Media: free flights, transmittance, scattering.

A flight in a chromatic medium takes one channel's free path, the channel chosen with probability
proportional to its throughput, and is weighted by the balance heuristic over the three channels
(one-sample model, Veach and Guibas 1995): unbiased, and the sum of the throughputs never grows. In
a grey medium that is the usual flight, with weight 1 or albedo. Where a grid gives the extinction,
the optical depth along the ray is integrated and inverted (``grids``). Where a medium scatters by
flakes alone, its extinction is that of the area which the ray sees of them.
"""

from __future__ import annotations

import math

import numpy as np

from reference.grids import integral
from reference.phases import (
    Flakes,
    HenyeyGreenstein,
    between,
    has_flakes,
    henyey_greenstein,
    henyey_greenstein_turn,
    onward,
)
from reference.scene import Medium
from reference.vectors import about, dot, unit_sphere


class Media:
    """The media of a scene; ``medium`` in calls is an index (n,) int, at least 0."""

    def __init__(self, media: tuple[Medium, ...]) -> None:
        self.sigma_t = np.array([m.sigma_t for m in media]).reshape(-1, 3).T.copy()
        self.albedo = np.array([m.albedo for m in media]).reshape(-1, 3).T.copy()
        self.phases = [m.phase for m in media]
        self.g = np.array([getattr(phase, "g", 0.0) for phase in self.phases])
        self.lobed = [
            m for m, phase in enumerate(self.phases) if not isinstance(phase, HenyeyGreenstein)
        ]
        self.flakes = [m for m in self.lobed if has_flakes(self.phases[m])]
        self.black = (self.albedo == 0).all(axis=0)
        self.extinction = [m.extinction_grid for m in media]
        self.albedo_grids = [m.albedo_grid for m in media]
        uneven = [grid for grid in self.extinction if grid is not None]
        self.uneven = bool(uneven)
        self.grey = bool((self.sigma_t == self.sigma_t[:1]).all())
        self.grey &= all(grid.grey for grid in uneven)
        self.isotropic = bool((self.g == 0).all()) and not self.lobed

    def flight(
        self,
        rng: np.random.Generator,
        medium: np.ndarray,
        limit: np.ndarray,
        throughput: np.ndarray,
        origin: np.ndarray,
        direction: np.ndarray,
    ) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """(distance flown (n,), scattered (n,) bool, weight (3, n)); ``limit`` is the surface's."""
        sigma = self.sigma(medium, direction)
        distance, scattered, weight = self._flight(rng, medium, limit, throughput, sigma)
        for m, grid in enumerate(self.extinction):
            if grid is not None and len(at := np.flatnonzero(medium == m)):
                distance[at], scattered[at], weight[:, at] = self._uneven_flight(
                    rng, m, limit[at], throughput[:, at], origin[:, at], direction[:, at]
                )
        for m, grid in enumerate(self.albedo_grids):
            if grid is not None and len(at := np.flatnonzero(scattered & (medium == m))):
                weight[:, at] *= grid.at(origin[:, at] + direction[:, at] * distance[at])
        return distance, scattered, weight

    def sigma(self, medium: np.ndarray, direction: np.ndarray) -> np.ndarray:
        """Extinction (3, n) along directions (3, n), where no grid says more."""
        sigma = self.sigma_t.take(medium, axis=1)
        for m in self.flakes:
            phase = self.phases[m]
            if isinstance(phase, Flakes) and len(at := np.flatnonzero(medium == m)):
                sigma[:, at] *= phase.area(direction[:, at])
        return sigma

    def _uneven_flight(
        self,
        rng: np.random.Generator,
        m: int,
        limit: np.ndarray,
        throughput: np.ndarray,
        origin: np.ndarray,
        direction: np.ndarray,
    ) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """As ``flight`` in medium m, less the albedo's grid."""
        n, grid, sigma = len(limit), self.extinction[m], self.sigma_t[:, m, None]
        total = throughput.sum(axis=0)
        chance = np.where(total > 0, throughput / np.where(total > 0, total, 1), 1 / 3)
        u, ray = rng.random(n), np.arange(n)
        channel = (u >= chance[0]).astype(np.int8) + (u >= chance[0] + chance[1])
        knots, powers = grid.along(origin, direction, limit)
        lengths = np.diff(knots, axis=0)
        parts = integral(powers, lengths, 1.0)
        depths = np.concatenate([np.zeros((3, 1, n)), np.cumsum(parts, axis=1)], axis=1)
        own = depths[channel, :, ray].T * sigma[channel, 0]
        wanted = rng.standard_exponential(n)
        scattered = wanted < own[-1]
        piece = np.clip((own <= wanted).sum(axis=0) - 1, 0, len(knots) - 2)
        length, at = lengths[piece, ray], powers[:, :, piece, ray]
        mine = at[:, channel, ray] * sigma[channel, 0]
        a, b = np.zeros(n), np.ones(n)
        for _ in range(60):
            middle = (a + b) / 2
            low = own[piece, ray] + integral(mine, length, middle) < wanted
            a, b = np.where(low, middle, a), np.where(low, b, middle)
        there = sum(at[p] * b**p for p in range(4)) * sigma
        depth = depths[:, piece, ray] + integral(at, length, b)
        depth = np.where(scattered, depth, depths[:, -1]) * sigma
        weight = np.exp(-depth)
        weight *= np.where(scattered, there, 1.0)
        weight /= dot(chance, weight)
        weight *= np.where(scattered, self.albedo[:, m, None], 1.0)
        return np.where(scattered, knots[piece, ray] + b * length, limit), scattered, weight

    def _flight(
        self,
        rng: np.random.Generator,
        medium: np.ndarray,
        limit: np.ndarray,
        throughput: np.ndarray,
        sigma: np.ndarray,
    ) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """As ``flight``, in homogeneous media."""
        n = len(medium)
        if self.grey:
            with np.errstate(divide="ignore"):
                free = rng.standard_exponential(n) / sigma[0]
            scattered = free < limit
            weight = np.where(scattered, self.albedo.take(medium, axis=1), 1.0)
            return np.minimum(free, limit), scattered, weight
        total = throughput.sum(axis=0)
        chance = np.where(total > 0, throughput / np.where(total > 0, total, 1), 1 / 3)
        u = rng.random(n)
        channel = (u >= chance[0]).astype(np.int8) + (u >= chance[0] + chance[1])
        with np.errstate(divide="ignore"):
            free = rng.standard_exponential(n) / np.choose(channel, sigma)
        scattered = free < limit
        distance = np.minimum(free, limit)
        weight = attenuation(sigma, distance)
        weight *= np.where(scattered, sigma, 1.0)
        weight /= dot(chance, weight)
        weight *= np.where(scattered, self.albedo.take(medium, axis=1), 1.0)
        return distance, scattered, weight

    def transmittance(
        self, medium: np.ndarray, distance: np.ndarray, origin: np.ndarray, direction: np.ndarray
    ) -> np.ndarray:
        """exp(-sigma_t distance) (3, n), or what stands for it along uneven ways."""
        out = attenuation(self.sigma(medium, direction), distance)
        for m, grid in enumerate(self.extinction):
            if grid is not None and len(at := np.flatnonzero(medium == m)):
                knots, powers = grid.along(origin[:, at], direction[:, at], distance[at])
                depth = integral(powers, np.diff(knots, axis=0), 1.0).sum(axis=1)
                out[:, at] = np.exp(-depth * self.sigma_t[:, m, None])
        return out

    def phase(
        self, medium: np.ndarray, cosine: np.ndarray, direction: np.ndarray, new: np.ndarray
    ) -> np.ndarray:
        """Value (n,) per steradian; cosine of the turn from direction to new, 1 is straight on."""
        if self.isotropic:
            return np.full(len(medium), 1 / (4 * math.pi))
        value = henyey_greenstein(self.g.take(medium), cosine)
        for m in self.lobed:
            at = np.flatnonzero(medium == m)
            if m in self.flakes:
                value[at] = between(self.phases[m], direction[:, at], new[:, at])
            else:
                value[at] = self.phases[m].value(cosine[at])
        return value

    def scatter(
        self, rng: np.random.Generator, medium: np.ndarray, direction: np.ndarray
    ) -> tuple[np.ndarray, np.ndarray]:
        """New directions (3, n) drawn from the phase function, and its value."""
        u, v = rng.random(len(medium)), rng.random(len(medium))
        if self.isotropic:
            return unit_sphere(u, v), np.full(len(medium), 1 / (4 * math.pi))
        cosine = henyey_greenstein_turn(self.g.take(medium), u)
        for m in self.lobed:
            if m not in self.flakes:
                at = np.flatnonzero(medium == m)
                cosine[at] = self.phases[m].draw(rng, len(at))
        new = about(direction, cosine, 2 * math.pi * v)
        for m in self.flakes:
            at = np.flatnonzero(medium == m)
            new[:, at] = onward(self.phases[m], rng, direction[:, at])
        return new, self.phase(medium, cosine, direction, new)


def attenuation(sigma: np.ndarray, distance: np.ndarray) -> np.ndarray:
    """exp(-sigma distance); 1 where sigma is 0, whatever the distance."""
    with np.errstate(invalid="ignore"):
        depth = sigma * distance
    depth[np.isnan(depth)] = 0
    return np.exp(-depth)
