"""Page of the planted bugs and the levels that catch them.

Run as `python -m tests.mutation.table [FILE.json] [-o docs/mutation.md]`.
"""

from __future__ import annotations

import argparse
import json
from pathlib import Path
from typing import Any

from tests.mutation.level_bugs import EXPLAINED
from tests.mutation.levels import BUGS, RESULT
from tests.mutation.mutants import ROOT
from veriray_validate.levels import LEVELS


def edits(name: str) -> list[list[str]]:
    """(File, old, new) of a bug as it is planted now; none if there is no such bug."""
    return [list(edit) for bug in BUGS if bug.name == name for edit in bug.edits]


def page(result: dict[str, Any]) -> str:
    """Markdown of a result of `tests.mutation.levels`."""
    levels = [str(n) for n in result["levels"]]
    rows = result["rows"]
    old = sum(row.get("sources") != result.get("sources") for row in rows)
    judged = {row["name"] for row in rows if [list(e) for e in row["edits"]] == edits(row["name"])}
    lines = [
        "# Planted bugs, and which level finds them",
        "",
        f"{result['planted']} bugs, each in one place of the C++ or Python sources, were planted "
        "and given to the quick levels of `veriray validate` on a CPU. **The quick run alone finds "
        f"{result['caught_quick']} ({100 * result['score_quick']:.1f} %)"
        + (f", the full run {result['caught']} ({100 * result['score']:.1f} %)"
           if result["caught"] > result["caught_quick"] else "")
        + f".** The unchanged program {'passes' if result['sound'] else 'FAILS'}. Written by "
        "`python -m tests.mutation.table` from `benchmarks/results/mutants_levels.json`; the bugs "
        "are in `tests/mutation/bugs.py` and `level_bugs.py`. When the page was written, these "
        f"planted {len(BUGS)}, of which {len(judged)} are in the table as they are; others were "
        "planted or moved since the run.",
        "",
        "| level | | cases | seconds | bugs found | found by it alone |",
        "|---|---|---|---|---|---|",
    ]  # fmt: skip
    for n in levels:
        sound, found = result["unchanged"][n], result["by_level"][n]
        lines.append(f"| {n} | {LEVELS[int(n)].name} | {sound['ran']} | {sound['seconds']:.0f} | "
                     f"{found['caught']} | {found['alone']} |")  # fmt: skip
    lines += [
        "",
        f"Films with recorded hashes changed for {result['recorded']} of "
        f"{result.get('recorded_of', len(rows))} bugs. They show that something changed, not that "
        "it is wrong, and are not counted here. Found by a level alone: of the "
        f"{sum(len(row['levels']) == len(levels) for row in rows)} bugs that all levels were given."
        + (f" Bugs judged with an earlier version of the sources: {old}." if old else ""),
        "",
        "The table gives the seconds of one processor until a level's first failed case; cases "
        "that found bugs of the same file run first, then cheap ones. Empty: the level passes. "
        "-: not run after another had failed. The case named is the quickest to find the bug.",
        "",
        "| bug | " + " | ".join(levels) + " | found by |",
        "|---|" + "---|" * (len(levels) + 1),
    ]
    for row in rows:
        cells = []
        for n in levels:
            answer = row["levels"].get(n)
            found = f"{answer['seconds']:.1f}" if answer and answer["case"] else ""
            cells.append(found if answer else "-")
        hits = [a for a in row["levels"].values() if a["case"]]
        best = min(hits, key=lambda a: a["seconds"])["case"] if hits else ""
        if not hits and row.get("full"):
            best = "full run: " + next(iter(row["full"].values()))["case"]
        name = row["name"] + (" (Python)" if row["language"] == "Python" else "")
        lines.append(f"| {name} | " + " | ".join(cells) + f" | {f'`{best}`' if best else '-'} |")
    if result["survivors"]:
        lines += ["", "## Survivors", ""]
        lines += [f"- {name}: {EXPLAINED.get(name) or why or 'unexplained'}"
                  for name, why in result["survivors"].items()]  # fmt: skip
    if result["not_judged"]:
        lines += ["", f"Not judged, for lack of time: {', '.join(result['not_judged'])}."]
    return "\n".join(lines) + "\n"


def main() -> None:
    """Command line."""
    p = argparse.ArgumentParser(description="Page of the planted bugs")
    p.add_argument("result", nargs="?", type=Path, default=RESULT)
    p.add_argument("-o", "--output", type=Path, default=ROOT / "docs" / "mutation.md")
    args = p.parse_args()
    args.output.write_text(page(json.loads(args.result.read_text("utf-8"))), "utf-8")


if __name__ == "__main__":
    main()
