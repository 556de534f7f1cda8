"""`veriray bench compaction`."""

from __future__ import annotations

import csv
import json
import re
from pathlib import Path
from typing import Any

import pytest

import veriray
from veriray.cli import main
from veriray.depths import BLOCK_SIZE, aligned
from veriray_bench import compaction, livebench


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


# ---- Table 1 of the 2016 report ----

ROOT = Path(__file__).resolve().parents[2]


def report_table() -> list[tuple[int, int, int]]:
    """Ray depth, live rays after it, blocks launched for it."""
    with (ROOT / "benchmarks/results/report_table1.csv").open(newline="") as file:
        return [
            (int(row["ray_depth"]), int(row["live_rays"]), int(row["thread_blocks"]))
            for row in csv.DictReader(file)
        ]


def test_the_report_obeys_the_law_in_every_row() -> None:
    table = report_table()
    assert [depth for depth, _, _ in table] == list(range(1, 12))
    before = 1280 * 720
    for depth, live, blocks in table:
        assert blocks == -(-before // BLOCK_SIZE), f"bounce {depth}"
        assert live < before
        before = live


def test_the_page_has_the_report_and_the_law() -> None:
    page = (ROOT / "docs/compaction.md").read_text().split("## The report's Table 1")[1]
    rows = [
        [cell.strip().replace(",", "") for cell in line.strip("|").split("|")]
        for line in page.splitlines()
        if re.match(r"\| \d+ ", line)
    ]
    assert len(rows) == 12
    assert [(int(r[0]), int(r[1]), int(r[2])) for r in rows[1:]] == report_table()
    for live, blocks in ((1, 2), (4, 5), (7, 8), (9, 10)):  # columns: report, spheres, box, open
        for above, row in zip(rows, rows[1:], strict=False):
            assert int(row[blocks]) == -(-int(above[live]) // BLOCK_SIZE), row[0]


def test_a_scene_of_the_report_s_kind_obeys_it() -> None:
    scene = veriray.load_file(ROOT / "scenes/gallery/spheres.xml")
    table = livebench.run(scene, device="cpu")
    assert table["law_holds"] is True and table["rows"][1]["blocks"] == 3600
    share = [row["share"] for row in table["rows"]]
    assert 0.8 < share[1] < 0.9  # not the sky, as in the report
    for row, (_, live, _) in zip(table["rows"][4:9], report_table()[3:8], strict=True):
        assert abs(row["live"] / live - 1) < 0.05
