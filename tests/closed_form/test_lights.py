"""Lights against closed forms (A3, A8, A9, A16, A20, A21) and their selection.

Rules as in test_analytic: false-alarm rate 1e-3, confirmed at 1e-4; `sees` is the relative bias
found with 90 % power.
"""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import pytest

from tests.closed_form.build import (
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
from tests.support import FAST, agrees, lambert

pytestmark = pytest.mark.parametrize("device", FAST)
FLOOR = flat("rectangle", [0, 0, 0], [0, 0, 1], 30, diffuse(0.5))
EYE = view([-3, 0.2, 1], [0, 0, 0])


def cap(theta: float, alpha: float) -> float:
    """Irradiance over radiance of a cone of half angle alpha, its axis theta off the normal."""
    x, w = np.polynomial.legendre.leggauss(200)
    c = 1 - (1 - math.cos(alpha)) * (x + 1) / 2  # cosines within the cone
    phi = (np.arange(400) + 0.5) / 400 * math.pi
    up = c[:, None] * math.cos(theta) + np.sqrt(1 - c * c)[:, None] * math.sin(theta) * np.cos(phi)
    return float((w @ np.maximum(up, 0)).mean() * (1 - math.cos(alpha)) * math.pi)


# ---- spheres and disks that shine ----


@pytest.mark.parametrize(
    ("radius", "distance", "angle"),
    [(0.5, 2, 0), (0.5, 2, 60), (0.5, 2, 85), (0.01, 10, 30), (0.99, 1, 0), (2, 2.1, 80)],
)
def test_a9_sphere_light(device: str, radius: float, distance: float, angle: float) -> None:
    """rho L (R / d)^2 cos above the horizon; by quadrature where the ball dips below it."""
    exact = cap(math.radians(angle), math.asin(radius / distance)) / math.pi
    if radius / distance < math.cos(math.radians(angle)):
        assert abs(exact / (radius / distance) ** 2 / math.cos(math.radians(angle)) - 1) < 1e-5
    if angle == 0 and distance == 2:
        assert abs(math.pi * exact - 0.196350) < 1e-6
    ball = sphere(distance * direction(angle), radius, BLACK, [1, 2, 10])
    # Where the ball is close the camera looks from below its side, past it.
    eye = view([-0.5, 0.02, 0.02], [0, 0, 0])
    seen = scene(eye, FLOOR, ball)
    agrees(seen, 0.5 * exact * np.array([1, 2, 10]), device, 800_000, sees=0.01, margin=3e-5)


def test_a9_far_and_tiny(device: str) -> None:
    """A ball of radius 1e-3 at distance 1,000: 3e-12 sr, and no noise to speak of."""
    ball = sphere(1000 * direction(20), 1e-3, BLACK, 1e9)
    exact = 0.5 * 1e9 * 1e-12 * math.cos(math.radians(20))
    agrees(scene(EYE, FLOOR, ball, max_depth=2), exact, device, 100_000, sees=1e-3, margin=1e-4)


def test_inside_a_shining_sphere(device: str) -> None:
    """Turned inside out: a furnace, E / (1 - rho), where every point sees all of it."""
    room = {**sphere([1, 2, 3], 2, diffuse([0.5, 0.2, 0.8]), [0.5, 1, 0.1]), "flip_normals": True}
    exact = np.array([0.5, 1, 0.1]) / (1 - np.float32([0.5, 0.2, 0.8]).astype(float))
    agrees(scene(view([1.5, 2, 3], [2, 2.2, 3.5], 60), room), exact, device, 800_000, sees=0.01)


@pytest.mark.parametrize("angle", [0, 50])
def test_a8_disk_light(device: str, angle: float) -> None:
    """On the axis pi L R^2 / (R^2 + h^2); on a plane tilted against the axis times the cosine."""
    normal = direction(angle)
    assert abs(math.pi * 0.5 - 1.570796) < 1e-6
    lamp = flat("disk", normal, -normal, 1, BLACK, 1)
    if angle == 0:
        exact = 0.5 * 0.5
        agrees(scene(EYE, FLOOR, lamp), exact, device, 800_000, sees=0.005)
    lamp = flat("disk", 3 * normal, -normal, 1, BLACK, [1, 5, 0.1])
    exact = 0.5 * 0.1 * math.cos(math.radians(angle))  # all of it is above the horizon
    agrees(scene(EYE, FLOOR, lamp), exact * np.array([1, 5, 0.1]), device, 800_000, sees=0.005)


def test_elliptic_disk_light(device: str) -> None:
    """Half axes 1.5 and 0.4 at height 1, by quadrature; and seen edge by edge: its solid area."""
    x, w = np.polynomial.legendre.leggauss(80)
    r, wr = (x + 1) / 2, w / 2
    phi = (np.arange(400) + 0.5) / 400 * 2 * math.pi
    d2 = 1 + (1.5 * r[:, None] * np.cos(phi)) ** 2 + (0.4 * r[:, None] * np.sin(phi)) ** 2
    exact = 0.5 / math.pi * 1.5 * 0.4 * float((wr * r) @ (1 / d2**2).mean(axis=1)) * 2 * math.pi
    lamp = flat("disk", [0, 0, 1], [0, 0, -1], [1.5, 0.4], BLACK, 1)
    agrees(scene(EYE, FLOOR, lamp), exact, device, 800_000, sees=0.005)
    fov = 2 * math.degrees(math.atan(2 / 5))
    front = scene(view([0, 0, -4], [0, 0, 1], fov), lamp)
    agrees(front, math.pi * 1.5 * 0.4 / 16, device, 800_000, sees=0.02)


def test_a16_concentric_spheres(device: str) -> None:
    """Radii 1 and 2, albedos .3 and .6, inner exitance 1: B1 = 1.089109, B2 = .297030."""
    outer_b = 0.6 * 0.25 / (1 - 0.6 * 0.75 - 0.6 * 0.25 * 0.3)
    inner_b = 1 + 0.3 * outer_b
    assert abs(inner_b - 1.089109) < 1e-6 and abs(outer_b - 0.297030) < 1e-6
    inner = sphere([0, 0, 0], 1, diffuse(0.3), 1 / math.pi)
    outer = {**sphere([0, 0, 0], 2, diffuse(0.6)), "flip_normals": True}
    for target, exact in (([0, 0, 0], inner_b), ([0, 1.5, 2], outer_b)):
        seen = scene(view([0, 0, 1.5], target), inner, outer)
        agrees(seen, exact / math.pi, device, 800_000, sees=0.01)


# ---- lights without a surface ----


def test_a3_point_light_in_a_sphere(device: str) -> None:
    """rho I / (pi R^2 (1 - rho)) with R = 2: .25; a light of 1 / r would give another number."""
    room = {**sphere([0, 0, 0], 2, diffuse(0.5)), "flip_normals": True}
    light = {"type": "point", "position": np.zeros(3), "intensity": rgb(math.pi)}
    agrees(scene(view([1, 0, 0], [0, 1, 1.5]), room, light), 0.25, device, 800_000, sees=0.01)


TILT = direction(30)
PLATE = flat("rectangle", [0, 0, 0], TILT, 1, diffuse(0.5))


def falloff(angle: float, cutoff: float, beam: float) -> float:
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


@pytest.mark.parametrize("name", LIGHTS)
def test_a20_lights_on_a_tilted_plane(device: str, name: str) -> None:
    """I cos / d^2 rho / pi, E cos rho / pi; a spot's falloff is linear in the angle. No noise."""
    light, strength = LIGHTS[name]
    exact = 0.5 / math.pi * math.cos(math.radians(50)) * strength * np.array([1, 2, 5])
    seen = scene(view([-0.5, 0.3, 3], [0, 0, 0]), PLATE, light, max_depth=2)
    # The last degree of the falloff: 20 times the rounding of the angle.
    margin = 1e-3 if name == "spot at 29" else 3e-5
    agrees(seen, exact, device, 10_000, sees=2 * margin, margin=margin)


@pytest.mark.parametrize("angle", [0, 45, 90, 135])
def test_a21_phases_of_a_ball(device: str, angle: float) -> None:
    """A Lambert ball in parallel light: [sin a + (pi - a) cos a] / pi of its full brightness."""
    a = math.radians(angle)
    phase = (math.sin(a) + (math.pi - a) * math.cos(a)) / math.pi
    assert abs(phase - {0: 1, 45: 0.755409, 90: 0.318310, 135: 0.048302}[angle]) < 1e-6
    distance, half = 3000.0, 1.05
    ball = sphere([0, 0, 0], 1, diffuse(0.8))
    light = {"type": "directional", "direction": -direction(angle), "irradiance": rgb(math.pi)}
    fov = 2 * math.degrees(math.atan(half / distance))
    exact = 2 / 3 * 0.8 * phase * math.pi / (2 * half) ** 2
    far = scene(view([0, 0, distance], [0, 0, 0], fov), ball, light)
    agrees(far, exact, device, 800_000, sees=0.02, margin=1e-4)


def test_shadow_of_a_ball(device: str) -> None:
    """In a point light's shadow nothing arrives, to the bit; at its rim the light is whole."""
    light = {"type": "point", "position": np.array([0, 0, 4.0]), "intensity": rgb(16)}
    ball = sphere([0, 0, 2], 1, BLACK)
    rim = 4 / math.sqrt(3)  # the tangent cone's radius on the floor
    for x, exact in ((rim - 1e-3, 0.0), (rim + 1e-3, 1.0)):
        d2 = x * x + 16
        value = exact * 0.5 / math.pi * 16 * 4 / d2**1.5
        eye = view([x + 3, 0, 1], [x, 0, 0], 1e-3)
        agrees(scene(eye, FLOOR, ball, light), value, device, 10_000, sees=1e-3, margin=1e-4)


# ---- many lights ----


def test_forty_point_lights(device: str) -> None:
    """Chosen one at a time, in proportion to some power: the sum of all of them."""
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
    agrees(seen, exact, device, 800_000, sees=0.02)


def test_a_hundred_lights_of_all_kinds(device: str) -> None:
    """Balls, disks, points, spots and a sun over a floor under a sky: the sum of all of them.

    They stand on a spiral, so that none hides another; balls and disks hide their share of the sky.
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
    # The camera looks straight down along the axis, past all of them.
    eye = view([0, 0, 5], [0, 0, 0])
    seen = scene(eye, FLOOR, *objects, sky(0.4), max_depth=2)
    agrees(seen, exact, device, 1_600_000, sees=0.04)


def test_lights_behind_are_dark(device: str) -> None:
    """A ball under the floor, a spot that looks away, a sun from below: exactly 0."""
    for light in (
        sphere([0, 0, -3], 1, BLACK, 5),
        {"type": "spot", "to_world": look([0, 0, 3], [0, 0, 9]), "intensity": rgb(5)},
        {"type": "directional", "direction": np.array([0, 0.1, 1.0]), "irradiance": rgb(5)},
        {"type": "point", "position": np.array([0, 1, -1.0]), "intensity": rgb(5)},
    ):
        agrees(scene(EYE, FLOOR, light), 0.0, device, 10_000, sees=1.0)


def test_a_lamp_that_is_a_cube(device: str) -> None:
    """Convex and uniform: irradiance by Lambert's sum over the faces that look down and aside."""
    lamp = {**cuboid([-0.5, -0.4, 1], [0.6, 0.7, 2], BLACK), "emitter": area(2)}
    below = [[-0.5, -0.4, 1], [0.6, -0.4, 1], [0.6, 0.7, 1], [-0.5, 0.7, 1]]
    exact = 0.5 * 2 * lambert([0, 0, 0], [0, 0, 1], below)  # the sides are behind it from here
    agrees(scene(EYE, FLOOR, lamp), exact, device, 800_000, sees=0.01)


def test_point_of_view_of_theory(device: str) -> None:
    """The cone integral of this file against (R / d)^2 and, half sunk, half of it and more."""
    assert abs(cap(0.3, 0.2) / math.pi - math.sin(0.2) ** 2 * math.cos(0.3)) < 1e-7
    half: Any = cap(math.pi / 2, 0.5)
    # A cone whose axis lies in the horizon: alpha - sin alpha cos alpha.
    assert abs(half - (0.5 - math.sin(0.5) * math.cos(0.5))) < 1e-5
