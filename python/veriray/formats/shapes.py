"""From shape objects to the primitives of a scene."""

from __future__ import annotations

import warnings
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

from .. import transform
from ..columns import MATERIAL_KINDS
from ..errors import SceneError, SceneWarning
from ..numeric import MAX_COORDINATE, determinant
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
_IDENTITY = np.eye(4)
_IDENTITY.setflags(write=False)
_CUBE_FACES = np.concatenate([_QUAD_FACES + 4 * face for face in range(6)])


class Shapes:
    """Shapes gathered one by one, with the rows of their material, emission and boundary."""

    def __init__(self) -> None:
        self.names: list[str] = []
        self.vertices: list[Array] = []
        self.normals: list[Array] = []
        self.triangles: list[Array] = []
        self.spheres: list[tuple[Node, Array, tuple[float, ...], bool]] = []
        self.disks: list[Array] = []
        self.rows: dict[str, list[tuple[int, int, int, int]]] = {
            "triangle": [],
            "sphere": [],
            "disk": [],
        }
        self.counts: list[int] = []
        self.vertex_count = 0

    def add(
        self, node: Node, values: dict[str, Any], row: tuple[int, int, int], solid: str
    ) -> None:
        """Adds the primitives of a shape.

        values: its checked parameters. row: indices of material, emission and boundary. solid: why
        the shape must be closed, "" if it need not.
        """
        kind = {"sphere": "sphere", "disk": "disk"}.get(node.plugin, "triangle")
        values["to_world"] = _IDENTITY if values["to_world"] is None else values["to_world"]
        getattr(self, f"_{kind}")(node, values, solid)
        self.rows[kind].append((*row, len(self.names)))
        self.names.append(node.id or f"{node.plugin}_{len(self.names)}")

    def arrays(self) -> dict[str, Any]:
        """The arguments of Scene."""
        spheres, inward = _spheres(self.spheres)
        result: dict[str, Any] = {
            "vertices": np.concatenate(self.vertices or [np.zeros((0, 3))]),
            "normals": np.concatenate(self.normals or [np.zeros((0, 3))]),
            "triangles": np.concatenate(self.triangles or [np.zeros((0, 3), np.int64)]),
            "spheres": spheres,
            "sphere_inward": inward,
            "disks": np.array(self.disks, np.float64).reshape(-1, 3, 3),
            "shape_names": tuple(self.names),
        }
        for kind, rows in self.rows.items():
            table = np.array(rows, np.int64).reshape(-1, 4)
            if kind == "triangle":
                table = np.repeat(table, self.counts, axis=0)
            for column, name in enumerate(("material", "emission", "boundary", "shape")):
                result[f"{kind}_{name}"] = table[:, column]
        return result

    def _sphere(self, node: Node, values: dict[str, Any], solid: str) -> None:
        ball = *values["center"], values["radius"]
        self.spheres.append((node, values["to_world"], ball, values["flip_normals"]))

    def _disk(self, node: Node, values: dict[str, Any], solid: str) -> None:
        matrix = values["to_world"]
        first, second = (0, 1)
        if values["flip_normals"] != (determinant(matrix) < 0):  # mirrors keep the front in front
            first, second = (1, 0)
        self.disks.append(np.stack([matrix[:3, 3], matrix[:3, first], matrix[:3, second]]))

    def _triangle(self, node: Node, values: dict[str, Any], solid: str) -> None:
        matrix, flip = values["to_world"], values["flip_normals"]
        normals = None
        if node.plugin in ("rectangle", "cube"):
            quad = node.plugin == "rectangle"
            vertices, faces = (_QUAD, _QUAD_FACES) if quad else (_CUBE, _CUBE_FACES)
            flip = flip != (determinant(matrix) < 0)  # a mirror keeps the front in front
            vertices = _placed(node, matrix, vertices)
        else:
            where = node.values["filename"].where
            path = Path(node.folder) / values["filename"]
            loaded = mesh.read(path, node.plugin, where)
            vertices, faces = _placed(node, matrix, loaded.vertices), loaded.triangles
            by_winding = values["face_normals"] or loaded.normals is None
            if by_winding and determinant(matrix) < 0:  # here too
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
        if normals is None:
            normals = np.zeros_like(vertices)
        self.vertices.append(vertices)
        self.normals.append(-normals if flip else normals)
        self.triangles.append((faces[:, ::-1] if flip else faces) + self.vertex_count)
        self.counts.append(len(faces))
        self.vertex_count += len(vertices)


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
        raise SceneError(f"{node}: a vertex exceeds {MAX_COORDINATE:g}", node.where)
    return placed


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
