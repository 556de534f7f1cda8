"""The result of a render: the picture with its error bars, and the hash of its film."""

from __future__ import annotations

import functools
import hashlib
import io
import os
import struct
from collections.abc import Callable
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
import numpy.typing as npt

from . import denoising, showing
from .device import native_errors
from .errors import ImageError
from .features import FeatureImages
from .held import HOST, OnHost, keep
from .numeric import path_text, shown, switch, whole
from .settings import LEDGER_COLUMNS as LEDGER_COLUMNS

if TYPE_CHECKING:
    from ._native import Picture
    from .scene import Scene

Array = npt.NDArray[Any]
_whole = functools.partial(whole, error=ValueError)


@dataclass(frozen=True, eq=False)
class Render:
    """A finished picture with its error bars.

    What `veriray.render` returns stays in the memory of its device: `image`, `stderr` and
    `film_sha256` are made when they are first asked for, and belong to the caller. So are `stats`
    where the hash of a large scene is not there yet. The picture
    itself is lent without a copy: `numpy.asarray(render)` on a CPU (read-only), and
    `torch.from_dlpack(render)`, `cupy.asarray(render)` and the like on either, as long as they
    need it. Who writes to it changes what is made later.

    image: (H, W, 3) float32, mean linear radiance; row 0 is the top of the picture.
    stderr: (H, W, 3) float32, standard error of that mean, per pixel and channel.
    batch_means: (B, H, W, 3) float64, means of B runs of spp / B samples each, or None. With
        sampler sobol they are independent of each other where spp / B is a multiple of 16.
    samples: (H, W) uint32, the samples of each pixel, or None where all have spp.
    features: feature images by name, if they were asked for (`veriray.features`).
    film_sha256: see `film_hash`; equal hashes mean equal bytes.
    stats: what was done (plain Python numbers, strings and lists; `render` lists the keys).
    Raises ValueError naming the field that is not so.
    """

    image: Array
    stderr: Array
    batch_means: Array | None
    film_sha256: str
    stats: dict[str, Any]
    width: int
    height: int
    spp: int
    seed: int
    samples: Array | None = None
    features: FeatureImages = field(default_factory=FeatureImages)

    def __post_init__(self) -> None:
        _check_film(self.image, self.stderr, self.samples)
        shape, means = self.image.shape, self.batch_means
        if means is not None and (
            not isinstance(means, np.ndarray)
            or means.ndim != 4
            or means.shape[1:] != shape
            or means.dtype.kind not in "fiu"
        ):
            given = means.shape if isinstance(means, np.ndarray) else means
            raise ValueError(f"batch_means is {shown(given)}, expected numbers (B, H, W, 3)")
        if not isinstance(self.film_sha256, str):
            raise ValueError(f"film_sha256 = {shown(self.film_sha256)} is not a string")
        if not isinstance(self.stats, dict) or not all(isinstance(k, str) for k in self.stats):
            raise ValueError(f"stats = {shown(self.stats)} is not a dictionary of names")
        for name, value in (("height", shape[0]), ("width", shape[1])):
            if _whole(name, getattr(self, name), 1, 2**31 - 1) != value:
                raise ValueError(f"{name} = {getattr(self, name)}, but image is {shape}")
        _whole("spp", self.spp, 0, 2**64 - 1)
        _whole("seed", self.seed, 0, 2**64 - 1)
        if not isinstance(self.features, FeatureImages):
            raise ValueError(f"features = {shown(self.features)} is not a FeatureImages")

    @classmethod
    def _of(cls, held: Picture, hashed: Scene | None = None, **fields: Any) -> Render:
        """The render whose picture a native module holds; fields: the others.

        hashed: the scene whose hash `stats` still lacks.
        """
        made = object.__new__(cls)
        if hashed is not None:
            fields["_unhashed"] = hashed, fields.pop("stats")
        made.__dict__.update({"features": FeatureImages(), **fields}, _held=held)
        keep(made)
        return made

    if not TYPE_CHECKING:  # the fields say what there is

        def __getattr__(self, name: str) -> Any:
            """A field that is made when it is first asked for."""
            held = self.__dict__.get("_held")
            if held is None or name not in _MADE:
                raise AttributeError(f"{type(self).__name__!r} object has no attribute {name!r}")
            with native_errors():
                made = _MADE[name](self, held)
            return self.__dict__.setdefault(name, made)

    @classmethod
    def load(cls, path: str | os.PathLike[str], *, check: bool = True) -> Render:
        """The render that `save` wrote to an EXR file: picture, errors, batches, statistics.

        check: the file's film_sha256 must be that of its pixels. Raises ImageError for a file that
        is damaged, changed since or beyond the limits of `veriray.image.load`, and OSError for one
        that cannot be read. Batch means are float32 in files.
        """
        from .loading import MAX_BYTES, read

        check = switch("check", check, error=ValueError)
        found = cls(**read(path, MAX_BYTES)[0])
        if check and found.film_sha256:
            own = film_hash(found.image, found.stderr, found.spp, found.samples)
            if own != found.film_sha256:
                raise ImageError(
                    f"{os.fspath(path)}: film hash of the pixels {own[:12]}..., but its header "
                    f"says {found.film_sha256[:12]}...: it was changed since (check=False takes it)"
                )
        return found

    def denoised(self, albedo: Array | None = None, normal: Array | None = None) -> Render:
        """This picture without noise, as Open Image Denoise guesses it: for eyes, not for proofs.

        albedo: (H, W, 3) in [0, 1]; normal: (H, W, 3) in [-1, 1], with albedo only; both of what
        the pixels show. None takes the feature images of that name, if the picture has them. The
        result has no standard error, batches or hash, its stats name the denoiser, and
        `veriray.compare` refuses it. Needs pyoidn (`pip install 'veriray[denoise]'`): raises
        MissingPackageError without it, `veriray.denoising.DenoiserError` where it fails, and
        ValueError for other arrays.
        """
        if self.stats.get("denoiser"):
            raise ValueError(f"the picture is denoised already, by {self.stats['denoiser']}")
        albedo = self.features.get("albedo") if albedo is None else albedo
        if albedo is not None and normal is None:
            normal = self.features.get("normal")
        return type(self)(**denoising.fields(self, albedo, normal))

    def __getstate__(self) -> dict[str, Any]:
        for name in _MADE:
            getattr(self, name)
        return {name: value for name, value in self.__dict__.items() if name not in _OWN}

    def __array__(self, dtype: Any = None, copy: bool | None = None) -> Array:
        """The image; on a CPU without a copy, and then read-only."""
        held = self.__dict__.get("_held")
        if "image" in self.__dict__ or held is None or held.dlpack_device()[0] != HOST:
            values = self.image
        else:
            values = held.view()
        if dtype is not None and values.dtype != dtype:
            if copy is False:
                raise ValueError(f"an image of {values.dtype} is none of {dtype} without a copy")
            return values.astype(dtype)
        return values.copy() if copy else values

    def __dlpack_device__(self) -> tuple[int, int]:
        """Kind and number of the device that holds the picture, as DLPack numbers them."""
        held = self.__dict__.get("_lent", self.__dict__.get("_held"))
        return (HOST, 0) if held is None else held.dlpack_device()

    def __dlpack__(
        self,
        *,
        stream: object = None,
        max_version: tuple[int, int] | None = None,
        dl_device: tuple[int, int] | None = None,
        copy: bool | None = None,
    ) -> Any:
        """A capsule of the image, (H, W, 3) float32, for `from_dlpack` of other packages.

        Without a copy, unless `copy` asks for one or `dl_device` for the host. The picture is
        complete, so no stream has to wait. Raises BufferError for another GPU, and for a copy on
        one.
        """
        here = self.__dlpack_device__()
        wanted = here if dl_device is None else (int(dl_device[0]), int(dl_device[1]))
        if wanted != here and (wanted[0] != HOST or copy is False):
            raise BufferError(f"the picture is on device {here} of DLPack, not on {wanted}")
        held = self.__dict__.get("_lent", self.__dict__.get("_held"))
        if wanted == here and not copy and held is not None and not isinstance(held, OnHost):
            return held.dlpack(versioned=max_version is not None and max_version[0] >= 1)
        if wanted[0] != HOST:
            raise BufferError("a picture on a GPU is lent without a copy")
        values = np.array(self) if copy or not self.image.flags.writeable else self.image
        return values.__dlpack__()

    @property
    def __cuda_array_interface__(self) -> dict[str, Any]:
        """The image on the GPU, for CuPy, Numba and PyTorch; an AttributeError on a CPU."""
        held = self.__dict__.get("_lent", self.__dict__.get("_held"))
        if held is None or held.dlpack_device()[0] == HOST:
            raise AttributeError("the picture is not on a GPU")
        self.__dict__["_lent"] = held  # stays, wherever the picture goes
        return {
            "shape": (self.height, self.width, 3),
            "typestr": "<f4",
            "data": (held.pointer(), False),
            "strides": None,
            "stream": None,
            "version": 3,
        }

    def save(
        self,
        path: str | os.PathLike[str],
        *,
        exposure: float = 0.0,
        regions: npt.NDArray[np.integer[Any]] | None = None,
        region_names: list[str] | None = None,
    ) -> None:
        """Write everything as `.exr` (layout: `veriray.image`), or a display copy as `.png`.

        Args:
            path: ends in `.exr` or `.png`. The file is written beside its place and renamed, so
                that a failure leaves an earlier file as it was and no partial file.
            exposure: stops, for PNG only (see `veriray.image.to_srgb8`).
            regions: (H, W) integers, for EXR only: primary-hit object masks, 0 = nothing.
            region_names: name of value k + 1 at index k.

        Raises:
            ImageError: another suffix; arrays of the wrong shape.
            OSError: the file cannot be written (the message names it).
        """
        from .saving import save_exr, save_png

        suffix = Path(path_text("path", path, ImageError)).suffix.lower()
        if suffix == ".png":
            save_png(self.image, path, exposure=exposure)
        elif suffix == ".exr":
            own = {"film_sha256": self.film_sha256, "spp": self.spp, "seed": self.seed}
            fields = self.image, self.stderr, self.batch_means, self.samples
            stats = {**self.stats, **own}
            more = self.features.channels(), self.features.attributes()
            save_exr(path, *fields, stats, regions, region_names, *more)
        else:
            raise ImageError(f"{os.fspath(path)}: suffix {suffix!r}; expected .exr or .png")

    def __repr__(self) -> str:
        return showing.render_text(self)

    def _repr_html_(self) -> str:
        """The picture with a slider for the exposure, for notebooks."""
        return showing.render_html(self)

    def _repr_png_(self) -> bytes:
        """The display copy, for notebooks."""
        from PIL import Image

        from .saving import to_srgb8

        file = io.BytesIO()
        Image.fromarray(to_srgb8(self.image)).save(file, format="png")
        return file.getvalue()


def _hash_of(render: Render, held: Picture | OnHost) -> str:
    """`film_hash` of the picture itself, whatever became of `Render.image`."""
    image = held.view() if held.dlpack_device()[0] == HOST else held.image()
    return _digest(image, held.stderr(), render.spp, render.samples)


def _whole_stats(render: Render, _: object) -> dict[str, Any]:
    """Statistics with the hash of the scene, which `render` then no longer holds."""
    waiting = render.__dict__.get("_unhashed")
    if waiting is not None:
        scene, stats = waiting
        stats["scene_sha256"] = scene.sha256
        render.__dict__.setdefault("stats", stats)
        render.__dict__.pop("_unhashed", None)
    made: dict[str, Any] = render.__dict__["stats"]
    return made


#: What `Render` makes when it is asked for, and what it keeps for that.
_MADE: dict[str, Callable[[Render, Any], Any]] = {
    "stats": _whole_stats,
    "image": lambda _, held: held.image(),
    "stderr": lambda _, held: held.stderr(),
    "film_sha256": _hash_of,
}
_OWN = ("_held", "_lent", "_for_child", "_unhashed")


def film_hash(image: Array, stderr: Array, spp: int, samples: Array | None = None) -> str:
    """SHA-256 (hex) of a film.

    Hashed are the bytes "veriray film 1", then width, height and spp as unsigned 64-bit
    little-endian integers, then image and stderr, (H, W, 3) each, as little-endian float32 in C
    order. Every NaN counts as the same NaN. Samples by pixel, where they differ, follow as (H, W)
    little-endian uint32.
    """
    _check_film(image, stderr, samples)
    return _digest(image, stderr, _whole("spp", spp, 0, 2**64 - 1), samples)


def _digest(image: Array, stderr: Array, spp: int, samples: Array | None) -> str:
    """`film_hash` of what is checked."""
    height, width = image.shape[:2]
    digest = hashlib.sha256(b"veriray film 1" + struct.pack("<3Q", width, height, spp))
    for values in (image, stderr):
        plain = np.ascontiguousarray(values, dtype="<f4")
        if (nan := np.isnan(plain)).any():
            plain = np.where(nan, np.float32(np.nan), plain).astype("<f4")
        digest.update(np.ascontiguousarray(plain).data)
    if samples is not None:
        digest.update(np.ascontiguousarray(samples, dtype="<u4").data)
    return digest.hexdigest()


def _check_film(image: Array, stderr: Array, samples: Array | None) -> None:
    """Raises ValueError unless the arrays are numbers (H, W, 3), (H, W, 3) and None or (H, W)."""
    shape: tuple[int, ...] = image.shape if isinstance(image, np.ndarray) else ()
    if len(shape) != 3 or shape[2] != 3 or 0 in shape:
        raise ValueError(
            f"image is {shown(shape or image)}, expected an array (H, W, 3) with H, W >= 1"
        )
    others = {"stderr": (stderr, shape), "samples": (samples, shape[:2])}
    for name, (given, expected) in others.items():
        if given is None and name == "samples":
            continue
        if not isinstance(given, np.ndarray) or given.shape != expected:
            raise ValueError(f"{name} is {shown(given)}, expected an array {expected}")
    for name, given in (("image", image), ("stderr", stderr), ("samples", samples)):
        kinds = "iu" if name == "samples" else "fiu"
        if given is not None and given.dtype.kind not in kinds:
            raise ValueError(f"{name} has dtype {given.dtype}, expected numbers")
