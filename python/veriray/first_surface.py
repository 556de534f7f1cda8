"""The samples of feature images, and what is made of them."""

from __future__ import annotations

import copy
import functools
import os
import warnings
from collections.abc import Callable, Mapping
from typing import Any

import numpy as np
import numpy.typing as npt

from .camera import Camera
from .device import Device, native_errors, polled
from .errors import RefusedSamplesWarning
from .features import LAYERS, NUMBERS, OF_SURFACES, FeatureImages
from .held import Held, with_room
from .native_scene import native_scene
from .scene import Scene

Array = npt.NDArray[Any]

_KINDS = ("triangle", "sphere", "disk")
_TABLES = {"object": "shape", "material": "material"}
_MEANS = tuple(name for name in OF_SURFACES if name not in (*NUMBERS, "alpha"))


def look(  # noqa: PLR0913
    device: Device, owner: Scene, scene: Scene, names: tuple[str, ...], spp: int,
    native: Mapping[str, Any], motion_to: Camera | None = None,
    progress: Callable[[float], object] | None = None, begin: int = 0,
) -> FeatureImages:  # fmt: skip
    """Feature images of `scene`, which `owner` keeps; native: its settings of native renders;
    begin: the first sample.

    Raises ValueError for "uv" of meshes without texture coordinates.

    Warns by RefusedSamplesWarning of numbers that a film cannot hold, which count as 0.
    """
    check(scene, names, motion_to)
    means = [name for name in _MEANS if name in names]
    numbers = [name for name in NUMBERS if name in names]
    kinds = {"alpha": "integers", **dict.fromkeys(means, "sums and squares")}
    if numbers:
        kinds["primitive"] = "integers"
    planes = [
        {"name": "hits" if name == "alpha" else name, "kind": kind, "channels": len(LAYERS[name]),
         "negative": kind != "integers"}
        for name, kind in kinds.items()
    ]  # fmt: skip
    shares = bool(means) or "alpha" in names
    width, height = scene.film.width, scene.film.height
    held = with_room(device, lambda: native_scene(owner, scene, device, None, "auto", spp))
    motion = np.zeros((2, 3, 4))
    if motion_to is not None:
        motion[:] = [pixel_rows(camera, width, height) for camera in (scene.camera, motion_to)]
    rows = band(device, width, native["threads"])
    tall = min(height, span(device, width, rows))
    samples = spp if shares else 1

    def blank(height: int) -> dict[str, Any]:
        return {
            name: device.native.Picture(
                width, height, len(LAYERS[name]), name == "primitive", device.index
            )
            for name in kinds
            if name != "alpha" or shares
        }

    pictures: dict[str, Any] = {}
    parts: dict[str, list[Held]] = {}
    refused: list[tuple[int, Any]] = []
    film = None
    for first in range(0, height, rows):
        count = min(rows, height - first)
        if film is None or film.height != count:
            make = functools.partial(
                device.native.Film, width, count, device=device.index, planes=planes
            )
            film = with_room(device, make)
        else:
            film.clear()

        def poll(share: float, done: int = first, of: int = count) -> None:
            if progress is not None:
                progress((done + share * of) / height)

        report = device.native.render_features(
            held, film, sample_begin=begin, sample_end=begin + samples, seed=native["seed"],
            sampler=native["sampler"], threads=native["threads"],
            all_features=native["all_features"], first_row=first, motion=motion,
            poll=polled(poll),
        )  # fmt: skip
        if report["nonfinite_samples"]:
            refused.append((report["nonfinite_samples"], report["nonfinite"][0]))
        if first % tall == 0:
            pictures = with_room(device, functools.partial(blank, min(tall, height - first)))
        device.native.put_features(
            held, film, pictures=[pictures.get(name) for name in kinds], first_row=first % tall,
            samples=spp, threads=native["threads"],
        )  # fmt: skip
        if first + count == height or (first + count) % tall == 0:
            for name in [*pictures]:
                parts.setdefault(name, []).append(Held(pictures.pop(name)))
    if refused:
        _warn(sum(n for n, _ in refused), refused[0][1])
    made: dict[str, Any] = {name: _Mean(held) for name, held in parts.items()}
    if numbers:
        seen = _Seen(scene, held.input_index, parts["primitive"])
        made |= {name: _Number(seen, name) for name in numbers}
    order = {name: made[name] for name in (*_MEANS, "alpha", *numbers) if name in made}
    images = FeatureImages._of(order, [name for name in order if name not in NUMBERS], spp)
    images.motion_to = None if motion_to is None else motion[1]
    return images


class _Mean:
    """A mean and its error, of pictures one above the other; made once."""

    def __init__(self, parts: list[Held]) -> None:
        self._parts = parts
        self._done: dict[str, Array] = {}

    @property
    def image(self) -> Array:
        return self._made("image")

    @property
    def stderr(self) -> Array:
        return self._made("stderr")

    def _made(self, what: str) -> Array:
        if what not in self._done:
            values = _joined(self._parts, what)
            self._done.setdefault(what, values[..., 0] if values.shape[2] == 1 else values)
        return self._done[what]


class _Number:
    """An image of numbers; made once."""

    def __init__(self, seen: _Seen, name: str) -> None:
        self._seen, self._name = seen, name

    @property
    def image(self) -> Array:
        made: Array = self.__dict__.setdefault("_image", self._seen.number(self._name))
        return made


def _joined(parts: list[Held], what: str) -> Array:
    """Arrays of pictures one above the other, as one that belongs to the caller."""
    with native_errors():
        values = [getattr(part, what)() for part in parts]
    return values[0] if len(values) == 1 else np.concatenate(values)


def span(device: Device, width: int, rows: int) -> int:
    """Rows that the pictures of features have at a time, a multiple of `rows`: on a GPU so few that
    those before can make room."""
    pixels = 1 << 23 if device.backend == "cuda" else 1 << 31
    return max(1, pixels // (width * rows)) * rows


def band(device: Device, width: int, threads: int) -> int:
    """Rows that a film has at a time: so few that it stays in the caches of a CPU, and that a GPU
    keeps its memory from call to call."""
    workers = threads or os.cpu_count() or 1
    pixels = 1 << 20 if device.backend == "cuda" else min(1 << 21, workers << 12)
    return max(1, pixels // width)


def check(scene: Scene, names: tuple[str, ...], motion_to: Camera | None) -> None:
    """Raises ValueError for what a scene cannot have."""
    if "motion" in names and motion_to is None:
        raise ValueError(
            'feature "motion" needs a second camera: motion_to, on the command line --motion-to N '
            "or --motion-to FILE:NAME"
        )
    if "motion" not in names and motion_to is not None:
        raise ValueError('motion_to is for the feature "motion", which is not asked for')
    if motion_to is not None and motion_to.measures:
        raise ValueError(f"motion_to: a camera of projection {motion_to.projection} sees no image")
    if names and scene.camera.measures:
        raise ValueError(
            f"feature images are not of cameras of projection {scene.camera.projection}"
        )
    if "uv" in names and len(scene.triangles) and not scene.uv.any():
        raise ValueError(
            'feature "uv": the meshes of the scene have no texture coordinates; the reader keeps '
            "those of files in which something is textured"
        )


class _Seen:
    """What the rays through the centres of pixels meet: primitives of the native form."""

    def __init__(self, scene: Scene, input_index: Array, parts: list[Held]) -> None:
        self._scene = copy.copy(scene)  # without its native forms
        self._input_index, self._parts = input_index, parts

    @property
    def _primitive(self) -> Array:
        """(H, W) primitives of the scene, -1 for nothing."""
        if "_found" not in self.__dict__:
            seen = _joined(self._parts, "image")[..., 0].astype(np.int64) - 1
            met, primitive = seen >= 0, np.full(seen.shape, -1)
            primitive[met] = self._input_index[seen[met]]
            primitive = _halves(self._scene, self._input_index, primitive)
            self.__dict__.setdefault("_found", primitive)
        found: Array = self.__dict__["_found"]
        return found

    def number(self, name: str) -> Array:
        """The image of that name."""
        primitive = self._primitive
        if name == "primitive":
            return (primitive + 1).astype(np.uint32)
        tables = [getattr(self._scene, f"{kind}_{_TABLES[name]}") for kind in _KINDS]
        rows = np.concatenate([np.asarray(table, np.int64) for table in tables])
        value = rows[np.maximum(primitive, 0)] + 1 if len(rows) else np.zeros_like(primitive)
        return np.where(primitive < 0, 0, value).astype(np.uint32)


def _halves(scene: Scene, input_index: Array, primitive: Array) -> Array:
    """Triangles where those of a face that was merged from two count as its first.

    The point of the face under the pixel's centre lies in one of the two.
    """
    triangles = len(scene.triangles)
    merged = np.setdiff1d(np.arange(triangles), input_index)
    if not len(merged) or len(input_index) > 1024:
        return primitive  # a tree holds each triangle by itself
    corners = scene.vertices[scene.triangles]
    out = primitive.copy().ravel()
    for first in np.flatnonzero(np.bincount(out + 1, minlength=triangles + 1)[1 : triangles + 1]):
        a, b, c = corners[first]
        normal = np.cross(b - a, c - a)
        flat = np.abs((corners[merged] - a) @ normal).max(axis=1)
        others = merged[flat <= 1e-5 * np.linalg.norm(normal) * np.abs(corners[first] - a).max()]
        if not len(others):
            continue
        here = np.flatnonzero(primitive.ravel() == first)
        origins, ways = centre_rays(scene, here // scene.film.width, here % scene.film.width)
        across = ways @ normal
        t = ((a - origins) @ normal) / np.where(across == 0, 1, across)
        points = origins + t[:, None] * ways
        inside = _inside(points, corners[first])
        beyond = inside < 0
        here, points, inside = here[beyond], points[beyond], inside[beyond]
        for other in others:
            depth = _inside(points, corners[other])
            better = depth > inside
            out[here[better]] = other
            inside = np.where(better, depth, inside)
    return out.reshape(primitive.shape)


def _inside(points: Array, triangle: Array) -> Array:
    """The least barycentric coordinate of points of a triangle's plane; -inf without an area."""
    a, b, c = triangle
    normal = np.cross(b - a, c - a)
    square = float(normal @ normal)
    if not square > 0:
        return np.full(len(points), -np.inf)
    heights = [
        (points - p) @ (np.cross(normal, q - p) / square) for p, q in ((a, b), (b, c), (c, a))
    ]
    least: Array = np.minimum(np.minimum(heights[0], heights[1]), heights[2])
    return least


def _view(camera: Camera, width: int, height: int) -> tuple[Array, float, float, float, float]:
    """Matrix, half extents and offsets of the principal point of a camera."""
    x, y = (float(v) for v in camera.principal_point_offset)
    return (np.asarray(camera.placed, np.float64), camera.tan_half_x(width, height),
            camera.tan_half_y(width, height), x, y)  # fmt: skip


def centre_rays(scene: Scene, rows: Array, columns: Array) -> tuple[Array, Array]:
    """Origins and directions, (N, 3) each and not normalised, through the centres of pixels."""
    width, height = scene.film.width, scene.film.height
    m, half_x, half_y, off_x, off_y = _view(scene.camera, width, height)
    x = half_x * (1 - 2 * ((columns + 0.5) / width + off_x))
    y = half_y * (1 - 2 * ((rows + 0.5) / height + off_y))
    aside = x[:, None] * m[:3, 0] + y[:, None] * m[:3, 1]
    ahead = np.broadcast_to(m[:3, 2], aside.shape)
    if scene.camera.projection == "orthographic":
        return m[:3, 3] + aside, ahead
    return np.broadcast_to(m[:3, 3], aside.shape), aside + ahead


def pixel_rows(camera: Camera, width: int, height: int) -> Array:
    """(3, 4): takes a point of the world to x w, y w and w of its place on the film in pixels."""
    m, half_x, half_y, off_x, off_y = _view(camera, width, height)
    local = np.concatenate([m[:3, :3].T, -(m[:3, :3].T @ m[:3, 3])[:, None]], axis=1)
    w = np.array([0.0, 0, 0, 1]) if camera.projection == "orthographic" else local[2]
    x = width * ((0.5 - off_x) * w - local[0] / (2 * half_x))
    y = height * ((0.5 - off_y) * w - local[1] / (2 * half_y))
    return np.array([x, y, w])


def _warn(count: int, first: Any) -> None:
    x, y, sample = first[:3]
    warnings.warn(
        f"{count:,} samples of feature images count as 0: a film cannot hold them; the first is "
        f"sample {sample} of pixel ({x}, {y})",
        RefusedSamplesWarning,
        stacklevel=4,
    )
