"""Level 2: the camera: pixel filters, aperture, field of view, clipping."""

from __future__ import annotations

import math
from collections.abc import Callable
from functools import partial
from typing import Any

import numpy as np
import numpy.typing as npt
from scipy import integrate, special

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
    """Cumulative distribution of |filter| about the pixel's centre, pixels; by formula."""
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
    edges = np.linspace(-2, 2, 2**14 + 1)
    middles = (edges[1:] + edges[:-1]) / 2
    steps = (np.abs(mitchell(edges[1:], *parameter)) + 4 * np.abs(mitchell(middles, *parameter))
             + np.abs(mitchell(edges[:-1], *parameter)))  # fmt: skip
    total = np.append(0, np.cumsum(steps))
    return lambda x: np.interp(x, edges, total / total[-1])


def drawn(name: str, parameter: Any) -> Callable[[Any], Array]:
    """`distribution` as the renderer draws it: 4,096 cells of equal probability, even within one.

    So it is off by up to 1.2e-4, in the first cell of a cubic tail: s - s^4 cells, s = 4^(-1/3).
    """
    cdf = distribution(name, parameter)
    if name in ("box", "tent"):
        return cdf
    reach = 4 * parameter if name == "gaussian" else 2
    x, levels = np.linspace(-reach, reach, 2**18 + 1), np.linspace(0, 1, 4097)
    cells = np.interp(levels, cdf(x), x)
    return lambda x: np.interp(x, cells, levels)


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


POSITIVE = {"box": ("box", None), "tent 1": ("tent", 1.0), "tent 1.7": ("tent", 1.7),
            "gaussian": ("gaussian", 0.5), "b-spline": ("mitchell", (1.0, 0.0))}  # fmt: skip
SIGNED = {"mitchell": (1 / 3, 1 / 3), "catmull-rom": (0.0, 0.5)}
EDGES = {"9.3 7.7": (9.3, 7.7), "4.5 3.02": (4.5, 3.02), "11.98 5.25": (11.98, 5.25)}


@case(2, each={"name": POSITIVE, "edge": EDGES})
def filters(t: Trial, name: str, edge: str) -> None:
    """A bright half plane whose corner falls on a point of a 16 x 12 film.

    Every pixel holds the part of its filter beyond both edges: finds shifts, flips, aspect, field
    of view, jitter and filter errors. Exact binomial, 25,000 samples per pixel: sees 0.015 pixel.
    """
    kind, parameter = POSITIVE[name]
    edge_x, edge_y = EDGES[edge]
    cdf = drawn(kind, parameter)
    right = 1 - cdf(edge_x - (np.arange(16) + 0.5))
    below = 1 - cdf(edge_y - (np.arange(12) + 0.5))
    exact = np.outer(below, right)
    n = 25_000 * t.effort
    image = t.render(half_plane(edge_x, edge_y, kind, parameter), 25_000).image[:, :, 0]
    hits = np.rint(image.astype(np.float64) * n)
    certain = (exact < 1e-12) | (exact > 1 - 1e-12)
    # an edge at the filter's very rim: one sample in 2^24 falls on it
    t.check(np.abs(hits - n * exact)[certain].sum() <= 3, "certain pixels")
    for h, e in zip(hits[~certain], exact[~certain], strict=True):
        t.p(binomial(int(h), n, float(e)), f"{edge}")


@case(2, each={"name": SIGNED, "edge": ["9.3 7.7", "4.5 3.02"]})
def signed_filters(t: Trial, name: str, edge: str) -> None:
    """As above for filters with negative lobes: a pixel may lie below 0 and above 1.

    z by the exact variance: samples have the magnitude (integral of |f|)^2 and the sign of both
    lobes. 25,000 samples per pixel.
    """
    parameters = SIGNED[name]
    edge_x, edge_y = EDGES[edge]
    f = partial(mitchell, b=parameters[0], c=parameters[1])
    net, whole = (
        2 * sum(integrate.quad(g, k, k + 1)[0] for k in (0, 1)) for g in (f, lambda x: abs(f(x)))
    )
    t.check(abs(net - 1) < 1e-9, "the filter's integral")
    cdf, lobe = drawn("mitchell", parameters), (whole - net) / whole / 4  # a side's share below 0

    def beyond(edge: float, pixels: int) -> tuple[Array, Array]:
        """Integral of f and of |f| beyond an edge, of all pixels of an axis."""
        u = cdf(edge - (np.arange(pixels) + 0.5))
        below = np.maximum(lobe - u, 0) + np.minimum(1 - u, lobe)
        return whole * (1 - u - 2 * below), whole * (1 - u)

    (x, x_size), (y, y_size) = beyond(edge_x, 16), beyond(edge_y, 12)
    exact, size = np.outer(y, x), whole**2
    second = np.outer(y_size, x_size) * size
    t.check(exact.max() > 1.01, "overshoot")
    n = 25_000 * t.effort
    scene = half_plane(edge_x, edge_y, "mitchell", parameters)
    image = t.render(scene, 25_000).image[:, :, 0].astype(np.float64)
    t.check(image[second == 0] == 0, "dark pixels")
    variance = second - exact**2
    seen = n * variance > 100 * size**2
    off = np.abs(image - exact)
    t.check(off[~seen].max() < 0.02, "rarely lit pixels")
    t.p(max_z(off[seen] / np.sqrt(variance[seen] / n)), "pixels")


OFFSETS: dict[str, tuple[str, Any]] = {
    **POSITIVE, **{name: ("mitchell", parameters) for name, parameters in SIGNED.items()}
}  # fmt: skip


@case(2, each={"name": OFFSETS})
def filter_offsets(t: Trial, name: str) -> None:
    """Places on the film are distributed as the pixel's filter.

    By the cumulative distribution of |f| along both axes, from the directions of 10^4 camera rays,
    replayed on the CPU: sees 3 % in scale, 12 % in tilt, in a full run half of that.
    """
    kind, parameter = OFFSETS[name]
    scene = make([], Camera(np.eye(4), 90.0), 1.0, 1, 1, kind, parameter)
    d = np.array([p[0]["direction"] for p in replayed(t, scene, 10_000 * t.effort, 1)])
    cdf = distribution(kind, parameter)
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
