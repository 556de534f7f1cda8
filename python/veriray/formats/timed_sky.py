"""The image of a `timed_sunsky`: the mean over a sensor's shutter of clear skies with the sun.

As in Mitsuba, time 0 is the beginning of the first day's window, each day's window takes an equal
part of the times, and at time 1 the last day begins. A closed shutter sees one `sunsky`.
"""

from __future__ import annotations

import datetime
import math
from typing import Any

import numpy as np
import numpy.typing as npt

from ..errors import SceneError
from ..numeric import sin_cos_degrees
from . import sky_model
from .node import Node
from .report import Report
from .skies import rotation
from .sunsky import TIME, UPRIGHT, directions, sunsky

Array = npt.NDArray[Any]
#: Columns of a mean image; its skies, its suns, and points of each.
WIDTH, SKIES, SUNS, POINTS = 512, 64, 1024, 16
_GOLDEN = 222.49223594996213  # degrees


def timed_sunsky(
    node: Node, values: dict[str, Any], shutter: tuple[float, float], report: Report
) -> dict[str, Any]:
    """The columns sky_* from the checked parameters of a timed_sunsky; none of a black one.

    Raises SceneError for a day that there is not, an end before the start, or a shutter outside of
    [0, 1].
    """
    begin, end = (_day(node, values, name) for name in ("start", "end"))
    if end < begin:
        raise SceneError(f"{node}: it ends on {end}, before it starts on {begin}", node.where)
    if not 0 <= shutter[0] <= shutter[1] <= 1:
        text = f"the shutter is open from {shutter[0]:g} to {shutter[1]:g}, expected within [0, 1]"
        raise SceneError(f"{node}: {text}", node.where)

    def at(time: float) -> dict[str, Any]:
        """Where and when, in the terms of a sunsky."""
        days = time * max((end - begin).days, 1)
        day = begin + datetime.timedelta(math.floor(days))
        window = values["window_end_time"] - values["window_start_time"]
        place = {k: values[k] for k in ("latitude", "longitude", "timezone")}
        hour = values["window_start_time"] + (days - math.floor(days)) * window
        now = {"year": day.year, "month": day.month, "day": day.day, "hour": hour}
        return {**TIME, **{k: v for k, v in place.items() if v is not None}, **now}

    if shutter[0] == shutter[1]:
        alone = {"sun_direction": None, "y_is_east": False, "minute": None, "second": None}
        return sunsky(node, {**values, **alone, **at(shutter[0])}, report)

    def suns(count: int) -> list[Array]:
        """Directions of the sun at equal steps, those above the horizon."""
        width = shutter[1] - shutter[0]
        found = []
        for k in range(count):
            when = at(shutter[0] + width * (k + 0.5) / count)
            found.append(sky_model.sun_direction(when, when["latitude"], when["longitude"]))
        return [sun for sun in found if sun[2] > 0]

    turn, across = rotation(node, values), directions(WIDTH)
    half = len(across) // 2 + 1
    texels = np.zeros(across.shape)
    if values["sky_scale"] > 0:
        for sun in suns(SKIES):
            sky = sky_model.Sky(values["turbidity"], values["albedo"], sun)
            texels[:half] += values["sky_scale"] / SKIES * sky.radiance(across[:half])
        texels[half - 1] /= 2  # of the row at the horizon, half is below
    if values["sun_scale"] > 0:
        shown = suns(SUNS)
        radiances = [sky_model.sun_radiance(values["turbidity"], sun) for sun in shown]
        size = 4 * math.pi * sin_cos_degrees(sky_model.APERTURE / 4)[0] ** 2
        share = values["sun_scale"] * size / (SUNS * POINTS)
        _add(texels, shown, [share * x for x in radiances], values["sun_aperture"] / 2)
    image = texels.astype(np.float32).reshape(-1, 3)
    if not np.isfinite(image).all():
        raise SceneError(f"{node}: its radiance exceeds the float32 range", node.where)
    if not image.any():
        report.warn(f"{node}: the sun is below the horizon: the sky is black", node.where)
        return {}
    return {
        "sky_texels": image,
        "sky_size": np.array([WIDTH, len(across)]),
        "sky_to_world": turn @ UPRIGHT,
    }


def _day(node: Node, values: dict[str, Any], name: str) -> datetime.date:
    year, month, day = (values[f"{name}_{part}"] for part in ("year", "month", "day"))
    try:
        return datetime.date(year, month, day)
    except ValueError as error:
        text = f"the day {year}-{month}-{day} that it {name}s: {error}"
        raise SceneError(f"{node}: {text}", node.where) from None


def _add(texels: Array, suns: list[Array], lights: list[Array], radius: float) -> None:
    """Adds the light of suns, points over a disc of `radius` degrees each, to the nearest texels
    above the horizon, by the integrals of the rows' bilinear weights."""
    height, width, _ = texels.shape
    step = 180 / (height - 1)
    beside, above = sin_cos_degrees(step)
    sines = np.array([sin_cos_degrees(step * k)[0] for k in range(height)])
    weight = sines * (2 * (1 - above) / math.radians(step))
    weight[[0, -1]] = 1 - beside / math.radians(step)
    area = weight * (2 * math.pi / width)
    for sun, light in zip(suns, lights, strict=True):
        flat = math.hypot(sun[0], sun[1])
        side = np.array([-sun[1], sun[0], 0.0]) / flat if flat > 0 else np.array([1.0, 0.0, 0.0])
        up = np.cross(sun, side)
        for k in range(POINTS):
            sine, cosine = sin_cos_degrees(radius * math.sqrt((k + 0.5) / POINTS))
            y, x = sin_cos_degrees(_GOLDEN * k % 360)
            at = cosine * sun + sine * (x * side + y * up)
            place = math.degrees(math.acos(max(-1.0, min(1.0, round(float(at[2]), 9)))))
            row = min(round(place / step), height // 2)
            turn = math.atan2(round(float(at[0]), 9), round(float(at[1]), 9)) / (2 * math.pi)
            texels[row, math.floor(turn % 1 * width) % width] += light / area[row]
