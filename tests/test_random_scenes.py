"""Random valid scenes: no faults, the same bits in two ways, and the reference's mean.

25 scenes, always the same; with --slow, 400 others, new each time.
"""

from __future__ import annotations

from pathlib import Path
from typing import Any

import pytest

import veriray

pytest.importorskip("embreex", reason="the reference renderer needs embreex")
from hypothesis import HealthCheck, given, settings  # noqa: E402

from tests.random_scenes import against_the_reference, judge, scenes, write_meshes  # noqa: E402

COMMON: dict[str, Any] = {
    "deadline": None,
    "database": None,
    "suppress_health_check": [HealthCheck.too_slow, HealthCheck.data_too_large],
}
pytestmark = pytest.mark.filterwarnings("ignore::veriray.SceneWarning")


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("random_scenes")
    write_meshes(path)
    return path


@settings(max_examples=25, derandomize=True, **COMMON)
@given(text=scenes())
def test_random_scenes(folder: Path, text: str) -> None:
    judge(text, folder / "scene.xml")


@pytest.mark.slow
@settings(max_examples=400, **COMMON)
@given(text=scenes())
def test_many_random_scenes(folder: Path, text: str) -> None:
    judge(text, folder / "scene.xml")


def test_sees_a_planted_error(folder: Path) -> None:
    """A floor 2 % brighter than in the reference's file is found."""
    text = """<scene version="3.0.0"><integrator type="path"/>
        <sensor type="perspective"><float name="fov" value="60"/>
        <film type="hdrfilm"><integer name="width" value="6"/><integer name="height" value="6"/>
        <rfilter type="box"/></film></sensor>
        <shape type="cube"><boolean name="flip_normals" value="true"/>
        <bsdf type="diffuse"><rgb name="reflectance" value="RHO"/></bsdf>
        <emitter type="area"><rgb name="radiance" value="1"/></emitter></shape></scene>"""
    path = folder / "planted.xml"
    path.write_text(text.replace("RHO", "0.51"))
    scene = veriray.load_file(path)
    path.write_text(text.replace("RHO", "0.5"))
    assert against_the_reference(path, scene, 2, 4) < 1e-4
