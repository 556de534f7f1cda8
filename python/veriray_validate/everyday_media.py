"""Random bodies of fog in walls of index 1, which let light through by chance, not straight."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import trimesh
from trimesh.transformations import random_rotation_matrix

from veriray_validate.everyday import Question, gridded, moved
from veriray_validate.everyday_scale import chosen
from veriray_validate.scenes import (
    NULL,
    Medium,
    Part,
    camera,
    make,
    material,
    point_light,
    quad,
    sphere,
)

#: Where lamps and other things are, beside a lamp far above.
PLACES = (
    "alone", "lamp inside", "point light inside", "lamp close outside", "window", "shining wall",
    "bubble", "lamp in a bubble",
)  # fmt: skip


def _body(rng: np.random.Generator, open_wall: bool, **kind: Any) -> tuple[Part, str]:
    """A ball, a cube or a mesh of fog about the unit ball; in pieces if a wall is to be opened."""
    form = chosen(rng, ("cube", "mesh") if open_wall else ("cube", "mesh", "ball"))
    if form == "ball":
        return sphere([0, 0, 0], 1, **kind), form
    if form == "cube":
        part = gridded([-0.8, -0.8, -0.8], [0.8, 0.8, 0.8], int(rng.integers(1, 8)), **kind)
    else:
        mesh = trimesh.creation.icosphere(int(rng.integers(1, 5)))
        part = Part(mesh.vertices, mesh.faces, **kind)
    moved([part], random_rotation_matrix(rng.random(3)))
    return part, f"{form} of {len(part.faces)}"


def walled(rng: np.random.Generator, place: str) -> Question:
    """Fog in a body of glass of index 1, under a lamp and a sky of 0.2: as in walls of nothing.

    Light samples from the fog end at such walls, and its light comes by chance; where a wall is
    open, or a lamp inside, they arrive. A point light lights the fog around it alone.
    """
    fog = Medium(10 ** rng.uniform(-0.5, 0.7), float(rng.uniform(0.5, 0.95)),
                 float(rng.uniform(-0.5, 0.8)))  # fmt: skip
    glass, point = material("dielectric", eta=1.0), place == "point light inside"
    opens = place in ("window", "shining wall")
    part, form = _body(rng, opens, material=glass, interior=fog)
    fixed: list[Part] = []
    if not point:
        fixed += [quad([-3, -3, -1.3], [6, 0, 0], [0, 6, 0], 0.6),
                  quad([-2, 0, 3], [4, 0, 0], [0, -2, 2], 0, 3)]  # fmt: skip
    if place in ("lamp inside", "lamp in a bubble"):
        fixed.append(sphere([0.1, 0, 0], 0.2, 0, 2))
    if place == "lamp close outside":
        fixed.append(sphere([0.85, -0.85, 0.85], 0.25, 0, 2))
    if "bubble" in place:
        fixed.append(sphere([0.1, 0, 0], 0.4, material=NULL, exterior=fog))
    if opens:  # half of the faces, in the order of the file
        cut = len(part.faces) // 4 * 2
        shines = {"emission": 1.0} if place == "shining wall" else {"material": NULL}
        fixed.append(Part(part.vertices, part.faces[:cut], interior=fog, **shines))
        part.faces = part.faces[cut:]
    view = camera([0, -4.5, 1.2], [0, 0, 0], 2 * math.degrees(math.atan(1.3 / 4.5)), [0, 0, 1])
    size: dict[str, Any] = {"width": 16, "height": 16, "max_depth": -1}
    if point:
        size["lights"] = [point_light([0.1, 0, 0], 0.3)]

    def seen(walls: dict[str, Any]) -> Any:
        part.material = walls
        return make([*fixed, part], view, 0.2, **size)

    drawn = f"{place}, {form}, {fog.sigma_t[0]:.3g}, {fog.albedo[0]:.3g}, {fog.g:.2f}"
    return Question(drawn, seen(glass), seen(NULL), sees=0.05)
