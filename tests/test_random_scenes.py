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


def lit(parts: str) -> str:
    """A scene of these shapes in front of the camera, under a lamp."""
    return f"""<scene version="3.0.0"><integrator type="path">
        <integer name="max_depth" value="6"/></integrator>
        <sensor type="perspective"><float name="fov" value="60"/>
        <film type="hdrfilm"><integer name="width" value="12"/><integer name="height" value="8"/>
        <rfilter type="box"/></film></sensor>{parts}<shape type="rectangle">
        <transform name="to_world"><rotate x="1" angle="90"/><translate y="2" z="3"/></transform>
        <emitter type="area"><rgb name="radiance" value="4"/></emitter></shape></scene>"""


def test_two_sides(folder: Path) -> None:
    """Another material on the back, of faces and of a ball that is seen from within."""
    parts = "".join(
        f'''<shape type="{kind}"><boolean name="flip_normals" value="{flip}"/>
        <transform name="to_world"><scale value="{size}"/><rotate y="1" angle="{angle}"/>
        <translate x="{x}" z="3"/></transform><bsdf type="twosided">
        <bsdf name="front" type="diffuse"><rgb name="reflectance" value="0.9 0.2 0.1"/></bsdf>
        <bsdf name="back" type="{back}"/></bsdf></shape>'''
        for kind, flip, size, angle, x, back in (
            ("rectangle", "false", 0.5, 30, -0.6, "plastic"),
            ("rectangle", "false", 0.5, 150, 0.6, "roughconductor"),
            ("sphere", "true", 0.3, 0, 0, "conductor"),
            ("sphere", "false", 6, 0, 0, "diffuse"),
        )
    )
    judge(lit(parts), folder / "sides.xml")


def test_three_in_one(folder: Path) -> None:
    """Blends in blends, and their shadows."""

    def blend(weight: float, first: str, second: str) -> str:
        first, second = (
            one.replace("<bsdf ", f'<bsdf name="{name}" ', 1)
            for name, one in (("first", first), ("second", second))
        )
        return f'''<bsdf type="blendbsdf"><float name="weight" value="{weight}"/>
            {first}{second}</bsdf>'''

    matt, glass, none, metal = (
        f'<bsdf type="{kind}"/>' for kind in ("diffuse", "thindielectric", "null", "roughconductor")
    )
    parts = "".join(
        f'''<shape type="rectangle"><transform name="to_world"><scale value="0.5"/>
        <rotate x="1" angle="{angle}"/><translate x="{x}" y="{y}" z="3"/></transform>{bsdf}
        </shape>'''
        for angle, x, y, bsdf in (
            (160, -0.6, -0.3, blend(0.6, matt, blend(0.3, metal, glass))),
            (160, 0.6, -0.3, blend(0.7, metal, blend(0.8, none, blend(0.5, matt, glass)))),
            (90, -0.6, 0.8, blend(0.7, none, blend(0.6, glass, matt))),
            (90, 0.6, 0.8, blend(0.2, matt, blend(0.4, none, metal))),
        )
    )
    room = """<shape type="sphere"><boolean name="flip_normals" value="true"/>
        <float name="radius" value="6"/></shape>"""
    judge(lit(parts + room), folder / "three.xml")


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
