"""Cameras at a surface: `irradiancemeter`, and `distant` with a shape as its target."""

import math
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import veriray as vr
from veriray import Camera, SceneError

Dict = dict[str, Any]


def loaded(folder: Path, *lines: str) -> vr.Scene:
    path = folder / "scene.xml"
    path.write_text('<scene version="3.0.0">\n' + "\n".join(lines) + "\n</scene>\n", "utf-8")
    return vr.load_file(path)


SKY = {"type": "constant", "radiance": {"type": "rgb", "value": [1.0, 0.5, 0.25]}}
BLACK = {"type": "diffuse", "reflectance": 0.0}
TURN = vr.transform.compose(
    vr.transform.translate([3.0, -0.2, 0.4]),
    vr.transform.compose(vr.transform.rotate([0, 1, 0], 40), vr.transform.scale([0.6, 0.6, 0.6])),
)
PLY = """ply
format ascii 1.0
element vertex 4
property float x
property float y
property float z
element face 4
property list uchar int vertex_indices
end_header
1 1 1
-1 -1 1
-1 1 -1
1 -1 -1
3 0 2 1
3 0 1 3
3 0 3 2
3 1 2 3
"""


def film(width: int = 1, height: int = 1) -> Dict:
    return {"type": "hdrfilm", "width": width, "height": height, "rfilter": {"type": "box"}}


def meter(width: int = 1, height: int = 1, **more: Any) -> Dict:
    return {"type": "irradiancemeter", "film": film(width, height), **more}


def scene(sky: Dict | None = SKY, **parts: Any) -> vr.Scene:
    return vr.load_dict({"type": "scene", **({"sky": sky} if sky else {}), **parts})


@pytest.mark.parametrize("flat", [True, False], ids=["flat", "tree"])
@pytest.mark.parametrize("plugin", ["rectangle", "disk", "sphere", "cube", "cylinder", "ply"])
def test_an_even_sky_gives_pi(plugin: str, flat: bool, tmp_path: Path, device: str) -> None:
    """On each point of a convex body, whatever pixel it is in: no ray meets what it left."""
    (tmp_path / "m.ply").write_text(PLY)
    shape: Dict = {"type": plugin, "to_world": TURN, "bsdf": BLACK, "m": meter(3, 2)}
    if plugin == "ply":
        shape |= {"filename": str(tmp_path / "m.ply"), "face_normals": True}
    far = {"type": "sphere", "center": [3, 900, 0], "radius": 1e-3, "bsdf": BLACK}
    if not flat:  # a mesh of many triangles far away
        far = {"type": "cylinder", "p0": [3, 900, 0], "p1": [3, 901, 0], "radius": 1e-3, "b": BLACK}
    image = vr.render(scene(shape=shape, far=far), 4096, device=device).image
    np.testing.assert_allclose(image / [math.pi, math.pi / 2, math.pi / 4], 1, rtol=3e-5)


def test_direct_light_of_points_is_left_out() -> None:
    """No ray meets them: a note says so, and there is none for a sky or a lamp."""
    shape = {"type": "rectangle", "bsdf": BLACK, "m": meter()}
    sun = {"type": "directional", "direction": [0, 0, -1]}
    assert any("without the direct light" in str(n) for n in scene(shape=shape, sun=sun).notes)
    assert not any("without the direct light" in str(n) for n in scene(shape=shape).notes)


def test_what_lies_on_the_sensor_counts(device: str) -> None:
    """A mask at any distance halves the light of an even sky, turned or not."""
    mask = {"type": "mask", "opacity": 0.5, "b": {"type": "twosided", "b": BLACK}}
    for turn in (np.eye(4), TURN):
        for gap in (0.0, 1e-8, 1e-7, 1e-6, 1e-5):
            above = vr.transform.translate([0.0, 0.0, gap]) @ vr.transform.scale([1.5, 1.5, 1])
            shape = {"type": "rectangle", "to_world": turn, "bsdf": BLACK, "m": meter()}
            cover = {"type": "rectangle", "to_world": turn @ above, "bsdf": mask}
            image = vr.render(scene(shape=shape, cover=cover), 4096, device=device).image
            assert image[0, 0, 0] == pytest.approx(math.pi / 2, rel=0.03), gap


def test_the_other_side_is_dark(device: str) -> None:
    floor = {"type": "rectangle", "to_world": vr.transform.scale([1e3, 1e3, 1]), "bsdf": BLACK}
    above = vr.transform.translate([0.0, 0.0, 1e-3])
    for flip, share in ((False, 1.0), (True, 0.0)):
        shape = {"type": "rectangle", "to_world": above, "flip_normals": flip, "m": meter()}
        image = vr.render(scene(floor=floor, shape=shape), 1024, device=device).image
        assert image[0, 0, 0] == pytest.approx(share * math.pi, abs=0.01)
    ball = {"type": "sphere", "flip_normals": True, "bsdf": BLACK, "m": meter()}
    assert not vr.render(scene(ball=ball), 1024, device=device).image.any()


def test_a_lamp_across(device: str) -> None:
    """A square sees an equal one at the distance of its side by the form factor 0.1998249.

    J. Howell, "A Catalog of Radiation Heat Transfer Configuration Factors", C-11. At 5 standard
    errors, 1.4 %: false alarms 6e-7. Of two columns at a wall that shines the near one has more.
    """
    up = vr.transform.translate([0, 0, 2])
    lamp = {"type": "rectangle", "to_world": up, "flip_normals": True,
            "emitter": {"type": "area", "radiance": 3.0}}  # fmt: skip
    shape = {"type": "rectangle", "bsdf": BLACK, "m": meter()}
    r = vr.render(scene(None, lamp=lamp, shape=shape), 1 << 19, device=device)
    error = float(r.stderr[0, 0, 0])
    assert abs(r.image[0, 0, 0] - 3 * math.pi * 0.1998249) < 5 * error < 0.03
    wall = vr.transform.compose(
        vr.transform.translate([1.0, 0.0, 1.0]), vr.transform.rotate([0, 1, 0], -90)
    )
    lamp = {**lamp, "to_world": wall, "flip_normals": False}
    shape = {**shape, "m": meter(2, 1)}
    left, right = vr.render(scene(None, lamp=lamp, shape=shape), 1 << 14, device=device).image[0]
    assert right[0] > 2 * left[0] > 0
    whole = vr.render(scene(None, lamp=lamp, shape={**shape, "m": meter()}), 1 << 15, device=device)
    assert (left[0] + right[0]) / 2 == pytest.approx(whole.image[0, 0, 0], rel=0.03)


def test_triangles_are_chosen_by_their_area(tmp_path: Path, device: str) -> None:
    """Half of the sphere of directions shines; triangles of all sizes look to either side of it.

    The mean irradiance is the sum of pi A (1 + n_z) / 2 over that of A: 5 standard errors.
    """
    rng = np.random.default_rng(3)
    corners = rng.normal(size=(200, 3, 3)) * rng.lognormal(sigma=2, size=(200, 1, 1))
    text = [f"v {x} {y} {z}" for x, y, z in corners.reshape(-1, 3)]
    text += [f"f {k} {k + 1} {k + 2}" for k in range(1, 600, 3)]
    (tmp_path / "m.obj").write_text("\n".join(text))
    upper = np.zeros((64, 4, 3), np.float32)
    upper[:32] = 1.0
    sky = {"type": "envmap", "bitmap": upper, "to_world": vr.transform.rotate([1, 0, 0], 90)}
    mesh = {"type": "obj", "filename": str(tmp_path / "m.obj"), "face_normals": True,
            "bsdf": {"type": "null"}, "m": meter()}  # fmt: skip
    r = vr.render(scene(sky, mesh=mesh), 1 << 16, device=device)
    n = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    area = np.sqrt((n * n).sum(axis=1))
    exact = math.pi * (area + n[:, 2]).sum() / (2 * area.sum())
    error = float(r.stderr[0, 0, 0])
    assert abs(r.image[0, 0, 0] - exact) < 5 * error + 0.01  # the sky's seam is a texel wide
    assert error < 0.01


@pytest.mark.parametrize("scale", [1.0, 2.0**-20])
def test_a_distant_sensor_with_a_shape(scale: float, device: str) -> None:
    """Rays even over the target, which is not in the scene, meet what is in their way: a lamp under
    a third of a square, and a black wall in front of a quarter of that."""
    at = vr.transform.translate
    size = vr.transform.scale
    below = vr.transform.compose(at([1.0, 0.0, -1.0]), size([2 / 3, 9, 1]))
    lamp = {"type": "rectangle", "to_world": below, "emitter": {"type": "area", "radiance": 6.0}}
    above = vr.transform.compose(at([0.0, 1.0, 3.0]), size([9, 0.5, 1]))
    wall = {"type": "rectangle", "to_world": above, "bsdf": BLACK}
    sensor = {"type": "distant", "direction": [0, 0, -2.0], "film": film(),
              "target": {"type": "rectangle"}}  # fmt: skip
    made = scene(None, lamp=lamp, wall=wall, c=sensor).scaled(scale)
    r = vr.render(made, 1 << 16, device=device)
    assert abs(r.image[0, 0, 0] - 6 * (1 / 3) * 0.75) < 5 * float(r.stderr[0, 0, 0]) < 0.06
    ball = {"type": "distant", "film": film(), "target": {"type": "sphere", "radius": 0.5}}
    inside = {"type": "rectangle", "to_world": at([0, 0, 0.49]), "flip_normals": True,
              "emitter": {"type": "area", "radiance": 2.0}}  # fmt: skip
    assert vr.render(scene(None, r=inside, c=ball), 256, device=device).image[0, 0, 0] == 2.0


def test_scale_and_place_change_no_bits(device: str) -> None:
    shape = {"type": "cube", "bsdf": {"type": "diffuse"}, "m": meter(2, 2)}
    floor = {"type": "rectangle", "to_world": vr.transform.translate([0, 0, -1.5])}
    made = scene(shape=shape, floor=floor)
    wanted = vr.render(made, 64, device=device).image
    for factor in (2.0**-30, 2.0**17):
        assert (vr.render(made.scaled(factor), 64, device=device).image == wanted).all()
    other = scene(shape={**shape, "to_world": vr.transform.scale([1.0, 1.0, 2.0])}, floor=floor)
    moved = vr.render(made.with_(camera=other.camera), 64, device=device).image
    assert (moved != wanted).any() and made.sha256 != other.sha256
    assert made.sha256 != made.with_(camera=Camera(np.eye(4), 40.0)).sha256


def test_the_meter_is_in_the_medium_around_its_shape() -> None:
    fog = {"type": "homogeneous", "sigma_t": 0.25, "albedo": 0.0}
    shape = {"type": "sphere", "bsdf": BLACK, "exterior": fog, "m": meter()}
    assert scene(shape=shape).camera.medium == 0
    own = {**shape, "exterior": {**fog, "sigma_t": 0.5}, "m": meter(medium=fog)}
    made = scene(shape=own)
    assert made.sigma_t[made.camera.medium].tolist() == [0.25] * 3


FILM = (
    '<film type="hdrfilm"><integer name="width" value="1"/><integer name="height" value="1"/>'
    '<rfilter type="box"/>{}</film>'
)
METER = f'<sensor type="irradiancemeter">{FILM.format("")}{{}}</sensor>'


def test_sensors_are_counted_in_their_order(tmp_path: Path) -> None:
    first = f'<shape type="sphere">{METER.format("")}</shape>'
    other = '<sensor type="perspective"><float name="fov" value="40"/></sensor>'
    sky = '<emitter type="constant"/>'
    made = loaded(tmp_path, first, other, first.replace("sphere", "disk"), sky)
    kinds = [camera.projection for camera in made.cameras]
    assert kinds == ["irradiance", "perspective", "irradiance"]
    assert made.cameras[2].patches[0, 0] == 2 and "the first of 3 sensors" in made.notes[0]
    gauss = first.replace('<rfilter type="box"/>', "")
    with pytest.warns(vr.SceneWarning, match="film has the filter box, not gaussian"):
        loaded(tmp_path, gauss, sky)


@pytest.mark.parametrize(("text", "message"), [
    ('<shape type="sphere">\n' + METER.format('<transform name="to_world"/>') + "</shape>",
     r'xml:3: irradiancemeter: "to_world": it is where its shape is'),
    ("\n" + METER.format(""), "cannot hold a sensor|is in no shape"),
    ('<shape type="shapegroup" id="g"><shape type="sphere">\n' + METER.format("")
     + '</shape></shape><shape type="instance"><ref id="g"/></shape>', "in one of a group"),
    ('<shape type="sphere">' + METER.format("").replace('"width" value="1"', '"width" value="2"')
     .replace("<rfilter", '<integer name="crop_width" value="1"/><rfilter') + "</shape>",
     "a crop window is not supported here"),
    (f'<sensor type="distant">{FILM.format("")}\n<shape type="sphere"/></sensor>',
     r'xml:3: distant: a shape .*expected one "target"'),
    (f'<sensor type="distant">{FILM.format("")}<point name="target" value="0, 0, 0"/>\n'
     '<shape type="sphere" name="target"/></sensor>', 'expected one "target"'),
])  # fmt: skip
def test_what_is_refused(text: str, message: str, tmp_path: Path) -> None:
    with pytest.raises(SceneError, match=message):
        loaded(tmp_path, text, '<emitter type="constant"/>')


def test_patches_are_checked() -> None:
    row = [3.0, 1, 0, 0, 0, 1, 0, 0, 0, 0, 0]
    assert Camera(np.eye(4), 90.0, projection="irradiance", patches=[row]).around[1] == 3**0.5
    for patches, projection, message in (
        ([row], "perspective", "1 patches of a camera of projection perspective"),
        ([], "irradiance", "0 patches"), ([row[:4]], "distant", "has shape"),
        ([[4.0, *row[1:]]], "distant", "indices of triangle"),
        ([[3.0, 0.0, *row[2:]]], "distant", "1 or -1"),
        ([[*row[:2], math.nan, *row[3:]]], "distant", "patches"),
    ):  # fmt: skip
        with pytest.raises(SceneError, match=message):
            Camera(np.eye(4), 90.0, projection=projection, patches=np.array(patches))


def test_feature_images_are_refused() -> None:
    made = scene(shape={"type": "sphere", "m": meter()})
    with pytest.raises(ValueError, match="feature images"):
        vr.render(made, 1, features=("depth",))


def test_lint_takes_the_rays_of_a_meter() -> None:
    """What they meet is judged, not what the middle of the shape sees."""
    ball = {"type": "sphere", "m": meter()}
    assert not vr.lint(scene(ball=ball))
    around = {"type": "sphere", "radius": 9.0, "emitter": {"type": "area", "radiance": 1.0}}
    found = vr.lint(scene(None, ball=ball, around=around))
    assert [one.rule for one in found] == ["dark-light"]
    back = {"type": "rectangle", "to_world": vr.transform.translate([0.0, 0.0, 2.0])}
    flat = {"type": "rectangle", "m": meter()}
    assert "black-back" not in [one.rule for one in vr.lint(scene(flat=flat))]
    assert "black-back" in [one.rule for one in vr.lint(scene(flat=flat, back=back))]
