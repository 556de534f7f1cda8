"""Cameras that move and numbers that change, in scenes that keep their geometry on the device."""

from __future__ import annotations

import copy
import pickle
from collections.abc import Sequence
from typing import Any

import numpy as np
import trimesh

import veriray
from veriray.camera import Camera
from veriray.scene import Scene
from veriray_validate import dicts
from veriray_validate.dicts import Dict
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


def _colour(rng: np.random.Generator) -> Dict:
    return dicts.rgb(rng.uniform(0, 1, 3))


def _materials(rng: np.random.Generator) -> Dict:
    """Three that are referred to by their ids."""
    rough = {"alpha": float(rng.uniform(0.02, 0.5)), "distribution": "ggx"}
    kinds: list[Dict] = [
        {"type": "diffuse", "reflectance": _colour(rng)},
        {"type": "roughconductor", "material": "none", **rough},
        {"type": "roughconductor", "material": "Au", **rough, "energy_compensation": True},
        {"type": "roughdielectric", **rough},
        {"type": "roughplastic", "diffuse_reflectance": _colour(rng), **rough},
        {"type": "plastic", "diffuse_reflectance": _colour(rng)},
        {"type": "principled", "base_color": _colour(rng), "roughness": 0.5, "spec_trans": 0.5},
        {"type": "thindielectric"},
        dicts.glass(1.5),
        dicts.masked(0.5, {"type": "diffuse"}),
        {
            "type": "blendbsdf",
            "weight": 0.5,
            "a": {"type": "diffuse"},
            "b": dicts.both(dicts.BLACK),
        },
    ]
    chosen = rng.choice(len(kinds), 3, replace=False)
    return {f"m{k}": {**kinds[i], "id": f"m{k}"} for k, i in enumerate(chosen)}


def windowed_room(cells: int) -> Dict:
    """A cube of half size 2 of 12 cells^2 faces, without those in the middle of a wall."""
    line = np.linspace(-2, 2, cells + 1)
    corners = np.stack(np.meshgrid(line, line, indexing="ij"), axis=-1)
    quads = np.stack(
        [corners[:-1, :-1], corners[1:, :-1], corners[1:, 1:], corners[:-1, 1:]], axis=2
    )
    quads = quads.reshape(-1, 4, 2)
    walls = [np.insert(quads, axis, side, axis=2) for axis in range(3) for side in (-2, 2)]
    walls[0] = walls[0][(np.abs(quads.mean(1)) > 0.8).any(1)]
    vertices = np.concatenate(walls).reshape(-1, 3)
    first = np.arange(0, len(vertices), 4)[:, None]
    faces = np.concatenate([first + [0, 1, 2], first + [0, 2, 3]])
    return {"type": "mesh", "vertices": vertices, "faces": faces,
            "bsdf": dicts.both({"type": "diffuse"})}  # fmt: skip


def drawn(rng: np.random.Generator) -> Scene:
    """More than 1,024 faces of drawn materials, media and lights, on a floor or in a room."""
    ball = trimesh.creation.icosphere(3)
    scene: Dict = {"type": "scene", "how": {"type": "volpath"}, **_materials(rng)}
    for k, size in enumerate((0.6, 0.3)):
        body: Dict = {"type": "mesh", "vertices": size * ball.vertices + [0.9 * k, 0, 0.1 * k],
                      "faces": ball.faces, "bsdf": {"type": "ref", "id": f"m{k}"}}  # fmt: skip
        if rng.random() < 0.4:
            fog = dicts.medium(
                rng.uniform(0, 5, 3), rng.uniform(0, 1, 3), float(rng.choice([0, 0.5]))
            )
            body["interior"] = fog
        scene[f"body{k}"] = body
    floor = dicts.flat("rectangle", [0, -0.6, 0], [0, 1, 0], 3, {"type": "ref", "id": "m2"})
    scene["around"] = windowed_room(12) if rng.random() < 0.4 else floor
    scene["lamp"] = dicts.sphere([0, 1.5, 0], 0.1, dicts.BLACK, rng.uniform(0, 5, 3))
    delta = {"type": "rgb", "value": [4.0, 3.0, 2.0]}
    lights: Dict = {
        "sky": dicts.sky(1.0),
        "sun": {"type": "directional", "direction": [0.1, -0.2, -1], "irradiance": delta},
        "point": {"type": "point", "position": [-1.0, 1.0, 1.0], "intensity": delta},
    }
    scene |= {name: lights[name] for name in lights if rng.random() < 0.6}
    eye = dicts.look([0, 0.5, 1.9], [0, 0, 0])
    scene["eye"] = {"type": "perspective", "fov": 50.0, "to_world": eye,
                    "film": dicts.box_film(8, 8)}  # fmt: skip
    return veriray.load_dict(scene)


#: By the last part of a parameter's name, the range of its new values; (0, 1) of others.
RANGES = {"radiance": (0, 8), "intensity": (0, 8), "irradiance": (0, 8), "sigma_t": (0, 20),
          "eta": (1.01, 2), "alpha": (1e-4, 1), "k": (0, 5), "g": (-0.8, 0.8),
          "position": (-2, 2)}  # fmt: skip


def new_value(rng: np.random.Generator, name: str, old: Any) -> Any:
    """A number, or one for each number of `old`: often an end of the range, or next to it."""
    low, high = RANGES.get(name.rpartition(".")[2], (0, 1))
    shape = np.shape(old)
    kind = rng.random()
    if kind < 0.4:
        value = np.full(shape, rng.choice([low, high, low + 1e-4 * (high - low)]))
    else:
        value = rng.uniform(low, high, shape if kind < 0.8 else ()) + np.zeros(shape)
    return value.tolist()


@case(6, each={"scenes": (3, 30)}, quick=lambda scenes: scenes == 3)
def changed_numbers(t: Trial, scenes: int) -> None:
    """Drawn scenes, changed seven times by name, or seen from elsewhere: the bits of fresh ones.

    Colours, roughness, indices, shares, media, lights and skies, to the ends of their ranges; films
    and their resolution are compared.
    """
    settings: dict[str, Any] = {"device": t.device, "threads": t.threads}
    for _ in range(scenes):
        scene = drawn(t.rng)
        for step in range(8):
            known = scene.parameters()
            names = [str(n) for n in t.rng.choice(list(known), 3 if step else 0, replace=False)]
            scene = scene.with_({name: new_value(t.rng, name, known[name]) for name in names})
            if t.rng.random() < 0.3:
                scene = scene.with_(camera=scene.camera.orbit(float(t.rng.uniform(0, 360))))
            states, seed = [], t.fresh()
            for each in (scene, copy.copy(scene)):
                work = veriray.Accumulation(each, spp=4, seed=seed, **settings)
                work.add(4)
                states.append(pickle.dumps(work.checkpoint().film))
            t.check(states[0] == states[1], f"step {step}: {', '.join(names)}")


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
