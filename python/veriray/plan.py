"""What a render will do, settled before any work: its scene, its settings and its scheduler."""

from __future__ import annotations

from typing import Any

from . import kernels
from .columns import MATERIAL_KINDS, SCATTERING_KINDS
from .first_surface import check
from .sampling import PILOT
from .scene import Scene
from .settings import RenderSettings

#: Paths of one launch from which `wavefront` pays for scenes that it suits (`choose_scheduler`).
WAVE_PATHS = 1 << 24
#: Features whose code makes one kernel for everything slow.
SLOW_IN_ONE_KERNEL = {"uneven_media", "principled", "principled_open"} | {
    name for name in MATERIAL_KINDS if name.startswith("rough")
}


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
        if {"direct", "indirect"} & {*settings.features}:
            raise ValueError(f"features = {settings.features}; with target_error no parts")
    check(used, (*settings.features,))
    if "motion" in settings.features:
        raise ValueError('features: "motion" needs a second camera: veriray.feature_images')
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
