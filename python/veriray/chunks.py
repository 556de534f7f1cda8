"""Passes over large arrays by several threads: NumPy and reads of files release Python's lock."""

from __future__ import annotations

import os
import threading
from collections.abc import Callable
from typing import TypeVar

#: Rows of a piece, which stays in a processor's cache.
GRAIN = 1 << 16
MOST_THREADS = 16

_Result = TypeVar("_Result")


def in_chunks(work: Callable[[int, int], _Result], rows: int, grain: int = GRAIN) -> list[_Result]:
    """[work(first, last), ...] for pieces of [0, rows) in their order, the calling thread's too.

    Runs on fewer threads if the system gives no more. The first exception is raised once all
    threads have ended. Threads do not see the caller's np.errstate.
    """
    starts = range(0, rows, grain)
    results: dict[int, _Result] = {}
    errors: list[BaseException] = []
    left = iter(starts)  # next() of it is one step under the lock

    def drain() -> None:
        try:
            for first in left:
                if errors:
                    return
                results[first] = work(first, min(first + grain, rows))
        except BaseException as error:
            errors.append(error)

    threads: list[threading.Thread] = []
    for _ in range(min(_processors(), MOST_THREADS, len(starts)) - 1):
        thread = threading.Thread(target=drain, daemon=True)
        try:
            thread.start()
        except RuntimeError:  # no thread can be had
            break
        threads.append(thread)
    drain()
    for thread in threads:
        thread.join()
    if errors:
        raise errors[0]
    return [results[first] for first in starts]


def _processors() -> int:
    if hasattr(os, "sched_getaffinity"):
        return len(os.sched_getaffinity(0))
    return os.cpu_count() or 1
