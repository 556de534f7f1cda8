"""What the commands share: arguments, checks before work starts, progress."""

from __future__ import annotations

import argparse
import contextlib
import json
import math
import os
import sys
import warnings
from collections.abc import Callable, Iterator, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any, NoReturn, TextIO

from ..errors import visible
from ..extras import has_bars
from ..files import check_writable, read_files, replacing
from ..settings import DEVICES as DEVICES
from ..settings import MAX_STOPS, SETTINGS
from ..shipped import SHIPPED

if TYPE_CHECKING:
    from ..scene import Scene

SCENE_SETTINGS = ("device", "width", "height")  # with which `add_scene` adds options
LARGE_MESH = 50_000  # triangles above which the tree's build shows its progress


class CommandError(Exception):
    """A mistake on the command line; its text is all that the user needs."""


class Parser(argparse.ArgumentParser):
    """A parser whose errors are `CommandError`."""

    def error(self, message: str) -> NoReturn:
        """Raises CommandError."""
        raise CommandError(f"{message} (see {self.prog} --help)")


def add_scene(parser: argparse.ArgumentParser, *, several: bool = False) -> None:
    """Adds the arguments of commands that read a scene; `load` takes them.

    several: whether the command takes several devices.
    """
    parser.add_argument(
        "scene",
        metavar="SCENE",
        help=f"a Mitsuba XML, glTF or OBJ file, or a shipped scene: {', '.join(SHIPPED)}",
    )
    parser.add_argument(
        "--sensor", type=integer, metavar="N", help="which of the file's sensors sees it, from 0"
    )
    add_definitions(parser)
    add_settings(parser, *SCENE_SETTINGS[0 if several else 1 :])
    if not several:
        about = f"{DEVICES} (default: {SETTINGS['device'].default})"
        parser.add_argument(
            "--device", type=one_device, default=SETTINGS["device"].default, help=about
        )


def add_definitions(parser: argparse.ArgumentParser) -> None:
    """Adds the arguments that say how a scene file is read."""
    parser.add_argument(
        "-D",
        dest="defines",
        metavar="KEY=VALUE",
        action="append",
        default=[],
        help="value of $KEY in the scene file (repeatable)",
    )
    parser.add_argument(
        "--strict", action="store_true", help="what has no effect in the scene file is an error"
    )


def add_settings(parser: argparse.ArgumentParser, *names: str) -> None:
    """Adds an option for each of these render settings, "--max-depth" for "max_depth"."""
    for name in names:
        setting = SETTINGS[name]
        options: dict[str, Any] = {"default": setting.default, "help": setting.help}
        if setting.default is False:
            options["action"] = "store_true"
        elif not setting.is_text:
            options["type"] = number if isinstance(setting.low, float) else integer
        parser.add_argument(f"--{name.replace('_', '-')}", **options)


def one_device(text: str) -> str:
    """An argument that names one device."""
    if "," in text:
        raise argparse.ArgumentTypeError(f"{text!r} names several; this command takes one")
    return text


def integer(text: str) -> int:
    """An argument that is a whole number."""
    try:
        return int(text)
    except ValueError:
        raise argparse.ArgumentTypeError(f"{text!r} is not an integer") from None


def number(text: str) -> float:
    """An argument that is a number."""
    try:
        return float(text)
    except ValueError:
        raise argparse.ArgumentTypeError(f"{text!r} is not a number") from None


def stops(text: str) -> float:
    """An argument that is an exposure in stops, as `Render.save` takes it."""
    if not -MAX_STOPS <= number(text) <= MAX_STOPS:
        raise argparse.ArgumentTypeError(f"{text} is not within {-MAX_STOPS} and {MAX_STOPS} stops")
    return float(text)


def load(arguments: argparse.Namespace, outputs: Sequence[str] = ()) -> Scene:
    """The scene that the arguments of `add_scene` name; one line of warning about its notes.

    Raises CommandError where it reads a file that is in `outputs`.
    """
    from ..scene import load_file

    parameters = definitions(arguments)
    name = arguments.scene
    if name not in SHIPPED and not os.path.exists(name) and not os.path.splitext(name)[1]:
        raise CommandError(
            f"{name}: no such file, and no shipped scene of that name; shipped: "
            f"{', '.join(SHIPPED)}"
        )
    with _told() as told, read_files() as used:
        scene = load_file(name, parameters, sensor=arguments.sensor, strict=arguments.strict)
    for path in filter(used, outputs):
        raise CommandError(f"{path}: the scene reads this file; write to another one")
    if not getattr(arguments, "quiet", False):
        report_notes([note for note in scene.notes if note not in told])
    return scene


@contextlib.contextmanager
def _told() -> Iterator[list[str]]:
    """Warnings of the block, which are shown, as a list of texts; some are notes on a scene too."""
    texts: list[str] = []
    shown = warnings.showwarning

    def show(message: Warning | str, *more: Any, **named: Any) -> None:
        texts.append(str(message))
        shown(message, *more, **named)

    warnings.showwarning = show
    try:
        yield texts
    finally:
        warnings.showwarning = shown


def set_second_camera(arguments: argparse.Namespace, scene: Scene) -> None:
    """Makes a camera of the text of --motion-to."""
    text: str | None = arguments.motion_to
    if text is None:
        return
    if text.isdecimal():
        cameras = scene.cameras
        if int(text) >= len(cameras):
            raise CommandError(
                f"--motion-to {text} is outside [0, {len(cameras) - 1}]: {arguments.scene} has "
                f"{len(cameras)} sensor{'s' * (len(cameras) > 1)} (or name a file of cameras)"
            )
        arguments.motion_to = cameras[int(text)]
        return
    from ..formats import cameras as lists

    path, colon, name = text, "", ""
    if not os.path.exists(path) and ":" in text:
        path, colon, name = text.rpartition(":")
    views = lists.load(
        path, arguments.width or scene.film.width, arguments.height or scene.film.height
    )
    found = [view.camera for view in views if view.name == name or not colon]
    if len(found) != 1:
        names = [view.name for view in views]
        more = f", ... ({len(names)})" if len(names) > 8 else ""
        raise CommandError(
            f"--motion-to {text}: expected {path}:NAME with one of {', '.join(names[:8])}{more}"
        )
    arguments.motion_to = found[0]


def definitions(arguments: argparse.Namespace) -> dict[str, object]:
    """The values that -D gives."""
    parameters: dict[str, object] = {}
    for define in arguments.defines:
        key, sign, value = define.partition("=")
        if not sign or not key:
            raise CommandError(f"-D {define}: expected KEY=VALUE")
        parameters[key] = value
    return parameters


def report_notes(notes: Sequence[str]) -> None:
    """Warns of notes on a scene, in one line."""
    if notes:
        first, *others = notes
        more = f" (and {len(others)} more: `veriray info` lists them)" if others else ""
        show_warning(f"note: {first}{more}")


def add_outputs(parser: argparse.ArgumentParser, text: str) -> None:
    """Adds -o, repeatable; a list of paths."""
    parser.add_argument(
        "-o", "--output", metavar="FILE", action="append", default=[], help=f"{text}; repeatable"
    )


def check_distinct(outputs: Sequence[str], inputs: Sequence[str] = ()) -> None:
    """Raises CommandError where two outputs are one file, or an output is an input."""
    if len({os.path.realpath(path) for path in outputs}) < len(outputs):
        raise CommandError(f"the same output twice: {', '.join(outputs)}")
    read = {os.path.realpath(path) for path in inputs}
    for path in outputs:
        if os.path.realpath(path) in read:
            raise CommandError(f"{path} is an input too; write to another file")


def check_output(path: str, suffixes: Sequence[str]) -> None:
    """Raise for a path that cannot become a file: found out before hours of rendering, not after.

    CommandError for an unknown suffix; OSError naming the path for a folder that is missing or not
    writable, and for a path that is a folder or a device.
    """
    if Path(path).suffix.lower() not in suffixes:
        raise CommandError(f"{path}: unknown suffix; expected {' or '.join(suffixes)}")
    check_writable(path)


def say(text: object, *, file: TextIO | None = None) -> None:
    """Prints text, as all commands do: what it holds of files and names commands no terminal."""
    print(visible(str(text)), file=file, flush=True)


@contextlib.contextmanager
def beside(package: str) -> Iterator[None]:
    """For imports of a package beside veriray; raises CommandError where it is not installed."""
    try:
        yield
    except ModuleNotFoundError as error:
        if error.name != package:
            raise
        raise CommandError(
            f"the package {package} is not installed; veriray's source brings it: pip install ."
        ) from None


def write_json(path: str, values: dict[str, Any]) -> None:
    """Write a JSON object, one key a line, so that the file appears whole or not at all.

    Numbers that are not finite become strings ("nan", "inf"), as JSON has none. Raises OSError
    naming the path.
    """
    lines = (
        f"{json.dumps(k)}: {json.dumps(_finite(v), allow_nan=False)}" for k, v in values.items()
    )
    text = "{\n" + ",\n".join(lines) + "\n}\n"
    with replacing(path) as file:
        file.write(text.encode())


def _finite(value: Any) -> Any:
    if isinstance(value, dict):
        return {key: _finite(entry) for key, entry in value.items()}
    if isinstance(value, (list, tuple)):
        return [_finite(entry) for entry in value]
    return str(value) if isinstance(value, float) and not math.isfinite(value) else value


@contextlib.contextmanager
def show_progress(title: str, quiet: bool) -> Iterator[Callable[[float], None] | None]:
    """A progress callback: a bar on a terminal, one plain line elsewhere, None when quiet."""
    if quiet:
        yield None
        return
    if not has_bars():
        say(title, file=sys.stderr)
        yield None
        return
    from rich.console import Console
    from rich.progress import (
        BarColumn,
        Progress,
        TaskProgressColumn,
        TextColumn,
        TimeRemainingColumn,
    )

    columns = TextColumn("{task.description}"), BarColumn(), TaskProgressColumn()
    with Progress(*columns, TimeRemainingColumn(), console=Console(stderr=True)) as bar:
        task = bar.add_task(title, total=1.0)
        yield lambda fraction: bar.update(task, completed=fraction)


def show_warning(message: Warning | str, *_: object, **__: object) -> None:
    """A warning as one line on standard error; fits `warnings.showwarning`."""
    text = " ".join(str(message).splitlines())
    say(f"veriray: warning: {text}", file=sys.stderr)
