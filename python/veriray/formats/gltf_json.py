"""glTF 2.0 files: the JSON part with typed access, buffers, and accessors as arrays.

What is missing, of the wrong type or out of range is a SceneError that names the place in the JSON,
as "meshes[3].primitives[0]". Limits: 512 MiB a file, and MAX_COUNT rows that no buffer holds.
"""

from __future__ import annotations

import base64
import binascii
import json
import struct
from pathlib import Path
from typing import Any
from urllib.parse import unquote

import numpy as np
import numpy.typing as npt

from ..errors import SceneError
from .node import read_bytes, shorten

Array = npt.NDArray[Any]
MAX_BYTES = 512 * 2**20
MAX_COUNT = 2**20
_COMPONENTS = {5120: "i1", 5121: "u1", 5122: "i2", 5123: "u2", 5125: "u4", 5126: "f4"}
_WIDTHS = {"SCALAR": 1, "VEC2": 2, "VEC3": 3, "VEC4": 4}


class Json:
    """An object of the file, and where it is."""

    def __init__(self, content: Any, where: str) -> None:
        if not isinstance(content, dict):
            raise SceneError(f"{shorten(content)} is not an object", where)
        self.content, self.where = content, where

    def fail(self, text: str) -> SceneError:
        """An error about this object."""
        return SceneError(text, self.where.removesuffix(": "))

    def of(self, key: str) -> Json:
        """The object in `key`; an empty one if there is none."""
        return Json(self.content.get(key, {}), self._place(key))

    def all(self, key: str) -> list[Json]:
        """The list of objects in `key`."""
        return [Json(row, f"{self._place(key)}[{k}]") for k, row in enumerate(self.rows(key))]

    def _place(self, key: str) -> str:
        return f"{self.where}{key}" if self.where.endswith(": ") else f"{self.where}.{key}"

    def rows(self, key: str) -> list[Any]:
        """The list in `key`; an empty one if there is none."""
        found = self.content.get(key, [])
        if not isinstance(found, list):
            raise self.fail(f'"{key}" = {shorten(found)} is not a list')
        return found

    def text(self, key: str, default: str = "") -> str:
        """The string in `key`."""
        found = self.content.get(key, default)
        if not isinstance(found, str):
            raise self.fail(f'"{key}" = {shorten(found)} is not a string')
        return found

    def flag(self, key: str, default: bool = False) -> bool:
        """The boolean in `key`; `default` if there is none."""
        found = self.content.get(key, default)
        if not isinstance(found, bool):
            raise self.fail(f'"{key}" = {shorten(found)} is not true or false')
        return found

    def whole(self, key: str, default: int | None, high: int, low: int = 0) -> int | None:
        """The integer in `key`, within [low, high]; `default` if there is none."""
        if key not in self.content:
            return default
        found = self.content[key]
        if isinstance(found, float) and found.is_integer():
            found = int(found)
        if isinstance(found, bool) or not isinstance(found, int) or not low <= found <= high:
            raise self.fail(f'"{key}" = {shorten(found)} is not an integer in [{low}, {high}]')
        return found

    def index(self, key: str, of: list[Any]) -> int | None:
        """A row of a list that `key` names."""
        return self.whole(key, None, len(of) - 1)

    def needed(self, key: str, high: int) -> int:
        """The integer in `key`, which must be there."""
        found = self.whole(key, None, high)
        if found is None:
            raise self.fail(f'"{key}" is missing')
        return found

    def number(self, key: str, default: float, low: float = -1e30, high: float = 1e30) -> float:
        """The number in `key`, within [low, high]."""
        return float(self.numbers(key, (default,), low, high, one=True)[0])

    def numbers(
        self,
        key: str,
        default: tuple[float, ...],
        low: float = -1e30,
        high: float = 1e30,
        *,
        one: bool = False,
    ) -> Array:
        """The numbers in `key`, as many as in `default`, each within [low, high]."""
        found = self.content.get(key)
        row = default if found is None else [found] if one else found
        good = isinstance(row, (list, tuple)) and len(row) == len(default)
        if not good or not all(type(x) in (int, float) and low <= x <= high for x in row):
            many = "a number" if one else f"{len(default)} numbers"
            raise self.fail(f'"{key}" = {shorten(found)} is not {many} in [{low:g}, {high:g}]')
        return np.array(row, np.float64)


def read(path: Path) -> File:
    """Reads a file of either form. Raises SceneError."""
    where = str(path)
    data, chunk = read_bytes(path, MAX_BYTES, ""), b""
    if data[:4] == b"glTF":
        data, chunk = _chunks(data, where)
    try:
        content = json.loads(data.decode("utf-8-sig"), parse_constant=_no_constant)
    except (ValueError, RecursionError) as error:
        text = "nested too deeply" if isinstance(error, RecursionError) else str(error)[:200]
        raise SceneError(f"not glTF: {text}", where) from None
    root = Json(content, f"{where}: ")
    version = root.of("asset").text("version")
    if not version.startswith("2."):
        raise SceneError(f'asset.version = {shorten(version)}, expected "2.0"', where)
    return File(root, path.parent, chunk)


def _no_constant(word: str) -> None:
    raise ValueError(f"{word} is no number of JSON")


def _chunks(data: bytes, where: str) -> tuple[bytes, bytes]:
    """The JSON and the binary chunk of a GLB file."""
    if len(data) < 20:
        raise SceneError("damaged GLB: it ends within its header", where)
    version, length = struct.unpack_from("<II", data, 4)
    if version != 2 or length > len(data):
        raise SceneError(
            f"damaged GLB: version {version} and {length} bytes stated, expected 2 and at most "
            f"{len(data)}",
            where,
        )
    found: dict[bytes, bytes] = {}
    at = 12
    while at + 8 <= length:
        size, kind = struct.unpack_from("<I4s", data, at)
        if at + 8 + size > length:
            raise SceneError("damaged GLB: it ends within a chunk", where)
        found.setdefault(kind, data[at + 8 : at + 8 + size])
        at += 8 + size + -size % 4
    if b"JSON" not in found:
        raise SceneError("damaged GLB: it has no JSON", where)
    return found[b"JSON"], found.get(b"BIN\0", b"")


class File:
    """The root object and what its accessors hold."""

    def __init__(self, root: Json, folder: Path, chunk: bytes) -> None:
        self.root, self.folder, self.chunk = root, folder, chunk
        self.tables = {
            name: root.all(name)
            for name in ("buffers", "bufferViews", "accessors", "meshes", "nodes", "materials",
                         "cameras", "scenes", "textures", "images", "samplers")
        }  # fmt: skip
        self.buffers: dict[int, bytes] = {}
        self.arrays: dict[int, Array] = {}

    def array(self, number: int) -> Array:
        """The rows (n, width) of an accessor: float64 if they are or stand for fractions, else
        int64."""
        if number not in self.arrays:
            self.arrays[number] = self._array(self.tables["accessors"][number])
        return self.arrays[number]

    def _array(self, accessor: Json) -> Array:
        form = accessor.text("type")
        if form not in _WIDTHS:
            raise accessor.fail(f'"type" = {shorten(form)}, expected {", ".join(_WIDTHS)}')
        kind = self._kind(accessor)
        count, width = accessor.needed("count", 2**31), _WIDTHS[form]
        if accessor.index("bufferView", self.tables["bufferViews"]) is None:
            if count > MAX_COUNT:
                raise accessor.fail(f'"count" = {count} without a bufferView; at most {MAX_COUNT}')
            table = np.zeros((count, width), kind)
        else:
            table = self._table(accessor, kind, count, width)
        if "sparse" in accessor.content:
            table = self._sparse(accessor.of("sparse"), table.copy())
        if accessor.flag("normalized") and table.dtype.kind in "iu":
            return np.maximum(table / float(np.iinfo(table.dtype).max), -1.0)
        return table.astype(np.float64 if table.dtype.kind == "f" else np.int64)

    def _sparse(self, sparse: Json, table: Array) -> Array:
        """The table with some rows replaced."""
        count = sparse.needed("count", len(table))
        at, new = sparse.of("indices"), sparse.of("values")
        rows = self._table(at, self._kind(at), count, 1)[:, 0]
        if len(rows) and not 0 <= rows.min() <= rows.max() < len(table):
            raise at.fail(f"a row is outside [0, {len(table) - 1}]")
        table[rows.astype(np.int64)] = self._table(new, table.dtype, count, table.shape[1])
        return table

    def _kind(self, accessor: Json) -> np.dtype[Any]:
        number = accessor.needed("componentType", 2**31)
        if number not in _COMPONENTS:
            raise accessor.fail(f'"componentType" = {number} is unknown')
        return np.dtype("<" + _COMPONENTS[number])

    def _table(self, accessor: Json, kind: np.dtype[Any], count: int, width: int) -> Array:
        """Rows (count, width) of a buffer view, which may have other things between them."""
        number = accessor.needed("bufferView", len(self.tables["bufferViews"]) - 1)
        view = self.tables["bufferViews"][number]
        data, begin, length = self._range(view)
        size = width * kind.itemsize
        stride = view.whole("byteStride", 0, 252) or size
        shift = accessor.whole("byteOffset", 0, length) or 0
        if count and shift + (count - 1) * stride + size > length or stride < size:
            raise accessor.fail(
                f"{count} rows of {size} bytes every {stride} bytes from byte {shift} on do not "
                f"fit in a bufferView of {length} bytes"
            )
        if not count:
            return np.zeros((0, width), kind)
        return np.ndarray((count, width), kind, data, begin + shift, (stride, kind.itemsize))

    def view(self, number: int) -> bytes:
        """What a buffer view holds."""
        data, begin, length = self._range(self.tables["bufferViews"][number])
        return data[begin : begin + length]

    def _range(self, view: Json) -> tuple[bytes, int, int]:
        """The buffer of a view, where it begins in that, and its length."""
        data = self._buffer(view.needed("buffer", len(self.tables["buffers"]) - 1))
        begin = view.whole("byteOffset", 0, len(data)) or 0
        return data, begin, view.needed("byteLength", len(data) - begin)

    def _buffer(self, number: int) -> bytes:
        if number not in self.buffers:
            buffer = self.tables["buffers"][number]
            self.buffers[number] = data = self._bytes(buffer, number)
            if buffer.needed("byteLength", 2**40) > len(data):
                raise buffer.fail(f"it has {len(data)} bytes, less than its byteLength")
        return self.buffers[number]

    def _bytes(self, buffer: Json, number: int) -> bytes:
        if "uri" not in buffer.content:
            if number or not self.chunk:
                raise buffer.fail('"uri" is missing')
            return self.chunk
        return self.content(buffer)

    def content(self, owner: Json) -> bytes:
        """What the "uri" of a buffer or an image holds or names."""
        if "uri" not in owner.content:
            raise owner.fail('"uri" is missing')
        uri = owner.text("uri")
        if uri.startswith("data:"):
            head, comma, body = uri.partition(",")
            try:
                if not comma or not head.endswith(";base64"):
                    raise ValueError
                return base64.b64decode(body, validate=True)
            except (ValueError, binascii.Error):
                raise owner.fail('"uri" holds no data in base64') from None
        if ":" in uri:
            raise owner.fail(f'"uri" = {shorten(uri)} is no file beside this one')
        return read_bytes(self.folder / unquote(uri), MAX_BYTES, owner.where)
