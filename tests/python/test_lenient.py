"""What Mitsuba takes and veriray renders as something near it, or as Mitsuba, with a warning."""

from __future__ import annotations

import warnings
from typing import Any

import numpy as np
import pytest

import veriray as vr
from veriray.errors import SceneError, SceneWarning

VIEW = {"type": "perspective", "fov": 40.0}
SKY = {"type": "constant"}
BOARD = {"type": "bitmap", "data": np.full((2, 2, 3), 0.5, np.float32), "raw": True}
GREY, COAT = {"type": "diffuse"}, {"type": "plastic"}


def load(**objects: Any) -> vr.Scene:
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", SceneWarning)
        return vr.load_dict({"type": "scene", "view": VIEW, **objects})


def ball(**values: Any) -> dict[str, Any]:
    return {"sky": SKY, "s": {"type": "sphere", **values}}


def spot(**values: Any) -> dict[str, Any]:
    return {"l": {"type": "spot", **values}, "s": {"type": "sphere"}}


BLEND = {"type": "blendbsdf", "weight": 0.25, "a": GREY, "b": COAT}
TWICE = np.diag([2.0, 2, 2, 1])
#: What a scene holds; what stands for it; a part of the warning.
CASES = {
    "uneven sphere": (
        ball(to_world=np.diag([2.0, 1, 3, 1]), center=[1.0, 2, 3]),
        ball(center=[2.0, 2, 9], radius=2.0), "as in Mitsuba it is a sphere of radius 2",
    ),
    "beam beyond the cutoff": (
        spot(cutoff_angle=20.0, beam_width=21.0), spot(cutoff_angle=20.0, beam_width=20.0),
        "beam_width = 21 is rendered as cutoff_angle = 20",
    ),
    "spot that scales": (spot(to_world=TWICE), spot(), "to_world scales by 2"),
    "sky that scales": (
        {"sky": {"type": "envmap", "bitmap": np.ones((2, 4, 3), np.float32), "to_world": TWICE}},
        {"sky": {"type": "envmap", "bitmap": np.ones((2, 4, 3), np.float32)}},
        "to_world scales by 2",
    ),
    "roughness above 1": (
        ball(b={"type": "principled", "roughness": 1.5, "clearcoat": -0.5}),
        ball(b={"type": "principled", "roughness": 1.0, "clearcoat": 0.0}),
        '"roughness" = 1.5 is rendered as 1, the nearest in range',
    ),
    "spectral film": (
        {"view": {**VIEW, "film": {"type": "specfilm", "width": 9}}, **ball()},
        {"view": {**VIEW, "film": {"type": "hdrfilm", "width": 9}}, **ball()},
        "RGB is rendered, not its bands",
    ),
    "depths": ({"i": {"type": "depth"}, **ball()}, {"i": {"type": "path"}, **ball()}, "as by path"),
    "planes alone": (
        {"i": {"type": "aov", "aovs": "a:depth"}, **ball()}, {"i": {"type": "path"}, **ball()},
        "as by path",
    ),
}  # fmt: skip
#: Other words for the same.
SAME = {
    "two sides alike": (
        {"g": {"type": "diffuse"}, **ball(b={"type": "twosided", "a": {"type": "ref", "id": "g"},
                                            "b": {"type": "ref", "id": "g"}})},
        {"g": {"type": "diffuse"}, **ball(b={"type": "twosided", "a": {"type": "ref", "id": "g"}})},
    ),
    "no far plane": (
        {"view": {**VIEW, "far_clip": float("inf")}, **ball()}, {"view": VIEW, **ball()},
    ),
    "older names": (
        ball(e={"type": "area", "radiance": {"type": "srgb_d65",
                                             "color": {"type": "rgb", "value": [1.0, 2, 3]}}}),
        ball(e={"type": "area", "radiance": {"type": "rgb", "value": [1.0, 2, 3]}}),
    ),
    "older volume": (
        ball(interior={"type": "homogeneous", "albedo": {"type": "constvolume", "color": 0.5}}),
        ball(interior={"type": "homogeneous", "albedo": 0.5}),
    ),
    "a map on a blend": (
        ball(b={"type": "normalmap", "normalmap": BOARD, "b": BLEND}),
        ball(b={"type": "blendbsdf", "weight": 0.25,
                "a": {"type": "normalmap", "normalmap": BOARD, "b": GREY},
                "b": {"type": "normalmap", "normalmap": BOARD, "b": COAT}}),
    ),
}  # fmt: skip


@pytest.mark.parametrize("name", CASES)
def test_what_is_near_stands_for_it(name: str) -> None:
    given, near, words = CASES[name]
    with pytest.warns(SceneWarning) as caught:
        found = vr.load_dict({"type": "scene", "view": VIEW, **given})
    assert any(words in str(one.message) for one in caught)
    assert found.sha256 == load(**near).sha256
    with pytest.raises(SceneError, match="an error by strict"):
        vr.load_dict({"type": "scene", "view": VIEW, **given}, strict=True)


@pytest.mark.parametrize("name", SAME)
def test_other_words(name: str, cpu: str) -> None:
    given, same = (load(**one) for one in SAME[name])
    if given.sha256 != same.sha256:  # rows may stand in another order
        pictures = [vr.render(one, spp=4, width=16, height=16, device=cpu).image
                    for one in (given, same)]  # fmt: skip
        np.testing.assert_array_equal(*pictures)


@pytest.mark.parametrize("seed", range(4))
def test_uneven_spheres_are_mitsubas(seed: int) -> None:
    mi = pytest.importorskip("mitsuba", reason="the peer renderer: pip install mitsuba")
    mi.set_variant("scalar_rgb")
    rng = np.random.default_rng(seed)
    matrix = np.eye(4)
    matrix[:3] = rng.normal(size=(3, 4))
    centre = rng.normal(size=3).tolist()
    level = mi.log_level()
    mi.set_log_level(mi.LogLevel.Error)
    try:
        theirs = mi.load_dict({"type": "sphere", "to_world": mi.ScalarTransform4f(matrix),
                               "center": centre, "radius": 0.5}).bbox()  # fmt: skip
    finally:
        mi.set_log_level(level)
    ((x, y, z, radius),) = load(**ball(to_world=matrix, center=centre, radius=0.5)).spheres
    low, high = np.array(theirs.min), np.array(theirs.max)
    np.testing.assert_allclose([x, y, z], (low + high) / 2, rtol=1e-4, atol=1e-4)
    assert abs(radius) == pytest.approx(abs(high[0] - low[0]) / 2, rel=1e-4)


def test_a_scale_by_a_power_of_two_scales_an_uneven_sphere() -> None:
    matrix = np.diag([2.0, 1, 3, 1]) @ [[1, 0.5, 0, 1], [0, 1, 0, 2], [0, 0, 1, 3], [0, 0, 0, 1]]
    one = load(**ball(to_world=matrix)).spheres
    big = load(**ball(to_world=np.diag([8.0, 8, 8, 1]) @ matrix)).spheres
    np.testing.assert_array_equal(big, 8 * np.asarray(one))


def test_one_map_to_a_material() -> None:
    inner = {"type": "normalmap", "normalmap": BOARD, "b": GREY}
    blend = {"type": "blendbsdf", "weight": 0.5, "a": inner, "b": COAT}
    with pytest.raises(SceneError, match="cannot hold another map"):
        load(**ball(b={"type": "bumpmap", "map": BOARD, "b": blend}))
