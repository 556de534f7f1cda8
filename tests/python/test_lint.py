"""`veriray lint`: one bad scene for each rule, which is good without the fault; no false alarms."""

from __future__ import annotations

import json
import warnings
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import veriray as vr
from veriray.cli import main
from veriray.gallery import pictures
from veriray.linting import RULES
from veriray.shipped import SHIPPED

Shapes = dict[str, Any]
GREY = {"type": "twosided", "bsdf": {"type": "diffuse"}}
GLASS = {"type": "dielectric"}
TETRA = np.array([[0, 0, 0], [1, 0, 0], [0, 1, 0], [0, 0, 1]], float)
FACES = np.array([[0, 2, 1], [0, 1, 3], [0, 3, 2], [1, 2, 3]])


def at(*place: float, size: float = 1.0, down: bool = False) -> Any:
    x, y, z = place
    turn = -1.0 if down else 1.0
    return [[size, 0, 0, x], [0, turn * size, 0, y], [0, 0, turn * size, z], [0, 0, 0, 1]]


def scene(sensor: dict[str, Any] | None = None, sky: bool = True, **shapes: Any) -> vr.Scene:
    """Shapes on a floor of z = -1 seen from (0, -6, 3) under a sky of 1."""
    to_world = vr.Camera.look_at((0, -6, 3), (0, 0, 0), (0, 0, 1)).to_world
    film = {"type": "hdrfilm", "width": 32, "height": 32}
    eye = {"type": "perspective", "fov": 40.0, "to_world": to_world, "film": film}
    parts: Shapes = {"floor": plate(0, 0, -1, size=4.0), **shapes}
    if sky:
        parts["sky"] = {"type": "constant"}
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", vr.SceneWarning)
        return vr.load_dict({"type": "scene", "eye": {**eye, **(sensor or {})}, **parts})


def plate(*place: float, bsdf: Any = GREY, **more: Any) -> dict[str, Any]:
    size, down = more.pop("size", 1.0), more.pop("down", False)
    return {"type": "rectangle", "to_world": at(*place, size=size, down=down), "bsdf": bsdf, **more}


def body(faces: Any = FACES, **more: Any) -> dict[str, Any]:
    mesh = {"type": "mesh", "vertices": TETRA, "faces": np.asarray(faces)}
    return {**mesh, "bsdf": {"type": "diffuse"}, **more}


def ball(*place: float, radius: float = 0.5, **more: Any) -> dict[str, Any]:
    return {"type": "sphere", "center": list(place), "radius": radius, "bsdf": GREY, **more}


def fog(sigma_t: float = 1.0, albedo: Any = 0.5) -> dict[str, Any]:
    return {"type": "homogeneous", "sigma_t": sigma_t, "albedo": albedo}


def diffuse(value: Any) -> dict[str, Any]:
    return {"type": "twosided", "bsdf": {"type": "diffuse", "reflectance": value}}


def image(share: float) -> dict[str, Any]:
    texels = np.full((10, 10, 3), 0.4, np.float32)
    texels.reshape(100, 3)[: int(100 * share)] = 1.0
    return {"type": "bitmap", "data": texels, "raw": True}


SPOT = {"type": "spot", "cutoff_angle": 10.0}
AREA = {"type": "area", "radiance": 5.0}
THIN = {"type": "thinlens", "aperture_radius": 0.05}
PRINCIPLED = {"type": "principled", "base_color": {"type": "rgb", "value": 0.95}, "roughness": 0.9}
HALF = {"type": "rgb", "value": 0.5}


def spot(target: tuple[float, float, float]) -> dict[str, Any]:
    return {**SPOT, "to_world": vr.Camera.look_at((0, 0, 2), target).to_world}


#: Rule: the bad scene, the good one, and the key of what is found.
CASES: dict[str, tuple[Callable[[], vr.Scene], Callable[[], vr.Scene], str]] = {
    "changed": (
        lambda: scene(a=plate(0, 0, 0, bsdf=diffuse({"type": "spectrum", "value": 1.5}))),
        lambda: scene(a=plate(0, 0, 0, bsdf=diffuse({"type": "spectrum", "value": 0.5}))),
        "",
    ),
    "black-surface": (
        lambda: scene(a=ball(0, 0, 0, bsdf=diffuse(0.0))),
        lambda: scene(a=ball(0, 0, 0, bsdf=diffuse(0.01))),
        "a",
    ),
    "black-back": (
        lambda: scene(a=plate(0, 0, 0, bsdf={"type": "diffuse"}, down=True)),
        lambda: scene(a=plate(0, 0, 0, bsdf={"type": "diffuse"})),
        "a",
    ),
    "albedo": (
        lambda: scene(a=ball(0, 0, 0, bsdf=diffuse(1.0))),
        lambda: scene(a=ball(0, 0, 0, bsdf=diffuse(0.99))),
        "a",
    ),
    "albedo of a medium": (
        lambda: scene(a=ball(0, 0, 0, bsdf={"type": "null"}, interior=fog(1.0, 1.0))),
        lambda: scene(a=ball(0, 0, 0, bsdf={"type": "null"}, interior=fog(1.0, 0.99))),
        "medium 0",
    ),
    "energy": (
        lambda: scene(a=ball(0, 0, 0, bsdf={**PRINCIPLED, "sheen": 1.0, "clearcoat": 1.0})),
        lambda: scene(a=ball(0, 0, 0, bsdf={**PRINCIPLED, "base_color": HALF})),
        "a",
    ),
    "clipped-texture": (
        lambda: scene(a=plate(0, 0, 0, bsdf=diffuse(image(0.3)))),
        lambda: scene(a=plate(0, 0, 0, bsdf=diffuse(image(0.05)))),
        "texture 0",
    ),
    "open-body": (
        lambda: scene(a=body(FACES[:3], bsdf=GLASS)),
        lambda: scene(a=body(bsdf=GLASS)),
        "a",
    ),
    "open-body of a medium": (
        lambda: scene(a=body(FACES[:3], bsdf={"type": "null"}, interior=fog())),
        lambda: scene(a=body(bsdf={"type": "null"}, interior=fog())),
        "a",
    ),
    "open-body, a disk": (
        lambda: scene(a={"type": "disk", "bsdf": GLASS}),
        lambda: scene(a={"type": "disk", "bsdf": {"type": "thindielectric"}}),
        "a",
    ),
    "media": (
        lambda: scene(a=ball(0, 0, 0, bsdf={"type": "null"}, interior=fog(), radius=0.9),
                      b=ball(0, 0, 0, bsdf={"type": "null"}, interior=fog(2.0))),
        lambda: scene(a=ball(0, 0, 0, bsdf={"type": "null"}, interior={"type": "ref", "id": "f"},
                             radius=0.9), f={**fog(), "id": "f"},
                      b=ball(0, 0, 0, bsdf={"type": "null"}, interior=fog(2.0),
                             exterior={"type": "ref", "id": "f"})),
        "b",
    ),
    "flipped": (
        lambda: scene(a=body(FACES[:, ::-1], bsdf={"type": "diffuse"})),
        lambda: scene(a=body(bsdf={"type": "diffuse"})),
        "a",
    ),
    "flipped, one face": (
        lambda: scene(a=body([*FACES[:3], FACES[3, ::-1]])),
        lambda: scene(a=body(FACES[:, ::-1], bsdf=GREY)),
        "a",
    ),
    "flipped, a sphere": (
        lambda: scene(a=ball(0, 0, 0, bsdf=GLASS, flip_normals=True)),
        lambda: scene(a=ball(0, 0, 0, bsdf=GLASS)),
        "a",
    ),
    "duplicate": (
        lambda: scene(a=body(), b=body([FACES[1]])),
        lambda: scene(a=body(), b=body([FACES[1]], to_world=at(0.1, 0, 0))),
        "b",
    ),
    "duplicate, a sphere": (
        lambda: scene(a=ball(0, 0, 0), b=ball(0, 0, 0, bsdf=diffuse(0.2))),
        lambda: scene(a=ball(0, 0, 0), b=ball(0, 0, 0, radius=0.51)),
        "b",
    ),
    "touching": (
        lambda: scene(a=plate(0, 0, 0), b=plate(0.7, 0.5, 0, bsdf=diffuse(0.2))),
        lambda: scene(a=plate(0, 0, 0), b=plate(0.7, 0.5, 0.01, bsdf=diffuse(0.2))),
        "b",
    ),
    "degenerate": (
        lambda: scene(a=body([*FACES, [0, 1, 1]])),
        lambda: scene(a=body()),
        "a",
    ),
    "covered-lamp": (
        lambda: scene(b=plate(0, 0, 1e-6, size=0.9), a=plate(0, 0, 0, emitter=AREA)),
        lambda: scene(b=plate(0, 0, 0.1, size=0.5), a=plate(0, 0, 0, emitter=AREA)),
        "a",
    ),
    "dark-light, enclosed": (
        lambda: scene(a={"type": "point", "position": [0, 0, 0]}, b=ball(0, 0, 0)),
        lambda: scene(a={"type": "point", "position": [0, 0, 1]}, b=ball(0, 0, 0)),
        "a",
    ),
    "dark-light, past the scene": (
        lambda: scene(a=spot((0, 5, 8))), lambda: scene(a=spot((0, 0.1, -1))), "a",
    ),
    "dark-light, turned away": (
        lambda: scene(a=plate(0, 0, 5, emitter=AREA)),
        lambda: scene(a=plate(0, 0, 5, emitter=AREA, down=True)),
        "a",
    ),
    "no-light": (lambda: scene(sky=False), lambda: scene(sky=True), ""),
    "view": (
        lambda: scene({"to_world": vr.Camera.look_at((0, 0, 3), (0, 0, 9)).to_world}),
        scene, "",
    ),
    "clip": (lambda: scene({"far_clip": 5.0}), lambda: scene({"far_clip": 50.0}), ""),
    "lens": (
        lambda: scene({**THIN, "focus_distance": 0.005}),
        lambda: scene({**THIN, "focus_distance": 6.0}), "",
    ),
    "size": (
        lambda: scene({"to_world": vr.Camera.look_at((0, 0, 3e4), (0, 0, 0)).to_world}),
        lambda: scene({"to_world": vr.Camera.look_at((0, 0, 30), (0, 0, 0)).to_world}), "",
    ),
    "size of a medium": (
        lambda: scene(a=ball(0, 0, 0, bsdf={"type": "null"}, interior=fog(1e-6))),
        lambda: scene(a=ball(0, 0, 0, bsdf={"type": "null"}, interior=fog(1e-2))),
        "medium 0",
    ),
    "precision": (
        lambda: scene(a=plate(0, 0, 0), b=plate(0.7, 0.5, 1e-7)),
        lambda: scene(a=plate(0, 0, 0), b=plate(0.7, 0.5, 1e-4)), "",
    ),
}  # fmt: skip


@pytest.mark.parametrize("name", CASES)
def test_a_fault_is_found_and_its_absence_too(name: str) -> None:
    bad, good, key = CASES[name]
    rule = name.partition(",")[0].partition(" of ")[0]
    found = [f for f in vr.lint(bad()) if f.rule == rule]
    assert [f.key for f in found][:1] == [key], vr.lint(bad())
    assert all(f.text and f.reason for f in found)
    assert rule not in [f.rule for f in vr.lint(good())], str(vr.lint(good()))


def test_every_rule_has_a_bad_scene() -> None:
    assert {name.partition(",")[0].partition(" of ")[0] for name in CASES} == {*RULES}


def test_reasons_of_dark_lamps() -> None:
    def reason(name: str) -> str:
        (found,) = [f for f in vr.lint(CASES[name][0]()) if f.rule == "dark-light"]
        return found.reason

    assert "ends on b, which encloses it" in reason("dark-light, enclosed")
    assert "shines past the scene" in reason("dark-light, past the scene")


#: What the shipped scenes are found to have, all of it meant.
MEANT = {
    "curves.xml": {"degenerate"},  # control points that coincide
    "cylinders.xml": {"black-back"},  # open tubes show their inner sides
    "hair.xml": {"degenerate"},  # of the same curves
    "flip_normals.xml": {"flipped", "black-back"},  # shapes turned inside out on purpose
    "glass_cube.xml": {"flipped"},  # a cube turned inside out on purpose
    "orthographic.xml": {"black-back", "clip"},  # a far plane cuts a ball open
    "rayleigh_air.xml": {"albedo"},  # air takes no light of one colour
    "twosided.xml": {"black-back"},  # beside a two-sided one, for comparison
}


def shipped(root: Path) -> list[str]:
    checks = sorted((root / "scenes" / "checks").glob("*.xml"))
    return [*SHIPPED, *map(str, checks)]


def test_shipped_scenes_have_what_they_are_meant_to_have(root: Path) -> None:
    found = {}
    for name in shipped(root):
        with warnings.catch_warnings():
            warnings.simplefilter("ignore", vr.SceneWarning)
            rules = {f.rule for f in vr.lint(vr.load_file(name))}
        if rules:
            found[Path(name).name] = rules
    assert found == MEANT


@pytest.mark.parametrize("name", [p.name for p in pictures.PICTURES])
def test_the_gallery_is_clean(name: str, tmp_path: Path) -> None:
    meant = {"degenerate"} if name == "terrace" else set()  # the pole of its ball
    assert {f.rule for f in vr.lint(pictures.load(name, tmp_path))} == meant


def test_the_command(capsys: pytest.CaptureFixture[str], tmp_path: Path) -> None:
    assert main(["lint", "cornell-box"]) == 0
    assert capsys.readouterr().out == "no findings\n"
    text = (
        '<scene version="3.0.0">\n<sensor type="perspective"/>\n<emitter type="constant"/>\n'
        '<shape type="sphere" id="ball"><point name="center" z="9"/>\n'
        '<bsdf type="diffuse" id="coal"><rgb name="reflectance" value="0"/></bsdf></shape></scene>'
    )
    file = tmp_path / "dark.xml"
    file.write_text(text)
    assert main(["lint", str(file)]) == 1
    line = capsys.readouterr().out.splitlines()[0]
    assert line.startswith(f"{file}:5: black-surface: coal: reflectance is 0 (")
    assert main(["lint", str(file), "--json"]) == 1
    (finding,) = json.loads(capsys.readouterr().out)["findings"]
    assert finding["where"] == f"{file}:5" and finding["key"] == "coal"
    assert main(["lint", str(file), "--allow", "black-surface"]) == 0
    assert main(["lint", str(file), "--allow", "colour"]) == 2
    file.write_text(text.replace("diffuse", "difuse"))
    assert main(["lint", str(file)]) == 2
    assert "difuse" in capsys.readouterr().err


def test_only_scenes() -> None:
    with pytest.raises(TypeError, match="expected a Scene"):
        vr.lint("cornell-box")  # type: ignore[arg-type]


def test_a_dark_lamp_does_not_change_the_scene() -> None:
    made = CASES["dark-light, enclosed"][0]()
    before = made.sha256
    vr.lint(made)
    assert made.sha256 == before
