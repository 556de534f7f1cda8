"""Materials against closed forms: furnaces, Fresnel, plastic, passes (A30 to A36, E6, N10).

Rules as in test_analytic: false-alarm rate 1e-3, confirmed at 1e-4; `sees` is the relative bias
found with 90 % power. Scalar (unpolarised) Fresnel theory throughout.
"""

from __future__ import annotations

import dataclasses
import math
from typing import Any

import numpy as np
import pytest
from scipy import stats

import veriray
from tests.closed_form.build import (
    BLACK,
    MIRROR,
    NULL,
    Dict,
    cuboid,
    diffuse,
    direction,
    external_reflectance,
    flat,
    fresnel,
    fresnel_conductor,
    glass,
    internal_reflectance,
    medium,
    rgb,
    scene,
    sky,
    sphere,
    view,
)
from tests.support import FAST, agrees, chi_square, confirm, ledger_adds_up

pytestmark = pytest.mark.parametrize("device", FAST)


# ---- furnaces ----


def plastic(base: Any, eta: float, **more: Any) -> Dict:
    return glass(eta, 1.0, "plastic", diffuse_reflectance=rgb(base), **more)


def masked(opacity: float, inner: Dict) -> Dict:
    return {"type": "mask", "opacity": opacity, "bsdf": inner}


def both(inner: Dict) -> Dict:
    return {"type": "twosided", "bsdf": inner}


LOSSLESS = {
    "diffuse": diffuse(1),
    "mirror": MIRROR,
    "glass": glass(1.5),
    "bubble": glass(1.0, 1.5),
    "thin": glass(1.7, 1.0, "thindielectric"),
    "plastic": plastic(1, 1.5),
    "plastic nonlinear": plastic(1, 1.9, nonlinear=True),
    "mask of diffuse": masked(0.4, both(diffuse(1))),
    "mask of mirror": masked(0.7, both(MIRROR)),
    "mask of plastic": masked(0.6, both(plastic(1, 1.3))),
    "null": NULL,
}


@pytest.mark.parametrize("name", LOSSLESS)
@pytest.mark.parametrize("kind", ["sphere", "cube"])
def test_white_furnace(device: str, name: str, kind: str) -> None:
    """A lossless body in a constant sky is invisible, at every pixel, silhouettes too (E2, A36)."""
    material = LOSSLESS[name]
    if kind == "sphere":
        body = sphere([0.1, 0, 0.2], 1, material)
    else:
        body = cuboid([-0.7, -0.5, -0.9], [0.8, 0.6, 0.7], material)
    furnace = scene(view([1, 2, 6], [0, 0, 0], 26, 8), body, sky([1, 0.5, 2]))
    agrees(furnace, [1, 0.5, 2], device, 30_000, sees=1e-3)


@pytest.mark.parametrize("name", ["disk", "rectangle"])
def test_white_furnace_of_open_surfaces(device: str, name: str) -> None:
    """Two-sided plates, one above another; the light between them finds its way out."""
    plates = [flat(name, [0, 0, z], [0.2, 0, 1], 1, both(material)) for z, material in
              ((0.0, plastic(1, 1.5)), (0.5, diffuse(1)), (-0.6, MIRROR))]  # fmt: skip
    furnace = scene(view([1, 4, 3], [0, 0, 0], 40, 6), *plates, sky(1))
    agrees(furnace, 1.0, device, 40_000, sees=1e-3)


def test_nested_glass_in_a_furnace(device: str) -> None:
    """N9: index 1.5 in 1.33 in 1, a bubble beside it, and glass cubes that touch nothing."""
    nest = [sphere([0, 0, 0], 1.2, glass(1.33)), sphere([-0.3, 0, 0], 0.6, glass(1.5, 1.33)),
            sphere([0.7, 0.2, 0], 0.3, glass(1, 1.33))]  # fmt: skip
    inside_out = {**sphere([-0.4, 0.1, 0.1], 0.2, glass(1.5, 1)), "flip_normals": True}
    furnace = scene(view([1, 2, 6], [0, 0, 0], 26, 8), *nest, inside_out, sky(1))
    agrees(furnace, 1.0, device, 40_000, sees=1e-3)


def test_e6_thermodynamic_equilibrium(device: str) -> None:
    """A black ball of radiance n^2 in glass of index n, in a sky of 1: 1; from within n^2.

    Nothing else sees a missing n^2.
    """
    n = 1.5
    bodies = [sphere([0, 0, 0], 1, glass(n)), sphere([0.1, 0.2, 0], 0.5, BLACK, n * n)]
    outside = scene(view([1, 2, 6], [0, 0, 0], 26, 8), *bodies, sky(1))
    agrees(outside, 1.0, device, 20_000, sees=1e-3)
    within = scene(view([-0.6, -0.3, 0.1], [0, 0, 0.2], 90, 6), *bodies, sky(1))
    agrees(within, n * n, device, 20_000, sees=1e-3)


# ---- Fresnel ----

ANGLES = (0, 30, 45, 60, 75, 85)
A30 = (0.040000, 0.041523, 0.050240, 0.089187, 0.253061, 0.612800)


def test_theory(device: str) -> None:
    """The formulas of this file against the plan's printed values (A30 to A34)."""
    for angle, value in zip(ANGLES, A30, strict=True):
        assert abs(fresnel(math.cos(math.radians(angle)), 1.5) - value) < 6e-7
    assert abs(external_reflectance(1.5) - 0.091778) < 1e-6
    assert abs(internal_reflectance(1.5) - 0.596346) < 1e-6
    x, w = np.polynomial.legendre.leggauss(400)
    critical = math.sqrt(1 - 1 / 2.25)  # all is reflected below this cosine
    c = critical + (1 - critical) * ((x + 1) / 2) ** 2
    inner = float((w * (x + 1) * fresnel(c, 1 / 1.5) * c).sum()) * (1 - critical) + critical**2
    assert abs(inner - 0.596346) < 1e-6
    fe, fi = external_reflectance(1.5), internal_reflectance(1.5)
    assert abs(fe + (1 - fe) * (1 - fi) * 0.5 / (1 - fi * 0.5) - 0.352959) < 1e-6


@pytest.mark.parametrize("angle", ANGLES)
def test_a30_fresnel_of_a_surface(device: str, angle: float) -> None:
    """First reflection alone: a black plastic, and glass filled with ink, in a sky of 1."""
    exact = float(fresnel(math.cos(math.radians(angle)), 1.5))
    eye = 5 * direction(angle)
    plate = flat("disk", [0, 0, 0], [0, 0, 1], 100, plastic(0, 1.5))
    agrees(scene(view(eye, [0, 0, 0]), plate, sky(1)), exact, device, 400_000, sees=0.05)
    ink = medium(1000.0, 0.0)
    block = cuboid([-99, -99, -99], [99, 99, 0], glass(1.5), interior=ink)
    agrees(scene(view(eye, [0, 0, 0]), block, sky(1)), exact, device, 400_000, sees=0.05)


@pytest.mark.parametrize(("eta", "k", "ext"), [(0.2, 3.9, 1.0), (2.9, 3.05, 1.0), (1.5, 0.0, 1.33)])
@pytest.mark.parametrize("angle", [0, 45, 80])
def test_conductor(device: str, eta: float, k: float, ext: float, angle: float) -> None:
    """Reflectance of a metal in a sky of 1: no noise, and equal to the complex Fresnel equations.

    Three channels: eta, its double, and a specular reflectance of 0.5.
    """
    c = math.cos(math.radians(angle))
    etas = np.array([eta, 2 * eta, eta])
    exact = [fresnel_conductor(c, complex(e, k) / ext) for e in etas] * np.array([1, 1, 0.5])
    material = {"type": "conductor", "eta": rgb(etas), "k": rgb(k), "ext_eta": ext,
                "specular_reflectance": rgb([1, 1, 0.5])}  # fmt: skip
    plate = flat("rectangle", [0, 0, 0], [0, 0, 1], 100, material)
    mirror = scene(view(5 * direction(angle), [0, 0, 0]), plate, sky(1), rr_depth=100)
    agrees(mirror, exact, device, 10_000, sees=1e-4, margin=3e-5)


SLAB = ((0, 0.923077), (30, 0.920266), (60, 0.836232))


@pytest.mark.parametrize(("angle", "through"), SLAB)
@pytest.mark.parametrize("material", ["slab", "thin"])
def test_a32_clear_slab(device: str, angle: float, through: float, material: str) -> None:
    """All inter-reflections: (1 - R) / (1 + R) of a lamp behind, the rest of one in front.

    A thin pane has the same two numbers.
    """
    r = float(fresnel(math.cos(math.radians(angle)), 1.5))
    assert abs((1 - r) / (1 + r) - through) < 1e-6
    eye = 5 * direction(angle)
    if material == "slab":
        pane = cuboid([-50, -50, -1], [50, 50, 0], glass(1.5))
    else:
        pane = flat("rectangle", [0, 0, 0], [0, 0, 1], 50, glass(1.5, 1.0, "thindielectric"))
    lamps = [flat("rectangle", [0, 0, -9], [0, 0, 1], 40, BLACK, [1, 0, 2]),
             flat("rectangle", [0, 0, 9], [0, 0, -1], 40, BLACK, [0, 1, 2])]  # fmt: skip
    exact = [(1 - r) / (1 + r), 2 * r / (1 + r), 2]
    agrees(scene(view(eye, [0, 0, 0]), pane, *lamps), exact, device, 800_000, sees=0.02)


def test_a33_absorbing_slab(device: str) -> None:
    """tau = 1 at normal incidence: T = .339111, R = .044990."""
    r, t = 0.04, math.exp(-1)
    transmitted = (1 - r) ** 2 * t / (1 - (r * t) ** 2)
    reflected = r + (1 - r) ** 2 * r * t * t / (1 - (r * t) ** 2)
    assert abs(transmitted - 0.339111) < 1e-6 and abs(reflected - 0.044990) < 1e-6
    pane = cuboid([-50, -50, -1], [50, 50, 0], glass(1.5), interior=medium(1.0, 0.0))
    lamps = [flat("rectangle", [0, 0, -9], [0, 0, 1], 40, BLACK, [1, 0, 1]),
             flat("rectangle", [0, 0, 9], [0, 0, -1], 40, BLACK, [0, 1, 1])]  # fmt: skip
    exact = [transmitted, reflected, transmitted + reflected]
    slab = scene(view([0, 0, 5], [0, 0, 0]), pane, *lamps)
    agrees(slab, exact, device, 1_600_000, sees=0.02)


def ways_through_a_ball(angle: float, n: float) -> list[tuple[Any, Any]]:
    """Points and directions at which a ray along -z leaves the unit ball that it meets at `angle`.

    Reflected outside, straight through, reflected once inside; in the plane y = 0.
    """
    c = math.cos(math.radians(angle))
    b = math.sqrt(1 - (1 - c * c) / n**2)
    p, d = direction(angle), np.array([0.0, 0, -1])
    ways = [(p, d + 2 * c * p)]
    t = d / n + (c / n - b) * p
    for _ in range(2):
        p = p + 2 * b * t
        ways.append((p, n * t + (c - n * b) * p))
        t = t - 2 * b * p
    return ways


@pytest.mark.parametrize("angle", [20, 45, 75])
def test_glass_ball(device: str, angle: float) -> None:
    """Light off a ball of n = 1.5 by its way: F, (1 - F)^2, (1 - F)^2 F.

    A lamp of its own colour waits in each of the three directions.
    """
    f = float(fresnel(math.cos(math.radians(angle)), 1.5))
    lamps = [flat("disk", p + 6 * d, -d, 0.3, BLACK, colour) for (p, d), colour in
             zip(ways_through_a_ball(angle, 1.5), np.eye(3).tolist(), strict=True)]  # fmt: skip
    x = math.sin(math.radians(angle))
    ball = sphere([0, 0, 0], 1, glass(1.5))
    seen = scene(view([x, 0, 5], [x, 0, 0]), ball, *lamps)
    agrees(seen, [f, (1 - f) ** 2, (1 - f) ** 2 * f], device, 800_000, sees=0.03)


def test_specular_colours_and_refraction(device: str) -> None:
    """specular_reflectance and specular_transmittance multiply each event."""
    f, r, t = 0.04, np.array([0.5, 1, 0.2]), np.array([1, 0.3, 0.7])
    tinted = glass(1.5, specular_reflectance=rgb(r), specular_transmittance=rgb(t))
    thin = glass(1.5, 1.0, "thindielectric", specular_reflectance=rgb(r),
                 specular_transmittance=rgb(t))  # fmt: skip
    block = cuboid([-99, -99, -1], [99, 99, 0], tinted)
    pane = flat("rectangle", [0, 0, 0], [0, 0, 1], 99, thin)
    below = flat("rectangle", [0, 0, -9], [0, 0, 1], 90, BLACK, 1)
    for body, exact in (
        (block, t**2 * (1 - f) ** 2 / (1 - (f * r) ** 2)),
        (pane, t * (1 - f) / (1 + f)),
    ):
        agrees(scene(view([0, 0, 5], [0, 0, 0]), body, below), exact, device, 400_000, sees=0.01)


def test_a35_total_internal_reflection(device: str) -> None:
    """At 60 degrees inside n = 1.5 a lamp in the glass is seen undimmed: exactly, without noise."""
    block = cuboid([-50, -50, -50], [50, 50, 0], glass(1.5))
    lamp = flat("rectangle", 10 * direction(240), -direction(240), 1, BLACK, [0.7, 1, 3])
    seen = scene(view(10 * direction(120), [0, 0, 0]), block, lamp)
    r = veriray.render(seen, spp=1000, device=device)
    assert np.abs(r.image - np.float32([0.7, 1, 3])).max() <= 1e-6 and r.stderr.max() <= 1e-6


def test_l3_clear_slab(device: str) -> None:
    """Segments alive at normal incidence: 1, 1, .96, .0384, .001536, 6.1e-5: exact multinomial."""
    pane = cuboid([-50, -50, -1], [50, 50, 0], glass(1.5))
    slab = scene(view([0, 0, 5], [0, 0, 0]), pane, sky(1), rr_depth=100)
    law = np.array([1, 1, 0.96, 0.0384, 0.001536, 6.144e-5])

    def p_value(effort: int, seed: int) -> float:
        n = 1_000_000 * effort
        r = veriray.render(slab, spp=n, seed=seed, device=device)
        ledger_adds_up(r)
        assert r.stats["live_rays"][:2] == [n, n] and np.abs(r.image - 1).max() < 1e-5
        ended = np.array(r.stats["ledger"]["escaped"])
        expected = n * (law - np.append(law[1:], 0))
        seen = np.append(ended[:5], ended[5:].sum())
        return chi_square(seen, expected)

    confirm(p_value)


def test_n10_trapped_light(device: str) -> None:
    """Directions from inside a cube of glass n = 1.5: sqrt 5 - 2 of them never leave (L3).

    Those with no component above sqrt(1 - 1/n^2). On one face of the cube of directions that is all
    beyond a circle: 1 - pi / 5 of its area, a binomial count of paths cut at max_depth; weighted by
    solid angle, pixel by pixel, the same count gives sqrt 5 - 2.
    """
    size, depth = 64, 200
    block = cuboid([-1, -1, -1], [1, 1, 1], glass(1.5))
    eye = [0.11, -0.23, 0.07]
    cube = scene(view(eye, [eye[0], eye[1], 1], 90, size), block, sky(1), max_depth=depth)
    r = veriray.render(cube, spp=64, device=device, rr_depth=10**6)
    ledger_adds_up(r)
    n, cut = size * size * 64, r.stats["ledger"]["depth_cut"][-1]
    assert sum(r.stats["ledger"]["depth_cut"]) == cut
    assert stats.binomtest(cut, n, 1 - math.pi / 5).pvalue > 1e-6
    assert abs(cut / n - (1 - math.pi / 5)) < 0.005
    x = (np.arange(size) + 0.5) / size * 2 - 1
    solid = (1 + x[:, None] ** 2 + x**2) ** -1.5
    kept = 1 - r.image[:, :, 0].astype(np.float64) / 2.25
    assert abs((solid * kept).sum() / solid.sum() - (math.sqrt(5) - 2)) < 0.004


# ---- plastic ----


@pytest.mark.parametrize("nonlinear", [False, True])
@pytest.mark.parametrize("angle", [0, 60, 80])
def test_a34_plastic_in_a_sky(device: str, nonlinear: bool, angle: float) -> None:
    """F + (1 - F) (1 - Fi) rho / (1 - Fi rho); linear: F + (1 - F) rho. Fi by quadrature."""
    eta, rho = 1.5, np.array([0.1, 0.5, 0.9])
    f, fi = float(fresnel(math.cos(math.radians(angle)), eta)), internal_reflectance(eta)
    base = (1 - fi) * rho / (1 - fi * rho) if nonlinear else rho
    exact = 0.8 * f + (1 - f) * base
    coat = plastic(rho, eta, nonlinear=nonlinear, specular_reflectance=rgb(0.8))
    plate = flat("rectangle", [0, 0, 0], [0, 0, 1], 100, coat)
    eye = 5 * direction(angle)
    agrees(scene(view(eye, [0, 0, 0]), plate, sky(1)), exact, device, 800_000, sees=0.01)


@pytest.mark.parametrize("eta", [1.3, 1.9])
def test_roulette_between_lobes_is_splitting(device: str, eta: float) -> None:
    """Radiance of a plastic floor under a lamp whose mirror image is a second lamp.

    Splitting, by quadrature: F(o) L_mirror + sum over the lamp of (1 - F(i)) (1 - F(o)) f cos.
    """
    rho, angle = np.array([0.2, 0.5, 0.8]), 50.0
    fi, f = internal_reflectance(eta), float(fresnel(math.cos(math.radians(angle)), eta))
    x, w = np.polynomial.legendre.leggauss(64)
    u, v = np.meshgrid(x, x + 0.3)  # lamp: [-1, 1] x [-.7, 1.3] at height 1.5
    distance2 = u**2 + v**2 + 1.5**2
    cosine = 1.5 / np.sqrt(distance2)
    weight = np.outer(w, w) * cosine**2 / distance2 * (1 - fresnel(cosine, eta))
    base = rho / (1 - fi * rho) * (1 - f) / eta**2 / math.pi
    mirrored = 5 * direction(-angle)
    exact = f * 2.0 + base * weight.sum()
    parts = [
        flat("rectangle", [0, 0, 0], [0, 0, 1], 20, plastic(rho, eta, nonlinear=True)),
        flat("rectangle", [0, 0.3, 1.5], [0, 0, -1], 1, BLACK, 1),
        flat("disk", mirrored, -mirrored, 0.05, BLACK, 2),
    ]
    # The small lamp lights the floor too, by pi .05^2 / 25 of its radiance.
    small = 2 * math.pi * 0.05**2 / 25 * math.cos(math.radians(angle))
    exact = exact + base * small * (1 - f)
    floor = scene(view(5 * direction(angle), [0, 0, 0]), *parts)
    agrees(floor, exact, device, 1_600_000, sees=0.02, margin=1e-4)


# ---- passes ----


def test_masks_and_panes_in_front_of_a_lamp(device: str) -> None:
    """A lamp behind black masks of opacity .3 and .5, null surfaces and both sides of a mask."""
    lamp = flat("rectangle", [0, 0, -5], [0, 0, 1], 5, BLACK, [1, 2, 3])
    panes = [flat("rectangle", [0, 0, 1], [0, 0, 1], 2, masked(0.3, BLACK)),
             flat("disk", [0, 0, 0], [0, 0, -1], 2, masked(0.5, BLACK)),
             sphere([0, 0, -2], 1, NULL), cuboid([-1, -1, -4.5], [1, 1, -3.5], NULL)]  # fmt: skip
    seen = scene(view([0.2, 0.1, 5], [0, 0, 0]), lamp, *panes, max_depth=1)
    agrees(seen, np.array([1, 2, 3]) * 0.7 * 0.5, device, 800_000, sees=0.01)


@pytest.mark.parametrize("material", ["mask", "null", "thindielectric"])
def test_shadow_rays_pass(device: str, material: str) -> None:
    """A point light over a floor, a pane between: straight through, and no noise."""
    thin = glass(1.5, 1.0, "thindielectric", specular_transmittance=rgb([1, 0.5, 0.2]))
    pane = {"mask": masked(0.3, BLACK), "null": NULL, "thindielectric": thin}[material]
    position = 3 * direction(40)
    c = math.cos(math.radians(40))
    f = float(fresnel(c, 1.5))
    through = {"mask": 0.7, "null": 1.0,
               "thindielectric": (1 - f) / (1 + f) * np.array([1, 0.5, 0.2])}[material]  # fmt: skip
    exact = 0.5 / math.pi * 4 * c / 9 * np.ones(3) * through
    objects = [
        flat("rectangle", [0, 0, 0], [0, 0, 1], 9, diffuse(0.5)),
        flat("rectangle", [1, 0, 1.5], [0, 0, 1], 1.5, pane),
        {"type": "point", "position": position, "intensity": rgb(4)},
    ]
    seen = scene(view([-3, 0, 1], [0, 0, 0]), *objects, max_depth=2)
    r = agrees(seen, exact, device, 10_000, sees=1e-4)
    assert r.stats["ledger"]["shadow_visible"][0] == 10_000
    assert not any(r.stats["ledger"]["shadow_occluded"])


def test_passes_do_not_count_as_bounces(device: str) -> None:
    """Ten null shells around a floor and its lamp: the picture at max_depth 2 stays the same."""
    floor = flat("rectangle", [0, 0, 0], [0, 0, 1], 9, diffuse(0.5))
    lamp = flat("rectangle", [0, 0, 2], [0, 0, -1], 0.5, BLACK, 3)
    shells = [sphere([0, 0, 0], 0.1 + 0.15 * k, NULL) for k in range(10)]
    eye = view([-3, 0.3, 1], [0, 0, 0])
    bare = veriray.render(scene(eye, floor, lamp), spp=1_600_000, max_depth=2, device=device)
    exact = bare.image[0, 0].astype(np.float64)
    error = float(bare.stderr.max() / exact.min())
    for depth in (2, -1):
        seen = scene(eye, floor, lamp, *shells, max_depth=depth)
        agrees(seen, exact, device, 400_000, sees=0.02, margin=5 * error)


# ---- shading normals ----


def tilted(degrees: float, material: Dict) -> tuple[veriray.Scene, float]:
    """A plate z = 0 whose vertex normals lean towards +x, in a sky of 1, seen from above."""
    plate = flat("rectangle", [0, 0, 0], [0, 0, 1], 9, material)
    flat_scene = scene(view([-1, 0, 3], [0, 0, 0]), plate, sky(1))
    normals = np.broadcast_to(direction(degrees), flat_scene.vertices.shape)
    return dataclasses.replace(flat_scene, normals=normals), math.radians(degrees)


@pytest.mark.parametrize("degrees", [5, 30, 60])
def test_shading_normals_do_not_light_from_behind(device: str, degrees: float) -> None:
    """A cosine lobe about n_s, cut at the plane of n_g: (1 + cos) / 2 of it. Nothing leaks."""
    bent, angle = tilted(degrees, diffuse(0.8))
    agrees(bent, 0.8 * (1 + math.cos(angle)) / 2, device, 800_000, sees=0.01)


@pytest.mark.parametrize("degrees", [5, 30, 60])
def test_mirror_about_a_shading_normal(device: str, degrees: float) -> None:
    """A bent mirror sees the lamp where the bent normal says, and no light through its back."""
    bent, angle = tilted(degrees, MIRROR)
    eye = np.array([-1.0, 0, 3]) / math.sqrt(10)
    n = direction(degrees)
    out = 2 * (eye @ n) * n - eye
    if out[2] > 0:
        lamp = flat("disk", 4 * out, -out, 0.02, BLACK, [1, 2, 3])
        plate = flat("rectangle", [0, 0, 0], [0, 0, 1], 9, MIRROR)
        seen = scene(view([-1, 0, 3], [0, 0, 0]), lamp, plate)
        normals = np.zeros(seen.vertices.shape)
        normals[-4:] = n
        seen = dataclasses.replace(seen, normals=normals)
        agrees(seen, [1, 2, 3], device, 1000, sees=1e-4)
    else:
        agrees(bent, 0.0, device, 1000, sees=1e-4)
