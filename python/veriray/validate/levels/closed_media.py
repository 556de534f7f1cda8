"""Media against closed forms and radiative transfer."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import numpy.typing as npt
import trimesh
from scipy import stats

from veriray.validate.dicts import (
    BLACK,
    NULL,
    Dict,
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
from veriray.validate.form_factors import gauss
from veriray.validate.levels.closed_materials import facing
from veriray.validate.scenes import Medium, Part, box, camera, make, material
from veriray.validate.statistics import chi_square, max_z, smallest_bias
from veriray.validate.transfer import (
    adding_doubling,
    chandrasekhar,
    discrete_ordinates,
    slab_reflectance,
    slab_under_beam,
)
from veriray.validate.trial import Trial, case

Array = npt.NDArray[np.float64]
ALBEDOS = np.array([0.5, 0.9, 0.99])


def at(mu: float) -> Array:
    """A place 5 away from the origin at cosine mu from +z, towards +x."""
    return 5 * np.array([math.sqrt(1 - mu * mu), 0, mu])


# ---- furnaces ----

WHITE = {
    "isotropic": ([1.0, 2.0, 4.0], 0.0),
    "grey": (3.0, 0.0),
    "forward": (4.0, 0.9),
    "backward": (2.0, -0.7),
}


@case(3, each={"name": WHITE, "boundary": ("null", "glass")}, quick=lambda name, boundary: (
    name != "grey" and (name == "forward") == (boundary == "glass")))  # fmt: skip
def white_furnace_of_a_medium(t: Trial, name: str, boundary: str) -> None:
    """Albedo 1 in a null ball and in a glass ball, in a sky of 1 (E2).

    Radiance 1 everywhere. Sees 0.2 %.
    """
    extinction, g = WHITE[name]
    material = NULL if boundary == "null" else glass(1.5)
    ball = sphere([0.1, 0, 0.2], 1, material, interior=medium(extinction, 1.0, g))
    furnace = scene(view([1, 2, 6], [0, 0, 0], 26, 4), ball, sky(1))
    t.agrees(furnace, 1.0, 100_000, sees=3e-3 if name == "isotropic" else 1.5e-3)


@case(3)
def white_furnace_of_nested_and_touching_media(t: Trial) -> None:
    """A ball in a ball in a glass ball, two cubes that share a wall, with one of air within (N9).

    Lossless: 1 everywhere (E2). Sees 0.2 %.
    """
    outer, inner = medium(1.0, 1.0), medium(3.0, 1.0, 0.5)
    bodies = [
        sphere([-1.2, 0, 0], 1, glass(1.3), interior=outer),
        sphere([-1.2, 0.1, 0], 0.5, NULL, interior=inner, exterior=outer),
        sphere([-1.0, 0.1, 0], 0.2, NULL, exterior=inner),
        cuboid([0, -0.5, -0.5], [1, 0.5, 0.5], NULL, interior=inner),
        cuboid([1.0001, -0.5, -0.5], [2, 0.5, 0.5], glass(1.2), interior=outer),
    ]
    furnace = scene(view([1, 2, 6], [0, 0, 0], 34, 6), *bodies, sky(1))
    t.agrees(furnace, 1.0, 20_000, sees=2e-3)


@case(3, each={"place": ("fog", "water")})
def camera_in_a_white_medium(t: Trial, place: str) -> None:
    """The camera stands in fog of albedo 1, in a null ball and in water (E2, E6, N9).

    1, and n^2. Sees 0.2 %.
    """
    fog = medium(1.5, 1.0, 0.4)
    material, exact = (NULL, 1.0) if place == "fog" else (glass(1.33), 1.33**2)
    eye = view([0.3, 0.1, 0.2], [0, 0.4, 1], 90, 4, medium=fog)
    furnace = scene(eye, sphere([0, 0, 0], 1, material, interior=fog), sky(1))
    t.agrees(furnace, exact, 40_000, sees=2e-3)


@case(3, each={"distance": (10.0, 1e3, 1e4)}, quick=lambda distance: distance == 1e4)
def white_medium_from_afar(t: Trial, distance: float) -> None:
    """A ball of radius 1 whose coordinates are rounded to 1e-7 of the camera's distance (E2, N8).

    Still 1: shadow rays and paths must cross the same length of medium, however it is rounded.
    """
    ball = sphere([0, 0, 0], 1, NULL, interior=medium(8.0, 1.0))
    fov = 2 * math.degrees(math.atan(0.9 / distance))
    far = scene(view([0, 0, distance], [0, 0, 0], fov), ball, sky(1))
    t.agrees(far, 1.0, 800_000, sees=3e-3)


@case(3)
def ledger_of_a_clear_medium(t: Trial) -> None:
    """Extinction 0 is a vacuum (L6, A40).

    Three segments, no scattering, the sky itself: exactly.
    """
    ball = sphere([0, 0, 0], 1, NULL, interior=medium(0.0, 0.5))
    r = t.render(scene(view([0, 0, 5], [0, 0, 0]), ball, sky(2)), 1000)
    t.check(r.image == 2)
    t.check(r.stats["live_rays"] == [r.spp, r.spp, r.spp])


# ---- absorption ----


@case(3, each={"boundary": ("null", "mask")})
def beer_lambert(t: Trial, boundary: str) -> None:
    """A lamp behind an absorbing slab (A40).

    e^-tau in three channels, tau = .1, 1, 3: .904837, .367879, .049787.
    """
    tau = np.array([0.1, 1.0, 3.0])
    material = NULL if boundary == "null" else {"type": "mask", "opacity": 0.0, "bsdf": BLACK}
    slab = cuboid([-50, -50, 0], [50, 50, 2], material, interior=medium(tau / 2, 0.0))
    lamp = flat("rectangle", [0, 0, -1], [0, 0, 1], 50, BLACK, 1)
    seen = scene(view([0, 0, 5], [0, 0, 0]), slab, lamp)
    t.agrees(seen, np.exp(-tau), 800_000, sees=0.02)


@case(3, quick=False)
def beer_lambert_of_ten(t: Trial) -> None:
    """A lamp behind an absorbing slab of optical depth 10 (A40).

    e^-10 = 4.539993e-5; one path in 22,026 arrives. Sees 10 %.
    """
    t.check(abs(math.exp(-10) / 4.539993e-5 - 1) < 1e-6)
    slab = cuboid([-50, -50, 0], [50, 50, 2], NULL, interior=medium(5.0, 0.0))
    lamp = flat("rectangle", [0, 0, -1], [0, 0, 1], 50, BLACK, 1)
    t.agrees(scene(view([0, 0, 5], [0, 0, 0]), slab, lamp), math.exp(-10), 60_000_000, sees=0.1)


@case(3)
def beer_lambert_in_a_camera_medium(t: Trial) -> None:
    """The camera in the medium and the lamp oblique (A40, N9).

    e^-(sigma d): the ray's length counts.
    """
    ink = medium([0.2, 0.5, 1.0], 0.0)
    eye = view(4 * direction(50), [0, 0, 0], medium=ink)
    around = sphere([0, 0, 0], 9, NULL, interior=ink)
    lamp = flat("rectangle", [0, 0, 0], [0, 0, 1], 1, BLACK, 1)
    exact = np.exp(-4 * np.array([0.2, 0.5, 1.0]))
    t.agrees(scene(eye, around, lamp), exact, 800_000, sees=0.03)


@case(3, each={"shells": (1, 4)})
def transmittance_of_shadow_rays(t: Trial, shells: int) -> None:
    """A point light in an absorbing ball over a floor (A45).

    I cos / d^2 rho / pi e^-tau, without noise; tau = 1.5 in green: .223130. In several shells, one
    in another, the same.
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
        t.check(abs(math.exp(-total[1]) - 0.223130) < 1e-6)
    exact = rho / math.pi * 7 * math.cos(math.radians(35)) / 25 * np.exp(-total)
    floor = flat("rectangle", [0, 0, 0], [0, 0, 1], 9, diffuse(rho))
    light = {"type": "point", "position": position, "intensity": rgb(7)}
    seen = scene(view([-3, 0, 1], [0, 0, 0]), floor, light, *balls, max_depth=2)
    # A medium ends 2^-21 of the coordinates before its surface.
    t.agrees(seen, exact, 10_000, sees=1e-3, margin=3e-5 * shells)


@case(3, each={"light": ("sun", "lamp")})
def absorbing_sheet_over_a_floor(t: Trial, light: str) -> None:
    """Parallel light through an absorbing sheet at 50 degrees, and a square lamp above it (A45).

    rho / pi E cos e^(-tau / cos), without noise; the lamp by quadrature of e^(-tau / cos) over its
    form factor: shadow rays of all lengths. Sees 0.5 %.
    """
    tau, rho = np.array([0.3, 1.0, 4.0]), 0.5
    # a medium ends 2^-21 of the scene before its surface: the scene is small; the camera is below
    floor = flat("rectangle", [0, 0, 0], [0, 0, 1], 1, diffuse(rho))
    sheet = cuboid([-2.5, -2.5, 1], [2.5, 2.5, 1.5], NULL, interior=medium(2 * tau, 0.0))
    eye = view([-0.6, 0.2, 0.5], [0, 0, 0])
    if light == "sun":
        c = math.cos(math.radians(50))
        source: Dict = {"type": "directional", "direction": -direction(50), "irradiance": rgb(3)}
        exact = rho / math.pi * 3 * c * np.exp(-tau / c)
        t.agrees(scene(eye, floor, sheet, source, max_depth=2), exact, 10_000, sees=1e-3,
                 margin=1e-4)  # fmt: skip
        return
    source = flat("rectangle", [0, 0, 2], [0, 0, -1], 1.5, BLACK, 3)
    x, w = gauss(80, 0, 1.5)
    d2 = x[:, None] ** 2 + x**2 + 4
    c = 2 / np.sqrt(d2)
    seen = np.exp(-tau[:, None, None] / c) * c**2 / d2 / math.pi
    exact = rho * 3 * 4 * np.einsum("kij,i,j->k", seen, w, w)
    t.agrees(scene(eye, floor, sheet, source), exact, 1_600_000, sees=0.01, margin=1e-4)


@case(3)
def chromatic_distance_to_a_wall(t: Trial) -> None:
    """Extinctions of .1, 1 and 5 with albedo 0 (A40).

    e^-tau: one channel's path may not starve another's.
    """
    slab = cuboid([-50, -50, 0], [50, 50, 1], NULL, interior=medium([0.1, 1.0, 5.0], 0.0))
    seen = scene(view([0, 0, 5], [0, 0, 0]), slab, sky(1))
    t.agrees(seen, np.exp([-0.1, -1.0, -5.0]), 1_600_000, sees=0.05)


# ---- theory ----


@case(3, once=True, quick=False)
def transfer_theory(t: Trial) -> None:
    """Solvers of the transfer equation against each other and printed values (A42, A43, A44).

    Adding-doubling and discrete ordinates to 1e-8; H functions; the integral equation; lossless
    slabs keep everything; H. C. van de Hulst, 1980 (g = .75, tau = 2: .09739, .66096); R. G.
    Giovanelli, 1955 (half space, n = 1.5: .2600).
    """
    mu = [1.0, 0.5]
    for eta in (1.0, 1.5):
        for g in (0.0, 0.75, -0.5):
            for tau in (0.5, 2.0, 1000.0):
                for w in ALBEDOS.tolist():
                    ways = (adding_doubling(tau, w, g, eta, mu),
                            discrete_ordinates(tau, w, g, eta, mu))  # fmt: skip
                    t.check(np.abs(np.subtract(*ways)).max() < 1e-8, f"{eta, g, tau, w}")
        r, tr = adding_doubling(1.0, 1.0, 0.75, eta, mu)
        t.check(np.abs(r + tr - 1).max() < 1e-9, "lossless")
    r, tr = discrete_ordinates(2.0, 0.9, 0.75, 1.0, [1.0])
    t.check(abs(r[0] - 0.09739) < 5e-6 and abs(tr[0] - 0.66096) < 5e-6, "van de Hulst")
    t.check(abs(discrete_ordinates(1e3, 0.9, 0.0, 1.5, [1.0])[0][0] - 0.2600) < 1e-4, "Giovanelli")
    for w, value in zip(ALBEDOS.tolist(), (1.251260, 1.850099, 2.472793), strict=True):
        t.check(abs(chandrasekhar(w, [1.0])[0] - value) < 1e-6, "H(1)")
        half = 1 - chandrasekhar(w, mu) * math.sqrt(1 - w)
        t.check(np.abs(half - adding_doubling(1e3, w, 0.0, 1.0, mu)[0]).max() < 1e-7)
    for x in (1.0, 0.4):
        r, _ = adding_doubling(1.0, 1.0, 0.0, 1.0, [x])
        t.check(abs(slab_reflectance(1.0, x) - r[0]) < 1e-6)
    # under a beam a deep slab is Chandrasekhar's half space; the mean over angles is the albedo
    h = chandrasekhar(0.9, [0.7, 0.4])
    up, _ = slab_under_beam(30.0, 0.7, 0.4, 0.9)
    t.check(abs(up - 0.9 / (4 * math.pi) * h.prod() * 0.4 / 1.1) < 2e-6)
    x, w = gauss(32)
    beam = [slab_under_beam(1.0, y, 0.4, 0.9, 500) for y in x.tolist()]
    r, tr = adding_doubling(1.0, 0.9, 0.0, 1.0, [0.4])
    fluxes = 2 * math.pi * ((w * x) @ beam) / 0.4
    t.check(abs(fluxes[0] - r[0]) < 1e-5 and abs(fluxes[1] + math.exp(-2.5) - tr[0]) < 1e-5)


# ---- half spaces ----

HALF_SPACE = {1.0: (0.115226, 0.414947, 0.752721), 0.5: (0.160144, 0.507939, 0.815140),
              0.3: (0.191148, 0.560016, 0.844129)}  # fmt: skip


@case(3, each={"mu": HALF_SPACE}, quick=lambda mu: mu == 0.5)
def half_space(t: Trial, mu: float) -> None:
    """An isotropic half space in a sky of 1, three albedos as three channels; tau is 200 (A43).

    Chandrasekhar's 1 - H(mu) sqrt(1 - w): at mu = 1 .115226, .414947, .752721. Sees 2 %.
    """
    exact = [1 - chandrasekhar(w, [mu])[0] * math.sqrt(1 - w) for w in ALBEDOS.tolist()]
    t.check(np.abs(exact - np.array(HALF_SPACE[mu])).max() < 2e-6)
    ground = cuboid([-200, -200, -200], [200, 200, 0], NULL, interior=medium(1.0, ALBEDOS))
    t.agrees(scene(view(at(mu), [0, 0, 0]), ground, sky(1)), exact, 200_000, sees=0.02)


@case(3, quick=False)
def spherical_albedo_of_a_half_space(t: Trial) -> None:
    """An isotropic half space lit by diffuse light (A43).

    2 integral of mu (1 - H sqrt(1 - w)) = .146544, .478024, .794564. Sees 2 %.
    """
    x, w = gauss(64)
    exact = [float(2 * (w * x) @ (1 - chandrasekhar(a, x.tolist()) * math.sqrt(1 - a)))
             for a in ALBEDOS.tolist()]  # fmt: skip
    t.check(np.abs(np.array(exact) - (0.146544, 0.478024, 0.794564)).max() < 1e-6)
    fog = medium(0.5, ALBEDOS)
    above = cuboid([-2000, -2000, 1], [2000, 2000, 1001], NULL, interior=fog)
    t.agrees(facing(above), exact, 800_000, sees=0.02, margin=5e-5)


@case(3, each={"mu": (1.0, 0.7, 0.25)}, quick=lambda mu: mu == 0.7)
def half_space_in_parallel_light(t: Trial, mu: float) -> None:
    """An isotropic half space under a sun at cosine .4 (A43).

    S. Chandrasekhar, 1950: w / 4 pi mu0 / (mu + mu0) H(mu) H(mu0) E. Sees 2 %.
    """
    mu0 = 0.4
    h = np.array([chandrasekhar(w, [mu, mu0]) for w in ALBEDOS.tolist()])
    exact = 2 * ALBEDOS / (4 * math.pi) * mu0 / (mu + mu0) * h.prod(axis=1)
    ground = cuboid([-200, -200, -200], [200, 200, 0], NULL, interior=medium(1.0, ALBEDOS))
    sun = {"type": "directional", "irradiance": rgb(2),
           "direction": -np.array([0, math.sqrt(1 - mu0 * mu0), mu0])}  # fmt: skip
    t.agrees(scene(view(at(mu), [0, 0, 0]), ground, sun), exact, 200_000, sees=0.02)


# ---- slabs ----


@case(3, each={"mu": (1.0, 0.4)})
def conservative_slab(t: Trial, mu: float) -> None:
    """Tau = 1, albedo 1, isotropic: of the sky above and of a lamp below (A44).

    R = .341329, T = .658671 at mu = 1; R + T = 1. Sees 1 %.
    """
    r = slab_reflectance(1.0, mu)
    t.check(abs(r - adding_doubling(1.0, 1.0, 0.0, 1.0, [mu])[0][0]) < 1e-6)
    t.check(mu < 1 or abs(r - 0.341329) < 2e-6)
    slab = cuboid([-40, -40, 0], [40, 40, 1], NULL, interior=medium(1.0, 1.0))
    lamp = flat("rectangle", [0, 0, -1], [0, 0, 1], 400, BLACK, [0, 1, 1])
    seen = scene(view(at(mu), [0, 0, 0]), slab, lamp, sky([1, 0, 1]))
    t.agrees(seen, [r, 1 - r, 1], 400_000, sees=0.01, margin=1e-4)


@case(
    3,
    each={"eta": (1.0, 1.5), "g": (0.0, 0.75, -0.5), "tau": (0.5, 2.0, 1000.0), "mu": (1.0, 0.5)},
    quick=lambda eta, g, tau, mu: (g, tau, mu) == (0.75, 2.0, 1.0),
)  # fmt: skip
def scattering_slab(t: Trial, eta: float, g: float, tau: float, mu: float) -> None:
    """Reflectance and transmittance of a slab, Henyey-Greenstein, matched or glassy (A43, A44).

    Adding-doubling, which discrete ordinates confirm to 1e-8; albedo .5, .9 and .99 as three
    channels, tau = 1000 for the half space, all angles of the sky. Sees 2 %.
    """
    exact = np.array([adding_doubling(tau, w, g, eta, [mu]) for w in ALBEDOS.tolist()])[:, :, 0]
    other = np.array([discrete_ordinates(tau, w, g, eta, [mu]) for w in ALBEDOS.tolist()])[:, :, 0]
    t.check(np.abs(exact - other).max() < 1e-8, "two ways")
    material = NULL if eta == 1 else glass(eta)
    wide = max(1000.0, 2 * tau)
    fog = medium(1.0, ALBEDOS, g)
    slab = cuboid([-wide, -wide, -tau], [wide, wide, 0], material, interior=fog)
    dark = flat("rectangle", [0, 0, -tau - 20], [0, 0, 1], 1e6, BLACK)
    eye, below = at(mu), np.array([0, 0, -tau])
    seen = scene(view(eye, [0, 0, 0], 1e-3), slab, dark, sky(1))
    spp = 800_000 if tau < 1 and eta == 1 else 300_000
    t.agrees(seen, exact[:, 0], spp, sees=0.03, margin=5e-5)
    if tau < 1000:  # from below, the dark plane behind the camera
        under = view(below - eye, below, 1e-3)
        t.agrees(scene(under, slab, dark, sky(1)), exact[:, 1], spp, sees=0.03, margin=5e-5)


@case(3, each={"side": ("above", "below"), "mu": (1.0, 0.3)},
      quick=lambda side, mu: (side == "above") == (mu == 0.3))  # fmt: skip
def slab_in_parallel_light(t: Trial, side: str, mu: float) -> None:
    """An isotropic slab of tau = 1 under a sun at cosine .6, from above and below (A44).

    The source function of the integral equation, integrated towards the eye. Sees 2 %.
    """
    mu0, tau = 0.6, 1.0
    both = np.array([slab_under_beam(tau, mu, mu0, w) for w in ALBEDOS.tolist()])
    exact = 2 * both[:, 0 if side == "above" else 1]
    slab = cuboid([-1000, -1000, -tau], [1000, 1000, 0], NULL, interior=medium(1.0, ALBEDOS))
    sun = {"type": "directional", "irradiance": rgb(2),
           "direction": -np.array([0, math.sqrt(1 - mu0 * mu0), mu0])}  # fmt: skip
    eye, low = at(mu), np.array([0, 0, -tau])
    seen = view(eye, [0, 0, 0], 1e-3) if side == "above" else view(low - eye, low, 1e-3)
    t.agrees(scene(seen, slab, sun), exact, 400_000, sees=0.02, margin=5e-5)


# ---- one scattering, and a known number of them ----


@case(3)
def single_scattering(t: Trial) -> None:
    """One scattering in a slab of tau = 1, isotropic, albedo .5, under a sun overhead (A42).

    w / 4 pi mu0 / (mu + mu0) (1 - exp(-tau (1/mu + 1/mu0))) E = .025205181 at mu = .5.
    """
    w, mu, tau = 0.5, 0.5, 1.0
    exact = w / (4 * math.pi) / (mu + 1) * (1 - math.exp(-tau * (1 / mu + 1)))
    t.check(abs(exact - 0.025205181) < 1e-9)
    x, v = gauss(40)
    t.check(abs(exact - w / (4 * math.pi) / mu * float(v @ np.exp(-x * (1 / mu + 1)))) < 1e-12)
    slab = cuboid([-40, -40, 0], [40, 40, 1], NULL, interior=medium(1.0, w))
    light = {"type": "directional", "direction": np.array([0, 0, -1.0]), "irradiance": rgb(1)}
    seen = scene(view(at(mu), [0, 0, 0]), slab, light, max_depth=2)
    t.agrees(seen, exact, 1_600_000, sees=0.01)


@case(3, each={"g": (0.8, -0.5)})
def single_scattering_has_the_phase_function(t: Trial, g: float) -> None:
    """One scattering with Henyey and Greenstein's law, light 60 degrees aside (A42).

    4 pi p(cos) in place of 1.
    """
    tau, mu, mu0 = 1.0, 1.0, 0.5
    cosine = -0.5  # of the turn: up to the camera from a beam 60 degrees off the way down
    phase = (1 - g * g) / (1 + g * g - 2 * g * cosine) ** 1.5
    exact = 0.9 / (4 * math.pi) * phase * mu0 / (mu + mu0) * (1 - math.exp(-tau / mu - tau / mu0))
    slab = cuboid([-40, -40, 0], [40, 40, 1], NULL, interior=medium(1.0, 0.9, g))
    light = {"type": "directional", "direction": -direction(60), "irradiance": rgb(1)}
    seen = scene(view([0, 0, 5], [0, 0, 0.5]), slab, light, max_depth=2)
    t.agrees(seen, exact, 1_600_000, sees=0.01)


@case(3, each={"g": (0.0, 0.6, -0.8), "mu": (0.5, 1.0)},
      quick=lambda g, mu: (g, mu) == (0.6, 0.5))  # fmt: skip
def single_scattering_through_a_slab(t: Trial, g: float, mu: float) -> None:
    """One scattering, seen from below, in three colours (A42).

    w / 4 pi mu0 / (mu0 - mu) (e^(-tau / mu0) - e^(-tau / mu)) E with mu0 = .8 across from the eye,
    times 4 pi p(cos). Sees 1 %.
    """
    mu0, tau, w = 0.8, 1.5, ALBEDOS
    sine, sine0 = math.sqrt(1 - mu * mu), math.sqrt(1 - mu0 * mu0)
    cosine = mu * mu0 - sine * sine0
    phase = (1 - g * g) / (1 + g * g - 2 * g * cosine) ** 1.5
    depths = (math.exp(-tau / mu0) - math.exp(-tau / mu)) * mu0 / (mu0 - mu)
    x, v = gauss(40, 0, tau)
    t.check(abs(depths - float(v @ np.exp(-x / mu0 - (tau - x) / mu)) / mu) < 1e-12, "two ways")
    exact = 2 * w / (4 * math.pi) * phase * depths
    slab = cuboid([-90, -90, -tau], [90, 90, 0], NULL, interior=medium(1.0, w, g))
    # light comes down towards +x; what reaches the eye goes down towards -x
    sun = {"type": "directional", "direction": np.array([sine0, 0, -mu0]), "irradiance": rgb(2)}
    low = np.array([0, 0, -tau])
    eye = view(low + 5 * np.array([-sine, 0, -mu]), low, 1e-3)
    t.agrees(scene(eye, slab, sun, max_depth=2), exact, 1_600_000, sees=0.01, margin=5e-5)


SCATTERINGS = {1.0: (0.153426, 0.097273, 0.069241, 0.052697, 0.041916, 0.034406),
               0.5: (0.225347, 0.125615, 0.081466, 0.057809),
               0.1: (0.380105, 0.147939, 0.078560)}  # fmt: skip


@case(3, each={"mu": SCATTERINGS, "rr_depth": (1, 1000)},
      quick=lambda mu, rr_depth: (mu, rr_depth) == (0.5, 1))  # fmt: skip
def leaves_after_n_scatterings(t: Trial, mu: float, rr_depth: int) -> None:
    """Half space, isotropic, albedo 1: paths out after n scatterings (L3, A43).

    Exact multinomial; n = 1 is (1 - mu log(1 + 1/mu)) / 2. Segment 0 ends at the null boundary; n
    scatterings on, segment n + 2 is in the open. Albedo 1 gives roulette nothing to do. Sees 1 %
    of the first.
    """
    law = np.array(SCATTERINGS[mu])
    t.check(abs(law[0] - (1 - mu * math.log(1 + 1 / mu)) / 2) < 1e-6)
    ground = cuboid([-500, -500, -500], [500, 500, 0], NULL, interior=medium(1.0, 1.0))
    half = scene(view(at(mu), [0, 0, 0]), ground, sky(1), max_depth=12, rr_depth=rr_depth)
    r = t.render(half, 1_000_000)
    n, escaped = r.spp, r.stats["ledger"]["escaped"]
    t.check(not any(escaped[:3]) and not any(r.stats["ledger"]["rr_killed"]))
    seen = np.array(escaped[3 : 3 + len(law)])
    t.p(chi_square(np.append(seen, n - seen.sum()), n * np.append(law, 1 - law.sum())), "orders")


@case(3, each={"depth": (1, 2, 3, 4, 6)})
def depth_counts_in_a_medium(t: Trial, depth: int) -> None:
    """Orders of scattering by max_depth: n scatterings take max_depth n + 1 (A2, A43).

    Half space at mu = 1 in a sky of 1: the sum of w^k times the law of the last case, k < depth; 0
    exactly at max_depth 1. Boundaries are no vertices. Sees 2 %.
    """
    law = np.array(SCATTERINGS[1.0])[: depth - 1]
    exact = [float((w ** np.arange(1, depth)) @ law) for w in ALBEDOS.tolist()]
    ground = cuboid([-500, -500, -500], [500, 500, 0], NULL, interior=medium(1.0, ALBEDOS))
    seen = scene(view(at(1.0), [0, 0, 0]), ground, sky(1), max_depth=depth)
    t.agrees(seen, exact, 400_000, sees=0.02)


@case(3, each={"g": (0.6, -0.4, 0.9)})
def direction_after_n_scatterings(t: Trial, g: float) -> None:
    """The turn after n scatterings with Henyey and Greenstein's law (A49).

    E[cos] = g^n, E[P2] = g^2n, and the whole law is that of g^n: chi-square in its own
    coordinate. Chains of the core's sampler, n = 1, 2, 3. Sees 1 % in the mean cosine (g = .6).
    """
    paths = 200_000 * t.effort
    d = np.tile([0.0, 0.6, 0.8], (paths, 1))
    for n in (1, 2, 3):
        u = t.rng.random((paths, 2))
        d = t.function("henyey_greenstein", *d.T, np.full(paths, g), *u.T)[:, :3]
        t.check(np.abs(np.linalg.norm(d, axis=1) - 1).max() < 1e-5)
        cosine = d @ [0.0, 0.6, 0.8]
        h = g**n
        legendre = (3 * cosine**2 - 1) / 2
        for values, exact in ((cosine, h), (legendre, h * h)):
            t.p(max_z(np.array([(values.mean() - exact) / values.std() * math.sqrt(paths)])),
                f"moment after {n}")  # fmt: skip
        # distribution of the law with mean cosine h: (1 - h^2) / 2h (1 / sqrt(...) - 1 / (1 + h))
        root = np.sqrt(1 + h * h - 2 * h * np.clip(cosine, -1, 1))
        below = (1 - h * h) / (2 * h) * (1 / root - 1 / (1 + h))
        counts = np.bincount((np.clip(below, 0, 1 - 1e-12) * 16).astype(int), minlength=16)
        t.p(chi_square(counts, np.full(16, paths / 16)), f"law after {n}")
        if n == 1:
            t.sees(smallest_bias(float(cosine.std()) / math.sqrt(paths), g), 0.02)


# ---- how long a path is ----


@case(3, each={"body": ((1.0, 0.0), (8.0, 0.0), (6.0, 0.9), (2.0, -0.5))})
def mean_path_in_a_lossless_ball(t: Trial, body: tuple[float, float]) -> None:
    """Scatterings in a ball that light enters by the cosine law; body: sigma, g (A48).

    Mean path 4 V / S = 4/3, whatever sigma and g (S. Blanco and R. Fournier, 2003): so many
    scatterings are 4/3 sigma in the mean. A far camera's almost parallel rays over the whole disc
    are the cosine law at the surface. Segments: 1 to the ball, n + 1 inside, 1 outside. z test with
    the counts' own variance; sees 2 %.
    """
    sigma, g = body
    distance = 100.0
    fov = 2 * math.degrees(math.atan(1.02 / distance))
    ball = sphere([0, 0, 0], 1, NULL, interior=medium(sigma, 1.0, g))
    far = scene(view([0, 0, distance], [0, 0, 0], fov), ball, sky(1), max_depth=60_000)
    r = t.render(far, 200_000, rr_depth=10**6)
    t.check(not any(r.stats["ledger"]["depth_cut"]))
    live = np.array(r.stats["live_rays"], np.float64)
    inside = live[2:] / live[1]  # inside[k]: share with at least k scatterings, less the last
    mean = inside.sum() - 1
    second = ((2 * np.arange(len(inside)) - 1) * inside)[1:].sum()
    error = math.sqrt((second - (inside[1:].sum()) ** 2) / live[1])
    t.p(2 * float(stats.norm.sf(abs(mean - sigma * 4 / 3) / error)), "mean scatterings")
    t.sees(smallest_bias(error, mean), 0.02)


BOXES = {"cube": ([1.0, 1, 1], 0.666667), "box": ([1.0, 2, 3], 1.090909)}


@case(3, each={"body": BOXES, "made": ("quads", "mesh"), "g": (0.0, 0.8)},
      quick=lambda body, made, g: (body, made, g) == ("box", "quads", 0))  # fmt: skip
def mean_path_in_a_lossless_box(t: Trial, body: str, made: str, g: float) -> None:
    """Scatterings in a cube and in a box 1 x 2 x 3 that light enters from all sides (A48).

    4 V / S = .666667 and 1.090909 mean free paths, whatever g; none is cut (exact). One far picture
    of the sphere around it from each of 300 random directions: the rays that meet the box obey the
    cosine law. Ratio of sums, error from the directions; sees 4 %. Six quads, or 192 triangles in a
    tree.
    """
    size, exact = np.array(BOXES[body][0]), BOXES[body][1]
    surface = 2 * float(size @ np.roll(size, 1))
    t.check(abs(4 * size.prod() / surface - exact) < 1e-6)
    radius, distance, sigma = float(np.linalg.norm(size)) / 2, 100.0, 2.0
    fov = 2 * math.degrees(math.atan(1.02 * radius / distance))
    mesh = trimesh.creation.box(size).subdivide().subdivide()
    fog = {"interior": Medium(sigma, 1.0, g), "material": material("null")}
    if made == "quads":
        part = box(-size / 2, size / 2, False, **fog)
    else:
        part = Part(mesh.vertices, mesh.faces, **fog)
    hits, turns = [], []
    for _ in range(300 * t.effort):
        d = t.rng.normal(size=3)
        eye = camera(distance * d / np.linalg.norm(d), [0, 0, 0], fov)
        far = make([part], eye, 1.0, max_depth=2000, rr_depth=10**6)
        r = t.render(far, 1000 // t.effort)
        escaped = np.array(r.stats["ledger"]["escaped"], np.float64)[2:]  # after n scatterings
        t.check(not any(r.stats["ledger"]["depth_cut"]), "rays never leave the medium")
        hits.append(escaped.sum())
        turns.append(escaped @ np.arange(len(escaped)))
    n, s = np.array(hits), np.array(turns)
    mean = s.sum() / n.sum()
    error = math.sqrt(float(((s - mean * n) ** 2).sum())) / n.sum()
    t.p(2 * float(stats.norm.sf(abs(mean - sigma * exact) / error)), "mean scatterings")
    t.sees(smallest_bias(error, mean), 0.04)


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


@case(3, each={"values": ((4.0, 0.3), (1.0, 1.0), (8.0, 0.1))},
      quick=lambda values: values == (1.0, 1.0))  # fmt: skip
def report_parameters(t: Trial, values: tuple[float, float]) -> None:
    """A ball by the 2016 report's parameters sigma_s' and mu, and its own procedure (A40, A43).

    sigma_s = sigma_s', sigma_a = mu, isotropic: equal to the report's procedure, in expectation.
    Two-sample z test against the procedure itself in NumPy; sees 2 %.
    """
    scattering, absorption = values
    total = scattering + absorption
    ball = sphere([0, 0, 0], 1, NULL, interior=medium(total, scattering / total))
    r = t.render(scene(view([0, 0, 5], [0, 0, 0], 1e-3), ball, sky(1)), 400_000)
    weight = report_ball(scattering, absorption, 100_000 * t.effort, t.fresh())
    error = math.hypot(float(r.stderr[0, 0, 0]), weight.std() / math.sqrt(len(weight)))
    t.p(2 * float(stats.norm.sf(abs(float(r.image[0, 0, 0]) - weight.mean()) / error)), "procedure")
    t.sees(smallest_bias(error, float(weight.mean())), 0.02)


@case(3)
def report_parameters_as_sigma_s_and_sigma_a(t: Trial) -> None:
    """The same medium by sigma_s and sigma_a (A40).

    The same film, bit for bit.
    """
    films, seed = [], t.fresh()
    parts = {"sigma_s": rgb(3.0), "sigma_a": rgb(1.0), "phase": {"type": "isotropic"}}
    for values in (medium(4.0, 0.75), {"type": "homogeneous", **parts}):
        ball = sphere([0, 0, 0], 1, NULL, interior=values)
        seen: Any = scene(view([0, 0, 5], [0, 0, 0], 30, 4), ball, sky(1))
        films.append(t.render(seen, 100, seed=seed).film_sha256)
    t.check(films[0] == films[1])
