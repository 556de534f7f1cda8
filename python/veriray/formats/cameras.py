"""Cameras of other programs: lists of views for data sets, read and written.

Read are, each with its own axes and pixels (x right, y down):

- NeRF `transforms.json` (key "frames"): `transform_matrix` is camera to world with OpenGL's axes
  (x right, y up, looks along -z); `camera_angle_x` in radians, or `fl_x`, `fl_y`, `cx`, `cy`, `w`,
  `h` in pixels, for all frames or each; the picture's top left corner is (0, 0).
- COLMAP, a folder with `cameras.txt` (SIMPLE_PINHOLE, PINHOLE, and models of distortion whose
  coefficients are 0) and `images.txt`: world to camera as quaternion (w, x, y, z) and translation
  with OpenCV's axes; the picture's top left corner is (0, 0). The lines of points may be left out.
- {"convention": "opencv", "cameras": [{"name", "K", "R", "t" or "matrix", "width", "height"}]}:
  world to camera, x right, y down, looks along +z; the centre of the top left pixel is (0, 0).
- {"convention": "opengl", "cameras": [{"name", "matrix", "fov", "fov_axis" or "K", "width",
  "height"}]}: camera to world, x right, y up, looks along -z; fov in degrees; K as above.
- {"convention": "mitsuba", "cameras": [{"name", "matrix", "fov", "fov_axis",
  "principal_point_offset_x", "principal_point_offset_y"}]}: camera to world, x left, y up, looks
  along +z.

Lenses have no distortion: keys of it must be 0 or empty, whatever the list. What several keys say
of a camera must agree.

width and height may stand beside "cameras" for all of them, else they are the scene's. Names become
file names; those without get numbers.
"""

from __future__ import annotations

import json
import math
import os
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from pathlib import Path, PurePosixPath
from typing import Any

import numpy as np
import numpy.typing as npt

from .. import transform
from ..camera import MAX_PIXELS, Camera
from ..errors import SceneError
from ..files import open_regular
from ..numeric import check_matrix, check_rotation, number, path_text, shown, view_angle, whole

Array = npt.NDArray[Any]
Entry = Mapping[str, Any]
MAX_BYTES, MAX_VIEWS = 1 << 28, 1 << 20
CONVENTIONS = ("opencv", "opengl", "mitsuba")
#: What programs call distortion, in small letters without "_": it must be 0 or empty.
_DISTORTION = (
    "k1", "k2", "k3", "k4", "k5", "k6", "p1", "p2", "d", "dist", "distcoeffs", "distortion",
    "distortionparams", "distortioncoeffs", "distortioncoefficients", "radialdistortion",
    "tangentialdistortion", "isfisheye", "fisheye",
)  # fmt: skip
_PLAIN = ("OPENCV", "PINHOLE", "SIMPLE_PINHOLE", "PERSPECTIVE", "SIMPLE_RADIAL", "RADIAL",
          "FULL_OPENCV")  # fmt: skip
#: COLMAP's models: focal lengths, and numbers in all; the others after the centre must be 0.
_MODELS = {"SIMPLE_PINHOLE": (1, 3), "PINHOLE": (2, 4), "SIMPLE_RADIAL": (1, 4), "RADIAL": (1, 5),
           "OPENCV": (2, 8), "FULL_OPENCV": (2, 12)}  # fmt: skip
_FLIP = np.diag([-1.0, 1.0, -1.0, 1.0])  # between OpenGL's axes and ours


@dataclass(frozen=True)
class View:
    """A camera with the name of its picture, which has no suffix, and its size in pixels."""

    name: str
    camera: Camera
    width: int
    height: int


def load(path: str | os.PathLike[str], width: int, height: int, **lens: Any) -> list[View]:
    """The views of a file or of a folder of COLMAP's.

    width, height: of pictures whose size is not stated. lens: other fields of Camera for all of
    them (near_clip, far_clip, aperture_radius, focus_distance, medium). Raises SceneError naming
    file, entry, key and value, OSError for a file that cannot be read.
    """
    where = path_text("cameras", path)
    if os.path.isdir(where):
        return _named(_colmap(Path(where), lens), where)
    data = parsed(where)
    size = {"width": width, "height": height}
    if "frames" in data:
        entries, make = _list(data, "frames", where), _frame
    else:
        convention = data.get("convention")
        if convention not in CONVENTIONS:
            raise SceneError(
                f'"convention" = {shown(convention)}; expected {", ".join(CONVENTIONS)}, or '
                '"frames" as in transforms.json',
                where,
            )
        entries = _list(data, "cameras", where)
        make = {"opencv": _opencv, "opengl": _opengl, "mitsuba": _mitsuba}[convention]
    views = []
    for k, entry in enumerate(entries):
        place = f"{where}: {'frames' if 'frames' in data else 'cameras'}[{k}]"
        if not isinstance(entry, dict):
            raise SceneError(f"{shown(entry)} is not an object", place)
        views.append(_made({**size, **data, **entry}, k, make, lens, place))
    return _named(views, where)


def parsed(path: str) -> dict[str, Any]:
    """What a JSON file holds. Raises SceneError unless it is an object."""
    try:
        data = json.loads(_text(path))
    except (ValueError, RecursionError) as error:
        raise SceneError(f"not JSON: {error}", path) from None
    if not isinstance(data, dict):
        raise SceneError(f"{shown(data)} is not an object", path)
    return data


def transforms(views: list[View], suffix: str = ".exr") -> dict[str, Any]:
    """A NeRF `transforms.json` of perspective views, each frame with its own intrinsics."""
    frames = []
    for view in views:
        camera = view.camera
        if camera.projection != "perspective":
            raise SceneError(f"{view.name}: transforms.json holds no {camera.projection} camera")
        focal = view.width / (2 * camera.tan_half_x(view.width, view.height))
        shift = 0.5 - np.asarray(camera.principal_point_offset)
        frames.append(
            {
                "file_path": f"{view.name}{suffix}", "w": view.width, "h": view.height,
                "fl_x": focal, "fl_y": focal, "cx": float(shift[0] * view.width),
                "cy": float(shift[1] * view.height),
                "transform_matrix": transform.compose(np.array(camera.to_world), _FLIP).tolist(),
            }
        )  # fmt: skip
    return {"camera_model": "PINHOLE", "frames": frames}


# ---- entries ----


def _made(
    entry: Entry, k: int, make: Callable[..., Camera], lens: dict[str, Any], place: str
) -> View:
    try:
        width, height = (_size(entry, *names) for names in (("width", "w"), ("height", "h")))
        name = entry.get("file_path", entry.get("name", f"{k:04d}"))
        _check_plain(entry)
        camera = make(entry, width, height, lens)
        _check_stated(entry, camera, width, height)
        return View(_file_name(name), camera, width, height)
    except SceneError as error:
        raise SceneError(str(error), place) from None


def _check_plain(entry: Entry) -> None:
    """Raises SceneError for a lens that distorts."""
    for key in ("camera_model", "camera_type"):
        model = entry.get(key)
        if model is not None and str(model).upper() not in _PLAIN:
            raise SceneError(f'"{key}" = {shown(model)}; expected {", ".join(_PLAIN)}')
    for key, value in entry.items():
        if key.lower().replace("_", "") in _DISTORTION and not _is_nothing(value):
            raise SceneError(
                f'"{key}" = {shown(value)}: lenses have no distortion here; expected 0'
            )


def _is_nothing(value: Any, levels: int = 3) -> bool:
    """Whether a value is null, false, 0 or empty, or holds only such."""
    if levels and isinstance(value, (list, dict)):
        parts = value.values() if isinstance(value, dict) else value
        return all(_is_nothing(part, levels - 1) for part in parts)
    return not value


def _check_stated(entry: Entry, camera: Camera, width: int, height: int) -> None:
    """Raises SceneError for a key that says of the camera what it is not."""
    focal = width / (2 * camera.tan_half_x(width, height))
    x, y = camera.principal_point_offset.tolist()
    angles = view_angle(width, focal), view_angle(height, focal)
    stated = {  # and how far off a rounded number may be
        **dict.fromkeys(("fl_x", "fl_y", "fx", "fy"), (focal, 1e-3 * focal)),
        "camera_angle_x": (math.radians(angles[0]), 1e-3 * math.radians(angles[0])),
        "camera_angle_y": (math.radians(angles[1]), 1e-3 * math.radians(angles[1])),
        "cx": ((0.5 - x) * width, 0.501),  # from the picture's corner or the first pixel's middle
        "cy": ((0.5 - y) * height, 0.501),
        "principal_point_offset_x": (x, 1e-3), "principal_point_offset_y": (y, 1e-3),
        "aperture_radius": (camera.aperture_radius, 1e-3 * camera.aperture_radius),
        **dict.fromkeys(("skew", "shift_x", "shift_y"), (0.0, 0.0)),
    }  # fmt: skip
    if "K" in entry:
        stated["fov"] = angles[0], 1e-3 * angles[0]
    for key, (own, off) in stated.items():
        given = entry.get(key)
        if given is not None and abs(number(f'"{key}"', given, -1e9, 1e9) - own) > off:
            raise SceneError(
                f'"{key}" = {given:g}; expected {own:g}, as the other keys and the scene have it'
            )


def _frame(entry: Entry, width: int, height: int, lens: dict[str, Any]) -> Camera:
    matrix = _rigid(entry, "transform_matrix")
    if entry.get("fl_x") is not None:
        focal = _positive(entry, "fl_x")
        _square(focal, _positive(entry, "fl_y") if entry.get("fl_y") is not None else focal)
        fov = view_angle(width, focal)
    elif entry.get("camera_angle_x") is not None:
        angle = number('"camera_angle_x"', entry["camera_angle_x"], 0.0, math.pi, open_=True)
        fov = math.degrees(angle)
    elif entry.get("fl_y") is not None:
        fov = view_angle(width, _positive(entry, "fl_y"))
    else:
        raise SceneError('neither "fl_x" nor "camera_angle_x" is given')
    centre = [entry.get(key, size / 2) for key, size in (("cx", width), ("cy", height))]
    return Camera.from_opengl(matrix, fov, **_centred(centre, width, height), **lens)


def _opencv(entry: Entry, width: int, height: int, lens: dict[str, Any]) -> Camera:
    given: dict[str, Any] = {key: entry[key] for key in ("R", "t", "matrix") if key in entry}
    if "K" not in entry:
        raise SceneError('"K" is missing')
    return Camera.from_opencv(entry["K"], width=width, height=height, **given, **lens)


def _opengl(entry: Entry, width: int, height: int, lens: dict[str, Any]) -> Camera:
    matrix = _rigid(entry, "matrix")
    if "K" in entry:
        found = Camera.from_opencv(
            entry["K"], width=width, height=height, matrix=np.eye(4), **lens
        )  # for its field of view
        shift = {"principal_point_offset": found.principal_point_offset}
        return Camera.from_opengl(matrix, found.fov, **shift, **lens)
    axis = entry.get("fov_axis", "x")
    return Camera.from_opengl(matrix, _positive(entry, "fov"), fov_axis=axis, **lens)


def _mitsuba(entry: Entry, width: int, height: int, lens: dict[str, Any]) -> Camera:
    axis = entry.get("fov_axis", "x")
    shift = [
        number(f'"{key}"', entry.get(key, 0.0), -1e3, 1e3)
        for key in ("principal_point_offset_x", "principal_point_offset_y")
    ]
    return Camera(_matrix(entry, "matrix"), _positive(entry, "fov"), axis,
                  principal_point_offset=np.array(shift), **lens)  # fmt: skip


def _colmap(folder: Path, lens: dict[str, Any]) -> list[View]:
    """The views of `images.txt`, with the intrinsics of `cameras.txt`."""
    for name in ("cameras", "images"):
        binary = folder / f"{name}.bin"
        if binary.exists() and not binary.with_suffix(".txt").exists():
            raise SceneError(
                f"binary files of COLMAP's are not read; expected {name}.txt, as "
                "`colmap model_converter --output_type TXT` writes it", str(binary),
            )  # fmt: skip
    cameras = {row[1][0]: row for row in _rows(folder / "cameras.txt") if row[1]}
    views: list[View] = []
    above = False  # whether the line above is an image's, and this one may hold its points
    for place, words in _rows(folder / "images.txt"):
        if not words or (above and _are_points(words)):
            above = False
            continue
        if len(words) < 10:
            raise SceneError(f"{len(words)} words; expected ID QW QX QY QZ TX TY TZ CAMERA NAME",
                             place)  # fmt: skip
        if words[8] not in cameras:
            raise SceneError(f"camera {shown(words[8])} is not in cameras.txt", place)
        width, height, focal, centre = _intrinsics(*cameras[words[8]])
        numbers = _floats(words[1:8], place)

        def make(
            entry: Entry, w: int, h: int, lens: dict[str, Any], f: float = focal,
            c: list[float] = centre, n: list[float] = numbers,
        ) -> Camera:  # fmt: skip
            k = [[f, 0.0, c[0] - 0.5], [0.0, f, c[1] - 0.5], [0.0, 0.0, 1.0]]
            return Camera.from_opencv(k, _rotation(n[:4]), n[4:], width=w, height=h, **lens)

        entry = {"width": width, "height": height, "name": " ".join(words[9:])}
        views.append(_made(entry, len(views), make, lens, place))
        above = True
    return views


def _are_points(words: list[str]) -> bool:
    """Whether a line of images.txt is of points (X Y ID each), not ID QW ... CAMERA NAME."""
    try:
        return len(words) % 3 == 0 and all(math.isfinite(float(word)) for word in words[:12])
    except ValueError:
        return False


def _intrinsics(place: str, words: list[str]) -> tuple[int, int, float, list[float]]:
    """Width, height, focal length and centre in pixels of a line of cameras.txt."""
    if len(words) < 4 or words[1] not in _MODELS:
        model = words[1] if len(words) > 1 else ""
        allowed = ", ".join(_MODELS)
        raise SceneError(f"model {shown(model)} is unknown; expected {allowed}", place)
    focals, count = _MODELS[words[1]]
    try:
        width, height = (
            whole(name, int(x) if x.isdecimal() else x, 1, MAX_PIXELS)
            for name, x in zip(("width", "height"), words[2:4], strict=True)
        )
    except SceneError as error:
        raise SceneError(str(error), place) from None
    values = _floats(words[4:], place)
    if len(values) != count:
        raise SceneError(f"{words[1]} with {len(values)} numbers; expected {count}", place)
    if any(values[focals + 2 :]):
        raise SceneError(
            f"{words[1]} with coefficients {values[focals + 2 :]}: lenses have no distortion here; "
            "expected 0", place,
        )  # fmt: skip
    if focals == 2:
        _square(values[0], values[1], place)
    return width, height, values[0], values[focals : focals + 2]


def _rotation(quaternion: list[float]) -> Array:
    """The matrix (3, 3) of a quaternion (w, x, y, z)."""
    norm = math.sqrt(sum(q * q for q in quaternion))
    if not abs(norm - 1) < 1e-2:
        raise SceneError(f"quaternion {quaternion} is not of length 1")
    w, x, y, z = (q / norm for q in quaternion)
    return transform.turned(x, y, z, w)


# ---- parts ----


def _text(path: str) -> str:
    with open_regular(path) as file:
        data = file.read(MAX_BYTES + 1)
    if len(data) > MAX_BYTES:
        raise SceneError(f"more than {MAX_BYTES} bytes", path)
    try:
        return data.decode("utf-8-sig")
    except UnicodeDecodeError as error:
        raise SceneError(f"not UTF-8: {error.reason} at byte {error.start}", path) from None


def _rows(file: Path) -> list[tuple[str, list[str]]]:
    """Place and words of each line but comments."""
    lines = _text(os.fspath(file)).split("\n")
    return [(f"{file}:{k}", line.split()) for k, line in enumerate(lines, 1)
            if not line.startswith("#")]  # fmt: skip


def _floats(words: list[str], place: str) -> list[float]:
    values = []
    for word in words:
        try:
            values.append(float(word))
        except ValueError:
            raise SceneError(f"{shown(word)} is not a number", place) from None
        if not math.isfinite(values[-1]):
            raise SceneError(f"{word} is not finite", place)
    return values


def _list(data: Entry, key: str, where: str) -> list[Any]:
    found = data.get(key)
    if not isinstance(found, list) or not 1 <= len(found) <= MAX_VIEWS:
        raise SceneError(f'"{key}" is not a list of 1 to {MAX_VIEWS} views', where)
    return found


def _matrix(entry: Entry, key: str) -> Array:
    if key not in entry:
        raise SceneError(f'"{key}" is missing')
    return check_matrix(f'"{key}"', entry[key])


def _rigid(entry: Entry, key: str) -> Array:
    """A matrix (4, 4) that turns and moves."""
    matrix = _matrix(entry, key)
    check_rotation(f'"{key}"', matrix)
    return matrix


def _positive(entry: Entry, key: str) -> float:
    if key not in entry:
        raise SceneError(f'"{key}" is missing')
    return number(f'"{key}"', entry[key], 0.0, 1e9, open_=True)


def _size(entry: Entry, *names: str) -> int:
    value = next((entry[name] for name in reversed(names) if name in entry), None)
    if isinstance(value, float) and value.is_integer():
        value = int(value)
    return whole(names[0], value, 1, MAX_PIXELS)


def _square(x: float, y: float, place: str = "") -> None:
    if abs(x - y) > 1e-6 * x:
        raise SceneError(f"focal lengths {x:g} and {y:g}: pixels must be square", place)


def _centred(centre: list[Any], width: int, height: int) -> dict[str, Any]:
    """The principal point, from pixels of a picture whose top left corner is (0, 0)."""
    cx, cy = (
        number(f'"{name}"', x, -1e9, 1e9) for name, x in zip(("cx", "cy"), centre, strict=True)
    )
    return {"principal_point_offset": np.array([0.5 - cx / width, 0.5 - cy / height])}


def _file_name(name: Any) -> str:
    """A name without its suffix, below the folder of the data set."""
    try:
        good = bool(os.fsencode(name)) and not {"\0", "\\"} & set(name)
    except (TypeError, UnicodeEncodeError):
        good = False
    if not good or not isinstance(name, str):
        raise SceneError(f"name {shown(name)} is none of a file")
    path = PurePosixPath(name)
    parts = [part for part in path.parts if part != "."]
    if path.is_absolute() or ".." in parts or not parts:
        raise SceneError(f"name {shown(name)} leads out of the folder")
    if path.suffix.lower() in (".png", ".jpg", ".jpeg", ".exr", ".tif", ".tiff", ".webp"):
        parts[-1] = path.stem
    return "/".join(parts)


def _named(views: list[View], where: str) -> list[View]:
    seen: set[str] = set()
    for view in views:
        if view.name in seen:
            raise SceneError(f"two views are named {shown(view.name)}", where)
        seen.add(view.name)
    if not views:
        raise SceneError("no views", where)
    return views
