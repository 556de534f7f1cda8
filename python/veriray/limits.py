"""Details of a scene too fine for float32: docs/limits.md, as warnings of `veriray info`.

Positions are float32 in a frame whose origin the native scene chooses (its `frame`), so they are
rounded to 6e-8 of their distance from it. Each check gives a list of texts, empty if all is well.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from typing import Any

import numpy as np
import numpy.typing as npt

from .columns import LIGHT_KINDS
from .scene import Scene

Array = npt.NDArray[Any]

#: Least radians of a pixel: with a lens or in a medium; with a pinhole, whose rays start at what it
#: sees.
PIXEL, PINHOLE_PIXEL = 1e-6, 1e-7
#: Share of its distance from the frame's origin below which a length is lost.
LENGTH = 1e-6
#: Mean free paths from the frame's origin beyond which a medium may be 0.5 % off.
FREE_PATHS = 1e5
#: Scatterings per path beyond which a render takes its time.
SCATTERINGS = 1e4
#: Largest number of triangles among which near ones are sought, and of neighbours of each.
MOST_TRIANGLES, NEIGHBOURS = 1 << 16, 32

_ROUNDING = 2.0**-24


def warnings(scene: Scene, origin: Sequence[float]) -> list[str]:
    """Everything beyond the limits; origin: of the frame, in world space."""
    centre = np.array(origin, np.float64)
    checks = (media, small_shapes, near_faces, near_lamps)
    with np.errstate(all="ignore"):
        found = [text for check in checks for text in check(scene, centre)]
        return [*narrow_view(scene), *found]


def narrow_view(scene: Scene) -> list[str]:
    """Pixels narrower than the steps of directions."""
    film, camera = scene.film, scene.camera
    if camera.projection == "orthographic":
        return []
    angle = 2 * camera.tan_half_x(film.width, film.height) / film.width
    least = PIXEL if camera.aperture_radius > 0 or camera.medium >= 0 else PINHOLE_PIXEL
    if angle >= least:
        return []
    return [f"a pixel is {angle:.2g} rad wide: below {least:g} rad directions show steps"]


def media(scene: Scene, origin: Array) -> list[str]:
    """Mean free paths near the rounding of positions; paths with very many scatterings."""
    sigma_t, albedo, boundaries = (
        np.asarray(getattr(scene, name)) for name in ("sigma_t", "albedo", "boundaries")
    )
    found: list[str] = []
    boxes = _all_boxes(scene, origin) if len(sigma_t) else {}
    for k in range(len(sigma_t)):
        parts = []
        for kind, box in boxes.items():
            bounds = np.isin(getattr(scene, f"{kind}_boundary"), np.argwhere(boundaries == k)[:, 0])
            parts.append(box[:, bounds | (k == scene.camera.medium)])
        low, high = np.concatenate(parts, axis=1)
        thick = float(sigma_t[k].max())
        if not len(low) or not thick:
            continue
        far = thick * float(np.sqrt((np.maximum(-low, high) ** 2).sum(axis=1)).max())
        depth = thick * float((high.max(axis=0) - low.min(axis=0)).max())
        name = _name(scene, f"sigma_t[{k}]")
        if far > FREE_PATHS:
            found.append(
                f"{name} reaches {far:.2g} free paths from the frame's origin: positions are "
                f"rounded to {_ROUNDING * far:.1g} of a free path; above {FREE_PATHS:g} light may "
                "be 0.5 % off"
            )
        scatterings = min(depth, 1 / max(1 - float(albedo[k].max()), 1e-300))
        if scatterings > SCATTERINGS and not 0 <= scene.max_depth < SCATTERINGS:
            found.append(f"{name} has an optical depth of {depth:.2g}: this takes its time")
    return found


def small_shapes(scene: Scene, origin: Array) -> list[str]:
    """Primitives smaller than the rounding of positions."""
    found = []
    for kind in ("triangle", "sphere", "disk"):
        low, high = primitive_boxes(scene, kind, origin)
        size, away = (_longest(x) for x in (high - low, (high + low) / 2))
        rows = np.flatnonzero((size > 0) & (size < LENGTH * away))
        if len(rows):
            more = f" and {len(rows) - 1:,} more" if len(rows) > 1 else ""
            found.append(
                f"{_name(scene, f'{kind}s[{rows[0]}]')}{more}: smaller than {LENGTH:g} of the "
                "distance from the frame's origin"
            )
    return found


def near_faces(scene: Scene, origin: Array) -> list[str]:
    """Parallel triangles, one above the other, in planes that rounding does not keep apart.

    Up to MOST_TRIANGLES are examined, each with those of the NEIGHBOURS next planes.
    """
    if not 1 < len(scene.triangles) <= MOST_TRIANGLES:
        return []
    for one, other, gap in parallel_pairs(scene, origin, np.arange(len(scene.triangles)), 1e-12,
                                          LENGTH):  # fmt: skip
        names = [_name(scene, f"triangles[{row}]") for row in (one, other)]
        return [
            f"the gap between {names[0]} and {names[1]} is {gap:.1g} of their distance from the "
            f"frame's origin: below {LENGTH:g} they may change places"
        ]
    return []


def parallel_pairs(
    scene: Scene, origin: Array, rows: Array, least: float, most: float, same_side: bool = False
) -> Iterator[tuple[int, int, float]]:
    """Triangles of `rows` in parallel planes, one above the other: their numbers, and the gap.

    least, most: of the gap as a share of their distance from the origin, both excluded.
    same_side: their fronts look the same way. Each is paired with those of the NEIGHBOURS next
    planes.
    """
    corners = _corners(scene, origin, rows)
    normals = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    lengths = np.sqrt((normals**2).sum(axis=1))
    number = np.flatnonzero(lengths > 0)
    corners, normals = corners[number], normals[number] / lengths[number, None]
    turned = normals @ (0.54, 0.31, 0.78) < 0
    normals *= np.where(turned, -1.0, 1.0)[:, None]  # either side
    offsets = (normals * corners[:, 0]).sum(axis=1)
    away = np.abs(corners).max(axis=(1, 2))
    keys = np.round(normals * 2**20).astype(np.int64)
    order = np.lexsort((offsets, *keys.T))
    for step in range(1, min(NEIGHBOURS + 1, len(order))):
        a, b = order[:-step], order[step:]
        gap = (offsets[b] - offsets[a]) / np.maximum(away[a], away[b])
        near = (gap > least) & (gap < most)
        near &= (keys[a] == keys[b]).all(axis=1)
        if same_side:
            near &= turned[a] == turned[b]
        a, b, gap = a[near], b[near], gap[near]
        for hit in np.flatnonzero(_overlap(corners[a], corners[b], normals[a])).tolist():
            yield int(rows[number[a[hit]]]), int(rows[number[b[hit]]]), float(gap[hit])


def near_lamps(scene: Scene, origin: Array) -> list[str]:
    """Point and spot lights whose distance to a surface is near the rounding of positions."""
    found = []
    kinds = np.asarray(scene.light_kind)
    rows = np.flatnonzero(kinds != LIGHT_KINDS.index("directional"))
    positions = np.asarray(scene.light_position)[rows] - origin
    boxes = _all_boxes(scene, origin) if len(rows) else {}
    for row, place in zip(rows.tolist(), positions, strict=True):
        limit = LENGTH * float(np.abs(place).max())
        for kind, (low, high) in boxes.items():
            inside = ((place >= low - limit) & (place <= high + limit)).all(axis=1)
            rest = np.flatnonzero(inside)
            near = rest[_distance(scene, kind, rest, origin, place) < limit]
            if len(near):
                shape = _name(scene, f"{kind}s[{near[0]}]")
                found.append(
                    f"{_name(scene, f'light_position[{row}]')} is nearer to {shape} than "
                    f"{LENGTH:g} of its distance from the frame's origin"
                )
                break
    return found


def _corners(scene: Scene, origin: Array, rows: Any = ...) -> Array:
    """Corners (T, 3, 3) of triangles about the origin."""
    corners: Array = scene.vertices[scene.triangles[rows]] - origin
    return corners


def _longest(vectors: Array) -> Array:
    """The largest absolute coordinate of each vector (n, 3)."""
    x, y, z = np.abs(vectors).T
    longest: Array = np.maximum(np.maximum(x, y), z)
    return longest


def _all_boxes(scene: Scene, origin: Array) -> dict[str, Array]:
    return {kind: primitive_boxes(scene, kind, origin) for kind in ("triangle", "sphere", "disk")}


def primitive_boxes(scene: Scene, kind: str, origin: Array) -> Array:
    """Lowest and highest coordinates (2, n, 3), about the origin, of all shapes of a kind."""
    if kind == "triangle":
        a, b, c = (scene.vertices[scene.triangles[:, k]] for k in range(3))
        low, high = (pick(pick(a, b), c) - origin for pick in (np.minimum, np.maximum))
        return np.stack([low, high])
    if kind == "sphere":
        spheres = np.asarray(scene.spheres)
        middle, reach = spheres[:, :3] - origin, spheres[:, 3:]
    else:
        disks = np.asarray(scene.disks)
        middle, reach = disks[:, 0] - origin, np.sqrt(disks[:, 1] ** 2 + disks[:, 2] ** 2)
    return np.stack([middle - reach, middle + reach])


def _distance(scene: Scene, kind: str, rows: Array, origin: Array, place: Array) -> Array:
    """Distances of a place from shapes that it lies over; infinity from others."""
    if kind == "sphere":
        spheres = np.asarray(scene.spheres)[rows]
        middle = np.sqrt(((spheres[:, :3] - origin - place) ** 2).sum(axis=1))
        distances: Array = np.abs(middle - spheres[:, 3])
        return distances
    if kind == "disk":
        disks = np.asarray(scene.disks)[rows]
        start, first, second = disks[:, 0] - origin, disks[:, 1], disks[:, 2]
    else:
        corners = _corners(scene, origin, rows)
        start = corners[:, 0]
        first, second = corners[:, 1] - start, corners[:, 2] - start
    normal = np.cross(first, second)
    square = (normal**2).sum(axis=1)
    offset = place - start
    u = (np.cross(offset, second) * normal).sum(axis=1) / square
    v = (np.cross(first, offset) * normal).sum(axis=1) / square
    within = u * u + v * v <= 1 if kind == "disk" else (u >= 0) & (v >= 0) & (u + v <= 1)
    return np.where(within, np.abs((offset * normal).sum(axis=1)) / np.sqrt(square), np.inf)


def _overlap(a: Array, b: Array, normals: Array) -> Array:
    """Whether triangles (n, 3, 3) of parallel planes lie above each other, by separating axes."""
    result = np.ones(len(a), np.bool_)
    for corners in (a, b):
        for k in range(3):
            axis = np.cross(normals, corners[:, (k + 1) % 3] - corners[:, k])[:, None]
            ours, theirs = ((axis * (x - a[:, :1])).sum(axis=2) for x in (a, b))
            common = np.minimum(ours.max(axis=1), theirs.max(axis=1)) - np.maximum(
                ours.min(axis=1), theirs.min(axis=1)
            )
            result &= common > 1e-3 * np.ptp(ours, axis=1)
    return result


def _name(scene: Scene, row: str) -> str:
    """A table's row, with its place in the scene file."""
    place = scene.place(row)
    return f"{row} ({place})" if place else row
