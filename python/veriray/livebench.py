"""`veriray bench live-rays`: how many rays live at each depth, and what each depth costs.

The columns Depth, Live rays and Thread blocks are those of Table 1 of the 2016 report on thread
compaction, measured by the scheduler that implements its algorithm. Row d: rays alive after bounce
d (row 0: the camera rays), thread blocks launched for that bounce, rays alive as a share of all
paths, and the time of the bounce. A bounce is launched for the rays that the one before left alive:
blocks[d + 1] = ceil(live[d] / 256) when all paths fit in one batch.
"""

from __future__ import annotations

import os
import platform
import time
from collections.abc import Callable
from typing import Any

from .rendering import Render, render
from .scene import Scene

BLOCK_SIZE = 256


def run(
    scene: Scene,
    *,
    width: int = 1280,
    height: int = 720,
    spp: int = 1,
    device: str = "auto",
    scheduler: str = "thrust",
    progress: Callable[[float], object] | None = None,
) -> dict[str, Any]:
    """Render once to warm up and once to measure; returns the table with its settings.

    One sample of every pixel is in flight at a time. Keys: rows (list of dicts depth, live, blocks,
    share, seconds), law_holds (None if not applicable), settings and stats of the run. Raises as
    `veriray.render`.
    """
    size = {"width": width, "height": height}
    common: dict[str, Any] = {"device": device, "scheduler": scheduler, **size}
    batch = min(width * height, 2**26)
    render(scene, spp=1, **common, batch_size=batch)
    result = render(scene, spp=spp, **common, batch_size=batch, progress=progress)
    stats = result.stats
    keys = "device device_name device_reason scheduler threads spp seed max_depth rr_depth"
    keys += " scene_sha256 version seconds samples_per_second rays paths"
    return {
        "benchmark": "live-rays",
        "time": time.strftime("%Y-%m-%dT%H:%M:%SZ", time.gmtime()),
        "machine": platform.machine(),
        "cpus": os.cpu_count(),
        **size,
        **{key: stats[key] for key in keys.split()},
        "film_sha256": result.film_sha256,
        "rows": rows(result),
        "law_holds": law_holds(result) if spp == 1 else None,
    }


def rows(result: Render) -> list[dict[str, Any]]:
    """The table of a render; blocks and seconds are None if the scheduler has none."""
    stats = result.stats
    live, blocks, seconds = stats["live_rays"], stats["blocks"], stats["depth_seconds"]
    table = []
    for depth in range(len(live) + (len(blocks) >= len(live) > 0)):
        before = depth - 1
        alive = live[depth] if depth < len(live) else 0
        table.append({
            "depth": depth,
            "live": alive,
            "blocks": blocks[before] if 0 <= before < len(blocks) else None,
            "share": alive / stats["paths"],
            "seconds": seconds[before] if 0 <= before < len(seconds) else None,
        })  # fmt: skip
    return table


def law_holds(result: Render) -> bool | None:
    """Whether the blocks of a bounce are ceil(live rays before it / 256); None: no blocks."""
    live, blocks = result.stats["live_rays"], result.stats["blocks"]
    if not blocks:
        return None
    return bool([-(-n // BLOCK_SIZE) for n in live] == blocks[: len(live)])


def as_text(table: list[dict[str, Any]], limit: int | None = None) -> str:
    """The table as aligned text; only the first `limit` rows and the last one when given.

    Columns that are empty in every row are left out.
    """
    headers = {
        "depth": "Depth",
        "live": "Live rays",
        "blocks": "Thread blocks",
        "share": "Share %",
        "seconds": "ms",
    }
    shown = [key for key in headers if any(row[key] is not None for row in table)]

    def cell(row: dict[str, Any], key: str) -> str:
        value = row[key]
        if value is None:
            return "-"
        if key == "share":
            return f"{100 * value:.4f}"
        return f"{1e3 * value:.3f}" if key == "seconds" else f"{value:,}"

    lines = [[headers[key] for key in shown]]
    for index, row in enumerate(table):
        if limit is None or index < limit or index == len(table) - 1:
            lines.append([cell(row, key) for key in shown])
        elif index == limit:
            lines.append(["..." for _ in shown])
    return aligned(lines)


def aligned(lines: list[list[str]]) -> str:
    """Lines with equal numbers of cells, right-aligned."""
    widths = [max(map(len, column)) for column in zip(*lines, strict=True)]
    return "\n".join(
        "  ".join(text.rjust(w) for text, w in zip(line, widths, strict=True)) for line in lines
    )
