"""Closed meshes do not leak: rays from inside at corners and edges (benchmarks/leaks.py: 10^9)."""

from __future__ import annotations

import sys
from pathlib import Path

import pytest

from tests.support import FAST

sys.path.append(str(Path(__file__).parents[2] / "benchmarks"))
import leaks


@pytest.mark.parametrize("device", FAST)
def test_no_leaks_in_ten_million_rays(device: str) -> None:
    """Ten meshes, four scales, in place and a million away; none may hit nothing."""
    result = leaks.run(device, 10_000_000)
    assert result["rays"] >= 9_900_000 and result["leaks"] == 0
