"""The samples of feature images, and what is made of them."""

from __future__ import annotations

import functools
import os
import warnings
from collections.abc import Callable, Mapping
from typing import Any

import numpy as np
import numpy.typing as npt

from .camera import Camera
from .device import Device, polled
from .errors import RefusedSamplesWarning
from .features import LAYERS, NUMBERS, OF_SURFACES, FeatureImages
from .native_scene import native_scene
from .picture import with_room
from .scene import Scene

Array = npt.NDArray[Any]

_DEPTHS = ("depth", "depth_axis")
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
    check(scene, names)
    means = [name for name in _MEANS if name in names]
    kinds = dict.fromkeys(means, "sums and squares")
    kinds["hits"] = "integers"
    if {*NUMBERS} & {*names}:
        kinds["primitive"] = "integers"
    planes = [
        {"name": name, "kind": kind, "channels": len(LAYERS.get(name, "I")),
         "negative": kind != "integers"}
        for name, kind in kinds.items()
    ]  # fmt: skip
    width, height = scene.film.width, scene.film.height
    held = with_room(device, lambda: native_scene(owner, scene, device, None, "auto", spp))
    motion = np.zeros((2, 3, 4))
    if motion_to is not None:
        motion[:] = [pixel_rows(camera, width, height) for camera in (scene.camera, motion_to)]
    rows = band(device, width, native["threads"])
    samples = spp if means or "alpha" in names else 1
    found = np.empty((height, width), np.int64)
    shares = ["alpha"] * bool(means or "alpha" in names)
    images = {name: np.empty((height, width, len(LAYERS[name])), np.float32)
              for name in (*means, *shares)}  # fmt: skip
    errors = {name: np.empty_like(values) for name, values in images.items()}
    origin, unit = held.frame
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
        here = slice(first, first + count)
        hits = np.ascontiguousarray(film.words(1 + len(means))[..., 0, 0])
        for k, name in enumerate(means):
            resolve = functools.partial(film.picture, hits, native["threads"], 1 + k)
            picture = with_room(device, resolve)
            values, stderr = picture.image(), picture.stderr()
            if name in (*_DEPTHS, "position"):
                values, stderr = values * np.float32(unit), stderr * np.float32(unit)
                if name == "position":
                    values = values + np.asarray(origin)
                values[hits == 0] = 0 if name == "position" else np.inf
            images[name][here], errors[name][here] = values, stderr
        for name in shares:
            alpha = hits / spp
            images[name][here, :, 0] = alpha
            errors[name][here, :, 0] = np.sqrt(alpha * (1 - alpha) / max(1, spp - 1))
        if "primitive" in kinds:
            found[here] = film.words(2 + len(means))[..., 0, 0].astype(np.int64) - 1
    for name in images:
        if len(LAYERS[name]) == 1:
            images[name], errors[name] = images[name][..., 0], errors[name][..., 0]
    if "primitive" in kinds:
        images |= numbers(scene, held.input_index, found, names)
    if refused:
        _warn(sum(n for n, _ in refused), refused[0][1])
    order = {name: images[name] for name in LAYERS if name in images}
    return FeatureImages(order, errors, spp)


def band(device: Device, width: int, threads: int) -> int:
    """Rows that a film has at a time: so few that it stays in the caches of a CPU."""
    workers = threads or os.cpu_count() or 1
    pixels = 1 << 21 if device.backend == "cuda" else min(1 << 21, workers << 12)
    return max(1, pixels // width)


def check(scene: Scene, names: tuple[str, ...]) -> None:
    """Raises ValueError for what a scene cannot have."""
    if names and scene.camera.measures:
        raise ValueError(
            f"feature images are not of cameras of projection {scene.camera.projection}"
        )
    if "uv" in names and len(scene.triangles) and not scene.uv.any():
        raise ValueError(
            'feature "uv": the meshes of the scene have no texture coordinates; the reader keeps '
            "those of files in which something is textured"
        )


def numbers(
    scene: Scene, input_index: Array, found: Array, names: tuple[str, ...]
) -> dict[str, Array]:
    """The images of numbers; found: (H, W) primitives of the native form, -1 for nothing."""
    nothing = found < 0
    primitive = np.where(nothing, -1, input_index[np.maximum(found, 0)].astype(np.int64))
    primitive = _halves(scene, input_index, primitive)
    tables = {
        "object": (scene.triangle_shape, scene.sphere_shape, scene.disk_shape),
        "material": (scene.triangle_material, scene.sphere_material, scene.disk_material),
    }
    images: dict[str, Array] = {}
    for name in names:
        if name == "primitive":
            images[name] = (primitive + 1).astype(np.uint32)
        elif name in tables:
            rows = np.concatenate([np.asarray(table, np.int64) for table in tables[name]])
            value = rows[np.maximum(primitive, 0)] + 1 if len(rows) else np.zeros_like(primitive)
            images[name] = np.where(nothing, 0, value).astype(np.uint32)
    return images


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
