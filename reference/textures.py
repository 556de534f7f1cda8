"""Textures of diffuse surfaces and of lights: bitmaps, checkerboards and colours of meshes, in
float64.

Source: Mitsuba 3 documentation, "Textures"; what it leaves open was measured with mitsuba 3.9.1.
Row 0 of a bitmap is at v = 0; texel k of n fills [k / n, (k + 1) / n), with its colour at the
middle. Where surfaces have their coordinates (``coordinates``):

=========== ======================================================================================
rectangle   (0, 0) to (1, 1) from the corner (-1, -1) to (1, 1)
cube        on each face from the corner (1, -1), see ``shapes``
disk        (r, angle from x towards y / 2 pi)
sphere      (angle about z from x towards y / 2 pi, angle from z / pi), in local space
=========== ======================================================================================
"""

from __future__ import annotations

import io
import math
from dataclasses import dataclass

import numpy as np
from PIL import Image

from reference.scene import Geometry


@dataclass(frozen=True, eq=False)
class Texture:
    """texels (H, W, 3), linear; or of a checkerboard its two colours (1, 2, 3).

    kind: "bitmap", "checkerboard" or "mesh_attribute". to_uv (2, 3). wrap: repeat, mirror or clamp.
    name: of the attribute, which is a factor of the one texel.
    """

    kind: str
    texels: np.ndarray
    to_uv: np.ndarray
    wrap: str = "repeat"
    nearest: bool = False
    name: str = ""

    def on(self, geometry: Geometry, primitive: np.ndarray, point: np.ndarray) -> np.ndarray:
        """Colours (3, n) at points (3, n) of primitives (n,)."""
        if not self.name:
            return self.at(coordinates(geometry, primitive, point))
        corners = geometry.colours[primitive].transpose(1, 2, 0)
        weights = barycentric(geometry, primitive, point)
        mixed = sum(w * c for w, c in zip(weights, corners, strict=True))
        return np.asarray(mixed) * self.texels[0, 0][:, None]

    def at(self, uv: np.ndarray) -> np.ndarray:
        """Colours (3, n) at coordinates (2, n)."""
        u, v = self.to_uv[:, :2] @ uv + self.to_uv[:, 2:]
        if self.kind == "checkerboard":
            odd = (np.floor(2 * u) + np.floor(2 * v)) % 2
            return self.texels[0, odd.astype(int)].T
        out = np.zeros((3, len(u)))
        height, width, _ = self.texels.shape
        for row, in_row in self.weights(v, height):
            for column, in_column in self.weights(u, width):
                out += self.texels[row, column].T * (in_row * in_column)
        return out

    def slope(self, uv: np.ndarray) -> np.ndarray:
        """Growth (2, n) of the grey of an interpolated bitmap with u and v; 0 of the others."""
        if self.nearest:
            return np.zeros_like(uv)
        place = self.to_uv[:, :2] @ uv + self.to_uv[:, 2:]
        height, width, _ = self.texels.shape
        columns, rows = self.weights(place[0], width), self.weights(place[1], height)
        grey = self.texels @ [0.212671, 0.71516, 0.072169]
        along = [sum(weight * (grey[row, columns[1][0]] - grey[row, columns[0][0]])
                     for row, weight in rows) * width,
                 sum(weight * (grey[rows[1][0], column] - grey[rows[0][0], column])
                     for column, weight in columns) * height]  # fmt: skip
        return self.to_uv[:, :2].T @ np.array(along)

    def mean(self) -> float:
        """Of all texels and channels."""
        return float(self.texels.mean())

    def weights(self, x: np.ndarray, n: int) -> list[tuple[np.ndarray, np.ndarray]]:
        """Texels along an axis of n, and their weights, which add up to 1."""
        if self.nearest:
            return [(self.wrapped(np.floor(x * n), n), np.ones_like(x))]
        first = np.floor(x * n - 0.5)
        centre = first + 0.5
        return [(self.wrapped(first + k, n), 1 - np.abs(x * n - (centre + k))) for k in (0.0, 1.0)]

    def wrapped(self, k: np.ndarray, n: int) -> np.ndarray:
        """The texel in [0, n) that stands at place k of the endless row."""
        if self.wrap == "clamp":
            return np.clip(k, 0, n - 1).astype(int)
        if self.wrap == "mirror":
            k = np.mod(k, 2 * n)
            return np.where(k < n, k, 2 * n - 1 - k).astype(int)
        return np.mod(k, n).astype(int)


def decoded(data: bytes, raw: bool) -> np.ndarray:
    """Texels (H, W, 3) of an 8-bit image file: sRGB (IEC 61966-2-1) unless raw."""
    codes = np.asarray(Image.open(io.BytesIO(data)).convert("RGB")) / 255
    if raw:
        return codes
    return np.where(codes <= 0.04045, codes / 12.92, ((codes + 0.055) / 1.055) ** 2.4)


def coordinates(geometry: Geometry, primitive: np.ndarray, point: np.ndarray) -> np.ndarray:
    """(u, v) (2, n) at points (3, n) of primitives (n,)."""
    triangles, spheres, _ = geometry.counts
    out = np.zeros((2, len(primitive)))
    at = np.flatnonzero(primitive < triangles)
    weights = barycentric(geometry, primitive[at], point[:, at])
    corner = geometry.uv[primitive[at]].transpose(1, 2, 0)
    out[:, at] = sum(weight * uv for weight, uv in zip(weights, corner, strict=True))
    at = np.flatnonzero((primitive >= triangles) & (primitive < triangles + spheres))
    number = primitive[at] - triangles
    away = point[:, at] - geometry.spheres[number, :3].T
    x, y, z = np.einsum("nij,jn->in", geometry.frames[number], away)
    radius = np.sqrt(x * x + y * y + z * z)
    out[:, at] = _turns(x, y), np.arccos(np.clip(z / radius, -1, 1)) / math.pi
    at = np.flatnonzero(primitive >= triangles + spheres)
    number = primitive[at] - triangles - spheres
    centre, *axes = geometry.disks[number].transpose(1, 2, 0)
    away = point[:, at] - centre
    gram = np.array([[(p * q).sum(0) for q in axes] for p in axes])
    sides = np.array([(p * away).sum(0) for p in axes])
    x, y = np.linalg.solve(gram.transpose(2, 0, 1), sides.T[:, :, None])[:, :, 0].T
    x, y = np.where(geometry.turned[number], (y, x), (x, y))
    out[:, at] = np.hypot(x, y), _turns(x, y)
    return out


def barycentric(geometry: Geometry, triangle: np.ndarray, p: np.ndarray) -> list[np.ndarray]:
    """Shares (n,) of the corners, by areas seen along the normal."""
    a, b, c = geometry.triangles[triangle].transpose(1, 2, 0)
    normal = np.cross(b - a, c - a, axis=0)
    return [
        (np.cross(s - r, p - r, axis=0) * normal).sum(0) / (normal * normal).sum(0)
        for r, s in ((b, c), (c, a), (a, b))
    ]


def _turns(x: np.ndarray, y: np.ndarray) -> np.ndarray:
    return np.arctan2(y, x) / (2 * math.pi) % 1
