"""Renders with one native module and compares with a reference picture; prints JSON.

    python -m tests.mutation.judge MODULE FILE SCENE REFERENCE SEED [SHAPE FACTOR]

MODULE: name of the native CPU module that FILE replaces in this process. The settings are those of
the reference picture. SHAPE FACTOR: multiply the reflectance of one shape of the scene.
"""

from __future__ import annotations

import dataclasses
import importlib.util
import json
import sys

import numpy as np

import veriray
from veriray import image
from veriray.columns import COLUMNS
from veriray.device import CPU_MODULES


def use_module(name: str, file: str) -> str:
    """Puts the native module in `file` in the place of veriray's own; returns its device."""
    spec = importlib.util.spec_from_file_location(f"veriray.{name}", file)
    assert spec is not None and spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    sys.modules[f"veriray.{name}"] = module
    return "cpu:" + next(isa for isa, module in CPU_MODULES.items() if module == name)


def with_reflectance(scene: veriray.Scene, shape: str, factor: float) -> veriray.Scene:
    """The scene with one shape's reflectance scaled."""
    own = scene.triangle_shape == scene.shape_names.index(shape)
    material = np.array(scene.triangle_material)
    columns = {name: getattr(scene, name) for name, c in COLUMNS.items() if c.table == "materials"}
    rows = {name: np.concatenate([c, c[material[own][:1]]]) for name, c in columns.items()}
    material[own] = len(scene.reflectance)
    rows["reflectance"][-1] *= np.float32(factor)
    return dataclasses.replace(scene, **rows, triangle_material=material)


def main(arguments: list[str]) -> None:
    """Command line."""
    name, file, path, reference_path, seed, *edit = arguments
    device = use_module(name, file)
    scene = veriray.load_file(path)
    if edit:
        scene = with_reflectance(scene, edit[0], float(edit[1]))
    reference = image.load(reference_path)
    assert reference.batch_means is not None
    render = veriray.render(
        scene, spp=reference.spp, seed=int(seed), device=device,
        batches=len(reference.batch_means), width=reference.width, height=reference.height,
        max_depth=reference.stats["max_depth"], rr_depth=reference.stats["rr_depth"],
    )  # fmt: skip
    report = veriray.compare(render, reference)
    p = {t.name: t.p for t in report.tests if t.p is not None}
    answer = {
        "result": report.result,
        "failed": [t.name for t in report.tests if t.result == "fail"],
        "smallest_p": min(p.values(), default=None),
        "mean_ratio": (render.image.mean(axis=(0, 1), dtype=float)
                       / reference.image.mean(axis=(0, 1), dtype=float)).tolist(),
    }  # fmt: skip
    print(json.dumps(answer))


if __name__ == "__main__":
    main(sys.argv[1:])
