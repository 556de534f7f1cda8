"""Numbers of a scene by name: what `Scene.parameters` lists and `Scene.with_` changes.

A name is that of an object and of its parameter: the id of a bsdf, a lamp, a medium or a texture
("white.reflectance"), or a shape's name and what it is for it ("teapot.bsdf.reflectance",
"lamp.emitter.radiance", "ball.interior.sigma_t"). A lamp without shape and id is "light_0" by its
number. Numbers within `twosided`, `mask` and maps of normals are named by the material that they
hold, and by what holds it if it has no id; so is the "weight" of a blend, and its first material.
"eta" of glass and of coats is the index inside over that outside.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from typing import TYPE_CHECKING, Any

import numpy as np
import numpy.typing as npt

from .columns import COLUMNS, LIGHT_KINDS, MATERIAL_KINDS, OPEN_KINDS, TEXTURE_KINDS, WHOLE_KINDS
from .errors import SceneError
from .named import Object, Use, objects
from .numeric import distinct, shown

if TYPE_CHECKING:
    from .scene import Scene

Array = npt.NDArray[Any]
_KINDS = ("triangle", "sphere", "disk")
_SLOPES = ("alpha_u", "alpha_v")  # or "alpha" for both: listed where they are equal
_CLOSED = {kind: name for name, kind in (OPEN_KINDS | WHOLE_KINDS).items()}


def listed(scene: Scene) -> dict[str, float | tuple[float, ...]]:
    """The numbers of a scene by name. What a texture gives is left out."""
    result: dict[str, float | tuple[float, ...]] = {}
    for name, use in _all(scene):
        known = _columns(scene, use)
        for key, columns in known.items():
            if _part(scene, use, key) != use.part or _textured(scene, columns, use.row):
                continue
            if key == "opacity" and scene.opacity[use.row] == 1:
                continue
            if use.table == "materials" and key in (
                _SLOPES if scene.alpha_u[use.row] == scene.alpha_v[use.row] else ("alpha",)
            ):
                continue
            if f"{name}.{key}" in objects(scene).merged:
                continue
            value = getattr(scene, columns[0])[use.row].tolist()
            if use.form == "rest":
                value = [1 - x for x in value] if isinstance(value, list) else 1 - value
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
        for columns, use in _found(scene, name):
            for column in columns:
                array = arrays.setdefault(column, getattr(scene, column).astype(np.float64))
                place = array if use is None else array[use.row]
                try:
                    given = np.asarray(value)
                    if given.dtype.kind not in "iufb":
                        raise TypeError
                    place = np.broadcast_to(given.astype(np.float64), place.shape)
                except (TypeError, ValueError):
                    wanted = "a number" + " or three" * (place.ndim > 0)
                    raise SceneError(f'"{name}" = {shown(value)}, expected {wanted}') from None
                if use is None:
                    array[...] = place
                else:
                    array[use.row] = _stored(place, use.form)
    return arrays


def _stored(value: Array, form: str) -> Any:
    """A number as the rows of a use hold it."""
    if form and value.ndim:
        mean = sum(value.tolist()) / 3
        return 1 - mean if form == "rest" else mean
    return 1 - value if form == "rest" else value


def _found(scene: Scene, name: object) -> list[tuple[tuple[str, ...], Use | None]]:
    """The columns that hold a number, and where they do; None if they are no tables."""
    if not isinstance(name, str):
        raise SceneError(f"changes: {shown(name)} is not the name of a parameter")
    if name == "environment.radiance" and not scene.sky_size.any():
        return [(("environment",), None)]
    holder, _, key = name.rpartition(".")
    known = objects(scene)
    if name in known.merged:
        raise _merged(name, True)
    for use, parts in _meant(scene, holder):
        if key not in _columns(scene, use):
            continue
        part = _part(scene, use, key)
        if parts and part not in parts:
            continue
        owner = known.of(use.table, use.row, part)
        uses = owner.uses if owner else (use,)
        if key == "opacity" and part != key and any(_part(scene, one, key) == key for one in uses):
            continue
        if owner and {owner.name, f"{owner.name}.{key}"} & known.merged:
            raise _merged(name, owner.name not in known.merged)
        if any(one.table == "materials" and (one.row, part) in known.products for one in uses):
            raise _merged(name, part != "bsdf")
        found = [(_columns(scene, one)[key], one) for one in uses]
        if any(_textured(scene, columns, one.row) for columns, one in found):
            raise SceneError(f'"{name}" is given by a texture')
        return [*found]
    if holder in known.merged:
        raise _merged(name, False)
    from .formats.node import allowed

    raise SceneError(f'there is no parameter "{name}"{allowed(name, listed(scene), "there is")}')


def _merged(name: str, factor: bool) -> SceneError:
    text = "number of a blend of more than two bsdfs, some of which became one"
    if factor:
        text = "factor of other numbers: of nested masks, or of a blend of more than two bsdfs"
    return SceneError(f'"{name}" is also a {text}')


def _meant(scene: Scene, holder: str) -> Iterator[tuple[Use, tuple[str, ...]]]:
    """What a name may mean: a use of an object, and the parts of its row, () for all: none, one, or
    an object and a shape of one name."""
    known = objects(scene)
    for one in known.named(holder):
        yield one.uses[0], (one.uses[0].part,)
    if holder in known.holders:
        yield Use("materials", known.holders[holder]), ()
    shape, _, part = holder.rpartition(".")
    if shape in scene.shape_names:
        index = scene.shape_names.index(shape)
        for kind in _KINDS:
            first = _first_of(scene, kind, index)
            for name, table, rows in _parts(scene, kind, slice(first, first + 1)):
                if name == part and len(rows) and rows[0] >= 0:
                    yield Use(table, int(rows[0])), ()
    for row in range(len(scene.light_kind)):
        if holder == f"light_{row}":
            yield Use("lights", row), ()


def _part(scene: Scene, use: Use, key: str) -> str:
    """The part of a row of materials whose number this is; "" in other tables."""
    if use.table != "materials":
        return ""
    apart = key == "weight" or key == "opacity" and objects(scene).of("materials", use.row, key)
    return key if apart else "bsdf"


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


def _all(scene: Scene) -> Iterator[tuple[str, Use]]:
    """Every object once: its name, and the first of its uses, rather of its numbers as they are."""
    known = objects(scene)
    seen: set[tuple[str, int, str]] = set()

    def see(one: Object) -> None:
        seen.update((use.table, use.row, use.part) for use in one.uses)

    for one in known.objects:
        if one.name:
            see(one)
            if one.name not in known.merged:
                yield one.name, min(one.uses, key=lambda use: use.form != "")
    for kind in _KINDS:
        shapes = getattr(scene, f"{kind}_shape")
        for part, table, rows in _parts(scene, kind):
            found, first = np.unique(rows, return_index=True)
            for row, at in sorted(
                zip(found.tolist(), first.tolist(), strict=True), key=lambda x: x[1]
            ):
                for own in ("bsdf", "opacity", "weight") if table == "materials" else ("",):
                    place = table, row, own
                    if row < 0 or place in seen or own not in ("", "bsdf") and not known.of(*place):
                        continue
                    seen.add(place)
                    if (owner := known.of(*place)) is not None:
                        see(owner)
                    if table == "materials" and (row, own) in known.products:
                        continue
                    yield f"{scene.shape_names[shapes[at]]}.{part}", known.use(*place)
    for row in range(len(scene.light_kind)):
        if ("lights", row, "") not in seen:
            yield f"light_{row}", Use("lights", row)


def _columns(scene: Scene, use: Use) -> dict[str, tuple[str, ...]]:
    """The parameters of an object, and the columns that hold each."""
    table, row = use.table, use.row
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
        return {f"color{1 - i if use.exchanged else i}": (f"texture_color{i}",) for i in sorted(
            own, reverse=use.exchanged)}  # fmt: skip
    weight = objects(scene).of("materials", row, "weight")
    return _of_material(scene, row) | ({"weight": ("blend_weight",)} if weight else {})


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
        result |= {name: (name,) for name in _SLOPES} | {"alpha": _SLOPES}
    if "k" in params:
        result |= {"eta": ("eta",), "k": ("k",)}
    elif "int_ior" in params or "eta" in params:
        result["eta"] = ("eta",)
    if kind in OPEN_KINDS:  # through which light goes only if it is another kind
        del result["spec_trans"]
    return {**result, "opacity": ("opacity",)}


def _textured(scene: Scene, columns: tuple[str, ...], row: int) -> bool:
    """Whether a texture gives what columns hold."""
    names = [f"{'emission' if column == 'emissions' else column}_texture" for column in columns]
    return any(name in COLUMNS and getattr(scene, name)[row] >= 0 for name in names)
