"""Writes pictures: EXR, the file of record (layout: `veriray.image`), and PNG, a display copy."""

from __future__ import annotations

import contextlib
import io
import json
import os
import sys
import threading
from collections.abc import Iterator, Mapping
from typing import Any

import numpy as np
import OpenEXR
from numpy.typing import NDArray

from .errors import ImageError
from .files import replacing
from .numeric import number, path_text, texts
from .settings import HEADER, MAX_BATCHES, MAX_STOPS, SETTINGS

_HEADER = [(name, setting.is_text) for name, setting in SETTINGS.items() if setting.kept == HEADER]
TEXT_KEYS = (
    "scene_sha256",
    "film_sha256",
    *(name for name, is_text in _HEADER if is_text),
    "version",
    "renderer",
)
INT_KEYS = tuple(name for name, is_text in _HEADER if not is_text)


def to_srgb8(image: NDArray[Any], exposure: float = 0.0) -> NDArray[np.uint8]:
    """Display transform: (H, W, 3) linear radiance to (H, W, 3) sRGB bytes.

    Multiplies by 2^exposure, clips to [0, 1], applies the sRGB curve (IEC 61966-2-1, 1999) and
    rounds. Pixels that are not finite become magenta, so that no display hides them.
    """
    exposure = number("exposure", exposure, -MAX_STOPS, MAX_STOPS, error=ImageError)
    values = _numbers(image, "image").astype(np.float64)
    if values.shape[-1:] != (3,):
        raise ImageError(f"image: shape {values.shape}; expected (H, W, 3)")
    finite = np.asarray(np.isfinite(values).all(axis=-1))
    with np.errstate(over="ignore", invalid="ignore"):
        x = np.clip(np.where(finite[..., None], values, 0.0) * 2.0**exposure, 0.0, 1.0)
    curve = np.where(x <= 0.0031308, 12.92 * x, 1.055 * x ** (1 / 2.4) - 0.055)
    out: NDArray[np.uint8] = np.round(curve * 255).astype(np.uint8)
    out[~finite] = (255, 0, 255)
    return out


def save_png(
    image: NDArray[Any], path: str | os.PathLike[str], *, exposure: float = 0.0, note: str = ""
) -> None:
    """Write (H, W, 3) linear radiance as an 8-bit sRGB PNG: to look at, never to compare.

    note: more of the file's comment, near its beginning.

    Raises:
        ImageError: the array is not (H, W, 3) with H, W >= 1, or the exposure is not finite.
        OSError: the file cannot be written (the message names it).
    """
    from PIL import Image, PngImagePlugin

    picture = Image.fromarray(to_srgb8(_picture(image, "image", None), exposure))
    info = PngImagePlugin.PngInfo()
    comment = f"veriray display copy, sRGB, exposure {exposure:g} stops"
    info.add_text("Comment", f"{comment}; {note}" if note else comment)
    with replacing(path_text("path", path, ImageError)) as file:
        picture.save(file, format="png", pnginfo=info)


def save_exr(
    path: str | os.PathLike[str],
    image: NDArray[Any],
    stderr: NDArray[Any] | None,
    batch_means: NDArray[Any] | None,
    samples: NDArray[Any] | None,
    stats: dict[str, Any],
    regions: NDArray[np.integer[Any]] | None = None,
    region_names: list[str] | None = None,
    more: Mapping[str, NDArray[Any]] | None = None,
    attributes: Mapping[str, str] | None = None,
) -> None:
    """Write an EXR file of a render's fields; stats must hold film_sha256, spp and seed.

    more, attributes: further channels, (H, W) float32 or uint32, and attributes of the header.

    regions, region_names, errors: as of `veriray.Render.save`.
    """
    image = _picture(image, "image", None)
    channels: dict[str, NDArray[Any]] = {}

    def add(prefix: str, picture: NDArray[Any], name: str) -> None:
        values = _picture(picture, name, image.shape[:2])
        for c, letter in enumerate("RGB"):
            channels[prefix + letter] = np.ascontiguousarray(values[..., c], np.float32)

    add("", image, "image")
    if stderr is not None:
        add("stderr.", stderr, "stderr")
    batches = [] if batch_means is None else list(batch_means)
    if len(batches) > MAX_BATCHES:
        raise ImageError(f"{len(batches)} batches; an EXR file holds at most {MAX_BATCHES}")
    for k, batch in enumerate(batches):
        add(f"batch.{k:03d}.", batch, f"batch_means[{k}]")
    if samples is not None:
        channels["samples"] = np.ascontiguousarray(samples, np.uint32)
    own = {*TEXT_KEYS, *INT_KEYS, "seconds", "features", "ledger"}
    header: dict[str, Any] = {
        "compression": OpenEXR.NO_COMPRESSION,
        "type": OpenEXR.scanlineimage,
        "veriray.format": "1",
        "veriray.renderer": str(stats.get("renderer") or "veriray"),
        "veriray.batches": str(len(batches)),
        "veriray.seconds": repr(float(stats.get("seconds") or 0.0)),
        "veriray.features": _dumps(list(stats.get("features") or [])),
        "veriray.ledger": _dumps(stats.get("ledger") or {}),
        "veriray.stats": _dumps({key: stats[key] for key in stats if key not in own}),
    }
    for key in TEXT_KEYS[:-1]:
        header[f"veriray.{key}"] = str(stats.get(key) or "")
    if stats.get("denoiser"):
        header["veriray.denoiser"] = str(stats["denoiser"])
    for key in INT_KEYS:
        if stats.get(key) is not None:
            header[f"veriray.{key}"] = str(int(stats[key]))
    if regions is not None:
        mask = _numbers(regions, "regions")
        if (
            mask.dtype.kind not in "iu"
            or mask.shape != image.shape[:2]
            or mask.min() < 0
            or mask.max() >= 1 << 32
        ):
            raise ImageError(f"regions: shape {mask.shape}; expected {image.shape[:2]}, 0..2^32-1")
        channels["region"] = np.ascontiguousarray(mask, np.uint32)
        header["veriray.regions"] = _dumps(
            texts("region_names", [] if region_names is None else region_names, ImageError)
        )
    for name, values in (more or {}).items():
        if values.shape != image.shape[:2]:
            raise ImageError(f"{name}: shape {values.shape}; expected {image.shape[:2]}")
        channels[name] = values
    _write(path, {**header, **(attributes or {})}, channels)


def save_channels(
    path: str | os.PathLike[str], channels: dict[str, NDArray[Any]], attributes: dict[str, str]
) -> None:
    """Write channels, (H, W) float32 or uint32 each, as an EXR file without a picture.

    Raises ImageError if the suffix is not .exr, OSError if the file cannot be written.
    """
    if not path_text("path", path, ImageError).lower().endswith(".exr"):
        raise ImageError(f"{os.fspath(path)}: expected the suffix .exr")
    kind = {"compression": OpenEXR.ZIP_COMPRESSION, "type": OpenEXR.scanlineimage}
    _write(path, {**kind, **attributes}, channels)


def _write(
    path: str | os.PathLike[str], header: dict[str, Any], channels: dict[str, NDArray[Any]]
) -> None:
    with replacing(path) as file:
        try:
            with library_silenced():
                OpenEXR.File(header, channels).write(file)
        except (RuntimeError, ValueError, TypeError) as error:
            raise OSError(f"cannot be written as EXR: {error}") from error


_STDERR = threading.RLock()  # also while forking: a child must not inherit the silenced stderr
os.register_at_fork(
    before=_STDERR.acquire, after_in_parent=_STDERR.release, after_in_child=_STDERR.release
)


@contextlib.contextmanager
def library_silenced() -> Iterator[io.StringIO]:
    """Gathers what OpenEXR's Python code prints and drops what its C code writes on descriptor 2.

    OpenEXR has no switch for this. What other threads write to stderr meanwhile is lost, too.
    """
    with _STDERR, contextlib.ExitStack() as stack:
        if sys.__stderr__ is not None:  # else descriptor 2 was closed, and may be any file
            stderr = os.dup(2)
            stack.callback(os.close, stderr)
            stack.callback(os.dup2, stderr, 2)
            with open(os.devnull, "wb") as null:
                os.dup2(null.fileno(), 2)
        yield stack.enter_context(contextlib.redirect_stdout(io.StringIO()))


def _dumps(value: object) -> str:
    def plain(item: object) -> object:
        return item.tolist() if isinstance(item, (np.ndarray, np.generic)) else str(item)

    return json.dumps(value, default=plain, separators=(",", ":"))


def _numbers(values: Any, name: str) -> NDArray[Any]:
    try:
        array = np.asarray(values)
    except Exception as error:  # of any object's own conversion
        raise ImageError(f"{name}: cannot be read as numbers: {error}") from None
    if array.dtype.kind not in "iufb":
        raise ImageError(f"{name}: dtype {array.dtype}; expected numbers")
    return array


def _picture(values: Any, name: str, shape: tuple[int, ...] | None) -> NDArray[Any]:
    array = _numbers(values, name)
    if array.ndim != 3 or array.shape[2] != 3 or 0 in array.shape:
        raise ImageError(f"{name}: shape {array.shape}; expected (H, W, 3) with H, W >= 1")
    if shape is not None and array.shape[:2] != shape:
        raise ImageError(f"{name}: shape {array.shape}; expected {(*shape, 3)}")
    return array
