"""White media in a sky of their brightness; clear media."""

from __future__ import annotations

import math

from veriray_validate.dicts import NULL, cuboid, glass, medium, scene, sky, sphere, view
from veriray_validate.trial import Trial, case

# ---- furnaces ----

WHITE = {
    "isotropic": ([1.0, 2.0, 4.0], 0.0),
    "grey": (3.0, 0.0),
    "forward": (4.0, 0.9),
    "backward": (2.0, -0.7),
}


@case(3, each={"name": WHITE, "boundary": ("null", "glass")}, quick=lambda name, boundary: (
    name != "grey" and (name == "forward") == (boundary == "glass")))  # fmt: skip
def white_furnace_of_a_medium(t: Trial, name: str, boundary: str) -> None:
    """Albedo 1 in a null ball and in a glass ball, in a sky of 1.

    Radiance 1 everywhere. Sees 0.2 %.
    """
    extinction, g = WHITE[name]
    material = NULL if boundary == "null" else glass(1.5)
    ball = sphere([0.1, 0, 0.2], 1, material, interior=medium(extinction, 1.0, g))
    furnace = scene(view([1, 2, 6], [0, 0, 0], 26, 4), ball, sky(1))
    t.agrees(furnace, 1.0, 100_000, sees=3e-3 if name == "isotropic" else 1.5e-3)


@case(3)
def white_furnace_of_nested_and_touching_media(t: Trial) -> None:
    """A ball in a ball in a glass ball; two cubes that share a wall, one with air inside.

    Lossless: 1 everywhere. Sees 0.2 %.
    """
    outer, inner = medium(1.0, 1.0), medium(3.0, 1.0, 0.5)
    bodies = [
        sphere([-1.2, 0, 0], 1, glass(1.3), interior=outer),
        sphere([-1.2, 0.1, 0], 0.5, NULL, interior=inner, exterior=outer),
        sphere([-1.0, 0.1, 0], 0.2, NULL, exterior=inner),
        cuboid([0, -0.5, -0.5], [1, 0.5, 0.5], NULL, interior=inner),
        cuboid([1.0001, -0.5, -0.5], [2, 0.5, 0.5], glass(1.2), interior=outer),
    ]
    furnace = scene(view([1, 2, 6], [0, 0, 0], 34, 6), *bodies, sky(1))
    t.agrees(furnace, 1.0, 20_000, sees=2e-3)


@case(3, each={"place": ("fog", "water")})
def camera_in_a_white_medium(t: Trial, place: str) -> None:
    """The camera stands in fog of albedo 1, in a null ball and in water.

    1, and n^2. Sees 0.2 %.
    """
    fog = medium(1.5, 1.0, 0.4)
    material, exact = (NULL, 1.0) if place == "fog" else (glass(1.33), 1.33**2)
    eye = view([0.3, 0.1, 0.2], [0, 0.4, 1], 90, 4, medium=fog)
    furnace = scene(eye, sphere([0, 0, 0], 1, material, interior=fog), sky(1))
    t.agrees(furnace, exact, 40_000, sees=2e-3)


@case(3, each={"distance": (10.0, 1e3, 1e4)}, quick=lambda distance: distance == 1e4)
def white_medium_from_afar(t: Trial, distance: float) -> None:
    """A ball of radius 1 whose coordinates are rounded to 1e-7 of the camera's distance.

    Still 1: shadow rays and paths must cross the same length of medium, whatever the rounding.
    """
    ball = sphere([0, 0, 0], 1, NULL, interior=medium(8.0, 1.0))
    fov = 2 * math.degrees(math.atan(0.9 / distance))
    far = scene(view([0, 0, distance], [0, 0, 0], fov), ball, sky(1))
    t.agrees(far, 1.0, 800_000, sees=3e-3)


@case(3)
def ledger_of_a_clear_medium(t: Trial) -> None:
    """Extinction 0 is a vacuum.

    Three segments, no scattering, the sky itself: exactly.
    """
    ball = sphere([0, 0, 0], 1, NULL, interior=medium(0.0, 0.5))
    r = t.render(scene(view([0, 0, 5], [0, 0, 0]), ball, sky(2)), 1000)
    t.check(r.image == 2)
    t.check(r.stats["live_rays"] == [r.spp, r.spp, r.spp])
