"""What a valid scene is, checked without the package's own checks."""

from __future__ import annotations

import random
import re
import struct
import zlib

import numpy as np

from veriray.columns import COLUMNS
from veriray.formats import spectra
from veriray.formats.known import MITSUBA
from veriray.formats.plugins import CATEGORIES, IORS, PLUGINS
from veriray.scene import Scene

NUMBERS = (
    "0", "1", "-1", "0.5", "1e-30", "1e30", "1e100", "1e-320", "1e38", "3.5e38", "-0.0", "nan",
    "inf", "2147483647", "4294967296", "18446744073709551615", "90", "180", "1, 2, 3", "1 0 0",
)  # fmt: skip
_TAGS = (
    "float", "integer", "boolean", "string", "rgb", "spectrum", "point", "vector", "transform",
    "ref", "default", "include", "path", "srgb", "alias", "lookAt", "blackbody", "texture",
    "translate", "scale", "rotate", "lookat", "matrix",
)  # fmt: skip
_SPECTRA = (
    *spectra.PLUGINS, "temperature", "color", "range", "values", "wavelengths", "wavelength_min",
    "wavelength_max", "unbounded", "400:1 700:2", "500:0.1, 600:0.3", "#ff8000", "Au", "a.spd",
)  # fmt: skip
_OLD = (
    "5000K", "toWorld", "diffuseReflectance", "uscale", "bdpt", "ldrfilm", "sobol", "mixturebsdf",
    "weights", "adaptive", "0.5.0", "sky", "sun", "sunRadiusScale", "stretch", "luminaire",
    "camera", "animation", "subsurface", "dipole", "hk", "irawan", "difftrans",
    "gridtexture", "wireframe",
    "lineWidth", "channel", "gamma", "wrapModeU", "zero", "rayleigh", "microflake", "mixturephase",
    "volcache", "density", "orientation", "method", "material", "skin1", "sigmaS", "sigmaA",
    "haltonsampler", "telecentric", "perspective_rdist", "kc", "ao", "field", "vertexcolors",
)  # fmt: skip
NAMES = tuple(sorted({
    *CATEGORIES, *PLUGINS,
    *(n for p in PLUGINS.values() for n in (*p.params, *p.unsupported, *p.noted)),
    *MITSUBA, *(name for names in MITSUBA.values() for name in names),
    *_TAGS, "interior", "exterior", "true", "false", "a", "$a", "${a}", "mesh.obj", "mesh.ply",
    "mesh.stl", "mesh.serialized", "part.xml", ".", *list(IORS)[:3], "50mm", *_SPECTRA, *_OLD,
}))  # fmt: skip
ATTRIBUTES = ("type", "id", "name", "value", "x", "y", "z", "angle", "origin", "target", "up",
              "filename", "version", "as", "temperature")  # fmt: skip
TRIANGLE = b"v 0 0 0\nv 1 0 0\nv 0 1 0\n"
STL = b"solid x\nfacet normal 0 0 1\nouter loop\nvertex 0 0 0\nvertex 1 0 0\nvertex 0 1 0\nendloop\nendfacet\nendsolid x\n"  # noqa: E501
PLY = (
    b"ply\nformat ascii 1.0\nelement vertex 3\nproperty float x\nproperty float y\n"
    b"property float z\nelement face 1\nproperty list uchar int vertex_indices\nend_header\n"
    b"0 0 0\n1 0 0\n0 1 0\n3 0 1 2\n"
)
SERIALIZED = struct.pack("<HH", 0x041C, 3) + zlib.compress(
    struct.pack("<IQQ9f3I", 0x1000, 3, 1, 0, 0, 0, 1, 0, 0, 0, 1, 0, 0, 1, 2)
)
BESIDE = {
    "mesh.serialized": SERIALIZED,
    "a.spd": b"# x\n400 0.1\n700 0.5\n",
    "mesh.obj": TRIANGLE + b"f 1 2 3\n", "mesh.stl": STL, "mesh.ply": PLY,
    "part.xml": b'<scene version="3.0.0"><shape type="cube"/></scene>',
    "scene.xml": b'<scene version="3.0.0"><sensor type="perspective"><float name="fov" value="40"/>'
                 b'</sensor><shape type="KIND"><string name="filename" value="input.KIND"/></shape>'
                 b"</scene>",
}  # fmt: skip


def problem(scene: Scene) -> str:
    """What is wrong with a scene that was loaded."""
    for name in COLUMNS:
        values = getattr(scene, name)
        if values.dtype.kind == "f" and not np.isfinite(values).all():
            return f"{name} is not finite"
    tables = {"vertices": "triangles", "reflectance": "material", "emissions": "emission",
              "boundaries": "boundary"}  # fmt: skip
    for table, users in tables.items():
        rows = len(getattr(scene, table))
        names = [users] if users == "triangles" else [f"{kind}_{users}" for kind in
                                                      ("triangle", "sphere", "disk")]  # fmt: skip
        for name in names:
            index = np.asarray(getattr(scene, name), np.int64)
            if index.size and (index.max() >= rows or index.min() < -1):
                return f"{name} is out of range"
    if not 1 <= scene.film.width * scene.film.height < 2**31:
        return "the film's size is out of range"
    if not np.isfinite(scene.camera.to_world).all():
        return "the camera is not finite"
    return "" if re.fullmatch("[0-9a-f]{64}", scene.sha256) else "it has no hash"


def lines(data: bytes, rng: random.Random) -> bytes | None:
    """Mutates a text of lines: one is removed, repeated, moved, or one word of it replaced."""
    rows = data.split(b"\n")
    i, j = rng.randrange(len(rows)), rng.randrange(len(rows))
    choice = rng.randrange(5)
    if choice == 0:
        del rows[i]
    elif choice == 1:
        rows.insert(i, rows[j])
    elif choice == 2:
        rows[i], rows[j] = rows[j], rows[i]
    else:
        words, others = rows[i].split(b" "), rows[j].split(b" ")
        new = rng.choice(others) if choice == 3 else rng.choice(NUMBERS).encode()
        words[rng.randrange(len(words))] = new
        rows[i] = b" ".join(words)
    return b"\n".join(rows)
