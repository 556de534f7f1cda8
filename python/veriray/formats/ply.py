"""Stanford PLY files: ASCII, and binary in both byte orders."""

from __future__ import annotations

import contextlib
import re
from collections.abc import Iterator
from dataclasses import dataclass, field
from itertools import chain, groupby
from typing import Any

import numpy as np
import numpy.typing as npt

from . import polygons
from .node import quoted

Array = npt.NDArray[Any]
_TYPES = {
    "char": "i1", "uchar": "u1", "short": "i2", "ushort": "u2", "int": "i4", "uint": "u4",
    "float": "f4", "double": "f8", "int8": "i1", "uint8": "u1", "int16": "i2", "uint16": "u2",
    "int32": "i4", "uint32": "u4", "float32": "f4", "float64": "f8",
}  # fmt: skip
UV = (("u", "v"), ("s", "t"), ("texture_u", "texture_v"))  # as Mitsuba
_ASIDE: tuple[list[str], ...] = (
    [],
    ["comment"],
    ["obj_info"],
)  # first words of lines that say nothing
INDICES = ("vertex_indices", "vertex_index")
_COLOUR = (("r", "g", "b"), ("red", "green", "blue"))
#: Ends of the names of an attribute's numbers.
_ENDS = [list(ends) for ends in ("xyz", "rgb", "012", "123", "x", "r", "0", "1")]
_MAX_WORD = 1000  # characters of a number


class MeshFileError(Exception):
    """What is wrong with a mesh file: the end of a sentence that begins with the file's name."""


@dataclass
class Element:
    """An element of the header."""

    name: str
    rows: int
    #: name -> (type of a list's length, or "" for a number; type)
    properties: dict[str, tuple[str, str]] = field(default_factory=dict)


def read(
    data: bytes, *, attributes: bool = False
) -> tuple[Array, Array, Array | None, Array | None, dict[str, Array]]:
    """Vertices (V, 3) float64, triangles (T, 3) int64; vertex normals (V, 3) and texture
    coordinates (V, 2), or None; if wanted, the other numbers by Mitsuba's names: (V or T, 1 or 3).

    Raises MeshFileError for anything but a header with vertex x, y, z and face vertex_indices (or
    vertex_index) and exactly the data that it states.
    """
    found = elements(data)
    vertex, face = found.get("vertex", {}), found.get("face", {})
    vertices, normals = _columns(vertex, "x", "y", "z"), _columns(vertex, "nx", "ny", "nz")
    if vertices is None:
        raise MeshFileError(": the vertices have no x, y and z")
    name = next((name for name in INDICES if name in face), None)
    if "face" in found and name is None:
        raise MeshFileError(": the faces have no list vertex_indices")
    uv = next((uv for names in UV if (uv := _columns(vertex, *names)) is not None), None)
    lists = face[name] if name else []
    fans, parts = _fans(lists)
    triangles, more = polygons.unfolded(vertices, fans, parts), {}
    bands = found.get("tristrips", {})
    strips: Any = next((bands[name] for name in INDICES if name in bands), [])
    if len(strips):
        triangles = np.concatenate([triangles, *map(_strip, strips)])
        face = {}  # its attributes are those of its own triangles
    if attributes:
        more = {f"vertex_{key}": values for key, values in _attributes(vertex).items()}
        for key, values in _attributes(face).items():
            more[f"face_{key}"] = np.repeat(values, parts, axis=0)
    return vertices, triangles, normals, uv, more


def elements(data: bytes) -> dict[str, dict[str, Any]]:
    """What a file holds: elements by name, of columns by name.

    Raises MeshFileError for anything but a header and exactly the data that it states.
    """
    rows_of, order, body = header(data)
    rows = sum(element.rows for element in rows_of)
    if order == "":
        head = data[: len(data) - len(body)]
        content: Any = _Text(body, rows, head.count(b"\n") + 1)
    elif rows > len(body):
        raise MeshFileError(f" is damaged: {rows} elements in {len(body)} bytes")
    else:
        content = _Binary(body, order)
    found = {element.name: content.element(element) for element in rows_of}
    content.end()
    return found


def _attributes(element: dict[str, Any]) -> dict[str, Array]:
    """Attributes of an element (rows, 1 or 3): r, g and b are "color", and of others those that
    stand side by side belong together if they differ after the last underscore alone."""
    found: dict[str, Array] = {}
    colour = next((c for names in _COLOUR if (c := _columns(element, *names)) is not None), None)
    if colour is not None:
        found["color"] = colour
    names = [name for name in element if "_" in name]
    for prefix, part in groupby(names, lambda name: name.rpartition("_")[0]):
        group = list(part)
        ends = [name.rpartition("_")[2] for name in group]
        if prefix and ends in _ENDS:
            key = f"{prefix}_color" if ends[0] == "r" else prefix
            values = _columns(element, *group)
            if values is not None:
                found.setdefault(key, values)
    return found


def _columns(vertex: dict[str, Any], *names: str) -> Array | None:
    """Numbers of the vertices (V, names) float64; None if one is not there, or a list."""
    columns: list[Any] = [vertex.get(name) for name in names]
    if not all(isinstance(column, np.ndarray) and column.ndim == 1 for column in columns):
        return None
    return np.stack(columns, axis=1).astype(np.float64)


def header(data: bytes) -> tuple[list[Element], str, bytes]:
    """The elements, the byte order ("" for text, "<", ">") and what follows the header."""
    end = re.search(rb"^end_header[ \t]*\r?\n|^end_header\Z", data[: 2**16], re.MULTILINE)
    lines = data[: end.start()].decode("latin-1").splitlines() if end else []
    if not end or len(lines) < 2 or lines[0].strip() != "ply":
        raise MeshFileError(' is not PLY: no header "ply" ... "end_header"')
    known = (number for number, line in enumerate(lines[1:], 2) if line.split()[:1] not in _ASIDE)
    second = next(known, 2)  # notes may stand before the format
    form = re.fullmatch(
        r"format (ascii|binary_(little|big)_endian) 1\.0", lines[second - 1].strip()
    )
    if not form:
        raise MeshFileError(f": header line {second} states no known format; expected ascii 1.0, "
                            "binary_little_endian 1.0 or binary_big_endian 1.0")  # fmt: skip
    elements: list[Element] = []
    for number, line in enumerate(lines[second:], second + 1):
        tokens = line.split()
        match tokens:
            case [] | ["comment" | "obj_info", *_]:
                continue
            case _ if max(map(len, tokens)) > 80:  # messages quote names
                pass
            case ["element", name, count] if re.fullmatch("[0-9]{1,10}", count):
                if all(name != element.name for element in elements):
                    elements.append(Element(name, int(count)))
                    continue
            case ["property", kind, name] if elements and kind in _TYPES:
                elements[-1].properties[name] = "", _TYPES[kind]
                continue
            case ["property", "list", length, kind, name] if elements:
                if _TYPES.get(length, "f")[0] in "iu" and kind in _TYPES:
                    elements[-1].properties[name] = _TYPES[length], _TYPES[kind]
                    continue
        raise MeshFileError(f": bad header line {number}")
    return elements, {None: "", "little": "<", "big": ">"}[form[2]], data[end.end() :]


class _Binary:
    def __init__(self, body: bytes, order: str) -> None:
        self.body, self.order, self.at = body, order, 0

    def element(self, element: Element) -> dict[str, Any]:
        """Columns of an element: arrays; lists as an array (rows, length) or a list of arrays."""
        lengths = self.lengths(element) if element.rows else {}
        fields: list[Any] = []
        for name, (length, kind) in element.properties.items():
            if length:
                fields += [
                    (f"#{name}", self.order + length),
                    (name, self.order + kind, (lengths.get(name, 0),)),
                ]
            else:
                fields.append((name, self.order + kind))
        dtype = np.dtype(fields)
        end = self.at + element.rows * dtype.itemsize
        if end <= len(self.body):
            table = np.frombuffer(self.body, dtype, element.rows, self.at)
            if all((table[f"#{name}"] == n).all() for name, n in lengths.items()):
                self.at = end
                return {name: table[name] for name in element.properties}
        if not lengths:
            raise MeshFileError(f" is damaged: it ends within {element.rows} x {element.name}")
        return self.ragged(element)

    def lengths(self, element: Element) -> dict[str, int]:
        """Lengths of the lists in the element's first row."""
        start, result = self.at, {}
        for name, (length, kind) in element.properties.items():
            if length:
                result[name] = int(self.take(length, 1)[0])
                self.take(kind, result[name])
            else:
                self.take(kind, 1)
        self.at = start
        return result

    def ragged(self, element: Element) -> dict[str, Any]:
        columns: dict[str, list[Any]] = {name: [] for name in element.properties}
        for _ in range(element.rows):
            for name, (length, kind) in element.properties.items():
                count = int(self.take(length, 1)[0]) if length else 1
                values = self.take(kind, count)
                columns[name].append(values if length else values[0])
        return {
            name: columns[name] if length else np.array(columns[name])
            for name, (length, _) in element.properties.items()
        }

    def take(self, kind: str, count: int) -> Array:
        dtype = np.dtype(self.order + kind)
        start = self.at
        self.at += dtype.itemsize * count
        if count < 0 or self.at > len(self.body):
            raise MeshFileError(" is damaged: it ends within its data")
        return np.frombuffer(self.body, dtype, count, start)

    def end(self) -> None:
        if self.at != len(self.body):
            raise MeshFileError(f" is damaged: {len(self.body) - self.at} bytes follow its data")


class _Text:
    """first: number in the file of the body's first line."""

    def __init__(self, body: bytes, rows: int, first: int) -> None:
        body = body.rstrip()
        found = body.count(b"\n") + 1 if body else 0
        if found > rows:  # empty lines between those of data
            body = re.sub(rb"\n\s*\n", b"\n", body.lstrip())
            found = body.count(b"\n") + 1
        if found != rows:
            raise MeshFileError(f" is damaged: {found} lines of data, {rows} expected")
        self.lines = body.split(b"\n") if body else []
        self.first, self.at = first, 0

    def element(self, element: Element) -> dict[str, Any]:
        """As _Binary's."""
        lines, first = self.lines[self.at : self.at + element.rows], self.first + self.at
        self.at += element.rows
        values = _numbers(lines, first, element.name)
        width = len(values) // max(element.rows, 1)
        if width * element.rows == len(values):
            table = values.reshape(element.rows, width)
            columns = self.columns(element, table)
            if columns is not None:
                return columns
        rows = [self.row(element, line, number) for number, line in enumerate(lines, first)]
        return {
            name: [row[name] for row in rows] if length else np.array([row[name] for row in rows])
            for name, (length, _) in element.properties.items()
        }

    def columns(self, element: Element, table: Array) -> dict[str, Any] | None:
        """The columns if all lists of a name have one length."""
        result, at = {}, 0
        for name, (length, _) in element.properties.items():
            count = 1
            if length:
                if not len(table) or at >= table.shape[1] or (table[:, at] != table[0, at]).any():
                    return None
                if not 0 <= table[0, at] <= table.shape[1] or table[0, at] % 1:
                    return None
                count, at = int(table[0, at]), at + 1
            if at + count > table.shape[1]:
                return None
            result[name] = table[:, at : at + count] if length else table[:, at]
            at += count
        return result if at == table.shape[1] else None

    def row(self, element: Element, line: bytes, number: int) -> dict[str, Any]:
        columns = self.columns(element, _numbers([line], number, element.name)[None])
        if columns is None:
            raise MeshFileError(f" is damaged: line {number} is no element {element.name}")
        return {name: values[0] for name, values in columns.items()}

    def end(self) -> None:
        pass


def _numbers(lines: list[bytes], first: int, what: str) -> Array:
    """All numbers of the lines; `first` is the first line's number in the file."""
    if max(map(len, lines), default=0) <= _MAX_WORD:
        with contextlib.suppress(ValueError):
            return np.fromiter(map(float, chain.from_iterable(map(bytes.split, lines))), np.float64)
    return np.fromiter(_checked(lines, first, what), np.float64)


def _checked(lines: list[bytes], first: int, what: str) -> Iterator[float]:
    """As `_numbers`, slowly; raises MeshFileError at the first word that is none."""
    for number, line in enumerate(lines, first):
        for word in line.split():
            try:
                if len(word) > _MAX_WORD:
                    raise ValueError
                yield float(word)
            except ValueError:
                raise MeshFileError(
                    f", line {number}: {quoted(word)} among the elements {what} is not a number of "
                    f"at most {_MAX_WORD} characters"
                ) from None


def _strip(corners: Array) -> Array:
    """Triangles (T, 3) int64 of strips of corners, each of which -1 ends."""
    row = np.asarray(corners)
    with np.errstate(invalid="ignore"):
        whole = row.astype(np.int64)
    if (whole != row).any():
        raise MeshFileError(": a triangle strip is not of integers")
    at = np.arange(len(whole))
    ends = np.maximum.accumulate(np.where(whole == -1, at, -1))
    odd = ((at - ends) % 2 == 0)[:-2]  # a strip's second triangle runs the other way
    a, b, c = whole[:-2], whole[1:-1], whole[2:]
    triangles = np.stack([np.where(odd, b, a), np.where(odd, a, b), c], axis=1)
    kept: Array = triangles[(triangles != -1).all(axis=1)]
    return kept


def _fans(lists: Any) -> tuple[Array, Array]:
    """Triangles (T, 3) int64 of polygons with 3 or 4 corners, in the polygons' order, and how many
    each has."""
    if isinstance(lists, list):
        lengths = np.array([len(row) for row in lists], np.int64)
    else:
        lengths = np.full(len(lists), lists.shape[1])
    if len(lengths) and (lengths.min() < 3 or lengths.max() > 4):
        bad = int(np.argmax((lengths < 3) | (lengths > 4)))
        raise MeshFileError(f": face {bad} has {lengths[bad]} vertices, expected 3 or 4")
    corners = np.zeros((len(lengths), 4))
    for count in (3, 4):
        rows = np.flatnonzero(lengths == count)
        if len(rows):
            chosen = lists if isinstance(lists, np.ndarray) else np.stack([lists[i] for i in rows])
            corners[rows, :count] = chosen
    with np.errstate(invalid="ignore"):
        whole = corners.astype(np.int64)
    bad = (whole != corners).any(axis=1)
    if bad.any():
        raise MeshFileError(f": face {int(np.argmax(bad))} is not of integers")
    fans = np.stack([whole[:, [0, 1, 2]], whole[:, [0, 2, 3]]], axis=1).reshape(-1, 3)
    keep = np.stack([lengths >= 3, lengths == 4], axis=1).reshape(-1)
    return fans[keep], lengths - 2
