"""Whole processes: from nothing to a saved picture, and peak memory."""

from __future__ import annotations

import json
import os
import statistics
import subprocess
import sys
import time
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from .measure import BenchError, mean, mean_error, means_agree, spread
from .mitsuba import libllvm
from .peers import VARIANTS
from .race import absent, differ
from .scenarios import Scenario, scene_file

if TYPE_CHECKING:
    from .kinds import Bench, Result, Settings

_MITSUBA = """
import sys
import mitsuba
scene, out, variant, spp = sys.argv[1:]
mitsuba.set_variant(variant)
film = mitsuba.render(mitsuba.load_file(scene), spp=int(spp))
mitsuba.util.write_bitmap(out, film, write_async=False)
"""
_MEMORY = """
import json, pathlib, resource, sys
import veriray
scene, spp, size, device = sys.argv[1:]
size = int(size)
r = veriray.render(veriray.load_file(scene), spp=int(spp), width=size, height=size, device=device)
status = pathlib.Path("/proc/self/status")
if status.exists():
    peak = int(status.read_text("utf-8").split("VmHWM:")[1].split()[0]) * 1024
else:
    unit = 1 if sys.platform == "darwin" else 1024
    peak = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss * unit
print(json.dumps({"peak_rss": peak, "scene_and_film": r.stats["memory"],
                  "seconds": r.stats["seconds"], "film_sha256": r.film_sha256}))
"""


def cold(bench: Bench, scenario: Scenario, settings: Settings) -> Result:
    """Processes that load, render and save a picture, from start to exit, alternating.

    Mitsuba's kernels come from its cache on disk after the first run, whose time is kept apart.
    """
    spp, scene = settings["spp"][0], settings["scene"]
    path = scene_file(scene, bench.folder)
    commands = {"veriray": [sys.executable, "-m", "veriray", "render", scene, "--quiet", "--device",
                            bench.device.name, "--spp", str(spp), "-o"]}  # fmt: skip
    rows: dict[str, Result] = {}
    for name, about in bench.crew.about.items():
        if name == "mitsuba" and "missing" not in about:
            variant = VARIANTS[name][bench.device.backend]
            commands[name] = [sys.executable, "-c", _MITSUBA, str(path), "", variant, str(spp)]
        else:
            rows[name] = absent(about.get("missing", "not measured from a cold start"))
    times: dict[str, list[float]] = {name: [] for name in commands}
    step = bench.steps(settings["rounds"] + 1)
    for _ in range(settings["rounds"] + 1):
        for name, words in list(commands.items()):
            try:
                times[name].append(_timed(words, bench.folder / f"cold-{name}.exr"))
            except BenchError as error:
                if name == "veriray":
                    raise
                rows[name] = {"void": str(error)}
                del commands[name]
        step()
    rows = {name: _cold_row(times[name]) for name in commands} | rows
    _same_pictures(bench, scenario, rows)
    figures = {"seconds": rows["veriray"]["seconds"]}
    if "seconds" in rows.get("mitsuba", {}):
        figures["share_of_peer"] = figures["seconds"] / rows["mitsuba"]["seconds"]
    return {"rows": rows, "figures": figures}


def _timed(words: list[str], picture: Path) -> float:
    """Seconds of a process that saves `picture`; "" among its words stands for that path."""
    words = [w or str(picture) for w in words] if "" in words else [*words, str(picture)]
    library = libllvm()
    environment = os.environ | ({"DRJIT_LIBLLVM_PATH": str(library)} if library else {})
    begin = time.perf_counter()
    done = subprocess.run(words, env=environment, capture_output=True, text=True)
    seconds = time.perf_counter() - begin
    if done.returncode:
        said = (done.stderr.strip().splitlines() or ["nothing"])[-1]
        raise BenchError(f"a process ended with status {done.returncode} and said: {said}")
    return seconds


def _cold_row(times: list[float]) -> Result:
    first, *rest = times
    return {"seconds": statistics.median(rest), "first": first, "spread": spread(rest),
            "rounds": rest}  # fmt: skip


def _same_pictures(bench: Bench, scenario: Scenario, rows: dict[str, Result]) -> None:
    """Judge the saved pictures of the last round; void the rows that differ from ours."""
    import OpenEXR

    from veriray.image import load

    ours = load(bench.folder / "cold-veriray.exr")
    noise = mean_error(ours.stderr) * np.sqrt(2)
    for name, row in rows.items():
        if name == "veriray" or "void" in row:
            continue
        channels = OpenEXR.File(str(bench.folder / f"cold-{name}.exr")).channels()
        theirs = np.asarray(channels["RGB"].pixels, np.float32)
        row["agreement"] = means_agree(mean(ours.image), mean(theirs), noise, scenario.margin)
        if not row["agreement"]["agree"]:
            rows[name] = {"void": differ(row["agreement"]), "agreement": row["agreement"],
                          "rounds": row["rounds"]}  # fmt: skip


def memory(bench: Bench, scenario: Scenario, settings: Settings) -> Result:
    """Peak resident memory of a render, a process each; on Linux VmHWM, as exec hands on the
    parent's peak that getrusage counts.
    """
    rows: dict[str, Result] = {}
    step = bench.steps(len(settings["spp"]) * settings["rounds"])
    for spp in settings["spp"]:
        runs = []
        for _ in range(settings["rounds"]):
            words = [sys.executable, "-c", _MEMORY, settings["scene"], str(spp),
                     str(settings["width"]), bench.device.name]  # fmt: skip
            done = subprocess.run(words, capture_output=True, text=True)
            if done.returncode:
                said = (done.stderr.strip().splitlines() or ["nothing"])[-1]
                raise BenchError(f"a process ended with status {done.returncode}: {said}")
            runs.append(json.loads(done.stdout))
            step()
        peak = statistics.median(r["peak_rss"] for r in runs)
        rows[str(spp)] = {"spp": spp, "peak_rss": peak, "runs": runs}
    peaks = [row["peak_rss"] for row in rows.values()]
    out: Result = {"rows": rows, "figures": {"growth_percent": 100 * (max(peaks) / min(peaks) - 1)}}
    if len({r["scene_and_film"] for row in rows.values() for r in row["runs"]}) > 1:
        out["void"] = "scene and film differ in size"
    return out
