"""OBJ files as scenes: shapes by material, and what MTL files say."""

import math
import re
import warnings

import numpy as np
import pytest
from PIL import Image

import veriray
from veriray.columns import MATERIAL_KINDS
from veriray.errors import SceneError, SceneWarning
from veriray.formats import images

OBJ = """mtllib a.mtl
v 0 0 0
v 1 0 0
v 1 1 0
v 0 1 0
vt 0 0.25
vt 1 0
vt 1 1
vt 0 1
f 1/1 2/2 3/3
usemtl one
f 1/1 2/2 3/3 4/4
usemtl two words
f 1/1 3/3 4/4
usemtl one # again
f 2/2 3/3 4/4
"""
MTL = "newmtl one\nKd 0.25 0.5 0.75\n\nnewmtl two words\nKd 1 0 0\nKe 2 3 4\n"


PLAIN = OBJ.replace(" # again", "")


def load(folder, mtl=MTL, obj=PLAIN):
    (folder / "a.mtl").write_text(mtl, "utf-8")
    (folder / "a.obj").write_text(obj, "utf-8")
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always")
        scene = veriray.load_file(folder / "a.obj")
    assert all(w.category is SceneWarning for w in caught)
    return scene, "; ".join(str(w.message) for w in caught)


def test_faces_by_material(tmp_path):
    scene, text = load(tmp_path)
    assert scene.shape_names == ("mesh_0", "one", "two words") and "sky" not in text
    assert scene.triangle_shape.tolist() == [0, 1, 1, 1, 2]
    rows = scene.triangle_material
    assert scene.reflectance[rows].tolist() == [[0.5] * 3] + [[0.25, 0.5, 0.75]] * 3 + [[1, 0, 0]]
    assert scene.two_sided[rows].all() and scene.triangle_emission.tolist() == [-1] * 4 + [0]
    assert scene.emissions.tolist() == [[2, 3, 4]]
    corners = scene.vertices[scene.triangles]
    assert corners[1].tolist() == [[0, 0, 0], [1, 0, 0], [1, 1, 0]]
    assert corners[3].tolist() == [[1, 0, 0], [1, 1, 0], [0, 1, 0]]
    assert any("placed that frames the file" in note for note in scene.notes)


@pytest.mark.parametrize("marked", ["obj", "mtl", "both"])
@pytest.mark.parametrize("first", ["mtllib", "v"])
def test_byte_order_marks_are_read_over(tmp_path, marked, first):
    library, rest = PLAIN.split("\n", 1)
    assert library.startswith("mtllib")
    obj = PLAIN if first == "mtllib" else rest.replace("usemtl", f"{library}\nusemtl", 1)
    files = {"obj": obj, "mtl": MTL}
    plain = load(tmp_path, **files)[0].sha256
    marks = {key: "\ufeff" + files[key] for key in files if marked in (key, "both")}
    assert load(tmp_path, **files | marks)[0].sha256 == plain


def one(folder, lines, obj=None):
    """The columns of the only material of an OBJ file, and what it warns of."""
    obj = obj or OBJ.split("usemtl two")[0].replace("f 1/1 2/2 3/3\n", "", 1)
    scene, text = load(folder, f"newmtl one\n{lines}\n", obj)
    return scene, scene.triangle_material[0], text


@pytest.mark.parametrize(
    ("lines", "kind", "columns"),
    [
        ("", "diffuse", {"reflectance": [0.5] * 3}),
        ("Kd 0.25", "diffuse", {"reflectance": [0.25] * 3}),
        ("Kd 0.25 0.5 1\nKs 1 1 1\nillum 1", "diffuse", {"reflectance": [0.25, 0.5, 1]}),
        ("Kd 0.25\nKs 0.5 1 1\nNs 6\nillum 2", "roughplastic",
         {"reflectance": [0.25] * 3, "specular_reflectance": [0.5, 1, 1], "alpha_u": 0.5}),
        ("Kd 0 0 0\nKs 0.5 1 1\nNs 48", "roughconductor",
         {"specular_reflectance": [0.5, 1, 1], "alpha_u": np.float32(0.2)}),
        ("Kd 1 0 0\nKs 0.5 1 1\nillum 3", "roughconductor", {"alpha_u": 1}),
        ("Ni 1.25\nTf 0.5 1 1\nillum 7\nd 0.5", "dielectric",
         {"eta": [1.25] * 3, "specular_transmittance": [0.5, 1, 1], "opacity": 1}),
        ("Kd 0.25\nd -halo 0.5", "diffuse", {"opacity": 0.5}),
        ("Kd 0.25\nTr 0.25", "diffuse", {"opacity": 0.75}),
        ("Kd 0.25\nd 1\nTr 1", "diffuse", {"opacity": 1}),
        ("Kd 0.25\nPr 0.5\nPm 1", "principled",
         {"reflectance": [0.25] * 3, "roughness": 0.5, "metallic": 1}),
    ],
)  # fmt: skip
def test_materials(tmp_path, lines, kind, columns):
    scene, row, _ = one(tmp_path, lines)
    assert MATERIAL_KINDS[scene.material_kind[row]] == kind
    assert scene.two_sided[row] == (kind != "dielectric")
    for name, value in columns.items():
        assert np.array(getattr(scene, name)[row]).tolist() == value


def test_textures(tmp_path):
    texels = np.random.default_rng(1).integers(0, 256, (3, 5, 3)).astype(np.uint8)
    Image.fromarray(texels).save(tmp_path / "a b.png")
    scene, row, text = one(
        tmp_path, "Kd 1 1 1\nmap_Kd -s 2 3 1 -o 0.5 -clamp on a b.png\nbump a b.png"
    )
    at = int(scene.reflectance_texture[row])
    # 3 v of the file, which is up: 1 - 3 (1 - v) of the v that is down
    assert scene.texture_to_uv[at].tolist() == [[2, 0, 0.5], [0, 3, -2]]
    assert scene.texture_wrap[at] == 2 and "bump" in text and "not applied" in text
    assert (scene.texels.view(np.uint8).reshape(3, 5, 4)[..., :3] == texels).all()
    assert scene.uv[:, 1].tolist()[0] == 0.75  # v is up in the file, and down in an image
    scene, row, _ = one(tmp_path, "Kd 1 0.5 0.25\nmap_Kd a b.png")
    found = scene.texels[:45].view(np.float32).reshape(3, 5, 3)
    assert (found == images.SRGB_TO_LINEAR[texels] * np.array([1, 0.5, 0.25], np.float32)).all()
    scene, row, _ = one(tmp_path, "Kd 0 0 0\nKs 1 1 1\nmap_Kd a b.png\nmap_d a b.png")
    assert MATERIAL_KINDS[scene.material_kind[row]] == "roughplastic"
    assert scene.opacity_texture[row] >= 0 and scene.reflectance_texture[row] >= 0


def texels_of(scene, at, shape):
    """The texels of a texture in float32."""
    first = int(scene.texture_first[at])
    return scene.texels[first : first + math.prod(shape)].view(np.float32).reshape(shape)


@pytest.mark.parametrize("given", ["-s 2 3 1", "-o 0.2 0.3", "-o 0.2 0.3 0 -s 2 3"])
def test_textures_are_placed_with_v_up(tmp_path, given):
    """s and o of a texture act on the coordinates of the file; 0 is the lowest row."""
    texels = np.random.default_rng(4).integers(0, 256, (4, 5, 3)).astype(np.uint8)
    Image.fromarray(texels).save(tmp_path / "a.png")
    scene, row, _ = one(tmp_path, f"Kd 1 1 1\nmap_Kd {given} a.png")
    matrix = scene.texture_to_uv[int(scene.reflectance_texture[row])]
    s = [2, 3] if "-s" in given else [1, 1]
    o = [0.2, 0.3] if "-o" in given else [0, 0]
    for u, v in ((0.0, 0.25), (1.0, 0.0), (1.0, 1.0), (0.25, 0.5)):
        place = matrix @ [u, 1 - v, 1]  # the v of meshes here is down
        assert place == pytest.approx([s[0] * u + o[0], 1 - (s[1] * v + o[1])], abs=1e-6)


def test_a_map_without_kd_is_taken_as_it_is(tmp_path):
    texels = np.random.default_rng(1).integers(0, 256, (3, 5, 3)).astype(np.uint8)
    Image.fromarray(texels).save(tmp_path / "a.png")
    scene, _, _ = one(tmp_path, "map_Kd a.png")
    assert (scene.texels.view(np.uint8).reshape(3, 5, 4)[..., :3] == texels).all()


def test_base_and_gain_of_textures(tmp_path):
    texels = np.random.default_rng(1).integers(0, 256, (3, 5, 3)).astype(np.uint8)
    Image.fromarray(texels).save(tmp_path / "a.png")
    scene, row, text = one(
        tmp_path, "Kd 1 0.5 1\nmap_Kd -mm 0.25 0.5 a.png\nmap_d -mm 0.5 0.25 a.png"
    )
    linear = images.SRGB_TO_LINEAR[texels].astype(float)
    found = texels_of(scene, scene.reflectance_texture[row], (3, 5, 3))
    assert np.abs(found - (0.25 + 0.5 * linear) * [1, 0.5, 1]).max() < 1e-6
    found = texels_of(scene, scene.opacity_texture[row], (3, 5, 3))
    assert np.abs(found - (0.5 + 0.25 * texels / 255)).max() < 1e-6
    assert "applied" not in text


@pytest.mark.parametrize("channel", ["r", "g", "b", "m", "l", "z"])
def test_channels_of_textures(tmp_path, channel):
    texels = np.random.default_rng(1).integers(0, 256, (3, 5, 4)).astype(np.uint8)
    Image.fromarray(texels).save(tmp_path / "a.png")
    lines = f"Kd 1 1 1\nmap_Kd -imfchan {channel} a.png\nmap_d -imfchan {channel} a.png"
    scene, row, text = one(tmp_path, lines)
    assert ('"-imfchan z" of a material is not applied' in text) == (channel == "z")
    at = scene.reflectance_texture[row], scene.opacity_texture[row]
    if channel == "z":
        assert scene.texture_format[list(at)].tolist() == [0, 1]  # of 8 bits, as they are
        return
    tables = images.SRGB_TO_LINEAR[texels].astype(float), texels / 255
    for row, table in zip(at, tables, strict=True):
        expected = table[..., :3] @ [0.212671, 0.71516, 0.072169]
        if channel == "m":
            expected = texels[..., 3] / 255
        elif channel != "l":
            expected = table[..., "rgb".index(channel)]
        assert scene.texture_grey[row]
        assert np.abs(texels_of(scene, row, (3, 5)) - expected).max() < 1e-6


def test_turbulence_is_said(tmp_path):
    Image.fromarray(np.zeros((2, 2, 3), np.uint8)).save(tmp_path / "a.png")
    _, _, text = one(tmp_path, "map_Kd -t 1 0.5 a.png")
    assert 'a.mtl:2: "-t 1 0.5" of a material is not applied' in text
    for given, said in (("0 0 0", False), ("0.0 -0", False), ("0 0 0.01", True), ("0e5", False)):
        assert ("not applied" in one(tmp_path, f"map_Kd -t {given} a.png")[2]) == said


def test_a_texture_may_be_scaled_to_a_line(tmp_path):
    texels = np.random.default_rng(5).integers(0, 256, (4, 6, 3)).astype(np.uint8)
    Image.fromarray(texels).save(tmp_path / "a.png")
    for scale, column in (("0 1", 0), ("1 0", 1), ("0", 0)):
        scene, row, text = one(tmp_path, f"map_Kd -s {scale} a.png")
        place = scene.texture_to_uv[int(scene.reflectance_texture[row])]
        assert np.abs(place[:, column]).max() < 1e-30 and place[1 - column, 1 - column] == 1
        assert "singular" not in text


def test_numbers_of_a_map_are_shares(tmp_path):
    Image.fromarray(np.full((2, 2, 3), [255, 0, 0], np.uint8)).save(tmp_path / "a.png")
    scene, row, text = one(tmp_path, "map_Kd -mm -0.5 2 a.png")
    assert "a.mtl:2: numbers of map_Kd outside [0, 1] are shown as 0 or 1" in text
    assert "Mitsuba" not in text
    found = texels_of(scene, int(scene.reflectance_texture[row]), (2, 2, 3))
    assert (found == [1, 0, 0]).all()


EDGES = "v 0 0 0\nv 1 0 0\nv 1 1 0\nv 0 1 0\nv 1 0 1\nv 1 1 1\nv 2 0 1\nv 2 1 1\n"
STEPS = ("f 1 2 3 4\n", "f 2 5 6 3\n", "f 5 7 8 6\n")  # floors at z 0 and 1, a wall between


def cosines(scene):
    """Of the normals at all corners with their faces'; 1 for a flat scene."""
    table = scene.vertices[scene.triangles]
    flat = np.cross(table[:, 1] - table[:, 0], table[:, 2] - table[:, 0])
    flat /= np.linalg.norm(flat, axis=1, keepdims=True)
    normals = scene.normals[scene.triangles]
    normals = np.where(normals.any(axis=2, keepdims=True), normals, flat[:, None])
    return (normals * flat[:, None]).sum(axis=2), table[..., 0]


@pytest.mark.parametrize("given", ["", "s off\n", "s 0\n", "s 1\ns off\n"])
def test_faces_of_no_smoothing_group_are_flat(tmp_path, given):
    scene, _ = load(tmp_path, obj=EDGES + given + "".join(STEPS))
    assert not scene.normals.any()


@pytest.mark.parametrize("textured", [False, True])
@pytest.mark.parametrize("material", ["", "usemtl one\n"])
def test_faces_are_smooth_within_their_smoothing_group(tmp_path, textured, material):
    """The first two of three are, also across materials and seams of texture coordinates."""
    faces = ["s 4\n" + STEPS[0], material + STEPS[1], "s 9 # another\n" + STEPS[2]]
    obj = EDGES + "vt 0 0\nvt 1 1\nmtllib a.mtl\n" + "".join(faces)
    if textured:
        obj = re.sub(r"f (\d) (\d) (\d) (\d)", r"f \1/1 \2/1 \3/1 \4/1", obj, count=1)
        obj = re.sub(r"f (\d) (\d) (\d) (\d)", r"f \1/2 \2/2 \3/2 \4/2", obj)
    found, x = cosines(load(tmp_path, obj=obj)[0])
    half = math.sqrt(0.5)  # between a floor and the wall
    expected = np.where(x == 1, half, 1.0)
    expected[2:4] = [half, 1, 1], [half, 1, half]  # of the wall, z is 0 in the common edge
    expected[4:] = 1
    assert np.abs(found - expected).max() < 1e-6
    found, _ = cosines(load(tmp_path, obj=obj.replace("s 9", "s off"))[0])
    assert np.abs(found - expected).max() < 1e-6
    found, _ = cosines(load(tmp_path, obj=obj.replace("s 9", "s 4"))[0])
    assert np.abs(found - np.where(x == 1, half, 1.0)).max() < 1e-6


def test_smoothing_groups_are_not_of_files_with_normals(tmp_path):
    obj = EDGES + "vn 0 0.6 0.8\ns off\nf 1//1 2//1 3//1\n"
    scene, _ = load(tmp_path, obj=obj)
    assert np.abs(scene.normals[scene.triangles] - [0, 0.6, 0.8]).max() < 1e-7


def test_smoothing_groups_are_not_of_obj_shapes(tmp_path):
    (tmp_path / "a.obj").write_text(EDGES + "s off\n" + "".join(STEPS))
    shape = {"type": "obj", "filename": str(tmp_path / "a.obj")}
    scene = {"type": "scene", "shape": shape, "sky": {"type": "constant"}}
    assert veriray.load_dict(scene).normals.any()


def coloured(obj):
    """With a colour for each of the first four vertices."""
    rows = iter(["1 0 0", "0 1 0.5", "0.25 0.5 1", "1 1 1"])
    return re.sub(r"(?m)^v .*$", lambda line: f"{line[0]} {next(rows)}", obj)


def vertex_colours(scene):
    """At the corners of triangles."""
    at = int(scene.reflectance_texture[scene.triangle_material[0]])
    first = int(scene.texture_first[at])
    return scene.attribute_values[first : first + len(scene.vertices)][scene.triangles]


def test_colours_of_vertices(tmp_path):
    """Times Kd, which is 1 where it is not given; a map_Kd stands in their place."""
    obj = OBJ.split("usemtl two")[0].replace("f 1/1 2/2 3/3\n", "", 1)
    colours = np.array([[1, 0, 0], [0, 1, 0.5], [0.25, 0.5, 1], [1, 1, 1]])
    for lines, factor in (("", 1), ("Kd 0.5 0.25 1", [0.5, 0.25, 1]), ("Kd 0.5\nKs 1 1 1", 0.5)):
        scene, _, _ = one(tmp_path, lines, coloured(obj))
        expected = colours[[[0, 1, 2], [0, 2, 3]]] * factor
        assert np.abs(vertex_colours(scene) - expected).max() < 1e-6
    bare = coloured(EDGES.split("v 1 0 1")[0]) + "f 1 2 3\n"
    assert (vertex_colours(load(tmp_path, obj=bare)[0]) == colours[:3]).all()
    smooth = coloured(EDGES.split("v 1 0 1")[0]) + "s 1\nf 1 2 3\ns 2\nf 3 4 1\n"
    found = vertex_colours(load(tmp_path, obj=smooth)[0])
    assert (found == colours[[[0, 1, 2], [2, 3, 0]]]).all()
    bytes_ = re.sub(r"(?m)^(v .*) \S+ \S+ \S+$", r"\1 51 0 255", bare)
    assert np.abs(vertex_colours(load(tmp_path, obj=bytes_)[0]) - [0.2, 0, 1]).max() < 1e-6
    some = bare.replace(" 0 1 0.5\n", "\n", 1)  # white where there is none
    assert vertex_colours(load(tmp_path, obj=some)[0])[0, 1].tolist() == [1, 1, 1]
    scene, row, _ = one(tmp_path, "Kd 0 0 0\nKs 1 1 1", coloured(obj))
    assert MATERIAL_KINDS[scene.material_kind[row]] == "roughconductor"
    Image.fromarray(np.zeros((2, 3, 3), np.uint8)).save(tmp_path / "a.png")
    scene, row, text = one(tmp_path, "map_Kd a.png", coloured(obj))
    assert "a.mtl:1: map_Kd is applied instead of the colours of vertices" in text
    assert scene.texture_width[int(scene.reflectance_texture[row])] == 3
    _, _, text = one(tmp_path, "map_Kd a.png", re.sub(r"(?m)^(v .*)$", r"\1 1 1 1", obj))
    assert "colours of vertices" not in text


def numbered(rows):
    """A square with numbers after x y z."""
    lines = EDGES.splitlines()[:4]
    return "".join(f"{line} {row}\n" for line, row in zip(lines, rows, strict=True)) + "f 1 2 3 4\n"


@pytest.mark.parametrize(
    "row",
    ["0 0.6 -0.8", "0.5 x 0", "a b c", "nan 0 0", "0 inf 0", "0 1e999 0", "300 0 0", "1 -1 0 1"],
)
def test_numbers_of_vertices_that_are_no_colours(tmp_path, row):
    """As scanners write normals there: the file is shown without colours."""
    scene, text = load(tmp_path, obj=numbered(["0 0 1", row, "", row]))
    assert "a.obj:2: the numbers after x y z are no colour" in text
    assert text.count("no colour;") == 1 and "vertex_color" not in text
    assert scene.reflectance[scene.triangle_material].tolist() == [[0.5] * 3] * 2
    assert (scene.reflectance_texture < 0).all()


@pytest.mark.parametrize(
    ("rows", "expected", "told"),
    [
        (["1.2 0 0", "0 1 0", "", "0 0 1"], [[1, 0, 0], [0, 1, 0], [1, 1, 1], [0, 0, 1]], True),
        (["127.5 0 51", "0 255 0", "", "1 0 0"],
         [[0.5, 0, 0.2], [0, 1, 0], [1, 1, 1], [1 / 255, 0, 0]], False),
        (["1 1 0 0", "1 0 1 0", "1", "1 0 0 1"],
         [[1, 0, 0], [0, 1, 0], [1, 1, 1], [0, 0, 1]], False),
        (["1 0 0 0.5", "0 1 0 1", "1 1 1 1", "0 0 1 1"],
         [[1, 0, 0], [0, 1, 0], [1, 1, 1], [0, 0, 1]], False),
        (["1 0 0 1", "1 1 0 1", "1 1 1 1", "1 0 1 1"],
         [[1, 0, 0], [1, 1, 0], [1, 1, 1], [1, 0, 1]], False),
        (["255 0 0 255", "0 255 0 255", "", "0 0 255 255"],
         [[1, 0, 0], [0, 1, 0], [1, 1, 1], [0, 0, 1]], False),
        (["1 0 0 9 9", "0 1 0 9 9", "", "0 0 1 9 9"],
         [[1, 0, 0], [0, 1, 0], [1, 1, 1], [0, 0, 1]], False),
    ],
)  # fmt: skip
def test_forms_of_colours_of_vertices(tmp_path, rows, expected, told):
    scene, text = load(tmp_path, obj=numbered(rows))
    wanted = np.array(expected)[[[0, 1, 2], [0, 2, 3]]]
    assert np.abs(vertex_colours(scene) - wanted).max() < 1e-6
    assert ("a.obj:1: colours of vertices above 1 are taken as 1" in text) == told
    assert "no colour;" not in text


def test_a_smoothing_group_of_all_faces(tmp_path):
    """As two groups that share no vertex, and with a vertex that no face has."""
    apart = EDGES + "v 9 9 9\n" + EDGES
    faces = "".join(re.sub(r"\d", lambda k: str(int(k[0]) + 9), line) for line in STEPS)
    found, _ = cosines(load(tmp_path, obj=apart + "s 1\n" + "".join(STEPS) + faces)[0])
    parts = "s 1\n" + "".join(STEPS) + "s 2\n" + faces
    expected, _ = cosines(load(tmp_path, obj=apart + parts)[0])
    assert found.min() < 0.8 and (found == expected).all()


def test_what_is_cut_away_does_not_shine(tmp_path):
    texels = np.random.default_rng(2).integers(0, 256, (3, 5)).astype(np.uint8)
    Image.fromarray(texels).save(tmp_path / "a.png")
    for mtl, lit in (("Ke 1 2 4", [[1, 2, 4]]), ("Ke 1 2 4\nd 0.25", [[0.25, 0.5, 1]]),
                     ("Ke 1 2 4\nTr 0.5", [[0.5, 1, 2]]), ("Ke 1 2 4\nd 0", []),
                     ("Ke 1 2 4\nd 0.25\nillum 4", [[1, 2, 4]])):  # fmt: skip
        scene, _, text = one(tmp_path, mtl)
        assert scene.emissions.tolist() == lit
        assert ("a white sky was added" in text) == (not lit)
    scene, _, _ = one(tmp_path, "Ke 1 2 4\nmap_d a.png")
    first = int(scene.texture_first[scene.emission_texture[0]])
    found = scene.texels[first : first + 45].view(np.float32).reshape(3, 5, 3)
    assert (found == images.BYTE_TO_SHARE[texels][..., None] * np.float32([1, 2, 4])).all()


def test_a_backslash_ends_no_line_of_names(tmp_path):
    plain = load(tmp_path)[0]
    marked = PLAIN.replace("usemtl one\n", "g C:\\a\\\nusemtl one\n# C:\\\n", 1)
    marked = marked.replace("f 1/1 2/2 3/3 4/4", "f 1/1 2/2 \\\n3/3 4/4", 1)
    assert marked.count("\\") == 4
    assert load(tmp_path, obj=marked)[0].sha256 == plain.sha256


def test_it_renders(tmp_path):
    """Under a white sky a white square sends back all that it gets."""
    scene, _, text = one(tmp_path, "Kd 1 1 1")
    assert "a white sky was added" in text
    picture = veriray.render(scene, spp=4, width=16, height=12, max_depth=-1, device="cpu")
    assert np.abs(picture.image - 1).max() < 1e-5
    assert math.isfinite(picture.image.sum())


@pytest.mark.parametrize(
    ("mtl", "obj", "message"),
    [
        (MTL, OBJ, 'a.obj:15: there is no material "one # again"; known: one, two words'),
        (MTL, OBJ.replace("a.mtl", "."), "a.obj:1: cannot read "),
        ("Kd 1 1 1\n", None, 'a.mtl:1: "Kd" stands before the first newmtl'),
        ("newmtl one\nKd 1 2\n", None, 'a.mtl:2: Kd = "1 2" is not 1 or 3 numbers in'),
        ("newmtl one\nKd 1 2 1\n", None, "a.mtl:2: Kd = "),
        ("newmtl one\nKd spectral a.rfl\n", None, "a.mtl:2: Kd spectral is not supported"),
        ("newmtl one\nKd x\n", None, 'a.mtl:2: Kd = "x" is not a number'),
        ("newmtl one\nNi\n", None, "a.mtl:2: Ni"),
        ("newmtl one\nNi 99\n", None, r"a.mtl:2: Ni = 99 is outside \[0.1, 10\]"),
        ("newmtl one\nmap_Kd\n", None, "a.mtl:2: map_Kd names no file"),
        ("newmtl one\nmap_Kd -s 1\n", None, "a.mtl:2: map_Kd names no file"),
        ("newmtl one\nmap_Kd -x a.png\n", None, 'a.mtl:2: map_Kd: unknown option "-x"'),
        ("newmtl one\nmap_Kd a.png\n", None, "a.mtl:2: cannot read .*a.png"),
        (MTL, "v 0 0 0\nf 1 2 3\n", "is not within the 1 v lines"),
        ("newmtl one\nmap_Kd -mm x a.png\n", None, "a.mtl:2: cannot read .*x a.png"),
    ],
)  # fmt: skip
def test_bad_files(tmp_path, mtl, obj, message):
    with pytest.raises(SceneError, match=message):
        load(tmp_path, mtl, obj or OBJ.split("usemtl two")[0])


@pytest.mark.parametrize(
    ("first", "told"),
    [
        ("mtllib no.mtl", r"a\.obj:1: \S*no\.mtl\" is not there; its materials are grey"),
        (f"mtllib {'b' * 999}.mtl", r"a\.obj:1: \S*\.mtl\" is not there; its materials are grey"),
        ("mtllib no.mtl a.mtl", r"a\.obj:1: \S*no\.mtl\" is not there; its materials are grey"),
        ("", r"a\.obj:11: no mtllib before this usemtl; its materials are grey"),
    ],
)
def test_materials_that_are_not_there_are_grey(tmp_path, first, told):
    obj = PLAIN.replace("mtllib a.mtl", first)
    scene, text = load(tmp_path, "newmtl two words\nKe 1 1 1\n", obj)
    assert re.search(told, text) and text.count("grey") == 1
    assert (scene.reflectance == 0.5).all() and ("sky" in text) == ("a.mtl" not in first)


def test_parameters_are_not_used(tmp_path):
    (tmp_path / "a.obj").write_text("v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 3\n")
    with pytest.raises(SceneError, match='parameter "x" is not used by the scene'):
        veriray.load_file(tmp_path / "a.obj", {"x": 1})
