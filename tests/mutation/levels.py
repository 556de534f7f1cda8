"""Which level of `veriray validate` catches which planted bug.

    python -m tests.mutation.levels [NAME ...] [--jobs J] [--levels 1 2 ...] [--full-survivors]
                                    [--first] [--random N] [--limit S] [--folder DIR]
                                    [--add] [-o FILE.json]

from the repository root, with veriray installed or on PYTHONPATH. Builds one CPU module that holds
all C++ bugs (none if only Python bugs are requested) and puts it, and the Python bugs, one per
copy, into copies of the packages. Then it runs the quick levels 1 to 8 on the unchanged copy, which
must pass, and on each bug, with J processes at once. A level ends at its first failed case; a level
catches a bug if a case fails, ends in an error, kills the process or hangs. --first: no further
levels for a caught bug; the cases that caught bugs of the same file before run ahead of all
others, then the cheap ones of all levels. --full-survivors: bugs that no quick level catches are
given to the full levels. --limit: no level starts after S seconds; bugs without all their answers
are listed as not judged and not counted. Films compared with recorded hashes are reported
separately and do not count, because any change shows.

After each bug, prints and writes as JSON which level catches it, by which case, after how many
seconds. A stopped run can continue: --folder keeps the build and every answer until a source
changes, also for other runs at the same time; --add keeps the JSON file's rows of bugs whose own
text is unchanged, and judges the named bugs, or all others. Ends with status 1, before any bug is
judged, if the unchanged copy fails.
`python -m tests.mutation.table` makes a page of the result.
"""

from __future__ import annotations

import argparse
import contextlib
import fcntl
import hashlib
import itertools
import json
import math
import os
import random
import re
import shutil
import signal
import subprocess
import sys
import tempfile
import time
from collections import Counter
from collections.abc import Callable, Iterable, Iterator, Sequence
from concurrent.futures import ThreadPoolExecutor, as_completed
from pathlib import Path
from typing import Any

from tests.mutation.bugs import Mutant
from tests.mutation.level_bugs import EXPLAINED, PYTHON
from tests.mutation.level_judge import RECORDED
from tests.mutation.mutants import BUILT, ROOT, SWITCH, Workshop
from veriray import device
from veriray.files import replacing

RESULT = ROOT / "benchmarks" / "results" / "mutants_levels.json"
PACKAGES = ("veriray", "veriray_validate")
LEVELS = (1, 2, 3, 4, 5, 6, 7, 8)
#: A level stops after LIMIT times the CPU seconds that the unchanged copy takes, but not before
#: LEAST. A case that runs HANG times as long counts as hanging; so does a level after ASLEEP times
#: that in wall time, which only a level that waits in vain takes.
LIMIT, LEAST, HANG, ASLEEP = 2, 120, 2, 4
UNJUDGED = "not judged"
#: Seconds of cases: with --first those up to the second number run first at all levels, and so on.
TIERS = (-1.0, 0.05, 0.3, math.inf)
#: C++ bugs; those of `bugs` that change a scene's reflectance test only the verdict of `compare`.
BUGS = (*(m for m in BUILT if m.file), *PYTHON)


class Stand:
    """Copies of the packages, one for all bugs of C++ and one for each of Python.

    bugs: those to be judged; where all are of Python the installed module serves.
    """

    def __init__(self, folder: Path, bugs: Sequence[Mutant], limit: float | None = None) -> None:
        self.folder, self.build_seconds = folder, 0.0
        self.end = time.monotonic() + limit if limit else math.inf
        folder.mkdir(parents=True, exist_ok=True)
        self.packages = Path(tempfile.mkdtemp(prefix="packages-", dir=folder))  # of this run
        self.module = Path(device.select("cpu")[0].native.__file__)
        if built := any(m in BUILT for m in bugs):
            with self.alone():
                shop = Workshop(folder)
            self.module, self.build_seconds = shop.module, shop.build_seconds
        self.compiled = self._package("compiled", None)
        self.sources = _digest()
        self.answers = folder / "answers" / (self.sources + ("-built" if built else ""))
        self.answers.mkdir(parents=True, exist_ok=True)

    @contextlib.contextmanager
    def alone(self) -> Iterator[None]:
        """Within it, other runs that share the folder wait: what all of them need is made once."""
        with open(self.folder / "lock", "w") as lock:
            fcntl.flock(lock, fcntl.LOCK_EX)
            yield

    def _package(self, name: str, bug: Mutant | None) -> Path:
        """A folder for PYTHONPATH: packages as links, the module that holds the bugs, `bug`."""
        source, folder = ROOT / "python", self.packages / name
        shutil.rmtree(folder, ignore_errors=True)
        for file in (f for package in PACKAGES for f in (source / package).rglob("*")):
            if file.is_file() and file.suffix not in (".so", ".pyc"):
                link = folder / file.relative_to(source)
                link.parent.mkdir(parents=True, exist_ok=True)
                link.symlink_to(file)
        (folder / "veriray" / "scenes").symlink_to(ROOT / "scenes")
        (folder / "veriray" / self.module.name).symlink_to(self.module.resolve())
        if bug:
            file = folder / "veriray" / bug.file
            text = file.read_text("utf-8")
            if text.count(bug.old) != 1:
                raise ValueError(f"{bug.name}: {bug.old!r} occurs {text.count(bug.old)} times")
            file.unlink()
            file.write_text(text.replace(bug.old, bug.new), "utf-8")
        return folder

    def judge(self, bug: Mutant | None, level: int, mode: str, sound: dict[str, Any] | None,
              cases: dict[str, float] | None, part: str = "") -> dict[str, Any]:  # fmt: skip
        """The answer of a level's cases on a bug, or of all on the unchanged copy; `level_judge`.

        cases: with the seconds that each takes the unchanged copy. part: of the level, "/K/N".
        """
        name = "unchanged" if bug is None else "_".join(re.findall(r"\w+", bug.name))
        text = json.dumps(cases, sort_keys=True).encode()
        asked = part.replace("/", "-")
        asked = asked if cases is None else "-" + hashlib.sha256(text).hexdigest()[:8]
        file = self.answers / f"{mode}-{level}{asked}-{name}.json"
        if not file.exists():
            if bug and time.monotonic() > self.end:
                return {"case": None, "verdict": UNJUDGED, "ran": 0, "seconds": 0.0}
            times = None if cases is None else self.packages / file.name
            if times:
                times.write_bytes(text)
            answer = self._judged(bug, f"{level}{part}", mode, sound, times)
            with replacing(file) as new:
                new.write(json.dumps(answer).encode())
        kept: dict[str, Any] = json.loads(file.read_text("utf-8"))
        return kept

    def _judged(self, bug: Mutant | None, level: str, mode: str, sound: dict[str, Any] | None,
                times: Path | None) -> dict[str, Any]:  # fmt: skip
        package = self.compiled
        if bug in PYTHON:
            package = self._package(f"python_{PYTHON.index(bug)}_{level}", bug)
        number = BUILT.index(bug) + 1 if bug in BUILT else 0
        threads = {f"{x}_NUM_THREADS": "1" for x in ("OPENBLAS", "OMP", "MKL")}
        places = [str(package), str(ROOT), *filter(None, [os.environ.get("PYTHONPATH")])]
        environment = {**os.environ, **threads, SWITCH: str(number),
                       "PYTHONPATH": os.pathsep.join(places)}  # fmt: skip
        limit = round(max(LEAST, LIMIT * sound["seconds"])) if sound else 10**5
        most = HANG * limit
        words = [sys.executable, "-m", "tests.mutation.level_judge", level, mode,
                 str(limit), str(most), *([str(times)] if times else [])]  # fmt: skip
        begin = time.perf_counter()
        with tempfile.TemporaryDirectory() as place:
            try:
                done = subprocess.run(words, cwd=place, env=environment, capture_output=True,
                                      text=True, timeout=ASLEEP * most)  # fmt: skip
            except subprocess.TimeoutExpired:
                return self._ended("(hang)", f"no answer in {ASLEEP * most} s", begin)
        if package is not self.compiled:
            shutil.rmtree(package, ignore_errors=True)
        if done.returncode == -signal.SIGXCPU:
            return self._ended("(hang)", f"no answer in {most} s of CPU time", begin)
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
    """Hash of everything that the answers depend on."""
    digest = hashlib.sha256()
    for place in ("cpp", "python", "reference", "scenes", "tests/mutation"):
        for file in sorted((ROOT / place).rglob("*")):
            if file.is_file() and file.suffix not in (".so", ".pyc"):
                digest.update(str(file.relative_to(ROOT)).encode() + file.read_bytes())
    return digest.hexdigest()[:16]


def run(stand: Stand, chosen: Sequence[Mutant], levels: Iterable[int], jobs: int,
        full_survivors: bool = False, first: bool = False, kept: Iterable[dict[str, Any]] = (),
        save: Callable[[dict[str, Any]], object] = lambda _: None) -> dict[str, Any]:  # fmt: skip
    """Judges the bugs and returns all rows, also those `kept`; prints and saves as it goes."""
    levels = sorted(levels)
    asked = levels if first else [RECORDED, *levels]
    rows = {row["name"]: row for row in kept}
    with ThreadPoolExecutor(jobs) as pool:
        with stand.alone():
            quick = _sound(stand, pool, asked, "quick", jobs)
        print("unchanged:", {n: f"{a['verdict']}, {a['ran']} cases, {a['seconds']} s"
                             for n, a in quick.items()}, flush=True)  # fmt: skip
        order = sorted(asked, key=lambda n: quick[n]["seconds"])
        tiers = [
            (n, {case: s for case, s in quick[n]["times"].items() if least < s <= most})
            for least, most in itertools.pairwise(TIERS) for n in order
        ]  # fmt: skip
        tiers = [step for step in tiers if step[1]]
        before = list(rows.values())
        plans = {
            m.name: [_likely(m, before, quick) + tiers] if first
            else [[(n, quick[n]["times"])] for n in order] for m in chosen
        }  # fmt: skip
        for bug, found in _answers(stand, pool, plans, "quick", quick):
            row = _row(bug, found, levels)
            if judged := all(a["verdict"] != UNJUDGED for a in found.values()):
                rows[bug.name] = {**row, "sources": stand.sources}
            said = (row["caught_by"] or "SURVIVED") if judged else UNJUDGED
            print(f"{bug.name}: {said} ({row['seconds']} s)", flush=True)
            save(_result(stand, chosen, levels, rows, quick))
        left = [m for m in chosen if m.name in rows and not rows[m.name]["caught_by"]]
        if full_survivors and left:
            full = _sound(stand, pool, levels, "full", jobs)
            plans = {m.name: [[(n, full[n]["times"])] for n in levels] for m in left}
            for bug, found in _answers(stand, pool, plans, "full", full):
                caught = {n: _brief(a) for n, a in sorted(found.items()) if a["case"]}
                rows[bug.name]["full"] = caught
                print(f"{bug.name}: full: {list(caught) or 'SURVIVED'}", flush=True)
                save(_result(stand, chosen, levels, rows, quick))
    return _result(stand, chosen, levels, rows, quick)


#: A level and cases of it, with the seconds that they take a sound run.
Step = tuple[int, dict[str, float]]


def _likely(bug: Mutant, rows: Iterable[dict[str, Any]],
            sound: dict[int, dict[str, Any]]) -> list[Step]:  # fmt: skip
    """The cases that caught bugs of the same file in `rows`; the levels with most of them first."""
    files = {edit[0] for edit in bug.edits}
    hits = Counter(
        (int(n), answer["case"])
        for row in rows if files & {edit[0] for edit in row["edits"]}
        for n, answer in row["levels"].items() if answer.get("case")
    )  # fmt: skip
    steps: dict[int, dict[str, float]] = {}
    for (n, case), _ in hits.most_common():
        if n in sound and case in sound[n]["times"]:
            steps.setdefault(n, {})[case] = sound[n]["times"][case]
    return list(steps.items())


def _answers(stand: Stand, pool: ThreadPoolExecutor, plans: dict[str, list[list[Step]]], mode: str,
             sound: dict[int, dict[str, Any]],
             ) -> Iterator[tuple[Mutant, dict[int, dict[str, Any]]]]:  # fmt: skip
    """Each bug, once it is judged, with its answers by level.

    plans: by the bug's name, groups of steps; those of a group run one after the other, up to the
    first that catches the bug.
    """

    def until_caught(bug: Mutant, group: list[Step]) -> dict[int, dict[str, Any]]:
        answers: dict[int, dict[str, Any]] = {}
        left = Counter(n for n, _ in group)
        for n, cases in group:
            answer = stand.judge(bug, n, mode, sound[n], cases)
            for key in ("seconds", "ran"):  # of all its cases so far
                answer[key] = round(answer[key] + answers.get(n, {key: 0})[key], 2)
            answers[n] = answer
            left[n] -= 1
            if answer["case"]:  # what a level has left open is no answer
                return {k: a for k, a in answers.items() if k == n or not left[k]}
        return answers

    bugs = {m.name: m for m in BUGS if m.name in plans}
    found: dict[str, dict[int, dict[str, Any]]] = {name: {} for name in plans}
    waiting = {name: len(groups) for name, groups in plans.items()}
    tasks = {pool.submit(until_caught, bugs[name], group): name
             for name, groups in plans.items() for group in groups}  # fmt: skip
    for task in as_completed(tasks):
        name = tasks[task]
        found[name] |= task.result()
        waiting[name] -= 1
        if not waiting[name]:
            yield bugs[name], found[name]


def _row(bug: Mutant, found: dict[int, dict[str, Any]], levels: Iterable[int]) -> dict[str, Any]:
    answers = {n: _brief(answer) for n, answer in sorted(found.items())}
    recorded = answers.pop(RECORDED, None)
    return {
        "name": bug.name, "language": "Python" if bug in PYTHON else "C++", "edits": bug.edits,
        "levels": answers, "recorded": recorded and bool(recorded["case"]),
        "caught_by": [n for n in levels if answers.get(n, {}).get("case")],
        "seconds": round(sum(a["seconds"] for a in answers.values()), 1),
    }  # fmt: skip


def _result(stand: Stand, chosen: Sequence[Mutant], levels: Sequence[int],
            by_name: dict[str, dict[str, Any]], quick: dict[int, dict[str, Any]],
            ) -> dict[str, Any]:  # fmt: skip
    """The JSON file's content; rows in the order of the lists of bugs."""
    rows = [by_name[m.name] for m in BUGS if m.name in by_name]
    caught = sum(bool(row["caught_by"]) for row in rows)
    overall = sum(bool(row["caught_by"] or row.get("full")) for row in rows)
    return {
        "levels": levels, "build_seconds": stand.build_seconds, "sources": stand.sources,
        "planted": len(rows), "not_judged": [m.name for m in chosen if m.name not in by_name],
        "caught_quick": caught, "caught": overall,
        "recorded": sum(bool(row["recorded"]) for row in rows),
        "recorded_of": sum(row["recorded"] is not None for row in rows),
        "score_quick": round(caught / max(1, len(rows)), 4),
        "score": round(overall / max(1, len(rows)), 4),
        "sound": all(a["verdict"] == "pass" for a in quick.values()),
        "unchanged": {n: {k: a[k] for k in ("verdict", "ran", "seconds", "failed", "inconclusive",
                                            "skipped")} for n, a in quick.items()},
        "by_level": {n: {"caught": sum(n in r["caught_by"] for r in rows),
                         "alone": sum(r["caught_by"] == [n] and len(r["levels"]) == len(levels)
                                      for r in rows)} for n in levels},
        "survivors": {r["name"]: EXPLAINED.get(r["name"], "") for r in rows
                      if not r["caught_by"] and not r.get("full")},
        "rows": rows,
    }  # fmt: skip


def _sound(stand: Stand, pool: ThreadPoolExecutor, levels: Iterable[int], mode: str,
           parts: int) -> dict[int, dict[str, Any]]:  # fmt: skip
    """The answers of levels on the unchanged copy, each from that many parts at once."""
    tasks = {
        n: [pool.submit(stand.judge, None, n, mode, None, None, f"/{k}/{parts}")
            for k in range(parts)] for n in levels
    }  # fmt: skip
    answers = {n: _whole([task.result() for task in found]) for n, found in tasks.items()}
    for n, answer in answers.items():
        for key in ("failed", "inconclusive", "skipped"):
            if answer.get(key):
                print(f"unchanged, level {n}: {key}: {answer[key]}: {answer['message']}")
            answer.setdefault(key, [])
    bad = [f"level {n}: {a['message']}" for n, a in answers.items() if a["verdict"] != "pass"]
    if bad:
        raise SystemExit("the unchanged copy fails, so nothing can be judged: " + "; ".join(bad))
    return answers


def _whole(parts: list[dict[str, Any]]) -> dict[str, Any]:
    """The answer of a level from those of its parts."""
    whole = dict(next((p for p in parts if p["verdict"] != "pass"), parts[0]))
    for key in ("ran", "seconds"):
        whole[key] = round(sum(p[key] for p in parts), 2)
    for key in ("inconclusive", "skipped", "failed"):
        whole[key] = [case for p in parts for case in p.get(key, [])]
    whole["times"] = {case: s for p in parts for case, s in p.get("times", {}).items()}
    return whole


def _brief(answer: dict[str, Any]) -> dict[str, Any]:
    keys = ("case", "verdict", "message", "p", "ran", "seconds", "inconclusive")
    return {k: answer[k] for k in keys if answer.get(k) not in (None, [], "") or k == "case"}


def known(file: Path) -> dict[str, dict[str, Any]]:
    """Rows of a JSON file by name, but for bugs that are gone or whose text is another now."""
    rows = json.loads(file.read_text("utf-8"))["rows"] if file.exists() else []
    texts = {m.name: [list(edit) for edit in m.edits] for m in BUGS}
    return {row["name"]: row for row in rows if texts.get(row["name"]) == row["edits"]}


def main() -> int:
    """Command line."""
    from benchmarks.common import cpu_count, header

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
    p.add_argument("--add", action="store_true", help="keep what the JSON file says of others")
    p.add_argument("-o", "--output", type=Path, default=RESULT, help="JSON file")
    args = p.parse_args()
    if args.list:
        print("\n".join(m.name for m in BUGS))
        return 0
    if unknown := set(args.names) - {m.name for m in BUGS}:
        p.error(f"unknown bugs: {', '.join(sorted(unknown))}; --list shows all")
    kept = known(args.output) if args.add else {}
    chosen = [m for m in BUGS if m.name in args.names or not args.names and m.name not in kept]
    if args.random:
        chosen = random.Random(args.seed).sample(chosen, min(args.random, len(chosen)))
    # by the committed table the slowest first, so that none is alone at the end
    before = known(RESULT)
    chosen.sort(key=lambda m: -before.get(m.name, {"seconds": math.inf})["seconds"])
    about, begin = header("mutants_levels"), time.perf_counter()

    def save(result: dict[str, Any]) -> None:
        seconds = round(time.perf_counter() - begin)
        with replacing(args.output) as file:
            file.write(json.dumps({**about, "seconds": seconds, **result}, indent=1).encode())

    with tempfile.TemporaryDirectory() as folder:
        stand = Stand((args.folder or Path(folder)).resolve(), chosen, args.limit)
        print(f"built in {stand.build_seconds} s", flush=True)
        try:
            result = run(stand, chosen, args.levels, args.jobs, args.full_survivors, args.first,
                         kept.values(), save)  # fmt: skip
        finally:
            shutil.rmtree(stand.packages, ignore_errors=True)
    save(result)
    left = ", ".join(result["survivors"]) or "none"
    print(f"{result['caught_quick']} of {result['planted']} bugs caught by the quick levels, "
          f"{result['caught']} in all; survivors: {left}")  # fmt: skip
    if result["not_judged"]:
        print(f"not judged: {', '.join(result['not_judged'])}")
    return 0


if __name__ == "__main__":
    sys.exit(main())
