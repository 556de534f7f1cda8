"""How much of a light sample's light arrives: blockers, passes and media on the way."""

from __future__ import annotations

import numpy as np

from reference.lights import Sample
from reference.materials import Materials
from reference.media import Media
from reference.scene import Scene
from reference.tracer import Start, Tracer
from reference.vectors import dot

_STEPS = 262143


class Shadows:
    """Shadow rays of one scene."""

    def __init__(self, scene: Scene, tracer: Tracer, materials: Materials, media: Media) -> None:
        self.scene, self.tracer, self.materials, self.media = scene, tracer, materials, media

    def light(
        self, point: np.ndarray, start: Start, sample: Sample, medium: np.ndarray | None
    ) -> tuple[np.ndarray, np.ndarray | float]:
        """(indices of the samples that arrive, their transmittance (3, k) or 1).

        ``medium`` (n,) is what the rays are in at ``point`` (3, n), -1 vacuum; None: no media.
        """
        if self.materials.passes:
            return self._through(point, start, sample, medium)
        seen = np.flatnonzero(
            self.tracer.visible(point, sample.direction, sample.distance, start, sample.target)
        )
        if medium is None:
            return seen, 1.0
        return seen, self._attenuation(
            medium.take(seen),
            sample.distance.take(seen),
            point[:, seen],
            sample.direction[:, seen],
        )

    def _attenuation(
        self, medium: np.ndarray, distance: np.ndarray, origin: np.ndarray, direction: np.ndarray
    ) -> np.ndarray:
        out = np.ones((3, len(medium)))
        at = np.flatnonzero(medium >= 0)
        out[:, at] = self.media.transmittance(
            medium[at], distance[at], origin[:, at], direction[:, at]
        )
        return out

    def _through(
        self, point: np.ndarray, start: Start, sample: Sample, medium: np.ndarray | None
    ) -> tuple[np.ndarray, np.ndarray]:
        """As ``light``, from surface to surface."""
        n = point.shape[1]
        through, arrived = np.ones((3, n)), np.zeros(n, bool)
        ray, direction, target = np.arange(n), sample.direction, sample.target
        left = sample.distance
        for _ in range(_STEPS):
            primitive, t, near = self.tracer.closest(point, direction, start)
            met = self.tracer.blocks(point, direction, primitive, t, left, target)
            if medium is not None:
                through[:, ray] *= self._attenuation(
                    medium, np.where(met, t, left), point, direction
                )
            arrived[ray[~met]] = True
            at = np.flatnonzero(met)
            m = self.scene.material.take(primitive[at])
            point = point[:, at] + direction[:, at] * t[at]
            front = self.tracer.front(point, primitive[at])
            ahead = dot(front, direction[:, at])
            share = self.materials.passing(m, ahead, self.scene.geometry, primitive[at], point)
            through[:, ray[at]] *= share
            open_ = (share > 0).any(axis=0)
            if not open_.any():
                break
            at, point, ahead = at[open_], point[:, open_], ahead[open_]
            ray, direction, target = ray[at], direction[:, at], target[at]
            primitive, left = primitive[at], left[at] - t[at]
            side = front[:, open_] * np.where(ahead < 0, -1.0, 1.0)
            side[:, self.tracer.curved.take(primitive)] = 0
            start = Start(primitive, side, near[at])
            if medium is not None:
                medium = medium[at]
                boundary = self.scene.boundary.take(primitive)
                new = np.flatnonzero(boundary >= 0)
                side_of = (ahead[new] >= 0).astype(np.int64)
                medium[new] = self.scene.boundaries[boundary[new], side_of]
        seen = np.flatnonzero(arrived)
        return seen, through[:, seen]
