"""Mitsuba's serialized meshes. Mutations change the unpacked mesh as often as the file."""

from __future__ import annotations

import random
import struct
import zlib
from dataclasses import replace

from tests.fuzz.meshes import target

_WORDS = (0, 1, 2, 3, 4, 0x10, 0x1000, 0x2000, 0x100B, 0x7F800000, 0x7FC00000, 2**31, 2**32 - 1)


def _changed(data: bytes, rng: random.Random) -> bytes:
    at, word = rng.randrange(len(data) + 1), struct.pack("<I", rng.choice(_WORDS))
    choice = rng.randrange(5)
    if choice == 0:
        return data[:at] + word + data[at + 4 :]
    if choice == 1:
        return data[:at] + bytes([rng.randrange(256)]) + data[at + 1 :]
    if choice == 2:
        return data[:at]
    return data[:at] + rng.choice([word, bytes(rng.randrange(1000))]) + data[at:]


def mutate(data: bytes, rng: random.Random) -> bytes | None:
    """Unpacks the first mesh, changes it and packs it again; or changes the file."""
    if rng.randrange(4) == 0:
        return _changed(data, rng)
    unpack = zlib.decompressobj()
    try:
        body = unpack.decompress(data[4:], 1 << 20)
    except zlib.error:
        return _changed(data, rng)
    return data[:4] + zlib.compress(_changed(body, rng)) + unpack.unused_data


TARGET = replace(
    target("serialized", ("formats/serialized.py",), ("\x1c\x04\x04", "\x1c\x04\x03")),
    mutate=mutate,
)
