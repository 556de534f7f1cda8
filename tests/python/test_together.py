"""Several devices at once: the bits and the statistics of one."""

from __future__ import annotations

import functools
import random
import threading
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest

import veriray as vr
from veriray import crew as crew_module
from veriray import rendering
from veriray.crew import Hand
from veriray.reports import in_order
from veriray.splitting import Split

SIZE: dict[str, Any] = {"width": 24, "height": 18}
#: Statistics that do not depend on who drew what.
SAME = ("ledger", "live_rays", "rays", "paths", "nonfinite_samples", "nonfinite", "spp",
        "scene_sha256", "mean_stderr", "features", "primitives")  # fmt: skip


def several(device: str) -> str:
    """The device, the other GPUs and the CPU; or the CPU three times."""
    if not device.startswith("cuda"):
        return f"{device},cpu,cpu"
    others = [d.name for d in vr.devices() if d.backend == "cuda" and d.name != device]
    return ",".join([device, *others, "cpu"])


def same(a: vr.Render, b: vr.Render) -> None:
    assert a.film_sha256 == b.film_sha256
    assert {k: a.stats[k] for k in SAME} == {k: b.stats[k] for k in SAME}


@pytest.fixture
def paces(monkeypatch: pytest.MonkeyPatch) -> dict[int, float]:
    """Seconds that hand k waits for each sample besides; filled by the test."""
    waits: dict[int, float] = {}
    numbers: dict[int, int] = {}
    draw = Hand.draw

    def slow(self: Hand, film: Any, begin: int, end: int, *rest: Any) -> Any:
        k = numbers.setdefault(id(self), len(numbers))
        time.sleep(waits.get(k, 0.0) * (end - begin))
        report = draw(self, film, begin, end, *rest)
        report["seconds"] += waits.get(k, 0.0) * (end - begin)
        return report

    monkeypatch.setattr(Hand, "draw", slow)
    return waits


@pytest.mark.parametrize("sampler", vr.SAMPLERS)
def test_the_bits_of_one(device: str, sampler: str) -> None:
    settings: dict[str, Any] = {**SIZE, "sampler": sampler, "seed": 3}
    one = vr.render(vr.cornell_box(), 64, device=device, **settings)
    all_ = vr.render(vr.cornell_box(), 64, device=several(device), **settings)
    same(all_, one)
    each = all_.stats["devices"]
    assert sum(e["paths"] for e in each) == all_.stats["paths"]
    assert all_.stats["device"] == ",".join(e["device"] for e in each)
    assert each[0]["device"] == one.stats["device"]
    assert all_.stats.keys() - one.stats.keys() == {"devices"}
    assert "devices" not in one.stats


def test_lists_and_threads() -> None:
    made = vr.render(vr.cornell_box(), 9, device=["cpu", "cpu"], threads=3, **SIZE)
    same(made, vr.render(vr.cornell_box(), 9, device="cpu", **SIZE))
    work = vr.Accumulation(vr.cornell_box(), device="cpu,cpu", threads=3, **SIZE)
    assert [hand.settings.threads for hand in work._crew.hands] == [2, 1]


@pytest.mark.parametrize("seed", range(3))
def test_paces(seed: int, paces: dict[int, float]) -> None:
    """Whoever is slow, and however much, each sample is drawn once."""
    rng = random.Random(seed)
    paces |= {k: 10 ** rng.uniform(-4, -2) for k in range(4)}
    made = vr.render(vr.cornell_box(), 200, device="cpu,cpu,cpu,cpu", seed=seed, **SIZE)
    same(made, vr.render(vr.cornell_box(), 200, device="cpu", seed=seed, **SIZE))


def test_the_fast_one_draws_more(paces: dict[int, float]) -> None:
    """Hand 1 is a twentieth as fast, so that it gets less than a fifth whatever this machine does
    meanwhile, and something: nobody knows at first."""
    scene = vr.cornell_box()
    paces |= {0: 0.002, 1: 0.04}
    made = vr.render(scene, 200, device="cpu,cpu", **SIZE)
    fast, slow = (e["paths"] for e in made.stats["devices"])
    assert 0 < slow < fast / 4


def test_batches_target_and_features(device: str) -> None:
    scene = vr.cornell_box()
    for settings in (
        {"spp": 12, "batches": 4},
        {"spp": 256, "target_error": 0.2, "width": 40, "height": 36},
        {"spp": 8, "features": "depth,direct"},
    ):
        given: dict[str, Any] = {**SIZE, **settings}
        one = vr.render(scene, device=device, **given)
        all_ = vr.render(scene, device=several(device), **given)
        same(all_, one)
        if one.batch_means is not None:
            assert all_.batch_means is not None
            assert all_.batch_means.tobytes() == one.batch_means.tobytes()
        for name, image in one.features.items():
            assert all_.features[name].tobytes() == image.tobytes()


def looked_at(work: vr.Accumulation, share: float) -> None:
    if work.spp:
        work.render()


def test_passes_checkpoints_and_every_state(device: str, tmp_path: Path) -> None:
    """Passes in which not all have something to do; pictures within; on and back to one device."""
    path, rng = tmp_path / "a.film", random.Random(1)
    whole = vr.render(vr.cornell_box(), 40, device=device, **SIZE)
    work = vr.Accumulation(vr.cornell_box(), device=several(device), spp=40, **SIZE)
    assert work.least == len(several(device).split(","))
    while work.left:
        work.add(rng.randint(1, min(7, work.left)), functools.partial(looked_at, work))
        if rng.random() < 0.5:
            state = vr.render(vr.cornell_box(), work.spp, device=device, **SIZE)
            assert work.render().film_sha256 == state.film_sha256
        if rng.random() < 0.4:
            work.checkpoint().save(path)
            where = rng.choice([device, several(device)])
            work = vr.Accumulation(vr.cornell_box(), device=where, spp=40, **SIZE)
            work.resume(vr.Checkpoint.load(path))
    same(work.render(), whole)


def test_cameras_share_trees() -> None:
    scene = vr.cornell_box()
    cameras = [scene.camera, scene.camera]
    one = vr.render(scene, 4, cameras=cameras, device="cpu", **SIZE)
    all_ = vr.render(scene, 4, cameras=cameras, device="cpu,cpu", **SIZE)
    for a, b in zip(all_, one, strict=True):
        same(a, b)


def test_time_and_interrupt(paces: dict[int, float], tmp_path: Path) -> None:
    paces |= {0: 0.01, 1: 0.02}
    scene = vr.cornell_box()
    short = vr.render(scene, 10**6, device="cpu,cpu", time=0.3, **SIZE)
    assert 2 <= short.spp < 10**4 and short.stats["stopped"] == "time"
    assert short.film_sha256 == vr.render(scene, short.spp, device="cpu", **SIZE).film_sha256

    work = vr.Accumulation(scene, device="cpu,cpu", spp=50, **SIZE)
    work.add(6)

    def stop(share: float) -> None:
        raise KeyboardInterrupt

    before = threading.active_count()
    with pytest.raises(KeyboardInterrupt):
        work.add(1000, stop)
    assert work.spp == 6 and threading.active_count() == before
    work.add(44)
    same(work.render(), vr.render(scene, 50, device="cpu", **SIZE))


def failing(monkeypatch: pytest.MonkeyPatch, fails: Callable[[Hand, int], None]) -> None:
    """`fails` is called with a hand and the number of its ranges so far, after it drew one."""
    draw, ranges = Hand.draw, dict[int, int]()

    def bad(self: Hand, *arguments: Any) -> Any:
        report = draw(self, *arguments)
        ranges[id(self)] = ranges.get(id(self), 0) + 1
        fails(self, ranges[id(self)])
        return report

    monkeypatch.setattr(Hand, "draw", bad)


@pytest.mark.parametrize("which", [0, 1])
def test_others_draw_for_one_without_memory(which: int, monkeypatch: pytest.MonkeyPatch) -> None:
    """What it drew in a pass is lost; what it had before is not."""
    scene = vr.cornell_box()

    def fails(hand: Hand, ranges: int) -> None:
        if work.spp and hand is work._crew.hands[which]:
            raise MemoryError("no room for this")
        time.sleep(0.02)  # so that this one gets a range

    failing(monkeypatch, fails)
    work = vr.Accumulation(scene, device="cpu,cpu,cpu", spp=600, **SIZE)
    work.add(96)
    with pytest.warns(vr.DeviceWarning, match="cpu:.* takes no part: no room for this"):
        while work.left > 48 and not work._crew.hands[which].out:
            for hand in work._crew.hands:
                hand.rate = 0.0  # so that all begin with a range
            work.add(48)
    work.add(work.left)
    same(work.render(), vr.render(scene, 600, device="cpu", **SIZE))

    work = vr.Accumulation(scene, device="cpu,cpu", spp=200, **SIZE)

    def all_fail(hand: Hand, ranges: int) -> None:
        raise MemoryError("no room at all")

    failing(monkeypatch, all_fail)
    with pytest.raises(vr.OutOfMemoryError, match="no room at all"):
        work.add(10)
    assert work.spp == 0


def test_errors_name_the_device(monkeypatch: pytest.MonkeyPatch) -> None:
    before = threading.active_count()  # other tests may have left some
    work = vr.Accumulation(vr.cornell_box(), device="cpu,cpu", spp=200, **SIZE)

    def fails(hand: Hand, ranges: int) -> None:
        if hand is work._crew.hands[1]:
            raise vr.DeviceError("it is broken")
        time.sleep(0.1)  # so that this one gets a range

    failing(monkeypatch, fails)
    with pytest.raises(vr.DeviceError, match=r"cpu:\w+: it is broken"):
        work.add(200)
    assert work.spp == 0 and threading.active_count() < before + 20


def test_a_scene_that_fits_on_some(monkeypatch: pytest.MonkeyPatch) -> None:
    count, native_scene = [0], crew_module.native_scene

    def one_fails(*arguments: Any) -> Any:
        count[0] += 1
        if count[0] == 1:
            raise MemoryError("too large")
        return native_scene(*arguments)

    monkeypatch.setattr(crew_module, "native_scene", one_fails)
    with pytest.warns(vr.DeviceWarning, match="takes no part: too large"):
        made = vr.render(vr.cornell_box(), 4, device="cpu,cpu", **SIZE)
    assert made.stats["device"].count("cpu") == 1


@pytest.mark.parametrize(
    ("device", "message"),
    [
        ("cpu,auto", "auto stands alone"),
        ("cpu,", "device = 'cpu,': a name is empty"),
        (["cpu", 3], "device"),
        ("cpu,tpu", "device = 'tpu' is unknown"),
    ],
)
def test_wrong_names(device: Any, message: str) -> None:
    with pytest.raises(ValueError, match=message):
        vr.render(vr.cornell_box(), 1, device=device, **SIZE)


@pytest.mark.gpu
def test_a_callback_that_uses_another_gpu() -> None:
    if sum(d.backend == "cuda" for d in vr.devices()) < 2:
        pytest.skip("needs two GPUs")
    scene = vr.cornell_box()
    wanted = vr.render(scene, 4096, device="cuda:0")
    other = vr.render(scene, 1, device="cuda:1")
    calls = []

    def use(share: float) -> None:
        calls.append(share)
        vr.render(scene, len(calls), device="cuda:1", width=16, height=16)
        assert other.image.shape == (512, 512, 3)

    found = vr.render(scene, 4096, device="cuda:0", progress=use)
    assert calls and found.film_sha256 == wanted.film_sha256


@pytest.mark.gpu
def test_a_gpu_twice() -> None:
    with pytest.raises(ValueError, match="names cuda:0 twice"):
        vr.render(vr.cornell_box(), 1, device="cuda:0,cuda", **SIZE)


def test_one_device_where_one_is_expected() -> None:
    with pytest.raises(ValueError, match="names several; one is expected here"):
        vr.device.select("cpu,cpu")


def test_refused_samples_in_order() -> None:
    """By sample and pixel, whoever said so first, and as many as one device lists."""
    rng = random.Random(0)
    listed = [(x, y, s, 1.0, 1.0, 1.0) for s in range(5) for y in range(5) for x in range(5)]
    mixed = rng.sample(listed, len(listed))
    assert in_order(mixed) == listed[:64]


def test_prepare_leaves_out_a_device_without_memory(monkeypatch: pytest.MonkeyPatch) -> None:
    scene = vr.cornell_box().with_(width=8, height=8, spp=2)
    real = rendering.native_scene
    short: list[Any] = []

    def native_scene(owner: Any, used: Any, device: Any, *more: Any) -> Any:
        if not short:
            short.append(device)
            raise MemoryError("no room")
        return real(owner, used, device, *more)

    monkeypatch.setattr(rendering, "native_scene", native_scene)
    assert rendering.prepare(scene, "cpu,cpu") == rendering.prepare(scene, "cpu")
    short.clear()
    with pytest.raises(MemoryError, match="no room"):
        rendering.prepare(scene, "cpu")


def test_a_batch_of_one_device_stays_its_own(monkeypatch: pytest.MonkeyPatch) -> None:
    scene = vr.cornell_box().with_(width=8, height=8)
    whole = vr.render(scene, spp=8, batches=8, device="cpu")
    first: list[Any] = []
    take = Split.take

    def second_alone(self: Split, worker: int) -> Any:
        first.append(worker)
        return take(self, worker) if worker == 1 else None

    monkeypatch.setattr(Split, "take", second_alone)
    a = vr.Accumulation(scene, spp=8, batches=8, device="cpu,cpu")
    while a.left:
        a.add(a.left)
        assert a._kept.films[0] is None and a._kept.films[1] is not None
    assert set(first) == {0, 1}
    assert a.render().film_sha256 == whole.film_sha256
