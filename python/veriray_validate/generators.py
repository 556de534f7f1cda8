"""Random number generators: ours, written a second time, and two bad ones that tests must reject.

A generator gives 32-bit words as a function of seed, pixel, sample and block, row by row. A block
is one use of random numbers at a vertex; there are three per bounce.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any

import numpy as np
import numpy.typing as npt

from veriray import device as device_module

Array = npt.NDArray[Any]
Words = Callable[[int, Array, Array, Array], Array]  # seed, (n,), (n,), (n,) -> (n, k) uint32
Numbers = Callable[[Array, int, int], Array]  # pixels (P,), pass, bounce -> (P, 2) in [0, 1)

U32 = np.uint64(0xFFFFFFFF)
MODULUS, FACTOR = 2**31 - 1, 48271  # minstd
SOBOL_BLOCKS = 19  # later blocks hold independent numbers with either sampler


def pcg4d(v: Sequence[Array]) -> list[Array]:
    """M. Jarzynski, M. Olano, JCGT 9(3), 2020, listing of pcg4d; 32-bit words held in uint64."""
    x, y, z, w = ((a.astype(np.uint64) * np.uint64(1664525) + np.uint64(1013904223)) & U32
                  for a in v)  # fmt: skip
    for shifted in (True, False):
        x = (x + y * w) & U32
        y = (y + z * x) & U32
        z = (z + x * y) & U32
        w = (w + y * z) & U32
        if shifted:
            x, y, z, w = (a ^ (a >> np.uint64(16)) for a in (x, y, z, w))
    return [x, y, z, w]


def expected(
    seed: int, pixel: Array, sample: Array, block: Array, sampler: str = "independent"
) -> Array:
    """What ours must give; the key is a hash of seed, upper half of the sample and a constant."""
    shape = np.zeros(len(pixel), np.uint64)
    sample = sample.astype(np.uint64)
    key = pcg4d([shape + np.uint64(seed & 0xFFFFFFFF), shape + np.uint64(seed >> 32),
                 sample >> np.uint64(32), shape + np.uint64(0x76657269)])  # fmt: skip
    place = (pixel.astype(np.uint64) + key[0]) & U32
    words = pcg4d([place, sample & U32, block.astype(np.uint64), key[1]])
    independent = np.stack(words, axis=1).astype(np.uint32)
    if sampler == "independent":
        return independent
    group = [place, (sample & U32) >> np.uint64(4), block.astype(np.uint64), key[1] ^ U32]
    digits = np.stack(group_digits(pcg4d(group), sample), axis=1).astype(np.uint32)
    led = independent & np.uint32(0x0FFFFFFF) | digits << np.uint32(28)
    return np.where(block[:, None] < SOBOL_BLOCKS, led, independent)


def group_digits(random: Sequence[Array], sample: Array) -> list[Array]:
    """The leading 4 binary digits of 4 numbers of a sample, as integers below 16: Sobol's first 16
    points, by direction numbers, in an order by a random linear map of bits (J. Matousek 1998) and
    with a random digital shift."""

    def bits(words: Array, k: int) -> Array:
        return words.astype(np.uint64) >> np.uint64(k) & np.uint64(1)

    order, shift = random[:2]
    columns = []
    for pair in (0, 1):
        # Bit k of the place: that of the sample, random ones of the higher bits, and a shift.
        place = []
        for k in range(4):
            bit = bits(sample, k) ^ bits(order, 16 * pair + 7 - k)
            for high in range(k + 1, 4):
                first = {3: 7, 2: 10, 1: 12}[high]
                bit = bit ^ bits(sample, high) & bits(order, 16 * pair + first + 3 - k)
            place.append(bit)
        for dimension in (0, 1):
            byte, v = 16 * pair + 8 * dimension, 8
            digit = [np.zeros_like(place[0]) for _ in range(4)]  # the first one highest
            for k in range(4):
                for d in range(4):
                    digit[d] = digit[d] ^ (place[k] if v >> (3 - d) & 1 else np.uint64(0))
                v = v ^ v >> 1 if dimension else v >> 1
            number = np.zeros_like(place[0])
            for d in range(4):
                number |= (digit[d] ^ bits(shift, byte + 7 - d)) << np.uint64(3 - d)
            columns.append(number)
    return columns


def native_words(native: Any, sampler: str = "independent") -> Words:
    """Ours, from a native module."""

    def words(seed: int, pixel: Array, sample: Array, block: Array) -> Array:
        out: Array = native.random(seed % 2**64, pixel.astype(np.uint32), sample.astype(np.uint64),
                                   block.astype(np.uint32), sampler)  # fmt: skip
        return out

    return words


def native_numbers(seed: int = 0) -> Numbers:
    """The direction numbers of a bounce as the renderer draws them."""
    words = native_words(device_module.select("cpu")[0].native)

    def numbers(pixel: Array, sample: int, bounce: int) -> Array:
        same = np.zeros(len(pixel), np.uint64)
        block = same + np.uint64(3 * bounce + 1)  # "scatter" of segment `bounce`
        return (words(seed, pixel, same + np.uint64(sample), block)[:, 2:] >> 8) * 2.0**-24

    return numbers


# ---- planted ----


def hash32(value: Array | int) -> Array:
    """A 32-bit integer hash with good avalanche (C. Wellons, "lowbias32", 2018)."""
    x = np.atleast_1d(np.asarray(value, np.uint32)).copy()
    for shift, factor in ((16, 0x7FEB352D), (15, 0x846CA68B)):
        x ^= x >> np.uint32(shift)
        x *= np.uint32(factor)
    return x ^ (x >> np.uint32(16))


def _seeded(pixel: Array, sample: Any, bounce: Any, clock: Any) -> Array:
    """The generator of 2016: (P,), rest (P,) or one number, to (P, 2) in (0, 1)."""
    seed = hash32(pixel) + hash32((sample + clock) & 0xFFFFFFFF) + hash32(bounce)
    first = np.maximum(seed.astype(np.uint64) % MODULUS, 1) * FACTOR % MODULUS
    return np.stack([first, first * FACTOR % MODULUS], axis=1) / MODULUS


def seeded_2016(ticks_a_pass: int, ticks_a_bounce: int) -> Numbers:
    """Two numbers of a linear generator, seeded anew for each pixel, pass and bounce.

    The seeding of the report "Parallel Path Tracing in CUDA" (H. Dahlberg, KTH, 2016), reproduced:
    seed = hash(pixel) + hash(pass + clock) + hash(depth), modulo 2^32. The clock starts at an
    arbitrary value and advances by the given ticks. The addend is the same for all pixels and the
    generator is linear, so the numbers of a pixel in two bounces obey u' = frac(u + c).
    """

    def numbers(pixel: Array, sample: int, bounce: int) -> Array:
        return _seeded(pixel, sample, bounce, 40_961 + sample * ticks_a_pass
                       + bounce * ticks_a_bounce)  # fmt: skip

    return numbers


def words_2016(ticks_a_pass: int, ticks_a_bounce: int) -> Words:
    """The same as words: the block is the bounce, the seed an offset of the clock."""

    def words(seed: int, pixel: Array, sample: Array, block: Array) -> Array:
        low = np.int64(0xFFFFFFFF)
        p, k, b = (np.asarray(x).astype(np.int64) & low for x in (pixel, sample, block))
        clock = (40_961 + seed % 2**31 + k * ticks_a_pass + b * ticks_a_bounce) & low
        u = _seeded(p, k, b, clock)
        return (u * 2.0**32).astype(np.uint32)

    return words


def linear_words(seed: int, pixel: Array, sample: Array, block: Array) -> Array:
    """Planted: x -> 48271 x mod 2^31 - 1 seeded with an index, as path tracers of 2016 did it."""
    x = pixel.astype(np.int64) + 640 * 480 * sample.astype(np.int64) + 7919 * block.astype(np.int64)
    x = (seed % MODULUS + x) % MODULUS
    columns = []
    for _ in range(4):
        x = x * FACTOR % MODULUS
        columns.append(x * 2)
    return np.stack(columns, axis=1).astype(np.uint32)
