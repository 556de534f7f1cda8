"""Feature images stay in memory of their device until they are asked for."""

from __future__ import annotations

import copy
import ctypes
import gc
import os
import pickle
import weakref
from concurrent.futures import ThreadPoolExecutor
from typing import Any

import numpy as np
import numpy.typing as npt
import pytest

import veriray as vr
from veriray import first_surface, held
from veriray.features import NUMBERS

Array = npt.NDArray[Any]
NAMES = "depth,position,albedo,object,material,primitive"
PARTS: dict[str, Any] = {"features": f"{NAMES},direct", "light_groups": {"all": "*"}}


def look(scene: vr.Scene, device: str, **more: Any) -> vr.FeatureImages:
    return vr.feature_images(scene, NAMES, device=device, **{"spp": 3, "seed": 2, **more})


def arrays(images: vr.FeatureImages) -> dict[str, bytes]:
    return {name: values.tobytes() for name, values in images.channels().items()}


def made(images: vr.FeatureImages) -> set[str]:
    """What is there as an array, errors with a prefix."""
    every = [("", images.images), ("stderr.", images.stderr)]
    return {prefix + name for prefix, part in every for name, source in part._sources.items()
            if isinstance(source, np.ndarray)}  # fmt: skip


@pytest.fixture
def all_held(monkeypatch: pytest.MonkeyPatch) -> None:
    """Pictures of a CPU count as those of a GPU, so that they leave its memory too."""
    monkeypatch.setattr(held, "HOST", 99)


def test_what_is_not_asked_for_is_not_made(cornell: vr.Scene, device: str) -> None:
    got = vr.render(cornell, 3, device=device, **PARTS).features
    names = [*NAMES.split(","), "alpha", "direct", "light.all"]
    assert {*got} == {*names} and len(got) == len(names) and repr(got).startswith("FeatureImages(")
    assert "depth" in got and "normal" not in got and got.get("normal") is None and bool(got)
    assert {*got.stderr} == {*names} - {*NUMBERS} and repr(got.stderr).startswith("Arrays(depth")
    assert not made(got)
    for name in ("depth", "object", "direct"):
        first = got[name]
        assert first.flags.writeable and first.flags.c_contiguous and got.images[name] is first
        first[:] = 0
        assert not got[name].any()
    assert made(got) == {"depth", "object", "direct"}
    assert got.stderr["depth"] is got.stderr["depth"] and "stderr.depth" in made(got)
    arrays(got)
    assert made(got) == {*got, *(f"stderr.{name}" for name in got.stderr)}


def test_copies_have_everything(cornell: vr.Scene, device: str) -> None:
    wanted = arrays(vr.render(cornell, 3, device=device, **PARTS).features)
    for twin in (lambda x: pickle.loads(pickle.dumps(x)), copy.deepcopy, copy.copy):
        render = vr.render(cornell, 3, device=device, **PARTS)
        assert arrays(twin(render).features) == wanted
        again = vr.render(cornell, 3, device=device, **PARTS).features
        other = twin(again)
        assert arrays(other) == wanted and other.spp == again.spp and other.lamps == again.lamps


def test_threads_get_the_same_arrays(cornell: vr.Scene, device: str) -> None:
    got = look(cornell, device)
    asked = [(part, name) for part in (got.images, got.stderr) for name in part]
    with ThreadPoolExecutor(8) as pool:
        found = list(pool.map(lambda k: asked[k % len(asked)][0][asked[k % len(asked)][1]],
                              range(8 * len(asked))))  # fmt: skip
    for k, value in enumerate(found):
        assert value is found[k % len(asked)]


def test_bands_and_spans_are_joined(
    cornell: vr.Scene, device: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Films of some rows at a time, and pictures of some films; the last of fewer."""
    wanted = arrays(look(cornell, device))
    for rows, tall in ((3, 3), (3, 9), (8, 16), (5, 32), (32, 32)):
        monkeypatch.setattr(first_surface, "band", lambda *_, rows=rows: rows)
        monkeypatch.setattr(first_surface, "span", lambda *_, tall=tall: tall)
        assert arrays(look(cornell, device)) == wanted


@pytest.mark.usefixtures("all_held")
def test_they_make_room(cornell: vr.Scene, device: str, monkeypatch: pytest.MonkeyPatch) -> None:
    """Memory of the device goes back once all of an image is made, or when others need it."""
    wanted = arrays(look(cornell, device))
    pictures: list[weakref.ref[Any]] = []

    def kept(holder: Any, keep: Any = held.keep) -> None:
        pictures.append(weakref.ref(holder.__dict__["_held"]))
        keep(holder)

    monkeypatch.setattr(held, "keep", kept)
    monkeypatch.setattr(first_surface, "band", lambda *_: 8)
    monkeypatch.setattr(first_surface, "span", lambda *_: 16)
    got = look(cornell, device)
    assert len(pictures) == 2 * 5 and all(picture() is not None for picture in pictures)
    del got.images._sources["position"]  # made, or dropped
    _ = got.stderr["position"]
    assert sum(picture() is None for picture in pictures) == 2
    assert held.move_to_host() and not any(picture() is not None for picture in pictures)
    assert not held.move_to_host() and made(got) == {"stderr.position"}
    again = arrays(got)
    assert again == {name: wanted[name] for name in again} and len(again) == len(wanted) - 3


@pytest.mark.usefixtures("all_held")
def test_pictures_that_do_not_fit_together_make_room_for_the_next(
    cornell: vr.Scene, device: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    """A device without memory for the second half of an image."""
    wanted, room = arrays(look(cornell, device)), 5
    chosen, _ = vr.device.select(device)

    class Native:
        """The module, with room for five pictures."""

        def __getattr__(self, name: str) -> Any:
            return getattr(chosen.native, name)

        def Picture(self, *given: Any) -> Any:  # noqa: N802
            gc.collect()
            there = [h for h, _ in held._on_gpu()]
            if len(there) >= room:
                raise chosen.native.OutOfMemoryError("full")
            return chosen.native.Picture(*given)

    full = vr.device.Device(**{**chosen.__dict__, "native": Native()})
    monkeypatch.setattr(vr.device, "select", lambda *_, **__: (full, ""))
    monkeypatch.setattr(first_surface, "band", lambda *_: 16)
    monkeypatch.setattr(first_surface, "span", lambda *_: 16)
    assert arrays(look(cornell, device)) == wanted


@pytest.mark.skipif(not hasattr(os, "fork"), reason="needs fork")
@pytest.mark.usefixtures("all_held")
def test_a_child_has_copies(cornell: vr.Scene, device: str) -> None:
    wanted = arrays(vr.render(cornell, 3, device=device, **PARTS).features)
    got = vr.render(cornell, 3, device=device, **PARTS).features
    child = os.fork()
    if child == 0:
        good = False
        try:
            good = not held._on_gpu() and arrays(got) == wanted
        finally:
            os._exit(7 if good else 1)
    assert os.waitstatus_to_exitcode(os.waitpid(child, 0)[1]) == 7
    assert not made(got) and arrays(got) == wanted


def test_the_scene_is_not_kept(device: str) -> None:
    """Nor its form on the device: numbers keep its arrays alone."""
    scene = vr.cornell_box().with_(width=8, height=8)
    got = look(scene, device)
    forms = [weakref.ref(form.native) for form in scene.native_forms]
    assert forms and forms[0]() is not None
    del scene
    gc.collect()
    assert not any(form() is not None for form in forms)
    assert got["object"].any() and got["primitive"].any()


def test_pictures_that_do_not_fit_are_refused(cornell: vr.Scene, cpu: str) -> None:
    from veriray.native_scene import native_scene

    chosen, _ = vr.device.select(cpu)
    native, scene = chosen.native, native_scene(cornell, cornell, chosen)
    plane = {"name": "hits", "kind": "integers", "channels": 1, "negative": False}
    depth = {"name": "depth", "kind": "sums and squares", "channels": 1, "negative": True}
    film = native.Film(32, 8, planes=[plane, depth])

    def put(pictures: list[Any], first_row: int = 0, film: Any = film) -> None:
        native.put_features(scene, film, pictures=pictures, first_row=first_row, samples=1)

    good = native.Picture(32, 9, 1)
    put([good, None], 1)
    put([None, None])
    with pytest.raises(ValueError, match="1 pictures for a film of 3 planes"):
        put([good])
    for bad in (native.Picture(31, 9, 1), native.Picture(32, 9, 3), native.Picture(32, 7, 1),
                native.Picture(32, 9, 1, integers=True)):  # fmt: skip
        with pytest.raises(ValueError, match="plane 'hits' does not fit into its picture"):
            put([bad, None])
    for row in (2, 2**32 - 1):
        with pytest.raises(ValueError, match=f"from row {row} on"):
            put([good, good], row)
    with pytest.raises(ValueError, match="no plane 'hits'"):
        put([good], film=native.Film(32, 8, planes=[depth]))
    with pytest.raises(ValueError, match="plane 'light' does not fit"):
        other = [plane, {**depth, "name": "light"}]
        put([good, good], film=native.Film(32, 8, planes=other))
    with pytest.raises(ValueError, match="a picture of 65 channels; allowed: 1 to 64"):
        native.Picture(1, 1, 65)


@pytest.mark.gpu
@pytest.mark.skipif(
    "PYTEST_XDIST_WORKER" in os.environ, reason="others use the GPU: run without -n"
)
def test_repeated_calls_take_no_memory(cornell: vr.Scene) -> None:
    free, total = ctypes.c_size_t(), ctypes.c_size_t()

    def left() -> int:
        info = ctypes.CDLL("libcuda.so.1").cuMemGetInfo_v2
        assert info(ctypes.byref(free), ctypes.byref(total)) == 0
        return free.value

    size = {"width": 700, "height": 500}
    for _ in range(3):
        arrays(look(cornell, "cuda", **size))
    before = left()
    for seed in range(20):
        arrays(look(cornell, "cuda", seed=seed, **size))
    assert left() == before


@pytest.mark.gpu
@pytest.mark.parametrize(
    "size", [(1999, 300, 8), (1024, 1024, 8), (1500, 1500, 8), (1021, 1021, 17)]
)
def test_large_images_reach_the_host(cornell: vr.Scene, size: tuple[int, int, int]) -> None:
    """By page-locked memory, of several films, and of more samples than float32 counts."""
    shape = dict(zip(("width", "height", "spp"), size, strict=True))
    assert arrays(look(cornell, "cuda", **shape)) == arrays(look(cornell, "cpu", **shape))


@pytest.mark.gpu
@pytest.mark.skipif("PYTEST_XDIST_WORKER" in os.environ, reason="fills the GPU: run it without -n")
def test_images_make_room_on_a_full_gpu(cornell: vr.Scene) -> None:
    chosen, _ = vr.device.select("cuda")
    native, size = chosen.native, {"width": 1024, "height": 1024}  # 68 MiB each
    wanted = [arrays(look(cornell, "cuda", seed=k, **size)) for k in range(3)]
    images = [look(cornell, "cuda", seed=k, **size) for k in range(3)]
    free = int(native.devices()[chosen.index]["memory_free"])
    full = [native.Film(1024, (free - (1 << 30)) // (1024 * 96), device=chosen.index)]
    with pytest.raises(native.OutOfMemoryError):
        while True:
            full.append(native.Film(1024, 682, device=chosen.index))  # 64 MiB each
    assert held._on_gpu()
    other = look(cornell, "cuda", width=512, height=512)  # a film of 96 MiB
    there = {id(picture) for _, picture in held._on_gpu()}
    for image in images:
        for source in image.images._sources.values():
            assert not there & {id(part._held) for part in getattr(source, "_parts", ())}
    assert not any(map(made, images)) and [arrays(image) for image in images] == wanted
    del full
    assert arrays(other) == arrays(look(cornell, "cpu", width=512, height=512))
