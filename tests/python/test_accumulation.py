"""Pictures that grow: any passes, interrupted or not, give the bits of one render."""

from __future__ import annotations

import copy
import pickle
import random
import signal
import time
from types import FrameType
from typing import Any

import numpy as np
import pytest

import veriray as vr
from veriray.accumulation import Accumulation
from veriray.rendering import METHODS
from veriray.sampling import PILOTS

SIZE: dict[str, Any] = {"width": 24, "height": 18}
#: Statistics that do not depend on passes and time.
SAME = ("ledger", "live_rays", "rays", "paths", "nonfinite_samples", "spp", "scene_sha256",
        "mean_stderr", "variant", "features")  # fmt: skip


def accumulated(parts: list[int], device: str = "cpu", **settings: Any) -> Accumulation:
    work = Accumulation(vr.cornell_box(), device=device, **{**SIZE, **settings})
    for n in parts:
        work.add(n)
    return work


def split(total: int, seed: int) -> list[int]:
    rng, parts = random.Random(seed), []
    while total:
        parts.append(rng.randint(1, total))
        total -= parts[-1]
    return parts


@pytest.mark.parametrize("sampler", vr.SAMPLERS)
@pytest.mark.parametrize("scheduler", METHODS)
@pytest.mark.parametrize("spp", [21, 90])
def test_any_passes_give_the_bits_of_one_render(
    device: str, sampler: str, scheduler: str, spp: int, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("VERIRAY_KERNELS", "off")  # or the variant changes when one is there
    ways: dict[str, Any] = {"sampler": sampler, "scheduler": scheduler, "seed": 7}
    whole = vr.render(vr.cornell_box(), spp, device=device, **SIZE, **ways)
    for seed in range(3):
        made = accumulated(split(spp, seed), device, **ways).render()
        assert made.film_sha256 == whole.film_sha256
        assert {k: made.stats[k] for k in SAME} == {k: whole.stats[k] for k in SAME}
    assert made.stats.keys() == whole.stats.keys()


def test_every_state_is_a_picture() -> None:
    work = accumulated([], spp=10)
    assert (work.spp, work.paths, work.left, work.paths_left) == (0, 0, 10, 10 * 24 * 18)
    with pytest.raises(ValueError, match="has no samples yet"):
        work.render()
    for n in (1, 4, 5, 3, 3, 10, 45, 9, 7):
        work.add(n)
        r = work.render()
        assert r.spp == r.stats["spp"] == work.spp
        assert work.paths == work.spp * 24 * 18 == r.stats["paths"]
        assert work.left == max(10 - work.spp, 0)
        once = vr.render(vr.cornell_box(), work.spp, device="cpu", **SIZE)
        assert r.film_sha256 == once.film_sha256


def test_short_texts_and_no_copies() -> None:
    work = accumulated([])
    device = work.settings.device
    assert repr(work) == f"<Accumulation 24 x 18, 0 of 64 spp, seed 0, on {device}>"
    work.add(3)
    assert repr(work) == f"<Accumulation 24 x 18, 3 of 64 spp, seed 0, on {device}>"
    kept = work.checkpoint()
    assert repr(kept) == "<Checkpoint 24 x 18, samples 0:3, seed 0>"
    for copied in (pickle.dumps, copy.deepcopy):
        with pytest.raises(TypeError, match="keep its checkpoint"):
            copied(work)
        copied(kept)


def test_pictures_stay_as_they_are() -> None:
    """A picture owns its numbers, though the film that it came from is used again."""
    work, early = accumulated([2]), []
    for _ in range(4):
        early.append((work.render(), work.render().image))
        work.add(3)
    for picture, image in early:
        assert picture.image.tobytes() == image.tobytes()


def test_what_is_written_to_a_picture_stays_there() -> None:
    work = Accumulation(vr.cornell_box(), batches=2, spp=8, device="cpu", **SIZE)
    for _ in range(2):
        work.add(4)
    before, spoiled = work.render(), work.render()
    assert spoiled.batch_means is not None
    spoiled.batch_means[...] = 0
    spoiled.stats["features"].clear()
    kept = work.checkpoint()
    kept.report["ledger"][...] = 0
    after = work.render()
    assert np.array_equal(after.batch_means, before.batch_means)
    for name in ("features", "live_rays"):
        assert after.stats[name] == before.stats[name] != []


def test_batches() -> None:
    whole = vr.render(vr.cornell_box(), 12, device="cpu", batches=4, **SIZE)
    work = accumulated([], spp=12, batches=4)
    assert work.left == 3
    with pytest.raises(ValueError, match="n = 2; with batches = 4 it is 3"):
        work.add(2)
    pictures = []
    while work.left:
        work.add(work.left)
        pictures.append(work.render())
    assert whole.batch_means is not None and whole.batch_means.shape == (4, 18, 24, 3)
    assert pictures[0].batch_means is None
    for k in (2, 3, 4):
        means = pictures[k - 1].batch_means
        assert means is not None and means.tobytes() == whole.batch_means[:k].tobytes()
    assert pictures[3].film_sha256 == whole.film_sha256
    with pytest.raises(ValueError, match=r"n = 3 is outside \[1, 0\]"):
        work.add(3)


def test_target_error_in_any_passes(device: str) -> None:
    settings: dict[str, Any] = {"spp": 512, "target_error": 0.05, "width": 40, "height": 36}
    whole = vr.render(vr.cornell_box(), device=device, **settings)
    rng = random.Random(3)
    work = accumulated([], device, **settings)
    assert work.left == PILOTS["sobol"]
    with pytest.raises(ValueError, match=r"n = 65 is outside \[1, 64\]"):
        work.add(65)
    states = 0
    while left := work.left:
        if work.paths < PILOTS["sobol"] * 40 * 36:
            assert work.spp == 0
            with pytest.raises(ValueError, match="has no samples yet"):
                work.render()
        ahead, n = work.paths_left, rng.randint(1, left)
        paths, told = work.paths, work.paths_of(n)
        work.add(n)
        assert work.paths - paths == told
        if work.spp:
            assert work.paths_left == ahead - told or work.spp == 0
            r = work.render()
            assert r.samples is not None and whole.samples is not None
            assert (r.samples == np.minimum(whole.samples, work.spp)).all()
            assert r.spp == (512 if not work.left else work.spp)
            states += 1
    assert states > 3
    made = work.render()
    assert made.film_sha256 == whole.film_sha256
    assert {k: made.stats[k] for k in SAME} == {k: whole.stats[k] for k in SAME}
    assert made.stats.keys() == whole.stats.keys()
    for key in ("tile_error", "tiles_at_limit", "mean_spp", "first_sample"):
        assert made.stats[key] == whole.stats[key]


def test_a_pass_that_fails_leaves_no_trace(device: str) -> None:
    def stop(_: float) -> None:
        raise TimeoutError("enough")

    wanted = vr.render(vr.cornell_box(), 9, device=device, **SIZE).film_sha256
    work = accumulated([], device)
    for n in (4, 3, 2):
        for _ in range(2):
            with pytest.raises(TimeoutError, match="enough"):
                work.add(10**6, stop)
        work.add(n)
    assert work.spp == 9 and work.render().film_sha256 == wanted


def test_progress_may_ask_for_the_picture(device: str) -> None:
    seen = []
    work = accumulated([2], device)
    longer = 1_000_000 if device.startswith("cuda") else 2000  # than the first call of progress
    work.add(longer, lambda share: seen.append((share, work.spp, work.render().film_sha256)))
    wanted = vr.render(vr.cornell_box(), 2, device=device, **SIZE).film_sha256
    assert {(spp, sha) for _, spp, sha in seen} == {(2, wanted)}
    assert all(0 <= share <= 1 for share, _, _ in seen)


def test_a_pass_within_a_pass_is_refused() -> None:
    work = accumulated([1])
    before = work.render().film_sha256
    inner: list[str] = []

    def again(_: float) -> None:
        if not inner:
            work.add(1)
            inner.append(work.render().film_sha256)

    with pytest.raises(RuntimeError, match="while another one ran"):
        work.add(5000, again)
    assert work.spp == 2 and work.render().film_sha256 == inner[0] != before


@pytest.mark.skipif(not hasattr(signal, "setitimer"), reason="needs POSIX signals")
def test_interrupts_at_any_moment_leave_a_whole_picture() -> None:
    def raise_it(number: int, frame: FrameType | None) -> None:
        raise KeyboardInterrupt

    scene, rng, counts = vr.cornell_box(), random.Random(11), [0, 0]
    right = {n: vr.render(scene, n, device="cpu", **SIZE) for n in range(1, 40)}
    before = signal.signal(signal.SIGALRM, raise_it)
    start, work = time.monotonic(), accumulated([])
    try:
        while (spent := time.monotonic() - start) < 2 or (min(counts) <= 50 and spent < 60):
            try:
                signal.setitimer(signal.ITIMER_REAL, rng.uniform(1e-5, 4e-3))
                while work.spp < 39:
                    work.add(1)
                    counts[1] += 1
                signal.setitimer(signal.ITIMER_REAL, 0)
            except KeyboardInterrupt:  # once: the timer does not repeat
                counts[0] += 1
            if work.spp:
                r = work.render()
                assert r.film_sha256 == right[work.spp].film_sha256
                assert r.stats["ledger"] == right[work.spp].stats["ledger"]
            if work.spp == 39:
                work = accumulated([])
    finally:
        signal.setitimer(signal.ITIMER_REAL, 0)
        signal.signal(signal.SIGALRM, before)
    assert min(counts) > 50


@pytest.mark.parametrize(
    "n, message",
    [
        (0, r"n = 0 is outside \[1, 1099511627776\]"),
        (2**40 + 1, r"n = 1099511627777 is outside"),
        (1.5, "n = 1.5 is not an integer"),
        (True, "n = True is not an integer"),
    ],
)
def test_what_is_not_allowed(n: Any, message: str) -> None:
    work = accumulated([])
    with pytest.raises(ValueError, match=message):
        work.add(n)
    with pytest.raises(ValueError, match="progress = 3 is not callable"):
        work.add(1, 3)  # type: ignore[arg-type]
    assert work.spp == 0
    with pytest.raises(TypeError, match="fur"):
        Accumulation(vr.cornell_box(), fur=1)
    with pytest.raises(TypeError, match="scene is int, expected a Scene"):
        Accumulation(3)  # type: ignore[arg-type]
