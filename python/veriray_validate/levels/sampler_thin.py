"""Level 2: the thin principled sheet, against its formulas in float64 (../principled_thin.py).

Grey, as the hooks take it; colours: tests/python/test_principled_thin.py and the pictures of level
5.
"""

from __future__ import annotations

import functools
import itertools
from typing import Any

import numpy as np
import numpy.typing as npt

from veriray_validate.levels.sampler_materials import Grey, evaluated, hemisphere, sampled, view
from veriray_validate.levels.sampler_principled import in_cells, shares_of_cells
from veriray_validate.levels.sampler_rough import Exact, agree, reciprocal
from veriray_validate.levels.samplers import N, random_numbers
from veriray_validate.oracles import CORNERS, single
from veriray_validate.principled_thin import Sheet, lobes
from veriray_validate.trial import Trial, case

Array = npt.NDArray[Any]
WHITE = (1.0, 1.0, 1.0)
SHEETS = {
    "default": Sheet(),
    "leaf": Sheet((0.6,) * 3, diff_trans=1.2, roughness=0.8, sheen=0.4),
    "paper": Sheet(WHITE, diff_trans=1.0, roughness=1.0, flatness=0.6),
    "lampshade": Sheet(WHITE, diff_trans=2.0),
    "cloth": Sheet((0.3,) * 3, sheen=1.0, sheen_tint=0.5, diff_trans=0.5),
    "frosted pane": Sheet(WHITE, spec_trans=1.0, roughness=0.8),
    "tinted pane": Sheet((0.5,) * 3, 1.7, spec_trans=1.0, spec_tint=0.6),
    "thick film": Sheet((0.9,) * 3, 2.4, spec_trans=0.8, roughness=0.6, diff_trans=0.8),
    "bubble": Sheet((0.8,) * 3, 0.8, spec_trans=0.9, roughness=0.7),
    "no interface": Sheet((0.8,) * 3, 1.0, spec_trans=0.7, roughness=1.0),
    "brushed pane": Sheet(WHITE, spec_trans=1.0, roughness=0.9, anisotropic=0.7),
    "everything": Sheet((0.6,) * 3, 1.7, 0.7, 0.5, 0.4, 0.6, 0.5, 0.7, 0.3, 1.4),
}
#: Of slopes wide enough for the cells of a histogram, behind too.
BROAD = tuple(
    name
    for name, p in SHEETS.items()
    if not p.spec_trans or min(*p.alphas(True), *p.alphas(False)) > 0.15
)
ANGLES = (0.0, 30.0, 60.0, 80.0, 89.0)


def grey(p: Sheet) -> Grey:
    """As the hooks take it."""
    return Grey("principledthin", p.base[0], eta=p.eta, shares=p.shares)


def rounded(p: Sheet) -> Sheet:
    """With the float32 numbers that the core has."""
    base, *rest = vars(p).values()
    value, *others = (float(x) for x in single(np.array([base[0], *rest])))
    return Sheet((value,) * 3, *others)


def formulas(p: Sheet) -> Exact:
    """As of rough surfaces."""

    def told(wo: Array, wi: Array, off: float) -> Array:
        value, density = lobes(rounded(p), wo, wi, off)
        return np.stack([value[:, 0], density])

    return told


@case(2, each={"name": SHEETS, "front": (True, False)})
def thin_weights(t: Trial, name: str, front: bool) -> None:
    """eval, sample and density agree with each other and with the formulas, on both sides.

    Five angles: at the sampled directions density and f cos, of samples weight times density,
    within what rounding does to float64 there; 0 on the wrong side.
    """
    p = SHEETS[name]
    for angle in ANGLES:
        wo, frame = view(angle)
        s = sampled(t, grey(p), front, wo, *random_numbers(t, 4000)[1:], importance=True)
        t.check(np.isfinite(s), "not finite")
        t.check(np.abs(np.linalg.norm(s[:, :3], axis=1) - 1).max() < 1e-6, "length")
        t.check((s[:, 3] >= 0) & (s[:, 4] >= 0), "negative")
        t.check(s[:, 3] == s[:, 8], "importance")
        cosine = s[:, :3] @ frame[2]
        right = (cosine < 0) == (s[:, 5] > 0)
        t.check(s[~right, 3] == 0, "weight on the wrong side")
        steady = (s[:, 4] > 0) & (np.abs(cosine) > 2.0**-18)
        t.check(steady.sum() > 100, "nothing sampled")
        agree(t, grey(p), front, angle, s[steady], formulas(p))


@functools.cache
def shares_of(name: str, angle: float) -> Array:
    """`shares_of_cells` of a sheet."""
    p, (wo, frame) = SHEETS[name], view(angle)

    def density(net: Array) -> Array:
        return lobes(rounded(p), np.broadcast_to(wo @ frame.T, net.shape), net)[1]

    return shares_of_cells(density, (1, -1))


@case(2, each={"name": BROAD, "angle": (20.0, 70.0)})
def thin_directions(t: Trial, name: str, angle: float) -> None:
    """Directions of samples against the exact density, in 20 x 20 cells of a hemisphere.

    Cells by midpoints; those of fewer than 20 samples are one; so are samples lost.
    10^5 samples: sees 4 % of one direction in ten.
    """
    p, n, (wo, frame) = SHEETS[name], N * t.effort, view(angle)
    s = sampled(t, grey(p), True, wo, *random_numbers(t, n)[1:])
    local = s[s[:, 4] > 0, :3] @ frame.T
    in_cells(t, local, n, shares_of(name, angle), (1, -1), f"{name} at {angle}", 1e-9)


@case(2, each={"name": [name for name, p in SHEETS.items() if p.diff_trans < 2]})
def thin_reciprocity(t: Trial, name: str) -> None:
    """f(a, b) = f(b, a) of reflection, 10^5 pairs, within what rounding does.

    Of what goes through, the mirrors' part is not reciprocal, as in Mitsuba.
    """
    reciprocal(t, grey(SHEETS[name]), lambda front: formulas(SHEETS[name]))


@case(2, each={"name": BROAD})
def thin_both_ways(t: Trial, name: str) -> None:
    """The mean weight of samples is the integral of f cos over directions, within 2 %."""
    p = SHEETS[name]
    x = (np.arange(64) + 0.5) / 64
    u, v, lobe = (a.ravel() for a in np.meshgrid(x, x, x))
    for angle in (0.0, 30.0, 60.0, 80.0):
        wo, frame = view(angle)
        net, weights = hemisphere(frame, 256)
        told = sum(float(weights @ evaluated(t, grey(p), True, wo, k * net)[:, 0]) for k in (1, -1))
        found = float(sampled(t, grey(p), True, wo, u, v, lobe)[:, 3].mean())
        t.check(abs(found - told) <= 0.02 * told, f"{found} for {told} at {angle}")


@case(2, each={"name": ("frosted pane", "brushed pane", "lampshade")})
def thin_energy(t: Trial, name: str) -> None:
    """White sheets of mirrors, or of diffuse light behind, return no more than they get.

    Mean weight below 1.005, 64 x 64 x 32 random numbers, five angles; that of the diffuse light is
    1 within 1e-6.
    """
    p = SHEETS[name]
    x = (np.arange(64) + 0.5) / 64
    u, v, lobe = (a.ravel() for a in np.meshgrid(x, x, (np.arange(32) + 0.5) / 32))
    for angle in ANGLES:
        found = sampled(t, grey(p), True, view(angle)[0], u, v, lobe)[:, 3].mean()
        t.check(found < 1.005, f"{found} at {angle}")
        if not p.spec_trans:
            t.check(abs(found - 1) < 1e-6, f"{found} at {angle}")


@case(2, each={"name": SHEETS})
def thin_corners(t: Trial, name: str) -> None:
    """Samples for random numbers at the end of their range, roughness from 0 to 1.

    u, v, lobe in {0, 2^-24, 1/2, 1 - 2^-24}, angles up to 89.9999 degrees: unit directions (1e-5),
    finite weights and densities, none of them negative.
    """
    u, v, lobe = np.array(list(itertools.product(CORNERS, repeat=3))).T
    for roughness, angle in itertools.product((0.0, 0.1, 1.0), (*ANGLES, 89.99, 89.9999)):
        p = Sheet(**{**vars(SHEETS[name]), "roughness": roughness})
        wo, _ = view(angle)
        s = sampled(t, grey(p), True, wo, u, v, lobe, importance=True)
        t.check(np.isfinite(s), f"not finite at {angle}, roughness {roughness}")
        t.check(np.abs(np.linalg.norm(s[:, :3], axis=1) - 1).max() < 1e-5, "length")
        t.check((s[:, 3] >= 0) & (s[:, 4] >= 0), "negative")
        e = evaluated(t, grey(p), True, wo, s[:, :3])
        t.check(np.isfinite(e), f"eval not finite at {angle}, roughness {roughness}")
        t.check((e[:, 0] >= 0) & (e[:, 1] >= 0), "negative eval")
