"""Phase functions other than Henyey and Greenstein's against radiative transfer."""

from __future__ import annotations

import math
from collections.abc import Callable

import numpy as np
import numpy.typing as npt

from veriray_validate.dicts import BLACK, NULL, Dict, cuboid, flat, rgb, scene, sky, view
from veriray_validate.form_factors import gauss
from veriray_validate.levels.closed_media.slabs import ALBEDOS, at
from veriray_validate.transfer import adding_doubling
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
