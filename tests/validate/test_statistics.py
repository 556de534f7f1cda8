"""The tests of counts and means: their false-alarm rates and power, by simulation or exactly.

Simulated rates are accepted within four standard errors of the nominal rate plus a tenth of it,
which the approximations of the tests may cost at 10 counts per cell.
"""

from __future__ import annotations

import math
from collections.abc import Callable

import numpy as np
import numpy.typing as npt
import pytest
from scipy import stats

from veriray_validate import statistics as st

Array = npt.NDArray[np.float64]


def rate(p: list[float], alpha: float) -> float:
    return float(np.mean(np.array(p) < alpha))


def holds(p: list[float], alphas: tuple[float, ...] = (0.1, 0.02)) -> bool:
    """Whether the false-alarm rates are the nominal ones."""
    return all(abs(rate(p, a) - a) < 4 * math.sqrt(a * (1 - a) / len(p)) + 0.1 * a for a in alphas)


@pytest.fixture
def rng() -> np.random.Generator:
    return np.random.default_rng(20)


# ---- several tests at once ----


def test_sidak() -> None:
    for p, n in ((0.3, 1), (1e-3, 7), (0.2, 40)):
        assert st.sidak(p, n) == pytest.approx(1 - (1 - p) ** n)
    assert st.sidak(1e-18, 10**6) == pytest.approx(1e-12)
    assert (st.sidak(0.0, 5), st.sidak(1.0, 5)) == (0.0, 1.0)


def test_corrections_are_exact(rng: np.random.Generator) -> None:
    smallest = [st.sidak(float(u.min()), 9) for u in rng.random((4000, 9))]
    largest = [st.max_z(z) for z in rng.standard_normal((4000, 25))]
    student = stats.t(5)
    wide = [st.max_z(z, student) for z in rng.standard_t(5, (4000, 25))]
    for p in (smallest, largest, wide):
        assert stats.kstest(p, "uniform").pvalue > 1e-4


def test_smallest_bias_is_found_9_times_in_10(rng: np.random.Generator) -> None:
    mean, error = 3.0, 0.02
    bias = st.smallest_bias(error, mean)
    z = rng.normal(bias * mean / error, 1, 40_000)
    assert abs((2 * stats.norm.sf(np.abs(z)) < 1e-3).mean() - 0.9) < 4 * math.sqrt(0.09 / 40_000)
    few = stats.t(19)
    bias = st.smallest_bias(error, mean, law=few)
    z = rng.normal(bias * mean / error, 1, 40_000) / np.sqrt(rng.chisquare(19, 40_000) / 19)
    assert abs((2 * few.sf(np.abs(z)) < 1e-3).mean() - 0.878) < 0.01
    assert st.smallest_bias(1.0, 0.0) == math.inf


# ---- counts ----


def test_pooling_loses_nothing(rng: np.random.Generator) -> None:
    for _ in range(500):
        n = int(rng.integers(1, 60))
        expected = 10 ** rng.uniform(-3, 2.5, n)
        observed = rng.poisson(expected)
        o, e = st.pooled(observed, expected)
        assert o.sum() == observed.sum() and e.sum() == pytest.approx(expected.sum())
        assert (e >= 10).all() or len(e) == 1


def cells(kind: str) -> Array:
    """Probabilities of 50 cells: equal, falling by a factor of 1000, or mostly nearly empty."""
    p = {"even": np.ones(50), "steep": np.geomspace(1, 1e-3, 50),
         "thin": np.where(np.arange(50) < 12, 1.0, 1e-4)}[kind]  # fmt: skip
    return np.asarray(p / p.sum())


@pytest.mark.parametrize("kind", ["even", "steep", "thin"])
def test_chi_square_false_alarms(kind: str, rng: np.random.Generator) -> None:
    share = cells(kind)
    assert holds([st.chi_square(o, 2000 * share) for o in rng.multinomial(2000, share, 4000)])


def test_chi_square_power(rng: np.random.Generator) -> None:
    """That of theory: the noncentral chi-square law."""
    share, n = cells("even"), 20_000
    tilted = share * (1 + 0.06 * np.linspace(-1, 1, 50))
    shift = n * ((tilted - share) ** 2 / share).sum()
    theory = float(stats.ncx2.sf(stats.chi2.isf(0.02, 49), 49, shift))
    found = rate([st.chi_square(o, n * share) for o in rng.multinomial(n, tilted, 2000)], 0.02)
    assert 0.3 < theory < 0.95 and abs(found - theory) < 0.05


def test_chi_square_of_impossible_and_single_cells() -> None:
    assert st.chi_square(np.array([99, 1]), np.array([100.0, 0.0])) == 0
    assert st.chi_square(np.array([100, 0]), np.array([100.0, 0.0])) == 1
    assert st.chi_square(np.array([7, 3]), np.array([5.0, 5.0])) == 1  # one cell after pooling


def test_grids_false_alarms(rng: np.random.Generator) -> None:
    assert holds([st.grids(*rng.random((2, 20_000))) for _ in range(1500)])


def scaled_wrong(n: int, rng: np.random.Generator) -> Array:
    """Points whose density is 2 % too high in one half of the square."""
    u, v = rng.random((2, n))
    flip = (v > 0.5) & (rng.random(n) < 0.02)
    return np.stack([u, np.where(flip, v - 0.5, v)])


def test_coarse_grids_find_what_the_fine_one_misses(rng: np.random.Generator) -> None:
    """50,000 points, density 2 % off in halves: three grids find it, the finest alone does not."""
    family, fine = [], []
    for _ in range(200):
        u, v = scaled_wrong(50_000, rng)
        family.append(st.grids(u, v))
        counts = np.histogram2d(u, v, (16, 32), ((0, 1), (0, 1)))[0]
        fine.append(st.chi_square(counts, np.full((16, 32), 50_000 / 512)))
    assert rate(family, 0.01) > 0.5 > 0.25 > rate(fine, 0.01)


def test_grid_family_false_alarms_with_lost_samples(rng: np.random.Generator) -> None:
    found = []
    for n in rng.binomial(20_000, 0.9, 800):
        found.append(st.grid_family(*rng.random((2, n)), drawn=20_000, chance=0.9))
    assert holds(found)


def test_lost_samples_have_a_cell(rng: np.random.Generator) -> None:
    """The remaining samples are uniform, but 1 % more of them are lost than should be."""
    u, v = rng.random((2, 89_100))
    assert st.grid_family(u, v, drawn=99_000, chance=0.9) > 1e-3
    assert st.grid_family(u, v, drawn=100_000, chance=0.9) < 1e-9
    assert st.grid_family(u, v, drawn=100_000) == 0


def test_points_outside_the_square() -> None:
    u = np.linspace(0, 1, 1000)
    assert st.grid_family(u, np.append(u[:-1], 1.0001)) == 0
    assert st.grids(u, np.append(u[:-1], 1.0001)) == 0
    assert st.grids(u, np.append(u[:-1], np.nan)) == 0


@pytest.mark.parametrize("n", [1, 7, 40, 300])
def test_binomial_never_raises_too_many_alarms(n: int) -> None:
    """Exactly, over all counts: P(p < alpha) <= alpha, and p below 1 is reached."""
    counts = np.arange(n + 1)
    for share in (0.0, 1e-3, 0.1, 0.5, 0.77, 1.0):
        p = np.array([st.binomial(int(k), n, share) for k in counts])
        weight = stats.binom.pmf(counts, n, share)
        assert ((p >= 0) & (p <= 1)).all()
        for alpha in (0.2, 0.05, 1e-3):
            assert weight[p < alpha].sum() <= alpha * (1 + 1e-9)


def test_binomial_power() -> None:
    """10,000 trials of 0.52 for 0.5: as the normal law has it."""
    counts = np.arange(10_001)
    p = np.array([st.binomial(int(k), 10_000, 0.5) for k in counts[4500:5600]])
    found = stats.binom.pmf(counts[4500:5600], 10_000, 0.52)[p < 1e-3].sum()
    theory = stats.norm.sf((stats.norm.isf(5e-4) * 0.5 - 2) / math.sqrt(0.52 * 0.48))
    assert found == pytest.approx(theory, abs=0.01)


def test_homogeneous_false_alarms(rng: np.random.Generator) -> None:
    """The nominal rate where all classes are full, no more than that with thin ones."""
    sizes = (1500, 4000, 2000)
    for kind, n in (("steep", 3000), ("thin", 2000)):
        if kind == "steep":
            share = cells("steep")
            share = share[share * min(sizes) >= 12] / share[share * min(sizes) >= 12].sum()
        else:
            share = np.array([0.7, 0.2968, 0.002, 0.001, 0.0002])
        p = [st.homogeneous(np.stack([rng.multinomial(n, share) for n in sizes])) for _ in range(n)]
        if kind == "steep":
            assert holds(p)
        for alpha in (0.1, 0.02, 1e-3):
            assert rate(p, alpha) <= 1.1 * alpha + 4 * math.sqrt(alpha / n)


def test_homogeneous_thin_classes(rng: np.random.Generator) -> None:
    """Rare ends are judged by their exact law, which neither alarms at one nor overlooks nine.

    A million paths against eight million: chi-square takes one event of the smaller sample, where
    a ninth is expected, for a z of 2.7, and three for 8.
    """
    rows = np.array([[279_000, 770_000, 0, 0], [2_233_000, 6_155_000, 0, 0]])
    p = []
    for k in (1, 2, 3, 9):
        rows[0, 2] = k
        p.append(st.homogeneous(rows))
    assert p[0] > 0.1 and p[1] > 0.01 and p[2] > 1e-3 and p[3] < 1e-7
    # wherever the others' counts put the borders between groups
    near = []
    for first in range(400):
        rows[0] = 279_000 + first, 770_000 - first, 9, 0
        near.append(st.homogeneous(rows))
    assert max(near) < 1e-7
    rare = [
        st.homogeneous(
            np.stack([rng.multinomial(n, [0.3, 0.7 - 2e-6, 2e-6]) for n in (10**6, 8 * 10**6)])
        )
        for _ in range(2000)
    ]
    assert rate(rare, 1e-3) <= 1e-3 + 4 * math.sqrt(1e-3 / 2000)


def test_homogeneous_power(rng: np.random.Generator) -> None:
    """That of theory, where in one of two rows a twentieth of the paths die one depth later."""
    share = 0.5 ** np.arange(1, 12)
    share = share / share.sum()
    later = 0.95 * share + 0.05 * np.roll(share, 1)
    n = 20_000
    shift = n * ((share - later) ** 2 / (share + later)).sum()
    theory = float(stats.ncx2.sf(stats.chi2.isf(1e-3, 10), 10, shift))
    pairs = zip(rng.multinomial(n, share, 600), rng.multinomial(n, later, 600), strict=True)
    found = rate([st.homogeneous(np.stack(pair)) for pair in pairs], 1e-3)
    assert 0.3 < theory < 0.95 and abs(found - theory) < 0.09


def test_homogeneous_of_little() -> None:
    assert st.homogeneous(np.array([[3, 1], [2, 2]])) == 1
    assert st.homogeneous(np.array([[500, 0, 0], [500, 0, 0]])) == 1
    assert st.homogeneous(np.array([[500, 0], [0, 500]])) < 1e-200


# ---- means ----

NOISE: dict[str, Callable[[np.random.Generator, int], Array]] = {
    "normal": lambda rng, n: rng.standard_normal(n),
    "uniform": lambda rng, n: rng.random(n),
}


@pytest.mark.parametrize("noise", NOISE)
def test_welch_false_alarms(noise: str, rng: np.random.Generator) -> None:
    """Unequal sizes and spreads, where Student's test is wrong."""
    draw = NOISE[noise]
    centre = 0.5 if noise == "uniform" else 0.0
    pairs = [(9 * (draw(rng, 12) - centre), draw(rng, 90) - centre) for _ in range(2000)]
    assert holds([st.welch(a, b) for a, b in pairs], (0.1,))
    student = [float(stats.ttest_ind(a, b).pvalue) for a, b in pairs]
    assert rate(student, 0.1) > 0.3


def test_welch_power(rng: np.random.Generator) -> None:
    """Means half a standard error of the difference times (3.29 + 1.28) x 2 apart: 9 in 10."""
    error = math.sqrt(1 / 400 + 4 / 400)
    shift = (3.29 + 1.28) * error
    p = [st.welch(rng.normal(0, 1, 400), rng.normal(shift, 2, 400)) for _ in range(1500)]
    assert abs(rate(p, 1e-3) - 0.9) < 0.04


def test_welch_of_several_columns_and_constants(rng: np.random.Generator) -> None:
    p = [st.welch(rng.normal(0, 1, (30, 5)), rng.normal(0, 3, (50, 5))) for _ in range(3000)]
    assert holds(p, (0.1,))
    same = np.ones((10, 2))
    assert st.welch(same, same) == 1 and st.welch(same, same * [1, 2]) == 0
    mixed = rng.normal(0, 1, (40, 2)) * [1, 0]
    assert 0 < st.welch(mixed, mixed[::-1] + [0.1, 0]) <= 1
