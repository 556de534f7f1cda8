"""The thread that renders what the viewer shows, one pass after another.

While the view moves, pictures have as many pixels as can be had in `MOVING_SECONDS`. A view that
rests is rendered in full, in passes whose number and size leave no trace: after N samples the
picture has the bits of `veriray.render` with N samples. A pass that no longer shows what users want
is left as soon as the device asks (about every 10 ms).
"""

from __future__ import annotations

import contextlib
import dataclasses
import threading
import time
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np
import numpy.typing as npt

from .. import device as device_module
from ..accumulation import Accumulation
from ..errors import printable
from ..native_scene import native_scene, roughly
from ..picture import Render
from ..scene import Scene
from ..units import rounded
from . import moves
from .controls import Action, View, applied, reach
from .display import CHANNELS
from .source import Source

Array = npt.NDArray[Any]

#: From the first sample of a picture to its file, while the view moves.
MOVING_SECONDS = 0.045
#: How long after a move the view counts as moving; and time of a sample that is long for a picture.
SETTLE_SECONDS, SLOW_SECONDS = 0.25, 0.25
#: How long the first picture of a change may take at least, before a newer view ends it.
PATIENCE_SECONDS = 1.0
#: Time of a pass at rest: at first, and at most.
PASS_SECONDS, LONGEST_PASS_SECONDS = 0.1, 1.0
#: By what the sides of the picture are divided while the view moves.
COARSE = (1, 2, 3, 4, 6, 8, 12, 16, 24, 32)
#: Samples of such a picture at most.
MOST_COARSE = 64


class _Outdated(Exception):  # noqa: N818
    """Ends a pass whose picture nobody wants any more."""


@dataclass(frozen=True)
class Frame:
    """A picture to show. number: of the frame, from 1. coarse: by what its sides are divided.
    preview: made in a hurry, for eyes alone. done: it has all samples. made: values of the channel
    of the scene that is shown. change: how many changes of the view it shows. marks: when
    the last of them arrived ("asked"), and when each step since then ended (time.perf_counter), in
    order."""

    number: int
    render: Render
    scene: Scene
    coarse: int
    preview: bool
    done: bool
    made: dict[str, Array]
    change: int
    marks: dict[str, float]

    def error(self) -> float | None:
        """Mean standard error over mean radiance; None of a preview, with one sample, and for a
        black picture."""
        error = None if self.preview or self.render.spp < 2 else self.render.stats["mean_stderr"]
        if error is None:
            return None
        mean = float(np.abs(np.asarray(self.render)).mean(dtype=np.float64))
        return float(error) / mean if mean > 0 else None


@dataclass(frozen=True)
class _Shot:
    """What is rendered: a view and its scene; key: `View.picture`; marks: of its last frame."""

    view: View
    scene: Scene
    change: int
    key: tuple[Any, ...]
    marks: dict[str, float]

    def mark(self, step: str) -> None:
        """A step has ended."""
        self.marks[step] = time.perf_counter()


class Renderer:
    """Renders the scene of a source on a thread of its own.

    device, threads: as `veriray.render` takes them. view: at the start. changed: called without
    arguments, on any thread, when there is a new `frame` or `status`.
    Raises what loading the scene raises.
    """

    def __init__(
        self,
        source: Source,
        device: str = "auto",
        threads: int | None = None,
        view: View | None = None,
        changed: Callable[[], object] = lambda: None,
    ) -> None:
        self.source, self.device, self.threads = source, device, threads
        self.file = source.load()
        self.view = view or View()
        self.view.scene(self.file)
        self.changed = changed
        self.frame: Frame | None = None
        #: What goes wrong, or ""; and how often the scene was read.
        self.message, self.loads = "", 1
        self._lock = threading.Lock()
        self._wake = threading.Event()
        self._stopping = self._reload = False
        self._picks: list[Action] = []
        self._asked = self._moved = -1e9
        self._change = 0
        #: Paths a second; seconds that a pixel takes on its way from the film into a file.
        self._rate, self._making = 0.0, {"picture": 0.0, "file": 0.0}
        self._thread = threading.Thread(target=self._run, name="veriray-view", daemon=True)

    # ---- for other threads ----

    def start(self) -> None:
        """Starts to render."""
        self._asked = time.perf_counter()
        self._thread.start()

    def stop(self) -> None:
        """Ends the thread, and waits for it."""
        self._stopping = True
        self._wake.set()
        if self._thread.is_alive():
            self._thread.join()

    def reload(self) -> None:
        """Reads the scene file again."""
        self._reload = True
        self._wake.set()

    def submit(self, action: Action) -> None:
        """Does what a user asks for. Raises ValueError if it is not possible; then nothing is."""
        with self._lock:
            if action.what == "focus":
                self._picks = [*self._picks[-8:], action]
            else:
                self._set(applied(self.view, action, self.file), action.moves)
        self._wake.set()
        self.changed()

    def took(self, step: str, pixels: int, seconds: float) -> None:
        """How long a step towards a picture of so many pixels took; from any thread."""
        known, this = self._making[step], seconds / pixels
        self._making[step] = 0.5 * (known + this) if known else this

    def _set(self, view: View, moves: bool) -> None:
        """Takes another view; the lock is held."""
        if view.picture() != self.view.picture():
            self._asked = time.perf_counter()
            self._change += 1
            if moves:
                self._moved = self._asked
        self.view = view

    # ---- the thread ----

    def _run(self) -> None:
        while not self._stopping:
            self._wake.clear()
            if self._stopping:  # it was set before
                return
            try:
                self._once()
            except _Outdated:
                continue
            except Exception as error:  # of one view; the next one may work
                self._tell(f"{type(error).__name__}: {error}")
                self._wake.wait()

    def _tell(self, message: str) -> None:
        self.message = printable(" ".join(message.split()))
        self.changed()

    def _once(self) -> None:
        """Renders the current view until another one is wanted."""
        if self._reload:
            self._reload = False
            self._read_again()
        self._pick()
        with self._lock:
            view, change, asked = self.view, self._change, self._asked
            scene = view.scene(self.file)
        shot = _Shot(view, scene, change, view.picture(), {"asked": asked})
        shot.mark("taken")
        factor = self._factor(scene) if self._moving or self._slow(scene) else 1
        if factor > 1 or self._moving:
            self._preview(shot, factor)
        while factor > 2 and self._slow(scene):  # comes back in steps, which take a third more
            factor = max(f for f in COARSE if f <= factor // 2)
            self._preview(shot, factor)
        full = self._accumulation(scene, view, shot)
        shot.mark("scene")
        while True:
            self._check(shot)
            if self._picks:
                self._pick()
                continue
            goal = self._goal()
            if goal < full.spp:  # fewer than there are
                raise _Outdated
            if full.spp < goal:
                self._pass(full, self._size(full, goal, self._unseen(shot)), shot)
                self._show(full, shot)
            elif self.frame is None or not self.frame.done or not self._has_channel(self.frame):
                self._show(full, shot)
            else:
                self._wake.wait()
                self._wake.clear()

    def _preview(self, shot: _Shot, factor: int) -> None:
        """Shows what can be had at once, as long as the view moves, and at least once."""
        film = shot.scene.film
        width, height = (-(-n // factor) for n in (film.width, film.height))
        with roughly():
            small = self._accumulation(shot.scene.with_(width=width, height=height), shot.view)
        shot.mark("scene")
        goal = min(self._goal(), MOST_COARSE)
        while not small.spp or self._moving:
            if small.spp < goal:
                self._pass(small, self._size(small, goal, True), shot)
                self._show(small, shot, factor)
            elif self._wake.wait(max(0.0, self._moved + SETTLE_SECONDS - time.perf_counter())):
                self._wake.clear()
            self._check(shot)

    def _goal(self) -> int:
        """How many samples of each pixel are wanted."""
        with self._lock:
            return self.view.scene(self.file).spp

    @property
    def _moving(self) -> bool:
        return time.perf_counter() - self._moved < SETTLE_SECONDS

    def _check(self, shot: _Shot) -> None:
        """Raises _Outdated if what is rendered is not what is wanted."""
        refocus = self._picks and shot.scene.camera.aperture_radius
        if self._stopping or self._reload or refocus or self.view.picture() != shot.key:
            raise _Outdated

    def _accumulation(self, scene: Scene, view: View, shot: _Shot | None = None) -> Accumulation:
        """shot: what its tree is for, which is left where a preview can do without."""
        return Accumulation(
            scene, seed=view.seed, scheduler=view.scheduler, device=self.device,
            threads=self.threads, progress=lambda share: self._building(share, shot),
        )  # fmt: skip

    def _building(self, share: float, shot: _Shot | None = None) -> None:
        if self._stopping:
            raise _Outdated
        if shot is not None and self.file.native_forms:
            self._check(shot)
        self._tell(f"building the tree: {share:.0%}" if share < 1 else "")

    def _slow(self, scene: Scene) -> bool:
        """Whether a sample of every pixel takes long, as far as known."""
        pixels = scene.film.width * scene.film.height
        return self._rate == 0.0 or pixels > SLOW_SECONDS * self._rate

    def _factor(self, scene: Scene) -> int:
        """By what to divide the sides of the picture so that it takes MOVING_SECONDS."""
        pixels = scene.film.width * scene.film.height
        drawn = 1 / self._rate if self._rate else MOVING_SECONDS / (1 << 14)
        one = drawn + sum(self._making.values())
        return next((f for f in COARSE if pixels * one <= MOVING_SECONDS * f * f), COARSE[-1])

    def _size(self, work: Accumulation, goal: int, soon: bool) -> int:
        """Samples of each pixel in the next pass; soon: in MOVING_SECONDS."""
        pixels = work.paths_of(1)
        if soon:
            seconds = MOVING_SECONDS - pixels * sum(self._making.values())
        else:
            spent = self.frame.render.stats["seconds"] if self.frame and work.spp else 0.0
            seconds = min(LONGEST_PASS_SECONDS, PASS_SECONDS + 0.1 * spent)
        left = goal - work.spp
        return rounded(work.spp, max(1, min(left, int(seconds * self._rate / pixels))), left)

    def _pass(self, work: Accumulation, n: int, shot: _Shot) -> None:
        """Draws samples. The first ones of a change are drawn to the end unless they take far
        longer than expected, or a view that changes without a pause would never be seen."""
        paths, done = work.paths_of(n), 0.0
        patience = start = time.perf_counter()
        if self._unseen(shot):
            expected = paths / self._rate if self._rate else 0.0
            patience += max(PATIENCE_SECONDS, 2 * expected)

        def poll(share: float) -> None:
            nonlocal done
            done = share
            if self._stopping or time.perf_counter() > patience:
                self._check(shot)

        try:
            work.add(n, poll)
            done = 1.0
        finally:
            if done:
                known, rate = self._rate, done * paths / max(time.perf_counter() - start, 1e-6)
                if known and done < 1:  # paths of which a device tells may just have begun
                    rate = min(known, rate)
                self._rate = 0.5 * (known + rate) if known else rate

    def _unseen(self, shot: _Shot) -> bool:
        return self.frame is None or self.frame.change != shot.change

    def _show(self, work: Accumulation, shot: _Shot, preview: int = 0) -> None:
        """preview: by what the sides are divided, of a preview."""
        shot.mark("samples")
        render = work._render()
        refused = render.stats["nonfinite_samples"]
        self.message = f"{refused:,} samples count as black: the film cannot hold them"
        self.message = self.message if refused else ""
        coarse, done = preview or 1, not preview and work.spp >= self._goal()
        _ = np.asarray(render)  # copied before the next pass keeps the device busy
        if done or self.view.channel != "radiance":
            _ = render.stderr
        made = self._made(render, shot, coarse)
        number = self.frame.number + 1 if self.frame is not None else 1
        shot.mark("picture")
        marks = dict(shot.marks)
        if not done:
            self.took("picture", render.width * render.height, marks["picture"] - marks["samples"])
        self.frame = Frame(
            number, render, shot.scene, coarse, preview > 0, done, made, shot.change, marks
        )
        self.changed()

    def _has_channel(self, frame: Frame) -> bool:
        channel = self.view.channel
        return CHANNELS[channel].of_scene is None or channel in frame.made

    def _made(self, render: Render, shot: _Shot, coarse: int) -> dict[str, Array]:
        """Values of the channel that is shown, if it is one of the scene."""
        channel, last = self.view.channel, self.frame
        found = CHANNELS[channel]
        if found.of_scene is None:
            return {}
        if last is not None and (last.change, last.coarse) == (shot.change, coarse):
            if channel in last.made:
                return last.made
        size = render.height, render.width
        try:
            scene = shot.scene.with_(width=size[1], height=size[0])
            return {channel: found.of_scene(scene, self.device)}
        except ValueError as error:  # of a scene without it
            self.message = printable(f"{found.title}: {error}")
            return {channel: np.full(size if found.ends else (*size, 3), np.nan, np.float32)}

    def _read_again(self) -> None:
        try:
            file = self.source.load()
            with self._lock:
                self.view.scene(file)
                self.file, self._asked = file, time.perf_counter()
                if self.view.camera is None:
                    self.view = dataclasses.replace(self.view, distance=None)
                self.loads, self._change = self.loads + 1, self._change + 1
            self.message = ""
        except (ValueError, OSError) as error:
            self._tell(str(error))
            self._wake.wait()
            raise _Outdated from None

    def _pick(self) -> None:
        """Finds what users clicked at, and what is ahead if that is not known."""
        with self._lock:
            picks, self._picks = self._picks, []
            scene = self.view.scene(self.file)
            if not picks and self.view.distance is not None:
                return
        device, _ = device_module.select(self.device, fresh=False)
        places = [action.numbers for action in picks] or [(0.5, 0.5)]
        rays = [moves.ray(scene.camera, scene.film, *place) for place in places]
        origins, directions = (np.array([ray[k] for ray in rays]) for k in (0, 1))
        with device_module.native_errors():
            native = native_scene(self.file, scene, device, self._building, spp=scene.spp)
            t, hit = device.native.intersect(native, origins, directions)
        depths = [
            float(along) * ray[2] if primitive >= 0 else None
            for ray, along, primitive in zip(rays, t, hit, strict=True)
        ]
        with self._lock:
            if not picks:
                distance = reach(scene) if depths[0] is None else depths[0]
                self.view = dataclasses.replace(self.view, distance=distance)
            for action, depth in zip(picks, depths, strict=False):
                with contextlib.suppress(ValueError):  # a camera in the surface that it sees
                    self._set(applied(self.view, action, self.file, depth), False)
        self.changed()
