"""`veriray compare`."""

from __future__ import annotations

import argparse
from typing import Any

from .common import CommandError, check_output, integer, say


def add(commands: Any) -> None:
    """Adds `compare` to the parser."""
    parser = commands.add_parser("compare", help="do two renders show the same radiance?")
    parser.add_argument(
        "files", metavar="A.exr B.exr", nargs="*", help="the two pictures, of any program"
    )
    for side in "ab":
        parser.add_argument(
            f"--{side}", nargs="+", metavar="FILE", default=[],
            help=f"pictures of {side.upper()}, a seed each: the batches of one",
        )  # fmt: skip
    for end in ("", "-a", "-b"):
        of = f" of {end[1].upper()}" if end else ""
        parser.add_argument(
            f"--channels{end}", metavar="NAME", help=f"layer or channels to read{of}"
        )
        parser.add_argument(
            f"--spp{end}", type=integer, metavar="N", help=f"samples per pixel of each file{of}"
        )
    parser.add_argument("-o", "--output", metavar="REPORT.html", help="write a report")
    parser.add_argument("--json", action="store_true", help="print JSON")
    parser.set_defaults(handler=_compare)


def _compare(arguments: argparse.Namespace) -> int:
    from .. import compare
    from ..extras import need

    need("comparing pictures", "compare")

    if arguments.output:
        check_output(arguments.output, (".html",))
    rest = list(arguments.files)
    sides = [given or rest[:1] and [rest.pop(0)] for given in (arguments.a, arguments.b)]
    if rest or not all(sides):
        raise CommandError(
            "expected two pictures, A.exr B.exr, or several of a side by --a FILE ... and --b FILE "
            "... (see veriray compare --help)"
        )

    def pair(name: str) -> tuple[Any, Any]:
        both, *own = (getattr(arguments, f"{name}{end}") for end in ("", "_a", "_b"))
        first, second = (both if value is None else value for value in own)
        return first, second

    report = compare(sides[0], sides[1], channels=pair("channels"), spp=pair("spp"))
    if arguments.output:
        report.save(arguments.output)
    say(report.to_json() if arguments.json else str(report))
    return {"pass": 0, "fail": 1}.get(report.result, 3)
