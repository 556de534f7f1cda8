"""Triangles of polygons that are not convex.

Readers make a polygon a fan around its first corner. Where a fan covers places outside of the
polygon, or places twice, the polygon is a fan around another corner instead, the first whose
triangles all turn as the polygon does. Polygons without one are cut along diagonals, which lie
inside of them: below the leftmost corner, or from there to the corner that is in the way (M. de
Berg and others, Computational Geometry, 2008, section 3.2). Corners may be in one place, as where a
polygon has a hole that a bridge joins to its outline.

On which side of a diagonal a corner lies is found exactly, for the polygon's projection along an
axis: by float64 where a bound on its error (J. R. Shewchuk, Discrete & Computational Geometry 18,
1997) leaves no doubt, else by integers.
"""

from __future__ import annotations

from typing import Any

import numpy as np
import numpy.typing as npt

from ..chunks import in_chunks

Array = npt.NDArray[Any]
#: A polygon of more corners stays a fan: cutting takes time as their square.
MOST = 4096
_GRAIN = 1 << 13  # polygons of a piece
#: Of the sum of both products of an area, its rounding at most (3.34e-16), and underflow of them.
_ERROR, _LEAST = 2.0**-51, 2.0**-1000


def unfolded(vertices: Array, fans: Array, parts: int | Array) -> Array:
    """Triangles (T, 3) of corners, by numbers, where `fans` (T, 3) are those of fans.

    vertices: the places (T, 3) of a fan's corners by their numbers are vertices[number]. parts: of
    each polygon, how many triangles it has. The result is `fans` itself if all are right; others
    have as many triangles, in the same place, with the same front.
    """
    if len(fans) == 0 or np.max(parts) < 2 or fans.min() < 0 or fans.max() >= len(vertices):
        return fans
    count = len(fans) // parts if isinstance(parts, int) else len(parts)
    lengths = np.broadcast_to(np.asarray(parts, np.int64), count)
    starts = np.concatenate([[0], np.cumsum(lengths)])

    def look(first: int, last: int) -> Array:
        with np.errstate(all="ignore"):
            area = _areas(vertices, fans[starts[first] : starts[last]])
            at = starts[first:last] - starts[first]
            whole = np.repeat(np.add.reduceat(area, at), lengths[first:last], axis=0)
            along = area[:, 0] * whole[:, 0] + area[:, 1] * whole[:, 1] + area[:, 2] * whole[:, 2]
            return first + np.flatnonzero(np.minimum.reduceat(along, at) < 0)

    wrong = np.concatenate(in_chunks(look, count, _GRAIN))
    wrong = wrong[lengths[wrong] + 2 <= MOST]
    if not len(wrong):
        return fans
    result = np.array(fans)
    for length in np.unique(lengths[wrong]).tolist():
        alike = wrong[lengths[wrong] == length]
        for piece in np.array_split(alike, len(alike) * length // _GRAIN + 1):
            rows = starts[piece, None] + np.arange(length)
            turned, right = _turned(vertices, fans[rows])
            result[rows[right]] = turned[right]
            for row in rows[~right]:
                result[row] = _diagonals(vertices, fans[row])
    return result


def _turned(vertices: Array, fans: Array) -> tuple[Array, Array]:
    """Of polygons (P, T, 3) alike in length, fans around another corner, and which are right."""
    count, length, _ = fans.shape
    rings = np.concatenate([fans[:, 0, :2], fans[:, :, 2]], axis=1)
    result, right = np.array(fans), np.zeros(count, bool)
    with np.errstate(all="ignore"):
        whole = _areas(vertices, fans.reshape(-1, 3)).reshape(fans.shape).sum(axis=1)
        for first in range(1, length + 2):
            left = np.flatnonzero(~right)
            if not len(left):
                break
            ring = np.roll(rings[left], -first, axis=1)
            fan = np.stack([ring[:, :1].repeat(length, 1), ring[:, 1:-1], ring[:, 2:]], axis=2)
            area = _areas(vertices, fan.reshape(-1, 3)).reshape(fan.shape)
            found = ((area * whole[left, None]).sum(axis=2) >= 0).all(axis=1)
            result[left[found]] = fan[found]
            right[left[found]] = True
    return result, right


def _diagonals(vertices: Array, fan: Array) -> Array:
    """The triangles (T, 3) of a polygon by diagonals; its fan where that covers no more, as may be
    if edges cross."""
    ring = np.concatenate([fan[0, :2], fan[:, 2]])
    places = vertices[ring].astype(np.float64)
    if not np.isfinite(places).all():
        return fan
    with np.errstate(all="ignore"):
        x, y = _flat(places, _areas(vertices, fan).sum(axis=0))
        cut = ring[np.array(_cut(x, y))]
        return cut if _covered(vertices, cut) < _covered(vertices, fan) else fan


def _areas(vertices: Array, triangles: Array) -> Array:
    """Twice the areas of triangles, as vectors (T, 3)."""
    a, b, c = (vertices[triangles[:, k]] for k in range(3))
    (ux, uy, uz), (vx, vy, vz) = (b - a).T, (c - a).T
    return np.stack([uy * vz - uz * vy, uz * vx - ux * vz, ux * vy - uy * vx], axis=1)


def _covered(vertices: Array, triangles: Array) -> float:
    """The sum of the areas, twice."""
    return float(np.sqrt((_areas(vertices, triangles) ** 2).sum(axis=1)).sum())


def _flat(points: Array, normal: Array) -> Array:
    """Two of the coordinates (2, N), in which the polygon with this normal is counter-clockwise."""
    axis = int(np.abs(normal).argmax())
    pair: Array = points[:, [(axis + 1) % 3, (axis + 2) % 3]].T
    return pair if normal[axis] > 0 else pair[::-1]


class _Sides:
    """Twice the areas of triangles of corners, with exact signs."""

    def __init__(self, x: Array, y: Array) -> None:
        self.x, self.y = x, y
        self.whole: list[tuple[int, int]] | None = None

    def areas(self, a: Any, b: Any, c: Any) -> tuple[Array, Array]:
        """The areas of triangles, positive where c is left of the line from a to b, and bounds on
        their errors."""
        x, y = self.x, self.y
        one, other = (x[b] - x[a]) * (y[c] - y[a]), (x[c] - x[a]) * (y[b] - y[a])
        return one - other, _ERROR * (np.abs(one) + np.abs(other)) + _LEAST

    def exact(self, a: int, b: int, c: int) -> int:
        """The area of a triangle times a power of 2, the same for all of them."""
        if self.whole is None:
            ratios = [value.as_integer_ratio() for value in (*self.x.tolist(), *self.y.tolist())]
            scale = max(below for _, below in ratios)
            numbers = [above * (scale // below) for above, below in ratios]
            count = len(self.x)
            self.whole = list(zip(numbers[:count], numbers[count:], strict=True))
        (ax, ay), (bx, by), (cx, cy) = self.whole[a], self.whole[b], self.whole[c]
        return (bx - ax) * (cy - ay) - (cx - ax) * (by - ay)

    def __call__(self, a: Any, b: Any, c: Any) -> Array:
        """Numbers with the exact signs of areas."""
        area, error = self.areas(a, b, c)
        for k in np.flatnonzero(~(np.abs(area) > error)).tolist():
            corners = (int(np.broadcast_to(at, area.shape)[k]) for at in (a, b, c))
            exact = self.exact(*corners)
            area[k] = (exact > 0) - (exact < 0)
        return area

    def farthest(self, a: int, b: int, corners: Array) -> Array:
        """Which of some corners left of a line are farthest from it, all that are equally far."""
        area, error = self.areas(a, b, corners)
        near: Array = ~(area + error < (area - error).max())
        if near.sum() > 1:
            exact = {k: self.exact(a, b, int(corners[k])) for k in np.flatnonzero(near).tolist()}
            most = max(exact.values())
            near[:] = [exact.get(k) == most for k in range(len(corners))]
        return near


def _cut(x: Array, y: Array) -> list[tuple[int, int, int]]:
    """Triangles of a counter-clockwise polygon, by its corners."""
    left = _Sides(x, y)
    result: list[tuple[int, int, int]] = []
    todo = [np.arange(len(x))]
    while todo:
        ring = todo.pop()
        ring = np.roll(ring, -int(np.lexsort((y[ring], x[ring]))[0]))
        v, after, before = (int(ring[k]) for k in (0, 1, -1))
        if len(ring) == 3:
            result.append((v, after, before))
            continue
        others = ring[2:-1]
        inside = (left(before, v, others) >= 0) & (left(v, after, others) >= 0)
        inside &= (left(after, before, others) > 0) & ((x[others] != x[v]) | (y[others] != y[v]))
        if not inside.any():
            result.append((v, after, before))
            todo.append(ring[1:])
            continue
        far = 2 + np.flatnonzero(inside)
        far = far[left.farthest(after, before, ring[far])]
        # of corners in one place the one on whose inner side v is
        p, back, on = ring[far], ring[far - 1], ring[(far + 1) % len(ring)]
        convex = left(p, on, back) >= 0
        between = (left(p, v, back) > 0) & (left(v, p, on) > 0)
        beyond = (left(p, v, on) >= 0) & (left(v, p, back) >= 0)
        sees = np.where(convex, between, ~beyond)
        at = int(far[int(sees.argmax())])
        todo += [ring[: at + 1], np.append(ring[at:], v)]
    return result
