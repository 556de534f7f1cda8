"""The scene file of the viewer: read, watched, and written with the camera and settings in use."""

from __future__ import annotations

import contextlib
import math
import os
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any

from lxml import etree

from ..errors import SceneError
from ..files import open_regular
from ..formats import READERS, write
from ..formats.node import Node
from ..formats.report import Report
from ..scene import Scene, load_file
from ..shipped import SHIPPED, find_shipped


class Source:
    """A scene file. name: as `veriray.load_file` takes it, like the other arguments."""

    def __init__(
        self,
        name: str,
        parameters: Mapping[str, object] | None = None,
        sensor: int | None = None,
        strict: bool = False,
    ) -> None:
        self.name = name
        self.path = find_shipped(name) if name in SHIPPED else Path(name)
        self._parameters = parameters or {}
        self._sensor, self._strict = sensor, strict
        self._stamps: dict[Path, tuple[int, int] | None] = {}

    def load(self) -> Scene:
        """The scene as the file has it now. Raises SceneError, OSError."""
        before = {path: _stamp(path) for path in (*self._stamps, *self._files())}
        self._stamps = dict(before)
        scene = load_file(self.name, self._parameters, sensor=self._sensor, strict=self._strict)
        self._stamps = {path: before.get(path, _stamp(path)) for path in self._files()}
        return scene

    def changed(self) -> bool:
        """Whether the file, or one that it names, is another than when it was read."""
        return any(_stamp(path) != stamp for path, stamp in self._stamps.items())

    def _files(self) -> list[Path]:
        """The scene file, those that it includes, and those that its objects name."""
        found = {self.path: None}
        if self.path.suffix.lower() == ".xml":
            found.update(dict.fromkeys(_included(self.path)))
        with contextlib.suppress(SceneError, OSError):
            for node in _nodes(self._tree().scene):
                value = node.values.get("filename")
                if value is not None and isinstance(value.value, str):
                    found[Path(node.folder) / value.value] = None
        return list(found)

    def _tree(self) -> Any:
        return READERS[self.path.suffix.lower()](self.path, self._parameters, Report())

    def xml(self, scene: Scene) -> str:
        """The text of a scene file, for the folder of this one, with the camera, film and settings
        of `scene`. Raises SceneError for what such a file cannot hold."""
        text = write.as_xml(self._tree(), self.path.parent, scene.camera)
        root = etree.fromstring(text.encode())
        sensors = root.findall("sensor")
        chosen = sensors[min(self._sensor or 0, len(sensors) - 1)]
        medium = [child for child in chosen if _is_medium(child, root)]
        for old in sensors:
            root.remove(old)
        place = len(root.findall("integrator"))
        root.insert(place, _sensor(scene, medium))
        _set_depths(root.find("integrator"), scene)
        etree.indent(root, "    ")
        return (
            '<?xml version="1.0" encoding="utf-8"?>\n'
            + etree.tostring(root, encoding="unicode")
            + "\n"
        )


def _stamp(path: Path) -> tuple[int, int] | None:
    with contextlib.suppress(OSError):
        status = os.stat(path)
        return status.st_mtime_ns, status.st_size
    return None


def _nodes(node: Node) -> Iterator[Node]:
    yield node
    for child in node.children:
        if isinstance(child, Node):
            yield from _nodes(child)


def _included(path: Path, depth: int = 0) -> Iterator[Path]:
    """The files that an XML file includes by plain names."""
    try:
        parser = etree.XMLParser(resolve_entities=False, no_network=True)
        with open_regular(path) as file:
            root = etree.fromstring(file.read(), parser)
    except (OSError, etree.XMLSyntaxError):
        return
    for element in root.iter("include"):
        inner = path.parent / str(element.get("filename", ""))
        if inner.is_file() and depth < 8:
            yield inner
            yield from _included(inner, depth + 1)


def _is_medium(element: Any, root: Any) -> bool:
    if element.tag == "ref":
        target = root.find(f".//*[@id='{element.get('id')}']")
        return target is not None and target.tag == "medium"
    return bool(element.tag == "medium")


def _put(parent: Any, kind: str, name: str, value: Any) -> None:
    etree.SubElement(parent, kind, name=name, value=repr(value) if kind == "float" else str(value))


def _sensor(scene: Scene, medium: list[Any]) -> Any:
    """The element of the scene's camera, film and sampler."""
    camera, film = scene.camera, scene.film
    offset = [float(x) for x in camera.principal_point_offset]
    plugin = camera.projection
    if camera.measures:
        raise SceneError(f"a scene file cannot hold a camera of projection {plugin}")
    if camera.aperture_radius:
        plugin = "thinlens"
        if any(offset):
            raise SceneError(
                f"principal_point_offset = {offset} with aperture_radius = "
                f"{camera.aperture_radius:g}: a scene file cannot hold both"
            )
    element = etree.Element("sensor", type=plugin)
    if plugin != "orthographic":
        _put(element, "float", "fov", float(camera.fov))
        _put(element, "string", "fov_axis", camera.fov_axis)
        if camera.aperture_radius:
            _put(element, "float", "aperture_radius", camera.aperture_radius)
        _put(element, "float", "focus_distance", camera.focus_distance)
        for name, value in zip("xy", offset, strict=True):
            if value:
                _put(element, "float", f"principal_point_offset_{name}", value)
    if camera.near_clip:
        _put(element, "float", "near_clip", camera.near_clip)
    if math.isfinite(camera.far_clip):
        _put(element, "float", "far_clip", camera.far_clip)
    matrix = " ".join(repr(float(x)) for x in camera.to_world.ravel())
    etree.SubElement(
        etree.SubElement(element, "transform", name="to_world"), "matrix", value=matrix
    )
    picture = etree.SubElement(element, "film", type="hdrfilm")
    _put(picture, "integer", "width", film.width)
    _put(picture, "integer", "height", film.height)
    filter_ = etree.SubElement(picture, "rfilter", type=film.filter)
    names = {"tent": ("radius",), "gaussian": ("stddev",), "mitchell": ("B", "C")}
    for name, value in zip(names.get(film.filter, ()), film.filter_parameters, strict=False):
        _put(filter_, "float", name, float(value))
    if film.filter == "lanczos":
        _put(filter_, "integer", "lobes", int(film.filter_parameters[0]))
    # Mitsuba's name for samples of low discrepancy
    kind = "ldsampler" if scene.sampler == "sobol" else scene.sampler
    sampler = etree.SubElement(element, "sampler", type=kind)
    _put(sampler, "integer", "sample_count", scene.spp)
    if scene.seed:
        _put(sampler, "integer", "seed", scene.seed)
    element.extend(medium)
    return element


def _set_depths(integrator: Any, scene: Scene) -> None:
    """Gives the innermost integrator the scene's depths."""
    inner = integrator
    while (nested := inner.find("integrator")) is not None:
        inner = nested
    for name in ("max_depth", "rr_depth"):
        for old in inner.findall(f"integer[@name='{name}']"):
            inner.remove(old)
    if inner.get("type") == "direct" and scene.max_depth == 2:
        return
    if inner.get("type") not in ("path", "volpath"):
        inner.set("type", "path")
        for child in list(inner):
            if child.get("name") != "hide_emitters":
                inner.remove(child)
    _put(inner, "integer", "max_depth", scene.max_depth)
    _put(inner, "integer", "rr_depth", scene.rr_depth)
