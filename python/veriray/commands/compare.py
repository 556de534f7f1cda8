"""`veriray compare`."""

from __future__ import annotations

import argparse
from typing import Any

from .common import check_output, say


def add(commands: Any) -> None:
    """Adds `compare` to the parser."""
    parser = commands.add_parser("compare", help="do two renders show the same radiance?")
    parser.add_argument("a", metavar="A.exr")
    parser.add_argument("b", metavar="B.exr")
    parser.add_argument("-o", "--output", metavar="REPORT.html", help="write a report")
    parser.add_argument("--json", action="store_true", help="print JSON")
    parser.set_defaults(handler=_compare)


def _compare(arguments: argparse.Namespace) -> int:
    from .. import compare

    if arguments.output:
        check_output(arguments.output, (".html",))
    report = compare(arguments.a, arguments.b)
    if arguments.output:
        report.save(arguments.output)
    say(report.to_json() if arguments.json else str(report))
    return {"pass": 0, "fail": 1}.get(report.result, 3)
