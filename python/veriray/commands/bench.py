"""`veriray bench live-rays`."""

from __future__ import annotations

import argparse
from typing import Any

from .common import Parser, add_scene, check_output, integer, load, show_progress, write_json


def add(commands: Any) -> None:
    """Adds `bench live-rays` to the parser."""
    bench = commands.add_parser("bench", help="measurements")
    kinds = bench.add_subparsers(metavar="KIND", required=True, parser_class=Parser)
    parser = kinds.add_parser("live-rays", help="live rays, thread blocks and time at each depth")
    add_scene(parser)
    parser.set_defaults(handler=_bench_live_rays, width=1280, height=720)
    parser.add_argument("--spp", type=integer, default=1, help="samples per pixel (default: 1)")
    parser.add_argument("--scheduler", default="thrust", help="thrust (default), fused or auto")
    parser.add_argument("--json", metavar="FILE", help="write table and settings as JSON")


def _bench_live_rays(arguments: argparse.Namespace) -> int:
    from .. import livebench

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
