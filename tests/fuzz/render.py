"""Scene files, rendered: 2 x 2 pixels of one sample. Needs a native module; not part of `all`."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from tests.fuzz.contract import Target
from tests.fuzz.xml import TARGET as XML
from veriray.comparison.ledgers import ledger_problems
from veriray.errors import DeviceError, OutOfMemoryError
from veriray.rendering import Render, render
from veriray.scene import load_file

SIDE, DEPTH = 2, 40


def _load(path: Path) -> Render:
    scene = load_file(path)
    depth = DEPTH if scene.max_depth < 0 else min(scene.max_depth, DEPTH)
    return render(scene, spp=1, width=SIDE, height=SIDE, max_depth=depth, device="cpu", threads=1)


def _valid(result: Render) -> str:
    if result.image.shape != (SIDE, SIDE, 3) or not np.isfinite(result.image).all():
        return "its picture is not finite"
    if result.stats["nonfinite_samples"]:
        return "it has samples that are not finite"
    problems = ledger_problems(result.stats["ledger"], SIDE * SIDE)
    return f"its ledger does not add up: {problems[0]}" if problems else ""


TARGET = Target(
    ".xml", _load, _valid, (ValueError, DeviceError, OutOfMemoryError),
    ("native_scene.py", "rendering.py", "scene.py"), XML.words, XML.mutate, XML.beside,
)  # fmt: skip
