"""Feature images, without a picture and beside one."""

from __future__ import annotations

import contextlib
from collections.abc import Callable
from typing import Any

import numpy as np

from . import device as device_module
from .accumulation import Accumulation
from .camera import Camera
from .features import OF_SURFACES, PARTS, SPP, FeatureImages
from .first_surface import look
from .light_groups import alone, resolved
from .numeric import shown, whole
from .picture import Render
from .plan import settle
from .sampling import first_sample
from .scene import Scene
from .settings import MAX_SPP, SETTINGS, RenderSettings


def feature_images(
    scene: Scene,
    names: str | tuple[str, ...] = ("depth", "normal", "albedo"),
    spp: int = SPP,
    seed: int = 0,
    device: str = "auto",
    sampler: str | None = None,
    width: int | None = None,
    height: int | None = None,
    threads: int | None = None,
    motion_to: Camera | None = None,
    progress: Callable[[float], object] | None = None,
) -> FeatureImages:
    """Feature images of a scene without a picture; `veriray.features` says what each of them is.

    The same bits on every device.

    Args:
        scene: from `load_file`, `load_dict` or `cornell_box`.
        names: of `veriray.features.OF_SURFACES`, as a tuple or with commas between them.
        spp: samples per pixel, 1 to 2^40; numbers are of one ray, whatever it is.
        seed, device, sampler, width, height, threads, progress: as of `veriray.render`.
        motion_to: the second camera, of "motion".

    Raises as `veriray.render`.
    """
    wanted: tuple[str, ...] = SETTINGS["features"].checked("names", names, ValueError)
    settings = RenderSettings(
        spp=whole("spp", spp, 1, MAX_SPP, error=ValueError), seed=seed, device=device,
        sampler=sampler, width=width, height=height, threads=threads, features=wanted,
        motion_to=motion_to,
    )  # fmt: skip
    if wrong := [name for name in wanted if name in PARTS]:
        raise ValueError(
            f"names: {', '.join(wrong)} are parts of a picture: render(scene, features=...)"
        )
    if progress is not None and not callable(progress):
        raise ValueError(f"progress = {shown(progress)} is not callable")
    if not wanted:
        raise ValueError(f"names = {shown(names)} is empty; allowed: {', '.join(OF_SURFACES)}")
    used, settings = settle(scene, settings)
    chosen, _ = device_module.select(device, fresh=False)
    with device_module.native_errors():
        return look(chosen, scene, used, wanted, used.spp, settings.native(),
                    motion_to, progress)  # fmt: skip


def beside(render: Render, scene: Scene, used: Scene, settings: RenderSettings) -> FeatureImages:
    """The feature images that a picture's settings ask for; used, settings: those that it ran with,
    of `scene`."""
    names = (*settings.features,)
    spp = min(SPP, render.spp) if settings.feature_spp is None else settings.feature_spp
    made = FeatureImages(spp=spp)
    if of_surfaces := tuple(name for name in names if name not in PARTS):
        drew = settings.device if settings.cluster else str(render.stats["device"])
        chosen, _ = device_module.select_all(drew, fresh=False)[0]
        begin = 0 if settings.target_error is None else first_sample(used.spp)
        with device_module.native_errors():
            made = look(chosen, scene, used, of_surfaces, spp, settings.native(),
                        settings.motion_to, begin=begin)  # fmt: skip
    depth = used.max_depth
    if "direct" in names:
        made._add("direct", _part(scene, settings, max_depth=min(2, depth) if depth >= 0 else 2))
    if "indirect" in names:
        far = scene._with_arrays(muted_segments=np.maximum(scene.muted_segments, 2))
        made._add("indirect", _part(far, settings))
    if settings.light_groups:
        groups = resolved(used, [*settings.light_groups])
        for group, shining in groups.items():
            part = _part(alone(scene, shining), settings)
            made._add(f"light.{group}", part, [lamp.names[0] for lamp in shining])
    return made


def _part(scene: Scene, settings: RenderSettings, **changes: Any) -> Render:
    """Another picture with the same samples."""
    plain = {"batches": 0, "features": (), "light_groups": (), "motion_to": None, **changes}
    once = settings.target_error is None
    work = Accumulation._of(scene, settings.with_checked(plain), None, last=once)
    with contextlib.closing(work):
        while work.left:
            work.add(work.left)
        return work._render()
