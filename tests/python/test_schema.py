"""The schema of the scene's arrays: generated files, and what a new column may change."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

import veriray
from veriray import columns, scene_arrays
from veriray.columns import COLUMNS, Column

ROOT = Path(__file__).resolve().parents[2]


def test_generated_files_are_current() -> None:
    command = [sys.executable, str(ROOT / "cpp" / "schema" / "generate.py"), "--check"]
    done = subprocess.run(command, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stdout + done.stderr


def test_a_scene_has_a_field_for_each_column() -> None:
    assert list(scene_arrays.SceneArrays.__dataclass_fields__) == list(COLUMNS)


def test_a_new_column_changes_the_hash_of_no_scene_that_leaves_it_alone(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    scene, *copies = (veriray.load_file("cornell-box") for _ in range(3))
    before, rows = scene.sha256, len(scene.reflectance)
    new = Column("materials", np.float32, (), 0.25, 0.0, 1.0)
    monkeypatch.setitem(columns.COLUMNS, "roughness", new)
    at_default, set_ = np.full(rows, 0.25), np.linspace(0.0, 1.0, rows)
    for copy, roughness, same in zip(copies, (at_default, set_), (True, False), strict=True):
        object.__setattr__(copy, "roughness", roughness)
        assert (copy.sha256 == before) == same
    monkeypatch.setitem(columns.COLUMNS, "knots", Column("curves", np.float64, (3,)))
    for rows, hashed in ((0, False), (2, True)):  # of a new table: existing rows count, even zeros
        assert columns.hashed("knots", np.zeros((rows, 3))) == hashed
