"""Levels 1 and 8: rays against triangles, spheres and discs, by float64, and in the worst cases.

Radii run from 1e-6 to 1e6 with surfaces through [-1, 1]^3, as scenes are normalised.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
import numpy.typing as npt
import trimesh

from veriray.scene import load_file
from veriray_validate.oracles import directions, normalised
from veriray_validate.scenes import Part, box, camera, make, quad
from veriray_validate.trial import Inconclusive, Trial, case

Array = npt.NDArray[Any]

RAYS = 200_000
#: Sphere radii, lower ends of a decade; 0 stands for ground: 0.5 to 1, seen from 5e-7 above.
RADII = [10.0**k for k in range(-6, 6)]


def need(condition: Any, what: str) -> None:
    """Conditions on the inputs for a valid answer."""
    if not np.all(condition):
        raise Inconclusive(what)


# ---- triangles ----


def brute_force(scene: Any, o: Array, d: Array) -> tuple[Array, ...]:
    """t, triangle (-1: none), |cos| of the ray to it, and whether the answer is clear.

    Clear: no edge near or before the hit within 1e-5 of the scene, no second hit within 1e-4.
    T. Moeller, B. Trumbore, 1997, in float64.
    """
    v = scene.vertices[scene.triangles]
    e1, e2 = v[:, 1] - v[:, 0], v[:, 2] - v[:, 0]
    normal = np.cross(e1, e2)
    area = np.linalg.norm(normal, axis=1)
    longest = np.max([np.linalg.norm(v[:, k] - v[:, k - 1], axis=1) for k in range(3)], axis=0)
    size = np.ptp(v.reshape(-1, 3), axis=0).max()
    columns = []
    for k in range(0, len(o), 500):
        ray, s = d[k : k + 500, None], o[k : k + 500, None] - v[:, 0]
        p, q = np.cross(ray, e2), np.cross(s, e1)
        det = (p * e1).sum(-1)
        b1, b2, far = (p * s).sum(-1) / det, (q * ray).sum(-1) / det, (q * e2).sum(-1) / det
        depth = np.minimum(np.minimum(b1, b2), 1 - b1 - b2) * area / longest  # inside an edge
        hits = np.where((depth >= 0) & (far > 0), far, np.inf)
        at, t = hits.argmin(1), hits.min(1)
        cos = np.abs(det) / area
        doubt = (np.abs(depth) * cos < 1e-5 * size) & (far > -1e-4) & (far <= t[:, None] + 1e-4)
        doubt |= (depth > -1e-5 * size) & (np.abs(far) < 1e-4 * size)
        second = np.partition(hits, 1, axis=1)[:, 1]
        clear = ~doubt.any(1) & (np.isinf(t) | (second > t + 1e-4 * size))
        columns.append((t, np.where(np.isinf(t), -1, at), np.take_along_axis(
            cos, at[:, None], 1)[:, 0], clear))  # fmt: skip
    t, at, cos, clear = (np.concatenate(c) for c in zip(*columns, strict=True))
    return t, at, cos, clear


def random_rays(rng: np.random.Generator, n: int) -> tuple[Array, Array]:
    """Rays from points of [-1, 1]^3 in all directions."""
    return rng.uniform(-1, 1, (n, 3)), directions(rng, n)


def soup(rng: np.random.Generator, triangles: int, size: float, least: float = 0.0) -> Part:
    """Triangles with corners about points of [-1, 1]^3; least: height.

    Below 2^-8 of the soup's size, which is 8 at most, they need a tree.
    """
    v = rng.uniform(-1, 1, (4 * triangles, 1, 3)) + rng.normal(0, size, (4 * triangles, 3, 3))
    longest = np.max([np.linalg.norm(v[:, k] - v[:, k - 1], axis=1) for k in range(3)], axis=0)
    height = np.linalg.norm(np.cross(v[:, 1] - v[:, 0], v[:, 2] - v[:, 0]), axis=1) / longest
    return Part(v[height >= least][:triangles], np.arange(3 * triangles))


CLOSE_TO_NO_FACE = camera([0, 0, 0], [0, 0, 1], projection="orthographic")
SOUPS = {12: 0.6, 60: 0.3, 100: 0.3, 2000: 0.1}


@case(1, each={"triangles": SOUPS})
def triangles_against_brute_force(t: Trial, triangles: int) -> None:
    """The closest triangle to 2,000 rays, flat below 64 and in a tree above.

    The same triangle, and t within a relative 1e-5. If the ray is near the surface or grazes it,
    the rounding of its origin counts and, without a tree, so do the 2^-22 of the scene's size by
    which planes stand back: 1e-6 / cos and 1.5e-6 size / cos.
    """
    mesh = soup(t.rng, triangles, SOUPS[triangles], 0.04 * (triangles <= 64))
    scene = make([mesh], CLOSE_TO_NO_FACE)
    host = t.native_scene(scene)
    t.check(("bvh" in host.features) == (triangles > 64), "tree")
    o, d = random_rays(t.rng, 2000)
    exact, triangle, cos, clear = brute_force(scene, o, d)
    got_t, got = t.native.intersect(host, o, d)
    need(clear.mean() > 0.9, "too many rays in doubt")
    t.check((got == triangle)[clear], "triangle")
    hit = clear & (triangle >= 0)
    need(hit.sum() > 100, "too few hits")
    error = np.abs(got_t[hit] - exact[hit])
    size = np.abs(scene.vertices).max()
    bound, middle = (1e-6, 3e-7) if triangles > 64 else (1.5e-6 * size, 5e-6 * size)
    t.check(error < np.maximum(1e-5 * exact[hit], bound / cos[hit]), "t")
    t.check((error * cos[hit]).max() < bound, "t")
    t.check(np.median(error / exact[hit]) < middle, "median error of t")
    t.check(np.isinf(got_t[got < 0]), "missed")


@case(1)
def flat_and_tree_agree(t: Trial) -> None:
    """The same triangles with and without distant ones that make the scene need a tree.

    The same triangle if the answer is clear, and the plane's distance within 4e-6.
    """
    few = soup(t.rng, 40, 0.4, 0.04)
    scatter = quad([1e-3, 5, 5], [1e-3, 0, 0], [0, 1e-3, 0])
    o, d = random_rays(t.rng, 5_000)
    flat = t.native_scene(make([few], CLOSE_TO_NO_FACE))
    tree = t.native_scene(make([few, scatter], CLOSE_TO_NO_FACE))
    t.check("bvh" in tree.features and "bvh" not in flat.features, "tree")
    t1, k1 = t.native.intersect(flat, o, d)
    t2, k2 = t.native.intersect(tree, o, d)
    _, _, cos, clear = brute_force(make([few]), o, d)
    t.check((k1 == k2)[clear], "triangle")
    hit = clear & (k1 >= 0)
    t.check((np.abs(t2[hit] - t1[hit]) * cos[hit]).max() < 4e-6, "t")


@case(1)
def coplanar_triangles_become_quads(t: Trial) -> None:
    """Cornell box of Mitsuba: 18 parallelograms. The measured one: its sides are not all flat.

    18 quads; at most 20 quads and polygons and no triangle.
    """
    mitsuba = t.native_scene(load_file("cornell-box-mitsuba")).primitives
    t.check({k: n for k, n in mitsuba.items() if n} == {"quads": 18}, f"{mitsuba}")
    measured = t.native_scene(load_file("cornell-box")).primitives
    t.check(measured["quads"] + measured["polygons"] <= 20, f"{measured}")
    t.check(measured["triangles"] == 0, f"{measured}")


# ---- closed meshes ----


def aimed(rng: np.random.Generator, mesh: trimesh.Trimesh, where: str,
          rays: int = RAYS) -> tuple[Array, Array]:  # fmt: skip
    """Rays from inside a convex mesh about the origin, at its vertices, edges or midpoints."""
    if where == "vertices":
        target = mesh.vertices[rng.integers(0, len(mesh.vertices), rays)]
    else:
        a, b = mesh.vertices[mesh.edges_unique[rng.integers(0, len(mesh.edges_unique), rays)]
                             ].transpose(1, 0, 2)  # fmt: skip
        s = 0.5 if where == "midpoints" else rng.random((rays, 1))
        target = a + s * (b - a)
    corners = mesh.vertices[rng.integers(0, len(mesh.vertices), (rays, 4))]
    o = 0.6 * (rng.dirichlet(np.ones(4), rays)[:, :, None] * corners).sum(axis=1)
    return o, normalised(target - o)


def rotated(mesh: trimesh.Trimesh, rng: np.random.Generator) -> trimesh.Trimesh:
    """Rotated and stretched by up to 3, so that nothing is aligned with an axis."""
    turn = trimesh.transformations.random_rotation_matrix(rng.random(3))[:3, :3]
    mesh = mesh.copy()
    mesh.vertices = mesh.vertices * rng.uniform(0.4, 1.2, 3) @ turn.T
    return mesh


MESHES: dict[str, Callable[[np.random.Generator], trimesh.Trimesh]] = {
    "box": lambda rng: trimesh.creation.box((2, 2, 2)),
    "box turned": lambda rng: rotated(trimesh.creation.box((2, 2, 2)), rng),
    "icosahedron turned": lambda rng: rotated(trimesh.creation.icosphere(0), rng),
    "icosphere of 1280 faces": lambda rng: trimesh.creation.icosphere(3),
    "icosphere of 20480 faces turned": lambda rng: rotated(trimesh.creation.icosphere(5), rng),
}
AIMS = ("vertices", "edges", "midpoints")


@case(8, each={"name": MESHES, "where": AIMS})
def closed_meshes_do_not_leak(t: Trial, name: str, where: str) -> None:
    """Rays aimed at vertices, edges and midpoints of closed meshes, from inside and outside.

    0 of 200,000 leak each way, and both ways meet in one place (1e-4).
    """
    mesh = MESHES[name](t.rng)
    host = t.native_scene(make([Part(mesh.vertices, mesh.faces)]))
    t.check(("bvh" in host.features) == name.startswith("icosphere"), "tree")
    o, d = aimed(t.rng, mesh, where, RAYS * t.effort)
    at, triangle = t.native.intersect(host, o, d)
    t.check((triangle < 0).sum() == 0, f"{(triangle < 0).sum()} leak from inside")
    t.check(np.isfinite(at) & (at > 0), "distance")
    # The same points from outside, with rays that continue inwards: the near side must stop them.
    far = 2 * at[:, None].astype(np.float64)
    back, triangle = t.native.intersect(host, o + far * d, -d)
    t.check((triangle < 0).sum() == 0, f"{(triangle < 0).sum()} leak from outside")
    t.check(np.abs(back - at).max() < 1e-4, "two places")


@case(8, once=True)
def the_aim_is_good(t: Trial) -> None:
    """Planted: the test of Moeller and Trumbore in float32 leaks at vertices.

    More than 1 in 100 of the rays with which leaks are sought.
    """
    mesh = MESHES["icosahedron turned"](t.rng)
    o, d = (a[:, None].astype(np.float32) for a in aimed(t.rng, mesh, "vertices", 20_000))
    v = mesh.vertices[mesh.faces].astype(np.float32)
    e1, e2, s = v[:, 1] - v[:, 0], v[:, 2] - v[:, 0], o - v[:, 0]
    p, q = np.cross(d, e2), np.cross(s, e1)
    det = (p * e1).sum(-1)
    with np.errstate(divide="ignore", invalid="ignore"):  # rays in the plane of a face
        b1, b2, at = (p * s).sum(-1) / det, (q * d).sum(-1) / det, (q * e2).sum(-1) / det
    hit = ((b1 >= 0) & (b2 >= 0) & (b1 + b2 <= 1) & (at > 0)).any(axis=1)
    t.check((~hit).mean() > 0.01, f"only {(~hit).mean():.2g} leak")


@case(8)
def split_edges_do_not_leak(t: Trial) -> None:
    """A box of quads, one wall of which is four strips: T-junctions along two edges.

    0 of 200,000 rays at the strips' edges leak.
    """
    strips = [quad([-1 + k / 2, -1, -1], [0, 2, 0], [0.5, 0, 0]) for k in range(4)]
    walls = box([-1, -1, -1], [1, 1, 1], True)
    walls.faces = walls.faces[(walls.vertices[walls.faces][:, :, 2] > -1).any(axis=1)]
    host = t.native_scene(make([walls, *strips]))
    t.check(host.primitives["quads"] == 9, "quads")
    n = RAYS * t.effort
    ends = np.array([[-1 + k / 2, y, -1] for k in range(5) for y in (-1, 1)], np.float64)
    a, b = ends[t.rng.integers(0, 10, n)], ends[t.rng.integers(0, 10, n)]
    target = a + t.rng.random((n, 1)) * (b - a)
    o = t.rng.uniform(-0.9, 0.9, (n, 3))
    _, triangle = t.native.intersect(host, o, target - o)
    t.check((triangle < 0).sum() == 0, f"{(triangle < 0).sum()} leak")


@case(8)
def slivers_do_not_leak(t: Trial) -> None:
    """A closed prism whose sides are slivers of 1 to 1e6.

    0 of 600,000 rays at vertices, edges and midpoints leak.
    """
    n = 40
    angle = np.cumsum(np.where(np.arange(n) % 2, 2e-6, 4 * np.pi / n))
    angle *= 2 * np.pi / angle[-1]
    ring = np.stack([np.cos(angle), np.sin(angle), np.zeros(n)], axis=1)
    vertices = np.concatenate([ring - [0, 0, 1], ring + [0, 0, 1], [[0, 0, -1], [0, 0, 1]]])
    i, j = np.arange(n), (np.arange(n) + 1) % n
    down, up = np.full(n, 2 * n), np.full(n, 2 * n + 1)
    faces = np.concatenate([np.stack(c, axis=1) for c in (
        (i, j, n + j), (i, n + j, n + i), (j, i, down), (n + i, n + j, up))])  # fmt: skip
    mesh = trimesh.Trimesh(vertices, faces, process=False)
    need(mesh.is_watertight, "the mesh is not closed")
    host = t.native_scene(make([Part(vertices, faces)]))
    t.check("bvh" in host.features, "tree")
    for where in AIMS:
        _, triangle = t.native.intersect(host, *aimed(t.rng, mesh, where, RAYS * t.effort))
        t.check((triangle < 0).sum() == 0, f"{(triangle < 0).sum()} leak at {where}")


@case(8)
def degenerate_triangles_are_dropped(t: Trial) -> None:
    """Triangles with repeated vertices or no area.

    Dropped and counted; the power of lights leaves them out: the picture has the same bits.
    """
    floor = quad([-1, -1, 0], [2, 0, 0], [0, 2, 0], 0.5)
    bad = Part([[0, 0, 1], [1, 0, 1], [2, 0, 1]], [[0, 1, 2], [0, 0, 1], [1, 1, 1]], 0, 1e6)
    lamp = quad([0.5, -0.5, 1], [-1, 0, 0], [0, 1, 0], 0, 1)
    host = t.native_scene(make([floor, bad, lamp], camera([0, 0, 3], [0, 0, 0])))
    found = {k: n for k, n in host.primitives.items() if n}
    t.check(found == {"quads": 2, "dropped": 3}, f"{found}")
    view, seed = {"width": 8, "height": 8}, t.fresh()
    images = [t.render(make(p, **view), 16, seed=seed, max_depth=3).film_sha256
              for p in ([floor, bad, lamp], [floor, lamp])]  # fmt: skip
    t.check(images[0] == images[1], "bits")


@case(8, each={"tree": [False, True]})
def coincident_surfaces_show_the_first(t: Trial, tree: bool) -> None:
    """Two quads in one place, with and without a tree.

    Every hit is that of the first quad, at the distance with the first alone, bit for bit. Rays
    within 2e-6 of the rim are left out, because surfaces that share an edge are widened by 2^-22 of
    the scene there.
    """
    first = quad([-1, -1, 0], [2, 0, 0], [0, 2, 0], 0.2)
    second = quad([-1, -1, 0], [2, 0, 0], [0, 2, 0], 0.9)
    far = [quad([k / 100, 0, -1], [0.005, 0, 0], [0, 0.5, 0]) for k in range(70)] if tree else []
    o, d = random_rays(t.rng, 20_000 * t.effort)
    eye = camera([0.3, 0.2, 2], [0, 0, 0])
    both, alone = (t.native_scene(make([*p, *far], eye)) for p in ([first, second], [first]))
    t2, k2 = t.native.intersect(both, o, d)
    t1, k1 = t.native.intersect(alone, o, d)
    t.check(("bvh" in both.features) == tree, "tree")
    t.check(~np.isin(k2, [2, 3]), "the second shows")
    at = o - d * (o[:, 2:] / d[:, 2:])
    plain = np.abs(np.abs(at[:, :2]).max(axis=1) - 1) > 2e-6
    t.check((t1 == t2)[plain], "distances")
    t.check((np.isin(k2, [0, 1]) == np.isin(k1, [0, 1]))[plain], "hits")


@case(8, each={"name": ["box turned", "icosphere of 1280 faces"]})
def rays_do_not_meet_what_they_leave(t: Trial, name: str) -> None:
    """65,536 paths in a rotated box and in a closed mesh.

    Nothing escapes, nothing is absorbed by a back, no shadow ray is occluded, except for the stated
    leaks at edges. Sees 2 in 100,000 segments.
    """
    mesh = MESHES[name](t.rng)
    wall = Part(mesh.vertices, mesh.faces[:, ::-1], 0.9, 1.0)
    t.leaks(t.render(make([wall], width=16, height=16), 256, max_depth=20))


# ---- spheres ----


def evaluate(t: Trial, name: str, *columns: Any) -> Array:
    """Columns, (n,) or (n, k) or one number, to rows of float32."""
    n = max(len(np.atleast_1d(np.asarray(c))) for c in columns)
    parts = [np.broadcast_to(np.asarray(c, np.float32), (n,)) if np.ndim(c) < 2 else c
             for c in columns]  # fmt: skip
    rows = np.concatenate([np.asarray(p, np.float32).reshape(n, -1) for p in parts], axis=1)
    out: Array = t.native.eval_function(name, rows)
    return out


def unit(v: Array) -> Array:
    """Rows of unit length, to within rounding, in float32."""
    return normalised(v).astype(np.float32)


class Spheres:
    """Spheres with a point of the surface uniform in [-reach, reach]^3 and its outward normal."""

    def __init__(self, rng: np.random.Generator, n: int, low: float, high: float,
                 reach: float = 1.0) -> None:  # fmt: skip
        self.radius = np.exp(rng.uniform(np.log(low), np.log(high), n))
        self.at, self.normal = rng.uniform(-reach, reach, (n, 3)), directions(rng, n)
        centre = self.at - self.normal * self.radius[:, None]
        exact = np.concatenate([centre, self.radius[:, None]], axis=1)
        high_part = exact.astype(np.float32)
        low_part = (exact - high_part).astype(np.float32)
        self.record = np.concatenate([high_part[:, :3], low_part[:, :3],
                                      high_part[:, 3:], low_part[:, 3:]], axis=1)  # fmt: skip
        sums = high_part.astype(np.longdouble) + low_part
        self.centre, self.r = sums[:, :3], sums[:, 3]


def dot(a: Array, b: Array) -> Array:
    """Of rows."""
    total: Array = (a * b).sum(axis=1)
    return total


class Exact:
    """The line o + t d against spheres in long doubles.

    t of the first hit (infinite: none), normal there, square of half the chord over r^2, height of
    o over the surface.
    """

    def __init__(self, s: Spheres, o: Array, d: Array) -> None:
        f, d = o.astype(np.longdouble) - s.centre, d.astype(np.longdouble)
        a = dot(d, d)
        middle = -dot(f, d) / a
        nearest = f + middle[:, None] * d
        square = (s.r**2 - dot(nearest, nearest)) / a
        half = np.sqrt(np.maximum(square, 0))
        far = middle + np.where(middle < 0, -half, half)
        outside = (dot(f, f) - s.r**2) / a
        with np.errstate(divide="ignore", invalid="ignore"):
            near = outside / far
        t = np.where(near > 0, near, far)
        self.square = square / s.r**2
        self.t = np.where((square >= 0) & (t > 0), t, np.inf)
        self.normal = (f + np.where(np.isinf(self.t), 0, self.t)[:, None] * d) / s.r[:, None]
        self.height = outside / (np.sqrt(dot(f, f)) + s.r)


def towards(rng: np.random.Generator, s: Spheres, o: Array) -> Array:
    """Half of the directions at points of the ball about each sphere, 1 % larger; half random."""
    n = len(o)
    target = s.centre + s.r[:, None] * directions(rng, n) * 1.01 * rng.random((n, 1)) ** (1 / 3)
    way = (target - o.astype(np.longdouble)).astype(np.float64)
    return unit(np.where(np.arange(n)[:, None] % 2, way, directions(rng, n)))


@case(1, each={"radius": RADII[::3]})
def first_hit_of_spheres(t: Trial, radius: float) -> None:
    """Rays from 1e-6 to 1e6 radii off a sphere, outside and inside, against long doubles.

    The same answer unless the ray passes within 1e-9 r^2 of tangency; t within 1e-6 of itself;
    normal within 3e-7; the point within its stated offset of the surface.
    """
    rng = t.rng
    for exponent in range(-6, 7, 2):
        for side in (1, -1) if exponent < 0 else (1,):
            s = Spheres(rng, 4_000, radius, 10 * radius)
            away = (s.r * (1 + side * 10.0**exponent))[:, None]
            tilt = s.normal + directions(rng, 4_000) / np.maximum(s.radius, 0.1)[:, None]
            o = (s.centre + unit(tilt) * away).astype(np.float32)
            d = towards(rng, s, o)
            exact = Exact(s, o, d)
            got = evaluate(t, "sphere", s.record, o, d, np.inf).astype(np.float64)
            clear = np.abs(exact.square) > 1e-9
            t.check((np.isinf(got[:, 0]) == np.isinf(exact.t))[clear], "hit or miss")
            hit = clear & np.isfinite(exact.t) & np.isfinite(got[:, 0])
            need(hit.sum() > 1_000, "too few hits")
            off_surface = hit & (np.abs(exact.height) > 5e-7 * s.r)
            t.check(np.abs(got[off_surface, 0] / exact.t[off_surface] - 1).max() < 1e-6, "t")
            if exponent <= 4:
                plain = hit & (exact.square > 1e-5)
                t.check(np.abs(got[:, 4:7] - exact.normal)[plain].max() < 3e-7, "normal")
            t.check(np.abs(np.linalg.norm(got[hit, 4:7], axis=1) - 1).max() < 3e-7, "length")
            off = np.linalg.norm((got[:, 1:4] - s.centre).astype(np.float64), axis=1) - s.r
            if exponent <= 4:
                t.check((np.abs(off) / got[:, 7])[hit].max() < 0.75, "offset")


@case(1)
def ground_seen_from_above(t: Trial) -> None:
    """A sphere of radius 0.5 to 1, the camera 5e-7 above it.

    t within 1e-6 of the exact one, in the median below 1e-5.
    """
    s = Spheres(t.rng, 50_000, 0.5, 1.0, 1e-3)
    o = (s.at + 5e-7 * s.normal).astype(np.float32)
    d = unit(directions(t.rng, 50_000) - t.rng.random((50_000, 1)) * s.normal)
    exact = Exact(s, o, d)
    got = evaluate(t, "sphere", s.record, o, d, np.inf)[:, 0]
    clear = np.abs(exact.square) > 1e-12
    t.check((np.isinf(got) == np.isinf(exact.t))[clear], "hit or miss")
    hit = clear & np.isfinite(exact.t)
    need(hit.sum() > 25_000 and np.median(exact.t[hit]) < 1e-5, "too few near hits")
    t.check(np.abs(got[hit] / exact.t[hit] - 1).max() < 1e-6, "t")


@case(1, once=True)
def the_plain_quadratic_would_not_do(t: Trial) -> None:
    """Planted: b^2 - c in float32 errs by more than a tenth where ours does not.

    In 6 % of the hits of near ground, and in 28 % of those of spheres 10,000 radii away.
    """
    rng = t.rng
    n = 20_000
    for s, away in ((Spheres(rng, n, 0.5, 1.0), 1e-6), (Spheres(rng, n, 1e-4, 1e-4), 1e4)):
        o = (s.centre + s.normal * s.r[:, None] * (1 + away)).astype(np.float32)
        d = towards(rng, s, o)[1::2]
        exact = Exact(s, o, np.repeat(d, 2, axis=0))
        f = (o - s.record[:, :3])[1::2]
        b, c = dot(f, d), dot(f, f) - s.record[1::2, 6] ** 2
        at = -b - np.sqrt(np.maximum(b * b - c, np.float32(0)))
        hit = np.isfinite(exact.t[1::2]) & (exact.square[1::2] > 0.01)
        with np.errstate(invalid="ignore"):
            wrong = (b * b - c < 0) | (np.abs(at / exact.t[1::2] - 1) > 0.1)
        t.check(wrong[hit].mean() > 0.04, f"only {wrong[hit].mean():.2g} err")


@case(1)
def tangents_and_limits(t: Trial) -> None:
    """Rays around a sphere's silhouette, radii 1e-6 to 1e6; the ray's end is exclusive.

    They agree with the exact sign where it is clear (1e-9 r^2).
    """
    rng, n = t.rng, 20_000
    s = Spheres(rng, n, 1e-6, 1e6)
    away = s.r * (1 + 10 ** rng.uniform(-3, 3, n))
    o = (s.centre + s.normal * away[:, None]).astype(np.float32)
    f = o.astype(np.longdouble) - s.centre
    length = np.sqrt(dot(f, f))
    side = np.cross(f, directions(rng, n))
    side /= np.sqrt(dot(side, side))[:, None]
    sine = np.minimum(s.r / length * (1 + 10 ** rng.uniform(-9, -2, n) * rng.choice([-1, 1], n)), 1)
    way = side * sine[:, None] - f / length[:, None] * np.sqrt(1 - sine**2)[:, None]
    d = unit(way.astype(np.float64))
    exact = Exact(s, o, d)
    got = evaluate(t, "sphere", s.record, o, d, np.inf)
    clear = np.abs(exact.square) > 1e-9
    t.check((np.isinf(got[:, 0]) == np.isinf(exact.t))[clear], "hit or miss")
    hit = np.isfinite(got[:, 0])
    need(n // 4 < hit.sum() < 3 * n // 4, "one-sided")
    at = got[hit, 0]
    ends = ((np.nextafter(at, np.float32(np.inf)), True), (at, False), (0.5 * at, False))
    for t_max, met in ends:
        again = evaluate(t, "sphere", s.record[hit], o[hit], d[hit], t_max)[:, 0]
        t.check(np.isfinite(again) == met, "end of the ray")


def leave(t: Trial, s: Spheres, o: Array, d: Array, share: float) -> tuple[Array, Array, int]:
    """Rays that leave from where o + t d meets spheres.

    Self-hits going out, lost far sides going in, and how many there were. share: of the offset.
    """
    rng = t.rng
    got = evaluate(t, "sphere", s.record, o, d, np.inf)
    hit = np.isfinite(got[:, 0]) & (np.abs(got[:, 1:4]).max(axis=1) < 2)
    record, p, n, offset = s.record[hit], got[hit, 1:4], got[hit, 4:7], share * got[hit, 7:]
    count = len(p)
    cosine = np.where(np.arange(count) % 2, rng.random(count), 10 ** rng.uniform(-9, 0, count))
    side = normalised(np.cross(n, directions(rng, count)))
    wi = unit(n * cosine[:, None] + side * np.sqrt(1 - cosine**2)[:, None])
    up = dot(wi.astype(np.float64), n.astype(np.float64))
    record, p, n, offset, wi = (a[up > 0] for a in (record, p, n, offset, wi))
    wide = p.astype(np.float64)
    above, below = ((wide + k * n * offset).astype(np.float32) for k in (1, -1))
    out = np.isfinite(evaluate(t, "sphere", record, above, wi, np.inf)[:, 0])
    far = evaluate(t, "sphere", record, below, -wi, np.inf)[:, 0].astype(np.float64)
    chord = 2 * record[:, 6] * up[up > 0]
    slack = 8 * offset[:, 0] + 1e-5 * record[:, 6] + 4 * offset[:, 0] / up[up > 0]
    lost = ~(np.abs(far - chord) <= slack)
    return out, lost, len(out)


def count_self_hits(t: Trial, rays: int, share: float = 1.0) -> tuple[int, int]:
    """Self-hits going out and far sides lost going in; every radius, and the ground."""
    rng = t.rng
    out = lost = done = 0
    while done < rays:
        for radius in [*RADII, 0.0]:
            n = 16_384
            s = Spheres(rng, n, radius, 10 * radius) if radius else Spheres(rng, n, 0.5, 1, 1e-3)
            o = rng.uniform(-1, 1, (n, 3)) if radius else s.at + 5e-7 * s.normal
            near = np.minimum(1, s.radius)[:, None] * directions(rng, n) * rng.random((n, 1))
            o = o.astype(np.float32)
            a, b, count = leave(t, s, o, unit(s.at + near - o), share)
            out, lost, done = out + int(a.sum()), lost + int(b.sum()), done + count
    t.samples += done
    return out, lost


@case(8, each={"rays": [400_000, 10_000_000]}, quick=lambda rays: rays < 1e6)
def spheres_do_not_meet_themselves(t: Trial, rays: int) -> None:
    """Rays that leave spheres of radius 1e-6 to 1e6, at up to 1e-9 of grazing.

    0 self-hits going out, 0 far sides lost going in, of 400,000 and in a full run of 10,000,000.
    """
    out, lost = count_self_hits(t, rays)
    t.check((out, lost) == (0, 0), f"{out} self-hits, {lost} lost")


@case(8)
def an_eighth_of_the_offset_would_not_do(t: Trial) -> None:
    """Planted: rays that leave by an eighth of the offset meet their sphere.

    More than 5,000 self-hits and 1,000 lost far sides of 100,000.
    """
    out, lost = count_self_hits(t, 100_000, 0.125)
    t.check(out > 5_000 and lost > 1_000, f"only {out} self-hits, {lost} lost")


# ---- sphere lights ----


@case(1, each={"radius": [1e-6, 1e-3, 1.0, 1e3]})
def sphere_lights_fill_their_cone(t: Trial, radius: float) -> None:
    """Directions to a sphere from 1e-6 to 1e6 radii off, against long doubles.

    pdf times the exact solid angle is 1 within 1e-6; wi meets the sphere at `distance` and under
    `cos_light` (2e-5); the sample's pdf is that of the pdf function within 4e-7.
    """
    rng = t.rng
    for exponent in range(-6, 7, 2):
        n = 4_000
        s = Spheres(rng, n, radius, 10 * radius)
        away = (s.r * (1 + 10.0**exponent))[:, None]
        p = np.asarray(s.centre + directions(rng, n) * away, np.float64).astype(np.float32)
        u, v = (rng.integers(0, 2**24, (2, n)) / 2**24).astype(np.float32)
        got = evaluate(t, "sphere_light", s.record, p, u, v).astype(np.float64)
        t.check(np.abs(got[:, 3] / got[:, 6] - 1) < 4e-7, "two pdfs")
        f = p.astype(np.longdouble) - s.centre
        d2 = dot(f, f)
        outside = d2 > s.r**2 * (1 + 1e-9)
        cosine2 = np.maximum(d2 - s.r**2, 0) / d2
        solid = 2 * np.pi * s.r**2 / d2 / (1 + np.sqrt(cosine2))
        need(outside.sum() > 1_000, "too few outside")
        t.check(np.abs(got[:, 3] * solid - 1)[outside].max() < 1e-6, "pdf")
        wi = got[:, :3]
        t.check(np.abs(np.linalg.norm(wi, axis=1) - 1).max() < 5e-7, "length")
        exact = Exact(s, p, wi)
        near = (got[:, 4] > 0) & (got[:, 4] <= np.sqrt(d2) * 1.000001)
        t.check(near[outside], "distance")
        if exponent <= 0:  # beyond, the rounding of wi counts
            plain = outside & (exact.square > 1e-3)
            t.check(np.isfinite(exact.t[plain]), "missed")
            t.check(np.abs(got[:, 4] / exact.t - 1)[plain].max() < 2e-5, "distance")
            t.check(np.abs(got[:, 5] + dot(exact.normal, wi))[plain].max() < 2e-5, "cosine")


@case(1, each={"radius": [1e-3, 1.0, 1e3]})
def sphere_lights_from_inside(t: Trial, radius: float) -> None:
    """Directions to a sphere from inside it are uniform and meet the inside of its far side.

    pdf 1 / (4 pi) within 2e-7, distance and cosine within 1e-5.
    """
    rng, n = t.rng, 20_000
    s = Spheres(rng, n, radius, 10 * radius)
    depth = np.where(np.arange(n) % 2, 1.0, rng.uniform(1e-3, 1, n)) * s.r
    p = (s.centre + directions(rng, n) * (s.r - depth)[:, None]).astype(np.float32)
    u, v = rng.random((2, n))
    got = evaluate(t, "sphere_light", s.record, p, u, v).astype(np.float64)
    t.check(np.abs(got[:, 3] * 4 * np.pi - 1) < 2e-7, "pdf")
    t.check(got[:, 3] == got[:, 6], "two pdfs")
    exact = Exact(s, p, got[:, :3])
    t.check(np.abs(got[:, 4] / exact.t - 1).max() < 1e-5, "distance")
    t.check(np.abs(got[:, 5] + dot(exact.normal, got[:, :3])).max() < 1e-5, "cosine")
    t.check(got[:, 5] < 0, "inside")


# ---- in scenes ----


def disk_hits(disks: Array, o: Array, d: Array) -> tuple[Array, Array]:
    """Distances of rays to discs (infinite: none); how far inside the rim, 1 at the centre."""
    c, a, b = (disks[None, :, k] for k in range(3))
    n = np.cross(a, b)
    to = c - o[:, None]
    t = (n * to).sum(-1) / (n * d[:, None]).sum(-1)
    q = o[:, None] + t[..., None] * d[:, None] - c
    aa, bb, ab = ((x * y).sum(-1) for x, y in ((a, a), (b, b), (a, b)))
    qa, qb = (q * a).sum(-1), (q * b).sum(-1)
    x, y = (bb * qa - ab * qb) / (aa * bb - ab**2), (aa * qb - ab * qa) / (aa * bb - ab**2)
    rim = 1 - np.hypot(x, y)
    return np.where((rim >= 0) & (t > 0), t, np.inf), rim


@case(1, each={"count": [20, 200]})
def disks_in_scenes(t: Trial, count: int) -> None:
    """Sheared ellipses, tested one after another and in a tree, against float64.

    The same disc if the answer is clear; t within 3e-7 in the median.
    """
    rng = t.rng
    disks = rng.normal(0, 0.2, (count, 3, 3))
    disks[:, 0] = rng.uniform(-1, 1, (count, 3))
    o, d = random_rays(rng, 5_000)
    hits, rim = disk_hits(disks, o, d)
    first, at = hits.min(1), hits.argmin(1)
    got_t, got = t.native.intersect(t.native_scene(make([Part(disks=disks)])), o, d)
    second = np.partition(hits, 1, axis=1)[:, 1]
    clear = (np.abs(rim) > 1e-4).all(1) & (np.isinf(first) | (second > first + 1e-4))
    need(clear.mean() > 0.8, "too many rays in doubt")
    t.check((got == np.where(np.isinf(first), -1, at))[clear], "disc")
    hit = clear & np.isfinite(first)
    need(hit.sum() > 300, "too few hits")
    error = np.abs(got_t[hit] - first[hit])
    t.check(np.median(error / first[hit]) < 3e-7, "median error of t")
    t.check(np.quantile(error, 0.99) < 1e-5, "t")


@case(1, each={"count": [20, 200]})
def spheres_in_scenes(t: Trial, count: int) -> None:
    """Spheres of radius 0.001 to 0.5, many overlap; origins inside and outside.

    The same sphere if the answer is clear; t within a relative 1e-4, in the median 3e-7.
    """
    rng = t.rng
    spheres = np.concatenate(
        [rng.uniform(-1, 1, (count, 3)), 10 ** rng.uniform(-3, -0.3, (count, 1))], axis=1
    )
    spheres[:3, 3] = 0.3, 0.4, 0.5
    scene = make([Part(spheres=[(c[:3], c[3], False) for c in spheres])])
    o, d = random_rays(rng, 5_000)
    f = o[:, None] - spheres[None, :, :3]
    b, c = (f * d[:, None]).sum(-1), (f * f).sum(-1) - spheres[:, 3] ** 2
    square = b * b - c
    root = np.sqrt(np.maximum(square, 0))
    near, far = -b - root, -b + root
    hits = np.where((square > 0) & (far > 0), np.where(near > 0, near, far), np.inf)
    first, at = hits.min(1), hits.argmin(1)
    got_t, got = t.native.intersect(t.native_scene(scene), o, d)
    second = np.partition(hits, 1, axis=1)[:, 1]
    clear = (np.abs(square) > 1e-6).all(1) & (np.isinf(first) | (second > first + 1e-5))
    clear &= (np.abs(c) > 1e-5).all(1)
    need(clear.mean() > 0.8, "too many rays in doubt")
    t.check((got == np.where(np.isinf(first), -1, at))[clear], "sphere")
    hit = clear & np.isfinite(first)
    need(hit.sum() > 300, "too few hits")
    t.check(np.abs(got_t[hit] - first[hit]).max() < 1e-4, "t")
    t.check(np.median(np.abs(got_t[hit] / first[hit] - 1)) < 3e-7, "median error of t")


@case(1, each={"tree": [False, True]})
def a_pebble_off_the_grid_of_floats(t: Trial, tree: bool) -> None:
    """A sphere of radius 1e-5 at (.1, .2, .3) in a scene of size 1, where floats are 3e-8 apart.

    Rays from 20 radii away meet it from 1e-4 R inside the rim on, and miss it 1e-4 R outside. With
    one float per coordinate, its centre would be off by 2e-3 R.
    """
    n, radius = 20_000, 1e-5
    centre = np.array([0.1, 0.2, 0.3])
    ends = [(sign * np.ones(3), 1e-3, False) for sign in (-1, 1)]
    more = [(t.rng.uniform(0.5, 0.9, 3), 1e-3, False) for _ in range(70 if tree else 0)]
    scene = t.native_scene(make([Part(spheres=[(centre, radius, False), *ends, *more])]))
    t.check(("bvh" in scene.features) == tree, "tree")
    o = (centre - 20 * radius * directions(t.rng, n)).astype(np.float32).astype(np.float64)
    away = np.linalg.norm(centre - o, axis=1, keepdims=True)
    ahead = (centre - o) / away
    gap = t.rng.choice([-1, 1], (n, 1)) * 10 ** t.rng.uniform(-5, -2, (n, 1))
    sine = radius * (1 + gap) / away
    d = np.sqrt(1 - sine**2) * ahead + sine * normalised(np.cross(ahead, directions(t.rng, n)))
    hit, gap = t.native.intersect(scene, o, d)[1] == 0, gap[:, 0]
    t.check(hit[gap < -1e-4], "misses within the rim")
    t.check(~hit[gap > 1e-4], "hits without the rim")
