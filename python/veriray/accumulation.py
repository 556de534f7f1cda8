"""Pictures that grow: samples are added pass by pass, and each state of them is a whole picture.

The film after N samples a pixel does not depend on the passes that they came in, so that its hash
is that of `veriray.render` with N samples (see `veriray.sampling` for `target_error`).

    >>> work = Accumulation(veriray.cornell_box(), device="cpu")
    >>> work.add(16)
    >>> work.add(48)
    >>> work.render().film_sha256 == veriray.render(veriray.cornell_box(), 64).film_sha256
    True
"""

from __future__ import annotations

import functools
import math
import time
import warnings
from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Any

import numpy as np
import numpy.typing as npt

from . import device as device_module
from . import kernels
from .checkpoint import Checkpoint
from .device import polled
from .errors import CheckpointError, RefusedSamplesWarning
from .native_scene import native_scene, scene_facts
from .numeric import shown, whole
from .picture import Render, with_room
from .plan import choose_scheduler, settle
from .reports import added, refused_text, statistics
from .sampling import PILOT, facts_of, first_sample, per_pixel, samples_of_tiles
from .scene import Scene
from .settings import MAX_SPP, RenderSettings

if TYPE_CHECKING:
    from ._native import Film, Report

Array = npt.NDArray[Any]
Progress = Callable[[float], object] | None


@dataclass(frozen=True)
class Kept:
    """What an accumulation has. It is replaced as a whole after each pass, so that an interrupt
    leaves the state before or after one.

    film: None without samples. spp: samples of each pixel in it, or less where `tiles` wants less.
    paths, report: of all that was done. tiles: samples that each tile gets, None where all pixels
    have the same number, and until the pilot is complete; beyond: how many of them want more.
    """

    film: Film | None = None
    spp: int = 0
    paths: int = 0
    report: Report | None = None
    tiles: Array | None = None
    beyond: int = 0


class Accumulation:
    """A picture to which samples are added.

    Args:
        scene: from `load_file`, `load_dict` or `cornell_box`.
        first: number of its first sample: of a range of a picture's samples, which `checkpoint`
            then gives (`Checkpoint.merged`). 0 with batches and with target_error.
        progress: called while a tree is built over a large mesh, with the fraction done.
        settings: as of `veriray.render`. spp says how many samples a pixel `left` counts to, and
            helps "auto" to choose a scheduler and a builder; None takes the scene's.

    A pass that is interrupted, by Ctrl-C or by an exception of its progress callback, leaves no
    trace: the next one draws its samples again. One thread at a time may use an accumulation; the
    progress callback may ask it for its picture. Memory: a film, and another one from the second
    pass on until `left` is 0.

    Raises as `veriray.render`, before any sample is drawn.
    """

    def __init__(
        self, scene: Scene, *, first: int = 0, progress: Progress = None, **settings: Any
    ) -> None:
        given = RenderSettings(**settings)
        if given.features or given.feature_spp is not None:
            raise ValueError("features and feature_spp are settings of veriray.render alone")
        self._begin(scene, given, progress, first)

    @classmethod
    def _of(
        cls, scene: Scene, settings: RenderSettings, progress: Progress, first: int = 0
    ) -> Accumulation:
        made = object.__new__(cls)
        made._begin(scene, settings, progress, first)
        return made

    def _begin(
        self, scene: Scene, settings: RenderSettings, progress: Progress, first: int
    ) -> None:
        if progress is not None and not callable(progress):
            raise ValueError(f"progress = {shown(progress)} is not callable")
        used, settings = settle(scene, settings)
        bound = settings.batches or settings.target_error is not None
        most = 0 if bound else MAX_SPP - used.spp
        self._first = whole("first", first, 0, most, error=ValueError)
        self.device, self._reason = device_module.select(settings.device, fresh=False)
        device, builder = self.device, settings.builder
        with device_module.native_errors():
            self._native = with_room(
                device, lambda: native_scene(scene, used, device, progress, builder, used.spp)
            )
            self._facts = scene_facts(self._native)
            scheduler, self._why = choose_scheduler(settings, device.backend, self._facts)
            self._settings = settings.with_checked({"scheduler": scheduler, "device": device.name})
            if device.backend == "cuda" and not settings.all_features:
                paths = used.film.width * used.film.height * used.spp
                kernels.offer(device, self._native, scheduler, paths)
        self._scene = used
        self._size = used.film.width, used.film.height
        self._kept = Kept()
        self._means: Array | None = None
        self._spare: Film | None = None

    @property
    def settings(self) -> RenderSettings:
        """The settings that it runs with."""
        return self._settings

    @property
    def spp(self) -> int:
        """Samples of each pixel in the picture; of those with most, with target_error."""
        return 0 if self._deciding else self._kept.spp

    @property
    def paths(self) -> int:
        """Paths that were traced, of the pilot too."""
        return self._kept.paths

    @property
    def left(self) -> int:
        """Samples per pixel that `add` can take at once on the way to the `spp` asked for; 0 when
        it is reached. Less than all that are missing with batches and with target_error."""
        kept, settings = self._kept, self._settings
        if self._deciding:
            return PILOT - kept.spp
        if kept.tiles is not None:
            larger = kept.tiles[kept.tiles > kept.spp]
            return int(larger.min()) - kept.spp if larger.size else 0
        missing = max(self._scene.spp - kept.spp, 0)
        return min(missing, self._batch) if settings.batches else missing

    @property
    def paths_left(self) -> int:
        """Paths until the `spp` asked for, or with target_error the target, is reached; as far as
        known while the pilot is drawn."""
        kept = self._kept
        if kept.tiles is not None:
            return int(np.maximum(self._counts - kept.spp, 0).sum(dtype=np.int64))
        goal = 2 * PILOT if self._deciding else self._scene.spp
        return self.paths_of(max(goal - kept.spp, 0))

    def paths_of(self, n: int) -> int:
        """Paths that `add(n)` traces."""
        n = whole("n", n, 0, MAX_SPP, error=ValueError)
        if self._kept.tiles is None:
            return n * self._size[0] * self._size[1]
        return n * int(np.count_nonzero(self._counts > self._kept.spp))

    @property
    def _counts(self) -> Array:
        """Samples that each pixel gets, of an adaptive picture."""
        assert self._kept.tiles is not None
        return per_pixel(self._kept.tiles, *self._size)

    @property
    def _deciding(self) -> bool:
        """Whether samples decide about their number, and do not go into the picture."""
        return self._settings.target_error is not None and self._kept.tiles is None

    @property
    def _bound(self) -> bool:
        """Whether the samples depend on the spp asked for."""
        return bool(self._settings.batches) or self._settings.target_error is not None

    @property
    def _batch(self) -> int:
        """Samples per pixel of a batch, whose mean is kept."""
        return self._scene.spp // self._settings.batches

    def add(self, n: int, progress: Progress = None) -> None:
        """Draw the next n samples of every pixel.

        With target_error those of the pixels that want them: first of the pilot, and n is at most
        `left`. With batches, n is the size of a batch.

        progress: called on this thread about every 50 ms with the fraction of the n that is done.
        Raises ValueError for an n that is not so, and as `veriray.render`; then nothing is added.
        """
        kept, settings = self._kept, self._settings
        most = self.left if self._bound else MAX_SPP - self._first - kept.spp
        n = whole("n", n, 1, most, error=ValueError)
        if settings.batches and n != self._batch:
            raise ValueError(f"n = {n}; with batches = {settings.batches} it is {self._batch}")
        if progress is not None and not callable(progress):
            raise ValueError(f"progress = {shown(progress)} is not callable")
        begin, pixels = self._first + kept.spp, None
        if kept.tiles is not None:
            begin += first_sample(self._scene.spp)
            pixels = np.flatnonzero(self._counts > kept.spp).astype(np.uint32)
        with device_module.native_errors():
            film, report = self._pass(begin, n, pixels, progress)
            if settings.batches:
                self._keep_mean(film, kept.spp // n)
            if kept.film is not None:
                film.add(kept.film)
            after = replace(
                kept, film=film, spp=kept.spp + n, paths=kept.paths + self.paths_of(n),
                report=added(kept.report, report),
            )  # fmt: skip
            target = settings.target_error
            if target is not None and kept.tiles is None and after.spp == PILOT:
                tiles, beyond = samples_of_tiles(film, target, self._scene.spp)
                after = replace(after, film=None, spp=0, tiles=tiles, beyond=beyond)
                self._spare = film
        if self._kept is not kept:
            raise RuntimeError("a pass was added while another one ran")
        self._kept = after
        if kept.film is not None:
            self._spare = kept.film
        if not self.left:  # two films are more than a finished picture needs
            self._spare = None

    def _pass(
        self, begin: int, n: int, pixels: Array | None, progress: Progress
    ) -> tuple[Film, Report]:
        """A film of n samples of these pixels, and what the render says."""
        device, (film, self._spare) = self.device, (self._spare, None)
        if film is None:
            native = device.native
            film = with_room(device, lambda: native.Film(*self._size, device=device.index))
        else:
            film.clear()
        start = time.perf_counter()
        draw = functools.partial(
            device.native.render, self._native, film, sample_begin=begin, sample_end=begin + n,
            pixels=pixels, poll=polled(progress), **self._settings.native(),
        )  # fmt: skip
        report: Report = with_room(device, draw, film.clear)
        report["seconds"] = time.perf_counter() - start
        return film, report

    def _keep_mean(self, batch: Film, k: int) -> None:
        if self._means is None:
            width, height = self._size
            self._means = np.empty((self._settings.batches, height, width, 3))
        self._means[k] = batch.sums() / batch.samples

    def _identity(self) -> dict[str, Any]:
        """What the samples depend on (`Checkpoint.render`)."""
        names = "seed", "sampler", "width", "height", "max_depth", "rr_depth", "target_error"
        return {
            "version": _version(),
            "scene_sha256": self._scene.sha256,
            **{name: getattr(self._settings, name) for name in (*names, "batches")},
            "spp": self._scene.spp if self._bound else None,
        }

    def checkpoint(self) -> Checkpoint:
        """What is there, exactly, to go on with elsewhere or later.

        Raises ValueError if no sample was drawn yet.
        """
        kept = self._kept
        if kept.report is None:
            raise ValueError("no samples to keep yet: add some first")
        with device_module.native_errors():
            film = None if kept.film is None else kept.film.state()
        means = None
        if self._settings.batches:
            assert self._means is not None
            means = self._means[: kept.spp // self._batch].copy()
        return Checkpoint(
            render=self._identity(), first=self._first, spp=kept.spp, paths=kept.paths,
            report=kept.report, film=film, tiles=kept.tiles, beyond=kept.beyond, means=means,
            machine={
                "device": self.device.name,
                "device_name": self.device.description,
                "scheduler": str(self._settings.scheduler),
            },
        )  # fmt: skip

    def resume(self, checkpoint: Checkpoint) -> None:
        """Take over what a checkpoint holds, of any device; its samples count as added here.

        Raises CheckpointError, and nothing is changed, if it is of another render or range (the
        message names what differs) or has more samples than the spp asked for; RuntimeError if
        there are samples already.
        """
        given = checkpoint
        if not isinstance(given, Checkpoint):
            raise TypeError(f"checkpoint is {type(given).__name__}, expected a Checkpoint")
        if self._kept.report is not None:
            raise RuntimeError("there are samples already: resume before any is added")
        if differences := given._differences(self._identity()):
            raise CheckpointError(f"{given}: of another render: {differences}")
        if given.first != self._first:
            raise CheckpointError(f"{given}: its first sample is {given.first}, not {self._first}")
        if given.spp > self._scene.spp:
            raise CheckpointError(
                f"{given}: it has {given.spp} samples per pixel, more than spp = {self._scene.spp}"
            )
        with device_module.native_errors():
            film = with_room(self.device, lambda: given._film_on(self.device))
        if given.means is not None:
            self._means = np.empty((self._settings.batches, *given.means.shape[1:]))
            self._means[: len(given.means)] = given.means
        self._kept = Kept(
            film=film, spp=given.spp, paths=given.paths, report=given.report, tiles=given.tiles,
            beyond=given.beyond,
        )  # fmt: skip

    def render(self) -> Render:
        """The picture of the samples that are there, as `veriray.render` gives it.

        Raises ValueError if there are none yet, or if its first sample is not 0; warns as
        `veriray.render`.
        """
        return self._render(3)

    def _render(self, level: int | None = None) -> Render:
        """`render`; level: of the stack whose line a warning names, None for no warning."""
        kept, settings, used = self._kept, self._settings, self._scene
        film, report = kept.film, kept.report
        if film is None or report is None or self._deciding:
            raise ValueError("the picture has no samples yet: add some first")
        if self._first:
            raise ValueError(f"samples 0:{self._first} are missing: merge checkpoints of all")
        counts = None
        if kept.tiles is not None:
            counts = np.minimum(self._counts, kept.spp).astype(np.uint64)
        with device_module.native_errors():
            threads = settings.native()["threads"]
            picture = with_room(self.device, lambda: film.picture(counts, threads))
            error = float(picture.mean_stderr)
            memory = int(self._native.memory) + int(film.memory)
            complete = kept.tiles is not None and not self.left
            stats = {
                **self._facts,
                **statistics(report, kept.paths),
                "device_name": self.device.description,
                "device_reason": self._reason,
                "scheduler_reason": self._why,
                **settings.kept(),
                "spp": used.spp if complete else kept.spp,
                "memory": memory,
                "scene_sha256": used.sha256,
                "version": _version(),
                "mean_stderr": error if math.isfinite(error) else None,
            }
            if counts is not None and settings.target_error is not None:
                first = first_sample(used.spp)
                stats |= facts_of(picture, counts, settings.target_error, first, kept.beyond)
        if level is not None and stats["nonfinite_samples"]:
            warnings.warn(refused_text(stats), RefusedSamplesWarning, stacklevel=level)
        return Render._of(
            picture,
            batch_means=self._batch_means(),
            stats=stats,
            width=self._size[0],
            height=self._size[1],
            spp=stats["spp"],
            seed=settings.seed,
            samples=None if counts is None else counts.astype(np.uint32),
        )

    def _batch_means(self) -> Array | None:
        """Means of the batches that are complete, if there are at least two."""
        if self._means is None or (count := self._kept.spp // self._batch) < 2:
            return None
        return self._means if count == len(self._means) else self._means[:count].copy()


def _version() -> str:
    from . import __version__

    return __version__
