"""Level 2: rough surfaces: small mirrors whose slopes follow GGX or Beckmann, Smith's shadows.

Exact counterparts in float64 are built from D and G1 here; the hooks' rough coat lets in what a
smooth one does.
"""

from __future__ import annotations

import itertools
import math
from dataclasses import replace
from typing import Any

import numpy as np
import numpy.typing as npt

from veriray_validate.levels.sampler_materials import (
    NORMAL,
    Grey,
    evaluated,
    hemisphere,
    sampled,
    view,
)
from veriray_validate.levels.samplers import N, random_numbers, random_points, uniform
from veriray_validate.oracles import CORNERS, fresnel, gauss, single
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
}  # fmt: skip
MIRRORS = tuple(name for name, grey in ROUGH.items() if grey.kind != "roughplastic")
GLASS = tuple(name for name, grey in ROUGH.items() if grey.kind == "roughdielectric")
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
    area = (wo * m).sum(axis=1) / m[:, 2]
    return 2 / (np.maximum(area, 0) + np.maximum(2 * wo[:, 2] - area, 0))


def half(wo: Array, wi: Array, eta: float) -> Array:
    """The normals that send wo to wi, both local (n, 3)."""
    h = wo + np.where(wi[:, 2:] > 0, 1.0, eta) * wi
    h *= np.where(h[:, 2:] < 0, -1, 1)
    out: Array = h / np.linalg.norm(h, axis=1)[:, None]
    return out


def exact(wo: Array, wi: Array, grey: Grey, eta: float) -> tuple[Array, Array]:
    """F cos and density of the mirrors alone, and of their refraction; of radiance."""
    m = half(wo, wi, eta)
    om, im = (wo * m).sum(axis=1), (wi * m).sum(axis=1)
    up = wi[:, 2] > 0
    wide = np.where(up, 1 / (4 * om), eta**2 * np.abs(im) / (om + eta * im) ** 2)
    k = grey.k if grey.kind == "roughconductor" else 0.0
    r = fresnel(np.clip(om, 0, 1), grey.eta if k else eta, k)
    share = np.where(up, r * grey.reflection, (1 - r) * grey.transmission / eta**2)
    lobe = slopes(m, grey) * om * wide
    chosen = np.where(up, r, 1 - r) if grey.kind == "roughdielectric" else 1.0
    value = lobe * share * masking(wo, grey) * masking(wi, grey) / wo[:, 2]
    sent = up | ((om > 0) & (im < 0))
    return np.where(sent, value, 0), np.where(sent, lobe * chosen * drawn(wo, m, grey), 0)


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
            h /= np.linalg.norm(h, axis=1)[:, None]
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
            sure = np.abs(turn) > 1.001 * own[:, 2]  # by more than rounding
            t.check((turn > 0)[sure], "a slope that wo does not see")
            if both.sum() > 1000:
                z = odds[both].sum() / math.sqrt(both.sum())
                t.p(math.erfc(abs(z) / math.sqrt(2)), "which of two slopes")
        uniform(t, np.clip(u, 0, 1), v / (2 * np.pi) % 1, f"{name}, front {front}")


@case(2, each={"name": ROUGH, "front": [True, False]})
def rough_weights(t: Trial, name: str, front: bool) -> None:
    """eval, sample and density of a rough surface agree with each other and with D, G1 and F.

    Five angles: density and f cos within 3e-4 + 3e-7 / (alpha cos) of float64 at the sampled
    directions (the half vector is rounded; 1 in 500 may be 100 times as far off, where 1 - F is
    rounded near total reflection), weight = f cos / density; a weight of 0 where a mirror
    sends light to the wrong side; of GGX at most the reflectance, of Beckmann eight times that.
    """
    grey = ROUGH[name]
    eta = grey.relative(front) if grey.kind == "roughdielectric" else 1.0
    for angle in ANGLES:
        wo, frame = view(angle)
        slack = 3e-4 + 3e-7 / (grey.slopes.min() * float(wo @ frame[2]))
        s = sampled(t, grey, front, wo, *random_numbers(t, 4000)[1:])
        wi, weight, pdf, through = s[:, :3], s[:, 3], s[:, 4], s[:, 5] > 0
        t.check(np.isfinite(s), "not finite")
        t.check(np.abs(np.linalg.norm(wi, axis=1) - 1).max() < 1e-6, "length")
        t.check((weight >= 0) & (pdf >= 0), "negative")
        local = wi @ frame.T
        right = (local[:, 2] < 0) == through
        t.check(weight[~right] == 0, "weight on the wrong side")
        steady = right & (np.abs(local[:, 2]) > 1e-3)
        e = evaluated(t, grey, front, wo, wi[steady])
        value = weight[steady] * pdf[steady]
        near(t, pdf[steady], e[:, 1], slack, f"density at {angle}")
        near(t, value, e[:, 0], slack, f"weight at {angle}")
        own = np.broadcast_to(wo @ frame.T, (int(steady.sum()), 3))
        told, density = exact(own, local[steady], grey, eta)
        if grey.kind == "roughplastic":
            index = float(single(grey.eta))
            told, density = coated(own, local[steady], grey, index)
        near(t, e[:, 1], density, slack, f"exact density at {angle}")
        near(t, e[:, 0], told, slack, f"exact f at {angle}")
        if grey.kind != "roughplastic":
            most = np.where(through, grey.transmission / eta**2, grey.reflection)
            t.check(weight <= most * (1 + 1e-6 if grey.ggx else 8), "weight above the reflectance")
        if grey.kind != "roughdielectric":
            below = evaluated(t, grey, front, wo, -wi[steady])
            t.check(below[:, :2] == 0, "from below")


def near(t: Trial, a: Array, b: Array, slack: float, what: str) -> None:
    """Relative differences of nearly all below slack, and of all below 100 times that."""
    off = np.abs(a / b - 1)
    t.check(np.quantile(off, 0.998) < slack and off.max() < 100 * slack, f"{what}: {off.max():.2g}")


def coated(wo: Array, wi: Array, grey: Grey, eta: float) -> tuple[Array, Array]:
    """F cos and density of rough plastic whose coat lets in what a smooth one does (a table)."""
    table = 1 - fresnel(np.linspace(0, 1, 64), eta)
    into, out = (np.interp(w[:, 2], np.linspace(0, 1, 64), table) for w in (wi, wo))
    m = half(wo, wi, 1.0)
    om = (wo * m).sum(axis=1)
    lobe = slopes(m, grey) / 4
    value = lobe * grey.reflection * fresnel(np.clip(om, 0, 1), eta)
    value *= masking(wo, grey) * masking(wi, grey) / wo[:, 2]
    density = (1 - out) * lobe * drawn(wo, m, grey) + out * wi[:, 2] / np.pi
    return value + grey.albedo * out * into * wi[:, 2] / np.pi, density


@case(2, each={"name": ONE_SIDE})
def rough_reciprocity(t: Trial, name: str) -> None:
    """f(a, b) = f(b, a) for 10^5 pairs of directions, relative 1e-4 for cosines above 0.01."""
    grey, (_, frame) = ROUGH[name], view(0.0)
    n = 100_000 * t.effort
    a, b = single(random_points(t, "cosine_hemisphere", 2 * n) @ frame).reshape(2, n, 3)
    forth, back = (pairs(t, grey, True, *p)[:, 0] / (p[1] @ frame[2]) for p in ((a, b), (b, a)))
    seen = (np.minimum(a @ frame[2], b @ frame[2]) > 0.01) & (forth > 1e-30)
    off = np.abs(back[seen] / forth[seen] - 1).max()
    t.check(off < 1e-4, f"off by {off:.2g}")


def pairs(t: Trial, grey: Grey, front: bool, wo: Array, wi: Array, n: Array = NORMAL) -> Array:
    """bsdf_eval for many wo (n, 3)."""
    columns = grey.columns(front)
    got: Array = t.function("bsdf_eval", *columns, *n, *wo.T, *wi.T)
    return got


@case(2, each={"name": GLASS})
def rough_reciprocity_of_refraction(t: Trial, name: str) -> None:
    """f(a, b) / n_b^2 = f(b, a) / n_a^2 for 10^5 pairs across rough glass, where light passes.

    Relative 5e-3 for cosines above 0.05 and values above 1e-3: near total reflection little
    passes, and 1 - F is rounded.
    """
    grey, (_, frame) = ROUGH[name], view(0.0)
    n = 100_000 * t.effort
    a, b = single(random_points(t, "cosine_hemisphere", 2 * n) @ frame).reshape(2, n, 3)
    b = -b
    forth = pairs(t, grey, True, a, b)[:, 0] / -(b @ frame[2])
    back = pairs(t, grey, False, b, a, -NORMAL)[:, 0] / (a @ frame[2])
    squared = float(single(grey.eta)) ** 2
    seen = (np.minimum(a @ frame[2], -(b @ frame[2])) > 0.05) & (forth > 1e-3)
    t.check(seen.sum() > 20, "nothing passes")
    off = np.abs(back[seen] / (forth[seen] * squared) - 1).max()
    t.check(off < 5e-3, f"off by {off:.2g}")


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
        s = sampled(t, grey, front, wo, u, v, lobe)
        t.check(s[:, 8].mean() < 1.005, f"{s[:, 8].mean()} at {angle}")


@case(2, each={"mu": [1.0, 0.9, 0.5, 0.25, 0.1, 0.01]})
def albedo_of_rough_mirrors(t: Trial, mu: float) -> None:
    """Directional albedo of GGX mirrors (F = 1) by quadrature over the random numbers.

    alpha 1, separable shadows: 2 (1 - ln 2) / (1 + mu); alpha 0.5 at mu 0.5: 0.6860072. Within
    1e-5; with height-correlated shadows it would be 1 - mu ln(1 + 1 / mu).
    """
    x, w = gauss(1200, 0, 1)
    v = (np.arange(600) + 0.5) / 600
    # the root at the cap's pole and at its rim
    u = np.sin(np.pi / 2 * x) ** 2
    weights = np.repeat(w * np.pi / 2 * np.sin(np.pi * x), len(v)) / len(v)
    grid = np.repeat(u, len(v)), np.tile(v, len(u)), 0.5
    wo, _ = view(math.degrees(math.acos(mu)))
    cosine = float(wo @ NORMAL)
    for alpha, known in ((1.0, 2 * (1 - math.log(2)) / (1 + cosine)), (0.5, 0.6860072)):
        if alpha == 1 or mu == 0.5:
            grey = Grey("roughconductor", eta=0.0, k=1.0, alpha=alpha, ggx=1.0)
            found = float(weights @ sampled(t, grey, True, wo, *grid)[:, 3])
            t.check(abs(found - known) < 1e-5, f"{found} for {known}, alpha {alpha}")


@case(2)
def mean_albedo_of_rough_mirrors(t: Trial) -> None:
    """Albedo of GGX mirrors of alpha 1 for diffuse light: 4 (1 - ln 2)^2, within 1e-4."""
    x, w = gauss(24, 0, 1)
    p, q = gauss(96, 0, 1)
    v = (np.arange(96) + 0.5) / 96
    u, weights = np.sin(np.pi / 2 * p) ** 2, q * np.pi / 2 * np.sin(np.pi * p)
    grid = np.repeat(u, 96), np.tile(v, 96), 0.5
    grey, total = Grey("roughconductor", eta=0.0, k=1.0, alpha=1.0, ggx=1.0), 0.0
    for mu, weight in zip(x, w, strict=True):
        wo, _ = view(math.degrees(math.acos(mu)))
        mean = np.repeat(weights, 96) @ sampled(t, grey, True, wo, *grid)[:, 3] / 96
        total += 2 * mu * weight * float(mean)
    t.check(abs(total - 4 * (1 - math.log(2)) ** 2) < 1e-4, f"{total}")


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
        sides = (1, -1) if grey.kind == "roughdielectric" else (1,)
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
        s = sampled(t, grey, front, wo, u, v, lobe)
        t.check(np.isfinite(s), f"not finite at {angle}, alpha {alpha}")
        t.check(np.abs(np.linalg.norm(s[:, :3], axis=1) - 1).max() < 1e-5, "length")
        t.check((s[:, 3] >= 0) & (s[:, 4] >= 0), "negative")
        e = evaluated(t, grey, front, wo, s[:, :3])
        t.check(np.isfinite(e), f"eval not finite at {angle}, alpha {alpha}")
        t.check((e[:, 0] >= 0) & (e[:, 1] >= 0), "negative eval")
