"""The native form of a scene: its arguments, the builder of its tree, and how long it is kept."""

from __future__ import annotations

import os
import threading
from collections.abc import Callable
from typing import TYPE_CHECKING, Any

import numpy as np

from .columns import COLUMNS
from .device import Device, polled
from .errors import SceneError
from .scene import Scene
from .settings import BUILDERS as BUILDERS

if TYPE_CHECKING:
    from ._native import Scene as NativeScene

#: Paths a triangle from which on a tree by `sah` saves more time on CUDA than it takes (an H200 and
#: 16 cores: scenario `build` of `veriray bench`).
CATCH_UP = 2000

_KEPT_PER_SCENE = 2
_building = threading.RLock()


def _new_lock() -> None:
    """Builds one tree at a time; a child process must not wait for a thread of its parent."""
    global _building
    _building = threading.RLock()  # a progress callback may render


if hasattr(os, "register_at_fork"):
    os.register_at_fork(after_in_child=_new_lock)


def native_scene_arguments(scene: Scene) -> dict[str, Any]:
    """The arguments arrays, camera and film of the native `Scene`; see `_native.pyi`."""
    camera, film = scene.camera, scene.film
    near, far = camera.clip_depths
    arrays = {name: getattr(scene, name) for name in COLUMNS}
    return {
        "arrays": {n: a.view(np.uint8) if a.dtype == np.bool_ else a for n, a in arrays.items()},
        "camera": {
            "to_world": camera.placed,
            "parallel": camera.projection == "orthographic",
            "tan_half_x": camera.tan_half_x(film.width, film.height),
            "tan_half_y": camera.tan_half_y(film.width, film.height),
            "near_clip": near,
            "far_clip": far,
            "principal_x": float(camera.principal_point_offset[0]),
            "principal_y": float(camera.principal_point_offset[1]),
            "aperture_radius": camera.aperture_radius,
            "focus_distance": camera.focus_distance,
            "hides_light": scene.hide_emitters,
            "medium": camera.medium,
        },
        "film": {
            "width": film.width,
            "height": film.height,
            "filter": film.filter,
            "filter_parameters": film.filter_parameters,
        },
    }


def choose_builder(backend: str, triangles: int, paths: int) -> str:
    """The builder that "auto" takes: `sah` on a CPU; on CUDA `ploc`, until `sah` pays.

    On CUDA a tree by `ploc` is built almost at once, and one by `sah` is traversed faster: from
    CATCH_UP paths per triangle on that is worth its build time, and below 2^14 triangles the build
    takes hardly any. `sah` is also taken if its tree exists already, or if the device has too
    little memory to build by `ploc`: 216 bytes more per primitive.
    """
    early = backend == "cuda" and triangles >= 1 << 14 and paths < CATCH_UP * triangles
    return "ploc" if early else "sah"


def native_scene(
    owner: Scene,
    scene: Scene,
    device: Device,
    progress: Callable[[float], object] | None = None,
    builder: str = "auto",
    spp: int = 1,
) -> NativeScene:
    """The native form of `scene`, kept by its owner, the user's object.

    progress, builder: as in `veriray.render`; spp: of the render that it is for.
    """
    width, height = scene.film.width, scene.film.height
    key = (device.native.__name__, device.index, width, height)
    with _building:
        kept: dict[tuple[object, ...], NativeScene] = owner.native_forms
        auto = builder == "auto"
        if auto:
            work = len(scene.triangles), width * height * spp
            builder = "sah" if (*key, "sah") in kept else choose_builder(device.backend, *work)
        found = kept.get((*key, builder))
        if found is None:
            while len(kept) >= _KEPT_PER_SCENE:
                kept.pop(next(iter(kept)))
            scene.hash_ahead()
            arguments = native_scene_arguments(scene)
            arguments |= {"device": device.index, "progress": polled(progress)}
            try:
                found = _make(scene, device, {**arguments, "builder": builder})
            except device.native.OutOfMemoryError:
                if not auto or builder == "sah":
                    raise
                builder = "sah"
                found = _make(scene, device, {**arguments, "builder": builder})
            kept.update({(*key, builder): found})
        return found


def _make(scene: Scene, device: Device, arguments: dict[str, Any]) -> NativeScene:
    try:
        made: NativeScene = device.native.Scene(**arguments)
        return made
    except ValueError as error:
        if error.__traceback__ is not None and error.__traceback__.tb_next is not None:
            raise  # of the progress callback
        raise SceneError(str(error), scene.place(str(error))) from None


def scene_facts(native: NativeScene) -> dict[str, Any]:
    """What a native scene says of itself, as plain data."""
    return {
        "features": [str(name) for name in native.features],
        "variant": [str(name) for name in native.variant],
        "path_bytes": int(native.path_bytes),
        "primitives": {str(k): int(v) for k, v in native.primitives.items()},
        "tree": dict(native.tree),
    }
