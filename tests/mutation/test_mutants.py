"""Planted bugs must be found by the verdict; `python -m tests.mutation.mutants` runs them all."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

import pytest

from tests.mutation import mutants
from tests.mutation.bugs import CASES, MUTANTS, Mutant
from tests.mutation.mutants import Workshop

SOURCE = [m for m in MUTANTS if m.file]
SLOW = [m for m in MUTANTS if m.case != "shipped"][::8]


@pytest.mark.parametrize("mutant", SOURCE, ids=lambda m: m.name)
def test_mutant_fits_the_source(root: Path, mutant: Mutant) -> None:
    text = (root / "cpp" / mutant.file).read_text()
    assert mutants.planted(text, mutant.edits) != text


def test_all_mutants_fit_one_build() -> None:
    assert set(mutants.sources()) == {m.file for m in SOURCE}


def test_names_are_unique() -> None:
    assert len({m.name for m in MUTANTS}) == len(MUTANTS)


@pytest.mark.parametrize("name", CASES)
def test_case_is_used_and_fits_its_scene(root: Path, name: str) -> None:
    case = CASES[name]
    assert any(m.case == name for m in MUTANTS)
    mutants.planted((root / "scenes" / case.scene).read_text(), case.edits + case.hidden)


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
