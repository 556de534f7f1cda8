"""Random heaps on a floor: sheets, and bodies within bodies, all in contact or nearly so."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from trimesh.transformations import random_rotation_matrix

from veriray.scene import Scene
from veriray_validate.everyday import LIFTED, LOSSY, Question, a_gap, direction, gridded, moved
from veriray_validate.scenes import Part, camera, make, material

SHEETS: dict[str, dict[str, Any]] = {
    "mask": LOSSY["mask"],
    "thin": {"reflectance": 0.0, "material": material("thindielectric", eta=1.5)},
}
FLOAT32 = 5e-7  # gaps that corners of float32 can tell
BODIES = ("glass", "fog", "milky glass", "mask")


def tiled(half: float, z: float, n: int, up: bool, **more: Any) -> Part:
    """A square of n x n quads across z."""
    x = np.linspace(-half, half, n + 1)
    xy = np.stack(np.meshgrid(x, x, indexing="ij"), axis=-1).reshape(-1, 2)
    i = (np.arange(n)[:, None] * (n + 1) + np.arange(n)).ravel()
    quads = np.stack([i, i + n + 1, i + n + 2, i + 1], axis=1)[:, :: 1 if up else -1]
    faces = quads[:, [[0, 1, 2], [0, 2, 3]]].reshape(-1, 3)
    return Part(np.column_stack([xy, np.full(len(xy), z)]), faces, **more)


@dataclass(frozen=True)
class Heap:
    """Sheets (kind, half width, front up) on a floor, from below, and bodies within each other.

    half, height: of the outermost body. gaps: below each of them. cells: how many quads the floor
    and each of them are divided into along a side. single: corners are rounded to float32, as files
    of meshes have them.
    """

    sheets: tuple[tuple[str, float, bool], ...]
    bodies: tuple[str, ...]
    half: float
    height: float
    gaps: tuple[float, ...]
    cells: tuple[int, ...]
    look: tuple[float, float]
    turn: tuple[float, float, float] | None = None
    single: bool = False

    def scene(self) -> Scene:
        """Below an even sky, seen from above."""
        parts = [tiled(1.0, 0.0, self.cells[0], True, reflectance=0.5)]
        z, inset, top = 0.0, 0.0, self.height + sum(self.gaps[: len(self.sheets) + 1])
        for gap, n, (kind, half, up) in zip(self.gaps, self.cells[1:], self.sheets, strict=False):
            z += gap
            parts.append(tiled(half, z, n, up, **SHEETS[kind]))
        for k, kind in enumerate(self.bodies, len(self.sheets)):
            z, inset = z + self.gaps[k], inset + self.gaps[k] * (k > len(self.sheets))
            low, high = [inset - self.half] * 2 + [z], [self.half - inset] * 2 + [top - inset]
            parts.append(gridded(low, high, self.cells[1 + k], **LOSSY[kind]))
        turn = np.eye(4) if self.turn is None else random_rotation_matrix(np.array(self.turn))
        moved(parts, turn)
        for p in parts:
            p.vertices = p.vertices.astype(np.float32).astype(float) if self.single else p.vertices
        eye = camera(turn[:3, :3] @ (2 * direction(*self.look)), np.zeros(3), 8, turn[:3, 1])
        return make(parts, eye, 1.0, width=4, height=4, max_depth=-1)


def heap(rng: np.random.Generator) -> Question:
    """Up to two sheets and up to three bodies on them; in one of five scenes, six of either.

    Each gap is one of its own; most are none.

    The picture is that with gaps of 1e-4 (of tall heaps 1e-5), undivided and unturned: through the
    slits, 4 x 0.6 x 1e-4 over 0.36, less than 1e-3 of the light goes.
    """
    kind = str(rng.choice(list(SHEETS)))  # in one place either may be above
    tall = rng.random() < 0.2
    sheets = tuple(
        (kind, float(rng.uniform(0.15, 0.9)), bool(rng.random() < 0.5))
        for _ in range(int(rng.integers(7 if tall else 3)))
    )
    bodies = tuple(map(str, rng.choice(BODIES, int(rng.integers(not sheets, 7 if tall else 4)))))
    if bodies and rng.random() < 0.3:
        bodies = (*bodies[:-1], "diffuse")
    count = len(sheets) + len(bodies)
    many = rng.random() < 0.1  # more pairs of faces than are looked at
    single = bool(rng.random() < 0.5)
    gaps = [
        a_gap(rng, 3e-6) if rng.random() < (0.1 if tall else 0.5) else 0.0 for _ in range(count)
    ]
    x = Heap(
        sheets, bodies, float(rng.uniform(0.3, 0.45)), float(rng.uniform(0.1, 1.2)),
        tuple(0.0 if single and g < FLOAT32 else g for g in gaps),
        tuple(int(rng.integers(50, 65) if many else 2 ** rng.uniform(0, 4))
              for _ in range(count + 1)),
        (float(rng.uniform(0, 2 * math.pi)), float(rng.uniform(0.6, 1.5))),
        tuple(rng.random(3)) if rng.random() < 0.7 else None, single,
    )  # fmt: skip
    lifted = LIFTED / 10 if tall else LIFTED
    other = replace(x, gaps=(lifted,) * count, cells=(1,) * (count + 1), turn=None, single=False)
    return Question(str(x), x.scene(), other.scene(), 1e-3, None, 0.05, ends=False)
