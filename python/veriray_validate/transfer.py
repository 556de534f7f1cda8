"""Radiative transfer in plane slabs, in float64 and without random numbers.

Two solvers for Henyey and Greenstein's phase function with a matched or refracting boundary share
only the quadrature rule and Fresnel's equations:

- `adding_doubling`: invariant imbedding for a thin layer, doubled to the thickness, boundaries
  added. Phase function by its Legendre series. H. C. van de Hulst, Multiple Light Scattering, 1980;
  S. A. Prahl, M. J. C. van Gemert and A. J. Welch, Applied Optics 32 (1993).
- `discrete_ordinates`: eigenvectors of the transfer equation, boundary conditions solved for.
  Phase function averaged over the azimuth. S. Chandrasekhar, Radiative Transfer, 1950.

For isotropic scattering there are three more: `chandrasekhar` (half space), `slab_reflectance` and
`slab_under_beam` (integral equation with exponential integrals). All are for light that does not
depend on the azimuth: reflectance and transmittance of a slab under a uniform sky of 1.
"""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np
import numpy.typing as npt
from scipy import linalg, special

from veriray_validate.form_factors import gauss
from veriray_validate.fresnel import fresnel

Array = npt.NDArray[np.float64]


# ---- isotropic ----


def chandrasekhar(albedo: float, mu: Sequence[float]) -> Array:
    """H(mu), isotropic: 1/H = sqrt(1-w) + w/2 integral of x H(x) / (mu + x) dx, by iteration."""
    x, w = gauss(128)
    h = np.ones_like(x)
    root = math.sqrt(1 - albedo)
    for _ in range(2000):
        h, last = 1 / (root + albedo / 2 * ((w * x * h) / (x[:, None] + x)).sum(1)), h
        if np.abs(h - last).max() < 1e-13:
            break
    at = np.asarray(mu, float)
    return np.asarray(1 / (root + albedo / 2 * ((w * x * h) / (at[:, None] + x)).sum(1)))


def _source(tau: float, mu: float, albedo: float, cells: int) -> tuple[Array, Array, float]:
    """Cell centres, source function (radiance) for a beam of irradiance 1 / mu, cell size.

    S(t) = w e^(-t/mu) + w/2 integral of E1|t - t'| S(t') dt', piecewise constant S with exact cell
    integrals of E1.
    """
    h = tau / cells
    t = (np.arange(cells) + 0.5) * h
    half = special.expn(2, (np.arange(cells) + 0.5) * h)
    row = np.empty(cells)  # integral of E1 over the cell at distance k cells
    row[0] = 2 * (1 - half[0])
    row[1:] = half[:-1] - half[1:]
    column = -albedo / 2 * row
    column[0] += 1
    return t, linalg.solve_toeplitz(column, albedo * np.exp(-t / mu)), h


def slab_reflectance(tau: float, mu: float, albedo: float = 1.0, cells: int = 1000) -> float:
    """Share of a beam at cosine mu that an isotropic slab reflects: the integral equation.

    R = 1/2 integral of E2(t) S(t) dt / mu. By reciprocity the radiance at mu under a sky of 1 above
    and nothing below.
    """
    t, source, h = _source(tau, mu, albedo, cells)
    return float((special.expn(2, t) * source).sum() * h / 2 / mu)


def slab_under_beam(tau: float, mu: float, mu0: float, albedo: float,
                    cells: int = 2000) -> tuple[float, float]:  # fmt: skip
    """Radiance at cosine mu above and below an isotropic slab under a beam at cosine mu0.

    For irradiance 1 across the beam, without the beam itself; integrates the source function
    towards the eye, cell by cell.
    """
    t, source, h = _source(tau, mu0, albedo, cells)
    cell = 2 * math.sinh(h / 2 / mu)  # integral of e^(-t/mu) / mu over a cell, over its centre's
    up = (source * np.exp(-t / mu)).sum() * cell
    down = (source * np.exp(-(tau - t) / mu)).sum() * cell
    return float(up) / (4 * math.pi), float(down) / (4 * math.pi)


def rayleigh_half_space(albedo: float, mu: Sequence[float]) -> Array:
    """Reflectance at cosines mu of a half space that scatters as Rayleigh says, under a sky of 1.

    V. A. Ambartsumian's equations (1943), whose phi of isotropic scattering is H, for the azimuth's
    mean 1 + P2 P2 / 2 of the phase function, by iteration; albedo below 1.
    """
    x, w = gauss(96)
    shares = np.array([1.0, 0.5])
    at = np.append(x, np.asarray(mu, float))
    legendre = np.stack([np.ones_like(at), 1.5 * at**2 - 0.5])
    near = w / (at[:, None] + x)
    phi = legendre.copy()
    for _ in range(2000):
        inner = np.einsum("kx,lx,mx->klm", phi[:, :96], legendre[:, :96], near)
        phi, last = legendre + albedo / 2 * at * np.einsum("k,km,klm->lm", shares, phi, inner), phi
        if np.abs(phi - last).max() < 1e-13:
            break
    out = albedo / 2 * np.einsum("k,km,kx,x,mx->m", shares, phi, phi[:, :96], x, near)
    return np.asarray(out[96:])


# ---- any asymmetry, any index ----


class _Nodes:
    """Directions in a slab of index `eta`: quadrature, then those seen at cosines `mu` outside.

    inside: cosines; weights: of the integral over cosines, 0 for the requested directions; fresnel:
    reflectance of the boundary, 1 beyond the critical angle.
    """

    def __init__(self, n: int, eta: float, mu: Sequence[float]):
        outside, w = gauss(n)
        seen = np.asarray(mu, np.float64)
        refracted = np.sqrt(1 - (1 - outside**2) / eta**2)
        # cosines below the critical angle by the outer one: Fresnel's equations are smooth in it
        self.inside, self.weights = refracted, w * outside / (eta**2 * refracted)
        self.fresnel = np.asarray(fresnel(outside, eta))
        if eta > 1:
            trapped, w = gauss(n, 0.0, math.sqrt(1 - 1 / eta**2))
            self.inside = np.append(self.inside, trapped)
            self.weights = np.append(self.weights, w)
            self.fresnel = np.append(self.fresnel, np.ones(n))
        self.inside = np.append(self.inside, np.sqrt(1 - (1 - seen**2) / eta**2))
        self.weights = np.append(self.weights, np.zeros(len(seen)))
        self.fresnel = np.append(self.fresnel, np.asarray(fresnel(seen, eta)))
        self.asked = slice(len(self.inside) - len(seen), None)

    def transfer(self, albedo: float, forward: Array, backward: Array) -> tuple[Array, Array]:
        """A and B of D' = -A D + B U, U' = A U - B D: D and U go down and up."""
        scale = albedo / 2 * self.weights / self.inside[:, None]
        return np.diag(1 / self.inside) - scale * forward, scale * backward


def adding_doubling(tau: float, albedo: float, g: float | Array, eta: float, mu: Sequence[float],
                    n: int = 32) -> tuple[Array, Array]:  # fmt: skip
    """Reflectance and transmittance at cosines mu (outside) under a sky of 1 on one side.

    tau: optical thickness; g: the asymmetry, or the means of Legendre's polynomials for another
    phase function, (2 n,); eta: index of the slab, 1 or more, in a vacuum; n: quadrature nodes in
    the escape cone, and as many beyond it. Fresnel's reflection off the top is part of the first.
    """
    nodes = _Nodes(n, eta, mu)
    orders = np.arange(2 * n)
    legendre = special.eval_legendre(orders, nodes.inside[:, None])
    moments = (2 * orders + 1) * (g if isinstance(g, np.ndarray) else g**orders)
    forward = (legendre * moments) @ legendre.T
    backward = (legendre * moments * (-1.0) ** orders) @ legendre.T
    a, b = nodes.transfer(albedo, forward, backward)
    doublings = max(0, math.ceil(math.log2(tau / (nodes.inside.min() / 64))))
    unit = np.eye(len(a))
    r, t = np.zeros_like(a), unit.copy()

    def slope(r: Array, t: Array) -> tuple[Array, Array]:
        return b - a @ r - r @ a + r @ b @ r, t @ (b @ r - a)

    steps = 8
    h = tau / 2.0**doublings / steps
    for _ in range(steps):  # Runge and Kutta, order 4
        k1 = slope(r, t)
        k2 = slope(r + h / 2 * k1[0], t + h / 2 * k1[1])
        k3 = slope(r + h / 2 * k2[0], t + h / 2 * k2[1])
        k4 = slope(r + h * k3[0], t + h * k3[1])
        r = r + h / 6 * (k1[0] + 2 * k2[0] + 2 * k3[0] + k4[0])
        t = t + h / 6 * (k1[1] + 2 * k2[1] + 2 * k3[1] + k4[1])
    for _ in range(doublings):
        between = t @ np.linalg.inv(unit - r @ r)
        r, t = r + between @ r @ t, between @ t
    # The boundary below, then the one above; radiance is counted over the index squared.
    f = np.diag(nodes.fresnel)
    between = np.linalg.inv(unit - r @ f)
    r, t = r + t @ f @ between @ t, (unit - f) @ between @ t
    entering = 1 - nodes.fresnel
    down = np.linalg.solve(unit - f @ r, entering)
    up = nodes.fresnel + entering * (r @ down)
    return up[nodes.asked], (t @ down)[nodes.asked]


def discrete_ordinates(tau: float, albedo: float, g: float, eta: float, mu: Sequence[float],
                       n: int = 40) -> tuple[Array, Array]:  # fmt: skip
    """The same as `adding_doubling` by eigenvectors; albedo must be below 1."""
    nodes = _Nodes(n, eta, mu)
    m = nodes.inside
    sine = np.sqrt(1 - m * m)
    phi = (np.arange(96) + 0.5) / 96 * math.pi
    turn = np.multiply.outer(sine[:, None] * sine, np.cos(phi))
    straight = (m[:, None] * m)[..., None]
    forward, backward = (
        ((1 - g * g) / (1 + g * g - 2 * g * (turn + sign * straight)) ** 1.5).mean(axis=-1)
        for sign in (1, -1)
    )
    # what the rule loses of the phase function is given back to the direction itself
    total = nodes.weights @ (forward + backward) / 2
    forward = forward + np.diag(
        np.where(nodes.weights > 0, 2 * (1 - total) / np.maximum(nodes.weights, 1e-300), 0.0)
    )
    a, b = nodes.transfer(albedo, forward, backward)
    # U + D = s, U - D = d: s' = (A + B) d, d' = (A - B) s
    square, x = np.linalg.eig((a + b) @ (a - b))
    k = np.sqrt(square.real)
    x = x.real
    y = np.linalg.solve(a + b, x * k)
    fade = np.exp(-k * tau)
    # s = x (p e^-k(t) + q e^-k(tau - t)), d = y (-p e^-k(t) + q e^-k(tau - t))
    up_top = np.hstack([x - y, (x + y) * fade]) / 2
    down_top = np.hstack([x + y, (x - y) * fade]) / 2
    up_low = np.hstack([(x - y) * fade, x + y]) / 2
    down_low = np.hstack([(x + y) * fade, x - y]) / 2
    f = nodes.fresnel[:, None]
    system = np.vstack([down_top - f * up_top, up_low - f * down_low])
    enters = 1 - nodes.fresnel
    weights = np.linalg.solve(system, np.append(enters, np.zeros_like(enters)))
    up = nodes.fresnel + enters * (up_top @ weights)
    down = enters * (down_low @ weights)
    return up[nodes.asked], down[nodes.asked]
