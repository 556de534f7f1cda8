"""`veriray info` warns of details too fine for float32, and only of these."""

from __future__ import annotations

import json
import math
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import veriray as vr
from veriray import info, limits
from veriray.cli import main

FLOOR = {"type": "rectangle"}


def at(*place: float, size: float = 1.0, turn: float = 0.0) -> list[list[float]]:
    c, s = size * math.cos(turn), size * math.sin(turn)
    x, y, z = place
    return [[c, -s, 0, x], [s, c, 0, y], [0, 0, size, z], [0, 0, 0, 1]]


def found(
    fov: float = 40.0, size: int = 16, eye: float = 5.0, lens: float = 0.0, **shapes: Any
) -> list[str]:
    """The warnings of a scene seen from (0, 0, eye)."""
    to_world = vr.Camera.look_at((0, 0, eye), (0, 0, 0)).to_world
    film = {"type": "hdrfilm", "width": size, "height": size}
    sensor = {"type": "perspective", "fov": fov, "to_world": to_world, "film": film}
    if lens:
        sensor |= {"type": "thinlens", "aperture_radius": lens, "focus_distance": eye}
    scene = {"type": "scene", "sensor": sensor, "sky": {"type": "constant"}, **shapes}
    result: list[str] = info.examine(vr.load_dict(scene), "cpu")["warnings"]
    return result


def ball(sigma_t: float, albedo: float = 0.5, **more: Any) -> dict[str, Any]:
    fog = {"type": "homogeneous", "sigma_t": sigma_t, "albedo": albedo}
    return {"type": "sphere", "bsdf": {"type": "null"}, "interior": fog, **more}


def wall(*place: float, **more: Any) -> dict[str, Any]:
    return {"type": "rectangle", "to_world": at(*place, **more)}


def lamp(*place: float) -> dict[str, Any]:
    return {"type": "point", "position": list(place)}


MANY = {
    f"s{k}": wall(k % 40, k // 40, -9, size=0.4) for k in range(1200)
}  # the camera is the origin
CASES: dict[str, tuple[dict[str, Any], dict[str, Any], str]] = {
    "view": ({"fov": 1e-5}, {"fov": 2e-4}, "a pixel is 1.1e-08 rad wide"),
    "view of many pixels": ({"fov": 0.01, "size": 4096}, {"fov": 0.1, "size": 4096}, "4.3e-08 rad"),
    "view of a lens": ({"fov": 1e-4, "lens": 0.1}, {"fov": 2e-3, "lens": 0.1}, "1.1e-07 rad wide"),
    "medium": (
        {"fog": ball(1e6), **MANY},
        {"fog": ball(2e3), **MANY},
        "sigma_t[0] (scene.fog.interior) reaches 2.6e+07 free paths",
    ),
    "depth": ({"fog": ball(1e4, 1.0)}, {"fog": ball(4e3, 1.0)}, "optical depth of 2e+04"),
    "grey depth": ({"fog": ball(1e4, 0.99999)}, {"fog": ball(1e4, 0.99)}, "optical depth"),
    "ball": (
        {"s": {"type": "sphere", "radius": 1e-6}, **MANY},
        {"s": {"type": "sphere", "radius": 1e-5}, **MANY},
        "spheres[0] (scene.s): smaller than 1e-06",
    ),
    "triangles": (
        {"s": wall(0, 0, 0, size=1e-6), **MANY},
        {"s": wall(0, 0, 0, size=1e-5), **MANY},
        "and 1 more: smaller",
    ),
    "disk": (
        {"s": {"type": "disk", "to_world": at(0, 0, 0, size=1e-6)}, **MANY},
        {"s": {"type": "disk", "to_world": at(0, 0, 0, size=1e-5)}, **MANY},
        "disks[0] (scene.s): smaller",
    ),
    "walls": (
        {"a": wall(0, 0, 0), "b": wall(0, 0, 2e-6)},
        {"a": wall(0, 0, 0), "b": wall(0, 0, 2e-5)},
        "triangles[0] (scene.a) and triangles[2] (scene.b) is 4e-07",
    ),
    "walls of other forms": (
        {"a": wall(0, 0, 0), "b": wall(0.3, 0, 2e-6, size=0.1, turn=0.7)},
        {"a": wall(0, 0, 0), "b": wall(3, 0, 2e-6, size=0.1, turn=0.7)},
        "change places",
    ),
    "lamp over a wall": (
        {"a": FLOOR, "l": lamp(0.1, 0.2, 1e-6), **MANY},
        {"a": FLOOR, "l": lamp(0.1, 0.2, 1e-4), **MANY},
        "light_position[0] (scene.l) is nearer to triangles[",
    ),
    "lamp at a sphere": (
        {"a": {"type": "sphere"}, "l": lamp(0, 0, 1 + 1e-6), **MANY},
        {"a": {"type": "sphere"}, "l": lamp(0, 0, 1 + 1e-4), **MANY},
        "nearer to spheres[0]",
    ),
    "lamp at a disk": (
        {"a": {"type": "disk", "to_world": at(-3, 0, 0)}, "l": lamp(-3.5, 0, 1e-6), **MANY},
        {"a": {"type": "disk", "to_world": at(-3, 0, 0)}, "l": lamp(-3.8, 0.8, 0), **MANY},
        "nearer to disks[0]",
    ),
}


@pytest.mark.parametrize("name", CASES)
def test_beyond_and_within(name: str) -> None:
    beyond, within, text = CASES[name]
    (warning,) = found(**beyond)
    assert text in warning and warning.isprintable()
    assert found(**within) == []


def test_flat_meshes_are_no_near_faces() -> None:
    """A rotated grid whose vertices are rounded to float32, and coincident walls."""
    n = 20
    x, y = np.meshgrid(np.arange(n + 1.0), np.arange(n + 1.0))
    plane = np.stack([x, y, 0.3 * x + 0.7 * y], axis=2).reshape(-1, 3).astype(np.float32) / 3
    first = (np.arange(n)[:, None] * (n + 1) + np.arange(n)).ravel()
    low, high = [first, first + 1, first + n + 2], [first, first + n + 2, first + n + 1]
    faces = np.concatenate([np.stack(low, 1), np.stack(high, 1)])
    box = vr.cornell_box()
    scene = vr.Scene(
        vertices=plane, triangles=faces, triangle_material=np.zeros(len(faces), int),
        triangle_emission=np.full(len(faces), -1), reflectance=[[0.5] * 3], two_sided=[True],
        emissions=np.zeros((0, 3)), environment=np.ones(3), camera=box.camera, film=box.film,
    )  # fmt: skip
    assert limits.near_faces(scene, np.array([0.1, 0.2, 30.0])) == []
    assert found(a=wall(0, 0, 0), b=wall(0, 0, 0)) == []


@pytest.mark.parametrize("name", ["cornell-box", "cornell-box-mitsuba", "open"])
def test_shipped_scenes_are_within(name: str) -> None:
    assert info.examine(vr.load_file(name), "cpu")["warnings"] == []


def test_the_command_warns(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    path = tmp_path / "s.xml"
    path.write_text(
        '<scene version="3.0.0"><sensor type="perspective"><float name="fov" value="1e-5"/>'
        '</sensor><shape type="sphere"/><emitter type="constant"/></scene>'
    )
    assert main(["info", str(path), "--device", "cpu"]) == 0
    assert "\nwarning     a pixel is 2.3e-10 rad wide" in capsys.readouterr().out
    assert main(["info", str(path), "--device", "cpu", "--json"]) == 0
    (warning,) = json.loads(capsys.readouterr().out)["warnings"]
    assert warning.startswith("a pixel is 2.3e-10 rad wide")
