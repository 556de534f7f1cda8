"""The schema of the scene's arrays: generated files, and what a new column may change."""

from __future__ import annotations

import re
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

import veriray
from veriray import columns, scene_arrays
from veriray.columns import COLUMNS, MATERIAL_KINDS, TEXTURABLE, Column
from veriray.formats.plugins import PLUGINS, of_category

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
    monkeypatch.setitem(columns.COLUMNS, "polish", new)
    at_default, set_ = np.full(rows, 0.25), np.linspace(0.0, 1.0, rows)
    for copy, polish, same in zip(copies, (at_default, set_), (True, False), strict=True):
        object.__setattr__(copy, "polish", polish)
        assert (copy.sha256 == before) == same
    monkeypatch.setitem(columns.COLUMNS, "knots", Column("curves", np.float64, (3,)))
    for rows, hashed in ((0, False), (2, True)):  # of a new table: existing rows count, even zeros
        assert columns.hashed("knots", np.zeros((rows, 3))) == hashed


@pytest.mark.parametrize("name", ["hair_tilt", "hair_around", "clearcoat_gloss", "diff_trans"])
def test_route_of_a_number(name: str) -> None:
    """Its row, where its parameter is read, and closures: no file in between names it by hand."""
    generated = {"cpp/schema/columns.def", "cpp/schema/materials.def", "python/veriray/_native.pyi",
                 "python/veriray/scene_arrays.py"}  # fmt: skip
    found = set()
    for folder in ("cpp", "python/veriray"):
        for path in (ROOT / folder).rglob("*"):
            if path.suffix in (".py", ".pyi", ".h", ".cpp", ".cu", ".cuh", ".def"):
                if re.search(rf"\b{name}\b", path.read_text("utf-8")):
                    found.add(path.relative_to(ROOT).as_posix())
    assert found >= generated
    by_hand = {f for f in found - generated if not f.startswith("cpp/bsdfs/")}
    by_hand -= {"cpp/backends/bsdf_hooks.h"}  # of the tests
    by_hand -= {f"python/veriray/formats/{n}.py" for n in ("gltf_materials", "legacy_media")}
    assert by_hand <= {"python/veriray/columns.py", "python/veriray/formats/plugins.py",
                       "python/veriray/formats/fibres.py"}  # fmt: skip


def test_parameters_fill_columns() -> None:
    tables = {"bsdf": "materials", "phase": "media", "emitter": "lights", "texture": "textures"}
    # by what they hold, or computed
    filled = {"two_sided", "material_kind", "eta", "k", "alpha_u", "alpha_v", "distribution"}
    filled |= {"shadowing"}
    filled |= {"blend_material", *(f"{name}_texture" for name in (*TEXTURABLE, "relief"))}
    filled |= {"relief_heights", "relief_mirrored", "blend_sides"}
    filled |= {"hair_along", "hair_around", "hair_tilt"}
    for plugin in PLUGINS.values():
        for param in plugin.params.values():
            if param.column:
                assert COLUMNS[param.column].table == tables[plugin.category]
                filled.add(param.column)
    assert {name for name, column in COLUMNS.items() if column.table == "materials"} <= filled
    unpolarised = {"polarizer", "circular", "retarder", "pplastic"}
    own = set(MATERIAL_KINDS) - {*columns.OPEN_KINDS.values(), *columns.WHOLE_KINDS.values()}
    assert own | {"twosided", "mask", "blendbsdf", "bumpmap", "normalmap", *unpolarised} == set(
        of_category("bsdf")
    )


def test_a_new_number_of_a_material_is_a_column_and_a_parameter() -> None:
    code = """
import veriray.columns as c
c.COLUMNS["polish"] = c.Column("materials", c.np.float32, (), 0.25, 0.0, 1.0)
from veriray.formats import build, mitsuba_dict, plugins
plugins.PLUGINS["diffuse"].params["alpha"] = plugins.Param("float", 0.5, column="polish")
one, two = ({"type": "sphere", "m": {"type": kind, **given}}
            for kind, given in (("diffuse", {"alpha": 0.75}), ("conductor", {})))
scene = {"type": "scene", "s": {"type": "perspective", "fov": 40.0}, "one": one, "two": two}
print(build.build(lambda report: mitsuba_dict.read(scene, report)).arguments["polish"])
"""
    done = subprocess.run(
        [sys.executable, "-W", "ignore", "-c", code], capture_output=True, text=True
    )
    assert done.stdout.split("\n")[0] == "[0.75, 0.25]", done.stderr
