"""From texture objects to rows of a scene's texture table, and their texels."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

from ..columns import TEXTURE_FILTERS, TEXTURE_FORMATS, TEXTURE_KINDS, TEXTURE_WRAPS
from ..errors import SceneError
from . import images, materials
from .node import Node, Ref, Value, shorten
from .plugins import PLUGINS, texturable

Array = npt.NDArray[Any]
_SOURCES = ("filename", "data", "bitmap")


def check_place(node: Node, child: Node, item: Node | Ref) -> None:
    """Raises SceneError if a texture may not stand where it does: `item` of `node`."""
    param = PLUGINS[node.plugin].params.get(item.name)
    if param is None or not param.texturable:
        name = f"{node.plugin}.{shorten(item.name)[1:-1] or '?'}"
        raise SceneError(
            f"texture {child.plugin} is supported on {', '.join(texturable())}, not on {name}",
            item.where,
        )


def exchanged(node: Node) -> Node:
    """A checkerboard where one number is wanted, for which Mitsuba 3.9.1 exchanges its colours."""
    values = dict(node.values)
    first, second = (
        values.pop(name, Value("float", PLUGINS[node.plugin].params[name].default, node.where))
        for name in ("color0", "color1")
    )
    return replace(node, values={**values, "color0": second, "color1": first})


class Texels:
    """The texels of the textures that are used, each image once."""

    def __init__(self) -> None:
        self.words: list[Array] = []
        self.count = 0
        self.known: dict[tuple[str, bool], materials.Row] = {}
        self.too_bright: dict[int, tuple[str, str]] = {}  # by first word: a texel above 1, place
        self.rows: dict[int, materials.Row] = {}

    def array(self) -> Array | None:
        """The column `texels`; None without any."""
        return np.concatenate(self.words) if self.words else None

    def row(self, node: Node, values: dict[str, Any], *, light: bool = False) -> materials.Row:
        """The row of a texture, made once; values: its checked parameters. light: of a light, whose
        texels may exceed 1."""
        found = self.rows.get(id(node))  # the caller keeps the node, and so its id
        if found is None:
            matrix = np.eye(4) if values["to_uv"] is None else values["to_uv"]
            found = {
                "texture_kind": TEXTURE_KINDS.index(node.plugin),
                "texture_to_uv": matrix[:2][:, [0, 1, 3]].tolist(),
                **materials.filled(node, values),
            }
            if node.plugin == "bitmap":
                found |= self._bitmap(node, values)
            self.rows[id(node)] = found
        if not light and found.get("texture_first") in self.too_bright:
            text, where = self.too_bright[found["texture_first"]]
            raise SceneError(f"{node}: {text}, outside [0, 1]", where)
        return found

    def _bitmap(self, node: Node, values: dict[str, Any]) -> materials.Row:
        given = [name for name in _SOURCES if values[name] is not None]
        if len(given) != 1:
            raise SceneError(
                f"{node}: {' and '.join(given) or 'no image'} given; expected one of "
                f"{', '.join(_SOURCES)}",
                node.where,
            )
        where, raw = node.values[given[0]].where, values["raw"]
        path = Path(node.folder) / values["filename"] if given[0] == "filename" else None
        stored = self.known.get((str(path), raw)) if path is not None else None
        if stored is None:
            if path is None:
                image = images.from_array(values[given[0]], where, raw=raw or given[0] == "data")
            else:
                image = images.read(path, where, raw=raw)
            stored = self._store(image)
            if (text := _beyond(node, image.texels, where)) is not None:
                self.too_bright[stored["texture_first"]] = text, where
            if path is not None:
                self.known[str(path), raw] = stored
        return {
            **stored,
            "texture_wrap": TEXTURE_WRAPS.index(values["wrap_mode"]),
            "texture_filter": TEXTURE_FILTERS.index(values["filter_type"]),
        }

    def _store(self, image: images.Image) -> materials.Row:
        height, width, channels = image.texels.shape
        first, words = self.count, packed(image.texels)
        self.words.append(words)
        self.count += len(words)
        name = {"u1": "srgb8" if image.encoded else "linear8", "f2": "half", "f4": "float"}
        return {
            "texture_format": TEXTURE_FORMATS.index(name[image.texels.dtype.str[1:]]),
            "texture_width": width,
            "texture_height": height,
            "texture_grey": channels == 1,
            "texture_first": first,
        }


def packed(texels: Array) -> Array:
    """Texels (H, W, 1 or 3) uint8, float16 or float32 as uint32 words: see `texels` of a scene."""
    height, width, channels = texels.shape
    flat = texels.reshape(height * width, channels)
    if channels == 3 and texels.itemsize < 4:
        flat = np.concatenate([flat, np.zeros((len(flat), 1), texels.dtype)], axis=1)
    data = np.ascontiguousarray(flat, texels.dtype.newbyteorder("<")).tobytes()
    return np.frombuffer(data + b"\0" * (-len(data) % 4), "<u4").astype(np.uint32)


def _beyond(node: Node, texels: Array, where: str) -> str | None:
    """The first number above 1; raises SceneError for one below 0."""
    if texels.dtype == np.uint8:
        return None

    def first(bad: Array) -> str:
        y, x, c = (int(i) for i in np.argwhere(bad)[0])
        return f"the texel (x {x}, y {y}) holds {texels[y, x, c]:g}"

    if float(texels.min()) < 0:
        raise SceneError(f"{node}: {first(texels < 0)}, outside [0, inf)", where)
    return first(texels > 1) if float(texels.max()) > 1 else None
