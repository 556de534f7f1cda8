"""Speed on the CPU against Mitsuba 3's llvm_ad_rgb: same scene file and settings, alternating.

Mitsuba's Cornell box, box filter, independent sampler. Wall time of a whole call (ours: `render`
with film, standard errors and hash; Mitsuba: `render` and the copy to numpy) after a warm-up, own
CPU time, medians over rounds and the median of the rounds' ratios. The means of the pictures must
agree before a time is quoted. The limit is arithmetic alone: 41 Mpaths/s per core of a processor
with two 512-bit FMA units at 4.1 GHz (max_depth 8, no roulette); for other settings it is scaled by
the rays per path.
"""

from __future__ import annotations

import sys
from typing import Any

import mitsuba_peer
import numpy as np
from common import (
    MITSUBA_BOX,
    NO_ROULETTE,
    Meter,
    cpu_count,
    header,
    means_agree,
    median,
    parser,
    wait_quiet,
    write,
)

import veriray

LIMIT_PATHS_PER_CORE = 41e6  # per second, max_depth 8, no roulette
SETTINGS = {"max_depth 8, rr_depth 5": (8, 5), "max_depth 8, no roulette": (8, NO_ROULETTE)}


def compare_speed(
    mi: Any, scene: veriray.Scene, max_depth: int, rr_depth: int, args: Any
) -> dict[str, Any]:
    """Alternating rounds at one setting."""
    size: dict[str, Any] = {"width": args.size, "height": args.size}
    depths: dict[str, Any] = {"max_depth": max_depth, "rr_depth": rr_depth}
    peer = mi.load_file(str(MITSUBA_BOX), **size, **depths)

    def run_ours(seed: int) -> veriray.Render:
        return veriray.render(
            scene, spp=args.spp, seed=seed, device=args.device, threads=args.threads, **size,
            **depths,
        )  # fmt: skip

    def run_peer(seed: int) -> np.ndarray:
        return mitsuba_peer.picture(mi, peer, args.spp, seed)

    ours, theirs = run_ours(0), run_peer(0)
    rows: dict[str, list[dict[str, Any]]] = {"ours": [], "mitsuba": []}
    images: dict[str, list[np.ndarray]] = {"ours": [ours.image], "mitsuba": [theirs]}
    for seed in range(1, args.rounds + 1):
        quiet = wait_quiet(args.quiet)
        with Meter() as m:
            ours = run_ours(seed)
        rows["ours"].append({"seed": seed, **m.row(), "before": quiet})
        images["ours"].append(ours.image)
        quiet = wait_quiet(args.quiet)
        with Meter() as m:
            theirs = run_peer(seed)
        rows["mitsuba"].append({"seed": seed, **m.row(), "before": quiet})
        images["mitsuba"].append(theirs)

    paths = ours.stats["paths"]
    summary = {
        who: {
            "wall": median(r, "wall"),
            "cpu": median(r, "cpu"),
            "mpaths_per_second": paths / median(r, "wall") / 1e6,
            "mpaths_per_cpu_second": paths / median(r, "cpu") / 1e6,
            "rounds": r,
        }
        for who, r in rows.items()
    }
    ratios = {
        key: [t[key] / o[key] for o, t in zip(rows["ours"], rows["mitsuba"], strict=True)]
        for key in ("wall", "cpu")
    }
    return {
        **depths,
        "agreement": means_agree(images["ours"], images["mitsuba"], ours.stderr),
        **summary,
        "times_faster": {key: float(np.median(values)) for key, values in ratios.items()},
        "times_faster_rounds": ratios,
        "rays_per_path": ours.stats["rays"] / paths,
        "scheduler": ours.stats["scheduler"],
        "device": ours.stats["device"],
        "threads": ours.stats["threads"],
        "film_sha256": ours.film_sha256,
        "film_seed": args.rounds,
    }


def main() -> int:
    """Command line."""
    p = parser(__doc__, "speed_cpu.json")
    p.add_argument("--size", type=int, default=512, help="width and height")
    p.add_argument("--spp", type=int, default=64)
    p.add_argument("--rounds", type=int, default=5)
    p.add_argument("--device", default="cpu")
    p.add_argument("--threads", type=int, default=None)
    p.add_argument("--quiet", type=float, default=0, help="seconds to wait for an idle machine")
    args = p.parse_args()
    try:
        mi = mitsuba_peer.start("llvm_ad_rgb")
    except (ImportError, RuntimeError) as error:
        print(f"no peer: {error}", file=sys.stderr)
        return 2
    result = header("speed_cpu", "mitsuba", "drjit")
    result["settings"] = {
        "scene": MITSUBA_BOX.name, "width": args.size, "height": args.size, "spp": args.spp,
        "filter": "box", "sampler": "independent", "rounds": args.rounds, "peer": "llvm_ad_rgb",
        "threads": args.threads or cpu_count(),
        "limit": f"{LIMIT_PATHS_PER_CORE:.3g} paths/s per core at max_depth 8 without roulette",
    }  # fmt: skip
    scene = veriray.load_file(MITSUBA_BOX)
    rows = {name: compare_speed(mi, scene, *depths, args) for name, depths in SETTINGS.items()}
    full = rows["max_depth 8, no roulette"]["rays_per_path"]
    ok = True
    for name, row in rows.items():
        limit = LIMIT_PATHS_PER_CORE * full / row["rays_per_path"]
        per_cpu = row["ours"]["mpaths_per_cpu_second"]
        row["percent_of_limit"] = 100 * per_cpu * 1e6 / limit
        ok &= row["agreement"]["agree"]
        if not row["agreement"]["agree"]:
            print(f"{name}: THE MEANS DIFFER, no time is quoted: {row['agreement']}")
            continue
        print(f"{name}: ours {row['ours']['mpaths_per_second']:.2f} Mpaths/s "
              f"({per_cpu:.2f} per CPU-second, {row['percent_of_limit']:.0f} % of the limit), "
              f"Mitsuba {row['mitsuba']['mpaths_per_second']:.2f} "
              f"({row['mitsuba']['mpaths_per_cpu_second']:.2f}); "
              f"{row['times_faster']['wall']:.2f} x by wall, "
              f"{row['times_faster']['cpu']:.2f} x by CPU time")  # fmt: skip
    result["rows"] = rows
    write(result, args.output)
    return 0 if ok else 1


if __name__ == "__main__":
    sys.exit(main())
