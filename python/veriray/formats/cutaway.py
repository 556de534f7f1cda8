"""What a material emits where it is not cut away.

A `mask` leaves lamps as they are, as in Mitsuba; in glTF and OBJ files alpha, or what stands for
it, is a share of all light that comes from a surface.
"""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

from . import images
from .node import Node, Value
from .report import Report

Array = npt.NDArray[Any]
Colour = tuple[float, float, float]
_PLACED = ("to_uv", "wrap_mode", "filter_type")


def emitted(radiance: Any, opacity: Any, where: str, report: Report) -> Any:
    """A radiance times an opacity: a colour or a bitmap's node, None if it is black everywhere.

    radiance: a colour or a bitmap; opacity: a number or a bitmap. Two bitmaps of other sizes or
    places are not multiplied, which `report` is told.
    """
    if not isinstance(opacity, Node):
        if not isinstance(radiance, Node):
            colour: Any = tuple(float(x) * float(opacity) for x in radiance)
            return colour if any(colour) else None
        if opacity == 1.0:
            return radiance
        return _bitmap(radiance, _texels(radiance) * np.float32(opacity)) if opacity else None
    shares = np.clip(images.one_number(_texels(opacity)), 0, 1)
    if not isinstance(radiance, Node):
        return _bitmap(opacity, shares * np.array(radiance)) if shares.any() else None
    texels = _texels(radiance)
    if texels.shape[:2] != shares.shape[:2] or _place(radiance) != _place(opacity):
        text = "what alpha cuts away still shines: its texture is of another size or place than "
        report.warn(f"{text}that of the emission", where)
        return radiance
    texels = texels * shares
    return _bitmap(radiance, texels) if texels.any() else None


def _texels(bitmap: Node) -> Array:
    """The texels (H, W, C) of a bitmap as it gives them."""
    raw = "raw" in bitmap.values and bool(bitmap.values["raw"].value)
    if "bitmap" in bitmap.values:
        given = bitmap.values["bitmap"]
        return images.from_array(given.value, given.where, raw=raw).linear()
    given = bitmap.values["filename"]
    return images.read(Path(given.value), given.where, raw=raw).linear()


def _place(bitmap: Node) -> list[Any]:
    values = (bitmap.values[name].value if name in bitmap.values else None for name in _PLACED)
    return [value.tolist() if isinstance(value, np.ndarray) else value for value in values]


def _bitmap(like: Node, texels: Array) -> Node:
    """A bitmap placed as another."""
    values = {name: like.values[name] for name in _PLACED if name in like.values}
    values["bitmap"] = Value("array", texels.astype(np.float32), like.where)
    return Node("bitmap", like.where, "texture", values=values)
