"""Spectra to linear RGB, as Mitsuba 3 does in its rgb variants.

A spectrum is a list of wavelengths and values, linear in between and 0 outside. With the CIE 1931
observer x, y, z, linear between its rows of 5 nm, and 1000 wavelengths w from 360 to 830 nm,

    XYZ = 470 / 1000 sum (x, y, z)(w) value(w) illuminant(w) / 106.7502593994140625
    RGB = M XYZ, M the matrix of ITU-R BT.709

The illuminant is 1 for what emits and for metals by name, and D65 / 98.99741751876255 for all else,
so that a white reflectance is grey (0.9989; the constants are Mitsuba's, of sums like this one, and
give an even spectrum Y = 1). RGB below 0 becomes 0. What must not exceed 1 (a reflectance) is cut
at 1; unlike in Mitsuba, the coefficients of media are not. A SceneWarning tells what was cut. One
number is that number in R, G and B, but in an emitter an even spectrum of that height, which is
reddish.

Mitsuba's rgb variants refuse to render `regular`, `irregular` and `blackbody`; here they are lists
like any other, a blackbody in W m^-2 sr^-1 nm^-1. As there, `d65` is (1, 1, 1) and its `scale` does
not apply to a spectrum nested in it, and `uniform` is its value whatever its range.

Sums are correctly rounded (math.fsum) and Planck's law uses decimal: the same on every machine.
"""

from __future__ import annotations

import math
import re
from bisect import bisect_right
from collections.abc import Callable
from dataclasses import dataclass
from decimal import Context, Decimal, localcontext
from functools import lru_cache
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

from ..errors import SceneError
from .colour_tables import D65, X, Y, Z
from .node import Value, allowed, parse_float, parse_floats, read_bytes, shorten

RGB = tuple[float, float, float]
Array = npt.NDArray[Any]
LOW, HIGH, SAMPLES = 360.0, 830.0, 1000
MAX_BYTES = 16 * 2**20
_STEP = 5.0
_Y_NORM, _D65_NORM = 106.7502593994140625, 98.99741751876255
XYZ_TO_RGB = (
    (3.240479, -1.537150, -0.498535),
    (-0.969256, 1.875991, 0.041556),
    (0.055648, -0.204043, 1.057311),
)
_PLANCK, _LIGHT, _BOLTZMANN = Decimal("6.62607015e-34"), Decimal(299792458), Decimal("1.380649e-23")
_DIGITS = Context(prec=30)


@dataclass(frozen=True, slots=True)
class Spectrum:
    """Values at increasing wavelengths in nm."""

    wavelengths: tuple[float, ...]
    values: tuple[float, ...]

    def __str__(self) -> str:
        pairs = zip(self.wavelengths, self.values, strict=True)
        return ", ".join(f"{w:g}:{v:g}" for w, v in pairs)

    __repr__ = __str__

    def written(self) -> str:
        """Text that `parse` reads as the same spectrum."""
        pairs = zip(self.wavelengths, self.values, strict=True)
        return " ".join(f"{w!r}:{v!r}" for w, v in pairs)


def listed(
    wavelengths: tuple[float, ...], values: tuple[float, ...], label: str, where: str
) -> Spectrum:
    """A checked spectrum: at least two increasing wavelengths, and a value for each."""
    if len(wavelengths) != len(values):
        raise SceneError(f"{label}: {len(wavelengths)} wavelengths, {len(values)} values", where)
    if len(wavelengths) < 2:
        raise SceneError(f"{label} holds {len(wavelengths)} wavelength, expected 2 or more", where)
    for one, next_ in zip(wavelengths, wavelengths[1:], strict=False):
        if not one < next_:
            raise SceneError(f"{label}: {next_:g} nm follows {one:g} nm; they must increase", where)
    return Spectrum(wavelengths, values)


def parse(text: str, label: str, where: str) -> Any:
    """The value of a spectrum given as text: (c, c, c) for one number, or a Spectrum of
    "wavelength:value" separated by blanks or commas."""
    if ":" not in text:
        if len([token for token in re.split(r"[\s,]+", text) if token]) == 3:
            told = f"{label} = {shorten(text)} holds 3 numbers, expected 1; a colour is <rgb>"
            raise SceneError(told, where)
        return parse_floats(text, label, where, (1,)) * 3
    pairs = [token.split(":") for token in re.split(r"[\s,]+", text) if token]
    for pair in pairs:
        if len(pair) != 2:
            raise SceneError(f"{label}: {shorten(':'.join(pair))} is not wavelength:value", where)
    wavelengths, values = (
        tuple(parse_float(pair[i], label, where) for pair in pairs) for i in (0, 1)
    )
    return listed(wavelengths, values, label, where)


def read_spd(path: Path, label: str, where: str) -> Spectrum:
    """A text file with a wavelength and a value to a line; "#" starts a comment line."""
    try:
        lines = read_bytes(path, MAX_BYTES, where).decode("utf-8-sig").splitlines()
    except UnicodeDecodeError as error:
        raise SceneError(f"not UTF-8 text (byte {error.start})", str(path)) from None
    rows = []
    for number, line in enumerate(lines, 1):
        if line.strip() and not line.lstrip().startswith("#"):
            rows.append(parse_floats(line, "wavelength and value", f"{path}:{number}", (2,)))
    return listed(tuple(r[0] for r in rows), tuple(r[1] for r in rows), label, where)


def to_rgb(
    value: Any,
    emitter: bool,
    bounded: bool,
    label: str,
    where: str,
    warn: Callable[[str, str], None],
) -> RGB:
    """RGB of the value of a `spectrum`, three equal numbers or a Spectrum; warn: takes the text and
    the place of a warning."""
    if not isinstance(value, Spectrum):
        return _matrix(value) if emitter else value
    rgb = _converted(value, not emitter)
    cut: RGB = tuple(max(x, 0.0) if not bounded else min(max(x, 0.0), 1.0) for x in rgb)  # type: ignore[assignment]
    if not all(math.isfinite(x) for x in rgb):
        raise SceneError(f"{label} = {shorten(str(value))}: its RGB must be finite", where)
    if cut != rgb:
        shown = ", ".join(f"{x:.4g}" for x in rgb)
        allowed_range = "[0, 1]" if bounded else "[0, inf)"
        warn(f"{label}: its linear RGB ({shown}) is cut to {allowed_range}, as in Mitsuba", where)
    return cut


def of_metal(wavelengths: tuple[float, ...], values: tuple[float, ...]) -> RGB:
    """RGB of eta or k, as Mitsuba converts its tables of metals: without illuminant."""
    red, green, blue = _converted(Spectrum(wavelengths, values), False)
    return max(red, 0.0), max(green, 0.0), max(blue, 0.0)


def xyz(spectrum: Spectrum, lit: bool = False) -> RGB:
    """CIE XYZ of a spectrum, of its product with D65 if `lit`."""
    weights = _weights(lit)
    wavelengths, values = spectrum.wavelengths, spectrum.values
    last = len(wavelengths) - 2
    products: tuple[list[float], ...] = ([], [], [])
    for w, weight in zip(_samples(), weights, strict=True):
        if w < wavelengths[0] or w > wavelengths[-1]:
            continue
        i = min(bisect_right(wavelengths, w) - 1, last)
        w0, w1 = wavelengths[i], wavelengths[i + 1]
        value = ((w - w1) * values[i] + (w0 - w) * values[i + 1]) / (w0 - w1)
        for product, factor in zip(products, weight, strict=True):
            product.append(factor * value)
    try:
        x, y, z = (math.fsum(product) for product in products)
    except (OverflowError, ValueError):  # infinite or above the range on the way
        x = y = z = math.inf
    return x, y, z


@lru_cache(maxsize=1024)
def _converted(spectrum: Spectrum, lit: bool) -> RGB:
    return _matrix(xyz(spectrum, lit))


def _matrix(colour: RGB) -> RGB:
    x, y, z = colour
    red, green, blue = (
        math.fsum((a * x, b * y, c * z)) if math.isfinite(x + y + z) else math.inf
        for a, b, c in XYZ_TO_RGB
    )
    return red, green, blue


@lru_cache(maxsize=1)
def _samples() -> tuple[float, ...]:
    return tuple(LOW + i / (SAMPLES - 1) * (HIGH - LOW) for i in range(SAMPLES))


@lru_cache(maxsize=2)
def _weights(lit: bool) -> tuple[RGB, ...]:
    """What a spectrum's value counts in X, Y and Z at each of the sampled wavelengths."""
    result = []
    for w in _samples():
        factor = (HIGH - LOW) / SAMPLES / _Y_NORM * (_table(D65, w) / _D65_NORM if lit else 1.0)
        result.append((_table(X, w) * factor, _table(Y, w) * factor, _table(Z, w) * factor))
    return tuple(result)


def _table(table: tuple[float, ...], wavelength: float) -> float:
    position = (wavelength - LOW) / _STEP
    i = min(int(position), len(table) - 2)
    share = position - i
    return (1.0 - share) * table[i] + share * table[i + 1]


@lru_cache(maxsize=256)
def blackbody(temperature: float, low: float, high: float, scale: float) -> Spectrum:
    """Planck's law at the sampled wavelengths, in W m^-2 sr^-1 nm^-1, times `scale`."""
    wavelengths = tuple(w for w in _samples() if low <= w <= high)
    values = []
    with localcontext(_DIGITS):
        nano = Decimal("1e-9")
        factor = 2 * _PLANCK * _LIGHT**2 * nano * Decimal(scale)
        unit = _PLANCK * _LIGHT / (_BOLTZMANN * Decimal(temperature))
        for w in wavelengths:
            metres = Decimal(w) * nano
            values.append(float(factor / (metres**5 * ((unit / metres).exp() - 1))))
    return Spectrum(wavelengths, tuple(values))


def decoded(shares: Array) -> Array:
    """Linear values of shares of white by the sRGB curve, with operations that round alike on every
    machine: above 0.04045 it is z^2 times the fifth root of z^2, z = (share + 0.055) / 1.055."""
    z = (np.maximum(shares, 0.04045) + 0.055) / 1.055
    square = z * z
    root = np.ldexp(1.0, -(-np.frexp(square)[1] // 5))  # not below; Newton's steps descend
    for _ in range(10):
        root = (4 * root + square / (root * root * (root * root))) / 5
    return np.where(shares <= 0.04045, shares / 12.92, square * root)


def srgb(text: str, label: str, where: str) -> RGB:
    """Linear RGB of an sRGB colour: "#rrggbb", or one or three numbers in [0, 1]."""
    if re.fullmatch(r"\s*#[0-9A-Fa-f]{6}\s*", text):
        digits = text.strip()[1:]
        codes = [_DIGITS.divide(int(digits[i : i + 2], 16), 255) for i in (0, 2, 4)]
    elif "#" in text:
        raise SceneError(f"{label} = {shorten(text)}, expected #rrggbb", where)
    else:
        numbers = parse_floats(text, label, where, (1, 3))
        codes = [Decimal(x) for x in numbers * (3 // len(numbers))]
        if not all(0 <= x <= 1 for x in codes):
            raise SceneError(f"{label} = {shorten(text)} is outside [0, 1]", where)
    red, green, blue = (_decoded(code) for code in codes)
    return red, green, blue


def _decoded(code: Decimal) -> float:
    with localcontext(_DIGITS):
        if code <= Decimal("0.04045"):
            return float(code / Decimal("12.92"))
        return float(((code + Decimal("0.055")) / Decimal("1.055")) ** Decimal("2.4"))


def parse_rgb(text: str, label: str, where: str) -> tuple[float, ...]:
    """One or three linear numbers; "#rrggbb" is sRGB."""
    if "#" in text:
        return srgb(text, label, where)
    numbers = parse_floats(text, label, where, (1, 3))
    return numbers * (3 // len(numbers))


# Plugins of category spectrum (Mitsuba counts them as textures).


def plugin(kind: str, given: dict[str, Value], nested: list[Value], where: str) -> Value:
    """The value of a spectrum plugin: its parameters, and spectra inside it without a name."""
    make, names = PLUGINS[kind]
    for name, value in given.items():
        if name not in names:
            raise SceneError(
                f'{kind}: unknown parameter "{name}" = {shorten(value.value)}'
                + allowed(name, names),
                value.where,
            )
    if nested and kind != "d65":
        raise SceneError(f"{kind} cannot hold a spectrum", nested[0].where)
    return make(_Given(kind, given, where), nested)


@dataclass(frozen=True)
class _Given:
    kind: str
    values: dict[str, Value]
    where: str

    def __contains__(self, name: str) -> bool:
        return name in self.values

    def number(
        self,
        name: str,
        default: float | None = None,
        low: float = -math.inf,
        high: float = math.inf,
    ) -> float:
        """A float or integer; required without a default."""
        label = f'{self.kind}: "{name}"'
        if name not in self.values:
            if default is None:
                raise SceneError(f"{label} (float) is missing", self.where)
            return default
        value = self.values[name]
        if value.kind not in ("float", "integer"):
            raise SceneError(f"{label} is of type {value.kind}, expected float", value.where)
        if not low <= value.value <= high:
            raise SceneError(
                f"{label} = {shorten(value.value)} is outside [{low:g}, {high:g}]", value.where
            )
        return float(value.value)

    def numbers(self, name: str) -> tuple[float, ...]:
        """A string of numbers, or an array."""
        label = f'{self.kind}: "{name}"'
        if name not in self.values:
            raise SceneError(f"{label} (string of numbers) is missing", self.where)
        value = self.values[name]
        if value.kind in ("vector", "numbers"):
            return tuple(value.value)
        if value.kind != "string":
            raise SceneError(f"{label} is of type {value.kind}, expected string", value.where)
        tokens = [token for token in re.split(r"[\s,]+", value.value) if token]
        return tuple(parse_float(token, label, value.where) for token in tokens)

    def colour(self, name: str, kinds: tuple[str, ...]) -> RGB:
        label = f'{self.kind}: "{name}"'
        if name not in self.values:
            raise SceneError(f"{label} ({' or '.join(kinds)}) is missing", self.where)
        value = self.values[name]
        if value.kind not in kinds:
            raise SceneError(
                f"{label} is of type {value.kind}, expected {' or '.join(kinds)}", value.where
            )
        single = not isinstance(value.value, tuple)
        colour: RGB = (float(value.value),) * 3 if single else value.value
        return colour


def _even(given: _Given, _: list[Value]) -> Value:
    return Value("float", given.number("value"), given.where)


def _d65(given: _Given, nested: list[Value]) -> Value:
    scale = given.number("scale", 1.0)
    if len(nested) + ("color" in given) > 1:
        raise SceneError("d65 holds more than one colour or spectrum", given.where)
    if nested:  # Mitsuba's rgb variants take what is nested as it is, without scale
        return Value(nested[0].kind, nested[0].value, given.where)
    if "color" not in given:
        return Value("float", scale, given.where)
    colour = given.colour("color", ("rgb", "vector"))
    return Value("rgb", tuple(scale * x for x in colour), given.where)


def _blackbody(given: _Given, _: list[Value]) -> Value:
    temperature = given.number("temperature", None, 1.0, 1e9)
    low, high = _range(given, (LOW, HIGH))
    scale = given.number("scale", 1.0, 0.0, 1e30)
    found = blackbody(temperature, low, high, scale)
    if len(found.values) < 2:
        raise SceneError(f"blackbody: {low:g} to {high:g} nm holds no light", given.where)
    return Value("spectrum", found, given.where)


def _range(given: _Given, default: tuple[float, float] | None = None) -> tuple[float, float]:
    if "range" in given:
        numbers = given.numbers("range")
        if len(numbers) != 2:
            where = given.values["range"].where
            raise SceneError(f'{given.kind}: "range" holds {len(numbers)} numbers, not 2', where)
        low, high = numbers
    else:
        old = "lambda_min" in given or "lambda_max" in given
        names = ("lambda_min", "lambda_max") if old else ("wavelength_min", "wavelength_max")
        ends = default or (None, None)
        low, high = (given.number(n, end) for n, end in zip(names, ends, strict=True))
    if not low < high:
        raise SceneError(f"{given.kind}: {low:g} to {high:g} nm; they must increase", given.where)
    return low, high


def _regular(given: _Given, _: list[Value]) -> Value:
    low, high = _range(given)
    values = given.numbers("values")
    last = max(len(values) - 1, 1)
    steps = tuple(low + i / last * (high - low) for i in range(len(values)))
    return Value("spectrum", listed(steps, values, "regular", given.where), given.where)


def _irregular(given: _Given, _: list[Value]) -> Value:
    lists = given.numbers("wavelengths"), given.numbers("values")
    return Value("spectrum", listed(*lists, "irregular", given.where), given.where)


def _raw(given: _Given, _: list[Value]) -> Value:
    kinds = ("float", "integer", "vector", "point", "rgb")
    return Value("rgb", given.colour("value", kinds), given.where)


def _srgb(given: _Given, _: list[Value]) -> Value:
    colour = given.colour("color", ("rgb", "vector"))
    free = given.values.get("unbounded")
    if free is not None and free.kind != "boolean":
        raise SceneError(f'srgb: "unbounded" is of type {free.kind}, expected boolean', free.where)
    if not (free is not None and free.value) and not all(0 <= x <= 1 for x in colour):
        raise SceneError(f'srgb: "color" = {shorten(colour)} is outside [0, 1]', given.where)
    return Value("rgb", colour, given.where)


_ENDS = ("wavelength_min", "wavelength_max", "lambda_min", "lambda_max")
#: Plugin -> what makes its value, and its parameters.
PLUGINS: dict[str, tuple[Callable[[_Given, list[Value]], Value], tuple[str, ...]]] = {
    "uniform": (_even, ("value", *_ENDS)),
    "d65": (_d65, ("scale", "color")),
    "blackbody": (_blackbody, ("temperature", "scale", *_ENDS)),
    "regular": (_regular, ("values", "range", *_ENDS)),
    "irregular": (_irregular, ("wavelengths", "values")),
    "rawconstant": (_raw, ("value",)),
    "srgb": (_srgb, ("color", "unbounded")),
    "srgb_d65": (_d65, ("scale", "color")),  # of Mitsuba 2
}
