"""core/rng: the generator against an independent implementation, and its statistics."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest

from tests.support import FAST, chi_square, confirm, max_z, native, sidak

U32 = np.uint64(0xFFFFFFFF)
Words = Callable[[int, np.ndarray, np.ndarray, np.ndarray], np.ndarray]


def pcg4d(v: list[np.ndarray]) -> list[np.ndarray]:
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


def expected(seed: int, pixel: np.ndarray, sample: np.ndarray, block: np.ndarray) -> np.ndarray:
    """The key is a hash of the seed, the upper half of the sample index and a constant."""
    shape = np.zeros(len(pixel), np.uint64)
    sample = sample.astype(np.uint64)
    key = pcg4d([shape + np.uint64(seed & 0xFFFFFFFF), shape + np.uint64(seed >> 32),
                 sample >> np.uint64(32), shape + np.uint64(0x76657269)])  # fmt: skip
    words = pcg4d([(pixel.astype(np.uint64) + key[0]) & U32, sample & U32,
                   block.astype(np.uint64), key[1]])  # fmt: skip
    return np.stack(words, axis=1).astype(np.uint32)


def ours(device: str) -> Words:
    def words(seed: int, pixel: np.ndarray, sample: np.ndarray, block: np.ndarray) -> np.ndarray:
        return native(device).random(seed, pixel.astype(np.uint32), sample.astype(np.uint64),
                                     block.astype(np.uint32))  # fmt: skip

    return words


def test_published_vector() -> None:
    """pcg4d(0, 0, 0, 0) and pcg4d(1, 2, 3, 4) computed by hand with integers of any length."""
    for v in ([0, 0, 0, 0], [1, 2, 3, 4]):
        x = [(a * 1664525 + 1013904223) % 2**32 for a in v]
        for final in (False, True):
            for k, (i, j) in enumerate(((1, 3), (2, 0), (0, 1), (1, 2))):
                x[k] = (x[k] + x[i] * x[j]) % 2**32
            if not final:
                x = [a ^ a >> 16 for a in x]
        assert [int(a[0]) for a in pcg4d([np.array([a]) for a in v])] == x


@pytest.mark.parametrize("seed", [0, 1, 2**32, 2**64 - 1, 0x123456789ABCDEF0])
def test_known_answers(device: str, seed: int) -> None:
    rng = np.random.default_rng(3)
    pixel = rng.integers(0, 2**31, 2000)
    sample = rng.integers(0, 2**63, 2000, np.uint64)
    block = rng.integers(0, 2**17, 2000)
    sample[:6] = [0, 2**32 - 1, 2**32, 2**63 - 1, 2**63, 2**64 - 1]
    got = ours(device)(seed, pixel, sample, block)
    assert (got == expected(seed, pixel, sample, block)).all()


@pytest.mark.parametrize("device", FAST)
def test_no_repeats_around_two_to_the_32(device: str) -> None:
    """The upper half of the sample index counts: streams do not start again at 2^32 or 2^63."""
    sample = np.concatenate([np.arange(1000, dtype=np.uint64) + np.uint64(at)
                             for at in (0, 2**32 - 500, 2**33, 2**63 - 500)])  # fmt: skip
    zero = np.zeros(len(sample))
    words = ours(device)(7, zero, sample, zero)
    assert len(np.unique(words, axis=0)) == len(sample)


@pytest.mark.parametrize("device", FAST)
def test_words_are_uniform(device: str) -> None:
    """Chi-square of the upper and of the lower 8 bits of each word, along each of the counters.

    N = 2^17 a cell of the product: sees a bin that is off by 20 %, or a tilt of 1.5 %.
    """

    def p_value(effort: int, seed: int) -> float:
        n = 2**17 * effort
        i, zero = np.arange(n), np.zeros(n)
        worst = 1.0
        for where in ((i, zero, zero), (zero, i, zero), (zero, zero, i)):
            words = ours(device)(seed, *where)
            for column in words.T:
                for byte in (column >> 24, column >> 8 & 255):
                    counts = np.bincount(byte, minlength=256)
                    worst = min(worst, chi_square(counts, np.full(256, n / 256)))
        return sidak(worst, 24)

    confirm(p_value)


def pair_correlations(words: Words, effort: int, seed: int) -> float:
    """p value of the largest correlation of words and of |u - 1/2| between neighbours.

    Neighbours in pixel (next, next row of 512), sample, block, seed, seed's upper half, word.
    """
    n = 2**14 * effort
    rng = np.random.default_rng(seed)
    pixel, sample, block = rng.integers(0, 2**18, n), np.arange(n), rng.integers(0, 40, n)
    base = words(seed, pixel, sample, block)
    others = [
        words(seed, pixel + 1, sample, block), words(seed, pixel + 512, sample, block),
        words(seed, pixel, sample + 1, block), words(seed, pixel, sample, block + 1),
        words(seed + 1, pixel, sample, block), words(seed + 2**32, pixel, sample, block), base,
    ]  # fmt: skip
    z = []
    for other in others:
        a, b = ((w.astype(np.float64) + 0.5) * 2.0**-32 - 0.5 for w in (base, other))
        for x, y, scale in ((a, b, 1 / 12), (np.abs(a) - 0.25, np.abs(b) - 0.25, 1 / 48)):
            r = x.T @ y / (scale * np.sqrt(n))
            z += r[np.triu_indices(4, 1)].tolist() if other is base else r.ravel().tolist()
    return max_z(np.array(z))


@pytest.mark.parametrize("device", FAST)
def test_neighbours_are_uncorrelated(device: str) -> None:
    """n = 2^14 pairs, 204 correlations: sees one of 0.043 with 90 % power."""
    confirm(lambda effort, seed: pair_correlations(ours(device), effort, seed))


def test_a_linear_generator_is_found_out() -> None:
    """Planted: x -> 48271 x mod 2^31 - 1 seeded with the index, as path tracers of 2016 did it."""

    def words(seed: int, pixel: np.ndarray, sample: np.ndarray, block: np.ndarray) -> np.ndarray:
        x = (seed + pixel + 640 * 480 * sample.astype(np.int64) + 7919 * block) % (2**31 - 1)
        columns = []
        for _ in range(4):
            x = x * 48271 % (2**31 - 1)
            columns.append(x * 2)
        return np.stack(columns, axis=1).astype(np.uint32)

    assert pair_correlations(words, 1, 1) < 1e-9
