"""The native form of a scene: its arguments, the builder of its tree, and how long it is kept."""

from __future__ import annotations

import contextlib
import contextvars
import operator
import os
import threading
import weakref
from collections.abc import Callable, Iterator
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from .camera import Camera
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

#: Native forms that a device keeps of a scene and its copies, and families of them.
_KEPT_FORMS, _KEPT_PER_SCENE = 8, 2
_building = threading.RLock()
_rough = contextvars.ContextVar("rough", default=False)


def _new_lock() -> None:
    """Builds one tree at a time; a child process must not wait for a thread of its parent."""
    global _building
    _building = threading.RLock()  # a progress callback may render


if hasattr(os, "register_at_fork"):
    os.register_at_fork(after_in_child=_new_lock)


@contextlib.contextmanager
def roughly() -> Iterator[None]:
    """Within it, this thread's large scenes keep their tree wherever the camera goes in them, where
    one is kept. Rounding may then be more than of a scene made anew, so that pictures are for the
    eye alone: their bits may differ."""
    token = _rough.set(True)
    try:
        yield
    finally:
        _rough.reset(token)


def native_scene_arguments(scene: Scene) -> dict[str, Any]:
    """The arguments arrays, camera and film of the native `Scene`; see `_native.pyi`."""
    return {"arrays": _native_arrays(_arrays(scene)), **_view_arguments(scene)}


def _arrays(scene: Scene) -> dict[str, Any]:
    return {name: getattr(scene, name) for name in COLUMNS}


def _native_arrays(arrays: dict[str, Any]) -> dict[str, Any]:
    return {n: a.view(np.uint8) if a.dtype == np.bool_ else a for n, a in arrays.items()}


def _view_arguments(scene: Scene) -> dict[str, Any]:
    camera, film = scene.camera, scene.film
    near, far = camera.clip_depths
    return {
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
            "hides_light": scene.hides,
            "medium": camera.medium,
            "patches": camera.patches,
            "distant": camera.projection == "distant",
            **(_around_patches(camera) if camera.measures else {}),
        },
        "film": {
            "width": film.width,
            "height": film.height,
            "filter": film.filter,
            "filter_parameters": film.filter_parameters,
        },
    }


def _around_patches(camera: Camera) -> dict[str, Any]:
    """Of the native camera of a surface what is other than of others: it stands in its middle, and
    its aperture reaches around all of it."""
    centre, radius = camera.around
    to_world = np.array(camera.to_world)
    to_world[:3, 3] = centre
    clip = {"near_clip": 0.0, "far_clip": float("inf")}
    return {"to_world": to_world, "aperture_radius": radius, "focus_distance": 1.0, **clip}


def choose_builder(backend: str, triangles: int, paths: int) -> str:
    """The builder that "auto" takes: `sah` on a CPU; on CUDA `ploc`, until `sah` pays.

    paths: of this render and of those before it with the same tree. On CUDA a tree by `ploc` is
    built almost at once, and one by `sah` is traversed faster: from CATCH_UP paths per triangle on
    that is worth its build time, and below 2^14 triangles the build takes hardly any. `sah` is also
    taken if its tree exists already, or if the device has too little memory to build by `ploc`: 216
    bytes more per primitive.
    """
    early = backend == "cuda" and triangles >= 1 << 14 and paths < CATCH_UP * triangles
    return "ploc" if early else "sah"


_ARRAYS = ("to_world", "patches")  # of a camera


class NativeForm(NamedTuple):
    """A native scene and what it was made of. Forms of one family share primitives and tree."""

    place: tuple[str, int, str]  # module, device, builder
    arrays: dict[str, Any]
    view: dict[str, Any]  # camera and film, as the native scene takes them
    native: NativeScene
    scene: weakref.ref[Scene]  # the last one that it served; scenes do not change
    traced: list[int]  # one number for a family: the paths of the renders that it was for

    def shows(self, view: dict[str, Any]) -> bool:
        """Whether its camera and film are these."""
        own, other = self.view["camera"], view["camera"]
        return (
            self.view["film"] == view["film"]
            and all(own[name] == other[name] for name in own if name not in _ARRAYS)
            and all(np.array_equal(own[name], other[name]) for name in _ARRAYS)
        )


def native_scene(
    owner: Scene,
    scene: Scene,
    device: Device,
    progress: Callable[[float], object] | None = None,
    builder: str = "auto",
    spp: int = 1,
) -> NativeScene:
    """The native form of `scene`, kept by its owner, the user's object, and by copies of that.

    What a kept form has in common with the scene is not made again. progress, builder: as in
    `veriray.render`; spp: of the render that it is for.
    """
    where = device.native.__name__, device.index
    paths = scene.film.width * scene.film.height * spp
    with _building:
        kept: list[NativeForm] = owner.native_forms
        auto = builder == "auto"

        def wanted(traced: int) -> str:
            return choose_builder(device.backend, len(scene.triangles), traced + paths)

        for name in ("sah", "ploc") if auto else (builder,):
            for form in kept:
                if form.scene() is scene and form.place == (*where, name):
                    if auto and name == "ploc" and wanted(form.traced[0]) == "sah":
                        break  # which `_improve` makes
                    form.traced[0] += paths
                    return form.native
        arrays, view = _arrays(scene), _view_arguments(scene)
        found = _found(kept, where, arrays, view)
        if auto:
            if "ploc" in found and "sah" not in found:
                _improve(kept, found, device, progress, wanted)
            builder = next((name for name in ("sah", "ploc") if name in found), wanted(0))
        tried = [builder, "sah"] if auto and builder != "sah" else [builder]
        known = found.get(tried[0])
        if known is not None and known.shows(view):
            served = known._replace(scene=weakref.ref(scene))
            served.traced[0] += paths
            kept[:] = [*(other for other in kept if other is not known), served]
            return known.native
        del found, known  # which hold memory
        tried[:0] = tried[:1] * bool(kept)  # once more without them if the memory does not suffice
        for number, name in enumerate(tried):
            try:
                place = *where, name
                native, exact = _make(scene, device, progress, (place, arrays, view), kept)
                break
            except device.native.OutOfMemoryError:
                if number + 1 == len(tried):
                    raise
            kept.clear()
        if exact:
            family = (form.traced for form in kept if form.native.family == native.family)
            traced = next(family, [0])
            traced[0] += paths
            made = NativeForm(place, arrays, view, native, weakref.ref(scene), traced)
            kept[:] = _recent([*kept, made])
        return native


def _improve(
    kept: list[NativeForm],
    found: dict[str, NativeForm],
    device: Device,
    progress: Callable[[float], object] | None,
    wanted: Callable[[int], str],
) -> None:
    """Replaces a tree by `ploc` with one by `sah` once renders have paid for that."""
    old = found["ploc"]
    if _rough.get() or wanted(old.traced[0]) == "ploc":
        return
    try:
        native = old.native.rebuilt("sah", polled(progress))
    except device.native.OutOfMemoryError:
        old.traced[0] = -(1 << 62)  # not tried again
        return
    new = old._replace(place=(*old.place[:-1], "sah"), native=native)
    family = old.native.family
    kept[:] = [*(form for form in kept if form.native.family != family), new]
    found["sah"] = new


def _found(
    kept: list[NativeForm], where: tuple[str, int], arrays: dict[str, Any], view: dict[str, Any]
) -> dict[str, NativeForm]:
    """The forms of these very arrays by builder; those of this camera and film, where there are."""
    found: dict[str, NativeForm] = {}
    for form in kept:
        name = form.place[-1]
        if form.place[:-1] == where and all(
            map(operator.is_, form.arrays.values(), arrays.values())
        ):
            if name not in found or form.shows(view):
                found[name] = form
    return found


def _recent(forms: list[NativeForm], families: int = _KEPT_PER_SCENE) -> list[NativeForm]:
    """The last forms of each device, and of them those of its last families."""
    kept: set[int] = set()
    for place in {form.place[:-1] for form in forms}:
        there = [form for form in forms if form.place[:-1] == place][-_KEPT_FORMS:]
        known = list(dict.fromkeys(form.native.family for form in reversed(there)))[:families]
        kept |= {id(form) for form in there if form.native.family in known}
    return [form for form in forms if id(form) in kept]


def _make(
    scene: Scene,
    device: Device,
    progress: Callable[[float], object] | None,
    wanted: tuple[tuple[str, int, str], dict[str, Any], dict[str, Any]],
    kept: list[NativeForm],
) -> tuple[NativeScene, bool]:
    """A native scene with what it has in common with a kept one, or else made anew; whether it has
    the bits of one made anew."""
    place, arrays, view = wanted
    rough = _rough.get()
    try:
        families = {form.native.family: form for form in kept if form.place == place}
        beside = list(reversed(families.values()))
        for form in beside:
            pairs = zip(arrays.items(), form.arrays.values(), strict=True)
            other = _native_arrays({name: a for (name, a), old in pairs if a is not old})
            anew = form is beside[-1] and not rough  # of a small scene
            changed = form.native.changed(
                other, **view, rough=rough, device=device.index, builder=place[-1] if anew else ""
            )
            if changed is not None:
                return changed, not rough
        kept[:] = _recent(kept, _KEPT_PER_SCENE - 1)
        scene.hash_ahead()
        made: NativeScene = device.native.Scene(
            arrays=_native_arrays(arrays), **view, device=device.index,
            progress=polled(progress), builder=place[-1],
        )  # fmt: skip
        return made, True
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
        "lights": int(native.lights),
        "tree": dict(native.tree),
    }
