"""Rooms that see the sky through a window, whose light samples are guided by place.

Rooms, windows and skies are drawn with every seed; so are the turn and the size of all.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Any

import numpy as np
import numpy.typing as npt
from trimesh.transformations import random_rotation_matrix

import veriray
from veriray_validate import dicts
from veriray_validate.dicts import BLACK, Dict, diffuse, flat
from veriray_validate.everyday import Question, ask
from veriray_validate.form_factors import gauss
from veriray_validate.levels.closed_skies import image
from veriray_validate.trial import Trial, case

Array = npt.NDArray[Any]


class Room:
    """A box with a window in the wall x = half[0], in a frame of its own.

    half: its half sizes; window: centre (y, z) and half sizes; place (4, 4): to the world.
    """

    def __init__(self, rng: np.random.Generator) -> None:
        self.half = rng.uniform((1.2, 0.9, 1.2), (1.8, 1.3, 1.8))
        half = rng.uniform(0.3, 0.5, 2)
        self.window = np.array([*rng.uniform(-1, 1, 2) * (self.half[1:] - half - 0.1), *half])
        self.place = random_rotation_matrix(rng.random(3)) * 10 ** rng.uniform(-3, 3)
        self.place[3, 3] = 1
        self.place[:3, 3] = rng.uniform(-5, 5, 3) * np.cbrt(np.linalg.det(self.place[:3, :3]))

    def shapes(self, floor: Dict, walls: Dict) -> list[Dict]:
        """The room, its fronts inside."""
        w, h, e = self.half
        y, z, a, b = self.window
        low, high, left, right = (h + y - a) / 2, (h - y - a) / 2, (e + z - b) / 2, (e - z - b) / 2
        beside = [((y, -e + left), (a, left)), ((y, e - right), (a, right)),
                  ((-h + low, 0), (low, e)), ((h - high, 0), (high, e))]  # fmt: skip
        return self.placed(
            flat("rectangle", (0, -h, 0), (0, 1, 0), (w, e), floor),
            flat("rectangle", (0, h, 0), (0, -1, 0), (w, e), walls),
            flat("rectangle", (-w, 0, 0), (1, 0, 0), (h, e), walls),
            flat("rectangle", (0, 0, -e), (0, 0, 1), (w, h), walls),
            flat("rectangle", (0, 0, e), (0, 0, -1), (w, h), walls),
            *(flat("rectangle", (w, *at), (-1, 0, 0), half, walls) for at, half in beside),
        )

    def pane(self, bsdf: Dict, radiance: Any = None) -> Dict:
        """What fills the window, its front inside."""
        centre = (self.half[0], *self.window[:2])
        return self.placed(flat("rectangle", centre, (-1, 0, 0), self.window[2:], bsdf, radiance))[
            0
        ]

    def placed(self, *shapes: Dict) -> list[Dict]:
        """Shapes in the world."""
        return [{**s, "to_world": self.place @ s.get("to_world", np.eye(4))} for s in shapes]

    def eye(self, origin: Any, target: Any, fov: float, size: int) -> Dict:
        """A camera in the room."""
        a, b = (self.place[:3, :3] @ np.asarray(p) + self.place[:3, 3] for p in (origin, target))
        return dicts.view(a, b, fov, size)

    def daylight(self, texels: Array, turn: Array, p: Array, n: Array) -> Array:
        """Irradiance (3,) at p with the normal n, by 240 x 240 points of the window.

        turn (3, 3): from the room's directions to the image's. Gauss's rule in 80 x 80 parts: the
        kinks of the image cost 1e-5.
        """
        height, width, _ = texels.shape
        x, w = gauss(3)
        at = 2 * ((np.arange(80)[:, None] + x) / 80).ravel() - 1
        weight = np.tile(w, 80) / 80
        y, z, a, b = self.window
        d = np.stack(np.broadcast_arrays(self.half[0], y + a * at[:, None], z + b * at), -1) - p
        r = np.linalg.norm(d, axis=-1)
        form = np.maximum(d @ n, 0) * d[..., 0] * 4 * a * b / r**4
        i, j, k = np.moveaxis(d @ turn.T / r[..., None], -1, 0)
        row = np.arccos(np.clip(j, -1, 1)) * (height - 1) / math.pi
        column = np.mod(np.arctan2(i, -k) * width / (2 * math.pi) - 0.5, width)
        above = np.minimum(row.astype(int), height - 2)
        left = np.minimum(column.astype(int), width - 1)
        t, s = (row - above)[..., None], (column - left)[..., None]
        upper, lower = (texels[v, left] * (1 - s) + texels[v, (left + 1) % width] * s
                        for v in (above, above + 1))  # fmt: skip
        seen = upper * (1 - t) + lower * t
        return np.asarray(np.einsum("u,v,uv,uvc->c", weight, weight, form, seen))


def guided(t: Trial, draw: Callable[[], tuple[veriray.Scene, Any]]) -> tuple[veriray.Scene, Any]:
    """What draw() gives with a scene whose light samples are guided: one in 1,000 rooms is not."""
    for _ in range(4):
        drawn = draw()
        if "guided_sky" in t.render(drawn[0], 1).stats["features"]:
            return drawn
    t.check(False, "not guided")
    return drawn


#: Rows and columns of images.
SKIES = {"even": (9, 24), "noise": (17, 32), "fine noise": (60, 90), "sun": (33, 64)}


@case(3, each={"sky": SKIES})
def skies_through_windows(t: Trial, sky: str) -> None:
    """The floor of a black room, lit through a window: rho E / pi, with E by quadrature.

    Eight rooms and places, by light samples and by the directions that the floor draws. The sun has
    a fifth of the image's light, and is seen or not.
    """
    rows, columns = SKIES[sky]

    def draw() -> tuple[veriray.Scene, Any]:
        room, rng = Room(t.rng), t.rng
        texels = rng.uniform(0.2, 1, (rows, columns, 3))
        if sky == "even":
            texels[:] = [1.0, 2.0, 0.5]
        if sky == "sun":
            texels[rng.integers(8, 24), rng.integers(columns)] += 400
        texels = texels.astype(np.float32)
        turn = random_rotation_matrix(rng.random(3))[:3, :3]
        local = turn.T @ room.place[:3, :3] / np.cbrt(np.linalg.det(room.place[:3, :3]))
        w, h, e = room.half
        p = np.array([rng.uniform(-0.8, 0.6) * w, -h, rng.uniform(-0.8, 0.8) * e])
        eye = room.eye([-0.5, 0.3, 0.2], p, 1e-3, 1)
        lit = image(texels, turn)
        seen = dicts.scene(eye, *room.shapes(diffuse(0.5), BLACK), lit, max_depth=2)
        return seen, 0.5 / math.pi * room.daylight(texels, local, p, np.array([0.0, 1, 0]))

    for _ in range(8):
        t.agrees(*guided(t, draw), 4_000_000, sees=0.05, margin=3e-5)


INSIDE: dict[str, Dict] = {
    "diffuse": diffuse(0.7),
    "plastic": dicts.plastic(0.6, 1.5),
    "glass": dicts.glass(1.5),
    "rough metal": {"type": "roughconductor", "material": "none", "alpha": 0.3},
    "rough glass": {"type": "roughdielectric", "alpha": 0.3, "int_ior": 1.5, "ext_ior": 1.0},
    "mask": dicts.masked(0.5, dicts.both(diffuse(0.7))),
    "fog": dicts.NULL,
}


@case(3, each={"inside": INSIDE, "rooms": (2, 16)}, quick=lambda inside, rooms: rooms == 2)
def windows_as_lamps(t: Trial, inside: str, rooms: int) -> None:
    """A room under a sky of one colour: as with a black lamp of that radiance in the window.

    All depths; in the room a ball and a mesh of some material, or of fog. Margin 3e-4, for blocks
    3e-3; sees 2 % of a picture.
    """

    def draw() -> tuple[veriray.Scene, Question]:
        room, rng = Room(t.rng), t.rng
        w, h, e = room.half
        bsdf = INSIDE[inside]
        fog = {"interior": dicts.medium(3.0, 0.9)} if inside == "fog" else {}
        ball = np.eye(4) * 0.3
        ball[:3, 3] = rng.uniform((-0.3, -0.2, -0.6), (0.6, 0.4, 0.6)) * room.half
        ball[3, 3] = 1
        cube = random_rotation_matrix(rng.random(3))
        cube[:3, :3] *= 0.2
        cube[:3, 3] = rng.uniform(-0.5, 0.5) * w, -h + 0.4, rng.uniform(-0.5, 0.5) * e
        things = room.placed(
            {"type": "sphere", "bsdf": bsdf, "to_world": ball, **fog},
            {"type": "cube", "bsdf": bsdf, "to_world": cube, **fog},
        )
        shapes = [*room.shapes(diffuse(0.6), diffuse(0.5)), *things]
        up, aside = rng.uniform(0.5, 0.8, 2) * [h, e]
        eye = room.eye([-0.8 * w, 0.5 * up, aside], [0.6 * w, -0.5 * h, -0.3 * e], 50, 16)
        by_sky, by_lamp = (dicts.scene(eye, *shapes, light, max_depth=12)
                           for light in (dicts.sky(1), room.pane(BLACK, 1.0)))  # fmt: skip
        told = f"{inside}, window {np.round(room.window, 3).tolist()}, half {room.half.round(3)}"
        return by_sky, Question(told, by_sky, by_lamp, 3e-4, 3e-3, ends=False)

    for _ in range(rooms):
        ask(t, guided(t, draw)[1])
