"""`veriray bench matrix`: classes of small scenes made by rule, beside a peer, by the wall.

For each scene the renderers take turns, with a seed of their own for each picture. Wall: median
seconds of the public call until the picture is in NumPy. Device: until the film is complete in the
device's memory. CPU: own processor seconds of the call. Variance: of a picture's pixels, relative,
mean over pixels and channels of

    V = sum_k (I_k - I)^2 / (K - 1) / (r^2 + 0.01 R^2),

where I_k are the K pictures of a renderer, I their mean, r the mean of all pictures of the scene,
and R the mean of r. Efficiency is 1 / (wall V). Ratios are the peer's wall and V over ours.

The means of the pictures must agree, or the scene has no figure: per channel, |z| is below the
limit at which a run of all scenes has a false alarm with probability ALARMS (Bonferroni), a
relative margin taken off.
"""

from __future__ import annotations

import math
import os
import time
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from statistics import NormalDist
from typing import Any
from unittest.mock import patch

import numpy as np

from veriray.scene import load_file

from .kinds import Bench, Result, Settings, film_settings
from .matrix_rules import RULES, SEEDS, Rule
from .measure import Array, BenchError, means_agree, median, wait_quiet
from .race import Contestant, PeerRun, Veriray, absent, differ
from .scenarios import BACKENDS, Scenario

ALARMS = 1e-3
#: Ours: that of a render that names none. The scenes' files name Mitsuba's own default.
SAMPLER = "sobol"
#: Seconds that the rounds of a scene may take; beyond it, all take fewer samples per pixel.
BUDGET = {"cpu": 8.0, "cuda": 2.0}
_LEAST_SPP = 4
TIMES = {"wall": "wall", "device": "seconds", "cpu": "cpu"}
FIGURES = ("wall", "device", "cpu", "variance", "efficiency")


@dataclass(frozen=True)
class Cell(Scenario):
    """A scene of the matrix: a rule and its seed."""

    rule_seed: int = 0

    def settings(self, backend: str, quick: bool) -> dict[str, Any]:
        """As of a scenario; large: whether the rule makes its big scenes."""
        large = backend == "cuda" and not quick
        return {**super().settings(backend, quick), "seed": self.rule_seed, "large": large}


def cells(rules: Sequence[Rule] = RULES, seeds: int = SEEDS) -> tuple[Cell, ...]:
    """Scenes of rules: first seed 0 of all, then seed 1 of all."""
    size, spp = {"cpu": 128, "cuda": 512}, {"cpu": (64,), "cuda": (64,)}
    return tuple(
        Cell(
            f"{rule.name}-{seed}", rule.title, rule.name, "matrix", size, spp, rule.max_depth,
            rule.rr_depth, rounds=4, margin=rule.margin, backends=BACKENDS, rule_seed=seed,
        )
        for seed in range(seeds)
        for rule in rules
    )  # fmt: skip


def choose(classes: Sequence[str], seeds: int) -> tuple[Cell, ...]:
    """The scenes of these classes, of all for none; ValueError for unknown ones."""
    known = {rule.name: rule for rule in RULES}
    for name in classes:
        if name not in known:
            raise ValueError(f"class {name!r} is unknown; expected some of: {', '.join(known)}")
    if not 1 <= seeds <= 1000:
        raise ValueError(f"seeds = {seeds} is outside [1, 1000]")
    return cells([rule for rule in RULES if not classes or rule.name in classes], seeds)


# ---- one scene ----


def matrix(bench: Bench, scenario: Cell, settings: Settings) -> Result:
    """A scene of the matrix, for ours and the peers that load it."""
    (rule,) = (r for r in RULES if r.name == scenario.scene)
    folder = bench.folder / scenario.name
    folder.mkdir(exist_ok=True)
    path = rule.write(settings["seed"], folder, settings["large"])
    film = film_settings(settings)
    begin = time.perf_counter()
    loaded = load_file(path)
    loads = {"veriray": time.perf_counter() - begin}
    field: dict[str, Contestant] = {"veriray": bench.ours(loaded, settings, SAMPLER)}
    rows: dict[str, Result] = {name: absent(about["missing"])
                               for name, about in bench.crew.about.items()
                               if "missing" in about}  # fmt: skip
    for name in bench.crew.names():
        try:
            peer = PeerRun(bench.crew.get(name), name, path, film)
        except BenchError as error:
            rows[name] = {"void": str(error)}
            continue
        field[name], loads[name] = peer, peer.load_seconds
    for file in folder.iterdir():
        file.unlink()
    # A renderer's first call waits for its kernels, as Mitsuba's does: what is timed has them.
    with patch.dict(os.environ, VERIRAY_KERNELS=os.environ.get("VERIRAY_KERNELS") or "wait"):
        taken = take_turns(
            field, settings["spp"][0], settings["rounds"], BUDGET[bench.device.backend],
            wait=bench.wait, step=bench.steps(settings["rounds"] + 2),
        )  # fmt: skip
    for name in field:
        taken.lanes[name].first["load"] = loads[name]
    own = field["veriray"]
    assert isinstance(own, Veriray)
    rows = judge(taken, alarm_limit(len(RULES) * SEEDS), scenario.margin) | rows
    keep = ("features", "variant", "scheduler", "primitives", "film_sha256")
    rows["veriray"] |= {key: value for key, value in own.facts().items() if key in keep}
    ratios = {name: row["ratios"] for name, row in rows.items() if "ratios" in row}
    return {"class": scenario.scene, "spp": taken.spp, "rows": rows, "figures": ratios}


@dataclass
class Lane:
    """What a renderer did: its first call, the timed rounds, their pictures."""

    first: dict[str, Any]
    rows: list[dict[str, Any]]
    pictures: list[Array]
    failed: str = ""


@dataclass
class Taken:
    """Lanes by renderer, and the samples per pixel that all took."""

    lanes: dict[str, Lane]
    spp: int


def take_turns(
    field: Mapping[str, Contestant], spp: int, rounds: int, budget: float, *, wait: float = 0.0,
    step: Callable[[], object] = lambda: None,
) -> Taken:  # fmt: skip
    """A first call, one to warm up and then rounds, alternating; each picture has its own seed.

    Samples are halved until the slowest renderer's rounds fit the budget in seconds. A peer that
    fails drops out.
    """
    lanes = {name: Lane({}, [], []) for name in field}

    def call(name: str, seed: int) -> tuple[dict[str, Any], Array] | None:
        try:
            return field[name].run(spp, seed)
        except BenchError as error:
            if name == "veriray":
                raise
            lanes[name].failed = str(error)
            return None

    slowest = 0.0
    for seed in range(2):
        for name, lane in lanes.items():
            done = None if lane.failed else call(name, seed)
            if done and seed == 0:
                lane.first = {"spp": spp, "wall": done[0]["wall"]}
            if done:
                # the first call of veriray may wait for kernels to be compiled
                slowest = max(slowest, done[0]["wall" if seed else "seconds"])
        while seed == 0 and slowest > 2 * budget and spp > _LEAST_SPP:
            spp, slowest = spp // 2, slowest / 2
        slowest = 0.0 if seed == 0 else slowest
        step()
    while slowest * rounds > budget and spp > _LEAST_SPP:
        spp, slowest = spp // 2, slowest / 2
    for seed in range(2, rounds + 2):
        for name, lane in lanes.items():
            if lane.failed:
                continue
            before = {"before": wait_quiet(wait)} if wait else {}
            if done := call(name, seed):
                lane.rows.append({"seed": seed, **done[0], **before})
                lane.pictures.append(done[1])
        step()
    return Taken(lanes, spp)


def alarm_limit(scenes: int) -> float:
    """|z| that three channels of so many scenes exceed with probability ALARMS at most."""
    return NormalDist().inv_cdf(1 - ALARMS / (2 * 3 * scenes))


# ---- figures ----


def variance(pictures: Sequence[Array], reference: Array) -> tuple[float, float]:
    """V (see above) of pictures (H, W, 3), and its standard error by their scatter."""
    stack = np.asarray(pictures, np.float64)
    weight = 1 / (reference**2 + 0.01 * reference.mean() ** 2)
    each = ((stack - stack.mean(axis=0)) ** 2 * weight).mean(axis=(1, 2, 3))
    each *= len(stack) / (len(stack) - 1)
    return float(each.mean()), float(each.std(ddof=1) / math.sqrt(len(each)))


def noise_of_mean(pictures: Sequence[Array]) -> Array:
    """(3,), standard error of the mean of all pictures, whose pixels are independent."""
    stack = np.asarray(pictures, np.float64)
    pixels = stack.var(axis=0, ddof=1) / len(stack)
    error: Array = np.sqrt(pixels.sum(axis=(0, 1))) / (pixels.shape[0] * pixels.shape[1])
    return error


def judge(taken: Taken, limit: float, margin: float) -> dict[str, Result]:
    """A row for each lane; peers have the test of the means and, if these agree, the ratios."""
    pictures = [p for lane in taken.lanes.values() if not lane.failed for p in lane.pictures]
    reference = np.mean(pictures, axis=0, dtype=np.float64)
    rows: dict[str, Result] = {}
    ours = taken.lanes["veriray"]
    for name, lane in taken.lanes.items():
        if lane.failed:
            rows[name] = {"void": lane.failed, "first": lane.first, "rounds": lane.rows}
            continue
        row: Result = {key: median(lane.rows, own) for key, own in TIMES.items()}
        row["variance"], row["variance_error"] = variance(lane.pictures, reference)
        row["efficiency"] = _inverse(row["wall"] * row["variance"])
        foreign = [r["foreign"] for r in lane.rows if r["foreign"] is not None]
        row |= {"foreign": float(np.median(foreign)) if foreign else None, "first": lane.first,
                "rounds": lane.rows}  # fmt: skip
        rows[name] = row
        if name == "veriray":
            continue
        noise = np.hypot(noise_of_mean(ours.pictures), noise_of_mean(lane.pictures))
        means = [np.mean(who.pictures, axis=(0, 1, 2), dtype=np.float64) for who in (ours, lane)]
        row["agreement"] = means_agree(*means, noise, margin, limit)
        if row["agreement"]["agree"]:
            row["ratios"] = ratios(rows["veriray"], row)
        else:
            row["void"] = differ(row["agreement"])
    return rows


def ratios(ours: Result, peer: Result) -> dict[str, float]:
    """The peer's times and variance over ours, and our efficiency over its."""
    found = {key: peer[key] / max(ours[key], 1e-9) for key in TIMES}
    # pictures without noise say nothing of variance
    found["variance"] = peer["variance"] / ours["variance"] if ours["variance"] > 0 else 1.0
    return {**found, "efficiency": found["wall"] * found["variance"]}


def _inverse(value: float) -> float | None:
    return 1 / value if value > 0 else None


# ---- all scenes ----


def headline(result: Result, peer: str) -> dict[str, Any]:
    """Geometric mean and minimum of each figure over all scenes that have it.

    Keys: scenes, void, failed (counts), and figure -> {"mean", "least", "where"}; no figures where
    there are none.
    """
    measured = [(name, row) for name, row in result["scenarios"].items() if row["kind"] == "matrix"]
    good = {name: row["figures"][peer] for name, row in measured
            if peer in row.get("figures", {})}  # fmt: skip
    out: dict[str, Any] = {
        "scenes": len(good),
        "void": sum("agreement" in row["rows"].get(peer, {}) and name not in good
                    for name, row in measured if "rows" in row),
        "failed": sum("error" in row for _, row in measured),
    }  # fmt: skip
    for key in FIGURES if good else ():
        where = min(good, key=lambda name: good[name][key])
        out[key] = {"mean": geometric_mean([g[key] for g in good.values()]),
                    "least": good[where][key], "where": where}  # fmt: skip
    return out


def by_class(result: Result, peer: str) -> dict[str, dict[str, Any]]:
    """Class -> title, scenes, why (of those without figures) and for each figure the geometric mean
    and the least over seeds.
    """
    found: dict[str, dict[str, Any]] = {}
    for row in result["scenarios"].values():
        if row["kind"] != "matrix":
            continue
        entry = found.setdefault(row["settings"]["scene"], {"title": row["title"], "rows": [],
                                                            "why": [], "own": []})  # fmt: skip
        if "error" in row:
            entry["why"].append(row["error"])
            continue
        entry["own"].append(row["rows"]["veriray"])
        theirs = row["rows"].get(peer, {})
        if peer in row["figures"]:
            entry["rows"].append(row["figures"][peer])
        elif "void" in theirs:
            entry["why"].append(theirs["void"])
    for entry in found.values():
        for key in FIGURES if entry["rows"] else ():
            values = [r[key] for r in entry["rows"]]
            entry[key] = {"mean": geometric_mean(values), "least": min(values)}
    return found


def geometric_mean(values: Sequence[float]) -> float:
    """Of positive numbers."""
    return math.exp(sum(map(math.log, values)) / len(values))
