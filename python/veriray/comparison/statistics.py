"""Tests behind the verdict of `veriray.compare`: exact sign flips at equal effort, else Welch.

Conventions: A is the picture under test, R the reference, d = A - R. Batch means are
(B, H, W, 3) float64 in linear radiance. A *cell* is a pixel, block or object, in one channel.

At equal effort (same B, same samples per batch, same estimator), swapping a pair (A_b, R_b) does
not change the distribution if the expectations agree. So the signs of d_b can be flipped:
p = (1 + flips at least as extreme) / (1 + flips) is exact, whatever the noise looks like
(Fisher 1935; the maximum over cells: Westfall and Young 1993, Resampling-Based Multiple Testing).

A float32 renderer has a true bias near 1e-6 and two programs decide some edges differently, so a
relative bias up to `MARGIN` does not count as a difference: each cell is tested against the point
nearest to its estimate within the margin.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, field, replace
from typing import TYPE_CHECKING, Any

import numpy as np

if TYPE_CHECKING:
    from numpy.typing import NDArray

    Array = NDArray[Any]

#: Relative bias that does not count as a difference; absolute for fractions of the ledger.
MARGIN = 1e-5
#: Relative rounding of half floats, of which neither side's tests may take notice.
HALF = 2.0**-11
#: Samples that must carry a mean before its t distribution is trusted: (sum x)^2 / sum x^2. As one
#: contribution is at most sqrt(sum x^2), it also bounds the largest to 1 % of the sum.
MIN_EFFECTIVE_SAMPLES = 10_000
#: Largest mean skewness of A - R at which pixels are tested. Measured with fireflies in A alone:
#: at 0.35, S2 (pixels) and S3 raise 2 % false alarms at a nominal 1 %; at 0.9 they raise 7 %.
MAX_ASYMMETRY = 0.3
#: Pixels that a filter reaches at most for blocks of 8 x 8 pixels to count as independent.
MOST_IN_BLOCKS = 4.0
#: Batches needed for a t test of blocks against a picture of another effort.
MIN_BATCHES = 64
CHANNELS = "RGB"
_POWER_Z = 1.2815515655446004  # 90 % power
MAX_CELLS = 200_000  # of one scale: bounds the time of the flips


@dataclass(frozen=True)
class Test:
    """Result of one test.

    Attributes:
        name: identifier and short name.
        finds: what a failure means.
        result: "pass", "fail", "inconclusive" (cannot decide: never counted as a pass).
        statistic, p: value and its probability without a difference, both corrected for the
            test's own many cells; None for exact conditions.
        threshold: p at or below this fails (Holm), None for exact conditions.
        where: the place that stands out most, or the reason when inconclusive.
    """

    __test__ = False  # not a test case for pytest

    name: str
    finds: str
    result: str
    statistic: float | None = None
    p: float | None = None
    threshold: float | None = None
    where: str = ""


@dataclass(frozen=True)
class Partition:
    """A picture cut into cells, separately for each channel.

    Attributes:
        name: of the scale.
        pixels: (C,) number of pixels per cell.
        mean: (..., H, W, 3) to (..., C), the mean over each cell.
        label: name of the k-th cell.
    """

    name: str
    pixels: NDArray[np.integer[Any]]
    mean: Callable[[Array], Array]
    label: Callable[[int], str]


@dataclass
class Cells:
    """Data of one scale: `values` (B, C) batch means of d, `level` (C,) mean of A and R."""

    name: str
    values: Array
    level: Array
    label: Callable[[int], str]
    t: Array = field(default_factory=lambda: np.zeros(1))


def holm(tests: Sequence[Test], alpha: float) -> list[Test]:
    """Decide the tests that have a p-value, at a family-wise error rate `alpha` (Holm 1979).

    Thresholds are alpha / (tests left), in order of p; tests without a p-value stay as they are.
    """
    family = sorted((t.p, k) for k, t in enumerate(tests) if t.p is not None)
    out, rejecting = list(tests), True
    for rank, (p, k) in enumerate(family):
        threshold = alpha / (len(family) - rank)
        rejecting = rejecting and p <= threshold
        out[k] = replace(tests[k], threshold=threshold, result="fail" if rejecting else "pass")
    return out


def flips_needed(alpha: float, tests: int) -> int:
    """Number of flips with which p can reach Holm's first threshold despite one exceedance."""
    return max(1000, 1000 * math.ceil(2.5 * tests / alpha / 1000)) - 1


def block_means(x: Array, size: int) -> Array:
    """(..., H, W, 3) to (..., ceil(H/size), ceil(W/size), 3); blocks at the edges are smaller."""
    if size == 1:
        return x
    height, width = x.shape[-3:-1]
    rows, columns = np.arange(0, height, size), np.arange(0, width, size)
    total = np.add.reduceat(np.add.reduceat(x, rows, axis=-3), columns, axis=-2)
    counts = np.minimum(size, height - rows)[:, None] * np.minimum(size, width - columns)
    means: Array = total / counts[..., None]
    return means


def block_sizes(height: int, width: int) -> list[int]:
    """1, 4, 16, 32, 64 ... up to half of the smaller side, without small ones for big pictures."""
    half = min(height, width) // 2
    sizes = [1, 4] + [1 << k for k in range(4, 17)]
    sizes = [s for s in sizes if s <= max(half, 1)]
    return [
        s for s in sizes if 3 * math.ceil(height / s) * math.ceil(width / s) <= MAX_CELLS
    ] or sizes[-1:]


def whole(height: int, width: int) -> Partition:
    """One cell per channel."""
    return Partition(
        "whole picture",
        np.full(3, height * width),
        lambda x: x.mean(axis=(-3, -2)),
        lambda k: f"mean of {CHANNELS[k]}",
    )


def blocks(height: int, width: int, size: int) -> Partition:
    """Cells of `block_means`."""
    columns = math.ceil(width / size)

    def label(k: int) -> str:
        y, x = divmod(k // 3, columns)
        kind = "pixel" if size == 1 else f"{size}x{size} block at"
        return f"{kind} ({x * size}, {y * size}) {CHANNELS[k % 3]}"

    rows, cols = (np.minimum(size, n - np.arange(0, n, size)) for n in (height, width))
    return Partition(
        "pixel" if size == 1 else f"{size}x{size}",
        np.repeat(np.outer(rows, cols).ravel(), 3),
        lambda x: block_means(x, size).reshape(*x.shape[:-3], -1),
        label,
    )


def objects(regions: NDArray[np.integer[Any]], names: dict[int, str]) -> Partition:
    """One cell per value of an (H, W) mask and channel."""
    order = np.argsort(regions, axis=None, kind="stable")
    values, first, counts = np.unique(regions.ravel()[order], return_index=True, return_counts=True)

    def mean(x: Array) -> Array:
        flat = x.reshape(*x.shape[:-3], -1, 3)[..., order, :]
        means: Array = np.add.reduceat(flat, first, axis=-2) / counts[:, None]
        return means.reshape(*x.shape[:-3], -1)

    def label(k: int) -> str:
        value = int(values[k // 3])
        return f"{names.get(value, f'object {value}')} {CHANNELS[k % 3]}"

    return Partition("objects", np.repeat(counts, 3), mean, label)


def cells(partition: Partition, d: Array, level: Array) -> Cells:
    """The differences (B, H, W, 3) and levels (H, W, 3) of each cell."""
    return Cells(partition.name, partition.mean(d), partition.mean(level), partition.label)


def _weights(d: Array, level: Array) -> Array:
    """Weights level/variance per 8x8 block: the best mean for a relative bias under uneven noise.

    They depend on A + R and on d^2 only, both unchanged by a swap, so the test stays exact.
    """
    mean = block_means(level, 8)
    with np.errstate(divide="ignore", invalid="ignore"):
        noise = block_means(np.mean(d * d, axis=0), 8) / mean**2
        usual = np.nanmedian(np.where(mean > 0, noise, np.nan))
        weight = 1.0 / (mean * (noise + 0.1 * usual))
    weight = np.where(np.isfinite(weight), weight, 0.0)
    return np.repeat(np.repeat(weight, 8, axis=0), 8, axis=1)[: d.shape[1], : d.shape[2]]


def whole_cells(d: Array, level: Array) -> Cells:
    """Means over the picture, plain and weighted (`_weights`), 3 channels each."""
    weight = _weights(d, level)
    total = np.maximum(weight.sum(axis=(0, 1)), 1e-300)
    values = [d.mean(axis=(1, 2)), np.einsum("bhwc,hwc->bc", d, weight) / total]
    levels = [level.mean(axis=(0, 1)), (level * weight).sum(axis=(0, 1)) / total]
    kinds = ("mean", "weighted mean")
    return Cells(
        "whole picture",
        np.hstack(values),
        np.hstack(levels),
        lambda k: f"{kinds[k // 3]} of {CHANNELS[k % 3]}",
    )


def within_margin(d: Array, level: Array, margin: float = MARGIN) -> Array:
    """D shifted towards mean zero by at most margin * |level|, per cell (batches on axis 0)."""
    limit = margin * np.abs(level)
    shifted: Array = d - np.clip(d.mean(axis=0), -limit, limit)
    return shifted


def sign_chunks(flips: int, batches: int, rng: np.random.Generator) -> Iterator[Array]:
    """Rows of +-1 (float32), 512 at a time; the very first row is all +1: the data themselves."""
    for start in range(0, flips + 1, 512):
        rows = min(512, flips + 1 - start)
        bits = np.frombuffer(rng.bytes((rows * batches + 7) // 8), np.uint8)
        signs = np.unpackbits(bits)[: rows * batches].astype(np.float32).reshape(rows, batches)
        signs = 2 * signs - 1
        if start == 0:
            signs[0] = 1
        yield signs


def _noisy(shifted: Array, level: Array) -> NDArray[np.bool_]:
    """Cells whose d is more than the rounding of float32 batch means."""
    noisy: NDArray[np.bool_] = np.sqrt(np.mean(shifted**2, axis=0)) > 1e-7 * np.abs(level)
    return noisy


def max_t(
    groups: Sequence[Cells], flips: int, rng: np.random.Generator
) -> tuple[float, str, float]:
    """Largest |t| over all cells, its place, and its p-value under sign flips of whole batches.

    |t| is monotone in |sum_b s_b d_b| / sqrt(sum_b d_b^2), whose denominator no flip changes, so
    the flips are one matrix product. Sets `t` of the cells.
    """
    parts = []
    for group in groups:
        shifted = within_margin(group.values, group.level)
        norm = np.sqrt(np.sum(shifted**2, axis=0))
        parts.append(np.where(_noisy(shifted, group.level), shifted / np.maximum(norm, 1e-300), 0))
        total = parts[-1].sum(axis=0)
        batches = len(shifted)
        group.t = total * np.sqrt((batches - 1) / np.maximum(batches - total**2, 1e-12))
    unit = np.hstack(parts).astype(np.float32)
    largest = []
    for signs in sign_chunks(flips, len(unit), rng):
        best = np.zeros(len(signs), np.float32)
        for start in range(0, unit.shape[1], 8192):
            sums = signs @ unit[:, start : start + 8192]
            np.maximum(best, np.maximum(sums.max(axis=1), -sums.min(axis=1)), out=best)
        largest.append(best)
    return (*_largest(groups), _tail(np.concatenate(largest)))


def _largest(groups: Sequence[Cells]) -> tuple[float, str]:
    """Largest |t| and its place, from `t` of the cells."""
    group = max(groups, key=lambda g: np.abs(g.t).max())
    k = int(np.argmax(np.abs(group.t)))
    change = group.values[:, k].mean() / max(abs(group.level[k]), 1e-300)
    return float(abs(group.t[k])), f"{group.label(k)}: {change:+.3%}, t = {group.t[k]:+.2f}"


def _tail(null: Array) -> float:
    """p-value of the first entry among all; ties within float32 rounding count against it."""
    return float(np.count_nonzero(null >= null[0] - 1e-6 * abs(null[0]))) / len(null)


def energy(
    d: Array, level: Array, flips: int, rng: np.random.Generator, alpha: float,
    whole: bool = False,
) -> tuple[float, float, float, float]:  # fmt: skip
    """Local bias of any sign: U = sum over cells of [(sum_b x_b)^2 - sum_b x_b^2].

    x is d over its root mean square per cell, so that noisy pixels do not drown the others. U is
    an unbiased estimate of B (B - 1) x the summed squared bias in units of the noise. Signs are
    flipped per batch and per block of 8x8 pixels (larger in pictures with over 1,024 of those), or
    if `whole` of all pixels alike, whose noise may then hang together. For one block, sum over
    cells of (sum_b s_b x_b)^2 is s^T G s with G the B x B Gram matrix.

    Returns (z of U, p, estimate of the rms relative bias, smallest one found with 90 % power at
    level `alpha`).
    """
    from scipy.stats import norm

    batches, height, width, _ = d.shape
    size = max(height, width) if whole else 8
    while math.ceil(height / size) * math.ceil(width / size) > 1024:
        size *= 2
    shifted = within_margin(d, level)
    rms = np.sqrt(np.mean(shifted**2, axis=0))
    scale = np.where(_noisy(shifted, level), 1 / np.maximum(rms, 1e-300), 0)
    x = (shifted * scale).astype(np.float32)
    total = np.zeros(flips + 1)
    for top in range(0, height, size):
        for left in range(0, width, size):
            cell = x[:, top : top + size, left : left + size].reshape(batches, -1)
            gram = cell @ cell.T
            np.fill_diagonal(gram, 0)
            total += np.concatenate(
                [
                    np.einsum("fb,fb->f", signs @ gram, signs)
                    for signs in sign_chunks(flips, batches, rng)
                ]
            )
    spread = float(total[1:].std())
    if spread == 0:
        return 0.0, 1.0, 0.0, math.nan
    signal = float(np.sum((level * scale) ** 2)) * batches * (batches - 1)
    z = float(total[0]) / spread
    bias, least = (
        math.sqrt(max(u, 0.0) * spread / signal) if signal > 0 else math.nan
        for u in (z, float(norm.isf(alpha)) + _POWER_Z)
    )
    return z, _tail(total), bias, least


def smallest_bias(
    level: Array, error: Array, dof: Array | float, alpha: float, tests: int
) -> Array:
    """Relative bias per cell that `tests` t tests at level `alpha` find with 90 % power.

    (critical t + 1.28) x standard error / level, critical t by Bonferroni. NaN where level is 0.
    """
    from scipy.stats import t

    critical = t.isf(alpha / (2 * tests), dof)
    with np.errstate(divide="ignore", invalid="ignore"):
        return np.where(level > 0, (critical + _POWER_Z) * error / level, np.nan)


def t_values(x: Array) -> Array:
    """Mean over axis 0 in its standard errors (t); 0 where nothing varies."""
    error = x.std(axis=0, ddof=1) / math.sqrt(len(x))
    return np.where(error > 0, x.mean(axis=0) / np.maximum(error, 1e-300), 0.0)


def variance_ratio(a: Array, r: Array) -> tuple[float, float, Array]:
    """Variance of A over that of R, such that no block of 8x8 pixels dominates.

    Per block q = (vA - vR)/(vA + vR), v summed over pixels with equal channel weights; q' = mean q
    and the ratio is (1 + q')/(1 - q'). Returns (ratio, its standard error, q per block).
    """
    va, vr = (block_means(x.var(axis=0, ddof=1), 8) for x in (a, r))
    both = va + vr
    level = block_means(0.5 * (a.mean(axis=0) + r.mean(axis=0)), 8)
    used = (both > 2e-12 * level**2).all(axis=-1)  # less is rounding alone
    if not used.any():
        return 1.0, 0.0, np.zeros(1)
    q = np.mean((va - vr)[used] / both[used], axis=-1)
    mean = float(np.clip(q.mean(), -1 + 1e-12, 1 - 1e-12))
    error = float(q.std(ddof=1)) / math.sqrt(q.size) if q.size > 1 else math.inf
    return (1 + mean) / (1 - mean), 2 * error / (1 - mean) ** 2, q


def variance_test(q: Array, flips: int, rng: np.random.Generator) -> float:
    """p-value that A and R have variances within a factor 1.25, by sign flips of blocks.

    A swap of A and R in one block changes the sign of its q, so the flips are exact.
    """
    shifted = q - np.clip(q.mean(), -1 / 9, 1 / 9)
    null = np.concatenate(
        [np.abs(s @ shifted.astype(np.float32)) for s in sign_chunks(flips, q.size, rng)]
    )
    return _tail(null)


def independence(x: Array) -> float:
    """Variance of the picture's mean over batches / the one that independent pixels give.

    About 1 +- sqrt(2/(B-1)) for independent pixels; the number of pixels if all use one stream.
    """
    alone = x.var(axis=0, ddof=1).sum(axis=(0, 1))
    together = x.sum(axis=(1, 2)).var(axis=0, ddof=1)
    return float(np.mean(together[alone > 0] / alone[alone > 0])) if (alone > 0).any() else 1.0


def correlation(a: Array, r: Array) -> float:
    """Mean over pixels and channels of the correlation between batches of A and of R."""
    x, y = a - a.mean(axis=0), r - r.mean(axis=0)
    norm = np.sqrt(np.sum(x * x, axis=0) * np.sum(y * y, axis=0))
    return float(np.mean(np.sum(x * y, axis=0)[norm > 0] / norm[norm > 0])) if norm.any() else 0.0


def asymmetry(a: Array, r: Array) -> float:
    """Mean over pixels and channels of the skewness of the batches of A - R; 0 for like noise."""
    d = a - r
    d -= d.mean(axis=0)
    spread = d.std(axis=0)
    used = spread > 0
    return float(np.mean(np.mean(d**3, axis=0)[used] / spread[used] ** 3)) if used.any() else 0.0


def effective_samples(mean: Array, error: Array, n: int | Array, partition: Partition) -> Array:
    """(sum x)^2 / sum x^2 per cell, from the pixels' means and standard errors.

    Per pixel sum x^2 = n ((n - 1) se^2 + mean^2) for n samples, a number or (H, W, 1).
    """
    first, second = partition.mean(n * mean), partition.mean(n * ((n - 1) * error**2 + mean**2))
    with np.errstate(divide="ignore", invalid="ignore"):
        return np.where(second == 0, np.inf, partition.pixels * first**2 / second)


def welch(
    difference: Array,
    level: Array,
    error_a: Array,
    error_r: Array,
    dof_a: float,
    dof_r: float,
    margin: float = MARGIN,
) -> tuple[Array, Array, Array]:
    """Welch's t per cell with the margin subtracted: (t, two-sided p, degrees of freedom).

    Welch (1947); degrees of freedom by Satterthwaite (1946). Infinite dof give a z test.
    """
    from scipy.stats import t as student

    variance = error_a**2 + error_r**2
    shifted = np.sign(difference) * np.maximum(np.abs(difference) - margin * np.abs(level), 0)
    with np.errstate(divide="ignore", invalid="ignore"):
        t = np.where(shifted == 0, 0.0, shifted / np.sqrt(variance))
        dof = variance**2 / (error_a**4 / dof_a + error_r**4 / dof_r)
    dof = np.where(np.isfinite(dof), dof, 1e12)
    return t, 2 * student.sf(np.abs(t), dof), dof
