"""glTF, both forms; mutations change a value of the JSON as often as a byte."""

from __future__ import annotations

import json
import random
import struct
from pathlib import Path

from tests.fuzz import dictionary
from tests.fuzz.contract import Target
from tests.fuzz.scenes import NUMBERS, problem
from veriray.errors import SceneError
from veriray.scene import Scene, load_file

_KEYS = (
    "asset", "version", "accessors", "bufferViews", "buffers", "meshes", "nodes", "scenes", "scene",
    "materials", "cameras", "extensions", "extensionsRequired", "KHR_lights_punctual", "lights",
    "primitives", "attributes", "POSITION", "NORMAL", "TANGENT", "TEXCOORD_0", "indices", "mode",
    "material", "normalTexture", "mesh", "children", "matrix", "translation", "rotation", "scale",
    "camera", "perspective",
    "yfov", "aspectRatio", "type", "count", "componentType", "normalized", "sparse", "values",
    "bufferView", "byteOffset", "byteLength", "byteStride", "buffer", "uri", "light", "spot",
    "color", "intensity", "outerConeAngle", "innerConeAngle", "pbrMetallicRoughness", "SCALAR",
    "baseColorFactor", "emissiveFactor", "alphaMode", "MASK", "BLEND", "alphaCutoff", "VEC2",
    "VEC3", "directional", "point", "KHR_materials_emissive_strength", "emissiveStrength",
    "textures",
    "images", "samplers", "source", "sampler", "baseColorTexture", "metallicRoughnessTexture",
    "index", "texCoord", "TEXCOORD_1", "wrapS", "magFilter", "metallicFactor", "roughnessFactor",
    "KHR_texture_transform", "offset", "rotation", "KHR_materials_ior", "ior",
    "KHR_materials_clearcoat", "clearcoatFactor", "KHR_materials_sheen", "sheenColorFactor",
    "KHR_materials_transmission", "transmissionFactor", "KHR_materials_volume", "thicknessFactor",
    "KHR_materials_specular", "specularFactor", "KHR_materials_unlit",
    "KHR_materials_pbrSpecularGlossiness", "diffuseFactor", "diffuseTexture", "glossinessFactor",
)  # fmt: skip


def _load(path: Path) -> Scene:
    return load_file(path)


def mutate(data: bytes, rng: random.Random) -> bytes | None:
    """As a dictionary is changed; of a GLB its JSON."""
    if data[:4] != b"glTF" or len(data) < 20:
        return dictionary.mutate(data, rng)
    (size,) = struct.unpack_from("<I", data, 12)
    head, rest = data[20 : 20 + size], data[20 + size :]
    new = dictionary.mutate(head, rng)
    if new is None:
        return None
    new += b" " * (-len(new) % 4)
    body = struct.pack("<I4s", len(new), b"JSON") + new + rest
    return b"glTF" + struct.pack("<II", 2, 12 + len(body)) + body


TARGET = Target(
    ".gltf", _load, problem, (SceneError,),
    tuple(f"formats/gltf{name}.py" for name in ("", "_json", "_materials", "_tangents")),
    (*(json.dumps(key) for key in _KEYS), *NUMBERS, "glTF\x02", "JSON", "data:x;base64,AAAA"),
    mutate,
)  # fmt: skip
