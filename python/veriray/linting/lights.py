"""Rules about lamps: which of them light nothing, and why."""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Any

import numpy as np

from ..columns import LIGHT_KINDS
from ..scene import Scene
from .look import Array, Finding, Look

#: Side in pixels of the pictures that show what one lamp gives; samples per pixel of the first, and
#: of the second, which is rendered where the first is black.
PROBE, PROBE_SPP = 24, (4, 188)
#: Most lamps that are tried one by one.
MOST_LAMPS = 64
#: Rays from a lamp that tell why it gives nothing.
RAYS = 256
#: `cpp/scene/covered.cpp`: distances in units of the frame's lengths, share of the area, pairs.
NEAR, ONE_PLANE, SLIVER, MOST_PAIRS = 2.0**-18, 2.0**-23, 1e-6, 1 << 20


def covered(look: Look) -> list[Finding]:
    """Flat lamps that something opaque covers so closely that shadow rays would end before it."""
    scene, count = look.scene, look.counts[0]
    lamps = np.flatnonzero(look.emission[:count] >= 0)
    lamps = lamps[np.asarray(scene.emissions)[look.emission[lamps]].any(axis=1)]
    others = np.flatnonzero(look.opaque[look.material[:count]])
    if len(lamps) * len(others) > MOST_PAIRS:
        look.skipped.append(f"covered-lamp: {len(lamps):,} lamps among {len(others):,} triangles")
        return []
    corners = np.asarray(scene.vertices)[np.asarray(scene.triangles)] / look.unit
    normals = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    lengths = np.sqrt((normals**2).sum(axis=1))[:, None]
    normals = np.divide(normals, lengths, out=np.zeros_like(normals), where=lengths > 0)
    found: dict[int, Finding] = {}
    for lamp in lamps.tolist():
        shape = int(look.shape[lamp])
        if shape in found or not normals[lamp].any():
            continue
        offsets = corners[lamp][None] - corners[others, 0][:, None]
        heights = (offsets * normals[others][:, None]).sum(axis=2)  # (n, 3)
        sides = np.where((normals[others] * normals[lamp]).sum(axis=1) < 0, -1.0, 1.0)
        before = -heights.mean(axis=1) * sides
        close = (np.abs(heights).max(axis=1) <= NEAR) & normals[others].any(axis=1)
        close &= (before > ONE_PLANE) | ((before >= -ONE_PLANE) & (others < lamp))
        close &= look.shape[others] != shape
        for other in others[close].tolist():
            share = _overlap_share(corners[lamp], corners[other], normals[lamp])
            if share > SLIVER:
                text = (
                    f"{look.shape_name(int(look.shape[other]))} lies on it, {share:.0%} of a face"
                )
                reason = (
                    "shadow rays end before what is so close: the lamp is not sampled, and dark or "
                    "noisy; move it off the surface"
                )
                found[shape] = look.of_primitive("covered-lamp", lamp, text, reason)
                break
    return list(found.values())


def _overlap_share(a: Array, b: Array, n: Array) -> float:
    """The share of triangle a (3, 3) that triangle b covers, seen along the normal n of a."""
    rest = list(a)
    turn = -1.0 if float(np.cross(b[1] - b[0], b[2] - b[0]) @ n) < 0 else 1.0
    for k in range(3):
        inward = np.cross(n, b[(k + 1) % 3] - b[k]) * turn
        sides = [float(inward @ (p - b[k])) for p in rest]
        kept: list[Array] = []
        for p, q, x, y in zip(rest, rest[1:] + rest[:1], sides, sides[1:] + sides[:1], strict=True):
            if x >= 0:
                kept.append(p)
            if (x >= 0) != (y >= 0):
                kept.append(p + (q - p) * (x / (x - y)))
        rest = kept
        if len(rest) < 3:
            return 0.0
    area = sum(float(np.cross(p - rest[0], q - rest[0]) @ n)
               for p, q in zip(rest[1:-1], rest[2:], strict=True))  # fmt: skip
    return abs(area) / float(np.linalg.norm(np.cross(a[1] - a[0], a[2] - a[0])))


def dark(look: Look) -> list[Finding]:
    """Lamps that give nothing to the picture: one that has only them is black.

    A lamp is reported after PROBE^2 x sum(PROBE_SPP) paths none of which it lights.
    """
    scene = look.scene
    sources = _sources(look)
    if not sources:
        if not scene.environment.any() and not len(scene.sky_texels):
            text = "nothing shines: the picture is black"
            return [Finding("no-light", "", scene.place(""), text, "there is no light to see")]
        return []
    if len(sources) > MOST_LAMPS:
        text = f"dark-light: the first {MOST_LAMPS} of {len(sources)} lamps were examined"
        look.skipped.append(text)
    lamps = sources[:MOST_LAMPS]
    if _gives(look, dict.fromkeys(("emissions", "light_intensity"))) and len(sources) == 1:
        return []
    found = []
    for column, row in lamps:
        if _gives(look, {column: row}):
            continue
        paths = PROBE * PROBE * sum(PROBE_SPP)
        name = "emissions" if column == "emissions" else "light_kind"
        text = f"none of {paths:,} paths of the picture finds light of it"
        found.append(look.found("dark-light", name, row, text, _why(look, column, row)))
    return found


def _sources(look: Look) -> list[tuple[str, int]]:
    """Rows of lamps that shine and are used: the column of their radiance, and the row."""
    scene = look.scene
    used = np.unique(look.emission[look.emission >= 0])
    areas = used[np.asarray(scene.emissions)[used].any(axis=1)]
    points = np.flatnonzero(np.asarray(scene.light_intensity).any(axis=1))
    return [("emissions", r) for r in areas.tolist()] + [
        ("light_intensity", r) for r in points.tolist()
    ]


def _gives(look: Look, rows: dict[str, Any]) -> bool:
    """Whether the picture of the scene with these lamps alone is not black; None: all rows."""
    from ..rendering import render

    scene = look.scene
    arrays: dict[str, Any] = {}
    for column in ("emissions", "light_intensity"):
        values = np.zeros_like(getattr(scene, column))
        if column in rows:
            row = ... if rows[column] is None else rows[column]
            values[row] = getattr(scene, column)[row]
        arrays[column] = values
    arrays["environment"] = np.zeros_like(scene.environment)
    if len(scene.sky_texels):
        arrays["sky_texels"] = np.zeros_like(scene.sky_texels)
    alone: Scene = scene._with_arrays(**arrays).with_(width=PROBE, height=PROBE, filter="box")
    return any(
        bool(np.asarray(render(alone, spp, seed, "cpu")).any())
        for seed, spp in enumerate(PROBE_SPP)
    )


def _why(look: Look, column: str, row: int) -> str:
    """What rays from a lamp say of the reason."""
    origins, directions = _rays(look, column, row)
    t, primitive = look.hits(origins, directions)
    hit = primitive >= 0
    if not hit.any():
        return f"none of {len(t)} rays from it meets a surface: it shines past the scene"
    shapes = np.unique(look.shape[primitive[hit]])
    opaque = look.opaque[look.material[primitive[hit]]].all()
    if hit.all() and opaque and len(shapes) == 1:
        return f"every ray from it ends on {look.shape_name(int(shapes[0]))}, which encloses it"
    if not opaque and column == "light_intensity":
        return (
            "it has no size and shines through smooth glass, or on what is out of view: no path "
            "from the camera can end on it"
        )
    names = ", ".join(look.shape_name(s) for s in shapes[:3].tolist())
    return f"its rays end on {names}, out of the camera's reach"


def _rays(look: Look, column: str, row: int) -> tuple[Array, Array]:
    """Rays (RAYS, 3) from a lamp into where it shines, evenly spread; the same every time."""
    rng = np.random.default_rng(7)
    z, turn = rng.random(RAYS), 2 * math.pi * rng.random(RAYS)
    scene = look.scene
    if column == "emissions":
        rows = np.flatnonzero(look.emission == row)
        mine = rows[rng.integers(len(rows), size=RAYS)]
        origins = np.array([_point(look, k, *rng.random(2)) for k in mine.tolist()])
        axes = look.normals(mine, origins)
        axes /= np.maximum(np.sqrt((axes**2).sum(axis=1)), 1e-300)[:, None]
        reach = np.abs(origins).max() + 1e-30
        directions = _about(axes, z, turn)
        return origins + axes * (1e-6 * reach), directions
    kind = LIGHT_KINDS[int(scene.light_kind[row])]
    axis = np.repeat(np.asarray(scene.light_direction)[row][None], RAYS, axis=0)
    if kind == "directional":
        low, high = look.bounds
        middle, radius = (low + high) / 2, float(np.linalg.norm(high - low)) / 2
        across = _about(axis, np.zeros(RAYS), turn) * (radius * np.sqrt(z))[:, None]
        return middle + across - axis * 2 * radius, axis
    if kind == "point":
        axis, z = np.repeat([[0.0, 0.0, 1.0]], RAYS, axis=0), 2 * z - 1
    elif kind == "spot":
        z = 1 - z * (1 - math.cos(math.radians(float(scene.light_angles[row, 0]))))
    origins = np.repeat(np.asarray(scene.light_position)[row][None], RAYS, axis=0)
    return origins, _about(axis, z, turn)


def _point(look: Look, primitive: int, x: float, y: float) -> Array:
    """A point of a primitive."""
    triangles, spheres, _ = look.counts
    if primitive < triangles:
        a, b, c = np.asarray(look.scene.vertices)[look.scene.triangles[primitive]]
        x, y = (1 - x, 1 - y) if x + y > 1 else (x, y)
        point: Array = a + x * (b - a) + y * (c - a)
        return point
    if primitive < triangles + spheres:
        ball = np.asarray(look.scene.spheres)[primitive - triangles]
        on = _about(np.array([[0.0, 0.0, 1.0]]), np.array([2 * x - 1]), np.array([2 * math.pi * y]))
        return np.asarray(ball[:3] + ball[3] * on[0])
    centre, a, b = np.asarray(look.scene.disks)[primitive - triangles - spheres]
    r, turn = math.sqrt(x), 2 * math.pi * y
    return np.asarray(centre + r * (math.cos(turn) * a + math.sin(turn) * b))


def _about(axes: Array, z: Array, turn: Array) -> Array:
    """Unit vectors (n, 3) at cosine z from unit axes (n, 3), turned about them."""
    helper = np.where(np.abs(axes[:, :1]) < 0.7, [[1.0, 0.0, 0.0]], [[0.0, 1.0, 0.0]])
    x = np.cross(axes, helper)
    x /= np.sqrt((x**2).sum(axis=1))[:, None]
    y = np.cross(axes, x)
    r = np.sqrt(np.maximum(1 - z * z, 0))
    directions: Array = (
        axes * z[:, None] + x * (r * np.cos(turn))[:, None] + y * (r * np.sin(turn))[:, None]
    )
    return directions


CHECKS: tuple[Callable[[Look], list[Finding]], ...] = (covered, dark)
