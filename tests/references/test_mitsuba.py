"""Our renders against Mitsuba 3's of the same scene file, at equal effort (VALIDATION level 5).

A false alarm of the verdict happens once in 1,000 sound pairs; the seeds are fixed.
"""

from __future__ import annotations

from pathlib import Path
from typing import Any

import pytest

import veriray
from veriray.compare import Report

pytest.importorskip("mitsuba", reason="the peer renderer: pip install mitsuba")
from benchmarks import mitsuba_peer  # noqa: E402

SIZE, BATCHES, SPP = 32, 64, 16


def verdict(root: Path, max_depth: int, ours_max_depth: int) -> Report:
    scene = root / "scenes" / "cornell" / "cornell_box_mitsuba.xml"
    mi = mitsuba_peer.start("scalar_rgb")
    size: dict[str, Any] = {"width": SIZE, "height": SIZE}
    peer = mitsuba_peer.render(
        mi, scene, batches=BATCHES, spp=SPP, seed=1000, max_depth=max_depth, rr_depth=5, **size
    )
    ours = veriray.render(
        veriray.load_file(scene), spp=BATCHES * SPP, seed=1, batches=BATCHES, device="cpu",
        max_depth=ours_max_depth, rr_depth=5, **size,
    )  # fmt: skip
    report = veriray.compare(ours, peer)
    assert report.effort == "equal", report.reason
    return report


@pytest.mark.parametrize("max_depth", [2, 3, 8, -1])
def test_agrees_with_mitsuba(root: Path, max_depth: int) -> None:
    report = verdict(root, max_depth, max_depth)
    assert report.passed, report.verdict


def test_sees_one_more_bounce(root: Path) -> None:
    assert verdict(root, 3, 4).result == "fail"
