"""How soon the viewer answers, on a device and a clock that are not real: exact, on any machine."""

from __future__ import annotations

import contextlib
import types
from collections.abc import Callable
from typing import Any

import numpy as np
import pytest

import veriray as vr
from veriray.viewer import renderer as renderer_module
from veriray.viewer.controls import Action, View
from veriray.viewer.source import Source


class Machine:
    """A device that draws `rate` paths a second and asks every 10 ms, with a clock of its own.

    making: seconds for a pixel of a picture, and as many for one of its file, which another thread
    makes. drags: when a user drags. last: when all ends.
    """

    def __init__(
        self, rate: float, making: float, drags: list[float], last: float, spp: int = 1 << 20
    ) -> None:
        self.rate, self.making, self.drags, self.last, self.now = rate, making, drags, last, 0.0
        self.seen: list[tuple[float, Any]] = []  # frames, and when their files were made
        view = View(width=1280, height=720, spp=spp, distance=1.0)
        self.renderer: Any = renderer_module.Renderer(Source("cornell-box"), "cpu", view=view)
        self.renderer._accumulation = self.work
        self.renderer._wake = self
        self.renderer.changed = self.changed

    def perf_counter(self) -> float:
        return self.now

    def spend(self, seconds: float) -> None:
        self.now += seconds
        while self.drags and self.drags[0] <= self.now:
            self.drags.pop(0)
            self.renderer.submit(Action("orbit", numbers=(0.01, 0.0)))
        self.renderer._stopping = self.now >= self.last

    def wait(self, _: float = 0.0) -> bool:
        self.spend(0.001)
        return False

    def set(self) -> None:
        """There is no other thread to wake."""

    clear = set

    def work(self, scene: vr.Scene, *_: Any) -> Any:
        """In place of an accumulation."""
        height, width = scene.film.height, scene.film.width
        pixels, work = width * height, types.SimpleNamespace(spp=0)

        def add(n: int, poll: Callable[[float], object]) -> None:
            whole = left = n * pixels / self.rate
            while left > 0:
                self.spend(min(left, 0.01))
                left -= 0.01
                poll(1 - 0.5 * max(left, 0.0) / whole)  # more has begun than is done
            work.spp += n

        def render() -> Any:
            self.spend(pixels * self.making)
            image = np.zeros((height, width, 3), np.float32)
            stats = {"nonfinite_samples": 0, "seconds": work.spp * pixels / self.rate}
            return vr.Render(image, image, None, "", stats, width, height, work.spp, 0)

        work.paths_of, work.add, work._render = pixels.__mul__, add, render
        return work

    def changed(self) -> None:
        frame = self.renderer.frame
        if frame is not None and (not self.seen or self.seen[-1][1] is not frame):
            pixels = frame.render.width * frame.render.height
            self.renderer.took("file", pixels, pixels * self.making)
            self.seen.append((self.now + pixels * self.making, frame))

    def run(self, monkeypatch: pytest.MonkeyPatch) -> list[tuple[float, Any]]:
        monkeypatch.setattr(renderer_module, "time", self)
        while not self.renderer._stopping:
            with contextlib.suppress(renderer_module._Outdated):
                self.renderer._once()
        return self.seen


@pytest.mark.parametrize("begin", [1.0, 1.03, 1.06])
@pytest.mark.parametrize("making", [1e-9, 3e-8, 1e-7])
@pytest.mark.parametrize("rate", [1e10, 1e9, 3e6])
def test_answers_in_time(
    rate: float, making: float, begin: float, monkeypatch: pytest.MonkeyPatch
) -> None:
    """However fast samples are drawn and files are made: the first picture within 100 ms after a
    drag, unless all pixels of one take longer, and 20 a second while it lasts, with all pixels
    where there is time for them."""
    drags = [begin + k / 60 for k in range(120)]
    seen = Machine(rate, making, drags, 5.0).run(monkeypatch)
    moving = [(at, frame) for at, frame in seen if frame.preview and begin < at < 3.3]
    assert moving[0][0] <= begin + 0.1 or making > 3e-8
    assert max(at - frame.marks["asked"] for at, frame in moving if 1.5 < at < 3.0) <= 0.1
    for second in (1.5, 2.0):
        assert sum(second < at <= second + 1 for at, _ in moving) >= 20
    if rate >= 1e9 and making <= 1e-8:
        assert {frame.coarse for _, frame in moving} == {1}
    last = seen[-1][1]
    assert (last.coarse, last.preview, last.change) == (1, False, 120)


def test_a_picture_is_done_at_rest(monkeypatch: pytest.MonkeyPatch) -> None:
    """One that has all its samples at once is not done, and so not sent without loss, before the
    view rests; it is shown once more then, and not again."""
    seen = Machine(1e9, 1e-9, [2 + k / 60 for k in range(60)], 5.0, spp=4).run(monkeypatch)
    assert all(frame.render.spp == 4 for _, frame in seen[-20:])
    moving = [frame.number for _, frame in seen if frame.preview and frame.change]
    assert not any(frame.done for _, frame in seen if frame.preview)
    assert len(moving) >= 20 and seen[-1][1].done and seen[-1][1].number == moving[-1] + 1
