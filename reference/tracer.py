"""Closest hits and visibility: Embree finds the triangle, float64 finds the point.

Embree (robust mode) works in float32 on coordinates relative to the triangles' centre and answers
one question only: which triangle is hit first. Distance, point and normal are then computed in
float64 from that triangle's plane, so float32 rounding can change a picture only through a
wrong choice of triangle. Spheres and disks are float64 throughout (``quadrics``).

Origins: the float64 point stays on its surface; only the copy handed to Embree is moved, along
the side's normal, by OFFSET of the triangles' half extent M. OFFSET = 2^-20 is 16 times the
rounding of a coordinate near M, so the own plane (and whatever is coplanar with it, such as a lamp
in its ceiling opening) lies behind the origin for Embree, too. The move cannot bias a picture by
crossing another surface: where a ray starts or ends within 4 OFFSET M of an edge of its triangle
(walls meet at edges), or where Embree's answer is the own triangle or disagrees with the float64
distance, the ray is traced again in float64, unmoved, against every triangle whose box it meets.
What is left is a surface that cuts through the inside of another triangle (a block on a floor):
points within OFFSET M of that line can see its wrong side. They are about 1e-6 of the area. Origins
on spheres and in media are not moved. Rays of the camera start at the triangles' box for Embree.

Surfaces that coincide count as one, and which of them is met is undefined.

Shadow rays ask for the closest hit and decide in float64: blocked means a primitive nearer than
the light point that is not the light and in whose plane that point does not lie, for a ray meets a
plane once. The lamp, its coplanar neighbours and everything behind it do not block, whichever of
them Embree names, and there is no epsilon along the ray.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from embreex.mesh_construction import TriangleMesh
from embreex.rtcore_scene import EmbreeScene

from reference.boxes import Boxes
from reference.quadrics import Quadrics
from reference.scene import Geometry
from reference.vectors import cross, dot

OFFSET = 2.0**-20
_RAYS = 1 << 10  # in the float64 fallback at a time


def embree_version() -> str:
    """Version of the embreex package, the Embree that it carries."""
    from importlib.metadata import version

    return f"embreex {version('embreex')}"


@dataclass
class Start:
    """What rays start on: own (n,) the primitive or -1; side (3, n) the unit normal of the side
    that they leave by, zero on spheres and in space; near (n,) bool, close to a triangle's edge.
    """

    own: np.ndarray
    side: np.ndarray
    near: np.ndarray

    def take(self, index: np.ndarray) -> Start:
        """The starts of some rays."""
        return Start(self.own.take(index), self.side.take(index, axis=1), self.near.take(index))


class Tracer:
    """Rays against a scene's geometry. All ray arrays are (3, n) float64, directions unit.

    normals (3, P) float64, unit, front side, zero for spheres; areas (P,) float64, world units
    squared; lowest, highest (3, P): their boxes; extent: radius of a ball that holds every shape.
    """

    def __init__(self, geometry: Geometry) -> None:
        triangles = geometry.triangles
        self.count = len(triangles)
        self.v0 = np.ascontiguousarray(triangles[:, 0].T)
        self.e1 = np.ascontiguousarray((triangles[:, 1] - triangles[:, 0]).T)
        self.e2 = np.ascontiguousarray((triangles[:, 2] - triangles[:, 0]).T)
        normal = cross(self.e1, self.e2)
        length = np.linalg.norm(normal, axis=0)
        normal /= np.where(length > 0, length, 1)
        self.quadrics = quadrics = Quadrics(geometry.spheres, geometry.inward, geometry.disks)
        self.normals = np.concatenate([normal, quadrics.normals], axis=1)
        self.planes = np.concatenate([dot(normal, self.v0), quadrics.planes])
        self.areas = np.concatenate(
            [length / 2, 4 * np.pi * quadrics.radius**2, np.pi * quadrics.area]
        )
        self.curved = np.zeros(len(self.planes), bool)
        self.curved[self.count : self.count + quadrics.spheres] = True
        self._bounds(geometry)
        self._embree(triangles, length)

    def _bounds(self, geometry: Geometry) -> None:
        spheres, disks = geometry.spheres, geometry.disks
        reach = np.sqrt(disks[:, 1] ** 2 + disks[:, 2] ** 2)  # half of a disk's box
        triangles, centre, radius = geometry.triangles, spheres[:, :3], spheres[:, 3:]
        self.lowest = np.concatenate(
            [triangles.min(axis=1), centre - radius, disks[:, 0] - reach]
        ).T
        self.highest = np.concatenate(
            [triangles.max(axis=1), centre + radius, disks[:, 0] + reach]
        ).T
        low, high = self.lowest.min(axis=1), self.highest.max(axis=1)
        self.middle, self.extent = (low + high) / 2, float(np.linalg.norm(high - low) / 2)
        self.on_plane = 1e-11 * (np.abs(high - low).max() / 2 + np.abs(self.middle).max())

    def _embree(self, triangles: np.ndarray, length: np.ndarray) -> None:
        longest = np.max(
            [np.linalg.norm(e, axis=0) for e in (self.e1, self.e2, self.e2 - self.e1)], axis=0
        )
        height = length / np.where(longest > 0, longest, 1)
        self.solid = height > 0
        self.empty = not self.solid.any()
        if self.empty:
            return
        corners = triangles.reshape(-1, 3)
        self.low, self.high = corners.min(axis=0), corners.max(axis=0)
        self.centre = (self.low + self.high) / 2
        extent = np.abs(self.high - self.low).max() / 2
        self.offset = OFFSET * extent
        self.agree = 1e-3 * extent
        self.margin = (4 * self.offset / np.where(height > 0, height, 1)).astype(np.float32)
        self.boxes = Boxes(triangles, self.solid, self.offset)
        self.scene = EmbreeScene(robust=True)
        local = (triangles - self.centre).astype(np.float32)
        index = np.arange(3 * len(local), dtype=np.int32).reshape(-1, 3)
        TriangleMesh(self.scene, local.reshape(-1, 3), index)

    # -- questions -----------------------------------------------------------------------------

    def closest(
        self, origin: np.ndarray, direction: np.ndarray, start: Start | None = None
    ) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """First primitive hit: (number (n,) -1 for none, t (n,), near a triangle's edge (n,) bool).

        Without ``start`` the rays come from outside every surface (a camera).
        """
        n = origin.shape[1]
        if self.empty:
            primitive, t = np.full(n, -1, np.int32), np.full(n, np.inf)
            near = np.zeros(n, bool)
        else:
            primitive, t, near = self._triangles(origin, direction, start)
        if self.quadrics.spheres or self.quadrics.disks:
            other, number = self._quadrics(origin, direction, start)
            nearer = np.flatnonzero(other < t)
            t[nearer], near[nearer] = other[nearer], False
            primitive[nearer] = number[nearer] + self.count
        return primitive, t, near

    def visible(
        self,
        origin: np.ndarray,
        direction: np.ndarray,
        distance: np.ndarray,
        start: Start,
        target: np.ndarray,
    ) -> np.ndarray:
        """True where nothing is nearer than ``distance`` (n,) but the primitive ``target`` (n,)."""
        clear = np.ones(origin.shape[1], bool)
        if not self.empty:
            triangle = self.scene.run(*self._inputs(origin, direction, start.side))
            height, rise = self._plane(origin, direction, triangle)
            wrong = ~(height * rise > 0)
            wrong |= triangle == start.own
            wrong &= triangle >= 0
            wrong |= start.near
            again = np.flatnonzero(wrong)
            if len(again):
                o, d = origin[:, again], direction[:, again]
                triangle[again] = self.brute(o, d, start.side[:, again])[0]
                height[again], rise[again] = self._plane(o, d, triangle[again])
            with np.errstate(divide="ignore", invalid="ignore"):
                blocked = height / rise < distance
                blocked &= np.abs(distance * rise - height) > self.on_plane
            blocked &= triangle >= 0
            clear = ~blocked
        if self.quadrics.spheres or self.quadrics.disks:
            t, number = self._quadrics(origin, direction, start)
            number[number >= 0] += self.count
            clear &= ~self.blocks(origin, direction, number, t, distance, target)
        return clear

    def blocks(
        self,
        origin: np.ndarray,
        direction: np.ndarray,
        primitive: np.ndarray,
        t: np.ndarray,
        distance: np.ndarray,
        target: np.ndarray,
    ) -> np.ndarray:
        """True where a first hit (``primitive`` at ``t``) lies before the end of a shadow ray."""
        height, rise = self._plane(origin, direction, primitive)
        with np.errstate(invalid="ignore"):
            off = np.abs(distance * rise - height) > self.on_plane
        off |= self.curved.take(np.maximum(primitive, 0))
        return (primitive >= 0) & (t < distance) & (primitive != target) & off

    def front(self, point: np.ndarray, primitive: np.ndarray) -> np.ndarray:
        """Unit geometric normals (3, n) of the front at points of primitives (none: zero)."""
        out = self.normals.take(np.maximum(primitive, 0), axis=1)
        if self.quadrics.spheres:
            on = np.flatnonzero(self.curved.take(np.maximum(primitive, 0)))
            out[:, on] = self.quadrics.sphere_normals(point[:, on], primitive[on] - self.count)
        return out

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

    # -- triangles -----------------------------------------------------------------------------

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

    def _ahead(self, origin: np.ndarray, direction: np.ndarray) -> np.ndarray:
        """Distance (n,) to the triangles' box, 0 inside and where it is missed."""
        with np.errstate(divide="ignore", invalid="ignore"):
            a = (self.low[:, None] - self.offset - origin) / direction
            b = (self.high[:, None] + self.offset - origin) / direction
        enter, leave = np.fmin(a, b).max(axis=0), np.fmax(a, b).min(axis=0)
        return np.where((enter > 0) & (enter <= leave), enter, 0.0)

    def _plane(
        self, origin: np.ndarray, direction: np.ndarray, primitive: np.ndarray
    ) -> tuple[np.ndarray, np.ndarray]:
        """Height of the plane of ``primitive`` over the origin, and the ray's rise (n,).

        Along the plane's normal; the first by the second is the distance to the plane.
        """
        primitive = np.maximum(primitive, 0)
        normal = self.normals.take(primitive, axis=1)
        height = self.planes.take(primitive)
        height -= dot(normal, origin)
        return height, dot(normal, direction)

    def _triangles(
        self, origin: np.ndarray, direction: np.ndarray, start: Start | None
    ) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        if start is None:
            ahead = self._ahead(origin, direction)
            inputs = self._inputs(origin + ahead * direction, direction, None)
        else:
            ahead, inputs = 0.0, self._inputs(origin, direction, start.side)
        found = self.scene.run(*inputs, output=True)
        triangle, u, v = found["primID"], found["u"], found["v"]
        hit = triangle >= 0
        with np.errstate(divide="ignore", invalid="ignore"):
            t = np.divide(*self._plane(origin, direction, triangle))
            wrong = ~((t > 0) & (np.abs(t - ahead - found["tfar"]) < self.agree))
        if start is not None:
            wrong |= triangle == start.own
        wrong &= hit
        if start is not None:
            wrong |= start.near
        t[~hit] = np.inf
        margin = self.margin.take(np.maximum(triangle, 0))
        near = np.minimum(np.minimum(u, v), 1 - u - v) < margin
        near &= hit
        wrong |= near
        again = np.flatnonzero(wrong)
        if len(again):
            side = None if start is None else start.side[:, again]
            triangle[again], t[again], near[again] = self.brute(
                origin[:, again], direction[:, again], side
            )
        return triangle, t, near

    def brute(
        self, origin: np.ndarray, direction: np.ndarray, side: np.ndarray | None
    ) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """As ``closest``, in float64 (Moeller and Trumbore 1997), for triangles alone.

        Triangles in the plane through the origin that ``side`` is normal to are left out.
        """
        n = origin.shape[1]
        triangle, best, near = np.full(n, -1, np.int32), np.full(n, np.inf), np.zeros(n, bool)
        for part in (slice(i, i + _RAYS) for i in range(0, n, _RAYS)):
            ray, number = self.boxes.pairs(origin[:, part], direction[:, part])
            o, d = origin[:, part].take(ray, axis=1), direction[:, part].take(ray, axis=1)
            e1, e2 = self.e1.take(number, axis=1), self.e2.take(number, axis=1)
            s = o - self.v0.take(number, axis=1)
            p, q = cross(d, e2), cross(s, e1)
            with np.errstate(divide="ignore", invalid="ignore"):
                scale = 1 / dot(e1, p)
                u, v, t = dot(s, p) * scale, dot(d, q) * scale, dot(e2, q) * scale
                ok = (u >= 0) & (v >= 0) & (u + v <= 1) & (t > 0)
            if side is not None:
                normal = self.normals.take(number, axis=1)
                height = dot(normal, o) - self.planes.take(number)
                mine = side[:, part].take(ray, axis=1)
                ok &= (np.abs(height) > self.on_plane) | (np.abs(dot(normal, mine)) < 1 - 1e-9)
            ok = np.flatnonzero(ok)
            order = ok[np.lexsort((number[ok], t[ok], ray[ok]))]
            row, first = np.unique(ray[order], return_index=True)
            pick, row = order[first], row + part.start
            triangle[row], best[row] = number[pick], t[pick]
            inside = np.minimum(np.minimum(u, v), 1 - u - v)[pick]
            near[row] = inside < self.margin[number[pick]]
        return triangle, best, near

    def _quadrics(
        self, origin: np.ndarray, direction: np.ndarray, start: Start | None
    ) -> tuple[np.ndarray, np.ndarray]:
        own = None if start is None else start.own - self.count
        return self.quadrics.closest(origin, direction, own, self.on_plane)
