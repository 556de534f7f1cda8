"""Speed on a GPU against Mitsuba 3's cuda_ad_rgb: same scene file and settings, alternating.

Mitsuba's Cornell box at 1024 x 1024, box filter, independent sampler. Seconds are those until the
film is complete in device memory; `wall` is the whole call with standard errors, copy and hash.
Medians over rounds after a warm-up; the means of the pictures must agree before a time is quoted.
Errors are against a picture of ours at --reference-spp. Without Mitsuba on the path the peer is
left out and the reason recorded. The limit is instruction issue on an H200, 0.23 ms per sample of
1024 x 1024 pixels at max_depth 8 without roulette; for other settings it is scaled by the rays per
path.
"""

from __future__ import annotations

import sys
from typing import Any

import mitsuba_peer
import numpy as np
from common import (
    MITSUBA_BOX,
    NO_ROULETTE,
    RELMSE,
    Mitsuba,
    Ours,
    errors,
    header,
    means_agree,
    median,
    parser,
    write,
)

import veriray

LIMIT_SECONDS = 0.23e-3  # per sample of 2^20 pixels, max_depth 8, no roulette, one H200
TARGET = 1e-3  # relMSE
SETTINGS = {
    "max_depth 8, rr_depth 5": (8, 5),
    "max_depth 8, no roulette": (8, NO_ROULETTE),
    "unlimited, rr_depth 5": (-1, 5),
}


def measure(contestants: dict[str, Any], reference: np.ndarray, spp: int,
            rounds: int) -> dict[str, Any]:  # fmt: skip
    """Alternating rounds of all contestants at one number of samples."""
    rows: dict[str, list[dict[str, Any]]] = {name: [] for name in contestants}
    images: dict[str, list[np.ndarray]] = {name: [] for name in contestants}
    for seed in range(rounds + 1):
        for name, contestant in contestants.items():
            row, image = contestant.run(spp, seed)
            if seed:
                rows[name].append({"seed": seed, **row, **errors(image, reference)})
                images[name].append(image)
    pixels = reference.shape[0] * reference.shape[1]
    out: dict[str, Any] = {}
    for name, r in rows.items():
        seconds, mse, relmse = median(r, "seconds"), median(r, "mse"), median(r, "relmse")
        out[name] = {
            "seconds": seconds,
            "wall": median(r, "wall"),
            "mpaths_per_second": pixels * spp / seconds / 1e6,
            "mse": mse,
            "relmse": relmse,
            "seconds_to_target": seconds * relmse / TARGET,
            "efficiency": 1 / (mse * seconds),
            "rounds": r,
        }
        if "mitsuba" in rows and name != "mitsuba":
            peer = rows["mitsuba"]
            ratio = [t["seconds"] / o["seconds"] for o, t in zip(r, peer, strict=True)]
            out[name]["times_faster"] = float(np.median(ratio))
            out[name]["agreement"] = means_agree(
                images[name], images["mitsuba"], contestants[name].last.stderr
            )
    if "mitsuba" in out:
        for name in rows:
            seconds = out[name]["seconds_to_target"]
            out[name]["times_faster_to_target"] = out["mitsuba"]["seconds_to_target"] / seconds
    return out


def main() -> int:
    """Command line."""
    p = parser(__doc__, "speed_cuda.json")
    p.add_argument("--size", type=int, default=1024, help="width and height")
    p.add_argument("--spp", type=int, nargs="+", default=[64, 256])
    p.add_argument("--reference-spp", type=int, default=65536)
    p.add_argument("--rounds", type=int, default=5)
    p.add_argument("--schedulers", nargs="+", default=["fused", "thrust"])
    p.add_argument("--device", default="cuda")
    p.add_argument("--peer", default="cuda_ad_rgb", help="variant of Mitsuba, or 'none'")
    args = p.parse_args()
    mi, why = None, "not asked for"
    if args.peer != "none":
        try:
            mi, why = mitsuba_peer.start(args.peer), ""
        except (ImportError, RuntimeError) as error:
            why = str(error)
            print(f"no peer: {why}")
    result = header("speed_cuda", "mitsuba", "drjit")
    if mi is not None:
        result["versions"]["mitsuba"] = mi.__version__
    chosen, _ = veriray.device.select(args.device)
    result["device"] = {"name": chosen.name, "description": chosen.description, **chosen.details}
    result["build"] = chosen.native.build_info()
    result["settings"] = {
        "scene": MITSUBA_BOX.name, "width": args.size, "height": args.size, "filter": "box",
        "sampler": "independent", "rounds": args.rounds, "reference_spp": args.reference_spp,
        "errors": RELMSE, "target_relmse": TARGET, "peer": args.peer if mi else None,
        "no_peer": why or None,
        "limit": f"{LIMIT_SECONDS * 1e3} ms per sample of 2^20 pixels, one H200, at max_depth 8 "
                 "without roulette",
    }  # fmt: skip
    scene = veriray.load_file(MITSUBA_BOX)
    limit = LIMIT_SECONDS * args.size**2 / 2**20
    rows: dict[str, Any] = {}
    rays: dict[str, float] = {}
    ok = True
    for name, (max_depth, rr_depth) in SETTINGS.items():
        settings: dict[str, Any] = {"width": args.size, "height": args.size, "max_depth": max_depth,
                    "rr_depth": rr_depth}  # fmt: skip
        reference = veriray.render(
            scene, spp=args.reference_spp, seed=2**32, device=args.device, **settings
        )
        rays[name] = reference.stats["rays"] / reference.stats["paths"]
        contestants: dict[str, Any] = {
            s: Ours(scene, args.device, scheduler=s, **settings) for s in args.schedulers
        }
        if mi is not None:
            contestants["mitsuba"] = Mitsuba(mi, MITSUBA_BOX, **settings)
        rows[name] = {
            str(spp): measure(contestants, reference.image, spp, args.rounds) for spp in args.spp
        }
        rows[name]["reference"] = {"film_sha256": reference.film_sha256,
                                   "seconds": reference.stats["seconds"]}  # fmt: skip
    for name, by_spp in rows.items():
        by_spp["rays_per_path"] = rays[name]
        fastest = limit * rays[name] / rays["max_depth 8, no roulette"]  # seconds per spp
        for spp in args.spp:
            for who, row in by_spp[str(spp)].items():
                agreement = row.get("agreement", {"agree": True})
                ok &= agreement["agree"]
                if not agreement["agree"]:
                    print(f"{name}, {who}: THE MEANS DIFFER, no time is quoted: {agreement}")
                    continue
                row["percent_of_limit"] = 100 * fastest * spp / row["seconds"]
                ratio = row.get("times_faster")
                print(f"{name}, {spp} spp, {who}: {row['seconds'] * 1e3:.2f} ms, "
                      f"{row['mpaths_per_second']:.0f} Mpaths/s, "
                      f"{row['percent_of_limit']:.0f} % of the limit, "
                      f"relMSE {row['relmse']:.3g}, "
                      f"{row['seconds_to_target'] * 1e3:.2f} ms to relMSE {TARGET}"
                      + (f", {ratio:.2f} x Mitsuba" if ratio else ""))  # fmt: skip
    result["rows"] = rows
    write(result, args.output)
    return 0 if ok else 1


if __name__ == "__main__":
    sys.exit(main())
