"""Shapes as geometry in world units; mesh files and vertex normals.

Every function returns a Geometry; ValueError or OSError if the input is unusable. Source of the
conventions: Mitsuba 3 documentation; what it leaves open (mirrored transforms, computed normals)
was measured with mitsuba 3.9.1.
"""

from __future__ import annotations

import io
import re
import struct
import zlib
from dataclasses import fields, replace
from itertools import permutations

import numpy as np
import trimesh
from scipy.interpolate import BSpline, RegularGridInterpolator

from reference.scene import Geometry

_SQUARE = np.array([[-1, -1, 0], [1, -1, 0], [1, 1, 0], [-1, 1, 0]], float)
_CORNERS = (_SQUARE[:, :2] + 1) / 2  # texture coordinates of the square
#: Face of a cube, as (axis, sign) -> the local axes along which u and v grow.
_CUBE_AXES = {
    (1, -1): ((0, 0, 1), (1, 0, 0)),
    (1, 1): ((-1, 0, 0), (0, 0, -1)),
    (0, 1): ((0, 1, 0), (0, 0, -1)),
    (2, 1): ((0, 1, 0), (1, 0, 0)),
    (0, -1): ((0, 1, 0), (0, 0, 1)),
    (2, -1): ((0, -1, 0), (1, 0, 0)),
}
_HALVES = [[0, 1, 2], [0, 2, 3]]
_FACES = {  # outward, counter-clockwise, as (axis, sign)
    (axis, sign): np.roll(_SQUARE + [0, 0, 1], axis + 1, axis=1) * sign
    for axis in range(3)
    for sign in (1, -1)
}


def rectangle(to_world: np.ndarray, flip: bool = False) -> Geometry:
    """[-1, 1] squared at z = 0, front +z; the front stays in front under a mirror."""
    return _flat(_SQUARE[_HALVES], _CORNERS[_HALVES], to_world, flip)


def cube(to_world: np.ndarray, flip: bool = False) -> Geometry:
    """[-1, 1] cubed, front outside, under a mirror too."""
    quads = [quad if sign > 0 else quad[::-1] for (_, sign), quad in _FACES.items()]
    triangles = np.concatenate([quad[_HALVES] for quad in quads])
    return _flat(triangles, _cube_coordinates(triangles), to_world, flip)


def _cube_coordinates(triangles: np.ndarray) -> np.ndarray:
    """Texture coordinates (12, 3, 2) of the local cube, as measured: see ``_CUBE_AXES``."""
    out = []
    for corners in triangles:
        normal = np.cross(corners[1] - corners[0], corners[2] - corners[0])
        axis = int(np.argmax(np.abs(normal)))
        along_u, along_v = (np.array(a) for a in _CUBE_AXES[axis, int(np.sign(normal[axis]))])
        out.append((np.stack([corners @ along_u, corners @ along_v], axis=1) + 1) / 2)
    return np.array(out)


def _flat(triangles: np.ndarray, uv: np.ndarray, to_world: np.ndarray, flip: bool) -> Geometry:
    triangles = _moved(triangles, to_world)
    if _mirrors(to_world) != flip:
        triangles, uv = triangles[:, ::-1], uv[:, ::-1]
    return Geometry(triangles=triangles, normals=np.zeros_like(triangles), uv=uv)


def disk(to_world: np.ndarray, flip: bool = False) -> Geometry:
    """The unit disk at z = 0, front +z; an affine transform makes an ellipse of it."""
    axes = to_world[:3, [0, 1]].T
    turned = _mirrors(to_world) != flip
    if turned:
        axes = axes[::-1]
    disks = np.concatenate([to_world[None, :3, 3], axes])[None]
    return Geometry(disks=disks, turned=np.array([turned]))


def sphere(centre: np.ndarray, radius: float, to_world: np.ndarray, flip: bool = False) -> Geometry:
    """A sphere; ``to_world`` may rotate, move, mirror and scale evenly. The front is outside.

    ValueError if the scale differs between directions by more than 1e-5 of itself.
    """
    linear = to_world[:3, :3]
    scale = abs(np.linalg.det(linear)) ** (1 / 3)
    if np.abs(linear @ linear.T / scale**2 - np.eye(3)).max() > 2e-5:
        raise ValueError("to_world of a sphere must scale equally in all directions")
    place = linear @ centre + to_world[:3, 3]
    return Geometry(
        spheres=np.append(place, radius * scale)[None],
        inward=np.array([flip]),
        frames=np.linalg.inv(linear)[None],
    )


def cylinder(
    start: np.ndarray, end: np.ndarray, radius: float, to_world: np.ndarray, flip: bool = False
) -> Geometry:
    """Open at both ends, front outside: a prism of 1024 sides, thinner by 4.7e-6 of its radius."""
    axis = end - start
    basis = np.linalg.svd(axis[None])[2]  # rows: along the axis, and two across it
    angle = np.linspace(0, 2 * np.pi, 1025)
    across = np.cos(angle)[:, None] * basis[1] + np.sin(angle)[:, None] * basis[2]
    if np.linalg.det([axis, basis[1], basis[2]]) < 0:
        across = across[::-1]
    low = start + radius * across
    a, b, c, d = low[:-1], low[1:], low[1:] + axis, low[:-1] + axis
    n, m = across[:-1], across[1:]
    triangles = np.stack([np.stack([a, b, c], 1), np.stack([a, c, d], 1)], 1).reshape(-1, 3, 3)
    normals = np.stack([np.stack([n, m, m], 1), np.stack([n, m, n], 1)], 1).reshape(-1, 3, 3)
    if flip:
        triangles, normals = triangles[:, ::-1], -normals[:, ::-1]
    return moved(Geometry(triangles=triangles, normals=normals), to_world)


def linear_curve(data: bytes, to_world: np.ndarray, flip: bool = False) -> Geometry:
    """Spheres at the control points, and cones of 512 sides that touch two in a row."""
    parts, angle = [Geometry()], np.linspace(0, 2 * np.pi, 513)
    for rows in _curves(data, to_world, 2):
        parts.append(Geometry(spheres=rows, inward=np.full(len(rows), flip),
                              frames=np.tile(np.eye(3), (len(rows), 1, 1))))  # fmt: skip
        for a, b in zip(rows[:-1], rows[1:], strict=True):
            basis = np.linalg.svd((b - a)[None, :3])[2]  # rows: along the axis, and two across it
            along = (b - a)[:3] / np.linalg.norm((b - a)[:3])
            across = np.cos(angle)[:, None] * basis[1] + np.sin(angle)[:, None] * basis[2]
            if np.dot(np.cross(basis[1], basis[2]), along) < 0:
                across = across[::-1]
            sine = (a[3] - b[3]) / np.linalg.norm((b - a)[:3])
            if abs(sine) >= 1:
                continue  # a sphere in the other
            normals = sine * along + np.sqrt(1 - sine**2) * across
            rings = np.stack([a[:3] + a[3] * normals, b[:3] + b[3] * normals])
            parts.append(_tube(rings, np.stack([normals, normals]), flip))
    return joined(parts)


def spline_curve(data: bytes, to_world: np.ndarray, flip: bool = False) -> Geometry:
    """Uniform cubic B-splines by scipy, 48 circles of 128 sides a segment; normals of the mesh."""
    parts, angle = [Geometry()], np.linspace(0, 2 * np.pi, 129)
    for rows in _curves(data, to_world, 4):
        spline = BSpline(np.arange(len(rows) + 4), rows, 3)
        # not at the very ends, where a point may be repeated and there is no direction
        line = np.linspace(3 + 1e-6, len(rows) - 1e-6, 48 * (len(rows) - 3) + 1)
        place, step = spline(line), _unit(spline(line, 1)[:, :3])
        across = np.cross(step, [[0.3, -0.5, 0.8]])
        frame = np.empty_like(across)
        e = across[0]
        for k, t in enumerate(step):  # turned as little as may be from one to the next
            e = _unit((e - (e @ t) * t)[None])[0]
            frame[k] = e
        other = np.cross(step, frame)
        round_ = np.cos(angle)[:, None, None] * frame + np.sin(angle)[:, None, None] * other
        rings = (place[:, :3] + place[:, 3:] * round_).transpose(1, 0, 2)
        du = np.gradient(np.concatenate([rings[:, -2:-1], rings, rings[:, 1:2]], 1), axis=1)[
            :, 1:-1
        ]
        normals = _unit(np.cross(du, np.gradient(rings, axis=0)))
        tips = ~normals.any(axis=2)
        normals[tips] = round_.transpose(1, 0, 2)[tips]
        parts.append(_tube(rings, normals, flip))
    return joined(parts)


def _curves(data: bytes, to_world: np.ndarray, fewest: int) -> list[np.ndarray]:
    """Control points (P, 4) of each curve, moved but for their radii."""
    found = []
    for block in re.split(r"\n[ \t\r]*\n", data.decode()):
        rows = np.array([line.split() for line in block.splitlines() if line.strip()], float)
        if len(rows):
            if rows.shape[1] != 4 or len(rows) < fewest:
                raise ValueError("a curve needs more points, of 4 numbers")
            rows[:, :3] = _moved(rows[:, :3], to_world)
            found.append(rows)
    return found


def _tube(rings: np.ndarray, normals: np.ndarray, flip: bool) -> Geometry:
    """Triangles between rings (R, N, 3) closed by a repeated point; u goes around."""
    corners = []
    for table in (rings, normals):
        a, b, c, d = table[:-1, :-1], table[:-1, 1:], table[1:, 1:], table[1:, :-1]
        corners.append(np.stack([np.stack([a, b, c], 2), np.stack([a, c, d], 2)]).reshape(-1, 3, 3))
    triangles, ends = corners
    if flip:
        triangles, ends = triangles[:, ::-1], -ends[:, ::-1]
    u, v = np.linspace(0, 1, rings.shape[1]), np.arange(len(rings), dtype=float)
    at = np.stack(np.meshgrid(u, v), axis=-1)
    a, b, c, d = at[:-1, :-1], at[:-1, 1:], at[1:, 1:], at[1:, :-1]
    uv = np.stack([np.stack([a, b, c], 2), np.stack([a, c, d], 2)]).reshape(-1, 3, 2)
    return Geometry(triangles=triangles, normals=ends, uv=uv[:, ::-1] if flip else uv)


def sdf_grid(data: bytes, to_world: np.ndarray, smooth: bool, flip: bool = False) -> Geometry:
    """Where a .vol grid is 0: tetrahedra of a grid 6 times finer, cut; 2,000,000 of them at most.

    The normals are those of the cells, or mixed from the 8 cells around the nearest corner
    (Hansson-Soederlund et al. 2022).
    """
    version, kind, *size, channels = struct.unpack_from("<B5i", data, 3)
    if (data[:3], version, kind, channels) != (b"VOL", 3, 1, 1):
        raise ValueError("not a .vol file of one float32 a cell")
    grid = np.frombuffer(data, "<f4", int(np.prod(size)), 48).reshape(size[::-1]).T.astype(float)
    last = np.array(grid.shape) - 1
    at = RegularGridInterpolator([np.arange(n + 1.0) for n in last], grid)
    steps = [np.linspace(0, n, 6 * n + 1) for n in last]
    fine = at(np.stack(np.meshgrid(*steps, indexing="ij"), axis=-1))
    cells = np.stack(np.meshgrid(*[np.arange(len(s) - 1) for s in steps], indexing="ij"), -1)
    cells = cells.reshape(-1, 3)
    cube = np.array([[k & 1, k >> 1 & 1, k >> 2 & 1] for k in range(8)])
    signs = np.stack([fine[tuple((cells + c).T)] > 0 for c in cube])
    cells = cells[signs.any(axis=0) & ~signs.all(axis=0)]
    found = [np.zeros((0, 3, 3))]
    for path in permutations(range(3)):  # from one end of a cube's diagonal to the other
        tet = np.cumsum([[0, 0, 0], *np.eye(3, dtype=int)[list(path)]], axis=0)
        points = cells[:, None] + tet
        found += _cut(points / 6.0, fine[tuple(points.reshape(-1, 3).T)].reshape(-1, 4))
    triangles = np.concatenate(found)
    a, b, c = triangles.transpose(1, 0, 2)
    triangles = triangles[np.linalg.norm(np.cross(b - a, c - a), axis=1) > 0]
    middle = triangles.mean(axis=1)
    cell = np.minimum(np.floor(middle).astype(int), last - 1)
    slope = _cell_slope(at, middle, cell, cell)
    a, b, c = triangles.transpose(1, 0, 2)
    behind = (np.cross(b - a, c - a) * slope / last**2).sum(axis=1) < 0
    triangles[behind] = triangles[behind][:, ::-1]
    corners = triangles.reshape(-1, 3)
    if smooth:
        near, normals = np.round(corners).astype(int), np.zeros_like(corners)
        for side in cube - 1:
            share = np.where(near == 0, 1.0, corners - near + 0.5)
            share = np.where(side == 0, share, 1 - share).prod(axis=1)
            normals += share[:, None] * _unit(_cell_slope(at, corners, near + side, None))
    else:
        normals = _cell_slope(at, corners, np.repeat(cell, 3, axis=0), cell)
    normals = _unit(normals).reshape(-1, 3, 3)
    zero = np.zeros((len(triangles), 3, 2))
    local = Geometry(triangles=triangles / last, normals=normals, uv=zero)
    placed = moved(local, to_world)
    if flip:
        placed = replace(
            placed, triangles=placed.triangles[:, ::-1], normals=-placed.normals[:, ::-1]
        )
    return replace(placed, uv=zero)


def _cell_slope(
    at: RegularGridInterpolator, points: np.ndarray, cell: np.ndarray, kept: np.ndarray | None
) -> np.ndarray:
    """Slopes of the function in cells, along the axes of a unit cube; kept: at points on the edge
    of a cell, which are moved into it."""
    last = np.array([len(axis) - 1 for axis in at.grid])
    out = np.empty(points.shape)
    inside = points if kept is None else np.clip(points, cell + 1e-9, cell + 1 - 1e-9)
    for axis in range(3):
        ends = np.stack([inside, inside])
        ends[0, :, axis], ends[1, :, axis] = cell[:, axis], cell[:, axis] + 1
        low, high = at(np.clip(ends, 0, last))
        out[:, axis] = (high - low) * last[axis]
    return out


def _cut(points: np.ndarray, values: np.ndarray) -> list[np.ndarray]:
    """Triangles of tetrahedra (N, 4, 3) where values (N, 4) that are linear in them are 0."""
    order = np.argsort(values, axis=1)
    points = np.take_along_axis(points, order[:, :, None], axis=1)
    values = np.take_along_axis(values, order, axis=1)

    def edge(i: int, j: int, rows: np.ndarray) -> np.ndarray:
        share = values[rows, i] / (values[rows, i] - values[rows, j])
        return points[rows, i] + share[:, None] * (points[rows, j] - points[rows, i])

    out, below = [], (values <= 0).sum(axis=1)
    for count, faces in ((1, [(1, 2, 3)]), (3, [(3, 13, 23)]), (2, [(2, 3, 13), (2, 13, 12)])):
        rows = below == count
        for face in faces:
            out.append(np.stack([edge(*divmod(pair, 10), rows) for pair in face], axis=1))
    return out


def moved(geometry: Geometry, matrix: np.ndarray) -> Geometry:
    """A geometry under one more affine map, fronts in front; ValueError for an uneven sphere."""
    triangles, disks = _moved(geometry.triangles, matrix), geometry.disks @ matrix[:3, :3].T
    normals = _unit(geometry.normals @ np.linalg.inv(matrix[:3, :3]))
    disks[:, 0] += matrix[:3, 3]
    if _mirrors(matrix):
        triangles, normals, disks = triangles[:, ::-1], normals[:, ::-1], disks[:, [0, 2, 1]]
    balls = [
        sphere(ball[:3], ball[3], matrix, inward).spheres
        for ball, inward in zip(geometry.spheres, geometry.inward, strict=True)
    ]
    spheres = np.concatenate([np.zeros((0, 4)), *balls])
    return Geometry(triangles, normals, spheres, geometry.inward, disks)


def mesh(
    kind: str, data: bytes, to_world: np.ndarray, face_normals: bool = False, flip: bool = False,
    index: int = 0, attribute: str = "",
) -> Geometry:  # fmt: skip
    """Triangles of a mesh file's ``data``; ``kind`` is obj, ply, stl or serialized (and its mesh
    ``index``).

    Vertex normals are the file's; if it has none they are computed, weighted by the angle that a
    face has at the vertex. stl and ``face_normals`` are flat. Front: by the file's winding, also
    under a mirror, which turns it round. ``attribute``: vertex_color or face_color of a ply, or
    another one of those that has one number.
    """
    colours = _colours(data, attribute) if attribute else None
    if kind == "serialized":
        vertices, faces, normals = serialized(data, index)
    else:
        vertices, faces, normals = _READERS[kind](data)
    if not np.isfinite(vertices).all() or (len(faces) and not _in_range(faces, len(vertices))):
        raise ValueError("non-finite vertex or index out of range")
    vertices = _moved(vertices, to_world)
    if colours is not None:
        of_vertices = attribute.startswith("vertex_")
        colours = colours[faces] if of_vertices else np.repeat(colours[:, None], 3, axis=1)
    if _mirrors(to_world):
        faces = faces[:, ::-1]
        colours = None if colours is None else colours[:, ::-1]
    triangles = vertices[faces]
    if face_normals or kind == "stl":
        normals = None
    elif normals is not None:
        normals = _unit(normals @ np.linalg.inv(to_world[:3, :3]))
    else:
        normals = angle_weighted_normals(vertices, faces)
    corner = np.zeros_like(triangles) if normals is None else normals[faces]
    if flip:
        triangles, corner = triangles[:, ::-1], -corner[:, ::-1]
        colours = None if colours is None else colours[:, ::-1]
    uv, more = np.zeros((len(triangles), 3, 2)), {} if colours is None else {"colours": colours}
    return Geometry(triangles=triangles, normals=corner, uv=uv, **more)


def _colours(data: bytes, attribute: str) -> np.ndarray:
    """An attribute (V or T, 3) of a ply of triangles."""
    read = trimesh.exchange.ply.load_ply(io.BytesIO(data), fix_texture=False, skip_materials=True)
    element, _, name = attribute.partition("_")
    table = read["metadata"]["_ply_raw"][element]["data"]
    names = "rgb" if name == "color" else [f"{name}_0"] * 3
    return np.stack([np.asarray(table[n], float).ravel() for n in names], axis=1)


def angle_weighted_normals(vertices: np.ndarray, faces: np.ndarray) -> np.ndarray:
    """Unit normals (V, 3), zero where a vertex has no face (Thuermer and Wuethrich 1998)."""
    corners = vertices[faces]
    normal = _unit(np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]))
    out = np.zeros_like(vertices)
    for i in range(3):
        a = _unit(corners[:, (i + 1) % 3] - corners[:, i])
        b = _unit(corners[:, (i + 2) % 3] - corners[:, i])
        angle = np.arctan2(np.linalg.norm(np.cross(a, b), axis=1), (a * b).sum(axis=1))
        np.add.at(out, faces[:, i], normal * angle[:, None])
    return _unit(out)


def joined(parts: list[Geometry]) -> Geometry:
    """All parts' triangles, then all spheres, then all disks, each in the order of the parts."""
    names = [field.name for field in fields(Geometry)]
    parts = [Geometry(), *parts]
    return Geometry(**{name: np.concatenate([getattr(p, name) for p in parts]) for name in names})


def _obj(data: bytes) -> tuple[np.ndarray, np.ndarray, np.ndarray | None]:
    """Corners that share position, texture coordinate and normal are one vertex."""
    places: list[list[float]] = []
    normals: list[list[float]] = []
    found: dict[tuple[int, int, int], int] = {}
    faces: list[list[int]] = []
    textures = 0
    for line in data.decode("utf-8", "replace").splitlines():
        words = line.split()
        if not words:
            continue
        if words[0] == "v":
            places.append([float(x) for x in words[1:4]])
        elif words[0] == "vn":
            normals.append([float(x) for x in words[1:4]])
        elif words[0] == "vt":
            textures += 1
        elif words[0] == "f":
            sizes = (len(places), textures, len(normals))
            corner = [found.setdefault(_corner(word, sizes), len(found)) for word in words[1:]]
            faces += [[corner[0], corner[i], corner[i + 1]] for i in range(1, len(corner) - 1)]
    if not faces:
        raise ValueError("no faces")
    keys = np.array(list(found))
    vertices = np.array(places, float)[keys[:, 0]]
    have = (keys[:, 2] >= 0).all() and len(normals)
    return vertices, np.array(faces), np.array(normals, float)[keys[:, 2]] if have else None


def _corner(word: str, sizes: tuple[int, int, int]) -> tuple[int, int, int]:
    parts = (word + "//").split("/")[:3]
    out = []
    for part, size in zip(parts, sizes, strict=True):
        index = int(part) if part else 0
        if not -size <= index <= size or (not part and len(out) == 0) or part == "0":
            raise ValueError(f"face corner {word}: index out of range")
        out.append(index + size if index < 0 else index - 1)
    return out[0], out[1], out[2]


def _ply(data: bytes) -> tuple[np.ndarray, np.ndarray, np.ndarray | None]:
    read = trimesh.exchange.ply.load_ply(io.BytesIO(data), fix_texture=False, skip_materials=True)
    if "faces" not in read or not len(read["faces"]):
        raise ValueError("no faces")
    faces = trimesh.geometry.triangulate_quads(read["faces"])
    normals = read.get("vertex_normals")
    return (
        np.asarray(read["vertices"], float),
        np.asarray(faces, int),
        None if normals is None else np.asarray(normals, float),
    )


def serialized(data: bytes, index: int) -> tuple[np.ndarray, np.ndarray, np.ndarray | None]:
    """Mesh `index` of a serialized file of version 4."""
    count = int.from_bytes(data[-4:], "little")
    table = np.frombuffer(data[-4 - 8 * count : -4], "<u8")
    body = zlib.decompressobj().decompress(data[int(table[index]) + 4 :])
    flags, name = int.from_bytes(body[:4], "little"), body.index(0, 4)
    vertices, faces = (int(n) for n in np.frombuffer(body[name + 1 : name + 17], "<u8"))
    rest, kind = body[name + 17 :], "<f8" if flags & 0x2000 else "<f4"
    sizes = [3, 3 * bool(flags & 1), 2 * bool(flags & 2), 3 * bool(flags & 8)]
    numbers = np.frombuffer(rest, kind, vertices * sum(sizes))
    parts = np.split(numbers.astype(float), np.cumsum(sizes[:-1]) * vertices)
    corners = np.frombuffer(rest[numbers.nbytes :], "<u4", 3 * faces).astype(int).reshape(-1, 3)
    return parts[0].reshape(-1, 3), corners, parts[1].reshape(-1, 3) if flags & 1 else None


def _stl(data: bytes) -> tuple[np.ndarray, np.ndarray, None]:
    read = trimesh.load(io.BytesIO(data), file_type="stl", force="mesh", process=False)
    return np.asarray(read.vertices, float), np.asarray(read.faces, int), None


_READERS = {"obj": _obj, "ply": _ply, "stl": _stl}


def _in_range(faces: np.ndarray, count: int) -> bool:
    return 0 <= faces.min() and faces.max() < count


def _moved(points: np.ndarray, to_world: np.ndarray) -> np.ndarray:
    return points @ to_world[:3, :3].T + to_world[:3, 3]


def _mirrors(to_world: np.ndarray) -> bool:
    return bool(np.linalg.det(to_world[:3, :3]) < 0)


def _unit(vectors: np.ndarray) -> np.ndarray:
    length = np.linalg.norm(vectors, axis=-1, keepdims=True)
    return vectors / np.where(length > 0, length, 1)
