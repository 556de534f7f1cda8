"""Renders from disk: what EXR files hold, checked (layout: `veriray.image`)."""

from __future__ import annotations

import json
import os
from typing import Any

import numpy as np
import OpenEXR
from numpy.typing import NDArray

from .errors import ImageError
from .features import NUMBERS, FeatureImages
from .files import open_regular
from .numeric import path_text, whole
from .saving import INT_KEYS, TEXT_KEYS, library_silenced
from .settings import LEDGER_COLUMNS, MAX_BATCHES

MAX_BYTES = 1 << 31
_MAGIC = b"\x76\x2f\x31\x01"
_MAX_TILE = 1 << 26  # bytes of a tile, of a picture that is smaller
_MAX_SIDE = 1 << 16
_MAX_DEPTHS = 1 << 20
_MOST_CHANNELS = 3 * MAX_BATCHES + 128
_DEFLATE_LIMIT = 1100  # deflate cannot shrink data to less than 1/1032
_WHOLE = ("region", "samples")  # channels of integers
_NUMBERS = tuple(f"{name}.I" for name in NUMBERS)


def read(
    path: str | os.PathLike[str], max_bytes: int
) -> tuple[dict[str, Any], NDArray[np.uint32] | None, list[str]]:
    """The fields of a Render, masks (H, W) or None, and their names. Raises as `image.load`."""
    where = path_text("path", path, ImageError)
    max_bytes = whole("max_bytes", max_bytes, 0, 2**63, error=ImageError)
    header, channels = read_exr(path, max_bytes)
    if "R" not in channels:
        found = ", ".join(sorted(channels)[:9])
        raise ImageError(f"{where}: no channels R, G, B; found {found}")
    for name, values in channels.items():
        whole_ones = name in _WHOLE or name in _NUMBERS
        with np.errstate(invalid="ignore"):
            channels[name] = values.astype(np.uint32 if whole_ones else np.float32)
        other = values[channels[name] != values] if whole_ones else values[:0]
        if other.size:
            raise ImageError(f"{where}: channel {name!r} holds {other.flat[0]}; expected integers "
                             "from 0 to 2^32 - 1")  # fmt: skip
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
    fields = {
        "image": image,
        "stderr": np.full_like(image, np.nan) if stderr is None else stderr,
        "batch_means": np.stack(batches).astype(np.float64) if batches else None,
        "film_sha256": stats.pop("film_sha256"),
        "stats": stats,
        "width": image.shape[1],
        "height": image.shape[0],
        "spp": stats["spp"],
        "seed": stats["seed"],
        "samples": channels.get("samples"),
        "features": _features(header, channels, where),
    }
    return fields, channels.get("region"), names


def read_header(path: str | os.PathLike[str]) -> tuple[dict[str, Any], list[str]]:
    """Header of the first part, and names of its channels. Raises as `read_exr`."""
    header, _ = read_exr(path, MAX_BYTES, pixels=False)
    return header, [channel.name for channel in header["channels"]]


def read_exr(
    path: str | os.PathLike[str], max_bytes: int, *, every_part: bool = False, pixels: bool = True
) -> tuple[dict[str, Any], dict[str, NDArray[Any]]]:
    """Header and channels (name -> (H, W) float16, float32 or uint32) of the first part.

    max_bytes: of all decoded channels together, as float32. every_part: also the channels of other
    parts, as "PART.NAME" where the name alone is taken or has no layer; their sizes may differ.
    pixels: else no channels. Raises ImageError for a file that is damaged or larger, OSError for
    one that cannot be read.
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
                headers = [part.header for part in OpenEXR.File(file, header_only=True).parts]
            if not headers:
                raise ImageError(f"{where}: damaged: it has no part")
            header, room = headers[0], max_bytes
            for key, value in header.items():
                if key.startswith("veriray.") and not isinstance(value, str):
                    raise ImageError(f"{where}: header attribute {key!r} is not a string")
            for one in headers:  # the library decodes all of them
                room -= _check_header(one, size, room, where)
            if not pixels:
                return header, {}
            file.seek(0)
            with library_silenced() as printed:  # a damaged part is only printed about
                parts = OpenEXR.File(file, separate_channels=True).parts
            if printed.getvalue():
                raise ValueError(printed.getvalue())
            found = {name: np.asarray(c.pixels) for name, c in parts[0].channels.items()}
            for part in parts[1:] if every_part else ():
                for name, channel in part.channels.items():
                    plain = "." in name and name not in found
                    name = name if plain else f"{part.name()}.{name}"
                    found[name] = np.asarray(channel.pixels)
        except (ImageError, MemoryError):
            raise
        except Exception as error:  # the library's errors have no common base class
            reason = " ".join(str(error).split())
            raise ImageError(f"{where}: not a readable OpenEXR file: {reason}") from error
    shape = next((values.shape for values in found.values()), ())
    for name, values in found.items():
        other = values.shape != shape and not every_part
        if other or values.ndim != 2 or values.dtype not in (np.float16, np.float32, np.uint32):
            raise ImageError(f"{where}: channel {name!r} is {values.dtype} {values.shape}; "
                             f"expected float32 {shape}")  # fmt: skip
    return header, found


def _check_header(header: dict[str, Any], size: int, max_bytes: int, where: str) -> int:
    """Bytes of a part's decoded pixels. Raises ImageError for what is beyond the limits."""
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
    return need


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
    lamps = _json(header, "veriray.light_groups", dict, where)
    if not all(isinstance(v, list) and all(isinstance(x, str) for x in v) for v in lamps.values()):
        raise ImageError(f"{where}: veriray.light_groups is not lists of names")
    spp = _integer(text, "veriray.feature_spp", where)
    rows = _json(header, "veriray.motion_to", list, where) or None
    try:
        return FeatureImages._of_channels(channels, spp, lamps, rows)
    except ValueError as error:
        raise ImageError(f"{where}: veriray.{error}") from None


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
