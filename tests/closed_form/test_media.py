"""Media against closed forms and radiative transfer (A40 to A48, L3, the report's parameters).

Rules as in test_analytic: false-alarm rate 1e-3, confirmed at 1e-4; `sees` is the relative bias
found with 90 % power.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Any

import numpy as np
import numpy.typing as npt
import pytest
from scipy import special, stats

import veriray
from tests.closed_form.build import (
    BLACK,
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
from tests.support import FAST, agrees, chi_square, confirm, ledger_adds_up

pytestmark = pytest.mark.parametrize("device", FAST)
Array = npt.NDArray[np.float64]


# ---- furnaces ----

WHITE = {
    "isotropic": ([1.0, 2.0, 4.0], 0.0),
    "grey": (3.0, 0.0),
    "forward": (4.0, 0.9),
    "backward": (2.0, -0.7),
}


@pytest.mark.parametrize("name", WHITE)
@pytest.mark.parametrize("boundary", ["null", "glass"])
def test_white_furnace_of_a_medium(device: str, name: str, boundary: str) -> None:
    """Albedo 1 in a null ball and in a glass ball: radiance 1 everywhere (E2)."""
    extinction, g = WHITE[name]
    material = NULL if boundary == "null" else glass(1.5)
    ball = sphere([0.1, 0, 0.2], 1, material, interior=medium(extinction, 1.0, g))
    furnace = scene(view([1, 2, 6], [0, 0, 0], 26, 4), ball, sky(1))
    agrees(furnace, 1.0, device, 100_000, sees=3e-3 if name == "isotropic" else 1.5e-3)


def test_white_furnace_of_nested_and_touching_media(device: str) -> None:
    """N9: a ball in a ball in a glass ball, two cubes that share a wall, with one of air within."""
    outer, inner = medium(1.0, 1.0), medium(3.0, 1.0, 0.5)
    bodies = [
        sphere([-1.2, 0, 0], 1, glass(1.3), interior=outer),
        sphere([-1.2, 0.1, 0], 0.5, NULL, interior=inner, exterior=outer),
        sphere([-1.0, 0.1, 0], 0.2, NULL, exterior=inner),
        cuboid([0, -0.5, -0.5], [1, 0.5, 0.5], NULL, interior=inner),
        cuboid([1.0001, -0.5, -0.5], [2, 0.5, 0.5], glass(1.2), interior=outer),
    ]
    furnace = scene(view([1, 2, 6], [0, 0, 0], 34, 6), *bodies, sky(1))
    agrees(furnace, 1.0, device, 20_000, sees=2e-3)


def test_camera_in_a_white_medium(device: str) -> None:
    """N9: the camera stands in fog of albedo 1, in a null ball and in water: 1, and n^2."""
    fog = medium(1.5, 1.0, 0.4)
    for material, exact in ((NULL, 1.0), (glass(1.33), 1.33**2)):
        eye = view([0.3, 0.1, 0.2], [0, 0.4, 1], 90, 4, medium=fog)
        furnace = scene(eye, sphere([0, 0, 0], 1, material, interior=fog), sky(1))
        agrees(furnace, exact, device, 40_000, sees=2e-3)


# ---- absorption ----


@pytest.mark.parametrize("boundary", ["null", "mask"])
def test_a40_beer_lambert(device: str, boundary: str) -> None:
    """A lamp behind an absorbing slab: e^-tau in three channels, tau = .1, 1, 3."""
    tau = np.array([0.1, 1.0, 3.0])
    material = NULL if boundary == "null" else {"type": "mask", "opacity": 0.0, "bsdf": BLACK}
    slab = cuboid([-50, -50, 0], [50, 50, 2], material, interior=medium(tau / 2, 0.0))
    lamp = flat("rectangle", [0, 0, -1], [0, 0, 1], 50, BLACK, 1)
    seen = scene(view([0, 0, 5], [0, 0, 0]), slab, lamp)
    agrees(seen, np.exp(-tau), device, 800_000, sees=0.02)


def test_a40_at_an_angle_in_a_camera_medium(device: str) -> None:
    """The same, the camera in the medium and the lamp oblique: the ray's length counts."""
    ink = medium([0.2, 0.5, 1.0], 0.0)
    eye = view(4 * direction(50), [0, 0, 0], medium=ink)
    around = sphere([0, 0, 0], 9, NULL, interior=ink)
    lamp = flat("rectangle", [0, 0, 0], [0, 0, 1], 1, BLACK, 1)
    exact = np.exp(-4 * np.array([0.2, 0.5, 1.0]))
    agrees(scene(eye, around, lamp), exact, device, 800_000, sees=0.03)


@pytest.mark.parametrize("shells", [1, 4])
def test_a45_transmittance_of_shadow_rays(device: str, shells: int) -> None:
    """A point light in an absorbing ball over a floor: I cos / d^2 rho / pi e^-tau, without noise.

    tau = 1.5 in green; in several shells, one in another, the same.
    """
    position, rho = 5 * direction(35), 0.5
    tau = np.array([0.3, 1.5, 4.0])
    radii = np.linspace(2, 1, shells)
    inks = [medium(tau / 2 * (1 + 0.3 * k), 0.0) for k in range(shells)]
    depth = np.append(-np.diff(radii), radii[-1])
    balls = []
    for k, radius in enumerate(radii):
        around = {} if k == 0 else {"exterior": inks[k - 1]}
        balls.append(sphere(position, radius, NULL, interior=inks[k], **around))
    total = sum(tau / 2 * (1 + 0.3 * k) * depth[k] for k in range(shells))
    if shells == 1:
        assert abs(math.exp(-total[1]) - 0.223130) < 1e-6
    exact = rho / math.pi * 7 * math.cos(math.radians(35)) / 25 * np.exp(-total)
    floor = flat("rectangle", [0, 0, 0], [0, 0, 1], 9, diffuse(rho))
    light = {"type": "point", "position": position, "intensity": rgb(7)}
    seen = scene(view([-3, 0, 1], [0, 0, 0]), floor, light, *balls, max_depth=2)
    # A medium ends 2^-21 of the coordinates before its surface.
    agrees(seen, exact, device, 10_000, sees=1e-3, margin=3e-5 * shells)


def test_chromatic_distance_to_a_wall(device: str) -> None:
    """Extinctions of .1, 1 and 10 with albedo 0: one channel's path may not starve another's."""
    slab = cuboid([-50, -50, 0], [50, 50, 1], NULL, interior=medium([0.1, 1.0, 5.0], 0.0))
    seen = scene(view([0, 0, 5], [0, 0, 0]), slab, sky(1))
    agrees(seen, np.exp([-0.1, -1.0, -5.0]), device, 1_600_000, sees=0.05)


# ---- scattering in slabs ----


def chandrasekhar(albedo: float, mu: Sequence[float]) -> Array:
    """H(mu), isotropic: 1/H = sqrt(1-w) + w/2 integral of x H(x) / (mu + x) dx, by iteration."""
    x, w = np.polynomial.legendre.leggauss(128)
    x, w = (x + 1) / 2, w / 2
    h = np.ones_like(x)
    root = math.sqrt(1 - albedo)
    for _ in range(2000):
        h, last = 1 / (root + albedo / 2 * ((w * x * h) / (x[:, None] + x)).sum(1)), h
        if np.abs(h - last).max() < 1e-13:
            break
    at = np.asarray(mu, float)
    return 1 / (root + albedo / 2 * ((w * x * h) / (at[:, None] + x)).sum(1))


def slab_reflectance(tau: float, mu: float, albedo: float = 1.0, cells: int = 1000) -> float:
    """Share of a beam at cosine mu that an isotropic slab sends back: the integral equation.

    S(t) = w e^(-t/mu) + w/2 integral of E1|t - t'| S(t') dt', piecewise constant S with exact cell
    integrals of E1; R = 1/2 integral of E2(t) S(t) dt / mu. By reciprocity the radiance at mu under
    a sky of 1 above and nothing below.
    """
    h = tau / cells
    t = (np.arange(cells) + 0.5) * h
    half = special.expn(2, (np.arange(cells) + 0.5) * h)
    row = np.empty(cells)  # integral of E1 over the cell at distance k cells
    row[0] = 2 * (1 - half[0])
    row[1:] = half[:-1] - half[1:]
    kernel = row[np.abs(np.arange(cells)[:, None] - np.arange(cells))]
    source = np.linalg.solve(np.eye(cells) - albedo / 2 * kernel, albedo * np.exp(-t / mu))
    return float((special.expn(2, t) * source).sum() * h / 2 / mu)


HALF_SPACE = {1.0: (0.115226, 0.414947, 0.752721), 0.5: (0.160144, 0.507939, 0.815140),
              0.3: (0.191148, 0.560016, 0.844129)}  # fmt: skip


@pytest.mark.parametrize("mu", HALF_SPACE)
def test_a43_half_space(device: str, mu: float) -> None:
    """Chandrasekhar's 1 - H(mu) sqrt(1 - w), three albedos as three channels; tau is 200."""
    albedo = np.array([0.5, 0.9, 0.99])
    exact = [1 - chandrasekhar(w, [mu])[0] * math.sqrt(1 - w) for w in albedo.tolist()]
    assert np.abs(exact - np.array(HALF_SPACE[mu])).max() < 2e-6
    ground = cuboid([-200, -200, -200], [200, 200, 0], NULL, interior=medium(1.0, albedo))
    eye = 5 * np.array([math.sqrt(1 - mu * mu), 0, mu])
    agrees(scene(view(eye, [0, 0, 0]), ground, sky(1)), exact, device, 200_000, sees=0.02)


@pytest.mark.parametrize("mu", [1.0, 0.4])
def test_a44_conservative_slab(device: str, mu: float) -> None:
    """tau = 1, albedo 1: R of the sky above, T of a lamp below; R + T = 1."""
    r = slab_reflectance(1.0, mu)
    assert mu < 1 or abs(r - 0.341329) < 2e-6
    slab = cuboid([-40, -40, 0], [40, 40, 1], NULL, interior=medium(1.0, 1.0))
    lamp = flat("rectangle", [0, 0, -1], [0, 0, 1], 400, BLACK, [0, 1, 1])
    eye = 5 * np.array([math.sqrt(1 - mu * mu), 0, mu])
    seen = scene(view(eye, [0, 0, 0]), slab, lamp, sky([1, 0, 1]))
    agrees(seen, [r, 1 - r, 1], device, 400_000, sees=0.01, margin=1e-4)


def test_a42_single_scattering(device: str) -> None:
    """w / 4 pi mu0 / (mu + mu0) (1 - exp(-tau (1/mu + 1/mu0))) E of parallel light: .025205181."""
    w, mu, tau = 0.5, 0.5, 1.0
    exact = w / (4 * math.pi) / (mu + 1) * (1 - math.exp(-tau * (1 / mu + 1)))
    assert abs(exact - 0.025205181) < 1e-9
    slab = cuboid([-40, -40, 0], [40, 40, 1], NULL, interior=medium(1.0, w))
    light = {"type": "directional", "direction": np.array([0, 0, -1.0]), "irradiance": rgb(1)}
    eye = 5 * np.array([math.sqrt(1 - mu * mu), 0, mu])
    seen = scene(view(eye, [0, 0, 0]), slab, light, max_depth=2)
    agrees(seen, exact, device, 1_600_000, sees=0.01)


@pytest.mark.parametrize("g", [0.8, -0.5])
def test_single_scattering_has_the_phase_function(device: str, g: float) -> None:
    """A42 with Henyey-Greenstein, light 60 degrees aside: 4 pi p(cos) in place of 1."""
    tau, mu, mu0 = 1.0, 1.0, 0.5
    cosine = -0.5  # of the turn: up to the camera from a beam 60 degrees off the way down
    phase = (1 - g * g) / (1 + g * g - 2 * g * cosine) ** 1.5
    exact = 0.9 / (4 * math.pi) * phase * mu0 / (mu + mu0) * (1 - math.exp(-tau / mu - tau / mu0))
    slab = cuboid([-40, -40, 0], [40, 40, 1], NULL, interior=medium(1.0, 0.9, g))
    light = {"type": "directional", "direction": -direction(60), "irradiance": rgb(1)}
    seen = scene(view([0, 0, 5], [0, 0, 0.5]), slab, light, max_depth=2)
    agrees(seen, exact, device, 1_600_000, sees=0.01)


# ---- counts ----

SCATTERINGS = {1.0: (0.153426, 0.097273, 0.069241, 0.052697, 0.041916, 0.034406),
               0.5: (0.225347, 0.125615, 0.081466, 0.057809),
               0.1: (0.380105, 0.147939, 0.078560)}  # fmt: skip


@pytest.mark.parametrize("mu", SCATTERINGS)
@pytest.mark.parametrize("rr_depth", [1, 1000])
def test_l3_leaves_after_n_scatterings(device: str, mu: float, rr_depth: int) -> None:
    """Half space, isotropic, albedo 1: exact multinomial of paths out after n scatterings.

    Segment 0 ends at the null boundary; n scatterings on, segment n + 2 is in the open. Albedo 1
    gives roulette nothing to do.
    """
    law = np.array(SCATTERINGS[mu])
    assert abs(law[0] - (1 - mu * math.log(1 + 1 / mu)) / 2) < 1e-6
    ground = cuboid([-500, -500, -500], [500, 500, 0], NULL, interior=medium(1.0, 1.0))
    eye = 5 * np.array([math.sqrt(1 - mu * mu), 0, mu])
    half = scene(view(eye, [0, 0, 0]), ground, sky(1), max_depth=12, rr_depth=rr_depth)

    def p_value(effort: int, seed: int) -> float:
        n = 1_000_000 * effort
        r = veriray.render(half, spp=n, seed=seed, device=device)
        ledger_adds_up(r)
        escaped = r.stats["ledger"]["escaped"]
        assert not any(escaped[:3]) and not any(r.stats["ledger"]["rr_killed"])
        seen = np.array(escaped[3 : 3 + len(law)])
        return chi_square(np.append(seen, n - seen.sum()), n * np.append(law, 1 - law.sum()))

    confirm(p_value)


@pytest.mark.parametrize("distance", [10.0, 1e3, 1e4])
def test_white_medium_from_afar(device: str, distance: float) -> None:
    """A ball of radius 1 whose coordinates are rounded to 1e-7 of the camera's distance: still 1.

    Shadow rays and paths must cross the same length of medium, however it is rounded.
    """
    ball = sphere([0, 0, 0], 1, NULL, interior=medium(8.0, 1.0))
    fov = 2 * math.degrees(math.atan(0.9 / distance))
    far = scene(view([0, 0, distance], [0, 0, 0], fov), ball, sky(1))
    agrees(far, 1.0, device, 800_000, sees=3e-3)


@pytest.mark.parametrize(("sigma", "g"), [(1.0, 0.0), (8.0, 0.0), (6.0, 0.9), (2.0, -0.5)])
def test_a48_mean_path_in_a_lossless_ball(device: str, sigma: float, g: float) -> None:
    """4 V / S = 4/3, whatever sigma and g: so many scatterings are 4/3 sigma in the mean.

    A far camera's almost parallel rays over the whole disc are the cosine law at the surface.
    Segments: 1 to the ball, n + 1 inside, 1 outside. z test with the counts' own variance; sees
    2 %.
    """
    distance = 100.0
    fov = 2 * math.degrees(math.atan(1.02 / distance))
    ball = sphere([0, 0, 0], 1, NULL, interior=medium(sigma, 1.0, g))
    far = scene(view([0, 0, distance], [0, 0, 0], fov), ball, sky(1), max_depth=60_000)

    def p_value(effort: int, seed: int) -> float:
        r = veriray.render(far, spp=200_000 * effort, seed=seed, device=device, rr_depth=10**6)
        ledger_adds_up(r)
        assert not any(r.stats["ledger"]["depth_cut"])
        live = np.array(r.stats["live_rays"], np.float64)
        inside = live[2:] / live[1]  # inside[k]: share with at least k scatterings, less the last
        mean = inside.sum() - 1
        second = ((2 * np.arange(len(inside)) - 1) * inside)[1:].sum()
        error = math.sqrt((second - (inside[1:].sum()) ** 2) / live[1])
        assert 4.57 * error / mean < 0.02
        return 2 * float(stats.norm.sf(abs(mean - sigma * 4 / 3) / error))

    confirm(p_value)


def test_ledger_of_a_clear_medium(device: str) -> None:
    """L6: extinction 0 is a vacuum: three segments, no scattering, the sky itself."""
    ball = sphere([0, 0, 0], 1, NULL, interior=medium(0.0, 0.5))
    r = veriray.render(scene(view([0, 0, 5], [0, 0, 0]), ball, sky(2)), spp=1000, device=device)
    assert (r.image == 2).all() and r.stats["live_rays"] == [1000, 1000, 1000]


# ---- the report's parameters ----


def report_ball(scattering: float, absorption: float, paths: int, seed: int) -> Array:
    """Weights of paths shot through the centre of the unit ball by the report's rule.

    Free flight -log(u) / sigma_s', isotropic turns, every segment times exp(-mu d), until it
    leaves; under a sky of 1 their mean is the radiance.
    """
    rng = np.random.default_rng(seed)
    p = np.tile([0.0, 0.0, 1.0], (paths, 1))
    d = np.tile([0.0, 0.0, -1.0], (paths, 1))
    weight = np.ones(paths)
    alive = np.arange(paths)
    while alive.size:
        b = (p * d).sum(1)
        exit_ = -b + np.sqrt(np.maximum(b * b + 1 - (p * p).sum(1), 0))
        flight = rng.exponential(1 / scattering, alive.size)
        weight[alive] *= np.exp(-absorption * np.minimum(flight, exit_))
        stays = flight < exit_
        alive, p = alive[stays], (p + flight[:, None] * d)[stays]
        z, phi = rng.uniform(-1, 1, alive.size), rng.uniform(0, 2 * math.pi, alive.size)
        s = np.sqrt(1 - z * z)
        d = np.stack([s * np.cos(phi), s * np.sin(phi), z], 1)
    return weight


@pytest.mark.parametrize(("scattering", "absorption"), [(4.0, 0.3), (1.0, 1.0), (8.0, 0.1)])
def test_report_parameters(device: str, scattering: float, absorption: float) -> None:
    """sigma_s = sigma_s', sigma_a = mu, isotropic: equal to the report's procedure, in expectation.

    Two-sample z test against the procedure itself in NumPy; sees 2 %.
    """
    total = scattering + absorption
    inner = medium(total, scattering / total)
    ball = sphere([0, 0, 0], 1, NULL, interior=inner)
    seen = scene(view([0, 0, 5], [0, 0, 0], 1e-3), ball, sky(1))

    def p_value(effort: int, seed: int) -> float:
        r = veriray.render(seen, spp=400_000 * effort, seed=seed, device=device)
        weight = report_ball(scattering, absorption, 100_000 * effort, seed)
        error = math.hypot(float(r.stderr[0, 0, 0]), weight.std() / math.sqrt(len(weight)))
        assert 4.57 * error / weight.mean() < 0.02
        return 2 * float(stats.norm.sf(abs(float(r.image[0, 0, 0]) - weight.mean()) / error))

    confirm(p_value)


def test_report_parameters_as_sigma_s_and_sigma_a(device: str) -> None:
    """The same medium by sigma_s and sigma_a: the same film, bit for bit."""
    films = []
    parts = {"sigma_s": rgb(3.0), "sigma_a": rgb(1.0), "phase": {"type": "isotropic"}}
    for values in (medium(4.0, 0.75), {"type": "homogeneous", **parts}):
        ball = sphere([0, 0, 0], 1, NULL, interior=values)
        seen: Any = scene(view([0, 0, 5], [0, 0, 0], 30, 4), ball, sky(1))
        films.append(veriray.render(seen, spp=100, device=device).film_sha256)
    assert films[0] == films[1]
