"""How pictures become bytes for the eye: channels, exposure, tone curves and false colours.

To add a channel, add its line to `CHANNELS`; page, checks and render thread follow.
"""

from __future__ import annotations

import functools
import os
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from types import MappingProxyType
from typing import Any

import numpy as np
import numpy.typing as npt

from ..feature_rendering import feature_images
from ..picture import Render
from ..sampling import FLOOR
from ..saving import to_srgb8
from ..scene import Scene

Array = npt.NDArray[Any]
Bytes = npt.NDArray[np.uint8]


@dataclass(frozen=True)
class Channel:
    """Something to see of a picture.

    values: of the render, or of_scene: of the scene and the device's name, which the render thread
    makes while the channel is shown; (H, W, 3) light, or (H, W) numbers if `ends` gives the two
    that the first and the last false colour stand for; on a logarithmic scale if the first is above
    0. text: of a number in the legend.
    """

    title: str
    values: Callable[[Render], Array] | None = None
    ends: Callable[[Array], tuple[float, float]] | None = None
    text: Callable[[float], str] = "{:,.6g}".format
    of_scene: Callable[[Scene, str], Array] | None = None


def relative_error(render: Render) -> Array:
    """(H, W): the root of the mean over channels of stderr^2 / (radiance^2 + (`FLOOR` times the
    picture's mean)^2), as `veriray.sampling.tile_errors` weighs errors; 0 where both are 0, and NaN
    with one sample."""
    image, stderr = np.asarray(render), render.stderr
    if render.spp < 2:
        return np.full(image.shape[:2], np.nan, np.float32)
    dark = np.float32(FLOOR * float(np.abs(image).mean(dtype=np.float64)))
    with np.errstate(all="ignore"):
        share = (stderr / np.hypot(image, dark)) ** 2
    result: Array = np.sqrt(np.where(stderr == 0, np.float32(0), share).mean(axis=2))
    return result


def _percent(share: float) -> str:
    return f"{100 * share:g} %"


def _samples(render: Render) -> Array:
    given = render.samples
    return np.full((render.height, render.width), render.spp) if given is None else given


def _first_surface(name: str) -> Callable[[Scene, str], Array]:
    """A feature image (`veriray.features`); normals as colours, half of them and a half."""

    def look(scene: Scene, device: str) -> Array:
        image: Array = feature_images(scene, name, device=device)[name]
        return image / 2 + np.float32(0.5) if name == "normal" else image

    return look


def _finite_ends(depth: Array) -> tuple[float, float]:
    seen = depth[np.isfinite(depth)]
    return (float(seen.min()), float(seen.max())) if seen.size else (0.0, 1.0)


CHANNELS: dict[str, Channel] = {
    "radiance": Channel("Radiance", np.asarray),
    "error": Channel("Relative error", relative_error, lambda _: (1e-3, 1.0), _percent),
    "samples": Channel("Samples", _samples, lambda n: (0.0, float(n.max()))),
    "albedo": Channel("Albedo", of_scene=_first_surface("albedo")),
    "normal": Channel("Normal", of_scene=_first_surface("normal")),
    "depth": Channel("Depth", ends=_finite_ends, of_scene=_first_surface("depth")),
}


def _filmic(x: Array) -> Array:
    """J. Hable's curve of 2010 with a white point of 11.2 and his factor of 2 on the exposure."""

    def curve(x: Any) -> Any:
        return (x * (0.15 * x + 0.05) + 0.004) / (x * (0.15 * x + 0.5) + 0.06) - 0.02 / 0.3

    result: Array = curve(2.0 * np.minimum(x, 1e4)) / curve(11.2)
    return result


def _soft(x: Array) -> Array:
    """E. Reinhard et al. (2002), equation 4, with white at 4."""
    x = np.minimum(x, 4.0)
    return x * (1.0 + x / 16.0) / (1.0 + x)


#: Tone curves by name: from light >= 0, already exposed, to light of the screen in [0, 1].
CURVES: dict[str, Callable[[Array], Array]] = {
    "standard": lambda x: np.minimum(x, 1.0),
    "soft": _soft,
    "filmic": _filmic,
}
#: False colours at equal steps.
COLOURS = ("#15102b", "#3b2a78", "#2c63a8", "#1f9a9a", "#6cc36b", "#f2d84b", "#fff7d6")
_UNKNOWN = (64, 64, 64)  # the colour of NaN


#: Of a float32's bits: those that are rounded away, and the least light of a tone table, 2^-20.
_CUT, _LEAST = 12, np.float32(2.0**-20).view(np.int32)


@functools.lru_cache(maxsize=len(CURVES))
def _table(curve: str) -> Bytes:
    """The bytes for light from 2^-20 to 2^12, in steps of 11 bits of a float's fraction."""
    light = ((np.arange(1 << 16, dtype=np.int32) << _CUT) + _LEAST).view(np.float32)
    mapped = CURVES[curve](light.astype(np.float64))
    return to_srgb8(np.repeat(mapped[:, None, None], 3, axis=2))[:, 0, 0].copy()


def tone_mapped(image: Array, exposure: float = 0.0, curve: str = "standard") -> Bytes:
    """(H, W, 3) light as sRGB bytes by a table: with "standard" within 1 of `to_srgb8`."""
    values, table, part = np.asarray(image, np.float32).ravel(), _table(curve), 1 << 16
    result: Bytes = np.empty(image.shape, np.uint8)
    with np.errstate(over="ignore"):
        for at in range(0, values.size, part):  # what fits a processor's cache
            bits = np.fmax(values[at : at + part] * np.float32(2.0**exposure), 0).view(np.int32)
            bits += (1 << _CUT - 1) - _LEAST
            bits >>= _CUT
            table.take(bits, out=result.reshape(-1)[at : at + part], mode="clip")
    return result


def exact_bytes(image: Array, exposure: float, curve: str) -> Bytes:
    """As `tone_mapped`, but in float64; with "standard" it is `to_srgb8`."""
    if curve == "standard":
        return to_srgb8(image, exposure)
    return to_srgb8(CURVES[curve](np.maximum(image.astype(np.float64) * 2.0**exposure, 0.0)))


@functools.lru_cache(maxsize=1)
def _palette() -> Bytes:
    steps = np.array([[int(colour[i : i + 2], 16) for i in (1, 3, 5)] for colour in COLOURS])
    at = np.linspace(0, len(COLOURS) - 1, 256)
    parts = [np.interp(at, range(len(COLOURS)), steps[:, c]) for c in range(3)]
    return np.round(np.stack(parts, axis=1)).astype(np.uint8)


def false_colours(values: Array, low: float, high: float) -> Bytes:
    """(H, W) numbers as colours from `low` to `high`, on a logarithmic scale if low > 0."""
    with np.errstate(all="ignore"):
        x = np.asarray(values, np.float32)
        if low > 0:
            x, low, high = np.log(x), np.log(low), np.log(high)
        share = (x - np.float32(low)) / np.float32(max(high - low, 1e-30))
        colours: Bytes = _palette()[
            (np.clip(np.nan_to_num(share, nan=0.0), 0, 1) * 255).astype(np.uint8)
        ]
    colours[np.isnan(share)] = _UNKNOWN
    return colours


@dataclass(frozen=True)
class Legend:
    """What the false colours mean: texts of the first, the middle and the last of them."""

    title: str
    marks: tuple[str, str, str]


def as_bytes(
    render: Render, channel: str, exposure: float, curve: str, exact: bool = False,
    made: Mapping[str, Array] = MappingProxyType({}),
) -> tuple[Bytes, Legend | None]:  # fmt: skip
    """A channel of a render, and what its colours mean. made: values of channels of the scene."""
    found = CHANNELS[channel]
    values = made[channel] if found.values is None else found.values(render)
    if found.ends is None:
        return (exact_bytes if exact else tone_mapped)(values, exposure, curve), None
    low, high = found.ends(values)
    middle = (low * high) ** 0.5 if low > 0 else (low + high) / 2
    marks = [found.text(float(f"{x:.2g}")) for x in (low, middle, high)]
    return false_colours(values, low, high), Legend(found.title, (marks[0], marks[1], marks[2]))


def encoded(pixels: Bytes, quality: int | None) -> tuple[str, bytes]:
    """Type and bytes of an image file: JPEG, or PNG for None."""
    from PIL import Image

    kind, options = "png", {"compress_level": 1}
    if quality is not None:
        kind, options = "jpeg", {"quality": quality, "subsampling": 0 if quality >= 90 else 2}
    # Pillow lets other threads run only while it writes to a file of the system.
    with open(os.memfd_create("veriray-view"), "w+b") as file:
        Image.fromarray(pixels).save(file, format=kind, **options)
        file.seek(0)
        return f"image/{kind}", file.read()
