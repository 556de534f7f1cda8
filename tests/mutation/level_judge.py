"""Runs one level of `veriray validate` until its first failure; prints JSON.

    python -m tests.mutation.level_judge LEVEL[/K/N] quick|full SECONDS MOST [LOG.json]

with the packages to be judged first on PYTHONPATH, alone with its native module. LEVEL 0: the films
of level 6 that are compared with recorded hashes. The other levels leave these out, because they
show that something changed, not that it is wrong. SECONDS: of CPU time, after which the level ends
as survived; MOST: after which it is killed (SIGXCPU) in a case that does not end. LOG.json: seconds
of the cases that a sound run passed; only these run, cheap ones first. Without it all cases run to
the end and the seconds are reported. /K/N: every N-th case alone, from the K-th.
"""

from __future__ import annotations

import fnmatch
import json
import resource
import sys
import time
from pathlib import Path
from typing import Any

FAILED = ("fail", "error")
RECORDED = 0
_RECORDED_CASES = "bits.recorded_films*"


def main(level: int, part: slice, full: bool, limit: float, log: Path | None) -> dict[str, Any]:
    """Verdict on a part of a level."""
    try:
        from veriray_validate.run import FULL_EFFORT, cases
        from veriray_validate.trial import FAMILY, FIRST, SECOND, judge

        second = min(SECOND, FAMILY / FIRST / (2 * len(cases(full=full))))
        chosen = [
            c for c in cases([level or 6], full=full)
            if fnmatch.fnmatch(c.id, _RECORDED_CASES) == (level == RECORDED)
        ]  # fmt: skip
    except Exception as error:  # a bug in Python may break whatever builds a scene
        message = f"{type(error).__name__}: {error}"
        return {"case": "(import)", "verdict": "error", "message": message, "ran": 0, "times": {},
                "seconds": round(time.process_time(), 2)}  # fmt: skip
    chosen = chosen[part]
    known: dict[str, float] = json.loads(log.read_text("utf-8")) if log else {}
    if log:
        chosen = sorted((c for c in chosen if c.id in known), key=lambda c: known[c.id])
    times: dict[str, float] = {}
    ran = 0
    verdicts: dict[str, list[str]] = {}
    found: dict[str, Any] = {"case": None, "verdict": "pass", "message": ""}
    for case in chosen:
        if log and time.process_time() > limit:
            found["message"] = f"stopped after {ran} of {len(chosen)} cases"
            break
        outcome = judge(case, "cpu", effort=FULL_EFFORT if full else 1, threads=1, second=second)
        ran += 1
        verdicts.setdefault(outcome.verdict, []).append(case.id)
        if outcome.verdict == "pass":
            times[case.id] = round(outcome.seconds, 3)
        if outcome.verdict in FAILED and found["case"] is None:
            found = {"case": case.id, "verdict": outcome.verdict, "p": outcome.p,
                     "message": outcome.message[:300]}  # fmt: skip
            if log:
                break
    return {
        **found, "ran": ran, "seconds": round(time.process_time(), 2),
        "inconclusive": verdicts.get("inconclusive", [])[:5], "skipped": verdicts.get("skip", []),
        "failed": [c for v in FAILED for c in verdicts.get(v, [])], "times": times,
    }  # fmt: skip


if __name__ == "__main__":
    _, hard = resource.getrlimit(resource.RLIMIT_CPU)
    resource.setrlimit(resource.RLIMIT_CPU, (int(sys.argv[4]), hard))
    level, first, step = map(int, (sys.argv[1] + "/0/1").split("/")[:3])
    answer = main(level, slice(first, None, step), sys.argv[2] == "full", float(sys.argv[3]),
                  Path(sys.argv[5]) if sys.argv[5:] else None)  # fmt: skip
    print("\n" + json.dumps(answer))
