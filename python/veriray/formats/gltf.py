"""glTF 2.0 scenes (.gltf, .glb): meshes where their nodes put them, a camera, lights and colours.

Materials are those of `gltf_materials`; they shine on their fronts, doubleSided ones from a copy of
the shape on their backs, too. Light keeps its numbers: candela, lux and nits are taken for what
they are in watts. A spot of KHR_lights_punctual falls off linearly between its angles. The first
camera is taken; without one the scene is framed from its front. Without a light there is a white
sky. Skins, morph targets and animations stay at rest.
"""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

from .. import transform
from ..errors import SceneError
from ..numeric import MAX_COORDINATE, check_matrix, determinant, sin_cos_degrees
from . import gltf_tangents
from .gltf_json import File, Json
from .gltf_json import read as read_json
from .gltf_materials import Materials, named
from .node import Node, Tree, Value, shorten
from .plugins import PLUGINS
from .report import Report

Array = npt.NDArray[Any]
WIDTH, HEIGHT, SPP, FOV = 768, 576, 64, 40.0
#: Required extensions without which a file can still be shown.
_OPTIONAL = ("KHR_lights_punctual", "KHR_mesh_quantization", "KHR_texture_", "KHR_materials_",
             "EXT_texture_", "KHR_xmp", "KHR_animation_pointer")  # fmt: skip
_MODES = ("POINTS", "LINES", "LINE_LOOP", "LINE_STRIP", "TRIANGLES", "STRIP", "FAN")
#: Extensions of nodes, meshes, scenes and the file that are applied, named elsewhere or only tell.
_TAKEN = ("KHR_lights_punctual", "EXT_mesh_gpu_instancing", "KHR_node_visibility", "KHR_xmp")
_BACK = ".back"  # ends the name of the side from which a lamp shines backwards
_MIRRORED = ".mirrored"  # ends the name of what shows a texture of normals so, of two parts
_TO_SENSOR = np.diag([-1.0, 1.0, -1.0, 1.0])  # looks along -z, +x right; a sensor along +z, +x left


def read(path: Path, parameters: Mapping[str, object], report: Report | None = None) -> Tree:
    """Reads a file. Raises SceneError; `report` takes what is not shown."""
    for key in parameters:
        raise SceneError(f"parameter {shorten(key)} is not used by the scene", str(path))
    report = Report() if report is None else report
    return _Reader(read_json(path), str(path), report).tree()


class _Reader:
    def __init__(self, file: File, where: str, report: Report) -> None:
        self.file, self.where, self.report = file, where, report
        self.looks = Materials(file, report)
        self.materials: dict[tuple[int | None, bool], Node] = {}  # and whether mirrored
        self.lamps: dict[int | None, Node | None] = {}  # of materials
        self.groups: dict[tuple[int, bool], Node] = {}  # of meshes, and whether mirrored
        self.endings: dict[tuple[int, bool], list[str]] = {}  # of the names of a group's shapes
        self.cameras: list[tuple[Json, Array]] = []
        self.lights: list[Node] = []
        self.corners: list[Array] = []  # of the boxes around meshes, in world space
        self.uses: Counter[int | None] = Counter()  # of meshes
        self.names: dict[str, int] = {}  # of nodes and shapes, and how often they were met
        self.shines = False

    def tree(self) -> Tree:
        root = self.file.root
        for name in root.rows("extensionsRequired"):
            if not isinstance(name, str) or not name.startswith(_OPTIONAL):
                raise root.fail(f"the extension {shorten(name)} is required and not supported")
        for what in ("skins", "animations"):
            if root.rows(what):
                self.report.warn(f"{what} are not applied", self.where)
        for row in (root, *self.file.tables["scenes"], *self.file.tables["meshes"]):
            self.unread(row)
        tree = Tree(Node("scene", self.where, "scene"), report=self.report)
        placed = self.placed()
        meshes = self.file.tables["meshes"]
        self.uses = Counter(node.index("mesh", meshes) for node, _, shown in placed if shown)
        shapes = [shape for found in placed for shape in self.shapes(*found)]
        children = tree.scene.children
        children += [self.sensor(), *shapes, *self.lights]
        if not self.lights and not self.shines:
            self.report.warn("the file has no light; a white sky was added", self.where)
            children.append(Node("constant", self.where, "emitter"))
        return tree

    def unread(self, row: Json) -> None:
        """Names the extensions of a part of the file that are not applied."""
        for name in row.of("extensions").content:
            if not name.startswith(_TAKEN):
                text = f"the extension {shorten(name)} is not applied"
                self.report.warn(text, self.where if row is self.file.root else row.where)

    def placed(self) -> list[tuple[Json, Array, bool]]:
        """All nodes of the scene, what takes them to world space, and whether they are shown."""
        nodes, scenes = self.file.tables["nodes"], self.file.tables["scenes"]
        if scenes:
            roots = _indices(scenes[self.file.root.index("scene", scenes) or 0], "nodes", nodes)
        else:
            held = {k for node in nodes for k in _indices(node, "children", nodes)}
            roots = [k for k in range(len(nodes)) if k not in held]
        result, met = [], set()
        todo = [(k, np.eye(4), True) for k in reversed(roots)]
        while todo:
            number, above, shown = todo.pop()
            node = nodes[number]
            if number in met:
                raise node.fail("the node is met twice")
            met.add(number)
            with np.errstate(all="ignore"):
                matrix = transform.compose(above, _local(node))
            if not (np.abs(matrix) <= MAX_COORDINATE).all():
                raise node.fail(f"its place exceeds {MAX_COORDINATE:g}")
            self.unread(node)
            shown = shown and node.of("extensions").of("KHR_node_visibility").flag("visible", True)
            result.append((node, matrix, shown))
            todo += [(k, matrix, shown) for k in reversed(_indices(node, "children", nodes))]
        return result

    def shapes(self, node: Json, matrix: Array, shown: bool) -> list[Node]:
        """The shapes of a node's mesh, if that is shown; its camera and light are kept."""
        cameras = self.file.tables["cameras"]
        camera = node.index("camera", cameras)
        if camera is not None:
            self.cameras.append((cameras[camera], matrix))
        if not shown:
            return []
        lights = self.file.root.of("extensions").of("KHR_lights_punctual").all("lights")
        light = node.of("extensions").of("KHR_lights_punctual").index("light", lights)
        if light is not None:
            self.lights += self.light(lights[light], matrix)
        number = node.index("mesh", self.file.tables["meshes"])
        if number is None:
            return []
        if "EXT_mesh_gpu_instancing" in node.of("extensions").content:
            self.report.warn("EXT_mesh_gpu_instancing: one instance of each is shown", node.where)
        flip = determinant(matrix) < 0
        group = self.group(number, flip)
        try:
            check_matrix("matrix", matrix)
        except SceneError:
            self.report.warn("a mesh whose node flattens space is not shown", node.where)
            return []
        children = [child for child in group.children if isinstance(child, Node)]
        picks = np.array([[k >> axis & 1 for axis in range(3)] for k in range(8)])
        for child in children:
            points = child.values["vertices"].value
            ends = np.stack([points.min(axis=0), points.max(axis=0)])
            self.corners.append(transform.apply(matrix, ends[picks, np.arange(3)]))
        place = {"to_world": Value("transform", matrix, node.where)}
        name = node.text("name") or self.file.tables["meshes"][number].text("name") or "mesh"
        name = self.unique(name)
        if self.uses[number] > 1:
            return [Node("instance", node.where, "shape", name, "", place, [group])]
        names = [self.unique(name + end) if end else name for end in self.endings[number, flip]]
        return [
            replace(child, values={**child.values, **place}, id=own)
            for child, own in zip(children, names, strict=True)
        ]

    def unique(self, name: str) -> str:
        """A name, with a number from its second use on."""
        self.names[name] = count = self.names.get(name, 0) + 1
        return name if count == 1 else f"{name}.{count - 1}"

    def group(self, number: int, flip: bool) -> Node:
        """The primitives of a mesh as a shape group, made once; flip: for a node that mirrors."""
        if (number, flip) not in self.groups:
            mesh = self.file.tables["meshes"][number]
            found = [self.primitive(part, mesh, flip) for part in mesh.all("primitives")]
            shown = [shapes for shapes in found if shapes]
            starts = [f"/{k}" if len(shown) > 1 else "" for k in range(len(shown))]
            self.endings[number, flip] = [
                start + end
                for start, shapes in zip(starts, shown, strict=True)
                for end, _ in shapes
            ]
            parts = [shape for shapes in shown for _, shape in shapes]
            self.groups[number, flip] = Node("shapegroup", mesh.where, "shape", children=[*parts])
        return self.groups[number, flip]

    def primitive(self, part: Json, mesh: Json, flip: bool) -> list[tuple[str, Node]]:
        """A mesh with the end of its name; two of it where a texture of normals lies mirrored on
        some triangles, and one more of each that shines backwards; none for points and lines."""
        accessors, attributes = self.file.tables["accessors"], part.of("attributes")
        mode = part.whole("mode", 4, len(_MODES) - 1) or 0
        place = attributes.index("POSITION", accessors)
        if mode < 4 or place is None:
            what = _MODES[mode] if mode < 4 else "a primitive without POSITION"
            self.report.warn(f"{what} is not shown", part.where)
            return []
        self.unused(part)
        arrays = {"vertices": self.file.array(place)}
        count = len(arrays["vertices"])
        if arrays["vertices"].shape[1] != 3:
            raise accessors[place].fail('"type" of a POSITION is not VEC3')
        index = part.index("indices", accessors)
        corners = np.arange(count) if index is None else self.file.array(index).ravel()
        faces = _triangles(corners, mode)
        if not len(faces) or not count:
            self.report.warn("a primitive without triangles is not shown", part.where)
            return []
        material = part.index("material", self.file.tables["materials"])
        about = Json({}, self.where)
        if material is not None:
            about = self.file.tables["materials"][material]
        self.material(material, about)
        textured = self.looks.sets.get(about.where)
        for key, name in (("uv", f"TEXCOORD_{textured or 0}"), ("normals", "NORMAL")):
            found = attributes.index(name, accessors)
            if found is not None:
                arrays[key] = self.file.array(found)
        if textured is not None and "uv" not in arrays:
            text = f"a textured primitive without TEXCOORD_{textured} shows one texel"
            self.report.warn(text, part.where)
            arrays["uv"] = np.zeros((count, 2))
        mirrored = np.zeros(len(faces), bool)
        if self.looks.turns(about):
            mirrored = self.mirrored(part, faces, arrays, flip)
        result: list[tuple[str, Node]] = []
        name = mesh.text("name")
        for side in np.unique(mirrored).tolist():
            values = _mesh(arrays, faces, mirrored == side, part.where)
            children: list[Any] = self.material(material, about, side)
            end = _MIRRORED if result else ""
            shape = Node("mesh", part.where, "shape", name and name + end, "", values, children)
            result.append((end, shape))
            if len(children) > 1 and self.shines_backwards(about, children[0]):
                values = {**values, "flip_normals": Value("boolean", True, part.where)}
                end += _BACK
                result.append((end, replace(shape, id=name and name + end, values=values)))
        return result

    def shines_backwards(self, about: Json, bsdf: Node) -> bool:
        """Whether a lamp of a material shines from the backs of its faces, too."""
        if not about.flag("doubleSided"):
            return False
        alike = bsdf.plugin == "twosided"
        alike |= bsdf.plugin == "mask" and about.text("alphaMode") == "MASK"
        if not alike:
            text = "a doubleSided material that lets light through shines on its front alone"
            self.report.warn(text, about.where)
        return alike

    def unused(self, part: Json) -> None:
        """Names what is not applied of a primitive."""
        for key in ("targets", "extensions"):
            if part.content.get(key):
                self.report.warn(f"{key} of a primitive are not applied", part.where)
        if "COLOR_0" in part.of("attributes").content:
            self.report.warn("colours of vertices are not shown", part.where)

    def mirrored(self, part: Json, faces: Array, arrays: dict[str, Array], flip: bool) -> Array:
        """Which triangles of a primitive show images mirrored, none if its arrays are no mesh's;
        TANGENT is compared with what is shown."""
        count = len(arrays["vertices"])
        widths = {"vertices": 3, "uv": 2, "normals": 3}
        sound = all(table.shape == (count, widths[name]) for name, table in arrays.items())
        sound = sound and faces.dtype.kind == "i" and 0 <= faces.min() <= faces.max() < count
        if "uv" not in arrays or not sound:
            return np.zeros(len(faces), bool)
        hand = gltf_tangents.handedness(arrays["uv"][faces])
        found = part.of("attributes").index("TANGENT", self.file.tables["accessors"])
        if found is not None and "normals" in arrays:
            if not gltf_tangents.agree(self.file.array(found), faces, hand, **arrays):
                text = "TANGENT is not what texture coordinates give, which are used instead"
                self.report.warn(text, part.where)
        return hand > 0 if flip else hand < 0

    def material(self, number: int | None, about: Json, mirrored: bool = False) -> list[Node]:
        """The bsdf and the emitter of a material, made once."""
        if (number, mirrored) not in self.materials:
            self.materials[number, mirrored] = self.looks.bsdf(about, mirrored)
        if number not in self.lamps:
            self.lamps[number] = self.emitter(about)
        lamp = self.lamps[number]
        return [self.materials[number, mirrored], *([] if lamp is None else [lamp])]

    def emitter(self, about: Json) -> Node | None:
        """What a material emits, on the front of a shape."""
        strength = about.of("extensions").of(_STRENGTH[0]).number("emissiveStrength", 1.0, 0.0)
        factor = about.numbers("emissiveFactor", (0.0,) * 3, 0.0) * strength
        if "KHR_materials_unlit" in about.of("extensions").content:
            return None
        texturable = PLUGINS["area"].params["radiance"].texturable
        if not factor.any() or "emissiveTexture" in about.content and not texturable:
            return None
        radiance = self.looks.radiance(about, tuple(factor.tolist()))
        if radiance is None:
            return None
        self.shines = True
        if isinstance(radiance, Node):
            return Node("area", about.where, "emitter", children=[named(radiance, "radiance")])
        values = {"radiance": Value("rgb", radiance, about.where)}
        return Node("area", about.where, "emitter", values=values)

    def light(self, about: Json, matrix: Array) -> list[Node]:
        """A punctual light; none for a dark one."""
        kind = about.text("type")
        if kind not in ("point", "spot", "directional"):
            raise about.fail(f'"type" = {shorten(kind)}, expected point, spot or directional')
        if "range" in about.content:
            self.report.warn("range of a light is not applied", about.where)
        power = about.numbers("color", (1.0,) * 3, 0.0) * about.number("intensity", 1.0, 0.0)
        if not power.any():
            return []
        name = "irradiance" if kind == "directional" else "intensity"
        place = transform.compose(_rigid(matrix, about), _TO_SENSOR)
        values = {name: Value("rgb", tuple(power.tolist()), about.where),
                  "to_world": Value("transform", place, about.where)}  # fmt: skip
        if kind == "spot":
            angles = about.of("spot")
            outer = math.degrees(angles.number("outerConeAngle", math.pi / 4, 0.0, math.pi / 2))
            inner = math.degrees(angles.number("innerConeAngle", 0.0, 0.0, math.pi / 2))
            values["cutoff_angle"] = Value("float", outer, about.where)
            values["beam_width"] = Value("float", inner, about.where)
        return [Node(kind, about.where, "emitter", about.text("name"), values=values)]

    def sensor(self) -> Node:
        """The first camera, else one that frames the scene."""
        for camera, matrix in self.cameras:
            if len(self.cameras) > 1:
                self.report.warn("the first of several cameras is taken", camera.where)
            place = transform.compose(_rigid(matrix, camera), _TO_SENSOR)
            if np.abs(place[:3, :3].T @ place[:3, :3] - np.eye(3)).max() > 1e-4:
                self.report.warn("its node shears it, and so its picture", camera.where)
            if camera.text("type") == "orthographic":
                view = camera.of("orthographic")
                x, y = (view.number(name, 0.0, 1e-12, 1e12) for name in ("xmag", "ymag"))
                width = max(1, round(HEIGHT * min(max(x / y, 1e-2), 1e2)))
                place = transform.compose(place, transform.scale([x, y * width / HEIGHT, 1.0]))
                return _sensor(camera.where, "orthographic", place, width, **_clips(view))
            view = camera.of("perspective")
            fov = math.degrees(view.number("yfov", 0.0, 0.0, math.pi))
            aspect = view.number("aspectRatio", WIDTH / HEIGHT, 1e-2, 1e2)
            width = max(1, round(HEIGHT * aspect))
            return _sensor(camera.where, "perspective", place, width, fov, "y", **_clips(view))
        if not self.corners:
            self.report.warn("the file shows no mesh", self.where)
        self.report.warn("the file has no camera; one was placed that frames it", self.where)
        corners = np.concatenate(self.corners) if self.corners else np.zeros((1, 3))
        return framing(corners.min(axis=0), corners.max(axis=0), self.where)


_STRENGTH = ("KHR_materials_emissive_strength",)


def framing(low: Array, high: Array, where: str) -> Node:
    """A camera that sees all of a box, from its front, which is at +z, from the right and above."""
    middle, ends = low + 0.5 * (high - low), 0.5 * (high - low)
    radius = math.sqrt(float((ends * ends).sum())) or 1.0
    away = radius / sin_cos_degrees(0.5 * FOV)[0]
    ahead = np.array(transform.unit([0.5, 0.375, 1.0], ""))
    place = transform.look_at(
        (middle + away * ahead).tolist(), middle.tolist(), [0.0, 1.0, 0.0], where
    )
    return _sensor(where, "perspective", place, WIDTH, FOV, "smaller")


def _clips(view: Json) -> dict[str, Any]:
    """The depths between which a camera sees."""
    found = {"near_clip": view.number("znear", 0.0, 0.0), "far_clip": view.number("zfar", 0.0, 0.0)}
    return {name: depth for name, depth in found.items() if depth}


def _sensor(
    where: str,
    kind: str,
    place: Array,
    width: int,
    fov: float = 0.0,
    axis: str = "",
    **clips: float,
) -> Node:
    def values(kind: str, **given: Any) -> dict[str, Value]:
        return {name: Value(kind, value, where) for name, value in given.items()}

    film = Node("hdrfilm", where, "film", values=values("integer", width=width, height=HEIGHT))
    sampler = Node("independent", where, "sampler", values=values("integer", sample_count=SPP))
    view = {**values("transform", to_world=place), **values("float", **clips)}
    if kind == "perspective":
        view |= {**values("float", fov=fov), **values("string", fov_axis=axis)}
    return Node(kind, where, "sensor", values=view, children=[film, sampler])


def _indices(node: Json, key: str, of: list[Any]) -> list[int]:
    """The list of rows of `of` in a key."""
    return [Json({key: row}, node.where).needed(key, len(of) - 1) for row in node.rows(key)]


def _local(node: Json) -> Array:
    """A node's own matrix, or its translation, rotation and scale as one."""
    if "matrix" in node.content:
        matrix = node.numbers("matrix", tuple(np.eye(4).ravel())).reshape(4, 4).T
        if matrix[3].tolist() != [0.0, 0.0, 0.0, 1.0]:
            raise node.fail(f"its matrix has the last row {matrix[3].tolist()}")
        return matrix
    x, y, z, w = node.numbers("rotation", (0.0, 0.0, 0.0, 1.0), -2.0, 2.0).tolist()
    square = x * x + y * y + z * z + w * w
    if not 0.5 < square < 2.0:
        raise node.fail(f'"rotation" has the length {math.sqrt(square):g}, expected 1')
    x, y, z, w = (part / math.sqrt(square) for part in (x, y, z, w))
    matrix = np.eye(4)
    matrix[:3, :3] = transform.turned(x, y, z, w)
    matrix[:3, :3] *= node.numbers("scale", (1.0,) * 3)
    matrix[:3, 3] = node.numbers("translation", (0.0,) * 3)
    return matrix


def _rigid(matrix: Array, about: Json) -> Array:
    """A matrix without its scale: glTF's cameras and lights have none."""
    result = np.array(matrix)
    for axis in range(3):
        message = "its node's matrix is singular"
        result[:3, axis] = transform.unit(result[:3, axis].tolist(), message, about.where)
    return result


def _mesh(arrays: dict[str, Array], faces: Array, shown: Array, where: str) -> dict[str, Value]:
    """The parameters of a mesh of some faces, with the vertices that they use if not all are."""
    own, tables = faces[shown], arrays
    if len(own) < len(faces):
        used, numbers = np.unique(own, return_inverse=True)
        own = numbers.reshape(-1, 3)
        tables = {name: table[used] for name, table in arrays.items()}
    values = {key: Value("array", table, where) for key, table in tables.items()}
    values["faces"] = Value("array", own, where)
    if "normals" not in values:
        values["face_normals"] = Value("boolean", True, where)
    return values


def _triangles(corners: Array, mode: int) -> Array:
    """Triangles (T, 3) of a list, strip or fan of corners."""
    if mode == 4:
        return corners[: len(corners) // 3 * 3].reshape(-1, 3)
    count = max(len(corners) - 2, 0)
    a, b, c = corners[:count], corners[1 : count + 1], corners[2:]
    if mode == 6:
        return np.stack([np.broadcast_to(corners[:1], (count,)), b, c], axis=1)
    odd = np.arange(count) % 2 == 1
    return np.stack([np.where(odd, b, a), np.where(odd, a, b), c], axis=1)
