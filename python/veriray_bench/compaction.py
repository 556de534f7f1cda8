"""`veriray bench compaction`: what it costs and brings to close the gaps that ended paths leave.

Rows, each a scheduler of `veriray.render`. "none": every bounce is launched for all paths begun,
ended ones return at once. "remove_if" (the 2016 report's), "partition": Thrust's algorithm on the
array of path indices after each bounce. "copy_if": the same into a second array. "append": the
bounce itself appends its survivors, one atomic addition a warp. "wavefront": a launch for each
stage of a bounce, over queues filled by appending, hits sorted by material; gaps are refilled with
new paths, and the host waits for eight steps at a time; after S. Laine, T. Karras and T. Aila,
"Megakernels Considered Harmful", 2013. "unsorted": the same with one queue of hits. "regenerate":
no array at all; a thread whose path ends begins the next one (scheduler `fused`), as in J. Novak,
V. Havran, C. Dachsbacher, "Path Regeneration for Interactive Path Tracing", 2010, and T. Aila and
S. Laine's ray pool, "Understanding the Efficiency of Ray Traversal on GPUs", 2009.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

from veriray.depths import BLOCK_SIZE
from veriray.rendering import COMPACTIONS, Render, render
from veriray.scene import Scene

from .measure import median, spread

STRATEGIES = {
    **COMPACTIONS,
    "wavefront": "wavefront",
    "unsorted": "wavefront-unsorted",
    "regenerate": "fused",
}
_KEYS = (
    "device device_name width height spp seed max_depth rr_depth scene_sha256 version paths "
    "live_rays"
).split()


def study(
    scene: Scene,
    *,
    width: int = 1280,
    height: int = 720,
    spp: int = 16,
    device: str = "auto",
    rounds: int = 5,
    progress: Callable[[float], object] | None = None,
) -> dict[str, Any]:
    """Renders a scene by every strategy, in turn, `rounds` times after one to warm up.

    As many paths as pixels are in flight, but for "regenerate". Returns settings, live_rays,
    same_film (all films have one hash), winner, and rows, one a strategy: strategy, scheduler,
    seconds (median), spread, samples_per_second, times_slower (than the winner), film_sha256 and,
    for those of `COMPACTIONS`, blocks, bounce_seconds and compaction_seconds by depth (medians),
    lanes (share of the launched threads whose path lived) and compaction_share (of the time of all
    bounces). Raises as `veriray.render`, ValueError for rounds below 1.
    """
    if rounds < 1:
        raise ValueError(f"rounds = {rounds} is below 1")
    common: dict[str, Any] = {"spp": spp, "device": device, "width": width, "height": height}
    runs: dict[str, list[Render]] = {name: [] for name in STRATEGIES}
    done, ahead = 0, len(STRATEGIES) * (rounds + 1)
    for turn in range(rounds + 1):
        names = list(STRATEGIES)
        for name in names[turn % len(names) :] + names[: turn % len(names)]:
            batch = 0 if name == "regenerate" else min(width * height, 2**26)
            result = render(scene, scheduler=STRATEGIES[name], batch_size=batch, **common)
            runs[name] = [result] if turn == 0 else [*runs[name], result]
            done += 1
            if progress:
                progress(done / ahead)
    rows = [_row(name, results[1:]) for name, results in runs.items()]
    best = min(rows, key=lambda row: row["seconds"])
    for row in rows:
        row["times_slower"] = row["seconds"] / best["seconds"]
    first = runs["none"][0].stats
    return {
        "benchmark": "compaction",
        "rounds": rounds,
        **{key: first[key] for key in _KEYS},
        "rows": rows,
        "winner": best["strategy"],
        "same_film": len({row["film_sha256"] for row in rows}) == 1,
    }


def _row(name: str, results: list[Render]) -> dict[str, Any]:
    runs = [r.stats for r in results]
    last, seconds = runs[-1], median(runs, "seconds")
    row = {
        "strategy": name,
        "scheduler": last["scheduler"],
        "seconds": seconds,
        "spread": spread(s["seconds"] for s in runs),
        "samples_per_second": last["paths"] / seconds,
        "launches": last["launches"],
        "film_sha256": results[-1].film_sha256,
    }
    if name not in COMPACTIONS:
        return row
    depths = range(len(last["blocks"]))
    whole, closing = (
        [median([{"s": s[key][d]} for s in runs], "s") for d in depths]
        for key in ("depth_seconds", "compaction_seconds")
    )
    row |= {
        "blocks": last["blocks"],
        "bounce_seconds": [a - b for a, b in zip(whole, closing, strict=True)],
        "compaction_seconds": closing,
        "lanes": sum(last["live_rays"]) / (BLOCK_SIZE * sum(last["blocks"])),
        "compaction_share": sum(closing) / sum(whole) if sum(whole) else 0.0,
    }
    return row


def summary(result: dict[str, Any]) -> list[list[str]]:
    """A table with its head: one line a strategy."""
    table = [["strategy", "ms", "+-", "Mpaths/s", "slower", "blocks", "lanes", "closing gaps"]]
    for row in result["rows"]:
        rate = f"{1e-6 * row['samples_per_second']:.1f}"
        cells = [row["strategy"], f"{1e3 * row['seconds']:.2f}", f"{row['spread']:.0%}", rate]
        cells.append(f"{row['times_slower']:.2f} x")
        if "blocks" in row:
            cells += [f"{sum(row['blocks']):,}", f"{row['lanes']:.1%}",
                      f"{row['compaction_share']:.1%}"]  # fmt: skip
        table.append(cells + ["-"] * (8 - len(cells)))
    return table


def by_depth(result: dict[str, Any], limit: int = 16) -> list[list[str]]:
    """A table with its head: live rays, and blocks and ms (bounce + closing) of each strategy.

    Depths from `limit` on are one line, their sum.
    """
    rows = [row for row in result["rows"] if "blocks" in row]
    live = result["live_rays"]
    table = [["depth", "live rays", "share"]]
    for row in rows:
        table[0] += [f"{row['strategy']}: blocks", "ms"]
    ranges = [range(d, d + 1) for d in range(min(limit, len(live)))]
    if len(live) > limit:
        ranges.append(range(limit, len(live)))
    for depths in ranges:
        first = depths[0]
        rays = sum(live[d] for d in depths)
        name = str(first) if len(depths) == 1 else f"{first}-{depths[-1]}"
        line = [name, f"{rays:,}", f"{rays / result['paths']:.2%}"]
        for row in rows:
            bounce, closing = (
                1e3 * sum(row[key][d] for d in depths if d < len(row[key]))
                for key in ("bounce_seconds", "compaction_seconds")
            )
            blocks = sum(row["blocks"][d] for d in depths if d < len(row["blocks"]))
            line += [f"{blocks:,}", f"{bounce:.2f} + {closing:.2f}"]
        table.append(line)
    return table
