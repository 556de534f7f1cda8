"""`veriray validate`."""

from __future__ import annotations

import argparse
import contextlib
import sys
from collections.abc import Callable, Iterator
from typing import TYPE_CHECKING, Any

from ..errors import visible
from ..extras import has_bars, need
from .common import (
    DEVICES,
    CommandError,
    add_outputs,
    beside,
    check_distinct,
    check_output,
    integer,
    say,
)

if TYPE_CHECKING:
    from veriray_validate import Outcome

SUFFIXES = (".html", ".json")
_STATUS = {"pass": 0, "fail": 1, "inconclusive": 3}


def add(commands: Any) -> None:
    """Adds `validate` to the parser."""
    parser = commands.add_parser(
        "validate", help="is the renderer on this machine right? the suite, with a report"
    )
    size = parser.add_mutually_exclusive_group()
    size.add_argument("--quick", action="store_true", help="short cases (default): minutes")
    size.add_argument("--full", action="store_true", help="all cases, 4 times the samples")
    parser.add_argument(
        "--device",
        action="append",
        help=f"{DEVICES}; repeatable (default: the fastest CPU device and every GPU)",
    )
    parser.add_argument("--level", type=integer, action="append", help="1 to 9; repeatable")
    parser.add_argument(
        "--case", metavar="PATTERN", default="*", help="of case names, as in a shell (default: *)"
    )
    parser.add_argument(
        "--seed", type=integer, help="0 to 2^64-1 (default: another one for each version)"
    )
    parser.add_argument(
        "--jobs", type=integer, help="processes (default: a processor each); 0: this one"
    )
    add_outputs(parser, "FILE.html (report) or FILE.json (numbers)")
    parser.add_argument("--json", action="store_true", help="print JSON")
    parser.set_defaults(handler=_validate)


def _validate(arguments: argparse.Namespace) -> int:
    need("veriray validate", "proof")
    for path in arguments.output:
        check_output(path, SUFFIXES)
    check_distinct(arguments.output)
    for name, low, high in (("seed", 0, 2**64 - 1), ("jobs", 0, 2**16 - 1)):
        value = getattr(arguments, name)
        if value is not None and not low <= value <= high:
            raise CommandError(f"{name} = {value} is outside [{low}, {high}]")

    with beside("veriray_validate"):
        from veriray_validate import LEVELS, Stopped, report, validate

    for level in arguments.level or ():
        if level not in LEVELS:
            raise CommandError(f"level = {level} is outside [{min(LEVELS)}, {max(LEVELS)}]")
    try:
        with _progress("full" if arguments.full else "quick") as progress:
            validation = validate(
                arguments.device,
                levels=arguments.level,
                full=arguments.full,
                pattern=arguments.case,
                seed=arguments.seed,
                workers=arguments.jobs,
                progress=progress,
            )
    except Stopped as stop:
        validation = stop.validation
    for path in arguments.output:
        validation.save(path)
    say(report.to_json(validation) if arguments.json else validation)
    if arguments.output and not arguments.json:
        say(f"written    {', '.join(arguments.output)}")
    if validation.missing:
        raise KeyboardInterrupt
    return _STATUS[report.verdict(validation)[0]]


@contextlib.contextmanager
def _progress(title: str) -> Iterator[Callable[[Outcome, int, int], None]]:
    """A progress callback for `validate`: a bar on a terminal, a line at each tenth elsewhere.

    A case that does not pass is printed at once. All of it goes to standard error.
    """
    from veriray_validate import LEVELS

    bad: list[Outcome] = []

    def state(outcome: Outcome, done: int, total: int) -> str:
        level = f"level {outcome.level} {LEVELS[outcome.level].name}"
        return f"{title} validation, {level}: {done} of {total} cases, {len(bad)} not passed"

    def noted(outcome: Outcome) -> str:
        if outcome.verdict in ("pass", "skip"):
            return ""
        bad.append(outcome)
        text = f"{outcome.verdict}: {outcome.id} on {outcome.device}: {outcome.title}\n"
        return text + (outcome.message or "no message").rstrip()

    if not has_bars():

        def line(outcome: Outcome, done: int, total: int) -> None:
            if text := noted(outcome):
                say(text, file=sys.stderr)
            if done == total or 10 * done // total > 10 * (done - 1) // total:
                say(state(outcome, done, total), file=sys.stderr)

        yield line
        return
    from rich.console import Console
    from rich.progress import BarColumn, Progress, TextColumn, TimeElapsedColumn

    console = Console(stderr=True, highlight=False)
    columns = TextColumn("{task.description}"), BarColumn(), TimeElapsedColumn()
    with Progress(*columns, console=console, redirect_stdout=False) as bar:
        task = bar.add_task(f"{title} validation", total=None)

        def show(outcome: Outcome, done: int, total: int) -> None:
            if text := noted(outcome):
                console.print(visible(text), markup=False)
            bar.update(task, completed=done, total=total, description=state(outcome, done, total))

        yield show
