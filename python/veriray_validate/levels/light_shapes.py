"""Level 2: every shape of light, in the order of cpp/lights/shapes.h: densities and emission.

A new shape is a row of SHAPES here; `tests/python/test_build_rules.py` compares the two lists.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Any

import numpy as np
import numpy.typing as npt

from veriray_validate.levels.numbers import LIGHT_SHAPES
from veriray_validate.levels.samplers import N, hooked, random_numbers, uniform, z_of_mean
from veriray_validate.oracles import INVERSE, azimuth, normalised, one_minus_cos, single
from veriray_validate.statistics import max_z
from veriray_validate.trial import Trial, case

Array = npt.NDArray[Any]
Square = tuple[Array, Array]

CHANCE = 0.4
P = single([0.3, -0.2, 0.1])
EDGES = single([[0.5, 0.1, 0.05], [-0.15, 0.4, 0.2]])
RIGHT = single([[0.45, 0.15, 0.3], [0.15, 0.15, -0.3]])
RADIUS = 0.25
CUTOFF, BEAM = 40.0, 25.0
AXIS = single(normalised(np.array([[0.48, -0.64, 0.6]])))[0]
#: Of the scene about the origin, which covers all coordinates below 1.
SCENE = math.sqrt(3)


def across(n: Array) -> Array:
    """Two unit vectors at right angles to n and to each other, as rows."""
    return np.asarray(np.linalg.svd(normalised(n[None]))[2][1:])


def about(n: Array, d: Array) -> Array:
    """Rows d in a frame with z along n, a unit vector or one a row."""
    if n.ndim == 1:
        return np.asarray(d @ np.stack([*across(n), normalised(n[None])[0]], axis=1))
    x = np.cross(n, np.where(np.abs(n[:, :1]) < 0.6, [[1.0, 0, 0]], [[0, 1.0, 0]]))
    x = normalised(x)
    return np.stack([(d * a).sum(axis=1) for a in (x, np.cross(n, x), n)], axis=1)


def everywhere(d: Array) -> Square:
    """Directions of a whole sphere to the unit square."""
    return one_minus_cos(d) / 2, azimuth(d)


def lambert(n: Array, d: Array) -> Square:
    """Directions of Lambert's lobe about n to the unit square."""
    return INVERSE["cosine_hemisphere"](about(n, d))


def on_disk(p: Array, d: Array) -> Square:
    """Points before the scene, as seen along d, to the unit square."""
    q = about(d, p) / SCENE
    if np.abs(q[:, 2] + 1).max() > 1e-6:
        raise ValueError("not before the scene")
    return INVERSE["uniform_disk"](q)


@dataclass(frozen=True)
class Shape:
    """A test row: the columns P, E1, E2 and N of the light table, and what follows from them.

    area: of a lamp, what the chance is divided by if it is flat. flux: emitted for radiance
    (intensity, irradiance) 1. place, way: position and direction of emitted light to the unit
    square, None where there is one alone. angle, meets: of a lamp, solid angle and which
    directions (n, 3) meet its front, as seen from a point. power: flux over that which counts for
    the choice.
    """

    columns: Array
    flux: float
    area: float = 0.0
    flat: bool = False
    place: Callable[[Array, Array], Square] | None = None
    way: Callable[[Array, Array], Square] | None = None
    angle: Callable[[Array], float] | None = None
    meets: Callable[[Array, Array], Array] | None = None
    receivers: dict[str, Array] = field(default_factory=dict)
    power: float = 1.0

    @property
    def density(self) -> float:
        """What the light table has the inverse of."""
        return CHANCE / self.area if self.flat else CHANCE


def fan(p: Array, middle: Array, rim: Array) -> float:
    """Solid angle of the triangles from a point to the sides of a polygon, seen from p.

    A. van Oosterom, J. Strackee, IEEE Trans. Biomed. Eng. 30 (1983).
    """
    a = np.broadcast_to(middle - p, rim.shape)
    b, c = rim - p, np.roll(rim, -1, axis=0) - p
    la, lb, lc = (np.linalg.norm(v, axis=1) for v in (a, b, c))
    over = (a * np.cross(b, c)).sum(axis=1)
    under = la * lb * lc + (a * b).sum(1) * lc + (b * c).sum(1) * la + (a * c).sum(1) * lb
    return float(np.abs(2 * np.arctan2(over, under).sum()))


def flat(name: str, edges: Array) -> Shape:
    """A parallelogram, triangle, disk or rectangle at P, and points in front of it."""
    n = np.cross(*edges)
    unit, corner_area = n / np.linalg.norm(n), float(np.linalg.norm(n))
    disk, three = name == "disk", name == "triangle"
    turns = 2 * math.pi * np.arange(20_000)[:, None] / 20_000
    rim = (
        np.cos(turns) * edges[0] + np.sin(turns) * edges[1]
        if disk
        else np.array([[0, 0, 0], edges[0], *([] if three else [edges.sum(0)]), edges[1]])
    )
    area = corner_area * (math.pi if disk else 0.5 if three else 1)
    middle = rim.mean(axis=0)

    def weights(q: Array) -> Array:
        return np.asarray(np.linalg.lstsq(edges.T, (q - P).T, rcond=None)[0].T)

    def meets(p: Array, d: Array) -> Array:
        along = d @ n
        t = ((P - p) @ n) / np.where(along < 0, along, -1e-30)
        a, b = weights(p + np.minimum(t, 1e6)[:, None] * d).T
        inside = a**2 + b**2 <= 1 if disk else (a >= 0) & (b >= 0) & (
            a + b <= 1 if three else np.maximum(a, b) <= 1)  # fmt: skip
        return np.asarray((along < 0) & inside)

    def place(p: Array, d: Array) -> Square:
        w = weights(p)
        if disk or three:
            return INVERSE[f"uniform_{name}"](w)
        return w[:, 0], w[:, 1]

    receivers = {where: single(P + middle + height * unit + along * edges[0])
                 for where, height, along in (("near", 0.15, 0.1), ("facing", 0.8, 0.0),
                                              ("oblique", 0.5, 1.5))}  # fmt: skip
    return Shape(
        np.concatenate([P, *edges, single(unit)]), math.pi * area, area, True, place,
        lambda p, d: lambert(unit, d), lambda p: fan(p, P + middle, P + rim), meets, receivers,
    )  # fmt: skip


def ball() -> Shape:
    """A sphere about P."""

    def angle(p: Array) -> float:
        ratio = RADIUS / float(np.linalg.norm(p - P))
        return 4 * math.pi if ratio > 1 else 2 * math.pi * (1 - math.sqrt(1 - ratio**2))

    def meets(p: Array, d: Array) -> Array:
        to, inside = P - p, np.linalg.norm(p - P) < RADIUS
        along = d @ to
        return np.asarray(inside | ((along > 0) & (along**2 >= to @ to - RADIUS**2)))

    columns = np.array([*P, 0, 0, 0, RADIUS, 0, 0, 1, 0, 0])
    area = 4 * math.pi * RADIUS**2
    receivers = {"near": P + 0.3 * AXIS, "far": P + 2 * AXIS, "inside": P + 0.1 * AXIS}
    return Shape(
        columns, math.pi * area, area, False, lambda p, d: everywhere(normalised(p - P)),
        lambda p, d: lambert(normalised(p - P), d), angle, meets,
        {where: single(p) for where, p in receivers.items()},
    )  # fmt: skip


def spot() -> Shape:
    """A spot at P along AXIS."""
    cutoff, beam = math.radians(CUTOFF), math.radians(BEAM)
    columns = np.array([*P, cutoff, 1 / (cutoff - beam), 0, 0, 0, 0, *AXIS])
    flux = 2 * math.pi * (1 - (math.sin(cutoff) - math.sin(beam)) / (cutoff - beam))

    def way(p: Array, d: Array) -> Square:
        local = about(AXIS, d)
        return one_minus_cos(local) / (1 - math.cos(cutoff)), azimuth(local)

    return Shape(columns, flux, way=way)


def projector() -> Shape:
    """A projector at P along AXIS."""
    a, b = across(AXIS) * [[0.8], [-1.7]]

    def way(p: Array, d: Array) -> Square:
        return 0.5 + (d @ a) / (d @ AXIS), 0.5 + (d @ b) / (d @ AXIS)

    area = float(1 / (np.linalg.norm(a) * np.linalg.norm(b)))
    return Shape(single(np.concatenate([P, a, b, AXIS])), area, area, way=way)


def of_image(p: Array, d: Array) -> Square:
    """Directions from the sky of hooks.h to the unit square.

    Its texels are a b with a 1, 0, 3, 0 in a row, and b 2, 1, 0 by rows. The columns' weights are
    a; those of the rows, 3, 3 t and 1 - t in the upper and the lower half.
    """
    x, y, z = -d.T
    a, ends = np.array([1, 0, 3, 0, 1]), np.array([0, 1, 4, 7])
    along = np.mod(np.arctan2(x, -z) / (2 * math.pi) * 4 - 0.5, 4)
    i = np.minimum(along.astype(int), 3)
    s, down = along - i, np.arctan2(np.hypot(x, z), y) * 2 / math.pi
    v = (ends[i] + 2 * a[i] * s + (a[i + 1] - a[i]) * s**2) / 8
    return np.where(down < 1, 0.75 * down**2, 1 - 0.25 * (2 - down) ** 2), v


#: Receivers by the chance of the guided sky's left half there.
PLACES = {0.25: P - single([0.8, 0, 0]), 0.75: P, 0.5: P + single([0, 1.5, 0])}


def guided(chance: float, d: Array) -> tuple[Array, Array, Array]:
    """Directions from the guided sky of hooks.h to the unit square, and their densities.

    chance: of the left half. Of its samples 3/4 are in the upper row, of the right half's 1/2.
    """
    u, v = of_image(d, -d)  # of emitted light
    x, y, z = d.T
    sine = np.hypot(x, z)
    down = np.arctan2(sine, y) * 2 / math.pi
    along = np.mod(np.arctan2(x, -z) / (2 * math.pi) * 4 - 0.5, 4)
    a, i = np.array([1, 0, 3, 0, 1]), np.minimum(along.astype(int), 3)
    density = (a[i] + (a[i + 1] - a[i]) * (along - i)) / 4 / (sine * math.pi**2 / 4)
    high, left = u < 0.75, v < 0.5
    upper = np.where(left, 0.75, 0.5)
    density = density * np.where(high, 2 * upper * down, 2 * (1 - upper) * (2 - down))
    density = density * np.where(left, 2 * chance, 2 * (1 - chance))
    u = np.where(high, upper * u / 0.75, 1 - (1 - upper) * (1 - u) / 0.25)
    return u, np.where(left, 2 * chance * v, 1 - 2 * (1 - chance) * (1 - v)), density


NOWHERE = np.zeros(9)
SHAPES = {
    "parallelogram": flat("parallelogram", EDGES),
    "triangle": flat("triangle", EDGES),
    "triangle_pair": flat("triangle_pair", EDGES),
    "disk": flat("disk", EDGES),
    "sphere": ball(),
    "point": Shape(np.array([*P, *NOWHERE]), 4 * math.pi, way=lambda p, d: everywhere(d)),
    "spot": spot(),
    "directional": Shape(np.array([*NOWHERE, *AXIS]), 3 * math.pi, place=on_disk, power=3),
    "rectangle": flat("rectangle", RIGHT),
    "constant_sky": Shape(np.array([*NOWHERE, 0, 0, 0]), 12 * math.pi**2, place=on_disk,
                          way=lambda p, d: everywhere(d), power=3),
    "image_sky": Shape(np.array([*np.eye(3).ravel(), 0, 0, 0]), 12 * math.pi**2, place=on_disk,
                       way=of_image, power=3),
    "guided_sky": Shape(np.array([*np.eye(3).ravel(), 0, 0, 0]), 12 * math.pi**2, place=on_disk,
                        way=of_image, power=3),
    "projector": projector(),
}  # fmt: skip
NUMBER = {name: LIGHT_SHAPES.index(name) for name in SHAPES}
LAMPS = [name for name, shape in SHAPES.items() if shape.meets]


def pdf(t: Trial, name: str, p: Array, d: Array) -> Array:
    """Density of light samples at directions (n, 3), all of which are taken to meet the lamp."""
    shape = SHAPES[name]
    return hooked(t, "light_pdf", NUMBER[name], *shape.columns, shape.density, *p,
                  *d.T)[:, 0]  # fmt: skip


def samples(t: Trial, name: str, p: Array, n: int) -> Array:
    """Rows of the hook `light`."""
    shape = SHAPES[name]
    u, v = random_numbers(t, n)[2:]
    return hooked(t, "light", NUMBER[name], *shape.columns, 0, shape.density, *p, u, v)


@case(2, each={"name": LAMPS})
def densities_of_lamps(t: Trial, name: str) -> None:
    """The density of a direction that meets a lamp is that of the light samples (C3).

    Near, far and from inside: over all directions it adds up to the chance of the lamp, by
    2 x 10^5 uniform ones; samples have it to 2e-4 / cos; the mean of 1 / density is the solid
    angle; and a sample's direction meets the lamp, the few within rounding of its rim aside.
    """
    shape, z = SHAPES[name], []
    assert shape.meets and shape.angle
    for where, p in shape.receivers.items():
        d = t.function("uniform_cone", *random_numbers(t, 2 * N * t.effort)[2:], 2.0)[:, :3]
        met = shape.meets(p, d)
        values = np.zeros(len(d))
        values[met] = 4 * math.pi * pdf(t, name, p, d[met])
        z.append(z_of_mean(values, CHANCE, 1e-5))
        s = samples(t, name, p, N * t.effort)
        met = shape.meets(p, s[:, :3])
        t.check(met.mean() > 0.9999, f"{where}: beside the lamp")
        unit = normalised(shape.columns[None, 9:])[0]
        cosine = np.abs(s[:, :3] @ unit) if shape.flat else np.ones(len(s))
        off = np.abs(pdf(t, name, p, s[:, :3]) / s[:, 3] - 1) * cosine
        t.check(off.max() < 2e-4, f"{where}: off by {off.max():.2g}")
        z.append(z_of_mean(CHANCE / s[:, 3], shape.angle(p), 1e-5))
    t.p(max_z(np.array(z)), "means")


@case(2, each={"chance": PLACES})
def samples_of_a_guided_sky(t: Trial, chance: float) -> None:
    """Directions by their cumulative distributions, 10^5, and densities to 1e-4 of their mean.

    Densities jump at the patches' borders, which the rounding of a direction, 2^-24 over its sine,
    may cross: 16 times as near they are not compared.
    """
    s = samples(t, "guided_sky", PLACES[chance], N * t.effort)
    d = s[:, :3].astype(np.float64)
    u, v, density = guided(chance, d)
    uniform(t, np.clip(u, 0, 1), np.clip(v, 0, 1), "directions")
    row, column = of_image(d, -d)
    borders = (row - 0.75, column - 0.5, column, 1 - column)
    near = np.abs(borders).min(axis=0)
    clear = near * np.hypot(d[:, 0], d[:, 2]) > 2.0**-20
    t.check(clear.mean() > 0.999, "at borders")
    off = np.abs(s[:, 3] / CHANCE - density)[clear]
    t.check(off.max() < 1e-4 * density.mean(), f"densities off by {off.max():.2g}")


def emitted(t: Trial, name: str, n: int) -> Array:
    """Rows of position (3), direction (3), cosine, radiance and the two densities."""
    shape = SHAPES[name]
    return hooked(t, "light_emission", NUMBER[name], *shape.columns, 0, shape.density,
                  *random_numbers(t, n))  # fmt: skip


@case(2, each={"name": SHAPES})
def emission(t: Trial, name: str) -> None:
    """Light leaves a light as its densities say, and adds up to its power (C1, C9).

    Positions and directions by their cumulative distributions, 10^5; the mean of radiance cosine
    over the densities is the flux over the chance (1e-5 and chance); so is what counts for the
    choice among lights, by the way of a third for what is far away.
    """
    shape = SHAPES[name]
    e = emitted(t, name, N * t.effort)
    p, d = e[:, :3], e[:, 3:6]
    t.check(np.isfinite(e), "not finite")
    t.check(np.abs((d * d).sum(axis=1) - 1).max() < 1e-6, "length")
    flux = e[:, 7] * e[:, 6] / (e[:, 8] * e[:, 9])
    t.p(max_z(np.array([z_of_mean(flux * CHANCE, shape.flux, 1e-5)])), "flux")
    for what, square in (("place", shape.place), ("way", shape.way)):
        if square is None:
            fixed = p if what == "place" else d
            t.check(np.ptp(fixed, axis=0).max() == 0, f"more than one {what}")
            continue
        u, v = square(p, d)
        t.check((u > -1e-5) & (u < 1 + 1e-5) & (v > -1e-5) & (v < 1 + 1e-5), f"{what}: outside")
        uniform(t, np.clip(u, 0, 1), np.clip(v, 0, 1), what)
    power = hooked(t, "light_power", [NUMBER[name]], shape.area, 1.0, CUTOFF, BEAM)
    off = abs(float(power[0, 0]) * shape.power / shape.flux - 1)
    t.check(off < 1e-6, f"power off by {off:.2g}")
