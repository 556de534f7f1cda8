"""`veriray render`."""

from __future__ import annotations

import argparse
from typing import Any

from .common import (
    LARGE_MESH,
    CommandError,
    add_outputs,
    add_scene,
    check_distinct,
    check_output,
    integer,
    load,
    number,
    say,
    show_progress,
    write_json,
)

PICTURE_SUFFIXES = (".exr", ".png")
TABLE_ROWS = 12


def add(commands: Any) -> None:
    """Adds `render` to the parser."""
    parser = commands.add_parser("render", help="render a scene")
    add_scene(parser)
    add_outputs(parser, "FILE.exr (everything) or FILE.png (display copy)")
    parser.add_argument("--spp", type=integer, help="samples per pixel (default: the scene's)")
    parser.add_argument("--seed", type=integer, default=0, help="0 to 2^64-1 (default: 0)")
    parser.add_argument("--scheduler", default="auto", help="auto, fused, thrust or wavefront")
    parser.add_argument("--builder", default="auto", help="of the tree: auto, sah or ploc")
    parser.add_argument("--max-depth", type=integer, help="longest path; 1 emission, -1 unlimited")
    parser.add_argument("--rr-depth", type=integer, help="first depth of Russian roulette")
    parser.add_argument("--sampler", help="independent or sobol (default: the scene's)")
    parser.add_argument("--threads", type=integer, help="CPU threads (default: all)")
    parser.add_argument("--batches", type=integer, default=0, help="batch means to keep, 0 or 2+")
    parser.add_argument("--batch-size", type=integer, default=0, help="paths in flight; 0: auto")
    parser.add_argument("--all-features", action="store_true", help="run the all-features variant")
    parser.add_argument(
        "--target-error",
        type=number,
        metavar="E",
        help="stop tiles at this relative standard error; --spp is then the most",
    )
    parser.add_argument("--stats", metavar="FILE.json", help="write the statistics as JSON")
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
    if not arguments.output:
        raise CommandError("no output: add -o FILE.exr or -o FILE.png")
    targets = [*arguments.output, *([arguments.stats] if arguments.stats else [])]
    check_distinct(targets)
    for path in arguments.output:
        check_output(path, PICTURE_SUFFIXES)
    if arguments.stats:
        check_output(arguments.stats, (".json",))

    from .. import device as device_module
    from ..image import save
    from ..info import primitives_text, tree_text
    from ..rendering import check_settings, choose_scheduler, prepare, render

    scene = load(arguments)
    settings: dict[str, Any] = {
        name: getattr(arguments, name)
        for name in (
            "spp seed max_depth rr_depth sampler width height threads batches batch_size "
            "target_error"
        ).split()
    }
    used, spp = check_settings(scene, **settings)
    chosen, reason = device_module.select(arguments.device)
    scheduler, scheduler_reason = choose_scheduler(arguments.scheduler)
    if not arguments.quiet:
        say(f"device     {chosen.name}, {chosen.description} ({reason})")
        say(f"scheduler  {scheduler} ({scheduler_reason})")
    asked = {"width": arguments.width, "height": arguments.height, "spp": spp,
             "builder": arguments.builder}  # fmt: skip
    if len(scene.triangles) >= LARGE_MESH:
        title = f"building the tree over {len(scene.triangles):,} triangles"
        with show_progress(title, arguments.quiet) as progress:
            facts = prepare(scene, arguments.device, **asked, progress=progress)
    else:
        facts = prepare(scene, arguments.device, **asked)
    if not arguments.quiet:
        if facts["tree"]:
            say(f"tree       {tree_text(facts['tree'])}")
        say(f"primitives {primitives_text(facts['primitives'])}")
    title = f"rendering {used.film.width} x {used.film.height}, {spp} spp"
    with show_progress(title, arguments.quiet) as progress:
        result = render(
            scene,
            device=arguments.device,
            scheduler=arguments.scheduler,
            builder=arguments.builder,
            progress=progress,
            all_features=arguments.all_features,
            **settings,
        )
    for path in arguments.output:
        save(result, path)
    if arguments.stats:
        write_json(arguments.stats, {**result.stats, "film_sha256": result.film_sha256})
    if not arguments.quiet:
        _print_result(result, arguments.output)
    return 0


def _print_result(result: Any, outputs: list[str]) -> None:
    from .. import depths

    stats = result.stats
    say(
        f"samples    {stats['paths']:,} paths, {stats['rays']:,} rays in {stats['seconds']:.3f} s: "
        f"{stats['samples_per_second']:,.0f} samples/s"
    )
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
    say(f"SHA-256    {result.film_sha256}")
    say(f"written    {', '.join(outputs)}")


def _replay(arguments: argparse.Namespace) -> int:
    from ..rendering import trace_path

    if arguments.output or arguments.stats:
        raise CommandError("--pixel prints a path and writes no file: leave out -o and --stats")
    scene = load(arguments)
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
        sampler=arguments.sampler,
        width=arguments.width,
        height=arguments.height,
    )
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
