"""Random lamps that are in the scene twice or more: of things in one place the first is seen."""

from __future__ import annotations

import numpy as np

from veriray.scene import Scene
from veriray_validate.dicts import BLACK, Dict, area, cuboid, diffuse, flat, scene, sphere, view
from veriray_validate.everyday import Question

KINDS = ("ball", "disk", "rectangle", "box")
WAYS = ("after", "before", "core", "shell")


def thing(kind: str, place: np.ndarray, size: float, normal: np.ndarray) -> Dict:
    """A lamp's shape, in black."""
    if kind == "ball":
        return sphere(place.tolist(), size, BLACK)
    if kind == "box":
        return cuboid(place - size, place + size, BLACK)
    shape = "disk" if kind == "disk" else "rectangle"
    return flat(shape, place.tolist(), normal.tolist(), [size, 0.7 * size], BLACK)


def copied(rng: np.random.Generator) -> Question:
    """Lamps over a grey floor, each with one to three copies: their picture without what is hidden.

    Copies are black or shine in another way; of balls they are up to 1e-14 aside. They follow their
    lamp, which is seen, or a black one precedes it and is seen. Of balls also a black core or
    shell, from a billionth to a thousandth smaller or larger: the larger is seen. In three of ten
    draws all is within a ball that shines inwards, which has a copy too. Half of the scenes have a
    tree; those that they are compared with have none. Margin 1e-3, and 4e-3 for a block; the
    pictures have the same random numbers.
    """
    drawn: list[Dict] = []
    seen: list[Dict] = []
    told = []
    for k in range(int(rng.integers(1, 4))):
        kind, way = str(rng.choice(KINDS)), str(rng.choice(WAYS, p=[0.4, 0.2, 0.2, 0.2]))
        way = way if kind == "ball" or way in WAYS[:2] else "after"
        place = np.array([-1.2 + 1.2 * k, rng.uniform(-0.6, 0.6), rng.uniform(0.6, 1.1)]).round(3)
        size = round(float(rng.uniform(0.15, 0.45)), 3)
        normal = np.array([*rng.uniform(-0.5, 0.5, 2), -1.0]).round(3)
        black = thing(kind, place, size, normal)
        radiance = (10 ** rng.uniform(-1, 0.5, 3)).round(3).tolist()
        lamp = {**black, "emitter": area(radiance)}
        gap = float(10 ** rng.uniform(-9, -3))
        other = {**black, "emitter": area(radiance[::-1])}
        more = [dict([black, lamp, other][int(rng.integers(3))]) for _ in range(rng.integers(1, 4))]
        if kind == "ball":
            for copy in more:
                copy["center"] = (place + 10 ** rng.uniform(-18, -14, 3)).tolist()
        if way == "after":
            parts, first = [lamp, *more], lamp
        elif way == "before":
            parts, first = [black, lamp, *more], black
        else:
            close = {**black, "radius": size * (1 - gap if way == "core" else 1 + gap)}
            parts, first = [close, lamp] if rng.random() < 0.5 else [lamp, close], lamp
            first = lamp if way == "core" else close
        drawn += parts
        seen.append(first)
        told.append((kind, way, place.tolist(), size, normal.tolist(), len(parts), gap))
    if rng.random() < 0.3:
        room = {**sphere([0, 0, 0], 5, diffuse(0.3), 0.05), "flip_normals": True}
        drawn += [room, {**sphere([0, 0, 0], 5, BLACK, 0.5), "flip_normals": True}]
        seen.append(room)
        told.append(("room",))
    floor = flat("rectangle", [0, 0, 0], [0, 0, 1], 2, diffuse(0.5))
    below = []
    if rng.random() < 0.5:
        below = [
            flat("disk", [0.02 * k - 0.7, 0, -0.02], [0, 0, 1], 0.005, BLACK) for k in range(70)
        ]
    look = float(rng.uniform(0, 2 * np.pi))

    def picture(parts: list[Dict]) -> Scene:
        eye = view([3 * np.cos(look), 3 * np.sin(look), 0.4], [0, 0, 0.4], 50, 16)
        dim = {"type": "constant", "radiance": 0.02}
        return scene(eye, floor, *parts, dim)

    name = f"lamps {told}, {'a' if below else 'no'} tree, eye {look:.3f}"
    return Question(name, picture(drawn + below), picture(seen), 1e-3, 4e-3, 0.05, spp=256)
