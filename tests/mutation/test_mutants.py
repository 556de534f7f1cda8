"""Planted bugs must be found by the verdict; `python -m tests.mutation.mutants` runs them all."""

from __future__ import annotations

import contextlib
import json
from collections.abc import Iterator
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import pytest

from tests.mutation import levels, mutants, table
from tests.mutation.bugs import CASES, MUTANTS, Mutant
from tests.mutation.level_bugs import EXPLAINED, PYTHON
from tests.mutation.mutants import BUILT, Workshop

SOURCE = [m for m in BUILT if m.file]
SLOW = [m for m in MUTANTS if m.case != "shipped"][::8]


@pytest.mark.parametrize("mutant", SOURCE, ids=lambda m: m.name)
def test_mutant_fits_the_source(root: Path, mutant: Mutant) -> None:
    for file in {file for file, _, _ in mutant.edits}:
        text = (root / "cpp" / file).read_text("utf-8")
        edits = [(old, new) for name, old, new in mutant.edits if name == file]
        assert mutants.planted(text, edits) != text


@pytest.mark.parametrize("mutant", PYTHON, ids=lambda m: m.name)
def test_python_mutant_fits_the_source(root: Path, mutant: Mutant) -> None:
    text = (root / "python" / "veriray" / mutant.file).read_text("utf-8")
    assert text.count(mutant.old) == 1
    compile(text.replace(mutant.old, mutant.new), mutant.file, "exec")


def test_all_mutants_fit_one_build() -> None:
    assert set(mutants.sources()) == {file for m in SOURCE for file, _, _ in m.edits}


def test_names_are_unique() -> None:
    names = {m.name for m in (*BUILT, *PYTHON)}
    assert len(names) == len(BUILT) + len(PYTHON) and set(EXPLAINED) <= names


@pytest.mark.parametrize("name", CASES)
def test_case_is_used_and_fits_its_scene(root: Path, name: str) -> None:
    case = CASES[name]
    assert any(m.case == name for m in MUTANTS)
    mutants.planted((root / "scenes" / case.scene).read_text("utf-8"), case.edits + case.hidden)


def test_switch_tells_edits_apart() -> None:
    text = "a = b + c; d(e);"
    edits = [(1, "b + c", "b"), (2, "d(e);", "d(0);"), (3, "b+c", "c")]
    assert mutants.switched(text, edits) == (
        "a = (planted_bug == 3 ? (c) : ((planted_bug == 1 ? (b) : (b + c)))); "
        "if (planted_bug == 2) { d(0); } else { d(e); }"
    )
    with pytest.raises(ValueError, match="overlaps"):
        mutants.switched(text, [(1, "b + c", "b"), (2, "c; d", "c; e")])
    for part in ("f(b", "x ? b", "b, c"):
        with pytest.raises(ValueError, match="not a whole expression"):
            mutants.switched(text, [(1, "b", part)])
    with pytest.raises(ValueError, match="2 times"):
        mutants.switched("b b", [(1, "b", "c")])


def test_page_of_the_levels() -> None:
    caught = {"case": "closed.furnace", "verdict": "fail", "seconds": 0.25}
    missed = {"case": None, "verdict": "pass", "seconds": 9.0}
    row = {"language": "C++", "edits": [], "seconds": 9.2}
    text = table.page({
        "levels": [3, 4], "planted": 2, "caught_quick": 1, "caught": 1, "score_quick": 0.5,
        "score": 0.5, "recorded": 2, "sound": True, "survivors": {"b": ""}, "not_judged": ["c"],
        "unchanged": {n: {"ran": 5, "seconds": 9.4} for n in "34"},
        "by_level": {"3": {"caught": 1, "alone": 1}, "4": {"caught": 0, "alone": 0}},
        "rows": [{**row, "name": "a", "levels": {"3": caught, "4": missed}, "caught_by": [3]},
                 {**row, "name": "b", "levels": {"3": missed, "4": missed}, "caught_by": []}],
    })  # fmt: skip
    assert "| a | 0.2 |  | `closed.furnace` |" in text and "| b |  |  | - |" in text
    assert "finds 1 (50.0 %)" in text and "- b: unexplained" in text
    assert "Not judged, for lack of time: c." in text


def test_what_is_known_of_bugs(tmp_path: Path) -> None:
    file = tmp_path / "levels.json"
    assert levels.known(file) == {}
    same, other = ({"name": m.name, "edits": m.edits} for m in levels.BUGS[:2])
    other["edits"] = [("a", "b", "c")]
    file.write_text(json.dumps({"rows": [{"name": "gone", "edits": []}, other, same]}))
    assert list(levels.known(file)) == [same["name"]]


@pytest.mark.parametrize("first", [False, True])
def test_every_bug_is_saved_and_old_ones_kept(tmp_path: Path, first: bool) -> None:
    """Level 3 is cheaper than 1 and finds the second bug; the third is not judged for want of time.

    The first bug's row is an old one.
    """

    def judge(bug: Mutant | None, level: int, *_: object) -> dict[str, Any]:
        times = {} if bug else {"closed.cheap": 0.01, "closed.furnace": 1.0}
        answer = {"case": None, "verdict": "pass", "seconds": 5 - level, "times": times, "ran": 1}
        if bug is judged and level == 3:
            answer |= {"case": "closed.furnace", "verdict": "fail"}
        elif bug is late and level == 3:
            answer |= {"verdict": levels.UNJUDGED}
        return answer

    old, judged, late = levels.BUGS[:3]
    asked = {"1": {}, "3": {}}
    kept = {"name": old.name, "edits": [], "levels": asked, "recorded": True, "caught_by": [1]}
    stand: Any = SimpleNamespace(judge=judge, packages=tmp_path, build_seconds=1.0, sources="now",
                                 alone=contextlib.nullcontext)  # fmt: skip
    saved: list[dict[str, Any]] = []
    result = levels.run(stand, [late, judged], [1, 3], 2, first=first, kept=[kept],
                        save=saved.append)  # fmt: skip
    assert [row["name"] for row in result["rows"]] == [old.name, judged.name]
    assert len(saved) == 2 and saved[-1] == result and result["not_judged"] == [late.name]
    assert result["rows"][1]["caught_by"] == [3] and result["caught_quick"] == 2
    alone = int(not first)  # asked at all levels
    assert result["by_level"] == {1: {"caught": 1, "alone": 1}, 3: {"caught": 1, "alone": alone}}
    assert list(result["rows"][1]["levels"]) == ([3] if first else [1, 3])
    assert (result["recorded"], result["recorded_of"]) == (1, 1 if first else 2)
    page = table.page(json.loads(json.dumps({**result, "rows": [
        {**row, "language": "C++", "levels": {}} for row in result["rows"]]})))  # fmt: skip
    assert "Bugs judged with an earlier version of the sources: 1." in page


def test_what_caught_bugs_of_the_same_file_is_likely() -> None:
    bug = levels.BUGS[0]
    sound = {n: {"times": {f"{n}.a": 1.0, f"{n}.b": 2.0}} for n in (1, 2, 3)}

    def row(file: str, **cases: str | None) -> dict[str, Any]:
        found = {n[1:]: {"case": case} for n, case in cases.items()}
        return {"edits": [[file, "", ""]], "levels": found}

    rows = [row(bug.file, l1="1.a"), row("another.h", l3="3.a"), row(bug.file, l1=None, l2="2.b"),
            row(bug.file, l2="2.b"), row(bug.file, l2="2.gone")]  # fmt: skip
    assert levels._likely(bug, rows, sound) == [(2, {"2.b": 2.0}), (1, {"1.a": 1.0})]


@pytest.fixture(scope="module")
def shop(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Workshop]:
    pytest.importorskip("embreex", reason="the reference renderer needs embreex")
    yield Workshop(tmp_path_factory.mktemp("mutants"))


@pytest.mark.slow
@pytest.mark.parametrize("case", dict.fromkeys(m.case for m in SLOW))
def test_the_unchanged_module_passes(shop: Workshop, case: str) -> None:
    row = shop.judge(None, case)
    assert row["result"] == "pass", row


@pytest.mark.slow
@pytest.mark.parametrize("mutant", SLOW, ids=lambda m: m.name)
def test_mutant_is_killed(shop: Workshop, mutant: Mutant) -> None:
    row = shop.judge(mutant, mutant.case)
    assert row["killed"], row
