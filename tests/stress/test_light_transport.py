"""Spheres, glass, media and passes at the edge (N1, N2, N3, N8, N11, N13, N17, N21, N22).

In every case the film is finite and the ledger adds up. Statistical tests: false-alarm rate 1e-3,
confirmed at 1e-4.
"""

from __future__ import annotations

import dataclasses
import math
from pathlib import Path

import numpy as np
import pytest

import veriray
from tests.closed_form.build import (
    BLACK,
    MIRROR,
    NULL,
    cuboid,
    diffuse,
    direction,
    flat,
    glass,
    medium,
    rgb,
    scene,
    sky,
    sphere,
    view,
)
from tests.closed_form.test_lights import cap
from tests.closed_form.test_media import chandrasekhar
from tests.support import FAST, agrees, ledger_adds_up

pytestmark = pytest.mark.parametrize("device", FAST)
CHECKS = Path(__file__).resolve().parents[2] / "scenes" / "checks"


# ---- N8: spheres of every size ----


@pytest.mark.parametrize("radius", [1e-6, 1e-3, 1.0, 1e3, 1e6])
@pytest.mark.parametrize("height", [1e-6, 1e-3, 1.0, 1e3, 1e6])
def test_n8_sphere_from_near_and_far(device: str, radius: float, height: float) -> None:
    """A diffuse ball under a sky of 1, seen from `height` radii above it: rho, sees 1 %.

    Convex: two segments a path and no blocked shadow ray, that is no hit with itself (exact).
    """
    ball = sphere([0, 0, 0], radius, diffuse(0.7))
    eye = view([0, 0, radius * (1 + height)], [0, 0, 0], min(60.0, 20 / height))
    r = agrees(scene(eye, ball, sky(1)), float(np.float32(0.7)), device, 100_000, sees=0.01)
    assert r.stats["live_rays"] == [100_000, 100_000]
    assert not any(r.stats["ledger"]["shadow_occluded"])


@pytest.mark.parametrize("radius", [1e-6, 1.0, 1e6])
@pytest.mark.parametrize("at", [0.0, 0.9, 0.99999])
def test_n8_inside_a_sphere(device: str, radius: float, at: float) -> None:
    """A1 in a sphere, from its centre, and from near its wall: nothing gets out (exact)."""
    room = {**sphere([0, 0, 0], radius, diffuse(0.5), 0.5), "flip_normals": True}
    eye = view([at * radius, 0, 0], [radius, 0.2 * radius, 0.1 * radius], 50)
    r = agrees(scene(eye, room), 1.0, device, 200_000, sees=0.02)
    assert not any(r.stats["ledger"]["escaped"]) and not any(r.stats["ledger"]["shadow_occluded"])


@pytest.mark.parametrize("radius", [1e-6, 1.0, 1e6])
@pytest.mark.parametrize("material", ["glass", "medium"])
def test_n8_glass_and_media_of_every_size(device: str, radius: float, material: str) -> None:
    """A lossless ball in a sky of 1: 1. Nothing is cut, so no path hangs on a surface."""
    if material == "glass":
        ball = sphere([0, 0, 0], radius, glass(1.5))
    else:
        fog = medium(4 / radius, 1.0, 0.5)
        ball = sphere([0, 0, 0], radius, NULL, interior=fog)
    eye = view([0, radius, 5 * radius], [0, 0, 0], 20, 4)
    r = agrees(scene(eye, ball, sky(1)), 1.0, device, 20_000, sees=0.01)
    assert not any(r.stats["ledger"]["depth_cut"])


def test_n3_pebble_by_a_mountain(device: str) -> None:
    """Radius 1e-3 on a black plain of 2,000 beside a ball of 1,000: rho times the sky's share.

    The pebble's side sees half of the sky, less the mountain's: a cone around the horizon.
    """
    pebble = sphere([0, 0, 1.001e-3], 1e-3, diffuse(0.8))
    plain = flat("rectangle", [0, 0, 0], [0, 0, 1], 1000, BLACK)
    for mountain, hidden in ((None, 0.0), ([1500.0, 0, 0], cap(0, math.asin(0.6)) / math.pi / 2)):
        more = [] if mountain is None else [sphere(mountain, 900, BLACK)]
        eye = view([0.02, 0, 1.001e-3], [1e-3, 0, 1.001e-3])
        seen = scene(eye, pebble, plain, *more, sky(1))
        agrees(seen, 0.8 * (0.5 - hidden), device, 400_000, sees=0.02, margin=2e-4)


def test_n22_lamps_that_touch_and_cut_the_floor(device: str) -> None:
    """A shining ball on the floor, near the point of contact, and one half sunk."""
    floor = flat("rectangle", [0, 0, 0], [0, 0, 1], 3, diffuse(0.5))
    for height, x in ((1.0, 1.0), (1.0, 0.05), (0.3, 2.0), (-0.5, 1.2)):
        lamp = sphere([x, 0, height], 1, BLACK, 1)
        d = math.hypot(x, height)
        exact = 0.5 * cap(math.acos(height / d), math.asin(1 / d)) / math.pi
        low = view([-0.3 * x, 0.001, 0.01 * x], [0, 0, 0], 1e-3)
        agrees(scene(low, floor, lamp), exact, device, 400_000, sees=0.02, margin=1e-4)
    inside = sphere([0, 0, 0.5], 1, BLACK, 1)  # around the point: its back is dark
    agrees(scene(view([-0.3, 0, 0.1], [0, 0, 0]), floor, inside), 0.0, device, 1000, sees=1.0)


# ---- N11: deep media ----


def test_n11_deep_and_almost_white(device: str) -> None:
    """Optical depth 1e4, albedo .9999: 1 - H(1) sqrt(1 - w), a thousand scatterings and more."""
    w = float(np.float32(0.9999))
    exact = 1 - chandrasekhar(w, [1.0])[0] * math.sqrt(1 - w)
    ground = cuboid([-1e4, -1e4, -1e4], [1e4, 1e4, 0], NULL, interior=medium(1.0, w))
    seen = scene(view([0, 0, 5], [0, 0, 0]), ground, sky(1))
    r = agrees(seen, exact, device, 40_000, sees=0.015)
    assert len(r.stats["live_rays"]) > 1000 and not any(r.stats["ledger"]["depth_cut"])


def test_n11_ink(device: str) -> None:
    """Optical depth 1e4 without scattering: a lamp behind is 0, and so is a point light; no NaN."""
    slab = cuboid([-9, -9, 0], [9, 9, 1], NULL, interior=medium(1e4, 0.0))
    below = flat("rectangle", [0, 0, -1], [0, 0, 1], 9, diffuse(0.5), 1)
    light = {"type": "point", "position": np.array([0, 0, 2.0]), "intensity": rgb(1e6)}
    for eye in (view([0, 0, 5], [0, 0, 0]), view([0, 0, 5], [0, 0, 0], 60, 4)):
        r = veriray.render(scene(eye, slab, below), spp=10_000, device=device)
        ledger_adds_up(r)
        assert not r.image.any()
    seen = scene(view([0, 3, -0.5], [0, 0, -1]), slab, flat("rectangle", [0, 0, -1], [0, 0, 1], 9,
                 diffuse(0.5)), light)  # fmt: skip
    r = veriray.render(seen, spp=10_000, device=device)
    assert not r.image.any() and r.stats["nonfinite_samples"] == 0


def test_n11_lossless_slab_adds_up(device: str) -> None:
    """Optical depth 300, albedo 1: every path leaves above, below or is cut; nothing is lost."""
    slab = cuboid([-1e3, -1e3, 0], [1e3, 1e3, 3], NULL, interior=medium(100.0, 1.0))
    seen = scene(view([0, 0, 5], [0, 0, 0]), slab, sky(1))
    r = veriray.render(seen, spp=2000, device=device)
    ledger_adds_up(r)
    ledger = r.stats["ledger"]
    assert sum(ledger["escaped"]) + sum(ledger["depth_cut"]) == 2000
    assert not any(ledger["rr_killed"]) and not any(ledger["absorbed"])
    assert abs(r.image.mean() - 1) < 1e-5 + 5 * r.stderr.max()


@pytest.mark.parametrize("g", [0.9999, -0.9999, 0.999999])
def test_n21_extreme_phase_functions(device: str, g: float) -> None:
    """Almost straight on, almost straight back: lossless still, and finite."""
    ball = sphere([0, 0, 0], 1, NULL, interior=medium(5.0, 1.0, g))
    r = agrees(scene(view([1, 2, 5], [0, 0, 0], 25, 4), ball, sky(1)), 1.0, device, 20_000, 0.01)
    assert r.stats["nonfinite_samples"] == 0


# ---- N13, N21: mirrors and glass ----


@pytest.mark.parametrize("room", ["box", "sphere"])
def test_n13_ten_thousand_bounces(device: str, room: str) -> None:
    """In a closed mirror every path lives to 10,000 segments; directions keep their length."""
    walls = (cuboid([-1, -1.1, -0.9], [1, 0.8, 1.2], MIRROR) if room == "box"
             else sphere([0, 0, 0], 1, MIRROR))  # fmt: skip
    closed = scene(view([0.1, 0.2, 0.3], [0.7, -0.4, 0.9], 80, 4),
                   {**walls, "flip_normals": True}, sky(1), max_depth=10_000)  # fmt: skip
    r = veriray.render(closed, spp=4, device=device)
    ledger_adds_up(r)
    assert r.stats["live_rays"] == [64] * 10_000 and not r.image.any()
    if device.startswith("cpu"):
        path = veriray.trace_path(closed, 2, 1, 0)
        assert len(path) == 10_000
        lengths = np.linalg.norm([v["direction"] for v in path], axis=1)
        assert np.abs(lengths - 1).max() <= 1e-5
        positions = np.array([v["position"] for v in path])
        if room == "box":
            assert (positions > [-1.00001, -1.10001, -0.90001]).all()
            assert (positions < [1.00001, 0.80001, 1.20001]).all()
        else:
            assert np.linalg.norm(positions, axis=1).max() < 1.00001


@pytest.mark.parametrize("eta", [1 + 1e-7, 1.0, 1 - 1e-6, 1 + 1e-4])
def test_n21_glass_that_is_almost_air(device: str, eta: float) -> None:
    """Continuous: a lamp seen through the ball is within 1e-3 of the lamp itself, no NaN."""
    lamp = flat("rectangle", [0, 0, -9], [0, 0, 1], 90, BLACK, [1, 2, 3])
    ball = sphere([0, 0, 0], 1, glass(eta))
    r = veriray.render(scene(view([0, 0.3, 5], [0, 0, 0], 20, 6), ball, lamp), spp=200,
                       device=device)  # fmt: skip
    ledger_adds_up(r)
    assert r.stats["nonfinite_samples"] == 0
    assert np.abs(r.image / np.float32([1, 2, 3]) - 1).max() < 1e-3


@pytest.mark.parametrize(("inside", "outside"), [(10, 0.1), (0.1, 10)])
def test_n21_extreme_index(device: str, inside: float, outside: float) -> None:
    """Index 100: R = (99 / 101)^2 at normal incidence; 1/100 the same. A furnace stays 1."""
    r = (99 / 101) ** 2
    front = flat("rectangle", [0, 0, 9], [0, 0, -1], 40, BLACK, [1, 0, 1])
    back = flat("rectangle", [0, 0, -9], [0, 0, 1], 40, BLACK, [0, 1, 1])
    slab = cuboid([-50, -50, -1], [50, 50, 0], glass(inside, outside))
    seen = scene(view([0, 0, 5], [0, 0, 0], 1e-3), slab, front, back)
    agrees(seen, [2 * r / (1 + r), (1 - r) / (1 + r), 1], device, 400_000, sees=0.01)
    ball = sphere([0, 0, 0], 1, glass(inside, outside))
    furnace = scene(view([1, 2, 5], [0, 0, 0], 25, 4), ball, sky(1))
    got = veriray.render(furnace, spp=500, device=device)
    assert abs(got.image.mean() - 1) < 1e-4 + 5 * got.stderr.max()


def test_n7_grazing_glass(device: str) -> None:
    """At 89.999 degrees a pane reflects everything but 1e-4; nothing is invalid."""
    pane = flat("rectangle", [0, 0, 0], [0, 0, 1], 100, glass(1.5, 1.0, "thindielectric"))
    up = flat("rectangle", [0, 0, 50], [0, 0, -1], 3e5, BLACK, 1)
    eye = 50 * direction(89.99)
    r = veriray.render(scene(view(eye, [0, 0, 0], 1e-4), pane, sky(1)), spp=1000, device=device)
    ledger_adds_up(r)
    assert np.abs(r.image - 1).max() < 1e-5
    r = veriray.render(scene(view(eye, [0, 0, 0], 1e-4), pane, up), spp=1000, device=device)
    assert r.image.min() > 0.99


# ---- N17: strange places ----


def test_n17_a_hundred_shells(device: str) -> None:
    """Null shells in one another: 200 passes a ray, the sky itself behind them."""
    shells = [sphere([0, 0, 0], 1 + 0.01 * k, NULL) for k in range(100)]
    r = veriray.render(scene(view([0.3, 0, 9], [0.3, 0, 0]), *shells, sky(3)), spp=100,
                       device=device)  # fmt: skip
    ledger_adds_up(r)
    assert (r.image == 3).all() and r.stats["live_rays"] == [100] * 201


def test_n17_camera_in_odd_places(device: str) -> None:
    """On a sphere, a disk, a null boundary; at a point light; at a shining ball's centre."""
    things = [
        sphere([0, 0, 1], 1, glass(1.5)),
        sphere([0, 0, 1], 1, NULL, interior=medium(1.0, 0.5)),
        flat("disk", [0, 0, 0], [0, 0, 1], 1, {"type": "twosided", "bsdf": diffuse(0.5)}),
        sphere([0, 0, 0], 1, BLACK, 5),
        {"type": "point", "position": np.zeros(3), "intensity": rgb(1)},
    ]
    for thing in things:
        for target in ([0, 0, 1], [1, 0, 0], [0.5, 0.2, -1]):
            for at in ([0, 0, 0], [0, 0, 1], [0, 0, 2]):
                if np.allclose(at, target):
                    continue
                seen = scene(view(at, target, 90, 4), thing, sky(1), max_depth=200)
                r = veriray.render(seen, spp=64, device=device)
                ledger_adds_up(r)
                assert r.stats["nonfinite_samples"] == 0 and np.isfinite(r.image).all()


# ---- N1, N2: moved and scaled ----

MOVED = ("sphere_light", "glass_mesh", "touching_media", "disk_ellipse", "point_light")


def close(a: veriray.Scene, b: veriray.Scene, device: str) -> None:
    """Only rounding differs: 2 % of the pixels at most by more than 1e-3 of their value."""
    x, y = (veriray.render(s, spp=32, device=device).image for s in (a, b))
    assert (np.abs(y - x) > 1e-3 * np.maximum(x, 1e-3)).mean() < 0.02
    assert abs(y.mean(dtype=np.float64) / x.mean(dtype=np.float64) - 1) < 2e-3


@pytest.mark.parametrize("name", MOVED)
@pytest.mark.parametrize("factor", [1e-6, 1e6])
def test_n2_scaled(device: str, name: str, factor: float) -> None:
    """Lengths times 10^-6 and 10^6: the same picture."""
    still = veriray.load_file(CHECKS / f"{name}.xml").with_(width=24, height=24)
    close(still, still.scaled(factor), device)


@pytest.mark.parametrize("name", MOVED)
def test_n1_moved_by_a_million(device: str, name: str) -> None:
    """Spheres, disks, lights and vertices are taken relative to the camera in float64."""
    still = veriray.load_file(CHECKS / f"{name}.xml").with_(width=24, height=24)
    spheres, disks = np.array(still.spheres), np.array(still.disks)
    spheres[:, :3] += 1e6
    disks[:, 0] += 1e6
    to_world = np.array(still.camera.to_world)
    to_world[:3, 3] += 1e6
    moved = dataclasses.replace(
        still, vertices=still.vertices + 1e6, spheres=spheres, disks=disks,
        light_position=still.light_position + 1e6,
        camera=dataclasses.replace(still.camera, to_world=to_world),
    )  # fmt: skip
    close(still, moved, device)
