"""Kernels that are made at run time: found or not, compiled, kept, and equal to the bit."""

from __future__ import annotations

import ctypes
import os
import subprocess
import sys
import threading
from collections.abc import Iterator
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import pytest

import veriray as vr
from veriray import crew, kernel_compiler, kernels
from veriray.device import select
from veriray.errors import DeviceError
from veriray_validate.scenes import check_scene

#: Quads, area lights, diffuse: the features of Mitsuba's Cornell box.
BOX = 0x80400001
SCENES = sorted(Path(vr.__file__).parent.glob("scenes/checks/*.xml"))
needs_nvrtc = pytest.mark.skipif(
    kernels.compiler() is None, reason="libnvrtc is not installed: nothing compiles at run time"
)


class Native:
    """Stands for the module of a GPU."""

    def __init__(self) -> None:
        self.added: list[tuple[int, int, bytes]] = []

    def add_kernels(self, device: int, features: int, code: bytes) -> None:
        self.added.append((device, features, code))


@pytest.fixture
def fresh(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[SimpleNamespace]:
    """Nothing known of any kernel, an empty folder, and a device that takes what it is given."""
    monkeypatch.setenv("VERIRAY_CACHE", str(tmp_path))
    monkeypatch.setenv("VERIRAY_KERNELS", "wait")
    for name in ("_settled", "_paths", "_children"):
        getattr(kernels, name).clear()
    native = Native()
    yield SimpleNamespace(
        index=0, details={"compute_capability": "9.0"}, native=native, folder=tmp_path / "kernels"
    )
    for name in ("_settled", "_paths", "_children"):
        getattr(kernels, name).clear()


def offer(device: Any, features: int = BOX, method: str = "fused", paths: int = 1) -> None:
    kernels.offer(device, SimpleNamespace(feature_mask=features), method, paths)  # type: ignore[arg-type]


@needs_nvrtc
@pytest.mark.parametrize("method", kernels.METHODS)
def test_a_kernel_is_compiled_once_and_kept(fresh: Any, method: str) -> None:
    offer(fresh, method=method)
    [(device, features, code)] = fresh.native.added
    assert (device, features) == (0, BOX) and code[:4] == b"\x7fELF"
    offer(fresh, method=method)
    assert len(fresh.native.added) == 1  # this process knows it
    [file] = fresh.folder.iterdir()
    assert file.read_bytes() == code
    written = file.stat().st_mtime_ns
    kernels._settled.clear()
    offer(fresh, method=method)
    assert fresh.native.added[1][2] == code and file.stat().st_mtime_ns == written


@needs_nvrtc
def test_few_paths_do_not_pay(fresh: Any, monkeypatch: pytest.MonkeyPatch) -> None:
    started: list[Any] = []
    monkeypatch.setenv("VERIRAY_KERNELS", "auto")
    monkeypatch.setattr(kernels, "_start", lambda *a: started.append(a) or _ended(0))
    offer(fresh, paths=kernels.PATHS_THAT_PAY - 1)
    assert not started
    offer(fresh, paths=1)
    assert len(started) == 1
    assert not fresh.native.added  # the child has not written it


def test_few_compilations_at_a_time(fresh: Any, monkeypatch: pytest.MonkeyPatch) -> None:
    children: list[subprocess.Popen[bytes]] = []

    def start(*_: object) -> subprocess.Popen[bytes]:
        children.append(subprocess.Popen([sys.executable, "-c", "input()"], stdin=subprocess.PIPE))
        return children[-1]

    monkeypatch.setenv("VERIRAY_KERNELS", "auto")
    monkeypatch.setattr(kernels, "available", lambda: "")
    monkeypatch.setattr(kernels, "_origin", lambda: "0")
    monkeypatch.setattr(kernels, "_start", start)
    try:
        for features in range(1, kernels.MOST_CHILDREN + 5):
            offer(fresh, features, paths=kernels.PATHS_THAT_PAY)
        assert len(children) == kernels.MOST_CHILDREN
    finally:
        for child in children:
            child.communicate(b"\n")
    offer(fresh, 99, paths=kernels.PATHS_THAT_PAY)  # the others have ended
    assert len(children) == kernels.MOST_CHILDREN + 1
    children[-1].communicate(b"\n")


def _ended(status: int) -> subprocess.Popen[bytes]:
    child = subprocess.Popen(
        [sys.executable, "-c", f"import sys; sys.stderr.write('no'); sys.exit({status})"],
        stderr=subprocess.PIPE,
    )
    child.wait()
    return child


def test_a_failure_is_kept_and_harms_nothing(fresh: Any, monkeypatch: pytest.MonkeyPatch) -> None:
    started: list[Any] = []
    monkeypatch.setattr(kernels, "available", lambda: "")
    monkeypatch.setattr(kernels, "_origin", lambda: "0")
    monkeypatch.setattr(kernels, "_start", lambda *a: started.append(a) or _ended(1))
    offer(fresh)
    offer(fresh)
    assert len(started) == 1 and not fresh.native.added


def test_a_folder_that_cannot_be_written(fresh: Any, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(kernels, "available", lambda: "")
    monkeypatch.setattr(kernels, "_origin", lambda: "0")
    fresh.folder.parent.mkdir(exist_ok=True)
    fresh.folder.write_text("a file, not a folder")
    offer(fresh)
    assert not fresh.native.added and (0, BOX, "fused") in kernels._settled


@pytest.mark.parametrize("error", [RuntimeError, MemoryError])
def test_code_that_does_not_load(
    fresh: Any, monkeypatch: pytest.MonkeyPatch, error: type[Exception]
) -> None:
    monkeypatch.setattr(kernels, "available", lambda: "")
    monkeypatch.setattr(kernels, "_origin", lambda: "0")
    fresh.folder.mkdir()
    (fresh.folder / f"fused-sm_90-{BOX:x}-0.cubin").write_bytes(b"\x7fELF, not machine code")

    def refuse(*_: object) -> None:
        raise error("no kernel image")

    fresh.native.add_kernels = refuse
    offer(fresh)
    assert (0, BOX, "fused") in kernels._settled


def test_a_damaged_file_is_removed(fresh: Any, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(kernels, "available", lambda: "")
    monkeypatch.setattr(kernels, "_origin", lambda: "0")
    fresh.folder.mkdir()
    file = fresh.folder / f"fused-sm_90-{BOX:x}-0.cubin"
    file.write_bytes(b"")
    offer(fresh)
    assert not file.exists() and not fresh.native.added


def test_headers_that_were_edited_after_the_build(
    fresh: Any, monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    header, module = tmp_path / "cpp" / "a.h", tmp_path / "_cuda.so"
    header.parent.mkdir()
    for file in (header, module):
        file.touch()
    monkeypatch.setattr(kernels, "sources", lambda: header.parent)
    monkeypatch.setattr(kernels, "compiler", lambda: tmp_path)
    found = SimpleNamespace(origin=str(module))
    monkeypatch.setattr(kernels.importlib.util, "find_spec", lambda _: found)
    for newer in (False, True):
        os.utime(header, (1e9, 2e9 if newer else 1e9))
        os.utime(module, (1.5e9, 1.5e9))
        kernels._edited.cache_clear()
        assert ("newer" in kernels.available()) == newer
    kernels._edited.cache_clear()


def test_switches(fresh: Any, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("VERIRAY_KERNELS", "off")
    offer(fresh)
    assert not fresh.native.added and "off" in kernels.available()
    monkeypatch.setenv("VERIRAY_KERNELS", "sometimes")
    with pytest.raises(
        DeviceError, match=r"VERIRAY_KERNELS = 'sometimes'; allowed: auto, off, wait"
    ):
        kernels.mode()
    offer(fresh, method="thrust")
    assert not fresh.native.added


@needs_nvrtc
def test_the_compiler_says_what_is_wrong(tmp_path: Path) -> None:
    program = Path(kernel_compiler.__file__)
    out = tmp_path / "out.cubin"
    command = [
        sys.executable, "-I", program, kernels.compiler(), tmp_path, "sm_90", BOX, "fused", out,
    ]  # fmt: skip
    done = subprocess.run([str(word) for word in command], capture_output=True, text=True)
    assert done.returncode == 1 and "kernel.cuh" in done.stderr and not out.exists()
    assert not list(tmp_path.iterdir())


@needs_nvrtc
def test_the_contract_is_that_of_the_build(root: Path) -> None:
    text = (root / "CMakeLists.txt").read_text()
    for option in kernel_compiler.CONTRACT:
        assert option in text


@pytest.mark.gpu
@pytest.mark.parametrize("method", kernels.METHODS)
@pytest.mark.parametrize("path", SCENES, ids=lambda path: path.stem)
def test_bits(path: Path, method: str, monkeypatch: pytest.MonkeyPatch) -> None:
    """Exactly the features of a scene, and all of them, give the same film."""
    monkeypatch.setenv("VERIRAY_KERNELS", "wait")
    scene = vr.load_file(path)
    film: dict[str, Any] = {
        "width": 32, "height": 32, "spp": 16, "device": "cuda:0", "scheduler": method,
    }  # fmt: skip
    own = vr.render(scene, **film)
    assert own.stats["variant"] == own.stats["features"] or kernels.available()
    assert own.film_sha256 == vr.render(scene, all_features=True, **film).film_sha256


def test_a_render_takes_up_its_kernel_when_it_is_there(
    cornell: vr.Scene, monkeypatch: pytest.MonkeyPatch
) -> None:
    """While a kernel is being compiled a render goes on in parts; picture and counts do not."""
    whole = vr.render(cornell, spp=96, device="cpu")
    asked: list[int] = []

    def awaits(hand: crew.Hand, paths: int = 0) -> bool:
        asked.append(paths)
        return len(asked) < 4

    monkeypatch.setattr(crew.Hand, "_awaits_kernel", awaits)
    monkeypatch.setattr(crew, "FIRST_PART", 1500)  # a group of samples
    monkeypatch.setattr(crew, "GROWTH", 1)
    shares: list[float] = []
    parts = vr.render(cornell, spp=96, device="cpu", progress=shares.append)
    assert asked[:3] == [96 * 32 * 32, 0, 0]  # of the scene, then of parts
    assert parts.film_sha256 == whole.film_sha256
    assert parts.stats["live_rays"] == whole.stats["live_rays"]
    assert shares == sorted(shares) and shares[-1] == 1


@pytest.mark.gpu
def test_wavefront_draws_until_the_kernel_is_there(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """The compiled kernel for every feature is slow, so scenes that need it do not wait in it."""
    scene = vr.load_file(next(path for path in SCENES if path.stem == "attributes"))
    film: dict[str, Any] = {"width": 256, "height": 256, "spp": 16, "device": "cuda:0"}
    fused = vr.render(scene, scheduler="fused", **film)
    monkeypatch.setenv("VERIRAY_CACHE", str(tmp_path))
    for name in ("_settled", "_paths", "_children"):
        monkeypatch.setattr(kernels, name, type(getattr(kernels, name))())
    first = vr.render(scene, **film)
    assert kernels.available() or first.stats["scheduler"] in ("wavefront", "wavefront,fused")
    assert first.stats["blocks"] == [] and first.film_sha256 == fused.film_sha256
    assert first.stats["live_rays"] == fused.stats["live_rays"]
    monkeypatch.setenv("VERIRAY_KERNELS", "wait")
    last = vr.render(scene, **film)
    assert kernels.available() or last.stats["scheduler"] in kernels.METHODS
    assert last.film_sha256 == fused.film_sha256


def test_devices_say_what_they_are() -> None:
    """What `offer` reads of a device."""
    device, _ = select("auto")
    assert device.backend == "cpu" or "." in str(device.details["compute_capability"])
    assert os.fspath(kernels.sources() or "")


@pytest.mark.gpu
def test_waves_while_another_thread_waits_for_the_gpu() -> None:
    """As a training loop does beside a thread that renders: neither disturbs the other."""
    driver, context, done = ctypes.CDLL("libcuda.so.1"), ctypes.c_void_p(), threading.Event()
    waits: list[int] = []
    scene = check_scene("spheres_300", 32)
    found = {vr.render(scene, 16, device="cuda:0", scheduler="fused").film_sha256}

    def wait() -> None:
        driver.cuDevicePrimaryCtxRetain(ctypes.byref(context), 0)
        driver.cuCtxSetCurrent(context)
        while not done.is_set():
            waits.append(driver.cuCtxSynchronize())

    other = threading.Thread(target=wait)
    other.start()
    try:
        for _ in range(60):
            render = vr.render(scene, 16, device="cuda:0", scheduler="wavefront")
            found.add(render.film_sha256)
    finally:
        done.set()
        other.join()
    assert len(found) == 1 and set(waits) == {0}
