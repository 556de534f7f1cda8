"""Checkpoints: the exact sums of a picture that is not finished, or of a range of its samples.

The layout of their files is that of `veriray.checkpoint_file`.
"""

from __future__ import annotations

import math
import os
from collections.abc import Sequence
from dataclasses import dataclass, field, fields, replace
from typing import TYPE_CHECKING, Any

import numpy.typing as npt

from . import checkpoint_file
from . import device as device_module
from .errors import CheckpointError
from .numeric import path_text, shown, whole
from .picture import Render
from .reports import added, statistics
from .units import GROUP, LATE, unit_begin

if TYPE_CHECKING:
    from ._native import Film, FilmState, Report

Array = npt.NDArray[Any]

MAX_BYTES = 1 << 37
#: What a scene's hash covers and a render names besides.
_IN_SCENE = ("width", "height", "max_depth", "rr_depth")


@dataclass(frozen=True, eq=False)
class Checkpoint:
    """What `Accumulation.checkpoint` gives, and what is needed to go on, on any device.

    render: what the samples depend on, by name: version, scene_sha256, seed, sampler, width,
    height, max_depth, rr_depth, target_error, batches, and spp where the samples depend on it
    (else None).
    first, spp: the samples are [first, first + spp) of every pixel; of the pixels that want them
    with target_error, or of the pilot while tiles is None.
    paths, report: of all that was done. film: exact sums, None at the end of the pilot; groups,
    tail: with sampler sobol those of `veriray.accumulation.Kept`.
    tiles: samples that each tile gets, with target_error; beyond: how many of them want more.
    means: of the batches that are complete. machine: device, device_name and scheduler that drew
    the last samples. where: the file that it came from. Those who make one themselves answer for
    its fields, which are not checked.
    """

    render: dict[str, Any]
    first: int
    spp: int
    paths: int
    report: Report
    film: FilmState | None = None
    groups: FilmState | None = None
    tail: FilmState | None = None
    tiles: Array | None = None
    beyond: int = 0
    means: Array | None = None
    machine: dict[str, str] = field(default_factory=dict)
    where: str = ""

    def __repr__(self) -> str:
        width, height, seed = (self.render.get(name) for name in ("width", "height", "seed"))
        return f"<Checkpoint {width} x {height}, samples {self.first}:{self.end}, seed {seed}>"

    @property
    def end(self) -> int:
        """Number after that of the last sample."""
        return self.first + self.spp

    def save(self, path: str | os.PathLike[str]) -> None:
        """Write the file, whole or not at all. Raises OSError naming it."""
        where = path_text("path", path, CheckpointError)
        checkpoint_file.write(where, {f.name: getattr(self, f.name) for f in fields(self)})

    @classmethod
    def load(cls, path: str | os.PathLike[str], *, max_bytes: int = MAX_BYTES) -> Checkpoint:
        """Read a file.

        max_bytes: largest size of a file. Raises CheckpointError for one that is none, is damaged
        or larger; OSError if it cannot be read.
        """
        where = path_text("path", path, CheckpointError)
        max_bytes = whole("max_bytes", max_bytes, 0, 2**63, error=CheckpointError)
        return cls(**checkpoint_file.read(where, max_bytes), where=where)

    def _differences(self, render: dict[str, Any]) -> str:
        """What is otherwise in this checkpoint's render than in `render`; "" if nothing."""
        names = [name for name in render if self.render[name] != render[name]]
        if any(name in names for name in _IN_SCENE):
            names = [name for name in names if name != "scene_sha256"]  # it covers these
        return "; ".join(f"{n} is {_short(self.render[n])}, not {_short(render[n])}" for n in names)

    def _film_on(self, device: device_module.Device, *states: FilmState | None) -> Film | None:
        """A film of a device with the sums of all of these. Raises ValueError if they are none."""
        there = [state for state in states if state is not None]
        if not there:
            return None
        planes = [{k: plane[k] for k in ("name", "kind", "channels", "negative")}
                  for plane in there[0]["planes"][1:]]  # fmt: skip
        size = self.render["width"], self.render["height"]
        film: Film = device.native.Film(*size, device=device.index, planes=planes)
        for state in there:
            film.add_state(state)
        return film

    @property
    def _late(self) -> bool:
        """As of the accumulation."""
        return self.spp >= LATE or self.render["target_error"] is not None

    @property
    def _cut(self) -> bool:
        """Whether samples of the last group may follow."""
        return self.render["sampler"] == "sobol" and unit_begin(self.end) != self.end

    @classmethod
    def merged(cls, parts: Sequence[Checkpoint]) -> Checkpoint:
        """One checkpoint of ranges of one render that follow one another, given in any order.

        Its sums are exact: those of a render of all samples. Raises CheckpointError that names a
        difference, an overlap or a gap; and for parts of adaptive renders or with batches.
        """
        if isinstance(parts, str) or not isinstance(parts, Sequence):
            raise TypeError(f"parts is {type(parts).__name__}, expected a list of Checkpoint")
        for k, part in enumerate(parts):
            if not isinstance(part, Checkpoint):
                raise TypeError(f"parts[{k}] is {type(part).__name__}, expected a Checkpoint")
        parts = sorted(parts, key=lambda part: (part.first, part.end))
        if not parts:
            raise CheckpointError("parts: no checkpoints to merge")
        if len(parts) == 1:
            return parts[0]
        one = parts[0]
        for part in parts:
            for name in ("target_error", "batches"):
                if part.render[name]:
                    raise CheckpointError(f"{part}: has {name}, and is no range of samples")
            if differences := part._differences(one.render):
                raise CheckpointError(f"{part}: of another render than {one}: {differences}")
        for last, part in zip(parts, parts[1:], strict=False):
            gap, twice = (last.end, part.first), (part.first, min(last.end, part.end))
            for (low, high), what in ((gap, "missing"), (twice, "there twice")):
                if low < high:
                    raise CheckpointError(f"{last} and {part}: samples {low}:{high} are {what}")
        for part in parts[:-1]:
            if part._cut:
                raise CheckpointError(
                    f"{part}: sample {part.end} is within a group; with sampler sobol, parts end "
                    f"at multiples of {GROUP}"
                )
        device, _ = device_module.select("cpu")
        with device_module.native_errors():
            report, paths = one.report, one.paths
            for part in parts[1:]:
                report, paths = added(report, part.report), paths + part.paths
            whole = replace(
                one, spp=parts[-1].end - one.first, paths=paths, report=report, where="",
                tail=parts[-1].tail, groups=None,
            )  # fmt: skip

            def sums(early: bool) -> FilmState | None:
                films = (part.film if early or part._late else part.groups for part in parts)
                film = one._film_on(device, *films)
                return None if film is None else film.state()

            grouped = one.render["sampler"] == "sobol"
            if grouped and not whole._late:
                return replace(whole, film=sums(True), groups=sums(False))
            return replace(whole, film=sums(not grouped))

    def __str__(self) -> str:
        return f"{self.where or 'a checkpoint'} ({self.first}:{self.end})"

    def picture(self, device: str = "cpu") -> Render:
        """The picture of these samples, which must begin at sample 0.

        Its stats lack what only the scene says (features, tree, ...). device: as of
        `veriray.render`. Raises CheckpointError where samples are missing, and with target_error,
        where an accumulation of the scene gives it.
        """
        if self.render["target_error"] is not None:
            raise CheckpointError(f"{self}: has target_error; render its scene with it to go on")
        if self.first:
            raise CheckpointError(f"{self}: samples 0:{self.first} are missing")
        chosen, _ = device_module.select(device)
        with device_module.native_errors():
            film = self._film_on(chosen, self.film)
            tail = self._film_on(chosen, self.tail) if self._late else None
            assert film is not None  # `Accumulation` makes none without samples but a pilot's
            stats = statistics(self.report, self.paths)
            stats |= {k: v for k, v in self.render.items() if k != "target_error"} | self.machine
            stats |= {"spp": self.spp, "memory": int(film.memory)}
            picture = film.picture(None, 0, tail=tail)
            error = float(picture.mean_stderr)
        stats["mean_stderr"] = error if math.isfinite(error) else None
        means = self.means if self.means is not None and len(self.means) > 1 else None
        return Render._of(
            picture, batch_means=means, stats=stats, width=self.render["width"],
            height=self.render["height"], spp=self.spp, seed=self.render["seed"], samples=None,
        )  # fmt: skip


def _short(value: object) -> str:
    text = str(value) if isinstance(value, str) else shown(value)
    return f"{text[:16]}..." if len(text) > 40 else text
