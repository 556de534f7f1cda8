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
    assert scene.texture_to_uv[at].tolist() == [[2, 0, 0.5], [0, 3, 0]]
    assert scene.texture_wrap[at] == 2 and "bump" in text and "not applied" in text
    assert (scene.texels.view(np.uint8).reshape(3, 5, 4)[..., :3] == texels).all()
    assert scene.uv[:, 1].tolist()[0] == 0.75  # v is up in the file, and down in an image
    scene, row, _ = one(tmp_path, "Kd 1 0.5 0.25\nmap_Kd a b.png")
    found = scene.texels[:45].view(np.float32).reshape(3, 5, 3)
    assert (found == images.SRGB_TO_LINEAR[texels] * np.array([1, 0.5, 0.25], np.float32)).all()
    scene, row, _ = one(tmp_path, "Kd 0 0 0\nKs 1 1 1\nmap_Kd a b.png\nmap_d a b.png")
    assert MATERIAL_KINDS[scene.material_kind[row]] == "roughplastic"
    assert scene.opacity_texture[row] >= 0 and scene.reflectance_texture[row] >= 0


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
