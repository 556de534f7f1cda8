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

import copy
import functools
import math
import warnings
from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Any, NoReturn

import numpy as np
import numpy.typing as npt

from . import device as device_module
from .checkpoint import Checkpoint
from .crew import Crew, Films
from .errors import CheckpointError, RefusedSamplesWarning
from .held import with_room
from .numeric import shown, whole
from .picture import Render
from .plan import settle
from .reports import added, refused_text, statistics
from .sampling import PILOTS, facts_of, first_sample, per_pixel, samples_of_tiles
from .scene import Scene
from .settings import MAX_SPP, RenderSettings
from .units import GROUP, LATE, unit_begin

if TYPE_CHECKING:
    from ._native import Film, FilmState, Report
    from .cluster import Cluster

Array = npt.NDArray[Any]
Progress = Callable[[float], object] | None


@dataclass(frozen=True)
class Kept:
    """What an accumulation has. It is replaced as a whole after each pass, so that an interrupt
    leaves the state before or after one.

    films: exact sums, of each place of the crew (`veriray.crew`); () without samples. spp: samples
    of each pixel in them and in `tail`, or less where `tiles` wants less.
    tail: of sampler sobol, those of a group that is not complete (`veriray.units`). Before there
    are LATE samples, all of them are in `films`, squared one by one, and again in groups: in
    `groups`, and in `tail`.
    paths, report: of all that was done. tiles: samples that each tile gets, None where all pixels
    have the same number, and until the pilot is complete; beyond: how many of them want more.
    """

    films: Films = ()
    groups: Films = ()
    tail: Films = ()
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
            then gives (`Checkpoint.merged`). 0 with batches and with target_error; with sampler
            sobol a multiple of 16.
        progress: called while a tree is built over a large mesh, with the fraction done.
        settings: as of `veriray.render`. spp says how many samples a pixel `left` counts to, and
            helps "auto" to choose a scheduler and a builder; None takes the scene's.

    A pass that is interrupted, by Ctrl-C or by an exception of its progress callback, leaves no
    trace: the next one draws its samples again; but on a cluster the first Ctrl-C ends a pass with
    the samples that were given out, before KeyboardInterrupt is raised. One thread at a time may
    use an accumulation; the progress callback may ask it for its picture. Memory: a film for each
    device, and another one from the second pass on until `left` is 0; with sampler sobol up to
    three more, before there are 64 samples and while a group of 16 is not complete.

    Raises as `veriray.render`, before any sample is drawn.
    """

    def __init__(
        self, scene: Scene, *, first: int = 0, progress: Progress = None, **settings: Any
    ) -> None:
        given = RenderSettings(**settings)
        alone = ("features", "feature_spp", "light_groups", "motion_to")
        if any(getattr(given, name) not in (None, ()) for name in alone):
            raise ValueError(f"{', '.join(alone)} are settings of veriray.render alone")
        self._begin(scene, given, progress, first)

    @classmethod
    def _of(
        cls, scene: Scene, settings: RenderSettings, progress: Progress, first: int = 0,
        last: bool = False,
    ) -> Accumulation:  # fmt: skip
        """last: all samples that are `left` are drawn at once, and no more."""
        made = object.__new__(cls)
        made._begin(scene, settings, progress, first, last)
        return made

    def _begin(
        self, scene: Scene, settings: RenderSettings, progress: Progress, first: int,
        last: bool = False,
    ) -> None:  # fmt: skip
        if progress is not None and not callable(progress):
            raise ValueError(f"progress = {shown(progress)} is not callable")
        used, settings = settle(scene, settings)
        bound = settings.batches or settings.target_error is not None
        most = 0 if bound else MAX_SPP - used.spp
        self._first = whole("first", first, 0, most, error=ValueError)
        self._units = settings.sampler == "sobol"
        if self._units and unit_begin(first) != first:
            raise ValueError(f"first = {first}; with sampler sobol it is a multiple of 16")
        with device_module.native_errors():
            self._crew = _crew(scene, used, settings, progress)
        self._scene = used
        self._size = used.film.width, used.film.height
        self._kept = Kept()
        self._last = last
        self._means: Array | None = None

    def __repr__(self) -> str:
        width, height = self._size
        asked, seed = self._scene.spp, self.settings.seed
        return (
            f"<Accumulation {width} x {height}, {self.spp} of {asked} spp, seed {seed}, "
            f"on {self.settings.device}>"
        )

    def __reduce__(self) -> NoReturn:
        raise TypeError("an Accumulation is not copied: keep its checkpoint() and resume another")

    @property
    def device(self) -> device_module.Device:
        """The device on which pictures are made: the first of several that has the memory."""
        return self._crew.device

    @property
    def least(self) -> int:
        """Samples per pixel of a pass that gives each device something to do."""
        return self._crew.least

    @property
    def pass_seconds(self) -> float:
        """How long a pass lasts best: on a cluster, the nodes' films are joined after it."""
        return self._crew.seconds

    def close(self) -> None:
        """Ends the workers on a cluster; what is there stays. Does nothing without a cluster."""
        self._crew.close()

    @property
    def settings(self) -> RenderSettings:
        """The settings that it runs with."""
        return self._crew.settings

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
        kept, settings = self._kept, self.settings
        if self._deciding:
            return self._pilot - kept.spp
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
        goal = 2 * self._pilot if self._deciding else self._scene.spp
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
        return self.settings.target_error is not None and self._kept.tiles is None

    @property
    def _pilot(self) -> int:
        """Samples per pixel that decide, with target_error."""
        return PILOTS[str(self.settings.sampler)]

    @property
    def _bound(self) -> bool:
        """Whether the samples depend on the spp asked for."""
        return bool(self.settings.batches) or self.settings.target_error is not None

    @property
    def _batch(self) -> int:
        """Samples per pixel of a batch, whose mean is kept."""
        return self._scene.spp // self.settings.batches

    def add(self, n: int, progress: Progress = None) -> None:
        """Draw the next n samples of every pixel.

        With target_error those of the pixels that want them: first of the pilot, and n is at most
        `left`. With batches, n is the size of a batch.

        progress: called on this thread about every 10 ms with the fraction of the n that is done.
        Raises ValueError for an n that is not so, and as `veriray.render`; then nothing is added.
        """
        kept, settings = self._kept, self.settings
        most = self.left if self._bound else MAX_SPP - self._first - kept.spp
        n = whole("n", n, 1, most, error=ValueError)
        if settings.batches and n != self._batch:
            raise ValueError(f"n = {n}; with batches = {settings.batches} it is {self._batch}")
        if progress is not None and not callable(progress):
            raise ValueError(f"progress = {shown(progress)} is not callable")
        origin, pixels = self._first, None
        if kept.tiles is not None:
            origin += first_sample(self._scene.spp)
            pixels = np.flatnonzero(self._counts > kept.spp).astype(np.uint32)
        crew, after, stopped = self._crew, kept, False
        sums = list[Array]()
        late = self._late(kept.spp + n)
        if late and kept.films and not self._late(kept.spp) and self._units:
            after = replace(kept, films=kept.groups, groups=())
        used = list[Films]()
        with device_module.native_errors():
            for low, high in self._parts(kept.spp, kept.spp + n, late):
                part = _part(progress, low - kept.spp, high - low, n)
                films, report, drawn, stopped = crew.draw(
                    origin + low, high - low, pixels, late and self._units, part
                )
                if settings.batches:
                    if drawn < high - low:
                        raise KeyboardInterrupt
                    batch = crew.merged(films)
                    assert batch is not None
                    sums.append(batch.sums())
                used.append(films)
                after = replace(
                    self._joined(after, films, low + drawn, late), paths=after.paths
                    + drawn * crew.paths_of(pixels), report=added(after.report, report),
                )  # fmt: skip
                if drawn < high - low:
                    break
            if settings.batches:
                self._keep_mean(kept.spp // n, sum(sums[1:], sums[0]) / n)
            if self._kept is not kept:
                raise RuntimeError("a pass was added while another one ran")
            target = settings.target_error
            if target is not None and kept.tiles is None and after.spp == self._pilot:
                pilot = crew.merged(after.films)
                assert pilot is not None
                tiles, beyond = samples_of_tiles(pilot, target, self._scene.spp)
                after = replace(after, films=(), spp=0, tiles=tiles, beyond=beyond)
        self._kept = after  # an interrupt before this leaves all films of `kept` as they are
        for unused in (*used, kept.films, kept.groups, kept.tail):
            crew.reuse(unused, (*after.films, *after.groups, *after.tail))
        if not self.left:  # two films are more than a finished picture needs
            crew.release()
        if stopped:
            raise KeyboardInterrupt

    def _late(self, spp: int) -> bool:
        """Whether errors of pictures with so many samples follow from groups."""
        return spp >= LATE or self.settings.target_error is not None

    def _parts(self, begin: int, end: int, late: bool) -> list[tuple[int, int]]:
        """Ranges of samples that are drawn each into a film of its own: whole groups together."""
        cuts = [begin, end]
        if self._units and (late or not self._last):
            first, last = unit_begin(begin + GROUP - 1), unit_begin(end)
            cuts += (first, last) if late else range(first, last + 1, GROUP)
        cuts = sorted({cut for cut in cuts if begin <= cut <= end})
        return list(zip(cuts, cuts[1:], strict=False))

    def _joined(self, kept: Kept, films: Films, spp: int, late: bool) -> Kept:
        """With the samples up to spp, which are in these films: whole groups, or of one."""
        crew = self._crew
        whole = unit_begin(kept.spp) == kept.spp and unit_begin(spp) == spp
        if not self._units or (whole if late else self._last):
            return replace(kept, films=crew.added(kept.films, films), spp=spp)
        group = crew.merged(films, kept.tail, new=True)
        assert group is not None
        begin = unit_begin(spp - 1)
        group.end_unit(spp - begin)
        tail, groups = crew.films(group), kept.films if late else kept.groups
        if spp == begin + GROUP:
            tail, groups = (), crew.added(groups, tail)
        if late:
            return replace(kept, films=groups, tail=tail, spp=spp)
        films = crew.added(kept.films, films)
        return replace(kept, films=films, groups=groups, tail=tail, spp=spp)

    def _film(self, kept: Kept) -> tuple[Film, Film | None]:
        """All samples but those of a group that is not complete, and these, on one device."""
        late = self._late(kept.spp) and self._units and kept.films
        tail = self._crew.merged(kept.tail) if late else None
        film = self._crew.merged(kept.films or kept.tail, new=bool(tail and len(kept.films) > 1))
        assert film is not None
        return film, tail

    def _keep_mean(self, k: int, mean: Array) -> None:
        """Keeps the mean of batch k."""
        if self._means is None:
            self._means = np.empty((self.settings.batches, *mean.shape))
        self._means[k] = mean

    def _identity(self) -> dict[str, Any]:
        """What the samples depend on (`Checkpoint.render`)."""
        names = "seed", "sampler", "width", "height", "max_depth", "rr_depth", "target_error"
        return {
            "version": _version(),
            "scene_sha256": self._scene.sha256,
            **{name: getattr(self.settings, name) for name in (*names, "batches")},
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
            films = [self._crew.merged(one) for one in (kept.films, kept.groups, kept.tail)]
            states = [None if film is None else film.state() for film in films]
        means = None
        if self.settings.batches:
            assert self._means is not None
            means = self._means[: kept.spp // self._batch].copy()
        return Checkpoint(
            render=self._identity(), first=self._first, spp=kept.spp, paths=kept.paths,
            report=copy.deepcopy(kept.report), film=states[0], groups=states[1], tail=states[2],
            tiles=kept.tiles, beyond=kept.beyond, means=means, machine=self._crew.machine,
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
            films, groups, tail = map(
                functools.partial(self._taken, given), (given.film, given.groups, given.tail)
            )
        if given.means is not None:
            self._means = np.empty((self.settings.batches, *given.means.shape[1:]))
            self._means[: len(given.means)] = given.means
        self._kept = Kept(
            films=films,
            groups=groups,
            tail=tail,
            spp=given.spp,
            paths=given.paths,
            report=given.report,
            tiles=given.tiles,
            beyond=given.beyond,
        )

    def _taken(self, given: Checkpoint, state: FilmState | None) -> Films:
        film = with_room(self.device, lambda: given._film_on(self.device, state))
        return () if film is None else self._crew.films(film)

    def render(self) -> Render:
        """The picture of the samples that are there, as `veriray.render` gives it.

        Raises ValueError if there are none yet, or if its first sample is not 0; warns as
        `veriray.render`.
        """
        return self._render(3)

    def _render(self, level: int | None = None) -> Render:
        """`render`; level: of the stack whose line a warning names, None for no warning."""
        kept, settings, used = self._kept, self.settings, self._scene
        report = kept.report
        if not kept.spp or report is None or self._deciding:
            raise ValueError("the picture has no samples yet: add some first")
        if self._first:
            raise ValueError(f"samples 0:{self._first} are missing: merge checkpoints of all")
        counts = None
        if kept.tiles is not None:
            counts = np.minimum(self._counts, kept.spp).astype(np.uint64)
        with device_module.native_errors():
            threads = settings.native()["threads"]
            film, tail = with_room(self.device, lambda: self._film(kept))
            picture = with_room(
                self.device, lambda: film.picture(counts, threads, units=self._units, tail=tail)
            )
            error = float(picture.mean_stderr)
            complete = kept.tiles is not None and not self.left
            stats = {
                **copy.deepcopy(self._crew.facts),
                **statistics(report, kept.paths),
                **settings.kept(),
                **self._crew.stats(kept.films),
                "spp": used.spp if complete else kept.spp,
                "filter": used.film.filter,
                "filter_parameter": used.film.filter_parameter,
                "scene_sha256": None if (waits := used.hash_awaited) else used.sha256,
                "version": _version(),
                "mean_stderr": error if math.isfinite(error) else None,
            }
            if counts is not None and settings.target_error is not None:
                first = first_sample(used.spp)
                stats |= facts_of(
                    picture, counts, settings.target_error, self._pilot, first, kept.beyond
                )
        if level is not None and stats["nonfinite_samples"]:
            warnings.warn(refused_text(stats), RefusedSamplesWarning, stacklevel=level)
        return Render._of(
            picture,
            used if waits else None,
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
        return self._means[:count].copy()


def _crew(
    owner: Scene, scene: Scene, settings: RenderSettings, progress: Progress
) -> Crew | Cluster:
    if not settings.cluster:
        return Crew(owner, scene, settings, progress)
    from .cluster import Cluster

    return Cluster(owner, scene, settings, progress)


def _part(progress: Progress, before: int, n: int, of: int) -> Progress:
    """A callback for n samples after `before` others that reports the fraction of `of`."""
    if progress is None or n == of:
        return progress
    return lambda share: progress((before + share * n) / of)


def _version() -> str:
    from . import __version__

    return __version__
