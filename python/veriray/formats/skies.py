"""The image of an `envmap`: texels, size and rotation, as the scene's arrays hold them."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np

from ..errors import SceneError
from . import images
from .node import Node


def envmap(node: Node, values: dict[str, Any]) -> dict[str, Any]:
    """The columns sky_* from the checked parameters of an envmap; none of a black image.

    Raises SceneError for a file or array that is no image of radiances, and for a to_world that
    does more than rotate and mirror, with which Mitsuba distorts the image.
    """
    if (values["filename"] is None) == (values["bitmap"] is None):
        both = "neither filename nor bitmap" if values["bitmap"] is None else "both"
        raise SceneError(f"{node}: {both} given, expected one of them", node.where)
    given = "bitmap" if values["filename"] is None else "filename"
    where = node.values[given].where
    if given == "bitmap":
        image = images.from_array(values["bitmap"], where)
    else:
        image = images.read(Path(node.folder) / values["filename"], where)
    texels = image.linear()
    if float(texels.min()) < 0:
        y, x, c = (int(i) for i in np.unravel_index(int(np.argmin(texels)), texels.shape))
        raise SceneError(
            f"{node}: texel (x {x}, y {y}) is {texels[y, x, c]:g}; radiance is not negative", where
        )
    with np.errstate(over="ignore"):
        texels = texels * np.float32(values["scale"])
    if not np.isfinite(texels).all():
        raise SceneError(f"{node}: scale = {values['scale']:g} exceeds the float32 range", where)
    if not texels.any():
        return {}
    height, width, _ = texels.shape
    texels = np.broadcast_to(texels, (height, width, 3)).reshape(-1, 3)
    turn = rotation(node, values)
    return {"sky_texels": texels, "sky_size": np.array([width, height]), "sky_to_world": turn}


def rotation(node: Node, values: dict[str, Any]) -> Any:
    """The rotation or reflection (3, 3) of a sky's to_world."""
    matrix = np.eye(4) if values["to_world"] is None else values["to_world"]
    turn = matrix[:3, :3]
    off = float(np.abs(turn.T @ turn - np.eye(3)).max())
    if not off <= 1e-3:
        raise SceneError(
            f"{node}: to_world scales or shears (by {off:.3g}); its image may only be "
            "rotated, mirrored and moved",
            node.values["to_world"].where,
        )
    return turn
