"""Stanford PLY."""

from tests.fuzz.meshes import target

TARGET = target(
    "ply", ("formats/ply.py",),
    ("ply\n", "format ascii 1.0\n", "format binary_little_endian 1.0\n", "end_header\n",
     "format binary_big_endian 1.0\n", "element vertex 3\n", "element face 1\n",
     "property list uchar int vertex_indices\n", "property float x\n", "vertex_index", "comment ",
     "char", "uchar", "short", "ushort", "int", "uint", "float", "double", "uint8", "int64",
     "property float nx\n", "property float ny\n", "property float nz\n"),
)  # fmt: skip
