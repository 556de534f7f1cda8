"""Materials that only polarisation sets apart: as in Mitsuba's variants without polarisation."""

from __future__ import annotations

import warnings
from typing import Any

import numpy as np
import pytest

import veriray as vr
from veriray.errors import SceneWarning

LIGHT = np.array([0.5, 0.3, -1.0])
BASE = [0.2, 0.5, 0.9]
FILTER = [0.4, 0.8, 1.0]


def rgb(values: list[float]) -> dict[str, Any]:
    return {"type": "rgb", "value": values}


def floor(bsdf: dict[str, Any], degrees: float, **others: Any) -> dict[str, Any]:
    """A floor under parallel light, seen at an angle from its normal through a narrow camera."""
    angle = np.radians(degrees)
    away = 5 * np.array([np.sin(angle), 0, np.cos(angle)])
    side = np.array([-np.cos(angle), 0, np.sin(angle)])
    ahead = -away / 5
    to_world = np.eye(4)
    to_world[:3] = np.stack([np.cross(side, ahead), side, ahead, away], axis=1)
    film = {"type": "hdrfilm", "width": 2, "height": 2, "rfilter": {"type": "box"}}
    sampler = {"type": "independent", "sample_count": 4}
    sun = {"type": "directional", "direction": LIGHT.tolist()}
    wide = np.diag([50.0, 50.0, 50.0, 1.0])
    return {
        "type": "scene",
        "integrator": {"type": "volpath"},
        "sensor": {
            "type": "perspective", "fov": 0.001, "to_world": to_world, "film": film,
            "sampler": sampler,
        },
        "floor": {"type": "rectangle", "to_world": wide, "bsdf": bsdf},
        "sun": sun,
        **others,
    }  # fmt: skip


def seen(scene: dict[str, Any], spp: int = 4) -> np.ndarray[Any, Any]:
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", SceneWarning)
        loaded = vr.load_dict(scene)
    return vr.render(loaded, spp=spp, device="cpu").image.mean(axis=(0, 1))


def fresnel(cosine: float, eta: float) -> float:
    """The reflectance of a smooth interface, by angles of refraction."""
    inside = np.arcsin(np.sqrt(1 - cosine**2) / eta)
    angle = np.arccos(cosine)
    across = np.sin(angle - inside) / np.sin(angle + inside)
    along = np.tan(angle - inside) / np.tan(angle + inside)
    return float(across**2 + along**2) / 2


@pytest.mark.parametrize("degrees", [10, 40, 75])
@pytest.mark.parametrize("eta", [1.33, 1.9])
def test_the_base_of_a_polarised_plastic(degrees: float, eta: float) -> None:
    """Light goes in and out once: (1 - F)(1 - F) / pi, without reflections within."""
    bsdf = {"type": "pplastic", "diffuse_reflectance": rgb(BASE), "specular_reflectance": 0.0}
    found = seen(floor({**bsdf, "int_ior": eta, "ext_ior": 1.0}, degrees))
    lit, out = -LIGHT[2] / np.linalg.norm(LIGHT), np.cos(np.radians(degrees))
    share = (1 - fresnel(lit, eta)) * (1 - fresnel(out, eta)) * lit / np.pi
    np.testing.assert_allclose(found, share * np.array(BASE), rtol=2e-5)


def test_the_mirrors_of_a_polarised_plastic() -> None:
    bsdf = {"alpha": 0.3, "diffuse_reflectance": 0.0, "distribution": "ggx"}
    one, other = (floor({"type": name, **bsdf}, 40) for name in ("pplastic", "roughplastic"))
    assert (seen(one) == seen(other)).all()
    assert "polarisation is not rendered" in vr.load_dict(one).notes[0]


@pytest.mark.parametrize("degrees", [10, 40, 75])
@pytest.mark.parametrize("alpha", [0.05, 0.3])
def test_a_polarised_plastic_is_the_sum_of_both(degrees: float, alpha: float) -> None:
    """Light enters its base as through a smooth coat, whatever its mirrors; from a texture, too."""
    bsdf = {"type": "pplastic", "alpha": alpha, "diffuse_reflectance": rgb(BASE)}
    base = seen(floor({**bsdf, "specular_reflectance": 0.0}, degrees))
    mirrors = seen(floor({**bsdf, "diffuse_reflectance": 0.0}, degrees))
    np.testing.assert_allclose(seen(floor(bsdf, degrees)), base + mirrors, rtol=1e-3)
    texels = np.full((2, 2, 3), BASE, np.float32)
    even = {"type": "bitmap", "data": texels, "raw": True}
    textured = seen(floor({**bsdf, "diffuse_reflectance": even}, degrees))
    np.testing.assert_allclose(textured, base + mirrors, rtol=1e-3)
    scene = floor({"type": "twosided", "bsdf": bsdf}, degrees)
    assert vr.load_dict(scene, strict=False).two_sided.tolist() == [True]


@pytest.mark.parametrize(
    ("name", "share"), [("polarizer", 0.5), ("circular", 0.5), ("retarder", 1.0)]
)
def test_filters_let_light_through(name: str, share: float) -> None:
    """Once on the way to the floor, once on the way to the eye; no reflection, no refraction."""
    pane = {"type": "rectangle", "bsdf": {"type": name, "transmittance": rgb(FILTER)}}
    place = np.diag([50.0, 50.0, 50.0, 1.0])
    place[2, 3] = 1.0
    scene = floor({"type": "diffuse"}, 75, pane={**pane, "to_world": place})
    clear = seen(floor({"type": "diffuse"}, 75))
    each = share * np.array(FILTER)
    np.testing.assert_allclose(seen(scene), clear * each**2, rtol=1e-6)
    del scene["sun"]
    sky = scene | {"sky": {"type": "constant"}, "integrator": {"type": "path", "max_depth": 2}}
    sky["floor"] = {"type": "sphere", "center": [0.0, 0.0, -99.0]}  # none: the sky alone
    np.testing.assert_allclose(seen(sky), each, rtol=1e-6)
    (note,) = vr.load_dict(sky).notes
    assert note == f"scene.pane.bsdf: {name}: polarisation is not rendered"


@pytest.mark.parametrize(
    ("bsdf", "bound"),
    [
        ({"type": "pplastic", "diffuse_reflectance": rgb(BASE), "specular_reflectance": 0.0}, 1e-4),
        ({"type": "pplastic", "diffuse_reflectance": 0.0, "alpha": 0.3}, 1e-4),
        ({"type": "pplastic", "diffuse_reflectance": rgb(BASE), "alpha": 0.1}, 1e-3),
        ({"type": "pplastic", "diffuse_reflectance": rgb(BASE), "alpha": 0.4}, 1e-3),
        (
            {
                "type": "roughconductor",
                "alpha": 0.3,
                "eta": rgb([-0.05, 4, 4]),
                "k": rgb([1, -1, 2]),
            },
            1e-4,
        ),
    ],
)
def test_mitsuba_agrees(bsdf: dict[str, Any], bound: float) -> None:
    mi = pytest.importorskip("mitsuba", reason="the peer renderer: pip install mitsuba")
    mi.set_variant("scalar_rgb")
    for degrees in (10, 40, 75):
        scene = floor(bsdf, degrees)
        found = seen(scene)
        for node in (scene["sensor"], scene["floor"]):
            node["to_world"] = mi.ScalarTransform4f(node["to_world"])
        expected = np.array(mi.render(mi.load_dict(scene), spp=4)).mean(axis=(0, 1))
        np.testing.assert_allclose(found, expected, rtol=bound)
