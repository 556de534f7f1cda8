# ruff: noqa: E501 (the tables of scenes)
"""What scene files of others have: search folders, several sensors, notes, all faults at once."""

from __future__ import annotations

import json
import os
import re
import warnings
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from PIL import Image

import veriray as vr
from veriray.cli import main
from veriray.errors import SceneError, SceneWarning
from veriray.formats import convert, known, mitsuba_dict
from veriray.formats.plugins import CATEGORIES, PLUGINS
from veriray.formats.report import MAX_FAULTS
from veriray.formats.write import as_xml
from veriray.shipped import SHIPPED
from veriray.transform import any_up, look_at

SKY = '<emitter type="constant"/>'
LAMP = '<shape type="rectangle" id="lamp"><emitter type="area"/></shape>'
POINT = '<emitter type="point"><point name="position" z="3"/></emitter>'
FILM = '<film type="hdrfilm"><integer name="width" value="8"/><integer name="height" value="6"/>{}</film>'
SENSOR = f'<sensor type="perspective"><float name="fov" value="40"/>{FILM}{{}}</sensor>'
VIEW = SENSOR.format("", "")
TRIANGLE = "v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 3\n"
OBJ = '<shape type="obj"><string name="filename" value="{}"/></shape>'


def param(kind: str, name: str, value: object) -> str:
    return f'<{kind} name="{name}" value="{value}"/>'


def write(path: Path, *lines: str) -> Path:
    path.write_text('<scene version="3.0.0">\n' + "\n".join(lines) + "\n</scene>\n", "utf-8")
    return path


def loaded(folder: Path, *lines: str, **options: Any) -> vr.Scene:
    return vr.load_file(write(folder / "scene.xml", *lines), **options)


def fault(folder: Path, *lines: str, **options: Any) -> SceneError:
    with pytest.raises(SceneError) as caught:
        loaded(folder, *lines, **options)
    assert type(caught.value) is SceneError
    assert caught.value.faults[0] in str(caught.value) or len(str(caught.value)) > 1900
    return caught.value


# ---- files and names ---------------------------------------------------------------------------


def test_search_folders_come_before_the_file_and_the_last_one_first(tmp_path: Path) -> None:
    for number, name in enumerate(("one", "two", "")):
        folder = tmp_path / "assets" / name if name else tmp_path / "scenes"
        folder.mkdir(parents=True)
        (folder / "a.obj").write_text(TRIANGLE.replace("v 1 0 0", f"v {number + 2} 0 0"))
    (tmp_path / "assets/one/b.obj").write_text(TRIANGLE)
    (tmp_path / "assets/one/part.xml").write_text(
        OBJ.format("b.obj").replace(">", ' version="3.0.0">', 1)
    )
    place = tmp_path / "scenes"
    folders = '<path value="../assets/one"/>', '<path value="../assets/two"/>'
    for paths, width in (((), 4.0), (folders[:1], 2.0), (folders, 3.0), (folders[::-1], 2.0)):
        assert loaded(place, VIEW, SKY, *paths, OBJ.format("a.obj")).vertices.max() == width
    scene = loaded(
        place, VIEW, SKY, *folders, '<include filename="part.xml"/>', OBJ.format("b.obj")
    )
    assert len(scene.triangles) == 2 and not scene.notes
    assert "cannot read" in str(fault(place, VIEW, SKY, folders[1], OBJ.format("b.obj")))
    (note,) = loaded(place, VIEW, '<path value="nowhere"/>', OBJ.format("a.obj"), SKY).notes
    assert note.endswith('scene.xml:3: <path>: "nowhere" is no folder; nothing is looked for')


def test_folders_of_an_included_file_end_with_it(tmp_path: Path) -> None:
    (tmp_path / "assets").mkdir()
    (tmp_path / "assets/a.obj").write_text(TRIANGLE)
    write(tmp_path / "part.xml", '<path value="assets"/>', OBJ.format("a.obj"))
    assert loaded(tmp_path, VIEW, SKY, '<include filename="part.xml"/>').triangles.shape == (1, 3)
    assert "cannot read" in str(
        fault(tmp_path, VIEW, SKY, '<include filename="part.xml"/>', OBJ.format("a.obj"))
    )


def test_an_included_object_has_the_name_that_its_place_gives(tmp_path: Path) -> None:
    medium = (
        '<medium version="3.0.0" type="homogeneous"><float name="albedo" value="0.1"/></medium>'
    )
    (tmp_path / "fog.xml").write_text(medium)
    ball = '<shape type="sphere"><include filename="fog.xml" name="interior"/></shape>'
    scene = loaded(tmp_path, VIEW, SKY, ball)
    assert scene.boundaries.tolist() == [[0, -1]]


def test_names_with_dollars_and_defaults(tmp_path: Path) -> None:
    # the longest known name that the text begins with, as in Mitsuba
    lines = (
        '<default name="size" value="3"/>', '<default name="kind" value="perspective"/>',
        '<sensor type="$kind"><default name="fov" value="30"/><float name="fov" value="$fov"/>'
        '<film type="hdrfilm"><integer name="width" value="$size2"/>'
        '<integer name="height" value="${size}1"/></film></sensor>',
        '<bsdf type="diffuse" id="\\$a"/>', '<shape type="cube"><ref id="\\$a"/></shape>', SKY,
    )  # fmt: skip
    scene = loaded(tmp_path, *lines)
    assert (scene.film.width, scene.film.height, scene.camera.fov) == (32, 31, 30.0)
    assert loaded(tmp_path, *lines, parameters={"fov": 50}).camera.fov == 50.0


UNSET = "$none"


@pytest.mark.parametrize(
    ("line", "kept", "fragment"),
    [
        (SENSOR.format("", f'<sampler type="independent">{param("integer", "sample_count", UNSET)}</sampler>'), {"spp": 4}, '"sample_count" of independent takes its default'),
        (VIEW.replace('"8"', f'"{UNSET}"'), {"film.width": 768}, '"width" of hdrfilm takes its default'),
        (SENSOR.format(f'<rfilter type="tent">{param("float", "radius", UNSET)}</rfilter>', ""), {"film.filter_parameter": 1.0}, '"radius" of tent takes its default'),
        (SENSOR.format(f'<rfilter type="{UNSET}"/>', ""), {"film.filter": "gaussian"}, "the rfilter is gaussian"),
        (SENSOR.format("", f'<sampler type="a{UNSET}"/>'), {"sampler": "sobol"}, "the sampler is independent"),
        (VIEW.replace("hdrfilm", UNSET), {"film.width": 8}, "the film is hdrfilm"),
        (VIEW + f'<integrator type="{UNSET}">{param("integer", "max_depth", 3)}</integrator>', {"max_depth": 3}, "the integrator is path"),
    ],
)  # fmt: skip
def test_parameters_without_a_value_that_change_no_light(
    tmp_path: Path, line: str, kept: dict[str, Any], fragment: str
) -> None:
    scene = loaded(tmp_path, SKY, line)
    ((name, value),) = kept.items()
    found: Any = scene
    for part in name.split("."):
        found = getattr(found, part)
    assert found == value
    (note,) = scene.notes
    assert note.startswith(f'{tmp_path}/scene.xml:3: parameter "$none" has no value; give it by -D')
    assert note.endswith(fragment)
    assert str(fault(tmp_path, SKY, line, strict=True)).startswith(note)


@pytest.mark.parametrize(
    "line",
    [
        f'<integrator type="path">{param("integer", "max_depth", UNSET)}</integrator>',
        f'<emitter type="point">{param("rgb", "intensity", UNSET)}</emitter>',
        f'<emitter type="{UNSET}"/>',
        f'<sensor type="perspective">{param("float", "fov", UNSET)}</sensor>',
        f'<sensor type="{UNSET}"/>',
        f'<sensor type="perspective" id="{UNSET}"/>',
        f'<sampler type="independent" id="{UNSET}"/>',
        f'<include filename="{UNSET}"/>',
    ],
)
def test_other_parameters_without_a_value_are_faults(tmp_path: Path, line: str) -> None:
    assert 'parameter "$none" has no value' in str(fault(tmp_path, VIEW, SKY, line))


def test_a_parameter_that_is_given_is_never_the_default(tmp_path: Path) -> None:
    sampler = f'<sampler type="$kind">{param("integer", "sample_count", "$n")}</sampler>'
    scene = loaded(
        tmp_path, SKY, SENSOR.format("", sampler), parameters={"n": 9, "kind": "stratified"}
    )
    assert (scene.spp, scene.sampler, scene.notes) == (9, "sobol", ())


def test_parameters_are_keywords_too(tmp_path: Path) -> None:
    view = VIEW.replace('value="8"', 'value="$size"')
    assert view != VIEW
    write(tmp_path / "scene.xml", view, SKY)
    path = tmp_path / "scene.xml"
    assert vr.load_file(path, size=5).sha256 == vr.load_file(path, {"size": "5"}).sha256
    with pytest.raises(vr.SceneError, match="^size is given twice: in parameters and as a keyword"):
        vr.load_file(path, {"size": 5}, size=5)
    with pytest.raises(vr.SceneError, match="sise"):
        vr.load_file(path, size=5, sise=6)


def test_what_is_given_twice(tmp_path: Path) -> None:
    film = VIEW.replace("</film>", param("integer", "height", 7) + "</film>")
    scene = loaded(tmp_path, SKY, film)
    assert (scene.film.width, scene.film.height) == (8, 7)  # the last, as in Mitsuba 2
    (note,) = scene.notes
    assert f'"height" is given twice, first at {tmp_path}/scene.xml:3; the last counts' in note
    grey = param("rgb", "reflectance", "0.1 0.2 0.3")
    cube = '<shape type="cube"><bsdf type="diffuse">{}{}</bsdf></shape>'
    (note,) = loaded(tmp_path, VIEW, SKY, cube.format(grey, grey)).notes
    assert "the last counts" in note
    for other in (grey.replace("0.3", "0.4"), param("float", "reflectance", 0.1)):
        assert "given twice" in str(fault(tmp_path, VIEW, SKY, cube.format(grey, other)))


def test_an_included_file_finds_files_beside_the_scene(tmp_path: Path) -> None:
    for folder in ("scene/parts", "common/parts"):
        (tmp_path / folder).mkdir(parents=True)
    write(tmp_path / "scene/parts/base.xml", '<include filename="parts/first.xml"/>', VIEW,
          '<include filename="parts/second.xml"/>', OBJ.format("a.obj"))  # fmt: skip
    write(tmp_path / "scene/parts/first.xml", '<default name="n" value="1"/>')
    write(tmp_path / "common/parts/second.xml", SKY)  # in the folder of the scene's <path>
    (tmp_path / "scene/a.obj").write_text(TRIANGLE)
    scene = loaded(
        tmp_path / "scene", '<path value="../common"/>', '<include filename="parts/base.xml"/>'
    )
    assert len(scene.triangles) == 1 and not scene.notes


def test_the_working_directory_is_searched_last(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    (tmp_path / "scenes").mkdir()
    (tmp_path / "meshes").mkdir()
    (tmp_path / "meshes/a.obj").write_text(TRIANGLE)
    here = OBJ.format("meshes/a.obj")
    assert "cannot read" in str(fault(tmp_path / "scenes", VIEW, SKY, here))
    monkeypatch.chdir(tmp_path)
    (note,) = loaded(tmp_path / "scenes", VIEW, SKY, here).notes
    assert note.endswith('scene.xml:4: "meshes/a.obj" is found in the working directory')
    assert not loaded(Path(), VIEW, SKY, here).notes  # it is the scene's folder, too
    back = here.replace("/a", "\\a")
    (note,) = loaded(Path(), VIEW, SKY, back).notes
    assert note.endswith('"meshes\\a.obj" is read as "meshes/a.obj"')
    (tmp_path / "scenes/meshes").mkdir()
    (tmp_path / "scenes/meshes/a.obj").write_text(TRIANGLE.replace("v 1 0 0", "v 5 0 0"))
    scene = loaded(tmp_path / "scenes", VIEW, SKY, here)
    assert scene.vertices.max() == 5.0 and not scene.notes
    assert len(loaded(tmp_path / "scenes", VIEW, SKY, here, back).notes) == 1
    (tmp_path / "scenes/meshes\\a.obj").write_text(TRIANGLE.replace("v 1 0 0", "v 7 0 0"))
    scene = loaded(tmp_path / "scenes", VIEW, SKY, back)  # a name of its own
    assert scene.vertices.max() == 7.0 and not scene.notes


@pytest.mark.parametrize("version", ["1.0", "2.0.0", "x"])
def test_the_declaration_of_an_xml_file_is_not_read(tmp_path: Path, version: str) -> None:
    path = write(tmp_path / "scene.xml", VIEW, SKY, '<shape type="torus"/>')
    text = path.read_text("utf-8")
    path.write_text(f'<?xml version="{version}"\n encoding="latin-1"?>\n{text}', "utf-8")
    with pytest.raises(SceneError, match="scene.xml:6: unknown shape"):
        vr.load_file(path)
    path.write_text(path.read_text("utf-8").replace("torus", "cube"), "utf-8")
    assert len(vr.load_file(path).triangles) == 12


def test_a_later_version_is_read_and_said(tmp_path: Path) -> None:
    path = write(tmp_path / "scene.xml", VIEW, SKY, '<shape type="cube"/>')
    path.write_text(path.read_text("utf-8").replace("3.0.0", "4.0.0"), "utf-8")
    (note,) = vr.load_file(path).notes
    assert note.endswith('version "4.0.0" is read as 3.x.x')


def test_the_sign_of_a_metals_index_does_not_count(tmp_path: Path) -> None:
    metal = '<shape type="cube"><bsdf type="conductor">{}{}</bsdf></shape>'
    plain, signed = (
        metal.format(param("rgb", "eta", eta), param("rgb", "k", k))
        for eta, k in (("0.1 1 2", "3 2 1"), ("-0.1 1 -2", "3 -2 1"))
    )
    with pytest.warns(SceneWarning, match=r"scene.xml:3: .*only its square counts; rendered as"):
        scene = loaded(tmp_path, VIEW, signed, SKY)
    assert scene.sha256 == loaded(tmp_path, VIEW, plain, SKY).sha256
    assert len(scene.notes) == 2
    assert "an error by strict" in str(fault(tmp_path, VIEW, signed, SKY, strict=True))
    assert "outside" in str(fault(tmp_path, VIEW, plain.replace("0.1", "1e7"), SKY))


def test_alias(tmp_path: Path) -> None:
    red = '<bsdf type="diffuse" id="red"><rgb name="reflectance" value="0.5 0 0"/></bsdf>'
    lines = (
        red,
        '<alias id="red" as="wall"/>',
        '<shape type="cube"><ref id="wall"/></shape>',
        SKY,
        VIEW,
    )
    assert loaded(tmp_path, *lines).reflectance.tolist() == [[0.5, 0.0, 0.0]]


def test_a_key_of_a_dictionary_is_a_second_name() -> None:
    """As in Mitsuba, whose references to objects with an id of their own take either."""
    grey = {"type": "diffuse", "id": "own", "reflectance": 0.25}
    for name in ("own", "key"):
        ball = {"type": "sphere", "bsdf": {"type": "ref", "id": name}}
        scene = vr.load_dict(
            {"type": "scene", "key": grey, "ball": ball, "sky": {"type": "constant"}}
        )
        assert np.allclose(scene.albedo, 0.25), name


def test_references_at_top_level(tmp_path: Path) -> None:
    """One to what the scene holds already counts once, one to a part of something adds it."""
    cube = '<shape type="cube" id="box"><bsdf type="diffuse" id="grey"/></shape>'
    plain = loaded(tmp_path, VIEW, SKY, cube)
    scene = loaded(tmp_path, VIEW, SKY, cube, '<ref id="box"/><ref id="grey"/>')
    assert scene.sha256 == plain.sha256
    (note,) = scene.notes
    assert note.endswith('scene.xml:5: ref: "box" is a part of the scene already; it counts once')
    inner = '<integrator type="moment"><integrator type="path" id="p"><integer name="max_depth" value="3"/></integrator></integrator>'
    assert "has 2 objects of category integrator" in str(
        fault(tmp_path, VIEW, SKY, inner, '<ref id="p"/>')
    )
    content = {
        "type": "scene",
        "v": {"type": "perspective", "fov": 40},
        "sky": {"type": "constant"},
    }
    scene = vr.load_dict({**content, "again": {"type": "ref", "id": "sky"}})
    assert scene.notes == (
        'scene.again: ref: "sky" is a part of the scene already; it counts once',
    )


@pytest.mark.parametrize(
    ("origin", "target", "expected"),
    [  # Mitsuba 3.9.1, scalar_rgb, float32
        ((0, 0, 5), (0, 0, 0), [[0, 1, 0], [1, 0, 0], [0, 0, -1]]),
        ((1, 2, 5), (0, 0, 0), [[-0.034851629, 0.98257416, -0.18257418], [0.93029672, -0.034851629, -0.36514837], [-0.36514837, -0.18257418, -0.91287094]]),
    ],
)  # fmt: skip
def test_lookat_without_up(tmp_path: Path, origin: Any, target: Any, expected: Any) -> None:
    view = VIEW.replace(
        "</sensor>",
        '<transform name="to_world"><lookat origin="{}" target="{}"{}/></transform></sensor>',
    )
    words = [" ".join(map(str, v)) for v in (origin, target)]
    for up in ("", ' up="0 0 0"'):
        matrix = loaded(tmp_path, SKY, view.format(*words, up)).camera.to_world
        assert np.array_equal(matrix, look_at(origin, target, any_up(origin, target)))
        assert np.abs(matrix[:3, :3] - expected).max() < 1e-6


def test_rotation_about_an_axis_that_is_not_of_unit_length(tmp_path: Path) -> None:
    """Mitsuba's matrix for points: a shear. Its normals do not follow, hence the warning."""
    turned = (
        '<shape type="cube"><transform name="to_world"><rotate {} angle="30"/></transform></shape>'
    )
    with pytest.warns(SceneWarning, match="it shears"):
        scene = loaded(tmp_path, VIEW, SKY, turned.format('y="1" z="1"'))
    expected = [[0.8660254, -0.5, 0.5], [0.5, 1.0, 0.13397461], [-0.5, 0.13397461, 1.0]]
    corner = scene.vertices[0] @ np.linalg.inv(expected).T
    assert np.abs(np.abs(corner) - 1).max() < 1e-6 and "it shears" in scene.notes[0]
    assert not loaded(tmp_path, VIEW, SKY, turned.format('z="1"')).notes


def test_catmullrom_is_a_mitchell_filter(tmp_path: Path) -> None:
    mitchell = param("float", "B", 0) + param("float", "C", 0.5)
    one, other = (
        loaded(tmp_path, SKY, SENSOR.format(f"<rfilter type={text}</rfilter>", ""))
        for text in ('"catmullrom">', f'"mitchell">{mitchell}')
    )
    assert one.sha256 == other.sha256 and not one.notes


def test_lanczos_has_its_lobes(tmp_path: Path) -> None:
    films = []
    for text in ("", param("integer", "lobes", 3), param("integer", "lobes", 5)):
        lanczos = SENSOR.format(f'<rfilter type="lanczos">{text}</rfilter>', "")
        scene = loaded(tmp_path, SKY, lanczos)
        assert not scene.notes
        films.append((scene.film.filter, scene.film.filter_parameter, scene.sha256))
    assert films[0] == films[1] == ("lanczos", 3.0, films[1][2])
    assert films[2][1] == 5.0 and films[2][2] != films[1][2]


# ---- sensors -----------------------------------------------------------------------------------


def test_one_of_several_sensors(tmp_path: Path, capsys: Any) -> None:
    views = VIEW, VIEW.replace("40", "50").replace('"8"', '"16"')
    first, second = (loaded(tmp_path, SKY, LAMP, view) for view in views)
    scene = loaded(tmp_path, SKY, LAMP, *views)
    assert scene.sha256 == first.sha256 and [c.fov for c in scene.cameras] == [40.0, 50.0]
    assert "the first of 2 sensors is rendered" in scene.notes[0]
    other = loaded(tmp_path, SKY, LAMP, *views, sensor=1)
    assert other.sha256 == second.sha256 and other.film.width == 16 and not other.notes
    assert first.cameras == (first.camera,)
    assert [c.to_world[2, 3] for c in loaded(tmp_path, SKY, LAMP, *views).scaled(2.0).cameras] == [
        0,
        0,
    ]
    text = str(fault(tmp_path, SKY, *views, sensor=2))
    assert text.endswith("scene.xml:1: sensor = 2 is outside [0, 1]")
    path = str(write(tmp_path / "scene.xml", SKY, LAMP, *views))
    assert main(["info", path, "--sensor", "1", "--json", "--device", "cpu"]) == 0
    report = json.loads(capsys.readouterr().out)
    assert (report["width"], report["cameras"], report["scene_sha256"]) == (16, 2, second.sha256)
    with pytest.raises(SceneError, match="sensor = -1 is outside"):
        vr.load_file(path, sensor=-1)


def test_a_batch_is_its_sensors(tmp_path: Path) -> None:
    inner = [
        f'<sensor type="perspective">{param("float", "fov", fov)}{FILM.format("")}'
        f'<sampler type="independent">{param("integer", "sample_count", 7)}</sampler></sensor>'
        for fov in (30, 50, 70)
    ]
    film = FILM.replace('"8"', '"24"').format('<rfilter type="box"/>')
    sampler = f'<sampler type="independent">{param("integer", "sample_count", 3)}</sampler>'
    batch = f'<sensor type="batch">{"".join(inner)}{film}{sampler}</sensor>'
    scene = loaded(tmp_path, SKY, batch)
    assert [c.fov for c in scene.cameras] == [30.0, 50.0, 70.0] and scene.spp == 3
    assert (scene.film.width, scene.film.height, scene.film.filter) == (8, 6, "box")
    assert "its 3 sensors are sensors of the scene, 8 pixels wide each" in scene.notes[0]
    assert loaded(tmp_path, SKY, batch, sensor=2).camera.fov == 70.0
    assert len(loaded(tmp_path, SKY, VIEW, batch, VIEW).cameras) == 5
    for old, new, message in (
        ('"24"', '"25"', "the film's width = 25 is not a multiple of its 3 sensors"),
        (
            sampler,
            sampler.replace("sampler", "film").replace("independent", "hdrfilm"),
            "at most 1",
        ),
        ('"24"/>', '"24"/>' + param("integer", "crop_width", 4), "a crop window is not supported"),
    ):
        assert message in str(fault(tmp_path, SKY, batch.replace(old, new)))
    assert "has no sensor" in str(fault(tmp_path, SKY, '<sensor type="batch"/>'))


def test_no_sensor_frames_the_scene(tmp_path: Path) -> None:
    """All corners are seen, and the largest side fills the picture's width at the front."""
    ball = (
        '<shape type="sphere"><point name="center" x="3"/><float name="radius" value="2"/></shape>'
    )
    scene = loaded(tmp_path, SKY, '<shape type="cube"/>', ball)  # x in [-1, 5], y, z in [-2, 2]
    assert scene.camera.fov == 45.0 and "one was placed that frames it" in scene.notes[0]
    place = scene.camera.to_world[:3, 3]
    assert place[:2].tolist() == [2.0, 0.0]
    assert abs((-2 - place[2]) * np.tan(np.radians(22.5)) - 3.0) < 1e-12
    assert "scene has no sensor; allowed: perspective" in str(fault(tmp_path, SKY))


def test_sensor_without_fov_has_50_mm(tmp_path: Path) -> None:
    bare = VIEW.replace('<float name="fov" value="40"/>', "").replace('"6"', '"4"')
    camera = loaded(tmp_path, SKY, bare).camera
    angle = np.degrees(2 * np.arctan(camera.tan_half_x(8, 4)))
    assert abs(angle - 42.31171417236328) < 1e-5  # Mitsuba 3.9.1: x_fov of an 8 x 4 film


CROP = "".join(
    f'<integer name="crop_{name}" value="{n}"/>'
    for name, n in (("width", 20), ("height", 10), ("offset_x", 30), ("offset_y", 5))
)


@pytest.mark.parametrize(
    ("offset", "first", "last"),
    [  # local directions of the corners, z = 1: Mitsuba 3.9.1, perspective, fov 60, film 80 x 40
        ("", (0.1443376, 0.21650636), (-0.1443375, 0.0721688)),
        ('<float name="principal_point_offset_x" value="0.1"/>', (0.02886755, 0.21650636), (-0.25980753, 0.0721688)),
    ],
)  # fmt: skip
def test_crop_window(tmp_path: Path, offset: str, first: Any, last: Any) -> None:
    view = SENSOR.format(CROP, offset).replace('"8"', '"80"').replace('"6"', '"40"')
    scene = loaded(tmp_path, SKY, view.replace('value="40"/><film', 'value="60"/><film'))
    camera, film = scene.camera, scene.film
    assert (film.width, film.height) == (20, 10)
    x, y = camera.tan_half_x(20, 10), camera.tan_half_y(20, 10)
    dx, dy = camera.principal_point_offset
    for u, expected in ((0, first), (1, last)):
        got = x * (1 - 2 * (u + dx)), y * (1 - 2 * (u + dy))
        assert np.abs(np.array(got) - expected).max() < 1e-6


def test_crop_window_of_the_last_of_many_columns(tmp_path: Path) -> None:
    names = {"width": 20000, "height": 2, "crop_width": 8, "crop_height": 2, "crop_offset_x": 19992}
    sizes = "".join(param("integer", name, n) for name, n in names.items())
    view = re.sub("<film.*?</film>", f'<film type="hdrfilm">{sizes}</film>', SENSOR.format("", ""))
    camera = loaded(tmp_path, SKY, view).camera
    assert camera.principal_point_offset[0] == pytest.approx((19996 - 10000) / 8)


def test_crop_window_shows_that_part(tmp_path: Path) -> None:
    """A pixel of the lamp's edge is lit in 64 samples, so its standard deviation is 0.0625 at most;
    12 pixels agree within 4 of their difference (false alarms 1e-3; the seed is fixed). A window
    that is one pixel off changes pixels by 0.75."""
    lamp = '<shape type="rectangle"><transform name="to_world"><rotate y="1" angle="180"/><translate z="4"/></transform><emitter type="area"/></shape>'
    box = '<rfilter type="box"/>'
    whole = vr.render(loaded(tmp_path, lamp, SENSOR.format(box, "")), spp=64, device="cpu").image
    crop = (
        CROP.replace('"20"', '"4"')
        .replace('"10"', '"3"')
        .replace('"30"', '"4"')
        .replace('"5"', '"0"')
    )
    part = vr.render(
        loaded(tmp_path, lamp, SENSOR.format(box + crop, "")), spp=64, device="cpu"
    ).image
    assert part.shape == (3, 4, 3)
    inner = whole[:3, 4:]
    assert 0 < inner.mean() < 1 and np.abs(part - inner).max() < 0.35
    assert np.array_equal(part == 0, inner == 0)


# ---- notes -------------------------------------------------------------------------------------


#: What is taken -> what the note says.
TAKEN = {
    "format": (SENSOR.format(param("string", "file_format", "rgbe"), ""), 'hdrfilm: "file_format" = "rgbe": the picture is written as render asks'),
    "alpha": (SENSOR.format(param("string", "pixel_format", "rgba"), ""), "radiance is written as rgb"),
    "banner": (SENSOR.format(param("boolean", "banner", "true"), ""), "no banner is drawn"),
    "border": (SENSOR.format(param("boolean", "sample_border", "true"), ""), "wherever the filter reaches"),
    "file": (SENSOR.format(param("string", "filename", "a.jpg"), ""), "the picture is written as render asks"),
    "rays": (SENSOR.format("", "") + param("boolean", "embree_use_robust_intersections", "true"), "no ray passes between neighbours"),
    "edges": (SENSOR.format(param("boolean", "high_quality_edges", "true"), ""), "wherever the filter reaches"),
    "gamma": (VIEW.replace("hdrfilm", "ldrfilm").replace("</film>", param("float", "gamma", 2.2) + "</film>"), 'ldrfilm: "gamma" = 2.2 has no effect'),
    "shutter": (SENSOR.format("", param("float", "shutter_open", 1)), "nothing in the scene moves"),
    "sampler": (SENSOR.format("", f'<sampler type="orthogonal">{param("integer", "strength", 2)}</sampler>'), '"strength" = 2 has no effect: it chooses samples'),
    "dimension": (SENSOR.format("", f'<sampler type="independent">{param("integer", "dimension", 2)}</sampler>'), "it chooses samples"),
    "medium": (VIEW + f'<medium type="homogeneous">{param("boolean", "sample_emitters", "false")}</medium>', "light is sampled in media anyway"),
    "spectral": (VIEW + f'<medium type="homogeneous">{param("boolean", "has_spectral_extinction", "false")}</medium>', "the coefficients themselves say so"),
    "blocks": (VIEW + f'<integrator type="path">{param("integer", "block_size", 2)}</integrator>', "how the work is cut"),
    "normals": (VIEW + f'<integrator type="path">{param("boolean", "strict_normals", "true")}</integrator>', "both normals agree"),
    "samples": (VIEW + f'<integrator type="direct">{param("integer", "shading_samples", 4)}</integrator>', "the sampler's sample_count alone counts"),
    "lamp": (VIEW + f'<emitter type="point">{param("float", "sampling_weight", 0.5)}</emitter>', "it chooses samples"),
    "dark lamp": (VIEW + f'<shape type="cube"><emitter type="area">{param("float", "sampling_weight", 0)}</emitter></shape>', "it chooses samples"),
    "silhouette": (VIEW + f'<shape type="cube">{param("float", "silhouette_sampling_weight", 2)}</shape>', "it concerns derivatives"),
    "other derivatives": (VIEW + f'<integrator type="prb_reparam">{param("integer", "reparam_rays", 4)}</integrator>', "it concerns derivatives"),
    "derivatives": (VIEW + f'<integrator type="prb_projective">{param("integer", "sppi", 4)}</integrator>', "it concerns derivatives"),
}  # fmt: skip


@pytest.mark.parametrize("plugin", ["point", "spot", "directional", "projector"])
def test_a_light_that_no_sample_finds_is_dark(tmp_path: Path, plugin: str) -> None:
    weight = param("float", "sampling_weight", 0)
    lamp = f'<emitter type="{plugin}"><spectrum name="{{}}" value="1"/>{weight}</emitter>'
    lamp = lamp.format("intensity" if plugin in ("point", "spot") else "irradiance")
    told = f"{plugin}: by sampling_weight 0 it is never sampled: no light, as in Mitsuba"
    with pytest.warns(SceneWarning, match=told):
        scene = loaded(tmp_path, VIEW, SKY, lamp)
    assert scene.sha256 == loaded(tmp_path, VIEW, SKY).sha256
    path = write(tmp_path / "dark.xml", VIEW, SKY, lamp)
    with pytest.warns(SceneWarning, match=told):
        convert(str(path), str(tmp_path / "copy.xml"), {})
    with pytest.warns(SceneWarning, match=told):
        assert vr.load_file(tmp_path / "copy.xml").sha256 == scene.sha256


@pytest.mark.parametrize("name", TAKEN)
def test_taken_with_a_note(tmp_path: Path, name: str) -> None:
    line, fragment = TAKEN[name]
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        scene = loaded(tmp_path, SKY, line)
    (note,) = scene.notes
    assert note.startswith(f"{tmp_path}/scene.xml:3: ") and fragment in note
    for copy in (scene.with_(spp=2), scene.scaled(2.0), scene.with_emission_scaled(2.0)):
        assert copy.notes == scene.notes
    error = fault(tmp_path, SKY, line, strict=True)
    assert str(error).startswith(note) and str(error).endswith("(an error by strict)")


def test_defaults_need_no_note(tmp_path: Path) -> None:
    given = (
        param("string", "file_format", "OpenEXR") + param("string", "pixel_format", "RGB")
        + param("string", "component_format", "float16") + param("boolean", "sample_border", "false")
    )  # fmt: skip
    assert not loaded(tmp_path, SKY, SENSOR.format(given, "")).notes
    for name in SHIPPED:
        assert not vr.load_file(name, strict=True).notes


def test_samplers(tmp_path: Path) -> None:
    for name in known.MITSUBA["sampler"]:
        sampler = f'<sampler type="{name}">{param("integer", "sample_count", 3)}</sampler>'
        scene = loaded(tmp_path, SKY, SENSOR.format("", sampler))
        assert scene.spp == 3
        assert scene.sampler == "sobol"


@pytest.mark.parametrize(
    ("body", "table", "expected", "energy"),
    [
        (f'<shape type="cube"><bsdf type="diffuse">{param("spectrum", "reflectance", 1.5)}</bsdf></shape>', "reflectance", [1, 1, 1], "more light leaving"),
        (f'<shape type="cube"><bsdf type="diffuse">{param("float", "reflectance", -1)}</bsdf></shape>', "reflectance", [0, 0, 0], "negative light"),
        (f'<shape type="cube"><emitter type="area">{param("rgb", "radiance", "1 -1 2")}</emitter></shape>', "emissions", [1, 0, 2], "negative light"),
        (f'<emitter type="point">{param("rgb", "intensity", "1 -1 2")}</emitter>', "light_intensity", [1, 0, 2], "negative light"),
    ],
)  # fmt: skip
def test_light_that_mitsuba_takes_and_veriray_cannot(
    tmp_path: Path, body: str, table: str, expected: list[float], energy: str
) -> None:
    with pytest.warns(SceneWarning, match=f"scene.xml:3: .*{energy}.*rendered as .*not Mitsuba's"):
        scene = loaded(tmp_path, VIEW, body, SKY)
    assert getattr(scene, table).tolist() == [expected] and len(scene.notes) == 1
    assert "an error by strict" in str(fault(tmp_path, VIEW, body, SKY, strict=True))


def test_notes_on_the_command_line(tmp_path: Path, capsys: Any) -> None:
    line = SENSOR.format(
        param("boolean", "banner", "true") + param("string", "file_format", "pfm"), ""
    )
    path = str(write(tmp_path / "scene.xml", SKY, '<shape type="cube"/>', line))
    output = str(tmp_path / "a.exr")
    assert main(["render", path, "-o", output, "--device", "cpu", "--spp", "1"]) == 0
    (text,) = capsys.readouterr().err.strip().split("\n")[:1]
    assert (
        text.startswith(f"veriray: warning: note: {path}:")
        and "(and 1 more: `veriray info` lists them)" in text
    )
    assert main(["info", path, "--device", "cpu"]) == 0
    assert capsys.readouterr().out.count("\nnote        ") == 2
    assert main(["render", path, "-o", output, "--device", "cpu", "--strict"]) == 2
    assert "an error by strict" in capsys.readouterr().err


# ---- integrators -------------------------------------------------------------------------------

DEPTHS = {
    "path": -1, "volpath": -1, "volpathmis": -1, "ptracer": -1, "prb": 6, "prb_basic": 6,
    "prbvolpath": 6, "prb_projective": 6, "direct": 2, "direct_projective": 2,
    "prb_reparam": 6, "direct_reparam": 2, "emission_reparam": 1,
}  # fmt: skip


@pytest.mark.parametrize("name", DEPTHS)
def test_integrators_that_render_paths(tmp_path: Path, name: str) -> None:
    line = f'<integrator type="{name}">{{}}</integrator>'
    scene = loaded(tmp_path, VIEW, SKY, line.format(""))
    assert (scene.max_depth, scene.rr_depth, scene.notes) == (DEPTHS[name], 5, ())
    if DEPTHS[name] not in (1, 2):
        given = param("integer", "max_depth", 9) + param("integer", "rr_depth", 3)
        scene = loaded(tmp_path, VIEW, SKY, line.format(given))
        assert (scene.max_depth, scene.rr_depth) == (9, 3)
    else:
        given = param("integer", "max_depth", 9)
        assert 'unknown parameter "max_depth"' in str(
            fault(tmp_path, VIEW, SKY, line.format(given))
        )


@pytest.mark.parametrize("name", ["moment", "aov", "stokes"])
def test_integrators_around_others(tmp_path: Path, name: str) -> None:
    inner = f'<integrator type="path">{param("integer", "max_depth", 4)}</integrator>'
    names = param("string", "aovs", "d:depth") if name == "aov" else ""
    scene = loaded(
        tmp_path,
        VIEW,
        SKY,
        f'<integrator type="{name}">{names}{inner}<integrator type="direct"/></integrator>',
    )
    assert scene.max_depth == 4
    assert [name in note or "path" in note for note in scene.notes] == [True] * len(scene.notes)
    assert any(f"{name} renders path" in note for note in scene.notes)
    assert any("only its first integrator is rendered" in note for note in scene.notes)


def test_hidden_emitters(tmp_path: Path) -> None:
    """The innermost integrator's counts, and changes nothing where nothing could be seen."""
    line = f'<integrator type="{{}}">{param("boolean", "hide_emitters", "true")}{{}}</integrator>'
    inner = line.format("path", "")
    for integrator in (inner, line.format("direct", ""), line.format("moment", inner),
                       f'<integrator type="moment">{inner}</integrator>'):  # fmt: skip
        shown = integrator.replace("true", "false")
        for light in (SKY, LAMP):
            scene = loaded(tmp_path, VIEW, integrator, light, POINT)
            assert scene.hide_emitters
            assert scene.sha256 != loaded(tmp_path, VIEW, shown, light, POINT).sha256
            assert (
                scene.with_(hide_emitters=False).sha256
                == loaded(tmp_path, VIEW, shown, light, POINT).sha256
            )
        cube = '<shape type="cube"/>'
        scene = loaded(tmp_path, VIEW, integrator, cube, POINT)
        assert scene.sha256 == loaded(tmp_path, VIEW, shown, cube, POINT).sha256
    scene = loaded(tmp_path, VIEW, line.format("moment", '<integrator type="path"/>'), LAMP)
    assert not scene.hide_emitters
    assert any('"hide_emitters" counts in path' in note for note in scene.notes)


def test_a_hidden_lamp_that_emits_nothing_is_hidden_too(tmp_path: Path) -> None:
    """As in Mitsuba, where an emitter is one whatever it emits."""
    hides = f'<integrator type="path">{param("boolean", "hide_emitters", "{}")}</integrator>'
    black = '<emitter type="area"><rgb name="radiance" value="0"/></emitter>'
    near = '<transform name="to_world"><scale value="9"/><translate z="2"/></transform>'
    lamp = f'<shape type="rectangle">{near}<bsdf type="diffuse"/>{black}</shape>'
    ball = (
        '<shape type="sphere"><point name="center" z="9"/><float name="radius" value="2"/></shape>'
    )
    pictures = [
        vr.render(
            loaded(tmp_path, VIEW, hides.format(value), SKY, lamp, ball), spp=256, device="cpu"
        )
        for value in ("true", "false")
    ]
    # The sky lights the ball past the lamp, whose back is black.
    assert 0 < pictures[0].image[3, 4, 0] < 0.5 and pictures[1].image[3, 4, 0] == 0


@pytest.mark.parametrize(
    ("name", "bsdf", "text"),
    [
        ("path", "diffuse", ""),
        ("path", "null", "hides its lamps and sky too"),
        ("prb", "thindielectric", "hides its lamps and sky too"),
        ("volpath", "null", ""),
        ("prbvolpath", "thindielectric", ""),
        ("ptracer", "diffuse", "sees what is behind hidden lamps"),
        ("direct_projective", "null", "sees what is behind hidden lamps"),
    ],
)
def test_what_mitsuba_hides_otherwise_is_said(
    tmp_path: Path, name: str, bsdf: str, text: str, recwarn: pytest.WarningsRecorder
) -> None:
    hides = param("boolean", "hide_emitters", "true")
    pane = f'<shape type="cube"><bsdf type="{bsdf}"/></shape>'
    loaded(tmp_path, VIEW, f'<integrator type="{name}">{hides}</integrator>', LAMP, pane)
    said = [str(w.message) for w in recwarn if "hid" in str(w.message)]
    assert text in " ".join(said) and bool(said) == bool(text)


def test_orthographic(tmp_path: Path) -> None:
    """The film is [-1, 1] of local x; a crop window is that part of it; to_world may not shear."""
    place = '<transform name="to_world"><scale x="3" y="2" z="0.5"/><translate x="1"/></transform>'
    film = '<film type="hdrfilm">' + param("integer", "width", 20) + param("integer", "height", 10)
    crop = "".join(param("integer", f"crop_{name}", value) for name, value in
                   (("width", 5), ("height", 4), ("offset_x", 3), ("offset_y", 2)))  # fmt: skip
    clip = param("float", "near_clip", 0.5) + param("float", "far_clip", 7)
    lines = '<sensor type="orthographic">{}{}{}</film></sensor>'
    camera = loaded(tmp_path, lines.format(place, clip, film), SKY).camera
    assert camera.projection == "orthographic" and camera.clip_depths == (0.25, 6.75)
    assert (camera.tan_half_x(20, 10), camera.tan_half_y(20, 10)) == (3, 1)
    part = loaded(tmp_path, lines.format(place, clip, film + crop), SKY).camera
    # Of Mitsuba's rays through the corners (0, 0) and (1, 1) of the film; before to_world.
    corners = [[0.7, 0.3], [0.2, -0.1]]
    for sign, corner in zip((1, -1), corners, strict=True):
        local = np.array([sign, sign * 4 / 5, 0, 1.0])
        x, y = corner
        assert part.to_world @ local == pytest.approx([3 * x + 1, 2 * y, 0, 1])
    assert part.clip_depths == camera.clip_depths
    sheared = (
        '<transform name="to_world"><matrix value="1 0 1 0 0 1 0 0 0 0 1 0 0 0 0 1"/></transform>'
    )
    assert "shears" in str(fault(tmp_path, lines.format(sheared, clip, film), SKY))


def test_radiancemeter(tmp_path: Path) -> None:
    """One ray: an orthographic film of no size."""
    film = '<film type="hdrfilm">' + "".join(param("integer", n, 1) for n in ("width", "height"))
    line = '<sensor type="radiancemeter">{}' + film + "</film></sensor>"
    origin, ahead = ('<{} name="{}" x="1" y="2" z="3"/>'.format(*names)
                     for names in (("point", "origin"), ("vector", "direction")))  # fmt: skip
    place = '<transform name="to_world"><scale value="2"/><translate x="4"/></transform>'
    for given, start, along in ((origin + ahead, (1, 2, 3), np.array([1, 2, 3]) / 14**0.5),
                                (place + origin, (4, 0, 0), (0, 0, 1)),
                                ("", (0, 0, 0), (0, 0, 1))):  # fmt: skip
        camera = loaded(tmp_path, line.format(given), SKY).camera
        assert camera.to_world[:3, 3].tolist() == list(start)
        assert camera.placed[:3, 2] == pytest.approx(along) and camera.tan_half_x(1, 1) < 1e-19
    text = str(fault(tmp_path, line.format(origin), SKY))
    assert "expected both origin and direction" in text
    wide = line.replace('value="1"', 'value="2"')
    assert "its film has 2 x 2 pixels, expected 1 x 1" in str(fault(tmp_path, wide.format(""), SKY))


def test_direct_light_without_one_kind_of_samples(tmp_path: Path) -> None:
    """Allowed where what it leaves out is not there."""
    line = '<integrator type="direct">{}</integrator>'
    without = line.format(param("integer", "bsdf_samples", 0))
    bsdf = '<shape type="cube"><bsdf type="{}">{}</bsdf></shape>'
    grey = '<bsdf type="diffuse"/>'
    assert loaded(tmp_path, VIEW, LAMP, without, bsdf.format("diffuse", "")).max_depth == 2
    assert (
        loaded(tmp_path, VIEW, LAMP, without, '<bsdf type="dielectric"/>').max_depth == 2
    )  # unused
    for kind, inner in (("conductor", ""), ("plastic", ""), ("null", ""), ("mask", grey)):
        text = str(fault(tmp_path, VIEW, LAMP, without, bsdf.format(kind, inner)))
        assert "leaves out the light of a mirror, glass or a mask" in text
    without = line.format(param("integer", "emitter_samples", 0))
    assert loaded(tmp_path, VIEW, LAMP, without).max_depth == 2
    assert "parallel lamp" in str(fault(tmp_path, VIEW, POINT, without))


def test_what_mitsuba_renders_otherwise_is_said(tmp_path: Path) -> None:
    line = '<shape type="cube"><bsdf type="{}">{}</bsdf></shape><integrator type="{}"/>'
    for kind, inner, integrator, said in (
        ("conductor", "", "ptracer", "what mirrors and glass show is rendered"),
        ("mask", '<bsdf type="diffuse"/>', "direct", "what is seen through masks"),
        ("diffuse", "", "ptracer", ""),
        ("conductor", "", "direct", ""),
        ("thindielectric", "", "path", ""),
    ):
        with warnings.catch_warnings(record=True) as caught:
            warnings.simplefilter("always")
            scene = loaded(tmp_path, VIEW, SKY, line.format(kind, inner, integrator))
        assert [said in str(warning.message) for warning in caught] == [True] * bool(said)
        assert len(scene.notes) == bool(said)


def test_directional_areas_are_dark(tmp_path: Path) -> None:
    """As in Mitsuba, but for ptracer."""
    line = '<shape type="cube"><emitter type="directionalarea"/></shape><integrator type="{}"/>'
    scene = loaded(tmp_path, VIEW, SKY, line.format("path"))
    assert not len(scene.emissions)
    assert any("only ptracer finds its light in Mitsuba" in note for note in scene.notes)
    text = str(fault(tmp_path, VIEW, SKY, line.format("ptracer")))
    assert "directionalarea: its light by ptracer is not supported" in text


def test_lights_of_points_behind_masks(tmp_path: Path) -> None:
    """They are seen through masks, which throw full shadows in Mitsuba's path: a warning."""
    line = '<shape type="cube"><bsdf type="{}"/></shape><integrator type="{}"/>'
    for kind, integrator, light, count in (
        ("thindielectric", "path", POINT, 1), ("thindielectric", "prb", POINT, 1),
        ("thindielectric", "volpath", POINT, 0), ("thindielectric", "path", LAMP, 0),
        ("dielectric", "path", POINT, 0),
    ):  # fmt: skip
        with warnings.catch_warnings(record=True) as caught:
            warnings.simplefilter("always")
            loaded(tmp_path, VIEW, light, line.format(kind, integrator))
        said = [str(one.message) for one in caught]
        assert sum("shine through masks" in text for text in said) == count


def test_media_by_integrators_that_have_none(tmp_path: Path) -> None:
    """Mitsuba's path leaves them out: a warning, but not where a scene names no integrator."""
    fog = (
        '<shape type="sphere"><bsdf type="null"/><medium type="homogeneous" name="interior"/>'
        "</shape>"
    )
    for integrator, count in (("path", 1), ("direct", 1), ("volpath", 0), ("", 0)):
        line = f'<integrator type="{integrator}"/>' if integrator else ""
        with warnings.catch_warnings(record=True) as caught:
            warnings.simplefilter("always")
            loaded(tmp_path, VIEW, SKY, fog + line)
        assert sum("media count, as by volpath" in str(one.message) for one in caught) == count


def test_grey_roughness(tmp_path: Path) -> None:
    """Of metal and glass, as in Mitsuba; its rough plastic takes a number alone."""
    rough = '<shape type="cube"><bsdf type="rough{}">{}</bsdf></shape>'
    for name in ("conductor", "dielectric"):
        for kind in ("float", "rgb", "spectrum"):
            given = rough.format(name, param(kind, "alpha", 0.25))
            assert loaded(tmp_path, VIEW, SKY, given).alpha_u.tolist() == [0.25]
    text = str(fault(tmp_path, VIEW, SKY, rough.format("plastic", param("rgb", "alpha", 0.25))))
    assert "is of type rgb, expected float" in text


def test_grey_opacity(tmp_path: Path) -> None:
    mask = '<shape type="cube"><bsdf type="mask">{}<bsdf type="diffuse"/></bsdf></shape>'
    for kind in ("float", "rgb", "spectrum"):
        scene = loaded(tmp_path, VIEW, SKY, mask.format(param(kind, "opacity", 0.25)))
        assert scene.opacity.tolist() == [0.25]


# ---- faults ------------------------------------------------------------------------------------


def test_all_faults_at_once(tmp_path: Path, capsys: Any) -> None:
    lines = (
        '<bsdf type="measured" id="fur"><texture type="noise" name="a"/>'
        '<bsdf type="diffuse"><float name="shine" value="1"/></bsdf></bsdf>',
        '<shape type="cube"><ref id="fur"/><float name="radius" value="1"/></shape>',
        '<shape type="sphere"><float name="radius" value="x"/></shape>',
        OBJ.format("none.obj"),
        '<sensor type="perspective"><float name="fov" value="200"/><film type="tape"/></sensor>',
        '<bsdf type="mask"><ref id="fur"/></bsdf><shape type="disk"><ref id="nobody"/></shape>',
        '<integrator type="path"><integer name="max_depth" value="-7"/>'
        '<integer name="rr_depth" value="0"/></integrator>',
        '<shape type="torus"/>',
    )  # fmt: skip
    error = fault(tmp_path, *lines)
    expected = {
        'bsdf "measured" of Mitsuba is not supported yet': 2, 'unknown texture "noise"': 2,
        'diffuse: unknown parameter "shine"': 2, 'cube: unknown parameter "radius"': 3,
        '"radius" = "x" is not a number': 4, 'cannot read "': 5, '"fov" = 200.0 is outside': 6,
        'unknown film "tape"': 6, 'no object with the id "nobody"': 7,
        '"max_depth" = -7 is outside': 8, '"rr_depth" = 0 is outside': 8, 'unknown shape "torus"': 9,
    }  # fmt: skip
    found = dict.fromkeys(error.faults)
    for fragment, line in expected.items():
        (text,) = [text for text in found if fragment in text]
        assert text.startswith(f"{tmp_path}/scene.xml:{line}: "), text
        del found[text]
    assert not found, found  # and nothing that only follows from another
    assert str(error).startswith(error.faults[0])
    assert str(error).endswith("(the first of 12 faults; `veriray info` lists them)")
    assert error.where == f"{tmp_path}/scene.xml:2"
    path = str(tmp_path / "scene.xml")
    assert main(["info", path]) == 2
    out, err = capsys.readouterr()
    assert out.count("\n") == 12 and out.startswith("fault       ") and err.count("\n") == 1
    assert main(["info", path, "--json"]) == 2
    assert json.loads(capsys.readouterr().out)["faults"] == list(error.faults)


def test_all_faults_of_a_dictionary() -> None:
    content = {
        "type": "scene",
        "cube": {"type": "cube", "fur": {"type": "measured"}, "colour": 1.0},
        "ball": {"type": "sphere", "radius": -1.0, "to_world": np.eye(3)},
        "view": {"type": "perspective", "fov": "wide"},
    }
    with pytest.raises(SceneError) as caught:
        vr.load_dict(content)
    assert [text.split(":")[0] for text in caught.value.faults] == [
        "scene.cube.fur", "scene.ball.to_world", "scene.cube.colour", "scene.ball.radius",
        "scene.view.fov",
    ]  # fmt: skip


def test_one_fault_is_raised_as_it_is(tmp_path: Path) -> None:
    error = fault(
        tmp_path, VIEW, SKY, '<shape type="cube"><float name="radius" value="1"/></shape>'
    )
    assert error.faults == (str(error),) and "faults" not in str(error)


def test_the_search_for_faults_ends(tmp_path: Path) -> None:
    error = fault(tmp_path, VIEW, *['<shape type="torus"/>'] * 3000)
    assert len(error.faults) == MAX_FAULTS and f"of {MAX_FAULTS} or more faults" in str(error)


def test_known_plugins() -> None:
    """Every category of ours is one of Mitsuba's, and its plugins that we lack are named so."""
    assert set(CATEGORIES) - {"scene"} <= set(known.MITSUBA)
    for category, names in known.MITSUBA.items():
        for name in names:
            if name not in PLUGINS:
                text = known.missing(category, name)
                assert text.startswith(f'{category} "{name}" of Mitsuba is not supported yet')


# ---- convert -----------------------------------------------------------------------------------


@pytest.mark.parametrize("name", SHIPPED)
def test_a_converted_scene_is_the_same(tmp_path: Path, name: str) -> None:
    target = tmp_path / "out.xml"
    assert convert(name, str(target), {}) == ()
    once = target.read_text("utf-8")
    assert vr.load_file(target).sha256 == vr.load_file(name).sha256
    convert(str(target), str(tmp_path / "again.xml"), {})
    assert (tmp_path / "again.xml").read_text("utf-8") == once


def test_convert(tmp_path: Path, capsys: Any) -> None:
    (tmp_path / "in").mkdir()
    (tmp_path / "in/$a & b.obj").write_text(TRIANGLE)
    write(tmp_path / "in/part.xml", '<path value="."/>', OBJ.format("\\$a &amp; b.obj"))
    write(
        tmp_path / "in/scene.xml", '<default name="g" value="0.1"/>',
        SENSOR.format(param("boolean", "banner", "true"), "").replace("hdrfilm", "ldrfilm"), LAMP,
        f'<integrator type="moment"><integrator type="path">{param("boolean", "strict_normals", "true")}</integrator></integrator>',
        '<include filename="part.xml"/>', '<bsdf type="diffuse" id="a"/><alias id="a" as="b"/>',
        '<shape type="sphere"><ref id="b"/><point name="center" x="$g" y="1e-30" z="-3"/>'
        '<medium type="homogeneous" name="interior"><spectrum name="albedo" value="$g"/></medium>'
        '<transform name="to_world"><rotate x="1" angle="33.3"/><scale value="0.3"/></transform></shape>',
        '<ref id="lamp"/>', SKY,
    )  # fmt: skip
    source, target = str(tmp_path / "in/scene.xml"), tmp_path / "out.xml"
    assert main(["convert", source, str(target), "-D", "g=0.7"]) == 0
    assert "veriray: warning: note: " in capsys.readouterr().err
    text = target.read_text("utf-8")
    assert "in/\\$a &amp; b.obj" in text and "hdrfilm" in text and "banner" not in text
    scene = vr.load_file(target)
    assert scene.sha256 == vr.load_file(source, {"g": 0.7}).sha256
    assert scene.shape_names == vr.load_file(source, {"g": 0.7}).shape_names
    said = [note.split(": ", 1)[1][:19] for note in scene.notes]
    assert said == ["moment renders path", "path: media count, "]


def test_convert_writes_the_sensor_and_the_integrator_that_are_not_there(tmp_path: Path) -> None:
    source = write(tmp_path / "in.xml", SKY, '<shape type="cube"/>')
    (note,) = convert(str(source), str(tmp_path / "out.xml"), {})
    scene = vr.load_file(tmp_path / "out.xml", strict=True)
    assert "no sensor" in note and scene.sha256 == vr.load_file(source).sha256
    assert '<integrator type="path"/>' in (tmp_path / "out.xml").read_text("utf-8")
    fog = '<shape type="cube"><medium type="homogeneous" name="interior"/></shape>'
    convert(str(write(tmp_path / "fog.xml", SKY, fog)), str(tmp_path / "out.xml"), {})
    assert '<integrator type="volpath"/>' in (tmp_path / "out.xml").read_text("utf-8")


def test_outputs_replace_no_file_that_the_scene_reads(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: Any
) -> None:
    """The scene, what it includes, and textures, by whatever name."""
    Image.fromarray(np.full((2, 2, 3), 99, np.uint8)).save(tmp_path / "a.png")
    os.link(tmp_path / "a.png", tmp_path / "same.png")
    texture = '<texture name="reflectance" type="bitmap"><string name="filename" value="a.png"/></texture>'
    part = f'<scene version="3.0.0"><shape type="sphere"><bsdf type="diffuse">{texture}'
    (tmp_path / "part.xml").write_text(f"{part}</bsdf></shape></scene>")
    whole = '<scene version="3.0.0"><include filename="part.xml"/></scene>'
    (tmp_path / "whole.xml").write_text(whole)
    before = {path: path.read_bytes() for path in tmp_path.iterdir()}
    monkeypatch.chdir(tmp_path)  # messages cut long paths
    scene = str(tmp_path / "whole.xml")
    small = ["--device", "cpu", "--width", "4", "--height", "4", "--spp", "1"]
    for words, name in (
        (["convert", scene], "whole.xml"), (["convert", scene], "part.xml"),
        (["render", scene, *small, "-o"], "a.png"), (["render", scene, *small, "-o"], "same.png"),
    ):  # fmt: skip
        assert main([*words, name]) == 2
        said = capsys.readouterr().err.splitlines()[-1]
        assert name in said and "the scene reads this file; write to another one" in said
    assert {path: path.read_bytes() for path in tmp_path.iterdir()} == before
    assert main(["convert", scene, str(tmp_path / "new.xml")]) == 0


def test_convert_writes_names_that_xml_cannot_hold_as_escapes(tmp_path: Path) -> None:
    tree = mitsuba_dict.read(
        {"type": "scene", "a\udc80\1": {"type": "sphere"}, "l": {"type": "constant"}}
    )
    text = as_xml(tree, tmp_path, vr.Camera(np.eye(4), 40.0))
    scene = vr.load_file(
        write(tmp_path / "out.xml", text[text.index("<shape") : -len("</scene>\n")])
    )
    assert scene.shape_names == ("a\\udc80\\x01",)


def test_convert_writes_nothing_of_a_scene_with_faults(tmp_path: Path, capsys: Any) -> None:
    source = str(write(tmp_path / "in.xml", '<shape type="torus"/>'))
    assert main(["convert", source, str(tmp_path / "out.xml")]) == 2
    assert main(["convert", source, str(tmp_path / "out.txt")]) == 2
    assert "unknown suffix; expected .xml" in capsys.readouterr().err
    assert [path.name for path in tmp_path.iterdir()] == ["in.xml"]


def test_objects_in_no_object_have_no_effect(tmp_path: Path) -> None:
    """As in Mitsuba: a film, sampler, filter or area light that stands in the scene itself."""
    idle = '<film type="hdrfilm"/><sampler type="stratified"/><rfilter type="box"/>'
    idle += '<emitter type="area"><rgb name="radiance" value="3"/></emitter>'
    body = '<sensor type="perspective"/><emitter type="constant"/><shape type="sphere"/>'
    path = tmp_path / "scene.xml"
    path.write_text(f'<scene version="3.0.0">{body}</scene>')
    plain = vr.load_file(path)
    path.write_text(f'<scene version="3.0.0">{idle}{body}</scene>')
    scene = vr.load_file(path)
    assert scene.sha256 == plain.sha256
    assert sum("in no object, it has no effect" in note for note in scene.notes) == 4


def test_convert_keeps_spectra(tmp_path: Path) -> None:
    """Lists of wavelengths are written exactly; arrays of a model cannot be."""
    body = (
        '<sensor type="perspective"/><shape type="sphere"><bsdf type="diffuse">'
        '<spectrum name="reflectance" value="400:0.1, 500:0.3, 700:0.7"/></bsdf></shape>'
        '<emitter type="constant"><spectrum name="radiance" type="blackbody">'
        '<float name="temperature" value="4000"/></spectrum></emitter>'
    )
    (tmp_path / "a.xml").write_text(f'<scene version="3.0.0">{body}</scene>')
    convert(str(tmp_path / "a.xml"), str(tmp_path / "b.xml"), {})
    both = [vr.load_file(tmp_path / name) for name in ("a.xml", "b.xml")]
    assert both[0].sha256 == both[1].sha256


def test_types_in_other_letters(tmp_path: Path) -> None:
    """As files have them that were written where file names have no case."""
    small = '<shape type="rectangle"><bsdf type="diffuse"/></shape>'
    large = '<shape type="Rectangle"><bsdf type="Diffuse"/></shape>'
    made, same = loaded(tmp_path, VIEW, SKY, large), loaded(tmp_path, VIEW, SKY, small)
    assert made.sha256 == same.sha256 and not same.notes
    told = [str(note) for note in made.notes]
    assert len(told) == 2 and 'shape "Rectangle" is read as "rectangle"' in told[0]
    with pytest.raises(SceneError, match='unknown shape "Diffuse"'):
        loaded(tmp_path, SKY, '<shape type="Diffuse"/>')
