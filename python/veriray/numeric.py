"""Checks of numbers and arrays, and exact trigonometry, for scene, camera and formats."""

from __future__ import annotations

import math
import os
from collections.abc import Sequence
from dataclasses import dataclass
from decimal import Decimal, localcontext
from functools import lru_cache
from typing import Any

import numpy as np
import numpy.typing as npt

from .chunks import in_chunks
from .errors import SceneError

Array = npt.NDArray[Any]

MAX_COORDINATE = 1e100  # squares and triple products stay finite in float64
#: Rows from which on arrays whose numbers are all alike are kept as one number.
REPEATED = 1 << 12
_PI = Decimal("3.14159265358979323846264338327950288419716939937510582097494")


@lru_cache(maxsize=256)
def sin_cos_degrees(angle: float) -> tuple[float, float]:
    """Sine and cosine of an angle in degrees, from 50-digit arithmetic: the same on every machine.

    Exact at multiples of 90 degrees.
    """
    with localcontext() as context:
        context.prec = 50
        degrees = Decimal(math.fmod(angle, 360.0))
        quarter = int((degrees / 90).to_integral_value())
        x = (degrees - 90 * quarter) * _PI / 180  # |x| <= pi/4
        term, sine, cosine = Decimal(1), Decimal(0), Decimal(1)
        for n in range(1, 50, 2):
            term = term * x / n
            sine += term
            term = -term * x / (n + 1)
            cosine += term
        pairs = ((sine, cosine), (cosine, -sine), (-sine, -cosine), (-cosine, sine))
        s, c = pairs[quarter % 4]
        return float(s), float(c)


def tan_half_degrees(angle: float) -> float:
    """tan(angle / 2) for an angle in degrees."""
    sine, cosine = sin_cos_degrees(0.5 * angle)
    return sine / cosine


def view_angle(extent: float, distance: float) -> float:
    """Angle in degrees of `extent` seen from `distance`: 2 atan(extent / (2 distance)).

    Rounded to 12 decimals, because atan differs in the last bit between C libraries.
    """
    return round(math.degrees(2.0 * math.atan(extent / (2.0 * distance))), 12)


def finite(name: str, value: Array, where: str = "") -> None:
    """Raises SceneError with the index of the first NaN or infinity in `value`."""
    good = np.isfinite(value)
    if not good.all():
        index, place = _first(~good)
        raise SceneError(f"{name}{place} is {value[index]}; it must be finite", where)


def _first(bad: Array) -> tuple[tuple[int, ...], str]:
    """Index of the first True, also as "[i][j]"."""
    index = tuple(int(i) for i in np.unravel_index(int(np.argmax(bad)), bad.shape))
    return index, "".join(f"[{i}]" for i in index)


@dataclass(frozen=True)
class Fresh:
    """An array of finite numbers that nobody else holds, and its least and greatest number.

    It has no -0, and is kept, not copied.
    """

    values: Array
    extremes: tuple[float, float]


def fresh(values: Array) -> Fresh | None:
    """An array that nobody else holds, once its -0 are 0; None if it cannot be changed, or holds a
    number that is not finite."""
    if not values.flags.writeable or not values.flags.c_contiguous:
        return None

    def settle(first: int, last: int) -> tuple[Any, Any]:
        part = values[first:last]
        if values.dtype.kind == "f":
            part += values.dtype.type(0)
        return part.min(), part.max()  # NaN if there is one

    lows, highs = zip(*in_chunks(settle, len(values)), strict=True)
    low, high = float(np.min(lows)), float(np.max(highs))
    return Fresh(values, (low, high)) if -math.inf < low <= high < math.inf else None


def repeated(value: Any, shape: tuple[int, ...], dtype: Any) -> Array:
    """A read-only array of `value` everywhere; one of REPEATED rows and more takes the memory of
    one number, and is not contiguous."""
    number = np.asarray(value, dtype)
    if shape and shape[0] >= REPEATED:
        return np.broadcast_to(number, shape)
    result: Array = np.full(shape, number, dtype)
    result.setflags(write=False)
    return result


def restore(owner: Any, state: dict[str, Any]) -> None:
    """Gives an object its pickled or deeply copied state; NumPy made the arrays writeable."""
    for value in state.values():
        if isinstance(value, np.ndarray):
            value.setflags(write=False)
    owner.__dict__.update(state)


def distinct(values: Array) -> Array:
    """The first row alone of an array that `repeated` made of some rows, else the array."""
    return values[:1] if values.ndim and len(values) and not any(values.strides) else values


def array(name: str, value: Any, dtype: Any, shape: tuple[int | None, ...]) -> Array:
    """A read-only C-contiguous copy of `value`, or what `repeated` makes of one whose numbers share
    their memory; None in `shape` stands for any length."""
    own = isinstance(value, Fresh)
    if isinstance(value, Fresh):
        value = value.values
    try:
        given = np.asarray(value)
        if given.dtype.kind not in "iufb" and given.size:
            raise TypeError(f"dtype {given.dtype}")
        if not given.size and None in shape:
            given = given.reshape(tuple(n or 0 for n in shape))
    except Exception as error:  # of any object's own conversion
        raise SceneError(f"{name} cannot be read as numbers: {error}") from None
    if given.ndim != len(shape) or any(
        n is not None and n != m for n, m in zip(shape, given.shape, strict=True)
    ):
        expected = ", ".join("n" if n is None else str(n) for n in shape)
        raise SceneError(f"{name} has shape {given.shape}, expected ({expected})")
    kind = np.dtype(dtype).kind
    result: Array
    if own and given.dtype == np.dtype(dtype) and given.flags.c_contiguous:
        given.setflags(write=False)
        return given
    if len(shape) and given.size and len(given) > 1 and not any(given.strides):
        one = array(name, given[:1], dtype, (None, *shape[1:]))
        return repeated(one.flat[0], given.shape, dtype)
    if kind == "f":
        if given.size:
            finite(name, given)
        with np.errstate(over="ignore"):
            result = np.array(given, dtype=dtype, order="C")
        if result.dtype != given.dtype:
            finite(f"{name} (as {result.dtype})", result)
        result += result.dtype.type(0)  # no -0
    else:
        if kind in "iu" and given.size:
            if given.dtype.kind not in "iu":
                raise SceneError(f"{name} has dtype {given.dtype}, expected integers")
            info = np.iinfo(dtype)
            if int(given.min()) < info.min or int(given.max()) > info.max:
                value = int(given.min()) if int(given.min()) < info.min else int(given.max())
                raise SceneError(f"{name} holds {value}, outside [{info.min}, {info.max}]")
        result = np.array(given, dtype=dtype, order="C")
    result.setflags(write=False)
    return result


def in_range(
    name: str, values: Array, low: float, high: float, note: str = "", *, open_: bool = False
) -> None:
    """Raises SceneError with the first entry outside [low, high], or (low, high) when `open_`."""
    if not values.size:
        return
    values = distinct(values)
    with np.errstate(invalid="ignore"):
        least, most = values.min(), values.max()
        if least > low and most < high if open_ else least >= low and most <= high:
            return
        good = (values > low) & (values < high) if open_ else (values >= low) & (values <= high)
    if not good.all():
        index, place = _first(~good)
        limits = f"({low:g}, {high:g})" if open_ else f"[{low:g}, {high:g}]"
        raise SceneError(f"{name}{place} = {values[index]} is outside {limits}{note}")


def shown(value: object, most: int = 80) -> str:
    """repr(value) for a message: cut if long; works for every object."""
    try:
        text = repr(value)
    except Exception:  # of the object's own, or of an integer of thousands of digits
        text = f"<{type(value).__name__}>"
    return text if len(text) <= most else f"{text[: most - 10]}...({len(text)} characters)"


def number(name: str, value: Any, low: float, high: float, *, open_: bool = False,
           error: type[ValueError] = SceneError) -> float:  # fmt: skip
    """float(value), inside [low, high], or inside (low, high) when `open_`."""
    if isinstance(value, bool) or not isinstance(value, (int, float, np.integer, np.floating)):
        raise error(f"{name} = {shown(value)} is not a number")
    if not (low < value < high if open_ else low <= value <= high):
        text = shown(value) if isinstance(value, int) else f"{value:g}"
        brackets = "()" if open_ else "[]"
        raise error(f"{name} = {text} is outside {brackets[0]}{low:g}, {high:g}{brackets[1]}")
    try:
        return float(value) + 0.0
    except OverflowError:  # of an integer below infinity
        raise error(f"{name} = {shown(value)} exceeds the float64 range") from None


def whole(name: str, value: Any, low: int, high: int, *,
          error: type[ValueError] = SceneError) -> int:  # fmt: skip
    """int(value) for an integer in [low, high]."""
    if isinstance(value, bool) or not isinstance(value, (int, np.integer)):
        raise error(f"{name} = {shown(value)} is not an integer")
    if not low <= int(value) <= high:
        raise error(f"{name} = {shown(int(value))} is outside [{low}, {high}]")
    return int(value)


def choice(name: str, value: Any, names: Sequence[str], *,
           error: type[ValueError] = SceneError) -> str:  # fmt: skip
    """`value`, if it is one of `names`."""
    if not isinstance(value, str) or value not in names:
        raise error(f"{name} = {shown(value)} is unknown; allowed: {', '.join(names)}")
    return value


def switch(name: str, value: Any, *, error: type[ValueError] = SceneError) -> bool:
    """bool(value) for a bool or an integer."""
    if not isinstance(value, (bool, int, np.bool_)):
        raise error(f"{name} = {shown(value)} is not a bool")
    return bool(value)


def texts(name: str, value: Any, error: type[ValueError] = SceneError) -> tuple[str, ...]:
    """A list, tuple or array of strings."""
    several = isinstance(value, (list, tuple)) or isinstance(value, np.ndarray) and value.ndim
    if several and all(isinstance(x, str) for x in value):
        return tuple(value)
    raise error(f"{name} = {shown(value)} is not a list of strings")


def path_text(name: str, value: Any, error: type[ValueError] = SceneError) -> str:
    """A path as text. Raises TypeError if it is not a path, `error` for characters that none
    has."""
    try:
        text = os.fspath(value)
    except Exception:
        text = None
    if not isinstance(text, str):
        raise TypeError(f"{name} is {type(value).__name__}, expected str or os.PathLike")
    if "\0" in text:
        raise error(f"{name}: cannot read {shown(text)}: it holds a null character")
    try:
        os.fsencode(text)
    except UnicodeEncodeError:
        text = shown(text.encode("utf-8", "backslashreplace").decode())
        raise error(f"{name}: cannot read {text}: it holds a lone surrogate") from None
    return text


def determinant(matrix: Array) -> float:
    """Determinant of the upper left 3x3 block, in a fixed order of operations."""
    result: float = _determinant(matrix[:3, :3].tolist())
    return result


def mirrors(matrices: Array) -> Array:
    """Whether the determinants of matrices (N, 4, 4) are below 0."""
    with np.errstate(all="ignore"):
        below: Array = _determinant(matrices[:, :3, :3].transpose(1, 2, 0)) < 0
    return below


def _determinant(rows: Any) -> Any:
    (a, b, c), (d, e, f), (g, h, i) = rows
    return a * (e * i - f * h) - b * (d * i - f * g) + c * (d * h - e * g)


def check_matrix(name: str, value: Any) -> Array:
    """A finite, affine, invertible 4x4 float64 matrix.

    Singular: |det| of the 3x3 block at most 1e-12 of the product of its column lengths.
    """
    matrix = array(name, value, np.float64, (4, 4))
    if matrix[3].tolist() != [0.0, 0.0, 0.0, 1.0]:
        raise SceneError(f"{name} has the last row {matrix[3].tolist()}, expected [0, 0, 0, 1]")
    rows = matrix[:3].tolist()  # numbers of Python: they are few
    if max(max(map(abs, row)) for row in rows) > MAX_COORDINATE:
        raise SceneError(f"{name} holds a number above {MAX_COORDINATE:g}")
    lengths = [math.hypot(*column) for column in zip(*(row[:3] for row in rows), strict=True)]
    if min(lengths) > 0:
        units = [[x / length for x, length in zip(row, lengths, strict=False)] for row in rows]
        if abs(_determinant(units)) > 1e-12:
            return matrix
    raise SceneError(f"{name} is singular: it flattens space (columns of length {lengths})")


def check_rotation(name: str, matrix: Array) -> None:
    """Raises SceneError if the upper left 3x3 block is not a rotation (to 1e-3)."""
    block = matrix[:3, :3]
    square = (block[:, None] * block[None]).sum(axis=2)
    if np.abs(square - np.eye(3)).max() > 1e-3 or determinant(matrix) < 0:
        raise SceneError(
            f"{name} = {block.tolist()} is not a rotation: it scales, shears or mirrors "
            f"(determinant {determinant(matrix):g}, expected 1)"
        )


def check_rigid(name: str, what: str, matrix: Array) -> None:
    """Raises SceneError if a column of the matrix's 3x3 block is not of unit length (to 1e-3)."""
    for squared in (matrix[:3, :3] ** 2).sum(axis=0).tolist():
        if abs(squared - 1.0) > 1e-3:
            raise SceneError(
                f"{name} scales by {math.sqrt(squared):g}; {what} may only be "
                "rotated, mirrored and moved"
            )
