"""Level 2: rough surfaces: small mirrors whose slopes follow GGX or Beckmann, Smith's shadows.

Exact counterparts in float64 are built from D and G here; the hooks' rough coat lets in what a
smooth one does, and of the light at a cosine c their mirrors lose c / 4 of a metal, c / 16 of an
interface and c / 8 from behind it, linear between the cosines of the table.
"""

from __future__ import annotations

import functools
import itertools
import math
from collections.abc import Callable
from dataclasses import replace
from typing import Any

import numpy as np
import numpy.typing as npt
from scipy import special, stats

from veriray_validate.levels.sampler_materials import (
    NORMAL,
    Grey,
    evaluated,
    hemisphere,
    sampled,
    view,
)
from veriray_validate.levels.samplers import N, random_numbers, random_points, uniform
from veriray_validate.oracles import CORNERS, dot, fresnel, gauss, single
from veriray_validate.trial import Trial, case

Array = npt.NDArray[Any]
ROUGH = {
    "mirror ggx": Grey("roughconductor", eta=0.0, k=1.0, alpha=0.3, ggx=1.0),
    "mirror beckmann": Grey("roughconductor", eta=0.0, k=1.0, alpha=0.3),
    "metal, fine ggx": Grey("roughconductor", 0.0, 0.8, eta=0.2, k=3.0, alpha=0.01, ggx=1.0),
    "metal, fine beckmann": Grey("roughconductor", 0.0, 0.8, eta=0.2, k=3.0, alpha=0.01),
    "coarse ggx": Grey("roughconductor", eta=0.0, k=1.0, alpha=1.0, ggx=1.0),
    "coarse beckmann": Grey("roughconductor", eta=0.0, k=1.0, alpha=1.0),
    "glass ggx": Grey("roughdielectric", eta=1.5, alpha=0.3, ggx=1.0),
    "glass beckmann": Grey("roughdielectric", 0.0, 0.7, 0.6, eta=1.5, alpha=0.3),
    "fine glass beckmann": Grey("roughdielectric", eta=1.33, alpha=0.02),
    "diamond ggx": Grey("roughdielectric", eta=2.4, alpha=0.6, ggx=1.0),
    "plastic ggx": Grey("roughplastic", 0.5, eta=1.5, alpha=0.3, ggx=1.0),
    "plastic beckmann": Grey("roughplastic", 0.7, 0.8, eta=1.9, alpha=0.2),
    "brushed ggx": Grey("roughconductor", eta=0.0, k=1.0, alpha=0.5, across=0.15, ggx=1.0),
    "brushed beckmann": Grey("roughconductor", eta=0.0, k=1.0, alpha=0.12, across=0.6),
    "finely brushed": Grey("roughconductor", eta=0.2, k=3.0, alpha=0.5, across=1e-3, ggx=1.0),
    "brushed glass ggx": Grey("roughdielectric", eta=1.5, alpha=0.15, across=0.5, ggx=1.0),
    "brushed glass beckmann": Grey("roughdielectric", eta=1.5, alpha=0.6, across=0.2),
    "by height ggx": Grey("roughconductor", eta=0.0, k=1.0, alpha=0.7, ggx=1.0, heights=True),
    "by height beckmann": Grey("roughconductor", 0.0, 0.8, eta=0.2, k=3.0, alpha=0.4, across=0.9,
                               heights=True),
    "glass by height ggx": Grey("roughdielectric", eta=1.5, alpha=0.5, ggx=1.0, heights=True),
    "glass by height beckmann": Grey("roughdielectric", eta=1.8, alpha=0.3, heights=True),
    "plastic by height": Grey("roughplastic", 0.5, eta=1.5, alpha=0.4, ggx=1.0, heights=True),
    "whole ggx": Grey("roughconductor_whole", eta=0.0, k=1.0, alpha=0.9, ggx=1.0),
    "whole beckmann": Grey("roughconductor_whole", 0.0, 0.9, eta=0.2, k=3.0, alpha=1.2,
                           heights=True),
    "whole glass ggx": Grey("roughdielectric_whole", eta=1.5, alpha=0.9, ggx=1.0, heights=True),
    "whole glass beckmann": Grey("roughdielectric_whole", 0.0, 0.7, 0.6, eta=1.8, alpha=0.8),
}  # fmt: skip
_GLASSES = ("roughdielectric", "roughdielectric_whole")
WHOLE = tuple(name for name, grey in ROUGH.items() if grey.kind.endswith("_whole"))
MIRRORS = tuple(
    name for name, grey in ROUGH.items() if grey.kind != "roughplastic" and name not in WHOLE
)
GLASS = tuple(name for name, grey in ROUGH.items() if grey.kind in _GLASSES)
ONE_SIDE = tuple(name for name in ROUGH if name not in GLASS)
COARSE = tuple(name for name, grey in ROUGH.items() if grey.slopes.min() > 0.1)
ANGLES = (0.0, 30.0, 60.0, 80.0, 89.0)


def masking(w: Array, grey: Grey) -> Array:
    """Smith's G1 of local directions (n, 3), of Beckmann by Mitsuba's rational function."""
    u, v, _ = grey.slopes
    with np.errstate(divide="ignore"):
        a = np.abs(w[:, 2]) / np.hypot(u * w[:, 0], v * w[:, 1])
        if grey.ggx:
            exact: Array = 2 / (1 + np.sqrt(1 + 1 / a**2))
            return exact
    b = np.minimum(a, 1.6)
    return np.where(a < 1.6, (3.535 * b + 2.181 * b * b) / (1 + 2.276 * b + 2.577 * b * b), 1.0)


def in_common(wo: Array, wi: Array, grey: Grey) -> Array:
    """Smith's G2 over the product of both G1, local directions (n, 3)."""
    if not grey.heights:
        return np.ones(len(wo))
    a, b = (np.maximum(masking(w, grey), 1e-300) for w in (wo, wi))
    with np.errstate(over="ignore", under="ignore"):
        across = special.beta(1 / a, 1 / b) / (a * b)
    return np.where(wo[:, 2] * wi[:, 2] > 0, 1 / (a + b - a * b), across)


def slopes(m: Array, grey: Grey) -> Array:
    """D of local normals (n, 3)."""
    u, v, _ = grey.slopes
    steep = ((m[:, 0] / u) ** 2 + (m[:, 1] / v) ** 2) / m[:, 2] ** 2
    value: Array = 1 / (1 + steep) ** 2 if grey.ggx else np.exp(-steep)
    return value / (np.pi * u * v * m[:, 2] ** 4)


def drawn(wo: Array, m: Array, grey: Grey) -> Array:
    """The density of normals over D wo.m: visible ones (GGX), or one of two opposite slopes."""
    if grey.ggx:
        visible: Array = masking(wo, grey) / wo[:, 2]
        return visible
    area = dot(wo, m) / m[:, 2]
    return 2 / (np.maximum(area, 0) + np.maximum(2 * wo[:, 2] - area, 0))


def half(wo: Array, wi: Array, eta: float) -> Array:
    """The normals that send wo to wi, both local (n, 3)."""
    h = wo + np.where(wi[:, 2:] > 0, 1.0, eta) * wi
    h *= np.where(h[:, 2:] < 0, -1, 1)
    out: Array = h / np.sqrt(dot(h, h))[:, None]
    return out


def reflectance(cosine: Array, eta: float, k: float, off: float) -> Array:
    """Of mirrors by |cosine|; off: as in `rounding`."""
    r = fresnel(np.clip(np.abs(cosine) - off, 0, 1), eta, k)
    return r if eta == 1 and k == 0 else np.clip(r + off, 0, 1)


def exact(wo: Array, wi: Array, off: float, grey: Grey, eta: float) -> Array:
    """F cos and density (2, n) of the mirrors alone, and of their refraction; of radiance."""
    m = half(wo, wi, eta)
    om, im = dot(wo, m), dot(wi, m)
    up = wi[:, 2] > 0
    wide = np.where(up, 1 / (4 * om), eta**2 * np.abs(im) / (om + eta * im) ** 2)
    k = grey.k if grey.kind == "roughconductor" else 0.0
    r = reflectance(om, grey.eta if k else eta, k, off)
    if eta < 1:  # next to total reflection the last bits of om would count
        r = np.where(up, r, reflectance(im, 1 / eta, 0.0, off))
    share = np.where(up, r * grey.reflection, (1 - r) * grey.transmission / eta**2)
    lobe = slopes(m, grey) * om * wide
    chosen = np.where(up, r, 1 - r) if grey.kind == "roughdielectric" else 1.0
    value = lobe * share * masking(wo, grey) * masking(wi, grey) / wo[:, 2]
    value = value * in_common(wo, wi, grey)
    sent = up | ((om > 0) & (im < 0))
    return np.where(sent, [value, lobe * chosen * drawn(wo, m, grey)], 0)


Exact = Callable[[Array, Array, float], Array]
#: Relative rounding of some forty products and roots.
PRODUCTS = 64 * 2.0**-24


def formulas(grey: Grey, front: bool) -> Exact:
    """F cos and density (2, n) by local directions wo, wi (n, 3), and by `off` of `rounding`."""
    if grey.kind == "roughplastic":
        return functools.partial(coated, grey=grey, eta=float(single(grey.eta)))
    if grey.kind.endswith("_whole"):
        return functools.partial(whole, grey=grey, front=front)
    eta = grey.relative(front) if grey.kind == "roughdielectric" else 1.0
    return functools.partial(exact, grey=grey, eta=eta)


def rounding(f: Exact, wo: Array, wi: Array) -> Array:
    """Bound on the rounding of f(wo, wi, 0) at each point, in the shape of f.

    In units of 2^-24. The core's local coordinates are within 16: 7 by the frame
    (`numbers.frames`), 3 by the sum of three products, 3 by the half vector's sum and its index.
    The mirrors' cosine and their reflectance are within 16 more; f(wo, wi, off) has the former less
    and the latter more by off. The products and roots that follow are within 64, relative.
    """
    told, turn = f(wo, wi, 0.0), 16 * 2.0**-24
    total = PRODUCTS * told
    for which, axis in itertools.product(range(2), range(3)):
        moved = []
        for step in (-turn, turn):
            at = [wo, wi]  # the same object where it is not moved: formulas may keep what it gives
            at[which] = at[which].copy()
            at[which][:, axis] += step
            moved.append(np.abs(f(*at, 0.0) - told))
        total += np.maximum(*moved)
    bound: Array = np.maximum(*(np.abs(f(wo, wi, off) - told) for off in (-turn, turn)))
    return total + bound


def agree(t: Trial, grey: Grey, front: bool, angle: float, s: Array, told: Exact) -> None:
    """Samples s, and `eval` in their directions, have the weight and density of the formulas.

    Within `rounding`, or 1e-32, as factors below the least float are 0; samples, whose directions
    are rounded too, within twice that.
    """
    wo, frame = view(angle)
    local, own = s[:, :3] @ frame.T, np.broadcast_to(wo @ frame.T, (len(s), 3))
    value = told(own, local, 0.0)
    found = evaluated(t, grey, front, wo, s[:, :3])[:, :2].T
    drawn = np.stack([s[:, 3] * s[:, 4], s[:, 4]])
    off = np.abs(np.stack([found, drawn]) - value)
    far = ~(off <= PRODUCTS * value).all(axis=(0, 1))  # the others are within every bound
    bound = rounding(told, own[far], local[far]) + 1e-32
    for which, (times, what) in enumerate(((1, "eval"), (2, "sample"))):
        for k, kind in enumerate(("f", "density")):
            at, most = off[which, k, far], times * bound[k]
            worst = (at / np.maximum(most, 1e-300)).max(initial=0)
            t.check(at <= most, f"{kind} of {what} at {angle}: {worst:.2g} times the rounding")


def reciprocal(t: Trial, grey: Grey, told: Callable[[bool], Exact], front: bool = True,
               across: bool = False) -> None:  # fmt: skip
    """f(a, b) / n_b^2 = f(b, a) / n_a^2 for 10^5 pairs on one side or across, within `rounding`.

    told: the formulas, by the side that wo is on.
    """
    _, frame = view(0.0)
    n = 100_000 * t.effort
    a, b = single(random_points(t, "cosine_hemisphere", 2 * n) @ frame).reshape(2, n, 3)
    normal, turn, squared, side = NORMAL, np.ones(3), 1.0, front
    if across:
        b, normal, turn, side = -b, -NORMAL, np.array([1, -1, -1]), not front
        squared = float(single(grey.eta)) ** (2 if front else -2)
    forth = pairs(t, grey, front, a, b)[:, 0] * squared / np.abs(b @ frame[2])
    back = pairs(t, grey, side, b, a, normal)[:, 0] / np.abs(a @ frame[2])
    seen = forth > 1e-30
    t.check(seen.sum() > 20, "nothing is seen")
    off = np.abs(back / np.maximum(forth, 1e-30) - 1)
    far = seen & (off > 2 * PRODUCTS)  # the others are within every bound
    slack = np.zeros(int(far.sum()))
    for wo, wi, f, flip in ((a, b, told(front), np.ones(3)), (b, a, told(side), turn)):
        o, i = wo[far] @ frame.T * flip, wi[far] @ frame.T * flip
        with np.errstate(divide="ignore"):  # the formulas give 0 where rounding decides the side
            slack += rounding(f, o, i)[0] / f(o, i, 0.0)[0]
    worst = (off[far] / slack).max(initial=0)
    t.check(off[far] <= slack, f"{worst:.2g} times the rounding")


@case(2, each={"name": MIRRORS, "angle": ANGLES})
def rough_directions(t: Trial, name: str, angle: float) -> None:
    """The small mirrors that samples meet, from normal to grazing incidence, both sides of glass.

    GGX: uniform on the spherical cap. Beckmann: slopes as the normals', either of two opposite
    ones. 10^5 samples of each side: sees 1 % in scale, 4 % in tilt.
    """
    grey, (wo, frame) = ROUGH[name], view(angle)
    for front in (True, False) if name in GLASS else (True,):
        s = sampled(t, grey, front, wo, *random_numbers(t, N * t.effort)[1:])
        local, own = s[:, :3] @ frame.T, np.broadcast_to(wo @ frame.T, (len(s), 3))
        eta = grey.relative(front) if name in GLASS else 1.0
        through = s[:, 5] > 0
        h = own + np.where(through, eta, 1.0)[:, None] * local
        h *= np.where(h[:, 2:] < 0, -1, 1) / grey.slopes
        if grey.ggx:
            w = own[:1] * grey.slopes
            w = w / np.linalg.norm(w)
            h /= np.sqrt(dot(h, h))[:, None]
            cap = 2 * (h @ w.T) * h - w
            u, v = (1 - cap[:, 2]) / (1 + w[0, 2]), np.arctan2(cap[:, 1], cap[:, 0])
        else:
            x, y = (h[:, :2] / h[:, 2:]).T
            u, v = -np.expm1(-(x * x + y * y)), 2 * (np.arctan2(y, x) % np.pi)
            turn = own[:, 0] * x * grey.slopes[0] + own[:, 1] * y * grey.slopes[1]
            # which of the two: its mean, where both are seen
            p = np.clip((own[:, 2] + np.abs(turn)) / (2 * own[:, 2]), 0, 1)
            odds = ((turn > 0) - p) / np.sqrt(np.maximum(p * (1 - p), 1e-12))
            both = p < 0.999
            # what 16 units of 2^-24 in the half vector make of its slope
            slack = 2.0**-20 * (1 + np.hypot(x * grey.slopes[0], y * grey.slopes[1])) / h[:, 2]
            t.check(turn > -own[:, 2] - slack, "a slope that wo does not see")
            if both.sum() > 1000:
                z = odds[both].sum() / math.sqrt(both.sum())
                t.p(math.erfc(abs(z) / math.sqrt(2)), "which of two slopes")
        uniform(t, np.clip(u, 0, 1), v / (2 * np.pi) % 1, f"{name}, front {front}")


@case(2, each={"name": ROUGH, "front": [True, False]})
def rough_weights(t: Trial, name: str, front: bool) -> None:
    """eval, sample and density of a rough surface agree with each other and with D, G1 and F.

    Five angles: density and f cos, of samples weight times density, within what rounding does to
    float64 at the sampled directions (`rounding`: half of them below 3e-5); a weight of 0 where a
    mirror sends light to the wrong side; of GGX at most the reflectance, of Beckmann eight times
    that (3.535 / 2 slopes of up to 4.08 alpha).
    """
    grey = ROUGH[name]
    eta = grey.relative(front) if grey.kind in _GLASSES else 1.0
    for angle in ANGLES:
        wo, frame = view(angle)
        s = sampled(t, grey, front, wo, *random_numbers(t, 4000)[1:], importance=True)
        weight, pdf, through = s[:, 3], s[:, 4], s[:, 5] > 0
        t.check(np.isfinite(s), "not finite")
        t.check(np.abs(np.linalg.norm(s[:, :3], axis=1) - 1).max() < 1e-6, "length")
        t.check((weight >= 0) & (pdf >= 0), "negative")
        cosine = s[:, :3] @ frame[2]
        right = (cosine < 0) == through
        t.check(weight[~right] == 0, "weight on the wrong side")
        steady = right & (np.abs(cosine) > 2.0**-18)
        agree(t, grey, front, angle, s[steady], formulas(grey, front))
        if name in MIRRORS:
            most = np.where(through, grey.transmission / eta**2, grey.reflection)
            t.check(weight <= most * (1 + 1e-6 if grey.ggx else 8), "weight above the reflectance")
        if grey.kind not in _GLASSES:
            below = evaluated(t, grey, front, wo, -s[steady, :3])
            t.check(below[:, :2] == 0, "from below")


def coated(wo: Array, wi: Array, off: float, grey: Grey, eta: float) -> Array:
    """F cos and density (2, n) of rough plastic whose coat lets in what a smooth one does."""
    table = 1 - reflectance(np.linspace(0, 1, 64), eta, 0.0, off)
    into, out = (np.interp(w[:, 2], np.linspace(0, 1, 64), table) for w in (wi, wo))
    m = half(wo, wi, 1.0)
    om = dot(wo, m)
    lobe = slopes(m, grey) / 4
    value = lobe * grey.reflection * reflectance(om, eta, 0.0, off)
    value *= masking(wo, grey) * masking(wi, grey) / wo[:, 2] * in_common(wo, wi, grey)
    chosen = grey.chosen(1 - out)
    density = chosen * lobe * drawn(wo, m, grey) + (1 - chosen) * wi[:, 2] / np.pi
    return np.stack([value + grey.albedo * out * into * wi[:, 2] / np.pi, density])


def lost(cosine: Array, grey: Grey, share: float) -> Array:
    """The hooks' table of a cosine times a share, linear in a / (a + b)."""
    alpha = float(single(grey.alpha))
    t = np.arange(1, 256) / 255
    nodes = share / np.sqrt(1 + (((1 - t) / t) ** 2 / alpha) ** 2)
    c = np.minimum(cosine, 1)
    a, b = np.sqrt(c), np.sqrt(alpha * np.sqrt(1 - c * c))
    return np.interp(a / (a + b), [0, *t], [0, *nodes])


def whole(wo: Array, wi: Array, off: float, grey: Grey, front: bool) -> Array:
    """F cos and density (2, n) of mirrors, and of what the table says that they lose."""
    metal = grey.kind == "roughconductor_whole"
    once = replace(grey, kind=grey.kind.removesuffix("_whole"))
    front = front or metal  # its sides are alike
    told = exact(wo, wi, off, once, 1.0 if metal else once.relative(front))
    shares = {True: 1 / 4} if metal else {True: 1 / 16, False: 1 / 8}
    crossing = {True: 0.0} if metal else {True: float(single(grey.eta)) ** 2 / 4, False: 1 / 8}
    own, up, cosine = lost(wo[:, 2], grey, shares[front]), wi[:, 2] > 0, np.abs(wi[:, 2])
    chosen = np.where(up, 1 - crossing[front], crossing[front])
    w = min(float(single(grey.alpha)), 1.0)
    density = chosen * cosine / np.pi / ((cosine**2 + w * w) * np.log1p(1 / w**2))
    # the mean of share times c is 2 / 3 of it
    even = cosine / np.pi * lost(cosine, grey, shares[front]) * 1.5 / shares[front]
    if metal:
        f = 0.5 * grey.reflection
        colour: Any = f * f * (5 / 6) / (1 - f / 6)
    else:
        beyond = cosine / np.pi * lost(cosine, grey, shares[not front]) * 1.5 / shares[not front]
        even = np.where(up, even, beyond)
        colour = np.where(up, grey.reflection, grey.transmission / once.relative(front) ** 2)
    again = np.stack([colour * chosen * even, density]) * own
    return told * np.stack([np.ones_like(own), 1 - own]) + np.where(up | (not metal), again, 0)


@case(2, each={"name": WHOLE, "angle": (0.0, 60.0, 85.0), "front": [True, False]})
def whole_directions(t: Trial, name: str, angle: float, front: bool) -> None:
    """Directions of lobes together fall as the density says: chi-square over 12 x 12 cells a side.

    Cells even in the cosine and in the turn; the density by quadrature within each. 10^5 samples.
    Cells that 12 and 24 nodes along an edge tell apart by a 20th of their deviation, next to
    grazing, count together with what is lost.
    """
    grey, (wo, frame) = ROUGH[name], view(angle)
    n, cells = N * t.effort, 12
    s = sampled(t, grey, front, wo, *random_numbers(t, n)[1:])
    local = s[:, :3] @ frame.T
    kept = (local[:, 2] < 0) == (s[:, 5] > 0)  # the others are lost
    sides = (1, -1) if name in GLASS else (1,)
    found, told = [], []
    for side in sides:
        here = local[kept & (side * local[:, 2] > 0)]
        turn = np.arctan2(here[:, 1], here[:, 0]) % (2 * np.pi)
        height = np.minimum(np.abs(here[:, 2]), 1)  # past rounding
        found.append(np.histogram2d(height, turn, bins=cells,
                                    range=((0, 1), (0, 2 * np.pi)))[0])  # fmt: skip
        rules = []
        for fine in (12, 24):
            x, w = gauss(fine, 0, 1)
            at = ((np.arange(cells)[:, None] + x) / cells).ravel()
            c, phi = (a.ravel() for a in np.meshgrid(at, 2 * np.pi * at, indexing="ij"))
            sine = np.sqrt(1 - c * c)
            net = np.stack([sine * np.cos(phi), sine * np.sin(phi), side * c], axis=1) @ frame
            density = evaluated(t, grey, front, wo, single(net))[:, 1].reshape((cells, fine) * 2)
            rules.append(np.einsum("aibj,i,j->ab", density, w, w) * 2 * np.pi / cells**2)
        told.append(rules)
    rough, told = (np.ravel(rule) for rule in np.swapaxes(told, 0, 1))
    sure = n * np.abs(rough - told) < 0.05 * np.sqrt(np.maximum(n * told, 1))
    expected = np.append(told[sure], 1 - told[sure].sum())
    counts = np.append(np.ravel(found)[sure], n - np.ravel(found)[sure].sum())
    rare = n * expected < 10
    many = np.append(n * expected[~rare], max(n * expected[rare].sum(), 1e-9))
    seen = np.append(counts[~rare], counts[rare].sum())
    if many[-1] < 10:
        many[-2], seen[-2] = many[-2] + many[-1], seen[-2] + seen[-1]
        many, seen = many[:-1], seen[:-1]
    square = float(((seen - many) ** 2 / many).sum())
    t.p(float(stats.chi2.sf(square, len(many) - 1)), "cells")
    t.sees(0.02)


@case(2, each={"name": ONE_SIDE})
def rough_reciprocity(t: Trial, name: str) -> None:
    """f(a, b) = f(b, a) for 10^5 pairs of directions, within what rounding does to each."""
    reciprocal(t, ROUGH[name], lambda front: formulas(ROUGH[name], front))


def pairs(t: Trial, grey: Grey, front: bool, wo: Array, wi: Array, n: Array = NORMAL) -> Array:
    """bsdf_eval for many wo (n, 3)."""
    columns = grey.columns(front)
    got: Array = t.function("bsdf_eval", *columns, *n, *wo.T, *wi.T)
    return got


@case(2, each={"name": GLASS})
def rough_reciprocity_of_refraction(t: Trial, name: str) -> None:
    """f(a, b) / n_b^2 = f(b, a) / n_a^2 for 10^5 pairs across rough glass.

    Within what rounding does to each, which includes 1 - F near total reflection.
    """
    reciprocal(t, ROUGH[name], lambda front: formulas(ROUGH[name], front), across=True)


@case(2, each={"name": ROUGH, "front": [True, False]})
def rough_energy(t: Trial, name: str, front: bool) -> None:
    """No rough surface returns more than it gets.

    Mean weight of importance over 64 x 64 x 32 random numbers, five angles: at most 1.005.
    """
    grey = ROUGH[name]
    x = (np.arange(64) + 0.5) / 64
    u, v, lobe = (a.ravel() for a in np.meshgrid(x, x, (np.arange(32) + 0.5) / 32))
    for angle in ANGLES:
        wo, _ = view(angle)
        s = sampled(t, grey, front, wo, u, v, lobe, importance=True)
        t.check(s[:, 8].mean() < 1.005, f"{s[:, 8].mean()} at {angle}")


@case(2, each={"mu": [1.0, 0.9, 0.5, 0.25, 0.1, 0.01], "heights": (False, True)})
def albedo_of_rough_mirrors(t: Trial, mu: float, heights: bool) -> None:
    """Directional albedo of GGX mirrors (F = 1) by quadrature over the random numbers.

    alpha 1, separable shadows: 2 (1 - ln 2) / (1 + mu); alpha 0.5 at mu 0.5: 0.6860072. Correlated
    by height: 1 - mu ln(1 + 1 / mu) and 0.6982507. Within 1e-5, at mu 0.01 1e-4.
    """
    x, w = gauss(1200, 0, 1)
    v = (np.arange(600) + 0.5) / 600
    # the root at the cap's pole and at its rim
    u = np.sin(np.pi / 2 * x) ** 2
    weights = np.repeat(w * np.pi / 2 * np.sin(np.pi * x), len(v)) / len(v)
    grid = np.repeat(u, len(v)), np.tile(v, len(u)), 0.5
    wo, _ = view(math.degrees(math.acos(mu)))
    cosine = float(wo @ NORMAL)
    separable = (1.0, 2 * (1 - math.log(2)) / (1 + cosine)), (0.5, 0.6860072)
    by_height = (1.0, 1 - cosine * math.log1p(1 / cosine)), (0.5, 0.6982507)
    for alpha, known in by_height if heights else separable:
        if alpha == 1 or mu == 0.5:
            grey = Grey("roughconductor", eta=0.0, k=1.0, alpha=alpha, ggx=1.0, heights=heights)
            found = float(weights @ sampled(t, grey, True, wo, *grid)[:, 3])
            off = 1e-4 if heights and mu < 0.1 else 1e-5
            t.check(abs(found - known) < off, f"{found} for {known}, alpha {alpha}")


@case(2, each={"heights": (False, True)})
def mean_albedo_of_rough_mirrors(t: Trial, heights: bool) -> None:
    """Albedo of GGX mirrors of alpha 1 for diffuse light, within 1e-4.

    4 (1 - ln 2)^2 by separable shadows, 4 (1 - ln 2) / 3 by those correlated by height.
    """
    x, w = gauss(24, 0, 1)
    p, q = gauss(96, 0, 1)
    v = (np.arange(96) + 0.5) / 96
    u, weights = np.sin(np.pi / 2 * p) ** 2, q * np.pi / 2 * np.sin(np.pi * p)
    grid = np.repeat(u, 96), np.tile(v, 96), 0.5
    grey = Grey("roughconductor", eta=0.0, k=1.0, alpha=1.0, ggx=1.0, heights=heights)
    total, rest = 0.0, 1 - math.log(2)
    for mu, weight in zip(x, w, strict=True):
        wo, _ = view(math.degrees(math.acos(mu)))
        mean = np.repeat(weights, 96) @ sampled(t, grey, True, wo, *grid)[:, 3] / 96
        total += 2 * mu * weight * float(mean)
    t.check(abs(total - (4 * rest / 3 if heights else 4 * rest**2)) < 1e-4, f"{total}")


@case(2, each={"name": COARSE, "front": [True, False]})
def weak_white_furnace(t: Trial, name: str, front: bool) -> None:
    """The density over all directions and the lost samples add up to 1, within 1 %.

    By quadrature over directions; alpha 0.2 and more, up to 80 degrees.
    """
    grey = ROUGH[name]
    x = (np.arange(64) + 0.5) / 64
    u, v, lobe = (a.ravel() for a in np.meshgrid(x, x, (np.arange(32) + 0.5) / 32))
    for angle in (0.0, 30.0, 60.0, 80.0):
        wo, frame = view(angle)
        net, weights = hemisphere(frame, 256)
        sides = (1, -1) if name in GLASS else (1,)
        found = sum(float(weights @ evaluated(t, grey, front, wo, k * net)[:, 1])
                    for k in sides)  # fmt: skip
        s = sampled(t, grey, front, wo, u, v, lobe)
        lost = float(((s[:, :3] @ NORMAL > 0) == (s[:, 5] > 0)).mean())
        t.check(abs(found + lost - 1) < 0.01, f"{found} + {lost} at {angle}")


@case(2, each={"name": ROUGH})
def rough_corners(t: Trial, name: str) -> None:
    """Samples for random numbers at the end of their range, alpha from 1e-4 to 10.

    u, v, lobe in {0, 2^-24, 1/2, 1 - 2^-24}, angles up to 89.9999 degrees, both sides: unit
    directions (1e-5), finite weights and densities, none of them negative. Of
    those that are brushed alpha changes along the tangent alone.
    """
    u, v, lobe = np.array(list(itertools.product(CORNERS, repeat=3))).T
    for alpha, angle, front in itertools.product(
        (1e-4, 1e-3, 0.1, 1.0, 10.0), (*ANGLES, 89.99, 89.9999), (True, False)
    ):
        grey = replace(ROUGH[name], alpha=alpha)
        wo, _ = view(angle)
        s = sampled(t, grey, front, wo, u, v, lobe, importance=True)
        t.check(np.isfinite(s), f"not finite at {angle}, alpha {alpha}")
        t.check(np.abs(np.linalg.norm(s[:, :3], axis=1) - 1).max() < 1e-5, "length")
        t.check((s[:, 3] >= 0) & (s[:, 4] >= 0), "negative")
        e = evaluated(t, grey, front, wo, s[:, :3])
        t.check(np.isfinite(e), f"eval not finite at {angle}, alpha {alpha}")
        t.check((e[:, 0] >= 0) & (e[:, 1] >= 0), "negative eval")
