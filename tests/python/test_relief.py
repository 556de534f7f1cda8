"""Slopes that depend on the direction, normal maps, bump maps: what is exact about them."""

from __future__ import annotations

import math
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt
import pytest

import veriray
from veriray.columns import MATERIAL_KINDS

Array = npt.NDArray[Any]
AHEAD = np.array([[-1.0, 0, 0, 0], [0, 1, 0, 0], [0, 0, -1, 4], [0, 0, 0, 1]])
PLAIN = {"use_shadowing_function": False, "flip_invalid_normals": False}


def scene(shape: dict[str, Any], bsdf: dict[str, Any], **light: Any) -> veriray.Scene:
    """A shape at the origin, seen from z = 4."""
    film = {"type": "hdrfilm", "width": 24, "height": 24, "filter": {"type": "box"}}
    sensor = {"type": "perspective", "fov": 35.0, "to_world": AHEAD, "film": film}
    lights = {
        "sky": {"type": "constant", "radiance": 0.5},
        "lamp": {"type": "point", "position": [1.0, 2.0, 3.0], "intensity": 5.0},
    }
    return veriray.load_dict(
        {"type": "scene", "sensor": sensor, **(light or lights), "shape": {**shape, "bsdf": bsdf}}
    )  # fmt: skip


def picture(made: veriray.Scene, spp: int = 4) -> Array:
    return np.asarray(veriray.render(made, spp, seed=7, device="cpu").image)


def normalmap(bsdf: dict[str, Any], *normal: float, **more: Any) -> dict[str, Any]:
    """An even map of a normal."""
    data = np.full((2, 2, 3), (np.array(normal) + 1) / 2, np.float32)
    texture = {"type": "bitmap", "data": data, "raw": True}
    return {"type": "normalmap", "normalmap": texture, "bsdf": bsdf, **more}


def bumpmap(bsdf: dict[str, Any], heights: Array, **more: Any) -> dict[str, Any]:
    image: dict[str, Any] = {"type": "bitmap", "data": heights[:, :, None].astype(np.float32)}
    return {"type": "bumpmap", "any": {**image, "raw": True, "wrap_mode": "clamp"}, "bsdf": bsdf,
            **more}  # fmt: skip


def ball() -> dict[str, Any]:
    """A mesh with normals and texture coordinates."""
    v, u = (a.ravel() for a in np.meshgrid(np.linspace(0.1, 3, 9), np.linspace(0, 6.28, 17)))
    points = np.stack([np.sin(v) * np.cos(u), np.sin(v) * np.sin(u), np.cos(v)], axis=-1)
    i = np.arange(len(u)).reshape(17, 9)
    a, b, c, d = i[:-1, :-1], i[:-1, 1:], i[1:, 1:], i[1:, :-1]
    faces = np.stack([a, b, c, a, c, d], axis=-1).reshape(-1, 3)
    return {"type": "mesh", "vertices": points, "faces": faces, "normals": points,
            "uv": np.stack([u, v], axis=-1)}  # fmt: skip


BRUSHED = {"type": "roughconductor", "alpha_u": 0.4, "alpha_v": 0.1, "distribution": "ggx"}
SHAPES = {"sphere": {"type": "sphere"}, "rectangle": {"type": "rectangle"}, "mesh": ball(),
          "disk": {"type": "disk"}, "cube": {"type": "cube"},
          "cylinder": {"type": "cylinder", "p0": [-1, 0, 0], "p1": [1, 0.2, 0]}}  # fmt: skip
BSDFS = {"diffuse": {"type": "diffuse"}, "brushed": BRUSHED, "glass": {"type": "dielectric"},
         "mirror": {"type": "conductor"}, "rough glass": {"type": "roughdielectric"},
         "pane": {"type": "thindielectric"},
         "masked": {"type": "mask", "opacity": 0.5, "bsdf": {"type": "plastic"}},
         "both sides": {"type": "twosided", "bsdf": {"type": "plastic"}}}  # fmt: skip


@pytest.mark.parametrize("shape", SHAPES)
@pytest.mark.parametrize("bsdf", BSDFS)
def test_the_map_of_the_surface_itself_changes_no_bit(shape: str, bsdf: str) -> None:
    plain, mapped = (
        picture(scene(SHAPES[shape], one)) for one in (BSDFS[bsdf], normalmap(BSDFS[bsdf], 0, 0, 1))
    )
    assert (plain == mapped).all() and plain.any()
    flat = bumpmap(BSDFS[bsdf], np.full((3, 3), 0.25))
    even = picture(scene(SHAPES[shape], flat))
    assert (np.abs(even - plain) <= 1e-3 * plain).mean() > 0.9


def lit(bsdf: dict[str, Any], direction: list[float], **shape: Any) -> Array:
    """The middle of a rectangle in parallel light of irradiance pi."""
    sun = {"type": "directional", "direction": [-x for x in direction], "irradiance": math.pi}
    made = scene({"type": "rectangle", **shape}, bsdf, sun=sun)
    found: Array = picture(made, 1)[12, 12]
    return found


@pytest.mark.parametrize("turn", [0.0, 40.0])
@pytest.mark.parametrize("slope", [(0.25, 0.0), (0.0, -0.5), (0.3, 0.2)])
def test_heights_that_rise_evenly_are_a_tilted_plane(
    turn: float, slope: tuple[float, float]
) -> None:
    """White under parallel light: the cosine to the plane z = a x + b y, in the frame of u and v.

    With shadows: times 2 / (1 + sqrt(1 + min(tan^2 n / 8, 1) tan^2 l)).
    """
    white = {"type": "diffuse", "reflectance": 1.0}
    u = (np.arange(8) + 0.5) / 8  # of texels; x = 2 u - 1
    heights = 0.5 + 2 * (slope[0] * (u[None, :] - 0.5) + slope[1] * (u[:, None] - 0.5))
    light = np.array([0.3, 0.4, 0.8])
    light /= np.linalg.norm(light)
    c, s = math.cos(math.radians(turn)), math.sin(math.radians(turn))
    place = np.array([[c, -s, 0, 0], [s, c, 0, 0], [0, 0, 1, 0], [0, 0, 0, 1]])
    normal = np.array([-slope[0], -slope[1], 1]) / math.sqrt(1 + slope[0] ** 2 + slope[1] ** 2)
    cosine = float(place[:3, :3] @ normal @ light)
    tan2_n, tan2_l = (1 / x[2] ** 2 - 1 for x in (normal, light))
    shadow = 2 / (1 + math.sqrt(1 + min(tan2_n / 8, 1) * tan2_l))
    for more, told in ((PLAIN, cosine), ({}, cosine * shadow)):
        found = lit(bumpmap(white, heights, **more), light.tolist(), to_world=place)
        assert np.abs(found / told - 1).max() < 2e-6
        found = lit(normalmap(white, *normal, **more), light.tolist(), to_world=place)
        assert np.abs(found / told - 1).max() < 2e-6
    half = lit(bumpmap(white, heights / 2, scale=2.0, **PLAIN), light.tolist(), to_world=place)
    assert np.abs(half / cosine - 1).max() < 2e-6
    nearest = bumpmap(white, heights, **PLAIN)
    nearest["any"]["filter_type"] = "nearest"
    assert np.abs(lit(nearest, light.tolist()) / light[2] - 1).max() < 2e-6


def test_normals_that_look_away() -> None:
    """From in front: black unless it flips; light from where the two normals disagree is lost."""
    white = {"type": "diffuse", "reflectance": 1.0}
    steep = np.array([0.9, 0.0, -0.3])
    steep /= np.linalg.norm(steep)
    quiet = {"use_shadowing_function": False}
    assert not lit(normalmap(white, *steep, **PLAIN), [0.0, 0.0, 1.0]).any()
    tilted = np.array([0.8, 0.0, 0.6])
    assert not lit(normalmap(white, *tilted, **quiet), [-0.9, 0.0, 0.4]).any()
    assert not lit(normalmap(white, *tilted, **quiet), [0.6, 0.0, -0.1]).any()
    side = np.array([[0, 0, -1.0, 0], [0, 1, 0, 0], [1, 0, 0.2, 0], [0, 0, 0, 1]])
    side[:3, :3] = [[0.2, 0, -0.98], [0, 1, 0], [0.98, 0, 0.2]]  # seen from 78 degrees
    side[:3, :3] /= np.linalg.norm(side[:3, :3], axis=0)
    own = side[:3, 2]  # the normal; x of the map points towards the viewer
    away = -tilted[0] * side[:3, 0] + tilted[2] * own
    back = tilted[0] * side[:3, 0] + tilted[2] * own
    assert away[2] < 0 < back[2]
    told = float(own @ back)
    found = lit(normalmap(white, -0.8, 0, 0.6, **quiet), own.tolist(), to_world=side)
    assert np.abs(found / told - 1).max() < 2e-6
    found = lit(normalmap(white, -0.8, 0, 0.6, **PLAIN), own.tolist(), to_world=side)
    assert not found.any()


def test_from_behind() -> None:
    """Within twosided the mirror image, around it the same normals."""
    white = {"type": "diffuse", "reflectance": 1.0}
    light = [0.6, 0.0, 0.8]
    behind = np.diag([1.0, -1, -1, 1])  # turned about x
    both = {"type": "twosided", "bsdf": normalmap(white, 0.6, 0, 0.8, **PLAIN)}
    outer = normalmap({"type": "twosided", "bsdf": white}, 0.6, 0, 0.8, **PLAIN)
    for bsdf, place, told in (
        (both, np.eye(4), 1.0), (outer, np.eye(4), 1.0), (both, behind, 1.0), (outer, behind, 0.28)
    ):  # fmt: skip
        assert np.abs(lit(bsdf, light, to_world=place) - told).max() < 2e-6


def test_one_colour_is_an_even_map(tmp_path: Path) -> None:
    """As Mitsuba reads it; as a colour, and as the spectrum that holds one."""
    white = {"type": "diffuse", "reflectance": 1.0}
    own = normalmap(white, 0.6, 0, 0.8, **PLAIN)
    own["normalmap"] = {"type": "rgb", "value": [0.8, 0.5, 0.9]}
    assert np.abs(lit(own, [0.6, 0.0, 0.8]) - 1.0).max() < 2e-6
    flat = {**own, "normalmap": {"type": "rgb", "value": [0.5, 0.5, 1.0]}}
    for light, cosine in (([0.6, 0.0, 0.8], 0.8), ([0.0, 0.6, 0.8], 0.8), ([0.0, 0.0, 1.0], 1.0)):
        assert np.abs(lit(flat, light) - cosine).max() < 2e-6
    file = tmp_path / "scene.xml"
    for inside in (
        '<rgb name="normalmap" value="0.8 0.5 0.9"/>',
        '<spectrum name="normalmap" type="srgb"><rgb name="color" value="0.8 0.5 0.9"/></spectrum>',
    ):
        file.write_text(
            '<scene version="3.0.0"><emitter type="constant"/><shape type="sphere"><bsdf '
            f'type="normalmap" id="n">{inside}<bsdf type="diffuse"/></bsdf></shape></scene>'
        )
        made = veriray.load_file(file)
        board = made.relief_texture[0]
        assert made.texture_color0[board].tolist() == made.texture_color1[board].tolist()
        assert np.abs(made.texture_color0[board] - [0.8, 0.5, 0.9]).max() < 1e-7
        assert not made.relief_heights[0]
    bitmap = '<texture type="bitmap" name="normalmap"><string name="filename" value="x"/></texture>'
    file.write_text(file.read_text().replace("<spectrum", f"{bitmap}<spectrum", 1))
    with pytest.raises(veriray.SceneError, match="1 textures besides a colour, expected 1"):
        veriray.load_file(file)
    with pytest.raises(veriray.SceneError, match=r"\(0.5, 0.5, 1.5\) is outside \[0, 1\]"):
        scene(SHAPES["disk"], {**own, "normalmap": {"type": "rgb", "value": [0.5, 0.5, 1.5]}})


def test_what_files_say() -> None:
    made = scene(SHAPES["sphere"], {"type": "twosided", "bsdf": bumpmap(BRUSHED, np.eye(3))})
    kind = MATERIAL_KINDS[made.material_kind[0]]
    assert kind == "roughconductor" and made.alpha_u[0] != made.alpha_v[0] and made.two_sided[0]
    assert made.relief_texture[0] == 0 and made.relief_heights[0] and made.relief_mirrored[0]
    other = scene(SHAPES["sphere"], bumpmap(BRUSHED, np.eye(3), scale=0.5, **PLAIN))
    assert not (other.relief_mirrored[0] or other.relief_flips[0] or other.relief_shades[0])
    assert other.relief_scale[0] == 0.5
    grey = {"type": "bitmap", "data": np.ones((2, 2, 1), np.float32)}
    with pytest.raises(veriray.SceneError, match="a grey image holds no normals"):
        scene(SHAPES["disk"], {"type": "normalmap", "normalmap": grey, "bsdf": BRUSHED})
    glass = bumpmap({"type": "dielectric"}, np.eye(3))
    with pytest.raises(veriray.SceneError, match="lets light through"):
        scene(SHAPES["disk"], {"type": "twosided", "bsdf": glass})


def test_meshes_without_coordinates_brush_along_an_edge() -> None:
    """As Mitsuba: from the first corner to the second of each triangle."""
    corners = {"vertices": [[-1, -1, 0], [1, -1, 0], [1, 1, 0], [-1, 1, 0.0]]}
    one = {"type": "mesh", **corners, "faces": [[0, 1, 2], [0, 2, 3]]}
    other = {"type": "mesh", **corners, "faces": [[1, 2, 0], [2, 3, 0]]}
    pictures = [picture(scene(shape, BRUSHED), 256) for shape in (one, other)]
    even = picture(scene(one, {**BRUSHED, "alpha_u": 0.1, "alpha_v": 0.4}), 256)
    # the first triangle is below, its edge along x, then along y
    turned = np.abs(pictures[1] - even)[14:20, 16:20].mean()
    assert turned < 0.5 * np.abs(pictures[1] - pictures[0])[14:20, 16:20].mean()
