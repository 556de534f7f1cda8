"""The closed list of scene objects and their parameters: for checks, messages and documentation.

To add an object, add it here and in `build`.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field, replace
from math import inf
from typing import Any

from ..camera import FILTERS, FOV_AXES, MAX_PIXELS, MOST_LOBES
from ..columns import (
    DISTRIBUTIONS,
    LIGHT_KINDS,
    MATERIAL_KINDS,
    MAX_ALPHA,
    MAX_ETA,
    MAX_IOR,
    OPAQUE_KINDS,
    OPEN_KINDS,
    PRINCIPLED,
    PRINCIPLED_THIN,
    SHADOWINGS,
    TEXTURABLE,
    TEXTURE_FILTERS,
    TEXTURE_WRAPS,
    WHOLE_KINDS,
)
from ..numeric import MAX_COORDINATE
from ..settings import SETTINGS
from .metals import NAMES
from .node import Node
from .spectra import PLUGINS as SPECTRA

REQUIRED = object()
COLOUR = "rgb, spectrum or number"
IOR = "number or name"
GREY = "number or grey"
_ACCEPTED = {
    "float": ("float", "integer"),
    COLOUR: ("rgb", "spectrum", "float", "integer"),
    IOR: ("float", "integer", "string"),
    GREY: ("float", "integer", "rgb", "spectrum"),
    "point": ("point", "vector"),
    "vector": ("point", "vector"),
}


@dataclass(frozen=True)
class Param:
    """One parameter: kind, default, range (without its ends if `open`), choices, meaning, and the
    column of the scene that it fills; "" for what `build` and `materials` convert.

    light_texture: it is light, of which a texture may be a factor. field: of a checkerboard, the
    column that names the texture in its place.
    note: what to say where another value than the default is given, which changes no light. beyond:
    a "share", "light", "near" or "sign", of which Mitsuba takes values outside the range too
    (see `values`).
    """

    kind: str
    default: Any = None
    low: float = -inf
    high: float = inf
    open: bool = False
    choices: tuple[Any, ...] = ()
    doc: str = ""
    column: str = ""
    note: str = ""
    beyond: str = ""
    light_texture: bool = False
    field: str = ""

    @property
    def accepted(self) -> tuple[str, ...]:
        """Kinds of values that a file or a dictionary may give."""
        return _ACCEPTED.get(self.kind, (self.kind,))

    @property
    def texturable(self) -> bool:
        """Whether a texture may stand in its place."""
        return self.column in TEXTURABLE or self.light_texture or bool(self.field)


@dataclass(frozen=True)
class Plugin:
    """One kind of object. children: category -> (plugins allowed there, fewest, most);
    unsupported: parameter of Mitsuba's -> what to do instead; noted: parameter that changes no
    light -> why, whatever its type; lenient: why none that is not listed does, "" where one may."""

    category: str
    params: dict[str, Param] = field(default_factory=dict)
    children: dict[str, tuple[tuple[str, ...], int, int]] = field(default_factory=dict)
    unsupported: dict[str, str] = field(default_factory=dict)
    doc: str = ""
    noted: dict[str, str] = field(default_factory=dict)
    lenient: str = ""


_MANY = 10**9
#: Refractive indices by name, as in Mitsuba 3.
IORS = {
    "vacuum": 1.0, "helium": 1.000036, "hydrogen": 1.000132, "air": 1.000277,
    "carbon dioxide": 1.00045, "water": 1.333, "acetone": 1.36, "ethanol": 1.361,
    "carbon tetrachloride": 1.461, "glycerol": 1.4729, "benzene": 1.501, "silicone oil": 1.52045,
    "bromine": 1.661, "water ice": 1.31, "fused quartz": 1.458, "pyrex": 1.47,
    "acrylic glass": 1.49, "polypropylene": 1.49, "bk7": 1.5046, "sodium chloride": 1.544,
    "amber": 1.55, "pet": 1.575, "diamond": 2.419,
}  # fmt: skip

_CLOCK = ("year", "month", "day", "hour", "minute", "second")
SHUTTER = ("shutter_open", "shutter_close")
_SHUTTER = {
    **dict.fromkeys(SHUTTER, "nothing in the scene moves but the sun of a timed_sunsky"),
    "srf": "the picture is RGB, not the answer of a sensor to a spectrum",
}
_TO_WORLD = Param("transform", doc="local to world space; default the identity")
_PLACED = {
    "to_world": _TO_WORLD,
    "flip_normals": Param("boolean", False, doc="swap front and back"),
}
#: Of shapes that are meshes without smooth normals.
_FLAT = {"face_normals": Param("boolean", False, doc="without effect: its faces are flat")}
#: What stands for an ellipsoid of an ellipsoidsmesh.
SHELLS = ("box", "ico_sphere", "uv_sphere")
#: Of ellipsoids.
_ELLIPSOIDS = {
    "filename": Param("string", None, doc="PLY of Gaussians; or data or centers"),
    "data": Param("array", None, doc="in a dictionary: (N, 10) centers, scales and quaternions"),
    "centers": Param("array", None, doc="likewise (N, 3), with"),
    "scales": Param("array", None, doc="(N, 3) half axes over extent, and"),
    "quaternions": Param("array", None, doc="(N, 4) unit quaternions, the real part last"),
    "opacities": Param("array", None, doc="(N, 1), for extent_adaptive_clamping alone"),
    "sh_coeffs": Param("array", None, doc="without effect: the bsdf says the colour"),
    "scale_factor": Param("float", 1.0, 0.0, MAX_COORDINATE, open=True, doc="of a file's scales"),
    "extent": Param("float", 3.0, 0.0, MAX_COORDINATE, open=True, doc="half axes over scales"),
    "extent_adaptive_clamping": Param(
        "boolean", False, doc="extent: the root of 2 log(opacity / .01); none up to .01"
    ),
}
_GAIN = Param("float", 1.0, 0.0, doc="factor on what is in range, the rest clipped; of version 0.x")
_TO_UV = Param("transform", doc="of u and v, to the texture's own; default the identity")
_TEXTURES = ("bitmap", "checkerboard", "mesh_attribute", "volume")
#: Kinds that are no plugins but what a parameter makes of one.
_MADE = (*OPEN_KINDS.values(), *WHOLE_KINDS.values())
_OPAQUE = (*(k for k in OPAQUE_KINDS if k not in _MADE), "pplastic")
_MEDIA = ("homogeneous", "heterogeneous")
_VOLUMES = ("gridvolume", "constvolume")
CHANNELS = ("r", "g", "b", "a", "x", "y", "z")
_PHASES = ("isotropic", "hg", "rayleigh", "tabphase", "sggx", "blendphase")
VOLUME_FILTERS = ("trilinear", "nearest")
_UNMASKED = (
    *_OPAQUE,
    "twosided",
    *(k for k in MATERIAL_KINDS if k not in (*OPAQUE_KINDS, *_MADE, "hair")),
    "polarizer",
    "circular",
    "retarder",
)
#: Bsdfs that hold another one and turn its normals.
RELIEFS = ("bumpmap", "normalmap")
_UNBLENDED = (*_UNMASKED, "mask", *RELIEFS)
_BSDFS = (*_UNBLENDED, "blendbsdf")
_SHAPES = (
    "mesh",
    "obj",
    "ply",
    "stl",
    "serialized",
    "rectangle",
    "disk",
    "cube",
    "sphere",
    "cylinder",
    "linearcurve",
    "bsplinecurve",
    "sdfgrid",
    "ellipsoids",
    "ellipsoidsmesh",
)
_ON_SHAPES: dict[str, tuple[tuple[str, ...], int, int]] = {
    "bsdf": ((*_BSDFS, "hair"), 0, 1),
    "emitter": (("area", "directionalarea"), 0, 1),
    "medium": (_MEDIA, 0, 2),
    "sensor": (("irradiancemeter",), 0, _MANY),
}
_CREASE = "degrees between faces from which on an edge is sharp; of Mitsuba 0.x"
_MESH = {
    "filename": Param("string", REQUIRED, doc="mesh file, relative to the scene file"),
    "face_normals": Param(
        "boolean", False, doc="flat shading; else the file's vertex normals, or computed ones"
    ),
    "max_smooth_angle": Param("float", None, 0.0, 180.0, doc=_CREASE),
    "disable_vertex_normals": Param("boolean", False, doc="the older name of face_normals"),
    **_PLACED,
}
_CURVES = {
    "filename": Param(
        "string",
        REQUIRED,
        doc="text: x y z radius of a point a line, an empty line between curves; to_world leaves "
        "radii as they are",
    )
}


def _flip_uv(default: bool) -> dict[str, Param]:
    doc = "v of a texture coordinate is 1 - v of the file"
    return {"flip_tex_coords": Param("boolean", default, doc=doc)}


_RADIANCE = Param(COLOUR, 1.0, 0.0, doc="emitted radiance, linear RGB", beyond="light")
_SHARE: dict[str, Any] = {"low": 0.0, "high": 1.0}
_REFLECTED: dict[str, Any] = {**_SHARE, "beyond": "share"}
_INT_IOR = Param(IOR, "bk7", 0.1, 10.0, doc="refractive index inside (behind the front)")
_EXT_IOR = Param(IOR, "air", 0.1, 10.0, doc="refractive index outside")
_SPECULAR = Param(
    COLOUR, 1.0, **_REFLECTED, doc="factor on reflected light", column="specular_reflectance"
)
_GLASS = {
    "int_ior": _INT_IOR,
    "ext_ior": _EXT_IOR,
    "specular_reflectance": _SPECULAR,
    "specular_transmittance": Param(
        COLOUR,
        1.0,
        **_REFLECTED,
        doc="factor on transmitted light",
        column="specular_transmittance",
    ),
}
_TRANSMITTANCE = Param(COLOUR, 1.0, **_REFLECTED, doc="factor on transmitted light")
_UNPOLARISED = "polarisation is not rendered"
_METAL = {
    "material": Param("string", None, doc='a metal; default "none", a mirror'),
    "eta": Param(
        COLOUR,
        None,
        0.0,
        MAX_ETA,
        doc="real part of the refractive index",
        column="eta",
        beyond="sign",
    ),
    "k": Param(
        COLOUR,
        None,
        0.0,
        MAX_ETA,
        doc="imaginary part; 1, with k alone eta 0",
        column="k",
        beyond="sign",
    ),
    "ext_eta": Param("float", 1.0, 0.1, 10.0, doc="index outside; not in Mitsuba"),
    "specular_reflectance": _SPECULAR,
}
_PLASTIC = {
    "diffuse_reflectance": Param(
        COLOUR, 0.5, **_REFLECTED, doc="of the base", column="reflectance"
    ),
    "int_ior": Param(IOR, "polypropylene", 0.1, 10.0, doc="refractive index of the coat"),
    "ext_ior": _EXT_IOR,
    "specular_reflectance": _SPECULAR,
    "nonlinear": Param(
        "boolean", False, doc="colour shifts by internal scattering", column="nonlinear"
    ),
}
_ROUGH = {
    "distribution": Param("string", "beckmann", choices=DISTRIBUTIONS, doc="of the slopes"),
    "shadowing": Param(
        "string",
        "separable",
        choices=SHADOWINGS,
        doc="Smith's G; not in Mitsuba, which has the first",
    ),
    "alpha": Param(
        "float", None, 0.0, MAX_ALPHA, doc="root mean square slope; 0.1; below 1e-4 as 1e-4"
    ),
    "alpha_u": Param("float", None, 0.0, MAX_ALPHA, doc="with alpha_v, for alpha: along u"),
    "alpha_v": Param("float", None, 0.0, MAX_ALPHA, doc="with alpha_u: across u"),
    "sample_visible": Param("boolean", True, doc="changes no expectation and nothing here"),
}
_WHOLE = {
    "energy_compensation": Param(
        "boolean", False, doc="for light that meets several mirrors; one alpha; not in Mitsuba"
    )
}
#: A rough coat has tables for its one alpha.
_TEXTURED_ALPHA = {
    name: replace(_ROUGH[name], kind=GREY, column=column)
    for name, column in (("alpha", "alpha_u"), ("alpha_u", "alpha_u"), ("alpha_v", "alpha_v"))
}
_PRINCIPLED = {
    "base_color": Param(
        COLOUR, 0.5, **_REFLECTED, doc="of the diffuse part and the metal", column="reflectance"
    ),
    **{
        name: Param(GREY, default, **_SHARE, beyond="near", doc=doc, column=name)
        for name, (default, doc) in PRINCIPLED.items()
    },
    "eta": Param("float", None, 1 / MAX_IOR, MAX_IOR, doc="index inside over outside; or specular"),
    "specular": Param(
        "float", None, **_SHARE, beyond="near", doc="0.5; eta is 2 / (1 - sqrt(0.08 specular)) - 1"
    ),
}
_THIN = {
    **{
        name: param
        for name, param in _PRINCIPLED.items()
        if name not in ("metallic", "clearcoat", "clearcoat_gloss", "specular")
    },
    **{
        name: Param(GREY, default, 0.0, 2.0, doc=doc, column=name)
        for name, (default, doc) in PRINCIPLED_THIN.items()
    },
    "eta": Param("float", 1.5, 1 / MAX_IOR, MAX_IOR, doc="index of the sheet over that around it"),
}


def _relief(doc: str, **params: Param) -> Plugin:
    flips = "turn normals that look away from the viewer the other way about the surface's"
    return Plugin(
        "bsdf",
        {
            **params,
            "flip_invalid_normals": Param("boolean", True, doc=flips, column="relief_flips"),
            "use_shadowing_function": Param(
                "boolean", True, doc="less light from grazing directions", column="relief_shades"
            ),
        },
        {"bsdf": ((*_UNMASKED, "mask", "blendbsdf"), 1, 1)},
        doc=doc,
    )


def _setting(name: str, doc: str) -> Param:
    setting = SETTINGS[name]
    return Param("integer", setting.scene, setting.low or 0, setting.high, doc=doc)


_IN_PARTS = "how the work is cut does not change the picture"
_DERIVATIVES = "it concerns derivatives, not the picture"
_RUN = {
    **dict.fromkeys(("samples_per_pass", "block_size", "timeout"), _IN_PARTS),
    "strict_normals": "directions count only where both normals agree, always",
}
_HIDE = Param("boolean", False, doc="the camera sees no sky, and through lamps")


def _integrator(max_depth: int | None, doc: str, **noted: str) -> Plugin:
    """An integrator that runs as path; max_depth: its default, None if it has no such parameter."""
    params = {"hide_emitters": _HIDE}
    if max_depth is not None:
        default = _setting("max_depth", "path length, -1 unlimited")
        params = {
            "max_depth": replace(default, default=max_depth),
            "rr_depth": _setting("rr_depth", "first depth with roulette"),
            **params,
        }
    return Plugin("integrator", params, doc=doc, noted={**_RUN, **noted})


_SAME = "the same picture as path"
_PROJECTIVE = dict.fromkeys(
    (
        "sppc", "sppp", "sppi", "guiding", "guiding_proj", "guiding_rounds", "project_seed",
    ),
    _DERIVATIVES,
)  # fmt: skip
_REPARAM = {
    f"reparam_{name}": _DERIVATIVES
    for name in ("max_depth", "rays", "kappa", "exp", "antithetic", "unroll")
}
_COUNT = Param("integer", 1, 0, 2**31 - 1, note="the sampler's sample_count alone counts here")
_DIRECT = {
    "shading_samples": replace(_COUNT, low=1, doc="stands for both of the next"),
    "emitter_samples": replace(_COUNT, doc="0 only where no light is a point, spot or directional"),
    "bsdf_samples": replace(_COUNT, doc="0 only where nothing mirrors, refracts or lets through"),
}
#: Integrators that render paths.
_PATHS = {
    "path": _integrator(-1, "path tracing with next-event estimation; media always count"),
    "volpath": _integrator(-1, _SAME),
    "volpathmis": _integrator(-1, _SAME, use_spectral_mis="a choice of samples"),
    "prb": _integrator(6, _SAME),
    "prb_basic": _integrator(6, _SAME),
    "prbvolpath": _integrator(6, _SAME),
    "prb_projective": _integrator(6, _SAME, **_PROJECTIVE),
    "direct_projective": _integrator(None, "path with max_depth 2", **_PROJECTIVE),
    "prb_reparam": _integrator(6, _SAME, **_REPARAM),
    "direct_reparam": _integrator(None, "path with max_depth 2", **_REPARAM),
    "emission_reparam": _integrator(None, "path with max_depth 1", **_REPARAM),
    "ptracer": _integrator(-1, "by light from the lamps in Mitsuba, which misses mirror images"),
    "direct": Plugin(
        "integrator", {**_DIRECT, "hide_emitters": _HIDE}, doc="path with max_depth 2", noted=_RUN
    ),
}
#: Integrators that add planes to what another one renders.
_AROUND = ("moment", "aov", "stokes", "depth")
_INTEGRATORS = (*_PATHS, *_AROUND)


def _around(
    doc: str, fewest: int = 1, params: Mapping[str, Param] | None = None, **noted: str
) -> Plugin:
    return Plugin(
        "integrator",
        {"hide_emitters": _HIDE, **(params or {})},
        {"integrator": (_INTEGRATORS, fewest, _MANY)},
        doc=f"renders its first integrator; {doc}",
        noted={**_RUN, **noted},
    )


_PERSPECTIVE = {
    "fov": Param("float", None, 0.0, 180.0, open=True, doc="degrees; or focal_length, 50mm"),
    "fov_axis": Param("string", "x", choices=FOV_AXES),
    "focal_length": Param("string", None, doc='on 35 mm film, as "50mm"'),
    "near_clip": Param("float", 0.0, 0.0, MAX_COORDINATE, open=True, doc="default none"),
    "far_clip": Param("float", inf, 0.0, MAX_COORDINATE, open=True, doc="default none"),
    "to_world": _TO_WORLD,
}
#: Mitsuba's samplers. They say how many samples there are; how these are drawn changes no expected
#: picture, and is a setting of the render.
SAMPLERS = ("independent", "stratified", "multijitter", "orthogonal", "ldsampler")
#: Films; all but the first and the last are of version 0.x.
FILMS = ("hdrfilm", "ldrfilm", "tiledhdrfilm", "mfilm", "specfilm")
_SAMPLED = "it chooses samples, not what they are an estimate of"
_SAMPLER: dict[str, Any] = {
    "sample_count": Param("integer", 4, 1, 2**63 - 1, doc="samples per pixel"),
    "seed": Param("integer", 0, 0, 2**64 - 1),
}
_SENSORS = ("perspective", "thinlens", "orthographic", "radiancemeter")
_ON_SENSORS: dict[str, tuple[tuple[str, ...], int, int]] = {
    "film": (FILMS, 0, 1),
    "sampler": (SAMPLERS, 0, 1),
    "medium": (_MEDIA, 0, 1),
}
_COEFFICIENT: dict[str, Any] = {"low": 0.0, "high": MAX_COORDINATE}
_MEDIUM = {
    "scale": Param("float", 1.0, **_COEFFICIENT, doc="factor on the coefficients"),
    "sample_emitters": Param("boolean", True, note="light is sampled in media anyway"),
    "has_spectral_extinction": Param("boolean", True, note="the coefficients themselves say so"),
}
_IN_MEDIA: dict[str, tuple[tuple[str, ...], int, int]] = {
    "phase": (_PHASES, 0, 1),
    "volume": (_VOLUMES, 0, 2),
}

_WRITTEN = "the picture is written as render asks"
_BORDER = "samples outside the film are taken wherever the filter reaches there"


def _film(name: str) -> Plugin:
    return Plugin(
        "film",
        {
            "width": Param("integer", 768, 1, MAX_PIXELS),
            "height": Param("integer", 576, 1, MAX_PIXELS),
            **{
                f"crop_{size}": Param("integer", None, 1, MAX_PIXELS, doc="of the part to render")
                for size in ("width", "height")
            },
            **{
                f"crop_offset_{axis}": Param("integer", 0, 0, MAX_PIXELS, doc="where it begins")
                for axis in "xy"
            },
            "pixel_format": Param("string", "rgb", note="radiance is written as rgb"),
            "component_format": Param("string", None, doc="float32 is written"),
            "file_format": Param("string", "openexr", note=_WRITTEN),
            "sample_border": Param("boolean", False, note=_BORDER),
            "high_quality_edges": Param("boolean", False, note=_BORDER),
            "compensate": Param("boolean", False, note="sums are exact"),
            "banner": Param("boolean", False, note="no banner is drawn"),
        },
        {"rfilter": ((*FILTERS, "catmullrom"), 0, 1)},
        doc={
            "hdrfilm": "linear RGB",
            "specfilm": "as hdrfilm, with a warning: not its bands, which are spectra of any name",
        }.get(name, "as hdrfilm; of version 0.x"),
        noted={"filename": _WRITTEN},
        lenient="" if name == "hdrfilm" else _WRITTEN,
    )


PLUGINS: dict[str, Plugin] = {
    "scene": Plugin(
        "scene",
        children={
            "integrator": (_INTEGRATORS, 0, 1),
            "sensor": ((*_SENSORS, "distant", "batch"), 0, _MANY),
            "emitter": (("constant", "envmap", "sunsky", "timed_sunsky", *LIGHT_KINDS), 0, _MANY),
            "shape": ((*_SHAPES, "shapegroup", "instance", "merge"), 0, _MANY),
            "bsdf": ((*_BSDFS, "hair"), 0, _MANY),
            "medium": (_MEDIA, 0, _MANY),
            "texture": (_TEXTURES, 0, _MANY),
            "volume": (_VOLUMES, 0, _MANY),
        },
        noted={"embree_use_robust_intersections": "no ray passes between neighbours, ever"},
    ),
    **_PATHS,
    "moment": _around("moments are not written: stderr has the variance"),
    "aov": _around(
        "its planes are feature images; path if it has none",
        0,
        {"aovs": Param("string", "", doc="NAME:KIND, ...; see veriray.features")},
    ),
    "depth": _around("depths are a feature image; path if it has none", 0),
    "stokes": _around("polarisation is not"),
    "perspective": Plugin(
        "sensor",
        {
            **_PERSPECTIVE,
            "principal_point_offset_x": Param("float", 0.0, -1e9, 1e9, doc="in film widths"),
            "principal_point_offset_y": Param("float", 0.0, -1e9, 1e9, doc="in film heights"),
            "focus_distance": Param("float", None, 0.0, doc="without effect on a pinhole"),
        },
        _ON_SENSORS,
        {"aperture_radius": 'depth of field needs the sensor "thinlens"'},
        doc="pinhole; a medium in it is the one that it stands in",
        noted=_SHUTTER,
    ),
    "thinlens": Plugin(
        "sensor",
        {
            **_PERSPECTIVE,
            "aperture_radius": Param("float", REQUIRED, 0.0, MAX_COORDINATE, doc="0: pinhole"),
            "focus_distance": Param(
                "float",
                None,
                0.0,
                MAX_COORDINATE,
                open=True,
                doc="to the plane in focus; default far_clip, or 10,000 without one",
            ),
        },
        _ON_SENSORS,
        doc="lens with a round aperture",
        noted=_SHUTTER,
    ),
    "batch": Plugin(
        "sensor",
        {},
        {
            "film": (FILMS, 0, 1),
            "sampler": (SAMPLERS, 0, 1),
            "sensor": (_SENSORS, 1, _MANY),
        },
        doc="stands for its sensors, each with its share of the film's width",
        noted=_SHUTTER,
    ),
    "orthographic": Plugin(
        "sensor",
        {
            **{name: _PERSPECTIVE[name] for name in ("near_clip", "far_clip", "to_world")},
            "focus_distance": Param("float", None, 0.0, doc="without effect on parallel rays"),
        },
        _ON_SENSORS,
        doc="parallel rays; x in [-1, 1] of to_world, which may scale, is the film's width",
        noted=_SHUTTER,
    ),
    "radiancemeter": Plugin(
        "sensor",
        {
            "origin": Param("point", None, -MAX_COORDINATE, MAX_COORDINATE, doc="with direction"),
            "direction": Param("vector", None, -MAX_COORDINATE, MAX_COORDINATE, doc="or to_world"),
            "to_world": Param("transform", doc="the ray is local +z; counts before origin"),
        },
        _ON_SENSORS,
        doc="one ray; its film has 1 x 1 pixels",
        noted=_SHUTTER,
    ),
    "distant": Plugin(
        "sensor",
        {
            "direction": Param("vector", None, -MAX_COORDINATE, MAX_COORDINATE, doc="or to_world"),
            "to_world": Param("transform", doc="the rays are local +z"),
            "target": Param(
                "point",
                None,
                -MAX_COORDINATE,
                MAX_COORDINATE,
                doc="one ray goes there, or rays to all of a shape of that name, which is in the "
                "sensor; default: to a disc across the ball about the box of the scene",
            ),
        },
        {**_ON_SENSORS, "shape": (_SHAPES, 0, 1)},
        doc="parallel rays from outside of the scene; its film has 1 x 1 pixels",
        noted=_SHUTTER,
    ),
    "irradiancemeter": Plugin(
        "sensor",
        {},
        _ON_SENSORS,
        {"to_world": "it is where its shape is"},
        doc="in a shape: what falls on its front, by its area; box filter, the film lies over the "
        "shape as in Mitsuba",
        noted=_SHUTTER,
    ),
    **{name: _film(name) for name in FILMS},
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
    "catmullrom": Plugin("rfilter", doc="mitchell with B 0 and C 0.5"),
    "lanczos": Plugin(
        "rfilter",
        {"lobes": Param("integer", 3, 1, MOST_LOBES)},
        doc="sinc(x) sinc(x / lobes), 2 lobes pixels wide, with negative lobes",
    ),
    **{
        name: Plugin(
            "sampler",
            _SAMPLER,
            doc="the render's setting says how samples are drawn: sobol",
            lenient=_SAMPLED,
        )
        for name in SAMPLERS
    },
    "rectangle": Plugin(
        "shape", _PLACED | _FLAT, _ON_SHAPES, doc="[-1, 1]^2 at z = 0, front towards +z"
    ),
    "disk": Plugin("shape", _PLACED, _ON_SHAPES, doc="unit disc at z = 0, front towards +z"),
    "cube": Plugin("shape", _PLACED | _FLAT, _ON_SHAPES, doc="[-1, 1]^3, front outside"),
    "sphere": Plugin(
        "shape",
        {
            "center": Param("point", (0.0, 0.0, 0.0), -MAX_COORDINATE, MAX_COORDINATE),
            "radius": Param("float", 1.0, 0.0, MAX_COORDINATE, open=True),
            **_PLACED,
        },
        _ON_SHAPES,
        doc="exact; to_world scales alike in all directions; front outside, if it mirrors too; "
        "where an instance stretches it, a mesh of 65,024 triangles",
    ),
    "cylinder": Plugin(
        "shape",
        {
            "p0": Param("point", (0.0, 0.0, 0.0), -MAX_COORDINATE, MAX_COORDINATE),
            "p1": Param("point", (0.0, 0.0, 1.0), -MAX_COORDINATE, MAX_COORDINATE),
            "radius": Param("float", 1.0, 0.0, MAX_COORDINATE, open=True),
            **_PLACED,
        },
        _ON_SHAPES,
        doc="from p0 to p1, without caps, front outside; a prism of 256 sides with smooth normals: "
        "up to 7.6e-5 of the radius thinner, area 2.6e-5 smaller",
    ),
    "linearcurve": Plugin(
        "shape",
        {**_CURVES, **_PLACED},
        _ON_SHAPES,
        doc="tubes with round joints and ends; prisms of 64 sides, of fewer in large files",
    ),
    "bsplinecurve": Plugin(
        "shape",
        {**_CURVES, **_PLACED},
        _ON_SHAPES,
        doc="tubes around uniform cubic B-splines, open at the ends; as linearcurve",
    ),
    "sdfgrid": Plugin(
        "shape",
        {
            "filename": Param("string", None, doc=".vol file with one number a cell; or grid"),
            "grid": Param("array", None, doc="in a dictionary: (Z, Y, X, 1) numbers"),
            "normals": Param("string", "smooth", choices=("smooth", "analytic")),
            **_PLACED,
        },
        _ON_SHAPES,
        doc="where the trilinear function of a grid over [0, 1]^3 is 0, front where it is above; "
        "a mesh, finer than the grid",
    ),
    "ellipsoids": Plugin(
        "shape",
        {**_ELLIPSOIDS, **_PLACED},
        _ON_SHAPES,
        doc="those of 3D Gaussians, with a bsdf; meshes with smooth normals, which are finer for "
        "fewer of them",
    ),
    "ellipsoidsmesh": Plugin(
        "shape",
        {
            **_ELLIPSOIDS,
            "shell": Param("string", "ico_sphere", choices=SHELLS, doc="what stands for each"),
            **_PLACED,
            **_FLAT,
        },
        _ON_SHAPES,
        doc="a flat shell about each ellipsoid",
    ),
    "obj": Plugin(
        "shape",
        {
            **_MESH,
            **_flip_uv(True),
            "load_materials": Param(
                "boolean", True, doc="without effect: no materials are read; of version 0.x"
            ),
        },
        _ON_SHAPES,
        doc="Wavefront OBJ",
    ),
    "ply": Plugin(
        "shape",
        {
            **_MESH,
            **_flip_uv(False),
            "srgb": Param("boolean", True, doc="vertexcolors of version 0.x are sRGB"),
        },
        _ON_SHAPES,
        doc="Stanford PLY; attributes vertex_color of red, green, blue or r, g, b, vertex_foo of "
        "foo_0, foo_1, foo_2 (or x, y, z; 1, 2, 3) or foo_0; of faces face_color and face_foo",
    ),
    "stl": Plugin(
        "shape",
        {name: param for name, param in _MESH.items() if name != "max_smooth_angle"}
        | {"face_normals": Param("boolean", True, choices=(True,))},
        _ON_SHAPES,
        doc="STL, flat; not in Mitsuba",
    ),
    "mesh": Plugin(
        "shape",
        {
            "vertices": Param("array", REQUIRED, doc="(V, 3) numbers"),
            "faces": Param("array", REQUIRED, doc="(T, 3) integers in [0, V)"),
            "uv": Param("array", None, doc="(V, 2) texture coordinates"),
            "normals": Param("array", None, doc="(V, 3) shading normals; zeros for none"),
            **_flip_uv(False),
            **{name: param for name, param in _MESH.items() if name != "filename"},
        },
        _ON_SHAPES,
        doc="arrays of a dictionary, not of a file; also attributes vertex_... (V, 1 or 3) and "
        "face_... (T, 1 or 3); not in Mitsuba",
    ),
    "serialized": Plugin(
        "shape",
        {**_MESH, "shape_index": Param("integer", 0, 0, 2**32 - 1, doc="which mesh of the file")},
        _ON_SHAPES,
        doc="Mitsuba's own format, versions 3 and 4; vertex colours are left out",
    ),
    "shapegroup": Plugin(
        "shape",
        {},
        {"shape": ((*_SHAPES, "merge"), 0, _MANY)},
        {"to_world": "without effect in Mitsuba; give it to the instances"},
        doc="shapes that instances show; a lamp among them shines in each (not in Mitsuba)",
    ),
    "instance": Plugin(
        "shape",
        {"to_world": _TO_WORLD},
        {"shape": (("shapegroup",), 1, 1)},
        doc="the shapes of a group once more; each takes memory of its own, at most 100,000 "
        "shapes and 50,000,000 triangles (12 GB) in all",
    ),
    "merge": Plugin(
        "shape",
        {},
        {"shape": ((*_SHAPES, "instance"), 0, _MANY)},
        doc="its shapes, as if they stood in its place",
    ),
    "diffuse": Plugin(
        "bsdf",
        {"reflectance": Param(COLOUR, 0.5, **_REFLECTED, column="reflectance")},
        doc="Lambertian; black from behind unless inside twosided",
    ),
    "conductor": Plugin(
        "bsdf",
        _METAL,
        doc="smooth metal",
    ),
    "dielectric": Plugin("bsdf", _GLASS, doc="smooth boundary of a clear material"),
    "thindielectric": Plugin("bsdf", _GLASS, doc="pane: two boundaries, too close to refract"),
    "plastic": Plugin(
        "bsdf",
        _PLASTIC,
        doc="smooth clear coat on a diffuse base",
    ),
    "roughconductor": Plugin(
        "bsdf", {**_METAL, **_ROUGH, **_TEXTURED_ALPHA, **_WHOLE}, doc="rough metal"
    ),
    "roughplastic": Plugin(
        "bsdf",
        {**_PLASTIC, **_ROUGH},
        doc="rough clear coat on a diffuse base",
        unsupported={
            "energy_compensation": "not supported; allowed: on roughconductor, roughdielectric"
        },
    ),
    "roughdielectric": Plugin(
        "bsdf",
        {**_GLASS, **_ROUGH, **_TEXTURED_ALPHA, **_WHOLE},
        doc="rough boundary of a clear material",
    ),
    "principled": Plugin(
        "bsdf",
        _PRINCIPLED,
        doc="diffuse, metal, glass, sheen and clear coat after Burley; black from behind unless "
        "spec_trans is above 0 or it is inside twosided",
        noted=dict.fromkeys(
            (
                "diffuse_reflectance_sampling_rate",
                "main_specular_sampling_rate",
                "clearcoat_sampling_rate",
            ),
            _SAMPLED,
        ),
    ),
    "principledthin": Plugin(
        "bsdf",
        _THIN,
        doc="a thin sheet after Burley: diffuse light, sheen and mirrors on both sides, and light "
        "that goes through",
        noted=dict.fromkeys(
            (
                "diffuse_reflectance_sampling_rate",
                "diffuse_transmittance_sampling_rate",
                "specular_reflectance_sampling_rate",
                "specular_transmittance_sampling_rate",
            ),
            _SAMPLED,
        ),
    ),
    "pplastic": Plugin(
        "bsdf",
        {
            name: param
            for name, param in {**_PLASTIC, **_ROUGH}.items()
            if name not in ("nonlinear", "shadowing")
        },
        doc="as Mitsuba's without polarisation: a rough coat's mirrors on a base that light enters "
        "and leaves once, as through a smooth coat",
    ),
    **{
        name: Plugin(
            "bsdf",
            {"transmittance": _TRANSMITTANCE},
            doc=f"lets {share} of the light straight through, as in Mitsuba without polarisation",
            noted=dict.fromkeys(("theta", "polarizing", "delta", "left_handed"), _UNPOLARISED),
        )
        for name, share in (("polarizer", "half"), ("circular", "half"), ("retarder", "all"))
    },
    "hair": Plugin(
        "bsdf",
        {
            "eumelanin": Param("float", None, 0.0, MAX_ETA, doc="black and brown pigment; 1.3"),
            "pheomelanin": Param("float", None, 0.0, MAX_ETA, doc="red and yellow pigment; 0.2"),
            "sigma_a": Param(COLOUR, None, 0.0, MAX_ETA, doc="instead: absorption over a radius"),
            "scale": Param("float", 1.0, 0.0, MAX_ETA, doc="factor on sigma_a"),
            "int_ior": Param(IOR, "amber", 1.0, 10.0, doc="refractive index of the fibre"),
            "ext_ior": _EXT_IOR,
            "longitudinal_roughness": Param("float", 0.3, 0.01, 1.0, beyond="near", doc="along it"),
            "azimuthal_roughness": Param("float", 0.3, 0.01, 1.0, beyond="near", doc="around it"),
            "scale_tilt": Param("float", 2.0, -90.0, 90.0, doc="degrees, of scales on its surface"),
        },
        doc="fibres of hair and fur after Chiang and others, 2016; for curves, in no other bsdf; "
        "u goes around them, and rays from within pass",
    ),
    "null": Plugin("bsdf", doc="invisible; bounds media"),
    "mask": Plugin(
        "bsdf",
        {"opacity": Param(GREY, 0.5, **_SHARE, doc="share that is there", column="opacity")},
        {"bsdf": ((*_UNMASKED, *RELIEFS, "mask", "blendbsdf"), 1, 1)},
        doc="partly transparent; a mask in it only if numbers are the opacity of both",
    ),
    "blendbsdf": Plugin(
        "bsdf",
        {
            "weight": Param(
                GREY,
                None,
                doc="share of the second bsdf, required; below 0 as 0, above 1 as 1",
                column="blend_weight",
            )
        },
        {"bsdf": (_BSDFS, 2, 2)},
        doc="the first bsdf in part, the second for the rest, in the order of the file; both may "
        "be blends where all weights are numbers, else one of them",
    ),
    "twosided": Plugin(
        "bsdf",
        {},
        {"bsdf": ((*_OPAQUE, *RELIEFS, "blendbsdf", "twosided"), 1, 2)},
        doc="both sides reflect; of two, the first on both, with a warning",
    ),
    "bumpmap": _relief(
        "normals turned as if the surface were raised by the heights of a bitmap, its texture of "
        "any name; bilinear ones alone have slopes",
        scale=Param(
            "float", 1.0, -1e6, 1e6, doc="world units for a height of 1", column="relief_scale"
        ),
    ),
    "normalmap": _relief(
        "normals n by the colours (n + 1) / 2 of a bitmap, its texture normalmap: x along u, z the "
        "surface's own",
        normalmap=Param(COLOUR, None, 0.0, 1.0, doc="one colour in place of the bitmap"),
    ),
    "bitmap": Plugin(
        "texture",
        {
            "filename": Param(
                "string", None, doc="PNG, JPEG, BMP, TGA, PPM, EXR, HDR or PFM; or data, bitmap"
            ),
            "data": Param("array", None, doc="(H, W, C) in a dictionary; not for sRGB"),
            "bitmap": Param("array", None, doc="likewise; uint8 is sRGB unless raw"),
            "raw": Param("boolean", False, doc="8-bit texels are linear, not sRGB"),
            "scale": Param(COLOUR, 1.0, 0.0, doc="factor on the texels; of version 0.x"),
            "gain": _GAIN,
            "channel": Param(
                "string", None, choices=CHANNELS, doc="that alone, as grey; of version 0.x"
            ),
            "filter_type": Param("string", "bilinear", choices=TEXTURE_FILTERS),
            "wrap_mode": Param("string", "repeat", choices=TEXTURE_WRAPS),
            "to_uv": _TO_UV,
            "format": Param(
                "string",
                "auto",
                choices=("auto", "variant", "fp16"),
                doc="without effect: texels keep the precision of the file",
            ),
            "accel": Param("boolean", True, doc="without effect: the filter is exact"),
        },
        doc="an image; row 0 at v = 0",
    ),
    "checkerboard": Plugin(
        "texture",
        {
            "color0": Param(COLOUR, 0.4, 0.0, column="texture_color0", field="texture_field0"),
            "color1": Param(COLOUR, 0.2, 0.0, column="texture_color1", field="texture_field1"),
            "to_uv": _TO_UV,
            "in_order": Param(
                "boolean", False, doc="where one number is wanted, too; of version 0.x"
            ),
        },
        doc="two by two fields a unit of u and v, color0 next to the origin",
    ),
    "mesh_attribute": Plugin(
        "texture",
        {
            "name": Param("string", REQUIRED, doc="begins with vertex_ or face_; see ply and mesh"),
            "scale": Param(
                "float",
                1.0,
                doc="factor on the numbers; with it they are in the range of what they stand for",
            ),
            "gain": _GAIN,
            "bytes": Param(
                "boolean", False, doc="numbers up to 255 are shares, of a ply sRGB; of version 0.x"
            ),
        },
        doc="numbers of a mesh, interpolated between vertices; one or three of them",
    ),
    "volume": Plugin(
        "texture", {}, {"volume": (_VOLUMES, 1, 1)}, doc="a volume, read where the surface is"
    ),
    "homogeneous": Plugin(
        "medium",
        {
            "sigma_t": Param(COLOUR, None, **_COEFFICIENT, doc="extinction; default 1"),
            "albedo": Param(COLOUR, None, **_SHARE, doc="default 0.75; or a volume of this name"),
            "sigma_s": Param(COLOUR, None, **_COEFFICIENT, doc="scattering; not in Mitsuba"),
            "sigma_a": Param(COLOUR, None, **_COEFFICIENT, doc="absorption; not in Mitsuba"),
            **_MEDIUM,
        },
        _IN_MEDIA,
        doc="per unit length of the world; sigma_t and albedo, or sigma_s and sigma_a",
    ),
    "heterogeneous": Plugin(
        "medium",
        {
            "sigma_t": Param(
                COLOUR,
                None,
                **_COEFFICIENT,
                doc="extinction, a volume of this name; a number (default 1) fills the unit cube",
            ),
            "albedo": Param(COLOUR, None, **_SHARE, doc="default 0.75; or a volume of this name"),
            **_MEDIUM,
            "density_scale": Param("float", None, **_COEFFICIENT, doc="the older name of scale"),
        },
        _IN_MEDIA,
        doc="uneven; nothing is outside of the box around the unit cube of sigma_t's volume",
    ),
    "gridvolume": Plugin(
        "volume",
        {
            "filename": Param("string", None, doc=".vol, version 3; or grid or data"),
            "grid": Param("array", None, doc="(Z, Y, X) or (Z, Y, X, C) in a dictionary"),
            "data": Param("array", None, doc="likewise"),
            "filter_type": Param("string", "trilinear", choices=VOLUME_FILTERS),
            "wrap_mode": Param("string", "clamp", choices=TEXTURE_WRAPS),
            "to_world": Param("transform", doc="of the unit cube that the cells fill"),
            "use_grid_bbox": Param("boolean", False, doc="they fill the file's box instead"),
            "at_corners": Param(
                "boolean", False, doc="the outer cells' centres lie on the box; of version 0.x"
            ),
            "raw": Param("boolean", False, doc="without effect: numbers are as they stand"),
            "accel": Param("boolean", True, doc="without effect: the filter is exact"),
            "max_value": Param("float", None, note="the grid's own largest number is taken"),
        },
        doc="1 or 3 numbers a cell; 6 as S of an sggx",
    ),
    "constvolume": Plugin(
        "volume",
        {
            "value": Param(COLOUR, 1.0, **_COEFFICIENT),
            "color": Param(COLOUR, None, **_COEFFICIENT, doc="the older name of value"),
            "to_world": Param("transform", doc="of the unit cube outside of which no sigma_t is"),
        },
        doc="the same number or colour everywhere",
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
    "rayleigh": Plugin("phase", doc="Rayleigh, without polarisation"),
    "tabphase": Plugin(
        "phase",
        {
            "values": Param(
                "string",
                REQUIRED,
                doc="numbers at cosines of the turn from -1 (backward) to 1, linear between them",
            )
        },
        doc="by a table, in proportion to its values",
    ),
    "sggx": Plugin(
        "phase",
        {},
        {"volume": (("gridvolume",), 0, 1)},
        doc="mirror flakes: S, a gridvolume of xx, yy, zz, xy, xz, yz, the same in all cells; the "
        "extinction along d is sigma_t times the root of d S d, not within a blendphase",
    ),
    "blendphase": Plugin(
        "phase",
        {
            "weight": Param(
                "float",
                None,
                0.0,
                1.0,
                doc="share of the second one, required; a volume of the same number everywhere too",
            )
        },
        {"phase": (_PHASES, 2, 2), "volume": (_VOLUMES, 0, 1)},
        doc="the first one in part, the second for the rest; they may be blends",
    ),
    "area": Plugin(
        "emitter",
        {"radiance": replace(_RADIANCE, light_texture=True)},
        doc="emits on the shape's front side",
    ),
    "directionalarea": Plugin(
        "emitter",
        {"radiance": replace(_RADIANCE, light_texture=True)},
        doc="dark, as in Mitsuba, where ptracer alone finds its light; with ptracer an error",
    ),
    "constant": Plugin(
        "emitter",
        {"radiance": _RADIANCE},
        doc="the same in every direction",
        noted={"to_world": "it is the same in every direction"},
    ),
    "envmap": Plugin(
        "emitter",
        {
            "filename": Param("string", None, doc="EXR, HDR, PFM; PNG and JPEG are sRGB"),
            "bitmap": Param("array", None, doc="instead, in a dictionary: (H, W, 3) radiances"),
            "scale": Param("float", 1.0, 0.0, doc="factor on the radiance"),
            "to_world": Param("transform", doc="no scale; the upper edge is at local +y"),
            "mis_compensation": Param(
                "boolean", True, doc="light samples only where it is brighter than its mean"
            ),
        },
        doc="radiance by direction: latitudes and longitudes; the middle column is at local +z",
    ),
    "sunsky": Plugin(
        "emitter",
        {
            "turbidity": Param("float", 3.0, 1.0, 10.0, doc="haze: 2 is clear, 6 warm and moist"),
            "albedo": Param(COLOUR, 0.3, **_SHARE, doc="of the ground, which the sky reflects"),
            "sun_direction": Param(
                "vector", None, -MAX_COORDINATE, MAX_COORDINATE, doc="in the world; or a time"
            ),
            "latitude": Param("float", None, -90.0, 90.0, doc="degrees northwards; 35.6894"),
            "longitude": Param("float", None, -180.0, 180.0, doc="degrees eastwards; 139.6917"),
            "timezone": Param("float", None, -14.0, 14.0, doc="hours before universal time; 9"),
            "year": Param("integer", None, 1, 9999, doc="2010"),
            "month": Param("integer", None, 1, 12, doc="7"),
            "day": Param("integer", None, 1, 31, doc="10"),
            "hour": Param("float", None, 0.0, 24.0, doc="15"),
            "minute": Param("float", None, 0.0, 60.0, doc="0"),
            "second": Param("float", None, 0.0, 60.0, doc="0"),
            "sun_scale": Param("float", 1.0, 0.0, doc="factor on the sun's radiance"),
            "sky_scale": Param("float", 1.0, 0.0, doc="factor on the sky's radiance"),
            "sun_aperture": Param(
                "float", 0.5358, 0.0, 90.0, open=True, doc="degrees across; its light stays"
            ),
            "complex_sun": Param("boolean", False, note="the sun's disc is even"),
            "y_is_east": Param("boolean", False, doc="of a time: +y is east; of version 0.x"),
            "to_world": Param("transform", doc="no scale; up is local +z, south +x, west +y"),
        },
        doc="a clear sky with the sun after Hosek and Wilkie, black below the horizon; an image of "
        "texels 0.18 degrees wide",
    ),
    "point": Plugin(
        "emitter",
        {
            "position": Param("point", None, -MAX_COORDINATE, MAX_COORDINATE, doc="or to_world"),
            "to_world": _TO_WORLD,
            "intensity": Param(
                COLOUR,
                1.0,
                0.0,
                doc="power per steradian",
                column="light_intensity",
                beyond="light",
            ),
        },
    ),
    "spot": Plugin(
        "emitter",
        {
            "to_world": Param("transform", doc="no scale; it shines along local +z"),
            "intensity": Param(
                COLOUR,
                1.0,
                0.0,
                doc="power per steradian on the axis",
                column="light_intensity",
                beyond="light",
            ),
            "cutoff_angle": Param("float", 20.0, 0.0, 180.0, doc="degrees from the axis to dark"),
            "beam_width": Param("float", None, 0.0, 180.0, doc="to the end of full light; 3/4"),
            "texture": Param(
                COLOUR,
                None,
                0.0,
                light_texture=True,
                doc="an image, factor on the intensity: it covers the tangents of directions up to "
                "cutoff_angle, below 90",
            ),
        },
        doc="falls off linearly with the angle from beam_width to cutoff_angle",
    ),
    "projector": Plugin(
        "emitter",
        {
            "to_world": Param("transform", doc="no scale; it shines along local +z"),
            "irradiance": Param(
                COLOUR,
                None,
                0.0,
                beyond="light",
                light_texture=True,
                doc="on a plane across the axis at distance 1, over pi; its top is at local +y; "
                "default 1",
            ),
            "scale": Param("float", 1.0, 0.0, doc="factor on the irradiance"),
            **{name: _PERSPECTIVE[name] for name in ("fov", "fov_axis", "focal_length")},
        },
        doc="the image that a perspective sensor would see, from a point; a texture states its "
        "ratio of sides, 1 without texels",
    ),
    "directional": Plugin(
        "emitter",
        {
            "direction": Param("vector", None, -MAX_COORDINATE, MAX_COORDINATE, doc="or to_world"),
            "to_world": Param("transform", doc="it shines along local +z"),
            "irradiance": Param(
                COLOUR,
                1.0,
                0.0,
                doc="on a surface that faces it",
                column="light_intensity",
                beyond="light",
            ),
        },
        doc="the sun: parallel light",
    ),
}
PLUGINS["timed_sunsky"] = Plugin(
    "emitter",
    {
        **{
            name: param
            for name, param in PLUGINS["sunsky"].params.items()
            if name not in ("sun_direction", "y_is_east", *_CLOCK)
        },
        **{
            f"{end}_{name}": Param("integer", default, 1, high, doc=f"{default}")
            for end, defaults in (("start", (2025, 1, 1)), ("end", (2026, 1, 1)))
            for name, default, high in zip(
                ("year", "month", "day"), defaults, (9999, 12, 31), strict=True
            )
        },
        "window_start_time": Param("float", 7.0, 0.0, 24.0, doc="hour at which each day begins"),
        "window_end_time": Param("float", 19.0, 0.0, 24.0, doc="and ends"),
    },
    doc="the mean of skies while the first sensor's shutter is open, 0 being the start of the "
    "first day and 1 that of the last one; a closed shutter sees one sunsky",
)
for _plugin in PLUGINS.values():
    if _plugin.category == "emitter":
        _plugin.params["sampling_weight"] = Param("float", 1.0, 0.0, note=_SAMPLED)
    elif _plugin.category == "shape":
        _plugin.noted["silhouette_sampling_weight"] = _DERIVATIVES
CATEGORIES = tuple(dict.fromkeys(plugin.category for plugin in PLUGINS.values()))


def mesh_attribute(node: Node, name: str) -> bool:
    """Whether a value of this name is an attribute of a mesh of a dictionary."""
    known = PLUGINS["mesh"].params
    return node.plugin == "mesh" and name not in known and name.startswith(("vertex_", "face_"))


def texturable() -> list[str]:
    """The parameters that a texture may give, as "diffuse.reflectance"."""
    return [
        f"{name}.{key}"
        for name, plugin in PLUGINS.items()
        for key, param in plugin.params.items()
        if param.texturable
    ]


def of_category(category: str) -> list[str]:
    """Names of the plugins of a category."""
    return [name for name, plugin in PLUGINS.items() if plugin.category == category]


def rows(plugin: Plugin) -> Iterator[tuple[str, str, str, str, str]]:
    """Of each parameter its name, type, default, range and meaning, as Markdown."""
    for key, param in plugin.params.items():
        default = "required" if param.default is REQUIRED else param.default
        limits = ", ".join(str(choice) for choice in param.choices)
        numeric = param.kind in ("float", "integer", COLOUR, IOR, GREY)
        if numeric and (param.low, param.high) != (-inf, inf):
            limits = f"{'>' if param.open else '>='} {param.low:g}"
            if param.high < inf:
                limits += f", {'<' if param.open else '<='} {param.high:g}"
        if isinstance(default, float):
            default = f"{default:.4g}"
        shown = "" if default is None else str(default)
        kind = f"{param.kind.replace(' or', ',')} or texture" if param.texturable else param.kind
        meaning = param.doc or (param.note and f"without effect: {param.note}")
        yield f"`{key}`", kind, shown, limits, meaning
    for key, reason in plugin.noted.items():
        yield f"`{key}`", "", "", "", f"without effect: {reason}"
    if plugin.lenient:
        yield "any other", "", "", "", f"without effect: {plugin.lenient}"


def describe() -> str:
    """The table of objects and parameters as Markdown, for the documentation."""
    table = ["| object | parameter | type | default | allowed | meaning |", "|" + " --- |" * 6]
    for name, plugin in PLUGINS.items():
        holds = f"holds {', '.join(plugin.children)}" if plugin.children else ""
        table.append(f"| {plugin.category} `{name}` | | | | {holds} | {plugin.doc} |")
        table += (f"| | {' | '.join(cells)} |" for cells in rows(plugin))
    names = ", ".join(f"{name} {value:g}" for name, value in IORS.items())
    spectrum = ", ".join(f"{name} ({', '.join(given)})" for name, (_, given) in SPECTRA.items())
    return (
        "\n".join(table)
        + f"\n\nRefractive indices by name: {names}.\n\nMetals by name: {', '.join(NAMES)}.\n\n"
        + f"Spectra, for any {COLOUR}: {spectrum}; text or a file of wavelength:value.\n"
    )
