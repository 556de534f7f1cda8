"""Level 2: samples have the density that is claimed: mappings, flights, phase functions.

Chi-square over four grids (1 x 8, 8 x 4, 16 x 16, 32 x 64) of the same points in the sampler's own
coordinates, with a cell for lost samples: one fine grid alone accepts a density that is 1 % wrong.
"""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import numpy.typing as npt

from veriray_validate.levels import numbers
from veriray_validate.oracles import (
    INVERSE,
    azimuth,
    normalised,
    one_minus_cos,
    phase_inverse,
    single,
)
from veriray_validate.scenes import NULL, Medium, camera, make, sphere
from veriray_validate.statistics import binomial, grid_family, max_z
from veriray_validate.trial import Skipped, Trial, case

Array = npt.NDArray[Any]

#: Samples of a chi-square test.
N = 100_000


def random_numbers(t: Trial, n: int) -> Array:
    """(4, n) float32 in [0, 1): multiples of 2^-24, by the renderer's generator."""
    zero, index = np.zeros(n, np.uint32), np.arange(n)
    words = t.native.random(t.fresh(), zero, index.astype(np.uint64), zero + 1)
    t.samples += n
    return (words >> 8).T.astype(np.float32) * np.float32(2.0**-24)


def random_points(t: Trial, name: str, n: int, *more: float) -> Array:
    """The points of a mapping with two random numbers."""
    return t.function(name, *random_numbers(t, n)[2:], *more)


def z_of_mean(values: Array, mean: float, margin: float = 0.0) -> float:
    """Standard score of a mean; margin: relative bias that is allowed."""
    error = values.std() / math.sqrt(len(values))
    return float((values.mean() - mean) / max(error, margin * abs(mean), 1e-300))


def uniform(t: Trial, u: Array, v: Array, what: str = "", drawn: int | None = None,
            chance: float = 1.0) -> None:  # fmt: skip
    """Tests that points are uniform in the unit square: `grid_family`.

    Sees 1 % in scale with 10^5 points, 2 % with 2.5 x 10^4; a cosine's tilt of four times that.
    """
    t.p(grid_family(u, v, drawn, chance), what)
    t.sees(0.01 * math.sqrt(1e5 / len(u)))


def count(t: Trial, k: int, n: int, p: float, what: str = "") -> None:
    """Tests that k of n have probability p: exact binomial; sees an absolute difference."""
    t.p(binomial(int(k), n, p), what)
    t.sees((3.29 + 1.28) * math.sqrt(p * (1 - p) / n))


def replayed(t: Trial, scene: Any, n: int, max_depth: int) -> list[list[dict[str, Any]]]:
    """Some paths of a one-pixel scene, vertex by vertex."""
    native = t.native
    if not hasattr(native, "trace_path"):
        raise Skipped("paths are replayed on the CPU")
    host, seed = t.native_scene(scene), t.fresh()
    t.samples += n
    return [
        native.trace_path(
            host, seed=seed, x=0, y=0, sample=k, max_depth=max_depth, rr_depth=10_000,
            sampler="independent",
        )
        for k in range(n)
    ]  # fmt: skip


# ---- mappings ----


@case(2, each={"name": INVERSE})
def mappings(t: Trial, name: str) -> None:
    """Points of the maps to hemisphere, sphere, triangle and disc fall as their density says.

    10^5 points: sees 1 % in scale, 4 % in tilt, in a full run half of that.
    """
    u, v = INVERSE[name](random_points(t, name, N * t.effort))
    uniform(t, np.clip(u, 0, 1), np.clip(v, 0, 1), name)


@case(2)
def moments(t: Trial) -> None:
    """Means that are known.

    E[cos] = 2/3, E[cos^2] = 1/2 of the cosine lobe; E[x] = 0; barycentric weights 1/3. n = 10^5:
    sees 0.5 %.
    """
    n, z = 100_000 * t.effort, []
    lobe = random_points(t, "cosine_hemisphere", n)
    triangle = random_points(t, "uniform_triangle", n)
    disk = random_points(t, "uniform_disk", n)
    for values, mean in (
        (lobe[:, 2], 2 / 3), (lobe[:, 2] ** 2, 1 / 2), (lobe[:, 0], 0), (lobe[:, 1], 0),
        (triangle[:, 0], 1 / 3), (triangle[:, 1], 1 / 3), (triangle[:, 2], 1 / 3),
        (disk[:, 0], 0), (disk[:, 1], 0), ((disk**2).sum(1), 1 / 2),
    ):  # fmt: skip
        z.append(z_of_mean(values, mean))
    t.p(max_z(np.array(z)), "moments")


@case(2)
def a_planted_percent_is_found(t: Trial) -> None:
    """Planted: a cosine lobe that is 1 % wrong, or loses one sample in 200.

    Azimuth shrunk by 1 %, tilted by 2 %, sines to the power 1.01; 1.6 x 10^6 points: the test that
    accepts the right lobe rejects all of these.
    """
    u, v = INVERSE["cosine_hemisphere"](random_points(t, "cosine_hemisphere", 16 * N))
    t.check(grid_family(u, v * 0.99) < 1e-6, "shrunk")
    t.check(grid_family(u, v + 0.02 / (2 * np.pi) * np.sin(2 * np.pi * v) ** 2) < 1e-3, "tilted")
    t.check(grid_family(u**1.01, v) < 1e-3, "power")
    kept = t.rng.random(len(u)) > 0.005
    t.check(grid_family(u[kept], v[kept], len(u)) == 0, "lost where none may be")
    some = t.rng.random(len(u)) > 0.1
    t.check(grid_family(u[some & kept], v[some & kept], len(u), 0.9) < 1e-3, "lost")


@case(2, each={"open_": [2.0, 0.5, 1e-13]})
def cones(t: Trial, open_: float) -> None:
    """Directions in cones of 1 - cos = 2, 1/2 and 1e-13 are uniform.

    10^5 points: sees 1 % in scale, 4 % in tilt, in a full run half of that.
    """
    p = random_points(t, "uniform_cone", N * t.effort, open_)
    uniform(t, np.clip(one_minus_cos(p) / open_, 0, 1), azimuth(p), "cone")


# ---- media ----

ASYMMETRIES = (0.0, 1e-4, -0.5, 0.9, 0.999, -0.999, 0.9999, -0.9999)


@case(2, each={"g": ASYMMETRIES})
def phase_function(t: Trial, g: float) -> None:
    """Henyey and Greenstein's phase function, by its cumulative distribution.

    10^5 directions: sees 1 % in scale, 4 % in tilt, in a full run half of that.
    """
    u, v = random_numbers(t, N * t.effort)[2:]
    wi = t.function("henyey_greenstein", 0, 0, 1, g, u, v)[:, :3]
    uniform(t, *phase_inverse(wi, g), "directions")


@case(2)
def phase_function_moments(t: Trial) -> None:
    """Moments of the phase function about a tilted axis.

    E[P_l(cos)] = g^l for Legendre's polynomials, l = 1, 2, 3; 50,000 directions a value of g.
    """
    d, z = np.array([0.48, -0.64, 0.6]), []
    for g in (-0.9, -0.3, 0.0, 1e-4, 0.5, 0.95):
        u, v = random_numbers(t, 50_000 * t.effort)[2:]
        c = t.function("henyey_greenstein", *d, g, u, v)[:, :3] @ d
        legendre = (c, (3 * c**2 - 1) / 2, (5 * c**3 - 3 * c) / 2)
        z += [z_of_mean(p, g**l) for l, p in enumerate(legendre, 1)]  # noqa: E741
    t.p(max_z(np.array(z)), "moments")


@case(2)
def free_flights(t: Trial) -> None:
    """Free flights are exponential with mean 1, and pairs of them independent.

    By their cumulative distribution; 10^5 pairs: sees 1 % in scale, 4 % in tilt, in a full run half
    of that.
    """
    n = N * t.effort
    zero, index = np.zeros(n, np.uint32), np.arange(n).astype(np.uint64)
    words = t.native.random(t.fresh(), zero, index, zero + 3)
    x, y = (t.function("exponential", w >> 16, w & 65535)[:, 0] for w in words.T[:2])
    uniform(t, -np.expm1(-x), -np.expm1(-y), "distribution")
    t.p(max_z(np.array([z_of_mean(x, 1), z_of_mean(x**2, 2), z_of_mean(y, 1)])), "moments")


def hooked(t: Trial, name: str, *columns: Any) -> Array:
    """`t.function` for what older native modules may lack."""
    return numbers.hooked(t.function, name, *columns)


def halves(t: Trial, n: int) -> tuple[Array, Array, Array]:
    """Upper and lower 16 bits of random words, and numbers in [0, 1)."""
    zero, index = np.zeros(n, np.uint32), np.arange(n).astype(np.uint64)
    words = t.native.random(t.fresh(), zero, index, zero + 3)
    t.samples += n
    return words[:, 0] >> 16, words[:, 0] & 65535, (words[:, 1] >> 8) * 2.0**-24


@case(2, each={"sigma": [0.5, 20.0], "limit": [0.1, 3.0]})
def collisions(t: Trial, sigma: float, limit: float) -> None:
    """Flights in a grey medium: how many collide before a limit, and where.

    Share 1 - exp(-sigma limit) by an exact binomial; distances by their cumulative distribution,
    the others in a cell of their own. 10^5 flights: sees 1 % of the share.
    """
    n = N * t.effort
    high, low, _ = halves(t, n)
    far, collides = hooked(t, "free_flight", sigma, limit, high, low).T
    t.check((collides == 1) == (far < single(limit)), "weights")
    share = -math.expm1(-sigma * single(limit))
    count(t, collides.sum(), n, share, "share")
    u = -np.expm1(-sigma * far[collides == 1]) / share
    uniform(t, np.clip(u, 0, 1), t.rng.random(len(u)), "distances", n, share)


@case(2)
def collisions_in_colour(t: Trial) -> None:
    """Flights in a coloured medium: weights are unbiased, whatever the path carries.

    E[weight; collides before s] = albedo (1 - exp(-sigma s)), E[weight; arrives] = exp(-sigma s);
    sigma from 0.2 to 5, three throughputs, 10^5 flights each: sees 1.5 %. Weights never exceed the
    bound of the balance heuristic.
    """
    n, z = N * t.effort, []
    sigma, albedo = np.array([0.2, 1.0, 5.0]), np.array([0.9, 0.5, 0.2])
    for throughput in ([1, 1, 1], [0.5, 0.1, 1.0], [0.02, 3.0, 0.3]):
        high, low, u = halves(t, n)
        limit = 0.8
        out = hooked(t, "free_flight_colour", *sigma, *albedo, *throughput, limit, u, high, low)
        far, weight = out[:, 0], out[:, 1:]
        collides = far < single(limit)
        carried = np.array(throughput) / np.sum(throughput)
        t.check(weight <= 1 / carried * 1.00001, "weights")
        for s in (0.1, limit):
            for k in range(3):
                mean = albedo[k] * -math.expm1(-sigma[k] * s)
                z.append(z_of_mean(np.where(collides & (far < single(s)), weight[:, k], 0), mean))
        for k in range(3):
            mean = math.exp(-sigma[k] * limit)
            z.append(z_of_mean(np.where(collides, 0, weight[:, k]), mean))
    t.p(max_z(np.array(z)), "means")


@case(2, each={"g": [0.0, 0.7, -0.9]})
def scatterings_of_paths(t: Trial, g: float) -> None:
    """Flights and directions of whole paths in a medium, as the renderer takes them.

    Replayed on the CPU, 10^4 paths from the centre of a ball of radius 1 and sigma 2: distances and
    angles by their cumulative distributions, the share that leaves by an exact binomial. Sees 3 %
    in scale, 12 % in tilt.
    """
    ball = sphere([0, 0, 0], 1, material=NULL, interior=Medium(2.0, 0.8, g))
    look = camera([0, 0, 0], [0.3, -0.5, 1.0])
    scene = make([ball], look, camera_medium=Medium(2.0, 0.8, g))
    n = 10_000 * t.effort
    paths = replayed(t, scene, n, 2)
    inside = [p for p in paths if p[0]["primitive"] < 0 and p[0]["event"] == "scattered"]
    leave = math.exp(-2.0)
    count(t, n - len(inside), n, leave, "leaving")
    far = np.array([p[0]["t"] for p in inside])
    u = np.clip(-np.expm1(-2 * far) / (1 - leave), 0, 1)
    uniform(t, u, t.rng.random(len(u)), "distances", n, 1 - leave)
    t.check(np.array([p[1]["throughput"][0] for p in inside]) == single(0.8), "weights")
    d = np.array(inside[0][0]["direction"])
    a = normalised(np.cross(d, [[0.0, 1.0, 0.0]]))[0]
    wi = np.array([p[1]["direction"] for p in inside]) @ np.stack([a, np.cross(d, a), d]).T
    uniform(t, *phase_inverse(wi, g), "angles")
