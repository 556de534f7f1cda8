"""How a render goes on: in passes, with checkpoints, until it is done or is stopped."""

from __future__ import annotations

import math
import os
import time
import warnings
from collections.abc import Callable
from dataclasses import dataclass

from .accumulation import Accumulation, Progress
from .checkpoint import Checkpoint
from .errors import CheckpointError, CheckpointWarning
from .files import check_writable
from .numeric import number, path_text, shown
from .picture import Render
from .units import rounded

#: The factor by which passes grow at most.
GROWTH = 8
#: Seconds between two checkpoints.
EVERY = 60.0


@dataclass(kw_only=True)
class Course:
    """What happens during a render beside its samples; checked.

    checkpoint: a file; if it exists the render goes on from it. It is written about every `every`
    seconds, and at the end. seconds: of sampling at most, as far as whole passes allow, and at
    least until there is a picture. on_pass: called with the picture after each pass. keeps: Ctrl-C
    ends the render with what is there, if that is a picture, and leaves out feature images while
    they are drawn. on_stop: called after Ctrl-C with the picture before feature images are drawn.
    failed: why the last write of the checkpoint failed, None if it did not.

    Raises ValueError, OSError for a checkpoint that cannot be written.
    """

    checkpoint: str | os.PathLike[str] | None = None
    every: float = EVERY
    seconds: float | None = None
    on_pass: Callable[[Render], object] | None = None
    keeps: bool = False
    on_stop: Callable[[Render], object] | None = None
    failed: OSError | None = None

    def __post_init__(self) -> None:
        self.every = number("every", self.every, 0, math.inf, error=ValueError)
        if self.seconds is not None:
            self.seconds = number("time", self.seconds, 0, math.inf, error=ValueError)
        if self.on_pass is not None and not callable(self.on_pass):
            raise ValueError(f"on_pass = {shown(self.on_pass)} is not callable")
        if self.checkpoint is not None:
            self.checkpoint = path_text("checkpoint", self.checkpoint, CheckpointError)
            check_writable(self.checkpoint)

    def resume(self, work: Accumulation) -> bool:
        """Takes over the samples of the checkpoint, if the file exists; whether it does."""
        if self.checkpoint is None or not os.path.exists(self.checkpoint):
            return False
        work.resume(Checkpoint.load(self.checkpoint))
        return True

    def run(self, work: Accumulation, of_pass: Callable[[int], Progress]) -> str:
        """Adds samples until all are there. Returns "", or why it stopped: "time", "interrupted".

        of_pass: the progress callback of a pass of so many samples per pixel.
        """
        begun = written = time.monotonic()
        rate, last, behind = 0.0, 0, False
        try:
            while work.left:
                spent = time.monotonic() - begun
                if self.seconds is not None and spent >= self.seconds and work.spp:
                    return "time"
                n = self._next(work, rate, last, spent)
                last, start = work.paths_of(n), time.monotonic()
                behind = True
                work.add(n, of_pass(n))
                now = time.monotonic()
                rate = last / max(now - start, 1e-6)
                if self.on_pass is not None and work.spp:
                    self.on_pass(work.render())
                if self.checkpoint is not None and now - written >= self.every:
                    self._write(work)
                    behind = self.failed is not None
                    written = time.monotonic()
            return ""
        except KeyboardInterrupt:
            if not self.keeps or not work.spp:
                raise
            return "interrupted"
        finally:
            if behind and self.checkpoint is not None and work.paths:
                self._write(work)

    def _next(self, work: Accumulation, rate: float, last: int, spent: float) -> int:
        """Samples per pixel of the next pass."""
        n = work.left
        if work.settings.batches:
            return n
        target = work.pass_seconds
        if self.checkpoint is not None:
            target = min(target, self.every)
        if self.seconds is not None and work.spp:
            target = min(target, self.seconds - spent)
        paths = min(rate * target, GROWTH * last)
        wanted = max(1, min(n, max(work.least, int(paths / work.paths_of(1)))))
        return rounded(work.spp, wanted, n)

    def _write(self, work: Accumulation) -> None:
        assert self.checkpoint is not None
        self.failed = None
        try:
            work.checkpoint().save(self.checkpoint)
        except OSError as error:
            self.failed = error
            warnings.warn(
                f"the checkpoint was not written, and the last one stays: {error}",
                CheckpointWarning,
                stacklevel=2,
            )
