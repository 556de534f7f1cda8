"""Mesh files: the body of the targets obj, ply, stl and serialized."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from tests.fuzz.contract import Target
from tests.fuzz.scenes import BESIDE, NUMBERS, lines, problem
from veriray.errors import SceneError
from veriray.formats import mesh
from veriray.numeric import MAX_COORDINATE
from veriray.scene import load_file


def target(kind: str, modules: tuple[str, ...], words: tuple[str, ...]) -> Target:
    """The target of a mesh format. A valid mesh must make a valid scene, or a SceneError."""
    scene = BESIDE["scene.xml"].replace(b"KIND", kind.encode())

    def load(path: Path) -> tuple[mesh.Mesh, Path]:
        index = path.stat().st_size % 3 if kind == "serialized" else 0
        return mesh.read(path, kind, "here", index), path.parent / "scene.xml"

    def valid(loaded: tuple[mesh.Mesh, Path]) -> str:
        found, path = loaded
        vertices, triangles = found.vertices, found.triangles
        if vertices.shape[1:] != (3,) or triangles.shape[1:] != (3,) or not len(triangles):
            return "its arrays have another shape"
        if not (np.abs(vertices) <= MAX_COORDINATE).all():
            return "a vertex is not finite"
        if triangles.min() < 0 or triangles.max() >= len(vertices):
            return "an index is out of range"
        if found.normals is not None and not np.isfinite(found.normals).all():
            return "a normal is not finite"
        if found.uv is not None and (found.uv.shape != (len(vertices), 2) or not
                                     np.isfinite(found.uv).all()):  # fmt: skip
            return "a texture coordinate is not finite"
        try:
            return problem(load_file(path))
        except SceneError:
            return ""

    return Target(
        f".{kind}", load, valid, (SceneError,), modules, (*words, *NUMBERS), lines,
        {"scene.xml": scene},
    )  # fmt: skip
