"""Level 1: the Sobol sampler: random from group to group, a net within one; errors by groups."""

from __future__ import annotations

import itertools
from collections import defaultdict

import numpy as np
from scipy import linalg, stats

import veriray
from veriray import device as device_module
from veriray_validate.generators import SOBOL_BLOCKS, expected, native_words
from veriray_validate.levels.randomness import Array, correlations
from veriray_validate.scenes import furnace
from veriray_validate.statistics import chi_square, max_z, sidak
from veriray_validate.trial import Trial, case


@case(1, once=True)
def sobol_known_answers(t: Trial) -> None:
    """The sampler's words on every device against the second implementation, by direction numbers.

    Equal to the bit, for sample numbers about 2^32, 2^63 and 2^64 too.
    """
    pixel, block = t.rng.integers(0, 2**31, 4000), t.rng.integers(0, 2 * SOBOL_BLOCKS, 4000)
    sample = t.rng.integers(0, 2**63, 4000, np.uint64)
    sample[:6] = [0, 2**32 - 1, 2**32, 2**63 - 1, 2**63, 2**64 - 1]
    for name in t.devices:
        for seed in (0, 2**64 - 1, t.fresh()):
            words = native_words(device_module.select(name)[0].native, "sobol")
            got = words(seed, pixel, sample, block)
            t.check(got == expected(seed, pixel, sample, block, "sobol"), name)


@case(1, each={"first": [0, 1 << 12, 2**32 - (1 << 10)]})
def sobol_points_are_nets(t: Trial, first: int) -> None:
    """2^m samples from a multiple of 2^m on, m <= 4: one in each cell of every dyadic partition.

    Exact; pairs of all blocks, 64 groups. A. Owen 1997: scrambling keeps a (0, m, 2)-net.
    """
    index = np.arange(first, first + 2**10, dtype=np.uint64)
    words = native_words(t.native, "sobol")
    for block in range(SOBOL_BLOCKS):
        same = np.zeros(len(index), np.int64)
        got = words(t.fresh(), same + int(t.rng.integers(2**20)), index, same + block)
        for x, y in got.T.astype(np.int64).reshape(2, 2, -1):
            for m in range(1, 5):
                for k in range(m + 1):
                    cell = x >> (32 - k) << (m - k) | y >> (32 - (m - k))
                    runs = np.sort(cell.reshape(-1, 2**m), axis=1)
                    t.check(runs == np.arange(2**m), f"block {block}: {2**k} x {2 ** (m - k)}")


@case(1)
def sobol_pixels_are_independent(t: Trial) -> None:
    """Words of one sample along pixels, blocks and seeds: uniform, and without correlation.

    Chi-square of the upper 8 bits and of 8^4 cells of a block's words, 2^17 of them; correlations
    of words and of |u - 1/2| in a block, with the next pixel, block and seed, 2^14 pairs: sees
    .043.
    """
    n, words = 2**17 * t.effort, native_words(t.native, "sobol")
    i, zero = np.arange(n), np.zeros(n, np.int64)
    sample, seed = zero + int(t.rng.integers(2**20)), t.fresh()
    worst = 1.0
    for got in (words(seed, i, sample, zero), words(seed, i, sample, zero + 5)):
        for column in got.T:
            counts = np.bincount(column >> 24, minlength=256)
            worst = min(worst, chi_square(counts, np.full(256, n / 256)))
        cells = (got >> 29).astype(np.int64) @ 8 ** np.arange(4)
        worst = min(worst, chi_square(np.bincount(cells, minlength=4096), np.full(4096, n / 4096)))
    t.p(sidak(worst, 10), "uniformity")
    i, zero, sample = i[: 2**14], zero[: 2**14], sample[: 2**14]
    base, z = words(seed, i, sample, zero), []
    for other in (
        words(seed, i + 1, sample, zero),
        words(seed, i, sample, zero + 1),
        words(seed + 1, i, sample, zero),
    ):
        z += correlations(base, other)
    z += correlations(base, base, upper=True)
    t.p(max_z(np.array(z)), "correlation")


@case(1, each={"sampler": veriray.SAMPLERS})
def digits_are_independent(t: Trial, sampler: str) -> None:
    """Parities of leading digits of a word and of another one are not correlated.

    Every parity of four digits of each of a block's words with every one of the next block,
    segment, pixel, group of 16 samples and seed, and of other words of the block: 2^18 pairs, 16
    seeds. Sees a correlation of 1.1 %; digits made of the lowest bits of the hash have 6 %.
    """
    n, words = 2**14 * t.effort, native_words(t.native, sampler)
    counts: dict[tuple[int, int, int], Array] = defaultdict(lambda: np.zeros(256))
    for _ in range(16):
        seed, block = t.fresh(), np.full(n, t.rng.integers(SOBOL_BLOCKS - 3))
        pixel, sample = t.rng.integers(0, 2**20, n), t.rng.integers(0, 2**16, n)
        others = (
            words(seed, pixel, sample, block + 1), words(seed, pixel, sample, block + 3),
            words(seed, pixel + 1, sample, block), words(seed, pixel, sample + 16, block),
            words(seed + 1, pixel, sample, block), words(seed, pixel, sample, block),
        )  # fmt: skip
        one = (others[-1] >> 28).astype(np.int64)
        for k, other in enumerate(others):
            for a, b in itertools.product(range(4), repeat=2):
                if k < 5 or a < b:
                    both = one[:, a] << 4 | (other[:, b] >> 28)
                    counts[k, a, b] += np.bincount(both, minlength=256)
    sums = linalg.hadamard(16) @ np.reshape(list(counts.values()), (-1, 16, 16))
    z = (sums @ linalg.hadamard(16) / np.sqrt(16 * n))[:, 1:, 1:]
    t.figure("largest correlation", float(abs(z).max() / np.sqrt(16 * n)))
    t.p(max_z(z.ravel()), "parities")


@case(1)
def sobol_pairs_are_independent(t: Trial) -> None:
    """Pairs of one pixel are in random order to each other: joint cells of words of two pairs.

    64 samples in 8 x 8 cells of (a word of one pair, a word of another), 2^10 pixels: each run of 8
    samples puts one in every row and column, and those of two runs are not correlated, so the
    variance of a cell is 8 (1/8) (7/8). Sees one that is off by 5 %; without the shuffle it is 7.
    """
    pixels = 2**10 * t.effort
    p, s = (a.ravel() for a in np.meshgrid(np.arange(pixels), np.arange(64), indexing="ij"))
    words = native_words(t.native, "sobol")
    seed = t.fresh()
    columns = np.hstack([words(seed, p, s, 0 * p + b) for b in (0, 4, 5)]) >> 29
    pairs = [(0, 2), (1, 3), (2, 4), (4, 6), (5, 9), (8, 10)]
    z = []
    for a, b in pairs:
        cell = columns[:, a].astype(np.int64) * 8 + columns[:, b] + 64 * p
        square = (np.bincount(cell, minlength=64 * pixels).reshape(pixels, 64) - 1.0) ** 2
        mean = square.mean(axis=1)
        z.append((mean.mean() - 7 / 8) / (mean.std(ddof=1) / np.sqrt(pixels)))
        t.figures.setdefault("squared deviation", []).append(float(mean.mean()))
    t.p(max_z(np.array(z)), "joint cells")


@case(1)
def sobol_means_are_unbiased(t: Trial) -> None:
    """A closed box with the exact answer 1: the mean of many pictures, each with a seed of its own.

    64 pictures of 64 pixels and 4 samples; z of the mean by the spread of the pictures. Sees a bias
    of 2 %; the pictures' own error bars must not be too small (chi-square, one-sided).
    """
    scene = furnace(0.5, 0.5, width=8, height=8)
    means, claimed = [], []
    for _ in range(64 * t.effort):
        r = t.render(scene, 4, sampler="sobol")
        means.append(float(r.image[..., 0].mean(dtype=np.float64)))
        claimed.append(float((r.stderr[..., 0].astype(np.float64) ** 2).sum()) / 64**2)
    n, spread = len(means), np.var(means, ddof=1)
    t.p(2 * float(stats.norm.sf(abs(np.mean(means) - 1) / np.sqrt(spread / n))), "mean")
    t.p(float(stats.chi2(n - 1).sf((n - 1) * spread / np.mean(claimed))), "error bars")
    t.sees((3.29 + 1.28) * float(np.sqrt(spread / n)))


@case(1, each={"spp": [64, 65, 160], "filter": ["box", "gaussian"]})
def sobol_errors_are_right(t: Trial, spp: int, filter: str) -> None:
    """The spread of pictures with seeds of their own is what their error bars say, on average.

    256 pictures of the Cornell box; Student's t of what the error bars of each, squared, claim
    beyond its squared distance from the mean. Sees error bars that are off by 10 %; those of as
    many independent samples are 1.9 times as large, and with a group that spp cuts as a whole one
    they are 2.6 (box) and 1.9 times as large at 65 samples.
    """
    scene = veriray.cornell_box().with_(width=16, height=16, filter=filter)
    renders = [t.render(scene, spp, sampler="sobol") for _ in range(64 * max(4, t.effort))]
    images = np.array([r.image for r in renders], np.float64)
    off = ((images - images.mean(axis=0)) ** 2).sum(axis=(1, 2, 3)) * (
        len(images) / (len(images) - 1)
    )
    claimed = np.array([(r.stderr.astype(np.float64) ** 2).sum() for r in renders])
    t.figure("claimed over true variance", float(claimed.sum() / off.sum()))
    t.p(float(stats.ttest_1samp(claimed - off, 0.0).pvalue), "variance")
    error = float(np.std(claimed - off, ddof=1)) / len(off) ** 0.5
    t.sees((3.29 + 1.28) * error / float(off.mean()) / 2, limit=0.2)


@case(1)
def sobol_error_falls_faster(t: Trial) -> None:
    """At 256 samples the squared error is below 0.6 of that of independent samples.

    1,024 pixels of a closed box with the exact answer 1. One-sided z on the logarithm of the ratio;
    a sampler that is no better than independent numbers fails with certainty.
    """
    scene = furnace(0.5, 0.5, width=32, height=32 * t.effort)
    square = {}
    for sampler in ("independent", "sobol"):
        image = t.render(scene, 256, sampler=sampler).image[..., 0].astype(np.float64)
        square[sampler] = (image - 1) ** 2
    ratio = square["sobol"].mean() / square["independent"].mean()
    error = np.sqrt(sum((s.std() / s.mean()) ** 2 / s.size for s in square.values()))
    t.figure("ratio", float(ratio))
    t.p(float(stats.norm.sf(np.log(ratio / 0.6) / error)), f"ratio {ratio:.2f}")
