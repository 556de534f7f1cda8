"""`veriray doctor`."""

from __future__ import annotations

import argparse
import json
from typing import Any

from .common import say


def add(commands: Any) -> None:
    """Adds `doctor` to the parser."""
    parser = commands.add_parser("doctor", help="what is installed, what works, and why not")
    parser.add_argument("--json", action="store_true", help="print JSON")
    parser.add_argument("--no-self-test", action="store_true", help="do not render anything")
    parser.set_defaults(handler=_doctor)


def _doctor(arguments: argparse.Namespace) -> int:
    from .. import doctor

    report = doctor.examine(self_test=not arguments.no_self_test)
    say(json.dumps(report, indent=2) if arguments.json else doctor.as_text(report))
    test = report["self_test"]
    return 0 if report["auto"]["device"] and (test is None or test["passed"]) else 1
