"""Stress of glass, media and lights: gaps, loops, extreme indices and depths, odd lamps.

In every case no sample is non-finite and the ledger adds up, besides what the case states.
"""

from __future__ import annotations

import dataclasses
import math
from typing import Any

import numpy as np
import numpy.typing as npt
import trimesh
from scipy import stats

import veriray
from veriray.scene import MAX_PATH_DEPTH
from veriray_validate import dicts
from veriray_validate.form_factors import cap, lambert, perpendicular_rectangle
from veriray_validate.scenes import Part, box, camera, disk, make, quad, sphere
from veriray_validate.statistics import binomial, smallest_bias
from veriray_validate.transfer import chandrasekhar
from veriray_validate.trial import Trial, case

Array = npt.NDArray[Any]
BLACK, MIRROR, NULL = dicts.BLACK, dicts.MIRROR, dicts.NULL
LAMP_BELOW = dicts.flat("rectangle", [0, 0, -9], [0, 0, 1], 90, BLACK, [1, 2, 3])


# ---- nested and touching glass ----


def two_balls(gap: float, inner_first: bool, **settings: Any) -> veriray.Scene:
    """Glass of index 1.5, radius 1, in water of radius 1 + gap, in a sky of 1."""
    balls = (dicts.sphere([0.1, 0, 0], 1 + gap, dicts.glass(1.33)),
             dicts.sphere([0.1, 0, 0], 1, dicts.glass(1.5, 1.33)))  # fmt: skip
    eye = dicts.view([1, 2, 6], [0, 0, 0], 26, 8)
    return dicts.scene(eye, *(balls[::-1] if inner_first else balls), dicts.sky(1), **settings)


@case(8, each={"gap": [1e-2, 1e-4, 1e-5, 0.0, -1e-5, -1e-4, -1e-2], "inner_first": [False, True]})
def nested_glass(t: Trial, gap: float, inner_first: bool) -> None:
    """A ball of index 1.5 in one of 1.33 in a sky of 1, `gap` between them, or overlapping.

    Lossless: 1 at every pixel, even without a gap: every crossing meets the first of two surfaces
    in one place.
    """
    r = t.agrees(two_balls(gap, inner_first), 1.0, 10_000, 0.01, margin=2e-5)
    t.check(not any(r.stats["ledger"]["depth_cut"]), "paths are cut")


@case(8, each={"gap": [1e-6, 2.0**-23, -1e-6], "inner_first": [False, True]})
def glass_nearer_than_rounding(t: Trial, gap: float, inner_first: bool) -> None:
    """The same with a gap below 2^-21 of the camera's distance, too small for float32.

    A limit: a crossing may be lost in one direction. Finite, .5 to 1.5 at every pixel; where the
    balls overlap, one path in ten is trapped until max_depth ends it.
    """
    r = t.render(two_balls(gap, inner_first, max_depth=500), 1_000)
    t.check((r.image > 0.5) & (r.image < 1.5), f"{r.image.min()} to {r.image.max()}")
    cut = sum(r.stats["ledger"]["depth_cut"]) / (64 * r.spp)
    t.check(cut < (0.2 if gap < 0 else 1e-3), f"{cut:.1%} of the paths are cut")
    t.figure("mean", float(r.image.mean()))
    t.figure("share that is cut", cut)


@case(8, each={"gap": [1e-2, 1e-4, 1e-5]})
def two_glasses_side_by_side(t: Trial, gap: float) -> None:
    """Two cubes and two balls of glass, a thin gap of air between them, in a sky of 1.

    1 at every pixel: no crossing is lost.
    """
    bodies = [
        dicts.cuboid([-1, -1, -1], [0, 1, 1], dicts.glass(1.5)),
        dicts.cuboid([gap, -1, -1], [1, 1, 1], dicts.glass(1.4)),
        dicts.sphere([-0.5, 2, 0], 0.5, dicts.glass(1.5)),
        dicts.sphere([0.5 + gap, 2, 0], 0.5, dicts.glass(1.7)),
    ]
    eye = dicts.view([1, 3, 6], [0, 0.7, 0], 32, 8)
    t.agrees(dicts.scene(eye, *bodies, dicts.sky(1)), 1.0, 10_000, 0.01, margin=1e-4)


@case(8)
def wall_between_two_glasses(t: Trial) -> None:
    """Water on glass without a gap: one surface between them, index over index.

    A slab of 1.5 below a slab of 1.33: 1 in a sky of 1, and at normal incidence the stack's
    reflectance of a lamp above, all orders.
    """

    def layer(z: float, inside: float, outside: float) -> dict[str, Any]:
        return dicts.flat("rectangle", [0, 0, z], [0, 0, 1], 500, dicts.glass(inside, outside))

    stack = [layer(1, 1.33, 1.0), layer(0, 1.5, 1.33), layer(-1, 1.0, 1.5)]
    furnace = dicts.scene(dicts.view([1, 2, 5], [0, 0, 0], 50, 4), *stack, dicts.sky(1))
    t.agrees(furnace, 1.0, 5_000, 0.01, margin=1e-4)
    a, b, c = (((m - n) / (m + n)) ** 2 for m, n in ((1.0, 1.33), (1.33, 1.5), (1.5, 1.0)))
    two = b + (1 - b) ** 2 * c / (1 - b * c)
    r = a + (1 - a) ** 2 * two / (1 - a * two)
    above = dicts.flat("rectangle", [0, 0, 9], [0, 0, -1], 400, BLACK, 1)
    seen = dicts.scene(dicts.view([0, 0, 5], [0, 0, 0], 1e-3), *stack, above)
    t.agrees(seen, r, 1_000_000, 0.02)


# ---- loops ----


def in_a_glass_cube(depth: int) -> veriray.Scene:
    """A camera of 90 degrees in the middle of a cube of index 1.5, in a sky of 1."""
    eye = dicts.view([0, 0, 0], [0, 0, 1], 90, 8, up=[0, 1, 0])
    cube = dicts.cuboid([-1, -1, -1], [1, 1, 1], dicts.glass(1.5))
    return dicts.scene(eye, cube, dicts.sky(1), max_depth=depth)


@case(8, each={"cap": [1000, 4000]})
def total_reflection_in_a_cube(t: Trial, cap: int) -> None:
    """Light in a glass cube: some of it never leaves.

    If every direction cosine is below sqrt(1 - 1 / n^2): .371681 of a pyramid of 90 degrees. These
    paths, and no others, end in depth_cut at the cap (binomial); segments grow only with the cap.
    """
    n = 1.5
    radius2 = 1 / (1 - 1 / n**2) - 1
    trapped = 1 - math.pi * radius2 / 4
    t.check(abs(trapped - 0.371681) < 1e-6, "theory")
    r = t.render(in_a_glass_cube(cap), 64, rr_depth=10**6)
    ledger = r.stats["ledger"]
    paths = 64 * r.spp
    cut = sum(ledger["depth_cut"])
    t.p(binomial(cut, paths, trapped), "trapped")
    t.check(cut == ledger["depth_cut"][cap - 1], "cut before the cap")
    t.check(len(r.stats["live_rays"]) == cap, "cap")
    t.check(r.stats["live_rays"][cap // 2] - cut < 1e-3 * paths, "paths linger")


@case(8)
def total_reflection_without_a_cap(t: Trial) -> None:
    """The same with unlimited depth: it ends.

    At most MAX_PATH_DEPTH segments; the trapped paths are cut there or by roulette (their weight
    stays 1, so only the cap cuts them).
    """
    r = t.render(in_a_glass_cube(-1), 1, width=2, height=2)
    ledger = r.stats["ledger"]
    t.check(len(r.stats["live_rays"]) <= MAX_PATH_DEPTH, "cap")
    cut = sum(ledger["depth_cut"])
    t.check(sum(ledger["escaped"]) + cut == 4 * r.spp, "ends")
    t.check(cut == 0 or ledger["depth_cut"][MAX_PATH_DEPTH - 1] == cut, "cut before the cap")


@case(8, each={"room": ["box", "sphere"]})
def ten_thousand_bounces(t: Trial, room: str) -> None:
    """A closed mirror, 10,000 bounces.

    Every path lives for 10,000 segments and never sees the sky: exact in the sphere; a box loses
    what `LEAKS` allows at its edges. On a CPU, vertex by vertex, directions keep their length to
    1e-5 and positions stay in the room to 1e-5.
    """
    walls = (dicts.cuboid([-1, -1.1, -0.9], [1, 0.8, 1.2], MIRROR) if room == "box"
             else dicts.sphere([0, 0, 0], 1, MIRROR))  # fmt: skip
    eye = dicts.view([0.1, 0.2, 0.3], [0.7, -0.4, 0.9], 80, 4)
    room_ = {**walls, "flip_normals": True}
    closed = dicts.scene(eye, room_, dicts.sky(1), max_depth=10_000)
    r = t.render(closed, 4)
    live, escaped = r.stats["live_rays"], sum(r.stats["ledger"]["escaped"])
    t.check(len(live) == 10_000 and live[0] - live[-1] <= escaped, "paths end")
    t.sealed(r) if room == "box" else t.check(escaped == 0, "paths leave")
    t.check(escaped or not r.image.any(), "light comes in")
    if t.device.startswith("cpu"):
        path = veriray.trace_path(closed, 2, 1, 0)
        t.check(escaped or len(path) == 10_000, "the replayed path ends")
        lengths = np.linalg.norm([v["direction"] for v in path], axis=1)
        t.check(np.abs(lengths - 1).max() <= 1e-5, "a direction's length")
        positions = np.array([v["position"] for v in path])
        if room == "box":
            low, high = [-1.00001, -1.10001, -0.90001], [1.00001, 0.80001, 1.20001]
            t.check((positions > low) & (positions < high), "a vertex outside of the box")
        else:
            t.check(np.linalg.norm(positions, axis=1) < 1.00001, "a vertex outside of the ball")


# ---- indices ----


@case(8, each={"eta": [1.0, 1 + 1e-7, 1 - 1e-7, 1 - 1e-6, 1 + 1e-4]})
def glass_that_is_almost_air(t: Trial, eta: float) -> None:
    """Indices of 1, 1 +- 1e-7 and close to these: a lamp seen through a ball.

    Continuous: the mean within 1e-3 of the lamp itself. At the rim any glass reflects, which a
    pixel's mean may show: one path in 10^6 meets it at a cosine of 5e-4.
    """
    ball = dicts.sphere([0, 0, 0], 1, dicts.glass(eta))
    r = t.render(dicts.scene(dicts.view([0, 0.3, 5], [0, 0, 0], 20, 6), ball, LAMP_BELOW), 200)
    off = np.abs(r.image.astype(float).mean(axis=(0, 1)) / [1, 2, 3] - 1).max()
    t.check(off < 1e-3, f"off by {off:.2g}")


@case(8, each={"eta": [1.0, 1 + 1e-7, 1 - 1e-7, 1 + 1e-4], "kind": ["plastic", "thindielectric"]})
def coats_that_are_almost_air(t: Trial, eta: float, kind: str) -> None:
    """Plastic and a pane of index 1, 1 +- 1e-7 and 1 + 1e-4.

    Continuous: plastic is its base of .5 under a sky of 1, a pane shows the lamp; within 1e-3.
    """
    body = dicts.glass(eta, kind=kind)
    plate = dicts.flat("rectangle", [0, 0, 0], [0, 0, 1], 9, body)
    eye = dicts.view([0.5, 0.3, 5], [0, 0, 0], 10)
    if kind == "plastic":
        body["diffuse_reflectance"] = dicts.rgb(0.5)
        t.agrees(dicts.scene(eye, plate, dicts.sky(1)), 0.5, 100_000, 0.01, margin=1e-3)
    else:
        r = t.render(dicts.scene(eye, plate, LAMP_BELOW), 1000)
        off = np.abs(r.image / np.float32([1, 2, 3]) - 1).max()
        t.check(off < 1e-3, f"off by {off:.2g}")


@case(
    8,
    each={"inside": [10.0, 4.0, 1.0, 0.1], "outside": [0.1, 1.0, 4.0, 10.0]},
    quick=lambda inside, outside: (inside, outside) in ((10.0, 0.1), (0.1, 10.0), (4.0, 1.0)),
)
def extreme_index(t: Trial, inside: float, outside: float) -> None:
    """Indices of 1/100 to 100: a slab at normal incidence, a ball in a furnace.

    R = ((n - 1) / (n + 1))^2 per surface, 2 R / (1 + R) for the slab, sees 1 %; the furnace 1.
    """
    n = inside / outside
    r = ((n - 1) / (n + 1)) ** 2
    front = dicts.flat("rectangle", [0, 0, 9], [0, 0, -1], 40, BLACK, [1, 0, 1])
    back = dicts.flat("rectangle", [0, 0, -9], [0, 0, 1], 40, BLACK, [0, 1, 1])
    slab = dicts.cuboid([-50, -50, -1], [50, 50, 0], dicts.glass(inside, outside))
    seen = dicts.scene(dicts.view([0, 0, 5], [0, 0, 0], 1e-3), slab, front, back)
    t.agrees(seen, [2 * r / (1 + r), (1 - r) / (1 + r), 1], 400_000, 0.02)
    ball = dicts.sphere([0, 0, 0], 1, dicts.glass(inside, outside))
    furnace = dicts.scene(dicts.view([1, 2, 5], [0, 0, 0], 25, 4), ball, dicts.sky(1))
    got = t.render(furnace, 500)
    t.check(abs(got.image.mean() - 1) < 1e-4 + 5 * got.stderr.max(), "the furnace is not 1")


# ---- deep, black and white media ----


@case(8, each={"albedo": [0.9999, 0.99999]}, quick=lambda albedo: albedo == 0.9999)
def deep_and_almost_white(t: Trial, albedo: float) -> None:
    """A half space of optical depth 1e4, a thousand scatterings and more.

    1 - H(1) sqrt(1 - w) (S. Chandrasekhar, 1950), sees 1.5 %; paths cut at MAX_PATH_DEPTH are
    counted: none at an albedo of .9999, below 1 in 1,000 at .99999.
    """
    w = float(np.float32(albedo))
    exact = 1 - chandrasekhar(w, [1.0])[0] * math.sqrt(1 - w)
    fog = dicts.medium(1.0, w)
    ground = dicts.cuboid([-1e4, -1e4, -1e4], [1e4, 1e4, 0], NULL, interior=fog)
    seen = dicts.scene(dicts.view([0, 0, 5], [0, 0, 0]), ground, dicts.sky(1))
    r = t.agrees(seen, exact, 40_000 if albedo < 0.99995 else 30_000, 0.015, margin=1e-4)
    cut = sum(r.stats["ledger"]["depth_cut"])
    t.check(len(r.stats["live_rays"]) > 1000, "no long path")
    t.check(cut <= (0 if albedo < 0.99995 else 1e-3 * r.spp), f"{cut} paths are cut")
    t.figure("longest path", len(r.stats["live_rays"]))


@case(8, each={"tau": [1e4, 1e6]})
def ink(t: Trial, tau: float) -> None:
    """Optical depths of 1e4 and 1e6 without scattering.

    A lamp and a point light behind it are exactly 0; a path takes two segments at any depth.
    """
    slab = dicts.cuboid([-9, -9, 0], [9, 9, 1], NULL, interior=dicts.medium(tau, 0.0))
    below = dicts.flat("rectangle", [0, 0, -1], [0, 0, 1], 9, dicts.diffuse(0.5), 1)
    light = {"type": "point", "position": np.array([0, 0, 2.0]), "intensity": dicts.rgb(1e6)}
    for eye in (dicts.view([0, 0, 5], [0, 0, 0]), dicts.view([0, 0, 5], [0, 0, 0], 60, 4)):
        r = t.render(dicts.scene(eye, slab, below), 10_000)
        t.check(not r.image.any(), "a lamp shines through")
        t.check(len(r.stats["live_rays"]) <= 3, f"{len(r.stats['live_rays'])} segments")
    floor = dicts.flat("rectangle", [0, 0, -1], [0, 0, 1], 9, dicts.diffuse(0.5))
    seen = dicts.scene(dicts.view([0, 3, -0.5], [0, 0, -1]), slab, floor, light)
    t.check(not t.render(seen, 10_000).image.any(), "a point light shines through")


@case(8, each={"tau": [300.0, 1e6]})
def lossless_slab_adds_up(t: Trial, tau: float) -> None:
    """Optical depths of 300 and 1e6, albedo 1, in a sky of 1.

    R + T + depth_cut = 1 in counts: every path leaves above, below or is cut, none is lost
    (exact); 1 less what is cut, within 5 errors.
    """
    slab = dicts.cuboid([-1e3, -1e3, 0], [1e3, 1e3, 3], NULL,
                        interior=dicts.medium(tau / 3, 1.0))  # fmt: skip
    seen = dicts.scene(dicts.view([0, 0, 5], [0, 0, 0]), slab, dicts.sky(1))
    r = t.render(seen, 2000)
    ledger = r.stats["ledger"]
    cut = sum(ledger["depth_cut"])
    t.check(sum(ledger["escaped"]) + cut == r.spp, "paths are lost")
    t.check(not any(ledger["rr_killed"]) and not any(ledger["absorbed"]), "paths die")
    off = abs(r.image.mean() - 1)
    t.check(off < 1e-5 + 5 * r.stderr.max() + cut / r.spp, f"off by {off:.2g}")
    t.check(len(r.stats["live_rays"]) <= MAX_PATH_DEPTH, "cap")


@case(8, each={"g": [0.999, -0.999, 0.9999, -0.9999, 0.999999]})
def extreme_phase_functions(t: Trial, g: float) -> None:
    """Scattering almost straight on or straight back, in a lossless ball in a sky of 1.

    1; sees 1 %.
    """
    ball = dicts.sphere([0, 0, 0], 1, NULL, interior=dicts.medium(5.0, 1.0, g))
    eye = dicts.view([1, 2, 5], [0, 0, 0], 25, 4)
    t.agrees(dicts.scene(eye, ball, dicts.sky(1)), 1.0, 20_000, 0.01)


@case(8)
def phase_function_about_isotropic(t: Trial) -> None:
    """Henyey and Greenstein's density at g = 0, 1e-8 ... 1e-3 of both signs.

    Continuous: 1 / (4 pi) within 4 |g|, and its samples unit vectors within 1e-6.
    """
    n = 1000
    d, w = (v / np.linalg.norm(v, axis=1)[:, None] for v in t.rng.normal(size=(2, n, 3)))
    columns = [*d.T, *w.T]
    u, v = t.rng.random((2, n))
    for g in (0.0, *(s * 10.0**-k for k in range(3, 9) for s in (1, -1))):
        value = t.function("henyey_greenstein_pdf", *columns, g)[:, 0] * 4 * math.pi
        t.check(np.abs(value - 1).max() < 4 * abs(g) + 1e-6, f"density at g = {g:g}")
        out = t.function("henyey_greenstein", *d.T, g, u, v)
        t.check(np.abs(np.linalg.norm(out[:, :3], axis=1) - 1).max() < 1e-6, f"sample at g = {g:g}")


@case(8)
def extinction_of_every_size(t: Trial) -> None:
    """A lamp behind a slab of extinctions 0, 1 and 1e6, and 1e-30, 1e-6, 1e-3.

    e^-tau by channel: 1, 1 / e and exactly 0; 1 within 1e-6, 1 - 1e-6, 1 - 1e-3.
    """
    lamp = dicts.flat("rectangle", [0, 0, -1], [0, 0, 1], 9, BLACK, 1)
    for sigma in ([0.0, 1.0, 1e6], [1e-30, 1e-6, 1e-3], [0.0, 0.0, 0.0]):
        slab = dicts.cuboid([-9, -9, 0], [9, 9, 1], NULL, interior=dicts.medium(sigma, 0.0))
        seen = dicts.scene(dicts.view([0, 0, 5], [0, 0, 0]), slab, lamp)
        r = t.render(seen, 100_000)
        exact = np.exp(-np.array(sigma))
        off = np.abs(r.image[0, 0] - exact)
        t.check(off <= 5 * r.stderr[0, 0] + 2e-6, f"{r.image[0, 0]} for {exact}")
        t.check(r.image[0, 0][exact < 1e-30] == 0, "the darkest channel")


@case(8, each={"sigma": [0.3, 1.0]})
def near_clip_in_a_medium(t: Trial, sigma: float) -> None:
    """A camera in ink, its near plane at distance 2, a lamp at distance 5.

    A path begins at the near plane: e^(-3 sigma), whether or not the plane cuts a surface; sees
    2 %.
    """
    ink = dicts.medium(sigma, 0.0)
    lamp = dicts.flat("rectangle", [0, 0, 0], [0, 0, 1], 1, BLACK, 1)
    before = dicts.sphere([0, 0, 4.5], 0.3, BLACK)  # cut away
    eye = dicts.view([0, 0, 5], [0, 0, 0], near_clip=2.0, medium=ink)
    for more in ([before], []):
        t.agrees(dicts.scene(eye, lamp, *more), math.exp(-3 * sigma), 1_200_000, 0.02)


# ---- lamps and cameras in glass and media ----


@case(8, each={"gap": [0.5, 1e-3, 1e-5]})
def lamp_in_glass(t: Trial, gap: float) -> None:
    """An emitting ball in a ball of glass, its surface `gap` below that of the glass.

    Seen along the axis (1 - F) L / n^2, F = .04: .426667; sees 1 %. In a sky of 1 with L = n^2,
    in equilibrium: 1 at every pixel.
    """
    n = 1.5
    shell = dicts.sphere([0, 0, 0], 1, dicts.glass(n))
    for radiance, sky, eye, exact in (
        (1.0, [], dicts.view([0, 0, 5], [0, 0, 0], 1e-3), 0.96 / n**2),
        (n * n, [dicts.sky(1)], dicts.view([1, 2, 5], [0, 0, 0], 30, 6), 1.0),
    ):
        core = dicts.sphere([0, 0, 0], 1 - gap, BLACK, radiance)
        t.agrees(dicts.scene(eye, shell, core, *sky), exact, 100_000, 0.01, margin=2e-5)


@case(8, each={"gap": [0.5, 1e-3, 1e-5]})
def lamp_in_a_medium(t: Trial, gap: float) -> None:
    """An emitting ball in a ball of ink (sigma 2), and in lossless fog in an equally bright sky.

    e^(-2 gap) along the axis, sees 1 %; 1 at every pixel of the fog.
    """
    for albedo, sky, eye, exact, spp in (
        (0.0, [], dicts.view([0, 0, 5], [0, 0, 0], 1e-3), math.exp(-2 * gap), 400_000),
        (1.0, [dicts.sky(1)], dicts.view([1, 2, 5], [0, 0, 0], 30, 4), 1.0, 40_000),
    ):
        fog = dicts.medium(2.0, albedo)
        shell = dicts.sphere([0, 0, 0], 1, NULL, interior=fog)
        core = dicts.sphere([0, 0, 0], 1 - gap, BLACK, 1)
        t.agrees(dicts.scene(eye, shell, core, *sky), exact, spp, 0.01, margin=5e-5)


@case(8, each={"material": ["glass", "null", "glass and fog"], "depth": [1.0, 1e-3, 1e-6]})
def camera_within(t: Trial, material: str, depth: float) -> None:
    """A camera in a ball of glass, of fog, of glass filled with fog, `depth` below its surface.

    In a sky of 1, looking through the middle and straight out: n^2, 1 and n^2 at every pixel; sees
    1 %. The camera's medium is declared, not guessed.
    """
    n = 1.33
    fog = dicts.medium(1.5, 1.0, 0.4) if material != "glass" else None
    bsdf = NULL if material == "null" else dicts.glass(n)
    inside = {} if fog is None else {"interior": fog}
    around = {} if fog is None else {"medium": fog}
    ball = dicts.sphere([0, 0, 0], 1, bsdf, **inside)
    exact = 1.0 if material == "null" else n * n
    for target in ([0, 0.1, 2], [0, 0.1, -1]):
        eye = dicts.view([0, 0, 1 - depth], target, 40, 4, **around)
        t.agrees(dicts.scene(eye, ball, dicts.sky(1)), exact, 10_000, 0.01, margin=2e-5)


# ---- lamps in odd places ----


@case(8)
def lamps_that_touch_and_cut_the_floor(t: Trial) -> None:
    """An emitting ball on the floor, seen near the contact; half sunk; and around the point.

    The irradiance of its cone above the horizon; sees 2 %. From within it is dark.
    """
    floor = dicts.flat("rectangle", [0, 0, 0], [0, 0, 1], 3, dicts.diffuse(0.5))
    for height, x in ((1.0, 1.0), (1.0, 0.05), (0.3, 2.0), (-0.5, 1.2)):
        lamp = dicts.sphere([x, 0, height], 1, BLACK, 1)
        d = math.hypot(x, height)
        exact = 0.5 * cap(math.acos(height / d), math.asin(1 / d)) / math.pi
        low = dicts.view([-0.3 * x, 0.001, 0.01 * x], [0, 0, 0], 1e-3)
        t.agrees(dicts.scene(low, floor, lamp), exact, 400_000, 0.02, margin=1e-4)
    inside = dicts.sphere([0, 0, 0.5], 1, BLACK, 1)  # around the point: its back is dark
    t.agrees(dicts.scene(dicts.view([-0.3, 0, 0.1], [0, 0, 0]), floor, inside), 0.0, 1000, 1.0)


@case(8, each={"away": [1.0, 1e-2, 1e-4, 1e-5]})
def lamp_that_stands_on_the_floor(t: Trial, away: float) -> None:
    """An upright lamp 2 x 1 whose edge lies on the floor, at a distance of `away` from it.

    rho F of a perpendicular rectangle (J. R. Howell B-4), towards rho / 2 at the edge; sees 2 %.
    """
    floor = quad([-5, -5, 0], [10, 0, 0], [0, 10, 0], 0.5)
    lamp = quad([away, -1, 0], [0, 0, 1], [0, 2, 0], 0, 1)
    exact = 0.5 * 2 * perpendicular_rectangle(1.0, 1.0, away)
    eye = camera([-0.5 * away, 1e-3 * away, 0.3 * away], [0, 0, 0], 1e-3)
    t.agrees(make([floor, lamp], eye), exact, 400_000, 0.02, margin=1e-3 if away < 1e-3 else 1e-4)


@case(8, each={"away": [0.3, 8.0]})
def lamp_of_two_triangles(t: Trial, away: float) -> None:
    """The same lamp in a scene with a tree, where it is two triangles, nearby and far away.

    rho F; from far away the rectangle is sampled by area. Sees 1 %.
    """
    floor = quad([-20, -20, 0], [40, 0, 0], [0, 40, 0], 0.5)
    lamp = quad([away, -1, 0], [0, 0, 1], [0, 2, 0], 0, 1)
    speck = quad([-19, 0, 9], [1e-4, 0, 0], [0, 1e-4, 0])  # too small for a scene without a tree
    exact = 0.5 * 2 * perpendicular_rectangle(1.0, 1.0, away)
    eye = camera([-0.5 * away, 1e-3 * away, 0.3 * away], [0, 0, 0], 1e-3)
    t.agrees(make([floor, lamp, speck], eye), exact, 400_000, 0.01)


@case(8, each={"kind": ["quad", "triangle", "disk", "sphere"], "size": [1e-6, 1e-4]})
def tiny_lamps(t: Trial, kind: str, size: float) -> None:
    """Lamps 1e-6 and 1e-4 wide at distance 1, with radiances that give the same light.

    rho / pi L A cos / d^2 = rho / pi, almost without noise, within 2e-4. A limit: corners are
    rounded to 1e-7 of the camera's distance, so flat lamps are off by 1.2e-7 / size (12 %).
    """
    area = {"quad": size**2, "triangle": size**2 / 2, "disk": math.pi * size**2,
            "sphere": math.pi * size**2}[kind]  # fmt: skip
    angle = 30.0
    at = dicts.direction(angle)
    cosine = math.cos(math.radians(angle))
    floor = dicts.flat("rectangle", [0, 0, 0], [0, 0, 1], 3, dicts.diffuse(0.5))
    # All but the ball face the floor, along -z: a second cosine.
    radiance = 1 / (area * cosine * (1 if kind == "sphere" else cosine))
    if kind == "sphere":
        lamp: Any = dicts.sphere(at.tolist(), size, BLACK, radiance)
    elif kind == "disk":
        lamp = dicts.flat("disk", at.tolist(), [0, 0, -1], size, BLACK, radiance)
    else:
        lamp = dicts.flat("rectangle", at.tolist(), [0, 0, -1], size / 2, BLACK, radiance)
    seen = dicts.scene(dicts.view([-1, 0.1, 1], [0, 0, 0]), floor, lamp, max_depth=2)
    if kind == "triangle":
        seen = dataclasses.replace(
            seen, triangles=seen.triangles[:-1], triangle_material=seen.triangle_material[:-1],
            triangle_emission=seen.triangle_emission[:-1],
            triangle_boundary=seen.triangle_boundary[:-1],
            triangle_shape=seen.triangle_shape[:-1],
        )  # fmt: skip
    margin = max(2e-4, 1.2e-7 / size) if kind in ("quad", "triangle") else 2e-4
    # Errors so far below what shines are upper bounds.
    spp, sees = (20_000, 1e-3) if size > 1e-5 else (400_000, 2e-2)
    t.agrees(seen, 0.5 / math.pi, spp, margin + sees, margin=margin)


CEILING = [([-3, -3], [3, -1]), ([-3, 1], [3, 3]), ([-3, -1], [-1, 1]), ([1, -1], [3, 1])]


@case(8, each={"ceiling": ["with a hole", "1e-5 above", "behind it, the lamp first",
                           "before it in number"]})  # fmt: skip
def lamp_in_the_ceiling(t: Trial, ceiling: str) -> None:
    """A lamp 2 x 2 in the plane of a black ceiling at height 1.

    If the ceiling has an opening, lies 1e-5 above, or comes after the lamp in number: rho F, sees
    1 %, and the lamp is visible. If it comes first in number, it hides the lamp from view, but its
    light samples remain: between 0 and rho F.
    """
    floor = quad([-5, -5, 0], [10, 0, 0], [0, 10, 0], 0.5)
    lamp = quad([-1, -1, 1], [0, 2, 0], [2, 0, 0], 0, 1)

    def sheet(low: Any, high: Any, z: float) -> Any:
        return quad([*low, z], [0, high[1] - low[1], 0], [high[0] - low[0], 0, 0])

    if ceiling == "with a hole":
        parts = [floor, *(sheet(low, high, 1.0) for low, high in CEILING), lamp]
    elif ceiling == "1e-5 above":
        parts = [floor, sheet([-3, -3], [3, 3], 1 + 1e-5), lamp]
    elif ceiling == "behind it, the lamp first":
        parts = [lamp, floor, sheet([-3, -3], [3, 3], 1.0)]
    else:
        parts = [sheet([-3, -3], [3, 3], 1.0), floor, lamp]
    corners = [[-1, -1, 1], [1, -1, 1], [1, 1, 1], [-1, 1, 1]]
    exact = 0.5 * lambert([0, 0, 0], [0, 0, 1], corners)
    scene = make(parts, camera([1.5, 1.2, 0.5], [0, 0, 0]))
    up = t.render(make(parts, camera([0.3, 0.2, 0.1], [0.4, 0.3, 1])), 16)
    hidden = ceiling == "before it in number"
    t.check(up.image == (0 if hidden else 1), f"the lamp is {up.image.ravel()}")
    if hidden:
        r = t.render(scene, 100_000)
        t.figure("share of the light", float(r.image.mean() / exact))
        t.check((r.image >= 0) & (r.image < exact + 5 * r.stderr), "more light than the lamp's")
    else:
        t.agrees(scene, exact, 400_000, 0.01, margin=3e-5)


def near_lamps() -> dict[str, list[Part]]:
    """Lamps of radiance 1 at the origin of a floor: they touch it, cut it, contain the origin."""
    solid = trimesh.creation.icosphere(2)
    room = box([-0.5, -0.6, -0.4], [0.7, 0.5, 0.8], True, 0, 1)
    return {
        "ball that touches": [sphere([0.05, 0, 1], 1, 0, 1)],
        "ball that cuts": [sphere([1.01, 0, 0.1], 1, 0, 1)],
        "ball around": [sphere([0.1, 0, 0.3], 1, 0, 1, True)],
        "quad that cuts": [quad([0.01, -1, -1], [0, 0, 2], [0, 2, 0], 0, 1)],
        "quad through the point": [quad([0, -1, -1], [0, 0, 2], [1, 2, 0], 0, 1)],
        "triangle that touches": [
            Part([[0.001, 0, 0], [0.3, -1, 1], [0.3, 1, 1]], [[0, 1, 2]], 0, 1)
        ],
        "disk that cuts": [disk([0.01, 0, 0], [0, 0, 1], [0, 1, 0], 0, 1)],
        "mesh that cuts": [Part(solid.vertices + [1.01, 0, 0.1], solid.faces, 0, 1)],
        "box around": [room],
    }


@case(8, each={"lamp": near_lamps()})
def lamps_in_odd_places_without_light_samples(t: Trial, lamp: str) -> None:
    """Lamps that touch, cut or contain the point: light samples change nothing.

    A lamp in a black box, a billion times as strong, takes all light samples and gives no light.
    Only sampled directions then find the other lamps, and the picture has the same mean as without
    it: z test of both renders; sees 2 %.
    """
    parts = [quad([-3, -3, 0], [6, 0, 0], [0, 6, 0], 0.5), *near_lamps()[lamp]]
    decoy = [
        quad([-0.5, -0.5, 6], [0, 1, 0], [1, 0, 0], 0, 1e9), box([-1, -1, 5], [1, 1, 7], False, 0),
    ]  # fmt: skip
    eye = camera([-0.3, 0.02, 0.01], [0, 0, 0])
    a, b = (t.render(make(p, eye, max_depth=2), 400_000) for p in (parts, [*parts, *decoy]))
    t.check(b.stats["ledger"]["shadow_visible"][0] < 1e-3 * b.spp, "light is sampled")
    error = math.hypot(float(a.stderr[0, 0, 0]), float(b.stderr[0, 0, 0]))
    mean, other = float(a.image[0, 0, 0]), float(b.image[0, 0, 0])
    t.check(mean > 0, "the lamp gives no light")
    t.p(2 * float(stats.norm.sf(abs(mean - other) / max(error, 1e-6 * mean))), "light samples")
    t.sees(smallest_bias(error, mean), 0.025)
