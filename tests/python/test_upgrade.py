# ruff: noqa: E501 (the tables of what is approximated)
"""Scene files of Mitsuba 0.3 to 1.x: the scene that the same file in today's terms gives."""

from __future__ import annotations

import re
import warnings
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from lxml import etree
from PIL import Image

import veriray as vr
from veriray.errors import SceneError, SceneWarning
from veriray.formats import upgrade

SENSOR = '<sensor type="perspective"><float name="fov" value="40"/></sensor>'
LIGHT = '<emitter type="constant"/>'
#: What is said of relief: version 0.x neither flipped normals nor had a function for shadows.
UNSHADED = (
    '<boolean name="flip_invalid_normals" value="false"/>'
    '<boolean name="use_shadowing_function" value="false"/>'
)


def read(folder: Path, version: str, body: str) -> vr.Scene:
    path = folder / f"scene-{version}.xml"
    path.write_text(f'<scene version="{version}">{body}</scene>', encoding="utf-8")
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", SceneWarning)
        return vr.load_file(path)


def upgraded(text: str) -> tuple[str, list[tuple[str, str]]]:
    """The elements of a file after the upgrade as text, and its notes."""
    root = etree.fromstring(text)
    notes = upgrade.Notes()
    upgrade.upgrade(root, "f.xml", notes)
    return etree.tostring(root).decode(), notes.listed()


@pytest.mark.parametrize(
    ("old", "new"),
    [
        ("toWorld", "to_world"),
        ("intIOR", "int_ior"),
        ("rrDepth", "rr_depth"),
        ("sigmaA", "sigma_a"),
        ("fooBARBaz", "foo_barbaz"),  # as Mitsuba writes it
        ("fooBar2Baz", "foo_bar2Baz"),
        ("alpha", "alpha"),
        ("BSDF", "BSDF"),
    ],
)
def test_names(old: str, new: str) -> None:
    assert upgrade.snake(old) == new


#: What an old file says, and today's words for it.
SAME = {
    "diffuse": (
        '<shape type="cube"><bsdf type="diffuse"><rgb name="diffuseReflectance" value="0.1 0.2 0.3"'
        ' intent="reflectance"/></bsdf></shape>',
        '<shape type="cube"><bsdf type="diffuse"><rgb name="reflectance" value="0.1 0.2 0.3"/>'
        "</bsdf></shape>",
    ),
    "transform": (
        '<shape type="cube"><transform name="toWorld"><lookAt origin="0 1 5" target="0 0 0"'
        ' up="0 1 0"/></transform></shape>',
        '<shape type="cube"><transform name="to_world"><lookat origin="0 1 5" target="0 0 0"'
        ' up="0 1 0"/></transform></shape>',
    ),
    "glass": (
        '<shape type="sphere"><bsdf type="dielectric"><float name="intIOR" value="1.7"/>'
        '<string name="extIOR" value="water"/></bsdf></shape>',
        '<shape type="sphere"><bsdf type="dielectric"><float name="int_ior" value="1.7"/>'
        '<string name="ext_ior" value="water"/></bsdf></shape>',
    ),
    "srgb": (
        '<shape type="cube"><bsdf type="plastic"><srgb name="diffuseReflectance" value="#336699"/>'
        "</bsdf></shape>",
        '<shape type="cube"><bsdf type="plastic"><srgb name="diffuse_reflectance"'
        ' value="0.2 0.4 0.6"/></bsdf></shape>',
    ),
    "three numbers": (
        '<emitter type="point"><spectrum name="intensity" value="1, 2, 3"/></emitter>',
        '<emitter type="point"><rgb name="intensity" value="1 2 3"/></emitter>',
    ),
    "blackbody": (
        '<emitter type="point"><blackbody name="intensity" temperature="5000 K" scale="0.01"/>'
        "</emitter>",
        '<emitter type="point"><spectrum type="blackbody" name="intensity">'
        '<float name="temperature" value="5000"/><float name="scale" value="0.01"/></spectrum>'
        "</emitter>",
    ),
    "opacity": (
        '<shape type="cube"><bsdf type="mask"><spectrum name="opacity" value="0.3"/>'
        '<bsdf type="diffuse"/></bsdf></shape>',
        '<shape type="cube"><bsdf type="mask"><float name="opacity" value="0.3"/>'
        '<bsdf type="diffuse"/></bsdf></shape>',
    ),
    "opacity of sRGB": (
        '<shape type="cube"><bsdf type="mask"><srgb name="opacity" value="0.5"/>'
        '<bsdf type="diffuse"/></bsdf></shape>',
        f'<shape type="cube"><bsdf type="mask"><float name="opacity" value="{((0.5 + 0.055) / 1.055) ** 2.4!r}"/>'
        '<bsdf type="diffuse"/></bsdf></shape>',
    ),
    "alias": (
        '<bsdf type="conductor" id="a"/><alias id="a" as="b"/><shape type="cube"><ref id="b"/>'
        "</shape>",
        '<bsdf type="conductor" id="a"/><shape type="cube"><ref id="a"/></shape>',
    ),
}


def same(one: vr.Scene, other: vr.Scene) -> None:
    assert one.sha256 == other.sha256


@pytest.mark.parametrize("case", SAME)
def test_an_old_file_is_todays(tmp_path: Path, case: str) -> None:
    old, new = (SENSOR + LIGHT + text for text in SAME[case])
    same(read(tmp_path, "0.5.0", old), read(tmp_path, "3.0.0", new))


def test_camera_film_sampler_and_integrator(tmp_path: Path) -> None:
    old = read(
        tmp_path, "0.4.0",
        '<integrator type="bdpt"><integer name="maxDepth" value="7"/><integer name="rrDepth"'
        ' value="9"/><boolean name="lightImage" value="true"/></integrator>'
        '<sensor type="perspective"><string name="fovAxis" value="smaller"/><float name="fov"'
        ' value="30"/><float name="nearClip" value="0.5"/><float name="farClip" value="50"/>'
        '<transform name="toWorld"><lookAt origin="0 0 5" target="0 0 0" up="0 1 0"/></transform>'
        '<sampler type="sobol"><integer name="sampleCount" value="16"/><integer name="scramble"'
        ' value="3"/></sampler><film type="ldrfilm"><integer name="width" value="64"/>'
        '<integer name="height" value="32"/><float name="gamma" value="2.2"/><boolean name="banner"'
        ' value="false"/><rfilter type="box"/></film></sensor>' + LIGHT,
    )  # fmt: skip
    new = read(
        tmp_path, "3.0.0",
        '<integrator type="path"><integer name="max_depth" value="7"/><integer name="rr_depth"'
        ' value="9"/></integrator>'
        '<sensor type="perspective"><string name="fov_axis" value="smaller"/><float name="fov"'
        ' value="30"/><float name="near_clip" value="0.5"/><float name="far_clip" value="50"/>'
        '<transform name="to_world"><lookat origin="0 0 5" target="0 0 0" up="0 1 0"/></transform>'
        '<sampler type="ldsampler"><integer name="sample_count" value="16"/></sampler>'
        '<film type="hdrfilm"><integer name="width" value="64"/><integer name="height" value="32"/>'
        '<rfilter type="box"/></film></sensor>' + LIGHT,
    )  # fmt: skip
    same(old, new)
    for name in ("max_depth", "rr_depth", "sampler", "spp", "seed"):
        assert getattr(old, name) == getattr(new, name)
    assert (old.film.width, old.film.filter) == (64, "box")


@pytest.mark.parametrize("version", ["0.4.0", "0.6.0", "1.0.0"])
def test_mitsuba_reads_the_same(tmp_path: Path, version: str) -> None:
    """Parameters of a file that Mitsuba 3 upgrades too."""
    mi = pytest.importorskip("mitsuba", reason="the peer renderer: pip install mitsuba")
    body = (
        '<sensor type="perspective"><string name="fovAxis" value="x"/>'
        '<float name="fov" value="30"/>'
        '<float name="nearClip" value="0.5"/><float name="farClip" value="50"/>'
        '<transform name="toWorld"><lookat origin="1 2 5" target="0 0 0" up="0 1 0"/></transform>'
        "</sensor>"
        '<shape type="cube" id="one"><transform name="toWorld"><translate x="2"/></transform>'
        '<bsdf type="diffuse"><rgb name="diffuseReflectance" value="0.1 0.2 0.3"/></bsdf></shape>'
        '<shape type="cube" id="two"><bsdf type="dielectric"><float name="intIOR" value="1.7"/>'
        '<string name="extIOR" value="water"/><spectrum name="specularReflectance" value="0.5"/>'
        "</bsdf></shape>"
        '<emitter type="constant" id="sky"><spectrum name="radiance" value="2"/></emitter>'
    )
    mi.set_variant("scalar_rgb")
    theirs = mi.traverse(mi.load_string(f'<scene version="{version}">{body}</scene>'))
    ours = read(tmp_path, version, body)

    def of(end: str) -> Any:
        (key,) = [k for k in theirs.keys() if k.endswith(end)]  # noqa: SIM118
        return theirs[key]

    camera = ours.camera
    assert (camera.near_clip, camera.far_clip) == (of("near_clip"), of("far_clip"))
    assert camera.fov == pytest.approx(of("x_fov"), rel=1e-6) and camera.fov_axis == "x"
    matrix = np.array(of("perspective.to_world").matrix) if False else None
    assert matrix is None
    np.testing.assert_allclose(ours.reflectance[0], of("one.bsdf.reflectance.value"), rtol=1e-6)
    assert ours.eta[1][0] == pytest.approx(of("two.bsdf.eta"), rel=1e-6)
    assert ours.specular_reflectance[1].tolist() == [of("specular_reflectance.value")] * 3
    np.testing.assert_allclose(ours.environment, of("sky.radiance.value"), rtol=2e-6)
    assert np.ravel(of("one.vertex_positions"))[0::3].min() == ours.vertices[:, 0][:24].min() == 1.0


OBJECT = '<shape type="rectangle">{}</shape>'
IMAGE = '<string name="filename" value="IMAGE"/>'
#: What Mitsuba 3 reads once it is upgraded, and not before.
UPGRADED = {
    "lookAt": '<sensor type="perspective"><transform name="toWorld"><lookAt origin="0 0 1"'
    ' target="0 0 0" up="0 1 0"/></transform></sensor>',
    "normal map": OBJECT.format(
        f'<bsdf type="normalmap"><texture name="normals" type="bitmap">{IMAGE}<float name="gamma"'
        ' value="1"/></texture><bsdf type="diffuse"/></bsdf>'
    ),
    "bump map": OBJECT.format(
        '<bsdf type="bumpmap"><texture type="scale" name="map"><float name="scale" value="5"/>'
        f'<texture type="bitmap">{IMAGE}</texture></texture><bsdf type="diffuse"/></bsdf>'
    ),
    "mixture": OBJECT.format(
        '<bsdf type="mixturebsdf"><string name="weights" value="0.2, 0.3, 0.4"/>'
        '<bsdf type="diffuse"/><bsdf type="plastic"/><bsdf type="diffuse"/></bsdf>'
    ),
    "bitmap": OBJECT.format(
        f'<bsdf type="diffuse"><texture name="reflectance" type="bitmap">{IMAGE}<string'
        ' name="filterType" value="ewa"/><string name="wrapModeU" value="clamp"/><string'
        ' name="wrapModeV" value="clamp"/><float name="maxAnisotropy" value="3"/></texture></bsdf>'
    ),
    "vertex colours": OBJECT.format(
        '<bsdf type="diffuse"><texture name="reflectance" type="vertexcolors"/></bsdf>'
    ),
    "integrators": '<integrator type="multichannel"><integrator type="sppm"><integer'
    ' name="photonCount" value="3"/></integrator><integrator type="field"/></integrator>',
    "film and sampler": '<sensor type="perspective"><film type="mfilm"><integer name="width"'
    ' value="8"/><string name="fileFormat" value="numpy"/></film><sampler type="hammersley"/>'
    "</sensor>",
    "intent": '<emitter type="point"><rgb name="intensity" value="1 2 3" intent="illuminant"/>'
    "</emitter>",
    "three numbers": '<emitter type="point"><spectrum name="intensity" value="1 2 3"/></emitter>',
    "envmap": f'<emitter type="envmap">{IMAGE}<boolean name="cache" value="false"/></emitter>',
}


@pytest.mark.parametrize("case", UPGRADED)
def test_mitsuba_reads_what_is_upgraded(tmp_path: Path, case: str) -> None:
    mi = pytest.importorskip("mitsuba", reason="the peer renderer: pip install mitsuba")
    mi.set_variant("scalar_rgb")
    Image.fromarray(np.full((4, 4, 3), 128, np.uint8)).save(tmp_path / "image.png")
    body = UPGRADED[case].replace("IMAGE", str(tmp_path / "image.png"))
    old = f'<scene version="0.6.0">{body}</scene>'
    level = mi.log_level()
    mi.set_log_level(mi.LogLevel.Error)
    try:
        with pytest.raises(RuntimeError):
            mi.load_string(old)
        mi.load_string(upgraded(old)[0].replace('<boolean name="bytes" value="true"/>', ""))
    finally:
        mi.set_log_level(level)


def test_texture_placement_scales_first_as_mitsuba_0() -> None:
    text, notes = upgraded(
        '<scene><texture type="checkerboard"><float name="uscale" value="3"/>'
        '<float name="uoffset" value=".25"/></texture></scene>'
    )
    assert text == (
        '<scene><texture type="checkerboard"><transform name="to_uv"><scale x="3" y="1"/>'
        '<translate x=".25" y="0"/></transform><boolean name="in_order" value="true"/>'
        "</texture></scene>"
    )
    assert notes == [("uoffset, voffset, uscale and vscale are to_uv", "f.xml:1")]


def test_bitmaps() -> None:
    text, _ = upgraded(
        '<texture type="bitmap"><string name="filterType" value="ewa"/><float name="gamma"'
        ' value="1"/><float name="maxAnisotropy" value="8"/></texture>'
    )
    assert text == (
        '<texture type="bitmap"><string name="filter_type" value="bilinear"/>'
        '<boolean name="raw" value="true"/></texture>'
    )


def test_multichannel_is_its_light() -> None:
    text, _ = upgraded(
        '<scene><integrator type="multichannel"><integrator type="field"/><integrator type="path">'
        '<integer name="maxDepth" value="3"/></integrator></integrator></scene>'
    )
    assert text == (
        '<scene><integrator type="path"><integer name="max_depth" value="3"/></integrator></scene>'
    )


def test_normal_maps_and_conductors() -> None:
    text, notes = upgraded(
        '<scene><bsdf type="normalmap"><texture name="normals" type="bitmap"/>'
        '<bsdf type="conductor"><string name="extEta" value="water"/></bsdf></bsdf></scene>'
    )
    assert text == (
        '<scene><bsdf type="normalmap"><texture name="normalmap" type="bitmap"/>'
        f'<bsdf type="conductor"><float name="ext_eta" value="1.333"/></bsdf>{UNSHADED}</bsdf></scene>'
    )
    assert "bsdf conductor of no material is a mirror" in " ".join(note for note, _ in notes)


def test_first_names_of_bsdfs() -> None:
    for old, new in (("mixture", "mixturebsdf"), ("bump", "bumpmap")):
        body = '<scene><bsdf type="{}"><string name="weights" value="1"/><bsdf type="diffuse"/></bsdf></scene>'
        assert upgraded(body.format(old))[0] == upgraded(body.format(new))[0]


def test_mfilm_has_one_pixel() -> None:
    side = '<integer name="{}" value="{}"/>'
    for given, sizes in (
        ("", {"width": "1", "height": "1"}),
        ("width", {"width": "8", "height": "1"}),
    ):
        text, _ = upgraded(f'<film type="mfilm">{side.format(given, 8) if given else ""}</film>')
        film = etree.fromstring(text)
        assert film.get("type") == "hdrfilm"
        assert {child.get("name"): child.get("value") for child in film} == sizes


def test_even_light_is_told() -> None:
    light = '<emitter type="point"><spectrum name="intensity" value="{}"/></emitter>'
    assert [note for note, _ in upgraded(light.format("2"))[1]] == [
        "light of one number is an even spectrum, as in Mitsuba 3: reddish"
    ]
    assert not upgraded(light.format("400:1 700:2"))[1]


def test_wrap_modes_and_gamma() -> None:
    text, _ = upgraded(
        '<texture type="bitmap"><string name="wrapModeU" value="clamp"/><string name="wrapModeV"'
        ' value="clamp"/><float name="gamma" value="-1"/></texture>'
    )
    assert text == '<texture type="bitmap"><string name="wrap_mode" value="clamp"/></texture>'
    other = '<texture type="bitmap"><float name="gamma" value="2.2"/></texture>'
    assert upgraded(other)[0] == '<texture type="bitmap"/>'


def test_the_scale_of_a_bump_map() -> None:
    text, _ = upgraded(
        '<bsdf type="bumpmap"><texture name="map" type="scale"><float name="scale" value="50"/>'
        '<texture type="bitmap"/></texture><bsdf type="diffuse"/></bsdf>'
    )
    assert text == (
        '<bsdf type="bumpmap"><texture type="bitmap"/><bsdf type="diffuse"/>'
        f'{UNSHADED}<float name="scale" value="50"/></bsdf>'
    )


@pytest.mark.parametrize(
    ("weights", "bsdfs", "expected"),
    [
        ("0.25, 0.75", 2, [0.25, 0.75]),
        ("0.2 0.3 0.5", 3, [0.2, 0.3, 0.5]),
        ("0.2 0.3", 2, [0.2, 0.3, 0.5]),
        ("1", 1, [1.0, 0.0]),
    ],
)
def test_a_mixture_is_blends(weights: str, bsdfs: int, expected: list[float]) -> None:
    """The weights that the leaves of the blends have."""
    inner = "".join(f'<bsdf type="diffuse" id="b{i}"/>' for i in range(bsdfs))
    root = etree.fromstring(
        f'<bsdf type="mixturebsdf" id="m"><string name="weights" value="{weights}"/>{inner}</bsdf>'
    )
    upgrade.upgrade(root, "f.xml", upgrade.Notes())
    found = []
    node, left = root, 1.0
    while True:
        assert node.get("type") == "blendbsdf"
        first, second = (child for child in node if child.tag == "bsdf")
        (weight,) = (float(child.get("value")) for child in node if child.tag == "float")
        found.append(left * (1 - weight))
        left *= weight
        if second.get("type") != "blendbsdf":
            found.append(left)
            break
        node = second
    np.testing.assert_allclose(found, expected, atol=1e-15)
    assert root.get("id") == "m" and first is not None


@pytest.mark.parametrize("weights", ["0.5", "0.5 0.6", "-0.1 0.5", "0 0"])
def test_bad_weights_are_refused(weights: str) -> None:
    with pytest.raises(SceneError, match="weights"):
        upgraded(
            f'<bsdf type="mixturebsdf"><string name="weights" value="{weights}"/>'
            '<bsdf type="diffuse"/><bsdf type="diffuse"/></bsdf>'
        )


@pytest.mark.parametrize("name", ["bdpt", "sppm", "photonmapper", "mlt", "volpath_simple"])
def test_integrators_of_the_same_expectation(name: str) -> None:
    text, notes = upgraded(
        f'<scene><integrator type="{name}"><integer name="maxDepth" value="5"/>'
        '<integer name="photonCount" value="9"/></integrator></scene>'
    )
    assert text == (
        '<scene><integrator type="path"><integer name="max_depth" value="5"/></integrator></scene>'
    )
    assert any("has the same expectation" in note for note, _ in notes)
    inner = f'<integrator type="{name}"/><medium type="homogeneous"/>'
    assert 'type="volpath"' in upgraded(f"<scene>{inner}</scene>")[0]


def test_points_of_light_end_at_depth_5() -> None:
    for held, depth in (("", 5), ('<integer name="maxDepth" value="9"/>', 9)):
        text, _ = upgraded(f'<scene><integrator type="vpl">{held}</integrator></scene>')
        assert f'<integer name="max_depth" value="{depth}"/></integrator>' in text
        assert text.count("max_depth") == 1


def test_adaptive_is_what_it_holds() -> None:
    text, _ = upgraded(
        '<scene><integrator type="adaptive"><float name="maxError" value="5"/><integrator'
        ' type="bdpt"><integer name="maxDepth" value="3"/></integrator></integrator></scene>'
    )
    assert text == (
        '<scene><integrator type="path"><integer name="max_depth" value="3"/></integrator></scene>'
    )


def test_what_was_read_otherwise_is_told(tmp_path: Path) -> None:
    path = tmp_path / "scene.xml"
    path.write_text(f'<scene version="0.6.0">\n<integrator type="sppm"/>{SENSOR}{LIGHT}</scene>')
    assert any("scene.xml:2: " in n and "sppm runs as path" in n for n in vr.load_file(path).notes)


def test_included_files_are_upgraded(tmp_path: Path) -> None:
    (tmp_path / "lamp.xml").write_text(
        '<emitter version="0.5.0" type="point"><spectrum name="intensity" value="1 2 3"/></emitter>'
    )
    (tmp_path / "old.xml").write_text(
        '<scene version="0.5.0"><shape type="cube"><transform name="toWorld"/></shape></scene>'
    )
    (tmp_path / "unversioned.xml").write_text(
        '<shape type="cube"><transform name="toWorld"/></shape>'
    )
    body = f'{SENSOR}<include filename="lamp.xml"/><include filename="old.xml"/>'
    for version in ("0.5.0", "3.0.0"):
        assert read(tmp_path, version, body).light_intensity.tolist() == [[1.0, 2.0, 3.0]]
    inherits = body + '<include filename="unversioned.xml"/>'
    assert len(read(tmp_path, "0.5.0", inherits).vertices) == 48
    with pytest.raises(SceneError, match='unversioned.xml:1: cube: unknown parameter "toWorld"'):
        read(tmp_path, "3.0.0", inherits)


def approximated(old: str) -> tuple[str, list[str]]:
    """A bsdf after the upgrade, on one line, and what is said of it."""
    root = etree.fromstring(f'<scene version="0.6.0">\n{old}</scene>')
    notes = upgrade.Notes()
    upgrade.upgrade(root, "f.xml", notes)
    assert all(place == "f.xml:2" for _, place in notes.approximated)
    found = etree.tostring(root[0], with_tail=False).decode()
    return re.sub(r">\s+<", "><", found), [text for text, _ in notes.approximated]


def bsdf(plugin: str, *content: str) -> str:
    return f'<bsdf type="{plugin}">{"".join(content)}</bsdf>'


def rgb(name: str, value: str) -> str:
    return f'<rgb name="{name}" value="{value}"/>'


def number(name: str, value: object) -> str:
    return f'<float name="{name}" value="{value}"/>'


BECKMANN = '<string name="distribution" value="beckmann"/>'
BITMAP = '<texture type="bitmap" name="{}"/>'
BK7 = '<string name="int_ior" value="bk7"/>'
ROUGH_METAL = bsdf("roughconductor", '<string name="material" value="Cu"/>', number("alpha", 0.2))
COPPER = '<string name="material" value="Cu"/>'
#: What Mitsuba 0.x has -> what stands for it, and what is said; sqrt(2 / (4 n + 2)) = 0.1 for 49.5.
APPROXIMATED = {
    "roughdiffuse": (
        bsdf("roughdiffuse", rgb("reflectance", "0.1 0.2 0.3"), number("alpha", 0.2)),
        bsdf("diffuse", rgb("reflectance", "0.1 0.2 0.3")),
        "bsdf roughdiffuse is rendered as diffuse",
    ),
    "phong": (
        bsdf("phong", number("exponent", 49.5), rgb("specularReflectance", "0.25 0.125 0"), rgb("diffuseReflectance", "0.75 0 0.375")),
        bsdf("roughplastic", rgb("specular_reflectance", "1.0 0.5 0.0"), rgb("diffuse_reflectance", "1.0 0.0 0.5"), number("int_ior", 3.0), number("ext_ior", 1), number("alpha", 0.1), BECKMANN),
        "bsdf phong is rendered as roughplastic of alpha 0.1",
    ),
    "phong of a texture": (
        bsdf("phong", number("exponent", 49.5), BITMAP.format("diffuseReflectance"), rgb("specularReflectance", "0.25")),
        bsdf("roughplastic", f'<texture type="bitmap" name="diffuse_reflectance">{number("gain", 1 / 0.75)}</texture>', rgb("specular_reflectance", "1.0 1.0 1.0"), number("int_ior", 3.0), number("ext_ior", 1), number("alpha", 0.1), BECKMANN),
        "bsdf phong is rendered as roughplastic of alpha 0.1",
    ),
    "phong of a spectrum": (
        bsdf("phong", number("exponent", 49.5), '<spectrum name="diffuseReflectance" value="400:0.375, 700:0.75"/>', rgb("specularReflectance", "0.25")),
        bsdf("roughplastic", '<spectrum name="diffuse_reflectance" value="400:0.5 700:1.0"/>', rgb("specular_reflectance", "1.0 1.0 1.0"), number("int_ior", 3.0), number("ext_ior", 1), number("alpha", 0.1), BECKMANN),
        "bsdf phong is rendered as roughplastic of alpha 0.1",
    ),
    "phong of sRGB": (
        bsdf("phong", number("exponent", 49.5), '<srgb name="diffuseReflectance" value="0.03876 0 0"/>', rgb("specularReflectance", "0.25")),
        bsdf("roughplastic", rgb("specular_reflectance", "1.0 1.0 1.0"), rgb("diffuse_reflectance", f"{0.03876 / 12.92 / 0.75!r} 0.0 0.0"), number("int_ior", 3.0), number("ext_ior", 1), number("alpha", 0.1), BECKMANN),
        "bsdf phong is rendered as roughplastic of alpha 0.1",
    ),
    "phong of a parameter": (
        bsdf("phong", number("exponent", 49.5), rgb("diffuseReflectance", "$x"), rgb("specularReflectance", "0.25")),
        bsdf("roughplastic", rgb("diffuse_reflectance", "$x"), rgb("specular_reflectance", "1.0 1.0 1.0"), number("int_ior", 3.0), number("ext_ior", 1), number("alpha", 0.1), BECKMANN),
        "bsdf phong is rendered as roughplastic of alpha 0.1, its base 0.75 times as bright",
    ),
    "roughdiffuse by its other name": (
        bsdf("roughdiffuse", rgb("diffuseReflectance", "0.1 0.2 0.3"), number("alpha", 0.2)),
        bsdf("diffuse", rgb("reflectance", "0.1 0.2 0.3")),
        "bsdf roughdiffuse is rendered as diffuse",
    ),
    "ward of a metal": (
        bsdf("ward", number("alphaU", 0.1), number("alphaV", 0.4), rgb("diffuseReflectance", "0"), rgb("specularReflectance", "0.5"), '<string name="variant" value="balanced"/>'),
        bsdf("roughconductor", rgb("specular_reflectance", "0.5 0.5 0.5"), number("alpha", 0.2), BECKMANN),
        "bsdf ward is rendered as roughconductor of alpha 0.2",
    ),
    "ward without mirrors": (
        bsdf("ward", rgb("specularReflectance", "0"), rgb("diffuseReflectance", "0.1 0.2 0.3")),
        bsdf("diffuse", rgb("reflectance", "0.1 0.2 0.3")),
        "",
    ),
    "slopes": (
        bsdf("roughdielectric", number("alpha", 0.2), BECKMANN.replace("beckmann", "phong")),
        bsdf("roughdielectric", number("alpha", 0.2), BECKMANN),
        "bsdf roughdielectric: slopes of phong are rendered as beckmann",
    ),
    "coating of diffuse": (
        bsdf("coating", number("intIOR", 1.7), bsdf("diffuse", BITMAP.format("reflectance"))),
        bsdf("plastic", number("int_ior", 1.7), BITMAP.format("diffuse_reflectance")),
        "bsdf coating is rendered as plastic",
    ),
    "coating that absorbs": (
        bsdf("coating", number("thickness", 0.5), rgb("sigmaA", "0 0 1000"), bsdf("diffuse", rgb("reflectance", "0.1 0.2 0.3"))),
        bsdf("plastic", BK7, rgb("diffuse_reflectance", "0.1 0.2 0.0")),
        "bsdf coating is rendered as plastic, with its absorption at normal incidence",
    ),
    "rough coating": (
        bsdf("roughcoating", number("alpha", 0.3), BECKMANN.replace("beckmann", "as"), bsdf("diffuse")),
        bsdf("roughplastic", number("alpha", 0.3), BECKMANN, BK7),
        "bsdf roughcoating is rendered as roughplastic",
    ),
    "coating of metal": (
        bsdf("coating", rgb("sigmaA", "0 0 1000"), ROUGH_METAL),
        bsdf("roughconductor", COPPER, number("alpha", 0.2), rgb("specular_reflectance", "1.0 1.0 0.0")),
        "bsdf coating is rendered without its coat, as roughconductor, with its absorption at normal incidence",
    ),
    "coating of both sides": (
        bsdf("coating", bsdf("twosided", ROUGH_METAL)),
        bsdf("twosided", ROUGH_METAL),
        "bsdf coating is rendered without its coat, as roughconductor",
    ),
    "coating of both sides in both sides": (
        bsdf("twosided", bsdf("coating", bsdf("twosided", ROUGH_METAL))),
        bsdf("twosided", ROUGH_METAL),
        "bsdf coating is rendered without its coat, as roughconductor",
    ),
    "coating of what is approximated": (
        bsdf("coating", rgb("sigmaA", "1"), '<bsdf type="thindielectric"/>'),
        '<bsdf type="thindielectric"/>',
        "bsdf coating is rendered without its coat, as thindielectric and without its absorption",
    ),
}  # fmt: skip


@pytest.mark.parametrize("name", APPROXIMATED)
def test_what_is_nearest_stands_for_what_has_no_counterpart(name: str) -> None:
    old, new, text = APPROXIMATED[name]
    found, told = approximated(old)
    assert found == new
    assert text in told if text else not told


@pytest.mark.parametrize("value", ["-1", "0", "1e308", "1e-320", "nan", "1 2", "", "$x", "1:2"])
@pytest.mark.parametrize(
    ("plugin", "name"),
    [
        ("phong", "exponent"), ("phong", "specular_reflectance"), ("phong", "diffuse_reflectance"),
        ("ward", "alpha_u"), ("coating", "sigma_a"), ("coating", "thickness"),
    ],
)  # fmt: skip
def test_odd_numbers_of_what_is_approximated(
    tmp_path: Path, plugin: str, name: str, value: str
) -> None:
    held = bsdf("conductor") + rgb("sigma_a", "1e308") if plugin == "coating" else ""
    material = bsdf(plugin, held if name != "sigma_a" else bsdf("diffuse"), rgb(name, value))
    try:
        read(tmp_path, "0.6.0", f'{SENSOR}{LIGHT}<shape type="cube">{material}</shape>')
    except SceneError as error:
        assert "scene-0.6.0.xml:1: " in str(error)


@pytest.mark.parametrize("order", [1, -1])
def test_a_coating_of_a_reference(tmp_path: Path, order: int) -> None:
    """What it refers to, before or after it, is read as it will be, and keeps its name alone."""
    base = '<bsdf type="diffuse" id="a"><rgb name="diffuseReflectance" value="0.1 0.2 0.3"/></bsdf>'
    parts = (base, '<bsdf type="coating" id="b"><ref id="a"/></bsdf>')
    shapes = "".join(f'<shape type="cube"><ref id="{i}"/></shape>' for i in "ab")
    scene = read(tmp_path, "0.6.0", SENSOR + LIGHT + "".join(parts[::order]) + shapes)
    assert [vr.columns.MATERIAL_KINDS[k] for k in scene.material_kind] == ["diffuse", "plastic"]
    np.testing.assert_array_equal(scene.reflectance, np.float32([[0.1, 0.2, 0.3]] * 2))
    with pytest.raises(SceneError, match='unknown bsdf "coating"'):
        read(tmp_path, "0.6.0", SENSOR + '<bsdf type="coating"><ref id="c"/></bsdf>')


def test_coats_without_end_are_refused(tmp_path: Path) -> None:
    ring = '<bsdf type="coating" id="a"><ref id="b"/></bsdf><bsdf type="coating" id="b"><ref id="a"/></bsdf>'
    for body in (
        ring,
        ring.replace('id="b"', 'id="a"'),
        "<bsdf type='coating'>" * 25 + "</bsdf>" * 25,
    ):
        with pytest.raises(SceneError):
            read(tmp_path, "0.6.0", SENSOR + body)
    chain = "".join(
        f'<bsdf type="coating" id="{i}"><ref id="{i - 1}"/></bsdf>' for i in range(1, 60)
    )
    for order in (1, -1):
        coats = re.findall("<bsdf.*?</bsdf>", '<bsdf type="conductor" id="0"></bsdf>' + chain)
        try:
            read(tmp_path, "0.6.0", SENSOR + "".join(coats[::order]))
        except SceneError as error:
            assert 'unknown bsdf "coating"' in str(error)


def test_approximations_are_warnings(tmp_path: Path) -> None:
    path = tmp_path / "scene.xml"
    body = f'{SENSOR}{LIGHT}<shape type="cube"><bsdf type="phong"/></shape>'
    path.write_text(f'<scene version="0.6.0">\n{body}</scene>')
    with pytest.warns(SceneWarning, match="scene.xml:2: bsdf phong is rendered as roughplastic"):
        vr.load_file(path)
    with pytest.raises(SceneError, match="an error by strict"):
        vr.load_file(path, strict=True)


@pytest.mark.parametrize("exponent", [50, 400])
def test_the_lobe_of_a_phong(tmp_path: Path, exponent: int) -> None:
    """ks (n + 2) / (2 pi) cos^n at normal incidence, within a twentieth down to 0.6 of its peak."""
    metal = bsdf("phong", number("exponent", exponent), rgb("diffuseReflectance", "0"), rgb("specularReflectance", "0.5"))  # fmt: skip
    for tenths in (0, 5, 10):
        angle = tenths / 10 / np.sqrt(exponent)  # from the mirrored direction
        x, z = 5 * np.sin(angle), 5 * np.cos(angle)
        body = (
            '<sensor type="perspective"><float name="fov" value="0.001"/>'
            f'<transform name="toWorld"><lookAt origin="{x} 0 {z}" target="0 0 0" up="0 1 0"/>'
            '</transform><film type="ldrfilm"><integer name="width" value="1"/>'
            '<integer name="height" value="1"/><rfilter type="box"/></film></sensor>'
            f'<shape type="rectangle">{metal}</shape><emitter type="directional">'
            '<vector name="direction" z="-1"/><rgb name="irradiance" value="1"/></emitter>'
        )
        image = vr.render(read(tmp_path, "0.6.0", body), spp=4, device="cpu").image
        lobe = 0.5 * (exponent + 2) / (2 * np.pi) * np.cos(angle) ** exponent
        assert abs(image[0, 0, 0] / lobe - 1) < 0.05


def test_today_is_not_upgraded(tmp_path: Path) -> None:
    with pytest.raises(SceneError, match='unknown parameter "toWorld"'):
        read(tmp_path, "2.1.0", f'{SENSOR}<shape type="cube"><transform name="toWorld"/></shape>')
