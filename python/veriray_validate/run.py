"""Runs cases: on which devices, in which processes, at what overall false-alarm rate."""

from __future__ import annotations

import contextlib
import fnmatch
import hashlib
import importlib
import os
import pkgutil
import platform
import subprocess
import time
from collections.abc import Callable, Iterable, Sequence
from dataclasses import asdict, dataclass, field
from pathlib import Path
from typing import Any

from scipy import stats

from veriray import __version__
from veriray import device as device_module
from veriray_validate import pool
from veriray_validate.levels import LEVELS
from veriray_validate.trial import CASES, FAMILY, FIRST, MANY, SECOND, Case, Outcome, judge

FULL_EFFORT = 4
MAX_WORKERS = 64
#: Of everything random where none is given: another one for each version, so that no release was
#: tuned to its own.
SEED = int.from_bytes(hashlib.sha256(__version__.encode()).digest()[:3], "big")


def cases(levels: Iterable[int] | None = None, *, full: bool = False,
          pattern: str = "*") -> list[Case]:  # fmt: skip
    """The cases of some levels (default: all), the quick ones or all; `pattern`: of ids."""
    from veriray_validate import levels as modules

    for module in pkgutil.walk_packages(modules.__path__, f"{modules.__name__}."):
        importlib.import_module(module.name)
    wanted = set(LEVELS if levels is None else levels)
    return [
        c for c in sorted(CASES.values(), key=lambda c: c.level)
        if c.level in wanted and (full or c.quick)
        and (pattern == c.id or fnmatch.fnmatchcase(c.id, pattern))
    ]  # fmt: skip


def fast_devices() -> list[str]:
    """The fastest CPU device and every GPU: enough, since level 6 proves the others equal."""
    names = [d.name for d in device_module.devices()]
    cpu = [n for n in names if n.startswith("cpu")]
    return cpu[:1] + [n for n in names if n.startswith("cuda")]


@dataclass
class Validation:
    """Outcome of a run; as a string its levels and the verdict.

    false_alarm: bound on the probability that a sound program fails. seconds: elapsed. facts: about
    machine and run; among them commit: that of the checkout, ending in -dirty if files differ from
    it, or None without one. missing: what a stopped run did not judge, in the order of the run.
    """

    full: bool
    seed: int
    devices: dict[str, str]
    false_alarm: float
    outcomes: list[Outcome] = field(default_factory=list)
    seconds: float = 0.0
    facts: dict[str, Any] = field(default_factory=dict)
    missing: list[str] = field(default_factory=list)

    @property
    def passed(self) -> bool:
        """No failure, error, inconclusive or missing case, something ran, and not `crowded`."""
        verdicts = {o.verdict for o in self.outcomes}
        clean = "pass" in verdicts and verdicts <= {"pass", "skip"}
        return clean and not self.crowded and not self.missing

    def first_stage(self) -> dict[str, Any]:
        """Cases with p < FIRST in the first stage (low), of how many (of), and p of that many.

        Exact binomial, one-sided. A case counts once, on the first of its devices: all devices give
        the same bits and so the same p values.
        """
        p = {o.id: o.p for o in reversed(self.outcomes) if o.p is not None}
        low = sum(q < FIRST for q in p.values())
        return {"low": low, "of": len(p), "p": float(stats.binom.sf(low - 1, len(p), FIRST))}

    @property
    def crowded(self) -> bool:
        """Whether more first-stage p values are below FIRST than chance can explain."""
        return bool(self.first_stage()["p"] < MANY)

    def __str__(self) -> str:
        from veriray_validate import report

        return report.as_text(self)

    def __repr__(self) -> str:
        from veriray_validate import report

        cases = f"{len(self.outcomes)} cases on {', '.join(self.devices)}"
        return f"<Validation {report.verdict(self)[0]}: {cases}>"

    def _repr_html_(self) -> str:
        """The verdict and a row for each level, for notebooks."""
        from veriray_validate import report

        return report.as_table(self)

    def save(self, path: str | os.PathLike[str]) -> None:
        """Writes the report (.html) or the numbers (.json); see `report.save`."""
        from veriray_validate import report

        report.save(self, path)

    def levels(self) -> list[dict[str, Any]]:
        """One row per level: number, name, cases, verdict, sees (smallest, largest), seconds ..."""
        rows = []
        for level, (name, _) in LEVELS.items():
            own = [o for o in self.outcomes if o.level == level]
            if not own:
                continue
            seen = [o.sees for o in own if o.sees is not None]
            counts = {v: sum(o.verdict == v for o in own)
                      for v in ("pass", "fail", "error", "inconclusive", "skip")}  # fmt: skip
            bad = counts["fail"] + counts["error"]
            verdict = "fail" if bad else "inconclusive" if counts["inconclusive"] else "pass"
            rows.append({
                "level": level, "name": name, "cases": len(own), **counts,
                "verdict": verdict if counts["pass"] or verdict != "pass" else "skip",
                "checks": sum(o.checks for o in own), "tests": sum(o.tests for o in own),
                "first_stage": sum(o.p is not None and o.p < FIRST for o in own),
                "sees": [min(seen), max(seen)] if seen else None,
                "samples": sum(o.samples for o in own), "seconds": sum(o.seconds for o in own),
            })  # fmt: skip
        return rows

    def to_dict(self) -> dict[str, Any]:
        """Everything, as plain numbers, strings, lists and dictionaries."""
        return {
            "veriray": __version__, "passed": self.passed, "full": self.full, "seed": self.seed,
            "devices": self.devices, "false_alarm": self.false_alarm, "seconds": self.seconds,
            "first_stage": self.first_stage(), "facts": self.facts, "missing": self.missing,
            "levels": self.levels(), "cases": [asdict(o) for o in self.outcomes],
        }  # fmt: skip


class Stopped(KeyboardInterrupt):
    """Ctrl-C during `validate`; validation: what was judged until then, the rest as `missing`."""

    def __init__(self, validation: Validation) -> None:
        super().__init__(f"{len(validation.missing)} cases were not judged")
        self.validation = validation


def validate(
    devices: Sequence[str] | None = None,
    *,
    levels: Iterable[int] | None = None,
    full: bool = False,
    pattern: str = "*",
    seed: int | None = None,
    workers: int | None = None,
    effort: int | None = None,
    progress: Callable[[Outcome, int, int], object] | None = None,
) -> Validation:
    """Runs the validation suite on this machine.

    Args:
        devices: names as for `veriray.render`; None: the fastest CPU device and every GPU.
        levels: numbers of LEVELS; None: all. pattern: of case ids, as in a shell.
        full: all cases with four times the samples, not the quick ones alone.
        seed: of everything random; the run is a function of it. None: SEED, that of the version.
        workers: number of processes; 0 runs in this one; None takes one per processor, at most 64.
            A GPU serves one at a time, or all if CUDA's Multi-Process Service runs.
        effort: factor on the samples instead of 1 (quick) or 4 (full).
        progress: called after each case with its outcome, cases done and cases in all.

    Returns:
        The validation with every outcome, in the order of the cases.

    Raises:
        ValueError: no case fits. DeviceError: a device that cannot be used. Stopped: Ctrl-C.
    """
    names = [device_module.select(d)[0].name for d in devices] if devices else fast_devices()
    seed = SEED if seed is None else seed
    chosen = cases(levels, full=full, pattern=pattern)
    if not chosen:
        raise ValueError(f"no case fits levels {levels!r}, pattern {pattern!r}")
    jobs = [(c.id, d) for c in chosen for d in (names[:1] if c.once else names)]
    # each case fails a sound program with probability FIRST x second
    second = min(SECOND, FAMILY / FIRST / (2 * len(jobs)))
    effort = effort or (FULL_EFFORT if full else 1)
    about = {d.name: d.description for d in device_module.devices()}
    result = Validation(full, seed, {n: about[n] for n in names}, len(jobs) * FIRST * second + MANY)
    result.facts = {
        "commit": _commit(),
        "system": platform.platform(terse=True), "machine": platform.machine(),
        "python": platform.python_version(), "cpus": os.cpu_count(), "effort": effort,
        "first": FIRST, "second": second,
        "time": time.strftime("%Y-%m-%dT%H:%M:%SZ", time.gmtime()),
    }  # fmt: skip
    begin = time.perf_counter()
    done: dict[tuple[str, str], Outcome] = {}

    def add(job: tuple[str, str], outcome: Outcome) -> None:
        done[job] = outcome
        if progress:
            progress(outcome, len(done), len(jobs))

    if workers is None:
        workers = min(len(os.sched_getaffinity(0)), MAX_WORKERS)
    order = jobs if workers < 1 else _longest_first(jobs)
    try:
        if workers < 1:
            for job in order:
                add(job, _work(*job, seed, effort, second, None))
        else:
            threads = [workers if _has_processes(name) else 1 for name, _ in order]
            work = [(*job, seed, effort, second, n) for job, n in zip(order, threads, strict=True)]
            holds = [None if _has_processes(name) else held_by(device) for name, device in order]
            with contextlib.closing(pool.results(_work, work, workers, holds)) as answers:
                for k, answer in answers:
                    if isinstance(answer, pool.Died):
                        c = CASES[order[k][0]]
                        answer = Outcome(c.id, c.level, c.title, order[k][1], "error", str(answer))
                    add(order[k], answer)
    except KeyboardInterrupt:
        result.missing = [" on ".join(job) for job in order if job not in done]
    result.outcomes = [done[job] for job in jobs if job in done]
    result.seconds = time.perf_counter() - begin
    if result.missing:
        raise Stopped(result)
    return result


def _has_processes(name: str) -> bool:
    """Whether a case is itself a run of the suite on CPUs, in many processes: planted bugs."""
    return CASES[name].level == 9


def _longest_first(jobs: Iterable[tuple[str, str]]) -> list[tuple[str, str]]:
    """Planted bugs, then what belongs to the full run only: at the end they would run alone."""
    return sorted(jobs, key=lambda job: (not _has_processes(job[0]), CASES[job[0]].quick))


def held_by(device: str) -> str | None:
    """What a case on the device has to itself: the GPU, unless CUDA's Multi-Process Service runs.

    Processes on one GPU take turns: eight on an H200 needed over thirty times as long as one.
    """
    folder = os.environ.get("CUDA_MPS_PIPE_DIRECTORY", "/tmp/nvidia-mps")
    return device if device.startswith("cuda") and not Path(folder, "control").exists() else None


def _commit() -> str | None:
    """Commit of the checkout that this file belongs to."""
    root = Path(__file__).resolve().parents[2]
    if not (root / ".git").exists():
        return None
    words = ["git", "describe", "--always", "--dirty", "--abbrev=40", "--exclude=*"]
    try:
        done = subprocess.run(words, cwd=root, capture_output=True, text=True, timeout=10)
    except (OSError, subprocess.TimeoutExpired):
        return None
    return done.stdout.strip() if done.returncode == 0 else None


def _work(name: str, device: str, seed: int, effort: int, second: float,
          threads: int | None) -> Outcome:  # fmt: skip
    """One job, in any process."""
    if name not in CASES:
        cases()
    return judge(CASES[name], device, seed=seed, effort=effort, threads=threads, second=second)
