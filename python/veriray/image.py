"""Pictures on disk: EXR, the file of record, and PNG, a display copy.

Layout of an EXR file, version 1 (any program that writes it can be compared by `veriray.compare`)
--------------------------------------------------------------------------------------------------
One part, scan lines, not compressed (of a render's noise RLE saves 5 % and ZIP 8 %, in 1.6 and 4.5
times the time), dataWindow = displayWindow = (0, 0)-(W-1, H-1), row 0 = top.
All lengths below: H rows, W columns. "required" is all that `load` insists on.

Channels, FLOAT (32 bits) unless said otherwise, linear scene-referred radiance:
- `R` `G` `B`                        required; mean over all samples of the pixel.
- `stderr.R` `stderr.G` `stderr.B`   standard error of that mean: sqrt(s^2 / spp), s^2 with spp - 1.
- `batch.000.R` ... `batch.NNN.B`    batch means; batch k of B is the mean of the samples
  [k spp/B, (k+1) spp/B) of the pixel. Three digits, B <= 1000, B divides spp, no gaps. The means
  are float64 in memory and float32 here: the loss is the rounding, 6e-8 of a batch mean, far below
  its own standard error and below the margin (1e-5) of every test in `veriray.compare`.
- `samples`                          UINT (32 bits), optional: samples of each pixel, where they
  differ.
- `region`                           UINT (32 bits), optional: what the ray through the pixel's
  centre hits first, k + 1 for shape k of the scene file in its order, 0 for nothing.

Header attributes, all of them strings, each optional (a missing one reads as empty or 0):
- `veriray.format` "1"; `veriray.renderer` program that made it: "veriray", "reference", ...
- `veriray.version`, `veriray.device`, `veriray.scheduler`, `veriray.sampler`: free text
- `veriray.scene_sha256`, `veriray.film_sha256`: 64 hexadecimal digits
- `veriray.seed`, `veriray.spp`, `veriray.max_depth`, `veriray.rr_depth`: decimal integers
- `veriray.batches`: B as a decimal integer, "0" for none; `veriray.seconds`: decimal number
- `veriray.features`: JSON list of strings
- `veriray.ledger`: JSON object, column name -> list of integers, one per depth; the columns are
  live, escaped, emitter_end, absorbed, rr_killed, depth_cut, invalid, shadow_visible,
  shadow_occluded; lists of one length, trailing all-zero depths left out
- `veriray.regions`: JSON list of names; entry k names the value k + 1 of channel `region`
- `veriray.stats`: JSON object, whatever else `Render.stats` holds
"""

from __future__ import annotations

import contextlib
import io
import json
import os
import sys
import threading
from collections.abc import Iterator
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
import OpenEXR

from veriray.errors import printable
from veriray.files import open_regular, replacing
from veriray.numeric import number, path_text, texts, whole
from veriray.rendering import LEDGER_COLUMNS, Render
from veriray.settings import HEADER, MAX_BATCHES, SETTINGS

if TYPE_CHECKING:
    from numpy.typing import NDArray

_MAGIC = b"\x76\x2f\x31\x01"
_MAX_SIDE = 1 << 16
_MAX_DEPTHS = 1 << 20
_MAX_BYTES = 1 << 31
_DEFLATE_LIMIT = 1100  # deflate cannot shrink data to less than 1/1032
_HEADER = [(name, setting.is_text) for name, setting in SETTINGS.items() if setting.kept == HEADER]
_TEXT_KEYS = (
    "scene_sha256",
    "film_sha256",
    *(name for name, is_text in _HEADER if is_text),
    "version",
    "renderer",
)
_INT_KEYS = tuple(name for name, is_text in _HEADER if not is_text)
_WHOLE = ("region", "samples")  # channels of integers


class ImageError(ValueError):
    """A file that cannot be read as a render, or a picture that cannot be written as asked."""

    def __init__(self, message: str) -> None:
        super().__init__(printable(message))


def save(
    render: Render,
    path: str | os.PathLike[str],
    *,
    exposure: float = 0.0,
    regions: NDArray[np.integer[Any]] | None = None,
    region_names: list[str] | None = None,
) -> None:
    """Write a render to `path`: everything as `.exr`, a display copy as `.png`.

    Args:
        render: the render; its `stats` go into the header (layout at the top of this module).
        path: ends in `.exr` or `.png`. The file is written beside its place and renamed, so that
            a failure leaves an earlier file as it was and no partial file.
        exposure: stops, for PNG only (see `to_srgb8`).
        regions: (H, W) integers, for EXR only: primary-hit object masks, 0 = nothing.
        region_names: name of value k + 1 at index k.

    Raises:
        ImageError: another suffix; arrays of the wrong shape.
        OSError: the file cannot be written (the message names it).
    """
    if not isinstance(render, Render):
        raise TypeError(f"render is {type(render).__name__}, expected a Render")
    suffix = Path(path_text("path", path, ImageError)).suffix.lower()
    if suffix == ".png":
        save_png(render.image, path, exposure=exposure)
    elif suffix == ".exr":
        _save_exr(render, path, regions, region_names)
    else:
        raise ImageError(f"{os.fspath(path)}: suffix {suffix!r}; expected .exr or .png")


def to_srgb8(image: NDArray[Any], exposure: float = 0.0) -> NDArray[np.uint8]:
    """Display transform: (H, W, 3) linear radiance to (H, W, 3) sRGB bytes.

    Multiplies by 2^exposure, clips to [0, 1], applies the sRGB curve (IEC 61966-2-1, 1999) and
    rounds. Pixels that are not finite become magenta, so that no display hides them.
    """
    exposure = number("exposure", exposure, -1000, 1000, error=ImageError)
    values = _numbers(image, "image").astype(np.float64)
    if values.shape[-1:] != (3,):
        raise ImageError(f"image: shape {values.shape}; expected (H, W, 3)")
    finite = np.asarray(np.isfinite(values).all(axis=-1))
    with np.errstate(over="ignore", invalid="ignore"):
        x = np.clip(np.where(finite[..., None], values, 0.0) * 2.0**exposure, 0.0, 1.0)
    curve = np.where(x <= 0.0031308, 12.92 * x, 1.055 * x ** (1 / 2.4) - 0.055)
    out = np.round(curve * 255).astype(np.uint8)
    out[~finite] = (255, 0, 255)
    return out


def save_png(image: NDArray[Any], path: str | os.PathLike[str], *, exposure: float = 0.0) -> None:
    """Write (H, W, 3) linear radiance as an 8-bit sRGB PNG: for eyes, never for comparisons.

    Raises:
        ImageError: the array is not (H, W, 3) with H, W >= 1, or the exposure is not finite.
        OSError: the file cannot be written (the message names it).
    """
    from PIL import Image, PngImagePlugin

    picture = Image.fromarray(to_srgb8(_picture(image, "image", None), exposure))
    note = PngImagePlugin.PngInfo()
    note.add_text("Comment", f"veriray display copy, sRGB, exposure {exposure:g} stops")
    with replacing(path_text("path", path, ImageError)) as file:
        picture.save(file, format="png", pnginfo=note)


def load(path: str | os.PathLike[str], *, max_bytes: int = _MAX_BYTES) -> Render:
    """Read a render from an EXR file (layout at the top of this module).

    Nothing in the file is trusted: sizes are checked before pixels are read, and text is parsed
    as JSON or a number. A render without standard errors gets NaN there. Pixels that are not
    finite are kept and counted in `stats["nonfinite_pixels"]`.

    Args:
        path: the file.
        max_bytes: largest size of all decoded channels together.

    Raises:
        ImageError: not such a file, damaged, or beyond the limits; the message names the file.
        OSError: the file cannot be opened or read.
    """
    return load_with_regions(path, max_bytes=max_bytes)[0]


def load_with_regions(
    path: str | os.PathLike[str], *, max_bytes: int = _MAX_BYTES
) -> tuple[Render, NDArray[np.uint32] | None, list[str]]:
    """As `load`, with the object masks: (H, W) uint32 (0 = nothing) or None, and their names."""
    where = path_text("path", path, ImageError)
    max_bytes = whole("max_bytes", max_bytes, 0, 2**63, error=ImageError)
    header, channels = _read_exr(path, max_bytes)
    image = _group(channels, "", where)
    assert image is not None
    stderr = _group(channels, "stderr.", where)
    named = sum(name.startswith("batch.") for name in channels)
    batches = [g for k in range(min(-(-named // 3), MAX_BATCHES))
               if (g := _group(channels, f"batch.{k:03d}.", where)) is not None]  # fmt: skip
    stats = _stats(header, where)
    if named != 3 * len(batches) or any(f"batch.{k:03d}.R" not in channels
                                        for k in range(len(batches))):  # fmt: skip
        raise ImageError(f"{where}: channels batch.NNN.R/G/B are not numbered 000, 001, ...")
    if batches and stats["spp"] % len(batches):
        raise ImageError(f"{where}: {len(batches)} batches do not divide spp {stats['spp']}")
    bad = int(np.count_nonzero(~np.isfinite(image).all(axis=-1)))
    if bad:
        stats["nonfinite_pixels"] = bad
    names = [str(name) for name in _json(header, "veriray.regions", list, where)]
    render = Render(
        image=image,
        stderr=np.full_like(image, np.nan) if stderr is None else stderr,
        batch_means=np.stack(batches).astype(np.float64) if batches else None,
        film_sha256=stats.pop("film_sha256"),
        stats=stats,
        width=image.shape[1],
        height=image.shape[0],
        spp=stats["spp"],
        seed=stats["seed"],
        samples=channels.get("samples"),
    )
    return render, channels.get("region"), names


def _save_exr(
    render: Render,
    path: str | os.PathLike[str],
    regions: NDArray[np.integer[Any]] | None,
    region_names: list[str] | None,
) -> None:
    image = _picture(render.image, "image", None)
    channels: dict[str, NDArray[Any]] = {}

    def add(prefix: str, picture: NDArray[Any], name: str) -> None:
        values = _picture(picture, name, image.shape[:2])
        for c, letter in enumerate("RGB"):
            channels[prefix + letter] = np.ascontiguousarray(values[..., c], np.float32)

    add("", image, "image")
    if render.stderr is not None:
        add("stderr.", render.stderr, "stderr")
    batches = [] if render.batch_means is None else list(render.batch_means)
    if len(batches) > MAX_BATCHES:
        raise ImageError(f"{len(batches)} batches; an EXR file holds at most {MAX_BATCHES}")
    for k, batch in enumerate(batches):
        add(f"batch.{k:03d}.", batch, f"batch_means[{k}]")
    if render.samples is not None:
        channels["samples"] = np.ascontiguousarray(render.samples, np.uint32)
    stats = dict(render.stats)
    stats.update(film_sha256=render.film_sha256, spp=render.spp, seed=render.seed)
    own = {*_TEXT_KEYS, *_INT_KEYS, "seconds", "features", "ledger"}
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
    for key in _TEXT_KEYS[:-1]:
        header[f"veriray.{key}"] = str(stats.get(key) or "")
    for key in _INT_KEYS:
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
    with replacing(path) as file:
        try:
            with _library_silenced():
                OpenEXR.File(header, channels).write(file)
        except (RuntimeError, ValueError, TypeError) as error:
            raise OSError(f"cannot be written as EXR: {error}") from error


_STDERR = threading.RLock()  # held by a fork too: a child must not get the empty stderr
os.register_at_fork(
    before=_STDERR.acquire, after_in_parent=_STDERR.release, after_in_child=_STDERR.release
)


@contextlib.contextmanager
def _library_silenced() -> Iterator[io.StringIO]:
    """Gathers what OpenEXR's Python code prints and drops what its C code writes on descriptor 2.

    There is no switch for it. What other threads write on stderr meanwhile is lost too.
    """
    with _STDERR, contextlib.ExitStack() as stack:
        if sys.__stderr__ is not None:  # else descriptor 2 was closed, and may be any file
            stderr = os.dup(2)
            stack.callback(os.close, stderr)
            stack.callback(os.dup2, stderr, 2)
            with open(os.devnull, "wb") as null:
                os.dup2(null.fileno(), 2)
        yield stack.enter_context(contextlib.redirect_stdout(io.StringIO()))


def _read_exr(
    path: str | os.PathLike[str], max_bytes: int
) -> tuple[dict[str, Any], dict[str, NDArray[Any]]]:
    """Header and channels (name -> (H, W) float32, `region` uint32) of the first part."""
    where = os.fspath(path)
    with open_regular(path) as file:
        size = os.fstat(file.fileno()).st_size
        magic = file.read(8)
        if magic.startswith(b"\x89PNG"):
            raise ImageError(f"{where}: a PNG is a display copy and cannot be read back; "
                             "use the EXR file")  # fmt: skip
        if magic[:4] != _MAGIC:
            raise ImageError(f"{where}: not an OpenEXR file")
        try:
            file.seek(0)
            with _library_silenced():
                header = OpenEXR.File(file, header_only=True).header()
            for key, value in header.items():
                if key.startswith("veriray.") and not isinstance(value, str):
                    raise ImageError(f"{where}: header attribute {key!r} is not a string")
            _check_header(header, size, max_bytes, where)
            file.seek(0)
            with _library_silenced() as printed:  # a damaged part is only printed about
                parts = OpenEXR.File(file, separate_channels=True).channels()
            if printed.getvalue():
                raise ValueError(printed.getvalue())
            pixels = {name: np.asarray(channel.pixels) for name, channel in parts.items()}
        except (ImageError, MemoryError):
            raise
        except Exception as error:  # the library's errors have no common base class
            reason = " ".join(str(error).split())
            raise ImageError(f"{where}: not a readable OpenEXR file: {reason}") from error
    if "R" not in pixels:
        raise ImageError(f"{where}: no channels R, G, B; found {', '.join(sorted(pixels)[:9])}")
    shape = pixels["R"].shape
    for name, values in pixels.items():
        if values.shape != shape or values.dtype not in (np.float16, np.float32, np.uint32):
            raise ImageError(f"{where}: channel {name!r} is {values.dtype} {values.shape}; "
                             f"expected float32 {shape}")  # fmt: skip
        pixels[name] = values.astype(np.uint32 if name in _WHOLE else np.float32)
    return header, pixels


def _check_header(header: dict[str, Any], size: int, max_bytes: int, where: str) -> None:
    low, high = (np.asarray(corner, np.int64) for corner in header["dataWindow"])
    width, height = (int(x) for x in high - low + 1)
    if not (1 <= width <= _MAX_SIDE and 1 <= height <= _MAX_SIDE):
        raise ImageError(f"{where}: {width} x {height} pixels; expected 1 to {_MAX_SIDE} a side")
    channels = header["channels"]
    if len(channels) > 3 * MAX_BATCHES + 64:
        raise ImageError(f"{where}: {len(channels)} channels; at most {3 * MAX_BATCHES + 64}")
    need = 4 * width * height * len(channels)
    if need > max_bytes:
        raise ImageError(f"{where}: {need} bytes of pixels; the limit is {max_bytes} (max_bytes)")
    if need > _DEFLATE_LIMIT * size:
        raise ImageError(f"{where}: damaged: {need} bytes of pixels cannot come from {size} bytes")


def _group(
    channels: dict[str, NDArray[Any]], prefix: str, where: str
) -> NDArray[np.float32] | None:
    """The three channels of a prefix as (H, W, 3), or None if none of them is there."""
    found = [prefix + letter in channels for letter in "RGB"]
    if not any(found):
        return None
    if not all(found):
        raise ImageError(f"{where}: channels {prefix}R, {prefix}G, {prefix}B are not all there")
    return np.stack([channels[prefix + letter] for letter in "RGB"], axis=-1)


def _stats(header: dict[str, Any], where: str) -> dict[str, Any]:
    """`Render.stats` from the header; the attributes of their own win over `veriray.stats`."""
    stats = _json(header, "veriray.stats", dict, where)
    for key in _TEXT_KEYS:
        stats[key] = header.get(f"veriray.{key}", "")
    for key in _INT_KEYS:
        text = header.get(f"veriray.{key}")
        stats[key] = None if text is None else _integer(text, f"veriray.{key}", where)
    stats["spp"], stats["seed"] = stats["spp"] or 0, stats["seed"] or 0
    try:
        seconds = float(header.get("veriray.seconds", 0.0))
    except ValueError:
        raise ImageError(f"{where}: veriray.seconds is not a number") from None
    if not 0 <= seconds < np.inf:
        raise ImageError(f"{where}: veriray.seconds = {seconds} is not in [0, inf)")
    stats["seconds"] = abs(seconds)  # of -0 too
    stats["features"] = [str(x) for x in _json(header, "veriray.features", list, where)]
    ledger = _json(header, "veriray.ledger", dict, where)
    columns = {name: ledger[name] for name in LEDGER_COLUMNS if name in ledger}
    for name, column in columns.items():
        if (not isinstance(column, list) or len(column) > _MAX_DEPTHS
                or len(column) != len(columns.get("live", column))
                or not all(type(x) is int and 0 <= x < 1 << 64 for x in column)):  # fmt: skip
            raise ImageError(f"{where}: veriray.ledger: column {name!r} is not a list of counts "
                             "as long as 'live'")  # fmt: skip
    stats["ledger"] = columns
    return stats


def _integer(text: str, key: str, where: str) -> int:
    low = -1 if key.endswith("depth") else 0
    try:
        value = int(text)
    except ValueError:
        raise ImageError(f"{where}: {key} is {text[:24]!r}; expected an integer") from None
    if not low <= value < 1 << 64:
        raise ImageError(f"{where}: {key} is {value}; expected {low} to 2^64 - 1")
    return value


def _json(header: dict[str, Any], key: str, kind: type, where: str) -> Any:
    text = header.get(key, "")
    try:
        value = json.loads(text) if text else kind()
    except (ValueError, RecursionError) as error:
        raise ImageError(f"{where}: {key} is not JSON: {error}") from error
    if not isinstance(value, kind):
        raise ImageError(f"{where}: {key} is not a JSON {kind.__name__}")
    return value


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
