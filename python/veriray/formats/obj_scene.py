"""Wavefront OBJ files as scenes, with the materials of their MTL files.

Faces of one material are one shape. A material is diffuse in Kd; with Ks, unless illum is 0 or 1,
a rough coat (`roughplastic`) with Ks as the factor on its reflection and the slope
sqrt(2 / (Ns + 2)) of a Phong lobe; metal with the colour Ks if Kd is black or illum is 3, 5 or 8;
glass of index Ni if illum is 4, 6, 7 or 9; `principled` if Pr or Pm give roughness and metal. All
but glass reflect on both sides. d, Tr and map_d are opacity (not of glass), Ke times that is
emitted by the front. map_Kd is taken times Kd, unless that is black. A scene without light gets a
white sky; a face without a material, or with one of an MTL file that is not there, is grey. A
camera is placed that frames it from its front, at +z with y up.
"""

from __future__ import annotations

import os
import re
from collections.abc import Mapping
from dataclasses import dataclass, field
from math import sqrt
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

from .. import transform
from ..errors import SceneError
from . import cutaway, gltf, images, mesh
from .node import Node, Tree, Value, allowed, parse_float, quoted, read_bytes, shorten
from .report import Report

Array = npt.NDArray[Any]
#: Keys of colours and numbers with what they are where they are not given.
_COLOURS = {"Kd": 0.5, "Ks": 0.0, "Ke": 0.0, "Tf": 1.0}
_NUMBERS = {"Ns": (0.0, 1e6), "Ni": (0.1, 10.0), "d": (0.0, 1.0), "Tr": (0.0, 1.0),
            "illum": (0.0, 10.0), "Pr": (0.0, 1.0), "Pm": (0.0, 1.0)}  # fmt: skip
_MAPS = ("map_Kd", "map_d")
_IDLE = ("Ka", "map_Ka", "Km", "sharpness", "map_aat")  # which change nothing here
_OPTIONS = {"-blendu": 1, "-blendv": 1, "-boost": 1, "-mm": 2, "-o": 3, "-s": 3, "-t": 3,
            "-texres": 1, "-clamp": 1, "-bm": 1, "-imfchan": 1, "-type": 1, "-cc": 1}  # fmt: skip


@dataclass
class _Material:
    """Colours and numbers of a material by key, and textures as (path, to_uv, clamped, place)."""

    name: str
    where: str
    colours: dict[str, tuple[float, float, float]] = field(default_factory=dict)
    numbers: dict[str, float] = field(default_factory=dict)
    maps: dict[str, tuple[Path, Array, bool, str]] = field(default_factory=dict)


def read(path: Path, parameters: Mapping[str, object], report: Report | None = None) -> Tree:
    """Reads a file. Raises SceneError; `report` takes what is not shown."""
    where = str(path)
    for key in parameters:
        raise SceneError(f"parameter {shorten(key)} is not used by the scene", where)
    report = Report() if report is None else report
    data = read_bytes(path, mesh.MAX_BYTES, "")
    found = mesh.read(path, "obj", where, files={path: data})
    materials, names, of = _faces(data, path, report)
    tree = Tree(Node("scene", where, "scene"), report=report)
    low, high = found.vertices.min(axis=0), found.vertices.max(axis=0)
    tree.scene.children.append(gltf.framing(low, high, where))
    report.note("a camera was placed that frames the file", where)
    made: dict[str, list[Node]] = {}
    for number, name in enumerate(names):
        faces = found.triangles[of == number]
        if not len(faces):
            continue
        if name not in made:
            made[name] = (
                _objects(materials[name], report) if name else [_twosided("diffuse", where)]
            )
        tree.scene.children.append(_shape(found, faces, name, where, made[name]))
    if not any(node.category == "emitter" for nodes in made.values() for node in nodes):
        report.warn("the file has no light; a white sky was added", where)
        tree.scene.children.append(Node("constant", where, "emitter"))
    return tree


def _faces(
    data: bytes, path: Path, report: Report
) -> tuple[dict[str, _Material], list[str], Array]:
    """The materials, the names of those used, and which of these each triangle has; "" for none."""
    materials: dict[str, _Material] = {}
    names, current, lost = [""], 0, False
    of: list[int] = []
    counts: list[int] = []
    for number, line in enumerate(mesh.obj_text(data).splitlines(), 1):
        words = line.split(b"#", 1)[0].split() if line.lstrip()[:1] in (b"f", b"m", b"u") else [b""]
        kind = words[0]
        if kind == b"f":
            of.append(current)
            counts.append(len(words) - 3)
        elif kind in (b"mtllib", b"usemtl"):
            place = f"{path}:{number}"
            word = line.strip()[6:].strip().decode("utf-8", "replace")
            if kind == b"mtllib":
                for name in [word] if os.path.isfile(path.parent / word) else word.split():
                    file = path.parent / name.replace("\\", "/")
                    if os.path.exists(file):
                        materials |= _materials(file, place)
                    else:
                        lost = True
                        report.warn(f"{shorten(file)} is not there; its materials are grey", place)
                continue
            if word not in materials and materials and not lost:
                known = allowed(word, materials, "known")
                raise SceneError(f"there is no material {shorten(word)}{known}", place)
            if word not in materials:
                if not lost:
                    report.warn("no mtllib before this usemtl; its materials are grey", place)
                lost, word = True, ""
            if word not in names:
                names.append(word)
            current = names.index(word)
    return materials, names, np.repeat(np.array(of, np.int64), counts)


def _materials(path: Path, place: str) -> dict[str, _Material]:
    """The materials of an MTL file."""
    found: dict[str, _Material] = {}
    now = None
    data = read_bytes(path, mesh.MAX_BYTES, place)
    for number, line in enumerate(data.decode("utf-8-sig", "replace").splitlines(), 1):
        words = line.split("#", 1)[0].split()
        if not words:
            continue
        key, where = words[0], f"{path}:{number}"
        if key == "newmtl":
            name = line.split(None, 1)[1].strip() if len(words) > 1 else ""
            now = found[name] = _Material(name, where)
        elif now is None:
            raise SceneError(f"{quoted(key.encode())} stands before the first newmtl", where)
        elif key in _COLOURS:
            now.colours[key] = _colour(key, words[1:], where)
        elif key in _NUMBERS:
            low, high = _NUMBERS[key]
            text = words[-1] if len(words) > 1 else ""
            value = parse_float(text, key, where)
            if not low <= value <= high:
                raise SceneError(f"{key} = {value:g} is outside [{low:g}, {high:g}]", where)
            now.numbers[key] = value
        elif key in _MAPS:
            now.maps[key] = _map(key, line.split(None, 1)[1:], path.parent, where)
        elif key not in _IDLE:
            now.maps.setdefault(key, (path, np.eye(4), False, where))
    return found


def _colour(key: str, words: list[str], where: str) -> tuple[float, float, float]:
    if words and words[0] in ("spectral", "xyz"):
        raise SceneError(f"{key} {words[0]} is not supported; give r g b", where)
    numbers = [parse_float(word, key, where) for word in words[:3]]
    most = 1e30 if key == "Ke" else 1.0
    if len(numbers) not in (1, 3) or not all(0 <= x <= most for x in numbers):
        text = f"{key} = {shorten(' '.join(words))} is not 1 or 3 numbers in [0, {most:g}]"
        raise SceneError(text, where)
    r, g, b = numbers * 3 if len(numbers) == 1 else numbers
    return r, g, b


def _map(key: str, rest: list[str], folder: Path, where: str) -> tuple[Path, Array, bool, str]:
    """A texture: options, then a file name that may have blanks in it."""
    text = rest[0].strip() if rest else ""
    scale, offset, clamped = [1.0, 1.0], [0.0, 0.0], False
    while text.startswith("-"):
        option, *words = text.split()
        if option not in _OPTIONS:
            raise SceneError(f"{key}: unknown option {shorten(option)}", where)
        most = _OPTIONS[option]
        used = [word for word in words[:most] if most == 1 or re.fullmatch(r"[-+.\deE]+", word)]
        if option in ("-s", "-o"):
            numbers = [parse_float(word, f"{key} {option}", where) for word in used[:2]]
            target = scale if option == "-s" else offset
            target[: len(numbers)] = numbers
        elif option == "-clamp":
            clamped = used == ["on"]
        text = text.split(None, len(used) + 1)[-1] if len(words) > len(used) else ""
    if not text:
        raise SceneError(f"{key} names no file", where)
    return (
        folder / text.replace("\\", "/"),
        transform.compose(transform.translate([*offset, 0.0]), transform.scale([*scale, 1.0])),
        clamped,
        where,
    )


def _objects(material: _Material, report: Report) -> list[Node]:
    """The bsdf of a material, and its light."""
    where, numbers = material.where, material.numbers
    colours = {key: material.colours.get(key, (value,) * 3) for key, value in _COLOURS.items()}
    for key, (*_, place) in material.maps.items():
        if key not in _MAPS:
            report.warn(f"{shorten(key)} of a material is not applied", place)
    illum, shine = numbers.get("illum", 2.0), any(colours["Ks"])
    slope = sqrt(2.0 / (numbers.get("Ns", 0.0) + 2.0))
    base: Any = colours["Kd"]
    if "map_Kd" in material.maps:
        base = _texture(material.maps["map_Kd"], colours["Kd"], "reflectance")
    if illum in (4, 6, 7, 9):
        inside = numbers.get("Ni", 1.5)
        result = _node("dielectric", where, int_ior=inside, ext_ior=1.0,
                       specular_transmittance=colours["Tf"])  # fmt: skip
    elif {"Pr", "Pm"} & numbers.keys():
        result = _twosided("principled", where, base_color=base, metallic=numbers.get("Pm", 0.0),
                           roughness=numbers.get("Pr", sqrt(slope)))  # fmt: skip
    elif shine and illum in (3, 5, 8) or shine and not isinstance(base, Node) and not any(base):
        result = _twosided("roughconductor", where, alpha=slope, material="none",
                           specular_reflectance=colours["Ks"])  # fmt: skip
    elif shine and illum >= 2:
        result = _twosided("roughplastic", where, alpha=slope, diffuse_reflectance=base,
                           specular_reflectance=colours["Ks"])  # fmt: skip
    else:
        result = _twosided("diffuse", where, reflectance=base)
    opacity: Any = numbers.get("d", 1.0 - numbers.get("Tr", 0.0))
    if "map_d" in material.maps:
        opacity = _texture(material.maps["map_d"], (opacity,) * 3, "opacity")
    radiance: Any = colours["Ke"] if any(colours["Ke"]) else None
    if opacity != 1.0 and result.plugin != "dielectric":
        result, inner = _node("mask", where, opacity=opacity), result
        result.children.append(inner)
        radiance = radiance and cutaway.emitted(radiance, opacity, where, report)
    if radiance is None:
        return [result]
    lamp = _node("area", where, radiance=radiance)
    lamp.category = "emitter"
    return [result, lamp]


def _texture(given: tuple[Path, Array, bool, str], factor: tuple[float, ...], name: str) -> Node:
    """A bitmap, baked with a factor that is not 0 or 1."""
    path, to_uv, clamped, where = given
    raw = name == "opacity"
    if any(factor) and factor != (1.0, 1.0, 1.0):
        texels = images.read(path, where, raw=raw).linear() * np.array(factor, np.float32)
        result = _node("bitmap", where, bitmap=texels)
    else:
        result = _node("bitmap", where, filename=str(path), raw=raw)
    result.values["wrap_mode"] = Value("string", "clamp" if clamped else "repeat", where)
    result.values["to_uv"] = Value("transform", to_uv, where)
    return result


def _node(plugin: str, where: str, **values: Any) -> Node:
    """An object with parameters: numbers, colours, text, arrays, or nodes for textures."""
    result = Node(plugin, where, "texture" if plugin == "bitmap" else "bsdf")
    kinds = {bool: "boolean", float: "float", str: "string", tuple: "rgb", np.ndarray: "array"}
    for name, value in values.items():
        if isinstance(value, Node):
            value.name = name
            result.children.append(value)
        else:
            result.values[name] = Value(kinds[type(value)], value, where)
    return result


def _twosided(plugin: str, where: str, **values: Any) -> Node:
    return Node("twosided", where, "bsdf", children=[_node(plugin, where, **values)])


def _shape(found: mesh.Mesh, faces: Array, name: str, where: str, objects: list[Node]) -> Node:
    """The mesh of some triangles."""
    used, inverse = np.unique(faces, return_inverse=True)
    arrays = {"vertices": found.vertices, "normals": found.normals, "uv": found.uv}
    values = {key: Value("array", table[used], where) for key, table in arrays.items()
              if table is not None}  # fmt: skip
    values["faces"] = Value("array", inverse.reshape(-1, 3), where)
    values["flip_tex_coords"] = Value("boolean", True, where)
    return Node("mesh", where, "shape", name, "", values, [*objects])
