"""Random sheets over a floor, lamps among them, some with a cover that almost touches them."""

from __future__ import annotations

import numpy as np

from veriray.scene import Scene
from veriray_validate.everyday import LIFTED, Question, a_gap
from veriray_validate.scenes import Part, camera, disk, make, quad

LEAST = 2e-6  # between a cover and its lamp


def sheet(kind: str, x: float, y: float, z: float, half: float, down: bool, *more: float) -> Part:
    """A square or disk at a height, front up or down."""
    a, b, c = np.array([half, 0, 0]), np.array([0, half, 0]), np.array([x, y, z])
    a, b = (b, a) if down else (a, b)
    return disk(c, a, b, *more) if kind == "disk" else quad(c - a - b, 2 * a, 2 * b, *more)


def sheets(rng: np.random.Generator) -> Question:
    """Two or three lamps over each other above a grey floor, most of them with a cover.

    Lamps and covers are squares or disks, one-sided. Their picture with any gap is that with a gap
    of 1e-4, in a tree or not: through a slit of it around a lamp of at least 0.6 x 0.6, 4 x 0.6 x
    1e-4 / 0.36 of its light goes. So 1e-3 of the mean, and 16 times that for a block, is a margin.
    """
    lamps = []
    for k in range(int(rng.integers(2, 4))):
        kind, over = (str(x) for x in rng.choice(["quad", "disk"], 2, p=[0.7, 0.3]))
        x, y = rng.uniform(-0.4, 0.4, 2).round(3).tolist()
        half, share = rng.uniform([0.3, 0.2], 1.2).round(3).tolist()
        down, covered = (rng.random(2) < 0.7).tolist()
        radiance = round(float(10 ** rng.uniform(-1, 1)), 3)
        lamps.append((kind, over if covered else "", x, y, 0.8 + 0.5 * k, half, half * share, down,
                      radiance))  # fmt: skip
    gap = a_gap(rng, LIFTED, LEAST)
    order = rng.permutation(2 * len(lamps) + 1)
    look = float(rng.uniform(0, 2 * np.pi))

    def scene(gap: float, tree: bool) -> Scene:
        parts: list[Part | None] = [quad([-2, -2, 0], [4, 0, 0], [0, 4, 0], 0.5)]
        for kind, over, x, y, z, half, size, down, radiance in lamps:
            parts.append(sheet(kind, x, y, z, half, down, 0.0, radiance))
            above = z - gap if down else z + gap
            parts.append(sheet(over, x, y, above, size, down, 0.5) if over else None)
        shown = [parts[k] for k in order if parts[k] is not None]
        if tree:
            shown.append(quad([0, 0, -1], [1e-5, 0, 0], [0, 1e-5, 0], 0.0))
        eye = camera([3 * np.cos(look), 3 * np.sin(look), 0.6], [0, 0, 0.3], 40)
        return make(shown, eye, 0.1, width=16, height=16)

    told = f"{len(lamps)} lamps {lamps}, gap {gap:g}, eye {look:.3f}"
    return Question(told, scene(gap, False), scene(LIFTED, True), 1e-3, 1.6e-2, 0.05, spp=256)
