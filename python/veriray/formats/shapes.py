"""From shape objects to the primitives of a scene."""

from __future__ import annotations

import warnings
from collections.abc import Collection, Mapping
from pathlib import Path
from typing import Any, NoReturn

import numpy as np
import numpy.typing as npt

from .. import transform
from ..chunks import in_chunks
from ..columns import MATERIAL_KINDS
from ..errors import SceneError, SceneWarning
from ..numeric import MAX_COORDINATE, Fresh, determinant, fresh, mirrors, repeated
from . import creases, curves, cylinder, ellipsoids, mesh, sdf, spheres
from .node import Node, shorten
from .textures import Attribute

Array = npt.NDArray[Any]
_DIELECTRICS = [
    MATERIAL_KINDS.index(name)
    for name in ("dielectric", "roughdielectric", "roughdielectric_whole", "principled_open")
]
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
IDENTITY = np.eye(4)
IDENTITY.setflags(write=False)
_CUBE_FACES = np.concatenate([_QUAD_FACES + 4 * face for face in range(6)])


#: Shapes with the same faces whatever their size: local vertices, faces, texture coordinates.
_FLAT = {
    "rectangle": (_QUAD, _QUAD_FACES, _QUAD_UV),
    "cube": (_CUBE, _CUBE_FACES, _CUBE_UV),
}
_CHUNK = 256  # shapes that are placed together
#: What instances may add to a scene, which holds each as shapes of its own; a triangle takes
#: BYTES_A_TRIANGLE of a device, its tree included.
MAX_INSTANCED = {"shapes": 100_000, "triangles": 50_000_000}
BYTES_A_TRIANGLE = 240
#: A shape's node, its checked parameters, its indices of material, emission and boundary, and why
#: it must be closed, "" if it need not.
Surface = tuple[Node, dict[str, Any], tuple[int, int, int], str]
_Arrays = tuple[Array, Array, Array | None, Array | None]


class Shapes:
    """Shapes gathered one by one, with the rows of their material, emission and boundary."""

    TABLES = ("vertices", "triangles", "spheres", "disks")

    def __init__(
        self,
        textured: Mapping[int, list[Attribute]] | None = None,
        textured_lamps: Mapping[int, list[Attribute]] | None = None,
        shared_files: Collection[str] = (),
    ) -> None:
        #: materials with textures: what they read from meshes
        self.textured = {} if textured is None else textured
        self.textured_lamps = {} if textured_lamps is None else textured_lamps  # emissions, too
        #: of meshes that such a material is on: first vertex and triangle, node, mesh, attributes
        self.attributed: list[tuple[int, int, Node, mesh.Mesh, list[Attribute]]] = []
        #: warnings, of attributes that are read and not there, and of spheres: text and place
        self.warned: list[tuple[str, str]] = []
        self.names: list[str] = []
        self.flat: dict[str, list[tuple[Node, Array, bool, int, int]]] = {
            name: [] for name in _FLAT
        }
        #: first vertex and triangle; the shape, its mesh, and by what that is still to be moved
        self.meshes: list[tuple[int, int, Node, mesh.Mesh, Array | None]] = []
        self.shared: dict[int, mesh.Mesh] = {}  # meshes of shape groups, by their nodes' ids
        self.files: dict[Path, bytes] = {}  # the mesh file that was read last
        self.shared_files = shared_files  # names of files that several objects have
        #: their meshes, by path, plugin, number in the file and whether with attributes
        self.parsed: dict[tuple[Path, str, int, bool], mesh.Mesh] = {}
        self.spheres: list[spheres.Ball] = []
        self.instanced_spheres: set[int] = set()  # their numbers
        self.disks: list[Array] = []
        self.turned: list[bool] = []  # of discs: y stands before x
        self.rows: dict[str, list[tuple[int, int, int, int]]] = {
            "triangle": [],
            "sphere": [],
            "disk": [],
        }
        self.counts: list[int] = []
        self.places: list[str] = []  # of the shapes in the scene file
        self.vertex_count = self.triangle_count = 0
        self.instances: list[Node] = []
        self.cylinders: list[Node] = []
        self.stretched: list[Node] = []  # instances, once for each sphere that they stretch
        self.evened: dict[int, Array] = {}  # matrices of spheres in groups, by their nodes' ids
        #: how shapes are rendered that become meshes, a line each, and their places
        self.made: list[tuple[str, str]] = []
        self.instanced_shapes = self.instanced_triangles = 0
        self.extremes: dict[str, tuple[float, float]] = {}  # of arrays, as Mesh has them

    def instance(self, node: Node, to_world: Array | None, group: list[Surface]) -> None:
        """Adds the shapes of a group once more, moved by to_world. Raises SceneError if that makes
        more shapes or triangles than MAX_INSTANCED."""
        self.instances.append(node)
        to_world = IDENTITY if to_world is None else to_world
        own = np.array([self._own(node, values) for node, values, _, _ in group]).reshape(-1, 4, 4)
        with np.errstate(all="ignore"):
            moved = transform.compose(to_world, own)
        for surface, matrix in zip(group, moved, strict=True):
            before = self.triangle_count
            self.add(surface, (node, to_world, matrix))
            self.instanced_shapes += 1
            self.instanced_triangles += self.triangle_count - before
            for what, most in MAX_INSTANCED.items():
                if getattr(self, f"instanced_{what}") > most:
                    many = f"{len(self.instances)} instances make more than {most} {what}"
                    raise SceneError(
                        f"{node}: with it, {many} of their own; instances share no memory",
                        node.where,
                    )

    def _own(self, node: Node, values: dict[str, Any]) -> Array:
        """The to_world of a shape in a group; of a sphere it scales alike in all directions."""
        matrix: Array = values["to_world"]
        if node.plugin != "sphere" or not spheres.is_uneven(matrix):
            return matrix
        if id(node) not in self.evened:  # its surface keeps the node, and so its id
            ball = (*values["center"], values["radius"])
            self.evened[id(node)] = spheres.even(node, matrix, ball, self.warned)
        return self.evened[id(node)]

    def notes(self) -> list[tuple[str, str]]:
        """How shapes are rendered that are rendered as others: text and place of the first."""
        found = []
        if self.instances:
            text = (
                f"{len(self.instances)} instances are rendered as shapes of their own: "
                f"{self.instanced_shapes} shapes with {self.instanced_triangles} triangles, about "
                f"{-(-self.instanced_triangles * BYTES_A_TRIANGLE // 10**6)} MB"
            )
            found.append((text, self.instances[0].where))
        if self.cylinders:
            text = (
                f"{len(self.cylinders)} cylinders are rendered as prisms of {cylinder.SIDES} sides"
            )
            found.append((text, self.cylinders[0].where))
        if self.stretched:
            text = (
                f"{len(self.stretched)} spheres that instances stretch are rendered as meshes of "
                f"{spheres.TRIANGLES} triangles"
            )
            found.append((text, self.stretched[0].where))
        return found + self.made

    def add(self, surface: Surface, instance: tuple[Node, Array, Array] | None = None) -> None:
        """Adds the primitives of a shape; instance: what moves it further, its matrix, and the
        matrix of both."""
        node, values, row, _ = surface
        plugin = node.plugin
        wanted = self._attributes(surface) if self.textured or self.textured_lamps else []
        if wanted and plugin in ("sphere", "disk"):
            raise SceneError(
                f"{node}: its material or lamp reads {shorten(wanted[0].name)}; allowed: on meshes",
                node.where,
            )
        if wanted and plugin in _FLAT:
            self.warned += [(one.missing(node), node.where) for one in wanted]
        flip, matrix = values["flip_normals"], instance[2] if instance else values["to_world"]
        kind = "triangle"
        if plugin == "sphere" and instance and spheres.is_uneven(matrix):
            self.stretched.append(instance[0])
            self._mesh(surface, instance)
        elif plugin == "sphere":
            kind = plugin
            if instance:
                self.instanced_spheres.add(len(self.spheres))
            self.spheres.append((node, matrix, (*values["center"], values["radius"]), flip))
        elif plugin == "disk":
            kind = plugin
            # mirrors keep the front in front
            first, second = (1, 0) if flip != (determinant(matrix) < 0) else (0, 1)
            self.turned.append(first == 1)
            self.disks.append(np.stack([matrix[:3, 3], matrix[:3, first], matrix[:3, second]]))
        elif plugin in _FLAT:
            corners, faces, _ = _FLAT[plugin]
            place = self._room(len(corners), len(faces))
            self.flat[plugin].append((node, matrix, flip, *place))
        else:
            self._mesh(surface, instance)
        self.rows[kind].append((*row, len(self.names)))
        name = node.id or f"{plugin}_{len(self.names)}"
        if instance:
            name = f"{instance[0].id or f'instance_{len(self.instances) - 1}'}/{name}"
        self.names.append(name)
        self.places.append(instance[0].where if instance else node.where)

    def arrays(self, *, with_uv: bool = False) -> dict[str, Any]:
        """The arguments of Scene; with_uv: also the texture coordinates uv (V, 2) float32, zero
        for the vertices of meshes without, and what spheres and discs have for them."""
        balls = spheres.evened(self.spheres, self.instanced_spheres, self.warned)
        placed, inward = spheres.placed(balls)
        vertices, triangles, normals, uv = self._alone() or self._joined()
        result: dict[str, Any] = {
            "vertices": vertices,
            "normals": normals,
            "triangles": triangles,
            "spheres": placed,
            "sphere_inward": inward,
            "disks": np.array(self.disks, np.float64).reshape(-1, 3, 3),
            "shape_names": tuple(self.names),
        }
        if with_uv:
            result["uv"] = uv
            result["sphere_frame"] = spheres.frames(balls)
            result["disk_turned"] = np.array(self.turned, np.bool_)
        for kind, table_rows in self.rows.items():
            table = np.array(table_rows, np.int32).reshape(-1, 4).T
            for values, name in zip(
                table, ("material", "emission", "boundary", "shape"), strict=True
            ):
                if kind == "triangle":
                    values = _for_each(values, self.counts)
                result[f"{kind}_{name}"] = values
        return result

    def _alone(self) -> _Arrays | None:
        """The arrays of `_joined` where one mesh is all, which are then the mesh's own."""
        if len(self.meshes) != 1 or len(self.counts) != 1:
            return None
        *_, found, matrix = self.meshes[0]
        if matrix is not None or self.vertex_count >= 2**32:
            return None
        self.extremes = found.extremes
        return found.vertices, found.triangles, found.normals, found.uv

    def _joined(self) -> _Arrays:
        """Vertices, triangles, normals and texture coordinates of all meshes and flat shapes; the
        latter two None if no mesh has any."""
        vertices = np.empty((self.vertex_count, 3))
        index = np.uint32 if self.vertex_count < 2**32 else np.int64
        triangles = np.empty((self.triangle_count, 3), index)
        meshes = [found for *_, found, _ in self.meshes]
        normals = uv = None
        if any(found.normals is not None for found in meshes):
            normals = np.zeros_like(vertices)
        if any(self.flat.values()) or any(found.uv is not None for found in meshes):
            uv = np.zeros((self.vertex_count, 2), np.float32)
        for name, given in self.flat.items():
            local, local_faces, local_uv = _FLAT[name]
            for begin in range(0, len(given), _CHUNK):
                chunk = given[begin : begin + _CHUNK]
                _place(local, local_faces, chunk, vertices, triangles)
                if uv is not None:
                    begins = np.array([first for *_, first, _ in chunk])[:, None]
                    uv[begins + np.arange(len(local))] = local_uv
        for first, face, node, found, matrix in self.meshes:
            rows = slice(first, first + len(found.vertices))
            moved = found if matrix is None else _moved(node, matrix, found)
            vertices[rows] = moved.vertices
            faces = triangles[face : face + len(moved.triangles)]
            np.add(moved.triangles, first, out=faces, casting="unsafe")
            if normals is not None and moved.normals is not None:
                normals[rows] = moved.normals
            if uv is not None and moved.uv is not None:
                uv[rows] = moved.uv
        return vertices, triangles, normals, uv

    def fresh(self, arrays: dict[str, Any]) -> dict[str, Fresh]:
        """Of these, made by `arrays`, the large ones that need no further check."""
        found = {}
        for name in ("vertices", "triangles", "normals", "uv"):
            values = arrays.get(name)
            if values is not None and len(values):
                known = self.extremes.get(name)
                one = Fresh(values, known) if known else fresh(values)
                if one is not None:
                    found[name] = one
        return found

    def attribute(self, key: tuple[str, float, float, bool], count: int) -> Array:
        """The rows (count, 3) float32 of an attribute for all vertices or triangles, zero for those
        of meshes that do not show it or have it not; raises SceneError as `Attribute.of`."""
        rows, name = np.zeros((count, 3), np.float32), key[0]
        for vertex, triangle, node, found, wanted in self.attributed:
            first = vertex if name.startswith("vertex_") else triangle
            for one in wanted:
                if one.key != key:
                    continue
                if name not in found.attributes:
                    self.warned.append((one.missing(node, found), node.where))
                    continue
                values = one.of(node, found)
                if text := one.clipped(node, found):
                    self.warned.append((text, node.where))
                rows[first : first + len(values)] = values
        return rows

    def _room(self, vertices: int, triangles: int) -> tuple[int, int]:
        """Numbers of the first vertex and triangle of a shape that has so many."""
        place = self.vertex_count, self.triangle_count
        self.vertex_count += vertices
        self.triangle_count += triangles
        self.counts.append(triangles)
        return place

    def _mesh(self, surface: Surface, instance: tuple[Node, Array, Array] | None) -> None:
        """Adds a mesh that is read, or made; of a shape in a group only once."""
        key = id(surface[0])
        found = self.shared.get(key) if instance else None
        if found is None:
            found = self._prepared(surface)
        if instance:
            self.shared[key] = found
        place = self._room(len(found.vertices), len(found.triangles))
        node, moved, _ = instance or (surface[0], None, None)
        self.meshes.append((*place, node, found, moved))
        wanted = self._attributes(surface)
        if wanted:
            self.attributed.append((*place, surface[0], found, wanted))

    def _attributes(self, surface: Surface) -> list[Attribute]:
        """What the material and the lamp of a shape read from its mesh."""
        material, emission, _ = surface[2]
        return [*self.textured.get(material, ()), *self.textured_lamps.get(emission, ())]

    def _prepared(self, surface: Surface) -> mesh.Mesh:
        """A mesh after its to_world, front where it belongs; normals of unit length or None."""
        node, values, _, solid = surface
        matrix, normals = values["to_world"], None
        wanted = bool(self._attributes(surface))
        loaded, name = self._loaded(node, values, wanted)
        if not len(loaded.triangles):
            return loaded
        if node.plugin == "cylinder":
            self.cylinders.append(node)
            matrix = cylinder.matrix(node, values, matrix)
        elif node.plugin == "sphere":
            matrix = transform.compose(
                self._own(node, values),
                transform.compose(
                    transform.translate(values["center"]), transform.scale([values["radius"]] * 3)
                ),
            )
        elif node.plugin in curves.KINDS:
            matrix = IDENTITY  # applied already, to points but not to radii
        vertices, reach = _placed(node, matrix, loaded)
        faces = loaded.triangles
        flat, angle = values.get("face_normals", False), values.get("max_smooth_angle")
        flat = flat or values.get("disable_vertex_normals", False)
        flat = flat or node.plugin == "ellipsoidsmesh"
        if angle is not None:
            if flat:
                raise SceneError(
                    f"{node}: both face_normals and max_smooth_angle given", node.where
                )
            whole = mesh.Mesh(vertices, faces, None, loaded.uv, loaded.attributes)
            loaded = creases.split(whole, angle)
            vertices, faces = loaded.vertices, loaded.triangles
        if determinant(matrix) < 0:
            faces = faces[:, ::-1]  # a mirror keeps the front in front
        if not flat:
            normals = _normals(matrix, vertices, faces, loaded)
        if normals is not None:
            faces, plain = mesh.shading(vertices, faces, normals)
            if plain:
                normals = None
        if solid and name and not mesh.is_closed(vertices, faces):
            warnings.warn(
                f"{name[0]}: {node}: the mesh {name[1]}is open, but {solid}: light leaks through "
                "the edges",
                SceneWarning,
                stacklevel=8,
            )
        if values["flip_normals"]:
            faces, normals = faces[:, ::-1], None if normals is None else -normals
        uv = loaded.uv
        if uv is not None and values.get("flip_tex_coords"):
            uv = np.stack([uv[:, 0], 1.0 - uv[:, 1]], axis=1)
        known = {"vertices": reach}
        if "triangles" in loaded.extremes:
            known["triangles"] = loaded.extremes["triangles"]
        found = mesh.Mesh(vertices, faces, normals, uv, loaded.attributes, known)
        material, emission, _ = surface[2]
        if uv is None and (material in self.textured or emission in self.textured_lamps):
            return mesh.barycentric(found, loaded.triangles)
        return found

    def _loaded(
        self, node: Node, values: dict[str, Any], wanted: bool
    ) -> tuple[mesh.Mesh, tuple[str, ...]]:
        """The mesh of a shape, and where it is named and how; no name for one that is made.

        wanted: its attributes are.
        """
        if node.plugin == "cylinder":
            placed = cylinder.matrix(node, values, values["to_world"])
            return cylinder.unit(cylinder.rings(placed)), ()
        if node.plugin == "sphere":
            return spheres.unit(), ()
        if node.plugin == "mesh":
            return mesh.given(node), (node.where, "")
        if node.plugin == "sdfgrid":
            loaded, text = sdf.surface(node, values)
            self.made.append((f"{node}: {text}", node.where))
            return loaded, (node.where, "")
        if node.plugin in ellipsoids.KINDS:
            loaded, text = ellipsoids.surface(node, values)
            if ellipsoids.uneven(values["to_world"]):
                told = (
                    f"{node}: to_world scales unevenly; Mitsuba scales its ellipsoids by the mean"
                )
                self.warned.append((told, node.values["to_world"].where))
            if text:
                self.made.append((f"{node}: {text}", node.where))
            return loaded, (node.where, "")
        where = node.values["filename"].where
        path = Path(node.folder) / values["filename"]
        if node.plugin in curves.KINDS:
            loaded, sides, count = curves.read(path, node.plugin, values["to_world"], where)
            many = len(loaded.triangles)
            text = f"{count} curve{'s' * (count != 1)} rendered as prisms of {sides} sides: "
            text += f"{many} triangles, about {-(-many * BYTES_A_TRIANGLE // 10**6)} MB"
            self.made.append((f"{node}: {text}", node.where))
            return loaded, (where, f"{shorten(str(path))} ")
        key = path, node.plugin, values.get("shape_index", 0), wanted
        found = self.parsed.get(key)
        if found is None:
            found = mesh.read(path, node.plugin, where, key[2], self.files, attributes=wanted)
            if values["filename"] in self.shared_files:
                self.parsed[key] = found
        return found, (where, f"{shorten(str(path))} ")


def _for_each(values: Array, counts: list[int]) -> Array:
    """A shape's value for each of its triangles."""
    if len(values) and (values == values[0]).all():
        return repeated(values[0], (sum(counts),), values.dtype)
    return np.repeat(values, counts)


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


def _placed(node: Node, matrix: Array, found: mesh.Mesh) -> tuple[Array, tuple[float, float]]:
    """A mesh's vertices after a matrix, without -0, and their extremes."""
    vertices = found.vertices
    if "vertices" in found.extremes and (matrix is IDENTITY or (matrix == IDENTITY).all()):
        return vertices, found.extremes["vertices"]
    placed = np.empty_like(vertices)

    def move(first: int, last: int) -> tuple[float, float]:
        out = placed[first:last]
        with np.errstate(all="ignore"):
            np.add(transform.apply(matrix, vertices[first:last]), 0.0, out=out)
        return float(out.min()), float(out.max())

    extremes = np.array(in_chunks(move, len(vertices), 1 << 13)).reshape(-1, 2)
    if not (np.abs(extremes) <= MAX_COORDINATE).all():  # NaN too
        _too_far(node)
    low, high = (extremes[:, 0].min(), extremes[:, 1].max()) if len(extremes) else (0.0, 0.0)
    return placed, (float(low), float(high))


def _moved(node: Node, matrix: Array, found: mesh.Mesh) -> mesh.Mesh:
    """A mesh moved by an instance's matrix; a mirror keeps the front in front."""
    faces = found.triangles[:, ::-1] if determinant(matrix) < 0 else found.triangles
    normals = found.normals
    if normals is not None:
        normals = mesh.unit(transform.apply(transform.for_normals(matrix), normals))
    vertices, reach = _placed(node, matrix, found)
    extremes = {**found.extremes, "vertices": reach}
    return mesh.Mesh(vertices, faces, normals, found.uv, {}, extremes)


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
    return "is a dielectric" if row["material_kind"] in _DIELECTRICS else ""
