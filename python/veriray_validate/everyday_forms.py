"""Random scenes of touching bodies of all forms: balls, meshes, cylinders, turned boxes.

Those of `everyday` are upright boxes.
"""

from __future__ import annotations

import dataclasses
import math
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
import numpy.typing as npt
from trimesh.transformations import random_rotation_matrix

from veriray.scene import Scene
from veriray_validate.everyday import (
    CLEAR,
    LIFTED,
    LOSSLESS,
    LOSSY,
    OPAQUE,
    REFRACTS,
    Question,
    a_gap,
    direction,
    fittings,
    moved,
    walls,
)  # fmt: skip
from veriray_validate.leaks import icosphere
from veriray_validate.scenes import Part, box, camera, make, quad, sphere

Array = npt.NDArray[Any]
FORMS = ("ball", "icosphere", "fine icosphere", "cylinder", "lying cylinder", "turned box", "box")
FLAT_FORMS = ("cylinder", "box")
#: The share of scenes whose floor is a large ball.
PLANETS = 0.2
#: Ways of two bodies: one on the other, let into it, side by side, with one edge or point in
#: common, the upper one within the lower: in the middle, or at its bottom.
WAYS = ("stands", "sunk", "beside", "edge", "inside", "lies")


def unit(form: str, spin: tuple[float, float, float]) -> tuple[Array, Array]:
    """Vertices and faces of a closed convex body around the origin, half as high as wide at least.

    spin: three numbers in [0, 1), of which rotations and counts follow. A ball has none of either.
    """
    if form == "ball":
        return np.zeros((0, 3)), np.zeros((0, 3), np.int64)
    if form.endswith("icosphere"):
        vertices, faces = icosphere(2 if form.startswith("fine") else int(2 * spin[0]))
        turn = random_rotation_matrix(np.array(spin))
        return vertices @ turn[:3, :3].T, faces
    if form.endswith("cylinder"):
        vertices, faces = prism(3 + int(40 * spin[0] ** 2))
        if form.startswith("lying"):
            vertices = vertices[:, [2, 0, 1]]
        c, s = math.cos(2 * math.pi * spin[1]), math.sin(2 * math.pi * spin[1])
        return vertices @ np.array([[c, s, 0], [-s, c, 0], [0, 0, 1]]), faces
    cube = box([-0.6] * 3, [0.6] * 3, False)
    turn = random_rotation_matrix(np.array(spin))[:3, :3] if form == "turned box" else np.eye(3)
    return cube.vertices @ turn.T, cube.faces


def prism(sides: int) -> tuple[Array, Array]:
    """Vertices and faces of an upright prism of radius 1 and height 1.2."""
    angle = 2 * math.pi * np.arange(sides) / sides
    ring = np.stack([np.cos(angle), np.sin(angle), np.full(sides, -0.6)], axis=1)
    vertices = np.concatenate([ring, ring * [1, 1, -1]])
    k = np.arange(sides)
    n = (k + 1) % sides
    side = [np.stack([k, n, n + sides], 1), np.stack([k, n + sides, k + sides], 1)]
    fan = np.arange(1, sides - 1)
    low = np.stack([0 * fan, fan + 1, fan], axis=1)
    return vertices, np.concatenate([*side, low, low[:, [0, 2, 1]] + sides])


@dataclass(frozen=True)
class Body:
    """A form of some size at a place, before it has a material."""

    form: str
    spin: tuple[float, float, float]
    size: float
    centre: Array

    @property
    def shape(self) -> tuple[Array, Array]:
        """Vertices and faces in place."""
        vertices, faces = unit(self.form, self.spin)
        return vertices * self.size + self.centre, faces

    def reach(self, way: Any) -> float:
        """How far it extends from its centre along a unit vector."""
        if self.form == "ball":
            return self.size
        return float((unit(self.form, self.spin)[0] @ np.asarray(way, float)).max() * self.size)

    @property
    def radii(self) -> tuple[float, float]:
        """Of the largest ball within and the smallest around it, about its centre."""
        if self.form == "ball":
            return self.size, self.size
        vertices, faces = unit(self.form, self.spin)
        p = vertices[faces]
        n = np.cross(p[:, 1] - p[:, 0], p[:, 2] - p[:, 0])
        n /= np.linalg.norm(n, axis=1)[:, None]
        within = (n * p[:, 0]).sum(1).min()
        return float(within) * self.size, float(np.linalg.norm(vertices, axis=1).max()) * self.size

    def part(self, kind: dict[str, Any]) -> Part:
        """It as primitives of a material."""
        if self.form == "ball":
            return sphere(self.centre, self.size, **kind)
        return Part(*self.shape, **kind)


UP, DOWN, ASIDE = np.array([0, 0, 1.0]), np.array([0, 0, -1.0]), np.array([1.0, 0, 0])


@dataclass(frozen=True)
class Contact:
    """Two bodies on a floor; the upper one touches the lower one, or the floor if that is lower.

    gap: between them, and between the lower one and the floor. depth: how far it is sunk. way: of
    WAYS. planet: radius of the ball that is the floor, 0 for a flat one. tree: a hidden speck gives
    the scene a tree. turn: of the whole room.
    """

    lower: str
    upper: str
    way: str
    gap: float
    forms: tuple[str, str]
    spins: tuple[tuple[float, float, float], tuple[float, float, float]]
    floor: bool
    depth: float
    eye: tuple[float, float, float]
    tree: bool = False
    planet: float = 0.0
    turn: tuple[float, float, float] | None = None

    def __str__(self) -> str:
        what = (
            ("planet" if self.planet else "floor") + " of" if self.floor else f"{self.forms[0]} of"
        )
        more = (", tree" if self.tree else "") + (", turned" if self.turn else "")
        spins = " ".join(f"{x:.3f}" for spin in self.spins for x in spin)
        eye = " ".join(f"{x:.3f}" for x in self.eye)
        who = f"{self.forms[1]} of {self.upper} {self.way} on {what} {self.lower}"
        return (f"{who}, gap {self.gap:.2g}, planet {self.planet:.3g}, depth {self.depth:.3f}, "
                f"spins {spins}, eye {eye}{more}")  # fmt: skip

    def bodies(self) -> list[Body]:
        """The lower body, unless it is the floor, and the upper one, above z = 0."""
        first = Body(self.forms[0], self.spins[0], 0.7, np.zeros(3))
        second = Body(self.forms[1], self.spins[1], 0.45, np.zeros(3))
        first = replace(first, centre=UP * (first.reach(DOWN) + self.gap))
        down = second.reach(DOWN)
        if self.floor:
            sunk = self.depth if self.way == "sunk" else 0.0
            return [replace(second, centre=UP * (down + self.gap - sunk))]
        top = first.centre[2] + first.reach(UP)
        if self.way in ("stands", "sunk"):
            sunk = self.depth if self.way == "sunk" else 0.0
            second = replace(second, centre=UP * (top + self.gap + down - sunk))
        elif self.way in ("beside", "edge"):  # tops in one plane; or only a corner in common
            x = first.reach(ASIDE) + self.gap + second.reach(-ASIDE)
            z = top - second.reach(UP) if self.way == "beside" else top + self.gap + down
            second = replace(second, centre=np.array([x, 0, max(z, down + self.gap)]))
        elif self.way == "inside" and self.forms[0] == self.forms[1]:
            within, _ = first.radii
            second = Body(
                first.form, first.spin, first.size * (1 - self.gap / within), first.centre
            )
        else:
            within, around = first.radii[0], second.radii[1]
            size = (within - self.gap) / around * second.size
            second = replace(second, size=size, centre=first.centre)
            if self.way == "lies":
                second = replace(second, size=size * 0.5)
                z = self.gap + second.reach(DOWN) + first.centre[2] - first.reach(DOWN)
                second = replace(second, centre=UP * z)
        return [first, second]

    def scene(self, kinds: dict[str, dict[str, Any]], shining: bool) -> Scene:
        """The bodies in a room whose walls are equally bright, or in a grey one with a lamp."""
        room = walls(shining)
        floor = kinds[self.lower if self.floor else "diffuse"]
        bodies = self.bodies()
        names = [self.upper] if self.floor else [self.lower, self.upper]
        ground = quad([-3, -3, 0], [6, 0, 0], [0, 6, 0], **floor)
        if self.planet:
            room = box([-3, -3, -2], [3, 3, 4], True, float(not shining) / 2, float(shining))
            ground = sphere([0, 0, -self.planet], self.planet, **floor)
        parts = [room, ground]
        parts += [b.part(kinds[n]) for b, n in zip(bodies, names, strict=True)]
        parts += fittings(shining, self.tree)
        look, distance = direction(*self.eye[:2]), self.eye[2]
        target = bodies[-1].centre * 1.0
        eye = np.clip(target + distance * look, [-2.9, -2.9, 0.05], [2.9, 2.9, 3.4])
        while any(np.linalg.norm(eye - b.centre) < b.radii[1] + 0.05 for b in bodies):
            eye[2] += 0.1
        up = UP
        if self.turn:
            turn = random_rotation_matrix(np.array(self.turn))
            moved(parts, turn)
            for p in parts:
                p.spheres[:, :3] = p.spheres[:, :3] @ turn[:3, :3].T
            eye, target, up = (turn[:3, :3] @ x for x in (eye, target, up))
        view = camera(eye, target, 35, up)
        return make(parts, view, width=16, height=16, max_depth=-1)


def contact(rng: np.random.Generator, lower: str, upper: str, way: str) -> Contact:
    """A random contact whose truth does not depend on definitions; see `everyday.settled`."""
    forms = str(rng.choice(FORMS)), str(rng.choice(FORMS))
    if way == "inside" and rng.random() < 0.5:
        forms = forms[0], forms[0]
    if way in ("inside", "lies") and lower not in CLEAR:
        lower = str(rng.choice(CLEAR))
    pair = {lower, upper}
    if way in ("inside", "lies") and pair <= REFRACTS:
        upper = "fog"
    floor = bool(lower in OPAQUE and way in ("stands", "sunk") and rng.random() < 0.7)
    gap = a_gap(rng)
    if "lamp" in pair and pair & REFRACTS:
        way, gap = "stands", max(gap, 1e-4)
    three = [tuple(rng.random(3).tolist()) for _ in range(3)]
    return Contact(
        lower, upper, way, gap, forms, (three[0], three[1]), floor,
        float(rng.uniform(0.02, 0.4)),
        (float(rng.uniform(0, 2 * math.pi)), float(rng.uniform(0.05, 1.2)),
         float(rng.uniform(1.5, 2.4))),
        bool(rng.random() < 0.3),
        10 ** float(rng.uniform(0.5, 4)) if rng.random() < PLANETS else 0.0,
        three[2] if rng.random() < 0.4 else None,
    )  # fmt: skip


def coat(x: Contact) -> float:
    """The share of light that takes a wrong way at the edges of a coat of glass on a body within.

    The coat's planes are moved out until they are m = 2^-20 (terms + seen) off the body's, its
    edges stay (cpp/scene/touching.cpp): terms are at most the 5 from the eye, seen at most 32 sizes
    of the body and half the unit, which is at most the planet's diameter and the room's 6. Diffuse
    light comes in once, and goes out 1 / (1 - r) and back r / (1 - r) times, r = 0.6 of it being
    reflected inside an index of 1.5: 5 ways through the coat, each m tan(t) to the side, pi / 2 m
    in the mean. In faces of perimeter P and area A it crosses an edge once in pi A / P; where it
    does it may be on the wrong side of the next face. So the share is at most 5 m P / (2 A).
    """
    if x.way != "inside" or x.floor or x.lower not in REFRACTS or x.forms[0] != x.forms[1]:
        return 0.0
    vertices, faces = x.bodies()[0].shape
    if not len(faces):
        return 0.0
    extent = float(np.linalg.norm(np.ptp(vertices, axis=0)))
    if x.turn:  # the box around it turns
        extent *= math.sqrt(3)
    moved_by = 2.0**-20 * (5 + min(2 * x.planet + 6, 32 * extent)) - x.gap
    p = vertices[faces]
    edges = np.linalg.norm(p - np.roll(p, 1, axis=1), axis=2).sum()
    area = np.linalg.norm(np.cross(p[:, 1] - p[:, 0], p[:, 2] - p[:, 0]), axis=1).sum() / 2
    return max(0.0, moved_by) * 2.5 * float(edges / area)


def shining(rng: np.random.Generator, lower: str, upper: str, way: str) -> Question:
    """Lossless bodies among walls of radiance 1: they are invisible, whatever touches what.

    Within margins of 1e-4 and of what `coat` says, for a block twice that; light on a wrong way
    may stay within the body.
    """
    x = contact(rng, lower, upper, way)
    off = coat(x)
    return Question(str(x), x.scene(LOSSLESS, True), 1.0, 1e-4 + off, 1e-4 + 2 * off, sealed=True,
                    ends=off == 0)  # fmt: skip


def lamp_on_glass(rng: np.random.Generator) -> Question:
    """A lamp that stands on a body of glass on a large ball, in contact or nearly: invisible."""
    x = contact(rng, str(rng.choice(sorted(REFRACTS))), "lamp", "stands")
    forms = str(rng.choice(FLAT_FORMS)), str(rng.choice(FLAT_FORMS))
    planet = 10 ** float(rng.uniform(1, 4))
    x = replace(x, forms=forms, gap=a_gap(rng), planet=planet)
    return Question(str(x), x.scene(LOSSLESS, True), 1.0, sealed=True, ends=False)


def balls(rng: np.random.Generator) -> Question:
    """A ball within a clear ball of nearly its size, on the floor: invisible.

    Their centres differ by less than their radii do, or by rounding.
    """
    upper = str(rng.choice([*LOSSLESS, "diffuse", "mirror", "plastic"]))
    lower, gap = str(rng.choice([*CLEAR, *sorted(REFRACTS)])), a_gap(rng, 1e-6)
    x = contact(rng, lower, upper, "inside")
    gap = max(gap, x.gap) if "lamp" in (x.lower, x.upper) else gap
    x = replace(x, forms=("ball", "ball"), gap=gap, way="inside")
    if "lamp" in (x.lower, x.upper) and x.lower in REFRACTS:
        x = replace(x, upper="mirror")
    scene, off = x.scene(LOSSLESS, True), rng.normal(size=3)
    off *= max(0.5 * x.gap, 1e-9) * rng.random() / np.linalg.norm(off)
    spheres = scene.spheres.copy()
    spheres[-1, :3] += off
    return Question(
        f"{x}, off {off}", dataclasses.replace(scene, spheres=spheres), 1.0, sealed=True
    )


def lifted(rng: np.random.Generator, lower: str, upper: str, way: str) -> Question:
    """Bodies with losses, lit by a lamp: the picture with any gap is that with a gap of 1e-4.

    Margins as in `everyday.lifted`, and of what `coat` says.
    """
    return _lifted(contact(rng, lower, upper, way))


def on_a_planet(rng: np.random.Generator) -> Question:
    """As `lifted`: a clear body on a large ball, with an opaque one at its bottom, both flat."""
    lower = str(rng.choice(sorted({*CLEAR, *REFRACTS})))
    x = contact(rng, lower, str(rng.choice(sorted(OPAQUE - {"lamp"}))), "lies")
    forms = str(rng.choice(FLAT_FORMS)), str(rng.choice(FLAT_FORMS))
    return _lifted(replace(x, lower=lower, forms=forms, planet=10 ** float(rng.uniform(2.5, 4.5))))


def _lifted(x: Contact) -> Question:
    gap = min(x.gap, LIFTED)
    if {x.lower, x.upper} & REFRACTS or x.way in ("inside", "lies"):
        gap = LIFTED if x.upper == "lamp" else float(np.clip(gap, 1e-5, LIFTED))
    x = replace(x, gap=gap)
    other = replace(x, gap=LIFTED, tree=False, turn=None)
    off = coat(x)
    pair = x.scene(LOSSY, False), other.scene(LOSSY, False)
    return Question(str(x), *pair, 1e-3 + off, 1.6e-2 + 2 * off, 0.05, sealed=True,
                    ends=x.way not in ("inside", "lies"))  # fmt: skip
