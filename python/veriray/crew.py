"""Who draws the samples of an accumulation: one device, or several at once.

Several devices take ranges of samples (`veriray.splitting`), each on a thread of its own. Each has
its own film of exact sums, of whatever samples it drew; they are merged where a picture, a
checkpoint, a batch's mean or the pilot's end needs them all.
"""

from __future__ import annotations

import functools
import os
import time
from collections.abc import Callable, Iterable, Sequence
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np
import numpy.typing as npt

from . import device as device_module
from . import kernels
from .device import Device, polled
from .held import with_room
from .native_scene import native_scene, scene_facts
from .plan import choose_scheduler, compiled_choice
from .reports import added
from .scene import Scene
from .settings import RenderSettings
from .splitting import GROWTH
from .together import Pass, warn_of
from .units import whole

if TYPE_CHECKING:
    from ._native import Film, Report

#: While a kernel for a scene is being compiled: paths of the first part of a render, and seconds of
#: those that follow, which grow by GROWTH at most.
FIRST_PART, PART_SECONDS = 1 << 24, 0.2

Array = npt.NDArray[Any]
Progress = Callable[[float], object] | None
Films = tuple["Film | None", ...]


class Drawn(NamedTuple):
    """What a pass gives: a film of each hand that drew, the sum of their reports, and the samples
    per pixel. stopped: by Ctrl-C, and then these may be fewer than asked for."""

    films: Films
    report: Report
    spp: int
    stopped: bool = False


class Place:
    """Where films are: a device. out: why it draws no more, "" if it does."""

    def __init__(self, device: Device, size: tuple[int, int]) -> None:
        self.device, self.size, self.out = device, size, ""
        self.spares: list[Film] = []  # pop is one step, for several threads

    def paths_of(self, pixels: Array | None) -> int:
        """Paths of one sample of these pixels, of all without them."""
        return self.size[0] * self.size[1] if pixels is None else len(pixels)

    def blank(self) -> Film:
        """A film without samples."""
        try:
            film = self.spares.pop()
        except IndexError:
            native = self.device.native
            made: Film = with_room(
                self.device, lambda: native.Film(*self.size, device=self.device.index)
            )
            return made
        film.clear()
        return film


class Team:
    """The places of an accumulation's films, which are tuples: one for each place, or None.

    seconds: of a pass, about, where it is up to `veriray.course`.
    """

    seconds = 1.0

    def __init__(self, places: Sequence[Place]) -> None:
        self._places = places

    @property
    def device(self) -> Device:
        """The device on which pictures are made."""
        return self._places[self._lead].device

    @property
    def _lead(self) -> int:
        return next((k for k, place in enumerate(self._places) if not place.out), 0)

    def paths_of(self, pixels: Array | None) -> int:
        """As of a place."""
        return self._places[0].paths_of(pixels)

    def films(self, film: Film | None) -> Films:
        """A film of `device` as a tuple."""
        return tuple(film if k == self._lead else None for k in range(len(self._places)))

    def added(self, kept: Films, new: Films) -> Films:
        """The samples of both; the films in `new` take them up."""
        for film, old in zip(new, kept, strict=bool(kept)):
            if film is not None and old is not None:
                film.add(old)
        return tuple(
            old if film is None else film
            for film, old in zip(new, kept or [None] * len(new), strict=True)
        )

    def reuse(self, films: Films, kept: Films) -> None:
        """Takes films back that are not in `kept`, to be used again."""
        for place, film in zip(self._places, films, strict=bool(films)):
            if film is not None and not place.spares and all(film is not one for one in kept):
                place.spares.append(film)

    def release(self) -> None:
        """Forgets films that were taken back."""
        for place in self._places:
            place.spares.clear()

    def merged(self, *films: Films, new: bool = False) -> Film | None:
        """All samples in one film, of `device` if there are several; these stay as they are. new:
        it is none of these."""
        there = [(k, film) for one in films for k, film in enumerate(one) if film is not None]
        if not there or (len(there) == 1 and not new):
            return there[0][1] if there else None
        first = self._places[self._lead]

        def merge() -> Film:
            whole = first.blank()
            for k, film in there:
                if self._places[k].device.native is first.device.native:
                    whole.add(film)
                else:
                    whole.add_state(film.state())
            return whole

        return with_room(first.device, merge)

    def close(self) -> None:
        """Ends what it started."""


class Hand(Place):
    """One device with what it needs of a scene. settings: as it runs them; rate: paths a
    second; said: its last report."""

    def __init__(
        self, owner: Scene, scene: Scene, settings: RenderSettings, device: Device, reason: str,
        progress: Progress,
    ) -> None:  # fmt: skip
        super().__init__(device, (scene.film.width, scene.film.height))
        self.reason = reason
        build = functools.partial(
            native_scene, owner, scene, device, progress, settings.builder, scene.spp
        )
        self.native = with_room(device, build)
        self.facts = scene_facts(self.native)
        scheduler, self.why = choose_scheduler(settings, device.backend, self.facts)
        self.settings = settings.with_checked({"scheduler": scheduler, "device": device.name})
        self._auto = settings.scheduler == "auto"
        self._drew: list[str] = []  # schedulers that drew
        self._awaits_kernel(self.paths_of(None) * scene.spp)
        self.rate, self.trials, self.paths, self.seconds = 0.0, 0, 0, 0.0
        self.said: Report | None = None

    def draw(
        self, film: Film, begin: int, end: int, pixels: Array | None, units: bool,
        progress: Progress,
    ) -> Report:  # fmt: skip
        """Adds these samples of these pixels to a film. units: in groups (`veriray.units`).

        In parts while a kernel for the scene is being compiled, so that it takes over once it is.
        """
        start, first = time.perf_counter(), begin
        size, report = max(1.0, FIRST_PART / self.paths_of(pixels)), None
        while begin < end:
            n = end - begin
            if n > size and self._awaits_kernel():
                n = min(n, whole(begin, int(size))) if units else int(size)
            since = time.perf_counter()
            scheduler = self._scheduler(n * self.paths_of(pixels))
            part: Report = self.device.native.render(
                self.native, film, sample_begin=begin, sample_end=begin + n, pixels=pixels,
                units=units,
                poll=polled(_share(progress, (begin - first) / (end - first), n / (end - first))),
                **{**self.settings.native(), "scheduler": scheduler},
            )  # fmt: skip
            if scheduler != self.settings.scheduler:  # what it alone counts would be of a part
                for name in ("blocks", "depth_seconds", "compaction_seconds"):
                    part[name] = part[name][:0]
            report, begin = added(report, part), begin + n
            size = max(1.0, min(GROWTH * n, n * PART_SECONDS / (time.perf_counter() - since)))
        assert report is not None
        report["seconds"] = time.perf_counter() - start
        return report

    def _awaits_kernel(self, paths: int = 0) -> bool:
        """Whether a kernel for the scene is being compiled; paths: that will be rendered, more."""
        if self.device.backend != "cuda" or self.settings.all_features:
            return False
        return kernels.offer(self.device, self.native, str(self.settings.scheduler), paths)

    def _scheduler(self, paths: int) -> str:
        """What draws so many paths: until the scene has kernels, the faster compiled one."""
        chosen = str(self.settings.scheduler)
        if self._auto and self.device.backend == "cuda" and not self.settings.all_features:
            if not kernels.made(self.device, self.native, chosen):
                chosen = compiled_choice(self.facts, paths)
        if chosen not in self._drew:
            self._drew.append(chosen)
        return chosen

    @property
    def drew(self) -> list[str]:
        """The schedulers that drew, in order; the one that will, if none did."""
        return self._drew or [str(self.settings.scheduler)]

    def stats(self) -> dict[str, Any]:
        """What it did, for `Render.stats`."""
        said = self.said
        return {
            "device": self.device.name,
            "device_name": self.device.description,
            "device_reason": self.reason,
            "scheduler": listed(self.drew),
            "scheduler_reason": self.why,
            "threads": 0 if said is None else int(said["threads"]),
            "variant": self.facts["variant"],
            "kernel": {} if said is None else {k: int(v) for k, v in said["kernel"].items()},
            "memory": int(self.native.memory),
            "paths": self.paths,
            "seconds": self.seconds,
        }


class Crew(Team):
    """The devices that `settings.device` names, ready for a scene.

    Raises as `veriray.render`; a device of several that lacks the memory is left out with a
    DeviceWarning.
    """

    def __init__(
        self, owner: Scene, scene: Scene, settings: RenderSettings, progress: Progress
    ) -> None:
        chosen = device_module.select_all(settings.device, fresh=False)
        shares = _threads([device for device, _ in chosen], settings.threads)
        self.hands: list[Hand] = []
        for k, ((device, reason), threads) in enumerate(zip(chosen, shares, strict=True)):
            of_it = settings.with_checked({"threads": threads})
            try:
                self.hands.append(Hand(owner, scene, of_it, device, reason, progress))
            except MemoryError as error:
                if k + 1 == len(chosen) and not self.hands:
                    raise
                warn_of(device, error)
        super().__init__(self.hands)
        self.facts = self.hands[0].facts
        self.settings = settings.with_checked({
            "scheduler": listed(str(hand.settings.scheduler) for hand in self.hands),
            "device": ",".join(hand.device.name for hand in self.hands),
        })  # fmt: skip

    @property
    def least(self) -> int:
        """Samples per pixel of a pass that gives each something to do."""
        return len(self.hands)

    @property
    def machine(self) -> dict[str, str]:
        """What a checkpoint says of who drew its samples."""
        return {
            "device": str(self.settings.device),
            "device_name": listed(hand.device.description for hand in self.hands),
            "scheduler": listed(name for hand in self.hands for name in hand.drew),
        }

    def stats(self, films: Films) -> dict[str, Any]:
        """For `Render.stats`: who they are, what each did, and the memory of all."""
        natives = {id(hand.native): int(hand.native.memory) for hand in self.hands}
        memory = sum(natives.values()) + sum(int(film.memory) for film in films if film is not None)
        one = {
            **self.machine,
            "device_reason": self.hands[0].reason,
            "scheduler_reason": self.hands[0].why,
            "memory": memory,
        }
        if len(self.hands) == 1:
            return one
        each = [hand.stats() for hand in self.hands]
        threads = sum(hand["threads"] for hand in each)
        return one | {"devices": each} | ({"threads": threads} if threads else {})

    def draw(
        self, begin: int, n: int, pixels: Array | None, units: bool, progress: Progress
    ) -> Drawn:
        """A pass: n samples of these pixels, in films of their own."""
        if len(self.hands) > 1:
            work = Pass(self.hands, begin, n, pixels, units, self.paths_of(pixels))
            films, report = work.run(progress)
            return Drawn(tuple(films), report, n)
        hand = self.hands[0]
        film = hand.blank()
        draw = functools.partial(hand.draw, film, begin, begin + n, pixels, units, progress)
        return Drawn((film,), with_room(hand.device, draw, film.clear), n)


def _share(progress: Progress, begin: float, part: float) -> Progress:
    """A callback for a part of what `progress` reports on."""
    return None if progress is None else lambda share: progress(begin + part * share)


def listed(names: Iterable[str]) -> str:
    """Different names, in order."""
    return ",".join(dict.fromkeys(names))


def _threads(devices: Sequence[Device], wanted: int | None) -> list[int | None]:
    """The threads of each device: where the CPU is named several times, they share them."""
    cpus = [k for k, device in enumerate(devices) if device.backend == "cpu"]
    shares: list[int | None] = [wanted] * len(devices)
    if len(cpus) > 1:
        total = wanted or len(os.sched_getaffinity(0))
        for place, part in zip(cpus, np.array_split(range(total), len(cpus)), strict=True):
            shares[place] = max(1, len(part))
    return shares
