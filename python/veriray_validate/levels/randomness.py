"""Level 1: random numbers, and pictures made with them.

Numbers are a function of seed, pixel, sample and block (three blocks per bounce). A stream along
any of the four must look random, and so must any two streams side by side. The seeding of the 2016
report, reproduced, is the planted failure.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Any

import numpy as np
import numpy.typing as npt
from scipy import stats

from veriray import device as device_module
from veriray_validate.generators import (
    Words,
    expected,
    linear_words,
    native_words,
    pcg4d,
    words_2016,
)
from veriray_validate.scenes import furnace
from veriray_validate.statistics import chi_square, grids, max_z, sidak
from veriray_validate.trial import Inconclusive, Trial, case

Array = npt.NDArray[Any]


@case(1, once=True)
def published_vector(t: Trial) -> None:
    """The second implementation of pcg4d gives the hashes of (0, 0, 0, 0) and (1, 2, 3, 4).

    Equal to the listing carried out in integers of any length. M. Jarzynski, M. Olano, JCGT 9(3),
    2020.
    """
    for v in ([0, 0, 0, 0], [1, 2, 3, 4]):
        x = [(a * 1664525 + 1013904223) % 2**32 for a in v]
        for final in (False, True):
            for k, (i, j) in enumerate(((1, 3), (2, 0), (0, 1), (1, 2))):
                x[k] = (x[k] + x[i] * x[j]) % 2**32
            if not final:
                x = [a ^ a >> 16 for a in x]
        t.check([int(a[0]) for a in pcg4d([np.array([a]) for a in v])] == x, f"{v}")


@case(1, each={"seed": [0, 1, 2**32, 2**64 - 1, 0x123456789ABCDEF0]}, once=True)
def known_answers(t: Trial, seed: int) -> None:
    """The generator's words on every device against the second implementation.

    Equal to the bit, for sample numbers about 2^32, 2^63 and 2^64 too.
    """
    pixel = t.rng.integers(0, 2**31, 2000)
    sample = t.rng.integers(0, 2**63, 2000, np.uint64)
    block = t.rng.integers(0, 2**17, 2000)
    sample[:6] = [0, 2**32 - 1, 2**32, 2**63 - 1, 2**63, 2**64 - 1]
    for name in t.devices:
        words = native_words(device_module.select(name)[0].native)
        got = words(seed, pixel, sample, block)
        t.check(got == expected(seed, pixel, sample, block), name)


@case(1, each={"bits": [18, 26]}, once=True, quick=lambda bits: bits < 26)
def same_words(t: Trial, bits: int) -> None:
    """2^18, in a full run 2^26 blocks of random words are the same on all devices.

    Equal to the bit; with one device, to the second implementation at every 16th.
    """
    modules = {d: native_words(device_module.select(d)[0].native) for d in t.devices}
    size = 2**18
    for _ in range(2**bits // size):
        seed = int(t.rng.integers(2**63))
        where = (t.rng.integers(0, 2**32, size), t.rng.integers(0, 2**63, size, np.uint64),
                 t.rng.integers(0, 2**18, size))  # fmt: skip
        all_words = [words(seed, *where) for words in modules.values()]
        for name, got in zip(modules, all_words, strict=True):
            t.check(got == all_words[0], name)
        some = [w[::16] for w in where]
        t.check(all_words[0][::16] == expected(seed, *some), "second implementation")


@case(1)
def no_repeats_around_two_to_the_32(t: Trial) -> None:
    """The upper half of the sample index counts: streams do not repeat after 2^32 or 2^63.

    4,000 blocks of four words about these places are all different.
    """
    sample = np.concatenate([np.arange(1000, dtype=np.uint64) + np.uint64(at)
                             for at in (0, 2**32 - 500, 2**33, 2**63 - 500)])  # fmt: skip
    zero = np.zeros(len(sample), np.uint64)
    words = native_words(t.native)(t.fresh(), zero, sample, zero)
    t.check(len(np.unique(words, axis=0)) == len(sample), "repeats")


def uniformity(words: Words, seed: int, n: int) -> float:
    """Of upper and lower 8 bits of each word, and of all four words together; a p value."""
    i, zero = np.arange(n), np.zeros(n, np.int64)
    worst = 1.0
    for where in ((i, zero, zero), (zero, i, zero), (zero, zero, i)):
        block = words(seed, *where)
        for column in block.T:
            for byte in (column >> 24, column >> 8 & 255):
                counts = np.bincount(byte, minlength=256)
                worst = min(worst, chi_square(counts, np.full(256, n / 256)))
        cells = np.zeros(n, np.int64)
        for column in block.T:
            cells = cells * 8 + (column >> 29)
        size = 8 ** block.shape[1]
        worst = min(worst, chi_square(np.bincount(cells, minlength=size), np.full(size, n / size)))
    return sidak(worst, 27)


@case(1)
def words_are_uniform(t: Trial) -> None:
    """Words along pixels, samples and blocks are uniform.

    Chi-square of the upper and of the lower 8 bits of each word and of 8^4 cells of the four, 2^17
    blocks each: sees a bin that is off by 20 %, or a tilt of 1.5 %.
    """
    t.p(uniformity(native_words(t.native), t.fresh(), 2**17 * t.effort), "uniformity")


def pair_correlations(words: Words, effort: int, seed: int) -> float:
    """The p value of the largest correlation of words and of |u - 1/2| between neighbours.

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
    z: list[float] = []
    for other in others:
        z += correlations(base, other, upper=other is base)
    return max_z(np.array(z))


def correlations(a: Array, b: Array, upper: bool = False) -> list[float]:
    """Standard scores of the correlations of words, and of |u - 1/2|; upper: of word i < word j."""
    n, k = a.shape
    p, q = ((w.astype(np.float64) + 0.5) * 2.0**-32 - 0.5 for w in (a, b))
    z: list[float] = []
    for x, y, scale in ((p, q, 1 / 12), (np.abs(p) - 0.25, np.abs(q) - 0.25, 1 / 48)):
        r = x.T @ y / (scale * np.sqrt(n))
        z += r[np.triu_indices(k, 1)].tolist() if upper else r.ravel().tolist()
    return z


@case(1)
def neighbours_are_uncorrelated(t: Trial) -> None:
    """Words of neighbouring pixels, samples, blocks and seeds, in random places.

    n = 2^14 pairs, 204 correlations: sees one of 0.043 with 90 % power.
    """
    t.p(pair_correlations(native_words(t.native), t.effort, t.fresh()), "correlation")


def stream_p(words: Words, rng: np.random.Generator, n: int, contexts: int) -> float:
    """The p value of the worst pair of streams side by side.

    A stream runs along n pixels, samples or blocks, the other three numbers fixed; its neighbour
    differs in one of the four. Per pair: correlations of words and of |u - 1/2|, and chi-square
    grids of (word, same word of the neighbour), which see any relation u' = frac(u + c).
    """
    z: list[float] = []
    worst, grid_count = 1.0, 0
    i = np.arange(n)
    for _ in range(contexts):
        seed = int(rng.integers(2**63))
        start = {"pixel": int(rng.integers(2**20)), "sample": int(rng.integers(2**31)),
                 "block": int(rng.integers(64))}  # fmt: skip
        for axis in start:
            at = {name: first + (i if name == axis else 0 * i) for name, first in start.items()}

            def stream(s: int, p: int = 0, k: int = 0, b: int = 0, at: Any = at) -> Array:
                return words(s, at["pixel"] + p, at["sample"] + k, at["block"] + b)

            base = stream(seed)
            others = [stream(seed, p=1), stream(seed, p=512), stream(seed, k=1), stream(seed, b=1),
                      stream(seed, b=3), stream(seed + 1), stream(seed + 2**32)]  # fmt: skip
            z += correlations(base, base, upper=True)
            for other in others:
                z += correlations(base, other)
                for x, y in zip(base.T, other.T, strict=True):
                    worst = min(worst, grids(x * 2.0**-32, y * 2.0**-32))
                    grid_count += 1
    return sidak(min(max_z(np.array(z)), sidak(worst, grid_count)), 2)


@case(1)
def streams_are_independent(t: Trial) -> None:
    """Streams along pixels, samples and blocks against their neighbours'.

    Neighbours: the next pixel, row, sample, bounce, dimension and seed. 2^12 numbers each, 4
    places: sees a correlation of 0.1 in any of 2,700, and u' = frac(u + c)
    for any c.
    """
    p = stream_p(native_words(t.native), t.rng, 2**12 * t.effort, 4)
    t.p(p, "streams")


#: Clock still within a pass; clock read at each bounce.
PLANTED_2016 = {"clock still": (7, 0), "clock read each bounce": (7_411, 877)}


@case(1, each={"clock": PLANTED_2016}, once=True)
def the_generator_of_2016_is_found_out(t: Trial, clock: str) -> None:
    """Planted: the seeding of the 2016 report, in which a bounce shifts all pixels alike.

    The test of streams rejects it, p below 1e-9: u' = frac(u + c) with one c for a picture.
    """
    p = stream_p(words_2016(*PLANTED_2016[clock]), t.rng, 2**12, 4)
    t.check(p < 1e-9, f"not rejected: p = {p:.2g}")


@case(1, once=True)
def a_linear_generator_is_found_out(t: Trial) -> None:
    """Planted: x -> 48271 x mod 2^31 - 1 seeded with the pixel's and the sample's number.

    Both tests of correlation reject it, p below 1e-9.
    """
    t.check(pair_correlations(linear_words, 1, 1) < 1e-9, "neighbours")
    t.check(stream_p(linear_words, t.rng, 2**12, 4) < 1e-9, "streams")


# ---- pictures ----


@case(1)
def seeds_are_independent(t: Trial) -> None:
    """Noise of films of different seeds, and of neighbouring pixels, is uncorrelated.

    64 x 64 pixels: sees a correlation of 0.09 in any of 36 pairs or 3 neighbours of 9 films.
    It uses normal scores of the ranks, because products of heavy-tailed noise are far from normal.
    """
    scene = furnace(0.5, 0.5, width=64, height=64 * t.effort)
    shift = t.fresh()
    noise = []
    for seed in (0, 1, 2, 3, 2**32, 2**32 + 1, 2**63, 2**64 - 2, 2**64 - 1):
        image = t.render(scene, 2, seed=(seed + shift) % 2**64).image
        ranks = stats.rankdata(image[:, :, 0]).reshape(image.shape[:2])
        scores = stats.norm.ppf((ranks - 0.5) / ranks.size)
        noise.append(scores / scores.std())
    z = []
    for i, a in enumerate(noise):
        pairs = [(a, b) for b in noise[:i]]
        pairs += [(a[1:], a[:-1]), (a[:, 1:], a[:, :-1]), (a[1:, 1:], a[:-1, :-1])]
        z += [float((p * q).sum()) / math.sqrt(p.size) for p, q in pairs]
    t.p(max_z(np.array(z)), "correlation of films")
    t.figure("z", z)


@case(1)
def pixels_do_not_share_samples(t: Trial) -> None:
    """Variance of the picture's mean against the mean of the pixels' variances; 48 seeds.

    The only test that finds "the same seed in every pixel" (a ratio of 256). Sees 2.2 or 0.4.
    """
    scene, n = furnace(0.5, 0.5, width=16, height=16), 48 * t.effort
    images = np.array([t.render(scene, 4).image[:, :, 0] for _ in range(n)], np.float64)
    ratio = images.mean((1, 2)).var(ddof=1) / (images.var(axis=0, ddof=1).mean() / 256)
    law = stats.chi2(n - 1)
    t.p(2 * float(min(law.sf(ratio * (n - 1)), law.cdf(ratio * (n - 1)))), "variance")
    t.figure("ratio", float(ratio))


@case(1)
def batches_are_independent(t: Trial) -> None:
    """Means of successive batches are uncorrelated, and their spread is that of noise.

    Lag 1 of 64 batches in 16 x 16 pixels: sees a correlation of 0.04. Error bars from batches
    against those from samples: sees a ratio of the variances of 1.05.
    """
    r = t.render(furnace(0.5, 0.5, width=16, height=16), 1024, batches=64)
    means = np.asarray(r.batch_means, np.float64)[..., 0]
    off = means - means.mean(axis=0)
    lag = (off[1:] * off[:-1]).sum(axis=0) / (off**2).sum(axis=0)  # E = -1/B, variance 1/B
    b = len(means)
    z = (lag.mean() + 1 / b) / math.sqrt((b - 2) / b**2 / lag.size)
    t.p(2 * float(stats.norm.sf(abs(z))), "lag of one batch")
    spread = means.var(axis=0, ddof=1) / b
    claimed = r.stderr[..., 0].astype(np.float64) ** 2
    ratio = spread / claimed
    error = ratio.std(ddof=1) / math.sqrt(ratio.size)
    t.p(2 * float(stats.norm.sf(abs(ratio.mean() - 1) / error)), "error bars")
    t.figure("variance of batches over samples", float(ratio.mean()))


SAMPLES = (4, 16, 64, 256, 1024)


def decay(images: Sequence[Array]) -> tuple[Array, float, float]:
    """MSE of pictures of SAMPLES samples whose exact answer is 1; slope of log MSE, its error."""
    squares = [(image.astype(np.float64) - 1) ** 2 for image in images]
    mse = np.array([s.mean() for s in squares])
    error = np.array([s.std() / math.sqrt(s.size) / s.mean() for s in squares])
    x, weight = np.log(np.array(SAMPLES, np.float64)), 1 / error**2
    x -= (weight * x).sum() / weight.sum()
    slope = float((weight * x * np.log(mse)).sum() / (weight * x**2).sum())
    return mse, slope, float(1 / np.sqrt((weight * x**2).sum()))


@case(1)
def error_falls_as_one_over_samples(t: Trial) -> None:
    """The mean squared error falls by 4.0 +- 0.3 per four times the samples.

    64 x 64 pixels of a closed box with the exact answer 1, 4 to 1,024 samples each: slope -1 of
    log MSE against log n within its standard error, which must be so small that a factor of 3.7 or
    4.3 is found. A flatter slope is a stuck generator, or bias.
    """
    scene = furnace(0.5, 0.5, width=64, height=64)
    mse, slope, deviation = decay([t.render(scene, n).image[:, :, 0] for n in SAMPLES])
    factor, spread = 4.0**-slope, 4 * math.log(4) * deviation
    t.figure("error against spp", [[n, float(m)] for n, m in zip(SAMPLES, mse, strict=True)])
    t.figure("factor", [factor, spread])
    if (3.29 + 1.28) * spread > 0.3:
        raise Inconclusive(f"the factor's standard error is {spread:.2g}")
    t.sees((3.29 + 1.28) * spread / 4)
    t.p(2 * float(stats.norm.sf(abs(slope + 1) / deviation)), f"factor {factor:.3f}")


@case(1, each={"period": (64, 256)}, once=True)
def a_stream_that_repeats_is_found_out(t: Trial, period: int) -> None:
    """Planted: after `period` samples each pixel's numbers repeat, so the mean stays.

    The test of the error's decrease rejects it, p below 1e-9.
    """
    scene = furnace(0.5, 0.5, width=64, height=64)
    images = [t.render(scene, min(n, period), seed=n if n < period else period).image[:, :, 0]
              for n in SAMPLES]  # fmt: skip
    _, slope, deviation = decay(images)
    p = 2 * float(stats.norm.sf(abs(slope + 1) / deviation))
    t.check(p < 1e-9, f"not rejected: slope {slope:.3f}, p = {p:.2g}")
