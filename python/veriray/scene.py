"""The scene: plain arrays in world units, with camera, film and render settings.

Conventions are Mitsuba 3's: right-handed, 4x4 matrices act on column vectors, a camera looks along
its local +Z with local +X on the left of the picture, pixel (0, 0) is top left.
"""

from __future__ import annotations

import dataclasses
import hashlib
import math
import os
from collections.abc import Mapping
from dataclasses import dataclass, field
from decimal import Decimal, localcontext
from functools import lru_cache
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

from .errors import SceneError

Array = npt.NDArray[Any]

FILTERS = ("box", "tent", "gaussian")
FILTER_DEFAULTS = {"box": 0.5, "tent": 1.0, "gaussian": 0.5}
FOV_AXES = ("x", "y", "diagonal", "smaller", "larger")
MAX_PIXELS = 2**31 - 1
#: Segments of a path at most; -1 in a scene stands for this.
MAX_PATH_DEPTH = 65535
MAX_COORDINATE = 1e100  # squares and triple products stay finite in float64
SHIPPED = {
    "cornell-box": "cornell/cornell_box.xml",
    "cornell-box-mitsuba": "cornell/cornell_box_mitsuba.xml",
    "open": "open.xml",
}
_PI = Decimal("3.14159265358979323846264338327950288419716939937510582097494")


@lru_cache(maxsize=256)
def sin_cos_degrees(angle: float) -> tuple[float, float]:
    """Sine and cosine of an angle in degrees, from 50-digit arithmetic: the same on every machine.

    Exact at multiples of 90 degrees.
    """
    with localcontext() as context:
        context.prec = 50
        degrees = Decimal(math.fmod(angle, 360.0))
        quarter = int((degrees / 90).to_integral_value())
        x = (degrees - 90 * quarter) * _PI / 180  # |x| <= pi/4
        term, sine, cosine = Decimal(1), Decimal(0), Decimal(1)
        for n in range(1, 50, 2):
            term = term * x / n
            sine += term
            term = -term * x / (n + 1)
            cosine += term
        pairs = ((sine, cosine), (cosine, -sine), (-sine, -cosine), (-cosine, sine))
        s, c = pairs[quarter % 4]
        return float(s), float(c)


def tan_half_degrees(angle: float) -> float:
    """tan(angle / 2) for an angle in degrees."""
    sine, cosine = sin_cos_degrees(0.5 * angle)
    return sine / cosine


def _finite(name: str, value: Array, where: str = "") -> None:
    """Raises SceneError with the index of the first NaN or infinity in `value`."""
    bad = np.argwhere(~np.isfinite(value))
    if len(bad):
        index = tuple(int(i) for i in bad[0])
        place = "".join(f"[{i}]" for i in index)
        raise SceneError(f"{name}{place} is {value[index]}; it must be finite", where)


def _array(name: str, value: Any, dtype: Any, shape: tuple[int | None, ...]) -> Array:
    """A read-only C-contiguous copy of `value`; None in `shape` stands for any length."""
    try:
        given = np.asarray(value)
        if given.dtype.kind not in "iufb" and given.size:
            raise TypeError(f"dtype {given.dtype}")
        if not given.size and None in shape:
            given = given.reshape(tuple(n or 0 for n in shape))
    except (TypeError, ValueError) as error:
        raise SceneError(f"{name} cannot be read as numbers: {error}") from None
    if given.ndim != len(shape) or any(
        n is not None and n != m for n, m in zip(shape, given.shape, strict=True)
    ):
        expected = ", ".join("n" if n is None else str(n) for n in shape)
        raise SceneError(f"{name} has shape {given.shape}, expected ({expected})")
    kind = np.dtype(dtype).kind
    result: Array
    if kind == "f":
        _finite(name, given.astype(np.float64))
        with np.errstate(over="ignore"):
            result = np.array(given, dtype=dtype, order="C") + np.dtype(dtype).type(0)  # no -0
        _finite(f"{name} (as {np.dtype(dtype)})", result)
    else:
        if kind in "iu" and given.size:
            if given.dtype.kind not in "iu":
                raise SceneError(f"{name} has dtype {given.dtype}, expected integers")
            info = np.iinfo(dtype)
            if int(given.min()) < info.min or int(given.max()) > info.max:
                value = int(given.min()) if int(given.min()) < info.min else int(given.max())
                raise SceneError(f"{name} holds {value}, outside [{info.min}, {info.max}]")
        result = np.array(given, dtype=dtype, order="C")
    result.setflags(write=False)
    return result


def _number(name: str, value: Any, low: float, high: float, *, open_: bool = False) -> float:
    """float(value), inside [low, high], or inside (low, high) when `open_`."""
    if isinstance(value, bool) or not isinstance(value, (int, float, np.integer, np.floating)):
        raise SceneError(f"{name} = {value!r} is not a number")
    number = float(value)
    if not (low < number < high if open_ else low <= number <= high):
        brackets = "()" if open_ else "[]"
        raise SceneError(
            f"{name} = {number:g} is outside {brackets[0]}{low:g}, {high:g}{brackets[1]}"
        )
    return number + 0.0


def _whole(name: str, value: Any, low: int, high: int) -> int:
    if isinstance(value, bool) or not isinstance(value, (int, np.integer)):
        raise SceneError(f"{name} = {value!r} is not an integer")
    if not low <= int(value) <= high:
        raise SceneError(f"{name} = {int(value)} is outside [{low}, {high}]")
    return int(value)


def determinant(matrix: Array) -> float:
    """Determinant of the upper left 3x3 block, in a fixed order of operations."""
    rows: list[list[float]] = matrix[:3, :3].tolist()
    (a, b, c), (d, e, f), (g, h, i) = rows
    return a * (e * i - f * h) - b * (d * i - f * g) + c * (d * h - e * g)


def check_matrix(name: str, value: Any) -> Array:
    """A finite, affine, invertible 4x4 float64 matrix.

    Singular: |det| of the 3x3 block at most 1e-12 of the product of its column lengths.
    """
    matrix = _array(name, value, np.float64, (4, 4))
    if matrix[3].tolist() != [0.0, 0.0, 0.0, 1.0]:
        raise SceneError(f"{name} has the last row {matrix[3].tolist()}, expected [0, 0, 0, 1]")
    if np.abs(matrix).max() > MAX_COORDINATE:
        raise SceneError(f"{name} holds a number above {MAX_COORDINATE:g}")
    lengths = [math.hypot(*column) for column in matrix[:3, :3].T.tolist()]
    if min(lengths) > 0:
        unit = np.array(matrix)
        unit[:3, :3] /= np.array(lengths)
        if abs(determinant(unit)) > 1e-12:
            return matrix
    raise SceneError(f"{name} is singular: it flattens space (columns of length {lengths})")


@dataclass(frozen=True)
class Film:
    """Picture size and reconstruction filter.

    filter: "box" (1 pixel wide), "tent" (filter_parameter = radius in pixels) or "gaussian"
    (filter_parameter = standard deviation s in pixels: exp(-x^2 / (2 s^2)) - exp(-8) on |x| < 4 s).
    filter_parameter None takes the filter's default: 0.5, 1.0 and 0.5.
    Raises SceneError for a size below 1 or above 2^31 pixels, or an unknown filter.
    """

    width: int = 768
    height: int = 576
    filter: str = "gaussian"
    filter_parameter: float | None = None

    def __post_init__(self) -> None:
        width = _whole("film width", self.width, 1, MAX_PIXELS)
        height = _whole("film height", self.height, 1, MAX_PIXELS)
        if width * height > MAX_PIXELS:
            raise SceneError(f"film of {width} x {height} pixels has more than {MAX_PIXELS}")
        if self.filter not in FILTERS:
            raise SceneError(f"filter = {self.filter!r} is unknown; allowed: {', '.join(FILTERS)}")
        default = FILTER_DEFAULTS[self.filter]
        parameter = default if self.filter_parameter is None else self.filter_parameter
        parameter = _number("filter_parameter", parameter, 1e-3, 100.0)
        if self.filter == "box" and parameter != default:
            raise SceneError(f"filter_parameter = {parameter:g} of the box filter must be 0.5")
        for name, value in (("width", width), ("height", height), ("filter_parameter", parameter)):
            object.__setattr__(self, name, value)


@dataclass(frozen=True, eq=False)
class Camera:
    """A pinhole camera with Mitsuba's `perspective` conventions.

    to_world: (4, 4) float64, no scale; looks along local +Z, with local +X on the picture's left.
    fov: degrees in (0, 180), measured along fov_axis ("x", "y", "diagonal", "smaller", "larger").
    near_clip, far_clip: distances along local Z; 0 and infinity clip nothing.
    principal_point_offset: (x, y) in film widths and heights. The ray through film position
    (u, v), both in [0, 1] from the top left, has the local direction
    (tan_half_x (1 - 2 (u + offset x)), tan_half_y (1 - 2 (v + offset y)), 1).
    Raises SceneError for values outside these ranges and for a singular or scaling to_world.
    """

    to_world: Array
    fov: float
    fov_axis: str = "x"
    near_clip: float = 0.0
    far_clip: float = math.inf
    principal_point_offset: Array = field(default_factory=lambda: np.zeros(2))

    def __post_init__(self) -> None:
        matrix = check_matrix("camera to_world", self.to_world)
        for squared in (matrix[:3, :3] ** 2).sum(axis=0).tolist():
            if abs(squared - 1.0) > 1e-3:
                raise SceneError(
                    f"camera to_world scales by {math.sqrt(squared):g}; a camera may only be "
                    "rotated, mirrored and moved"
                )
        if self.fov_axis not in FOV_AXES:
            raise SceneError(
                f"fov_axis = {self.fov_axis!r} is unknown; allowed: {', '.join(FOV_AXES)}"
            )
        near = _number("near_clip", self.near_clip, 0.0, MAX_COORDINATE)
        far = _number("far_clip", self.far_clip, 0.0, math.inf)
        if not far > near:
            raise SceneError(f"far_clip = {far:g} must be greater than near_clip = {near:g}")
        offset = _array("principal_point_offset", self.principal_point_offset, np.float64, (2,))
        if np.abs(offset).max() > 1e3:
            raise SceneError(f"principal_point_offset = {offset.tolist()} exceeds 1000 film sizes")
        values = {
            "to_world": matrix,
            "fov": _number("fov", self.fov, 0.0, 180.0, open_=True),
            "near_clip": near,
            "far_clip": far,
            "principal_point_offset": offset,
        }
        for name, value in values.items():
            object.__setattr__(self, name, value)

    def tan_half_x(self, width: int, height: int) -> float:
        """Tangent of half the horizontal field of view for a film of width x height pixels."""
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
        """Tangent of half the vertical field of view for a film of width x height pixels."""
        return self.tan_half_x(width, height) * (height / width)


@dataclass(frozen=True, eq=False)
class Scene:
    """Everything a renderer needs, as read-only arrays in world units.

    vertices (V, 3) float64. triangles (T, 3) uint32; cross(v1 - v0, v2 - v0) is on the front side.
    triangle_material (T,) uint32 into reflectance; triangle_emission (T,) int32 into emissions, -1
    for none. reflectance (M, 3) float32 in [0, 1]; two_sided (M,) bool. emissions (E, 3) float32
    radiance >= 0, emitted on the front side only. environment (3,) float32 constant radiance.
    max_depth counts as Mitsuba's does (1 emission only, 2 direct light, -1 unlimited); rr_depth is
    the first depth with Russian roulette; spp and seed are the file's sampler settings.
    triangle_shape (T,) uint32 into shape_names: for masks and messages only.

    Raises SceneError naming array, index, value and expected range. Zero-area triangles are kept.
    """

    vertices: Array
    triangles: Array
    triangle_material: Array
    triangle_emission: Array
    reflectance: Array
    two_sided: Array
    emissions: Array
    environment: Array
    camera: Camera
    film: Film
    max_depth: int = -1
    rr_depth: int = 5
    spp: int = 4
    seed: int = 0
    triangle_shape: Array | None = None
    shape_names: tuple[str, ...] = ()

    def __post_init__(self) -> None:
        if not isinstance(self.camera, Camera):
            raise SceneError(f"camera is {type(self.camera).__name__}, expected Camera")
        if not isinstance(self.film, Film):
            raise SceneError(f"film is {type(self.film).__name__}, expected Film")
        triangles = _array("triangles", self.triangles, np.uint32, (None, 3))
        count = len(triangles)
        names = tuple(self.shape_names) or (("scene",) if count else ())
        shape = np.zeros(count, np.uint32) if self.triangle_shape is None else self.triangle_shape
        arrays = {
            "vertices": _array("vertices", self.vertices, np.float64, (None, 3)),
            "triangles": triangles,
            "triangle_material": _array(
                "triangle_material", self.triangle_material, np.uint32, (count,)
            ),
            "triangle_emission": _array(
                "triangle_emission", self.triangle_emission, np.int32, (count,)
            ),
            "triangle_shape": _array("triangle_shape", shape, np.uint32, (count,)),
            "reflectance": _array("reflectance", self.reflectance, np.float32, (None, 3)),
            "emissions": _array("emissions", self.emissions, np.float32, (None, 3)),
            "environment": _array("environment", self.environment, np.float32, (3,)),
        }
        arrays["two_sided"] = _array(
            "two_sided", self.two_sided, np.bool_, (len(arrays["reflectance"]),)
        )
        for name, low, high in (
            ("vertices", -MAX_COORDINATE, MAX_COORDINATE),
            ("reflectance", 0.0, 1.0),
            ("emissions", 0.0, math.inf),
            ("environment", 0.0, math.inf),
        ):
            _in_range(name, arrays[name], low, high)
        for name, low, size, of in (
            ("triangles", 0, len(arrays["vertices"]), "vertices"),
            ("triangle_material", 0, len(arrays["reflectance"]), "materials"),
            ("triangle_emission", -1, len(arrays["emissions"]), "emissions"),
            ("triangle_shape", 0, len(names), "shapes"),
        ):
            _in_range(name, arrays[name], low, size - 1, f" (there are {size} {of})")
        values = {
            **arrays,
            "shape_names": names,
            "max_depth": _whole("max_depth", self.max_depth, -1, MAX_PATH_DEPTH),
            "rr_depth": _whole("rr_depth", self.rr_depth, 1, 2**31 - 1),
            "spp": _whole("spp", self.spp, 1, 2**63 - 1),
            "seed": _whole("seed", self.seed, 0, 2**64 - 1),
        }
        for name, value in values.items():
            object.__setattr__(self, name, value)

    @property
    def sha256(self) -> str:
        """Hash (hex) of all that changes the expected picture: not names, spp or seed.

        Does not depend on the machine, the process or the file that the scene came from.
        """
        digest = hashlib.sha256(b"veriray scene 1\n")
        for name in (
            "vertices triangles triangle_material triangle_emission reflectance two_sided "
            "emissions environment"
        ).split():
            array: Array = getattr(self, name)
            digest.update(f"{name} {array.dtype.str[1:]} {array.shape}\n".encode())
            digest.update(array.astype(array.dtype.newbyteorder("<")).tobytes())
        camera, film = self.camera, self.film
        numbers = [
            *camera.to_world.ravel().tolist(),
            camera.tan_half_x(film.width, film.height),
            camera.tan_half_y(film.width, film.height),
            camera.near_clip,
            camera.far_clip,
            *camera.principal_point_offset.tolist(),
            film.filter_parameter,
        ]
        digest.update(" ".join(float(x).hex() for x in numbers).encode())
        settings = (film.width, film.height, film.filter, self.max_depth, self.rr_depth)
        digest.update(f"\n{settings}\n".encode())
        return digest.hexdigest()

    def with_(
        self,
        *,
        width: int | None = None,
        height: int | None = None,
        filter: str | None = None,
        filter_parameter: float | None = None,
        max_depth: int | None = None,
        rr_depth: int | None = None,
        spp: int | None = None,
        seed: int | None = None,
    ) -> Scene:
        """A copy with other settings; None keeps the value. Raises SceneError as Scene does."""
        film = self.film
        if filter is None and filter_parameter is None:
            filter_parameter = film.filter_parameter
        film = Film(
            film.width if width is None else width,
            film.height if height is None else height,
            film.filter if filter is None else filter,
            filter_parameter,
        )
        settings = {"max_depth": max_depth, "rr_depth": rr_depth, "spp": spp, "seed": seed}
        changed: dict[str, Any] = {k: v for k, v in settings.items() if v is not None}
        return dataclasses.replace(self, film=film, **changed)

    def scaled(self, factor: float) -> Scene:
        """A copy with all lengths, the camera's too, multiplied by `factor` > 0."""
        factor = _number("scale factor", factor, 0.0, MAX_COORDINATE, open_=True)
        to_world = np.array(self.camera.to_world)
        to_world[:3, 3] *= factor
        camera = dataclasses.replace(
            self.camera,
            to_world=to_world,
            near_clip=self.camera.near_clip * factor,
            far_clip=self.camera.far_clip * factor,
        )
        return dataclasses.replace(self, vertices=self.vertices * factor, camera=camera)

    def with_emission_scaled(self, factor: float) -> Scene:
        """A copy with all emitted radiance, the environment's too, multiplied by `factor` > 0."""
        factor = _number("emission factor", factor, 0.0, MAX_COORDINATE, open_=True)
        return dataclasses.replace(
            self,
            emissions=self.emissions.astype(np.float64) * factor,
            environment=self.environment.astype(np.float64) * factor,
        )


def _in_range(name: str, array: Array, low: float, high: float, note: str = "") -> None:
    bad = np.argwhere((array < low) | (array > high))
    if len(bad):
        index = tuple(int(i) for i in bad[0])
        place = "".join(f"[{i}]" for i in index)
        raise SceneError(f"{name}{place} = {array[index]} is outside [{low:g}, {high:g}]{note}")


def find_shipped(name: str) -> Path:
    """Path of a shipped scene: in the installed package, else in the source checkout."""
    package = Path(__file__).resolve().parent
    for root in (package / "scenes", package.parents[1] / "scenes"):
        path = root / SHIPPED[name]
        if path.is_file():
            return path
    raise SceneError(f"shipped scene {name!r} is not installed ({SHIPPED[name]} is missing)")


def load_file(
    scene: str | os.PathLike[str], parameters: Mapping[str, object] | None = None
) -> Scene:
    """Reads a scene file, or a shipped scene by its name.

    scene: path of a file in the Mitsuba 3 XML subset (see veriray.formats), or a key of SHIPPED; a
    file that has such a name is reached as "./name". parameters: values for the file's $names, as
    `-D key=value` gives them. Raises SceneError for anything that is missing, unknown or wrong.
    """
    from . import formats

    text = os.fspath(scene)
    path = find_shipped(text) if text in SHIPPED else Path(text)
    return formats.load(path, parameters or {})


def load_dict(scene: Mapping[str, Any]) -> Scene:
    """Builds a scene from a Mitsuba-style dictionary (as mitsuba.load_dict takes it).

    Transforms are 4x4 arrays or objects with a `matrix` attribute, colours {"type": "rgb", "value":
    ...} or one number. File names are relative to the working directory. Raises SceneError naming
    the key path.
    """
    from .formats import build, mitsuba_dict

    return build.build(mitsuba_dict.read(scene))


def cornell_box() -> Scene:
    """The measured Cornell box (scenes/cornell/cornell_box.xml), 512 x 512, 64 spp."""
    return load_file("cornell-box")
