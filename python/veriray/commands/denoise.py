"""`veriray denoise`."""

from __future__ import annotations

import argparse
from typing import Any

from ..extras import need
from .common import CommandError, check_distinct, check_output, say, stops


def add(commands: Any) -> None:
    """Adds `denoise` to the parser."""
    parser = commands.add_parser("denoise", help="a picture for eyes, by Open Image Denoise")
    parser.add_argument("input", metavar="IN.exr", help="a render")
    parser.add_argument("output", metavar="OUT", help="FILE.exr or FILE.png")
    parser.add_argument("--exposure", type=stops, default=0.0, help="stops, for PNG (0)")
    parser.set_defaults(handler=_denoise)


def _denoise(arguments: argparse.Namespace) -> int:
    need("denoising", "denoise")
    check_output(arguments.output, (".exr", ".png"))
    check_distinct([arguments.output], [arguments.input])
    from ..picture import Render

    noisy = Render.load(arguments.input)
    try:
        made = noisy.denoised()
    except ValueError as error:
        raise CommandError(f"{arguments.input}: {error}") from None
    made.save(arguments.output, exposure=arguments.exposure)
    say(f"written    {arguments.output}, denoised by {made.stats['denoiser']}")
    return 0
