"""Time of the public call, `veriray.render`, and of what the device does of it.

    python benchmarks/call.py --device cuda
    PYTHONPATH=OLDER python benchmarks/call.py --device cuda      # of another build of the package

The Cornell box, 64 x 64 to 1920 x 1080 pixels, 1 and 64 samples each; medians of rounds in which
the sizes take turns. device: `stats["seconds"]`, the back end's own; call: until `render` returns;
over: call - device; image: until `render(...).image` is in NumPy; hash: the same with its
`film_sha256`. --profile lists the steps of a call of 256 x 256 pixels and 1 sample, which the
profiler makes slower.
"""

from __future__ import annotations

import argparse
import cProfile
import gc
import pstats
import time
from pathlib import Path
from statistics import median
from typing import Any

from common import header, write

import veriray as vr

SIZES = ((64, 64), (128, 128), (256, 256), (512, 512), (1024, 1024), (1920, 1080))
SPP = (1, 64)


def once(scene: vr.Scene, settings: dict[str, Any]) -> dict[str, float]:
    """Milliseconds of one round."""
    begin = time.perf_counter()
    picture = vr.render(scene, **settings)
    row = {"call": time.perf_counter() - begin, "device": picture.stats["seconds"]}
    begin = time.perf_counter()
    again = vr.render(scene, **settings).image
    row["image"] = time.perf_counter() - begin
    begin = time.perf_counter()
    picture = vr.render(scene, **settings)
    kept = picture.image, picture.film_sha256
    row["hash"] = time.perf_counter() - begin
    del again, kept
    return {name: 1e3 * seconds for name, seconds in row.items()}


def profile(scene: vr.Scene, device: str, calls: int = 100) -> None:
    """Prints what takes longest of a call: microseconds a call, own and with all that it calls."""
    settings = {"width": 256, "height": 256, "spp": 1, "device": device}
    vr.render(scene, **settings)
    with cProfile.Profile() as p:
        for _ in range(calls):
            vr.render(scene, **settings)
    rows = pstats.Stats(p).stats  # type: ignore[attr-defined]
    longest = sorted(rows.items(), key=lambda row: -row[1][2])[:24]
    for (file, _, name), (_, _, own, whole, _) in longest:
        own, whole = (1e6 * seconds / calls for seconds in (own, whole))
        print(f"{own:9.1f} {whole:9.1f} us  {Path(file).name} {name}")


def main() -> None:
    """Command line."""
    p = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawTextHelpFormatter)
    p.add_argument("--device", default="cuda")
    p.add_argument("--rounds", type=int, default=9)
    p.add_argument("--spp", type=int, nargs="*", default=list(SPP))
    p.add_argument("--largest", type=int, default=1 << 31, help="leave out films of more pixels")
    p.add_argument("--profile", action="store_true", help="steps of one call instead")
    p.add_argument("-o", "--output", type=Path)
    arguments = p.parse_args()
    scene = vr.cornell_box()
    if arguments.profile:
        return profile(scene, arguments.device)
    jobs = [
        {"width": w, "height": h, "spp": spp, "device": arguments.device}
        for spp in arguments.spp for w, h in SIZES if w * h <= arguments.largest
    ]  # fmt: skip
    times: list[list[dict[str, float]]] = [[] for _ in jobs]
    gc.disable()
    for k in range(arguments.rounds + 1):
        for rows, job in zip(times, jobs, strict=True):
            row = once(scene, job)
            rows.extend([row] if k else [])  # the first round warms up
            gc.collect()
    table = []
    names = ("device", "call", "over", "image", "hash")
    print(f"{'size':>11} {'spp':>4}", *(f"{name:>8}" for name in names), "ms")
    for job, rows in zip(jobs, times, strict=True):
        row = {name: median(r[name] for r in rows) for name in rows[0]}
        row["over"] = median(r["call"] - r["device"] for r in rows)
        table.append({**{k: job[k] for k in ("width", "height", "spp")}, **row})
        size = f"{job['width']}x{job['height']}"
        print(f"{size:>11} {job['spp']:>4}", *(f"{row[name]:8.3f}" for name in names))
    if arguments.output:
        chosen, _ = vr.device.select(arguments.device)
        about = {"name": chosen.name, "description": chosen.description}
        write({**header("call"), "device": about, "rounds": arguments.rounds, "ms": table},
              arguments.output)  # fmt: skip


if __name__ == "__main__":
    main()
