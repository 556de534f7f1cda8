"""Regression tests for what fuzzing found."""

from __future__ import annotations

import logging
import time
import tracemalloc
from pathlib import Path

import numpy as np
import pytest

from tests.fuzz.formats import corpus
from veriray import image
from veriray.cli import main
from veriray.errors import SceneError, SceneWarning
from veriray.formats import mesh, node
from veriray.scene import load_dict, load_file

SCENE = '<scene version="3.0.0"><sensor type="perspective"><float name="fov" value="40"/></sensor>{}</scene>'  # noqa: E501
ESCAPE = "\x1b[2J\x07\u202e"  # clears a terminal, rings, turns the text round


def message(path: Path, content: str | bytes) -> str:
    path.write_bytes(content.encode() if isinstance(content, str) else content)
    with pytest.raises(SceneError) as caught:
        if path.suffix == ".xml":
            load_file(path)
        else:
            mesh.read(path, path.suffix[1:], "here")
    return str(caught.value)


def test_messages_hold_no_control_characters(tmp_path: Path) -> None:
    texts = [
        message(tmp_path / "a.obj", f"v 0 0 {ESCAPE}\n"),
        message(tmp_path / "a.ply", f"ply\nformat ascii 1.0\n{ESCAPE}\nend_header\n"),
        message(tmp_path / "a.xml", SCENE.format('<bsdf type="\u202ediffuse"/>')),
        message(tmp_path / "a.xml", SCENE.format('<ref id="\u202e"/>')),
        message(tmp_path / "a.xml", "<scene>\0</scene>"),
    ]
    with pytest.raises(SceneError) as caught:
        load_dict({"type": "scene", "s": {"type": f"cube{ESCAPE}"}})
    for text in (*texts, str(caught.value)):
        assert text.isprintable()
    assert "\\x1b[2J\\x07\\u202e" in texts[0]


def test_warnings_hold_no_control_characters(tmp_path: Path) -> None:
    (tmp_path / "open.obj").write_text("v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 3\n")
    (tmp_path / "a.xml").write_text(SCENE.format(
        '<shape type="obj" id="\u202e"><string name="filename" value="open.obj"/>'
        '<bsdf type="dielectric"/></shape><emitter type="constant"/>'
    ), "utf-8")  # fmt: skip
    with pytest.warns(SceneWarning) as caught:
        load_file(tmp_path / "a.xml")
    assert all(str(w.message).isprintable() for w in caught)


def test_channel_names_are_escaped(tmp_path: Path) -> None:
    import OpenEXR

    path = tmp_path / "a.exr"
    pixels = np.zeros((2, 2), np.float32)
    OpenEXR.File({"type": OpenEXR.scanlineimage}, {f"x{ESCAPE}": pixels}).write(str(path))
    with pytest.raises(image.ImageError) as caught:
        image.load(path)
    assert str(caught.value).isprintable() and "\\x1b" in str(caught.value)


DIGITS = "1" * 60_000
SLOW = {
    "digits of OBJ": ("a.obj", f"v 0 0 {DIGITS}x\n", "is not a finite number"),
    "digits of XML": ("a.xml", SCENE.replace("40", f"{DIGITS}x").format(""), "is not a number"),
    "comments": ("a.xml", "<!--" * 500_000, "not well-formed XML"),
    "many ids": (
        "a.xml",
        SCENE.format(
            "".join(f'<bsdf type="null" id="{k}"/>' for k in range(9000))
            + '<shape type="cube"><ref id="a"/></shape>'
        ),
        'there is no object with the id "a"; known: 0, 1, 10,',
    ),
    "long id": (
        "a.xml",
        SCENE.format(f'<shape type="cube" id="{DIGITS}"><float name="q" value="1"/></shape>'),
        'unknown parameter "q"',
    ),
}


@pytest.mark.parametrize("name", SLOW)
def test_large_files_end_soon_and_with_short_messages(tmp_path: Path, name: str) -> None:
    file, content, words = SLOW[name]
    begin = time.process_time()
    text = message(tmp_path / file, content)
    assert time.process_time() - begin < 2
    assert words in text or name == "long id"
    assert len(text) < 2100


def test_comments_keep_their_lines(tmp_path: Path) -> None:
    text = message(tmp_path / "a.xml", "<!-- a\n<! b --><!---->\n\n<!DOCTYPE x><scene/>")
    assert "a.xml:4: DOCTYPE" in text


@pytest.mark.parametrize(
    "text",
    [
        '<?x <!-- ?><!DOCTYPE scene [<!ENTITY v "3.0.0">]><?x --> ?><scene version="&v;"/>',
        '\ufeff<?xml version="1.0" encoding="UTF-16"?><!DOCTYPE scene><scene version="3.0.0"/>',
        '<!-- <?x --><!DOCTYPE scene SYSTEM "/etc/passwd"><?x ?><scene version="3.0.0"/>',
    ],
)
def test_no_doctype_hides(tmp_path: Path, text: str) -> None:
    for content in (text, text.replace("<scene", "\n<scene")):
        assert "a.xml:1: DOCTYPE and entities are not allowed" in message(
            tmp_path / "a.xml", content
        )


def test_words_about_doctypes_are_no_doctype(tmp_path: Path) -> None:
    bare = SCENE.format('<emitter type="constant"/>')
    (tmp_path / "a.xml").write_text(f"<?x <!DOCTYPE ?><!-- <!ENTITY -->{bare}<!-- <!DOCTYPE -->")
    load_file(tmp_path / "a.xml")


@pytest.mark.parametrize("length", ["inf", "nan", "-inf", "1e300", "2.5", "-3", "4"])
def test_length_of_a_face_is_a_number_of_corners(tmp_path: Path, length: str) -> None:
    head = "ply\nformat ascii 1.0\nelement vertex 3\nproperty float x\nproperty float y\n"
    head += "property float z\nelement face 1\nproperty list uchar int vertex_indices\nend_header\n"
    text = message(tmp_path / "a.ply", f"{head}0 0 0\n1 0 0\n0 1 0\n{length} 0 1 2\n")
    assert "is damaged: line 13 is no element face" in text


def test_damaged_stl_prints_nothing(tmp_path: Path, caplog: pytest.LogCaptureFixture,
                                    capfd: pytest.CaptureFixture[str]) -> None:  # fmt: skip
    level = logging.getLogger("trimesh").level
    text = "solid x\nfacet normal 0 0 zero\nouter loop\nvertex 0 0 0\nvertex 1 0 0\nvertex 0 1 0\n"
    message(tmp_path / "a.stl", text + "endloop\nendfacet\nvertex nan\nendsolid x\n")
    assert not caplog.records and capfd.readouterr() == ("", "")
    assert logging.getLogger("trimesh").level == level


def test_long_names_are_not_repeated(tmp_path: Path) -> None:
    name = "n" * 5000
    head = f"ply\nformat ascii 1.0\nelement {name} 1\nproperty float x\nend_header\n"
    text = message(tmp_path / "a.ply", head + "zero\n")
    assert "bad header line" in text and len(text) < 300


@pytest.mark.parametrize("end", ["0\n3 0 1 2", "zero\n3 0 1 2", "0\n4 0 1 2"])
def test_a_long_word_needs_little_memory(tmp_path: Path, end: str) -> None:
    """Memory grows with the size of a PLY file, not with its words times the longest of them."""
    head = "ply\nformat ascii 1.0\nelement vertex 9000\nproperty float x\nproperty float y\n"
    head += "property float z\nelement face 1\nproperty list uchar int vertex_indices\nend_header\n"
    words = f"{'0' * 60_000}.5 0 {end}"
    tracemalloc.start()
    try:
        text = message(tmp_path / "a.ply", head + "0 0 0\n" * 8999 + words)
        assert tracemalloc.get_traced_memory()[1] < 2**24
    finally:
        tracemalloc.stop()
    assert 'line 9009: "0000000000000000..." (60002 characters)' in text


@pytest.mark.parametrize("name", ["a.obj", "a.ply", "a.stl", "a.xml"])
def test_messages_do_not_read_a_file_aloud(tmp_path: Path, name: str) -> None:
    """A message quotes at most a short word of a file that is something else."""
    secret = "correct-horse-battery-staple-correct-horse"
    data = "ply\nformat ascii 1.0\nelement x 1\nproperty float x\nend_header\n"
    kinds = {
        "a.obj": [
            f"v password {secret}\n",
            f"f 1 2 {secret}\n",
            f"v 0 0 0 {secret}\nv 1 {secret}\n",
        ],
        "a.ply": [
            f"ply\nformat {secret}\nend_header\n",
            f"ply\nformat ascii 1.0\n{secret}\nend_header",
            *(f"{data}{line}\n" for line in (secret, f"1 {secret}", f"1 2 3 {secret}")),
        ],
        "a.stl": [f"solid {secret}\nfacet normal 0 0 1\nvertex 0 0 {secret}\nendfacet\nendsolid\n"],
        "a.xml": [f"password {secret}", f'<scene version="3.0.0">{secret}</scene>'],
    }
    for content in kinds[name]:
        text = message(tmp_path / name, content)
        assert secret[:20] not in text and str(tmp_path / name) in text.replace('"', "")


def test_a_small_file_needs_little_memory(tmp_path: Path) -> None:
    """`read(n)` takes n bytes of memory, whatever the file holds."""
    tracemalloc.start()
    try:
        message(tmp_path / "a.ply", b"1")
        assert tracemalloc.get_traced_memory()[1] < 2**20
    finally:
        tracemalloc.stop()


def test_compare_prints_its_own_lines_alone(
    tmp_path: Path, capfd: pytest.CaptureFixture[str]
) -> None:
    """Neither a picture's text nor the EXR library writes to the terminal."""
    paths = [tmp_path / f"{name}.exr" for name in ("escape-in-region", "escape-other", "truncated")]
    for path in paths:
        path.write_bytes((corpus("exr") / f"found-{path.stem}").read_bytes())
    assert main(["compare", str(paths[0]), str(paths[1])]) == 1
    out, err = capfd.readouterr()
    assert all(line.isprintable() for line in out.split("\n")) and not err
    assert r"\x1b[2J\x1b]0;pwn\x07\nThe pictures agree: forged" in out
    assert main(["compare", str(paths[2]), str(paths[0])]) == 2
    out, err = capfd.readouterr()
    assert not out and err.count("\n") == 1
    assert err.startswith(f"veriray: error: {paths[2]}: not a readable OpenEXR file: ")


def test_tiles_of_an_exr_cannot_take_all_memory() -> None:
    """429 bytes, of tiles of 256,000,032 rows, for which the library took 9 GB."""
    with pytest.raises(image.ImageError, match="tiles of 32 x 256000032 for 3 x 2 pixels"):
        image.load(corpus("exr") / "tall-tiles")


def test_lists_of_known_names_are_short() -> None:
    names = [f"{k:03}" + "x" * 1000 for k in range(1000)]
    assert len(node.allowed("000", names)) < 50 * 45
