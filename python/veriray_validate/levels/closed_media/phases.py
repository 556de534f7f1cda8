"""Phase functions other than Henyey and Greenstein's against radiative transfer."""

from __future__ import annotations

import math
from collections.abc import Callable

import numpy as np
import numpy.typing as npt

from veriray_validate.dicts import BLACK, NULL, Dict, cuboid, flat, rgb, scene, sky, view
from veriray_validate.form_factors import gauss
from veriray_validate.levels.closed_media.slabs import ALBEDOS, at
from veriray_validate.transfer import adding_doubling, rayleigh_half_space
from veriray_validate.trial import Trial, case

Array = npt.NDArray[np.float64]
Function = Callable[[Array], Array]

_TABLE = (0.5, 0.1, 0.2, 0.4, 3.0)
_TABULATED: Dict = {"type": "tabphase", "values": ", ".join(map(str, _TABLE))}


def _hg(g: float) -> Function:
    return lambda c: (1 - g * g) / (1 + g * g - 2 * g * c) ** 1.5


def _rayleigh(c: Array) -> Array:
    return 0.75 * (1 + c * c)


def _tabulated(c: Array) -> Array:
    heights = np.array(_TABLE)
    return np.interp(c, np.linspace(-1, 1, len(heights)), heights) / (
        (heights[1:] + heights[:-1]).mean() / 2
    )


def _blend(weight: float, a: Dict, b: Dict) -> Dict:
    return {"type": "blendphase", "weight": weight, "a": a, "b": b}


#: Plugin, and the function times 4 pi of the cosine of the turn.
KINDS: dict[str, tuple[Dict, Function]] = {
    "rayleigh": ({"type": "rayleigh"}, _rayleigh),
    "tabulated": (_TABULATED, _tabulated),
    "double": (
        _blend(0.3, {"type": "hg", "g": 0.8}, {"type": "hg", "g": -0.4}),
        lambda c: 0.7 * _hg(0.8)(c) + 0.3 * _hg(-0.4)(c),
    ),
    "nested": (
        _blend(0.4, _TABULATED, _blend(0.5, {"type": "isotropic"}, {"type": "rayleigh"})),
        lambda c: 0.6 * _tabulated(c) + 0.2 + 0.2 * _rayleigh(c),
    ),
}


def moments(function: Function, orders: int) -> Array:
    """Means of Legendre's polynomials, (orders,), by quadrature between the table's cosines."""
    result = np.zeros(orders)
    for low in np.linspace(-1, 1, len(_TABLE))[:-1]:
        x, w = gauss(100, low, low + 2 / (len(_TABLE) - 1))
        result += np.polynomial.legendre.legvander(x, orders - 1).T @ (w * function(x)) / 2
    return result


def _fog(phase: Dict) -> Dict:
    return {"type": "homogeneous", "sigma_t": 1.0, "albedo": rgb(ALBEDOS), "phase": phase}


@case(3, each={"kind": KINDS, "azimuth": (0.0, 1.0, 3.0)}, quick=lambda kind, azimuth: azimuth == 1)
def single_scattering_of_any_phase(t: Trial, kind: str, azimuth: float) -> None:
    """Light of a sun that a slab of tau = 0.5 scatters once, from above.

    w p / 4 pi mu0 / (mu + mu0) (1 - exp(-tau (1 / mu + 1 / mu0))). Light samples. Sees 1 %.
    """
    phase, function = KINDS[kind]
    tau, mu, mu0 = 0.5, 0.6, 0.8
    sine = math.sqrt(1 - mu0 * mu0)
    down = -np.array([sine * math.cos(azimuth), sine * math.sin(azimuth), mu0])
    cosine = down @ at(mu) / 5
    share = mu0 / (mu + mu0) * (1 - math.exp(-tau * (1 / mu + 1 / mu0)))
    exact = ALBEDOS * function(np.array(cosine)) / (4 * math.pi) * share
    slab = cuboid([-40, -40, -tau], [40, 40, 0], NULL, interior=_fog(phase))
    sun = {"type": "directional", "irradiance": rgb(1), "direction": down}
    seen = scene(view(at(mu), [0, 0, 0]), slab, sun, max_depth=2)
    t.agrees(seen, exact, 400_000, sees=0.01, margin=5e-5)


@case(3, each={"kind": KINDS, "tau": (0.5, 2.0), "mu": (1.0, 0.4)},
      quick=lambda kind, tau, mu: (tau, mu) == (2.0, 0.4))  # fmt: skip
def slab_of_any_phase(t: Trial, kind: str, tau: float, mu: float) -> None:
    """Reflectance and transmittance of a slab under a sky of 1, by drawn directions alone.

    Adding-doubling with 24 and 40 nodes; albedo .5, .9 and .99 as three channels. Sees 2 %.
    """
    phase, function = KINDS[kind]
    chi = moments(function, 80)
    t.check(abs(chi[0] - 1) < 1e-12, "normalised")
    exact, coarse = (
        np.array([adding_doubling(tau, w, chi[: 2 * n], 1.0, [mu], n) for w in ALBEDOS.tolist()])
        for n in (40, 24)
    )
    t.check(np.abs(exact - coarse).max() < 2e-5, "orders")
    body = cuboid([-1000, -1000, -tau], [1000, 1000, 0], NULL, interior=_fog(phase))
    dark = flat("rectangle", [0, 0, -tau - 20], [0, 0, 1], 1e6, BLACK)
    eye, below = at(mu), np.array([0, 0, -tau])
    t.agrees(scene(view(eye, [0, 0, 0], 1e-3), body, dark, sky(1)), exact[:, 0, 0], 400_000,
             sees=0.03, margin=5e-5)  # fmt: skip
    t.agrees(scene(view(below - eye, below, 1e-3), body, dark, sky(1)), exact[:, 1, 0], 400_000,
             sees=0.03, margin=5e-5)  # fmt: skip


@case(3, once=True)
def theory_of_rayleigh(t: Trial) -> None:
    """Adding-doubling for a half space of Rayleigh scattering against Ambartsumian's equations.

    Within 1e-7 at three cosines, albedo .2 to .99.
    """
    mu = [1.0, 0.5, 0.1]
    chi = moments(_rayleigh, 80)
    t.check(
        np.abs(chi[:3] - [1, 0, 0.1]).max() < 1e-12 and np.abs(chi[3:]).max() < 1e-12, "moments"
    )
    for w in (0.2, 0.5, 0.9, 0.99):
        off = adding_doubling(3000.0, w, chi, 1.0, mu, 40)[0] - rayleigh_half_space(w, mu)
        t.check(np.abs(off).max() < 1e-7, f"albedo {w}: {off}")


@case(3, each={"slabs": (3, 24)}, quick=lambda slabs: slabs == 3)
def tables_of_radiative_transfer(t: Trial, slabs: int) -> None:
    """Reflectance and transmittance of drawn slabs under a sky of 1, by adding-doubling.

    Phase function of `KINDS` or Henyey and Greenstein's with g of -.5 to .9, thickness .03 to 32,
    albedo .2 to 1 by channel, cosine .1 to 1. Only what is above .05 in each channel is compared;
    sees 4 % of it.
    """
    dark = flat("rectangle", [0, 0, -60], [0, 0, 1], 1e6, BLACK)
    for _ in range(slabs):
        tau, mu = math.exp(t.rng.uniform(math.log(0.03), math.log(32))), t.rng.uniform(0.1, 1)
        albedos, g = np.append(t.rng.uniform(0.2, 1, 2), 1.0), t.rng.uniform(-0.5, 0.9)
        kinds = {**KINDS, "hg": ({"type": "hg", "g": g}, _hg(g))}
        phase, function = kinds[str(t.rng.choice(list(kinds)))]
        chi = moments(function, 80)
        fine, coarse = (
            np.array([adding_doubling(tau, w, chi[: 2 * n], 1.0, [mu], n) for w in albedos])
            for n in (40, 24)
        )
        t.check(np.abs(fine - coarse).max() < 1e-3 * fine.max(), "orders")
        half = 100 + 5 * tau  # no flight is so long; wider is too thin in single precision
        fog = {**_fog(phase), "albedo": rgb(albedos)}
        body = cuboid([-half, -half, -tau], [half, half, 0], NULL, interior=fog)
        eye, below = at(mu), np.array([0, 0, -tau])
        places = ((eye, np.zeros(3)), (below - eye, below))
        for (origin, target), exact in zip(places, (fine[:, 0, 0], fine[:, 1, 0]), strict=True):
            if exact.min() > 0.05:
                seen = scene(view(origin, target, 1e-3), body, dark, sky(1))
                t.agrees(seen, exact, 400_000, sees=0.04, margin=3e-4)
