"""Renderers side by side: alternating rounds, ratios, and whether they draw the same picture."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, Protocol

import numpy as np

from veriray.rendering import Render, render
from veriray.scene import Scene

from .measure import (
    Array,
    BenchError,
    Meter,
    mean,
    mean_error,
    means_agree,
    median,
    spread,
    wait_quiet,
)
from .peers import Peer

TIMES = ("seconds", "wall", "cpu")
_FACTS = ("device", "scheduler", "threads", "features", "variant", "path_bytes", "kernel",
          "primitives", "tree", "live_rays", "memory", "launches")  # fmt: skip


class Contestant(Protocol):
    """Who can take part."""

    def run(self, spp: int, seed: int) -> tuple[dict[str, Any], Array]:
        """Times (see `kinds`) and picture of one render."""


class Veriray:
    """Our renderer. `last` is the Render of the last run."""

    last: Render

    def __init__(self, scene: Scene, **settings: Any) -> None:
        self.scene, self.settings = scene, settings

    def run(self, spp: int, seed: int) -> tuple[dict[str, Any], Array]:
        """The whole call until the picture is in NumPy."""
        with Meter() as m:
            self.last = render(self.scene, spp=spp, seed=seed, **self.settings)
            image = self.last.image
        return {"seconds": self.last.stats["seconds"], **m.row()}, image

    def facts(self) -> dict[str, Any]:
        """What the last run was, for the record."""
        stats = self.last.stats
        return {
            "rays_per_path": stats["rays"] / stats["paths"],
            "film_sha256": self.last.film_sha256,
            "film_seed": self.last.seed,
            **{key: stats[key] for key in _FACTS},
        }


class PeerRun:
    """A scene that a peer has loaded."""

    def __init__(self, peer: Peer, key: str, path: Path, settings: dict[str, Any]) -> None:
        self.peer, self.key = peer, key
        self.load_seconds = peer.load(key, path, settings)

    def run(self, spp: int, seed: int) -> tuple[dict[str, Any], Array]:
        """As `Peer.run`."""
        return self.peer.run(self.key, spp, seed)


@dataclass
class Lane:
    """What one contestant did: a row and the mean (3,) of the picture for each round."""

    rows: list[dict[str, Any]] = field(default_factory=list)
    means: list[Array] = field(default_factory=list)
    failed: str = ""


def race(
    contestants: Mapping[str, Contestant],
    spp: int,
    rounds: int,
    *,
    wait: float = 0.0,
    judge: Callable[[Array], dict[str, float]] | None = None,
    step: Callable[[], object] = lambda: None,
) -> dict[str, Lane]:
    """Alternating rounds after one to warm up; round k has seed k.

    wait: seconds to wait for an idle machine before each run; judge: further columns from a
    picture; step: called after each round. A peer that fails drops out.
    """
    lanes = {name: Lane() for name in contestants}
    for seed in range(rounds + 1):
        for name, contestant in contestants.items():
            lane = lanes[name]
            if lane.failed:
                continue
            before = {"before": wait_quiet(wait)} if seed and wait else {}
            try:
                row, image = contestant.run(spp, seed)
            except BenchError as error:
                lane.failed = str(error)
                continue
            if seed:
                extra = judge(image) if judge else {}
                lane.rows.append({"seed": seed, **row, **before, **extra})
                lane.means.append(mean(image))
        step()
    return lanes


def summary(lane: Lane, paths: int, by: str) -> dict[str, Any]:
    """Medians and spread of a lane; samples per second by the time `by`."""
    rows = lane.rows
    foreign = [row["foreign"] for row in rows if row["foreign"] is not None]
    return {
        **{key: median(rows, key) for key in TIMES},
        "spread": {key: spread(row[key] for row in rows) for key in ("seconds", "wall")},
        "foreign": float(np.median(foreign)) if foreign else None,
        "mpaths_per_second": paths / median(rows, by) / 1e6,
        "mpaths_per_cpu_second": paths / max(median(rows, "cpu"), 1e-9) / 1e6,
        "rounds": rows,
    }


def compare(
    contestants: Mapping[str, Contestant], lanes: Mapping[str, Lane], margin: float, by: str
) -> dict[str, dict[str, Any]]:
    """A row for each contestant; the first is ours, the others are compared with it.

    Another run of ours must have the same film, a peer the same mean. Where that does not hold, the
    row is `void`: its rounds are kept, and no median and no ratio is made of them.
    """
    (base, first), *others = lanes.items()
    own = contestants[base]
    assert isinstance(own, Veriray)
    last = own.last
    paths = last.stats["paths"]
    rows = {base: {**summary(first, paths, by), **own.facts()}}
    one = mean_error(last.stderr)
    for name, lane in others:
        contestant = contestants[name]
        row: dict[str, Any] = {}
        if lane.failed:
            row["void"] = lane.failed
        elif isinstance(contestant, Veriray):
            row |= contestant.facts()
            if row["film_sha256"] != rows[base]["film_sha256"]:
                row["void"] = f"the film differs from that of {base}"
        else:
            noise = one * np.sqrt(1 / len(first.rows) + 1 / len(lane.rows))
            row["agreement"] = means_agree(
                np.mean(first.means, axis=0), np.mean(lane.means, axis=0), noise, margin
            )
            if not row["agreement"]["agree"]:
                row["void"] = differ(row["agreement"])
        if "void" in row:
            rows[name] = {**row, "rounds": lane.rows}
            continue
        rows[name] = {**summary(lane, paths, by), **row, "times_faster": {}}
        for key in TIMES:
            each = [t[key] / o[key] for o, t in zip(first.rows, lane.rows, strict=True)]
            rows[name]["times_faster"][key] = {
                "median": float(np.median(each)), "spread": spread(each), "rounds": each,
            }  # fmt: skip
    return rows


def absent(why: str) -> dict[str, Any]:
    """The row of a peer that did not take part."""
    return {"void": why, "absent": True}


def differ(agreement: dict[str, Any]) -> str:
    """Why a row is void whose means do not agree."""
    far = max(agreement["relative_difference"], key=abs)
    z = max(abs(z) for z in agreement["z"])
    return f"the means of the pictures differ by {100 * far:.3g} %, {z:.1f} standard errors"
