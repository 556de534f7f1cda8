"""Everyday geometry and sizes with exact answers: every seed draws new scenes.

Each case draws its scenes from the seed and lists them, with their parameters, in the report.
"""

from __future__ import annotations

from veriray_validate import everyday_forms
from veriray_validate.everyday import LOSSLESS, WAYS, ask, inlaid, nested, shining
from veriray_validate.everyday_bodies import (
    UNSEEN,
    folded,
    lossless,
    outline,
    past_the_horizon,
    smooth,
)
from veriray_validate.everyday_copies import copied
from veriray_validate.everyday_planes import glowing, level
from veriray_validate.everyday_scale import CLOSED
from veriray_validate.everyday_sheets import sheets
from veriray_validate.trial import Trial, case

FEW, MANY = 8, 150  # scenes of a quick and of a full case
KINDS = tuple(LOSSLESS)


@case(3, each={"lower": KINDS, "scenes": (10, 150)}, quick=lambda lower, scenes: scenes == 10)
def bodies_that_touch_are_not_seen(t: Trial, lower: str, scenes: int) -> None:
    """Boxes of eleven materials on, against, in and leaning on each other, among walls of 1: 1.

    Nothing absorbs light (a lamp is as bright as the walls), so pictures and 4 x 4 blocks of them
    are 1 within 1e-4; sees 2 % in each scene. Gaps of 0, 2^-24, 1e-7 ... 1e-3; rotated or not, of 6
    to 150 faces, with and without a tree. Nothing leaves the room except for the stated leaks at
    edges.
    """
    for k in range(scenes):
        ask(t, shining(t.rng, lower, KINDS[k % len(KINDS)], str(t.rng.choice(WAYS))))


@case(3, each={"scenes": (20, MANY)}, quick=lambda scenes: scenes == 20)
def bodies_within_bodies_are_not_seen(t: Trial, scenes: int) -> None:
    """Clear boxes on the floor, each with contents, all within 1e-6, among walls of 1: 1.

    Margin 1e-4; sees 2 % in each scene. No path goes on for ever.
    """
    for _ in range(scenes):
        ask(t, nested(t.rng))


@case(3, each={"scenes": (60, MANY)}, quick=lambda scenes: scenes == 60)
def bodies_within_lamps_are_not_seen(t: Trial, scenes: int) -> None:
    """Opaque boxes in lamps, so close that rays may meet either, turned, among walls of 1: 1.

    Margin 1e-4; sees 2 % in each scene.
    """
    for _ in range(scenes):
        ask(t, inlaid(t.rng))


@case(3, each={"lower": KINDS, "scenes": (10, 150)}, quick=lambda lower, scenes: scenes == 10)
def round_bodies_that_touch_are_not_seen(t: Trial, lower: str, scenes: int) -> None:
    """Balls, meshes, cylinders, turned boxes on, against, in and within each other, walls of 1: 1.

    On flat floors and on balls of radius 3 to 10,000. Margin 1e-4, of glass on a body of its form
    what `everyday_forms.coat` says; sees 2 % in each scene. Nothing leaves the room except for the
    stated leaks at edges.
    """
    for k in range(scenes):
        way = str(t.rng.choice(everyday_forms.WAYS))
        ask(t, everyday_forms.shining(t.rng, lower, KINDS[k % len(KINDS)], way))


@case(3, each={"scenes": (10, 60)}, quick=lambda scenes: scenes == 10)
def lamps_on_glass_are_not_seen(t: Trial, scenes: int) -> None:
    """Lamps of 1 that stand on bodies of glass on balls of radius 10 to 10,000, walls of 1: 1.

    Margin 1e-4; sees 2 % in each scene.
    """
    for _ in range(scenes):
        ask(t, everyday_forms.lamp_on_glass(t.rng))


@case(3, each={"scenes": (20, MANY)}, quick=lambda scenes: scenes == 20)
def balls_within_balls_are_not_seen(t: Trial, scenes: int) -> None:
    """Balls in clear balls that are larger by at most 1e-6, among walls of 1: 1.

    Margin 1e-4; sees 2 % in each scene.
    """
    for _ in range(scenes):
        ask(t, everyday_forms.balls(t.rng))


@case(3, each={"what": CLOSED, "scenes": (FEW, MANY)}, quick=lambda what, scenes: scenes == FEW)
def everyday_sizes(t: Trial, what: str, scenes: int) -> None:
    """Lamps, grounds, fogs and lenses, decades apart in size, by closed forms.

    The formula is in the function of `everyday_scale` by that name. Sees 2 % (half spaces 3 %,
    slabs 5 %) in each scene; margin 1e-3 (half spaces 1.5e-3, lenses a hundredth of a pixel).
    """
    for _ in range(scenes):
        ask(t, CLOSED[what](t.rng))


@case(3, each={"scenes": (FEW, MANY)}, quick=lambda scenes: scenes == FEW)
def bodies_without_loss_are_not_seen(t: Trial, scenes: int) -> None:
    """Glass, thin glass, fog, mirror: meshes of 8 to 8,192 faces, flat and smooth, a sky of 1: 1.

    Glass is flat. Sees 2 % in each scene, margin 1e-4.
    """
    for _ in range(scenes):
        ask(t, lossless(t.rng))


@case(3, each={"kind": (*UNSEEN, "thin glass")})
def smooth_bodies_are_not_seen(t: Trial, kind: str) -> None:
    """Clear bodies of 8 to 512 faces with interpolated normals, a sky of 1: 1.

    Sees 2 % in each of six scenes, margin 1e-4.
    """
    for _ in range(6):
        ask(t, smooth(t.rng, kind))


@case(3, each={"scenes": (FEW, MANY)}, quick=lambda scenes: scenes == FEW)
def smooth_glass_mirrors_past_its_horizon(t: Trial, scenes: int) -> None:
    """Glass whose interpolated normals send mirror images below its faces: these go along them.

    By Fresnel's equations. Sees 2 % in each scene, margin 2e-3.
    """
    for _ in range(scenes):
        ask(t, past_the_horizon(t.rng))


@case(3, each={"scenes": (FEW, MANY)}, quick=lambda scenes: scenes == FEW)
def folded_meshes_hold_their_fog(t: Trial, scenes: int) -> None:
    """White fog in smooth balls with folds, a sky of 1: 1, and no path goes on for ever.

    Sees 2 % in each scene, margin 1e-4, and paths in 10^7.
    """
    for _ in range(scenes):
        ask(t, folded(t.rng))


@case(3, each={"scenes": (FEW, MANY)}, quick=lambda scenes: scenes == FEW)
def outlines(t: Trial, scenes: int) -> None:
    """White convex bodies, black inside, under a sky of 1: 1, and no camera ray meets the inside.

    Cubes and meshes, stretched and sheared. Sees 2 % of the picture, and 1e-7 of the camera rays.
    """
    for _ in range(scenes):
        ask(t, outline(t.rng))


@case(3, each={"scenes": (FEW, MANY)}, quick=lambda scenes: scenes == FEW)
def lamps_under_covers(t: Trial, scenes: int) -> None:
    """Sheets of light over each other, most with a cover: the gap to it does not show, nor a tree.

    Gaps of 2e-6 to 1e-4. A covered lamp is not sampled, and blocks the light of the others. Sees
    5 % in each scene, margin 1e-3.
    """
    for _ in range(scenes):
        ask(t, sheets(t.rng))


@case(3, each={"scenes": (FEW, MANY)}, quick=lambda scenes: scenes == FEW)
def planes_through_the_origin(t: Trial, scenes: int) -> None:
    """White things whose planes pass 0, or 1e-17 to 1e-5, from the origin, under a sky of 1: 1.

    Bodies of 2,000 to 10,000 faces on boxes, balls over disks at the camera's height. Sees 2 % in
    each scene, margin 1e-4, and 1e-7 of the camera rays.
    """
    for _ in range(scenes):
        ask(t, level(t.rng))


@case(3, each={"scenes": (FEW, MANY)}, quick=lambda scenes: scenes == FEW)
def lamps_that_let_light_through(t: Trial, scenes: int) -> None:
    """Convex lamps of rough glass and the like, alone but for black specks: they show L itself.

    Squares, disks, balls and boxes. Sees 2 % in each scene, margin 1e-4.
    """
    for _ in range(scenes):
        ask(t, glowing(t.rng))


@case(3, each={"scenes": (FEW, MANY)}, quick=lambda scenes: scenes == FEW)
def lamps_twice_in_one_place(t: Trial, scenes: int) -> None:
    """Balls, disks, squares and boxes that shine, with copies in their place: the first is seen.

    Copies are black or shine in another way; of balls also a core or a shell, as close as 1e-9 of
    the radius, of which the larger is seen. As without what is hidden. Sees 5 % in each scene,
    margin 1e-3.
    """
    for _ in range(scenes):
        ask(t, copied(t.rng))
