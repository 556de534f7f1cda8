"""Objects of Mitsuba 3 as values of a dictionary, read by their methods; it is not imported."""

from __future__ import annotations

import functools
import re
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import numpy as np
import numpy.typing as npt

from ..chunks import in_chunks
from ..errors import SceneError
from . import spectra, volume_grid
from .known import category

Array = npt.NDArray[Any]
#: Numbers of a texel that count, by pixel format: alpha is left out.
_CHANNELS = {"Y": 1, "YA": 1, "RGB": 3, "RGBA": 3, "XYZ": 3, "XYZA": 3}
_ATTRIBUTE = re.compile(r"((?:vertex|face)_[^:\n]*): ([13]) float")


def kind(value: object) -> str:
    """The name of the class of an object of Mitsuba, as "Mesh"; "" of anything else."""
    form: Any = type(value)
    return _name(form)


@functools.lru_cache(256)
def _name(form: type) -> str:
    classes = (one for one in form.__mro__ if one.__module__.partition(".")[0] == "mitsuba")
    return next((one.__name__ for one in classes), "")


@dataclass(frozen=True, eq=False)
class Bitmap:
    """The texels (H, W, 1 or 3) of a mitsuba.Bitmap: integers are shares of their largest. encoded:
    they follow the sRGB curve; xyz: they are, without it, CIE XYZ."""

    texels: Array
    encoded: bool
    xyz: bool

    def plain(self, raw: bool) -> tuple[Array, bool]:
        """Texels of RGB that are uint8 or floats, and whether they follow the curve, which only
        uint8 do; raw: it is left in them."""
        texels, encoded = self.texels, self.encoded and not raw
        form = texels.dtype
        wide = form.kind == "u" and form != np.uint8
        if form.kind not in "uf" or not (self.xyz or wide or encoded and form != np.uint8):
            return texels, encoded
        linear = np.empty(texels.shape, np.float16 if form == np.float16 else np.float32)
        white = np.iinfo(form).max if form.kind == "u" else 1

        def part(first: int, last: int) -> None:
            with np.errstate(all="ignore"):  # what is not finite is found later
                shares = texels[first:last] / np.float64(white)
                shares = spectra.decoded(shares) if encoded else shares
                if self.xyz:
                    x, y, z = np.moveaxis(shares, 2, 0)
                    rows = [a * x + b * y + c * z for a, b, c in spectra.XYZ_TO_RGB]
                    shares = np.stack(rows, axis=2)
                linear[first:last] = shares

        in_chunks(part, len(texels), max(1, 2**14 // max(1, texels.shape[1])))
        return linear, False


def bitmap(value: Any, where: str) -> Bitmap:
    """What a mitsuba.Bitmap holds. Raises SceneError for a pixel format without colours."""
    name = str(value.pixel_format()).rpartition(".")[2]
    if name not in _CHANNELS:
        told = f"a mitsuba.Bitmap of pixel format {name}; expected one of {', '.join(_CHANNELS)}"
        raise SceneError(told, where)
    texels = np.asarray(value)
    texels = texels[:, :, None] if texels.ndim == 2 else texels[:, :, : _CHANNELS[name]]
    return Bitmap(texels, bool(value.srgb_gamma()), name.startswith("XYZ"))


def volume(value: Any, where: str) -> tuple[Array, Array]:
    """The cells and the box of a mitsuba.VolumeGrid, as `volume_grid.read_vol`; only the files that
    it writes tell its box."""
    cells = volume_grid.from_array(value, where)
    try:
        with TemporaryDirectory() as folder:
            path = Path(folder) / "grid.vol"
            value.write(str(path))
            return cells, volume_grid.read_vol(path, where)[1]
    except OSError as error:
        raise SceneError(f"no box of a mitsuba.VolumeGrid: {error}", where) from None


def mesh(value: Any, where: str, around: Mapping[str, Any]) -> dict[str, Any]:
    """A mitsuba.Mesh as a dictionary of its arrays, which are those in the world; without vertex
    normals it is flat. around: the dictionary that it is the "mesh" of, empty if it is the shape.

    Raises SceneError if the mesh has what cannot be read from it, and `around` has none such.
    """
    lamp = value.is_emitter()
    grey = r"0(\.0+)?" if lamp else r"0\.50*"
    usual = rf"SmoothDiffuse\[\s*reflectance = UniformSpectrum\[value=\[?{grey}\]?\]\s*\]"
    has = {
        "bsdf": value.bsdf() is not None and not re.fullmatch(usual, str(value.bsdf())),
        "emitter": lamp,
        "sensor": value.is_sensor(),
        "medium": value.interior_medium() is not None or value.exterior_medium() is not None,
    }
    types = [str(one.get("type")) for one in around.values() if isinstance(one, Mapping)]
    given = {category(name) for name in types} | ({"bsdf", "medium"} if "ref" in types else set())
    lost = [name for name, there in has.items() if there and name not in given]
    if lost:
        parts = ", ".join(f"'{name}': {{...}}" for name in lost)
        raise SceneError(
            f"a mitsuba.Mesh with {' and '.join(lost)} that cannot be read from it; give "
            f"{{'type': 'mesh', 'mesh': the mesh, {parts}}}",
            where,
        )

    def rows(buffer: Any, width: int) -> Array:
        return np.array(buffer).reshape(-1, width)

    found = {
        "type": "mesh",
        "vertices": rows(value.vertex_positions_buffer(), 3),
        "faces": rows(value.faces_buffer(), 3),
        "flip_normals": bool(value.has_flipped_normals()),
    }
    if value.has_vertex_normals():
        found["normals"] = rows(value.vertex_normals_buffer(), 3)
    else:
        found["face_normals"] = True
    if value.has_vertex_texcoords():
        found["uv"] = rows(value.vertex_texcoords_buffer(), 2)
    if value.has_mesh_attributes():
        for name, width in _ATTRIBUTE.findall(str(value)):
            found[name] = rows(value.attribute_buffer(name), int(width))
    return found
