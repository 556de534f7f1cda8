"""Level 2: lights: points on them, directions to them, their selection, their density when hit."""

from __future__ import annotations

import itertools
import math
from typing import Any

import numpy as np
import numpy.typing as npt

from veriray.scene import Scene
from veriray_validate.levels.light_choice import chances
from veriray_validate.levels.light_shapes import NUMBER
from veriray_validate.levels.numbers import jacobian, places
from veriray_validate.levels.samplers import (
    N,
    count,
    hooked,
    random_numbers,
    replayed,
    uniform,
    z_of_mean,
)
from veriray_validate.oracles import (
    CORNERS,
    INVERSE,
    azimuth,
    normalised,
    seen_rectangle,
    single,
    solid_angle,
)
from veriray_validate.scenes import Part, camera, disk, make, quad, sphere
from veriray_validate.statistics import chi_square, max_z
from veriray_validate.trial import Trial, case

Array = npt.NDArray[Any]

# ---- sphere lights ----

#: Centre and radius with low parts 0, and points: just outside, near, far, inside, at the centre.
SPHERE = [0.25, -0.5, 0.125, 0, 0, 0, 0.5, 0]
TOWARDS = np.array([0.6, 0.0, -0.8])
AWAY = {"1e-5 radii off": 1.00001, "near": 1.5, "far": 200.0, "inside": 0.7, "centre": 0.0}


@case(2, each={"name": AWAY})
def sphere_lights(t: Trial, name: str) -> None:
    """Directions to a sphere are uniform in its cone; from inside, over all directions.

    pdf within 1e-5; 10^5 directions: sees 1 % in scale, 4 % in tilt.
    """
    p = single(SPHERE[:3]) + single(AWAY[name] * SPHERE[6] * TOWARDS)
    axis = np.array(SPHERE[:3]) - single(p)
    ratio = SPHERE[6] / max(float(np.linalg.norm(axis)), 1e-30)
    open_ = 2.0 if ratio > 1 else ratio**2 / (1 + math.sqrt(1 - ratio**2))
    frame = np.linalg.svd(axis[None] if axis.any() else np.eye(3)[2:])[2]
    frame[0] *= np.sign(frame[0] @ axis) if axis.any() else 1
    u, v = random_numbers(t, N * t.effort)[2:]
    s = t.function("sphere_light", *SPHERE, *p, u, v)
    t.check(np.abs(s[:, 3] * 2 * np.pi * open_ - 1) < 1e-5, "pdf")
    local = s[:, :3] @ frame.T
    h = np.where(local[:, 0] > 0, (local[:, 1:] ** 2).sum(1) / (1 + np.abs(local[:, 0])),
                 1 - local[:, 0])  # fmt: skip
    uniform(t, np.clip(h / open_, 0, 1), azimuth(local[:, 1:]), name)


@case(2)
def sphere_light_irradiance(t: Trial) -> None:
    """Irradiance from a sphere, and its area, by its samples.

    Radiance 1 gives pi (r/d)^2 to a patch that faces it, pi to one inside it; the mean of
    distance^2 / (cos_light pdf) is the area seen, 2 pi r^2 (1 - r/d). 10^5 samples: sees 1 %.
    """
    z = []
    for name, away in AWAY.items():
        p = single(SPHERE[:3]) + single(away * SPHERE[6] * TOWARDS)
        u, v = random_numbers(t, N * t.effort)[2:]
        s = t.function("sphere_light", *SPHERE, *p, u, v)
        cosine = np.maximum(-(s[:, :3] @ TOWARDS), 0)
        outside = away > 1
        irradiance = math.pi * (1 / away**2 if outside else 1)
        area = 2 * math.pi * SPHERE[6] ** 2 * (1 - 1 / away if outside else 2)
        weights = [(cosine / s[:, 3], irradiance)]
        if name != "1e-5 radii off":  # there a sample in 10^5 holds most of the area
            weights.append((s[:, 4] ** 2 / (np.abs(s[:, 5]) * s[:, 3]), area))
        z += [z_of_mean(values, mean, 1e-6) for values, mean in weights]
    t.p(max_z(np.array(z)), "means")


# ---- flat lights ----

SHAPES = ("parallelogram", "triangle", "disk")
CORNER = single([0.3, -0.2, 0.6])
EDGES = single([[1.0, 0.2, 0.1], [-0.3, 0.8, 0.4]])
AREA = {shape: float(np.linalg.norm(np.cross(*EDGES))) * share
        for shape, share in zip(SHAPES, (1, 0.5, math.pi), strict=True)}  # fmt: skip
LAMP_NORMAL = normalised(np.cross(*EDGES)[None])[0]
#: Receivers: height over the lamp's plane, and position along its first edge from its middle.
RECEIVERS = {"facing": (1.0, 0.0), "oblique": (1.0, 1.7), "grazing": (0.02, 2.5),
             "near": (0.02, 0.0), "far": (100.0, 30.0)}  # fmt: skip


def receiver(shape: str, where: str, side: float = 1.0) -> Array:
    """A point that sees the front of the lamp, or with side -1 its back."""
    height, along = RECEIVERS[where]
    middle = {"parallelogram": 0.5, "triangle": 1 / 3, "disk": 0.0}[shape]
    at = CORNER + middle * EDGES.sum(axis=0)
    return single(at + side * height * LAMP_NORMAL + along * EDGES[0])


def light(t: Trial, shape: str, p: Array, u: Any, v: Any) -> Array:
    """Rows of wi (3), pdf, distance, radiance and whether the light is a delta one."""
    return hooked(t, "light", NUMBER[shape], *CORNER, *EDGES[0], *EDGES[1], *LAMP_NORMAL, 0.0,
                  0.4 / AREA[shape], *p, u, v)  # fmt: skip


def weights(shape: str, u: Array, v: Array) -> tuple[Array, Array]:
    """Of the two edges (half axes) at a place chosen by u and v."""
    if shape == "parallelogram":
        return u, v
    r = np.sqrt(u)
    if shape == "triangle":
        return r * (1 - v), r * v
    return r * np.cos(2 * np.pi * v), r * np.sin(2 * np.pi * v)


@case(2, each={"shape": SHAPES, "where": RECEIVERS})
def places_on_flat_lights(t: Trial, shape: str, where: str) -> None:
    """Points on a lamp are uniform by area, seen from the front, at grazing angles, near and far.

    Recovered from direction and distance; 10^5 points: sees 1 % in scale, 4 % in tilt.
    """
    p = receiver(shape, where)
    s = light(t, shape, p, *random_numbers(t, N * t.effort)[2:])
    q = p + s[:, :3] * s[:, 4:5] / (1 - 2.0**-21) - CORNER
    a, b = np.linalg.lstsq(EDGES.T, q.T, rcond=None)[0]
    off = 1e-6 * (1 + RECEIVERS[where][0])
    t.check(np.abs(q @ LAMP_NORMAL).max() < off, "not on the lamp")
    if shape == "parallelogram":
        u, v = a, b
    elif shape == "triangle":
        u, v = INVERSE["uniform_triangle"](np.stack([a, b], axis=1).clip(0, 1))
    else:
        u, v = INVERSE["uniform_disk"](np.stack([a, b], axis=1))
    t.check((u > -10 * off) & (u < 1 + 10 * off) & (v > -10 * off) & (v < 1 + 10 * off), "outside")
    uniform(t, np.clip(u, 0, 1), np.clip(v, 0, 1), shape)


@case(2, each={"shape": SHAPES, "where": RECEIVERS})
def samples_of_flat_lights(t: Trial, shape: str, where: str) -> None:
    """Direction, distance, density and radiance of light samples, corners included.

    Against float64: direction within 5e-7 of the place's distance, distance 1e-6 of itself, pdf
    chance distance^2 / (area cos) within 1e-6 + 1e-6 / cos; radiance 1 from the front, exactly 0
    from the back; Jacobian times pdf is 1 within 1e-4.
    """
    p = receiver(shape, where)
    u, v = random_numbers(t, 20_000)[2:].astype(np.float64)
    u[:16], v[:16] = np.array(list(itertools.product(CORNERS, CORNERS))).T
    s = light(t, shape, p, u, v)
    a, b = weights(shape, u, v)
    to = CORNER + a[:, None] * EDGES[0] + b[:, None] * EDGES[1] - p
    d = np.linalg.norm(to, axis=1)
    wi = to / d[:, None]
    cosine = -(wi @ LAMP_NORMAL)
    t.check(np.isfinite(s), "not finite")
    off = np.abs(s[:, :3] - wi).max(axis=1)
    t.check(off < 5e-7 * np.maximum(1, 2 / d), f"direction off by {off.max():.2g}")
    t.check(np.abs(s[:, 4] / d - 1) < 1e-6 * np.maximum(1, 1 / d), "distance")
    slack = 1e-6 + 1e-6 / cosine * np.maximum(1, 1 / d)
    t.check(np.abs(s[:, 3] * cosine * AREA[shape] / (0.4 * d**2) - 1) < slack, "pdf")
    t.check((s[:, 5] == 1) & (s[:, 6] == 0), "radiance")
    back = light(t, shape, receiver(shape, where, -1), u, v)
    t.check(back[:, 5] == 0, "the back shines")
    if where in ("facing", "oblique"):
        u, v = places()
        area = jacobian(lambda u, v: light(t, shape, p, u, v)[:, :3], u, v)
        off = np.abs(area * light(t, shape, p, u, v)[:, 3] / 0.4 - 1)
        t.check(off.max() < 1e-4, f"Jacobian off by {off.max():.2g}")


#: A rectangle and, from its middle and in lengths of its first edge, receivers: along both edges
#: and height. From the last two it is sampled by area.
RIGHT = single([[0.9, 0.3, 0.6], [0.3, 0.3, -0.6]])
RIGHT_NORMAL = normalised(np.cross(*RIGHT)[None])[0]
SEEN = {"facing": (0, 0, 0.8), "off": (0.1, 0.7, 0.3), "near": (0.2, 0.1, 0.003),
        "edge": (0.5, 0.0, 0.02), "corner": (0.6, 0.5, 0.2), "beside": (0.55, 0.1, 0.02),
        "far": (0.2, 0.4, 2.6), "far off": (1.5, 1.0, 1.0), "grazing": (3.0, 0.2, 0.1)}  # fmt: skip


def seen(where: str) -> Array:
    """A receiver of SEEN."""
    a, b, up = SEEN[where]
    length, way = np.linalg.norm(RIGHT[0]), normalised(RIGHT)
    return single(CORNER + RIGHT.sum(axis=0) / 2
                  + length * (a * way[0] + b * way[1] + up * RIGHT_NORMAL))  # fmt: skip


@case(2, each={"where": SEEN})
def rectangles_by_solid_angle(t: Trial, where: str) -> None:
    """Samples of a rectangle are uniform in its solid angle where that is 1/16 or more.

    Against float64: the density is selection probability / solid angle, the latter within 5e-7 sr
    plus the effect of 1e-7 of the distance to the lamp in a coordinate. The solid angle before a
    point's x is u of the whole within 4e-6 sr, its y has the share v of the sines between the edges
    within 1e-5, and no point is off the lamp. Below 1/16 the density is by area. 20,000 points,
    corners included.
    """
    p = seen(where)
    u, v = random_numbers(t, 20_000 * t.effort)[2:].astype(np.float64)
    u[:16], v[:16] = np.array(list(itertools.product(CORNERS, CORNERS))).T
    area = float(np.linalg.norm(np.cross(*RIGHT)))
    s = hooked(t, "light", NUMBER["rectangle"], *CORNER, *RIGHT[0], *RIGHT[1], *RIGHT_NORMAL, 0.0,
               0.4 / area, *p, u, v)  # fmt: skip
    t.check(np.isfinite(s), "not finite")
    (x0,), (y0,), (z,) = seen_rectangle(p, CORNER, *RIGHT)
    w, h = np.linalg.norm(RIGHT, axis=1)
    whole = float(solid_angle(x0, x0 + w, y0, y0 + h, z))
    q = p + s[:, :3] * s[:, 4:5] / (1 - 2.0**-21) - CORNER
    a, b = np.linalg.lstsq(RIGHT.T, q.T, rcond=None)[0]
    slack = 1e-6 * max(1.0, float(np.linalg.norm(p - CORNER)))
    t.check(np.abs(q @ RIGHT_NORMAL).max() < slack, "not on the lamp")
    t.check((np.minimum(a, b) > -2 * slack) & (np.maximum(a, b) < 1 + 2 * slack), "outside")
    if whole < 1 / 16:
        cosine = -(s[:, :3] @ RIGHT_NORMAL)
        t.check(np.abs(a - u).max() < 1e-5 and np.abs(b - v).max() < 1e-5, "not by area")
        t.check(np.abs(s[:, 3] * cosine * area / (0.4 * s[:, 4] ** 2) - 1) < 1e-4, "pdf by area")
        return
    step = 1e-7 * max(1.0, float(np.linalg.norm(p - CORNER)))
    slack = 5e-7 + sum(
        abs(float(solid_angle(x, x + w, y, y + h, up)) - whole)
        for x, y, up in ((x0 + step, y0, z), (x0, y0 + step, z), (x0, y0, z + step))
    )
    off = np.abs(0.4 / s[:, 3] - whole)
    t.check(off < slack, f"solid angle off by {off.max():.2g} sr")
    x, dx = x0 + a * w, 2 * step  # places are rounded too
    low, high = (solid_angle(x0, x + side * dx, y0, y0 + h, z) for side in (-1, 1))
    off = np.maximum(np.maximum(low - u * whole, u * whole - high), 0)
    t.check(off.max() < 4e-6, f"x off by {off.max():.2g} sr")
    across = np.sqrt(x**2 + z**2)
    sines = [y / np.hypot(y, across) for y in (y0, y0 + b * h - dx, y0 + b * h + dx, y0 + h)]
    low, high = ((sine - sines[0]) / (sines[3] - sines[0]) for sine in sines[1:3])
    off = np.maximum(np.maximum(low - v, v - high), 0)
    t.check(off.max() < 1e-5, f"y off by {off.max():.2g}")


@case(2)
def delta_lights(t: Trial) -> None:
    """Samples of point, spot and directional lights.

    One direction, chance 0.25 for a density, marked as delta; radiance 1 / d^2, of a spot times its
    linear falloff between beam and cutoff, 0 outside; within 1e-6, the spot's within 1e-5.
    """
    n = 5_000
    p = single(t.rng.uniform(-2, 2, (n, 3)))
    at, way = single([0.2, 0.1, 3.0]), single(normalised(np.array([[0.1, -0.2, -1.0]])))[0]
    cutoff, beam = math.radians(25), math.radians(15)
    spot = single([cutoff, 1 / (cutoff - beam)])
    u, v = t.rng.random((2, n))
    to = at - p
    d = np.linalg.norm(to, axis=1)
    for kind, row in (("point", [0] * 6), ("spot", [*spot, 0, 0, 0, 0]), ("directional", [0] * 6)):
        s = hooked(t, "light", NUMBER[kind], *at, *row, *way, 0.0, 0.25, *p.T, u, v)
        t.check((s[:, 3] == 0.25) & (s[:, 6] == 1), f"{kind}: chance")
        if kind == "directional":
            t.check(np.isinf(s[:, 4]) & (s[:, 5] == 1), "radiance")
            t.check(s[:, :3] == -way, "direction")
            continue
        t.check(np.abs(s[:, :3] - to / d[:, None]).max() < 5e-7, f"{kind}: direction")
        t.check(np.abs(s[:, 4] / d - 1).max() < 1e-6, f"{kind}: distance")
        share = np.ones(n)
        if kind == "spot":
            angle = np.arccos(np.clip(-(to @ way) / d / np.linalg.norm(way), -1, 1))
            share = np.clip((cutoff - angle) / (cutoff - beam), 0, 1)
        off = np.abs(s[:, 5] * d**2 - share)
        t.check(off.max() < (1e-5 if kind == "spot" else 1e-6), f"{kind}: {off.max():.2g}")


# ---- in renders ----

FLOOR = quad([-9, -9, 0], [18, 0, 0], [0, 18, 0], 0.5)
VIEW = camera([0.4, 0.6, 0.4], [0, 0, 0], 0.001)


def shadowed(t: Trial, parts: list[Part], spp: int, environment: Any = 0.0) -> tuple[int, int]:
    """Shadow rays from the origin on the floor: hidden ones, and all that were wanted."""
    scene = make([FLOOR, *parts], VIEW, environment, max_depth=2)
    ledger = t.render(scene, spp).stats["ledger"]
    hidden, free = ledger["shadow_occluded"][0], ledger["shadow_visible"][0]
    return hidden, hidden + free


def _scaled(points: Any, share: float = 0.9) -> Array:
    """Nearer to the origin, under the same solid angle."""
    return share * np.asarray(points, np.float64)


def _hiders() -> dict[str, tuple[Part, Part, float]]:
    """Lamp, black plate before a part of it as seen from the origin, share of the samples."""
    corner, a, b = np.array([-0.5, -0.7, 1.2]), np.array([0.2, 1.5, 0.3]), np.array([1.3, 0.1, 0.1])
    # fronts look down: cross(a, b) has a negative z
    whole = quad(corner, a, b, 0, 1.0)

    def plate(u: float, v: float, du: float, dv: float) -> Part:
        return quad(_scaled(corner + u * a + v * b), _scaled(du * a), _scaled(dv * b))

    three = Part([corner, corner + a, corner + b], [[0, 1, 2]], 0, 1.0)
    tip = Part(_scaled([corner, corner + 0.6 * a, corner + 0.6 * b]), [[0, 1, 2]])
    half = Part(_scaled([corner, corner + a, corner + (a + b) / 2]), [[0, 1, 2]])
    middle = np.array([0.1, 0.2, 1.5])
    round_ = disk(middle, 0.5 * a, 0.5 * b, 0, 1.0)
    core = disk(_scaled(middle), _scaled(0.3 * a), _scaled(0.3 * b))
    side = quad(_scaled(middle - 0.6 * a), _scaled(1.2 * a), _scaled(0.6 * b))
    ball = sphere([0, 0, 2.0], 1.0, 0, 1.0)
    # a disc at height 0.5 that hides the cone of 15 degrees of the ball's 30
    cap = disk([0, 0, 0.5], [0, 0.5 * math.tan(math.radians(15)), 0],
               [0.5 * math.tan(math.radians(15)), 0, 0])  # fmt: skip
    wedge = quad([0, -2, 0.5], [0, 4, 0], [2, 0, 0])
    solid = (1 - math.cos(math.radians(15))) / (1 - math.cos(math.radians(30)))
    return {
        "parallelogram u": (whole, plate(0, 0, 0.3, 1), 0.3),
        "parallelogram v": (whole, plate(0, 0.6, 1, 0.4), 0.4),
        "parallelogram corner": (whole, plate(0, 0, 0.5, 0.5), 0.25),
        "triangle tip": (three, tip, 0.36),
        "triangle half": (three, half, 0.5),
        "disk core": (round_, core, 0.36),
        "disk half": (round_, side, 0.5),
        "sphere cap": (ball, cap, solid),
        "sphere half": (ball, wedge, 0.5),
    }


HIDERS = _hiders()


@case(2, each={"name": HIDERS})
def hidden_parts_of_lights(t: Trial, name: str) -> None:
    """A black plate hides a part of a lamp: its share of the shadow rays is occluded.

    By area for flat lamps, by solid angle for the sphere; exact binomial, 10^5 rays: sees 0.8 %
    (absolute), in a full run 0.4 %.
    """
    lamp, plate, share = HIDERS[name]
    hidden, wanted = shadowed(t, [lamp, plate], N)
    t.check(wanted == N * t.effort, f"{wanted} rays wanted")
    count(t, hidden, wanted, share, name)


def at_origin(t: Trial, parts: list[Part]) -> Array:
    """The chances of the lights at the origin on the floor, by row of the light table."""
    return chances(t, make([FLOOR, *parts], VIEW), np.zeros(3), np.array([0, 0, 1.0]))


@case(2)
def choice_of_light(t: Trial) -> None:
    """Two lamps, of which a black plate hides the first: its share of shadow rays is occluded.

    Its chance is that of `light_choice`, with and without a sky, which takes no light samples.
    Exact binomial, 4 x 10^5 rays: sees 0.3 % (absolute).
    """
    lamps = [quad([-3, -0.5, 2], [0, 1, 0], [2, 0, 0], 0, 3.0),
             quad([1, -0.5, 2], [0, 1, 0], [1, 0, 0], 0, [1.0, 2.0, 3.0])]  # fmt: skip
    plate = quad([-2.2, -0.5, 1], [1.9, 0, 0], [0, 1, 0])
    n = 4 * N * t.effort
    for sky in (0.0, 0.5):
        hidden, wanted = shadowed(t, [*lamps, plate], 4 * N, sky)
        t.check(wanted == n, "wanted")
        count(t, hidden, n, at_origin(t, [*lamps, plate])[0], f"sky {sky}")


#: Three lamps as seen from the origin: corner and edges. Each emits in a channel of its own, with
#: radiance 3, 2 and 1; cells along either edge.
JOINT = [(np.array(c), np.array(a), np.array(b)) for c, a, b in (
    ([-3.0, -0.5, 2.0], [0, 1.0, 0], [2.0, 0, 0]), ([1.0, -0.5, 2.0], [0, 1.0, 0], [1.0, 0, 0]),
    ([-0.5, 1.0, 2.0], [0, 1.0, 0.3], [1.0, 0, 0]),
)]  # fmt: skip
CELLS = 16


def stripes(bit: int, across: bool) -> list[Part]:
    """Black plates in front of all cells along an edge of the lamps whose number has a bit set."""
    plates = []
    for corner, a, b in JOINT:
        side, other = (b, a) if across else (a, b)
        for k in range(1 << bit, CELLS, 2 << bit):
            at = corner + side * (k / CELLS)
            plates.append(quad(_scaled(at), _scaled(side * 2**bit / CELLS), _scaled(other)))
    return plates


def cells_seen(corner: Array, a: Array, b: Array) -> Array:
    """Solid angles of a rectangle's cells from the origin, (CELLS, CELLS), along a first."""
    (x0,), (y0,), (z,) = seen_rectangle(np.zeros(3), corner, a, b)
    x, y = (start + np.linalg.norm(e) * np.arange(CELLS + 1) / CELLS
            for start, e in ((x0, a), (y0, b)))  # fmt: skip
    return solid_angle(x[:-1, None], x[1:, None], y[:-1], y[1:], z)


@case(2, each={"tree": [False, True]}, quick=lambda tree: not tree)
def light_and_place_are_independent(t: Trial, tree: bool) -> None:
    """Which lamp is sampled, and where on it: one joint law.

    A pixel is a sample. Its channel identifies the lamp, and plates in front of half of the cells
    give the bits of the cell, in nine renders with one seed; roulette ends all paths at the floor.
    Chi-square of (lamp, u, v) over 3 x 16 x 16, 3 x 4 x 4 and 3 x 2 x 2 cells: the chances of
    `light_choice`, on each lamp by solid angle. 2.5 x 10^5 samples: sees 1.3 % between halves. In a
    tree, lamps are pairs of triangles.
    """
    side, seed = 500, t.fresh()
    once = Trial(t.device, seed, 1, t.threads)  # a larger film, not more samples of a pixel
    lamps = [quad(c, a, b, 0, np.eye(3)[k] * (3 - k)) for k, (c, a, b) in enumerate(JOINT)]
    floor = [quad([-2, -2, 0], [4, 0, 0], [0, 4, 0], 2.0**-24)]
    # beside every lamp something near, so that it is sampled by solid angle without plates too
    floor += [quad(_scaled(c - 0.2 * a), 0.01 * a, 0.01 * b) for c, a, b in JOINT]
    if tree:  # an edge too small for a scene without
        floor.append(quad([1.9, 1.9, -1], [1e-4, 0, 0], [0, 1e-4, 0]))
    view = camera([0.4, 0.6, 0.4], [0, 0, 0], 1e-4)

    def arrives(plates: list[Part]) -> Array:
        scene = make([*floor, *lamps, *plates], view, width=side, height=side * t.effort)
        return once.render(scene, 1, seed=seed, rr_depth=1).image > 0

    free = arrives([])
    t.check(free.any(axis=-1), "a sample of no lamp")
    t.check((free.sum(axis=-1) > 1).sum() <= 3, "samples of two lamps")  # survivors of roulette
    lamp, t.samples = free.argmax(axis=-1).ravel(), free[..., 0].size
    place = [sum((~arrives(stripes(bit, across)).any(axis=-1)).ravel().astype(np.int64) << bit
                 for bit in range(4)) for across in (False, True)]  # fmt: skip
    chance = chances(t, make([*floor, *lamps], view), np.zeros(3), np.array([0, 0, 1.0]))
    counts = np.zeros((3, CELLS, CELLS))
    np.add.at(counts, (lamp, *place), 1)
    share = np.array([cells_seen(*lamp) for lamp in JOINT])
    share *= (chance / share.sum(axis=(1, 2)))[:, None, None]
    for size in (16, 4, 2):
        cut = CELLS // size
        observed, expected = (x.reshape(3, size, cut, size, cut).sum(axis=(2, 4))
                              for x in (counts, share * counts.sum()))  # fmt: skip
        t.p(chi_square(observed, expected), f"{size} x {size} cells a lamp")
    t.figure("cells", {"observed": counts.reshape(3 * CELLS, CELLS),
                       "expected": (share * counts.sum()).reshape(3 * CELLS, CELLS)})  # fmt: skip
    t.sees(0.0063 / math.sqrt(counts.sum() / 1e6))


@case(2)
def choice_among_many_lights(t: Trial) -> None:
    """Of 100 lamps of radiance 1 to 100 one in turn emits upwards: it takes no light samples.

    All other samples request a shadow ray, exactly.
    """

    def lamp(k: int, up: bool) -> Part:
        corner, a, b = [k % 10 - 5, k // 10 - 5, 2], [0.5, 0, 0], [0, 0.5, 0]
        return quad(corner, a, b, 0, k + 1.0) if up else quad(corner, b, a, 0, k + 1.0)

    n = 50_000 * t.effort
    for turned in (0, 1, 2, 31, 50, 62, 63, 98, 99):
        _, wanted = shadowed(t, [lamp(k, k == turned) for k in range(100)], 50_000)
        t.check(wanted == n, f"lamp {turned}")


# ---- lights that are hit ----


#: Corner and edges of a rectangle near the origin.
NEAR = tuple(np.array(v) for v in ([-0.3, -0.2, 0.25], [0.0, 0.7, 0.2], [0.8, 0.0, 0.0]))


def _lit() -> dict[str, tuple[list[Part], float]]:
    """Lamps, the first of which is looked at, and the sky's radiance."""
    whole, _, _ = HIDERS["parallelogram u"]
    three, _, _ = HIDERS["triangle tip"]
    round_, _, _ = HIDERS["disk core"]
    ball = sphere([0, 0, 2.0], 1.0, 0, 1.0)
    other = quad([2, 2, 1], [0, 1, 0], [1, 0, 0], 0, 3.0)
    near = quad(*NEAR, 0, 1.0)
    far = quad([1.9, 1.9, 9], [1e-4, 0, 0], [0, 1e-4, 0])  # too small for a scene without a tree
    return {
        "rectangle": ([near], 0.0), "two rectangles": ([near, other], 0.0),
        "rectangle in a tree": ([near, far], 0.0), "parallelogram": ([whole], 0.0),
        "triangle": ([three], 0.0), "disk": ([round_], 0.0), "sphere": ([ball], 0.0),
        "two lamps": ([whole, other], 0.0), "sphere and lamp": ([ball, other], 0.0),
        "lamp and sky": ([whole], 0.5), "sky": ([], 0.5),
    }  # fmt: skip


LIT = _lit()


def _area(part: Part) -> float:
    if len(part.spheres):
        return 4 * math.pi * float(part.spheres[0, 3]) ** 2
    if len(part.disks):
        return math.pi * float(np.linalg.norm(np.cross(part.disks[0, 1], part.disks[0, 2])))
    v = part.vertices[part.faces]
    return float(np.linalg.norm(np.cross(v[:, 1] - v[:, 0], v[:, 2] - v[:, 0]), axis=1).sum() / 2)


@case(2, each={"name": LIT})
def density_when_hit(t: Trial, name: str) -> None:
    """A light that a direction meets is weighted with the density of its light samples.

    Whole paths, replayed on the CPU: emission found after a diffuse bounce carries the weight
    p^2 / (p^2 + q^2), p = cos / pi, q = chance distance^2 / (area cos), of a sphere and a near
    rectangle chance over its solid angle, with the chances of `light_choice`, of the sky 0; within
    1e-4 for all paths that meet the light.
    """
    lamps, sky = LIT[name]
    scene: Scene = make([FLOOR, *lamps], VIEW, sky, max_depth=2)
    lit = [part for part in lamps if part.emission.any()]
    rows = sorted(range(len(lit)), key=lambda k: len(lit[k].spheres))
    chance_of = dict.fromkeys(range(len(lit)), 1.0)
    if len(lit) > 1:
        at = chances(t, scene, np.zeros(3), np.array([0, 0, 1.0]))
        chance_of = {k: float(at[row]) for row, k in enumerate(rows)}
    emission = np.concatenate([scene.triangle_emission, scene.sphere_emission, scene.disk_emission])
    seen = 0
    for path in replayed(t, scene, 4_000, 2):
        first, last = path[0], path[-1]
        if len(path) < 2 or last["event"] not in ("emitter_end", "escaped"):
            continue
        d, far = np.array(last["direction"]), last["t"]
        p = d[2] / math.pi
        if last["event"] == "escaped":
            q, radiance = 0.0, sky
        else:
            k = int(emission[last["primitive"]])
            radiance = float(lamps[k].emission[0])
            chance = chance_of[k]
            if len(lamps[k].spheres):
                c, r = lamps[k].spheres[0, :3], lamps[k].spheres[0, 3]
                solid = 2 * math.pi * (1 - math.sqrt(1 - r**2 / (c @ c)))
                q = chance / solid
            elif "rectangle" in name and k == 0:
                corner, a, b = NEAR
                (x0,), (y0,), (z,) = seen_rectangle(np.zeros(3), corner, a, b)
                w, h = np.linalg.norm(a), np.linalg.norm(b)
                q = chance / float(solid_angle(x0, x0 + w, y0, y0 + h, z))
            else:
                cosine = -float(np.dot(last["normal"], d))
                q = chance * far**2 / (_area(lamps[k]) * cosine)
        got = (last["radiance"][0] - first["radiance"][0]) / last["throughput"][0]
        exact = radiance * p**2 / (p**2 + q**2)
        if radiance > 0:
            seen += 1
            t.check(abs(got - exact) <= 1e-4 * exact + 1e-6 * first["radiance"][0],
                    f"{got} for {exact}")  # fmt: skip
    t.check(seen > 100, f"only {seen} paths meet a light")
