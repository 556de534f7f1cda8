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
- `veriray.feature_spp`: decimal integer, samples of the feature images' means; then channels
  `LAYER.X` and `stderr.LAYER.X` (`veriray.features.LAYERS`): FLOAT, but UINT for numbers
- `veriray.regions`: JSON list of names; entry k names the value k + 1 of channel `region`
- `veriray.stats`: JSON object, whatever else `Render.stats` holds
"""

from __future__ import annotations

import json
import os
from typing import Any

import numpy as np
import OpenEXR
from numpy.typing import NDArray

from .errors import ImageError as ImageError
from .features import NUMBERS, FeatureImages
from .files import open_regular
from .numeric import path_text, whole
from .picture import LEDGER_COLUMNS, Render
from .saving import INT_KEYS, TEXT_KEYS, library_silenced
from .saving import save_png as save_png
from .saving import to_srgb8 as to_srgb8
from .settings import MAX_BATCHES

_MAGIC = b"\x76\x2f\x31\x01"
_MAX_TILE = 1 << 26  # bytes of a tile, of a picture that is smaller
_MAX_SIDE = 1 << 16
_MAX_DEPTHS = 1 << 20
_MAX_BYTES = 1 << 31
_MOST_CHANNELS = 3 * MAX_BATCHES + 128
_DEFLATE_LIMIT = 1100  # deflate cannot shrink data to less than 1/1032
_WHOLE = ("region", "samples")  # channels of integers
_NUMBERS = tuple(f"{name}.I" for name in NUMBERS)


def save(render: Render, path: str | os.PathLike[str], **options: Any) -> None:
    """Write a render to `path`: `render.save`. Raises TypeError for what is no Render."""
    if not isinstance(render, Render):
        raise TypeError(f"render is {type(render).__name__}, expected a Render")
    render.save(path, **options)


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
    header, channels = read_exr(path, max_bytes)
    if "R" not in channels:
        found = ", ".join(sorted(channels)[:9])
        raise ImageError(f"{where}: no channels R, G, B; found {found}")
    for name, values in channels.items():
        whole_ones = name in _WHOLE or name in _NUMBERS
        channels[name] = values.astype(np.uint32 if whole_ones else np.float32)
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
        features=_features(header, channels, where),
    )
    return render, channels.get("region"), names


def read_exr(
    path: str | os.PathLike[str], max_bytes: int
) -> tuple[dict[str, Any], dict[str, NDArray[Any]]]:
    """Header and channels (name -> (H, W) float16, float32 or uint32) of the first part.

    max_bytes: of all decoded channels together, as float32. Raises ImageError for a file that is
    damaged or larger, OSError for one that cannot be read.
    """
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
            with library_silenced():
                every = OpenEXR.File(file, header_only=True).parts
                headers = [part.header for part in every]
            if not headers:
                raise ImageError(f"{where}: damaged: it has no part")
            header = headers[0]
            for key, value in header.items():
                if key.startswith("veriray.") and not isinstance(value, str):
                    raise ImageError(f"{where}: header attribute {key!r} is not a string")
            for one in headers:  # the library decodes all of them
                _check_header(one, size, max_bytes, where)
            file.seek(0)
            with library_silenced() as printed:  # a damaged part is only printed about
                parts = OpenEXR.File(file, separate_channels=True).channels()
            if printed.getvalue():
                raise ValueError(printed.getvalue())
            pixels = {name: np.asarray(channel.pixels) for name, channel in parts.items()}
        except (ImageError, MemoryError):
            raise
        except Exception as error:  # the library's errors have no common base class
            reason = " ".join(str(error).split())
            raise ImageError(f"{where}: not a readable OpenEXR file: {reason}") from error
    shape = next((values.shape for values in pixels.values()), ())
    for name, values in pixels.items():
        if values.shape != shape or values.dtype not in (np.float16, np.float32, np.uint32):
            raise ImageError(f"{where}: channel {name!r} is {values.dtype} {values.shape}; "
                             f"expected float32 {shape}")  # fmt: skip
    return header, pixels


def _check_header(header: dict[str, Any], size: int, max_bytes: int, where: str) -> None:
    low, high = (np.asarray(corner, np.int64) for corner in header["dataWindow"])
    width, height = (int(x) for x in high - low + 1)
    if not (1 <= width <= _MAX_SIDE and 1 <= height <= _MAX_SIDE):
        raise ImageError(f"{where}: {width} x {height} pixels; expected 1 to {_MAX_SIDE} a side")
    channels = header["channels"]
    if len(channels) > _MOST_CHANNELS:
        raise ImageError(f"{where}: {len(channels)} channels; at most {_MOST_CHANNELS}")
    need = 4 * width * height * len(channels)
    if need > max_bytes:
        raise ImageError(f"{where}: {need} bytes of pixels; the limit is {max_bytes} (max_bytes)")
    if need > _DEFLATE_LIMIT * size:
        raise ImageError(f"{where}: damaged: {need} bytes of pixels cannot come from {size} bytes")
    tiles = header.get("tiles")
    if tiles is not None:  # the library takes memory for whole ones
        room = 4 * len(channels) * tiles.xSize * tiles.ySize
        if room > max(need, _MAX_TILE):
            raise ImageError(
                f"{where}: damaged: tiles of {tiles.xSize} x {tiles.ySize} for {width} x {height} "
                "pixels"
            )


def _group(
    channels: dict[str, NDArray[Any]], prefix: str, where: str
) -> NDArray[np.float32] | None:
    """The three channels of a prefix as (H, W, 3), or None if none of them is there."""
    found = [prefix + letter in channels for letter in "RGB"]
    if not any(found):
        return None
    if not all(found):
        raise ImageError(f"{where}: channels {prefix}R, {prefix}G, {prefix}B are not all there")
    picture: NDArray[np.float32] = np.stack([channels[prefix + c] for c in "RGB"], axis=-1)
    return picture


def _features(
    header: dict[str, Any], channels: dict[str, NDArray[Any]], where: str
) -> FeatureImages:
    """The feature images of a file that says that it has them."""
    text = header.get("veriray.feature_spp")
    if text is None:
        return FeatureImages()
    return FeatureImages._of_channels(channels, _integer(text, "veriray.feature_spp", where))


def _stats(header: dict[str, Any], where: str) -> dict[str, Any]:
    """`Render.stats` from the header; the attributes of their own win over `veriray.stats`."""
    stats: dict[str, Any] = _json(header, "veriray.stats", dict, where)
    for key in TEXT_KEYS:
        stats[key] = header.get(f"veriray.{key}", "")
    for key in INT_KEYS:
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
