"""The inputs that fuzzing kept: each gives a valid object or a documented error, within limits."""

from __future__ import annotations

from pathlib import Path

import pytest

from tests.fuzz.contract import judge
from tests.fuzz.formats import CORPUS, FORMATS, target

MAX_CORPUS = 300_000  # bytes


@pytest.mark.parametrize("name", FORMATS)
def test_inputs_keep_the_contract(tmp_path: Path, name: str) -> None:
    of = target(name)
    path = of.prepare(tmp_path)
    outcomes = [judge(of, file.read_bytes(), path) for file in sorted((CORPUS / name).iterdir())]
    assert "valid" in outcomes and len(set(outcomes)) > 1


def test_corpus_is_small() -> None:
    files = [file for file in CORPUS.rglob("*") if file.is_file()]
    assert sum(file.stat().st_size for file in files) <= MAX_CORPUS
    assert {file.parent.name for file in files} == set(FORMATS)


@pytest.mark.parametrize("name", FORMATS)
def test_mutations_are_made_of_seeds(name: str) -> None:
    import random

    of, rng = target(name), random.Random(1)
    seeds = [file.read_bytes() for file in (CORPUS / name).glob("seed-*")]
    assert of.mutate is not None
    made = [of.mutate(data, rng) for data in seeds * 20]
    assert sum(m not in (None, *seeds) for m in made) > len(made) / 4
