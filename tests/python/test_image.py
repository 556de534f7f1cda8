"""Files: a written picture reads back, a failed write harms nothing, a damaged file is an error."""

from __future__ import annotations

import dataclasses
import errno
import json
import os
import re
import resource
import signal
import subprocess
import sys
import time
from pathlib import Path

import numpy as np
import OpenEXR
import pytest

from veriray import image
from veriray.files import replacing
from veriray.image import ImageError
from veriray.rendering import LEDGER_COLUMNS, Render


def make_render(height: int = 5, width: int = 7, batches: int = 4, **stats: object) -> Render:
    rng = np.random.default_rng(7)
    picture = rng.random((height, width, 3)).astype(np.float32)
    return Render(
        image=picture,
        stderr=(picture * 0.01).astype(np.float32),
        batch_means=rng.random((batches, height, width, 3)) if batches else None,
        film_sha256="ab" * 32,
        stats={
            "scene_sha256": "cd" * 32,
            "device": "cpu (Prozessor, 2 Kerne; ä)",
            "scheduler": "fused",
            "features": ["quads", "area"],
            "version": "0.1.0",
            "seconds": 0.1234567890123,
            "max_depth": -1,
            "rr_depth": 5,
            "ledger": {c: [k + 2**40, 3, 0] for k, c in enumerate(LEDGER_COLUMNS)},
            "nonfinite": [[1, 2, 3, float("nan"), 0.0, 1.0]],
            "live_rays": [9, 3],
            "mean_stderr": 0.25,
            **stats,
        },
        width=width,
        height=height,
        spp=64,
        seed=2**64 - 1,
    )


def test_exr_round_trip(tmp_path: Path) -> None:
    render = make_render()
    path = tmp_path / "ö picture.exr"
    image.save(render, path)
    back = image.load(str(path))
    np.testing.assert_array_equal(back.image, render.image)
    np.testing.assert_array_equal(back.stderr, render.stderr)
    assert back.image.dtype == back.stderr.dtype == np.float32
    assert back.batch_means.dtype == np.float64
    np.testing.assert_array_equal(back.batch_means, render.batch_means.astype(np.float32))
    for name in ("film_sha256", "width", "height", "spp", "seed"):
        assert getattr(back, name) == getattr(render, name)
    for key, value in render.stats.items():
        if key != "nonfinite":
            assert back.stats[key] == value, key
    assert json.dumps(back.stats["nonfinite"]) == json.dumps(render.stats["nonfinite"])
    assert os.listdir(tmp_path) == [path.name]


def test_exr_layout_is_as_documented(tmp_path: Path) -> None:
    path = tmp_path / "x.exr"
    mask = np.arange(35, dtype=np.uint32).reshape(5, 7)
    image.save(make_render(), path, regions=mask, region_names=["floor", "lamp"])
    file = OpenEXR.File(str(path), separate_channels=True)
    names = {"R", "G", "B", "stderr.R", "batch.000.R", "batch.003.B", "region"}
    assert names <= set(file.channels())
    assert len(file.channels()) == 3 + 3 + 12 + 1
    header = file.header()
    expected = {"format": "1", "renderer": "veriray", "batches": "4", "spp": "64"}
    expected |= {"seed": str(2**64 - 1), "max_depth": "-1", "rr_depth": "5"}
    for key, value in expected.items():
        assert header[f"veriray.{key}"] == value
    assert json.loads(header["veriray.ledger"])["live"] == [2**40, 3, 0]
    assert json.loads(header["veriray.features"]) == ["quads", "area"]
    _, back, region_names = image.load_with_regions(path)
    np.testing.assert_array_equal(back, mask)
    assert region_names == ["floor", "lamp"]


def test_file_of_another_program_needs_only_rgb(tmp_path: Path) -> None:
    path = tmp_path / "x.exr"
    plane = np.full((3, 4), 0.5, np.float16)
    OpenEXR.File({}, {c: plane for c in "RGB"}).write(str(path))
    back = image.load(path)
    assert (back.image == 0.5).all() and back.image.dtype == np.float32
    assert np.isnan(back.stderr).all() and back.batch_means is None
    assert (back.spp, back.seed, back.film_sha256, back.stats["ledger"]) == (0, 0, "", {})


def test_nonfinite_pixels_are_kept_and_counted(tmp_path: Path) -> None:
    render = make_render(batches=0)
    render.image[1, 2, 0] = np.nan
    render.image[2, 2, 1] = np.inf
    image.save(render, tmp_path / "x.exr")
    back = image.load(tmp_path / "x.exr")
    np.testing.assert_array_equal(back.image, render.image)
    assert back.stats["nonfinite_pixels"] == 2


def test_png_is_srgb_and_not_an_input(tmp_path: Path) -> None:
    from PIL import Image

    render = make_render(batches=0)
    # 0.5 -> 188, 0.2140411 -> 127.5: IEC 61966-2-1
    render.image[0, :4, 0] = (0.0, 0.5, 1.0, 7.0)
    render.image[1, 0] = np.nan
    path = tmp_path / "x.PNG"
    image.save(render, path)
    pixels = np.asarray(Image.open(path))
    assert pixels.shape == (5, 7, 3) and pixels.dtype == np.uint8
    assert list(pixels[0, :4, 0]) == [0, 188, 255, 255]
    assert tuple(pixels[1, 0]) == (255, 0, 255)
    image.save_png(render.image, path, exposure=-1)
    assert np.asarray(Image.open(path))[0, 2, 0] == 188
    with pytest.raises(ImageError, match="display copy"):
        image.load(path)


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"image": np.zeros((4, 4), np.float32)}, r"image is \(4, 4\), expected an array"),
        ({"image": np.zeros((0, 4, 3), np.float32)}, "H, W >= 1"),
        ({"stderr": np.zeros((5, 8, 3), np.float32)}, "stderr"),
        ({"batch_means": np.zeros((2, 4, 7, 3))}, "batch_means"),
        ({"batch_means": np.zeros((1001, 5, 7, 3))}, "at most 1000"),
    ],
)
def test_bad_arrays(tmp_path: Path, change: dict[str, np.ndarray], message: str) -> None:
    with pytest.raises(ValueError, match=message):
        image.save(dataclasses.replace(make_render(), **change), tmp_path / "x.exr")
    assert not os.listdir(tmp_path)


def test_bad_suffix_exposure_and_regions(tmp_path: Path) -> None:
    with pytest.raises(ImageError, match=r"x\.jpg.*expected \.exr or \.png"):
        image.save(make_render(), tmp_path / "x.jpg")
    with pytest.raises(ImageError, match="exposure"):
        image.save(make_render(), tmp_path / "x.png", exposure=float("nan"))
    with pytest.raises(ImageError, match="regions"):
        image.save(make_render(), tmp_path / "x.exr", regions=np.zeros((2, 2), int))
    assert not os.listdir(tmp_path)


@pytest.mark.parametrize("suffix", ["exr", "png"])
def test_places_that_cannot_be_written(tmp_path: Path, suffix: str) -> None:
    render = make_render()
    folder = tmp_path / f"folder.{suffix}"
    folder.mkdir()
    cases = [(folder, errno.EISDIR), (tmp_path / "missing" / f"x.{suffix}", errno.ENOENT),
             (tmp_path / f"{'n' * 300}.{suffix}", errno.ENAMETOOLONG)]  # fmt: skip
    for path, number in cases:
        with pytest.raises(OSError) as caught:
            image.save(render, path)
        assert caught.value.errno == number
        assert str(path) in str(caught.value)
    device = tmp_path / f"full.{suffix}"
    device.symlink_to("/dev/full")
    with pytest.raises(OSError, match="not a regular file"):
        image.save(render, device)
    assert sorted(os.listdir(tmp_path)) == sorted([folder.name, device.name])


@pytest.mark.parametrize("suffix", ["exr", "png"])
def test_full_disk_leaves_the_earlier_file(tmp_path: Path, suffix: str) -> None:
    path = tmp_path / f"x.{suffix}"
    image.save(make_render(), path)
    before = path.read_bytes()
    old_limit = resource.getrlimit(resource.RLIMIT_FSIZE)
    old_handler = signal.signal(signal.SIGXFSZ, signal.SIG_IGN)
    try:
        resource.setrlimit(resource.RLIMIT_FSIZE, (5000, old_limit[1]))
        with pytest.raises(OSError, match="x") as caught:
            image.save(make_render(300, 300), path)
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, old_limit)
        signal.signal(signal.SIGXFSZ, old_handler)
    assert caught.value.errno == errno.EFBIG and str(path) in str(caught.value)
    assert path.read_bytes() == before
    assert os.listdir(tmp_path) == [path.name]


def test_interrupt_leaves_no_temporary_file(tmp_path: Path) -> None:
    def stop() -> None:
        with replacing(tmp_path / "x.exr") as file:
            file.write(b"half")
            raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        stop()
    assert not os.listdir(tmp_path)


def test_links_are_followed_and_modes_are_usual(tmp_path: Path) -> None:
    (tmp_path / "link.png").symlink_to("real.png")
    image.save(make_render(), tmp_path / "link.png")
    assert (tmp_path / "link.png").is_symlink()
    plain = tmp_path / "plain"
    plain.write_text("")
    assert (tmp_path / "real.png").stat().st_mode == plain.stat().st_mode


def header_with(tmp_path: Path, **attributes: str) -> Path:
    path = tmp_path / "bad.exr"
    plane = np.zeros((2, 2), np.float32)
    channels = {c: plane for c in "RGB"}
    OpenEXR.File({f"veriray.{k}": v for k, v in attributes.items()}, channels).write(str(path))
    return path


@pytest.mark.parametrize(
    ("key", "value"),
    [
        ("spp", "many"),
        ("spp", "-1"),
        ("seed", "9" * 5000),
        ("seconds", "soon"),
        ("seconds", "nan"),
        ("seconds", "-1"),
        ("ledger", "{"),
        ("ledger", "[]"),
        ("ledger", "[" * 100_000),
        ("ledger", '{"live": [1, 2], "escaped": [1]}'),
        ("ledger", '{"live": [1.5]}'),
        ("ledger", '{"live": [-1]}'),
        ("ledger", '{"live": "x"}'),
        ("features", "{}"),
        ("stats", "7"),
        ("regions", "null"),
        ("motion_to", "{}"),
        ("motion_to", "[[1, 2, 3, 4], [5]]"),
        ("motion_to", "[[1, 2, 3, 4]]"),
        ("motion_to", '[["1"]]'),
    ],
)
def test_bad_headers(tmp_path: Path, key: str, value: str) -> None:
    path = header_with(tmp_path, feature_spp="1", **{key: value})
    with pytest.raises(ImageError, match=rf"bad\.exr.*{key}"):
        image.load(path)


def test_minus_zero_seconds_are_zero(tmp_path: Path) -> None:
    seconds = image.load(header_with(tmp_path, seconds="-0")).stats["seconds"]
    assert str(seconds) == "0.0"


def test_bad_channels(tmp_path: Path) -> None:
    path = tmp_path / "x.exr"
    plane = np.zeros((2, 2), np.float32)
    for names, message in [
        (("R", "G"), "not all there"),
        (("Y",), "no channels R, G, B"),
        (("R", "G", "B", "stderr.R"), "stderr"),
        (("R", "G", "B", *(f"batch.001.{c}" for c in "RGB")), "numbered"),
        (("R", "G", "B", "batch.x"), "numbered"),
    ]:
        OpenEXR.File({}, {name: plane for name in names}).write(str(path))
        with pytest.raises(ImageError, match=message):
            image.load(path)
    batches = {f"batch.{k:03d}.{c}": plane for k in range(3) for c in "RGB"}
    OpenEXR.File({"veriray.spp": "8"}, {c: plane for c in "RGB"} | batches).write(str(path))
    with pytest.raises(ImageError, match="do not divide"):
        image.load(path)


@pytest.mark.parametrize("value", [np.nan, np.inf, 1e20, -1.0, 2.5])
@pytest.mark.parametrize("name", ["region", "samples", "object.I"])
def test_channels_of_integers_hold_integers(tmp_path: Path, name: str, value: float) -> None:
    path = tmp_path / "x.exr"
    for last in (3, value):
        plane = np.array([[0, last], [7, 1]], np.float32)
        OpenEXR.File({}, {c: plane for c in ("R", "G", "B", name)}).write(str(path))
        if last == 3:
            image.load(path)
    shown = re.escape(f"x.exr: channel '{name}' holds {np.float32(value)}; expected integers from")
    with pytest.raises(ImageError, match=shown):
        image.load(path)


def test_limits_come_before_pixels(tmp_path: Path) -> None:
    path = tmp_path / "x.exr"
    image.save(make_render(40, 40), path)
    with pytest.raises(ImageError, match="max_bytes"):
        image.load(path, max_bytes=1000)
    data = path.read_bytes()
    # both windows end at (39, 39); claim 65,536 columns and 60,000 rows
    old = np.array([0, 0, 39, 39], "<i4").tobytes()
    new = np.array([0, 0, 65535, 59999], "<i4").tobytes()
    path.write_bytes(data.replace(old, new))
    start = time.perf_counter()
    with pytest.raises(ImageError):
        image.load(path, max_bytes=1 << 50)
    assert time.perf_counter() - start < 2


def test_missing_file(tmp_path: Path) -> None:
    with pytest.raises(FileNotFoundError):
        image.load(tmp_path / "x.exr")


def test_a_damaged_file_prints_nothing(tmp_path: Path, capfd: pytest.CaptureFixture[str]) -> None:
    """The library's C code prints nothing either; stderr works as before, closed or open."""
    path = tmp_path / "x.exr"
    image.save(make_render(3, 4, batches=2), path)
    data = path.read_bytes()
    (tmp_path / "good.exr").write_bytes(data)
    for end in (len(data) - 1, len(data) - 200, len(data) // 2, 400, 40):
        path.write_bytes(data[:end])
        with pytest.raises(ImageError):
            image.load(path)
    assert capfd.readouterr() == ("", "")
    os.write(2, b"heard")
    assert capfd.readouterr() == ("", "heard")
    code = "from veriray import image\nimage.load('good.exr')\ntry: image.load('x.exr')\n"
    code += "except image.ImageError: print('damaged')"
    command = ["sh", "-c", 'exec "$@" 2>&-', "sh", sys.executable, "-c", code]
    done = subprocess.run(command, capture_output=True, check=True, cwd=tmp_path)
    assert done.stdout == b"damaged\n"


def test_truncated_and_mutated_files(tmp_path: Path) -> None:
    """Any damage gives ImageError or a render of sane arrays, never a crash."""
    path = tmp_path / "x.exr"
    image.save(make_render(3, 4, batches=2), path)
    data = path.read_bytes()
    rng = np.random.default_rng(1)
    damaged = [data[:n] for n in range(0, len(data), 7)]
    for _ in range(400):
        copy = bytearray(data)
        for _ in range(rng.integers(1, 4)):
            copy[rng.integers(len(copy))] = rng.integers(256)
        damaged.append(bytes(copy))
    for content in damaged:
        path.write_bytes(content)
        try:
            render = image.load(path)
        except (ImageError, OSError):
            continue
        assert render.image.ndim == 3 and render.image.dtype == np.float32
        assert render.image.shape == render.stderr.shape
