"""A suite of synthetic cases, for testing the code that runs, judges and reports them."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest

from veriray_validate import levels
from veriray_validate.trial import CASES, Case

_SCRIPT = """
import os, sys
from veriray_validate import levels

levels.__path__ = [os.path.join(os.path.dirname(os.path.abspath(__file__)), "levels")]
if __name__ == "__main__":
    from veriray.cli import main

    sys.exit(main())
"""


@pytest.fixture
def suite(monkeypatch: pytest.MonkeyPatch) -> Iterator[dict[str, Case]]:
    """The table of cases, empty; what a test registers is gone after it."""
    monkeypatch.setattr(levels, "__path__", [])
    kept = dict(CASES)
    CASES.clear()
    yield CASES
    CASES.clear()
    CASES.update(kept)


@pytest.fixture
def command(tmp_path: Path) -> Any:
    """A function from the text of a module of cases to a script: `veriray` with these alone.

    Worker processes see them too.
    """

    def make(module: str) -> str:
        (tmp_path / "levels").mkdir()
        (tmp_path / "levels" / "synthetic.py").write_text(module)
        script = tmp_path / "veriray_synthetic.py"
        script.write_text(_SCRIPT)
        return str(script)

    return make
