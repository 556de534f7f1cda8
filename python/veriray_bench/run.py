"""The runner: scenarios in, one JSON file a device out, whole after each scenario."""

from __future__ import annotations

import contextlib
import json
import math
import os
import tempfile
import time
from collections.abc import Callable, Iterator, Sequence
from pathlib import Path
from typing import Any

from veriray import html
from veriray.device import select
from veriray.errors import DeviceError
from veriray.files import open_regular, replacing

from . import kinds, process, studies
from . import matrix as matrix_kind
from .measure import RELMSE, BenchError, cpu_count, header, now
from .peers import Crew
from .scenarios import SCENARIOS, Scenario

KINDS: dict[str, Callable[..., dict[str, Any]]] = {
    "speed": kinds.speed,
    "error": kinds.error,
    "scaling": kinds.scaling,
    "depth": kinds.depth,
    "build": kinds.build,
    "compaction": studies.compaction,
    "adaptive": studies.adaptive,
    "variants": studies.variants,
    "roulette": studies.roulette,
    "cold": process.cold,
    "memory": process.memory,
    "cost": studies.cost,
    "matrix": matrix_kind.matrix,
}
#: Results of `run`: of scenarios, and of scenes of the matrix.
BENCHMARKS = ("bench", "matrix")
#: What must not change between the sessions of one file.
_SAME = ("commit", "modified", "versions", "machine", "device", "build", "settings", "peers")

Show = Callable[[str], contextlib.AbstractContextManager[Callable[[float], object] | None]]


@contextlib.contextmanager
def _silent(title: str) -> Iterator[None]:
    yield None


def choose(names: Sequence[str], backend: str) -> list[Scenario]:
    """The scenarios of these names, in the table's order; of all for none.

    Raises ValueError for a name that is unknown or not for the back end.
    """
    known = {s.name: s for s in SCENARIOS}
    for name in names:
        if name not in known:
            raise ValueError(f"scenario {name!r} is unknown; expected some of: {', '.join(known)}")
        if backend not in known[name].backends:
            allowed = ", ".join(known[name].backends)
            raise ValueError(f"scenario {name!r} is not for {backend}; it is for: {allowed}")
    return [s for s in SCENARIOS if backend in s.backends and (not names or s.name in names)]


def run(
    folder: str | os.PathLike[str],
    device: str = "auto",
    *,
    only: Sequence[str] = (),
    peers: Sequence[str] = (),
    quick: bool = False,
    again: bool = False,
    wait: float = 0.0,
    limit: float = math.inf,
    scenes: Sequence[matrix_kind.Cell] | None = None,
    show: Show = _silent,
    done: Callable[[Scenario, dict[str, Any], bool], object] = lambda scenario, row, kept: None,
) -> Path:
    """Measure scenarios on a device; returns the file, FOLDER/bench_BACKEND.json.

    With `scenes` these are measured instead of the table's scenarios; the file is
    FOLDER/matrix_BACKEND.json. The file is rewritten whole after each scenario. What it already
    holds is not measured again unless `again`; a scenario that ended in an error is. quick: a smoke
    test whose figures mean little. wait: seconds to wait for an idle machine before each run.
    limit: seconds after which none is begun. show(title) gives a progress callback;
    done(scenario, result, kept) is called after each one.

    Raises ValueError for unknown names, BenchError where the file is of another run, DeviceError,
    OSError naming the file.
    """
    chosen, _ = select(device)
    begin = time.perf_counter()
    table = choose(only, chosen.backend) if scenes is None else scenes
    name = BENCHMARKS[scenes is not None]
    path = Path(folder) / f"{name}_{chosen.backend}.json"
    with tempfile.TemporaryDirectory() as scratch, Crew(peers, chosen.backend) as crew:
        result = _header(name, chosen, crew, quick)
        result["scenarios"] = _earlier(path, result)
        path.parent.mkdir(parents=True, exist_ok=True)
        for k, scenario in enumerate(table, 1):
            old = result["scenarios"].get(scenario.name)
            if old and "error" not in old and not again:
                done(scenario, old, True)
                continue
            if time.perf_counter() - begin > limit:
                break
            title = f"{scenario.name} ({k} of {len(table)}): {scenario.title}"
            with show(title) as progress:
                bench = kinds.Bench(chosen, crew, Path(scratch), wait, progress or (lambda f: None))
                row = _measure(bench, scenario, quick)
            result["scenarios"][scenario.name] = row
            with replacing(path) as file:
                file.write(_text(result).encode())
            done(scenario, row, False)
    return path


def _header(name: str, chosen: Any, crew: Crew, quick: bool) -> dict[str, Any]:
    result = header(name, "mitsuba", "drjit", root=Path.cwd())
    result["device"] = {"name": chosen.name, "description": chosen.description, **chosen.details}
    result["build"] = chosen.native.build_info()
    result["settings"] = {
        "quick": quick, "filter": "box", "threads": cpu_count(), "errors": RELMSE,
        "ratio_by": "seconds" if chosen.backend == "cuda" else "wall",
        "limit": f"{kinds.LIMITS[chosen.backend]:.3g} paths/s {kinds.LIMIT_OF[chosen.backend]} at "
                 "max_depth 8 without roulette, by rays per path at other depths",
    }  # fmt: skip
    if name == "matrix":
        result["settings"] |= {
            "sampler": f"{matrix_kind.SAMPLER} (veriray), independent (peers)",
            "alarms": matrix_kind.ALARMS,
            "variance": "sum_k (I_k - I)^2 / (K - 1) / (r^2 + 0.01 R^2)",
        }
    result["peers"] = {peer: dict(about) for peer, about in crew.about.items()}
    return result


def _earlier(path: Path, result: dict[str, Any]) -> dict[str, Any]:
    """The scenarios that the file holds; BenchError if it is of another run."""
    if not path.exists():
        return {}
    old = read(path)
    for key in _SAME:
        if old.get(key) != html.plain(result[key]):
            raise BenchError(
                f"{path}: of another run: {key} was {_short(old.get(key))}, now "
                f"{_short(html.plain(result[key]))}; name another folder with -o"
            )
    scenarios: dict[str, Any] = old["scenarios"]
    return scenarios


def _short(value: Any) -> str:
    text = json.dumps(value)
    return text if len(text) <= 200 else text[:200] + " ..."


def read(path: str | os.PathLike[str]) -> dict[str, Any]:
    """A result file; ValueError naming it where it is none."""
    try:
        with open_regular(path) as file:
            result = json.load(file)
    except ValueError as error:
        raise ValueError(f"{os.fspath(path)}: not JSON: {error}") from None
    if not isinstance(result, dict) or result.get("benchmark") not in BENCHMARKS:
        raise ValueError(f"{os.fspath(path)}: not a result of `veriray bench all` or `matrix`")
    return result


def _measure(bench: kinds.Bench, scenario: Scenario, quick: bool) -> dict[str, Any]:
    settings = scenario.settings(bench.device.backend, quick)
    row = {"title": scenario.title, "kind": scenario.kind, "time": now(), "settings": settings}
    begin = time.perf_counter()
    try:
        row |= KINDS[scenario.kind](bench, scenario, settings)
    except (BenchError, DeviceError, MemoryError, ValueError, OSError) as error:
        row["error"] = f"{type(error).__name__}: {error}"
        with contextlib.suppress(BenchError):
            bench.crew.forget()
    return {**row, "measured_seconds": time.perf_counter() - begin}


def _text(result: dict[str, Any]) -> str:
    """JSON, a scenario a line."""
    lines = []
    for key, value in html.plain(result).items():
        text = json.dumps(value, allow_nan=False)
        if key == "scenarios":
            rows = (f" {json.dumps(k)}: {json.dumps(v, allow_nan=False)}" for k, v in value.items())
            text = "{\n" + ",\n".join(rows) + "\n}"
        lines.append(f"{json.dumps(key)}: {text}")
    return "{\n" + ",\n".join(lines) + "\n}\n"
