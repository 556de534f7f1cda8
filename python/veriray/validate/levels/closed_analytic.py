"""Furnaces, form factors and shadows: pixels whose value is known.

Every case renders pixels with next-event estimation and the balance heuristic, as the renderer
always does; `sees` is the relative bias that it finds with 90 % power.
"""

from __future__ import annotations

import dataclasses
import math
from typing import Any

import numpy as np
import numpy.typing as npt
import trimesh

import veriray
from veriray.scene import MAX_PATH_DEPTH
from veriray.validate import dicts
from veriray.validate.form_factors import (
    above_plane,
    coaxial_disks,
    disk_beside,
    disk_to_sphere,
    disk_upright,
    gauss,
    mean_over,
    parallel_rectangles,
    perpendicular_rectangle,
    perpendicular_rectangles,
    rectangle_above_corner,
    to_disk,
)
from veriray.validate.scenes import (
    Part,
    box,
    camera,
    disk,
    furnace,
    lambert,
    make,
    material,
    point_light,
    quad,
    sphere,
    without,
)
from veriray.validate.statistics import binomial, chi_square, max_z, smallest_bias
from veriray.validate.trial import Trial, case

Array = npt.NDArray[np.float64]
DOWN = camera([0.6, 0.8, 0.7], [0, 0, 0])
UP = [0, 0, 1]


def ceiling(x0: float, x1: float, y0: float, y1: float, z: float = 1.0) -> list[list[float]]:
    """Corners of a rectangle at height z."""
    return [[x0, y0, z], [x1, y0, z], [x1, y1, z], [x0, y1, z]]


def lamp(x0: float, x1: float, y0: float, y1: float, emission: float, z: float = 1.0) -> Part:
    """A rectangle at height z that shines down and reflects nothing."""
    return quad([x0, y0, z], [0, y1 - y0, 0], [x1 - x0, 0, 0], 0.0, emission)


def floor(reflectance: float = 0.5, two_sided: bool = False) -> Part:
    """A square of side 10 around the origin."""
    return quad([-5, -5, 0], [10, 0, 0], [0, 10, 0], reflectance, 0, two_sided)


def single(value: float) -> float:
    """The number as the renderer holds it, in single precision."""
    return float(np.float32(value))


@case(3, once=True)
def form_factors_agree(t: Trial) -> None:
    """Formulas of form factors against quadrature and printed values (A8, A10, A11, A14, A15).

    Lambert's sum, Howell's formulas and quadrature agree to 6 digits, with 1 for a closed cube.
    """
    origin = [0, 0, 0]
    for a, b, value in ((1, 1, 0.138532), (2, 2, 0.207757)):
        t.check(abs(rectangle_above_corner(a, b) - value) < 6e-7)
        t.check(abs(lambert(origin, UP, ceiling(0, a, 0, b)) - value) < 6e-7)
    wall = [[1, 0, 0], [1, 1, 0], [1, 1, 1], [1, 0, 1]]
    t.check(abs(perpendicular_rectangle(1, 1, 1) - 0.055734) < 6e-7)
    t.check(abs(lambert(origin, UP, wall) - 0.055734) < 6e-7)
    t.check(abs(math.pi * lambert(origin, UP, ceiling(-1, 1, -1, 1)) - 1.740840) < 6e-7)
    t.check(abs(parallel_rectangles(1, 1, 1) - 0.199825) < 6e-7)
    t.check(abs(perpendicular_rectangles(1, 1, 1) - 0.200044) < 6e-7)
    cube = parallel_rectangles(1, 1, 1) + 4 * perpendicular_rectangles(1, 1, 1)
    t.check(abs(cube - 1) < 1e-12, "a cube is closed")
    t.check(abs(coaxial_disks(1, 1, 1) - 0.381966) < 6e-7)
    r, w = gauss(60)
    rings = [to_disk([x, 0, 1], [0.7, 0, 0], [0, 0.7, 0], UP, 60) for x in r.tolist()]
    t.check(abs(float((2 * r * w) @ rings) - coaxial_disks(1, 0.7, 1)) < 1e-7)
    shine = [0.25 / (1 + x * x) ** 1.5 for x in r.tolist()]  # (R / d)^2 cos, from the point
    t.check(abs(float((2 * r * w) @ shine) - disk_to_sphere(1, 0.5, 1)) < 1e-9)
    for disk_form, centre, a, b in (
        (disk_beside(0.7, 1.2, 0.9), [0.9, 0, 1.2], [0.7, 0, 0], [0, 0.7, 0]),
        (disk_upright(0.7, 1.2, 0.9), [1.2, 0, 0.9], [0, 0.7, 0], [0, 0, 0.7]),
    ):
        t.check(abs(disk_form - to_disk(centre, a, b, UP)) < 1e-9)


# ---- closed scenes ----

FURNACES = {0.5: (0.5, 1.0), 0.9: (1.0, 10.0)}  # albedo: emission, radiance


@case(3, each={"albedo": FURNACES})
def diffuse_furnace(t: Trial, albedo: float) -> None:
    """A closed room of one albedo that shines everywhere (A1, E1).

    Radiance E / (1 - rho) at every point, in every direction: 1 and 10. Sees 0.5 %.
    """
    emission, exact = FURNACES[albedo]
    truth = emission / (1 - single(albedo))
    t.check(abs(truth / exact - 1) < 1e-6)
    t.agrees(furnace(albedo, emission), truth, 800_000, sees=0.005)


@case(
    3, each={"albedo": (0.343, 0.7, 0.98), "rr_depth": (1, 2, 5)},
    quick=lambda albedo, rr_depth: (albedo, rr_depth) in ((0.343, 1), (0.98, 5)),
)  # fmt: skip
def furnace_with_roulette(t: Trial, albedo: float, rr_depth: int) -> None:
    """Radiance and length of paths in a furnace with roulette (A1, L3).

    E / (1 - rho), and live[d] / N = 1 below rr_depth, then rho^d: multinomial chi-square over the
    depths of death, sees 0.5 % in the survival probability. Light choice: 5 of 6 walls are not
    one's own, whatever the vertex: exact binomial of all shadow rays.
    """
    scene = furnace(albedo, 1.0, rr_depth=rr_depth)
    rho = single(albedo)
    r = t.agrees(scene, 1 / (1 - rho), 1_600_000 if albedo < 0.9 else 320_000, sees=0.01)
    ledger = {name: np.array(column) for name, column in r.stats["ledger"].items()}
    dead = ledger["rr_killed"]
    lost = int(t.leaks(r).sum())
    t.check(dead.sum() == r.spp - lost and not dead[: rr_depth - 1].any(), "who dies, and when")
    d = np.arange(len(dead) + 1)
    alive = np.where(d < rr_depth, 1.0, rho**d)
    expected = np.append((alive[:-1] - alive[1:]), alive[-1]) * r.spp
    t.p(chi_square(np.append(dead, 0), expected), "depths of death")
    lit, vertices = int(ledger["shadow_visible"].sum()), int(ledger["live"].sum())
    t.p(binomial(lit, vertices, 5 / 6), "light choice")


@case(3, each={"depth": (1, 2, 3, 4, 5, 6)})
def truncated_furnace(t: Trial, depth: int) -> None:
    """A furnace cut at max_depth: .5, .75, .875 ... (A2, L3).

    E (1 - rho^depth) / (1 - rho). Without roulette every path lives to max_depth: exact.
    """
    exact = [0.5, 0.75, 0.875, 0.9375, 0.96875, 0.984375][depth - 1]
    scene = furnace(0.5, 0.5, max_depth=depth, rr_depth=100)
    r = t.agrees(scene, exact, 400_000, sees=0.001)
    lost = t.leaks(r)
    t.check(np.array(r.stats["live_rays"]) + lost.cumsum() - lost == r.spp, "a path ends early")
    t.check(r.stats["ledger"]["depth_cut"] == [0] * (depth - 1) + [r.spp - lost.sum()])
    t.check(depth > 1 or not r.stderr.any(), "emission alone has no noise")


@case(3, each={"room": ("long box", "mesh")}, quick=lambda room: room != "mesh")
def furnace_in_three_colours(t: Trial, room: str) -> None:
    """Colours do not mix; long walls; turned, in a tree, with triangle lights (A1).

    E / (1 - rho), channel by channel.
    """
    albedo, emission = np.array([0.2, 0.5, 0.8]), np.array([3.0, 0.1, 0.5])
    exact = emission / (1 - albedo.astype(np.float32).astype(np.float64))
    if room == "long box":
        view = camera([0.5, 0.3, 0.2], [2, 0.1, 0.7], 40)
        scene = make([box([0, 0, 0], [3, 1, 1], True, albedo, emission)], view)
        t.agrees(scene, exact, 800_000, sees=0.003)
    else:
        mesh = trimesh.creation.icosphere(2)
        wall = Part(mesh.vertices, mesh.faces[:, ::-1], albedo, emission)
        t.agrees(make([wall]), exact, 320_000, sees=0.004)


@case(3, each={"cut": (1, 2, 7, -1)})
def mirror_furnace(t: Trial, cut: int) -> None:
    """A closed box of shining mirrors, reflectance .8: radiance 5; cut at a depth less (A4).

    E (1 - r^depth) / (1 - r), without noise where a path is cut before roulette begins: light that
    is found by a mirror counts whole. Sees 0.5 %.
    """
    walls = material("conductor", eta=0.0, k=1.0, specular_reflectance=[0.8, 0.5, 0.2])
    r = np.array([0.8, 0.5, 0.2]).astype(np.float32).astype(np.float64)
    room = box([0, 0, 0], [1, 1.1, 1.2], True, emission=[1, 3, 1], material=walls)
    scene = make([room], camera([0.4, 0.45, 0.3], [0.6, 0.3, 1.0], 60.0), width=3, height=3,
                 max_depth=cut, rr_depth=8)  # fmt: skip
    exact = np.array([1, 3, 1]) * (1 - (r**cut if cut > 0 else 0)) / (1 - r)
    t.check(cut > 0 or abs(exact[0] - 5) < 1e-6)
    result = t.agrees(scene, exact, 100_000 if cut < 0 else 100, sees=0.005)
    t.check(cut < 0 or result.stderr.max() < 1e-6)
    t.sealed(result)


PATCHES = {"shares": (0.1, 0.4, 0.5), "albedo": (0.2, 0.3, 0.8), "emission": (10.0, 0.0, 0.0)}


def patched_sphere(targets: Array, fine: int = 6) -> tuple[list[Part], Array, Array]:
    """A ball seen from inside in three zones of about the shares of PATCHES; their shares; places.

    20 x 4^fine triangles. The form factor between points of a sphere is area over the whole,
    whatever the points; triangles depart from it by h^2, h = 2^-fine: the margin is 2e-4. Places:
    where the triangles towards `targets` are perpendicular to the radius.
    """
    mesh = trimesh.creation.icosphere(fine)
    height = mesh.triangles_center[:, 2]
    zone = np.digitize(height, [0.0, 0.8])  # below 0: half; above .8: a tenth
    areas = np.array([mesh.area_faces[zone == k].sum() for k in (2, 1, 0)]) / mesh.area
    parts = [
        Part(mesh.vertices, mesh.faces[zone == k][:, ::-1], albedo, emission)
        for k, albedo, emission in zip((2, 1, 0), PATCHES["albedo"], PATCHES["emission"],
                                       strict=True)
    ]  # fmt: skip
    nearest = [int(np.argmax(mesh.triangles_center @ target)) for target in targets]
    normals = mesh.face_normals[nearest]
    feet = normals * (normals * mesh.triangles[nearest][:, 0]).sum(1, keepdims=True)
    return parts, areas, feet


@case(3, each={"patch": (0, 1, 2), "depth": (1, 2, 3, 6, -1)},
      quick=lambda patch, depth: (patch, depth) in ((1, 2), (2, -1)))  # fmt: skip
def integrating_sphere(t: Trial, patch: int, depth: int) -> None:
    """A sphere in three patches, one of them lit, and its series in depth (A6, L3).

    H = sum f e / (1 - sum f rho), radiance e_i + rho_i H: 10.434783, .652174, 1.739130; cut after
    k bounces H_k = 1, 1.54, 1.8316, ...: D. G. Goebel, Applied Optics 6 (1967). Counts of paths:
    1, rho_i, rho_i m, rho_i m^2 ... with m = sum f rho = .54.
    """
    albedo = np.array([single(a) for a in PATCHES["albedo"]])
    emission = np.array(PATCHES["emission"])
    shares = np.array(PATCHES["shares"])

    def after(bounces: float, f: Array) -> float:
        m = float(f @ albedo)
        return float(f @ emission) * (1 - (m**bounces if bounces < 1e3 else 0)) / (1 - m)

    for k, value in enumerate((1, 1.54, 1.8316, 1.989064, 2.074095), 1):
        t.check(abs(after(k, shares) - value) < 1e-6)
    t.check(abs(after(1e9, shares) - 2.173913) < 1e-6)
    targets = np.array([[0.1, 0.05, 0.97], [0.8, -0.2, 0.4], [-0.7, 0.3, -0.5]])
    parts, real, places = patched_sphere(targets)
    t.check(np.abs(real - shares).max() < 2e-3, "zones are what they are meant to be")
    exact = emission[patch] + albedo[patch] * after(depth - 1 if depth > 0 else 1e9, real)
    scene = make(parts, camera([0.1, 0, 0.1], places[patch]), max_depth=depth, rr_depth=1)
    if depth == 1:
        t.agrees(scene, exact, 100, sees=1e-4)
        return
    r = t.agrees(scene, exact, 400_000, sees=0.02, margin=2e-4)
    if depth < 0:
        dead = np.array(r.stats["ledger"]["rr_killed"])
        t.rare(r.spp - int(dead.sum()), r, "left the sphere")
        d = np.arange(len(dead))
        m = float(real @ albedo)
        alive = np.append(1.0, albedo[patch] * m**d)
        expected = np.append(alive[:-1] - alive[1:], alive[-1]) * r.spp
        t.p(chi_square(np.append(dead, 0), expected), "depths of death")


@case(3, each={"wall": (0.343, 0.9)})
def sphere_with_ports(t: Trial, wall: float) -> None:
    """A sphere with a lit port and a dark one, both flat (A6, L3).

    A flat black port takes what its cap would, whole or not: L = rho f e / (1 - rho (1 - f - g))
    with shares (1 - cos) / 2 = f = .1, g = .05. Counts: 1, rho, rho (1 - f - g) rho ...
    """
    f, g = 0.1, 0.05
    ports = []
    for share, axis, emission in ((f, [0, 0, 1], 4.0), (g, [1, 0, 0], 0.0)):
        c = 1 - 2 * share
        s = math.sqrt(1 - c * c)
        n = np.array(axis, float)
        a = np.array([0, 1.0, 0])
        ports.append(disk(c * n, s * a, s * np.cross(-n, a), 0.0, emission))
    t.check(all(np.cross(p.disks[0][1], p.disks[0][2]) @ p.disks[0][0] < 0 for p in ports))
    rho = single(wall)
    exact = rho * f * 4 / (1 - rho * (1 - f - g))
    room = sphere([0, 0, 0], 1, wall, inward=True)
    scene = make([room, *ports], camera([0, 0, 0], [-0.3, -0.5, -0.4]), rr_depth=1)
    r = t.agrees(scene, exact, 800_000, sees=0.01)
    ledger = r.stats["ledger"]
    dead = np.array(ledger["rr_killed"])
    ended = np.array(ledger["absorbed"]) + np.array(ledger["emitter_end"])
    d = np.arange(len(dead))
    arrive = np.append(1.0, rho * (rho * (1 - f - g)) ** d[:-1])  # segments alive
    walls = np.append(1.0, arrive[1:] * (1 - f - g))  # those that end on the wall
    expected = np.concatenate([walls * (1 - rho), arrive - walls])
    rest = 1 - expected.sum()
    counts = np.append(np.concatenate([dead, ended]), 0)
    t.check(not any(ledger["escaped"]), "closed")
    t.p(chi_square(counts, r.spp * np.append(expected, max(rest, 0))), "depths of death")


@case(3, each={"where": ("wall", "disk")}, quick=lambda where: where == "wall")
def sphere_with_a_flat_patch(t: Trial, where: str) -> None:
    """Part of a sphere is cut off by a reflecting disk that shines (A6).

    The wall is of one radiance W, so the disk is too: D = e + b W, W = a ((1 - f) W + f D).
    """
    f, a, b, e = 0.2, single(0.7), single(0.4), 3.0
    c = 1 - 2 * f
    s = math.sqrt(1 - c * c)
    wall = a * f * e / (1 - a * (1 - f) - a * f * b)
    system = np.linalg.solve([[1 - a * (1 - f), -a * f], [-b, 1]], [0, e])
    t.check(np.abs(system - [wall, e + b * wall]).max() < 1e-12)
    patch = disk([0, 0, c], [s, 0, 0], [0, -s, 0], b, e)
    eye = camera([0.1, 0.2, 0.1], [0.3, 0.1, c] if where == "disk" else [0.6, -0.3, -0.2])
    scene = make([sphere([0, 0, 0], 1, a, inward=True), patch], eye)
    t.agrees(scene, wall if where == "wall" else e + b * wall, 800_000, sees=0.01)


@case(3, each={"shape": ("cube", "box")}, quick=False)
def mean_irradiance_of_a_closed_room(t: Trial, shape: str) -> None:
    """A point light off the centre of a room of one albedo: the mean over its walls (A7).

    Flux Phi, surface S: mean irradiance Phi / (S (1 - rho)), of which Phi rho / (S (1 - rho)) is
    indirect: 104.166667 for Phi = 1e4, S = 96, rho = .5, whatever the room's shape. One picture per
    wall, from the centre, covers it evenly.
    """
    size = np.array([4.0, 4.0, 4.0] if shape == "cube" else [2.0, 4.0, 6.0])
    surface = 2 * float(size @ np.roll(size, 1))
    phi, rho = 1e4, 0.5
    exact = phi * rho / (surface * (1 - rho))
    t.check(shape == "box" or abs(exact - 104.166667) < 1e-6)
    room = box(-size / 2, size / 2, True, rho)
    light = point_light([0.3, -0.7, 1.1], phi / (4 * math.pi))
    mean = {2: 0.0, -1: 0.0}
    noise = {2: 0.0, -1: 0.0}
    for axis in range(3):
        for sign in (1, -1):
            up = np.eye(3)[(axis + 2) % 3]
            across, high, far = size[(axis + 1) % 3], size[(axis + 2) % 3], size[axis]
            eye = camera([0, 0, 0], sign * np.eye(3)[axis],
                         math.degrees(2 * math.atan(across / far)), up)  # fmt: skip
            whole = make([room], eye, width=round(across), height=round(high), lights=[light])
            for depth in mean:
                r = t.render(whole, 40_000, max_depth=depth)
                e = math.pi / rho * across * high / surface / r.image[:, :, 0].size
                mean[depth] += e * float(r.image[:, :, 0].sum(dtype=np.float64))
                noise[depth] += e**2 * float((r.stderr[:, :, 0].astype(np.float64) ** 2).sum())
    for depth, truth in ((2, phi / surface), (-1, phi / surface + exact)):
        error = math.sqrt(noise[depth])
        off = max(abs(mean[depth] - truth) - 1e-5 * truth, 0)
        t.p(max_z(np.array([off / error])), f"mean at max_depth {depth}")
        t.sees(smallest_bias(error, truth), 0.01)


@case(3, each={"kind": ("room", "glass", "medium")}, quick=lambda kind: kind == "glass")
def equilibrium_of_a_furnished_room(t: Trial, kind: str) -> None:
    """Everything shines with what it does not reflect: G. Kirchhoff, 1860 (E1, E6).

    Walls, balls, mirrors of any albedo with emission (1 - albedo) L, glass with a black ball of
    n^2 L in it, lossless fog: radiance L at every pixel, in three colours. Sees 0.5 %.
    """
    radiance = np.array([1.0, 0.3, 4.0])
    d = dicts

    def grey(albedo: Any) -> tuple[dict[str, Any], Array]:
        return d.diffuse(albedo), (1 - np.asarray(albedo, float)) * radiance

    shades = [0.1, 0.95, [0.2, 0.8, 0.5], 0.0, 0.6, 0.3]
    sides = np.concatenate([np.eye(3), -np.eye(3)])
    objects = [d.flat("rectangle", 2 * n, -n, 2, *grey(shade))
               for n, shade in zip(sides, shades, strict=True)]  # fmt: skip
    metal = {**d.MIRROR, "specular_reflectance": d.rgb(0.7)}
    block, shine = grey([0.9, 0.1, 0.4])
    coat = d.glass(1.5, 1.0, "plastic", nonlinear=True, diffuse_reflectance=d.rgb(1))
    objects += [
        d.sphere([1.2, -1.1, -1.2], 0.7, *grey(0.8)),
        d.sphere([-1.2, -1.3, 0.8], 0.6, metal, 0.3 * radiance),
        d.cuboid([-0.3, 1.0, -1.8], [0.6, 1.7, -1.1], block, emitter=d.area(shine)),
        d.sphere([-1.1, 1.2, 1.0], 0.5, coat),
    ]
    if kind == "glass":
        objects += [
            d.sphere([0.2, 0.1, 0.3], 0.8, d.glass(1.5)),
            d.sphere([0.3, 0.2, 0.1], 0.4, d.diffuse(0.4), 0.6 * 2.25 * radiance),
            d.flat("rectangle", [-0.9, 0, -0.9], [1, 0.2, 1], 0.5,
                   d.glass(1.7, 1.0, "thindielectric")),
        ]  # fmt: skip
    if kind == "medium":
        fog = d.medium([1.0, 2.0, 3.0], 1.0, 0.5)
        objects += [
            d.sphere([0.2, 0.1, 0.3], 0.8, d.NULL, interior=fog),
            d.cuboid([-1.4, 0.2, -1.2], [-0.6, 1.0, -0.4], d.glass(1.3), interior=fog),
        ]
    eye = d.view([-0.2, -1.6, -0.5], [0.3, 0.2, 0.1], 100, 6)
    scene = d.scene(eye, *objects)
    # Single precision rounds 1 - albedo: the walls are off by 6e-8 / (1 - albedo) at most.
    t.agrees(scene, radiance, 40_000, sees=0.005, margin=3e-5)


# ---- direct light ----


@case(3, each={"depth": (2, -1)})
def rectangle_overhead(t: Trial, depth: int) -> None:
    """A rectangle above its corner, and centred over the point (A10).

    Radiance rho F: F = .138532 and .554126. The light reflects nothing.
    """
    for rect, value in (((0, 1, 0, 1), 0.138532), ((-1, 1, -1, 1), 0.554126)):
        exact = lambert([0, 0, 0], UP, ceiling(*rect))
        t.check(abs(exact - value) < 1e-6)
        scene = make([floor(), lamp(*rect, 1.0)], DOWN, max_depth=depth)
        t.agrees(scene, 0.5 * exact, 1_600_000, sees=0.003)


@case(3)
def triangles_overhead(t: Trial) -> None:
    """A light that is a triangle, and one that is a mesh of 128 in a tree (A10).

    Lambert's sum over the edges; four times the rectangle above its corner.
    """
    corners = np.array([[-0.5, -0.7, 1.0], [0.2, 1.0, 1.0], [1.2, -0.3, 1.0]])
    exact = 0.5 * lambert([0, 0, 0], UP, corners)
    t.agrees(make([floor(), Part(corners, [[0, 1, 2]], 0, 1)], DOWN), exact, 1_600_000, 0.003)
    grid = np.linspace(-1, 1, 9)
    parts = [lamp(x, x + 0.25, y, y + 0.25, 1.0) for x in grid[:-1] for y in grid[:-1]]
    fine = Part(np.concatenate([p.vertices for p in parts]),
                np.concatenate([p.faces + 4 * k for k, p in enumerate(parts)]), 0, 1)  # fmt: skip
    exact = 0.5 * 4 * rectangle_above_corner(1, 1)
    t.agrees(make([floor(), fine, quad([4, 4, 1], [0.1, 0, 0], [0, 0.1, 0])], DOWN), exact,
             800_000, 0.003)  # fmt: skip


@case(3)
def upright_rectangle(t: Trial) -> None:
    """A lit square that stands on the floor (A11).

    Radiance .5 x .055734 at the corner's foot.
    """
    wall = quad([1, 0, 0], [0, 0, 1], [0, 1, 0], 0, 1)
    view = camera([-1, -1, 2], [0, 0, 0])
    exact = 0.5 * perpendicular_rectangle(1, 1, 1)
    t.agrees(make([floor(), wall], view), exact, 3_200_000, sees=0.002)


@case(3)
def two_lights_of_different_radiance(t: Trial) -> None:
    """Two rectangles in opposite quadrants, radiance 3 and 1 (A12).

    .5 (3 + 1) F(2, 2) = .415514: one random number for choice and place would show here.
    """
    scene = make([floor(), lamp(0, 2, 0, 2, 3.0), lamp(-2, 0, -2, 0, 1.0)], DOWN)
    t.check(abs(2 * rectangle_above_corner(2, 2) - 0.415514) < 1e-6)
    t.agrees(scene, 0.5 * 4 * rectangle_above_corner(2, 2), 1_600_000, sees=0.003)


FIVE = [(-2, -1, -2, -0.5, 0.2), (-0.5, 0.5, -0.5, 0.5, 1.0), (1, 2.5, 0, 1, 7.0),
        (-1.5, -1, 1, 2, 30.0), (0.7, 0.8, -1.2, -1.1, 400.0)]  # fmt: skip


@case(3, each={"sky": (0.0, 0.8)})
def five_lights_and_a_sky(t: Trial, sky: float) -> None:
    """Five rectangles of unequal areas and radiances, with and without a sky (A12, A13).

    rho times the sum of form factor times radiance; with a sky the lamps hide their share of it.
    """
    form = [lambert([0, 0, 0], UP, ceiling(*rect)) for *rect, _ in FIVE]
    shine = sum(f * emission for f, (*_, emission) in zip(form, FIVE, strict=True))
    exact = 0.5 * (shine + sky * (1 - sum(form)))
    scene = make([floor(), *[lamp(*rect, emission) for *rect, emission in FIVE]], DOWN, sky)
    t.agrees(scene, exact, 3_200_000, sees=0.003)


PENTAGON = np.array([[1.0, 0.3, 0.6], [1.2, 1.1, 0.7], [1.6, 1.2, 1.4], [1.8, 0.2, 1.7],
                     [1.3, -0.4, 1.0]])  # fmt: skip


@case(3, each={"sunk": (0.0, 0.9, 1.5)})
def polygon_at_the_horizon(t: Trial, sunk: float) -> None:
    """A tilted pentagon, all above the floor, partly below it, almost all below (A13, A23).

    Lambert's sum over the edges of what is above the horizon. Sees 0.5 %, the last 1.5 %.
    """
    flat = PENTAGON.copy()  # in one plane
    n = np.cross(flat[1] - flat[0], flat[4] - flat[0])
    for k in (2, 3):
        flat[k, 0] -= (flat[k] - flat[0]) @ n / n[0]
    flat[:, 2] -= sunk
    if n @ flat[0] > 0:
        flat = flat[::-1]
    visible = above_plane(flat, [0, 0, 0], UP)
    t.check(len(visible) == (3 if sunk == 1.5 else 5))
    exact = lambert([0, 0, 0], UP, visible)
    # a second way: quadrature over the triangles of a fan
    u, w = gauss(40)
    total = 0.0
    for k in range(1, len(visible) - 1):
        a, b, c = visible[0], visible[k], visible[k + 1]
        p = a + u[:, None, None] * ((b - a) + u[None, :, None] * (c - b))
        area = u[:, None] * np.linalg.norm(np.cross(b - a, c - b))
        d2 = (p * p).sum(-1)
        m = np.cross(b - a, c - b) / np.linalg.norm(np.cross(b - a, c - b))
        total += float(w @ (area * p[..., 2] * np.abs(p @ m) / d2**2 / math.pi) @ w)
    t.check(abs(total - exact) < 1e-8, "two ways")
    plate = quad([-0.1, -0.1, 0], [0.2, 0, 0], [0, 0.2, 0], 0.5)
    lit = Part(flat, [[0, 1, 2], [0, 2, 3], [0, 3, 4]], 0, 1.0)
    scene = make([plate, lit], camera([-0.6, 0.1, 0.7], [0, 0, 0]))
    t.agrees(scene, 0.5 * exact, 3_200_000 if sunk == 1.5 else 800_000,
             sees=0.015 if sunk == 1.5 else 0.005)  # fmt: skip


@case(3, each={"way": ("overhead", "beside", "upright")})
def disk_off_the_axis(t: Trial, way: str) -> None:
    """A disk over the point, aside from it and standing upright (A8).

    Form factors B-12, B-13 and B-15 of Howell's catalog. Sees 0.5 %.
    """
    if way == "upright":
        exact = disk_upright(0.7, 1.2, 0.9)
        lit = disk([1.2, 0, 0.9], [0, 0.7, 0], [0, 0, -0.7], 0, 1)
    else:
        aside = 0.9 if way == "beside" else 1e-3
        exact = disk_beside(0.7, 1.2, aside)
        lit = disk([aside, 0, 1.2], [0.7, 0, 0], [0, -0.7, 0], 0, 1)
        t.check(way == "beside" or abs(exact - 0.49 / (0.49 + 1.44)) < 1e-5)
    place = lit.disks[0]
    t.check(abs(to_disk(*place, UP) - exact) < 1e-9)
    t.check(np.cross(place[1], place[2]) @ place[0] < 0, "it faces the point")
    t.agrees(make([floor(), lit], camera([-0.6, 0.4, 0.7], [0, 0, 0])), 0.5 * exact, 800_000,
             sees=0.005)  # fmt: skip


# ---- from surface to surface: a picture that covers the receiver evenly ----


def over(half: float, height: float, size: int = 1) -> Any:
    """A camera `height` above the origin whose film covers [-half, half]^2 of the plane z = 0."""
    return camera([0, 0, height], [0, 0, 0], 2 * math.degrees(math.atan(half / height)), [0, 1, 0])


@case(3, each={"pair": ("parallel", "upright", "long parallel", "tall upright")},
      quick=lambda pair: " " not in pair)  # fmt: skip
def square_to_square(t: Trial, pair: str) -> None:
    """Form factors of squares and rectangles, parallel and at a right angle (A14).

    .199825 and .200044 for unit squares: Howell, C-11 and C-14. The film covers the receiver.
    """
    height = {"parallel": 1.0, "upright": 1.0, "long parallel": 0.4, "tall upright": 2.5}[pair]
    receiver = quad([-0.5, -0.5, 0], [1, 0, 0], [0, 1, 0], 0.5)
    if "parallel" in pair:
        exact = parallel_rectangles(1, 1, height)
        lit = lamp(-0.5, 0.5, -0.5, 0.5, 1.0, height)
        t.check(abs(mean_over(
            lambda x, y: lambert([x, y, 0], UP, ceiling(0, 1, 0, 1, height)), 1, 1) - exact) < 1e-9
        )  # fmt: skip
        eye = over(0.5, 0.5 * height)
    else:
        exact = perpendicular_rectangles(1, height, 1)
        lit = quad([-0.5, -0.5, 0], [0, 1, 0], [0, 0, height], 0, 1)
        wall = [[0, 0, 0], [0, 1, 0], [0, 1, height], [0, 0, height]]
        t.check(abs(mean_over(
            lambda x, y: lambert([x, y, 0], UP, wall), 1, 1, graded=True) - exact) < 1e-6
        )  # fmt: skip
        eye = over(0.5, 0.5)
    t.agrees(make([receiver, lit], eye), 0.5 * exact, 1_600_000, sees=0.005)


@case(3, each={"other": ("disk", "small disk", "ball")})
def disk_to_disk_and_ball(t: Trial, other: str) -> None:
    """Form factors from a disk to a disk and to a ball on its axis (A15, A9).

    (3 - sqrt 5) / 2 = .381966 for unit disks at distance 1; the disk is pi / 4 of the film.
    """
    receiver = disk([0, 0, 0], [1, 0, 0], [0, 1, 0], 0.5)
    if other == "ball":
        exact, lit = disk_to_sphere(1, 0.5, 1), sphere([0, 0, 1], 0.5, 0, 1)
        eye = over(1, 0.45)
    else:
        radius = 1.0 if other == "disk" else 0.3
        exact = coaxial_disks(1, radius, 1)
        t.check(radius < 1 or abs(exact - (3 - math.sqrt(5)) / 2) < 1e-12)
        lit = disk([0, 0, 1], [radius, 0, 0], [0, -radius, 0], 0, 1)
        eye = over(1, 0.5)
    t.agrees(make([receiver, lit], eye), math.pi / 4 * 0.5 * exact, 1_600_000, sees=0.005)


# ---- shadows ----


@case(3)
def known_shadow(t: Trial) -> None:
    """A black screen at half the height hides one quadrant of the light (A17).

    Three of four form factors; a quarter of the first shadow rays are stopped: exact binomial.
    """
    screen = quad([0, 0, 0.5], [0.5, 0, 0], [0, 0.5, 0])
    exact = 0.5 * 3 * rectangle_above_corner(1, 1)
    view = camera([-0.6, -0.4, 0.9], [0, 0, 0])
    scene = make([floor(), lamp(-1, 1, -1, 1, 1.0), screen], view)
    r = t.agrees(scene, exact, 1_600_000, sees=0.003)
    t.p(binomial(r.stats["ledger"]["shadow_occluded"][0], r.spp, 0.25), "shadow rays stopped")


HALVES = {
    "rectangle": (lamp(-1, 1, -1, 1, 2.0), 4 * rectangle_above_corner(1, 1)),
    "disk": (disk([0, 0, 1], [0.8, 0, 0], [0, -0.8, 0], 0, 2), 0.64 / 1.64),
    "ball": (sphere([0, 0, 1], 0.7, 0, 2), 0.49),
    "sky": (None, 1.0),
}


@case(3, each={"light": HALVES, "screen": ("quad", "disk", "mesh")},
      quick=lambda light, screen: screen == "quad")  # fmt: skip
def occluded_half(t: Trial, light: str, screen: str) -> None:
    """An upright screen through the normal hides half of a lamp, or of the sky (A17).

    Half of the form factor, by symmetry: .276..., .195..., .245, .5. Sees 0.5 %.
    """
    source, form = HALVES[light]
    # The screen stands on the point's far side of x = 0, an inch away from it: black, two-sided.
    gap = 1e-6
    if screen == "quad":
        hides = quad([gap, -50, 0], [0, 100, 0], [0, 0, 50], 0, 0, True)
    elif screen == "disk":
        hides = disk([gap, 0, 0], [0, 50, 0], [0, 0, 50], 0, 0, two_sided=True)
    else:
        grid = [quad([gap, y, z], [0, 5, 0], [0, 0, 5], 0, 0, True)
                for y in np.arange(-50, 50, 5) for z in np.arange(0, 50, 5)]  # fmt: skip
        faces = np.concatenate([q.faces + 4 * k for k, q in enumerate(grid)])
        hides = Part(np.concatenate([q.vertices for q in grid]), faces, 0, 0, True)
    plate = quad([-0.2, -0.2, 0], [0.2, 0, 0], [0, 0.4, 0], 0.5)
    # seen at x = -1e-5: the plate's edge is behind the screen
    at = [-1e-5, 0, 0]
    parts = [plate, hides] + ([] if source is None else [source])
    scene = make(parts, camera([-0.5, 0.1, 0.4], at, 1e-5), 2.0 if source is None else 0.0)
    t.agrees(scene, 0.5 * 2 * form / 2, 800_000, sees=0.005, margin=1e-4)


CORNELL = {
    "floor centre": ((278, 0, 279.5), (0, 1, 0), "floor", 0.044632475),
    "floor corner": ((100, 0, 100), (0, 1, 0), "floor", 0.030656670),
    "floor back": ((278, 0, 500), (0, 1, 0), "floor", 0.033300261),
    "right wall": ((0, 274.4, 279.6), (1, 0, 0), "right_wall", 0.044180738),
    "back wall": ((278, 274.4, 559.2), (0, 0, -1), "back_wall", 0.043652624),
}


@case(3, each={"place": CORNELL})
def cornell_box_direct(t: Trial, place: str) -> None:
    """The measured box without its blocks: irradiance at five points, three colours (A19).

    E / L of its light by Lambert's sum.
    """
    point, normal, shape, value = CORNELL[place]
    x, z, y = (213.0, 343.0), (227.0, 332.0), 548.8
    corners = [[x[0], y, z[0]], [x[1], y, z[0]], [x[1], y, z[1]], [x[0], y, z[1]]]
    factor = lambert(point, normal, corners)
    t.check(abs(math.pi * factor / value - 1) < 1e-6)
    empty = without(veriray.cornell_box(), lambda name: "block" in name)
    k = empty.triangle_shape.tolist().index(empty.shape_names.index(shape))
    exact = empty.reflectance[empty.triangle_material[k]] * empty.emissions[0] * factor
    view = camera([278, 200, 250], point)
    scene = dataclasses.replace(empty, camera=view, film=veriray.Film(1, 1, "box"), max_depth=2)
    t.agrees(scene, exact.astype(np.float64), 800_000, sees=0.003)


@case(3)
def small_bright_light(t: Trial) -> None:
    """0.2 x 0.2 of radiance 10^4: any clamp shows (A22).

    .5 x 10^4 x 4 F(.1, .1) = 62.824862.
    """
    exact = 0.5 * 1e4 * 4 * rectangle_above_corner(0.1, 0.1)
    t.check(abs(exact / 62.824862 - 1) < 1e-6)
    scene = make([floor(), lamp(-0.1, 0.1, -0.1, 0.1, 1e4)], DOWN)
    t.agrees(scene, exact, 1_600_000, sees=0.003)


@case(3, quick=False)
def small_bright_light_found_by_the_path(t: Trial) -> None:
    """Radiance 10^4 outside a glass bowl over the point: only paths find it, as fireflies (A22).

    All rays through the bowl's centre are radial and go straight on: T = (1 - R) / (1 + R), the
    rest comes back to the point. .5 x 10^4 x 4 F(.1, .1) T / (1 - .5 (1 - T)) = 60.311867. Sees
    2 %: a clamp at any radiance below 10^4 shows.
    """
    through = 0.96 / 1.04
    exact = 0.5 * 1e4 * 4 * rectangle_above_corner(0.1, 0.1) * through / (1 - 0.5 * (1 - through))
    t.check(abs(exact - 60.311867) < 1e-6)
    back = sum((0.5 * (1 - through)) ** k for k in range(60))  # bounce by bounce
    t.check(abs(exact / (62.824862 * through * back) - 1) < 1e-6)
    d = dicts
    bowl = [d.sphere([0, 0, 0], 0.5, d.glass(1.5)), d.sphere([0, 0, 0], 0.4, d.glass(1, 1.5))]
    small = d.flat("rectangle", [0, 0, 1], [0, 0, -1], 0.1, d.BLACK, 1e4)
    ground = d.flat("rectangle", [0, 0, 0], [0, 0, 1], 3, d.diffuse(0.5))
    scene = d.scene(d.view([-0.2, 0.1, 0.2], [0, 0, 0], 1e-4), ground, *bowl, small)
    t.agrees(scene, exact, 6_000_000, sees=0.02, margin=1e-4)


@case(3)
def light_against_the_point(t: Trial) -> None:
    """Paths that find the light by themselves carry the estimate: a lamp 0.01 above (A22).

    Four times the rectangle of 100 heights above its corner.
    """
    view = camera([0.5, 0, 0.004], [0, 0, 0])
    scene = make([floor(), lamp(-1, 1, -1, 1, 1.0, 0.01)], view)
    exact = 0.5 * 4 * rectangle_above_corner(100, 100)
    t.agrees(scene, exact, 1_600_000, sees=0.003)


@case(3)
def exactly_dark(t: Trial) -> None:
    """Below the horizon, behind a one-sided light, in full shadow, behind a wall (A23).

    0 without noise, and no shadow ray is free.
    """
    below = quad([1, -1, -2], [0, 2, 0], [0, 0, 1.9], 0, 5)
    turned = quad([-1, -1, 1], [2, 0, 0], [0, 2, 0], 0, 5)
    cover = quad([-4, -4, 0.5], [8, 0, 0], [0, 8, 0])
    aside = camera([1.5, 1, 0.3], [0, 0, 0])
    for parts, view in (
        ([floor(), below], DOWN),
        ([floor(), turned], aside),
        ([floor(), lamp(-1, 1, -1, 1, 5.0), cover], aside),
        ([floor(), lamp(-1, 1, -1, 1, 5.0)], camera([0.3, 0.4, -3], [0, 0, 0])),
        ([turned], camera([0, 0, 0], [0, 0, 1])),
    ):
        r = t.render(make(parts, view), 20_000)
        t.check(not r.image.any() and not r.stderr.any(), "light where there is none")
        t.check(not any(r.stats["ledger"]["shadow_visible"]), "a shadow ray got through")


@case(3)
def two_sided(t: Trial) -> None:
    """The back of a two-sided floor reflects as its front does (A10, A23).

    Radiance rho F from below.
    """
    below = quad([-1, -1, -1], [2, 0, 0], [0, 2, 0], 0, 1)
    exact = 0.5 * 4 * rectangle_above_corner(1, 1)
    view = camera([1.5, 1.2, -0.5], [0, 0, 0])
    t.agrees(make([floor(two_sided=True), below], view), exact, 800_000, sees=0.003)


# ---- bounce by bounce ----


@case(3, each={"shape": ("box", "hexagon", "mesh")})
def convex_object_under_a_constant_sky(t: Trial, shape: str) -> None:
    """A cube, a flat polygon, a mesh of albedo .7 in a sky of 1 (A5).

    Radiance rho L; no path lives beyond the second segment, and no shadow ray is stopped: exact.
    """
    mesh = trimesh.creation.icosphere(2)
    hexagon = [[math.cos(k), math.sin(k), 0] for k in np.arange(6) * math.pi / 3]
    part = {
        "box": box([-1, -1, -1], [1, 1, 1], False, 0.7),
        "hexagon": Part(hexagon, [[0, 1, 2], [0, 2, 3], [0, 3, 4], [0, 4, 5]], 0.7),
        "mesh": Part(mesh.vertices, mesh.faces, 0.7),
    }[shape]
    scene = make([part], camera([0.2, 0.1, 4], [0.1, 0.15, 0]), 1.0, rr_depth=100)
    r = t.agrees(scene, single(0.7), 1_600_000, sees=0.003)
    live = r.stats["live_rays"]
    t.check(live[:2] == [r.spp, r.spp])
    # Flat primitives are widened by 2^-20 along shared edges: no ray should meet that rim.
    t.rare(sum(live[2:]), r, "met the object again")
    t.rare(sum(r.stats["ledger"]["shadow_occluded"]), r, "hidden by the object itself")


def planes(a: float, b: float, emission: float) -> list[Part]:
    """Floor of albedo a and lit ceiling of albedo b, so wide that they close space."""
    size = 1e5
    return [quad([-size, -size, 0], [2 * size, 0, 0], [0, 2 * size, 0], a),
            quad([-size, -size, 1], [0, 2 * size, 0], [2 * size, 0, 0], b, emission)]  # fmt: skip


@case(3)
def lossless_floor_sees_a_second_bounce(t: Trial) -> None:
    """Two parallel planes so wide that they close space, with one of them lit (A1).

    Floor albedo a, lit ceiling albedo b, emission e: ceiling e / (1 - a b), floor a times that.
    """
    a, b = single(0.6), single(0.4)
    scene = make(planes(0.6, 0.4, 1.0), camera([0, 0, 0.5], [0, 0.2, 0]))
    t.agrees(scene, a / (1 - a * b), 800_000, sees=0.003, margin=1e-4)


@case(3, each={"depth": (1, 2, 3, 4, 5, -1), "seen": ("floor", "ceiling")})
def depth_counts(t: Trial, depth: int, seen: str) -> None:
    """max_depth 1 is emission alone, 2 adds direct light, 3 one bounce, and so on (A2).

    Between two planes, the ceiling lit: the floor has a e (1 + a b + ...), the ceiling
    e (1 + a b + ...), a term more with every second depth; 0 exactly for the floor at depth 1.
    """
    a, b, e = single(0.6), single(0.4), 2.0
    terms = {"floor": depth // 2, "ceiling": (depth + 1) // 2}[seen]
    series = (1 - (a * b) ** terms) / (1 - a * b) if depth > 0 else 1 / (1 - a * b)
    t.check(depth < 0 or abs(series - sum((a * b) ** k for k in range(terms))) < 1e-12)
    exact = e * series * (a if seen == "floor" else 1)
    eye = camera([0, 0, 0.5], [0, 0.2, 0.0 if seen == "floor" else 1.0])
    scene = make(planes(0.6, 0.4, e), eye, max_depth=depth)
    t.agrees(scene, exact, 200_000, sees=0.01, margin=1e-4)


# ---- source and sensor change places ----

ROOMS = ("diffuse", "glass", "mirror", "fog", "immersed")


def swap_room(kind: str, shine: int, rng: np.random.Generator) -> tuple[veriray.Scene, float]:
    """A room with two patches, one of which shines, seen from close to the other one.

    Returns the scene, whose one pixel covers the dark patch, and that patch's area over its albedo,
    times the square of the index where the other one shines. The rest of the room is random.
    """
    d = dicts
    walls, places = rng.uniform(0.3, 0.8, (6, 3)), rng.uniform(-0.25, 0.25, (4, 3))
    within: dict[str, Any] = {}
    if kind == "fog":
        within = {"interior": d.medium([2.0, 3.0, 4.0], [0.95, 0.7, 0.5], 0.6)}
    sides = np.concatenate([np.eye(3), -np.eye(3)])
    objects = [d.flat("rectangle", 2 * n, -n, 2, d.diffuse(w))
               for n, w in zip(sides, walls, strict=True)]  # fmt: skip
    bodies = {
        "diffuse": [d.diffuse(0.7), d.diffuse([0.2, 0.9, 0.4])],
        "glass": [d.glass(1.5), d.glass(1.5, 1.0, "plastic", diffuse_reflectance=d.rgb(0.8))],
        "mirror": [d.MIRROR, {"type": "conductor", "eta": d.rgb([0.2, 0.9, 1.1]),
                              "k": d.rgb([3.9, 2.4, 2.2])}],
        "fog": [d.NULL, d.glass(1.3, 1.0, "plastic", nonlinear=True,
                                        diffuse_reflectance=d.rgb(0.6))],
        "immersed": [d.diffuse(0.7), d.diffuse(0.3)],
    }[kind]  # fmt: skip
    objects += [d.sphere(np.array([-0.4, -0.5, 0.3]) + places[0], 0.5, bodies[0], **within),
                d.sphere(np.array([0.6, 0.5, -0.4]) + places[1], 0.55, bodies[1])]  # fmt: skip
    index = 1.5 if kind == "immersed" else 1.0
    if kind == "immersed":  # the second patch is under a sheet of glass
        objects.append(d.flat("rectangle", [0, 0, -1.4], [0, 0, 1], 2, d.glass(1.5)))
    # centre, normal, half size, albedo, index squared
    patches = [
        (np.array([-1.98, -0.6, 0.9]), np.array([1.0, 0, 0]), 0.4, 0.9, 1.0),
        (np.array([0.9, -0.8, -1.98]), np.array([0, 0, 1.0]), 0.3, 0.6, index**2),
    ]
    for k, (centre, normal, half, albedo, _) in enumerate(patches):
        objects.append(d.flat("rectangle", centre, normal, half, d.diffuse(albedo),
                              5.0 if k == shine else None))  # fmt: skip
    centre, normal, half, albedo, _ = patches[1 - shine]
    eye = d.view(centre + half * normal, centre, 90.0, up=[0, 1, 0])
    return d.scene(eye, *objects), (2 * half) ** 2 / albedo * patches[shine][4]


@case(3, each={"kind": ROOMS}, quick=lambda kind: kind in ("diffuse", "glass"))
def source_and_sensor_change_places(t: Trial, kind: str) -> None:
    """The light of one patch on another, and the other way round, in a random room (E5, E7).

    Equal, area times irradiance, all reflections included, with glass, mirrors or fog between, and
    with one patch in glass, where the index squared counts: H. von Helmholtz, 1860. Two-sample z
    test; sees 4 %.
    """
    seed = t.fresh()
    flux, error = [], []
    for shine in (0, 1):
        scene, weight = swap_room(kind, shine, np.random.default_rng(seed))
        r = t.render(scene, 4_000_000 if kind == "immersed" else 600_000)
        flux.append(r.image[0, 0].astype(np.float64) * weight)
        error.append(r.stderr[0, 0].astype(np.float64) * weight)
    spread = np.hypot(*error)
    t.p(max_z((flux[0] - flux[1]) / spread), "two ways")
    t.figure("flux", np.array(flux))
    t.sees(float(smallest_bias(float((spread / flux[0]).max()), 1.0)), 0.04)


# ---- long paths ----


@case(3)
def albedo_of_almost_one(t: Trial) -> None:
    """Albedo .999999, emission 1e-6; paths are cut at MAX_PATH_DEPTH (N12).

    As float32 the albedo is .99999898672. Exact, truncated: E (1 - rho^n) / (1 - rho), n =
    MAX_PATH_DEPTH. Margin 4e-4: the throughput is rounded n times. No stack and no cap but the
    stated one.
    """
    n = MAX_PATH_DEPTH
    rho, e = single(0.999999), single(1e-6)
    t.check(abs(rho - 0.99999898672) < 1e-11 and abs(e / (1 - rho) - 0.986895) < 1e-6)
    r = t.render(furnace(0.999999, 1e-6, rr_depth=2**31 - 1), 16)
    arrive = r.spp - int(t.leaks(r).sum())
    t.check(len(r.stats["live_rays"]) == n and r.stats["live_rays"][-1] == arrive, "live rays")
    t.check(r.stats["ledger"]["depth_cut"][-1] == arrive, "all are cut at the end")
    exact = e * (1 - rho**n) / (1 - rho)
    off = abs(float(r.image.mean()) / exact - 1)
    t.check(off < 4 * float(r.stderr.max()) / exact + 4e-4, f"off by {off:.2g}")


@case(3)
def scenes_are_what_they_say(t: Trial) -> None:
    """The furnaces above are flat quads, on a device that says what it is.

    Six quads after merging pairs of triangles.
    """
    t.check(t.native_scene(furnace(0.5, 0.5)).primitives["quads"] == 6)
    t.check(t.native.build_info()["backend"] in ("cpu", "cuda"))
