"""The measured Cornell box by wavelengths: spectra, their sum to CIE XYZ, colour differences.

XYZ are integrals of radiance times the CIE 1931 2 degree functions, divided by the integral of
y-bar, from 400 to 700 nm on a grid of 1 nm by the trapezoidal rule. Between the measured points
(4 nm apart, the lamp's 100 nm) spectra are linear. So a spectrum of constant 1 has Y = 1, and RGB
(linear, BT.709 primaries, D65 white) is a matrix times XYZ, as in scenes/cornell/make.py.

A diffuse scene is monochromatic at every wavelength: its radiance there depends on the reflectances
and the emission at this wavelength alone. Three wavelengths make one render, as its R, G and B.
"""

from __future__ import annotations

import csv
import dataclasses
import functools
import json
import math
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
import numpy.typing as npt

from veriray.scene import Scene
from veriray.shipped import find_shipped
from veriray_validate.form_factors import (
    lambert,
    mean_over,
    parallel_rectangles,
    perpendicular_rectangles,
)

Array = npt.NDArray[np.float64]

PAINTS = ("white", "green", "red")
#: Measured wavelengths of the paints in nm.
NODES: Array = np.arange(400.0, 701.0, 4.0)
#: The grid of the integrals.
FINE: Array = np.arange(400.0, 701.0)
#: Corners of the lamp in mm, facing down.
LAMP = ((343.0, 548.8, 227.0), (343.0, 548.8, 332.0), (213.0, 548.8, 332.0), (213.0, 548.8, 227.0))
#: Surface -> a shape of the scene with its paint.
_SAMPLES = {"white": "floor", "lamp": "light", "green": "right_wall", "red": "left_wall"}


# ---- spectra ----


@functools.cache
def _table(name: str) -> dict[str, Array]:
    """Columns of a data file of the box."""
    with open(find_shipped("cornell-box").parent / name, newline="", encoding="ascii") as file:
        head, *rows = list(csv.reader(file))
    columns = np.array([[float(x) for x in row] for row in rows]).T
    return dict(zip(head, columns, strict=True))


def reflectance(wavelengths: Any) -> dict[str, Array]:
    """Reflectance of white, green, red and lamp at `wavelengths` (nm)."""
    at, table = np.asarray(wavelengths, np.float64), _table("reflectance.csv")
    result = {p: np.interp(at, table["wavelength_nm"], table[p]) for p in PAINTS}
    text = (find_shipped("cornell-box").parent / "light.json").read_text("utf-8")
    result["lamp"] = np.full(at.shape, float(json.loads(text)["reflectance"]))
    return result


def emission(wavelengths: Any) -> Array:
    """Spectral radiance of the lamp at `wavelengths` (nm), in the unit of the published data."""
    table = _table("emission.csv")
    return np.interp(wavelengths, table["wavelength_nm"], table["emission"])


def repaint(scene: Scene, paints: Mapping[str, Any], lamp: Any) -> Scene:
    """The measured box with other columns: paints white, green, red, lamp (3,), and emission (3,).

    Three wavelengths (`reflectance`, `emission`), or three colours.
    """
    columns = np.array(scene.reflectance, np.float64)
    shapes = np.asarray(scene.triangle_shape)
    for paint, shape in _SAMPLES.items():
        row = np.flatnonzero(shapes == scene.shape_names.index(shape))[0]
        columns[scene.triangle_material[row]] = paints[paint]
    return dataclasses.replace(scene, reflectance=columns, emissions=np.asarray(lamp)[None])


# ---- XYZ ----


@functools.cache
def observer() -> Array:
    """The CIE 1931 2 degree functions at FINE, (301, 3), from colour-science."""
    import colour

    cmfs = colour.MSDS_CMFS["CIE 1931 2 Degree Standard Observer"]
    values = np.asarray(cmfs.values, np.float64)
    return np.stack([np.interp(FINE, cmfs.wavelengths, values[:, i]) for i in range(3)], axis=1)


def _integral(values: Array) -> Array:
    """Trapezoidal rule over FINE, along the first axis."""
    return np.asarray(values.sum(axis=0) - 0.5 * (values[0] + values[-1]))


def xyz(spectrum: Any) -> Array:
    """XYZ (..., 3) of a spectrum (301, ...) at FINE."""
    s = np.asarray(spectrum, np.float64)
    return _integral(s[..., None] * _like(observer(), s)) / _integral(observer()[:, 1])


def _like(cmfs: Array, s: Array) -> Array:
    return cmfs.reshape(len(cmfs), *[1] * (s.ndim - 1), 3)


def weights(nodes: Any) -> Array:
    """Weights (n, 3): XYZ of a spectrum that is linear between its values at `nodes`."""
    return np.stack([xyz(np.interp(FINE, nodes, row)) for row in np.eye(len(nodes))])


def thinned(step: int) -> Array:
    """Indices into NODES: every `step`-th, and the last."""
    kept = np.arange(0, len(NODES), step)
    return kept if kept[-1] == len(NODES) - 1 else np.append(kept, len(NODES) - 1)


@functools.cache
def to_rgb() -> Array:
    """Matrix from XYZ to linear RGB: BT.709 primaries, D65 white (0.3127, 0.3290), unrounded."""
    primaries = ((0.640, 0.330), (0.300, 0.600), (0.150, 0.060))
    columns = np.array([[x / y, 1.0, (1.0 - x - y) / y] for x, y in primaries]).T
    x, y = 0.3127, 0.3290
    return np.linalg.inv(columns * np.linalg.solve(columns, [x / y, 1.0, (1.0 - x - y) / y]))


def colours(lit: bool = True) -> tuple[dict[str, Array], Array]:
    """Reflectances and emission as linear RGB.

    lit: RGB of the light that the surface reflects, divided by RGB of the lamp, which makes the
    first bounce exact; else, as is common, RGB of the surface under an equal-energy light.
    """
    light = emission(FINE) if lit else np.ones(len(FINE))
    white = to_rgb() @ xyz(light) if lit else xyz(light)[1]
    paints = {k: to_rgb() @ xyz(r * light) / white for k, r in reflectance(FINE).items()}
    return paints, to_rgb() @ xyz(emission(FINE))


def delta_e(a: Any, b: Any, luminance: float) -> Array:
    """CIE Delta E 2000 between XYZ (..., 3), by colour-science.

    White has the lamp's chromaticity, to which an eye in the box is adapted, at Y = `luminance`.
    """
    import colour

    white = colour.XYZ_to_xy(xyz(emission(FINE)))
    labs = [colour.XYZ_to_Lab(np.asarray(x) / luminance, white) for x in (a, b)]
    return np.asarray(colour.delta_E(*labs, method="CIE 2000"), np.float64)


# ---- what to expect ----


WALLS = ("floor", "ceiling", "back wall", "left wall", "right wall")
_SURFACES = ("white", "white", "white", "red", "green", None)  # the last one is the opening
_SIZE = (556.0, 548.8, 559.2)


@functools.cache
def _exchange() -> tuple[Array, Array]:
    """Form factors (6, 6) between the sides of the empty box, and (6,) from each to the lamp.

    J. R. Howell's C-11 and C-14; means over the sides of Lambert's polygon.
    """
    axis = (1, 1, 2, 0, 0, 2)
    between = np.zeros((6, 6))
    for i, j in np.argwhere(~np.eye(6, dtype=bool)):
        if axis[i] == axis[j]:
            a, b = (_SIZE[k] for k in range(3) if k != axis[i])
            between[i, j] = parallel_rectangles(a, b, _SIZE[axis[i]])
        else:
            edge = next(_SIZE[k] for k in range(3) if k not in (axis[i], axis[j]))
            between[i, j] = perpendicular_rectangles(_SIZE[axis[j]], _SIZE[axis[i]], edge)
    x, y, z = _SIZE
    places = {
        0: ((0, 1, 0), lambda u, v: (u, 0, v), x, z),
        2: ((0, 0, -1), lambda u, v: (u, v, z), x, y),
        3: ((-1, 0, 0), lambda u, v: (x, u, v), y, z),
        4: ((1, 0, 0), lambda u, v: (0, u, v), y, z),
    }
    lamp = np.zeros(6)
    for side, (normal, place, a, b) in places.items():
        lamp[side] = mean_over(
            lambda u, v, p=place, n=normal: lambert(p(u, v), n, LAMP), a, b, n=12
        )  # fmt: skip
    return between, lamp


def radiosity(paints: Mapping[str, Any]) -> tuple[Array, Array]:
    """Radiance of WALLS over the lamp's, (5, ...), in the empty box: all light, indirect alone.

    C. M. Goral, K. E. Torrance, D. P. Greenberg and B. Battaile, SIGGRAPH 1984: a matrix of form
    factors, every wall of one radiance. paints: white, green, red, each (...).
    """
    between, lamp = _exchange()
    shape = np.shape(paints["white"])
    rho = np.stack([np.zeros(shape) if p is None else np.asarray(paints[p]) for p in _SURFACES])
    first = (rho.T * lamp).T
    system = np.eye(6) - rho.reshape(6, -1).T[:, :, None] * between
    total = np.linalg.solve(system, first.reshape(6, -1).T[:, :, None])[..., 0].T.reshape(rho.shape)
    return total[:5], (total - first)[:5]


@functools.cache
def expected(luminance: float) -> dict[str, Array]:
    """The error of RGB rendering that five plain walls predict, for WALLS; see `radiosity`.

    xyz, rgb: XYZ (5, 3) by spectra and by RGB; all, shade: Delta E of their difference, of all
    light and of indirect light alone; quadrature: relative error (5, 3) of XYZ with NODES alone.
    """
    spectra = radiosity(reflectance(FINE))
    paints, lamp = colours()
    by_rgb = radiosity(paints)
    truth, theirs = [], []
    for s, c in zip(spectra, by_rgb, strict=True):
        truth.append(xyz((s * emission(FINE)).T))
        theirs.append(c * lamp @ np.linalg.inv(to_rgb()).T)
    coarse = (radiosity(reflectance(NODES))[0] * emission(NODES)) @ weights(NODES)
    return {
        "xyz": truth[0], "rgb": theirs[0], "quadrature": coarse / truth[0] - 1,
        "all": delta_e(theirs[0], truth[0], luminance),
        "shade": delta_e(theirs[1], truth[1], luminance),
    }  # fmt: skip


def products(degree: int) -> tuple[list[str], Array]:
    """Spectra that light of the lamp can have after 1 to `degree` reflections: names, (301, m).

    Light in the box is a sum of such products of reflectances, with weights >= 0 that depend on the
    geometry. So any linear functional of a pixel's light over its XYZ lies between those of the
    products. The lamp's own reflectance is constant and changes no ratio.
    """
    rho, names, rows = reflectance(FINE), [], []
    for n in range(1, degree + 1):
        for g in range(n + 1):
            for r in range(n + 1 - g):
                names.append(f"white^{n - g - r} green^{g} red^{r}")
                rows.append(emission(FINE) * rho["white"] ** (n - g - r) * rho["green"] ** g
                            * rho["red"] ** r)  # fmt: skip
    return names, np.stack(rows, axis=1)


# ---- what is seen where ----


PARTS: dict[str, Sequence[str]] = {
    "floor": ("floor",),
    "ceiling": ("ceiling_front", "ceiling_back", "ceiling_left", "ceiling_right"),
    "back wall": ("back_wall",),
    "left wall": ("left_wall",),
    "right wall": ("right_wall",),
    "short block": ("short_block_top", *(f"short_block_side_{k}" for k in range(1, 5))),
    "tall block": ("tall_block_top", *(f"tall_block_side_{k}" for k in range(1, 5))),
    "lamp": ("light",),
}
MIXED, OUTSIDE = -1, -2


def parts(scene: Scene, size: int) -> npt.NDArray[np.int64]:
    """Which of PARTS each pixel of a size x size picture shows; MIXED, or OUTSIDE for nothing.

    Uses 3 x 3 rays per pixel; a pixel through which any ray leaves is OUTSIDE.
    """
    place = (np.arange(3 * size) + 0.5) / (3 * size)
    camera = scene.camera
    x = (1 - 2 * place) * camera.tan_half_x(size, size)
    y = (1 - 2 * place) * camera.tan_half_y(size, size)
    local = np.stack(np.broadcast_arrays(x[None, :], y[:, None], 1.0), axis=-1)
    to_world = np.asarray(camera.to_world)
    direction = local.reshape(-1, 3) @ to_world[:3, :3].T
    nearest = np.full(len(direction), np.inf)
    shape = np.full(len(direction), -1)
    for corners, own in zip(
        scene.vertices[scene.triangles], np.asarray(scene.triangle_shape), strict=True
    ):
        a, b = corners[1] - corners[0], corners[2] - corners[0]
        s = to_world[:3, 3] - corners[0]
        p, q = np.cross(direction, b), np.cross(s, a)
        with np.errstate(divide="ignore", invalid="ignore"):
            scale = 1 / (p @ a)
            u, v, t = (p @ s) * scale, (direction @ q) * scale, (b @ q) * scale
        hit = (u >= 0) & (v >= 0) & (u + v <= 1) & (t > 0) & (t < nearest)
        nearest[hit], shape[hit] = t[hit], own
    part = {scene.shape_names.index(n): k for k, names in enumerate(PARTS.values()) for n in names}
    of_shape = np.array([*(part[k] for k in range(len(scene.shape_names))), OUTSIDE])
    rays = of_shape[shape].reshape(size, 3, size, 3).transpose(0, 2, 1, 3).reshape(size, size, 9)
    alike = (rays == rays[..., :1]).all(axis=-1)
    out = np.where(alike, rays[..., 0], MIXED)
    return np.where((rays == OUTSIDE).any(axis=-1), OUTSIDE, out)


def brightest(truth: Array, part: npt.NDArray[np.int64]) -> float:
    """Y of a perfect diffuser in the brightest place of a white wall: white in `delta_e`.

    The 99.5th percentile of Y over pixels that show no lamp, over the reflectance of white paint
    for the lamp's light.
    """
    seen = (part >= 0) & (part != list(PARTS).index("lamp"))
    light = emission(FINE)
    paint = xyz(light * reflectance(FINE)["white"])[1] / xyz(light)[1]
    return float(np.percentile(truth[..., 1][seen], 99.5) / paint)


def blocks(image: Any, size: int) -> Array:
    """Means over size x size pixels: (..., H, W, 3) to (..., H / size, W / size, 3)."""
    x = np.asarray(image, np.float64)
    *front, height, width, channels = x.shape
    shape = (*front, height // size, size, width // size, size, channels)
    return np.asarray(x.reshape(shape).mean(axis=(-4, -2)))


def same(part: npt.NDArray[np.int64], size: int) -> npt.NDArray[np.int64]:
    """`parts` in blocks of size x size pixels: MIXED unless all are equal, OUTSIDE if one is."""
    height, width = part.shape
    cell = part.reshape(height // size, size, width // size, size).transpose(0, 2, 1, 3)
    cell = cell.reshape(height // size, width // size, -1)
    out = np.where((cell == cell[..., :1]).all(axis=-1), cell[..., 0], MIXED)
    return np.where((cell == OUTSIDE).any(axis=-1), OUTSIDE, out)


def rms(x: Any) -> float:
    """Root mean square."""
    return math.sqrt(float(np.mean(np.square(x))))
