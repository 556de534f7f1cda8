"""`veriray dataset`."""

from __future__ import annotations

import argparse
from typing import Any

from ..settings import SETTINGS
from .common import (
    SCENE_SETTINGS,
    add_scene,
    add_settings,
    load,
    say,
    set_second_camera,
    show_progress,
    stops,
)


def add(commands: Any) -> None:
    """Adds `dataset` to the parser."""
    parser = commands.add_parser("dataset", help="render many views of a scene, resumable")
    add_scene(parser, several=True)
    parser.add_argument(
        "--cameras", metavar="FILE",
        help="transforms.json, a folder of COLMAP's, or a list for OpenCV, OpenGL or Mitsuba; "
        "without it all sensors of the scene",
    )  # fmt: skip
    parser.add_argument("-o", "--output", metavar="FOLDER", required=True, help="for the pictures")
    names = (name for name in SETTINGS if name not in SCENE_SETTINGS)
    add_settings(parser, *names)
    parser.add_argument("--png", action="store_true", help="write display copies too")
    parser.add_argument("--exposure", type=stops, default=0.0, help="stops, for PNG (0)")
    parser.add_argument(
        "--again", action="store_true", help="replace files of other settings or another origin"
    )
    parser.add_argument("--quiet", action="store_true", help="print errors only")
    parser.set_defaults(handler=_dataset)


def _dataset(arguments: argparse.Namespace) -> int:
    from ..datasets import dataset

    scene = load(arguments)
    set_second_camera(arguments, scene)
    settings = {name: getattr(arguments, name) for name in SETTINGS}
    with show_progress("rendering views", arguments.quiet) as progress:
        files = dataset(
            scene, arguments.output, arguments.cameras, png=arguments.png,
            exposure=arguments.exposure, again=arguments.again, progress=progress, **settings,
        )  # fmt: skip
    if not arguments.quiet:
        say(f"written    {len(files) - 1} views, {files[-1]}")
    return 0
