"""Triangle meshes from OBJ and PLY files.

OBJ is read here: trimesh (5.2) takes the index 0 for vertex 1, counts negative indices from the end
of the file and reverses groups, all without a word. PLY is read by trimesh, which shortens damaged
faces and lets indices run out of range; what it returns is checked against the file.
Limits: 512 MiB a file, regular files only; PLY polygons with 3 or 4 corners. Polygons become fans.
"""

from __future__ import annotations

import io
import re
import warnings
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

from ..errors import SceneError
from ..scene import MAX_COORDINATE
from .node import read_bytes, shorten

Array = npt.NDArray[Any]
MAX_BYTES = 512 * 2**20
_NUMBER = re.compile(rb"[+-]?(?:[0-9]+\.?[0-9]*|\.[0-9]+)(?:[eE][+-]?[0-9]+)?")


def read(path: Path, kind: str, where: str) -> tuple[Array, Array, bool]:
    """Vertices (V, 3) float64, triangles (T, 3) int64, and whether flat shading changes nothing.

    kind: "obj" or "ply". The last is True if the file has no vertex normals and those that Mitsuba
    would compute (means of the faces around a vertex) are the normals of all these faces.
    Raises SceneError for a file that is missing, damaged, empty, or holds indices out of range.
    """
    data = read_bytes(path, MAX_BYTES, where)
    vertices, faces, normals = (_obj if kind == "obj" else _ply)(data, path, where)
    if not len(faces):
        raise SceneError(f"{_name(path)} holds no triangles", where)
    bad = np.argwhere(~(np.abs(vertices) <= MAX_COORDINATE))  # NaN too
    if len(bad):
        row, column = (int(i) for i in bad[0])
        raise SceneError(
            f"{_name(path)}: vertex {row} has the coordinate {vertices[row, column]}; it must be "
            f"finite and within {MAX_COORDINATE:g}",
            where,
        )
    bad = np.argwhere((faces < 0) | (faces >= len(vertices)))
    if len(bad):
        row, column = (int(i) for i in bad[0])
        raise SceneError(
            f"{_name(path)}: triangle {row} uses vertex {faces[row, column]}, outside "
            f"[0, {len(vertices) - 1}]",
            where,
        )
    return vertices, faces, not normals and _is_flat(vertices, faces)


def _name(path: Path) -> str:
    return f'"filename" = {shorten(str(path))}'


def _obj(data: bytes, path: Path, where: str) -> tuple[Array, Array, bool]:
    vertices: list[list[float]] = []
    faces: list[tuple[int, int, int]] = []
    counts = {b"v": 0, b"vt": 0, b"vn": 0}
    normals = False
    text = data.replace(b"\r\n", b"\n").replace(b"\\\n", b" ")
    for number, line in enumerate(text.splitlines(), 1):
        tokens = line.split(b"#", 1)[0].split()
        if not tokens:
            continue
        place = f"{_name(path)}, line {number}"
        if tokens[0] in counts:
            counts[tokens[0]] += 1
            if tokens[0] == b"v":
                if len(tokens) < 4 or not all(_NUMBER.fullmatch(t) for t in tokens[1:4]):
                    given = shorten(line.decode("utf-8", "replace"))
                    raise SceneError(f"{place}: {given} is not a vertex of 3 finite numbers", where)
                vertices.append([float(t) for t in tokens[1:4]])
        elif tokens[0] == b"f":
            if len(tokens) < 4:
                raise SceneError(f"{place}: a face needs at least 3 vertices", where)
            corners = []
            for token in tokens[1:]:
                parts = token.split(b"/")
                for part, of in zip(parts, counts, strict=False):
                    if not part and of != b"v":
                        continue
                    index = int(part) if re.fullmatch(rb"[+-]?[0-9]{1,18}", part) else 0
                    if index == 0 or not -counts[of] <= index <= counts[of]:
                        raise SceneError(
                            f"{place}: the index {shorten(token.decode('utf-8', 'replace'))} is "
                            f"not within the {counts[of]} {of.decode()} lines before it",
                            where,
                        )
                    if of == b"v":
                        corners.append(index - 1 if index > 0 else index + len(vertices))
                normals = normals or (len(parts) > 2 and parts[2] != b"")
            faces += [(corners[0], a, b) for a, b in zip(corners[1:], corners[2:], strict=False)]
    return (
        np.array(vertices, np.float64).reshape(-1, 3),
        np.array(faces, np.int64).reshape(-1, 3),
        normals,
    )


def _ply(data: bytes, path: Path, where: str) -> tuple[Array, Array, bool]:
    import trimesh  # slow to import, and rarely needed

    normals = _check_ply(data, path, where)
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")
            loaded: Any = trimesh.load(
                io.BytesIO(data), file_type="ply", process=False, skip_materials=True, force="mesh"
            )
        vertices = np.array(loaded.vertices, np.float64).reshape(-1, 3)
        faces = np.array(loaded.faces, np.int64).reshape(-1, 3)
    except Exception as error:  # trimesh raises whatever its parsers stumble over
        message = f"{type(error).__name__}: {str(error)[:200]}"
        raise SceneError(f"{_name(path)} cannot be read as PLY: {message}", where) from None
    expected = _ply_triangles(loaded, path, where)
    if len(faces) != expected:
        raise SceneError(
            f"{_name(path)} is damaged: {len(faces)} triangles read, {expected} expected", where
        )
    return vertices, faces, normals


def _check_ply(data: bytes, path: Path, where: str) -> bool:
    """Checks the header, and the number of lines in a text file; whether it has vertex normals."""
    end = data.find(b"end_header")
    lines = data[: max(end, 0)].decode("latin-1").splitlines()
    if end < 0 or end > 2**16 or len(lines) < 2 or lines[0].strip() != "ply":
        raise SceneError(f'{_name(path)} is not PLY: no header "ply" ... "end_header"', where)
    rows, normals = 0, False
    for line in lines:
        tokens = line.split()
        if tokens[:1] == ["element"]:
            if len(tokens) != 3 or not re.fullmatch("[0-9]{1,10}", tokens[2]):
                raise SceneError(f"{_name(path)}: bad header line {shorten(line)}", where)
            rows += int(tokens[2])
        normals = normals or (tokens[:1] == ["property"] and tokens[-1] == "nx")
    if not re.fullmatch(r"format (ascii|binary_(little|big)_endian) 1\.0", lines[1].strip()):
        raise SceneError(f"{_name(path)}: unknown {shorten(lines[1])}", where)
    if "ascii" in lines[1]:
        body = data[end:].partition(b"\n")[2].rstrip()
        present = body.count(b"\n") + 1 if body else 0
        if present != rows:
            raise SceneError(
                f"{_name(path)} is damaged: {present} lines of data, {rows} expected", where
            )
    elif rows > len(data):
        raise SceneError(f"{_name(path)} is damaged: {rows} elements in {len(data)} bytes", where)
    return normals


def _ply_triangles(mesh: Any, path: Path, where: str) -> int:
    """Triangles that the file's face lists make, from the lists' lengths."""
    faces = mesh.metadata.get("_ply_raw", {}).get("face", {}).get("data")
    if faces is None:
        return 0
    names = faces.keys() if isinstance(faces, dict) else faces.dtype.names
    name = next((name for name in names if name in ("vertex_index", "vertex_indices")), None)
    if name is None:
        raise SceneError(f"{_name(path)}: the faces have no list vertex_indices", where)
    lists = faces[name]
    if isinstance(faces, dict):
        lengths = np.array([np.size(row) for row in lists])
    else:
        lengths = np.asarray(lists["f0"]).astype(np.int64)
        if len(lengths) and (lengths != lists["f1"].reshape(len(lists), -1).shape[1]).any():
            raise SceneError(f"{_name(path)} mixes polygons; triangulate it", where)
    if len(lengths) and (lengths.min() < 3 or lengths.max() > 4):
        bad = int(np.argmax((lengths < 3) | (lengths > 4)))
        raise SceneError(
            f"{_name(path)}: face {bad} has {lengths[bad]} vertices, expected 3 or 4", where
        )
    return int((lengths - 2).sum())


def _is_flat(vertices: Array, faces: Array) -> bool:
    corners = vertices[faces]
    with np.errstate(all="ignore"):
        face = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
        face /= np.linalg.norm(face, axis=1, keepdims=True)
        solid = np.isfinite(face).all(axis=1)
        face, faces = face[solid], faces[solid]
        normals = np.zeros_like(vertices)
        for corner in range(3):
            np.add.at(normals, faces[:, corner], face)
        normals /= np.linalg.norm(normals, axis=1, keepdims=True)
        return bool(((normals[faces] * face[:, None]).sum(axis=2) > 1 - 1e-7).all())
