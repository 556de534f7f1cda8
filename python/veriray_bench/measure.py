"""What every measurement stands on: the machine, meters, agreement and error of pictures."""

from __future__ import annotations

import math
import os
import platform
import statistics
import subprocess
import time
from collections.abc import Iterable, Sequence
from importlib import metadata
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

from veriray import __version__
from veriray.device import survey

Array = npt.NDArray[Any]
RELMSE = "relMSE = mean (I-R)^2/(R^2 + 0.01), MSE = mean (I-R)^2, less the reference's own variance"


class BenchError(RuntimeError):
    """A measurement that cannot be made: a renderer is missing or failed, files do not fit."""


# ---- where and what ----


def machine() -> dict[str, Any]:
    """Processor, cores, memory and devices; nothing that names this particular machine."""
    info = {"processor": platform.machine(), "system": platform.system(), "cpus": cpu_count()}
    cpuinfo, meminfo = Path("/proc/cpuinfo"), Path("/proc/meminfo")
    if cpuinfo.exists():
        keys = {"model name": "model_name", "cpu family": "family", "model": "model"}
        for line in cpuinfo.read_text(errors="replace").split("\n\n")[0].splitlines():
            key, _, value = (part.strip() for part in line.partition(":"))
            if key in keys:
                info[keys[key]] = value
    if meminfo.exists():
        info["memory_gib"] = round(int(meminfo.read_text("utf-8").split()[1]) / 2**20, 1)
    usable, reasons = survey()
    info["devices"] = {d.name: d.description for d in usable}
    info["not_usable"] = reasons
    return info


def cpu_count() -> int:
    """Processors that this process may use."""
    return len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1


def commit(root: Path) -> dict[str, Any]:
    """Commit of the checkout `root`, and whether tracked files differ; None where unknown."""

    def git(*words: str) -> str | None:
        try:
            done = subprocess.run(["git", *words], cwd=root, capture_output=True, text=True)
        except OSError:
            return None
        return done.stdout.strip() if done.returncode == 0 else None

    if not (root / "python" / "veriray_bench").is_dir():
        return {"commit": None, "modified": None}
    status = git("status", "--porcelain", "--untracked-files=no")
    return {
        "commit": git("rev-parse", "HEAD"),
        "modified": None if status is None else bool(status),
    }


def versions(*packages: str) -> dict[str, str | None]:
    """Versions of Python, veriray and further packages."""
    found: dict[str, str | None] = {"python": platform.python_version(), "veriray": __version__}
    for name in ("numpy", *packages):
        try:
            found[name] = metadata.version(name)
        except metadata.PackageNotFoundError:
            found[name] = None
    return found


def header(benchmark: str, *packages: str, root: Path) -> dict[str, Any]:
    """What every result begins with; root: the checkout whose commit is stated, if it is one."""
    return {
        "benchmark": benchmark,
        "time": now(),
        **commit(root),
        "versions": versions(*packages),
        "machine": machine(),
    }


def now() -> str:
    """The time, UTC."""
    return time.strftime("%Y-%m-%dT%H:%M:%SZ", time.gmtime())


# ---- meters ----


def _busy() -> float:
    """CPU seconds of all processes since boot, idle, waiting and stolen time left out (Linux)."""
    with open("/proc/stat") as file:
        ticks = [int(word) for word in file.readline().split()[1:9]]
    return (sum(ticks) - ticks[3] - ticks[4] - ticks[7]) / os.sysconf("SC_CLK_TCK")


class Meter:
    """Wall seconds, own CPU seconds and cores used by others over a `with` block.

    `foreign` is None where the system does not tell.
    """

    wall: float
    cpu: float
    foreign: float | None

    def __enter__(self) -> Meter:
        self._busy = _busy() if Path("/proc/stat").exists() else None
        self._cpu, self._wall = time.process_time(), time.perf_counter()
        return self

    def __exit__(self, *_: object) -> None:
        self.wall = time.perf_counter() - self._wall
        self.cpu = time.process_time() - self._cpu
        self.foreign = None
        if self._busy is not None:
            others = _busy() - self._busy - self.cpu
            self.foreign = max(0.0, others / max(self.wall, 1e-9))

    def row(self) -> dict[str, float | None]:
        """The three numbers."""
        foreign = None if self.foreign is None else round(self.foreign, 3)
        return {"wall": self.wall, "cpu": self.cpu, "foreign": foreign}


def wait_quiet(limit: float, level: float = 0.1) -> float | None:
    """Wait at most `limit` seconds until others use less than `level` cores; what they use."""
    start = time.perf_counter()
    while True:
        with Meter() as m:
            time.sleep(2 if limit > 0 else 0.2)
        if m.foreign is None or m.foreign < level or time.perf_counter() - start > limit:
            return m.foreign


def median(rows: Sequence[dict[str, Any]], key: str) -> float:
    """Median of one column."""
    return float(statistics.median(row[key] for row in rows))


def spread(values: Iterable[float]) -> float:
    """Largest less smallest value, over the median."""
    v = list(values)
    return (max(v) - min(v)) / statistics.median(v)


# ---- agreement and error ----


def mean(image: Array) -> Array:
    """(3,) float64, mean of a picture (H, W, 3)."""
    return np.asarray(image.mean(axis=(0, 1), dtype=np.float64))


def mean_error(stderr: Array) -> Array:
    """(3,) float64, standard error of the mean of a picture with these errors (H, W, 3)."""
    return np.sqrt((stderr.astype(np.float64) ** 2).sum(axis=(0, 1))) / (stderr.size / 3)


def means_agree(
    ours: Any, peer: Any, noise: Array, margin: float = 1e-5, limit: float = 4.0
) -> dict[str, Any]:
    """Do the means of two renderers agree, per channel?

    ours, peer: (3,), means of their pictures; noise: (3,), standard error of the difference.
    Agreement is |z| < limit per channel, a relative margin taken off: false once in 5,000 at 4.
    """
    a, b = np.asarray(ours, np.float64), np.asarray(peer, np.float64)
    far = np.maximum(np.abs(a - b) - margin * np.abs(b), 0)
    with np.errstate(divide="ignore", invalid="ignore"):
        z = np.sign(a - b) * np.where(far == 0, 0, far / noise)
        return {
            "mean_ours": a.tolist(),
            "mean_peer": b.tolist(),
            "relative_difference": (a / b - 1).tolist(),
            "relative_standard_error": (noise / b).tolist(),
            "margin": margin,
            "limit": limit,
            "z": z.tolist(),
            "agree": bool((np.abs(z) < limit).all()),
        }


def errors(image: Array, reference: Array, stderr: Array) -> dict[str, float]:
    """MSE and relMSE as RELMSE has them; stderr: (H, W, 3), the reference's standard errors.

    Unbiased where the reference's samples are independent of the image's, so it may be below zero
    at the reference's own accuracy.
    """
    r = reference.astype(np.float64)
    d = (image - r) ** 2 - stderr.astype(np.float64) ** 2
    return {"mse": float(np.mean(d)), "relmse": float(np.mean(d / (r**2 + 0.01)))}


def slope(x: Sequence[float], y: Sequence[float]) -> tuple[float | None, float | None]:
    """Slope of log y against log x by least squares, and its standard error by the scatter.

    Pairs that are not positive are left out; None below two different x, for the error below three
    pairs.
    """
    pairs = [(math.log(a), math.log(b)) for a, b in zip(x, y, strict=True) if a > 0 and b > 0]
    if len({a for a, _ in pairs}) < 2:
        return None, None
    u, v = np.array(pairs).T
    line = np.polyfit(u, v, 1)
    if len(pairs) < 3:
        return float(line[0]), None
    left = float(((v - np.polyval(line, u)) ** 2).sum()) / (len(pairs) - 2)
    return float(line[0]), math.sqrt(left / float(((u - u.mean()) ** 2).sum()))


def at_error(
    seconds: Sequence[float], error: Sequence[float], target: float
) -> tuple[float | None, bool]:
    """Seconds at which the error is `target`, linear in logarithms, and whether extrapolated.

    The two neighbours of the target are taken, outside the range the nearest two. None where the
    error does not fall there.
    """
    pairs = [(math.log(s), math.log(e)) for s, e in zip(seconds, error, strict=True) if e > 0]
    if len(pairs) < 2:
        return None, False
    goal = math.log(target)
    first = next((k for k in range(len(pairs) - 1) if pairs[k + 1][1] <= goal), len(pairs) - 2)
    (s0, e0), (s1, e1) = pairs[first : first + 2]
    if e1 >= e0:
        return None, False
    return math.exp(s0 + (goal - e0) / (e1 - e0) * (s1 - s0)), not e1 <= goal <= e0
