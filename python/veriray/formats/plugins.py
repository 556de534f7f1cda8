"""The closed list of scene objects and their parameters: for checks, messages and documentation.

To add an object, add it here and in `build`.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from math import inf
from typing import Any

from ..scene import FOV_AXES, MAX_COORDINATE, MAX_PATH_DEPTH, MAX_PIXELS

REQUIRED = object()
COLOUR = "rgb, spectrum or number"
_ACCEPTED = {
    "float": ("float", "integer"),
    COLOUR: ("rgb", "spectrum", "float", "integer"),
}


@dataclass(frozen=True)
class Param:
    """One parameter: kind, default, range (open at an end if in `excluded`), choices, meaning."""

    kind: str
    default: Any = None
    low: float = -inf
    high: float = inf
    open: bool = False
    choices: tuple[Any, ...] = ()
    doc: str = ""

    @property
    def accepted(self) -> tuple[str, ...]:
        """Kinds of values that a file or a dictionary may give."""
        return _ACCEPTED.get(self.kind, (self.kind,))


@dataclass(frozen=True)
class Plugin:
    """One kind of object. children: category -> (plugins allowed there, fewest, most);
    unsupported: parameter of Mitsuba's -> what to do instead."""

    category: str
    params: dict[str, Param] = field(default_factory=dict)
    children: dict[str, tuple[tuple[str, ...], int, int]] = field(default_factory=dict)
    unsupported: dict[str, str] = field(default_factory=dict)
    doc: str = ""


_MANY = 10**9
_CROP = "crop windows are not supported; render the whole film"
_TO_WORLD = Param("transform", doc="local to world space; default the identity")
_FLIP = Param("boolean", False, doc="swap front and back")
_SHAPE_CHILDREN = {"bsdf": (("diffuse", "twosided"), 0, 1), "emitter": (("area",), 0, 1)}
_MESH = {
    "filename": Param("string", REQUIRED, doc="mesh file, relative to the scene file"),
    "face_normals": Param(
        "boolean", False, doc="flat shading; needed unless the mesh is flat anyway"
    ),
    "to_world": _TO_WORLD,
    "flip_normals": _FLIP,
}
_RADIANCE = Param(COLOUR, 1.0, 0.0, doc="emitted radiance, linear RGB")

PLUGINS: dict[str, Plugin] = {
    "scene": Plugin(
        "scene",
        children={
            "integrator": (("path",), 0, 1),
            "sensor": (("perspective",), 1, 1),
            "emitter": (("constant",), 0, 1),
            "shape": (("rectangle", "cube", "obj", "ply"), 0, _MANY),
            "bsdf": (("diffuse", "twosided"), 0, _MANY),
        },
    ),
    "path": Plugin(
        "integrator",
        {
            "max_depth": Param("integer", -1, -1, MAX_PATH_DEPTH, doc="path length, -1 unlimited"),
            "rr_depth": Param("integer", 5, 1, 2**31 - 1, doc="first depth with roulette"),
            "hide_emitters": Param("boolean", False, choices=(False,)),
        },
        doc="path tracing with next-event estimation",
    ),
    "perspective": Plugin(
        "sensor",
        {
            "fov": Param("float", None, 0.0, 180.0, open=True, doc="degrees; or focal_length"),
            "fov_axis": Param("string", "x", choices=FOV_AXES),
            "focal_length": Param("string", None, doc='on 35 mm film, as "50mm"'),
            "near_clip": Param("float", 0.0, 0.0, MAX_COORDINATE, open=True, doc="default none"),
            "far_clip": Param("float", inf, 0.0, MAX_COORDINATE, open=True, doc="default none"),
            "principal_point_offset_x": Param("float", 0.0, -1e3, 1e3, doc="in film widths"),
            "principal_point_offset_y": Param("float", 0.0, -1e3, 1e3, doc="in film heights"),
            "focus_distance": Param("float", None, 0.0, doc="without effect on a pinhole"),
            "to_world": _TO_WORLD,
        },
        {"film": (("hdrfilm",), 0, 1), "sampler": (("independent",), 0, 1)},
        {
            "shutter_open": "motion blur is not supported",
            "shutter_close": "motion blur is not supported",
            "aperture_radius": "depth of field is not supported",
        },
    ),
    "hdrfilm": Plugin(
        "film",
        {
            "width": Param("integer", 768, 1, MAX_PIXELS),
            "height": Param("integer", 576, 1, MAX_PIXELS),
            "pixel_format": Param("string", "rgb", choices=("rgb",)),
            "component_format": Param(
                "string", "float32", choices=("float16", "float32"), doc="float32 is written"
            ),
            "file_format": Param("string", "openexr", choices=("openexr",)),
        },
        {"rfilter": (("box", "tent", "gaussian"), 0, 1)},
        {
            **{f"crop_{name}": _CROP for name in ("width", "height", "offset_x", "offset_y")},
            "sample_border": "samples never fall outside the film here; leave it out",
        },
    ),
    "box": Plugin("rfilter", doc="one pixel wide"),
    "tent": Plugin("rfilter", {"radius": Param("float", 1.0, 1e-3, 100.0, doc="pixels")}),
    "gaussian": Plugin(
        "rfilter", {"stddev": Param("float", 0.5, 1e-3, 100.0, doc="pixels; cut at 4 stddev")}
    ),
    "independent": Plugin(
        "sampler",
        {
            "sample_count": Param("integer", 4, 1, 2**63 - 1, doc="samples per pixel"),
            "seed": Param("integer", 0, 0, 2**64 - 1),
        },
    ),
    "rectangle": Plugin(
        "shape",
        {"to_world": _TO_WORLD, "flip_normals": _FLIP},
        _SHAPE_CHILDREN,
        doc="[-1, 1]^2 at z = 0, front towards +z",
    ),
    "cube": Plugin(
        "shape",
        {"to_world": _TO_WORLD, "flip_normals": _FLIP},
        _SHAPE_CHILDREN,
        doc="[-1, 1]^3, front outside",
    ),
    "obj": Plugin("shape", _MESH, _SHAPE_CHILDREN, doc="Wavefront OBJ"),
    "ply": Plugin("shape", _MESH, _SHAPE_CHILDREN, doc="Stanford PLY"),
    "diffuse": Plugin(
        "bsdf",
        {"reflectance": Param(COLOUR, 0.5, 0.0, 1.0)},
        doc="Lambertian; black from behind unless inside twosided",
    ),
    "twosided": Plugin("bsdf", {}, {"bsdf": (("diffuse",), 1, 1)}, doc="both sides reflect"),
    "area": Plugin("emitter", {"radiance": _RADIANCE}, doc="emits on the shape's front side"),
    "constant": Plugin("emitter", {"radiance": _RADIANCE}, doc="the same in every direction"),
}
CATEGORIES = tuple(dict.fromkeys(plugin.category for plugin in PLUGINS.values()))


def of_category(category: str) -> list[str]:
    """Names of the plugins of a category."""
    return [name for name, plugin in PLUGINS.items() if plugin.category == category]


def describe() -> str:
    """The table of objects and parameters as Markdown, for the documentation."""
    rows = ["| object | parameter | type | default | allowed | meaning |", "|" + " --- |" * 6]
    for name, plugin in PLUGINS.items():
        rows.append(f"| {plugin.category} `{name}` | | | | | {plugin.doc} |")
        for key, param in plugin.params.items():
            default = "required" if param.default is REQUIRED else param.default
            limits = ", ".join(str(choice) for choice in param.choices)
            if param.kind in ("float", "integer", COLOUR) and (param.low, param.high) != (
                -inf,
                inf,
            ):
                limits = f"{'>' if param.open else '>='} {param.low:g}"
                if param.high < inf:
                    limits += f", {'<' if param.open else '<='} {param.high:g}"
            shown = "" if default is None else default
            rows.append(f"| | `{key}` | {param.kind} | {shown} | {limits} | {param.doc} |")
    return "\n".join(rows) + "\n"
