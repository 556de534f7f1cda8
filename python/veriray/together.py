"""One pass by several devices at once."""

from __future__ import annotations

import threading
import time
import warnings
from collections.abc import Callable, Sequence
from typing import TYPE_CHECKING, Any

import numpy.typing as npt

from . import device as device_module
from .device import Device
from .errors import DeviceError, DeviceWarning, OutOfMemoryError
from .held import move_to_host
from .reports import added, in_order
from .splitting import Split

if TYPE_CHECKING:
    from ._native import Film, Report
    from .crew import Hand

Array = npt.NDArray[Any]
Progress = Callable[[float], object] | None

#: Seconds between two calls of a progress callback.
PAUSE = 0.01


class _StoppedError(Exception):
    """Ends a thread's range: the pass is over."""


class Pass:
    """One pass by several hands, each on a thread. What one of them holds is lost if it lacks
    memory: the others then draw it. Any other error ends the pass."""

    def __init__(
        self, hands: Sequence[Hand], begin: int, n: int, pixels: Array | None, units: bool,
        paths: int,
    ) -> None:  # fmt: skip
        self._hands, self._pixels, self._n, self._paths = hands, pixels, n, paths
        self._units = units
        if all(hand.out for hand in hands):
            for hand in hands:
                hand.out = ""
        there = [k for k, hand in enumerate(hands) if not hand.out]
        self._split = Split(begin, begin + n, {k: hands[k].rate / paths for k in there},
                            groups=units)  # fmt: skip
        self._there = there
        self._films: list[Film | None] = [None] * len(hands)
        self._reports: list[Report | None] = [None] * len(hands)
        self._parts = [0.0] * len(hands)
        self._changed, self._over = threading.Condition(), False
        self._error: BaseException | None = None
        self._short: dict[int, MemoryError] = {}

    def run(self, progress: Progress) -> tuple[list[Film | None], Report]:
        """Draws the samples; the callback is called on this thread."""
        start = time.perf_counter()
        threads = [threading.Thread(target=self._work, args=(k,), daemon=True) for k in self._there]
        started = []
        try:
            for thread in threads:
                try:
                    thread.start()
                    started.append(thread)
                except RuntimeError as error:
                    raise OutOfMemoryError("no thread can be started for a device") from error
            while not self._wait():
                if progress is not None:
                    progress(min(sum(self._parts) / self._n, 1.0))
        finally:
            self._over = True  # first, and without the lock: Ctrl-C may come once more
            self._end()
            for thread in started:
                thread.join()
        if self._error is not None:
            raise self._error
        if not self._split.done:
            raise next(iter(self._short.values()))
        for k, short in self._short.items():
            if self._hands[k].out:
                warn_of(self._hands[k].device, short)
        return self._films, self._report(time.perf_counter() - start)

    def _wait(self) -> bool:
        """Waits a little; whether the pass is over."""
        with self._changed:
            if not self._ended():
                self._changed.wait(PAUSE)
            return self._ended()

    def _ended(self) -> bool:
        out = all(self._hands[k].out for k in self._there)
        return self._over or out or self._split.done

    def _end(self, error: BaseException | None = None) -> None:
        with self._changed:
            self._over = True
            self._error = self._error or error
            self._changed.notify_all()

    def _report(self, seconds: float) -> Report:
        """Of all hands; seconds: of the pass."""
        total: Report | None = None
        for k, hand in enumerate(self._hands):
            said = self._reports[k]
            if said is not None:
                hand.trials += self._split.trials(k)
                hand.rate = self._split.rate(k) * self._paths if hand.trials > 1 else 0.0
                hand.paths += self._split.drawn(k) * self._paths
                hand.seconds += said["seconds"]
                hand.said = said
                total = added(total, said)
        assert total is not None
        total["seconds"], total["nonfinite"] = seconds, in_order(total["nonfinite"])
        return total

    def _work(self, k: int) -> None:
        """What a thread does."""
        try:
            with device_module.native_errors():
                while (piece := self._next(k)) is not None:
                    self._draw(k, *piece)
        except _StoppedError:
            pass
        except DeviceError as error:
            named = DeviceError(f"{self._hands[k].device.name}: {error}")
            named.__cause__ = error
            self._end(named)
        except BaseException as error:
            self._end(error)

    def _next(self, k: int) -> tuple[int, int] | None:
        with self._changed:
            while not self._ended() and not self._hands[k].out:
                if (piece := self._split.take(k)) is not None:
                    return piece
                self._changed.wait(PAUSE)
        return None

    def _draw(self, k: int, begin: int, end: int) -> None:
        hand, before = self._hands[k], self._split.drawn(k)

        def poll(share: float) -> None:
            if self._over:
                raise _StoppedError
            self._parts[k] = before + share * (end - begin)

        try:
            film = self._films[k]
            if film is None:
                film = self._films[k] = hand.blank()
            report = hand.draw(film, begin, end, self._pixels, self._units, poll)
        except MemoryError as error:
            self._films[k], self._reports[k], self._parts[k] = None, None, 0.0
            again = k not in self._short and move_to_host()
            with self._changed:
                self._short[k] = error
                self._split.lost(k, leaves=not again)
                hand.out = "" if again else str(error)
                self._changed.notify_all()
            return
        with self._changed:
            self._reports[k] = added(self._reports[k], report)
            self._split.finished(k, report["seconds"])
            self._parts[k] = self._split.drawn(k)
            self._changed.notify_all()


def warn_of(device: Device, error: MemoryError) -> None:
    """Warns that a device is left out."""
    warnings.warn(
        f"{device.name} takes no part: {error or 'too little memory'}", DeviceWarning, stacklevel=2
    )
