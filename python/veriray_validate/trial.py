"""Cases and their judgement.

A case is a function of a `Trial`. It renders through the trial, states exact conditions with
`check` and statistical ones as p values, and says which bias it would have seen. The judgement has
two stages. If the smallest p value (corrected by Sidak over those of the case) is below `FIRST`,
the case is run once more with four times the samples and a fresh seed, and fails only if p is then
below `SECOND`. A sound program fails a case once in 1 / (FIRST x SECOND) = 1e7 runs; the power is
that of the first stage. Exact conditions fail at once.
"""

from __future__ import annotations

import itertools
import time
import traceback
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np
import numpy.typing as npt
from scipy import stats

from veriray import device as device_module
from veriray.comparison.ledgers import ledger_problems
from veriray.comparison.statistics import MARGIN
from veriray.native_scene import native_scene_arguments
from veriray.rendering import Render, render
from veriray.scene import Scene
from veriray.units import GROUP
from veriray_validate.statistics import error_of_sum, max_z, sidak, smallest_bias

Array = npt.NDArray[Any]

FIRST, SECOND = 1e-3, 1e-4
#: The whole run of a sound program fails less often than FAMILY: FAMILY / 2 by its cases, and MANY
#: by their number with p < FIRST in the first stage.
FAMILY, MANY = 1e-3, 1e-4
CONFIRM = 4  # times the samples
#: Equal parts of a render whose means tell the error of a picture whose pixels share samples.
BATCHES = 20
#: Samples that must carry a mean for the normal law: (sum x)^2 / sum x^2.
EFFECTIVE = 1000
#: Share of segments that may pass an edge on its wrong side because a path's vertex lies within
#: rounding of the neighbour's plane; measured 3e-8 in rooms of flat walls, 1e-8 in a mesh.
LEAKS = 1e-7
#: Rows of arguments that a function of the core gets at once: they stay in a core's cache.
ROWS = 1 << 13


class Failed(Exception):  # noqa: N818
    """An exact condition does not hold."""


class Inconclusive(Exception):  # noqa: N818
    """Too little data for a judgement; never a pass."""


class Skipped(Exception):  # noqa: N818
    """The case cannot run here; the text says why."""


@dataclass(frozen=True)
class Case:
    """One question with its answer.

    id: module.function[arguments], or package.function[arguments] where a module of the levels has
    become a package; title: first line of the function's docstring; expects: the rest of it. quick:
    part of the quick run. once: runs once per machine, not once per device. stored: compares with
    stored data, whose noise both stages share.
    """

    id: str
    level: int
    title: str
    expects: str
    function: Callable[..., None]
    arguments: Mapping[str, Any]
    quick: bool
    once: bool
    stored: bool


@dataclass(frozen=True)
class Outcome:
    """The outcome of a case on a device.

    verdict: "pass", "fail", "inconclusive", "error" or "skip". p: smallest p value of the first
    stage, corrected for their number; confirmed: that of the second stage, if there was one.
    checks, tests: numbers of exact conditions and of p values. sees: smallest relative bias that
    the case finds with 90 % power, or None if that has no meaning. figures: numbers for the report.
    seeded: it drew random numbers; other cases give the same answer with every seed.
    """

    id: str
    level: int
    title: str
    device: str
    verdict: str
    message: str = ""
    p: float | None = None
    confirmed: float | None = None
    checks: int = 0
    tests: int = 0
    sees: float | None = None
    samples: int = 0
    seconds: float = 0.0
    figures: dict[str, Any] = field(default_factory=dict)
    seeded: bool = True


CASES: dict[str, Case] = {}


def case(
    level: int,
    *,
    each: Mapping[str, Iterable[Any]] | None = None,
    quick: bool | Callable[..., bool] = True,
    once: bool = False,
    stored: bool = False,
) -> Callable[[Callable[..., None]], Callable[..., None]]:
    """Registers the decorated function as a case, or as one for each combination of `each`.

    each: argument name -> values; a mapping gives its keys. quick: whether the quick run has it,
    or a function of the arguments. once, stored: see `Case`.
    """

    def register(function: Callable[..., None]) -> Callable[..., None]:
        title, _, expects = (function.__doc__ or "").strip().partition("\n")
        _, ours, module = function.__module__.rpartition("veriray_validate.levels.")
        parts = module.split(".")
        name = f"{parts[0] if ours else parts[-1]}.{function.__name__}"
        names, values = list(each or {}), [list(v) for v in (each or {}).values()]
        for combination in itertools.product(*values):
            arguments = dict(zip(names, combination, strict=True))
            label = f"[{','.join(map(str, combination))}]" if names else ""
            wanted = quick(**arguments) if callable(quick) else quick
            if name + label in CASES:
                raise ValueError(f"case {name + label} exists twice")
            CASES[name + label] = Case(
                name + label, level, title, " ".join(expects.split()), function, arguments, wanted,
                once, stored,
            )  # fmt: skip
        return function

    return register


class Trial:
    """One run of a case: its device, seed and effort, and what it has found so far.

    device: name for `veriray.render`; effort: factor on the samples.
    """

    def __init__(self, device: str, seed: int = 1, effort: int = 1, threads: int | None = None):
        self.device, self.effort, self.threads = device, effort, threads
        self.seeded = False
        self._seed, self._rng = seed, np.random.default_rng([seed, 0x7E57])
        self.p_values: list[tuple[float, str]] = []
        self.checks = self.samples = 0
        self.smallest: float | None = None
        self.figures: dict[str, Any] = {}
        self._seeds = np.random.default_rng([seed, 0x5EED])

    # ---- devices ----

    @property
    def devices(self) -> list[str]:
        """All usable devices of this machine."""
        return [d.name for d in device_module.devices()]

    @property
    def _chosen(self) -> device_module.Device:
        return device_module.select(self.device, fresh=False)[0]

    @property
    def native(self) -> Any:
        """The native module of the device."""
        return self._chosen.native

    def native_scene(self, scene: Scene, builder: str | None = None) -> Any:
        """The scene as the native module holds it; by default with a tree by `ploc` on CUDA.

        Renders use `sah` for meshes as small as those of most cases, so both are tested.
        """
        return self.native.Scene(
            **native_scene_arguments(scene), device=self._chosen.index,
            builder=builder or ("ploc" if self._chosen.backend == "cuda" else "sah"),
        )  # fmt: skip

    def native_film(self, width: int, height: int) -> Any:
        """An empty film of the device."""
        return self.native.Film(width, height, device=self._chosen.index)

    def function(self, name: str, *columns: Any) -> Array:
        """A function of the core, by its name in backends/hooks.h, over columns; (n, k) float64."""
        values = [np.asarray(c) for c in columns]
        (n,) = np.broadcast_shapes((1,), *(v.shape for v in values))
        same = np.array([v.item() if v.size == 1 else 0 for v in values], np.float32)
        many = [c for c, v in enumerate(values) if v.size != 1]
        evaluate, parts = self.native.eval_function, []
        for begin in range(0, max(n, 1), ROWS):
            rows = np.empty((min(ROWS, n - begin), len(values)), np.float32)
            rows[:] = same
            for c in many:
                rows[:, c] = values[c][begin : begin + ROWS]
            parts.append(evaluate(name, rows))
        return np.concatenate(parts, dtype=np.float64)

    # ---- seeds ----

    @property
    def seed(self) -> int:
        """The seed from which all random numbers of the trial derive."""
        self.seeded = True
        return self._seed

    @property
    def rng(self) -> np.random.Generator:
        """NumPy's generator, for inputs."""
        self.seeded = True
        return self._rng

    def fresh(self) -> int:
        """A new seed for a render or a table of random numbers."""
        self.seeded = True
        return int(self._seeds.integers(2**63))

    # ---- judgements ----

    def check(self, condition: Any, what: str = "") -> None:
        """An exact condition; arrays must hold everywhere."""
        self.checks += 1
        if not np.all(condition):
            raise Failed(what or "a condition does not hold")

    def raises(self, kind: type[BaseException] | tuple[type[BaseException], ...],
               call: Callable[[], object], *words: str) -> None:  # fmt: skip
        """`call` must raise `kind` with all words in its text."""
        self.checks += 1
        try:
            call()
        except kind as error:
            if missing := [w for w in words if w not in str(error)]:
                raise Failed(f"{type(error).__name__}: {error}; without {missing}") from None
            return
        raise Failed(f"no {kind} raised")

    def p(self, value: float, what: str = "") -> None:
        """A p value; all of a case's are judged together."""
        if np.isnan(value):
            raise Failed(f"{what}: p is not a number")
        self.p_values.append((float(value), what))

    def sees(self, bias: float, limit: float | None = None) -> None:
        """The relative bias that would have been seen; inconclusive if it is above `limit`."""
        if limit is not None and not bias <= limit:
            raise Inconclusive(f"sees {bias:.2g}, wanted {limit:.2g}")
        self.smallest = max(bias, self.smallest or 0.0)

    def figure(self, name: str, value: Any) -> None:
        """Keeps a number, list or array for the report."""
        self.figures[name] = value.tolist() if isinstance(value, np.ndarray) else value

    # ---- renders ----

    def render(self, scene: Scene, spp: int, **settings: Any) -> Render:
        """`veriray.render` on the trial's device, spp times effort, a fresh seed unless given.

        Samples are independent where batches would cut the groups that sobol draws, because tests
        take batches for independent. Checks that no sample is non-finite and that the ledger adds
        up.
        """
        settings = {"device": self.device, "threads": self.threads, **settings}
        settings.setdefault("seed", self.fresh())
        spp *= self.effort
        batches = settings.get("batches", 0)
        if batches and spp % (GROUP * batches):
            settings.setdefault("sampler", "independent")
        result = render(scene, spp=spp, **settings)
        paths = result.width * result.height * result.spp
        if result.samples is not None:
            pilot = result.stats["pilot_spp"] * result.samples.size
            paths = pilot + int(result.samples.sum(dtype=np.int64))
        self.samples += paths
        self.check(result.stats["nonfinite_samples"] == 0, "non-finite samples")
        problems = ledger_problems(result.stats["ledger"], paths)
        self.check(not problems, "ledger: " + "; ".join(problems))
        return result

    def rare(self, count: int, r: Render, what: str) -> None:
        """Checks that `LEAKS` explains `count` events in a render; false-alarm rate 1e-9."""
        segments = sum(r.stats["live_rays"])
        most = stats.poisson.isf(1e-9, LEAKS * segments)
        self.check(count <= most, f"{count} of {segments} segments: {what}")

    def sealed(self, r: Render, room: str = "a closed room") -> None:
        """Checks that nothing leaves a closed room except what `LEAKS` allows."""
        self.rare(sum(r.stats["ledger"]["escaped"]), r, f"left {room}")

    def leaks(self, r: Render) -> Array:
        """Paths that left a closed furnace of flat walls, by depth; no more than `LEAKS` allows.

        They escape, or meet the back of a wall from outside and are absorbed.
        """
        ledger = r.stats["ledger"]
        lost = np.array(ledger["escaped"]) + np.array(ledger["absorbed"])
        self.rare(int(lost.sum()), r, "left a closed room")
        self.rare(sum(ledger["shadow_occluded"]), r, "walls of a box hide each other")
        return lost

    def agrees(self, scene: Scene, exact: float | Sequence[float] | Array, spp: int, sees: float,
               margin: float = MARGIN, **settings: Any) -> Render:  # fmt: skip
        """Compares a render's pixels with `exact` (broadcast to the picture); returns the render.

        The statistics are the largest |z| over pixels and channels, and over the channels of the
        picture's mean, with Sidak's correction; pixels without noise must be within the margin.
        sees: relative bias of the mean that must be found with 90 % power. Pixels under other
        filters than the box share samples, so the error of the mean of several is that of
        BATCHES means of equal parts of spp, which is rounded up to a multiple.
        """
        shared = scene.film.filter != "box" and scene.film.width * scene.film.height > 1
        if shared:
            whole = BATCHES * (1 if spp < BATCHES * GROUP else GROUP)
            spp, settings = whole * -(-spp // whole), {**settings, "batches": BATCHES}
        r = self.render(scene, spp, **settings)
        truth = np.broadcast_to(np.asarray(exact, np.float64), r.image.shape)
        mean, error = r.image.astype(np.float64), r.stderr.astype(np.float64)
        total, law = error_of_sum(r)
        off = np.sign(mean - truth) * np.maximum(np.abs(mean - truth) - margin * truth, 0)
        still = error == 0
        self.check(off[still] == 0, f"{mean[still].ravel()[:3]} for {truth[still].ravel()[:3]}")
        if not still.all():
            m, e = mean[~still], error[~still]
            n: Any = r.spp if r.samples is None else r.samples[..., None].astype(np.float64)
            n = np.broadcast_to(n, mean.shape)[~still]
            carried = n * m**2 / np.maximum(e**2 * (n - 1) + m**2, 1e-300)
            if mean.any() and carried.min() < EFFECTIVE:
                raise Inconclusive(f"{carried.min():.0f} samples carry a pixel: raise spp")
            z = off[~still] / e
            # channels that share their noise count once
            self.p(sidak(max_z(z[np.abs(z).argmax()]), len(np.unique(z))), "pixels")
            if r.width * r.height > 1:
                self.p(max_z(off.sum(axis=(0, 1))[total > 0] / total[total > 0], law), "picture")
            self.figures.setdefault("z", []).extend(z.ravel()[:192].tolist())
        if truth.mean() > 0:
            spread = float(np.sqrt((total**2).mean())) / (r.width * r.height)
            self.sees(smallest_bias(spread, float(truth.mean()), law=law) + margin, sees)
        return r


def _attempt(
    case: Case, device: str, seed: int, effort: int, threads: int | None
) -> tuple[Outcome, bool]:
    trial = Trial(device, seed, effort, threads)
    begin, verdict, message = time.perf_counter(), "pass", ""
    try:
        case.function(trial, **case.arguments)
    except Failed as error:
        verdict, message = "fail", str(error)
    except Inconclusive as error:
        verdict, message = "inconclusive", str(error)
    except Skipped as error:
        verdict, message = "skip", str(error)
    except Exception as error:
        verdict = "error"
        message = f"{type(error).__name__}: {error}\n{traceback.format_exc(limit=-4)}"
    p, where = min(trial.p_values, default=(None, ""))
    if p is not None:
        p = sidak(p, len(trial.p_values))
    if verdict == "pass" and not trial.checks and not trial.p_values:
        verdict, message = "inconclusive", "the case tests nothing"
    return Outcome(
        case.id, case.level, case.title, device, verdict, message or where, p, None, trial.checks,
        len(trial.p_values), trial.smallest, trial.samples, time.perf_counter() - begin,
        trial.figures, trial.seeded,
    ), verdict == "pass" and p is not None  # fmt: skip


def judge(
    case: Case, device: str, *, seed: int = 1, effort: int = 1, threads: int | None = None,
    second: float = SECOND,
) -> Outcome:  # fmt: skip
    """Runs a case on a device and judges it in two stages. `second`: threshold of the second.

    If the stages share a stored reference's noise, the second alone keeps the rate.
    """
    second *= FIRST if case.stored else 1
    key = [seed, *case.id.encode()]
    first_seed, second_seed = (
        int(np.random.default_rng([*key, stage]).integers(2**63)) for stage in (1, 2)
    )
    first, statistical = _attempt(case, device, first_seed, effort, threads)
    if not statistical or first.p is None or first.p >= FIRST:
        return replace(first, message="" if first.verdict == "pass" else first.message)
    again, statistical = _attempt(case, device, second_seed, effort * CONFIRM, threads)
    verdict = again.verdict
    if statistical and again.p is not None and again.p < second:
        verdict = "fail"
    return replace(
        first, verdict=verdict, confirmed=again.p, seconds=first.seconds + again.seconds,
        samples=first.samples + again.samples,
        message=f"{again.message or first.message}: p = {first.p:.2g}, then {again.p:.2g}"
        if again.p is not None else again.message,
    )  # fmt: skip
