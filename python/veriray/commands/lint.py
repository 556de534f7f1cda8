"""`veriray lint`."""

from __future__ import annotations

import argparse
import json
from typing import Any

from .common import add_definitions, integer, load, say


def add(commands: Any) -> None:
    """Adds `lint` to the parser."""
    parser = commands.add_parser("lint", help="what in a scene is probably not meant")
    parser.add_argument("scene", metavar="SCENE", help="a scene file, or a shipped scene")
    parser.add_argument(
        "--sensor", type=integer, metavar="N", help="which of the file's sensors sees it, from 0"
    )
    add_definitions(parser)
    parser.add_argument(
        "--allow",
        metavar="RULE",
        action="append",
        default=[],
        help="leave this rule out; repeatable",
    )
    parser.add_argument("--json", action="store_true", help="print JSON")
    parser.set_defaults(handler=_lint, quiet=True)


def _lint(arguments: argparse.Namespace) -> int:
    import warnings

    from .. import linting
    from ..errors import SceneError, SceneWarning
    from .common import CommandError

    for rule in arguments.allow:
        if rule not in linting.RULES:
            raise CommandError(f"--allow {rule}: unknown; expected {', '.join(linting.RULES)}")
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore", SceneWarning)  # they are findings
            scene = load(arguments)
    except SceneError as error:
        if arguments.json:
            say(json.dumps({"faults": list(error.faults)}, indent=2))
        elif len(error.faults) > 1:
            say("\n".join(f"fault: {fault}" for fault in error.faults))
        raise
    found = linting.lint(scene).without(arguments.allow)
    say(found.to_json() if arguments.json else str(found))
    return 1 if found else 0
