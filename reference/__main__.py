"""Command line: ``python -m reference render SCENE -o OUT.exr --spp N``."""

from __future__ import annotations

import argparse
import json
import sys
import time
from pathlib import Path

from reference.output import summary, write_exr
from reference.plugins import load
from reference.render import render
from reference.scene import SceneError, with_settings


def main(arguments: list[str] | None = None) -> int:
    """Run the command; 0 = written, 2 = an error, told on one line of stderr."""
    parser = argparse.ArgumentParser(
        prog="python -m reference", description="The independent reference renderer (Embree)."
    )
    command = parser.add_subparsers(required=True).add_parser(
        "render", help="render a scene file to EXR"
    )
    command.add_argument("scene", type=Path, help="Mitsuba 3 XML file")
    command.add_argument("-o", "--output", type=Path, required=True, metavar="OUT.exr")
    command.add_argument("--spp", type=int, help="samples a pixel, a multiple of the batches")
    command.add_argument("--seed", type=int, default=0)
    command.add_argument("--width", type=int)
    command.add_argument("--height", type=int)
    command.add_argument("--max-depth", type=int, help="-1 unlimited, 1 emission, 2 direct light")
    command.add_argument("--rr-depth", type=int)
    command.add_argument("--batches", type=int, default=64, help="batch means kept (default 64)")
    command.add_argument("--processes", type=int, default=1)
    command.add_argument("--json", type=Path, metavar="STATS.json", help="write the statistics")
    command.add_argument(
        "-D",
        action="append",
        default=[],
        metavar="NAME=VALUE",
        dest="define",
        help="set a $parameter of the scene file",
    )
    options = parser.parse_args(arguments)
    try:
        if not all("=" in item for item in options.define):
            raise SceneError(f"-D {' '.join(options.define)}: expected NAME=VALUE")
        scene = load(options.scene, dict(item.split("=", 1) for item in options.define))
        scene = with_settings(
            scene,
            width=options.width,
            height=options.height,
            max_depth=options.max_depth,
            rr_depth=options.rr_depth,
        )
        if not options.output.absolute().parent.is_dir():
            raise OSError(f"{options.output}: no such folder")
        start = time.perf_counter()

        def progress(done: int, batches: int) -> None:
            seconds = time.perf_counter() - start
            print(
                f"\rbatch {done}/{batches}  {seconds:.0f} s, "
                f"{seconds / done * (batches - done):.0f} s left ",
                end="",
                file=sys.stderr,
            )

        picture = render(
            scene,
            spp=options.spp or scene.spp,
            seed=options.seed,
            batches=options.batches,
            processes=options.processes,
            progress=progress,
        )
        print(file=sys.stderr)
        write_exr(picture, options.output)
        if options.json:
            options.json.write_text(json.dumps(summary(picture), indent=1) + "\n")
    except (ValueError, OSError) as error:
        print(f"\nerror: {error}", file=sys.stderr)
        return 2
    except KeyboardInterrupt:
        print("\nstopped; nothing written", file=sys.stderr)
        return 130
    invalid = int(picture.ledger[:, 6].sum())
    print(
        f"{options.output}: {picture.seconds:.1f} s, mean "
        f"{picture.mean.mean():.6g}, mean standard error {picture.stderr.mean():.3g}"
        + (f", {invalid} INVALID SAMPLES" if invalid else "")
    )
    return 0


if __name__ == "__main__":
    sys.exit(main())
