"""Triangles of polygons that are not convex.

Readers make a polygon a fan around its first corner. Where a fan covers places outside of the
polygon, or places twice, the polygon is cut along diagonals instead, which lie inside of it: below
its leftmost corner, or from there to the corner that is in the way (M. de Berg and others,
Computational Geometry, 2008, section 3.2). Corners may be in one place, as where a polygon has a
hole that a bridge joins to its outline.
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

    result = fans
    for k in np.concatenate(in_chunks(look, count, _GRAIN)):
        fan = fans[starts[k] : starts[k + 1]]
        if len(fan) + 2 > MOST:
            continue
        ring = np.concatenate([fan[0, :2], fan[:, 2]])
        with np.errstate(all="ignore"):
            x, y = _flat(vertices[ring], _areas(vertices, fan).sum(axis=0))
            cut = ring[np.array(_cut(x, y))]
            if _covered(vertices, cut) < _covered(vertices, fan):
                result = np.array(fans) if result is fans else result
                result[starts[k] : starts[k + 1]] = cut
    return result


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


def _cut(x: Array, y: Array) -> list[tuple[int, int, int]]:
    """Triangles of a counter-clockwise polygon, by its corners."""

    def left(a: Any, b: Any, c: Any) -> Any:
        """Twice the area of triangles: positive where c is left of the line from a to b."""
        return (x[b] - x[a]) * (y[c] - y[a]) - (x[c] - x[a]) * (y[b] - y[a])

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
        ahead = left(after, before, others)
        inside = (left(before, v, others) >= 0) & (left(v, after, others) >= 0) & (ahead > 0)
        inside &= (x[others] != x[v]) | (y[others] != y[v])
        if not inside.any():
            result.append((v, after, before))
            todo.append(ring[1:])
            continue
        far = 2 + np.flatnonzero(inside & (ahead == ahead[inside].max()))
        # of corners in one place the one on whose inner side v is
        p, back, on = ring[far], ring[far - 1], ring[(far + 1) % len(ring)]
        convex = left(p, on, back) >= 0
        between = (left(p, v, back) > 0) & (left(v, p, on) > 0)
        beyond = (left(p, v, on) >= 0) & (left(v, p, back) >= 0)
        sees = np.where(convex, between, ~beyond)
        at = int(far[int(sees.argmax())])
        todo += [ring[: at + 1], np.append(ring[at:], v)]
    return result
