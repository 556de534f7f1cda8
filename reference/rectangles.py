"""Rectangular lights by solid angle, for points near to them.

C. Urena, M. Fajardo, A. King, "An Area-Preserving Parametrization for Spherical Rectangles",
CGF 32(4), 2013, as there: by the angles between the planes through the edges.
"""

from __future__ import annotations

import numpy as np

from reference.scene import Scene
from reference.tracer import Tracer
from reference.vectors import cross, dot

#: Rectangles are sampled by area where their solid angle is below this, in sr.
LEAST = 1 / 16
_SQUARE = 2.0**-15  # cosine of the edges at most; gap of the fourth corner, in edges
_NEAR = 0.24  # squared gap over the area
_MOST_PAIRS = 1 << 22  # of a light and a primitive; beyond it every light counts as near


class Rectangles:
    """Shining pairs of triangles that make a rectangle and have something near in front of them.

    Near: of the axis-aligned boxes, at less than half the root of its area. count: how many.
    of (P,) int: the rectangle that a primitive belongs to, or -1. halves (2, R): its triangles; the
    second holds the points corner + a e1 + b e2 with a >= b.
    """

    def __init__(self, scene: Scene, tracer: Tracer, shining: np.ndarray) -> None:
        self.of = np.full(len(tracer.areas), -1)
        triangles = np.stack([tracer.v0, tracer.v0 + tracer.e1, tracer.v0 + tracer.e2])  # 3, 3, T
        surface = np.stack([scene.material, scene.emission, scene.boundary])
        many = len(shining) * len(tracer.areas) > _MOST_PAIRS
        found, taken = [], -1
        for i in shining[:-1]:
            if i <= taken or i + 1 >= tracer.count or i + 1 not in shining:
                continue
            if (surface[:, i] != surface[:, i + 1]).any():
                continue
            corners = _joined(triangles[:, :, i], triangles[:, :, i + 1])
            if corners is None or not (many or _near(corners, tracer.lowest, tracer.highest)):
                continue
            self.of[[i, i + 1]] = len(found)
            found.append((i, *corners))
            taken = i + 1
        self.count = len(found)
        first = np.array([i for i, *_ in found], int)
        self.halves = np.stack([first, first + 1])
        corner, end1, end2 = (np.array([f[k] for f in found]).reshape(-1, 3).T for k in (1, 2, 3))
        self.corner, e1, e2 = corner, end1 - corner, end2 - corner
        self.width, self.height = np.sqrt(dot(e1, e1)), np.sqrt(dot(e2, e2))
        self.x, self.y = e1 / self.width, e2 / self.height
        self.z = cross(self.x, self.y)

    def _seen(self, point: np.ndarray, rectangle: np.ndarray) -> tuple[np.ndarray, ...]:
        """x0, x1, y0, y1 and the height over the point, (n,) each."""
        to = self.corner.take(rectangle, axis=1) - point
        x0, y0, z = (dot(to, e.take(rectangle, axis=1)) for e in (self.x, self.y, self.z))
        return x0, x0 + self.width[rectangle], y0, y0 + self.height[rectangle], -z

    def solid_angle(self, point: np.ndarray, rectangle: np.ndarray) -> np.ndarray:
        """Of rectangles seen from points (3, n) before them; 0 or less from behind."""
        x0, x1, y0, y1, z = self._seen(point, rectangle)

        def corner(x: np.ndarray, y: np.ndarray) -> np.ndarray:
            return np.arctan2(x * y, z * np.sqrt(x**2 + y**2 + z**2))

        solid = corner(x1, y1) - corner(x0, y1) - corner(x1, y0) + corner(x0, y0)
        return np.where(z > 0, solid, 0)

    def wide(
        self, point: np.ndarray, primitive: np.ndarray
    ) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Which of n points sample a rectangle by solid angle, with its number and solid angle."""
        none = np.zeros(0, int)
        if not self.count:
            return none, none, np.zeros(0)
        at = np.flatnonzero(self.of[primitive] >= 0)
        rectangle = self.of[primitive[at]]
        solid = self.solid_angle(point[:, at], rectangle)
        kept = solid >= LEAST
        return at[kept], rectangle[kept], solid[kept]

    def sample(
        self, point: np.ndarray, rectangle: np.ndarray, u: np.ndarray, v: np.ndarray
    ) -> tuple[np.ndarray, np.ndarray]:
        """Places (3, n) uniform in solid angle, and in which half (n,) they are."""
        x0, x1, y0, y1, z = self._seen(point, rectangle)
        # the paper's z0 is -z; normals of the planes through the edges by their z components
        b0, b1 = -y0 / np.hypot(y0, z), y1 / np.hypot(y1, z)
        a0, a1 = x1 / np.hypot(x1, z), -x0 / np.hypot(x0, z)
        g0, g1 = np.arccos(-b0 * a0), np.arccos(-a0 * b1)
        g2, g3 = np.arccos(-b1 * a1), np.arccos(-a1 * b0)
        k = 2 * np.pi - g2 - g3
        angle = u * (g0 + g1 - k) + k
        f = (np.cos(angle) * b0 - b1) / np.sin(angle)
        c = np.sign(f) / np.sqrt(f**2 + b0**2)
        x = np.clip(c * z / np.sqrt(np.maximum(1 - c**2, 1e-300)), x0, x1)
        across = np.hypot(x, z)
        h0, h1 = y0 / np.hypot(across, y0), y1 / np.hypot(across, y1)
        h = h0 + v * (h1 - h0)
        y = np.clip(h * across / np.sqrt(np.maximum(1 - h**2, 1e-300)), y0, y1)
        a, b = x - x0, y - y0
        place = self.corner.take(rectangle, axis=1)
        place = place + a * self.x.take(rectangle, axis=1) + b * self.y.take(rectangle, axis=1)
        return place, (a / (x1 - x0) >= b / (y1 - y0)).astype(int)


def _joined(first: np.ndarray, second: np.ndarray) -> list[np.ndarray] | None:
    """Corner and the ends of both edges of the rectangle of two triangles (3, 3), if it is one.

    The first edge goes to the second triangle's own corner.
    """
    for i in range(3):
        for j in range(3):
            start, end, apex = first[i], first[(i + 1) % 3], first[(i + 2) % 3]
            if not (np.array_equal(start, second[(j + 1) % 3]) and np.array_equal(end, second[j])):
                continue
            other = second[(j + 2) % 3]
            e1, e2 = other - start, apex - start
            size = np.linalg.norm(e1) * np.linalg.norm(e2)
            gap = np.linalg.norm(start + e1 + e2 - end)
            least = min(np.linalg.norm(e1), np.linalg.norm(e2))
            if gap <= _SQUARE * least and abs(e1 @ e2) <= _SQUARE * size:
                return [start, other, apex]
    return None


def _near(corners: list[np.ndarray], low: np.ndarray, high: np.ndarray) -> bool:
    """Whether something comes near in front. low, high: boxes (3, P)."""
    start, end1, end2 = corners
    normal = np.cross(end1 - start, end2 - start)
    area = np.linalg.norm(normal)
    normal /= area
    box = np.array([start, end1, end2, end1 + end2 - start])
    reach = np.maximum(normal[:, None] * low, normal[:, None] * high).sum(axis=0)
    gap = np.maximum(np.maximum(low - box.max(axis=0)[:, None], box.min(axis=0)[:, None] - high), 0)
    front = reach > normal @ start + np.sqrt(area) / 256
    return bool((front & ((gap**2).sum(axis=0) < _NEAR * area)).any())
