"""`veriray render`."""

from __future__ import annotations

import argparse
import contextlib
import sys
import time
from collections.abc import Callable
from typing import TYPE_CHECKING, Any

from .. import interrupts
from ..settings import MAX_SPP, SETTINGS, RenderSettings
from .common import (
    LARGE_MESH,
    SCENE_SETTINGS,
    CommandError,
    add_outputs,
    add_scene,
    add_settings,
    check_distinct,
    check_output,
    integer,
    load,
    number,
    say,
    set_second_camera,
    show_progress,
    stops,
    write_json,
)

if TYPE_CHECKING:
    from ..course import Course
    from ..picture import Render

PICTURE_SUFFIXES = (".exr", ".png")
TABLE_ROWS = 12
#: Of checkpoints.
SUFFIX = ".film"


def add(commands: Any) -> None:
    """Adds `render` to the parser."""
    parser = commands.add_parser("render", help="render a scene")
    add_scene(parser, several=True)
    add_outputs(parser, "FILE.exr (everything) or FILE.png (display copy)")
    add_settings(parser, *(name for name in SETTINGS if name not in SCENE_SETTINGS))
    parser.add_argument("--exposure", type=stops, default=0.0, help="stops, for PNG (0)")
    parser.add_argument("--stats", metavar="FILE.json", help="write the statistics as JSON")
    parser.add_argument(
        "--checkpoint",
        metavar="FILE.film",
        help="go on from this file if it exists, and keep the exact sums there (resumable)",
    )
    parser.add_argument(
        "--every", type=number, metavar="S", help="seconds between checkpoints (60)"
    )
    parser.add_argument(
        "--time", type=number, metavar="S", help="seconds of sampling after which it ends"
    )
    parser.add_argument(
        "--preview", type=number, metavar="S", help="write the picture so far every S seconds"
    )
    parser.add_argument(
        "--discard", action="store_true", help="write no picture of what is there at Ctrl-C"
    )
    parser.add_argument(
        "--samples",
        metavar="A:B",
        help="draw samples A to B - 1 of each pixel into --checkpoint, for `veriray merge`",
    )
    parser.add_argument("--quiet", action="store_true", help="print errors only")
    parser.add_argument(
        "--pixel",
        nargs=2,
        type=integer,
        metavar=("X", "Y"),
        help="do not render: print one path of this pixel vertex by vertex",
    )
    parser.add_argument("--sample", type=integer, default=None, metavar="N", help="with --pixel")
    parser.set_defaults(handler=_render)


def _render(arguments: argparse.Namespace) -> int:
    if arguments.pixel is not None:
        return _replay(arguments)
    if arguments.sample is not None:
        raise CommandError("--sample goes with --pixel X Y")
    if arguments.preview is not None and not arguments.preview > 0:
        raise CommandError(f"--preview {arguments.preview:g}: expected seconds above 0")
    if arguments.samples is not None:
        return _draw_range(arguments)
    if not arguments.output:
        raise CommandError("no output: add -o FILE.exr or -o FILE.png")
    if arguments.every is not None and not arguments.checkpoint:
        raise CommandError("--every goes with --checkpoint FILE")
    others = [path for path in (arguments.stats, arguments.checkpoint) if path]
    check_distinct([*arguments.output, *others])
    for path in arguments.output:
        check_output(path, PICTURE_SUFFIXES)
    if arguments.stats:
        check_output(arguments.stats, (".json",))
    if arguments.checkpoint:
        check_output(arguments.checkpoint, (SUFFIX,))

    has_exr = any(path.lower().endswith(".exr") for path in arguments.output)
    for name in ("features", "light_groups", "batches"):
        if getattr(arguments, name) and not has_exr:
            option = f"--{name.replace('_', '-')}"
            raise CommandError(f"{option} needs an output FILE.exr: a PNG has the picture alone")

    from .. import device as device_module
    from ..info import primitives_text, tree_text
    from ..rendering import choose_scheduler, prepare, render_with, settle

    scene = load(arguments, arguments.output)
    set_second_camera(arguments, scene)
    if has_exr and not arguments.features:
        arguments.features = scene.features
    settings = RenderSettings(**{name: getattr(arguments, name) for name in SETTINGS})
    used, settled = settle(scene, settings)
    chosen = [] if settings.cluster else device_module.select_all(arguments.device)
    if settings.cluster and not arguments.quiet:
        say(f"cluster    {settings.cluster}")
    elif not arguments.quiet:
        for one, reason in chosen:
            say(f"device     {one.name}, {one.description} ({reason})")
    asked = {name: getattr(settled, name) for name in ("width", "height", "spp", "builder")}
    if settings.cluster:
        facts = None
    elif len(scene.triangles) >= LARGE_MESH:
        title = f"building the tree over {len(scene.triangles):,} triangles"
        with show_progress(title, arguments.quiet) as progress:
            facts = prepare(scene, arguments.device, **asked, progress=progress)
    else:
        facts = prepare(scene, arguments.device, **asked)
    if facts is not None and not arguments.quiet:
        if facts["tree"]:
            say(f"tree       {tree_text(facts['tree'])}")
        say(f"primitives {primitives_text(facts['primitives'])}")
        for backend in dict.fromkeys(one.backend for one, _ in chosen):
            scheduler, why = choose_scheduler(settled, backend, facts)
            say(f"scheduler  {scheduler} ({why})")
    course = _course(arguments, keeps=not arguments.discard)
    course.on_stop = _stop_shown(arguments)
    title = f"rendering {used.film.width} x {used.film.height}, {used.spp} spp"
    with show_progress(title, arguments.quiet) as progress:
        result = render_with(scene, settings, progress, course)
    _save(result, arguments)
    if arguments.stats:
        write_json(arguments.stats, {**result.stats, "film_sha256": result.film_sha256})
    if not arguments.quiet:
        _print_result(result, arguments.output)
    stopped = result.stats.get("stopped")
    if stopped:
        why = "--time is over" if stopped == "time" else stopped
        text = f"the picture has {result.spp} of {result.stats['spp_asked']} samples per pixel"
        if (settled.features or settled.light_groups) and not result.features:
            text += ", and no feature images"
        say(f"veriray: {why}: {text}", file=sys.stderr)
    if course.failed is not None:
        raise course.failed
    return interrupts.status() if stopped == "interrupted" else 0


def _course(arguments: argparse.Namespace, keeps: bool) -> Course:
    from ..course import EVERY, Course

    return Course(
        checkpoint=arguments.checkpoint,
        every=EVERY if arguments.every is None else arguments.every,
        seconds=arguments.time,
        on_pass=None if arguments.preview is None else _previews(arguments),
        keeps=keeps,
    )


def _previews(arguments: argparse.Namespace) -> Callable[[Render], None]:
    """Called after each pass: writes the outputs, --preview seconds after the last time at least.

    What cannot be written is said, and the render goes on.
    """
    from ..image import save

    written = time.monotonic()

    def of_pass(picture: Render) -> None:
        nonlocal written
        if time.monotonic() - written < arguments.preview:
            return
        for path in arguments.output:
            try:
                save(picture, path, exposure=arguments.exposure)
            except OSError as error:
                say(f"veriray: no preview: {error}", file=sys.stderr)
        written = time.monotonic()

    return of_pass


def _save(picture: Render, arguments: argparse.Namespace) -> None:
    """Writes all outputs."""
    from ..image import save

    for path in arguments.output:
        save(picture, path, exposure=arguments.exposure)


def _stop_shown(arguments: argparse.Namespace) -> Callable[[Render], None]:
    """Called after Ctrl-C: writes the outputs before feature images, which may take long."""

    def of_stop(picture: Render) -> None:
        _save(picture, arguments)
        text = "the picture is written; its feature images are drawn (once more leaves them out)"
        say(f"veriray: interrupted: {text}", file=sys.stderr)

    return of_stop


def _draw_range(arguments: argparse.Namespace) -> int:
    first, sign, end = arguments.samples.partition(":")
    if not (sign and first.isdecimal() and end.isdecimal() and int(first) < int(end) <= MAX_SPP):
        raise CommandError(f"--samples {arguments.samples}: expected A:B with 0 <= A < B <= 2^40")
    pictures = (
        arguments.output, arguments.stats, arguments.features, arguments.light_groups,
        arguments.preview, arguments.motion_to,
    )  # fmt: skip
    if not arguments.checkpoint or any(pictures):
        raise CommandError(
            "--samples draws into --checkpoint FILE alone: "
            "without -o, --stats, --features, --light-groups, --motion-to and --preview"
        )
    if arguments.spp is not None or arguments.batches or arguments.target_error is not None:
        raise CommandError("--samples: not together with --spp, --batches or --target-error")
    check_output(arguments.checkpoint, (SUFFIX,))

    from ..accumulation import Accumulation
    from ..rendering import of_all

    scene = load(arguments)
    settings = {name: getattr(arguments, name) for name in SETTINGS}
    settings["spp"] = int(end) - int(first)
    course = _course(arguments, keeps=True)
    work = Accumulation(scene, first=int(first), **settings)
    title = f"drawing samples {first}:{end}"
    with contextlib.closing(work), show_progress(title, arguments.quiet) as progress:
        course.resume(work)
        stopped = course.run(work, lambda n: of_all(work, n, progress))
    if course.failed is not None:
        raise course.failed
    if stopped or not arguments.quiet:
        say(
            f"samples    {first}:{int(first) + work.spp} of {first}:{end} in {arguments.checkpoint}"
        )
    return interrupts.status() if stopped == "interrupted" else 0


def _print_result(result: Any, outputs: list[str]) -> None:
    from .. import depths

    stats = result.stats
    say(
        f"samples    {stats['paths']:,} paths, {stats['rays']:,} rays in {stats['seconds']:.3f} s: "
        f"{stats['samples_per_second']:,.0f} samples/s"
    )
    for one in stats.get("devices", ()):
        who = f"{one['node']}: {one['device']}" if "node" in one else one["device"]
        share = one["paths"] / max(1, sum(other["paths"] for other in stats["devices"]))
        say(f"of these   {share:.1%} by {who}, busy for {one['seconds']:.3f} s")
    say(depths.as_text(depths.rows(result), TABLE_ROWS))
    if "target_error" in stats:
        good = stats["tiles"] - stats["tiles_above_target"]
        say(
            f"target     {stats['target_error']:g} reached by {good} of {stats['tiles']} tiles, "
            f"{stats['tiles_at_limit']} need more than {stats['spp']} spp; "
            f"mean {stats['mean_spp']:.1f} spp"
        )
    error = stats["mean_stderr"]
    say(f"mean standard error  {'needs 2 spp' if error is None else f'{error:.6g}'}")
    if result.features:
        say(f"features   {', '.join(result.features)} ({result.features.spp} spp)")
    say(f"SHA-256    {result.film_sha256}")
    say(f"written    {', '.join(outputs)}")


def _replay(arguments: argparse.Namespace) -> int:
    from ..rendering import trace_path

    if arguments.output or arguments.stats:
        raise CommandError("--pixel prints a path and writes no file: leave out -o and --stats")
    scene = load(arguments)
    sample = 0 if arguments.sample is None else arguments.sample
    x, y = arguments.pixel
    settings = {name: getattr(arguments, name) for name, s in SETTINGS.items() if s.path}
    path = trace_path(scene, x, y, sample, **settings)
    say(f"pixel ({x}, {y}), sample {sample}, seed {arguments.seed}: {len(path)} vertices")
    for vertex in path:
        say(f"\nvertex {vertex['depth']}: {vertex['event']}")
        for key, value in vertex.items():
            if key not in ("depth", "event"):
                say(f"  {key:<12} {_value_text(value)}")
    return 0


def _value_text(value: Any) -> str:
    if hasattr(value, "tolist"):
        value = value.tolist()
    if isinstance(value, (list, tuple)):
        return "  ".join(_value_text(entry) for entry in value)
    if isinstance(value, dict):
        return ", ".join(f"{key} {_value_text(entry)}" for key, entry in value.items())
    return f"{value:.9g}" if isinstance(value, float) else str(value)
