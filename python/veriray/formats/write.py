"""A tree as a scene file of version 3.0.0."""

from __future__ import annotations

import os
import re
from pathlib import Path

from lxml import etree

from ..camera import Camera
from ..errors import SceneError
from .node import Node, Ref, Tree, Value
from .plugins import FILMS, PLUGINS
from .spectra import Spectrum

_FOREIGN = re.compile("[^\t\n\r -\ud7ff\ue000-\ufffd\U00010000-\U0010ffff]")


def as_xml(tree: Tree, folder: Path, camera: Camera) -> str:
    """The text of a scene file in `folder` that means the same as the tree of a scene.

    What has no effect is left out, and numbers are written exactly. If there is no sensor, `camera`
    becomes one; if there is no integrator, `path` does, or `volpath` where there are media.
    """
    root = etree.Element("scene", version="3.0.0")
    _fill(root, tree.scene, tree, folder)
    items = (tree.ids[i.id] if isinstance(i, Ref) else i for i in tree.scene.children)
    given = {item.category for item in items}
    if "integrator" not in given:
        kind = "path" if root.find(".//medium") is None else "volpath"
        root.insert(0, etree.Element("integrator", type=kind))
    if "sensor" not in given:
        view = {
            "fov": Value("float", camera.fov, ""),
            "to_world": Value("transform", camera.to_world, ""),
        }
        sensor = etree.SubElement(root, "sensor", type="perspective")
        _fill(sensor, Node("perspective", "", "sensor", values=view), tree, folder)
    etree.indent(root, "    ")
    return etree.tostring(root, encoding="unicode") + "\n"


def _fill(element: etree._Element, node: Node, tree: Tree, folder: Path) -> None:
    params = PLUGINS[node.plugin].params
    for name, value in node.values.items():
        dark = (name, value.value) == ("sampling_weight", 0)
        if name in params and (dark or not params[name].note):
            element.append(_value(name, value, node, folder))
    held = {id(item) for item in node.children}
    for item in node.children:
        if isinstance(item, Ref):
            target = tree.ids[item.id]
            if node.category == "scene" and id(target) in held:
                continue
            child = etree.SubElement(element, "ref", id=_text(target.id))
        else:
            plugin = FILMS[0] if item.plugin in FILMS else item.plugin
            child = etree.SubElement(element, item.category, type=plugin)
            if item.id:
                child.set("id", _text(item.id))
            _fill(child, item, tree, folder)
        if item.name:
            child.set("name", _text(item.name))


def _value(name: str, value: Value, node: Node, folder: Path) -> etree._Element:
    kind, content = value.kind, value.value
    if kind == "transform":
        element = etree.Element(kind, name=name)
        etree.SubElement(element, "matrix", value=_numbers(content.ravel().tolist()))
        return element
    if kind == "array":
        raise SceneError(
            f'{node}: "{name}" is an array, which a scene file cannot hold', value.where
        )
    if isinstance(content, Spectrum):
        return etree.Element(kind, name=name, value=content.written())
    if kind == "spectrum" and len(set(content)) > 1:
        kind = "rgb"
    if kind in ("point", "vector"):
        return etree.Element(
            kind, {"name": name, **dict(zip("xyz", map(_number, content), strict=True))}
        )
    if kind == "rgb":
        text = _numbers(content)
    elif kind == "spectrum":
        text = _number(content[0])
    elif kind == "boolean":
        text = str(content).lower()
    elif name == "filename" and not os.path.isabs(content):
        text = _text(os.path.relpath(Path(node.folder) / content, folder))
    else:
        text = _text(content) if kind == "string" else str(content)
    return etree.Element(kind, name=name, value=text)


def _numbers(numbers: list[float] | tuple[float, ...]) -> str:
    return " ".join(map(_number, numbers))


def _number(number: float) -> str:
    return repr(float(number))


def _text(text: str) -> str:
    """Text in which a dollar names no parameter, and what XML cannot hold is an escape."""
    return _FOREIGN.sub(lambda m: ascii(m[0])[1:-1], text.replace("$", "\\$"))
