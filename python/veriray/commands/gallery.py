"""`veriray gallery`."""

from __future__ import annotations

import argparse
from typing import Any

from ..extras import need
from .common import add_settings, integer, number, say, show_progress


def add(commands: Any) -> None:
    """Adds `gallery` to the parser."""
    parser = commands.add_parser("gallery", help="render the figures of the 2016 report, and more")
    parser.add_argument("names", metavar="NAME", nargs="*", help="pictures (default: all)")
    parser.add_argument("-o", "--output", metavar="DIR", default="gallery", help="(gallery)")
    parser.add_argument("--mesh", metavar="PATH", help="closed mesh (default: a generated one)")
    add_settings(parser, "spp", "seed", "device", "threads")
    size = parser.add_mutually_exclusive_group()
    size.add_argument("--width", type=integer, help="pixels; the height keeps the shape")
    size.add_argument("--scale", type=number, default=1.0, help="factor on width and height")
    parser.add_argument(
        "--force",
        action="store_true",
        help="render finished pictures again, and replace files without the gallery's mark",
    )
    parser.add_argument("--sheet", action="store_true", help="contact sheet alone, from DIR")
    parser.add_argument("--docs", metavar="DIR", help="for the page and the sheet (default: -o)")
    parser.add_argument("--list", action="store_true", help="print the names and leave")
    parser.add_argument("--quiet", action="store_true", help="print errors only")
    parser.set_defaults(handler=_gallery)


def _gallery(arguments: argparse.Namespace) -> int:
    from .. import gallery

    if arguments.list:
        say("\n".join(gallery.names()))
        return 0
    if arguments.mesh:
        need("a mesh of your own in the gallery", "formats", "trimesh")
    quiet = arguments.quiet
    gallery.run(
        arguments.names,
        arguments.output,
        sheet_only=arguments.sheet,
        show=lambda title: show_progress(title, quiet),
        say=None if quiet else say,
        **{
            name: getattr(arguments, name)
            for name in "mesh spp seed width scale device threads force docs".split()
        },
    )
    return 0
