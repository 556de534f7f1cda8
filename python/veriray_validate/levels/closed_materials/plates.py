"""Plates, stacks, balls and blocks of glass."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Any

import numpy as np
import numpy.typing as npt

from veriray_validate.dicts import (
    BLACK,
    cuboid,
    diffuse,
    direction,
    flat,
    glass,
    medium,
    rgb,
    scene,
    sky,
    sphere,
    view,
)
from veriray_validate.fresnel import fresnel, internal_reflectance
from veriray_validate.statistics import binomial, chi_square, smallest_bias
from veriray_validate.trial import Trial, case

Array = npt.NDArray[np.float64]


# ---- plates and stacks ----

SLAB = {0: 0.923077, 30: 0.920266, 60: 0.836232}
LAMPS = (flat("rectangle", [0, 0, -9], [0, 0, 1], 40, BLACK, [1, 0, 2]),
         flat("rectangle", [0, 0, 9], [0, 0, -1], 40, BLACK, [0, 1, 2]))  # fmt: skip


@case(3, each={"angle": SLAB, "material": ("slab", "thin")})
def clear_slab(t: Trial, angle: float, material: str) -> None:
    """A plate of glass, all inter-reflections, and a thin pane.

    (1 - R) / (1 + R) of a lamp behind: .923077, .920266, .836232; the rest of a lamp in front. A
    thin pane has the same two numbers.
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
    """A plate of absorbing glass, tau = 1.

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
    """Reflectance and transmittance of a stack of surfaces; layers in between transmit `passes`.

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
    """A pile of plates of any index, clear and coloured, at any angle.

    m clear surfaces of one kind transmit (1 - R) / (1 + (m - 1) R): G. G. Stokes, 1862; others by
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
    """A sheet of clear glass on a diffuse wall, by its geometry.

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
    """Light from a ball of n = 1.5: reflected, transmitted, and reflected once inside.

    F, (1 - F)^2, (1 - F)^2 F: there is a lamp of a different colour in each of the directions.
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
    """specular_reflectance and specular_transmittance multiply each event.

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
    """At 60 degrees inside n = 1.5 a lamp in the glass is seen undimmed.

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
    """Segments alive in a clear slab at normal incidence.

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
    """Directions from inside a cube of glass n = 1.5: sqrt 5 - 2 of them never leave.

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
