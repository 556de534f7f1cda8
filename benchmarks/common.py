"""Shared by the benchmark scripts: machine, versions, meters, contestants, meshes, result files."""

from __future__ import annotations

import argparse
import json
import math
import os
import platform
import statistics
import subprocess
import time
from collections.abc import Iterable
from importlib import metadata
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

import veriray
from veriray import device as _device

ROOT = Path(__file__).resolve().parents[1]
RESULTS = ROOT / "benchmarks" / "results"
MITSUBA_BOX = ROOT / "scenes" / "cornell" / "cornell_box_mitsuba.xml"
NO_ROULETTE = 1000  # rr_depth beyond every max_depth used here

Array = npt.NDArray[Any]


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
    usable, reasons = _device.survey()
    info["devices"] = {d.name: d.description for d in usable}
    info["not_usable"] = reasons
    return info


def cpu_count() -> int:
    """Processors that this process may use."""
    return len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1


def commit() -> dict[str, Any]:
    """Commit of the checkout and whether tracked files differ from it; None where unknown."""

    def git(*words: str) -> str | None:
        try:
            done = subprocess.run(["git", *words], cwd=ROOT, capture_output=True, text=True)
        except OSError:
            return None
        return done.stdout.strip() if done.returncode == 0 else None

    status = git("status", "--porcelain", "--untracked-files=no")
    return {
        "commit": git("rev-parse", "HEAD"),
        "modified": None if status is None else bool(status),
    }


def versions(*packages: str) -> dict[str, str | None]:
    """Versions of Python, veriray and further packages."""
    found: dict[str, str | None] = {
        "python": platform.python_version(),
        "veriray": veriray.__version__,
    }
    for name in ("numpy", *packages):
        try:
            found[name] = metadata.version(name)
        except metadata.PackageNotFoundError:
            found[name] = None
    return found


def header(benchmark: str, *packages: str) -> dict[str, Any]:
    """What every result begins with."""
    now = time.strftime("%Y-%m-%dT%H:%M:%SZ", time.gmtime())
    return {
        "benchmark": benchmark,
        "time": now,
        **commit(),
        "versions": versions(*packages),
        "machine": machine(),
    }


def write(result: dict[str, Any], path: Path) -> None:
    """Write a result as JSON."""
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_text(json.dumps(result, indent=1) + "\n")
    print(f"written: {path.name}")


def parser(text: str | None, name: str) -> argparse.ArgumentParser:
    """Argument parser with the options that all scripts share."""
    summary = (text or "").splitlines()[0]
    p = argparse.ArgumentParser(description=summary)
    p.add_argument("-o", "--output", type=Path, default=RESULTS / name, help="JSON file")
    return p


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


def median(rows: list[dict[str, Any]], key: str) -> float:
    """Median of one column."""
    return float(statistics.median(row[key] for row in rows))


def spread(values: Iterable[float]) -> float:
    """Largest less smallest value, over the median."""
    v = list(values)
    return (max(v) - min(v)) / statistics.median(v)


# ---- contestants ----


class Ours:
    """Our renderer on one device. `last` is the Render of the last run."""

    last: veriray.Render

    def __init__(self, scene: veriray.Scene, device: str, **settings: Any) -> None:
        self.scene, self.settings = scene, {"device": device, **settings}

    def run(self, spp: int, seed: int) -> tuple[dict[str, Any], Array]:
        """Times and picture of one render.

        seconds: until the film is complete in device memory; wall, cpu, foreign: of the whole call
        with standard errors, copy and hash.
        """
        with Meter() as m:
            self.last = veriray.render(self.scene, spp=spp, seed=seed, **self.settings)
        return {"seconds": self.last.stats["seconds"], **m.row()}, self.last.image


class Mitsuba:
    """Mitsuba's renderer on the same file; mi: the module from mitsuba_peer.start."""

    def __init__(self, mi: Any, path: Path, **settings: Any) -> None:
        import drjit

        self.mi, self.dr = mi, drjit
        self.scene = mi.load_file(str(path), **settings)
        self.dr.sync_thread()

    def run(self, spp: int, seed: int) -> tuple[dict[str, Any], Array]:
        """As `Ours.run`; the whole call ends with the picture in a NumPy array."""
        self.dr.sync_thread()
        with Meter() as m:
            begin = time.perf_counter()
            film = self.mi.render(self.scene, spp=spp, seed=seed)
            self.dr.eval(film)
            self.dr.sync_thread()
            seconds = time.perf_counter() - begin
            image = np.array(film, dtype=np.float32)[..., :3]
        return {"seconds": seconds, **m.row()}, image


# ---- agreement and error ----


def means_agree(
    ours: list[Array], theirs: list[Array], error: Array, margin: float = 1e-5
) -> dict[str, Any]:
    """Do the means over pictures (H, W, 3) of two renderers agree, per channel?

    error: (H, W, 3), standard error of each picture's pixels, taken for both. Agreement is
    |z| < 4 per channel, a relative margin taken off: false once in 5,000.
    """
    a, b = (np.mean([x.mean(axis=(0, 1), dtype=np.float64) for x in p], axis=0)
            for p in (ours, theirs))  # fmt: skip
    one = np.sqrt((error.astype(np.float64) ** 2).sum(axis=(0, 1))) / (error.size / 3)
    noise = one * math.sqrt(1 / len(ours) + 1 / len(theirs))
    z = np.sign(a - b) * np.maximum(np.abs(a - b) - margin * b, 0) / noise
    return {
        "mean_ours": a.tolist(),
        "mean_peer": b.tolist(),
        "relative_difference": (a / b - 1).tolist(),
        "relative_standard_error": (noise / b).tolist(),
        "margin": margin,
        "z": z.tolist(),
        "agree": bool((np.abs(z) < 4).all()),
    }


def errors(image: Array, reference: Array) -> dict[str, float]:
    """MSE = mean (I-R)^2; relMSE = mean (I-R)^2/(R^2 + 0.01), both scaled so that mean R = 1."""
    scale = 1 / reference.mean(dtype=np.float64)
    r = reference.astype(np.float64) * scale
    d = image.astype(np.float64) * scale - r
    return {"mse": float(np.mean(d**2)), "relmse": float(np.mean(d**2 / (r**2 + 0.01)))}


RELMSE = "relMSE = mean (I-R)^2/(R^2 + 0.01), MSE = mean (I-R)^2, after scaling so that mean R = 1"


# ---- meshes: those of veriray.validate.leaks, too ----


def write_ply(path: Path, vertices: Array, triangles: Array) -> None:
    """A binary PLY file with float32 vertices."""
    rows = np.empty(len(triangles), dtype=[("n", "u1"), ("v", "<i4", 3)])
    rows["n"], rows["v"] = 3, triangles
    header = (
        f"ply\nformat binary_little_endian 1.0\nelement vertex {len(vertices)}\n"
        "property float x\nproperty float y\nproperty float z\n"
        f"element face {len(triangles)}\nproperty list uchar int vertex_indices\nend_header\n"
    )
    path.write_bytes(header.encode() + vertices.astype("<f4").tobytes() + rows.tobytes())
