"""Closed forms under every scheduler: the mean of a picture of many pixels.

Level 6 proves that schedulers give equal bits; here each gives the right answer on its own, for
pictures large enough to fill it.
"""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Callable
from typing import Any

import numpy as np
import trimesh

import veriray
from veriray.comparison.statistics import MARGIN
from veriray.rendering import METHODS, SCHEDULERS
from veriray_validate import dicts as d
from veriray_validate.form_factors import lambert, rectangle_above_corner
from veriray_validate.fresnel import fresnel, internal_reflectance
from veriray_validate.levels.closed_analytic.direct import FIVE
from veriray_validate.levels.closed_analytic.parts import DOWN, ceiling, floor, lamp
from veriray_validate.levels.closed_lights import hundred_lights
from veriray_validate.scenes import Part, camera, furnace, make
from veriray_validate.statistics import error_of_sum, max_z, smallest_bias
from veriray_validate.transfer import adding_doubling
from veriray_validate.trial import Trial, case

SIDE = 128
Known = tuple[veriray.Scene, Any]


def _mesh() -> Known:
    ball = trimesh.creation.icosphere(2)
    albedo = np.array([0.2, 0.5, 0.8])
    wall = Part(ball.vertices, ball.faces[:, ::-1], albedo, [3.0, 0.1, 0.5])
    return make([wall], camera([0, 0, 0], [0.3, 0.2, 1], 60)), [3.0, 0.1, 0.5] / (1 - albedo)


def _lights() -> Known:
    form = [lambert([0, 0, 0], [0, 0, 1], ceiling(*rect)) for *rect, _ in FIVE]
    shine = sum(f * emission for f, (*_, emission) in zip(form, FIVE, strict=True))
    parts = [floor(), *[lamp(*rect, emission) for *rect, emission in FIVE]]
    return make(parts, DOWN, 0.8), 0.5 * (shine + 0.8 * (1 - sum(form)))


def _hundred() -> Known:
    objects, exact = hundred_lights()
    return d.scene(d.view([0, 0, 5], [0, 0, 0]), *objects, max_depth=2), exact


def _plastic() -> Known:
    rho, f, fi = np.array([0.1, 0.5, 0.9]), float(fresnel(0.5, 1.5)), internal_reflectance(1.5)
    coat = d.glass(1.5, 1.0, "plastic", diffuse_reflectance=d.rgb(rho), nonlinear=True)
    plate = d.flat("rectangle", [0, 0, 0], [0, 0, 1], 100, coat)
    exact = f + (1 - f) * (1 - fi) * rho / (1 - fi * rho)
    return d.scene(d.view(5 * d.direction(60), [0, 0, 0]), plate, d.sky(1)), exact


def _slab() -> Known:
    r, t = 0.04, math.exp(-1)
    pane = d.cuboid([-50, -50, -1], [50, 50, 0], d.glass(1.5), interior=d.medium(1.0, 0.0))
    lamps = [d.flat("rectangle", [0, 0, -9], [0, 0, 1], 40, d.BLACK, [1, 0, 1]),
             d.flat("rectangle", [0, 0, 9], [0, 0, -1], 40, d.BLACK, [0, 1, 1])]  # fmt: skip
    through = (1 - r) ** 2 * t / (1 - (r * t) ** 2)
    back = r + (1 - r) ** 2 * r * t * t / (1 - (r * t) ** 2)
    return d.scene(d.view([0, 0, 5], [0, 0, 0]), pane, *lamps), [through, back, through + back]


def _equilibrium() -> Known:
    bodies = [d.sphere([0, 0, 0], 1, d.glass(1.5)),
              d.sphere([0.1, 0.2, 0], 0.5, d.diffuse(0.4), 0.6 * 2.25)]  # fmt: skip
    return d.scene(d.view([1, 2, 6], [0, 0, 0], 26), *bodies, d.sky(1)), 1.0


def _passes() -> Known:
    ground = d.flat("rectangle", [0, 0, 0], [0, 0, 1], 9, d.diffuse(0.5))
    lit = d.flat("rectangle", [0, 0, 2], [0, 0, -1], 0.5, d.BLACK, 3)
    shells = [d.sphere([0, 0, 0], 0.1 + 0.15 * k, d.NULL) for k in range(10)]
    eye = d.view([-3, 0.3, 1], [0, 0, 0])
    exact = 0.5 * 3 * 4 * rectangle_above_corner(0.25, 0.25)
    return d.scene(eye, ground, lit, *shells, max_depth=2), exact


def _half_space() -> Known:
    albedo = np.array([0.5, 0.9, 0.99])
    exact = [adding_doubling(1e3, w, 0.75, 1.5, [1.0])[0][0] for w in albedo.tolist()]
    ground = d.cuboid([-2000, -2000, -1000], [2000, 2000, 0], d.glass(1.5),
                      interior=d.medium(1.0, albedo, 0.75))  # fmt: skip
    return d.scene(d.view([0, 0, 5], [0, 0, 0], 1e-3), ground, d.sky(1)), exact


def _fog() -> Known:
    ball = d.sphere([0.1, 0, 0.2], 1, d.NULL, interior=d.medium([1.0, 2.0, 4.0], 1.0, 0.3))
    return d.scene(d.view([1, 2, 6], [0, 0, 0], 26), ball, d.sky(1)), 1.0


def _beam() -> Known:
    g, mu0 = 0.8, 0.5
    phase = (1 - g * g) / (1 + g * g + g) ** 1.5
    exact = 0.9 / (4 * math.pi) * phase * mu0 / (1 + mu0) * (1 - math.exp(-1 - 1 / mu0))
    slab = d.cuboid([-40, -40, 0], [40, 40, 1], d.NULL, interior=d.medium(1.0, 0.9, g))
    sun = {"type": "directional", "direction": -d.direction(60), "irradiance": d.rgb(1)}
    return d.scene(d.view([0, 0, 5], [0, 0, 0.5], 1e-3), slab, sun, max_depth=2), exact


def _lens() -> Known:
    focus, fov, depth, r = 4.0, 24.0, 2.0, 0.05
    disk = d.flat("disk", [0, 0, -depth], [0, 0, 1], r, d.BLACK, 1)
    eye = d.view([0, 0, 0], [0, 0, -1], fov, 1, "thinlens", aperture_radius=0.1,
                 focus_distance=focus, rfilter={"type": "gaussian"})  # fmt: skip
    half = depth * math.tan(math.radians(fov / 2))
    return d.scene(eye, disk), math.pi * (r / (2 * half)) ** 2


SCENES: dict[str, tuple[Callable[[], Known], float]] = {  # scene and answer; margin
    "furnace": (lambda: (furnace(0.9, 1.0), 1 / (1 - float(np.float32(0.9)))), MARGIN),
    "cut furnace": (lambda: (furnace(0.5, 0.5, max_depth=3), 0.875), MARGIN),
    "mesh": (_mesh, MARGIN),
    "lights and sky": (_lights, MARGIN),
    "hundred lights": (_hundred, MARGIN),
    "plastic": (_plastic, MARGIN),
    "absorbing slab": (_slab, MARGIN),
    "equilibrium": (_equilibrium, MARGIN),
    "passes": (_passes, MARGIN),
    "scattering glass": (_half_space, 5e-5),
    "coloured fog": (_fog, MARGIN),
    "single scattering": (_beam, 5e-5),
    "lens": (_lens, MARGIN),
}


SAMPLES = {"hundred lights": 20, "lens": 160, "passes": 4, "absorbing slab": 24}
#: Runs whose means give the error where pixels share samples (cpp/film/shared.h). Their errors are
#: not independent then, and those of a picture add up to more than their squares say.
BATCHES = {"lens": 20}


HEAVY = ("furnace", "mesh", "hundred lights", "passes", "scattering glass")


@case(3, each={"name": SCENES, "scheduler": [s for s in SCHEDULERS if s != "auto"]},
      quick=lambda name, scheduler: scheduler in METHODS[1:] and name not in HEAVY)  # fmt: skip
def scheduler(t: Trial, name: str, scheduler: str) -> None:
    """A scene of each kind under each scheduler.

    The known answer in the mean over 128 x 128 pixels, per channel. Sees 4 %.
    """
    build, margin = SCENES[name]
    scene, exact = build()
    film = dataclasses.replace(scene.film, width=SIDE, height=SIDE)
    batches = BATCHES.get(name, 0)
    r = t.render(dataclasses.replace(scene, film=film), SAMPLES.get(name, 8), scheduler=scheduler,
                 batches=batches)  # fmt: skip
    truth = np.broadcast_to(np.asarray(exact, np.float64), 3)
    mean = r.image.mean(axis=(0, 1), dtype=np.float64)
    error, law = error_of_sum(r)
    error /= SIDE**2
    off = np.sign(mean - truth) * np.maximum(np.abs(mean - truth) - margin * truth, 0)
    t.check(r.stats["scheduler"] == scheduler)
    t.check((off == 0) | (error > 0), f"{mean} for {truth}")
    z = off[error > 0] / error[error > 0]
    if batches:  # channels that share their noise count once
        z = np.unique(z)
    t.p(max_z(z, law) if len(z) else 1.0, "picture mean")
    t.sees(float(max(smallest_bias(e, m, law=law) for e, m in zip(error, truth, strict=True)))
           + margin, 0.04)  # fmt: skip
