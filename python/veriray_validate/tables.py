"""Tables of a validation for the documentation.

python -m veriray_validate.tables VALIDATION.json ... [-o docs/stress.md]
"""

from __future__ import annotations

import argparse
import json
import sys
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from veriray.files import replacing
from veriray_validate.levels import LEVELS
from veriray_validate.run import cases

(STRESS,) = (number for number, level in LEVELS.items() if level.name == "Stress")
WORST = ("fail", "error", "inconclusive", "pass", "skip")


def verdict(outcomes: list[Mapping[str, Any]]) -> str:
    """One cell for the outcomes of a row on a kind of device: the worst verdict and its count."""
    if not outcomes:
        return "-"
    names = [str(o["verdict"]) for o in outcomes]
    worst = min(names, key=WORST.index)
    count = names.count(worst)
    return worst if count == len(names) == 1 else f"{worst} ({count} of {len(names)})"


def stress_table(*validations: Mapping[str, Any]) -> str:
    """The page docs/stress.md from `Validation.to_dict()`s, or their JSON: one row per question.

    Columns: the case, the scene, what is expected (the case's docstring), verdicts on the CPU and
    on CUDA. Cases with arguments share a row. Cases that no validation holds are listed below.
    """
    known = {c.id.partition("[")[0]: c for c in cases([STRESS], full=True)}
    rows: dict[str, list[Mapping[str, Any]]] = {}
    for outcome in (o for validation in validations for o in validation["cases"]):
        if outcome["level"] == STRESS:
            rows.setdefault(str(outcome["id"]).partition("[")[0], []).append(outcome)
    extent = "full" if all(v["full"] for v in validations) else "quick"
    lines = [
        "# Numerical stress",
        "",
        f"Written by `python -m veriray_validate.tables` from a {extent} `veriray validate` of",
        f"veriray {validations[0]['veriray']}. The expectations were written down before the runs.",
        "In addition, no sample may be non-finite and the ray ledger must add up in every case.",
        "Known limits are named as such.",
        "",
        *(f"- {name}: {about}{_commit(v)}" for v in validations
          for name, about in v["devices"].items()),
        "",
        "| case | scene | expected | CPU | CUDA |",
        "|---|---|---|---|---|",
    ]  # fmt: skip
    for name, outcomes in rows.items():
        case = known.get(name)
        scene = (case.title if case else str(outcomes[0]["title"])).rstrip(".")
        cells = [
            f"`{name}`", scene, case.expects if case else "",
            *(verdict([o for o in outcomes if str(o["device"]).startswith(kind)])
              for kind in ("cpu", "cuda")),
        ]  # fmt: skip
        lines.append("| " + " | ".join(c.replace("|", "\\|") for c in cells) + " |")
    counts = {v: sum(o["verdict"] == v for group in rows.values() for o in group) for v in WORST}
    lines += ["", f"{len(rows)} lines, {sum(counts.values())} outcomes: "
              + ", ".join(f"{n} {v}" for v, n in counts.items() if n) + "."]  # fmt: skip
    if later := [f"`{name}`" for name in known if name not in rows]:
        lines += ["", f"{len(later)} cases are not in these runs: {', '.join(later)}."]
    return "\n".join(lines) + "\n"


def _commit(validation: Mapping[str, Any]) -> str:
    commit = validation.get("facts", {}).get("commit")
    return f", commit {commit[:7]}" if commit else ""


def main() -> int:
    """Command line."""
    parser = argparse.ArgumentParser(prog="python -m veriray_validate.tables", description=__doc__)
    parser.add_argument("validation", type=Path, nargs="+", help="JSON of veriray validate")
    parser.add_argument("-o", "--output", type=Path, help="Markdown file; default: standard output")
    args = parser.parse_args()
    text = stress_table(*(json.loads(path.read_text("utf-8")) for path in args.validation))
    if args.output is None:
        sys.stdout.write(text)
    else:
        with replacing(args.output) as file:
            file.write(text.encode())
    return 0


if __name__ == "__main__":
    sys.exit(main())
