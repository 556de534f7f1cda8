"""Cameras that users move: about a point, in place, sideways, and through the scene.

Each move gives a new camera with a rotation made anew from the direction and `up`, so that a
thousand moves add up no rounding errors. A mirrored camera stays mirrored, and an orthographic one
keeps its scales.
"""

from __future__ import annotations

import dataclasses
import math
from typing import Any

import numpy as np
import numpy.typing as npt

from ..camera import Camera, Film
from ..numeric import determinant

Array = npt.NDArray[np.float64]

#: The steepest view up and down, in radians from the horizon.
STEEPEST = math.radians(89.0)
#: Sine of the largest roll that counts as none.
_LEVEL = math.sin(math.radians(2.0))
AXES = {
    "+x": (1.0, 0.0, 0.0), "+y": (0.0, 1.0, 0.0), "+z": (0.0, 0.0, 1.0),
    "-x": (-1.0, 0.0, 0.0), "-y": (0.0, -1.0, 0.0), "-z": (0.0, 0.0, -1.0),
}  # fmt: skip


def position(camera: Camera) -> Array:
    """Where it stands, (3,)."""
    return np.array(camera.to_world[:3, 3])


def forward(camera: Camera) -> Array:
    """Its direction of view, (3,), of length 1."""
    axis = np.array(camera.to_world[:3, 2])
    return axis / float(np.linalg.norm(axis))


def scales(camera: Camera) -> list[float]:
    """Lengths of the axes of its to_world: all 1, unless it is orthographic."""
    return [float(np.linalg.norm(column)) for column in camera.to_world[:3, :3].T]


def up_axis(camera: Camera) -> Array:
    """The axis about which it turns: the axis of the world closest to its own up, or its own up
    where that is none: for a camera that leans to a side."""
    left, own = (np.array(camera.placed[:3, column]) for column in (0, 1))
    level = [np.array(a) for a in AXES.values() if abs(float(np.dot(left, a))) <= _LEVEL]
    if not level:
        return own
    return max(level, key=lambda axis: float(np.dot(own, axis)))


def placed(camera: Camera, eye: Array, view: Array, up: Array) -> Camera:
    """The camera at `eye` with the direction `view`, its top towards `up` (not parallel)."""
    view = view / np.linalg.norm(view)
    left = np.cross(up, view)
    left /= np.linalg.norm(left)
    matrix = np.eye(4)
    matrix[:3, :4] = np.array([left, np.cross(view, left), view, eye]).T
    if determinant(camera.to_world) < 0:
        matrix[:3, 0] *= -1.0
    if camera.projection == "orthographic":
        matrix[:3, :3] *= scales(camera)
    return dataclasses.replace(camera, to_world=matrix)


def turned(camera: Camera, yaw: float, pitch: float, up: Array) -> Camera:
    """The camera turned in place, in radians: yaw towards the picture's left, pitch upwards."""
    return placed(camera, position(camera), _turned(camera, yaw, pitch, up), up)


def orbited(camera: Camera, yaw: float, pitch: float, up: Array, distance: float) -> Camera:
    """The camera turned by as much about the point that is `distance` ahead of it."""
    view = _turned(camera, yaw, pitch, up)
    centre = position(camera) + distance * forward(camera)
    return placed(camera, centre - distance * view, view, up)


def _turned(camera: Camera, yaw: float, pitch: float, up: Array) -> Array:
    view = forward(camera)
    height = max(-1.0, min(1.0, float(np.dot(view, up))))
    flat = view - height * up
    if float(np.linalg.norm(flat)) < 1e-3:  # straight up or down: its own top says where is ahead
        own = np.array(camera.placed[:3, 1]) * (-1.0 if height > 0 else 1.0)
        flat = own - float(np.dot(own, up)) * up
    flat /= np.linalg.norm(flat)
    yaw = -yaw if determinant(camera.to_world) < 0 else yaw
    ahead = flat * math.cos(yaw) + np.cross(up, flat) * math.sin(yaw)
    steep = max(-STEEPEST, min(STEEPEST, math.asin(height) + pitch))
    view = ahead * math.cos(steep) + up * math.sin(steep)
    return np.asarray(view)


def shifted(camera: Camera, left: float, top: float, ahead: float) -> Camera:
    """The camera moved along its own axes, in units of the world: the picture's left and top, and
    ahead."""
    matrix, axes = np.array(camera.to_world), np.array(camera.placed[:3, :3])
    matrix[:3, 3] += axes @ [left, top, ahead]
    return dataclasses.replace(camera, to_world=matrix)


def zoomed(camera: Camera, factor: float, distance: float) -> tuple[Camera, float]:
    """The camera with the point `distance` ahead at `factor` times that distance, and this
    distance. An orthographic one shows `factor` times as much instead."""
    if camera.projection == "orthographic":
        matrix = np.array(camera.to_world)
        matrix[:3, :2] *= factor
        return dataclasses.replace(camera, to_world=matrix), distance
    return shifted(camera, 0.0, 0.0, distance * (1.0 - factor)), distance * factor


def visible_height(camera: Camera, film: Film, distance: float) -> float:
    """What the picture's height spans at a distance, in units of the world."""
    half = camera.tan_half_y(film.width, film.height)
    return 2.0 * half * (1.0 if camera.projection == "orthographic" else distance)


def ray(camera: Camera, film: Film, u: float, v: float) -> tuple[Array, Array, float]:
    """Origin and direction (unit) of the ray through the picture at (u, v) in [0, 1] from its top
    left, through the middle of the lens; and what depth along the view a unit of it covers."""
    x = 1.0 - 2.0 * (u + float(camera.principal_point_offset[0]))
    y = 1.0 - 2.0 * (v + float(camera.principal_point_offset[1]))
    half = camera.tan_half_x(film.width, film.height), camera.tan_half_y(film.width, film.height)
    axes: Any = camera.placed[:3, :3]
    if camera.projection == "orthographic":
        offset = axes @ [x, y * half[1] / half[0], 0.0] * half[0]
        return position(camera) + offset, forward(camera), 1.0
    direction = axes @ [x * half[0], y * half[1], 1.0]
    length = float(np.linalg.norm(direction))
    return position(camera), direction / length, 1.0 / length
