"""Stress of the geometry: places and scales, slivers, ties, gaps, odd rays, strange meshes.

In every case no sample is non-finite and the ledger adds up, in addition to what the case states.
"""

from __future__ import annotations

import dataclasses
import math
import resource
import warnings
from collections.abc import Callable
from typing import Any

import numpy as np
import numpy.typing as npt
from scipy import stats

import veriray
from veriray_validate import dicts, leaks
from veriray_validate.form_factors import cap, rectangle_above_corner
from veriray_validate.scenes import (
    Part,
    box,
    camera,
    check_scene,
    checks,
    disk,
    make,
    quad,
    sphere,
)
from veriray_validate.statistics import sidak, smallest_bias
from veriray_validate.trial import Skipped, Trial, case

Array = npt.NDArray[Any]


# ---- the same scene elsewhere and of another size ----

MOVED = ("sphere_light", "glass_mesh", "touching_media", "disk_ellipse", "point_light")
SCALES = (1e-6, 1e-3, 1e3, 1e6, 1e9)


def still(name: str, size: int) -> veriray.Scene:
    """The Cornell box or a scene of scenes/checks, if it is installed."""
    if name == "cornell":
        return veriray.cornell_box().with_(width=size, height=size)
    if name not in checks():
        raise Skipped("scenes/checks is not installed")
    return check_scene(name, size)


def shifted(scene: veriray.Scene, by: Array) -> veriray.Scene:
    """The scene with its camera, moved."""
    spheres, disks = np.array(scene.spheres), np.array(scene.disks)
    spheres[:, :3] += by
    disks[:, 0] += by
    to_world = np.array(scene.camera.to_world)
    to_world[:3, 3] += by
    return dataclasses.replace(
        scene, vertices=scene.vertices + by, spheres=spheres, disks=disks,
        light_position=np.asarray(scene.light_position) + by,
        camera=dataclasses.replace(scene.camera, to_world=to_world),
    )  # fmt: skip


WAYS: dict[str, Callable[[veriray.Scene], veriray.Scene]] = {
    "moved by 1e6": lambda s: shifted(s, np.full(3, 1e6)),
    "moved by 1e6, -1e6, 1e5": lambda s: shifted(s, np.array([1e6, -1e6, 1e5])),
    **{f"times {k:g}": lambda s, k=k: s.scaled(k) for k in SCALES},  # type: ignore[misc]
}


def alike(t: Trial, a: veriray.Render, b: veriray.Render, margin: float) -> None:
    """Welch's test of every pixel and of the picture, over batches; sees: bias of the picture.

    margin: a relative difference that is allowed.
    """
    x, y = (np.asarray(r.batch_means, np.float64) for r in (a, b))
    n = len(x)
    x, y = (np.concatenate([v.reshape(n, -1), v.mean(axis=(1, 2))], axis=1) for v in (x, y))
    level = (np.abs(x).mean(axis=0) + np.abs(y).mean(axis=0)) / 2
    off = np.maximum(np.abs(x.mean(axis=0) - y.mean(axis=0)) - margin * level, 0)
    vx, vy = x.var(axis=0, ddof=1) / n, y.var(axis=0, ddof=1) / n
    spread = np.sqrt(vx + vy)
    quiet = spread <= 1e-7 * level
    t.check(off[quiet] == 0, "a pixel without noise differs")
    loud = ~quiet
    freedom = (n - 1) * (vx + vy)[loud] ** 2 / (vx**2 + vy**2)[loud]
    p = 2 * stats.t.sf(off[loud] / spread[loud], freedom)
    if p.size:
        t.p(sidak(float(p.min()), p.size), "pixels and picture")
        t.figure("z", (off / np.maximum(spread, 1e-300))[loud][:192])
    t.sees(max(map(smallest_bias, spread[-3:], level[-3:])) + margin)


@case(8, each={"name": [*MOVED, "cornell"], "way": WAYS},
      quick=lambda name, way: name != "cornell" and way in ("moved by 1e6", "times 1e-06",
                                                            "times 1e+09"))  # fmt: skip
def same_picture_elsewhere(t: Trial, name: str, way: str) -> None:
    """A whole scene a million away, or 1e-6 to 1e9 times as large: the same picture.

    With the same seed only rounding differs: at most 2 % of the pixels by more than 1e-3, the mean
    by less than 2e-3. With another seed each pixel and the mean agree within noise (Welch over 32
    batches; a margin of 1e-4).
    """
    scene = still(name, 24)
    other = WAYS[way](scene)
    seed = t.fresh()
    a, b = (t.render(s, 32, seed=seed) for s in (scene, other))
    x, y = a.image, b.image
    differ = (np.abs(y - x) > 1e-3 * np.maximum(x, 1e-3)).mean()
    t.check(differ < 0.02, f"{differ:.1%} of the values differ by more than 1e-3")
    ratio = y.mean(dtype=np.float64) / x.mean(dtype=np.float64)
    t.check(abs(ratio - 1) < 2e-3, f"the means' ratio is {ratio}")
    t.figure("share of values that differ by more than 1e-3", float(differ))
    size = {"width": 6, "height": 6, "batches": 32}
    alike(t, *(t.render(s, 1024, **size) for s in (scene, other)), margin=1e-4)


@case(8, each={"name": ["glass_mesh", "spheres_300", "disk_ellipse"]})
def same_depths_elsewhere(t: Trial, name: str) -> None:
    """Distances from the camera, a scene in place and a million away.

    The same primitives, and distances within 1e-6, except for 1 in 500 rays that pass an edge.
    """
    scene = still(name, 16)
    eye = np.array(scene.camera.to_world)[:3, 3]
    ways = t.rng.normal(size=(20_000, 3)) - 0.5 * eye / np.linalg.norm(eye)
    ways /= np.linalg.norm(ways, axis=1)[:, None]
    results = []
    for by in (np.zeros(3), np.array([1e6, -1e6, 1e6])):
        origins = np.tile(eye + by, (len(ways), 1))
        results.append(t.native.intersect(t.native_scene(shifted(scene, by)), origins, ways))
    (t1, k1), (t2, k2) = results
    met = k1 >= 0  # t of the others is infinite
    same = (k1 == k2) & ~met
    same[met] = (k1 == k2)[met] & (np.abs(t2[met] / t1[met] - 1) < 1e-6)
    t.check((k1 >= 0).mean() > 0.05, "the rays miss everything")
    t.check((~same).mean() < 2e-3, f"{(~same).mean():.2%} of the rays differ")


# ---- spheres of every size ----


@case(8, each={"radius": [1e-6, 1e-3, 1.0, 1e3, 1e6], "height": [1e-6, 1e-3, 1.0, 1e3, 1e6]})
def sphere_from_near_and_far(t: Trial, radius: float, height: float) -> None:
    """A diffuse ball under a sky of 1, seen from `height` radii above it.

    Its albedo; sees 1 %. It is convex: two segments per path and no blocked shadow ray, that is, no
    self-intersection (exact).
    """
    ball = dicts.sphere([0, 0, 0], radius, dicts.diffuse(0.7))
    eye = dicts.view([0, 0, radius * (1 + height)], [0, 0, 0], min(60.0, 20 / height))
    r = t.agrees(dicts.scene(eye, ball, dicts.sky(1)), float(np.float32(0.7)), 100_000, 0.01)
    t.check(r.stats["live_rays"] == [r.spp, r.spp], "more than two segments")
    t.check(not any(r.stats["ledger"]["shadow_occluded"]), "the ball shades itself")


@case(8, each={"radius": [1e-6, 1.0, 1e6], "at": [0.0, 0.9, 0.99999]})
def inside_a_sphere(t: Trial, radius: float, at: float) -> None:
    """A furnace that is a sphere, from its centre and from near its wall.

    E / (1 - rho) = 1; sees 2 %. Nothing leaves and nothing is blocked (exact).
    """
    room = {**dicts.sphere([0, 0, 0], radius, dicts.diffuse(0.5), 0.5), "flip_normals": True}
    eye = dicts.view([at * radius, 0, 0], [radius, 0.2 * radius, 0.1 * radius], 50)
    r = t.agrees(dicts.scene(eye, room), 1.0, 200_000, 0.02)
    t.check(not any(r.stats["ledger"]["escaped"]), "paths get out")
    t.check(not any(r.stats["ledger"]["shadow_occluded"]), "the wall shades itself")


@case(8, each={"radius": [1e-6, 1.0, 1e6], "material": ["glass", "medium"]})
def glass_and_media_of_every_size(t: Trial, radius: float, material: str) -> None:
    """A lossless ball of glass or fog in a sky of 1, radius 1e-6 to 1e6.

    1; sees 1 %. No path is cut, so none is stuck on a surface (exact).
    """
    if material == "glass":
        ball = dicts.sphere([0, 0, 0], radius, dicts.glass(1.5))
    else:
        fog = dicts.medium(4 / radius, 1.0, 0.5)
        ball = dicts.sphere([0, 0, 0], radius, dicts.NULL, interior=fog)
    eye = dicts.view([0, radius, 5 * radius], [0, 0, 0], 20, 4)
    r = t.agrees(dicts.scene(eye, ball, dicts.sky(1)), 1.0, 20_000, 0.01)
    t.check(not any(r.stats["ledger"]["depth_cut"]), "paths are cut")


@case(8, each={"radius": [1e-6, 1.0, 1e6], "tree": [False, True]})
def rays_tangent_to_a_sphere(t: Trial, radius: float, tree: bool) -> None:
    """Rays that pass a sphere's centre at about its radius, from 1e-3 to 1e3 radii away.

    Nearer than R by more than 1e-5 R they meet it, further off by that much they do not; between
    the two either may happen, at the point of contact. From inside, along its wall, all meet it.
    """
    n = 20_000 * t.effort
    far = [sphere([0, 0, 5 * radius + k * radius / 50], radius / 200) for k in range(70)]
    host = t.native_scene(make([sphere([0, 0, 0], radius), *(far if tree else [])],
                               camera([0, 0, -2 * radius], [0, 0, 0])))  # fmt: skip
    t.check(("bvh" in host.features) == tree, "tree")
    for reach in (1e-3, 1.0, 1e3):
        gap = t.rng.choice([-1, 1], n) * 10.0 ** t.rng.uniform(-8, -3, n)
        angle = t.rng.uniform(0, 2 * math.pi, n)
        side = np.stack([np.cos(angle), np.sin(angle), np.zeros(n)], axis=1)
        ways = np.stack([-np.sin(angle), np.cos(angle), np.zeros(n)], axis=1)
        origins = radius * ((1 + gap)[:, None] * side - reach * ways)
        distance, primitive = t.native.intersect(host, origins, ways)
        hit = primitive == 0
        slack = 1e-5 * max(1.0, reach)
        t.check(hit[gap < -slack], f"misses inside the rim, {reach:g} radii before it")
        t.check(~hit[gap > slack], f"hits outside of the rim, {reach:g} radii before it")
        off = np.abs(distance[hit] / radius - reach)
        reaches = np.sqrt(2 * np.maximum(-gap[hit], 0)) * 1.01 + 0.01 * np.sqrt(slack) + slack
        t.check(off < np.maximum(reaches, math.sqrt(2 * slack)), "a hit is not at the rim")
        t.check(np.isinf(distance[primitive < 0]), "a miss has a distance")
    inner = radius * (1 - 10.0 ** t.rng.uniform(-6, -2, n))[:, None] * side
    distance, primitive = t.native.intersect(host, inner, ways)
    t.check(primitive == 0, "a ray from inside leaves")
    t.check(np.isfinite(distance) & (distance > 0), "a distance is not finite")


@case(8)
def pebble_by_a_mountain(t: Trial) -> None:
    """A ball of radius 1e-3 on a black plain of 2,000 beside a ball of radius 1,000.

    rho times the visible share of the sky: the small ball's side sees half of the sky, less the
    large ball's cone around the horizon. Sees 2 %.
    """
    pebble = dicts.sphere([0, 0, 1.001e-3], 1e-3, dicts.diffuse(0.8))
    plain = dicts.flat("rectangle", [0, 0, 0], [0, 0, 1], 1000, dicts.BLACK)
    hides = cap(0, math.asin(0.6)) / math.pi / 2
    for mountain, hidden in ((None, 0.0), ([1500.0, 0, 0], hides)):
        more = [] if mountain is None else [dicts.sphere(mountain, 900, dicts.BLACK)]
        eye = dicts.view([0.02, 0, 1.001e-3], [1e-3, 0, 1.001e-3])
        seen = dicts.scene(eye, pebble, plain, *more, dicts.sky(1))
        t.agrees(seen, 0.8 * (0.5 - hidden), 400_000, 0.02, margin=2e-4)


# ---- closed meshes do not leak ----

SMALL = ("box of 12", "box of 12, turned", "icosahedron, turned", "cube of 3,072, turned",
         "slivers", "slivers, turned")  # fmt: skip


@case(8, each={"name": leaks.MESHES}, quick=lambda name: name in SMALL)
def closed_meshes_do_not_leak(t: Trial, name: str) -> None:
    """Rays from inside a closed mesh, aimed at its vertices and edges, all meet it.

    0 of 1e6 leak, at scales 1e-3 to 1e6, in place and a million away.
    """
    result = leaks.run(t.device, 1_000_000 * t.effort, (name,), t.fresh() >> 2)
    t.check(result["rays"] >= 990_000 * t.effort, "too few rays")
    t.check(result["leaks"] == 0, f"{result['leaks']} leaks")
    t.figure("rays", result["rays"])


@case(8, each={"turned": [False, True]})
def furnace_of_slivers(t: Trial, turned: bool) -> None:
    """A closed bar of triangles 1 : 2e6, glowing inside.

    E / (1 - rho) = 1 at every pixel; sees 1 %. Nothing leaves except for the stated leaks at edges.
    """
    vertices, faces, _ = leaks.MESHES["slivers, turned" if turned else "slivers"]()
    wall = Part(vertices, faces[:, ::-1], 0.5, 0.5)
    eye = camera([0.1, 0.2, -0.1], [0.4, 0.1, 0.9], 100)
    r = t.agrees(make([wall], eye, width=6, height=6), 1.0, 8_000, 0.01, margin=1e-4)
    t.sealed(r)


def strips(turn: Array) -> Part:
    """The cube from -1 to 1, one side in four strips: T-junctions on two edges of its neighbours.

    Every quad as a fan about its middle, so that it stays triangles.
    """
    walls = box([-1, -1, -1], [1, 1, 1], True)
    corners = walls.vertices.reshape(-1, 4, 3)
    bottom = (corners[:, :, 2] == -1).all(axis=1)
    split = [quad([-1 + k / 2, -1, -1], [0, 2, 0], [0.5, 0, 0]).vertices for k in range(4)]
    quads = np.concatenate([corners[~bottom], np.array(split)])
    quads = quads @ turn.T
    fans = np.concatenate([quads, quads.mean(axis=1, keepdims=True)], axis=1)
    faces = np.array([[0, 1, 4], [1, 2, 4], [2, 3, 4], [3, 0, 4]])
    faces = (faces[None] + 5 * np.arange(len(fans))[:, None, None]).reshape(-1, 3)
    return Part(fans.reshape(-1, 3), faces)


@case(8, each={"turned": [False, True], "tree": [False, True]})
def t_junctions(t: Trial, turned: bool, tree: bool) -> None:
    """Vertices in the middle of a neighbour's edge: rays from inside at those edges.

    Without a tree none leaks. In a tree such a mesh is open by a rounding error: 1 in 100 of the
    rays aimed exactly at the edge leak, 1 in 5 if the mesh is rotated (the vertex is then off the
    edge), and 1e-5 of other rays.
    """
    n = 200_000 * t.effort
    turn = np.linalg.qr(np.random.default_rng(3).normal(size=(3, 3)))[0] if turned else np.eye(3)
    far = [quad([5, 5, 5 + k / 10], [0.1, 0, 0], [0, 0.1, 0]) for k in range(70)] if tree else []
    host = t.native_scene(make([strips(turn), *far]))
    t.check(("bvh" in host.features) == tree, "tree")
    ends = np.array([[-1 + k / 2, y, -1] for k in range(5) for y in (-1, 1)], np.float64)
    a, b = ends[t.rng.integers(0, 10, n)], ends[t.rng.integers(0, 10, n)]
    edges = a + t.rng.random((n, 1)) * (b - a)
    bottom = np.concatenate([t.rng.uniform(-1.2, 1.2, (n, 2)), -np.ones((n, 1))], axis=1)
    for name, targets in (("edges", edges), ("anywhere", bottom)):
        origins = t.rng.uniform(-0.9, 0.9, (n, 3))
        ways = (targets - origins) @ turn.T
        distance, primitive = t.native.intersect(host, origins @ turn.T, ways)
        lost = (primitive < 0) | (distance > 4)
        t.figure(f"share of leaks at {name}", float(lost.mean()))
        limit = ((0.2 if turned else 0.01) if name == "edges" else 1e-5) if tree else 0.0
        t.check(lost.mean() <= limit, f"{lost.sum()} of {n} leak at {name}")


# ---- rays in odd directions ----


def rectangle_exit(origins: Array, ways: Array) -> Array:
    """Distance at which rays from inside the cube from -1 to 1 leave it."""
    with np.errstate(divide="ignore", invalid="ignore"):
        far = (np.copysign(1.0, ways) - origins) / ways
    far[ways == 0] = np.inf
    return far.min(axis=1)


@case(8, each={"cells": [1, 16]})
def rays_with_zero_components(t: Trial, cells: int) -> None:
    """Rays along axes, face and space diagonals, with zeros of both signs, through vertices.

    From every point of a lattice in a cube whose triangles end on that lattice, rays in all 26
    directions meet the cube, within 1e-6 of the exact point (without a tree 2e-6). From outside,
    lines one step off the cube miss it, and lines through it meet it where they must.
    """
    vertices, triangles, _ = leaks.cube(cells)
    host = t.native_scene(make([Part(vertices, triangles)], camera([0.3, 0.2, 0.1], [1, 1, 1])))
    steps = np.arange(-7, 8) / 8
    lattice = np.stack(np.meshgrid(steps, steps, steps, indexing="ij"), axis=-1).reshape(-1, 3)
    signs = np.array([(x, y, z) for x in (-1, 0, 1) for y in (-1, 0, 1) for z in (-1, 0, 1)
                      if x or y or z], float)  # fmt: skip
    for zero in (0.0, -0.0):
        ways = np.where(signs == 0, zero, signs)
        origins = np.repeat(lattice, len(ways), axis=0)
        ways = np.tile(ways, (len(lattice), 1))
        distance, primitive = t.native.intersect(host, origins, ways)
        t.check(primitive >= 0, "a ray from inside meets nothing")
        length = np.linalg.norm(ways, axis=1)
        off = np.abs(distance / length - rectangle_exit(origins, ways))
        t.check(off < (1e-6 if cells > 1 else 2e-6), f"a hit is {off.max():.2g} off")
    grid = np.arange(-10, 11) / 8
    for axis in range(3):
        u, v = (a.ravel() for a in np.meshgrid(grid, grid))
        origins = np.insert(np.stack([u, v], axis=1), axis, -3, axis=1)
        ways = np.zeros_like(origins)
        ways[:, axis] = 1
        distance, primitive = t.native.intersect(host, origins, ways)
        reach = np.maximum(np.abs(u), np.abs(v))
        t.check(primitive[reach < 1] >= 0, "a line through the cube misses it")
        t.check(np.abs(distance[reach < 1] - 2) < 2e-6, "a line meets the far side first")
        t.check(primitive[reach > 1] < 0, "a line beside the cube meets it")
        rim = distance[(reach == 1) & (primitive >= 0)]  # in the plane of a side: either
        t.check((rim > 2 - 2e-6) & (rim < 4 + 4e-6), "a hit in the plane of a side is off it")


@case(8, each={"turned": [False, True], "tree": [False, True]})
def rays_in_the_plane_of_a_triangle(t: Trial, turned: bool, tree: bool) -> None:
    """Rays that lie in a triangle's plane, along its edges and across it, in a closed box.

    Each meets the triangle within its outline, or the box. If the scene is rotated and in a tree,
    rays lie in the plane only to rounding, and at most 1 in 20 meets the plane beside the triangle.
    Every ray meets something, and no distance is NaN.
    """
    n = 40_000 * t.effort
    corners = np.array([[-0.5, -0.5, 0], [0.5, -0.25, 0], [-0.25, 0.5, 0]])
    far = [quad([k / 100 - 0.3, 0.8, -0.8], [0.005, 0, 0], [0, 0.1, 0]) for k in range(70)]
    room = box([-1, -1, -1], [1, 1, 1], True)
    parts = [Part(corners, [[0, 1, 2]]), room, *(far if tree else [])]
    turn = np.linalg.qr(np.random.default_rng(5).normal(size=(3, 3)))[0] if turned else np.eye(3)
    for part in parts:
        part.vertices = part.vertices @ turn.T
    host = t.native_scene(make(parts, camera(turn @ [0.1, 0.2, 0.7], turn @ [0, 0, 0])))
    origins = np.concatenate([t.rng.uniform(-0.95, 0.95, (n, 2)), np.zeros((n, 1))], axis=1)
    angle = t.rng.uniform(0, 2 * math.pi, n)
    ways = np.stack([np.cos(angle), np.sin(angle), np.zeros(n)], axis=1)
    edge = t.rng.integers(0, 3, n // 2)  # half of them run along an edge's line
    start, end = corners[edge], corners[(edge + 1) % 3]
    ways[: n // 2] = end - start
    origins[: n // 2] = start - 0.3 * t.rng.random((n // 2, 1)) * (end - start)
    ways /= np.linalg.norm(ways, axis=1)[:, None]
    distance, primitive = t.native.intersect(host, origins @ turn.T, ways @ turn.T)
    t.check(primitive >= 0, f"{(primitive < 0).sum()} rays meet nothing")
    t.check(np.isfinite(distance) & (distance > 0), "a distance is not finite and positive")
    at = (origins + distance[:, None] * ways)[:, :2]
    flat = np.array([[1.0, *c[:2]] for c in corners])
    weights = np.concatenate([np.ones((n, 1)), at], axis=1) @ np.linalg.inv(flat)
    inside = weights.min(axis=1) > -1e-5
    wall = (np.abs(np.abs(at).max(axis=1) - 1) < 1e-5) & (primitive > 0)
    beside = ~(inside | wall)
    t.figure("share beside the triangle", float(beside.mean()))
    t.check(beside.mean() <= (0.05 if turned and tree else 0), f"{beside.sum()} hits beside it")
    t.check(wall | (primitive == 0), "another surface is met")
    t.figure("share that meets the triangle", float((~wall).mean()))


# ---- grazing ----


@case(8, each={"cosine": [1e-3, 1e-4, 1e-5, 1e-6]})
def grazing_view_of_a_floor(t: Trial, cosine: float) -> None:
    """A diffuse floor under a sky of 1 at cosines of 1e-3 to 1e-6.

    Its albedo; sees 1 %. Two segments per path and no blocked shadow ray: no self-intersection
    (exact). A limit: a direction is rounded to 6e-8, so at 1e-7 the camera looks over the floor.
    """
    floor = quad([-30, -30, 0], [60, 0, 0], [0, 60, 0], 0.5)
    eye = camera([1, 0.3, cosine], [0, 0, 0], math.degrees(cosine) / 100)
    r = t.agrees(make([floor], eye, 1.0), 0.5, 50_000, 0.01)
    t.check(r.stats["live_rays"] == [r.spp, r.spp], "more than two segments")
    t.check(not any(r.stats["ledger"]["shadow_occluded"]), "the floor shades itself")


@case(8)
def grazing_glass(t: Trial) -> None:
    """A thin pane at 89.99 degrees reflects all but 1e-3.

    A sky of 1 on both sides gives 1 within 1e-5; a white ceiling over a sky of 0 gives over .99.
    """
    pane = dicts.flat("rectangle", [0, 0, 0], [0, 0, 1], 100,
                      dicts.glass(1.5, 1.0, "thindielectric"))  # fmt: skip
    up = dicts.flat("rectangle", [0, 0, 50], [0, 0, -1], 3e5, dicts.BLACK, 1)
    eye = dicts.view(50 * dicts.direction(89.99), [0, 0, 0], 1e-4)
    r = t.render(dicts.scene(eye, pane, dicts.sky(1)), 1000)
    t.check(np.abs(r.image - 1).max() < 1e-5, f"{r.image.ravel()} under a sky of 1")
    r = t.render(dicts.scene(eye, pane, up), 1000)
    t.check(r.image.min() > 0.99, f"{r.image.ravel()} from a ceiling of 1")


@case(8, each={"kind": ["diffuse", "mirror", "plastic"]})
def smooth_normals_let_no_light_out(t: Trial, kind: str) -> None:
    """A lamp in a closed mesh of 80 faces with smooth normals, seen from all sides outside.

    Exactly 0: no light comes through, whatever the normals are at grazing angles.
    """
    vertices, faces = leaks.icosphere(1)
    bsdf: dict[str, Any] = {"diffuse": {}, "mirror": {"material_kind": 1, "eta": 0.0, "k": 1.0},
                            "plastic": {"material_kind": 3, "eta": 1.5}}[kind]  # fmt: skip
    shell = Part(vertices, faces, 0.9, normals=vertices, material=bsdf)
    lamp = sphere([0, 0, 0], 0.3, 0.0, 10.0)
    for eye in t.rng.normal(size=(4, 3)):
        eye *= 3 / np.linalg.norm(eye)
        r = t.render(make([shell, lamp], camera(eye, [0, 0, 0], 45), width=16, height=16), 50)
        t.check(not r.image.any(), "light comes through")


# ---- degenerate, coincident and strange surfaces ----


@case(8)
def degenerate_parts_do_no_harm(t: Trial) -> None:
    """A thousand triangles in one place, with points and lines among them.

    The albedo under a sky of 1, sees 3 %; two dropped, a thousand kept, memory below 8 GiB.
    """
    corners = np.tile([[0.0, 0, 0], [1, 0, 0], [0, 1, 0]], (1000, 1))
    pile = Part(corners, np.arange(3000), 0.5)
    lines = Part([[0, 0, 1], [1, 1, 1], [2, 2, 1]], [[0, 1, 2], [0, 0, 0]], 0.5, 9.0)
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", veriray.SceneWarning)
        scene = make([pile, lines], camera([0.3, 0.3, 2], [0.3, 0.3, 0]), 1.0)
    kept = {k: n for k, n in t.native_scene(scene).primitives.items() if n}
    t.check(kept == {"triangles": 1000, "dropped": 2}, str(kept))
    t.agrees(scene, 0.5, 50_000, 0.03)
    t.check(resource.getrusage(resource.RUSAGE_SELF).ru_maxrss < 8 << 20, "memory")


@case(8, quick=False)
def a_million_triangles_in_one_place(t: Trial) -> None:
    """10^6 equal triangles: no box can separate them, and the tree stays bounded.

    The albedo under a sky of 1, sees 3 %; the scene takes less than 2 KiB per triangle.
    """
    n = 10**6
    pile = Part([[0.0, 0, 0], [1, 0, 0], [0, 1, 0]], np.tile([0, 1, 2], (n, 1)), 0.5)
    scene = make([pile], camera([0.3, 0.3, 2], [0.3, 0.3, 0]), 1.0)
    host = t.native_scene(scene)
    t.check(host.primitives["triangles"] == n, str(host.primitives))
    t.check(host.memory < 2048 * n, f"{host.memory} bytes")
    t.figure("tree", host.tree)
    # every ray visits them all
    origins = np.tile([0.3, 0.3, 2.0], (4, 1)) + [[0, 0, 0], [0.1, 0, 0], [0, 0.1, 0], [5, 0, 0]]
    _, primitive = t.native.intersect(host, origins, np.tile([0.0, 0, -1], (4, 1)))
    t.check(primitive.tolist() == [0, 0, 0, -1], str(primitive))
    r = t.render(scene, 4)
    t.check(r.stats["live_rays"][0] == r.spp and r.image.max() <= 1, "picture")


def behind(tree: bool) -> list[Part]:
    """Seventy small quads that make the scene need a tree, or nothing."""
    if not tree:
        return []
    return [quad([k / 100, 0, -1], [0.005, 0, 0], [0, 0.5, 0]) for k in range(70)]


@case(8, each={"tree": [False, True], "kind": ["quad", "triangle", "disk", "sphere"]})
def coincident_surfaces_show_the_first(t: Trial, tree: bool, kind: str) -> None:
    """Two surfaces in one place with different materials.

    The lower number wins every tie: the same bits as without the second surface, from above and at
    an edge seen from so near that rounding shows.
    """

    def surface(albedo: float) -> Part:
        if kind == "quad":
            return quad([-1, -1, 0], [2, 0, 0], [0, 2, 0], albedo)
        if kind == "triangle":
            return Part([[-1, -1, 0], [1, -1, 0.1], [-1, 1, 0.2]], [[0, 1, 2]], albedo)
        if kind == "disk":
            return disk([0, 0, 0], [1, 0, 0], [0, 0.9, 0.1], albedo)
        return sphere([0, 0, 0], 0.8, albedo)

    parts = [surface(0.2), surface(0.9), *behind(tree)]
    for eye in (camera([0.4, 0.3, 3], [0, 0, 0], 50), camera([1, 0.1, 3], [1, 0.1, 0], 1e-3)):
        seed = t.fresh()
        a, b = (t.render(make(p, eye, 1.0, 16, 16), 16, seed=seed)
                for p in (parts, [parts[0], *parts[2:]]))  # fmt: skip
        t.check(a.film_sha256 == b.film_sha256, "the second surface shows")
        t.check(a.stats["ledger"] == b.stats["ledger"], "the ledgers differ")


@case(8, each={"tree": [False, True]})
def coplanar_surfaces_that_overlap(t: Trial, tree: bool) -> None:
    """Emitting quads in one plane that partly overlap, with radiance 1 and 2.

    1 where the first is, 2 where only the second is, 0 elsewhere, at every pixel (exact).
    """
    first = quad([-1, -1, 0], [1.5, 0, 0], [0, 2, 0], 0, 1)
    second = quad([-0.5, -0.5, 0], [1.5, 0, 0], [0, 1, 0], 0, 2)
    size = 64
    eye = camera([0, 0, 4], [0, 0, 0], math.degrees(2 * math.atan(1.25 / 4)), up=[0, 1, 0])
    r = t.render(make([first, second, *behind(tree)], eye, width=size, height=size), 16)
    x = ((np.arange(size) + 0.5) / size * 2 - 1) * 1.25
    x, y = np.meshgrid(x, -x)  # +x is on the right of the picture
    outline = np.zeros((size, size), bool)
    exact = np.zeros((size, size))
    for low, high, radiance in (((-0.5, -0.5), (1, 0.5), 2), ((-1, -1), (0.5, 1), 1)):
        inside = (x > low[0]) & (x < high[0]) & (y > low[1]) & (y < high[1])
        exact[inside] = radiance
        for line in (x - low[0], x - high[0], y - low[1], y - high[1]):
            outline |= np.abs(line) < 0.03
    t.check((r.image[..., 0] == exact)[~outline], "a pixel differs")


GAPS = (0.0, 2.0**-24, 2.0**-23, 2.0**-20, 1e-5, 1e-3)


def room_in_room(gap: float, glow: float) -> veriray.Scene:
    """Two cubes in one another, the walls `gap` apart; the outer one glows by `glow`."""
    rooms = [box([0, 0, 0], [1, 1, 1], True, 0.5, 0.5),
             box([-gap, -gap, -gap], [1 + gap, 1 + gap, 1 + gap], True, 0.5, glow)]  # fmt: skip
    return make(rooms, camera([0.4, 0.45, 0.3], [0.6, 0.3, 1.0], 80), width=4, height=4)


@case(8, each={"gap": GAPS})
def walls_with_a_gap(t: Trial, gap: float) -> None:
    """A glowing room in a dark room, with walls zero, one or a few ulp apart.

    E / (1 - rho) = 1 at every pixel; sees 1 %. Nothing leaves, and nothing ends in the gap, except
    for the stated leaks at edges of flat rooms.
    """
    r = t.agrees(room_in_room(gap, 0.0), 1.0, 16_000, 0.01)
    t.sealed(r)
    lost = sum(r.stats["ledger"]["absorbed"])
    t.check(lost <= 5 + 1e-6 * sum(r.stats["live_rays"]), f"{lost} paths end in the gap")


@case(8, each={"gap": GAPS})
def glowing_walls_with_a_gap(t: Trial, gap: float) -> None:
    """A glowing room in a glowing room, with walls zero, one or a few ulp apart.

    E / (1 - rho) = 1 from a gap of 1e-5 on; sees 1 %. Two lamps in one place are not a valid scene:
    with a smaller gap, light samples count the hidden lamp too, which gives 1 to 1.25. Nothing
    leaves, and nothing ends in the gap.
    """
    room = room_in_room(gap, 0.5)
    if gap >= 1e-5:
        r = t.agrees(room, 1.0, 16_000, 0.01)
    else:
        r = t.render(room, 16_000)
        t.check((r.image > 0.98) & (r.image < 1.25), f"{r.image.min()} to {r.image.max()}")
    t.figure("mean", float(r.image.mean(dtype=np.float64)))
    t.sealed(r)
    lost = sum(r.stats["ledger"]["absorbed"])
    t.check(lost <= 5 + 1e-6 * sum(r.stats["live_rays"]), f"{lost} paths end in the gap")


@case(8, each={"gap": [2.0**-23, 1e-6, 1e-5, 1e-3], "tree": [False, True]})
def sheet_on_a_sheet(t: Trial, gap: float, tree: bool) -> None:
    """Two sheets `gap` apart, 1 ulp and more, rays from either side.

    Each ray meets one of the two; from 1e-5 on it is the nearer one.
    """
    n = 20_000 * t.effort
    low = quad([-1, -1, 0], [2, 0, 0], [0, 2, 0])
    high = quad([-1, -1, gap], [2, 0, 0], [0, 2, 0])
    host = t.native_scene(make([low, high, *behind(tree)], camera([0, 0, 1], [0, 0, 0])))
    targets = np.concatenate([t.rng.uniform(-0.9, 0.9, (n, 2)), np.full((n, 1), gap / 2)], axis=1)
    for side in (1, -1):
        origins = t.rng.uniform(-0.9, 0.9, (n, 3))
        origins[:, 2] = side * t.rng.uniform(0.3, 0.9, n)
        _, primitive = t.native.intersect(host, origins, targets - origins)
        near = (2, 3) if side > 0 else (0, 1)
        t.check((primitive >= 0) & (primitive < 4), "a ray passes both sheets")
        if gap >= 1e-5:
            t.check(np.isin(primitive, near), "the farther sheet is met")


@case(8, each={"distance": [1e3, 1e4], "tree": [False, True]})
def sheet_before_a_lamp_from_afar(t: Trial, distance: float, tree: bool) -> None:
    """A black sheet 2e-5 before a lamp of width 2, seen from 1,000 and 10,000 away.

    Exactly 0, though float32 lengths from the camera are off by 3e-5 and 5e-4 there. Of two equal
    distances the lower number counts, which is the lamp's. Pixels are wider than 2^-17, so the view
    is no narrow one.
    """
    lamp = quad([-1, -1, 0], [2, 0, 0], [0, 2, 0], 0.0, 1.0)
    sheet = quad([-1.01, -1.01, 2e-5], [2.02, 0, 0], [0, 2.02, 0])
    for _ in range(4):
        way = np.append(t.rng.uniform(-0.3, 0.3, 2), 1.0)
        eye = camera(distance * way, [0, 0, 0], 2 * math.degrees(math.atan(1 / distance)))
        r = t.render(make([lamp, sheet, *behind(tree)], eye, width=8, height=8), 64)
        t.check(not r.image.any(), f"the lamp shows, by up to {r.image.max()}")


@case(8, each={"kind": ["quad", "disk"], "far": [4e4, 1e5, 2e5]})
def small_lamp_over_a_ground_of_a_wide_scene(t: Trial, kind: str, far: float) -> None:
    """A lamp 0.02 to 0.1 wide, 1 above a ground, a planet of radius `far` below: 0.5. Sees 1 %.

    The lamp lights a wide scene from 2^-17, 2^-18 and 2^-19 of its size before the ground, which is
    no cover of it: unless it is sampled, one path in thousands finds it. The patch is 2e-3 wide,
    where pi L a^2 / (a^2 + h^2) and Lambert's rectangle are within 1e-4.
    """
    half = float(t.rng.uniform(0.01, 0.05))
    if kind == "disk":
        lamp = disk([0, 0, 1], [0, half, 0], [half, 0, 0], 0, 1 + half**-2)
    else:
        share = 4 * rectangle_above_corner(half, half)
        lamp = quad([-half, -half, 1], [0, 2 * half, 0], [2 * half, 0, 0], 0, 1 / share)
    ground = quad([-100, -100, 0], [200, 0, 0], [0, 200, 0], 0.5)
    eye = camera([2, 0, 2.5], [0, 0, 0], math.degrees(2e-3 / math.hypot(2, 2.5)))
    scene = make([ground, lamp, sphere([0, 0, -far - 0.5], far)], eye, width=4, height=4,
                 max_depth=2)  # fmt: skip
    t.agrees(scene, 0.5, 4096, 0.01, margin=1e-3)


@case(8, each={"share": [0.5, 1.0, 1.5, 3.0]})
def lamp_close_over_a_cover(t: Trial, share: float) -> None:
    """A lamp `share` times 2^-20 before a wider black sheet, a white body far beyond it: exactly 0.

    In a tree, turned any way, with the sheet through the middle of the scene or aside.
    """
    for k in range(16):
        turn = np.linalg.qr(t.rng.normal(size=(3, 3)))[0] if k % 4 else np.eye(3)
        turn *= np.linalg.det(turn)
        up = float(t.rng.uniform(0, 0.3)) * (k % 2)
        half = 10 ** float(t.rng.uniform(-3, -1))
        lamp = quad([-half, -half, up + share * 2.0**-20], [0, 2 * half, 0], [2 * half, 0, 0], 0,
                    half**-2)  # fmt: skip
        sheet = quad([-0.5, -0.5, up], [1, 0, 0], [0, 1, 0])
        body = quad([-0.5, -0.5, -0.55], [1, 0, 0], [0, 1, 0], 1.0)
        parts = [lamp, sheet, body, quad([0, 0, -0.56], [1e-5, 0, 0], [0, 1e-5, 0])]
        for part in parts:
            part.vertices = part.vertices @ turn.T
        eye = camera(turn @ [0.3, 0.4, -0.2], turn @ [0, 0, -0.55], 60, turn @ [1.0, 0, 0])
        r = t.render(make(parts, eye, width=8, height=8), 256)
        t.check(not r.image.any(), f"light comes through, up to {r.image.max()}")


@case(8, each={"kind": ["winding", "isolated vertices", "three on an edge", "open"]})
def meshes_that_are_no_solid(t: Trial, kind: str) -> None:
    """Mixed winding, isolated vertices, three faces on an edge, holes.

    A two-sided ball of 80 faces: isolated vertices change no bit, and other windings change no
    pixel by 1e-5. With a fin or a hole and an albedo of 1, it is lossless in a sky of 1: 1, sees
    1 %.
    """
    vertices, faces = leaks.icosphere(1)
    eye = camera([0, 1, 3.5], [0, 0, 0], 45)
    size = {"width": 12, "height": 12}
    if kind in ("winding", "isolated vertices"):
        other_vertices, other_faces = vertices, np.array(faces)
        if kind == "winding":
            flip = t.rng.random(len(faces)) < 0.5
            other_faces[flip] = other_faces[flip, ::-1]
        else:
            other_vertices = np.concatenate([vertices, t.rng.uniform(-0.5, 0.5, (50, 3))])
        seed = t.fresh()
        a, b = (t.render(make([Part(v, f, 0.7, two_sided=True)], eye, 1.0, **size), 64, seed=seed)
                for v, f in ((vertices, faces), (other_vertices, other_faces)))  # fmt: skip
        if kind == "isolated vertices":
            t.check(a.film_sha256 == b.film_sha256, "different bits")
        off = np.abs(a.image - b.image).max()
        t.check(off < 1e-5, f"a pixel differs by {off:.2g}")
        return
    if kind == "open":
        faces = faces[5:]
    else:
        vertices = np.concatenate([vertices, 1.7 * vertices[faces[0, :1]]])
        faces = np.concatenate([faces, [[faces[0, 0], faces[0, 1], len(vertices) - 1]]])
    white = Part(vertices, faces, 1.0, two_sided=True)
    t.agrees(make([white], eye, 1.0, **size, rr_depth=200, max_depth=2000), 1.0, 2_000, 0.01,
             margin=1e-3)  # fmt: skip


# ---- strange places ----


@case(8, each={"kind": ["triangle", "quad", "disk", "sphere"], "count": [0, 1, 2]})
def scenes_of_few_primitives(t: Trial, kind: str, count: int) -> None:
    """0, 1 and 2 primitives, emitting or grey, with and without a sky.

    The radiance of the one in view (exact), else the sky (exact); a grey one under a sky of 1 has
    its albedo within noise.
    """
    looks = camera([0, 0, 3], [0, 0, 0], 0.1)

    def primitive(k: int, albedo: float, radiance: float) -> Part:
        z = -float(k)
        if kind == "triangle":
            return Part([[-2, -2, z], [2, -2, z], [0.1, 3, z]], [[0, 1, 2]], albedo, radiance)
        if kind == "quad":
            return quad([-1, -1, z], [2, 0, 0], [0, 2, 0], albedo, radiance)
        if kind == "disk":
            return disk([0, 0, z], [1, 0, 0], [0, 1, 0], albedo, radiance)
        return sphere([0, 0, z], 0.4, albedo, radiance)

    for sky in (0.0, 0.25):
        parts = [primitive(k, 0.0, 2.0 + k) for k in range(count)]
        r = t.render(make(parts, looks, sky), 64)
        t.check(r.image == (2.0 if count else sky), f"{r.image.ravel()} of shining ones")
        r = t.render(make([primitive(k, 0.5, 0.0) for k in range(count)], looks), 64)
        t.check(r.image == 0, "light without a lamp")
    if count:
        t.agrees(make([primitive(k, 0.5, 0.0) for k in range(count)], looks, 1.0), 0.5, 20_000,
                 0.03)  # fmt: skip


@case(8)
def empty_and_dark(t: Trial) -> None:
    """No light, no surface, or neither.

    Black, the sky, black, exactly; no shadow ray is cast, and without surfaces a path has one
    segment.
    """
    sky = [0.25, 1.0, 4.0]
    room = box([0, 0, 0], [1, 1, 1], True, 0.5)
    inside = camera([0.5, 0.5, 0.5], [1, 0.9, 0.8], 60)
    rows: list[tuple[list[Part], Any, Any]] = [
        ([], 0.0, 0.0), ([], sky, sky), ([room], 0.0, 0.0), ([room], sky, 0.0),
    ]  # fmt: skip
    for parts, environment, exact in rows:
        r = t.render(make(parts, inside, environment, 7, 5), 20)
        t.check((r.image == np.float32(exact)) & (r.stderr == 0), "picture")
        t.check(not any(r.stats["ledger"]["shadow_visible"]), "shadow rays")
        t.check(bool(parts) or r.stats["live_rays"] == [35 * r.spp], "segments")


@case(8)
def camera_in_and_on_solids(t: Trial) -> None:
    """Inside a solid emitter, in a glowing room, on faces, edges and corners.

    Backs do not emit: black, all absorbed. A room's front: its radiance. On a surface: finite, at
    most the emitted radiance.
    """
    view = camera([0, 0, 0], [1, 2, 3], 90)
    solid = box([-1, -1, -1], [1, 1, 1], False, 0.5, 3.0)
    r = t.render(make([solid], view, 1.0, 6, 6), 20)
    t.check(not r.image.any(), "a back shines")
    t.check(r.stats["ledger"]["absorbed"] == [36 * r.spp], "ends")
    shining = box([-1, -1, -1], [1, 1, 1], True, 0.0, 3.0)
    r = t.render(make([shining], view, 1.0, 6, 6), 20)
    t.check(r.image == 3, "a room's walls")
    t.check(r.stats["ledger"]["emitter_end"] == [36 * r.spp], "ends")
    sheet = quad([-1, -1, 0], [2, 0, 0], [0, 2, 0], 0.5, two_sided=True)
    for part in (solid, shining, sheet):
        for where in ([0, 0, 1.0], [1, 1, 1], [0, 0, 0]):
            r = t.render(make([part], camera(where, [3, 4, 5], 90), 1.0, 6, 6), 50)
            t.check(np.isfinite(r.image) & (r.image <= 4), "a pixel on a surface")


@case(8)
def edges_of_solids_from_within(t: Trial) -> None:
    """Rays from within a dark solid, aimed at its edges by views of 3e-4: none leaves.

    Sheared boxes and tetrahedra, without a tree. Rims of 2^-20 of the scene
    (`cpp/geometry/polygon.h`) are met by 0.2 to 2 % of these rays.
    """
    cube = box([-1, -1, -1], [1, 1, 1], False)
    corners = np.array([[-1, -1, -1], [1, 1, -1], [1, -1, 1], [-1, 1, 1.0]])
    pointed = Part(corners, [[0, 2, 1], [0, 1, 3], [0, 3, 2], [1, 2, 3]])
    for body in (cube, cube, pointed, pointed):
        turn = np.linalg.qr(t.rng.normal(size=(3, 3)))[0] @ np.diag(t.rng.uniform(0.5, 2, 3))
        turn *= np.linalg.det(turn) / abs(np.linalg.det(turn))
        solid = Part(body.vertices @ turn.T, body.faces)
        for face in t.rng.choice(solid.faces, 3):
            a, b = solid.vertices[t.rng.choice(face, 2, replace=False)]
            view = camera(t.rng.uniform(-0.1, 0.1, 3), a + t.rng.uniform(0, 1) * (b - a), 0.02)
            r = t.render(make([solid], view, 1.0, 64, 64, max_depth=1), 16)
            t.check(r.stats["ledger"]["escaped"] == [0], "ends")


@case(8, each={"side": (1, 2, 12), "shines": (True, False)})
def sheets_of_two_faces(t: Trial, side: int, shines: bool) -> None:
    """Two one-sided sheets with the same corners, back to back: each side shows its own front.

    Of 2 to 288 faces, in any order, with corners in any order, anywhere. Lamps of 1 and 3, or white
    and grey under a sky: exact.
    """
    x = np.linspace(-1, 1, side + 1)
    flat = np.stack([*np.meshgrid(x, x, indexing="ij"), np.zeros((side + 1, side + 1))], axis=2)
    first = np.add.outer((side + 1) * np.arange(side), np.arange(side)).ravel()
    a, b = [first, first + side + 1, first + side + 2], [first, first + side + 2, first + 1]
    faces = np.stack([*a, *b], axis=1).reshape(-1, 3)
    for _ in range(4):
        turn = np.linalg.qr(t.rng.normal(size=(3, 3)))[0]
        place = t.rng.normal(size=3) * 10 ** t.rng.uniform(-2, 2)
        vertices = flat.reshape(-1, 3) @ turn.T + place
        looks = [(0.0, 1.0), (0.0, 3.0)] if shines else [(1.0, 0.0), (0.25, 0.0)]
        parts = []
        for k, (albedo, emission) in enumerate(looks):
            turned = faces[:, ::-1] if k else faces
            turned = np.array([np.roll(face, t.rng.integers(3)) for face in turned])
            parts.append(Part(vertices, t.rng.permutation(turned), albedo, emission))
        up = np.linalg.det(turn) * turn[:, 2]
        for k, (albedo, emission) in enumerate(looks):
            eye = place + (1 - 2 * k) * up * 3 + 0.5 * t.rng.normal(size=3)
            view = camera(eye, place + turn @ np.array([0.1, 0.2, 0.0]), 8)
            r = t.render(make(parts[:: t.rng.choice([-1, 1])], view, 1.0, 24, 24), 16)
            t.check(r.image == albedo + emission, f"side {k}")


@case(8)
def camera_in_odd_places(t: Trial) -> None:
    """The camera on a glass ball, a fog ball or a disk, in a point light or an emitting ball.

    Finite, and the ledger adds up, for three directions from three places.
    """
    things: list[dict[str, Any]] = [
        dicts.sphere([0, 0, 1], 1, dicts.glass(1.5)),
        dicts.sphere([0, 0, 1], 1, dicts.NULL, interior=dicts.medium(1.0, 0.5)),
        dicts.flat("disk", [0, 0, 0], [0, 0, 1], 1,
                   {"type": "twosided", "bsdf": dicts.diffuse(0.5)}),
        dicts.sphere([0, 0, 0], 1, dicts.BLACK, 5),
        {"type": "point", "position": np.zeros(3), "intensity": dicts.rgb(1)},
    ]  # fmt: skip
    for thing in things:
        for target in ([0, 0, 1], [1, 0, 0], [0.5, 0.2, -1]):
            for at in ([0, 0, 0], [0, 0, 1], [0, 0, 2]):
                if np.allclose(at, target):
                    continue
                eye = dicts.view(at, target, 90, 4)
                r = t.render(dicts.scene(eye, thing, dicts.sky(1), max_depth=200), 64)
                t.check(np.isfinite(r.image), "a pixel")


@case(8)
def a_hundred_shells(t: Trial) -> None:
    """Nested null shells in front of a sky of 3.

    200 passes per ray, and the sky itself behind them (exact).
    """
    shells = [dicts.sphere([0, 0, 0], 1 + 0.01 * k, dicts.NULL) for k in range(100)]
    eye = dicts.view([0.3, 0, 9], [0.3, 0, 0])
    r = t.render(dicts.scene(eye, *shells, dicts.sky(3)), 100)
    t.check(r.image == 3, "the sky")
    t.check(r.stats["live_rays"] == [r.spp] * 201, "passes")


@case(8)
def mirrored_and_stretched(t: Trial) -> None:
    """A mirrored world and camera; a box of 10^6 : 1.

    The same picture within noise (t test of 64 batch means per channel); E / (1 - rho) = 1 in the
    box, which stays closed except for the stated leaks at edges.
    """
    room = veriray.cornell_box().with_(width=24, height=24)
    flip = np.diag([-1.0, 1.0, 1.0])
    to_world = np.array(room.camera.to_world)
    to_world[:3] = flip @ to_world[:3]
    mirrored = dataclasses.replace(
        room, vertices=room.vertices @ flip, triangles=room.triangles[:, ::-1],
        camera=dataclasses.replace(room.camera, to_world=to_world),
    )  # fmt: skip
    a, b = (t.render(s, 64, batches=64) for s in (room, mirrored))
    x, y = (np.asarray(r.batch_means, np.float64) for r in (a, b))
    d = (x - y).mean(axis=(1, 2))
    t.p(min(1.0, 3 * float(stats.ttest_1samp(d, 0).pvalue.min())), "mirrored")
    walls = box([0, 0, 0], [1, 1, 1e-6], True, 0.5, 0.5)
    thin = make([walls], camera([0.4, 0.3, 0.5e-6], [0.9, 0.3, 0.6e-6], 1.0))
    r = t.agrees(thin, 1.0, 20_000, 0.05, margin=1e-3)
    t.sealed(r)


@case(8, once=True)
def singular_transform_is_refused(t: Trial) -> None:
    """A rectangle scaled by 0 along one axis.

    A SceneError that says so.
    """
    flat = {"type": "rectangle", "to_world": np.diag([1.0, 0.0, 1.0, 1.0])}
    sensor = {"type": "perspective", "fov": 40.0}
    t.raises(veriray.SceneError,
             lambda: veriray.load_dict({"type": "scene", "sensor": sensor, "flat": flat}),
             "singular")  # fmt: skip
