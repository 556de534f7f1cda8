"""core/math and tent: own elementary functions, over their whole range, on every device."""

from __future__ import annotations

import numpy as np
import pytest

from tests.support import FAST, native
from veriray.numeric import sin_cos_degrees

UNIT = 2.0**-24
#: Largest error of sin_2pi and cos_2pi over all 2^24 arguments k 2^-24, in units in the last place
#: of the exact value. Measured: 1.684 (absolute: 8.4e-8), at k = 672694 and k = 3521610.
SINCOS_ULP = 1.69


def turns(k: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """sin and cos of 2 pi k 2^-24 in float64: quarter turns taken off exactly."""
    x = k * (4 * UNIT)
    quarter = np.rint(x)
    s, c = np.sin((x - quarter) * (np.pi / 2)), np.cos((x - quarter) * (np.pi / 2))
    q = quarter.astype(np.int64) % 4
    return np.choose(q, [s, c, -s, -c]), np.choose(q, [c, -s, -c, s])


def test_oracle_against_fifty_digits() -> None:
    k = np.random.default_rng(1).integers(0, 2**24, 300)
    exact = np.array([sin_cos_degrees(360.0 * int(n) * UNIT) for n in k]).T
    assert np.abs(np.array(turns(k)) - exact).max() < 3e-16


@pytest.mark.parametrize("device", FAST)
def test_sincos_error_over_the_whole_range(device: str) -> None:
    for part in np.arange(2**24, dtype=np.int64).reshape(8, -1):
        u = (part * UNIT).astype(np.float32)
        for exact, name in zip(turns(part), ("sin_2pi", "cos_2pi"), strict=True):
            got = native(device).eval_math(name, u).astype(np.float64)
            zero = exact == 0
            assert (got[zero] == 0).all()
            ulp = np.spacing(np.abs(exact).astype(np.float32)).astype(np.float64)
            assert (np.abs(got - exact)[~zero] / ulp[~zero]).max() < SINCOS_ULP
            assert np.abs(got).max() <= 1


def test_same_bits_on_every_device(device: str) -> None:
    k = np.concatenate([np.arange(0, 2**24, 97), np.arange(2**14), 2**24 - 1 - np.arange(2**14)])
    u = (k * UNIT).astype(np.float32)
    for name in ("sin_2pi", "cos_2pi", "tent", "sqrt", "reciprocal"):
        x = u[u > 0] if name == "reciprocal" else u
        ours = native(device).eval_math(name, x)
        assert (ours.view(np.uint32) == native(FAST[0]).eval_math(name, x).view(np.uint32)).all()


def test_root_and_quotient_are_correctly_rounded(device: str) -> None:
    x = np.exp(np.random.default_rng(2).uniform(-80, 80, 20_000)).astype(np.float32)
    assert (native(device).eval_math("sqrt", x) == np.sqrt(x)).all()
    assert (native(device).eval_math("reciprocal", x) == np.float32(1) / x).all()


def test_tent_inverts_its_distribution(device: str) -> None:
    u = np.arange(0, 2**24, 61) * UNIT
    x = native(device).eval_math("tent", u.astype(np.float32)).astype(np.float64)
    assert x.min() == -1 and x.max() < 1 and (np.diff(x) >= 0).all()
    cdf = np.where(x < 0, (1 + x) ** 2 / 2, 1 - (1 - x) ** 2 / 2)
    assert np.abs(cdf - u).max() < 2e-7
