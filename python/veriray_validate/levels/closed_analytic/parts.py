"""Lamps, floors and places that the closed forms share."""

from __future__ import annotations

import numpy as np

from veriray_validate.scenes import Part, camera, quad

DOWN = camera([0.6, 0.8, 0.7], [0, 0, 0])
UP = [0, 0, 1]


def ceiling(x0: float, x1: float, y0: float, y1: float, z: float = 1.0) -> list[list[float]]:
    """Corners of a rectangle at height z."""
    return [[x0, y0, z], [x1, y0, z], [x1, y1, z], [x0, y1, z]]


def lamp(x0: float, x1: float, y0: float, y1: float, emission: float, z: float = 1.0) -> Part:
    """A rectangle at height z that shines down and reflects nothing."""
    return quad([x0, y0, z], [0, y1 - y0, 0], [x1 - x0, 0, 0], 0.0, emission)


def floor(reflectance: float = 0.5, two_sided: bool = False) -> Part:
    """A square of side 10 around the origin."""
    return quad([-5, -5, 0], [10, 0, 0], [0, 10, 0], reflectance, 0, two_sided)


def single(value: float) -> float:
    """The number as the renderer holds it, in single precision."""
    return float(np.float32(value))
