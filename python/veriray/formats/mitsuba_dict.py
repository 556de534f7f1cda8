"""Mitsuba-style dictionaries, as mitsuba.load_dict takes them: the same rules as for files.

An object is {"type": name, parameter: value, child: object}. Values: bool, int, float, str, 4x4
arrays or objects with a `matrix` attribute, images as arrays (H, W, C),
{"type": "rgb", "value": ...}, {"type": "spectrum", "value": number}, {"type": "ref", "id": name}. A
key of the scene is the id of its object. Places in messages are key paths, "scene.white.reflectance".
"""

from __future__ import annotations

import os
from collections.abc import Mapping
from typing import Any

import numpy as np
import numpy.typing as npt

from ..errors import SceneError
from .node import MAX_DEPTH, Node, Ref, Tree, Value, allowed, shorten
from .plugins import PLUGINS


def read(scene: Mapping[str, Any]) -> Tree:
    """The tree of a dictionary whose type is "scene". Raises SceneError with the key path."""
    if not isinstance(scene, Mapping):
        raise SceneError(f"{shorten(scene)} is not a dictionary", "scene")
    if scene.get("type") != "scene":
        raise SceneError(f'"type" = {shorten(scene.get("type"))}, expected "scene"', "scene")
    tree = Tree(Node("scene", "scene", "scene"))
    _fill(scene, tree.scene, tree, 0)
    return tree


def _fill(content: Mapping[str, Any], node: Node, tree: Tree, depth: int) -> None:
    if depth > MAX_DEPTH:
        raise SceneError(f"nested deeper than {MAX_DEPTH}", node.where[:200])
    for key, value in content.items():
        if not isinstance(key, str):
            raise SceneError(f"the key {shorten(key)} is not a string", node.where)
        where = f"{node.where}.{key}"
        if key == "type":
            continue
        if key == "id":
            if not isinstance(value, str):
                raise SceneError(f"{shorten(value)} is not a string", where)
            continue
        item = _convert(value, where)
        if isinstance(item, Value):
            node.values[key] = item
            continue
        item.name = key
        if isinstance(item, Ref):
            node.children.append(item)
        else:
            named = value.get("id", key if depth == 0 else "")
            item.id = named if isinstance(named, str) else ""
            if item.id:
                tree.add_id(item)
            node.children.append(item)
            _fill(value, item, tree, depth + 1)


def _convert(value: Any, where: str) -> Value | Ref | Node:
    if isinstance(value, Mapping):
        return _mapping(value, where)
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
    if hasattr(value, "__array_interface__") and np.asarray(value).ndim == 3:  # mitsuba.Bitmap too
        return Value("array", np.asarray(value), where)
    numbers = _numbers(value, where)
    if numbers.shape == (4, 4):
        return Value("transform", numbers, where)
    if numbers.shape == (3,):
        return Value("vector", tuple(numbers.tolist()), where)
    raise SceneError(f"an array of shape {numbers.shape}, expected (4, 4) or (3,)", where)


def _mapping(value: Mapping[str, Any], where: str) -> Value | Ref | Node:
    kind = value.get("type")
    if not isinstance(kind, str):
        raise SceneError(f'"type" = {shorten(kind)} is not the name of an object', where)
    fields = {"rgb": "value", "spectrum": "value", "ref": "id"}
    if kind not in fields:
        if kind not in PLUGINS or kind == "scene":
            names = (*(name for name in PLUGINS if name != "scene"), *fields)
            raise SceneError(f"unknown type {shorten(kind)}{allowed(kind, names)}", where)
        return Node(kind, where, PLUGINS[kind].category)
    for key in value:
        if key not in ("type", fields[kind]):
            raise SceneError(
                f"{kind} has an unknown key {shorten(key)}{allowed(str(key), [fields[kind]])}",
                where,
            )
    content = value.get(fields[kind])
    if kind == "ref":
        if not isinstance(content, str):
            raise SceneError(f'"id" = {shorten(content)} is not a string', where)
        return Ref(content, where)
    numbers = _numbers(content, where).ravel()
    counts = (1, 3) if kind == "rgb" else (1,)
    if len(numbers) not in counts:
        expected = " or ".join(str(n) for n in counts)
        raise SceneError(f'"value" holds {len(numbers)} numbers, expected {expected}', where)
    return Value(kind, tuple(numbers.tolist()) * (3 // len(numbers)), where)


def _numbers(value: Any, where: str) -> npt.NDArray[np.float64]:
    try:
        array = np.array(getattr(value, "matrix", value))
        if array.dtype.kind not in "iuf":
            raise TypeError
        return array.astype(np.float64)
    except Exception:  # any object may be given, and its conversion may raise anything
        raise SceneError(
            f"{shorten(value)} ({type(value).__name__}) is not a value that a scene can hold",
            where,
        ) from None
