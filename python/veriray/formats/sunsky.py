"""The image of a `sunsky`: a clear sky with the sun, as the scene's arrays hold images of skies."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import numpy.typing as npt

from ..chunks import in_chunks
from ..errors import SceneError
from ..numeric import sin_cos_degrees
from . import sky_model
from .node import Node
from .report import Report
from .skies import rotation

Array = npt.NDArray[Any]

#: Where and when, with Mitsuba's defaults.
TIME = {
    "latitude": 35.6894, "longitude": 139.6917, "timezone": 9.0, "year": 2010, "month": 7,
    "day": 10, "hour": 15.0, "minute": 0.0, "second": 0.0,
}  # fmt: skip
#: Columns of the image, without and with a sun that is narrower than 2 degrees; half as many rows
#: and the one at the horizon.
WIDTH, FINE = 1024, 2048
_ROWS = 16  # that a thread makes at a time
_PARTS = 16  # of a texel's sides, to find what the sun covers of it
#: From axes of the image, y up, to those of the sky, z up.
UPRIGHT = np.array([[1.0, 0.0, 0.0], [0.0, 0.0, -1.0], [0.0, 1.0, 0.0]])


def sunsky(node: Node, values: dict[str, Any], report: Report) -> dict[str, Any]:
    """The columns sky_* from the checked parameters of a sunsky; none of a black one.

    The sun is what texels it covers, in proportion; its light is that of its disc. Raises
    SceneError for a direction without length, beside a time, or for a to_world that scales.
    """
    turn = rotation(node, values)
    sun = _sun(node, values, turn)
    if not sun[2] > 0:
        report.warn(f"{node}: the sun is below the horizon: the sky is black", node.where)
        return {}
    turbidity, shines = values["turbidity"], values["sun_scale"] > 0
    width = FINE if shines and values["sun_aperture"] < 2 else WIDTH
    across = directions(width)
    half = len(across) // 2 + 1  # rows down to the horizon
    texels = np.zeros(across.shape)
    if values["sky_scale"] > 0:
        sky = sky_model.Sky(turbidity, values["albedo"], sun)

        def put(first: int, last: int) -> None:
            texels[first:last] = values["sky_scale"] * sky.radiance(across[first:last])

        in_chunks(put, half, _ROWS)
        texels[half - 1] /= 2  # of the row at the horizon, half is below
    if shines:
        light = values["sun_scale"] * sky_model.sun_radiance(turbidity, sun)
        radius = values["sun_aperture"] / 2
        texels[:half] += _covered(across, sun, radius)[:half, :, None] * light
    with np.errstate(over="ignore"):
        shown = texels.astype(np.float32).reshape(-1, 3)
    if not np.isfinite(shown).all():
        raise SceneError(f"{node}: its radiance exceeds the float32 range", node.where)
    if not shown.any():
        return {}
    return {
        "sky_texels": shown,
        "sky_size": np.array([width, len(across)]),
        "sky_to_world": turn @ UPRIGHT,
    }


def _sun(node: Node, values: dict[str, Any], turn: Array) -> Array:
    """The direction of the sun in the sky's axes, of length 1; sun_direction is of the world."""
    given = [name for name in TIME if values[name] is not None]
    direction = values["sun_direction"]
    if direction is None:
        when = {k: v if values[k] is None else values[k] for k, v in TIME.items()}
        found = sky_model.sun_direction(when, when["latitude"], when["longitude"])
        return found * np.array([1.0, -1.0, 1.0]) if values["y_is_east"] else found
    if given:
        raise SceneError(
            f"{node}: both sun_direction and {given[0]} given, expected one of them",
            node.values["sun_direction"].where,
        )
    x = np.array([float(v) for v in direction])
    most = float(np.abs(x).max())
    if not most > 0:
        raise SceneError(f"{node}: sun_direction has length 0", node.values["sun_direction"].where)
    x = x / most
    own = [math.fsum((turn[:, k] * x).tolist()) for k in range(3)]
    return np.array(own) / math.sqrt(math.fsum(v * v for v in own))


def _circle(steps: int, turns: float, shift: float = 0.0) -> Array:
    """Sines and cosines (2, steps) of equal parts of a turn, or of half of one with its end."""
    ends = steps if turns == 1 else steps - 1
    return np.array([sin_cos_degrees(360 * turns * (k + shift) / ends) for k in range(steps)]).T


def directions(width: int) -> Array:
    """Of the texels (H, W, 3), in the sky's axes."""
    (sine, up), (x, y) = _circle(width // 2 + 1, 0.5), _circle(width, 1, 0.5)
    flat = np.stack([sine[:, None] * x, sine[:, None] * y], axis=-1)
    return np.concatenate([flat, np.broadcast_to(up[:, None, None], (*flat.shape[:2], 1))], axis=-1)


def _covered(directions: Array, sun: Array, radius: float) -> Array:
    """What the sun's disc, `radius` degrees wide, covers of each texel (H, W).

    Scaled so that the image sends as much light as a sun of the usual size does, whatever the
    radius, by the exact integrals of the rows' bilinear weights.
    """
    height, width, _ = directions.shape
    step = math.pi / (height - 1)
    reach = 2 * sin_cos_degrees(radius / 2)[0]  # the disc by the distance from its centre
    near = 2 * sin_cos_degrees(min(radius / 2 + 180 / (height - 1), 90.0))[0]
    off = directions - sun
    seen = np.argwhere((off * off).sum(axis=-1) <= near * near)
    cover = np.zeros((height, width))
    rows, columns = seen.T
    tilts = _fine(rows, 0.0, 180 / (height - 1))
    turns = _fine(columns, 0.5, 360 / width)
    for a in range(_PARTS):
        for b in range(_PARTS):
            sine, up = tilts[0][:, a], tilts[1][:, a]
            x, y = sine * turns[0][:, b] - sun[0], sine * turns[1][:, b] - sun[1]
            cover[rows, columns] += x * x + y * y + (up - sun[2]) ** 2 <= reach * reach
    cover /= _PARTS**2
    flat = directions[:, 0, 0] * directions[:, 0, 0] + directions[:, 0, 1] * directions[:, 0, 1]
    beside, above = sin_cos_degrees(180 / (height - 1))
    weight = np.sqrt(flat) * (2 * (1 - above) / step)
    weight[[0, -1]] = 1 - beside / step
    light = math.fsum((cover.sum(axis=1) * weight).tolist()) * 2 * math.pi / width
    usual = 4 * math.pi * sin_cos_degrees(sky_model.APERTURE / 4)[0] ** 2
    return cover * (usual / light) if light > 0 else _point(cover, directions, sun, weight, usual)


def _fine(places: Array, shift: float, step: float) -> Array:
    """Sines and cosines (2, n, parts) of parts of intervals of `step` degrees around places."""
    kinds, which = np.unique(places, return_inverse=True)
    parts = (np.arange(_PARTS) + 0.5) / _PARTS - 0.5
    pairs = [[sin_cos_degrees(float((k + shift + p) * step)) for p in parts] for k in kinds]
    return np.moveaxis(np.array(pairs)[which], -1, 0)


def _point(cover: Array, directions: Array, sun: Array, weight: Array, usual: float) -> Array:
    """A sun too small to cover any part of a texel is in the nearest one."""
    off = directions - sun
    row, column = np.unravel_index(int(np.argmin((off * off).sum(axis=-1))), cover.shape)
    cover[row, column] = usual / (weight[row] * 2 * math.pi / cover.shape[1])
    return cover
