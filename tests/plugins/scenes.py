# ruff: noqa: E501 (tables of elements)
"""A small scene for each parameter of the table, as file and dictionary, and what becomes of it."""

from __future__ import annotations

import math
import struct
import warnings
import zlib
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from lxml import etree
from PIL import Image

import veriray as vr
from tests.plugins.table import TABLE
from veriray.errors import SceneError

_MATRIX = '<transform name="{}"><matrix value="{}"/></transform>'
_TURN = "0 0 1 0 0 1 0 0 -1 0 0 0 0 0 0 1"
_MOVE = "1 0 0 1 0 1 0 2 0 0 1 3 0 0 0 1"
_NUMBERS = {"float": "0.3", "far": "100", "angle": "30", "index": "1.3", "turbidity": "4",
            "radius": "1.5", "required": "0.3"}  # fmt: skip
_WHOLE = {"integer": 3, "zero": 0, "one": 1, "square": 16}
_BITMAP = '<texture type="bitmap" name="{}"><string name="filename" value="a.png"/></texture>'
_GRID = '<volume type="gridvolume" name="{}"><string name="filename" value="a.vol"/></volume>'
_MATRIX_GRID = _GRID.replace("a.vol", "s.vol")
_INTEGER = '<integer name="{}" value="{}"/>'
_FLOAT = '<float name="{}" value="{}"/>'
_TEXT = '<string name="{}" value="{}"/>'


_EVEN = '<volume type="constvolume" name="volume"><float name="value" value="0.5"/></volume>'


def _floats(*pairs: tuple[str, object]) -> str:
    return "".join(_FLOAT.format(*pair) for pair in pairs)


#: What a plugin needs: its values by parameter, each of which another value replaces.
NEEDED = {
    ("bsdf", "blendbsdf"): {"weight": _floats(("weight", 0.5))},
    ("sensor", "perspective"): {"fov": _floats(("fov", 40))},
    ("sensor", "thinlens"): {
        "fov": _floats(("fov", 40)),
        "aperture_radius": _floats(("aperture_radius", 0.1)),
    },
    ("emitter", "projector"): {"fov": _floats(("fov", 40))},
    ("emitter", "sunsky"): {"sun_direction": '<vector name="sun_direction" value="0 1 1"/>'},
    ("phase", "blendphase"): {"weight": _floats(("weight", 0.5))},
    ("phase", "sggx"): {"S": _MATRIX_GRID.format("S")},
    ("texture", "mesh_attribute"): {"name": _TEXT.format("name", "vertex_color")},
    ("texture", "volume"): {"volume": _EVEN},
    ("volume", "constvolume"): {"value": _floats(("value", 0.5))},
    ("spectrum", "blackbody"): {"temperature": _floats(("temperature", 5000))},
    ("spectrum", "uniform"): {"value": _floats(("value", 0.5))},
    ("spectrum", "rawconstant"): {"value": _floats(("value", 0.5))},
    ("spectrum", "srgb"): {"color": '<rgb name="color" value="0.2 0.3 0.4"/>'},
}
_SUFFIX = {"obj": "obj", "ply": "ply", "serialized": "serialized", "bsplinecurve": "txt",
           "linearcurve": "txt", "sdfgrid": "vol", "gridvolume": "vol", "envmap": "png",
           "bitmap": "png", "ellipsoids": "gaussians.ply", "ellipsoidsmesh": "gaussians.ply",
           "measured": "bsdf", "measured_polarized": "pbsdf"}  # fmt: skip
#: Values of single parameters.
_SPECIAL = {
    ("blackbody", "temperature"): _floats(("temperature", 4000)),
    ("irregular", "wavelengths"): _TEXT.format("wavelengths", "400 700") + _TEXT.format("values", ".1 .2"),
    ("regular", "wavelength_min"): _floats(("wavelength_min", 400), ("wavelength_max", 700)) + _TEXT.format("values", ".1 .2"),
    ("tabphase", "values"): _TEXT.format("values", "0.5, 1.0"),
    ("sggx", "S"): _MATRIX_GRID.format("S"),
    ("mesh_attribute", "name"): _TEXT.format("name", "face_color"),
    ("rawconstant", "value"): _floats(("value", 0.3)),
    ("sunsky", "sun_aperture"): _floats(("sun_aperture", 3)),
    ("sphere", "radius"): _floats(("radius", 2)),
    ("sunsky", "hour"): _floats(("hour", 12)),
    ("sunsky", "timezone"): _floats(("timezone", 8)),
    ("specfilm", "component_format"): _TEXT.format("component_format", "float32"),
}  # fmt: skip
#: What a parameter of a time takes the place of.
_INSTEAD = {"focal_length": "fov", **dict.fromkeys(
    ("latitude", "longitude", "timezone", "year", "month", "day", "hour", "minute", "second"),
    "sun_direction",
)}  # fmt: skip
_OWN = {
    "bsdf": '<bsdf type="diffuse"/>',
    "texture": '<texture type="bitmap"><string name="filename" value="a.png"/></texture>',
    "integrator": '<integrator type="path"/>',
    "phase": '<phase type="isotropic"/>',
    "shape": '<shape type="sphere"/>',
    "volume": _GRID.format("volume"),
    "spectrum": '<spectrum name="band" value="500:1 600:1"/>',
    "sensor": '<sensor type="perspective"><float name="fov" value="40"/></sensor>',
    "group": '<ref id="group"/>',
}


@dataclass(frozen=True)
class Case:
    """A parameter of a plugin with a value of one kind; none for the plugin alone."""

    category: str
    plugin: str
    parameter: str = ""
    kind: str = ""

    def __str__(self) -> str:
        return ".".join(filter(None, (self.category, self.plugin, self.parameter, self.kind)))


def cases() -> Iterator[Case]:
    """Each plugin alone, and then each of its parameters with each kind of value."""
    for line in filter(None, TABLE.splitlines()):
        category, plugin, *words = line.split()
        yield Case(category, plugin)
        for word in words:
            name, _, kinds = word.partition(":")
            for kind in kinds.split(",") if not word.startswith("+") else ():
                if kind != "-":
                    yield Case(category, plugin, name, kind)


def _value(case: Case) -> str:
    name, kind = case.parameter, case.kind
    special = _SPECIAL.get((case.plugin, name))
    if special:
        return special
    if kind in _NUMBERS:
        return _floats((name, _NUMBERS[kind]))
    if kind in _WHOLE:
        return _INTEGER.format(name, _WHOLE[kind])
    if kind.startswith("string="):
        return _TEXT.format(name, kind[7:])
    made: dict[str, str] = {
        "boolean": f'<boolean name="{name}" value="true"/>',
        "rgb": f'<rgb name="{name}" value="0.2 0.3 0.4"/>',
        "spectrum": f'<spectrum name="{name}" value="400:0.2, 700:0.4"/>',
        "texture": _BITMAP.format(name),
        "volume": _GRID.format(name),
        "gridvolume": _GRID.format(name),
        "constvolume": _EVEN,
        "transform": _MATRIX.format(name, _MOVE),
        "rotation": _MATRIX.format(name, _TURN),
        "uv": _MATRIX.format(name, "2 0 0 0 0 2 0 0 0 0 1 0 0 0 0 1"),
        "point": f'<point name="{name}" value="0.1 0.2 0.3"/>',
        "shape": f'<shape name="{name}" type="rectangle"/>',
        "vector": f'<vector name="{name}" value="0.1 0.2 0.3"/>',
        "ray": '<point name="origin" value="0 0 3"/><vector name="direction" value="0 0 -1"/>',
        "both": _floats(("alpha_u", 0.1), ("alpha_v", 0.3)),
        "texture_both": _BITMAP.format("alpha_u") + _BITMAP.format("alpha_v"),
        "metal": '<spectrum name="eta" value="400:0.2, 700:0.4"/><spectrum name="k" value="400:3, 700:4"/>',
        "shutter": _floats(("shutter_open", 0), ("shutter_close", 1)),
        "focal": _TEXT.format(name, "35mm"),
        "crop": "".join(map(_INTEGER.format, ("crop_width", "crop_height", "crop_offset_x", "crop_offset_y"), (4, 2, 1, 3))),
        "range": _floats(("wavelength_min", 400), ("wavelength_max", 700)),
        "second": '<bsdf type="plastic"/>',
        "bsdf": '<bsdf type="plastic"/>',
        "area": '<emitter type="area"/>',
        "medium": f'<medium type="homogeneous" name="{name}"/>',
        "file": _TEXT.format(name, f"a.{_SUFFIX.get(case.plugin, 'none')}"),
    }  # fmt: skip
    return made[kind]


def element(case: Case) -> str:
    """The element of the plugin with what it needs and the parameter of the case."""
    line = next(x for x in TABLE.splitlines() if x.split()[:2] == [case.category, case.plugin])
    needed = dict(NEEDED.get((case.category, case.plugin), {}))
    if case.plugin in _SUFFIX:
        needed["filename"] = _TEXT.format("filename", f"a.{_SUFFIX[case.plugin]}")
    if case.plugin in ("irregular", "regular", "tabphase"):
        first = next(name for plugin, name in _SPECIAL if plugin == case.plugin)
        needed[first] = _SPECIAL[case.plugin, first]
    if case.plugin == "aov":
        needed["aovs"] = _TEXT.format("aovs", "dd.y:depth")
    needed.pop(_INSTEAD.get(case.parameter, ""), "")
    needed.pop(case.parameter, "")
    parts = []
    for number, word in enumerate(w for w in line.split()[2:] if w.startswith("+")):
        name, _, made = word[1:].partition("=")
        if made:
            parts.append((_BITMAP if made == "texture.bitmap" else _GRID).format(name))
        elif name == "sensor":
            parts.append(_OWN[name])
        else:
            parts.append(_OWN[name].replace("<bsdf ", f'<bsdf name="b{number}" '))
    parts += needed.values()
    if case.parameter:
        parts.append(_value(case))
    if case.plugin in ("radiancemeter", "irradiancemeter", "distant"):
        parts.append(_FILM.format(1, 1).replace("</film>", '<rfilter type="box"/></film>'))
    elif case.category == "sensor":
        parts.append(_FILM.format(8, 8))
    use = {"spectrum": "radiance" if case.plugin in ("blackbody", "d65") else "reflectance",
           "texture": "reflectance", "volume": "sigma_t", "medium": "interior"}.get(case.category)  # fmt: skip
    named = f' name="{use}"' if use else ""
    return f'<{case.category} type="{case.plugin}"{named}>{"".join(parts)}</{case.category}>'


_FILM = '<film type="hdrfilm"><integer name="width" value="{}"/><integer name="height" value="{}"/></film>'
_SENSOR = '<sensor type="perspective"><float name="fov" value="40"/>{}</sensor>'
_PLY = '<shape type="ply"><string name="filename" value="a.ply"/>{}</shape>'
_FOG = '<shape type="sphere"><bsdf type="null"/>{}</shape>'


def scene(case: Case) -> str:
    """The text of the file."""
    made, category = element(case), case.category
    light, sensor, rest = '<emitter type="constant"/>', _SENSOR.format(_FILM.format(8, 8)), ""
    if category == "bsdf":
        rest = f'<shape type="sphere">{made}</shape>'
    elif category == "emitter" and case.plugin in ("area", "directionalarea"):
        rest = _PLY.format(made)
    elif category == "emitter":
        light, rest = made, _PLY.format("")
    elif category in ("film", "sampler"):
        sensor = _SENSOR.format(made)
    elif category == "rfilter":
        sensor = _SENSOR.format(_FILM.format(8, 8).replace("</film>", f"{made}</film>"))
    elif category == "sensor":
        sensor = "" if case.plugin == "irradiancemeter" else made
        rest = _PLY.format(made if case.plugin == "irradiancemeter" else "")
    elif category == "medium":
        rest = _FOG.format(made)
    elif category == "phase":
        rest = _FOG.format(f'<medium type="homogeneous" name="interior">{made}</medium>')
    elif category == "volume":
        rest = _FOG.format(f'<medium type="heterogeneous" name="interior">{made}</medium>')
    elif category == "texture" or (category == "spectrum" and 'name="reflectance"' in made):
        rest = _PLY.format(f'<bsdf type="diffuse">{made}</bsdf>')
    elif category == "spectrum":
        rest = _PLY.format(f'<emitter type="area">{made}</emitter>')
    elif case.plugin == "instance":
        rest = '<shape type="shapegroup" id="group"><shape type="sphere"/></shape>' + made
    else:
        rest = made
    if category != "integrator":
        integrator = "volpath" if "<medium" in rest else "path"
        rest = f'<integrator type="{integrator}"/>' + rest
    return f'<scene version="3.0.0">\n{sensor}{light}{rest}</scene>'


def files(folder: Path) -> None:
    """Writes the files that the scenes name."""
    Image.fromarray(np.arange(96, dtype=np.uint8).reshape(4, 8, 3)).save(folder / "a.png")
    (folder / "a.obj").write_text(
        "v 0 0 0\nv 1 0 0\nv 0 1 0\nvt 0 0\nvt 1 0\nvt 0 1\nf 1/1 2/2 3/3\n"
    )
    head = "ply\nformat ascii 1.0\nelement vertex 3\n"
    head += "".join(f"property float {a}\n" for a in ("x", "y", "z", "u", "v", "r", "g", "b"))
    head += "element face 1\nproperty list uchar int vertex_indices\n"
    head += "".join(f"property float {a}\n" for a in "rgb") + "end_header\n"
    rows = "0 0 0 0 0 .1 .2 .3\n1 0 0 1 0 .1 .2 .3\n0 1 0 0 1 .1 .2 .3\n3 0 1 2 .4 .5 .6\n"
    (folder / "a.ply").write_text(head + rows)
    names = ["x", "y", "z", "nx", "ny", "nz", *(f"f_dc_{k}" for k in range(3)), "opacity"]
    names += [*(f"scale_{k}" for k in range(3)), *(f"rot_{k}" for k in range(4))]
    head = "ply\nformat binary_little_endian 1.0\nelement vertex 1\n"
    head += "".join(f"property float {name}\n" for name in names) + "end_header\n"
    numbers = struct.pack("<17f", *([0] * 9), 1, -1, -2, -3, 1, 0, 0, 0)
    (folder / "a.gaussians.ply").write_bytes(head.encode() + numbers)
    corners = struct.pack("<9f3I", 0, 0, 0, 1, 0, 0, 0, 1, 0, 0, 1, 2)
    body = zlib.compress(struct.pack("<I", 0x1000) + b"m\0" + struct.pack("<QQ", 3, 1) + corners)
    part = struct.pack("<HH", 0x041C, 4) + body
    (folder / "a.serialized").write_bytes(part + struct.pack("<QI", 0, 1))
    (folder / "a.txt").write_text("".join(f"{0.1 * k} 0 0 0.05\n" for k in range(5)))
    cells = np.abs(np.linspace(-0.5, 0.5, 27)).astype("<f4")
    box = b"VOL\3" + struct.pack("<5i6f", 1, 3, 3, 3, 1, 0, 0, 0, 1, 1, 1)
    (folder / "a.vol").write_bytes(box + cells.tobytes())
    six = np.broadcast_to(np.array([1, 0.5, 0.25, 0, 0, 0], "<f4"), (8, 6))
    box = b"VOL\3" + struct.pack("<5i6f", 1, 2, 2, 2, 6, 0, 0, 0, 1, 1, 1)
    (folder / "s.vol").write_bytes(box + six.tobytes())
    (folder / "a.bsdf").write_bytes(b"tensor_file")
    (folder / "a.pbsdf").write_bytes(b"tensor_file")


def dictionary(text: str, folder: Path) -> dict[str, Any]:
    """The dictionary that means the same as a file."""

    def made(node: etree._Element) -> Any:
        value = node.get("value") or ""
        plain = {"float": float, "integer": int, "boolean": lambda t: t == "true"}
        if node.tag in plain:
            return plain[node.tag](value)  # type: ignore[operator]
        if node.tag == "string":
            return str(folder / value) if node.get("name") == "filename" else value
        if node.tag == "rgb":
            return {"type": "rgb", "value": [float(x) for x in value.split()]}
        if node.tag == "spectrum" and node.get("type") is None:
            pairs = [tuple(map(float, pair.split(":"))) for pair in value.replace(",", " ").split()]
            return {"type": "spectrum", "value": pairs}
        if node.tag in ("point", "vector"):
            return [float(x) for x in value.split()]
        if node.tag == "transform":
            return np.array([float(x) for x in (node[0].get("value") or "").split()]).reshape(4, 4)
        if node.tag == "ref":
            return {"type": "ref", "id": node.get("id")}
        result: dict[str, Any] = {"type": node.get("type", "scene")}
        for number, child in enumerate(node):
            key = child.get("name") or child.get("id") or f"{child.tag}_{number}"
            result[key] = made(child)
        return result

    found: dict[str, Any] = made(etree.fromstring(text))
    return found


@dataclass(frozen=True)
class Outcome:
    """What became of a scene: its hash, or the fault; its warnings and notes without their places."""

    hash: str
    fault: str
    warnings: frozenset[str]
    notes: frozenset[str]
    where: str = ""


def outcome(content: str | dict[str, Any], folder: Path) -> Outcome:
    """Reads a scene."""

    def plain(text: str) -> str:
        text = text.replace(f"{folder}/", "")
        head, _, tail = text.partition(": ")
        return tail if head.startswith(("scene", str(folder))) else text

    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always")
        try:
            if isinstance(content, str):
                (folder / "scene.xml").write_text(content, "utf-8")
                found = vr.load_file(folder / "scene.xml")
            else:
                found = vr.load_dict(content)
        except SceneError as error:
            return Outcome("", plain(str(error)), frozenset(), frozenset(), str(error.where))
    told = frozenset(plain(str(one.message)) for one in caught)
    notes = frozenset(map(plain, found.notes)) - told
    assert math.isfinite(float(found.camera.fov))
    return Outcome(found.sha256, "", told, notes)
