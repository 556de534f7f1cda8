"""The scene: plain arrays in world units, with camera, film and render settings.

Conventions are Mitsuba 3's: right-handed, 4x4 matrices act on column vectors, a camera looks along
its local +Z with local +X on the left of the picture, pixel (0, 0) is top left.
"""

from __future__ import annotations

import contextlib
import dataclasses
import functools
import hashlib
import os
import re
import threading
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
import numpy.typing as npt

from . import parameters, showing
from .camera import Camera, Film
from .columns import COLUMNS, LIGHT_KINDS, TEXTURE_KINDS, checked, hashed
from .errors import SceneError
from .numeric import (
    MAX_COORDINATE,
    array,
    distinct,
    in_range,
    number,
    path_text,
    repeated,
    restore,
    shown,
    switch,
    texts,
    whole,
)  # fmt: skip
from .scene_arrays import _NONE, SceneArrays
from .settings import MAX_PATH_DEPTH as MAX_PATH_DEPTH
from .settings import SAMPLERS as SAMPLERS
from .settings import SETTINGS
from .shipped import SHIPPED, find_shipped

if TYPE_CHECKING:
    from .formats.build import Built
    from .native_scene import NativeForm

Array = npt.NDArray[Any]

_DERIVED = ("_hashes", "_sha256", "_native_forms", "_settled")


#: Bytes of arrays that take a good part of a frame's time to hash.
_LARGE = 1 << 18


class _Hashes:
    """The hash of a scene's arrays after each of the first columns, as far as known.

    maker: the thread that makes it. first: of a scene with the same first `same` columns.
    """

    def __init__(self, first: _Hashes | None = None, same: int = 0) -> None:
        self.made: list[hashlib._Hash] = []
        self.maker: threading.Thread | None = None
        if first is not None and first.first is not None and not first.made:
            first, same = first.first, min(same, first.same)
        self.first: _Hashes | None = first
        self.same: int = same

    def known(self) -> list[hashlib._Hash]:
        """Those that are known."""
        first = self.first
        return self.made or (first.known()[: self.same] if first else [])

    def makers(self) -> list[threading.Thread]:
        """Threads that work, or worked, on what this needs."""
        return [cell.maker for cell in (self, self.first) if cell and cell.maker]

    def keep(self, made: list[hashlib._Hash]) -> None:
        """Takes all of them, and tells `first` what it may not know; no longer needs it."""
        first = self.first
        if first is not None and len(first.known()) < self.same:
            first.made = made[: self.same]
        self.made, self.first = made, None


@dataclass(frozen=True, eq=False, kw_only=True)
class Scene(SceneArrays):
    """Everything a renderer needs: arrays in world units, camera, film and settings.

    The arrays are those of `veriray.scene_arrays.SceneArrays` (docs/scene-arrays.md), and
    triangle_shape (T,), sphere_shape (S,), disk_shape (D,) uint32 into shape_names, for masks and
    messages only.

    max_depth counts as Mitsuba's does (1 emission only, 2 direct light, -1 unlimited); rr_depth is
    the first depth with Russian roulette; with hide_emitters, rays of the camera go through lamps
    and see no sky, also behind what they have passed (masks, null, thin glass); sampler (of
    SAMPLERS), spp and seed are the file's sampler settings.

    Raises SceneError naming array, index, value and expected range. Zero-area triangles are kept.
    """

    camera: Camera
    film: Film
    max_depth: int = -1
    rr_depth: int = 5
    hide_emitters: bool = False
    sampler: str = "sobol"
    spp: int = 4
    seed: int = 0
    triangle_shape: Array = _NONE
    sphere_shape: Array = _NONE
    disk_shape: Array = _NONE
    shape_names: tuple[str, ...] = ()

    def __post_init__(self) -> None:
        arrays = checked({name: getattr(self, name) for name in COLUMNS})
        shapes = [name for name in ("triangle", "sphere", "disk") if len(arrays[f"{name}s"])]
        names = texts("shape_names", self.shape_names) or (("scene",) if shapes else ())
        for kind in ("triangle", "sphere", "disk"):
            name, count = f"{kind}_shape", len(arrays[f"{kind}s"])
            given = getattr(self, name)
            given = repeated(0, (count,), np.uint32) if given is None else given
            arrays[name] = array(name, given, np.uint32, (count,))
            note = f" (there are {len(names)} shapes)"
            in_range(name, arrays[name], 0, len(names) - 1, note)
        for name, value in {**arrays, "shape_names": names}.items():
            object.__setattr__(self, name, value)
        self._check_settings()

    def _check_settings(self) -> None:
        """Checks all but the arrays."""
        if not isinstance(self.camera, Camera):
            raise SceneError(f"camera is {type(self.camera).__name__}, expected Camera")
        if not isinstance(self.film, Film):
            raise SceneError(f"film is {type(self.film).__name__}, expected Film")
        whole("camera medium", self.camera.medium, -1, len(self.sigma_t) - 1)
        for name in ("sampler", "max_depth", "rr_depth", "seed"):
            value = SETTINGS[name].checked(name, getattr(self, name), SceneError)
            object.__setattr__(self, name, value)
        object.__setattr__(self, "hide_emitters", switch("hide_emitters", self.hide_emitters))
        object.__setattr__(self, "spp", whole("spp", self.spp, 1, 2**63 - 1))

    def __getstate__(self) -> dict[str, Any]:
        return {name: value for name, value in self.__dict__.items() if name not in _DERIVED}

    __setstate__ = restore

    def __repr__(self) -> str:
        return showing.scene_text(self)

    def _repr_html_(self) -> str:
        """A table, for notebooks."""
        return showing.scene_html(self)

    # Kept on the object, not in a table by id(), which another object may have later; without
    # cached_property, whose lock a child process may find taken.

    @property
    def native_forms(self) -> list[NativeForm]:
        """What `veriray.native_scene` keeps of this object and of copies by `with_`."""
        forms: list[NativeForm] = self.__dict__.setdefault("_native_forms", [])
        return forms

    @property
    def _hashed_columns(self) -> list[hashlib._Hash]:
        """The hash after each column, in order."""
        own = self._hashes_kept
        for maker in own.makers():
            if maker is not threading.current_thread():
                maker.join()  # at once in a child process, which has no such thread
        made = list(own.known())
        digest = made[-1].copy() if made else hashlib.sha256(b"veriray scene 2\n")
        for name in tuple(COLUMNS)[len(made) :]:
            self._hash(digest, name)
            made.append(digest.copy())
        own.keep(made)
        return made

    def hash_ahead(self) -> None:
        """Lets a thread hash large arrays, which `sha256` then waits for."""
        cell = self._hashes_kept
        if cell.maker is not None or len(cell.known()) == len(COLUMNS):
            return
        if sum(getattr(self, name).nbytes for name in COLUMNS) >= _LARGE:
            thread = threading.Thread(target=self._hash_in_thread, daemon=True)
            with contextlib.suppress(RuntimeError):  # no thread can be had
                thread.start()
                cell.maker = thread

    @property
    def hash_awaited(self) -> bool:
        """Whether `sha256` would wait for the thread of `hash_ahead`."""
        return any(maker.is_alive() for maker in self._hashes_kept.makers())

    def _hash_in_thread(self) -> None:
        with contextlib.suppress(Exception):  # `sha256` then raises it itself
            _ = self._hashed_columns

    def _hash(self, digest: hashlib._Hash, name: str) -> None:
        """Takes a column up, unless it is at its default."""
        values: Array = getattr(self, name)
        if not hashed(name, values):
            return
        digest.update(f"{name} {values.dtype.str[1:]} {values.shape}\n".encode())
        step = len(values) if distinct(values) is values else 1 << 16
        for first in range(0, len(values), max(step, 1)):
            part = values[first : first + step]
            digest.update(np.ascontiguousarray(part, part.dtype.newbyteorder("<")).data)

    @property
    def _hashes_kept(self) -> _Hashes:
        """What is known of its hash; copies with the same arrays share it."""
        hashes: _Hashes = self.__dict__.setdefault("_hashes", _Hashes())
        return hashes

    def place(self, message: str) -> str:
        """The place in the scene file of what "column[row] ..." is about; "" if unknown.

        The file alone where the message names no row. Raises TypeError for what is no text.
        """
        if not isinstance(message, str):
            raise TypeError(f"message is {type(message).__name__}, expected str")
        places: dict[str, list[str]] = self.__dict__.get("_places", {})
        found = re.match(r"(\w+)\[(\d+)\]", message)
        if found and found[1] in COLUMNS and places:
            table, row = COLUMNS[found[1]].table, int(found[2])
            if table in ("triangles", "spheres", "disks"):
                table, row = "shapes", int(getattr(self, f"{table[:-1]}_shape")[row])
            if row < len(places.get(table, ())):
                return places[table][row]
        return places.get("scene", [""])[0]

    def _with_arrays(self, camera: Camera | None = None, **changes: Any) -> Scene:
        """A copy with other values in the same rows, and perhaps another camera."""
        known = {name: getattr(self, name) for name in COLUMNS}
        arrays = checked({**known, **{n: a for n, a in changes.items() if n in COLUMNS}}, known)
        new = {name: arrays.get(name, value) for name, value in changes.items()}
        same = min(
            (place for place, name in enumerate(COLUMNS) if name in changes), default=len(COLUMNS)
        )
        hashes = _Hashes(self._hashes_kept, same)
        return self._copy(**new, camera=camera or self.camera, _hashes=hashes)

    def _copy(self, **changes: Any) -> Scene:
        """A copy with other fields, whose arrays are read-only and checked; it shares the rest."""
        copy = object.__new__(Scene)
        shared = {"_native_forms": self.native_forms, "_hashes": self._hashes_kept}
        copy.__dict__.update({**self.__getstate__(), **shared, **changes})
        copy._check_settings()
        return copy

    @property
    def cameras(self) -> tuple[Camera, ...]:
        """The cameras of all sensors of the file, by their numbers; `camera` is one of them."""
        cameras: tuple[Camera, ...] = self.__dict__.get("_cameras", (self.camera,))
        return cameras

    @property
    def notes(self) -> tuple[str, ...]:
        """What the file asks for and what changes no light here: lines of text, each with its
        place."""
        notes: tuple[str, ...] = self.__dict__.get("_notes", ())
        return notes

    @property
    def features(self) -> tuple[str, ...]:
        """Feature images that the file asks for (`aov`), which `veriray render` then writes."""
        features: tuple[str, ...] = self.__dict__.get("_features", ())
        return features

    @property
    def hides(self) -> bool:
        """Whether rays of the camera go through something: `hide_emitters`, with lamps or a sky."""
        seen = len(self.emissions) or self.sky_size.any() or self.environment.any()
        return self.hide_emitters and bool(seen)

    @property
    def sha256(self) -> str:
        """Hash (hex) of all that changes the expected picture: not names, sampler, spp or seed.

        Does not depend on the machine, the process or the file that the scene came from.
        """
        known: str | None = self.__dict__.get("_sha256")
        if known is None:
            known = self.__dict__["_sha256"] = self._made_sha256()
        return known

    def _made_sha256(self) -> str:
        digest = self._hashed_columns[-1].copy()
        camera, film = self.camera, self.film
        numbers = [
            *camera.to_world.ravel().tolist(),
            camera.tan_half_x(film.width, film.height),
            camera.tan_half_y(film.width, film.height),
            camera.near_clip,
            camera.far_clip,
            *camera.principal_point_offset.tolist(),
            camera.aperture_radius,
            camera.focus_distance if camera.aperture_radius else 0.0,
            *film.filter_parameters,
        ]
        if camera.projection != "perspective":
            digest.update(f"{camera.projection} ".encode())
        if camera.measures:
            digest.update(camera.patches.astype("<f8").tobytes())
        digest.update(" ".join(float(x).hex() for x in numbers).encode())
        settings = (film.width, film.height, film.filter, self.max_depth, self.rr_depth)
        digest.update(f"\n{(*settings, camera.medium)}\n".encode())
        if self.hides:
            digest.update(b"hide_emitters\n")
        return digest.hexdigest()

    def parameters(self) -> dict[str, float | tuple[float, ...]]:
        """The numbers of materials, lights, media and textures by name, as
        "teapot.bsdf.reflectance"; what textures give is left out. See `veriray.parameters`."""
        return parameters.listed(self)

    def with_(
        self,
        changes: Mapping[str, Any] | None = None,
        *,
        width: int | None = None,
        height: int | None = None,
        filter: str | None = None,
        filter_parameter: float | tuple[float, float] | None = None,
        max_depth: int | None = None,
        rr_depth: int | None = None,
        hide_emitters: bool | None = None,
        sampler: str | None = None,
        spp: int | None = None,
        seed: int | None = None,
        camera: Camera | None = None,
    ) -> Scene:
        """A copy with other settings; None keeps the value. changes: new values of `parameters`, by
        their names; a colour may be one number. Raises SceneError as Scene does.

        The copy shares what has not changed, on devices too: rendering it after the original makes
        nothing anew of a large scene's geometry (docs/speed.md, "Camera moves")."""
        if changes is not None:
            return self._changed(changes).with_(
                width=width, height=height, filter=filter, filter_parameter=filter_parameter,
                max_depth=max_depth, rr_depth=rr_depth, sampler=sampler, spp=spp, seed=seed,
                camera=camera, hide_emitters=hide_emitters,
            )  # fmt: skip
        film = self.film
        if filter is None and filter_parameter is None:
            filter_parameter = film.filter_parameter
        film = Film(
            film.width if width is None else width,
            film.height if height is None else height,
            film.filter if filter is None else filter,
            filter_parameter,
        )
        settings: dict[str, Any] = {"max_depth": max_depth, "rr_depth": rr_depth, "spp": spp}
        settings |= {"sampler": sampler, "seed": seed, "camera": camera}
        settings |= {"hide_emitters": hide_emitters}
        changed = {name: value for name, value in settings.items() if value is not None}
        return self._copy(**changed, film=film)

    def _changed(self, changes: Mapping[str, Any]) -> Scene:
        if not isinstance(changes, Mapping):
            raise SceneError(f"changes = {shown(changes)} is not a dictionary of names")
        arrays: dict[str, Any] = parameters.changed(self, changes)
        try:
            return self._with_arrays(**arrays)
        except SceneError as error:
            names = ", ".join(f'"{name}"' for name in changes)
            raise SceneError(f"{names}: {error}") from None

    def scaled(self, factor: float) -> Scene:
        """A copy with all lengths, the camera's too, multiplied by `factor` > 0: the same picture.

        So sigma_t is divided by `factor`, and the intensity of point and spot lights multiplied by
        its square.
        """
        factor = number("scale factor", factor, 0.0, MAX_COORDINATE, open_=True)
        intensity = self.light_intensity.astype(np.float64)
        near = self.light_kind != LIGHT_KINDS.index("directional")
        with np.errstate(over="ignore"):
            intensity[near] *= factor * factor
            sigma_t = self.sigma_t.astype(np.float64) / factor
        places: dict[str, Any] = {
            name: getattr(self, name) * factor
            for name in ("vertices", "spheres", "disks", "light_position", "grid_to_world")
        }
        solid = (self.texture_kind == TEXTURE_KINDS.index("volume"))[:, None, None]
        places["texture_to_world"] = np.where(
            solid, self.texture_to_world * factor, self.texture_to_world
        )
        turned = self.relief_texture >= 0
        places["relief_scale"] = np.where(turned, self.relief_scale * factor, self.relief_scale)
        copy = self._with_arrays(
            camera=_scaled(self.camera, factor),
            sigma_t=sigma_t,
            light_intensity=intensity,
            **places,
        )
        copy.__dict__["_cameras"] = tuple(_scaled(camera, factor) for camera in self.cameras)
        return copy

    def with_emission_scaled(self, factor: float) -> Scene:
        """A copy with all that shines, the environment too, multiplied by `factor` > 0."""
        factor = number("emission factor", factor, 0.0, MAX_COORDINATE, open_=True)
        names = ("emissions", "environment", "light_intensity", "sky_texels")
        changed: dict[str, Any] = {
            name: getattr(self, name).astype(np.float64) * factor for name in names
        }
        return self._with_arrays(**changed)


def _scaled(camera: Camera, factor: float) -> Camera:
    """A camera with all lengths multiplied by `factor`."""
    to_world = np.array(camera.to_world)
    to_world[:3, 3] *= factor
    if camera.projection == "orthographic":
        to_world[:3, :2] *= factor
    patches = np.array(camera.patches)
    patches[:, 2:] *= factor
    lens = ("near_clip", "far_clip", "aperture_radius", "focus_distance")
    lengths: dict[str, Any] = {name: getattr(camera, name) * factor for name in lens}
    return dataclasses.replace(camera, to_world=to_world, patches=patches, **lengths)


def load_file(
    scene: str | os.PathLike[str],
    parameters: Mapping[str, object] | None = None,
    *,
    sensor: int | None = None,
    strict: bool = False,
    **names: object,
) -> Scene:
    """Reads a scene file, or a shipped scene by its name.

    scene: path of a Mitsuba XML, glTF or OBJ file (docs/scene-files.md), or the name of a shipped
    scene: "cornell-box", "cornell-box-mitsuba" or "open"; a file that has such a name is reached as
    "./name". parameters: values for the file's $names, as `-D key=value` gives them; they may be
    keywords too, as Mitsuba takes them: load_file("a.xml", spp=64). sensor: the number of the
    file's sensor that sees the scene, from 0; None takes the first. strict: what `Scene.notes`
    would list is an error.
    Raises SceneError for anything that is missing, unknown or wrong; its `faults` lists all of it.
    """
    from . import formats

    text = path_text("scene", scene)
    if text.endswith(os.sep):  # Path forgets it
        raise SceneError(f"{text} names a folder, not a file")
    parameters = {} if parameters is None else parameters
    if not isinstance(parameters, Mapping) or not all(isinstance(key, str) for key in parameters):
        raise SceneError(f"parameters = {shown(parameters)} is not a dictionary of names")
    if twice := sorted(parameters.keys() & names.keys()):
        raise SceneError(f"{twice[0]} is given twice: in parameters and as a keyword")
    parameters = {**parameters, **names}
    path = find_shipped(text) if text in SHIPPED else Path(text)
    return _made(formats.load(path, parameters, *_options(sensor, strict)))


def _options(sensor: int | None, strict: bool) -> tuple[int | None, bool]:
    number = None if sensor is None else whole("sensor", sensor, 0, 2**31 - 1)
    return number, switch("strict", strict)


def load_dict(
    scene: Mapping[str, Any], *, sensor: int | None = None, strict: bool = False
) -> Scene:
    """Builds a scene from a Mitsuba-style dictionary (as mitsuba.load_dict takes it).

    Transforms are 4x4 arrays or objects with a `matrix` attribute, colours {"type": "rgb", "value":
    ...} or one number. File names are relative to the working directory. sensor, strict: as
    `load_file` takes them. Raises SceneError naming the key path.
    """
    from .formats import build, mitsuba_dict

    read = functools.partial(mitsuba_dict.read, scene)
    return _made(build.build(read, *_options(sensor, strict)))


def _made(built: Built) -> Scene:
    """The scene that a reader found; its place is added to errors."""
    try:
        scene = Scene(**built.arguments)
    except SceneError as error:
        raise SceneError(str(error), built.places["scene"][0]) from None
    scene.__dict__.update(
        _places=built.places, _cameras=built.cameras, _notes=built.notes,
        _objects=built.objects,
        _features=built.features,
        _warned=built.warned,
    )  # fmt: skip
    return scene


def cornell_box() -> Scene:
    """The measured Cornell box (scenes/cornell/cornell_box.xml), 512 x 512, 64 spp."""
    return load_file("cornell-box")
