"""Reading of the Mitsuba 3 XML subset that veriray's first scenes use.

Right-handed world; a sensor looks along local +Z with +X to the left of the picture; ``fov`` in
degrees. A triangle's front is the side that cross(v1 - v0, v2 - v0) points to. Source of the
format: Mitsuba 3 documentation, "Scene format" and "Plugin reference"; details that the pages
leave open (mirrored transforms, defaults) were measured with mitsuba 3.9.1.
"""

from __future__ import annotations

import hashlib
import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np
import trimesh
from lxml import etree


class SceneError(ValueError):
    """A scene file that cannot be used; the message starts with file:line."""


@dataclass(frozen=True)
class Camera:
    """Pinhole camera. ``tan_x`` and ``tan_y`` are tangents of half the field of view."""

    to_world: np.ndarray
    fov: float
    fov_axis: str
    near: float = 0.0
    far: float = math.inf
    principal: tuple[float, float] = (0.0, 0.0)

    def tangents(self, width: int, height: int) -> tuple[float, float]:
        """Half extents of the picture at unit distance for a film of width x height pixels."""
        half = math.tan(math.radians(self.fov) / 2)
        aspect = width / height
        axis = self.fov_axis
        if axis in ("smaller", "larger"):
            axis = "x" if (axis == "smaller") == (width < height) else "y"
        if axis == "x":
            tan_x = half
        elif axis == "y":
            tan_x = half * aspect
        else:
            tan_x = half * aspect / math.hypot(1.0, aspect)
        return tan_x, tan_x / aspect


@dataclass(frozen=True)
class Film:
    """Size in pixels and reconstruction filter; ``parameter`` is a radius (stddev: gaussian)."""

    width: int = 768
    height: int = 576
    filter: str = "gaussian"
    parameter: float = 0.5


@dataclass(frozen=True)
class Scene:
    """A scene in world units.

    triangles (T, 3, 3) float64; reflectance and emission per triangle (T, 3) float64 ;
    two_sided and emitter (T,) bool; environment (3,) float64 or None; depths as in Mitsuba's
    path integrator; digest is the SHA-256 of every file read and every parameter given.
    """

    triangles: np.ndarray
    reflectance: np.ndarray
    two_sided: np.ndarray
    emission: np.ndarray
    emitter: np.ndarray
    environment: np.ndarray | None
    camera: Camera
    film: Film
    max_depth: int
    rr_depth: int
    spp: int
    digest: str


@dataclass(frozen=True)
class _Bsdf:
    reflectance: np.ndarray = field(default_factory=lambda: np.full(3, 0.5))
    two_sided: bool = False


_SQUARE = np.array([[-1, -1, 0], [1, -1, 0], [1, 1, 0], [-1, 1, 0]], float)
_FACES = {  # outward, counter-clockwise, as (axis, sign)
    (axis, sign): np.roll(_SQUARE + [0, 0, 1], axis + 1, axis=1) * sign
    for axis in range(3)
    for sign in (1, -1)
}
_TRANSFORMS = ("translate", "rotate", "scale", "matrix", "lookat")


def load(path: str | Path, parameters: Mapping[str, str] | None = None) -> Scene:
    """Read a scene file; ``parameters`` set its ``$names`` (command line: -D name=value)."""
    return _Reader(Path(path), dict(parameters or {})).scene()


class _Reader:
    def __init__(self, path: Path, parameters: dict[str, str]) -> None:
        self.given = parameters
        self.defaults: dict[str, str] = {}
        self.hash = hashlib.sha256(repr(sorted(parameters.items())).encode())
        self.files: dict[etree._Element, Path] = {}
        self.bsdfs: dict[str, _Bsdf] = {}
        self.path = path
        self.root = self.parse(path)
        self.used: set[str] = set()

    # -- elements and values -----------------------------------------------------------------

    def parse(self, path: Path) -> etree._Element:
        try:
            data = path.read_bytes()
            parser = etree.XMLParser(resolve_entities=False, no_network=True, load_dtd=False)
            root = etree.fromstring(data, parser)
        except OSError as error:
            raise SceneError(f"{path}: {error.strerror}") from error
        except etree.XMLSyntaxError as error:
            raise SceneError(f"{path}:{error.lineno}: {error.msg}") from error
        self.hash.update(data)
        self.files[root] = path
        if root.tag != "scene":
            raise self.error(root, f"root element is <{root.tag}>, expected <scene>")
        return root

    def file_of(self, element: etree._Element) -> Path:
        return self.files[element.getroottree().getroot()]

    def error(self, element: etree._Element, text: str) -> SceneError:
        return SceneError(f"{self.file_of(element)}:{element.sourceline}: {text}")

    def text(self, element: etree._Element, key: str, default: str | None = None) -> str:
        value = element.get(key, default)
        if value is None:
            raise self.error(element, f"<{element.tag}> needs the attribute '{key}'")
        names = {**self.defaults, **self.given}
        for name in sorted(names, key=len, reverse=True):
            if f"${name}" in value:
                self.used.add(name)
                value = value.replace(f"${name}", names[name])
        if "$" in value:
            raise self.error(element, f"undefined parameter in {key}='{value}'")
        return value

    def numbers(
        self, element: etree._Element, key: str, count: tuple[int, ...], default: str | None = None
    ) -> np.ndarray:
        value = self.text(element, key, default)
        try:
            out = np.array([float(x) for x in value.replace(",", " ").split()])
        except ValueError:
            out = np.full(1, math.nan)
        if len(out) not in count or not np.isfinite(out).all():
            raise self.error(element, f"{key}='{value}', expected {count} finite number(s)")
        return out

    def children(self, element: etree._Element) -> list[etree._Element]:
        return [child for child in element if isinstance(child.tag, str)]

    def parameters(self, element: etree._Element, **readers: Callable) -> dict:
        """Read the named parameters of a plugin; a name without a reader is an error."""
        out = {}
        for child in self.children(element):
            name = child.get("name", child.tag)
            if name not in readers:
                raise self.error(
                    child,
                    f"unknown '{name}' in {element.get('type', element.tag)};"
                    f" known: {', '.join(sorted(readers))}",
                )
            if name in out:
                raise self.error(child, f"'{name}' given twice")
            out[name] = readers[name](child)
        return out

    def plugin(self, element: etree._Element, *known: str) -> str:
        kind = self.text(element, "type")
        if kind not in known:
            raise self.error(element, f"{element.tag} '{kind}', known: {', '.join(known)}")
        return kind

    def number(self, low: float = -math.inf, high: float = math.inf) -> Callable:
        def read(element: etree._Element) -> float:
            if element.tag not in ("float", "integer"):
                raise self.error(element, f"<{element.tag}>, expected <float>")
            value = float(self.numbers(element, "value", (1,))[0])
            if not low <= value <= high:
                raise self.error(element, f"{value}, expected {low} to {high}")
            return value

        return read

    def integer(self, low: int) -> Callable:
        def read(element: etree._Element) -> int:
            value = self.number(low)(element)
            if element.tag != "integer" or value != int(value):
                raise self.error(element, "expected <integer>")
            return int(value)

        return read

    def choice(self, *known: str) -> Callable:
        def read(element: etree._Element) -> str:
            value = self.text(element, "value").lower()
            if value not in known:
                raise self.error(element, f"'{value}', known: {', '.join(known)}")
            return value

        return read

    def boolean(self, element: etree._Element) -> bool:
        return self.choice("true", "false")(element) == "true"

    def colour(self, high: float = math.inf, grey: bool = True) -> Callable:
        """Three non-negative numbers up to ``high``.

        A <spectrum> is one only where ``grey`` is true: Mitsuba's constant emission spectrum is
        equal energy, not (1, 1, 1).
        """

        def read(element: etree._Element) -> np.ndarray:
            if element.tag not in ("rgb", "float", *(["spectrum"] if grey else [])):
                raise self.error(element, f"<{element.tag}>, expected <rgb>")
            value = self.numbers(element, "value", (1, 3) if element.tag == "rgb" else (1,))
            if (value < 0).any() or (value > high).any():
                raise self.error(element, f"{value}, expected 0 to {high}")
            return np.broadcast_to(value, 3).copy()

        return read

    def ignore(self, element: etree._Element) -> None:
        return None

    # -- transforms ---------------------------------------------------------------------------

    def transform(self, element: etree._Element) -> np.ndarray:
        total = np.eye(4)
        for child in self.children(element):
            if child.tag not in _TRANSFORMS:
                raise self.error(child, f"<{child.tag}>, known: {', '.join(_TRANSFORMS)}")
            total = getattr(self, child.tag)(child) @ total
        if abs(np.linalg.det(total[:3, :3])) < 1e-300 or (total[3] != [0, 0, 0, 1]).any():
            raise self.error(element, "singular or not affine")
        return total

    def vector(self, element: etree._Element, default: str) -> np.ndarray:
        if element.get("value") is not None:
            return np.broadcast_to(self.numbers(element, "value", (1, 3)), 3)
        return np.concatenate([self.numbers(element, key, (1,), default) for key in "xyz"])

    def translate(self, element: etree._Element) -> np.ndarray:
        out = np.eye(4)
        out[:3, 3] = self.vector(element, "0")
        return out

    def scale(self, element: etree._Element) -> np.ndarray:
        return np.diag([*self.vector(element, "1"), 1.0])

    def rotate(self, element: etree._Element) -> np.ndarray:
        x, y, z = axis = self.vector(element, "0")
        if abs(np.linalg.norm(axis) - 1) > 1e-6:  # Mitsuba would shear instead of rotate
            raise self.error(element, f"rotation axis {axis}, expected unit length")
        angle = math.radians(self.numbers(element, "angle", (1,))[0])
        cross = np.array([[0, -z, y], [z, 0, -x], [-y, x, 0]])
        out = np.eye(4)  # Rodrigues
        out[:3, :3] = (
            math.cos(angle) * np.eye(3)
            + math.sin(angle) * cross
            + (1 - math.cos(angle)) * np.outer(axis, axis)
        )
        return out

    def matrix(self, element: etree._Element) -> np.ndarray:
        value = self.numbers(element, "value", (9, 16))
        out = np.eye(4)
        size = math.isqrt(len(value))
        out[:size, :size] = value.reshape(size, size)
        return out

    def lookat(self, element: etree._Element) -> np.ndarray:
        origin, target = (self.numbers(element, key, (3,)) for key in ("origin", "target"))
        up = self.numbers(element, "up", (3,), "0 1 0")
        out = np.eye(4)
        ahead = (target - origin) / np.linalg.norm(target - origin)
        left = np.cross(up, ahead)
        if not np.linalg.norm(left) > 0:
            raise self.error(element, "lookat: up is parallel to the view, or target is origin")
        left /= np.linalg.norm(left)
        out[:3] = np.stack([left, np.cross(ahead, left), ahead, origin], axis=1)
        return out

    # -- plugins ------------------------------------------------------------------------------

    def scene(self) -> Scene:
        self.shapes: list[tuple] = []
        self.environment: np.ndarray | None = None
        self.sensor: tuple | None = None
        self.path_settings = {"max_depth": -1, "rr_depth": 5}
        self.body(self.root, self.path.parent)
        unknown = set(self.given) - self.used
        if unknown:
            raise SceneError(f"{self.path}: no such parameter: {', '.join(sorted(unknown))}")
        if self.sensor is None:
            raise SceneError(f"{self.path}: no sensor")
        if not self.shapes:
            self.shapes.append((np.zeros((1, 3, 3)), _Bsdf(), None))  # a point: never hit
        camera, film, spp = self.sensor

        def per_triangle(pick: Callable, dtype: type = float) -> np.ndarray:
            return np.concatenate(
                [
                    np.broadcast_to(np.asarray(pick(s), dtype), (len(s[0]), *np.shape(pick(s))))
                    for s in self.shapes
                ]
            )

        return Scene(
            triangles=np.concatenate([s[0] for s in self.shapes]),
            reflectance=per_triangle(lambda s: s[1].reflectance),
            two_sided=per_triangle(lambda s: s[1].two_sided, bool),
            emission=per_triangle(lambda s: np.zeros(3) if s[2] is None else s[2]),
            emitter=per_triangle(lambda s: s[2] is not None, bool),
            environment=self.environment,
            camera=camera,
            film=film,
            spp=spp,
            digest=self.hash.hexdigest(),
            **self.path_settings,
        )

    def body(self, root: etree._Element, folder: Path) -> None:
        for child in self.children(root):
            if child.tag == "default":
                self.defaults.setdefault(self.text(child, "name"), self.text(child, "value"))
                self.used.add(child.get("name"))
            elif child.tag == "include":
                path = folder / self.text(child, "filename")
                self.body(self.parse(path), path.parent)
            elif child.tag == "integrator":
                self.plugin(child, "path")
                self.path_settings.update(
                    self.parameters(child, max_depth=self.integer(-1), rr_depth=self.integer(1))
                )
            elif child.tag == "sensor":
                if self.sensor is not None:
                    raise self.error(child, "second sensor")
                self.sensor = self.perspective(child)
            elif child.tag == "bsdf":
                self.bsdfs[self.text(child, "id")] = self.bsdf(child)
            elif child.tag == "emitter":
                self.plugin(child, "constant")
                if self.environment is not None:
                    raise self.error(child, "second environment")
                values = self.parameters(child, radiance=self.colour(grey=False))
                self.environment = values.get("radiance", np.ones(3))
            elif child.tag == "shape":
                self.shapes.append(self.shape(child, folder))
            else:
                raise self.error(child, f"unknown element <{child.tag}>")

    def perspective(self, element: etree._Element) -> tuple[Camera, Film, int]:
        self.plugin(element, "perspective")
        values = self.parameters(
            element,
            fov=self.number(1e-6, 180 - 1e-6),
            to_world=self.transform,
            fov_axis=self.choice("x", "y", "diagonal", "smaller", "larger"),
            focal_length=lambda e: self.text(e, "value"),
            near_clip=self.number(0),
            far_clip=self.number(0),
            focus_distance=self.ignore,
            principal_point_offset_x=self.number(),
            principal_point_offset_y=self.number(),
            film=self.hdrfilm,
            sampler=self.sampler,
        )
        if ("fov" in values) == ("focal_length" in values):
            raise self.error(element, "needs one of fov and focal_length")
        axis = values.get("fov_axis", "x")
        if "fov" not in values:  # millimetres on 36 x 24 film; its fov is along the diagonal
            text = values["focal_length"]
            length = float(text[:-2] if text.endswith("mm") else text)
            values["fov"] = math.degrees(2 * math.atan(math.hypot(36, 24) / 2 / length))
            axis = "diagonal"
        to_world = values.get("to_world", np.eye(4))
        camera = Camera(
            to_world=to_world,
            fov=values["fov"],
            fov_axis=axis,
            near=values.get("near_clip", 0.0),
            far=values.get("far_clip", math.inf),
            principal=(
                values.get("principal_point_offset_x", 0.0),
                values.get("principal_point_offset_y", 0.0),
            ),
        )
        return camera, values.get("film", Film()), values.get("sampler", 4)

    def sampler(self, element: etree._Element) -> int:
        self.plugin(element, "independent")
        values = self.parameters(element, sample_count=self.integer(1), seed=self.integer(0))
        return values.get("sample_count", 4)

    def hdrfilm(self, element: etree._Element) -> Film:
        self.plugin(element, "hdrfilm")
        values = self.parameters(
            element,
            width=self.integer(1),
            height=self.integer(1),
            rfilter=self.rfilter,
            pixel_format=self.choice("rgb", "rgba"),
            file_format=self.ignore,
            component_format=self.ignore,
            banner=self.ignore,
        )
        kind, parameter = values.get("rfilter", ("gaussian", 0.5))
        return Film(values.get("width", 768), values.get("height", 576), kind, parameter)

    def rfilter(self, element: etree._Element) -> tuple[str, float]:
        kind = self.plugin(element, "box", "tent", "gaussian")
        if kind == "gaussian":
            return kind, self.parameters(element, stddev=self.number(1e-6)).get("stddev", 0.5)
        if kind == "tent":
            return kind, self.parameters(element, radius=self.number(1e-6)).get("radius", 1.0)
        self.parameters(element)
        return kind, 0.5

    def bsdf(self, element: etree._Element) -> _Bsdf:
        if element.tag == "ref":
            name = self.text(element, "id")
            if name not in self.bsdfs:
                raise self.error(element, f"no bsdf '{name}'; known: {', '.join(self.bsdfs)}")
            return self.bsdfs[name]
        if self.plugin(element, "diffuse", "twosided") == "twosided":
            inner = self.parameters(element, bsdf=self.bsdf, ref=self.bsdf)
            if len(inner) != 1:
                raise self.error(element, "twosided needs exactly one bsdf")
            return _Bsdf(next(iter(inner.values())).reflectance, True)
        return _Bsdf(**self.parameters(element, reflectance=self.colour(1.0)))

    def area(self, element: etree._Element) -> np.ndarray:
        self.plugin(element, "area")
        values = self.parameters(element, radiance=self.colour(grey=False))
        return values.get("radiance", np.ones(3))

    def shape(self, element: etree._Element, folder: Path) -> tuple:
        kind = self.plugin(element, "rectangle", "cube", "obj", "ply")
        readers: dict[str, Callable] = dict(
            to_world=self.transform,
            bsdf=self.bsdf,
            ref=self.bsdf,
            emitter=self.area,
            flip_normals=self.boolean,
        )
        if kind in ("obj", "ply"):
            readers.update(
                filename=lambda e: folder / self.text(e, "value"),
                face_normals=self.boolean,
                flip_tex_coords=self.ignore,
            )
        values = self.parameters(element, **readers)
        if kind == "rectangle":
            triangles = _SQUARE[[[0, 1, 2], [0, 2, 3]]]
        elif kind == "cube":
            quads = [quad if sign > 0 else quad[::-1] for (_, sign), quad in _FACES.items()]
            triangles = np.concatenate([quad[[[0, 1, 2], [0, 2, 3]]] for quad in quads])
        else:
            triangles = self.mesh(element, values.get("filename"))
        to_world = values.get("to_world", np.eye(4))
        triangles = triangles @ to_world[:3, :3].T + to_world[:3, 3]
        # Mitsuba keeps rectangle and cube normals through a mirror; a mesh keeps its winding.
        mirrored = kind in ("rectangle", "cube") and np.linalg.det(to_world[:3, :3]) < 0
        if mirrored != values.get("flip_normals", False):
            triangles = triangles[:, ::-1]
        bsdf = values.get("bsdf", values.get("ref", _Bsdf()))
        return triangles, bsdf, values.get("emitter")

    def mesh(self, element: etree._Element, path: Path | None) -> np.ndarray:
        if path is None:
            raise self.error(element, "needs a filename")
        try:
            self.hash.update(path.read_bytes())
            mesh = trimesh.load(path, force="mesh", process=False, maintain_order=True)
        except Exception as error:
            raise self.error(element, f"{path}: {error}") from error
        vertices, faces = np.asarray(mesh.vertices, float), np.asarray(mesh.faces)
        if not np.isfinite(vertices).all() or faces.min() < 0 or faces.max() >= len(vertices):
            raise self.error(element, f"{path}: non-finite vertex or index out of range")
        return vertices[faces]
