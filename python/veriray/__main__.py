"""The command `veriray`, also as `python -m veriray`."""

import contextlib
import gc
import importlib
import sys
import threading


def main() -> int:
    """Runs the command of `sys.argv`; returns its exit status."""
    if may_use_cuda(sys.argv[1:]):
        start_cuda()
    from .cli import main

    status = main()
    gc.freeze()  # the process ends: no last search for cycles among all that was imported
    return status


def may_use_cuda(words: list[str]) -> bool:
    """Whether this command line may render on CUDA; what is wrong in it is left to the parser."""
    device = "auto"
    for word, following in zip(words, [*words[1:], ""], strict=False):
        name, equals, value = word.partition("=")
        if len(name) > 2 and "--device".startswith(name):
            device = value if equals else following
    asked = words[:1] == ["render"] and not {"-h", "--help", "--pixel"} & {*words}
    return asked and device.partition(":")[0] in ("auto", "cuda")


def start_cuda() -> None:
    """Starts CUDA on a thread: the driver takes as long as all imports and the scene together.

    What fails here fails again when the device is selected, and is reported then.
    """
    with contextlib.suppress(Exception):
        native = importlib.import_module("veriray._cuda")

        def start() -> None:
            from .device import native_errors

            with contextlib.suppress(Exception), native_errors():
                native.status()  # makes the context, without the interpreter's lock

        threading.Thread(target=start).start()


if __name__ == "__main__":
    sys.exit(main())
