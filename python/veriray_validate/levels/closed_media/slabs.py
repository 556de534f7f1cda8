"""Half spaces and slabs against radiative transfer."""

from __future__ import annotations

import itertools
import math

import numpy as np
import numpy.typing as npt

from veriray_validate.dicts import (
    BLACK,
    NULL,
    cuboid,
    facing,
    flat,
    glass,
    medium,
    rgb,
    scene,
    sky,
    view,
)
from veriray_validate.form_factors import gauss
from veriray_validate.statistics import max_z, smallest_bias
from veriray_validate.transfer import (
    adding_doubling,
    chandrasekhar,
    discrete_ordinates,
    slab_reflectance,
    slab_under_beam,
)
from veriray_validate.trial import Trial, case

Array = npt.NDArray[np.float64]


ALBEDOS = np.array([0.5, 0.9, 0.99])


def at(mu: float) -> Array:
    """A place 5 away from the origin at cosine mu from +z, towards +x."""
    return 5 * np.array([math.sqrt(1 - mu * mu), 0, mu])


# ---- theory ----


@case(3, once=True, quick=False)
def transfer_theory(t: Trial) -> None:
    """Solvers of the transfer equation against each other and printed values.

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
    """An isotropic half space in a sky of 1, three albedos as three channels; tau is 200.

    Chandrasekhar's 1 - H(mu) sqrt(1 - w): at mu = 1 .115226, .414947, .752721. Sees 2 %.
    """
    exact = [1 - chandrasekhar(w, [mu])[0] * math.sqrt(1 - w) for w in ALBEDOS.tolist()]
    t.check(np.abs(exact - np.array(HALF_SPACE[mu])).max() < 2e-6)
    ground = cuboid([-200, -200, -200], [200, 200, 0], NULL, interior=medium(1.0, ALBEDOS))
    t.agrees(scene(view(at(mu), [0, 0, 0]), ground, sky(1)), exact, 200_000, sees=0.02)


@case(3, quick=False)
def spherical_albedo_of_a_half_space(t: Trial) -> None:
    """An isotropic half space lit by diffuse light.

    2 integral of mu (1 - H sqrt(1 - w)) = .146544, .478024, .794564. Sees 2 %.

    The body that represents it is 36 mean free paths deep and wide. What is missing of R is below
    w / 2 exp(-2 k tau), 2e-6 for k = .1725 at w = .99 (its largest root of k = w artanh k), and the
    patch sees (h / W)^2 = 2e-7 past it. Light enters 2^-20 of the renderer's unit U = 2048 inside,
    unattenuated, and leaves through a plane 2^-22 U inside. Starting an optical depth e inside
    changes R(mu) by e / mu (R(mu) - w E), where E = (1 + integral of R) / 2 is the light that
    leaves a source at the boundary. Relative to R that is 2 e (integral of R - w E) / R: -1.66 e,
    -.69 e, -.21 e for the three albedos. e = 3 / 4 2^-20 U sigma is 2.6e-5 here, and the change
    4.4e-5.
    """
    x, w = gauss(64)
    at_mu = np.array([1 - chandrasekhar(a, x.tolist()) * math.sqrt(1 - a) for a in ALBEDOS])
    exact, mean = 2 * at_mu @ (w * x), at_mu @ w
    t.check(np.abs(exact - (0.146544, 0.478024, 0.794564)).max() < 1e-6)
    wide, sigma, unit = 2000.0, 0.018, 2048.0
    slope = 2 * (mean - ALBEDOS * (1 + mean) / 2) / exact
    t.check(np.abs(slope).max() * 0.75 * 2.0**-20 * unit * sigma + 2e-6 < 5e-5, "entry")
    fog = medium(sigma, ALBEDOS)
    above = cuboid([-wide, -wide, 1], [wide, wide, 1 + wide], NULL, interior=fog)
    t.agrees(facing(above), exact, 800_000, sees=0.02, margin=5e-5)


@case(3, each={"mu": (1.0, 0.7, 0.25)}, quick=lambda mu: mu == 0.7)
def half_space_in_parallel_light(t: Trial, mu: float) -> None:
    """An isotropic half space under a sun at cosine .4.

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
    """Tau = 1, albedo 1, isotropic: reflection of the sky above, transmission of a lamp below.

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
    """Reflectance and transmittance of a slab, Henyey-Greenstein, matched or glassy.

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


@case(3, each={"slabs": (4, 40)}, quick=lambda slabs: slabs == 4)
def drawn_slabs(t: Trial, slabs: int) -> None:
    """Slabs of random depth, 1e-3 to 1e3, asymmetry, -0.9 to 0.9, index, albedo and direction.

    Adding-doubling as for `scattering_slab`. Matched slabs are put together from up to three. They
    are 2,000 times as wide as thick to each side; what lies beyond is left out: 3e-6. Values above
    0.05 are judged; sees 6 % of each.
    """
    for _ in range(slabs):
        tau, g = float(10 ** t.rng.uniform(-3, 3)), float(t.rng.uniform(-0.9, 0.9))
        albedo, mu = t.rng.uniform(0, 1, 3), float(t.rng.uniform(0.1, 1))
        near = t.rng.random(3) < 0.3
        albedo[near] = 1 - 10 ** t.rng.uniform(-3, -1, int(near.sum()))
        eta = 1.0 if t.rng.random() < 0.5 else float(t.rng.uniform(1.001, 2.5))
        ways = [adding_doubling(tau, w, g, eta, [mu], 64) for w in albedo.tolist()]
        under = bool(tau < 10 and t.rng.random() < 0.5)
        exact = np.array(ways)[:, int(under), 0]
        cuts = -np.sort(t.rng.uniform(0.1, 0.9, int(t.rng.integers(3)) if eta == 1 else 0))
        heights = [0.0, *cuts.tolist(), -1.0]
        fog, material = medium(tau, albedo, g), NULL if eta == 1 else glass(eta)
        layers = [cuboid([-2000, -2000, low], [2000, 2000, high], material, interior=fog)
                  for high, low in itertools.pairwise(heights)]  # fmt: skip
        dark = flat("rectangle", [0, 0, -21], [0, 0, 1], 1e6, BLACK)
        below = np.array([0, 0, -1.0])
        eye = view(below - at(mu), below, 1e-3) if under else view(at(mu), [0, 0, 0], 1e-3)
        bright = exact > 0.05  # below, few samples carry the mean
        if not bright.any():
            continue
        spp, sees = 300_000 if tau < 100 else 60_000, math.inf
        while sees > 0.06:  # again with four times the samples where these are too noisy
            r = t.render(scene(eye, *layers, dark, sky(1)), spp)
            mean, error = r.image[0, 0].astype(np.float64), r.stderr[0, 0].astype(np.float64)
            sees = smallest_bias(float((error / exact)[bright].max()), 1.0) + 1e-4
            spp *= 4
        off = np.maximum(np.abs(mean - exact) - 1e-4 * exact - 3e-6, 0)
        drawn = f"tau {tau:.4g}, g {g:.3f}, albedo {albedo.round(4)}, eta {eta:.3f}"
        drawn += f", mu {mu:.3f}, {len(layers)} layers, {'under' if under else 'over'}"
        t.p(max_z((off / error)[bright]), f"{drawn}: {mean} for {exact}")
        t.sees(sees, 0.06)


@case(3, each={"side": ("above", "below"), "mu": (1.0, 0.3)},
      quick=lambda side, mu: (side == "above") == (mu == 0.3))  # fmt: skip
def slab_in_parallel_light(t: Trial, side: str, mu: float) -> None:
    """An isotropic slab of tau = 1 under a sun at cosine .6, from above and below.

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
