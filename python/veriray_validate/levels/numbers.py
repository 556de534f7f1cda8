"""Level 1: the renderer's elementary functions and mappings, against float64 over their range.

Errors are in units in the last place (ulp) of the exact value. Coefficients and error bounds are
stated where the functions are (cpp/core/math.h, cpp/core/mapping.h).
"""

from __future__ import annotations

import itertools
from collections.abc import Callable, Iterator
from typing import Any

import numpy as np
import numpy.typing as npt
from scipy.special import i0e

from veriray import device as device_module
from veriray.columns import MATERIAL_KINDS, PRINCIPLED, PRINCIPLED_THIN
from veriray.numeric import sin_cos_degrees
from veriray_validate.oracles import (
    CORNERS,
    INVERSE,
    density,
    directions,
    normalised,
    phase,
    single,
)
from veriray_validate.trial import Skipped, Trial, case

Array = npt.NDArray[Any]

UNIT = 2.0**-24
#: Largest error of sin_2pi and cos_2pi over all 2^24 arguments k 2^-24, in ulp. Measured: 1.684
#: (absolute: 8.4e-8), at k = 672694 and k = 3521610.
SINCOS_ULP = 1.69
#: name: (first and last argument, way it goes, ulp over all floats between). Measured: 0.876 at
#: 1.27433 and 1.012 at 5.85708.
MONOTONE = {
    "log": (np.float32(2.0**-126), np.finfo(np.float32).max, 1, 0.88),
    "exp_minus": (np.float32(0), np.float32(87.33654), -1, 1.02),
}
#: Asymmetries of the phase function; the smallest ones must be continuous with 0.
ASYMMETRIES = (0.0, 1e-4, -1e-4, 1e-7, 0.3, -0.5, 0.9, -0.99, 0.9999, -0.9999)
#: Largest error of the angle of a point, in ulp: half an ulp of the quotient, which may be one ulp
#: of the angle, half an ulp for the last sum, and 0.1 for the polynomial. Measured: 1.501.
ANGLE_ULP = 1.6
BESSEL_ULP = 8.5
PARTS = 8


# ---- elementary functions ----


def turns(k: Array) -> tuple[Array, Array]:
    """Sine and cosine of 2 pi k 2^-24 in float64: quarter turns are subtracted exactly."""
    x = k * (4 * UNIT)
    quarter = np.rint(x)
    s, c = np.sin((x - quarter) * (np.pi / 2)), np.cos((x - quarter) * (np.pi / 2))
    q = quarter.astype(np.int64) % 4
    return np.choose(q, [s, c, -s, -c]), np.choose(q, [c, -s, -c, s])


def oracle(name: str, x: Array) -> Array:
    """Log or exp_minus in float64."""
    x = x.astype(np.float64)
    return np.log(x) if name == "log" else np.exp(-x)


def ulp(exact: Array) -> Array:
    """Unit in the last place of float32 at each value."""
    spacing: Array = np.spacing(np.abs(exact).astype(np.float32)).astype(np.float64)
    return spacing


def column(t: Trial, name: str, x: Array) -> Array:
    """A function of one argument: float32 to float32, (n,)."""
    out: Array = t.native.eval_function(name, np.asarray(x, np.float32)[:, None])
    return out[:, 0]


def floats(first: np.float32, last: np.float32, step: int, part: int = 0,
           parts: int = 1) -> Iterator[Array]:  # fmt: skip
    """Every step-th float of one of the parts of an interval of one sign, and the last one.

    At most 2^19 at a time; the parts share their ends.
    """
    low, high = (int(np.float32(x).view(np.uint32)) for x in (first, last))
    ends = [low + (high - low) * k // parts for k in range(parts + 1)]
    low, high = ends[part], ends[part + 1]
    for start in range(low, high + 1, step * 2**19):
        end = min(start + step * 2**19, high + 1)
        words = np.arange(start, end, step, dtype=np.uint32)
        yield (np.append(words, np.uint32(high)) if end > high else words).view(np.float32)


@case(1, once=True)
def sine_oracle(t: Trial) -> None:
    """The float64 oracle of sine and cosine agrees with 50-digit arithmetic.

    Within 3e-16 at 300 arguments.
    """
    k = t.rng.integers(0, 2**24, 300)
    exact = np.array([sin_cos_degrees(360.0 * int(n) * UNIT) for n in k]).T
    t.check(np.abs(np.array(turns(k)) - exact).max() < 3e-16, "sine and cosine")


@case(1, once=True)
def oracles_at_fifty_digits(t: Trial) -> None:
    """The float64 oracles of log and exp agree with mpmath at 50 digits.

    Within 1e-15 of themselves at 300 floats each.
    """
    try:
        import mpmath
    except ImportError:
        raise Skipped("mpmath is not installed") from None
    functions = {"log": mpmath.log, "exp_minus": lambda v: mpmath.exp(-v)}
    with mpmath.workdps(50):
        for name, (first, last, _, _) in MONOTONE.items():
            x = np.concatenate(list(floats(first, last, 2**22 + 12345)))[:300]
            real = [functions[name](mpmath.mpf(float(v))) for v in x]
            for a, b in zip(map(float, oracle(name, x)), real, strict=True):
                t.check(abs(mpmath.mpf(a) - b) <= 1e-15 * max(abs(b), 1e-6), f"{name}: {a}")


@case(1, each={"step": [4, 1]}, quick=lambda step: step > 1)
def sine_and_cosine(t: Trial, step: int) -> None:
    """Sine and cosine of 2 pi u at every step-th of all 2^24 arguments.

    At most 1.69 ulp and never beyond 1; zeros are exact. Full: every possible argument.
    """
    worst = 0.0
    every = np.arange(int(t.rng.integers(step)), 2**24, step, dtype=np.int64)
    for part in np.array_split(every, max(1, 32 // step)):
        u = (part * UNIT).astype(np.float32)
        for exact, name in zip(turns(part), ("sin_2pi", "cos_2pi"), strict=True):
            got = column(t, name, u).astype(np.float64)
            zero = exact == 0
            t.check(got[zero] == 0, f"{name}: a zero is not exact")
            worst = max(worst, float((np.abs(got - exact)[~zero] / ulp(exact)[~zero]).max()))
            t.check(worst < SINCOS_ULP, f"{name}: {worst} ulp")
            t.check(np.abs(got).max() <= 1, f"{name}: beyond 1")
    t.figure("ulp", worst)


def check_monotone(t: Trial, name: str, step: int, part: int = 0, parts: int = 1) -> None:
    """Error and order of a function of MONOTONE at every step-th float of a part of its domain."""
    first, last, way, bound = MONOTONE[name]
    before: Array | None = None
    worst = 0.0
    for x in floats(first, last, step, part, parts):
        got, exact = column(t, name, x), oracle(name, x)
        zero = exact == 0
        t.check(got[zero] == 0, "a zero is not exact")
        error = np.abs(got - exact) / np.where(zero, 1, ulp(exact))
        worst = max(worst, float(error.max()))
        t.check(worst < bound, f"{worst} ulp at {x[error.argmax()]}")
        together = got if before is None else np.append(before, got)
        t.check(way * np.diff(together) >= 0, "not monotone")
        before = got[-1:]
    t.figure("ulp", worst)


@case(1, each={"name": MONOTONE})
def error_and_order(t: Trial, name: str) -> None:
    """Log and exp(-x) over their whole domain: every 1,021st float.

    Errors at most 0.88 and 1.02 ulp; monotone.
    """
    check_monotone(t, name, 1021)


@case(1, each={"name": MONOTONE, "part": range(PARTS)}, quick=False)
def error_and_order_at_every_float(t: Trial, name: str, part: int) -> None:
    """Log and exp(-x) at every float of an eighth of their domain.

    Errors at most 0.88 and 1.02 ulp; monotone.
    """
    check_monotone(t, name, 1, part, PARTS)


@case(1, each={"name": MONOTONE})
def error_where_it_is_hard(t: Trial, name: str) -> None:
    """All floats around 1 for log, and around changes of polynomial, scale and range.

    The bounds of the whole domain hold; monotone.
    """
    middles = {"log": [1.0, 2**0.5, 0.5**0.5, 2.0**-125],
               "exp_minus": [np.log(2) * (k + 0.5) for k in (0, 1, 2, 64, 125)]}[name]  # fmt: skip
    for middle in middles:
        word = int(np.float32(middle).view(np.uint32))
        x = np.arange(word - 2**14, word + 2**14, dtype=np.uint32).view(np.float32)
        got, exact = column(t, name, x), oracle(name, x)
        away = exact != 0
        _, _, way, bound = MONOTONE[name]
        t.check((np.abs(got - exact)[away] / ulp(exact)[away]).max() < bound, f"about {middle}")
        t.check(np.diff(got) * way >= 0, f"not monotone about {middle}")


@case(1)
def fixed_points_and_limits(t: Trial) -> None:
    """Values that must be exact: log 1, exp 0, exp of a large number.

    exp(-x) is 0 beyond 87.33654, where it would leave the normal floats, and NaN for NaN.
    """
    t.check(column(t, "log", np.array([1.0]))[0] == 0, "log 1")
    t.check(column(t, "exp_minus", np.array([0.0, -0.0])) == 1, "exp 0")
    beyond = np.array([np.nextafter(np.float32(87.33654), np.float32(88)), 88, 200, 3e38, np.inf])
    t.check(column(t, "exp_minus", beyond) == 0, "exp of large numbers")
    last = column(t, "exp_minus", np.array([87.33654]))[0]
    t.check(2.0**-126 <= last < 1.18e-38, "exp of the last number")
    t.check(np.isnan(column(t, "exp_minus", np.array([np.nan]))), "exp of NaN")


@case(1, each={"step": [1009, 13]}, quick=lambda step: step > 100)
def scaled_bessel(t: Trial, step: int) -> None:
    """e^-x I0(x) at every step-th float from 10^-3 to 10^5, at 0, and up to 3e38.

    Error at most 8.5 ulp against SciPy's i0e (measured: 8.194 at 163.38174); 1 at 0; finite.
    """
    for x in floats(np.float32(1e-3), np.float32(1e5), step):
        exact = i0e(x.astype(np.float64))
        off = np.abs(column(t, "scaled_bessel", x) - exact) / ulp(exact)
        t.check(off.max() <= BESSEL_ULP, f"{off.max():.3f} ulp at {x[off.argmax()]}")
    t.check(column(t, "scaled_bessel", np.array([0.0])) == 1, "at 0")
    far = np.float32(10.0) ** np.arange(5, 39, dtype=np.float32)
    off = np.abs(column(t, "scaled_bessel", far) / i0e(far.astype(np.float64)) - 1)
    t.check(off <= 1e-6, f"far out: {off.max():.2g}")


@case(1, each={"step": [4001, 61]}, quick=lambda step: step > 100)
def root_and_quotient(t: Trial, step: int) -> None:
    """Square roots and reciprocals are correctly rounded at every step-th positive float.

    Equal to NumPy's to the bit (IEEE 754), numbers below 2^-126 among arguments and results.
    """
    last = np.finfo(np.float32).max
    for x in floats(np.float32(1e-45), last, step):
        t.check(column(t, "sqrt", x) == np.sqrt(x), "root")
        with np.errstate(over="ignore"):
            t.check(column(t, "reciprocal", x) == np.float32(1) / x, "reciprocal")


@case(1)
def quotients_of_lengths(t: Trial) -> None:
    """The quotient for the distance to a plane, which checks no ranges.

    Correctly rounded: equal to NumPy's to the bit for 500,000 pairs, 0 and 2^-60 to 2^4 over
    2^-90 to 2^2.
    """
    n = 500_000 * t.effort
    a, b = (
        single(np.ldexp(t.rng.choice([-1, 1], n) * t.rng.uniform(0.5, 1, n), t.rng.integers(*e, n)))
        for e in ((-60, 4), (-90, 2))
    )
    a[: n // 50] = 0
    kept = np.abs(a) <= np.abs(b) * 2.0**100
    a, b = a[kept], b[kept]
    t.check(t.function("plain_quotient", a, b)[:, 0] == single(np.float32(a) / np.float32(b)))


@case(1)
def angles_of_points(t: Trial) -> None:
    """The angle of a point in the plane, in [-pi, pi].

    500,000 points of all directions and of exponents -40 to 40 apart: at most 1.6 ulp; odd in
    y to the bit; on the axes and at the origin the nearest float, with the sign of y.
    """
    n = 500_000 * t.effort
    x, y = t.rng.normal(size=(2, n))
    x[: n // 2] *= np.exp2(t.rng.integers(-40, 40, n // 2))
    x, y = single(x), single(y)
    exact = np.arctan2(y, x)
    off = np.abs(t.function("angle", x, y)[:, 0] - exact) / ulp(exact)
    t.check(off.max() <= ANGLE_ULP, f"{off.max():.3f} ulp")
    t.figure("ulp", float(off.max()))
    t.check(t.function("angle", x, -y)[:, 0] == -t.function("angle", x, y)[:, 0], "odd")
    x, y = np.array([[1, 1, -1, -1, 0, 0, 0, 0], [0.0, -0.0, 0.0, -0.0, 1, -1, 0.0, -0.0]])
    got, exact = t.function("angle", x, y)[:, 0], single(np.arctan2(y, x))
    t.check((got == exact) & (np.signbit(got) == np.signbit(y)), "axes")


@case(1)
def error_free_sum_and_product(t: Trial) -> None:
    """The sum high + low of two_sum and two_product is the exact result.

    float64 holds it where the exponents are near: equal to the bit for 50,000 pairs.
    """
    n = 50_000 * t.effort
    a, b = (np.ldexp(t.rng.uniform(-1, 1, n), t.rng.integers(-12, 12, n)) for _ in range(2))
    a, b = single(a), single(b)
    for name, exact in (("two_sum", a + b), ("two_product", a * b)):
        high, low = t.function(name, a, b).T
        t.check(high == single(exact), name)
        t.check(high + low == exact, name)


def in_units(mantissa: int, exponent: int) -> int:
    """round(mantissa 2^exponent), halves up."""
    if exponent >= 0:
        return mantissa << exponent
    return (mantissa + (1 << (-exponent - 1))) >> -exponent


@case(1)
def film_sums(t: Trial) -> None:
    """A pixel's sums are the integers that the film specifies, added one by one or side by side.

    x once and y 63 times: round(x 2^72) and round(x^2 2^76), halves up, to the bit for 20,000
    pairs with exponents from -149 to 19; an eighth are halves of the resolution or 0.
    """
    n = 20_000 * t.effort
    pairs = np.ldexp(t.rng.uniform(0.5, 1, (n, 2)), t.rng.integers(-60, 21, (n, 2)))
    pairs[::8] = np.ldexp(t.rng.integers(0, 2**12, (n // 8, 2)), -73)
    pairs[1::8] = np.ldexp(
        t.rng.uniform(0.5, 1, (n // 8, 2)), t.rng.integers(-148, -60, (n // 8, 2))
    )
    pairs[2::32] = np.nextafter(np.float32(2**20), np.float32(0))  # the largest
    pairs = single(pairs)
    mantissa, exponent = np.frexp(pairs)
    whole = np.ldexp(mantissa, 24).astype(np.int64).tolist()
    low = (exponent - 24).tolist()
    got = t.function("film_sums", *pairs.T).astype(np.int64)
    for k, (m, e) in enumerate(zip(whole, low, strict=True)):
        for power, scale, words in ((1, 72, got[k, :8]), (2, 76, got[k, 8:])):
            x, y = (in_units(m[i] ** power, power * e[i] + scale) for i in (0, 1))
            total = sum(int(word) << (16 * i) for i, word in enumerate(words))
            t.check(total == x + 63 * y, f"{pairs[k]} to the power {power}: {total:#x}")


@case(1)
def tent(t: Trial) -> None:
    """The tent filter's offset inverts its distribution, at every 61st of all 2^24 arguments.

    In [-1, 1), rising; the cumulative distribution gives the argument back within 2e-7.
    """
    u = np.arange(0, 2**24, 61) * UNIT
    x = column(t, "tent", u).astype(np.float64)
    t.check(x.min() == -1 and x.max() < 1 and (np.diff(x) >= 0).all(), "range and order")
    cdf = np.where(x < 0, (1 + x) ** 2 / 2, 1 - (1 - x) ** 2 / 2)
    t.check(np.abs(cdf - u).max() < 2e-7, "distribution")


# ---- the same bits everywhere ----

Arguments = Callable[[np.random.Generator, int], Array]


def _words(rng: np.random.Generator, n: int, last: float) -> Array:
    """Uniform over the bit patterns of the positive normal floats up to `last`."""
    end = int(np.float32(last).view(np.uint32)) + 1
    return rng.integers(0x800000, end, n, dtype=np.uint32).view(np.float32)[:, None]


def _unit(rng: np.random.Generator, n: int, columns: int = 1) -> Array:
    """Multiples of 2^-24, corners included."""
    u = rng.integers(0, 2**24, (n, columns)) * UNIT
    corners = np.array(list(itertools.product(CORNERS, repeat=columns)))[:n]
    u[: len(corners)] = corners
    return u


def _pairs(rng: np.random.Generator, n: int) -> Array:
    return np.ldexp(rng.uniform(-1, 1, (n, 2)), rng.integers(-12, 12, (n, 2)))


def _cone(rng: np.random.Generator, n: int) -> Array:
    return np.concatenate([_unit(rng, n, 2), 2 * 10 ** rng.uniform(-30, 0, (n, 1))], axis=1)


def _g(rng: np.random.Generator, n: int) -> Array:
    g = rng.uniform(-1, 1, (n, 1))
    return np.where(rng.random((n, 1)) < 0.5, g, rng.choice(ASYMMETRIES, (n, 1))) * (1 - 1e-6)


def _spheres(rng: np.random.Generator, n: int) -> tuple[Array, Array]:
    """Records of spheres that pass through [-1, 1]^3, and the points where they do."""
    radius = 10 ** rng.uniform(-6, 6, (n, 1))
    at = rng.uniform(-1, 1, (n, 3))
    exact = np.concatenate([at - directions(rng, n) * radius, radius], axis=1)
    high = single(exact)
    low = exact - high
    return np.concatenate([high[:, :3], low[:, :3], high[:, 3:], low[:, 3:]], axis=1), at


def _sphere_rays(rng: np.random.Generator, n: int) -> Array:
    record, at = _spheres(rng, n)
    o = rng.uniform(-1, 1, (n, 3))
    near = np.minimum(record[:, 6:7], 1) * directions(rng, n)
    return np.concatenate([record, o, normalised(at + near - o), np.full((n, 1), np.inf)], axis=1)


def _sphere_lights(rng: np.random.Generator, n: int) -> Array:
    record, _ = _spheres(rng, n)
    return np.concatenate([record, rng.uniform(-1, 1, (n, 3)), _unit(rng, n, 2)], axis=1)


def _materials(rng: np.random.Generator, n: int) -> Array:
    """Kind, side, albedo, colours, eta, k, alpha, slopes, shares of a principled one, a normal and
    a direction on its side."""
    kind = rng.integers(0, len(MATERIAL_KINDS), (n, 1))
    eta = np.where(
        (kind == 1) | (kind == 6), 10 ** rng.uniform(-2, 1, (n, 1)), rng.uniform(0.4, 2.5, (n, 1))
    )
    shares = rng.random((n, len(PRINCIPLED | PRINCIPLED_THIN)))
    normal = directions(rng, n)
    wo = normalised(normal + 0.9999 * directions(rng, n))
    return np.concatenate([kind, rng.integers(0, 2, (n, 1)), rng.random((n, 3)), eta,
                           rng.uniform(0, 20, (n, 1)), 10 ** rng.uniform(-4, 0.5, (n, 2)),
                           rng.integers(0, 2, (n, 1)), shares, normal, wo], axis=1)  # fmt: skip


#: Shapes of lights in the order of cpp/lights/shapes.h.
LIGHT_SHAPES = (
    "parallelogram", "triangle", "triangle_pair", "disk", "sphere", "point", "spot", "directional",
    "rectangle", "constant_sky", "image_sky", "guided_sky",
    "projector",
)  # fmt: skip


def _lights(rng: np.random.Generator, n: int) -> Array:
    """Lights of the shapes before the skies, receivers in [-1, 1]^3 and two random numbers."""
    shape = rng.integers(0, LIGHT_SHAPES.index("constant_sky"), (n, 1))
    ball_shape, spot_shape = (LIGHT_SHAPES.index(name) for name in ("sphere", "spot"))
    place = np.concatenate([rng.uniform(-2, 2, (n, 9)), directions(rng, n)], axis=1)
    ball = np.zeros((n, 12))
    ball[:, :8], _ = _spheres(rng, n)
    ball[:, 9] = rng.choice([-1, 1], n)
    cutoff = rng.uniform(0.1, 3, n)
    beam = cutoff * rng.random(n) * 0.99
    spot = place.copy()
    spot[:, 3:7] = np.stack([np.cos(cutoff), np.cos(beam), cutoff, 1 / (cutoff - beam)], axis=1)
    place = np.where(shape == ball_shape, ball, np.where(shape == spot_shape, spot, place))
    rest = np.stack([1e-6 * rng.random(n), rng.uniform(0.01, 1, n)], axis=1)
    return np.concatenate(
        [shape, place, rest, rng.uniform(-1, 1, (n, 3)), _unit(rng, n, 2)], axis=1
    )


def _powers(rng: np.random.Generator, n: int) -> Array:
    """Shape, area, strength, cutoff and beam in degrees."""
    cutoff = rng.uniform(1, 180, n)
    shape = rng.integers(0, LIGHT_SHAPES.index("image_sky"), n)
    return np.stack([shape, rng.uniform(0.01, 9, n), rng.uniform(0.01, 9, n),
                     cutoff, cutoff * rng.random(n) * 0.99], axis=1)  # fmt: skip


def _flights(rng: np.random.Generator, n: int, colours: int) -> Array:
    sigma, limit = 10 ** rng.uniform(-2, 2, (n, colours)), 10 ** rng.uniform(-2, 2, (n, 1))
    words = rng.integers(0, 2**16, (n, 2))
    if colours == 1:
        return np.concatenate([sigma, limit, words], axis=1)
    carried = 10 ** rng.uniform(-3, 1, (n, 3))
    return np.concatenate([sigma, rng.random((n, 3)), carried, limit, _unit(rng, n), words], axis=1)


#: Functions of one argument, those of 2^24 arguments apart.
WIDE: dict[str, Arguments] = {
    "sqrt": lambda rng, n: _words(rng, n, 3e38),
    "reciprocal": lambda rng, n: _words(rng, n, 3e38),
    "log": lambda rng, n: _words(rng, n, 3e38),
    "exp_minus": lambda rng, n: _words(rng, n, 90.0),
    "scaled_bessel": lambda rng, n: _words(rng, n, 3e38),
    "exponential": lambda rng, n: rng.integers(0, 2**16, (n, 2)).astype(np.float64),
    "two_sum": _pairs,
    "two_product": _pairs,
    "plain_quotient": _pairs,
}
UNIT_ONLY = ("sin_2pi", "cos_2pi", "tent")
MANY: dict[str, Arguments] = {
    **{name: lambda rng, n: _unit(rng, n, 2) for name in INVERSE},
    "uniform_cone": _cone,
    "orthonormal_frame": lambda rng, n: directions(rng, n),
    "henyey_greenstein": lambda rng, n: np.concatenate(
        [directions(rng, n), _g(rng, n), _unit(rng, n, 2)], axis=1
    ),
    "henyey_greenstein_pdf": lambda rng, n: np.concatenate(
        [directions(rng, n), directions(rng, n), _g(rng, n)], axis=1
    ),
    "sphere": _sphere_rays,
    "sphere_light": _sphere_lights,
    "fresnel_dielectric": lambda rng, n: np.concatenate(
        [_unit(rng, n), 10 ** rng.uniform(-1, 1, (n, 1))], axis=1
    ),
    "fresnel_conductor": lambda rng, n: np.concatenate(
        [_unit(rng, n), 10 ** rng.uniform(-2, 1, (n, 1)), rng.uniform(0, 20, (n, 1))], axis=1
    ),
    "bsdf_sample": lambda rng, n: np.concatenate([_materials(rng, n), _unit(rng, n, 3)], axis=1),
    "bsdf_eval": lambda rng, n: np.concatenate([_materials(rng, n), directions(rng, n)], axis=1),
    "light": _lights,
    "light_pdf": lambda rng, n: np.concatenate(
        [np.delete(_lights(rng, n), (13, 18, 19), 1), directions(rng, n)], axis=1
    ),
    "light_emission": lambda rng, n: np.concatenate(
        [_lights(rng, n)[:, :15], _unit(rng, n, 4)], axis=1
    ),
    "light_power": _powers,
    "free_flight": lambda rng, n: _flights(rng, n, 1),
    "free_flight_colour": lambda rng, n: _flights(rng, n, 3),
}


def hooked(function: Callable[..., Array], name: str, *columns: Any) -> Array:
    """A hook of the native module; Skipped if the module does not have it."""
    try:
        return function(name, *columns)
    except ValueError as error:
        if "unknown function" in str(error):
            raise Skipped(f"no hook {name!r} in the native module") from None
        raise


def check_same_bits(t: Trial, name: str, chunk: Callable[[int, int], Array], total: int) -> None:
    """chunk(start, n): rows of arguments. Every device against the first; words compared."""
    modules = {d: device_module.select(d)[0].native for d in t.devices}
    size = min(total, 2**18)
    for start in range(0, total, size):
        x = chunk(start, min(size, total - start)).astype(np.float32)
        first: Array | None = None
        for d, module in modules.items():
            got = hooked(module.eval_function, name, x).view(np.uint32)
            if first is None:
                first = got
                continue
            if np.array_equal(got, first):
                t.checks += 1
                continue
            same = (got == first).all(axis=1)
            t.check(same, f"{d}: {name}{x[~same][:1].tolist()}: {got[~same][:1]}")
    t.check(total > 0)
    t.figure("arguments", total)
    t.figure("devices", list(modules))


@case(1, each={"name": [*WIDE, *MANY], "bits": [20, 24]}, once=True,
      quick=lambda name, bits: bits < 24)  # fmt: skip
def same_bits(t: Trial, name: str, bits: int) -> None:
    """A function has the same bits on all devices, in scalar and in vector lanes.

    Random arguments over the whole domain, corners among them: 2^20, in a full run 2^24 (mappings:
    2^22). A CPU module compares its own lane widths.
    """
    many = name in MANY
    arguments = (MANY if many else WIDE)[name]
    check_same_bits(t, name, lambda _, n: arguments(t.rng, n), 2 ** min(bits, 22 if many else 24))


@case(1, each={"name": UNIT_ONLY, "step": [61, 1]}, once=True, quick=lambda name, step: step > 1)
def same_bits_of_turns(t: Trial, name: str, step: int) -> None:
    """Sine, cosine and tent have the same bits on all devices and lanes.

    At every step-th (in a full run every) of the 2^24 arguments k 2^-24, and around both ends.
    """
    ends = np.arange(2**14)
    k = np.concatenate([np.arange(0, 2**24, step), ends, 2**24 - 1 - ends])
    check_same_bits(t, name, lambda start, n: k[start : start + n, None] * UNIT, len(k))


# ---- mappings ----

FLAT = ("uniform_triangle", "uniform_disk")
#: Step, reach in steps and weights of the central difference of sixth order.
STEP = 2.0**-6
STENCIL = ((1, 3 / 4), (2, -3 / 20), (3, 1 / 60))
#: Largest |Jacobian x density - 1|: rounding of float32 divided by the step, and truncation.
JACOBIAN = 2e-5


def jacobian(f: Callable[[Array, Array], Array], u: Array, v: Array) -> Array:
    """Area of the image of a unit of (u, v) under f: (n,), (n,) -> (n, 2 or 3)."""
    du = sum(w * (f(u + k * STEP, v) - f(u - k * STEP, v)) for k, w in STENCIL) / STEP
    dv = sum(w * (f(u, v + k * STEP) - f(u, v - k * STEP)) for k, w in STENCIL) / STEP
    if du.shape[1] == 2:
        return np.abs(du[:, 0] * dv[:, 1] - du[:, 1] * dv[:, 0])
    return np.linalg.norm(np.cross(du, dv), axis=1)


def places(low: float = 0.15, high: float = 0.85) -> tuple[Array, Array]:
    """400 points of the unit square, multiples of 2^-12, so that steps from them are exact."""
    line = np.rint(np.linspace(low, high, 20) * 4096) / 4096
    u, v = np.meshgrid(line, line)
    return u.ravel(), v.ravel()


@case(1, each={"name": INVERSE})
def jacobian_of_mappings(t: Trial, name: str) -> None:
    """Jacobian times density is 1 for the maps to hemisphere, sphere, triangle and disc.

    Sixth-order differences of the float32 map in float64: within 2e-5 at 400 places.
    """
    u, v = places()

    def f(u: Array, v: Array) -> Array:
        p = t.function(name, u, v)
        return p[:, :2] if name in FLAT else p

    off = jacobian(f, u, v) * density(name, t.function(name, u, v)) - 1
    t.check(np.abs(off).max() < JACOBIAN, f"off by {np.abs(off).max():.2g}")
    t.figure("largest error", float(np.abs(off).max()))


@case(1, each={"one_minus_cos": [2.0, 0.5, 1e-4, 1e-13]})
def jacobian_of_cones(t: Trial, one_minus_cos: float) -> None:
    """Jacobian times density is 1 for cones of directions, down to 6e-13 sr.

    Within 2e-5 at 400 places; a narrow cone is compared in units of its own width.
    """
    u, v = places()
    scale = max(1.0, np.sqrt(1 / one_minus_cos))

    def f(u: Array, v: Array) -> Array:
        p = t.function("uniform_cone", u, v, one_minus_cos)[:, :3]
        return p * scale if scale == 1 else p[:, :2] * scale

    p = t.function("uniform_cone", u, v, one_minus_cos)
    # in the plane: the solid angle is foreshortened by the cosine
    pdf = p[:, 3] / scale**2 / (1 if scale == 1 else p[:, 2])
    off = jacobian(f, u, v) * pdf - 1
    t.check(np.abs(off).max() < JACOBIAN, f"off by {np.abs(off).max():.2g}")


@case(1, each={"g": [0.0, 1e-4, -0.5, 0.6, -0.9]})
def jacobian_of_the_phase_function(t: Trial, g: float) -> None:
    """Jacobian times density is 1 for Henyey and Greenstein's phase function about a tilted axis.

    Within 2e-5, for |g| > 0.8 within 1e-3, at 400 places.
    """
    d = normalised(np.array([[0.48, -0.64, 0.6]]))[0]
    u, v = places()
    p = t.function("henyey_greenstein", *d, g, u, v)
    area = jacobian(lambda u, v: t.function("henyey_greenstein", *d, g, u, v)[:, :3], u, v)
    off = np.abs(area * p[:, 3] - 1).max()
    t.check(off < (1e-3 if abs(g) > 0.8 else JACOBIAN), f"off by {off:.2g}")


@case(1, each={"away": [1.5, 30.0, 0.6]})
def jacobian_of_sphere_lights(t: Trial, away: float) -> None:
    """Jacobian times density is 1 for directions to a sphere, from near, far and inside.

    Within 2e-5 of 1 at 400 places; far: in units of the cone's width.
    """
    sphere = [0.25, -0.5, 0.125, 0, 0, 0, 0.5, 0]
    p = np.array(sphere[:3]) + away * 0.5 * np.array([0.6, 0.0, -0.8])
    u, v = places()
    s = t.function("sphere_light", *sphere, *p, u, v)
    area = jacobian(lambda u, v: t.function("sphere_light", *sphere, *p, u, v)[:, :3], u, v)
    off = np.abs(area * s[:, 3] - 1).max()
    t.check(off < JACOBIAN * max(1.0, away), f"off by {off:.2g}")


@case(1, each={"name": ["exponential", "tent"]})
def derivative_of_inverse_distributions(t: Trial, name: str) -> None:
    """Derivative times density is 1 for free flights and for the tent filter.

    Within 2e-5 at 1,000 places of (0, 1), the tip of the tent left out.
    """
    u = np.rint(np.linspace(0.15, 0.85, 1000) * 2**16) / 2**16
    u = u[np.abs(u - 0.5) > 0.06] if name == "tent" else u

    def f(u: Array) -> Array:
        if name == "tent":
            return t.function("tent", u)[:, 0]
        return t.function("exponential", np.floor(u * 65536), 0)[:, 0]

    slope = sum(w * (f(u + k * STEP) - f(u - k * STEP)) for k, w in STENCIL) / STEP
    pdf = 1 - np.abs(f(u)) if name == "tent" else -np.exp(-f(u))
    off = np.abs(slope * pdf - 1).max()
    t.check(off < JACOBIAN, f"off by {off:.2g}")


@case(1, each={"name": INVERSE})
def corners(t: Trial, name: str) -> None:
    """Mappings at the corners of the unit square: u, v in {0, 2^-24, 1/2, 1 - 2^-24}.

    Unit directions (1e-5) with a positive finite density; weights and points within their shape.
    """
    u, v = np.array(list(itertools.product(CORNERS, CORNERS))).T
    p = t.function(name, u, v)
    t.check(np.isfinite(p), "not finite")
    if name == "uniform_triangle":
        t.check((p[:, :2] >= 0).all() and (p[:, :2].sum(1) <= 1 + 1e-6).all(), "outside")
    elif name == "uniform_disk":
        t.check(np.linalg.norm(p, axis=1) <= 1 + 1e-7, "outside")
    else:
        t.check(np.abs(np.linalg.norm(p, axis=1) - 1).max() < 1e-5, "length")
        t.check((density(name, p) > 0) & np.isfinite(density(name, p)), "density")


@case(1, each={"one_minus_cos": [2.0, 1.0, 0.3, 1e-4, 1e-13, 1e-30]})
def cones_of_every_width(t: Trial, one_minus_cos: float) -> None:
    """Directions in cones, down to 1e-30 sr, and at the corners.

    x, y, z and the pdf within 3e-7 of the exact map, relatively.
    """
    u, v = single(t.rng.random((2, 20_000 * t.effort)) * (1 - 2.0**-24))
    u[:4], v[:4] = CORNERS, CORNERS
    got = t.function("uniform_cone", u, v, one_minus_cos)
    h = u * single(one_minus_cos)
    sine = np.sqrt(h * (2 - h))
    t.check(np.abs(np.hypot(got[:, 0], got[:, 1]) - sine) <= 3e-7 * sine, "sine")
    t.check(np.abs(got[:, 2] - (1 - h)).max() < 1e-7, "cosine")
    turn = np.arctan2(got[:, 1], got[:, 0]) / (2 * np.pi) - v
    t.check(np.abs(turn - np.rint(turn))[h > 0].max() < 2e-7, "azimuth")
    t.check(np.abs(got[:, 3] * 2 * np.pi * single(one_minus_cos) - 1) < 3e-7, "pdf")


@case(1)
def frames(t: Trial) -> None:
    """Frames about a normal are orthonormal and right-handed, also near the poles.

    Within 5e-7 at 20,000 normals. T. Duff et al., JCGT 6(1), 2017.
    """
    n = t.rng.normal(size=(20_000 * t.effort, 3))
    n[:5_000, :2] *= np.exp(t.rng.uniform(-40, 0, (5_000, 1)))  # about both poles
    n[:6] = np.concatenate([np.eye(3), -np.eye(3)])
    n = single(normalised(n))
    frame = t.function("orthonormal_frame", *n.T)
    a, b = frame[:, :3], frame[:, 3:]
    for p, q in ((a, b), (a, n), (b, n)):
        t.check(np.abs((p * q).sum(1)).max() < 4e-7, "angles")
    for p in (a, b):
        t.check(np.abs(np.linalg.norm(p, axis=1) - 1).max() < 4e-7, "lengths")
    t.check(np.abs(np.cross(a, b) - n).max() < 5e-7, "handedness")


@case(1, each={"g": ASYMMETRIES})
def phase_function_inverts_its_distribution(t: Trial, g: float) -> None:
    """Henyey and Greenstein's phase function about +z, corners included.

    The angle to the favoured direction is within 1e-6 of itself, the pdf within 2e-6.
    """
    g = float(single(g))
    a = abs(g)
    u, v = single(t.rng.random((2, 20_000 * t.effort)) * (1 - 2.0**-24))
    u[:4], v[:4] = CORNERS, CORNERS
    x, y, z, pdf = t.function("henyey_greenstein", 0, 0, 1, g, u, v).T
    angle = np.arctan2(np.hypot(x, y), -z if g < 0 else z)
    q = 1 - a + 2 * a * u
    less = 2 * (1 - a) ** 2 * (1 - u) * (1 + a * u) / q**2  # 1 - cos
    more = 2 * (1 + a) ** 2 * u * (1 - a * (1 - u)) / q**2  # 1 + cos
    exact = 2 * np.arctan2(np.sqrt(less), np.sqrt(more))
    t.check(np.abs(angle - exact) <= 1e-6 * exact, "angle")
    value = phase(2 * np.sin(angle / 2) ** 2, g)
    t.check(np.abs(pdf - value) <= 2e-6 * value, "pdf")
    if a > 0.1:  # the textbook's form
        other = (1 + a * a - ((1 - a * a) / q) ** 2) / (2 * a)
        t.check(np.abs(other - (1 - less)).max() < 1e-10, "oracle")
    turn = np.arctan2(y, x) / (2 * np.pi) - v
    t.check(np.abs(turn - np.rint(turn))[1:].max() < 3e-7, "azimuth")


@case(1, each={"g": ASYMMETRIES})
def phase_function_of_vectors(t: Trial, g: float) -> None:
    """The phase function of sampled and of arbitrary directions; its integral over the sphere.

    Unit directions (2e-7), pdf within 2e-6 of itself, integral 1 within 1e-5 (|g| <= 0.9).
    """
    g = float(single(g))
    n = 20_000 * t.effort
    d = single(directions(t.rng, n))
    out = t.function("henyey_greenstein", *d.T, g, t.rng.random(n), t.rng.random(n))
    t.check(np.abs(np.linalg.norm(out[:, :3], axis=1) - 1).max() < 2e-7, "length")
    for w in (out[:, :3], np.roll(d, 1, axis=0), d, -d):
        got = t.function("henyey_greenstein_pdf", *d.T, *w.T, g)[:, 0]
        value = phase(((w - np.where(g < 0, -1, 1) * d) ** 2).sum(1) / 2, g)
        t.check(np.abs(got - value) <= 2e-6 * value, "pdf")
    if abs(g) <= 0.9:
        cosine = (np.arange(2**16) + 0.5) * 2.0**-15 - 1
        w = np.stack([np.sqrt(1 - cosine**2), 0 * cosine, cosine])
        values = t.function("henyey_greenstein_pdf", 0, 0, 1, *w, g)
        t.check(abs(values.sum() * 2.0**-15 * 2 * np.pi - 1) < 1e-5, "integral")


@case(1)
def rayleigh_inverts_its_distribution(t: Trial) -> None:
    """Rayleigh's phase function about +z: the share (4 + 3 c + c^3) / 8 below a cosine is u.

    Within 2e-7, corners included; the pdf within 1e-6 of 3 / 16 pi (1 + c^2).
    """
    u, v = single(t.rng.random((2, 20_000 * t.effort)) * (1 - 2.0**-24))
    u[:4], v[:4] = CORNERS, CORNERS
    x, y, z, pdf = t.function("rayleigh", 0, 0, 1, u, v).T
    c = np.cos(np.arctan2(np.hypot(x, y), z))
    t.check(np.abs((4 + 3 * c + c**3) / 8 - u).max() < 2e-7, "share")
    t.check(np.abs(pdf * 16 * np.pi / 3 / (1 + c * c) - 1).max() < 1e-6, "pdf")
    turn = np.arctan2(y, x) / (2 * np.pi) - v
    t.check(np.abs(turn - np.rint(turn))[4:].max() < 3e-7, "azimuth")


@case(1)
def free_flights_from_all_words(t: Trial) -> None:
    """-log((word + 1/2) 2^-32) for words everywhere, at both ends and where the form changes.

    Within a relative 2.4e-7, falling with the word, positive for the last: no flight is infinite.
    """
    words = t.rng.integers(0, 2**32, 100_000 * t.effort, dtype=np.uint64)
    ends = np.arange(4096, dtype=np.uint64)
    about = np.uint64(np.sqrt(0.5) * 2**32) - np.uint64(2048) + ends  # where the form changes
    words = np.unique(np.concatenate([words, ends, 2**32 - 1 - ends, about]))
    got = t.function("exponential", words >> 16, words & 65535)[:, 0]
    low, high = (words + 0.5) * 2.0**-32, (2**32 - 1 - words + 0.5) * 2.0**-32
    exact = np.where(low < 0.5, -np.log(low), -np.log1p(-high))
    t.check(np.abs(got - exact) <= 2.4e-7 * exact, "value")
    t.check((np.diff(got) <= 0).all() and got[-1] > 0, "order")
