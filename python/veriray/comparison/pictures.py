"""The pictures of the comparison's page: data to flicker, swipe, zoom and read them.

The page holds the linear radiance itself, so that exposure and read-out do not go through 8 bits:
a pixel's channels as 16-bit integers under one exponent, within `VALUE_ERROR` of its largest
channel, and standard errors as logarithms in 8 bits, within `Packed.stderr_error` of each. That is
about 18 bytes a pixel in the file. Pictures of more than MOST_PIXELS are embedded as means of
blocks, with the standard errors of these means: of independent pixels, or as large as those of
pixels that share samples can be.
"""

from __future__ import annotations

import base64
import json
import math
import zlib
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np

from veriray import html, showing
from veriray.comparison.metrics import display_scale
from veriray.comparison.statistics import block_means
from veriray.image import to_srgb8

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from veriray.comparison.report import Maps

    Array = NDArray[Any]

#: Pixels of a picture up to which the page holds every one.
MOST_PIXELS = 2**20
#: Pixels of the longer side of what is shown where no script runs.
STILL = 480
#: Largest error of an embedded value, relative to its pixel's largest channel.
VALUE_ERROR = 3.1e-5
_MOST = 32766  # integers beyond stand for infinite (+-32767) and not a number (-32768)


@dataclass(frozen=True)
class Packed:
    """Pictures as text for the page.

    data: base64 of deflated planes, of A, then of B: exponent + 126; high bytes of R, G, B; low
        bytes of R, G, B; codes of the standard errors of R, G, B. A value is integer 2^(exponent -
        15); code 0: unknown, 1: zero, c: 2^(low + (c - 2) interval).
    about: sizes and scales for the script, as JSON. step: pixels along a side of what is one pixel
        on the page. stderr_error: largest relative error of a standard error.
    """

    data: str
    about: str
    step: int
    stderr_error: float


def packed(maps: Maps) -> Packed:
    """The pictures and standard errors of a comparison."""
    height, width = maps.a.shape[:2]
    step = reduction(height, width)
    planes, codes = [], []
    sides = ((maps.a, maps.stderr_a), (maps.b, maps.stderr_b))
    for (picture, stderr), together in zip(sides, maps.together, strict=True):
        planes.append(values(block_means(np.asarray(picture, np.float64), step)))
        error = np.full(picture.shape, np.nan) if stderr is None else np.asarray(stderr, float)
        shown, low, interval = errors(_error_of_blocks(error, step, together))
        planes.append(shown)
        codes.append([low, interval])
    about = {
        "width": width, "height": height, "step": step,
        "columns": -(-width // step), "rows": -(-height // step),
        "white": 1 / display_scale(maps.b), "codes": codes,
    }  # fmt: skip
    worst = 2 ** (max(interval for _, interval in codes) / 2) - 1
    deflated = zlib.compress(b"".join(p.tobytes() for p in planes), 6)
    return Packed(base64.b64encode(deflated).decode(), json.dumps(about), step, worst)


def reduction(height: int, width: int) -> int:
    """The least size of blocks whose means are at most MOST_PIXELS."""
    step = max(1, math.isqrt(height * width // MOST_PIXELS))
    while -(-height // step) * -(-width // step) > MOST_PIXELS:
        step += 1
    return step


def values(picture: Array) -> NDArray[np.uint8]:
    """(7, H, W) bytes of a picture (H, W, 3): exponents, high bytes and low bytes."""
    finite = np.isfinite(picture)
    known = np.where(finite, picture, 0.0)
    _, exponent = np.frexp(np.abs(known).max(axis=-1))
    exponent = np.clip(exponent, -126, 128)
    whole = np.rint(np.ldexp(known, (15 - exponent)[..., None]))
    exponent += np.abs(whole).max(axis=-1) > _MOST
    whole = np.rint(np.ldexp(known, (15 - exponent)[..., None])).astype(np.int32)
    lost = np.where(np.isnan(picture), -32768, np.where(picture > 0, 32767, -32767))
    whole = np.moveaxis(np.where(finite, whole, lost), -1, 0) & 0xFFFF
    return np.concatenate([(exponent + 126)[None], whole >> 8, whole & 255]).astype(np.uint8)


def errors(stderr: Array) -> tuple[NDArray[np.uint8], float, float]:
    """(3, H, W) codes of standard errors (H, W, 3), and the logarithms that codes 2 and up mean:
    the lowest and the interval.
    """
    known = np.isfinite(stderr) & (stderr > 0)
    logs = np.log2(stderr, where=known, out=np.zeros(stderr.shape))
    low, high = (float(f(logs[known])) if known.any() else 0.0 for f in (np.min, np.max))
    interval = (high - low) / 253
    code = 2 + np.rint((logs - low) / (interval or 1.0))
    code = np.where(known, code, np.where(stderr == 0, 1, 0))
    return np.moveaxis(code, -1, 0).astype(np.uint8), low, interval


def _error_of_blocks(stderr: Array, step: int, together: float) -> Array:
    """Standard errors of the means of blocks; together: of `Maps`."""
    if step == 1:
        return stderr
    height, width = stderr.shape[:2]
    tall = np.minimum(step, height - np.arange(0, height, step))
    wide = np.minimum(step, width - np.arange(0, width, step))
    count = (tall[:, None] * wide)[..., None]
    error: Array = np.sqrt(together * block_means(stderr**2, step) / count)
    return error


# ---- what is shown beside them ----


@dataclass(frozen=True)
class Map:
    """A picture with signs. cell: its pixel's side in pixels; limit: of the colours, with unit."""

    caption: str
    uri: str
    cell: int
    limit: str


def stills(maps: Maps) -> list[str]:
    """A and B as PNG data URIs on one display scale, where no script runs."""
    scale = display_scale(maps.b)
    return [
        html.picture(to_srgb8(showing.smaller(np.asarray(p, np.float64) * scale, STILL)))
        for p in (maps.a, maps.b)
    ]


def signed_maps(maps: Maps) -> list[Map]:
    """The difference and its z-scores, as far as there are any; none of invalid pictures."""
    if not (np.isfinite(maps.a).all() and np.isfinite(maps.b).all()):
        return []
    step = reduction(*maps.a.shape[:2])
    a, b = (np.asarray(x, np.float64).mean(axis=-1) for x in (maps.a, maps.b))
    relative = 100 * (a - b) / max(float(b.mean()), 1e-300)
    relative = block_means(relative[..., None], step)[..., 0]
    limit = float(np.percentile(np.abs(relative), 99)) or float(np.abs(relative).max()) or 1.0
    out = [
        Map("Difference A - B (mean of the channels), per cent of B's mean; the colours end at the "
            "99th percentile", html.signed_picture(relative, limit), step, f"{limit:.3g} %")
    ]  # fmt: skip
    if maps.t is not None:
        # of blocks: the sum of the scores over the root of their number, as of independent pixels
        z = block_means(maps.t[..., None], step)[..., 0] * step
        z /= math.sqrt(max(maps.together)) if step > 1 else 1
        of = "pixel" if step == 1 else f"block of {step}x{step} pixels"
        out.append(_z_map(z, step, f"z-score of the difference per {of}"))
    if maps.t_blocks is not None and min(maps.t_blocks.shape) > 1:
        out.append(_z_map(maps.t_blocks, 8, "z-score per block of 8x8 pixels"))
    return out


def _z_map(z: Array, cell: int, caption: str) -> Map:
    limit = max(4.0, math.ceil(float(np.abs(z).max())))
    return Map(caption, html.signed_picture(z, limit), cell, f"{limit:.3g}")
