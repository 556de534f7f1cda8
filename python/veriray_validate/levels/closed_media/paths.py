"""Paths: a known number of scatterings, their mean length, the 2016 report's parameters."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import numpy.typing as npt
import trimesh
from scipy import stats

from veriray_validate.dicts import NULL, cuboid, direction, medium, rgb, scene, sky, sphere, view
from veriray_validate.form_factors import gauss
from veriray_validate.levels.closed_media.slabs import ALBEDOS, at
from veriray_validate.scenes import Medium, Part, box, camera, make, material
from veriray_validate.statistics import chi_square, max_z, smallest_bias
from veriray_validate.trial import Trial, case

Array = npt.NDArray[np.float64]


# ---- one scattering, and a known number of them ----


@case(3)
def single_scattering(t: Trial) -> None:
    """One scattering in a slab of tau = 1, isotropic, albedo .5, under a sun overhead.

    w / 4 pi mu0 / (mu + mu0) (1 - exp(-tau (1/mu + 1/mu0))) E = .025205181 at mu = .5.
    """
    w, mu, tau = 0.5, 0.5, 1.0
    exact = w / (4 * math.pi) / (mu + 1) * (1 - math.exp(-tau * (1 / mu + 1)))
    t.check(abs(exact - 0.025205181) < 1e-9)
    x, v = gauss(40)
    t.check(abs(exact - w / (4 * math.pi) / mu * float(v @ np.exp(-x * (1 / mu + 1)))) < 1e-12)
    slab = cuboid([-40, -40, 0], [40, 40, 1], NULL, interior=medium(1.0, w))
    light = {"type": "directional", "direction": np.array([0, 0, -1.0]), "irradiance": rgb(1)}
    seen = scene(view(at(mu), [0, 0, 0]), slab, light, max_depth=2)
    t.agrees(seen, exact, 1_600_000, sees=0.01)


@case(3, each={"g": (0.8, -0.5)})
def single_scattering_has_the_phase_function(t: Trial, g: float) -> None:
    """One scattering with Henyey and Greenstein's law, light 60 degrees aside.

    4 pi p(cos) in place of 1.
    """
    tau, mu, mu0 = 1.0, 1.0, 0.5
    cosine = -0.5  # of the turn: up to the camera from a beam 60 degrees off the way down
    phase = (1 - g * g) / (1 + g * g - 2 * g * cosine) ** 1.5
    exact = 0.9 / (4 * math.pi) * phase * mu0 / (mu + mu0) * (1 - math.exp(-tau / mu - tau / mu0))
    slab = cuboid([-40, -40, 0], [40, 40, 1], NULL, interior=medium(1.0, 0.9, g))
    light = {"type": "directional", "direction": -direction(60), "irradiance": rgb(1)}
    seen = scene(view([0, 0, 5], [0, 0, 0.5]), slab, light, max_depth=2)
    t.agrees(seen, exact, 1_600_000, sees=0.01)


@case(3, each={"g": (0.0, 0.6, -0.8), "mu": (0.5, 1.0)},
      quick=lambda g, mu: (g, mu) == (0.6, 0.5))  # fmt: skip
def single_scattering_through_a_slab(t: Trial, g: float, mu: float) -> None:
    """One scattering, seen from below, in three colours.

    w / 4 pi mu0 / (mu0 - mu) (e^(-tau / mu0) - e^(-tau / mu)) E with mu0 = .8 across from the eye,
    times 4 pi p(cos). Sees 1 %.
    """
    mu0, tau, w = 0.8, 1.5, ALBEDOS
    sine, sine0 = math.sqrt(1 - mu * mu), math.sqrt(1 - mu0 * mu0)
    cosine = mu * mu0 - sine * sine0
    phase = (1 - g * g) / (1 + g * g - 2 * g * cosine) ** 1.5
    depths = (math.exp(-tau / mu0) - math.exp(-tau / mu)) * mu0 / (mu0 - mu)
    x, v = gauss(40, 0, tau)
    t.check(abs(depths - float(v @ np.exp(-x / mu0 - (tau - x) / mu)) / mu) < 1e-12, "two ways")
    exact = 2 * w / (4 * math.pi) * phase * depths
    slab = cuboid([-90, -90, -tau], [90, 90, 0], NULL, interior=medium(1.0, w, g))
    # light comes down towards +x; what reaches the eye goes down towards -x
    sun = {"type": "directional", "direction": np.array([sine0, 0, -mu0]), "irradiance": rgb(2)}
    low = np.array([0, 0, -tau])
    eye = view(low + 5 * np.array([-sine, 0, -mu]), low, 1e-3)
    t.agrees(scene(eye, slab, sun, max_depth=2), exact, 1_600_000, sees=0.01, margin=5e-5)


SCATTERINGS = {1.0: (0.153426, 0.097273, 0.069241, 0.052697, 0.041916, 0.034406),
               0.5: (0.225347, 0.125615, 0.081466, 0.057809),
               0.1: (0.380105, 0.147939, 0.078560)}  # fmt: skip


@case(3, each={"mu": SCATTERINGS, "rr_depth": (1, 1000)},
      quick=lambda mu, rr_depth: (mu, rr_depth) == (0.5, 1))  # fmt: skip
def leaves_after_n_scatterings(t: Trial, mu: float, rr_depth: int) -> None:
    """Half space, isotropic, albedo 1: paths out after n scatterings.

    Exact multinomial; n = 1 is (1 - mu log(1 + 1/mu)) / 2. Segment 0 ends at the null boundary;
    after n scatterings, segment n + 2 is outside. With albedo 1 roulette ends no path. Sees 1 % of
    the first.
    """
    law = np.array(SCATTERINGS[mu])
    t.check(abs(law[0] - (1 - mu * math.log(1 + 1 / mu)) / 2) < 1e-6)
    ground = cuboid([-500, -500, -500], [500, 500, 0], NULL, interior=medium(1.0, 1.0))
    half = scene(view(at(mu), [0, 0, 0]), ground, sky(1), max_depth=12, rr_depth=rr_depth)
    r = t.render(half, 1_000_000)
    n, escaped = r.spp, r.stats["ledger"]["escaped"]
    t.check(not any(escaped[:3]) and not any(r.stats["ledger"]["rr_killed"]))
    seen = np.array(escaped[3 : 3 + len(law)])
    t.p(chi_square(np.append(seen, n - seen.sum()), n * np.append(law, 1 - law.sum())), "orders")


@case(3, each={"depth": (1, 2, 3, 4, 6)})
def depth_counts_in_a_medium(t: Trial, depth: int) -> None:
    """Orders of scattering by max_depth: n scatterings take max_depth n + 1.

    Half space at mu = 1 in a sky of 1: the sum of w^k times the law of the last case, k < depth; 0
    exactly at max_depth 1. Boundaries are not vertices. Sees 2 %.
    """
    law = np.array(SCATTERINGS[1.0])[: depth - 1]
    exact = [float((w ** np.arange(1, depth)) @ law) for w in ALBEDOS.tolist()]
    ground = cuboid([-500, -500, -500], [500, 500, 0], NULL, interior=medium(1.0, ALBEDOS))
    seen = scene(view(at(1.0), [0, 0, 0]), ground, sky(1), max_depth=depth)
    t.agrees(seen, exact, 400_000, sees=0.02)


@case(3, each={"g": (0.6, -0.4, 0.9)})
def direction_after_n_scatterings(t: Trial, g: float) -> None:
    """The turn after n scatterings with Henyey and Greenstein's law.

    E[cos] = g^n, E[P2] = g^2n, and the whole law is that of g^n: chi-square in its own
    coordinate. Chains of the core's sampler, n = 1, 2, 3. Sees 1 % in the mean cosine (g = .6).
    """
    paths = 200_000 * t.effort
    d = np.tile([0.0, 0.6, 0.8], (paths, 1))
    for n in (1, 2, 3):
        u = t.rng.random((paths, 2))
        d = t.function("henyey_greenstein", *d.T, np.full(paths, g), *u.T)[:, :3]
        t.check(np.abs(np.linalg.norm(d, axis=1) - 1).max() < 1e-5)
        cosine = d @ [0.0, 0.6, 0.8]
        h = g**n
        legendre = (3 * cosine**2 - 1) / 2
        for values, exact in ((cosine, h), (legendre, h * h)):
            t.p(max_z(np.array([(values.mean() - exact) / values.std() * math.sqrt(paths)])),
                f"moment after {n}")  # fmt: skip
        # distribution of the law with mean cosine h: (1 - h^2) / 2h (1 / sqrt(...) - 1 / (1 + h))
        root = np.sqrt(1 + h * h - 2 * h * np.clip(cosine, -1, 1))
        below = (1 - h * h) / (2 * h) * (1 / root - 1 / (1 + h))
        counts = np.bincount((np.clip(below, 0, 1 - 1e-12) * 16).astype(int), minlength=16)
        t.p(chi_square(counts, np.full(16, paths / 16)), f"law after {n}")
        if n == 1:
            t.sees(smallest_bias(float(cosine.std()) / math.sqrt(paths), g), 0.02)


# ---- how long a path is ----


@case(3, each={"body": ((1.0, 0.0), (8.0, 0.0), (6.0, 0.9), (2.0, -0.5))})
def mean_path_in_a_lossless_ball(t: Trial, body: tuple[float, float]) -> None:
    """Scatterings in a ball that light enters by the cosine law; body: sigma, g.

    The mean path is 4 V / S = 4/3, whatever sigma and g (S. Blanco and R. Fournier, 2003), so the
    mean number of scatterings is 4/3 sigma. A far camera's almost parallel rays over the whole disc
    follow the cosine law at the surface. Segments: 1 to the ball, n + 1 inside, 1 outside. z test
    with the counts' own variance; sees 2 %.
    """
    sigma, g = body
    distance = 100.0
    fov = 2 * math.degrees(math.atan(1.02 / distance))
    ball = sphere([0, 0, 0], 1, NULL, interior=medium(sigma, 1.0, g))
    far = scene(view([0, 0, distance], [0, 0, 0], fov), ball, sky(1), max_depth=60_000)
    r = t.render(far, 200_000, rr_depth=10**6)
    t.check(not any(r.stats["ledger"]["depth_cut"]))
    live = np.array(r.stats["live_rays"], np.float64)
    inside = live[2:] / live[1]  # inside[k]: share with at least k scatterings, less the last
    mean = inside.sum() - 1
    second = ((2 * np.arange(len(inside)) - 1) * inside)[1:].sum()
    error = math.sqrt((second - (inside[1:].sum()) ** 2) / live[1])
    t.p(2 * float(stats.norm.sf(abs(mean - sigma * 4 / 3) / error)), "mean scatterings")
    t.sees(smallest_bias(error, mean), 0.02)


BOXES = {"cube": ([1.0, 1, 1], 0.666667), "box": ([1.0, 2, 3], 1.090909)}


@case(3, each={"body": BOXES, "made": ("quads", "mesh"), "g": (0.0, 0.8)},
      quick=lambda body, made, g: (body, made, g) == ("box", "quads", 0))  # fmt: skip
def mean_path_in_a_lossless_box(t: Trial, body: str, made: str, g: float) -> None:
    """Scatterings in a cube and in a box 1 x 2 x 3 that light enters from all sides.

    4 V / S = .666667 and 1.090909 mean free paths, whatever g; none is cut (exact). One distant
    picture of the sphere around the box from each of 200 random directions: the rays that meet the
    box obey the cosine law. Ratio of sums, error from the directions; sees 4 %. Six quads, or 192
    triangles in a tree.
    """
    size, exact = np.array(BOXES[body][0]), BOXES[body][1]
    surface = 2 * float(size @ np.roll(size, 1))
    t.check(abs(4 * size.prod() / surface - exact) < 1e-6)
    radius, distance, sigma = float(np.linalg.norm(size)) / 2, 100.0, 2.0
    fov = 2 * math.degrees(math.atan(1.02 * radius / distance))
    mesh = trimesh.creation.box(size).subdivide().subdivide()
    fog = {"interior": Medium(sigma, 1.0, g), "material": material("null")}
    if made == "quads":
        part = box(-size / 2, size / 2, False, **fog)
    else:
        part = Part(mesh.vertices, mesh.faces, **fog)

    def seen_from(d: Array) -> Any:
        return camera(distance * d / np.linalg.norm(d), [0, 0, 0], fov)

    scene = make([part], seen_from(np.ones(3)), 1.0, max_depth=2000, rr_depth=10**6)
    hits, turns = [], []
    for _ in range(200 * t.effort):
        far = scene.with_(camera=seen_from(t.rng.normal(size=3)))
        r = t.render(far, 1000 // t.effort)
        escaped = np.array(r.stats["ledger"]["escaped"], np.float64)[2:]  # after n scatterings
        t.check(not any(r.stats["ledger"]["depth_cut"]), "rays never leave the medium")
        hits.append(escaped.sum())
        turns.append(escaped @ np.arange(len(escaped)))
    n, s = np.array(hits), np.array(turns)
    mean = s.sum() / n.sum()
    error = math.sqrt(float(((s - mean * n) ** 2).sum())) / n.sum()
    t.p(2 * float(stats.norm.sf(abs(mean - sigma * exact) / error)), "mean scatterings")
    t.sees(smallest_bias(error, mean), 0.04)


# ---- the report's parameters ----


def report_ball(scattering: float, absorption: float, paths: int, seed: int) -> Array:
    """Weights of paths shot through the centre of the unit ball by the report's rule.

    Free flight -log(u) / sigma_s', isotropic turns, every segment times exp(-mu d), until it
    leaves; under a sky of 1 their mean is the radiance.
    """
    rng = np.random.default_rng(seed)
    p = np.tile([0.0, 0.0, 1.0], (paths, 1))
    d = np.tile([0.0, 0.0, -1.0], (paths, 1))
    weight = np.ones(paths)
    alive = np.arange(paths)
    while alive.size:
        b = (p * d).sum(1)
        exit_ = -b + np.sqrt(np.maximum(b * b + 1 - (p * p).sum(1), 0))
        flight = rng.exponential(1 / scattering, alive.size)
        weight[alive] *= np.exp(-absorption * np.minimum(flight, exit_))
        stays = flight < exit_
        alive, p = alive[stays], (p + flight[:, None] * d)[stays]
        z, phi = rng.uniform(-1, 1, alive.size), rng.uniform(0, 2 * math.pi, alive.size)
        s = np.sqrt(1 - z * z)
        d = np.stack([s * np.cos(phi), s * np.sin(phi), z], 1)
    return weight


@case(3, each={"values": ((4.0, 0.3), (1.0, 1.0), (8.0, 0.1))},
      quick=lambda values: values == (1.0, 1.0))  # fmt: skip
def report_parameters(t: Trial, values: tuple[float, float]) -> None:
    """A ball by the 2016 report's parameters sigma_s' and mu, and its own procedure.

    sigma_s = sigma_s', sigma_a = mu, isotropic: equal to the report's procedure, in expectation.
    Two-sample z test against the procedure itself in NumPy; sees 2 %.
    """
    scattering, absorption = values
    total = scattering + absorption
    ball = sphere([0, 0, 0], 1, NULL, interior=medium(total, scattering / total))
    r = t.render(scene(view([0, 0, 5], [0, 0, 0], 1e-3), ball, sky(1)), 400_000)
    weight = report_ball(scattering, absorption, 100_000 * t.effort, t.fresh())
    error = math.hypot(float(r.stderr[0, 0, 0]), weight.std() / math.sqrt(len(weight)))
    t.p(2 * float(stats.norm.sf(abs(float(r.image[0, 0, 0]) - weight.mean()) / error)), "procedure")
    t.sees(smallest_bias(error, float(weight.mean())), 0.02)


@case(3)
def report_parameters_as_sigma_s_and_sigma_a(t: Trial) -> None:
    """The same medium by sigma_s and sigma_a.

    The same film, bit for bit.
    """
    films, seed = [], t.fresh()
    parts = {"sigma_s": rgb(3.0), "sigma_a": rgb(1.0), "phase": {"type": "isotropic"}}
    for values in (medium(4.0, 0.75), {"type": "homogeneous", **parts}):
        ball = sphere([0, 0, 0], 1, NULL, interior=values)
        seen: Any = scene(view([0, 0, 5], [0, 0, 0], 30, 4), ball, sky(1))
        films.append(t.render(seen, 100, seed=seed).film_sha256)
    t.check(films[0] == films[1])
