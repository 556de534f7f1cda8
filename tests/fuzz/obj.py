"""Wavefront OBJ."""

from tests.fuzz.meshes import target

TARGET = target(
    "obj", ("formats/mesh.py",),
    ("v ", "vt ", "vn ", "f ", "1/1/1", "1//1", "-1", "o x", "usemtl x", "# ", "\\\n", "\r\n"),
)  # fmt: skip
