"""Numbers of a scene by name: what `Scene.parameters` lists and `Scene.with_` changes.

A name is that of an object and of its parameter: the id of a bsdf, a lamp, a medium or a texture
("white.reflectance"), or a shape's name and what it is for it ("teapot.bsdf.reflectance",
"lamp.emitter.radiance", "ball.interior.sigma_t"). A lamp without shape and id is "light_0" by its
number. Names within `twosided` and `mask` are those of the material that they hold; "eta" of glass
and of coats is the index inside over that outside.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from typing import TYPE_CHECKING, Any

import numpy as np
import numpy.typing as npt

from .columns import COLUMNS, LIGHT_KINDS, MATERIAL_KINDS, OPEN_KINDS, TEXTURE_KINDS, WHOLE_KINDS
from .errors import SceneError
from .numeric import distinct, shown

if TYPE_CHECKING:
    from .scene import Scene

Array = npt.NDArray[Any]
_KINDS = ("triangle", "sphere", "disk")
_CLOSED = {kind: name for name, kind in (OPEN_KINDS | WHOLE_KINDS).items()}


def listed(scene: Scene) -> dict[str, float | tuple[float, ...]]:
    """The numbers of a scene by name. What a texture gives is left out."""
    result: dict[str, float | tuple[float, ...]] = {}
    for name, table, row in _objects(scene):
        known = _columns(scene, table, row)
        for key, columns in known.items():
            if key == "opacity" and scene.opacity[row] == 1 or _textured(scene, columns, row):
                continue
            value = getattr(scene, columns[0])[row].tolist()
            if key == "eta" and "k" not in known:
                value = value[0]
            result[f"{name}.{key}"] = tuple(value) if isinstance(value, list) else value
    if scene.environment.any():
        result["environment.radiance"] = tuple(scene.environment.tolist())
    return result


def changed(scene: Scene, changes: Mapping[str, Any]) -> dict[str, Array]:
    """The arrays of a scene in which numbers have changed. Raises SceneError naming the name."""
    arrays: dict[str, Array] = {}
    for name, value in changes.items():
        columns, row = _found(scene, name)
        for column in columns:
            array = arrays.setdefault(column, getattr(scene, column).astype(np.float64))
            place = array if row is None else array[row]
            try:
                given = np.asarray(value)
                if given.dtype.kind not in "iufb":
                    raise TypeError
                place = np.broadcast_to(given.astype(np.float64), place.shape)
            except (TypeError, ValueError):
                wanted = "a number" + " or three" * (place.ndim > 0)
                raise SceneError(f'"{name}" = {shown(value)}, expected {wanted}') from None
            array[... if row is None else row] = place
    return arrays


def _found(scene: Scene, name: object) -> tuple[tuple[str, ...], int | None]:
    """The columns that hold a number, and its row; None if they are no tables."""
    if not isinstance(name, str):
        raise SceneError(f"changes: {shown(name)} is not the name of a parameter")
    if name == "environment.radiance" and not scene.sky_size.any():
        return ("environment",), None
    holder, _, key = name.rpartition(".")
    for table, row in _meant(scene, holder):
        columns = _columns(scene, table, row).get(key)
        if columns is None:
            continue
        if _textured(scene, columns, row):
            raise SceneError(f'"{name}" is given by a texture')
        return columns, row
    from .formats.node import allowed

    raise SceneError(f'there is no parameter "{name}"{allowed(name, listed(scene), "there is")}')


def _meant(scene: Scene, holder: str) -> Iterator[tuple[str, int]]:
    """The table and row of what a name means: none, one, or an object and a shape of one name."""
    ids = _ids(scene)
    if holder in ids:
        yield ids[holder]
    shape, _, part = holder.rpartition(".")
    if shape in scene.shape_names:
        index = scene.shape_names.index(shape)
        for kind in _KINDS:
            first = _first_of(scene, kind, index)
            for name, table, rows in _parts(scene, kind, slice(first, first + 1)):
                if name == part and len(rows) and rows[0] >= 0:
                    yield table, int(rows[0])
    for row in range(len(scene.light_kind)):
        if holder == f"light_{row}":
            yield "lights", row


def _first_of(scene: Scene, kind: str, index: int) -> int:
    """The first triangle, sphere or disk of a shape; how many there are if it has none."""
    shapes = getattr(scene, f"{kind}_shape")
    if distinct(shapes) is not shapes:
        return 0 if shapes[0] == index else len(shapes)
    found = shapes == index
    return int(found.argmax()) if found.any() else len(shapes)


def _parts(scene: Scene, kind: str, of: slice = slice(None)) -> Iterator[tuple[str, str, Array]]:
    """What triangles, spheres or disks have: its name, its table, and its row for each or -1."""
    yield "bsdf", "materials", getattr(scene, f"{kind}_material")[of]
    yield "emitter", "emissions", getattr(scene, f"{kind}_emission")[of]
    boundary = getattr(scene, f"{kind}_boundary")[of]
    media = np.concatenate([scene.boundaries, [[-1, -1]]])[boundary]  # -1: the last
    yield "interior", "media", media[:, 0]
    yield "exterior", "media", media[:, 1]


def _objects(scene: Scene) -> Iterator[tuple[str, str, int]]:
    """Every object once: its name, its table and its row there."""
    named: set[tuple[str, int]] = set()
    for name, item in _ids(scene).items():
        named.add(item)
        yield name, *item
    for kind in _KINDS:
        shapes = getattr(scene, f"{kind}_shape")
        for part, table, rows in _parts(scene, kind):
            found, first = np.unique(rows, return_index=True)
            for row, at in sorted(
                zip(found.tolist(), first.tolist(), strict=True), key=lambda x: x[1]
            ):
                if row >= 0 and (table, row) not in named:
                    named.add((table, row))
                    yield f"{scene.shape_names[shapes[at]]}.{part}", table, row
    for row in range(len(scene.light_kind)):
        if ("lights", row) not in named:
            yield f"light_{row}", "lights", row


def _ids(scene: Scene) -> dict[str, tuple[str, int]]:
    ids: dict[str, tuple[str, int]] = scene.__dict__.get("_ids", {})
    return ids


def _columns(scene: Scene, table: str, row: int) -> dict[str, tuple[str, ...]]:
    """The parameters of an object, and the columns that hold each."""
    if table == "emissions":
        return {"radiance": ("emissions",)}
    if table == "media":
        known: dict[str, tuple[str, ...]] = {"sigma_t": ("sigma_t",), "albedo": ("albedo",)}
        return known if scene.phase_lobe[row] >= 0 else {**known, "g": ("phase_g",)}
    if table == "lights":
        kind = LIGHT_KINDS[scene.light_kind[row]]
        light = "irradiance" if kind == "directional" else "intensity"
        place = {} if kind == "directional" else {"position": ("light_position",)}
        return {light: ("light_intensity",), **place}
    if table == "textures":
        if TEXTURE_KINDS[scene.texture_kind[row]] != "checkerboard":
            return {}
        fields = (getattr(scene, f"texture_field{i}")[row] for i in range(2))
        own = [i for i, field in enumerate(fields) if field < 0]
        return {f"color{i}": (f"texture_color{i}",) for i in own}
    return _of_material(scene, row)


def _of_material(scene: Scene, row: int) -> dict[str, tuple[str, ...]]:
    from .formats.plugins import PLUGINS

    kind = MATERIAL_KINDS[scene.material_kind[row]]
    params = PLUGINS[_CLOSED.get(kind, kind)].params
    result: dict[str, tuple[str, ...]] = {
        name: (param.column,)
        for name, param in params.items()
        if param.column and COLUMNS[param.column].dtype == np.float32
    }
    if "distribution" in params:
        slopes = ("alpha_u", "alpha_v")
        alike = scene.alpha_u[row] == scene.alpha_v[row]
        result = {name: columns for name, columns in result.items() if "alpha" not in name}
        result |= {"alpha": slopes} if alike else {name: (name,) for name in slopes}
    if "k" in params:
        result |= {"eta": ("eta",), "k": ("k",)}
    elif "int_ior" in params or "eta" in params:
        result["eta"] = ("eta",)
    if kind in OPEN_KINDS:  # through which light goes only if it is another kind
        del result["spec_trans"]
    return {**result, "opacity": ("opacity",)}


def _textured(scene: Scene, columns: tuple[str, ...], row: int) -> bool:
    return any(
        f"{column}_texture" in COLUMNS and getattr(scene, f"{column}_texture")[row] >= 0
        for column in columns
    )
