"""Level 2: the choice of a light by where the receiver is: chances against float64, and no light
without one that can give something."""

from __future__ import annotations

from typing import Any

import numpy as np
import numpy.typing as npt

from veriray.scene import Scene
from veriray_validate.oracles import normalised
from veriray_validate.scenes import (
    Part,
    directional_light,
    disk,
    make,
    point_light,
    quad,
    sphere,
    spot_light,
)
from veriray_validate.statistics import chi_square
from veriray_validate.trial import Trial, case

Array = npt.NDArray[Any]

#: Columns of a branch (cpp/lights/tree_view.h).
P, AXIS = slice(0, 3), slice(4, 7)
RADIUS, WIDE, WIDE_SINE, EDGE, INVERSE, STRENGTH, FIRST, COUNT, UP = 3, *range(7, 15)
SLACK = 2.0**-10
COSINE = 2.0**-21  # what a cosine of float32 is off by, at most
NONE = 0xFFFFFFFF
ALL, ONE, BOTH = 0, 1, 2
KINDS = ("triangle", "disk", "sphere", "inside", "point", "spot", "sun")


def scene_of(t: Trial, n: int, kinds: tuple[str, ...] = KINDS) -> tuple[Scene, list[Any]]:
    """N lights of each kind at random over a floor, and what they are, by row of the table."""
    rng = t.rng
    parts, lights, rows = [], [], []
    for kind in KINDS:  # in the order of the table
        for _ in range(n if kind in kinds else 0):
            at = rng.uniform(-2, 2, 3) + [0, 0, 2.5]
            a, b = rng.normal(size=(2, 3)) * 0.3
            d, power = normalised(rng.normal(size=(1, 3)))[0], float(10 ** rng.uniform(-2, 2))
            if kind == "triangle":
                parts.append(Part([at, at + a, at + b], [[0, 1, 2]], 0, power))
                rows.append((kind, at, a, b))
            elif kind == "disk":
                b -= a * (a @ b) / (a @ a)
                parts.append(disk(at, a, b, 0, power))
                rows.append((kind, at, a, b))
            elif kind in ("sphere", "inside"):
                r = rng.uniform(0.05, 0.4) * (20 if kind == "inside" else 1)
                parts.append(sphere(at, r, 0, power, inward=kind == "inside"))
                rows.append((kind, at, r, None))
            elif kind == "point":
                lights.append(point_light(at, power))
                rows.append((kind, at, None, None))
            elif kind == "spot":
                cutoff = float(rng.uniform(2, 88))
                lights.append(spot_light(at, d, power, cutoff, cutoff * rng.uniform(0, 1)))
                rows.append((kind, at, d, cutoff))
            else:
                lights.append(directional_light(d, power))
                rows.append((kind, d, None, None))
    floor = quad([-9, -9, 0], [18, 0, 0], [0, 18, 0], 0.5)
    return make([floor, *parts], lights=lights), rows


def receivers(t: Trial, n: int) -> tuple[Array, Array, Array]:
    """Points, normals that are not between two which the renderer keeps, and sides."""
    p = t.rng.uniform(-3, 3, (n, 3)) + [0, 0, 2.5]
    return (
        p,
        rounded_normal(normalised(t.rng.normal(size=(n, 3)))),
        t.rng.integers(0, 3, n).astype(np.uint32),
    )


def answers(t: Trial, held: Any, p: Array, n: Array, sides: Array, u24: Array, row: Array) -> Any:
    """Rows chosen, their chances, and the chances of `row`."""
    words = (np.broadcast_to(np.asarray(x, np.uint32), len(p)).copy() for x in (sides, u24, row))
    chosen, chance, of_row = t.native.choose_lights(held, p, n, *words)
    return chosen, chance.astype(np.float64), of_row.astype(np.float64)


def chances(t: Trial, scene: Scene, p: Any, n: Any, sides: int = ONE) -> Array:
    """The chances of all lights, by row of the table, at one point."""
    held = t.native_scene(scene)
    branches, _ = t.native.light_tree(held)
    words = branches.view(np.uint32)
    k = int((words[:, COUNT] == 0).sum())
    points = np.tile(np.asarray(p, np.float64), (k, 1))
    out: Array = answers(t, held, points, np.tile(np.asarray(n, np.float64), (k, 1)),
                         np.array(sides), np.array(0), np.arange(k))[2]  # fmt: skip
    return out


def rounded_normal(n: Array) -> Array:
    """As the renderer keeps it: two coordinates on an octahedron in units of 1/16383."""
    q = n / np.abs(n).sum(axis=-1, keepdims=True)
    a, b = q[..., 0], q[..., 1]
    below = n[..., 2] < 0
    one = np.where(below, np.where(a < 0, -1, 1) * (1 - np.abs(b)), a)
    two = np.where(below, np.where(b < 0, -1, 1) * (1 - np.abs(a)), b)
    one, two = (np.round(x * 16383) / 16383 for x in (one, two))
    z = 1 - np.abs(one) - np.abs(two)
    below = z < 0
    x = np.where(below, np.where(one < 0, -1, 1) * (1 - np.abs(two)), one)
    y = np.where(below, np.where(two < 0, -1, 1) * (1 - np.abs(one)), two)
    return normalised(np.stack([x, y, z], axis=-1).reshape(-1, 3)).reshape(n.shape)


def importance(branches: Array, p: Array, n: Array, sides: int) -> tuple[Array, Array]:
    """The bounds of all branches at a point in the tree's units; float64, by angles.

    Second, what rounding of cosines may change of each, as a share of it: all of it at the edge
    of a cone of light, whose range of cosines is narrow.
    """
    r = branches[:, RADIUS]
    to = np.where(r[:, None] < 0, branches[:, P], branches[:, P] - p)
    ball = np.maximum(r, 0)
    d = np.linalg.norm(to, axis=1)
    within = (d <= ball) | (r < -1.5)
    half = np.arcsin(np.minimum(ball / np.maximum(d, 1e-30), 1))
    way = to / np.maximum(d, 1e-30)[:, None]

    def beyond(cosine: Array, less: Array) -> Array:
        return np.maximum(np.arccos(np.clip(cosine, -1, 1)) - less, 0)

    off = beyond(-(branches[:, AXIS] * way).sum(axis=1), np.arccos(branches[:, WIDE]))
    off = np.maximum(off - half, 0)
    emitted = np.clip((np.cos(off) - branches[:, EDGE]) / (1 - branches[:, EDGE]), 0, 1)
    up = way @ rounded_normal(n)
    seen = np.cos(beyond(np.abs(up) if sides == BOTH else up, half)) + SLACK
    received = np.ones(len(r)) if sides == ALL else np.where(within, 1, np.maximum(seen, 0))
    emitted = np.where(within, 1, emitted)
    off = COSINE / np.maximum(received, COSINE)
    off += COSINE / np.maximum((1 - branches[:, EDGE]) * emitted, COSINE)
    return branches[:, STRENGTH] * emitted * received / np.maximum(d, ball) ** 2, off


def exact(
    branches: Array, words: Array, root: int, p: Array, n: Array, sides: int
) -> tuple[Array, Array]:
    """The chances of all lights by row: the branches' shares, multiplied from the root on.

    Second, what rounding of cosines may change of each.
    """
    weight, rounded = importance(branches, p, n, sides)
    chance, off = np.zeros(len(branches)), np.zeros(len(branches))
    out = np.zeros((2, int((words[:, COUNT] == 0).sum())))
    groups = [(0, root, 1.0, 0.0)]
    for first, count, whole, before in groups:
        these = slice(first, first + count)
        w = weight[these]
        w = w / w.sum() if w.sum() > 0 else np.full(count, 1 / count)
        chance[these] = whole * w
        off[these] = before + rounded[these] + w @ rounded[these]
        for b in range(first, first + count):
            if words[b, COUNT]:
                groups.append((int(words[b, FIRST]), int(words[b, COUNT]), chance[b], off[b]))
            else:
                out[:, words[b, FIRST]] = chance[b], chance[b] * off[b]
    return out[0], out[1]


@case(2, each={"n": (1, 2, 30)})
def chances_of_lights(t: Trial, n: int) -> None:
    """The chances of lights of all kinds, few and in a deep tree, at points that face all ways.

    Against float64, by angles: within 0.3 %, 2^-20 and what rounding of cosines may change. They
    add up to 1, exactly where the tree has one node, and within 1e-5 else. The chance that comes
    with a choice is that of the light which it states, within 1e-6.
    """
    scene, rows = scene_of(t, n)
    held = t.native_scene(scene)
    branches, root = t.native.light_tree(held)
    words, branches = branches.view(np.uint32), branches.astype(np.float64)
    count = len(rows)
    t.check(int((words[:, COUNT] == 0).sum()) == count, "a leaf for each light")
    points = 40
    p, normals, sides = receivers(t, points)
    every = np.tile(np.arange(count), points)
    got = answers(t, held, *(np.repeat(x, count, axis=0) for x in (p, normals, sides)),
                  np.array(0), every)[2].reshape(points, count)  # fmt: skip
    total = got.sum(axis=1)
    t.check(total == 1 if root == len(branches) else np.abs(total - 1) < 1e-5, "sum of chances")
    # world to the tree's units, by a light at a point
    place = next(k for k, row in enumerate(rows) if row[0] == "point")
    leaves = {int(words[b, FIRST]): b for b in range(len(words)) if words[b, COUNT] == 0}
    others = [k for k, row in enumerate(rows) if row[0] in ("point", "spot", "sphere")]
    world = np.stack([rows[k][1] for k in others])
    tree = np.stack([branches[leaves[k], P] for k in others])
    unit = np.ptp(world, axis=0).max() / np.ptp(tree, axis=0).max()
    origin = rows[place][1] - unit * branches[leaves[place], P]
    for k in range(points):
        want, rounded = exact(
            branches, words, root, (p[k] - origin) / unit, normals[k], int(sides[k])
        )
        off = np.abs(got[k] - want) - 3e-3 * want - rounded - 2.0**-20
        t.check(off < 0, f"point {k}: {got[k][off.argmax()]} for {want[off.argmax()]}")
    u24 = t.rng.integers(0, 1 << 24, points).astype(np.uint32)
    chosen, chance, _ = answers(t, held, p, normals, sides, u24, np.array(0))
    own = got[np.arange(points), chosen]
    t.check(np.abs(chance / own - 1) < 1e-6, "the chance of the choice")


@case(2, each={"n": (2, 30)})
def choices_follow_their_chances(t: Trial, n: int) -> None:
    """How often each light is chosen at a point: chi-square of 10^5 choices, at four points."""
    scene, rows = scene_of(t, n)
    held = t.native_scene(scene)
    draws = 100_000 * t.effort
    for k in range(4):
        p, normals, _ = (np.repeat(x[:1], draws, axis=0) for x in receivers(t, 1))
        side = np.array(k % 3)
        u24 = t.rng.integers(0, 1 << 24, draws)
        chosen = answers(t, held, p, normals, side, u24, np.array(0))[0]
        want = chances(t, scene, p[0], normals[0], k % 3)
        seen = np.bincount(chosen, minlength=len(rows)).astype(np.float64)
        t.check(seen[want == 0] == 0, "a light without a chance")
        rare = want * draws < 20
        fold = [np.append(x[~rare], x[rare].sum()) for x in (seen, want * draws)]
        t.p(chi_square(*fold), f"point {k}")


def gives(t: Trial, row: Any, p: Array, n: Array, sides: Array) -> Array:
    """Whether a light can give something to each receiver, by places on it."""
    kind, at, a, b = row
    m = len(p)
    if kind == "sun":
        way = np.broadcast_to(-at, (m, 1, 3))
        lit = np.ones((m, 1), bool)
    elif kind in ("point", "spot"):
        way = normalised(at - p)[:, None]
        lit = np.ones((m, 1), bool)
        if kind == "spot":
            lit = np.arccos(np.clip(-(way @ a), -1, 1)) < np.radians(b)
    else:
        u = t.rng.random((64, 2))
        if kind == "triangle":
            s = np.sqrt(u[:, :1])
            q, out = at + a * s * (1 - u[:, 1:]) + b * s * u[:, 1:], np.cross(a, b)[None]
        elif kind == "disk":
            s, angle = np.sqrt(u[:, :1]), 2 * np.pi * u[:, 1:]
            q, out = at + a * s * np.cos(angle) + b * s * np.sin(angle), np.cross(a, b)[None]
        else:
            out = normalised(t.rng.normal(size=(64, 3)))
            q = at + a * out
            out = -out if kind == "inside" else out
        way = q[None] - p[:, None]
        lit = (way * out[None]).sum(axis=-1) < 0
    up = (way * n[:, None]).sum(axis=-1)
    seen = (sides == ALL)[:, None] | (up > 0) | (sides == BOTH)[:, None]
    return np.asarray((lit & seen).any(axis=1))


@case(2, each={"kind": KINDS, "n": (3, 40)})
def every_light_that_can_give_has_a_chance(t: Trial, kind: str, n: int) -> None:
    """No light that shines on a receiver without blockers has the chance 0, at 2,000 receivers.

    By places on the lamps, beams of spots and the receiver's sides, in float64; among lights of one
    kind, alone at the root and in a deep tree.
    """
    scene, rows = scene_of(t, n, (kind,))
    held = t.native_scene(scene)
    p, normals, sides = receivers(t, 2000)
    zero = 0
    for k, row in enumerate(rows):
        chance = answers(t, held, p, normals, sides, np.array(0), np.array(k))[2]
        can = gives(t, row, p, normals, sides)
        t.check(chance[can] > 0, f"light {k} has no chance")
        zero += int((chance == 0).sum())
    t.figure("chances of 0", zero)
