"""Textures and a sky that the gallery makes itself, the same on every machine: integer hashes, and
+ - * / and sqrt on float64, rounded to 8 bits or to float32."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

from ..files import replacing
from .own import MARK

Array = npt.NDArray[Any]

SIZE = 1024


def write(path: Path, values: Array) -> None:
    """Writes uint8 (H, W, 3) as PNG, float32 (H, W, 3) as EXR; whole or not at all."""
    with replacing(path) as file:
        if values.dtype == np.uint8:
            from PIL import Image, PngImagePlugin

            note = PngImagePlugin.PngInfo()
            note.add_text("Comment", MARK)
            Image.fromarray(values).save(file, format="png", pnginfo=note)
        else:
            import OpenEXR

            header = {"compression": OpenEXR.ZIP_COMPRESSION, "type": OpenEXR.scanlineimage}
            OpenEXR.File({**header, "comments": MARK}, {"RGB": values}).write(file)


def _hash(*numbers: Array | int) -> Array:
    """Numbers in [0, 1) from integers; the finalizer of MurmurHash3 (A. Appleby, 2011)."""
    h: Array = np.asarray(0x9E3779B9, np.uint64)
    for n in numbers:
        h = (h ^ np.asarray(n).astype(np.uint64)) & np.uint64(0xFFFFFFFF)
        for shift, factor in ((16, 0x85EBCA6B), (13, 0xC2B2AE35), (16, 1)):
            h = (h ^ (h >> np.uint64(shift))) * np.uint64(factor) & np.uint64(0xFFFFFFFF)
    return h / 2.0**32


def _noise(x: Array, y: Array, periods: tuple[int, int], seed: int) -> Array:
    """Value noise in [0, 1), smooth, with whole periods in x and y: it tiles."""
    column, row = np.floor(x).astype(np.int64), np.floor(y).astype(np.int64)
    a, b = x - column, y - row
    a, b = a * a * (3 - 2 * a), b * b * (3 - 2 * b)

    def at(i: int, j: int) -> Array:
        return _hash((column + i) % periods[0], (row + j) % periods[1], seed)

    low, high = at(0, 0) * (1 - a) + at(1, 0) * a, at(0, 1) * (1 - a) + at(1, 1) * a
    return low * (1 - b) + high * b


def _layers(u: Array, v: Array, across: int, along: int, seed: int, count: int = 4) -> Array:
    """Noise of several scales, in [0, 1)."""
    total, weight = np.zeros(np.broadcast(u, v).shape), 0.0
    for k in range(count):
        part, n, m = 0.5**k, across << k, along << k
        total += part * _noise(u * n, v * m, (n, m), seed + k)
        weight += part
    return total / weight


def _grid() -> tuple[Array, Array]:
    c = (np.arange(SIZE) + 0.5) / SIZE
    return c[None, :], c[:, None]


def _colours(share: Array, low: tuple[float, ...], high: tuple[float, ...]) -> Array:
    mixed = np.array(low) + share[..., None] * (np.array(high) - np.array(low))
    colours: Array = np.rint(np.clip(mixed, 0, 1) * 255).astype(np.uint8)
    return colours


def planks() -> Array:
    """A floor of eight rows of boards."""
    u, v = _grid()
    row = np.floor(v * 8).astype(np.int64)
    along = u * 2 + _hash(row, 5)
    board = np.floor(along).astype(np.int64) % 2
    tone = _hash(row, board, 7)
    grain = _layers(u + tone, v + 0 * u, 4, 128, 11)
    share = np.clip(0.25 + 0.5 * tone + 0.55 * (grain - 0.5), 0, 1)
    seam = (v * 8 % 1 < 0.025) | (along % 1 < 0.004)
    return _colours(np.where(seam, 0.0, share), (0.20, 0.12, 0.07), (0.74, 0.53, 0.35))


def wood() -> Array:
    """Dark wood with rings, for furniture."""
    u, v = _grid()
    wave = _layers(u + 0 * v, v + 0 * u, 2, 8, 31, 3)
    ring = (v * 14 + 3 * wave) % 1
    share = 0.3 + 0.5 * np.abs(2 * ring - 1) + 0.3 * (_layers(u + 0 * v, v, 8, 256, 37) - 0.5)
    return _colours(np.clip(share, 0, 1), (0.22, 0.11, 0.05), (0.50, 0.28, 0.14))


def plaster() -> Array:
    """A painted wall."""
    u, v = _grid()
    share = _layers(u + 0 * v, v + 0 * u, 6, 6, 41, 6)
    return _colours(share, (0.80, 0.77, 0.71), (0.90, 0.88, 0.83))


def weave() -> Array:
    """A rug: threads, two borders and rows of rhombs."""
    u, v = _grid()
    edge = np.minimum(np.minimum(u, 1 - u), np.minimum(v, 1 - v) * 1.5)
    rhomb = np.abs(u * 12 % 1 - 0.5) + np.abs(v * 8 % 1 - 0.5)
    share = np.where(rhomb < 0.22, 1.0, np.where(rhomb < 0.34, 0.55, 0.12))
    share = np.where(edge < 0.09, 0.85, np.where(edge < 0.11, 0.1, share))
    share = np.where(edge < 0.02, 0.15, share)
    thread = 0.8 + 0.2 * _hash(np.floor(u * 256), np.floor(v * 256), 53)
    return _colours(share * thread, (0.38, 0.07, 0.06), (0.92, 0.82, 0.62))


def painting() -> Array:
    """How fast z^2 + c leaves the circle of 2 about the origin (B. Mandelbrot, 1980)."""
    u, v = _grid()
    c = (u * 2.6 - 1.9) + 1j * (v * 2.2 - 1.1)
    z, steps = np.zeros_like(c), np.zeros(c.shape)
    for _ in range(48):
        inside = z.real * z.real + z.imag * z.imag < 4
        z = np.where(inside, z * z + c, z)
        steps += inside
    share = 1 - (1 - steps / 48) ** 2
    colours = _colours(share % 1, (0.05, 0.16, 0.30), (0.98, 0.78, 0.42))
    colours[steps == 48] = (24, 20, 30)
    return colours


def scratches() -> Array:
    """Roughness of used metal: fine lines across, with patches."""
    u, v = _grid()
    lines = _layers(u + 0 * v, v + 0 * u, 8, 256, 61)
    patches = _layers(u + 0 * v, v + 0 * u, 5, 5, 67)
    return _colours(0.55 * lines + 0.45 * patches, (0.08,) * 3, (0.42,) * 3)


def sky() -> Array:
    """A clear afternoon: blue with a bright horizon, a sun of 1.4 degrees, grey ground; radiance.

    Row 0 is the zenith; the sun is 34 degrees high, at a quarter of the width.
    """
    height, width = 512, 1024
    up = 1 - 2 * (np.arange(height) + 0.5)[:, None] / height  # of the angle, not of its sine
    across = (np.arange(width) + 0.5)[None, :] / width
    haze = np.clip(1 - np.abs(up), 0, 1) ** 4 + 0 * across
    blue = np.array([0.20, 0.42, 0.95]) * 0.9
    image = blue + haze[..., None] * (np.array([1.15, 1.10, 1.0]) - blue)
    image = np.where((up < 0)[..., None], np.array([0.28, 0.26, 0.22]), image)
    high = 34 / 90
    away = np.sqrt((90 * (up - high)) ** 2 + (360 * 0.829 * (across - 0.25)) ** 2)
    glow = 2.2 / (1 + (away / 4) ** 2)
    image = image + np.where(up > 0, glow, 0)[..., None] * np.array([1.0, 0.86, 0.62])
    image = np.where((away < 0.7)[..., None], np.array([9000.0, 7900.0, 6200.0]), image)
    return image.astype(np.float32)


#: By file name.
MAKERS: dict[str, Callable[[], Array]] = {
    "planks.png": planks, "wood.png": wood, "plaster.png": plaster, "weave.png": weave,
    "painting.png": painting, "scratches.png": scratches, "sky.exr": sky,
}  # fmt: skip
