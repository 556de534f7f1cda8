"""STL, through trimesh."""

from tests.fuzz.meshes import target

TARGET = target(
    "stl", ("formats/mesh.py",),
    ("solid ", "endsolid ", "facet normal 0 0 1\n", "outer loop\n", "vertex 0 0 0\n", "endloop\n",
     "endfacet\n"),
)  # fmt: skip
