"""The measured Cornell box: its files against each other and the published numbers, and the scene
made from them. Checksums and colours of the data are in level 7 of the validation."""

import importlib.util
import json
from pathlib import Path

import numpy as np
import pytest

from veriray.scene import cornell_box, load_file
from veriray.shipped import find_shipped

FOLDER = find_shipped("cornell-box").parent


@pytest.fixture(scope="module")
def make():
    path = Path(__file__).parents[2] / "scenes" / "cornell" / "make.py"
    spec = importlib.util.spec_from_file_location("cornell_make", path)
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


@pytest.fixture(scope="module")
def geometry():
    return json.loads((FOLDER / "geometry.json").read_text("utf-8"))


@pytest.fixture(scope="module")
def box():
    return cornell_box()


def shape(scene, name):
    return scene.vertices[scene.triangles[scene.triangle_shape == scene.shape_names.index(name)]]


def area_vectors(triangles):
    return 0.5 * np.cross(triangles[:, 1] - triangles[:, 0], triangles[:, 2] - triangles[:, 0])


def leaves(value, path=""):
    if isinstance(value, dict):
        for key, item in value.items():
            yield from leaves(item, f"{path}/{key}")
    else:
        yield path, np.array(value)


def test_spectra(make):
    table = make.read_table("reflectance.csv")
    assert table["wavelength_nm"].tolist() == list(range(400, 701, 4))
    for paint in make.PAINTS:
        assert len(table[paint]) == 76 and ((table[paint] > 0) & (table[paint] < 1)).all()
    assert [table[paint][0] for paint in make.PAINTS] == [0.343, 0.092, 0.04]
    assert [table[paint][-1] for paint in make.PAINTS] == [0.737, 0.159, 0.642]
    light = make.read_table("emission.csv")
    assert light["wavelength_nm"].tolist() == [400, 500, 600, 700]
    assert light["emission"].tolist() == [0, 8, 15.6, 18.4]


def test_colours_reproduce_the_recorded_ones(make):
    pytest.importorskip("colour", reason="colour-science has the CIE 1931 functions")
    recorded = dict(leaves(json.loads((FOLDER / "derived_rgb.json").read_text("utf-8"))["values"]))
    count = 0
    for path, value in leaves(make.derive()):
        assert np.abs(value - recorded[path]).max() < 1e-4, path
        count += value.size
    assert count == 2 * 5 * 6 + 5 * 3 + 6


def test_made_files_are_up_to_date(make):
    pytest.importorskip("colour", reason="colour-science has the CIE 1931 functions")
    for name, text in make.make().items():
        assert (FOLDER / name).read_text(encoding="utf-8") == text, name


def test_box_holds_the_recorded_colours(box):
    values = json.loads((FOLDER / "derived_rgb.json").read_text("utf-8"))["values"]
    paints = {
        name: np.array(values["measured_light"][name]["rgb_over_light_rgb"])
        for name in ("white", "green", "red")
    }
    used = {"floor": "white", "right_wall": "green", "left_wall": "red", "tall_block_top": "white"}
    for name, paint in used.items():
        material = box.triangle_material[box.triangle_shape == box.shape_names.index(name)]
        assert np.abs(box.reflectance[material] - paints[paint]).max() < 1e-6
    lamp = box.triangle_shape == box.shape_names.index("light")
    assert (box.reflectance[box.triangle_material[lamp]] == np.float32(0.78)).all()
    assert ((box.triangle_emission >= 0) == lamp).all() and len(box.emissions) == 1
    assert np.abs(box.emissions[0] - values["light_emission"]["rgb_over_ybar"]).max() < 1e-5
    assert not box.two_sided.any() and not box.environment.any()


def test_box_has_the_measured_corners_bit_for_bit(box, make, geometry):
    quads = {
        q["name"]: np.array(q["vertices"]) for q in geometry["quads"] if q["name"] != "ceiling"
    }
    assert len(quads) == 15
    for name, corners in quads.items():
        assert (shape(box, name) == corners[[[0, 1, 2], [0, 2, 3]]]).all(), name
    for name, (_, corners) in make.rectangles(geometry).items():
        assert (shape(box, name) == corners[[[0, 1, 2], [0, 2, 3]]]).all(), name


def test_every_surface_faces_the_room(box, geometry):
    for quad in geometry["quads"]:
        if quad["name"] == "ceiling":
            continue
        vector = area_vectors(shape(box, quad["name"])).sum(axis=0)
        normal = np.array(quad["listed_winding_normal"])
        # the listed normal of the left wall, which is not flat, is that of its first triangle
        assert vector @ normal / np.linalg.norm(vector) > 1 - 2e-5, quad["name"]
        area = np.linalg.norm(area_vectors(shape(box, quad["name"])), axis=1).sum()
        assert area == pytest.approx(quad["area_mm2"], rel=1e-7)


def test_ceiling_leaves_the_opening_of_the_lamp_free(box):
    pieces = np.concatenate(
        [shape(box, f"ceiling_{n}") for n in ("front", "back", "left", "right")]
    )
    light = shape(box, "light")
    assert (pieces[..., 1] == 548.8).all() and (light[..., 1] == 548.8).all()
    vectors = area_vectors(pieces)
    assert (vectors[:, 1] < 0).all() and (vectors[:, [0, 2]] == 0).all()
    assert -vectors[:, 1].sum() == pytest.approx(556.0 * 559.2 - 130.0 * 105.0, rel=1e-14)
    x, z = np.random.default_rng(1).uniform((0, 0), (556.0, 559.2), (4000, 2)).T
    covered = np.stack([inside(t, x, z) for t in pieces]).sum(axis=0)
    lit = np.stack([inside(t, x, z) for t in light]).sum(axis=0)
    assert (covered + lit == 1).all(), "each point of the ceiling's plane is on one surface"
    assert lit.mean() == pytest.approx(130 * 105 / (556 * 559.2), abs=0.01)


def inside(triangle, x, z):
    """Whether points of the plane of constant y are in a triangle."""
    corners = triangle[:, ::2]
    sides = []
    for a, b in zip(corners, np.roll(corners, -1, axis=0), strict=True):
        sides.append((b[0] - a[0]) * (z - a[1]) - (b[1] - a[1]) * (x - a[0]) > 0)
    return np.all(sides, axis=0) | ~np.any(sides, axis=0)


def test_left_wall_is_split_as_documented(box):
    wall = shape(box, "left_wall")
    assert wall[0].tolist() == [[552.8, 0, 0], [549.6, 0, 559.2], [556, 548.8, 559.2]]
    assert wall[1].tolist() == [[552.8, 0, 0], [556, 548.8, 559.2], [556, 548.8, 0]]
    n = area_vectors(wall)
    n /= np.linalg.norm(n, axis=1, keepdims=True)
    assert 1e-3 < np.linalg.norm(n[0] - n[1]) < 0.02


def test_camera(box):
    data = json.loads((FOLDER / "camera.json").read_text("utf-8"))
    to_world = box.camera.to_world
    assert to_world[:3, 3].tolist() == data["position_mm"]
    assert to_world[:3, 2].tolist() == data["direction"]
    assert to_world[:3, 1].tolist() == data["up"]
    assert (-to_world[:3, 0]).tolist() == data["derived"]["screen_right"], "+x is on the left"
    tangent = box.camera.tan_half_x(512, 512)
    assert tangent == box.camera.tan_half_y(512, 512)
    assert tangent == pytest.approx(data["film_width_m"] / 2 / data["focal_length_m"], rel=1e-14)
    assert box.camera.fov == pytest.approx(data["derived"]["fov_degrees"], abs=1e-9)
    corners = {
        "front_left_floor": shape(box, "floor")[0, 0],
        "front_right_ceiling": shape(box, "right_wall")[1, 1],
        "back_left_floor": shape(box, "back_wall")[0, 0],
        "light_corner_2": shape(box, "light")[0, 2],
        "short_block_top_0": shape(box, "short_block_top")[0, 0],
    }
    if not (corners["front_right_ceiling"] == [0, 548.8, 0]).all():
        corners["front_right_ceiling"] = np.array([0, 548.8, 0])
    for name, corner in corners.items():
        x, y, z = np.linalg.inv(to_world)[:3] @ np.append(corner, 1.0)
        seen = [-x / z / tangent, y / z / tangent]
        assert seen == pytest.approx(data["derived"]["projected_ndc"]["points"][name], abs=1e-6)


def test_settings(box):
    assert (box.film.width, box.film.height, box.film.filter) == (512, 512, "box")
    assert (box.max_depth, box.rr_depth, box.spp) == (-1, 5, 64)
    small = load_file("cornell-box", dict(spp=1, width=8, height=4, max_depth=2, rr_depth=9))
    assert (small.film.width, small.film.height) == (8, 4)
    assert (small.max_depth, small.rr_depth, small.spp) == (2, 9, 1)


def test_nothing_stands_between_lamp_and_floor(box):
    """Rays straight down from the lamp meet nothing before the blocks (330 mm) or the floor."""
    x, z = np.random.default_rng(2).uniform((213.1, 227.1), (342.9, 331.9), (500, 2)).T
    for index, triangle in enumerate(box.vertices[box.triangles]):
        name = box.shape_names[box.triangle_shape[index]]
        flat = np.ptp(triangle[:, 1]) == 0
        if flat and name != "light" and inside(triangle, x, z).any():
            assert triangle[0, 1] <= 330, name


def test_open_scene_is_open():
    scene = load_file("open")
    assert scene.environment.min() > 0 and len(scene.emissions) == 1
    lamp = shape(scene, "lamp")
    assert (area_vectors(lamp)[:, 1] < 0).all(), "the lamp shines down"
    assert scene.vertices[:, 1].min() == 0, "nothing is below the ground"
