"""Materials against closed forms: furnaces, Fresnel, plates, plastic, passes.

Scalar (unpolarised) Fresnel theory throughout.
"""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Sequence
from typing import Any

import numpy as np
import numpy.typing as npt

import veriray
from veriray.validate.dicts import (
    BLACK,
    MIRROR,
    NULL,
    Dict,
    cuboid,
    diffuse,
    direction,
    external_reflectance,
    flat,
    fresnel,
    fresnel_conductor,
    glass,
    internal_reflectance,
    medium,
    rgb,
    scene,
    sky,
    sphere,
    view,
)
from veriray.validate.form_factors import gauss, rectangle_above_corner
from veriray.validate.statistics import binomial, chi_square, smallest_bias
from veriray.validate.trial import Trial, case

Array = npt.NDArray[np.float64]


def plastic(base: Any, eta: float, **more: Any) -> Dict:
    """A smooth coat of index eta on a diffuse base."""
    return glass(eta, 1.0, "plastic", diffuse_reflectance=rgb(base), **more)


def masked(opacity: float, inner: Dict) -> Dict:
    """A material with holes."""
    return {"type": "mask", "opacity": opacity, "bsdf": inner}


def both(inner: Dict) -> Dict:
    """A material on both sides."""
    return {"type": "twosided", "bsdf": inner}


# ---- furnaces ----

LOSSLESS = {
    "diffuse": diffuse(1),
    "mirror": MIRROR,
    "glass": glass(1.5),
    "bubble": glass(1.0, 1.5),
    "thin": glass(1.7, 1.0, "thindielectric"),
    "plastic": plastic(1, 1.5),
    "plastic nonlinear": plastic(1, 1.9, nonlinear=True),
    "mask of diffuse": masked(0.4, both(diffuse(1))),
    "mask of mirror": masked(0.7, both(MIRROR)),
    "mask of plastic": masked(0.6, both(plastic(1, 1.3))),
    "null": NULL,
}


@case(3, each={"name": LOSSLESS, "kind": ("sphere", "cube")}, quick=lambda name, kind: (
    kind == "sphere" or name in ("glass", "bubble", "plastic", "mask of mirror")))  # fmt: skip
def white_furnace(t: Trial, name: str, kind: str) -> None:
    """A lossless body in a constant sky is invisible, at every pixel, silhouettes too (E2, A36).

    Exactly the sky: 1, .5, 2. Sees 1e-3.
    """
    material = LOSSLESS[name]
    if kind == "sphere":
        body = sphere([0.1, 0, 0.2], 1, material)
    else:
        body = cuboid([-0.7, -0.5, -0.9], [0.8, 0.6, 0.7], material)
    furnace = scene(view([1, 2, 6], [0, 0, 0], 26, 8), body, sky([1, 0.5, 2]))
    t.agrees(furnace, [1, 0.5, 2], 30_000, sees=1e-3)


@case(3, each={"name": LOSSLESS, "angle": (0, 60, 80, 89, 89.9)},
      quick=lambda name, angle: angle in (60, 89.9))  # fmt: skip
def lossless_plate(t: Trial, name: str, angle: float) -> None:
    """A lossless plate or block in a constant sky, as steep as it gets (E2, E4).

    Directional albedo 1 at every angle of incidence: 1, .5, 2. Sees 0.4 %.
    """
    if name in ("glass", "bubble"):  # both of its sides
        plate = cuboid([-100, -100, -1], [100, 100, 0], LOSSLESS[name])
    else:
        plate = flat("rectangle", [0, 0, 0], [0, 0, 1], 100, LOSSLESS[name])
    seen = scene(view(5 * direction(angle), [0, 0, 0], 1e-3), plate, sky([1, 0.5, 2]))
    t.agrees(seen, [1, 0.5, 2], 400_000, sees=4e-3)


@case(3, each={"name": ("disk", "rectangle")})
def white_furnace_of_open_surfaces(t: Trial, name: str) -> None:
    """Two-sided plates, one above another (E2).

    The light between them finds its way out: 1. Sees 1e-3.
    """
    plates = [flat(name, [0, 0, z], [0.2, 0, 1], 1, both(material)) for z, material in
              ((0.0, plastic(1, 1.5)), (0.5, diffuse(1)), (-0.6, MIRROR))]  # fmt: skip
    furnace = scene(view([1, 4, 3], [0, 0, 0], 40, 6), *plates, sky(1))
    t.agrees(furnace, 1.0, 40_000, sees=1e-3)


@case(3)
def nested_glass_in_a_furnace(t: Trial) -> None:
    """Index 1.5 in 1.33 in 1, a bubble beside it, and glass inside out (E2, A36, N9).

    1 at every pixel. Sees 1e-3.
    """
    nest = [sphere([0, 0, 0], 1.2, glass(1.33)), sphere([-0.3, 0, 0], 0.6, glass(1.5, 1.33)),
            sphere([0.7, 0.2, 0], 0.3, glass(1, 1.33))]  # fmt: skip
    inside_out = {**sphere([-0.4, 0.1, 0.1], 0.2, glass(1.5, 1)), "flip_normals": True}
    furnace = scene(view([1, 2, 6], [0, 0, 0], 26, 8), *nest, inside_out, sky(1))
    t.agrees(furnace, 1.0, 40_000, sees=1e-3)


@case(3)
def thermodynamic_equilibrium(t: Trial) -> None:
    """A black ball of radiance n^2 in glass of index n, in a sky of 1 (E6, A36).

    1 from outside, n^2 from within: nothing else sees a missing n^2.
    """
    n = 1.5
    bodies = [sphere([0, 0, 0], 1, glass(n)), sphere([0.1, 0.2, 0], 0.5, BLACK, n * n)]
    outside = scene(view([1, 2, 6], [0, 0, 0], 26, 8), *bodies, sky(1))
    t.agrees(outside, 1.0, 20_000, sees=1e-3)
    within = scene(view([-0.6, -0.3, 0.1], [0, 0, 0.2], 90, 6), *bodies, sky(1))
    t.agrees(within, n * n, 20_000, sees=1e-3)


@case(3, each={"place": ("outside", "water", "glass")},
      quick=lambda place: place == "outside")  # fmt: skip
def equilibrium_in_nested_glass(t: Trial, place: str) -> None:
    """Grey bodies at equilibrium in glass in water in a sky: G. Kirchhoff, 1860 (E6).

    Emission (1 - albedo) n^2 with the index around it: 1 from outside, n^2 from within. Sees 0.3 %.
    """
    water, flint = 1.33, 1.7
    exact = {"outside": 1.0, "water": water**2, "glass": flint**2}[place]
    bodies = [
        sphere([0, 0, 0], 2, glass(water)),
        sphere([-0.6, 0, 0], 1, glass(flint, water)),
        sphere([-0.9, 0.2, 0], 0.4, diffuse(0.3), 0.7 * flint**2),
        sphere([1.1, 0.3, 0.2], 0.5, diffuse([0.8, 0.5, 0.0]),
               np.array([0.2, 0.5, 1.0]) * water**2),
        sphere([0.9, -0.9, -0.3], 0.3, glass(1.0, water)),
    ]  # fmt: skip
    eye = {
        "outside": view([1, 2, 9], [0, 0, 0], 26, 6),
        "water": view([0.9, -0.2, 1.2], [0, 0, 0], 90, 6),
        "glass": view([-0.2, -0.1, 0.3], [-0.9, 0.2, 0], 90, 6),
    }[place]
    # grey bodies emit 1 - albedo in single precision
    t.agrees(scene(eye, *bodies, sky(1)), exact, 40_000, sees=3e-3)


# ---- Fresnel ----

ANGLES = (0, 30, 45, 60, 75, 85)
A30 = (0.040000, 0.041523, 0.050240, 0.089187, 0.253061, 0.612800)


@case(3, once=True)
def fresnel_theory(t: Trial) -> None:
    """The formulas used here against printed values and other formulas (A30, A31, A34).

    Fresnel's equations by cosines, by angles and by the complex index; the mean reflectance by
    quadrature from outside and from inside; critical and Brewster's angle.
    """
    for angle, value in zip(ANGLES, A30, strict=True):
        f = float(fresnel(math.cos(math.radians(angle)), 1.5))
        t.check(abs(f - value) < 6e-7)
        t.check(abs(f - fresnel_conductor(math.cos(math.radians(angle)), 1.5)) < 1e-12)
        if angle:
            i, r = math.radians(angle), math.asin(math.sin(math.radians(angle)) / 1.5)
            s, p = math.sin(i - r) / math.sin(i + r), math.tan(i - r) / math.tan(i + r)
            t.check(abs(f - (s * s + p * p) / 2) < 1e-12, "A. Fresnel, 1823")
    brewster = math.radians(56.309932)
    r = math.asin(math.sin(brewster) / 1.5)
    t.check(abs(math.tan(brewster - r) / math.tan(brewster + r)) < 1e-6, "Brewster's angle")
    t.check(fresnel(math.cos(math.radians(41.810315 + 1e-5)), 1 / 1.5) == 1, "critical angle")
    t.check(fresnel(math.cos(math.radians(41.810315 - 1e-5)), 1 / 1.5) < 1, "critical angle")
    t.check(abs(external_reflectance(1.5) - 0.091778) < 1e-6)
    t.check(abs(internal_reflectance(1.5) - 0.596346) < 1e-6)
    x, w = np.polynomial.legendre.leggauss(400)
    critical = math.sqrt(1 - 1 / 2.25)  # all is reflected below this cosine
    c = critical + (1 - critical) * ((x + 1) / 2) ** 2
    inner = float((w * (x + 1) * fresnel(c, 1 / 1.5) * c).sum()) * (1 - critical) + critical**2
    t.check(abs(inner - 0.596346) < 1e-6)
    fe, fi = external_reflectance(1.5), internal_reflectance(1.5)
    t.check(abs(fe + (1 - fe) * (1 - fi) * 0.5 / (1 - fi * 0.5) - 0.352959) < 1e-6)


@case(3, each={"angle": ANGLES, "body": ("plastic", "ink")})
def fresnel_of_a_surface(t: Trial, angle: float, body: str) -> None:
    """First reflection alone: a black plastic, and glass filled with ink, in a sky of 1 (A30).

    .040000 .041523 .050240 .089187 .253061 .612800. Sees 5 %.
    """
    exact = float(fresnel(math.cos(math.radians(angle)), 1.5))
    eye = view(5 * direction(angle), [0, 0, 0])
    if body == "plastic":
        block = flat("disk", [0, 0, 0], [0, 0, 1], 100, plastic(0, 1.5))
    else:
        block = cuboid([-99, -99, -99], [99, 99, 0], glass(1.5), interior=medium(1000.0, 0.0))
    t.agrees(scene(eye, block, sky(1)), exact, 400_000, sees=0.05)


METALS = {"silver": (0.2, 3.9, 1.0), "chromium": (2.9, 3.05, 1.0), "oil": (1.5, 0.0, 1.33)}


@case(3, each={"name": METALS, "angle": (0, 45, 80)})
def conductor(t: Trial, name: str, angle: float) -> None:
    """Reflectance of a metal in a sky of 1 (A30).

    No noise, and equal to the complex Fresnel equations. Three channels: eta, its double, and a
    specular reflectance of 0.5.
    """
    eta, k, ext = METALS[name]
    c = math.cos(math.radians(angle))
    etas = np.array([eta, 2 * eta, eta])
    exact = [fresnel_conductor(c, complex(e, k) / ext) for e in etas] * np.array([1, 1, 0.5])
    material = {"type": "conductor", "eta": rgb(etas), "k": rgb(k), "ext_eta": ext,
                "specular_reflectance": rgb([1, 1, 0.5])}  # fmt: skip
    plate = flat("rectangle", [0, 0, 0], [0, 0, 1], 100, material)
    mirror = scene(view(5 * direction(angle), [0, 0, 0]), plate, sky(1), rr_depth=100)
    t.agrees(mirror, exact, 10_000, sees=1e-4, margin=3e-5)


# ---- diffuse light on a plane ----


def facing(*above: Dict, rr_depth: int = 5) -> veriray.Scene:
    """A small diffuse disk (albedo 1) over a black floor of radiance 1; `above`: what hangs there.

    Things above are at z = 1 and wide. The disk's radiance is the reflectance of what is above for
    diffuse light, less 3e-6 of it: the disk hides so much of its own picture in a mirror.
    """
    ground = flat("rectangle", [0, 0, 0], [0, 0, 1], 2000, BLACK, 1)
    patch = flat("disk", [0, 0, 0.05], [0, 0, 1], 0.003, diffuse(1))
    eye = view([0.3, 0.1, 0.3], [0, 0, 0.05], 1e-3)
    return scene(eye, ground, patch, *above, rr_depth=rr_depth)


DIFFUSE_LIGHT = {"outside": 4_000_000, "inside": 800_000, "black plastic": 4_000_000,
                 "gold": 200_000, "thin": 2_000_000}  # fmt: skip


@case(3, each={"name": DIFFUSE_LIGHT}, quick=lambda name: name in ("inside", "gold"))
def reflectance_for_diffuse_light(t: Trial, name: str) -> None:
    """A plane lit by diffuse light from one side (A31).

    Twice the integral of F cos: .091778 from outside, .596346 = 1 - (1 - .091778) / n^2 from
    inside n = 1.5; metal and thin glass by quadrature. Sees 1 %.
    """
    x, w = gauss(200)
    thin = 2 * fresnel(x, 1.7) / (1 + fresnel(x, 1.7))
    gold = np.array([0.143, 0.375, 1.44]), np.array([3.98, 2.39, 1.6])
    metal = [float(2 * w * x @ np.array([fresnel_conductor(c, complex(n, k)) for c in x.tolist()]))
             for n, k in zip(*gold, strict=True)]  # fmt: skip
    material, exact = {
        "outside": (glass(1.5), external_reflectance(1.5)),
        "inside": (glass(1.0, 1.5), internal_reflectance(1.5)),
        "black plastic": (plastic(0, 1.5), external_reflectance(1.5)),
        "gold": ({"type": "conductor", "eta": rgb(gold[0]), "k": rgb(gold[1])}, metal),
        "thin": (glass(1.7, 1.0, "thindielectric"), float(2 * w * x @ thin)),
    }[name]
    for known, value in (("outside", 0.091778), ("inside", 0.596346)):
        t.check(name != known or abs(exact - value) < 1e-6)
    plane = flat("rectangle", [0, 0, 1], [0, 0, -1], 2000, material)
    t.agrees(facing(plane), exact, DIFFUSE_LIGHT[name], sees=0.01, margin=3e-5)


# ---- plates and stacks ----

SLAB = {0: 0.923077, 30: 0.920266, 60: 0.836232}
LAMPS = (flat("rectangle", [0, 0, -9], [0, 0, 1], 40, BLACK, [1, 0, 2]),
         flat("rectangle", [0, 0, 9], [0, 0, -1], 40, BLACK, [0, 1, 2]))  # fmt: skip


@case(3, each={"angle": SLAB, "material": ("slab", "thin")})
def clear_slab(t: Trial, angle: float, material: str) -> None:
    """A plate of glass, all inter-reflections, and a thin pane (A32).

    (1 - R) / (1 + R) of a lamp behind: .923077, .920266, .836232, the rest of one in front. A thin
    pane has the same two numbers.
    """
    r = float(fresnel(math.cos(math.radians(angle)), 1.5))
    t.check(abs((1 - r) / (1 + r) - SLAB[int(angle)]) < 1e-6)
    eye = 5 * direction(angle)
    if material == "slab":
        pane = cuboid([-50, -50, -1], [50, 50, 0], glass(1.5))
    else:
        pane = flat("rectangle", [0, 0, 0], [0, 0, 1], 50, glass(1.5, 1.0, "thindielectric"))
    exact = [(1 - r) / (1 + r), 2 * r / (1 + r), 2]
    t.agrees(scene(view(eye, [0, 0, 0]), pane, *LAMPS), exact, 800_000, sees=0.02)


@case(3, each={"angle": (0, 60)})
def absorbing_slab(t: Trial, angle: float) -> None:
    """A plate of absorbing glass, tau = 1 (A33).

    Normal incidence: T = .339111, R = .044990; at 60 degrees the way within is longer.
    """
    outside = math.cos(math.radians(angle))
    inside = math.sqrt(1 - (1 - outside**2) / 2.25)
    r, tr = float(fresnel(outside, 1.5)), math.exp(-1 / inside)
    transmitted = (1 - r) ** 2 * tr / (1 - (r * tr) ** 2)
    reflected = r + (1 - r) ** 2 * r * tr * tr / (1 - (r * tr) ** 2)
    t.check(angle > 0 or abs(transmitted - 0.339111) < 1e-6 and abs(reflected - 0.044990) < 1e-6)
    pane = cuboid([-50, -50, -1], [50, 50, 0], glass(1.5), interior=medium(1.0, 0.0))
    exact = [transmitted, reflected, 2 * (transmitted + reflected)]
    slab = scene(view(5 * direction(angle), [0, 0, 0]), pane, *LAMPS)
    t.agrees(slab, exact, 1_600_000, sees=0.02)


def pile(reflectances: Sequence[float], passes: Sequence[Array]) -> tuple[Array, Array]:
    """Reflectance and transmittance of a stack of surfaces, layers between them passing `passes`.

    G. G. Stokes, 1862: surfaces are added one by one. Light is not coherent.
    """
    up, through = np.full(3, reflectances[0]), np.full(3, 1 - reflectances[0])
    down = up  # reflectance from below
    for r, t in zip(reflectances[1:], passes, strict=True):
        loop = 1 / (1 - down * r * t * t)
        up, down, through = (
            up + through**2 * t * t * r * loop,
            r + (1 - r) ** 2 * t * t * down * loop,
            through * t * (1 - r) * loop,
        )
    return up, through


def pile_by_fluxes(reflectances: Sequence[float], passes: Sequence[Array]) -> tuple[Array, Array]:
    """The same from the linear system of the light going up and down between the surfaces."""
    n = len(reflectances)
    result = np.empty((2, 3))
    for channel in range(3):
        # unknowns: down and up just below surface k; above it, one layer further, both faded
        a, b = np.eye(2 * n), np.zeros(2 * n)
        top = reflectances[0]
        for k, r in enumerate(reflectances):
            below = np.asarray(passes[k])[channel] if k + 1 < n else 0.0
            t = np.asarray(passes[k - 1])[channel] if k else 1.0
            if k:
                a[2 * k, 2 * (k - 1)] -= (1 - r) * t
            else:
                b[0] = 1 - r
            a[2 * k, 2 * k + 1] -= r
            if k + 1 < n:  # what comes up below surface k left the next one upwards
                s = reflectances[k + 1]
                a[2 * k + 1, 2 * k] -= s * below**2
                a[2 * k + 1, 2 * k + 3] -= (1 - s) * below
        x = np.linalg.solve(a, b)
        result[:, channel] = top + (1 - top) * x[1], x[2 * n - 2]
    return result[0], result[1]


STACKS = {  # indices from above, extinction of each layer between
    "one plate": ([1, 1.5, 1], [0]),
    "two plates": ([1, 1.5, 1, 1.5, 1], [0, 0, 0]),
    "five plates": ([1, *[1.5, 1] * 5], [0] * 9),
    "coated": ([1, 1.38, 1.52, 1], [0, 0]),
    "aquarium": ([1, 1.5, 1.33, 1.5, 1], [0.2, 1.0, 0.2]),
    "filters": ([1, 1.6, 1, 1.4, 1.7, 1], [0.5, 0.0, 1.0, 0.3]),
}


@case(3, each={"name": STACKS, "angle": (0, 50, 75)},
      quick=lambda name, angle: angle == 50 and name in ("coated", "aquarium"))  # fmt: skip
def stack_of_plates(t: Trial, name: str, angle: float) -> None:
    """A pile of plates of any index, clear and coloured, at any angle (A32, A33).

    m clear surfaces of one kind pass (1 - R) / (1 + (m - 1) R): G. G. Stokes, 1862; others by
    adding surface by surface, in two ways. A lamp behind, one in front and both. Sees 2 %.
    """
    indices, extinctions = STACKS[name]
    sine = math.sin(math.radians(angle))
    cosines = [math.sqrt(1 - (sine / n) ** 2) for n in indices]
    fs = [float(fresnel(c, b / a)) for c, a, b in
          zip(cosines[:-1], indices[:-1], indices[1:], strict=True)]  # fmt: skip
    colour = np.array([1.0, 0.5, 2.0])
    passes = [np.exp(-s * colour / c) for s, c in zip(extinctions, cosines[1:-1], strict=True)]
    up, through = pile(fs, passes)
    for a, b in zip((up, through), pile_by_fluxes(fs, passes), strict=True):
        t.check(np.abs(a - b).max() < 1e-12, "two ways")
    if "plate" in name:
        r = fs[0]
        t.check(np.abs(through - (1 - r) / (1 + (len(fs) - 1) * r)).max() < 1e-12)
        t.check(np.abs(up + through - 1).max() < 1e-12)
    inks = [None if s == 0 else medium(s * colour, 0.0) for s in extinctions]
    surfaces = []
    for k, (a, b) in enumerate(zip(indices[:-1], indices[1:], strict=True)):
        sides: dict[str, Any] = {}
        if k and inks[k - 1]:
            sides["exterior"] = inks[k - 1]
        if k < len(inks) and inks[k]:
            sides["interior"] = inks[k]
        surfaces.append(flat("rectangle", [0, 0, -k], [0, 0, 1], 500, glass(b, a), **sides))
    behind = flat("rectangle", [0, 0, -20], [0, 0, 1], 400, BLACK, 1)
    front = flat("rectangle", [0, 0, 20], [0, 0, -1], 400, BLACK, 1)
    eye = view(5 * direction(angle), [0, 0, 0], 1e-3)
    for lamps, exact in (([behind], through), ([front], up)):
        seen = scene(eye, *surfaces, *lamps, rr_depth=20)
        t.agrees(seen, exact, 1_600_000 if name == "filters" else 800_000, sees=0.03)


@case(3, each={"angle": (0, 60, 80)}, quick=lambda angle: angle == 60)
def varnish_over_a_diffuse_wall(t: Trial, angle: float) -> None:
    """A sheet of clear glass on a diffuse wall, by its geometry (A34, A31).

    F + (1 - F) (1 - Fi) rho / (1 - Fi rho), the formula of plastic: .352959 in the mean over
    angles at rho = .5. Refraction, its n^2 and all inner reflections. Sees 2 %.
    """
    rho = np.array([0.1, 0.5, 0.9])
    f, fi = float(fresnel(math.cos(math.radians(angle)), 1.5)), internal_reflectance(1.5)
    exact = f + (1 - f) * (1 - fi) * rho / (1 - fi * rho)
    sheet = flat("rectangle", [0, 0, 0], [0, 0, 1], 1000, glass(1.5))
    wall = flat("rectangle", [0, 0, -1], [0, 0, 1], 1000, diffuse(rho))
    seen = scene(view(5 * direction(angle), [0, 0, 0]), sheet, wall, sky(1))
    t.agrees(seen, exact, 800_000, sees=0.02, margin=3e-5)


def ways_through_a_ball(angle: float, n: float) -> list[tuple[Any, Any]]:
    """Points and directions at which a ray along -z leaves the unit ball that it meets at `angle`.

    Reflected outside, straight through, reflected once inside; in the plane y = 0.
    """
    c = math.cos(math.radians(angle))
    b = math.sqrt(1 - (1 - c * c) / n**2)
    p, d = direction(angle), np.array([0.0, 0, -1])
    ways = [(p, d + 2 * c * p)]
    t = d / n + (c / n - b) * p
    for _ in range(2):
        p = p + 2 * b * t
        ways.append((p, n * t + (c - n * b) * p))
        t = t - 2 * b * p
    return ways


@case(3, each={"angle": (20, 45, 75)})
def glass_ball(t: Trial, angle: float) -> None:
    """Light off a ball of n = 1.5 by its way: reflected, through, reflected inside (A36).

    F, (1 - F)^2, (1 - F)^2 F: a lamp of its own colour waits in each of the three directions.
    """
    f = float(fresnel(math.cos(math.radians(angle)), 1.5))
    lamps = [flat("disk", p + 6 * d, -d, 0.3, BLACK, colour) for (p, d), colour in
             zip(ways_through_a_ball(angle, 1.5), np.eye(3).tolist(), strict=True)]  # fmt: skip
    x = math.sin(math.radians(angle))
    ball = sphere([0, 0, 0], 1, glass(1.5))
    seen = scene(view([x, 0, 5], [x, 0, 0]), ball, *lamps)
    t.agrees(seen, [f, (1 - f) ** 2, (1 - f) ** 2 * f], 800_000, sees=0.03)


@case(3, each={"body": ("block", "pane")})
def specular_colours_and_refraction(t: Trial, body: str) -> None:
    """specular_reflectance and specular_transmittance multiply each event (A32).

    t^2 (1 - f)^2 / (1 - (f r)^2) through a block; t (1 - f) / (1 + f) through a pane.
    """
    f, r, tr = 0.04, np.array([0.5, 1, 0.2]), np.array([1, 0.3, 0.7])
    colours = {"specular_reflectance": rgb(r), "specular_transmittance": rgb(tr)}
    if body == "block":
        thing = cuboid([-99, -99, -1], [99, 99, 0], glass(1.5, **colours))
        exact = tr**2 * (1 - f) ** 2 / (1 - (f * r) ** 2)
    else:
        thin = glass(1.5, 1.0, "thindielectric", **colours)
        thing = flat("rectangle", [0, 0, 0], [0, 0, 1], 99, thin)
        exact = tr * (1 - f) / (1 + f)
    below = flat("rectangle", [0, 0, -9], [0, 0, 1], 90, BLACK, 1)
    t.agrees(scene(view([0, 0, 5], [0, 0, 0]), thing, below), exact, 400_000, sees=0.01)


@case(3)
def total_internal_reflection(t: Trial) -> None:
    """At 60 degrees inside n = 1.5 a lamp in the glass is seen undimmed (A35).

    Exactly, without noise.
    """
    block = cuboid([-50, -50, -50], [50, 50, 0], glass(1.5))
    lamp = flat("rectangle", 10 * direction(240), -direction(240), 1, BLACK, [0.7, 1, 3])
    seen = scene(view(10 * direction(120), [0, 0, 0]), block, lamp)
    r = t.render(seen, 1000)
    t.check(np.abs(r.image - np.float32([0.7, 1, 3])).max() <= 1e-6)
    t.check(r.stderr.max() <= 1e-6)


@case(3)
def clear_slab_counts(t: Trial) -> None:
    """Segments alive in a clear slab at normal incidence (L3, A32).

    1, 1, .96, .0384, .001536, 6.1e-5: exact multinomial; sees 5 % of the third. The sky is whole.
    """
    pane = cuboid([-50, -50, -1], [50, 50, 0], glass(1.5))
    slab = scene(view([0, 0, 5], [0, 0, 0]), pane, sky(1), rr_depth=100)
    law = np.array([1, 1, 0.96, 0.0384, 0.001536, 6.144e-5])
    r = t.render(slab, 1_000_000)
    n = r.spp
    t.check(r.stats["live_rays"][:2] == [n, n] and np.abs(r.image - 1).max() < 1e-5)
    ended = np.array(r.stats["ledger"]["escaped"])
    expected = n * (law - np.append(law[1:], 0))
    t.p(chi_square(np.append(ended[:5], ended[5:].sum()), expected), "ends by depth")


@case(3)
def trapped_light(t: Trial) -> None:
    """Directions from inside a cube of glass n = 1.5: sqrt 5 - 2 of them never leave (N10, L3).

    Those with no component above sqrt(1 - 1/n^2). On one face of the cube of directions that is all
    beyond a circle: 1 - pi / 5 of its area, a binomial count of paths cut at max_depth; weighted by
    solid angle, pixel by pixel, the same count gives sqrt 5 - 2.
    """
    size, depth = 64, 200
    block = cuboid([-1, -1, -1], [1, 1, 1], glass(1.5))
    eye = [0.11, -0.23, 0.07]
    cube = scene(view(eye, [eye[0], eye[1], 1], 90, size), block, sky(1), max_depth=depth)
    r = t.render(cube, 64, rr_depth=10**6)
    n, cut = size * size * r.spp, r.stats["ledger"]["depth_cut"][-1]
    t.check(sum(r.stats["ledger"]["depth_cut"]) == cut)
    share = 1 - math.pi / 5
    t.p(binomial(cut, n, share), "trapped")
    t.check(abs(cut / n - share) < 0.005)
    t.sees(smallest_bias(math.sqrt(share * (1 - share) / n), share), 0.02)
    x = (np.arange(size) + 0.5) / size * 2 - 1
    solid = (1 + x[:, None] ** 2 + x**2) ** -1.5
    kept = 1 - r.image[:, :, 0].astype(np.float64) / 2.25
    t.check(abs((solid * kept).sum() / solid.sum() - (math.sqrt(5) - 2)) < 0.004)


# ---- plastic ----


@case(3, each={"nonlinear": (False, True), "angle": (0, 60, 80)})
def plastic_in_a_sky(t: Trial, nonlinear: bool, angle: float) -> None:
    """A smooth coat on a diffuse base in a sky of 1 (A34).

    F + (1 - F) (1 - Fi) rho / (1 - Fi rho); linear: F + (1 - F) rho. Fi by quadrature.
    """
    eta, rho = 1.5, np.array([0.1, 0.5, 0.9])
    f, fi = float(fresnel(math.cos(math.radians(angle)), eta)), internal_reflectance(eta)
    base = (1 - fi) * rho / (1 - fi * rho) if nonlinear else rho
    exact = 0.8 * f + (1 - f) * base
    coat = plastic(rho, eta, nonlinear=nonlinear, specular_reflectance=rgb(0.8))
    plate = flat("rectangle", [0, 0, 0], [0, 0, 1], 100, coat)
    eye = 5 * direction(angle)
    t.agrees(scene(view(eye, [0, 0, 0]), plate, sky(1)), exact, 800_000, sees=0.01)


@case(3, each={"eta": (1.3, 1.9)})
def roulette_between_lobes_is_splitting(t: Trial, eta: float) -> None:
    """Radiance of a plastic floor under a lamp whose mirror image is a second lamp (A34).

    Splitting, by quadrature: F(o) L_mirror + sum over the lamp of (1 - F(i)) (1 - F(o)) f cos.
    """
    rho, angle = np.array([0.2, 0.5, 0.8]), 50.0
    fi, f = internal_reflectance(eta), float(fresnel(math.cos(math.radians(angle)), eta))
    x, w = np.polynomial.legendre.leggauss(64)
    u, v = np.meshgrid(x, x + 0.3)  # lamp: [-1, 1] x [-.7, 1.3] at height 1.5
    distance2 = u**2 + v**2 + 1.5**2
    cosine = 1.5 / np.sqrt(distance2)
    weight = np.outer(w, w) * cosine**2 / distance2 * (1 - fresnel(cosine, eta))
    base = rho / (1 - fi * rho) * (1 - f) / eta**2 / math.pi
    mirrored = 5 * direction(-angle)
    exact = f * 2.0 + base * weight.sum()
    parts = [
        flat("rectangle", [0, 0, 0], [0, 0, 1], 20, plastic(rho, eta, nonlinear=True)),
        flat("rectangle", [0, 0.3, 1.5], [0, 0, -1], 1, BLACK, 1),
        flat("disk", mirrored, -mirrored, 0.05, BLACK, 2),
    ]
    # The small lamp lights the floor too, by pi .05^2 / 25 of its radiance.
    small = 2 * math.pi * 0.05**2 / 25 * math.cos(math.radians(angle))
    exact = exact + base * small * (1 - f)
    floor = scene(view(5 * direction(angle), [0, 0, 0]), *parts)
    t.agrees(floor, exact, 1_600_000, sees=0.02, margin=1e-4)


# ---- passes ----


@case(3)
def masks_and_panes_in_front_of_a_lamp(t: Trial) -> None:
    """A lamp behind black masks of opacity .3 and .5, null surfaces and both sides of a mask (A40).

    .7 x .5 of it, at max_depth 1: passes are no bounces.
    """
    lamp = flat("rectangle", [0, 0, -5], [0, 0, 1], 5, BLACK, [1, 2, 3])
    panes = [flat("rectangle", [0, 0, 1], [0, 0, 1], 2, masked(0.3, BLACK)),
             flat("disk", [0, 0, 0], [0, 0, -1], 2, masked(0.5, BLACK)),
             sphere([0, 0, -2], 1, NULL), cuboid([-1, -1, -4.5], [1, 1, -3.5], NULL)]  # fmt: skip
    seen = scene(view([0.2, 0.1, 5], [0, 0, 0]), lamp, *panes, max_depth=1)
    t.agrees(seen, np.array([1, 2, 3]) * 0.7 * 0.5, 800_000, sees=0.01)


@case(3, each={"material": ("mask", "null", "thindielectric")})
def shadow_rays_pass(t: Trial, material: str) -> None:
    """A point light over a floor, a pane between (A20, A32).

    Straight through, and no noise: .7, 1, (1 - f) / (1 + f) of it.
    """
    thin = glass(1.5, 1.0, "thindielectric", specular_transmittance=rgb([1, 0.5, 0.2]))
    pane = {"mask": masked(0.3, BLACK), "null": NULL, "thindielectric": thin}[material]
    position = 3 * direction(40)
    c = math.cos(math.radians(40))
    f = float(fresnel(c, 1.5))
    through = {"mask": 0.7, "null": 1.0,
               "thindielectric": (1 - f) / (1 + f) * np.array([1, 0.5, 0.2])}[material]  # fmt: skip
    exact = 0.5 / math.pi * 4 * c / 9 * np.ones(3) * through
    objects = [
        flat("rectangle", [0, 0, 0], [0, 0, 1], 9, diffuse(0.5)),
        flat("rectangle", [1, 0, 1.5], [0, 0, 1], 1.5, pane),
        {"type": "point", "position": position, "intensity": rgb(4)},
    ]
    seen = scene(view([-3, 0, 1], [0, 0, 0]), *objects, max_depth=2)
    r = t.agrees(seen, exact, 10_000, sees=1e-4)
    t.check(r.stats["ledger"]["shadow_visible"][0] == r.spp)
    t.check(not any(r.stats["ledger"]["shadow_occluded"]), "a shadow ray was stopped")


@case(3, each={"depth": (2, -1)}, quick=lambda depth: depth == 2)
def passes_do_not_count_as_bounces(t: Trial, depth: int) -> None:
    """Ten null shells around a floor and its lamp (A10, A2).

    The form factor of the lamp, as without them, at max_depth 2 too.
    """
    floor = flat("rectangle", [0, 0, 0], [0, 0, 1], 9, diffuse(0.5))
    lamp = flat("rectangle", [0, 0, 2], [0, 0, -1], 0.5, BLACK, 3)
    shells = [sphere([0, 0, 0], 0.1 + 0.15 * k, NULL) for k in range(10)]
    exact = 0.5 * 3 * 4 * rectangle_above_corner(0.25, 0.25)
    seen = scene(view([-3, 0.3, 1], [0, 0, 0]), floor, lamp, *shells, max_depth=depth)
    t.agrees(seen, exact, 200_000, sees=0.02)


# ---- shading normals ----


def tilted(degrees: float, material: Dict) -> tuple[veriray.Scene, float]:
    """A plate z = 0 whose vertex normals lean towards +x, in a sky of 1, seen from above."""
    plate = flat("rectangle", [0, 0, 0], [0, 0, 1], 9, material)
    flat_scene = scene(view([-1, 0, 3], [0, 0, 0]), plate, sky(1))
    normals = np.broadcast_to(direction(degrees), flat_scene.vertices.shape)
    return dataclasses.replace(flat_scene, normals=normals), math.radians(degrees)


@case(3, each={"degrees": (5, 30, 60)})
def shading_normals_do_not_light_from_behind(t: Trial, degrees: float) -> None:
    """A diffuse plate with bent normals in a sky of 1 (A5, N7).

    A cosine lobe about n_s, cut at the plane of n_g: (1 + cos) / 2 of it. Nothing leaks.
    """
    bent, angle = tilted(degrees, diffuse(0.8))
    t.agrees(bent, 0.8 * (1 + math.cos(angle)) / 2, 800_000, sees=0.01)


@case(3, each={"degrees": (5, 30, 60)})
def mirror_about_a_shading_normal(t: Trial, degrees: float) -> None:
    """A bent mirror sees the lamp where the bent normal says (N7).

    The lamp's radiance, or 0 exactly where the direction is behind the plate.
    """
    bent, _ = tilted(degrees, MIRROR)
    eye = np.array([-1.0, 0, 3]) / math.sqrt(10)
    n = direction(degrees)
    out = 2 * (eye @ n) * n - eye
    if out[2] > 0:
        lamp = flat("disk", 4 * out, -out, 0.02, BLACK, [1, 2, 3])
        plate = flat("rectangle", [0, 0, 0], [0, 0, 1], 9, MIRROR)
        seen = scene(view([-1, 0, 3], [0, 0, 0]), lamp, plate)
        normals = np.zeros(seen.vertices.shape)
        normals[-4:] = n
        seen = dataclasses.replace(seen, normals=normals)
        t.agrees(seen, [1, 2, 3], 1000, sees=1e-4)
    else:
        t.agrees(bent, 0.0, 1000, sees=1e-4)
