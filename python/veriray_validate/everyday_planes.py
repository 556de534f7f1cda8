"""Random scenes in which planes nearly contain the origin, and lamps of materials that transmit."""

from __future__ import annotations

import math
from typing import Any

import numpy as np

from veriray_validate.everyday import Question, decades, gridded, moved
from veriray_validate.everyday_bodies import mesh
from veriray_validate.everyday_scale import chosen
from veriray_validate.scenes import Part, camera, disk, make, material, quad, sphere


def nearly(rng: np.random.Generator) -> float:
    """0, or 1e-17 to 1e-5 of either sign."""
    return 0.0 if rng.random() < 0.1 else float(rng.choice([-1.0, 1.0])) * decades(rng, -17, -5)


def level(rng: np.random.Generator) -> Question:
    """White things, black within or behind, under a sky of 1: 1.

    A body of more than 1,024 faces on a box as high as itself: the box's top is nearly in the
    middle of the scene, which is the origin. Or a ball above a disk nearly at the camera's height,
    which is the origin of small scenes. The plane may be tilted by as little.
    """
    off, tilt = nearly(rng), abs(nearly(rng))
    white: dict[str, Any] = {"reflectance": 1.0}
    turn = np.eye(4)
    turn[1, 2], turn[2, 1] = -tilt, tilt
    if rng.random() < 0.5:
        vertices, faces, form = mesh(rng, decades(rng, 3.3, 4))
        vertices = vertices * (0.5 / np.ptp(vertices[:, 2]))
        vertices[:, 2] += 0.5 + off - vertices[:, 2].max()
        top = Part(vertices, faces, **white)
        floor = gridded([-2, -2, -0.5], [2, 2, 0], int(rng.integers(1, 4)), **white)
        parts = [floor, top]
        moved(parts, turn)
        at = rng.uniform(-1, 1)
        eye, target = [3 * math.sin(at), -3 * math.cos(at), 2.0], [0, 0, 0]
        view = camera(eye, target, 40, [0, 0, 1])
        form = f"{form} on a box"
    else:
        height = float(rng.uniform(0.5, 0.8))
        rim = disk([0, 0, 0], [1, 0, tilt], [0, 1, 0], **white)
        parts = [rim, sphere([0, 0, height], 0.3, **white)]
        view = camera([0, -3, off], [0, 0, height], 12, [0, 0, 1])
        form = "ball over a disk"
    seen = make(parts, view, 1.0, width=16, height=16, max_depth=-1)
    return Question(f"{form}, off {off:g}, tilt {tilt:g}", seen, 1.0, backs=True)


#: Materials that let light through and spread it.
CLOUDY: dict[str, dict[str, Any]] = {
    "thin": material("principledthin", roughness=0.9, spec_trans=0.5, diff_trans=1.0, eta=1.4),
    "paper": material("principledthin", roughness=0.5, diff_trans=2.0, eta=1.4),
    "rough glass": material("roughdielectric", alpha_u=0.5, alpha_v=0.5, eta=1.5),
    "principled": material("principled", roughness=0.5, spec_trans=1.0, eta=1.4),
}


def glowing(rng: np.random.Generator) -> Question:
    """A convex lamp of radiance 1 that lets light through, among black specks in front of it: 1.

    It shines outwards, or to one side, so it does not light itself.
    """
    name, form = chosen(rng, list(CLOUDY)), chosen(rng, ("square", "disk", "ball", "box"))
    kind: dict[str, Any] = {"reflectance": 0.8, "emission": 1.0, "material": CLOUDY[name]}
    if form == "square":
        lamp = quad([-1, -1, 0], [2, 0, 0], [0, 2, 0], **kind)
    elif form == "disk":
        lamp = disk([0, 0, 0], [1, 0, 0], [0, 1, 0], **kind)
    elif form == "ball":
        lamp = sphere([0, 0, -1], 1, **kind)
    else:
        lamp = gridded([-1, -1, -1], [1, 1, 0], int(rng.integers(1, 3)), **kind)
    specks = []
    for _ in range(int(rng.integers(0, 3))):
        x, y = rng.uniform(0.6, 0.9, 2) * rng.choice([-1.0, 1.0], 2)
        specks.append(quad([x, y, decades(rng, -3, -0.5)], [0.02, 0, 0], [0, 0.02, 0]))
    if rng.random() < 0.3:
        specks.append(quad([0, 0, -8], [1e-5, 0, 0], [0, 1e-5, 0]))
    # 12.8 degrees about the ball's middle, 7.3 from the axis: below 7.8 corners do not pass it
    view = camera([0.5, -2, 3], [0, 0, 0], float(rng.uniform(1, 7.5)), [0, 0, 1])
    seen = make([lamp, *specks], view, width=16, height=16, max_depth=-1)
    return Question(f"{form} of {name}, {len(specks)} specks", seen, 1.0)
