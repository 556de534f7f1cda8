"""Live rays and thread blocks per depth, as in Table 1 of the 2016 report, at 1280 x 720.

Row d: rays alive after bounce d (row 0: the camera rays), blocks of 256 threads launched for that
bounce, share of all paths, milliseconds of the bounce with its compaction. A bounce is launched for
what the one before left alive, so blocks[d + 1] = ceil(live[d] / 256): checked here for every row.
"""

from __future__ import annotations

import sys

from common import header, parser, write

import veriray
from veriray import livebench


def main() -> int:
    """Command line."""
    p = parser(__doc__, "live_rays.json")
    p.add_argument("scenes", nargs="*", default=["cornell-box", "open"])
    p.add_argument("--width", type=int, default=1280)
    p.add_argument("--height", type=int, default=720)
    p.add_argument("--device", default="auto")
    p.add_argument("--repeat", type=int, default=5, help="runs; each row shows its fastest")
    args = p.parse_args()
    result = header("live_rays")
    result["tables"] = {}
    holds = True
    for name in args.scenes:
        scene = veriray.load_file(name)
        size = {"width": args.width, "height": args.height}
        runs = [livebench.run(scene, device=args.device, **size) for _ in range(args.repeat)]
        table = runs[0]["rows"]
        for row, *others in zip(table, *(r["rows"] for r in runs[1:]), strict=True):
            times = [r["seconds"] for r in (row, *others) if r["seconds"] is not None]
            row["seconds"] = min(times, default=None)
        law = all(
            after["blocks"] == -(-before["live"] // livebench.BLOCK_SIZE)
            for before, after in zip(table, table[1:], strict=False)
        )
        same = len({r["film_sha256"] for r in runs}) == 1
        holds &= law and same and table[0]["live"] == args.width * args.height
        print(f"\n{name}, {args.width} x {args.height}, {runs[0]['device']}, "
              f"scheduler {runs[0]['scheduler']}")  # fmt: skip
        print(livebench.as_text(table))
        print(f"blocks[d + 1] = ceil(live[d] / 256): {'holds' if law else 'BROKEN'} in all "
              f"{len(table) - 1} bounces")  # fmt: skip
        result["tables"][name] = {**runs[0], "law_holds": law, "repeat": args.repeat}
    write(result, args.output)
    return 0 if holds else 1


if __name__ == "__main__":
    sys.exit(main())
