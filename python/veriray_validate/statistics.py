"""Tests of counts and means, each with its error rates: the building blocks of the levels.

Every function returns a p value: the probability of data at least as far off if the expectation is
right. Tests of whole pictures are in `veriray.comparison.statistics`.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Any

import numpy as np
import numpy.typing as npt
from scipy import stats

from veriray.rendering import Render

Array = npt.NDArray[Any]


def sidak(p: float, tests: int) -> float:
    """The p value of the smallest of `tests` independent p values."""
    return float(-np.expm1(tests * np.log1p(-min(p, 1.0)))) if p < 1 else 1.0


def max_z(z: Array, law: Any = stats.norm) -> float:
    """The p value of the largest |z| of independent numbers of a law, by default normal ones."""
    return sidak(2 * float(law.sf(np.abs(z).max())), np.size(z))


def pooled(observed: Array, expected: Array, least: float = 10.0) -> tuple[Array, Array]:
    """Cells joined in order of expectation until each expects at least `least`; none is lost."""
    order = np.argsort(expected.ravel(), kind="stable")
    groups = np.floor(np.cumsum(expected.ravel()[order]) / least).astype(np.int64)
    starts = np.flatnonzero(np.diff(groups, prepend=-1))
    o = np.add.reduceat(observed.ravel()[order], starts).astype(np.float64)
    e = np.add.reduceat(expected.ravel()[order], starts).astype(np.float64)
    if len(e) > 1 and e[-1] < least:
        o[-2:], e[-2:] = o[-2:].sum(), e[-2:].sum()
        o, e = o[:-1], e[:-1]
    low = np.flatnonzero(e < least)
    if len(low) and len(e) > 1:  # a thin group joins its neighbour
        keep = np.ones(len(e), bool)
        for i in low:
            j = i + 1 if i + 1 < len(e) else i - 1
            o[j] += o[i]
            e[j] += e[i]
            keep[i] = False
        o, e = o[keep], e[keep]
    return o, e


def chi_square(observed: Array, expected: Array) -> float:
    """The p value of counts against expectations of equal total; 0 for a hit in an empty cell."""
    if (observed[expected == 0] > 0).any():
        return 0.0
    o, e = pooled(np.asarray(observed), np.asarray(expected))
    if len(e) < 2:
        return 1.0
    return float(stats.chi2.sf(((o - e) ** 2 / e).sum(), len(e) - 1))


def grids(u: Array, v: Array) -> float:
    """`grid_family` on three grids: enough if there are many points and none is lost."""
    return grid_family(u, v, sizes=((1, 8), (8, 4), (16, 32)))


def binomial(count: int, n: int, p: float) -> float:
    """Two-sided exact test of `count` successes in n trials of probability p.

    C. J. Clopper and E. S. Pearson, Biometrika 26 (1934): twice the smaller tail.
    """
    tail = min(stats.binom.cdf(count, n, p), stats.binom.sf(count - 1, n, p))
    return min(1.0, 2 * float(tail))


def homogeneous(counts: Array) -> float:
    """Test that rows of counts (one per sample, columns are classes) are alike.

    Chi-square (K. Pearson, Biometrika 8, 1911) over the classes that expect at least 10 in each
    row and a pool of the others, which joins the smallest of those classes if it is thin itself.
    Chi-square says nothing about classes that expect less. So each of them is also tested by the
    exact law of its counts in a row, given their sum: binomial, with the row's share of all counts.
    Tests that cannot reach 1 in 100, whatever is seen, are left out (R. E. Tarone, Biometrics 46,
    1990); Sidak over the rest.
    """
    table = np.asarray(counts, np.float64)
    table = table[table.sum(axis=1) > 0][:, table.sum(axis=0) > 0]
    if table.shape[0] < 2 or table.shape[1] < 2:
        return 1.0
    share = table.sum(axis=1) / table.sum()
    thin = table.sum(axis=0) * share.min() < 10
    p = []
    for column in table[:, thin].T:
        for k, q in zip(column, share, strict=True):
            if 2 * min(q, 1 - q) ** column.sum() < 0.01:
                p.append(binomial(int(k), int(column.sum()), float(q)))
    dense = table[:, ~thin]
    if thin.any() and dense.shape[1]:
        rest = table[:, thin].sum(axis=1)
        if rest.sum() * share.min() >= 10:
            dense = np.concatenate([dense, rest[:, None]], axis=1)
        else:
            dense[:, dense.sum(axis=0).argmin()] += rest
    if dense.shape[1] > 1:
        expected = np.outer(dense.sum(axis=1), dense.sum(axis=0)) / dense.sum()
        dof = (dense.shape[0] - 1) * (dense.shape[1] - 1)
        p.append(float(stats.chi2.sf(((dense - expected) ** 2 / expected).sum(), dof)))
    return sidak(min(p), len(p)) if p else 1.0


def welch(a: Array, b: Array) -> float:
    """Two-sided p value that two samples have one mean: B. L. Welch, Biometrika 34 (1947).

    Columns are tested one by one; the smallest p value, corrected by Sidak, is returned.
    """
    x, y = (np.asarray(v, np.float64).reshape(len(v), -1) for v in (a, b))
    same = (x.var(axis=0) == 0) & (y.var(axis=0) == 0)
    if (x.mean(axis=0) != y.mean(axis=0))[same].any():
        return 0.0
    p = stats.ttest_ind(x[:, ~same], y[:, ~same], equal_var=False).pvalue
    return sidak(float(p.min()), p.size) if p.size else 1.0


def error_of_sum(r: Render) -> tuple[Array, Any]:
    """Standard errors (3,) of the sums over a picture's pixels, and their law: of batch means where
    the render has them, as pixels may share samples, else of pixels that are independent."""
    if r.batch_means is None:
        return np.sqrt((r.stderr.astype(np.float64) ** 2).sum(axis=(0, 1))), stats.norm
    sums, count = r.batch_means.sum(axis=(1, 2)), len(r.batch_means)
    return sums.std(axis=0, ddof=1) / count**0.5, stats.t(count - 1)


def smallest_bias(
    error: float, mean: float, alpha: float = 1e-3, power: float = 0.9, law: Any = stats.norm
) -> float:
    """Relative bias that a two-sided test of z at level alpha finds with the given power.

    (z of alpha / 2 + z of power) x standard error / mean. law: of z without bias; under
    Student's with 19 degrees of freedom the power is 0.88, as the error is estimated.
    """
    z = float(law.isf(alpha / 2) + law.ppf(power))
    return z * error / abs(mean) if mean else math.inf


#: Coarse grids see a wrong scale or tilt, fine grids a wrong place.
GRIDS = ((1, 8), (8, 4), (16, 16), (32, 64))


def grid_family(
    u: Array,
    v: Array,
    drawn: int | None = None,
    chance: float = 1.0,
    sizes: Sequence[tuple[int, int]] = GRIDS,
) -> float:
    """Uniformity of points in the unit square: chi-square on several grids over the same points.

    One grid is weak: 2,500 cells with 10^6 points accept a density that is 1 % wrong. drawn:
    samples in all, each of which gives a point with probability `chance`; lost samples fill a cell
    of their own. A point outside the square is a failure. Sidak over the grids.
    """
    drawn = len(u) if drawn is None else drawn
    inside = (u >= 0) & (u <= 1) & (v >= 0) & (v <= 1)
    if not inside.all() or (chance >= 1 and drawn != len(u)):
        return 0.0
    worst = 1.0
    for m, n in sizes:
        i = np.minimum((u * m).astype(np.int64), m - 1)
        j = np.minimum((v * n).astype(np.int64), n - 1)
        counts = np.bincount(i * n + j, minlength=m * n).astype(np.float64)
        expected = np.full(m * n, drawn * chance / (m * n))
        if chance < 1:
            counts = np.append(counts, drawn - len(u))
            expected = np.append(expected, drawn * (1 - chance))
        worst = min(worst, chi_square(counts, expected))
    return sidak(worst, len(sizes))
