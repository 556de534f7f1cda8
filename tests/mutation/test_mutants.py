"""Planted bugs must be found by the verdict; `python -m tests.mutation.mutants` runs them all."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

import pytest

from tests.mutation import mutants, table
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
    assert "finds 1 (50 %)" in text and "- b: unexplained" in text and "not judged: c." in text


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
