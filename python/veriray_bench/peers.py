"""Other renderers, each in a process of its own.

A peer is a module `veriray_bench.NAME` that calls `serve` when it is run with the arguments VARIANT
and FD. The parent asks over a pipe: ("load", key, file, settings), ("run", key, spp, seed) and
("forget",).
"""

from __future__ import annotations

import contextlib
import multiprocessing
import multiprocessing.connection
import subprocess
import sys
import tempfile
from collections.abc import Callable, Iterator, Sequence
from pathlib import Path
from typing import Any

from .measure import Array, BenchError

#: Peer -> backend -> variant; the samplers that are raced, the first one at equal samples. "own" is
#: the peer's, whatever the file says.
VARIANTS: dict[str, dict[str, str]] = {
    "mitsuba": {"cpu": "llvm_ad_rgb", "cuda": "cuda_ad_rgb"},
    "cycles": {"cpu": "cpu"},
}
SAMPLERS = {"mitsuba": ("independent", "multijitter"), "cycles": ("own",)}


class Peer:
    """A running peer. `about`: what it says of itself (version, variant ...).

    Raises BenchError, here and in its methods, when the peer cannot run or fails; `alive` tells
    whether it can be asked again.
    """

    def __init__(self, name: str, variant: str) -> None:
        self.name = name
        self._log = tempfile.TemporaryFile()
        self._pipe, theirs = multiprocessing.Pipe()
        words = [sys.executable, "-m", f"{__package__}.{name}", variant, str(theirs.fileno())]
        self._process = subprocess.Popen(
            words, pass_fds=[theirs.fileno()], stdin=subprocess.DEVNULL, stdout=self._log,
            stderr=self._log, start_new_session=True,
        )  # fmt: skip
        theirs.close()
        try:
            self.about: dict[str, Any] = {"variant": variant, **self._answer()}
        except BaseException:
            self.close()
            raise

    @property
    def alive(self) -> bool:
        """Whether the process runs."""
        return self._process.poll() is None

    def load(self, key: str, path: Path, settings: dict[str, Any]) -> float:
        """Read a scene file under a name; returns the seconds."""
        return float(self._ask("load", key, str(path), settings))

    def run(self, key: str, spp: int, seed: int) -> tuple[dict[str, Any], Array]:
        """Render a loaded scene: times (as `kinds.Veriray.run` has them) and picture."""
        row, image = self._ask("run", key, spp, seed)
        return row, image

    def forget(self) -> None:
        """Free all scenes."""
        if self.alive:
            self._ask("forget")

    def close(self) -> None:
        """End the process, whatever it does."""
        self._pipe.close()
        self._process.kill()
        self._process.wait()
        self._log.close()

    def _ask(self, *request: Any) -> Any:
        with contextlib.suppress(OSError):  # a dead process shows when it is asked for its answer
            self._pipe.send(request)
        return self._answer()

    def _answer(self) -> Any:
        try:
            kind, value = self._pipe.recv()
        except (EOFError, OSError):
            status = self._process.wait()
            raise BenchError(f"{self.name}: ended with status {status}{self._said()}") from None
        if kind == "error":
            raise BenchError(f"{self.name}: {value}")
        return value

    def _said(self) -> str:
        self._log.seek(0)
        lines = self._log.read().decode(errors="replace").strip().splitlines()
        return f" ({lines[-1].strip()})" if lines else ""


class Crew:
    """The peers of one backend; started when first asked for, again if they died."""

    def __init__(self, names: Sequence[str], backend: str) -> None:
        self._variants = {n: VARIANTS[n][backend] for n in names if backend in VARIANTS[n]}
        self._running: dict[str, Peer] = {}
        self.about: dict[str, dict[str, Any]] = {
            n: {"missing": f"not raced on {backend}"} for n in names if n not in self._variants
        }

    def __enter__(self) -> Crew:
        """Start all once, to know what is there."""
        for name in self._variants:
            with contextlib.suppress(BenchError):
                self.get(name)
        return self

    def __exit__(self, *_: object) -> None:
        for peer in self._running.values():
            peer.close()

    def get(self, name: str) -> Peer:
        """The peer; raises BenchError where it cannot run."""
        missing = self.about.get(name, {}).get("missing")
        if missing:
            raise BenchError(missing)
        peer = self._running.get(name)
        if peer is None or not peer.alive:
            try:
                peer = Peer(name, self._variants[name])
            except BenchError as error:
                self.about.setdefault(name, {"missing": str(error)})
                raise
            self._running[name], self.about[name] = peer, peer.about
        return peer

    def names(self) -> Iterator[str]:
        """Those that can run."""
        return (name for name in self._variants if "missing" not in self.about[name])

    def forget(self) -> None:
        """Free the scenes of all peers."""
        for peer in self._running.values():
            peer.forget()


def serve(start: Callable[[str], tuple[dict[str, Any], Any]]) -> None:
    """A peer's process: start(variant) gives `about` and an object with load(), run() and forget().

    Arguments of the process: variant and the number of the pipe's end.
    """
    variant, number = sys.argv[1:]
    pipe: Any = multiprocessing.connection.Connection(int(number))
    try:
        about, renderer = start(variant)
    except (ImportError, RuntimeError) as error:
        missing = isinstance(error, ModuleNotFoundError)
        pipe.send(("error", f"not installed ({error})" if missing else str(error)))
        return
    pipe.send(("done", about))
    with contextlib.suppress(EOFError, OSError):
        while True:
            request, *arguments = pipe.recv()
            try:
                answer = getattr(renderer, request)(*arguments)
            except Exception as error:
                pipe.send(("error", f"{type(error).__name__}: {error}"))
            else:
                pipe.send(("done", answer))


def parse(text: str) -> tuple[str, ...]:
    """The peers of a list such as "mitsuba" or "none"; ValueError for an unknown one."""
    names = tuple(dict.fromkeys(word.strip() for word in text.split(",") if word.strip()))
    if names == ("none",):
        return ()
    for name in names:
        if name not in VARIANTS:
            known = ", ".join(VARIANTS)
            raise ValueError(f"peer {name!r} is unknown; expected none or some of: {known}")
    if not names:
        raise ValueError(f"no peers named; expected none or some of: {', '.join(VARIANTS)}")
    return names
