"""Sensors at a shape: `irradiancemeter`, and `distant` with a shape as its target."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Any

import numpy as np
import numpy.typing as npt

from .. import transform
from ..camera import PATCH_KINDS, Camera
from ..errors import SceneError
from ..numeric import MAX_COORDINATE, determinant
from .node import Node, Ref, shorten
from .report import Report
from .shapes import IDENTITY, Shapes
from .values import check

Array = npt.NDArray[Any]
Resolve = Callable[[Ref, Node], Node]
_NO_ROWS = (0, -1, -1)  # of material, emission and boundary
_FOV = 90.0  # without effect
_DEEPEST = 8  # merges in each other; one that holds itself has no end


@dataclass
class Held:
    """The sensors of a scene in their order, and by a sensor's id() the shape that holds it."""

    nodes: list[Node] = field(default_factory=list)
    shapes: dict[int, Node] = field(default_factory=dict)

    def of(self, sensor: Node) -> Node:
        """The shape that holds a sensor."""
        shape = self.shapes.get(id(sensor))
        if shape is None:
            raise SceneError(f"{sensor} is in no shape, or in one of a group", sensor.where)
        return shape

    def add(self, shape: Node, ids: dict[str, Node], depth: int = _DEEPEST) -> None:
        """Adds the sensors of a shape, or of those of a merge."""
        for item in shape.children:  # without calls, as there are many shapes
            child: Any = ids.get(item.id) if type(item) is Ref else item
            if child is None:
                continue
            if child.category == "sensor":
                self.nodes.append(child)
                self.shapes[id(child)] = shape
            elif child.category == "shape" and shape.plugin == "merge" and depth:
                self.add(child, ids, depth - 1)


def of_scene(items: list[Node | Ref], ids: dict[str, Node]) -> Held:
    """The sensors among the objects of a scene, and of its shapes; ids: objects by theirs."""
    held = Held()
    for item in items:
        child: Any = ids.get(item.id) if type(item) is Ref else item
        if child is None:
            continue
        if child.category == "sensor":
            held.nodes.append(child)
        elif child.category == "shape" and child.children:
            held.add(child, ids)
    return held


def patches(node: Node, report: Report | None = None) -> Array:
    """A shape as the patches of a Camera."""
    values = check(node, report)
    if values["to_world"] is None:
        values["to_world"] = IDENTITY
    matrix, flip = values["to_world"], values["flip_normals"]
    if node.plugin == "rectangle":
        with np.errstate(all="ignore"):
            corner = transform.apply(matrix, np.array([-1.0, -1.0, 0.0]))
        side = -1.0 if flip != (determinant(matrix) < 0) else 1.0
        numbers = [corner, 2 * matrix[:3, 0], 2 * matrix[:3, 1]]
        found = _rows("parallelogram", np.array([side]), *(v[None] for v in numbers))
    else:
        shapes = Shapes()
        shapes.add((node, values, _NO_ROWS, ""))
        found = _of_arrays(shapes.arrays())
    if not len(found) or not np.abs(found[:, 2:]).max() <= MAX_COORDINATE:
        raise SceneError(f"{node}: a sensor cannot be at it", node.where)
    return found


def _of_arrays(arrays: dict[str, Any]) -> Array:
    vertices, faces, normals = (arrays[name] for name in ("vertices", "triangles", "normals"))
    a, b, c = (vertices[faces[:, k]] for k in range(3))
    side = np.ones(len(faces))
    if normals is not None and len(faces):
        outwards = normals[faces].sum(axis=1)
        side[(np.cross(b - a, c - a) * outwards).sum(axis=1) < 0] = -1.0
    disks, spheres = arrays["disks"], arrays["spheres"]
    inward = np.where(arrays["sphere_inward"], -1.0, 1.0)
    radii = spheres[:, 3:] * [1.0, 0.0, 0.0]
    return np.concatenate(
        [
            _rows("triangle", side, a, b - a, c - a),
            _rows("sphere", inward, spheres[:, :3], radii, np.zeros_like(radii)),
            _rows("disk", np.ones(len(disks)), *(disks[:, k] for k in range(3))),
        ]
    )


def _rows(kind: str, side: Array, point: Array, a: Array, b: Array) -> Array:
    kinds = np.full((len(side), 1), float(PATCH_KINDS.index(kind)))
    return np.concatenate([kinds, side[:, None], point, a, b], axis=1)


def irradiance(shape: Node, medium: int) -> Camera:
    """The camera of an irradiancemeter that a shape holds."""
    return _camera("irradiance", IDENTITY, patches(shape), medium)


def target(node: Node, items: list[Node | Ref], resolve: Resolve) -> Node | None:
    """The shape that is the target of a distant sensor; None if it has another or none."""
    for item in items:
        child = resolve(item, node) if isinstance(item, Ref) else item
        if child.category == "shape":
            if item.name != "target" or "target" in node.values:
                text = f'a shape {shorten(item.name)}, expected one "target", a point or a shape'
                raise SceneError(f"{node}: {text}", item.where)
            return child
    return None


def distant(shape: Node, turn: Array, medium: int, report: Report) -> Camera:
    """The camera of a distant sensor with a shape as its target; turn: its rays run along z."""
    return _camera("distant", turn, patches(shape, report), medium)


def _camera(projection: str, turn: Array, surface: Array, medium: int) -> Camera:
    camera = Camera(turn, _FOV, medium=medium, projection=projection, patches=surface)
    placed = transform.compose(transform.translate(camera.around[0].tolist()), turn)
    return Camera(placed, _FOV, medium=medium, projection=projection, patches=surface)
