"""What happens around a render: Ctrl-C, threads, fork, the end of the process, little memory."""

from __future__ import annotations

import copy
import os
import random
import re
import signal
import subprocess
import sys
import threading
import time
from pathlib import Path
from types import FrameType
from typing import Any

import pytest

import veriray as vr
from veriray import native_scene

unix = pytest.mark.skipif(not hasattr(signal, "setitimer"), reason="needs POSIX signals")

#: A scene whose tree takes a good part of a second to build.
BIG = """
import os, sys, threading, time, numpy as np, veriray as vr
def big(n=300_000):
    points = np.random.default_rng(1).random((3 * n, 3))
    return vr.Scene(
        vertices=points, triangles=np.arange(3 * n).reshape(-1, 3),
        triangle_material=np.zeros(n, int), triangle_emission=-np.ones(n, int),
        reflectance=np.full((1, 3), 0.5), two_sided=np.ones(1, bool), emissions=np.zeros((0, 3)),
        environment=np.ones(3), camera=vr.cornell_box().camera, film=vr.Film(16, 16))
"""


def python(code: str, *, seconds: float = 60, **options: Any) -> subprocess.CompletedProcess[str]:
    """Runs a program that uses veriray."""
    folder = Path(vr.__file__).parents[1]
    path = os.pathsep.join([str(folder), os.environ.get("PYTHONPATH", "")])
    return subprocess.run(
        [sys.executable, "-W", "ignore::DeprecationWarning", "-c", code],
        env={**os.environ, "PYTHONPATH": path}, text=True,
        capture_output=True, timeout=seconds, check=False, **options,
    )  # fmt: skip


def film(scene: vr.Scene) -> str:
    settings: dict[str, Any] = {"width": 4, "height": 4, "spp": 1, "threads": 1, "max_depth": 2}
    return vr.render(scene, device="cpu", **settings).film_sha256


@pytest.fixture(scope="module")
def films() -> list[tuple[vr.Scene, str]]:
    """Scenes and the hashes of their pictures."""
    scenes = [vr.cornell_box(), vr.load_file("open")]
    return [(scene, film(scene)) for scene in scenes]


# Ctrl-C


def lines_of(name: str) -> list[int]:
    code = getattr(native_scene, name).__code__
    return sorted({line for _, _, line in code.co_lines() if line} - {code.co_firstlineno})


@pytest.mark.parametrize("line", lines_of("native_scene"))
def test_no_stale_scene_after_an_interrupt_at_any_line(
    line: int, films: list[tuple[vr.Scene, str]]
) -> None:
    (first, _), (second, right) = films

    def trace(frame: FrameType, event: str, arg: object) -> Any:
        if frame.f_code is not native_scene.native_scene.__code__:
            return None
        if event == "line" and frame.f_lineno == line:
            sys.settrace(None)
            raise KeyboardInterrupt
        return trace

    def interrupted(scene: vr.Scene) -> None:
        before = sys.gettrace()
        sys.settrace(trace)
        try:
            film(scene)
        except KeyboardInterrupt:
            native_scene._new_lock()  # held if the tracer raised on the way out of the with block
            film(scene)  # the next render works
        finally:
            sys.settrace(before)

    old = [copy.copy(first) for _ in range(8)]  # which have no native forms yet
    for scene in old:
        interrupted(scene)
    del old, scene
    later = [copy.copy(second) for _ in range(32)]  # some at the addresses of the old
    assert {film(scene) for scene in later} == {right}


def interrupt_often(films: list[tuple[vr.Scene, str]], seconds: float, seed: int) -> int:
    rng, count, renders = random.Random(seed), 0, 0

    def raise_it(number: int, frame: FrameType | None) -> None:
        raise KeyboardInterrupt

    before = signal.signal(signal.SIGALRM, raise_it)
    end = time.monotonic() + seconds
    scene: vr.Scene | None = None
    try:
        while time.monotonic() < end:
            try:
                signal.setitimer(signal.ITIMER_REAL, rng.uniform(1e-5, 4e-3))
                while True:
                    renders += 1
                    given, right = films[renders % len(films)]
                    scene = copy.copy(given).with_(seed=renders)
                    assert film(scene) == right
                    scene = None
            except KeyboardInterrupt:
                count += 1
                scene = None
    finally:
        signal.setitimer(signal.ITIMER_REAL, 0)
        signal.signal(signal.SIGALRM, before)
    return count


@unix
def test_pictures_are_right_after_interrupts(films: list[tuple[vr.Scene, str]]) -> None:
    assert interrupt_often(films, 2.0, 1) > 100
    with_thread: list[str] = []  # the lock is free
    scene, right = films[0]
    thread = threading.Thread(
        target=lambda: with_thread.append(film(scene.with_(seed=5))), daemon=True
    )
    thread.start()
    thread.join(30)
    assert with_thread == [right]


@unix
@pytest.mark.slow
def test_pictures_are_right_after_many_interrupts(films: list[tuple[vr.Scene, str]]) -> None:
    assert interrupt_often(films, 60.0, 2) > 3000


# The end of the process


@pytest.mark.parametrize("what", ["vr.render(big(), device='cpu', spp=2**30)",
                                  "vr.render(vr.cornell_box(), device='cpu', spp=2**30)",
                                  "render_again_and_again()"])  # fmt: skip
@pytest.mark.parametrize("wait", [0.05, 0.3])
def test_the_process_ends_while_a_daemon_thread_renders(what: str, wait: float) -> None:
    code = f"""{BIG}
def render_again_and_again():
    while True: vr.render(vr.cornell_box(), device='cpu', spp=1, width=8, height=8)
vr.render(vr.cornell_box(), device='cpu', spp=1, width=8, height=8)
for _ in range(3): threading.Thread(target=lambda: {what}, daemon=True).start()
time.sleep({wait})
"""
    done = python(code)
    assert (done.returncode, done.stderr) == (0, "")


# fork


FORK = """
threading.Thread(target=work, daemon=True).start()
time.sleep(WAIT)
child = os.fork()
if child == 0:
    box = vr.cornell_box()
    assert vr.render(box, width=8, height=8, spp=1, device='cpu').film_sha256 == right
    assert scene.with_(spp=5).sha256
    os._exit(7)
end = time.time() + 20
while time.time() < end:
    done, status = os.waitpid(child, os.WNOHANG)
    if done: os._exit(os.waitstatus_to_exitcode(status))
    time.sleep(0.02)
os.kill(child, 9)
os._exit(1)
"""


@pytest.mark.skipif(not hasattr(os, "fork"), reason="needs fork")
@pytest.mark.parametrize(
    "work",
    [
        "vr.render(scene, spp=1, device='cpu')",
        "[scene.with_(spp=k).scaled(2) for k in range(1, 9)]",
    ],
)
def test_a_child_renders_after_fork_from_a_busy_thread(work: str) -> None:
    code = f"""{BIG}
right = vr.render(vr.cornell_box(), width=8, height=8, spp=1, device='cpu').film_sha256
scene = big()
work = lambda: {work}
WAIT = 0.1
{FORK}"""
    done = python(code)
    assert (done.returncode, done.stderr) == (7, "")


@pytest.mark.skipif(not hasattr(os, "fork"), reason="needs fork")
@pytest.mark.parametrize("wait", [0.01, 0.03, 0.05, 0.08])
def test_a_child_renders_after_fork_while_a_thread_imports(wait: float) -> None:
    """What is imported on first use is imported by the thread when the process forks."""
    film = vr.render(vr.cornell_box(), width=8, height=8, spp=1, device="cpu").film_sha256
    code = f"""
import os, threading, time, veriray as vr
right = {film!r}
scene = vr.cornell_box()
work = lambda: vr.render(scene, spp=64, device='cpu')
WAIT = {wait}
{FORK}"""
    done = python(code)
    assert (done.returncode, done.stderr) == (7, "")


# Little memory


LITTLE = """
import resource, veriray as vr
box = vr.cornell_box()
vr.render(box, width=4, height=4, spp=1, device='cpu', threads=1)
scene = {scene}
used = int(open('/proc/self/statm').read().split()[0]) * resource.getpagesize()
resource.setrlimit(resource.RLIMIT_AS, (used + {room}, -1))
try:
    vr.render(scene, device='cpu', threads=64, scheduler='{scheduler}')
except vr.OutOfMemoryError as error:
    assert str(error)
"""


@pytest.mark.skipif(not Path("/proc/self/statm").exists(), reason="needs Linux")
@pytest.mark.parametrize("scheduler", ["fused", "thrust", "wavefront"])
@pytest.mark.parametrize("room", [0, 2**16, 2**18, 2**20, 9 * 2**20, 100 * 2**20])
def test_little_memory_is_an_out_of_memory_error(scheduler: str, room: int) -> None:
    """Or a picture, on as many threads as there is room for."""
    scene = "box.with_(width=64, height=64, spp=4)"
    done = python(LITTLE.format(scene=scene, room=room, scheduler=scheduler))
    assert (done.returncode, done.stderr) == (0, "")


NO_THREADS = """
import resource
box = vr.cornell_box().with_(width=16, height=16, spp=2)
scene = {scene}
settings = dict(device='cpu', scheduler='{scheduler}')
right = vr.render(box, **settings).film_sha256
if os.geteuid() == 0:  # whom no limit binds
    os.setgroups([])
    os.setgid({user})
    os.setuid({user})
resource.setrlimit(resource.RLIMIT_NPROC, ({most}, {most}))
try:
    for _ in range({most}): threading.Thread(target=time.sleep, args=(0.2,)).start()
    sys.exit("threads start in spite of RLIMIT_NPROC")
except RuntimeError:
    time.sleep(0.4)
try:
    assert vr.render(scene, threads=8, **settings).film_sha256 == right
    print('fewer')
except vr.OutOfMemoryError as error:
    print(error)
"""


@pytest.mark.skipif(not sys.platform.startswith("linux"), reason="needs RLIMIT_NPROC of Linux")
@pytest.mark.parametrize("scheduler", ["fused", "thrust", "wavefront"])
@pytest.mark.parametrize(("scene", "most"), [("box", 1), ("box", 3), ("big(20_000)", 1)])
def test_threads_that_cannot_start(scheduler: str, scene: str, most: int) -> None:
    """No thread for a render or a tree: an OutOfMemoryError. Fewer than requested: the picture; a
    small one by `thrust` needs none."""
    values = {"scene": scene, "scheduler": scheduler, "most": most, "user": 60_123}
    done = python(BIG + NO_THREADS.format(**values))
    if "in spite of RLIMIT_NPROC" in done.stderr or "os.set" in done.stderr:
        pytest.skip(f"no limit on threads here: {done.stderr.splitlines()[-1]}")
    assert (done.returncode, done.stderr) == (0, "")
    enough = most > 1 or (scene, scheduler) == ("box", "thrust")
    assert re.search("no thread|too little memory" + "|fewer" * enough, done.stdout)
