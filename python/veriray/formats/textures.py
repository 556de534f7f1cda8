"""From texture objects to rows of a scene's texture table, and their texels."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

from ..columns import MAX_NESTED, TEXTURE_FILTERS, TEXTURE_FORMATS, TEXTURE_KINDS, TEXTURE_WRAPS
from ..errors import SceneError
from . import images, materials, spectra
from .mesh import Mesh
from .node import Node, Ref, Value, shorten
from .plugins import PLUGINS, RELIEFS, VOLUME_FILTERS, texturable
from .report import Report

Array = npt.NDArray[Any]
_SOURCES = ("filename", "data", "bitmap")


def check_place(node: Node, child: Node, item: Node | Ref) -> None:
    """Raises SceneError if a texture may not stand where it does: `item` of `node`."""
    if node.plugin in RELIEFS and (node.plugin == "bumpmap" or item.name == "normalmap"):
        if child.plugin == "bitmap":
            return
        raise SceneError(f"{node} cannot hold a texture {child.plugin}, only a bitmap", item.where)
    param = PLUGINS[node.plugin].params.get(item.name)
    if param is None or not param.texturable:
        name = f"{node.plugin}.{shorten(item.name)[1:-1] or '?'}"
        own = [one for one in texturable() if one.startswith(f"{node.plugin}.")]
        own += ["normalmap.normalmap"] if node.plugin == "normalmap" else []
        raise SceneError(
            f"texture {child.plugin} is not supported on {name}, but on "
            f"{', '.join(own or texturable())}",
            item.where,
        )


def check_depth(node: Node, depth: int) -> None:
    """Raises SceneError for a texture in too many others, as one in itself is."""
    if depth > MAX_NESTED:
        raise SceneError(f"{node}: it is a texture in more than {MAX_NESTED} others", node.where)


def textures_in(node: Node, resolve: Callable[[Ref, Node], Node]) -> dict[str, Node]:
    """The textures that a texture holds, by parameter. Raises SceneError if one is given twice."""
    found: dict[str, Node] = {}
    for item in node.children:
        child = resolve(item, node) if isinstance(item, Ref) else item
        if child.category == "texture":
            if item.name in found or item.name in node.values:
                raise SceneError(f'{node}: "{item.name}" is given twice', item.where)
            found[item.name] = child
    return found


def in_order(node: Node) -> bool:
    """Whether a checkerboard's colours are in their order where one number is wanted, too."""
    return "in_order" in node.values and node.values["in_order"].value is True


def copied(
    node: Node, resolve: Callable[[Ref, Node], Node], exchange: bool = False, depth: int = 0
) -> Node:
    """A texture's node, and those in it, once more. exchange: with the colours of checkerboards
    exchanged, as Mitsuba 3.9.1, but not 0.x, has them where one number is wanted."""
    check_depth(node, depth)
    values, held = dict(node.values), textures_in(node, resolve)
    inside = {name: copied(child, resolve, exchange, depth + 1) for name, child in held.items()}
    if exchange and node.plugin == "checkerboard" and not in_order(node):
        names = "color0", "color1"
        params = PLUGINS[node.plugin].params
        for name in names:
            if name not in inside and name not in values:
                values[name] = Value("float", params[name].default, node.where)
        new = dict(zip(names, reversed(names), strict=True))
        values = {new.get(name, name): value for name, value in values.items()}
        inside = {new.get(name, name): child for name, child in inside.items()}
    rest = [item for item in node.children if item.name not in held]
    children = [*rest, *(replace(child, name=name) for name, child in inside.items())]
    return replace(node, values=values, children=children)


def even(colour: tuple[float, ...]) -> materials.Row:
    """The row of a texture of one colour: a checkerboard of equal fields."""
    fields = dict.fromkeys(("texture_color0", "texture_color1"), colour)
    return {"texture_kind": TEXTURE_KINDS.index("checkerboard"), **fields}


class Texels:
    """The texels of the textures that are used, each image once."""

    def __init__(self, report: Report) -> None:
        self.report = report
        self.words: list[Array] = []
        self.count = 0
        self.known: dict[tuple[Any, ...], materials.Row] = {}
        self.rows: dict[int, materials.Row] = {}

    def array(self) -> Array | None:
        """The column `texels`; None without any."""
        return np.concatenate(self.words) if self.words else None

    def row(
        self, node: Node, values: dict[str, Any], *, most: float = 1.0, inverse: bool = False
    ) -> materials.Row:
        """The row of a texture, made once; values: its checked parameters. most: the largest
        number that counts; where it is not 1, and where `inverse` is set (1 less the luminance of
        its texels), the node is one of its own."""
        found = self.rows.get(id(node))  # the caller keeps the node, and so its id
        if found is None:
            if node.plugin == "mesh_attribute" and inverse:
                raise SceneError(
                    f"{node} as the weight of a blend whose first bsdf is a blend: allowed are "
                    "bitmaps and checkerboards; or exchange the two bsdfs",
                    node.where,
                )
            if node.plugin == "mesh_attribute":
                found = _attribute(node, values, most)
            elif node.plugin == "volume" and "cells" in values:
                found = self._volume(node, values, most, inverse)
            elif node.plugin == "volume":
                check_most(node, values["value"], most, values["where"])
                found = even(values["value"])
            else:
                for name in node.values.keys() & {"color0", "color1"}:
                    check_most(node, values[name], most, node.values[name].where)
                matrix = np.eye(4) if values["to_uv"] is None else values["to_uv"]
                found = {
                    "texture_kind": TEXTURE_KINDS.index(node.plugin),
                    "texture_to_uv": matrix[:2][:, [0, 1, 3]].tolist(),
                    **materials.filled(node, values),
                }
            if node.plugin == "bitmap":
                found |= self._bitmap(node, values, most, inverse)
            self.rows[id(node)] = found
        return found

    def _bitmap(
        self, node: Node, values: dict[str, Any], most: float, inverse: bool
    ) -> materials.Row:
        given = [name for name in _SOURCES if values[name] is not None]
        if len(given) != 1:
            raise SceneError(
                f"{node}: {' and '.join(given) or 'no image'} given; expected one of "
                f"{', '.join(_SOURCES)}",
                node.where,
            )
        where, raw = node.values[given[0]].where, values["raw"]
        path = Path(node.folder) / values["filename"] if given[0] == "filename" else None
        channel, scale = values["channel"], np.array(values["scale"], np.float32)
        scale = scale[:1] if (scale == scale[0]).all() else scale  # one colour leaves grey texels
        gain = values["gain"]
        key = str(path), raw, most, inverse, channel, tuple(scale.tolist()), gain
        stored = self.known.get(key) if path is not None else None
        if stored is None:
            if path is None:
                image = images.from_array(values[given[0]], where, raw=raw or given[0] == "data")
            else:
                image = images.read(path, where, raw=raw, channel=channel)
            if (scale != 1).any():
                with np.errstate(over="ignore"):
                    image = images.Image(image.linear() * scale)
            name = shorten(str(path)) if path else "the image"
            texels = (_within if most < np.inf else _positive)(
                node, image.texels, name, where, self.report, most
            )
            made = images.Image(texels, image.encoded)
            if gain != 1:
                brighter = made.linear() * np.float32(gain)
                made = images.Image(np.minimum(brighter, np.float32(most)))
            stored = self._store(_inverse(made) if inverse else made)
            if path is not None:
                self.known[key] = stored
        return {
            **stored,
            "texture_wrap": TEXTURE_WRAPS.index(values["wrap_mode"]),
            "texture_filter": TEXTURE_FILTERS.index(values["filter_type"]),
        }

    def _volume(
        self, node: Node, values: dict[str, Any], most: float, inverse: bool
    ) -> materials.Row:
        """A grid in space: values of its gridvolume, with its cells and matrix."""
        depth, height, width, channels = values["cells"].shape
        texels = values["cells"].reshape(depth * height, width, channels)
        within = _within if most < np.inf else _positive
        image = images.Image(
            within(node, texels, "the grid", values["where"], self.report, most).astype(np.float32)
        )
        return {
            **self._store(_inverse(image) if inverse else image),
            "texture_kind": TEXTURE_KINDS.index("volume"),
            "texture_height": height,
            "texture_depth": depth,
            "texture_to_world": values["matrix"][:3].tolist(),
            "texture_wrap": TEXTURE_WRAPS.index(values["wrap_mode"]),
            "texture_filter": VOLUME_FILTERS.index(values["filter_type"]),
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


@dataclass(eq=False)
class Attribute:
    """What a texture reads from meshes. gain: a further factor, by which they do not exceed `most`.
    old: numbers of 0 to 255 are shares, of a PLY file sRGB; those that `scale` takes beyond `most`
    are clipped. most: what they may not exceed. single: where one number of it is wanted, "" if
    nowhere."""

    name: str
    scale: float
    gain: float = 1.0
    old: bool = False
    most: float = 1.0
    single: str = ""

    @property
    def key(self) -> tuple[str, float, float, bool]:
        """What its rows depend on besides the mesh."""
        return self.name, self.scale, self.gain, self.old

    def missing(self, node: Node, found: Mesh | None = None) -> str:
        """What to say of a shape without it; Mitsuba's variants for GPU and LLVM read 0, too."""
        other = ", ".join(map(shorten, found.attributes)) if found else ""
        return (
            f"{node}: its material or lamp reads {shorten(self.name)}, which the mesh has not; it "
            f"counts as 0. It has: {other or 'no attributes'}"
        )

    def clipped(self, node: Node, found: Mesh) -> str:
        """What to say of the mesh of a shape where numbers are clipped; "" if none are."""
        if not (self.old and self.scale > 1):
            return ""
        with np.errstate(all="ignore"):
            over = (_shares(found.attributes[self.name], node) * self.scale > self.most).any()
        text = f"{node}: texture scale: {shorten(self.name)} times {self.scale:g} exceeds "
        return f"{text}{self.most:g}, which is rendered there" if over else ""

    def of(self, node: Node, found: Mesh) -> Array:
        """Its rows (V or T, 3) float32 for the mesh of a shape.

        Raises SceneError if it holds other numbers than Mitsuba would read or than a texture may.
        """
        values = found.attributes[self.name]
        if self.single and values.shape[1] != 1:
            raise SceneError(
                f"{node}: {shorten(self.name)} has {values.shape[1]} numbers, expected one for "
                f"what stands at {self.single}",
                node.where,
            )
        with np.errstate(all="ignore"):
            shares = _shares(values, node) if self.old else values
            rows: Array = (shares * self.scale).astype(np.float32)
        if self.scale > 1 and self.old:  # a texture `scale` there
            rows = np.minimum(rows, np.float32(self.most))
        good = (rows <= self.most) & (rows < np.inf)
        bad = np.argwhere(~((rows >= 0) & good))
        if len(bad):
            row, column = (int(i) for i in bad[0])
            allowed = f"[0, {self.most:g}{']' if self.most < np.inf else ')'}"
            if self.most == 1:
                allowed += " (numbers of 0 to 255 take the scale 0.00392156862745098)"
            raise SceneError(
                f"{node}: {shorten(self.name)} holds {values[row, column]:g} in row {row}; times "
                f"scale = {self.scale:g} it must be in {allowed}",
                node.where,
            )
        if self.gain != 1:
            rows = np.minimum(rows * np.float32(self.gain), np.float32(self.most))
        return np.broadcast_to(rows, (len(rows), 3))


def _shares(values: Array, node: Node) -> Array:
    """Colours of version 0.x as linear shares: of 255 if one exceeds 1, and sRGB in a PLY file
    unless its shape, `node`, says no."""
    most = 255 if values.size and values.max() > 1 else 1
    if node.plugin != "ply" or ("srgb" in node.values and node.values["srgb"].value is False):
        return values / most
    codes = values.astype(np.uint8)
    if most == 255 and (codes == values).all():
        return images.SRGB_TO_LINEAR[codes]
    return spectra.decoded(np.maximum(values / most, 0))


def _attribute(node: Node, values: dict[str, Any], most: float) -> materials.Row:
    name = values["name"]
    if not name.startswith(("vertex_", "face_")):
        raise SceneError(
            f'{node}: "name" = {shorten(name)}; expected one that begins with vertex_ or face_',
            node.values["name"].where,
        )
    return {
        "texture_kind": TEXTURE_KINDS.index(f"{name.partition('_')[0]}_attribute"),
        "attribute": Attribute(name, values["scale"], values["gain"], values["bytes"], most),
    }


def packed(texels: Array) -> Array:
    """Texels (H, W, 1 or 3) uint8, float16 or float32 as uint32 words: see `texels` of a scene."""
    height, width, channels = texels.shape
    flat = texels.reshape(height * width, channels)
    if channels == 3 and texels.itemsize < 4:
        flat = np.concatenate([flat, np.zeros((len(flat), 1), texels.dtype)], axis=1)
    data = np.ascontiguousarray(flat, texels.dtype.newbyteorder("<")).tobytes()
    return np.frombuffer(data + b"\0" * (-len(data) % 4), "<u4").astype(np.uint32)


def check_most(node: Node, colour: tuple[float, ...], most: float, where: str) -> None:
    """Raises SceneError if a number of a colour exceeds what the texture may give."""
    if max(colour) > most:
        found = colour[0] if len({*colour}) == 1 else colour
        raise SceneError(f"{node}: {found} is outside [0, {most:g}]", where)


def _within(node: Node, texels: Array, name: str, where: str, report: Report, most: float) -> Array:
    """Texels within [0, most]; Mitsuba takes others as they are, and, of shares, light without end
    from them."""
    if texels.dtype == np.uint8 or not ((texels < 0) | (texels > most)).any():
        return texels
    largest, least = float(texels.max()), float(texels.min())
    share = most == 1
    told = f"{int((texels > most).sum())} numbers above {most:g}, up to {largest:g}"
    told += ": more than all light" if share else ""
    if least < 0:
        below = f"{int((texels < 0).sum())} below 0, down to {least:g}"
        below += ": negative light" if share else ""
        told = f"{told}; {below}" if largest > most else below
    report.warn(
        f"{node}: {name} holds {told}. The nearest of 0 and {most:g} is rendered: the picture is "
        "not Mitsuba's",
        where,
    )
    return texels.clip(0, most)


def _inverse(image: images.Image) -> images.Image:
    """1 less the luminance, in one float32 a texel."""
    texels = images.one_number(image.linear())
    return images.Image(np.clip(1 - texels, 0, 1).astype(np.float32))


def _positive(
    node: Node, texels: Array, name: str, where: str, report: Report, most: float
) -> Array:
    """Texels that may exceed 1."""
    if float(texels.min()) < 0:
        raise SceneError(f"{node}: {name} holds {float(texels.min()):g}, outside [0, inf)", where)
    return texels
