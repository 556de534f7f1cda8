"""Planted bugs must be found by the verdict; `python -m tests.mutation.mutants` runs them all."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

import pytest

from tests.mutation import mutants
from tests.mutation.mutants import MUTANTS, Mutant, Workshop

SOURCE = [m for m in MUTANTS if m.file]
QUICK = [m for m in MUTANTS if m.case != "shipped"][::4]


@pytest.mark.parametrize("mutant", SOURCE, ids=lambda m: m.name)
def test_mutant_fits_the_source(root: Path, mutant: Mutant) -> None:
    text = (root / "cpp" / mutant.file).read_text()
    assert mutants.planted(text, mutant.old, mutant.new) != text


def test_names_are_unique() -> None:
    assert len({m.name for m in MUTANTS}) == len(MUTANTS)


@pytest.fixture(scope="module")
def shop(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Workshop]:
    pytest.importorskip("embreex", reason="the reference renderer needs embreex")
    yield Workshop(tmp_path_factory.mktemp("mutants"))


@pytest.mark.slow
def test_the_unchanged_copy_passes(shop: Workshop) -> None:
    row = shop.judge(None, "quick")
    assert row["result"] == "pass", row


@pytest.mark.slow
@pytest.mark.parametrize("mutant", QUICK, ids=lambda m: m.name)
def test_mutant_is_killed(shop: Workshop, mutant: Mutant) -> None:
    row = shop.judge(mutant, mutant.case)
    assert row["killed"], row
