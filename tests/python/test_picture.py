"""Where the picture of a render is, who may have it without a copy, and for how long."""

from __future__ import annotations

import copy
import ctypes
import dataclasses
import gc
import os
import pickle
import weakref
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from typing import Any

import numpy as np
import pytest

import veriray as vr
from veriray.held import move_to_host

SIZE = 48


def render(scene: vr.Scene, device: str = "cpu", **settings: Any) -> vr.Render:
    return vr.render(scene, device=device, **{"spp": 4, "width": SIZE, "height": SIZE, **settings})


def made(picture: vr.Render) -> set[str]:
    return {"image", "stderr", "film_sha256"} & set(picture.__dict__)


def test_what_is_not_asked_for_is_not_made(cornell: vr.Scene, device: str) -> None:
    picture = render(cornell, device)
    assert not made(picture)
    first = picture.image
    assert made(picture) == {"image"} and picture.image is first
    assert first.flags.writeable and first.flags.c_contiguous
    assert not isinstance(first.base, np.ndarray)  # no view of what the module holds
    assert picture.film_sha256 == vr.film_hash(first, picture.stderr, 4)
    with pytest.raises(AttributeError, match="'Render' object has no attribute 'imag'"):
        picture.imag  # noqa: B018


def test_the_hash_is_of_the_picture_itself(cornell: vr.Scene, device: str) -> None:
    wanted = render(cornell, device).film_sha256
    picture = render(cornell, device)
    picture.image[:] = 0
    picture.stderr[:] = 0
    assert picture.film_sha256 == wanted


def test_copies_have_everything(cornell: vr.Scene, device: str) -> None:
    picture, wanted = render(cornell, device), render(cornell, device)
    for other in (
        pickle.loads(pickle.dumps(picture)),
        copy.copy(picture),
        copy.deepcopy(picture),
        dataclasses.replace(picture, spp=4),
    ):
        assert np.array_equal(other.image, wanted.image)
        assert np.array_equal(other.stderr, wanted.stderr)
        assert other.film_sha256 == wanted.film_sha256 and other.stats == picture.stats
        assert np.shares_memory(np.asarray(other), other.image)
        assert np.shares_memory(np.from_dlpack(other), other.image)


def test_threads_get_the_same_arrays(cornell: vr.Scene, device: str) -> None:
    picture = render(cornell, device)

    def ask(k: int) -> Any:
        return getattr(picture, ("image", "stderr", "film_sha256")[k % 3])

    with ThreadPoolExecutor(8) as pool:
        found = list(pool.map(ask, range(48)))
    for k, value in enumerate(found):
        assert value is found[k % 3]


def test_memory_serves_the_next_picture(cornell: vr.Scene, device: str) -> None:
    """That of arrays that nobody holds; those that somebody holds stay as they are."""
    wanted = [render(cornell, device, seed=seed).image.copy() for seed in range(4)]
    first, kept = (render(cornell, device, seed=seed).image for seed in range(2))
    place, part = first.ctypes.data, kept[3:]
    del first, kept
    found = [render(cornell, device, seed=seed).image for seed in (2, 3)]
    assert place in [image.ctypes.data for image in found]
    assert np.array_equal(part, wanted[1][3:])
    assert np.array_equal(found, wanted[2:])


def test_arrays_without_a_copy(cornell: vr.Scene, cpu: str) -> None:
    picture = render(cornell, cpu)
    held = np.asarray(picture)
    assert held.shape == (SIZE, SIZE, 3) and held.dtype == np.float32
    assert not held.flags.writeable and not made(picture)
    lent = np.from_dlpack(picture)
    assert np.shares_memory(held, np.asarray(picture)) and np.shares_memory(held, lent)
    assert np.array_equal(held, picture.image) and not np.shares_memory(held, picture.image)
    assert np.asarray(picture) is picture.image
    assert np.array(picture).flags.writeable
    assert np.asarray(picture, np.float64).dtype == np.float64


@pytest.mark.parametrize("lend", [np.asarray, np.from_dlpack, lambda r: np.asarray(r)[1:]])
def test_what_is_lent_outlives_the_render(
    cornell: vr.Scene, cpu: str, lend: Callable[[vr.Render], Any]
) -> None:
    """Also while other renders take memory of the same size."""
    wanted = render(cornell, cpu).image
    picture = render(cornell, cpu)
    lent = lend(picture)
    del picture
    gc.collect()
    others = [render(cornell, cpu, seed=k) for k in range(1, 9)]
    assert np.array_equal(lent, wanted[-len(lent) :])
    assert not any(np.shares_memory(np.asarray(other), lent) for other in others)


@pytest.mark.skipif(not os.path.exists("/proc/self/statm"), reason="needs Linux")
def test_what_is_lent_is_given_back(cornell: vr.Scene, cpu: str) -> None:
    """600 pictures of 96 KiB, each lent in every way, are 56 MiB."""

    def resident() -> int:
        with open("/proc/self/statm") as file:
            return int(file.read().split()[1]) * os.sysconf("SC_PAGESIZE")

    def lend(times: int) -> None:
        for k in range(times):
            picture = render(cornell, cpu, spp=1, width=64, height=64, max_depth=1, seed=k)
            kept = [np.asarray(picture), np.from_dlpack(picture), picture.image]
            unused = picture.__dlpack__(), picture.__dlpack__(max_version=(1, 0))
            del picture, kept, unused

    lend(100)
    before = resident()
    lend(600)
    assert resident() - before < 16 << 20


def test_dlpack_versions_and_devices(cornell: vr.Scene, cpu: str) -> None:
    picture = render(cornell, cpu)
    assert picture.__dlpack_device__() == (1, 0)
    assert '"dltensor"' in repr(picture.__dlpack__())
    assert '"dltensor"' in repr(picture.__dlpack__(max_version=(0, 8)))
    assert '"dltensor_versioned"' in repr(picture.__dlpack__(max_version=(1, 0)))
    assert not hasattr(picture, "__cuda_array_interface__")
    with pytest.raises(BufferError, match=r"on device \(1, 0\) of DLPack, not on \(2, 0\)"):
        picture.__dlpack__(dl_device=(2, 0))
    fresh = picture.__dlpack__(copy=True)
    assert '"dltensor"' in repr(fresh)


def test_mean_of_the_standard_errors(cornell: vr.Scene, device: str) -> None:
    """The same number on every device, and exact under powers of two."""
    found = render(cornell, device).stats["mean_stderr"]
    assert found == render(cornell, "cpu").stats["mean_stderr"] > 0
    stderr = render(cornell, device).stderr
    assert found == pytest.approx(stderr.mean(dtype=np.float64), rel=1e-12)
    for k in (-20, 7):
        scaled = render(cornell.with_emission_scaled(2.0**k), device)
        assert scaled.stats["mean_stderr"] == found * 2.0**k
    assert render(cornell, device, spp=1).stats["mean_stderr"] == 0


def test_large_pictures_are_summed_by_threads(cornell: vr.Scene, cpu: str) -> None:
    settings: dict[str, Any] = {"width": 300, "height": 200, "spp": 2}
    one = render(cornell, cpu, threads=1, **settings)
    for threads in (2, 5):
        other = render(cornell, cpu, threads=threads, **settings)
        assert other.stats["mean_stderr"] == one.stats["mean_stderr"]
        assert other.film_sha256 == one.film_sha256
    assert one.stats["mean_stderr"] == pytest.approx(one.stderr.mean(dtype=np.float64), rel=1e-12)


def test_repeated_renders_forget_no_setting(cornell: vr.Scene) -> None:
    """The last settings that a scene was rendered with are kept."""
    changes: list[dict[str, Any]] = [
        {}, {"seed": 3}, {"max_depth": 2}, {"rr_depth": 2}, {"sampler": "sobol"}, {"width": 40},
        {"spp": 5}, {"spp": 4}, {},
    ]  # fmt: skip
    for change in changes:
        again = render(cornell, **change)
        fresh = render(pickle.loads(pickle.dumps(cornell)), **change)
        assert again.film_sha256 == fresh.film_sha256, change
        assert again.stats["scene_sha256"] == fresh.stats["scene_sha256"], change
        assert (again.seed, again.spp) == (change.get("seed", 0), change.get("spp", 4))
    with pytest.raises(vr.SceneError, match="width = 32.0 is not an integer"):
        render(cornell, width=32.0)


class OnGpu:
    """A stand-in for a native picture that is in memory of a GPU."""

    def __init__(self, values: Any) -> None:
        self.values, self.owner = values, os.getpid()

    def image(self) -> Any:
        assert os.getpid() == self.owner
        return self.values.copy()

    def stderr(self) -> Any:
        return self.image() / 8

    def dlpack_device(self) -> tuple[int, int]:
        return 2, 0

    def pointer(self) -> int:
        return self.values.ctypes.data


def on_gpu(seed: int) -> tuple[vr.Render, OnGpu]:
    held = OnGpu(np.random.default_rng(seed).random((4, 5, 3), np.float32))
    more: dict[str, Any] = {"stats": {}, "batch_means": None, "samples": None, "seed": 0}
    return vr.Render._of(held, width=5, height=4, spp=2, **more), held  # type: ignore[arg-type]


def test_pictures_of_a_gpu_move_to_the_host() -> None:
    (picture, held), (lent, kept) = on_gpu(1), on_gpu(2)
    pointer = lent.__cuda_array_interface__["data"][0]
    values, gone = held.values, weakref.ref(held)
    del held
    assert move_to_host()
    assert gone() is None, "its memory is not given back"
    assert picture.__dlpack_device__() == (1, 0)
    assert not hasattr(picture, "__cuda_array_interface__")
    assert lent.__dlpack_device__() == (2, 0)
    assert lent.__cuda_array_interface__["data"][0] == pointer
    picture.image[:] = 0
    assert picture.film_sha256 == vr.film_hash(values, values / 8, 2)
    assert np.array_equal(lent.image, kept.values)
    assert not move_to_host()


@pytest.mark.skipif(not hasattr(os, "fork"), reason="needs fork")
def test_a_child_has_copies_of_a_gpus_pictures() -> None:
    picture, held = on_gpu(1)
    assert picture.__cuda_array_interface__["version"] == 3
    child = os.fork()
    if child == 0:
        good = False
        try:
            good = picture.film_sha256 == vr.film_hash(held.values, held.values / 8, 2)
            good &= np.array_equal(picture.image, held.values)
            good &= picture.__dlpack_device__() == (1, 0)
        finally:
            os._exit(7 if good else 1)
    assert os.waitstatus_to_exitcode(os.waitpid(child, 0)[1]) == 7
    assert picture.__dlpack_device__() == (2, 0) and picture.__dict__["_held"] is held
    assert "_for_child" not in picture.__dict__


# On a GPU


def driver() -> ctypes.CDLL:
    return ctypes.CDLL("libcuda.so.1")


def read(pointer: int, shape: tuple[int, ...]) -> Any:
    """What is in the GPU's memory, by the driver alone."""
    out = np.empty(shape, np.float32)
    copied = driver().cuMemcpyDtoH_v2(
        ctypes.c_void_p(out.ctypes.data), ctypes.c_uint64(pointer), ctypes.c_size_t(out.nbytes)
    )
    assert copied == 0
    return out


def address(capsule: Any) -> int:
    """The first word of what a capsule points to: of a DLTensor its data."""
    get = ctypes.pythonapi.PyCapsule_GetPointer
    get.restype, get.argtypes = ctypes.c_void_p, [ctypes.py_object, ctypes.c_char_p]
    return int(ctypes.c_uint64.from_address(get(capsule, b"dltensor")).value)


@pytest.mark.gpu
def test_the_gpu_lends_its_memory(cornell: vr.Scene) -> None:
    wanted = render(cornell, "cuda").image
    picture = render(cornell, "cuda")
    interface = picture.__cuda_array_interface__
    assert interface["shape"] == (SIZE, SIZE, 3) and interface["typestr"] == "<f4"
    assert interface["version"] == 3 and interface["stream"] is None
    pointer, read_only = interface["data"]
    assert not read_only and picture.__cuda_array_interface__["data"] == (pointer, False)
    assert picture.__dlpack_device__() == (2, 0)
    capsule = picture.__dlpack__(stream=-1)
    assert address(capsule) == pointer and not made(picture)
    assert np.array_equal(read(pointer, wanted.shape), wanted)
    assert move_to_host()
    assert picture.__cuda_array_interface__["data"] == (pointer, False)
    del picture
    gc.collect()
    others = [render(cornell, "cuda", seed=k) for k in range(1, 9)]
    assert np.array_equal(read(pointer, wanted.shape), wanted)
    del capsule
    addresses = {address(other.__dlpack__()) for other in others}
    assert len(addresses) == len(others) and pointer not in addresses
    assert all(np.array_equal(read(address(o.__dlpack__()), o.image.shape), o.image)
               for o in others)  # fmt: skip
    with pytest.raises(BufferError, match="lent without a copy"):
        others[0].__dlpack__(copy=True)
    assert np.array_equal(np.from_dlpack(others[0], device="cpu"), others[0].image)


@pytest.mark.gpu
@pytest.mark.parametrize("size", [64, 700, 1024, 1999])
def test_pictures_of_any_size_reach_the_host(cornell: vr.Scene, size: int) -> None:
    """By the driver, and by page-locked memory in one window and in several."""
    settings: dict[str, Any] = {"width": size, "height": size, "spp": 2}
    gpu, cpu = render(cornell, "cuda", **settings), render(cornell, "cpu", **settings)
    assert np.array_equal(gpu.image, cpu.image) and np.array_equal(gpu.stderr, cpu.stderr)
    assert gpu.stats["mean_stderr"] == cpu.stats["mean_stderr"]


@pytest.mark.gpu
@pytest.mark.skipif(
    "PYTEST_XDIST_WORKER" in os.environ, reason="others use the GPU: run without -n"
)
def test_repeated_renders_take_no_memory(cornell: vr.Scene) -> None:
    free, total = ctypes.c_size_t(), ctypes.c_size_t()

    def left() -> int:
        assert driver().cuMemGetInfo_v2(ctypes.byref(free), ctypes.byref(total)) == 0
        return free.value

    for scheduler in ("fused", "thrust", "wavefront"):
        for _ in range(3):
            render(cornell, "cuda", scheduler=scheduler).image.sum()
        before = left()
        for seed in range(20):
            render(cornell, "cuda", scheduler=scheduler, seed=seed).image.sum()
        assert left() == before, scheduler


@pytest.mark.gpu
@pytest.mark.skipif("PYTEST_XDIST_WORKER" in os.environ, reason="fills the GPU: run it without -n")
def test_pictures_make_room_on_a_full_gpu(cornell: vr.Scene) -> None:
    chosen, _ = vr.device.select("cuda")
    large: dict[str, Any] = {"width": 2048, "height": 2048, "spp": 1}  # 96 MiB each
    pictures = [render(cornell, "cuda", seed=k, **large) for k in range(4)]
    wanted = [picture.film_sha256 for picture in pictures]
    lent = pictures[0].__cuda_array_interface__["data"][0]
    render(cornell, "cuda", seed=9)  # all kernels are loaded
    free = int(chosen.native.devices()[chosen.index]["memory_free"])
    full = chosen.native.Film(1024, (free - (160 << 20)) // (1024 * 96), device=chosen.index)
    other = render(cornell, "cuda", width=1600, height=1600, spp=1)  # a film of 234 MiB
    assert not made(other) and other.__dlpack_device__() == (2, 0)
    assert [picture.__dlpack_device__()[0] for picture in pictures] == [2, 1, 1, 1]
    assert pictures[0].__cuda_array_interface__["data"][0] == lent
    assert np.array_equal(read(lent, (2048, 2048, 3)), pictures[0].image)
    assert [picture.film_sha256 for picture in pictures] == wanted
    del full


@pytest.mark.gpu
@pytest.mark.skipif(not hasattr(os, "fork"), reason="needs fork")
def test_a_child_has_the_pictures_of_its_parent(cornell: vr.Scene) -> None:
    wanted = render(cornell, "cuda").film_sha256
    picture = render(cornell, "cuda")
    child = os.fork()
    if child == 0:
        os._exit(7 if picture.film_sha256 == wanted and picture.image.any() else 1)
    assert os.waitstatus_to_exitcode(os.waitpid(child, 0)[1]) == 7
    assert picture.film_sha256 == wanted and picture.__dlpack_device__() == (2, 0)
