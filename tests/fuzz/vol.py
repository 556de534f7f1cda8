"""Grids of numbers in space."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from tests.fuzz.contract import Target
from tests.fuzz.image import mutate
from veriray.errors import SceneError
from veriray.formats import volume_grid


def _valid(grid: tuple[np.ndarray, np.ndarray]) -> str:
    cells, box = grid
    if cells.ndim != 4 or not cells.size or cells.dtype != np.float32:
        return f"its shape is {cells.shape}, its type {cells.dtype}"
    if box.shape != (2, 3) or not (np.isfinite(cells).all() and np.isfinite(box).all()):
        return "a number is not finite"
    return ""


def _load(path: Path) -> tuple[np.ndarray, np.ndarray]:
    return volume_grid.read_vol(path, "here")


TARGET = Target(
    ".vol", _load, _valid, (SceneError,), ("formats/volume_grid.py",), ("VOL\x03",), mutate
)
