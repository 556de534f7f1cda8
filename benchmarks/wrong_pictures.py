"""Runs a folder of scripts, each of which once showed a wrong picture, and keeps what they say.

    python benchmarks/wrong_pictures.py FOLDER -o wrong_pictures.json

A script gets the seed; one whose docstring has "argv: device" gets the device and 256 samples
instead, and chooses its own seed. `common.py` is no script. The JSON holds for each: exit status,
seconds, the z values that it printed, its last lines, and a verdict: "agrees" if no |z| is above 5
beside a difference of 1e-4 or more; "differs"; "failed" (exit status, or `--limit` seconds over);
"read it" for a script that prints no z. Exit status 0 if none differs or failed.
"""

from __future__ import annotations

import re
import subprocess
import sys
import time
from pathlib import Path
from typing import Any

from common import header, parser, write

LARGEST = 5.0  # |z|; scripts print some ten each
Z = re.compile(r"\bz\s*(?:=\s*)?([+-]?\d+(?:\.\d+)?)")
#: Percent that a line tells beside z. Without any noise rounding alone is many standard errors.
PERCENT = re.compile(r"([+-]?[\d.]+) %")


def run(script: Path, args: Any) -> dict[str, Any]:
    """One script, in its own process and folder."""
    takes_device = "argv: device" in script.read_text("utf-8")
    words = [args.device, "256"] if takes_device else [str(args.seed)]
    begin, over = time.perf_counter(), False
    try:
        done = subprocess.run(
            [sys.executable, script.name, *words], cwd=script.parent, timeout=args.limit,
            stdout=subprocess.PIPE, stderr=subprocess.STDOUT,
        )  # fmt: skip
        status, said = done.returncode, done.stdout
    except subprocess.TimeoutExpired as error:
        status, said, over = -1, error.stdout or b"", True
    text = said.decode(errors="replace")
    z, differs = [], False
    for line in text.splitlines():
        told = PERCENT.search(line)
        z += (here := [float(found) for found in Z.findall(line)])
        off = max(map(abs, here), default=0.0) > LARGEST
        differs |= off and (told is None or abs(float(told[1])) >= 0.01)
    verdict = "read it" if not z else "differs" if differs else "agrees"
    return {
        "script": script.name, "arguments": words, "verdict": "failed" if status else verdict,
        "status": status, "over_limit": over, "seconds": round(time.perf_counter() - begin, 2),
        "z": z, "output": text.splitlines()[-40:],
    }  # fmt: skip


def main() -> int:
    """Command line."""
    p = parser(__doc__, "wrong_pictures.json")
    p.add_argument("folder", type=Path)
    p.add_argument("--device", default="cpu", help="for scripts that take one (default: cpu)")
    p.add_argument("--seed", type=int, default=1)
    p.add_argument("--limit", type=float, default=600.0, help="seconds for a script")
    args = p.parse_args()
    scripts = sorted(s for s in args.folder.resolve().glob("*.py") if s.name != "common.py")
    if not scripts:
        p.error(f"no scripts in {args.folder}")
    result: dict[str, Any] = header("wrong_pictures")
    result["settings"] = {"device": args.device, "seed": args.seed, "largest_z": LARGEST}
    rows: list[dict[str, Any]] = []
    result["scripts"] = rows
    for script in scripts:
        rows.append(row := run(script, args))
        print(f"{row['verdict']:8} {script.name}, {row['seconds']} s, z {row['z']}", flush=True)
    write(result, args.output)
    return int(any(row["verdict"] in ("differs", "failed") for row in rows))


if __name__ == "__main__":
    sys.exit(main())
