"""`veriray validate` with many seeds on one build: what fails, how often, and how near the rest is.

    python benchmarks/seeds.py --seeds 400 --jobs 16                      # quick runs
    python benchmarks/seeds.py --seeds 40 --full --jobs 16 -o full.json   # full ones

Seed s gives each case the very run of `veriray validate [--full] --seed s`: both stages, the same
thresholds. The JSON holds, for each case that ever failed, gave no verdict or was rejected in the
first stage more often than chance explains: its seeds, p values of both stages and messages; each
rejection of the first stage; and for each seed the verdict of the whole run. A case that is
rejected with p < 0.001 in the first stage by k of n seeds is listed as fragile where the binomial
probability of k or more is below 0.001 over the number of cases: its margin or its truth is off by
little, and a longer run fails.

On a GPU, start CUDA's Multi-Process Service first (nvidia-cuda-mps-control -d): without it cases
take turns. Kernels are not made at run time unless VERIRAY_KERNELS says so: small cases differ in
what they need, and compilers took over half of the time. Bits do not depend on them.

Cases that draw no random numbers are asked with the first seed alone; their answer is every seed's.
What a planted bug does is the same with every seed, so those that several seeds choose are judged
once, on one build.

Seeds are worked on in order. `--limit` ends after so many seconds with those that are done; the
file is written anew every minute, so that a run that is cut off leaves what it has. Exit status 0
if every seed passes and no case is fragile.
"""

from __future__ import annotations

import argparse
import itertools
import json
import os
import sys
import tempfile
import time
from collections import defaultdict
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from common import RESULTS, header, write
from scipy import stats

from veriray_validate import CASES, cases, judge, pool
from veriray_validate.levels.mutation import FOLDER
from veriray_validate.run import FULL_EFFORT, fast_devices, held_by
from veriray_validate.trial import FAMILY, FIRST, MANY, SECOND

SAVE = 60.0  # seconds between files
#: Builds bugs and judges the sound program, which takes several times as long with the first seed.
#: The other seeds need both, so they ask it that many seeds later than all else.
PLANTED, LATER = "mutation.planted_bugs", 8
#: verdict, p of the first stage, p of the second, message, seconds, whether the seed matters
Answer = tuple[str, float | None, float | None, str, float, bool]


def work(name: str, device: str, seed: int, effort: int, second: float) -> Answer:
    """One case with one seed, as `veriray validate` runs it."""
    if name not in CASES:
        cases()
    o = judge(CASES[name], device, seed=seed, effort=effort, threads=1, second=second)
    return o.verdict, o.p, o.confirmed, o.message, o.seconds, o.seeded


@dataclass
class Tally:
    """What the seeds done so far say."""

    wanted: int  # cases of a seed
    by_case: dict[str, dict[int, Answer]] = field(default_factory=lambda: defaultdict(dict))
    by_seed: dict[int, dict[str, Answer]] = field(default_factory=lambda: defaultdict(dict))

    constant: dict[str, Answer] = field(default_factory=dict)  # of cases without random numbers

    def add(self, name: str, seed: int, answer: Answer) -> None:
        """One case with one seed."""
        if not answer[5]:
            self.constant[name] = answer
        self.by_case[name][seed] = self.by_seed[seed][name] = answer

    def seeds(self) -> list[dict[str, Any]]:
        """Verdicts of whole runs, of those seeds whose cases are all done."""
        rows = []
        for seed, answers in sorted(self.by_seed.items()):
            if len(answers) < self.wanted:
                continue
            p = [a[1] for a in answers.values() if a[1] is not None]
            low = sum(q < FIRST for q in p)
            crowded = float(stats.binom.sf(low - 1, len(p), FIRST)) < MANY
            bad = sorted(n for n, a in answers.items() if a[0] not in ("pass", "skip"))
            rows.append({"seed": seed, "passed": not bad and not crowded, "not_passed": bad,
                         "first_stage": low, "of": len(p), "crowded": crowded})  # fmt: skip
        return rows

    def cases(self) -> list[dict[str, Any]]:
        """Cases that failed or are fragile, the worst first."""
        rows = []
        for name, answers in self.by_case.items():
            p = [a[1] for a in answers.values() if a[1] is not None]
            low = sum(q < FIRST for q in p)
            chance = float(stats.binom.sf(low - 1, len(p), FIRST)) if p else 1.0
            bad = {s: a for s, a in sorted(answers.items()) if a[0] not in ("pass", "skip")}
            fragile = chance < FIRST / self.wanted
            if bad or fragile:
                rows.append({
                    "case": name, "level": CASES[name].level, "seeds": len(answers),
                    "not_passed": len(bad), "first_stage": low, "chance_of_so_many": chance,
                    "fragile": fragile, "smallest_p": min(p, default=None),
                    "median_p": sorted(p)[len(p) // 2] if p else None,
                    "failures": [{"seed": s, "verdict": a[0], "p": a[1], "confirmed": a[2],
                                  "message": a[3][:300]} for s, a in bad.items()],
                })  # fmt: skip
        return sorted(rows, key=lambda r: (-r["not_passed"], r["chance_of_so_many"], r["case"]))


def report(
    args: argparse.Namespace, begun: dict[str, Any], tally: Tally, second: float, seconds: float
) -> dict[str, Any]:
    """The result as it stands; begun: header from before the workers started."""
    rows = tally.seeds()
    values = [a[1] for answers in tally.by_case.values() for a in answers.values()]
    p = [q for q in values if q is not None]
    failed = sum(not r["passed"] for r in rows)
    # what the suite promises of a run, and how likely so many failures are if it holds
    bound = tally.wanted * FIRST * second + MANY
    result = dict(begun)
    result["settings"] = {
        "device": args.device, "full": args.full, "levels": args.level, "case": args.case,
        "first_seed": args.first, "seeds": args.seeds, "cases": tally.wanted,
        "first": FIRST, "second": second, "jobs": args.jobs, "seconds": seconds,
        "kernels": os.environ["VERIRAY_KERNELS"],
    }  # fmt: skip
    result["cases_done"] = sum(map(len, tally.by_case.values()))
    result["cases_without_random_numbers"] = len(tally.constant)
    seconds_of: dict[str, float] = defaultdict(float)
    for name, answers in tally.by_case.items():
        done = list(answers.values())[: 1 if name in tally.constant else None]
        seconds_of[name.partition("[")[0]] += sum(a[4] for a in done)
    ranked = sorted(seconds_of.items(), key=lambda x: -x[1])
    result["processor_seconds"] = {name: round(s, 1) for name, s in ranked[:40]}
    result["seeds_done"], result["seeds_failed"] = len(rows), failed
    result["false_alarm_bound"] = bound
    result["chance_of_so_many"] = float(stats.binom.sf(failed - 1, len(rows), bound))
    low = [(a[1], name, seed) for name, answers in tally.by_case.items()
           for seed, a in answers.items() if a[1] is not None and a[1] < FIRST]  # fmt: skip
    result["first_stage"] = {
        "of": len(p), "low": len(low), "expected": len(p) * FIRST,
        "those": [{"case": name, "seed": seed, "p": q} for q, name, seed in sorted(low)],
    }  # fmt: skip
    result["cases"] = tally.cases()
    result["runs"] = rows
    return result


def main() -> int:
    """Command line."""
    p = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawTextHelpFormatter)
    p.add_argument("--seeds", type=int, default=20, help="how many")
    p.add_argument("--first", type=int, default=1, help="the first of them")
    p.add_argument("--full", action="store_true", help="as validate --full (default: quick)")
    p.add_argument("--level", type=int, action="append", help="1 to 9; repeatable (default: all)")
    p.add_argument("--case", default="*", help="cases whose id matches, as in veriray validate")
    p.add_argument("--device", default=fast_devices()[0])
    p.add_argument("--jobs", type=int, default=len(os.sched_getaffinity(0)))
    p.add_argument("--limit", type=float, help="seconds after which no more answers are awaited")
    p.add_argument("-o", "--output", type=Path, default=RESULTS / "seeds.json")
    args = p.parse_args()
    chosen = cases(args.level, full=args.full, pattern=args.case)
    if not chosen:
        p.error(f"no case fits levels {args.level}, pattern {args.case!r}")
    second = min(SECOND, FAMILY / FIRST / (2 * len(chosen)))
    effort = FULL_EFFORT if args.full else 1
    seeds = range(args.first, args.first + args.seeds)
    order = [c.id for c in sorted(chosen, key=lambda c: c.quick)]
    os.environ.setdefault("VERIRAY_KERNELS", "off")
    kept = tempfile.TemporaryDirectory(prefix="bugs-")
    os.environ.setdefault(FOLDER, kept.name)
    begun, tally, begin = header("seeds"), Tally(len(chosen)), time.perf_counter()
    saved = begin
    for part in range(2):
        if args.limit and time.perf_counter() - begin > args.limit:
            break  # before the second part
        asked = [(seed, name) for seed in seeds for name in order
                 if name not in tally.constant
                 and (seed == args.first and name != PLANTED) == (part == 0)]  # fmt: skip
        asked.sort(key=lambda x: x[0] + LATER * (x[1] == PLANTED and x[0] > args.first))
        jobs = [(name, args.device, seed, effort, second) for seed, name in asked]
        for name, seed in itertools.product(list(tally.constant), seeds[1:] if part else ()):
            tally.add(name, seed, tally.constant[name])
        for k, answer in pool.results(work, jobs, args.jobs, [held_by(args.device)] * len(jobs)):
            name, _, seed, _, _ = jobs[k]
            if isinstance(answer, pool.Died):
                answer = ("error", None, None, str(answer), 0.0, True)
            tally.add(name, seed, answer)
            if answer[0] not in ("pass", "skip"):
                print(f"seed {seed}: {name}: {answer[0]}: {answer[3][:160]}", flush=True)
            now = time.perf_counter()
            if now - saved > SAVE:
                saved = now
                now_known = report(args, begun, tally, second, now - begin)
                args.output.parent.mkdir(parents=True, exist_ok=True)
                args.output.write_text(json.dumps(now_known, indent=1) + "\n")
            if args.limit and now - begin > args.limit:
                break
    kept.cleanup()
    result = report(args, begun, tally, second, time.perf_counter() - begin)
    write(result, args.output)
    print(f"{result['cases_done']} cases; {result['seeds_failed']} of {result['seeds_done']} whole "
          f"runs failed; promised: one in {1 / result['false_alarm_bound']:,.0f}")  # fmt: skip
    for row in result["cases"]:
        words = " fragile" if row["fragile"] else ""
        print(f"{row['not_passed']} of {row['seeds']} x {row['case']}; first stage "
              f"{row['first_stage']}, median p {row['median_p'] or 0:.2g}{words}")  # fmt: skip
    return 0 if not result["seeds_failed"] and not result["cases"] else 1


if __name__ == "__main__":
    sys.exit(main())
