"""Cameras that move and numbers that change, in scenes that keep their geometry on the device."""

from __future__ import annotations

import copy
from collections.abc import Sequence
from typing import Any

import numpy as np
import trimesh

import veriray
from veriray.camera import Camera
from veriray.scene import Scene
from veriray_validate.scenes import Part, make
from veriray_validate.trial import Trial, case


def crowd(middle: np.ndarray) -> Scene:
    """A thousand small bodies over a floor 400 times their size: 20,002 triangles."""
    rng = np.random.default_rng(5)
    body = trimesh.creation.icosphere(0)
    places = rng.uniform([-10, 0, -10], [10, 3, 10], (1000, 1, 3)) + middle
    vertices = (places + 0.1 * body.vertices).reshape(-1, 3)
    faces = (np.arange(1000)[:, None, None] * len(body.vertices) + body.faces).reshape(-1, 3)
    floor = np.array([[-40, -1, -40], [-40, -1, 40], [40, -1, 40], [40, -1, -40]]) + middle
    parts = [Part(vertices, faces, 0.5), Part(floor, [[0, 1, 2], [0, 2, 3]], 0.7)]
    return make(parts, Camera.look_at(middle + [0, 1, 4], middle, fov=40), 0.3, 16, 12)


@case(6)
def moved_cameras(t: Trial) -> None:
    """A scene that has been rendered shows the same bits as one made anew.

    40 cameras among the bodies, around them and far away, each with another reflectance of the
    floor and another environment; 3e5 sizes from the world's origin.
    """
    middle = t.rng.uniform(-1, 1, 3) * 3e5
    scene = crowd(middle)
    for k in range(40):
        away = 10.0 ** t.rng.uniform(-1, 2.5)
        way = t.rng.normal(size=3)
        start = middle + way / np.linalg.norm(way) * away * [1, 0.2, 1]
        moved = scene.with_(camera=Camera.look_at(start, middle, fov=t.rng.uniform(5, 90)))
        if k % 2:
            moved = moved._with_arrays(
                reflectance=t.rng.uniform(0.1, 0.9, (2, 3)), environment=t.rng.uniform(0.1, 9, 3)
            )
        films = {
            veriray.render(each, 2, k, t.device, threads=t.threads).film_sha256
            for each in (moved, copy.copy(moved))  # the copy keeps nothing on the device
        }
        t.check(len(films) == 1, f"camera {k}, {away:g} away")


@case(8)
def details_near_a_camera(t: Trial) -> None:
    """A ball of 1e-3 to 1e-1 in a scene of size 80 looks as it does alone.

    The camera is four radii away. Rounding is less than 2^-8 pixel there (cpp/README.md), so of
    65,536 samples in a row of 512 pixels 1 may differ on average at the two edges, and 9 with a
    probability below 1e-6.
    """
    rng, crowded = t.rng, crowd(np.zeros(3))
    ball = trimesh.creation.icosphere(4)
    spp, others = 128, Part(crowded.vertices, crowded.triangles, 0.5)
    for _ in range(4):
        radius = 10.0 ** rng.uniform(-3, -1)
        middle, seed = rng.uniform([-30, 5, -30], [30, 9, 30]), t.fresh()

        def lit(places: Sequence[Part], at: Any, seed: int = seed, radius: float = radius) -> Any:
            lamp = Part(at + radius * ball.vertices, ball.faces, 0.0, 1.0)
            view = Camera.look_at(at + [0, 0, 4 * radius], at, fov=40)
            scene = make([*places, lamp], view, 0.0, 512, 1)
            done = veriray.render(scene, spp, seed, t.device, max_depth=1, threads=t.threads)
            return np.rint(spp * done.image[..., 0].astype(np.float64))

        among, alone = lit([others], middle), lit([], np.zeros(3))
        t.check(alone.sum() > 100 * spp, "no ball")
        differ = float(np.abs(among - alone).sum())
        t.check(differ <= 9, f"radius {radius:g} at {middle}: {differ:g} samples")
