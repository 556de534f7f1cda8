"""Pictures: batches of independent samples, in one process or several.

Random numbers: numpy's Philox with key (seed, batch); a batch is traced in chunks of fixed size,
so a picture depends on scene, settings, seed and the number of batches alone, not on processes.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator
from concurrent.futures import ProcessPoolExecutor
from dataclasses import dataclass
from multiprocessing import get_context

import numpy as np

from reference.integrator import Integrator
from reference.paths import COLUMNS
from reference.scene import Scene

_CHUNK = 1 << 15


@dataclass(frozen=True)
class Picture:
    """A finished render: linear radiance, float64.

    mean and stderr (standard error of the mean) (H, W, 3); batch_means (B, H, W, 3), each of
    spp / B samples; ledger (D, 9) uint64 with one row a segment and the columns of COLUMNS.
    """

    mean: np.ndarray
    stderr: np.ndarray
    batch_means: np.ndarray
    ledger: np.ndarray
    scene: Scene
    spp: int
    seed: int
    seconds: float


def render(
    scene: Scene,
    *,
    spp: int,
    seed: int = 0,
    batches: int = 64,
    processes: int = 1,
    progress: Callable[[int, int], None] | None = None,
) -> Picture:
    """Render ``spp`` samples a pixel in ``batches`` independent batches of equal size.

    progress(done, batches) is called after every batch. Memory: a fixed chunk of paths per
    process plus 9 float64 a pixel and batch. ValueError if spp is no multiple of batches.
    """
    if spp < 1 or batches < 1 or spp % batches:
        raise ValueError(f"spp {spp} must be a positive multiple of the batches ({batches})")
    if not 0 <= seed < 2**64:
        raise ValueError(f"seed {seed}, expected 0 to 2^64 - 1")
    start = time.perf_counter()
    shape = (scene.film.height, scene.film.width, 3)
    means, squares = np.empty((batches, *shape)), np.zeros(shape)
    ledger = np.zeros((0, len(COLUMNS)), np.uint64)
    jobs = [(seed, batch, spp // batches) for batch in range(batches)]
    for done, (batch, total, square, rows) in enumerate(_results(scene, jobs, processes), 1):
        means[batch] = total.T.reshape(shape) / (spp // batches)
        squares += square.T.reshape(shape)
        ledger = _add_rows(ledger, rows)
        if progress:
            progress(done, batches)
    mean = means.mean(axis=0)
    variance = np.maximum(squares / spp - mean**2, 0) / max(spp - 1, 1)
    return Picture(
        mean, np.sqrt(variance), means, ledger, scene, spp, seed, time.perf_counter() - start
    )


def _results(scene: Scene, jobs: list, processes: int) -> Iterator[tuple]:
    if processes == 1:
        _start(scene)
        yield from map(_batch, jobs)
        return
    with ProcessPoolExecutor(processes, get_context("spawn"), _start, (scene,)) as pool:
        futures = [pool.submit(_batch, job) for job in jobs]
        try:
            for future in futures:  # in order, so that sums are
                yield future.result()
        except BaseException:
            pool.shutdown(cancel_futures=True)
            raise


_integrator: Integrator


def _start(scene: Scene) -> None:
    global _integrator
    _integrator = Integrator(scene)


def _batch(job: tuple[int, int, int]) -> tuple[int, np.ndarray, np.ndarray, np.ndarray]:
    seed, batch, samples = job
    rng = np.random.Generator(np.random.Philox(key=np.array([seed, batch], np.uint64)))
    film = _integrator.scene.film
    pixels = film.width * film.height
    total, square = np.zeros((3, pixels)), np.zeros((3, pixels))
    ledger = np.zeros((0, len(COLUMNS)), np.uint64)
    for begin in range(0, pixels * samples, _CHUNK):
        pixel = np.arange(begin, min(begin + _CHUNK, pixels * samples)) % pixels
        radiance, rows = _integrator.paths(rng, pixel)
        for channel in range(3):
            total[channel] += np.bincount(pixel, radiance[channel], pixels)
            square[channel] += np.bincount(pixel, radiance[channel] ** 2, pixels)
        ledger = _add_rows(ledger, rows)
    return batch, total, square, ledger


def _add_rows(a: np.ndarray, b: np.ndarray) -> np.ndarray:
    longer, shorter = (a, b) if len(a) >= len(b) else (b, a)
    out = longer.copy()
    out[: len(shorter)] += shorter
    return out
