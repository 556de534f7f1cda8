"""`veriray bench compaction`."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import pytest

import veriray
from veriray.bench import compaction
from veriray.cli import main
from veriray.livebench import aligned


@pytest.fixture(scope="module")
def study() -> dict[str, Any]:
    scene = veriray.load_file("open")
    return compaction.study(scene, width=40, height=30, spp=2, device="cpu", rounds=1)


def test_every_strategy_makes_the_same_film(study: dict[str, Any]) -> None:
    assert [row["strategy"] for row in study["rows"]] == list(compaction.STRATEGIES)
    assert study["same_film"] and len({row["film_sha256"] for row in study["rows"]}) == 1
    assert study["winner"] == min(study["rows"], key=lambda row: row["seconds"])["strategy"]


def test_blocks_follow_what_lives(study: dict[str, Any]) -> None:
    rows = {row["strategy"]: row for row in study["rows"]}
    live, passes, block = study["live_rays"], 2, 256
    for name in ("remove_if", "partition", "copy_if", "append"):
        assert rows[name]["blocks"] == rows["remove_if"]["blocks"]
        for blocks, rays in zip(rows[name]["blocks"], live, strict=True):
            assert -(-rays // block) <= blocks < rays / block + passes
        assert rows[name]["lanes"] > rows["none"]["lanes"]
    whole = passes * -(-40 * 30 // block)
    assert rows["none"]["blocks"][:2] == [whole, whole]
    assert "blocks" not in rows["regenerate"]


def test_tables_hold_every_ray(study: dict[str, Any]) -> None:
    table = compaction.by_depth(study, limit=3)
    assert [line[0] for line in table[1:4]] == ["0", "1", "2"] and table[4][0].startswith("3-")
    assert sum(int(line[1].replace(",", "")) for line in table[1:]) == sum(study["live_rays"])
    assert len(compaction.summary(study)) == 1 + len(compaction.STRATEGIES)
    assert len({len(line) for line in compaction.summary(study)}) == 1
    text = aligned(table).splitlines()
    assert len({len(line) for line in text}) == 1


def test_command(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    file = tmp_path / "c.json"
    arguments = "bench compaction open --width 24 --height 20 --spp 1 --rounds 1 --device cpu"
    assert main([*arguments.split(), "--json", str(file)]) == 0
    assert "one SHA-256 for all" in capsys.readouterr().out
    assert json.loads(file.read_text())["same_film"] is True
    assert main([*arguments.split()[:-3], "0", "--device", "cpu"]) == 2


def test_errors() -> None:
    with pytest.raises(ValueError, match="rounds = 0"):
        compaction.study(veriray.load_file("open"), rounds=0)
