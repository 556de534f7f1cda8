"""Which rays may meet which triangles, in float64: a tree of boxes, walked level by level.

The exact fallback behind Embree for rays that float32 can not decide. Triangles are sorted along a
Morton curve and halved; all rays go down together as (ray, box) pairs, without early ends, which is
quick for the few rays that need it and simple enough to be trusted.
"""

from __future__ import annotations

import numpy as np

_LEAF = 8  # triangles


class Boxes:
    """Boxes over triangles (T, 3, 3), padded by ``pad``; ``solid`` (T,) tells which count."""

    def __init__(self, triangles: np.ndarray, solid: np.ndarray, pad: float) -> None:
        low, high = triangles.min(axis=1), triangles.max(axis=1)
        centre = (low + high) / 2
        self.order = np.flatnonzero(solid)
        self.order = self.order[np.argsort(_morton(centre[self.order]), kind="stable")]
        rest = -len(self.order) % _LEAF
        self.order = np.concatenate([self.order, np.full(rest, -1)]).astype(np.int64)
        low, high = low[self.order] - pad, high[self.order] + pad
        low[self.order < 0], high[self.order < 0] = np.inf, -np.inf
        low, high = (x.reshape(-1, _LEAF, 3) for x in (low, high))
        self.levels = [(low.min(axis=1), high.max(axis=1))]
        while len(self.levels[-1][0]) > 1:
            low, high = self.levels[-1]
            if len(low) % 2:
                low = np.concatenate([low, np.full((1, 3), np.inf)])
                high = np.concatenate([high, np.full((1, 3), -np.inf)])
            self.levels.append(
                (low.reshape(-1, 2, 3).min(axis=1), high.reshape(-1, 2, 3).max(axis=1))
            )

    def pairs(self, origin: np.ndarray, direction: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """(ray, triangle) indices of all pairs whose boxes the ray (3, n) meets at t >= 0."""
        ray, box = np.arange(origin.shape[1]), np.zeros(origin.shape[1], np.int64)
        with np.errstate(divide="ignore"):
            o, inverse = origin.T, 1 / direction.T
        for depth, (low, high) in enumerate(reversed(self.levels)):
            if depth:
                ray, box = np.repeat(ray, 2), np.repeat(2 * box, 2)
                box[1::2] += 1
                inside = box < len(low)
                ray, box = ray[inside], box[inside]
            with np.errstate(invalid="ignore"):
                a = (low[box] - o[ray]) * inverse[ray]
                b = (high[box] - o[ray]) * inverse[ray]
            enter = np.fmax(np.fmin(a, b).max(axis=1), 0)
            met = (enter <= np.fmax(a, b).min(axis=1)) & (low[box, 0] <= high[box, 0])
            ray, box = ray[met], box[met]
        triangle = self.order[(box[:, None] * _LEAF + np.arange(_LEAF)).ravel()]
        ray = np.repeat(ray, _LEAF)
        return ray[triangle >= 0], triangle[triangle >= 0]


def _morton(points: np.ndarray) -> np.ndarray:
    """Codes (n,) of points (n, 3): 16 bits an axis, interleaved."""
    if not len(points):
        return np.zeros(0, np.uint64)
    low, high = points.min(axis=0), points.max(axis=0)
    cell = ((points - low) / np.where(high > low, high - low, 1) * 65535).astype(np.uint64)
    code = np.zeros(len(points), np.uint64)
    for bit in range(16):
        for axis in range(3):
            code |= ((cell[:, axis] >> np.uint64(bit)) & np.uint64(1)) << np.uint64(3 * bit + axis)
    return code
