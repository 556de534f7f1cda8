"""Level 9: bugs planted on purpose are found by the other levels."""

from __future__ import annotations

import json
import os
import shutil
import subprocess
import sys
import tempfile
from pathlib import Path
from typing import Any

import numpy as np

import veriray
from veriray_validate.trial import Skipped, Trial, case

CHOSEN = 10
COMMAND = "python -m tests.mutation.levels"
#: Variable of the environment: a folder in which runs of `COMMAND` keep the build and every answer
#: for each other. What a bug's answer is does not depend on the seed, which only chooses bugs.
FOLDER = "VERIRAY_BUGS_FOLDER"
_RESULT = Path("benchmarks") / "results" / "mutants_levels.json"


def _checkout() -> Path | None:
    """The source checkout that this package comes from, or that is the working directory."""
    for root in (Path(veriray.__file__).resolve().parents[2], Path.cwd()):
        own = root / "python" / "veriray" / "__init__.py"
        if (root / "tests" / "mutation" / "levels.py").is_file() and own.is_file():
            if f'"{veriray.__version__}"' in own.read_text("utf-8"):
                return root
    return None


def _committed(root: Path | None) -> dict[str, Any] | None:
    """The result of the last run on all bugs."""
    file = root / _RESULT if root else None
    found: dict[str, Any] | None = (
        json.loads(file.read_text("utf-8")) if file and file.is_file() else None
    )
    return found


@case(9, quick=False, once=True)
def planted_bugs(t: Trial) -> None:
    """Ten of the planted bugs, chosen at random, are found by the quick levels 1 to 8.

    A test build holds every bug behind a switch, and the unchanged build passes. If the ten come
    from the bugs that the committed table lists as found, all are found again; without a table,
    eight of any ten.
    """
    root = _checkout()
    committed = _committed(root)
    if committed:
        t.figure("planted bugs found", {
            "planted": committed["planted"], "by the quick levels": committed["caught_quick"],
            "by any level": committed["caught"], "commit": committed.get("commit"),
            "survivors": ", ".join(committed["survivors"]) or "none",
        })  # fmt: skip
        t.figure("table of planted bugs found by level", {
            "columns": ["level", "found", "by it alone"],
            "rows": [[n, row["caught"], row["alone"]] for n, row in committed["by_level"].items()],
        })  # fmt: skip
    if root is None:
        raise Skipped(f"needs the source checkout: {COMMAND}")
    tools = os.pathsep.join([str(Path(sys.executable).parent), os.environ.get("PATH", "")])
    missing = [name for name in ("c++", "cmake", "ninja") if not shutil.which(name, path=tools)]
    if missing:
        raise Skipped(f"needs {', '.join(missing)}: {COMMAND}")
    command = [sys.executable, *COMMAND.split()[1:]]
    if committed:
        listed = subprocess.run([*command, "--list"], cwd=root, capture_output=True, text=True)
        there = set(listed.stdout.splitlines())
        known = [r["name"] for r in committed["rows"] if r["caught_by"] and r["name"] in there]
        t.check(len(known) > 0, f"{COMMAND} --list: {listed.stderr[-500:]}")
        chosen = np.random.default_rng(t.fresh()).choice(known, min(CHOSEN, len(known)), False)
        words, least = chosen.tolist(), len(chosen)
    else:
        words, least = ["--random", str(CHOSEN), "--seed", str(t.fresh())], CHOSEN - 2
    with tempfile.TemporaryDirectory() as folder:
        output = Path(folder) / "result.json"
        jobs = t.threads or len(os.sched_getaffinity(0))
        if kept := os.environ.get(FOLDER):
            words += ["--folder", kept]
        done = subprocess.run(
            [*command, *words, "--first", "--jobs", str(jobs), "-o", str(output)],
            cwd=root, capture_output=True, text=True,
        )  # fmt: skip
        t.check(output.is_file(), f"{COMMAND}: {done.stderr[-500:]}")
        result = json.loads(output.read_text("utf-8"))
    t.check(result["sound"], "the unchanged build fails")
    rows = [[row["name"], ", ".join(map(str, row["caught_by"])) or "none", row["seconds"]]
            for row in result["rows"]]  # fmt: skip
    t.figure("table of bugs tried now", {"columns": ["bug", "level", "seconds"], "rows": rows})
    survivors = ", ".join(result["survivors"])
    t.check(result["caught_quick"] >= least, f"not found by the quick levels: {survivors}")
