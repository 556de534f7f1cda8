"""Skies whose light samples leave out what is below their mean, as is the default.

Light there is found by directions of closures and phase functions alone, with weight 1: so these
cases ask each way on which light of a sky arrives.
"""

from __future__ import annotations

import math
import warnings
from typing import Any

import numpy as np
import numpy.typing as npt

import veriray
from veriray_validate.dicts import (
    BLACK,
    NULL,
    Dict,
    diffuse,
    flat,
    glass,
    masked,
    medium,
    plastic,
    rgb,
    scene,
    sphere,
    view,
)
from veriray_validate.levels.closed_skies import COLOUR, IMAGES, NORMALS, image, irradiance, plate
from veriray_validate.levels.samplers import replayed
from veriray_validate.oracles import gauss
from veriray_validate.statistics import error_of_sum, max_z, sidak, smallest_bias
from veriray_validate.trial import Trial, case

Array = npt.NDArray[Any]
ONCE: Dict = {"mis_compensation": True}


def mean_over_sphere(sums: Array) -> float:
    """Of the bilinear image of texels (height, width), by Gauss's rule in each row of cells."""
    rows, (x, w) = sums.mean(axis=1), gauss(6, 0.0, 1.0)
    cells = len(rows) - 1
    angle = (np.arange(cells)[:, None] + x) * math.pi / cells
    level = rows[:-1, None] * (1 - x) + rows[1:, None] * x
    return float((level * np.sin(angle) * w).sum() * math.pi / cells / 2)


def polar(d: Array) -> Array:
    """Angles of directions (n, 3) from the pole +y, which rounding of y leaves right next to it."""
    return np.asarray(np.arctan2(np.hypot(d[:, 0], d[:, 2]), d[:, 1]))


def densities(texels: Array, d: Array, compensated: bool) -> tuple[Array, Array]:
    """Per solid angle, of light samples of an image in its own frame, at directions (n, 3); and how
    much of it may be rounding: chances of rows, and of cells within one, are multiples of 2^-24.

    Bilinear in cells between texels, from corners of a texel's sum, less the mean if compensated,
    times the sine of its polar angle; a pole has its neighbour's.
    """
    sums = texels.astype(np.float64).sum(axis=2)
    if compensated:
        sums = np.maximum(sums - mean_over_sphere(sums), 0)
    height, width = sums.shape
    sines = np.sin(np.arange(height) * math.pi / (height - 1))
    above, below = sums[:-1] * sines[:-1, None], sums[1:] * sines[1:, None]
    above[-1] += sums[-1] * sines[-2]
    below[0] += sums[0] * sines[1]
    y = polar(d) * (height - 1) / math.pi
    x = np.arctan2(d[:, 0], -d[:, 2]) * width / (2 * math.pi) - 0.5
    row = np.minimum(y.astype(int), height - 2)
    column = np.floor(x).astype(int)
    t, s = y - row, x - column
    left, right = column % width, (column + 1) % width
    here = (above[row, left] * (1 - s) + above[row, right] * s) * (1 - t)
    here = here + (below[row, left] * (1 - s) + below[row, right] * s) * t
    total = (above + below).sum() / 2 * (2 * math.pi / width) * (math.pi / (height - 1))
    cells = above + below
    cells = cells + np.roll(cells, -1, axis=1)
    rows = cells.sum(axis=1)
    with np.errstate(divide="ignore", invalid="ignore"):  # no light samples there
        rounding = 2.0**-24 * (rows.sum() / rows[row] + rows[row] / cells[row, left])
    return here / (total * np.hypot(d[:, 0], d[:, 2])), np.where(here > 0, rounding, 0)


@case(2, each={"name": ["linear", "noise", "sun"], "compensated": [False, True]})
def density_where_a_sky_is_met(t: Trial, name: str, compensated: bool) -> None:
    """Paths that leave a white plate for an image: its light, weighted with an own density.

    Whole paths, replayed on the CPU: the weight is p^2 / (p^2 + q^2), p = cos / pi and q that of
    `densities`; within 1e-3 of the light, and what rounding changes: of q, and of the place in the
    image, by four units of 2^-24. Compensated, some meet a density of 0, and the weight is 1; of
    "sun" nine in ten.
    """
    texels, n = IMAGES[name], np.array(NORMALS["aslant"])
    out = plate(n, image(texels, mis_compensation=compensated), max_depth=2)
    paths = [p for p in replayed(t, out, 2_000, 2) if p[-1]["event"] == "escaped" and len(p) == 2]
    t.check(len(paths) > 1_000, f"{len(paths)} paths")
    d = np.array([p[1]["direction"] for p in paths], np.float64)
    got = np.array([np.subtract(p[1]["radiance"], p[0]["radiance"]) for p in paths])
    got /= np.array([p[1]["throughput"] for p in paths])
    height, width, _ = texels.shape
    y = polar(d) * (height - 1) / math.pi
    x = np.arctan2(d[:, 0], -d[:, 2]) * width / (2 * math.pi) - 0.5
    row, column = np.minimum(y.astype(int), height - 2), np.floor(x).astype(int)
    v, u = (y - row)[:, None], (x - column)[:, None]
    upper, lower = (
        texels[r, column % width] * (1 - u) + texels[r, (column + 1) % width] * u
        for r in (row, row + 1)
    )
    seen = upper * (1 - v) + lower * v
    p, (q, rounding) = d @ n / math.pi, densities(texels, d, compensated)
    weight = p**2 / (p**2 + q**2)
    exact = seen * weight[:, None]
    first = np.array([path[0]["radiance"] for path in paths])
    off = np.abs(got - exact) / (seen + first)
    ends = [texels[r, c % width] for r in (row, row + 1) for c in (column, column + 1)]
    steps = np.max(ends, axis=0) - np.min(ends, axis=0)  # of light and, in proportion, of density
    allowed = 1e-3 + 2 * (weight * (1 - weight) * rounding)[:, None]
    allowed = allowed + 8 * 2.0**-24 * max(texels.shape) * steps / (seen + first)
    t.check((off < allowed).all(), f"off by {off.max():.2g}")
    none = float((q == 0).mean())
    least = {"linear": 0.05, "noise": 0.01, "sun": 0.9}[name] if compensated else 0.0
    t.check((none >= least) & ((none > 0) == compensated), f"{none:.0%} without light samples")


@case(3, each={"name": IMAGES, "normal": NORMALS}, quick=lambda name, normal: normal == "aslant")
def compensated_image_over_a_plate(t: Trial, name: str, normal: str) -> None:
    """A plate under an image: rho E / pi, as without compensation.

    The images of `closed_skies.image_over_a_plate`.
    """
    texels, n = IMAGES[name], NORMALS[normal]
    exact = 0.5 / math.pi * irradiance(texels, n)
    seen = plate(n, image(texels, **ONCE), max_depth=2)
    t.agrees(seen, exact, 400_000, sees=0.03 if exact.max() > 1e-3 else 0.3)


@case(3)
def even_compensated_image(t: Trial) -> None:
    """An image of one colour, of which nothing exceeds the mean: a ball's furnace, and the bits of
    one that is not compensated.
    """
    ball = sphere([0, 0, 0], 1, diffuse(0.8))
    pictures = []
    for value in (False, True):
        even = image(np.broadcast_to(COLOUR, (7, 12, 3)), mis_compensation=value)
        seen = scene(view([0, 2, 3], [0, 0, 0], 15, 4), ball, even)
        pictures.append(t.render(seen, 64, seed=3).image)
        t.agrees(seen, 0.8 * COLOUR, 40_000, sees=0.01)
    t.check(pictures[0] == pictures[1], "other bits")


@case(3)
def black_below_half_of_a_sky(t: Trial) -> None:
    """Upper half 1, lower half 1 - 2^-10: half of the directions have no light samples.

    A plate that faces down sees none that has: rho E / pi by closures alone.
    """
    texels = np.ones((33, 16, 3))
    texels[17:] = 1 - 2**-10
    exact = 0.5 / math.pi * irradiance(texels, NORMALS["down"])
    t.agrees(plate(NORMALS["down"], image(texels, **ONCE), max_depth=2), exact, 200_000, sees=0.01)


# ---- pictures with and without ----

#: As much light from a bright part as from all that is below the mean.
_BRIGHT = 0.3 * COLOUR + IMAGES["three rows"].mean() * np.linspace(0.5, 1, 9 * 16).reshape(9, 16, 1)
_BRIGHT[2:4, 12:15] += 7 * COLOUR
_FLOOR = flat("rectangle", [0, -1, 0], [0, 1, 0], 6, diffuse([0.7, 0.5, 0.3]))
_METAL: Dict = {"type": "roughconductor", "material": "Au"}
_GLOSS: Dict = {"type": "roughplastic", "alpha": 0.2, "diffuse_reflectance": rgb([0.1, 0.4, 0.6])}
_SHINY: Dict = {"type": "principled", "roughness": 0.4, "metallic": 0.3, "clearcoat": 0.5,
                "spec_trans": 0.3, "base_color": rgb([0.8, 0.5, 0.3])}  # fmt: skip
_FOG = medium([0.6, 0.8, 1.0], [0.9, 0.8, 0.7], 0.6)
_FUR: Dict = {"type": "hair", "longitudinal_roughness": 0.3, "azimuthal_roughness": 0.3}


def _ball(bsdf: Dict, **more: Any) -> Dict:
    return sphere([0, 0, 0], 1, bsdf, **more)


#: Objects besides the floor, the depth of paths, and what else the integrator says.
SCENES: dict[str, tuple[list[Dict], int, Dict]] = {
    "diffuse": ([_ball(diffuse(0.6))], -1, {}),
    "cut at depth 2": ([_ball(diffuse(0.6))], 2, {}),
    "cut at depth 3": ([_ball(_GLOSS)], 3, {}),
    "roulette at once": ([_ball(diffuse(0.3))], -1, {"rr_depth": 1}),
    "rough metal .05": ([_ball({**_METAL, "alpha": 0.05})], -1, {}),
    "rough metal .5, beckmann": (
        [_ball({**_METAL, "alpha": 0.5, "distribution": "beckmann"})], -1, {}
    ),
    "rough plastic": ([_ball(_GLOSS)], -1, {}),
    "plastic": ([_ball(plastic(0.5, 1.5))], -1, {}),
    "glass": ([_ball(glass(1.5))], -1, {}),
    "rough glass": ([_ball(glass(1.5, kind="roughdielectric", alpha=0.3))], -1, {}),
    "principled": ([_ball(_SHINY)], -1, {}),
    "blend": ([_ball({"type": "blendbsdf", "weight": 0.4, "a": diffuse(0.5),
                      "b": {**_METAL, "alpha": 0.1}})], -1, {}),
    "mask": ([_ball(masked(0.6, diffuse(0.5)))], -1, {}),
    "thin glass": ([_ball(glass(1.5, kind="thindielectric"))], -1, {}),
    "hair": ([_ball(_FUR)], -1, {}),
    "fog": ([_ball(NULL, interior=_FOG)], -1, {}),
    "fog cut at depth 2": ([_ball(NULL, interior=_FOG)], 2, {}),
    "fog in glass": ([_ball(glass(1.3), interior=_FOG)], -1, {}),
    "hidden": ([_ball(masked(0.6, diffuse(0.5)))], -1, {"hide_emitters": True}),
    "direct, bsdf_samples 0": ([_ball(_GLOSS)], 2, {"type": "direct", "bsdf_samples": 0}),
    "ptracer": ([_ball(diffuse(0.6))], -1, {"type": "ptracer"}),
    "a lamp and a sun beside it": (
        [_ball(diffuse(0.6)),
         flat("rectangle", [-3, 3, 0], [0.7, -0.7, 0], 0.5, BLACK, [3, 4, 5]),
         {"type": "directional", "direction": [0.3, -1, 0.2], "irradiance": rgb([1, 0.5, 0.2])}],
        -1, {}
    ),
}  # fmt: skip
QUICK = ("diffuse", "cut at depth 2", "roulette at once", "rough plastic", "blend", "fog", "hidden",
         "direct, bsdf_samples 0", "a lamp and a sun beside it")  # fmt: skip


def pictured(name: str, compensated: bool) -> Any:
    """One of SCENES."""
    objects, depth, more = SCENES[name]
    out = {"type": "volpath", "rr_depth": 5, "max_depth": depth, **more}
    if out["type"] == "direct":
        del out["max_depth"], out["rr_depth"]
    parts = {f"object_{k}": o for k, o in enumerate([_FLOOR, *objects])}
    eye = view([0, 1.5, 4.5], [0, -0.3, 0], 40, 8)
    sky = image(_BRIGHT, mis_compensation=compensated)
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", veriray.SceneWarning)  # hair on a ball
        return veriray.load_dict(
            {"type": "scene", "integrator": out, "sensor": eye, **parts, "sky": sky}
        )


@case(3, each={"name": SCENES, "sampler": ["independent", "sobol"]},
      quick=lambda name, sampler: name in QUICK and sampler == "independent")  # fmt: skip
def compensation_changes_noise_alone(t: Trial, name: str, sampler: str) -> None:
    """Two pictures, one with compensation, by seeds of their own: one expectation.

    Largest |z| over 64 pixels and channels, and over the channels of the mean: a sound program
    fails once in 10^7 runs, as every case. States the bias of the mean that it finds with 90 %
    power, 2 % at most.
    """
    one, other = (
        t.render(pictured(name, value), 16_384, seed=t.fresh(), sampler=sampler)
        for value in (False, True)
    )
    a, b = (r.image.astype(np.float64) for r in (one, other))
    error = np.hypot(one.stderr.astype(np.float64), other.stderr.astype(np.float64))
    t.check((a == b)[error == 0], "pixels without noise")
    noisy = error > 0
    z = ((a - b)[noisy] / error[noisy]).ravel()
    t.p(sidak(max_z(z[np.abs(z).argmax()]), len(z)), "pixels")
    total = np.hypot(error_of_sum(one)[0], error_of_sum(other)[0])
    t.p(max_z((a - b).sum(axis=(0, 1)) / total), "picture")
    t.sees(smallest_bias(float(np.sqrt((total**2).mean())), float(a.sum()) / 3), 0.02)
