"""Rendering: the call, its checks and its statistics."""

from __future__ import annotations

import functools
import math
import os
from collections.abc import Callable, Iterator, Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor
from typing import Any, overload

from . import bars
from . import device as device_module
from .accumulation import Accumulation, Progress
from .camera import Camera
from .course import EVERY, Course
from .feature_rendering import beside
from .held import with_room
from .native_scene import native_scene, scene_facts
from .numeric import number, shown, whole
from .picture import LEDGER_COLUMNS as LEDGER_COLUMNS
from .picture import Render
from .plan import choose_scheduler as choose_scheduler
from .plan import settle as settle
from .scene import Scene
from .settings import COMPACTIONS as COMPACTIONS
from .settings import MAX_SPP, RenderSettings
from .settings import METHODS as METHODS
from .settings import SCHEDULERS as SCHEDULERS

BUILD_SHARE = 0.1
#: Of several cameras, so many pictures are rendered at a time on a GPU if they have fewer samples
#: than BRIEF: what a call costs beside the device's work overlaps with that of others.
AT_ONCE, BRIEF = 2, 1 << 24

_whole = functools.partial(whole, error=ValueError)


@overload
def render(
    scene: Scene,
    spp: int | None = None,
    seed: int = 0,
    device: str | Sequence[str] = "auto",
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
    features: str | tuple[str, ...] = (),
    feature_spp: int | None = None,
    light_groups: str | Sequence[str] | Mapping[str, Any] = (),
    motion_to: Camera | None = None,
    cluster: str = "",
    cameras: None = None,
    checkpoint: str | os.PathLike[str] | None = None,
    every: float = EVERY,
    time: float | None = None,
    on_pass: Callable[[Render], object] | None = None,
) -> Render: ...
@overload
def render(
    scene: Scene, *given: Any, cameras: Sequence[Camera], **settings: Any
) -> list[Render]: ...
def render(  # type: ignore[misc]  # the list of settings is that of the first
    scene: Scene,
    spp: int | None = None,
    seed: int = 0,
    device: str | Sequence[str] = "auto",
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
    features: str | tuple[str, ...] = (),
    feature_spp: int | None = None,
    light_groups: str | Sequence[str] | Mapping[str, Any] = (),
    motion_to: Camera | None = None,
    cluster: str = "",
    cameras: Sequence[Camera] | None = None,
    checkpoint: str | os.PathLike[str] | None = None,
    every: float = EVERY,
    time: float | None = None,
    on_pass: Callable[[Render], object] | None = None,
) -> Render | list[Render]:
    """Render a scene, or several views of it.

    The film depends on scene, spp, seed, max_depth, rr_depth, sampler, width, height and
    target_error alone: device, scheduler, builder, threads, batches and batch_size change the time
    taken, never a bit of the picture.

    Args:
        scene: from `load_file`, `load_dict` or `cornell_box`.
        spp: samples per pixel, 1 to 2^40; None takes the scene's.
        seed: 0 to 2^64 - 1.
        device: "auto", "cuda", "cuda:N", "cpu", "cpu:avx512", "cpu:avx2" or "cpu:portable"; or
            several, in a list or with commas between them, which render together
            (docs/clusters.md).
        scheduler: "fused", "thrust" (the 2016 report's), "thrust-none", "thrust-partition",
            "thrust-copy", "thrust-append" (see `COMPACTIONS`), "wavefront" (a launch for each stage
            of a bounce, hits sorted by material), "wavefront-unsorted" or "auto" (see
            `choose_scheduler`).
        max_depth: longest path in segments, as Mitsuba counts: 1 is emission alone, 2 adds direct
            light, -1 is unlimited; None takes the scene's.
        rr_depth: first depth of Russian roulette, >= 1; None takes the scene's.
        sampler: "sobol" (groups of 16 samples, each a scrambled net in every pair of numbers;
            cpp/core/sobol.h) or "independent". `stderr` is right on average; with sobol it is an
            upper estimate for feature images and below 64 samples. None takes the scene's, which
            is sobol.
        width, height: film size in pixels; None takes the scene's.
        threads: CPU threads, 1 to 1024; None takes all processors. Ignored on CUDA.
        batches: 0, or the number 2 to 1000 of equal sample ranges whose means are kept in
            `batch_means`; must divide spp. With sobol take a multiple of 16 samples for each
            (`Render.batch_means`).
        batch_size: paths in flight; 0 lets the back end choose. Sets memory, not the picture.
        progress: called on this thread about every 10 ms with the fraction done in [0, 1]; where a
            tree is built over a large mesh, that is the first tenth. An exception that it raises
            stops the render and propagates. True draws a bar (`veriray.bars`) on standard error or
            in the notebook: samples per pixel and a second, time left, memory, and at last the
            error.
        all_features: use the variant compiled for everything even if the scene needs less.
        target_error: None, or the relative standard error in (0, 1) at which tiles of 16 x 16
            pixels stop: adaptive sampling without bias (see `veriray.sampling`), of spp samples a
            pixel at most (at least 64, with independent 16). Not together with batches.
        builder: of the tree, where the scene needs one: "auto", "sah" or "ploc" (see
            `veriray.native_scene`).
        features: feature images of the first surface that the camera sees (`veriray.features`), in
            a tuple or with commas between them: "depth", "depth_axis", "position", "normal",
            "geo_normal", "albedo", "uv", "motion", "alpha", the numbers "object", "material",
            "primitive", and the parts "direct" and "indirect" of the picture.
        feature_spp: samples per pixel of feature images, the picture's first ones; None takes 8,
            or spp if that is less. Parts of the picture have all of its samples.
        light_groups: lamps by group, as {"key": "lamp_*", "fill": ["window", "sky"]}, texts
            "key=lamp_*" in a list or with commas between them, or "*" for a group of each lamp
            (`veriray.light_groups`): the feature images "light.key" and so on, each of which costs
            another picture; "light.rest" is of lamps in no group.
        motion_to: the second camera, of the feature "motion".
        cluster: "", or the address of a Ray cluster whose nodes render (docs/clusters.md): "auto",
            "local", "HOST:PORT" or "ray://HOST:PORT". device is then that of each node, and "auto"
            all its GPUs.
        cameras: None, or the cameras of several views, in place of the scene's: a list of renders,
            each as of `scene.with_(camera=camera)`. Geometry and tree are made once. Not together
            with checkpoint, time or on_pass.
        checkpoint: None, or a file that keeps the exact sums: if it exists the render goes on from
            it (docs/stop-and-go-on.md).
        every: about how many seconds lie between two writes of it; 0 writes after every sample per
            pixel.
        time: None, or the seconds of sampling after which the render ends with the picture that is
            there, after a whole pass.
        on_pass: called with the picture so far after each pass.

    Returns:
        Render, or with cameras a list of them, whose picture stays in the device's memory until it
        is asked for. Its stats:
        live_rays (rays per depth), ledger (column -> list, one entry per depth),
        blocks (thread blocks per depth), depth_seconds and of these compaction_seconds, rays,
        paths, seconds, samples_per_second, device, device_name, device_reason, scheduler (on CUDA
        "wavefront,fused" where the first drew until the scene's kernels were made),
        scheduler_reason, features (what the scene needs), variant (what the code that ran was
        compiled with), path_bytes (stored for each path in flight, in that code;
        `wavefront` stores its hit and shadow ray besides), kernel (of the
        one that traces paths on CUDA: registers and local_bytes of a thread, resident_threads on a
        multiprocessor; empty on a CPU), primitives (count by kind; dropped: triangles without
        area), lights (from which a light sample chooses), tree (builder, width, nodes, references,
        depth, cost: expected visits and tests of a line through its box, seconds, memory; empty
        without one), nonfinite_samples, nonfinite (at most 64 of [x, y, sample, r, g, b]), seed,
        spp, max_depth, rr_depth, sampler, width, height,
        batches, batch_size, threads, launches, memory (bytes of scene and film), filter,
        filter_parameter, scene_sha256, version, mean_stderr. With target_error also
        target_error, pilot_spp,
        first_sample (number of the picture's first sample), mean_spp, tiles, tiles_at_limit (which
        need more than spp), tiles_above_target and tile_error (median, nine tenths, largest) of the
        finished picture;
        paths and ledger then hold the pilot's too. Of a picture that was stopped also stopped
        ("time", "interrupted") and spp_asked. Of several devices, device, device_name and
        scheduler are lists with commas, what describes one device is of the first, seconds are
        those of the clock, threads, memory and the times of depths are sums, and devices has of
        each: device, device_name, device_reason, scheduler, scheduler_reason, threads, variant,
        kernel, memory, paths, seconds (of its own ranges); on a cluster of each node, with node
        (its name) and deaths (of its workers in a row).

    Raises:
        ValueError: an argument out of range (SceneError for those that belong to the scene).
        TypeError: `scene` is not a Scene.
        CheckpointError: the checkpoint is damaged, or one of another render; it stays as it is.
        DeviceError: the device cannot be used; the message says why.
        MissingPackageError: a cluster needs Ray.
        OutOfMemoryError, MemoryError: scene or film do not fit.
        KeyboardInterrupt: Ctrl-C; nothing is kept but the checkpoint, and the next render works.

    Warns:
        RefusedSamplesWarning: samples that the film cannot hold were left out; see
            stats["nonfinite"].
        CheckpointWarning: a checkpoint could not be written; the last one stays.
        DeviceWarning: one of several devices, or a node of a cluster, takes no part.
    """
    settings = RenderSettings(
        spp=spp, seed=seed, device=device, scheduler=scheduler, max_depth=max_depth,
        rr_depth=rr_depth, sampler=sampler, width=width, height=height, threads=threads,
        batches=batches, batch_size=batch_size, all_features=all_features,
        target_error=target_error, builder=builder, features=features, feature_spp=feature_spp,
        light_groups=light_groups, motion_to=motion_to, cluster=cluster,
    )  # fmt: skip
    number("every", every, 0, math.inf, error=ValueError)
    course = None
    if checkpoint is not None or time is not None or on_pass is not None:
        if cameras is not None:
            raise ValueError("cameras: not together with checkpoint, time or on_pass")
        course = Course(checkpoint=checkpoint, every=every, seconds=time, on_pass=on_pass)
    if cameras is None and progress is not True:
        return render_with(scene, settings, None if progress is False else progress, course)
    used, _ = settle(scene, settings)
    views = [scene] if cameras is None else _views(used, cameras)
    if progress is True and views:
        spp = used.spp * len(views) if target_error is None else 0  # 0: not known
        with bars.bar(used.film.width, used.film.height, spp) as bar:
            done = [render_with(*view, course) for view in _turns(views, settings, bar)]
            bar.done(done[-1].stats["mean_stderr"])
    else:
        callback = None if isinstance(progress, bool) else progress
        turns = _turns(views, settings, callback)
        if callback is None and len(views) > 1 and _brief(used, settings):
            with ThreadPoolExecutor(AT_ONCE) as pool:  # an exception cancels those that wait
                done = list(pool.map(lambda view: render_with(*view), turns))
        else:
            done = [render_with(*view) for view in turns]
    return done[0] if cameras is None else done


def _brief(used: Scene, settings: RenderSettings) -> bool:
    """Whether the device has a picture as soon as Python has prepared the next one."""
    if settings.target_error is not None or settings.cluster:
        return False
    chosen = device_module.select_all(settings.device, fresh=False)
    samples = used.film.width * used.film.height * used.spp
    return len(chosen) == 1 and chosen[0][0].backend == "cuda" and samples < BRIEF


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
    scene: Scene,
    settings: RenderSettings,
    progress: Callable[[float], object] | None = None,
    course: Course | None = None,
) -> Render:
    """As `render`, with its settings as one object."""
    if progress is not None and not callable(progress):
        raise ValueError(f"progress = {shown(progress)} is not callable")
    building, sampling = _shares(progress)
    alone = course is None and not settings.batches and settings.target_error is None
    work = Accumulation._of(scene, settings, building, last=alone and not settings.cluster)
    used = work.settings
    if course is None and used.cluster:
        course = Course()  # whose passes bound what a worker's death costs
    try:
        return _finished(work, scene, progress, sampling, course)
    finally:
        work.close()


def _finished(
    work: Accumulation,
    scene: Scene,
    progress: Progress,
    sampling: Progress,
    course: Course | None,
) -> Render:
    """The render of all samples, or of those that there are when it is stopped."""
    stopped, used = "", work.settings
    if course is None:
        while n := work.left:
            work.add(n, of_all(work, n, sampling))
    else:
        course.resume(work)
        stopped = course.run(work, lambda n: of_all(work, n, sampling))
    made = work._render(5)
    if stopped:
        made.stats.update(stopped=stopped, spp_asked=used.spp)
        used = used.with_checked({"spp": made.spp, "batches": 0, "target_error": None})
    if used.features or used.light_groups:
        try:
            if course is not None and course.on_stop is not None and stopped == "interrupted":
                course.on_stop(made)
            made.__dict__["features"] = beside(made, scene, work._scene, used)
        except KeyboardInterrupt:
            if course is None or not course.keeps:
                raise
            made.stats.update(stopped="interrupted", spp_asked=work.settings.spp)
    if progress is not None:
        progress(1.0)
    return made


def of_all(work: Accumulation, n: int, progress: Progress) -> Progress:
    """A callback for a pass of n samples per pixel that reports the fraction of the whole."""
    if progress is None:
        return None
    done, paths = work.paths, work.paths_of(n)
    ahead = float(done + work.paths_left)
    return lambda share: progress(min((done + share * paths) / ahead, 1.0))


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


def prepare(
    scene: Scene,
    device: str | Sequence[str] = "auto",
    width: int | None = None,
    height: int | None = None,
    progress: Callable[[float], object] | None = None,
    builder: str = "auto",
    spp: int | None = None,
) -> dict[str, Any]:
    """Build what devices need of a scene, a tree for example, and keep it for a render of `spp`.

    progress: as in `render`, for the build alone; builder, spp: as there. Returns features,
    variant, path_bytes, primitives, tree (see `render`) and memory (bytes of the scene). Raises as
    `render`; OutOfMemoryError if all of the devices lack memory.
    """
    settings = RenderSettings(spp=spp, device=device, width=width, height=height, builder=builder)
    used, settings = settle(scene, settings)
    with device_module.native_errors():
        natives, short = [], None
        for chosen, _ in device_module.select_all(settings.device):
            build = functools.partial(
                native_scene, scene, used, chosen, progress, builder, used.spp
            )
            try:
                natives.append(with_room(chosen, build))
            except MemoryError as error:  # the render goes on without it, and says so
                short = error
        if short is not None and not natives:
            raise short
        memory = sum({id(native): int(native.memory) for native in natives}.values())
        return {**scene_facts(natives[0]), "memory": memory}


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
