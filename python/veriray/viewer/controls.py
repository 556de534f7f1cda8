"""What users of the viewer set, and the checks of what they send.

A `View` holds what differs from the scene file; None stands for the file's value, so that a file
that is read again keeps what users set and brings what they left alone.
"""

from __future__ import annotations

import dataclasses
import json
import math
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np

from ..camera import MAX_PIXELS, Camera
from ..numeric import MAX_COORDINATE, choice, number, shown, whole
from ..scene import Scene
from ..settings import SETTINGS
from . import moves
from .display import CHANNELS, CURVES

#: Bytes of a message at most.
LONGEST = 4096
#: Pixels of the largest picture that users may ask for: 4096 x 4096; and of a side, of JPEG files.
MOST_PIXELS, MOST_SIDE = 1 << 24, 65500
UPS = ("auto", *moves.AXES)
_STEP = 1e3  # of one message, in radians, pictures or steps


class ControlError(ValueError):
    """A message that asks for something that is not allowed."""


@dataclass(frozen=True)
class View:
    """What is shown. distance: of the point ahead about which the camera turns; None: unknown."""

    camera: Camera | None = None
    distance: float | None = None
    up: str = "auto"
    width: int | None = None
    height: int | None = None
    spp: int | None = None
    seed: int = 0
    max_depth: int | None = None
    rr_depth: int | None = None
    sampler: str | None = None
    scheduler: str = "auto"
    exposure: float = 0.0
    curve: str = "standard"
    channel: str = "radiance"

    def scene(self, scene: Scene) -> Scene:
        """The file's scene as it is shown. Raises SceneError."""
        names = ("camera", "width", "height", "spp", "max_depth", "rr_depth", "sampler")
        return scene.with_(**{name: getattr(self, name) for name in names})

    def picture(self) -> tuple[Any, ...]:
        """All that the picture depends on but the number of samples: with another value, it starts
        anew."""
        names = ("camera", "width", "height", "seed", "max_depth", "rr_depth", "sampler",
                 "scheduler")  # fmt: skip
        return tuple(getattr(self, name) for name in names)

    def shown(self) -> tuple[str, float, str]:
        """Channel, exposure and curve: how the picture becomes bytes."""
        return self.channel, self.exposure, self.curve


def _setting(name: str) -> Callable[[Any], Any]:
    return lambda value: SETTINGS[name].checked(name, value, ControlError)


def _number(name: str, low: float, high: float, open_: bool = False) -> Callable[[Any], float]:
    return lambda value: number(name, value, low, high, open_=open_, error=ControlError)


def _choice(name: str, names: tuple[str, ...]) -> Callable[[Any], str]:
    return lambda value: choice(name, value, names, error=ControlError)


def _size(name: str) -> Callable[[Any], int]:
    return lambda value: whole(name, value, 1, MAX_PIXELS, error=ControlError)


#: Fields of a view that a message may set, each with its check.
FIELDS: dict[str, Callable[[Any], Any]] = {
    **{name: _setting(name) for name in
       ("spp", "seed", "max_depth", "rr_depth", "sampler", "scheduler")},
    "width": _size("width"),
    "height": _size("height"),
    "exposure": _number("exposure", -30.0, 30.0),
    "curve": _choice("curve", tuple(CURVES)),
    "channel": _choice("channel", tuple(CHANNELS)),
    "up": _choice("up", UPS),
}  # fmt: skip
#: Fields of its camera, likewise.
LENS: dict[str, Callable[[Any], float]] = {
    "fov": _number("fov", 0.0, 180.0, open_=True),
    "aperture_radius": _number("aperture_radius", 0.0, MAX_COORDINATE),
    "focus_distance": _number("focus_distance", 0.0, MAX_COORDINATE, open_=True),
}
#: Numbers of the moves.
MOVES = {"orbit": ("x", "y"), "look": ("x", "y"), "pan": ("x", "y"), "zoom": ("x",),
         "fly": ("x", "y", "z"), "focus": ("x", "y"), "reset": ()}  # fmt: skip


@dataclass(frozen=True)
class Action:
    """A checked message. what: of MOVES, or "set" with the field's name; moves: the view moves."""

    what: str
    name: str = ""
    value: Any = None
    numbers: tuple[float, ...] = ()

    @property
    def moves(self) -> bool:
        """Whether more of its kind are likely to follow at once."""
        return self.what not in ("set", "reset", "focus") or self.name in (*LENS,)


def parse(message: str | bytes) -> Action:
    """What a message asks for. Raises ControlError for anything else."""
    if not isinstance(message, str):
        raise ControlError("a message is text")
    if len(message) > LONGEST:
        raise ControlError(f"a message of {len(message)} characters; at most {LONGEST}")
    try:
        content = json.loads(message)
    except (ValueError, RecursionError):
        raise ControlError(f"not JSON: {shown(message)}") from None
    if not isinstance(content, dict):
        raise ControlError(f"not an object: {shown(content)}")
    what = content.get("do")
    if what == "set":
        return _parsed_set(content.get("name"), content.get("value"))
    if not isinstance(what, str) or what not in MOVES:
        raise ControlError(f'"do" = {shown(what)}; expected set, {", ".join(MOVES)}')
    limit = 1.0 if what == "focus" else _STEP
    low = 0.0 if what == "focus" else -limit
    numbers = (
        number(f'"{name}" of {what}', content.get(name), low, limit, error=ControlError)
        for name in MOVES[what]
    )
    return Action(what, numbers=tuple(numbers))


def _parsed_set(name: Any, value: Any) -> Action:
    known = {**FIELDS, **LENS}
    if not isinstance(name, str) or name not in known:
        raise ControlError(f'"name" = {shown(name)}; expected {", ".join(known)}')
    if value is None and name in FIELDS:  # the file's, or the default
        return Action("set", name, View.__dataclass_fields__[name].default)
    return Action("set", name, known[name](value))


def applied(view: View, action: Action, file: Scene, depth: float | None = None) -> View:
    """The view after an action. file: the scene as the file has it; depth: along the view, of what
    an action "focus" hit, None for nothing. Raises ValueError, and leaves the view as it is."""
    if action.what == "reset":
        return dataclasses.replace(view, camera=None, distance=None, up="auto")
    if action.what == "set" and action.name in FIELDS:
        after = dataclasses.replace(view, **{action.name: action.value})
        film = after.scene(file).film
        sized = action.name in ("width", "height") and action.value is not None
        size = f"{film.width} x {film.height}"
        if sized and film.width * film.height > MOST_PIXELS:
            raise ControlError(f"a picture of {size} has more than {MOST_PIXELS} pixels")
        if sized and max(film.width, film.height) > MOST_SIDE:
            raise ControlError(f"a picture of {size} has a side above {MOST_SIDE} pixels")
        return after
    camera = file.camera if view.camera is None else view.camera
    if action.what == "set":
        opened = action.name == "aperture_radius" and not camera.aperture_radius
        if opened and view.distance and camera.projection == "perspective":  # no focus so far
            camera = dataclasses.replace(camera, focus_distance=view.distance)
        camera = dataclasses.replace(camera, **{action.name: action.value})
        return dataclasses.replace(view, camera=camera)
    if action.what == "focus":
        if depth is None:
            return view
        if camera.aperture_radius:
            camera = dataclasses.replace(camera, focus_distance=depth)
            view = dataclasses.replace(view, camera=camera)
        return dataclasses.replace(view, distance=depth)
    return _moved(view, camera, action, file)


def _moved(view: View, camera: Camera, action: Action, file: Scene) -> View:
    up = moves.up_axis(camera) if view.up == "auto" else np.array(moves.AXES[view.up])
    distance = view.distance if view.distance is not None else reach(file)
    film = view.scene(file).film
    what, numbers = action.what, action.numbers
    if what == "zoom":
        factor = math.exp(max(-5.0, min(5.0, numbers[0])))
        camera, distance = moves.zoomed(camera, factor, distance)
    elif what == "orbit":
        camera = moves.orbited(camera, numbers[0], numbers[1], up, distance)
    elif what == "look":
        camera = moves.turned(camera, numbers[0], numbers[1], up)
    elif what == "pan":
        height = moves.visible_height(camera, film, distance)
        camera = moves.shifted(camera, numbers[0] * height, numbers[1] * height, 0.0)
    else:
        camera = moves.shifted(camera, *(x * distance for x in numbers))
    return dataclasses.replace(view, camera=camera, distance=distance)


def reach(scene: Scene) -> float:
    """A length of the scene's order where nothing is ahead: the focus of a lens, else from the
    camera to the middle of what there is, else 1."""
    if scene.camera.aperture_radius:
        return scene.camera.focus_distance
    points = [p for p in (scene.vertices, scene.spheres[:, :3]) if len(p)]
    if not points:
        return 1.0
    low = np.min([p.min(axis=0) for p in points], axis=0)
    high = np.max([p.max(axis=0) for p in points], axis=0)
    away = float(np.linalg.norm((low + high) / 2 - moves.position(scene.camera)))
    return away or float(np.linalg.norm(high - low)) or 1.0
