"""From shape objects to the primitives of a scene."""

from __future__ import annotations

import warnings
from pathlib import Path
from typing import Any, NoReturn

import numpy as np
import numpy.typing as npt

from .. import transform
from ..columns import MATERIAL_KINDS
from ..errors import SceneError, SceneWarning
from ..numeric import MAX_COORDINATE, determinant, mirrors
from . import mesh
from .node import Node, shorten

Array = npt.NDArray[Any]
_DIELECTRIC = MATERIAL_KINDS.index("dielectric")
_QUAD = np.array([[-1, -1, 0], [1, -1, 0], [1, 1, 0], [-1, 1, 0]], np.float64)
_QUAD_FACES = np.array([[0, 1, 2], [0, 2, 3]])
_CUBE = np.array(  # four corners a face, counter-clockwise from outside: -y, +y, +x, +z, -x, -z
    [
        [[1, -1, -1], [1, -1, 1], [-1, -1, 1], [-1, -1, -1]],
        [[1, 1, -1], [-1, 1, -1], [-1, 1, 1], [1, 1, 1]],
        [[1, -1, -1], [1, 1, -1], [1, 1, 1], [1, -1, 1]],
        [[1, -1, 1], [1, 1, 1], [-1, 1, 1], [-1, -1, 1]],
        [[-1, -1, 1], [-1, 1, 1], [-1, 1, -1], [-1, -1, -1]],
        [[1, 1, -1], [1, -1, -1], [-1, -1, -1], [-1, 1, -1]],
    ],
    np.float64,
).reshape(24, 3)
_QUAD_UV = np.array([[0, 0], [1, 0], [1, 1], [0, 1]], np.float64)
_CUBE_UV = np.tile(np.array([[0, 1], [1, 1], [1, 0], [0, 0]], np.float64), (6, 1))
_IDENTITY = np.eye(4)
_IDENTITY.setflags(write=False)
_CUBE_FACES = np.concatenate([_QUAD_FACES + 4 * face for face in range(6)])


#: Shapes with the same faces whatever their size: local vertices, faces, texture coordinates.
_FLAT = {
    "rectangle": (_QUAD, _QUAD_FACES, _QUAD_UV),
    "cube": (_CUBE, _CUBE_FACES, _CUBE_UV),
}
_CHUNK = 256  # shapes that are placed together


class Shapes:
    """Shapes gathered one by one, with the rows of their material, emission and boundary."""

    TABLES = ("vertices", "triangles", "spheres", "disks")

    def __init__(self) -> None:
        self.names: list[str] = []
        self.flat: dict[str, list[tuple[Node, Array, bool, int, int]]] = {
            name: [] for name in _FLAT
        }
        #: first vertex and triangle; vertices, triangles, normals and texture coordinates
        self.meshes: list[tuple[int, int, Array, Array, Array | None, Array | None]] = []
        self.spheres: list[tuple[Node, Array, tuple[float, ...], bool]] = []
        self.disks: list[Array] = []
        self.rows: dict[str, list[tuple[int, int, int, int]]] = {
            "triangle": [],
            "sphere": [],
            "disk": [],
        }
        self.counts: list[int] = []
        self.vertex_count = self.triangle_count = 0

    def add(
        self, node: Node, values: dict[str, Any], row: tuple[int, int, int], solid: str
    ) -> None:
        """Adds the primitives of a shape.

        values: its checked parameters. row: indices of material, emission and boundary. solid: why
        the shape must be closed, "" if it need not.
        """
        plugin = node.plugin
        matrix, flip = values["to_world"], values["flip_normals"]
        matrix = _IDENTITY if matrix is None else matrix
        kind = "triangle"
        if plugin == "sphere":
            kind = plugin
            self.spheres.append((node, matrix, (*values["center"], values["radius"]), flip))
        elif plugin == "disk":
            kind = plugin
            # mirrors keep the front in front
            first, second = (1, 0) if flip != (determinant(matrix) < 0) else (0, 1)
            self.disks.append(np.stack([matrix[:3, 3], matrix[:3, first], matrix[:3, second]]))
        elif plugin in _FLAT:
            corners, faces, _ = _FLAT[plugin]
            place = self._room(len(corners), len(faces))
            self.flat[plugin].append((node, matrix, flip, *place))
        else:
            self._mesh(node, values, matrix, solid)
        self.rows[kind].append((*row, len(self.names)))
        self.names.append(node.id or f"{plugin}_{len(self.names)}")

    def arrays(self, *, with_uv: bool = False) -> dict[str, Any]:
        """The arguments of Scene; with_uv: also the texture coordinates uv (V, 2) float64, zero
        for the vertices of meshes without."""
        spheres, inward = _spheres(self.spheres)
        vertices = np.empty((self.vertex_count, 3))
        index = np.uint32 if self.vertex_count < 2**32 else np.int64
        triangles = np.empty((self.triangle_count, 3), index)
        normals = None
        if any(mesh_normals is not None for *_, mesh_normals, _ in self.meshes):
            normals = np.zeros_like(vertices)
        uv = np.zeros((self.vertex_count, 2)) if with_uv else None
        for name, given in self.flat.items():
            local, local_faces, local_uv = _FLAT[name]
            for begin in range(0, len(given), _CHUNK):
                chunk = given[begin : begin + _CHUNK]
                _place(local, local_faces, chunk, vertices, triangles)
                if uv is not None:
                    rows = np.array([first for *_, first, _ in chunk])[:, None]
                    uv[rows + np.arange(len(local))] = local_uv
        for first, face, corners, faces, directions, coordinates in self.meshes:
            vertices[first : first + len(corners)] = corners
            triangles[face : face + len(faces)] = faces + first
            if normals is not None and directions is not None:
                normals[first : first + len(corners)] = directions
            if uv is not None and coordinates is not None:
                uv[first : first + len(corners)] = coordinates
        result: dict[str, Any] = {
            "vertices": vertices,
            "normals": normals,
            "triangles": triangles,
            "spheres": spheres,
            "sphere_inward": inward,
            "disks": np.array(self.disks, np.float64).reshape(-1, 3, 3),
            "shape_names": tuple(self.names),
        }
        if uv is not None:
            result["uv"] = uv
        for kind, rows in self.rows.items():
            table = np.array(rows, np.int32).reshape(-1, 4).T
            for values, name in zip(
                table, ("material", "emission", "boundary", "shape"), strict=True
            ):
                values = np.repeat(values, self.counts) if kind == "triangle" else values
                result[f"{kind}_{name}"] = values
        return result

    def _room(self, vertices: int, triangles: int) -> tuple[int, int]:
        """Numbers of the first vertex and triangle of a shape that has so many."""
        place = self.vertex_count, self.triangle_count
        self.vertex_count += vertices
        self.triangle_count += triangles
        self.counts.append(triangles)
        return place

    def _mesh(self, node: Node, values: dict[str, Any], matrix: Array, solid: str) -> None:
        flip = values["flip_normals"]
        normals = None
        where = node.values["filename"].where
        path = Path(node.folder) / values["filename"]
        loaded = mesh.read(path, node.plugin, where)
        vertices, faces = _placed(node, matrix, loaded.vertices), loaded.triangles
        by_winding = values["face_normals"] or loaded.normals is None
        if by_winding and determinant(matrix) < 0:  # a mirror keeps the front in front
            faces = faces[:, ::-1]
        if not values["face_normals"]:
            normals = _normals(matrix, vertices, faces, loaded)
        if normals is not None:
            faces = mesh.fronts_by_normals(vertices, faces, normals)
            if mesh.is_flat(vertices, faces, normals):
                normals = None
        if solid and not mesh.is_closed(vertices, faces):
            warnings.warn(
                f"{where}: {node}: the mesh {shorten(str(path))} is open, but {solid}: light "
                "leaks through the edges",
                SceneWarning,
                stacklevel=7,
            )
        if flip:
            faces, normals = faces[:, ::-1], None if normals is None else -normals
        uv = loaded.uv
        if uv is not None and values.get("flip_tex_coords"):
            uv = np.stack([uv[:, 0], 1.0 - uv[:, 1]], axis=1)
        self.meshes.append((*self._room(len(vertices), len(faces)), vertices, faces, normals, uv))


def _place(
    local: Array,
    faces: Array,
    given: list[tuple[Node, Array, bool, int, int]],
    vertices: Array,
    triangles: Array,
) -> None:
    """Writes shapes with the same local vertices and faces into the scene's arrays; given: node,
    matrix, flipped, first vertex, first triangle."""
    nodes, matrices, flipped, first, face = zip(*given, strict=True)
    matrix = np.array(matrices)
    with np.errstate(all="ignore"):
        placed = transform.apply(matrix[:, None], local)
    small = (np.abs(placed) <= MAX_COORDINATE).all(axis=(1, 2))
    if not small.all():
        _too_far(nodes[int(np.argmin(small))])
    turned = np.array(flipped, np.bool_) != mirrors(matrix)  # a mirror keeps the front in front
    corners = np.where(turned[:, None, None], faces[:, ::-1], faces)
    begin = np.array(first)[:, None]
    vertices[begin + np.arange(len(local))] = placed
    triangles[np.array(face)[:, None] + np.arange(len(faces))] = corners + begin[:, :, None]


def _spheres(
    given: list[tuple[Node, Array, tuple[float, ...], bool]],
) -> tuple[Array, Array]:
    """Centres and radii (S, 4) in world space, and whether the front is inside, of spheres: node,
    matrix, (x, y, z, radius), flipped. All at once: a file may hold a million."""
    if not given:
        return np.zeros((0, 4)), np.zeros(0, np.bool_)
    nodes, matrices, balls, flipped = zip(*given, strict=True)
    matrix, local = np.array(matrices), np.array(balls, np.float64)
    rows = matrix[:, :3, :3]
    with np.errstate(all="ignore"):
        products = (rows[:, :, None, :] * rows[:, None, :, :]).sum(axis=3)
        square = products[:, 0, 0]
        uneven = np.abs(products - square[:, None, None] * np.eye(3)).max(axis=(1, 2))
        centres = transform.apply(matrix, local[:, :3])
        radii = local[:, 3] * np.sqrt(square)
        inward = np.array(flipped, np.bool_)  # a mirror keeps the front in front
    uniform = uneven <= 2e-3 * square
    small = (np.abs(centres) <= MAX_COORDINATE).all(axis=1)
    small &= (radii > 0) & (radii <= MAX_COORDINATE)
    if not (uniform & small).all():
        first = int(np.argmin(uniform & small))
        node = nodes[first]
        if uniform[first]:
            raise SceneError(f"{node}: centre or radius exceeds {MAX_COORDINATE:g}", node.where)
        raise SceneError(
            f'{node}: "to_world" scales a sphere unevenly; allowed: rotation, translation and '
            "the same scale in all directions (or a mesh)",
            node.values["to_world"].where,
        )
    return np.column_stack([centres, radii]), inward


def _placed(node: Node, matrix: Array, vertices: Array) -> Array:
    with np.errstate(all="ignore"):
        placed = transform.apply(matrix, vertices)
    if not (np.abs(placed) <= MAX_COORDINATE).all():
        _too_far(node)
    return placed


def _too_far(node: Node) -> NoReturn:
    raise SceneError(f"{node}: a vertex exceeds {MAX_COORDINATE:g}", node.where)


def _normals(matrix: Array, vertices: Array, faces: Array, loaded: mesh.Mesh) -> Array:
    """Unit normals in world space, of the file or computed."""
    if loaded.normals is None:
        turned = faces is not loaded.triangles  # by a mirror
        return mesh.vertex_normals(vertices, loaded.triangles) * (-1 if turned else 1)
    return mesh.unit(transform.apply(transform.for_normals(matrix), mesh.unit(loaded.normals)))


def must_be_closed(row: dict[str, Any], interior: bool) -> str:
    """Why a shape with this material and an interior medium or none must be closed, else ""."""
    if interior:
        return "has an interior medium"
    return "is a dielectric" if row["material_kind"] == _DIELECTRIC else ""
