"""Reports of native renders: their sum, and the statistics that a picture has of it."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, Any

import numpy.typing as npt

from .picture import LEDGER_COLUMNS

if TYPE_CHECKING:
    from ._native import Report

Array = npt.NDArray[Any]

MAX_NONFINITE = 64


def added(first: Report | None, second: Report) -> Report:
    """One report of both renders; what describes the machine is the second's."""
    if first is None:
        return second
    result = second.copy()
    for name in ("ledger", "blocks", "depth_seconds", "compaction_seconds"):
        result[name] = _padded_sum(first[name], second[name])
    for name in ("seconds", "nonfinite_samples", "launches"):
        result[name] = first[name] + second[name]  # type: ignore[literal-required]
    result["nonfinite"] = [*first["nonfinite"], *second["nonfinite"]][:MAX_NONFINITE]
    return result


def in_order(nonfinite: list[Any]) -> list[Any]:
    """The first refused samples of several lists, by sample and pixel."""
    return sorted(nonfinite, key=lambda entry: (entry[2], entry[1], entry[0]))[:MAX_NONFINITE]


def statistics(report: Report, paths: int) -> dict[str, Any]:
    """The keys of `Render.stats` that a report gives."""
    ledger = report["ledger"]
    if ledger.ndim == 2:
        columns = dict(zip(LEDGER_COLUMNS, ledger.T.tolist(), strict=True))
    else:
        columns = {name: [] for name in LEDGER_COLUMNS}
    seconds = float(report["seconds"])
    return {
        "live_rays": columns["live"],
        "ledger": columns,
        "blocks": report["blocks"].tolist(),
        "depth_seconds": report["depth_seconds"].tolist(),
        "compaction_seconds": report["compaction_seconds"].tolist(),
        "rays": sum(columns["live"] + columns["shadow_visible"] + columns["shadow_occluded"]),
        "paths": paths,
        "seconds": seconds,
        "samples_per_second": paths / seconds if seconds > 0 else 0.0,
        "nonfinite_samples": int(report["nonfinite_samples"]),
        "nonfinite": [list(entry) for entry in report["nonfinite"]],
        "launches": int(report["launches"]),
        "threads": int(report["threads"]),
        "variant": [str(name) for name in report["features"]],
        "path_bytes": int(report["path_bytes"]),
        "kernel": {str(k): int(v) for k, v in report["kernel"].items()},
    }


def refused_text(stats: dict[str, Any]) -> str:
    """How many samples the film refused, why, and how to see one again."""
    limit = "2^20" if stats.get("filter", "box") == "box" else "2^17 or 2^20"

    def reason(radiance: list[float]) -> str:
        if any(math.isnan(x) for x in radiance):
            return "not a number"
        if any(math.isinf(x) for x in radiance):
            return "infinite"
        return "negative" if min(radiance) < 0 else f"{limit} times the largest radiance or more"

    listed = stats["nonfinite"]
    text = f"{stats['nonfinite_samples']:,} of {stats['paths']:,} samples count as black: the film "
    if not listed:
        return text + "cannot hold them"
    reasons = [reason(entry[3:]) for entry in listed]
    counts = ", ".join(f"{reasons.count(name)} {name}" for name in dict.fromkeys(reasons))
    # One beyond the film, in the rim with which pixels share samples, cannot be replayed.
    width, height = stats["width"], stats["height"]
    x, y, sample = next((e for e in listed if 0 <= e[0] < width and 0 <= e[1] < height), listed[0])[
        :3
    ]
    return (
        f"{text}cannot hold them (of the {len(listed)} listed: {counts}); replay one with --pixel "
        f"{x} {y} --sample {sample} --seed {stats['seed']}, in Python trace_path(scene, {x}, {y}, "
        f"{sample}, seed={stats['seed']}), and this picture's size, depths and sampler"
    )


def _padded_sum(a: Array, b: Array) -> Array:
    """Sum of arrays whose lengths differ; the short one is padded with zeros."""
    if len(a) < len(b):
        a, b = b, a
    total = a.copy()
    if len(b):
        total[: len(b)] += b
    return total
