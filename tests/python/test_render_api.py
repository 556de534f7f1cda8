"""`veriray.render`: checks, results, invariance, interruption, device choice."""

from __future__ import annotations

import copy
import dataclasses
import hashlib
import json
import logging
import pickle
import struct
import sys
import threading
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from importlib.util import find_spec
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

import veriray as vr
from veriray import device as device_module
from veriray import kernels, native_scene
from veriray.rendering import METHODS, SCHEDULERS, choose_scheduler, prepare
from veriray.settings import RenderSettings
from veriray_validate.levels.stress_extremes import too_bright
from veriray_validate.scenes import Part, camera, check_scene, make

CAUSES = ("escaped", "emitter_end", "absorbed", "rr_killed", "depth_cut", "invalid")


@pytest.fixture(scope="module")
def picture(cornell: vr.Scene) -> vr.Render:
    return vr.render(cornell, spp=16, device="cpu")


def test_shapes_and_types(picture: vr.Render) -> None:
    for values in (picture.image, picture.stderr):
        assert values.shape == (32, 32, 3) and values.dtype == np.float32
        assert np.isfinite(values).all() and (values >= 0).all()
    assert picture.batch_means is None
    assert (picture.width, picture.height, picture.spp, picture.seed) == (32, 32, 16, 0)
    assert picture._repr_png_().startswith(b"\x89PNG\r\n\x1a\n")


def test_film_hash_is_as_documented(picture: vr.Render) -> None:
    data = b"veriray film 1" + struct.pack("<QQQ", 32, 32, 16)
    data += picture.image.astype("<f4").tobytes() + picture.stderr.astype("<f4").tobytes()
    assert picture.film_sha256 == hashlib.sha256(data).hexdigest()
    assert picture.film_sha256 != vr.film_hash(picture.image, picture.stderr, 17)


def test_stats(picture: vr.Render, cornell: vr.Scene) -> None:
    stats = picture.stats
    assert json.loads(json.dumps(stats)) == stats
    assert stats["paths"] == 32 * 32 * 16 == stats["live_rays"][0]
    assert stats["live_rays"] == stats["ledger"]["live"]
    assert stats["scene_sha256"] == cornell.sha256
    assert stats["version"] == vr.__version__
    assert stats["device"].startswith("cpu:") and stats["device_reason"]
    assert stats["scheduler"] in METHODS and stats["scheduler_reason"]
    assert stats["features"] and stats["threads"] >= 1 and stats["memory"] > 0
    assert set(stats["features"]) <= set(stats["variant"]) and stats["path_bytes"] > 0
    assert stats["tree"] == {} and stats["primitives"]["dropped"] == 0
    assert stats["nonfinite_samples"] == 0 and stats["nonfinite"] == []
    assert stats["mean_stderr"] == pytest.approx(picture.stderr.mean(dtype=np.float64))
    shadow = sum(stats["ledger"]["shadow_visible"]) + sum(stats["ledger"]["shadow_occluded"])
    assert stats["rays"] == sum(stats["live_rays"]) + shadow


@pytest.mark.parametrize("scheduler", SCHEDULERS[1:])
@pytest.mark.parametrize("max_depth", [1, 2, 5, -1])
def test_ledger_adds_up(cornell: vr.Scene, device: str, scheduler: str, max_depth: int) -> None:
    stats = vr.render(cornell, 2, device=device, scheduler=scheduler, max_depth=max_depth).stats
    ledger = stats["ledger"]
    assert {len(column) for column in ledger.values()} == {len(ledger["live"])}
    following = [*ledger["live"][1:], 0]
    for depth, live in enumerate(ledger["live"]):
        assert live == sum(ledger[cause][depth] for cause in CAUSES) + following[depth]
    if max_depth > 0:
        assert len(ledger["live"]) <= max_depth
    if scheduler.startswith("thrust"):
        assert len(stats["blocks"]) == len(ledger["live"])
        for whole, part in zip(stats["depth_seconds"], stats["compaction_seconds"], strict=True):
            assert 0 <= part <= whole


def test_nothing_but_the_picture_settings_matters(
    cornell: vr.Scene, picture: vr.Render, device: str
) -> None:
    variants: list[dict[str, Any]] = [
        *({"scheduler": name} for name in SCHEDULERS),
        *({"scheduler": name, "batch_size": 257} for name in SCHEDULERS),
        {"threads": 1},
        {"threads": 3, "batch_size": 1000},
        {"batches": 4},
        {"batches": 16, "scheduler": "thrust", "batch_size": 257},
        {"batches": 4, "scheduler": "wavefront", "batch_size": 33},
        *({"all_features": True, "scheduler": name} for name in METHODS),
    ]
    for variant in variants:
        other = vr.render(cornell, spp=16, device=device, **variant)
        assert other.film_sha256 == picture.film_sha256, variant
        assert other.stats["ledger"] == picture.stats["ledger"], variant


@pytest.mark.parametrize("scheduler", ["wavefront", "wavefront-unsorted"])
@pytest.mark.parametrize(
    "name", ["mask", "medium_in_mesh", "nested_dielectrics", "spheres_300", "thinlens"]
)
def test_waves_of_any_size(device: str, scheduler: str, name: str) -> None:
    """Batches of one path, a warp and one more, a tile and part of one, more than all paths."""
    scene = check_scene(name, 16).with_(sampler="sobol")
    for depth in (1, -1):
        wanted = vr.render(scene, 3, device="cpu", scheduler="fused", max_depth=depth)
        for batch in (1, 33, 700, 2000):
            other = vr.render(
                scene, 3, device=device, scheduler=scheduler, max_depth=depth, batch_size=batch
            )
            assert other.film_sha256 == wanted.film_sha256, (depth, batch)
            assert other.stats["ledger"] == wanted.stats["ledger"], (depth, batch)


@pytest.mark.gpu
@pytest.mark.parametrize("scheduler", METHODS)
def test_more_paths_in_flight_than_float32_counts(scheduler: str) -> None:
    """A batch of 2^24 + 1,200 paths."""
    scene = check_scene("spheres_300", 4128).with_(height=4099)
    wanted, found = (
        vr.render(scene, 1, device="cuda", max_depth=3, **more)
        for more in ({"scheduler": "fused"}, {"scheduler": scheduler, "batch_size": 2**24 + 1200})
    )
    assert found.film_sha256 == wanted.film_sha256
    assert found.stats["ledger"] == wanted.stats["ledger"]


@pytest.mark.parametrize(
    "change",
    [
        {"seed": 1},
        {"spp": 17},
        {"max_depth": 3},
        {"rr_depth": 2},
        {"width": 33},
        {"sampler": "independent"},
        {"target_error": 0.5, "spp": 64},
        {"seed": 2**64 - 1},
    ],
    ids=str,
)
def test_each_picture_setting_matters(
    cornell: vr.Scene, picture: vr.Render, change: dict[str, int]
) -> None:
    other = vr.render(cornell, **{"spp": 16, "device": "cpu", **change})
    assert other.film_sha256 != picture.film_sha256


def test_scenes_can_be_copied(cornell: vr.Scene) -> None:
    wanted = cornell.sha256
    for other in (copy.deepcopy(cornell), pickle.loads(pickle.dumps(cornell)), cornell.with_()):
        assert other.sha256 == wanted
    assert cornell.with_(max_depth=3).sha256 != wanted
    assert dataclasses.replace(cornell, vertices=cornell.vertices * 2).sha256 != wanted


def test_batch_means(cornell: vr.Scene, picture: vr.Render) -> None:
    batched = vr.render(cornell, spp=16, batches=4, device="cpu")
    assert batched.batch_means is not None
    assert batched.batch_means.shape == (4, 32, 32, 3) and batched.batch_means.dtype == np.float64
    np.testing.assert_allclose(batched.batch_means.mean(axis=0), picture.image, rtol=1e-6)
    first = vr.render(cornell, spp=4, device="cpu")
    np.testing.assert_allclose(batched.batch_means[0], first.image, rtol=1e-6)


def test_size_override_is_the_scene_of_that_size(cornell: vr.Scene) -> None:
    overridden = vr.render(cornell, 2, width=40, height=24, device="cpu")
    changed = vr.render(cornell.with_(width=40, height=24), 2, device="cpu")
    assert overridden.image.shape == (24, 40, 3)
    assert overridden.film_sha256 == changed.film_sha256
    assert overridden.stats["scene_sha256"] == changed.stats["scene_sha256"]


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        ({"spp": 0}, "spp = 0 is outside"),
        ({"spp": 2.0}, "spp = 2.0 is not an integer"),
        ({"spp": True}, "spp = True is not an integer"),
        ({"seed": -1}, "seed = -1 is outside"),
        ({"seed": 2**64}, "seed = 18446744073709551616 is outside"),
        ({"max_depth": -2}, "max_depth = -2 is outside"),
        ({"rr_depth": 0}, "rr_depth = 0 is outside"),
        ({"width": 0}, "width = 0 is outside"),
        ({"height": 2**30, "width": 4}, "pixels has more than"),
        ({"threads": 0}, "threads = 0 is outside"),
        ({"batches": 1}, "batches = 1; expected 0 or a divisor of spp = 16"),
        ({"batches": 3}, "batches = 3; expected 0 or a divisor of spp = 16"),
        ({"batch_size": -1}, "batch_size = -1 is outside"),
        ({"scheduler": "best"}, "scheduler = 'best' is unknown; allowed: auto, fused, thrust"),
        ({"device": "gpu"}, "device = 'gpu' is unknown; allowed: auto, cuda"),
        ({"device": "cuda:x"}, "device = 'cuda:x' is unknown"),
        ({"device": "cpu:"}, "device = 'cpu:' is unknown"),
        ({"device": 3}, "device = 3; expected a string"),
        ({"progress": 3}, "progress = 3 is not callable"),
    ],
)
def test_bad_arguments(cornell: vr.Scene, arguments: dict[str, Any], message: str) -> None:
    with pytest.raises(ValueError) as caught:
        vr.render(cornell, **{"spp": 16, **arguments})
    assert message in str(caught.value)


def test_scene_must_be_a_scene() -> None:
    with pytest.raises(TypeError, match="load_file"):
        vr.render("cornell-box")  # type: ignore[arg-type]


@pytest.mark.parametrize("batches", [0, 4])
def test_progress(cornell: vr.Scene, cpu: str, batches: int) -> None:
    seen: list[float] = []
    vr.render(cornell, spp=64, device=cpu, batches=batches, progress=seen.append)
    assert seen == sorted(seen) and seen[-1] == 1.0 and seen[0] >= 0.0


def test_building_a_tree_reports_and_can_be_stopped(cpu: str) -> None:
    """A large mesh: the tree is the first tenth; the next render of the scene builds nothing."""
    side = 150
    grid = np.stack(np.meshgrid(*[np.linspace(-1, 1, side)] * 2), axis=-1).reshape(-1, 2)
    vertices = np.column_stack([grid, 0.3 * np.sin(5 * grid[:, 0])])
    first = (np.arange(side - 1)[:, None] * side + np.arange(side - 1)).ravel()
    a, b = first + side, first + side + 1
    faces = np.concatenate([np.column_stack([first, first + 1, b]), np.column_stack([first, b, a])])
    scene = make([Part(vertices, faces, 0.5)], camera([0, 0, 3], [0, 0, 0], 40), 1.0, 8, 8)
    with pytest.raises(KeyboardInterrupt):
        vr.render(scene, 1, device=cpu, progress=stop_at_once)
    seen: list[float] = []
    picture = vr.render(scene, 1, device=cpu, progress=seen.append)
    assert seen == sorted(seen) and seen[-1] == 1.0
    tree = picture.stats["tree"]
    assert tree["nodes"] > 0 and tree["references"] >= len(faces) and tree["depth"] > 0
    assert "bvh" in picture.stats["features"] and "bvh" in picture.stats["variant"]
    facts = prepare(scene, cpu, progress=stop_at_once)
    assert facts["tree"] == tree and facts["primitives"] == picture.stats["primitives"]


def stop_at_once(fraction: float) -> None:
    raise KeyboardInterrupt


@pytest.mark.parametrize(
    "error", [RuntimeError("stop"), KeyboardInterrupt(), SystemExit(3)], ids=repr
)
@pytest.mark.parametrize("scheduler", METHODS)
def test_progress_can_stop(
    cornell: vr.Scene, picture: vr.Render, cpu: str, scheduler: str, error: BaseException
) -> None:
    check_stop(cornell, picture, cpu, scheduler, error, 2**14)


@pytest.mark.gpu
@pytest.mark.parametrize("scheduler", METHODS)
def test_progress_can_stop_cuda(cornell: vr.Scene, picture: vr.Render, scheduler: str) -> None:
    check_stop(cornell, picture, "cuda", scheduler, KeyboardInterrupt(), 2**22)


def check_stop(
    scene: vr.Scene,
    picture: vr.Render,
    device: str,
    scheduler: str,
    error: BaseException,
    spp: int,
) -> None:
    """An exception of the callback ends a long render, and the next one is right."""

    def stop(fraction: float) -> None:
        if fraction < 1.0:
            raise error

    with pytest.raises(type(error)) as caught:
        vr.render(scene, spp, device=device, scheduler=scheduler, progress=stop)
    assert caught.value is error
    again = vr.render(scene, spp=16, device=device, scheduler=scheduler)
    assert again.film_sha256 == picture.film_sha256


def test_other_threads_run_while_rendering(cornell: vr.Scene) -> None:
    beats, done = 0, threading.Event()

    def heart() -> None:
        nonlocal beats
        while not done.wait(0.001):
            beats += 1

    thread = threading.Thread(target=heart)
    thread.start()
    before = beats
    vr.render(cornell, spp=2048, device="cpu", threads=1)
    during = beats - before
    done.set()
    thread.join()
    assert during > 3


def test_threads_render_the_same_scene_at_once(cornell: vr.Scene, picture: vr.Render) -> None:
    def job(k: int) -> str:
        name = METHODS[k % len(METHODS)]
        return vr.render(cornell, spp=16, device="cpu", scheduler=name, threads=2).film_sha256

    with ThreadPoolExecutor(8) as pool:
        assert set(pool.map(job, range(16))) == {picture.film_sha256}


def test_native_scenes_stay_with_their_owner() -> None:
    scene = vr.cornell_box()
    for size in (8, 9, 10):
        vr.render(scene, 1, width=size, height=size, device="cpu")
    assert len(scene.native_forms) == native_scene._KEPT_PER_SCENE
    for other in (copy.copy(scene), pickle.loads(pickle.dumps(scene))):
        assert other.sha256 == scene.sha256
        assert not other.native_forms
    assert scene.with_(spp=2).native_forms is scene.native_forms


DENSE = """<scene version="3.0.0">
<sensor type="perspective"><float name="fov" value="40"/></sensor>
<shape type="sphere"><bsdf type="null"/>
 <medium name="interior" type="homogeneous">
  <float name="sigma_t" value="1e38"/></medium></shape>
<emitter type="constant"/></scene>"""


def test_faults_found_while_building_name_their_place(tmp_path: Any) -> None:
    path = tmp_path / "dense.xml"
    path.write_text(DENSE)
    scene = vr.load_file(path)
    for given in (scene, scene.with_(spp=2), pickle.loads(pickle.dumps(scene))):
        with pytest.raises(
            vr.SceneError, match=r"dense\.xml:4: sigma_t\[0\] = 1e\+38 is too"
        ) as info:
            prepare(given, "cpu", 8, 8)
        assert info.value.where == f"{path}:4"
    bright = vr.cornell_box().with_emission_scaled(1e35)
    with pytest.raises(vr.SceneError, match=r"cornell_box\.xml:\d+: the largest radiance"):
        prepare(bright, "cpu")
    with pytest.raises(vr.SceneError, match=r"^the largest radiance"):
        prepare(dataclasses.replace(bright), "cpu")


def test_a_callbacks_value_error_stays_one() -> None:
    def fail(fraction: float) -> None:
        raise ValueError("mine")

    with pytest.raises(ValueError, match="^mine$") as info:
        vr.render(vr.cornell_box(), 4096, device="cpu", progress=fail)
    assert info.type is ValueError


def test_refused_samples_warn() -> None:
    scene = too_bright()
    with pytest.warns(vr.RefusedSamplesWarning) as warned:
        result = vr.render(scene, spp=4000, seed=3, device="cpu")
    count, (x, y, sample, *radiance) = (
        result.stats["nonfinite_samples"],
        result.stats["nonfinite"][0],
    )
    text = str(warned[0].message)
    assert text.startswith(f"{count:,} of 324,000 samples count as black")
    assert "2^20 times the largest radiance or more" in text
    assert f"--pixel {x} {y} --sample {sample} --seed 3" in text
    assert warned[0].filename == __file__
    path = vr.trace_path(scene, x, y, sample, seed=3)
    assert list(path[-1]["radiance"]) == radiance


def test_trace_path_agrees_with_the_film(cornell: vr.Scene) -> None:
    scene = cornell.with_(width=4, height=4)
    for x, y in ((0, 0), (3, 1), (2, 3)):
        path = vr.trace_path(scene, x, y, 0)
        assert [vertex["depth"] for vertex in path] == list(range(len(path)))
        assert all(vertex["event"] for vertex in path)
    for bad in ((4, 0, 0), (0, -1, 0), (0, 0, -1)):
        with pytest.raises(ValueError, match="is outside"):
            vr.trace_path(scene, *bad)


# Devices


def fake_native(usable: bool = True, reason: str = "", count: int = 1) -> Any:
    """A stand-in for a native module, enough to be chosen."""
    entry = {"name": "Fake", "memory_total": 2, "memory_free": 1}
    return SimpleNamespace(
        status=lambda: (usable, reason),
        build_info=lambda: {"isa": "sm", "lanes": 1},
        devices=lambda: [{**entry, "index": k} for k in range(count)],
    )


@pytest.fixture
def cuda(monkeypatch: pytest.MonkeyPatch) -> Callable[..., None]:
    """Puts a fake CUDA module in place, or with None takes it away."""

    def put(native: Any) -> None:
        monkeypatch.setitem(sys.modules, "veriray._cuda", native)
        monkeypatch.setattr(device_module, "_cuda_process", None)

    return put


def test_auto_takes_cuda_where_it_works(cuda: Callable[..., None]) -> None:
    cuda(fake_native(count=2))
    chosen, reason = device_module.select("auto")
    assert chosen.name == "cuda:0" and reason
    assert device_module.select("cuda:1")[0].index == 1
    with pytest.raises(vr.DeviceError, match="cuda:2 does not exist; .* cuda:0, cuda:1"):
        device_module.select("cuda:2")


def test_auto_says_why_not_cuda(cuda: Callable[..., None], caplog: Any) -> None:
    cuda(fake_native(False, "driver 12.2 is older than 13.0"))
    device_module._announce.cache_clear()
    with caplog.at_level(logging.INFO, logger="veriray"):
        for _ in range(3):
            chosen, reason = device_module.select("auto")
    assert chosen.backend == "cpu"
    assert "driver 12.2 is older than 13.0" in reason
    assert len(caplog.records) == 1 and reason in caplog.text
    with pytest.raises(vr.DeviceError, match="driver 12.2 is older than 13.0"):
        device_module.select("cuda")


def test_hidden_devices_are_named(cuda: Callable[..., None], monkeypatch: Any) -> None:
    cuda(fake_native(False, "no CUDA device"))
    monkeypatch.setenv("CUDA_VISIBLE_DEVICES", "")
    with pytest.raises(vr.DeviceError, match="CUDA_VISIBLE_DEVICES='' hides every device"):
        device_module.select("cuda:0")


def test_module_that_was_not_built(cuda: Callable[..., None], monkeypatch: Any) -> None:
    missing = device_module.importlib.import_module

    def import_module(name: str) -> Any:
        if name == "veriray._cuda":
            raise ModuleNotFoundError(name=name)
        return missing(name)

    monkeypatch.setattr(device_module.importlib, "import_module", import_module)
    with pytest.raises(vr.DeviceError, match="veriray._cuda was not built"):
        device_module.select("cuda")


def test_cuda_after_fork(cuda: Callable[..., None], monkeypatch: Any) -> None:
    cuda(fake_native())
    monkeypatch.setattr(device_module, "_cuda_process", -1)
    with pytest.raises(vr.DeviceError, match="before it was forked"):
        device_module.select("cuda")


def test_machine_code_that_the_processor_lacks_is_not_loaded(monkeypatch: Any) -> None:
    monkeypatch.setattr(device_module, "processor_flags", lambda: frozenset(["avx", "sse2"]))
    monkeypatch.delenv("VERIRAY_ISA", raising=False)
    with pytest.raises(vr.DeviceError, match="cpu:avx512: "):
        device_module.select("cpu:avx512")
    if find_spec("veriray._cpu") is None:  # VERIRAY_CPU=best, as `make` has it
        with pytest.raises(vr.DeviceError, match=r"veriray\._cpu was not built; build with V"):
            device_module.select("cpu")
        return
    chosen, reason = device_module.select("cpu")
    assert chosen.isa == "portable" and "portable" in reason


def test_isa_from_the_environment(monkeypatch: Any, cornell: vr.Scene, cpu: str) -> None:
    isa = cpu.removeprefix("cpu:")
    monkeypatch.setenv("VERIRAY_ISA", isa)
    stats = vr.render(cornell, 1, device="cpu").stats
    assert stats["device"] == cpu and f"VERIRAY_ISA={isa}" in stats["device_reason"]
    monkeypatch.setenv("VERIRAY_ISA", "sse9")
    with pytest.raises(ValueError, match="VERIRAY_ISA = 'sse9'; allowed: avx512, avx2, portable"):
        vr.render(cornell, 1, device="cpu")


def test_native_error_types_become_ours() -> None:
    theirs = type("DeviceError", (RuntimeError,), {})
    with pytest.raises(vr.DeviceError, match="lost"), device_module.native_errors():
        raise theirs("lost")
    with pytest.raises(KeyError), device_module.native_errors():
        raise KeyError("other")


def test_auto_takes_wavefront_where_it_pays(monkeypatch: pytest.MonkeyPatch) -> None:
    """The rule of `choose_scheduler`, on what scenes say of themselves."""
    monkeypatch.setattr(kernels, "available", lambda: "no compiler")
    many = RenderSettings(width=1024, height=1024, spp=16)
    balls = {
        "tree": {"width": 4}, "features": ["bvh", "diffuse"], "variant": ["bvh", "diffuse"],
        "primitives": {"spheres": 100, "triangles": 2, "dropped": 7}, "lights": 1,
    }  # fmt: skip
    mesh = {**balls, "primitives": {"triangles": 20_000, "dropped": 0}}
    rich = {**mesh, "variant": ["bvh", "blend", "tangents", "diffuse", "plastic"]}
    flat = {**rich, "tree": {}}
    mixed = {**flat, "features": ["diffuse", "plastic"]}

    def chosen(settings: RenderSettings = many, backend: str = "cuda", facts: Any = rich) -> str:
        return choose_scheduler(settings, backend, facts)[0]

    lamps = {**mesh, "lights": 100}
    assert {chosen(), chosen(facts=mixed), chosen(facts=lamps)} == {"wavefront"}
    assert {chosen(facts=mesh), chosen(facts=flat), chosen(backend="cpu")} == {"fused"}
    few = dataclasses.replace(many, width=512, height=256, spp=4)
    assert chosen(few) == "wavefront"
    few = dataclasses.replace(few, spp=3)
    by_batch = dataclasses.replace(few, spp=4, batches=2)
    until = dataclasses.replace(many, target_error=0.1)
    assert {chosen(few), chosen(by_batch), chosen(until)} == {"fused"}
    asked = dataclasses.replace(few, scheduler="thrust")
    assert choose_scheduler(asked, "cuda", rich) == ("thrust", "asked for")
    monkeypatch.setattr(kernels, "available", lambda: "")  # kernels are made at run time
    kinds = [*balls["features"], "conductor", "dielectric", "plastic"]
    by_measurement = {  # as measured, fused / wavefront
        "mesh under a lamp, 0.96": (mesh, "fused"),
        "two materials, 1.08": ({**mesh, "features": ["diffuse", "conductor"]}, "wavefront"),
        "100 lamps, 1.9": ({**mesh, "lights": 100}, "wavefront"),
        "16 lamps that are balls, 2": ({**balls, "lights": 16}, "wavefront"),
        "balls of four materials, 1.8": ({**balls, "features": kinds}, "wavefront"),
        "20 balls without a tree, 0.5": ({**balls, "tree": {}}, "fused"),
    }  # fmt: skip
    assert {k: chosen(facts=f) for k, (f, _) in by_measurement.items()} == {
        k: name for k, (_, name) in by_measurement.items()
    }
    short = dataclasses.replace(many, width=64, height=64)
    assert chosen(short, facts={**mesh, "lights": 100}) == "fused"
