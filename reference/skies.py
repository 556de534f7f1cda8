"""An image around the scene, in latitudes and longitudes.

The first row is at the local pole +y and the last at -y; columns have their centres half a column
from the seam at -z, and +x is a quarter further. Radiance is bilinear in the angles. A sample is
drawn, by rejection within a cell of four texels, in proportion to what is bilinear between weights
at the cell's corners: the sum over channels times the sine of the polar angle. At a pole, where the
sine is 0, a texel's sum counts for its neighbour away from the pole. Compensated, what a sum
exceeds the mean over the sphere by takes its place, if something does.
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
    the last is repeated. compensated: for light samples, what is below the mean does not count."""

    def __init__(self, texels: np.ndarray, turn: np.ndarray, compensated: bool = False) -> None:
        rows = np.minimum(np.arange(max(len(texels), 3)), len(texels) - 1)
        self.texels, self.turn = texels[rows].astype(np.float64), turn
        height, self.width, _ = self.texels.shape
        self.cells = height - 1
        self.area = 2 * math.pi / self.width * math.pi / self.cells
        light = self.texels.sum(axis=2)
        #: Light across a unit disc, about.
        self.power = math.pi * self.area * self._corners(light).mean(axis=0).sum()
        if compensated:
            # The sine's integral with a tent of width h about a row, of the poles half of one.
            h = math.pi / self.cells
            share = 2 * (1 - math.cos(h)) / h * np.sin(h * np.arange(height))
            share[[0, -1]] = 1 - math.sin(h) / h
            above = np.maximum(light - share @ light.mean(axis=1) / 2, 0)
            if above.max() > 1e-6 * light.max():
                light = above
        self.corners = self._corners(light)
        weight = self.corners.mean(axis=0)
        self.scale = 1 / max(weight.sum() * self.area, 1e-300)
        self.cdf = np.cumsum(weight) / max(weight.sum(), 1e-300)

    def _corners(self, light: np.ndarray) -> np.ndarray:
        """Weights by corner: upper left, upper right, lower left, lower right."""
        height = self.cells + 1
        sine = np.sin(math.pi * np.arange(height) / self.cells)[:, None]
        upper, lower = light[:-1] * sine[:-1], light[1:] * sine[1:]
        lower[0] += light[0] * sine[1]
        upper[-1] += light[-1] * sine[-2]
        rolled = [np.roll(x, -1, axis=1) for x in (upper, lower)]
        return np.stack([upper, rolled[0], lower, rolled[1]])

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

    def _weight(
        self, row: np.ndarray, column: np.ndarray, s: np.ndarray, t: np.ndarray
    ) -> np.ndarray:
        a, b, c, d = self.corners[:, row, column]
        return (a * (1 - s) + b * s) * (1 - t) + (c * (1 - s) + d * s) * t

    def pdf(self, d: np.ndarray) -> np.ndarray:
        """Density (n,) per solid angle of sampled directions."""
        row, column, s, t = self._place(d)
        sine = np.sin((row + t) * math.pi / self.cells)
        return self._weight(row, column, s, t) * self.scale / np.where(sine > 0, sine, np.inf)

    def sample(self, rng: np.random.Generator, n: int) -> tuple[np.ndarray, np.ndarray]:
        """World directions (3, n) and their densities."""
        cell = np.searchsorted(self.cdf, rng.random(n) * self.cdf[-1], side="right")
        row, column = np.divmod(np.minimum(cell, self.cdf.size - 1), self.width)
        s, t, todo = np.empty(n), np.empty(n), np.arange(n)
        while len(todo):
            s[todo], t[todo] = rng.random(len(todo)), rng.random(len(todo))
            i, j = row[todo], column[todo]
            most = self.corners[:, i, j].max(axis=0)
            todo = todo[rng.random(len(todo)) * most >= self._weight(i, j, s[todo], t[todo])]
        polar = (row + t) * math.pi / self.cells
        azimuth = (column + 0.5 + s) * (2 * math.pi / self.width)
        sine = np.sin(polar)
        local = np.stack([sine * np.sin(azimuth), np.cos(polar), -sine * np.cos(azimuth)])
        return self.turn @ local, self._weight(row, column, s, t) * self.scale / sine
