"""core/math, core/compensated and tent: own elementary functions, over their whole range."""

from __future__ import annotations

from collections.abc import Iterator

import mpmath
import numpy as np
import pytest

from tests.support import FAST, native
from veriray.numeric import sin_cos_degrees

UNIT = 2.0**-24
#: Largest error of sin_2pi and cos_2pi over all 2^24 arguments k 2^-24, in units in the last place
#: of the exact value. Measured: 1.684 (absolute: 8.4e-8), at k = 672694 and k = 3521610.
SINCOS_ULP = 1.69
#: name: (first and last argument, way it goes, units in the last place over all floats between).
#: Measured: 0.876 at 1.27433, 1.012 at 5.85708, 1.139 at 0.544701 and 0.900 at -0.500547.
MONOTONE = {
    "log": (np.float32(2.0**-126), np.finfo(np.float32).max, 1, 0.88),
    "exp_minus": (np.float32(0), np.float32(87.33654), -1, 1.02),
    "acos": (np.float32(0), np.float32(1), -1, 1.14),
    "acos of negative": (np.float32(-0.0), np.float32(-1), 1, 0.9),
}


def evaluate(device: str, name: str, *columns: np.ndarray) -> np.ndarray:
    """Columns of float32 to rows of float32; one output is one column."""
    rows = np.stack([np.asarray(c, np.float32) for c in columns], axis=1)
    out: np.ndarray = native(device).eval_function(name, rows)
    return out[:, 0] if out.shape[1] == 1 else out


def turns(k: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """sin and cos of 2 pi k 2^-24 in float64: quarter turns taken off exactly."""
    x = k * (4 * UNIT)
    quarter = np.rint(x)
    s, c = np.sin((x - quarter) * (np.pi / 2)), np.cos((x - quarter) * (np.pi / 2))
    q = quarter.astype(np.int64) % 4
    return np.choose(q, [s, c, -s, -c]), np.choose(q, [c, -s, -c, s])


def oracle(name: str, x: np.ndarray) -> np.ndarray:
    """float64."""
    x = x.astype(np.float64)
    return np.log(x) if name == "log" else np.exp(-x) if name == "exp_minus" else np.arccos(x)


def ulp(exact: np.ndarray) -> np.ndarray:
    return np.spacing(np.abs(exact).astype(np.float32)).astype(np.float64)


def test_oracle_against_fifty_digits() -> None:
    rng = np.random.default_rng(1)
    k = rng.integers(0, 2**24, 300)
    exact = np.array([sin_cos_degrees(360.0 * int(n) * UNIT) for n in k]).T
    assert np.abs(np.array(turns(k)) - exact).max() < 3e-16
    with mpmath.workdps(50):
        for name, (first, last, _, _) in MONOTONE.items():
            x = np.concatenate(list(floats(first, last, 2**22 + 12345)))[:300]
            of = {"log": mpmath.log, "exp_minus": lambda v: mpmath.exp(-v)}.get(name, mpmath.acos)
            real = [of(mpmath.mpf(float(v))) for v in x]
            for a, b in zip(map(float, oracle(name, x)), real, strict=True):
                assert abs(mpmath.mpf(a) - b) <= 1e-15 * max(abs(b), 1e-6)


@pytest.mark.parametrize("device", FAST)
def test_sincos_error_over_the_whole_range(device: str) -> None:
    for part in np.arange(2**24, dtype=np.int64).reshape(8, -1):
        u = (part * UNIT).astype(np.float32)
        for exact, name in zip(turns(part), ("sin_2pi", "cos_2pi"), strict=True):
            got = evaluate(device, name, u).astype(np.float64)
            zero = exact == 0
            assert (got[zero] == 0).all()
            assert (np.abs(got - exact)[~zero] / ulp(exact)[~zero]).max() < SINCOS_ULP
            assert np.abs(got).max() <= 1


def floats(first: np.float32, last: np.float32, step: int) -> Iterator[np.ndarray]:
    """Every step-th float of an interval of one sign, and the last one; up to 2^21 at a time."""
    low, high = (int(np.float32(x).view(np.uint32)) for x in (first, last))
    for start in range(low, high + 1, step * 2**21):
        end = min(start + step * 2**21, high + 1)
        words = np.arange(start, end, step, dtype=np.uint32)
        yield (np.append(words, np.uint32(high)) if end > high else words).view(np.float32)


def check_monotone(device: str, name: str, step: int) -> None:
    first, last, way, bound = MONOTONE[name]
    before: np.ndarray | None = None
    for x in floats(first, last, step):
        got = evaluate(device, name.split()[0], x)
        exact = oracle(name.split()[0], x)
        zero = exact == 0
        assert (got[zero] == 0).all()
        assert (np.abs(got - exact)[~zero] / ulp(exact)[~zero]).max() < bound
        together = got if before is None else np.append(before, got)
        assert (way * np.diff(together) >= 0).all()
        before = got[-1:]


@pytest.mark.parametrize("device", FAST)
@pytest.mark.parametrize("name", MONOTONE)
def test_error_and_order(device: str, name: str) -> None:
    """Every 1,021st float of the domain."""
    check_monotone(device, name, 1021)


@pytest.mark.slow
@pytest.mark.parametrize("device", FAST)
@pytest.mark.parametrize("name", MONOTONE)
def test_error_and_order_over_all_floats(device: str, name: str) -> None:
    check_monotone(device, name, 1)


@pytest.mark.parametrize("name", ["log", "exp_minus", "acos"])
def test_error_where_it_is_hard(device: str, name: str) -> None:
    """All floats about 1 of log and acos, about the changes of polynomial, scale and range."""
    middles = {"log": [1.0, 2**0.5, 0.5**0.5, 2.0**-125], "acos": [0.5, 1 - 2**-10, -0.5],
               "exp_minus": [np.log(2) * (k + 0.5) for k in (0, 1, 2, 64, 125)]}[name]  # fmt: skip
    for middle in middles:
        word = int(np.float32(middle).view(np.uint32))
        x = np.arange(word - 2**14, word + 2**14, dtype=np.uint32).view(np.float32)
        got, exact = evaluate(device, name, x), oracle(name, x)
        away = exact != 0
        bound = max(b for n, (_, _, _, b) in MONOTONE.items() if n.startswith(name))
        assert (np.abs(got - exact)[away] / ulp(exact)[away]).max() < bound
        rising = name == "log" or middle < 0
        assert (np.diff(got) * (1 if rising else -1) >= 0).all()


def test_fixed_points_and_limits(device: str) -> None:
    assert evaluate(device, "log", [1.0])[0] == 0
    assert (evaluate(device, "exp_minus", [0.0, -0.0]) == 1).all()
    beyond = [np.nextafter(np.float32(87.33654), np.float32(88)), 88, 200, 3e38, np.inf]
    assert (evaluate(device, "exp_minus", beyond) == 0).all()
    assert 2.0**-126 <= evaluate(device, "exp_minus", [87.33654])[0] < 1.18e-38
    assert np.isnan(evaluate(device, "exp_minus", [np.nan])).all()
    angles = evaluate(device, "acos", [1, 0.5, 0, -0.0, -0.5, -1])
    exact = np.arccos([1, 0.5, 0, 0, -0.5, -1]).astype(np.float32)
    assert (angles == exact).all()


def test_same_bits_on_every_device(device: str) -> None:
    k = np.concatenate([np.arange(0, 2**24, 97), np.arange(2**14), 2**24 - 1 - np.arange(2**14)])
    u = (k * UNIT).astype(np.float32)
    wide = np.exp(np.random.default_rng(3).uniform(-80, 80, 50_000)).astype(np.float32)
    for name in ("sin_2pi", "cos_2pi", "tent", "sqrt", "reciprocal", "log", "exp_minus", "acos"):
        for x in (u, wide):
            if x is wide and name in ("sin_2pi", "cos_2pi", "tent", "acos"):
                continue
            x = x[x > 0] if name in ("reciprocal", "log") else x
            ours, theirs = (evaluate(d, name, x).view(np.uint32) for d in (device, FAST[0]))
            assert (ours == theirs).all()


def test_root_and_quotient_are_correctly_rounded(device: str) -> None:
    x = np.exp(np.random.default_rng(2).uniform(-80, 80, 20_000)).astype(np.float32)
    assert (evaluate(device, "sqrt", x) == np.sqrt(x)).all()
    assert (evaluate(device, "reciprocal", x) == np.float32(1) / x).all()


def test_error_free_sum_and_product(device: str) -> None:
    """high + low equals the exact result, which float64 holds where the exponents are near."""
    rng = np.random.default_rng(4)
    a, b = (np.ldexp(rng.uniform(-1, 1, 50_000), rng.integers(-12, 12, 50_000)) for _ in range(2))
    a, b = a.astype(np.float32), b.astype(np.float32)
    wide = a.astype(np.float64)
    for name, exact in (("two_sum", wide + b), ("two_product", wide * b)):
        high, low = evaluate(device, name, a, b).T
        assert (high == exact.astype(np.float32)).all()
        assert (high.astype(np.float64) + low == exact).all()


def test_tent_inverts_its_distribution(device: str) -> None:
    u = np.arange(0, 2**24, 61) * UNIT
    x = evaluate(device, "tent", u).astype(np.float64)
    assert x.min() == -1 and x.max() < 1 and (np.diff(x) >= 0).all()
    cdf = np.where(x < 0, (1 + x) ** 2 / 2, 1 - (1 - x) ** 2 / 2)
    assert np.abs(cdf - u).max() < 2e-7
