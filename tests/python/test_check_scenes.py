"""scenes/checks and the data stored about it: files, not pictures."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

import veriray
from veriray_validate import references
from veriray_validate.levels import stranger
from veriray_validate.references import Reference, Run
from veriray_validate.scenes import check_scene, checks

FOLDER = Path(__file__).resolve().parents[2] / "scenes" / "checks"


def test_scenes_are_what_their_maker_makes() -> None:
    done = subprocess.run([sys.executable, FOLDER / "make.py", "--check"], capture_output=True,
                          text=True)  # fmt: skip
    assert done.returncode == 0, done.stdout + done.stderr


def test_scenes_are_small_and_many() -> None:
    names = sorted(path.stem for path in FOLDER.glob("*.xml"))
    assert len(names) >= 24 and names == sorted(checks())
    for path in FOLDER.rglob("*"):
        assert path.is_dir() or path.stat().st_size < 100 * 1024, path.name
        if path.suffix == ".xml":
            film = veriray.load_file(path).film
            assert max(film.width, film.height) <= 96, path.name


def test_each_question_gets_a_check_scene_of_its_own() -> None:
    a, b = check_scene("point_light", 16), check_scene("point_light", 16)
    assert a.vertices is b.vertices and a.sha256 == b.sha256
    veriray.render(a, 1, device="cpu")
    assert a.native_forms and not b.native_forms


def test_references_are_small() -> None:
    files = [references.FOLDER / f"{name}.npz" for name in checks()]
    assert sum(f.stat().st_size for f in files if f.is_file()) < 170e3 * len(files)


def run(rng: np.random.Generator, block: int, spread: float = 0.1) -> Run:
    """Batch means of a picture of radiance 1 with lognormal noise."""
    cells = references.SIZE // block
    means = rng.lognormal(0, spread, (references.BATCHES, cells, cells, 3))
    live = [1000, 600, 200]
    ledger = {c: [0, 0, 0] for c in references.LEDGER_COLUMNS}
    ledger |= {"live": live, "escaped": [400, 400, 200]}
    return Run(means, np.full((cells, cells, 3), 2.0), ledger, block, 4)


def test_files_hold_float32_whole(tmp_path: Path) -> None:
    rng = np.random.default_rng(3)
    runs = {name: run(rng, block) for name, block in references.BLOCKS.items()}
    references.save(Reference("x", "abc", runs, {"version": "1"}), tmp_path / "x.npz")
    back = references.read(tmp_path / "x.npz")
    assert (back.name, back.sha256, back.facts) == ("x", "abc", {"version": "1"})
    for name, kept in runs.items():
        assert (back.runs[name].means == kept.means.astype(np.float32)).all()
        assert (back.runs[name].squares == kept.squares).all()
        assert back.runs[name].ledger == kept.ledger and back.runs[name].spp == 4


def test_another_run_confirms() -> None:
    rng = np.random.default_rng(4)
    kept = Reference("x", "", {n: run(rng, b) for n, b in references.BLOCKS.items()}, {})
    for effort in (1, 2, 3, 4, 8, 16, 17, 64, 256):
        assert kept.run(effort) is not kept.run(4 * effort), effort
    assert kept.run(1) is kept.runs["small"] and kept.run(4) is kept.runs["first"]


@pytest.mark.parametrize("block", [8, 4])
def test_comparison_has_few_false_alarms_and_sees_a_bias(block: int) -> None:
    """Sound pairs: no p value below 1e-4; 2 % of the picture and 3 % of a part are found."""
    rng = np.random.default_rng(5)
    cells = references.SIZE // block
    mask = np.zeros((cells, cells), np.int64)
    mask[: cells // 4] = 1
    parts = mask, {0: "rest", 1: "top"}
    found = []
    for _ in range(10):
        a, r = run(rng, block), run(rng, block)
        found += stranger.comparison(a, r, parts, rng, fine=False)
    assert min(found)[0] > 1e-4
    p = np.array([value for value, _ in found])
    assert 0.4 < p.mean() < 0.7
    for bright in (np.full((cells, cells, 1), 1.02), 1 + 0.03 * mask[..., None]):
        a, r = run(rng, block), run(rng, block)
        biased = Run(a.means * bright, a.squares, a.ledger, block, 4)
        assert min(stranger.comparison(biased, r, parts, rng, fine=False))[0] < 1e-4
