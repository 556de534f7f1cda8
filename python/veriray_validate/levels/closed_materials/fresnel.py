"""Fresnel's reflectances, at an angle and for diffuse light."""

from __future__ import annotations

import math

import numpy as np

from veriray_validate.dicts import (
    cuboid,
    direction,
    facing,
    flat,
    glass,
    medium,
    plastic,
    rgb,
    scene,
    sky,
    view,
)
from veriray_validate.form_factors import gauss
from veriray_validate.fresnel import (
    external_reflectance,
    fresnel,
    fresnel_conductor,
    internal_reflectance,
)
from veriray_validate.trial import Trial, case

# ---- Fresnel ----

ANGLES = (0, 30, 45, 60, 75, 85)
#: Fresnel's reflectance at these angles for an index of 1.5.
AT_ANGLES = (0.040000, 0.041523, 0.050240, 0.089187, 0.253061, 0.612800)


@case(3, once=True)
def fresnel_theory(t: Trial) -> None:
    """The formulas used here against printed values and other formulas.

    Fresnel's equations by cosines, by angles and by the complex index; the mean reflectance by
    quadrature from outside and from inside; critical and Brewster's angle.
    """
    for angle, value in zip(ANGLES, AT_ANGLES, strict=True):
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
    """Only the first reflection: black plastic, and glass filled with ink, in a sky of 1.

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
    """Reflectance of a metal in a sky of 1.

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


DIFFUSE_LIGHT = {"outside": 4_000_000, "inside": 800_000, "black plastic": 4_000_000,
                 "gold": 200_000, "thin": 2_000_000}  # fmt: skip


@case(3, each={"name": DIFFUSE_LIGHT}, quick=lambda name: name in ("inside", "gold"))
def reflectance_for_diffuse_light(t: Trial, name: str) -> None:
    """A plane lit by diffuse light from one side.

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
