"""Textures in the fields of checkerboards, of metals' refractive indices, and of meshes' lamps.

Under an even sky of radiance 1 a convex diffuse surface sends out its reflectance, without noise:
so a picture of one narrow pixel is a lookup.
"""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest
from PIL import Image as Pillow

import veriray
from tests.python.test_attributes import FACES, POINTS, attribute, columns, text
from tests.python.test_textures import COLOURS, TO_UV, bitmap, diffuse, scene, seen
from veriray import transform as tf
from veriray.errors import SceneError, SceneWarning
from veriray_validate.scenes import camera

RNG = np.random.default_rng(20161100)
GREY = RNG.random((4, 5, 1)).astype(np.float32)
DOWN = [((x, y, 3.0), (x, y, 0.0)) for x, y in RNG.uniform(-0.9, 0.9, (12, 2)).tolist()]
SQUARE: dict[str, Any] = {"type": "rectangle"}


def board(first: Any = None, second: Any = None, **more: Any) -> dict[str, Any]:
    given = {"color0": first, "color1": second}
    return {"type": "checkerboard", **{k: v for k, v in given.items() if v is not None}, **more}


def rgb(*value: float) -> dict[str, Any]:
    return {"type": "rgb", "value": list(value)}


NESTED: dict[str, Any] = {
    "an image first": board(bitmap(COLOURS, raw=True, to_uv=TO_UV), rgb(0.1, 0.5, 0.9)),
    "an image second": board(None, bitmap(COLOURS, raw=True)),
    "two images": board(
        bitmap(COLOURS, raw=True, filter_type="nearest"), bitmap(GREY, raw=True), to_uv=TO_UV
    ),
    "boards": board(
        board(None, bitmap(GREY, raw=True), to_uv=TO_UV),
        board(0.8, None),
        to_uv=np.diag([3, 2, 1, 1]),
    ),
    "a volume": board(
        {"type": "volume", "volume": {"type": "constvolume", "value": rgb(0.2, 0.6, 0.9)}}
    ),
    "four deep": board(board(board(board(0.9, 0.1), 0.3, to_uv=TO_UV), 0.6), bitmap(COLOURS)),
}  # fmt: skip


def theirs(given: Any) -> Any:
    """A dictionary with what Mitsuba has for images and matrices."""
    mitsuba = pytest.importorskip("mitsuba", reason="the peer renderer: pip install mitsuba")
    if isinstance(given, dict):
        exact = {"format": "variant", "accel": False} if given.get("type") == "bitmap" else {}
        return {**{key: theirs(value) for key, value in given.items()}, **exact}
    if not isinstance(given, np.ndarray):
        return given
    return mitsuba.ScalarTransform4f(given) if given.shape == (4, 4) else mitsuba.Bitmap(given)


def hits(shape: dict[str, Any], views: Any) -> tuple[Any, list[Any]]:
    """Mitsuba's intersections of rays along views, and the scene, which must live as long."""
    mitsuba = pytest.importorskip("mitsuba", reason="the peer renderer: pip install mitsuba")
    mitsuba.set_variant("scalar_rgb")
    found = []
    of = mitsuba.load_dict({"type": "scene", "shape": theirs(shape)})
    for origin, target in views:
        towards = np.subtract(target, origin)
        ray = mitsuba.Ray3f(list(origin), (towards / np.linalg.norm(towards)).tolist())
        found.append(of.ray_intersect(ray))
        assert found[-1].is_valid()
    return of, found


@pytest.mark.parametrize("name", NESTED)
def test_lookups_are_mitsubas(name: str, device: str) -> None:
    """To 2e-5, as those of textures alone: colours, and numbers of an opacity."""
    mitsuba = pytest.importorskip("mitsuba", reason="the peer renderer: pip install mitsuba")
    alive, at = hits(SQUARE, DOWN)
    looked_up = mitsuba.load_dict(theirs(NESTED[name]))
    mask = {"type": "mask", "opacity": NESTED[name], "bsdf": diffuse(0.0)}
    for view, hit in zip(DOWN, at, strict=True):
        found = seen(SQUARE, diffuse(NESTED[name]), view, device)
        np.testing.assert_allclose(found, np.array(looked_up.eval(hit)), rtol=0, atol=2e-5)
    for view, hit in zip(DOWN[:4], at[:4], strict=True):
        # of the sky behind, the share that is not covered, at 6 standard errors at most
        found = seen(SQUARE, mask, view, device, spp=1 << 13)
        expected = 1 - looked_up.eval_1(hit)
        np.testing.assert_allclose(found, expected, rtol=0, atol=6 * 0.5 / 2**6.5)


def test_attributes_in_a_board_are_mitsubas(tmp_path: Path, device: str) -> None:
    mitsuba = pytest.importorskip("mitsuba", reason="the peer renderer: pip install mitsuba")
    path = tmp_path / "a.ply"
    path.write_bytes(text(columns("r g b foo_0 u v", 5), columns("r g b", 4)))
    shape = {"type": "ply", "filename": str(path)}
    turned = board(attribute("vertex_color"), attribute("face_color", scale=0.5), to_uv=TO_UV)
    alive, at = hits(shape, DOWN)
    for texture in (turned, board(board(attribute("vertex_foo"), turned), 0.25)):
        looked_up = mitsuba.load_dict(theirs(texture))
        for view, hit in zip(DOWN, at, strict=True):
            found = seen(shape, diffuse(texture), view, device)
            np.testing.assert_allclose(found, np.array(looked_up.eval(hit)), rtol=0, atol=2e-5)


FILE = """<scene version="3.0.0">
    <sensor type="perspective"><float name="fov" value="40"/></sensor>
    <emitter type="constant"/>
    <texture type="bitmap" id="wood"><string name="filename" value="a.png"/></texture>
    <shape type="sphere"><bsdf type="blendbsdf"><texture type="checkerboard" name="weight">
        <ref id="wood" name="color0"/><float name="color1" value="0.75"/></texture>
        <bsdf type="diffuse"><texture type="checkerboard" name="reflectance">
            <ref id="wood" name="color0"/>
            <texture type="checkerboard" name="color1"><ref id="wood" name="color1"/></texture>
        </texture></bsdf>
        <bsdf type="conductor"><ref id="wood" name="eta"/><float name="k" value="2.5"/></bsdf>
    </bsdf></shape></scene>"""


def test_a_file_says_what_a_dictionary_says(tmp_path: Path) -> None:
    Pillow.fromarray(RNG.integers(0, 256, (5, 4, 3), dtype=np.uint8)).save(tmp_path / "a.png")
    path = tmp_path / "x.xml"
    path.write_text(FILE)
    image = {"type": "bitmap", "filename": str(tmp_path / "a.png")}
    wood = {"type": "ref", "id": "wood"}
    found = veriray.load_file(path)
    given = veriray.load_dict({
        "type": "scene", "c": {"type": "perspective", "fov": 40.0}, "e": {"type": "constant"},
        "wood": image, "s": {"type": "sphere", "bsdf": {
            "type": "blendbsdf", "weight": board(wood, 0.75),
            "first": diffuse(board(wood, board(None, wood))),
            "second": {"type": "conductor", "eta": wood, "k": 2.5}}},
    })  # fmt: skip
    assert found.sha256 == given.sha256
    assert found.texture_kind.tolist() == [0, 1, 1, 0, 0, 1]
    assert found.texture_first.tolist() == [0, 0, 0, 20, 0, 0] and len(found.texels) == 40
    # where one number counts, the fields are Mitsuba's: exchanged
    assert found.texture_field0.tolist() == [-1, -1, 0, -1, -1, -1]
    assert found.texture_field1.tolist() == [-1, 0, 1, -1, -1, 4]
    assert found.texture_color0[5].tolist() == [0.75] * 3
    assert found.eta_texture.tolist() == [-1, 3] and found.k[1].tolist() == [2.5] * 3


@pytest.mark.parametrize("kind", ["conductor", "roughconductor"])
def test_indices_by_texture(kind: str, device: str) -> None:
    """An even texture against numbers; one alone stands with the default of the other."""
    eta, k = [0.2, 0.92, 1.1], [3.9, 2.45, 2.14]
    images = (bitmap(np.full((2, 2, 3), x, np.float32)) for x in (eta, k))
    of_eta, of_k = images
    for given, plain in (
        ({"eta": of_eta, "k": of_k}, {"eta": rgb(*eta), "k": rgb(*k)}),
        ({"eta": of_eta}, {"eta": rgb(*eta), "k": 1.0}),
        ({"k": board(of_k, of_k)}, {"eta": 0.0, "k": rgb(*k)}),
        ({"eta": 0.5, "k": of_k}, {"eta": 0.5, "k": rgb(*k)}),
    ):
        one, other = (
            seen({"type": "sphere"}, {"type": kind, **numbers}, DOWN[0], device, 512)
            for numbers in (given, plain)
        )
        np.testing.assert_array_equal(one, other)


def test_indices_by_texture_are_mitsubas(device: str) -> None:
    """A mirror shows the even sky times its Fresnel reflectance, without noise: to 2e-5."""
    mitsuba = pytest.importorskip("mitsuba", reason="the peer renderer: pip install mitsuba")
    mitsuba.set_variant("scalar_rgb")
    metal = {
        "type": "conductor",
        "eta": board(bitmap(3 * COLOURS, raw=True), 0.75, to_uv=TO_UV),
        "k": bitmap(5 * COLOURS[::-1].copy(), raw=True),
    }
    for origin, target in DOWN:
        view = (origin[0] + 1.5, origin[1], origin[2] - 1), target
        found = seen(SQUARE, metal, view, device)
        given = scene(SQUARE, metal, view, i={"type": "path", "max_depth": 3})
        expected = np.array(mitsuba.render(mitsuba.load_dict(theirs(given)), spp=4))[0, 0]
        np.testing.assert_allclose(found, expected, rtol=0, atol=2e-5)


LAMP = {
    "type": "mesh",
    "vertices": POINTS + [0, 0, 1],
    "faces": FACES[:, ::-1],
    "face_normals": True,
}
FLOOR: dict[str, Any] = {"type": "rectangle", "to_world": tf.scale((3, 3, 1)), "bsdf": diffuse(0.8)}


def lit(*lamps: dict[str, Any]) -> dict[str, Any]:
    """A floor below lamps, and a camera at its side."""
    return {
        "type": "scene", "i": {"type": "path", "max_depth": 2}, "floor": FLOOR,
        "camera": {"type": "perspective", "fov": 40,
                   "to_world": tf.look_at([0, -4, 0.9], [0, 0, 0], [0, 0, 1]),
                   "film": {"type": "hdrfilm", "width": 4, "height": 4, "f": {"type": "box"}}},
        **{f"lamp{k}": lamp for k, lamp in enumerate(lamps)},
    }  # fmt: skip


@pytest.mark.parametrize("kind", ["face", "vertex", "board"])
@pytest.mark.parametrize("seed", [1, 2, 3])
def test_a_lamp_by_an_attribute_is_its_parts(kind: str, seed: int, device: str) -> None:
    """Faces of one colour each against a lamp for each face, vertices against bitmaps of the same
    affine colours; a board of both against the mean of its fields by the linearity of light.

    At 5 standard errors of both, of three channels of the mean: false alarms 2e-6 a case.
    """
    power = 7.0 * RNG.random((5, 3))
    colours = power[:4] if kind == "face" else power
    lamp = {**LAMP, f"{'face' if kind == 'face' else 'vertex'}_a": colours}
    name = "face_a" if kind == "face" else "vertex_a"
    radiance: Any = attribute(name)
    if kind == "face":
        parts = [
            {**LAMP, "faces": LAMP["faces"][[k]], "emitter": {"type": "area", "radiance": rgb(*c)}}
            for k, c in enumerate(colours)
        ]
    elif kind == "vertex":  # by linearity the sum of lamps that shine at one corner each
        corner = np.eye(5)
        parts = []
        for k in range(5):
            uv = np.column_stack([0.25 + corner[k] / 2, np.full(5, 0.5)])
            texels = np.stack([0 * power[k], power[k]])[None].astype(np.float32)
            texture = bitmap(texels, raw=True, wrap_mode="clamp")
            parts.append({**LAMP, "uv": uv, "emitter": {"type": "area", "radiance": texture}})
    else:
        lamp["uv"], lamp["face_a"] = 3 * RNG.random((5, 2)), 7.0 * RNG.random((4, 3))
        radiance = board(attribute("vertex_a"), attribute("face_a"))
        parts = [
            {**lamp, "emitter": {"type": "area", "radiance": half}}
            for half in (board(attribute("vertex_a"), 0.0), board(0.0, attribute("face_a")))
        ]

    def mean(given: dict[str, Any]) -> tuple[Any, Any]:
        found = veriray.render(veriray.load_dict(given), 1 << 13, device=device, seed=seed)
        error = np.sqrt((found.stderr.astype(np.float64) ** 2).sum(axis=(0, 1)))
        return found.image.sum(axis=(0, 1), dtype=np.float64), error

    found, error = mean(lit({**lamp, "emitter": {"type": "area", "radiance": radiance}}))
    # of lamps in one place only the first is seen and lights: one after another
    one = [mean(lit(*parts))] if kind == "face" else [mean(lit(part)) for part in parts]
    expected = sum(value for value, _ in one)
    error = np.sqrt(error**2 + sum(off**2 for _, off in one))
    assert (error < 0.015 * expected).all()
    assert (np.abs(found - expected) <= 5 * error).all(), (found, expected, error)


def test_a_lamp_by_an_attribute_is_seen_as_it_is(device: str) -> None:
    lamp = {**LAMP, "vertex_a": np.tile([2.0, 0.5, 8.0], (5, 1)), "face_b": np.full((4, 3), 3.0)}
    lamp["uv"] = np.array([[0.1, 0.1]] * 5)
    for radiance, expected in (
        (attribute("vertex_a"), [2, 0.5, 8]),
        (attribute("face_b", scale=0.5), [1.5] * 3),
        (board(0.25, attribute("vertex_a")), [0.25] * 3),
        (board(attribute("face_b"), 0.25), [3] * 3),
    ):
        view = (0.3, 0.2, -4.0), (0.3, 0.2, 0.0)
        given = {**lit({**lamp, "emitter": {"type": "area", "radiance": radiance}})}
        del given["floor"]
        given["camera"] = scene(SQUARE, diffuse(0.5), view)["camera"]
        found = veriray.render(veriray.load_dict(given), 4, device=device).image[0, 0]
        np.testing.assert_allclose(found, expected, rtol=1e-6)


def test_a_texture_in_itself_is_refused(tmp_path: Path) -> None:
    inside = board(0.5, 0.5)
    for _ in range(8):
        inside = board(inside, inside)
    veriray.load_dict(scene(SQUARE, diffuse(inside)))
    with pytest.raises(SceneError, match="checkerboard: it is a texture in more than 8 others"):
        veriray.load_dict(scene(SQUARE, diffuse(board(inside))))
    own = '<texture type="checkerboard" name="{}" id="own"><ref id="own" name="color0"/></texture>'
    light = '<shape type="sphere"><emitter type="area">{}</emitter></shape>'
    surface = '<shape type="sphere"><bsdf type="{}">{}<bsdf type="diffuse"/></bsdf></shape>'
    for shape in (
        light.format(own.format("radiance")),
        surface.format("mask", own.format("opacity")),
        surface.format("twosided", "").replace("</bsdf></", f"{own.format('reflectance')}</bsdf></")
        .replace('<bsdf type="diffuse"/>', "").replace("twosided", "diffuse"),
    ):  # fmt: skip
        path = tmp_path / "x.xml"
        path.write_text(f'<scene version="3.0.0">\n{shape}</scene>')
        with pytest.raises(SceneError, match=r"x.xml:2: checkerboard .* in more than 8 others"):
            veriray.load_file(path)


@pytest.mark.parametrize("name", ["an image", *NESTED])
def test_a_blend_first_in_a_blend_by_a_texture(name: str, device: str) -> None:
    """The shares of all three, by Mitsuba's numbers of the texture.

    At 6 standard errors of 2^13 hits that are one of 0, 0.25 and 1: false alarms 2e-9 each.
    """
    mitsuba = pytest.importorskip("mitsuba", reason="the peer renderer: pip install mitsuba")
    texture = NESTED.get(name, bitmap(RNG.integers(0, 256, (4, 5, 3), dtype=np.uint8)))
    alive, at = hits(SQUARE, DOWN[:4])
    looked_up = mitsuba.load_dict(theirs(texture))
    inner = {"type": "blendbsdf", "weight": 0.75, "a": diffuse(0.0), "b": diffuse(0.25)}
    bsdf = {"type": "blendbsdf", "weight": texture, "first": inner, "second": diffuse(1.0)}
    for view, hit in zip(DOWN[:4], at, strict=True):
        weight = float(looked_up.eval_1(hit))
        expected = (1 - weight) * 0.1875 + weight
        spread = ((1 - weight) * 0.75 * 0.0625 + weight - expected**2) ** 0.5
        found = seen(SQUARE, bsdf, view, device, spp=1 << 13)
        np.testing.assert_allclose(found, expected, rtol=0, atol=6 * spread / 2**6.5 + 1e-5)


def test_a_volume_is_its_colour(device: str) -> None:
    """On surfaces and lamps, of balls too; a grid is refused."""
    colour = rgb(0.25, 0.5, 0.75)
    volume = {"type": "volume", "v": {"type": "constvolume", "value": colour}}
    for shape in (SQUARE, {"type": "sphere"}):
        for bsdf, light in ((diffuse, None), (None, "area")):
            pictures = []
            for given in (volume, colour):
                made = {**shape, "emitter": {"type": light, "radiance": given}} if light else shape
                pictures.append(seen(made, bsdf(given) if bsdf else diffuse(0.5), DOWN[0], device))
            np.testing.assert_array_equal(*pictures)
    for inside, message in (
        ({"type": "gridvolume", "data": np.ones((2, 2, 2, 2), np.float32)},
         "2 numbers a cell; a texture takes 1 or 3"),
        ({"type": "constvolume", "value": 2.0}, r"volume: 2.0 is outside \[0, 1\]"),
    ):  # fmt: skip
        with pytest.raises(SceneError, match=message):
            veriray.load_dict(scene(SQUARE, diffuse({"type": "volume", "v": inside})))


@pytest.mark.parametrize("kind", ["bitmap", "checkerboard", "nested", "volume", "vertex", "face"])
def test_numbers_above_1_are_what_they_are(kind: str, device: str) -> None:
    """Of slopes, transmission of thin sheets, indices and lamps: a texture of one number is it."""
    for plugin, name, number, more in (
        ("roughconductor", "alpha", 3.0, {}),
        ("roughdielectric", "alpha", 5.0, {}),
        ("principledthin", "diff_trans", 1.75, {}),
        ("conductor", "eta", 3.0, {"k": 2.0}),
        ("roughconductor", "k", 8.0, {"eta": 0.5, "alpha": 0.3}),
        ("area", "radiance", 6.0, {}),
    ):
        texels = bitmap(np.full((2, 3, 1), number, np.float32), raw=True)
        texture = {
            "bitmap": texels,
            "checkerboard": board(number, number),
            "nested": board(number, board(texels, number)),
            "volume": {"type": "volume", "v": {"type": "constvolume", "value": number}},
            "vertex": attribute("vertex_a"),
            "face": attribute("face_a"),
        }[kind]
        pictures = []
        for given in (number, texture):
            shape: dict[str, Any] = {
                "type": "mesh", "vertices": POINTS, "faces": FACES, "face_normals": True,
                "vertex_a": np.full((len(POINTS), 1), number),
                "face_a": np.full((len(FACES), 1), number),
            }  # fmt: skip
            made = {"type": plugin, name: given, **more}
            if plugin == "area":
                shape["emitter"] = made
            bsdf = diffuse(0.5) if plugin == "area" else made
            pictures.append(seen(shape, bsdf, DOWN[0], device, 16))
        np.testing.assert_allclose(*pictures, rtol=1e-5, err_msg=f"{plugin}.{name}")


def test_numbers_beyond_what_a_material_takes() -> None:
    """Texels are the nearest that it takes, with a warning; other numbers are errors."""

    def made(texture: Any) -> veriray.Scene:
        bsdf = {"type": "roughconductor", "alpha": texture}
        return veriray.load_dict(scene(SQUARE, bsdf, DOWN[0]))

    texels = np.array([[[0.5], [12.0]]], np.float32)
    with pytest.warns(SceneWarning, match="holds 1 numbers above 10, up to 12. The nearest of 0"):
        found = made(bitmap(texels, raw=True))
    assert found.sha256 == made(bitmap(texels.clip(0, 10), raw=True)).sha256
    with pytest.raises(SceneError, match=r"color1: checkerboard: 12.0 is outside \[0, 10\]"):
        made(board(0.5, 12.0))
    with pytest.raises(SceneError, match=r"checkerboard: \(0.5, 2.0, 1.0\) is outside \[0, 1\]"):
        veriray.load_dict(scene(SQUARE, diffuse(board(rgb(0.5, 2.0, 1.0))), DOWN[0]))


def test_refusals() -> None:
    mesh = {"type": "mesh", "vertices": POINTS, "faces": FACES, "vertex_a": np.full((5, 3), 1.5)}
    matt = diffuse(1.0)
    for shape, bsdf, message in (
        (SQUARE, diffuse(board(bitmap(COLOURS), color2=bitmap(COLOURS))),
         "not supported on checkerboard.color2, but on checkerboard.color0, checkerboard.color1$"),
        (mesh, diffuse(board(attribute("vertex_a"))), r"in row 0; times scale = 1 it must be in"),
        ({"type": "sphere"}, diffuse(board(attribute("vertex_a"))), 'reads "vertex_a"; allowed'),
        (SQUARE, {"type": "conductor", "material": "Au", "eta": bitmap(COLOURS)},
         "material and eta given; expected either material, or eta and k"),
        (SQUARE, {"type": "conductor", "k": bitmap(COLOURS), "ext_eta": 1.5}, "ext_eta given, and"),
        (mesh, {"type": "mask", "opacity": board(attribute("vertex_a", scale=0.1)), "b": matt},
         "has 3 numbers, expected one for what stands at"),
        (SQUARE, {"type": "plastic", "int_ior": board()}, "not supported on plastic.int_ior"),
    ):  # fmt: skip
        with pytest.raises(SceneError, match=message):
            veriray.load_dict(scene(shape, bsdf))
    spot = {"type": "spot", "texture": board(attribute("vertex_a"))}
    with pytest.raises(
        SceneError, match="mesh_attribute is of meshes, allowed on lights of plugin"
    ):
        veriray.load_dict(scene(SQUARE, diffuse(0.5), spot=spot))
    lamp = {"type": "area", "radiance": attribute("vertex_a")}
    with pytest.raises(SceneError, match='material or lamp reads "vertex_a"; allowed: on meshes'):
        veriray.load_dict(scene({"type": "sphere", "emitter": lamp}, diffuse(0.5)))
    with pytest.raises(SceneError, match=r"in row 0; times scale = -1 it must be in \[0, inf\)"):
        veriray.load_dict(
            scene(
                {**mesh, "emitter": {**lamp, "radiance": attribute("vertex_a", scale=-1.0)}},
                diffuse(0.5),
            )
        )
    with pytest.warns(SceneWarning, match='lamp reads "vertex_b", which the mesh has not'):
        veriray.load_dict(
            scene({**mesh, "emitter": {**lamp, "radiance": attribute("vertex_b")}}, diffuse(0.5))
        )


def test_arrays_that_no_scene_may_hold(cpu: str) -> None:
    good: dict[str, Any] = {
        "vertices": POINTS, "triangles": FACES, "triangle_material": [0] * 4,
        "reflectance": [[0.5] * 3], "texture_kind": [2, 1], "reflectance_texture": [1],
        "attribute_values": np.full((5, 3), 0.5), "texture_field0": [-1, 0],
    }  # fmt: skip

    def made(**more: Any) -> veriray.Scene:
        return veriray.Scene(camera=camera([0, 0, 2], [0, 0, 0]), film=veriray.Film(1, 1),
                             **{**good, **more})  # fmt: skip

    veriray.rendering.prepare(made(), cpu)
    for more, message in (
        ({"texture_field0": [-1, 1]}, r"texture_field0\[1\] = 1; allowed: of a checkerboard, a t"),
        ({"texture_field1": [1, 0]}, r"texture_field1\[0\] = 1; allowed: of a checkerboard, a t"),
        ({"texture_field1": [0, -1]}, r"texture_field1\[0\] = 0; allowed: of a checkerboard, a t"),
        ({"texture_kind": [2, 0]}, r"texture_field0\[1\] = 0; allowed: of a checkerboard, a t"),
        (
            {"texture_kind": [1] * 10, "texture_field1": range(-1, 9), "texture_field0": [-1] * 10},
            "texture 9 holds textures more than 8 deep",
        ),
        ({"texture_color1": [[0.0] * 3, [0.5, 2.0, 1.0]]}, r"texture_color1\[1\] = .* is outside"),
        ({"attribute_values": np.full((5, 3), 1.5)}, r"attribute_values\[0\] of texture 0 holds 1"),
        ({"eta_texture": [1]}, r"eta_texture\[0\] is set on a diffuse; allowed: on conductor, rou"),
    ):
        with pytest.raises(SceneError, match=message):
            made(**more)
    for name, value, message in (
        ("texture_field0", [-1, 1], r"texture_field\[1\] is 1; allowed: of a checkerboard, a text"),
        ("texture_kind", [1, 0], r"texture_field\[1\] is 0; allowed: of a checkerboard"),
    ):
        wrong = made()
        object.__setattr__(wrong, name, np.array(value, getattr(wrong, name).dtype))
        with pytest.raises(SceneError, match=message):
            veriray.rendering.prepare(wrong, cpu)
