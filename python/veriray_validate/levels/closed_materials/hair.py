"""A plate of hair against its formulas in float64 (../../hair.py).

Hair is for curves, and seen from within it is not there; a plate has one side, and what goes
through leaves below it.
"""

from __future__ import annotations

import itertools
import math
import warnings
from typing import Any

import numpy as np
import numpy.typing as npt

import veriray
from veriray.columns import MATERIAL_KINDS
from veriray_validate.dicts import BLACK, Dict, flat, rgb, scene, sky, sphere, view
from veriray_validate.hair import Fibre, light, lobes
from veriray_validate.trial import Trial, case

Array = npt.NDArray[Any]
ABSORPTION = (0.1, 0.5, 2.0)
#: Directions of the fibres' tops as seen, in degrees from the normal and from x towards y; fibres
#: lie along y.
VIEWS = ((0, 0), (40, 0), (40, 90), (75, 60))


def towards(angle: float, turn: float) -> Array:
    """The unit vector of two angles in degrees."""
    a, b = math.radians(angle), math.radians(turn)
    return np.array([math.sin(a) * math.cos(b), math.sin(a) * math.sin(b), math.cos(a)])


def plate(wo: Array, *lights: Dict, **given: Any) -> tuple[veriray.Scene, Fibre]:
    """One pixel that sees a plate of hair along wo, and the numbers of its material."""
    bsdf = {"type": "hair", "sigma_a": rgb(ABSORPTION), **given}
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", veriray.SceneWarning)
        ground = flat("rectangle", [0, 0, 0], [0, 0, 1], 100, bsdf)
        made = scene(view(5 * wo, [0, 0, 0], 1e-4), ground, *lights)
    row = made.material_kind.tolist().index(MATERIAL_KINDS.index("hair"))
    numbers = (getattr(made, f"hair_{name}")[row] for name in ("along", "around", "tilt"))
    red, green, blue = map(float, made.k[row])
    return made, Fibre((red, green, blue), float(made.eta[row, 0]), *map(float, numbers))


@case(3, each={"seen": VIEWS, "lit": ("sky", "lamp")})
def hair_in_even_light(t: Trial, seen: tuple[int, int], lit: str) -> None:
    """In even light of radiance 1 hair shows the shares of all its lobes, by colour.

    Directions are drawn for the material alone (sky), or light samples compete with them. Sees 1 %.
    """
    around = {"sky": sky(1), "lamp": sphere([0, 0, 0], 1000, BLACK, 1.0, flip_normals=True)}
    wo = towards(*seen)
    made, fibre = plate(wo, around[lit])
    t.agrees(made, light(fibre, wo).sum(axis=0), 100_000, sees=0.01)


@case(3, each={"seen": VIEWS, "given": ("default", "wide", "tilted")})
def hair_in_the_sun(t: Trial, seen: tuple[int, int], given: str) -> None:
    """Lit from one direction, hair shows f cos, above and through it.

    Six directions, without noise: within 1e-4 of it and of 1e-4 of the largest.
    """
    numbers: Dict = {
        "default": {},
        "wide": {"longitudinal_roughness": 0.8, "azimuthal_roughness": 0.6},
        "tilted": {"scale_tilt": -6.0, "int_ior": 1.8},
    }[given]
    wo, pairs = towards(*seen), []
    for angle, turn in itertools.product((20, 60, 130), (30, 250)):
        wi = towards(angle, turn)
        sun = {"type": "directional", "direction": (-wi).tolist(), "irradiance": rgb(1)}
        made, fibre = plate(wo, sun, **numbers)
        pairs.append((t.render(made, 16).image[0, 0], lobes(fibre, wo, wi[None])[0][0]))
    found, told = (np.array(x) for x in zip(*pairs, strict=True))
    off = np.abs(found - told) / np.maximum(told, 1e-4 * told.max())
    t.check(off < 1e-4, f"off by {off.max():.2g}")
