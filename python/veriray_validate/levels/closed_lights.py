"""Lights against closed forms, and their selection."""

from __future__ import annotations

import math

import numpy as np
import numpy.typing as npt

from veriray_validate.dicts import (
    BLACK,
    Dict,
    area,
    cuboid,
    diffuse,
    direction,
    flat,
    look,
    rgb,
    scene,
    sky,
    sphere,
    view,
)
from veriray_validate.form_factors import cap, gauss, lambert, to_disk
from veriray_validate.trial import MARGIN, Trial, case

Array = npt.NDArray[np.float64]
FLOOR = flat("rectangle", [0, 0, 0], [0, 0, 1], 30, diffuse(0.5))
EYE = view([-3, 0.2, 1], [0, 0, 0])


@case(3, once=True)
def cone_integral_agrees(t: Trial) -> None:
    """The integral over a cone against (R / d)^2 and, half sunk, against its closed form.

    A cone whose axis lies in the horizon: a - sin a cos a.
    """
    t.check(abs(cap(0.3, 0.2) / math.pi - math.sin(0.2) ** 2 * math.cos(0.3)) < 1e-7)
    t.check(abs(cap(math.pi / 2, 0.5) - (0.5 - math.sin(0.5) * math.cos(0.5))) < 1e-5)


# ---- emitting spheres and disks ----

SPHERES = {  # radius, distance, angle off the normal
    "facing": (0.5, 2, 0), "oblique": (0.5, 2, 60), "at the horizon": (0.5, 2, 85),
    "small": (0.01, 10, 30), "touching": (0.99, 1, 0), "half of the sky": (2, 2.1, 80),
}  # fmt: skip


#: As a share of the renderer's unit, the power of two above the scene's largest distance from the
#: camera along an axis: how far a flat's plane lies behind its surface for arriving rays
#: (cpp/geometry/polygon.h).
BEHIND = 2.0**-22


def ball_over_a_point(radius: float, centre: Array, point: Array) -> float:
    """Irradiance over radiance of a ball, at a point with normal z."""
    to = centre - point
    distance = float(np.linalg.norm(to))
    return cap(math.acos(to[2] / distance), math.asin(radius / distance))


@case(3, each={"place": SPHERES})
def sphere_light(t: Trial, place: str) -> None:
    """An emitting ball over a plane.

    rho L (R / d)^2 cos above the horizon (facing: pi L / 16 = .196350); by quadrature where the
    ball dips below it. A ray from e meets the plane BEHIND its surface, so aside by BEHIND times
    the tangent of its angle: what that changes is below the margin.
    """
    radius, distance, angle = SPHERES[place]
    centre = distance * direction(angle)
    exact = cap(math.radians(angle), math.asin(radius / distance)) / math.pi
    if radius / distance < math.cos(math.radians(angle)):
        t.check(abs(exact / (radius / distance) ** 2 / math.cos(math.radians(angle)) - 1) < 1e-5)
    t.check(place != "facing" or abs(math.pi * exact - 0.196350) < 1e-6)
    # Where the ball is close the camera looks from below its side, past it.
    eye = np.array([-0.5, 0.02, 0.02 if place == "touching" else 0.5])
    floor = flat("rectangle", [0, 0, 0], [0, 0, 1], 3, diffuse(0.5))
    most = max(float(np.abs(centre - eye).max()) + radius, 3 + 0.5)
    unit = 2.0 ** (math.floor(math.log2(most)) + 1)
    moved = -eye / eye[2] * BEHIND * unit
    moved[2] = 0
    change = ball_over_a_point(radius, centre, moved) / (math.pi * exact) - 1
    t.check(abs(change) < 0.8 * MARGIN, f"the surface's distance changes {change:.1e}")
    ball = sphere(centre, radius, BLACK, [1, 2, 10])
    seen = scene(view(eye, [0, 0, 0]), floor, ball)
    t.agrees(seen, 0.5 * exact * np.array([1, 2, 10]), 800_000, sees=0.01)


@case(3)
def far_and_tiny(t: Trial) -> None:
    """A ball of radius 1e-3 at distance 1,000: 3e-12 sr.

    rho L (R / d)^2 cos, almost without noise; the error is an upper bound, so far below the ball.
    """
    ball = sphere(1000 * direction(20), 1e-3, BLACK, 1e9)
    exact = 0.5 * 1e9 * 1e-12 * math.cos(math.radians(20))
    t.agrees(scene(EYE, FLOOR, ball, max_depth=2), exact, 1_000_000, sees=1e-3, margin=1e-4)


@case(3)
def inside_a_shining_sphere(t: Trial) -> None:
    """A sphere turned inside out, where every point sees all of it.

    A furnace, E / (1 - rho).
    """
    room = {**sphere([1, 2, 3], 2, diffuse([0.5, 0.2, 0.8]), [0.5, 1, 0.1]), "flip_normals": True}
    exact = np.array([0.5, 1, 0.1]) / (1 - np.float32([0.5, 0.2, 0.8]).astype(float))
    t.agrees(scene(view([1.5, 2, 3], [2, 2.2, 3.5], 60), room), exact, 800_000, sees=0.01)


@case(3, each={"half": (20, 60, 100, 150, 1_000, 1_900, 1e5)})
def lamp_at_a_camera_close_to_a_wide_ground(t: Trial, half: float) -> None:
    """A point light at a camera 1 above a ground, which it sees 140 degrees wide: rho / pi I cos^3.

    Of a pixel, the mean over x, y of the ground at distance 1: differences of arctan(x y / sqrt(1 +
    x^2 + y^2)). Hits that go on by a share of the ground would show.
    """
    ground = flat("rectangle", [0, 0, 0], [0, 0, 1], half, diffuse(0.5))
    lamp = {"type": "point", "position": [0, 0, 1], "intensity": rgb(20)}
    edge = math.tan(math.radians(70)) * np.linspace(-1, 1, 65)
    x, y = np.meshgrid(edge, edge)
    inside = np.diff(np.diff(np.arctan(x * y / np.sqrt(1 + x * x + y * y)), axis=0), axis=1)
    exact = 0.5 / math.pi * 20 * inside / (edge[1] - edge[0]) ** 2
    eye = view([0, 0, 1], [0, 0, 0], 140, 64)
    asked = scene(eye, ground, lamp, max_depth=2)
    t.agrees(asked, exact[..., None], 2_000, sees=1e-3, margin=1e-4)


@case(3, each={"kind": ("point", "rectangle", "sphere")})
def lamps_seen_from_far(t: Trial, kind: str) -> None:
    """A lamp 1 above a ground, seen from 60 to 120 along its normal, which is drawn.

    rho / pi E, by quadrature over what is seen and the rectangle. Shadow rays start and end off
    surfaces by 2^-21 of the camera's distance each, which would be 1e-4 of the light and more. The
    frame's origin is near the camera, so places are rounded to 2^-25 of `far` or twice that: the
    margin is what this makes of the distance, and for rectangles over three standard deviations of
    what it makes of their area.
    """
    far, aside = float(t.rng.uniform(60, 120)), float(t.rng.uniform(0.2, 0.6))
    half, size = 0.02, 0.12 if kind == "rectangle" else 0.01
    margin = MARGIN + 2**-24 * far * (2 + (1 / size if kind == "rectangle" else 0))
    turn = look(t.rng.uniform(-1, 1, 3), t.rng.uniform(2, 3, 3))

    def placed(x: float, z: float, *scale: float) -> Array:
        at = np.diag([*scale, 1.0])
        at[:3, 3] = x, 0, z
        return np.asarray(turn @ at)

    above = placed(aside, 1, size, -size, -size)
    lamp: Dict = {"type": kind, "to_world": above, "bsdf": BLACK, "emitter": area(1)}
    if kind == "point":
        lamp = {"type": kind, "position": above[:3, 3], "intensity": rgb(1)}
    ground = {"type": "rectangle", "to_world": placed(0, 0, 10, 10, 1), "bsdf": diffuse(0.5)}
    eye = view([0, 0, 0], [0, 0, 1], 2 * math.degrees(math.atan(half / far)))
    eye["to_world"] = placed(0, far, 1, -1, -1)

    x, w = gauss(8, -1, 1)
    u, v = (g.ravel() for g in np.meshgrid(x, x))
    share = np.outer(w, w).ravel()
    p, q, power, strength = u, v, 2.0, share * size**2
    if kind != "rectangle":
        p, q = np.zeros((2, 1))
        power, strength = 1.5, np.array([1.0 if kind == "point" else math.pi * size**2])
    across = np.add.outer(size * p + aside, half * u)
    along = np.add.outer(size * q, half * v)
    exact = 0.5 / math.pi * strength @ (across**2 + along**2 + 1) ** -power @ share / 4
    asked = scene(eye, ground, lamp, max_depth=2)
    t.agrees(asked, exact, 1_000_000, sees=4e-4, margin=margin)


@case(3, each={"distance": (1e4, 1e7, 1e12)})
def a_point_light_far_away_is_a_sun(t: Trial, distance: float) -> None:
    """A white floor of half size 1 under a sky of 1 and a lamp of intensity pi d^2 at d: 2.

    The film's resolution must go by what the lamp gives the floor, errors too.
    """
    ground = flat("rectangle", [0, 0, 0], [0, 0, 1], 1, diffuse(1))
    lamp = {"type": "point", "position": [0, 0, distance], "intensity": rgb(math.pi * distance**2)}
    eye = view([0.3, 0.2, 2], [0, 0, 0], 10, 4)
    t.agrees(scene(eye, ground, lamp, sky(1), max_depth=2), 2, 40_000, sees=0.01)


@case(3, each={"aspect": (1, 20, 500, 2_000), "scenes": (10, 60)},
      quick=lambda aspect, scenes: scenes == 10)  # fmt: skip
def long_lamps_beside_a_surface(t: Trial, aspect: float, scenes: int) -> None:
    """Rectangular lamps of length 1, turned, a thousandth to a half beside a patch.

    J. H. Lambert's form factor. Corners are rounded to 2^-25 of the length, which moves the lamp
    and tilts it about its long axis: the margin is 2^-21 of the length over the distance, and 2^-22
    of it over the width.
    """
    for _ in range(scenes):
        turn = look([0, 0, 0], t.rng.normal(size=3), t.rng.normal(size=3))[:3, :3]
        half = np.array([0.5 / aspect, 0.5, 1])
        gap = 10 ** t.rng.uniform(-3, -0.3) * t.rng.uniform(0.5, 2, 2)
        place = turn @ [-half[0] - gap[0], t.rng.uniform(-0.4, 0.4), gap[1]]
        normal, up = turn @ [0.6, 0, -0.8], turn @ [0.3, 0.8, 0.1]
        corners = [turn @ (half * [x, y, 0]) for x, y in ((-1, -1), (1, -1), (1, 1), (-1, 1))]
        exact = lambert(place, normal, corners)
        size = 0.02 * float(gap.min())
        patch, lamp = np.eye(4), np.eye(4)
        patch[:3] = look(place, place + normal, up)[:3] @ np.diag([size, size, 1, 1])
        lamp[:3, :3] = turn * half
        eye = view(place + size * normal, place, up=up, near_clip=1e-9)
        shown = scene(eye, {"type": "rectangle", "to_world": patch, "bsdf": diffuse(1)},
                      {"type": "rectangle", "to_world": lamp, "bsdf": BLACK, "emitter": area(1)},
                      max_depth=2)  # fmt: skip
        margin = MARGIN + 2**-21 / float(np.hypot(*gap)) + 2**-22 * aspect
        t.agrees(shown, exact, 65_536, sees=0.1, margin=margin)


@case(3, each={"far": ("sun", "sky"), "half": (5, 100, 10_000)})
def lamp_beside_faint_light_from_far_away(t: Trial, far: str, half: float) -> None:
    """A point light of 20, one above a ground that a sun or an even sky of 0.1 lights as a whole.

    rho / pi (20 + 0.1), or 20 rho / pi + 0.1 rho. The power from far away goes with the ground's
    area, the lamp's does not: by power alone the lamp's samples would be too rare to see.
    """
    ground = flat("rectangle", [0, 0, 0], [0, 0, 1], half, diffuse(0.5))
    lamp = {"type": "point", "position": [0, 0, 1], "intensity": rgb(20)}
    sun = {"type": "directional", "direction": [0, 0, -1], "irradiance": rgb(0.1)}
    even = {"type": "envmap", "bitmap": np.full((2, 4, 3), 0.1, np.float32)}
    exact = 0.5 / math.pi * (20 + 0.1 * (1 if far == "sun" else math.pi))
    light = sun if far == "sun" else even
    # Samples of both lights weigh almost alike.
    t.agrees(scene(EYE, ground, lamp, light, max_depth=2), exact, 400_000, sees=0.01)


@case(3, each={"inside": (True, False)})
def backs_of_spheres_are_black(t: Trial, inside: bool) -> None:
    """A floor within a ball that emits outwards, and in front of one that emits inwards.

    Exactly 0: light samples respect the side too.
    """
    ball = {**sphere([0, 0, 2], 5 if inside else 1, BLACK, 3), "flip_normals": not inside}
    t.agrees(scene(view([-0.5, 0.02, 0.02], [0, 0, 0]), FLOOR, ball), 0.0, 100_000, sees=1e-4)


@case(3, each={"angle": (0, 50)})
def disk_light(t: Trial, angle: float) -> None:
    """A disk on the axis, and the same over a tilted plane.

    pi L R^2 / (R^2 + h^2) (R = h = 1: 1.570796), times the cosine of the tilt.
    """
    normal = direction(angle)
    t.check(abs(math.pi * 0.5 - 1.570796) < 1e-6)
    if angle == 0:
        lamp = flat("disk", normal, -normal, 1, BLACK, 1)
        t.agrees(scene(EYE, FLOOR, lamp), 0.5 * 0.5, 800_000, sees=0.005)
    lamp = flat("disk", 3 * normal, -normal, 1, BLACK, [1, 5, 0.1])
    exact = 0.5 * 0.1 * math.cos(math.radians(angle))  # all of it is above the horizon
    t.agrees(scene(EYE, FLOOR, lamp), exact * np.array([1, 5, 0.1]), 800_000, sees=0.005)


@case(3)
def elliptic_disk_light(t: Trial) -> None:
    """Half axes 1.5 and 0.4 at height 1, and its share of a picture.

    By quadrature, in two ways; pi a b over the area of the film.
    """
    x, w = np.polynomial.legendre.leggauss(80)
    r, wr = (x + 1) / 2, w / 2
    phi = (np.arange(400) + 0.5) / 400 * 2 * math.pi
    d2 = 1 + (1.5 * r[:, None] * np.cos(phi)) ** 2 + (0.4 * r[:, None] * np.sin(phi)) ** 2
    exact = 0.5 / math.pi * 1.5 * 0.4 * float((wr * r) @ (1 / d2**2).mean(axis=1)) * 2 * math.pi
    other = 0.5 * to_disk([0, 0, 1], [1.5, 0, 0], [0, 0.4, 0], [0, 0, 1])
    t.check(abs(other / exact - 1) < 1e-9, "two ways")
    lamp = flat("disk", [0, 0, 1], [0, 0, -1], [1.5, 0.4], BLACK, 1)
    t.agrees(scene(EYE, FLOOR, lamp), exact, 800_000, sees=0.005)
    fov = 2 * math.degrees(math.atan(2 / 5))
    front = scene(view([0, 0, -4], [0, 0, 1], fov), lamp)
    t.agrees(front, math.pi * 1.5 * 0.4 / 16, 800_000, sees=0.02)


@case(3)
def concentric_spheres(t: Trial) -> None:
    """Radii 1 and 2, albedos .3 and .6, inner exitance 1.

    B1 = 1.089109, B2 = .297030.
    """
    outer_b = 0.6 * 0.25 / (1 - 0.6 * 0.75 - 0.6 * 0.25 * 0.3)
    inner_b = 1 + 0.3 * outer_b
    t.check(abs(inner_b - 1.089109) < 1e-6 and abs(outer_b - 0.297030) < 1e-6)
    system = np.linalg.solve([[1, -0.3], [-0.6 * 0.25, 1 - 0.6 * 0.75]], [1, 0])
    t.check(np.abs(system - [inner_b, outer_b]).max() < 1e-12, "two ways")
    inner = sphere([0, 0, 0], 1, diffuse(0.3), 1 / math.pi)
    outer = {**sphere([0, 0, 0], 2, diffuse(0.6)), "flip_normals": True}
    for target, exact in (([0, 0, 0], inner_b), ([0, 1.5, 2], outer_b)):
        seen = scene(view([0, 0, 1.5], target), inner, outer)
        t.agrees(seen, exact / math.pi, 800_000, sees=0.01)


# ---- lights without a surface ----


@case(3, each={"radius": (1.0, 2.0)})
def point_light_in_a_sphere(t: Trial, radius: float) -> None:
    """A point light at the centre of a room of albedo .5.

    rho I / (pi R^2 (1 - rho)): 1 with R = 1, .25 with R = 2; a falloff of 1 / r would give another
    number.
    """
    room = {**sphere([0, 0, 0], radius, diffuse(0.5)), "flip_normals": True}
    light = {"type": "point", "position": np.zeros(3), "intensity": rgb(math.pi)}
    seen = scene(view([radius / 2, 0, 0], [0, radius / 2, 0.75 * radius]), room, light)
    t.agrees(seen, 1 / radius**2, 800_000, sees=0.01)


TILT = direction(30)
PLATE = flat("rectangle", [0, 0, 0], TILT, 1, diffuse(0.5))


def falloff(angle: float, cutoff: float, beam: float) -> float:
    """Share of a spot's intensity, linear from beam to cutoff."""
    return float(np.clip((cutoff - angle) / (cutoff - beam), 0, 1))


WHERE = direction(-20)
LIGHTS: dict[str, tuple[Dict, float]] = {
    "point": ({"type": "point", "position": 3 * WHERE, "intensity": rgb([1, 2, 5])}, 1 / 9),
    "directional": (
        {"type": "directional", "direction": -WHERE, "irradiance": rgb([1, 2, 5])}, 1.0),
}  # fmt: skip
for _angle in (0.0, 9.0, 14.0, 29.0, 31.0):
    _axis = look(3 * WHERE, [0, 0, 0]) @ look([0, 0, 0], direction(_angle))
    _spot = {"type": "spot", "to_world": _axis, "intensity": rgb([1, 2, 5]), "cutoff_angle": 30.0}
    LIGHTS[f"spot at {_angle:g}"] = {**_spot, "beam_width": 10.0}, falloff(_angle, 30, 10) / 9


@case(3, each={"name": LIGHTS})
def light_on_a_tilted_plane(t: Trial, name: str) -> None:
    """Point, parallel and spot light on a tilted plane.

    I cos / d^2 rho / pi, E cos rho / pi; a spot's falloff is linear in the angle. No noise.
    """
    light, strength = LIGHTS[name]
    exact = 0.5 / math.pi * math.cos(math.radians(50)) * strength * np.array([1, 2, 5])
    seen = scene(view([-0.5, 0.3, 3], [0, 0, 0]), PLATE, light, max_depth=2)
    # The last degree of the falloff: 20 times the rounding of the angle.
    margin, sees = (1e-3, 2e-3) if name == "spot at 29" else (MARGIN, 6e-5)
    t.agrees(seen, exact, 10_000, sees=sees, margin=margin)


@case(3)
def flux_of_a_spot(t: Trial) -> None:
    """All of a spot's light falls into a picture of the floor.

    Its flux over its intensity: 2 pi (1 - cos b) + 2 pi integral of the falloff; in closed form
    2 pi (1 - (sin c - sin b) / (c - b)), with b and c in radians. Sees 1 %.
    """
    b, c = math.radians(25), math.radians(40)
    flux = 2 * math.pi * (1 - (math.sin(c) - math.sin(b)) / (c - b))
    x, w = gauss(40, b, c)
    other = 2 * math.pi * (1 - math.cos(b) + float(w @ ((c - x) / (c - b) * np.sin(x))))
    t.check(abs(flux / other - 1) < 1e-12, "two ways")
    half = 1.1  # tan 40 = .84
    spot = {"type": "spot", "to_world": look([0.1, -0.05, 1], [0.1, -0.05, 0]),
            "intensity": rgb([1, 2, 5]), "cutoff_angle": 40.0, "beam_width": 25.0}  # fmt: skip
    eye = view([0, 0, 2], [0, 0, 0], 2 * math.degrees(math.atan(half / 2)), up=[0, 1, 0])
    exact = 0.5 / math.pi * flux / (2 * half) ** 2 * np.array([1, 2, 5])
    t.agrees(scene(eye, FLOOR, spot, max_depth=2), exact, 800_000, sees=0.01)


@case(3, each={"angle": (0, 45, 90, 135)})
def phases_of_a_ball(t: Trial, angle: float) -> None:
    """A Lambertian ball in parallel light, like the moon.

    [sin a + (pi - a) cos a] / pi of its full brightness: 1, .755409, .318310, .048302.
    """
    a = math.radians(angle)
    phase = (math.sin(a) + (math.pi - a) * math.cos(a)) / math.pi
    t.check(abs(phase - {0: 1, 45: 0.755409, 90: 0.318310, 135: 0.048302}[angle]) < 1e-6)
    distance, half = 3000.0, 1.05
    ball = sphere([0, 0, 0], 1, diffuse(0.8))
    light = {"type": "directional", "direction": -direction(angle), "irradiance": rgb(math.pi)}
    fov = 2 * math.degrees(math.atan(half / distance))
    exact = 2 / 3 * 0.8 * phase * math.pi / (2 * half) ** 2
    far = scene(view([0, 0, distance], [0, 0, 0], fov), ball, light)
    t.agrees(far, exact, 800_000, sees=0.02, margin=1e-4)


@case(3)
def shadow_of_a_ball(t: Trial) -> None:
    """A point light behind a ball, a millimetre inside and outside the shadow's edge.

    In the shadow exactly nothing arrives; outside it all of the light does.
    """
    light = {"type": "point", "position": np.array([0, 0, 4.0]), "intensity": rgb(16)}
    ball = sphere([0, 0, 2], 1, BLACK)
    rim = 4 / math.sqrt(3)  # the tangent cone's radius on the floor
    for x, exact in ((rim - 1e-3, 0.0), (rim + 1e-3, 1.0)):
        d2 = x * x + 16
        value = exact * 0.5 / math.pi * 16 * 4 / d2**1.5
        eye = view([x + 3, 0, 1], [x, 0, 0], 1e-3)
        t.agrees(scene(eye, FLOOR, ball, light), value, 10_000, sees=1e-3, margin=1e-4)


@case(3, quick=False)
def penumbra_of_a_disk(t: Trial) -> None:
    """A disk light behind the edge of a half plane, at seven places of the penumbra.

    The form factor of the visible part of the disk, cut by a chord, by quadrature. Sees 2 %.
    """
    radius, height = 0.5, 2.0
    screen = flat("rectangle", [10, 0, 1], [0, 0, 1], 10, {"type": "twosided", "bsdf": BLACK})
    lamp = flat("disk", [0, 0, height], [0, 0, -1], radius, BLACK, 3)
    for x in (-0.6, -0.4, -0.25, 0.0, 0.1, 0.2, 0.3):
        # the screen's edge at (0, y, 1) is seen from (x, 0, 0) at -x in the lamp's plane
        u, wu = gauss(200, -radius, min(max(-x, -radius), radius))
        y, wy = gauss(60, -1, 1)
        chord = np.sqrt(np.maximum(radius**2 - u**2, 0))
        d2 = (u - x)[:, None] ** 2 + (chord[:, None] * y) ** 2 + height**2
        exact = 0.5 * 3 / math.pi * float((wu * chord) @ (height**2 / d2**2) @ wy)
        if x < -radius:
            whole = to_disk([-x, 0, height], [radius, 0, 0], [0, radius, 0], [0, 0, 1])
            t.check(abs(exact / (0.5 * 3 * whole) - 1) < 1e-5, "two ways")
        seen = scene(view([x - 3, 0.1, 0.4], [x, 0, 0], 1e-3), FLOOR, screen, lamp)
        t.agrees(seen, exact, 800_000, sees=0.03, margin=3e-5)


# ---- many lights ----


@case(3)
def forty_point_lights(t: Trial) -> None:
    """Forty point lights, of which one is chosen at a time.

    The sum of all of them.
    """
    rng = np.random.default_rng(40)
    lights: list[Dict] = []
    exact = np.zeros(3)
    for _ in range(40):
        p = rng.normal(size=3) * 3 + [0, 0, 0.5]
        p[2] = abs(p[2]) + 1
        intensity = rng.uniform(0, 1, 3) * rng.choice([0.1, 1, 5])
        lights.append({"type": "point", "position": p, "intensity": rgb(intensity)})
        exact += 0.5 / math.pi * intensity * p[2] / (p @ p) ** 1.5
    seen = scene(EYE, FLOOR, *lights, max_depth=2)
    t.agrees(seen, exact, 800_000, sees=0.02)


def hundred_lights() -> tuple[list[Dict], Array]:
    """Balls, disks, points, spots, a sun and a sky over FLOOR, and the radiance at its centre.

    They stand on a spiral so that none hides another; balls and disks hide their share of the sky.
    """
    exact, form = np.zeros(3), 0.0
    objects: list[Dict] = []
    for k in range(100):
        z = 0.98 - 0.93 * k / 100
        phi, s = 2.399963 * k, math.sqrt(1 - z * z)
        d = np.array([s * math.cos(phi), s * math.sin(phi), z])
        colour = np.array([(0.3, 1, 2), (2, 0.5, 0.2), (1, 1, 1)][k % 3]) * (1 + k % 7)
        kind = ("ball", "disk", "point", "spot")[k % 4]
        if kind == "ball":
            objects.append(sphere(6 * d, 0.2, BLACK, 5 * colour))
            share = (0.2 / 6) ** 2 * z
        elif kind == "disk":
            objects.append(flat("disk", 6 * d, -d, 0.25, BLACK, 5 * colour))
            share = 0.25**2 / (0.25**2 + 36) * z
        else:
            light: Dict = {"type": kind, "intensity": rgb(colour)}
            if kind == "spot":
                light |= {"to_world": look(4 * d, [0, 0, 0]), "cutoff_angle": 20.0}
            else:
                light |= {"position": 4 * d}
            objects.append(light)
            exact += 0.5 / math.pi * colour * z / 16
            continue
        form += share
        exact += 0.5 * 5 * colour * share
    sun = np.array([1.0, 2, 0.5])
    objects.append({"type": "directional", "direction": -direction(77), "irradiance": rgb(sun)})
    exact += 0.5 / math.pi * sun * math.cos(math.radians(77))
    exact += 0.5 * 0.4 * (1 - form)
    return [FLOOR, *objects, sky(0.4)], exact


@case(3)
def hundred_lights_of_all_kinds(t: Trial) -> None:
    """Balls, disks, points, spots and a sun over a floor under a sky.

    The sum of all of them, less the share of the sky that they hide.
    """
    objects, exact = hundred_lights()
    # The camera looks straight down along the axis, past all of them.
    eye = view([0, 0, 5], [0, 0, 0])
    t.agrees(scene(eye, *objects, max_depth=2), exact, 1_600_000, sees=0.04)


@case(3)
def lights_behind_are_dark(t: Trial) -> None:
    """A ball under the floor, a spot that points away, a sun from below.

    Exactly 0.
    """
    for light in (
        sphere([0, 0, -3], 1, BLACK, 5),
        {"type": "spot", "to_world": look([0, 0, 3], [0, 0, 9]), "intensity": rgb(5)},
        {"type": "directional", "direction": np.array([0, 0.1, 1.0]), "irradiance": rgb(5)},
        {"type": "point", "position": np.array([0, 1, -1.0]), "intensity": rgb(5)},
    ):
        t.agrees(scene(EYE, FLOOR, light), 0.0, 10_000, sees=1.0)


@case(3)
def lamp_that_is_a_cube(t: Trial) -> None:
    """An emitting cube over the floor.

    Irradiance by Lambert's sum over the face that looks down; the sides are not visible from here.
    """
    lamp = {**cuboid([-0.5, -0.4, 1], [0.6, 0.7, 2], BLACK), "emitter": area(2)}
    below = [[-0.5, -0.4, 1], [0.6, -0.4, 1], [0.6, 0.7, 1], [-0.5, 0.7, 1]]
    exact = 0.5 * 2 * lambert([0, 0, 0], [0, 0, 1], below)
    t.agrees(scene(EYE, FLOOR, lamp), exact, 800_000, sees=0.01)


@case(3)
def cube_aside(t: Trial) -> None:
    """An emitting cube beside the point, three of its faces in view.

    Lambert's sum over the three, which do not hide each other. Sees 0.5 %.
    """
    lo, hi = np.array([0.8, -1.4, 0.5]), np.array([1.6, -0.5, 1.3])
    lamp = {**cuboid(lo, hi, BLACK), "emitter": area(2)}
    x, y, z = (lo[0], hi[0]), (lo[1], hi[1]), (lo[2], hi[2])
    faces = [
        [[x[a], y[b], z[0]] for a, b in ((0, 0), (1, 0), (1, 1), (0, 1))],
        [[x[0], y[a], z[b]] for a, b in ((0, 0), (1, 0), (1, 1), (0, 1))],
        [[x[a], y[1], z[b]] for a, b in ((0, 0), (1, 0), (1, 1), (0, 1))],
    ]
    up = [0.0, 0, 1]
    form = [lambert([0, 0, 0], up, face) for face in faces]
    # the same solid angle as the outline's: Lambert's sum over the six edges of the silhouette
    outline = [[x[0], y[0], z[0]], [x[1], y[0], z[0]], [x[1], y[1], z[0]], [x[1], y[1], z[1]],
               [x[0], y[1], z[1]], [x[0], y[0], z[1]]]  # fmt: skip
    t.check(abs(lambert([0, 0, 0], up, outline) - sum(form)) < 1e-12, "two ways")
    t.agrees(scene(EYE, FLOOR, lamp), 0.5 * 2 * sum(form), 1_600_000, sees=0.005)
