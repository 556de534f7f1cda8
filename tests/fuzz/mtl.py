"""MTL files beside an OBJ file that is a scene."""

from __future__ import annotations

from pathlib import Path

from tests.fuzz.contract import Target
from tests.fuzz.scenes import NUMBERS, TRIANGLE, lines, problem
from veriray.errors import SceneError
from veriray.scene import Scene, load_file

_KEYS = (
    "newmtl a", "Kd", "Ks", "Ke", "Tf", "Ns", "Ni", "d", "Tr", "illum", "Pr", "Pm", "map_Kd",
    "map_d", "bump", "-s", "-o", "-clamp on", "-bm", "-mm", "-imfchan m", "-t", "input.mtl",
    "spectral", "xyz", "#",
)  # fmt: skip
_OBJ = b"mtllib input.mtl\n" + TRIANGLE + b"usemtl a\nf 1 2 3\nusemtl b\nf 3 2 1\n"


def _load(path: Path) -> Scene:
    return load_file(path.parent / "scene.obj")


TARGET = Target(
    ".mtl", _load, problem, (SceneError,), ("formats/obj_scene.py",), (*_KEYS, *NUMBERS), lines,
    {"scene.obj": _OBJ},
)  # fmt: skip
