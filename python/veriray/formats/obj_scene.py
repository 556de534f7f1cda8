"""Wavefront OBJ files as scenes, with the materials of their MTL files.

Faces of one material are one shape. A material is diffuse in Kd; with Ks, unless illum is 0 or 1,
a rough coat (`roughplastic`) with Ks as the factor on its reflection and the slope
sqrt(2 / (Ns + 2)) of a Phong lobe; metal with the colour Ks if Kd is black or illum is 3, 5 or 8;
glass of index Ni if illum is 4, 6, 7 or 9; `principled` if Pr or Pm give roughness and metal. All
but glass reflect on both sides. d, Tr and map_d are opacity (not of glass), Ke times that is
emitted by the front. map_Kd is taken times Kd, unless that is black; without it the colours of
vertices are. A scene without light gets a white sky; a face without a material, or with one of an
MTL file that is not there, is grey. A camera is placed that frames it from its front, at +z with y
up.

In a file without vn the faces of a smoothing group are smooth among each other, and those of none
are flat.
"""

from __future__ import annotations

import math
import os
import re
from collections.abc import Mapping
from dataclasses import dataclass, field
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
_CHANNELS = {"r": "r", "g": "g", "b": "b", "m": "a", "l": "l"}  # of -imfchan; here l is grey
_VERTEX = {b"v", b"v#", b"v ", b"v\t", b"v\v", b"v\f"}  # starts of v lines
_IDLE = ("Ka", "map_Ka", "Km", "sharpness", "map_aat")  # which change nothing here
_NOT_0 = re.compile(r"[-+.0]*[1-9]")  # starts of numbers
_OPTIONS = {"-blendu": 1, "-blendv": 1, "-boost": 1, "-mm": 2, "-o": 3, "-s": 3, "-t": 3,
            "-texres": 1, "-clamp": 1, "-bm": 1, "-imfchan": 1, "-type": 1, "-cc": 1}  # fmt: skip


@dataclass
class _Map:
    """A texture: base + gain times its texels, of one channel of _CHANNELS or of all."""

    path: Path
    where: str
    to_uv: Array = field(default_factory=lambda: np.eye(4))
    clamped: bool = False
    base: float = 0.0
    gain: float = 1.0
    channel: str = ""
    left_out: list[str] = field(default_factory=list)  # options


@dataclass
class _Material:
    """Colours and numbers of a material by key, and textures."""

    name: str
    where: str
    colours: dict[str, tuple[float, float, float]] = field(default_factory=dict)
    numbers: dict[str, float] = field(default_factory=dict)
    maps: dict[str, _Map] = field(default_factory=dict)


def read(path: Path, parameters: Mapping[str, object], report: Report | None = None) -> Tree:
    """Reads a file. Raises SceneError; `report` takes what is not shown."""
    where = str(path)
    for key in parameters:
        raise SceneError(f"parameter {shorten(key)} is not used by the scene", where)
    report = Report() if report is None else report
    data = read_bytes(path, mesh.MAX_BYTES, "")
    found, lines = mesh.obj(data, path, where)
    texts = mesh.obj_text(data).splitlines()
    materials, names, of, groups = _faces(texts, path, report)
    colours = _vertex_colours(texts, where, report)
    if found.normals is None:
        found, lines = _smoothed(found, lines, groups)
    if colours is not None:
        found.attributes["vertex_color"] = colours[lines]
    tree = Tree(Node("scene", where, "scene"), report=report)
    low, high = found.vertices.min(axis=0), found.vertices.max(axis=0)
    tree.scene.children.append(gltf.framing(low, high, where))
    report.note("a camera was placed that frames the file", where)
    made: dict[str, list[Node]] = {}
    for number, name in enumerate(names):
        faces = found.triangles[of == number]
        if not len(faces):
            continue
        material = materials[name] if name else _Material("", where)
        if name not in made:
            made[name] = _objects(material, report, colours is not None)
        shape = _shape(found, faces, name, where, made[name])
        if colours is not None:
            own = shape.values["vertex_color"].value
            if "map_Kd" not in material.maps:
                own *= material.colours.get("Kd", 1.0)
            elif (own != 1).any():
                told = "map_Kd is applied instead of the colours of vertices"
                report.warn(told, material.where)
        tree.scene.children.append(shape)
    if not any(node.category == "emitter" for nodes in made.values() for node in nodes):
        report.warn("the file has no light; a white sky was added", where)
        tree.scene.children.append(Node("constant", where, "emitter"))
    return tree


def _faces(
    lines: list[bytes], path: Path, report: Report
) -> tuple[dict[str, _Material], list[str], Array, Array]:
    """The materials, the names of those used, and which of these each triangle has, "" for none;
    its smoothing group, 0 for none."""
    materials: dict[str, _Material] = {}
    names, current, lost = [""], 0, False
    groups, group = {b"off": 0, b"0": 0}, 0
    of: list[tuple[int, int, int]] = []  # of a face: material, group, triangles
    for number, line in enumerate(lines, 1):
        if line.lstrip()[:1] not in (b"f", b"m", b"u", b"s"):
            continue
        words = line.split(b"#", 1)[0].split()
        kind = words[0] if words else b""
        if kind == b"f":
            of.append((current, group, len(words) - 3))
        elif kind == b"s" and len(words) > 1:
            group = groups.setdefault(words[1], len(groups))
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
    table = np.array(of, np.int64).reshape(-1, 3)
    own, smooth = np.repeat(table[:, :2], table[:, 2], axis=0).T
    return materials, names, own, smooth


def _vertex_colours(lines: list[bytes], where: str, report: Report) -> Array | None:
    """The colours (N, 3) of v lines as shares, white for one without; None if the numbers after
    x y z are something else, such as normals. Some above 1.5 mean that all are of 255."""
    own = [line for line in lines if line.lstrip()[:2] in _VERTEX]
    if not any(line.count(b" ") + line.count(b"\t") > 5 for line in own):
        return None
    rows = [(line.split(b"#", 1)[0] if b"#" in line else line).split()[4:] for line in own]
    given = [k for k, row in enumerate(rows) if len(row) >= 3]
    if not given:
        return None
    # x y z weight r g b, or x y z r g b alpha
    long = [row for row in rows if len(row) == 4]
    weighed = all(_is_1(row[0]) for row in long) and not all(_is_1(row[3]) for row in long)
    found = _numbers([row[1:] if weighed and len(row) == 4 else row[:3] for row in rows])
    bad = np.flatnonzero(~((found >= 0) & (found <= 255)).all(axis=1))
    if len(bad):
        told = "the numbers after x y z are no colour; no colours of vertices are taken"
        report.warn(told, f"{where}:{_line(lines, given[bad[0]])}")
        return None
    high = np.flatnonzero((found > 1).any(axis=1))
    if (found > 1.5).any():
        found = found / 255
    elif len(high):
        told = "colours of vertices above 1 are taken as 1"
        report.warn(told, f"{where}:{_line(lines, given[high[0]])}")
    result = np.ones((len(rows), 3))
    result[given] = np.minimum(found, 1.0)
    return result


def _line(lines: list[bytes], vertex: int) -> int:
    """The number of a v line in the file."""
    return [k for k, line in enumerate(lines, 1) if line.lstrip()[:2] in _VERTEX][vertex]


def _is_1(word: bytes) -> bool:
    return bool(_number(word) == 1)


def _numbers(rows: list[list[bytes]]) -> Array:
    """Words of rows that have 3 as numbers (N, 3), nan for those that are none."""
    words = [word for row in rows if len(row) == 3 for word in row]
    try:
        found = [float(word) for word in words]
    except ValueError:
        found = [_number(word) for word in words]
    return np.array(found).reshape(-1, 3)


def _number(word: bytes) -> float:
    try:
        return float(word)
    except ValueError:
        return math.nan


def _smoothed(found: mesh.Mesh, lines: Array, groups: Array) -> tuple[mesh.Mesh, Array]:
    """The mesh with normals by smoothing groups, and its vertices' v lines; without a group, as it
    is."""
    if not groups.any():
        return found, lines
    if groups.min() == groups.max():
        points = np.zeros((lines.max() + 1, 3))
        points[lines] = found.vertices
        smooth = mesh.vertex_normals(points, lines[found.triangles])[lines]
        return mesh.Mesh(found.vertices, found.triangles, smooth, found.uv), lines
    alone = groups.max() + 1 + np.arange(len(groups))  # a face without a group
    group = np.repeat(np.where(groups > 0, groups, alone), 3)
    corners = found.triangles.reshape(-1)
    zero = np.zeros_like(corners)
    places, place = mesh.distinct(np.stack([zero, lines[corners], group], axis=1))
    points = np.empty((lines.max() + 1, 3))
    points[lines] = found.vertices
    smooth = mesh.vertex_normals(points[places[:, 1]], place.reshape(-1, 3))
    split, vertex = mesh.distinct(np.stack([zero, corners, group], axis=1))
    normals = np.empty((len(split), 3))
    normals[vertex] = smooth[place]
    used = split[:, 1]
    uv = None if found.uv is None else found.uv[used]
    return mesh.Mesh(found.vertices[used], vertex.reshape(-1, 3), normals, uv), lines[used]


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
            now.maps.setdefault(key, _Map(path, where))
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


def _map(key: str, rest: list[str], folder: Path, where: str) -> _Map:
    """A texture: options, then a file name that may have blanks in it."""
    text = rest[0].strip() if rest else ""
    numbers = {"-s": [1.0, 1.0], "-o": [0.0, 0.0], "-mm": [0.0, 1.0]}
    found = _Map(folder, where)
    while text.startswith("-"):
        option, *words = text.split()
        if option not in _OPTIONS:
            raise SceneError(f"{key}: unknown option {shorten(option)}", where)
        most = _OPTIONS[option]
        used = [word for word in words[:most] if most == 1 or re.fullmatch(r"[-+.\deE]+", word)]
        if option in numbers:
            given = [parse_float(word, f"{key} {option}", where) for word in used[:2]]
            numbers[option][: len(given)] = given
        elif option == "-clamp":
            found.clamped = used == ["on"]
        elif option == "-imfchan":
            found.channel = _CHANNELS.get("".join(used), "")
        turbulent = option == "-t" and any(_NOT_0.match(word) for word in used)
        if turbulent or option == "-imfchan" and not found.channel:
            found.left_out.append(" ".join([option, *used]))
        text = text.split(None, len(used) + 1)[-1] if len(words) > len(used) else ""
    if not text:
        raise SceneError(f"{key} names no file", where)
    found.path = folder / text.replace("\\", "/")
    (su, sv), (u, v), (found.base, found.gain) = numbers.values()
    su, sv = su or 1e-60, sv or 1e-60  # which is 0 in float32, and not singular here
    found.to_uv = transform.compose(  # v is up there, and down in an image
        transform.translate([u, 1.0 - sv - v, 0.0]), transform.scale([su, sv, 1.0])
    )
    return found


def _objects(material: _Material, report: Report, coloured: bool) -> list[Node]:
    """The bsdf of a material, and its light; coloured: vertices have colours."""
    where, numbers = material.where, material.numbers
    colours = {key: material.colours.get(key, (value,) * 3) for key, value in _COLOURS.items()}
    for key, given in material.maps.items():
        for name in given.left_out if key in _MAPS else [key]:
            report.warn(f"{shorten(name)} of a material is not applied", given.where)
    illum, shine = numbers.get("illum", 2.0), any(colours["Ks"])
    slope = math.sqrt(2.0 / (numbers.get("Ns", 0.0) + 2.0))
    base: Any = colours["Kd"]
    if "map_Kd" in material.maps:
        base = _texture("map_Kd", material, material.colours.get("Kd", (1.0,) * 3), report)
    elif coloured and any(base):
        base = _node("mesh_attribute", where, name="vertex_color")
    if illum in (4, 6, 7, 9):
        inside = numbers.get("Ni", 1.5)
        result = _node("dielectric", where, int_ior=inside, ext_ior=1.0,
                       specular_transmittance=colours["Tf"])  # fmt: skip
    elif {"Pr", "Pm"} & numbers.keys():
        result = _twosided("principled", where, base_color=base, metallic=numbers.get("Pm", 0.0),
                           roughness=numbers.get("Pr", math.sqrt(slope)))  # fmt: skip
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
        opacity = _texture("map_d", material, (opacity,) * 3, report)
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


def _texture(key: str, material: _Material, factor: tuple[float, ...], report: Report) -> Node:
    """A bitmap, baked with a factor that is not 0 or 1, and with options."""
    given = material.maps[key]
    where, raw = given.where, key == "map_d"
    factor = factor if any(factor) else (1.0,) * 3
    if given.channel or (given.base, given.gain, *factor) != (0.0, 1.0, 1.0, 1.0, 1.0):
        channel = given.channel if given.channel in tuple("rgba") else None
        texels = images.read(given.path, where, raw=raw, channel=channel).linear()
        texels = images.one_number(texels) if given.channel == "l" else texels
        factor = factor if len({*factor}) > 1 else factor[:1]  # leaves grey texels
        texels = (given.base + given.gain * texels) * np.array(factor, np.float32)
        if ((texels < 0) | (texels > 1)).any():
            report.warn(f"numbers of {key} outside [0, 1] are shown as 0 or 1", where)
            texels = texels.clip(0, 1)
        result = _node("bitmap", where, bitmap=texels)
    else:
        result = _node("bitmap", where, filename=str(given.path), raw=raw)
    result.values["wrap_mode"] = Value("string", "clamp" if given.clamped else "repeat", where)
    result.values["to_uv"] = Value("transform", given.to_uv, where)
    return result


def _node(plugin: str, where: str, **values: Any) -> Node:
    """An object with parameters: numbers, colours, text, arrays, or nodes for textures."""
    texture = plugin in ("bitmap", "mesh_attribute")
    result = Node(plugin, where, "texture" if texture else "bsdf")
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
    arrays |= found.attributes
    values = {key: Value("array", table[used], where) for key, table in arrays.items()
              if table is not None}  # fmt: skip
    values["faces"] = Value("array", inverse.reshape(-1, 3), where)
    values["flip_tex_coords"] = Value("boolean", True, where)
    if found.normals is None:
        values["face_normals"] = Value("boolean", True, where)
    return Node("mesh", where, "shape", name, "", values, [*objects])
