"""How each kind of scenario is measured.

A kind takes the `Bench`, a scenario and its settings and returns plain data: `rows`, `points` or
a `table` (what was measured) and `figures` (numbers that targets look at). Times of a render:
`seconds` until the film is complete in device memory; `wall`, `cpu` and `foreign` of the whole call
to a picture in NumPy, own CPU time and cores used by others. Ratios are by `seconds` on CUDA, by
`wall` on the CPU.
"""

from __future__ import annotations

import os
import time
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from veriray import depths
from veriray.device import Device
from veriray.native_scene import BUILDERS, choose_builder
from veriray.rendering import Render, prepare, render
from veriray.scene import SAMPLERS, Scene, load_file

from . import livebench
from .measure import (
    Array,
    BenchError,
    at_error,
    cpu_count,
    errors,
    mean,
    mean_error,
    means_agree,
    median,
    slope,
    spread,
)
from .peers import SAMPLERS as PEER_SAMPLERS
from .peers import Crew
from .race import Contestant, Lane, PeerRun, Veriray, absent, compare, differ, race, summary
from .scenarios import NO_ROULETTE, TARGET_RELMSE, Scenario, scene_file

#: Paths per second of the box, 18 quads, at max_depth 8 without roulette, by arithmetic alone (0.23
#: ms per sample of 2^20 pixels on an H200), and what they are the limit of.
LIMITS = {"cuda": 2**20 / 0.23e-3, "cpu": 41e6}
LIMIT_OF = {"cuda": "of an H200", "cpu": "a core with two 512-bit FMA units at 4.1 GHz"}
_OVERHEAD_SPP = 64
REFERENCE_SEED = 2**32

Settings = dict[str, Any]
Result = dict[str, Any]


@dataclass
class Bench:
    """Where measurements run.

    folder: for scene files; wait: seconds to wait for an idle machine before each run; progress:
    called with the fraction of a scenario that is done.
    """

    device: Device
    crew: Crew
    folder: Path
    wait: float = 0.0
    progress: Callable[[float], object] = lambda fraction: None

    @property
    def by(self) -> str:
        """The time that ratios are of."""
        return "seconds" if self.device.backend == "cuda" else "wall"

    def steps(self, count: int) -> Callable[[], None]:
        """A function to be called `count` times in the scenario."""
        done = 0

        def step() -> None:
            nonlocal done
            done += 1
            self.progress(min(done / count, 1.0))

        return step

    def render(self, scene: Scene, settings: Settings, **more: Any) -> Render:
        """One render of ours with the film and the depths of the settings."""
        return render(scene, device=self.device.name, **film_settings(settings), **more)

    def ours(self, scene: Scene, settings: Settings, sampler: str = "independent",
             **more: Any) -> Veriray:  # fmt: skip
        """A contestant of ours."""
        more["sampler"] = sampler
        return Veriray(scene, device=self.device.name, **film_settings(settings), **more)


def film_settings(settings: Settings) -> Settings:
    """What of the settings film and depths are."""
    return {key: settings[key] for key in ("width", "height", "max_depth", "rr_depth")}


def _peers(
    bench: Bench, scenario: Scenario, settings: Settings, all_samplers: bool = False
) -> tuple[dict[str, Contestant], dict[str, str]]:
    """The peers that have loaded the scene, and why the others have not."""
    found: dict[str, Contestant] = {}
    failed = {name: about["missing"] for name, about in bench.crew.about.items()
              if "missing" in about and scenario.peers}  # fmt: skip
    for name in bench.crew.names() if scenario.peers else ():
        for sampler in PEER_SAMPLERS[name][: None if all_samplers else 1]:
            named = "independent" if sampler == "own" else sampler
            path = scene_file(settings["scene"], bench.folder, named)
            label = f"{name} {sampler}" if all_samplers else name
            try:
                found[label] = PeerRun(bench.crew.get(name), label, path, film_settings(settings))
            except BenchError as error:
                failed[label] = str(error)
    return found, failed


def speed(bench: Bench, scenario: Scenario, settings: Settings) -> Result:
    """Samples per second of ours, of further schedulers and of peers, at equal samples."""
    step = bench.steps(settings["rounds"] + 1)
    rows = _compared(bench, scenario, settings, settings["spp"][0], step)
    figures = {"mpaths_per_second": rows["veriray"]["mpaths_per_second"], **_ratios(rows, bench.by)}
    if scenario.limit and (bench.device.backend == "cpu" or "H200" in bench.device.description):
        full = bench.render(load_file(settings["scene"]), {**settings, "max_depth": 8,
                            "rr_depth": NO_ROULETTE}, spp=16)  # fmt: skip
        share = full.stats["paths"] / full.stats["rays"] / LIMITS[bench.device.backend]
        key = "mpaths_per_second" if bench.device.backend == "cuda" else "mpaths_per_cpu_second"
        for row in rows.values():
            if key in row:
                rate = 1e6 * row[key] * rows["veriray"]["rays_per_path"]
                row["percent_of_limit"] = 100 * rate * share
        figures["percent_of_limit"] = rows["veriray"]["percent_of_limit"]
    return {"rows": rows, "figures": figures}


def _compared(
    bench: Bench, scenario: Scenario, settings: Settings, spp: int, step: Callable[[], None],
    **ours: Any,
) -> dict[str, dict[str, Any]]:  # fmt: skip
    """One race at equal samples; ours: further settings of our render."""
    begin = time.perf_counter()
    scene = load_file(scene_file(settings["scene"], bench.folder))
    bench.render(scene, settings, spp=1, **ours)
    ready = time.perf_counter() - begin
    field: dict[str, Contestant] = {"veriray": bench.ours(scene, settings, **ours)}
    for scheduler in scenario.schedulers:
        field[f"veriray {scheduler}"] = bench.ours(scene, settings, scheduler=scheduler, **ours)
    peers, failed = _peers(bench, scenario, settings)
    first = {}
    for name, peer in list(peers.items()):
        try:
            first[name] = peer.load_seconds + peer.run(1, 0)[0]["wall"]
        except BenchError as error:
            failed[name] = str(error)
            del peers[name]
    lanes = race(field | peers, spp, settings["rounds"], wait=bench.wait, step=step)
    rows = compare(field | peers, lanes, scenario.margin, bench.by)
    rows["veriray"]["seconds_to_first_sample"] = ready
    for name, seconds in first.items():
        rows[name]["seconds_to_first_sample"] = seconds
    bench.crew.forget()
    return rows | {name: absent(why) for name, why in failed.items()}


def _ratios(rows: dict[str, dict[str, Any]], by: str) -> dict[str, float]:
    """Of Mitsuba, which the targets name, as times_faster; of others with their names."""
    return {
        "times_faster" if name == "mitsuba" else f"times_faster_{name}": row["times_faster"][by][
            "median"
        ]
        for name, row in rows.items()
        if "times_faster" in row and not name.startswith("veriray")
    }


# ---- time against error ----


def error(bench: Bench, scenario: Scenario, settings: Settings) -> Result:
    """Error and time at several samples per pixel, of every sampler, against our reference."""
    rounds, curve = settings["rounds"], settings["spp"]
    step = bench.steps((rounds + 1) * len(curve) + 4)
    scene = load_file(scene_file(settings["scene"], bench.folder))
    own = bench.ours(scene, settings)
    own.run(settings["reference_spp"], REFERENCE_SEED)
    reference = own.last
    for _ in range(4):
        step()
    field: dict[str, Contestant] = {f"veriray {s}": bench.ours(scene, settings, s)
                                    for s in SAMPLERS}  # fmt: skip
    peers, failed = _peers(bench, scenario, settings, all_samplers=True)
    field |= peers
    lanes: dict[str, list[Lane]] = {name: [] for name in field}

    def judge(image: Array) -> dict[str, float]:
        return errors(image, reference.image, reference.stderr)

    for spp in curve:
        done = race(field, spp, rounds, wait=bench.wait, judge=judge, step=step)
        for name, lane in done.items():
            lanes[name].append(lane)
    bench.crew.forget()
    rows = {name: _curve(own, curve, lanes[name], scenario.margin, bench.by) for name in lanes}
    rows |= {name: absent(why) for name, why in failed.items()}
    return {
        "target_relmse": TARGET_RELMSE,
        "reference": {"film_sha256": reference.film_sha256, "seed": REFERENCE_SEED,
                      "spp": reference.spp, "seconds": reference.stats["seconds"]},
        "rows": rows,
        "figures": _best(rows),
    }  # fmt: skip


def _curve(reference: Veriray, curve: list[int], lanes: list[Lane], margin: float,
           by: str) -> Result:  # fmt: skip
    """One contestant's row: lists by samples per pixel, slope, time to the target."""
    if failed := next((lane.failed for lane in lanes if lane.failed), ""):
        return {"void": failed}
    r, last = reference.last, lanes[-1]
    one = mean_error(r.stderr)
    noise = one * np.sqrt(1 + r.spp / (curve[-1] * len(last.rows)))
    agreement = means_agree(mean(r.image), np.mean(last.means, axis=0), noise, margin)
    pixels = r.width * r.height
    points = [
        {"spp": spp, **summary(lane, pixels * spp, by), "mse": median(lane.rows, "mse"),
         "relmse": median(lane.rows, "relmse")}
        for spp, lane in zip(curve, lanes, strict=True)
    ]  # fmt: skip
    row: Result = {"agreement": agreement}
    if not agreement["agree"]:
        return {**row, "void": differ(agreement), "points": points}
    relmse = [p["relmse"] for p in points]
    seconds, beyond = at_error([p[by] for p in points], relmse, TARGET_RELMSE)
    slopes = {key: slope(curve, [p[key] for p in points]) for key in ("mse", "relmse")}
    return {
        **row,
        "points": points,
        "slope": {key: steep for key, (steep, _) in slopes.items()},
        "slope_error": {key: error for key, (_, error) in slopes.items()},
        "seconds_to_target": seconds,
        "extrapolated": beyond,
        "efficiency": 1 / max(points[-1]["mse"] * points[-1][by], 1e-300),
    }


def _best(rows: dict[str, Result]) -> dict[str, Any]:
    """The fastest sampler of ours and of Mitsuba to the target."""
    best: dict[str, tuple[float, str]] = {}
    for name, row in rows.items():
        if row.get("seconds_to_target"):
            who = name.split()[0]
            best[who] = min(best.get(who, (np.inf, "")), (row["seconds_to_target"], name))
    out: dict[str, Any] = {f"best_{who}": name for who, (_, name) in best.items()}
    if "veriray" in best:
        out["seconds_to_target"] = best["veriray"][0]
        if "mitsuba" in best:
            out["times_faster_to_target"] = best["mitsuba"][0] / best["veriray"][0]
    return out


# ---- scaling ----


def scaling(bench: Bench, scenario: Scenario, settings: Settings) -> Result:
    """Races along one setting: spp, size, icosphere (levels), max_depth or threads."""
    name, values = settings["vary"]
    if name == "threads":
        values = sorted({*(v for v in values if v < cpu_count()), cpu_count()})
    step = bench.steps((settings["rounds"] + 1) * len(values))
    points = []
    for value in values:
        used, spp, more = dict(settings), settings["spp"][0], {}
        if name == "spp":
            spp = value
        elif name == "size":
            used |= {"width": value, "height": value}
        elif name == "icosphere":
            used["scene"] = f"icosphere {value}"
        elif name == "max_depth":
            used["max_depth"] = value
        else:
            more["threads"] = value
        rows = _compared(bench, scenario, used, spp, step, **more)
        points.append({"value": 20 * 4**value if name == "icosphere" else value, "rows": rows})
        if name == "icosphere":
            for file in bench.folder.glob(f"icosphere_{value}*"):
                file.unlink()
    figures = {}
    if name == "spp" and len(points) > 2:
        figures["overhead_percent"] = _overhead(points)
    return {"varies": "triangles" if name == "icosphere" else name, "points": points,
            "figures": figures}  # fmt: skip


def _overhead(points: list[dict[str, Any]]) -> float:
    """Share in % of the fixed cost a in a + b spp at 64 spp; least squares of relative errors."""
    spp = np.array([p["value"] for p in points], float)
    seconds = np.array([p["rows"]["veriray"]["seconds"] for p in points])
    fit, *_ = np.linalg.lstsq(np.stack([1 / seconds, spp / seconds], axis=1), np.ones(len(spp)),
                              rcond=None)  # fmt: skip
    a, b = fit.tolist()
    return float(100 * a / (a + b * _OVERHEAD_SPP))


# ---- depth, build ----


def loaded(bench: Bench, settings: Settings) -> Scene:
    """The scenario's scene with its depths."""
    return load_file(scene_file(settings["scene"], bench.folder)).with_(
        max_depth=settings["max_depth"], rr_depth=settings["rr_depth"]
    )


def depth(bench: Bench, scenario: Scenario, settings: Settings) -> Result:
    """Live rays, blocks and time by depth with the scheduler `thrust`; a row's fastest time."""
    scene = loaded(bench, settings)
    step = bench.steps(settings["rounds"])
    size = {"width": settings["width"], "height": settings["height"]}
    runs = []
    for _ in range(settings["rounds"]):
        runs.append(livebench.run(scene, device=bench.device.name, **size))
        step()
    table = runs[0]["rows"]
    for row, *others in zip(table, *(r["rows"] for r in runs[1:]), strict=True):
        times = [r["seconds"] for r in (row, *others) if r["seconds"] is not None]
        row["seconds"] = min(times, default=None)
    out: Result = {"table": runs[0], "figures": {}}
    if len({r["film_sha256"] for r in runs}) > 1:
        out["void"] = "the same render gave different films"
    elif runs[0]["law_holds"] is False:
        out["void"] = f"blocks[d+1] = ceil(live[d] / {depths.BLOCK_SIZE}) does not hold"
    return out


def build(bench: Bench, scenario: Scenario, settings: Settings) -> Result:
    """By builder: seconds of the tree alone, of the scene and to a first picture, and the rate of
    renders; on the CPU the tree of "auto" on one core too."""
    scene = load_file(scene_file(settings["scene"], bench.folder))
    builders = BUILDERS[1:]
    step = bench.steps((len(builders) + 1) * settings["rounds"])
    millions = len(scene.triangles) / 1e6
    rows = {name: _built(bench, scene, settings, name, step) for name in builders}
    auto = rows[choose_builder(bench.device.backend, len(scene.triangles), paths=0)]
    figures = {"seconds_per_million": auto["tree_seconds"] / millions}
    figures |= {f"{name}_seconds_per_million": row["tree_seconds"] / millions
                for name, row in rows.items()}  # fmt: skip
    # Samples a pixel from which on the better tree has made up for the time that it took.
    fast, good = sorted(rows.values(), key=lambda row: row["scene_seconds"])
    lost = fast["seconds_per_spp"] - good["seconds_per_spp"]
    if lost > 0:
        figures["spp_to_catch_up"] = (good["scene_seconds"] - fast["scene_seconds"]) / lost
    if bench.device.backend == "cpu" and hasattr(os, "sched_setaffinity"):
        allowed = os.sched_getaffinity(0)
        os.sched_setaffinity(0, {min(allowed)})  # of this thread and those that it starts
        try:
            rows["auto, one core"] = _built(bench, scene, settings, "auto", step)
        finally:
            os.sched_setaffinity(0, allowed)
        figures["cpu_seconds_per_million"] = rows["auto, one core"]["tree_seconds"] / millions
    out: Result = {"triangles": len(scene.triangles), "rows": rows, "figures": figures}
    if len({row["film_sha256"] for row in rows.values()}) > 1:
        out["void"] = "the builders' trees gave different films"
    return out


def _built(bench: Bench, scene: Scene, settings: Settings, builder: str,
           step: Callable[[], None]) -> Result:  # fmt: skip
    times: dict[str, list[float]] = {"tree": [], "scene": [], "first_picture": [], "render": []}
    spp = settings["spp"][0]
    size = {key: settings[key] for key in ("width", "height")}
    for _ in range(settings["rounds"]):
        fresh = scene.with_()
        begin = time.perf_counter()
        facts = prepare(fresh, bench.device.name, **size, builder=builder)
        times["scene"].append(time.perf_counter() - begin)
        bench.render(fresh, settings, spp=1, builder=builder)
        times["first_picture"].append(time.perf_counter() - begin)
        times["tree"].append(facts["tree"]["seconds"])
        picture = bench.render(fresh, settings, spp=spp, builder=builder)
        times["render"].append(picture.stats["seconds"])
        step()
    medians = {f"{name}_seconds": float(np.median(values)) for name, values in times.items()}
    return {
        **medians,
        "seconds_per_spp": medians["render_seconds"] / spp,
        "mpaths_per_second": picture.stats["paths"] / medians["render_seconds"] / 1e6,
        "spread": {name: spread(values) for name, values in times.items()},
        "memory": facts["memory"],
        "tree": facts["tree"],
        "film_sha256": picture.film_sha256,
    }
