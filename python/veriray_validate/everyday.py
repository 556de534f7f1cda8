"""Random scenes of everyday geometry: bodies on, in and against bodies, in rooms and alone.

A drawn scene comes as a `Question` with its truth: an exact mean, or a scene with the same mean.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import numpy.typing as npt
from scipy import stats
from trimesh.transformations import random_rotation_matrix, rotation_matrix

from veriray.rendering import Render
from veriray.scene import Scene
from veriray_validate.scenes import MIRROR, NULL, Medium, Part, box, camera, make, material, quad
from veriray_validate.statistics import sidak, smallest_bias
from veriray_validate.trial import EFFECTIVE, Inconclusive, Trial

Array = npt.NDArray[Any]
BLOCKS = 4  # of the picture's side
#: Where blocks have fewer pixels than LEAST, or other means, two scenes differ by batches.
LEAST, BATCHES = 16, 32


# ---- questions ----


@dataclass(frozen=True)
class Question:
    """A drawn scene and its truth: the exact mean, or a scene with the same mean.

    drawn: its parameters. margin: relative difference of means that is allowed; blocks: that of
    means over blocks of the picture, None: only the mean is judged. sees: relative bias of the mean
    that must be found. sealed: nothing leaves the scene. backs: no camera ray ends on the surface
    that it meets. ends: no path is cut.
    """

    drawn: str
    scene: Scene
    truth: float | Scene
    margin: float = 1e-4
    blocks: float | None = 1e-4
    sees: float = 0.02
    spp: int = 128
    sealed: bool = False
    backs: bool = False
    ends: bool = True


def parts(x: Array) -> list[Array]:
    """The first channel of (..., H, W, 3): of the picture, then of its blocks, (..., pixels)."""
    grey = np.asarray(x, np.float64)[..., 0]
    *more, height, width = grey.shape
    split = grey.reshape(*more, BLOCKS, height // BLOCKS, BLOCKS, width // BLOCKS)
    split = split.swapaxes(-3, -2).reshape(*more, BLOCKS**2, -1)
    return [grey.reshape(*more, -1), *np.moveaxis(split, -2, 0)]


def means(x: Array) -> Array:
    """Of `parts`: (..., 1 + BLOCKS^2)."""
    return np.stack([part.mean(axis=-1) for part in parts(x)], axis=-1)


def against_value(r: Render, truth: float, margin: Array) -> tuple[float, float, float]:
    """Smallest p of mean and blocks, their number and the bias of the mean that is seen."""
    pixels = np.array([part.size for part in parts(r.image)])
    mean = means(r.image)
    error = np.sqrt(means(np.square(r.stderr, dtype=np.float64)) / pixels)
    off = np.maximum(np.abs(mean - truth) - margin * truth, 0)
    # too few samples carry the mean or a block for the normal law: judged with more of them
    n = r.spp * pixels
    off[n * truth**2 < EFFECTIVE * (n * error**2 + truth**2)] = 0
    return _judged(off, error, truth, np.full(len(off), math.inf))


def against_scene(a: Render, b: Render, margin: Array) -> tuple[float, float, float]:
    """The same for two renders of one seed: t tests of differences, by batches or else by pixels.

    If paths use the same random numbers, most of the noise cancels. Under the null hypothesis a
    difference is as likely as its negative, so heavy tails make the test safer, not wrong; so do
    pixels of a part whose means differ from each other's.
    """
    if a.batch_means is None or b.batch_means is None:
        each = parts(a.image.astype(np.float64) - b.image)
    else:
        each = list((means(a.batch_means) - means(b.batch_means)).T)
    n = np.array([len(d) for d in each])
    error = np.array([d.std(ddof=1) for d in each]) / np.sqrt(n)
    level = float(np.mean([r.image[..., 0].mean(dtype=np.float64) for r in (a, b)]))
    off = np.maximum(np.abs([d.mean() for d in each]) - margin * level, 0)
    return _judged(off, error, level, n - 1)


def _judged(off: Array, error: Array, level: float, freedom: Array) -> tuple[float, float, float]:
    """Student's tests (freedom: infinite for the normal law) of what is off beyond its margin."""
    quiet = error <= 1e-7 * level
    tests = int(np.isfinite(off).sum())
    if (off[quiet] > 0).any():
        return 0.0, tests, 0.0
    loud = ~quiet
    p = 2 * stats.t.sf(off[loud] / error[loud], freedom[loud]) if loud.any() else np.ones(1)
    return min(1.0, float(p.min())), tests, smallest_bias(float(error[0]), level)


#: A question with p below SUSPECT is repeated with AGAIN times the samples and fresh random
#: numbers, which then count instead: means of few paths are further off than the normal law says
#: (p < 1e-6 once in 300, of a lamp among mirrors). It fails at once if p is then below SURE: the
#: second stage would not draw a scene again that is one in thousands. False alarms: 1e-10 per
#: question.
SUSPECT, AGAIN, SURE = 1e-3, 16, 1e-7
#: Times as many samples as a question states, at most.
MOST = 1024


def ask(t: Trial, q: Question) -> float:
    """Asks a question: returns its p value and adds it to the trial.

    While noise hides the bias to be seen, the scene is rendered again with fresh random numbers and
    more samples, first 16 times as many: how many does not depend on those that are judged.
    """
    factor = 1
    p, seen, told = _answer(t, q, factor)
    while seen > q.sees:
        if factor == MOST:
            raise Inconclusive(f"sees {seen:.2g}: {told}")
        factor = math.ceil(min(max(16, 2 * factor * (seen / q.sees) ** 2), MOST))
        p, seen, told = _answer(t, q, factor)
    if p < SUSPECT:
        first = p
        p, seen, told = _answer(t, q, AGAIN * factor)
        t.check(p >= SURE, f"{told}, p = {first:.2g}, then {p:.2g}")
    t.p(p, told)
    t.sees(seen + q.margin)
    t.figures.setdefault("drawn", []).append(f"{told}, p = {p:.2g}")
    return p


def _answer(t: Trial, q: Question, factor: int) -> tuple[float, float, str]:
    """The p value, the bias that is seen (0 if it does not depend on noise), and the question."""
    margin = np.array([q.margin, *[math.inf if q.blocks is None else q.blocks] * BLOCKS**2])
    seed = t.fresh()
    spp = q.spp * factor // math.gcd(t.effort, 4)  # full runs draw more scenes instead
    few = q.scene.film.width * q.scene.film.height < LEAST * BLOCKS**2
    batches = BATCHES if isinstance(q.truth, Scene) and (few or q.blocks is None) else 0
    r = t.render(q.scene, spp, seed=seed, batches=batches)
    if q.sealed:
        t.sealed(r, q.drawn)
    if q.backs:
        t.rare(r.stats["ledger"]["absorbed"][0], r, f"camera rays meet a back: {q.drawn}")
    if q.ends:
        t.rare(sum(r.stats["ledger"]["depth_cut"]), r, f"paths do not end: {q.drawn}")
    if isinstance(q.truth, Scene):
        other = t.render(q.truth, spp, seed=seed, batches=batches)
        p, tests, seen = against_scene(r, other, margin)
        want = float(other.image[..., 0].mean(dtype=np.float64))
    else:
        p, tests, seen = against_value(r, q.truth, margin)
        want = q.truth
    mean = float(r.image[..., 0].mean(dtype=np.float64))
    return sidak(p, tests), seen, f"{q.drawn}: {mean:.6g} for {want:.6g}"


# ---- bodies ----

FOG = Medium(2.0, 1.0)
#: Materials without loss (a lamp: as bright as the walls): invisible if everything is as bright.
LOSSLESS: dict[str, dict[str, Any]] = {
    "diffuse": {"reflectance": 1.0},
    "board": {"reflectance": 1.0, "two_sided": True},
    "mirror": {"material": MIRROR},
    "glass": {"material": material("dielectric", eta=1.5)},
    "plastic": {"reflectance": 1.0, "material": material("plastic", eta=1.5)},
    "null": {"material": NULL},
    "fog": {"material": NULL, "interior": FOG},
    "milky glass": {"material": material("dielectric", eta=1.5), "interior": FOG},
    "mask": {"reflectance": 1.0, "two_sided": True, "material": material("diffuse", opacity=0.5)},
    "thin glass": {"material": material("thindielectric", eta=1.5)},
    "lamp": {"emission": 1.0},
}
_MIST = Medium(2.0, 0.8)
#: The same with losses.
LOSSY: dict[str, dict[str, Any]] = {
    **LOSSLESS,
    "diffuse": {"reflectance": 0.7},
    "board": {"reflectance": 0.7, "two_sided": True},
    "plastic": {"reflectance": 0.7, "material": material("plastic", eta=1.5)},
    "fog": {"material": NULL, "interior": _MIST},
    "milky glass": {"material": material("dielectric", eta=1.5), "interior": _MIST},
    "mask": {"reflectance": 0.7, "two_sided": True, "material": material("diffuse", opacity=0.5)},
}
REFRACTS = {"glass", "milky glass"}
OPAQUE = {"diffuse", "board", "mirror", "plastic", "lamp"}
WAYS = ("stands", "leans", "sunk", "flush", "inside")
GAPS = (0.0, 2.0**-24, 1e-7, 1e-6, 1e-5, 1e-4, 1e-3)


def decades(rng: np.random.Generator, low: float, high: float) -> float:
    """10 to a random power between `low` and `high`, rounded to three digits."""
    return float(f"{10 ** rng.uniform(low, high):.3g}")


def a_gap(rng: np.random.Generator, most: float = 1e-3, least: float = 0.0) -> float:
    """One of `GAPS` in half of the draws, else any down to 1e-9: of bounds on rounding that tell
    what is close, one may hold and another not."""
    if rng.random() < 0.5:
        return float(rng.choice([g for g in GAPS if least <= g <= most]))
    return decades(rng, math.log10(max(least, 1e-9)), math.log10(most))


def gridded(lo: Any, hi: Any, n: int, **more: Any) -> Part:
    """A box, front outside, each face of n x n quads."""
    lo, hi = np.asarray(lo, float), np.asarray(hi, float)
    if n == 1:
        return box(lo, hi, False, **more)
    quads = []
    steps = np.linspace(0, 1, n + 1)
    for axis in range(3):
        u, v = (axis + 1) % 3, (axis + 2) % 3
        for side in (0, 1):
            for i in range(n):
                for j in range(n):
                    ring = [(i, j), (i + 1, j), (i + 1, j + 1), (i, j + 1)]
                    corner = np.empty((4, 3))
                    corner[:, axis] = side
                    corner[:, u], corner[:, v] = steps[np.array(ring).T]
                    quads.append(corner if side else corner[::-1])
    vertices = lo + np.concatenate(quads) * (hi - lo)
    faces = np.array([[0, 1, 2], [0, 2, 3]])
    faces = (faces + 4 * np.arange(len(quads))[:, None, None]).reshape(-1, 3)
    return Part(vertices, faces, **more)


def moved(parts: Sequence[Part], matrix: Array) -> None:
    """Parts of triangles, in place."""
    for p in parts:
        p.vertices = p.vertices @ matrix[:3, :3].T + matrix[:3, 3]


def walls(shining: bool) -> Part:
    """Of a room 6 wide and 4 high without a floor: of radiance 1, or grey."""
    room = box([-3, -3, 0], [3, 3, 4], True)
    room.faces = room.faces[(room.vertices[room.faces][:, :, 2] > 0).any(axis=1)]
    room.emission = np.full(3, float(shining))
    room.reflectance = np.full(3, 0.0 if shining else 0.5)
    return room


def fittings(shining: bool, tree: bool) -> list[Part]:
    """The lamp of a grey room; and a speck that brings a tree."""
    lamp = quad([-1, -1, 3.5], [0, 2, 0], [2, 0, 0], 0.0, 4.0)
    speck = quad([2.9, 2.9, 3.9], [1e-5, 0, 0], [0, 1e-5, 0], 0.0, float(shining))
    return [lamp] * (not shining) + [speck] * tree


def direction(azimuth: float, elevation: float) -> Array:
    """A unit vector, by radians about the z axis and above the floor."""
    return np.array([math.cos(azimuth) * math.cos(elevation),
                     math.sin(azimuth) * math.cos(elevation), math.sin(elevation)])  # fmt: skip


@dataclass(frozen=True)
class Touch:
    """Two bodies in a room, the upper one on, in or against the lower one.

    gap: between them, and between the lower one and the floor. depth: how far it is sunk. angle:
    how far it leans. floor: the lower body is the floor. n: of `gridded`. tree: a hidden speck
    gives the scene a tree.
    """

    lower: str
    upper: str
    way: str
    gap: float
    floor: bool
    angle: float
    depth: float
    at: tuple[float, float]
    eye: tuple[float, float, float]
    n: int = 1
    tree: bool = False
    turn: tuple[float, float, float] | None = None

    def __str__(self) -> str:
        what = "floor of" if self.floor else "box of"
        more = f", {self.n} x {self.n}" if self.n > 1 else ""
        more += (", tree" if self.tree else "") + (", turned" if self.turn else "")
        place = f"at {self.at[0]:.3f} {self.at[1]:.3f}, angle {self.angle:.3f}"
        eye = " ".join(f"{x:.3f}" for x in self.eye)
        return (f"{self.upper} {self.way} on {what} {self.lower}, gap {self.gap:.2g}, {place}, "
                f"depth {self.depth:.3f}, eye {eye}{more}")  # fmt: skip

    def parts(self, kinds: dict[str, dict[str, Any]]) -> list[Part]:
        """The two bodies, in a frame whose floor is z = 0."""
        result = []
        top = 0.0
        if not self.floor:
            lo, hi = [-1.0, -1.0, self.gap], [1.0, 1.0, self.gap + 0.625]
            top = hi[2]
            result.append(gridded(lo, hi, self.n, **kinds[self.lower]))
        half, height = 0.375, 0.75
        centre = np.array([*self.at, top + self.gap])
        if self.way == "sunk":
            centre[2] -= self.depth
        if self.way == "flush":  # with the lower one's side, or with the room's wall
            centre[0] = (3.0 - self.gap if self.floor else 1.0) - half
        if self.way == "inside" and not self.floor:
            lo, hi = np.array(lo) + self.gap, np.array(hi) - self.gap
        else:
            lo = centre - [half, half, 0]
            hi = centre + [half, half, height]
        upper = gridded(lo, hi, self.n, **kinds[self.upper])
        if self.way == "leans":
            edge = [centre[0] - half, centre[1], centre[2]]
            moved([upper], rotation_matrix(-self.angle, [0, 1, 0], edge))
        return [*result, upper]

    def scene(self, kinds: dict[str, dict[str, Any]], shining: bool) -> Scene:
        """The bodies in a room whose walls are equally bright, or in a grey one with a lamp."""
        floor = kinds[self.lower if self.floor else "diffuse"]
        ground = quad([-3, -3, 0], [6, 0, 0], [0, 6, 0], **floor)
        parts = [walls(shining), ground, *self.parts(kinds), *fittings(shining, self.tree)]
        look, distance = direction(*self.eye[:2]), self.eye[2]
        target = np.array([*self.at, 0.2 if self.floor else 0.6])
        if self.way == "flush":  # the eye keeps out of the body at the wall
            target[0] = 2.4 if self.floor else 0.625
        top = 1.8 if self.way == "flush" and self.floor else 2.9
        eye = np.clip(target + distance * look, [-2.9, -2.9, 0.05], [top, 2.9, 3.4])
        up = np.array([0.0, 0.0, 1.0])
        if self.turn:
            turn = random_rotation_matrix(np.array(self.turn))
            moved(parts, turn)
            eye, target, up = (turn[:3, :3] @ x for x in (eye, target, up))
        view = camera(eye, target, 35, up)
        return make(parts, view, width=16, height=16, max_depth=-1)


def touch(rng: np.random.Generator, lower: str, upper: str, way: str) -> Touch:
    """A random touch: gap, place, angle, depth, eye, representation."""
    floor = bool(lower in OPAQUE and way != "inside" and rng.random() < 0.5)
    plain = bool(rng.random() < 0.5)
    return Touch(
        lower, upper, way, a_gap(rng), floor, float(rng.uniform(0.05, 0.7)),
        float(rng.uniform(0.02, 0.5)), tuple(rng.uniform(-0.5, 0.5, 2).round(3).tolist()),
        (float(rng.uniform(0, 2 * math.pi)), float(rng.uniform(0.05, 1.2)),
         float(rng.uniform(1.5, 2.4))),
        1 if plain or rng.random() < 0.5 else int(rng.integers(2, 6)),
        bool(not plain and rng.random() < 0.5),
        tuple(rng.random(3).tolist()) if rng.random() < 0.4 else None,
    )  # fmt: skip


def settled(x: Touch) -> Touch:
    """A scene whose truth does not depend on definitions: glass keeps a distance from lamps.

    Light that a lamp sends directly into glass is not in equilibrium, because its radiance there
    should be that in air times the index squared. And glass within glass, a gap away, is a light
    guide: light that enters at its corners stays for 1 / gap bounces.
    """
    pair = {x.lower, x.upper}
    if x.way == "inside" and pair <= REFRACTS:
        x = Touch(**{**vars(x), "way": "stands"})
    if "lamp" in pair and pair & REFRACTS and x.way != "stands":
        x = Touch(**{**vars(x), "way": "stands"})
    if "lamp" in pair and pair & REFRACTS:
        x = Touch(**{**vars(x), "gap": max(x.gap, 1e-4)})
    return x


def shining(rng: np.random.Generator, lower: str, upper: str, way: str) -> Question:
    """Lossless bodies among walls of radiance 1: they are invisible, whatever touches what."""
    x = settled(touch(rng, lower, upper, way))
    return Question(str(x), x.scene(LOSSLESS, True), 1.0, sealed=True)


#: Materials that let light through to what the body holds.
CLEAR = ("glass", "null", "fog", "milky glass", "mask", "thin glass")


def nested(rng: np.random.Generator) -> Question:
    """A body within a clear one on the floor, turned in nine of ten draws: invisible.

    Three layers, each within 1e-6 of the next, in the same order at every face.
    """
    lower, upper = str(rng.choice(CLEAR)), str(rng.choice(list(LOSSLESS)))
    if {lower, upper} <= REFRACTS:
        upper = "fog"  # `settled` says why
    x = touch(rng, lower, upper, "inside")
    turn = tuple(rng.random(3).tolist()) if rng.random() < 0.9 else None
    x = settled(Touch(**{**vars(x), "gap": a_gap(rng, 1e-6), "turn": turn}))
    return Question(str(x), x.scene(LOSSLESS, True), 1.0, sealed=True)


def inlaid(rng: np.random.Generator) -> Question:
    """An opaque body within a lamp, turned, within the rounding of their faces: invisible."""
    x = touch(rng, "lamp", str(rng.choice(sorted(OPAQUE - {"lamp"}))), "inside")
    turn = tuple(rng.random(3).tolist())
    x = settled(Touch(**{**vars(x), "gap": a_gap(rng, 1e-7), "turn": turn}))
    return Question(str(x), x.scene(LOSSLESS, True), 1.0, sealed=True)


#: Gap of the scene with which the others are compared.
LIFTED = 1e-4


def lifted(rng: np.random.Generator, lower: str, upper: str, way: str) -> Question:
    """Bodies with losses, lit by a lamp: the picture with any gap is that with a gap of 1e-4.

    A slit of 1e-4 around a body of perimeter 4 x .75 lets through at most 3e-4 of the light on a
    unit of area, and no edge moves by more than 2e-4 of the picture's 1.2. So 1e-3 of the mean, and
    16 times that for a block, is a margin for both. Glass keeps 1e-5 away from what could wet it,
    and so does anything inside it: of two surfaces in one place either may be seen. Between the
    walls of two bodies light may stay for long. A cover keeps 1e-4 away from its lamp, 2^-16 of
    the room.
    """
    x = settled(touch(rng, lower, upper, way))
    most = {} if x.gap <= LIFTED else {"gap": LIFTED}
    if {x.lower, x.upper} & REFRACTS or x.way == "inside":
        most["gap"] = LIFTED if x.upper == "lamp" else float(np.clip(x.gap, 1e-5, LIFTED))
    x = Touch(**{**vars(x), **most})
    other = Touch(**{**vars(x), "gap": LIFTED, "n": 1, "tree": False, "turn": None})
    return Question(str(x), x.scene(LOSSY, False), other.scene(LOSSY, False), 1e-3, 1.6e-2, 0.05,
                    sealed=True, ends=x.way != "inside")  # fmt: skip
