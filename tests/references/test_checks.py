"""Our renders of scenes/checks against the independent reference renderer's, at equal effort.

A false alarm of one verdict happens once in 1,000 sound pairs; the seeds are fixed. The ledgers are
compared too: at every depth paths end alike. Larger runs: benchmarks/agree_reference.py.
"""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

import veriray

pytest.importorskip("embreex", reason="the reference renderer needs embreex")
import reference  # noqa: E402

FOLDER = Path(__file__).resolve().parents[2] / "scenes" / "checks"
NAMES = sorted(path.stem for path in FOLDER.glob("*.xml"))
SIZE, BATCHES, SPP = 16, 16, 16


def strange(name: str, seed: int, spp: int = BATCHES * SPP) -> veriray.Render:
    """The reference's render of a scene, as a Render."""
    scene = reference.with_settings(reference.load(FOLDER / f"{name}.xml"), width=SIZE, height=SIZE)
    picture = reference.render(scene, spp=spp, seed=seed, batches=BATCHES)
    columns = {c: picture.ledger[:, k].tolist() for k, c in enumerate(reference.COLUMNS)}
    image, stderr = picture.mean.astype(np.float32), picture.stderr.astype(np.float32)
    return veriray.Render(
        image=image, stderr=stderr, batch_means=picture.batch_means,
        film_sha256=veriray.film_hash(image, stderr, picture.spp),
        stats={"renderer": "reference", "ledger": columns, "max_depth": scene.max_depth,
               "rr_depth": scene.rr_depth},
        width=SIZE, height=SIZE, spp=picture.spp, seed=seed,
    )  # fmt: skip


@pytest.mark.parametrize("name", NAMES)
def test_agrees_with_the_reference(name: str) -> None:
    scene = veriray.load_file(FOLDER / f"{name}.xml").with_(width=SIZE, height=SIZE)
    # Signed weights: the mean of few samples may be negative, which `compare` calls invalid.
    spp = BATCHES * SPP * (4 if scene.film.filter == "mitchell" else 1)
    ours = veriray.render(scene, spp=spp, seed=1, batches=BATCHES, device="cpu")
    report = veriray.compare(ours, strange(name, 2, spp))
    assert report.effort == "equal", report.reason
    assert report.passed, report.verdict
    assert any(test.name == "L4 ends of paths" for test in report.tests)


def test_sees_another_scene() -> None:
    """The power of it: the mesh's shading normals, and a plastic's colour, make a difference."""
    for name, other in (("smooth_normals", "face_normals"), ("plastic_nonlinear", "plastic")):
        scene = veriray.load_file(FOLDER / f"{name}.xml").with_(width=SIZE, height=SIZE)
        ours = veriray.render(scene, spp=BATCHES * SPP, seed=1, batches=BATCHES, device="cpu")
        assert veriray.compare(ours, strange(other, 2)).result == "fail", name


def test_scenes_are_what_their_maker_makes() -> None:
    done = subprocess.run([sys.executable, FOLDER / "make.py", "--check"], capture_output=True,
                          text=True)  # fmt: skip
    assert done.returncode == 0, done.stdout + done.stderr


def test_scenes_are_small_and_many() -> None:
    assert len(NAMES) >= 24
    for path in FOLDER.rglob("*"):
        assert path.is_dir() or path.stat().st_size < 100 * 1024, path.name
        if path.suffix == ".xml":
            film = veriray.load_file(path).film
            assert max(film.width, film.height) <= 96, path.name
