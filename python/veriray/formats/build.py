"""From a tree to a scene: checks every object against `plugins`, then makes the arrays."""

from __future__ import annotations

import math
import re
import warnings
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

from ..errors import SceneError, SceneWarning
from ..scene import MAX_COORDINATE, Camera, Film, Scene, check_matrix, determinant
from . import mesh, transform
from .node import Node, Ref, Tree, allowed, parse_float, shorten
from .plugins import COLOUR, PLUGINS, REQUIRED, Param

Array = npt.NDArray[Any]
_DIAGONAL_35_MM = math.sqrt(36.0 * 36.0 + 24.0 * 24.0)
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
_CUBE_FACES = np.concatenate([_QUAD_FACES + 4 * face for face in range(6)])


def build(tree: Tree) -> Scene:
    """The scene of a tree. Raises SceneError naming place, object, key, value and what is allowed;
    warns (SceneWarning) of a scene without light."""
    return _Builder(tree).scene()


def check(node: Node) -> dict[str, Any]:
    """A node's parameters, converted and complete with defaults; None for absent ones."""
    plugin = PLUGINS[node.plugin]
    for name, value in node.values.items():
        if name in plugin.unsupported:
            raise SceneError(f'{node}: "{name}": {plugin.unsupported[name]}', value.where)
        if name not in plugin.params:
            raise SceneError(
                f'{node}: unknown parameter "{name}" = {shorten(value.value)}'
                + allowed(name, plugin.params),
                value.where,
            )
    result = {}
    for name, param in plugin.params.items():
        if name in node.values:
            result[name] = _parameter(node, name, param)
        elif param.default is REQUIRED:
            raise SceneError(f'{node}: "{name}" ({param.kind}) is missing', node.where)
        else:
            colour = param.kind == COLOUR and param.default is not None
            result[name] = (param.default,) * 3 if colour else param.default
    return result


def _parameter(node: Node, name: str, param: Param) -> Any:
    given = node.values[name]
    label = f'{node}: "{name}" = {shorten(given.value)}'
    if given.kind not in param.accepted:
        raise SceneError(f"{label} is of type {given.kind}, expected {param.kind}", given.where)
    value = given.value
    if param.kind == "transform":
        try:
            return check_matrix(f'{node}: "{name}"', value)
        except SceneError as error:
            raise SceneError(str(error), given.where) from None
    if param.kind == "string":
        value = value.lower() if param.choices else value
    if param.choices and value not in param.choices:
        names = [str(choice).lower() for choice in param.choices]
        raise SceneError(f"{label} is not supported{allowed(str(value), names)}", given.where)
    if param.kind == "boolean" or param.kind == "string":
        return value
    if param.kind == COLOUR:
        value = value if isinstance(value, tuple) else (float(value),) * 3
    for number in value if isinstance(value, tuple) else (value,):
        good = param.low < number < param.high if param.open else param.low <= number <= param.high
        if number != number or number in (math.inf, -math.inf):
            raise SceneError(f"{label} must be finite", given.where)
        if not good:
            ends = "()" if param.open else "[]"
            raise SceneError(
                f"{label} is outside {ends[0]}{param.low:g}, {param.high:g}{ends[1]}", given.where
            )
    if param.kind == COLOUR and max(value) > float(np.finfo(np.float32).max):
        raise SceneError(f"{label} exceeds the float32 range", given.where)
    return float(value) if param.kind == "float" else value


class _Builder:
    def __init__(self, tree: Tree) -> None:
        self.tree = tree
        self.checked: dict[int, tuple[Node, dict[str, Any]]] = {}

    def check(self, node: Node) -> dict[str, Any]:
        """`check`, once for each node however often it is used."""
        if id(node) not in self.checked:
            self.checked[id(node)] = node, check(node)  # holding the node keeps its id unique
        return self.checked[id(node)][1]

    def children(self, node: Node) -> dict[str, list[Node]]:
        """A node's objects by category, references resolved, kinds and numbers checked."""
        rules = PLUGINS[node.plugin].children
        result: dict[str, list[Node]] = {category: [] for category in rules}
        for item in node.children:
            if isinstance(item, Ref) and node.category == "scene":
                raise SceneError("a ref must stand inside the object that uses it", item.where)
            child = self.resolve(item, node) if isinstance(item, Ref) else item
            names = [name for allowed_names, _, _ in rules.values() for name in allowed_names]
            if child.category not in rules or child.plugin not in rules[child.category][0]:
                raise SceneError(
                    f"{node} cannot hold a {child.category} {shorten(child.plugin)}"
                    + allowed(child.plugin, names),
                    item.where,
                )
            result[child.category].append(child)
        for category, (names_, fewest, most) in rules.items():
            found = result[category]
            if len(found) < fewest:
                what = f"{node} has no {category}"
                raise SceneError(f"{what}; allowed: {', '.join(names_)}", node.where)
            if len(found) > most:
                raise SceneError(
                    f"{node} has {len(found)} objects of category {category}, at most {most} "
                    "allowed",
                    found[most].where,
                )
        return result

    def resolve(self, ref: Ref, node: Node) -> Node:
        if ref.id not in self.tree.ids:
            raise SceneError(
                f"{node}: there is no object with the id {shorten(ref.id)}"
                + allowed(ref.id, self.tree.ids, "known"),
                ref.where,
            )
        return self.tree.ids[ref.id]

    def scene(self) -> Scene:
        root = self.tree.scene
        parts = self.children(root)
        check(root)
        integrator = parts["integrator"][0] if parts["integrator"] else Node("path", root.where)
        path = self.check(integrator)
        camera, film, sampler = self.sensor(parts["sensor"][0])
        environment = (0.0, 0.0, 0.0)
        for emitter in parts["emitter"]:
            environment = self.check(emitter)["radiance"]
        for bsdf in parts["bsdf"]:
            self.material(bsdf)
        geometry = _Geometry()
        for shape in parts["shape"]:
            self.shape(shape, geometry)
        if not geometry.emissions and not any(environment):
            warnings.warn(
                f"{root.where}: the scene has no light: the picture will be black",
                SceneWarning,
                stacklevel=4,
            )
        scene: Scene = _located(
            root,
            lambda: Scene(
                **geometry.arrays(),
                environment=np.array(environment),
                camera=camera,
                film=film,
                max_depth=path["max_depth"],
                rr_depth=path["rr_depth"],
                spp=sampler["sample_count"],
                seed=sampler["seed"],
            ),
        )
        return scene

    def sensor(self, node: Node) -> tuple[Camera, Film, dict[str, Any]]:
        parts = self.children(node)
        values = self.check(node)
        film_node = parts["film"][0] if parts["film"] else Node("hdrfilm", node.where)
        sampler = parts["sampler"][0] if parts["sampler"] else Node("independent", node.where)
        filters = self.children(film_node)["rfilter"]
        filter_node = filters[0] if filters else Node("gaussian", film_node.where)
        size = self.check(film_node)
        parameters = list(self.check(filter_node).values())
        film = _located(
            film_node,
            lambda: Film(
                size["width"],
                size["height"],
                filter_node.plugin,
                parameters[0] if parameters else None,
            ),
        )
        fov, axis = values["fov"], values["fov_axis"]
        focal = values["focal_length"]
        if (fov is None) == (focal is None):
            both = "both fov and focal_length" if focal else "neither fov nor focal_length"
            raise SceneError(f"{node}: {both} given, expected one of them", node.where)
        if focal is not None:
            where = node.values["focal_length"].where
            number = re.sub(r"\s*mm\s*$", "", focal)
            length = parse_float(number, f'{node}: "focal_length"', where)
            if not 1e-3 <= length <= 1e6:
                raise SceneError(
                    f'{node}: "focal_length" = {shorten(focal)} is outside [0.001, 1e+06] mm', where
                )
            angle = math.degrees(2.0 * math.atan(_DIAGONAL_35_MM / (2.0 * length)))
            fov = round(angle, 12)  # atan differs in the last bit between C libraries
            axis = "diagonal"
        offset = [values[f"principal_point_offset_{end}"] for end in "xy"]
        to_world = np.eye(4) if values["to_world"] is None else values["to_world"]
        camera = _located(
            node,
            lambda: Camera(
                to_world, fov, axis, values["near_clip"], values["far_clip"], np.array(offset)
            ),
        )
        return camera, film, self.check(sampler)

    def material(self, node: Node) -> tuple[tuple[float, ...], bool]:
        """Reflectance and two-sidedness of a bsdf."""
        if node.plugin == "twosided":
            self.check(node)
            inner = self.children(node)["bsdf"][0]
            return self.material(inner)[0], True
        self.children(node)
        reflectance: tuple[float, ...] = self.check(node)["reflectance"]
        return reflectance, False

    def shape(self, node: Node, geometry: _Geometry) -> None:
        parts = self.children(node)
        values = self.check(node)
        to_world = np.eye(4) if values["to_world"] is None else values["to_world"]
        flip = values["flip_normals"]
        if node.plugin in ("rectangle", "cube"):
            quad = node.plugin == "rectangle"
            vertices, faces = (_QUAD, _QUAD_FACES) if quad else (_CUBE, _CUBE_FACES)
            flip = flip != (determinant(to_world) < 0)  # a mirror keeps the front in front
        else:
            where = node.values["filename"].where
            path = Path(node.folder) / values["filename"]
            vertices, faces, flat = mesh.read(path, node.plugin, where)
            if not (flat or values["face_normals"]):
                raise SceneError(
                    f"{node}: the mesh {shorten(str(path))} is smooth (it has vertex normals, or "
                    "gets them in Mitsuba), and smooth shading is not supported; set "
                    "face_normals = true for flat shading",
                    where,
                )
        with np.errstate(all="ignore"):
            vertices = transform.apply(to_world, vertices)
        if not (np.abs(vertices) <= MAX_COORDINATE).all():
            raise SceneError(f"{node}: a vertex exceeds {MAX_COORDINATE:g}", node.where)
        bsdf = parts["bsdf"][0] if parts["bsdf"] else geometry.default_bsdf
        material = geometry.material(bsdf, self.material(bsdf))
        emission = -1
        for emitter in parts["emitter"]:
            self.children(emitter)
            emission = geometry.emission(emitter, self.check(emitter)["radiance"])
        geometry.add(
            node.id or f"{node.plugin}_{len(geometry.names)}",
            vertices,
            faces[:, ::-1] if flip else faces,
            material,
            emission,
        )


class _Geometry:
    """Shapes, materials and emissions gathered one by one."""

    def __init__(self) -> None:
        self.default_bsdf = Node("diffuse", "", "bsdf")
        self.names: list[str] = []
        self.vertices: list[Array] = []
        self.triangles: list[Array] = []
        self.per_shape: list[tuple[int, int]] = []
        self.materials: dict[int, int] = {}
        self.reflectance: list[tuple[float, ...]] = []
        self.two_sided: list[bool] = []
        self.emitters: dict[int, int] = {}
        self.emissions: list[tuple[float, ...]] = []
        self.count = 0

    def material(self, node: Node, material: tuple[tuple[float, ...], bool]) -> int:
        index = self.materials.setdefault(id(node), len(self.reflectance))
        if index == len(self.reflectance):
            self.reflectance.append(material[0])
            self.two_sided.append(material[1])
        return index

    def emission(self, node: Node, radiance: tuple[float, ...]) -> int:
        """Index of the emission; -1 for a black one, which is no light."""
        if not any(np.float32(x) for x in radiance):
            return -1
        index = self.emitters.setdefault(id(node), len(self.emissions))
        if index == len(self.emissions):
            self.emissions.append(radiance)
        return index

    def add(self, name: str, vertices: Array, faces: Array, material: int, emission: int) -> None:
        self.names.append(name)
        self.vertices.append(vertices)
        self.triangles.append(faces + self.count)
        self.per_shape.append((material, emission))
        self.count += len(vertices)

    def arrays(self) -> dict[str, Any]:
        lengths = [len(t) for t in self.triangles]
        table = np.array(self.per_shape, np.int64).reshape(-1, 2)
        return {
            "vertices": np.concatenate(self.vertices or [np.zeros((0, 3))]),
            "triangles": np.concatenate(self.triangles or [np.zeros((0, 3), np.int64)]),
            "triangle_material": np.repeat(table[:, 0], lengths),
            "triangle_emission": np.repeat(table[:, 1], lengths),
            "triangle_shape": np.repeat(np.arange(len(lengths)), lengths),
            "reflectance": np.array(self.reflectance, np.float64).reshape(-1, 3),
            "two_sided": np.array(self.two_sided, np.bool_),
            "emissions": np.array(self.emissions, np.float64).reshape(-1, 3),
            "shape_names": tuple(self.names),
        }


def _located(node: Node, make: Callable[[], Any]) -> Any:
    """make(), with the node's place added to its SceneError."""
    try:
        return make()
    except SceneError as error:
        raise SceneError(str(error), node.where) from None
