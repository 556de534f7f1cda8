"""Stress by everyday geometry and sizes: pairs of scenes with one mean, drawn with every seed.

Both scenes of a pair have the same batches and random numbers; a t test over the differences of
batches judges the picture and 4 x 4 blocks of it, within margins that the generators derive.
"""

from __future__ import annotations

import tempfile
from pathlib import Path

from veriray_validate import everyday_forms, everyday_heaps
from veriray_validate.everyday import LOSSY, WAYS, ask, lifted
from veriray_validate.everyday_bodies import explicit, files, mirrored, unseen
from veriray_validate.everyday_media import PLACES, walled
from veriray_validate.everyday_scale import PAIRS
from veriray_validate.trial import Trial, case

FEW, MANY = 8, 150  # scenes of a quick and of a full case
KINDS = tuple(LOSSY)


@case(8, each={"lower": KINDS, "scenes": (10, 100)}, quick=lambda lower, scenes: scenes == 10)
def bodies_that_touch_and_that_nearly_do(t: Trial, lower: str, scenes: int) -> None:
    """Boxes of eleven materials on, against, in and leaning on each other, lit in a grey room.

    Any gap of 1e-4 or less gives the picture with a gap of 1e-4, made without a tree, unrotated and
    with 6 quads. Margin 1e-3, for a block 1.6e-2; sees 5 % of a picture. Nothing leaves the room
    except for the stated leaks at edges.
    """
    for k in range(scenes):
        ask(t, lifted(t.rng, lower, KINDS[k % len(KINDS)], str(t.rng.choice(WAYS))))


@case(8, each={"lower": KINDS, "scenes": (4, 50)}, quick=lambda lower, scenes: scenes == 4)
def round_bodies_that_touch_and_that_nearly_do(t: Trial, lower: str, scenes: int) -> None:
    """Balls, meshes, cylinders and turned boxes, as `bodies_that_touch_and_that_nearly_do`.

    Any gap of 1e-4 or less gives the picture with a gap of 1e-4; sees 5 %.
    """
    for _ in range(scenes):
        way = str(t.rng.choice(everyday_forms.WAYS))
        ask(t, everyday_forms.lifted(t.rng, lower, str(t.rng.choice(KINDS)), way))


@case(8, each={"scenes": (10, 100)}, quick=lambda scenes: scenes == 10)
def heaps_of_sheets_and_bodies(t: Trial, scenes: int) -> None:
    """Sheets on a floor and bodies within bodies on them, by different meshes, most in contact.

    The picture is that with gaps of 1e-4, undivided and unturned. Margin 1e-3; sees 5 %.
    """
    for _ in range(scenes):
        ask(t, everyday_heaps.heap(t.rng))


@case(8, each={"scenes": (2, 40)}, quick=lambda scenes: scenes == 2)
def bodies_on_planets_with_something_inside(t: Trial, scenes: int) -> None:
    """Clear bodies on balls of radius 100 to 30,000, an opaque body at their bottom.

    The picture with any gap is that with a gap of 1e-4. Sees 5 %.
    """
    for _ in range(scenes):
        ask(t, everyday_forms.on_a_planet(t.rng))


@case(8, each={"what": PAIRS, "scenes": (FEW, MANY)}, quick=lambda what, scenes: scenes == FEW)
def sizes_that_do_not_matter(t: Trial, what: str, scenes: int) -> None:
    """Things out of sight, a ground beyond 1,000, a camera beyond 1,000: the same picture.

    Sees 2 % (fog) to 6 % (rooms from afar) in each scene.
    """
    for _ in range(scenes):
        ask(t, PAIRS[what](t.rng))


@case(8, each={"scenes": (FEW, MANY)}, quick=lambda scenes: scenes == FEW)
def invisible_bodies(t: Trial, scenes: int) -> None:
    """Null, index 1 or opacity 0, in front, around the camera or around all: as without them.

    Meshes of 8 to 80,000 faces, flat and smooth, cubes and spheres; under a sky of 1 (margin 1e-4,
    sees 2 %) and before a lit scene (margin 3e-4, sees 5 %).
    """
    for _ in range(scenes):
        ask(t, unseen(t.rng))


@case(8, each={"scenes": (FEW, MANY)}, quick=lambda scenes: scenes == FEW)
def mirrored_bodies(t: Trial, scenes: int) -> None:
    """Symmetric bodies under a transform that mirrors: the picture without the mirror.

    Cubes, spheres, PLY and OBJ, flat and smooth; fog, glass, plastic, lamps. Sees 5 %.
    """
    with tempfile.TemporaryDirectory() as name:
        files(Path(name))
        draw = mirrored(Path(name))
        for _ in range(scenes):
            ask(t, draw(t.rng))


@case(8, each={"scenes": (FEW, MANY)}, quick=lambda scenes: scenes == FEW)
def sheared_bodies(t: Trial, scenes: int) -> None:
    """Emitting rectangles, disks and cubes by a sheared or mirrored matrix, and by their points.

    The same picture; sees 5 %.
    """
    for _ in range(scenes):
        ask(t, explicit(t.rng))


@case(8, each={"place": PLACES, "scenes": (2, 40)}, quick=lambda place, scenes: scenes == 2)
def fog_in_walls_that_no_light_passes_straight(t: Trial, place: str, scenes: int) -> None:
    """Balls, cubes and meshes of fog in walls of index 1: the picture with walls of nothing.

    Light samples that walls stop are not traced; those to lamps inside, or through a wall that is
    open, must be. Sees 5 %.
    """
    for _ in range(scenes):
        ask(t, walled(t.rng, place))
