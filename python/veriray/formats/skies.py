"""The image of an `envmap`: texels, size and rotation, as the scene's arrays hold them."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np

from ..chunks import in_chunks
from ..errors import SceneError
from ..numeric import Fresh
from . import images
from .node import Node
from .report import Report


def envmap(node: Node, values: dict[str, Any], report: Report) -> dict[str, Any]:
    """The columns sky_* from the checked parameters of an envmap; none of a black image.

    Numbers below 0 of a file or a Bitmap count as 0, with a warning. Raises SceneError for a file
    or array that is no image of radiances, and for a to_world that does more than rotate and
    mirror, with which Mitsuba distorts the image.
    """
    if (values["filename"] is None) == (values["bitmap"] is None):
        both = "neither filename nor bitmap" if values["bitmap"] is None else "both"
        raise SceneError(f"{node}: {both} given, expected one of them", node.where)
    source = "bitmap" if values["filename"] is None else "filename"
    where = node.values[source].where
    if source == "bitmap":
        image = images.from_array(values["bitmap"], where, kept=False)
    else:
        image = images.read(Path(node.folder) / values["filename"], where)
    height, width, _ = image.texels.shape
    texels = np.empty((height, width, 3), np.float32)
    scale = np.float32(values["scale"])

    def fill(first: int, last: int) -> tuple[float, float, float]:
        part, out = (
            images.Image(image.texels[first:last], image.encoded).linear(),
            texels[first:last],
        )
        with np.errstate(over="ignore", invalid="ignore"):
            np.multiply(np.maximum(part, 0), scale, out=out)
            out += np.float32(0)  # no -0
        return float(part.min()), float(out.min()), float(out.max())

    given, lows, highs = np.array(in_chunks(fill, height, max(1, 2**14 // width))).T
    if given.min() < 0:
        plain = image.linear()
        y, x, c = (int(i) for i in np.unravel_index(int(np.argmin(plain)), plain.shape))
        told = f"{node}: texel (x {x}, y {y}) is {plain[y, x, c]:g}; radiance is not negative"
        if isinstance(values["bitmap"], np.ndarray):
            raise SceneError(told, where)
        report.warn(f"{told}: 0 is rendered for it, and for all below 0", where)
    extremes = float(lows.min()), float(highs.max())
    if not np.isfinite(extremes).all():
        raise SceneError(f"{node}: scale = {values['scale']:g} exceeds the float32 range", where)
    if extremes == (0.0, 0.0):
        return {}
    sky = Fresh(texels.reshape(-1, 3), extremes)
    return {
        "sky_texels": sky,
        "sky_size": np.array([width, height]),
        "sky_to_world": rotation(node, values),
        "sky_compensated": np.array([values["mis_compensation"]]),
    }


def rotation(node: Node, values: dict[str, Any]) -> Any:
    """The rotation or reflection (3, 3) of a sky's to_world."""
    matrix = np.eye(4) if values["to_world"] is None else values["to_world"]
    turn = matrix[:3, :3]
    off = float(np.abs(turn.T @ turn - np.eye(3)).max())
    if not off <= 1e-3:
        raise SceneError(
            f"{node}: to_world scales or shears (by {off:.3g}); its image may only be "
            "rotated, mirrored, moved and scaled evenly",
            node.values["to_world"].where,
        )
    return turn
