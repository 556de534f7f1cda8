"""Textures of lamps, spots and projectors: what is read, what is refused, and what they change."""

from __future__ import annotations

import dataclasses
import math
from typing import Any

import numpy as np
import pytest

import veriray
from veriray import SceneError, SceneWarning
from veriray.columns import LIGHT_KINDS

TEXELS = np.random.default_rng(6).uniform(0, 3, (4, 6, 3)).astype(np.float32)
BITMAP = {"type": "bitmap", "bitmap": TEXELS}
BOARD = {"type": "checkerboard", "color0": 0.5}
VIEW = {"type": "perspective", "film": {"type": "hdrfilm", "width": 8, "height": 8}}
TURN = np.array([[0.0, 0, 1, 5], [1, 0, 0, 6], [0, -1, 0, 7], [0, 0, 0, 1]])  # a reflection


def scene(**objects: Any) -> veriray.Scene:
    return veriray.load_dict({"type": "scene", "view": VIEW, **objects})


def lamp(radiance: Any = BITMAP, **more: Any) -> dict[str, Any]:
    return {"type": "rectangle", "emitter": {"type": "area", "radiance": radiance}, **more}


def projector(**values: Any) -> dict[str, Any]:
    return {"type": "projector", "irradiance": BITMAP, "fov": 40.0, **values}


def test_a_lamp_names_its_texture() -> None:
    found = scene(lamp=lamp(), other=lamp({"type": "rgb", "value": [1.0, 2, 3]}))
    assert found.emission_texture.tolist() == [0, -1]
    assert found.emissions.tolist() == [[1, 1, 1], [1, 2, 3]]
    assert found.uv[:4].tolist() == [[0, 0], [1, 0], [1, 1], [0, 1]]
    bright = found.with_emission_scaled(4)
    assert bright.emissions.tolist() == [[4, 4, 4], [4, 8, 12]]
    assert (bright.emission_texture == found.emission_texture).all()
    assert veriray.render(found, 1, device="cpu").stats["features"]


def test_a_mesh_without_coordinates_gets_mitsubas() -> None:
    mesh = {"type": "mesh", "vertices": np.eye(3), "faces": np.array([[0, 1, 2]])}
    found = scene(mesh={**mesh, "emitter": {"type": "area", "radiance": BITMAP}})
    assert found.uv.any()


def test_the_hash_is_of_texture_and_place() -> None:
    shapes = [scene(lamp=lamp()), scene(lamp=lamp(BOARD)), scene(lamp=lamp(1.0)),
              scene(p=projector()), scene(p=projector(fov=41.0)), scene(p=projector(scale=2.0)),
              scene(p=projector(to_world=TURN)),
              scene(s={"type": "spot"}), scene(s={"type": "spot", "texture": BITMAP})]  # fmt: skip
    assert len({found.sha256 for found in shapes}) == len(shapes)


def test_the_arrays_of_a_projector() -> None:
    found = scene(p=projector(to_world=TURN, scale=2.0))
    half = math.tan(math.radians(20))
    assert found.light_kind.tolist() == [LIGHT_KINDS.index("projector")]
    assert np.allclose(found.light_intensity, 2 * math.pi, rtol=1e-7)
    assert found.light_position.tolist() == [[5, 6, 7]]
    assert found.light_direction.tolist() == [[1, 0, 0]]
    a, b = found.light_image[0]
    assert np.allclose(a, [0, -0.5 / half, 0], rtol=1e-15)
    assert np.allclose(b, [0, 0, 0.5 / (half * 4 / 6)], rtol=1e-15)
    row, doubled = (
        scene(p=projector(irradiance={"type": "bitmap", "bitmap": rows})).light_image
        for rows in (TEXELS[:1], TEXELS[[0, 0]])
    )
    assert (row == doubled).all()  # as Mitsuba's images, whose sides are 2 at least
    plain = scene(p=projector(irradiance={"type": "rgb", "value": [1.0, 2, 3]}))
    assert plain.light_texture.tolist() == [-1]
    assert np.allclose(plain.light_intensity[0], [math.pi, 2 * math.pi, 3 * math.pi], rtol=1e-7)
    assert np.allclose(np.abs(plain.light_image[0]).max(axis=1), 0.5 / half)


@pytest.mark.parametrize(
    ("part", "message"),
    [
        (lamp({**BITMAP, "bitmap": -TEXELS}), "outside"),
        (projector(focal_length="50mm"), "both fov and focal_length"),
        (projector(to_world=np.diag([2.0, 1, 1, 1])), "to_world"),
        (projector(fov=180.0), "fov"),
        ({"type": "spot", "texture": 0.5}, "belongs to intensity"),
        ({"type": "spot", "texture": BITMAP, "cutoff_angle": 90.0}, "less than 90"),
        ({"type": "spot", "intensity": BITMAP}, "not supported on spot.intensity"),
        ({"type": "constant", "radiance": BITMAP}, "not supported on constant.radiance"),
    ],
)
def test_what_is_refused(part: dict[str, Any], message: str) -> None:
    with pytest.raises(SceneError, match=message):
        scene(part=part)


def test_texels_above_1_are_for_lights_alone() -> None:
    matt = {"type": "diffuse", "reflectance": BITMAP}
    with pytest.warns(SceneWarning, match="numbers above 1"):
        both = scene(wall={"type": "rectangle", "bsdf": matt}, lamp=lamp())
    texels = both.texels.view(np.float32)
    used = both.reflectance_texture.max(), both.emission_texture.max()
    first = [int(both.texture_first[row]) for row in used]
    most = [texels[k : k + texels.size // 2].max() for k in first]
    assert most[0] == 1 < most[1]
    arrays = scene(lamp=lamp())
    with pytest.raises(SceneError, match="outside \\[0, 1\\]"):
        dataclasses.replace(arrays, reflectance_texture=[0])


def test_black_textures_are_sound() -> None:
    black = {"type": "bitmap", "bitmap": np.zeros((2, 2, 3), np.float32)}
    for part in (lamp(black), projector(irradiance=black), {"type": "spot", "texture": black}):
        found = scene(part=part, floor={"type": "rectangle", "to_world": TURN})
        assert not veriray.render(found, 2, device="cpu").image.any()
