"""The result of a render: the picture with its error bars, and the hash of its film."""

from __future__ import annotations

import functools
import hashlib
import io
import os
import struct
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

from .errors import ImageError
from .numeric import path_text, shown, whole

#: Columns of the ray ledger, in the native modules' order.
LEDGER_COLUMNS = (
    "live", "escaped", "emitter_end", "absorbed", "rr_killed", "depth_cut", "invalid",
    "shadow_visible", "shadow_occluded",
)  # fmt: skip

Array = npt.NDArray[Any]
_whole = functools.partial(whole, error=ValueError)


@dataclass(frozen=True, eq=False)
class Render:
    """A finished picture with its error bars.

    image: (H, W, 3) float32, mean linear radiance; row 0 is the top of the picture.
    stderr: (H, W, 3) float32, standard error of that mean, per pixel and channel.
    batch_means: (B, H, W, 3) float64, means of B runs of spp / B samples each, or None.
    samples: (H, W) uint32, the samples of each pixel, or None where all have spp.
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
            save_exr(path, *fields, {**self.stats, **own}, regions, region_names)
        else:
            raise ImageError(f"{os.fspath(path)}: suffix {suffix!r}; expected .exr or .png")

    def _repr_png_(self) -> bytes:
        """The display copy, for notebooks."""
        from PIL import Image

        from .saving import to_srgb8

        file = io.BytesIO()
        Image.fromarray(to_srgb8(self.image)).save(file, format="png")
        return file.getvalue()


def film_hash(image: Array, stderr: Array, spp: int, samples: Array | None = None) -> str:
    """SHA-256 (hex) of a film.

    Hashed are the bytes "veriray film 1", then width, height and spp as unsigned 64-bit
    little-endian integers, then image and stderr, (H, W, 3) each, as little-endian float32 in C
    order. Every NaN counts as the same NaN. Samples by pixel, where they differ, follow as (H, W)
    little-endian uint32.
    """
    _check_film(image, stderr, samples)
    height, width = image.shape[:2]
    spp = _whole("spp", spp, 0, 2**64 - 1)
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
