"""Kinds of scenarios about veriray alone: adaptive sampling at equal error, and compaction."""

from __future__ import annotations

import math

import numpy as np

from ..render import Render, render
from ..sampling import PILOT, tile_errors
from .compaction import STRATEGIES, study
from .kinds import Bench, Result, Settings, loaded
from .measure import median, spread
from .scenarios import Scenario

LIMIT = 2**16  # samples of a pixel at most, of either way
_TRY = 256  # samples of the render that says how many uniform ones need


def compaction(bench: Bench, scenario: Scenario, settings: Settings) -> Result:
    """All ways to close the gaps of ended paths; see `bench.compaction.study`."""
    scene = loaded(bench, settings)
    step = bench.steps(len(STRATEGIES) * (settings["rounds"] + 1))
    found = study(
        scene, width=settings["width"], height=settings["height"], spp=settings["spp"][0],
        device=bench.device.name, rounds=settings["rounds"], progress=lambda _: step(),
    )  # fmt: skip
    slower = {row["strategy"]: row["times_slower"] for row in found["rows"]}
    figures = {"remove_if_slower": slower["remove_if"], "none_slower": slower["none"]}
    out: Result = {"study": found, "figures": figures}
    if not found["same_film"]:
        out["void"] = "the strategies gave different films"
    return out


def adaptive(bench: Bench, scenario: Scenario, settings: Settings) -> Result:
    """Adaptive against uniform sampling at the same error of the worst tile.

    The uniform samples that bring the worst tile to the error of the adaptive picture's are
    foretold from a render of their own; both are then timed in turn. figures: saving in paths (the
    pilot's counted) and in time.
    """
    scene = loaded(bench, settings).with_(width=settings["width"], height=settings["height"])
    target = float(settings["vary"][1][0])
    step = bench.steps(2 + 2 * settings["rounds"])
    common = {"device": bench.device.name, "seed": 1}
    first = render(scene, spp=LIMIT, target_error=target, **common)
    step()
    worst = _worst(first)
    foretold = _worst(render(scene, spp=_TRY, **common)) ** 2 / worst**2
    spp = min(LIMIT, max(PILOT, math.ceil(_TRY * foretold)))
    step()
    runs: dict[str, list[Render]] = {"adaptive": [], "uniform": []}
    for _ in range(settings["rounds"]):
        runs["adaptive"].append(render(scene, spp=LIMIT, target_error=target, **common))
        step()
        runs["uniform"].append(render(scene, spp=spp, **common))
        step()
    rows = {name: _row(pictures) for name, pictures in runs.items()}
    a, u = rows["adaptive"], rows["uniform"]
    figures = {
        "paths_saved": u["paths"] / a["paths"],
        "time_saved": u["seconds"] / a["seconds"],
    }
    return {"target_error": target, "rows": rows, "figures": figures}


def _worst(picture: Render) -> float:
    return float(np.sqrt(tile_errors(picture.image, picture.stderr).max()))


def _row(pictures: list[Render]) -> Result:
    stats = [picture.stats for picture in pictures]
    pixels = pictures[0].width * pictures[0].height
    return {
        "seconds": median(stats, "seconds"),
        "spread": spread(s["seconds"] for s in stats),
        "paths": stats[0]["paths"],
        "mean_spp": stats[0]["paths"] / pixels,
        "worst_tile": _worst(pictures[0]),
    }
