"""Blends of two materials: what they reflect and let through is the weighted sum of both."""

from __future__ import annotations

import functools
import math
from typing import Any

import veriray
from veriray_validate.dicts import (
    BLACK,
    MIRROR,
    NULL,
    Dict,
    diffuse,
    flat,
    glass,
    masked,
    rgb,
    scene,
    sky,
    sphere,
    view,
)
from veriray_validate.fresnel import fresnel, fresnel_conductor
from veriray_validate.levels.closed_materials.rough import LIT, plate, rough
from veriray_validate.rough import share
from veriray_validate.trial import Trial, case

MU, ALPHA, ETA, BELOW, WEIGHT = 0.6, 0.4, 1.5, 3.0, 0.3


def blend(first: Dict, second: Dict, weight: object = WEIGHT) -> Dict:
    """Two materials in one; weight: of the second."""
    return {"type": "blendbsdf", "weight": weight, "first": first, "second": second}


def metal(mu: Any) -> Any:
    """What gold-like metal reflects of light at a cosine."""
    return fresnel_conductor(mu, complex(0.2, 3.0))


@functools.cache
def facets() -> tuple[float, float]:
    """What rough metal and rough glass send to the cosine MU; of glass, light from below too."""
    through = BELOW / ETA**2 * share(MU, ALPHA, True, lambda c: fresnel(c, ETA), ETA)
    back = share(MU, ALPHA, True, lambda c: fresnel(c, ETA))
    return share(MU, ALPHA, True, metal), back + through


def materials() -> dict[str, tuple[Dict, float]]:
    """Materials, and their radiance at the cosine MU in light of 1 above and BELOW underneath."""
    shown = {"type": "conductor", "eta": 0.2, "k": 3.0}
    f = float(fresnel(MU, ETA))
    of_metal, of_glass = facets()
    grey = diffuse(0.6)
    return {
        "matt": (grey, 0.6),
        "metal": (shown, float(metal(MU))),
        "rough metal": (rough(ALPHA, True, shown), of_metal),
        "glass": (glass(ETA), f + (1 - f) * BELOW / ETA**2),
        "rough glass": (rough(ALPHA, True, glass(ETA)), of_glass),
        "nothing": (NULL, BELOW),
        "holes": (masked(0.2, grey), 0.2 * 0.6 + 0.8 * BELOW),
        "few holes": (masked(0.9, MIRROR), 0.9 + 0.1 * BELOW),
    }  # fmt: skip


PAIRS = (
    ("matt", "rough metal"), ("rough metal", "matt"), ("matt", "metal"), ("glass", "matt"),
    ("matt", "rough glass"), ("rough metal", "rough glass"), ("nothing", "matt"),
    ("holes", "few holes"), ("holes", "glass"),
)  # fmt: skip


@case(3, each={"pair": PAIRS, "lit": LIT, "textured": (False, True)},
      quick=lambda pair, lit, textured: textured == (lit == "sky"))  # fmt: skip
def plate_of_two(t: Trial, pair: tuple[str, str], lit: str, textured: bool) -> None:
    """A plate of two materials over a lamp: the weighted sum of what each gives alone. Sees 1 %.

    Each alone by closed forms and quadrature. With lamps, light samples compete.
    """
    (first, a), (second, b) = (materials()[name] for name in pair)
    board: object = {"type": "checkerboard", "color0": WEIGHT, "color1": WEIGHT}
    bsdf = blend(first, second, board if textured else WEIGHT)
    t.agrees(plate(bsdf, MU, lit, BELOW), (1 - WEIGHT) * a + WEIGHT * b, 600_000, sees=0.01)


SIDES = (("matt", "metal"), ("metal", "rough metal"), ("rough metal", "matt"))


@case(3, each={"pair": SIDES, "behind": (False, True), "lit": LIT, "masked_": (False, True)},
      quick=lambda pair, behind, lit, masked_: masked_ == (lit == "sky"))  # fmt: skip
def plate_of_two_sides(
    t: Trial, pair: tuple[str, str], behind: bool, lit: str, masked_: bool
) -> None:
    """A plate with another material on its back, seen from either side. Sees 1 %.

    masked_: in a mask over a lamp, which half of the light meets.
    """
    (front, a), (back, b) = (materials()[name] for name in pair)
    bsdf: Dict = {"type": "twosided", "front": front, "back": back}
    exact, below = b if behind else a, None
    if masked_:
        bsdf, exact, below = masked(0.5, bsdf), 0.5 * exact + 0.5 * BELOW, BELOW
    t.agrees(plate(bsdf, MU, lit, below, -1.0 if behind else 1.0), exact, 200_000, sees=0.01)


@case(3, each={"of": ("nothing", "pane", "holes"), "around": (False, True)})
def shadow_of_two(t: Trial, of: str, around: bool) -> None:
    """A blend of black and what lets light through, between the sun and what is seen. Sees 1 %.

    around: the blend is in a mask, which covers 3 / 4 of either.
    """
    f = (ETA - 1) ** 2 / (ETA + 1) ** 2
    other, through = {
        "nothing": (NULL, 1.0),
        "pane": (glass(ETA, kind="thindielectric"), 1 - 2 * f / (1 + f)),
        "holes": (masked(0.25, BLACK), 0.75),
    }[of]
    exact, opacity = WEIGHT * through, 0.75
    bsdf = blend(BLACK, other)
    if around:
        if of == "holes":
            bsdf, exact = blend(BLACK, NULL), WEIGHT
        bsdf, exact = masked(opacity, bsdf), 1 - opacity + opacity * exact
    sun = {"type": "directional", "direction": [0, 0, -1], "irradiance": rgb(math.pi)}
    holes = flat("rectangle", [0, 0, 4], [0, 0, 1], 9, bsdf)
    ground = flat("rectangle", [0, 0, 0], [0, 0, 1], 9, diffuse(1.0))
    t.agrees(scene(view([0, 0, 3], [0, 0, 0]), holes, ground, sun, max_depth=2), exact, 20_000,
             sees=0.01)  # fmt: skip


THREE = (
    ("matt", "metal", "holes"), ("holes", "rough metal", "nothing"), ("glass", "nothing", "matt"),
)  # fmt: skip


@case(3, each={"of": THREE, "lit": LIT})
def plate_of_three(t: Trial, of: tuple[str, str, str], lit: str) -> None:
    """A blend whose second material is a blend: the weighted sum of what each gives. Sees 1 %."""
    (first, a), (second, b), (third, c) = (materials()[name] for name in of)
    bsdf = blend(first, blend(second, third, 0.4), 0.7)
    exact = 0.3 * a + 0.7 * (0.6 * b + 0.4 * c)
    t.agrees(plate(bsdf, MU, lit, BELOW), exact, 600_000, sees=0.01)


@case(3, each={"black": (0, 1, 2)})
def shadow_of_three(t: Trial, black: int) -> None:
    """A blend in a blend between the sun and what is seen: black, with holes, nothing. Sees 1 %."""
    parts = [(BLACK, 0.0), (masked(0.25, BLACK), 0.75), (NULL, 1.0)]
    parts = parts[-black:] + parts[:-black]
    exact = sum(w * share for w, (_, share) in zip((0.3, 0.42, 0.28), parts, strict=True))
    bsdf = blend(parts[0][0], blend(parts[1][0], parts[2][0], 0.4), 0.7)
    sun = {"type": "directional", "direction": [0, 0, -1], "irradiance": rgb(math.pi)}
    holes = flat("rectangle", [0, 0, 4], [0, 0, 1], 9, bsdf)
    ground = flat("rectangle", [0, 0, 0], [0, 0, 1], 9, diffuse(1.0))
    t.agrees(scene(view([0, 0, 3], [0, 0, 0]), holes, ground, sun, max_depth=2), exact, 20_000,
             sees=0.01)  # fmt: skip


@case(3)
def furnace_of_two(t: Trial) -> None:
    """Matt and mirror in one, which lose nothing, in a sky of 1, many bounces: 1. Sees 0.1 %."""
    ground = flat("rectangle", [0, 0, -1], [0, 0, 1], 50, blend(diffuse(1.0), MIRROR, 0.5))
    parts = (ground, sphere([0, 0, 0], 1, blend(MIRROR, diffuse(1.0))), sky(1))
    t.agrees(scene(view([4, 0, 3], [0, 0, 0], 30, 8), *parts), 1.0, 4_000, sees=0.001)


SHEETS = {
    "two": lambda a, b: (blend(diffuse(a), diffuse(b), 0.3), 0.7 * a + 0.3 * b),
    "three": lambda a, b: (blend(diffuse(a), blend(diffuse(b), BLACK, 0.2), 0.3),
                           0.7 * a + 0.3 * 0.8 * b),
}  # fmt: skip


@case(3, each={"of": SHEETS, "lit": LIT})
def matt_in_matt(t: Trial, of: str, lit: str) -> None:
    """A blend of matt surfaces is the matt one of their mean: the same picture, noise and all.

    All of its materials count in light samples and in densities, so that by the same random numbers
    each sample is the same, but for rounding: 2^-16 of a pixel. Of the material that is chosen
    alone, the variance would be 2 to 20 times this.
    """
    bsdf, mean = SHEETS[of](0.02, 0.9)
    seed, pictures = t.fresh(), []
    for one in (bsdf, diffuse(mean)):
        ground = flat("rectangle", [0, 0, -1], [0, 0, 1], 5, one)
        light = sky(1) if lit == "sky" else sphere([0, 3, 3], 0.5, BLACK, 50.0)
        parts = (ground, sphere([0, 0, 0], 1, one), light)
        scene_of_one = scene(view([4, 0, 3], [0, 0, 0], 30, 8), *parts, max_depth=4)
        pictures.append(t.render(scene_of_one, 64, seed=seed).image.astype(float))
    blended, plain = pictures
    t.check(plain.mean() > 0.05, "no light")
    t.check(abs(blended - plain) <= plain * 2.0**-16, "another picture than of their mean")


@case(3)
def lamps_on_both_sides(t: Trial) -> None:
    """Matt and rough glass in one between three lamps: the sum of what each shows. Sees 2.5 %.

    One of the lamps is chosen for a light sample, and behind the matt part none is. The parts alone
    have 64 times the samples.
    """
    parts = diffuse(0.6), rough(0.5, True, glass(ETA))
    lamps = [
        sphere([x, y, z], 0.5, BLACK, radiance)
        for x, y, z, radiance in ((1, 0, 1.5, 10.0), (-1, 0.5, -1.5, 10.0), (0, -1, -1.2, 6.0))
    ]

    def between(bsdf: Dict) -> veriray.Scene:
        sheet = flat("rectangle", [0, 0, 0], [0, 0, 1], 9, bsdf)
        return scene(view([0, 4, 3], [0, 0, 0]), sheet, *lamps, max_depth=2)

    alone = [t.render(between(part), 2_560_000).image.astype(float) for part in parts]
    exact = (1 - WEIGHT) * alone[0] + WEIGHT * alone[1]
    t.agrees(between(blend(*parts)), exact, 40_000, sees=0.025)
