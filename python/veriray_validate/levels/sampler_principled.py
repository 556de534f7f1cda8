"""Level 2: the principled surface, against its formulas in float64 (../principled.py).

Grey, as the hooks take it; colours: tests/python/test_principled.py and the pictures of level 5.
"""

from __future__ import annotations

import functools
import itertools
import math
from collections.abc import Callable
from typing import Any

import numpy as np
import numpy.typing as npt

from veriray_validate.levels.sampler_materials import (
    Grey,
    evaluated,
    hemisphere,
    sampled,
    view,
)
from veriray_validate.levels.sampler_rough import Exact, agree, reciprocal
from veriray_validate.levels.samplers import N, count, random_numbers, uniform
from veriray_validate.oracles import CORNERS, single
from veriray_validate.principled import Principled, lobes
from veriray_validate.trial import Trial, case

Array = npt.NDArray[Any]
WHITE = (1.0, 1.0, 1.0)
SURFACES = {
    "default": Principled(),
    "chalk": Principled(WHITE, roughness=1.0),
    "no interface": Principled(eta=1.0),
    "thinner inside": Principled(eta=0.7, spec_tint=0.5, roughness=0.4),
    "metal": Principled((0.9,) * 3, metallic=1.0, roughness=0.3),
    "half metal": Principled((0.3,) * 3, metallic=0.5, spec_tint=0.7),
    "cloth": Principled((0.3,) * 3, sheen=1.0, sheen_tint=0.5, roughness=0.8),
    "flat": Principled((0.8,) * 3, flatness=0.7, roughness=0.7),
    "lacquer": Principled((0.2,) * 3, clearcoat=1.0, roughness=0.6),
    "gloss": Principled((0.2,) * 3, clearcoat=0.7, clearcoat_gloss=0.5, roughness=0.6),
    "coat alone": Principled((0.0,) * 3, 1.0, clearcoat=1.0),
    "fine coat alone": Principled((0.0,) * 3, 1.0, clearcoat=1.0, clearcoat_gloss=0.9),
    "black": Principled((0.0,) * 3, 1.0, metallic=1.0),
    "glass": Principled(WHITE, spec_trans=1.0, roughness=0.5),
    "tinted glass": Principled((0.5,) * 3, 1.3, spec_trans=1.0, roughness=0.3),
    "veiled glass": Principled((0.5,) * 3, spec_trans=1.0, sheen=1.0, roughness=0.6),
    "diamond": Principled(WHITE, 2.4, spec_trans=1.0, roughness=0.7),
    "bubble": Principled((0.8,) * 3, 0.8, spec_trans=0.9, roughness=0.6),
    "everything": Principled((0.6,) * 3, 1.7, 0.6, 0.3, 0.5, 0.4, 0.6, 0.5, 0.3, 0.8, 0.1),
    "brushed metal": Principled((0.7,) * 3, roughness=0.6, metallic=1.0, anisotropic=0.7),
    "brushed glass": Principled(WHITE, spec_trans=1.0, roughness=0.8, anisotropic=0.6),
    "finely brushed": Principled((0.3,) * 3, roughness=0.2, metallic=0.5, anisotropic=0.9),
}  # fmt: skip
OPEN = tuple(name for name, p in SURFACES.items() if p.open)
#: A surface and the side that it is seen from.
SIDES = {name: (name, True) for name in SURFACES}
SIDES |= {f"{name} from behind": (name, False) for name in OPEN}
COATS = ("coat alone", "fine coat alone")
#: Without spikes narrower than the cells of a histogram.
BROAD = tuple(
    side
    for side, (name, _) in SIDES.items()
    if name != "black" and not SURFACES[name].clearcoat and SURFACES[name].roughness > 0.45
)
#: Without sheen and diffuse parts, which return more than they get at grazing angles.
FRUGAL = ("metal", *COATS, "glass", "glass from behind", "tinted glass", "diamond from behind")
ANGLES = (0.0, 30.0, 60.0, 80.0, 89.0)


def grey(p: Principled) -> Grey:
    """As the hooks take it."""
    kind = "principled_open" if p.open else "principled"
    return Grey(kind, p.base[0], eta=p.eta, shares=p.shares)


def rounded(p: Principled) -> Principled:
    """With the float32 numbers that the core has."""
    base, eta, *shares = vars(p).values()
    numbers = (float(x) for x in single(np.array([base[0], eta, *shares])))
    value, *others = numbers
    return Principled((value,) * 3, *others)


def formulas(p: Principled, front: bool) -> Exact:
    """As of rough surfaces."""

    def told(wo: Array, wi: Array, off: float) -> Array:
        value, density = lobes(rounded(p), wo, wi, front, off=off)
        return np.stack([value[:, 0], density])

    return told


@case(2, each={"side": SIDES})
def principled_weights(t: Trial, side: str) -> None:
    """eval, sample and density agree with each other and with the formulas.

    Five angles: at the sampled directions density and f cos, of samples weight times density,
    within what rounding does to float64 there (half below 3e-5); 0 on the wrong side.
    """
    name, front = SIDES[side]
    p = SURFACES[name]
    for angle in ANGLES:
        wo, frame = view(angle)
        s = sampled(t, grey(p), front, wo, *random_numbers(t, 4000)[1:], importance=True)
        t.check(np.isfinite(s), "not finite")
        t.check(np.abs(np.linalg.norm(s[:, :3], axis=1) - 1).max() < 1e-6, "length")
        t.check((s[:, 3] >= 0) & (s[:, 4] >= 0), "negative")
        cosine = s[:, :3] @ frame[2]
        right = (cosine < 0) == (s[:, 5] > 0)
        t.check(s[~right, 3] == 0, "weight on the wrong side")
        steady = (s[:, 4] > 0) & (np.abs(cosine) > 2.0**-18)
        if name == "black":
            t.check(~steady, "a density where nothing is sampled")
            continue
        t.check(steady.sum() > 100, "nothing sampled")
        agree(t, grey(p), front, angle, s[steady], formulas(p, front))
        if not p.open:
            below = evaluated(t, grey(p), front, wo, -s[steady, :3])
            t.check(below[:, :2] == 0, "from below")


#: Cells of a hemisphere along its height and around it; midpoints in each, along both. Densities
#: end at heights where light is reflected totally: by 24 midpoints a cell is 5 % off there.
CELLS, HIGH, AROUND = 20, 96, 12


def shares_of_cells(density: Callable[[Array], Array], signs: tuple[int, ...]) -> Array:
    """Integrals over the cells of the hemispheres of `signs`, by a density of directions (n, 3)."""
    height, around = ((np.arange(n) + 0.5) / n for n in (CELLS * HIGH, CELLS * AROUND))
    shares = []
    for sign, rows in itertools.product(signs, np.split(height, CELLS)):
        z, turn = (a.ravel() for a in np.meshgrid(rows, 2 * np.pi * around, indexing="ij"))
        sine = np.sqrt(1 - z * z)
        net = np.stack([sine * np.cos(turn), sine * np.sin(turn), sign * z], axis=-1)
        cells = density(net).reshape(HIGH, CELLS, AROUND).mean(axis=(0, 2))
        shares.append(cells * 2 * np.pi / CELLS**2)
    return np.concatenate(shares)


def in_cells(t: Trial, local: Array, n: int, shares: Array, signs: tuple[int, ...],
             what: str, least: float = 0.0) -> None:  # fmt: skip
    """Tests that of n samples the kept ones, local (m, 3), fall into the cells by their shares.

    Cells of fewer than 20 samples are one; so are samples lost: those expect `least` or more.
    """
    edges, counts = np.linspace(0, 1, CELLS + 1), []
    for sign in signs:
        here = local[np.sign(local[:, 2]) == sign]
        azimuth = np.arctan2(here[:, 1], here[:, 0]) % (2 * np.pi)
        height = np.minimum(np.abs(here[:, 2]), 1)  # past rounding
        grid, _, _ = np.histogram2d(height, azimuth / (2 * np.pi), (edges, edges))
        counts.append(grid.ravel())
    told, seen = shares * n, np.concatenate(counts)
    many = told >= 20
    told = np.append(told[many], max(n - told[many].sum(), least))
    seen = np.append(seen[many], n - seen[many].sum())
    t.p(chi_square(seen, told), what)


@functools.cache
def shares_of(side: str, angle: float) -> Array:
    """`shares_of_cells` of a surface."""
    name, front = SIDES[side]
    p, (wo, frame) = SURFACES[name], view(angle)

    def density(net: Array) -> Array:
        return lobes(rounded(p), np.broadcast_to(wo @ frame.T, net.shape), net, front)[1]

    return shares_of_cells(density, (1, -1) if p.open else (1,))


@case(2, each={"side": BROAD, "angle": (20.0, 70.0)})
def principled_directions(t: Trial, side: str, angle: float) -> None:
    """Directions of samples against the exact density, in 20 x 20 cells of a hemisphere.

    Cells by midpoints; those of fewer than 20 samples are one; so are samples lost.
    10^5 samples: sees 4 % of one direction in ten.
    """
    name, front = SIDES[side]
    p = SURFACES[name]
    n, (wo, frame) = N * t.effort, view(angle)
    s = sampled(t, grey(p), front, wo, *random_numbers(t, n)[1:])
    local = s[s[:, 4] > 0, :3] @ frame.T
    signs = (1, -1) if p.open else (1,)
    in_cells(t, local, n, shares_of(side, angle), signs, f"{side} at {angle}")


def chi_square(seen: Array, told: Array) -> float:
    """P-value, by Wilson and Hilferty's cube root."""
    keep = told > 0
    value, free = float(((seen - told)[keep] ** 2 / told[keep]).sum()), int(keep.sum()) - 1
    z = ((value / free) ** (1 / 3) - (1 - 2 / (9 * free))) / np.sqrt(2 / (9 * free))
    return math.erfc(float(z) / math.sqrt(2)) / 2


@case(2, each={"name": COATS, "angle": (0.0, 45.0)})
def coat_directions(t: Trial, name: str, angle: float) -> None:
    """The coat's small mirrors follow its distribution, by the inverse of its sampling.

    Those that reflect however they are turned, 0.6 of them and more, whose share is tested by an
    exact binomial. 10^5 samples: sees 1 % in scale, 4 % in tilt, 0.7 % lost (absolute). None goes
    below the horizon.
    """
    p, (wo, frame) = SURFACES[name], view(angle)
    n = N * t.effort
    s = sampled(t, grey(p), True, wo, *random_numbers(t, n)[1:])
    local = s[:, :3] @ frame.T
    kept = s[:, 4] > 0
    t.check(local[kept, 2] > -(2.0**-22), "light from below")  # the cosine's rounding
    h = local + wo @ frame.T
    tilt = (h[:, 0] ** 2 + h[:, 1] ** 2) / (h**2).sum(axis=1)
    a2 = float(single(p.coat_alpha)) ** 2
    u = 1 - np.log(tilt * (1 - a2) + a2) / np.log(a2)
    turn = np.arctan2(h[:, 1], h[:, 0]) / (2 * np.pi) % 1
    # all mirrors within this tilt reflect wo upwards
    edge = np.sin(np.radians((90 - angle) / 2)) ** 2
    cut = 1 - np.log(edge * (1 - a2) + a2) / np.log(a2)
    inside = kept & (u < cut)
    count(t, int(inside.sum()), n, float(cut), "share")
    uniform(t, u[inside] / cut, turn[inside], name)


@case(2, each={"side": [side for side, (name, _) in SIDES.items() if name != "black"]})
def principled_reciprocity(t: Trial, side: str) -> None:
    """f(a, b) = f(b, a) of reflection on either side, 10^5 pairs, within what rounding does."""
    name, front = SIDES[side]
    p = SURFACES[name]
    reciprocal(t, grey(p), lambda front: formulas(p, front), front)


@case(2, each={"name": OPEN})
def principled_reciprocity_of_refraction(t: Trial, name: str) -> None:
    """f(a, b) / n_b^2 = f(b, a) / n_a^2 across the surface, 10^5 pairs, within rounding."""
    p = SURFACES[name]
    reciprocal(t, grey(p), lambda front: formulas(p, front), across=True)


@case(2, each={"side": FRUGAL})
def principled_energy(t: Trial, side: str) -> None:
    """Metal, glass and coat return no more than they get: mean weight of importance below 1.005.

    64 x 64 x 32 random numbers, five angles. Burley's diffuse part and the sheen do return more.
    """
    name, front = SIDES[side]
    p = SURFACES[name]
    x = (np.arange(64) + 0.5) / 64
    u, v, lobe = (a.ravel() for a in np.meshgrid(x, x, (np.arange(32) + 0.5) / 32))
    for angle in ANGLES:
        s = sampled(t, grey(p), front, view(angle)[0], u, v, lobe, importance=True)
        t.check(s[:, 8].mean() < 1.005, f"{s[:, 8].mean()} at {angle}")


@case(2, each={"side": BROAD})
def principled_both_ways(t: Trial, side: str) -> None:
    """The mean weight of samples is the integral of f cos over directions, within 2 %."""
    name, front = SIDES[side]
    p = SURFACES[name]
    x = (np.arange(64) + 0.5) / 64
    u, v, lobe = (a.ravel() for a in np.meshgrid(x, x, x))
    for angle in (0.0, 30.0, 60.0, 80.0):
        wo, frame = view(angle)
        net, weights = hemisphere(frame, 256)
        sides = (1, -1) if p.open else (1,)
        told = sum(float(weights @ evaluated(t, grey(p), front, wo, k * net)[:, 0])
                   for k in sides)  # fmt: skip
        found = float(sampled(t, grey(p), front, wo, u, v, lobe)[:, 3].mean())
        t.check(abs(found - told) <= 0.02 * told, f"{found} for {told} at {angle}")


@case(2, each={"side": SIDES})
def principled_corners(t: Trial, side: str) -> None:
    """Samples for random numbers at the end of their range, roughness from 0 to 1.

    u, v, lobe in {0, 2^-24, 1/2, 1 - 2^-24}, angles up to 89.9999 degrees: unit directions (1e-5),
    finite weights and densities, none of them negative.
    """
    name, front = SIDES[side]
    u, v, lobe = np.array(list(itertools.product(CORNERS, repeat=3))).T
    for roughness, angle in itertools.product((0.0, 0.1, 1.0), (*ANGLES, 89.99, 89.9999)):
        p = Principled(**{**vars(SURFACES[name]), "roughness": roughness})
        wo, _ = view(angle)
        s = sampled(t, grey(p), front, wo, u, v, lobe, importance=True)
        t.check(np.isfinite(s), f"not finite at {angle}, roughness {roughness}")
        t.check(np.abs(np.linalg.norm(s[:, :3], axis=1) - 1).max() < 1e-5, "length")
        t.check((s[:, 3] >= 0) & (s[:, 4] >= 0), "negative")
        e = evaluated(t, grey(p), front, wo, s[:, :3])
        t.check(np.isfinite(e), f"eval not finite at {angle}, roughness {roughness}")
        t.check((e[:, 0] >= 0) & (e[:, 1] >= 0), "negative eval")
