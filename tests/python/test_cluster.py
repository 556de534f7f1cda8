"""Renders on several nodes of Ray, on this machine; their workers are killed."""

from __future__ import annotations

import os
import random
import signal
import threading
import time
import warnings
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest

import veriray as vr
from veriray import cluster_worker
from veriray.cli import main
from veriray.cluster_worker import differences, digests

# Ray reads it when it is imported; from 2.61 on it asks for a token anyway.
os.environ |= {"RAY_AUTH_MODE": "token", "RAY_AUTH_TOKEN": "0123456789abcdef" * 4}
ray = pytest.importorskip("ray", reason="Ray is not installed: pip install veriray[cluster]")

SIZE: dict[str, Any] = {"width": 48, "height": 32}
SAME = ("ledger", "live_rays", "rays", "paths", "nonfinite_samples", "spp", "scene_sha256",
        "mean_stderr", "features", "primitives")  # fmt: skip
STORE = 80 << 20
#: How soon Ray notices that a node is gone: after so many calls that fail, not after 15 s.
HEALTH = {"health_check_initial_delay_ms": 1000, "health_check_period_ms": 500}


@pytest.fixture(scope="module")
def nodes() -> Iterator[Any]:
    """Two nodes of one processor, and a head that has none."""
    from ray.cluster_utils import Cluster

    quiet = {"num_cpus": 0, "object_store_memory": STORE, "include_dashboard": False,
             "_system_config": HEALTH}  # fmt: skip
    cluster = Cluster(initialize_head=True, head_node_args=quiet)
    try:
        for _ in range(2):
            cluster.add_node(num_cpus=1, object_store_memory=STORE)
        yield cluster
    finally:
        ray.shutdown()
        cluster.shutdown()


def workers() -> list[int]:
    """Processes of workers that raylets of this process started."""
    parents, names = {}, {}
    for entry in Path("/proc").iterdir():
        if entry.name.isdecimal():
            try:
                parents[int(entry.name)] = int(entry.joinpath("stat").read_text().split()[-49])
                names[int(entry.name)] = entry.joinpath("cmdline").read_text()
            except OSError:
                continue
    return [
        pid for pid, name in names.items()
        if name.startswith("ray::Worker") and parents.get(parents.get(pid, 0)) == os.getpid()
    ]  # fmt: skip


def same(a: vr.Render, b: vr.Render) -> None:
    assert a.film_sha256 == b.film_sha256
    assert {k: a.stats[k] for k in SAME} == {k: b.stats[k] for k in SAME}


def test_the_bits_of_one(nodes: Any) -> None:
    scene = vr.cornell_box()
    for settings in ({"spp": 300}, {"spp": 40, "batches": 4}, {"spp": 128, "target_error": 0.2}):
        given: dict[str, Any] = {**SIZE, **settings, "device": "cpu", "seed": 5}
        one = vr.render(scene, **given)
        made = vr.render(scene, cluster=nodes.address, **given)
        same(made, one)
        if one.batch_means is not None:
            assert made.batch_means is not None
            assert made.batch_means.tobytes() == one.batch_means.tobytes()
        each = made.stats["devices"]
        assert sum(e["paths"] for e in each) == made.stats["paths"]
        assert 1 <= len(each) <= 2 and all(e["node"] for e in each)
    last = time.monotonic() + 30
    while workers() and time.monotonic() < last:
        time.sleep(0.1)
    assert not workers(), "workers outlive the render"


def test_command(nodes: Any, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    out, film = tmp_path / "a.exr", tmp_path / "a.film"
    where = ["--width", "48", "--height", "32", "--device", "cpu", "--cluster", nodes.address]
    first = ["render", "cornell-box", "--samples", "0:30", "--checkpoint", str(film)]
    assert main([*first, *where]) == 0
    again = ["render", "cornell-box", "--spp", "90", "--checkpoint", str(film), "-o", str(out)]
    assert main([*again, *where]) == 0
    shown = capsys.readouterr().out
    assert f"cluster    {nodes.address}" in shown and "of these" in shown
    right = vr.render(vr.cornell_box(), 90, device="cpu", **SIZE).film_sha256
    assert vr.Render.load(out).film_sha256 == right


class Killer:
    """Kills workers at random moments, up to `times`."""

    def __init__(self, times: int, seed: int, pause: float) -> None:
        self.killed, self.left, self.pause = 0, times, pause
        self.rng, self.over = random.Random(seed), threading.Event()
        self.thread = threading.Thread(target=self.work, daemon=True)

    def work(self) -> None:
        while self.left and not self.over.wait(self.rng.uniform(0, self.pause)):
            if there := workers():
                os.kill(self.rng.choice(there), signal.SIGKILL)
                self.killed, self.left = self.killed + 1, self.left - 1

    def __enter__(self) -> Killer:
        self.thread.start()
        return self

    def __exit__(self, *_: object) -> None:
        self.over.set()
        self.thread.join()


@pytest.mark.parametrize("times", [4, pytest.param(100, marks=pytest.mark.slow)])
def test_workers_are_killed(nodes: Any, times: int, monkeypatch: pytest.MonkeyPatch) -> None:
    """The render goes on until as many were killed, and then ends; no sample is lost or twice."""
    monkeypatch.setattr("veriray.cluster.Cluster.seconds", 0.5)
    monkeypatch.setattr("veriray.cluster.DEATHS", 50)
    scene = vr.cornell_box()
    with Killer(times, times, 4.0) as killer:
        work = vr.Accumulation(scene, cluster=nodes.address, device="cpu", spp=10**8, **SIZE)
        n = 8
        while killer.left or not work.spp:
            start = time.monotonic()
            work.add(n)
            n = max(8, int(n * min(2.0, 0.5 / (time.monotonic() - start))))
        work.add(10)
        made = work.render()
        work.close()
    assert killer.killed == times
    assert sum(e["paths"] for e in made.stats["devices"]) == made.stats["paths"]
    print(f"{killer.killed} killed, {made.spp} samples per pixel")
    same(made, vr.render(scene, made.spp, device="cpu", **SIZE))


def test_a_node_goes_and_another_comes(nodes: Any) -> None:
    scene = vr.cornell_box()
    going = nodes.add_node(num_cpus=1, object_store_memory=STORE)
    nodes.wait_for_nodes()
    work = vr.Accumulation(scene, cluster=nodes.address, device="cpu", **SIZE)
    while work.least < 3:
        work.add(10)
    timer = threading.Timer(1.0, nodes.remove_node, (going,), {"allow_graceful": False})
    timer.start()
    last = time.monotonic() + 200  # Ray notices it after a while
    with warnings.catch_warnings(record=True) as said:
        warnings.simplefilter("always", vr.DeviceWarning)
        while not said and time.monotonic() < last:
            work.add(1000)
    assert [str(w.message).partition(": ")[2] for w in said] == ["the node is gone"]
    timer.join()
    made = work.render()
    work.close()
    same(made, vr.render(scene, made.spp, device="cpu", **SIZE))


@pytest.fixture
def interruptible() -> Iterator[None]:
    """Ctrl-C raises KeyboardInterrupt, though a process started in the background ignores it."""
    before = signal.signal(signal.SIGINT, signal.default_int_handler)
    yield
    signal.signal(signal.SIGINT, before)


@pytest.mark.usefixtures("interruptible")
def test_interrupt_keeps_what_was_given_out(nodes: Any, tmp_path: Path) -> None:
    """Ctrl-C ends the pass; what is there is a picture, and a checkpoint to go on from."""
    scene, film = vr.cornell_box(), tmp_path / "a.film"
    work = vr.Accumulation(scene, cluster=nodes.address, device="cpu", spp=10**6, **SIZE)
    try:
        timer = threading.Timer(2.0, signal.raise_signal, (signal.SIGINT,))
        timer.start()
        start = time.monotonic()
        with pytest.raises(KeyboardInterrupt):
            work.add(10**6)
        assert 0 < work.spp < 10**6 and time.monotonic() - start < 60
        assert signal.getsignal(signal.SIGINT) is signal.default_int_handler
        work.checkpoint().save(film)
        made = work.render()
    finally:
        work.close()  # or the workers keep the processors that other tests wait for
    assert made.film_sha256 == vr.render(scene, made.spp, device="cpu", **SIZE).film_sha256
    more = made.spp + 5
    on = vr.render(scene, more, device="cpu", checkpoint=film, **SIZE)
    assert on.film_sha256 == vr.render(scene, more, device="cpu", **SIZE).film_sha256


def test_errors_name_the_node(nodes: Any, monkeypatch: pytest.MonkeyPatch) -> None:
    scene, name = vr.cornell_box(), os.uname().nodename
    with (
        warnings.catch_warnings(),
        pytest.raises(vr.DeviceError, match=f"node {name}: DeviceError: "),
    ):
        warnings.simplefilter("ignore")
        vr.render(scene, 4, cluster=nodes.address, device="cuda:77", **SIZE)
    other = {**digests(), "version": "0.0.1"}
    monkeypatch.setattr("veriray.cluster.digests", lambda: other)
    text = rf"node {name} takes no part: veriray {vr.__version__}, not 0.0.1: refused"
    with pytest.warns(vr.DeviceWarning, match=text), pytest.raises(vr.DeviceError, match="no node"):
        vr.render(scene, 4, cluster=nodes.address, device="cpu", **SIZE)
    with pytest.raises(ValueError, match="cluster = 3"):
        vr.render(scene, 4, cluster=3, **SIZE)  # type: ignore[arg-type]


def test_builds() -> None:
    own = digests()
    assert own["version"] == vr.__version__ and not differences(own, own)
    assert not differences(own, {**own, "_other": "0"}), "a module that only one of them has"
    assert differences(own, {**own, "code": "0"}) == "another build of veriray: code differ"
    assert Path(cluster_worker.__file__).is_file()
