"""False alarms of `veriray validate`: its statistical cases on a sound build, with many seeds.

    python benchmarks/false_alarms_levels.py [--seeds 200] [--levels 1 2 3 4 5] [--case PATTERN]

Per level: first-stage p values at or below 1e-3, their number, the exact binomial probability of so
many or more, and cases that failed (both stages). Conservative tests give fewer than 1 in 1,000.
Cases that compare with stored data share its noise over all seeds and are counted apart. Exit
status 1 if a case failed or a level's first stage rejects more than chance explains (1e-3).
"""

from __future__ import annotations

import argparse
import os
import sys
import time
from collections import Counter
from pathlib import Path
from typing import Any

from common import RESULTS, header, write
from scipy import stats

from veriray_validate import CASES, cases, judge, pool
from veriray_validate.run import held_by
from veriray_validate.trial import FIRST


def work(name: str, device: str, seeds: list[int]) -> list[tuple[str, float | None, float]]:
    """Verdict, p value of the first stage and seconds of one case for each seed."""
    if name not in CASES:
        cases()
    answers = []
    for seed in seeds:
        outcome = judge(CASES[name], device, seed=seed, threads=1)
        answers.append((outcome.verdict, outcome.p, outcome.seconds))
        if outcome.p is None:
            break  # exact: one seed says it
    return answers


def main() -> int:
    """Command line."""
    p = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawTextHelpFormatter)
    p.add_argument("--seeds", type=int, default=200)
    p.add_argument("--levels", type=int, nargs="+", default=[1, 2, 3, 4, 5])
    p.add_argument("--case", default="*", help="cases whose id matches, as in veriray validate")
    p.add_argument("--device", default="cpu")
    p.add_argument("--jobs", type=int, default=len(os.sched_getaffinity(0)))
    p.add_argument("--piece", type=int, default=20, help="seeds of one job")
    p.add_argument("--limit", type=float, help="seconds after which no more answers are awaited")
    p.add_argument("-o", "--output", type=Path, default=RESULTS / "false_alarms_levels.json")
    args = p.parse_args()
    chosen = cases(args.levels, pattern=args.case)
    pieces = [list(range(first, min(first + args.piece, args.seeds + 1)))
              for first in range(1, args.seeds + 1, args.piece)]  # fmt: skip
    jobs = [(c.id, args.device, piece) for piece in pieces for c in chosen]
    rows: dict[tuple[int, bool], dict[str, Any]] = {}
    failed: Counter[str] = Counter()
    begin, done = time.perf_counter(), 0
    holds = [held_by(args.device)] * len(jobs)
    for k, answer in pool.results(work, jobs, args.jobs, holds):
        name = jobs[k][0]
        c = CASES[name]
        row = rows.setdefault((c.level, c.stored), Counter())
        if isinstance(answer, pool.Died):
            failed[f"{name}: {answer}"] += 1
            continue
        for verdict, value, seconds in answer:
            row["seconds"] += seconds
            row[verdict] += 1
            if verdict not in ("pass", "skip"):
                failed[f"{name}: {verdict}"] += 1
            if value is not None:
                row["p_values"] += 1
                row["first_stage"] += value <= FIRST
        done += 1
        if args.limit and time.perf_counter() - begin > args.limit:
            break
    result = header("false_alarms_levels")
    result["settings"] = {"seeds": args.seeds, "device": args.device, "case": args.case,
                          "first": FIRST, "jobs": len(jobs), "jobs_done": done}  # fmt: skip
    result["failed"] = dict(failed.most_common())
    result["rows"], sound = [], not failed
    for (level, stored), row in sorted(rows.items()):
        n, k = row["p_values"], row["first_stage"]
        chance = float(stats.binom.sf(k - 1, n, FIRST)) if n else 1.0
        sound &= stored or chance > FIRST
        result["rows"].append({"level": level, "stored": stored, **row, "rate": k / max(n, 1),
                               "chance_of_so_many": chance})  # fmt: skip
        print(result["rows"][-1], flush=True)
    for name, count in failed.most_common(40):
        print(f"{count} x {name}")
    write(result, args.output)
    return 0 if sound else 1


if __name__ == "__main__":
    sys.exit(main())
