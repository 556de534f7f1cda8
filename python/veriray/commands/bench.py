"""`veriray bench`: all, matrix, report, compaction, live-rays."""

from __future__ import annotations

import argparse
import math
from typing import Any

from .common import (
    DEVICES,
    CommandError,
    Parser,
    add_outputs,
    add_scene,
    beside,
    check_distinct,
    check_output,
    integer,
    load,
    number,
    say,
    show_progress,
    write_json,
)

RESULTS = "veriray-bench"
REPORT_SUFFIXES = (".html", ".md")


def add(commands: Any) -> None:
    """Adds `bench` and its kinds to the parser."""
    bench = commands.add_parser("bench", help="measurements")
    kinds = bench.add_subparsers(metavar="KIND", required=True, parser_class=Parser)
    _add_all(kinds)
    _add_matrix(kinds)
    _add_report(kinds)
    _add_compaction(kinds)
    _add_live_rays(kinds)


# ---- all ----


def _add_all(kinds: Any) -> None:
    parser = kinds.add_parser(
        "all", help="speed, error, scaling, start, memory; beside other renderers"
    )
    parser.add_argument(
        "--only", metavar="NAME", nargs="+", action="extend", default=[], help="these scenarios"
    )
    _add_runs(parser)
    parser.add_argument("--quick", action="store_true", help="a smoke test of about two minutes")
    parser.set_defaults(handler=_bench_all)


def _add_runs(parser: argparse.ArgumentParser) -> None:
    """Adds what `all` and `matrix` share."""
    parser.add_argument("--device", default="auto", help=f"{DEVICES} (default: auto)")
    parser.add_argument(
        "--peers",
        metavar="LIST",
        default="mitsuba",
        help="renderers to race, with commas between, or none: mitsuba (default), cycles",
    )
    parser.add_argument("--again", action="store_true", help="measure again what DIR holds")
    parser.add_argument(
        "--wait", type=number, default=0.0, metavar="S", help="wait up to S s for an idle machine"
    )
    parser.add_argument(
        "-o", "--output", metavar="DIR", default=RESULTS, help=f"results (default: {RESULTS})"
    )


def _bench_all(arguments: argparse.Namespace) -> int:
    return _run(arguments, only=arguments.only)


def _run(arguments: argparse.Namespace, **what: Any) -> int:
    """Runs what `all` and `matrix` name; 1 if something is void or failed."""
    if not 0 <= arguments.wait <= 86400:
        raise CommandError(f"wait = {arguments.wait:g} is outside [0, 86400]")

    from .. import device as device_module
    from ..depths import aligned

    with beside("veriray_bench"):
        from veriray_bench import report, run
        from veriray_bench.peers import parse

    backend = device_module.select(arguments.device)[0].backend
    bad = []

    def done(scenario: Any, row: dict[str, Any], kept: bool) -> None:
        say(report.line(scenario, row, backend) + (" (kept)" if kept else ""))
        if any(report.void_rows(row)):
            bad.append(scenario.name)

    path = run(
        arguments.output,
        arguments.device,
        **what,
        peers=parse(arguments.peers),
        quick=arguments.quick,
        again=arguments.again,
        wait=arguments.wait,
        show=lambda title: show_progress(title, False),
        done=done,
    )
    for section in report.matrix_sections([report.read(path)]):
        say(f"\n{section.title}\n")
        for table in section.tables:
            say(aligned([[c.strip() for c in table.columns], *table.rows]) + "\n")
    say(f"written    {path}")
    return 1 if bad else 0


# ---- matrix ----


def _add_matrix(kinds: Any) -> None:
    parser = kinds.add_parser(
        "matrix", help="classes of small scenes made by rule: wall, variance, efficiency"
    )
    parser.add_argument(
        "--classes", metavar="NAME", nargs="+", action="extend", default=[], help="of scenes"
    )
    parser.add_argument("--seeds", type=integer, default=3, help="scenes a class (default: 3)")
    _add_runs(parser)
    parser.add_argument("--quick", action="store_true", help="tiny pictures; no figures to quote")
    parser.add_argument(
        "--limit", type=number, metavar="S", default=math.inf, help="begin no scene after S s"
    )
    parser.set_defaults(handler=_bench_matrix)


def _bench_matrix(arguments: argparse.Namespace) -> int:
    if not arguments.limit > 0:
        raise CommandError(f"limit = {arguments.limit:g} is not positive")

    with beside("veriray_bench"):
        from veriray_bench import matrix

    scenes = matrix.choose(arguments.classes, arguments.seeds)
    return _run(arguments, scenes=scenes, limit=arguments.limit)


# ---- report ----


def _add_report(kinds: Any) -> None:
    parser = kinds.add_parser("report", help="a page of results of `bench all` and `matrix`")
    parser.add_argument("results", metavar="PATH", nargs="+", help="folders or files of these")
    add_outputs(parser, "FILE.html or FILE.md")
    parser.set_defaults(handler=_bench_report)


def _bench_report(arguments: argparse.Namespace) -> int:
    for path in arguments.output:
        check_output(path, REPORT_SUFFIXES)
    check_distinct(arguments.output)

    with beside("veriray_bench"):
        from veriray_bench import report

    results = report.find(arguments.results)
    for path in arguments.output:
        report.save(results, path)
    for t in report.targets(results):
        say(f"{t['state']:13} {t['device']}, {t['scenario'].name}: {t['target'].what}")
    say(report.verdict(results)[1])
    if arguments.output:
        say(f"written    {', '.join(arguments.output)}")
    return 0


# ---- compaction ----


def _add_compaction(kinds: Any) -> None:
    parser = kinds.add_parser("compaction", help="ways to close the gaps that ended paths leave")
    add_scene(parser)
    parser.set_defaults(handler=_bench_compaction, width=1280, height=720)
    parser.add_argument("--spp", type=integer, default=16, help="samples per pixel (default: 16)")
    parser.add_argument("--rounds", type=integer, default=5, help="of which medians (default: 5)")
    parser.add_argument("--json", metavar="FILE", help="write tables and settings as JSON")


def _bench_compaction(arguments: argparse.Namespace) -> int:
    from ..depths import aligned

    with beside("veriray_bench"):
        from veriray_bench import compaction

    if arguments.json:
        check_output(arguments.json, (".json",))
    if arguments.rounds < 1:
        raise CommandError(f"--rounds {arguments.rounds}; expected at least 1")
    scene = load(arguments)
    names = ("width", "height", "spp", "device", "rounds")
    settings = {name: getattr(arguments, name) for name in names}
    with show_progress("compaction", False) as progress:
        result = compaction.study(scene, progress=progress, **settings)
    result = {"scene": arguments.scene, **result}
    if arguments.json:
        write_json(arguments.json, result)
    size = f"{result['width']} x {result['height']}, {result['spp']} spp"
    say(f"{arguments.scene}, {size}, {result['device']} ({result['device_name']})")
    for table in (compaction.by_depth(result), compaction.summary(result)):
        say(aligned(table) + "\n")
    say(f"winner     {result['winner']}")
    films = "one SHA-256 for all" if result["same_film"] else "DIFFERENT FILMS"
    say(f"films      {films}")
    return 0 if result["same_film"] else 1


# ---- live-rays ----


def _add_live_rays(kinds: Any) -> None:
    parser = kinds.add_parser("live-rays", help="live rays, thread blocks and time at each depth")
    add_scene(parser)
    parser.set_defaults(handler=_bench_live_rays, width=1280, height=720)
    parser.add_argument("--spp", type=integer, default=1, help="samples per pixel (default: 1)")
    parser.add_argument("--scheduler", default="thrust", help="thrust (default) or any other")
    parser.add_argument("--json", metavar="FILE", help="write table and settings as JSON")


def _bench_live_rays(arguments: argparse.Namespace) -> int:
    from ..depths import BLOCK_SIZE, as_text

    with beside("veriray_bench"):
        from veriray_bench import livebench

    if arguments.json:
        check_output(arguments.json, (".json",))
    scene = load(arguments)
    title = f"live rays at {arguments.width} x {arguments.height}, {arguments.spp} spp"
    with show_progress(title, False) as progress:
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
    say(
        f"{arguments.scene}, {result['width']} x {result['height']}, {result['spp']} spp, "
        f"max_depth {result['max_depth']}, rr_depth {result['rr_depth']}"
    )
    say(f"device {result['device']} ({result['device_reason']})")
    say(f"{result['device']} ({result['device_name']}), scheduler {result['scheduler']}")
    say(as_text(result["rows"]))
    say(f"{result['samples_per_second']:,.0f} samples/s; SHA-256 {result['film_sha256']}")
    if result["law_holds"] is not None:
        verdict = "holds" if result["law_holds"] else "DOES NOT HOLD"
        say(f"blocks[d+1] = ceil(live[d] / {BLOCK_SIZE}) {verdict} at every depth")
    return 0
