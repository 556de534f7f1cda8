"""Denoised pictures for eyes, by Intel's Open Image Denoise: `Render.denoised`.

A network guesses the picture behind the noise: its error is unknown and its bits depend on the
machine. So a denoised render has no standard error, batches or film hash, bears the denoiser's name
in its statistics and in the header of its file, and `veriray.compare` refuses it. The package is
pyoidn, an optional one.
"""

from __future__ import annotations

from importlib import import_module
from typing import Any

import numpy as np
import numpy.typing as npt

from .extras import need
from .numeric import shown
from .settings import SETTINGS

Array = npt.NDArray[Any]
#: Statistics that a denoised picture keeps, beside the settings.
_KEPT = ("scene_sha256", "version", "renderer", "features", "device_name")


class DenoiserError(RuntimeError):
    """The denoiser cannot be loaded, or failed."""


def denoised(image: Array, albedo: Array | None, normal: Array | None) -> tuple[Array, str]:
    """A picture (H, W, 3) of radiance without noise, float32, and the name of the denoiser.

    albedo: (H, W, 3) in [0, 1]. normal: (H, W, 3) in [-1, 1], only together with albedo. Raises
    ValueError for arrays of another form or with numbers that are not finite, MissingPackageError
    without pyoidn, DenoiserError where it fails.
    """
    given = {"image": image, "albedo": albedo, "normal": normal}
    if normal is not None and albedo is None:
        raise ValueError("normal without albedo: the denoiser takes both, or albedo alone")
    arrays: dict[str, Array] = {}
    for name, values in given.items():
        if values is None:
            continue
        array = values if isinstance(values, np.ndarray) else np.empty(0, object)
        if array.dtype.kind not in "fiu" or array.shape != image.shape:
            raise ValueError(f"{name} is {shown(values)}, expected numbers {image.shape}")
        if not np.isfinite(array).all():
            at = [int(k) for k in np.argwhere(~np.isfinite(array))[0]]
            raise ValueError(f"{name}{at} = {array[tuple(at)]}; expected finite numbers")
        arrays[name] = np.ascontiguousarray(array, np.float32)
    need("denoising", "denoise")
    try:
        library = import_module("pyoidn")
    except (ImportError, OSError) as error:
        raise DenoiserError(f"the package pyoidn cannot be loaded: {error}") from None
    others = {name: arrays[name] for name in ("albedo", "normal") if name in arrays}
    try:
        made = library.denoise(arrays["image"], hdr=True, **others)
    except RuntimeError as error:
        raise DenoiserError(f"Open Image Denoise failed: {error}") from None
    version = getattr(getattr(library, "version", None), "oidn_version", "")
    return np.asarray(made, np.float32), f"Open Image Denoise {version}".strip()


def fields(render: Any, albedo: Array | None, normal: Array | None) -> dict[str, Any]:
    """The fields of a Render that is `render` denoised."""
    image, name = denoised(render.image, albedo, normal)
    kept = {key: render.stats[key] for key in (*_KEPT, *SETTINGS) if key in render.stats}
    return {
        "image": image,
        "stderr": np.full_like(image, np.nan),
        "batch_means": None,
        "film_sha256": "",
        "stats": {**kept, "denoiser": name, "denoised_from": render.film_sha256},
        "width": render.width,
        "height": render.height,
        "spp": render.spp,
        "seed": render.seed,
        "samples": render.samples,
        "features": render.features,
    }
