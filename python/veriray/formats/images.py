"""Image files as texels: what textures and skies are made of.

PNG, JPEG, BMP, TGA and PPM by Pillow, OpenEXR by its own library, Radiance HDR and PFM here. Texels
keep the precision of the file: 8 bits, half or float; a PNG of 16 bits becomes float, and so does a
PGM or PPM whose white is not 255. An alpha channel is left out, as in Mitsuba.
"""

from __future__ import annotations

import io
import math
import os
import re
import warnings
import zlib
from collections.abc import Iterable
from dataclasses import dataclass
from pathlib import Path
from typing import IO, Any

import numpy as np
import numpy.typing as npt

from ..chunks import in_chunks
from ..device import cpu_module
from ..errors import ImageError, SceneError
from ..files import open_regular
from ..image import read_exr
from . import spectra
from .mitsuba_objects import Bitmap
from .node import NOT_FETCHED, POINTER, shorten

Array = npt.NDArray[Any]
MAX_SIDE = 1 << 15
MAX_TEXELS = 1 << 27
_MAX_BYTES = 1 << 31
#: Texels that a byte of a file can hold: deflate makes 1032 bytes of one, and an image of one bit
#: a texel has 8 in each.
_MOST_PER_BYTE = 8 * 1032
_PILLOW = ("PNG", "JPEG", "BMP", "TGA", "PPM")
_GREY = ("1", "L", "LA", "La", "I;16", "I;16B", "I;16L", "I")
_COLOUR = ("RGB", "RGBA", "RGBa", "RGBX", "P", "PA")


@dataclass(frozen=True)
class Image:
    """texels (H, W, C) uint8, float16 or float32, row 0 on top; C is 1 (grey) or 3 (RGB).

    encoded: 8-bit texels that follow the sRGB curve; all others are linear.
    """

    texels: Array
    encoded: bool = False

    def linear(self) -> npt.NDArray[np.float32]:
        """(H, W, C) float32: sRGB undone, other 8-bit texels divided by 255."""
        if self.texels.dtype == np.uint8:
            table = SRGB_TO_LINEAR if self.encoded else BYTE_TO_SHARE
            return table[self.texels]
        return self.texels.astype(np.float32)


def one_number(texels: Array) -> Array:
    """Of texels (H, W, C) what a bitmap gives as a number (H, W, 1): of three, the luminance."""
    if texels.shape[2] == 1:
        return texels
    luminance: Array = texels @ np.array([0.212671, 0.71516, 0.072169])
    return luminance[..., None]


def read(path: Path, where: str, *, raw: bool = False, channel: str | None = None) -> Image:
    """An image file. raw: its numbers as they are; else files other than EXR, HDR and PFM are sRGB.
    channel: "r", "g", "b" (or "x", "y", "z"), "a" for one of them as a grey image; alpha is linear,
    and 1 where the file has none.

    Raises SceneError for a file that is missing, damaged, too large, of an unknown kind, or holds
    texels that are not finite; `where` is the place that names it.
    """
    name = shorten(path)
    try:
        with open_regular(path) as file:
            size = os.fstat(file.fileno()).st_size
            start = file.read(len(POINTER))
            file.seek(0)
            if start == POINTER:
                raise SceneError(NOT_FETCHED)
            if start.startswith(b"\x76\x2f\x31\x01"):
                image = Image(_exr(path))
            elif start.startswith((b"#?RADIANCE", b"#?RGBE")):
                image = Image(_hdr(_whole(file, size)))
            elif re.match(rb"P[Ff]\s", start):
                image = Image(_pfm(_whole(file, size)))
            else:
                image = _by_pillow(file, size, raw, channel == "a")
                channel = None if channel == "a" else channel
            if channel is not None:
                image = _channel(image, channel)
    except (SceneError, ImageError) as error:
        text = str(error).removeprefix(f"{path}: ")
        raise SceneError(f"{name}: {text}", where) from None
    except OSError as error:
        raise SceneError(f"cannot read {name}: {error.strerror or error}", where) from None
    except ValueError as error:  # a name with a null character
        raise SceneError(f"cannot read {name}: {error}", where) from None
    return _checked(image, name, where)


def from_array(values: object, where: str, *, raw: bool = False, kept: bool = True) -> Image:
    """The image of an array (H, W) or (H, W, C), C 1, 3 or 4: uint8 is sRGB unless raw, floats are
    linear; or of a Bitmap. kept: else it may share the array's memory, which is not ours. Raises
    SceneError."""
    encoded = not raw
    if isinstance(values, Bitmap):
        values, encoded = values.plain(raw)
    texels = np.asarray(values)
    texels = texels.astype(texels.dtype.newbyteorder("="), copy=False)
    texels = texels[:, :, None] if texels.ndim == 2 else texels
    if texels.ndim != 3 or texels.shape[2] not in (1, 3, 4) or texels.dtype.kind not in "uf":
        raise SceneError(
            f"an image of shape {texels.shape} and type {texels.dtype}; expected (H, W), "
            "(H, W, 1), (H, W, 3) or (H, W, 4) of uint8, float16 or float32",
            where,
        )
    if texels.dtype.kind == "u" and texels.dtype != np.uint8:
        raise SceneError(f"an image of {texels.dtype}; expected uint8, or floats", where)
    try:
        _check_size(texels.shape[1], texels.shape[0])
    except SceneError as error:
        raise SceneError(str(error), where) from None
    if texels.dtype == np.float64:
        with np.errstate(over="ignore"):
            texels = texels.astype(np.float32)
    if texels.dtype not in (np.uint8, np.float16, np.float32):
        raise SceneError(f"an image of {texels.dtype}; expected float16, float32 or uint8", where)
    texels = np.array(texels[:, :, :3]) if kept else texels[:, :, :3]
    return _checked(Image(texels, texels.dtype == np.uint8 and encoded), "the image", where)


def rgba(data: bytes, name: str, where: str) -> Array:
    """The texels (H, W, 4) uint8 of a PNG or JPEG file's content, row 0 on top; numbers of 16 bits
    are rounded to 8. Raises SceneError as `read`."""
    from PIL import Image as Pillow  # not needed by most scenes

    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")  # the size is checked
            with Pillow.open(file := io.BytesIO(data), formats=("PNG", "JPEG")) as image:
                _check_size(*image.size)
                if image.width * image.height > _MOST_PER_BYTE * len(data):
                    raise SceneError("damaged: too few bytes for its texels")
                depth, colour = _png_kind(file) if image.format == "PNG" else (8, 0)
                if depth < 16:
                    return _with_alpha(image, depth, file)
                parts = _png_wide(file, len(data), image, colour)
                wide = np.concatenate([np.broadcast_to(parts[0], (*parts[1].shape[:2], 3)),
                                       parts[1]], axis=2)  # fmt: skip
                return ((wide.astype(np.uint32) + 128) // 257).astype(np.uint8)
    except MemoryError:
        raise
    except Exception as error:  # the library's errors have no common base class
        text = " ".join(str(error).split())[:200]
        raise SceneError(f"{name} is no readable PNG or JPEG: {text}", where) from None


def _checked(image: Image, name: str, where: str) -> Image:
    if image.texels.dtype != np.uint8 and not _finite(image.texels):
        y, x, c = (int(i) for i in np.argwhere(~np.isfinite(image.texels))[0])
        value = image.texels[y, x, c]
        raise SceneError(f"{name}: texel (x {x}, y {y}) is {value}; it must be finite", where)
    image.texels.setflags(write=False)
    return image


def _finite(texels: Array) -> bool:
    def part(first: int, last: int) -> bool:
        return bool(np.isfinite(texels[first:last]).all())

    return all(in_chunks(part, len(texels), max(1, 2**16 // texels.shape[1])))


def _check_size(width: int, height: int) -> None:
    if not (1 <= width <= MAX_SIDE and 1 <= height <= MAX_SIDE and width * height <= MAX_TEXELS):
        raise SceneError(
            f"{width} x {height} texels; expected 1 to {MAX_SIDE} a side and at most "
            f"{MAX_TEXELS} in all"
        )


def _whole(file: IO[bytes], size: int) -> bytes:
    if size > _MAX_BYTES:
        raise SceneError(f"exceeds {_MAX_BYTES} bytes")
    return file.read(_MAX_BYTES)


def _channel(image: Image, name: str) -> Image:
    """One channel as grey; the kinds of image that hold no alpha here have 1."""
    if name == "a":
        return Image(np.ones_like(image.texels[:, :, :1]))
    index = min("rgbxyz".index(name) % 3, image.texels.shape[2] - 1)
    return Image(np.array(image.texels[:, :, index : index + 1]), image.encoded)


def _by_pillow(file: IO[bytes], size: int, raw: bool, alpha: bool = False) -> Image:
    from PIL import Image as Pillow  # not needed by most scenes
    from PIL import UnidentifiedImageError

    most = 65535
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore", Pillow.DecompressionBombWarning)  # the size is checked
            with Pillow.open(file, formats=_PILLOW) as image:
                _check_size(*image.size)
                kind, mode = str(image.format), image.mode
                if image.width * image.height > _MOST_PER_BYTE * size:
                    raise SceneError(
                        f"damaged: {image.width} x {image.height} texels cannot come from {size} "
                        "bytes"
                    )
                depth, colour = _png_kind(file) if kind == "PNG" else (8, 0)
                if depth == 16:
                    texels, share = _png_wide(file, size, image, colour)
                    if alpha:
                        return Image(_by_table(share, 65535, True))
                elif alpha:
                    return Image(_with_alpha(image, depth, file)[:, :, 3:])
                elif kind == "PPM" and mode in ("L", "I", "RGB"):
                    texels, most = _ppm(file, size, image.width, image.height)
                elif mode in _GREY:
                    wide = mode.startswith("I")
                    texels = np.asarray(image if wide else image.convert("L"))[:, :, None]
                elif mode in _COLOUR:
                    palette = mode in ("P", "PA")
                    texels = np.asarray(image.convert("RGBA") if palette else image)[:, :, :3]
                else:
                    raise SceneError(f"{kind} of mode {mode}; expected grey or RGB")
    except (SceneError, MemoryError):
        raise
    except UnidentifiedImageError:
        raise SceneError(
            f"not an image of a known kind: EXR, HDR, PFM, {', '.join(_PILLOW)}"
        ) from None
    except Exception as error:  # the library's errors have no common base class
        raise SceneError(f"not a readable image: {' '.join(str(error).split())}") from None
    if texels.dtype == np.uint8 and most in (255, 65535):  # 65535: of no PPM file
        return Image(np.array(texels), not raw)
    if not ((texels >= 0) & (texels <= most)).all():
        raise SceneError(f"holds numbers outside [0, {most}]")
    return Image(_by_table(texels, most, raw))


def _by_table(codes: Array, most: int, raw: bool) -> Array:
    """Shares (H, W, C) float32 of codes 0 to `most` (<= 65535); not raw: by the sRGB curve."""
    table = np.zeros(most + 1, np.float32)
    table[codes] = 1
    for code in np.flatnonzero(table).tolist():
        table[code] = _rounded(code, most) if raw else _linear(code, most)
    return table[codes]


def _png_kind(file: IO[bytes]) -> tuple[int, int]:
    """Bits of a number and the colour type of a PNG file."""
    at = file.tell()
    file.seek(24)  # behind the signature and the length, name, width and height of IHDR
    found = file.read(2)
    file.seek(at)
    return (found[0], found[1]) if len(found) == 2 else (0, 0)


def _with_alpha(image: Any, depth: int, file: IO[bytes]) -> Array:
    """The texels (H, W, 4) uint8 of an image of Pillow's of at most 8 bits a number, which stand
    with `depth` bits in the file. Pillow widens grey to 8 bits, but not the colour key."""
    if image.mode in ("1", "L") and "transparency" in image.info:
        most = (1 << depth) - 1
        key = _png_key(file) if image.mode == "1" else image.info["transparency"]
        image.info["transparency"] = (key & most) * 255 // most
    return np.array(image.convert("RGBA"))


def _png_key(file: IO[bytes]) -> int:
    """The colour key of a grey PNG file; of files of one bit Pillow keeps whether it is 0."""
    at = file.tell()
    file.seek(8)
    name = b""
    while name not in (b"tRNS", b"IDAT") and len(head := file.read(8)) == 8:
        size, name = int.from_bytes(head[:4], "big"), head[4:]
        key = file.read(min(size, 2))
        file.seek(size - len(key) + 4, os.SEEK_CUR)
    file.seek(at)
    return int.from_bytes(key, "big") if name == b"tRNS" else 0


def _png_wide(file: IO[bytes], size: int, image: Any, colour: int) -> tuple[Array, Array]:
    """The colours (H, W, 1 or 3) and alphas (H, W, 1) uint16 of a PNG file of 16 bits a number."""
    if colour == 4:
        texels = _png_grey_alpha(file, size)
    elif colour == 0:
        texels = np.asarray(image).astype(np.uint16)[:, :, None]
    else:
        texels = _png_16(file, image.mode)
    if colour & 4:
        return texels[:, :, :-1], texels[:, :, -1:]
    alpha = np.full_like(texels[:, :, :1], 65535)
    if "transparency" in image.info:
        alpha[(texels == image.info["transparency"]).all(axis=2)] = 0
    return texels, alpha


def _png_grey_alpha(file: IO[bytes], size: int) -> Array:
    """The numbers (H, W, 2) uint16 of a PNG file of grey and alpha of 16 bits each, of which Pillow
    keeps the high bytes. Its 4 bytes a texel are filtered as those of 8 bits RGBA, so it is read as
    such a file."""
    from PIL import Image as Pillow

    file.seek(0)
    data = bytearray(_whole(file, size))
    data[24:26] = 8, 6
    data[29:33] = zlib.crc32(data[12:29]).to_bytes(4, "big")
    with Pillow.open(io.BytesIO(data), formats=("PNG",)) as image:
        parts = np.asarray(image).astype(np.uint16)
    return parts[:, :, 0::2] << 8 | parts[:, :, 1::2]


def _ppm(file: IO[bytes], size: int, width: int, height: int) -> tuple[Array, int]:
    """The numbers (H, W, 1 or 3) of a PGM or PPM file and that of white; Pillow rounds them to
    shares of 255 or 65535."""
    file.seek(0)
    data, space = _whole(file, size), rb"(?:\s|#[^\n]*\n)+"
    head = re.match(rb"P([2356])" + 3 * (space + rb"(\d{1,5})") + rb"\s", data)
    if not head:
        raise SceneError("damaged: no header of a PGM or PPM file")
    most, shape = int(head[4]), (height, width, 3 if head[1] in b"36" else 1)
    count = math.prod(shape)
    if head[1] in b"56":
        kind = np.dtype("u1" if most < 256 else ">u2")
        data = data[head.end() : head.end() + count * kind.itemsize]
        codes = np.frombuffer(data, kind, len(data) // kind.itemsize)
    else:
        words = re.sub(rb"#[^\n]*", b"", data[head.end() :]).split(None, count)[:count]
        codes = np.array(words, np.uint32)
    if len(codes) < count:
        raise SceneError("damaged: it ends before its last texel")
    if most == 255 and (codes <= most).all():
        codes = codes.astype(np.uint8)
    return codes.reshape(shape), most


def _png_16(file: IO[bytes], mode: str) -> Array:
    """A colour PNG of 16 bits, which Pillow gives with 8: the high bytes and, read as if in the
    other order, the low ones."""
    from PIL import Image as Pillow

    parts = []
    for order in ("B", "L"):
        file.seek(0)
        with Pillow.open(file, formats=("PNG",)) as image:
            image.tile = [(*tile[:3], f"{mode};16{order}") for tile in image.tile]  # type: ignore
            parts.append(np.asarray(image).astype(np.uint16))
    return parts[0] << 8 | parts[1]


def _exr_names(channels: Iterable[str]) -> tuple[str, ...]:
    """The channels of an EXR file's colours: R, G, B, or X, Y, Z, or Y, or r, g, b, or those of the
    only layer that has R, G and B; none where nothing says which."""
    for names in (("R", "G", "B"), ("X", "Y", "Z"), ("Y",), ("r", "g", "b")):
        if set(names) <= set(channels):
            return names
    layers = [name.rpartition(".")[0] for name in channels if name.endswith(".R")]
    layers = [layer for layer in layers if {f"{layer}.G", f"{layer}.B"} <= set(channels)]
    return tuple(f"{layers[0]}.{name}" for name in "RGB") if len(layers) == 1 else ()


def _exr(path: Path) -> Array:
    _, channels = read_exr(path, _MAX_BYTES)
    names = _exr_names(channels)
    if not names:
        found = ", ".join(sorted(channels)[:9])
        raise SceneError(f"no channels R, G, B, and no channel Y; found {found}")
    if {"RY", "BY"} & set(channels):
        raise SceneError("luminance and chroma channels are not supported; use R, G, B")
    planes = [channels[name] for name in names]
    _check_size(planes[0].shape[1], planes[0].shape[0])
    if names == ("X", "Y", "Z"):
        with np.errstate(over="ignore", invalid="ignore"):
            x, y, z = (plane.astype(np.float64) for plane in planes)
            planes = [a * x + b * y + c * z for a, b, c in spectra.XYZ_TO_RGB]
    half = all(plane.dtype == np.float16 for plane in planes)
    kind = np.float16 if half else np.float32
    return np.stack([plane.astype(kind) for plane in planes], axis=-1)


def _pfm(data: bytes) -> Array:
    """Portable float map: rows from the bottom, a negative scale for little-endian numbers."""
    head = re.match(
        rb"(P[Ff])\s+(\d{1,6})\s+(\d{1,6})\s+([+-]?[0-9.]{1,20}(?:[eE][+-]?\d{1,3})?)\s", data
    )
    if not head:
        raise SceneError("damaged: no header of a PFM file")
    width, height, count = int(head[2]), int(head[3]), 3 if head[1] == b"PF" else 1
    _check_size(width, height)
    order = "<" if head[4].startswith(b"-") else ">"
    need = width * height * count
    if len(data) - head.end() < 4 * need:
        raise SceneError("damaged: it ends before its last texel")
    try:
        scale = np.float32(abs(float(head[4])))
    except ValueError:
        scale = np.float32(0)
    if not 0 < scale < np.inf:
        raise SceneError(f"damaged: its scale is {head[4].decode()}")
    values = np.frombuffer(data, order + "f4", need, head.end()).astype(np.float32)
    with np.errstate(over="ignore", invalid="ignore"):
        return values.reshape(height, width, count)[::-1] * scale


def _hdr(data: bytes) -> Array:
    """Radiance's picture format (G. Ward, "Real pixels", Graphics Gems II, 1991): three mantissas
    and a common exponent, scan lines run-length coded by channel or flat."""
    head = re.match(rb"#\?[^\n]*\n(?:[^\n]{0,2000}\n){0,200}?\r?\n", data)
    size = re.match(rb"-Y (\d{1,6}) \+X (\d{1,6})\r?\n", data[head.end() :]) if head else None
    if not head or not size:
        raise SceneError('damaged: no header of an HDR file with "-Y height +X width"')
    if re.search(rb"FORMAT=(?!32-bit_rle_rgbe)", head[0]):
        raise SceneError("only FORMAT=32-bit_rle_rgbe is supported")
    height, width = int(size[1]), int(size[2])
    _check_size(width, height)
    at = head.end() + size.end()
    mark = bytes((2, 2, width >> 8, width & 255))
    if 8 <= width < 1 << 15 and data[at : at + 4] == mark:
        native = cpu_module()
        if native is not None:
            values: Array | None = native.read_rgbe(data[at:], width, height)
            if values is not None:
                return values
        codes = _hdr_runs(data, at, width, height, mark)
    else:
        if len(data) - at < 4 * width * height:
            raise SceneError("damaged, or coded in the old way: it ends before its last texel")
        codes = np.frombuffer(data, np.uint8, 4 * width * height, at).reshape(height, width, 4)
    exponent = codes[:, :, 3:].astype(np.int32) - (128 + 8)
    mantissa = codes[:, :, :3].astype(np.float32)
    return np.where(codes[:, :, 3:] > 0, np.ldexp(mantissa, exponent), np.float32(0))


def _hdr_runs(data: bytes, at: int, width: int, height: int, mark: bytes) -> Array:
    codes = np.empty((height, width, 4), np.uint8)
    for y in range(height):
        if data[at : at + 4] != mark:
            raise SceneError(f"damaged: scan line {y} does not begin as one")
        at += 4
        line = bytearray()
        for channel in range(4):
            while len(line) < width * (channel + 1):
                if at + 1 >= len(data):
                    raise SceneError(f"damaged: it ends in scan line {y}")
                count = data[at]
                if count > 128:
                    line += data[at + 1 : at + 2] * (count - 128)
                    at += 2
                else:
                    line += data[at + 1 : at + 1 + count]
                    at += 1 + count
                if not count or at > len(data):
                    raise SceneError(f"damaged: a run of scan line {y} is empty or cut off")
            if len(line) != width * (channel + 1):
                raise SceneError(f"damaged: a run leaves scan line {y}")
        codes[y] = np.frombuffer(bytes(line), np.uint8).reshape(4, width).T
    return codes


_BITS = 80  # of a fraction before it is rounded to float32


def _float32(fraction: int, exact: bool) -> float:
    """A fraction (times 2^-_BITS) to the nearest even float32; exact: nothing follows its bits."""
    drop = max(fraction.bit_length() - 24, 0)
    kept, rest, half = fraction >> drop, fraction & ((1 << drop) - 1), (1 << drop) >> 1
    up = rest > half or (drop > 0 and rest == half and (not exact or kept & 1))
    return float((kept + up) << drop) * 2.0**-_BITS


def _rounded(code: int, most: int) -> float:
    """The share code / most, correctly rounded to float32."""
    fraction, rest = divmod(code << _BITS, most)
    return _float32(fraction, rest == 0)


def _linear(code: int, most: int) -> float:
    """Linear value of the sRGB code (IEC 61966-2-1), correctly rounded to float32, by integers.

    Above 0.04045 it is z^(12/5) with z = (code / most + 0.055) / 1.055, the fifth root of z^12.
    """
    if code * 100_000 <= 4045 * most:
        fraction, rest = divmod(code * 100 << _BITS, 1292 * most)
        return _float32(fraction, rest == 0)
    above, below = 1000 * code + 55 * most, 1055 * most
    power = (above**12 << 5 * _BITS) // below**12
    root = 1 << -(-power.bit_length() // 5)  # not below the root; Newton's steps then descend
    while True:
        lower = (4 * root + power // root**4) // 5
        if lower >= root:
            break
        root = lower
    return _float32(root, above == below)  # irrational otherwise


#: Linear values of the 256 codes of sRGB, and of codes that are shares of 255; float32, exact to
#: rounding.
SRGB_TO_LINEAR = np.array([_linear(code, 255) for code in range(256)], np.float32)
BYTE_TO_SHARE = np.array([_rounded(code, 255) for code in range(256)], np.float32)
for _table in (SRGB_TO_LINEAR, BYTE_TO_SHARE):
    _table.setflags(write=False)
