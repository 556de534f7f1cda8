"""Parts of a film, and a view of a scene that has no sensor."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace
from typing import Any

import numpy as np
import numpy.typing as npt

from .. import transform
from ..camera import Camera
from ..errors import SceneError
from ..numeric import tan_half_degrees
from .node import Node, Ref, Value
from .plugins import PLUGINS
from .report import Report

Array = npt.NDArray[np.float64]

FRAMING_FOV = 45.0  # degrees
_POINT = 1e-20  # of a film: too small to matter
_NARROW = 1e-3  # degrees
_WIDER = 1 + 1500 * 2.0**-24  # as Mitsuba's
Ball = tuple[tuple[float, ...], float]  # centre and radius
NOTHING: Ball = ((0.0, 0.0, 0.0), 1.0)


def window(node: Node, values: dict[str, Any]) -> tuple[int, int, int, int]:
    """Left, top, width and height, in pixels, of the part of a film that is rendered."""
    width, height = values["width"], values["height"]
    left, top = values["crop_offset_x"], values["crop_offset_y"]
    wide, high = values["crop_width"] or width, values["crop_height"] or height
    if left + wide > width or top + high > height:
        raise SceneError(
            f"{node}: the crop window of {wide} x {high} pixels at ({left}, {top}) is not within "
            f"the film of {width} x {height}",
            node.where,
        )
    return left, top, wide, high


def batch(
    node: Node, parts: dict[str, list[Node]], ids: dict[str, Node], report: Report
) -> list[Node]:
    """The sensors of a batch, each with the batch's sampler and its part of the batch's film, for
    which Mitsuba lays their pictures side by side. parts: the batch's objects; ids: the scene's."""
    inner = parts["sensor"]
    film = parts["film"][0] if parts["film"] else Node("hdrfilm", node.where, "film")
    cropped = [value.where for name, value in film.values.items() if name.startswith("crop_")]
    if cropped:
        raise SceneError(f"{node}: a crop window is not supported here", cropped[0])
    given = film.values.get("width")
    width = PLUGINS[film.plugin].params["width"].default if given is None else given.value
    if width % len(inner):
        raise SceneError(
            f"{node}: the film's width = {width} is not a multiple of its {len(inner)} sensors",
            film.where,
        )
    part = Value("integer", width // len(inner), film.where)
    own = [replace(film, id="", values={**film.values, "width": part}), *parts["sampler"]]
    report.note(
        f"{node}: its {len(inner)} sensors are sensors of the scene, {part.value} pixels wide each",
        node.where,
    )
    return [
        replace(
            one, children=[*own, *(item for item in one.children if not _superseded(item, ids))]
        )
        for one in inner
    ]


def _superseded(item: Node | Ref, ids: dict[str, Node]) -> bool:
    """Whether a batch's own stands for this object of one of its sensors."""
    found = ids[item.id] if isinstance(item, Ref) else item
    return found.category in ("film", "sampler")


def shifted(
    offset: Sequence[float], film: Sequence[int], begin: Sequence[int], part: Sequence[int]
) -> list[float]:
    """The principal point offset of a part of a film, for that of the whole: both see the same
    along each direction. begin: left and top of the part."""
    return [
        (1 - whole / size * (1 - 2 * shift - 2 * first / whole)) / 2
        for shift, whole, first, size in zip(offset, film, begin, part, strict=True)
    ]


def one_pixel(node: Node, film: tuple[int, int]) -> None:
    """Raises SceneError unless a sensor's film is one."""
    if film != (1, 1):
        raise SceneError(
            f"{node}: its film has {film[0]} x {film[1]} pixels, expected 1 x 1", node.where
        )


def one_ray(node: Node, values: dict[str, Any], film: tuple[int, int]) -> Array:
    """to_world of a film so small that an orthographic camera is a radiancemeter."""
    one_pixel(node, film)
    matrix, origin, ahead = (values[name] for name in ("to_world", "origin", "direction"))
    if matrix is not None:
        origin, ahead = matrix[:3, 3].tolist(), matrix[:3, 2].tolist()
    elif (origin is None) != (ahead is None):
        raise SceneError(f"{node}: expected both origin and direction, or to_world", node.where)
    start, ahead = origin or [0.0, 0.0, 0.0], ahead or [0.0, 0.0, 1.0]
    ahead = transform.unit(ahead, f"{node}: direction has length 0", node.where)
    zero = [0.0, 0.0, 0.0]
    turn = transform.look_at(zero, ahead, transform.any_up(zero, ahead), node.where)
    turn = transform.compose(turn, transform.scale([_POINT, _POINT, 1.0]))
    return transform.compose(transform.translate(start), turn)


def ends(arrays: dict[str, Any]) -> Array:
    """Points (N, 3) whose box is that of all shapes of a scene with these arrays."""
    disks, spheres = arrays["disks"], arrays["spheres"]
    reach = np.sqrt((disks[:, 1:] * disks[:, 1:]).sum(axis=1))
    points = [arrays["vertices"], disks[:, 0] - reach, disks[:, 0] + reach]
    points += [spheres[:, :3] + side * spheres[:, 3:] for side in (-1, 1)]
    return np.concatenate(points)


def ball(arrays: dict[str, Any]) -> Ball:
    """The sphere about the box of all shapes, as Mitsuba's."""
    points = ends(arrays)
    if not len(points):
        return NOTHING
    low, high = points.min(axis=0), points.max(axis=0)
    half = 0.5 * (high - low)
    radius = math.sqrt(math.fsum((half * half).tolist()))
    return tuple((low + half).tolist()), radius * _WIDER


def ahead(node: Node, values: dict[str, Any]) -> tuple[list[float], Array]:
    """The direction of a distant sensor's rays, and a to_world that turns z there."""
    matrix, along = values["to_world"], values["direction"]
    if matrix is not None and along is not None:
        raise SceneError(f"{node}: both direction and to_world given", node.where)
    along = matrix[:3, 2].tolist() if matrix is not None else along or [0.0, 0.0, 1.0]
    along = transform.unit(along, f"{node}: direction has length 0", node.where)
    zero = [0.0, 0.0, 0.0]
    return along, transform.look_at(zero, along, transform.any_up(zero, along), node.where)


def distant(node: Node, values: dict[str, Any], around: Ball, medium: int) -> Camera:
    """The camera of a sensor that looks at a scene from far away: one ray towards its target, or
    those of a lens in focus far behind the scene, which are parallel to 1e-5. around: the sphere
    about all."""
    along, turn = ahead(node, values)
    target = values["target"]
    centre, radius = around
    away = radius if target is None else 2 * radius
    start = [x - away * d for x, d in zip(target or centre, along, strict=True)]
    placed = transform.compose(transform.translate(start), turn)
    if target is not None:
        point = transform.scale([_POINT, _POINT, 1.0])
        return Camera.orthographic(transform.compose(placed, point), medium=medium)
    return Camera(
        placed,
        _NARROW,
        aperture_radius=radius,
        focus_distance=radius * 2.0**20,
        medium=medium,
    )


def part(film: Sequence[int], begin: Sequence[int], size: Sequence[int]) -> Array:
    """What takes the film of an orthographic sensor to a part of it; begin: left and top."""
    (width, height), (left, top), (wide, high) = film, begin, size
    x, y = (width - 2 * left - wide) / width, (height - 2 * top - high) / width
    scale = transform.scale([wide / width, wide / width, 1.0])
    return transform.compose(transform.translate([x, y, 0.0]), scale)


def framing(arrays: dict[str, Any], root: Node) -> Array:
    """A place from which a view of FRAMING_FOV along +z holds all of a scene with these arrays."""
    points = ends(arrays)
    if not len(points):
        names = ", ".join(PLUGINS["scene"].children["sensor"][0])
        raise SceneError(f"scene has no sensor; allowed: {names}", root.where)
    low, high = points.min(axis=0), points.max(axis=0)
    away = 0.5 * float((high - low).max()) / tan_half_degrees(FRAMING_FOV)
    middle = (low + 0.5 * (high - low)).tolist()
    return transform.translate([*middle[:2], float(low[2]) - away])
