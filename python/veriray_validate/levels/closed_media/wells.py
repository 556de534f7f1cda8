"""Fog in wells of mirrors, which are slabs without end; half spaces that lose all or nothing."""

from __future__ import annotations

import math

import numpy as np

from veriray_validate.dicts import (
    BLACK,
    MIRROR,
    NULL,
    Dict,
    cuboid,
    diffuse,
    flat,
    glass,
    medium,
    scene,
    sky,
    sphere,
    view,
)
from veriray_validate.form_factors import gauss
from veriray_validate.levels.closed_media.grids import box_of, heterogeneous
from veriray_validate.levels.closed_media.slabs import ALBEDOS, at
from veriray_validate.transfer import adding_doubling, chandrasekhar
from veriray_validate.trial import Trial, case

#: Where faces meet: pieces along x, y and z, the floor's height, how far walls go on below it, the
#: camera's distance and its place along y.
PLACES: dict[str, tuple[tuple[int, int, int], float, float, float, float]] = {
    "middle": ((2, 2, 2), -1.0, 0.0, 40.0, 0.1),
    "many": ((4, 4, 2), -1.0, 0.0, 40.0, 0.1),
    "layers": ((1, 1, 4), -1.0, 0.0, 40.0, 0.1),
    "floor": ((1, 1, 1), 0.0, 2.0, 40.0, 0.1),
    "eye": ((1, 2, 1), 0.0, 2.0, 3.0, 0.0),
    "apart": ((3, 3, 3), -1.0, 0.0, 4.0, 0.1),
}


def pieces(low: float, counts: tuple[int, int, int], fog: Dict) -> list[Dict]:
    """The box from (-1, -1, low) to (1, 1, low + 2) cut into boxes of one fog."""
    x, y, z = (np.linspace(a, a + 2, n + 1) for a, n in zip((-1, -1, low), counts, strict=True))
    return [
        cuboid([x[i], y[j], z[k]], [x[i + 1], y[j + 1], z[k + 1]], NULL, interior=fog)
        for i in range(counts[0])
        for j in range(counts[1])
        for k in range(counts[2])
    ]


@case(3, each={"place": PLACES, "mu": (0.9, 0.5)}, quick=lambda place, mu: mu == 0.9)
def fog_in_pieces(t: Trial, place: str, mu: float) -> None:
    """Fog in pieces that share faces, in a well with sides and floor of mirrors, in a sky of 1.

    Mirrors make it a slab of twice the thickness, seen from both sides: its reflectance and its
    transmittance together, by adding-doubling. Faces meet at the origin from which lengths are
    measured, the middle of what a far camera sees or a near camera's own place, and beside it; in
    few primitives and in a tree. Albedo .5, .9 and .99, g = .4, tau = 1.2. Sees 1 %.
    """
    counts, bottom, below, distance, aside = PLACES[place]
    tau, g = 1.2, 0.4
    exact = np.array([np.sum(adding_doubling(2 * tau, w, g, 1.0, [mu])) for w in ALBEDOS.tolist()])
    fog = medium(tau / 2, ALBEDOS, g)
    walls = [
        flat("rectangle", [-x, -y, bottom + 1 - below / 2], [x, y, 0], (1, 1 + below / 2), MIRROR)
        for x, y in ((1, 0), (-1, 0), (0, 1), (0, -1))
    ]
    ground = flat("rectangle", [0, 0, bottom], [0, 0, 1], 1, MIRROR)
    target = np.array([0.15, aside, bottom + 2])
    seen = view(target + at(mu) * distance / 5, target, 1e-3)
    t.agrees(scene(seen, *walls, ground, *pieces(bottom, counts, fog), sky(1)), exact, 60_000,
             sees=0.015, margin=2e-4)  # fmt: skip


@case(3, each={"extinction": ("number", "grid")})
def dim_colours_without_roulette(t: Trial, extinction: str) -> None:
    """A half space of albedo .003, 0 and .002 in three extinctions, no roulette, in a sky of 1.

    Chandrasekhar's 1 - H(1) sqrt(1 - w). Throughputs fall below 2^-128 after 16 scatterings,
    beside a colour of 0; no sample may be refused (exact). Sees 3 %.
    """
    albedo, sigma = [0.003, 0.0, 0.002], np.array([1.0, 2.0, 1.5])
    exact = [1 - chandrasekhar(w, [1.0])[0] * math.sqrt(1 - w) for w in albedo]
    exact[1] = 0.0
    fog = medium(sigma, albedo)
    if extinction == "grid":
        cells = np.broadcast_to(sigma, (1, 1, 2, 3))
        fog = heterogeneous(box_of([-40, -40, -40], [40, 40, 0], cells), albedo)
    ground = cuboid([-40, -40, -40], [40, 40, 0], NULL, interior=fog)
    seen = scene(view(at(1.0), [0, 0, 0]), ground, sky(1), rr_depth=10**6)
    t.agrees(seen, exact, 200_000, sees=0.04)


#: H of isotropic scattering without loss; S. Chandrasekhar, Radiative Transfer, 1950, table XI.
MILNE = {1.0: 2.9078, 0.5: 2.0128, 0.1: 1.2474}
#: Hopf's function far from the surface; E. Hopf, 1934.
DEEP = 0.71044609


@case(3, each={"mu": MILNE}, quick=lambda mu: mu == 0.5)
def milne_problem(t: Trial, mu: float) -> None:
    """Light from far below a lossless isotropic half space, as a slab of tau = 8 over a lamp of 1.

    sqrt(3) / 4 H(mu) of the flux, 4/3 / (tau + 2 x .71044609); H by Hopf's integral, and from
    Chandrasekhar's table. Adding-doubling agrees to 1e-4. Sees 4 %.
    """
    tau = 8.0
    # log H = -mu / pi integral of log(1 - arctan k / k) / (1 + mu^2 k^2) dk
    x, w = gauss(300, 0, math.pi / 2)
    k = np.tan(x)
    kernel = np.log(1 - np.arctan(k) / k) * (1 + k * k) / (1 + (mu * k) ** 2)
    h = math.exp(-mu / math.pi * float(w @ kernel))
    t.check(abs(h - MILNE[mu]) < 6e-5, f"H = {h}")
    exact = math.sqrt(3) / 4 * h * 4 / 3 / (tau + 2 * DEEP)
    other = adding_doubling(tau, 1.0, 0.0, 1.0, [mu])[1][0]
    t.check(abs(exact / other - 1) < 1e-4, f"{exact} and {other}")
    slab = cuboid([-1000, -1000, -tau], [1000, 1000, 0], NULL, interior=medium(1.0, 1.0))
    lamp = flat("rectangle", [0, 0, -tau - 1], [0, 0, 1], 5000, BLACK, 1)
    t.agrees(scene(view(at(mu), [0, 0, 0], 1e-3), slab, lamp), exact, 100_000, sees=0.05,
             margin=2e-4)  # fmt: skip


@case(3, each={"of": ("glass", "wall"), "first": ("ink", "other")})
def ink_in_spheres_of_its_size(t: Trial, of: str, first: str) -> None:
    """A ball of ink in a glass ball of the same size, and in a shining round room of that size.

    Through the middle of the glass r + (1 - r)^2 e / (1 - r e), r = .04, e = exp(-2 sigma). From
    the middle of the room B exp(-sigma), B = 1 / (1 - m / 2) with albedo .5 and m the mean of
    exp(-2 sigma mu) by the cosine law. Sees 2 %.
    """
    sigma = np.array([0.3, 1.0, 2.0])
    ink = medium(sigma, 0.0)
    ball = sphere([0, 0, 0], 1, NULL, interior=ink)
    if of == "glass":
        e, r = np.exp(-2 * sigma), 0.04
        exact = r + (1 - r) ** 2 * e / (1 - r * e)
        other, lights = sphere([0, 0, 0], 1, glass(1.5)), [sky(1)]
        eye = view([0, 0, 5], [0, 0, 0], 1e-3)
    else:
        s = 2 * sigma
        exact = np.exp(-sigma) / (1 - (1 - (1 + s) * np.exp(-s)) / s**2)
        other, lights = sphere([0, 0, 0], 1, diffuse(0.5), 1, flip_normals=True), []
        eye = view([0, 0, 0], [0.3, 0.2, 1], 1e-3, medium=ink)
    bodies = [ball, other] if first == "ink" else [other, ball]
    t.agrees(scene(eye, *bodies, *lights), exact, 200_000, sees=0.03, margin=1e-4)
