"""Two results of `veriray bench all` beside each other: seconds of every row, before over after.

    python benchmarks/compare_bench.py BEFORE.json AFTER.json [BEFORE.json AFTER.json ...]
                                       [--commits BEFORE AFTER] -o RESULT.json

Several pairs (the devices of a machine changed round, say) are averaged geometrically. Rows of one
build alone, trees' building times and other renderers are left out.
"""

from __future__ import annotations

import argparse
import json
import math
from collections import defaultdict
from collections.abc import Iterator
from pathlib import Path
from typing import Any

from common import write

_LEFT_OUT = {"spread", "rounds", "mitsuba", "cycles", "tree", "runs"}


def seconds(value: Any, path: tuple[str, ...] = ()) -> Iterator[tuple[str, float]]:
    """(row, seconds) of everything below a scenario that was timed."""
    if isinstance(value, dict):
        for key, below in value.items():
            if key == "seconds" and isinstance(below, (int, float)) and below > 0:
                yield "/".join(p for p in path if p not in ("rows", "points")), float(below)
            elif key not in _LEFT_OUT:
                yield from seconds(below, (*path, str(key)))
    elif isinstance(value, list):
        for k, below in enumerate(value):
            yield from seconds(below, (*path, str(k)))


def main() -> None:
    """Compare, print the scenarios, write."""
    p = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawTextHelpFormatter)
    p.add_argument("files", nargs="+", type=Path)
    p.add_argument("--commits", nargs=2, metavar=("BEFORE", "AFTER"))
    p.add_argument("-o", "--output", type=Path, required=True)
    args = p.parse_args()
    if len(args.files) % 2:
        p.error(f"{len(args.files)} files; expected pairs")
    results = [json.loads(f.read_text("utf-8")) for f in args.files]
    logs: dict[str, dict[str, list[float]]] = defaultdict(lambda: defaultdict(list))
    for before, after in zip(results[::2], results[1::2], strict=True):
        for name in before["scenarios"].keys() & after["scenarios"].keys():
            old, new = (dict(seconds(r["scenarios"][name])) for r in (before, after))
            for row in old.keys() & new.keys():
                logs[name][row].append(math.log(old[row] / new[row]))
    scenarios = {}
    for name in results[0]["scenarios"]:
        rows = {row: math.exp(sum(x) / len(x)) for row, x in sorted(logs[name].items())}
        if rows:
            mean = math.exp(sum(map(math.log, rows.values())) / len(rows))
            scenarios[name] = {"mean": mean, "least": min(rows.values()), "rows": rows}
            print(f"{name:22} {mean:6.3f}  least {min(rows.values()):6.3f} of {len(rows)}")
    facts = {k: results[0][k] for k in ("time", "machine", "device", "build", "settings")}
    write({"benchmark": "bench all, before / after", "commits": args.commits, **facts,
           "pairs": len(results) // 2, "scenarios": scenarios}, args.output)  # fmt: skip


if __name__ == "__main__":
    main()
