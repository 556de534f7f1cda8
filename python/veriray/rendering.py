"""Rendering: the call, its checks and its statistics."""

from __future__ import annotations

import functools
import math
import warnings
from collections.abc import Callable, Iterator, Sequence
from typing import TYPE_CHECKING, Any, overload

import numpy as np
import numpy.typing as npt

from . import bars, kernels
from . import device as device_module
from .camera import Camera
from .columns import MATERIAL_KINDS, SCATTERING_KINDS
from .errors import RefusedSamplesWarning
from .native_scene import native_scene, scene_facts
from .numeric import shown, whole
from .picture import LEDGER_COLUMNS, Render
from .sampling import PILOT, Progress, adaptive, uniform, with_room
from .scene import Scene
from .settings import COMPACTIONS as COMPACTIONS
from .settings import MAX_SPP, RenderSettings
from .settings import METHODS as METHODS
from .settings import SCHEDULERS as SCHEDULERS

MAX_NONFINITE = 64
BUILD_SHARE = 0.1
#: Paths of one launch from which `wavefront` pays for scenes that it suits (`choose_scheduler`).
WAVE_PATHS = 1 << 24
#: Features whose code makes one kernel for everything slow.
SLOW_IN_ONE_KERNEL = {"uneven_media", "principled", "principled_open"} | {
    name for name in MATERIAL_KINDS if name.startswith("rough")
}

if TYPE_CHECKING:
    from ._native import Report

Array = npt.NDArray[Any]
_whole = functools.partial(whole, error=ValueError)


@overload
def render(
    scene: Scene,
    spp: int | None = None,
    seed: int = 0,
    device: str = "auto",
    scheduler: str = "auto",
    max_depth: int | None = None,
    rr_depth: int | None = None,
    sampler: str | None = None,
    width: int | None = None,
    height: int | None = None,
    threads: int | None = None,
    batches: int = 0,
    batch_size: int = 0,
    progress: Callable[[float], object] | bool | None = None,
    all_features: bool = False,
    target_error: float | None = None,
    builder: str = "auto",
    cameras: None = None,
) -> Render: ...
@overload
def render(
    scene: Scene, *given: Any, cameras: Sequence[Camera], **settings: Any
) -> list[Render]: ...
def render(  # type: ignore[misc]  # the list of settings is that of the first
    scene: Scene,
    spp: int | None = None,
    seed: int = 0,
    device: str = "auto",
    scheduler: str = "auto",
    max_depth: int | None = None,
    rr_depth: int | None = None,
    sampler: str | None = None,
    width: int | None = None,
    height: int | None = None,
    threads: int | None = None,
    batches: int = 0,
    batch_size: int = 0,
    progress: Callable[[float], object] | bool | None = None,
    all_features: bool = False,
    target_error: float | None = None,
    builder: str = "auto",
    cameras: Sequence[Camera] | None = None,
) -> Render | list[Render]:
    """Render a scene, or several views of it.

    The film depends on scene, spp, seed, max_depth, rr_depth, sampler, width, height and
    target_error alone: device, scheduler, builder, threads, batches and batch_size change the time
    taken, never a bit of the picture.

    Args:
        scene: from `load_file`, `load_dict` or `cornell_box`.
        spp: samples per pixel, 1 to 2^40; None takes the scene's.
        seed: 0 to 2^64 - 1.
        device: "auto", "cuda", "cuda:N", "cpu", "cpu:avx512", "cpu:avx2" or "cpu:portable".
        scheduler: "fused", "thrust" (the 2016 report's), "thrust-none", "thrust-partition",
            "thrust-copy", "thrust-append" (see `COMPACTIONS`), "wavefront" (a launch for each stage
            of a bounce, hits sorted by material), "wavefront-unsorted" or "auto" (see
            `choose_scheduler`).
        max_depth: longest path in segments, as Mitsuba counts: 1 is emission alone, 2 adds direct
            light, -1 is unlimited; None takes the scene's.
        rr_depth: first depth of Russian roulette, >= 1; None takes the scene's.
        sampler: "independent" or "sobol" (Owen-scrambled, padded pairs; Burley 2020), which lowers
            the error of pictures with many samples; its `stderr` is that of as many independent
            samples, an upper estimate. None takes the scene's.
        width, height: film size in pixels; None takes the scene's.
        threads: CPU threads, 1 to 1024; None takes all processors. Ignored on CUDA.
        batches: 0, or the number 2 to 1000 of equal sample ranges whose means are kept in
            `batch_means`; must divide spp.
        batch_size: paths in flight; 0 lets the back end choose. Sets memory, not the picture.
        progress: called on this thread about every 50 ms with the fraction done in [0, 1]; where a
            tree is built over a large mesh, that is the first tenth. An exception that it raises
            stops the render and propagates. True draws a bar (`veriray.bars`) on standard error or
            in the notebook: samples per pixel and a second, time left, memory, and at last the
            error.
        all_features: use the variant compiled for everything even if the scene needs less.
        target_error: None, or the relative standard error in (0, 1) at which tiles of 16 x 16
            pixels stop: adaptive sampling without bias (see `veriray.sampling`), of spp samples a
            pixel at most (at least 16). Not together with batches.
        builder: of the tree, where the scene needs one: "auto", "sah" or "ploc" (see
            `veriray.native_scene`).
        cameras: None, or the cameras of several views, in place of the scene's: a list of renders,
            each as of `scene.with_(camera=camera)`. Geometry and tree are made once.

    Returns:
        Render, or with cameras a list of them, whose picture stays in the device's memory until it
        is asked for. Its stats:
        live_rays (rays per depth), ledger (column -> list, one entry per depth),
        blocks (thread blocks per depth), depth_seconds and of these compaction_seconds, rays,
        paths, seconds, samples_per_second, device, device_name, device_reason, scheduler,
        scheduler_reason, features (what the scene needs), variant (what the code that ran was
        compiled with), path_bytes (stored for each path in flight, in that code;
        `wavefront` stores its hit and shadow ray besides), kernel (of the
        one that traces paths on CUDA: registers and local_bytes of a thread, resident_threads on a
        multiprocessor; empty on a CPU), primitives (count by kind; dropped: triangles without
        area), tree (builder, width, nodes, references, depth, cost: expected visits and tests of a
        line through its box, seconds, memory; empty without one), nonfinite_samples, nonfinite (at
        most 64 of [x, y, sample, r, g, b]), seed, spp, max_depth, rr_depth, sampler, width, height,
        batches, batch_size, threads, launches, memory (bytes of scene and film), scene_sha256,
        version, mean_stderr. With target_error also target_error, pilot_spp, first_sample (number
        of the picture's first sample), mean_spp, tiles, tiles_at_limit (which need more than spp),
        tiles_above_target and tile_error (median, nine tenths, largest) of the finished picture;
        paths and ledger then hold the pilot's too.

    Raises:
        ValueError: an argument out of range (SceneError for those that belong to the scene).
        TypeError: `scene` is not a Scene.
        DeviceError: the device cannot be used; the message says why.
        OutOfMemoryError, MemoryError: scene or film do not fit.
        KeyboardInterrupt: Ctrl-C; nothing is kept, and the next render works.

    Warns:
        RefusedSamplesWarning: samples that the film cannot hold were left out; see
            stats["nonfinite"].
    """
    settings = RenderSettings(
        spp=spp, seed=seed, device=device, scheduler=scheduler, max_depth=max_depth,
        rr_depth=rr_depth, sampler=sampler, width=width, height=height, threads=threads,
        batches=batches, batch_size=batch_size, all_features=all_features,
        target_error=target_error, builder=builder,
    )  # fmt: skip
    if cameras is None and progress is not True:
        return render_with(scene, settings, None if progress is False else progress)
    used, _ = settle(scene, settings)
    views = [scene] if cameras is None else _views(used, cameras)
    if progress is True and views:
        with bars.bar(used.film.width, used.film.height, used.spp * len(views)) as bar:
            done = [render_with(*view) for view in _turns(views, settings, bar)]
            bar.done(done[-1].stats["mean_stderr"])
    else:
        callback = None if isinstance(progress, bool) else progress
        done = [render_with(*view) for view in _turns(views, settings, callback)]
    return done[0] if cameras is None else done


def _views(scene: Scene, cameras: Sequence[Camera]) -> list[Scene]:
    """The scene with each of the cameras; they share its geometry."""
    if isinstance(cameras, (Camera, str)) or not isinstance(cameras, Sequence):
        raise TypeError(f"cameras is {type(cameras).__name__}, expected a list of Camera")
    for k, camera in enumerate(cameras):
        if not isinstance(camera, Camera):
            raise TypeError(f"cameras[{k}] is {type(camera).__name__}, expected Camera")
    return [scene.with_(camera=camera) for camera in cameras]


def _turns(
    views: list[Scene], settings: RenderSettings, progress: Progress
) -> Iterator[tuple[Scene, RenderSettings, Progress]]:
    """The arguments of `render_with` for each view, with a share of a common progress."""
    for k, view in enumerate(views):

        def part(fraction: float, k: int = k) -> None:
            assert progress is not None
            progress((k + fraction) / len(views))

        yield view, settings, part if callable(progress) and len(views) > 1 else progress


def render_with(
    scene: Scene, settings: RenderSettings, progress: Callable[[float], object] | None = None
) -> Render:
    """As `render`, with its settings as one object."""
    used, settings = settle(scene, settings)
    if progress is not None and not callable(progress):
        raise ValueError(f"progress = {shown(progress)} is not callable")
    chosen, device_reason = device_module.select(settings.device, fresh=False)
    with device_module.native_errors():
        building, sampling = _shares(progress)
        native = with_room(
            chosen,
            lambda: native_scene(scene, used, chosen, building, settings.builder, used.spp),
        )
        facts = scene_facts(native)
        scheduler, scheduler_reason = choose_scheduler(settings, chosen.backend, facts)
        settings = settings.with_checked({"scheduler": scheduler, "device": chosen.name})
        if chosen.backend == "cuda" and not settings.all_features:
            paths = used.film.width * used.film.height * used.spp
            kernels.offer(chosen, native, scheduler, paths)
        run = (chosen, native, used, settings.native(), sampling)
        if settings.target_error is None:
            done = uniform(*run, settings.batches)
        else:
            done = adaptive(*run, settings.target_error)
        memory = int(native.memory) + int(done.memory)
    if progress is not None:
        progress(1.0)
    stats = _statistics(done.results, done.paths)
    error = float(done.picture.mean_stderr)
    stats |= {
        "device_name": chosen.description,
        "device_reason": device_reason,
        "scheduler_reason": scheduler_reason,
        **facts,
        "variant": [str(name) for name in done.results[-1]["features"]],
        "path_bytes": int(done.results[-1]["path_bytes"]),
        "kernel": {str(k): int(v) for k, v in done.results[-1]["kernel"].items()},
        **settings.kept(),
        "memory": memory,
        "scene_sha256": used.sha256,
        "version": _version(),
        "mean_stderr": error if math.isfinite(error) else None,
        **done.facts,
    }
    if stats["nonfinite_samples"]:
        warnings.warn(_refused_text(stats), RefusedSamplesWarning, stacklevel=3)
    return Render._of(
        done.picture,
        batch_means=done.batch_means,
        stats=stats,
        width=used.film.width,
        height=used.film.height,
        spp=used.spp,
        seed=settings.seed,
        samples=done.counts,
    )


def settle(scene: Scene, settings: RenderSettings) -> tuple[Scene, RenderSettings]:
    """The scene with those settings that belong to it, and all settings with the scene's.

    Raises as `render` does, before any work is done.
    """
    if not isinstance(scene, Scene):
        raise TypeError(
            f"scene is {type(scene).__name__}, expected a Scene: use veriray.load_file(path) or "
            "veriray.load_dict(dict)"
        )
    given = settings.of_scene()
    plain = all(value is None or type(value) in (int, str) for value in given.values())
    # Kept on the scene: a table with weak keys would lose interrupts in its callbacks.
    last = scene.__dict__.get("_settled") if plain else None
    if last is None or last[0] != given:
        last = given, scene.with_(**given)
        if plain:
            scene.__dict__["_settled"] = last
    used = last[1]
    values = {
        name: getattr(used.film if hasattr(used.film, name) else used, name) for name in given
    }
    settings = settings.with_checked(values)
    spp, batches = used.spp, settings.batches
    if batches == 1 or (batches and spp % batches):
        raise ValueError(f"batches = {batches}; expected 0 or a divisor of spp = {spp} above 1")
    if settings.target_error is not None:
        if not PILOT <= spp <= 2**31:
            raise ValueError(f"spp = {spp}; with target_error {PILOT} to {2**31}")
        if batches:
            raise ValueError(f"batches = {batches}; with target_error 0")
    return used, settings


def choose_scheduler(
    settings: RenderSettings, backend: str, facts: dict[str, Any]
) -> tuple[str, str]:
    """The scheduler that runs and why. settings: settled; facts: those of `scene_facts`.

    Rule of "auto": `fused`, but `wavefront` on CUDA from WAVE_PATHS paths per launch on, for scenes
    with a tree and a material that is not made of delta lobes, if they have rough surfaces, uneven
    media or more than two kinds of material; without kernels made at run time (`kernels`), if
    several kinds are in the compiled variant, whose one kernel is then slow (docs/speed.md).
    """
    if settings.scheduler != "auto":
        return settings.scheduler, "asked for"
    width, height, spp = (getattr(settings, name) for name in ("width", "height", "spp"))
    paths = 0 if settings.target_error else width * height * spp // max(1, settings.batches)
    features = {*facts["features"]}
    if backend == "cuda" and not kernels.available():
        slow = features & SLOW_IN_ONE_KERNEL or len({*MATERIAL_KINDS} & features) > 2
    else:
        slow = len({*MATERIAL_KINDS} & {*facts["variant"]}) > 1
    suits = facts["tree"] and slow and {*SCATTERING_KINDS} & features
    if backend == "cuda" and suits and paths >= WAVE_PATHS:
        return "wavefront", "auto takes it for many paths among such materials in a tree"
    return "fused", "auto"


def _shares(progress: Progress) -> tuple[Progress, Progress]:
    """Callbacks for building and sampling; building is the first BUILD_SHARE if it reports."""
    if progress is None:
        return None, None
    start = 0.0

    def building(fraction: float) -> None:
        nonlocal start
        start = BUILD_SHARE
        progress(BUILD_SHARE * min(fraction, 1.0))

    def sampling(fraction: float) -> None:
        progress(min(start + (1.0 - start) * fraction, 1.0))

    return building, sampling


def _statistics(results: list[Report], paths: int) -> dict[str, Any]:
    """Sums the pieces' reports."""
    ledger, blocks, by_depth, closing = (
        _padded_sum([r[name] for r in results])
        for name in ("ledger", "blocks", "depth_seconds", "compaction_seconds")
    )
    if ledger.ndim == 2:
        columns = dict(zip(LEDGER_COLUMNS, ledger.T.tolist(), strict=True))
    else:
        columns = {name: [] for name in LEDGER_COLUMNS}
    seconds = float(sum(r["seconds"] for r in results))
    nonfinite = [list(entry) for r in results for entry in r["nonfinite"]]
    return {
        "live_rays": columns["live"],
        "ledger": columns,
        "blocks": blocks.tolist(),
        "depth_seconds": by_depth.tolist(),
        "compaction_seconds": closing.tolist(),
        "rays": sum(columns["live"] + columns["shadow_visible"] + columns["shadow_occluded"]),
        "paths": paths,
        "seconds": seconds,
        "samples_per_second": paths / seconds if seconds > 0 else 0.0,
        "nonfinite_samples": sum(int(r["nonfinite_samples"]) for r in results),
        "nonfinite": nonfinite[:MAX_NONFINITE],
        "launches": sum(int(r["launches"]) for r in results),
        "threads": int(results[-1]["threads"]),
    }


def _refused_text(stats: dict[str, Any]) -> str:
    """How many samples the film refused, why, and how to see one again."""

    def reason(radiance: list[float]) -> str:
        if any(math.isnan(x) for x in radiance):
            return "not a number"
        if any(math.isinf(x) for x in radiance):
            return "infinite"
        return "negative" if min(radiance) < 0 else "2^20 times the largest radiance or more"

    listed = stats["nonfinite"]
    text = f"{stats['nonfinite_samples']:,} of {stats['paths']:,} samples count as black: the film "
    if not listed:
        return text + "cannot hold them"
    reasons = [reason(entry[3:]) for entry in listed]
    counts = ", ".join(f"{reasons.count(name)} {name}" for name in dict.fromkeys(reasons))
    x, y, sample = listed[0][:3]
    return (
        f"{text}cannot hold them (of the {len(listed)} listed: {counts}); replay one with --pixel "
        f"{x} {y} --sample {sample} --seed {stats['seed']}, in Python trace_path(scene, {x}, {y}, "
        f"{sample}, seed={stats['seed']}), and this picture's size, depths and sampler"
    )


def _padded_sum(arrays: list[Array]) -> Array:
    """Sum along axis 0 of arrays whose lengths differ; short ones are padded with zeros."""
    if len(arrays) == 1:
        return arrays[0]
    longest = max(arrays, key=len)
    total = np.zeros_like(longest)
    for array in arrays:
        if len(array):
            total[: len(array)] += array
    return total


def prepare(
    scene: Scene,
    device: str = "auto",
    width: int | None = None,
    height: int | None = None,
    progress: Callable[[float], object] | None = None,
    builder: str = "auto",
    spp: int | None = None,
) -> dict[str, Any]:
    """Build what a device needs of a scene, a tree for example, and keep it for a render of `spp`.

    progress: as in `render`, for the build alone; builder, spp: as there. Returns features,
    variant, path_bytes, primitives, tree (see `render`) and memory (bytes of the scene). Raises as
    `render`.
    """
    settings = RenderSettings(spp=spp, device=device, width=width, height=height, builder=builder)
    used, _ = settle(scene, settings)
    chosen, _ = device_module.select(device)
    with device_module.native_errors():
        native = native_scene(scene, used, chosen, progress, builder, used.spp)
        return {**scene_facts(native), "memory": int(native.memory)}


def trace_path(
    scene: Scene,
    x: int,
    y: int,
    sample: int,
    *,
    seed: int = 0,
    max_depth: int | None = None,
    rr_depth: int | None = None,
    sampler: str | None = None,
    width: int | None = None,
    height: int | None = None,
) -> list[dict[str, Any]]:
    """Replay one path of a render on the CPU, vertex by vertex.

    Gives the path that `render` with the same scene, seed, sampler, size and depths traced for
    sample number `sample` (from 0) of pixel (x, y), top left (0, 0). Raises ValueError for a pixel
    outside the film, and otherwise as `render`.
    """
    settings = RenderSettings(
        seed=seed, max_depth=max_depth, rr_depth=rr_depth, sampler=sampler, width=width,
        height=height,
    )  # fmt: skip
    used, settings = settle(scene, settings)
    x = _whole("x", x, 0, used.film.width - 1)
    y = _whole("y", y, 0, used.film.height - 1)
    sample = _whole("sample", sample, 0, MAX_SPP - 1)
    chosen, _ = device_module.select("cpu")
    with device_module.native_errors():
        path: list[dict[str, Any]] = chosen.native.trace_path(
            native_scene(scene, used, chosen), x=x, y=y, sample=sample, **settings.native(path=True)
        )
    return path


def _version() -> str:
    from . import __version__

    return __version__
