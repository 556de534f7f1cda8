"""Scene formats. To add one: a function (path, parameters) -> node.Tree, a line in READERS, a test.

Supported objects and parameters are listed in `plugins`; elements of XML files in `mitsuba_xml`.
"""

from __future__ import annotations

import contextlib
import gc
from collections.abc import Callable, Iterator, Mapping
from pathlib import Path

from ..errors import SceneError
from ..shipped import SHIPPED
from . import build, gltf, mitsuba_xml
from .node import Tree, allowed, shorten

READERS: dict[str, Callable[[Path, Mapping[str, object]], Tree]] = {
    ".xml": mitsuba_xml.read,
    ".gltf": gltf.read,
    ".glb": gltf.read,
}


def load(path: Path, parameters: Mapping[str, object]) -> build.Built:
    """Reads a scene file by its suffix. Raises SceneError."""
    reader = READERS.get(path.suffix.lower())
    if reader is None:
        known = ", ".join(READERS)
        raise SceneError(
            f"{shorten(str(path))} is neither a scene file ({known}) nor a shipped scene"
            + allowed(path.name, SHIPPED, "shipped")
        )
    with _without_collector():
        return build.build(reader(path, parameters))


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
