"""A new closure is added to a copy of the sources, as CONTRIBUTING says, and works."""

from __future__ import annotations

import json
import os
import shutil
import subprocess
import sys
from pathlib import Path

import pytest

import veriray

ROOT = Path(__file__).resolve().parents[2]
MOCK = ROOT / "tests" / "mock_closure" / "phong.h"

#: What is written by hand: file -> (text there, text instead), or all of a new file.
EDITS: dict[str, list[tuple[str, str]] | str] = {
    "cpp/bsdfs/phong.h": MOCK.read_text("utf-8"),
    "cpp/bsdfs/closures.def": [
        ('#include "bsdfs/null.h"\n', '#include "bsdfs/null.h"\n#include "bsdfs/phong.h"\n'),
        ("X(Null)", "X(Null) X(Phong)"),
    ],
    "python/veriray/columns.py": [
        ('    "null": MaterialKind(),\n', '    "null": MaterialKind(),\n'
         '    "phong": MaterialKind(opaque=True),\n'),
        ("_HASHED_IF_SET: dict[str, Column] = {\n",
         "_HASHED_IF_SET: dict[str, Column] = {\n"
         '    "exponent": Column("materials", np.float32, (), 1.0, 0.0, 1e4),\n'),
    ],
    "python/veriray/formats/plugins.py": [
        ('    "null": Plugin("bsdf"', '    "phong": Plugin("bsdf", {"specular_reflectance": '
         '_SPECULAR, "exponent": Param("float", 30.0, 0.0, 1e4, column="exponent"), '
         '"reflectance": Param(COLOUR, 0.5, **_SHARE, column="reflectance")}),\n'
         '    "null": Plugin("bsdf"'),
    ],
}  # fmt: skip

#: Seen from inside a lamp and under a sky of the same radiance a ball looks the same; the lamp is
#: sampled, the sky is not.
RENDER = """
import json, sys
import numpy as np
import veriray as vr

def ball(light, exponent, base=0.3):
    bsdf = {"type": "phong", "exponent": exponent, "specular_reflectance": 0.7,
            "reflectance": base}
    film = {"type": "hdrfilm", "width": 16, "height": 16}
    eye = [[-1, 0, 0, 0], [0, 1, 0, 0], [0, 0, -1, 4], [0, 0, 0, 1]]  # from z = 4 to the centre
    camera = {"type": "perspective", "fov": 25.0, "to_world": eye, "film": film}
    return vr.render(vr.load_dict({"type": "scene", "camera": camera, "light": light,
                     "ball": {"type": "sphere", "bsdf": bsdf}}), spp=1024)

sky = {"type": "constant", "radiance": 1.0}
lamp = {"type": "sphere", "radius": 50.0, "flip_normals": True,
        "bsdf": {"type": "diffuse", "reflectance": 0.0},
        "emitter": {"type": "area", "radiance": 1.0}}
off = []
for exponent in (1.0, 30.0, 1000.0):
    a, b = ball(sky, exponent), ball(lamp, exponent)
    error = np.hypot(np.sqrt((a.stderr**2).sum()), np.sqrt((b.stderr**2).sum()))
    off.append(float((a.image - b.image).sum() / error))
sharp = ball(sky, 1e4, 0.0).image
box = vr.cornell_box()
print(json.dumps({"off": off, "sharp": float(sharp[2:14, 2:14].mean()), "scene": box.sha256,
                  "film": vr.render(box, spp=4, width=32, height=32).film_sha256}))
"""


def planted(source: Path) -> None:
    for name, edits in EDITS.items():
        if isinstance(edits, str):
            (source / name).write_text(edits)
            continue
        text = (ROOT / name).read_text("utf-8")
        for old, new in edits:
            assert text.count(old) == 1, f"{name}: {old!r}"
            text = text.replace(old, new)
        (source / name).write_text(text)


def test_edits_are_few_and_fit(tmp_path: Path) -> None:
    assert len(EDITS) <= 4
    for name in EDITS:
        (tmp_path / name).parent.mkdir(parents=True, exist_ok=True)
    planted(tmp_path)


@pytest.mark.slow
def test_mock_closure(tmp_path: Path) -> None:
    """A ball of two lobes is lit alike by a sky and by a lamp, |z| < 5 for three sums.

    One that is nearly a mirror shows its reflectance; the box is as ever. False alarm: 3e-6.
    """
    ignored = shutil.ignore_patterns("*.so", "__pycache__", "references")
    for name in ("cpp", "python", "scenes"):
        shutil.copytree(ROOT / name, tmp_path / name, ignore=ignored)
    shutil.copy(ROOT / "CMakeLists.txt", tmp_path)
    (tmp_path / "docs").mkdir()
    planted(tmp_path)
    module = veriray.device.select("cpu")[0].native.__name__.rpartition(".")[2]
    path = os.pathsep.join([str(Path(sys.executable).parent), os.environ["PATH"]])
    environment = {**os.environ, "PATH": path, "PYTHONPATH": str(tmp_path / "python")}

    def call(*words: object) -> str:
        done = subprocess.run([str(w) for w in words], cwd=tmp_path, env=environment,
                              capture_output=True, text=True)  # fmt: skip
        assert done.returncode == 0, done.stdout[-3000:] + done.stderr[-3000:]
        return done.stdout

    call(sys.executable, "cpp/schema/generate.py")
    call("cmake", "-S", ".", "-B", "build", "-G", "Ninja", "-DVERIRAY_CPU=all", "-DVERIRAY_CUDA=0",
         f"-DPython_EXECUTABLE={sys.executable}",
         f"-DVERIRAY_OUTPUT_DIRECTORY={tmp_path / 'python' / 'veriray'}")  # fmt: skip
    call("cmake", "--build", "build", "--target", module)
    (tmp_path / "python" / "veriray" / "scenes").symlink_to(tmp_path / "scenes")
    found = json.loads(call(sys.executable, "-c", RENDER))
    assert max(abs(z) for z in found["off"]) < 5
    assert abs(found["sharp"] - 0.7) < 0.01  # 5 standard errors
    box = veriray.cornell_box()
    assert found["scene"] == box.sha256
    assert found["film"] == veriray.render(box, spp=4, width=32, height=32).film_sha256
