# ruff: noqa: E501 (the tables of what is read)
"""What Mitsuba 0.x had and today has not: the scene that stands for it, and what is said."""

from __future__ import annotations

import math
import re
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
#: The same as version 0.x placed it.
PLACED = VOLUME.replace(
    "</", '<boolean name="use_grid_bbox" value="true"/><boolean name="at_corners" value="true"/></'
)
BEYOND = "half a cell beyond its box"
MANUAL = "1/mm, as the manual"
SKIN_SHARE = f'<rgb name="albedo" value="{0.74 / (0.74 + 0.032)!r} {0.88 / (0.88 + 0.17)!r} {1.01 / (1.01 + 0.48)!r}"/>'
CHECKS = '<texture type="checkerboard" name="{}"><rgb name="color0" value="{}"/><rgb name="color1" value="{}"/></texture>'


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
    "border": (BALL.format('<medium type="homogeneous" name="interior"/>'), FOG.format("homogeneous", SKIN), MANUAL),
    "border by id": ('<medium type="homogeneous" id="fog"/>' + BALL.format('<ref id="fog" name="exterior"/>'), BALL.format('<bsdf type="null"/><medium type="homogeneous" name="exterior">' + SKIN + "</medium>"), MANUAL),
    "border of a lamp": (BALL.format('<medium type="homogeneous" name="interior"/><emitter type="area"/>'), BALL.format('<medium type="homogeneous" name="interior">' + SKIN + '</medium><emitter type="area"/>'), MANUAL),
    "border with a bsdf by id": ('<bsdf type="plastic" id="b"/>' + BALL.format('<ref id="b"/><medium type="homogeneous" name="interior"/>'), BALL.format('<bsdf type="plastic"/><medium type="homogeneous" name="interior">' + SKIN + "</medium>"), MANUAL),
    "rayleigh": (FOG.format("homogeneous", '<spectrum name="sigmaT" value="1"/><phase type="rayleigh"/>'), FOG.format("homogeneous", SKIN_SHARE + '<spectrum name="sigma_t" value="1"/><phase type="rayleigh"/>'), ""),
    "microflake": (FOG.format("homogeneous", '<spectrum name="sigmaT" value="1"/><phase type="microflake"><float name="stddev" value="0.1"/></phase>'), FOG.format("homogeneous", SKIN_SHARE + '<spectrum name="sigma_t" value="1"/><phase type="isotropic"/>'), "phase microflake is rendered as isotropic"),
    "mixturephase": (FOG.format("homogeneous", '<spectrum name="sigmaT" value="1"/><phase type="mixturephase"><string name="weights" value="1, 3"/><phase type="hg"><float name="g" value="0.5"/></phase><phase type="isotropic"/></phase>'), FOG.format("homogeneous", SKIN_SHARE + '<spectrum name="sigma_t" value="1"/><phase type="blendphase"><float name="weight" value="0.75"/><phase type="hg"><float name="g" value="0.5"/></phase><phase type="isotropic"/></phase>'), ""),
    "mixture of three": (FOG.format("homogeneous", '<spectrum name="sigmaT" value="1"/><phase type="mixturephase"><string name="weights" value="0.5, 0.25, 0.25"/><phase type="hg"><float name="g" value="0.5"/></phase><phase type="isotropic"/><phase type="rayleigh"/></phase>'), FOG.format("homogeneous", SKIN_SHARE + '<spectrum name="sigma_t" value="1"/><phase type="blendphase"><float name="weight" value="0.5"/><phase type="hg"><float name="g" value="0.5"/></phase><phase type="blendphase"><float name="weight" value="0.5"/><phase type="isotropic"/><phase type="rayleigh"/></phase></phase>'), ""),
    "material": (FOG.format("homogeneous", '<string name="material" value="Ketchup"/><float name="scale" value="2"/>'), FOG.format("homogeneous", '<rgb name="sigma_s" value="0.18 0.07 0.03"/><rgb name="sigma_a" value="0.061 0.97 1.45"/><float name="scale" value="2"/>'), MANUAL),
    "no material": (FOG.format("homogeneous", MANUAL), FOG.format("homogeneous", SKIN), MANUAL),
    "scattering alone": (FOG.format("homogeneous", '<rgb name="sigmaS" value="2"/>'), FOG.format("homogeneous", '<rgb name="sigma_s" value="2"/><rgb name="sigma_a" value="0.032 0.17 0.48"/>'), "sigma_a of material skin1 in 1/mm"),
    "absorption alone of a material": (FOG.format("homogeneous", '<rgb name="sigmaA" value="2"/><string name="material" value="marble"/>'), FOG.format("homogeneous", '<rgb name="sigma_a" value="2"/><rgb name="sigma_s" value="2.19 2.62 3.00"/>'), "sigma_s of material marble in 1/mm"),
    "albedo alone": (FOG.format("homogeneous", '<rgb name="albedo" value="0.5"/>'), FOG.format("homogeneous", f'<rgb name="albedo" value="0.5"/><rgb name="sigma_t" value="{0.74 + 0.032!r} {0.88 + 0.17!r} {1.01 + 0.48!r}"/>'), MANUAL),
    "both coefficients": (FOG.format("homogeneous", '<rgb name="sigmaS" value="2"/><rgb name="sigmaA" value="1"/>'), FOG.format("homogeneous", '<rgb name="sigma_s" value="2"/><rgb name="sigma_a" value="1"/>'), ""),
    "checks as opacity": (BALL.format('<bsdf type="mask">' + CHECKS.format("opacity", "1", "0.25") + '<bsdf type="diffuse"/></bsdf>'), BALL.format('<bsdf type="mask">' + CHECKS.format("opacity", "0.25", "1") + '<bsdf type="diffuse"/></bsdf>'), ""),
    "checks as weight": (BALL.format('<bsdf type="blendbsdf">' + CHECKS.format("weight", "1", "0.25") + '<bsdf type="diffuse"/><bsdf type="plastic"/></bsdf>'), BALL.format('<bsdf type="blendbsdf">' + CHECKS.format("weight", "0.25", "1") + '<bsdf type="diffuse"/><bsdf type="plastic"/></bsdf>'), ""),
    "checks as weight before a blend": (BALL.format('<bsdf type="blendbsdf">' + CHECKS.format("weight", "1", "0.25") + '<bsdf type="blendbsdf"><float name="weight" value="0.5"/><bsdf type="diffuse"/><bsdf type="plastic"/></bsdf><bsdf type="conductor"/></bsdf>'), BALL.format('<bsdf type="blendbsdf">' + CHECKS.format("weight", "0.25", "1") + '<bsdf type="blendbsdf"><float name="weight" value="0.5"/><bsdf type="diffuse"/><bsdf type="plastic"/></bsdf><bsdf type="conductor"/></bsdf>'), ""),
    "scale of checks above 1": (TEXTURE.format("scale", '<float name="scale" value="2"/><texture type="checkerboard"><rgb name="color0" value="0.25"/><rgb name="color1" value="0.75"/></texture>'), TEXTURE.format("checkerboard", '<rgb name="color0" value="0.5"/><rgb name="color1" value="1"/>'), "color1 above 1 is 1"),
    "scale of lines": (TEXTURE.format("scale", '<float name="scale" value="0.5"/><texture type="wireframe"><rgb name="interiorColor" value="0.5"/></texture>'), TEXTURE.format("checkerboard", '<rgb name="color0" value="0.25"/><rgb name="color1" value="0.25"/>'), "without its lines"),
    "density": (FOG.format("heterogeneous", '<string name="method" value="woodcock"/>' + VOLUME.format("density") + '<float name="albedo" value="0.9"/><float name="scale" value="3"/>'), FOG.format("heterogeneous", PLACED.format("sigma_t") + '<float name="albedo" value="0.9"/><float name="scale" value="3"/>'), BEYOND),
    "volcache": (FOG.format("heterogeneous", '<volume type="volcache" name="density">' + VOLUME.format("a") + "</volume>"), FOG.format("heterogeneous", PLACED.format("sigma_t")), BEYOND),
    "orientation": (FOG.format("heterogeneous", VOLUME.format("density") + '<volume type="constvolume" name="orientation"><vector name="value" x="1"/></volume>'), FOG.format("heterogeneous", PLACED.format("sigma_t")), "orientation is left out"),
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
    for said, value in (
        ("", ((0.2 + 0.055) / 1.055) ** 2.4),  # 51 of 255; version 0.x takes them as sRGB
        ('<boolean name="srgb" value="true"/>', ((0.2 + 0.055) / 1.055) ** 2.4),
        ('<boolean name="srgb" value="false"/>', 0.2),
    ):
        found, told = read(folder, "0.6.0", body.replace("<bsdf", said + "<bsdf"))
        expected = [[1, 0, value], [0, 1, 0], [0, 0, 1]]
        np.testing.assert_allclose(found.attribute_values, expected, rtol=1e-6)
        assert not told
    half = '<texture type="scale" name="reflectance"><float name="scale" value="0.5"/><texture type="vertexcolors"/></texture>'
    scaled, _ = read(folder, "0.6.0", re.sub("<texture.*?/>", half, body))
    np.testing.assert_allclose(
        scaled.attribute_values[0], [0.5, 0, 0.5 * ((0.2 + 0.055) / 1.055) ** 2.4], rtol=1e-6
    )


def grid(folder: Path, cells: Any, content: str = "") -> tuple[Any, str]:
    """What takes the unit cube of a density to the world, and the warnings; its file's box is from
    (-1, 0, 2) to (1, 3, 2.5)."""
    head = b"VOL\3" + np.array([1, *cells.shape[::-1], 1], "<i4").tobytes()
    box = np.array([-1, 0, 2, 1, 3, 2.5], "<f4").tobytes()
    (folder / "b.vol").write_bytes(head + box + cells.astype("<f4").tobytes())
    volume = f'<volume name="density" type="gridvolume">{FILE.format("b.vol")}{content}</volume>'
    body = FOG.format("heterogeneous", volume + '<float name="albedo" value="0.5"/>')
    scene, told = read(folder, "0.6.0", body)
    return np.asarray(scene.grid_to_world).reshape(3, 4), told


def test_a_grid_fills_its_box_from_corner_to_corner(folder: Path) -> None:
    """The centres of the outer cells lie on the corners of the box."""
    cells = np.ones((4, 2, 3))
    ends = '<point name="min" x="1" y="2" z="3"/><point name="max" value="2, 4, 6"/>'
    moved = '<transform name="toWorld"><scale value="2"/><translate x="1"/></transform>'
    for content, low, high in (
        ("", [-1, 0, 2], [1, 3, 2.5]),
        (ends, [1, 2, 3], [2, 4, 6]),
        (ends + moved, [3, 4, 6], [5, 8, 12]),
        (moved, [-1, 0, 4], [3, 6, 5]),
    ):
        matrix, told = grid(folder, cells, content)
        first = 0.5 / np.array([3, 2, 4])
        np.testing.assert_allclose(matrix @ [*first, 1], low, atol=1e-6)
        np.testing.assert_allclose(matrix @ [*(1 - first), 1], high, atol=1e-6)
        assert "b.vol" not in told and BEYOND in told
    inner = np.zeros((3, 3, 3))
    inner[1, 1, 1] = 1
    assert not grid(folder, inner)[1]


def test_version_3_of_0(folder: Path) -> None:
    """What version 0.4 changed, and that older files are refused."""
    fog = '<shape type="sphere"><bsdf type="null"/><medium type="homogeneous" name="interior"><rgb name="sigmaS" value="1"/><rgb name="sigmaA" value="1"/><float name="{}" value="4"/></medium></shape>'
    at = '<lookAt origin="0 0 5" target="0 0 0" up="0 1 0"/></transform>'
    old = (
        f'<camera type="thinlens"><float name="apertureRadius" value="0.1"/><float name="focusDepth" value="3"/><float name="fov" value="40"/><transform name="toWorld">{at}</camera>'
        '<luminaire type="constant"><rgb name="intensity" value="3"/></luminaire>'
        '<luminaire type="directional"><rgb name="intensity" value="2"/><vector name="direction" z="1"/></luminaire>'
    ) + fog.format("densityMultiplier")
    new = (
        f'<sensor type="thinlens"><float name="apertureRadius" value="0.1"/><float name="focusDistance" value="3"/><float name="fov" value="40"/><string name="fovAxis" value="smaller"/><transform name="toWorld"><scale x="-1"/>{at}</sensor>'
        '<emitter type="constant"><rgb name="radiance" value="3"/></emitter>'
        '<emitter type="directional"><rgb name="irradiance" value="2"/><vector name="direction" z="1"/></emitter>'
    ) + fog.format("scale")
    expected = read(folder, "0.4.0", new)
    for version in ("0.3.0", "0.3"):
        found, told = read(folder, version, old)
        assert found.sha256 == expected[0].sha256
        assert told.replace(version, "0.4.0") == expected[1]
    scene, _ = read(
        folder,
        "0.3.0",
        '<camera type="perspective"/><luminaire type="envmap"><string name="filename" value="a.png"/><float name="intensityScale" value="2"/></luminaire>',
    )
    other, _ = read(
        folder,
        "0.3.0",
        '<camera type="perspective"/><luminaire type="envmap"><string name="filename" value="a.png"/></luminaire>',
    )
    np.testing.assert_array_equal(scene.sky_texels, 2 * other.sky_texels)
    for version in ("0.2.9", "0.1", "0"):
        with pytest.raises(SceneError, match=":1: version = .*expected 0.3.0 or later"):
            read(folder, version, new)


def test_an_axis_of_any_length(folder: Path) -> None:
    """Version 0.x takes its direction alone."""
    turn = '<transform name="{}"><rotate angle="50" x="{}" y="{}"/></transform>'
    found, told = read(folder, "0.6.0", BALL.format(turn.format("toWorld", 3, 4)))
    expected, _ = read(folder, "3.0.0", BALL.format(turn.format("to_world", 3 / 5, 4 / 5)))
    assert found.sha256 == expected.sha256 and not told


def test_the_ground_of_a_sky(folder: Path) -> None:
    """Its albedo is 0.2 where none is given."""
    for plugin in ("sky", "sunsky"):
        body = (
            SENSOR + f'<emitter type="{plugin}"><vector name="sunDirection" y="1"/>{{}}</emitter>'
        )
        found, said, other = (
            read(folder, "0.6.0", body.format(text))[0].sha256
            for text in ("", *(f'<spectrum name="albedo" value="{x}"/>' for x in (0.2, 0.3)))
        )
        assert found == said != other


def test_a_sky_and_a_sun_that_are_unlike(folder: Path) -> None:
    """Both lines are named, and in what they differ."""
    at = '<vector name="sunDirection" x="1" y="2" z="3"/>'
    turned = '<transform name="toWorld"><rotate y="1" angle="90"/></transform>'
    for sky, sun, unlike in (
        (at, at.replace('"1"', '"1.0"'), ""),
        (at, at + '<float name="turbidity" value="3"/>', ""),
        (at, at + '<float name="turbidity" value="5"/>', "turbidity"),
        (at, "", "sunDirection"),
        (at, at + turned, "toWorld"),
    ):
        body = f'{SENSOR}<emitter type="sky">{sky}</emitter>\n<emitter type="sun">{sun}</emitter>'
        told = read(folder, "0.6.0", body)[1]
        assert ("unlike" in told) == bool(unlike)
        assert "another model of the sun; this one is brighter" in told
        if unlike:
            assert "0.6.0.xml:3: emitters sun and sky (" in told and "0.6.0.xml:2)" in told
            assert f'are one sunsky, but unlike in "{unlike}": ' in told


def test_a_dipole_of_a_phase_and_an_index(folder: Path) -> None:
    """(a / 2) (1 + e^(-4 A s / 3)) e^(-s) of the reduced albedo and the index named."""

    def expected(scattering: float, absorption: float, eta: float) -> float:
        inside = -1.44 / eta**2 + 0.71 / eta + 0.668 + 0.0636 * eta if eta != 1 else 0.0
        a = scattering / (scattering + absorption)
        s = math.sqrt(3 * (1 - a))
        ratio = (1 + inside) / (1 - inside)
        return a / 2 * (1 + math.exp(-4 / 3 * ratio * s)) * math.exp(-s)

    own = '<rgb name="sigmaS" value="10"/><rgb name="sigmaA" value="1"/>'
    bk7 = '<string name="intIOR" value="bk7"/>'
    for content, value in (
        (own, expected(10, 1, 1.3)),
        (own + '<float name="g" value="0.9"/>', expected(1, 1, 1.3)),
        (own + bk7, expected(10, 1, 1.5046 / 1.000277)),
        (own + bk7 + '<string name="extIOR" value="bk7"/>', expected(10, 1, 1)),
        (
            own + '<float name="intIOR" value="1.5"/><float name="extIOR" value="1.2"/>',
            expected(10, 1, 1.25),
        ),
        ('<string name="material" value="marble"/>', expected(2.19, 0.0021, 1.5)),
        ('<string name="material" value="apple"/>', expected(2.29, 0.003, 1.3)),
    ):
        body = BALL.format(f'<subsurface type="dipole">{content}</subsurface>')
        scene, _ = read(folder, "0.6.0", body)
        assert math.isclose(scene.reflectance[0][0], value, rel_tol=1e-6)
    with pytest.raises(SceneError, match="xml:2: .*subsurface"):
        read(
            folder,
            "0.6.0",
            BALL.format(f'<subsurface type="dipole">{own}<float name="g" value="1"/></subsurface>'),
        )


@pytest.mark.parametrize(
    ("held", "defined", "warning"),
    [
        ('<ref id="t" name="diffuseReflectance"/>', '<texture type="checkerboard" id="t"><rgb name="color0" value="0.3"/><srgb name="color1" value="0.03876"/></texture>', ""),
        ('<texture type="checkerboard" name="diffuseReflectance"><rgb name="color0" value="0.3"/><rgb name="color1" value="0.003"/></texture>', "", ""),
        ('<texture type="checkerboard" name="diffuseReflectance"><rgb name="color0" value="0.3"/><rgb name="color1" value="$x"/></texture>', '<default name="x" value="0.003"/>', "its base 0.75 times as bright"),
    ],
)  # fmt: skip
def test_the_base_of_a_phong_of_checks(folder: Path, held: str, defined: str, warning: str) -> None:
    """What a number becomes: by 1 / (1 - 0.25)."""
    mirrors = '<rgb name="specularReflectance" value="0.25"/>'
    body = defined + BALL.format(f'<bsdf type="phong">{held}{mirrors}</bsdf>')
    scene, told = read(folder, "0.6.0", body)
    factor = 1.0 if warning else 1 / 0.75
    np.testing.assert_allclose(scene.texture_color0[0], 0.3 * factor, rtol=1e-6)
    np.testing.assert_allclose(scene.texture_color1[0], 0.003 * factor, rtol=1e-6)
    assert warning in told


def test_numbers_of_checks_in_order(folder: Path) -> None:
    """By their names, as opacity alone, and as reflectance too."""
    checks = '<texture type="checkerboard" id="tx"><float name="color0" value="{}"/><float name="color1" value="0.3"/></texture>'
    for held in ("", '<ref id="tx" name="reflectance"/>'):
        body = checks + BALL.format(
            f'<bsdf type="mask"><ref id="tx" name="opacity"/><bsdf type="diffuse">{held}</bsdf></bsdf>'
        )
        scene, other = (read(folder, "0.6.0", body.format(v))[0] for v in (0.9, 0.7))
        assert math.isclose(np.max(scene.parameters()["tx.color0"]), 0.9, rel_tol=1e-6)
        assert scene.with_({"tx.color0": 0.7}).sha256 == other.sha256 != scene.sha256


@pytest.mark.parametrize("kind", ["checkerboard", "bitmap", "scale"])
@pytest.mark.parametrize("order", [1, -1])
def test_others_refer_to_the_texture_of_a_phong(folder: Path, kind: str, order: int) -> None:
    """It is brighter in the phong alone."""
    content = {
        "checkerboard": '<rgb name="color0" value="0.3"/>',
        "bitmap": FILE.format("a.png"),
        "scale": '<float name="scale" value="0.5"/><texture type="bitmap" id="u">'
        + FILE.format("a.png")
        + "</texture>",
    }[kind]
    texture = f'<texture type="{kind}" id="t" name="diffuseReflectance">{content}</texture>'
    ref = '<ref id="t" name="diffuseReflectance"/>'
    shape = '<shape type="sphere"><bsdf type="{}">{}</bsdf></shape>'
    dark = '<rgb name="specularReflectance" value="0.25"/>'
    for phongs, others in (((texture,), (ref,)), ((ref,), (texture,)), ((texture, ref), (ref,))):
        parts = [shape.format("phong", one + dark) for one in phongs]
        parts += [shape.format("diffuse", one) for one in others]
        scene, told = read(folder, "0.6.0", SENSOR + LIGHT + "\n".join(parts[::order]))
        apart = [
            one.replace(ref, texture).replace(' id="t"', "").replace(' id="u"', "") for one in parts
        ]
        expected, also = read(folder, "0.6.1", SENSOR + LIGHT + "\n".join(apart[::order]))
        columns = ("texture_color0", "texture_field0", "texture_kind", "texture_width")
        for column in columns:
            found, wanted = getattr(scene, column), getattr(expected, column)
            assert {*map(str, found)} == {*map(str, wanted)}
        assert "scale" not in told and "texture" not in told.replace("texture scale", "")
        assert told.count("phong") == len(phongs) == also.count("phong")


def test_scale_of_checks_of_a_parameter(folder: Path) -> None:
    """What is a number is scaled, and what is not is told."""
    body = '<default name="c" value="0.5"/>' + TEXTURE.format(
        "scale",
        '<float name="scale" value="0.5"/><texture type="checkerboard"><rgb name="color0" value="0.8"/><rgb name="color1" value="$c"/></texture>',
    )
    scene, told = read(folder, "0.6.0", body)
    np.testing.assert_allclose(scene.texture_color0[0], 0.4, rtol=1e-6)
    np.testing.assert_allclose(scene.texture_color1[0], 0.5, rtol=1e-6)
    assert "texture scale: color1 is no number of the file, and stays as it is" in told


def test_a_phong_of_bright_texels(folder: Path) -> None:
    """They are clipped, without a word of the file, unless that exceeds 1 itself."""
    Image.fromarray(np.full((2, 2, 3), 250, np.uint8)).save(folder / "a.png")
    mirrors = '<rgb name="specularReflectance" value="0.25"/>'
    for content in (
        '<texture type="bitmap" name="diffuseReflectance">' + FILE.format("a.png") + "</texture>",
        '<texture type="checkerboard" name="diffuseReflectance"><rgb name="color0" value="0.9"/></texture>',
    ):
        bsdf = f'<bsdf type="phong">{content}{mirrors}</bsdf>'
        told = read(folder, "0.6.0", BALL.format(bsdf))[1]
        assert "phong is rendered" in told and "scale" not in told and "holds" not in told
    scaled = '<texture type="scale" name="diffuseReflectance"><float name="scale" value="2"/><texture type="bitmap">'
    body = BALL.format(
        f'<bsdf type="phong">{scaled}{FILE.format("a.png")}</texture></texture>{mirrors}</bsdf>'
    )
    assert "holds 12 numbers above 1" in read(folder, "0.6.0", body)[1]
    checks = scaled.replace("bitmap", "checkerboard") + '<rgb name="color1" value="0.75"/>'
    body = BALL.format(f'<bsdf type="phong">{checks}</texture></texture>{mirrors}</bsdf>')
    assert "texture checkerboard: color1 above 1 is 1" in read(folder, "0.6.0", body)[1]


@pytest.mark.parametrize(("scale", "clips"), [(1.25, False), (1.5, True)])
def test_colours_of_vertices_above_1(folder: Path, scale: float, clips: bool) -> None:
    """Only where a colour is clipped it is told; in a phong it is not."""
    head = "ply\nformat ascii 1.0\nelement vertex 3\n"
    head += "".join(f"property float {a}\n" for a in ("x", "y", "z", "red", "green", "blue"))
    head += "element face 1\nproperty list uchar int vertex_indices\nend_header\n"
    rows = "0 0 0 .7 0 0\n1 0 0 0 .7 0\n0 1 0 0 0 .7\n3 0 1 2\n"
    (folder / "a.ply").write_text(head + rows)
    shape = '<shape type="ply">' + FILE.format("a.ply") + '<boolean name="srgb" value="false"/>{}'
    texture = f'<texture type="scale" name="reflectance"><float name="scale" value="{scale}"/><texture type="vertexcolors"/></texture>'
    body = shape.format(f'<bsdf type="diffuse">{texture}</bsdf></shape>')
    scene, told = read(folder, "0.6.0", SENSOR + LIGHT + body)
    assert math.isclose(scene.attribute_values[0, 0], min(0.7 * scale, 1.0), rel_tol=1e-6)
    assert ("texture scale" in told) == clips == bool(told)
    phong = f'<bsdf type="phong"><texture type="vertexcolors" name="diffuseReflectance"/><rgb name="specularReflectance" value="{1 - 1 / scale}"/></bsdf></shape>'
    scene, told = read(folder, "0.6.0", SENSOR + LIGHT + shape.format(phong))
    assert math.isclose(scene.attribute_values[0, 0], min(0.7 * scale, 1.0), rel_tol=1e-6)
    assert "phong" in told and "texture" not in told


def test_what_is_beyond_a_grid(folder: Path) -> None:
    """A shape that ends at its box hides it; of a mesh of a file it is a note. An axis of one cell
    has nothing beyond."""
    for cells, low in ((np.ones((2, 2, 2)), -1), (np.ones((1, 2, 2)), -5)):
        head = b"VOL\3" + np.array([1, *cells.shape[::-1], 1], "<i4").tobytes()
        box = np.array([-1, -1, low, 1, 1, 1], "<f4").tobytes()
        (folder / "b.vol").write_bytes(head + box + cells.astype("<f4").tobytes())
        fog = f'<medium type="heterogeneous" name="interior"><volume name="density" type="gridvolume">{FILE.format("b.vol")}</volume></medium>'
        for shape, side, warned in (
            ("cube", 1, False),
            ("sphere", 1, False),
            ("cube", 1.2, True),
            ("sphere", 1.2, True),
        ):
            moved = f'<transform name="toWorld"><scale value="{side}"/></transform>'
            body = f'{SENSOR}{LIGHT}<shape type="{shape}">{moved}{fog}</shape>'
            scene, told = read(folder, "0.6.0", body)
            assert (BEYOND in told) == warned
            if warned:
                assert "gridvolume: the medium half a cell beyond its box" in told
    (folder / "m.obj").write_text(
        "v 0 0 0\nv 1 0 0\nv 0 1 0\nv 0 0 1\nf 1 3 2\nf 1 2 4\nf 1 4 3\nf 2 3 4\n"
    )
    body = f'{SENSOR}{LIGHT}<shape type="obj">{FILE.format("m.obj")}{fog}</shape>'
    scene, told = read(folder, "0.6.0", body)
    assert not told and any(BEYOND in note for note in scene.notes)
    cells = np.zeros((1, 3, 3))
    cells[0, 1, 1] = 1
    assert not grid(folder, cells)[1]


def test_materials_of_an_obj_are_told(folder: Path) -> None:
    """Where its shape has no bsdf, and the file is there."""
    (folder / "m.obj").write_text("mtllib m.mtl\nv 0 0 0\nv 1 0 0\nv 0 1 0\nusemtl a\nf 1 2 3\n")
    body = SENSOR + LIGHT + '<shape type="obj">' + FILE.format("m.obj") + "{}</shape>"
    assert not read(folder, "0.6.0", body.format(""))[1]
    (folder / "m.mtl").write_text("newmtl a\nKd 1 0 0\n")
    told = read(folder, "0.6.0", body.format(""))[1]
    assert '0.6.0.xml:2: obj: version 0.x took the materials of "m.mtl"' in told
    assert "m.mtl" in read(folder, "0.6.0", body.format('<emitter type="area"/>'))[1]
    assert not read(folder, "0.6.0", body.format('<bsdf type="plastic"/>'))[1]
    assert not read(folder, "3.0.0", body.format(""))[1]
    assert not read(folder, "0.6.0", body.format('<boolean name="loadMaterials" value="false"/>'))[
        1
    ]
    load = '<boolean name="loadMaterials" value="true"/>'
    assert "m.mtl" in read(folder, "0.6.0", body.format(load))[1]


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
