"""Which level of `veriray validate` catches which planted bug.

    python -m tests.mutation.levels [NAME ...] [--jobs J] [--levels 1 2 ...] [--full-survivors]
                                    [--first] [--random N] [--limit S] [--folder DIR]
                                    [-o FILE.json]

from the repository root, with veriray installed or on PYTHONPATH. Builds one CPU module that holds
all bugs of C++, puts it (and the bugs of Python, one a copy) into copies of the package, and runs
the quick levels 1 to 8 on each bug and, first, on the unchanged copy, which must pass; J processes
at once. A level ends at its first failed case; a bug is caught by a level if a case fails, ends in
an error, kills the process or hangs. --first: no further levels for a bug that is caught, cheap
levels first. --full-survivors: what no quick level catches is given to the full ones. --limit: no
bug is begun after S seconds; those are named as not judged and count nowhere. --folder keeps the
build and every answer: the same command goes on where it was stopped, unless a source changed.
Films compared with recorded hashes are told apart and do not count: any change shows.

Prints and writes as JSON which level catches which bug, by which case, after how many seconds. Ends
with status 1, before any bug is judged, if the unchanged copy fails. `python -m
tests.mutation.table` makes a page of it.
"""

from __future__ import annotations

import argparse
import hashlib
import json
import math
import os
import random
import re
import shutil
import subprocess
import sys
import tempfile
import time
from collections.abc import Iterable, Sequence
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from typing import Any

from tests.mutation.bugs import Mutant
from tests.mutation.level_bugs import EXPLAINED, PYTHON
from tests.mutation.level_judge import RECORDED
from tests.mutation.mutants import BUILT, ROOT, SWITCH, Workshop

RESULT = ROOT / "benchmarks" / "results" / "mutants_levels.json"
LEVELS = (1, 2, 3, 4, 5, 6, 7, 8)
#: A level stops, or is killed, after so many times the seconds that the unchanged copy takes.
LIMIT, HANG = 1.5, 10
UNJUDGED = "not judged"
LEAST = 120  # seconds of such a limit at least
#: Bugs of C++; those of `bugs` that change a scene's reflectance test the verdict of compare alone.
COMPILED = tuple(m for m in BUILT if m.file)


class Stand:
    """Copies of the package, one for all bugs of C++ and one for each of Python."""

    def __init__(self, folder: Path, limit: float | None = None) -> None:
        self.folder = folder
        self.end = time.monotonic() + limit if limit else math.inf
        self.shop = Workshop(folder)
        self.compiled = self._package("compiled", None)
        self.answers = folder / "answers" / _digest()
        self.answers.mkdir(parents=True, exist_ok=True)

    def _package(self, name: str, bug: Mutant | None) -> Path:
        """A folder for PYTHONPATH: the package as links, the module that holds the bugs, `bug`."""
        source, folder = ROOT / "python" / "veriray", self.folder / "packages" / name
        shutil.rmtree(folder, ignore_errors=True)
        for file in source.rglob("*"):
            if file.is_file() and file.suffix not in (".so", ".pyc"):
                link = folder / "veriray" / file.relative_to(source)
                link.parent.mkdir(parents=True, exist_ok=True)
                link.symlink_to(file)
        (folder / "veriray" / "scenes").symlink_to(ROOT / "scenes")
        (folder / "veriray" / self.shop.module.name).symlink_to(self.shop.module.resolve())
        if bug:
            file = folder / "veriray" / bug.file
            text = file.read_text("utf-8")
            if text.count(bug.old) != 1:
                raise ValueError(f"{bug.name}: {bug.old!r} occurs {text.count(bug.old)} times")
            file.unlink()
            file.write_text(text.replace(bug.old, bug.new), "utf-8")
        return folder

    def judge(self, bug: Mutant | None, level: int, mode: str, sound: dict[str, Any] | None,
              times: Path | None) -> dict[str, Any]:  # fmt: skip
        """One level's answer on a bug, or on the unchanged copy; see `level_judge`."""
        name = "unchanged" if bug is None else "_".join(re.findall(r"\w+", bug.name))
        file = self.answers / f"{mode}-{level}-{name}.json"
        if not file.exists():
            if bug and time.monotonic() > self.end:
                return {"case": None, "verdict": UNJUDGED, "ran": 0, "seconds": 0.0}
            answer = self._judged(bug, level, mode, sound, times)
            file.with_suffix(".part").write_text(json.dumps(answer))
            file.with_suffix(".part").replace(file)
        kept: dict[str, Any] = json.loads(file.read_text("utf-8"))
        return kept

    def _judged(self, bug: Mutant | None, level: int, mode: str, sound: dict[str, Any] | None,
                times: Path | None) -> dict[str, Any]:  # fmt: skip
        package = self.compiled
        if bug in PYTHON:
            package = self._package(f"python_{PYTHON.index(bug)}_{level}", bug)
        number = BUILT.index(bug) + 1 if bug in BUILT else 0
        threads = {f"{x}_NUM_THREADS": "1" for x in ("OPENBLAS", "OMP", "MKL")}
        places = [str(package), str(ROOT), *filter(None, [os.environ.get("PYTHONPATH")])]
        environment = {**os.environ, **threads, SWITCH: str(number),
                       "PYTHONPATH": os.pathsep.join(places)}  # fmt: skip
        limits = [max(LEAST, k * sound["seconds"]) if sound else 1e6 for k in (LIMIT, HANG)]
        words = [sys.executable, "-m", "tests.mutation.level_judge", str(level), mode,
                 str(limits[0]), *([str(times)] if times else [])]  # fmt: skip
        begin = time.perf_counter()
        with tempfile.TemporaryDirectory() as place:
            try:
                done = subprocess.run(words, cwd=place, env=environment, capture_output=True,
                                      text=True, timeout=limits[1])  # fmt: skip
            except subprocess.TimeoutExpired:
                return self._ended("(hang)", f"no answer in {limits[1]:.0f} s", begin)
        if package is not self.compiled:
            shutil.rmtree(package, ignore_errors=True)
        if done.returncode < 0:
            return self._ended("(crash)", f"signal {-done.returncode}", begin)
        if done.returncode:
            return self._ended("(crash)", done.stderr[-300:], begin)
        answer: dict[str, Any] = json.loads(done.stdout.splitlines()[-1])
        return answer

    @staticmethod
    def _ended(case: str, message: str, begin: float) -> dict[str, Any]:
        return {"case": case, "verdict": "error", "message": message, "ran": 0,
                "seconds": round(time.perf_counter() - begin, 2)}  # fmt: skip


def _digest() -> str:
    """Hash of all that the answers depend on."""
    digest = hashlib.sha256()
    for place in ("cpp", "python", "reference", "scenes", "tests/mutation"):
        for file in sorted((ROOT / place).rglob("*")):
            if file.is_file() and file.suffix not in (".so", ".pyc"):
                digest.update(str(file.relative_to(ROOT)).encode() + file.read_bytes())
    return digest.hexdigest()[:16]


def run(stand: Stand, chosen: Sequence[Mutant], levels: Iterable[int], jobs: int,
        full_survivors: bool = False, first: bool = False) -> dict[str, Any]:  # fmt: skip
    """Judges the bugs; prints as it goes."""
    levels = sorted(levels)
    asked = levels if first else [RECORDED, *levels]
    with ThreadPoolExecutor(jobs) as pool:
        quick = _sound(stand, pool, asked, "quick")
        order = sorted(asked, key=lambda n: quick[n]["seconds"])
        print("unchanged:", {n: f"{a['verdict']}, {a['ran']} cases, {a['seconds']} s"
                             for n, a in quick.items()}, flush=True)  # fmt: skip
        times = _times(stand.folder / "quick_times.json", quick)
        rows = [{"name": m.name, "language": "Python" if m in PYTHON else "C++",
                 "edits": m.edits, "levels": {}} for m in chosen]  # fmt: skip
        if first:
            answers = [pool.submit(_until_caught, stand, m, order, quick, times) for m in chosen]
        else:
            tasks = {(k, n): pool.submit(stand.judge, m, n, "quick", quick[n], times)
                     for k, m in enumerate(chosen) for n in order}  # fmt: skip
        for k, row in enumerate(rows):
            found = answers[k].result() if first else {n: tasks[k, n].result() for n in order}
            row["levels"] = {n: _brief(answer) for n, answer in found.items()}
            row["recorded"] = bool(row["levels"].pop(RECORDED, {}).get("case"))
            row["caught_by"] = [n for n in levels if row["levels"].get(n, {}).get("case")]
            row["judged"] = all(a["verdict"] != UNJUDGED for a in row["levels"].values())
            row["seconds"] = round(sum(a["seconds"] for a in row["levels"].values()), 1)
            said = (row["caught_by"] or "SURVIVED") if row["judged"] else UNJUDGED
            print(f"{row['name']}: {said} ({row['seconds']} s)", flush=True)
        unjudged = [row["name"] for row in rows if not row["judged"]]
        rows = [row for row in rows if row["judged"]]
        left = [k for k, row in enumerate(rows) if not row["caught_by"]]
        if full_survivors and left:
            order = levels
            sound = _sound(stand, pool, levels, "full")
            times = _times(stand.folder / "full_times.json", sound)
            bugs = {m.name: m for m in chosen}
            again = {(k, n): pool.submit(stand.judge, bugs[rows[k]["name"]], n, "full", sound[n],
                                         times)
                     for k in left for n in order}  # fmt: skip
            for k in left:
                answers = {n: _brief(again[k, n].result()) for n in order}
                rows[k]["full"] = {n: a for n, a in answers.items() if a["case"]}
                print(f"{rows[k]['name']}: full: {list(rows[k]['full']) or 'SURVIVED'}", flush=True)
    caught = sum(bool(row["caught_by"]) for row in rows)
    overall = sum(bool(row["caught_by"] or row.get("full")) for row in rows)
    return {
        "levels": levels, "build_seconds": stand.shop.build_seconds, "planted": len(rows),
        "not_judged": unjudged, "caught_quick": caught, "caught": overall,
        "recorded": sum(row["recorded"] for row in rows),
        "score_quick": round(caught / max(1, len(rows)), 4),
        "score": round(overall / max(1, len(rows)), 4),
        "sound": all(a["verdict"] == "pass" for a in quick.values()),
        "unchanged": {n: {k: a[k] for k in ("verdict", "ran", "seconds", "failed", "inconclusive",
                                            "skipped")} for n, a in quick.items()},
        "by_level": {n: {"caught": sum(n in r["caught_by"] for r in rows),
                         "alone": sum(r["caught_by"] == [n] for r in rows)} for n in levels},
        "survivors": {r["name"]: EXPLAINED.get(r["name"], "") for r in rows
                      if not r["caught_by"] and not r.get("full")},
        "rows": rows,
    }  # fmt: skip


def _until_caught(stand: Stand, bug: Mutant, order: Sequence[int], sound: dict[int, dict[str, Any]],
                  times: Path) -> dict[int, dict[str, Any]]:  # fmt: skip
    """The levels' answers up to the first that catches the bug."""
    answers: dict[int, dict[str, Any]] = {}
    for n in order:
        answers[n] = stand.judge(bug, n, "quick", sound[n], times)
        if answers[n]["case"]:
            break
    return answers


def _sound(stand: Stand, pool: ThreadPoolExecutor, levels: Iterable[int],
           mode: str) -> dict[int, dict[str, Any]]:  # fmt: skip
    tasks = {n: pool.submit(stand.judge, None, n, mode, None, None) for n in levels}
    answers = {n: task.result() for n, task in tasks.items()}
    for n, answer in answers.items():
        for key in ("failed", "inconclusive", "skipped"):
            if answer.get(key):
                print(f"unchanged, level {n}: {key}: {answer[key]}: {answer['message']}")
            answer.setdefault(key, [])
    bad = [f"level {n}: {a['message']}" for n, a in answers.items() if a["verdict"] != "pass"]
    if bad:
        raise SystemExit("the unchanged copy fails, so nothing can be judged: " + "; ".join(bad))
    return answers


def _times(file: Path, answers: dict[int, dict[str, Any]]) -> Path:
    file.write_text(json.dumps({k: v for a in answers.values() for k, v in a["times"].items()}))
    return file


def _brief(answer: dict[str, Any]) -> dict[str, Any]:
    keys = ("case", "verdict", "message", "p", "ran", "seconds", "inconclusive")
    return {k: answer[k] for k in keys if answer.get(k) not in (None, [], "") or k == "case"}


def main() -> int:
    """Command line."""
    from benchmarks.common import cpu_count, header, write

    p = argparse.ArgumentParser(description="Planted bugs against the levels of veriray validate")
    p.add_argument("names", nargs="*", help="bugs, default all")
    p.add_argument("--list", action="store_true")
    p.add_argument("--jobs", type=int, default=cpu_count())
    p.add_argument("--levels", type=int, nargs="+", choices=LEVELS, default=LEVELS)
    p.add_argument("--random", type=int, metavar="N", help="N bugs by --seed")
    p.add_argument("--seed", type=int, default=1)
    p.add_argument("--full-survivors", action="store_true")
    p.add_argument("--first", action="store_true", help="stop at the first level that catches")
    p.add_argument("--limit", type=float, metavar="S", help="begin no bug after S seconds")
    p.add_argument("--folder", type=Path, help="keep the build here")
    p.add_argument("-o", "--output", type=Path, default=RESULT, help="JSON file")
    args = p.parse_args()
    bugs = (*COMPILED, *PYTHON)
    if args.list:
        print("\n".join(m.name for m in bugs))
        return 0
    if unknown := set(args.names) - {m.name for m in bugs}:
        p.error(f"unknown bugs: {', '.join(sorted(unknown))}; --list shows all")
    chosen = [m for m in bugs if not args.names or m.name in args.names]
    if args.random:
        chosen = random.Random(args.seed).sample(chosen, min(args.random, len(chosen)))
    begin = time.perf_counter()
    with tempfile.TemporaryDirectory() as folder:
        stand = Stand((args.folder or Path(folder)).resolve(), args.limit)
        print(f"built in {stand.shop.build_seconds} s", flush=True)
        result = run(stand, chosen, args.levels, args.jobs, args.full_survivors, args.first)
    result = {**header("mutants_levels"), "seconds": round(time.perf_counter() - begin), **result}
    left = ", ".join(result["survivors"]) or "none"
    print(f"{result['caught_quick']} of {result['planted']} bugs caught by the quick levels, "
          f"{result['caught']} in all; survivors: {left}")  # fmt: skip
    write(result, args.output)
    if result["not_judged"]:
        print(f"not judged: {', '.join(result['not_judged'])}")
    return 0


if __name__ == "__main__":
    sys.exit(main())
