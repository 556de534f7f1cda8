"""Scenes that come with veriray."""

from __future__ import annotations

from pathlib import Path

from .errors import SceneError

#: Name -> path in the folder of scenes.
SHIPPED = {
    "cornell-box": "cornell/cornell_box.xml",
    "cornell-box-mitsuba": "cornell/cornell_box_mitsuba.xml",
    "open": "open.xml",
}


def find_shipped(name: str) -> Path:
    """Path of a shipped scene: in the installed package, else in the source checkout."""
    package = Path(__file__).resolve().parent
    for root in (package / "scenes", package.parents[1] / "scenes"):
        path = root / SHIPPED[name]
        if path.is_file():
            return path
    raise SceneError(f"shipped scene {name!r} is not installed ({SHIPPED[name]} is missing)")
