"""Renders on the nodes of a Ray cluster: `veriray.render(scene, cluster=ADDRESS)`.

One actor for each node (`veriray.cluster_worker`) draws ranges of samples (`veriray.splitting`)
with all devices of its node into films of its own. At the end of a pass the films are joined in a
tree, from node to node, so that this machine receives one. A worker that dies takes what it drew of
the pass with it: others draw it again, and another worker takes its place.
"""

from __future__ import annotations

import contextlib
import itertools
import signal
import threading
import time
import warnings
from collections.abc import Callable, Iterator
from dataclasses import dataclass, field
from types import FrameType
from typing import TYPE_CHECKING, Any

import numpy.typing as npt

from . import device as device_module
from . import interrupts
from .cluster_worker import Worker, differences, digests
from .crew import Drawn, Films, Place, Team, listed
from .errors import DeviceError, DeviceWarning, OutOfMemoryError
from .extras import need
from .reports import added, in_order
from .scene import Scene
from .settings import RenderSettings
from .splitting import Split

if TYPE_CHECKING:
    from ._native import FilmState, Report

Array = npt.NDArray[Any]
Progress = Callable[[float], object] | None

#: Seconds that a range takes at most: what Ctrl-C waits for. Seconds between looks at the list of
#: nodes, for a first worker at most, and between calls of a progress callback.
LONGEST, LOOK, FIRST, PAUSE = 2.0, 2.0, 300.0, 0.1
#: Seconds of a pass (`veriray.course`), after which the nodes' films are joined.
PASS = 60.0
#: Deaths of a node's workers in a row, without a range between them, after which it is left out;
#: and attempts at joining films while nobody dies.
DEATHS, TRIES = 5, 5


@dataclass(eq=False)
class Member:
    """A node's worker. state: "asked", "preparing", "ready", "drawing", "busy" (with a range of a
    pass that was dropped), "lost" or "out"; paths, seconds: of whole passes; said: its reports of
    this one."""

    node: str
    threads: int
    gpus: float
    actor: Any = None
    name: str = ""
    state: str = "asked"
    rate: float = 0.0
    deaths: int = 0
    about: dict[str, Any] = field(default_factory=dict)
    said: list[Report] = field(default_factory=list)
    paths: int = 0
    seconds: float = 0.0


class Cluster(Team):
    """The nodes of the cluster at `settings.cluster`, ready for a scene.

    Nodes that appear later join. Raises DeviceError if there is no cluster, or no node that can
    draw, and ValueError as `veriray.render`. Warns (DeviceWarning) of nodes that are left out.
    """

    seconds = PASS

    def __init__(
        self, owner: Scene, scene: Scene, settings: RenderSettings, progress: Progress
    ) -> None:
        self._ray = _connected(settings.cluster)
        device, _ = device_module.select("cpu", fresh=False)
        super().__init__([Place(device, (scene.film.width, scene.film.height))])
        self.settings, self._members = settings, dict[str, Member]()
        given = {**settings.__dict__, "cluster": "", "batches": 0, "target_error": None,
                 "features": (), "motion_to": None}  # fmt: skip
        self._shipped = self._ray.put((scene, given, scene.sha256))
        self._pending: dict[Any, tuple[Member, float]] = {}
        self._looked, self._number = 0.0, 0
        self._split: Split | None = None
        self.facts: dict[str, Any] = {}
        begun = time.monotonic()
        try:
            while not self.facts:
                self._look()
                self._turn()
                if time.monotonic() - begun > FIRST:
                    raise DeviceError(
                        f"cluster {settings.cluster}: no node was ready in {FIRST:.0f} s"
                    )
        except BaseException:
            self.close()
            raise

    @property
    def least(self) -> int:
        """Samples per pixel of a pass that gives each something to do."""
        return max(1, len(self._able()))

    @property
    def machine(self) -> dict[str, str]:
        """What a checkpoint says of who drew its samples."""
        abouts = [m.about for m in self._members.values() if m.about]
        return {
            key: listed(str(about[key]) for about in abouts)
            for key in ("device", "device_name", "scheduler")
        }

    def stats(self, films: Films) -> dict[str, Any]:
        """For `Render.stats`; memory is that of all nodes' scenes and this machine's film."""
        there = [m for m in self._members.values() if m.about]
        own = sum(int(film.memory) for film in films if film is not None)
        each = [
            {"node": m.name, **m.about, "paths": m.paths, "seconds": m.seconds, "deaths": m.deaths}
            for m in there
        ]
        return {
            **self.machine,
            "device_reason": f"nodes of {self.settings.cluster}",
            "scheduler_reason": there[0].about["scheduler_reason"],
            "threads": sum(m.threads for m in there),
            "memory": own + sum(m.about["memory"] for m in there),
            "devices": each,
        }

    def draw(
        self, begin: int, n: int, pixels: Array | None, units: bool, progress: Progress
    ) -> Drawn:
        """A pass. Ctrl-C gives out no more, and ends it with what was given out; Ctrl-C again drops
        it."""
        start, self._number = time.perf_counter(), self._number + 1
        self._wanted, self._paths, self._units = n, self.paths_of(pixels), units
        self._pixels = None if pixels is None else self._ray.put(pixels)
        split = self._split = Split(begin, begin + n, {}, LONGEST, units)
        for member in self._able():
            member.said = []
            split.join(member.node, member.rate / self._paths)
            if member.state == "drawing":  # of a pass that was dropped
                member.state = "busy"
        try:
            with _interrupts() as asked:
                while (state := self._collected(asked, progress)) is None:
                    if split.end == begin:
                        raise KeyboardInterrupt
        finally:
            self._split, self._pixels = None, None
        film = self._places[0].blank()
        film.add_state(state)
        report = self._report(split, time.perf_counter() - start)
        return Drawn((film,), report, split.end - begin, bool(asked))

    def _collected(self, asked: list[int], progress: Progress) -> FilmState | None:
        """Draws on; the film of all nodes if that is done, None where some must be drawn again."""
        split = self._split
        assert split is not None
        while not split.done:
            self._look()
            for member in self._able():
                if member.state == "ready" and (piece := split.take(member.node)) is not None:
                    self._ask(member, "drawing", "draw", self._number, *piece, self._pixels,
                              self._units)  # fmt: skip
            self._turn()
            if asked:
                split.close()
            if progress is not None:
                progress(min(sum(split.drawn(m.node) for m in self._able()) / self._wanted, 1.0))
        if not any(split.drawn(m.node) for m in self._able()):
            return None
        for _ in range(TRIES):
            state = self._joined([m for m in self._able() if split.drawn(m.node)])
            if state is not None:
                return state
            alive = [self._lives(m) for m in self._able()]
            if not all(alive):
                return None
        raise DeviceError("the films of the nodes cannot be joined: they are lost again and again")

    def _joined(self, members: list[Member]) -> FilmState | None:
        """The sum of the films of these, made in a tree of their nodes; None if one was lost."""
        level = [(m, m.actor.state.remote(self._number)) for m in members]
        while len(level) > 1:
            pairs = itertools.zip_longest(level[::2], level[1::2])
            level = [
                first if second is None else (first[0], first[0].actor.joined.remote(
                    first[1], second[1]))
                for first, second in pairs
            ]  # fmt: skip
        try:
            state: FilmState = self._ray.get(level[0][1])
        except self._ray.exceptions.RayError:
            return None
        return state

    def _lives(self, member: Member) -> bool:
        try:
            self._ray.get(member.actor.hello.remote(), timeout=60)
        except self._ray.exceptions.RayError as error:
            self._died(member, error)
            return False
        return True

    def _report(self, split: Split, seconds: float) -> Report:
        total: Report | None = None
        for member in self._able():
            for said in member.said:
                total = added(total, said)
            drawn = split.drawn(member.node) * self._paths
            member.paths += drawn
            member.seconds += sum(said["seconds"] for said in member.said)
            member.rate = split.rate(member.node) * self._paths
        assert total is not None
        total["seconds"], total["nonfinite"] = seconds, in_order(total["nonfinite"])
        return total

    # ---- workers ----

    def _able(self) -> list[Member]:
        """Those that draw or will at once."""
        return [m for m in self._members.values() if m.state in ("ready", "drawing", "busy")]

    def _look(self) -> None:
        """Workers for nodes that are new, every LOOK seconds."""
        if time.monotonic() - self._looked < LOOK:
            return
        self._looked = time.monotonic()
        for node in self._ray.nodes():
            threads = int(node["Resources"].get("CPU", 0))
            if node["Alive"] and threads and node["NodeID"] not in self._members:
                gpus = node["Resources"].get("GPU", 0.0)
                if str(self.settings.device).startswith("cpu"):
                    gpus = 0.0
                member = Member(node["NodeID"], threads, gpus, name=node["NodeManagerHostname"])
                self._members[member.node] = member
                self._start(member)

    def _start(self, member: Member) -> None:
        from ray.util.scheduling_strategies import NodeAffinitySchedulingStrategy

        remote = self._ray.remote(Worker)
        member.actor = remote.options(
            num_cpus=member.threads,
            num_gpus=member.gpus,
            max_restarts=0,
            scheduling_strategy=NodeAffinitySchedulingStrategy(member.node, soft=False),
        ).remote()
        self._ask(member, "asked", "hello")

    def _ask(self, member: Member, state: str, method: str, *arguments: Any) -> None:
        member.state = state
        call = getattr(member.actor, method).remote(*arguments)
        self._pending[call] = member, time.perf_counter()

    def _turn(self) -> None:
        """Takes what workers have answered, after PAUSE seconds at most."""
        if not self._pending:
            time.sleep(PAUSE)  # nodes may come
            if self._members and not self._able():
                raise DeviceError(f"cluster {self.settings.cluster}: no node can draw")
            return
        answers, _ = self._ray.wait(list(self._pending), timeout=PAUSE)
        for call in answers:
            member, asked = self._pending.pop(call)
            try:
                answer = self._ray.get(call)
            except self._ray.exceptions.RayTaskError as error:
                self._failed(member, error)
            except self._ray.exceptions.RayError as error:
                self._died(member, error)
            else:
                self._answered(member, answer, time.perf_counter() - asked)

    def _answered(self, member: Member, answer: Any, seconds: float) -> None:
        if member.state == "asked":
            name, other = answer
            member.name = name
            if why := differences(digests(), other):
                self._leave(member, f"{why}: refused")
                return
            threads = min(member.threads, self.settings.threads or member.threads)
            self._ask(member, "preparing", "prepare", self._shipped, threads)
        elif member.state == "preparing":
            member.about, member.state = answer["about"], "ready"
            self.facts = self.facts or answer["facts"]
            if self._split is not None:
                member.said = []
                self._split.join(member.node, member.rate / self._paths)
        elif member.state == "busy":
            member.state = "ready"
        else:
            assert self._split is not None
            self._split.finished(member.node, seconds)
            member.said.append(answer)
            member.state, member.deaths = "ready", 0

    def _lost(self, member: Member) -> None:
        """What it holds of this pass is drawn again."""
        if self._split is not None and member.state in ("ready", "drawing", "busy"):
            self._split.lost(member.node)
        member.state, member.said = "lost", []

    def _died(self, member: Member, error: BaseException) -> None:
        """Another worker for a node, unless it is gone or its workers die at once."""
        if member.state == "out":
            return
        self._forget(member)
        with contextlib.suppress(Exception):
            self._ray.kill(member.actor)  # one that only does not answer holds its processors
        member.deaths += 1
        nodes = {node["NodeID"] for node in self._ray.nodes() if node["Alive"]}
        if member.node not in nodes:
            self._leave(member, "the node is gone")
        elif member.deaths > DEATHS:
            self._leave(member, f"its workers die: {_first_line(error)}")
        else:
            self._start(member)

    def _failed(self, member: Member, error: Any) -> None:
        """A worker raised an error: the others draw for it, if it is one of its device."""
        cause = error.cause
        text = f"{type(cause).__name__}: {_first_line(cause)}"
        kinds = (MemoryError, DeviceError)
        others = [m for m in self._members.values() if m is not member and m.state != "out"]
        if isinstance(cause, kinds) and others:
            self._leave(member, text)
            return
        named = f"node {member.name}: {text}"
        raise OutOfMemoryError(named) if isinstance(cause, MemoryError) else DeviceError(named)

    def _leave(self, member: Member, why: str) -> None:
        self._forget(member)
        member.state = "out"
        self._ray.kill(member.actor)
        warnings.warn(f"node {member.name} takes no part: {why}", DeviceWarning, stacklevel=2)

    def _forget(self, member: Member) -> None:
        self._lost(member)
        for call in [c for c, (m, _) in self._pending.items() if m is member]:
            del self._pending[call]

    def close(self) -> None:
        """Ends the workers; the connection stays."""
        for member in self._members.values():
            if member.state != "out":
                with contextlib.suppress(Exception):
                    self._ray.kill(member.actor)
            member.state = "out"
        self._pending.clear()


def _connected(address: object) -> Any:
    """The module ray, connected to a cluster."""
    if not isinstance(address, str):
        raise ValueError(f"cluster = {address!r}; expected auto, local, HOST:PORT or ray://...")
    need("a cluster", "cluster")
    import ray

    if not ray.is_initialized():
        options: dict[str, Any] = {"log_to_driver": False, "logging_level": "error"}
        if address == "local":
            options["include_dashboard"] = False
        before = signal.getsignal(signal.SIGTERM)
        try:
            ray.init(address, **options)
        except (ConnectionError, RuntimeError, ValueError, OSError) as error:
            raise DeviceError(f"cluster {address}: {_first_line(error)}") from error
        if before is interrupts.interrupt:  # Ray takes SIGTERM for itself
            signal.signal(signal.SIGTERM, before)
    return ray


def _first_line(error: BaseException) -> str:
    """The first line of a message, and the last one, where Ray states the cause."""
    lines = str(error).strip().splitlines() or [type(error).__name__]
    return lines[0] if len(lines) == 1 else f"{lines[0]} ... {lines[-1].strip()}"


@contextlib.contextmanager
def _interrupts() -> Iterator[list[int]]:
    """The first of `interrupts.SIGNALS` fills the list; the next raises KeyboardInterrupt. Only
    those that raise it now, on the main thread."""
    asked: list[int] = []
    main = threading.current_thread() is threading.main_thread()
    raising = (signal.default_int_handler, interrupts.interrupt)
    before = {number: signal.getsignal(number) for number in interrupts.SIGNALS}
    ours = [number for number, handler in before.items() if main and handler in raising]

    def handle(number: int, frame: FrameType | None) -> None:
        interrupts.heard(number)
        asked.append(number)
        if len(asked) > 1:
            interrupts.interrupt(number, frame)

    for number in ours:
        signal.signal(number, handle)
    try:
        yield asked
    finally:
        for number in ours:
            signal.signal(number, before[number])
