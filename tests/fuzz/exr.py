"""EXR files: pictures, and what a render keeps in them."""

from __future__ import annotations

import json
import random
import struct
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from tests.fuzz.contract import Target
from veriray import image
from veriray.image import ImageError
from veriray.rendering import Render

_TEXTS = (
    "", "0", "-1", "1", "18446744073709551615", "18446744073709551616", "1e400", "nan", "[]", "{}",
    '{"live":[1,2]}', '{"live":[1],"escaped":[1,2]}', '["a"]', "[" * 1000, "1" * 5000, "null",
    '{"a":NaN}', '{"spp":"x"}', '{"ledger":1}', "0x10", " 7 ", "1_0", "\u0661", "inf",
)  # fmt: skip
_KEYS = (
    "seed", "spp", "max_depth", "rr_depth", "batches", "seconds", "features", "ledger", "regions",
    "stats", "scene_sha256", "film_sha256", "device", "scheduler", "version", "renderer", "format",
)  # fmt: skip


def _load(path: Path) -> object:
    return (*image.load_with_regions(path), path.with_name("again.exr"))


def _valid(loaded: tuple[Render, NDArray[np.uint32] | None, list[str], Path]) -> str:
    render, regions, names, path = loaded
    shape = (render.height, render.width, 3)
    if render.image.shape != shape or render.image.dtype != np.float32:
        return "its picture has another shape"
    if render.stderr.shape != shape:
        return "its errors have another shape"
    means = render.batch_means
    if means is not None and (means.shape[1:] != shape or render.spp % len(means)):
        return "its batches do not fit"
    if not (0 <= render.spp < 1 << 64 and 0 <= render.seed < 1 << 64):
        return "spp or seed is out of range"
    if any(x < 0 for column in render.stats["ledger"].values() for x in column):
        return "its ledger has a negative count"
    try:
        image.save(render, path, regions=regions, region_names=names)
        again = image.load(path)
    except Exception as error:
        return f"it cannot be saved and loaded again: {type(error).__name__}: {error}"
    same = np.array_equal(render.image, again.image, equal_nan=True)
    same &= (render.spp, render.seed) == (again.spp, again.seed)
    first, second = ({**r.stats, "renderer": ""} for r in (render, again))  # empty: veriray's
    same &= json.dumps(first, sort_keys=True) == json.dumps(second, sort_keys=True)
    return "" if same else "it comes back changed from a second file"


def mutate(data: bytes, rng: random.Random) -> bytes | None:
    """Changes, adds or removes one attribute of the header and moves the offsets along."""
    try:
        attributes, at = [], 8
        while data[at]:
            ends = data.index(0, at) + 1
            kind_ends = data.index(0, ends) + 1
            (size,) = struct.unpack_from("<i", data, kind_ends)
            begin = kind_ends + 4
            if size < 0 or begin + size > len(data):
                return None
            attributes.append([data[at : ends - 1], data[ends : kind_ends - 1],
                               data[begin : begin + size]])  # fmt: skip
            at = begin + size
        first = struct.unpack_from("<Q", data, at + 1)[0]
    except (IndexError, ValueError, struct.error):
        return None
    if not attributes:
        return None
    chunks = max(0, min((first - at - 1) // 8, (len(data) - at - 1) // 8))
    offsets = np.frombuffer(data, "<u8", chunks, at + 1)
    body = data[at + 1 + 8 * chunks :]
    k, choice = rng.randrange(len(attributes)), rng.randrange(6)
    if choice == 0:
        del attributes[k]
    elif choice == 1:
        value = bytearray(attributes[k][2])
        if value:
            value[rng.randrange(len(value))] = rng.choice([0, 1, 127, 128, 255, rng.randrange(256)])
        attributes[k][2] = bytes(value)
    elif choice == 2:
        attributes[k][2] += attributes[k][2]
    else:
        name = f"veriray.{rng.choice(_KEYS)}".encode()
        attributes = [a for a in attributes if a[0] != name]
        kind, value = b"string", rng.choice(_TEXTS).encode()
        if rng.randrange(9) == 0:
            kind, value = b"int", b"\7\0\0\0"
        attributes.append([name, kind, value])
    header = data[:8] + b"".join(
        b"%s\0%s\0%s%s" % (name, kind, struct.pack("<i", len(value)), value)
        for name, kind, value in attributes
    )
    with np.errstate(over="ignore"):
        moved = offsets + np.uint64((len(header) - at) % 2**64)
    return header + b"\0" + moved.astype("<u8").tobytes() + body


TARGET = Target(
    ".exr", _load, _valid, (ImageError, OSError), ("image.py",),
    (*(f"veriray.{k}" for k in _KEYS), *_TEXTS[:20], "R", "G", "B", "stderr.R", "batch.000.R",
     "region", "chlist", "box2i", "string", "int", "float"), mutate,
)  # fmt: skip
