"""`veriray info`."""

from __future__ import annotations

import argparse
import json
from typing import Any

from .common import LARGE_MESH, add_scene, load, say, show_progress


def add(commands: Any) -> None:
    """Adds `info` to the parser."""
    parser = commands.add_parser("info", help="what a scene needs, and what is compiled in for it")
    add_scene(parser)
    parser.add_argument("--json", action="store_true", help="print JSON")
    parser.set_defaults(handler=_info)


def _info(arguments: argparse.Namespace) -> int:
    from .. import info
    from ..errors import SceneError

    try:
        scene = load(arguments)
    except SceneError as error:
        if len(error.faults) > 1:
            faults = list(error.faults)
            text = "\n".join(f"fault       {fault}" for fault in faults)
            say(json.dumps({"faults": faults}, indent=2) if arguments.json else text)
        raise
    quiet = arguments.json or len(scene.triangles) < LARGE_MESH
    with show_progress("building the tree", quiet) as progress:
        report = info.examine(scene, arguments.device, arguments.width, arguments.height, progress)
    say(json.dumps(report, indent=2) if arguments.json else info.as_text(report))
    return 0
