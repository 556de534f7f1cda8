"""Images around scenes: what is read, what is refused, and what they change."""

from __future__ import annotations

import dataclasses
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from PIL import Image

import veriray
from veriray import SceneError
from veriray.formats.images import SRGB_TO_LINEAR

RNG = np.random.default_rng(5)
TEXELS = RNG.uniform(0, 2, (5, 8, 3)).astype(np.float32)
TURN = np.array([[0.0, 0, 1, 5], [1, 0, 0, 6], [0, -1, 0, 7], [0, 0, 0, 1]])  # a reflection
VIEW = {"type": "perspective", "fov": 90.0, "film": {"type": "hdrfilm", "width": 8, "height": 8,
        "rfilter": {"type": "box"}}}  # fmt: skip


def scene(**values: Any) -> veriray.Scene:
    values.setdefault("bitmap", TEXELS)
    sky = {"type": "envmap", **{k: v for k, v in values.items() if v is not None}}
    return veriray.load_dict({"type": "scene", "view": VIEW, "sky": sky})


def test_the_arrays_of_an_image() -> None:
    found = scene(scale=2.0, to_world=TURN, mis_compensation=True)
    assert found.sky_texels.dtype == np.float32 and found.sky_size.tolist() == [8, 5]
    assert (found.sky_texels == 2 * TEXELS.reshape(-1, 3)).all()
    assert (found.sky_to_world == TURN[:3, :3]).all() and not found.environment.any()
    assert veriray.render(found, 1, device="cpu").stats["features"]
    bright = found.with_emission_scaled(4)
    assert (bright.sky_texels == 8 * TEXELS.reshape(-1, 3)).all()
    assert (found.scaled(8).sky_texels == found.sky_texels).all()


def test_compensation_is_in_the_hash_and_even_skies_have_none() -> None:
    plain, other = scene(mis_compensation=False), scene()
    assert other.sky_compensated.tolist() == [True] and not plain.sky_compensated.any()
    assert scene(mis_compensation=True).sha256 == other.sha256 != plain.sha256
    floor = {"type": "sphere", "center": [0, 0, 4]}
    pictures = []
    for texels in (TEXELS, np.full_like(TEXELS, 0.3)):
        for value in (False, True):
            sky = {"type": "envmap", "bitmap": texels, "mis_compensation": value}
            out = veriray.load_dict({"type": "scene", "view": VIEW, "ball": floor, "sky": sky})
            pictures.append(veriray.render(out, 4, device="cpu", seed=1).image)
    assert (pictures[0] != pictures[1]).any() and (pictures[2] == pictures[3]).all()


def test_the_hash_is_of_texels_and_turn() -> None:
    hashes = [s.sha256 for s in (scene(), scene(scale=2.0), scene(to_world=TURN),
              scene(bitmap=TEXELS[:, ::-1]), scene(bitmap=TEXELS.reshape(8, 5, 3)))]  # fmt: skip
    assert len(set(hashes)) == len(hashes)
    assert scene(bitmap=2 * TEXELS).sha256 == hashes[1]


def test_grey_and_encoded_images() -> None:
    grey = scene(bitmap=TEXELS[:, :, :1])
    assert (grey.sky_texels == TEXELS[:, :, :1].reshape(-1, 1)).all()
    codes = RNG.integers(0, 256, (3, 4, 3), np.uint8)
    assert (scene(bitmap=codes).sky_texels == SRGB_TO_LINEAR[codes].reshape(-1, 3)).all()


def test_files(tmp_path: Path) -> None:
    import OpenEXR

    header = {"compression": OpenEXR.ZIP_COMPRESSION, "type": OpenEXR.scanlineimage}
    with OpenEXR.File(header, {"RGB": TEXELS}) as file:
        file.write(str(tmp_path / "sky.exr"))
    codes = RNG.integers(0, 256, (4, 6, 3), np.uint8)
    Image.fromarray(codes).save(tmp_path / "sky.png")
    path = tmp_path / "a.xml"
    text = (
        '<scene version="3.0.0"><sensor type="perspective"><float name="fov" value="40"/></sensor>'
        '<emitter type="envmap"><string name="filename" value="sky.exr"/></emitter></scene>'
    )
    path.write_text(text)
    assert veriray.load_file(path).sha256 != ""
    assert (veriray.load_file(path).sky_texels == TEXELS.reshape(-1, 3)).all()
    path.write_text(text.replace("exr", "png"))
    assert (veriray.load_file(path).sky_texels == SRGB_TO_LINEAR[codes].reshape(-1, 3)).all()
    path.write_text(text.replace("sky.exr", "none.exr"))
    with pytest.raises(SceneError, match=r"a\.xml:1: cannot read .*none\.exr"):
        veriray.load_file(path)


def bad(y: int, x: int, value: float) -> np.ndarray:
    texels = TEXELS.copy()
    texels[y, x, 1] = value
    return texels


@pytest.mark.parametrize(("values", "words"), [
    ({"bitmap": bad(3, 2, -0.5)}, "texel (x 2, y 3) is -0.5; radiance is not negative"),
    ({"bitmap": bad(3, 2, np.nan)}, "texel (x 2, y 3) is nan"),
    ({"bitmap": bad(0, 7, np.inf)}, "texel (x 7, y 0) is inf"),
    ({"bitmap": np.ones((2, 2, 2))}, "an image of shape (2, 2, 2)"),
    ({"bitmap": np.ones((1, 1 << 16, 3), np.uint8)}, "65536 x 1 texels"),
    ({"bitmap": 7}, "is of type integer, expected array"),
    ({"filename": "a.exr"}, "both given"),
    ({"bitmap": None}, "neither filename nor bitmap"),
    ({"scale": -1.0}, "is outside [0"),
    ({"scale": 3e38}, "exceeds the float32 range"),
    ({"to_world": np.diag([2.0, 2, 1, 1])}, "to_world scales or shears"),
    ({"to_world": np.array([[1.0, 0.5, 0, 0], [0, 1, 0, 0], [0, 0, 1, 0], [0, 0, 0, 1]])},
     "to_world scales or shears"),
])  # fmt: skip
def test_bad_images(values: dict[str, Any], words: str) -> None:
    with pytest.raises(SceneError) as found:
        scene(**values)
    assert words in str(found.value) and str(found.value).startswith("scene.sky")


def test_one_environment() -> None:
    sky, even = {"type": "envmap", "bitmap": TEXELS}, {"type": "constant"}
    for pair in ((sky, even), (even, sky), (sky, sky)):
        with pytest.raises(SceneError, match="a second emitter"):
            veriray.load_dict({"type": "scene", "view": VIEW, "a": pair[0], "b": pair[1]})
    with pytest.raises(SceneError, match="environment and sky_texels are both given"):
        dataclasses.replace(scene(), environment=np.ones(3))


@pytest.mark.parametrize(("changes", "words"), [
    ({"sky_size": np.array([8, 4])}, "sky_size = [8, 4] of 40 sky_texels"),
    ({"sky_texels": -TEXELS.reshape(-1, 3)}, "sky_texels["),
    ({"sky_to_world": 2 * np.eye(3)}, "sky_to_world"),
    ({"sky_to_world": np.full((3, 3), np.nan)}, "sky_to_world"),
])  # fmt: skip
def test_bad_arrays(changes: dict[str, Any], words: str) -> None:
    with pytest.raises(SceneError) as found:
        dataclasses.replace(scene(), **changes)
    assert words in str(found.value)


def test_a_black_image_is_no_light() -> None:
    with pytest.warns(veriray.SceneWarning, match="no light"):
        black = scene(bitmap=np.zeros((4, 8, 3)))
    assert not black.sky_texels.size
    assert not veriray.render(black, 2, device="cpu").image.any()
    dark = dataclasses.replace(black, sky_texels=np.zeros((8, 3)), sky_size=[4, 2])
    assert not veriray.render(dark, 2, device="cpu").image.any()


def test_powers_of_two_change_no_bit() -> None:
    floor = {"type": "rectangle", "to_world": np.diag([5.0, 5, 1, 1]) @ np.eye(4)}
    base = veriray.load_dict({"type": "scene", "view": VIEW, "floor": floor, "sky":
                              {"type": "envmap", "bitmap": TEXELS}})  # fmt: skip
    image = veriray.render(base, 8, device="cpu").image
    for power in (-60, -7, 20):
        scaled = veriray.render(base.with_emission_scaled(2.0**power), 8, device="cpu").image
        assert (scaled == np.ldexp(image, power)).all()
    assert (veriray.render(base.scaled(2.0**9), 8, device="cpu").image == image).all()


def test_schedulers_agree_on_every_bit(device: str) -> None:
    name = Path(__file__).resolve().parents[2] / "scenes" / "checks" / "image_sky.xml"
    found = veriray.load_file(name).with_(width=24, height=24, max_depth=8)
    films = {
        veriray.render(found, 32, device=device, scheduler=s).film_sha256
        for s in ("fused", "thrust", "wavefront")
    }
    assert len(films) == 1


def room(sky: dict[str, Any], window: float = 0.8, **more: Any) -> veriray.Scene:
    """A room with a window in the wall x = 2, seen from within."""
    white = {"type": "diffuse", "reflectance": 0.6}

    def wall(centre: Any, u: Any, v: Any) -> dict[str, Any]:
        place = np.eye(4)
        place[:3] = np.stack([u, v, np.cross(u, v), centre], axis=1)
        return {"type": "rectangle", "to_world": place, "bsdf": white}

    rest = (2 + window) / 2
    walls = (
        wall((0, -2, 0), (0, 0, 2), (2, 0, 0)), wall((0, 2, 0), (2, 0, 0), (0, 0, 2)),
        wall((0, 0, -2), (2, 0, 0), (0, 2, 0)), wall((0, 0, 2), (0, 2, 0), (2, 0, 0)),
        wall((-2, 0, 0), (0, 2, 0), (0, 0, 2)),
        wall((2, rest, 0), (0, 0, 2), (0, 2 - rest, 0)),
        wall((2, -rest, 0), (0, 0, 2), (0, 2 - rest, 0)),
        wall((2, 0, rest), (0, 0, 2 - rest), (0, window, 0)),
        wall((2, 0, -rest), (0, 0, 2 - rest), (0, window, 0)),
    )  # fmt: skip
    parts = {f"wall_{k}": w for k, w in enumerate(walls)}
    return veriray.load_dict({"type": "scene", "view": VIEW, **parts, "sky": sky, **more})


EVEN = {"type": "constant", "radiance": 1.0}
NOISE = {"type": "envmap", "bitmap": RNG.uniform(0, 2, (17, 32, 3)).astype(np.float32)}


def is_guided(found: veriray.Scene) -> bool:
    return "guided_sky" in veriray.render(found, 1, device="cpu").stats["features"]


@pytest.mark.parametrize("sky", [EVEN, NOISE], ids=["even", "image"])
def test_rooms_are_guided_and_what_is_open_or_closed_is_not(sky: dict[str, Any]) -> None:
    assert is_guided(room(sky))
    far = {"type": "rectangle", "to_world": np.diag([1e4, 1e4, 1.0, 1.0])}
    assert is_guided(room(sky, ground=far)), "a ground that is apart does not count"
    assert not is_guided(room(sky, window=0.001)), "nothing leads into it"
    ball = {"type": "sphere", "center": [0, 0, 4], "bsdf": {"type": "diffuse"}}
    floor = {"type": "rectangle", "to_world": np.diag([5.0, 5, 1, 1])}
    base = {"type": "scene", "view": VIEW, "ball": ball, "floor": floor, "sky": sky}
    assert not is_guided(veriray.load_dict(base))


def test_images_of_few_texels_are_not_guided() -> None:
    assert not is_guided(room({"type": "envmap", "bitmap": TEXELS}))
    assert not is_guided(room({"type": "constant", "radiance": 0.0}))


@pytest.mark.parametrize("sky", [EVEN, NOISE], ids=["even", "image"])
def test_guided_light_depends_on_the_scene_alone(device: str, sky: dict[str, Any]) -> None:
    """Whatever was rendered before; by every scheduler; scaled by powers of two."""
    base, other = room(sky), room(sky, window=0.5)

    def film(found: veriray.Scene, **settings: Any) -> str:
        return veriray.render(found, 16, device=device, seed=3, **settings).film_sha256

    wanted = film(base)
    moved = base.with_(camera=dataclasses.replace(base.camera, fov=60.0))
    of_moved = film(moved)
    assert film(other) != wanted == film(base) and film(moved) == of_moved != wanted
    for scheduler in ("thrust", "wavefront"):
        assert film(base, scheduler=scheduler) == wanted
    image = veriray.render(base, 16, device=device, seed=3).image
    bright = veriray.render(base.with_emission_scaled(2.0**-9), 16, device=device, seed=3)
    assert (bright.image == np.ldexp(image, -9)).all()
    large = veriray.render(base.scaled(2.0**9), 16, device=device, seed=3)
    assert (large.image == image).all()


def test_a_small_window_is_found_with_less_noise() -> None:
    """A fifth of the squared errors of samples from all around; an image of 8 texels has those."""
    even = {"type": "envmap", "bitmap": np.ones((8, 4, 3), np.float32)}
    errors = []
    for sky in (EVEN, even):
        r = veriray.render(room(sky), 256, device="cpu", max_depth=2)
        errors.append(float((r.stderr.astype(np.float64) ** 2).mean()))
    assert errors[0] < errors[1] / 5
