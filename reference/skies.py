"""An image around the scene, in latitudes and longitudes.

The first row is at the local pole +y and the last at -y; columns have their centres half a column
from the seam at -z, and +x is a quarter further. Radiance is bilinear in the angles. A sample's
cell, between four texels, is drawn in proportion to its solid angle and the brightest of its
corners, by the sum over channels, and its direction uniformly in the cell.
"""

from __future__ import annotations

import math
from pathlib import Path

import numpy as np
import OpenEXR


def read_texels(path: Path) -> np.ndarray:
    """(H, W, 3) float64 from the channels R, G and B of an EXR file; KeyError if one is missing."""
    with OpenEXR.File(str(path), separate_channels=True) as file:
        channels = file.channels()
        return np.stack([channels[c].pixels for c in "RGB"], axis=-1).astype(np.float64)


class Sky:
    """texels (H, W, 3); turn (3, 3) takes local directions to the world. Of fewer than three rows
    the last is repeated."""

    def __init__(self, texels: np.ndarray, turn: np.ndarray) -> None:
        rows = np.minimum(np.arange(max(len(texels), 3)), len(texels) - 1)
        self.texels, self.turn = texels[rows].astype(np.float64), turn
        height, self.width, _ = self.texels.shape
        self.cells = height - 1
        light = self.texels.sum(axis=2)
        light = np.maximum(light, np.roll(light, -1, axis=1))
        edges = np.cos(math.pi * np.arange(height) / self.cells)
        self.edges = edges
        weight = np.maximum(light[:-1], light[1:]) * -np.diff(edges)[:, None]
        total = weight.sum()
        #: Light across a unit disc, about.
        self.power = math.pi * 2 * math.pi / self.width * total
        self.chance = weight / max(total, 1e-300)
        self.cdf = np.cumsum(self.chance)

    def _place(self, d: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
        """Row, column and place in the cell of world directions (3, n)."""
        x, y, z = np.linalg.solve(self.turn, d)
        polar = np.arctan2(np.hypot(x, z), y) / math.pi * self.cells
        row = np.clip(polar.astype(int), 0, self.cells - 1)
        turns = (np.arctan2(x, -z) / (2 * math.pi) * self.width - 0.5) % self.width
        column = turns.astype(int) % self.width
        return row, column, turns - np.floor(turns), polar - row

    def radiance(self, d: np.ndarray) -> np.ndarray:
        """(3, n) from world directions (3, n)."""
        row, column, s, t = self._place(d)
        beside = (column + 1) % self.width
        out = np.zeros((3, len(row)))
        for j, down in ((row, 1 - t), (row + 1, t)):
            for i, along in ((column, 1 - s), (beside, s)):
                out += self.texels[j, i].T * (down * along)
        return out

    def pdf(self, d: np.ndarray) -> np.ndarray:
        """Density (n,) per solid angle of sampled directions."""
        row, column, _, _ = self._place(d)
        return self.chance[row, column] / self._solid_angle(row)

    def _solid_angle(self, row: np.ndarray) -> np.ndarray:
        return (self.edges[row] - self.edges[row + 1]) * (2 * math.pi / self.width)

    def sample(self, rng: np.random.Generator, n: int) -> tuple[np.ndarray, np.ndarray]:
        """World directions (3, n) and their densities."""
        cell = np.searchsorted(self.cdf, rng.random(n) * self.cdf[-1], side="right")
        row, column = np.divmod(np.minimum(cell, self.cdf.size - 1), self.width)
        height = self.edges[row] + rng.random(n) * (self.edges[row + 1] - self.edges[row])
        azimuth = (column + 0.5 + rng.random(n)) * (2 * math.pi / self.width)
        sine = np.sqrt(np.maximum(1 - height**2, 0))
        local = np.stack([sine * np.sin(azimuth), height, -sine * np.cos(azimuth)])
        return self.turn @ local, self.chance[row, column] / self._solid_angle(row)
