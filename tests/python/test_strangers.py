# ruff: noqa: E501 (the tables of spellings)
"""Spellings of strangers' files that Mitsuba 3.9.1 reads: each means what the plain one means."""

from __future__ import annotations

import struct
import warnings
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import veriray as vr
from veriray.errors import SceneError, SceneWarning
from veriray.formats import images, mesh

VIEW = '<sensor type="perspective"><float name="fov" value="40"/></sensor>'
SKY = '<emitter type="constant"/>'
BALL = '<shape type="sphere" id="ball"><float name="radius" value="0.5"/></shape>'
PLAIN = f'<scene version="3.0.0">\n{VIEW}{SKY}\n{BALL}</scene>\n'


def loaded(folder: Path, text: str | bytes, name: str = "scene.xml") -> vr.Scene:
    path = folder / name
    path.write_bytes(text if isinstance(text, bytes) else text.encode())
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", SceneWarning)
        return vr.load_file(path)


def before(text: str) -> str:
    return PLAIN.replace(BALL, text + BALL)


DOCUMENTS: dict[str, str | bytes] = {
    "UTF-8 mark": b"\xef\xbb\xbf" + PLAIN.encode(),
    "UTF-16 little": b"\xff\xfe" + PLAIN.encode("utf-16-le"),
    "UTF-16 big": b"\xfe\xff" + PLAIN.encode("utf-16-be"),
    "UTF-16 without mark": ('<?xml version="1.0" encoding="UTF-16"?>' + PLAIN).encode("utf-16-le"),
    "UTF-16 big without mark": PLAIN.encode("utf-16-be"),
    "UTF-32": b"\xff\xfe\0\0" + PLAIN.encode("utf-32-le"),
    "UTF-32 big": PLAIN.encode("utf-32-be"),
    "ISO-8859-1": ('<?xml version="1.0" encoding="ISO-8859-1"?>' + before("<!-- caf\xe9 -->")).encode("latin-1"),
    "a comment of one byte a letter": before("<!-- caf\xe9 -->").encode("latin-1"),
    "a comment in GBK": before("<!-- \u5730\u677f -->").encode("gbk"),
    "dashes in a comment": before("<!-- a -- b -->"),
    "a row of dashes": before("<!------- a ------->"),
    "a comment that begins with a dash": before("<!--- a --->"),
    "tags in a comment": before('<!-- <shape type="x" a=<> & -->'),
    "control characters in a comment": before("<!-- \x01 -->"),
    "a comment before the declaration": "<!-- licence -->\n" + '<?xml version="1.0"?>' + PLAIN,
    "a comment in an instruction": before("<?x <!-- ?>") .replace("</scene>", "<?x --> ?></scene>"),
    "a comment in literal text": before("<![CDATA[ <!-- ]]>"),
    "text between elements": before("light:"),
    "text in a shape": PLAIN.replace("</shape>", ">\n</shape>"),
    "text in a transform": PLAIN.replace("</shape>", '<transform name="to_world">none</transform></shape>'),
    "an ampersand": PLAIN.replace('id="ball"', 'id="a & b"'),
    "an ampersand that begins no entity": PLAIN.replace('id="ball"', 'id="R&D;"'),
    "a version with a word": PLAIN.replace("3.0.0", "3.0.0-dev"),
    "a version with spaces": PLAIN.replace("3.0.0", " 3.0.0 "),
    "a name with a dash": before('<default name="a-b" value="0.5"/>').replace('"0.5"/></shape>', '"$a-b"/></shape>'),
    "a name with a dot": before('<default name="a.b" value="0.5"/>').replace('"0.5"/></shape>', '"$a.b"/></shape>'),
    "a name of a number": before('<default name="1" value="0.5"/>').replace('"0.5"/></shape>', '"$1"/></shape>'),
    "the longest name": before('<default name="r" value="9"/><default name="r-s" value="0.5"/>').replace('"0.5"/></shape>', '"$r-s"/></shape>'),
    "text behind a name": before('<default name="r" value="0"/>').replace('"0.5"/></shape>', '"$r.5"/></shape>'),
}  # fmt: skip


@pytest.mark.parametrize("name", DOCUMENTS)
def test_a_document_means_what_the_plain_one_means(tmp_path: Path, name: str) -> None:
    found = loaded(tmp_path, DOCUMENTS[name])
    assert found.sha256 == loaded(tmp_path, PLAIN).sha256


@pytest.mark.parametrize(
    ("name", "words"),
    [
        ("a comment in GBK", "not UTF-8 text: it is read as ISO-8859-1"),
        ("text between elements", "scene.xml:1: <scene> holds text, which is not read"),
        ("text in a shape", "scene.xml:3: <shape> holds text, which is not read"),
    ],
)
def test_what_is_not_read_is_said(tmp_path: Path, name: str, words: str) -> None:
    assert words in " ".join(loaded(tmp_path, DOCUMENTS[name]).notes)
    with pytest.raises(SceneError, match="an error by strict"):
        vr.load_file(tmp_path / "scene.xml", strict=True)


def test_lines_count_past_comments(tmp_path: Path) -> None:
    text = PLAIN.replace(VIEW, "<!-- a\n--\n-->\n" + VIEW).replace('"0.5"', '"x"')
    with pytest.raises(SceneError, match=r"scene\.xml:6: "):
        loaded(tmp_path, text)


def test_names_in_another_encoding_are_alike(tmp_path: Path) -> None:
    bsdf, ref = '<bsdf type="diffuse" id="\u7403"/>', '<ref id="\u7403"/>'
    text = before(bsdf).replace("</shape>", ref + "</shape>")
    assert loaded(tmp_path, text.encode("gbk")).sha256 == loaded(tmp_path, text).sha256


def bsdf(text: str) -> str:
    return PLAIN.replace("</shape>", text + "</shape>")


METAL = '<bsdf type="conductor">{}</bsdf>'
MASK = '<bsdf type="mask">{}<bsdf type="diffuse"/></bsdf>'
TWOSIDED = '<bsdf type="twosided">{}</bsdf>'
SIDES = TWOSIDED.format('<bsdf type="plastic"/><bsdf type="diffuse"/>')
COLOUR = '<rgb name="{}" value="{}"/>'
BSDFS = {
    "eta alone": (METAL.format(COLOUR.format("eta", "0.2 0.9 1.1")), METAL.format(COLOUR.format("eta", "0.2 0.9 1.1") + COLOUR.format("k", 1))),
    "k alone": (METAL.format(COLOUR.format("k", "3 2 1")), METAL.format(COLOUR.format("eta", 0) + COLOUR.format("k", "3 2 1"))),
    "coloured opacity": (MASK.format(COLOUR.format("opacity", "1 0.5 0")), MASK.format('<float name="opacity" value="0.5"/>')),
    "mask in mask": ('<bsdf type="mask"><float name="opacity" value="0.25"/>' + MASK.format('<float name="opacity" value="0.5"/>') + "</bsdf>", MASK.format('<float name="opacity" value="0.125"/>')),
    "twosided in twosided": (TWOSIDED.format(TWOSIDED.format('<bsdf type="plastic"/>')), TWOSIDED.format('<bsdf type="plastic"/>')),
    "two sides in twosided": (TWOSIDED.format(SIDES), TWOSIDED.format('<bsdf type="plastic"/>')),
    "two sides as its front": (TWOSIDED.format(SIDES + METAL.format("")), TWOSIDED.format('<bsdf type="plastic"/>' + METAL.format(""))),
    "two sides as its back": (TWOSIDED.format(METAL.format("") + SIDES), TWOSIDED.format(METAL.format("") + '<bsdf type="plastic"/>')),
}  # fmt: skip


@pytest.mark.parametrize("name", BSDFS)
def test_a_bsdf_means_what_another_means(tmp_path: Path, name: str) -> None:
    one, other = (loaded(tmp_path, bsdf(text)) for text in BSDFS[name])
    assert one.sha256 == other.sha256


def blend(first: str, second: str, weight: float) -> str:
    return f'<bsdf type="blendbsdf"><float name="weight" value="{weight}"/>{first}{second}</bsdf>'


def matt(grey: float) -> str:
    return f'<bsdf type="diffuse">{COLOUR.format("reflectance", grey)}</bsdf>'


ROUGH = '<bsdf type="roughconductor"><float name="alpha" value="0.25"/>{}</bsdf>'
GLASS = '<bsdf type="dielectric">{}</bsdf>'
COAT = '<bsdf type="plastic"/>'
TWICE = '<bsdf type="twosided">{}</bsdf>'
DARK = COLOUR.format("specular_reflectance", 0.75)
BLENDS = {
    "two matt ones": (blend(blend(matt(1), COAT, 0.5), matt(0.25), 0.5), blend(matt(0.5), COAT, 0.25)),
    "three matt ones": (blend(blend(matt(1), matt(0.5), 0.5), matt(0.25), 0.5), blend(matt(0.75), matt(0.25), 0.5)),
    "two alike": (blend(blend(COAT, matt(0.5), 0.5), COAT, 0.5), blend(COAT, matt(0.5), 0.25)),
    "a black one": (blend(blend(ROUGH.format(""), matt(0), 0.25), COAT, 0.5), blend(ROUGH.format(DARK), COAT, 0.5)),
    "a black one and glass": (blend(blend(matt(0), GLASS.format(""), 0.75), COAT, 0.5), blend(GLASS.format(DARK + DARK.replace("reflectance", "transmittance")), COAT, 0.5)),
    "one that is not shown": (blend(blend(GLASS.format(""), matt(0.5), 0), COAT, 0.5), blend(GLASS.format(""), COAT, 0.5)),
    "both sides": (TWICE.format(blend(blend(matt(1), COAT, 0.5), matt(0.25), 0.5)), TWICE.format(blend(matt(0.5), COAT, 0.25))),
    "parts with two sides": (blend(TWICE.format(blend(matt(1), COAT, 0.5)), TWICE.format(matt(0.25)), 0.5), TWICE.format(blend(matt(0.5), COAT, 0.25))),
}  # fmt: skip


@pytest.mark.parametrize("name", BLENDS)
def test_a_blend_of_three_that_two_can_be(tmp_path: Path, name: str) -> None:
    one, other = (loaded(tmp_path, bsdf(text)) for text in BLENDS[name])
    assert one.sha256 == other.sha256


@pytest.mark.parametrize(
    "part",
    [
        f'<bsdf type="mask"><float name="opacity" value="0.5"/>{matt(0)}</bsdf>',
        TWICE.format(matt(1)),
        '<bsdf type="diffuse"><texture type="checkerboard" name="reflectance"/></bsdf>',
    ],
)
def test_a_blend_of_three_that_two_cannot_be(tmp_path: Path, part: str) -> None:
    """A blend whose second bsdf is a blend: by the chances of each."""
    parts = blend(matt(0.5), COAT, 0.25)
    chances = []
    for text in (blend(parts, part, 0.5), blend(part, parts, 0.5)):
        found, row = loaded(tmp_path, bsdf(text)), 0
        left, shares = 1.0, []
        while row >= 0:
            weight = float(found.blend_weight[row]) if found.blend_material[row] >= 0 else 0.0
            shares.append(left * (1 - weight))
            left, row = left * weight, int(found.blend_material[row])
        chances.append(shares)
    assert chances[0] == pytest.approx([0.375, 0.125, 0.5])
    assert chances[1] == pytest.approx([0.5, 0.375, 0.125])


def test_a_blend_by_an_image_in_a_blend(tmp_path: Path) -> None:
    """As its second bsdf, and as its first where a number is the other weight."""
    image = '<texture type="checkerboard" name="weight"/>'
    inner = f'<bsdf type="blendbsdf">{image}{matt(0.5)}{COAT}</bsdf>'
    one = loaded(tmp_path, bsdf(blend(ROUGH.format(""), inner, 0.25)))
    other = loaded(tmp_path, bsdf(blend(inner, ROUGH.format(""), 0.75)))
    assert one.sha256 == other.sha256
    assert one.blend_material.tolist() == [1, 2, -1]
    assert one.blend_weight_texture.tolist() == [-1, 0, -1]


def test_a_spectrum_for_one_number_is_its_mean(tmp_path: Path) -> None:
    opacity = '<spectrum name="opacity" value="400:0, 700:1"/>'
    found = loaded(tmp_path, bsdf(MASK.format(opacity)))
    shown = loaded(
        tmp_path, bsdf(f'<bsdf type="diffuse">{opacity.replace("opacity", "reflectance")}</bsdf>')
    )
    assert found.opacity[0] == pytest.approx(np.mean(shown.reflectance[0]))
    assert "one number counts, the mean of these" in " ".join(found.notes)


def test_version_0_takes_the_last_of_two_and_leaves_out_what_it_does_not_know(
    tmp_path: Path,
) -> None:
    lamp = '<shape type="sphere"><float name="radius" value="0.25"/><float name="radius" value="{}"/><emitter type="area"><rgb name="reflectance" value="1"/><rgb name="radiance" value="2"/></emitter></shape>'
    text = PLAIN.replace("3.0.0", "0.6.0").replace(BALL, lamp.format("0.5") + lamp.format("0.75"))
    found = loaded(tmp_path, text)
    assert sorted(found.spheres[:, 3].tolist()) == [0.5, 0.75]
    assert " ".join(found.notes).count('"reflectance" is left out') == 1  # a place twice is a note
    assert '"radius" is given twice' in " ".join(found.notes)
    with pytest.raises(SceneError, match='"radius" is given twice'):
        loaded(tmp_path, text.replace("0.6.0", "3.0.0"))


# ---- meshes --------------------------------------------------------------------------------------

HEAD = "ply\n{}element vertex 5\nproperty float x\nproperty float y\nproperty float z\nelement {} {}\nproperty list uchar int vertex_indices\nend_header\n"
POINTS = "0 0 0\n1 0 0\n0 1 0\n1 1 0.5\n0 2 1\n"
FACES = "3 0 1 2\n3 2 1 3\n3 2 3 4\n"
FORM = "format ascii 1.0\n"


def triangles(folder: Path, content: bytes, kind: str = "ply") -> tuple[Any, Any]:
    path = folder / f"a.{kind}"
    path.write_bytes(content)
    found = mesh.read(path, kind, "here")
    return found.vertices.tolist(), found.triangles.tolist()


PLYS = {
    "comment before the format": HEAD.format("comment a\nobj_info b\n\n" + FORM, "face", 3) + POINTS + FACES,
    "empty lines": HEAD.format(FORM, "face", 3) + "\n" + POINTS.replace("\n", "\n\n") + "  \n" + FACES,
    "a strip": HEAD.format(FORM, "tristrips", 1) + POINTS + "5 0 1 2 3 4\n",
    "two strips in one": HEAD.format(FORM, "tristrips", 1) + POINTS + "9 0 1 2 -1 2 1 3 -1 0\n",
    "an element of strips": HEAD.format(FORM, "tristrips", 2) + POINTS + "3 0 1 2\n4 2 1 3 4\n",
}  # fmt: skip


@pytest.mark.parametrize("name", PLYS)
def test_ply_files_of_others(tmp_path: Path, name: str) -> None:
    found = triangles(tmp_path, PLYS[name].encode())
    plain = triangles(tmp_path, (HEAD.format(FORM, "face", 3) + POINTS + FACES).encode())
    assert found[0] == plain[0]
    expected = plain[1]
    if name == "two strips in one":
        expected = [[0, 1, 2], [2, 1, 3]]
    elif name == "an element of strips":
        expected = [[0, 1, 2], [2, 1, 3], [3, 1, 4]]
    assert found[1] == expected


def test_binary_strips_and_their_faults(tmp_path: Path) -> None:
    head = HEAD.format("format binary_little_endian 1.0\n", "tristrips", 1).replace(
        "list uchar", "list int"
    )
    points = np.array(POINTS.split(), "<f4").tobytes()
    found = triangles(tmp_path, head.encode() + points + struct.pack("<6i", 5, 0, 1, 2, 3, 4))
    assert found[1] == [[0, 1, 2], [2, 1, 3], [2, 3, 4]]
    with pytest.raises(SceneError, match="triangle 0 uses vertex 7"):
        triangles(tmp_path, head.encode() + points + struct.pack("<4i", 3, 7, 1, 2))
    with pytest.raises(SceneError, match="holds no triangles"):
        triangles(tmp_path, head.encode() + points + struct.pack("<3i", 2, 0, 1))


# ---- images --------------------------------------------------------------------------------------

RNG = np.random.default_rng(3)
TEXELS = RNG.random((3, 4, 3)).astype(np.float32)


def exr(path: Path, names: list[str], texels: np.ndarray[Any, Any] = TEXELS, **more: Any) -> Path:
    import OpenEXR

    planes = {name: np.ascontiguousarray(texels[..., k]) for k, name in enumerate(names)}
    OpenEXR.File({"type": OpenEXR.scanlineimage}, {**planes, **more}).write(str(path))
    return path


@pytest.mark.parametrize("names", ["R G B", "r g b", "View.R View.G View.B", "V.Combined.R V.Combined.G V.Combined.B"])  # fmt: skip
def test_channels_of_colours(tmp_path: Path, names: str) -> None:
    path = exr(tmp_path / "a.exr", names.split(), Depth=np.ones((3, 4), np.float32))
    assert (images.read(path, "here").texels == TEXELS).all()


def test_no_layer_is_guessed(tmp_path: Path) -> None:
    path = exr(tmp_path / "a.exr", [f"{layer}.{name}" for layer in "ab" for name in "RGB"],
               np.concatenate([TEXELS, TEXELS], axis=2))  # fmt: skip
    with pytest.raises(SceneError, match=r"no channels R, G, B, and no channel Y; found a\.B"):
        images.read(path, "here")


def test_x_y_z_is_a_colour(tmp_path: Path) -> None:
    matrix = np.array(
        [
            [3.240479, -1.537150, -0.498535],
            [-0.969256, 1.875991, 0.041556],
            [0.055648, -0.204043, 1.057311],
        ]
    )  # ITU-R BT.709
    xyz = (TEXELS @ np.linalg.inv(matrix).T).astype(np.float32)
    found = images.read(exr(tmp_path / "a.exr", ["X", "Y", "Z"], xyz), "here").texels
    assert np.allclose(found, TEXELS, atol=1e-6)


def test_a_sky_below_nothing_is_dark(tmp_path: Path) -> None:
    texels = TEXELS.copy()
    texels[1, 2, 0] = -1e-3
    exr(tmp_path / "a.exr", ["R", "G", "B"], texels)
    sky = '<emitter type="envmap"><string name="filename" value="a.exr"/></emitter>'
    (tmp_path / "scene.xml").write_text(PLAIN.replace(SKY, sky))
    with pytest.warns(
        SceneWarning,
        match=r"scene\.xml:2: envmap: texel \(x 2, y 1\) is -0.001; radiance is not negative: 0 is rendered",
    ):
        scene = vr.load_file(tmp_path / "scene.xml")
    assert (scene.sky_texels == np.maximum(texels, 0).reshape(-1, 3)).all()


def test_a_factor_of_colour_on_grey_texels(tmp_path: Path) -> None:
    exr(tmp_path / "a.exr", ["Y"], TEXELS[..., :1])
    texture = '<texture type="bitmap" name="reflectance"><string name="filename" value="a.exr"/>{}</texture>'
    plain, grey, coloured = (
        loaded(tmp_path, bsdf(f'<bsdf type="diffuse">{texture.format(factor)}</bsdf>'))
        for factor in ("", COLOUR.format("scale", 0.5), COLOUR.format("scale", "0.5 1 0.25"))
    )
    assert plain.texture_grey.tolist() == grey.texture_grey.tolist() == [1]
    assert coloured.texture_grey.tolist() == [0]
    texels = coloured.texels.view(np.float32).reshape(3, 4, 3)
    assert (texels == TEXELS[..., :1] * np.float32([0.5, 1, 0.25])).all()
    assert (grey.texels.view(np.float32) == TEXELS[..., 0].ravel() * np.float32(0.5)).all()


POINTER = "version https://git-lfs.github.com/spec/v1\noid sha256:0\nsize 9\n"
FILE = '<string name="filename" value="{}"/>'
MESH = '<shape type="{0}"><string name="filename" value="a.{0}"/></shape>'


@pytest.mark.parametrize("name", ["obj", "ply", "serialized", "png", "exr", "hdr", "vol", "spd"])
def test_pointers_of_git_lfs_are_named(tmp_path: Path, name: str) -> None:
    (tmp_path / f"a.{name}").write_text(POINTER)
    file = FILE.format(f"a.{name}")
    matter = (
        f'<bsdf type="diffuse"><texture type="bitmap" name="reflectance">{file}</texture></bsdf>'
    )
    if name == "spd":
        matter = '<bsdf type="diffuse"><spectrum name="reflectance" filename="a.spd"/></bsdf>'
    if name == "vol":
        volume = f'<volume type="gridvolume" name="sigma_t">{file}</volume>'
        matter = f'<medium type="heterogeneous" name="interior">{volume}</medium>'
    mesh_file = name in ("obj", "ply", "serialized")
    text = PLAIN.replace(BALL, MESH.format(name)) if mesh_file else bsdf(matter)
    with pytest.raises(SceneError, match="not the file, but a pointer of Git LFS to it"):
        loaded(tmp_path, text)


def test_three_numbers_are_a_colour(tmp_path: Path) -> None:
    text = '<bsdf type="diffuse"><spectrum name="reflectance" value="0.1, 0.2, 0.3"/></bsdf>'
    with pytest.raises(SceneError, match="holds 3 numbers, expected 1; a colour is <rgb>"):
        loaded(tmp_path, bsdf(text))


# ---- media ---------------------------------------------------------------------------------------

POINT = '<emitter type="point"><point name="position" z="3"/></emitter>'
LAMP = '<shape type="rectangle"><emitter type="area"/></shape>'
FALSE = '<boolean name="{}" value="false"/>'


@pytest.mark.parametrize(
    ("light", "sigma_t", "said", "words"),
    [
        (POINT, "1", "sample_emitters", "leaves the light of points and parallel light in it out"),
        (POINT.replace("point", "directional", 1).replace('<point name="position" z="3"/>', ""), "1", "sample_emitters", "leaves the light of points and parallel light in it out"),
        (LAMP, "1", "sample_emitters", ""),
        (SKY, "1 2 3", "has_spectral_extinction", "takes a coloured extinction for one that is grey"),
        (SKY, "2 2 2", "has_spectral_extinction", ""),
        (POINT, "1 2 3", "", ""),
    ],
)  # fmt: skip
@pytest.mark.parametrize("kind", ["homogeneous", "constvolume", "gridvolume"])
def test_what_media_say_about_sampling(
    tmp_path: Path, kind: str, light: str, sigma_t: str, said: str, words: str
) -> None:
    matter = COLOUR.format("sigma_t", sigma_t)
    if kind == "constvolume":
        matter = (
            f'<volume type="constvolume" name="sigma_t">{COLOUR.format("value", sigma_t)}</volume>'
        )
    if kind == "gridvolume":
        cells = np.broadcast_to(np.array(sigma_t.split(), "<f4"), (2, 2, 2, len(sigma_t.split())))
        head = b"VOL\3" + struct.pack("<5i6f", 1, 2, 2, 2, cells.shape[3], 0, 0, 0, 1, 1, 1)
        (tmp_path / "a.vol").write_bytes(head + cells.tobytes())
        matter = f'<volume type="gridvolume" name="sigma_t">{FILE.format("a.vol")}</volume>'
        words = "takes a coloured extinction" if sigma_t == "2 2 2" else words  # three a cell
    matter += FALSE.format(said) if said else ""
    plugin = "homogeneous" if kind == "homogeneous" else "heterogeneous"
    medium = f'<medium type="{plugin}" name="interior">{matter}</medium>'
    volpath = '<integrator type="volpath"/>'
    text = PLAIN.replace(SKY, volpath + light).replace("</shape>\n", "</shape>", 1)
    path = tmp_path / "scene.xml"
    path.write_text(
        text.replace(BALL, BALL.replace("</shape>", f'<bsdf type="null"/>{medium}</shape>'))
    )
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always")
        vr.load_file(path)
    told = "; ".join(str(one.message) for one in caught if issubclass(one.category, SceneWarning))
    assert (words in told and f'"{said}" = false' in told) if words else not told


# ---- folders -------------------------------------------------------------------------------------


def test_assets_are_found_where_mitsuba_looks_and_then_beside_the_included_file(
    tmp_path: Path,
) -> None:
    """Beside the first file or in its search folders; included files beside what names them."""
    obj = '<shape type="obj"><string name="filename" value="a.obj"/></shape>'
    for name in ("", "one", "one/two", "more"):
        (tmp_path / name).mkdir(exist_ok=True)
    (tmp_path / "one" / "a.xml").write_text(
        f'<scene version="3.0.0"><include filename="two/b.xml"/>{obj}</scene>'
    )
    (tmp_path / "one" / "two" / "b.xml").write_text(f'<scene version="3.0.0">{obj}</scene>')

    def heights(*where: str) -> list[float]:
        for name in ("", "one", "one/two", "more"):
            (tmp_path / name / "a.obj").unlink(missing_ok=True)
        for height, name in enumerate(where, 1):
            text = f"v 0 0 {height}\nv 1 0 {height}\nv 0 1 {height}\nf 1 2 3\n"
            (tmp_path / name / "a.obj").write_text(text)
        text = f'<scene version="3.0.0"><path value="more"/>{VIEW}{SKY}<include filename="one/a.xml"/></scene>'
        return sorted(set(loaded(tmp_path, text).vertices[:, 2].tolist()))

    assert heights("more", "", "one", "one/two") == [1]
    assert heights("", "one", "one/two") == [1]
    assert heights("one", "one/two") == [1, 2]
    assert heights("one") == [1]


def test_a_corner_without_a_normal_has_that_of_the_one_before_it(tmp_path: Path) -> None:
    """As Mitsuba's; where no corner of a face has one before it, there is none: Mitsuba sets none."""
    path = tmp_path / "a.obj"
    corners = "v -1 -1 0\nv 1 -1 0\nv 1 1 0\nv -1 1 0\nvt .1 .2\nvt .3 .4\nvn 0 0 1\nvn 0 .6 .8\n"
    path.write_text(f"{corners}f 1/1/1 2/2/2 3 4//1\nf 1 2/1/2 3//1\nf 2 4 1\n")
    found = mesh.read(path, "obj", "")
    assert found.uv is not None and found.normals is not None
    assert found.normals[found.triangles[:, 1:]].tolist() == [
        [[0, 0.6, 0.8]] * 2, [[0, 0.6, 0.8], [0, 0, 1]], [[0, 0.6, 0.8], [0, 0, 1]], [[0, 0, 0]] * 2,
    ]  # fmt: skip
    mitsuba = pytest.importorskip("mitsuba", reason="the peer renderer: pip install mitsuba")
    mitsuba.set_variant("scalar_rgb")
    given = {"type": "obj", "filename": str(path), "flip_tex_coords": False}
    theirs = mitsuba.traverse(mitsuba.load_dict(given))
    faces = np.array(theirs["faces"]).reshape(-1, 3)
    for name, width, own in (("normals", 3, found.normals), ("texcoords", 2, found.uv)):
        rows = np.array(theirs[f"vertex_{name}"]).reshape(-1, width)
        np.testing.assert_allclose(own[found.triangles[:2]], rows[faces[:2]], atol=1e-6)
        np.testing.assert_allclose(own[found.triangles[2, 1:]], rows[faces[2, 1:]], atol=1e-6)


FAR = {"type": "distant", "film": {"type": "hdrfilm", "width": 1, "height": 1}}
GLOW: dict[str, Any] = {"type": "sphere", "center": [0.5, 0.2, 0.1], "radius": 0.7}


def far(sensor: dict[str, Any], **more: Any) -> dict[str, Any]:
    lamp = {**GLOW, "emitter": {"type": "area", "radiance": 1.0}}
    return {"type": "scene", "i": {"type": "path", "max_depth": 2}, "c": {**FAR, **sensor},
            "ball": lamp, **more}  # fmt: skip


@pytest.mark.parametrize("ahead", [(0, 0, -1), (0.48, 0.6, -0.64), (-1, 0, 0)])
def test_a_distant_sensor_sees_all_of_a_disc(ahead: tuple[float, ...], device: str) -> None:
    """A ball that shines is a third of the disc across the ball about its box, from wherever.

    At 5 standard errors of 2^16 samples, 0.9 %: false alarms 6e-7.
    """
    scene = vr.load_dict(far({"direction": list(ahead)}))
    found = vr.render(scene, 1 << 16, device=device)
    assert abs(found.image[0, 0, 0] - 1 / 3) <= 5 * float(np.sqrt(2 / 9 / 2**16))
    up = [0, 1, 0] if ahead[0] else [1, 0, 0]
    given = {
        "to_world": vr.transform.look_at(
            [9.0, 8.0, 7.0], [9 + ahead[0], 8 + ahead[1], 7 + ahead[2]], up
        )
    }
    other = vr.load_dict(far(given)).camera
    np.testing.assert_allclose(other.to_world, scene.camera.to_world, rtol=0, atol=1e-12)
    mitsuba = pytest.importorskip("mitsuba", reason="the peer renderer: pip install mitsuba")
    mitsuba.set_variant("scalar_rgb")
    theirs = mitsuba.load_dict({"type": "scene", "s": GLOW, "c": {**FAR, "direction": list(ahead)}})
    rng, origins = np.random.default_rng(1), []
    for _ in range(2000):
        ray, weight = theirs.sensors()[0].sample_ray(0, 0.5, rng.random(2), rng.random(2))
        np.testing.assert_allclose(ray.d, ahead, rtol=0, atol=1e-6)
        np.testing.assert_allclose(weight, 1)
        origins.append(np.array(ray.o))
    across = np.array(origins) - scene.camera.to_world[:3, 3]
    assert np.abs(across @ ahead).max() < 1e-5
    assert scene.camera.aperture_radius == pytest.approx(0.7 * 3**0.5, rel=1e-4)
    assert np.linalg.norm(across, axis=1).max() == pytest.approx(0.7 * 3**0.5, rel=2e-3)


def test_a_distant_sensor_with_a_target_is_one_ray(tmp_path: Path, device: str) -> None:
    """It begins before the scene, wherever the target is in it."""
    wall = {"type": "rectangle", "to_world": vr.transform.translate([0, 0, -5])}
    sensor = {"direction": [0.0, 0.0, -1.0]}
    for target, seen in (((0.5, 0.2, -4), 1.0), ((0.5, 0.2, 0.7), 1.0), ((0, 0.95, -4.9), 0.0)):
        scene = vr.load_dict(far({**sensor, "target": list(target)}, wall=wall))
        assert (vr.render(scene, 4, device=device, max_depth=1).image == seen).all()
    text = """<scene version="3.0.0"><integrator type="path"><integer name="max_depth" value="2"/></integrator>
    <sensor type="distant"><vector name="direction" value="0 0 -1"/><point name="target" value="0.5 0.2 -4"/>
    <film type="hdrfilm"><integer name="width" value="1"/><integer name="height" value="1"/></film></sensor>
    <shape type="sphere"><point name="center" value="0.5 0.2 0.1"/><float name="radius" value="0.7"/>
    <emitter type="area"><rgb name="radiance" value="1"/></emitter></shape></scene>"""
    given = vr.load_dict(far({**sensor, "target": [0.5, 0.2, -4]}))
    assert loaded(tmp_path, text).sha256 == given.sha256


@pytest.mark.parametrize(
    ("sensor", "message"),
    [
        ({"film": {"type": "hdrfilm", "width": 2, "height": 1}}, "2 x 1 pixels, expected 1 x 1"),
        ({"direction": [0, 0, 1], "to_world": np.eye(4)}, "both direction and to_world given"),
        ({"direction": [0, 0, 0]}, "direction has length 0"),
    ],
)
def test_distant_sensors_that_are_not_read(sensor: dict[str, Any], message: str) -> None:
    with pytest.raises(SceneError, match=message):
        vr.load_dict(far(sensor))


@pytest.mark.parametrize(
    "text",
    [
        MASK.replace('type="mask"', 'type="mask" id="a"').format('<ref id="a"/>').replace('<bsdf type="diffuse"/>', ""),
        '<bsdf type="blendbsdf" id="a"><float name="weight" value="0.5"/><bsdf type="diffuse"/><ref id="a"/></bsdf>',
        '<bsdf type="twosided" id="a"><bsdf type="twosided"><ref id="a"/></bsdf></bsdf>',
    ],
)  # fmt: skip
def test_a_bsdf_in_itself_is_refused(tmp_path: Path, text: str) -> None:
    with pytest.raises(SceneError, match=r'scene\.xml:3: \w+ "a" holds itself'):
        loaded(tmp_path, bsdf(text))
