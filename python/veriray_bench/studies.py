"""Kinds of scenarios about veriray: compaction, adaptive sampling, variants, roulette, and, beside
peers, what surfaces cost.
"""

from __future__ import annotations

import math

import numpy as np

from veriray.rendering import Render, render
from veriray.sampling import PILOTS, tile_errors
from veriray.scene import load_file

from .compaction import STRATEGIES, study
from .kinds import REFERENCE_SEED, Bench, Result, Settings, film_settings, loaded
from .measure import Array, BenchError, errors, mean, mean_error, means_agree, median, spread
from .race import Contestant, Lane, PeerRun, Veriray, absent, compare, differ, race, summary
from .scenarios import NO_ROULETTE, Scenario, scene_file

LIMIT = 2**16  # samples of a pixel at most, of either way
_TRY = 256  # samples of the render that says how many uniform ones need

#: Mitsuba's Cornell box with other surfaces.
SURFACES = {"matt": "cornell-box-mitsuba", "textured": "cornell textured",
            "rough": "cornell all rough"}  # fmt: skip


def cost(bench: Bench, scenario: Scenario, settings: Settings) -> Result:
    """The box with matt, textured and rough surfaces, of ours and of peers, in one race.

    A rough surface absorbs other shares than a matt one, so paths differ in length: figures are of
    the time per path (`textured_over_matt`) and per ray (`rough_over_matt`, `textured_per_ray`).
    """
    step = bench.steps(settings["rounds"] + 1)
    ours: dict[str, Contestant] = {}
    theirs: dict[str, tuple[str, str]] = {}
    lost: dict[str, Result] = {}
    for surface, scene in SURFACES.items():
        path = scene_file(scene, bench.folder)
        ours[f"veriray {surface}"] = bench.ours(load_file(path), settings)
        for name in bench.crew.names() if scenario.peers else ():
            label = f"{name} {surface}"
            try:
                ours[label] = PeerRun(bench.crew.get(name), label, path, film_settings(settings))
                theirs[label] = surface, name
            except BenchError as error:
                lost[label] = absent(str(error))
    lanes = race(ours, settings["spp"][0], settings["rounds"], wait=bench.wait, step=step)
    rows: dict[str, Result] = {}
    figures: dict[str, float] = {}
    for surface in SURFACES:
        own = f"veriray {surface}"
        names = [own, *(label for label, (where, _) in theirs.items() if where == surface)]
        rows |= compare({n: ours[n] for n in names}, {n: lanes[n] for n in names}, scenario.margin,
                        bench.by)  # fmt: skip
        for label in names[1:]:
            if "times_faster" in rows[label]:
                figures[f"times_faster_{label.replace(' ', '_')}"] = rows[label]["times_faster"][
                    bench.by]["median"]  # fmt: skip
    matt = rows["veriray matt"]
    for surface in ("textured", "rough"):
        row = rows[f"veriray {surface}"]
        each = [b[bench.by] / a[bench.by] for a, b in zip(matt["rounds"], row["rounds"],
                                                          strict=True)]  # fmt: skip
        ratio = float(np.median(each))
        figures[f"{surface}_time_over_matt"] = ratio
        figures[f"{surface}_per_ray"] = ratio * matt["rays_per_path"] / row["rays_per_path"]
    figures["textured_over_matt"] = figures["textured_time_over_matt"]
    figures["rough_over_matt"] = figures["rough_per_ray"]
    bench.crew.forget()
    return {"rows": rows | lost, "figures": figures}


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
    predicted from a render of their own; both are then timed in turn. figures: saving in paths (the
    pilot's counted) and in time.
    """
    scene = loaded(bench, settings).with_(width=settings["width"], height=settings["height"])
    target = float(settings["vary"][1][0])
    step = bench.steps(2 + 2 * settings["rounds"])
    common = {"device": bench.device.name, "seed": 1}
    first = render(scene, spp=LIMIT, target_error=target, **common)
    step()
    worst = _worst(first)
    predicted = _worst(render(scene, spp=_TRY, **common)) ** 2 / worst**2
    spp = min(LIMIT, max(max(PILOTS.values()), math.ceil(_TRY * predicted)))
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


# ---- variants ----


def variants(bench: Bench, scenario: Scenario, settings: Settings) -> Result:
    """The compiled variant that the scene takes against the one with everything; one film.

    figures: times_faster, the time of everything over that of the scene's own variant.
    """
    scene = load_file(scene_file(settings["scene"], bench.folder))
    step = bench.steps(settings["rounds"] + 1)
    field = {
        "exact": bench.ours(scene, settings),
        "everything": bench.ours(scene, settings, all_features=True),
    }
    lanes = race(field, settings["spp"][0], settings["rounds"], wait=bench.wait, step=step)
    rows = compare(field, lanes, scenario.margin, bench.by)
    faster = rows["everything"].get("times_faster", {})
    native = bench.device.native
    base = native.path_bytes([])
    more = {name: native.path_bytes([name]) - base for name in native.variants()[-1]}
    return {
        "rows": rows,
        "path_bytes": {"of every path": base, **{name: n for name, n in more.items() if n}},
        "figures": {"times_faster": faster[bench.by]["median"]} if faster else {},
    }


# ---- roulette ----

BASE = 5  # the default start depth, of which the efficiencies are multiples


def roulette(bench: Bench, scenario: Scenario, settings: Settings) -> Result:
    """Start depths of roulette by efficiency 1 / (time x MSE), in multiples of that of rr_depth 5.

    Errors are against a converged picture with other random numbers. An efficiency is the geometric
    mean over rounds of the ratio within a round; its error the standard error of that mean.
    figures: winner (by MSE), its efficiency and error.
    """
    spp, rounds = settings["spp"][0], settings["rounds"]
    step = bench.steps(rounds + 5)
    scene = load_file(scene_file(settings["scene"], bench.folder))
    own = bench.ours(scene, settings)
    own.run(settings["reference_spp"], REFERENCE_SEED)
    for _ in range(4):
        step()

    def judge(image: Array) -> dict[str, float]:
        return errors(image, own.last.image, own.last.stderr)

    field = {start_name(d): bench.ours(scene, {**settings, "rr_depth": d})
             for d in settings["vary"][1]}  # fmt: skip
    lanes = race(field, spp, rounds, wait=bench.wait, judge=judge, step=step)
    base = lanes[start_name(BASE)]
    rows = {name: _start(own.last, field[name], lanes[name], base, scenario.margin, bench.by)
            for name in field}  # fmt: skip
    valid = {name: row["efficiency"]["mse"] for name, row in rows.items() if "void" not in row}
    figures = {}
    if start_name(BASE) in valid:
        winner = max(valid, key=lambda name: valid[name][0])
        figures = {"winner": winner, "efficiency": valid[winner][0], "error": valid[winner][1]}
    return {"rows": rows, "figures": figures}


def start_name(rr_depth: int) -> str:
    """The row of a start depth."""
    return "no roulette" if rr_depth == NO_ROULETTE else f"rr_depth {rr_depth}"


def _start(reference: Render, who: Veriray, lane: Lane, base: Lane, margin: float,
           by: str) -> Result:  # fmt: skip
    """One start depth's row; void where its mean is not the reference's."""
    last = who.last
    noise = np.hypot(
        mean_error(reference.stderr), mean_error(last.stderr) / math.sqrt(len(lane.rows))
    )
    agreement = means_agree(mean(reference.image), np.mean(lane.means, axis=0), noise, margin)
    if not agreement["agree"]:
        return {"void": differ(agreement), "agreement": agreement, "rounds": lane.rows}
    if min(row[key] for row in lane.rows + base.rows for key in ("mse", "relmse")) <= 0:
        return {"void": "the reference is too noisy", "rounds": lane.rows}
    row = {**summary(lane, last.stats["paths"], by), **who.facts(), "agreement": agreement}
    row["efficiency"] = {}
    for key in ("mse", "relmse"):
        row[key] = median(lane.rows, key)
        gains = [math.log(b[by] * b[key] / (r[by] * r[key]))
                 for b, r in zip(base.rows, lane.rows, strict=True)]  # fmt: skip
        gain = math.exp(np.mean(gains))
        error = gain * float(np.std(gains, ddof=1)) / math.sqrt(len(gains))
        row["efficiency"][key] = [gain, error]
    return row
