"""Random scenes of everyday sizes: lamps, grounds, fogs and cameras, decades apart in size.

The generators take a random number generator and give a `Question`; `SCALES` names them all.
"""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Callable, Sequence
from typing import Any

import numpy as np
import numpy.typing as npt
from trimesh.transformations import random_rotation_matrix

from veriray.scene import Scene
from veriray_validate.everyday import LOSSY, Question, a_gap, decades, gridded, moved
from veriray_validate.form_factors import rectangle_above_corner
from veriray_validate.scenes import (
    MIRROR,
    NULL,
    Medium,
    Part,
    box,
    camera,
    directional_light,
    disk,
    make,
    point_light,
    quad,
    sphere,
    spot_light,
)
from veriray_validate.transfer import chandrasekhar

Array = npt.NDArray[Any]
Generator = Callable[[np.random.Generator], Question]
FAR = 5.0  # decades from a lamp's height, a fog, a body to eyes, grounds and hidden things
EYE = 5.0  # the same of the eye alone, where a place that it sees lies close to a lamp
REACH = 1e9  # free paths between an eye and a fog


def chosen(rng: np.random.Generator, values: Sequence[Any]) -> Any:
    """A random one of them."""
    return values[int(rng.integers(len(values)))]


def square(half: float, z: float = 0.0, **more: Any) -> Part:
    """A square across z, its front above."""
    return quad([-half, -half, z], [2 * half, 0, 0], [0, 2 * half, 0], **more)


def framed(w: float, distance: float, size: int = 16, tilt: float = 0.0) -> Any:
    """A camera above the origin that sees the square of half width w around it."""
    eye = distance * np.array([math.sin(tilt), 0, math.cos(tilt)])
    up = [0, 1, 0]
    return camera(eye, [0, 0, 0], 2 * math.degrees(math.atan(w / distance)), up)


def hidden(rng: np.random.Generator, most: float = FAR) -> tuple[str, list[Part]]:
    """Black things below the plane z = 0, or none: they reflect no light and hide none."""
    kind = chosen(rng, ("nothing", "speck", "ball", "planet", "plain"))
    far = decades(rng, 1, 2.4 if rng.random() < 0.5 else most)
    at = rng.normal(size=3)
    at = far * at / np.linalg.norm(at)
    at[2] = -abs(at[2]) - 1
    return f"{kind} {far:g} away", {
        "nothing": [],
        "speck": [quad([0, 0, -far], [1e-4, 0, 0], [0, 1e-4, 0])],
        "ball": [sphere(at, 0.1)],
        "planet": [sphere([0, 0, -far - 0.5], far)],
        "plain": [square(far, -1.0)],
    }[kind]


# ---- closed forms ----


def foot_of_a_lamp(rng: np.random.Generator) -> Question:
    """The ground below a lamp at height 1: point, sphere, disk, square.

    I / h^2; pi L (R / h)^2; pi L a^2 / (a^2 + h^2); Lambert's rectangle. The patch is at most 5e-3
    wide, where all of these are within 1e-4 of the value at the foot. A planet's radius in float32
    moves its top by a few 2^-24 of the radius, so the margin is 5e-7 of it.
    """
    kind = chosen(rng, ("point", "sphere", "inward sphere", "disk", "square"))
    low = kind in ("disk", "square")
    size = decades(rng, -4, 2) if low else decades(rng, -4, -0.02)
    wide = low and size > 0.2 or not low and size > 0.25
    tilt = float(rng.uniform(0.3, 0.9))
    eye = decades(rng, -1.5, -0.5 if wide else EYE)
    if wide and not low:
        eye = min(eye, 0.9 * (1 - size))  # below the lamp
    ground, half = chosen(rng, ("square", "disk", "planet")), decades(rng, -1, FAR)
    what, more = hidden(rng)
    if ground == "planet":
        half, what, more = min(max(half, 10), 1e4), "nothing", []
    floor = {
        "square": lambda: square(half, reflectance=0.5),
        "disk": lambda: disk([0, 0, 0], [half, 0, 0], [0, half, 0], 0.5),
        "planet": lambda: sphere([0, 0, -half], half, 0.5),
    }[ground]()
    lights, lamps, truth = [], [], 0.5
    if kind == "point":
        lights = [point_light([0, 0, 1], math.pi)]
    elif kind == "sphere":
        lamps = [sphere([0, 0, 1], size, 0, size**-2)]
    elif kind == "inward sphere":  # shines through itself
        lamps = [sphere([0, 0, 1], size, 0, size**-2, True, material=NULL)]
    elif kind == "disk":
        lamps = [disk([0, 0, 1], [0, size, 0], [size, 0, 0], 0, 1 + size**-2)]
    else:
        share = 4 * rectangle_above_corner(size, size)
        lamps = [quad([-size, -size, 1], [0, 2 * size, 0], [2 * size, 0, 0], 0, 1 / share)]
    view = framed(1e-3, eye, tilt=tilt)
    seen = make([floor, *lamps, *more], view, lights=lights, width=4, height=4, max_depth=2)
    drawn = f"{kind} {size:g} above {ground} {half:g}, eye {eye:g} away at {tilt:.3f}, {what}"
    margin = 1e-3 + (5e-7 * half if ground == "planet" else 0)
    return Question(drawn, seen, truth, margin, margin, spp=1024)


def lamp_over_a_world(rng: np.random.Generator) -> Question:
    """A lamp's foot as above, on a ground half a unit over a ball up to 1e7 times as large as high.

    The lamp is closer to the ground than the rounding of the world's far side.
    """
    size, half, radius = decades(rng, -3, -1), decades(rng, 0.5, 3), decades(rng, 3, 7)
    # corners are rounded by 2^-24 of their distance from the eye
    tilt, eye = float(rng.uniform(0.3, 0.9)), decades(rng, -0.5, math.log10(2e3 * size))
    kind, ground = chosen(rng, ("disk", "square")), chosen(rng, ("disk", "square"))
    floor = square(half, reflectance=0.5)
    if ground == "disk":
        floor = disk([0, 0, 0], [half, 0, 0], [0, half, 0], 0.5)
    lamp = disk([0, 0, 1], [0, size, 0], [size, 0, 0], 0, 1 + size**-2)
    if kind == "square":
        share = 4 * rectangle_above_corner(size, size)
        lamp = quad([-size, -size, 1], [0, 2 * size, 0], [2 * size, 0, 0], 0, 1 / share)
    world = sphere([0, 0, -radius - 0.5], radius, 0.5)
    seen = make([floor, lamp, world], framed(1e-3, eye, tilt=tilt), width=4, height=4, max_depth=2)
    drawn = f"{kind} {size:g} above {ground} {half:g}, eye {eye:g} away, ball {radius:g}"
    return Question(drawn, seen, 0.5, 1e-3, 1e-3, spp=1024)


def sun(rng: np.random.Generator) -> Question:
    """The ground near a small box, in the light of a ball 10 to 1e8 away: L sin^2(a) cos(t).

    Its angular radius a is 0.1 to 5 degrees, its height over the horizon more than that.
    """
    far, radius = decades(rng, 1, 8), math.radians(decades(rng, -1, 0.7))
    zenith, azimuth = float(rng.uniform(0, 1.2)), float(rng.uniform(0, 2 * math.pi))
    to = np.array([math.sin(zenith) * math.cos(azimuth), math.sin(zenith) * math.sin(azimuth),
                   math.cos(zenith)])  # fmt: skip
    half, eye = decades(rng, 0.5, 3), min(decades(rng, 0, 2), far / 2)
    ball = sphere(far * to, far * math.sin(radius), 0, math.sin(radius) ** -2)
    aside = -3 * np.array([math.cos(azimuth), math.sin(azimuth), 0])
    thing = box(aside, aside + 0.02, False, 0.5)
    turn = random_rotation_matrix(rng.random(3)) if rng.random() < 0.5 else np.eye(4)
    parts = [square(half, reflectance=0.5), ball, thing]
    moved(parts, turn)
    ball.spheres[:, :3] = ball.spheres[:, :3] @ turn[:3, :3].T
    w = 0.05
    view = camera(turn[:3, 2] * eye, [0, 0, 0], 2 * math.degrees(math.atan(w / eye)), turn[:3, 1])
    seen = make(parts, view, width=16, height=16, max_depth=2)
    drawn = (f"sun {far:g} away of {math.degrees(radius):g} degrees, {zenith:.3f} from the zenith, "
             f"ground {half:g}, eye {eye:g}")  # fmt: skip
    return Question(drawn, seen, 0.5 * math.cos(zenith), 1e-3, None, spp=64, ends=False)


def lamp_by_a_wall(rng: np.random.Generator) -> Question:
    """A point lamp at distance d in front of a wall, seen head-on.

    The mean over a square of half width w is I rho / pi times its solid angle from the lamp,
    4 atan(w^2 / (d sqrt(2 w^2 + d^2))), over 4 w^2. A position in a scene of size 1 is known to
    2^-23, which changes 1 / d^2 by 2.4e-7 / d.
    """
    d = decades(rng, -5, -0.5)
    w = float(f"{d * 10 ** rng.uniform(-1, 0.9):.3g}")
    eye = float(f"{w * 10 ** rng.uniform(0.3, 4):.3g}")
    half = max(1.0, 2 * w)
    what, more = hidden(rng)
    angle = 4 * math.atan(w * w / (d * math.sqrt(2 * w * w + d * d)))
    seen = make([square(half, reflectance=0.5), *more], framed(w, eye), width=16, height=16,
                lights=[point_light([0, 0, d], d * d)], max_depth=2)  # fmt: skip
    truth = 0.5 / math.pi * d * d * angle / (4 * w * w)
    return Question(f"lamp {d:g} before a wall, {w:g} wide from {eye:g}, {what}", seen, truth,
                    1e-3 + 2.4e-7 / d, None, spp=256)  # fmt: skip


def spot(rng: np.random.Generator) -> Question:
    """All light of a spot 5 away, of cutoff 0.003 to 50 degrees, its beam three quarters of that.

    The falloff between beam and cutoff is linear in the angle; quadrature over the plane.
    """
    cut, reach = decades(rng, -2.5, 1.7), 5.0
    top = math.radians(cut)
    w = 2 * reach * math.tan(top) if cut < 20 else 1.1 * reach * math.tan(top)
    theta = (np.arange(20_000) + 0.5) / 20_000 * top
    fall = np.clip((top - theta) / (top / 4), 0, 1) * np.cos(theta) ** 3 / np.cos(theta) ** 2
    # E r dr with E = I fall cos^3 / D^2, r = D tan: I fall tan cos dtheta
    light = 2 * math.pi * float(np.sum(fall * np.tan(theta))) * top / 20_000
    turn = random_rotation_matrix(rng.random(3))
    wall = square(2 * w, reflectance=1.0)
    moved([wall], turn)
    eye = turn[:3, :3] @ [0, 0, 2 * w + 0.5]
    view = camera(eye, [0, 0, 0], 2 * math.degrees(math.atan(w / (2 * w + 0.5))),
                  turn[:3, :3] @ [0, 1, 0])  # fmt: skip
    axis = turn[:3, 2]
    lamp = spot_light(reach * axis, -axis, math.pi, cut, 0.75 * cut)
    seen = make([wall], view, lights=[lamp], width=16, height=16, max_depth=2)
    return Question(f"spot of {cut:g} degrees along {axis.round(3)}", seen, light / (4 * w * w),
                    1e-3, None, spp=256)  # fmt: skip


def field_of_view(rng: np.random.Generator) -> Question:
    """An emitting square in the middle of the picture: its share of it, by wide and long lenses.

    Half of the lenses are so long that float32 directions do not resolve pixels. The margin is a
    hundredth of a pixel at each edge, two of these long ones: in a scene 10^7 times as large as the
    distance of what they show, 0.012 were measured.
    """
    long = rng.random() < 0.5
    angle, distance = decades(rng, -4, -3.2 if long else 2.2), decades(rng, -4, 5)
    share = float(rng.uniform(0.1, 0.9))
    half = share * distance * math.tan(math.radians(angle / 2))
    target = square(half, emission=1.0)
    turn = random_rotation_matrix(rng.random(3))
    what, more = hidden(rng, 4)
    moved([target, *(p for p in more if len(p.faces))], turn)
    for p in more:
        if len(p.spheres):
            p.spheres[:, :3] = p.spheres[:, :3] @ turn[:3, :3].T
    view = camera(turn[:3, 2] * distance, [0, 0, 0], angle, turn[:3, 1])
    seen = make([target, *more], view, width=16, height=16, max_depth=1)
    drawn = f"{angle:g} degrees from {distance:g}, share {share:.4f} of the side, {what}"
    margin, spp = 2e-3 + (5e-3 if long else 2.5e-3) / share, 128 * math.ceil(2 / share**2)
    return Question(drawn, seen, share**2, margin, None, spp=spp)


def half_space(rng: np.random.Generator) -> Question:
    """A fog of 50 to 1e5 mean free paths, seen straight from above under a sky of 1.

    1 - H(1) sqrt(1 - w), Chandrasekhar; a ball of n free paths differs by about 1 / n, so it has
    10,000 or more. Hidden things cover less than 3e-5 of the sky. A slab's corners are known to
    2^-24 of its width, so it is at most 1e5 free paths wide.
    """
    body = chosen(rng, ("cube", "cube of quads", "sphere", "slab"))
    sigma = decades(rng, 4, 5) if body == "sphere" else decades(rng, 1.7, 5)
    albedo, eye, half = chosen(rng, (0.5, 0.9)), decades(rng, 0.3, 4), decades(rng, 0, FAR)
    half, eye = max(1.0, min(half, 1e5 / sigma)), max(2.0, min(eye, REACH / sigma))
    fog: dict[str, Any] = {"material": NULL, "interior": Medium(sigma, albedo)}
    what, more = "nothing", []
    if rng.random() < 0.5:
        far = decades(rng, 1.5, 4.5)
        what, more = f"ball {far:g} behind", [sphere([0, 0, eye + far], 0.1)]
    n = int(rng.integers(2, 8))
    parts = {
        "cube": lambda: box([-1, -1, -2], [1, 1, 0], False, **fog),
        "cube of quads": lambda: gridded([-1, -1, -2], [1, 1, 0], n, **fog),
        "sphere": lambda: sphere([0, 0, -1], 1, **fog),
        "slab": lambda: box([-half, -half, -2], [half, half, 0], False, **fog),
    }[body]()
    turn = random_rotation_matrix(rng.random(3)) if rng.random() < 0.5 else np.eye(4)
    moved([parts], turn)
    for p in (parts, *more):
        p.spheres[:, :3] = p.spheres[:, :3] @ turn[:3, :3].T
    w = 0.02
    view = camera(turn[:3, 2] * eye, [0, 0, 0], 2 * math.degrees(math.atan(w / eye)), turn[:3, 1])
    seen = make([parts, *more], view, 1.0, width=4, height=4)
    truth = 1 - float(chandrasekhar(albedo, [1.0])[0]) * math.sqrt(1 - albedo)
    wide = f" {half:g} wide" if body == "slab" else f" {n} x {n}" if body[4:] else ""
    drawn = f"{body}{wide} of sigma {sigma:g}, albedo {albedo}, eye {eye:g} away, {what}"
    return Question(drawn + (", turned" if turn[0, 0] != 1 else ""), seen, truth, 1.5e-3, None,
                    0.03, spp=2048)  # fmt: skip


def stacked_fogs(rng: np.random.Generator) -> Question:
    """Two or three slabs of ink on a floor, each on the last or within it: exp(-optical depth).

    The floor emits, or is a mirror below a sky, so that light comes down as well. The slabs are
    seen from straight above, from 25 to 50 times their size away, in any order, rotated or not. A
    face in contact is moved by 2^-21 of the scene and 2^-20 of its position; twice that share of a
    slab's thickness is the margin of its depth.
    """
    count, order = int(rng.integers(2, 4)), bool(rng.random() < 0.5)
    within = bool(rng.random() < 0.5)
    mirror = within or bool(rng.random() < 0.2)
    gap = a_gap(rng, 1e-6)
    thick, far = decades(rng, -2.5, -1), decades(rng, 1.4, 1.7)
    depths = rng.uniform(0.2, 0.5, count)
    depths *= np.linspace(0.2, 1, count) if within else 1  # the inner ones are told from the outer
    fogs: list[Part] = []
    for k, depth in enumerate(depths):
        around = fogs[-1].media[0] if within and fogs else None
        fog: dict[str, Any] = {"interior": Medium(depth / thick), "exterior": around}
        low = (k + 1) * gap + (0 if within else k * thick)
        high = low - gap + thick * (count - k if within else 1)
        side = 0.7 - (0.1 * k if within else 0)
        fogs.append(box([-side, -side, low], [side, side, high], False, material=NULL, **fog))
    floor = square(3.0, material=MIRROR) if mirror else square(3.0, emission=1.0)
    parts = [floor, *(fogs[::-1] if order else fogs)]
    turn = random_rotation_matrix(rng.random(3)) if rng.random() < 0.5 else np.eye(4)
    moved(parts, turn)
    w = 0.02
    view = camera(turn[:3, 2] * far, [0, 0, 0], 2 * math.degrees(math.atan(w / far)), turn[:3, 1])
    seen = make(parts, view, float(mirror), width=8, height=8)
    drawn = f"{count} slabs {thick:g} thick, gap {gap:.2g}, eye {far:g} away"
    drawn += (", within each other" if within else "") + (", mirror" if mirror else "")
    drawn += (", last first" if order else "") + (", turned" if turn[0, 0] != 1 else "")
    depth = float(depths.sum()) * (2 if mirror else 1)
    moved_by = 2.0**-21 * 2 ** math.ceil(math.log2(far)) + 2.0**-20
    margin = 1e-3 + 2 * depth * moved_by / thick
    return Question(drawn, seen, math.exp(-depth), margin, None, 0.05, spp=512)


def wide_fogs(rng: np.random.Generator) -> Question:
    """One to three layers of ink, 5 to 1e5 times as wide as thick, on or above a ground, or alone.

    The ground emits, or a sun lights it through the layers, or the sky is seen from below: exp(-d),
    rho sin(sun) / pi exp(-d - d'), exp(-d) with the optical depths d and d' along the view and
    towards the sun. Grounds are up to 100 times as wide as the layers. The middle of the picture is
    at the origin, where positions across the layers are exact; those of turned layers are off by
    2^-20 of their width, so these are up to 100 wide. Planes of neighbouring faces are then 2^-24
    of it or more apart, and a slanting ray slips through the step: at 40 wide a thousandth of the
    picture, which is 2e-3 wide, and more where the sun slants. So their edges keep out of it.
    """
    light = chosen(rng, ("ground", "sun", "sky"))
    turned = bool(rng.random() < 0.3)
    count, half = int(rng.integers(1, 4)), decades(rng, 1, 2 if turned else 5)
    gap = a_gap(rng, 10.0)
    layers = [(float(rng.uniform(0.3, 1)), float(rng.uniform(0.1, 1))) for _ in range(count)]
    top = sum(thick + gap for thick, _ in layers)
    half = max(half, 4 * top)  # the view and the sun go through all layers
    ground = half * decades(rng, 0, 0.5 if turned else 2)
    n = int(rng.integers(1, 5))
    fogs: list[Part] = []
    depth, low = 0.0, gap
    for thick, sigma in layers:
        fog: dict[str, Any] = {"material": NULL, "interior": Medium(sigma)}
        fogs.append(gridded([-half, -half, low], [half, half, low + thick], n, **fog))
        if turned:
            fogs[-1].vertices += [0.08 * half / n, 0.03 * half / n, 0]
        depth, low = depth + thick * sigma, low + thick + gap
    cosine, tilt = float(rng.uniform(0.3, 1)), float(rng.uniform(0, 1))
    eye = top / math.cos(tilt) + decades(rng, -1, 4)
    floor = {
        "ground": lambda: square(ground, emission=1.0),
        "sun": lambda: square(ground, reflectance=0.5),
        "sky": lambda: square(ground, -10.0),
    }[light]()
    parts = [floor, *fogs]
    turn = random_rotation_matrix(rng.random(3)) if turned else np.eye(4)
    moved(parts, turn)
    w = 1e-3
    above = eye * np.array([math.sin(tilt), 0, math.cos(tilt)])
    from_, to = (-above / eye, above) if light == "sky" else (above, np.zeros(3))
    view = camera(turn[:3, :3] @ from_, turn[:3, :3] @ to, 2 * math.degrees(math.atan(w / eye)),
                  turn[:3, 1])  # fmt: skip
    sun = turn[:3, :3] @ [0, math.sqrt(1 - cosine**2), -cosine]
    lights = [directional_light(sun, math.pi)] if light == "sun" else []
    seen = make(parts, view, float(light == "sky"), lights=lights, width=4, height=4)
    truth = math.exp(-depth / math.cos(tilt))
    truth *= 0.5 * cosine * math.exp(-depth / cosine) if light == "sun" else 1
    drawn = f"{count} layers of depth {depth:.3f}, {half:g} wide, gap {gap:.2g}, {n} x {n}, "
    drawn += f"ground {ground:g} wide, {light}, {cosine:.3f}, eye {eye:g} away at {tilt:.3f}"
    margin = 1e-3 + (2.0**-19 * half * 6 if turned else 0)
    return Question(drawn + (", turned" if turned else ""), seen, truth, margin, None, 0.02,
                    spp=4096)  # fmt: skip


def far_fogs(rng: np.random.Generator) -> Question:
    """Layers thinner than rays from afar resolve, between a ground that emits and a mirror: 1.

    Seen from between ground and layers through the mirror, 1e4 to 1e7 away: the order in which a
    ray enters and leaves them is within rounding. Below them it is in none of them; otherwise 10
    free paths would darken it. Their depth is 2e-4 to 6e-3, which rounding makes 0 to twice that.
    """
    count, half, far = int(rng.integers(1, 4)), decades(rng, 3, 4), decades(rng, 4, 7)
    thick, n, gap = decades(rng, -4, -3), int(rng.integers(1, 4)), chosen(rng, (0.0, 1e-5, 1e-2))
    fogs = [
        gridded([-half, -half, low], [half, half, low + thick], n, material=NULL,
                interior=Medium(1.0))
        for low in 10 + (thick + gap) * np.arange(count)
    ]  # fmt: skip
    order = rng.permutation(count)
    mirror = quad([-half, -half, far], [0, 2 * half, 0], [2 * half, 0, 0], material=MIRROR)
    parts = [square(half, emission=1.0), *(fogs[k] for k in order), mirror]
    turn = [np.eye(4), np.diag([1, -1, -1, 1])][int(rng.integers(2))]
    moved(parts, turn)
    view = camera(turn[:3, 2] * 5, turn[:3, 2] * 20, math.degrees(half / far) / 4, turn[:3, 1])
    drawn = f"{count} layers {thick:g} thick, gap {gap:g}, {half:g} wide, {n} x {n}, "
    drawn += f"mirror {far:g} away"
    return Question(drawn, make(parts, view, width=4, height=4), 1.0, 1e-3 + 4 * count * thick,
                    None, 0.02, spp=256)  # fmt: skip


# ---- pairs ----


def still_life(rng: np.random.Generator, lifted: float, ground: list[Part],
               sigma: float) -> Callable[..., Scene]:  # fmt: skip
    """Two bodies on a ground, lit by a lamp; called with further parts.

    Half of the scenes have only balls, with a ball as lamp: otherwise sizes below a 256th of the
    scene would occur only with a tree. Half of them have a fog.
    """
    names = [str(n) for n in rng.choice(list(LOSSY), 2)]
    if rng.random() < 0.5:
        names[0] = "fog"
    balls = bool(rng.random() < 0.5)
    fog = Medium(sigma, 0.8)
    parts = list(ground)
    for k, name in enumerate(names):
        kind = dict(LOSSY[name])
        if "interior" in kind:
            kind["interior"] = fog
        size, x = float(rng.uniform(0.3, 0.5)), 1.2 * k - 0.6
        if balls or rng.random() < 0.3:
            parts.append(sphere([x, 0, size + lifted], size, **kind))
        else:
            lo, hi = [x - size, -size, lifted], [x + size, size, 2 * size + lifted]
            parts.append(gridded(lo, hi, 1 if rng.random() < 0.7 else 3, **kind))
    lamp = quad([-0.5, -0.5, 3], [0, 1, 0], [1, 0, 0], 0, 8)
    parts.append(sphere([0, 0, 3], 0.5, 0, 8) if balls else lamp)
    eye = camera([*rng.uniform(-3, 3, 2), 2], [0, 0, 0.4], 45)
    kwargs: dict[str, Any] = {"width": 16, "height": 16, "max_depth": -1}

    def scene(*more: Part) -> Scene:
        return make([*parts, *more], eye, **kwargs)

    what = " and ".join(names)
    scene.__doc__ = f"{'balls' if balls else 'bodies'} of {what}, sigma {sigma:g}"
    return scene


def out_of_sight(rng: np.random.Generator) -> Question:
    """Two bodies over a ground, and a black thing somewhere below it that light never meets."""
    while (extra := hidden(rng))[0].startswith("nothing"):
        pass
    half = decades(rng, 0.5, 1.5)
    seen = still_life(rng, decades(rng, -4, -1), [square(half, reflectance=0.6)],
                      decades(rng, 0, 4))  # fmt: skip
    return Question(f"{seen.__doc__}, ground {half:g}, {extra[0]}", seen(*extra[1]), seen(),
                    3e-4, 3e-3, 0.05)  # fmt: skip


def fog_and_speck(rng: np.random.Generator) -> Question:
    """A fog under the sky; a black ball or square far behind the camera covers < 3e-5 of it."""
    body, sigma = chosen(rng, ("cube", "cube of quads", "sphere")), decades(rng, -0.5, 4)
    far = decades(rng, 1.5, 2.6 if rng.random() < 0.5 else FAR)
    fog: dict[str, Any] = {"material": NULL, "interior": Medium(sigma, 0.9)}
    part = {
        "cube": lambda: box([-1, -1, -1], [1, 1, 1], False, **fog),
        "cube of quads": lambda: gridded([-1, -1, -1], [1, 1, 1], 4, **fog),
        "sphere": lambda: sphere([0, 0, 0], 1, **fog),
    }[body]()
    ball = bool(rng.random() < 0.6)
    at = [0.3 * far, 0, far + 4]
    more = sphere(at, 0.1) if ball else quad(at, [0.2, 0, 0], [0, 0.2, 0])
    view = framed(0.5, 4.0)
    pair = [make([part, *p], view, 1.0, width=16, height=16) for p in ([more], [])]
    drawn = f"{body} of sigma {sigma:g}, {'ball' if ball else 'square'} {far:g} away"
    return Question(drawn, pair[0], pair[1], 3e-4, 3e-3, 0.02)


def wide_ground(rng: np.random.Generator) -> Question:
    """Two bodies on a ground of size 1e3 and up to 1e6: 1e-5 of the light meets it beyond 1e3."""
    kind, half = chosen(rng, ("square", "disk", "planet")), decades(rng, 3.3, 6)
    wide = {
        "square": lambda: square(half, reflectance=0.6),
        "disk": lambda: disk([0, 0, 0], [half, 0, 0], [0, half, 0], 0.6),
        "planet": lambda: sphere([0, 0, -max(half, 1e5)], max(half, 1e5), 0.6),
    }[kind]()
    pair = []
    lifted, sigma = decades(rng, -4, -1), decades(rng, 0, 2.5)
    state = rng.bit_generator.state
    for ground in (wide, square(1e3, reflectance=0.6)):
        rng.bit_generator.state = state
        seen = still_life(rng, lifted, [ground], sigma)
        pair.append(seen())
    return Question(f"{seen.__doc__}, lifted {lifted:g}, {kind} {half:g}", pair[0], pair[1], 5e-4,
                    5e-3, 0.05)  # fmt: skip


def telephoto(rng: np.random.Generator) -> Question:
    """A room without its front wall from 1e3 and from up to 3e5 half widths away.

    From the nearer place, perspective shows its sides over 1e-3 of its width.
    """
    room = box([-1, -1, -1], [1, 1, 1], True, 0.6)
    room.faces = room.faces[(room.vertices[room.faces][:, :, 2] < 1).any(axis=1)]
    lamp = quad([-0.3, 0.99, -0.3], [0.6, 0, 0], [0, 0, 0.6], 0, 10)
    name = str(rng.choice([n for n in LOSSY if n != "lamp"]))
    n = int(rng.integers(1, 4))
    body = gridded([-0.4, -0.9, -0.5], [0.3, -0.1, 0.2], n, **LOSSY[name])
    turn = random_rotation_matrix(rng.random(3)) if rng.random() < 0.5 else np.eye(4)
    parts = [room, lamp, body]
    moved(parts, turn)
    far = decades(rng, 3.3, 5.5)
    eyes = [camera(turn[:3, 2] * d, [0, 0, 0], 2 * math.degrees(math.atan(0.9 / d)), turn[:3, 1])
            for d in (far, 1e3)]  # fmt: skip
    seen = make(parts, eyes[0], width=16, height=16, max_depth=-1)
    drawn = f"room with {name} {n} x {n} from {far:g}" + (", turned" if turn[0, 0] != 1 else "")
    return Question(drawn, seen, dataclasses.replace(seen, camera=eyes[1]), 3e-3, 2e-2, 0.06,
                    512)  # fmt: skip


#: Generators by name: with an exact mean, and pairs of one mean.
CLOSED: dict[str, Generator] = {
    "foot of a lamp": foot_of_a_lamp,
    "lamp over a world": lamp_over_a_world,
    "sun": sun,
    "lamp by a wall": lamp_by_a_wall,
    "spot": spot,
    "field of view": field_of_view,
    "half space": half_space,
    "stacked fogs": stacked_fogs,
    "wide fogs": wide_fogs,
    "far fogs": far_fogs,
}
PAIRS: dict[str, Generator] = {
    "out of sight": out_of_sight,
    "fog and speck": fog_and_speck,
    "wide ground": wide_ground,
    "telephoto": telephoto,
}
