"""Curves with a radius, as tubes of triangles with smooth normals.

A linear curve is the surface around the spheres at its control points and the cones that touch both
of two in a row; a B-spline curve is made of the circles around a uniform cubic spline, across it,
and open at its ends. Both are Mitsuba's, whose curves cannot be hit from within: these can.

The circles become polygons of N sides with their corners on them, thinner by up to
1 - cos(pi / N) of the radius: 1.2e-3 with 64 sides, 4.8e-3 with 32, 1.9e-2 with 16, 7.6e-2 with 8.
The rings of a spline stand so close that a chord of its middle line is no further from it than that
share of its largest radius, or 1e-5 of its control points' second differences if that is more;
rings of a sphere about 360 / N degrees apart. N is the first of SIDES that takes no more than FEW
triangles. u goes once around, v along the curves of a file, one after the other; u is not cut at 1:
a texture must repeat to have no seam there.
"""

from __future__ import annotations

from dataclasses import dataclass, fields
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

from .. import transform
from ..errors import SceneError
from ..numeric import MAX_COORDINATE, sin_cos_degrees
from .mesh import MAX_BYTES, Mesh, angles, cross, dot, unit
from .node import parse_float, read_bytes, shorten

Array = npt.NDArray[Any]
SIDES = (64, 32, 16, 8)
FEW, MANY = 2_000_000, 50_000_000  # triangles of a shape: for more, fewer sides; an error
KINDS = {"linearcurve": 2, "bsplinecurve": 4}  # and the control points of a segment
_TWO_PI = 6.283185307179586


@dataclass
class _Rings:
    """Circles around points, a row each. Their points are centre + radius (along axis + across e)
    with unit vectors e across the axis; the normals there are up axis + (out - radius e . bend) e.

    place: segment, part of it, and number in that part, by which they are put in order.
    """

    place: Array
    v: Array
    axis: Array
    centre: Array
    radius: Array
    along: Array
    across: Array
    up: Array
    out: Array
    bend: Array


def read(path: Path, kind: str, matrix: Array, where: str) -> tuple[Mesh, int, int]:
    """The mesh of a file whose points are moved by `matrix`, radii as they are; also its sides and
    how many curves it has. Raises SceneError for a file that is missing, damaged or empty."""
    name = f'"filename" = {shorten(str(path))}'
    points, starts = _points(read_bytes(path, MAX_BYTES, where), name, KINDS[kind], where)
    with np.errstate(all="ignore"):
        points[:, :3] = transform.apply(matrix, points[:, :3])
    if not (np.abs(points) <= MAX_COORDINATE).all():
        raise SceneError(f"{name}: a control point exceeds {MAX_COORDINATE:g}", where)
    first, fresh = _segments(starts, len(points), KINDS[kind])
    cones = _cones(points, first, fresh) if kind == "linearcurve" else None
    for sides in SIDES:
        pieces = _halves(cones, sides) if cones else _pieces(points, first, sides)
        count = (
            (2.0 * pieces.sum() + 2 * len(first) + sides * len(starts)) if cones else pieces.sum()
        )
        triangles = 2 * sides * float(count)  # about
        if triangles <= FEW:
            break
    if triangles > MANY:
        raise SceneError(
            f"{name}: {len(starts)} curves of {sides} sides are {triangles:.3g} triangles; at most "
            f"{MANY}",
            where,
        )
    counts = pieces.astype(np.int64)
    if cones:
        rings = _linear(points, first, fresh, cones, counts, sides)
    else:
        rings = _spline(points, first, fresh, counts)
    mesh = _tubes(rings, fresh, sides)
    if not len(mesh.triangles):
        why = "the points of each are one" if points[:, 3].any() else "all radii are 0"
        raise SceneError(f"{name}: the curves have no surface, as {why}", where)
    return mesh, sides, len(starts)


def _points(data: bytes, name: str, fewest: int, where: str) -> tuple[Array, Array]:
    """Control points (P, 4) with radii, and the first of each curve."""
    rows: list[list[float]] = []
    starts: list[int] = []
    fresh = True
    for number, line in enumerate(data.split(b"\n"), 1):
        words = line.split()
        if not words:
            fresh = True
            continue
        place = f"{name}, line {number}"
        if len(words) != 4:
            raise SceneError(f"{place}: {len(words)} words, expected x y z radius", where)
        row = [parse_float(word.decode("utf-8", "replace"), place, where) for word in words]
        if row[3] < 0:
            raise SceneError(f"{place}: the radius {row[3]:g} is below 0", where)
        if fresh:
            starts.append(len(rows))
            fresh = False
        rows.append(row)
    if not rows:
        raise SceneError(f"{name} holds no control points", where)
    counts = np.diff(starts, append=len(rows))
    if counts.min() < fewest:
        number = int(np.argmax(counts < fewest))
        raise SceneError(
            f"{name}: curve {number} has {counts[number]} control points, expected {fewest} or "
            "more",
            where,
        )
    return np.array(rows), np.array(starts)


def _segments(starts: Array, count: int, width: int) -> tuple[Array, Array]:
    """The first point of each segment of `width` points, and whether it begins a curve."""
    counts = np.diff(starts, append=count) - (width - 1)
    fresh = np.zeros(counts.sum(), np.bool_)
    fresh[np.cumsum(counts) - counts] = True
    return np.arange(len(fresh)) + (np.cumsum(fresh) - 1) * (width - 1), fresh


def _filled(axis: Array, fresh: Array) -> Array:
    """Axes, those of length 0 exchanged for the one before in their curve, else the one behind,
    else z."""
    good: Array = np.any(axis != 0, axis=1)
    number = np.arange(len(axis))
    curve = np.cumsum(fresh)
    before = np.maximum.accumulate(np.where(good, number, 0))
    behind = np.minimum.accumulate(np.where(good, number, len(axis) - 1)[::-1])[::-1]
    result = np.tile([0.0, 0.0, 1.0], (len(axis), 1))
    for near in (behind, before):
        fits = good[near] & (curve[near] == curve)
        result[fits] = axis[near[fits]]
    return result


# ---- linear curves ----

_CAP, _BEGIN, _END, _JOINT = range(4)  # parts of a segment


@dataclass
class _Cones:
    """Axes (S, 3) of segments, how far their normals lean towards these, and the segments that turn
    from the one before: in a circle over `middle`, as far as `chord`."""

    axis: Array
    lean: Array
    rows: Array
    middle: Array
    chord: Array


def _cones(points: Array, first: Array, fresh: Array) -> _Cones:
    step = points[first + 1] - points[first]
    length = np.sqrt(dot(step[:, :3], step[:, :3]))
    axis = _filled(unit(step[:, :3]), fresh)
    lean = np.sign(-step[:, 3])  # 1: a sphere in the other
    cone = length > np.abs(step[:, 3])
    lean[cone] = -step[cone, 3] / length[cone]
    turns = np.append(True, (axis[1:] != axis[:-1]).any(axis=1) | (lean[1:] != lean[:-1]))
    rows = np.flatnonzero(turns & ~fresh)
    before, behind = axis[rows - 1], axis[rows]
    middle = unit(before + behind)
    split: Array = np.any(middle != 0, axis=1)
    middle = np.where(split[:, None], middle, _frame(before)[0])
    half, leaning = middle - before, _tilt(lean[rows]) - _tilt(lean[rows - 1])
    chord = 2.0 * np.sqrt(dot(half, half)) + np.sqrt(dot(leaning, leaning))
    return _Cones(axis, lean, rows, middle, chord)


def _tilt(lean: Array) -> Array:
    """Unit vectors of so much along the axis, and the rest across it."""
    return np.stack([lean, np.sqrt((1.0 - lean) * (1.0 + lean)), 0.0 * lean], axis=1)


def _halves(cones: _Cones, sides: int) -> Array:
    """Half the pieces of each turn; 1.3 for chords instead of arcs, unevenly spaced."""
    return np.ceil(np.maximum(0.5 * 1.3 * cones.chord * sides / _TWO_PI, 1.0))


def _linear(
    points: Array, first: Array, fresh: Array, cones: _Cones, halves: Array, sides: int
) -> _Rings:
    """The two ends of each cone, and rings of the spheres at the ends and between cones."""
    axis, lean = cones.axis, cones.lean
    number, ends, begins = np.arange(len(first)), np.append(fresh[1:], True), fresh.copy()
    begins[cones.rows] = True
    latitudes = np.array([-sin_cos_degrees(360.0 * k / sides)[1] for k in range(sides // 2)])

    def rings(rows: Array, point: int, part: int, sub: Any, axes: Array, leans: Array) -> _Rings:
        """Rings of the spheres at first + point, around an axis each."""
        zero, across = np.zeros(len(rows)), np.sqrt((1.0 - leans) * (1.0 + leans))
        place = np.stack([rows, zero + part, zero + sub], axis=1)
        middle = points[first[rows] + point]
        return _Rings(place, (rows + point) / len(first), axes, middle[:, :3], middle[:, 3],
                      leans, across, leans, across, np.zeros((len(rows), 3)))  # fmt: skip

    parts = []
    for point, part, rows in ((0, _BEGIN, np.flatnonzero(begins)), (1, _END, number)):
        parts.append(rings(rows, point, part, 0, axis[rows], lean[rows]))
    for point, part, there, sign in ((0, _CAP, fresh, 1.0), (1, _JOINT, ends, -1.0)):
        rows, sub = np.nonzero(there[:, None] & (latitudes < sign * lean[:, None]))
        parts.append(rings(rows, point, part, sign * sub, axis[rows], sign * latitudes[sub]))
    count = 2 * halves - 1
    of = np.repeat(np.arange(len(count)), count)
    sub = np.arange(len(of)) - np.repeat(np.cumsum(count) - count, count) + 1
    share, rows, middle = (sub / halves[of])[:, None], cones.rows[of], cones.middle[of]
    axes = np.where(
        share < 1,
        axis[rows - 1] + share * (middle - axis[rows - 1]),
        middle + (share - 1.0) * (axis[rows] - middle),
    )
    old, new = _tilt(lean[rows - 1]), _tilt(lean[rows])
    leans = np.clip(unit(old + 0.5 * share * (new - old))[:, 0], -1.0, 1.0)
    parts.append(rings(rows - 1, 1, _JOINT, sub, unit(axes), leans))
    columns = [np.concatenate([getattr(part, f.name) for part in parts]) for f in fields(_Rings)]
    order = np.lexsort(columns[0].T[::-1])
    return _Rings(*(column[order] for column in columns))


# ---- B-spline curves ----


def _pieces(points: Array, first: Array, sides: int) -> Array:
    """How many pieces a segment needs for its chords to be near it."""
    a, b, c, d = (points[first + k] for k in range(4))
    with np.errstate(all="ignore"):
        squares = [dot(x, x) + x[:, 3] * x[:, 3] for x in (a - 2 * b + c, b - 2 * c + d)]
        bends = np.sqrt(np.maximum(*squares))
        share = 1.0 - sin_cos_degrees(180.0 / sides)[1]
        largest = np.maximum(np.maximum(a[:, 3], b[:, 3]), np.maximum(c[:, 3], d[:, 3]))
        pieces = np.ceil(np.sqrt(bends / (8.0 * np.maximum(share * largest, 1e-5 * bends))))
    return np.where(largest > 0, np.maximum(pieces, 1.0), 1.0)


def _spline(points: Array, first: Array, fresh: Array, pieces: Array) -> _Rings:
    """Rings across a uniform cubic B-spline; the last of each curve at its end."""
    counts = pieces + np.append(fresh[1:], True)
    of = np.repeat(np.arange(len(first)), counts)
    sub = np.arange(len(of)) - np.repeat(np.cumsum(counts) - counts, counts)
    v = (sub / pieces[of])[:, None]
    a, b, c, d = (points[first[of] + k] for k in range(4))
    w = 1.0 - v
    place = (w * w * w * a + (4.0 - 3.0 * v * v * (1.0 + w)) * b
             + (4.0 - 3.0 * w * w * (1.0 + v)) * c + v * v * v * d) / 6.0  # fmt: skip
    speed = 0.5 * (w * w * (b - a) + (1.0 + 2.0 * v * w) * (c - b) + v * v * (d - c))
    bend = w * (a - 2.0 * b + c) + v * (b - 2.0 * c + d)
    new = fresh[of] & (sub == 0)
    square, zero = dot(speed[:, :3], speed[:, :3]), np.zeros(len(of))
    bend = np.where((square > 0)[:, None], bend[:, :3], 0.0)  # else the normal is across the axis
    return _Rings(np.stack([of, zero, sub], axis=1), (of + v[:, 0]) / len(first),
                  _filled(unit(speed[:, :3]), new), place[:, :3], place[:, 3], zero, zero + 1.0,
                  -speed[:, 3] * np.sqrt(square), square, bend)  # fmt: skip


# ---- tubes ----


def _frame(axis: Array) -> tuple[Array, Array]:
    """Unit vectors across axes where u = 0 and u = 1/4, as in Mitsuba."""
    x, y, z = axis.T
    up = np.array([0.0, 0.0, 1.0]) - axis * z[:, None]
    quarter = unit(np.where((np.abs(z) == 1.0)[:, None], [0.0, 1.0, 0.0], up))
    return cross(quarter, axis), quarter


def _tubes(rings: _Rings, fresh: Array, sides: int) -> Mesh:
    """The mesh of rings in their order; fresh: segments that begin a curve."""
    curve = np.cumsum(fresh)[rings.place[:, 0].astype(np.int64)]
    starts = np.flatnonzero(np.diff(curve, prepend=0))
    across, u = _untwisted(rings.axis, starts)
    other = cross(rings.axis, across)
    columns = sides + 1
    turns = [sin_cos_degrees(360.0 * (k % sides) / sides) for k in range(columns)]
    corners, normals = np.empty((2, len(u), columns, 3))
    foot = rings.centre + (rings.radius * rings.along)[:, None] * rings.axis
    reach = rings.radius * rings.across
    for k, (sine, cosine) in enumerate(turns):
        e = cosine * across + sine * other
        corners[:, k] = foot + reach[:, None] * e
        out = rings.out - rings.radius * dot(e, rings.bend)
        normal = unit(rings.up[:, None] * rings.axis + out[:, None] * e)
        known: Array = np.any(normal != 0, axis=1)
        normals[:, k] = np.where(known[:, None], normal, e)
    uv = np.empty((len(u), columns, 2))
    uv[..., 0], uv[..., 1] = u[:, None] + np.arange(columns) / sides, rings.v[:, None]
    vertices = corners.reshape(-1, 3)
    row = np.flatnonzero(curve[1:] == curve[:-1])[:, None] * columns + np.arange(sides)
    a, b, c, d = row, row + 1, row + columns + 1, row + columns
    faces = np.stack([a, b, c, a, c, d], axis=2).reshape(-1, 3)
    tips = [(vertices[faces[:, k]] == vertices[faces[:, k - 1]]).all(axis=1) for k in range(3)]
    faces = faces[~(tips[0] | tips[1] | tips[2])]
    return Mesh(vertices, faces, normals.reshape(-1, 3), uv.reshape(-1, 2))


def _untwisted(axis: Array, starts: Array) -> tuple[Array, Array]:
    """A unit vector across each axis, the same but for the turn of the axis within a curve, and the
    u that belongs to it, without jumps where that can be."""
    zero, quarter = _frame(axis)
    across, u = zero.copy(), np.zeros(len(axis))
    counts = np.diff(starts, append=len(axis))
    order = np.argsort(-counts, kind="stable")
    left = np.searchsorted(-counts[order], -np.arange(counts.max()), side="left")
    for k in range(1, counts.max()):
        here = starts[order[: left[k]]] + k
        old, new, e = axis[here - 1], axis[here], across[here - 1]
        near = 1.0 + dot(old, new)
        turn = np.where(near > 1e-9, dot(e, new) / np.where(near > 1e-9, near, 1.0), 0.0)
        e = e - turn[:, None] * (old + new)
        across[here] = unit(e - dot(e, new)[:, None] * new)
    sine = dot(across, quarter)
    u = np.where(sine < 0, -1.0, 1.0) * angles(across, zero) / _TWO_PI
    for k in range(1, counts.max()):
        here = starts[order[: left[k]]] + k
        u[here] += np.round(u[here - 1] - u[here])
    return across, u
