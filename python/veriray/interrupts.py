"""How Ctrl-C, SIGTERM and a closed terminal end a command: as KeyboardInterrupt, which `cli.main`
turns into a status.

Within an import they wait for its end: half an import comes out as another error, or as a traceback
that native code prints.
"""

from __future__ import annotations

import signal
from types import FrameType
from typing import NoReturn

#: What ends a command, and the last of these that came.
SIGNALS = (signal.SIGINT, signal.SIGTERM, signal.SIGHUP)
last = int(signal.SIGINT)
#: Whether one waits, and how often it looks whether it may go on.
_waits, _LOOK_SECONDS = False, 0.005


def install() -> None:
    """From now on they raise KeyboardInterrupt on the main thread, which must call this. One that
    is ignored stays so, as SIGINT is in a job that a script put into the background, and SIGHUP
    under nohup."""
    signal.signal(signal.SIGALRM, _look)
    for number in SIGNALS:
        if signal.getsignal(number) is not signal.SIG_IGN:
            signal.signal(number, interrupt)


def remove() -> None:
    """From now on they end the process at once: its work is done."""
    for number in SIGNALS:
        if signal.getsignal(number) is interrupt:
            signal.signal(number, signal.SIG_DFL)


def status() -> int:
    """Exit status of an interrupted command: 130 after Ctrl-C, 143 SIGTERM, 129 SIGHUP."""
    return 128 + last


def heard(number: int) -> None:
    """Notes a signal for `status`. Of those of a terminal that closes the first one counts."""
    global last
    last = number
    if number == signal.SIGHUP:
        signal.signal(number, signal.SIG_IGN)


def interrupt(number: int, frame: FrameType | None) -> None:
    """The handler. The second signal does not wait."""
    global _waits
    heard(number)
    if _waits or not _imports(frame):
        _end()
    _waits = True
    signal.setitimer(signal.ITIMER_REAL, _LOOK_SECONDS, _LOOK_SECONDS)


def _look(number: int, frame: FrameType | None) -> None:
    if not _imports(frame):
        _end()


def _end() -> NoReturn:
    global _waits
    _waits = False
    signal.setitimer(signal.ITIMER_REAL, 0)
    raise KeyboardInterrupt


def _imports(frame: FrameType | None) -> bool:
    """Whether this frame runs within an import."""
    while frame is not None:
        if frame.f_code.co_filename.startswith("<frozen importlib"):
            return True
        frame = frame.f_back
    return False
