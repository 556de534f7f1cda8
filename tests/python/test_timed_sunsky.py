"""The mean of skies over a shutter, against skies at single times."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

import veriray
from veriray import SceneError

DAY = {"start_year": 2020, "start_month": 6, "start_day": 1, "end_year": 2020, "end_month": 6,
       "end_day": 11, "window_start_time": 8.0, "window_end_time": 18.0}  # fmt: skip


def sky(plugin: str, shutter: tuple[float, float] = (0.0, 0.0), **given: Any) -> Any:
    return veriray.load_dict({
        "type": "scene", "ball": {"type": "sphere"}, "light": {"type": plugin, **given},
        "view": {"type": "perspective", "fov": 40.0, "shutter_open": shutter[0],
                 "shutter_close": shutter[1]},
    })  # fmt: skip


def test_a_shutter_has_no_effect_but_with_this_sky() -> None:
    assert not any("shutter" in note for note in sky("timed_sunsky", (0.0, 1.0), **DAY).notes)
    assert sum("shutter" in note for note in sky("sunsky", (0.0, 1.0)).notes) == 2
    named = {"type": "scene", "light": {"type": "timed_sunsky", **DAY},
             "view": {"type": "perspective", "fov": 40.0, "shutter_close": 0.5}}  # fmt: skip
    veriray.load_dict(named, strict=True)


def vector(scene: Any) -> np.ndarray:
    """The integrals of radiance times direction and of radiance alone (4, 3), in the image's axes,
    by the bilinear weights of rows."""
    width, height = (int(n) for n in scene.sky_size)
    texels = scene.sky_texels.reshape(height, width, 3).astype(np.float64)
    polar = np.pi * np.arange(height) / (height - 1)
    step = np.pi / (height - 1)
    weight = np.sin(polar) * 2 * (1 - np.cos(step)) / step * 2 * np.pi / width
    turn = 2 * np.pi * (np.arange(width) + 0.5) / width
    axes = np.stack([
        np.sin(polar)[:, None] * np.cos(turn), np.sin(polar)[:, None] * np.sin(turn),
        np.broadcast_to(np.cos(polar)[:, None], (height, width)), np.ones((height, width)),
    ])  # fmt: skip
    found: np.ndarray = np.einsum("ahw,h,hwc->ac", axes, weight, texels)
    return found


def at(hour: float, day: int = 1, **given: Any) -> Any:
    return sky("sunsky", year=2020, month=6, day=day, hour=hour, **given)


@pytest.mark.parametrize(("time", "hour", "day"), [(0.0, 8.0, 1), (0.05, 13.0, 1), (0.5, 8.0, 6)])
def test_a_closed_shutter_sees_one_sky(time: float, hour: float, day: int) -> None:
    assert sky("timed_sunsky", (time, time), **DAY).sha256 == at(hour, day).sha256


@pytest.mark.parametrize("given", [{}, {"sky_scale": 0.0, "turbidity": 6.0}])
def test_the_mean_of_a_day(given: dict[str, Any]) -> None:
    """Light by direction and in all is the mean of skies at 16 hours: to 0.3 % of all light."""
    found = vector(sky("timed_sunsky", (0.0, 0.1), **DAY, **given))
    hours = 8 + 10 * (np.arange(16) + 0.5) / 16
    told = np.mean([vector(at(hour, **given)) for hour in hours], axis=0)
    assert (np.abs(found - told) < 3e-3 * told[3]).all()
    assert (told[3] > 0).all()


def test_hours_below_the_horizon_are_dark() -> None:
    whole = {**DAY, "window_start_time": 0.0, "window_end_time": 24.0}
    day, night = (vector(sky("timed_sunsky", s, **whole)) for s in ((0.0, 0.1), (0.03, 0.07)))
    assert (0.3 * night[3] < day[3]).all() and (day[3] < night[3]).all()
    with pytest.warns(veriray.SceneWarning, match="the sun is below the horizon"):
        assert not sky("timed_sunsky", (0.0, 0.01), **whole).sky_size.any()


@pytest.mark.parametrize(
    ("given", "shutter", "text"),
    [
        ({"end_year": 2019}, (0, 0), "it ends on 2019-06-11, before it starts on 2020-06-01"),
        ({"start_day": 31}, (0, 0), "the day 2020-6-31 that it starts"),
        ({}, (0.5, 1.5), "the shutter is open from 0.5 to 1.5, expected within [0, 1]"),
        ({"hour": 3.0}, (0, 0), 'unknown parameter "hour"'),
    ],
)
def test_refused(given: dict[str, Any], shutter: tuple[float, float], text: str) -> None:
    with pytest.raises(SceneError) as error:
        sky("timed_sunsky", shutter, **{**DAY, **given})
    assert text in str(error.value) and "scene.light" in str(error.value)
