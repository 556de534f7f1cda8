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


@case(3, each={"scenes": (FEW, MANY)}, quick=lambda scenes: scenes == FEW)
def sun_in_a_rough_mirror(t: Trial, scenes: int) -> None:
    """Along its mirrored ray, a sun of irradiance 1 on rough metal: D G / (4 cos), by GGX.

    alpha from 1e-4, where that is 8e6 and more, to 0.3; up to 80 degrees, turned; one in three is
    principled. No sample is too bright for the film. Margin 1e-3: float32 directions are 1e-7 off.
    """
    for k in range(scenes):
        alpha = 10 ** t.rng.uniform(math.log10(1e-3 if k % 3 == 0 else 1e-4), math.log10(0.3))
        angle = math.radians(t.rng.uniform(0, 80))
        normal = t.rng.normal(size=3)
        normal /= np.linalg.norm(normal)
        along = np.cross(normal, t.rng.normal(size=3))
        along /= np.linalg.norm(along)
        up, aside = math.cos(angle) * normal, math.sin(angle) * along
        metal = (
            {"type": "principled", "metallic": 1.0, "base_color": 1.0, "roughness": alpha**0.5}
            if k % 3 == 0
            else {"type": "roughconductor", "material": "none", "distribution": "ggx",
                  "alpha": alpha}
        )  # fmt: skip
        shown = scene(
            {"type": "radiancemeter", "origin": (2 * (up + aside)).tolist(),
             "direction": (-up - aside).tolist(), "film": box_film()},
            flat("rectangle", (0, 0, 0), normal.tolist(), 1.0, metal),
            {"type": "directional", "direction": (aside - up).tolist(), "irradiance": 1.0},
            max_depth=2,
        )  # fmt: skip
        shadow = 2 / (1 + math.sqrt(1 + (alpha * math.tan(angle)) ** 2))
        wanted = shadow**2 / (4 * math.pi * alpha**2 * math.cos(angle))
        seen = float(t.render(shown, 4).image.mean())
        told = f"{metal['type']}, alpha {alpha:.3g}, {math.degrees(angle):.3g} degrees"
        t.check(abs(seen / wanted - 1) < 1e-3, f"{told}: {seen:.6g}, not {wanted:.6g}")
