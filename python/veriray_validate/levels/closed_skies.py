"""Images of skies against quadrature in float64 and closed forms."""

from __future__ import annotations

import itertools
import math
from typing import Any

import numpy as np
import numpy.typing as npt

from veriray_validate.dicts import (
    BLACK,
    NULL,
    Dict,
    diffuse,
    flat,
    masked,
    medium,
    rgb,
    scene,
    sphere,
    view,
)
from veriray_validate.form_factors import gauss
from veriray_validate.trial import Trial, case

Array = npt.NDArray[Any]
COLOUR = np.array([1.0, 2.0, 0.5])


def image(texels: Array, turn: Any = None, **more: Any) -> Dict:
    """An image around the scene; turn (3, 3). Its light samples are of all of it."""
    place = np.eye(4)
    place[:3, :3] = np.eye(3) if turn is None else turn
    sky = {"type": "envmap", "bitmap": texels.astype(np.float32), "to_world": place}
    return {**sky, "mis_compensation": False, **more}


def irradiance(texels: Array, normal: Any) -> Array:
    """Irradiance (3,) of an image, in its own frame: Gauss's rule in parts of its cells.

    The parts are 0.3 degrees wide or less, so that the horizon costs 1e-6.
    """
    height, width, _ = texels.shape
    n = np.asarray(normal, np.float64)
    x, w = gauss(3)
    down, along = -(-600 // (height - 1)), -(-1200 // width)
    y = ((np.arange((height - 1) * down)[:, None] + x) / down).ravel()
    wy = np.tile(w, (height - 1) * down) / down * math.pi / (height - 1)
    i = ((np.arange(width * along)[:, None] + x) / along).ravel()
    wi = np.tile(w, width * along) / along * 2 * math.pi / width
    row, column = y.astype(int), i.astype(int)
    t, s = (y - row)[:, None, None], i - column
    rows = texels[row] * (1 - t) + texels[row + 1] * t
    polar, azimuth = y * math.pi / (height - 1), (i + 0.5) * 2 * math.pi / width
    level = n[0] * np.sin(azimuth) - n[2] * np.cos(azimuth)
    weights = np.zeros((2, len(i), width))  # of the columns, by places between them
    weights[0, np.arange(len(i)), column] = wi * (1 - s)
    weights[1, np.arange(len(i)), (column + 1) % width] = wi * s
    across, total = weights.sum(axis=0), np.zeros(3)
    for part in np.array_split(np.arange(len(polar)), 16):
        sine, height_ = np.sin(polar[part])[:, None], np.cos(polar[part])[:, None]
        cosine = np.maximum(sine * level + height_ * n[1], 0)
        seen = cosine @ across * (sine * wy[part, None])
        total += np.einsum("vu,vuc->c", seen, rows[part])
    return total


def one(*at: tuple[int, int], size: tuple[int, int] = (9, 16)) -> Array:
    """A black image but for the texels (row, column)."""
    texels = np.zeros((*size, 3))
    for row, column in at:
        texels[row, column] = COLOUR
    return texels


def lifted(size: tuple[int, int], seed: int) -> Array:
    """Random texels."""
    return np.random.default_rng(seed).uniform(0.1, 1, (*size, 3)).astype(np.float32)


_HEIGHTS = np.cos(np.linspace(0, math.pi, 1025))
IMAGES = {
    "linear": np.repeat((1 + _HEIGHTS)[:, None, None] * COLOUR, 4, axis=1),
    "first column": one((4, 0)), "last column": one((4, 15)), "upper pole": one((0, 0)),
    "pole at the seam": one((0, 15)), "beside the pole": one((1, 7)), "lower pole": one((8, 3)),
    "three rows": lifted((3, 5), 1), "one column": lifted((5, 1), 2), "noise": lifted((13, 24), 3),
    "sun": lifted((9, 16), 4) + 1e4 * one((2, 15)),
}  # fmt: skip
NORMALS = {"up": (0, 1, 0), "down": (0, -1, 0), "to the seam": (0.28, 0, -0.96),
           "aslant": (-0.48, 0.6, 0.64)}  # fmt: skip


def plate(normal: Any, sky: Dict, *more: Dict, half: float = 1.0, **settings: Any) -> Any:
    """A point of a plate of albedo .5 alone under a sky, seen from in front."""
    n = np.asarray(normal, np.float64)
    aside = np.cross(n, [0.6, 0.0, 0.8])
    eye = view(n + 0.3 * aside, [0, 0, 0])
    return scene(eye, flat("rectangle", [0, 0, 0], n, half, diffuse(0.5)), sky, *more, **settings)


@case(3, once=True)
def quadrature_agrees(t: Trial) -> None:
    """The quadrature against pi (1 + 2/3 cos) under a sky of 1 + cos, cos from the pole.

    The image is linear between 1,025 rows, which costs 2e-6.
    """
    for normal in NORMALS.values():
        exact = math.pi * (1 + 2 / 3 * normal[1]) * COLOUR
        t.check(np.abs(irradiance(IMAGES["linear"], normal) / exact - 1) < 4e-6)


@case(3, each={"name": IMAGES, "normal": NORMALS}, quick=lambda name, normal: normal != "down")
def image_over_a_plate(t: Trial, name: str, normal: str) -> None:
    """A plate under an image: rho E / pi, with E by quadrature.

    Single texels at the seam and at the poles, images with few rows or columns, a sun beside the
    seam. From below the horizon of all light, exactly 0.
    """
    texels, n = IMAGES[name], NORMALS[normal]
    exact = 0.5 / math.pi * irradiance(texels, n)
    seen = plate(n, image(texels), max_depth=2)
    t.agrees(seen, exact, 400_000, sees=0.03 if exact.max() > 1e-3 else 0.3)


TURNS = [
    np.array(m)
    for signs in itertools.product((1, -1), repeat=3)
    for m in ([[signs[0], 0, 0], [0, signs[1], 0], [0, 0, signs[2]]],
              [[0, signs[0], 0], [0, 0, signs[1]], [signs[2], 0, 0]])
]  # fmt: skip


@case(3, each={"number": range(len(TURNS))}, quick=lambda number: number % 5 == 0)
def quarter_turns(t: Trial, number: int) -> None:
    """Quarter turns and reflections of an image, as its plate turned the other way."""
    turn, texels, n = TURNS[number], IMAGES["noise"], np.array(NORMALS["aslant"])
    exact = 0.5 / math.pi * irradiance(texels, turn.T @ n)
    t.agrees(plate(n, image(texels, turn), max_depth=2), exact, 400_000, sees=0.01)


@case(3)
def even_image(t: Trial) -> None:
    """An image of one colour is a constant sky: exactly where it is seen, and in a furnace.

    A ball of albedo .8 has the radiance .8 L all over.
    """
    sky = image(np.broadcast_to(COLOUR, (7, 12, 3)), scale=0.75)
    out = scene(view([0, 0, 0], [0.3, 0.2, -1], 120, 16), sky)
    t.check(t.render(out, 4).image == 0.75 * COLOUR, "seen")
    ball = sphere([0, 0, 0], 1, diffuse(0.8))
    seen = scene(view([0, 2, 3], [0, 0, 0], 15, 4), ball, sky)
    t.agrees(seen, 0.8 * 0.75 * COLOUR, 40_000, sees=0.01)


@case(3)
def texels_are_seen(t: Trial) -> None:
    """A camera that looks at a texel sees it, and half of two between them.

    Within 1e-3 of the differences of neighbours, by which a pixel of .01 degrees shifts.
    """
    texels = IMAGES["noise"]
    rows, columns, _ = texels.shape
    for row, column in ((1, 0), (4, 7), (6, 23), (11, 12)):
        for shift in (0.0, 0.5):
            polar = math.pi * row / (rows - 1)
            azimuth = 2 * math.pi * (column + 0.5 + shift) / columns
            d = [math.sin(polar) * math.sin(azimuth), math.cos(polar),
                 -math.sin(polar) * math.cos(azimuth)]  # fmt: skip
            seen = t.render(scene(view([0, 0, 0], d), image(texels)), 64).image[0, 0]
            beside = texels[row, (column + 1) % columns]
            exact = texels[row, column] * (1 - shift) + beside * shift
            t.check(np.abs(seen - exact) < 1e-3, f"texel {row}, {column}: {seen} for {exact}")


@case(3)
def sun_beside_an_image(t: Trial) -> None:
    """Parallel light beside an image: each is chosen for some samples, and they add up."""
    n = np.array(NORMALS["aslant"])
    sun = {"type": "directional", "direction": -n, "irradiance": rgb([3, 1, 2])}
    light = irradiance(IMAGES["noise"], n) + np.array([3, 1, 2])
    t.agrees(plate(n, image(IMAGES["noise"]), sun, max_depth=2), 0.5 / math.pi * light, 800_000,
             sees=0.01)  # fmt: skip


@case(3)
def image_through_a_medium(t: Trial) -> None:
    """A small disk in the middle of a ball that absorbs: exp(-sigma r) of the light arrives."""
    fog = medium([0.5, 1, 0.2], 0.0)
    ball = {**sphere([0, 0, 0], 1, NULL), "interior": fog}
    disk = flat("disk", [0, 0, 0], [0, 1, 0], 1e-3, diffuse(0.5))
    eye = view([0.06, 0.08, 0], [0, 0, 0], medium=fog)
    exact = 0.5 / math.pi * irradiance(IMAGES["noise"], [0, 1, 0])
    exact = exact * np.exp(-1.1 * np.array([0.5, 1, 0.2]))
    t.agrees(scene(eye, ball, disk, image(IMAGES["noise"])), exact, 800_000, sees=0.01)


@case(3)
def image_through_a_mask(t: Trial) -> None:
    """A black sheet with holes over a plate lets the open share of the light through."""
    sheet = flat("rectangle", [0, 0.01, 0], [0, 1, 0], 20, masked(0.3, BLACK))
    floor = flat("rectangle", [0, 0, 0], [0, 1, 0], 1, diffuse(0.5))
    eye = view([0.01, 0.005, 0], [0, 0, 0])
    exact = 0.7 * 0.5 / math.pi * irradiance(IMAGES["noise"], [0, 1, 0])
    t.agrees(scene(eye, floor, sheet, image(IMAGES["noise"]), max_depth=2), exact, 800_000,
             sees=0.01)  # fmt: skip
