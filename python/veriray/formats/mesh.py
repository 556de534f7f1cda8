"""Triangle meshes from OBJ, PLY, STL and serialized files, and their shading normals.

OBJ and PLY are read here: trimesh (5.2) takes OBJ's index 0 for vertex 1, counts negative indices
from the end of the file and reverses groups, shortens damaged PLY faces and lets indices run out of
range, all without a word. STL as text is read by trimesh; the triangles are counted against the
file. Limits: 512 MiB a file, 8 GiB of large PLY files (`ply_pieces`); regular files only; PLY
polygons with 3 or 4 corners. Polygons become fans, or what `polygons` makes of them.
"""

from __future__ import annotations

import codecs
import io
import logging
import re
import warnings
from collections.abc import Callable
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

from .. import numeric
from ..chunks import in_chunks
from ..device import cpu_module
from ..errors import SceneError
from ..extras import need
from ..numeric import MAX_COORDINATE
from . import ply, ply_pieces, polygons, serialized
from .node import Node, quoted, read_bytes, shorten
from .plugins import mesh_attribute
from .ply import MeshFileError

Array = npt.NDArray[Any]
MAX_BYTES = 512 * 2**20
MAX_UV = 1e30  # float32 on the device
_GRAIN = 1 << 13  # triangles of a piece
#: Triangles from which on normals are computed by the native module.
NATIVE = 1 << 12
_NUMBER = re.compile(rb"[+-]?(?:[0-9]+(?:\.[0-9]*)?|\.[0-9]+)(?:[eE][+-]?[0-9]+)?")
_INDEX = re.compile(rb"[+-]?[0-9]{1,18}")


@dataclass
class Mesh:
    """vertices (V, 3) float64, triangles (T, 3) int64 or uint32; normals (V, 3) float64 of the
    file, of any length, and texture coordinates uv (V, 2) float64 as they stand in the file: zero
    rows for vertices without, None for a file without any. attributes: (V or T, 1 or 3) float64 by
    names that begin with vertex_ or face_. extremes: the least and the greatest number of fields
    that are known to be finite and without -0, by their names."""

    vertices: Array
    triangles: Array
    normals: Array | None
    uv: Array | None = None
    attributes: dict[str, Array] = field(default_factory=dict)
    extremes: dict[str, tuple[float, float]] = field(default_factory=dict)

    def of_vertices(self, rows: Array) -> dict[str, Array]:
        """The attributes where the vertices are these rows of the ones now."""
        return {
            name: values[rows] if name.startswith("vertex_") else values
            for name, values in self.attributes.items()
        }


_FIELDS = ("vertices", "triangles", "normals", "uv")
_Arrays = tuple[Array, Array, Array | None, Array | None]


def barycentric(mesh: Mesh, corners: Array) -> Mesh:
    """A mesh without texture coordinates with Mitsuba's: in each triangle (0, 0), (1, 0) and (0, 1)
    at its corners, in the order of `corners` (T, 3). Triangles share no vertices then."""
    place = (mesh.triangles[:, :, None] == corners[:, None, :]).argmax(axis=2)
    uv = np.array([[0.0, 0.0], [1.0, 0.0], [0.0, 1.0]])[place].reshape(-1, 2)
    used = mesh.triangles.ravel()
    normals = None if mesh.normals is None else mesh.normals[used]
    triangles = np.arange(len(used)).reshape(-1, 3)
    return Mesh(mesh.vertices[used], triangles, normals, uv, mesh.of_vertices(used))


def read(
    path: Path,
    kind: str,
    where: str,
    index: int = 0,
    files: dict[Path, bytes] | None = None,
    *,
    attributes: bool = False,
) -> Mesh:
    """A mesh file; kind: "obj", "ply", "stl" or "serialized", with the mesh `index` of that file.

    attributes: they are wanted, which PLY alone has.

    files: holds the content of the file that was read last, for shapes in a row that share one.

    Vertices of an OBJ file that is used with several normals or texture coordinates are split, as
    Mitsuba does. Raises SceneError for a file that is missing, damaged, empty, or holds indices out
    of range or numbers that are not finite.
    """
    files = {} if files is None else files
    name = f'"filename" = {shorten(path)}'
    if kind == "ply" and not attributes:
        tables = ply_pieces.read(path, ply_pieces.MAX_BYTES)
        if tables is not None:
            vertices, triangles = (table.values for table in tables[:2])
            normals, uv = (None if table is None else table.values for table in tables[2:])
            mesh = Mesh(vertices, triangles, normals, uv)
            for key, table in zip(_FIELDS, tables, strict=True):
                if table is not None:
                    mesh.extremes[key] = table.extremes
            _check(mesh, name, where)
            return mesh
    if path not in files:
        files.clear()
        files[path] = read_bytes(path, MAX_BYTES, where)
    data = files[path]
    try:
        if kind == "ply":
            mesh = Mesh(*ply.read(data, attributes=attributes))
        elif kind == "serialized":
            mesh = Mesh(*serialized.read(data, index))
        else:
            readers: dict[str, Callable[[bytes], _Arrays]]
            readers = {"obj": _obj, "stl": _stl}
            mesh = Mesh(*readers[kind](data))
    except MeshFileError as error:
        raise SceneError(f"{name}{error}", where) from None
    _check(mesh, name, where)
    return mesh


def given(node: Node) -> Mesh:
    """The mesh of a shape whose parameters are its arrays. Raises SceneError as `read`."""

    def array(name: str, dtype: Any, width: int) -> Array | None:
        value = node.values.get(name)
        if value is None:
            return None
        if not width:  # one or three numbers
            width = 1 if value.value.shape[1:] == (1,) else 3
        try:
            return numeric.array(f'{node}: "{name}"', value.value, dtype, (None, width))
        except SceneError as error:
            raise SceneError(str(error), value.where) from None

    vertices, triangles = array("vertices", np.float64, 3), array("faces", np.int64, 3)
    assert vertices is not None and triangles is not None  # they are required
    mesh = Mesh(vertices, triangles, array("normals", np.float64, 3), array("uv", np.float64, 2))
    for name in node.values:
        if mesh_attribute(node, name):
            values = array(name, np.float64, 0)
            assert values is not None
            mesh.attributes[name] = values
    for name, values in {"normals": mesh.normals, "uv": mesh.uv, **mesh.attributes}.items():
        of, rows = "vertices", len(vertices)
        if name.startswith("face_"):
            of, rows = "faces", len(triangles)
        if values is not None and len(values) != rows:
            raise SceneError(
                f'{node}: "{name}" has {len(values)} rows for {rows} {of}',
                node.values[name].where,
            )
    _check(mesh, str(node), node.where)
    return mesh


def _check(mesh: Mesh, name: str, where: str) -> None:
    """Raises SceneError for a mesh without triangles, indices out of range and bad numbers."""
    if not len(mesh.triangles):
        raise SceneError(f"{name} holds no triangles", where)
    for what, values, limit in (
        ("vertices", mesh.vertices, MAX_COORDINATE),
        ("normals", mesh.normals, MAX_COORDINATE),
        ("uv", mesh.uv, MAX_UV),
    ):
        if values is None or _within(mesh, what, values, -limit, limit):
            continue
        bad = np.argwhere(~(np.abs(values) <= limit))  # NaN too
        row, column = (int(i) for i in bad[0])
        raise SceneError(
            f"{name}: vertex {row} has the {_WORDS[what]} {values[row, column]}; it must be finite "
            f"and within {limit:g}",
            where,
        )
    if not _within(mesh, "triangles", mesh.triangles, 0, len(mesh.vertices) - 1):
        bad = np.argwhere((mesh.triangles < 0) | (mesh.triangles >= len(mesh.vertices)))
        row, column = (int(i) for i in bad[0])
        raise SceneError(
            f"{name}: triangle {row} uses vertex {mesh.triangles[row, column]}, outside "
            f"[0, {len(mesh.vertices) - 1}]",
            where,
        )


_WORDS = {"vertices": "coordinate", "normals": "normal's component", "uv": "texture coordinate"}


def _within(mesh: Mesh, what: str, values: Array, least: float, most: float) -> bool:
    """Whether all numbers of a field are finite and within [least, most]."""
    if not values.size:
        return True
    low, high = mesh.extremes.get(what) or (values.min(), values.max())  # NaN if there is one
    return bool(least <= low and high <= most)


#: Lines v, vt, vn and f up to the last that a backslash continues; none has a comment.
_CONTINUED = re.compile(rb"(?<![^\r\n])[ \t\v\f]*(?:v[tn]?|f)(?=[ \t\v\f\\])(?:[^\r\n#]*\\\r?\n)+")


def obj_text(data: bytes) -> bytes:
    """The text of an OBJ file without byte order mark, and with continued lines as one.

    A backslash at the end of other lines, and of comments, is a part of them: of a path in them,
    perhaps.
    """
    text = data.removeprefix(codecs.BOM_UTF8)
    if b"\\\n" not in text and b"\\\r\n" not in text:
        return text

    def join(found: re.Match[bytes]) -> bytes:
        return found[0].replace(b"\\\r\n", b" ").replace(b"\\\n", b" ")

    return _CONTINUED.sub(join, text)


def obj(data: bytes, path: Path, where: str) -> tuple[Mesh, Array]:
    """The mesh of an OBJ file's content, and the numbers (V,) of the v lines that its vertices are
    of. Raises SceneError as `read`."""
    name = f'"filename" = {shorten(path)}'
    try:
        vertices, triangles, normals, uv, lines = _obj_of_lines(data)
    except MeshFileError as error:
        raise SceneError(f"{name}{error}", where) from None
    mesh = Mesh(vertices, triangles, normals, uv)
    _check(mesh, name, where)
    return mesh, lines


def _obj(data: bytes) -> _Arrays:
    return _obj_of_lines(data)[:4]


def _obj_of_lines(data: bytes) -> tuple[Array, Array, Array | None, Array | None, Array]:
    """The arrays of an OBJ file, and which v line each vertex is of."""
    text = obj_text(data)
    tables, corners, triangles, parts = _obj_native(text) or _obj_lines(text)
    vertices, *others = tables
    if parts.max(initial=1) > 1:
        triangles = polygons.unfolded(vertices[corners[:, 0]], triangles, parts)
    if not (corners[:, 1:] >= 0).any():
        return vertices, corners[:, 0][triangles], None, None, np.arange(len(vertices))
    rows, inverse = distinct(corners)
    uv, normals = (
        np.concatenate([table, np.zeros((1, table.shape[1]))])[index]
        if (index >= 0).any()
        else None
        for table, index in zip(others, rows[:, 1:].T, strict=True)
    )
    return vertices[rows[:, 0]], inverse[triangles], normals, uv, rows[:, 0]


def distinct(corners: Array) -> tuple[Array, Array]:
    """The different rows of indices (C, 3), in ascending order, and which of them each row is.

    As np.unique with axis 0, by one integer a row where that holds all three: 5 times as fast.
    """
    sizes = [int(size) + 2 for size in corners.max(axis=0)]  # -1 is an index, too
    if sizes[0] * sizes[1] * sizes[2] >= 2**63:
        rows, inverse = np.unique(corners, axis=0, return_inverse=True)
        return rows, inverse.reshape(-1)
    v, vt, vn = corners.T + 1
    _, first, inverse = np.unique(
        (v * sizes[1] + vt) * sizes[2] + vn, return_index=True, return_inverse=True
    )
    return corners[first], inverse


_KINDS = {b"v": 3, b"vt": 2, b"vn": 3}  # line -> numbers kept
#: Tables of v, vt, vn; corners (C, 3) or -1; fans of corners, and the triangles of each.
_Obj = tuple[list[Array], Array, Array, Array]


def _obj_native(text: bytes) -> _Obj | None:
    """As `_obj_lines`; None for a file with an error, or without a native module."""
    native = cpu_module()
    found = None if native is None else native.read_obj(text)
    if found is None:
        return None
    *tables, corners, sides = found
    return tables, corners, _fans(sides), sides - 2


def _fans(sides: Array) -> Array:
    """Triangles (T, 3) of consecutive corners of faces with so many sides: a fan for each."""
    parts, first = sides - 2, np.cumsum(sides) - sides
    triangles: Array = np.repeat(first, parts)[:, None] + np.arange(3)
    k = np.arange(len(triangles)) - np.repeat(np.cumsum(parts) - parts, parts)
    triangles[:, 1:] += k[:, None]
    return triangles


def _obj_lines(text: bytes) -> _Obj:
    """Line by line, with errors that name the line."""
    tables: dict[bytes, list[Any]] = {kind: [] for kind in _KINDS}
    corners: list[tuple[int, int, int]] = []  # v, vt, vn of each; -1 for none
    faces: list[tuple[int, int, int]] = []  # into corners
    parts: list[int] = []
    for number, line in enumerate(text.splitlines(), 1):
        tokens = line.split(b"#", 1)[0].split()
        if not tokens:
            continue
        kind = tokens[0]
        if kind == b"f":
            if len(tokens) < 4:
                raise MeshFileError(f", line {number}: a face needs at least 3 vertices")
            first = len(corners)
            previous = -1, -1, -1
            for token in tokens[1:]:
                v, *rest = _corner(token, tables, number)
                # as Mitsuba: a corner without a normal has that of the one before it
                vt, vn = (own if own >= 0 else b for own, b in zip(rest, previous[1:], strict=True))
                previous = v, vt, vn
                corners.append(previous)
            faces += [(first, k, k + 1) for k in range(first + 1, len(corners) - 1)]
            parts.append(len(tokens) - 3)
        elif kind in tables:
            tables[kind].append(_row(kind, tokens, number))
    return (
        [np.array(tables[k], np.float64).reshape(-1, n) for k, n in _KINDS.items()],
        np.array(corners, np.int64).reshape(-1, 3),
        np.array(faces, np.int64).reshape(-1, 3),
        np.array(parts, np.int64),
    )


def _row(kind: bytes, tokens: list[bytes], number: int) -> list[float]:
    """The numbers of a line v, vt or vn."""
    count = 2 if kind == b"vt" else 3
    numbers, least = tokens[1 : count + 1], 1 if kind == b"vt" else 3
    for token in numbers:
        if not _NUMBER.fullmatch(token):
            raise MeshFileError(f", line {number}: {quoted(token)} is not a finite number")
    if len(numbers) < least:
        given = f"{kind.decode()} has {len(numbers)} finite numbers"
        raise MeshFileError(f", line {number}: {given}, expected {least}")
    return [float(t) for t in numbers] + [0.0] * (count - len(numbers))


def _corner(token: bytes, tables: dict[bytes, list[Any]], number: int) -> tuple[int, int, int]:
    """Indices from 0 of a corner "v", "v/vt", "v//vn" or "v/vt/vn"; -1 for an absent one."""
    result = []
    parts = token.split(b"/")
    for of, part in zip(tables, (*parts, b"", b""), strict=False):
        if not part and of != b"v":
            result.append(-1)
            continue
        count = len(tables[of])
        index = int(part) if _INDEX.fullmatch(part) else 0
        if index == 0 or not -count <= index <= count or len(parts) > 3:
            raise MeshFileError(
                f", line {number}: the index {quoted(token)} is not "
                f"within the {count} {of.decode()} lines before it"
            )
        result.append(index - 1 if index > 0 else index + count)
    return result[0], result[1], result[2]


_FACET = np.dtype([("normal", "<f4", 3), ("corners", "<f4", (3, 3)), ("more", "<u2")])


def _stl(data: bytes) -> _Arrays:
    count = int.from_bytes(data[80:84], "little") if len(data) >= 84 else -1
    binary = count >= 0 and len(data) == 84 + 50 * count
    if binary and count:
        facets = np.frombuffer(data, _FACET, count, 84)["corners"]
        corners = np.empty((count, 3, 3))

        def widen(first: int, last: int) -> None:
            corners[first:last] = facets[first:last]

        in_chunks(widen, count, _GRAIN)
        every = np.arange(3 * count, dtype=np.uint32 if 3 * count < 2**32 else np.int64)
        return corners.reshape(-1, 3), every.reshape(-1, 3), None, None
    return _stl_text(data, count, binary)


def _plain_stl(data: bytes) -> bytes:
    """Text in small letters and lines that end as Unix's, without a byte order mark and names.

    Names of solids may be words of the format, which trimesh would take for its own.
    """
    text = data.removeprefix(codecs.BOM_UTF8).replace(b"\r\n", b"\n").replace(b"\r", b"\n")
    return re.sub(rb"(?m)^[ \t]*((?:end)?solid)\b.*$", rb"\1", text.lower())


def _stl_text(data: bytes, count: int, binary: bool) -> _Arrays:
    need("an STL file of text", "formats", "trimesh")
    import trimesh  # slow to import, and rarely needed

    if not binary:
        data = _plain_stl(data)
        if not data.lstrip().startswith(b"solid") or b"endsolid" not in data:
            raise MeshFileError(
                " is not STL: neither binary of the stated size nor solid ... endsolid"
            )
        count = len(re.findall(rb"\bendfacet\b", data))
    log = logging.getLogger("trimesh")  # prints tracebacks of what it then raises
    level = log.level
    try:
        log.setLevel(logging.CRITICAL + 1)
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")
            loaded: Any = trimesh.load(
                io.BytesIO(data), file_type="stl", process=False, force="mesh"
            )
        vertices = np.array(loaded.vertices, np.float64).reshape(-1, 3)
        triangles = np.array(loaded.faces, np.int64).reshape(-1, 3)
    except Exception as error:  # trimesh raises whatever its parsers stumble over
        raise MeshFileError(f" cannot be read as STL ({type(error).__name__})") from None
    finally:
        log.setLevel(level)
    if len(triangles) != count:
        raise MeshFileError(f" is damaged: {len(triangles)} triangles read, {count} expected")
    return vertices, triangles, None, None


# ---- normals; elementwise and in a fixed order, so that they have the same bits everywhere ----


def cross(a: Array, b: Array) -> Array:
    """Cross products of rows (N, 3)."""
    (ax, ay, az), (bx, by, bz) = a.T, b.T
    return np.stack([ay * bz - az * by, az * bx - ax * bz, ax * by - ay * bx], axis=1)


def dot(a: Array, b: Array) -> Array:
    """Dot products (N,) of rows, of their first three columns."""
    result: Array = (a[:, 0] * b[:, 0] + a[:, 1] * b[:, 1]) + a[:, 2] * b[:, 2]
    return result


def unit(vectors: Array) -> Array:
    """Rows (N, 3) divided by their lengths; rows of zeros stay."""
    largest = np.abs(vectors).max(axis=1, initial=0.0)
    scaled = vectors / np.where(largest > 0, largest, 1.0)[:, None]
    lengths = np.sqrt(dot(scaled, scaled))
    result: Array = scaled / np.where(lengths > 0, lengths, 1.0)[:, None]
    return result


def face_normals(vertices: Array, triangles: Array) -> Array:
    """Unit normals (T, 3) on the front sides; zero for triangles without area."""
    result = np.empty((len(triangles), 3))

    def part(first: int, last: int) -> None:
        result[first:last] = _facing(*_corners(vertices, triangles[first:last]))

    in_chunks(part, len(triangles), _GRAIN)
    return result


def _corners(vertices: Array, triangles: Array) -> list[Array]:
    return [vertices[triangles[:, k]] for k in range(3)]


def _facing(a: Array, b: Array, c: Array) -> Array:
    return unit(cross(b - a, c - a))


def angles(a: Array, b: Array) -> Array:
    """Angles between unit vectors: 2 atan(|a - b| / |a + b|), to about 1e-12."""
    d, s = a - b, a + b
    x = np.sqrt(dot(d, d)) / np.maximum(np.sqrt(dot(s, s)), 1e-300)
    x = np.minimum(x, 1e12)
    for _ in range(4):  # halve the angle
        x = x / (1.0 + np.sqrt(1.0 + x * x))
    square, series = x * x, np.zeros_like(x)
    for n in range(11, 0, -2):
        series = 1.0 / n - square * series
    result: Array = 32.0 * x * series
    return result


def _native(triangles: Array) -> Any:
    """The module that does the same for many triangles, with the same bits; None for few, and where
    there is none."""
    return None if len(triangles) < NATIVE else cpu_module()


def vertex_normals(vertices: Array, triangles: Array) -> Array:
    """Normals (V, 3): the faces' around a vertex, weighted by their angles there, as in Mitsuba.

    After G. Thuermer and C. A. Wuethrich, Computing vertex normals from polygonal facets, 1998.
    Zero for vertices without a triangle that has an area.
    """
    native = _native(triangles)
    if native is not None:
        result: Array = native.vertex_normals(vertices, np.asarray(triangles, np.uint32))
        return result
    count = len(triangles)
    parts = np.empty((3, 3, count))  # by axis and corner

    def part(first: int, last: int) -> None:
        corners = _corners(vertices, triangles[first:last])
        facing = _facing(*corners).T
        edges = [unit(corners[(k + 1) % 3] - corners[k]) for k in range(3)]  # from k to k + 1
        for k in range(3):
            parts[:, k, first:last] = facing * angles(edges[k], -edges[k - 1])

    in_chunks(part, count, _GRAIN)
    index = triangles.T.reshape(-1)
    sums = [np.bincount(index, values.reshape(-1), minlength=len(vertices)) for values in parts]
    return unit(np.stack(sums, axis=1))


def shading(vertices: Array, triangles: Array, normals: Array) -> tuple[Array, bool]:
    """The triangles as `fronts_by_normals` turns them, and whether the normals are then flat."""
    native = _native(triangles)
    if native is not None:
        behind, flat = native.shading_of(vertices, np.asarray(triangles, np.uint32), normals)
        if not behind:
            return triangles, flat

    def look(first: int, last: int) -> tuple[bool, bool]:
        part = triangles[first:last]
        facing = _facing(*_corners(vertices, part))
        cosines = [dot(normals[part[:, k]], facing) for k in range(3)]
        behind = (cosines[0] < 0) & (cosines[1] < 0) & (cosines[2] < 0)
        solid = facing.any(axis=1)
        return bool(behind.any()), all((of[solid] > 1 - 1e-7).all() for of in cosines)

    if native is None:
        found = in_chunks(look, len(triangles), _GRAIN)
        if not any(behind for behind, _ in found):
            return triangles, all(flat for _, flat in found)
    triangles = fronts_by_normals(vertices, triangles, normals)
    return triangles, is_flat(vertices, triangles, normals)


def is_flat(vertices: Array, triangles: Array, normals: Array) -> bool:
    """Whether `normals` are those of the faces (to 5e-4 radian): then they change nothing."""
    facing = face_normals(vertices, triangles)
    solid = facing.any(axis=1)
    facing, corners = facing[solid], triangles[solid]
    return all((dot(normals[corners[:, k]], facing) > 1 - 1e-7).all() for k in range(3))


def fronts_by_normals(vertices: Array, triangles: Array, normals: Array) -> Array:
    """The triangles, turned so that their fronts are where the vertex normals point, as in Mitsuba.

    All or none of them, by majority, if neighbours agree on their front: a sliver folded over must
    not break a closed surface. Else each whose three normals point to the back.
    """
    facing = face_normals(vertices, triangles)
    cosines = np.stack([dot(normals[triangles[:, k]], facing) for k in range(3)])
    behind: Array = np.all(cosines < 0, axis=0)
    if not behind.any():
        return triangles
    forth, back = (np.sort(edges) for edges in _edges(vertices, triangles))
    if np.array_equal(forth, back) or (forth[1:] != forth[:-1]).all():
        behind[:] = 2 * behind.sum() > len(behind)
    return np.where(behind[:, None], triangles[:, ::-1], triangles)


def is_closed(vertices: Array, triangles: Array) -> bool:
    """Whether each edge has as many triangles on one side as on the other, by equal positions."""
    forth, back = _edges(vertices, triangles)
    return np.array_equal(np.sort(forth), np.sort(back))


def _edges(vertices: Array, triangles: Array) -> tuple[Array, Array]:
    """A number for each edge of each triangle, and for the same edges run backwards.

    Vertices at the same place are one; edges from a vertex to itself are left out.
    """
    _, inverse = np.unique(vertices, axis=0, return_inverse=True)
    welded = inverse.reshape(-1)[triangles]
    edges = np.concatenate([welded[:, [k, (k + 1) % 3]] for k in range(3)])
    a, b = edges[edges[:, 0] != edges[:, 1]].T
    return a * len(vertices) + b, b * len(vertices) + a
