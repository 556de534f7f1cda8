"""Absorption along rays and shadow rays: Beer and Lambert."""

from __future__ import annotations

import math

import numpy as np

from veriray_validate.dicts import (
    BLACK,
    NULL,
    Dict,
    cuboid,
    diffuse,
    direction,
    flat,
    medium,
    rgb,
    scene,
    sky,
    sphere,
    view,
)
from veriray_validate.form_factors import gauss
from veriray_validate.trial import Trial, case

# ---- absorption ----


@case(3, each={"boundary": ("null", "mask")})
def beer_lambert(t: Trial, boundary: str) -> None:
    """A lamp behind an absorbing slab.

    e^-tau in three channels, tau = .1, 1, 3: .904837, .367879, .049787.
    """
    tau = np.array([0.1, 1.0, 3.0])
    material = NULL if boundary == "null" else {"type": "mask", "opacity": 0.0, "bsdf": BLACK}
    slab = cuboid([-50, -50, 0], [50, 50, 2], material, interior=medium(tau / 2, 0.0))
    lamp = flat("rectangle", [0, 0, -1], [0, 0, 1], 50, BLACK, 1)
    seen = scene(view([0, 0, 5], [0, 0, 0]), slab, lamp)
    t.agrees(seen, np.exp(-tau), 800_000, sees=0.02)


@case(3, quick=False)
def beer_lambert_of_ten(t: Trial) -> None:
    """A lamp behind an absorbing slab of optical depth 10.

    e^-10 = 4.539993e-5; one path in 22,026 arrives. Sees 10 %.
    """
    t.check(abs(math.exp(-10) / 4.539993e-5 - 1) < 1e-6)
    slab = cuboid([-50, -50, 0], [50, 50, 2], NULL, interior=medium(5.0, 0.0))
    lamp = flat("rectangle", [0, 0, -1], [0, 0, 1], 50, BLACK, 1)
    t.agrees(scene(view([0, 0, 5], [0, 0, 0]), slab, lamp), math.exp(-10), 60_000_000, sees=0.1)


@case(3)
def beer_lambert_in_a_camera_medium(t: Trial) -> None:
    """The camera in the medium and the lamp oblique.

    e^-(sigma d): the ray's length counts.
    """
    ink = medium([0.2, 0.5, 1.0], 0.0)
    eye = view(4 * direction(50), [0, 0, 0], medium=ink)
    around = sphere([0, 0, 0], 9, NULL, interior=ink)
    lamp = flat("rectangle", [0, 0, 0], [0, 0, 1], 1, BLACK, 1)
    exact = np.exp(-4 * np.array([0.2, 0.5, 1.0]))
    t.agrees(scene(eye, around, lamp), exact, 800_000, sees=0.03)


@case(3, each={"shells": (1, 4)})
def transmittance_of_shadow_rays(t: Trial, shells: int) -> None:
    """A point light in an absorbing ball over a floor.

    I cos / d^2 rho / pi e^-tau, without noise; tau = 1.5 in green: .223130. In several shells, one
    in another, the same.
    """
    position, rho = 5 * direction(35), 0.5
    tau = np.array([0.3, 1.5, 4.0])
    radii = np.linspace(2, 1, shells)
    inks = [medium(tau / 2 * (1 + 0.3 * k), 0.0) for k in range(shells)]
    depth = np.append(-np.diff(radii), radii[-1])
    balls = []
    for k, radius in enumerate(radii):
        around = {} if k == 0 else {"exterior": inks[k - 1]}
        balls.append(sphere(position, radius, NULL, interior=inks[k], **around))
    total = sum(tau / 2 * (1 + 0.3 * k) * depth[k] for k in range(shells))
    if shells == 1:
        t.check(abs(math.exp(-total[1]) - 0.223130) < 1e-6)
    exact = rho / math.pi * 7 * math.cos(math.radians(35)) / 25 * np.exp(-total)
    floor = flat("rectangle", [0, 0, 0], [0, 0, 1], 9, diffuse(rho))
    light = {"type": "point", "position": position, "intensity": rgb(7)}
    seen = scene(view([-3, 0, 1], [0, 0, 0]), floor, light, *balls, max_depth=2)
    # A medium ends 2^-21 of the coordinates before its surface.
    t.agrees(seen, exact, 10_000, sees=1e-3, margin=3e-5 * shells)


@case(3, each={"light": ("sun", "lamp")})
def absorbing_sheet_over_a_floor(t: Trial, light: str) -> None:
    """Parallel light through an absorbing sheet at 50 degrees, and a square lamp above it.

    rho / pi E cos e^(-tau / cos), without noise; the lamp by quadrature of e^(-tau / cos) over its
    form factor: shadow rays of all lengths. Sees 0.5 %.
    """
    tau, rho = np.array([0.3, 1.0, 4.0]), 0.5
    # a medium ends 2^-21 of the scene before its surface: the scene is small; the camera is below
    floor = flat("rectangle", [0, 0, 0], [0, 0, 1], 1, diffuse(rho))
    sheet = cuboid([-2.5, -2.5, 1], [2.5, 2.5, 1.5], NULL, interior=medium(2 * tau, 0.0))
    eye = view([-0.6, 0.2, 0.5], [0, 0, 0])
    if light == "sun":
        c = math.cos(math.radians(50))
        source: Dict = {"type": "directional", "direction": -direction(50), "irradiance": rgb(3)}
        exact = rho / math.pi * 3 * c * np.exp(-tau / c)
        t.agrees(scene(eye, floor, sheet, source, max_depth=2), exact, 10_000, sees=1e-3,
                 margin=1e-4)  # fmt: skip
        return
    source = flat("rectangle", [0, 0, 2], [0, 0, -1], 1.5, BLACK, 3)
    x, w = gauss(80, 0, 1.5)
    d2 = x[:, None] ** 2 + x**2 + 4
    c = 2 / np.sqrt(d2)
    seen = np.exp(-tau[:, None, None] / c) * c**2 / d2 / math.pi
    exact = rho * 3 * 4 * np.einsum("kij,i,j->k", seen, w, w)
    t.agrees(scene(eye, floor, sheet, source), exact, 1_600_000, sees=0.01, margin=1e-4)


@case(3)
def chromatic_distance_to_a_wall(t: Trial) -> None:
    """Extinctions of .1, 1 and 5 with albedo 0.

    e^-tau: no channel's paths may be lost because of another's extinction.
    """
    slab = cuboid([-50, -50, 0], [50, 50, 1], NULL, interior=medium([0.1, 1.0, 5.0], 0.0))
    seen = scene(view([0, 0, 5], [0, 0, 0]), slab, sky(1))
    t.agrees(seen, np.exp([-0.1, -1.0, -5.0]), 1_600_000, sees=0.05)
