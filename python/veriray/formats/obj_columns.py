"""Wavefront OBJ files a column at a time, some megabytes after another.

Exporters write lines of a few forms. What holds others, and any file with an error, is left to the
reader that goes line by line (`mesh`).
"""

from __future__ import annotations

from typing import Any

import numpy as np
import numpy.typing as npt

Array = npt.NDArray[Any]

_PIECE = 1 << 23  # bytes, about
_SPACE, _TAB, _LINE, _SLASH = b" \t\n/"


def _letters(*classes: bytes) -> Array:
    """For each byte its class, from 0 on; as many as there are for those of none."""
    found = np.full(256, len(classes), np.uint8)
    for k, letters in enumerate(classes):
        found[list(letters)] = k
    return found


_BLANK, _DIGIT, _POINT, _EXPONENT, _SIGN = range(5)
_REAL = _letters(b" \t\n", b"0123456789", b".", b"eE", b"+-")
_WHOLE = _letters(b"0123456789/ \t\n") == 0
#: Classes of _REAL that may follow each.
_NEXT = np.zeros((6, 6), bool)
for _one, _after in {
    _BLANK: (_BLANK, _DIGIT, _POINT, _SIGN), _DIGIT: (_BLANK, _DIGIT, _POINT, _EXPONENT),
    _POINT: (_BLANK, _DIGIT, _EXPONENT), _EXPONENT: (_DIGIT, _SIGN), _SIGN: (_DIGIT, _POINT),
}.items():  # fmt: skip
    _NEXT[_one, _after] = True
#: Kinds of lines: first word, numbers kept.
KINDS = {b"v": 3, b"vt": 2, b"vn": 3}
_OTHER, _FACE = 0, len(KINDS) + 1


def tables(text: bytes) -> tuple[list[Array], Array, Array, Array] | None:
    """The tables of v, vt and vn; corners (C, 3), rows of these or -1; triangles (T, 3) of corners,
    a fan for each face; and the triangles of each face.

    text: with the lines of Unix. None for a file of another form.
    """
    kept: list[list[Array]] = [[] for _ in KINDS]
    corners: list[Array] = []
    sides: list[Array] = []
    before = np.zeros(len(KINDS), np.int64)  # lines of each kind in earlier pieces
    widths: dict[int, int] = {}
    form: tuple[bool, ...] | None = None
    begin = 0
    while begin < len(text):
        end = text.find(b"\n", begin + _PIECE) + 1 or len(text)
        piece = text[begin:end]
        begin = end
        raw = np.frombuffer(piece if piece.endswith(b"\n") else piece + b"\n", np.uint8)
        lengths, kinds = _lines(raw)
        if kinds is None:
            return None
        for k, columns in enumerate(KINDS.values()):
            rows = _table(raw, lengths, kinds == k + 1, k, columns)
            if rows is None:
                return None
            if len(rows) and widths.setdefault(k, rows.shape[1]) != rows.shape[1]:
                return None
            kept[k].append(rows[:, :columns])
        faces = kinds == _FACE
        if faces.any():
            found = _faces(_bytes(raw, lengths, faces), form)
            if found is None:
                return None
            numbers, counts, form = found
            given = np.flatnonzero(form)
            there = [before[k] + np.cumsum(kinds == k + 1)[faces] for k in given]
            most = np.repeat(np.stack(there, axis=1), counts, axis=0)
            if ((numbers < 1) | (numbers > most)).any():
                return None
            rows = np.full((len(numbers), len(KINDS)), -1, np.int64)
            rows[:, given] = numbers - 1
            corners.append(rows)
            sides.append(counts)
        before += [len(part[-1]) for part in kept]
    every = np.concatenate([np.zeros(0, np.int64), *sides])
    return (
        [
            np.concatenate([np.zeros((0, n)), *(rows for rows in part if len(rows))])
            for part, n in zip(kept, KINDS.values(), strict=True)
        ],
        np.concatenate([np.zeros((0, len(KINDS)), np.int64), *corners]),
        _fans(every),
        every - 2,
    )


def _lines(raw: Array) -> tuple[Array, Array | None]:
    """Bytes of each line, and its kind: 0 for one without v or f, then KINDS, then faces.

    None where a line may be of another form.
    """
    ends = np.flatnonzero(raw == _LINE) + 1
    starts = np.concatenate([[0], ends[:-1]])
    padded = np.concatenate([raw, [_LINE, _LINE]])
    first, second, third = (padded[starts + k] for k in range(3))
    v, f = first == ord("v"), first == ord("f")
    kinds = np.full(len(starts), _OTHER, np.int8)
    kinds[v & (second == _SPACE)] = 1
    for k, letter in ((2, "t"), (3, "n")):
        kinds[v & (second == ord(letter)) & (third == _SPACE)] = k
    kinds[f & (second == _SPACE)] = _FACE
    unknown = (v | f) & (kinds == _OTHER)
    indented = (first == _TAB) | (first == _SPACE) | (first == 11) | (first == 12) | (first == 13)
    return ends - starts, None if unknown.any() or indented.any() else kinds


def _bytes(raw: Array, lengths: Array, chosen: Array) -> Array:
    """The bytes of the lines that are chosen."""
    lines: Array = raw[np.repeat(chosen, lengths)]
    return lines


def _words(lines: Array, first: int) -> tuple[Array, Array]:
    """Blanks the first words of lines, of so many letters; where words begin, and their numbers."""
    starts = np.concatenate([[0], np.flatnonzero(lines == _LINE)[:-1] + 1])
    for k in range(first):
        lines[starts + k] = _SPACE
    blank = (lines == _SPACE) | (lines == _TAB) | (lines == _LINE)
    begins = np.flatnonzero(blank[:-1] & ~blank[1:]) + 1
    return begins, np.diff(np.searchsorted(begins, [*starts, len(lines)]))


def _table(raw: Array, lengths: Array, chosen: Array, kind: int, least: int) -> Array | None:
    """The numbers (N, columns) of the lines that are chosen, all of equally many."""
    if not chosen.any():
        return np.zeros((0, 0))
    lines = _bytes(raw, lengths, chosen)
    begins, counts = _words(lines, 1 if kind == 0 else 2)
    if counts[0] < least or (counts != counts[0]).any() or not _are_numbers(lines, begins):
        return None
    return _parsed(lines, np.float64, len(counts), int(counts[0]))


def _are_numbers(lines: Array, begins: Array) -> bool:
    """Whether each word is a decimal number."""
    kinds = _REAL[lines]
    if not _NEXT[kinds[:-1], kinds[1:]].all():
        return False
    points = np.flatnonzero(kinds == _POINT)
    if ((kinds[points - 1] != _DIGIT) & (kinds[points + 1] != _DIGIT)).any():
        return False
    # one point and one exponent at most, in this order
    marks = np.flatnonzero((kinds == _POINT) | (kinds == _EXPONENT))
    together = np.diff(np.searchsorted(begins, marks, "right")) == 0
    first, second = kinds[marks[:-1]][together], kinds[marks[1:]][together]
    return bool(((first == _POINT) & (second == _EXPONENT)).all())


def _parsed(lines: Array, dtype: Any, rows: int, columns: int) -> Array | None:
    """Numbers between blanks; None unless there are as many as expected."""
    numbers = np.fromstring(lines.tobytes(), dtype, sep=" ")
    return numbers.reshape(rows, columns) if len(numbers) == rows * columns else None


def _faces(
    lines: Array, form: tuple[bool, ...] | None
) -> tuple[Array, Array, tuple[bool, ...]] | None:
    """Numbers (corners, given) of faces, the corners of each face, and which numbers are given.

    form: of earlier faces.
    """
    begins, counts = _words(lines, 1)
    if (counts < 3).any() or not _WHOLE[lines].all():
        return None
    if form is None:
        word = lines[begins[0] :][:64].tobytes().split(None, 1)[0]
        form = tuple(map(bool, word.split(b"/")))
    slash = lines == _SLASH
    blank = ~slash & (lines <= _SPACE)
    pairs = np.count_nonzero(slash[:-1] & slash[1:])
    loose = (slash[:-1] & blank[1:]) | (blank[:-1] & slash[1:])
    slashes = np.diff(np.searchsorted(np.flatnonzero(slash), [*begins, len(lines)]))
    if (
        form not in ((True,), (True, True), (True, False, True), (True, True, True))
        or (slashes != len(form) - 1).any()
        or pairs != (len(begins) if form == (True, False, True) else 0)
        or loose.any()
    ):
        return None
    lines[slash] = _SPACE
    numbers = _parsed(lines, np.int64, len(begins), sum(form))
    return None if numbers is None else (numbers, counts, form)


def _fans(sides: Array) -> Array:
    """Triangles (T, 3) of consecutive corners of faces with so many sides: a fan for each."""
    parts, first = sides - 2, np.cumsum(sides) - sides
    of = np.repeat(np.arange(len(sides)), parts)
    k = np.arange(len(of)) - np.repeat(np.cumsum(parts) - parts, parts)
    triangles: Array = first[of][:, None] + np.stack([np.zeros_like(k), k + 1, k + 2], axis=1)
    return triangles
