"""Textures: image files, lookups beside Mitsuba's, and the numbers of materials that they give.

Under an even sky of radiance 1 a convex diffuse surface sends out its reflectance, without noise:
so a picture of one narrow pixel is a lookup.
"""

from __future__ import annotations

import itertools
import struct
import zlib
from decimal import Decimal, localcontext
from pathlib import Path
from typing import Any

import numpy as np
import OpenEXR
import pytest
from PIL import Image as Pillow

import veriray
from veriray import transform as tf
from veriray.columns import PRINCIPLED
from veriray.device import cpu_module
from veriray.errors import SceneError, SceneWarning
from veriray.formats import images
from veriray_validate.scenes import camera

ROOT = Path(__file__).resolve().parents[2]
RNG = np.random.default_rng(20161100)
COLOURS = RNG.random((3, 6, 3)).astype(np.float32)
IMAGES = {
    "srgb8": RNG.integers(0, 256, (5, 4, 3), dtype=np.uint8),
    "grey8": RNG.integers(0, 256, (5, 3, 1), dtype=np.uint8),
    "float": COLOURS,
    "grey float": COLOURS[..., :1].copy(),
    "half": COLOURS.astype(np.float16),
    "grey half": COLOURS[..., :1].astype(np.float16),
}
TO_UV = np.eye(4)
TO_UV[:2, [0, 1, 3]] = [[3.1, -0.7, -1.3], [1.2, 2.5, 0.4]]
TURN = tf.rotate((2 / 3, 1 / 3, 2 / 3), 70.0, "") @ tf.scale((1.3, 1.3, 1.3))
MIRROR = TURN @ np.diag([1.0, -1.0, 1.0, 1.0])
UNEVEN = tf.rotate((2 / 3, 1 / 3, 2 / 3), 20.0, "") @ tf.scale((1.3, 0.7, 1.0))
DOWN = [((x, y, 3.0), (x, y, 0.0)) for x, y in RNG.uniform(-0.6, 0.6, (4, 2)).tolist()]
SQUARE = {"type": "rectangle"}
AROUND = [(tuple(5 * d / np.linalg.norm(d)), tuple(0.2 * d[::-1])) for d in RNG.normal(size=(5, 3))]


ABOVE = (0.5, -0.3, 3.0), (0.5, -0.3, 0.0)


def scene(shape: dict[str, Any], bsdf: Any, view: Any = ABOVE, **more: Any) -> dict[str, Any]:
    """One narrow pixel along `view`, from one point to another, under a sky of radiance 1."""
    return {
        "type": "scene",
        "camera": {"type": "perspective", "fov": 1e-4, "to_world": camera(*view).to_world,
                   "film": {"type": "hdrfilm", "width": 1, "height": 1,
                            "rfilter": {"type": "box"}}},
        "sky": {"type": "constant"},
        "shape": {**shape, "bsdf": bsdf},
        **more,
    }  # fmt: skip


def seen(
    shape: dict[str, Any], bsdf: dict[str, Any], view: Any, device: str, spp: int = 0, **more: Any
) -> Any:
    """Radiance (3,) of that pixel; without spp that of a path that does not meet the shape again,
    the brightest of four."""
    made = veriray.load_dict(scene(shape, bsdf, view, **more))
    images = [
        veriray.render(made, spp or 1, seed, device=device, max_depth=3).image[0, 0]
        for seed in range(1 if spp else 4)
    ]
    return np.max(images, axis=0)


def diffuse(texture: Any) -> dict[str, Any]:
    return {"type": "diffuse", "reflectance": texture}


def bitmap(array: Any, **more: Any) -> dict[str, Any]:
    return {"type": "bitmap", "bitmap": array, **more}


CASES: list[tuple[dict[str, Any], dict[str, Any], Any]] = [
    *(
        (SQUARE, bitmap(IMAGES[name], wrap_mode=wrap, filter_type=kind, **more), DOWN)
        for (name, wrap, kind, more) in itertools.product(
            IMAGES,
            ("repeat", "mirror", "clamp"),
            ("bilinear", "nearest"),
            ({}, {"to_uv": TO_UV, "raw": True}),
        )
    ),
    ({"type": "rectangle"}, {"type": "checkerboard"}, DOWN),
    (
        {"type": "rectangle"},
        {"type": "checkerboard", "to_uv": TO_UV, "color0": 0.1,
         "color1": {"type": "rgb", "value": [0.5, 0.2, 0.9]}},
        DOWN,
    ),
    *(
        ({"type": kind, "to_world": matrix}, bitmap(COLOURS, raw=True), views)
        for kind, matrices, views in (
            ("rectangle", (UNEVEN, UNEVEN @ np.diag([-1.0, 1.0, 1.0, 1.0])), DOWN),
            ("disk", (np.eye(4), UNEVEN, UNEVEN @ np.diag([-1.0, 1.0, 1.0, 1.0])), DOWN),
            ("cube", (np.eye(4), UNEVEN), AROUND),
            ("sphere", (np.eye(4), TURN, MIRROR), AROUND),
        )
        for matrix in matrices
    ),
]  # fmt: skip


@pytest.mark.parametrize("case", range(len(CASES)))
def test_lookups_are_mitsubas(case: int, device: str) -> None:
    check_lookups(*CASES[case], device)


@pytest.mark.parametrize("more", ["plain", "flipped", "mirrored", "smooth"])
def test_meshes_without_coordinates_are_mitsubas(more: str, tmp_path: Path, device: str) -> None:
    lines = ["v -1 -1 0", "v 1 -1 0.2", "v 1 1 0.1", "v -1.2 1 0"]
    normals = ["vn 0.1 0 1", "vn 0 0.2 1", "vn 0 0 1", "vn -0.1 0 1"]
    smooth = more == "smooth"
    faces = ["f 1//1 2//2 3//3", "f 3//3 4//4 1//1"] if smooth else ["f 1 2 3", "f 3 4 1"]
    path = tmp_path / "a.obj"
    path.write_text("\n".join([*lines, *(normals if smooth else []), *faces]) + "\n")
    shape = {"type": "obj", "filename": str(path), "face_normals": not smooth}
    z = 3.0
    if more == "flipped":
        shape["flip_normals"], z = True, -3.0
    elif more == "mirrored":
        shape["to_world"] = tf.scale((-1, 1, 1))
    views = [((x, y, z), (x, y, 0.0)) for x, y in ((0.5, -0.3), (-0.4, 0.6), (0.1, 0.7))]
    check_lookups(shape, bitmap(COLOURS, raw=True), views, device)


def check_lookups(shape: Any, texture: Any, views: Any, device: str) -> None:
    """To 2e-5: both round to float32, and slopes are up to 30 a unit."""
    mitsuba = pytest.importorskip("mitsuba", reason="the peer renderer: pip install mitsuba")
    mitsuba.set_variant("scalar_rgb")
    theirs = {"bitmap": mitsuba.Bitmap} | dict.fromkeys(
        ("to_uv", "to_world"), mitsuba.ScalarTransform4f
    )

    def load(given: dict[str, Any]) -> Any:
        return mitsuba.load_dict({k: theirs.get(k, lambda v: v)(v) for k, v in given.items()})

    scene = mitsuba.load_dict({"type": "scene", "shape": load(shape)})
    exact = {"format": "variant", "accel": False} if "bitmap" in texture else {}
    looked_up = load({**texture, **exact})
    for origin, target in views:
        towards = np.subtract(target, origin)
        ray = mitsuba.Ray3f(list(origin), (towards / np.linalg.norm(towards)).tolist())
        hit = scene.ray_intersect(ray)
        assert hit.is_valid()
        found = seen(shape, diffuse(texture), (origin, target), device)
        np.testing.assert_allclose(found, np.array(looked_up.eval(hit)), rtol=0, atol=2e-5)


def test_srgb_table_is_correctly_rounded_and_the_native_one() -> None:
    text = (ROOT / "cpp" / "textures" / "srgb.h").read_text("utf-8")
    inside = text[text.index("= {") + 3 : text.rindex("};")]
    native = [float.fromhex(word.strip()[:-1]) for word in inside.split(",") if word.strip()]
    assert native == images.SRGB_TO_LINEAR.tolist()
    with localcontext() as context:
        context.prec = 40
        for code, found in enumerate(images.SRGB_TO_LINEAR):
            share = Decimal(code) / 255
            exact = share / Decimal("12.92")
            if share > Decimal("0.04045"):
                exact = ((share + Decimal("0.055")) / Decimal("1.055")) ** Decimal("2.4")
            off = abs(Decimal(float(found)) - exact)
            for other in (np.nextafter(found, np.float32(-1)), np.nextafter(found, np.float32(2))):
                assert off <= abs(Decimal(float(other)) - exact), code
    assert (images.BYTE_TO_SHARE == np.arange(256, dtype=np.float32) / np.float32(255)).all()


def test_an_even_texture_has_the_bits_of_its_colour(device: str) -> None:
    """Of a picture with interreflection: every lookup is the colour to the bit."""
    colour = [0.25, 0.5, 0.71875]
    board = {
        "type": "checkerboard",
        **{f"color{k}": {"type": "rgb", "value": colour} for k in "01"},
    }
    image = np.full((3, 2, 3), colour, np.float32)
    texel = np.full((4, 3), 128, np.uint8)
    grey = {"type": "rgb", "value": [float(np.float32(128 / 255))] * 3}
    for plain, textures in (
        (
            {"type": "rgb", "value": colour},
            (board, bitmap(image), bitmap(image.astype(np.float16))),
        ),
        (grey, (bitmap(texel, raw=True),)),
    ):
        hashes = set()
        for reflectance in (plain, *textures):
            scene = {
                "type": "scene",
                "camera": {"type": "perspective", "fov": 60.0, "to_world":
                           camera([0, 0, 4], [0, 0, 0]).to_world,
                           "film": {"type": "hdrfilm", "width": 24, "height": 24}},
                "sky": {"type": "constant"},
                "ball": {"type": "sphere", "bsdf": diffuse(reflectance)},
                "floor": {"type": "rectangle", "to_world": tf.scale((3, 3, 1)),
                          "bsdf": diffuse(reflectance)},
                "disk": {"type": "disk", "to_world": tf.translate((1.5, 0, 0.5)),
                         "bsdf": diffuse(reflectance)},
            }  # fmt: skip
            hashes |= {
                veriray.render(veriray.load_dict(scene), 8, device=device, scheduler=s).film_sha256
                for s in ("fused", "thrust", "wavefront")
            }
        assert len(hashes) == 1


def test_texels_of_a_wrapped_edge(device: str) -> None:
    """Between the last texel and what follows it: the first, itself, and itself."""
    row = bitmap(np.array([[[0.25], [0.5], [1.0]]], np.float32))
    view = ((2 * 2.9 / 3 - 1, 0.1, 3.0), (2 * 2.9 / 3 - 1, 0.1, 0.0))  # 0.4 texels behind the last
    for wrap, follows in (("repeat", 0.25), ("mirror", 1.0), ("clamp", 1.0)):
        found = seen({"type": "rectangle"}, diffuse({**row, "wrap_mode": wrap}), view, device)
        np.testing.assert_allclose(found, 0.6 * 1.0 + 0.4 * follows, atol=1e-5)


@pytest.mark.parametrize("nonlinear", [False, True])
def test_a_base_in_a_coat(nonlinear: bool, device: str) -> None:
    colour = [0.25, 0.5, 0.71875]
    image = bitmap(np.full((2, 2, 3), colour, np.float32))
    plain, textured = (
        seen({"type": "rectangle"},
             {"type": "plastic", "diffuse_reflectance": c, "nonlinear": nonlinear}, DOWN[0], device)
        for c in ({"type": "rgb", "value": colour}, image)
    )  # fmt: skip
    np.testing.assert_allclose(plain, textured, rtol=3e-7)


def test_every_texturable_parameter_is_read(device: str) -> None:
    """An even texture of 0.25 against the number 0.25; what the texture replaces is 1 or 0.5."""
    image = bitmap(np.full((2, 2, 1), 0.25, np.float32))
    for kind, name in (
        ("diffuse", "reflectance"),
        ("conductor", "specular_reflectance"),
        ("dielectric", "specular_reflectance"),
        ("dielectric", "specular_transmittance"),
        ("thindielectric", "specular_reflectance"),
        ("thindielectric", "specular_transmittance"),
        ("plastic", "diffuse_reflectance"),
        ("plastic", "specular_reflectance"),
        ("roughplastic", "diffuse_reflectance"),
        ("roughconductor", "alpha"),
        ("roughdielectric", "alpha"),
        *(("principled", name) for name in PRINCIPLED),
    ):
        also: dict[str, Any] = {}
        if kind == "principled":  # tints and gloss need what they are of
            also = {"base_color": {"type": "rgb", "value": [0.8, 0.3, 0.1]}, "sheen": 1.0}
            also = {**also, "clearcoat": 1.0} if name == "clearcoat_gloss" else also
            also.pop(name, None)
        plain, textured, default = (
            seen(
                {"type": "sphere"},
                {"type": kind, **given},
                AROUND[0],
                device,
                1 << 14 if name == "alpha" else 512,
            )  # fmt: skip
            for given in ({name: 0.25, **also}, {name: image, **also}, also)
        )
        np.testing.assert_allclose(plain, textured, rtol=1e-6, err_msg=f"{kind}.{name}")
        assert abs(default - plain).max() > (1e-5 if name == "alpha" else 1e-4)  # lost in slopes
    names = veriray.formats.plugins.texturable()
    assert len(names) >= 9 and "mask.opacity" in names


def test_roughness_by_texture() -> None:
    """A texture, or two alike, for both directions; or textures and numbers for each."""
    board = {"type": "checkerboard", "color0": 0.1, "color1": 0.5}

    def material(**alpha: object) -> veriray.Scene:
        bsdf = {"type": "roughconductor", **alpha}
        sensor = {"type": "perspective", "fov": 45.0}
        ball = {"type": "sphere", "bsdf": bsdf}
        return veriray.load_dict(
            {"type": "scene", "s": sensor, "e": {"type": "constant"}, "b": ball}
        )

    scene = material(alpha_u=board, alpha_v=dict(board))
    assert scene.alpha_u_texture[0] == scene.alpha_v_texture[0] >= 0
    other = {**board, "color0": 0.2}
    apart = material(alpha_u=board, alpha_v=other)
    assert 0 <= apart.alpha_u_texture[0] != apart.alpha_v_texture[0] >= 0
    mixed = material(alpha_u=board, alpha_v=0.25)
    assert mixed.alpha_u_texture[0] == 0 and mixed.alpha_v_texture[0] == -1
    assert mixed.alpha_v[0] == 0.25
    for wrong in ({"alpha_u": board}, {"alpha": board, "alpha_u": board}, {"alpha_v": 0.1}):
        with pytest.raises(veriray.SceneError, match="expected alpha|given twice"):
            material(**wrong)


def test_the_scale_of_a_pfm_file(tmp_path: Path) -> None:
    texels = np.arange(6, dtype="<f4").reshape(1, 2, 3) / 8
    for scale, factor in ((b"-1.0", 1.0), (b"-0.5", 0.5), (b"-25e-1", 2.5)):
        (tmp_path / "a.pfm").write_bytes(b"PF\n2 1\n" + scale + b"\n" + texels.tobytes())
        found = images.read(tmp_path / "a.pfm", "here").texels
        assert (found == texels * np.float32(factor)).all()
    for scale in (b"0", b"-0.0", b"1.2.3"):
        (tmp_path / "a.pfm").write_bytes(b"PF\n2 1\n" + scale + b"\n" + texels.tobytes())
        with pytest.raises(SceneError, match="its scale is"):
            images.read(tmp_path / "a.pfm", "here")


def test_opacity(device: str) -> None:
    """Camera rays and shadow rays pass the open fields of a mask, and only those."""
    board = {"type": "checkerboard", "color0": 0.0, "color1": 1.0}  # exchanged, as by Mitsuba
    mask = {"type": "mask", "opacity": board, "in": diffuse(0.0)}
    for x, open_ in ((-0.5, False), (0.5, True)):  # v below 0.5
        found = seen({"type": "rectangle"}, mask, ((x, -0.5, 3.0), (x, -0.5, 0.0)), device)
        assert (found == (1.0 if open_ else 0.0)).all()
    lamp = {"type": "point", "position": [0.5, -0.5, 2.0], "intensity": 4.0}
    floor = {"type": "rectangle", "to_world": tf.translate((0, 0, -1)), "bsdf": diffuse(0.5)}
    for x, lit in ((-0.5, False), (0.5, True)):
        lamp["position"] = [x, -0.5, 2.0]
        found = seen({"type": "rectangle"}, mask, ((0.5, -0.5, -0.5), (x, -0.5, -1.0)), device,
                     lamp=lamp, floor=floor, sky={"type": "constant", "radiance": 0.0})  # fmt: skip
        expected = 0.5 / np.pi * 4 / 9 if lit else 0.0
        np.testing.assert_allclose(found, expected, rtol=1e-4, atol=1e-8)


def test_luminance_of_a_coloured_opacity(device: str) -> None:
    """As Mitsuba's eval_1, by 20,000 rays, to 5 standard errors: 6e-7 of sound runs fail."""
    image = bitmap(np.full((2, 2, 3), [0.2, 0.5, 0.8], np.float32))
    mask = {"type": "mask", "opacity": image, "in": diffuse(0.0)}
    scene = {"type": "scene", "camera": {"type": "perspective", "fov": 1e-4, "to_world":
             camera(*DOWN[0]).to_world, "film": {"type": "hdrfilm", "width": 1, "height": 1}},
             "sky": {"type": "constant"}, "s": {"type": "rectangle", "bsdf": mask}}  # fmt: skip
    done = veriray.render(veriray.load_dict(scene), 20_000, device=device)
    share = 1 - (0.2 * 0.212671 + 0.5 * 0.71516 + 0.8 * 0.072169)
    assert abs(done.image[0, 0, 0] - share) < 5 * (share * (1 - share) / 20_000) ** 0.5


def test_triangles_with_other_coordinates_are_not_joined(cpu: str) -> None:
    """Two halves of a square, one of which has its texture turned, or moved by more than rounding.

    A map whose corners are rounded to float32 at 1000 is one; with a corner 2^-10 off it is two.
    """
    arrays = {
        "vertices": [[0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0], [0, 0, 0], [1, 1, 0]],
        "triangles": [[0, 1, 2], [4, 5, 3]],
        "triangle_material": [0, 0],
        "reflectance": [[0.5] * 3],
        "texture_kind": [1],
    }
    film = veriray.Film(1, 1)
    far = np.array(arrays["vertices"])[:, :2] @ [[0.7, -0.3], [0.1, 0.9]] + 1000.1
    off = np.zeros((6, 2))
    off[3, 1] = 2.0**-10
    for uv, texture, count in (
        (far, 0, 1),
        (far + off, 0, 2),
        ([[0, 0], [1, 0], [1, 1], [0, 1], [0, 0], [1, 1]], 0, 1),
        ([[0, 0], [1, 0], [1, 1], [0, 1], [1, 0], [1, 1]], 0, 2),
        ([[0, 0], [1, 0], [1, 1], [0, 1], [1, 0], [1, 1]], -1, 1),
    ):
        scene = veriray.Scene(camera=camera([0, 0, 2], [0, 0, 0]), film=film, uv=uv,
                              reflectance_texture=[texture], **arrays)  # fmt: skip
        facts = veriray.rendering.prepare(scene, cpu)
        assert sum(facts["primitives"].values()) == count, facts["primitives"]
        assert ("textures" in facts["features"]) == (texture == 0)


@pytest.mark.parametrize("what", ["flat", "tree", "smooth", "turned"])
def test_texture_coordinates_of_meshes(what: str, device: str) -> None:
    """Of small scenes, of a tree, and of triangles whose vertex normals look the other way."""
    corners = np.array([[0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0]], float)
    uv = np.array([[0.1, 0.2], [0.9, 0.3], [0.8, 0.9], [0.2, 0.7]])
    faces = np.array([[0, 1, 2], [0, 2, 3]])
    faces = faces[:, ::-1] if what == "turned" else faces
    normals = np.tile([0.0, 0.0, 1.0], (4, 1)) if what in ("smooth", "turned") else None
    dust = [[9, 9, -9, 1e-4]] if what == "tree" else []
    for x, y in ((0.7, 0.2), (0.3, 0.9)):
        scene = veriray.Scene(
            vertices=corners, uv=uv, triangles=faces, triangle_material=[0, 0], normals=normals,
            spheres=dust, sphere_material=[0] * len(dust), reflectance=[[0.5] * 3],
            reflectance_texture=[0], texture_kind=[0], texture_width=[2], texture_height=[2],
            texture_format=[3], texture_grey=[True], texture_wrap=[2],
            texels=np.array([0.1, 0.9, 0.4, 0.2], np.float32).view(np.uint32),
            environment=[1.0] * 3, camera=camera([x, y, 2], [x, y, 0], 1e-4),
            film=veriray.Film(1, 1),
        )  # fmt: skip
        assert ("bvh" in veriray.rendering.prepare(scene, device)["features"]) == (what != "flat")
        a, b, c = (0, 1, 2) if x > y else (0, 3, 2)
        at = np.linalg.solve((corners[[b, c], :2] - corners[a, :2]).T, [x, y])
        u, v = uv[a] + at @ (uv[[b, c]] - uv[a])
        s, t = np.clip(2 * u - 0.5, 0, 1), np.clip(2 * v - 0.5, 0, 1)
        expected = (1 - t) * ((1 - s) * 0.1 + s * 0.9) + t * ((1 - s) * 0.4 + s * 0.2)
        found = veriray.render(scene, 4, device=device, max_depth=3).image[0, 0]
        np.testing.assert_allclose(found, expected, atol=1e-5)


def test_the_texels_are_part_of_the_hash(tmp_path: Path) -> None:
    """Decoded ones: another file of the same texels leaves it alone."""
    image = IMAGES["srgb8"]
    hashes = []
    for name, texels in (("a.png", image), ("b.bmp", image), ("c.png", image ^ 1)):
        Pillow.fromarray(texels).save(tmp_path / name)
        scene = {"type": "scene", "camera": {"type": "perspective", "fov": 40.0},
                 "s": {"type": "sphere", "bsdf": diffuse(
                     {"type": "bitmap", "filename": str(tmp_path / name)})},
                 "e": {"type": "constant"}}  # fmt: skip
        hashes.append(veriray.load_dict(scene).sha256)
    assert hashes[0] == hashes[1] != hashes[2]


# ---- image files ----


def from_srgb(code: np.ndarray[Any, Any]) -> np.ndarray[Any, Any]:
    """Linear values of sRGB codes in [0, 1] (IEC 61966-2-1)."""
    return np.where(code <= 0.04045, code / 12.92, ((code + 0.055) / 1.055) ** 2.4)


def png_16(texels: np.ndarray[Any, Any]) -> bytes:
    """A PNG of 16 bits whose rows have the filters 0 to 4 in turn (PNG, section 9)."""
    height, width, channels = texels.shape
    step, last, data = 2 * channels, bytes(2 * width * channels), b""
    for y in range(height):
        row, coded = texels[y].astype(">u2").tobytes(), []
        for i, byte in enumerate(row):
            left, corner = (r[i - step] if i >= step else 0 for r in (row, last))
            guess = left + last[i] - corner
            corner_guess = min((left, last[i], corner), key=lambda x: abs(guess - x))
            coded.append(
                byte - (0, left, last[i], (left + last[i]) // 2, corner_guess)[y % 5] & 255
            )
        data, last = data + bytes([y % 5, *coded]), row
    head = struct.pack(">IIBBBBB", width, height, 16, {2: 4, 3: 2, 4: 6}[channels], 0, 0, 0)
    return b"\x89PNG\r\n\x1a\n" + b"".join(
        struct.pack(">I", len(body)) + name + body + struct.pack(">I", zlib.crc32(name + body))
        for name, body in ((b"IHDR", head), (b"IDAT", zlib.compress(data)), (b"IEND", b""))
    )


@pytest.mark.parametrize("channels", [2, 3, 4])
def test_png_files_of_16_bits(tmp_path: Path, channels: int) -> None:
    texels = RNG.integers(0, 1 << 16, (11, 7, channels), dtype=np.uint16)
    colours = 1 if channels == 2 else 3
    texels[0, :3, 0] = 0, 257, 65535
    path = tmp_path / "x.png"
    path.write_bytes(png_16(texels))
    codes = texels[:, :, :colours].astype(np.float64)
    found = images.read(path, "", raw=True)
    assert not found.encoded and (found.texels == (codes / 65535).astype(np.float32)).all()
    linear = images.read(path, "").texels
    assert linear[0, :3, 0].tolist() == [0.0, float(images.SRGB_TO_LINEAR[1]), 1.0]
    np.testing.assert_allclose(linear, from_srgb(codes / 65535), rtol=1e-6)
    if channels != 3:
        alpha = images.read(path, "", channel="a").texels
        assert (alpha == (texels[:, :, -1:].astype(np.float64) / 65535).astype(np.float32)).all()
    path.write_bytes(png_16(texels)[:-40])
    with pytest.raises(SceneError, match="not a readable image"):
        images.read(path, "")


def png_of(codes: np.ndarray[Any, Any], depth: int, key: tuple[int, ...] = ()) -> bytes:
    """A PNG of 1 to 4 numbers a texel, of so many bits each; key: the colour that is clear."""
    height, width, channels = codes.shape
    bits = (codes[..., None] >> np.arange(depth)[::-1] & 1).reshape(height, -1)
    rows = np.packbits(bits.astype(np.uint8), axis=1)
    colour = {1: 0, 2: 4, 3: 2, 4: 6}[channels]
    chunks = [(b"IHDR", struct.pack(">IIBBBBB", width, height, depth, colour, 0, 0, 0))]
    chunks += [(b"tRNS", struct.pack(f">{len(key)}H", *key))] if key else []
    chunks += [(b"IDAT", zlib.compress(np.insert(rows, 0, 0, axis=1).tobytes())), (b"IEND", b"")]
    return b"\x89PNG\r\n\x1a\n" + b"".join(
        struct.pack(">I", len(body)) + name + body + struct.pack(">I", zlib.crc32(name + body))
        for name, body in chunks
    )


@pytest.mark.parametrize("channels", [1, 2, 3, 4])
def test_png_files_of_16_bits_become_8_bits_of_a_gltf_file(channels: int) -> None:
    codes = RNG.integers(0, 1 << 16, (5, 7, channels))
    codes[0, :3, 0] = 0, 257, 65535
    found = images.rgba(png_of(codes, 16), "", "")
    nearest = np.rint(codes / 257)
    assert (found[..., :3] == (nearest[..., :3] if channels > 2 else nearest[..., :1])).all()
    assert (found[..., 3] == (255 if channels % 2 else nearest[..., -1])).all()


@pytest.mark.parametrize(
    ("depth", "channels"), [(1, 1), (2, 1), (4, 1), (8, 1), (16, 1), (8, 3), (16, 3)]
)
def test_the_colour_key_of_png_files(tmp_path: Path, depth: int, channels: int) -> None:
    """It is compared with the numbers that the file holds, of 16 bits too."""
    codes = RNG.integers(0, 1 << depth, (5, 7, channels))
    codes[2, 3] = codes[1, 1] = key = codes[0, 0] ^ 1
    codes[3, 3] = codes[0, 0]  # in 16 bits it has the key's high byte
    path = tmp_path / "x.png"
    path.write_bytes(png_of(codes, depth, tuple(key.tolist())))
    seen = (codes != key).any(axis=2)
    assert not seen.all() and seen.any()
    assert (images.rgba(path.read_bytes(), "", "")[..., 3] == 255 * seen).all()
    assert (images.read(path, "", channel="a").linear()[..., 0] == seen).all()


@pytest.mark.parametrize("depth", [1, 2, 4])
def test_only_the_low_bits_of_a_colour_key_count(tmp_path: Path, depth: int) -> None:
    codes = RNG.integers(0, 1 << depth, (5, 7, 1))
    path = tmp_path / "x.png"
    for key in (0, 1):
        path.write_bytes(png_of(codes, depth, (key + (5 << depth),)))
        seen = codes[..., 0] != key
        assert (images.rgba(path.read_bytes(), "", "")[..., 3] == 255 * seen).all()
        assert (images.read(path, "", channel="a").linear()[..., 0] == seen).all()


@pytest.mark.parametrize("kind", [2, 3, 5, 6])
def test_pgm_and_ppm_files_of_any_white(tmp_path: Path, kind: int) -> None:
    path = tmp_path / "x.ppm"
    for white in (1, 15, 100, 255, 1023, 65535):
        codes = RNG.integers(0, white + 1, (5, 7, 3 if kind in (3, 6) else 1))
        codes[0, 0] = 1
        head = f"P{kind}\n# made by hand\n7 5\n{white}\n".encode()
        body = " ".join(map(str, codes.ravel().tolist())).encode()
        if kind > 3:
            body = codes.astype(">u2" if white > 255 else "u1").tobytes()
        path.write_bytes(head + body)
        found = images.read(path, "", raw=True)
        assert found.texels.dtype == (np.uint8 if white == 255 else np.float32)
        assert (found.linear() == (codes / white).astype(np.float32)).all()
        linear = images.read(path, "").linear()
        np.testing.assert_allclose(linear, from_srgb(codes / white), rtol=1e-6)
        path.write_bytes((head + body)[:-5])
        with pytest.raises(SceneError, match="it ends before its last texel"):
            images.read(path, "")
        path.write_bytes(f"P{kind % 3 or 3} 1 1 {white} {' 70000' * 3}".encode())
        with pytest.raises(SceneError, match="numbers outside"):
            images.read(path, "")


def test_texels_beyond_a_share_are_the_nearest(tmp_path: Path) -> None:
    image = np.full((2, 2, 3), 0.5, np.float32)
    image[0, 1] = 1.5, -0.25, 1.0
    image[1, 1, 0] = 3.0
    path = tmp_path / "x.exr"
    OpenEXR.File({"type": OpenEXR.scanlineimage}, {"RGB": image}).write(str(path))
    text = r"x.exr. holds 2 numbers above 1, up to 3: more than all light; 1 below 0, down to -0.25"
    scene, plain = (
        {"type": "scene", "sky": {"type": "constant"}, "s": {**SQUARE, "bsdf": diffuse(texture)}}
        for texture in ({"type": "bitmap", "filename": str(path)}, bitmap(image.clip(0, 1)))
    )
    scene["camera"] = plain["camera"] = {"type": "perspective"}
    with pytest.warns(SceneWarning, match=text):
        found = veriray.load_dict(scene)
    expected = veriray.load_dict(plain)
    assert found.sha256 == expected.sha256 and not expected.notes and len(found.notes) == 1
    with pytest.raises(SceneError, match="an error by strict"):
        veriray.load_dict(scene, strict=True)


def test_image_files(tmp_path: Path) -> None:
    path = tmp_path / "x"
    for mode, channels, wanted in (("L", 1, 1), ("LA", 2, 1), ("RGB", 3, 3), ("RGBA", 4, 3)):
        texels = RNG.integers(0, 256, (5, 7, channels), dtype=np.uint8)
        Pillow.fromarray(texels.squeeze(), mode).save(path, "PNG")
        for raw in (False, True):
            found = images.read(path, "", raw=raw)
            assert found.encoded != raw and (found.texels == texels[..., :wanted]).all()
    codes = np.array([[0, 257], [32768, 65535]], np.uint16)
    Pillow.fromarray(codes).save(path, "PNG")
    assert images.read(path, "").texels.ravel()[[0, 1, 3]].tolist() == [
        0.0, float(images.SRGB_TO_LINEAR[1]), 1.0]  # fmt: skip
    assert images.read(path, "", raw=True).texels.ravel().tolist() == [
        float(np.float32(c / 65535)) for c in codes.ravel().tolist()]  # fmt: skip
    for kind in (np.float16, np.float32):
        texels = RNG.random((5, 9, 3)).astype(kind)
        OpenEXR.File({"type": OpenEXR.scanlineimage}, {"RGB": texels}).write(str(path))
        found = images.read(path, "")
        assert found.texels.dtype == kind and (found.texels == texels).all()
    for order, scale in (("<", b"-1.0"), (">", b"1")):
        texels = RNG.random((4, 5, 3)).astype(np.float32)
        path.write_bytes(b"PF\n5 4\n" + scale + b"\n" + texels[::-1].astype(order + "f4").tobytes())
        assert (images.read(path, "").texels == texels).all()


@pytest.mark.parametrize("native", [False, True])
@pytest.mark.parametrize("runs", [False, True])
def test_radiance_hdr(
    runs: bool, native: bool, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    if not native:
        monkeypatch.setattr(images, "cpu_module", lambda: None)
    width, height = 19, 7
    codes = RNG.integers(0, 256, (height, width, 4), dtype=np.uint8)
    codes[..., 3] = RNG.integers(120, 140, (height, width))
    codes[5, :, 3] = RNG.integers(0, 12, width)  # below the normal float32
    codes[2], codes[3, 4:] = 0, codes[3, 4]
    body = b""
    for line in codes:
        if runs:
            body += bytes((2, 2, 0, width))
            for channel in line.T.tolist():
                for value, same in itertools.groupby(channel):
                    count = len(list(same))
                    body += bytes((128 + count, value)) if count > 1 else bytes((1, value))
        else:
            body += line.tobytes()
    head = b"#?RADIANCE\nFORMAT=32-bit_rle_rgbe\nEXPOSURE=1\n\n-Y 7 +X 19\n"
    path = tmp_path / "x.hdr"
    path.write_bytes(head + body)
    exact = codes[..., :3] * 2.0 ** (codes[..., 3:].astype(int) - 136) * (codes[..., 3:] > 0)
    assert (images.read(path, "").texels == exact).all()
    for cut in range(len(head) + len(body)):
        path.write_bytes((head + body)[:cut])
        with pytest.raises(SceneError, match="damaged|known kind"):
            images.read(path, "")


def test_damaged_runs_of_radiance_hdr(monkeypatch: pytest.MonkeyPatch) -> None:
    """Lines with bytes changed at random: the same for the native reader, or damaged for both."""
    rng, damaged = np.random.default_rng(3), 0
    head = b"#?RADIANCE\n\n-Y 3 +X 9\n"
    for _ in range(2000):
        body = bytearray()
        for _ in range(3):
            body += bytes((2, 2, 0, 9))
            for _ in range(4):
                body += bytes((128 + 5, rng.integers(256), 4, *rng.integers(256, size=4)))
        for place in rng.integers(0, len(body), rng.integers(3)):
            body[place] = rng.choice([0, 1, 2, 9, 127, 128, 129, 130, 255])
        found: list[Any] = []
        for module in (cpu_module, lambda: None):
            monkeypatch.setattr(images, "cpu_module", module)
            try:
                found.append(images._hdr(head + body).tobytes())
            except SceneError as error:
                found.append(str(error))
        damaged += isinstance(found[0], str)
        assert found[0] == found[1]
    assert 200 < damaged < 1800


def test_damaged_and_foreign_images(tmp_path: Path) -> None:
    path = tmp_path / "x.png"
    with pytest.raises(SceneError, match=r"^here: cannot read .*No such file"):
        images.read(path, "here")
    for content, message in (
        (b"", "not an image of a known kind"),
        (b"GIF89a" + bytes(50), "not an image of a known kind"),
        (b"PF\n99999 99999\n-1\n", "99999 x 99999 texels; expected 1 to 32768"),
        (b"PF\n4 4\n-1\n" + bytes(100), "ends before its last texel"),
        (b"Pf\n1 1\n-1\n" + np.array([np.nan], "<f4").tobytes(), r"texel \(x 0, y 0\) is nan"),
        (b"#?RADIANCE\nFORMAT=32-bit_rle_xyze\n\n-Y 1 +X 1\n0000", "only FORMAT=32-bit_rle_rgbe"),
        (b"#?RADIANCE\n\n+Y 1 +X 1\n0000", "no header of an HDR file"),
    ):
        path.write_bytes(content)
        with pytest.raises(SceneError, match=message):
            images.read(path, "here")
    Pillow.fromarray(RNG.integers(0, 256, (64, 64, 3), dtype=np.uint8)).save(path)
    whole = path.read_bytes()
    for cut in range(0, len(whole) - 60, 97):
        path.write_bytes(whole[:cut])
        with pytest.raises(SceneError, match="not an image|not a readable image"):
            images.read(path, "here")
    pixels = np.zeros((2, 2, 3), np.float32)
    OpenEXR.File({"type": OpenEXR.scanlineimage},
                 {name: pixels[..., 0] for name in ("A.R", "B")}).write(str(path))  # fmt: skip
    with pytest.raises(SceneError, match="no channels R, G, B, and no channel Y; found A.R, B"):
        images.read(path, "here")


# ---- what a scene may say ----


def loaded(shape: dict[str, Any], **more: Any) -> veriray.Scene:
    return veriray.load_dict({"type": "scene", "c": {"type": "perspective", "fov": 40.0},
                              "e": {"type": "constant"}, "s": shape, **more})  # fmt: skip


def test_textures_in_a_file(tmp_path: Path) -> None:
    """Nested, by reference, in other bsdfs, read once."""
    Pillow.fromarray(IMAGES["srgb8"]).save(tmp_path / "a.png")
    text = """<scene version="3.0.0">
    <sensor type="perspective"><float name="fov" value="40"/></sensor>
    <emitter type="constant"/>
    <texture type="bitmap" id="wood"><string name="filename" value="a.png"/>
        <transform name="to_uv"><scale x="2" y="3"/></transform></texture>
    <shape type="sphere"><bsdf type="twosided"><bsdf type="diffuse">
        <ref id="wood" name="reflectance"/></bsdf></bsdf></shape>
    <shape type="sphere"><bsdf type="plastic"><texture type="bitmap" name="diffuse_reflectance">
        <string name="filename" value="a.png"/><string name="wrap_mode" value="clamp"/></texture>
        <ref id="wood" name="specular_reflectance"/></bsdf></shape>
    <shape type="rectangle"><bsdf type="mask"><texture type="checkerboard" name="opacity"/>
        <bsdf type="diffuse"/></bsdf></shape>
    </scene>"""
    path = tmp_path / "x.xml"
    path.write_text(text)
    scene = veriray.load_file(path)
    assert scene.texture_kind.tolist() == [0, 0, 1] and len(scene.texels) == 20
    assert scene.texture_first.tolist() == [0, 0, 0] and scene.texture_wrap.tolist() == [0, 2, 0]
    assert scene.texture_to_uv[0].tolist() == [[2, 0, 0], [0, 3, 0]]
    assert scene.reflectance_texture.tolist() == [0, 1, -1]
    assert scene.specular_reflectance_texture.tolist() == [-1, 0, -1]
    assert scene.opacity_texture.tolist() == [-1, -1, 2] and scene.two_sided.tolist()[0]


@pytest.mark.parametrize("kind", ["f2", "f4", "f8"])
def test_arrays_of_the_other_byte_order(kind: str) -> None:
    array = RNG.random((3, 5, 3)).astype(f"<{kind}")
    one, other = (
        loaded({"type": "sphere", "bsdf": diffuse(bitmap(given))})
        for given in (array, array.astype(f">{kind}"))
    )
    assert one.sha256 == other.sha256


def test_refusals(tmp_path: Path) -> None:
    one = np.ones((2, 2, 3), np.float32)
    board = {"type": "checkerboard"}
    for bsdf, message in (
        ({"type": "plastic", "int_ior": board},
         "checkerboard is not supported on plastic.int_ior, but on plastic.diffuse_reflectance"),
        ({"type": "diffuse", "colour": board}, "not supported on diffuse.colour, but on diffuse.r"),
        (diffuse({"type": "bitmap", "color0": board}),
         r"not supported on bitmap.color0, but on diffuse.reflectance, .*mask.opacity, "),
        (diffuse({"type": "bitmap"}), "no image given; expected one of filename, data, bitmap"),
        (diffuse(bitmap(one, data=one)), "data and bitmap given"),
        (diffuse(bitmap(one, wrap_mode="black")), r'"wrap_mode" = "black" is not supported'),
        (diffuse(bitmap(one * np.nan)), "it must be finite"),
        (diffuse(bitmap(np.zeros((2, 2, 2)))), r"an image of shape \(2, 2, 2\)"),
        (diffuse(bitmap(np.zeros((2, 2, 3), np.int32))), "of shape .* type int32"),
        (diffuse(bitmap(np.zeros((0, 2, 3), np.float32))), "2 x 0 texels"),
        (diffuse({"type": "bitmap", "filename": "nowhere.png"}), 'cannot read "nowhere.png"'),
        (diffuse(bitmap(one, to_uv=np.diag([1e7, 1, 1, 1]))), "texture_to_uv"),
    ):  # fmt: skip
        with pytest.raises(SceneError, match=message):
            loaded({"type": "sphere", "bsdf": bsdf})
    with pytest.raises(SceneError, match="not supported on area.intensity"):
        loaded({"type": "sphere", "emitter": {"type": "area", "intensity": board}})
    with pytest.raises(SceneError, match='"reflectance" is given twice'):
        path = tmp_path / "x.xml"
        path.write_text("""<scene version="3.0.0">
            <sensor type="perspective"><float name="fov" value="40"/></sensor>
            <shape type="sphere"><bsdf type="diffuse"><rgb name="reflectance" value="1"/>
            <texture name="reflectance" type="checkerboard"/></bsdf></shape></scene>""")
        veriray.load_file(path)


def test_arrays_that_no_texture_may_hold(cpu: str) -> None:
    def scene(**more: Any) -> veriray.Scene:
        given: dict[str, Any] = {
            "spheres": [[0, 0, 0, 1]], "sphere_material": [0], "reflectance": [[0.5] * 3],
            "reflectance_texture": [0], "texture_kind": [0], "texels": np.zeros(4, np.uint32),
            "texture_width": [2], "texture_height": [2],
        }  # fmt: skip
        return veriray.Scene(camera=camera([0, 0, 2], [0, 0, 0]), film=veriray.Film(1, 1),
                             **{**given, **more})  # fmt: skip

    scene()
    for more, message in (
        ({"texture_first": [1]}, r"texture_first\[0\] = 1: 2 x 2 texels srgb8 end at 5; there a"),
        ({"texture_format": [3]}, "end at 12"),
        ({"texture_width": [0]}, r"texture_width\[0\] = 0"),
        ({"reflectance_texture": [1]}, r"reflectance_texture\[0\] = 1"),
        ({"texture_wrap": [3]}, "texture_wrap"),
        ({"texture_format": [3], "texture_width": [1], "texture_height": [1],
          "texels": np.full(4, 0x40000000, np.uint32)}, r"texels\[0\] of texture 0 holds 2"),
        ({"sphere_frame": np.zeros((1, 3, 3))}, r"sphere_frame\[0\]"),
    ):  # fmt: skip
        with pytest.raises(SceneError, match=message):
            scene(**more)
    good = scene()
    object.__setattr__(good, "texture_first", np.array([1], np.uint32))
    with pytest.raises(SceneError, match=r"texture_first\[0\] begins texels that end at 5"):
        veriray.rendering.prepare(good, cpu)
