"""Rules about shapes as bodies: closed or open, fronts inside or outside, twice the same."""

from __future__ import annotations

from collections.abc import Callable, Iterator

import numpy as np

from .look import SIDE, Array, Finding, Look, row_keys

#: Most triangles of one shape whose edges are looked at.
MOST_FACES = 1 << 22
#: Share of their size by which corners of several shapes may differ.
WELD = 2.0**-20
#: Most boundaries on a ray that are followed; share of pairs of them that may disagree.
STEPS, DISAGREE = 12, 0.01
_SOLID = ("dielectric", "roughdielectric", "roughdielectric_whole", "principled_open")


def _meshes(look: Look) -> Iterator[tuple[int, Array]]:
    """Shapes of triangles: number, and rows of the triangles."""
    shapes = look.shape[: look.counts[0]]
    order = np.argsort(shapes, kind="stable")
    starts = np.flatnonzero(np.diff(shapes[order], prepend=-1))
    for rows in np.split(order, starts[1:]) if len(order) else ():
        if len(rows) > MOST_FACES:
            look.skipped.append(f"{look.shape_name(int(shapes[rows[0]]))}: {len(rows):,} triangles")
        else:
            yield int(shapes[rows[0]]), rows


class _Edges:
    """The edges of triangles, whose corners at equal places are one.

    open: edges that have no partner that runs the other way. twice: directed edges that belong to
    several triangles. closed: every edge, whichever way it runs, has an even number of faces.
    balanced: each edge runs as often forth as back. turned: triangles that count turned round.
    """

    def __init__(self, look: Look, rows: Array, turned: Array | None = None) -> None:
        scene = look.scene
        corners = np.asarray(scene.triangles)[rows]
        if turned is not None:
            corners = np.concatenate([corners, np.asarray(scene.triangles)[turned][:, ::-1]])
        used, local = np.unique(corners, return_inverse=True)
        places = np.asarray(scene.vertices)[used] + 0.0  # no -0
        if turned is not None:  # of several shapes, whose corners may differ by rounding
            low, high = places.min(axis=0, initial=0.0), places.max(axis=0, initial=0.0)
            step = WELD * max(float((high - low).max()), 1e-300)
            places = np.round((places - low) / step + 0.381966)
        _, welded = np.unique(row_keys(places), return_inverse=True)
        faces = welded.reshape(-1)[local.reshape(-1, 3)]
        edges = np.concatenate([faces[:, [k, (k + 1) % 3]] for k in range(3)])
        self.face = np.tile(np.arange(len(corners)), 3)
        real = edges[:, 0] != edges[:, 1]
        (a, b), self.face, count = edges[real].T, self.face[real], len(used) + 1
        forth, back = a * count + b, b * count + a
        self.open = ~np.isin(forth, back)
        values, times = np.unique(forth, return_counts=True)
        self.twice = times[np.searchsorted(values, forth)] > 1
        self.balanced = np.array_equal(np.sort(forth), np.sort(back))
        _, pairs = np.unique(np.minimum(forth, back), return_counts=True)
        self.closed = bool((pairs % 2 == 0).all()) and len(pairs) > 0

    @property
    def closed_and_wound(self) -> bool:
        """Whether the surface is closed and has one front."""
        return self.closed and not self.open.any()


def open_bodies(look: Look) -> list[Finding]:
    """Glass, and boundaries of media, that are not closed, alone or with others alike."""
    scene, found = look.scene, []
    media = np.asarray(scene.boundaries)

    def solid(primitive: int) -> str:
        if look.kind[look.material[primitive]] in _SOLID:
            return "glass"
        boundary = int(look.boundary[primitive])
        if boundary >= 0 and media[boundary, 0] != media[boundary, 1]:
            return "the boundary of a medium"
        return ""

    open_shapes: dict[int, tuple[Array, float]] = {}
    for shape, rows in _meshes(look):
        if solid(int(rows[0])):
            edges = _Edges(look, rows)
            if edges.open.any():
                open_shapes[shape] = rows, float(edges.open.mean())
    alike: dict[tuple[int, int], list[int]] = {}
    for shape, (rows, _) in open_shapes.items():
        key = int(look.material[rows[0]]), int(look.boundary[rows[0]])
        alike.setdefault(key if key[1] < 0 else (-1, -1), []).append(shape)
    reason = (
        "inside and outside meet at the open edges: light enters and does not leave, or leaves and "
        "never entered"
    )
    for (material, _), shapes in alike.items():
        if material < 0:
            shapes = [s for s in shapes if not _media_close(look, open_shapes[s][0])]
        elif len(shapes) > 1:
            together = np.concatenate([open_shapes[shape][0] for shape in shapes])
            if _Edges(look, together, together[:0]).balanced:
                continue
        for shape in shapes:
            rows, share = open_shapes[shape]
            text = f"{solid(int(rows[0]))} is not closed: {share:.2g} of its edges are open"
            found.append(look.of_primitive("open-body", int(rows[0]), text, reason))
    first = look.counts[0] + look.counts[1]
    for shape in np.unique(look.shape[first:]).tolist():
        disk = first + int(np.flatnonzero(look.shape[first:] == shape)[0])
        if solid(disk):
            text = f"{solid(disk)} is a disk, which closes nothing"
            found.append(look.of_primitive("open-body", disk, text, reason))
    return found


def _media_close(look: Look, rows: Array) -> bool:
    """Whether all triangles at which a medium begins or ends close each medium that these bound."""
    sides = np.asarray(look.scene.boundaries)
    of = look.boundary[: look.counts[0]]
    inside = np.where(of >= 0, sides[of, 0], -1)
    outside = np.where(of >= 0, sides[of, 1], -1)
    bounded = {*inside[rows].tolist(), *outside[rows].tolist()} - {-1}
    for medium in bounded:
        forth = np.flatnonzero((inside == medium) & (outside != medium))
        back = np.flatnonzero((outside == medium) & (inside != medium))
        if not _Edges(look, forth, back).balanced:
            return False
    return True


def media(look: Look) -> list[Finding]:
    """Media that do not agree from one boundary to the next along straight rays of the camera.

    Between two boundaries, the medium behind the first and the one before the second are the same.
    """
    scene = look.scene
    if not len(scene.boundaries):
        return []
    sides = np.asarray(scene.boundaries)
    origins, directions = (x.copy() for x in look.camera_rays)
    inside = np.full(len(origins), scene.camera.medium)
    of_camera = np.ones(len(origins), np.bool_)
    last, left = np.full(len(origins), -1), np.full(len(origins), -1)
    wrong: dict[tuple[int, int], int] = {}
    pairs = 0
    live = np.arange(len(origins))
    for _ in range(STEPS):
        t, primitive = look.hits(origins[live], directions[live])
        back = look.behind(origins[live], directions[live], t, primitive)
        hit = primitive >= 0
        live, t, primitive, back = live[hit], t[hit], primitive[hit], back[hit]
        if not len(live):
            break
        boundary = look.boundary[primitive]
        again = (primitive == left[live]) & (t < 1e-4 * np.abs(origins[live]).max(axis=1))
        marks = (boundary >= 0) & ~again  # not what it has just gone through
        left[live] = primitive
        before = np.where(back, sides[boundary, 0], sides[boundary, 1])
        after = np.where(back, sides[boundary, 1], sides[boundary, 0])
        for k in np.flatnonzero(marks & (before != inside[live])).tolist():
            pair = (-1 if of_camera[live[k]] else int(last[live[k]])), int(look.shape[primitive[k]])
            wrong[pair] = wrong.get(pair, 0) + 1
        pairs += int(marks.sum())
        inside[live] = np.where(marks, after, inside[live])
        of_camera[live[marks]] = False
        last[live[marks]] = look.shape[primitive[marks]]
        go = ~look.opaque[look.material[primitive]]
        live, t = live[go], t[go]
        reach = np.abs(origins[live]).max(axis=1, initial=0.0) + t
        origins[live] += directions[live] * (t + 1e-6 * reach)[:, None]
    found = []
    for (one, other), count in wrong.items():
        if count > DISAGREE * max(pairs, 1):
            start = "the camera" if one < 0 else look.shape_name(one)
            text = (
                f"before {look.shape_name(other)} there is another medium than behind {start}, on "
                f"{count} of {SIDE**2} rays of the camera"
            )
            reason = "a ray cannot change its medium in between: name it on both boundaries"
            primitive_ = int(np.flatnonzero(look.shape == other)[0])
            found.append(look.of_primitive("media", primitive_, text, reason))
    return found


def flipped(look: Look) -> list[Finding]:
    """Closed bodies seen from outside whose fronts are inside; and faces that look both ways.

    Only where the side matters: one-sided surfaces, lamps, glass, boundaries of media. A body
    around the camera is a room.
    """
    scene, found = look.scene, []
    eye = np.asarray(scene.camera.to_world)[:3, 3]
    two_sided = np.asarray(scene.two_sided)
    reason = {
        "lamp": "it shines on its front side only",
        "glass": "its refractive index and its media count from the front",
        "surface": "from behind it is black",
    }

    def matters(primitive: int) -> str:
        row = int(look.material[primitive])
        if look.emission[primitive] >= 0:
            return "lamp"
        if look.kind[row] in _SOLID or look.boundary[primitive] >= 0:
            return "glass"
        if look.opaque[row] and not two_sided[row]:
            return "surface"
        return ""

    for shape, rows in _meshes(look):
        what = matters(int(rows[0]))
        if len(rows) < 4 or not what:
            continue
        corners = np.asarray(scene.vertices)[np.asarray(scene.triangles)[rows]]
        low, high = corners.min(axis=(0, 1)), corners.max(axis=(0, 1))
        edges = _Edges(look, rows)
        if edges.closed and edges.open.any():
            faces = np.unique(edges.face[edges.open | edges.twice])
            text = f"its faces look both ways: {len(faces)} of {len(rows)} beside ones turned round"
            found.append(look.of_primitive("flipped", int(rows[0]), text, reason[what]))
        elif edges.closed_and_wound and not ((eye >= low) & (eye <= high)).all():
            local = corners - (low + high) / 2
            volume = (local[:, 0] * np.cross(local[:, 1], local[:, 2])).sum() / 6
            if volume < -1e-9 * np.prod(np.maximum(high - low, 1e-300)):
                text = f"shape {look.shape_name(shape)} has its front inside"
                found.append(look.of_primitive("flipped", int(rows[0]), text, reason[what]))
    spheres = np.asarray(scene.spheres)
    away = np.sqrt(((spheres[:, :3] - eye) ** 2).sum(axis=1)) > spheres[:, 3]
    for row in np.flatnonzero(np.asarray(scene.sphere_inward) & away).tolist():
        primitive = look.counts[0] + row
        if what := matters(primitive):
            text = "the sphere has its front inside"
            found.append(look.of_primitive("flipped", primitive, text, reason[what]))
    return found


def duplicates(look: Look) -> list[Finding]:
    """The same triangle, sphere or disc twice, in any order of the corners."""
    scene, found = look.scene, []
    tables: list[tuple[int, Array]] = []
    if 1 < look.counts[0] <= MOST_FACES:
        corners = np.asarray(scene.vertices)[np.asarray(scene.triangles)]
        key = corners[:, :, 0] + 0.0
        for axis, weight in ((1, 0.6180339887498949), (2, 0.7548776662466927)):
            key = key + corners[:, :, axis] * weight
        order = np.argsort(key, axis=1, kind="stable")
        ordered = np.take_along_axis(corners, order[:, :, None], axis=1)
        tables.append((0, ordered.reshape(len(corners), -1)))
    tables.append((look.counts[0], np.asarray(scene.spheres)))
    tables.append((sum(look.counts[:2]), np.asarray(scene.disks).reshape(look.counts[2], 9)))
    pairs: dict[tuple[int, int], list[int]] = {}
    for first, values in tables:
        if len(values) < 2:
            continue
        words = row_keys(values + 0.0)
        _, index, inverse = np.unique(words, return_index=True, return_inverse=True)
        again = np.flatnonzero(index[inverse] != np.arange(len(values)))
        for row in again.tolist():
            one, other = first + int(index[inverse[row]]), first + row
            shapes = int(look.shape[one]), int(look.shape[other])
            pairs.setdefault(shapes, []).append(other)
    for (one, _), rows_ in pairs.items():
        count = len(rows_)
        text = f"{count} of its primitives stand{'s' * (count == 1)} in {look.shape_name(one)} too"
        reason = "two surfaces cannot be in one place; only the first is seen, and both may shine"
        found.append(look.of_primitive("duplicate", rows_[0], text, reason))
    return found


def degenerate(look: Look) -> list[Finding]:
    """Triangles without area, which are dropped."""
    if not look.dropped:
        return []
    corners = np.asarray(look.scene.vertices)[np.asarray(look.scene.triangles)]
    normal = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    rows = np.flatnonzero(~normal.any(axis=1))
    text = f"{look.dropped} triangles have no area and are left out"
    reason = "they are seen from nowhere; in glass they are holes only where their edges are open"
    row = int(rows[0]) if len(rows) else 0
    return [look.of_primitive("degenerate", row, text, reason)]


CHECKS: tuple[Callable[[Look], list[Finding]], ...] = (
    open_bodies, media, flipped, duplicates, degenerate,
)  # fmt: skip
