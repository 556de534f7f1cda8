"""Rough metal, plastic and glass against quadrature and closed forms, lit both ways."""

from __future__ import annotations

import math
from typing import Any

import numpy as np

import veriray
from veriray_validate.dicts import (
    BLACK,
    Array,
    Dict,
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
    sphere,
    view,
)
from veriray_validate.fresnel import fresnel, fresnel_conductor
from veriray_validate.rough import coat, returned, share, unhidden
from veriray_validate.trial import Trial, case

#: Directions are drawn for the material alone, or light samples compete with them.
LIT = ("sky", "lamp")


def rough(alpha: float, ggx: bool, inner: Dict, heights: bool = False) -> Dict:
    """A smooth material with small mirrors instead."""
    slopes = {"alpha": alpha, "distribution": "ggx" if ggx else "beckmann"}
    if heights:
        slopes["shadowing"] = "height_correlated"
    return {**inner, "type": f"rough{inner['type']}", **slopes}


def whole(alpha: float, ggx: bool, inner: Dict, heights: bool) -> Dict:
    """Likewise, with what the mirrors lose given back."""
    return {**rough(alpha, ggx, inner, heights), "energy_compensation": True}


def plate(
    bsdf: Dict, mu: float, lit: str, below: float | None = None, front: float = 1.0
) -> veriray.Scene:
    """A plate seen at a cosine, in light of radiance 1 above and `below` underneath; front: -1
    where it is seen from behind."""
    parts: list[Dict] = [flat("rectangle", [0, 0, 0], [0, 0, front], 100, bsdf)]
    if lit == "sky":
        parts.append(sky(1))
    else:
        parts.append(sphere([0, 0, 0], 1000, BLACK, 1.0, flip_normals=True))
    if below is not None:
        parts.append(flat("rectangle", [0, 0, -0.01], [0, 0, 1], 99, BLACK, below))
    eye = 5 * direction(math.degrees(math.acos(mu)))
    return scene(view(eye, [0, 0, 0]), *parts)


@case(3, each={"mu": (1.0, 0.5, 0.05), "lit": LIT, "heights": (False, True)})
def rough_mirror(t: Trial, mu: float, lit: str, heights: bool) -> None:
    """GGX of alpha 1 that reflects all (F = 1): 2 (1 - ln 2) / (1 + mu). Sees 1 %.

    By shadows that are correlated by height 1 - mu ln(1 + 1 / mu).
    """
    exact = 1 - mu * math.log1p(1 / mu) if heights else 2 * (1 - math.log(2)) / (1 + mu)
    mirror = rough(1.0, True, {"type": "conductor"}, heights)
    t.agrees(plate(mirror, mu, lit), exact, 400_000, sees=0.01)


@case(3, each={"heights": (False, True)})
def rough_mirror_in_even_light(t: Trial, heights: bool) -> None:
    """Reflectance of such a mirror for diffuse light: 4 (1 - ln 2)^2, or / 3. Sees 1 %."""
    mirror = rough(1.0, True, {"type": "conductor"}, heights)
    above = flat("rectangle", [0, 0, 1], [0, 0, -1], 3000, mirror)
    rest = 1 - math.log(2)
    t.agrees(facing(above), 4 * rest / 3 if heights else 4 * rest**2, 800_000, sees=0.01)


SLOPES: dict[str, Any] = {"ggx": (True, False), "heights": (True, False)}


@case(3, each={"alpha": (0.05, 0.3, 1.0, 3.0), **SLOPES, "mu": (0.9, 0.2), "lit": LIT},
      quick=lambda alpha, ggx, heights, mu, lit: alpha == 0.3 and mu == 0.2)  # fmt: skip
def whole_mirror(t: Trial, alpha: float, ggx: bool, heights: bool, mu: float, lit: str) -> None:
    """Rough mirrors (F = 1) with energy compensation send on all light: 1. Sees 0.3 %."""
    mirror = whole(alpha, ggx, {"type": "conductor"}, heights)
    t.agrees(plate(mirror, mu, lit), 1.0, 800_000, sees=0.003)


@case(3, each={"alpha": (0.3, 1.0), **SLOPES, "lit": LIT},
      quick=lambda alpha, ggx, heights, lit: alpha == 1 and lit == "sky")  # fmt: skip
def whole_metal(t: Trial, alpha: float, ggx: bool, heights: bool, lit: str) -> None:
    """A rough metal with energy compensation, by quadrature: E F + (1 - E) F_ms. Sees 0.5 %."""
    metal = {"type": "conductor", "eta": 0.9, "k": 2.0, "specular_reflectance": rgb(0.8)}
    exact = returned(0.4, alpha, ggx, heights, complex(0.9, 2.0), 0.8)
    t.agrees(plate(whole(alpha, ggx, metal, heights), 0.4, lit), exact, 800_000, sees=0.005)


@case(3, each={"alpha": (0.1, 0.5, 1.0), **SLOPES, "mu": (0.9, 0.3), "inside": (True, False),
               "lit": LIT},
      quick=lambda alpha, ggx, heights, mu, inside, lit: alpha == 0.5 and lit == "sky"
      and mu == 0.3)  # fmt: skip
def whole_glass(t: Trial, alpha: float, ggx: bool, heights: bool, mu: float, inside: bool,
                lit: str) -> None:  # fmt: skip
    """Rough glass with energy compensation in even light, radiance eta^2 within: 1. Sees 0.3 %."""
    eta = 1 / 1.5 if inside else 1.5
    sheet = whole(alpha, ggx, glass(1.0, 1.5) if inside else glass(1.5), heights)
    t.agrees(plate(sheet, mu, lit, eta**2), 1.0, 800_000, sees=0.003)


@case(3, each={"alpha": (0.02, 0.3, 0.8), "ggx": (True, False), "mu": (0.9, 0.2), "lit": LIT},
      quick=lambda alpha, ggx, mu, lit: alpha == 0.3)  # fmt: skip
def rough_metal(t: Trial, alpha: float, ggx: bool, mu: float, lit: str) -> None:
    """A rough metal by its complex index: share of light that goes on, by quadrature. Sees 1 %."""
    eta, k = 0.2, 3.0
    exact = 0.8 * share(mu, alpha, ggx, lambda c: fresnel_conductor(c, complex(eta, k)))
    metal = {"type": "conductor", "eta": eta, "k": k, "specular_reflectance": rgb(0.8)}
    t.agrees(plate(rough(alpha, ggx, metal), mu, lit), exact, 400_000, sees=0.01)


@case(3, each={"alpha": (0.1, 0.5), "ggx": (True, False), "mu": (0.9, 0.3), "lit": LIT,
               "heights": (False, True)},
      quick=lambda alpha, ggx, mu, lit, heights: alpha == 0.1 + 0.4 * heights
      and mu == 0.3)  # fmt: skip
def rough_plastic(t: Trial, alpha: float, ggx: bool, mu: float, lit: str, heights: bool) -> None:
    """A rough coat on a matt base: E(mu) + rho T(mu) mean T / (eta^2 (1 - Fi)), by quadrature.

    T, what the coat lets in, linear between 64 cosines; nonlinear. Tables are made with 48 x 48
    slopes for a cosine, which is up to 1.3e-4 off for a base of 0.9. Sees 1 %.
    """
    eta, rho = 1.5, np.array([0.1, 0.5, 0.9])
    table, inside = coat(eta, alpha, ggx, heights)
    grid = np.linspace(0, 1, 64)
    x = (np.arange(20_000) + 0.5) / 20_000
    mean = float((2 * x * np.interp(x, grid, table)).mean())
    base = rho / (1 - rho * inside) / eta**2 * mean * np.interp(mu, grid, table)
    exact = 0.8 * share(mu, alpha, ggx, lambda c: fresnel(c, eta), None, 0.0, heights) + base
    smooth = plastic(rho, eta, nonlinear=True, specular_reflectance=rgb(0.8))
    t.agrees(plate(rough(alpha, ggx, smooth, heights), mu, lit), exact, 800_000, sees=0.01,
             margin=2e-4)  # fmt: skip


@case(3, each={"alpha": (0.05, 0.4), "ggx": (True, False), "mu": (0.9, 0.3),
               "inside": (True, False), "heights": (False, True)},
      quick=lambda alpha, ggx, mu, inside, heights: alpha == 0.4)  # fmt: skip
def rough_glass(t: Trial, alpha: float, ggx: bool, mu: float, inside: bool,
                heights: bool) -> None:  # fmt: skip
    """Rough glass over a lamp, by quadrature: 1 of the sky reflected, 3 of the lamp through it.

    Radiance is compressed by the squared index. Light samples reach the lamp from behind. Sees 1 %.
    """
    eta = 1 / 1.5 if inside else 1.5
    sheet = rough(alpha, ggx, glass(1.0, 1.5) if inside else glass(1.5), heights)
    curve = lambda c: fresnel(c, eta)  # noqa: E731
    points = 384 if inside else 96
    back = share(mu, alpha, ggx, curve, None, 0.0, heights, points)
    exact = back + 3 / eta**2 * share(mu, alpha, ggx, curve, eta, 0.0, heights, points)
    t.agrees(plate(sheet, mu, "sky", 3.0), exact, 400_000, sees=0.01)


@case(3, each={"ggx": (True, False), "lamp": (True, False), "fog": (0.0, 0.4)})
def light_through_rough_glass(t: Trial, ggx: bool, lamp: bool, fog: float) -> None:
    """A point light, or a lamp as small, behind the face of rough glass: f cos over d^2.

    What radiance the face scatters to the eye, from D, G1 and F in float64, for the lamp its mean
    over six directions to it; exp(-fog d) of it where the glass is a block that absorbs. Sees
    0.2 %.
    """
    eta, alpha, mu = 1.5, 0.4, 0.8
    wo = np.array([math.sqrt(1 - mu * mu), 0.0, mu])
    place = np.array([-0.7, 0.3, -2.0])
    distance = np.linalg.norm(place)

    def scattered(wi: Array) -> float:
        h = -(wo + eta * wi)
        h /= np.linalg.norm(h)
        h *= np.sign(h[2])
        om, im = float(wo @ h), float(wi @ h)
        slope2 = (h[0] ** 2 + h[1] ** 2) / h[2] ** 2 / alpha**2
        d = (1 / (1 + slope2) ** 2 if ggx else math.exp(-slope2)) / (math.pi * alpha**2 * h[2] ** 4)
        g = float(unhidden(wo, alpha, ggx) * unhidden(wi, alpha, ggx))
        f = float(fresnel(om, eta))
        return d * (1 - f) * g * om * abs(im) / mu / (om + eta * im) ** 2

    sheet = rough(alpha, ggx, glass(eta))
    radius = 0.01
    parts: list[Any] = [flat("rectangle", [0, 0, 0], [0, 0, 1], 50, sheet)]
    if fog:
        parts = [cuboid([-50, -50, -9], [50, 50, 0], sheet, interior=medium(fog, 0.0))]
    if lamp:
        parts.append(sphere(list(place), radius, BLACK, 1.0))
        power, way = math.pi * radius**2, distance - 2 / 3 * radius  # to its surface, on the mean
        # the mean over a disc but for the fourth power of its size: at 1 / sqrt(2) of its radius
        across = np.linalg.svd(place[None])[2][1:] * radius / math.sqrt(2)
        angles = np.arange(6) * math.pi / 3
        turns = list(np.stack([np.cos(angles), np.sin(angles)], axis=1) @ across)
    else:
        parts.append({"type": "point", "position": place.tolist(), "intensity": rgb(1.0)})
        power, way, turns = 1.0, distance, [np.zeros(3)]
    seen = scene(view(5 * wo, [0, 0, 0]), *parts, max_depth=2)
    ways = [(place + turn) / np.linalg.norm(place + turn) for turn in turns]
    value = float(np.mean([scattered(wi) for wi in ways]))
    exact = value * power / distance**2 * math.exp(-fog * way)
    t.agrees(seen, exact, 20_000, sees=0.002)
