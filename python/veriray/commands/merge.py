"""`veriray merge`."""

from __future__ import annotations

import argparse
from typing import Any

from .common import CommandError, add_outputs, check_distinct, check_output, say, stops
from .render import PICTURE_SUFFIXES, SUFFIX


def add(commands: Any) -> None:
    """Adds `merge` to the parser."""
    parser = commands.add_parser("merge", help="join checkpoints of ranges of samples")
    parser.add_argument(
        "checkpoints", metavar="FILE.film", nargs="+", help="of `render --samples A:B`, any order"
    )
    add_outputs(parser, "FILE.exr, FILE.png: the picture; FILE.film: a checkpoint")
    parser.add_argument("--exposure", type=stops, default=0.0, help="stops, for PNG (0)")
    parser.set_defaults(handler=_merge)


def _merge(arguments: argparse.Namespace) -> int:
    outputs = arguments.output
    if not outputs:
        raise CommandError("no output: add -o FILE.exr, -o FILE.png or -o FILE.film")
    check_distinct(outputs, arguments.checkpoints)
    for path in outputs:
        check_output(path, (*PICTURE_SUFFIXES, SUFFIX))

    from ..checkpoint import Checkpoint
    from ..image import save

    whole = Checkpoint.merged([Checkpoint.load(path) for path in arguments.checkpoints])
    pictures = [path for path in outputs if not path.lower().endswith(SUFFIX)]
    picture = whole.picture() if pictures else None
    for path in outputs:
        if picture is not None and path in pictures:
            save(picture, path, exposure=arguments.exposure)
        else:
            whole.save(path)
    say(f"samples    {whole.first}:{whole.end} of each pixel")
    if picture is not None:
        say(f"SHA-256    {picture.film_sha256}")
    say(f"written    {', '.join(outputs)}")
    return 0
