"""Mitsuba 3 on our scene files, its pictures as `veriray.Render`.

Mitsuba reads the same XML file. Its roulette survives with probability min(max throughput, 0.95),
ours without the cap: the same mean, slightly other noise.
"""

from __future__ import annotations

import math
import time
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

from veriray import Render, film_hash
from veriray_bench.mitsuba import start

__all__ = ["batch_means", "picture", "render", "start"]
Array = npt.NDArray[Any]


def picture(mi: Any, scene: Any, spp: int, seed: int) -> Array:
    """(H, W, 3) float32."""
    return np.array(mi.render(scene, spp=spp, seed=seed), dtype=np.float32)[..., :3]


def batch_means(mi: Any, scene: Any, batches: int, spp: int, seed: int) -> Iterator[Array]:
    """`batches` pictures of spp samples each, with seeds seed, seed + 1 ..."""
    for k in range(batches):
        yield picture(mi, scene, spp, seed + k)


def render(
    mi: Any, path: Path, *, batches: int, spp: int, seed: int, max_depth: int, rr_depth: int,
    width: int, height: int,
) -> Render:  # fmt: skip
    """`batches` runs of spp samples a pixel each, as one Render with batch means, without ledger.

    The scene file must have the parameters max_depth, rr_depth, width and height.
    """
    scene = mi.load_file(
        str(path), max_depth=max_depth, rr_depth=rr_depth, width=width, height=height
    )
    begin = time.perf_counter()
    means = np.stack(list(batch_means(mi, scene, batches, spp, seed))).astype(np.float64)
    image = means.mean(axis=0).astype(np.float32)
    stderr = (means.std(axis=0, ddof=1) / math.sqrt(batches)).astype(np.float32)
    total = spp * batches
    return Render(
        image=image,
        stderr=stderr,
        batch_means=means,
        film_sha256=film_hash(image, stderr, total),
        stats={
            "renderer": f"mitsuba {mi.__version__} {mi.variant()}",
            "max_depth": max_depth,
            "rr_depth": rr_depth,
            "seconds": time.perf_counter() - begin,
        },
        width=width,
        height=height,
        spp=total,
        seed=seed,
    )
