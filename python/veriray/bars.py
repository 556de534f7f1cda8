"""The bar of `render(..., progress=True)`: in a terminal, in a notebook, or two plain lines.

It shows samples per pixel, samples a second, the time left and the memory of this process, and
when the picture is done its error.
"""

from __future__ import annotations

import contextlib
import importlib
import os
import sys
import time
from collections.abc import Callable, Iterator
from typing import Any, TextIO

from .extras import has_bars

#: Least seconds between two states that are shown.
PAUSE = 0.1


class Bar:
    """A progress callback that shows what it is told.

    size: pixels; spp: samples per pixel. show: called with the fraction done and a line of text.
    """

    def __init__(self, size: int, spp: int, show: Callable[[float, str], None]) -> None:
        self.size, self.spp, self.show = size, spp, show
        self.start = self.shown = time.perf_counter()

    def __call__(self, fraction: float) -> None:
        """Shows the state, if the last one is PAUSE old; fraction: done, in [0, 1]."""
        now = time.perf_counter()
        if now - self.shown < PAUSE:
            return
        self.shown, seconds = now, now - self.start
        left = seconds / fraction - seconds if fraction > 0 else float("inf")
        text = ""
        if self.spp:
            text = f"{fraction * self.spp:,.0f} of {self.spp:,} spp, "
            text += f"{self._rate(fraction, seconds)}, "
        self.show(fraction, f"{text}{duration(left)} left, {memory()}")

    def done(self, error: float | None) -> None:
        """The last line; error: mean standard error, None if unknown."""
        seconds = time.perf_counter() - self.start
        about = "" if error is None else f", mean standard error {error:.3g}"
        text = duration(seconds)
        if self.spp:
            text = f"{self.spp:,} spp in {text}, {self._rate(1.0, seconds)}"
        self.show(1.0, f"{text}{about}, {memory()}")

    def _rate(self, fraction: float, seconds: float) -> str:
        rate = fraction * self.size * self.spp / max(seconds, 1e-9)
        unit, factor = next((u, f) for u, f in ((" G", 1e9), (" M", 1e6), (" k", 1e3), (" ", 1.0))
                            if rate >= f or f == 1.0)  # fmt: skip
        return f"{rate / factor:.3g}{unit}samples/s"


@contextlib.contextmanager
def bar(width: int, height: int, spp: int) -> Iterator[Bar]:
    """A bar for a render of this size, on standard error or in the notebook's cell."""
    title = f"rendering {width} x {height}"
    size, notebook = width * height, _notebook()
    if notebook is not None:
        yield Bar(size, spp, _Cell(notebook, title).show)
    elif not has_bars():
        yield Bar(size, spp, _Lines(title, sys.stderr).show)
    else:
        from rich.console import Console
        from rich.progress import BarColumn, Progress, TaskProgressColumn, TextColumn

        columns = TextColumn("{task.description}"), BarColumn(), TaskProgressColumn()
        console = Console(stderr=True)
        with Progress(*columns, TextColumn("{task.fields[text]}"), console=console) as progress:
            task = progress.add_task(title, total=1.0, text="")
            yield Bar(
                size, spp,
                lambda done, text: progress.update(task, completed=done, text=text, refresh=True),
            )  # fmt: skip


def duration(seconds: float) -> str:
    """A time as people write it."""
    if seconds < 99.5:
        return f"{seconds:.2g} s" if seconds < 9.95 else f"{seconds:.0f} s"
    if not seconds < 1e9:
        return "unknown time"
    minutes, hours = divmod(round(seconds / 60), 60)[::-1]
    return f"{hours} h {minutes} min" if hours else f"{minutes} min"


def memory() -> str:
    """The memory of this process."""
    try:
        with open("/proc/self/statm", encoding="ascii") as file:
            pages = int(file.read().split()[1])
    except (OSError, ValueError, IndexError):
        return "memory unknown"
    return f"{pages * os.sysconf('SC_PAGE_SIZE') / 2**20:,.0f} MiB"


class _Lines:
    """Where nothing can be drawn: the title at the start, and the last line."""

    def __init__(self, title: str, file: TextIO | None) -> None:
        self.file = file
        self.say(title)

    def say(self, text: str) -> None:
        if self.file is not None:
            with contextlib.suppress(OSError, ValueError):
                print(text, file=self.file, flush=True)

    def show(self, fraction: float, text: str) -> None:
        if fraction == 1.0 and " in " in text:
            self.say(text)


class _Cell:
    """A bar below a notebook's cell, drawn by the browser."""

    def __init__(self, display: Any, title: str) -> None:
        self.display, self.title = display, title
        self.handle: Any = None

    def show(self, fraction: float, text: str) -> None:
        page = self.display.HTML(
            f'<div>{self.title} <progress max="1" value="{fraction:.4f}" style="width:16em">'
            f"</progress> {fraction:.0%} {text}</div>"
        )
        if self.handle is None:
            self.handle = self.display.display(page, display_id=True)
        else:
            self.handle.update(page)


def _notebook() -> Any:
    """IPython's displays if a notebook runs this, else None."""
    core = sys.modules.get("IPython")
    shell = core.get_ipython() if core is not None else None
    if shell is None or getattr(shell, "kernel", None) is None:
        return None
    return importlib.import_module("IPython.display")
