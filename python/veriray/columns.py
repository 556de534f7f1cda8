"""The arrays of a scene: type, shape, default, range and what each indexes."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
import numpy.typing as npt

from .errors import SceneError
from .numeric import MAX_COORDINATE, array, in_range

Array = npt.NDArray[Any]

#: Names of the values of `material_kind` and `light_kind`.
MATERIAL_KINDS = ("diffuse", "conductor", "dielectric", "plastic", "thindielectric", "null")
LIGHT_KINDS = ("point", "spot", "directional")
MAX_ETA = 1e6  # of a conductor; k likewise
MAX_IOR = 1e3  # interior over exterior index; at least 1 / MAX_IOR
REQUIRED = object()


@dataclass(frozen=True)
class Column:
    """One array: a row of shape `width` for each row of `table`.

    default: what a row holds if the array is not given. indexes: the table whose rows it names.
    """

    table: str
    dtype: Any
    width: tuple[int, ...] = ()
    default: Any = REQUIRED
    low: float = -math.inf
    high: float = math.inf
    indexes: str = ""


def _index(table: str, of: str, default: Any = REQUIRED) -> Column:
    return Column(table, np.uint32 if default is REQUIRED else np.int32, (), default, indexes=of)


_BIG = MAX_COORDINATE
#: The first column of a table is the one that says how many rows it has.
COLUMNS: dict[str, Column] = {
    "vertices": Column("vertices", np.float64, (3,), low=-_BIG, high=_BIG),
    "normals": Column("vertices", np.float64, (3,), 0.0),
    "triangles": Column("triangles", np.uint32, (3,), indexes="vertices"),
    "triangle_material": _index("triangles", "materials"),
    "triangle_emission": _index("triangles", "emissions", -1),
    "triangle_boundary": _index("triangles", "boundaries", -1),
    "spheres": Column("spheres", np.float64, (4,), low=-_BIG, high=_BIG),
    "sphere_material": _index("spheres", "materials"),
    "sphere_emission": _index("spheres", "emissions", -1),
    "sphere_boundary": _index("spheres", "boundaries", -1),
    "sphere_inward": Column("spheres", np.bool_, (), False),
    "disks": Column("disks", np.float64, (3, 3), low=-_BIG, high=_BIG),
    "disk_material": _index("disks", "materials"),
    "disk_emission": _index("disks", "emissions", -1),
    "disk_boundary": _index("disks", "boundaries", -1),
    "reflectance": Column("materials", np.float32, (3,), low=0.0, high=1.0),
    "two_sided": Column("materials", np.bool_, (), False),
    "material_kind": Column("materials", np.uint32, (), 0, indexes="material kinds"),
    "specular_reflectance": Column("materials", np.float32, (3,), 1.0, 0.0, 1.0),
    "specular_transmittance": Column("materials", np.float32, (3,), 1.0, 0.0, 1.0),
    "eta": Column("materials", np.float32, (3,), 1.0, 0.0, MAX_ETA),
    "k": Column("materials", np.float32, (3,), 0.0, 0.0, MAX_ETA),
    "opacity": Column("materials", np.float32, (), 1.0, 0.0, 1.0),
    "nonlinear": Column("materials", np.bool_, (), False),
    "emissions": Column("emissions", np.float32, (3,), low=0.0),
    "environment": Column("", np.float32, (3,), low=0.0),
    "boundaries": Column("boundaries", np.int32, (2,), -1, indexes="media"),
    "sigma_t": Column("media", np.float32, (3,), low=0.0),
    "albedo": Column("media", np.float32, (3,), 0.0, 0.0, 1.0),
    "phase_g": Column("media", np.float32, (), 0.0),
    "light_kind": Column("lights", np.uint32, indexes="light kinds"),
    "light_position": Column("lights", np.float64, (3,), 0.0, -_BIG, _BIG),
    "light_direction": Column("lights", np.float64, (3,), (0.0, 0.0, 1.0)),
    "light_intensity": Column("lights", np.float32, (3,), 1.0, 0.0),
    "light_angles": Column("lights", np.float64, (2,), (20.0, 15.0), 0.0, 180.0),
}
_SIZES = {"material kinds": len(MATERIAL_KINDS), "light kinds": len(LIGHT_KINDS)}


def checked(given: Mapping[str, Any]) -> dict[str, Array]:
    """All arrays of COLUMNS from those given; None stands for a default or an empty table.

    Raises SceneError naming array, index, value and what is allowed.
    """
    arrays: dict[str, Array] = {}
    rows: dict[str, int] = {}
    for name, column in COLUMNS.items():
        value = given[name]
        first = column.table not in rows
        length = None if first else rows[column.table]
        shape = (length, *column.width) if column.table else column.width
        if value is None and column.table:
            if length and column.default is REQUIRED:
                raise SceneError(f"{name} is missing; there are {length} {column.table}")
            arrays[name] = np.full((length or 0, *column.width), _fill(column), column.dtype)
            arrays[name].setflags(write=False)
        else:
            arrays[name] = array(name, value, column.dtype, shape)
        if first:
            rows[column.table] = len(arrays[name])
    for name, column in COLUMNS.items():
        if column.indexes:
            size = _SIZES.get(column.indexes) or rows.get(column.indexes, 0)
            low = 0 if column.dtype is np.uint32 else -1
            in_range(name, arrays[name], low, size - 1, f" (there are {size} {column.indexes})")
        elif column.dtype is not np.bool_:
            in_range(name, arrays[name], column.low, column.high)
    _check_shapes(arrays)
    _check_materials(arrays)
    in_range("phase_g", arrays["phase_g"], -1.0, 1.0, open_=True)
    _check_lights(arrays)
    return arrays


def _fill(column: Column) -> Any:
    return 0 if column.default is REQUIRED else column.default


def _lengths(vectors: Array) -> Array:
    x, y, z = (vectors[..., axis] for axis in range(3))
    lengths: Array = np.sqrt(x * x + y * y + z * z)
    return lengths


def _first(bad: Array) -> int | None:
    return int(np.argmax(bad)) if bad.any() else None


def _check_shapes(arrays: Mapping[str, Array]) -> None:
    lengths = _lengths(arrays["normals"] if arrays["normals"].any() else np.zeros((0, 3)))
    row = _first((lengths != 0) & ~(np.abs(lengths - 1) <= 1e-3))
    if row is not None:
        raise SceneError(f"normals[{row}] has length {lengths[row]:g}, expected 1, or 0 for none")
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
    opaque = np.isin(kinds, [MATERIAL_KINDS.index(n) for n in ("diffuse", "conductor", "plastic")])
    row = _first(arrays["two_sided"] & ~opaque)
    if row is not None:
        raise SceneError(
            f"two_sided[{row}] is set on a {MATERIAL_KINDS[kinds[row]]}; allowed: on diffuse, "
            "conductor, plastic"
        )
    refracts = np.isin(
        kinds, [MATERIAL_KINDS.index(n) for n in ("dielectric", "plastic", "thindielectric")]
    )
    eta = arrays["eta"]
    for row in np.flatnonzero(refracts).tolist():
        first, *others = eta[row].tolist()
        if not 1 / MAX_IOR <= first <= MAX_IOR or others != [first, first]:
            raise SceneError(
                f"eta[{row}] = {eta[row].tolist()} of a {MATERIAL_KINDS[kinds[row]]}; expected one "
                f"number in [{1 / MAX_IOR:g}, {MAX_IOR:g}] three times"
            )


def _check_lights(arrays: Mapping[str, Array]) -> None:
    lengths = _lengths(arrays["light_direction"])
    row = _first((arrays["light_kind"] != 0) & ~(np.abs(lengths - 1) <= 1e-3))
    if row is not None:
        raise SceneError(f"light_direction[{row}] has length {lengths[row]:g}, expected 1")
    cutoff, beam = arrays["light_angles"].T
    row = _first((arrays["light_kind"] == 1) & ~((cutoff > 0) & (beam <= cutoff)))
    if row is not None:
        raise SceneError(
            f"light_angles[{row}] = {[float(cutoff[row]), float(beam[row])]}; expected a cutoff in "
            "(0, 180] and a beam width in [0, cutoff]"
        )
