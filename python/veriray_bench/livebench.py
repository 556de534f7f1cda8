"""`veriray bench live-rays`: how many rays live at each depth, and what each depth costs.

The columns Depth, Live rays and Thread blocks are those of Table 1 of the 2016 report on thread
compaction, measured by the scheduler that implements its algorithm (`veriray.depths`).
"""

from __future__ import annotations

import os
import platform
import time
from collections.abc import Callable
from typing import Any

from veriray.depths import law_holds, rows
from veriray.rendering import render
from veriray.scene import Scene


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
