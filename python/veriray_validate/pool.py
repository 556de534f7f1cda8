"""Jobs in worker processes. A worker that dies takes only its own job with it.

Workers are spawned, not forked, as CUDA requires. They end with the iteration, however it ends:
Ctrl-C reaches only the parent, which ends them; a worker whose parent was killed ends itself.
"""

from __future__ import annotations

import contextlib
import multiprocessing
import os
import pickle
import signal
import threading
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from multiprocessing import connection, resource_tracker
from typing import Any

_CONTEXT = multiprocessing.get_context("spawn")
_PATIENCE = 10.0  # seconds for a worker to leave
#: A worker uses one processor: threads of its linear algebra would take those of other workers.
_ONE_THREAD = ("OPENBLAS_NUM_THREADS", "OMP_NUM_THREADS", "MKL_NUM_THREADS")


@dataclass(frozen=True)
class Died:
    """Replaces a result: the job raised, its process ended, or its answer cannot be sent."""

    how: str

    def __str__(self) -> str:
        return self.how


def results(
    function: Callable[..., Any], jobs: Sequence[tuple[Any, ...]], workers: int,
    holds: Sequence[str | None] | None = None,
) -> Iterator[tuple[int, Any]]:  # fmt: skip
    """Yields (k, function(*jobs[k])) in the order of completion, with `workers` processes.

    function: importable by its name, with arguments and results that can be pickled. holds[k]: a
    resource that job k has to itself while it runs; it waits for a job that holds the same, and
    others overtake it. The result of a job that raised or whose process died is a `Died`. Close the
    iterator to end the workers early.
    """
    left = list(range(len(jobs)))[::-1]
    held = [None] * len(jobs) if holds is None else holds
    crew: dict[Any, tuple[Any, int]] = {}  # pipe -> process, number of its job
    leaving: list[Any] = []
    try:
        while left or crew:
            while len(crew) < max(workers, 1):
                job = _next(left, held, [running for _, running in crew.values()])
                if job is None:
                    break
                pipe, process = _hire(function)
                crew[pipe] = process, _give(pipe, job, jobs)
            for pipe in connection.wait(list(crew)):
                process, job = crew[pipe]
                try:
                    answer = pipe.recv()
                except (EOFError, OSError):
                    process.join()
                    answer = Died(_how(process.exitcode))
                    del crew[pipe]
                else:
                    others = [running for p, (_, running) in crew.items() if p is not pipe]
                    following = _next(left, held, others)
                    if following is not None:
                        crew[pipe] = process, _give(pipe, following, jobs)
                    else:
                        pipe.close()  # it leaves
                        leaving.append(process)
                        del crew[pipe]
                yield job, answer
    finally:
        for pipe, (process, _) in crew.items():
            process.terminate()
            pipe.close()
            leaving.append(process)
        for process in leaving:
            process.join(_PATIENCE)
            if process.exitcode is None:
                process.kill()
                process.join()


def _next(left: list[int], held: Sequence[str | None], running: list[int]) -> int | None:
    """Takes the next job that need not wait from `left` (in reverse order); None: all must wait."""
    taken = {held[job] for job in running} - {None}
    for place in range(len(left) - 1, -1, -1):
        if held[left[place]] not in taken:
            return left.pop(place)
    return None


def _give(pipe: Any, job: int, jobs: Sequence[tuple[Any, ...]]) -> int:
    """Sends a job; returns its number."""
    with contextlib.suppress(OSError):  # a dead worker shows when it is asked for its answer
        pipe.send(jobs[job])
    return job


def _hire(function: Callable[..., Any]) -> tuple[Any, Any]:
    """A new worker: our end of its pipe, and its process."""
    ours, theirs = _CONTEXT.Pipe()
    process = _CONTEXT.Process(target=_serve, args=(theirs, function))
    resource_tracker.ensure_running()  # it unblocks SIGINT
    blocked = signal.pthread_sigmask(signal.SIG_BLOCK, {signal.SIGINT})
    unset = [name for name in _ONE_THREAD if name not in os.environ]
    os.environ.update(dict.fromkeys(unset, "1"))  # read when NumPy is loaded
    try:
        process.start()
    finally:
        for name in unset:
            del os.environ[name]
        signal.pthread_sigmask(signal.SIG_SETMASK, blocked)
        theirs.close()
    return ours, process


def _how(status: int) -> str:
    if status < 0:
        return f"the process died of signal {-status} ({signal.strsignal(-status)})"
    return f"the process ended with status {status}"


def _serve(pipe: Any, function: Callable[..., Any]) -> None:
    """A worker: jobs in, results out, until the pipe ends."""
    os.setpgrp()  # the terminal's Ctrl-C is the parent's
    signal.pthread_sigmask(signal.SIG_UNBLOCK, {signal.SIGINT})
    threading.Thread(target=_leave_with_parent, daemon=True).start()
    with contextlib.suppress(EOFError, OSError):
        while True:
            arguments = pipe.recv()
            try:
                answer = function(*arguments)
            except Exception as error:
                answer = Died(f"{type(error).__name__}: {error}")
            try:
                pipe.send(answer)
            except (TypeError, AttributeError, ValueError, pickle.PicklingError) as error:
                pipe.send(Died(f"its result cannot be sent: {error}"))


def _leave_with_parent() -> None:
    parent = multiprocessing.parent_process()
    if parent is not None:
        parent.join()
        os._exit(1)
