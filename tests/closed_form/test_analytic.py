"""Scenes with known answers (the A numbers are those of the validation plan).

Each test renders one pixel whose value is known, with next-event estimation and MIS, and compares
at a false-alarm rate of 1e-3, confirmed at 1e-4 (tests/support.py); `sees` is the relative bias
that it finds with 90 % power. The CPU's fastest code and every GPU run them: other code gives equal
bits (tests/equivalence).
"""

from __future__ import annotations

import dataclasses
import math

import numpy as np
import pytest
import trimesh
from scipy import stats

import veriray
from veriray.scene import MAX_PATH_DEPTH
from tests.support import (
    FAST,
    Part,
    agrees,
    box,
    camera,
    chi_square,
    confirm,
    furnace,
    lambert,
    ledger_adds_up,
    make,
    native,
    native_scene,
    quad,
    sidak,
    without,
)

pytestmark = pytest.mark.parametrize("device", FAST)
DOWN = camera([0.6, 0.8, 0.7], [0, 0, 0])


# ---- form factors: two derivations ----


def rectangle_above_corner(a: float, b: float) -> float:
    """From a point to a x b parallel at height 1 above its corner (A10)."""
    p, q = math.hypot(1, a), math.hypot(1, b)
    return (a / p * math.atan(b / p) + b / q * math.atan(a / q)) / (2 * math.pi)


def perpendicular_rectangle(a: float, b: float, c: float) -> float:
    """To a rectangle a wide, b high, standing on the plane at distance c, corner opposite (A11)."""
    s = math.hypot(b, c)
    return (math.atan(a / c) - c / s * math.atan(a / s)) / (2 * math.pi)


def ceiling(x0: float, x1: float, y0: float, y1: float, z: float = 1.0) -> list[list[float]]:
    return [[x0, y0, z], [x1, y0, z], [x1, y1, z], [x0, y1, z]]


def lamp(x0: float, x1: float, y0: float, y1: float, emission: float, z: float = 1.0) -> Part:
    """A rectangle at height z that shines down and reflects nothing."""
    return quad([x0, y0, z], [0, y1 - y0, 0], [x1 - x0, 0, 0], 0.0, emission)


def floor(reflectance: float = 0.5, two_sided: bool = False) -> Part:
    return quad([-5, -5, 0], [10, 0, 0], [0, 10, 0], reflectance, 0, two_sided)


def test_form_factors_agree(device: str) -> None:
    """Lambert's sum against the formulas, and both against the printed values."""
    origin, up = [0, 0, 0], [0, 0, 1]
    for a, b, value in ((1, 1, 0.138532), (2, 2, 0.207757)):
        assert abs(rectangle_above_corner(a, b) - value) < 6e-7
        assert abs(lambert(origin, up, ceiling(0, a, 0, b)) - value) < 6e-7
    wall = [[1, 0, 0], [1, 1, 0], [1, 1, 1], [1, 0, 1]]
    assert abs(perpendicular_rectangle(1, 1, 1) - 0.055734) < 6e-7
    assert abs(lambert(origin, up, wall) - 0.055734) < 6e-7
    assert abs(math.pi * lambert(origin, up, ceiling(-1, 1, -1, 1)) - 1.740840) < 6e-7


# ---- closed scenes ----


@pytest.mark.parametrize(("albedo", "emission", "exact"), [(0.5, 0.5, 1.0), (0.9, 1.0, 10.0)])
def test_a1_furnace(device: str, albedo: float, emission: float, exact: float) -> None:
    truth = emission / (1 - float(np.float32(albedo)))
    assert abs(truth / exact - 1) < 1e-6
    agrees(furnace(albedo, emission), truth, device, 800_000, sees=0.005)


@pytest.mark.parametrize("albedo", [0.343, 0.7, 0.98])
@pytest.mark.parametrize("rr_depth", [1, 2, 5])
def test_furnace_with_roulette(device: str, albedo: float, rr_depth: int) -> None:
    """A1 and L3: the radiance, and when paths die: live[d] / N = 1 below rr_depth, then albedo^d.

    Multinomial chi-square over the depths of death; sees 0.5 % in the survival probability. Light
    choice: 5 of 6 walls are not one's own, whatever the vertex: exact binomial of all shadow rays.
    """
    scene = furnace(albedo, 1.0, rr_depth=rr_depth)
    rho = float(np.float32(albedo))
    n = 1_600_000 if albedo < 0.9 else 320_000
    agrees(scene, 1 / (1 - rho), device, n, sees=0.01)

    def p_value(effort: int, seed: int) -> float:
        r = veriray.render(scene, spp=n * effort, seed=seed, device=device)
        ledger = {name: np.array(column) for name, column in r.stats["ledger"].items()}
        dead = ledger["rr_killed"]
        assert dead.sum() == n * effort and not dead[: rr_depth - 1].any()
        assert not ledger["escaped"].any() and not ledger["shadow_occluded"].any()
        d = np.arange(len(dead) + 1)
        alive = np.where(d < rr_depth, 1.0, rho**d)
        expected = np.append((alive[:-1] - alive[1:]), alive[-1]) * n * effort
        lit, vertices = int(ledger["shadow_visible"].sum()), int(ledger["live"].sum())
        return sidak(min(chi_square(np.append(dead, 0), expected),
                         stats.binomtest(lit, vertices, 5 / 6).pvalue), 2)  # fmt: skip

    confirm(p_value)


@pytest.mark.parametrize("depth", [1, 2, 3, 4, 5, 6])
def test_a2_truncated_furnace(device: str, depth: int) -> None:
    """And L3: without roulette every path lives to max_depth."""
    exact = [0.5, 0.75, 0.875, 0.9375, 0.96875, 0.984375][depth - 1]
    scene = furnace(0.5, 0.5, max_depth=depth, rr_depth=100)
    r = agrees(scene, exact, device, 400_000, sees=0.001)
    assert r.stats["live_rays"] == [400_000] * depth
    assert r.stats["ledger"]["depth_cut"] == [0] * (depth - 1) + [400_000]
    assert depth > 1 or not r.stderr.any()


def test_a1_in_three_colours_and_any_box(device: str) -> None:
    """Colours do not mix; long walls; turned, in a tree, with triangle lights."""
    albedo, emission = np.array([0.2, 0.5, 0.8]), np.array([3.0, 0.1, 0.5])
    exact = emission / (1 - albedo)
    view = camera([0.5, 0.3, 0.2], [2, 0.1, 0.7], 40)
    agrees(make([box([0, 0, 0], [3, 1, 1], True, albedo, emission)], view), exact, device, 800_000,
           sees=0.003)  # fmt: skip
    mesh = trimesh.creation.icosphere(2)
    wall = Part(mesh.vertices, mesh.faces[:, ::-1], albedo, emission)
    agrees(make([wall]), exact, device, 320_000, sees=0.004)


def test_a5_convex_object_under_a_constant_sky(device: str) -> None:
    """Radiance rho L: a cube, a flat polygon, a mesh; no path lives beyond the second segment."""
    mesh = trimesh.creation.icosphere(2)
    hexagon = [[math.cos(k), math.sin(k), 0] for k in np.arange(6) * math.pi / 3]
    for part in (
        box([-1, -1, -1], [1, 1, 1], False, 0.7),
        Part(hexagon, [[0, 1, 2], [0, 2, 3], [0, 3, 4], [0, 4, 5]], 0.7),
        Part(mesh.vertices, mesh.faces, 0.7),
    ):
        scene = make([part], camera([0.2, 0.1, 4], [0.1, 0.15, 0]), 1.0, rr_depth=100)
        r = agrees(scene, float(np.float32(0.7)), device, 1_600_000, sees=0.003)
        assert r.stats["live_rays"] == [1_600_000, 1_600_000]
        # Flat primitives are widened by 2^-20 along shared edges: no ray may meet that rim.
        assert not any(r.stats["ledger"]["shadow_occluded"])


# ---- direct light ----


@pytest.mark.parametrize("depth", [2, -1])
def test_a10_rectangle_overhead(device: str, depth: int) -> None:
    """Above its corner, and centred over the point: radiance rho F. The light reflects nothing."""
    for rect, value in (((0, 1, 0, 1), 0.138532), ((-1, 1, -1, 1), 0.554126)):
        exact = lambert([0, 0, 0], [0, 0, 1], ceiling(*rect))
        assert abs(exact - value) < 1e-6
        scene = make([floor(), lamp(*rect, 1.0)], DOWN, max_depth=depth)
        agrees(scene, 0.5 * exact, device, 1_600_000, sees=0.003)


def test_a10_triangle_overhead(device: str) -> None:
    """A light that is a triangle, and one that is a mesh of 128 in a tree."""
    corners = np.array([[-0.5, -0.7, 1.0], [0.2, 1.0, 1.0], [1.2, -0.3, 1.0]])
    exact = 0.5 * lambert([0, 0, 0], [0, 0, 1], corners)
    agrees(make([floor(), Part(corners, [[0, 1, 2]], 0, 1)], DOWN), exact, device, 1_600_000, 0.003)
    grid = np.linspace(-1, 1, 9)
    parts = [lamp(x, x + 0.25, y, y + 0.25, 1.0) for x in grid[:-1] for y in grid[:-1]]
    fine = Part(np.concatenate([p.vertices for p in parts]),
                np.concatenate([p.faces + 4 * k for k, p in enumerate(parts)]), 0, 1)  # fmt: skip
    exact = 0.5 * 4 * rectangle_above_corner(1, 1)
    agrees(make([floor(), fine, quad([4, 4, 1], [0.1, 0, 0], [0, 0.1, 0])], DOWN), exact, device,
           800_000, 0.003)  # fmt: skip


def test_a11_perpendicular_rectangle(device: str) -> None:
    wall = quad([1, 0, 0], [0, 0, 1], [0, 1, 0], 0, 1)
    view = camera([-1, -1, 2], [0, 0, 0])
    exact = 0.5 * perpendicular_rectangle(1, 1, 1)
    agrees(make([floor(), wall], view), exact, device, 3_200_000, sees=0.002)


def test_a12_two_lights_of_different_radiance(device: str) -> None:
    """One random number for choice and place would show here."""
    scene = make([floor(), lamp(0, 2, 0, 2, 3.0), lamp(-2, 0, -2, 0, 1.0)], DOWN)
    assert abs(2 * rectangle_above_corner(2, 2) - 0.415514) < 1e-6
    agrees(scene, 0.5 * 4 * rectangle_above_corner(2, 2), device, 1_600_000, sees=0.003)


FIVE = [(-2, -1, -2, -0.5, 0.2), (-0.5, 0.5, -0.5, 0.5, 1.0), (1, 2.5, 0, 1, 7.0),
        (-1.5, -1, 1, 2, 30.0), (0.7, 0.8, -1.2, -1.1, 400.0)]  # fmt: skip


@pytest.mark.parametrize("sky", [0.0, 0.8])
def test_five_lights_and_a_sky(device: str, sky: float) -> None:
    """Unequal areas and radiances; with a sky the lamps hide their share of it."""
    up = [0, 0, 1]
    form = [lambert([0, 0, 0], up, ceiling(*rect)) for *rect, _ in FIVE]
    shine = sum(f * emission for f, (*_, emission) in zip(form, FIVE, strict=True))
    exact = 0.5 * (shine + sky * (1 - sum(form)))
    scene = make([floor(), *[lamp(*rect, emission) for *rect, emission in FIVE]], DOWN, sky)
    agrees(scene, exact, device, 3_200_000, sees=0.003)


def test_a17_known_shadow(device: str) -> None:
    """A black screen at half the height hides one quadrant of the light."""
    screen = quad([0, 0, 0.5], [0.5, 0, 0], [0, 0.5, 0])
    exact = 0.5 * 3 * rectangle_above_corner(1, 1)
    view = camera([-0.6, -0.4, 0.9], [0, 0, 0])
    scene = make([floor(), lamp(-1, 1, -1, 1, 1.0), screen], view)
    r = agrees(scene, exact, device, 1_600_000, sees=0.003)
    occluded = r.stats["ledger"]["shadow_occluded"][0]
    assert stats.binomtest(occluded, 1_600_000, 0.25).pvalue > 1e-6


CORNELL = [
    ((278, 0, 279.5), (0, 1, 0), "floor", 0.044632475),
    ((100, 0, 100), (0, 1, 0), "floor", 0.030656670),
    ((278, 0, 500), (0, 1, 0), "floor", 0.033300261),
    ((0, 274.4, 279.6), (1, 0, 0), "right_wall", 0.044180738),
    ((278, 274.4, 559.2), (0, 0, -1), "back_wall", 0.043652624),
]


@pytest.mark.parametrize(("point", "normal", "shape", "value"), CORNELL)
def test_a19_cornell_box_direct(
    device: str, point: tuple[float, ...], normal: tuple[float, ...], shape: str, value: float
) -> None:
    """The measured box without its blocks: E / L of its light at five points, three colours."""
    x, z, y = (213.0, 343.0), (227.0, 332.0), 548.8
    corners = [[x[0], y, z[0]], [x[1], y, z[0]], [x[1], y, z[1]], [x[0], y, z[1]]]
    factor = lambert(point, normal, corners)
    assert abs(math.pi * factor / value - 1) < 1e-6
    empty = without(veriray.cornell_box(), lambda name: "block" in name)
    k = empty.triangle_shape.tolist().index(empty.shape_names.index(shape))
    exact = empty.reflectance[empty.triangle_material[k]] * empty.emissions[0] * factor
    view = camera([278, 200, 250], point)
    scene = dataclasses.replace(empty, camera=view, film=veriray.Film(1, 1, "box"), max_depth=2)
    agrees(scene, exact.astype(np.float64), device, 800_000, sees=0.003)


def test_a22_small_bright_light(device: str) -> None:
    """0.2 x 0.2 of radiance 10^4: any clamp shows."""
    exact = 0.5 * 1e4 * 4 * rectangle_above_corner(0.1, 0.1)
    assert abs(exact / 62.824862 - 1) < 1e-6
    scene = make([floor(), lamp(-0.1, 0.1, -0.1, 0.1, 1e4)], DOWN)
    agrees(scene, exact, device, 1_600_000, sees=0.003)


def test_a22_light_against_the_point(device: str) -> None:
    """Paths that find the light by themselves carry the estimate: a lamp 0.01 above the point."""
    view = camera([0.5, 0, 0.004], [0, 0, 0])
    scene = make([floor(), lamp(-1, 1, -1, 1, 1.0, 0.01)], view)
    exact = 0.5 * 4 * rectangle_above_corner(100, 100)
    agrees(scene, exact, device, 1_600_000, sees=0.003)


def test_a23_exactly_dark(device: str) -> None:
    """Below the horizon, behind a one-sided light, in full shadow, behind a one-sided wall: 0."""
    below = quad([1, -1, -2], [0, 2, 0], [0, 0, 1.9], 0, 5)
    turned = quad([-1, -1, 1], [2, 0, 0], [0, 2, 0], 0, 5)
    cover = quad([-4, -4, 0.5], [8, 0, 0], [0, 8, 0])
    aside = camera([1.5, 1, 0.3], [0, 0, 0])
    for parts, view in (
        ([floor(), below], DOWN),
        ([floor(), turned], aside),
        ([floor(), lamp(-1, 1, -1, 1, 5.0), cover], aside),
        ([floor(), lamp(-1, 1, -1, 1, 5.0)], camera([0.3, 0.4, -3], [0, 0, 0])),
        ([turned], camera([0, 0, 0], [0, 0, 1])),
    ):
        r = veriray.render(make(parts, view), spp=20_000, device=device)
        ledger_adds_up(r)
        assert not r.image.any() and not r.stderr.any()
        assert not any(r.stats["ledger"]["shadow_visible"])


def test_two_sided(device: str) -> None:
    """The back of a two-sided floor reflects as its front does."""
    view = camera([0.3, 0.4, -3], [0, 0, 0])
    below = quad([-1, -1, -1], [2, 0, 0], [0, 2, 0], 0, 1)
    exact = 0.5 * 4 * rectangle_above_corner(1, 1)
    view = camera([1.5, 1.2, -0.5], [0, 0, 0])
    agrees(make([floor(two_sided=True), below], view), exact, device, 800_000, sees=0.003)


def test_lossless_floor_sees_a_second_bounce(device: str) -> None:
    """Two parallel planes so wide that they close space: E / (1 - rho), with one of them lit.

    Floor albedo a, lit ceiling albedo b, emission e: ceiling e / (1 - a b), floor a times that.
    """
    a, b, size = 0.6, 0.4, 1e5
    lower = quad([-size, -size, 0], [2 * size, 0, 0], [0, 2 * size, 0], a)
    upper = quad([-size, -size, 1], [0, 2 * size, 0], [2 * size, 0, 0], b, 1.0)
    exact = float(np.float32(a)) / (1 - float(np.float32(a)) * float(np.float32(b)))
    view = camera([0, 0, 0.5], [0, 0.2, 0])
    agrees(make([lower, upper], view), exact, device, 800_000, sees=0.003, margin=1e-4)


def test_a25_pinhole_under_constant_light(device: str) -> None:
    """Every pixel of a wide film has the radiance L itself, without noise: no cos^4, no weight."""
    for name, parameter in (("box", None), ("tent", 1.3), ("gaussian", 0.5)):
        scene = make([], camera([0, 0, 0], [1, 2, 3], 120), [0.1, 1.0, 7.0], 16, 9, name, parameter)
        r = veriray.render(scene, spp=50, device=device)
        assert (r.image == np.array([0.1, 1.0, 7.0], np.float32)).all()
        assert not r.stderr.any() and r.stats["live_rays"] == [16 * 9 * 50]


# ---- long paths ----


def test_n12_albedo_of_almost_one(device: str) -> None:
    """Albedo .999999 as float32 is .99999898672; emission 1e-6; paths are cut at MAX_PATH_DEPTH.

    Exact, truncated: E (1 - rho^n) / (1 - rho), n = MAX_PATH_DEPTH. Margin 4e-4: the throughput is
    rounded n times. No stack and no cap but the stated one.
    """
    rho, e = float(np.float32(0.999999)), float(np.float32(1e-6))
    assert abs(rho - 0.99999898672) < 1e-11 and abs(e / (1 - rho) - 0.986895) < 1e-6
    r = veriray.render(furnace(0.999999, 1e-6, rr_depth=2**31 - 1), spp=16, device=device)
    ledger_adds_up(r)
    assert r.stats["live_rays"] == [16] * MAX_PATH_DEPTH and r.stats["ledger"]["depth_cut"][-1] == 16
    exact = e * (1 - rho**MAX_PATH_DEPTH) / (1 - rho)
    assert abs(r.image.mean() / exact - 1) < 4 * r.stderr.max() / exact + 4e-4


def test_native_scene_counts(device: str) -> None:
    """The scenes above are what they say: flat quads, or a tree."""
    assert native_scene(furnace(0.5, 0.5), device).primitives["quads"] == 6
    assert native(device).build_info()["backend"] in ("cpu", "cuda")
