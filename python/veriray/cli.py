"""The command `veriray`: render, merge, dataset, compare, validate, info, lint, convert, denoise,
gallery, view, bench, doctor.

Results go to standard output, progress and errors to standard error. Exit status: 0 done (compare:
the pictures agree; validate: passed), 1 compare: they differ, validate: a case failed, lint: there
are findings, doctor: the self-test failed, 2 error, 3 compare, validate: too little data for a
verdict, 130 Ctrl-C, 143 SIGTERM and 129 SIGHUP, which do what Ctrl-C does.
"""

from __future__ import annotations

import argparse
import contextlib
import io
import logging
import os
import sys
import warnings
from collections.abc import Callable, Sequence

from . import __version__, interrupts
from .commands import (
    bench,
    compare,
    convert,
    dataset,
    denoise,
    doctor,
    gallery,
    info,
    lint,
    merge,
    render,
    validate,
    view,
)
from .commands.common import CommandError, Parser, say, show_warning
from .errors import MissingPackageError

COMMANDS = (
    render, merge, dataset, compare, validate, info, lint, convert, denoise, gallery, view, bench,
    doctor,
)  # fmt: skip


def main(argv: Sequence[str] | None = None) -> int:
    """Run the command; returns its exit status. A user's error never becomes a traceback."""
    logging.getLogger("veriray").setLevel(logging.ERROR)  # the command prints the choice itself
    warnings.showwarning = show_warning
    if isinstance(sys.stdout, io.TextIOWrapper):
        sys.stdout.reconfigure(errors="backslashreplace")
    try:
        status = _run(argv)
        sys.stdout.flush()
        return status
    except KeyboardInterrupt:
        return _fail("interrupted", interrupts.status())
    except OSError as error:
        return _fail(_os_error_text(error))
    except MemoryError as error:
        return _fail(f"out of memory: {error}" if str(error) else "out of memory")
    except (CommandError, MissingPackageError, ValueError, RuntimeError) as error:
        return _fail(str(error) or type(error).__name__)
    except Exception as error:
        if os.environ.get("VERIRAY_TRACEBACK"):
            raise
        return _fail(
            f"internal error: {type(error).__name__}: {error} (a bug: please report it with what "
            "VERIRAY_TRACEBACK=1 prints)"
        )


def _run(argv: Sequence[str] | None) -> int:
    arguments = _parser().parse_args(argv)
    handler: Callable[[argparse.Namespace], int] = arguments.handler
    return handler(arguments)


def _fail(message: str, status: int = 2) -> int:
    with contextlib.suppress(OSError, ValueError):
        say("veriray: error: " + " ".join(message.split("\n")), file=sys.stderr)
    return status


def _os_error_text(error: OSError) -> str:
    reason = error.strerror or str(error) or type(error).__name__
    return f"{os.fspath(error.filename)}: {reason}" if error.filename else reason


def _parser() -> argparse.ArgumentParser:
    parser = Parser(
        prog="veriray",
        description="A CUDA and CPU path tracer whose every picture can be proved right.",
    )
    parser.add_argument("--version", action="version", version=f"veriray {__version__}")
    commands = parser.add_subparsers(metavar="COMMAND", required=True, parser_class=Parser)
    for command in COMMANDS:
        command.add(commands)
    return parser
