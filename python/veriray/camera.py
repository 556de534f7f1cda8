"""The camera, and the film that it exposes."""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np
import numpy.typing as npt

from . import transform
from .errors import SceneError
from .numeric import (
    MAX_COORDINATE,
    array,
    check_matrix,
    check_rigid,
    check_rotation,
    choice,
    in_range,
    number,
    restore,
    tan_half_degrees,
    view_angle,
    whole,
)

Array = npt.NDArray[Any]

FILTERS = ("box", "tent", "gaussian", "mitchell", "lanczos")
FILTER_DEFAULTS: dict[str, float | tuple[float, float]] = {
    "box": 0.5,
    "tent": 1.0,
    "gaussian": 0.5,
    "mitchell": (1.0 / 3.0, 1.0 / 3.0),
    "lanczos": 3.0,
}
MOST_LOBES = 16
PROJECTIONS = ("perspective", "orthographic", "irradiance", "distant")
PATCH_KINDS = ("triangle", "parallelogram", "disk", "sphere")
FOV_AXES = ("x", "y", "diagonal", "smaller", "larger")
MAX_PIXELS = 2**31 - 1
_UP = (0.0, 1.0, 0.0)
_NO_FOV = 90.0  # of a camera to which it means nothing


@dataclass(frozen=True)
class Film:
    """Picture size and reconstruction filter.

    filter: "box" (1 pixel wide), "tent" (filter_parameter = radius in pixels), "gaussian"
    (filter_parameter = standard deviation s in pixels: exp(-x^2 / (2 s^2)) - exp(-8) where
    abs(x) < 4 s), "mitchell" (filter_parameter = (B, C) of Mitchell and Netravali, 1988, each in
    [0, 1]; 4 pixels wide, with negative lobes) or "lanczos" (filter_parameter = a, a whole number
    of lobes from 1 to 16: sinc(x) sinc(x / a) where abs(x) < a, sinc(x) = sin(pi x) / (pi x)).
    What scene files call "catmullrom" is "mitchell" with (0, 0.5).
    filter_parameter None takes the filter's default: 0.5, 1.0, 0.5, (1/3, 1/3) and 3.
    Raises SceneError for a size below 1 or above 2^31 pixels, or an unknown filter.
    """

    width: int = 768
    height: int = 576
    filter: str = "gaussian"
    filter_parameter: float | tuple[float, float] | None = None

    def __post_init__(self) -> None:
        width = whole("film width", self.width, 1, MAX_PIXELS)
        height = whole("film height", self.height, 1, MAX_PIXELS)
        if width * height > MAX_PIXELS:
            raise SceneError(f"film of {width} x {height} pixels has more than {MAX_PIXELS}")
        choice("filter", self.filter, FILTERS)
        default = FILTER_DEFAULTS[self.filter]
        parameter: Any = default if self.filter_parameter is None else self.filter_parameter
        if self.filter == "mitchell":
            pair = array("filter_parameter", parameter, np.float64, (2,))
            in_range("filter_parameter", pair, 0.0, 1.0)
            parameter = tuple(pair.tolist())
        elif self.filter == "lanczos":
            parameter = number("filter_parameter", parameter, 1.0, MOST_LOBES)
            if not parameter.is_integer():
                raise SceneError(f"filter_parameter = {parameter:g} of lanczos is no whole number")
        else:
            parameter = number("filter_parameter", parameter, 1e-3, 100.0)
            if self.filter == "box" and parameter != default:
                raise SceneError(f"filter_parameter = {parameter:g} of the box filter must be 0.5")
        for name, value in (("width", width), ("height", height), ("filter_parameter", parameter)):
            object.__setattr__(self, name, value)

    @property
    def filter_parameters(self) -> tuple[float, float]:
        """The filter's numbers as a pair; 0 for the second one that most filters lack."""
        parameter: Any = self.filter_parameter
        return parameter if isinstance(parameter, tuple) else (parameter, 0.0)


@dataclass(frozen=True, eq=False)
class Camera:
    """A camera with the conventions of Mitsuba's `perspective`, `thinlens` and `orthographic`.

    to_world: (4, 4) float64, no scale; looks along local +Z, with local +X on the picture's left.
    fov: degrees in (0, 180), measured along fov_axis ("x", "y", "diagonal", "smaller", "larger").
    near_clip, far_clip: distances along local Z; 0 and infinity clip nothing.
    principal_point_offset: (x, y) in film widths and heights. The ray through film position
    (u, v), both in [0, 1] from the top left, has the local direction
    (tan_half_x (1 - 2 (u + offset x)), tan_half_y (1 - 2 (v + offset y)), 1).
    aperture_radius: of the lens, 0 for a pinhole. focus_distance: along local Z to the plane in
    focus; used if the aperture is above 0. medium: index of the medium around the camera in the
    scene's media, -1 for vacuum.
    projection: "perspective", or "orthographic": the rays are parallel to local Z and start at the
    film, local x in [-1, 1] and y as its height asks, at z = near_clip; they end far_clip -
    near_clip world units further. to_world may then scale but not shear; fov and principal point
    have no effect, and there is no aperture. `Camera.orthographic` makes one.
    Or "irradiance": rays leave the front of a surface by the cosine to its normal and count pi
    times, so that a picture's mean is the surface's mean irradiance. Or "distant": rays along local
    Z come from outside of the scene to the surface, even over its area. The place on the film says
    where on the surface. Of to_world the place has no effect, and the lens and clipping have none.
    patches: (N, 11) float64, that surface, which need not be one of the scene: the index in
    PATCH_KINDS, 1 or -1 where the normal is the axes' product or its opposite, a point, and two
    axes in world units: of triangles and parallelograms from a corner, of discs the half axes; of
    spheres (radius, 0, 0) and zeros, the normal outwards or inwards.
    Raises SceneError for values outside these ranges and for a singular or scaling to_world.
    """

    to_world: Array
    fov: float
    fov_axis: str = "x"
    near_clip: float = 0.0
    far_clip: float = math.inf
    principal_point_offset: Array = field(default_factory=lambda: np.zeros(2))
    aperture_radius: float = 0.0
    focus_distance: float = 1.0
    medium: int = -1
    projection: str = "perspective"
    patches: Array = field(default_factory=lambda: np.empty((0, 11)))

    def __post_init__(self) -> None:
        matrix = check_matrix("camera to_world", self.to_world)
        choice("projection", self.projection, PROJECTIONS)
        if self.projection != "orthographic":
            check_rigid("camera to_world", "a camera", matrix)
        else:
            _check_parallel(matrix, self.aperture_radius)
        choice("fov_axis", self.fov_axis, FOV_AXES)
        near = number("near_clip", self.near_clip, 0.0, MAX_COORDINATE)
        far = number("far_clip", self.far_clip, 0.0, math.inf)
        if not far > near:
            raise SceneError(f"far_clip = {far:g} must be greater than near_clip = {near:g}")
        patches = array("patches", self.patches, np.float64, (None, 11))
        _check_patches(patches, self.projection)
        offset = array("principal_point_offset", self.principal_point_offset, np.float64, (2,))
        if np.abs(offset).max() > 1e9:
            raise SceneError(f"principal_point_offset = {offset.tolist()} exceeds 1e9 film sizes")
        values = {
            "to_world": matrix,
            "fov": number("fov", self.fov, 0.0, 180.0, open_=True),
            "near_clip": near,
            "far_clip": far,
            "principal_point_offset": offset,
            "aperture_radius": number("aperture_radius", self.aperture_radius, 0.0, MAX_COORDINATE),
            "focus_distance": number(
                "focus_distance", self.focus_distance, 0.0, MAX_COORDINATE, open_=True
            ),
            "medium": whole("camera medium", self.medium, -1, 2**31 - 1),
            "patches": patches,
        }
        for name, value in values.items():
            object.__setattr__(self, name, value)

    __setstate__ = restore

    @property
    def measures(self) -> bool:
        """Whether its rays begin at, or go to, a surface."""
        return self.projection in ("irradiance", "distant")

    @property
    def around(self) -> tuple[Array, float]:
        """Centre (3,) and radius of a ball about the patches."""
        kind, point, a, b = (
            self.patches[:, k] for k in (0, slice(2, 5), slice(5, 8), slice(8, 11))
        )
        corner = np.minimum(a, 0) + np.minimum(b, 0), np.maximum(a, 0) + np.maximum(b, 0)
        flat = (kind < PATCH_KINDS.index("disk"))[:, None]
        reach = np.where((kind == PATCH_KINDS.index("sphere"))[:, None], a[:, :1], np.hypot(a, b))
        low = (point + np.where(flat, corner[0], -reach)).min(axis=0)
        high = (point + np.where(flat, corner[1], reach)).max(axis=0)
        half = 0.5 * (high - low)
        return low + half, math.sqrt(math.fsum((half * half).tolist()))

    @property
    def placed(self) -> Array:
        """to_world (4, 4) without its scale."""
        if self.projection != "orthographic":
            return self.to_world
        matrix = np.array(self.to_world)
        matrix[:3, :3] /= _scales(matrix)
        matrix.setflags(write=False)
        return matrix

    @property
    def clip_depths(self) -> tuple[float, float]:
        """Distances of the near and the far plane along the view, in world units."""
        if self.projection != "orthographic":
            return self.near_clip, self.far_clip
        near = self.near_clip * _scales(self.to_world)[2]
        return near, near + (self.far_clip - self.near_clip)

    def tan_half_x(self, width: int, height: int) -> float:
        """Tangent of half the horizontal field of view for a film of width x height pixels.

        Of an orthographic camera half of the film's width in world units.
        """
        width, height = whole("width", width, 1, MAX_PIXELS), whole("height", height, 1, MAX_PIXELS)
        if self.projection == "orthographic":
            return _scales(self.to_world)[0]
        tangent = tan_half_degrees(self.fov)
        axis = self.fov_axis
        if axis in ("smaller", "larger"):
            axis = "y" if (axis == "smaller") == (width > height) else "x"
        if axis == "y":
            return tangent * (width / height)
        if axis == "diagonal":
            return tangent * (width / math.sqrt(float(width * width + height * height)))
        return tangent

    def tan_half_y(self, width: int, height: int) -> float:
        """Likewise, vertically."""
        if self.projection == "orthographic":
            whole("width", width, 1, MAX_PIXELS), whole("height", height, 1, MAX_PIXELS)
            return _scales(self.to_world)[1] * (int(height) / int(width))
        return self.tan_half_x(width, height) * (int(height) / int(width))

    # ---- other cameras ----

    @classmethod
    def look_at(
        cls,
        origin: Sequence[float],
        target: Sequence[float],
        up: Sequence[float] = _UP,
        fov: float = 40.0,
        **lens: Any,
    ) -> Camera:
        """A camera at `origin` with `target` in the middle of the picture and `up` upwards.

        lens: the other fields of Camera. Raises SceneError if target is origin or lies along up.
        """
        eye, aim = _vector("origin", origin), _vector("target", target)
        return cls(transform.look_at(eye, aim, _vector("up", up)), fov, **lens)

    @classmethod
    def orthographic(cls, to_world: Any, **clip: Any) -> Camera:
        """A camera with parallel rays: see `projection`.

        clip: near_clip, far_clip and medium of Camera. Raises SceneError as Camera does.
        """
        return cls(to_world, _NO_FOV, projection="orthographic", **clip)

    @classmethod
    def from_opengl(cls, matrix: Any, fov: float, **lens: Any) -> Camera:
        """A camera from a (4, 4) camera-to-world matrix that looks along -Z, +X right, +Y up.

        That is the convention of OpenGL, Blender and glTF. lens: the other fields of Camera.
        """
        given = check_matrix("matrix", matrix)
        return cls(transform.compose(given, np.diag([-1.0, 1.0, -1.0, 1.0])), fov, **lens)

    @classmethod
    def from_opencv(
        cls,
        K: Any,
        R: Any = None,
        t: Any = None,
        *,
        width: int,
        height: int,
        matrix: Any = None,
        **lens: Any,
    ) -> Camera:
        """A camera from OpenCV's intrinsics and extrinsics, without lens distortion.

        K: (3, 3), [[f, 0, cx], [0, f, cy], [0, 0, 1]] in pixels of a picture of width x height, the
        centre of the top left pixel at (0, 0). x_camera = R x_world + t with rotation R (3, 3) and
        t (3,), camera axes +X right, +Y down, +Z forward; or matrix = [R t; 0 1] (4, 4) instead.
        Raises SceneError for skew, pixels that are not square (to 1e-6) and an R that is not a
        rotation (to 1e-3).
        """
        k = array("K", K, np.float64, (3, 3))
        (fx, skew, cx), (zero, fy, cy) = k[0].tolist(), k[1].tolist()
        if skew or zero or k[2].tolist() != [0.0, 0.0, 1.0] or min(fx, fy) <= 0:
            raise SceneError(f"K = {k.tolist()}, expected [[f, 0, cx], [0, f, cy], [0, 0, 1]]")
        if abs(fx - fy) > 1e-6 * fx:
            raise SceneError(f"K has focal lengths {fx:g} and {fy:g}: pixels must be square")
        if (matrix is None) == (R is None or t is None):
            raise SceneError("give either R and t or matrix")
        if matrix is None:
            matrix = np.eye(4)
            matrix[:3, :3] = array("R", R, np.float64, (3, 3))
            column = isinstance(t, np.ndarray) and t.shape == (3, 1)
            matrix[:3, 3] = array("t", t.ravel() if column else t, np.float64, (3,))
        view = check_matrix("matrix [R t]", matrix)
        check_rotation("R", view)
        back = np.eye(4)
        back[:3, :3] = view[:3, :3].T
        position = transform.compose(back, transform.translate((-view[:3, 3]).tolist()))
        width, height = whole("width", width, 1, MAX_PIXELS), whole("height", height, 1, MAX_PIXELS)
        offset = [0.5 - (cx + 0.5) / width, 0.5 - (cy + 0.5) / height]
        to_world = transform.compose(position, np.diag([-1.0, -1.0, 1.0, 1.0]))
        fov = view_angle(width, fx)
        return cls(to_world, fov, "x", principal_point_offset=np.array(offset), **lens)

    def looking_at(
        self,
        target: Sequence[float],
        origin: Sequence[float] | None = None,
        up: Sequence[float] = _UP,
    ) -> Camera:
        """This camera with the same lens, turned to `target`, and moved to `origin` if given."""
        eye = self.to_world[:3, 3].tolist() if origin is None else _vector("origin", origin)
        matrix = transform.look_at(eye, _vector("target", target), _vector("up", up))
        if self.projection == "orthographic":
            matrix = transform.compose(matrix, transform.scale(_scales(self.to_world)))
        return dataclasses.replace(self, to_world=matrix)

    def orbit(
        self,
        azimuth: float,
        elevation: float = 0.0,
        centre: Sequence[float] = (0.0, 0.0, 0.0),
        up: Sequence[float] = _UP,
    ) -> Camera:
        """This camera moved around `centre` as on a turntable: what is there stays in view.

        azimuth: degrees about `up`, counter-clockwise seen from above. elevation: degrees towards
        `up`, before that.
        """
        pivot = _vector("centre", centre)
        axis = transform.unit(_vector("up", up), "up has length 0")
        azimuth = number("azimuth", azimuth, -1e6, 1e6)
        elevation = number("elevation", elevation, -1e6, 1e6)
        arm = [p - c for p, c in zip(self.to_world[:3, 3].tolist(), pivot, strict=True)]
        side = transform.cross(arm, axis)
        if math.sqrt(sum(x * x for x in side)) <= 1e-9 * math.sqrt(sum(x * x for x in arm)):
            side = self.to_world[:3, 0].tolist()  # above or below the centre: its own left
        turn = transform.rotate(axis, azimuth)
        turn = transform.compose(turn, transform.rotate(transform.unit(side, ""), elevation))
        steps = (transform.translate([-c for c in pivot]), turn, transform.translate(pivot))
        matrix = np.asarray(self.to_world)
        for step in steps:
            matrix = transform.compose(step, matrix)
        return dataclasses.replace(self, to_world=matrix)

    def dolly(self, distance: float) -> Camera:
        """This camera, moved forward by `distance` along its view; backward if negative."""
        distance = number("distance", distance, -MAX_COORDINATE, MAX_COORDINATE)
        if self.projection == "orthographic":
            distance /= _scales(self.to_world)[2]
        step = transform.translate([0.0, 0.0, distance])
        return dataclasses.replace(self, to_world=transform.compose(self.to_world, step))


def _scales(matrix: Array) -> list[float]:
    """Lengths of the axes that a matrix (4, 4) gives."""
    return [math.sqrt(x * x + y * y + z * z) for x, y, z in matrix[:3, :3].T.tolist()]


def _check_patches(patches: Array, projection: str) -> None:
    """Raises SceneError for what the patches of a camera cannot be."""
    if (len(patches) > 0) != (projection in ("irradiance", "distant")):
        raise SceneError(f"{len(patches)} patches of a camera of projection {projection}")
    in_range("patches", patches, -MAX_COORDINATE, MAX_COORDINATE)
    if not (patches[:, :1] == np.arange(len(PATCH_KINDS))).any(axis=1).all():
        raise SceneError(f"patches[:, 0] are not all indices of {', '.join(PATCH_KINDS)}")
    if not (np.abs(patches[:, 1]) == 1).all():
        raise SceneError("patches[:, 1] are not all 1 or -1")


def _check_parallel(matrix: Array, aperture: float) -> None:
    """Raises SceneError for what an orthographic camera cannot have."""
    scales = [number("scale of camera to_world", x, 1e-30, math.inf) for x in _scales(matrix)]
    axes = matrix[:3, :3] / scales
    off = float(np.abs(axes.T @ axes - np.eye(3)).max())
    if not off <= 1e-3:
        raise SceneError(
            f"camera to_world shears: the cosine between two of its axes is {off:.3g}; an "
            "orthographic camera may only be scaled, rotated, mirrored and moved"
        )
    if aperture:
        raise SceneError(f"aperture_radius = {aperture} of an orthographic camera; expected 0")


def _vector(name: str, value: Sequence[float]) -> list[float]:
    vector: list[float] = array(name, value, np.float64, (3,)).tolist()
    return vector
