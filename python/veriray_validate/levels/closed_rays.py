"""Single rays and narrow views of flat faces: every seed draws new scenes.

Their rays start close to what they see, and the origin of all lengths lies there.
"""

from __future__ import annotations

import math

import numpy as np

from veriray.transform import rotate
from veriray_validate.dicts import both, box_film, diffuse, flat, look, scene, sky, sphere
from veriray_validate.trial import Trial, case

FEW, MANY = 60, 1000  # scenes of a quick and of a full case
KINDS = ("rectangle", "disk")


@case(3, each={"tree": (False, True), "scenes": (FEW, MANY)},
      quick=lambda tree, scenes: scenes == FEW)  # fmt: skip
def flat_faces_seen_by_narrow_views(t: Trial, tree: bool, scenes: int) -> None:
    """A white convex face of two sides under a sky of 1: 1 in every sample, and no ray misses it.

    Seen upright and at a slant, down to 0.06 degrees, from the front and from behind, by one ray,
    by narrow and by parallel views, at places up to 1,000 sizes from the world's origin, some disks
    in their middle and turned about one axis. A tree of dark specks behind the eye changes nothing,
    nor a black ball behind the face. Margin 1e-5.
    """
    for k in range(scenes):
        kind = KINDS[int(t.rng.integers(2))]
        turned = t.rng.uniform() < 0.3  # about one axis: a part of the normal is 0, or rounded 0
        normal = t.rng.normal(size=3) * 10 ** t.rng.uniform(-4, 0, 3)
        normal[t.rng.integers(3)] = 1
        normal[t.rng.integers(3)] *= not turned
        normal /= np.linalg.norm(normal)
        slope = 1.0 if k % 2 else 10 ** t.rng.uniform(-3, 0)
        along = np.cross(normal, t.rng.normal(size=3))
        along /= np.linalg.norm(along)
        ahead = math.sqrt(1 - slope * slope) * along + t.rng.choice([-1, 1]) * slope * normal
        place = t.rng.normal(size=3) * 10 ** t.rng.uniform(-1, 3) * (not turned)
        eye = place - 10 ** t.rng.uniform(-2, 1) * ahead
        # A ray that hits the diagonal between the face's triangles exactly may end there.
        middle = place + 0.31 * along + 0.17 * np.cross(normal, along)
        if turned and kind == "disk":
            middle = place
        film = box_film()
        width = 10 ** t.rng.uniform(-9, -6)
        sensor = [
            {"type": "radiancemeter", "origin": eye.tolist(), "direction": ahead.tolist()},
            {"type": "perspective", "fov": math.degrees(width), "to_world": look(eye, place)},
            {"type": "orthographic",
             "to_world": look(eye, place) @ np.diag([width, width, 1.0, 1.0])},
        ][k % 3]  # fmt: skip
        face = flat(kind, middle.tolist(), normal.tolist(), 1.0, both(diffuse(1.0)))
        if t.rng.uniform() < 0.5:  # turned in its plane
            spin = float(t.rng.uniform(0, 360))
            face["to_world"] = face["to_world"] @ rotate([0, 0, 1], spin)
        away = float(t.rng.uniform(10, 300))
        ball = sphere(place + away * ahead, 0.5 * away * slope, diffuse(0.0))
        behind = [ball] if t.rng.uniform() < 0.5 else []
        specks = [sphere((eye - (40 + n) * ahead).tolist(), 1e-3, diffuse(0.0))
                  for n in range(80 * tree)]  # fmt: skip
        shown = scene({**sensor, "film": film}, face, *behind, *specks, sky(1), max_depth=2)
        seen = float(t.render(shown, 64).image.mean())
        told = f"{sensor['type']}, {kind}, slope {slope:.2g}, normal {normal}, {len(behind)} behind"
        t.check(abs(seen - 1) < 1e-5, f"{told}: {seen:.6g}")
