"""Elements, values and transforms of the Mitsuba 3 XML format, whatever the plugins mean.

Source of the format: Mitsuba 3 documentation, "Scene format".
"""

from __future__ import annotations

import hashlib
import math
from collections.abc import Callable
from pathlib import Path

import numpy as np
from lxml import etree

from reference.scene import SceneError

_TRANSFORMS = ("translate", "rotate", "scale", "matrix", "lookat")
_OBJECTS = ("bsdf", "emitter", "film", "medium", "phase", "rfilter", "sampler", "shape", "texture",
            "volume")  # fmt: skip


class Document:
    """A scene file with what it includes: checked access to values, errors with file and line."""

    def __init__(self, path: Path, parameters: dict[str, str]) -> None:
        self.given = parameters
        self.defaults: dict[str, str] = {}
        self.used: set[str] = set()
        self.hash = hashlib.sha256(repr(sorted(parameters.items())).encode())
        self.files: dict[etree._Element, Path] = {}
        self.named: dict[str, etree._Element] = {}
        self.path = path
        self.root = self.parse(path)

    def parse(self, path: Path) -> etree._Element:
        """The root of a file; its objects with an id can be referred to from now on."""
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
        for element in root.iter(*_OBJECTS):
            if (name := element.get("id")) is not None:
                if name in self.named:
                    raise self.error(element, f"second object with the id '{name}'")
                self.named[name] = element
        return root

    def file_of(self, element: etree._Element) -> Path:
        """The file that ``element`` stands in."""
        return self.files[element.getroottree().getroot()]

    def error(self, element: etree._Element, text: str) -> SceneError:
        """The exception to raise for a fault in ``element``."""
        return SceneError(f"{self.file_of(element)}:{element.sourceline}: {text}")

    # -- attributes and elements ---------------------------------------------------------------

    def text(self, element: etree._Element, key: str, default: str | None = None) -> str:
        """An attribute, with its $names replaced."""
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
        """An attribute of finite numbers, as many as one of ``count``."""
        value = self.text(element, key, default)
        try:
            out = np.array([float(x) for x in value.replace(",", " ").split()])
        except ValueError:
            out = np.full(1, math.nan)
        if len(out) not in count or not np.isfinite(out).all():
            raise self.error(element, f"{key}='{value}', expected {count} finite number(s)")
        return out

    def children(self, element: etree._Element) -> list[etree._Element]:
        """Child elements, without comments."""
        return [child for child in element if isinstance(child.tag, str)]

    def target(self, element: etree._Element) -> etree._Element:
        """What a <ref> refers to; any other element is its own target."""
        if element.tag != "ref":
            return element
        name = self.text(element, "id")
        if name not in self.named:
            raise self.error(element, f"no object '{name}'; known: {', '.join(self.named)}")
        return self.named[name]

    def parameters(self, element: etree._Element, **readers: Callable) -> dict:
        """Read the named parameters of a plugin; a name without a reader is an error.

        Nested objects go by their tag, but for media and textures, which have names.
        """
        out = {}
        for child in self.children(element):
            aim = self.target(child)
            name = child.get("name", aim.tag)
            if aim.tag in _OBJECTS and name not in readers:
                name = aim.tag
            if name not in readers:
                raise self.error(
                    child,
                    f"unknown '{name}' in {element.get('type', element.tag)};"
                    f" known: {', '.join(sorted(readers))}",
                )
            if name in out:
                raise self.error(child, f"'{name}' given twice")
            out[name] = readers[name](aim)
        return out

    def plugin(self, element: etree._Element, *known: str) -> str:
        """The type of a plugin, one of ``known``."""
        kind = self.text(element, "type")
        if kind not in known:
            raise self.error(element, f"{element.tag} '{kind}', known: {', '.join(known)}")
        return kind

    # -- readers of values ---------------------------------------------------------------------

    def number(
        self, low: float = -math.inf, high: float = math.inf, open_low: bool = False
    ) -> Callable:
        """Reader of one number in [low, high], or (low, high] with ``open_low``."""

        def read(element: etree._Element) -> float:
            if element.tag not in ("float", "integer"):
                raise self.error(element, f"<{element.tag}>, expected <float>")
            value = float(self.numbers(element, "value", (1,))[0])
            if not low <= value <= high or (open_low and value == low):
                raise self.error(element, f"{value}, expected {low} to {high}")
            return value

        return read

    def integer(self, low: int) -> Callable:
        """Reader of a whole number, at least ``low``."""

        def read(element: etree._Element) -> int:
            value = self.number(low)(element)
            if element.tag != "integer" or value != int(value):
                raise self.error(element, "expected <integer>")
            return int(value)

        return read

    def choice(self, *known: str) -> Callable:
        """Reader of one of some words."""

        def read(element: etree._Element) -> str:
            value = self.text(element, "value").lower()
            if value not in known:
                raise self.error(element, f"'{value}', known: {', '.join(known)}")
            return value

        return read

    def boolean(self, element: etree._Element) -> bool:
        """True or false."""
        return self.choice("true", "false")(element) == "true"

    def colour(self, high: float = math.inf, grey: bool = True) -> Callable:
        """Reader of three non-negative numbers up to ``high``.

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

    def point(self, element: etree._Element) -> np.ndarray:
        """<point> or <vector>: as x, y, z or as a value of three numbers."""
        if element.tag not in ("point", "vector"):
            raise self.error(element, f"<{element.tag}>, expected <point> or <vector>")
        return self.vector(element, "0")

    def ignore(self, element: etree._Element) -> None:
        """Reader of what has no effect here."""
        return None

    # -- transforms ----------------------------------------------------------------------------

    def transform(self, element: etree._Element) -> np.ndarray:
        """A regular affine 4 x 4 matrix; later children act later."""
        total = np.eye(4)
        for child in self.children(element):
            if child.tag not in _TRANSFORMS:
                raise self.error(child, f"<{child.tag}>, known: {', '.join(_TRANSFORMS)}")
            total = getattr(self, child.tag)(child) @ total
        if abs(np.linalg.det(total[:3, :3])) < 1e-300 or (total[3] != [0, 0, 0, 1]).any():
            raise self.error(element, "singular or not affine")
        return total

    def vector(self, element: etree._Element, default: str) -> np.ndarray:
        """Three numbers: value (one serves for all) or x, y, z."""
        if element.get("value") is not None:
            return np.broadcast_to(self.numbers(element, "value", (1, 3)), 3)
        return np.concatenate([self.numbers(element, key, (1,), default) for key in "xyz"])

    def translate(self, element: etree._Element) -> np.ndarray:
        """A move."""
        out = np.eye(4)
        out[:3, 3] = self.vector(element, "0")
        return out

    def scale(self, element: etree._Element) -> np.ndarray:
        """A scale along the axes."""
        return np.diag([*self.vector(element, "1"), 1.0])

    def rotate(self, element: etree._Element) -> np.ndarray:
        """A rotation about a unit axis by an angle in degrees."""
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
        """9 or 16 numbers, row by row."""
        value = self.numbers(element, "value", (9, 16))
        out = np.eye(4)
        size = math.isqrt(len(value))
        out[:size, :size] = value.reshape(size, size)
        return out

    def lookat(self, element: etree._Element) -> np.ndarray:
        """Local +Z towards the target, local +Y near ``up``."""
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
