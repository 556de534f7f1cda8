"""The number of samples of each pixel, and their sum: the same number everywhere, or by error.

Adaptive sampling follows D. Kirk and J. Arvo, "Unbiased Sampling Techniques for Image Synthesis"
(1991): samples that decide how many more are drawn would bias the picture, since a tile that was
dark by chance stops early. So `PILOT` samples per pixel decide the number for each tile, and none
of them is in the picture: that number and the samples of the picture are independent.
"""

from __future__ import annotations

import functools
import math
import time
from collections.abc import Callable
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any, TypeVar

import numpy as np
import numpy.typing as npt

from .device import Device, polled
from .picture import move_to_host
from .scene import Scene

if TYPE_CHECKING:
    from ._native import Film, Picture, Report
    from ._native import Scene as NativeScene

Array = npt.NDArray[Any]
Progress = Callable[[float], object] | None
T = TypeVar("T")

#: Samples per pixel that decide, and the side in pixels of the tiles that they decide about.
PILOT, TILE = 16, 16
#: Factor on the samples that the pilot's variance asks for, which is off by a tenth, and by more
#: for rare light.
HEADROOM = 1.2
#: Share of the picture's mean that is added to the radiance to which the error is relative.
FLOOR = 0.1


@dataclass
class Sampled:
    """Result of a sampling.

    picture: mean and standard error. counts: (H, W) uint32 samples by pixel, or None if all have
    the same number. results: reports of the native renders. memory: bytes of the film. facts: for
    `Render.stats`.
    """

    picture: Picture
    results: list[Report]
    memory: int
    paths: int
    batch_means: Array | None = None
    counts: Array | None = None
    facts: dict[str, Any] = field(default_factory=dict)


def with_room(device: Device, call: Callable[[], T], undo: Callable[[], object] | None = None) -> T:
    """The call's result. Where the device lacks memory, pictures make room and it is called again,
    after `undo`."""
    try:
        return call()
    except device.native.OutOfMemoryError:
        if not move_to_host():
            raise
        if undo:
            undo()
        return call()


class _Runs:
    """Native renders one after another, with a common progress."""

    def __init__(self, device: Device, held: NativeScene, scene: Scene, settings: dict[str, Any],
                 progress: Progress) -> None:  # fmt: skip
        self.device, self.held, self.settings, self.progress = device, held, settings, progress
        self.size = scene.film.width, scene.film.height
        self.results: list[Report] = []
        self.done, self.ahead = 0.0, 1.0  # paths

    def film(self) -> Film:
        native, index = self.device.native, self.device.index
        film: Film = with_room(self.device, lambda: native.Film(*self.size, device=index))
        return film

    def picture(self, film: Film, counts: Array | None = None) -> Picture:
        threads = self.settings["threads"]
        return with_room(self.device, lambda: film.picture(counts, threads))

    def render(self, film: Film, begin: int, end: int, pixels: Array | None = None) -> None:
        paths = (end - begin) * (self.size[0] * self.size[1] if pixels is None else len(pixels))

        def poll(share: float) -> None:
            if self.progress:
                self.progress(min((self.done + share * paths) / self.ahead, 1.0))

        start = time.perf_counter()
        result: Report = self.device.native.render(
            self.held, film, sample_begin=begin, sample_end=end, pixels=pixels,
            poll=polled(poll), **self.settings,
        )  # fmt: skip
        result["seconds"] = time.perf_counter() - start
        self.results.append(result)
        self.done += paths


def uniform(device: Device, held: NativeScene, scene: Scene, settings: dict[str, Any],
            progress: Progress, batches: int) -> Sampled:  # fmt: skip
    """The same samples of every pixel, in one piece or in `batches` pieces whose means are kept."""
    runs = _Runs(device, held, scene, settings, progress)
    (width, height), spp = runs.size, scene.spp
    runs.ahead = float(width * height * spp)
    size = spp // (batches or 1)
    total = runs.film()
    piece = runs.film() if batches else total
    means = np.empty((batches, height, width, 3)) if batches else None
    for k in range(batches or 1):
        first = k * size
        with_room(device, functools.partial(runs.render, piece, first, first + size), piece.clear)
        if means is not None:
            means[k] = piece.sums() / size
            total.add(piece)
            piece.clear()
    paths = width * height * spp
    return Sampled(runs.picture(total), runs.results, total.memory, paths, means)


def adaptive(device: Device, held: NativeScene, scene: Scene, settings: dict[str, Any],
             progress: Progress, target: float) -> Sampled:  # fmt: skip
    """As many samples as each tile needs for `target`, `PILOT` to the scene's spp a pixel."""
    runs = _Runs(device, held, scene, settings, progress)
    (width, height), spp = runs.size, scene.spp
    pilot = runs.film()
    runs.ahead = float(2 * PILOT * width * height)
    runs.render(pilot, 0, PILOT)
    wanted = tile_errors(*pilot.resolve()) * (HEADROOM * PILOT / target**2)
    tiles = np.minimum(_round_up(wanted), spp)
    counts = _spread(tiles, width, height)
    film, before = runs.film(), 0
    runs.ahead = float(runs.done + counts.sum(dtype=np.int64))
    # from a power of two on, so that a tile's samples are a net of sampler sobol
    first = 1 << (spp - 1).bit_length()
    for size in np.unique(tiles).tolist():
        pixels = np.flatnonzero(counts >= size).astype(np.uint32)
        runs.render(film, first + before, first + size, pixels)
        before = size
    picture = runs.picture(film, counts.astype(np.uint64))
    reached = np.sqrt(tile_errors(picture.image(), picture.stderr()))
    facts = {
        "target_error": target,
        "pilot_spp": PILOT,
        "first_sample": first,
        "mean_spp": float(counts.mean(dtype=np.float64)),
        "tiles": int(tiles.size),
        "tiles_at_limit": int((wanted > spp).sum()),
        "tiles_above_target": int((reached > target).sum()),
        "tile_error": [float(x) for x in np.quantile(reached, (0.5, 0.9, 1.0))],
    }
    return Sampled(
        picture, runs.results, film.memory, int(runs.done), None, counts.astype(np.uint32), facts
    )


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


def _round_up(wanted: Array) -> Array:
    """The next number 2^k or 3 2^k from `PILOT` on; int64."""
    part, exponent = np.frexp(np.clip(wanted, PILOT, 2.0**61))  # part in [1/2, 1)
    power = np.ldexp(np.where(part == 0.5, 0.5, 1.0), exponent)
    return np.where((wanted <= 0.75 * power) & (power > PILOT), 0.75 * power, power).astype(
        np.int64
    )


def _spread(tiles: Array, width: int, height: int) -> Array:
    """Expands numbers per tile to numbers per pixel."""
    whole: Array = tiles.repeat(TILE, axis=0).repeat(TILE, axis=1)[:height, :width]
    return whole
