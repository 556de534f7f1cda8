"""`veriray convert`."""

from __future__ import annotations

import argparse
from typing import Any

from .common import add_definitions, check_output, definitions, report_notes, say


def add(commands: Any) -> None:
    """Adds `convert` to the parser."""
    parser = commands.add_parser("convert", help="write a scene file in today's dialect")
    parser.add_argument("scene", metavar="IN.xml", help="a scene file")
    parser.add_argument(
        "output", metavar="OUT.xml", help="what was understood of it, version 3.0.0"
    )
    add_definitions(parser)
    parser.set_defaults(handler=_convert)


def _convert(arguments: argparse.Namespace) -> int:
    check_output(arguments.output, (".xml",))
    from ..formats import convert

    notes = convert(arguments.scene, arguments.output, definitions(arguments), arguments.strict)
    report_notes(notes)
    say(f"written    {arguments.output}")
    return 0
