"""Bounce by bounce; source and sensor change places."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import trimesh

import veriray
from veriray_validate import dicts
from veriray_validate.levels.closed_analytic.parts import single
from veriray_validate.scenes import Part, box, camera, make, quad
from veriray_validate.statistics import max_z, smallest_bias
from veriray_validate.trial import Trial, case

# ---- bounce by bounce ----


@case(3, each={"shape": ("box", "hexagon", "mesh")})
def convex_object_under_a_constant_sky(t: Trial, shape: str) -> None:
    """A cube, a flat polygon, a mesh of albedo .7 in a sky of 1.

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
    """Two parallel planes so wide that they close space, with one of them lit.

    Floor albedo a, lit ceiling albedo b, emission e: ceiling e / (1 - a b), floor a times that.
    """
    a, b = single(0.6), single(0.4)
    scene = make(planes(0.6, 0.4, 1.0), camera([0, 0, 0.5], [0, 0.2, 0]))
    t.agrees(scene, a / (1 - a * b), 800_000, sees=0.003, margin=1e-4)


@case(3, each={"depth": (1, 2, 3, 4, 5, -1), "seen": ("floor", "ceiling")})
def depth_counts(t: Trial, depth: int, seen: str) -> None:
    """max_depth 1 is emission alone, 2 adds direct light, 3 one bounce, and so on.

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
    """The light of one patch on another, and the other way round, in a random room.

    Equal, area times irradiance, all reflections included, with glass, mirrors or fog between, and
    with one patch in glass, where the index squared counts: H. von Helmholtz, 1860. Two-sample z
    test; sees 4 %.
    """
    seed = t.fresh()
    flux, error = [], []
    for shine in (0, 1):
        scene, weight = swap_room(kind, shine, np.random.default_rng(seed))
        r = t.render(scene, {"immersed": 4_000_000, "glass": 1_600_000}.get(kind, 600_000))
        flux.append(r.image[0, 0].astype(np.float64) * weight)
        error.append(r.stderr[0, 0].astype(np.float64) * weight)
    spread = np.hypot(*error)
    t.p(max_z((flux[0] - flux[1]) / spread), "two ways")
    t.figure("flux", np.array(flux))
    t.sees(float(smallest_bias(float((spread / flux[0]).max()), 1.0)), 0.04)
