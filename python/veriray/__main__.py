"""The command `veriray`, also as `python -m veriray`."""

import contextlib
import gc
import importlib
import io
import os
import sys
import threading
from typing import Any

from . import interrupts


def main() -> int:
    """Runs the command of `sys.argv`; returns its exit status.

    A failure to write to standard output or error stops no command; it is reported afterwards.
    """
    interrupts.install()
    try:
        open_standard_streams()
        if may_use_cuda(sys.argv[1:]):
            start_cuda()
        from .cli import main

        status = main()
        interrupts.remove()
    except KeyboardInterrupt:  # before the command begins, or after its end
        print("veriray: error: interrupted", file=sys.stderr)
        return interrupts.status()
    gc.freeze()  # the process ends: no last search for cycles among all that was imported
    error = getattr(getattr(getattr(sys.stdout, "buffer", None), "raw", None), "error", None)
    if error is None or status:
        return status
    if isinstance(error, BrokenPipeError):  # the reader went away (`veriray ... | head`)
        return 141
    print(f"veriray: error: standard output: {error.strerror}", file=sys.stderr)
    return 2


class StandardStream(io.FileIO):
    """Standard output or error: keeps the first error, and drops what is written after it."""

    error: OSError | None = None

    def write(self, data: Any) -> int:
        """As FileIO's, but waits if the stream is non-blocking."""
        if not self.error:
            try:
                while (count := super().write(data)) is None:
                    importlib.import_module("select").select([], [self], [])
                return count
            except OSError as error:
                self.error = error
        return memoryview(data).nbytes


def open_standard_streams() -> None:
    """Makes standard streams that are closed or break harmless.

    No file that is opened later gets the number of a closed one, to which libraries may print.
    """
    for number in range(3):
        try:
            os.fstat(number)
        except OSError:
            os.open(os.devnull, os.O_RDWR)
    for number, name in ((1, "stdout"), (2, "stderr")):
        stream = getattr(sys, name)
        if stream is not getattr(sys, f"__{name}__"):
            continue
        raw = io.BufferedWriter(StandardStream(number, "w", closefd=False))
        if stream is None:
            setattr(sys, name, io.TextIOWrapper(raw, "utf-8", "backslashreplace"))
            continue
        stream.flush()
        setattr(
            sys,
            name,
            io.TextIOWrapper(
                raw,
                stream.encoding,
                stream.errors,
                line_buffering=stream.line_buffering,
                write_through=stream.write_through,
            ),
        )


def may_use_cuda(words: list[str]) -> bool:
    """Whether this command line may render on CUDA; errors in it are left to the parser."""
    device = "auto"
    for word, following in zip(words, [*words[1:], ""], strict=False):
        name, equals, value = word.partition("=")
        if len(name) > 2 and "--device".startswith(name):
            device = value if equals else following
    asked = words[:1] in (["render"], ["view"]) and not {"-h", "--help", "--pixel"} & {*words}
    return asked and device.partition(":")[0] in ("auto", "cuda")


def start_cuda() -> None:
    """Starts CUDA on a thread: the driver takes as long as all imports and the scene together.

    A failure here recurs when the device is selected, and is reported then.
    """
    with contextlib.suppress(Exception):
        native = importlib.import_module("veriray._cuda")
        # not on the thread: Ctrl-C may end this one within an import, whose lock is then kept
        from .device import native_errors

        def start() -> None:
            with contextlib.suppress(Exception), native_errors():
                native.status()  # makes the context, without the interpreter's lock

        threading.Thread(target=start).start()


if __name__ == "__main__":
    sys.exit(main())
