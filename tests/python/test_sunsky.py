"""A sunsky: values of Mitsuba (tests/references/record_sunsky.py), their image and light."""

from __future__ import annotations

import json
import warnings
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import veriray
from veriray import SceneError, SceneWarning
from veriray.formats import sky_model

RECORD = json.loads((Path(__file__).parents[1] / "references" / "sunsky.json").read_text("utf-8"))
NOON = {"sun_direction": [0.0, 0.6, 0.8]}


def made(*, size: int = 8, **given: Any) -> Any:
    """A rectangle of albedo 0.5 that faces +z, seen from above, under a sunsky."""
    look = veriray.transform.look_at((0.0, 0.0, 3.0), (0.0, 0.0, 0.0), (0.0, 1.0, 0.0))
    return veriray.load_dict({
        "type": "scene", "sky": {"type": "sunsky", **given},
        "camera": {"type": "perspective", "fov": 20.0, "to_world": look,
                   "film": {"type": "hdrfilm", "width": size, "height": size,
                            "filter": {"type": "box"}}},
        "ground": {"type": "rectangle", "bsdf": {"type": "diffuse", "reflectance": 0.5}},
    })  # fmt: skip


def texels(scene: Any) -> tuple[Any, Any, Any]:
    """An image's texels (H, W, 3), their directions in the world and bilinear solid angles (H,)."""
    width, height = scene.sky_size
    image = np.asarray(scene.sky_texels, np.float64).reshape(height, width, 3)
    tilt = np.pi * np.arange(height)[:, None] / (height - 1)
    turn = 2 * np.pi * (np.arange(width) + 0.5) / width
    local = np.stack([np.sin(tilt) * np.sin(turn), np.cos(tilt) + 0 * turn,
                      -np.sin(tilt) * np.cos(turn)], axis=-1)  # fmt: skip
    step, fine = np.pi / (height - 1), (np.arange(512) + 0.5) / 512
    edges = tilt + step * np.concatenate([fine - 1, fine])
    weights = np.where((edges >= 0) & (edges <= np.pi), np.sin(edges), 0)
    share = (weights * np.concatenate([fine, 1 - fine])).mean(axis=1) * 2 * step
    return image, local @ scene.sky_to_world.T, share * 2 * np.pi / width


def test_albedo_of_the_ground_is_a_reflectance() -> None:
    """Its spectra are converted as those of surfaces, not as light."""
    for value, albedo in ((0.5, 0.5), ([(300, 0.25), (900, 0.25)], 0.25)):
        one, other = (made(albedo=a) for a in ({"type": "spectrum", "value": value}, albedo))
        assert np.allclose(one.sky_texels, other.sky_texels, rtol=1e-3)


def test_the_sky_is_that_of_mitsuba() -> None:
    """Within 2e-5 at 20 directions of five skies."""
    directions = np.array(RECORD["directions"])
    for row in RECORD["skies"]:
        sun = np.array(row["sun_direction"])
        sky = sky_model.Sky(row["turbidity"], (row["albedo"],) * 3, sun)
        assert np.abs(sky.radiance(directions) / np.array(row["sky"]) - 1).max() < 2e-5


def test_the_sun_is_nearly_that_of_mitsuba() -> None:
    """Within 2e-3: its mean over the disc is exact here."""
    for row in RECORD["skies"]:
        found = sky_model.sun_radiance(row["turbidity"], np.array(row["sun_direction"]))
        assert np.abs(found / np.array(row["sun"]) - 1).max() < 2e-3


def test_the_sun_stands_where_mitsuba_has_it() -> None:
    """Within 4e-4 radians, which is what float32 does to Mitsuba's days since 2000."""
    base = {"year": 2010, "month": 7, "day": 10, "hour": 15.0, "minute": 0.0, "second": 0.0,
            "timezone": 9.0, "latitude": 35.6894, "longitude": 139.6917}  # fmt: skip
    for row in RECORD["times"]:
        when = {**base, **row["given"]}
        found = sky_model.sun_direction(when, when["latitude"], when["longitude"])
        assert np.abs(found - row["sun"]).max() < 4e-4
        assert abs(np.linalg.norm(found) - 1) < 1e-8


def test_own_functions() -> None:
    x = np.linspace(-600, 600, 10001)
    assert np.abs(sky_model.exp(x) / np.exp(x) - 1).max() < 1e-15
    chord = np.linspace(0, 2, 10001)
    assert np.abs(sky_model.angle(chord) - 2 * np.arcsin(chord / 2)).max() < 1e-14


@pytest.mark.parametrize(
    ("sun", "aperture"),
    [
        ([0.0, 0.0, 1.0], 1e-3),
        ([0.0, 0.0, 1.0], 0.5358),
        ([0.5, -0.6, 0.7], 1e-3),
        ([0.5, -0.6, 0.7], 0.1),
        ([0.5, -0.6, 0.7], 0.5358),
        ([1.0, 0.2, 0.4], 20.0),
    ],
)
def test_the_suns_light_does_not_depend_on_its_size(sun: list[float], aperture: float) -> None:
    """The image's bilinear integral is the disc's radiance times its solid angle, within 1e-5."""
    image, directions, share = texels(made(sun_direction=sun, sky_scale=0.0, sun_aperture=aperture))
    found = (image * share[:, None, None]).sum(axis=(0, 1))
    unit = np.array(sun) / np.linalg.norm(sun)
    usual = 4 * np.pi * np.sin(np.radians(0.5358) / 4) ** 2
    assert found == pytest.approx(sky_model.sun_radiance(3.0, unit) * usual, rel=5e-5)
    centre = (image.sum(axis=2) * share[:, None])[..., None] * directions
    mean = centre.sum(axis=(0, 1)) / np.linalg.norm(centre.sum(axis=(0, 1)))
    step = np.pi / (len(image) - 1)
    assert np.linalg.norm(mean - unit) < 0.75 * step


def test_the_ground_gets_the_skys_light() -> None:
    """Irradiance of the ground by a picture, against 400 x 400 midpoints of the model: 0.3 %.

    The picture's standard error is a tenth of that; the horizon's row adds 1e-3.
    """
    up = (np.arange(400) + 0.5) / 400
    turn = 2 * np.pi * up
    root = np.sqrt(1 - up * up)[:, None]
    net = np.stack([root * np.cos(turn), root * np.sin(turn), up[:, None] + 0 * turn], axis=-1)
    sky = sky_model.Sky(3.0, (0.3,) * 3, np.array(NOON["sun_direction"])).radiance(net)
    told = (sky * up[:, None, None]).mean(axis=(0, 1)) * 2 * np.pi * 0.5 / np.pi
    done = veriray.render(made(**NOON, sun_scale=0.0), spp=4096, device="cpu", seed=3)
    assert np.asarray(done.image).mean(axis=(0, 1)) == pytest.approx(told, rel=3e-3)


def test_it_is_turned_into_the_world() -> None:
    """sun_direction is of the world; to_world turns the zenith, and a time's sun with it."""
    turn = np.array([[1.0, 0, 0, 0], [0, 0, 1, 0], [0, -1, 0, 0], [0, 0, 0, 1]])  # up becomes +y
    for given, told in (
        ({"sun_direction": [0.0, 0.8, 0.6]}, np.array([0.0, 0.8, 0.6])),
        ({}, turn[:3, :3] @ np.array(RECORD["times"][0]["sun"])),
    ):
        image, directions, _ = texels(made(**given, to_world=turn))
        brightest = directions.reshape(-1, 3)[image.sum(axis=2).argmax()]
        assert np.linalg.norm(brightest - told) < 0.01
        assert not image[directions[..., 1] < -1e-6].any()  # the ground's side


@pytest.mark.parametrize("sun", [[0.3, -0.5, 0.6], [-0.7, 0.1, 0.3]])
def test_the_camera_sees_the_sun_where_it_stands(sun: list[float]) -> None:
    """The middle of its light in a view of 2 degrees, within a fifth of a texel."""
    look = veriray.transform.look_at((0.0, 0.0, 0.0), tuple(sun), (0.0, 0.0, 1.0))
    scene = veriray.load_dict({
        "type": "scene", "sky": {"type": "sunsky", "sun_direction": sun, "sky_scale": 0.0},
        "camera": {"type": "perspective", "fov": 2.0, "to_world": look,
                   "film": {"type": "hdrfilm", "width": 64, "height": 64,
                            "filter": {"type": "box"}}},
    })  # fmt: skip
    light = np.asarray(veriray.render(scene, spp=16, device="cpu").image).sum(axis=2)
    for axis in (0, 1):
        place = (light.sum(axis=axis) * (np.arange(64) - 31.5)).sum() / light.sum()
        assert abs(place) * 2 / 64 < 0.2 * 180 / 1024


def test_factors_and_colours() -> None:
    plain, double = (made(**NOON, sky_scale=k, sun_scale=k).sky_texels for k in (1.0, 2.0))
    assert (2 * plain == double).all()
    assert made(**NOON).sha256 == made(**NOON).sha256 != made(**NOON, turbidity=4.0).sha256
    red = made(**NOON, albedo={"type": "rgb", "value": [0.9, 0.3, 0.3]}, sun_scale=0.0)
    off = np.asarray(red.sky_texels) / np.maximum(made(**NOON, sun_scale=0.0).sky_texels, 1e-9)
    assert off[0, 0] > 1.01 and off[0, 1:] == pytest.approx(1)


def test_a_sun_below_the_horizon_is_dark() -> None:
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always")
        scene = made(hour=1.0)
    assert not len(scene.sky_texels)
    assert any(
        issubclass(w.category, SceneWarning) and "below the horizon" in str(w.message)
        for w in caught
    )


@pytest.mark.parametrize(
    ("given", "text"),
    [
        ({"turbidity": 11.0}, '"turbidity" = 11.0 is outside [1, 10]'),
        ({**NOON, "hour": 3.0}, "both sun_direction and hour given"),
        ({"sun_direction": [0.0, 0.0, 0.0]}, "sun_direction has length 0"),
        ({"sun_aperture": 0.0}, '"sun_aperture" = 0.0 is outside (0, 90)'),
        ({"to_world": np.diag([2.0, 1, 1, 1])}, "its image may only be rotated"),
        ({"sky_scale": 1e42}, "exceeds the float32 range"),
    ],
)
def test_refused(given: dict[str, Any], text: str) -> None:
    with pytest.raises(SceneError, match=".*") as error:
        made(**given)
    assert text in str(error.value)
