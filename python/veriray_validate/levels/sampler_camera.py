"""Level 2: the camera: pixel filters, aperture, field of view, clipping."""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Any

import numpy as np
import numpy.typing as npt
from scipy import special

from veriray.camera import Camera
from veriray.scene import Scene
from veriray_validate.levels.samplers import count, replayed, uniform
from veriray_validate.oracles import INVERSE
from veriray_validate.scenes import Medium, disk, make, quad
from veriray_validate.statistics import binomial, max_z
from veriray_validate.trial import Trial, case

Array = npt.NDArray[Any]

# ---- filters ----


def mitchell(x: Any, b: float, c: float) -> Array:
    """D. Mitchell, A. Netravali, "Reconstruction Filters in Computer Graphics", 1988."""
    x = np.abs(x)
    inner = ((12 - 9 * b - 6 * c) * x**3 + (-18 + 12 * b + 6 * c) * x**2 + 6 - 2 * b) / 6
    outer = (-b - 6 * c) * x**3 + (6 * b + 30 * c) * x**2 + (-12 * b - 48 * c) * x + 8 * b + 24 * c
    return np.where(x < 1, inner, np.where(x < 2, outer / 6, 0.0))


def distribution(name: str, parameter: Any) -> Callable[[Any], Array]:
    """Integral of a filter from its left end on; 1 in all. By formula, pixels."""
    if name == "box":
        return lambda x: np.clip(np.asarray(x) + 0.5, 0, 1)
    if name == "tent":

        def tent(x: Any) -> Array:
            t = np.clip(np.asarray(x) / parameter, -1, 1)
            return np.where(t < 0, (1 + t) ** 2 / 2, 1 - (1 - t) ** 2 / 2)

        return tent
    if name == "gaussian":  # exp(-z^2 / 2) - exp(-8) on |z| < 4

        def integral(z: Any) -> Array:
            bell: Array = math.sqrt(math.pi / 2) * special.erf(z / math.sqrt(2))
            return bell - math.exp(-8) * z

        return lambda x: integral(np.clip(np.asarray(x) / parameter, -4, 4)) / (
            2 * integral(4.0)
        ) + 0.5  # fmt: skip
    reach = 2 if name == "mitchell" else parameter
    edges = np.linspace(-reach, reach, 2**14 + 1)
    middles = (edges[1:] + edges[:-1]) / 2
    left, middle, right = (
        mitchell(x, *parameter) if name == "mitchell" else np.sinc(x) * np.sinc(x / parameter)
        for x in (edges[:-1], middles, edges[1:])
    )
    total = np.append(0, np.cumsum(left + 4 * middle + right))
    return lambda x: np.interp(x, edges, total / total[-1])


def half_plane(edge_x: float, edge_y: float, name: str, parameter: Any) -> Scene:
    """Radiance 1 right of and below a point of a 16 x 12 film."""
    width, height, fov = 16, 12, 50.0
    tan_x = math.tan(math.radians(fov / 2))
    tan_y = tan_x * height / width
    x = tan_x * (1 - 2 * edge_x / width)
    y = tan_y * (1 - 2 * edge_y / height)
    # The film's right is local -X, its bottom local -Y; the front faces the camera.
    plane = quad([x, y, 1], [0, -9, 0], [-9, 0, 0], 0, 1.0)
    return make([plane], Camera(np.eye(4), fov), 0.0, width, height, name, parameter)


#: Kind, parameter, and the pixels to each side that count in one.
FILTERS: dict[str, tuple[str, Any, int]] = {
    "box": ("box", None, 0), "tent 0.6": ("tent", 0.6, 1), "tent 1": ("tent", 1.0, 1),
    "tent 1.7": ("tent", 1.7, 2), "gaussian": ("gaussian", 0.5, 2),
    "narrow gaussian": ("gaussian", 0.2, 1), "wide gaussian": ("gaussian", 1.1, 4),
    "b-spline": ("mitchell", (1.0, 0.0), 2), "mitchell": ("mitchell", (1 / 3, 1 / 3), 2),
    "catmull-rom": ("mitchell", (0.0, 0.5), 2), "lanczos": ("lanczos", 3.0, 3),
    "one lobe": ("lanczos", 1.0, 1),
}  # fmt: skip
#: Of these, what draws its samples from the filter.
DRAWN = ("box", "tent 0.6", "narrow gaussian")
EDGES = {"9.3 7.7": (9.3, 7.7), "4.5 3.02": (4.5, 3.02), "11.98 5.25": (11.98, 5.25)}


@case(2, each={"name": FILTERS, "edge": EDGES})
def filters(t: Trial, name: str, edge: str) -> None:
    """A bright half plane whose corner falls on a point of a 16 x 12 film.

    Every pixel holds the integral of its filter beyond both edges: finds shifts, flips, aspect,
    field of view, jitter and filter errors; where no edge is near it is 0 or 1 exactly. 25,000
    samples per pixel, z by the picture's own errors: sees 0.01 pixel.
    """
    kind, parameter, reach = FILTERS[name]
    cdf, edges = distribution(kind, parameter), EDGES[edge]
    y, x = (1 - cdf(at - (np.arange(n) + 0.5)) for at, n in ((edges[1], 12), (edges[0], 16)))
    exact = np.outer(y, x)
    t.check(exact.max() > 1.01 or name not in ("mitchell", "catmull-rom", "lanczos"), "overshoot")
    picture = t.render(half_plane(*edges, kind, parameter), 25_000)
    image, error = (a[:, :, 0].astype(np.float64) for a in (picture.image, picture.stderr))
    # The side of an edge on which all lies that counts in a pixel, or 0.
    left, right = (np.arange(16) - reach - at for at in (edges[0], edges[0] - 2 * reach - 1))
    upper, lower = (np.arange(12) - reach - at for at in (edges[1], edges[1] - 2 * reach - 1))
    lit = np.outer(upper >= 0, left >= 0)
    dark = np.add.outer(lower <= 0, right <= 0)
    t.check(image[lit] == 1, "lit pixels")
    t.check(image[dark] == 0, "dark pixels")
    t.check(error[lit | dark] == 0, "errors of even pixels")
    seen = ~(lit | dark) & (error > 0)
    if name in DRAWN:  # where samples of both sides come often
        seen &= 25_000 * exact * (1 - exact) > 100
    t.check(np.abs(image - exact)[~seen].max() < 0.01, "rarely lit pixels")
    t.p(max_z((image - exact)[seen] / error[seen]), edge)


@case(2, each={"name": FILTERS})
def filter_offsets(t: Trial, name: str) -> None:
    """Camera rays lie evenly in their pixels, or are distributed as the pixel's filter.

    By the cumulative distribution along both axes, from the directions of 10^4 camera rays,
    replayed on the CPU: sees 3 % in scale, 12 % in tilt, in a full run half of that.
    """
    kind, parameter, _ = FILTERS[name]
    scene = make([], Camera(np.eye(4), 90.0), 1.0, 1, 1, kind, parameter)
    d = np.array([p[0]["direction"] for p in replayed(t, scene, 10_000 * t.effort, 1)])
    cdf = distribution(kind if name in DRAWN else "box", parameter)
    # the film is 1 x 1 pixel and 2 x 2 wide at distance 1; its left and top are +x and +y
    x, y = (-d[:, k] / d[:, 2] / 2 for k in (0, 1))
    uniform(t, cdf(x), cdf(y), name)


# ---- lens, field of view, clipping ----


@case(2)
def aperture(t: Trial) -> None:
    """Places on a thin lens are uniform on its disc, and their rays go through the focus.

    10^4 camera rays, replayed on the CPU: sees 3 % in scale, 12 % in tilt, in a full run half of
    that; the point in focus is met within 2e-6 of its distance.
    """
    view = Camera(np.eye(4), 1e-4, aperture_radius=0.4, focus_distance=3.0)
    scene = make([], view, 1.0)
    rays = [p[0] for p in replayed(t, scene, 10_000 * t.effort, 1)]
    o, d = (np.array([r[name] for r in rays]) for name in ("position", "direction"))
    t.check(np.abs(o[:, 2]).max() == 0, "off the lens")
    u, v = INVERSE["uniform_disk"](o[:, :2] / 0.4)
    t.check(u < 1 + 1e-6, "beyond the rim")
    uniform(t, np.clip(u, 0, 1), v, "aperture")
    focus = o + d * (3.0 / d[:, 2:])
    t.check(np.abs(focus - [0, 0, 3.0]).max() < 6e-6, f"{np.abs(focus - [0, 0, 3]).max():.2g}")


PLATES = {"core": 0.36, "half x": 0.5, "half y": 0.5, "quarter": 0.25}


@case(2, each={"part": PLATES})
def aperture_in_renders(t: Trial, part: str) -> None:
    """A black plate hides a part of the lens: its share of the camera rays is absorbed.

    The share by area of the disc, since the plate is halfway to the focus; exact binomial, 10^5
    camera rays: sees 0.8 % (absolute).
    """
    view = Camera(np.eye(4), 1e-6, aperture_radius=0.4, focus_distance=3.0)
    plates = {
        "core": disk([0, 0, 1.5], [0, 0.12, 0], [0.12, 0, 0]),
        "half x": quad([0, -1, 1.5], [0, 2, 0], [1, 0, 0]),
        "half y": quad([-1, 0, 1.5], [0, 1, 0], [2, 0, 0]),
        "quarter": quad([-1, 0, 1.5], [0, 1, 0], [1, 0, 0]),
    }
    ledger = t.render(make([plates[part]], view, 1.0), 100_000).stats["ledger"]
    n = 100_000 * t.effort
    t.check(ledger["absorbed"][0] + ledger["escaped"][0] == n, "counts")
    count(t, ledger["absorbed"][0], n, PLATES[part], part)


@case(2, each={"axis": ["x", "y", "diagonal", "smaller", "larger"]})
def field_of_view_and_offset(t: Trial, axis: str) -> None:
    """A bright square 30 degrees wide: `fov` is measured along its axis, offsets shift it.

    Every pixel holds its covered share, those fully inside or outside exactly. 4,000 samples.
    """
    width, height = 40, 24
    offset = (0.1, -0.05)
    view = Camera(np.eye(4), 90.0, axis, principal_point_offset=np.array(offset))
    size = {"x": width, "y": height, "diagonal": math.hypot(width, height),
            "smaller": height, "larger": width}[axis]  # fmt: skip
    tangent = math.tan(math.radians(15))
    square = quad([-tangent, -tangent, 1], [0, 2 * tangent, 0], [2 * tangent, 0, 0], 0, 1.0)
    half = tangent * size / 2
    centre = (width * (0.5 - offset[0]), height * (0.5 - offset[1]))
    cover = []
    for c, n in zip(centre, (width, height), strict=True):
        left = np.arange(n)
        cover.append(np.clip(np.minimum(left + 1, c + half) - np.maximum(left, c - half), 0, 1))
    exact = np.outer(cover[1], cover[0])
    n = 4000 * t.effort
    image = t.render(make([square], view, 0.0, width, height), 4000).image[..., 0]
    t.check(image[exact == 0] == 0, "outside")
    t.check(image[exact == 1] == 1, "inside")
    cut = (exact > 1e-9) & (exact < 1 - 1e-9)
    hits = np.rint(image.astype(np.float64) * n)
    for h, e in zip(hits[cut], exact[cut], strict=True):
        t.p(binomial(int(h), n, float(e)), axis)


#: Sizes of the film and distances of it, in sizes of what it shows.
PARALLEL = {"near": (1.0, 0.5), "far": (1.0, 3e9), "small": (1e-6, 2.0), "large": (1e7, 3.0),
            "small and far": (1e-5, 1e7)}  # fmt: skip


def parallel(seed: int, size: float, away: float, **clip: float) -> tuple[Camera, Array]:
    """A turned orthographic camera of unequal scales, and what takes (x, y, depth / size), of which
    x and y span [-1, 1] over the film's width, to the world."""
    rng = np.random.default_rng(seed)
    q, _ = np.linalg.qr(rng.normal(size=(3, 3)))
    q[:, 0] *= np.sign(np.linalg.det(q))
    place = np.eye(4)
    place[:3, :3], place[:3, 3] = q * [size, 1.5 * size, size], rng.normal(size=3)
    to_world = np.array(place)
    to_world[:3, 3] -= q[:, 2] * size * away
    to_world[:3, 2] *= 0.7
    return Camera.orthographic(to_world, **clip), place


@case(2, each={"place": PARALLEL, "seed": (1, 77, 4242, 5)})
def orthographic_film(t: Trial, place: str, seed: int) -> None:
    """A bright parallelogram before a floor of 3 or a million film widths, seen by parallel rays.

    Turned, of unequal scales, near, far, small and large. Every pixel holds its covered share,
    those fully inside or outside exactly. 4,000 samples.
    """
    width, height = 40, 24
    size, away = PARALLEL[place]
    view, world = parallel(seed, size, away)
    x, y = (-0.4302, 0.7311), (-0.2102, 0.3203)

    def corners(x: tuple[float, float], y: tuple[float, float], z: float) -> list[Array]:
        points = [(world @ [a, b, z, 1])[:3] for a, b in ((x[0], y[0]), (x[0], y[1]), (x[1], y[0]))]
        return [points[0], points[1] - points[0], points[2] - points[0]]

    plate = quad(*corners(x, y, 0.0), 0, 1.0)
    wide = 1e6 if place.startswith("small") else 3.0
    floor = quad(*corners((-wide, wide), (-wide, wide), 1.0), 0, 0)
    cover = []
    for (low, high), n, half in ((x, width, 1.0), (y, height, height / width)):
        ends = [n * (1 - value / half) / 2 for value in (high, low)]
        left = np.arange(n)
        cover.append(np.clip(np.minimum(left + 1, ends[1]) - np.maximum(left, ends[0]), 0, 1))
    exact = np.outer(cover[1], cover[0])
    n = 4000 * t.effort
    image = t.render(make([plate, floor], view, 0.0, width, height), 4000).image[..., 0]
    t.check(image[exact == 0] == 0, "outside")
    t.check(image[exact == 1] == 1, "inside")
    cut = (exact > 1e-9) & (exact < 1 - 1e-9)
    hits = np.rint(image.astype(np.float64) * n)
    for h, e in zip(hits[cut], exact[cut], strict=True):
        t.p(binomial(int(h), n, float(e)), place)


@case(2, each={"seed": (1, 77, 4242, 5)})
def orthographic_clipping(t: Trial, seed: int) -> None:
    """Screens at depths 1, 2, 3 before an orthographic camera whose local z is 0.7 long.

    The near plane lies at 0.7 near_clip, the far plane far_clip - near_clip behind it. The first
    screen between them in every pixel, black where there is none: exact. Planes 1e-5 off a screen
    are told apart.
    """
    e = 1e-5
    planes = ((0.0, math.inf, 1), (0.5, 0.9, 1), (1.5, math.inf, 2), (2.5, 9.0, 3), (2.5, 0.4, 0),
              (3.5, 9.0, 0), (0.1, 0.8, 0), (1 - e, math.inf, 1), (1 + e, math.inf, 2),
              (1 + e, 1 - 2 * e, 0), (1 + e, 1.0, 2))  # fmt: skip
    for near, length, shown in planes:
        clip = {"near_clip": near / 0.7, "far_clip": near / 0.7 + length}
        view, world = parallel(seed, 1.0, 0.0, **clip)
        screens = []
        for z in (1.0, 2.0, 3.0):
            p, a, b = ((world @ [*xy, z, 1])[:3] for xy in ((-9, -9), (-9, 9), (9, -9)))
            screens.append(quad(p, a - p, b - p, 0, z))
        t.agrees(make(screens, view, 0.0, 8, 6), shown, 50, sees=1e-3)


@case(2, each={"near": (0.0, 1.3, 40.0), "seed": (1, 77, 4242, 5)})
def orthographic_in_a_medium(t: Trial, near: float, seed: int) -> None:
    """A screen in an absorbing medium before an orthographic camera: exp(-extinction x distance).

    The distance is that from the near plane, also where the film is far from all that it shows.
    Sees 1 %.
    """
    fog = Medium(0.4)
    view, world = parallel(seed, 1.0, 0.0, near_clip=near / 0.7)
    depth = near + 2.5
    p, a, b = ((world @ [*xy, depth, 1])[:3] for xy in ((-9, -9), (-9, 9), (9, -9)))
    screen = quad(p, a - p, b - p, 0, 1.0)
    t.agrees(make([screen], view, camera_medium=fog), math.exp(-1), 400_000, sees=0.01)


@case(2)
def clipping(t: Trial) -> None:
    """near_clip and far_clip are planes: three screens at 1, 2, 3 seen between them.

    The first screen between the planes in every pixel, black where there is none: exact.
    """
    screens = [quad([-9, -9, z], [0, 18, 0], [18, 0, 0], 0, float(z)) for z in (1, 2, 3)]
    for near, far, shown in ((0.0, math.inf, 1), (0.5, 9.0, 1), (1.5, math.inf, 2), (2.5, 9.0, 3),
                             (2.5, 2.9, 0), (3.5, 9.0, 0), (0.1, 0.9, 0)):  # fmt: skip
        view = Camera(np.eye(4), 100.0, "x", near, far)
        t.agrees(make(screens, view, 0.0, 8, 6), shown, 50, sees=1e-3)
