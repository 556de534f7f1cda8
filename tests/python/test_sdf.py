"""Grids of signed distances: the mesh of their surface, its normals; against Mitsuba."""

import struct

import numpy as np
import pytest
import trimesh

from tests.python.test_curves import hits
from veriray.errors import SceneError, SceneWarning
from veriray.formats import sdf
from veriray.scene import load_dict

SIDE = 20
Z, Y, X = np.meshgrid(*[np.linspace(0, 1, SIDE)] * 3, indexing="ij")
TORUS = np.hypot(np.hypot(X - 0.5, Y - 0.5) - 0.28, Z - 0.5) - 0.13
PLANE = 0.3 * X + 0.5 * Y + 0.2 * Z - 0.45
WAVY = np.sqrt((X - 0.5) ** 2 + (Y - 0.5) ** 2 + (Z - 0.5) ** 2) - 0.3
WAVY = WAVY + np.random.default_rng(5).normal(size=WAVY.shape) * 0.02


def scene(**values):
    return load_dict({
        "type": "scene", "sensor": {"type": "perspective", "fov": 40.0},
        "sky": {"type": "constant"}, "s": {"type": "sdfgrid", **values},
    })  # fmt: skip


def vol(path, grid, channels=1):
    z, y, x = grid.shape
    head = struct.pack("<3sB5i6f", b"VOL", 3, 1, x, y, z, channels, 0, 0, 0, 1, 1, 1)
    path.write_bytes(head + np.repeat(grid[..., None], channels, 3).astype("<f4").tobytes())
    return path


def fronts(found):
    a, b, c = (found.vertices[found.triangles[:, k]] for k in range(3))
    return mesh_unit(np.cross(b - a, c - a))


def mesh_unit(v):
    return v / np.linalg.norm(v, axis=1)[:, None]


@pytest.mark.parametrize("normals", ["smooth", "analytic"])
def test_a_plane_is_exact(normals):
    """On a grid with different sides, where x and z exchanged would be seen."""
    found = scene(grid=PLANE[::3, :10, :, None].astype(np.float32), normals=normals)
    points = found.vertices
    last = np.array([1.0, 9 / 19, 18 / 19])  # of x, y and z
    off = points * last @ [0.3, 0.5, 0.2] - 0.45
    assert np.abs(off).max() < 1e-6
    assert points.min() >= 0 and points.max() == 1.0
    outward = mesh_unit((last * [0.3, 0.5, 0.2])[None])[0]
    assert (fronts(found) @ outward).min() > 0.999
    if normals == "analytic":
        assert not found.normals.any()  # flat
    else:  # at the upper ends Mitsuba's lean towards the other axes
        inner = (points * (np.array([20, 10, 7]) - 1) < np.array([20, 10, 7]) - 1.5).all(axis=1)
        assert inner.mean() > 0.6 and (found.normals[inner] @ outward).min() > 1 - 1e-9


def test_the_mesh_is_as_near_as_stated(tmp_path):
    found = scene(filename=vol(tmp_path / "a.vol", TORUS))
    assert any("within 0.0" in note for note in found.notes)
    whole = trimesh.Trimesh(found.vertices, found.triangles)
    assert whole.is_watertight and whole.volume > 0
    assert whole.volume == pytest.approx(2 * np.pi**2 * 0.28 * 0.13**2, rel=0.03)  # of the grid's
    at = np.hypot(np.hypot(*(found.vertices[:, :2] - 0.5).T) - 0.28, found.vertices[:, 2] - 0.5)
    assert np.abs(at - 0.13).max() < 0.1 / SIDE  # the function is not the grid's
    numbers = TORUS.astype(np.float32).astype(np.float64).T
    assert np.abs(sdf._function(numbers, found.vertices * (SIDE - 1))).max() < 1e-9
    assert sdf._error(numbers, found.vertices * (SIDE - 1), found.triangles) < sdf.NEAR
    grid = scene(grid=TORUS[..., None])
    assert (grid.vertices == found.vertices).all() and (grid.normals == found.normals).all()


@pytest.fixture(scope="module")
def mi():
    mitsuba = pytest.importorskip("mitsuba", reason="the peer renderer: pip install mitsuba")
    mitsuba.set_variant("scalar_rgb")
    return mitsuba


@pytest.mark.parametrize("normals", ["smooth", "analytic"])
@pytest.mark.parametrize("grid", [TORUS, WAVY], ids=["torus", "wavy"])
def test_grids_are_mitsubas(mi, tmp_path, normals, grid):
    path = vol(tmp_path / "a.vol", grid)
    matrix = np.diag([2.0, 1.5, 3.0, 1.0])
    matrix[:3, 3] = -0.5, -0.7, -1.5
    shape = {"type": "sdfgrid", "normals": normals}
    ours = scene(**shape, filename=path, to_world=matrix)
    shape |= {"filename": str(path), "to_world": mi.ScalarTransform4f(matrix)}
    del shape["type"]
    lengths, other, rays, faces, share, found = hits(mi, ours, {"type": "sdfgrid", **shape}, 2000)
    assert len(rays) > 300
    assert (np.isfinite(lengths) == np.isfinite(other)).mean() > 0.998
    assert np.quantile(np.abs(lengths[rays] - other[rays]), 0.98) < 3e-3
    near = np.abs(lengths[rays] - other[rays]) < 0.02
    ends = (ours.normals[ours.triangles[faces]] * share[:, :, None]).sum(axis=1)
    cosines = (mesh_unit(ends) * [np.array(hit.sh_frame.n) for hit in found]).sum(axis=1)
    worst = 0.9999 if grid is TORUS else 0.998
    assert np.quantile(cosines[near], 0.02) > worst


def test_smooth_normals_differ_from_analytic():
    smooth, sharp = (scene(grid=WAVY[..., None], normals=n) for n in ("smooth", "analytic"))
    assert len(smooth.triangles) == len(sharp.triangles)
    assert len(sharp.vertices) > len(smooth.vertices)


def test_a_grid_without_surface(tmp_path):
    for grid in (np.ones((2, 2, 2, 1)), -np.ones((3, 2, 4, 1)), np.zeros((2, 2, 2, 1))):
        with pytest.warns(SceneWarning, match="the function is nowhere 0: nothing is shown"):
            found = scene(grid=grid)
        assert not len(found.triangles)


@pytest.mark.parametrize(
    ("values", "message"),
    [
        ({}, "no grid given; expected filename or grid"),
        ({"grid": np.ones((2, 2, 2, 1)), "filename": "a"}, "filename and grid given"),
        ({"grid": np.ones((2, 1, 2, 1))}, "2 x 1 x 2 cells of 1 numbers; expected 2 cells"),
        ({"grid": np.ones((2, 2, 2, 3))}, "2 x 2 x 2 cells of 3 numbers"),
        ({"grid": np.ones((2, 2))}, "expected numbers"),
        ({"grid": np.full((2, 2, 2), np.nan)}, "must be finite"),
        ({"filename": "no.vol"}, "cannot read"),
        ({"grid": np.ones((2, 2, 2)), "normals": "flat"}, '"normals" = "flat" is not supported'),
    ],
)
def test_bad_grids(values, message):
    with pytest.raises(SceneError, match=message):
        scene(**values)
