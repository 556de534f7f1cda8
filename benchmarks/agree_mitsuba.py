"""Agreement with Mitsuba 3 on the same scene file, by the equal-effort tests of `veriray.compare`.

Each depth of --depths: 64 batches of --spp samples from both, independent seeds, box filter, the
sign-flip tests S0 to S3 at a family-wise false-alarm rate of 1e-3. Exit status 1 if one differs.
"""

from __future__ import annotations

import sys
from pathlib import Path
from typing import Any

import mitsuba_peer
from common import MITSUBA_BOX, Meter, header, parser, write

import veriray


def agree(mi: Any, scene: Path, max_depth: int, size: int, batches: int, spp: int,
          device: str) -> dict[str, Any]:  # fmt: skip
    """One comparison at roulette from depth 5; spp is that of a batch."""
    settings: dict[str, Any] = {
        "max_depth": max_depth,
        "rr_depth": 5,
        "width": size,
        "height": size,
    }
    with Meter() as theirs:
        peer = mitsuba_peer.render(mi, scene, batches=batches, spp=spp, seed=1000, **settings)
    with Meter() as mine:
        ours = veriray.render(
            veriray.load_file(scene), spp=batches * spp, seed=1, batches=batches, device=device,
            **settings,
        )  # fmt: skip
    report = veriray.compare(ours, peer)
    whole = [row for row in report.power if row["scale"] == "whole picture"]
    return {
        "max_depth": max_depth,
        "result": report.result,
        "effort": report.effort,
        "verdict": report.verdict,
        "tests": [
            {"name": t.name, "result": t.result, "p": t.p, "threshold": t.threshold,
             "where": t.where}
            for t in report.tests
        ],
        "smallest_detectable_bias": whole[0]["smallest"] if whole else None,
        "power": report.power,
        "mean_ours": ours.image.mean(axis=(0, 1), dtype=float).tolist(),
        "mean_mitsuba": peer.image.mean(axis=(0, 1), dtype=float).tolist(),
        "variance_ratio": report.figures.get("variance_ratio"),
        "film_sha256": ours.film_sha256,
        "device": ours.stats["device"],
        "notes": report.notes,
        "metered": {"ours": mine.row(), "mitsuba": theirs.row()},
    }  # fmt: skip


def main() -> int:
    """Command line."""
    p = parser(__doc__, "agree_mitsuba.json")
    p.add_argument("--variant", default="llvm_ad_rgb", help="of Mitsuba (default: %(default)s)")
    p.add_argument("--size", type=int, default=64, help="width and height")
    p.add_argument("--spp", type=int, default=64, help="samples of a batch")
    p.add_argument("--batches", type=int, default=64)
    p.add_argument("--depths", type=int, nargs="+", default=[2, 3, 8, -1])
    p.add_argument("--device", default="cpu")
    args = p.parse_args()
    try:
        mi = mitsuba_peer.start(args.variant)
    except (ImportError, RuntimeError) as error:
        print(f"no peer: {error}", file=sys.stderr)
        return 2
    result = header("agree_mitsuba", "mitsuba", "drjit")
    result["settings"] = {
        "scene": MITSUBA_BOX.name, "variant": args.variant, "width": args.size,
        "height": args.size, "batches": args.batches, "spp_of_a_batch": args.spp, "rr_depth": 5,
        "filter": "box", "sampler": "independent", "alpha": 1e-3, "seed_ours": 1,
        "seeds_mitsuba": [1000, 1000 + args.batches - 1],
    }  # fmt: skip
    result["rows"] = []
    for depth in args.depths:
        row = agree(mi, MITSUBA_BOX, depth, args.size, args.batches, args.spp, args.device)
        smallest = min((t["p"] for t in row["tests"] if t["p"] is not None), default=None)
        print(f"max_depth {depth:2d}: {row['result']}, smallest p {smallest}, {row['verdict']}")
        result["rows"].append(row)
    write(result, args.output)
    return 0 if all(row["result"] == "pass" for row in result["rows"]) else 1


if __name__ == "__main__":
    sys.exit(main())
