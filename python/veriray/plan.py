"""What a render will do, settled before any work: its scene, its settings and its scheduler."""

from __future__ import annotations

import math
import operator
from typing import Any

from . import kernels
from .columns import MATERIAL_KINDS
from .features import PARTS
from .first_surface import check
from .light_groups import resolved
from .sampling import PILOTS
from .scene import Scene
from .settings import RenderSettings

#: Paths of one launch up to which a step's launches slow `wavefront`.
WAVE_PATHS = 1 << 24
#: Paths of one launch from which on `wavefront` is faster in the compiled variants that hold these.
RICH_PATHS, RICH = 1 << 19, {"blend", "tangents"}
#: The weights of the terms of `wave_gain`, in their order.
_FLAT = (-1.0, 0.5, 0.16, 0.2, 0.45, 0.43, -0.1, 0.0)
_IN_A_TREE = (-0.05, 0.27, 0.1, 0.15, 0.26, 0.22, -0.13, -0.2)
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
        beside = f"beside target_error = {settings.target_error:g}"
        least = PILOTS[str(settings.sampler)]
        if not least <= spp <= 2**31:
            raise ValueError(f"spp = {spp}; expected {least} to {2**31} {beside}")
        if batches:
            raise ValueError(f"batches = {batches}; expected 0 {beside}")
        if parts := [name for name in PARTS if name in settings.features]:
            raise ValueError(f"features: {', '.join(parts)} not together with target_error")
        if settings.light_groups:
            raise ValueError("light_groups: not together with target_error")
    if settings.light_groups:
        resolved(used, [*settings.light_groups])
    check(used, (*settings.features,), settings.motion_to)
    return used, settings


def wave_gain(facts: dict[str, Any], paths: int) -> float:
    """Logarithm of the expected time of `fused` over that of `wavefront` on CUDA.

    Both with kernels made for the scene. facts: those of `scene_facts`; paths: of one launch.
    Without a tree a fit to 59 scenes of 2^24 paths, 23 of them with 2^22 and 2^20 too (H200), with
    a root of the mean squared error of 0.22. In a tree one to 17 scenes of 2^24, 2^21 and 2^18
    (H200), of 0.09; the weight of media is from three meshes of glass around some. In one kernel,
    lanes wait for those at other materials, at more lamps or at other texels of the sky, and for
    walks through trees; a wave pays with traffic and launches.
    """
    features, primitives = {*facts["features"]}, dict(facts["primitives"])
    primitives.pop("dropped", None)
    terms = (
        1.0,
        float(primitives.get("spheres", 0) / max(1, sum(primitives.values()))),
        len({*MATERIAL_KINDS} & features) - 1,
        math.log(min(100, max(1, facts["lights"]))),
        bool({"image_sky", "guided_sky"} & features),
        bool(SLOW_IN_ONE_KERNEL & features),
        max(0.0, math.log2(WAVE_PATHS / max(1, paths))),
        "media" in features,
    )
    return float(sum(map(operator.mul, _IN_A_TREE if facts["tree"] else _FLAT, terms)))


def _pays(facts: dict[str, Any], paths: int) -> bool:
    """Whether `wavefront` is expected to be faster by 2 % in a tree, whose fit is closer, or 11."""
    return wave_gain(facts, paths) > (0.02 if facts["tree"] else math.log(10 / 9))


def compiled_choice(facts: dict[str, Any], paths: int) -> str:
    """The faster of `fused` and `wavefront` on CUDA without kernels made for the scene.

    One kernel for every feature has 218 registers: it takes 1.0 to 5.8 times as long as `wavefront`
    in a tree and, if there are several materials, without one (24 scenes of 2^21 and 2^24 paths,
    H100), but 0.7 to 1.1 times for one material without a tree. The other variants follow
    `wave_gain`.
    """
    if RICH & {*facts["variant"]}:
        several = len({*MATERIAL_KINDS} & {*facts["features"]}) > 1
        pays = paths >= RICH_PATHS and (bool(facts["tree"]) or several)
    else:
        pays = _pays(facts, paths)
    return "wavefront" if pays else "fused"


def choose_scheduler(
    settings: RenderSettings, backend: str, facts: dict[str, Any]
) -> tuple[str, str]:
    """The scheduler that runs and why. settings: settled; facts: those of `scene_facts`.

    Rule of "auto": `fused`, but `wavefront` on CUDA where it is expected to be faster, by 2 % in a
    tree and 11 % without one: by `wave_gain` with kernels made for the scene, and until these are
    there, or where none are made (`kernels`), by `compiled_choice`.
    """
    if settings.scheduler != "auto":
        return settings.scheduler, "asked for"
    width, height, spp = (getattr(settings, name) for name in ("width", "height", "spp"))
    paths = 0 if settings.target_error else width * height * spp // max(1, settings.batches)
    if backend != "cuda" or not paths:
        return "fused", "auto"
    if kernels.available():  # why there are none
        chosen = compiled_choice(facts, paths)
    else:
        chosen = "wavefront" if _pays(facts, paths) else "fused"
    if chosen == "fused":
        return chosen, "auto"
    return chosen, "auto expects it to be faster for such a scene"
