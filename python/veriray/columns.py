"""The schema of a scene's arrays: each column and table once.

From here `cpp/schema/generate.py` makes `cpp/schema/columns.def` (the native input, its checks and
its bindings), the types of `_native.pyi`, the fields of `scene_arrays.py` and
docs/scene-arrays.md. To add a column, add it to `_HASHED_IF_SET` and run `make schema`.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
import numpy.typing as npt

from .chunks import in_chunks
from .errors import SceneError
from .numeric import MAX_COORDINATE, Fresh, array, distinct, in_range, repeated

Array = npt.NDArray[Any]


@dataclass(frozen=True)
class MaterialKind:
    """opaque: nothing goes through, so `two_sided` may be set; refracts: `eta` is one index;
    scatters: not by delta lobes alone, so light samples reach it."""

    opaque: bool = False
    refracts: bool = False
    scatters: bool = False


_MATERIAL_KINDS = {
    "diffuse": MaterialKind(opaque=True, scatters=True),
    "conductor": MaterialKind(opaque=True),
    "dielectric": MaterialKind(refracts=True),
    "plastic": MaterialKind(opaque=True, refracts=True, scatters=True),
    "thindielectric": MaterialKind(refracts=True),
    "null": MaterialKind(),
    "roughconductor": MaterialKind(opaque=True, scatters=True),
    "roughplastic": MaterialKind(opaque=True, refracts=True, scatters=True),
    "roughdielectric": MaterialKind(refracts=True, scatters=True),
    "principled": MaterialKind(opaque=True, refracts=True, scatters=True),
    "principled_open": MaterialKind(refracts=True, scatters=True),
    "principledthin": MaterialKind(refracts=True, scatters=True),
    "hair": MaterialKind(refracts=True, scatters=True),
    "roughconductor_whole": MaterialKind(opaque=True, scatters=True),
    "roughdielectric_whole": MaterialKind(refracts=True, scatters=True),
}
#: Kinds that a parameter of a plugin makes of its own kind.
OPEN_KINDS = {"principled": "principled_open"}
#: Likewise, of rough surfaces that lose no light.
WHOLE_KINDS = {
    "roughconductor": "roughconductor_whole",
    "roughdielectric": "roughdielectric_whole",
}
#: Values of `distribution` and `shadowing`.
DISTRIBUTIONS = ("beckmann", "ggx")
SHADOWINGS = ("separable", "height_correlated")
MIN_ALPHA, MAX_ALPHA = 5e-5, 10.0
#: Shares of a principled surface: default and meaning.
PRINCIPLED = {
    "roughness": (0.5, "root of the slope of its mirrors, which is 0.001 at least"),
    "metallic": (0.0, "share of a metal of the base colour"),
    "spec_trans": (0.0, "share of the rest that lets light through"),
    "spec_tint": (0.0, "share of the base colour's hue in what is not metal and reflects"),
    "sheen": (0.0, "light that it reflects at grazing angles"),
    "sheen_tint": (0.0, "share of the base colour's hue in that"),
    "flatness": (0.0, "share of the diffuse part that imitates scattering below the surface"),
    "clearcoat": (0.0, "amount of a clear coat"),
    "clearcoat_gloss": (0.0, "the coat's slope, from 0.1 to 0.001"),
    "anisotropic": (0.0, "how much less its mirrors slope across the tangent than along it"),
}
#: Of a thin one alone, up to 2: default and meaning.
PRINCIPLED_THIN = {"diff_trans": (0.0, "twice the share of the diffuse light that goes through")}
#: Names of the values of `material_kind` and `light_kind`.
MATERIAL_KINDS = tuple(_MATERIAL_KINDS)
OPAQUE_KINDS = tuple(name for name, kind in _MATERIAL_KINDS.items() if kind.opaque)
SCATTERING_KINDS = tuple(name for name, kind in _MATERIAL_KINDS.items() if kind.scatters)
LIGHT_KINDS = ("point", "spot", "directional", "projector")
#: Names of the values of `texture_kind`, `texture_wrap`, `texture_filter` and `texture_format`.
TEXTURE_KINDS = ("bitmap", "checkerboard", "vertex_attribute", "face_attribute", "volume")
TEXTURE_WRAPS = ("repeat", "mirror", "clamp")
TEXTURE_FILTERS = ("bilinear", "nearest")
TEXTURE_FORMATS = ("srgb8", "linear8", "half", "float")
#: Numbers of a material that a texture can give: one more is a name here.
TEXTURABLE = (
    "reflectance", "specular_reflectance", "specular_transmittance", "opacity",
    "alpha_u", "alpha_v", *PRINCIPLED, *PRINCIPLED_THIN, "blend_weight",
    "eta", "k",
)  # fmt: skip
#: Those of metals, and the kinds of material that take textures of them.
INDICES = ("eta", "k")
METALS = ("conductor", "roughconductor")
#: Names of the values of `lobe_kind`.
PHASE_KINDS = ("hg", "rayleigh", "tabphase", "sggx")
MAX_LOBES = 64  # of a medium
MAX_PHASE_VALUES = 1 << 16  # of a lobe
MAX_UV = 1e30  # of a texture coordinate: float32
MAX_NESTED = 8  # textures around another
MAX_ETA = 1e6  # of a conductor; k likewise
MAX_IOR = 1e3  # interior over exterior index; at least 1 / MAX_IOR
MAX_SKY_TEXELS = 1 << 27
MAX_CELL_NUMBERS = (1 << 31) - 512  # of all grids
REQUIRED = object()

#: Tables and the letters of their numbers of rows; the table "" has one row.
TABLES = {
    "vertices": "V",
    "triangles": "T",
    "spheres": "S",
    "disks": "D",
    "materials": "M",
    "emissions": "E",
    "boundaries": "B",
    "media": "K",
    "lights": "Q",
    "textures": "X",
    "texels": "W",
    "attributes": "A",
    "sky": "Y",
    "grids": "G",
    "cells": "C",
    "lobes": "L",
    "phase_values": "P",
}


@dataclass(frozen=True)
class Column:
    """One array: a row of shape `width` for each row of `table`.

    default: what a row holds if the array is not given. low, high: of each number; open: both are
    excluded. indexes: the table whose rows it names, and -1 for none if that is the default.
    """

    table: str
    dtype: Any
    width: tuple[int, ...] = ()
    default: Any = REQUIRED
    low: float = -math.inf
    high: float = math.inf
    open: bool = False
    indexes: str = ""
    doc: str = ""


def _index(table: str, of: str, default: Any = REQUIRED, *, doc: str) -> Column:
    dtype = np.uint32 if default is REQUIRED else np.int32
    return Column(table, dtype, (), default, indexes=of, doc=doc)


def _material(table: str) -> Column:
    return _index(table, "materials", doc="its material")


def _emission(table: str) -> Column:
    return _index(table, "emissions", -1, doc="what its front emits; -1 for nothing")


def _boundary(table: str) -> Column:
    return _index(table, "boundaries", -1, doc="the media on its sides; -1 for no change")


_BIG = MAX_COORDINATE
_ALWAYS_HASHED: dict[str, Column] = {
    "vertices": Column("vertices", np.float64, (3,), low=-_BIG, high=_BIG, doc="world units"),
    "normals": Column(
        "vertices", np.float64, (3,), 0.0, -_BIG, _BIG,
        doc="shading normals of unit length, or zero for none; a triangle is smooth if its three "
        "are not zero",
    ),
    "triangles": Column(
        "triangles", np.uint32, (3,), indexes="vertices",
        doc="cross(v1 - v0, v2 - v0) is on the front side",
    ),
    "triangle_material": _material("triangles"),
    "triangle_emission": _emission("triangles"),
    "triangle_boundary": _boundary("triangles"),
    "spheres": Column(
        "spheres", np.float64, (4,), low=-_BIG, high=_BIG, doc="centre, and radius above 0"
    ),
    "sphere_material": _material("spheres"),
    "sphere_emission": _emission("spheres"),
    "sphere_boundary": _boundary("spheres"),
    "sphere_inward": Column("spheres", np.bool_, (), False, doc="the front is inside"),
    "disks": Column(
        "disks", np.float64, (3, 3), low=-_BIG, high=_BIG,
        doc="centre and half axes a and b of an ellipse; cross(a, b) is on the front side",
    ),
    "disk_material": _material("disks"),
    "disk_emission": _emission("disks"),
    "disk_boundary": _boundary("disks"),
    "reflectance": Column(
        "materials", np.float32, (3,), low=0.0, high=1.0,
        doc="of a diffuse surface, or of a plastic's base",
    ),
    "two_sided": Column(
        "materials", np.bool_, (), False, doc="the back scatters as the front does"
    ),
    "material_kind": Column(
        "materials", np.uint32, (), 0, indexes="material kinds", doc="of MATERIAL_KINDS"
    ),
    "specular_reflectance": Column(
        "materials", np.float32, (3,), 1.0, 0.0, 1.0, doc="factor on what a mirror would reflect"
    ),
    "specular_transmittance": Column(
        "materials", np.float32, (3,), 1.0, 0.0, 1.0, doc="factor on what is refracted"
    ),
    "eta": Column(
        "materials", np.float32, (3,), 1.0, 0.0, MAX_ETA,
        doc="of a conductor the refractive index over that outside (the ideal mirror: eta 0, k 1); "
        "else the index inside over that outside, three times",
    ),
    "k": Column(
        "materials", np.float32, (3,), 0.0, 0.0, MAX_ETA,
        doc="of a conductor: the imaginary part of its index; of a plastic: above 0 if light "
        "enters and leaves its base once, as through a smooth coat; of hair: absorption per radius",
    ),
    "opacity": Column(
        "materials", np.float32, (), 1.0, 0.0, 1.0, doc="share of the surface that is there"
    ),
    "nonlinear": Column(
        "materials", np.bool_, (), False,
        doc="colour shifts of a plastic's base by internal scattering",
    ),
    "emissions": Column(
        "emissions", np.float32, (3,), low=0.0, doc="radiance, emitted on the front side only"
    ),
    "environment": Column(
        "", np.float32, (3,), 0.0, low=0.0, doc="constant radiance from far away"
    ),
    "boundaries": Column(
        "boundaries", np.int32, (2,), -1, indexes="media",
        doc="media inside (behind the front) and outside of a surface; -1 for vacuum",
    ),
    "sigma_t": Column("media", np.float32, (3,), low=0.0, doc="extinction per unit length"),
    "albedo": Column(
        "media", np.float32, (3,), 0.0, 0.0, 1.0, doc="share of the extinction that scatters"
    ),
    "phase_g": Column(
        "media", np.float32, (), 0.0, -1.0, 1.0, open=True,
        doc="Henyey and Greenstein's asymmetry in (-1, 1); 0 is isotropic",
    ),
    "light_kind": Column("lights", np.uint32, indexes="light kinds", doc="of LIGHT_KINDS"),
    "light_position": Column("lights", np.float64, (3,), 0.0, -_BIG, _BIG, doc="world units"),
    "light_direction": Column(
        "lights", np.float64, (3,), (0.0, 0.0, 1.0), -_BIG, _BIG,
        doc="of unit length: the way the light goes",
    ),
    "light_intensity": Column(
        "lights", np.float32, (3,), 1.0, 0.0,
        doc="of a directional light the irradiance across it, of a projector that at distance 1",
    ),
    "light_angles": Column(
        "lights", np.float64, (2,), (20.0, 15.0), 0.0, 180.0,
        doc="a spot's cutoff and beam width, degrees from its axis",
    ),
}  # fmt: skip
#: Columns that enter the hash of a scene only where they are not at their default, so that they
#: change the hash of no scene that does not use them.
_HASHED_IF_SET: dict[str, Column] = {
    "uv": Column(
        "vertices", np.float32, (2,), 0.0, -MAX_UV, MAX_UV, doc="texture coordinates u and v"
    ),
    "sphere_frame": Column(
        "spheres", np.float32, (3, 3), ((1.0, 0.0, 0.0), (0.0, 1.0, 0.0), (0.0, 0.0, 1.0)),
        -1.0, 1.0,
        doc="unit axes x, y and z, a row each, across each other: u is the angle about z from x "
        "towards y over 2 pi, v that from z over pi",
    ),
    "disk_turned": Column(
        "disks", np.bool_, (), False,
        doc="v, the angle over 2 pi, runs from b to a; else from a to b; u is the distance from "
        "the centre",
    ),
    "texture_kind": Column("textures", np.uint32, indexes="texture kinds", doc="of TEXTURE_KINDS"),
    "texture_to_uv": Column(
        "textures", np.float32, (2, 3), ((1.0, 0.0, 0.0), (0.0, 1.0, 0.0)), -1e6, 1e6,
        doc="what takes (u, v, 1) to the texture's own coordinates; rows of texels follow its v",
    ),
    "texture_color0": Column(
        "textures", np.float32, (3,), 0.4, 0.0,
        doc="of a checkerboard, where u and v are both in the first or both in the second half",
    ),
    "texture_color1": Column(
        "textures", np.float32, (3,), 0.2, 0.0, doc="of its other fields"
    ),
    **{
        f"texture_field{k}": _index(
            "textures", "textures", -1,
            doc=f"of a checkerboard: a texture before it that stands in place of texture_color{k}; "
            "-1: none does",
        )
        for k in range(2)
    },
    "texture_wrap": Column(
        "textures", np.uint32, (), 0, indexes="texture wraps", doc="of TEXTURE_WRAPS"
    ),
    "texture_filter": Column(
        "textures", np.uint32, (), 0, indexes="texture filters", doc="of TEXTURE_FILTERS"
    ),
    "texture_format": Column(
        "textures", np.uint32, (), 0, indexes="texture formats", doc="of TEXTURE_FORMATS"
    ),
    "texture_width": Column("textures", np.uint32, (), 1, 1, 1 << 15, doc="in texels"),
    "texture_height": Column("textures", np.uint32, (), 1, 1, 1 << 15, doc="in texels"),
    "texture_depth": Column(
        "textures", np.uint32, (), 1, 1, 1 << 15,
        doc="of a volume: texels along z; its height is along y, its format float",
    ),
    "texture_to_world": Column(
        "textures", np.float64, (3, 4),
        ((1.0, 0.0, 0.0, 0.0), (0.0, 1.0, 0.0, 0.0), (0.0, 0.0, 1.0, 0.0)), -_BIG, _BIG,
        doc="of a volume: what takes (x, y, z, 1) of the unit cube of its texels to world units",
    ),
    "texture_grey": Column(
        "textures", np.bool_, (), False, doc="one number a texel; else three, and 8-bit and half "
        "texels have a fourth that is not used",
    ),
    "texture_first": Column(
        "textures", np.uint32, (), 0, doc="its first row of texels; of an attribute that of "
        "attribute_values, with one for each vertex or triangle",
    ),
    "texels": Column(
        "texels", np.uint32, doc="texels row by row, packed from the lowest bits; each texture "
        "begins a row",
    ),
    "attribute_values": Column(
        "attributes", np.float32, (3,), low=0.0,
        doc="numbers of vertices or triangles, zero for meshes without; one alone stands there "
        "three times",
    ),
    "blend_material": _index(
        "materials", "materials", -1,
        doc="a surface is of this material too, by the share blend_weight; a blend only if it "
        "comes after; -1: none",
    ),
    "blend_weight": Column(
        "materials", np.float32, (), 0.0, 0.0, 1.0, doc="the share of blend_material"
    ),
    "blend_sides": Column(
        "materials", np.bool_, (), False,
        doc="blend_material is all that is seen from behind; blend_weight counts in front",
    ),
    **{
        f"{name}_texture": _index("materials", "textures", -1, doc=f"gives {name}; -1: none does")
        for name in TEXTURABLE
    },
    "emission_texture": _index(
        "emissions", "textures", -1, doc="what its radiance is multiplied by; -1: nothing"
    ),
    "light_texture": _index(
        "lights", "textures", -1, doc="what the intensity of a spot or projector is multiplied by"
    ),
    "light_image": Column(
        "lights", np.float64, (2, 3), 0.0, -_BIG, _BIG,
        doc="rows a and b: along d, which is 1 along the light's direction, an image is read at "
        "u = 1/2 + a.d and v = 1/2 + b.d; a projector lights where both are in [0, 1]",
    ),
    "alpha_u": Column(
        "materials", np.float32, (), 0.1, MIN_ALPHA, MAX_ALPHA,
        doc="root mean square slope of a rough surface, along its tangent",
    ),
    "alpha_v": Column(
        "materials", np.float32, (), 0.1, MIN_ALPHA, MAX_ALPHA,
        doc="likewise, across its tangent",
    ),
    "distribution": Column(
        "materials", np.uint32, (), 0, indexes="distributions",
        doc="of the slopes; of DISTRIBUTIONS",
    ),
    "shadowing": Column(
        "materials", np.uint32, (), 0, indexes="shadowings",
        doc="of small mirrors by each other, Smith's; of SHADOWINGS",
    ),
    **{
        name: Column("materials", np.float32, (), default, 0.0, 1.0, doc=f"of a principled: {doc}")
        for name, (default, doc) in PRINCIPLED.items()
    },
    **{
        name: Column("materials", np.float32, (), default, 0.0, 2.0, doc=f"of a thin one: {doc}")
        for name, (default, doc) in PRINCIPLED_THIN.items()
    },
    "hair_along": Column(
        "materials", np.float32, (), 0.1, 1e-6, 100.0,
        doc="of hair: variance of the light that its surface reflects, along it",
    ),
    "hair_around": Column(
        "materials", np.float32, (), 0.2, 1e-3, 10.0,
        doc="of hair: scale of the logistic by which light spreads around it, radians",
    ),
    "hair_tilt": Column(
        "materials", np.float32, (), 0.0, -1.0, 1.0, doc="of hair: sine of the tilt of its scales"
    ),
    "relief_texture": _index(
        "materials", "textures", -1, doc="turns the surface's normals; -1: none does"
    ),
    "relief_heights": Column(
        "materials", np.bool_, (), False,
        doc="it gives heights (bilinear ones), whose slopes count; else normals n by colours "
        "(n + 1) / 2",
    ),
    "relief_scale": Column(
        "materials", np.float32, (), 1.0, -1e6, 1e6, doc="of heights: world units for a height of 1"
    ),
    "relief_flips": Column(
        "materials", np.bool_, (), True,
        doc="a turned normal that looks away from the viewer is turned the other way",
    ),
    "relief_shades": Column(
        "materials", np.bool_, (), True,
        doc="what is turned reflects less light from grazing directions",
    ),
    "relief_mirrored": Column(
        "materials", np.bool_, (), False,
        doc="seen from behind, the turned normals are those of the front mirrored",
    ),
    "sky_texels": Column(
        "sky", np.float32, (3,), low=0.0,
        doc="radiance from far away by direction: an image in rows from the local pole +y to -y; "
        "in a row, azimuths from -z by +x",
    ),
    "sky_size": Column(
        "", np.uint32, (2,), 0, 0, 1 << 15, doc="width and height of the image, 0 for none"
    ),
    "sky_to_world": Column(
        "", np.float64, (3, 3), ((1.0, 0.0, 0.0), (0.0, 1.0, 0.0), (0.0, 0.0, 1.0)), -2.0, 2.0,
        doc="rotation or reflection of the image, acting on column vectors",
    ),
    "sky_compensated": Column(
        "", np.bool_, (1,), True,
        doc="light samples are drawn by what the radiance exceeds its mean by; noise alone changes",
    ),
    "grid_size": Column(
        "grids", np.uint32, (3,), low=1, high=1 << 15,
        doc="cells along x, y and z; cell k of n has its centre at (k + 1/2) / n",
    ),
    "grid_first": Column("grids", np.uint32, (), 0, doc="its first row of cells"),
    "grid_grey": Column("grids", np.bool_, (), False, doc="one number a cell; else three"),
    "grid_wrap": Column(
        "grids", np.uint32, (), 2, indexes="texture wraps", doc="of TEXTURE_WRAPS, along all axes"
    ),
    "grid_filter": Column(
        "grids", np.uint32, (), 0, indexes="texture filters",
        doc="of TEXTURE_FILTERS, the first in three dimensions",
    ),
    "grid_to_world": Column(
        "grids", np.float64, (3, 4),
        ((1.0, 0.0, 0.0, 0.0), (0.0, 1.0, 0.0, 0.0), (0.0, 0.0, 1.0, 0.0)), -_BIG, _BIG,
        doc="what takes (x, y, z, 1) of its unit cube to world units",
    ),
    "cells": Column(
        "cells", np.float32, low=0.0, high=1.0,
        doc="numbers of grids: of a grid x by x, then by y and z, those of a cell side by side",
    ),
    "lobe_kind": Column("lobes", np.uint32, indexes="phase kinds", doc="of PHASE_KINDS"),
    "lobe_share": Column(
        "lobes", np.float32, (), 1.0, 0.0, 1.0,
        doc="of its medium's phase function; those of a medium add up to 1",
    ),
    "lobe_g": Column(
        "lobes", np.float32, (), 0.0, -1.0, 1.0, open=True, doc="of an hg; as phase_g"
    ),
    "lobe_flakes": Column(
        "lobes", np.float64, (6,), (1.0, 1.0, 1.0, 0.0, 0.0, 0.0), -1.0, 1.0,
        doc="of an sggx: xx, yy, zz, xy, xz, yz of the matrix S of its flakes; where it is a "
        "medium's only lobe, the extinction along d is sigma_t times the root of d S d",
    ),
    "lobe_values": Column(
        "lobes", np.uint32, (), 0, doc="of a tabphase: its first row of phase_values"
    ),
    "lobe_size": Column("lobes", np.uint32, (), 2, 2, MAX_PHASE_VALUES, doc="and how many it has"),
    "phase_values": Column(
        "phase_values", np.float32, low=0.0,
        doc="at cosines of the turn from -1 (backward) to 1 in equal steps, linear between them; "
        "in proportion to what a tabphase scatters",
    ),
    "phase_lobe": _index(
        "media", "lobes", -1, doc="the first lobe of its phase function; -1: it is that of phase_g"
    ),
    "phase_lobes": Column("media", np.uint32, (), 1, 1, MAX_LOBES, doc="and how many it has"),
    "albedo_grid": _index(
        "media", "grids", -1, doc="a factor on albedo by place; -1: none"
    ),
    "sigma_t_grid": _index(
        "media", "grids", -1,
        doc="the share of sigma_t, then grey, that is there, and none outside of the box around "
        "the grid's unit cube; -1: all is everywhere",
    ),
    **{
        f"{lamp}_muted": Column(
            table, np.bool_, () if table else (1,), False,
            doc="paths are those with its light, which is left out of the picture (light groups)",
        )
        for lamp, table in (("emission", "emissions"), ("light", "lights"), ("sky", ""))
    },
    "muted_segments": Column(
        "", np.uint32, (1,), 0, 0, 1 << 18,
        doc="light of paths of so many segments at most is left out, as of max_depth",
    ),
}  # fmt: skip
#: The first column of a table is the one that says how many rows it has.
COLUMNS: dict[str, Column] = {**_ALWAYS_HASHED, **_HASHED_IF_SET}
#: How many values there are of what is no table.
KINDS = {
    "material kinds": len(MATERIAL_KINDS),
    "light kinds": len(LIGHT_KINDS),
    "texture kinds": len(TEXTURE_KINDS),
    "texture wraps": len(TEXTURE_WRAPS),
    "texture filters": len(TEXTURE_FILTERS),
    "texture formats": len(TEXTURE_FORMATS),
    "distributions": len(DISTRIBUTIONS),
    "shadowings": len(SHADOWINGS),
    "phase kinds": len(PHASE_KINDS),
}


#: What the check of textures reads.
_OF_TEXTURES = frozenset(
    name
    for name, column in COLUMNS.items()
    if column.table in ("textures", "texels", "attributes") or column.indexes == "textures"
) | {"sphere_frame"}


def hashed(name: str, values: Array) -> bool:
    """Whether a column with these values is part of the scene's hash."""
    if name in _ALWAYS_HASHED:
        return True
    default = COLUMNS[name].default
    given = distinct(values)
    return bool(values.size) and (default is REQUIRED or bool((given != default).any()))


def checked(given: Mapping[str, Any], known: Mapping[str, Any] = {}) -> dict[str, Array]:
    """All arrays of COLUMNS from those given; None stands for a default or an empty table.

    known: arrays that have been checked, with the same numbers of rows. Raises SceneError naming
    array, index, value and what is allowed.
    """
    arrays: dict[str, Array] = {}
    rows: dict[str, int] = {}
    unknown: list[str] = []  # columns to be checked for their range
    for name, column in COLUMNS.items():
        value = given[name]
        first = column.table not in rows
        length = None if first else rows[column.table]
        shape = (length, *column.width) if column.table else column.width
        if value is not None and value is known.get(name):
            arrays[name] = known[name]
        elif value is None:
            if length and column.default is REQUIRED:
                raise SceneError(f"{name} is missing; there are {length} {column.table}")
            arrays[name] = repeated(_fill(column), tuple(n or 0 for n in shape), column.dtype)
        else:
            arrays[name] = array(name, value, column.dtype, shape)
            unknown.append(name)
        if first:
            rows[column.table] = len(arrays[name])
    for name in unknown:
        column, value = COLUMNS[name], given[name]
        if isinstance(value, Fresh) and _fits(column, value, rows):
            continue
        if column.indexes:
            size = KINDS.get(column.indexes) or rows.get(column.indexes, 0)
            low = 0 if column.dtype is np.uint32 else -1
            in_range(name, arrays[name], low, size - 1, f" (there are {size} {column.indexes})")
        elif column.dtype is not np.bool_:
            in_range(name, arrays[name], column.low, column.high, open_=column.open)
    if any(name in unknown for name in ("normals", "spheres", "disks")):
        _check_shapes(arrays)
    _check_materials(arrays)
    _check_lights(arrays)
    if not _OF_TEXTURES.isdisjoint(unknown):
        _check_textures(arrays)
    if any(name in unknown for name in ("sky_size", "sky_texels", "sky_to_world", "environment")):
        _check_sky(arrays)
    _check_grids(arrays)
    _check_phases(arrays)
    return arrays


def _fits(column: Column, fresh: Fresh, rows: Mapping[str, int]) -> bool:
    """Whether the extremes of an array are within its column's range."""
    low, high = column.low, column.high
    if column.indexes:
        low = 0 if column.dtype is np.uint32 else -1
        high = (KINDS.get(column.indexes) or rows.get(column.indexes, 0)) - 1
    return not column.open and low <= fresh.extremes[0] and fresh.extremes[1] <= high


def blank_row(table: str) -> dict[str, Any]:
    """A row of defaults, zeros where there is none: column -> number or list."""
    return {
        name: np.full(column.width, _fill(column), column.dtype).tolist()
        for name, column in COLUMNS.items()
        if column.table == table
    }


def _fill(column: Column) -> Any:
    return 0 if column.default is REQUIRED else column.default


def _lengths(vectors: Array) -> Array:
    x, y, z = (vectors[..., axis] for axis in range(3))
    lengths: Array = np.sqrt(x * x + y * y + z * z)
    return lengths


def _first(bad: Array) -> int | None:
    return int(np.argmax(bad)) if bad.any() else None


def _check_shapes(arrays: Mapping[str, Array]) -> None:
    normals = distinct(arrays["normals"])

    def wrong(first: int, last: int) -> str:
        lengths = _lengths(normals[first:last])
        row = _first((lengths != 0) & ~(np.abs(lengths - 1) <= 1e-3))
        return "" if row is None else f"normals[{first + row}] has length {lengths[row]:g}"

    for text in filter(None, in_chunks(wrong, len(normals), 1 << 13)):
        raise SceneError(f"{text}, expected 1, or 0 for none")
    radii = arrays["spheres"][:, 3]
    row = _first(radii <= 0)
    if row is not None:
        raise SceneError(f"spheres[{row}][3] = {radii[row]} is outside (0, {MAX_COORDINATE:g}]")
    _, a, b = (arrays["disks"][:, k] for k in range(3))
    with np.errstate(all="ignore"):
        a, b = (axis / _lengths(axis)[:, None] for axis in (a, b))
        row = _first(~(_lengths(np.cross(a, b)) > 1e-12))
    if row is not None:
        raise SceneError(f"disks[{row}] is flat: its half axes are parallel or have length 0")


def _check_materials(arrays: Mapping[str, Array]) -> None:
    kinds = arrays["material_kind"]
    opaque, refracts = (
        np.array([getattr(kind, fact) for kind in _MATERIAL_KINDS.values()])[kinds]
        for fact in ("opaque", "refracts")
    )
    row = _first(arrays["two_sided"] & ~opaque)
    if row is not None:
        raise SceneError(
            f"two_sided[{row}] is set on a {MATERIAL_KINDS[kinds[row]]}; allowed: on "
            f"{', '.join(OPAQUE_KINDS)}"
        )
    eta = arrays["eta"]
    for row in np.flatnonzero(refracts).tolist():
        first, *others = eta[row].tolist()
        if not 1 / MAX_IOR <= first <= MAX_IOR or others != [first, first]:
            raise SceneError(
                f"eta[{row}] = {eta[row].tolist()} of a {MATERIAL_KINDS[kinds[row]]}; expected one "
                f"number in [{1 / MAX_IOR:g}, {MAX_IOR:g}] three times"
            )
    for name in ("roughdielectric", "roughdielectric_whole", "principled_open"):
        row = _first((kinds == MATERIAL_KINDS.index(name)) & (eta[:, 0] == 1))
        if row is not None:
            raise SceneError(f"eta[{row}] is 1 on a {name}; equal indices have no small mirrors")
    others = arrays["blend_material"]
    behind = others > np.arange(len(others))
    row = _first((others >= 0) & (others[others] >= 0) & ~behind)
    if row is not None:
        raise SceneError(
            f"blend_material[{row}] = {others[row]}, which is a blend itself; allowed: one that is "
            "none, or comes after it"
        )
    # Not np.isin, whose np.unique ends the process where the interpreter ends in a daemon thread.
    metal = np.array([name in METALS for name in MATERIAL_KINDS])[kinds]
    for name in INDICES:
        row = _first((arrays[f"{name}_texture"] >= 0) & ~metal)
        if row is not None:
            raise SceneError(
                f"{name}_texture[{row}] is set on a {MATERIAL_KINDS[kinds[row]]}; allowed: on "
                f"{', '.join(METALS)}"
            )
    u, v = arrays["alpha_u"], arrays["alpha_v"]
    row = _first((kinds == MATERIAL_KINDS.index("roughplastic")) & (u != v))
    if row is not None:
        raise SceneError(
            f"alpha_u[{row}] = {u[row]:g} and alpha_v[{row}] = {v[row]:g}: the coat of a "
            "roughplastic has one alpha"
        )
    textured = (arrays["alpha_u_texture"] >= 0) | (arrays["alpha_v_texture"] >= 0)
    for name in WHOLE_KINDS.values():
        row = _first((kinds == MATERIAL_KINDS.index(name)) & (textured | (u != v)))
        if row is not None:
            given = (
                "has a texture"
                if textured[row]
                else f"= {u[row]:g} and alpha_v[{row}] = {v[row]:g}"
            )
            raise SceneError(
                f"alpha_u[{row}] {given}: energy compensation of a {name} is for one alpha"
            )


def _check_lights(arrays: Mapping[str, Array]) -> None:
    lengths = _lengths(arrays["light_direction"])
    kinds = arrays["light_kind"]
    row = _first((kinds != LIGHT_KINDS.index("point")) & ~(np.abs(lengths - 1) <= 1e-3))
    if row is not None:
        raise SceneError(f"light_direction[{row}] has length {lengths[row]:g}, expected 1")
    projector = kinds == LIGHT_KINDS.index("projector")
    row = _first(projector & ~(_lengths(arrays["light_image"]) > 0).all(axis=1))
    if row is not None:
        raise SceneError(
            f"light_image[{row}] = {arrays['light_image'][row].tolist()} of a projector; expected "
            "two rows that are not 0"
        )
    cutoff, beam = arrays["light_angles"].T
    row = _first((kinds == LIGHT_KINDS.index("spot")) & ~((cutoff > 0) & (beam <= cutoff)))
    if row is not None:
        raise SceneError(
            f"light_angles[{row}] = {[float(cutoff[row]), float(beam[row])]}; expected a cutoff in "
            "(0, 180] and a beam width in [0, cutoff]"
        )


def _most_of_textures(arrays: Mapping[str, Array]) -> Array:
    """The largest number that each texture may hold: that of the numbers of materials it gives."""
    most = np.full(len(arrays["texture_kind"]), np.finfo(np.float32).max, np.float32)
    for name in TEXTURABLE:
        rows = arrays[f"{name}_texture"]
        rows = rows[rows >= 0]
        most[rows] = np.minimum(most[rows], COLUMNS[name].high)
    fields = np.column_stack([arrays["texture_field0"], arrays["texture_field1"]])
    for row in np.flatnonzero((fields >= 0).any(axis=1))[::-1].tolist():  # fields come before it
        held = [field for field in fields[row].tolist() if field >= 0]
        most[held] = np.minimum(most[held], most[row])
    return most


#: Bytes of a texel by format, of colours and of grey.
TEXEL_BYTES = ((4, 1), (4, 1), (8, 2), (12, 4))


def _check_textures(arrays: Mapping[str, Array]) -> None:
    words, formats = arrays["texels"], arrays["texture_format"]
    for kind, table in (("vertex_attribute", "vertices"), ("face_attribute", "triangles")):
        ends = arrays["texture_first"].astype(np.int64) + len(arrays[table])
        given = len(arrays["attribute_values"])
        row = _first((arrays["texture_kind"] == TEXTURE_KINDS.index(kind)) & (ends > given))
        if row is not None:
            raise SceneError(
                f"texture_first[{row}] = {arrays['texture_first'][row]}: a row for each of "
                f"{len(arrays[table])} {table} ends at {ends[row]}; there are {given} "
                "attribute_values"
            )
    for name in ("texture_field0", "texture_field1"):
        fields = arrays[name]
        board = arrays["texture_kind"] == TEXTURE_KINDS.index("checkerboard")
        row = _first((fields >= 0) & ~(board & (fields < np.arange(len(fields)))))
        if row is not None:
            raise SceneError(
                f"{name}[{row}] = {fields[row]}; allowed: of a checkerboard, a texture before it"
            )
    depth = np.zeros(len(formats), np.int64)
    given_fields = (arrays["texture_field0"] >= 0) | (arrays["texture_field1"] >= 0)
    for row in np.flatnonzero(given_fields).tolist():
        held = (int(arrays[f"texture_field{k}"][row]) for k in range(2))
        depth[row] = 1 + max(depth[field] for field in held if field >= 0)
        if depth[row] > MAX_NESTED:
            raise SceneError(f"texture {row} holds textures more than {MAX_NESTED} deep")
    most = _most_of_textures(arrays)
    for name in ("texture_color0", "texture_color1"):
        row = _first(arrays[name].max(axis=1) > most)
        if row is not None:
            raise SceneError(
                f"{name}[{row}] = {arrays[name][row].tolist()} is outside [0, {most[row]:g}]"
            )
    values = arrays["attribute_values"]
    for kind, table in (("vertex_attribute", "vertices"), ("face_attribute", "triangles")):
        of_kind = arrays["texture_kind"] == TEXTURE_KINDS.index(kind)
        for row in np.flatnonzero(of_kind).tolist():
            first = int(arrays["texture_first"][row])
            of_row: Array = values[first : first + len(arrays[table])]
            bad = _first((of_row > most[row]).any(axis=1))
            if bad is not None:
                raise SceneError(
                    f"attribute_values[{first + bad}] of texture {row} holds "
                    f"{of_row[bad].max():g}, outside [0, {most[row]:g}]"
                )
    solid = arrays["texture_kind"] == TEXTURE_KINDS.index("volume")
    row = _first(solid & (formats != TEXTURE_FORMATS.index("float")))
    if row is not None:
        raise SceneError(f"texture_format[{row}] of a volume is not float")
    with np.errstate(all="ignore"):
        x, y, z = (arrays["texture_to_world"][:, :, k] for k in range(3))
        row = _first(solid & ~(np.abs((np.cross(x, y) * z).sum(axis=1)) > 0))
    if row is not None:
        raise SceneError(f"texture_to_world[{row}] is singular")
    image = arrays["texture_kind"] == TEXTURE_KINDS.index("bitmap")
    for row in np.flatnonzero(image | solid).tolist():
        name = TEXTURE_FORMATS[formats[row]]
        size = TEXEL_BYTES[formats[row]][int(arrays["texture_grey"][row])]
        width, height, first = (
            int(arrays[f"texture_{key}"][row]) for key in ("width", "height", "first")
        )
        height *= int(arrays["texture_depth"][row]) if solid[row] else 1
        last = first + -(-width * height * size // 4)
        if last > len(words):
            raise SceneError(
                f"texture_first[{row}] = {first}: {width} x {height} texels {name} end at {last}; "
                f"there are {len(words)} texels"
            )
        if name.endswith("8"):
            continue
        texels: Array = words[first:last].view("f2" if name == "half" else "f4")
        high = most[row]
        bad = _first(~((texels >= 0) & (texels <= high)))
        if bad is not None:
            raise SceneError(
                f"texels[{first + bad * texels.itemsize // 4}] of texture {row} holds "
                f"{texels[bad]:g}, outside [0, {high:g}]"
            )
    frames = arrays["sphere_frame"].astype(np.float64)
    products = (frames[:, :, None, :] * frames[:, None, :, :]).sum(axis=3)
    turned = _first(~(np.abs(products - np.eye(3)) <= 1e-3).all(axis=(1, 2)))
    if turned is not None:
        raise SceneError(f"sphere_frame[{turned}] does not hold unit axes across each other")


def _check_sky(arrays: Mapping[str, Array]) -> None:
    (width, height), texels = arrays["sky_size"].tolist(), len(arrays["sky_texels"])
    if width * height != texels or texels > MAX_SKY_TEXELS:
        raise SceneError(
            f"sky_size = [{width}, {height}] of {texels} sky_texels; expected width x height of "
            f"them, {MAX_SKY_TEXELS} at most"
        )
    if texels and arrays["environment"].any():
        raise SceneError("environment and sky_texels are both given; expected one of them")
    turn = arrays["sky_to_world"]
    off = float(np.abs(turn.T @ turn - np.eye(3)).max())
    if not off <= 1e-3:
        raise SceneError(
            f"sky_to_world = {turn.tolist()} is {off:.3g} from a rotation or reflection"
        )


def _check_grids(arrays: Mapping[str, Array]) -> None:
    count = len(arrays["cells"])
    for row, (x, y, z) in enumerate(arrays["grid_size"].tolist()):
        first = int(arrays["grid_first"][row])
        last = first + x * y * z * (1 if arrays["grid_grey"][row] else 3)
        if last > count or last > MAX_CELL_NUMBERS:
            raise SceneError(
                f"grid_first[{row}] = {first}: the numbers of {x} x {y} x {z} cells end at {last}; "
                f"there are {count} cells, and at most {MAX_CELL_NUMBERS} allowed"
            )
        linear = arrays["grid_to_world"][row][:, :3]
        scale = float(np.abs(linear).max())
        volume = float(np.abs(np.linalg.det(linear / scale))) if scale else 0.0
        if not volume > 1e-12:
            raise SceneError(f"grid_to_world[{row}] = {linear.tolist()} makes its cube flat")
    sigma, grid = arrays["sigma_t"], arrays["sigma_t_grid"]
    uneven = _first((grid >= 0) & (sigma != sigma[:, :1]).any(axis=1))
    if uneven is not None:
        raise SceneError(
            f"sigma_t[{uneven}] = {sigma[uneven].tolist()} with sigma_t_grid; expected one number "
            "three times"
        )


def _check_phases(arrays: Mapping[str, Array]) -> None:
    values, shares = arrays["phase_values"], arrays["lobe_share"]
    for row in np.flatnonzero(arrays["lobe_kind"] == PHASE_KINDS.index("tabphase")).tolist():
        first, size = int(arrays["lobe_values"][row]), int(arrays["lobe_size"][row])
        if first + size > len(values):
            raise SceneError(
                f"lobe_values[{row}] = {first}: {size} values end at {first + size}; there are "
                f"{len(values)} phase_values"
            )
        if not values[first : first + size].any():
            raise SceneError(f"phase_values[{first}:{first + size}] of lobe {row} are all 0")
    for row in np.flatnonzero(arrays["lobe_kind"] == PHASE_KINDS.index("sggx")).tolist():
        xx, yy, zz, xy, xz, yz = arrays["lobe_flakes"][row].tolist()
        areas = np.linalg.eigvalsh([[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]])
        if not 0.99e-6 * areas[2] <= areas[0] or not 0 < areas[2] <= 1 + 1e-6:
            raise SceneError(
                f"lobe_flakes[{row}] is of a matrix of eigenvalues from {areas[0]:.3g} to "
                f"{areas[2]:.3g}; expected numbers up to 1, the least a millionth of the greatest "
                "or more"
            )
    for row in np.flatnonzero(arrays["phase_lobe"] >= 0).tolist():
        first, count = int(arrays["phase_lobe"][row]), int(arrays["phase_lobes"][row])
        if first + count > len(shares):
            raise SceneError(
                f"phase_lobe[{row}] = {first}: {count} lobes end at {first + count}; there are "
                f"{len(shares)}"
            )
        total = float(shares[first : first + count].sum(dtype=np.float64))
        if not abs(total - 1) <= 1e-5:
            raise SceneError(
                f"lobe_share[{first}:{first + count}] of medium {row} add up to {total:g}, "
                "expected 1"
            )
