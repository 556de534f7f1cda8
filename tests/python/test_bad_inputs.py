"""The scenes of bad_inputs.md."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import pytest

from tests.python import bad_inputs
from veriray.cli import main


@pytest.mark.parametrize("name", bad_inputs.SCENES)
def test_bad_scenes_are_errors_of_one_line(
    name: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: Any
) -> None:
    bad_inputs.prepare(tmp_path)
    monkeypatch.chdir(tmp_path)
    assert main(["render", f"{name}.xml", "-o", "a.exr", "--device", "cpu"]) == 2
    (line,) = capsys.readouterr().err.splitlines()
    assert line.startswith("veriray: error: ") and not Path("a.exr").exists()
