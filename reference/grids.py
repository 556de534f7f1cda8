"""Grids of numbers in space, in float64: values, and optical depths along rays by integration.

Source: Mitsuba 3 documentation, "Volumes"; what it leaves open was measured with mitsuba 3.9.1: a
grid's extinction is none outside of the box around its unit cube. Along a ray, between the planes
through the cells' centres (of the filter nearest: between the cells), the value is a polynomial of
the third degree, known from four points, and integrated exactly ("regular tracking").
"""

from __future__ import annotations

import itertools
import struct
from dataclasses import dataclass
from pathlib import Path

import numpy as np

_PLACES = np.array([0.05, 0.35, 0.65, 0.95])
_POWERS = np.linalg.inv(np.vander(_PLACES, 4, increasing=True))  # values there -> coefficients


@dataclass(frozen=True, eq=False)
class Grid:
    """cells (Z, Y, X, 1 or 3); to_world (4, 4) of the unit cube. wrap: repeat, mirror or clamp."""

    cells: np.ndarray
    to_world: np.ndarray
    wrap: str = "clamp"
    nearest: bool = False

    @property
    def grey(self) -> bool:
        """One number a cell."""
        return self.cells.shape[3] == 1

    def corners(self) -> np.ndarray:
        """Of the unit cube in world space (3, 8)."""
        cube = np.array(list(itertools.product((0, 1), repeat=3)), float).T
        return self.to_world[:3, :3] @ cube + self.to_world[:3, 3:]

    def local(self, point: np.ndarray) -> np.ndarray:
        """Points (3, n) in the unit cube's coordinates."""
        return np.linalg.solve(self.to_world[:3, :3], point - self.to_world[:3, 3:])

    def at(self, point: np.ndarray) -> np.ndarray:
        """Values (3, n) at points (3, n)."""
        size = self.cells.shape[2::-1]
        axes = [self._weights(x, n) for x, n in zip(self.local(point), size, strict=True)]
        out = np.zeros((3, point.shape[1]))
        for (x, wx), (y, wy), (z, wz) in itertools.product(*axes):
            out += self.cells[z, y, x].T * (wx * wy * wz)
        return out

    def _weights(self, x: np.ndarray, n: int) -> list[tuple[np.ndarray, np.ndarray]]:
        if self.nearest:
            return [(self._wrapped(np.floor(x * n), n), np.ones_like(x))]
        first = np.floor(x * n - 0.5)
        share = x * n - 0.5 - first
        return [(self._wrapped(first, n), 1 - share), (self._wrapped(first + 1, n), share)]

    def _wrapped(self, k: np.ndarray, n: int) -> np.ndarray:
        if self.wrap == "clamp":
            return np.clip(k, 0, n - 1).astype(int)
        if self.wrap == "repeat":
            return np.mod(k, n).astype(int)
        k = np.mod(k, 2 * n)
        return np.where(k < n, k, 2 * n - 1 - k).astype(int)

    def knots(self, origin: np.ndarray, direction: np.ndarray, limit: np.ndarray) -> np.ndarray:
        """Distances (K, n), rising, within the box and the limit: the way in and out, and the
        planes between. All alike where a ray misses the box."""
        corners = self.corners()
        low, high = corners.min(axis=1)[:, None], corners.max(axis=1)[:, None]
        with np.errstate(all="ignore"):
            a, b = (low - origin) / direction, (high - origin) / direction
            first, last = np.fmin(a, b).max(axis=0), np.fmax(a, b).min(axis=0)
        first = np.maximum(first, 0)
        last = np.maximum(np.minimum(last, limit), first)
        missed = ~np.isfinite(first + last)
        first[missed], last[missed] = 0, 0
        box = np.array(list(itertools.product(*zip(low[:, 0], high[:, 0], strict=True)))).T
        inside = self.local(box)
        start = self.local(origin)
        way = np.linalg.solve(self.to_world[:3, :3], direction)
        rows = [first, last]
        shift = 0.0 if self.nearest else 0.5
        for k, n in enumerate(self.cells.shape[2::-1]):
            least, most = np.floor(inside[k].min() * n), np.ceil(inside[k].max() * n)
            for plane in np.arange(least - 1, most + 1):
                with np.errstate(all="ignore"):
                    t = ((plane + shift) / n - start[k]) / way[k]
                rows.append(np.clip(np.where(np.isfinite(t), t, first), first, last))
        return np.sort(rows, axis=0)

    def along(
        self, origin: np.ndarray, direction: np.ndarray, limit: np.ndarray
    ) -> tuple[np.ndarray, np.ndarray]:
        """The knots (K, n), and the values between each two as powers of the share of the way from
        one to the other: coefficients (4, 3, K - 1, n)."""
        knots = self.knots(origin, direction, limit)
        a, b = knots[:-1], knots[1:]
        t = a + (b - a) * _PLACES[:, None, None]
        points = origin[:, None, None] + direction[:, None, None] * t
        values = self.at(points.reshape(3, -1)).reshape(3, *t.shape)
        return knots, np.einsum("pq,cqkn->pckn", _POWERS, values)


def integral(powers: np.ndarray, length: np.ndarray, share: np.ndarray | float) -> np.ndarray:
    """Of coefficients (4, ...) over the first `share` of a piece of that length."""
    total = sum(powers[p] * share ** (p + 1) / (p + 1) for p in range(4))
    return total * length


def read_vol(path: Path) -> tuple[np.ndarray, np.ndarray]:
    """Cells (Z, Y, X, C) and the box (2, 3) of a .vol file of version 3."""
    data = path.read_bytes()
    magic, version, encoding, x, y, z, channels = struct.unpack_from("<3sB5i", data)
    if (magic, version, encoding) != (b"VOL", 3, 1) or channels not in (1, 3, 6):
        raise ValueError("no .vol file of version 3 with 1, 3 or 6 float32 a cell")
    box = np.frombuffer(data, "<f4", 6, 24).reshape(2, 3).astype(float)
    cells = np.frombuffer(data, "<f4", x * y * z * channels, 48).astype(float)
    return cells.reshape(z, y, x, channels), box
