"""Scene formats. To add one: a function (path, parameters) -> node.Tree, a line in READERS, a test.

Supported objects and parameters are listed in `plugins`; elements of XML files in `mitsuba_xml`.
"""

from __future__ import annotations

import contextlib
import gc
from collections.abc import Callable, Iterator, Mapping
from pathlib import Path

from ..errors import SceneError
from ..files import read_files, replacing
from ..shipped import SHIPPED, find_shipped
from . import build, gltf, mitsuba_xml, obj_scene, write
from .node import Tree, allowed, shorten
from .report import Report

READERS: dict[str, Callable[[Path, Mapping[str, object], Report], Tree]] = {
    ".xml": mitsuba_xml.read,
    ".gltf": gltf.read,
    ".glb": gltf.read,
    ".obj": obj_scene.read,
}


def load(
    path: Path, parameters: Mapping[str, object], sensor: int | None = None, strict: bool = False
) -> build.Built:
    """Reads a scene file by its suffix. Raises SceneError."""
    reader = _reader(path)
    with _without_collector():
        return build.build(lambda report: reader(path, parameters, report), sensor, strict)


@contextlib.contextmanager
def _without_collector() -> Iterator[None]:
    """Stops the search for cycles: a tree has none, and a large one would be searched often."""
    on = gc.isenabled()
    gc.disable()
    try:
        yield
    finally:
        if on:
            gc.enable()


def convert(
    source: str, target: str, parameters: Mapping[str, object], strict: bool = False
) -> tuple[str, ...]:
    """Writes what was understood of a scene file as one of version 3.0.0; returns the notes.

    Values and references are those of `source`, includes and $names are replaced, and what has no
    effect is left out. Raises SceneError, OSError naming the path.
    """
    path = find_shipped(source) if source in SHIPPED else Path(source)
    reader = _reader(path)
    trees: list[Tree] = []

    def read(report: Report) -> Tree:
        trees.append(reader(path, parameters, report))
        return trees[-1]

    with _without_collector(), read_files() as used:
        built = build.build(read, None, strict)
        if used(target):
            raise SceneError(f"{shorten(target)}: the scene reads this file; write to another one")
        text = write.as_xml(trees[-1], Path(target).parent, built.cameras[0])
    with replacing(target) as file:
        file.write(text.encode())
    return built.notes


def _reader(path: Path) -> Callable[[Path, Mapping[str, object], Report], Tree]:
    reader = READERS.get(path.suffix.lower())
    if reader is None:
        known = ", ".join(READERS)
        raise SceneError(
            f"{shorten(path)} is neither a scene file ({known}) nor a shipped scene"
            + allowed(path.name, SHIPPED, "shipped")
        )
    return reader
