"""Adaptive sampling: the number of samples of each pixel, by error.

It follows D. Kirk and J. Arvo, "Unbiased Sampling Techniques for Image Synthesis" (1991): samples
that decide how many more are drawn would bias the picture, since a tile that was dark by chance
stops early. So `PILOTS` samples per pixel decide the number for each tile, and none of them is in
the picture: that number and the samples of the picture are independent.
"""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, Any

import numpy as np
import numpy.typing as npt

from .units import LATE

if TYPE_CHECKING:
    from ._native import Film, Picture

Array = npt.NDArray[Any]

#: Samples per pixel that decide, by sampler; these of sobol are four groups (`veriray.units`).
PILOTS = {"independent": 16, "sobol": LATE}
#: Side in pixels of the tiles that they decide about.
TILE = 16
#: Factor on the samples that the pilot's variance asks for, which is off by a tenth, and by more
#: for rare light.
HEADROOM = 1.2
#: Share of the picture's mean that is added to the radiance to which the error is relative.
FLOOR = 0.1


def first_sample(spp: int) -> int:
    """Number of the picture's first sample, where a pixel has spp at most: a power of two, so that
    a tile's samples are a net of sampler sobol."""
    return 1 << (spp - 1).bit_length()


def samples_of_tiles(pilot: Film, target: float, spp: int) -> tuple[Array, int]:
    """Samples for each tile (int64), as many as the pilot's to spp, and how many tiles want more
    than spp."""
    least = pilot.samples
    wanted = tile_errors(*pilot.resolve()) * (HEADROOM * least / target**2)
    return np.minimum(_round_up(wanted, least), spp), int((wanted > spp).sum())


def per_pixel(tiles: Array, width: int, height: int) -> Array:
    """Expands numbers per tile to numbers per pixel."""
    whole: Array = tiles.repeat(TILE, axis=0).repeat(TILE, axis=1)[:height, :width]
    return whole


def facts_of(
    picture: Picture, counts: Array, target: float, pilot: int, first: int, beyond: int
) -> dict[str, Any]:
    """For `Render.stats` (see `veriray.render`). counts: samples by pixel; pilot: those of
    its pixels; beyond: of `samples_of_tiles`."""
    reached = np.sqrt(tile_errors(picture.image(), picture.stderr()))
    return {
        "target_error": target,
        "pilot_spp": pilot,
        "first_sample": first,
        "mean_spp": float(counts.mean(dtype=np.float64)),
        "tiles": int(reached.size),
        "tiles_at_limit": beyond,
        "tiles_above_target": int((reached > target).sum()),
        "tile_error": [float(x) for x in np.quantile(reached, (0.5, 0.9, 1.0))],
    }


def tile_errors(image: Array, stderr: Array) -> Array:
    """Squared relative standard error of each tile (float64).

    For a pixel it is the mean over channels of stderr^2 / (radiance^2 + (`FLOOR` times the
    picture's mean)^2); for a tile, the mean over its pixels. Sums are of integers, so every machine
    decides alike; scaling radiance by a power of two changes nothing.
    """
    height, width = image.shape[:2]
    mean, error = image.astype(np.float64), stderr.astype(np.float64)
    unit = 2.0 ** (math.frexp(float(np.abs(mean).max()))[1] - 32)
    dark = FLOOR * float((mean / unit).astype(np.int64).sum()) * unit / image.size
    scale = mean**2 + dark**2
    share = np.where(scale > 0, error**2 / np.where(scale > 0, scale, 1), 0)
    whole = np.minimum(share * 2.0**32, 2.0**52).astype(np.int64).sum(axis=2)
    down, right = np.arange(0, height, TILE), np.arange(0, width, TILE)
    sums = np.add.reduceat(np.add.reduceat(whole, down, axis=0), right, axis=1)
    sizes = np.outer(np.minimum(TILE, height - down), np.minimum(TILE, width - right))
    tiles: Array = sums / (3 * 2.0**32) / sizes
    return tiles


def _round_up(wanted: Array, least: int) -> Array:
    """The next number 2^k or 3 2^k from `least`, a power of two, on; int64."""
    part, exponent = np.frexp(np.clip(wanted, least, 2.0**61))  # part in [1/2, 1)
    power = np.ldexp(np.where(part == 0.5, 0.5, 1.0), exponent)
    return np.where((wanted <= 0.75 * power) & (power > least), 0.75 * power, power).astype(
        np.int64
    )
