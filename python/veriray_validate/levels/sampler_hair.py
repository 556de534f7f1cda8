"""Level 2: hair, against its formulas in float64 (../hair.py).

Grey, as the hooks take it; colours: tests/python/test_hair.py, and the picture of level 5.
"""

from __future__ import annotations

import functools
import itertools
from dataclasses import astuple, replace
from typing import Any

import numpy as np
import numpy.typing as npt

from veriray_validate.hair import Fibre, Seen, light, lobes, seen_from
from veriray_validate.levels.sampler_materials import Grey, evaluated, hemisphere, sampled, view
from veriray_validate.levels.sampler_principled import in_cells, shares_of_cells
from veriray_validate.levels.sampler_rough import PRODUCTS, Exact, agree, pairs, rounding
from veriray_validate.levels.samplers import N, hooked, random_numbers, random_points
from veriray_validate.oracles import CORNERS, single
from veriray_validate.trial import Trial, case

Array = npt.NDArray[Any]


def dyed(absorption: float, *numbers: float) -> Fibre:
    """Grey hair."""
    return Fibre((absorption,) * 3, *numbers)


#: Absorption, index, variance along, scale around, sine of the scales' tilt.
FIBRES = {
    "clear": dyed(0.0, 1.5496, 0.0846, 0.117, 0.0349),
    "brown": dyed(0.6, 1.5496, 0.0846, 0.117, 0.0349),
    "black": dyed(8.0, 1.5496, 0.0846, 0.117, 0.0349),
    "tilted": dyed(0.2, 1.5496, 0.15, 0.3, -0.3),
    "broad": dyed(0.4, 1.5496, 27.4, 4.28, 0.1),
    "fine": dyed(0.3, 1.5496, 1e-4, 0.005, 0.05),
    "finest": dyed(0.0, 1.3, 1e-6, 1e-3, 0.0),
    "dense": dyed(0.0, 2.4, 0.2, 0.2, 0.02),
    "no interface": dyed(0.5, 1.0, 0.1, 0.2, 0.05),
    "thinner inside": dyed(0.3, 0.8, 0.1, 0.2, 0.05),
}
CLEAR = ("clear", "finest", "dense")
#: Of lobes wide enough for the cells of a histogram.
BROAD = tuple(name for name, p in FIBRES.items() if p.along > 0.01)
ANGLES = (0.0, 30.0, 60.0, 80.0, 89.0)


def grey(p: Fibre) -> Grey:
    """As the hooks take it."""
    return Grey("hair", eta=p.eta, k=p.absorption[0], alpha=p.along, across=p.around, ggx=p.tilt)


def rounded(p: Fibre) -> Fibre:
    """With the float32 numbers that the core has."""
    absorption, *others = astuple(p)
    value, *rest = (float(x) for x in single(np.array([absorption[0], *others])))
    return dyed(value, *rest)


def formulas(p: Fibre) -> Exact:
    """As of rough surfaces. They keep what they made of the last wo."""
    one = replace(rounded(p), absorption=rounded(p).absorption[:1])  # channels are alike
    kept: list[tuple[Array, float, Seen]] = []

    def told(wo: Array, wi: Array, off: float) -> Array:
        if not kept or kept[0][0] is not wo or kept[0][1] != off:
            kept[:] = [(wo, off, seen_from(one, wo, off))]
        value, density = lobes(one, wo, wi, off, kept[0][2])
        return np.stack([value[:, 0], density])

    return told


@case(2, each={"name": FIBRES})
def hair_weights(t: Trial, name: str) -> None:
    """eval, sample and density agree with each other and with the formulas.

    Five angles: at the sampled directions density and f cos, of samples weight times density,
    within what rounding does to float64 there; the weight is that of all lobes, within 1e-5.
    """
    p = FIBRES[name]
    for angle in ANGLES:
        wo, frame = view(angle)
        s = sampled(t, grey(p), True, wo, *random_numbers(t, 4000)[1:], importance=True)
        t.check(np.isfinite(s), "not finite")
        t.check(np.abs(np.linalg.norm(s[:, :3], axis=1) - 1).max() < 1e-6, "length")
        t.check((s[:, 3] >= 0) & (s[:, 4] > 0), "negative, or no density")
        t.check(s[:, 3] == s[:, 8], "importance")
        t.check((s[:, :3] @ frame[2] < 0) == (s[:, 5] > 0), "side")
        t.check(s[:, 6] == 0, "passes")
        whole = float(light(rounded(p), wo @ frame.T)[:, 0].sum())
        t.check(np.abs(s[:, 3] - whole).max() < 1e-5, f"weight at {angle}")
        agree(t, grey(p), True, angle, s, formulas(p))


@functools.cache
def shares_of(name: str, angle: float) -> Array:
    """`shares_of_cells` of a fibre."""
    p, (wo, frame) = FIBRES[name], view(angle)
    return shares_of_cells(lambda net: lobes(rounded(p), wo @ frame.T, net)[1], (1, -1))


@case(2, each={"name": BROAD, "angle": (20.0, 70.0)})
def hair_directions(t: Trial, name: str, angle: float) -> None:
    """Directions of samples against the exact density, in 20 x 20 cells of a hemisphere.

    Cells by midpoints; those of fewer than 20 samples are one. 10^5 samples: sees 7 % in the
    variance along, 4 % in the scale around and 0.012 in the tilt of the scales, where light is not
    spread over all directions ("broad").
    """
    p, n, (wo, frame) = FIBRES[name], N * t.effort, view(angle)
    s = sampled(t, grey(p), True, wo, *random_numbers(t, n)[1:])
    t.check(s[:, 4] > 0, "samples lost")
    in_cells(t, s[:, :3] @ frame.T, n, shares_of(name, angle), (1, -1), f"{name} at {angle}", 1e-9)
    t.sees(0.07)


@case(2)
def a_planted_lobe_is_found(t: Trial) -> None:
    """Planted: directions drawn with one number of the fibre changed.

    Variance times 1.2, scale times 1.1, tilt 0.03 more, index times 1.05: the test that accepts the
    right fibre has p < 10^-3 for each of these.
    """
    n, told = N * t.effort, shares_of("brown", 70.0)
    right, (wo, frame) = FIBRES["brown"], view(70.0)
    wrong = {
        "variance": {"along": 1.2 * right.along},
        "scale": {"around": 1.1 * right.around},
        "tilt": {"tilt": right.tilt + 0.03},
        "index": {"eta": 1.05 * right.eta},
    }
    for what, numbers in wrong.items():
        p = replace(right, **numbers)
        s = sampled(t, grey(p), True, wo, *random_numbers(t, n)[1:])
        other = Trial(t.device)
        in_cells(other, s[:, :3] @ frame.T, n, told, (1, -1), what, 1e-9)
        t.check(other.p_values[0][0] < 1e-3, f"{what}: p = {other.p_values[0][0]:.2g}")


@case(2, each={"name": FIBRES})
def hair_energy(t: Trial, name: str) -> None:
    """Hair sends on no more light than it gets, and all of it where nothing is absorbed.

    The mean weight over 16 x 16 x 64 random numbers, up to 89.99 degrees: 1 + 1e-5 at most, 1
    within 1e-5 for clear fibres. Where lobes are wide, by quadrature over all directions: of the
    density 1 within 5e-4, of f cos that weight within 5e-4.
    """
    p, x = FIBRES[name], (np.arange(16) + 0.5) / 16
    u, v, lobe = (a.ravel() for a in np.meshgrid(x, x, (np.arange(64) + 0.5) / 64))
    for angle in (*ANGLES, 89.99):
        wo, frame = view(angle)
        mean = float(sampled(t, grey(p), True, wo, u, v, lobe)[:, 3].mean())
        t.check(mean < 1 + 1e-5, f"{mean} at {angle}")
        if name in CLEAR:
            t.check(mean > 1 - 1e-5, f"{mean} at {angle}")
        if name in BROAD:
            net, weights = hemisphere(frame, 256)
            found = sum(weights @ evaluated(t, grey(p), True, wo, k * net)[:, :2] for k in (1, -1))
            t.check(abs(found[1] - 1) < 5e-4, f"density of {found[1]} at {angle}")
            t.check(abs(found[0] - mean) < 5e-4, f"{found[0]} for {mean} at {angle}")


@case(2, each={"name": FIBRES})
def hair_albedo(t: Trial, name: str) -> None:
    """The albedo for feature images is the light that goes on from the middle of a fibre."""
    p = FIBRES[name]
    for front in (True, False):
        wo, _ = view(60.0)
        told = float(evaluated(t, grey(p), front, wo, wo[None])[0, 4])
        mean = float(light(rounded(p), np.array([0.0, 0.0, 1.0]))[:, 0].sum())
        t.check(abs(told - mean) < 2e-6, f"{told} for {mean}")


@case(2, each={"name": FIBRES})
def hair_pairs(t: Trial, name: str) -> None:
    """F cos and density of 10^5 pairs of directions are those of the formulas, within rounding. Of
    less than 2^-100 of the light, where the lobes' chances are not in proportion, F cos alone.

    Pairs on either side. There is no reciprocity to test: what is absorbed, and where lobes point,
    follows from wo alone. The reverse density is that of the roles changed, to the bit.
    """
    p, n, (_, frame) = FIBRES[name], 100_000 * t.effort, view(0.0)
    a, b = single(random_points(t, "cosine_hemisphere", 2 * n) @ frame).reshape(2, n, 3)
    told = formulas(p)
    for wi in (b, -b):
        found = pairs(t, grey(p), True, a, wi)
        local = a @ frame.T, wi @ frame.T
        exact = told(*local, 0.0)
        off = np.abs(found[:, :2].T - exact)
        off[1, light(rounded(p), local[0])[..., 0].sum(axis=0) < 2.0**-100] = 0
        far = (off > PRODUCTS * exact).any(axis=0)  # others are within every bound
        bound = rounding(told, *(w[far] for w in local))
        worst = (off[:, far] / np.maximum(bound, 1e-300)).max(initial=0)
        t.check(off[:, far] <= bound + 1e-30, f"{worst:.2g} times the rounding")
    forth, back = (pairs(t, grey(p), True, *both) for both in ((a, b), (b, a)))
    t.check((forth[:, 3] == back[:, 1]) & (back[:, 3] == forth[:, 1]), "reverse density")


@case(2, each={"eta": (0.5, 1.0, 1.0 + 2.0**-23, 1.55, 1e3), "absorption": (0.0, 0.5, 1e6)})
def hair_corners(t: Trial, eta: float, absorption: float) -> None:
    """Samples for numbers at the end of their ranges, across, along and aslant to the fibre.

    u, v, lobe in {0, 2^-24, 1/2, 1 - 2^-24}, the least and largest roughness and tilt, angles up to
    89.9999 degrees: unit directions (1e-5), finite weights and densities, none of them
    negative; a weight of 1 at most, of 1 where nothing is absorbed, but for densities below 2^-100.
    """
    u, v, lobe = np.array(list(itertools.product(CORNERS, repeat=3))).T
    _, frame = view(0.0)
    shapes = itertools.product((1e-6, 100.0), (1e-3, 10.0), (-1.0, 0.0, 1.0))
    for along, around, tilt in shapes:
        p = dyed(absorption, eta, along, around, tilt)
        for angle, turn in itertools.product((0.0, 60.0, 89.9, 89.9999), (0.0, 0.9273, 1.5708)):
            sine, cosine = np.sin(np.radians(angle)), np.cos(np.radians(angle))
            wo = single(np.array([sine * np.cos(turn), sine * np.sin(turn), cosine]) @ frame)
            s = sampled(t, grey(p), True, wo, u, v, lobe, importance=True)
            where = f"at {angle}, turned by {turn}, {astuple(p)[2:]}"
            t.check(np.isfinite(s), f"not finite {where}")
            t.check(np.abs(np.linalg.norm(s[:, :3], axis=1) - 1).max() < 1e-5, f"length {where}")
            t.check((s[:, 3] >= 0) & (s[:, 4] >= 0), f"negative {where}")
            weight = s[s[:, 4] > 2.0**-100, 3]  # below, densities have few bits
            t.check(weight < 1 + 1e-5, f"{weight.max(initial=0)} {where}")
            if not absorption:
                t.check(weight > 1 - 1e-5, f"{weight.min(initial=1)} {where}")
            e = evaluated(t, grey(p), True, wo, s[:, :3])
            t.check(np.isfinite(e), f"eval not finite {where}")
            t.check((e[:, 0] >= 0) & (e[:, 1] >= 0), f"negative eval {where}")


@case(2, each={"eta": (0.5, 1.0, 1.0 + 2.0**-23, 1.55, 1e3)})
def hair_in_the_plane(t: Trial, eta: float) -> None:
    """Seen from within its plane, to the last bit: Fresnel reflects all, or nothing enters.

    Cosines of 0, 2^-100, 2^-40 and 2^-24, across, along and aslant to the fibre, clear and black:
    finite, weights of 1 at most, of 1 where nothing is absorbed, or no density.
    """
    u, v, lobe = np.array(list(itertools.product(CORNERS, repeat=3))).T
    exponents, turns = (-np.inf, -100, -40, -24), ((1.0, 0.0), (0.0, 1.0), (0.6, 0.8), (1.0, 2e-5))
    for exponent, (x, y), k in itertools.product(exponents, turns, (0.0, 0.5, 1e6)):
        fibre = grey(dyed(k, eta, 0.08, 0.12, 0.03))
        s = hooked(t, "bsdf_sample", *fibre.columns(), 0, 0, 1, x, y, 2.0**exponent, u, v, lobe)
        where = f"at a cosine of 2^{exponent}, {x, y}, absorption {k}"
        t.check(np.isfinite(s), f"not finite {where}")
        weight = s[s[:, 4] > 2.0**-100, 3]
        t.check(weight < 1 + 1e-5, f"{weight.max(initial=0)} {where}")
        if not k:
            t.check(weight > 1 - 1e-5, f"{weight.min(initial=1)} {where}")
