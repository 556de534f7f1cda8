"""Plastic, surfaces that let light pass, shading normals."""

from __future__ import annotations

import dataclasses
import math

import numpy as np

import veriray
from veriray_validate.dicts import (
    BLACK,
    MIRROR,
    NULL,
    Dict,
    cuboid,
    diffuse,
    direction,
    flat,
    glass,
    masked,
    plastic,
    rgb,
    scene,
    sky,
    sphere,
    view,
)
from veriray_validate.form_factors import rectangle_above_corner
from veriray_validate.fresnel import fresnel, internal_reflectance
from veriray_validate.trial import Trial, case

# ---- plastic ----


@case(3, each={"nonlinear": (False, True), "angle": (0, 60, 80)})
def plastic_in_a_sky(t: Trial, nonlinear: bool, angle: float) -> None:
    """A smooth coat on a diffuse base in a sky of 1.

    F + (1 - F) (1 - Fi) rho / (1 - Fi rho); linear: F + (1 - F) rho. Fi by quadrature.
    """
    eta, rho = 1.5, np.array([0.1, 0.5, 0.9])
    f, fi = float(fresnel(math.cos(math.radians(angle)), eta)), internal_reflectance(eta)
    base = (1 - fi) * rho / (1 - fi * rho) if nonlinear else rho
    exact = 0.8 * f + (1 - f) * base
    coat = plastic(rho, eta, nonlinear=nonlinear, specular_reflectance=rgb(0.8))
    plate = flat("rectangle", [0, 0, 0], [0, 0, 1], 100, coat)
    eye = 5 * direction(angle)
    t.agrees(scene(view(eye, [0, 0, 0]), plate, sky(1)), exact, 800_000, sees=0.01)


@case(3, each={"eta": (1.3, 1.9)})
def roulette_between_lobes_is_splitting(t: Trial, eta: float) -> None:
    """Radiance of a plastic floor under a lamp whose mirror image is a second lamp.

    Splitting, by quadrature: F(o) L_mirror + sum over the lamp of (1 - F(i)) (1 - F(o)) f cos.
    """
    rho, angle = np.array([0.2, 0.5, 0.8]), 50.0
    fi, f = internal_reflectance(eta), float(fresnel(math.cos(math.radians(angle)), eta))
    x, w = np.polynomial.legendre.leggauss(64)
    u, v = np.meshgrid(x, x + 0.3)  # lamp: [-1, 1] x [-.7, 1.3] at height 1.5
    distance2 = u**2 + v**2 + 1.5**2
    cosine = 1.5 / np.sqrt(distance2)
    weight = np.outer(w, w) * cosine**2 / distance2 * (1 - fresnel(cosine, eta))
    base = rho / (1 - fi * rho) * (1 - f) / eta**2 / math.pi
    mirrored = 5 * direction(-angle)
    exact = f * 2.0 + base * weight.sum()
    parts = [
        flat("rectangle", [0, 0, 0], [0, 0, 1], 20, plastic(rho, eta, nonlinear=True)),
        flat("rectangle", [0, 0.3, 1.5], [0, 0, -1], 1, BLACK, 1),
        flat("disk", mirrored, -mirrored, 0.05, BLACK, 2),
    ]
    # The small lamp lights the floor too, by pi .05^2 / 25 of its radiance.
    small = 2 * math.pi * 0.05**2 / 25 * math.cos(math.radians(angle))
    exact = exact + base * small * (1 - f)
    floor = scene(view(5 * direction(angle), [0, 0, 0]), *parts)
    t.agrees(floor, exact, 1_600_000, sees=0.02, margin=1e-4)


# ---- passes ----


@case(3)
def masks_and_panes_in_front_of_a_lamp(t: Trial) -> None:
    """A lamp behind black masks of opacity .3 and .5, null surfaces and both sides of a mask.

    .7 x .5 of it, at max_depth 1: passes are not bounces.
    """
    lamp = flat("rectangle", [0, 0, -5], [0, 0, 1], 5, BLACK, [1, 2, 3])
    panes = [flat("rectangle", [0, 0, 1], [0, 0, 1], 2, masked(0.3, BLACK)),
             flat("disk", [0, 0, 0], [0, 0, -1], 2, masked(0.5, BLACK)),
             sphere([0, 0, -2], 1, NULL), cuboid([-1, -1, -4.5], [1, 1, -3.5], NULL)]  # fmt: skip
    seen = scene(view([0.2, 0.1, 5], [0, 0, 0]), lamp, *panes, max_depth=1)
    t.agrees(seen, np.array([1, 2, 3]) * 0.7 * 0.5, 800_000, sees=0.01)


@case(3, each={"material": ("mask", "null", "thindielectric")})
def shadow_rays_pass(t: Trial, material: str) -> None:
    """A point light over a floor, with a pane in between.

    Straight through, without noise: .7, 1, (1 - f) / (1 + f) of it.
    """
    thin = glass(1.5, 1.0, "thindielectric", specular_transmittance=rgb([1, 0.5, 0.2]))
    pane = {"mask": masked(0.3, BLACK), "null": NULL, "thindielectric": thin}[material]
    position = 3 * direction(40)
    c = math.cos(math.radians(40))
    f = float(fresnel(c, 1.5))
    through = {"mask": 0.7, "null": 1.0,
               "thindielectric": (1 - f) / (1 + f) * np.array([1, 0.5, 0.2])}[material]  # fmt: skip
    exact = 0.5 / math.pi * 4 * c / 9 * np.ones(3) * through
    objects = [
        flat("rectangle", [0, 0, 0], [0, 0, 1], 9, diffuse(0.5)),
        flat("rectangle", [1, 0, 1.5], [0, 0, 1], 1.5, pane),
        {"type": "point", "position": position, "intensity": rgb(4)},
    ]
    seen = scene(view([-3, 0, 1], [0, 0, 0]), *objects, max_depth=2)
    r = t.agrees(seen, exact, 10_000, sees=1e-4)
    t.check(r.stats["ledger"]["shadow_visible"][0] == r.spp)
    t.check(not any(r.stats["ledger"]["shadow_occluded"]), "a shadow ray was stopped")


@case(3, each={"lamp": ("rectangle", "sphere"), "depth": (2, -1)},
      quick=lambda lamp, depth: depth == 2)  # fmt: skip
def passes_do_not_count_as_bounces(t: Trial, lamp: str, depth: int) -> None:
    """Ten null shells around a floor, between it and its lamp.

    The form factor of the lamp, as without the shells, also at max_depth 2.
    """
    floor = flat("rectangle", [0, 0, 0], [0, 0, 1], 9, diffuse(0.5))
    lamps = {"rectangle": (flat("rectangle", [0, 0, 2], [0, 0, -1], 0.5, BLACK, 3),
                           4 * rectangle_above_corner(0.25, 0.25)),
             "sphere": (sphere([0, 0, 2], 1.2, BLACK, 3), (1.2 / 2) ** 2)}  # fmt: skip
    shells = [sphere([0, 0, 0], 0.1 + 0.15 * k, NULL) for k in range(10)]
    shining, factor = lamps[lamp]
    exact = 0.5 * 3 * factor
    seen = scene(view([-3, 0.3, 1], [0, 0, 0]), floor, shining, *shells, max_depth=depth)
    t.agrees(seen, exact, 200_000, sees=0.02)


# ---- shading normals ----


def tilted(degrees: float, material: Dict) -> tuple[veriray.Scene, float]:
    """A plate z = 0 whose vertex normals lean towards +x, in a sky of 1, seen from above."""
    plate = flat("rectangle", [0, 0, 0], [0, 0, 1], 9, material)
    flat_scene = scene(view([-1, 0, 3], [0, 0, 0]), plate, sky(1))
    normals = np.broadcast_to(direction(degrees), flat_scene.vertices.shape)
    return dataclasses.replace(flat_scene, normals=normals), math.radians(degrees)


@case(3, each={"degrees": (5, 30, 60)})
def shading_normals_do_not_light_from_behind(t: Trial, degrees: float) -> None:
    """A diffuse plate with bent normals in a sky of 1.

    A cosine lobe about n_s, cut at the plane of n_g: (1 + cos) / 2 of it. Nothing leaks.
    """
    bent, angle = tilted(degrees, diffuse(0.8))
    t.agrees(bent, 0.8 * (1 + math.cos(angle)) / 2, 800_000, sees=0.01)


@case(3, each={"degrees": (5, 30, 60)})
def mirror_about_a_shading_normal(t: Trial, degrees: float) -> None:
    """A mirror with a bent normal sees the lamp in the direction that follows from that normal.

    The lamp's radiance, or 0 exactly where the direction is behind the plate.
    """
    bent, _ = tilted(degrees, MIRROR)
    eye = np.array([-1.0, 0, 3]) / math.sqrt(10)
    n = direction(degrees)
    out = 2 * (eye @ n) * n - eye
    if out[2] > 0:
        lamp = flat("disk", 4 * out, -out, 0.02, BLACK, [1, 2, 3])
        plate = flat("rectangle", [0, 0, 0], [0, 0, 1], 9, MIRROR)
        seen = scene(view([-1, 0, 3], [0, 0, 0]), lamp, plate)
        normals = np.zeros(seen.vertices.shape)
        normals[-4:] = n
        seen = dataclasses.replace(seen, normals=normals)
        t.agrees(seen, [1, 2, 3], 1000, sees=1e-4)
    else:
        t.agrees(bent, 0.0, 1000, sees=1e-4)


@case(3)
def interpolated_normals_have_unit_length(t: Trial) -> None:
    """A plate with normals 45 degrees to the left at its left end, to the right at its right one.

    Halfway between the middle and the right end they lean by atan(1 / 2): rho / pi I cos / d^2 of a
    point light.
    """
    plate = flat("rectangle", [0, 0, 0], [0, 0, 1], 9, diffuse(0.5))
    light = {"type": "point", "position": [6.5, 0, 3], "intensity": rgb(4)}
    seen = scene(view([3.5, 0.1, 2], [4.5, 0.1, 0]), plate, light, max_depth=2)
    leaning = (np.sign(seen.vertices) * [1, 0, 0] + [0, 0, 1]) / math.sqrt(2)
    to_light = np.array([2, -0.1, 3])
    cosine = to_light @ [1, 0, 2] / math.sqrt(5) / np.linalg.norm(to_light)
    exact = 0.5 / math.pi * 4 * cosine / (to_light @ to_light)
    t.agrees(dataclasses.replace(seen, normals=leaning), exact, 10_000, sees=1e-3, margin=1e-4)


@case(3, each={"turned": (False, True)})
def the_front_is_the_faces(t: Trial, turned: bool) -> None:
    """A lamp whose vertex normals lean by 60 degrees, seen at 50 degrees from the other side.

    All of its radiance on the side of the face where its vertex normals point, exactly 0 on the
    other, for either winding.
    """
    for eye in (direction(-50), -direction(-50)):
        seen = scene(view(5 * eye, [0, 0, 0]), flat("rectangle", [0, 0, 0], [0, 0, 1], 9, BLACK, 3))
        normals = np.broadcast_to(direction(60) * (-1 if turned else 1), seen.vertices.shape)
        exact = 3.0 if (eye[2] > 0) != turned else 0.0
        t.agrees(dataclasses.replace(seen, normals=normals), exact, 1000, sees=1e-4)
