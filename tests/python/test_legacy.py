# ruff: noqa: E501 (the tables of what is read)
"""What Mitsuba 0.x had and today has not: the scene that stands for it, and what is said."""

from __future__ import annotations

import math
import warnings
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from PIL import Image

import veriray as vr
from veriray.errors import SceneError, SceneWarning
from veriray.formats import legacy_media

SENSOR = '<sensor type="perspective"><float name="fov" value="40"/></sensor>'
LIGHT = '<emitter type="constant"/>'
BALL = SENSOR + LIGHT + '<shape type="sphere">{}</shape>'
LENS = '{}<emitter type="constant"/><shape type="sphere"/>'
FOG = BALL.format('<bsdf type="null"/><medium type="{}" name="interior">{}</medium>')
SKIN = '<rgb name="sigma_s" value="0.74 0.88 1.01"/><rgb name="sigma_a" value="0.032 0.17 0.48"/>'
DIFFUSE = BALL.format('<bsdf type="diffuse">{}</bsdf>')
TEXTURE = DIFFUSE.format('<texture type="{}" name="reflectance">{}</texture>')
FILE = '<string name="filename" value="{}"/>'
VOLUME = '<volume name="{}" type="gridvolume">' + FILE.format("a.vol") + "</volume>"


def read(folder: Path, version: str, body: str) -> tuple[vr.Scene, str]:
    """The scene of a file, and its warnings."""
    path = folder / f"scene-{version}.xml"
    path.write_text(f'<scene version="{version}">\n{body}</scene>', encoding="utf-8")
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always")
        scene = vr.load_file(path)
    return scene, "; ".join(str(one.message) for one in caught)


@pytest.fixture(name="folder")
def _folder(tmp_path: Path) -> Path:
    texels = np.arange(4 * 8 * 4, dtype=np.uint8).reshape(4, 8, 4)
    Image.fromarray(texels).save(tmp_path / "a.png")
    cells = np.linspace(0, 1, 8).astype("<f4").tobytes()
    head = b"VOL\3" + np.array([1, 2, 2, 2, 1], "<i4").tobytes()
    box = np.array([0, 0, 0, 1, 1, 1], "<f4").tobytes()
    (tmp_path / "a.vol").write_bytes(head + box + cells)
    return tmp_path


#: What an old file says; the same in today's terms; a part of the warning, "" for none.
CASES = {
    "luminaire": ('<luminaire type="constant"/>' + SENSOR + '<shape type="sphere"/>', LENS.format(SENSOR), ""),
    "camera": (LENS.format('<camera type="perspective"><float name="fov" value="30"/></camera>'), LENS.format('<sensor type="perspective"><float name="fov" value="30"/></sensor>'), ""),
    "parameter that nothing reads": (BALL.format('<string name="comment" value="x"/>'), BALL.format(""), 'shape sphere: "comment" is left out'),
    "aperture of a pinhole": (LENS.format('<sensor type="perspective"><float name="apertureRadius" value="1"/><float name="fov" value="40"/></sensor>'), LENS.format(SENSOR), 'depth of field needs the sensor "thinlens"'),
    "animation": (BALL.format('<animation name="toWorld"><transform time="0"><translate x="1"/></transform><transform time="1"><translate x="2"/></transform></animation>'), BALL.format('<transform name="to_world"><translate x="1"/></transform>'), "its first transform counts"),
    "difftrans": (BALL.format('<bsdf type="difftrans"><rgb name="transmittance" value="0.1 0.2 0.3"/></bsdf>'), BALL.format('<bsdf type="principledthin"><rgb name="base_color" value="0.1 0.2 0.3"/><float name="diff_trans" value="2"/><float name="eta" value="1"/><float name="roughness" value="1"/></bsdf>'), ""),
    "hk": (BALL.format('<bsdf type="hk"><rgb name="sigmaS" value="1 2 3"/><rgb name="sigmaA" value="1 2 1"/><float name="thickness" value="2"/></bsdf>'), BALL.format('<bsdf type="principledthin"><rgb name="base_color" value="0.5 0.5 0.75"/><float name="diff_trans" value="1"/><float name="eta" value="1"/><float name="roughness" value="1"/></bsdf>'), "bsdf hk is rendered as principledthin"),
    "irawan": (BALL.format('<bsdf type="irawan">' + FILE.format("x.wv") + '<float name="repeatU" value="9"/></bsdf>'), BALL.format('<bsdf type="diffuse"/>'), "bsdf irawan is rendered as diffuse"),
    "two sides": (BALL.format('<bsdf type="twosided"><bsdf type="plastic"/><bsdf type="diffuse"/></bsdf>'), BALL.format('<bsdf type="twosided"><bsdf name="front" type="plastic"/><bsdf name="back" type="diffuse"/></bsdf>'), ""),
    "dipole": (BALL.format('<subsurface type="dipole"><rgb name="sigmaS" value="0"/><rgb name="sigmaA" value="1"/></subsurface>'), DIFFUSE.format('<rgb name="reflectance" value="0"/>'), "subsurface dipole is rendered as a diffuse surface"),
    "gridtexture": (TEXTURE.format("gridtexture", '<rgb name="color0" value="0.1 0.2 0.3"/><float name="lineWidth" value="0.1"/>'), TEXTURE.format("checkerboard", '<rgb name="color0" value="0.1 0.2 0.3"/><rgb name="color1" value="0.1 0.2 0.3"/>'), "without its lines"),
    "wireframe": (TEXTURE.format("wireframe", '<rgb name="interiorColor" value="0.1"/>'), TEXTURE.format("checkerboard", '<rgb name="color0" value="0.1"/><rgb name="color1" value="0.1"/>'), "without its lines"),
    "scale of checks": (TEXTURE.format("scale", '<float name="scale" value="0.5"/><texture type="checkerboard"><rgb name="color0" value="0.5"/><rgb name="color1" value="1"/></texture>'), TEXTURE.format("checkerboard", '<rgb name="color0" value="0.25"/><rgb name="color1" value="0.5"/>'), ""),
    "scale of a colour": (TEXTURE.format("scale", '<float name="scale" value="0.5"/><rgb name="value" value="0.5 1 0.25"/>'), TEXTURE.format("checkerboard", '<rgb name="color0" value="0.25 0.5 0.125"/><rgb name="color1" value="0.25 0.5 0.125"/>'), ""),
    "scale of 1": (TEXTURE.format("scale", '<float name="scale" value="1"/><texture type="bitmap">' + FILE.format("a.png") + "</texture>"), TEXTURE.format("bitmap", FILE.format("a.png")), ""),
    "gamma": (TEXTURE.format("bitmap", FILE.format("a.png") + '<float name="gamma" value="2.2"/>'), TEXTURE.format("bitmap", FILE.format("a.png")), 'a gamma of "2.2" is read as sRGB'),
    "wrap zero": (TEXTURE.format("bitmap", FILE.format("a.png") + '<string name="wrapMode" value="zero"/>'), TEXTURE.format("bitmap", FILE.format("a.png") + '<string name="wrap_mode" value="clamp"/>'), "it is as at the edge, not zero"),
    "scale by a colour": (TEXTURE.format("scale", '<rgb name="scale" value="0.5 0.25 1"/><texture type="bitmap">' + FILE.format("a.png") + "</texture>"), TEXTURE.format("bitmap", FILE.format("a.png") + '<rgb name="scale" value="0.5 0.25 1"/>'), ""),
    "scale of a scale": (TEXTURE.format("scale", '<float name="scale" value="0.5"/><texture type="scale"><rgb name="scale" value="0.5 1 0.25"/><texture type="bitmap">' + FILE.format("a.png") + "</texture></texture>"), TEXTURE.format("bitmap", FILE.format("a.png") + '<rgb name="scale" value="0.25 0.5 0.125"/>'), ""),
    "scale of a texture by id": ('<texture type="bitmap" id="t">' + FILE.format("a.png") + "</texture>" + TEXTURE.format("scale", '<ref id="t"/><float name="scale" value="0.5"/>'), TEXTURE.format("bitmap", FILE.format("a.png") + '<float name="scale" value="0.5"/>'), ""),
    "scale of a later texture": (TEXTURE.format("scale", '<ref id="t"/><float name="scale" value="0.5"/>') + '<texture type="bitmap" id="t"><string name="wrapMode" value="zero"/>' + FILE.format("a.png") + "</texture>", TEXTURE.format("bitmap", FILE.format("a.png") + '<float name="scale" value="0.5"/><string name="wrap_mode" value="clamp"/>'), "beyond its edge"),
    "wrap u and v": (TEXTURE.format("bitmap", FILE.format("a.png") + '<string name="wrapModeU" value="mirror"/><string name="wrapModeV" value="clamp"/>'), TEXTURE.format("bitmap", FILE.format("a.png") + '<string name="wrap_mode" value="mirror"/>'), "wrap mode mirror in u and v"),
    "border": (BALL.format('<medium type="homogeneous" name="interior"/>'), FOG.format("homogeneous", SKIN), ""),
    "border by id": ('<medium type="homogeneous" id="fog"/>' + BALL.format('<ref id="fog" name="exterior"/>'), BALL.format('<bsdf type="null"/><medium type="homogeneous" name="exterior">' + SKIN + "</medium>"), ""),
    "border of a lamp": (BALL.format('<medium type="homogeneous" name="interior"/><emitter type="area"/>'), BALL.format('<medium type="homogeneous" name="interior">' + SKIN + '</medium><emitter type="area"/>'), ""),
    "border with a bsdf by id": ('<bsdf type="plastic" id="b"/>' + BALL.format('<ref id="b"/><medium type="homogeneous" name="interior"/>'), BALL.format('<bsdf type="plastic"/><medium type="homogeneous" name="interior">' + SKIN + "</medium>"), ""),
    "rayleigh": (FOG.format("homogeneous", '<spectrum name="sigmaT" value="1"/><phase type="rayleigh"/>'), FOG.format("homogeneous", '<spectrum name="sigma_t" value="1"/><phase type="rayleigh"/>'), ""),
    "microflake": (FOG.format("homogeneous", '<spectrum name="sigmaT" value="1"/><phase type="microflake"><float name="stddev" value="0.1"/></phase>'), FOG.format("homogeneous", '<spectrum name="sigma_t" value="1"/><phase type="isotropic"/>'), "phase microflake is rendered as isotropic"),
    "mixturephase": (FOG.format("homogeneous", '<spectrum name="sigmaT" value="1"/><phase type="mixturephase"><string name="weights" value="1, 3"/><phase type="hg"><float name="g" value="0.5"/></phase><phase type="isotropic"/></phase>'), FOG.format("homogeneous", '<spectrum name="sigma_t" value="1"/><phase type="blendphase"><float name="weight" value="0.75"/><phase type="hg"><float name="g" value="0.5"/></phase><phase type="isotropic"/></phase>'), ""),
    "mixture of three": (FOG.format("homogeneous", '<spectrum name="sigmaT" value="1"/><phase type="mixturephase"><string name="weights" value="0.5, 0.25, 0.25"/><phase type="hg"><float name="g" value="0.5"/></phase><phase type="isotropic"/><phase type="rayleigh"/></phase>'), FOG.format("homogeneous", '<spectrum name="sigma_t" value="1"/><phase type="blendphase"><float name="weight" value="0.5"/><phase type="hg"><float name="g" value="0.5"/></phase><phase type="blendphase"><float name="weight" value="0.5"/><phase type="isotropic"/><phase type="rayleigh"/></phase></phase>'), ""),
    "material": (FOG.format("homogeneous", '<string name="material" value="Ketchup"/><float name="scale" value="2"/>'), FOG.format("homogeneous", '<rgb name="sigma_s" value="0.18 0.07 0.03"/><rgb name="sigma_a" value="0.061 0.97 1.45"/><float name="scale" value="2"/>'), ""),
    "no material": (FOG.format("homogeneous", ""), FOG.format("homogeneous", SKIN), ""),
    "no absorption": (FOG.format("homogeneous", '<rgb name="sigmaS" value="2"/>'), FOG.format("homogeneous", '<rgb name="sigma_s" value="2"/><rgb name="sigma_a" value="0"/>'), ""),
    "density": (FOG.format("heterogeneous", '<string name="method" value="woodcock"/>' + VOLUME.format("density") + '<float name="albedo" value="0.9"/><float name="scale" value="3"/>'), FOG.format("heterogeneous", VOLUME.format("sigma_t") + '<float name="albedo" value="0.9"/><float name="scale" value="3"/>'), ""),
    "volcache": (FOG.format("heterogeneous", '<volume type="volcache" name="density">' + VOLUME.format("a") + "</volume>"), FOG.format("heterogeneous", VOLUME.format("sigma_t")), ""),
    "orientation": (FOG.format("heterogeneous", VOLUME.format("density") + '<volume type="constvolume" name="orientation"><vector name="value" x="1"/></volume>'), FOG.format("heterogeneous", VOLUME.format("sigma_t")), "orientation is left out"),
    "filter": (LENS.format('<sensor type="perspective"><float name="fov" value="40"/><film type="video"><rfilter type="wsinc"/></film></sensor>'), LENS.format(SENSOR), 'rfilter "wsinc" is not known'),
    "sampler": (LENS.format('<sensor type="perspective"><float name="fov" value="40"/><sampler type="haltonsampler"><integer name="sampleCount" value="9"/></sampler></sensor>'), LENS.format('<sensor type="perspective"><float name="fov" value="40"/><sampler type="independent"><integer name="sample_count" value="9"/></sampler></sensor>'), ""),
    "distorted camera": (LENS.format('<sensor type="perspective_rdist"><float name="fov" value="40"/><string name="kc" value="0.1, 0.2"/></sensor>'), LENS.format(SENSOR), "without its distortion"),
    "telecentric": (LENS.format('<sensor type="telecentric"><float name="apertureRadius" value="0.1"/><transform name="toWorld"><scale value="2"/></transform></sensor>'), LENS.format('<sensor type="orthographic"><transform name="to_world"><scale value="2"/></transform></sensor>'), "without its blur"),
    "openness": ('<integrator type="ao"><integer name="shadingSamples" value="4"/></integrator>' + BALL.format(""), '<integrator type="path"/>' + BALL.format(""), "integrator ao is rendered as path"),
    "lamp": (BALL.format('<emitter type="area"><rgb name="intensity" value="1 2 3"/></emitter>'), BALL.format('<emitter type="area"><rgb name="radiance" value="1 2 3"/></emitter>'), ""),
    "bins": (DIFFUSE.format(f'<spectrum name="reflectance" value="{", ".join(["0.25"] * 30)}"/>'), DIFFUSE.format('<spectrum name="reflectance" value="{}"/>'.format(" ".join(f"{360 + (i + 0.5) * (470 / 30)!r}:0.25" for i in range(30)))), ""),
}  # fmt: skip


@pytest.mark.parametrize("name", CASES)
def test_what_stands_for_it(folder: Path, name: str) -> None:
    old, new, warning = CASES[name]
    found, told = read(folder, "0.6.0", old)
    expected, _ = read(folder, "3.0.0", new)
    assert found.sha256 == expected.sha256
    assert warning in told if warning else not told


@pytest.mark.parametrize(
    "body",
    [
        BALL.format('<subsurface type="singlescatter"/>'),
        '<texture type="scale" id="t"><ref id="t"/></texture>' + TEXTURE.format("scale", '<ref id="t"/>'),
        TEXTURE.format("scale", '<ref id="none"/>'),
        FOG.format("homogeneous", '<string name="material" value="ambrosia"/>'),
        TEXTURE.format("curvature", ""),
        TEXTURE.format("scale", '<float name="scale" value="x"/><texture type="bitmap"/>'),
        FOG.format("homogeneous", '<phase type="mixturephase"><string name="weights" value="a"/></phase>'),
        FOG.format("homogeneous", '<phase type="mixturephase"><string name="weights" value="0"/><phase type="hg"/></phase>'),
        SENSOR + '<emitter type="collimated"/>',
        BALL.format('<animation name="toWorld"/>'),
        BALL.format('<subsurface type="dipole"><string name="material" value="ambrosia"/></subsurface>'),
    ],
)  # fmt: skip
def test_what_nothing_stands_for_is_refused_with_its_line(folder: Path, body: str) -> None:
    with pytest.raises(
        SceneError, match=r"scene-0.6.0.xml:2: .*(unknown|not a number|bitmap|nothing moves)"
    ):
        read(folder, "0.6.0", body)


def test_a_transmitter_lets_its_share_through(folder: Path, cpu: str) -> None:
    """A sheet before an even sky of radiance 1 shows the share that it lets through."""
    body = (
        '<sensor type="perspective"><transform name="toWorld"><lookAt origin="0.1 0.2 -3" target="0 0 0"/>'
        '</transform><float name="fov" value="10"/></sensor><emitter type="constant">'
        '<rgb name="radiance" value="1"/></emitter><shape type="rectangle"><bsdf type="difftrans">'
        '<rgb name="transmittance" value="0.25 0.5 1"/></bsdf></shape>'
    )
    scene, _ = read(folder, "0.6.0", body)
    image = vr.render(scene, spp=256, width=8, height=8, device=cpu).image
    np.testing.assert_allclose(image.mean(axis=(0, 1)), [0.25, 0.5, 1], rtol=2e-3)


def test_the_channel_and_the_scale_of_an_image(folder: Path) -> None:
    """Texels of one channel as they are, alpha linear; the others' curve undone before a scale."""
    png = np.asarray(Image.open(folder / "a.png"))
    for channel, index in (("r", 0), ("g", 1), ("b", 2), ("a", 3)):
        text = FILE.format("a.png") + f'<string name="channel" value="{channel}"/>'
        body = BALL.format(
            f'<bsdf type="mask"><texture type="bitmap" name="opacity">{text}</texture><bsdf type="diffuse"/></bsdf>'
        )
        found, _ = read(folder, "0.6.0", body)
        assert (
            found.texels.view(np.uint8)[: png[..., 0].size].tolist()
            == png[..., index].ravel().tolist()
        )
        assert bool(found.texture_grey[0])
        assert vr.columns.TEXTURE_FORMATS[found.texture_format[0]] == (
            "linear8" if channel == "a" else "srgb8"
        )
    body = TEXTURE.format(
        "scale",
        '<float name="scale" value="0.5"/><texture type="bitmap">'
        + FILE.format("a.png")
        + "</texture>",
    )
    found, _ = read(folder, "0.6.0", body)
    share = png[..., :3] / 255.0
    linear = np.where(share <= 0.04045, share / 12.92, ((share + 0.055) / 1.055) ** 2.4)
    np.testing.assert_allclose(found.texels.view(np.float32), 0.5 * linear.ravel(), rtol=1e-6)


def sun(folder: Path, content: str, plugin: str = "sun") -> Any:
    """The direction in the world of the brightest texel of a sky."""
    scene, _ = read(folder, "0.6.0", SENSOR + f'<emitter type="{plugin}">{content}</emitter>')
    width, height = (int(n) for n in scene.sky_size)
    texels = scene.sky_texels.reshape(height, width, 3)
    row, column = np.unravel_index(int(texels.sum(axis=2).argmax()), (height, width))
    tilt, turn = math.pi * row / (height - 1), 2 * math.pi * (column + 0.5) / width
    # of the image: y up; a column's direction is that of an envmap
    x, z = math.sin(tilt) * math.sin(turn), -math.sin(tilt) * math.cos(turn)
    return np.asarray(scene.sky_to_world) @ [x, math.cos(tilt), z]


def test_up_is_y_and_the_afternoon_sun_stands_in_the_west(folder: Path) -> None:
    """East is x, south z: at 6, 12 and 18 o'clock solar time at the equator the sun is at x, y, -x."""
    place = '<float name="latitude" value="40"/><float name="longitude" value="0"/><float name="timezone" value="0"/>'
    day = '<integer name="year" value="2010"/><integer name="month" value="6"/><integer name="day" value="21"/>'
    for hour, signs in ((8, (1, 1)), (16, (-1, 1))):
        x, y, _ = sun(folder, f'{place}{day}<float name="hour" value="{hour}"/>')
        assert x * signs[0] > 0.5 and y > 0.3
    x, y, z = sun(folder, f'{place}{day}<float name="hour" value="12"/>')
    assert abs(x) < 0.05 and z > 0.2 and y > 0.9  # south of the zenith
    turned = f'<transform name="toWorld"><rotate x="1" angle="90"/></transform>{place}{day}<float name="hour" value="8"/>'
    x, y, z = sun(folder, turned)
    assert x > 0.5 and z > 0.3  # up is z
    given = np.array(sun(folder, '<vector name="sunDirection" x="1" y="2" z="3"/>'))
    assert given @ [1, 2, 3] / math.sqrt(14) > 0.99999


def test_a_sky_and_a_sun_are_one(folder: Path) -> None:
    at = '<vector name="sunDirection" x="1" y="2" z="3"/>'
    two = f'<emitter type="sky">{at}<float name="scale" value="2"/></emitter><emitter type="sun">{at}<float name="scale" value="3"/></emitter>'
    one = f'<emitter type="sunsky">{at}<float name="skyScale" value="2"/><float name="sunScale" value="3"/></emitter>'
    assert (
        read(folder, "0.6.0", SENSOR + two)[0].sha256
        == read(folder, "0.6.0", SENSOR + one)[0].sha256
    )
    dark, _ = read(folder, "0.6.0", SENSOR + f'<emitter type="sky">{at}</emitter>')
    assert dark.sky_size[0] == 1024  # without a sun


def test_the_reflectance_of_a_half_space() -> None:
    """None of a black one and all of a white one, whatever its index; and growing between."""
    for eta in (1.0, 1.3, 1.5):
        assert legacy_media.dipole(0.0, eta) == 0 and legacy_media.dipole(1.0, eta) == 1
        steps = [legacy_media.dipole(k / 50, eta) for k in range(51)]
        assert all(a < b for a, b in zip(steps, steps[1:], strict=False))


def test_colours_of_bytes(folder: Path) -> None:
    rows = "0 0 0 255 0 51\n1 0 0 0 255 0\n0 1 0 0 0 255\n3 0 1 2\n"
    head = "ply\nformat ascii 1.0\nelement vertex 3\n" + "".join(
        f"property float {a}\n" for a in "xyz"
    )
    head += "".join(f"property uchar {c}\n" for c in ("red", "green", "blue"))
    head += "element face 1\nproperty list uchar int vertex_indices\nend_header\n"
    (folder / "a.ply").write_text(head + rows)
    body = (
        SENSOR
        + LIGHT
        + '<shape type="ply">'
        + FILE.format("a.ply")
        + '<bsdf type="diffuse"><texture type="vertexcolors" name="reflectance"/></bsdf></shape>'
    )
    found, _ = read(folder, "0.6.0", body)
    np.testing.assert_allclose(
        found.attribute_values, [[1, 0, 0.2], [0, 1, 0], [0, 0, 1]], rtol=1e-6
    )


def test_today_refuses_what_is_old(folder: Path) -> None:
    for body in (
        CASES["sampler"][0],
        CASES["difftrans"][0],
        CASES["parameter that nothing reads"][0],
    ):
        with pytest.raises(SceneError):
            read(folder, "3.0.0", body)


def test_a_path_of_another_machine(folder: Path) -> None:
    """The longest end of it that is there is read, and said."""
    (folder / "maps").mkdir()
    (folder / "a.png").rename(folder / "maps" / "a.png")
    right = read(folder, "3.0.0", TEXTURE.format("bitmap", FILE.format("maps/a.png")))[0].sha256
    for name in ("/home/nobody/scene/maps/a.png", "C:\\Users\\nobody\\maps\\a.png"):
        path = folder / "scene.xml"
        path.write_text(
            f'<scene version="3.0.0">{TEXTURE.format("bitmap", FILE.format(name))}</scene>'
        )
        with pytest.warns(SceneWarning, match="is not there; maps/a.png is read"):
            assert vr.load_file(path).sha256 == right
    with pytest.raises(SceneError, match="cannot read"):
        read(folder, "3.0.0", TEXTURE.format("bitmap", FILE.format("/x/../maps/a.png")))


def test_a_path_of_another_machine_into_a_folder_beside_the_scene(folder: Path) -> None:
    """The only file of that name there is read; of two none is."""
    (folder / "maps").mkdir()
    (folder / "a.png").rename(folder / "maps" / "a.png")
    right = read(folder, "3.0.0", TEXTURE.format("bitmap", FILE.format("maps/a.png")))[0].sha256
    body = TEXTURE.format("bitmap", FILE.format("D:\\work\\a.png"))
    (folder / "scene.xml").write_text(f'<scene version="3.0.0">{body}</scene>')
    with pytest.warns(SceneWarning, match="is not there; maps/a.png is read"):
        assert vr.load_file(folder / "scene.xml").sha256 == right
    (folder / ".more").mkdir()
    (folder / ".more" / "a.png").write_bytes((folder / "maps" / "a.png").read_bytes())
    assert read(folder, "3.0.0", body)[0].sha256 == right
    (folder / "more").mkdir()
    (folder / ".more" / "a.png").rename(folder / "more" / "a.png")
    with pytest.raises(SceneError, match="cannot read"):
        read(folder, "3.0.0", body)
