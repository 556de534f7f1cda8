"""Mesh files: reading, shading normals, closedness; positions and normals against Mitsuba."""

import dataclasses
import math
import re
import struct
import warnings
import zlib
from fractions import Fraction

import numpy as np
import pytest
import trimesh

import veriray
from veriray import transform
from veriray.columns import COLUMNS
from veriray.errors import SceneError, SceneWarning
from veriray.formats import mesh, mitsuba_dict, ply, ply_pieces, polygons
from veriray.formats.node import Node, Value
from veriray.formats.plugins import PLUGINS
from veriray.formats.shapes import Shapes
from veriray.scene import load_dict
from veriray_validate.levels.closed_polygons import ring
from veriray_validate.scenes import Medium, Part, camera, make, material

CORNERS = [[0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0]]
PLY = (
    "ply\nformat ascii 1.0\nelement vertex 4\nproperty float x\nproperty float y\n"
    "property float z\n"
    "element face 2\nproperty list uchar int vertex_indices\nend_header\n"
    "0 0 0\n1 0 0\n1 1 0\n0 1 0\n3 0 1 2\n3 0 2 3\n"
)
OBJ = "v 0 0 0\nv 1 0 0\nv 1 1 0.3\nv 0 1 0.1\n"
TETRAHEDRON = "v 0 0 0\nv 1 0 0\nv 0 1 0\nv 0 0 1\nf 1 3 2\nf 1 2 4\nf 2 3 4\nf 3 1 4\n"


def binary_ply(vertices, faces, endian="<", kind="f4", extra=""):
    word, number = {"<": "little", ">": "big"}[endian], {"f4": "float", "f8": "double"}[kind]
    header = (
        f"ply\nformat binary_{word}_endian 1.0\ncomment x\nelement vertex {len(vertices)}\n"
        + "".join(f"property {number} {axis}\n" for axis in "xyz")
        + f"{extra}element face {len(faces)}\nproperty list uchar int vertex_indices\nend_header\n"
    )
    data = np.array(vertices, f"{endian}{kind}").tobytes()
    for face in faces:
        data += bytes([len(face)]) + np.array(face, f"{endian}i4").tobytes()
    return header.encode() + data


def binary_stl(triangles):
    record = np.zeros(len(triangles), [("n", "<f4", 3), ("v", "<f4", (3, 3)), ("a", "<u2")])
    record["v"] = triangles
    return b"x" * 80 + np.uint32(len(triangles)).tobytes() + record.tobytes()


def read(folder, name, content):
    path = folder / name
    path.write_bytes(content if isinstance(content, bytes) else content.encode())
    return mesh.read(path, path.suffix[1:], "here")


def shape(folder, name, content=None, **values):
    """The scene of one mesh."""
    if content is not None:
        (folder / name).write_bytes(content if isinstance(content, bytes) else content.encode())
    return load_dict({
        "type": "scene",
        "sensor": {"type": "perspective", "fov": 40.0},
        "sky": {"type": "constant"},
        "s": {"type": name.rpartition(".")[2], "filename": folder / name, **values},
    })  # fmt: skip


def facing(scene):
    a, b, c = (scene.vertices[scene.triangles[:, i]] for i in range(3))
    n = np.cross(b - a, c - a)
    lengths = np.linalg.norm(n, axis=1, keepdims=True)
    return n / np.where(lengths > 0, lengths, np.nan)


# ---- files ----


def test_ply(tmp_path):
    got = read(tmp_path, "a.ply", PLY)
    assert got.vertices.tolist() == CORNERS and got.normals is None
    assert got.triangles.tolist() == [[0, 1, 2], [0, 2, 3]]
    for endian in "<>":
        for kind in ("f4", "f8"):
            data = binary_ply(CORNERS, got.triangles, endian, kind)
            same = read(tmp_path, "b.ply", data)
            assert (same.vertices == got.vertices).all()
            assert (same.triangles == got.triangles).all()


@pytest.mark.parametrize(
    "faces", [[[0, 1, 2, 3]], [[0, 1, 2], [0, 1, 2, 3]], [[0, 1, 2, 3], [3, 2, 1]]]
)
def test_ply_polygons_become_fans(tmp_path, faces):
    fans = [[f[0], f[k], f[k + 1]] for f in faces for k in range(1, len(f) - 1)]
    text = PLY.split("0 0 0\n")[0].replace("face 2", f"face {len(faces)}")
    text += "".join("{} {} {}\n".format(*v) for v in CORNERS)
    text += "".join(f"{len(f)} {' '.join(map(str, f))}\n" for f in faces)
    for content in (binary_ply(CORNERS, faces), binary_ply(CORNERS, faces, ">"), text):
        assert read(tmp_path, "a.ply", content).triangles.tolist() == fans


def area(mesh):
    """The areas of triangles (T, 3), as vectors."""
    a, b, c = (mesh.vertices[mesh.triangles[:, k]] for k in range(3))
    return 0.5 * np.cross(b - a, c - a)


def simple_polygon(rng):
    """Random corners (N, 2), in an order in which no two edges cross."""
    p = rng.uniform(-1, 1, (int(rng.integers(4, 16)), 2))

    def left(a, b, c):
        return (b[0] - a[0]) * (c[1] - a[1]) - (c[0] - a[0]) * (b[1] - a[1])

    def crossing(i, j):
        a, b, c, d = p[i], p[i + 1], p[j], p[(j + 1) % len(p)]
        return left(a, b, c) * left(a, b, d) < 0 and left(c, d, a) * left(c, d, b) < 0

    pairs = [(i, j) for i in range(len(p) - 1) for j in range(i + 2, len(p))]
    while found := next((pair for pair in pairs if crossing(*pair)), None):
        p[found[0] + 1 : found[1] + 1] = p[found[0] + 1 : found[1] + 1][::-1].copy()
    return p


def polygon_file(corners, rows, last=""):
    lines = ["v " + " ".join(map(repr, corner)) for corner in np.array(corners, float).tolist()]
    faces = ["f " + " ".join(str(k + 1) for k in row) for row in rows]
    return "\n".join([*lines, *faces, last])


def covers_once(mesh, outlines):
    """Whether the triangles of polygons, one after another, cover them without folds."""
    areas, at = area(mesh), 0
    for outline in outlines:
        own = areas[at : at + len(outline) - 2]
        at += len(own)
        whole = 0.5 * np.cross(outline, np.roll(outline, -1, axis=0)).sum(axis=0)
        assert np.allclose(own.sum(axis=0), whole, rtol=0, atol=1e-12)
        assert np.linalg.norm(own, axis=1).sum() <= np.linalg.norm(whole) * (1 + 1e-9)
    assert at == len(areas)


@pytest.mark.parametrize("last", ["", "# read line by line\n v 0 0 0"])
def test_obj_polygons_that_are_not_convex(tmp_path, last):
    rng = np.random.default_rng(1)
    for _ in range(100):
        turn, _ = np.linalg.qr(rng.normal(size=(3, 3)))
        flat = simple_polygon(rng)
        outlines = [np.c_[np.roll(flat, k, axis=0), np.zeros(len(flat))] @ turn for k in range(3)]
        starts = np.arange(3) * len(flat)
        rows = [np.arange(len(flat)) + start for start in starts]
        got = read(tmp_path, "a.obj", polygon_file(np.concatenate(outlines), rows, last))
        covers_once(got, outlines)


def test_obj_polygons_with_a_hole(tmp_path):
    rng = np.random.default_rng(2)
    for _ in range(200):
        flat = ring(rng)
        outline = np.c_[np.roll(flat, rng.integers(len(flat)), axis=0), np.zeros(len(flat))]
        got = read(tmp_path, "a.obj", polygon_file(outline, [np.arange(len(outline))]))
        covers_once(got, [outline])


def test_obj_polygons_that_fans_cover_stay_fans(tmp_path):
    turn = 2 * np.pi * np.arange(9) / 9
    convex = np.stack([np.cos(turn), np.sin(turn), 0 * turn], axis=1)
    straight = np.array([[0, 0, 0], [1, 0, 0], [2, 0, 0], [2, 1, 0], [0, 1, 0]])
    crossed = np.array([[0, 0, 0], [1, 1, 0], [1, 0, 0], [0, 1, 0]])
    for outline in (convex, straight, crossed, np.zeros((5, 3))):
        got = read(tmp_path, "a.obj", polygon_file(outline, [np.arange(len(outline))]))
        assert got.triangles.tolist() == [[0, k, k + 1] for k in range(1, len(outline) - 1)]


def test_corners_of_polygons_that_are_not_convex_keep_their_numbers(tmp_path):
    text = "v 0 0 0\nv 4 -1 0\nv 1 0 0\nv 4 1 0\nvt 0 0\nvt 4 -1\nvt 1 0\nvt 4 1\n"
    got = read(tmp_path, "a.obj", text + "f 2/2 3/3 4/4 1/1\nf 3/3 4/4 1/1 2/2\n")
    assert (got.uv[:, :2] == got.vertices[:, :2]).all()
    assert len(got.triangles) == 4
    assert np.linalg.norm(area(got), axis=1).sum() == 2


#: Outlines whose corners lie on each other's diagonals.
OUTLINES = {
    "stairs": [(0, 0), (5, 0), (5, 5), (4, 5), (4, 4), (3, 4), (3, 3), (2, 3), (2, 2), (1, 2),
               (1, 1), (0, 1)],
    "plus": [(1, -3), (1, -1), (3, -1), (3, 1), (1, 1), (1, 3), (-1, 3), (-1, 1), (-3, 1),
             (-3, -1), (-1, -1), (-1, -3)],
    "arrow": [(0, -1), (4, -1), (4, -3), (7, 0), (4, 3), (4, 1), (0, 1)],
    "L": [(0, 0), (3, 0), (3, 1), (1, 1), (1, 3), (0, 3)],
    "H": [(0, 0), (1, 0), (1, 2), (3, 2), (3, 0), (4, 0), (4, 5), (3, 5), (3, 3), (1, 3), (1, 5),
          (0, 5)],
    "zigzag": [(0, 0), (6, 0), (6, 3), (5, 2), (4, 3), (3, 2), (2, 3), (1, 2), (0, 3)],
    **{
        name: [(r * math.cos(math.pi * k / n), r * math.sin(math.pi * k / n))
               for k, r in enumerate([1, inner] * n)]
        for name, n, inner in (("hexagram", 6, 1 / math.sqrt(3)), ("pentagram", 5, 0.381966))
    },
}  # fmt: skip


def exact_area(corners):
    """Twice the area of an outline of floats, counter-clockwise above 0."""
    x, y = ([Fraction(float(value)) for value in column] for column in np.transpose(corners))
    return sum(x[k - 1] * y[k] - x[k] * y[k - 1] for k in range(len(x)))


def grid_polygon(rng):
    """Corners (N, 2) of a grid of integers, in an order in which no two edges meet; or None."""
    p = np.unique(rng.integers(0, 9, (int(rng.integers(5, 13)), 2)), axis=0)
    rng.shuffle(p)

    def left(a, b, c):
        return (b[0] - a[0]) * (c[1] - a[1]) - (c[0] - a[0]) * (b[1] - a[1])

    def within(a, b, c):
        return (
            left(a, b, c) == 0 and (np.minimum(a, b) <= c).all() and (c <= np.maximum(a, b)).all()
        )

    def meet(i, j):
        a, b, c, d = p[i], p[i + 1], p[j], p[(j + 1) % len(p)]
        if left(a, b, c) * left(a, b, d) < 0 and left(c, d, a) * left(c, d, b) < 0:
            return True
        return within(a, b, c) or within(a, b, d) or within(c, d, a) or within(c, d, b)

    pairs = [(i, j) for i in range(len(p)) for j in range(i + 2, len(p) - (i == 0))]
    for _ in range(60):
        found = next((pair for pair in pairs if meet(*pair)), None)
        if found is None:
            break
        p[found[0] + 1 : found[1] + 1] = p[found[0] + 1 : found[1] + 1][::-1].copy()
    else:
        return None
    back, on = p - np.roll(p, 1, axis=0), np.roll(p, -1, axis=0) - p
    turns_round = (back[:, 0] * on[:, 1] == back[:, 1] * on[:, 0]) & ((back * on).sum(axis=1) <= 0)
    return None if turns_round.any() else p


def outlines(rng):
    """Simple outlines (N, 2) whose corners lie within rounding of each other's diagonals."""
    for _ in range(150):
        p = grid_polygon(rng)
        if p is not None:
            yield np.array([[float(f"{x / 10:.1f}") for x in corner] for corner in p.tolist()])
    for p in OUTLINES.values():
        for _ in range(10):
            size, angle = rng.choice([1, 0.1, 0.3, 2.54]), rng.choice([0, 0.5, 1 / 3, rng.random()])
            c, s = math.cos(math.pi * angle), math.sin(math.pi * angle)
            yield size * np.array(p) @ [[c, s], [-s, c]] + rng.choice([0, 5.3])


def test_cuts_of_polygons_are_exact():
    rng = np.random.default_rng(3)
    for outline in outlines(rng):
        outline = np.roll(outline, rng.integers(len(outline)), axis=0)
        outline = outline if exact_area(outline) > 0 else outline[::-1]
        cut = polygons._cut(*outline.T)
        areas = [exact_area(outline[list(corners)]) for corners in cut]
        assert len(cut) == len(outline) - 2
        assert min(areas) >= 0
        assert sum(areas) == exact_area(outline)


def test_obj_polygons_with_corners_on_diagonals(tmp_path):
    rng = np.random.default_rng(4)
    for outline in outlines(rng):
        turn = np.linalg.qr(rng.normal(size=(3, 3)))[0] if rng.random() < 0.5 else np.eye(3)
        places = [np.c_[np.roll(outline, k, axis=0), np.zeros(len(outline))] @ turn
                  for k in range(len(outline))]  # fmt: skip
        rows = np.arange(len(outline)) + len(outline) * np.arange(len(outline))[:, None]
        got = read(tmp_path, "a.obj", polygon_file(np.concatenate(places), rows))
        covers_once(got, places)


@pytest.mark.parametrize("pieces", [False, True])
def test_ply_quadrangles_that_are_not_convex(tmp_path, monkeypatch, pieces):
    if pieces:
        monkeypatch.setattr(ply_pieces, "LEAST", 1)
        monkeypatch.setattr(ply_pieces, "PIECE", 64)
    corners = np.array([[0, 0, 0], [4, -1, 0], [1, 0, 0], [4, 1, 0]])
    faces = [np.roll(np.arange(4), k).tolist() for k in range(4)] * 5
    got = read(tmp_path, "a.ply", binary_ply(corners, faces))
    assert (ply_pieces.read(tmp_path / "a.ply", 2**20) is not None) == pieces
    covers_once(got, [corners[face] for face in faces])


def test_ply_normals_and_other_properties(tmp_path):
    text = (
        "ply\nformat ascii 1.0\nobj_info x\nelement vertex 3\nproperty uchar red\n"
        "property double x\n"
        "property double y\nproperty double z\nproperty list uchar float more\nproperty float nx\n"
        "property float ny\nproperty float nz\nproperty float u\nproperty float v\n"
        "element edge 1\nproperty int a\nproperty int b\nelement face 1\nproperty uchar flags\n"
        "property list uint8 uint32 vertex_index\nproperty list uchar float texcoord\nend_header\n"
        "255 0 0 0 2 5 5 0 0 1 .1 .2\n255 1 0 0 0 0 0 2 .1 .2\n255 0 1 0 1 7 1 0 0 .1 .2\n0 1\n"
        "9 3 0 1 2 6 0 0 0 1 1 0\n"
    )
    got = read(tmp_path, "a.ply", text)
    assert got.vertices.tolist() == [[0, 0, 0], [1, 0, 0], [0, 1, 0]]
    assert got.normals.tolist() == [[0, 0, 1], [0, 0, 2], [1, 0, 0]]
    assert got.triangles.tolist() == [[0, 1, 2]]
    assert got.uv.tolist() == [[0.1, 0.2]] * 3


@pytest.mark.parametrize("names", ["u v", "s t", "texture_u texture_v", "v u"])
def test_ply_texture_coordinates(tmp_path, names):
    extra = "".join(f"property float {name}\n" for name in names.split())
    text = PLY.replace("property float z\n", f"property float z\n{extra}")
    for k, corner in enumerate(CORNERS):
        line = " ".join(map(str, corner))
        text = text.replace(f"\n{line}\n", f"\n{line} {k} {-k / 2}\n")
    got = read(tmp_path, "a.ply", text)
    expected = [[k, -k / 2] for k in range(4)]
    assert got.uv.tolist() == [row[::-1] if names == "v u" else row for row in expected]
    other = read(tmp_path, "b.ply", text.replace(f"{names.split()[1]}\n", "w\n"))
    assert other.uv is None, "one of two is none"


def test_obj(tmp_path):
    text = (
        "# c\nmtllib x.mtl\no one\nv 0 0 0\nv 2 0 0 1\r\nv 2 1 0\nv 1 2 0\nv 0 1 0\n"
        "usemtl x\n"
        "f 1 2 3 \\\n4 5\ns off\no two\nv 0 0 5\nv 2 0 5 # c\nv 2e0 1 5.0\nusemtl y\n"
        "f -3 -2 -1\nl 1 2\n"
    )
    got = read(tmp_path, "a.obj", text)
    assert got.vertices.shape == (8, 3) and got.normals is None
    assert got.triangles.tolist() == [[0, 1, 2], [0, 2, 3], [0, 3, 4], [5, 6, 7]]


@pytest.mark.parametrize("end", ["\n", "\r\n"])
@pytest.mark.parametrize(
    "before",
    ["# from C:\\models\\", "g C:\\models\\", "o part\\", "s \\", "usemtl \\", "vp 1\\", "fx \\",
     "\\", "vt 0 0 # C:\\", " # \\", "# a\rg b\\", "vt 0 \\\n0 # \\"],
)  # fmt: skip
def test_obj_lines_without_numbers_end_at_a_backslash(tmp_path, before, end):
    square = "v 5 5 5\nv 0 0 0\nv 1 0 0\nv 1 1 0\n"
    for native in (True, False):
        text = f"{before}\n{square}{before}\nf 1 2 \\\n 3 \\\n4\n{before}\nf\\\n-3 -2 -1\n"
        data = text.replace("\n", end).encode()
        joined = mesh.obj_text(data)
        reader = mesh._obj_native if native else mesh._obj_lines
        tables, corners, triangles, parts = reader(joined)
        assert tables[0].tolist() == [[5, 5, 5], [0, 0, 0], [1, 0, 0], [1, 1, 0]]
        assert corners[:, 0].tolist() == [0, 1, 2, 3, 1, 2, 3]
        assert triangles.tolist() == [[0, 1, 2], [0, 2, 3], [4, 5, 6]] and parts.tolist() == [2, 1]
    assert read(tmp_path, "a.obj", data).triangles.tolist() == [[0, 1, 2], [0, 2, 3], [1, 2, 3]]


def test_obj_backslashes_mean_the_same_to_both_readers():
    """Files with backslashes at random: refused by both readers, or the same for both."""
    rng, read_both = np.random.default_rng(5), 0
    for k in range(300):
        text = obj_file(rng, OBJ_CORNERS[k % 4], (3, 4), 1)
        ends = [at for at, letter in enumerate(text) if letter in "\n "]
        for at in sorted(rng.choice(ends, rng.integers(1, 4)).tolist(), reverse=True):
            text = (
                text[:at]
                + str(rng.choice(["\\\n", "\\\r\n", "#\\\n", "\\", "\\\r"]))
                + text[at + 1 :]
            )
        given = mesh.obj_text(text.encode())
        fast = mesh._obj_native(given)
        try:
            slow = mesh._obj_lines(given)
        except mesh.MeshFileError:
            assert fast is None, given
            continue
        assert fast is not None, given
        assert same_obj(fast, slow), given
        read_both += 1
    assert read_both > 30


OBJ_CORNERS = ["{0}", "{0}/{1}", "{0}//{2}", "{0}/{1}/{2}"]


def obj_file(rng, corner, sides, blocks):
    """Blocks of 9 lines of each kind and 20 faces that use those so far."""
    text = "# c\n"
    for block in range(1, blocks + 1):
        text += f"o x{block}\n\n"
        for kind, width in (("v", 3), ("vt", 2), ("vn", 3)):
            rows = (10.0 ** rng.integers(-9, 9) * rng.normal(size=(9, width))).tolist()
            text += "".join(f"{kind} {' '.join(map(repr, row))}\n" for row in rows)
        for face in rng.integers(1, 9 * block + 1, (20, max(sides), 3)).tolist():
            used = face[: rng.choice(sides)]
            text += f"f {' '.join(corner.format(*c) for c in used)}\n"
    return text


def same_obj(fast, slow):
    """Whether two readings are the same arrays, numbers of one kind."""
    pairs = zip([*fast[0], *fast[1:]], [*slow[0], *slow[1:]], strict=True)
    return all(a.shape == b.shape and a.dtype == b.dtype and (a == b).all() for a, b in pairs)


@pytest.mark.parametrize("corner", OBJ_CORNERS)
@pytest.mark.parametrize("sides", [(3,), (4,), (3, 4, 7)])
def test_obj_by_the_native_module_is_obj_line_by_line(corner, sides):
    text = obj_file(np.random.default_rng(1), corner, sides, 3)
    for given in (text, text.rstrip("\n"), text.replace("\n", "\r\n"), ""):
        assert same_obj(mesh._obj_native(given.encode()), mesh._obj_lines(given.encode()))
    for fine in (
        "f 1 2 -1", "f 1/1 2/2 3", "f -1/-2/-3 2 3", "f +1 2 3", "f 1 2 3#", "f\t1\v2\f3 ",
        "f 1/ 2// 3", "v +1 .5 5.e-3", "v 1 2 3 4 x", "v -0 1E5 1e+5", "v 1 2 3 # c", " v 1 2 3",
        "v\t1 2 3",
        "vt 1", "vt 1 2 3", "vp 1 2", "# v", "g v f", "vn 1 2 3\rv 4 5 6\n\r",
    ):  # fmt: skip
        given = f"{text}{fine}\n".encode()
        assert same_obj(mesh._obj_native(given), mesh._obj_lines(given)), fine
    for odd in (
        "f 1 2 28", "f 0 1 2", "f 1 2", "f 1 2 -28", "f 1/1/1/1 2 3", "f / 1 2", "f 1.0 2 3",
        "f 9999999999999999999 1 2", "f 1///1 2///1 3///1", "f +-1 2 3", "v 1 nan 2", "v 1 2", "v",
        "v 1.2.3 4 5", "v 1-2 3 4", "v 1 2 .", "v 1 2 1e", "v 1 2 e5", "v 1 2 +-1", "v 1 2 1e5e3",
        "v 1 2 1e5.5", "v 1 2 -", "v 1 2 0x1", "v 1 2 1_0", "v 1 2 inf", "vt", "vn 1 2",
    ):  # fmt: skip
        given = f"{text}{odd}\n".encode()
        assert mesh._obj_native(given) is None, odd
        with pytest.raises(mesh.MeshFileError):
            mesh._obj_lines(given)


def test_obj_by_the_native_module_accepts_nothing_else():
    """Files with bytes changed at random: refused by both readers, or the same for both."""
    rng, read_both = np.random.default_rng(2), 0
    for k in range(2000):
        text = bytearray(obj_file(rng, OBJ_CORNERS[k % 4], (3, 4), 1).encode())
        for place in rng.integers(0, len(text), rng.integers(1, 4)):
            text[place] = rng.choice(list(b"0123456789 /.-+e#vtnf\n\t\r\x0b\x0c\x00"))
        fast = mesh._obj_native(bytes(text))
        try:
            slow = mesh._obj_lines(bytes(text))
        except mesh.MeshFileError:
            assert fast is None, bytes(text)
            continue
        if fast is None:  # infinite or 0 line by line
            assert re.search(rb"[eE][+-]?[0-9]{3}", text), bytes(text)
            continue
        read_both += 1
        assert same_obj(fast, slow), bytes(text)
    assert 200 < read_both < 1900


def test_obj_agrees_with_trimesh(tmp_path):
    trimesh = pytest.importorskip(
        "trimesh", reason="reads meshes a second way: pip install trimesh"
    )
    ball = trimesh.creation.icosphere(subdivisions=2)
    got = read(tmp_path, "ball.obj", ball.export(file_type="obj", include_normals=False))
    assert (got.triangles == ball.faces).all() and np.abs(got.vertices - ball.vertices).max() < 1e-8


def test_obj_vertices_are_split_by_normal_and_texture(tmp_path):
    got = read(tmp_path, "a.obj", OBJ + "vn 0 0 2\nvn 1 0 0\nf 1//1 2//1 3//1\nf 1//2 3//1 4\n")
    assert got.normals[got.triangles].tolist() == [
        [[0, 0, 2]] * 3,
        [[1, 0, 0], [0, 0, 2], [0, 0, 2]],  # as in Mitsuba, that of the corner before it
    ]
    assert (got.vertices[got.triangles] == np.array(
        [[[0, 0, 0], [1, 0, 0], [1, 1, 0.3]], [[0, 0, 0], [1, 1, 0.3], [0, 1, 0.1]]]
    )).all()  # fmt: skip
    assert got.uv is None
    seam = OBJ + "vt 0 .25\nvt 1\nf 1/1 2/1 3/1\nf 1/2 3 4/2\n"
    split = read(tmp_path, "b.obj", seam)
    assert len(split.vertices) == 6 and split.normals is None
    assert split.uv[split.triangles].tolist() == [[[0, 0.25]] * 3, [[1, 0]] * 3]
    seam = OBJ + "vt 0 0\nvt 1 1\nf 1/1 2/1 3/1\nf 1/2 3/2 4/2\n"
    assert len(read(tmp_path, "b.obj", seam).vertices) == 6
    assert not shape(tmp_path, "b.obj").normals.any(), "a seam is an edge, as in Mitsuba"


def test_stl(tmp_path):
    corners = np.array(CORNERS, float)[[[0, 1, 2], [0, 2, 3]]]
    text = "solid x\n" + "".join(
        "facet normal 0 0 1\nouter loop\n"
        + "".join("vertex {:g} {:g} {:g}\n".format(*v) for v in triangle)
        + "endloop\nendfacet\n"
        for triangle in corners
    )
    for content in (binary_stl(corners), text + "endsolid x\n"):
        got = read(tmp_path, "a.stl", content)
        assert (got.vertices[got.triangles] == corners).all() and got.normals is None
    (tmp_path / "b.stl").write_bytes(binary_stl(corners + [[[0, 0, 0], [0, 0, 0], [0, 0, 1]]]))
    scene = shape(tmp_path, "b.stl")
    assert len(scene.triangles) == 2 and not scene.normals.any()


@pytest.mark.parametrize(
    ("change", "name"),
    [
        (str, ""), (str, " vertex 1"), (str, " facet normal"), (str, " endfacet solid"),
        (str.upper, " part"), (lambda text: "\ufeff" + text, ""),
        (lambda text: text.replace("\n", "\r"), ""), (lambda text: text.replace("\n", "\r\n"), ""),
    ],
)  # fmt: skip
def test_stl_files_of_several_solids(tmp_path, change, name):
    corners = np.array(CORNERS, float)[[[0, 1, 2], [0, 2, 3]]]
    text = "".join(
        f"solid{name}\nfacet normal 0 0 1\nouter loop\n"
        + "".join("vertex {:.1e} {:.1e} {:.1e}\n".format(*v) for v in triangle)
        + f"endloop\nendfacet\nendsolid{name}\n"
        for triangle in corners
    )
    got = read(tmp_path, "a.stl", change(text).encode())
    assert (got.vertices[got.triangles] == corners).all()


# ---- serialized files ----

FLAGS = {"normals": 1, "uv": 2, "colours": 8, "f4": 0x1000, "f8": 0x2000}
TABLES = {
    "vertices": [[0, 0, 0], [1, 0, 0], [0, 1, 0], [0.25, 0.5, 1]],
    "normals": [[-1, -1, -1], [0, -2, -1], [-2, 0, -1], [-1, -1, 0]],
    "uv": [[0, 0.1], [1, 0.2], [-3, 0.3], [0.5, 7]],
    "colours": [[1, 0, 0]] * 4,
}
FACES = [[0, 2, 1], [0, 1, 3], [0, 3, 2]]


def one_mesh(
    parts=("normals", "uv"), kind="f4", version=4, shift=0.0, flags=0, end=b"", counts=(4, 3)
):
    """One mesh of a serialized file."""
    body = struct.pack("<I", FLAGS[kind] | flags | sum(FLAGS[part] for part in parts))
    body += "Stra\u00dfe\0".encode() if version == 4 else b""
    body += struct.pack("<QQ", *counts)
    for part in ("vertices", *parts):
        table = np.array(TABLES[part]) + (shift if part == "vertices" else 0)
        body += table.astype("<" + kind).tobytes()
    body += np.array(FACES, "<u4").tobytes() + end
    return struct.pack("<HH", 0x041C, version) + zlib.compress(body)


def serialized_file(meshes, version=4):
    """A file of several meshes, with its table of offsets."""
    offsets = np.cumsum([0, *map(len, meshes)])[:-1]
    table = offsets.astype("<u8" if version == 4 else "<u4").tobytes()
    return b"".join(meshes) + table + struct.pack("<I", len(meshes))


@pytest.mark.parametrize("version", [3, 4])
@pytest.mark.parametrize("kind", ["f4", "f8"])
@pytest.mark.parametrize("parts", [(), ("normals",), ("uv", "colours"), ("normals", "uv")])
def test_serialized(tmp_path, version, kind, parts):
    meshes = [one_mesh(parts, kind, version, shift) for shift in (0, 1, 2)]
    (tmp_path / "a.serialized").write_bytes(serialized_file(meshes, version))
    files = {}
    for index in range(3):
        got = mesh.read(tmp_path / "a.serialized", "serialized", "here", index, files)
        assert (got.vertices == np.array(TABLES["vertices"]) + index).all()
        assert got.triangles.tolist() == FACES and got.vertices.dtype == np.float64
        for part, values in (("normals", got.normals), ("uv", got.uv)):
            assert (values is None) == (part not in parts)
            exact = np.array(TABLES[part], kind).astype(float)
            assert values is None or (values == exact).all()
    assert len(files) == 1
    alone = read(tmp_path, "b.serialized", meshes[0])
    assert alone.triangles.tolist() == FACES, "one mesh needs no table"


DAMAGE = {
    "empty": (b"", 0, "no header"),
    "magic": (b"\x1c\x05\x04\0" + one_mesh()[4:], 0, "format 0x051c and the version 4"),
    "version": (b"\x1c\x04\x05\0" + one_mesh()[4:], 0, "version 5, expected 0x041c and 3 or 4"),
    "not zlib": (one_mesh()[:4] + b"hello world", 0, "mesh 0 cannot be unpacked"),
    "bits": (bytes(b ^ (k == 40) * 8 for k, b in enumerate(one_mesh())), 0, "cannot be unpacked"),
    "short": (one_mesh()[:-20], 0, "ends within its"),
    "no checksum": (one_mesh()[:-1], 0, "ends within its"),
    "long": (one_mesh(end=b"x"), 0, "holds more than the"),
    "bomb": (one_mesh(end=bytes(10**8)), 0, "holds more than the"),
    "vertices": (one_mesh(counts=(10**9, 3)), 0, "at most 2147483648 allowed"),
    "triangles": (one_mesh(counts=(4, 2**64 - 1)), 0, "18446744073709551615 triangles"),
    "few": (one_mesh(counts=(4, 4)), 0, "ends within its"),
    "none": (one_mesh(counts=(4, 0), end=b""), 0, "holds more than"),
    "name": (one_mesh()[:4] + zlib.compress(b"x" * 10**7), 0, "no counts"),
    "flags": (one_mesh(flags=0x3000), 0, "single and double"),
    "index": (serialized_file([one_mesh()] * 2), 2, r'"shape_index" = 2 is outside \[0, 1\]'),
    "no table": (one_mesh(), 1, "its end states [0-9]+ meshes"),
    "no meshes": (one_mesh() + bytes(4), 1, "its end states 0 meshes"),
    "offset": (one_mesh() + struct.pack("<QQI", 0, 2**40, 2), 1, "begin at byte 1099511627776"),
    "not there": (one_mesh() + struct.pack("<QQI", 0, 3, 2), 1, "at byte 3 stand"),
}  # fmt: skip


@pytest.mark.parametrize("name", DAMAGE)
def test_damaged_serialized_files(tmp_path, name):
    content, index, message = DAMAGE[name]
    with pytest.raises(SceneError, match=rf"s.filename: .*a.serialized.*{message}"):
        shape(tmp_path, "a.serialized", content, shape_index=index)


def test_every_byte_of_a_serialized_file_may_be_wrong(tmp_path):
    whole = serialized_file([one_mesh(), one_mesh(shift=1.0)])
    same = 0
    for k in range(len(whole)):
        for content in (whole[:k], whole[:k] + bytes([whole[k] ^ 0x55]) + whole[k + 1 :]):
            (tmp_path / "a.serialized").write_bytes(content)
            for index in (0, 1):
                try:
                    mesh.read(tmp_path / "a.serialized", "serialized", "here", index)
                    same += 1
                except SceneError:
                    continue
    first = len(one_mesh())  # the other mesh may be wrong, and what says where that is
    assert same == 2 * (len(whole) - first) + (first - 4) + 8


# ---- normals ----


def test_angles_are_exact():
    rng = np.random.default_rng(2)
    a, b = (mesh.unit(rng.normal(size=(2000, 3))) for _ in range(2))
    angles = mesh.angles(a, b)
    cross = np.linalg.norm(np.cross(a, b), axis=1)
    assert np.abs(angles - np.arctan2(cross, (a * b).sum(axis=1))).max() < 1e-12
    ends = mesh.angles(a[:2], np.stack([a[0], -a[1]]))
    assert ends[0] == 0 and ends[1] == pytest.approx(math.pi, abs=1e-11)


def test_unit_vectors_of_any_length():
    rows = np.array([[3, 0, 4], [0, 0, 0], [1e200, 0, 0], [0, -1e-300, 0]])
    assert np.abs(mesh.unit(rows) - [[0.6, 0, 0.8], [0, 0, 0], [1, 0, 0], [0, -1, 0]]).max() < 1e-15


def test_computed_normals_of_a_sphere_point_outwards(tmp_path):
    trimesh = pytest.importorskip(
        "trimesh", reason="reads meshes a second way: pip install trimesh"
    )
    ball = trimesh.creation.icosphere(subdivisions=3)
    scene = shape(tmp_path, "ball.obj", ball.export(file_type="obj", include_normals=False))
    assert np.abs(scene.normals - scene.vertices).max() < 5e-3
    assert np.abs(np.linalg.norm(scene.normals, axis=1) - 1).max() < 1e-15
    flat = shape(tmp_path, "ball.obj", face_normals=True)
    assert not flat.normals.any() and (flat.triangles == scene.triangles).all()
    inside = shape(tmp_path, "ball.obj", flip_normals=True)
    assert (inside.normals == -scene.normals).all()
    assert (inside.triangles == scene.triangles[:, ::-1]).all()


def test_creases(tmp_path):
    box = trimesh.creation.box()
    values = {"type": "mesh", "mesh": box}
    assert len(one_shape(**values).vertices) == 8 and one_shape(**values).normals.any()
    sharp = one_shape(**values, max_smooth_angle=89.0)
    assert len(sharp.vertices) == 24 and not sharp.normals.any()
    assert len(one_shape(**values, max_smooth_angle=91.0).vertices) == 8
    tube = trimesh.creation.cylinder(1, 2, sections=64)
    turned = np.where((np.arange(len(tube.faces)) % 2)[:, None] == 0, [0, 1, 2], [1, 2, 0])
    faces = np.take_along_axis(tube.faces, turned, axis=1)
    scene = one_shape(type="mesh", vertices=tube.vertices, faces=faces, max_smooth_angle=20)
    assert len(scene.vertices) == 2 + 4 * 64, "caps and side apart"
    side = np.abs(facing(scene)[:, 2]) < 0.5
    round_ = scene.normals[scene.triangles[side]]
    expected = scene.vertices[scene.triangles[side]] * [1, 1, 0]
    assert np.abs(round_ - expected).max() < 1e-12
    assert np.abs(np.abs(scene.normals[scene.triangles[~side]][..., 2]) - 1).max() < 1e-12
    (tmp_path / "a.obj").write_text(
        "v 0 0 0\nv 1 0 0\nv 1 1 .1\nv 0 1 0\nvt 0 0\nvt 1 1\nf 1/1 2/1 3/1\nf 1/2 3/2 4/2\n"
    )
    assert len(shape(tmp_path, "a.obj", max_smooth_angle=180).vertices) == 6, "a seam stays"
    with pytest.raises(SceneError, match="both face_normals and max_smooth_angle given"):
        one_shape(**values, max_smooth_angle=3.0, face_normals=True)
    with pytest.raises(SceneError, match="unknown parameter"):
        shape(tmp_path, "a.stl", b"", max_smooth_angle=3.0)


def test_a_flat_mesh_keeps_no_normals(tmp_path):
    assert not shape(tmp_path, "a.ply", PLY).normals.any()
    bent = shape(tmp_path, "b.ply", PLY.replace("0 1 0\n3", "0 1 1\n3"))
    assert (np.linalg.norm(bent.normals, axis=1) > 0.99).all()
    assert not shape(
        tmp_path, "c.obj", OBJ + "vn 0 0 1\nf 1 2 3\nf 2 3 4\nf 1 2 2\n", face_normals=True
    ).normals.any()


def test_normals_of_the_file_are_transformed_by_the_inverse_transpose(tmp_path):
    text = OBJ + "vn 0 0 2\nvn .5 0 1\nf 1//1 2//2 3//1\nf 1//1 3//1 4//2\n"
    matrix = np.array([[1, 0.3, 0, 5], [0, 2, 0, 0], [0.2, 0, 1.5, 0], [0, 0, 0, 1]])
    scene = shape(tmp_path, "a.obj", text, to_world=matrix)
    expected = np.array([[0, 0, 1], [0.5, 0, 1]]) @ np.linalg.inv(matrix[:3, :3])
    expected /= np.linalg.norm(expected, axis=1, keepdims=True)
    index = scene.triangles[0]
    assert np.abs(scene.normals[index] - expected[[0, 1, 0]]).max() < 1e-15
    mirrored = shape(tmp_path, "a.obj", to_world=np.diag([-1.0, 1, 1, 1]))
    assert (facing(mirrored)[:, 2] > 0).all(), "the front is where the normals point"
    flat = shape(tmp_path, "a.obj", to_world=np.diag([-1.0, 1, 1, 1]), face_normals=True)
    straight = shape(tmp_path, "a.obj", face_normals=True)
    assert (flat.triangles == straight.triangles[:, ::-1]).all(), "a mirror keeps the front"


def test_a_folded_sliver_does_not_break_a_surface():
    """A closed mesh is turned as a whole; if neighbours disagree, each triangle by itself."""
    tables, corners, triangles, _ = mesh._obj_lines(TETRAHEDRON.encode())
    vertices, triangles = tables[0], corners[:, 0][triangles]
    outward = mesh.unit(vertices - vertices.mean(axis=0))
    for turned, result in ((triangles, triangles), (triangles[:, ::-1], triangles)):
        assert (mesh.fronts_by_normals(vertices, turned, outward) == result).all()
    folded = np.where(
        (np.arange(4) != triangles[0][:, None]).all(axis=0)[:, None], outward, -outward
    )
    assert (mesh.fronts_by_normals(vertices, triangles, folded) == triangles).all()
    mixed = triangles.copy()
    mixed[1] = mixed[1][::-1]
    assert (mesh.fronts_by_normals(vertices, mixed, outward) == triangles).all()


def test_a_flat_mirrored_mesh_keeps_its_front(tmp_path):
    flat = "v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 3\n"
    mirror = np.diag([-1.0, 1, 1, 1])
    assert facing(shape(tmp_path, "m.obj", flat, to_world=mirror))[0, 2] == 1
    assert facing(shape(tmp_path, "m.obj", to_world=mirror, flip_normals=True))[0, 2] == -1


# ---- closedness ----


def test_a_fold_is_turned_with_its_mesh_or_not_at_all():
    ball = trimesh.creation.icosphere(subdivisions=4)
    bumps = np.random.default_rng(3).uniform(0.6, 1.4, (len(ball.vertices), 1))
    ball = trimesh.Trimesh(ball.vertices * bumps, ball.faces, process=False)
    n = np.array(ball.vertex_normals)
    back = (ball.face_normals * n[ball.faces].sum(axis=1)).sum(axis=1) < 0
    assert 0 < back.sum() < len(back) / 2  # a fold

    def normals_met(faces):
        """Of camera rays, as they are met, by face: shape (3,) each."""
        whole = len(faces) == len(back)
        fog = Medium(2.0, 1.0) if whole else None
        part = Part(ball.vertices, faces, normals=n, material=material("null"), interior=fog)
        scene = make([part], camera([0, 0, 4], [0, 0, 0], 40), 1.0, 16, 16, max_depth=-1)
        r = veriray.render(scene, spp=16, device="cpu")
        if whole:  # what goes in comes out
            assert sum(r.stats["ledger"]["depth_cut"]) == 0 and abs(r.image - 1).max() < 1e-5
        met = [veriray.trace_path(scene, k % 16, k // 16, 0)[0] for k in range(256)]
        return {e["primitive"]: np.array(e["normal"]) for e in met if e["primitive"] >= 0}

    for faces in (ball.faces, ball.faces[:, ::-1]):  # normals say where the front is
        for k, normal in normals_met(faces).items():
            assert normal @ ball.face_normals[k] > 0.99
    rows = np.flatnonzero(back)
    alone = normals_met(ball.faces[rows])
    assert alone
    for k, normal in alone.items():  # by itself each is turned
        assert normal @ ball.face_normals[rows[k]] < -0.99


def test_closed_meshes():
    def closed(text):
        tables, corners, triangles, _ = mesh._obj_lines(text.encode())
        return mesh.is_closed(tables[0], corners[:, 0][triangles])

    assert closed(TETRAHEDRON)
    assert closed(TETRAHEDRON.replace("f 3 1 4", "v 0 1 0\nf 5 1 4")), "welded by position"
    assert closed(TETRAHEDRON + "f 1 2 2\n"), "a triangle without area"
    assert not closed(TETRAHEDRON.replace("f 1 3 2\n", ""))
    assert not closed(TETRAHEDRON.replace("f 1 3 2\n", "f 1 2 3\n")), "one face turned over"


@pytest.mark.parametrize(
    ("values", "reason"),
    [
        ({"bsdf": {"type": "dielectric"}}, "is a dielectric"),
        ({"bsdf": {"type": "mask", "b": {"type": "dielectric"}}}, "is a dielectric"),
        ({"bsdf": {"type": "null"}, "interior": {"type": "homogeneous"}}, "has an interior medium"),
    ],
)
def test_open_meshes_that_must_be_closed_are_named(tmp_path, values, reason):
    with pytest.warns(SceneWarning, match=rf"s.filename: obj \"s\": .*is open, but {reason}"):
        shape(tmp_path, "open.obj", TETRAHEDRON.replace("f 1 3 2\n", ""), **values)
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        shape(tmp_path, "closed.obj", TETRAHEDRON, **values)
        shape(tmp_path, "open.obj", bsdf={"type": "thindielectric"})
        shape(tmp_path, "open.obj", bsdf={"type": "plastic"}, exterior={"type": "homogeneous"})


# ---- against Mitsuba ----


@pytest.fixture(scope="module")
def mi():
    module = pytest.importorskip("mitsuba", reason="compares with Mitsuba 3 itself")
    module.set_variant("scalar_rgb")
    return module


MATRICES = {
    "identity": np.eye(4),
    "affine": np.array([[1, 0.3, 0, 0], [0, 2, 0, 1], [0.2, 0, 1.5, 0], [0, 0, 0, 1]]),
    "mirror": np.array([[-1, 0.3, 0, 0], [0, 2, 0, 0], [0.2, 0, 1.5, 0], [0, 0, 0, 1]]),
}
FILES = {
    "computed.obj": OBJ + "f 1 2 3\nf 1 3 4\n",
    "quad.obj": OBJ + "f 1 2 3 4\nf 1 1 2\n",
    "given.obj": OBJ + "vn 0 0 2\nvn .5 0 1\nvn 0 .5 1\nf 1//1 2//2 3//3\nf 1//1 3//3 4//2\n",
    "turned.obj": OBJ + "vn 0 0 -1\nvn .1 0 -1\nf 1//1 2//2 3//1\nf 1//1 3//1 4//2\n",
    "computed.ply": PLY.replace("1 1 0\n0 1 0\n", "1 1 .3\n0 1 .1\n"),
    "given.ply": PLY.replace(
        "z\n", "z\nproperty float nx\nproperty float ny\nproperty float nz\n"
    ).replace(
        "0 0 0\n1 0 0\n1 1 0\n0 1 0\n", "0 0 0 0 0 2\n1 0 0 .3 0 1\n1 1 0 0 0 1\n0 1 .1 0 .2 1\n"
    ),
    "computed.serialized": one_mesh(("uv", "colours"), "f8"),
    "given.serialized": one_mesh(version=3),
    "flag.serialized": one_mesh(("uv",), flags=0x10),  # Mitsuba 3 ignores it
}  # fmt: skip


@pytest.mark.parametrize("name", FILES)
@pytest.mark.parametrize("matrix", MATRICES)
@pytest.mark.parametrize("flip", [False, True])
def test_vertices_and_normals_are_mitsubas(mi, tmp_path, name, matrix, flip):
    matrix = MATRICES[matrix]
    ours = shape(tmp_path, name, FILES[name], to_world=matrix, flip_normals=flip)
    theirs = mi.load_dict({
        "type": name.partition(".")[2], "filename": str(tmp_path / name), "flip_normals": flip,
        "to_world": mi.ScalarTransform4f(matrix),
    })  # fmt: skip
    params = mi.traverse(theirs)
    assert len(ours.triangles) == np.array(params["faces"]).size // 3
    positions = np.array(params["vertex_positions"]).reshape(-1, 3)
    given = name.startswith(("given", "turned"))
    turned = np.linalg.det(matrix[:3, :3]) < 0 and not given  # Mitsuba turns these inside out
    normals = np.array(params["vertex_normals"]).reshape(-1, 3) * (-1 if flip != turned else 1)
    for position, normal in zip(ours.vertices, ours.normals, strict=True):
        distance = np.abs(positions - position).max(axis=1)
        nearest = distance.argmin()  # these meshes have one normal at each position
        assert distance[nearest] < 1e-6 and np.abs(normals[nearest] - normal).max() < 1e-6
    scene = mi.load_dict({"type": "scene", "s": theirs})
    for corners, front in zip(ours.vertices[ours.triangles], facing(ours), strict=True):
        if np.isnan(front).any():
            continue
        ray = mi.Ray3f((corners.mean(axis=0) + 0.01 * front).tolist(), (-front).tolist())
        side = scene.ray_intersect(ray).wi.z * (-1 if turned else 1)
        assert side > 0, "our front is the side that Mitsuba shades"


TEXTURED = {
    "a.obj": OBJ + "vt 0 .1\nvt 1 .2\nvt .9 1\nvt -3 7\nf 1/1 2/2 3/3\nf 1/1 3/4 4/2\n",
    "n.obj": OBJ + "vt 0 .1\nvt 1 .2\nvt 2 3\nvn 0 0 -1\nvn .1 0 -1\n"
             "f 1/1/1 2/2/1 3/3/2\nf 1/1/1 3/2/2 4/2/2\n",
    "a.ply": PLY.replace("float z\n", "float z\nproperty float u\nproperty float v\n").replace(
        "0 0 0\n1 0 0\n1 1 0\n0 1 0\n", "0 0 0 0 .1\n1 0 0 .7 .2\n1 1 .3 4 5\n0 1 0 .1 .9\n"),
    "a.serialized": one_mesh(("uv", "colours")),
}  # fmt: skip


def with_uv(folder, description):
    """The triangles' corners (T, 3, 3) and texture coordinates (T, 3, 2) of a shape."""
    shapes, kind = Shapes(), description["type"]
    values = {name: param.default for name, param in PLUGINS[kind].params.items()}
    values = {**values, "to_world": np.eye(4), **description}
    node = Node(kind, "here", values={n: Value("", v, "here") for n, v in description.items()})
    shapes.add((node, values, (0, -1, -1), ""))
    arrays = shapes.arrays(with_uv=True)
    assert "uv" not in shapes.arrays() and len(arrays["uv"]) == len(arrays["vertices"])
    return arrays["vertices"][arrays["triangles"]], arrays["uv"][arrays["triangles"]]


@pytest.mark.parametrize("name", [*TEXTURED, "cube", "rectangle", "cylinder"])
@pytest.mark.parametrize("flip_tex_coords", [None, False, True])
@pytest.mark.parametrize("flip", [False, True])
@pytest.mark.parametrize("matrix", MATRICES)
def test_texture_coordinates_are_mitsubas(mi, tmp_path, name, flip_tex_coords, flip, matrix):
    description = {"type": name.rpartition(".")[2], "flip_normals": flip}
    if name in TEXTURED:
        text = TEXTURED[name]
        (tmp_path / name).write_bytes(text if isinstance(text, bytes) else text.encode())
        description["filename"] = str(tmp_path / name)
    if flip_tex_coords is not None:
        if not name.endswith(("obj", "ply")):
            pytest.skip("only obj and ply have flip_tex_coords")
        description["flip_tex_coords"] = flip_tex_coords
    corners, uv = with_uv(tmp_path, {**description, "to_world": MATRICES[matrix]})
    to_world = mi.ScalarTransform4f(MATRICES[matrix])
    scene = mi.load_dict({"type": "scene", "s": {**description, "to_world": to_world}})
    for points, values in zip(corners, uv, strict=True):
        normal = np.cross(points[1] - points[0], points[2] - points[0])
        normal *= 0.01 / np.linalg.norm(normal)
        for weights in ([0.2, 0.3, 0.5], [0.7, 0.1, 0.2]):
            ray = mi.Ray3f((weights @ points + normal).tolist(), (-normal).tolist())
            hit = scene.ray_intersect(ray)
            assert np.abs(np.array(hit.uv) - weights @ values).max() < 1e-4


def one_shape(**values):
    """The scene of a shape."""
    return load_dict({
        "type": "scene",
        "sensor": {"type": "perspective", "fov": 40.0},
        "sky": {"type": "constant"},
        "s": values,
    })  # fmt: skip


ENDS = {
    "default": {},
    "slanted": {"p0": [1, 2, 3], "p1": [2, 4, 3], "radius": 0.5},
    "down": {"p0": [0, 0, 1], "p1": [0, 0, 0], "radius": 3.0},
    "steep": {"p0": [0, 1, 0], "p1": [0.25, 1, -9], "radius": 2.0},
}
CYLINDERS = {
    **MATRICES,
    "long": np.diag([2.0, 2.0, 9.0, 1.0]),
    "flat": np.diag([1.0, 1.0, -0.125, 1.0]),
}


@pytest.mark.parametrize("ends", ENDS)
@pytest.mark.parametrize("matrix", CYLINDERS)
@pytest.mark.parametrize("flip", [False, True])
def test_cylinders_are_mitsubas(mi, ends, matrix, flip):
    """From points about the axis: hits, normals, texture coordinates and sides."""
    values = {"type": "cylinder", "flip_normals": flip, **ENDS[ends]}
    matrix = CYLINDERS[matrix]
    ours = one_shape(**values, to_world=matrix)
    theirs = mi.load_dict({
        "type": "scene", "s": {**values, "to_world": mi.ScalarTransform4f(matrix)}
    })  # fmt: skip
    corners, uv = with_uv(None, {**values, "to_world": matrix})
    points = corners.mean(axis=1)
    normals = ours.normals[ours.triangles].mean(axis=1)
    normals /= np.linalg.norm(normals, axis=1)[:, None]
    size = np.ptp(corners.reshape(-1, 3), axis=0).max()
    fronts = facing(ours)
    assert (fronts * normals).sum(axis=1).min() > 0.999
    assert len(points) == 512
    outward = normals * (-1 if flip else 1)
    for k in range(0, 512, 5):
        ray = mi.Ray3f((points[k] + 1e-3 * size * outward[k]).tolist(), (-outward[k]).tolist())
        hit = theirs.ray_intersect(ray)
        assert np.abs(np.array(hit.p) - points[k]).max() < 1.5e-4 * size
        assert np.array(hit.n) @ normals[k] > 1 - 1e-5 and (hit.wi.z > 0) != flip
        assert np.abs(np.array(hit.uv) - uv[k].mean(axis=0)).max() < 1e-3


def test_mirrors_leave_fronts_without_normals_in_front(tmp_path):
    """Of an OBJ file of whose faces some have normals, and of a PLY file with some of length 0."""
    squares = "".join(f"v {x} 0 0\nv {x + 1} 0 0\nv {x + 1} 1 0\n" for x in (-2, 0))
    (tmp_path / "a.obj").write_text(squares + "vn 0 0 1\nvn .05 0 1\nf 1//1 2//2 3//1\nf 4 5 6\n")
    rows = "-2 0 0 0 0 1\n-1 0 0 .05 0 1\n-1 1 0 0 0 1\n0 0 0 0 0 0\n1 0 0 0 0 0\n1 1 0 0 0 0\n"
    names = "".join(f"property float {name}\n" for name in ("x", "y", "z", "nx", "ny", "nz"))
    (tmp_path / "a.ply").write_text(
        f"ply\nformat ascii 1.0\nelement vertex 6\n{names}element face 2\n"
        f"property list uchar int vertex_indices\nend_header\n{rows}3 0 1 2\n3 3 4 5\n"
    )
    for kind in ("obj", "ply"):
        for matrix in (np.eye(4), np.diag([-1.0, 1, 1, 1]), np.diag([1.0, 1, -1, 1])):
            file = str(tmp_path / f"a.{kind}")
            scene = one_shape(type=kind, filename=file, to_world=matrix)
            assert (facing(scene)[:, 2] * matrix[2, 2] > 0).all()


def test_cylinders_are_as_near_as_stated():
    scene = one_shape(type="cylinder", radius=0.5, p1=[0, 0, 4])
    a, b, c = (scene.vertices[scene.triangles[:, k]] for k in range(3))
    area = np.linalg.norm(np.cross(b - a, c - a), axis=1).sum() / 2
    assert 1 - area / (4 * math.pi) == pytest.approx(2.51e-5, rel=1e-3)
    radii = np.linalg.norm(scene.vertices[:, :2], axis=1)
    assert np.abs(radii - 0.5).max() < 1e-15
    middle = np.linalg.norm(((a + b) / 2)[::2, :2], axis=1)
    assert 1 - middle.min() / 0.5 == pytest.approx(7.53e-5, rel=1e-3)
    assert (np.abs(np.linalg.norm(scene.normals, axis=1) - 1) < 1e-15).all()
    assert set(scene.vertices[:, 2]) == {0.0, 4.0}
    turned = one_shape(type="cylinder", to_world=np.diag([-1.0, 1, 1, 1]))
    assert (facing(turned)[:, :2] * turned.vertices[turned.triangles[:, 0]][:, :2]).sum() > 0


@pytest.mark.parametrize(
    ("half", "z"), [(1e5, 0.0), (1e6, -999_950.0), (1e8, 0.0), (1e8, 99_999_950.0)]
)
def test_slender_cylinders_lose_no_light(half, z):
    """White ones, 2e4 to 2e7 times as long as thick, in an even sky, near an end or the middle."""
    scene = load_dict({
        "type": "scene", "sky": {"type": "constant", "radiance": 0.5},
        "sensor": {"type": "perspective", "fov": 6.0,
                   "to_world": transform.look_at([-20, -100, z + 10], [0, 0, z], [0, 0, 1])},
        "pole": {"type": "cylinder", "radius": 5.0, "p0": [0, 0, -half], "p1": [0, 0, half],
                 "bsdf": {"type": "diffuse", "reflectance": 1.0}},
    })  # fmt: skip
    picture = veriray.render(scene, spp=256, width=32, height=32, device="cpu", seed=1)
    # the normals of 256 sides cost 1e-5 of the light (docs/mitsuba.md)
    assert 0 <= 1 - picture.image.mean() / 0.5 < 2e-5


def test_a_closed_cylinder_leaks_no_light():
    """Black from within, with disks as ends, under a bright sky: 65,536 paths see nothing."""
    black = {"type": "twosided", "b": {"type": "diffuse", "reflectance": 0.0}}
    for k, target in enumerate(([0.3, 0.1, 2], [1, 0.2, 0.1], [-0.2, 1, -2], [0.1, 0.1, 1.1])):
        place = transform.look_at([0.1, -0.2, 0.3], target, [1, 2, 3])
        scene = load_dict({
            "type": "scene", "sky": {"type": "constant", "radiance": 1e30},
            "sensor": {"type": "perspective", "fov": 150.0, "to_world": place},
            "side": {"type": "cylinder", "p0": [0, 0, -1], "bsdf": black},
            "low": {"type": "disk", "to_world": transform.translate([0, 0, -1]), "bsdf": black},
            "high": {"type": "disk", "to_world": transform.translate([0, 0, 1]), "bsdf": black},
        })  # fmt: skip
        picture = veriray.render(scene, spp=16, width=32, height=32, device="cpu", seed=k)
        assert not picture.image.any()


@pytest.mark.parametrize(
    ("values", "message"),
    [
        ({"p1": [0, 0, 0]}, 's: cylinder "s": p0 and p1 are the same point'),
        ({"radius": 0}, r'"radius" = 0 is outside \(0, 1e\+100\)'),
        ({"radius": -1.0}, r'"radius" = -1.0 is outside \(0, 1e\+100\)'),
        ({"p0": [1e101, 0, 0]}, '"p0"'),
        ({"radius": 9e99, "p0": [9e99, 0, 0], "p1": [9e99, 0, 1]}, "a vertex exceeds 1e\\+100"),
        ({"radius": 9e99, "to_world": np.diag([1e99, 1e99, 1e99, 1])}, "a vertex exceeds"),
        ({"p1": [0, 0, 1e99], "to_world": np.full((4, 4), 1e100)}, "to_world"),
    ],
)
def test_bad_cylinders(values, message):
    with pytest.raises(SceneError, match=message):
        one_shape(type="cylinder", **values)


# ---- arrays ----

TRIANGLE = {"type": "mesh", "vertices": [[0, 0, 0], [1, 0, 0], [0, 1, 0]], "faces": [[0, 1, 2]]}


def test_arrays_are_a_file(tmp_path):
    ball = trimesh.creation.icosphere(subdivisions=2)
    (tmp_path / "b.obj").write_text(ball.export(file_type="obj", include_normals=False, digits=17))
    matrix = MATRICES["mirror"]
    filed = shape(tmp_path, "b.obj", to_world=matrix, flip_normals=True)
    arrays = one_shape(type="mesh", vertices=ball.vertices.tolist(), faces=ball.faces,
                       to_world=matrix, flip_normals=True)  # fmt: skip
    assert arrays.sha256 == filed.sha256 and arrays.normals.any()
    scene = load_dict({"type": "scene", "sensor": {"type": "perspective", "fov": 40.0},
                       "sky": {"type": "constant"}, "ball": ball})  # fmt: skip
    assert scene.sha256 == one_shape(type="mesh", mesh=ball).sha256
    assert scene.shape_names == ("ball",)
    assert scene.sha256 == one_shape(type="obj", filename=tmp_path / "b.obj").sha256
    red = one_shape(type="mesh", mesh=ball, face_normals=True,
                    bsdf={"type": "diffuse", "reflectance": 0.25})  # fmt: skip
    assert red.reflectance.tolist() == [[0.25] * 3] and not red.normals.any()


def test_arrays_with_normals():
    scene = one_shape(**TRIANGLE, normals=[[0, 0, -2], [0.5, 0, -1], [0, 0, 0]])
    lengths = np.linalg.norm(scene.normals, axis=1)
    assert lengths.tolist() == pytest.approx([1, 1, 0])


def test_texture_coordinates_of_arrays(tmp_path):
    uv = np.array([[0, 0.25], [1, 0.5], [-2, 3]])
    for flip in (False, True):
        made = trimesh.Trimesh(TRIANGLE["vertices"], TRIANGLE["faces"], process=False)
        made.visual = trimesh.visual.TextureVisuals(uv=uv)
        tree = mitsuba_dict._described(made)
        assert tree["flip_tex_coords"] is True and (tree["uv"] == uv).all()
        _, found = with_uv(tmp_path, {**TRIANGLE, "uv": uv, "flip_tex_coords": flip})
        assert (found[0] == (uv * [1, -1] + [0, 1] if flip else uv)).all()
    one_shape(type="mesh", mesh=made)


class Odd:
    @property
    def vertices(self):
        raise RuntimeError("no")


@pytest.mark.parametrize(
    ("values", "message"),
    [
        ({"vertices": None}, r's.vertices: mesh "s": "vertices" cannot be read as numbers'),
        ({"vertices": "abc"}, "s.vertices: .* cannot be read as numbers"),
        ({"vertices": [[0, 1]]}, r"has shape \(1, 2\), expected \(n, 3\)"),
        ({"vertices": [[0, 1], [0]]}, "s.vertices: .* is not an array"),
        ({"vertices": [[0, 0, np.nan]] * 3}, "must be finite"),
        ({"vertices": [[0, 0, 1e101]] * 3}, r"vertex 0 has the coordinate 1e\+101"),
        ({"faces": [[0, 1, 3]]}, r'mesh "s": triangle 0 uses vertex 3, outside \[0, 2\]'),
        ({"faces": [[0, 1, -1]]}, "uses vertex -1, outside"),
        ({"faces": [[0.0, 1.0, 2.0]]}, "has dtype float64, expected integers"),
        ({"faces": [[0, 1, 2, 3]]}, r"has shape \(1, 4\), expected \(n, 3\)"),
        ({"faces": []}, "holds no triangles"),
        ({"faces": {"type": "cube"}}, "cannot be read as numbers"),
        ({"uv": [[0, 0]]}, '"uv" has 1 rows for 3 vertices'),
        ({"uv": [[0, 0], [1, 1], [0, 1e31]]}, r"the texture coordinate 1e\+31"),
        ({"normals": [[0, 0, 1]]}, '"normals" has 1 rows for 3 vertices'),
        ({"filename": "a.obj"}, "unknown parameter"),
        ({"mesh": 3}, 'unknown parameter "mesh" = 3'),
        ({"mesh": Odd()}, "is not a value that a scene can hold"),
    ],
)
def test_bad_arrays(values, message):
    with pytest.raises(SceneError, match=message):
        one_shape(**{**TRIANGLE, **values})


def test_a_file_holds_no_arrays(tmp_path):
    (tmp_path / "a.xml").write_text(
        """<scene version="3.0.0"><sensor type="perspective"><float name="fov" value="40"/></sensor>
        <shape type="mesh"/></scene>"""
    )
    with pytest.raises(SceneError, match=r'a.xml:2: mesh: "vertices" \(array\) is missing'):
        veriray.load_file(tmp_path / "a.xml")


def test_texture_coordinates_are_finite(tmp_path):
    text = TEXTURED["a.ply"].replace("4 5", "4 nan")
    with pytest.raises(SceneError, match=r"vertex 2 has the texture coordinate nan; .* 1e\+30"):
        shape(tmp_path, "a.ply", text)


def test_errors_name_the_file(tmp_path):
    with pytest.raises(SceneError, match=r"s.filename: .*mesh.stl\" is not STL"):
        shape(tmp_path, "mesh.stl", "solid")


def _ply(dtype, order, kind, properties=(), faces=None):
    """A PLY file of 3,000 vertices and its parts; faces: (F, 3 or 4)."""
    rng = np.random.default_rng(7)
    count = 3000
    names = ["x", "y", "z", *properties]
    table = np.zeros(count, [(name, dtype) for name in names])
    for name in names:
        table[name] = rng.normal(size=count)
    table["x"][:5] = -0.0
    faces = rng.integers(0, count, (9000, 3)) if faces is None else faces
    lists = np.zeros(len(faces), [("n", "u1"), ("flag", order + "i2"), ("i", kind, faces.shape[1])])
    lists["n"], lists["i"] = faces.shape[1], faces
    words = {"i4": "int", "u4": "uint", "u2": "ushort"}
    form = "little" if order == "<" else "big"
    head = [f"ply\nformat binary_{form}_endian 1.0\nelement vertex {count}"]
    head += [f"property {'float' if dtype[1:] == 'f4' else 'double'} {name}" for name in names]
    head += [f"element face {len(faces)}", "property short flag"]
    head += [f"property list uchar {words[kind[1:]]} vertex_index", "end_header\n"]
    lists = lists[["flag", "n", "i"]].astype(
        [("flag", order + "i2"), ("n", "u1"), ("i", kind, faces.shape[1])]
    )
    return "\n".join(head).encode() + table.tobytes() + lists.tobytes()


@pytest.mark.parametrize("order", "<>")
@pytest.mark.parametrize("dtype, kind", [("f4", "i4"), ("f8", "u4"), ("f4", "u2")])
@pytest.mark.parametrize("sides", [3, 4])
@pytest.mark.parametrize("properties", [(), ("nx", "ny", "nz"), ("s", "t", "nz", "u", "v")])
def test_ply_piece_by_piece_is_ply_as_a_whole(tmp_path, monkeypatch, order, dtype, kind, sides,
                                              properties):  # fmt: skip
    """Large files are read in pieces by several threads: the same arrays."""
    faces = np.random.default_rng(5).integers(0, 3000, (1000, sides))
    data = _ply(order + dtype, order, order + kind, properties, faces)
    (tmp_path / "m.ply").write_bytes(data)
    monkeypatch.setattr(ply_pieces, "LEAST", 1)
    monkeypatch.setattr(ply_pieces, "PIECE", 4099)
    whole = ply.read(data)
    tables = ply_pieces.read(tmp_path / "m.ply", len(data))
    assert tables is not None
    for table, values in zip(tables, whole[:4], strict=True):
        assert (table is None) == (values is None)
        if table is not None:
            assert np.array_equal(table.values, values) and table.values.dtype.kind in "fu"
            assert table.extremes == (values.min(), values.max())
            assert not np.signbit(table.values[table.values == 0]).any()
    assert ply_pieces.read(tmp_path / "m.ply", len(data) - 1) is None


@pytest.mark.parametrize(
    "change",
    [
        lambda data: data[:-1],
        lambda data: data + b"\0",
        lambda data: data[:-12] + b"\xff\xff\xff\x7f" + data[-8:],  # an index
        lambda data: data[:-13] + b"\x04" + data[-12:],  # a list's length
        lambda data: data.replace(b"element face 9000", b"element face 9001"),
        lambda data: data.replace(b"property float z", b"property float w"),
        lambda data: data.replace(b"end_header\n", b"end_header\n" + b"\0\0\xc0\x7f", 1)[:-4],
    ],
)
def test_damaged_ply_pieces_are_left_to_the_other_reader(tmp_path, monkeypatch, change):
    """Its messages are the only ones."""
    data = change(_ply("<f4", "<", "<i4"))
    (tmp_path / "m.ply").write_bytes(data)
    messages = []
    for least in (1, 2**30):
        monkeypatch.setattr(ply_pieces, "LEAST", least)
        with pytest.raises(SceneError) as caught:
            mesh.read(tmp_path / "m.ply", "ply", "here")
        messages.append(str(caught.value))
    assert messages[0] == messages[1]


def test_a_mesh_read_in_pieces_makes_the_same_scene(tmp_path, monkeypatch):
    (tmp_path / "m.ply").write_bytes(_ply("<f4", "<", "<i4", ("nx", "ny", "nz")))
    turned = [[0, -1, 0, 3], [1, 0, 0, 0], [0, 0, 2, 0], [0, 0, 0, 1]]
    shapes = {"type": "ply", "filename": str(tmp_path / "m.ply")}
    for more in ({}, {"face_normals": True}, {"to_world": np.array(turned)}, {"other": "cube"}):
        found: dict[str, object] = {"type": "scene", "m": {**shapes, **more}}
        if "other" in more:
            found = {"type": "scene", "m": shapes, "c": {"type": "cube"}, "n": shapes}
        hashes = set()
        for least in (1, 2**30):
            monkeypatch.setattr(ply_pieces, "LEAST", least)
            scene = load_dict(found)
            hashes.add(scene.sha256)
            assert all(not getattr(scene, name).flags.writeable for name in COLUMNS)
        assert len(hashes) == 1


@pytest.mark.parametrize("scale", [1.0, 1e-90, 1e90])
def test_native_normals_have_the_bits_of_numpys(monkeypatch, scale):
    """A folded, closed mesh with faces without area, single vertices and doubled ones."""
    rng = np.random.default_rng(11)
    count = 3000
    vertices = rng.normal(size=(count, 3)) * scale
    vertices[100:200] = vertices[:100]
    triangles = rng.integers(0, count - 50, (9000, 3)).astype(np.uint32)
    triangles[:50, 1] = triangles[:50, 0]
    found, looks = [], []
    for native in (1, 10**9):
        monkeypatch.setattr(mesh, "NATIVE", native)
        assert (mesh._native(triangles) is None) == (native > 1)
        normals = mesh.vertex_normals(vertices, triangles)
        found.append(normals)
        for part in (triangles, triangles[:1], triangles[5000:5003], triangles[:40]):
            for given in (normals, -normals, mesh.face_normals(vertices, triangles)[:count]):
                turned, flat = mesh.shading(vertices, part, given)
                looks.append((native, turned.tobytes(), flat))
    assert found[0].tobytes() == found[1].tobytes() and not found[0][-50:].any()
    half = len(looks) // 2
    assert [x[1:] for x in looks[:half]] == [x[1:] for x in looks[half:]]
    assert {x[2] for x in looks} == {False, True}
    with pytest.raises(ValueError, match="corner"):
        monkeypatch.setattr(mesh, "NATIVE", 1)
        mesh.vertex_normals(vertices, triangles + np.uint32(count))


def test_columns_of_one_number_are_columns_of_many(tmp_path):
    """Columns that keep one number for all rows: the same hash, native tables and picture."""
    trimesh.creation.icosphere(5).export(tmp_path / "m.ply")
    shape = {"type": "ply", "filename": str(tmp_path / "m.ply"), "face_normals": True}
    found = {"type": "scene", "sky": {"type": "constant"}, "a": shape}
    found["a"] = {**shape, "bsdf": {"type": "dielectric"}}
    for more in ({}, {"b": {**shape, "lamp": {"type": "area"}}}):
        scene = load_dict({**found, **more}).with_(width=8, height=8, max_depth=3)
        alike = [name for name in COLUMNS if not any(getattr(scene, name).strides)]
        assert "triangle_boundary" in alike
        dense = {field.name: getattr(scene, field.name) for field in dataclasses.fields(scene)}
        dense |= {name: np.array(dense[name]) for name in alike}
        whole = veriray.Scene(**dense)
        assert whole.sha256 == scene.sha256
        both = [veriray.render(s, spp=2, device="cpu").film_sha256 for s in (scene, whole)]
        assert both[0] == both[1]
        for name in alike:
            again = veriray.Scene(**{**dense, name: getattr(scene, name)})
            assert again.sha256 == scene.sha256 and not getattr(again, name).flags.writeable
    with pytest.raises(SceneError, match=r"triangle_emission\[0\] = 7 is outside"):
        veriray.Scene(**{**dense, "triangle_emission": np.broadcast_to(7, 2 * 20480)})


@pytest.mark.parametrize("kind", ["obj", "ply"])
def test_a_mesh_file_of_several_shapes_is_parsed_once(tmp_path, monkeypatch, kind):
    """And shows in each what it shows alone, whatever stands between them."""
    trimesh.creation.icosphere(2).export(tmp_path / f"a.{kind}")
    trimesh.creation.box().export(tmp_path / f"b.{kind}")
    parsed = []
    original = mesh.read

    def read(path, *arguments, **more):
        parsed.append(path.name)
        return original(path, *arguments, **more)

    monkeypatch.setattr(mesh, "read", read)

    def shape(number, name):
        placed = f'<transform name="to_world"><scale value="{number}"/></transform>'
        flips = f'<boolean name="flip_normals" value="{str(number == 3).lower()}"/>'
        return (
            f'<shape type="{kind}"><string name="filename" value="{name}"/>{placed}{flips}</shape>'
        )

    def loaded(*names):
        text = "".join(shape(number, name) for number, name in enumerate(names, 1))
        (tmp_path / "scene.xml").write_text(
            f'<scene version="3.0.0"><emitter type="constant"/>{text}</scene>'
        )
        return veriray.load_file(tmp_path / "scene.xml")

    once = loaded(f"a.{kind}", f"b.{kind}", f"a.{kind}", f"a.{kind}")
    assert parsed == [f"a.{kind}", f"b.{kind}"]
    for copy in "cd":
        (tmp_path / f"{copy}.{kind}").write_bytes((tmp_path / f"a.{kind}").read_bytes())
    apart = loaded(f"a.{kind}", f"b.{kind}", f"c.{kind}", f"d.{kind}")
    assert once.sha256 == apart.sha256


@pytest.mark.parametrize("largest", [5, 2**31])
def test_distinct_corners_are_those_of_rows(largest):
    """By one integer a row, and where that cannot hold three indices."""
    corners = np.random.default_rng(2).integers(-1, 5, (200, 3))
    corners[0] = largest
    rows, inverse = np.unique(corners, axis=0, return_inverse=True)
    found = mesh.distinct(corners)
    assert (found[0] == rows).all() and (found[1] == inverse.reshape(-1)).all()
