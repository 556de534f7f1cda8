"""The closed list of scene objects and their parameters: for checks, messages and documentation.

To add an object, add it here and in `build`.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from math import inf
from typing import Any

from ..camera import FILTERS, FOV_AXES, MAX_PIXELS
from ..columns import MATERIAL_KINDS, MAX_ETA, OPAQUE_KINDS
from ..numeric import MAX_COORDINATE
from ..settings import SETTINGS

REQUIRED = object()
COLOUR = "rgb, spectrum or number"
IOR = "number or name"
_ACCEPTED = {
    "float": ("float", "integer"),
    COLOUR: ("rgb", "spectrum", "float", "integer"),
    IOR: ("float", "integer", "string"),
    "point": ("point", "vector"),
    "vector": ("point", "vector"),
}


@dataclass(frozen=True)
class Param:
    """One parameter: kind, default, range (without its ends if `open`), choices, meaning, and the
    column of the scene that it fills; "" for what `build` and `materials` convert."""

    kind: str
    default: Any = None
    low: float = -inf
    high: float = inf
    open: bool = False
    choices: tuple[Any, ...] = ()
    doc: str = ""
    column: str = ""

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


#: Refractive indices by name, as in Mitsuba 3.
IORS = {
    "vacuum": 1.0, "helium": 1.000036, "hydrogen": 1.000132, "air": 1.000277,
    "carbon dioxide": 1.00045, "water": 1.333, "acetone": 1.36, "ethanol": 1.361,
    "carbon tetrachloride": 1.461, "glycerol": 1.4729, "benzene": 1.501, "silicone oil": 1.52045,
    "bromine": 1.661, "water ice": 1.31, "fused quartz": 1.458, "pyrex": 1.47,
    "acrylic glass": 1.49, "polypropylene": 1.49, "bk7": 1.5046, "sodium chloride": 1.544,
    "amber": 1.55, "pet": 1.575, "diamond": 2.419,
}  # fmt: skip

_MANY = 10**9
_CROP = "crop windows are not supported; render the whole film"
_BLUR = "motion blur is not supported"
_TO_WORLD = Param("transform", doc="local to world space; default the identity")
_PLACED = {
    "to_world": _TO_WORLD,
    "flip_normals": Param("boolean", False, doc="swap front and back"),
}
_UNMASKED = (*OPAQUE_KINDS, "twosided", *(k for k in MATERIAL_KINDS if k not in OPAQUE_KINDS))
_BSDFS = (*_UNMASKED, "mask")
_SHAPES = ("obj", "ply", "stl", "rectangle", "disk", "cube", "sphere")
_ON_SHAPES: dict[str, tuple[tuple[str, ...], int, int]] = {
    "bsdf": (_BSDFS, 0, 1),
    "emitter": (("area",), 0, 1),
    "medium": (("homogeneous",), 0, 2),
}
_MESH = {
    "filename": Param("string", REQUIRED, doc="mesh file, relative to the scene file"),
    "face_normals": Param(
        "boolean", False, doc="flat shading; else the file's vertex normals, or computed ones"
    ),
    **_PLACED,
}


def _flip_uv(default: bool) -> dict[str, Param]:
    doc = "v of a texture coordinate is 1 - v of the file"
    return {"flip_tex_coords": Param("boolean", default, doc=doc)}


_RADIANCE = Param(COLOUR, 1.0, 0.0, doc="emitted radiance, linear RGB")
_SHARE: dict[str, Any] = {"low": 0.0, "high": 1.0}
_INT_IOR = Param(IOR, "bk7", 0.1, 10.0, doc="refractive index inside (behind the front)")
_EXT_IOR = Param(IOR, "air", 0.1, 10.0, doc="refractive index outside")
_SPECULAR = Param(
    COLOUR, 1.0, **_SHARE, doc="factor on reflected light", column="specular_reflectance"
)
_GLASS = {
    "int_ior": _INT_IOR,
    "ext_ior": _EXT_IOR,
    "specular_reflectance": _SPECULAR,
    "specular_transmittance": Param(
        COLOUR, 1.0, **_SHARE, doc="factor on transmitted light", column="specular_transmittance"
    ),
}


def _setting(name: str, doc: str) -> Param:
    setting = SETTINGS[name]
    return Param("integer", setting.scene, setting.low or 0, setting.high, doc=doc)


_PATH = Plugin(
    "integrator",
    {
        "max_depth": _setting("max_depth", "path length, -1 unlimited"),
        "rr_depth": _setting("rr_depth", "first depth with roulette"),
        "hide_emitters": Param("boolean", False, choices=(False,)),
    },
    doc="path tracing with next-event estimation; media always count",
)
_PERSPECTIVE = {
    "fov": Param("float", None, 0.0, 180.0, open=True, doc="degrees; or focal_length"),
    "fov_axis": Param("string", "x", choices=FOV_AXES),
    "focal_length": Param("string", None, doc='on 35 mm film, as "50mm"'),
    "near_clip": Param("float", 0.0, 0.0, MAX_COORDINATE, open=True, doc="default none"),
    "far_clip": Param("float", inf, 0.0, MAX_COORDINATE, open=True, doc="default none"),
    "to_world": _TO_WORLD,
}
#: Mitsuba's stratified samplers.
STRATIFIED = ("stratified", "multijitter", "ldsampler")
_SAMPLER: dict[str, Any] = {
    "sample_count": Param("integer", 4, 1, 2**63 - 1, doc="samples per pixel"),
    "seed": Param("integer", 0, 0, 2**64 - 1),
}
_ON_SENSORS: dict[str, tuple[tuple[str, ...], int, int]] = {
    "film": (("hdrfilm",), 0, 1),
    "sampler": (("independent", *STRATIFIED), 0, 1),
    "medium": (("homogeneous",), 0, 1),
}
_COEFFICIENT: dict[str, Any] = {"low": 0.0, "high": MAX_COORDINATE}

PLUGINS: dict[str, Plugin] = {
    "scene": Plugin(
        "scene",
        children={
            "integrator": (("path", "volpath"), 0, 1),
            "sensor": (("perspective", "thinlens"), 1, 1),
            "emitter": (("constant", "envmap", "point", "spot", "directional"), 0, _MANY),
            "shape": (_SHAPES, 0, _MANY),
            "bsdf": (_BSDFS, 0, _MANY),
            "medium": (("homogeneous",), 0, _MANY),
        },
    ),
    "path": _PATH,
    "volpath": _PATH,
    "perspective": Plugin(
        "sensor",
        {
            **_PERSPECTIVE,
            "principal_point_offset_x": Param("float", 0.0, -1e3, 1e3, doc="in film widths"),
            "principal_point_offset_y": Param("float", 0.0, -1e3, 1e3, doc="in film heights"),
            "focus_distance": Param("float", None, 0.0, doc="without effect on a pinhole"),
        },
        _ON_SENSORS,
        {
            "shutter_open": _BLUR,
            "shutter_close": _BLUR,
            "aperture_radius": 'depth of field needs the sensor "thinlens"',
        },
        doc="pinhole; a medium in it is the one that it stands in",
    ),
    "thinlens": Plugin(
        "sensor",
        {
            **_PERSPECTIVE,
            "aperture_radius": Param("float", REQUIRED, 0.0, MAX_COORDINATE, doc="0: pinhole"),
            "focus_distance": Param(
                "float", REQUIRED, 0.0, MAX_COORDINATE, open=True, doc="to the plane in focus"
            ),
        },
        _ON_SENSORS,
        {"shutter_open": _BLUR, "shutter_close": _BLUR},
        doc="lens with a round aperture",
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
        {"rfilter": (FILTERS, 0, 1)},
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
    "mitchell": Plugin(
        "rfilter",
        {name: Param("float", 1.0 / 3.0, **_SHARE) for name in "BC"},
        doc="Mitchell and Netravali, 1988; 4 pixels wide, with negative lobes",
    ),
    "independent": Plugin("sampler", _SAMPLER),
    **{name: Plugin("sampler", _SAMPLER, doc="runs as sampler sobol") for name in STRATIFIED},
    "rectangle": Plugin("shape", _PLACED, _ON_SHAPES, doc="[-1, 1]^2 at z = 0, front towards +z"),
    "disk": Plugin("shape", _PLACED, _ON_SHAPES, doc="unit disc at z = 0, front towards +z"),
    "cube": Plugin("shape", _PLACED, _ON_SHAPES, doc="[-1, 1]^3, front outside"),
    "sphere": Plugin(
        "shape",
        {
            "center": Param("point", (0.0, 0.0, 0.0), -MAX_COORDINATE, MAX_COORDINATE),
            "radius": Param("float", 1.0, 0.0, MAX_COORDINATE, open=True),
            **_PLACED,
        },
        _ON_SHAPES,
        doc="exact; to_world scales alike in all directions; front outside, inside if it mirrors",
    ),
    "obj": Plugin("shape", {**_MESH, **_flip_uv(True)}, _ON_SHAPES, doc="Wavefront OBJ"),
    "ply": Plugin("shape", {**_MESH, **_flip_uv(False)}, _ON_SHAPES, doc="Stanford PLY"),
    "stl": Plugin(
        "shape",
        {**_MESH, "face_normals": Param("boolean", True, choices=(True,))},
        _ON_SHAPES,
        doc="STL, flat; not in Mitsuba",
    ),
    "diffuse": Plugin(
        "bsdf",
        {"reflectance": Param(COLOUR, 0.5, **_SHARE, column="reflectance")},
        doc="Lambertian; black from behind unless inside twosided",
    ),
    "conductor": Plugin(
        "bsdf",
        {
            "material": Param("string", None, doc='"none", an ideal mirror, unless eta and k'),
            "eta": Param(COLOUR, None, 0.0, MAX_ETA, doc="real part of the refractive index"),
            "k": Param(COLOUR, None, 0.0, MAX_ETA, doc="imaginary part"),
            "ext_eta": Param("float", 1.0, 0.1, 10.0, doc="index outside; not in Mitsuba"),
            "specular_reflectance": _SPECULAR,
        },
        doc="smooth metal",
    ),
    "dielectric": Plugin("bsdf", _GLASS, doc="smooth boundary of a clear material"),
    "thindielectric": Plugin("bsdf", _GLASS, doc="pane: two boundaries, too close to refract"),
    "plastic": Plugin(
        "bsdf",
        {
            "diffuse_reflectance": Param(
                COLOUR, 0.5, **_SHARE, doc="of the base", column="reflectance"
            ),
            "int_ior": Param(IOR, "polypropylene", 0.1, 10.0, doc="refractive index of the coat"),
            "ext_ior": _EXT_IOR,
            "specular_reflectance": _SPECULAR,
            "nonlinear": Param(
                "boolean", False, doc="colour shifts by internal scattering", column="nonlinear"
            ),
        },
        doc="smooth clear coat on a diffuse base",
    ),
    "null": Plugin("bsdf", doc="invisible; bounds media"),
    "mask": Plugin(
        "bsdf",
        {"opacity": Param("float", 0.5, **_SHARE, doc="share that is there", column="opacity")},
        {"bsdf": (_UNMASKED, 1, 1)},
        doc="partly transparent",
    ),
    "twosided": Plugin("bsdf", {}, {"bsdf": (OPAQUE_KINDS, 1, 1)}, doc="both sides reflect"),
    "homogeneous": Plugin(
        "medium",
        {
            "sigma_t": Param(COLOUR, None, **_COEFFICIENT, doc="extinction; default 1"),
            "albedo": Param(COLOUR, None, **_SHARE, doc="default 0.75"),
            "sigma_s": Param(COLOUR, None, **_COEFFICIENT, doc="scattering; not in Mitsuba"),
            "sigma_a": Param(COLOUR, None, **_COEFFICIENT, doc="absorption; not in Mitsuba"),
            "scale": Param("float", 1.0, **_COEFFICIENT, doc="factor on the coefficients"),
            "sample_emitters": Param("boolean", True, choices=(True,)),
        },
        {"phase": (("isotropic", "hg"), 0, 1)},
        doc="per unit length of the world; sigma_t and albedo, or sigma_s and sigma_a",
    ),
    "isotropic": Plugin("phase", doc="default"),
    "hg": Plugin(
        "phase",
        {
            "g": Param(
                "float", 0.8, -1.0, 1.0, open=True, doc="mean cosine; > 0 forward", column="phase_g"
            )
        },
        doc="Henyey and Greenstein",
    ),
    "area": Plugin("emitter", {"radiance": _RADIANCE}, doc="emits on the shape's front side"),
    "constant": Plugin("emitter", {"radiance": _RADIANCE}, doc="the same in every direction"),
    "envmap": Plugin(
        "emitter",
        {
            "filename": Param("string", None, doc="EXR, HDR, PFM; PNG and JPEG are sRGB"),
            "bitmap": Param("array", None, doc="instead, in a dictionary: (H, W, 3) radiances"),
            "scale": Param("float", 1.0, 0.0, doc="factor on the radiance"),
            "to_world": Param("transform", doc="no scale; the upper edge is at local +y"),
            "mis_compensation": Param("boolean", False, doc="changes noise alone; ignored"),
        },
        doc="radiance by direction: latitudes and longitudes; the middle column is at local +z",
    ),
    "point": Plugin(
        "emitter",
        {
            "position": Param("point", None, -MAX_COORDINATE, MAX_COORDINATE, doc="or to_world"),
            "to_world": _TO_WORLD,
            "intensity": Param(
                COLOUR, 1.0, 0.0, doc="power per steradian", column="light_intensity"
            ),
        },
    ),
    "spot": Plugin(
        "emitter",
        {
            "to_world": Param("transform", doc="no scale; it shines along local +z"),
            "intensity": Param(
                COLOUR, 1.0, 0.0, doc="power per steradian on the axis", column="light_intensity"
            ),
            "cutoff_angle": Param("float", 20.0, 0.0, 180.0, doc="degrees from the axis to dark"),
            "beam_width": Param("float", None, 0.0, 180.0, doc="to the end of full light; 3/4"),
        },
        unsupported={"texture": "textures are not supported"},
        doc="falls off linearly with the angle from beam_width to cutoff_angle",
    ),
    "directional": Plugin(
        "emitter",
        {
            "direction": Param("vector", None, -MAX_COORDINATE, MAX_COORDINATE, doc="or to_world"),
            "to_world": Param("transform", doc="it shines along local +z"),
            "irradiance": Param(
                COLOUR, 1.0, 0.0, doc="on a surface that faces it", column="light_intensity"
            ),
        },
        doc="the sun: parallel light",
    ),
}
CATEGORIES = tuple(dict.fromkeys(plugin.category for plugin in PLUGINS.values()))


def of_category(category: str) -> list[str]:
    """Names of the plugins of a category."""
    return [name for name, plugin in PLUGINS.items() if plugin.category == category]


def describe() -> str:
    """The table of objects and parameters as Markdown, for the documentation."""
    rows = ["| object | parameter | type | default | allowed | meaning |", "|" + " --- |" * 6]
    for name, plugin in PLUGINS.items():
        holds = f"holds {', '.join(plugin.children)}" if plugin.children else ""
        rows.append(f"| {plugin.category} `{name}` | | | | {holds} | {plugin.doc} |")
        for key, param in plugin.params.items():
            default = "required" if param.default is REQUIRED else param.default
            limits = ", ".join(str(choice) for choice in param.choices)
            if param.kind in ("float", "integer", COLOUR, IOR) and (param.low, param.high) != (
                -inf,
                inf,
            ):
                limits = f"{'>' if param.open else '>='} {param.low:g}"
                if param.high < inf:
                    limits += f", {'<' if param.open else '<='} {param.high:g}"
            if isinstance(default, float):
                default = f"{default:.4g}"
            shown = "" if default is None else default
            rows.append(f"| | `{key}` | {param.kind} | {shown} | {limits} | {param.doc} |")
    names = ", ".join(f"{name} {value:g}" for name, value in IORS.items())
    return "\n".join(rows) + f"\n\nRefractive indices by name: {names}.\n"
