"""Media of mirror flakes (`sggx`): density, draws, limits, extinction by direction, closed forms.

The oracle is float64 and uses S and its inverse, not the triangular factor that the code uses.
"""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import numpy.typing as npt

from veriray_validate.dicts import BLACK, NULL, Dict, cuboid, diffuse, flat, rgb, scene, sky, view
from veriray_validate.levels.closed_media.slabs import at
from veriray_validate.levels.samplers import N, hooked, random_numbers, uniform
from veriray_validate.oracles import azimuth, directions, dot, gauss, normalised, single
from veriray_validate.transfer import adding_doubling
from veriray_validate.trial import Trial, case

Array = npt.NDArray[Any]


def spread(axis: Any, along: float, across: float) -> Array:
    """S of flakes whose areas are these along and across an axis."""
    n = np.asarray(axis, float) / np.linalg.norm(axis)
    return along**2 * np.outer(n, n) + across**2 * (np.eye(3) - np.outer(n, n))


_TURN = np.linalg.qr(np.array([[3.0, 1, 2], [-1, 2, 2], [0.5, -2, 3]]))[0]
SHAPES: dict[str, Array] = {
    "round": np.eye(3),
    "flat": spread([1, 2, 0.5], 1, 0.3),
    "needles": spread([1, -1, 2], 0.2, 1),
    "aslant": _TURN @ np.diag([1, 0.16, 0.04]) @ _TURN.T,
    "thin needles": spread([0.2, 1, 0.4], 0.01, 1),
    "thin discs": spread([-0.6, 1, 0.4], 1, 0.01),
}
WIDE = ("round", "flat", "needles", "aslant")


def numbers(s: Array) -> Array:
    """xx, yy, zz, xy, xz, yz."""
    return s[[0, 1, 2, 0, 0, 1], [0, 1, 2, 1, 2, 2]]


def grid(s: Array) -> Dict:
    """S as a grid, as Mitsuba takes it."""
    cells = np.broadcast_to(numbers(s), (2, 2, 2, 6)).astype(np.float32)
    return {"type": "gridvolume", "grid": cells, "raw": True}


def sggx(s: Array) -> Dict:
    """The phase function."""
    return {"type": "sggx", "S": grid(s)}


def area(s: Array, d: Array) -> Array:
    """sqrt(d S d), of directions (..., 3)."""
    return np.asarray(np.sqrt(dot(d, d @ s)))


def value(s: Array, d: Array, wi: Array) -> Array:
    """D(h) / (4 area): light that goes on along wi from d."""
    h = normalised(wi - d)
    q = dot(h, h @ np.linalg.inv(s))
    return np.asarray(1 / (4 * math.pi * math.sqrt(np.linalg.det(s)) * q**2 * area(s, d)))


def lobe(s: Array) -> Array:
    """What a lobe's flakes are in the device's table: M, its inverse, 1 / (4 pi det M)."""
    m = np.linalg.cholesky(s)
    rows, columns = np.tril_indices(3)
    inverse = np.linalg.inv(m)
    scale = 1 / (4 * math.pi * np.prod(np.diag(m)))
    return np.array([*m[rows, columns], *inverse[rows, columns], scale])


def flakes(t: Trial, s: Array, d: Array, w: Array, u: Any = 0.5, v: Any = 0.5) -> Array:
    """Direction, its density, that of w, and the area along d, (n, 6)."""
    return hooked(t, "flakes", *d.T, *w.T, u, v, *lobe(s))


@case(2, each={"name": WIDE})
def flakes_scatter_all_light(t: Trial, name: str) -> None:
    """The integral of the phase function over the sphere is 1 within 1e-6, for 12 directions.

    By the halfway vector h, dw = 4 (w h) dh, with Gauss's rule over the hemisphere about w: 300
    cosines and 300 azimuths.
    """
    s = SHAPES[name]
    x, weight = gauss(300, 0.0, 1.0)
    phi = (np.arange(300) + 0.5) * (2 * math.pi / 300)
    sine = np.sqrt(1 - x * x)
    local = np.stack(np.broadcast_arrays(
        sine[:, None] * np.cos(phi), sine[:, None] * np.sin(phi), x[:, None]), axis=-1
    ).reshape(-1, 3)  # fmt: skip
    for d in directions(t.rng, 12):
        back = -d
        a = normalised(np.cross(back, np.eye(3)[int(abs(back).argmin())]))
        h = local @ np.stack([a, np.cross(back, a), back])
        cosine = np.repeat(x, 300)
        wi = 2 * cosine[:, None] * h - back
        got = flakes(t, s, np.broadcast_to(d, wi.shape), wi)[:, 4]
        whole = float((got * 4 * cosine * np.repeat(weight, 300)).sum() * 2 * math.pi / 300)
        t.check(abs(whole - 1) < 1e-6, f"{whole}")


@case(2, each={"name": SHAPES})
def density_of_flakes(t: Trial, name: str) -> None:
    """Density of what is drawn and of given directions, and the area, against the oracle.

    Area within 1e-6 of itself and 6e-7 of the largest, which is 1: the three numbers whose squares
    add up to its square have six roundings of 2^-24 each. Density within 2e-5, of thin flakes 1e-3,
    where directions differ by .01 or more: nearer, the halfway vector is that of their rounding.
    """
    s, n = SHAPES[name], 20_000 * t.effort
    d, w = single(directions(t.rng, n)), single(directions(t.rng, n))
    got = flakes(t, s, d, w, *random_numbers(t, n)[2:])
    exact = area(s, d)
    t.check((np.abs(got[:, 5] - exact) < 6e-7 + 1e-6 * exact).all(), "area")
    most = 1e-3 if name.startswith("thin") else 2e-5
    for wi, pdf in ((w, got[:, 4]), (got[:, :3], got[:, 3])):
        apart = np.sqrt(dot(wi - d, wi - d)) > 0.01
        off = np.abs(pdf[apart] / value(s, d[apart], wi[apart]) - 1).max()
        t.check(off < most, f"density off by {off:.2g}")
    t.check(np.abs(dot(got[:, :3], got[:, :3]) - 1).max() < 1e-6, "length")


@case(2, each={"name": SHAPES})
def directions_of_flakes(t: Trial, name: str) -> None:
    """Drawn directions by the law of their normals, in a frame where that is a cosine's.

    By the symmetric root of S: normals m with area, u = S^-1/2 m, spread by its cosine about S^1/2
    w. From one direction, then from many; 10^5 directions: sees 1 % in scale.
    """
    s, n = SHAPES[name], N * t.effort
    values, axes = np.linalg.eigh(s)
    root = axes @ np.diag(np.sqrt(values)) @ axes.T
    one = np.broadcast_to(single(normalised(np.array([0.3, -0.5, 0.8]))), (n, 3))
    for what, d in (("one", one), ("many", single(directions(t.rng, n)))):
        wi = flakes(t, s, d, d, *random_numbers(t, n)[2:])[:, :3]
        q = normalised(normalised(wi - d) @ np.linalg.inv(root))
        up = normalised(-d @ root)
        a = normalised(np.cross(up, np.eye(3)[0]))
        place = np.stack([dot(q, a), dot(q, np.cross(up, a)), dot(q, up)], axis=1)
        uniform(t, np.clip(place[:, 2] ** 2, 0, 1), azimuth(place), what)


@case(2)
def round_flakes_are_isotropic(t: Trial) -> None:
    """S = 1: mirrors of all normals alike scatter evenly, 1 / (4 pi), within 1e-6."""
    n = 100_000 * t.effort
    d, w = single(directions(t.rng, n)), single(directions(t.rng, n))
    got = flakes(t, np.eye(3), d, w)
    off = np.abs(got[:, 3:5] * (4 * math.pi) - 1).max()
    t.check(off < 1e-6, f"off by {off:.2g}")


@case(2)
def limit_of_needles(t: Trial) -> None:
    """Thin needles along an axis: cosines with it stay, azimuths turn as on a cylinder.

    Normals are across the axis; the sine of the angle between their azimuth and that of the way
    back is even in (-1, 1). Width .001: all but 1 % of the cosines within .05; 10^5 directions see
    1 % in scale.
    """
    n, axis = N * t.effort, normalised(np.array([0.2, 1.0, 0.4]))
    s = spread(axis, 0.001, 1)
    d = np.broadcast_to(single(normalised(np.array([0.3, -0.5, 0.8]))), (n, 3))
    wi = flakes(t, s, d, d, *random_numbers(t, n)[2:])[:, :3]
    kept = np.abs((wi - d) @ axis)
    t.check((kept > 0.05).mean() < 0.01, f"{(kept > 0.05).mean():.2%} leave the cone")
    m = normalised(wi - d)
    m = normalised(m - (m @ axis)[:, None] * axis)
    back = normalised(-d - (-d @ axis)[:, None] * axis)
    sine = dot(np.cross(back, m), np.broadcast_to(axis, m.shape))
    uniform(t, np.clip((sine + 1) / 2, 0, 1), t.rng.random(n), "azimuths")


@case(2)
def limit_of_discs(t: Trial) -> None:
    """Thin discs: nearly all light is mirrored at the plane across their axis.

    Width .001: all but 1 % within .05 of the mirror's direction, the median within .004.
    """
    n, axis = N * t.effort, normalised(np.array([-0.6, 1.0, 0.4]))
    d = np.broadcast_to(single(normalised(np.array([0.3, -0.5, 0.8]))), (n, 3))
    wi = flakes(t, spread(axis, 1, 0.001), d, d, *random_numbers(t, n)[2:])[:, :3]
    off = np.linalg.norm(wi - (d - 2 * (d @ axis)[:, None] * axis), axis=1)
    t.check((off > 0.05).mean() < 0.01, f"{(off > 0.05).mean():.2%} go elsewhere")
    t.check(np.median(off) < 0.004, f"median {np.median(off):.2g}")


# ---- in scenes ----


def fog(s: Array, sigma_t: float = 1.0, albedo: Any = 0.0, uneven: bool = False) -> Dict:
    """A medium of flakes; uneven: by a grid of ones over [-2, 2]^3, with its extinction."""
    values: Dict = {"albedo": rgb(albedo), "phase": sggx(s)}
    if not uneven:
        return {"type": "homogeneous", "sigma_t": sigma_t, **values}
    place = np.diag([4.0, 4, 4, 1])
    place[:3, 3] = -2
    ones = {"type": "gridvolume", "grid": np.ones((2, 2, 2), np.float32), "to_world": place}
    return {"type": "heterogeneous", "scale": sigma_t, "sigma_t": ones, **values}


WAYS = {"x": (1, 0, 0), "y": (0, -1, 0), "z": (0, 0, 1), "aslant": (1, -2, 0.7)}


@case(3, each={"name": [*WIDE, "thin discs"], "way": WAYS, "uneven": [False, True]},
      quick=lambda name, way, uneven: name == "aslant" and way in ("y", "aslant"))  # fmt: skip
def flakes_hide_by_their_area(t: Trial, name: str, way: str, uneven: bool) -> None:
    """A ball of black flakes before a sky of 1: exp(-2 r sigma_t sqrt(d S d)), 4 S as well.

    By flights of camera rays; 4 S with half the extinction is the same medium.
    """
    s, d = SHAPES[name], normalised(np.array(WAYS[way], float))
    exact = math.exp(-2 * 0.8 * area(s, d))
    for scaled, sigma in ((s, 1.0), (4 * s, 0.5)):
        ball = {"type": "sphere", "radius": 0.8, "bsdf": NULL,
                "interior": fog(scaled, sigma, uneven=uneven)}  # fmt: skip
        t.agrees(scene(view(-5 * d, [0, 0, 0]), ball, sky(1)), exact, 200_000, sees=0.02)


@case(3, each={"name": [*WIDE, "thin discs"], "uneven": [False, True]})
def flakes_dim_shadow_rays(t: Trial, name: str, uneven: bool) -> None:
    """Parallel light on a plate through black flakes 1 thick: rho / pi cos exp(-way area)."""
    s, down = SHAPES[name], normalised(np.array([0.4, -0.3, -1.0]))
    slab = cuboid([-1.9, -1.9, 0.5], [1.9, 1.9, 1.5], NULL, interior=fog(s, 1.0, uneven=uneven))
    floor = flat("rectangle", [0, 0, 0], [0, 0, 1], 1, diffuse(0.5))
    sun = {"type": "directional", "direction": down, "irradiance": rgb(2)}
    eye = view([0.1, 0.2, 0.3], [0, 0, 0])
    exact = 0.5 / math.pi * 2 * -down[2] * math.exp(-area(s, down) / -down[2])
    t.agrees(scene(eye, slab, floor, sun, max_depth=2), exact, 200_000, sees=0.02)


@case(3)
def flakes_in_a_blend_hide_evenly(t: Trial) -> None:
    """In a blendphase of any weight the extinction is sigma_t along all ways, as in Mitsuba."""
    s, d = SHAPES["flat"], normalised(np.array([1.0, -2, 0.7]))
    for weight in (0.0, 0.4, 1.0):
        blend = {"type": "blendphase", "weight": weight, "a": {"type": "isotropic"}, "b": sggx(s)}
        mist = {"type": "homogeneous", "sigma_t": 1.0, "albedo": 0.0, "phase": blend}
        ball = {"type": "sphere", "radius": 0.8, "bsdf": NULL, "interior": mist}
        seen = scene(view(-5 * d, [0, 0, 0]), ball, sky(1))
        t.agrees(seen, math.exp(-1.6), 400_000, sees=0.02)


@case(3, each={"name": [*WIDE, "thin discs"], "azimuth": (0.0, 1.0, 3.0),
               "weight": (1.0, 0.5)}, quick=lambda name, azimuth, weight: azimuth == 1)  # fmt: skip
def single_scattering_of_flakes(t: Trial, name: str, azimuth: float, weight: float) -> None:
    """Light of a sun that a slab of thickness .5 scatters once, from above.

    w a f / (a + b) (1 - exp(-tau (a + b))), a and b the extinctions along view and sun over their
    cosines, f the phase function. weight: of the flakes in a blend with isotropic scattering, whose
    extinction is even. Light samples. Sees 1.5 %.
    """
    s, tau, mu, mu0 = SHAPES[name], 0.5, 0.6, 0.8
    sine = math.sqrt(1 - mu0 * mu0)
    down = -np.array([sine * math.cos(azimuth), sine * math.sin(azimuth), mu0])
    d = -at(mu) / 5
    f, a, b = float(value(s, d, -down)), 1.0, 1.0
    phase: Dict = sggx(s)
    if weight < 1:
        f = weight * f + (1 - weight) / (4 * math.pi)
        phase = {"type": "blendphase", "weight": weight, "a": {"type": "isotropic"}, "b": phase}
    else:
        a, b = float(area(s, d)), float(area(s, down))
    a, b = a / mu, b / mu0
    albedo = np.array([0.5, 0.9, 0.99])
    exact = albedo * a * f / (a + b) * (1 - math.exp(-tau * (a + b)))
    mist = {"type": "homogeneous", "sigma_t": 1.0, "albedo": rgb(albedo), "phase": phase}
    slab = cuboid([-40, -40, -tau], [40, 40, 0], NULL, interior=mist)
    sun = {"type": "directional", "irradiance": rgb(1), "direction": down}
    seen = scene(view(at(mu), [0, 0, 0]), slab, sun, max_depth=2)
    t.agrees(seen, exact, 800_000, sees=0.015, margin=5e-4 if name.startswith("thin") else 5e-5)


@case(3, each={"name": SHAPES})
def white_flakes_are_not_seen(t: Trial, name: str) -> None:
    """A ball of white flakes under a sky of 1, and in a ball that shines inwards with 1: 1."""
    ball = {"type": "sphere", "radius": 0.8, "bsdf": NULL, "interior": fog(SHAPES[name], 2.0, 1.0)}
    t.agrees(scene(view([1, 3, 2], [0, 0, 0], 20, 4), ball, sky(1)), 1.0, 4_000, sees=0.01)
    room = {"type": "sphere", "radius": 9.0, "flip_normals": True, "bsdf": BLACK,
            "emitter": {"type": "area", "radiance": rgb(1)}}  # fmt: skip
    t.agrees(scene(view([1, 3, 2], [0, 0, 0], 20, 4), ball, room), 1.0, 20_000, sees=0.01)


@case(3)
def slab_of_round_flakes(t: Trial) -> None:
    """Round flakes are isotropic scattering: reflectance of a slab of 2, by adding-doubling."""
    tau, mu, albedos = 2.0, 0.4, np.array([0.5, 0.9, 0.99])
    exact = np.array([adding_doubling(tau, w, np.eye(1, 80)[0], 1.0, [mu], 40)[0][0]
                      for w in albedos.tolist()])  # fmt: skip
    body = cuboid([-1000, -1000, -tau], [1000, 1000, 0], NULL, interior=fog(np.eye(3), 1, albedos))
    dark = flat("rectangle", [0, 0, -tau - 20], [0, 0, 1], 1e6, BLACK)
    seen = scene(view(at(mu), [0, 0, 0], 1e-3), body, dark, sky(1))
    t.agrees(seen, exact, 400_000, sees=0.03, margin=5e-5)


@case(3, each={"name": ["flat", "needles", "aslant"]})
def flakes_are_reciprocal_with_their_area(t: Trial, name: str) -> None:
    """A slab's light from d to w is that from w to d, over the cosines: R(mu, mu0) / mu0.

    Two suns and two views, all orders of scattering; each picture is the other's exact answer
    within their noise: |z| of the difference.
    """
    s, tau = SHAPES[name], 1.0
    p, q = (normalised(np.array(v)) for v in ([0.3, 0.5, 0.8], [-0.7, 0.1, 0.5]))
    body = cuboid([-500, -500, -tau], [500, 500, 0], NULL, interior=fog(s, 1, 0.9))
    found = []
    for eye, sun in ((p, q), (q, p)):
        light = {"type": "directional", "irradiance": rgb(1), "direction": -sun}
        r = t.render(scene(view(5 * eye, [0, 0, 0], 1e-3), body, light), 2_000_000, seed=t.fresh())
        image, error = (float(x.ravel()[0]) for x in (r.image, r.stderr))
        found.append((image / sun[2], error / sun[2]))
    (a, da), (b, db) = found
    t.p(math.erfc(abs(a - b) / math.hypot(da, db) / math.sqrt(2)), f"{a} and {b}")
    t.sees(4.6 * math.hypot(da, db) / a, 0.03)
