"""docs/what-is-read.md from the table of parameters and what becomes of each.

python -m tests.plugins.page          writes it
"""

from __future__ import annotations

import tempfile
from pathlib import Path

from tests.plugins import scenes

PAGE = Path(__file__).resolve().parents[2] / "docs" / "what-is-read.md"
HOW = ("read", "with a note", "with a warning", "refused")
_HEAD = """# What is read of Mitsuba 3

Every parameter of every plugin of Mitsuba 3.9.1, with each kind of value that it takes, in a small
scene of its own, as a file and as a dictionary. `python -m tests.plugins.page` makes this page,
`tests/python/test_plugins.py` checks that it is true, and that Mitsuba reads the same scenes.

- *Read*: it counts as in Mitsuba, or changes no light.
- *With a note*: it changes no light, and `Scene.notes` says so.
- *With a warning*: something near it is rendered, and a `SceneWarning` says what.
- *Refused*: a `SceneError` names it with file and line.

A kind of value is named where kinds differ. What is said of a plugin, whatever its parameters, and
of parameters that are refused or rendered as something else, stands below the tables.

"""


def outcomes(folder: Path) -> dict[scenes.Case, scenes.Outcome]:
    """What becomes of each case as a file."""
    return {case: scenes.outcome(scenes.scene(case), folder) for case in scenes.cases()}


def judged(files: dict[scenes.Case, scenes.Outcome]) -> dict[scenes.Case, tuple[str, str]]:
    """Each case, how it is read, one of HOW, and what is said then."""
    alone: dict[tuple[str, str], scenes.Outcome] = {}
    result = {}
    for case, found in files.items():
        if not case.parameter:
            alone[case.category, case.plugin] = found
        base = alone[case.category, case.plugin]
        known = (base.warnings, base.notes) if case.parameter else (frozenset(), frozenset())
        warned, noted = found.warnings - known[0], found.notes - known[1]
        if found.fault:
            result[case] = "refused", found.fault
        elif warned:
            result[case] = "with a warning", "; ".join(sorted(warned))
        elif noted:
            result[case] = "with a note", "; ".join(sorted(noted))
        else:
            result[case] = "read", ""
    return result


def _cell(names: list[str]) -> str:
    """Names, each with its kind, if it has one, in brackets."""
    words = (name.partition(" ") for name in names)
    return ", ".join(f"`{name}`{space}{kind}" for name, space, kind in words)


def _short(text: str) -> str:
    text = text.split("; allowed:")[0].split("; did you mean")[0].replace("|", "/")
    return text if len(text) <= 160 else f"{text[:150]} ..."


def page(found: dict[scenes.Case, tuple[str, str]]) -> str:
    """The text of the page."""
    parts, told = [_HEAD], []
    for category in dict.fromkeys(case.category for case in found):
        parts.append(
            f"## {category}\n\n| plugin | " + " | ".join(HOW) + " |\n|---|---|---|---|---|\n"
        )
        own = [case for case in found if case.category == category]
        for plugin in dict.fromkeys(case.plugin for case in own):
            alone = found[scenes.Case(category, plugin)]
            if alone[0] == "refused":
                parts.append(f"| `{plugin}` | | | | all of it |\n")
                told.append(f"- `{plugin}`: {_short(alone[1])}\n")
                continue
            if alone[0] != "read":
                told.append(f"- `{plugin}`: {_short(alone[1])}\n")
            cells: dict[str, list[str]] = {how: [] for how in HOW}
            cases = [case for case in own if case.plugin == plugin and case.parameter]
            for name in dict.fromkeys(case.parameter for case in cases):
                kinds = [case for case in cases if case.parameter == name]
                same = len({found[case][0] for case in kinds}) == 1
                for case in kinds[:1] if same else kinds:
                    how, text = found[case]
                    cells[how].append(
                        name if same else f"{name} ({case.kind.replace('string=', '')})"
                    )
                    if how in ("with a warning", "refused"):
                        told.append(f"- `{plugin}.{name}`: {_short(text)}\n")
            parts.append(f"| `{plugin}` | " + " | ".join(_cell(cells[how]) for how in HOW) + " |\n")
        parts.append("\n")
    parts += ["## What is said\n\n", *dict.fromkeys(told)]
    return "".join(parts)


if __name__ == "__main__":
    with tempfile.TemporaryDirectory() as name:
        scenes.files(Path(name))
        PAGE.write_text(page(judged(outcomes(Path(name)))), "utf-8")
