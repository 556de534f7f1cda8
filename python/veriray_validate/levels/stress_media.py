"""Stress of the boundaries of media: rounding at edges and faces, layers, unbounded media."""

from __future__ import annotations

import math
from collections.abc import Callable

import trimesh

from veriray.scene import Scene
from veriray_validate.everyday import fittings
from veriray_validate.scenes import (
    MIRROR,
    NULL,
    Medium,
    Part,
    box,
    camera,
    disk,
    make,
    material,
    quad,
    sphere,
)
from veriray_validate.transfer import chandrasekhar
from veriray_validate.trial import Trial, case


@case(8, each={"distance": [300.0, 3e4], "around": ["vacuum", "ink"]})
def medium_from_afar(t: Trial, distance: float, around: str) -> None:
    """A rotated box of lossless fog, 300 and 30,000 sizes away, in a sky of 1.

    Of the rays that enter, 1 in 40,000 and 1 in 20,000 miss the exit at an edge, because of
    rounding, and meet nothing more. They count as outside: no path is cut at 1,000 segments
    (exact), and every pixel is 1 (sees 2 %). In unbounded ink they stay in the ink: every pixel is
    exactly 0, and nothing escapes.
    """
    ink = Medium(1 / distance) if around == "ink" else None
    fog = box([-1, -1, -1], [1, 1, 1], False, material=NULL, interior=Medium(2.0, 1.0),
              exterior=ink)  # fmt: skip
    fog.vertices = fog.vertices @ trimesh.transformations.rotation_matrix(0.7, [1, 2, 3])[:3, :3]
    eye = camera([0.3 * distance, 0.5 * distance, 0.8 * distance], [0, 0, 0],
                 2 * math.degrees(math.atan(1.8 / distance)))  # fmt: skip
    seen = make([fog], eye, 1.0, 16, 16, camera_medium=ink, max_depth=1000)
    if ink is None:
        r = t.agrees(seen, 1.0, 2000, 0.02, margin=1e-4)
    else:
        r = t.render(seen, 4000)
        t.check(not r.image.any() and not any(r.stats["ledger"]["escaped"]), "the sky is seen")
    t.check(not any(r.stats["ledger"]["depth_cut"]), "paths never leave the medium")


def endless(ink: Medium) -> dict[str, Callable[[], Scene]]:
    """Media without an end, from within and through their boundaries; a sky of 1."""
    out = camera([0, 0, 0], [0.3, 0.2, 1])
    five = box([-1, -1, 1], [1, 1, 2], False, material=NULL, interior=ink)
    five.faces = five.faces[[k for k, f in enumerate(five.faces)
                             if not (five.vertices[f][:, 2] == 2).all()]]  # fmt: skip
    ball = trimesh.creation.icosphere(1)
    mesh = Part(ball.vertices, ball.faces, material=NULL, exterior=ink)
    inner = sphere([0, 0, 0], 1, material=NULL, interior=ink)
    return {
        "around the camera": lambda: make([], out, 1.0, camera_medium=ink),
        "around a wall": lambda: make(
            [quad([-9, -9, 2], [0, 18, 0], [18, 0, 0], 0.5)], out, 1.0, camera_medium=ink
        ),
        "behind a quad": lambda: make(
            [quad([-9, -9, 2], [0, 18, 0], [18, 0, 0], material=NULL, interior=ink)], out, 1.0
        ),
        "behind a disk": lambda: make(
            [disk([0, 0, 2], [0, 9, 0], [9, 0, 0], material=NULL, interior=ink)], out, 1.0
        ),
        "in a box without a lid": lambda: make([five], out, 1.0),
        "around a ball": lambda: make(
            [sphere([0, 0, 0], 1, material=NULL, exterior=ink)], out, 1.0
        ),
        "around an inward ball": lambda: make(
            [sphere([0, 0, 0], 1, inward=True, material=NULL, interior=ink)], out, 1.0
        ),
        "around a mesh": lambda: make([mesh], out, 1.0),
        "around a ball of itself": lambda: make([inner], out, 1.0, camera_medium=ink),
    }


@case(8, each={"where": endless(Medium(1.0))})
def media_without_an_end(t: Trial, where: str) -> None:
    """Ink around the camera, behind a quad or disk, in an open box, around balls; a sky of 1.

    A medium that nothing encloses is unbounded: the sky is exactly 0, for shadow rays too. Only a
    ball of ink around a camera in ink shows it, as e^-1: outside of the ball is a vacuum.
    """
    seen = endless(Medium(1.0))[where]()
    if where == "around a ball of itself":
        t.agrees(seen, math.exp(-1), 100_000, 0.03)
        return
    r = t.render(seen, 1000)
    t.check(not r.image.any(), f"the sky shines through: {r.image.ravel()}")
    t.check(not any(r.stats["ledger"]["escaped"]), "paths escape")


@case(8, each={"tree": [False, True]})
def layers_on_one_mirror(t: Trial, tree: bool) -> None:
    """Three boxes of ink, each within the last, with bottoms in the plane of a mirror; a sky of 1.

    The light goes through each layer twice: exp(-1.5); sees 2 %. If bottoms were in one place, rays
    would meet the inner box first, by its number, on both ways, and find the outer ink within it.
    """
    inks = [Medium(0.05)]
    layers = [box([-1, -1, 0], [1, 1, 3], False, material=NULL, interior=inks[0])]
    for k, sigma in enumerate((0.2, 0.5)):
        side = 0.8 - 0.2 * k
        inks.append(Medium(sigma))
        layers.append(box([-side, -side, 0], [side, side, 2.0 - k], False, material=NULL,
                          interior=inks[-1], exterior=inks[-2]))  # fmt: skip
    mirror = quad([-2, -2, 0], [4, 0, 0], [0, 4, 0], material=MIRROR)
    parts = [mirror, *layers[::-1], *fittings(True, tree)]
    seen = make(parts, camera([0.2, 0.1, 8], [0.2, 0.1, 0]), 1.0)
    t.check(("bvh" in t.native_scene(seen).features) == tree, "tree")
    t.agrees(seen, math.exp(-1.5), 400_000, 0.02)


@case(8, each={"form": ["cube", "ball"]})
def dense_fog_in_a_bright_room(t: Trial, form: str) -> None:
    """Fog of 200,000 free paths in a room of radiance 1, seen at 3 degrees to its surface.

    1 - H(0.05) sqrt(1 - albedo), Chandrasekhar; sees 2 %. Rounding puts 6 % of the first collisions
    on or beyond the surface, and their paths would go on in fog that fills the room. They are put
    back by 2^-22, a fortieth of a free path, which takes a tenth of their light at most: margin
    6e-3.
    """
    albedo, cosine = 0.5, 0.05
    fog = Medium(1e5, albedo)
    body = {"cube": box([-1, -1, -1], [1, 1, 1], False, material=NULL, interior=fog),
            "ball": sphere([0, 0, 0], 1, material=NULL, interior=fog)}[form]  # fmt: skip
    room = box([-5, -5, -5], [5, 5, 5], True, 0.0, 1.0)
    eye = camera([3 * math.sqrt(1 - cosine**2), 0, 1 + 3 * cosine], [0, 0, 1], 1e-3)
    exact = 1 - float(chandrasekhar(albedo, [cosine])[0]) * math.sqrt(1 - albedo)
    t.agrees(make([room, body], eye), exact, 100_000, 0.02, margin=6e-3)


@case(8, each={"angle": [40.0, 2.0, 0.5], "wall": ["null", "index 1"]})
def wedges_of_white_fog(t: Trial, angle: float, wall: str) -> None:
    """The sharp edge of a wedge of lossless fog in a tree, seen from close by, in a sky of 1.

    1 at every pixel. Rays that enter at the edge begin beyond the other face by rounding, up to 1
    in 3; they count as outside: no path is cut at 1,000 segments (exact). Sees 1 %.
    """
    h = math.tan(math.radians(angle) / 2)
    corners = [(x, y, z) for z in (-0.5, 0.5) for x, y in ((0, 0), (1, h), (1, -h))]
    hull = trimesh.convex.convex_hull(corners)
    turn = trimesh.transformations.rotation_matrix(0.6, [0.3, 1, 0.2])[:3, :3]
    fog = Part(hull.vertices @ turn.T, hull.faces, interior=Medium(0.7, 1.0),
               material=NULL if wall == "null" else material("dielectric", eta=1.0))  # fmt: skip
    aside = turn @ [-0.3, 3, 0.7]
    eye = camera(aside, [0, 0, 0], 2 * math.degrees(math.atan(5e-4 / 3.1)))
    seen = make([fog, *fittings(True, True)], eye, 1.0, 16, 16, max_depth=1000)
    r = t.agrees(seen, 1.0, 2000, 0.01, margin=1e-4)
    t.check(not any(r.stats["ledger"]["depth_cut"]), "paths never leave the medium")


@case(8, each={"distance": [4.0, 300.0], "tree": [False, True]})
def far_plane_in_fog(t: Trial, distance: float, tree: bool) -> None:
    """A cube of ink that the far plane cuts in halves, in a sky of 1: exp(-1). Sees 1 %."""
    ink = box([-1, -1, -1], [1, 1, 1], False, material=NULL, interior=Medium(1.0))
    eye = camera([0, 0, distance], [0, 0, 0], far_clip=distance)
    seen = make([ink, *fittings(True, tree)], eye, 1.0)
    t.agrees(seen, math.exp(-1.0), 100_000, 0.01)


@case(8, each={"sigma": [100.0, 1e4]})
def dense_fog_behind_glass(t: Trial, sigma: float) -> None:
    """A half space of fog of albedo 0.5 in walls of index 1, 20 units wide: H functions.

    Rays that enter begin 2^-20 of the numbers at the wall inside, up to 0.2 mean free paths;
    light that collides there does so at their end. Sees 1.2 %, and margin 2e-3.
    """
    albedo, cosine = 0.5, 0.6
    fog = box([-10, -10, -13], [10, 10, 7], False, material=material("dielectric", eta=1.0),
              interior=Medium(sigma, albedo))  # fmt: skip
    exact = 1 - float(chandrasekhar(albedo, [cosine])[0]) * math.sqrt(1 - albedo)
    eye = camera([3 * math.sqrt(1 - cosine**2), 0, 7 + 3 * cosine], [0, 0, 7])
    t.agrees(make([fog, *fittings(True, True)], eye, 1.0), exact, 1_000_000, 0.012, margin=2e-3)
