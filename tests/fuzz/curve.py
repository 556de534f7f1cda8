"""Files of curves, linear and B-spline by their lengths; of few triangles."""

from __future__ import annotations

from pathlib import Path
from unittest import mock

from tests.fuzz.contract import Target
from tests.fuzz.scenes import NUMBERS, lines, problem
from veriray.errors import SceneError
from veriray.formats import curves
from veriray.scene import Scene, load_dict


def _load(path: Path) -> Scene:
    kind = sorted(curves.KINDS)[path.stat().st_size % 2]
    shape = {"type": kind, "filename": str(path)}
    with mock.patch.multiple(curves, FEW=10_000, MANY=30_000):
        return load_dict({"type": "scene", "sky": {"type": "constant"}, "s": shape})


TARGET = Target(
    ".txt", _load, problem, (SceneError,), ("formats/curves.py",),
    (*NUMBERS, "0 0 0 1", "\n\n", "\r\n"), lines,
)  # fmt: skip
