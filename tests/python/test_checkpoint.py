"""Checkpoints: what goes on from one, after any stop and on any device, has the bits of one render.

Files that are damaged, hostile or of another render are refused, and stay as they are.
"""

from __future__ import annotations

import contextlib
import dataclasses
import fcntl
import hashlib
import json
import os
import random
import resource
import signal
import struct
import subprocess
import sys
import termios
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import veriray as vr
from veriray import image
from veriray.cli import main
from veriray.rendering import METHODS
from veriray.sampling import PILOTS

SIZE: dict[str, Any] = {"width": 24, "height": 18}
SAME = ("ledger", "rays", "paths", "nonfinite_samples", "spp", "scene_sha256", "mean_stderr")
HEAD = len("veriray checkpoint 1\n")


def started(n: int = 5, **settings: Any) -> vr.Accumulation:
    work = vr.Accumulation(vr.cornell_box(), **{"device": "cpu", **SIZE, **settings})
    work.add(n)
    return work


def again(work: vr.Accumulation, path: Path, **settings: Any) -> vr.Accumulation:
    """Another accumulation with what a file of the first one's checkpoint holds."""
    work.checkpoint().save(path)
    other = vr.Accumulation(vr.cornell_box(), **{"device": "cpu", **SIZE, **settings})
    other.resume(vr.Checkpoint.load(path))
    return other


def test_goes_on_elsewhere(device: str, tmp_path: Path) -> None:
    """Each pass by another scheduler, to and fro between the device and the CPU."""
    for sampler in vr.SAMPLERS:
        ways: dict[str, Any] = {"sampler": sampler, "seed": 9, "spp": 20}
        work = started(5, **ways)
        for k, scheduler in enumerate(METHODS):
            where = device if k % 2 == 0 else "cpu"
            work = again(work, tmp_path / "a.film", device=where, scheduler=scheduler, **ways)
            assert work.spp == 5 + 5 * k
            work.add(5)
        one = vr.render(vr.cornell_box(), device="cpu", **SIZE, **ways)
        made = work.render()
        assert made.film_sha256 == one.film_sha256
        assert {k: made.stats[k] for k in SAME} == {k: one.stats[k] for k in SAME}
        assert made.stats.keys() == one.stats.keys()


def test_goes_on_with_batches_and_target(device: str, tmp_path: Path) -> None:
    """Stopped after every pass, of the pilot too."""
    cases: list[dict[str, Any]] = [
        {"spp": 12, "batches": 4}, {"spp": 256, "target_error": 0.2, "width": 40, "height": 36},
    ]  # fmt: skip
    for settings in cases:
        one = vr.render(vr.cornell_box(), device=device, **{**SIZE, **settings})
        work = started(3, device=device, **settings)
        while work.left:
            work = again(work, tmp_path / "a.film", device=device, **settings)
            work.add(work.left)
            if "batches" not in settings and work.paths <= PILOTS["sobol"] * 40 * 36:
                assert work.spp == 0
        made = again(work, tmp_path / "a.film", device=device, **settings).render()
        assert made.film_sha256 == one.film_sha256
        assert {k: made.stats[k] for k in SAME} == {k: one.stats[k] for k in SAME}
        if one.batch_means is not None:
            assert made.batch_means is not None
            assert made.batch_means.tobytes() == one.batch_means.tobytes()


@pytest.mark.parametrize(
    ("cuts", "sampler"),
    [
        ((0, 4, 7, 12, 13), "independent"), ((0, 16, 32, 48, 49), "sobol"),
        ((0, 16, 32, 48, 70), "sobol"), ((0, 64, 112, 192, 197), "sobol"),
    ],
)  # fmt: skip
def test_ranges_merge_to_the_bits_of_one_render(
    tmp_path: Path, cuts: tuple[int, ...], sampler: str
) -> None:
    parts = []
    for k in (2, 0, 3, 1):
        work = started(cuts[k + 1] - cuts[k], first=cuts[k], sampler=sampler)
        work.checkpoint().save(tmp_path / f"{k}.film")
        parts.append(vr.Checkpoint.load(tmp_path / f"{k}.film"))
    whole = vr.Checkpoint.merged(parts)
    made = whole.picture()
    one = vr.render(vr.cornell_box(), cuts[-1], device="cpu", sampler=sampler, **SIZE)
    assert made.film_sha256 == one.film_sha256 and made.spp == cuts[-1]
    work = vr.Accumulation(vr.cornell_box(), spp=250, device="cpu", sampler=sampler, **SIZE)
    work.resume(whole)
    work.add(250 - cuts[-1])
    more = vr.render(vr.cornell_box(), 250, device="cpu", sampler=sampler, **SIZE)
    assert work.render().film_sha256 == more.film_sha256
    assert {k: made.stats[k] for k in SAME} == {k: one.stats[k] for k in SAME}
    made.save(tmp_path / "a.exr")
    assert vr.Render.load(tmp_path / "a.exr").film_sha256 == one.film_sha256
    wrong: list[tuple[list[Any], str]] = [
        (parts[:3], f"samples {cuts[1]}:{cuts[2]} are missing"),
        ([*parts, parts[3]], f"samples {cuts[1]}:{cuts[2]} are there twice"),
        ([], "no checkpoints to merge"),
        ([*parts, started(2, first=208, seed=4, sampler=sampler).checkpoint()], "seed is 4, not 0"),
    ]
    for given, message in wrong:
        with pytest.raises(vr.CheckpointError, match=message):
            vr.Checkpoint.merged(given)
    with pytest.raises(vr.CheckpointError, match=f"samples 0:{cuts[1]} are missing"):
        parts[3].picture()


def test_groups_are_not_cut() -> None:
    with pytest.raises(ValueError, match="first = 8; with sampler sobol it is a multiple of 16"):
        started(4, first=8)
    parts = [started(5).checkpoint(), started(5, first=16).checkpoint()]
    parts[1] = dataclasses.replace(parts[1], first=5)
    with pytest.raises(vr.CheckpointError, match="parts end at multiples of 16"):
        vr.Checkpoint.merged(parts)


@pytest.mark.parametrize(
    ("other", "message"),
    [
        ({"seed": 1}, "seed is 0, not 1"),
        ({"sampler": "independent"}, "sampler is sobol, not independent"),
        ({"width": 25}, "width is 24, not 25"),
        ({"max_depth": 3}, "max_depth is .*, not 3"),
        ({"rr_depth": 9}, "rr_depth is .*, not 9"),
        ({"target_error": 0.1, "spp": 64}, "target_error is None, not 0.1"),
        ({"batches": 2, "spp": 10}, "batches is 0, not 2"),
        ({"spp": 3}, "it has 5 samples per pixel, more than spp = 3"),
        ({"first": 16}, "its first sample is 0, not 16"),
    ],
)  # fmt: skip
def test_of_another_render(other: dict[str, Any], message: str) -> None:
    given = started(spp=10).checkpoint()
    work = vr.Accumulation(vr.cornell_box(), device="cpu", **{**SIZE, **other})
    with pytest.raises(vr.CheckpointError, match=message):
        work.resume(given)
    assert work.paths == 0


def test_of_another_scene_and_twice() -> None:
    given = started().checkpoint()
    dim = vr.Accumulation(vr.cornell_box().with_emission_scaled(0.5), device="cpu", **SIZE)
    with pytest.raises(vr.CheckpointError, match=r"scene_sha256 is \w{16}\.\.\., not"):
        dim.resume(given)
    work = started()
    with pytest.raises(RuntimeError, match="samples already"):
        work.resume(given)
    with pytest.raises(ValueError, match="no samples to keep"):
        dim.checkpoint()


# ---- files that are damaged or hostile ----


def rewritten(content: bytes, change: Callable[[dict[str, Any]], object]) -> bytes:
    """A file whose header is changed, and whose SHA-256 is right."""
    (length,) = struct.unpack_from("<Q", content, HEAD)
    start = HEAD + 8
    header = json.loads(content[start : start + length])
    change(header)
    text = json.dumps(header).encode()
    new = content[:HEAD] + struct.pack("<Q", len(text)) + text + content[start + length : -32]
    return new + hashlib.sha256(new).digest()


def test_torn_and_changed_files(tmp_path: Path) -> None:
    path = tmp_path / "a.film"
    started().checkpoint().save(path)
    good = path.read_bytes()
    rng = random.Random(3)
    bad = [good[:n] for n in (0, 5, HEAD, HEAD + 4, HEAD + 8, 500, len(good) // 2, len(good) - 1)]
    bad += [good + b"x", b"veriray checkpoint 3\n" + good[HEAD:]]
    for _ in range(60):
        k = rng.randrange(len(good))
        bad.append(good[:k] + bytes([good[k] ^ 1 << rng.randrange(8)]) + good[k + 1 :])
    for content in bad:
        path.write_bytes(content)
        with pytest.raises(vr.CheckpointError, match=r"a\.film: "):
            vr.Checkpoint.load(path)
    path.write_bytes(good)
    with pytest.raises(vr.CheckpointError, match="the limit is 1000"):
        vr.Checkpoint.load(path, max_bytes=1000)
    vr.Checkpoint.load(path)


def test_hostile_headers(tmp_path: Path) -> None:
    """With a right SHA-256: nothing large is allocated, nothing but CheckpointError is raised."""
    path = tmp_path / "a.film"
    started().checkpoint().save(path)
    good = path.read_bytes()
    path.write_bytes(rewritten(good, lambda h: None))
    vr.Checkpoint.load(path)
    values: list[Any] = [None, -1, 2**63, 2**31 - 1, 1.5, "x", [], {}, True, 1e308, [[]], [1, 2, 3]]
    (length,) = struct.unpack_from("<Q", good, HEAD)
    header = json.loads(good[HEAD + 8 : HEAD + 8 + length])
    places: list[tuple[Any, ...]] = [(k,) for k in header]
    places += [("render", k) for k in header["render"]] + [("report", k) for k in header["report"]]
    places += [("planes", 0, k) for k in header["planes"][0]]
    places += [("arrays", 0, k) for k in range(3)] + [("arrays", 0, 2, k) for k in range(4)]
    refused = 0
    for place in places:
        for value in values:

            def change(h: Any, place: Any = place, value: Any = value) -> None:
                for key in place[:-1]:
                    h = h[key]
                h[place[-1]] = value

            path.write_bytes(rewritten(good, change))
            try:
                given = vr.Checkpoint.load(path)
                work = vr.Accumulation(vr.cornell_box(), device="cpu", spp=2**39, **SIZE)
                work.resume(given)
            except ValueError:  # CheckpointError, or of a film that no samples make
                refused += 1
    assert refused > 0.8 * len(places) * len(values)


@pytest.mark.parametrize("side", [2**12, 2**17, 2**31 - 1])
def test_sizes_that_the_file_has_not(side: int, tmp_path: Path) -> None:
    """All shapes agree with one another, and ask for up to 2^69 bytes."""

    def enlarge(h: dict[str, Any]) -> None:
        h["render"].update(width=side, height=side)
        (words,) = (entry for entry in h["arrays"] if entry[0] == "film radiance")
        words[2][:2] = side, side

    path = tmp_path / "a.film"
    started(sampler="independent").checkpoint().save(path)
    path.write_bytes(rewritten(path.read_bytes(), enlarge))
    need = side * side * 3 * 4 * 8
    with pytest.raises(vr.CheckpointError, match=r"bytes, where its header says (\d+)") as caught:
        vr.Checkpoint.load(path)
    said = int(str(caught.value).rsplit(" ", 1)[1])
    assert need < said < need + 10000


# ---- the command ----

COMMAND = [sys.executable, "-m", "veriray", "render", "cornell-box", "--device", "cpu"]
SMALL = ["--width", "32", "--height", "24", "--threads", "1"]


def run(*arguments: str, **more: Any) -> subprocess.CompletedProcess[str]:
    return subprocess.run(
        [*COMMAND, *SMALL, *arguments], capture_output=True, text=True, timeout=300, check=False,
        **more,
    )  # fmt: skip


def killed_again_and_again(folder: Path, times: int) -> tuple[int, int, int]:
    """A render without end that is killed at random moments, then one that ends soon: kills, of
    them with samples kept, and samples that were kept at the last."""
    rng, film, kills, kept = random.Random(5), folder / "a.film", 0, 0
    goal = ["-o", str(folder / "a.exr"), "--checkpoint", str(film)]
    last = 0
    while kills < times:
        process = subprocess.Popen(
            [*COMMAND, *SMALL, *goal, "--spp", "100000000", "--every", "0", "--quiet"],
            stderr=subprocess.PIPE,
        )
        try:
            process.wait(rng.uniform(0.0, 1.2))
        except subprocess.TimeoutExpired:
            process.kill()
            kills += 1
        _, err = process.communicate()
        assert not err, err.decode()
        if film.exists():
            now = vr.Checkpoint.load(film).spp
            assert now >= last
            kept += now > last
            last = now
    spp = last + 20
    done = run(*goal, "--spp", str(spp))
    assert done.returncode == 0, done.stderr
    one = vr.render(vr.cornell_box(), spp, device="cpu", width=32, height=24)
    assert vr.Render.load(folder / "a.exr").film_sha256 == one.film_sha256
    assert sorted(os.listdir(folder)) == ["a.exr", "a.film"]
    return kills, kept, last


@pytest.mark.parametrize("times", [5, pytest.param(200, marks=pytest.mark.slow)])
def test_kills_at_any_moment(times: int, tmp_path: Path) -> None:
    kills, kept, last = killed_again_and_again(tmp_path, times)
    print(
        f"{kills} kills, {kept} with more samples than before, {last} samples before the last run"
    )
    assert kills == times and kept >= times // 10


def test_resumed_command(tmp_path: Path) -> None:
    film = tmp_path / "a.film"
    goal = ["-o", str(tmp_path / "a.exr"), "--checkpoint", str(film)]
    assert run("--spp", "6", *goal).returncode == 0
    good = film.read_bytes()
    done = run("--spp", "6", "--seed", "3", *goal)
    assert done.returncode == 2 and "of another render: seed is 0, not 3" in done.stderr
    film.write_bytes(good[:-5])
    done = run("--spp", "6", *goal)
    assert done.returncode == 2 and "a.film: damaged: " in done.stderr
    assert film.read_bytes() == good[:-5]
    done = run("--every", "3", "--spp", "2", "-o", str(tmp_path / "a.exr"))
    assert done.returncode == 2 and "--every goes with --checkpoint" in done.stderr


def test_ranges_by_commands(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.chdir(tmp_path)
    render = [*COMMAND[3:], *SMALL]
    for samples, name in (("0:16", "a.film"), ("48:70", "c.film"), ("16:48", "b.film")):
        assert main([*render, "--samples", samples, "--checkpoint", name]) == 0
        assert f"{samples} of {samples} in {name}" in capsys.readouterr().out
    one = vr.render(vr.cornell_box(), 70, device="cpu", width=32, height=24)
    assert main(["merge", "c.film", "a.film", "b.film", "-o", "a.exr", "-o", "d.film"]) == 0
    assert f"SHA-256    {one.film_sha256}" in capsys.readouterr().out
    assert vr.Render.load("a.exr").film_sha256 == one.film_sha256
    assert main([*render, "--spp", "70", "--checkpoint", "d.film", "-o", "b.png"]) == 0
    assert one.film_sha256 in capsys.readouterr().out
    out, film = ["-o", "x.exr"], ["--checkpoint", "x.film"]
    wrong = [
        (["merge", "a.film", "c.film", *out], "(0:16) and c.film (48:70): samples 16:48 are m"),
        (["merge", "d.film", "b.film", *out], "samples 16:48 are there twice"),
        (["merge", "b.film", *out], "b.film (16:48): samples 0:16 are missing"),
        (["merge", "a.film"], "no output"),
        (["merge", "a.film", "-o", "./a.film"], "./a.film is an input too; write to another file"),
        (["merge", "a.film", "a.film", *out], "samples 0:16 are there twice"),
        ([*render, "--samples", "3:3", *film], "expected A:B with"),
        ([*render, "--samples", "3", *film], "expected A:B with"),
        ([*render, "--samples", "0:3"], "into --checkpoint FILE alone"),
        ([*render, "--samples", "0:3", *film, "--spp", "3"], "not together with --spp"),
        ([*render, "--samples", "0:4", "--checkpoint", "b.film"], "first sample is 16, not 0"),
        ([*render, "--samples", "3:7", *film], "with sampler sobol it is a multiple of 16"),
    ]  # fmt: skip
    for arguments, message in wrong:
        assert main(arguments) == 2
        assert message in capsys.readouterr().err
    assert not {"x.exr", "x.film"} & {*os.listdir()}


def test_full_disk(tmp_path: Path) -> None:
    """The limit of a file's size stands for the disk: pictures fit, the checkpoint does not."""
    film = tmp_path / "a.film"
    goal = ["-o", str(tmp_path / "a.png"), "--checkpoint", str(film), "--every", "0"]
    assert run("--spp", "2", *goal).returncode == 0
    good = film.read_bytes()

    def limit() -> None:
        signal.signal(signal.SIGXFSZ, signal.SIG_IGN)
        resource.setrlimit(resource.RLIMIT_FSIZE, (len(good) // 2, len(good) // 2))

    os.remove(tmp_path / "a.png")
    done = run("--spp", "4", *goal, preexec_fn=limit)
    assert done.returncode == 2
    assert "the checkpoint was not written, and the last one stays" in done.stderr
    assert done.stderr.splitlines()[-1].endswith("a.film: File too large")
    assert film.read_bytes() == good
    assert sorted(os.listdir(tmp_path)) == ["a.film", "a.png"]


def sampling(*words: str) -> subprocess.Popen[str]:
    """A `veriray render` that has drawn samples for some seconds, and hears Ctrl-C."""
    process = subprocess.Popen(
        [*COMMAND, *SMALL, *words], text=True, stdout=subprocess.PIPE, stderr=subprocess.PIPE,
        preexec_fn=lambda: signal.signal(signal.SIGINT, signal.default_int_handler),
    )  # fmt: skip
    assert process.stdout is not None and process.stdout.readline().startswith("device")
    time.sleep(3)
    return process


@pytest.mark.parametrize(
    ("more", "number"),
    [([], signal.SIGINT), (["--checkpoint", "a.film"], signal.SIGINT), ([], signal.SIGTERM)],
)
def test_interrupt_keeps_the_picture(
    more: list[str], number: signal.Signals, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    process = sampling("--spp", "1000000000", "-o", "a.exr", *more)
    try:
        process.send_signal(number)
        _, err = process.communicate(timeout=60)
    finally:
        process.kill()
    assert process.returncode == 128 + number, err
    made = vr.Render.load("a.exr")
    assert f"interrupted: the picture has {made.spp} of 1000000000 samples per pixel" in err
    assert made.stats["stopped"] == "interrupted" and made.stats["spp_asked"] == 1000000000
    one = vr.render(vr.cornell_box(), made.spp, device="cpu", width=32, height=24)
    assert made.film_sha256 == one.film_sha256
    if more:
        assert vr.Checkpoint.load("a.film").spp == made.spp


def test_a_terminal_that_closes_costs_no_picture(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """It sends SIGHUP, its shell once more, and what is said then is lost."""
    monkeypatch.chdir(tmp_path)
    terminal, end = os.openpty()

    def begin() -> None:
        signal.signal(signal.SIGHUP, signal.SIG_DFL)  # under nohup it is ignored
        fcntl.ioctl(0, termios.TIOCSCTTY, 0)

    process = subprocess.Popen(
        [*COMMAND, *SMALL, "--spp", "1000000000", "-o", "a.exr"], stdin=end, stdout=end,
        stderr=end, start_new_session=True,
        preexec_fn=begin,
    )  # fmt: skip
    os.close(end)
    try:
        assert os.read(terminal, 6) == b"device"
        time.sleep(3)
        os.close(terminal)
        time.sleep(0.02)
        with contextlib.suppress(ProcessLookupError):
            process.send_signal(signal.SIGHUP)
        assert process.wait(60) == 128 + signal.SIGHUP
    finally:
        process.kill()
    made = vr.Render.load("a.exr")
    one = vr.render(vr.cornell_box(), made.spp, device="cpu", width=32, height=24)
    assert made.film_sha256 == one.film_sha256


@pytest.mark.parametrize(("spp", "times"), [("1000000000", 2), ("1", 1)])
def test_interrupt_leaves_feature_images_out(
    spp: str, times: int, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Of a picture that Ctrl-C stopped, they are drawn once that is written."""
    monkeypatch.chdir(tmp_path)
    more = ["--features", "normal", "--feature-spp", "1000000000", "-o", "a.exr"]
    process = sampling("--spp", spp, *more)
    try:
        process.send_signal(signal.SIGINT)
        end = time.monotonic() + 30
        while times == 2 and not os.path.exists("a.exr") and time.monotonic() < end:
            time.sleep(0.05)
        if times == 2:
            assert vr.Render.load("a.exr").stats["stopped"] == "interrupted"
            process.send_signal(signal.SIGINT)
        err = process.communicate(timeout=30)[1]
    finally:
        process.kill()
    assert process.returncode == 130, err
    made = vr.Render.load("a.exr")
    assert f"has {made.spp} of {spp} samples per pixel, and no feature images" in err
    assert made.stats["stopped"] == "interrupted" and not made.features


def test_every_is_checked_without_a_checkpoint() -> None:
    for every in (-1, float("nan"), "x"):
        with pytest.raises(ValueError, match="every = "):
            vr.render(vr.cornell_box(), 1, every=every, width=8, height=6, device="cpu")  # type: ignore[arg-type]


def test_previews(tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: Any) -> None:
    """Outputs appear while the render goes on; one that cannot be written costs nothing else."""
    monkeypatch.chdir(tmp_path)
    saved: list[int] = []
    save = image.save

    def noted(picture: vr.Render, path: str, **more: Any) -> None:
        saved.append(picture.spp)
        if len(saved) == 1:
            raise OSError("no room")
        save(picture, path, **more)

    monkeypatch.setattr(image, "save", noted)
    words = ["render", "cornell-box", "--device", "cpu", "--width", "8", "--height", "8"]
    assert main([*words, "--spp", "512", "-o", "a.exr", "--preview", "1e-9", "--quiet"]) == 0
    assert len(saved) > 2 and saved == sorted(saved) and saved[-1] == 512 > saved[0]
    assert capsys.readouterr().err == "veriray: no preview: no room\n"
    one = vr.render(vr.cornell_box(), 512, device="cpu", width=8, height=8)
    assert vr.Render.load("a.exr").film_sha256 == one.film_sha256
    assert main([*words, "-o", "a.exr", "--preview", "0"]) == 2
    assert "--preview 0: expected seconds above 0" in capsys.readouterr().err


# ---- from Python ----


def test_time_and_passes(tmp_path: Path) -> None:
    seen: list[int] = []
    made = vr.render(vr.cornell_box(), 10**9, device="cpu", time=0.5, **SIZE,
                     on_pass=lambda r: seen.append(r.spp))  # fmt: skip
    assert seen == sorted(seen) and seen[-1] == made.spp > 1
    assert (made.stats["stopped"], made.stats["spp_asked"]) == ("time", 10**9)
    assert made.stats["seconds"] < 5
    one = vr.render(vr.cornell_box(), made.spp, device="cpu", **SIZE)
    assert made.film_sha256 == one.film_sha256
    path = tmp_path / "a.film"
    parts = [vr.render(vr.cornell_box(), n, device="cpu", checkpoint=path, every=0, **SIZE)
             for n in (3, 3, 8)]  # fmt: skip
    one = vr.render(vr.cornell_box(), 8, device="cpu", **SIZE)
    assert parts[2].film_sha256 == one.film_sha256 and "stopped" not in parts[2].stats

    def stop(_: vr.Render) -> None:
        raise TimeoutError("enough")

    with pytest.raises(TimeoutError):
        vr.render(vr.cornell_box(), 90, device="cpu", checkpoint=path, on_pass=stop, **SIZE)
    assert vr.Checkpoint.load(path).spp == 9


@pytest.mark.parametrize(
    ("given", "message"),
    [
        ({"time": -1}, r"time = -1 is outside"),
        ({"time": np.nan}, "time = nan is outside"),
        ({"checkpoint": "a\0"}, "null character"),
        ({"checkpoint": "a\ud800"}, "checkpoint: cannot read .* lone surrogate"),
        ({"on_pass": 3}, "on_pass = 3 is not callable"),
        ({"time": 1, "every": "x"}, "every = 'x' is not a number"),
        ({"time": 1, "cameras": []}, "cameras: not together with"),
    ],
)
def test_wrong_arguments(given: dict[str, Any], message: str) -> None:
    with pytest.raises(ValueError, match=message):
        vr.render(vr.cornell_box(), 1, device="cpu", **SIZE, **given)
