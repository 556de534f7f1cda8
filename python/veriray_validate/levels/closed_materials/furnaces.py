"""White furnaces and thermodynamic equilibrium: lossless bodies are invisible."""

from __future__ import annotations

import numpy as np

from veriray_validate.dicts import (
    BLACK,
    MIRROR,
    NULL,
    both,
    cuboid,
    diffuse,
    direction,
    flat,
    glass,
    masked,
    plastic,
    scene,
    sky,
    sphere,
    view,
)
from veriray_validate.trial import Trial, case

# ---- furnaces ----

LOSSLESS = {
    "diffuse": diffuse(1),
    "mirror": MIRROR,
    "glass": glass(1.5),
    "bubble": glass(1.0, 1.5),
    "thin": glass(1.7, 1.0, "thindielectric"),
    "plastic": plastic(1, 1.5),
    "plastic nonlinear": plastic(1, 1.9, nonlinear=True),
    "mask of diffuse": masked(0.4, both(diffuse(1))),
    "mask of mirror": masked(0.7, both(MIRROR)),
    "mask of plastic": masked(0.6, both(plastic(1, 1.3))),
    "null": NULL,
}


@case(3, each={"name": LOSSLESS, "kind": ("sphere", "cube")}, quick=lambda name, kind: (
    kind == "sphere" or name in ("glass", "bubble", "plastic", "mask of mirror")))  # fmt: skip
def white_furnace(t: Trial, name: str, kind: str) -> None:
    """A lossless body in a constant sky is invisible, at every pixel, silhouettes too.

    Exactly the sky: 1, .5, 2. Sees 1e-3. No path is absorbed: the picture's margin hides ten in a
    million that meet the back of a face past an edge, but their count does not.
    """
    material = LOSSLESS[name]
    if kind == "sphere":
        body = sphere([0.1, 0, 0.2], 1, material)
    else:
        body = cuboid([-0.7, -0.5, -0.9], [0.8, 0.6, 0.7], material)
    furnace = scene(view([1, 2, 6], [0, 0, 0], 26, 8), body, sky([1, 0.5, 2]))
    r = t.agrees(furnace, [1, 0.5, 2], 30_000, sees=1e-3)
    t.rare(sum(r.stats["ledger"]["absorbed"]), r, "absorbed by a lossless body")


@case(3, each={"name": LOSSLESS, "angle": (0, 60, 80, 89, 89.9)},
      quick=lambda name, angle: angle in (60, 89.9))  # fmt: skip
def lossless_plate(t: Trial, name: str, angle: float) -> None:
    """A lossless plate or block in a constant sky, up to grazing angles.

    Directional albedo 1 at every angle of incidence: 1, .5, 2. Sees 0.4 %.
    """
    if name in ("glass", "bubble"):  # both of its sides
        plate = cuboid([-100, -100, -1], [100, 100, 0], LOSSLESS[name])
    else:
        plate = flat("rectangle", [0, 0, 0], [0, 0, 1], 100, LOSSLESS[name])
    seen = scene(view(5 * direction(angle), [0, 0, 0], 1e-3), plate, sky([1, 0.5, 2]))
    t.agrees(seen, [1, 0.5, 2], 400_000, sees=4e-3)


@case(3, each={"name": ("disk", "rectangle")})
def white_furnace_of_open_surfaces(t: Trial, name: str) -> None:
    """Two-sided plates, one above another.

    The light between them finds its way out: 1. Sees 1e-3.
    """
    plates = [flat(name, [0, 0, z], [0.2, 0, 1], 1, both(material)) for z, material in
              ((0.0, plastic(1, 1.5)), (0.5, diffuse(1)), (-0.6, MIRROR))]  # fmt: skip
    furnace = scene(view([1, 4, 3], [0, 0, 0], 40, 6), *plates, sky(1))
    t.agrees(furnace, 1.0, 40_000, sees=1e-3)


@case(3)
def nested_glass_in_a_furnace(t: Trial) -> None:
    """Index 1.5 in 1.33 in 1, a bubble beside it, and glass inside out.

    1 at every pixel. Sees 1e-3.
    """
    nest = [sphere([0, 0, 0], 1.2, glass(1.33)), sphere([-0.3, 0, 0], 0.6, glass(1.5, 1.33)),
            sphere([0.7, 0.2, 0], 0.3, glass(1, 1.33))]  # fmt: skip
    inside_out = {**sphere([-0.4, 0.1, 0.1], 0.2, glass(1.5, 1)), "flip_normals": True}
    furnace = scene(view([1, 2, 6], [0, 0, 0], 26, 8), *nest, inside_out, sky(1))
    t.agrees(furnace, 1.0, 40_000, sees=1e-3)


@case(3)
def thermodynamic_equilibrium(t: Trial) -> None:
    """A black ball of radiance n^2 in glass of index n, in a sky of 1.

    1 from outside, n^2 from within: no other test sees a missing n^2.
    """
    n = 1.5
    bodies = [sphere([0, 0, 0], 1, glass(n)), sphere([0.1, 0.2, 0], 0.5, BLACK, n * n)]
    outside = scene(view([1, 2, 6], [0, 0, 0], 26, 8), *bodies, sky(1))
    t.agrees(outside, 1.0, 20_000, sees=1e-3)
    within = scene(view([-0.6, -0.3, 0.1], [0, 0, 0.2], 90, 6), *bodies, sky(1))
    t.agrees(within, n * n, 20_000, sees=1e-3)


@case(3, each={"place": ("outside", "water", "glass")},
      quick=lambda place: place == "outside")  # fmt: skip
def equilibrium_in_nested_glass(t: Trial, place: str) -> None:
    """Grey bodies at equilibrium in glass in water in a sky: G. Kirchhoff, 1860.

    Emission (1 - albedo) n^2 with the index around it: 1 from outside, n^2 from within. Sees 0.3 %.
    """
    water, flint = 1.33, 1.7
    exact = {"outside": 1.0, "water": water**2, "glass": flint**2}[place]
    bodies = [
        sphere([0, 0, 0], 2, glass(water)),
        sphere([-0.6, 0, 0], 1, glass(flint, water)),
        sphere([-0.9, 0.2, 0], 0.4, diffuse(0.3), 0.7 * flint**2),
        sphere([1.1, 0.3, 0.2], 0.5, diffuse([0.8, 0.5, 0.0]),
               np.array([0.2, 0.5, 1.0]) * water**2),
        sphere([0.9, -0.9, -0.3], 0.3, glass(1.0, water)),
    ]  # fmt: skip
    eye = {
        "outside": view([1, 2, 9], [0, 0, 0], 26, 6),
        "water": view([0.9, -0.2, 1.2], [0, 0, 0], 90, 6),
        "glass": view([-0.2, -0.1, 0.3], [-0.9, 0.2, 0], 90, 6),
    }[place]
    # grey bodies emit 1 - albedo in single precision
    t.agrees(scene(eye, *bodies, sky(1)), exact, 40_000, sees=3e-3)
