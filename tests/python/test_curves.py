"""Linear and B-spline curves: their surface, normals, texture coordinates; against Mitsuba."""

import math

import numpy as np
import pytest

from veriray.errors import SceneError, SceneWarning
from veriray.formats import curves, mesh
from veriray.formats.shapes import IDENTITY
from veriray.scene import load_dict

LINEAR = """-1.0 0.1 0.1 0.1
1.0 1.0 0.3 0.2
1.0 0 1 0.1
0 0.1 1.3 .3

-1 -0.5 1 .2
-1 -0.6 0 .1
1 -1 .5 .05
"""
SPLINE = """-1.0 0.1 0.1 0.1
-.5 1.0 0.3 0.2
.3 0 1 0.1
.6 0.1 -.3 .3
1 1 .5 .2

-2 -0.5 1 .2
-1 -0.6 0 .1
1 -1 .5 .2
2 -.4 .7 .1
"""
SHARE = 1 - math.cos(math.pi / 64)  # by which a prism of 64 sides is thinner


def read(folder, text, kind="linearcurve", matrix=IDENTITY):
    path = folder / "curve.txt"
    path.write_text(text)
    return curves.read(path, kind, matrix, "here")


def scene(folder, text, kind="linearcurve", **values):
    (folder / "curve.txt").write_text(text)
    return load_dict({
        "type": "scene", "sensor": {"type": "perspective", "fov": 40.0},
        "sky": {"type": "constant"},
        "s": {"type": kind, "filename": folder / "curve.txt", **values},
    })  # fmt: skip


def distance(points, text):
    """Signed distance (N,) to the spheres along linear curves, from 4,001 of each segment."""
    result = np.full(len(points), np.inf)
    for curve in text.split("\n\n"):
        rows = np.loadtxt(curve.splitlines())
        for a, b in zip(rows[:-1], rows[1:], strict=True):
            for v in np.linspace(0, 1, 4001):
                c = a + v * (b - a)
                result = np.minimum(result, np.linalg.norm(points - c[:3], axis=1) - c[3])
    return result


def corners(found):
    return found.vertices[found.triangles]


def area(found):
    a, b, c = corners(found).transpose(1, 0, 2)
    return np.linalg.norm(np.cross(b - a, c - a), axis=1).sum() / 2


def test_a_capsule(tmp_path):
    found, sides, count = read(tmp_path, "0 0 0 0.5\n3 0 0 0.5\n")
    assert (sides, count) == (64, 1) and mesh.is_closed(found.vertices, found.triangles)
    exact = 2 * math.pi * 0.5 * 3 + 4 * math.pi * 0.25
    assert -2 * SHARE < area(found) / exact - 1 < -0.2 * SHARE
    a, b, c = corners(found).transpose(1, 0, 2)
    volume = (np.cross(a, b) * c).sum() / 6
    assert volume / (math.pi * 0.25 * 3 + math.pi / 6) - 1 == pytest.approx(0, abs=2 * SHARE)
    assert volume > 0
    middle = np.clip(found.vertices[:, 0], 0, 3)[:, None] * [1, 0, 0]
    assert np.abs(found.vertices - middle - 0.5 * found.normals).max() < 1e-15
    assert np.abs(found.uv[:, 1] - middle[:, 0] / 3).max() < 1e-15


def test_linear_curves_are_as_near_as_stated(tmp_path):
    found, *_ = read(tmp_path, LINEAR)
    assert mesh.is_closed(found.vertices, found.triangles)
    assert np.abs(np.linalg.norm(found.normals, axis=1) - 1).max() < 1e-14
    rng = np.random.default_rng(1)
    some = rng.choice(len(found.vertices), 300, replace=False)
    assert distance(found.vertices[some], LINEAR).max() < 1e-7  # not outside
    some = rng.choice(len(found.triangles), 600, replace=False)
    off = distance(corners(found).mean(axis=1)[some], LINEAR)
    outer = off > -2 * SHARE * 0.3  # others are where segments overlap
    assert 0.75 < outer.mean() < 0.9 and off.max() < 1e-7
    cone = "0 0 0 0.3\n1 1 1 0.1\n"
    found, *_ = read(tmp_path, cone)
    off = distance(corners(found).mean(axis=1)[::5], cone)
    assert len(off) > 300 and off.min() > -2 * SHARE * 0.3 and off.max() < 1e-7


def test_one_sphere_holds_the_next(tmp_path):
    for text in ("0 0 0 1\n0.3 0 0 0.2\n", "0.3 0 0 0.2\n0 0 0 1\n", "0 0 0 1\n0 0 0 1\n"):
        found, *_ = read(tmp_path, text)
        assert mesh.is_closed(found.vertices, found.triangles)
        lengths = np.linalg.norm(found.vertices, axis=1)
        assert lengths.max() < 1 + 1e-15
        outer = lengths > 1 - 1e-12
        assert np.ptp(found.vertices[outer], axis=0) == pytest.approx([2, 2, 2], abs=4 * SHARE)


def test_a_curve_may_turn_back(tmp_path):
    for text in ("0 0 0 .1\n1 0 0 .1\n0 0 0 .1\n", "0 0 0 .1\n1 0 0 .1\n1 0 0 .2\n2 0 0 .1\n"):
        found, *_ = read(tmp_path, text)
        assert np.isfinite(found.normals).all() and mesh.is_closed(found.vertices, found.triangles)
        assert distance(found.vertices, text).max() < 1e-7


def test_splines_are_as_near_as_stated(tmp_path):
    """Middles of faces against the exact tube, by the nearest of its points that are sampled."""
    found, sides, count = read(tmp_path, SPLINE, "bsplinecurve")
    assert (sides, count) == (64, 2)
    rows = np.loadtxt(SPLINE.split("\n\n")[1].splitlines())
    v = np.linspace(0, 1, 4001)[:, None]
    w = 1 - v
    weights = [w**3, 3 * v**3 - 6 * v**2 + 4, 3 * w**3 - 6 * w**2 + 4, v**3]
    line = sum(weight * row for weight, row in zip(weights, rows, strict=True)) / 6
    last = found.uv[:, 1][found.triangles].mean(axis=1) > 2 / 3
    middles = corners(found)[last].mean(axis=1)
    off = [(np.linalg.norm(p - line[:, :3], axis=1) - line[:, 3]).min() for p in middles[::7]]
    assert len(off) > 300 and min(off) > -2 * SHARE * 0.2 and max(off) < 0.5 * SHARE * 0.2


def test_many_curves_have_fewer_sides(tmp_path, monkeypatch):
    for few, sides in ((20_000, 64), (6_000, 32), (2_500, 16), (10, 8)):
        monkeypatch.setattr(curves, "FEW", few)
        for kind, text in (("linearcurve", LINEAR), ("bsplinecurve", SPLINE)):
            found, used, _ = read(tmp_path, text, kind)
            assert used <= sides and (used == 8 or len(found.triangles) <= few)
    assert used == 8
    monkeypatch.setattr(curves, "MANY", 100)
    with pytest.raises(SceneError, match="2 curves of 8 sides are .* triangles; at most 100"):
        read(tmp_path, LINEAR)
    with pytest.raises(SceneError, match="2 curves of 8 sides are .* triangles; at most 100"):
        read(tmp_path, SPLINE, "bsplinecurve")


def test_to_world_leaves_the_radii(tmp_path):
    matrix = np.diag([4.0, -3.0, 2.0, 1.0])
    plain = scene(tmp_path, "0 0 0 1\n4 0 0 1\n")
    moved = scene(tmp_path, "0 0 0 1\n1 0 0 1\n", to_world=matrix)
    assert (plain.vertices == moved.vertices).all() and (plain.triangles == moved.triangles).all()
    flipped = scene(tmp_path, "0 0 0 1\n4 0 0 1\n", flip_normals=True)
    assert (flipped.normals == -plain.normals).all()
    assert any("1 curve rendered as prisms of 64 sides: " in note for note in plain.notes)
    group = {"type": "shapegroup", "c": {"type": "linearcurve", "filename": tmp_path / "curve.txt"}}
    held = load_dict({
        "type": "scene", "sky": {"type": "constant"}, "g": group,
        "i": {"type": "instance", "g": {"type": "ref", "id": "g"},
              "to_world": np.diag([2.0, 2.0, 2.0, 1.0])},
    })  # fmt: skip
    assert (held.vertices == 2 * plain.vertices).all()  # an instance scales all


@pytest.fixture(scope="module")
def mi():
    mitsuba = pytest.importorskip("mitsuba", reason="the peer renderer: pip install mitsuba")
    mitsuba.set_variant("scalar_rgb")
    return mitsuba


def hits(mi, scene_, shape, count):
    """Where random rays from outside first meet a scene, here and in Mitsuba."""
    import trimesh

    theirs = mi.load_dict({"type": "scene", "s": shape})
    rng = np.random.default_rng(1)
    start = rng.normal(size=(count, 3))
    start *= 6 / np.linalg.norm(start, axis=1)[:, None]
    ahead = rng.uniform(-1.2, 1.2, size=(count, 3)) - start
    ahead /= np.linalg.norm(ahead, axis=1)[:, None]
    found = [theirs.ray_intersect(mi.Ray3f(a.tolist(), b.tolist()))
             for a, b in zip(start, ahead, strict=True)]  # fmt: skip
    ours = trimesh.Trimesh(scene_.vertices, scene_.triangles, process=False)
    places, rays, faces = ours.ray.intersects_location(start, ahead, multiple_hits=False)
    lengths = np.full(count, np.inf)
    lengths[rays] = np.linalg.norm(places - start[rays], axis=1)
    other = np.array([hit.t for hit in found])
    both = np.isfinite(lengths[rays]) & np.isfinite(other[rays])
    rays, faces, places = rays[both], faces[both], places[both]
    share = trimesh.triangles.points_to_barycentric(ours.triangles[faces], places)
    return lengths, other, rays, faces, share, [found[k] for k in rays]


@pytest.mark.parametrize("kind", ["linearcurve", "bsplinecurve"])
def test_curves_are_mitsubas(mi, tmp_path, kind):
    """Splines from the front alone: Mitsuba sees through their backs."""
    ours = scene(tmp_path, {"linearcurve": LINEAR, "bsplinecurve": SPLINE}[kind], kind)
    shape = {"type": kind, "filename": str(tmp_path / "curve.txt")}
    lengths, other, rays, faces, share, found = hits(mi, ours, shape, 3000)
    assert len(rays) > 400
    inner = np.isfinite(lengths) & ~np.isfinite(other)
    assert (np.isfinite(lengths) | ~np.isfinite(other)).mean() > 0.998
    assert inner.mean() < (0.002 if kind == "linearcurve" else 0.05)
    near = np.abs(lengths[rays] - other[rays]) < 0.02
    assert near.mean() > (0.998 if kind == "linearcurve" else 0.98)
    mesh_, *_ = curves.read(tmp_path / "curve.txt", kind, np.eye(4), "")
    normals = (mesh_.normals[mesh_.triangles[faces]] * share[:, :, None]).sum(axis=1)
    normals /= np.linalg.norm(normals, axis=1)[:, None]
    cosines = (normals * [np.array(hit.n) for hit in found]).sum(axis=1)
    assert np.quantile(cosines[near], 0.02) > 0.9995
    uv = (mesh_.uv[mesh_.triangles[faces]] * share[:, :, None]).sum(axis=1)
    off = uv - [np.array(hit.uv) for hit in found]
    assert np.quantile(np.abs(off[near, 1]), 0.98) < 1e-3
    around = np.abs((off[near, 0] + 0.5) % 1 - 0.5)
    assert np.quantile(around, 0.9) < 5e-3


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("", "holds no control points"),
        ("\n \n", "holds no control points"),
        ("0 0 0 1\n", "curve 0 has 1 control points, expected 2 or more"),
        ("0 0 0 1\n1 0 0 1\n\n0 0 0 1\n", "curve 1 has 1 control points"),
        ("0 0 0 1\n1 0 0\n", "line 2: 3 words, expected x y z radius"),
        ("0 0 0 1\n1 0 0 x\n", 'line 2 = "x" is not a number'),
        ("0 0 0 1\n1 0 nan 1\n", 'line 2 = "nan" must be finite'),
        ("0 0 0 1\n1 0 1e999 1\n", "line 2 .* exceeds the float64 range"),
        ("0 0 0 1\n1 0 0 -1\n", "line 2: the radius -1 is below 0"),
        ("0 0 0 1\n1e101 0 0 1\n", "a control point exceeds 1e\\+100"),
        ("0 0 0 0\n1 0 0 0\n", "no surface, as all radii are 0"),
    ],
)
def test_bad_curves(tmp_path, text, message):
    with pytest.raises(SceneError, match=message):
        scene(tmp_path, text)


def test_bad_splines(tmp_path):
    with pytest.raises(SceneError, match="curve 0 has 3 control points, expected 4 or more"):
        scene(tmp_path, "0 0 0 1\n1 0 0 1\n2 0 0 1\n", "bsplinecurve")
    with pytest.raises(SceneError, match="no surface"):
        scene(tmp_path, "0 0 0 0\n1 0 0 0\n2 0 0 0\n3 1 0 0\n", "bsplinecurve")
    with pytest.raises(SceneError, match="no surface, as the points of each are one"):
        scene(tmp_path, 4 * "1 2 3 0.5\n", "bsplinecurve")
    with pytest.raises(SceneError, match="cannot read"):
        load_dict({"type": "scene", "s": {"type": "linearcurve", "filename": tmp_path / "none"}})


def test_points_that_coincide(tmp_path):
    """Three alike end a spline at its last point."""
    text = "0 0 0 .1\n" * 3 + "1 0 0 .1\n" + "2 1 0 .1\n" * 3
    found, *_ = read(tmp_path, text, "bsplinecurve")
    assert np.isfinite(found.normals).all()
    assert np.abs(found.vertices[:65] - [0, 0, 0]).max() < 0.1 + 1e-15
    assert np.abs(np.linalg.norm(found.vertices[-65:] - [2, 1, 0], axis=1) - 0.1).max() < 1e-15
    assert (np.abs(np.linalg.norm(found.normals, axis=1) - 1) < 1e-14).all()
    with pytest.warns(SceneWarning, match='curve.txt" is open, but is a dielectric'):
        scene(tmp_path, text, "bsplinecurve", bsdf={"type": "dielectric"})
