"""Materials of glTF files as `principled`, with their textures of base colour, alpha, roughness and
metal.

What is not metal reflects 4 % from the front, or as KHR_materials_ior and KHR_materials_specular
say. KHR_materials_clearcoat and KHR_materials_sheen become the coat and the sheen of `principled`,
which are others: a coat of 1 is a quarter as strong. Transmission is that of a solid where
KHR_materials_volume gives it a thickness, else of a pane (`thindielectric`). A material without
transmission reflects on both sides. KHR_materials_unlit is diffuse, and so is a mesh without a
material, in white. A texture keeps its 8 bits unless a factor scales it; one that is the same
everywhere is a number or a colour. Alpha that is masked is cut at the texels, before they are
filtered; what is cut away does not shine. What else there is, is named.
"""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import numpy.typing as npt

from ..numeric import sin_cos_degrees
from . import cutaway, images
from .gltf_json import File, Json
from .node import Node, Value, shorten
from .report import Report

Array = npt.NDArray[Any]
_WRAPS = {10497: "repeat", 33648: "mirror", 33071: "clamp"}
_NEAREST = 9728
_BASE, _ROUGH = "baseColorTexture", "metallicRoughnessTexture"
#: Extensions that are used here, or where the material's light is made.
_KNOWN = tuple(
    f"KHR_materials_{name}"
    for name in ("ior", "specular", "clearcoat", "sheen", "transmission", "volume", "unlit",
                 "emissive_strength", "pbrSpecularGlossiness")
)  # fmt: skip


class Materials:
    """Makes the bsdf of a material; `sets`: the texture coordinates that each material uses."""

    def __init__(self, file: File, report: Report) -> None:
        self.file, self.report = file, report
        self.pixels: dict[int, Array] = {}
        self.nodes: dict[tuple[Any, ...], Node | float | tuple[float, ...]] = {}
        self.sets: dict[str, int] = {}  # by the material's place
        self.place = ""  # of the material in the making
        self.mirrored = False  # where it is
        self.opacities: dict[str, Any] = {}  # by the material's place
        self.bare: dict[str, Node] = {}  # without normals of textures, by the material's place

    def bsdf(self, about: Json, mirrored: bool = False) -> Node:
        """What a material reflects and lets through; of an empty one diffuse white. mirrored: where
        texture coordinates show images mirrored."""
        self.place, self.mirrored = about.where, mirrored
        if not about.content:
            return _twosided(_node("diffuse", about, reflectance=(1.0, 1.0, 1.0)))
        more = {name.removeprefix("KHR_materials_"): self.extension(about, name) for name in _KNOWN}
        rough = self.rough(about, more["pbrSpecularGlossiness"])
        self.unused(about, rough)
        colour = rough.numbers("baseColorFactor", (1.0,) * 4, 0.0, 1.0).tolist()[:3]
        base = self.taken(rough, _BASE, "rgb", tuple(colour))
        if more["unlit"] is not None:
            self.report.warn("an unlit material is shown as diffuse", about.where)
            result = _twosided(_node("diffuse", about, reflectance=base))
        else:
            if about.where not in self.bare:  # one for both, as whose numbers have one name
                self.bare[about.where] = self.lit(about, rough, base, more)
            result = self.bare[about.where]
            if result.plugin == "principled":
                shown = self.relief(about, result)
                result = shown if "spec_trans" in result.values else _twosided(shown)
        opacity = self.opacities[about.where] = self.opacity(about, rough)
        if opacity != 1.0:
            mask = _node("mask", about, opacity=opacity)
            mask.children.append(result)
            result = mask
        return result

    def opacity(self, about: Json, rough: Json) -> Any:
        """A number or a texture, by the mode of alpha."""
        mode = about.text("alphaMode", "OPAQUE")
        if mode not in ("OPAQUE", "MASK", "BLEND"):
            raise about.fail(f'"alphaMode" = {shorten(mode)}, expected OPAQUE, MASK or BLEND')
        if mode == "OPAQUE":
            return 1.0
        alpha = rough.numbers("baseColorFactor", (1.0,) * 4, 0.0, 1.0).tolist()[3]
        cut = about.number("alphaCutoff", 0.5, 0.0) if mode == "MASK" else None
        return self.taken(rough, _BASE, "a", (alpha,), cut)

    def lit(self, about: Json, rough: Json, base: Any, more: dict[str, Json | None]) -> Node:
        """A material that reflects light, without normals of a texture, on its front."""
        empty = Json({}, about.where)
        ior = (more["ior"] or empty).number("ior", 1.5, 0.0, 1e3)
        shine = (more["specular"] or empty).number("specularFactor", 1.0, 0.0, 1.0)
        through = (more["transmission"] or empty).number("transmissionFactor", 0.0, 0.0, 1.0)
        thick = (more["volume"] or empty).number("thicknessFactor", 0.0, 0.0)
        if 0 < ior < 1:
            self.report.warn('"ior" below 1 is not applied', about.where)
        ior = ior if ior >= 1 else 1.5
        if through and not thick:
            if through >= 0.5:
                self.report.warn("a thin material that transmits is a smooth pane", about.where)
                return _node("thindielectric", about, int_ior=ior, ext_ior=1.0,
                             specular_transmittance=base)  # fmt: skip
            self.report.warn("transmission below a half is not applied", about.where)
        values: dict[str, Any] = {
            "base_color": base,
            "metallic": self.taken(rough, _ROUGH, "b", _factor(rough, "metallicFactor")),
            "roughness": self.taken(rough, _ROUGH, "g", _factor(rough, "roughnessFactor")),
        }
        if through and thick:
            values |= {"spec_trans": through, "eta": max(ior, 1.001)}
        else:
            front = ((ior - 1.0) / (ior + 1.0)) ** 2 * shine / 0.08
            values["specular"] = min(front, 1.0)
            if front > 1:
                self.report.warn('"ior" above 1.79 is shown as 1.79', about.where)
        coat, sheen = more["clearcoat"], more["sheen"]
        if coat is not None:
            values["clearcoat"] = coat.number("clearcoatFactor", 0.0, 0.0, 1.0)
            slope = coat.number("clearcoatRoughnessFactor", 0.0, 0.0, 1.0) ** 2
            values["clearcoat_gloss"] = min(max((0.1 - slope) / 0.099, 0.0), 1.0)
        if sheen is not None:
            values["sheen"] = max(sheen.numbers("sheenColorFactor", (0.0,) * 3, 0.0, 1.0).tolist())
        return _node("principled", about, **values)

    def relief(self, about: Json, bsdf: Node) -> Node:
        """A bsdf with the normals of a texture: y along the normal's cross product with u, or
        against it where the image is mirrored."""
        if "normalTexture" not in about.content:
            return bsdf
        scale = about.of("normalTexture").number("scale", 1.0, -1e3, 1e3)
        channels = "mirrored normal" if self.mirrored else "normal"
        normals = self.taken(about, "normalTexture", channels, (scale,))
        if not isinstance(normals, Node) and normals in (scale, (0.5, 0.5, 1.0)):
            return bsdf  # without an image, or with one that turns nothing
        result = _node("normalmap", about, normalmap=normals)
        result.children.append(bsdf)
        return result

    def turns(self, about: Json) -> bool:
        """Whether a texture turns normals of a material."""
        unlit = "KHR_materials_unlit" in about.of("extensions").content
        return "normalTexture" in about.content and not unlit

    def radiance(self, about: Json, factor: tuple[float, ...]) -> Any:
        """What a material emits, where alpha leaves it: a colour or a texture; None for nothing."""
        found = self.taken(about, "emissiveTexture", "rgb", factor)
        return cutaway.emitted(
            found, self.opacities.get(about.where, 1.0), about.where, self.report
        )

    def extension(self, about: Json, name: str) -> Json | None:
        """An extension of a material; its textures are named as not applied."""
        if name not in about.of("extensions").content:
            return None
        found = about.of("extensions").of(name)
        for key in sorted(found.content):
            if key.endswith("Texture") and key != "diffuseTexture":
                self.report.warn(f"{shorten(key)} of a material is not applied", found.where)
        for key in ("attenuationColor", "specularColorFactor"):
            if key in found.content and (found.numbers(key, (1.0,) * 3) != 1).any():
                self.report.warn(f"{key} of a material is not applied", found.where)
        return found

    def rough(self, about: Json, old: Json | None) -> Json:
        """The metallic-roughness part, or what stands for it."""
        if old is None:
            return about.of("pbrMetallicRoughness")
        self.report.warn("specular and glossiness are shown as roughness alone", old.where)
        shown = {
            "baseColorFactor": old.content.get("diffuseFactor", [1, 1, 1, 1]),
            "metallicFactor": 0,
            "roughnessFactor": 1.0 - old.number("glossinessFactor", 1.0, 0.0, 1.0),
        }
        if "diffuseTexture" in old.content:
            shown[_BASE] = old.content["diffuseTexture"]
        return Json(shown, old.where)

    def unused(self, about: Json, rough: Json) -> None:
        """Names what is not applied."""
        if "occlusionTexture" in about.content:
            self.report.note('"occlusionTexture": shadows are traced instead', about.where)
        names = [name for name in about.content if name.endswith("Texture")]
        names += [name for name in rough.content if name.endswith("Texture")]
        names += about.of("extensions").content
        used = {_BASE, _ROUGH, "occlusionTexture", "normalTexture", "emissiveTexture", *_KNOWN}
        for name in sorted({*names} - used):
            self.report.warn(f"{shorten(name)} of a material is not applied", about.where)

    def taken(
        self,
        rough: Json,
        key: str,
        channels: str,
        factor: tuple[float, ...],
        cut: float | None = None,
    ) -> Any:
        """The texture in `key` times a factor, or the factor: a node, a number or a colour.

        channels: "rgb", "normal", "mirrored normal", "g", "b" or "a". cut: from where on a number
        counts as 1, else 0.
        """
        plain = factor if channels == "rgb" else factor[0]
        if key in rough.content:
            info = rough.of(key)
            number = info.needed("index", len(self.file.tables["textures"]) - 1)
            texture = self.file.tables["textures"][number]
            source = texture.index("source", self.file.tables["images"])
            if source is not None:
                place, coordinates = _transform(info)
                before = self.sets.setdefault(self.place, coordinates)
                if before != coordinates:
                    text = f"texture coordinates {coordinates} are not used, {before} are"
                    self.report.warn(text, info.where)
                name = number, channels, factor, cut, None if place is None else place.tobytes()
                if name not in self.nodes:
                    texels = _scaled(self.image(source), channels, factor, cut)
                    self.nodes[name] = self.texture(texture, texels, channels, place)
                return self.nodes[name]
            self.report.warn(f"{key}: its image is in no format that is read", texture.where)
        return plain if cut is None else float(factor[0] >= cut)

    def texture(
        self, texture: Json, texels: Array, channels: str, place: Array | None
    ) -> Node | float | tuple[float, ...]:
        """A bitmap, or the number or colour that it is everywhere."""
        if (texels == texels[:1, :1]).all():
            one = images.from_array(texels[:1, :1], texture.where, raw=channels != "rgb")
            found = tuple(float(x) for x in one.linear()[0, 0])
            return found if len(found) == 3 else found[0]
        sampler = Json({}, texture.where)
        number = texture.index("sampler", self.file.tables["samplers"])
        if number is not None:
            sampler = self.file.tables["samplers"][number]
        wraps = []
        for axis in "ST":
            wrap = sampler.whole(f"wrap{axis}", 10497, 2**31)
            if wrap not in _WRAPS:
                raise sampler.fail(f'"wrap{axis}" = {wrap} is unknown')
            wraps.append(_WRAPS[wrap])
        if wraps[0] != wraps[1]:
            self.report.warn(f"wrapT is shown as wrapS, {wraps[0]}", sampler.where)
        nearest = sampler.whole("magFilter", 0, 2**31) == _NEAREST
        result = _node("bitmap", texture, bitmap=texels, raw=channels != "rgb", wrap_mode=wraps[0],
                       filter_type="nearest" if nearest else "bilinear")  # fmt: skip
        if place is not None:
            result.values["to_uv"] = Value("transform", place, texture.where)
        return result

    def image(self, number: int) -> Array:
        """The texels (H, W, 4) uint8 of an image."""
        if number not in self.pixels:
            image = self.file.tables["images"][number]
            view = image.index("bufferView", self.file.tables["bufferViews"])
            data = self.file.content(image) if view is None else self.file.view(view)
            self.pixels[number] = images.rgba(data, "the image", image.where)
        return self.pixels[number]


def _factor(rough: Json, key: str) -> tuple[float]:
    return (rough.number(key, 1.0, 0.0, 1.0),)


def _scaled(pixels: Array, channels: str, factor: tuple[float, ...], cut: float | None) -> Array:
    """Channels of an image times a factor: uint8 if that is 1, else float32; or 0 and 1."""
    if channels == "rgb":
        if factor == (1.0, 1.0, 1.0):
            return pixels[..., :3]
        return images.SRGB_TO_LINEAR[pixels[..., :3]] * np.array(factor, np.float32)
    if channels.endswith("normal"):
        return _normals(pixels, factor[0], channels != "normal")
    plane = pixels[..., "rgba".index(channels), None]
    if cut is not None:
        return np.where(images.BYTE_TO_SHARE[plane] * factor[0] >= cut, 255, 0).astype(np.uint8)
    return plane if factor == (1.0,) else images.BYTE_TO_SHARE[plane] * np.float32(factor[0])


def _normals(pixels: Array, scale: float, mirrored: bool) -> Array:
    """The texels of a normal map, with -y for y if mirrored: uint8 if the scale of x and y is 1."""
    texels = pixels[..., :3]
    if mirrored:
        texels = texels ^ np.array([0, 255, 0], np.uint8)
    if scale == 1.0:
        return texels
    x, y, z = np.moveaxis(texels / 127.5 - 1.0, 2, 0)
    normals = np.stack([scale * x, scale * y, z], axis=2)
    largest = np.abs(normals).max(axis=2, keepdims=True)  # as long as within [-1, 1]
    normals = normals / np.maximum(largest, 1.0)
    colours: Array = (0.5 * (normals + 1.0)).astype(np.float32)
    return colours


def _transform(info: Json) -> tuple[Array | None, int]:
    """What moves texture coordinates, None if nothing does, and their number."""
    number = info.whole("texCoord", 0, 1000) or 0
    if "KHR_texture_transform" not in info.of("extensions").content:
        return None, number
    moved = info.of("extensions").of("KHR_texture_transform")
    scale, offset = moved.numbers("scale", (1.0, 1.0)), moved.numbers("offset", (0.0, 0.0))
    scale[scale == 0] = 1e-60  # which is 0 in float32, and not singular here
    sine, cosine = sin_cos_degrees(math.degrees(moved.number("rotation", 0.0, -1e3, 1e3)))
    matrix = np.eye(4)  # a turn from u to -v, counter-clockwise on the image
    matrix[:2, :2] = [[cosine * scale[0], sine * scale[1]], [-sine * scale[0], cosine * scale[1]]]
    matrix[:2, 3] = offset
    return matrix, moved.whole("texCoord", number, 1000) or 0


def _twosided(bsdf: Node) -> Node:
    return Node("twosided", bsdf.where, "bsdf", children=[bsdf])


def _node(plugin: str, about: Json, **values: Any) -> Node:
    """An object with parameters: numbers, colours, text, arrays, or nodes for textures."""
    result = Node(plugin, about.where, "texture" if plugin == "bitmap" else "bsdf")
    kinds = {bool: "boolean", float: "float", str: "string", tuple: "rgb", np.ndarray: "array"}
    for name, value in values.items():
        if isinstance(value, Node):
            result.children.append(named(value, name))
        else:
            result.values[name] = Value(kinds[type(value)], value, about.where)
    return result


def named(texture: Node, name: str) -> Node:
    """A texture, for a parameter; the same object for each use in the same parameter."""
    if not texture.name:
        texture.name = name
    if texture.name == name:
        return texture
    return Node(texture.plugin, texture.where, texture.category, "", "", texture.values, [], name)
