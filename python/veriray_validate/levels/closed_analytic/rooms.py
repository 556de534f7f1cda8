"""Closed rooms: furnaces, integrating spheres, equilibrium, long paths."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import numpy.typing as npt
import trimesh

from veriray.scene import MAX_PATH_DEPTH
from veriray_validate import dicts
from veriray_validate.levels.closed_analytic.parts import single
from veriray_validate.scenes import (
    Part,
    box,
    camera,
    disk,
    furnace,
    make,
    material,
    point_light,
    sphere,
)
from veriray_validate.statistics import chi_square, max_z, smallest_bias
from veriray_validate.trial import Trial, case

Array = npt.NDArray[np.float64]


# ---- closed scenes ----

FURNACES = {0.5: (0.5, 1.0), 0.9: (1.0, 10.0)}  # albedo: emission, radiance


@case(3, each={"albedo": FURNACES})
def diffuse_furnace(t: Trial, albedo: float) -> None:
    """A closed room of one albedo that shines everywhere.

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
    """Radiance and length of paths in a furnace with roulette.

    E / (1 - rho), and live[d] / N = 1 below rr_depth, then rho^d: multinomial chi-square over the
    depths of death, sees 0.5 % in the survival probability.
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


@case(3, each={"depth": (1, 2, 3, 4, 5, 6)})
def truncated_furnace(t: Trial, depth: int) -> None:
    """A furnace cut at max_depth: .5, .75, .875 ....

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
    """Colours do not mix; long walls; turned, in a tree, with triangle lights.

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
    """A closed box of shining mirrors, reflectance .8: radiance 5; cut at a depth less.

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
    """A sphere in three patches, one of them lit, and its series in depth.

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
    """A sphere with a lit port and a dark one, both flat.

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
    """Part of a sphere is cut off by a reflecting disk that shines.

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
    """A point light off the centre of a room of one albedo: the mean over its walls.

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
    """Everything shines with what it does not reflect: G. Kirchhoff, 1860.

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


# ---- long paths ----


@case(3)
def albedo_of_almost_one(t: Trial) -> None:
    """Albedo .999999, emission 1e-6; paths are cut at MAX_PATH_DEPTH.

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
