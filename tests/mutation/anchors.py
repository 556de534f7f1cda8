"""Anchors of the planted bugs: `python -m tests.mutation.anchors` lists those that fit no longer.

For each text that does not occur exactly once in its file, prints the files of cpp/ that hold it
once, or the nearest lines of its own file. Exit status 1 if an anchor is lost.
"""

from __future__ import annotations

import difflib
import sys

from tests.mutation.mutants import BUILT, ROOT, span


def holds(text: str, old: str) -> bool:
    """Whether `old` occurs exactly once in `text`."""
    try:
        span(text, old)
    except ValueError:
        return False
    return True


def lost() -> list[str]:
    """One line per anchor that fits no longer: mutant, file, text, and where to look."""
    cpp = ROOT / "cpp"
    texts = {
        str(f.relative_to(cpp)): f.read_text("utf-8")
        for f in sorted(cpp.rglob("*"))
        if f.suffix in {".h", ".cpp", ".cu", ".cuh", ".def"}
    }
    found = []
    for mutant in BUILT:
        for file, old, _ in mutant.edits:
            text = texts.get(file, "")
            if holds(text, old):
                continue
            places = [f"moved to {name}" for name in texts if holds(texts[name], old)]
            lines = [line.strip() for line in text.splitlines()]
            near = difflib.get_close_matches(old, lines, 2, 0.3)
            hint = "; ".join(places) or "nearest: " + " | ".join(near)
            found.append(f"{mutant.name}: {file}: {old!r}: {hint}")
    return found


if __name__ == "__main__":
    report = lost()
    print("\n".join(report) or "every anchor fits")
    sys.exit(bool(report))
