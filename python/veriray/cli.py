"""The command `veriray`: render, compare, info, gallery, bench live-rays, doctor.

Results go to standard output, progress and errors to standard error. Exit status: 0 done (compare:
the pictures agree), 1 compare: they differ, doctor: the self-test failed, 2 error, 3 compare: too
little data for a verdict, 130 Ctrl-C.
"""

from __future__ import annotations

import argparse
import contextlib
import errno
import io
import json
import logging
import math
import os
import secrets
import sys
import warnings
from collections.abc import Callable, Iterator, Sequence
from pathlib import Path
from typing import Any, NoReturn

from . import __version__
from .image import replacing
from .scene import SHIPPED, Scene, load_file

PICTURE_SUFFIXES = (".exr", ".png")
TABLE_ROWS = 12
LARGE_MESH = 50_000  # triangles above which the tree's build shows its progress
DEVICES = "auto, cuda, cuda:N, cpu, cpu:avx512, cpu:avx2, cpu:portable"


class CommandError(Exception):
    """A mistake on the command line; its text is all that the user needs."""


class _Parser(argparse.ArgumentParser):
    def error(self, message: str) -> NoReturn:
        raise CommandError(f"{message} (see {self.prog} --help)")


def main(argv: Sequence[str] | None = None) -> int:
    """Run the command; returns its exit status and never lets a user's error become a traceback."""
    logging.getLogger("veriray").setLevel(logging.ERROR)  # the command prints the choice itself
    warnings.showwarning = _show_warning
    if isinstance(sys.stdout, io.TextIOWrapper):
        sys.stdout.reconfigure(errors="backslashreplace")
    try:
        status = _run(argv)
        sys.stdout.flush()
        return status
    except BrokenPipeError:
        # The reader went away (`veriray ... | head`); keep the interpreter from flushing again.
        with contextlib.suppress(OSError):
            os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
        return 141
    except KeyboardInterrupt:
        return _fail("interrupted", 130)
    except OSError as error:
        return _fail(_os_error_text(error))
    except MemoryError as error:
        return _fail(f"out of memory: {error}" if str(error) else "out of memory")
    except (CommandError, ValueError, RuntimeError) as error:
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
        print("veriray: error: " + " ".join(message.split("\n")), file=sys.stderr, flush=True)
    return status


def _os_error_text(error: OSError) -> str:
    reason = error.strerror or str(error) or type(error).__name__
    return f"{os.fspath(error.filename)}: {reason}" if error.filename else reason


def _show_warning(message: Warning | str, *_: object, **__: object) -> None:
    print(f"veriray: warning: {message}", file=sys.stderr)


def _parser() -> argparse.ArgumentParser:
    parser = _Parser(
        prog="veriray",
        description="A CUDA and CPU path tracer whose every picture can be proved right.",
    )
    parser.add_argument("--version", action="version", version=f"veriray {__version__}")
    commands = parser.add_subparsers(metavar="COMMAND", required=True, parser_class=_Parser)
    _add_render(commands)
    _add_compare(commands)
    _add_info(commands)
    _add_gallery(commands)
    _add_bench(commands)
    _add_doctor(commands)
    return parser


def _add_scene(parser: argparse.ArgumentParser) -> None:
    parser.add_argument(
        "scene",
        metavar="SCENE",
        help=f"a Mitsuba 3 XML file, or a shipped scene: {', '.join(SHIPPED)}",
    )
    parser.add_argument(
        "-D",
        dest="defines",
        metavar="KEY=VALUE",
        action="append",
        default=[],
        help="value of $KEY in the scene file (repeatable)",
    )
    parser.add_argument("--device", default="auto", help=f"{DEVICES} (default: auto)")
    parser.add_argument("--width", type=_integer, help="film width in pixels")
    parser.add_argument("--height", type=_integer, help="film height in pixels")


def _add_render(commands: Any) -> None:
    parser = commands.add_parser("render", help="render a scene")
    _add_scene(parser)
    parser.add_argument(
        "-o",
        "--output",
        metavar="FILE",
        action="append",
        default=[],
        help="FILE.exr (everything) or FILE.png (display copy); repeatable",
    )
    parser.add_argument("--spp", type=_integer, help="samples per pixel (default: the scene's)")
    parser.add_argument("--seed", type=_integer, default=0, help="0 to 2^64-1 (default: 0)")
    parser.add_argument("--scheduler", default="auto", help="auto, fused or thrust")
    parser.add_argument("--max-depth", type=_integer, help="longest path; 1 emission, -1 unlimited")
    parser.add_argument("--rr-depth", type=_integer, help="first depth of Russian roulette")
    parser.add_argument("--threads", type=_integer, help="CPU threads (default: all)")
    parser.add_argument("--batches", type=_integer, default=0, help="batch means to keep, 0 or 2+")
    parser.add_argument("--batch-size", type=_integer, default=0, help="paths in flight; 0: auto")
    parser.add_argument("--all-features", action="store_true", help="run the all-features variant")
    parser.add_argument("--stats", metavar="FILE.json", help="write the statistics as JSON")
    parser.add_argument("--quiet", action="store_true", help="print errors only")
    parser.add_argument(
        "--pixel",
        nargs=2,
        type=_integer,
        metavar=("X", "Y"),
        help="do not render: print one path of this pixel vertex by vertex",
    )
    parser.add_argument("--sample", type=_integer, default=None, metavar="N", help="with --pixel")
    parser.set_defaults(handler=_render)


def _add_compare(commands: Any) -> None:
    parser = commands.add_parser("compare", help="do two renders show the same radiance?")
    parser.add_argument("a", metavar="A.exr")
    parser.add_argument("b", metavar="B.exr")
    parser.add_argument("-o", "--output", metavar="REPORT.html", help="write a report")
    parser.add_argument("--json", action="store_true", help="print JSON")
    parser.set_defaults(handler=_compare)


def _add_info(commands: Any) -> None:
    parser = commands.add_parser("info", help="what a scene needs, and what is compiled in for it")
    _add_scene(parser)
    parser.add_argument("--json", action="store_true", help="print JSON")
    parser.set_defaults(handler=_info)


def _add_gallery(commands: Any) -> None:
    parser = commands.add_parser("gallery", help="render the figures of the 2016 report")
    parser.add_argument("names", metavar="NAME", nargs="*", help="pictures (default: all)")
    parser.add_argument("-o", "--output", metavar="DIR", default="gallery", help="(gallery)")
    parser.add_argument("--mesh", metavar="PATH", help="closed mesh (default: a generated one)")
    parser.add_argument("--spp", type=_integer, help="samples per pixel (default: the scene's)")
    parser.add_argument("--seed", type=_integer, default=0, help="0 to 2^64-1 (default: 0)")
    size = parser.add_mutually_exclusive_group()
    size.add_argument("--width", type=_integer, help="pixels; the height keeps the shape")
    size.add_argument("--scale", type=_number, default=1.0, help="factor on width and height")
    parser.add_argument("--device", default="auto", help=f"{DEVICES} (default: auto)")
    parser.add_argument("--threads", type=_integer, help="CPU threads (default: all)")
    parser.add_argument("--force", action="store_true", help="render finished pictures again")
    parser.add_argument("--sheet", action="store_true", help="contact sheet alone, from DIR")
    parser.add_argument("--docs", metavar="DIR", help="for the page and the sheet (default: -o)")
    parser.add_argument("--list", action="store_true", help="print the names and leave")
    parser.add_argument("--quiet", action="store_true", help="print errors only")
    parser.set_defaults(handler=_gallery)


def _add_bench(commands: Any) -> None:
    bench = commands.add_parser("bench", help="measurements")
    kinds = bench.add_subparsers(metavar="KIND", required=True, parser_class=_Parser)
    parser = kinds.add_parser("live-rays", help="live rays, thread blocks and time at each depth")
    _add_scene(parser)
    parser.set_defaults(handler=_bench_live_rays, width=1280, height=720)
    parser.add_argument("--spp", type=_integer, default=1, help="samples per pixel (default: 1)")
    parser.add_argument("--scheduler", default="thrust", help="thrust (default), fused or auto")
    parser.add_argument("--json", metavar="FILE", help="write table and settings as JSON")


def _add_doctor(commands: Any) -> None:
    parser = commands.add_parser("doctor", help="what is installed, what works, and why not")
    parser.add_argument("--json", action="store_true", help="print JSON")
    parser.add_argument("--no-self-test", action="store_true", help="do not render anything")
    parser.set_defaults(handler=_doctor)


def _integer(text: str) -> int:
    try:
        return int(text)
    except ValueError:
        raise argparse.ArgumentTypeError(f"{text!r} is not an integer") from None


def _number(text: str) -> float:
    try:
        return float(text)
    except ValueError:
        raise argparse.ArgumentTypeError(f"{text!r} is not a number") from None


def _load(arguments: argparse.Namespace) -> Scene:
    parameters: dict[str, object] = {}
    for define in arguments.defines:
        key, sign, value = define.partition("=")
        if not sign or not key:
            raise CommandError(f"-D {define}: expected KEY=VALUE")
        parameters[key] = value
    name = arguments.scene
    if name not in SHIPPED and not os.path.exists(name) and not os.path.splitext(name)[1]:
        raise CommandError(
            f"{name}: no such file, and no shipped scene of that name; shipped: "
            f"{', '.join(SHIPPED)}"
        )
    return load_file(name, parameters)


def check_output(path: str, suffixes: Sequence[str]) -> None:
    """Raise for a path that cannot become a file: found out before hours of rendering, not after.

    CommandError for an unknown suffix; OSError naming the path for a folder that is missing or not
    writable, and for a path that is a folder or a device.
    """
    if Path(path).suffix.lower() not in suffixes:
        raise CommandError(f"{path}: unknown suffix; expected {' or '.join(suffixes)}")
    target = Path(os.path.realpath(path))
    if target.is_dir():
        raise OSError(errno.EISDIR, os.strerror(errno.EISDIR), path)
    if target.exists() and not target.is_file():
        raise OSError(errno.EINVAL, "not a regular file", path)
    if not target.parent.is_dir():
        code = errno.ENOTDIR if target.parent.exists() else errno.ENOENT
        raise OSError(code, f"folder {target.parent}: {os.strerror(code)}", path)
    probe = target.with_name(f".veriray-{secrets.token_hex(8)}.tmp")
    try:
        os.close(os.open(probe, os.O_WRONLY | os.O_CREAT | os.O_EXCL, 0o666))
        os.unlink(probe)
    except OSError as error:
        raise OSError(error.errno, f"folder not writable: {error.strerror}", path) from error


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
def _progress(title: str, quiet: bool) -> Iterator[Callable[[float], None] | None]:
    """A progress callback: a bar on a terminal, one plain line elsewhere, None when quiet."""
    if quiet:
        yield None
        return
    if not sys.stderr.isatty():
        print(title, file=sys.stderr, flush=True)
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


def _render(arguments: argparse.Namespace) -> int:
    if arguments.pixel is not None:
        return _replay(arguments)
    if arguments.sample is not None:
        raise CommandError("--sample goes with --pixel X Y")
    if not arguments.output:
        raise CommandError("no output: add -o FILE.exr or -o FILE.png")
    targets = [*arguments.output, *([arguments.stats] if arguments.stats else [])]
    if len({os.path.realpath(path) for path in targets}) < len(targets):
        raise CommandError(f"the same output twice: {', '.join(targets)}")
    for path in arguments.output:
        check_output(path, PICTURE_SUFFIXES)
    if arguments.stats:
        check_output(arguments.stats, (".json",))

    from . import device as device_module
    from .info import primitives_text, tree_text
    from .render import check_settings, choose_scheduler, prepare, render

    scene = _load(arguments)
    settings: dict[str, Any] = {
        name: getattr(arguments, name)
        for name in ("spp seed max_depth rr_depth width height threads batches batch_size").split()
    }
    used, spp = check_settings(scene, **settings)
    chosen, reason = device_module.select(arguments.device)
    scheduler, scheduler_reason = choose_scheduler(arguments.scheduler)
    if not arguments.quiet:
        print(f"device     {chosen.name}, {chosen.description} ({reason})")
        print(f"scheduler  {scheduler} ({scheduler_reason})", flush=True)
    size = {"width": arguments.width, "height": arguments.height}
    if len(scene.triangles) >= LARGE_MESH:
        title = f"building the tree over {len(scene.triangles):,} triangles"
        with _progress(title, arguments.quiet) as progress:
            facts = prepare(scene, arguments.device, **size, progress=progress)
    else:
        facts = prepare(scene, arguments.device, **size)
    if not arguments.quiet:
        if facts["tree"]:
            print(f"tree       {tree_text(facts['tree'])}")
        print(f"primitives {primitives_text(facts['primitives'])}", flush=True)
    title = f"rendering {used.film.width} x {used.film.height}, {spp} spp"
    with _progress(title, arguments.quiet) as progress:
        result = render(
            scene,
            device=arguments.device,
            scheduler=arguments.scheduler,
            progress=progress,
            all_features=arguments.all_features,
            **settings,
        )
    for path in arguments.output:
        result.save(path)
    if arguments.stats:
        write_json(arguments.stats, {**result.stats, "film_sha256": result.film_sha256})
    if not arguments.quiet:
        _print_result(result, arguments.output)
    elif result.stats["nonfinite_samples"]:
        _show_warning(_nonfinite_text(result.stats))
    return 0


def _print_result(result: Any, outputs: list[str]) -> None:
    from . import livebench

    stats = result.stats
    print(
        f"samples    {stats['paths']:,} paths, {stats['rays']:,} rays in {stats['seconds']:.3f} s: "
        f"{stats['samples_per_second']:,.0f} samples/s"
    )
    print(livebench.as_text(livebench.rows(result), TABLE_ROWS))
    error = stats["mean_stderr"]
    print(f"mean standard error  {'needs 2 spp' if error is None else f'{error:.6g}'}")
    if stats["nonfinite_samples"]:
        print(_nonfinite_text(stats))
    print(f"SHA-256    {result.film_sha256}")
    print(f"written    {', '.join(outputs)}")


def _nonfinite_text(stats: dict[str, Any]) -> str:
    text = f"{stats['nonfinite_samples']} samples were not finite or negative, and count as black"
    if stats["nonfinite"]:
        x, y, sample = stats["nonfinite"][0][:3]
        text += f"; the first: --pixel {x} {y} --sample {sample} --seed {stats['seed']}"
    return text


def _replay(arguments: argparse.Namespace) -> int:
    from .render import trace_path

    if arguments.output or arguments.stats:
        raise CommandError("--pixel prints a path and writes no file: leave out -o and --stats")
    scene = _load(arguments)
    sample = 0 if arguments.sample is None else arguments.sample
    x, y = arguments.pixel
    path = trace_path(
        scene,
        x,
        y,
        sample,
        seed=arguments.seed,
        max_depth=arguments.max_depth,
        rr_depth=arguments.rr_depth,
        width=arguments.width,
        height=arguments.height,
    )
    print(f"pixel ({x}, {y}), sample {sample}, seed {arguments.seed}: {len(path)} vertices")
    for vertex in path:
        print(f"\nvertex {vertex['depth']}: {vertex['event']}")
        for key, value in vertex.items():
            if key not in ("depth", "event"):
                print(f"  {key:<12} {_value_text(value)}")
    return 0


def _value_text(value: Any) -> str:
    if hasattr(value, "tolist"):
        value = value.tolist()
    if isinstance(value, (list, tuple)):
        return "  ".join(_value_text(entry) for entry in value)
    if isinstance(value, dict):
        return ", ".join(f"{key} {_value_text(entry)}" for key, entry in value.items())
    return f"{value:.9g}" if isinstance(value, float) else str(value)


def _compare(arguments: argparse.Namespace) -> int:
    from . import compare

    if arguments.output:
        check_output(arguments.output, (".html",))
    report = compare(arguments.a, arguments.b)
    if arguments.output:
        report.save(arguments.output)
    print(report.to_json() if arguments.json else str(report))
    return {"pass": 0, "fail": 1}.get(report.result, 3)


def _info(arguments: argparse.Namespace) -> int:
    from . import info

    scene = _load(arguments)
    quiet = arguments.json or len(scene.triangles) < LARGE_MESH
    with _progress("building the tree", quiet) as progress:
        report = info.examine(scene, arguments.device, arguments.width, arguments.height, progress)
    print(json.dumps(report, indent=2) if arguments.json else info.as_text(report))
    return 0


def _gallery(arguments: argparse.Namespace) -> int:
    from . import gallery

    if arguments.list:
        print("\n".join(gallery.names()))
        return 0
    quiet = arguments.quiet
    gallery.run(
        arguments.names,
        arguments.output,
        sheet_only=arguments.sheet,
        show=lambda title: _progress(title, quiet),
        say=None if quiet else lambda line: print(line, flush=True),
        **{
            name: getattr(arguments, name)
            for name in "mesh spp seed width scale device threads force docs".split()
        },
    )
    return 0


def _bench_live_rays(arguments: argparse.Namespace) -> int:
    from . import livebench

    if arguments.json:
        check_output(arguments.json, (".json",))
    scene = _load(arguments)
    title = f"live rays at {arguments.width} x {arguments.height}, {arguments.spp} spp"
    with _progress(title, False) as progress:
        result = livebench.run(
            scene,
            width=arguments.width,
            height=arguments.height,
            spp=arguments.spp,
            device=arguments.device,
            scheduler=arguments.scheduler,
            progress=progress,
        )
    if arguments.json:
        write_json(arguments.json, result)
    print(
        f"{arguments.scene}, {result['width']} x {result['height']}, {result['spp']} spp, ", end=""
    )
    print(f"max_depth {result['max_depth']}, rr_depth {result['rr_depth']}")
    print(f"device {result['device']} ({result['device_reason']})")
    print(f"{result['device']} ({result['device_name']}), scheduler {result['scheduler']}")
    print(livebench.as_text(result["rows"]))
    print(f"{result['samples_per_second']:,.0f} samples/s; SHA-256 {result['film_sha256']}")
    if result["law_holds"] is not None:
        verdict = "holds" if result["law_holds"] else "DOES NOT HOLD"
        print(f"blocks[d+1] = ceil(live[d] / {livebench.BLOCK_SIZE}) {verdict} at every depth")
    return 0


def _doctor(arguments: argparse.Namespace) -> int:
    from . import doctor

    report = doctor.examine(self_test=not arguments.no_self_test)
    print(json.dumps(report, indent=2) if arguments.json else doctor.as_text(report))
    test = report["self_test"]
    return 0 if report["auto"]["device"] and (test is None or test["passed"]) else 1
