"""Pinhole, thin lens, moving cameras and filters against geometry."""

from __future__ import annotations

import dataclasses
import math

import numpy as np
import numpy.typing as npt
from scipy import stats

import veriray
from veriray import transform
from veriray.comparison.statistics import MARGIN
from veriray_validate.dicts import BLACK, box_film, flat, scene, sky, sphere, view
from veriray_validate.scenes import MIRROR, NULL, Medium, Part, box, camera, make, quad
from veriray_validate.scenes import sphere as ball
from veriray_validate.statistics import chi_square, sidak, smallest_bias
from veriray_validate.trial import Trial, case

Array = npt.NDArray[np.float64]


# ---- pinhole ----


@case(3, each={"filter": ("box", "tent", "gaussian", "mitchell", "lanczos"), "lens": (0.0, 0.3)})
def uniform_light_on_the_film(t: Trial, filter: str, lens: float) -> None:
    """Every pixel of a wide film has the radiance L itself, under any filter.

    Without noise, bit for bit: no cos^4, no weight but the filter's, whose mean is 1, negative
    lobes and lens included. One segment per path.
    """
    parameter = {"box": None, "tent": 1.3, "gaussian": 0.5, "mitchell": (0.2, 0.4), "lanczos": 4.0}[
        filter
    ]
    eye = camera([0, 0, 0], [1, 2, 3], 120, aperture_radius=lens, focus_distance=2.0)
    r = t.render(make([], eye, [0.1, 1.0, 7.0], 16, 9, filter, parameter), 50)
    t.check(r.image == np.array([0.1, 1.0, 7.0], np.float32))
    t.check(not r.stderr.any(), "noise in a constant")
    t.check(r.stats["live_rays"] == [16 * 9 * r.spp])


@case(3, each={"angle": (0, 25, 50)})
def ball_off_the_axis(t: Trial, angle: float) -> None:
    """A ball's picture is an ellipse: its share of a wide film.

    Half axes sin a cos a / (cos^2 q - sin^2 a) and sin a / sqrt(cos^2 q - sin^2 a) for a ball of
    angular radius a at angle q off the axis, focal length 1. Sees 3 %.
    """
    a, q = math.radians(12), math.radians(angle)
    gap = math.cos(q) ** 2 - math.sin(a) ** 2
    area = math.pi * math.sin(a) ** 2 * math.cos(a) / gap**1.5
    # the same as the integral of 1 / cos^3 over the cone
    x, w = np.polynomial.legendre.leggauss(80)
    c = 1 - (1 - math.cos(a)) * (x + 1) / 2
    phi = (np.arange(200) + 0.5) / 200 * math.pi
    z = c[:, None] * math.cos(q) + np.sqrt(1 - c * c)[:, None] * math.sin(q) * np.cos(phi)
    cone = float((w @ z**-3.0).mean()) * (1 - math.cos(a)) * math.pi
    t.check(abs(cone / area - 1) < 1e-9, "two ways")
    half = 2.0
    centre = np.array([0.8 * math.sin(q), 0.6 * math.sin(q), -math.cos(q)])
    eye = view([0, 0, 0], [0, 0, -1], 2 * math.degrees(math.atan(half)), up=[0, 1, 0])
    ball = sphere(2 * centre, 2 * math.sin(a), BLACK, 1)
    t.agrees(scene(eye, ball), area / (2 * half) ** 2, 3_200_000, sees=0.03)


def covered(a: float, b: float, c: float, width: int, height: int) -> Array:
    """Share of each pixel in which a x + b y + c > 0, in pixels from the top left; by clipping."""
    share = np.zeros((height, width))
    for j in range(height):
        for i in range(width):
            square = [(i, j), (i + 1, j), (i + 1, j + 1), (i, j + 1)]
            value = [a * x + b * y + c for x, y in square]
            kept = []
            for k in range(4):
                m = (k + 1) % 4
                if value[k] > 0:
                    kept.append(square[k])
                if value[k] * value[m] < 0:
                    s = value[k] / (value[k] - value[m])
                    kept.append((square[k][0] + s * (square[m][0] - square[k][0]),
                                 square[k][1] + s * (square[m][1] - square[k][1])))  # fmt: skip
            x, y = (np.array([p[axis] for p in kept]) for axis in range(2))
            if len(kept):
                share[j, i] = abs(x @ np.roll(y, -1) - y @ np.roll(x, -1)) / 2
    return share


@case(3, each={"offset": (0.0, 0.125)})
def slanted_edge(t: Trial, offset: float) -> None:
    """A lit half plane with a slanted edge: the share of each pixel that it covers.

    Areas by clipping, box filter; any flip, offset, aspect or jitter shows. offset: the principal
    point's, in film widths. Sees 1 % of the mean.
    """
    width, height, fov = 9, 5, 50.0
    half = math.tan(math.radians(fov / 2))
    # the edge through film points (3.2, 0) and (5.9, 5), lit on its right
    p, q = np.array([3.2, 0.0]), np.array([5.9, 5.0])
    normal = np.array([q[1] - p[1], p[0] - q[0]])
    share = covered(*normal, -float(normal @ p), width, height)
    t.check(abs(share.sum() - (45 - (3.2 + 5.9) / 2 * 5)) < 1e-9, "two ways")

    def place(point: Array) -> Array:  # film to the plane z = -1
        u, v = point[0] / width + offset, point[1] / height
        return np.array([half * (2 * u - 1), half * height / width * (1 - 2 * v), -1.0])

    a, b = place(p), place(q)
    along = (b - a) / np.linalg.norm(b - a)
    right = np.cross(along, [0, 0, 1.0])
    right *= np.sign(right[0])
    corners = np.array([a - 9 * along, a + 9 * along, a + 9 * along + 20 * right,
                        a - 9 * along + 20 * right])  # fmt: skip
    if np.cross(corners[1] - corners[0], corners[2] - corners[0])[2] < 0:
        corners = corners[::-1]  # the front towards the camera
    eye = camera([0, 0, 0], [0, 0, -1], fov, [0, 1, 0],
                 principal_point_offset=np.array([offset, 0.0]))  # fmt: skip
    lamp = Part(corners, [[0, 1, 2], [0, 2, 3]], 0.0, 3.0)
    lit = make([lamp], eye, 1.0, width, height)
    t.agrees(lit, (1 + 2 * share)[:, :, None], 200_000, sees=0.01)


# ---- thin lens ----


def overlap(distance: Array, a: float, b: float) -> Array:
    """Area common to two circles of radii a > b whose centres are `distance` apart."""
    d = np.clip(distance, a - b, a + b)
    p = np.arccos(np.clip((d * d + a * a - b * b) / (2 * d * a), -1, 1))
    q = np.arccos(np.clip((d * d + b * b - a * a) / (2 * d * b), -1, 1))
    kite = np.sqrt(np.maximum((a + b - d) * (d + a - b) * (d - a + b) * (d + a + b), 0)) / 2
    return np.asarray(a * a * p + b * b * q - kite)


@case(3, each={"depth": (2.0, 8.0)}, quick=lambda depth: depth == 2.0)
def circle_of_confusion(t: Trial, depth: float) -> None:
    """A small disk out of focus: the share of the lens that sees it, pixel by pixel.

    From a point p of the focal plane f the disk at distance z, seen through the lens point q, lies
    at q (1 - z/f) + p z/f. So the lens points that hit a disk of radius r are those within
    r / |1 - z/f| of a centre that moves with p. Three tests, Sidak: chi-square of all pixels; the
    energy, which focus does not change: pi r^2 f^2 / z^2 of the focal plane; the second moment
    (a^2 + r'^2) / 2 over the scale squared, which is the radius. Sees 2.5 % of either.
    """
    focus, aperture, size, fov = 4.0, 0.5, 48, 24.0
    r, spp = (0.03, 6_000) if depth < focus else (0.08, 12_000)
    lens = {"aperture_radius": aperture, "focus_distance": focus}
    disk = flat("disk", [0, 0, -depth], [0, 0, 1], r, BLACK, 1)
    seen = scene(view([0, 0, 0], [0, 0, -1], fov, size, "thinlens", **lens), disk)
    half = focus * math.tan(math.radians(fov / 2))
    pixel = 2 * half / size
    spot, scale = r / abs(1 - depth / focus), (depth / focus) / abs(1 - depth / focus)
    fine = ((np.arange(size * 32) + 0.5) / 32 - size / 2) * pixel
    radius = np.hypot(fine[:, None], fine)
    share = overlap(radius * scale, aperture, spot) / (math.pi * aperture**2)
    share = np.where(radius * scale < aperture + spot, share, 0.0)
    exact = share.reshape(size, 32, size, 32).mean((1, 3))
    rim = np.hypot(fine[16::32, None], fine[16::32]) * scale < aperture + spot + 2 * pixel * scale
    exact = np.where(rim, np.maximum(exact, 1e-12), 0.0)
    area = math.pi * (r * focus / depth) ** 2 / pixel**2  # in pixels
    t.check(abs(exact.sum() / area - 1) < 2e-3, "energy of the theory")
    centre = (np.arange(size) + 0.5 - size / 2) * pixel
    squared = centre[:, None] ** 2 + centre**2 + pixel**2 / 6
    moment = (aperture**2 + spot**2) / (2 * scale**2)
    fine2 = fine[:, None] ** 2 + fine**2
    t.check(abs((share * fine2).sum() / share.sum() / moment - 1) < 2e-3, "radius of the theory")
    moment = float((exact * squared).sum() / exact.sum())  # as the pixels see it
    image = t.render(seen, spp)
    n = image.spp
    hits = np.rint(image.image[:, :, 0].astype(np.float64) * n)
    total, expected = float(hits.sum()), area * n
    blur = float((hits * squared).sum() / total)
    spread = math.sqrt(float((hits * (squared - blur) ** 2).sum())) / total
    z = [(total - expected) / math.sqrt(expected), (blur - moment) / spread]
    every = size * size * n
    fits = chi_square(np.append(hits, every - total), np.append(exact * n, every - expected))
    t.p(sidak(min(fits, 2 * float(stats.norm.sf(np.abs(z).max()))), 3), "blur")
    t.sees(smallest_bias(math.sqrt(total), total), 0.025)


@case(3)
def lens_in_focus_is_a_pinhole(t: Trial) -> None:
    """Things in the focal plane are sharp.

    Each pixel has its own radiance bit for bit, except for samples that rounding, at most 2^-20 of
    the picture, takes across the edge of the lamp (false-alarm rate 1e-9).
    """
    lens = {"aperture_radius": 0.7, "focus_distance": 3.0}
    half = math.tan(math.radians(20)) * 3
    lamp = flat("rectangle", [half, 0, -3], [0, 0, 1], [half, 2 * half], BLACK, 2)
    eye = view([0, 0, 0], [0, 0, -1], 40.0, 8, "thinlens", up=[0, 1, 0], **lens)
    r = t.render(scene(eye, lamp, sky(1)), 2000)
    sharp = np.repeat([1.0, 2.0], 4)
    off = np.abs(r.image[:, :, 0] - sharp) * r.spp  # samples; beside the edge 2 pixels of each row
    t.check(np.delete(off, (3, 4), axis=1) == 0, "far from the edge")
    most = stats.poisson.isf(1e-9, 2**-20 * 2 * 8 * 8 * r.spp)
    t.check(off.sum() <= most + 0.01, f"{off.sum():g} samples on the other side of the edge")


@case(3, each={"depth": (1.5, 9.0)})
def edge_out_of_focus(t: Trial, depth: float) -> None:
    """A half plane in front of and behind the focal plane, blurred by a lens of known radius.

    A pixel sees the part of the lens on one side of a chord: 1/2 + (x sqrt(1 - x^2) + asin x) / pi
    with x the distance from the edge over the blur's radius, averaged over the pixel. Sees 1 %.
    """
    focus, aperture, fov, width = 3.0, 0.25, 40.0, 16
    half = math.tan(math.radians(fov / 2))
    fine = ((np.arange(width * 64) + 0.5) / 64 / width * 2 - 1) * half * focus  # focal plane
    # through lens point q the ray is at q (1 - z/f) + p z/f: lit where that is above 0
    x = np.clip(fine * (depth / focus) / (aperture * abs(1 - depth / focus)), -1, 1)
    share = 0.5 + (x * np.sqrt(1 - x * x) + np.arcsin(x)) / math.pi
    t.check(0 < x[len(x) // 2] < 0.2 and x.min() == -1, "the blur is some pixels wide")
    exact = share.reshape(width, 64).mean(1)
    t.check(abs(exact.mean() - 0.5) < 1e-12)
    eye = view([0, 0, 0], [0, 0, -1], fov, (width, 2), "thinlens", up=[0, 1, 0],
               aperture_radius=aperture, focus_distance=focus)  # fmt: skip
    lamp = flat("rectangle", [20, 0, -depth], [0, 0, 1], 20, BLACK, 3)
    t.agrees(scene(eye, lamp, sky(1)), (1 + 2 * exact)[None, :, None], 100_000, sees=0.01)


@case(3)
def aperture_zero_is_the_pinhole(t: Trial) -> None:
    """A lens of radius 0.

    The same film as the pinhole's, bit for bit.
    """
    pinhole = scene(view([1, 2, 5], [0, 0, 0], 40.0, 8),
                    flat("disk", [0, 0, 0], [0, 0, 1], 1, BLACK, 2), sky(1))  # fmt: skip
    lens = dataclasses.replace(pinhole.camera, focus_distance=2.0)
    seed = t.fresh()
    films = [t.render(s, 64, seed=seed).film_sha256 for s in (pinhole, pinhole.with_(camera=lens))]
    t.check(films[0] == films[1])


# ---- moving cameras ----


@case(3)
def orbit_and_dolly(t: Trial) -> None:
    """A camera that moves around a box whose faces emit six radiances.

    It sees the face that it must see, without noise; distances and axes to 1e-12.
    """
    faces = {(1, 0, 0): 1.0, (-1, 0, 0): 2.0, (0, 1, 0): 3.0, (0, -1, 0): 4.0, (0, 0, 1): 5.0,
             (0, 0, -1): 6.0}  # fmt: skip
    box = [flat("rectangle", n, n, 1, BLACK, value) for n, value in faces.items()]
    still = scene(view([0, 0, 5], [0, 0, 0], 30.0, 2), *box)
    start = veriray.Camera.look_at([0, 0, 5], [0, 0, 0], fov=10)
    for azimuth, elevation, value in ((0, 0, 5.0), (90, 0, 1.0), (180, 0, 6.0), (270, 0, 2.0),
                                      (-90, 0, 2.0), (30, 80, 3.0), (0, -80, 4.0)):  # fmt: skip
        moved = start.orbit(azimuth, elevation)
        position = moved.to_world[:3, 3]
        t.check(abs(np.linalg.norm(position) - 5) < 1e-12)
        t.check(np.abs(moved.to_world[:3, 2] + position / 5).max() < 1e-12)
        r = t.render(still.with_(camera=moved), 16)
        t.check((r.image == value).all() and not r.stderr.any(), f"face of {value}")
        near = moved.dolly(1.5)
        t.check(abs(np.linalg.norm(near.to_world[:3, 3]) - 3.5) < 1e-12)
        t.check(t.render(still.with_(camera=near), 16).image == value, f"face of {value}, near")
    t.check(start.to_world[:3, 3] == [0, 0, 5], "the camera itself stands where it stood")


@case(3)
def dolly_magnifies(t: Trial) -> None:
    """A disk's share of the picture, nearer and farther.

    It grows as the inverse square of the distance. Sees 3 %.
    """
    disk = flat("disk", [0, 0, 0], [0, 0, 1], 1, BLACK, 1)
    still = scene(view([0, 0, 10], [0, 0, 0], 30.0), disk)
    for step in (0.0, 4.0, -5.0):
        half = (10 - step) * math.tan(math.radians(15))
        moved = still.with_(camera=still.camera.dolly(step))
        t.agrees(moved, math.pi / (2 * half) ** 2, 1_600_000, sees=0.03)


# ---- narrow views ----


@case(3, each={"width": (1e-1, 1e-3, 1e-5, 1e-7), "parallel": (True, False), "away": (0.0, 40.0)})
def narrow_view_starts_at_its_camera(t: Trial, width: float, parallel: bool, away: float) -> None:
    """A black plate close to the camera hides the bright wall if it is in front, and only then.

    Views from wide ones to some of 10^-7 of the wall, whose rays start close to what they see;
    plates from a hundredth of the wall to rounding away. Exact: 1 or 0 in every pixel.
    """
    move = transform.translate((away, -away / 2, away / 4))
    turned = transform.rotate((1.0, 0.0, 0.0), 180.0)

    def plate(z: float, half: float) -> Array:
        place = transform.compose(transform.translate((0.0, 0.0, z)), transform.scale((half,) * 3))
        return transform.compose(move, transform.compose(place, turned))

    lens = transform.scale((width, width, 1.0)) if parallel else np.eye(4)
    eye = {"type": "orthographic"} if parallel else {
        "type": "perspective", "fov": 2 * math.degrees(math.atan(width))}  # fmt: skip
    film = box_film(4, 4)
    black = {"type": "twosided", "bsdf": {"type": "diffuse", "reflectance": 0.0}}
    for distance in (1e-2, 1e-4, 1e-6):
        if away and distance < 1e-5:  # the plate's own place is rounded there
            continue
        for side in (1, -1):
            seen = veriray.load_dict({
                "type": "scene", "integrator": {"type": "path", "max_depth": 1},
                "eye": {**eye, "to_world": transform.compose(move, lens), "film": film},
                "wall": {"type": "rectangle", "to_world": plate(1.0, 0.5), "bsdf": black,
                         "emitter": {"type": "area", "radiance": 1.0}},
                "plate": {"type": "rectangle", "bsdf": black,
                          "to_world": plate(side * distance, max(4 * width, 1e-6))},
            })  # fmt: skip
            told = 0 if side > 0 else 1
            t.check(t.render(seen, 16).image == told, f"{side * distance:g} in front")


@case(3)
def narrow_views_aside(t: Trial) -> None:
    """A shining wall fills views of 4,000 pixels below 2^-17 that look up to 63 degrees aside.

    As crops of wide films do. Exact: 1 in every pixel, however the wall is turned.
    """
    for _ in range(6):
        tan, depth = t.rng.uniform(2e-3, 1.3e-2), 10 ** t.rng.uniform(-3, 3)
        turned = transform.rotate((0.0, 1.0, 0.0), 180.0 + t.rng.uniform(-20, 20))
        place = transform.compose(
            transform.translate((0.0, 0.0, depth)),
            transform.compose(turned, transform.scale((100 * depth,) * 3)),
        )
        seen = veriray.load_dict({
            "type": "scene", "integrator": {"type": "path", "max_depth": 1},
            "eye": {"type": "perspective", "fov": 2 * math.degrees(math.atan(tan)),
                    "principal_point_offset_x": t.rng.uniform(-1, 1) / tan,
                    "film": box_film(4000, 1)},
            "wall": {"type": "rectangle", "to_world": place, "bsdf": BLACK,
                     "emitter": {"type": "area", "radiance": 1.0}},
        })  # fmt: skip
        t.check(t.render(seen, 4).image == 1)


# ---- light that the camera does not see ----

INSIDE = {"nothing": 0.0, "grey": 0.9, "mirror": 3.0, "grey behind null": 0.9}


@case(3, each={"inside": INSIDE, "shape": ("ball", "box"), "seed": (1, 77, 4242, 5)})
def hidden_light(t: Trial, inside: str, shape: str, seed: int) -> None:
    """A convex lamp of radiance 3, which shines inwards, around a grey or mirror ball, under a sky
    of 5, all hidden from the camera outside.

    A ball of reflectance 0.3 in it has the radiance 0.9, a mirror 3, without noise; past it the
    picture is black. Paths that escape are counted. Also behind a null surface. Sees 1 %.
    """
    rng = np.random.default_rng(seed)
    eye = rng.normal(size=3)
    eye *= 6 / np.linalg.norm(eye)
    lamp = (ball([0, 0, 0], 2.0, 0.0, 3.0, True) if shape == "ball"
            else box([-2, -1.9, -2.1], [2, 2.2, 2], True, 0.0, 3.0))  # fmt: skip
    parts = [lamp]
    if inside != "nothing":
        more = {"material": MIRROR} if inside == "mirror" else {}
        parts.append(ball([0, 0, 0], 1.0, 0.3, **more))
    if "null" in inside:
        parts.append(ball([0, 0, 0], 4.0, material=NULL))
    for target, value in (
        ([0, 0, 0], INSIDE[inside]),
        (eye + np.cross(eye, rng.normal(size=3)), 0),
    ):
        hidden = make(parts, camera(eye, target), 5.0, hide_emitters=True)
        r = t.agrees(hidden, value, 20_000, sees=0.01)
        if value != 0.9:
            t.check(r.image == value)
            t.check(not r.stderr.any(), "noise")
        if value == 0:
            t.check(sum(r.stats["ledger"]["escaped"]) == r.spp, "escaped")
        elif inside != "mirror":
            t.check(sum(r.stats["ledger"]["emitter_end"]) > 0, "lamps end other paths")
    seen = make(parts, camera(eye, [0, 0, 0]), 5.0)
    t.check(t.render(seen, 16).image == 0, "seen, the back of the lamp is black")


@case(3, each={"border": (False, True), "seed": (1, 77, 4242, 5)})
def hidden_light_in_a_medium(t: Trial, border: bool, seed: int) -> None:
    """A lamp that shines away from the camera onto a mirror that shows its front, in absorbing fog.

    The whole way is attenuated: to the lamp, which is not there, to the mirror and back. It is no
    border for the camera either (the fog would end at it). Sees 1 %.
    """
    q, _ = np.linalg.qr(np.random.default_rng(seed).normal(size=(3, 3)))
    x, y, z = q.T * np.sign(np.linalg.det(q))
    fog = Medium(0.2)
    more = {"interior": fog} if border else {}
    lamp = quad(-3 * x - 3 * y, 6 * x, 6 * y, 0, 2.0, **more)
    mirror = quad(2 * z - 3 * x - 3 * y, 6 * y, 6 * x, 0, material=MIRROR)
    eye = camera(0.1 * x - 1.5 * z, 0.1 * x)
    hidden = make([lamp, mirror], eye, 7.0, camera_medium=fog, hide_emitters=True)
    t.agrees(hidden, 2 * math.exp(-0.2 * 5.5), 800_000, sees=0.01)


# ---- filters ----


def mitchell(x: Array) -> Array:
    """Mitchell and Netravali, 1988, with B = C = 1/3."""
    b = c = 1 / 3
    x = np.abs(x)
    near = ((12 - 9 * b - 6 * c) * x**3 + (-18 + 12 * b + 6 * c) * x**2 + 6 - 2 * b) / 6
    far = ((-b - 6 * c) * x**3 + (6 * b + 30 * c) * x**2 + (-12 * b - 48 * c) * x
           + 8 * b + 24 * c) / 6  # fmt: skip
    return np.where(x < 1, near, np.where(x < 2, far, 0.0))


FILTERS = {
    "box": (lambda x: 1.0 * (np.abs(x) <= 0.5), 0.5),
    "tent": (lambda x: np.maximum(1 - np.abs(x), 0.0), 1.0),
    "gaussian": (lambda x: np.exp(-2 * x * x) - math.exp(-8), 2.0),
    "mitchell": (mitchell, 2.0),
    "lanczos": (lambda x: np.sinc(x) * np.sinc(x / 3), 3.0),
}


#: Of step functions: the renderer holds a filter as 4,096 cells of equal probability.
TABLE = {"box": MARGIN, "tent": MARGIN, "gaussian": 2e-4, "mitchell": 4e-4, "lanczos": 4e-4}


def above(name: str, edge: float, pixels: int) -> Array:
    """Share of each pixel's filter beyond `edge`, in pixels, along one axis."""
    kernel, reach = FILTERS[name]
    at = (np.arange(200_000) + 0.5) / 100_000 * reach - reach
    weight = kernel(at)
    return np.array([float(weight[at > edge - i - 0.5].sum() / weight.sum())
                     for i in range(pixels)])  # fmt: skip


@case(3, each={"name": FILTERS})
def edge_under_a_filter(t: Trial, name: str) -> None:
    """A lit half plane from pixel 5.65 on.

    1 + 2 times the filter's integral over it; negative lobes over- and undershoot.
    """
    width, height, edge = 12, 3, 5.65
    half = math.tan(math.radians(20))
    x = (2 * edge / width - 1) * half  # world +x is on the picture's right
    lamp = flat("rectangle", [x + 5, 0, -1], [0, 0, 1], 5, BLACK, 3)
    size = (width, height)
    eye = view([0, 0, 0], [0, 0, -1], 40.0, size, up=[0, 1, 0], rfilter={"type": name})
    share = above(name, edge, width)
    exact = np.broadcast_to((1 + 2 * share)[None, :, None], (height, width, 3))
    t.check(name not in ("mitchell", "lanczos") or exact.min() < 0.97)
    t.agrees(scene(eye, lamp, sky(1)), exact, 100_000, sees=0.005, margin=TABLE[name])


@case(3, each={"name": FILTERS}, quick=lambda name: name in ("box", "gaussian"))
def corner_under_a_filter(t: Trial, name: str) -> None:
    """A lit quarter plane whose corner is at film position (9.3, 7.7) of 12 x 10.

    1 + 2 times the product of the filter's integrals along both axes. This tests the filter's place
    and width, and the direction of the picture's rows and columns. Sees 0.5 %.
    """
    width, height, x_edge, y_edge = 12, 10, 9.3, 7.7
    half = math.tan(math.radians(20))
    x = (2 * x_edge / width - 1) * half
    y = (1 - 2 * y_edge / height) * half * height / width
    lamp = flat("rectangle", [x + 5, y + 5, -1], [0, 0, 1], 5, BLACK, 3)  # right of x, above y
    eye = view([0, 0, 0], [0, 0, -1], 40.0, (width, height), up=[0, 1, 0], rfilter={"type": name})
    right, upper = above(name, x_edge, width), 1 - above(name, y_edge, height)
    exact = 1 + 2 * upper[:, None, None] * right[:, None]
    t.check(abs((exact.mean() - 1) / 2 - (12 - x_edge) / 12 * y_edge / 10) < 0.01)
    t.agrees(scene(eye, lamp, sky(1)), exact, 100_000, sees=0.005, margin=TABLE[name])


# ---- cameras at a surface ----


@case(3, each={"kind": ("rectangle", "disk", "sphere", "cube", "cylinder")})
def meter_under_an_even_sky(t: Trial, kind: str) -> None:
    """On a convex black body a meter measures pi under a sky of 1, in every pixel, within 3e-5.

    Rays leave by the cosine and meet nothing of what they left. Turned, stretched along one axis
    and of sizes from 1e-3 to 1e3; one of five is 900 of its sizes away from the origin.

    But next to the edges of a cube, whose other face is widened by e = 2^-20 of the scene: at the
    distance x a share of (e / x)^2 meets it, so 2 e of the length of each edge on either side, half
    of the directions. Edges over area are below 1.6 halves of the cube: 2^-18 of the rays at most.
    """
    turns = t.rng.normal(size=(5, 3)), t.rng.uniform(0, 360, 5), t.rng.uniform(-3, 3, 5)
    for k, (axis, angle, size) in enumerate(zip(*turns, strict=True)):
        axis = axis / np.linalg.norm(axis)
        across = 1.0 if kind == "sphere" else t.rng.uniform(0.2, 5)
        place = transform.compose(
            transform.translate(np.array([900.0, -500, 300]) * 10**size * (k == 4)),
            transform.compose(transform.rotate(axis, angle),
                              transform.scale(np.array([across, 1, 1]) * 10**size)),
        )  # fmt: skip
        meter = {"type": "irradiancemeter", "film": box_film(3, 2)}
        body = {"type": kind, "to_world": place, "bsdf": BLACK, "meter": meter}
        made = veriray.load_dict({"type": "scene", "sky": sky(1.0), "body": body})
        r = t.render(made, 1024)
        lost = r.stats["ledger"]["absorbed"][0]
        most = stats.poisson.isf(1e-9, 2.0**-18 * r.stats["paths"]) if kind == "cube" else 0
        t.check(lost <= most, f"{lost} rays met what they left, {k}")
        off = np.abs(r.image / math.pi - 1).max()
        t.check(off < 3e-5 + lost / r.spp, f"{r.image.min()} to {r.image.max()}, {k}")


@case(3, each={"kind": ("rectangle", "disk", "mesh"), "gap": (0.5, 2.0)})
def meter_below_a_lamp(t: Trial, kind: str, gap: float) -> None:
    """Two equal faces across: pi times the form factor. Sees 2 %; a mesh is four triangles.

    J. Howell, "A Catalog of Radiation Heat Transfer Configuration Factors", C-11 and C-41.
    """
    if kind != "disk":
        x, root = 2 / gap, math.sqrt(1 + 4 / gap**2)
        share = 2 / (math.pi * x * x) * (
            math.log((1 + x * x) / math.sqrt(1 + 2 * x * x))
            + 2 * x * root * math.atan(x / root) - 2 * x * math.atan(x)
        )  # fmt: skip
    else:
        x = 2 + gap * gap
        share = (x - math.sqrt(x * x - 4)) / 2
    above = transform.translate((0.0, 0.0, gap))
    corners = [[0, 0, 0], [-1, -1, 0], [1, -1, 0], [1, 1, 0], [-1, 1, 0]]
    fan = {"vertices": np.array(corners, float),
           "faces": np.array([[0, k, k % 4 + 1] for k in range(1, 5)])}  # fmt: skip
    meter = {"type": "irradiancemeter", "film": box_film()}
    made = veriray.load_dict({
        "type": "scene",
        "below": {"type": kind, "bsdf": BLACK, "meter": meter, **(fan if kind == "mesh" else {})},
        "above": {"type": "disk" if kind == "disk" else "rectangle", "to_world": above,
                  "flip_normals": True,
                  "emitter": {"type": "area", "radiance": 1.0}},
    })  # fmt: skip
    t.agrees(made, math.pi * share, 1 << 19, 0.02)


@case(3, each={"kind": ("rectangle", "disk", "sphere"), "share": (0.25, 0.64)})
def distant_sensor_on_a_shape(t: Trial, kind: str, share: float) -> None:
    """A lamp covers a part of the target's shadow: its share of the target's area. Sees 4 %.

    Of a ball, points at most r from the axis have 1 - sqrt(1 - r^2) of the area.
    """
    half = math.sqrt(1 - (1 - share) ** 2) if kind == "sphere" else math.sqrt(share)
    lamp = transform.compose(
        transform.translate((0.0, 0.0, -3.0)), transform.scale((half, half, 1.0))
    )
    target = {"type": kind}
    made = veriray.load_dict({
        "type": "scene",
        "eye": {"type": "distant", "direction": [0, 0, -1], "film": box_film(), "target": target},
        "lamp": {"type": "rectangle" if kind == "rectangle" else "disk", "to_world": lamp,
                 "emitter": {"type": "area", "radiance": 1.0}},
    })  # fmt: skip
    t.agrees(made, share, 1 << 16, 0.04)
