"""Scenes with known answers as dictionaries, in Mitsuba's words: through the reader.

`scenes` has those without it; the names are Mitsuba's here and those of the arrays there.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Any

import numpy as np
import numpy.typing as npt

import veriray
from veriray_validate.scenes import camera

Array = npt.NDArray[Any]
Dict = dict[str, Any]
NULL: Dict = {"type": "null"}
BLACK: Dict = {"type": "diffuse", "reflectance": 0.0}
MIRROR: Dict = {"type": "conductor", "material": "none"}


def rgb(value: float | Sequence[float]) -> Dict:
    """A colour of one or three numbers."""
    return {"type": "rgb", "value": np.broadcast_to(np.asarray(value, float), 3).tolist()}


def box_film(width: int = 1, height: int = 1) -> Dict:
    """A film under a box filter."""
    return {"type": "hdrfilm", "width": width, "height": height, "rfilter": {"type": "box"}}


def look(origin: Any, target: Any, up: Any = None) -> Array:
    """to_world with local +Z from origin to target."""
    return np.asarray(camera(origin, target, up=up).to_world)


def view(origin: Any, target: Any, fov: float = 0.01, size: int | tuple[int, int] = 1,
         kind: str = "perspective", up: Any = None, **more: Any) -> Dict:  # fmt: skip
    """A sensor; the default sees one point. size: of the film, its rfilter is `rfilter` or box."""
    width, height = (size, size) if isinstance(size, int) else size
    film = box_film(width, height)
    film["rfilter"] = more.pop("rfilter", film["rfilter"])
    return {"type": kind, "fov": fov, "to_world": look(origin, target, up), "film": film, **more}


def diffuse(reflectance: float | Sequence[float]) -> Dict:
    """A Lambertian material."""
    return {"type": "diffuse", "reflectance": rgb(reflectance)}


def area(radiance: float | Sequence[float]) -> Dict:
    """An area emitter."""
    return {"type": "area", "radiance": rgb(radiance)}


def sky(radiance: float | Sequence[float]) -> Dict:
    """A constant environment."""
    return {"type": "constant", "radiance": rgb(radiance)}


def medium(sigma_t: float | Sequence[float], albedo: float | Sequence[float], g: float = 0.0,
           **more: Any) -> Dict:  # fmt: skip
    """A homogeneous medium; g 0 is isotropic."""
    phase: Dict = {"type": "hg", "g": g} if g else {"type": "isotropic"}
    values = {"sigma_t": rgb(sigma_t), "albedo": rgb(albedo), "phase": phase}
    return {"type": "homogeneous", **values, **more}


def glass(int_ior: float, ext_ior: float = 1.0, kind: str = "dielectric", **more: Any) -> Dict:
    """A dielectric, or another material with two indices."""
    return {"type": kind, "int_ior": float(int_ior), "ext_ior": float(ext_ior), **more}


def plastic(base: Any, eta: float, **more: Any) -> Dict:
    """A smooth coat of index eta on a diffuse base."""
    return glass(eta, 1.0, "plastic", diffuse_reflectance=rgb(base), **more)


def masked(opacity: float, inner: Dict) -> Dict:
    """A material with holes."""
    return {"type": "mask", "opacity": opacity, "bsdf": inner}


def both(inner: Dict) -> Dict:
    """A material on both sides."""
    return {"type": "twosided", "bsdf": inner}


def shape(kind: str, bsdf: Dict, radiance: Any = None, **more: Any) -> Dict:
    """A shape with a material, and an emitter if `radiance` is given."""
    result = {"type": kind, "bsdf": bsdf, **more}
    if radiance is not None:
        result["emitter"] = area(radiance)
    return result


def sphere(center: Sequence[float], radius: float, bsdf: Dict, radiance: Any = None,
           **more: Any) -> Dict:  # fmt: skip
    """A sphere."""
    return shape("sphere", bsdf, radiance, center=list(map(float, center)), radius=float(radius),
                 **more)  # fmt: skip


def flat(kind: str, centre: Sequence[float], normal: Sequence[float], half: float | Sequence[float],
         bsdf: Dict, radiance: Any = None, **more: Any) -> Dict:  # fmt: skip
    """A rectangle or disk of half sizes `half` (one or two) whose front faces along `normal`.

    The first half size is along world x as far as the plane allows, or along y if it faces x.
    """
    n = np.asarray(normal, np.float64) / np.linalg.norm(normal)
    a = np.eye(3)[int(abs(n[0]) > 0.9)]
    a = a - (a @ n) * n
    a /= np.linalg.norm(a)
    size = np.broadcast_to(np.asarray(half, np.float64), 2)
    place = np.eye(4)
    place[:3] = np.stack([a * size[0], np.cross(n, a) * size[1], n, np.asarray(centre)], axis=1)
    return shape(kind, bsdf, radiance, to_world=place, **more)


def cuboid(lo: Sequence[float], hi: Sequence[float], bsdf: Dict, **more: Any) -> Dict:
    """An axis-parallel box, front outside."""
    lo_, hi_ = np.asarray(lo, float), np.asarray(hi, float)
    place = np.diag([*(hi_ - lo_) / 2, 1.0])
    place[:3, 3] = (lo_ + hi_) / 2
    return shape("cube", bsdf, to_world=place, **more)


def scene(sensor: Dict, *objects: Dict, max_depth: int = -1, rr_depth: int = 5) -> veriray.Scene:
    """The scene of a sensor and objects."""
    integrator = {"type": "volpath", "max_depth": max_depth, "rr_depth": rr_depth}
    parts = {f"object_{k}": o for k, o in enumerate(objects)}
    return veriray.load_dict({"type": "scene", "integrator": integrator, "sensor": sensor, **parts})


def facing(*above: Dict, rr_depth: int = 5) -> veriray.Scene:
    """A small diffuse disk (albedo 1) over a black floor of radiance 1; `above`: objects over it.

    Things above are at z = 1 and wide. The disk's radiance is the reflectance of what is above for
    diffuse light, less 3e-6 of it: the disk hides so much of its own picture in a mirror.
    """
    ground = flat("rectangle", [0, 0, 0], [0, 0, 1], 2000, BLACK, 1)
    patch = flat("disk", [0, 0, 0.05], [0, 0, 1], 0.003, diffuse(1))
    eye = view([0.3, 0.1, 0.3], [0, 0, 0.05], 1e-3)
    return scene(eye, ground, patch, *above, rr_depth=rr_depth)


def direction(angle: float) -> Array:
    """The unit vector at `angle` degrees from +z towards +x."""
    return np.array([math.sin(math.radians(angle)), 0.0, math.cos(math.radians(angle))])
