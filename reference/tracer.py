"""Closest hits and visibility: Embree finds the triangle, float64 finds the point.

Embree (robust mode) works in float32 on coordinates relative to the scene's centre and answers
one question only: which triangle is hit first. Distance, point and normal are then computed in
float64 from that triangle's plane, so float32 rounding can change a picture only through a
wrong choice of triangle.

Origins: the float64 point stays on its surface; only the copy handed to Embree is moved, along
the side's normal, by OFFSET of the scene's half extent M. OFFSET = 2^-20 is 16 times the rounding
of a coordinate near M, so the own plane (and whatever is coplanar with it, such as a lamp in its
ceiling opening) lies behind the origin for Embree, too. The move cannot bias a picture by crossing
another surface: where a ray starts or ends within 4 OFFSET M of an edge of its triangle (walls
meet at edges), or where Embree's answer is the own triangle or disagrees with the float64
distance, the ray is traced again by brute force over all triangles in float64, unmoved. What is
left is a surface that cuts through the inside of another triangle (a block on a floor): points
within OFFSET M of that line can see its wrong side. They are about 1e-6 of the area.

Shadow rays ask for the closest hit and decide in float64: blocked means a triangle nearer than the
light point in whose plane that point does not lie, for a ray meets a plane once. The lamp, its
coplanar neighbours and everything behind it do not block, whichever of them Embree names, and
there is no epsilon along the ray.
"""

from __future__ import annotations

import numpy as np
from embreex.mesh_construction import TriangleMesh
from embreex.rtcore_scene import EmbreeScene

OFFSET = 2.0**-20
_BRUTE = 1 << 18  # ray-triangle pairs at a time


def embree_version() -> str:
    """Version of the embreex package, the Embree that it carries."""
    from importlib.metadata import version

    return f"embreex {version('embreex')}"


class Tracer:
    """Rays against triangles (T, 3, 3) float64. All ray arrays are (3, n) float64.

    normals (3, T) float64, unit, front side; areas (T,) float64, world units squared.
    """

    def __init__(self, triangles: np.ndarray) -> None:
        self.v0 = np.ascontiguousarray(triangles[:, 0].T)
        self.e1 = np.ascontiguousarray((triangles[:, 1] - triangles[:, 0]).T)
        self.e2 = np.ascontiguousarray((triangles[:, 2] - triangles[:, 0]).T)
        cross = np.cross(self.e1, self.e2, axis=0)
        length = np.linalg.norm(cross, axis=0)
        self.areas = length / 2
        self.normals = cross / np.where(length > 0, length, 1)
        self.planes = np.einsum("ij,ij->j", self.normals, self.v0)
        low, high = triangles.min(axis=(0, 1)), triangles.max(axis=(0, 1))
        self.centre = (low + high) / 2
        extent = np.abs(high - low).max() / 2
        self.offset = OFFSET * extent
        self.agree = 1e-3 * extent
        self.on_plane = 1e-11 * (extent + np.abs(self.centre).max())
        longest = np.max(
            [np.linalg.norm(e, axis=0) for e in (self.e1, self.e2, self.e2 - self.e1)], axis=0
        )
        height = length / np.where(longest > 0, longest, 1)
        self.margin = (4 * self.offset / np.where(height > 0, height, 1)).astype(np.float32)
        self.solid = height > 0
        self.scene = EmbreeScene(robust=True)
        local = (triangles - self.centre).astype(np.float32)
        self.empty = not self.solid.any()
        if not self.empty:
            index = np.arange(3 * len(local), dtype=np.int32).reshape(-1, 3)
            TriangleMesh(self.scene, local.reshape(-1, 3), index)

    def overlapping(self, triangle: int) -> int:
        """A triangle that shares some of the area of ``triangle`` in its plane; -1 for none.

        By separating axes, up to an overlap 1e-6 of the scene's half extent wide.
        """
        corners = np.stack([self.v0, self.v0 + self.e1, self.v0 + self.e2], axis=1)  # (3, 3, T)
        normal = self.normals[:, triangle]
        height = np.abs(np.tensordot(normal, corners, 1) - self.planes[triangle]).max(axis=0)
        other = np.flatnonzero((height < 1e-3 * self.agree) & self.solid)
        other = other[other != triangle]
        ahead = self.e1[:, triangle] / np.linalg.norm(self.e1[:, triangle])
        flat = np.tensordot(np.stack([ahead, np.cross(normal, ahead)]), corners, 1)  # (2, 3, T)
        a, b = flat[:, :, [triangle]], flat[:, :, other]
        overlap = np.full(len(other), np.inf)
        for shape in (a, b):
            edge = shape - np.roll(shape, 1, axis=1)
            edge /= np.linalg.norm(edge, axis=0)
            axis = np.stack([edge[1], -edge[0]])
            pa, pb = (np.einsum("ien,icn->cen", axis, x) for x in (a, b))
            shared = np.minimum(pa.max(0), pb.max(0)) - np.maximum(pa.min(0), pb.min(0))
            overlap = np.minimum(overlap, shared.min(axis=0))
        found = other[overlap > 1e-3 * self.agree]
        return int(found[0]) if len(found) else -1

    def _inputs(
        self, origin: np.ndarray, direction: np.ndarray, side: np.ndarray | None
    ) -> tuple[np.ndarray, np.ndarray]:
        """Embree's float32 (n, 3) copies; ``side`` is the unit normal to move origins along."""
        o = np.empty(origin.shape[::-1], np.float32)
        d = np.empty(o.shape, np.float32)
        for axis in range(3):
            moved = origin[axis] - self.centre[axis]
            if side is not None:
                moved += self.offset * side[axis]
            o[:, axis] = moved
            d[:, axis] = direction[axis]
        return o, d

    def _plane(
        self, origin: np.ndarray, direction: np.ndarray, triangle: np.ndarray
    ) -> tuple[np.ndarray, np.ndarray]:
        """Height of the plane of ``triangle`` over the origin, and the ray's rise (n,).

        Along the plane's normal; the first by the second is the distance to the plane.
        """
        triangle = np.maximum(triangle, 0)
        normal = self.normals.take(triangle, axis=1)
        height = self.planes.take(triangle)
        height -= _dot(normal, origin)
        return height, _dot(normal, direction)

    def closest(
        self,
        origin: np.ndarray,
        direction: np.ndarray,
        own: np.ndarray | None = None,
        side: np.ndarray | None = None,
        edge: np.ndarray | None = None,
    ) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """First triangle hit: (triangle (n,) -1 for none, t (n,) float64, near edge (n,) bool).

        ``own`` is the triangle that a ray starts on, ``side`` the unit normal of the side that it
        leaves by, ``edge`` whether it starts near an edge.
        """
        n = origin.shape[1]
        if self.empty:
            return np.full(n, -1), np.full(n, np.inf), np.zeros(n, bool)
        found = self.scene.run(*self._inputs(origin, direction, side), output=True)
        triangle, u, v = found["primID"], found["u"], found["v"]
        hit = triangle >= 0
        with np.errstate(divide="ignore", invalid="ignore"):
            t = np.divide(*self._plane(origin, direction, triangle))
            wrong = ~((t > 0) & (np.abs(t - found["tfar"]) < self.agree))
        wrong &= hit
        if own is not None:
            wrong |= triangle == own
            wrong |= edge
        t[~hit] = np.inf
        margin = self.margin.take(np.maximum(triangle, 0))
        near = np.minimum(np.minimum(u, v), 1 - u - v) < margin
        near &= hit
        wrong |= near
        again = np.flatnonzero(wrong)
        if len(again):
            triangle[again], t[again], near[again] = self.brute(
                origin[:, again], direction[:, again], None if own is None else own[again]
            )
        return triangle, t, near

    def visible(
        self,
        origin: np.ndarray,
        direction: np.ndarray,
        distance: np.ndarray,
        own: np.ndarray,
        side: np.ndarray,
        edge: np.ndarray,
    ) -> np.ndarray:
        """True where nothing is nearer than ``distance`` (n,); direction has unit length."""
        triangle = self.scene.run(*self._inputs(origin, direction, side))
        height, rise = self._plane(origin, direction, triangle)
        wrong = ~(height * rise > 0)
        wrong |= triangle == own
        wrong &= triangle >= 0
        wrong |= edge
        again = np.flatnonzero(wrong)
        if len(again):
            o, d = origin[:, again], direction[:, again]
            triangle[again] = self.brute(o, d, own[again])[0]
            height[again], rise[again] = self._plane(o, d, triangle[again])
        with np.errstate(divide="ignore", invalid="ignore"):
            blocked = height / rise < distance
            blocked &= np.abs(distance * rise - height) > self.on_plane
        blocked &= triangle >= 0
        return ~blocked

    def brute(
        self, origin: np.ndarray, direction: np.ndarray, own: np.ndarray | None
    ) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """As ``closest``, in float64 over every triangle (Moeller and Trumbore 1997).

        Triangles coplanar with ``own`` are left out.
        """
        n = origin.shape[1]
        triangle, best, near = np.full(n, -1, np.int32), np.full(n, np.inf), np.zeros(n, bool)
        step = max(1, _BRUTE // len(self.solid))
        for part in (slice(i, i + step) for i in range(0, n, step)):
            o, d = origin[:, part, None], direction[:, part, None]
            e1, e2 = self.e1[:, None], self.e2[:, None]
            with np.errstate(divide="ignore", invalid="ignore"):
                p = _cross(d, e2)
                scale = 1 / _dot(e1, p)
                s = o - self.v0[:, None]
                u = _dot(s, p) * scale
                q = _cross(s, e1)
                v = _dot(d, q) * scale
                t = _dot(e2, q) * scale
                ok = (u >= 0) & (v >= 0) & (u + v <= 1) & (t > 0) & self.solid
            if own is not None:
                normals, mine = self.normals[:, None], self.normals[:, own[part], None]
                ok &= (np.abs(_dot(normals, o) - self.planes) > self.on_plane) | (
                    np.abs(_dot(normals, mine)) < 1 - 1e-9
                )
            t[~ok] = np.inf
            first = t.argmin(axis=1)
            row = np.arange(len(first))
            best[part] = t[row, first]
            hit = best[part] < np.inf
            triangle[part] = np.where(hit, first, -1)
            inside = np.minimum(np.minimum(u, v), 1 - u - v)[row, first]
            near[part] = hit & (inside < self.margin[first])
        return triangle, best, near


def _cross(a: np.ndarray, b: np.ndarray) -> np.ndarray:
    return np.stack(
        [a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]]
    )


def _dot(a: np.ndarray, b: np.ndarray) -> np.ndarray:
    out = a[0] * b[0]
    out += a[1] * b[1]
    out += a[2] * b[2]
    return out
