"""From sensors to cameras, films and the settings of their samplers."""

from __future__ import annotations

import math
import re
from collections.abc import Callable
from typing import Any

import numpy as np
import numpy.typing as npt

from .. import transform
from ..camera import Camera, Film
from ..errors import SceneError
from ..numeric import view_angle
from . import meters, views
from .node import Node, Ref, parse_float, shorten
from .plugins import SHUTTER
from .report import Report
from .values import located

Array = npt.NDArray[Any]
Parts = dict[str, list[Node]]
View = tuple[Camera, Film, dict[str, Any]]
_DIAGONAL_35_MM = 43.266615305567875  # sqrt(36^2 + 24^2)
_FAR_CLIP = 1e4  # Mitsuba's, which is infinite here


class Sensors:
    """The sensors of a scene. check: an object's own objects and parameters; medium: the index of a
    medium; boundary: those in and around a shape; ids: the scene's objects by theirs."""

    def __init__(
        self,
        report: Report,
        ids: dict[str, Node],
        check: Callable[[Node], tuple[Parts, dict[str, Any]]],
        resolve: Callable[[Ref, Node], Node],
        medium: Callable[[Node], int],
        boundary: Callable[[Node], tuple[int, int]],
    ) -> None:
        self.report, self.ids, self.check, self.resolve = report, ids, check, resolve
        self.medium, self.boundary = medium, boundary
        self.meters = meters.Held()  # found once the scene is checked

    def seen_by(self, node: Node) -> list[View]:
        """What a sensor sees; of a batch what each of its sensors does."""
        parts, _ = self.check(node)
        if node.plugin != "batch":
            return [self.view(node)]
        return [self.view(one) for one in views.batch(node, parts, self.ids, self.report)]

    def view(self, node: Node, place: Array | None = None) -> View:
        """What a sensor sees, and how; place: its to_world, unless the file has it."""
        parts, values = self.check(node)
        film_node = parts["film"][0] if parts["film"] else Node("hdrfilm", node.where)
        sampler = parts["sampler"][0] if parts["sampler"] else Node("independent", node.where)
        film_parts, size = self.check(film_node)
        filters = film_parts["rfilter"]
        filter_node = filters[0] if filters else Node("gaussian", film_node.where)
        kind, parameters = filter_node.plugin, list(self.check(filter_node)[1].values())
        if kind == "catmullrom":
            kind, parameters = "mitchell", [0.0, 0.5]
        if film_node.plugin == "specfilm":
            self.report.warn(f"{film_node}: RGB is rendered, not its bands", film_node.where)
        width, height = size["width"], size["height"]
        left, top, wide, high = views.window(film_node, size)
        film = located(
            film_node,
            lambda: Film(
                wide,
                high,
                kind,
                parameters[0] if len(parameters) == 1 else tuple(parameters) or None,
            ),
        )
        if node.plugin == "distant":
            views.one_pixel(node, (width, height))
            return self.far(node, views.NOTHING), Film(1, 1, "box"), self.sampling(sampler)
        if node.plugin == "irradiancemeter":
            if (wide, high) != (width, height):
                raise SceneError(f"{node}: a crop window is not supported here", film_node.where)
            if kind != "box":
                text = f"{node}: its film has the filter box, not {filter_node.plugin}"
                self.report.warn(text, filter_node.where)
            return self.meter(node, parts), Film(wide, high, "box"), self.sampling(sampler)
        if node.plugin in ("orthographic", "radiancemeter"):
            to_world = np.eye(4) if values["to_world"] is None else values["to_world"]
            if node.plugin == "radiancemeter":
                to_world = views.one_ray(node, values, (width, height))
            part = views.part((width, height), (left, top), (wide, high))
            camera = located(
                node,
                lambda: Camera.orthographic(
                    transform.compose(to_world, part),
                    near_clip=values.get("near_clip", 0.0),
                    far_clip=values.get("far_clip", math.inf),
                    medium=self.medium(parts["medium"][0]) if parts["medium"] else -1,
                ),
            )
            return camera, film, self.sampling(sampler)
        fov, axis = field_of_view(node, values)
        if place is not None:
            fov, axis = views.FRAMING_FOV, values["fov_axis"]
        offset = [values.get(f"principal_point_offset_{end}", 0.0) for end in "xy"]
        to_world = np.eye(4) if place is None else place
        to_world = to_world if values["to_world"] is None else values["to_world"]
        if (wide, high) != (width, height):
            whole = located(node, lambda: Camera(to_world, fov, axis))
            fov, axis = view_angle(2 * whole.tan_half_x(width, height) * wide, width), "x"
            offset = views.shifted(offset, (width, height), (left, top), (wide, high))
        camera = located(
            node,
            lambda: Camera(
                to_world,
                fov,
                axis,
                values["near_clip"],
                values["far_clip"],
                np.array(offset),
                values.get("aperture_radius", 0.0),
                focus(values) if node.plugin == "thinlens" else 1.0,
                self.medium(parts["medium"][0]) if parts["medium"] else -1,
            ),
        )
        return camera, film, self.sampling(sampler)

    def meter(self, node: Node, parts: Parts) -> Camera:
        """The camera of an irradiancemeter; it is in its own medium, or that around its shape."""
        shape = self.meters.of(node)
        own = [self.medium(medium) for medium in parts["medium"]]
        medium = own[0] if own else self.boundary(shape)[1]
        camera: Camera = located(node, lambda: meters.irradiance(shape, medium))
        return camera

    def far(self, node: Node, around: views.Ball) -> Camera:
        """The camera of a distant sensor; around: the sphere about all shapes."""
        parts, values = self.check(node)
        inside = self.medium(parts["medium"][0]) if parts["medium"] else -1
        shape = meters.target(node, node.children, self.resolve)
        turn = views.ahead(node, values)[1]
        camera: Camera = located(
            node,
            lambda: (
                meters.distant(shape, turn, inside, self.report)
                if shape
                else views.distant(node, values, around, inside)
            ),
        )
        return camera

    def sampling(self, node: Node) -> dict[str, Any]:
        """The settings that a sampler gives, of whatever kind it is."""
        _, given = self.check(node)
        return {"spp": given["sample_count"], "seed": given["seed"]}


def focus(values: dict[str, Any]) -> float:
    """The distance from a lens to the plane in focus; without one, Mitsuba's far plane."""
    far = values["far_clip"]
    distance: float = values["focus_distance"] or (_FAR_CLIP if math.isinf(far) else far)
    return distance


def field_of_view(node: Node, values: dict[str, Any]) -> tuple[float, str]:
    """The angle of a sensor or projector in degrees, and along what."""
    fov, focal = values["fov"], values["focal_length"]
    if fov is not None and focal is not None:
        text = "both fov and focal_length given, expected one of them"
        raise SceneError(f"{node}: {text}", node.where)
    if fov is not None:
        return fov, values["fov_axis"]
    where = node.values["focal_length"].where if focal else node.where
    focal = focal or "50mm"
    number = re.sub(r"\s*mm\s*$", "", focal)
    length = parse_float(number, f'{node}: "focal_length"', where)
    if not 1e-3 <= length <= 1e6:
        raise SceneError(
            f'{node}: "focal_length" = {shorten(focal)} is outside [0.001, 1e+06] mm', where
        )
    return view_angle(_DIAGONAL_35_MM, length), "diagonal"


def shutter(found: list[Node]) -> tuple[float, float]:
    """When that of a sensor is open; of none at 0."""
    times = []
    for name in SHUTTER:
        given = found[0].values.get(name) if found else None
        if given is not None and given.kind not in ("float", "integer"):
            raise SceneError(f'{found[0]}: "{name}" is no number', given.where)
        times.append(0.0 if given is None else float(given.value))
    return times[0], times[1]
