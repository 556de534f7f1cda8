"""A glTF model that the gallery makes itself, and the sky that it stands under.

Hare of bronze, knot of lacquer, ball of glass and a block of stone on a terrace in a meadow:
meshes, a texture and metallic-roughness materials in one GLB file, with its camera.
"""

from __future__ import annotations

import dataclasses
import io
import json
import struct
import warnings
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

from ..errors import SceneWarning
from ..files import replacing
from ..scene import Scene, load_dict, load_file
from ..transform import look_at
from . import maps, meshes
from .own import MARK

Array = npt.NDArray[Any]

SIZE = (1200, 800)
_EYE, _TARGET, _FOV = (1.9, 1.55, -7.2), (0.15, 1.05, 0.0), 0.52
#: The sun is behind the camera's left shoulder, 27 degrees high; the sky's +z is the model's +y.
_SKY = {
    "type": "sunsky", "turbidity": 3.0, "sun_direction": [0.85, 0.62, -0.85],
    "to_world": np.array([[1.0, 0, 0, 0], [0, 0, 1, 0], [0, -1, 0, 0], [0, 0, 0, 1]]),
}  # fmt: skip
_FLOATS, _INDICES = 5126, 5125  # component types of glTF


def _slab(x: float, y: float, z: float) -> tuple[Array, Array, Array, Array]:
    """A box on y = 0: vertices, normals, triangles and texture coordinates of 3 units."""
    corners: list[Array] = []
    normals, uv, faces = [], [], []
    for axis in range(3):
        for side in (-1.0, 1.0):
            a, b = np.eye(3)[(axis + 1) % 3], np.eye(3)[(axis + 2) % 3]
            n = side * np.eye(3)[axis]
            first = len(corners)
            for s, t in ((-1, -1), (1, -1), (1, 1), (-1, 1)):
                p = (n + s * side * a + t * b) * [x / 2, y / 2, z / 2]
                corners.append(p + [0, y / 2, 0])
                normals.append(n)
                uv.append(np.delete(p, axis) / 3)
            faces += [[first, first + 1, first + 2], [first, first + 2, first + 3]]
    return np.array(corners), np.array(normals), np.array(faces), np.array(uv)


def _ball(radius: float) -> meshes.Mesh:
    """A sphere that stands on y = 0."""
    size = np.full(3, 1.25 * radius)
    vertices, normals, faces = meshes.contour(
        lambda p: np.sqrt((p * p).sum(axis=-1)) - radius, -size, size, round(40 / radius)
    )
    return vertices + np.array([0.0, radius, 0.0]), normals, faces


class _File:
    """A GLB file as it grows."""

    def __init__(self) -> None:
        self.data = b""
        self.root: dict[str, Any] = {
            "asset": {"version": "2.0", "generator": MARK}, "scene": 0, "scenes": [{"nodes": []}],
            "extensionsUsed": ["KHR_materials_transmission", "KHR_materials_ior",
                               "KHR_materials_clearcoat"],
            **{name: [] for name in ("nodes", "meshes", "materials", "accessors", "bufferViews")},
        }  # fmt: skip

    def view(self, data: bytes) -> int:
        """A buffer's view of data; its number."""
        self.data += b"\0" * (-len(self.data) % 4)
        views: list[Any] = self.root["bufferViews"]
        views.append({"buffer": 0, "byteOffset": len(self.data), "byteLength": len(data)})
        self.data += data
        return len(views) - 1

    def accessor(self, values: Array, kind: str) -> int:
        """An array of numbers; its number."""
        whole = values.dtype.kind in "iu"
        stored = values.astype("<u4" if whole else "<f4")
        row: dict[str, Any] = {
            "bufferView": self.view(stored.tobytes()), "type": kind, "count": len(stored),
            "componentType": _INDICES if whole else _FLOATS,
        }  # fmt: skip
        if kind == "VEC3":
            row |= {"min": stored.min(axis=0).tolist(), "max": stored.max(axis=0).tolist()}
        self.root["accessors"].append(row)
        return len(self.root["accessors"]) - 1

    def add(self, mesh: Any, material: dict[str, Any], **placed: Any) -> None:
        """A node with a mesh of one material."""
        vertices, normals, faces, *uv = mesh
        names = {"POSITION": (vertices, "VEC3"), "NORMAL": (normals, "VEC3")}
        if uv:
            names["TEXCOORD_0"] = (uv[0], "VEC2")
        attributes = {name: self.accessor(*value) for name, value in names.items()}
        indices = self.accessor(faces.reshape(-1), "SCALAR")
        self.root["materials"].append(material)
        part = {"attributes": attributes, "indices": indices,
                "material": len(self.root["materials"]) - 1}  # fmt: skip
        self.root["meshes"].append({"primitives": [part]})
        self.node(mesh=len(self.root["meshes"]) - 1, **placed)

    def node(self, **values: Any) -> None:
        """A node of the scene."""
        self.root["nodes"].append(values)
        self.root["scenes"][0]["nodes"].append(len(self.root["nodes"]) - 1)

    def content(self) -> bytes:
        """The file."""
        self.data += b"\0" * (-len(self.data) % 4)
        self.root["buffers"] = [{"byteLength": len(self.data)}]
        text = json.dumps(self.root).encode()
        text += b" " * (-len(text) % 4)
        head = struct.pack("<4sII", b"glTF", 2, 12 + 8 + len(text) + 8 + len(self.data))
        chunks = ((b"JSON", text), (b"BIN\0", self.data))
        return head + b"".join(struct.pack("<I4s", len(c), kind) + c for kind, c in chunks)


def _material(colour: tuple[float, ...], metal: float, rough: float, **more: Any) -> dict[str, Any]:
    shares = {"baseColorFactor": [*colour, 1.0], "metallicFactor": metal, "roughnessFactor": rough}
    extensions = {f"KHR_materials_{name}": value for name, value in more.items()}
    return {"pbrMetallicRoughness": shares} | ({"extensions": extensions} if extensions else {})


@cache
def _content() -> bytes:
    """The model's file."""
    from PIL import Image

    file, png = _File(), io.BytesIO()
    Image.fromarray(maps.planks()).save(png, "PNG")
    file.root["images"] = [{"bufferView": file.view(png.getvalue()), "mimeType": "image/png"}]
    file.root["textures"] = [{"source": 0}]
    boards = _material((1.0, 1.0, 1.0), 0.0, 0.7)
    boards["pbrMetallicRoughness"]["baseColorTexture"] = {"index": 0}
    file.add(_slab(40.0, 0.2, 40.0), boards, translation=[0, -0.2, 0])
    meadow = _material((0.1, 0.13, 0.04), 0.0, 1.0)
    file.add(_slab(6000.0, 0.2, 6000.0), meadow, translation=[0, -0.6, 0])
    file.add(_slab(1.5, 0.5, 1.5), _material((0.55, 0.52, 0.47), 0.0, 0.9))
    file.add(
        meshes.hare(), _material((0.62, 0.36, 0.17), 1.0, 0.42),
        translation=[0, 0.5, 0], scale=[0.8] * 3, rotation=[0, -0.13052619, 0, 0.99144486],
    )  # fmt: skip
    lacquer = {"clearcoatFactor": 1.0, "clearcoatRoughnessFactor": 0.05}
    file.add(
        meshes.knot(), _material((0.45, 0.03, 0.02), 0.0, 0.5, clearcoat=lacquer),
        translation=[-1.95, 0.69, -0.2], scale=[0.62] * 3, rotation=[0, 0.25881905, 0, 0.96592583],
    )  # fmt: skip
    glass = {"transmission": {"transmissionFactor": 1.0}, "ior": {"ior": 1.5}}
    thick = _material((1.0, 1.0, 1.0), 0.0, 0.0, volume={"thicknessFactor": 1.0}, **glass)
    file.add(_ball(0.5), thick, translation=[1.35, 0, -1.0])
    view = look_at(_EYE, _TARGET, (0.0, 1.0, 0.0))
    view = view @ np.diag([-1.0, 1.0, -1.0, 1.0])  # cameras of glTF look along -z
    lens = {"yfov": _FOV, "znear": 0.01, "aspectRatio": SIZE[0] / SIZE[1]}
    file.root["cameras"] = [{"type": "perspective", "perspective": lens}]
    file.node(camera=0, matrix=view.T.reshape(-1).tolist())
    return file.content()


def write(path: Path) -> None:
    """Writes the model; the file appears whole or not at all."""
    with replacing(path) as file:
        file.write(_content())


def load(path: Path) -> Scene:
    """The model under its sky."""
    with warnings.catch_warnings():  # of the file, which has no light
        warnings.simplefilter("ignore", SceneWarning)
        model, sky = (
            load_file(path),
            load_dict({"type": "scene", "camera": {"type": "perspective"}, "sky": _SKY}),
        )
    columns = {name: getattr(sky, name) for name in ("sky_texels", "sky_size", "sky_to_world")}
    lit = dataclasses.replace(model, environment=np.zeros(3, np.float32), **columns)
    return lit.with_(width=SIZE[0], height=SIZE[1])
