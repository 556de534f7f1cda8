"""Images of textures and skies, of any kind."""

from __future__ import annotations

import random
from pathlib import Path

import numpy as np

from tests.fuzz.contract import Target
from veriray.errors import SceneError
from veriray.formats import images

_BYTES = (0, 1, 2, 3, 127, 128, 129, 254, 255)
_WORDS = (
    "#?RADIANCE\n", "FORMAT=32-bit_rle_rgbe\n", "-Y 1 +X 1\n", "\n\n", "PF\n", "Pf\n", "P6\n",
    "1 1\n", "-1.0\n", "32768 32768\n", "IHDR", "IDAT", "PLTE", "tRNS", "IEND", "JFIF", "BM",
)  # fmt: skip


def _valid(image: images.Image) -> str:
    texels = image.texels
    if texels.ndim != 3 or texels.shape[2] not in (1, 3) or not texels.size:
        return f"its shape is {texels.shape}"
    if texels.dtype not in (np.uint8, np.float16, np.float32):
        return f"its type is {texels.dtype}"
    if not np.isfinite(texels).all():
        return "a texel is not finite"
    return "it is encoded" if image.encoded and texels.dtype != np.uint8 else ""


def mutate(data: bytes, rng: random.Random) -> bytes | None:
    """Changes some bytes, more often at the beginning; or cuts, repeats or moves a piece."""
    if not data:
        return None
    out, choice = bytearray(data), rng.randrange(6)
    if choice < 4:
        for _ in range(1 << choice):
            last = len(out) if rng.random() < 0.5 else min(len(out), 64)
            out[rng.randrange(last)] = rng.choice((*_BYTES, rng.randrange(256)))
        return bytes(out)
    a, b = sorted(rng.randrange(len(out) + 1) for _ in range(2))
    if choice == 4:
        return bytes(out[:a] + out[b:])
    return bytes(out[:b] + out[a:])


def _load(path: Path) -> images.Image:
    return images.read(path, "here")


TARGET = Target(
    ".img", _load, _valid, (SceneError,), ("formats/images.py", "image.py"), _WORDS, mutate
)
