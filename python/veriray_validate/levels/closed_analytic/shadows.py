"""Shadows, small and near lights, what is exactly dark."""

from __future__ import annotations

import dataclasses
import math

import numpy as np

import veriray
from veriray_validate import dicts
from veriray_validate.form_factors import lambert, rectangle_above_corner
from veriray_validate.levels.closed_analytic.parts import DOWN, floor, lamp
from veriray_validate.scenes import Part, camera, disk, make, quad, sphere, without
from veriray_validate.statistics import binomial
from veriray_validate.trial import Trial, case

# ---- shadows ----


@case(3)
def known_shadow(t: Trial) -> None:
    """A black screen at half the height hides one quadrant of the light.

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
    """An upright screen through the normal hides half of a lamp, or of the sky.

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
    t.agrees(scene, 0.5 * 2 * form / 2, 900_000, sees=0.005, margin=1e-4)


CORNELL = {
    "floor centre": ((278, 0, 279.5), (0, 1, 0), "floor", 0.044632475),
    "floor corner": ((100, 0, 100), (0, 1, 0), "floor", 0.030656670),
    "floor back": ((278, 0, 500), (0, 1, 0), "floor", 0.033300261),
    "right wall": ((0, 274.4, 279.6), (1, 0, 0), "right_wall", 0.044180738),
    "back wall": ((278, 274.4, 559.2), (0, 0, -1), "back_wall", 0.043652624),
}


@case(3, each={"place": CORNELL})
def cornell_box_direct(t: Trial, place: str) -> None:
    """The measured box without its blocks: irradiance at five points, three colours.

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
    """0.2 x 0.2 of radiance 10^4: any clamp shows.

    .5 x 10^4 x 4 F(.1, .1) = 62.824862.
    """
    exact = 0.5 * 1e4 * 4 * rectangle_above_corner(0.1, 0.1)
    t.check(abs(exact / 62.824862 - 1) < 1e-6)
    scene = make([floor(), lamp(-0.1, 0.1, -0.1, 0.1, 1e4)], DOWN)
    t.agrees(scene, exact, 1_600_000, sees=0.003)


@case(3, quick=False)
def small_bright_light_found_by_the_path(t: Trial) -> None:
    """Radiance 10^4 outside a glass bowl over the point: only paths find it, as fireflies.

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
    """Paths that find the light by themselves carry the estimate: a lamp 0.01 above.

    Four times the rectangle of 100 heights above its corner.
    """
    view = camera([0.5, 0, 0.004], [0, 0, 0])
    scene = make([floor(), lamp(-1, 1, -1, 1, 1.0, 0.01)], view)
    exact = 0.5 * 4 * rectangle_above_corner(100, 100)
    t.agrees(scene, exact, 1_600_000, sees=0.003)


@case(3)
def exactly_dark(t: Trial) -> None:
    """Below the horizon, behind a one-sided light, in full shadow, behind a wall.

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
    """The back of a two-sided floor reflects as its front does.

    Radiance rho F from below.
    """
    below = quad([-1, -1, -1], [2, 0, 0], [0, 2, 0], 0, 1)
    exact = 0.5 * 4 * rectangle_above_corner(1, 1)
    view = camera([1.5, 1.2, -0.5], [0, 0, 0])
    t.agrees(make([floor(two_sided=True), below], view), exact, 800_000, sees=0.003)
