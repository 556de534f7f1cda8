"""Mitsuba-style dictionaries, as mitsuba.load_dict takes them: the same rules as for files.

An object is {"type": name, parameter: value, child: object}. Values: bool, int, float, str, 4x4
arrays or objects with a `matrix` attribute, images as arrays (H, W, C), {"type": "rgb", "value":
...}, {"type": "spectrum", "value": number or pairs} and the plugins of `spectra`, {"type": "ref",
"id": name}. A key of the scene is the id of its object, beside one that it states itself. Places
in messages are key paths, "scene.white.reflectance".

Beyond Mitsuba: {"type": "mesh", "vertices": (V, 3), "faces": (T, 3)} with "uv": (V, 2) and
"normals": (V, 3) if wanted, and attributes "vertex_...": (V, 1 or 3) and "face_...": (T, 1 or 3).
A trimesh.Trimesh stands for such a dictionary with its vertices, faces
and texture coordinates; "mesh": a trimesh.Trimesh stands for these arrays in one. So does a
mitsuba.Mesh, with its normals and attributes.
"""

from __future__ import annotations

import os
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

from ..errors import SceneError
from . import ellipsoids, mitsuba_objects, spectra
from .known import category, missing
from .node import MAX_DEPTH, Node, Ref, Tree, Value, allowed, shorten
from .plugins import PLUGINS, mesh_attribute
from .report import Report

#: Most of what dictionaries hold, which is neither a mesh nor an object of Mitsuba.
_PLAIN = (dict, str, int, float, list, tuple, np.ndarray)
_ARRAYS = {
    "mesh": ("vertices", "faces", "uv", "normals"),
    "bitmap": ("bitmap", "data"),
    "envmap": ("bitmap",),
    "gridvolume": ("grid", "data"),
    "sdfgrid": ("grid",),
    **dict.fromkeys(ellipsoids.KINDS, ellipsoids.ARRAYS),
}


#: What other dictionaries than those of objects hold beside their type.
_FIELDS = {"rgb": "value", "spectrum": "value", "ref": "id"}


def read(scene: Mapping[str, Any], report: Report | None = None) -> Tree:
    """The tree of a dictionary whose type is "scene". Raises SceneError with the key path for what
    is none; `report` takes all other faults, and the tree is then not complete."""
    if not isinstance(scene, Mapping):
        raise SceneError(f"{shorten(scene)} is not a dictionary", "scene")
    if scene.get("type") != "scene":
        raise SceneError(f'"type" = {shorten(scene.get("type"))}, expected "scene"', "scene")
    report = Report() if report is None else report
    tree = Tree(Node("scene", "scene", "scene"), report=report)
    _fill(scene, tree.scene, tree, 0)
    return tree


def _fill(content: Mapping[str, Any], node: Node, tree: Tree, depth: int) -> None:
    if depth > MAX_DEPTH:
        raise SceneError(f"nested deeper than {MAX_DEPTH}", node.where[:200])
    for key in content:
        try:
            _add(key, content, node, tree, depth)
        except SceneError as error:
            tree.report.add(error)
            node.faulty = True


def _add(key: Any, content: Mapping[str, Any], node: Node, tree: Tree, depth: int) -> None:
    if not isinstance(key, str):
        raise SceneError(f"the key {shorten(key)} is not a string", node.where)
    where = f"{node.where}.{key}"
    within = node.plugin == "mesh" and key == "mesh"
    value = _described(content[key], where, content if within else {})
    if key == "type":
        return
    if key == "id":
        if not isinstance(value, str):
            raise SceneError(f"{shorten(value)} is not a string", where)
        return
    if within and isinstance(value, Mapping):
        _fill({k: v for k, v in value.items() if k not in content}, node, tree, depth)
        return
    array = key in _ARRAYS.get(node.plugin, ()) or mesh_attribute(node, key)
    if array and (node.plugin == "mesh" or not isinstance(value, (str, int, float))):
        node.values[key] = Value(
            "array", _array(value, where, node.plugin, "use_grid_bbox" in content), where
        )
        return
    item = _convert(value, where, tree)
    if isinstance(item, Value):
        node.values[key] = item
        return
    item.name = key
    node.children.append(item)
    if isinstance(item, Node):
        named = value.get("id", key if depth == 0 else "")
        item.id = named if isinstance(named, str) else ""
        if item.id:
            tree.add_id(item)
            if depth == 0 and key != item.id:
                tree.add_id(item, key)
        _fill(value, item, tree, depth + 1)
        if not item.plugin:
            tree.orphans += [child for child in item.children if isinstance(child, Node)]


def _described(value: Any, where: str = "", around: Mapping[str, Any] | None = None) -> Any:
    """A trimesh.Trimesh or mitsuba.Mesh as a dictionary; anything else as it is. around: the
    dictionary that it is the "mesh" of. Raises SceneError as `mitsuba_objects.mesh`."""
    if isinstance(value, (*_PLAIN, Mapping)):
        return value
    if mitsuba_objects.kind(value) == "Mesh":
        return mitsuba_objects.mesh(value, where, around or {})
    try:
        found = {"type": "mesh", "vertices": value.vertices, "faces": value.faces}
        uv = getattr(value.visual, "uv", None)
    except Exception:  # it is something else, and may raise anything
        return value
    return found if uv is None else {**found, "uv": uv, "flip_tex_coords": True}


def _convert(value: Any, where: str, tree: Tree) -> Value | Ref | Node:
    if isinstance(value, (dict, Mapping)):
        return _mapping(value, where, tree)
    if isinstance(value, (bool, np.bool_)):
        return Value("boolean", bool(value), where)
    if isinstance(value, (int, np.integer)):
        if abs(int(value)) >= 2**64:
            raise SceneError(f"{shorten(value)} exceeds 64 bits", where)
        return Value("integer", int(value), where)
    if isinstance(value, (float, np.floating)):
        return Value("float", float(value), where)
    if isinstance(value, (str, os.PathLike)):
        return Value("string", str(value), where)
    kind = mitsuba_objects.kind(value)
    if kind == "Bitmap" or hasattr(value, "__array_interface__") and np.asarray(value).ndim == 3:
        return Value("array", np.asarray(value), where)
    numbers, in_plane = _numbers(value, where), where.endswith(".to_uv")
    if numbers.shape == (3, 3) and in_plane:
        found = np.eye(4)
        found[np.ix_((0, 1, 3), (0, 1, 3))] = numbers
        return Value("transform", found, where)
    if numbers.shape == (4, 4):
        return Value("transform", numbers, where)
    if numbers.shape == (3,):
        return Value("rgb" if "Color3" in kind else "vector", tuple(numbers.tolist()), where)
    expected = "(4, 4) or (3, 3)" if in_plane else "(4, 4) or (3,)"
    raise SceneError(f"an array of shape {numbers.shape}, expected {expected}", where)


def _mapping(value: Mapping[str, Any], where: str, tree: Tree) -> Value | Ref | Node:
    kind = value.get("type")
    if not isinstance(kind, str):
        raise SceneError(f'"type" = {shorten(kind)} is not the name of an object', where)
    if kind in spectra.PLUGINS:
        return _spectrum_plugin(kind, value, where, tree)
    if kind not in _FIELDS:
        if kind in PLUGINS and kind != "scene":
            return Node(kind, where, PLUGINS[kind].category)
        if kind != "scene" and category(kind):  # what it holds is read, for what else is missing
            tree.report.add(SceneError(missing(category(kind), kind), where))
            return Node("", where, category(kind), faulty=True)
        names = (*(name for name in PLUGINS if name != "scene"), *_FIELDS)
        raise SceneError(f"unknown type {shorten(kind)}{allowed(kind, names)}", where)
    if kind == "spectrum":
        return _spectrum(value, where)
    field = _FIELDS[kind]
    for key in value:
        if key not in ("type", field):
            raise SceneError(
                f"{kind} has an unknown key {shorten(key)}{allowed(str(key), [field])}", where
            )
    content = value.get(field)
    if kind == "ref":
        if not isinstance(content, str):
            raise SceneError(f'"id" = {shorten(content)} is not a string', where)
        return Ref(content, where)
    if isinstance(content, str):
        return Value(kind, spectra.parse_rgb(content, '"value"', where), where)
    numbers = _numbers(content, where).ravel()
    if len(numbers) not in (1, 3):
        raise SceneError(f'"value" holds {len(numbers)} numbers, expected 1 or 3', where)
    return Value(kind, tuple(numbers.tolist()) * (3 // len(numbers)), where)


def _array(value: Any, where: str, plugin: str, boxed: bool) -> Any:
    """An array of a plugin, which of a sky shares the memory of `value`; of an image a Bitmap of a
    mitsuba.Bitmap. boxed: of a mitsuba.VolumeGrid its cells and box."""
    kind = mitsuba_objects.kind(value)
    if kind == "Bitmap" and plugin in ("bitmap", "envmap"):
        return mitsuba_objects.bitmap(value, where)
    if kind == "VolumeGrid" and boxed:
        return mitsuba_objects.volume(value, where)
    try:
        return np.asarray(value) if plugin == "envmap" else np.array(value)
    except Exception:  # as below
        raise SceneError(f"{shorten(value)} is not an array", where) from None


def _spectrum(value: Mapping[str, Any], where: str) -> Value:
    """{"type": "spectrum"} with a number, pairs of wavelength and value, text, or a file."""
    for key in value:
        if key not in ("type", "value", "filename"):
            raise SceneError(
                f"spectrum has an unknown key {shorten(key)}"
                + allowed(str(key), ["value", "filename"]),
                where,
            )
    if ("value" in value) == ("filename" in value):
        raise SceneError("spectrum: give either value or filename", where)
    content = value.get("value", value.get("filename"))
    if "filename" in value:
        if not isinstance(content, (str, os.PathLike)):
            raise SceneError(f'"filename" = {shorten(content)} is not a path', where)
        return Value("spectrum", spectra.read_spd(Path(content), '"filename"', where), where)
    if isinstance(content, str):
        return Value("spectrum", spectra.parse(content, '"value"', where), where)
    numbers = _numbers(content, where)
    if numbers.ndim == 2 and numbers.shape[1] == 2:
        if not np.isfinite(numbers).all():
            raise SceneError('"value" must be finite', where)
        wavelengths, heights = (tuple(column) for column in numbers.T.tolist())
        return Value("spectrum", spectra.listed(wavelengths, heights, '"value"', where), where)
    if numbers.size != 1:
        raise SceneError(
            f'"value" holds {numbers.size} numbers, expected one, or pairs of wavelength and value',
            where,
        )
    return Value("spectrum", tuple(numbers.ravel().tolist()) * 3, where)


def _spectrum_plugin(kind: str, content: Mapping[str, Any], where: str, tree: Tree) -> Value:
    given: dict[str, Value] = {}
    nested = []
    for key, value in content.items():
        if key in ("type", "id"):
            continue
        here = f"{where}.{key}"
        if isinstance(value, (list, tuple, np.ndarray)) and kind in ("regular", "irregular"):
            item: Value | Ref | Node = Value("numbers", _numbers(value, here).ravel(), here)
        else:
            item = _convert(value, here, tree)
        if not isinstance(item, Value):
            raise SceneError(f"{kind} cannot hold {shorten(key)}", here)
        if isinstance(value, Mapping) and value.get("type") in spectra.PLUGINS:
            nested.append(item)
        else:
            given[str(key)] = item
    return spectra.plugin(kind, given, nested, where)


def _numbers(value: Any, where: str) -> npt.NDArray[np.float64]:
    try:
        array = np.array(getattr(value, "matrix", value))
        if array.shape[:2] not in ((4, 4), (3, 3)):
            array = np.array(value)  # Dr.Jit's vectors have any attribute, by swizzling
        if array.shape in ((3, 1), (4, 4, 1), (3, 3, 1)):  # its vectors of one lane
            array = array[..., 0]
        if array.dtype.kind not in "iuf":
            raise TypeError
        return array.astype(np.float64)
    except Exception:  # any object may be given, and its conversion may raise anything
        text = f"{shorten(value)} ({type(value).__name__}) is not a value that a scene can hold"
        kind = mitsuba_objects.kind(value)
        if "Transform" in kind:
            text += ": give a 4x4 array, or a 3x3 one as to_uv"
        elif kind:
            text += ": give the dictionary that Mitsuba made it from"
        raise SceneError(text, where) from None
