"""Polygons of mesh files that are not convex, as lamps."""

from __future__ import annotations

import math
import tempfile
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

from veriray_validate.dicts import BLACK, diffuse, flat, scene, shape, view
from veriray_validate.form_factors import lambert
from veriray_validate.trial import Trial, case

Array = npt.NDArray[Any]


def arrow(rng: np.random.Generator) -> Array:
    """A quadrangle with a corner that points inwards."""
    x, tip, notch = rng.uniform(0.4, 1.2), rng.uniform(0.5, 1.2), rng.uniform(-0.5, 0.3)
    return np.array([[-x, -0.6], [0.0, notch], [x, -0.6], [0.1, tip]])


def chains(rng: np.random.Generator) -> Array:
    """A saw blade of 6 to 12 corners: one chain of corners above a line, one below it."""
    counts = rng.integers(2, 6, 2)
    lower, upper = (np.sort(rng.uniform(-0.9, 0.9, count)) for count in counts)
    below = np.stack([lower, -rng.uniform(0.05, 1.0, len(lower))], axis=1)
    above = np.stack([upper[::-1], rng.uniform(0.05, 1.0, len(upper))], axis=1)
    return np.concatenate([[[-1.0, 0.0]], below, [[1.0, 0.0]], above])


def around(count: int, radii: Any) -> Array:
    """Corners (count, 2) at equal angles around the origin."""
    turn = 2 * math.pi * np.arange(count) / count
    corners: Array = np.broadcast_to(radii, count)[:, None] * np.c_[np.cos(turn), np.sin(turn)]
    return corners


def ring(rng: np.random.Generator) -> Array:
    """A polygon with a hole, a star, to which a bridge leads there and back."""
    outside = around(int(rng.integers(3, 8)), 1.2)
    inside = around(count := int(rng.integers(3, 8)), rng.uniform(0.15, 0.6, count))[::-1]

    def left(a: Array, b: Array, c: Array) -> Any:
        return (b - a)[..., 0] * (c - a)[..., 1] - (b - a)[..., 1] * (c - a)[..., 0]

    while True:  # a corner of the star that is seen from a corner of the polygon
        outside = np.roll(outside, int(rng.integers(len(outside))), axis=0)
        inside = np.roll(inside, int(rng.integers(count)), axis=0)
        a, b = inside[1:-1], inside[2:]  # the edges that do not end there
        apart = left(a, b, outside[0]) * left(a, b, inside[0]) > 0
        if (apart | (left(outside[0], inside[0], a) * left(outside[0], inside[0], b) > 0)).all():
            return np.concatenate([outside, outside[:1], inside, inside[:1]])


FORMS: dict[str, Callable[[np.random.Generator], Array]] = {
    "arrow": arrow, "chains": chains, "ring": ring,
}  # fmt: skip


def written(path: Path, corners: Array) -> None:
    """A file with one polygon."""
    numbers = [" ".join(map(repr, corner)) for corner in corners.tolist()]
    if path.suffix == ".obj":
        face = "f " + " ".join(str(k + 1) for k in range(len(corners)))
        path.write_text("\n".join([*(f"v {line}" for line in numbers), face, ""]))
        return
    head = ["ply", "format ascii 1.0", f"element vertex {len(corners)}"]
    head += [f"property float64 {axis}" for axis in "xyz"]
    head += ["element face 1", "property list uchar int vertex_indices", "end_header"]
    face = " ".join(map(str, [len(corners), *range(len(corners))]))
    path.write_text("\n".join([*head, *numbers, face, ""]))


@case(3, each={"form": FORMS})
def outlines_of_polygons(t: Trial, form: str) -> None:
    """A lamp that is one polygon of an OBJ or PLY file, over a plane: not convex, or with a hole.

    Lambert's sum over the edges of the outline, of which bridges to a hole take away their share;
    any corner may come first. Sees 5 %.
    """
    with tempfile.TemporaryDirectory() as folder:
        for _ in range(24):
            outline = FORMS[form](t.rng)
            outline = np.roll(outline, int(t.rng.integers(len(outline))), axis=0)
            tilt = t.rng.uniform(-0.3, 0.3, 2)
            corners = np.c_[outline, 1.5 + outline @ tilt]
            kind = "ply" if form == "arrow" and t.rng.random() < 0.5 else "obj"
            path = Path(folder) / f"lamp.{kind}"
            written(path, corners)
            lamp = shape(kind, BLACK, 1.0, filename=str(path), flip_normals=True)
            floor = flat("rectangle", [0, 0, 0], [0, 0, 1], 30, diffuse(0.5))
            exact = 0.5 * lambert([0, 0, 0], [0, 0, 1], corners)
            t.agrees(scene(view([-3, 0.2, 1], [0, 0, 0]), floor, lamp), exact, 200_000, sees=0.05)
