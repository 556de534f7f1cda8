"""Cameras made and moved: tested by where points appear on the film.

A point's place on the film follows from Camera's definition; other programs' conventions are
written out here with their own formulas.
"""

import dataclasses
import math

import numpy as np
import pytest

from veriray.camera import Camera, Film
from veriray.errors import SceneError

LENS = {"aperture_radius": 0.1, "focus_distance": 3.0, "near_clip": 0.2}


def film_position(camera, point, width=40, height=30):
    """(u, v) in [0, 1] from the top left, and the distance along the view."""
    x, y, z, _ = np.linalg.inv(camera.to_world) @ [*point, 1.0]
    ends = camera.tan_half_x(width, height), camera.tan_half_y(width, height)
    return [
        0.5 * (1 - c / (z * tangent)) - offset
        for c, tangent, offset in zip((x, y), ends, camera.principal_point_offset, strict=True)
    ] + [z]


def rotation(seed):
    q, r = np.linalg.qr(np.random.default_rng(seed).normal(size=(3, 3)))
    q = q * np.sign(np.diag(r))
    return q * np.sign(np.linalg.det(q))


def test_look_at():
    camera = Camera.look_at((1, 2, 3), (1, 2, -7), fov=50, **LENS)
    assert camera.fov == 50 and camera.aperture_radius == 0.1
    assert film_position(camera, (1, 2, -7)) == pytest.approx([0.5, 0.5, 10])
    u, v, _ = film_position(camera, (2, 3, -7))  # looking along -z, +x is on the right
    assert u > 0.5 and v < 0.5
    for bad in (((1, 2, 3), (1, 2, 3)), ((0, 0, 0), (0, 5, 0)), ((0, 0), (1, 1, 1))):
        with pytest.raises(SceneError):
            Camera.look_at(*bad)
    with pytest.raises(SceneError, match=r"target\[1\] is nan"):
        Camera.look_at((0, 0, 0), (1, math.nan, 1))


def test_looking_at_keeps_the_lens():
    camera = Camera.look_at((1, 2, 3), (0, 0, 0), fov=50, **LENS)
    other = camera.looking_at((4, 4, 4))
    assert film_position(other, (4, 4, 4))[:2] == pytest.approx([0.5, 0.5])
    assert other.to_world[:3, 3].tolist() == [1, 2, 3]
    moved = camera.looking_at((4, 4, 4), origin=(0, 1, 0))
    assert moved.to_world[:3, 3].tolist() == [0, 1, 0]
    for changed in (other, moved, camera.dolly(1), camera.orbit(10)):
        assert changed is not camera
        for field in dataclasses.fields(Camera):
            if field.name not in ("to_world", "principal_point_offset", "patches"):
                assert getattr(changed, field.name) == getattr(camera, field.name), field.name


def test_dolly():
    camera = Camera.look_at((0, 0, 5), (0, 0, 0)).dolly(2)
    assert camera.to_world[:3, 3].tolist() == [0, 0, 3]
    assert camera.dolly(-2).to_world[:3, 3].tolist() == [0, 0, 5]


def test_orbit():
    camera = Camera.look_at((0, 0, 5), (0, 0, 0), fov=30)
    east = camera.orbit(90)
    assert east.to_world[:3, 3] == pytest.approx([5, 0, 0])
    assert film_position(east, (0, 0, 0)) == pytest.approx([0.5, 0.5, 5])
    top = camera.orbit(0, 90)
    assert top.to_world[:3, 3] == pytest.approx([0, 5, 0])
    assert camera.orbit(0, 30).to_world[1, 3] == pytest.approx(2.5)
    assert camera.orbit(40, 20).to_world[1, 3] == pytest.approx(5 * math.sin(math.radians(20)))
    around = camera.orbit(25, 15, centre=(1, 1, 1), up=(0, 0, 2))
    for point in ((1, 1, 1),):
        assert film_position(around, point) == pytest.approx(film_position(camera, point))
    assert top.orbit(0, 10).to_world[1, 3] == pytest.approx(5 * math.cos(math.radians(10)))
    back = camera
    for _ in range(12):
        back = back.orbit(30)
    assert np.abs(back.to_world - camera.to_world).max() < 1e-14
    with pytest.raises(SceneError, match="up has length 0"):
        camera.orbit(1, up=(0, 0, 0))
    with pytest.raises(SceneError, match="azimuth = nan"):
        camera.orbit(math.nan)


def test_from_opengl():
    matrix = np.eye(4)
    matrix[:3, :3], matrix[:3, 3] = rotation(1), (1, 2, 3)
    camera = Camera.from_opengl(matrix, 50, **LENS)
    x, y, z = local = (0.3, -0.2, -2.0)  # right, below, in front
    u, v, depth = film_position(camera, (matrix @ [*local, 1])[:3])
    tangent = math.tan(math.radians(25))
    assert depth == pytest.approx(2)
    assert u == pytest.approx(0.5 * (1 + x / -z / tangent))
    assert v == pytest.approx(0.5 * (1 - y / -z / (tangent * 0.75)))


def test_from_opencv():
    R, t, f, cx, cy = rotation(2), np.array([0.1, -0.2, 4.0]), 35.0, 18.0, 16.5
    K = [[f, 0, cx], [0, f, cy], [0, 0, 1]]
    camera = Camera.from_opencv(K, R, t, width=40, height=30, **LENS)
    point = np.array([0.3, -0.4, 0.5])
    x, y, z = R @ point + t
    pixel = f * x / z + cx, f * y / z + cy  # 0 is the middle of the first pixel
    u, v, depth = film_position(camera, point)
    assert (u, v) == pytest.approx(((pixel[0] + 0.5) / 40, (pixel[1] + 0.5) / 30))
    assert depth == pytest.approx(z)
    matrix = np.eye(4)
    matrix[:3, :3], matrix[:3, 3] = R, t
    same = Camera.from_opencv(K, matrix=matrix, width=40, height=30)
    assert (same.to_world == camera.to_world).all()
    centred = Camera.from_opencv([[f, 0, 19.5], [0, f, 14.5], [0, 0, 1]], R, t, width=40, height=30)
    assert centred.principal_point_offset.tolist() == [0, 0]


@pytest.mark.parametrize(
    ("change", "fragment"),
    [
        ({"K": [[35, 1, 20], [0, 35, 15], [0, 0, 1]]}, "expected [[f, 0, cx], [0, f, cy]"),
        ({"K": [[35, 0, 20], [0, 36, 15], [0, 0, 1]]}, "pixels must be square"),
        ({"K": [[-35, 0, 20], [0, -35, 15], [0, 0, 1]]}, "expected [[f, 0, cx]"),
        ({"K": np.eye(4)}, "K has shape (4, 4), expected (3, 3)"),
        ({"R": 2 * np.eye(3)}, "is not a rotation"),
        ({"R": np.diag([1, 1, -1])}, "is not a rotation"),
        ({"R": [[1, 0.5, 0], [0, 0.866, 0], [0, 0, 1]]}, "is not a rotation"),
        ({"R": None}, "give either R and t or matrix"),
        ({"matrix": np.eye(4)}, "give either R and t or matrix"),
        ({"width": 0}, "width = 0 is outside"),
        ({"t": [0, math.inf, 0]}, "t[1] is inf"),
    ],
)
def test_bad_opencv_cameras(change, fragment):
    good = {"K": [[35, 0, 20], [0, 35, 15], [0, 0, 1]], "R": np.eye(3), "t": [0, 0, 1]}
    with pytest.raises(SceneError) as caught:
        Camera.from_opencv(**{**good, "width": 40, "height": 30, **change})
    assert fragment in str(caught.value)


def test_film_of_the_mitchell_filter():
    third = 1 / 3
    assert Film(4, 4, "mitchell").filter_parameters == (third, third)
    assert Film(4, 4, "mitchell", (0, 0.5)).filter_parameter == (0.0, 0.5)
    assert Film(4, 4, "gaussian", 0.4).filter_parameters == (0.4, 0.0)
    assert Film(4, 4, "lanczos").filter_parameters == (3.0, 0.0)
    for lobes in (0, 2.5, 17):
        with pytest.raises(SceneError, match="filter_parameter"):
            Film(4, 4, "lanczos", lobes)
    for bad in ((0, 1.5), 0.3, (1, 2, 3), (0, math.nan)):
        with pytest.raises(SceneError, match="filter_parameter"):
            Film(4, 4, "mitchell", bad)
    with pytest.raises(SceneError, match="filter_parameter"):
        Film(4, 4, "tent", (1.0, 1.0))


def test_orthographic():
    """Parallel rays; moved and turned with their scales."""
    camera = Camera.orthographic(np.diag([2.0, 3.0, 0.5, 1.0]), near_clip=2.0, far_clip=5.0)
    assert camera.tan_half_x(40, 30) == 2 and camera.tan_half_y(40, 30) == 3 * 30 / 40
    assert camera.clip_depths == (1.0, 4.0)
    assert camera.placed.tolist() == np.eye(4).tolist()
    moved = camera.dolly(2.0)
    assert moved.to_world[:3, 3].tolist() == [0, 0, 2] and moved.clip_depths == (1.0, 4.0)
    turned = camera.looking_at((9, 0, 0))
    assert turned.placed[:3, 2] == pytest.approx([1, 0, 0])
    assert [turned.tan_half_x(1, 1), turned.tan_half_y(1, 1)] == pytest.approx([2, 3])
    assert camera.orbit(30, 20).clip_depths == pytest.approx((1.0, 4.0))
    with pytest.raises(SceneError, match="shears"):
        Camera.orthographic(np.eye(4) + np.eye(4, k=1) * [0, 1, 0, 0])
    with pytest.raises(SceneError, match=r"aperture_radius = 0.1 of an orthographic"):
        Camera.orthographic(np.eye(4), aperture_radius=0.1)
    with pytest.raises(SceneError, match="projection"):
        Camera(np.eye(4), 40, projection="fisheye")
