"""Feature images: what the camera sees first, as depth, normals, colours and numbers.

They are of the first surface that a ray of the camera meets. The rays are those of the picture: the
same random numbers, pixel filter and lens, so its first samples and theirs meet the same points. A
ray goes on through null surfaces, through uncovered parts of masks, through lamps that the camera
does not see (`hide_emitters`) and through media. A mirror or glass is itself, not what it shows.

Means over the samples of a pixel that meet a surface, each with its standard error; `alpha` is the
share of those samples. Where none does, depths are infinite and all others 0. A filter with negative
lobes counts without its sign, so that a mean lies between the numbers that it is of.

- `depth` (H, W): distance along the ray from the camera or the point of its lens, in world units.
- `depth_axis` (H, W): the same along the camera's axis.
- `position` (H, W, 3): of the point, in the world.
- `normal` (H, W, 3): of shading, interpolated and turned by normal and bump maps; of the surface's
  front, whichever side is seen. Means of unit vectors, so shorter where they differ.
- `geo_normal` (H, W, 3): of the face.
- `albedo` (H, W, 3): share of the light towards the camera that the surface sends on, by mirror,
  base and transmission together, as its material states it; 0 for what takes all light, as the back
  of a one-sided surface does. Mitsuba's `albedo` is the diffuse part of it.
- `uv` (H, W, 2): texture coordinates, as Mitsuba has them.
- `motion` (H, W, 2): pixels to the right and down from the point's image in this camera to that in
  the camera `motion_to`, of the same film; 0 for points behind one of them.
- `alpha` (H, W): share of the samples that meet a surface; always there beside another mean.

Numbers (H, W) uint32 of what the ray through the pixel's centre and the lens's meets, 0 for nothing;
never filtered:

- `object`: 1 + the shape in `Scene.shape_names`.
- `material`: 1 + the row of the scene's materials (of a blend, the row that blends).
- `primitive`: 1 + the triangle, T + the sphere or T + S + the disk of T triangles and S spheres.

Parts of the picture (H, W, 3), which cost another picture of two segments a path:

- `direct`: paths of two segments at most: what lamps send to the camera, and what is lit by them.
- `indirect`: the rest, picture less `direct`. Its standard error is the sum of both, an upper limit.

In EXR files a layer has the image's name, `depth.Z` and `normal.X` for example (`LAYERS`), and its
standard error is the layer `stderr.NAME`.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from typing import TYPE_CHECKING, Any

import numpy as np
import numpy.typing as npt

from .numeric import shown, whole
from .settings import FEATURES, MAX_SPP

if TYPE_CHECKING:
    from .camera import Camera
    from .device import Device
    from .picture import Render
    from .scene import Scene

Array = npt.NDArray[Any]

#: Letters of the channels by image, as EXR files have them.
LAYERS = {
    "depth": "Z", "depth_axis": "Z", "position": "XYZ", "normal": "XYZ", "geo_normal": "XYZ",
    "albedo": "RGB", "uv": "UV", "motion": "XY", "alpha": "A", "object": "I", "material": "I",
    "primitive": "I", "direct": "RGB", "indirect": "RGB",
}  # fmt: skip
NUMBERS = ("object", "material", "primitive")
PARTS = ("direct", "indirect")
#: What is made of nothing but the first surface.
OF_SURFACES = tuple(name for name in LAYERS if name not in PARTS)
#: Samples of a pixel, if nothing else is asked for, but not more than the picture has.
SPP = 16
_DEPTHS = ("depth", "depth_axis")
_MEANS = tuple(name for name in OF_SURFACES if name not in (*NUMBERS, "alpha"))


class FeatureImages(Mapping[str, Array]):
    """Feature images by name.

    images: those of `veriray.features`. stderr: standard errors of the means among them, by name;
    0 where fewer than two samples met a surface. spp: samples of a pixel that the means are of.
    """

    def __init__(
        self, images: Mapping[str, Array] = {}, stderr: Mapping[str, Array] = {}, spp: int = 0
    ) -> None:  # fmt: skip
        for name, values in images.items():
            known = name in LAYERS and isinstance(values, np.ndarray)
            if not known or _channels(values) != len(LAYERS[name]):
                raise ValueError(f"feature image {shown(name)}: not of `veriray.features`")
        self.images, self.stderr, self.spp = dict(images), dict(stderr), spp

    def __getitem__(self, name: str) -> Array:
        try:
            return self.images[name]
        except KeyError:
            raise KeyError(f"no feature image {name!r}; there are: {', '.join(self)}") from None

    def __iter__(self) -> Iterator[str]:
        return iter(self.images)

    def __len__(self) -> int:
        return len(self.images)

    def __repr__(self) -> str:
        return f"FeatureImages({', '.join(self)}; {self.spp} spp)"

    def channels(self) -> dict[str, Array]:
        """(H, W) float32 or uint32 by the channel's name in an EXR file."""
        out: dict[str, Array] = {}
        for prefix, images in (("", self.images), ("stderr.", self.stderr)):
            for name, values in images.items():
                planes = values.reshape(*values.shape[:2], -1)
                for c, letter in enumerate(LAYERS[name]):
                    out[f"{prefix}{name}.{letter}"] = np.ascontiguousarray(planes[..., c])
        return out

    @classmethod
    def of_channels(cls, channels: Mapping[str, Array], spp: int) -> FeatureImages:
        """The inverse of `channels`, from all channels of a file."""
        found: dict[str, dict[str, Array]] = {"": {}, "stderr.": {}}
        for prefix, images in found.items():
            for name, letters in LAYERS.items():
                planes = [channels.get(f"{prefix}{name}.{letter}") for letter in letters]
                if all(plane is not None for plane in planes):
                    kind = np.uint32 if name in NUMBERS else np.float32
                    values = np.stack(planes, axis=-1).astype(kind)  # type: ignore[arg-type]
                    images[name] = values[..., 0] if len(letters) == 1 else values
        return cls(found[""], found["stderr."], spp)

    def save(self, path: Any) -> None:
        """Write these images alone as an EXR file, whose channels are `channels()`.

        Raises ImageError for another suffix than .exr, OSError for what cannot be written.
        """
        from .saving import save_channels

        save_channels(path, self.channels(), {"veriray.feature_spp": str(self.spp)})


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
        motion_to: the second camera, for "motion".

    Raises as `veriray.render`.
    """
    from . import device as device_module
    from .rendering import settle
    from .settings import SETTINGS, RenderSettings

    settings = RenderSettings(
        spp=whole("spp", spp, 1, MAX_SPP, error=ValueError), seed=seed, device=device,
        sampler=sampler, width=width, height=height, threads=threads,
    )  # fmt: skip
    wanted: tuple[str, ...] = SETTINGS["features"].checked("names", names, ValueError)
    if wrong := [name for name in wanted if name in PARTS]:
        raise ValueError(
            f"names: {', '.join(wrong)} are parts of a picture: render(scene, features=...)"
        )
    if not wanted:
        raise ValueError(f"names = {shown(names)} is empty; allowed: {', '.join(OF_SURFACES)}")
    if "motion" in wanted and motion_to is None:
        raise ValueError('"motion" needs a second camera: motion_to=Camera(...)')
    used, settings = settle(scene, settings)
    chosen, _ = device_module.select(settings.device, fresh=False)
    with device_module.native_errors():
        return look(chosen, scene, used, wanted, used.spp, settings.native(),
                    motion_to, progress)  # fmt: skip


def look(device: Device, owner: Scene, scene: Scene, names: tuple[str, ...], spp: int,
         native: Mapping[str, Any], motion_to: Camera | None = None,
         progress: Callable[[float], object] | None = None) -> FeatureImages:  # fmt: skip
    """Feature images of `scene`, which `owner` keeps; native: its settings of native renders.

    Warns by RefusedSamplesWarning of numbers that a film cannot hold, which count as 0.
    """
    from .device import polled
    from .native_scene import native_scene
    from .sampling import with_room

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
    film = with_room(
        device, lambda: device.native.Film(width, height, device=device.index, planes=planes)
    )
    motion = np.zeros((2, 3, 4))
    if motion_to is not None:
        motion[:] = [pixel_rows(camera, width, height) for camera in (scene.camera, motion_to)]
    report = device.native.render_features(
        held, film, sample_begin=0, sample_end=spp if means or "alpha" in names else 1,
        seed=native["seed"], sampler=native["sampler"], threads=native["threads"],
        motion=motion, poll=polled(progress),
    )  # fmt: skip
    places = {name: 1 + k for k, name in enumerate(kinds)}
    hits = np.ascontiguousarray(film.words(places["hits"])[..., 0, 0])
    origin, unit = held.frame
    images: dict[str, Array] = {}
    errors: dict[str, Array] = {}
    for name in means:
        picture = with_room(
            device, lambda at=places[name]: film.picture(hits, native["threads"], at)
        )
        mean, error = picture.image(), picture.stderr()
        if name in (*_DEPTHS, "position"):
            mean, error = mean.astype(np.float64) * unit, error * np.float32(unit)
        if name == "position":
            mean = np.where(hits[..., None] > 0, mean + np.asarray(origin), 0)
        elif name in _DEPTHS:
            mean = np.where(hits[..., None] > 0, mean, np.inf)
        flat = mean.shape[2] == 1
        images[name] = np.asarray(mean[..., 0] if flat else mean, np.float32)
        errors[name] = np.asarray(error[..., 0] if flat else error, np.float32)
    if means or "alpha" in names:
        alpha = hits / spp
        images["alpha"] = alpha.astype(np.float32)
        errors["alpha"] = np.sqrt(alpha * (1 - alpha) / max(1, spp - 1)).astype(np.float32)
    if "primitive" in kinds:
        found = film.words(places["primitive"])[..., 0, 0].astype(np.int64) - 1
        images |= numbers(scene, held.input_index, found, names)
    if report["nonfinite_samples"]:
        _warn(report)
    order = {name: images[name] for name in LAYERS if name in images}
    return FeatureImages(order, errors, spp)


def beside(render: Render, device: Device, owner: Scene, scene: Scene, names: tuple[str, ...],
           spp: int | None, native: Mapping[str, Any]) -> FeatureImages:  # fmt: skip
    """The feature images that a picture is to have; spp: of the means, None for the usual."""
    of_surfaces = tuple(name for name in names if name not in PARTS)
    spp = min(SPP, scene.spp) if spp is None else spp
    made = FeatureImages(spp=spp)
    if of_surfaces:
        made = look(device, owner, scene, of_surfaces, spp, native)
    if {*PARTS} & {*names}:
        from .native_scene import native_scene
        from .sampling import uniform

        depth = native["max_depth"]
        less = {**native, "max_depth": min(2, depth) if depth >= 0 else 2}
        held = native_scene(owner, scene, device, None, "auto", scene.spp)
        part = uniform(device, held, scene, less, None, 0).picture
        direct, error = part.image(), part.stderr()
        if "direct" in names:
            made.images["direct"], made.stderr["direct"] = direct, error
        if "indirect" in names:
            made.images["indirect"] = np.asarray(render.image - direct, np.float32)
            made.stderr["indirect"] = np.asarray(render.stderr + error, np.float32)
    return made


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
    out = primitive.copy()
    for first in np.unique(primitive[(primitive >= 0) & (primitive < triangles)]):
        rows, columns = np.nonzero(primitive == first)
        origins, ways = centre_rays(scene, rows, columns)
        a, b, c = corners[first]
        normal = np.cross(b - a, c - a)
        across = ways @ normal
        t = ((a - origins) @ normal) / np.where(across == 0, 1, across)
        points = origins + t[:, None] * ways
        best, inside = np.full(len(rows), first), _inside(points, corners[first])
        beyond = inside < 0
        flat = np.abs((corners[merged] - a) @ normal).max(axis=1)
        size = np.linalg.norm(normal) * np.abs(corners[first] - a).max()
        for other in merged[flat <= 1e-5 * size]:
            depth = _inside(points, corners[other])
            better = beyond & (depth > inside)
            best, inside = np.where(better, other, best), np.where(better, depth, inside)
        out[rows, columns] = best
    return out


def _inside(points: Array, triangle: Array) -> Array:
    """The least barycentric coordinate of points of a triangle's plane; -inf without an area."""
    a, b, c = triangle
    normal = np.cross(b - a, c - a)
    square = float(normal @ normal)
    if not square > 0:
        return np.full(len(points), -np.inf)
    edges = ((a, b), (b, c), (c, a))
    return np.min([np.cross(q - p, points - p) @ normal / square for p, q in edges], axis=0)


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


def _warn(report: Mapping[str, Any]) -> None:
    import warnings

    from .errors import RefusedSamplesWarning

    x, y, sample = report["nonfinite"][0][:3]
    warnings.warn(
        f"{report['nonfinite_samples']:,} samples of feature images count as 0: a film cannot hold "
        f"them; the first is sample {sample} of pixel ({x}, {y})",
        RefusedSamplesWarning,
        stacklevel=4,
    )


def _channels(values: Array) -> int:
    return values.shape[2] if values.ndim == 3 else 1


assert set(LAYERS) == set(FEATURES)
