"""Samplers: chi-square of mappings, light choice, pixel filters and the camera.

Chi-square over three grids (1 x 8, 8 x 4, 16 x 32) of the same points in the sampler's own
coordinates: one fine grid alone accepts a density that is 1 % wrong. N = 400,000: sees 1 % in
scale or tilt. Rates and confirmation as in tests/support.py.
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Callable
from functools import partial
from typing import Any

import numpy as np
import pytest
from scipy import integrate, stats

import veriray
from tests.support import (
    FAST,
    agrees,
    camera,
    confirm,
    grids,
    make,
    max_z,
    native,
    quad,
    sidak,
)

pytestmark = pytest.mark.parametrize("device", FAST)
N = 400_000
Cells = Callable[[np.ndarray], tuple[np.ndarray, np.ndarray]]


def azimuth(p: np.ndarray) -> np.ndarray:
    return np.arctan2(p[:, 1], p[:, 0]) / (2 * np.pi) % 1.0


#: From a point of the mapping to the unit square, by the cumulative distribution.
INVERSE: dict[str, Cells] = {
    "cosine_hemisphere": lambda p: (1 - p[:, 2] ** 2, azimuth(p)),
    "uniform_sphere": lambda p: ((1 - p[:, 2]) / 2, azimuth(p)),
    "uniform_triangle": lambda p: (
        (p[:, 0] + p[:, 1]) ** 2,
        p[:, 1] / np.maximum(p[:, 0] + p[:, 1], 1e-30),
    ),
    "uniform_disk": lambda p: (p[:, 0] ** 2 + p[:, 1] ** 2, azimuth(p)),
}


def random_numbers(device: str, n: int, seed: int) -> np.ndarray:
    """(4, n) float32 in [0, 1): multiples of 2^-24."""
    zero, index = np.zeros(n, np.uint32), np.arange(n)
    words = native(device).random(seed, zero, index.astype(np.uint64), zero + 1)
    return (words >> 8).T.astype(np.float32) * np.float32(2.0**-24)


def evaluate(device: str, name: str, *columns: Any) -> np.ndarray:
    """Columns (numbers are repeated) to rows, float64."""
    rows = np.stack(np.broadcast_arrays(*columns), axis=-1).astype(np.float32)
    out: np.ndarray = native(device).eval_function(name, rows)
    return out.astype(np.float64)


def random_points(device: str, name: str, n: int, seed: int, *more: float) -> np.ndarray:
    return evaluate(device, name, *random_numbers(device, n, seed)[2:], *more)


@pytest.mark.parametrize("name", INVERSE)
def test_mappings(device: str, name: str) -> None:
    def p_value(effort: int, seed: int) -> float:
        u, v = INVERSE[name](random_points(device, name, N // 4 * effort, seed))
        return grids(np.clip(u, 0, 1), np.clip(v, 0, 1))

    confirm(p_value)


def test_moments(device: str) -> None:
    """C9: E[cos] = 2/3, E[cos^2] = 1/2 of the cosine lobe; E[x] = 0; E of barycentrics 1/3.

    n = 10^5: sees 0.5 %."""

    def p_value(effort: int, seed: int) -> float:
        n, z = 100_000 * effort, []
        lobe = random_points(device, "cosine_hemisphere", n, seed)
        sphere = random_points(device, "uniform_sphere", n, seed)
        triangle = random_points(device, "uniform_triangle", n, seed)
        for values, mean in (
            (lobe[:, 2], 2 / 3), (lobe[:, 2] ** 2, 1 / 2), (lobe[:, 0], 0), (lobe[:, 1], 0),
            (sphere[:, 2], 0), (sphere[:, 0], 0), (sphere[:, 2] ** 2, 1 / 3),
            (triangle[:, 0], 1 / 3), (triangle[:, 1], 1 / 3), (triangle[:, 2], 1 / 3),
        ):  # fmt: skip
            z.append((values.mean() - mean) / values.std() * math.sqrt(n))
        return max_z(np.array(z))

    confirm(p_value)


def test_planted_one_percent_is_found(device: str) -> None:
    """A cosine lobe whose azimuth is tilted by 2 %, or shrunk by 1 %, fails the same test."""
    p = random_points(device, "cosine_hemisphere", N, 1)
    u, v = INVERSE["cosine_hemisphere"](p)
    assert grids(u, v * 0.99) < 1e-6
    assert grids(u, v + 0.02 / (2 * np.pi) * np.sin(2 * np.pi * v) ** 2) < 1e-3
    assert grids(u**1.01, v) < 1e-3


@pytest.mark.parametrize("one_minus_cos", [2.0, 0.5, 1e-13])
def test_cones(device: str, one_minus_cos: float) -> None:
    def p_value(effort: int, seed: int) -> float:
        p = random_points(device, "uniform_cone", N // 4 * effort, seed, one_minus_cos)
        r2 = p[:, 0] ** 2 + p[:, 1] ** 2
        h = np.where(p[:, 2] > 0, r2 / (1 + np.abs(p[:, 2])), 1 - p[:, 2])
        return grids(np.clip(h / one_minus_cos, 0, 1), azimuth(p))

    confirm(p_value)


@pytest.mark.parametrize("g", [0.0, 1e-4, -0.5, 0.9, 0.9999, -0.9999])
def test_phase_function(device: str, g: float) -> None:
    """C10: directions by the cumulative distribution over the cosine; for g > 0
    (1 - g^2) / (2 g) (1 / (1 - g) - 1 / sqrt(1 + g^2 - 2 g cos)) is the share beyond cos."""
    a, sign = abs(g), math.copysign(1, g)

    def p_value(effort: int, seed: int) -> float:
        n = N // 4 * effort
        u, v = random_numbers(device, n, seed)[2:]
        p = evaluate(device, "henyey_greenstein", 0, 0, 1, g, u, v)
        z = sign * p[:, 2]
        less = np.where(z > 0, (p[:, 0] ** 2 + p[:, 1] ** 2) / (1 + np.abs(z)), 1 - z)
        root = np.sqrt((1 - a) ** 2 + 2 * a * less)
        beyond = less * (1 + a) / (root * (root + 1 - a))
        return grids(np.clip(beyond, 0, 1), azimuth(p))

    confirm(p_value)


def test_phase_function_mean_cosine(device: str) -> None:
    """E[cos] = g, E[cos^2] = (1 + 2 g^2) / 3, for directions about a tilted axis."""
    d = np.array([0.48, -0.64, 0.6])

    def p_value(effort: int, seed: int) -> float:
        z = []
        for k, g in enumerate((-0.9, -0.3, 0.0, 1e-4, 0.5, 0.95)):
            n = 50_000 * effort
            u, v = random_numbers(device, n, seed + k)[2:]
            cosine = evaluate(device, "henyey_greenstein", *d, g, u, v)[:, :3] @ d
            for values, mean in ((cosine, g), (cosine**2, (1 + 2 * g * g) / 3)):
                z.append((values.mean() - mean) / values.std() * math.sqrt(n))
        return max_z(np.array(z))

    confirm(p_value)


def test_free_flights(device: str) -> None:
    """Exponential with mean 1, by its cumulative distribution; pairs are independent."""

    def p_value(effort: int, seed: int) -> float:
        n = N // 4 * effort
        zero, index = np.zeros(n, np.uint32), np.arange(n).astype(np.uint64)
        words = native(device).random(seed, zero, index, zero + 3)
        x, y = (evaluate(device, "exponential", w >> 16, w & 65535)[:, 0] for w in words.T[:2])
        return grids(-np.expm1(-x), -np.expm1(-y))

    confirm(p_value)


# ---- sphere lights ----

#: Centre and radius with low parts 0, and points: just outside, near, far, inside, at the centre.
SPHERE = [0.25, -0.5, 0.125, 0, 0, 0, 0.5, 0]
TOWARDS = np.array([0.6, 0.0, -0.8])
AWAY = {"1e-5 radii off": 1.00001, "near": 1.5, "far": 200.0, "inside": 0.7, "centre": 0.0}


@pytest.mark.parametrize("name", AWAY)
def test_sphere_lights(device: str, name: str) -> None:
    """Uniform in the cone, from inside over all directions."""
    p = np.array(SPHERE[:3], np.float32) + (AWAY[name] * SPHERE[6] * TOWARDS).astype(np.float32)
    axis = np.array(SPHERE[:3]) - p
    ratio = SPHERE[6] / max(float(np.linalg.norm(axis)), 1e-30)
    inside = ratio > 1
    open_ = 2.0 if inside else ratio**2 / (1 + math.sqrt(1 - ratio**2))
    frame = np.linalg.svd(axis[None] if axis.any() else np.eye(3)[2:])[2]
    frame[0] *= np.sign(frame[0] @ axis) if axis.any() else 1

    def p_value(effort: int, seed: int) -> float:
        u, v = random_numbers(device, N // 4 * effort, seed)[2:]
        s = evaluate(device, "sphere_light", *SPHERE, *p, u, v)
        assert np.allclose(s[:, 3], 1 / (2 * np.pi * open_), rtol=1e-5)
        local = s[:, :3] @ frame.T
        h = np.where(local[:, 0] > 0, (local[:, 1:] ** 2).sum(1) / (1 + np.abs(local[:, 0])),
                     1 - local[:, 0])  # fmt: skip
        return grids(np.clip(h / open_, 0, 1), azimuth(local[:, 1:]))

    confirm(p_value)


def test_sphere_light_irradiance(device: str) -> None:
    """A sphere of radiance 1 gives pi (r/d)^2 to a patch that faces it; to one at its centre, pi;
    and its area is that of the mean of distance^2 / (cos_light pdf): 2 pi r^2 (1 - r/d) is seen."""

    def p_value(effort: int, seed: int) -> float:
        z = []
        for name, away in AWAY.items():
            n = 100_000 * effort
            p = np.array(SPHERE[:3], np.float32) + (away * SPHERE[6] * TOWARDS).astype(np.float32)
            u, v = random_numbers(device, n, seed)[2:]
            s = evaluate(device, "sphere_light", *SPHERE, *p, u, v)
            cosine = np.maximum(-(s[:, :3] @ TOWARDS), 0)
            outside = away > 1
            irradiance = math.pi * (1 / away**2 if outside else 1)
            area = 2 * math.pi * SPHERE[6] ** 2 * (1 - 1 / away if outside else 2)
            weights = [(cosine / s[:, 3], irradiance)]
            if name != "1e-5 radii off":  # there a sample in 10^5 holds most of the area
                weights.append((s[:, 4] ** 2 / (np.abs(s[:, 5]) * s[:, 3]), area))
            for values, mean in weights:
                error = max(values.std() / math.sqrt(n), 1e-6 * mean)
                z.append((values.mean() - mean) / error)
        return max_z(np.array(z))

    confirm(p_value)


# ---- light choice ----


def test_light_choice_is_binomial(device: str) -> None:
    """Two lamps, of which a black plate hides the first: its share of shadow rays is occluded.

    Choice in proportion to area times radiance, here 2 x 1 x 3 to 1 x 1 x 2: 3/4. Then with a sky:
    half of the rays are its own, half of those above the horizon. Exact binomial; sees 0.2 %.
    """
    floor = quad([-9, -9, 0], [18, 0, 0], [0, 18, 0], 0.5)
    lamps = [quad([-3, -0.5, 2], [0, 1, 0], [2, 0, 0], 0, 3.0),
             quad([1, -0.5, 2], [0, 1, 0], [1, 0, 0], 0, [1.0, 2.0, 3.0])]  # fmt: skip
    plate = quad([-2.2, -0.5, 1], [1.9, 0, 0], [0, 1, 0])
    view = camera([0.4, 0.6, 0.4], [0, 0, 0])
    share = 2 * 9 / (2 * 9 + 1 * 6)

    def p_value(effort: int, seed: int) -> float:
        n, p = N * effort, []
        scene = make([floor, *lamps, plate], view, max_depth=2)
        ledger = veriray.render(scene, spp=n, seed=seed, device=device).stats["ledger"]
        hidden, free = ledger["shadow_occluded"][0], ledger["shadow_visible"][0]
        assert hidden + free == n
        p.append(stats.binomtest(hidden, n, share).pvalue)
        scene = make([floor, *lamps], view, 0.5, max_depth=2)
        ledger = veriray.render(scene, spp=n, seed=seed, device=device).stats["ledger"]
        wanted = ledger["shadow_occluded"][0] + ledger["shadow_visible"][0]
        p.append(stats.binomtest(wanted, n, 0.75).pvalue)
        return sidak(min(p), 2)

    confirm(p_value)


def test_choice_among_many_lights(device: str) -> None:
    """One of 100 lamps of radiance 1 to 100 is hidden in turn by being one-sided: its front is up.

    Rays wanted: the share of the others. Binomial for nine lamps; sees 0.3 % of all rays.
    """
    floor = quad([-9, -9, 0], [18, 0, 0], [0, 18, 0], 0.5)
    view = camera([0.4, 0.6, 0.4], [0, 0, 0])

    def lamp(k: int, up: bool) -> object:
        corner, a, b = [k % 10 - 5, k // 10 - 5, 2], [0.5, 0, 0], [0, 0.5, 0]
        return quad(corner, a, b, 0, k + 1.0) if up else quad(corner, b, a, 0, k + 1.0)

    def p_value(effort: int, seed: int) -> float:
        n, p = 50_000 * effort, []
        for turned in (0, 1, 2, 31, 50, 62, 63, 98, 99):
            scene = make([floor, *(lamp(k, k == turned) for k in range(100))], view, max_depth=2)
            ledger = veriray.render(scene, spp=n, seed=seed + turned, device=device).stats["ledger"]
            wanted = ledger["shadow_occluded"][0] + ledger["shadow_visible"][0]
            p.append(stats.binomtest(n - wanted, n, (turned + 1) / 5050).pvalue)
        return sidak(min(p), 9)

    confirm(p_value)


# ---- pixel filters and the camera ----


def distribution(name: str, parameter: float) -> Callable[[float], float]:
    """Cumulative distribution of a filter about the pixel's centre, pixels; by formula."""
    if name == "box":
        return lambda x: min(max(x + 0.5, 0.0), 1.0)
    if name == "tent":

        def tent(x: float) -> float:
            t = min(max(x / parameter, -1.0), 1.0)
            return (1 + t) ** 2 / 2 if t < 0 else 1 - (1 - t) ** 2 / 2

        return tent

    def density(z: float) -> float:
        return math.exp(-z * z / 2) - math.exp(-8) if abs(z) < 4 else 0.0

    whole = integrate.quad(density, -4, 4)[0]
    return lambda x: integrate.quad(density, -4, min(max(x / parameter, -4), 4))[0] / whole


def half_plane(edge_x: float, edge_y: float, name: str, parameter: Any) -> veriray.Scene:
    """Radiance 1 right of and below a point of a 16 x 12 film."""
    width, height, fov = 16, 12, 50.0
    tan_x = math.tan(math.radians(fov / 2))
    tan_y = tan_x * height / width
    x = tan_x * (1 - 2 * edge_x / width)
    y = tan_y * (1 - 2 * edge_y / height)
    # The film's right is local -X, its bottom local -Y; the front faces the camera.
    plane = quad([x, y, 1], [0, -9, 0], [-9, 0, 0], 0, 1.0)
    return make([plane], veriray.Camera(np.eye(4), fov), 0.0, width, height, name, parameter)


@pytest.mark.parametrize(("edge_x", "edge_y"), [(9.3, 7.7), (4.5, 3.02), (11.98, 5.25)])
@pytest.mark.parametrize(
    ("name", "parameter"), [("box", 0.5), ("tent", 1.0), ("tent", 1.7), ("gaussian", 0.5)]
)
def test_a24_filters(
    device: str, name: str, parameter: float, edge_x: float, edge_y: float
) -> None:
    """A bright half plane whose corner falls on (edge_x, edge_y) of a 16 x 12 film.

    Every pixel must hold the part of its filter beyond both edges: finds shifts, flips, aspect,
    field of view, jitter and filter errors. 25,000 samples a pixel: sees 0.015 pixel.
    """
    width, height = 16, 12
    scene = half_plane(edge_x, edge_y, name, None if name == "box" else parameter)
    cdf = distribution(name, parameter)
    right = np.array([1 - cdf(edge_x - (i + 0.5)) for i in range(width)])
    below = np.array([1 - cdf(edge_y - (j + 0.5)) for j in range(height)])
    exact = np.outer(below, right)
    table = 1e-4 if name == "gaussian" else 0.0  # margin: it is drawn from a table

    def p_value(effort: int, seed: int) -> float:
        n = 25_000 * effort
        image = veriray.render(scene, spp=n, seed=seed, device=device).image[:, :, 0]
        hits = np.rint(image.astype(np.float64) * n)
        certain = (exact < 1e-12) | (exact > 1 - 1e-12)
        assert (image[certain] == np.rint(exact[certain])).all()
        nearest = np.clip(hits / n, np.maximum(exact - table, 0), np.minimum(exact + table, 1))
        p = [stats.binomtest(int(h), n, e).pvalue
             for h, e in zip(hits[~certain], nearest[~certain], strict=True)]  # fmt: skip
        return sidak(min(p), len(p))

    confirm(p_value)


def mitchell(x: float, b: float, c: float) -> float:
    """D. Mitchell, A. Netravali, "Reconstruction Filters in Computer Graphics", 1988."""
    x = abs(x)
    if x < 1:
        return ((12 - 9 * b - 6 * c) * x**3 + (-18 + 12 * b + 6 * c) * x**2 + 6 - 2 * b) / 6
    cubic = (-b - 6 * c) * x**3 + (6 * b + 30 * c) * x**2 + (-12 * b - 48 * c) * x + 8 * b + 24 * c
    return cubic / 6 if x < 2 else 0.0


@pytest.mark.parametrize(("edge_x", "edge_y"), [(9.3, 7.7), (4.5, 3.02)])
@pytest.mark.parametrize("parameters", [(1 / 3, 1 / 3), (0.0, 0.5), (1.0, 0.0)])
def test_signed_filter(
    device: str, parameters: tuple[float, float], edge_x: float, edge_y: float
) -> None:
    """As above for Mitchell's filter: a pixel may lie below 0 and above 1.

    z by the exact variance: samples have the size (integral of |f|)^2 and the sign of both lobes.
    """

    def share(edge: float, centre: float, sign: bool) -> float:
        """Integral of f (of |f|) beyond an edge."""
        start = min(max(edge - centre, -2.0), 2.0)
        knots = [start, *(k for k in (-1, 0, 1, 2) if k > start)]
        f = partial(mitchell, b=parameters[0], c=parameters[1])
        g = f if sign else lambda x: abs(f(x))
        return sum(integrate.quad(g, p, q, limit=200)[0] for p, q in itertools.pairwise(knots))

    def product(sign: bool) -> np.ndarray:
        return np.outer([share(edge_y, j + 0.5, sign) for j in range(12)],
                        [share(edge_x, i + 0.5, sign) for i in range(16)])  # fmt: skip

    exact, size = product(True), share(-2, 0, False) ** 2
    second = product(False) * size
    assert abs(share(-2, 0, True) - 1) < 1e-9 and (exact.max() > 1.01) == (parameters[1] > 0)

    def p_value(effort: int, seed: int) -> float:
        n = 25_000 * effort
        scene = half_plane(edge_x, edge_y, "mitchell", parameters)
        image = veriray.render(scene, spp=n, seed=seed, device=device).image[:, :, 0]
        assert (image[second == 0] == 0).all()
        variance = second - exact**2
        seen = (n * second > 100 * size**2) & (variance > 1e-9)
        off = np.maximum(np.abs(image - exact) - 1e-4, 0)  # it is drawn from a table
        assert off[~seen].max() < 0.02
        return max_z(off[seen] / np.sqrt(variance[seen] / n))

    confirm(p_value)


@pytest.mark.parametrize("axis", ["x", "y", "diagonal", "smaller", "larger"])
def test_a24_field_of_view_and_offset(device: str, axis: str) -> None:
    """A bright square 30 degrees wide: `fov` is measured along its axis, offsets shift it."""
    width, height = 40, 24
    offset = (0.1, -0.05)
    view = veriray.Camera(np.eye(4), 90.0, axis, principal_point_offset=np.array(offset))
    size = {"x": width, "y": height, "diagonal": math.hypot(width, height),
            "smaller": height, "larger": width}[axis]  # fmt: skip
    t = math.tan(math.radians(15))
    scene = make(
        [quad([-t, -t, 1], [0, 2 * t, 0], [2 * t, 0, 0], 0, 1.0)], view, 0.0, width, height
    )
    half = t * size / 2
    centre = (width * (0.5 - offset[0]), height * (0.5 - offset[1]))
    cover = []
    for c, n in zip(centre, (width, height), strict=True):
        left = np.arange(n)
        cover.append(np.clip(np.minimum(left + 1, c + half) - np.maximum(left, c - half), 0, 1))
    agrees_with = np.outer(cover[1], cover[0])[..., None]
    image = veriray.render(scene, spp=4000, device=device).image
    assert np.abs(image - agrees_with).max() < 5 * 0.5 / math.sqrt(4000)
    assert (image[agrees_with[..., 0] == 0] == 0).all()
    assert (image[agrees_with[..., 0] == 1] == 1).all()


def test_clipping(device: str) -> None:
    """near_clip and far_clip are planes: three screens at 1, 2, 3 seen between them."""
    screens = [quad([-9, -9, z], [0, 18, 0], [18, 0, 0], 0, float(z)) for z in (1, 2, 3)]
    for near, far, shown in ((0.0, math.inf, 1), (0.5, 9.0, 1), (1.5, math.inf, 2), (2.5, 9.0, 3),
                             (2.5, 2.9, 0), (3.5, 9.0, 0), (0.1, 0.9, 0)):  # fmt: skip
        view = veriray.Camera(np.eye(4), 100.0, "x", near, far)
        scene = make(screens, view, 0.0, 8, 6)
        agrees(scene, shown, device, 50, sees=1e-3)
