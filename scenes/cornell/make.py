#!/usr/bin/env python3
"""Makes cornell_box.xml and meshes/*.obj from the measured data beside this file.

    python scenes/cornell/make.py [--check]

--check compares with the files that are there and writes nothing (exit status 1 if they differ).
Needs numpy and colour-science (the CIE 1931 2 degree colour matching functions, 1 nm).

Colour: XYZ = integral(R S cmf) / integral(S ybar) by the trapezoidal rule on a 1 nm grid from 400
to 700 nm, R (4 nm) and S (100 nm) interpolated linearly; linear RGB with BT.709 primaries and the
D65 white (0.3127, 0.3290), no adaptation, no clipping. The light's RGB is integral(L cmf) /
integral(ybar), so that a spectrum of constant 1 has Y = 1.

Albedo: an RGB renderer multiplies the light's RGB by the albedo, channel by channel. The albedo
RGB(R L) / RGB(L) makes that product exact at the first bounce, so it is what cornell_box.xml holds
(not the colour under an equal-energy light, whose red exceeds 1 for a perfect diffuser).
"""

from __future__ import annotations

import csv
import json
import math
import sys
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

HERE = Path(__file__).resolve().parent
PAINTS = ("white", "green", "red")
Array = npt.NDArray[np.float64]

HEAD = """<?xml version="1.0" encoding="utf-8"?>
<!-- The measured Cornell box, in millimetres, made by make.py from the data beside it (README.md).
     Override the defaults with -D name=value. -->
<scene version="3.0.0">
    <default name="spp" value="64"/>
    <default name="width" value="512"/>
    <default name="height" value="512"/>
    <default name="max_depth" value="-1"/>
    <default name="rr_depth" value="5"/>

    <integrator type="path">
        <integer name="max_depth" value="$max_depth"/>
        <integer name="rr_depth" value="$rr_depth"/>
    </integrator>
    <sensor type="perspective">
        <float name="fov" value="{fov!r}"/>
        <transform name="to_world">
            <lookat origin="{origin}" target="{target}" up="{up}"/>
        </transform>
        <film type="hdrfilm">
            <integer name="width" value="$width"/>
            <integer name="height" value="$height"/>
            <rfilter type="box"/>
        </film>
        <sampler type="independent">
            <integer name="sample_count" value="$spp"/>
        </sampler>
    </sensor>
"""


def read_table(name: str) -> dict[str, Array]:
    """Columns of a CSV file by their names."""
    with open(HERE / name, newline="", encoding="ascii") as file:
        rows = list(csv.reader(file))
    columns = np.array([[float(x) for x in row] for row in rows[1:]]).T
    return dict(zip(rows[0], columns, strict=True))


def xyz_to_rgb() -> Array:
    """Matrix from XYZ to linear RGB: BT.709 primaries, D65 white, unrounded."""
    primaries = ((0.640, 0.330), (0.300, 0.600), (0.150, 0.060))
    columns = np.array([[x / y, 1.0, (1.0 - x - y) / y] for x, y in primaries]).T
    x, y = 0.3127, 0.3290
    white = np.array([x / y, 1.0, (1.0 - x - y) / y])
    return np.linalg.inv(columns * np.linalg.solve(columns, white))


def integral(values: Array, wavelengths: Array) -> Array:
    """Trapezoidal rule along the first axis."""
    steps = np.diff(wavelengths)
    return np.tensordot(steps, 0.5 * (values[1:] + values[:-1]), axes=(0, 0))


def derive() -> dict[str, Any]:
    """Light and reflectances as XYZ and linear RGB, in the layout of derived_rgb.json "values"."""
    import colour

    cmfs = colour.MSDS_CMFS["CIE 1931 2 Degree Standard Observer"]
    wl = np.arange(400.0, 701.0)
    cmf = np.stack(
        [np.interp(wl, cmfs.wavelengths, np.asarray(cmfs.values)[:, i]) for i in range(3)], axis=1
    )
    to_rgb = xyz_to_rgb()
    reflectance = read_table("reflectance.csv")
    emission = read_table("emission.csv")
    light = np.interp(wl, emission["wavelength_nm"], emission["emission"])
    lamp = json.loads((HERE / "light.json").read_text())["reflectance"]
    surfaces = {
        name: np.interp(wl, reflectance["wavelength_nm"], reflectance[name]) for name in PAINTS
    }
    surfaces[f"light_surface_{lamp}"] = np.full_like(wl, lamp)
    surfaces["perfect_diffuser_1.0"] = np.ones_like(wl)

    result: dict[str, Any] = {}
    for key, source in (("equal_energy_E", np.ones_like(wl)), ("measured_light", light)):
        norm = integral(source * cmf[:, 1], wl)
        source_rgb = to_rgb @ (integral(source[:, None] * cmf, wl) / norm)
        result[key] = {}
        for name, surface in surfaces.items():
            xyz = integral((surface * source)[:, None] * cmf, wl) / norm
            rgb = to_rgb @ xyz
            result[key][name] = {"XYZ": xyz.tolist(), "rgb": rgb.tolist()}
            if key == "measured_light":
                result[key][name]["rgb_over_light_rgb"] = (rgb / source_rgb).tolist()
    xyz = integral(light[:, None] * cmf, wl) / integral(cmf[:, 1], wl)
    result["light_emission"] = {
        "XYZ_over_ybar": xyz.tolist(),
        "rgb_over_ybar": (to_rgb @ xyz).tolist(),
    }
    return result


def rectangles(geometry: dict[str, Any]) -> dict[str, tuple[str, Array]]:
    """All quads as name -> (material, corners (4, 3)), the ceiling in four pieces.

    The pieces leave the light's opening free: two over the whole width before and behind it, two
    beside it. So the light stays at its measured height with no surface in the same place.
    """
    quads = {
        q["name"]: (q["material"], np.array(q["vertices"]))
        for q in geometry["quads"]
        if q["name"] != "ceiling"
    }
    ceiling = np.array(next(q["vertices"] for q in geometry["quads"] if q["name"] == "ceiling"))
    hole = np.array(geometry["holes"]["ceiling_light_opening"])
    height = ceiling[0, 1]
    (x0, z0), (x1, z1) = ceiling[:, ::2].min(axis=0), ceiling[:, ::2].max(axis=0)
    (hx0, hz0), (hx1, hz1) = hole[:, ::2].min(axis=0), hole[:, ::2].max(axis=0)
    pieces = {
        "front": (x0, x1, z0, hz0),
        "back": (x0, x1, hz1, z1),
        "left": (hx1, x1, hz0, hz1),
        "right": (x0, hx0, hz0, hz1),
    }
    for name, (xa, xb, za, zb) in pieces.items():
        corners = [[xb, height, za], [xb, height, zb], [xa, height, zb], [xa, height, za]]
        quads[f"ceiling_{name}"] = ("white", np.array(corners))
    return quads


def rectangle_matrix(corners: Array) -> Array | None:
    """to_world that makes Mitsuba's rectangle these corners, bit for bit, or None if none does."""
    centre = 0.5 * (corners[0] + corners[2])
    u, v = 0.5 * (corners[1] - corners[0]), 0.5 * (corners[3] - corners[0])
    signs = ((-1, -1), (1, -1), (1, 1), (-1, 1))
    if any((centre + (a * u + b * v) != c).any() for (a, b), c in zip(signs, corners, strict=True)):
        return None
    normal = np.cross(u, v)
    normal = normal / math.sqrt(float((normal * normal).sum())) + 0.0
    return np.array([u, v, normal, centre]).T


def number(x: float) -> str:
    """Shortest text that reads back as x."""
    return repr(float(x) + 0.0).removesuffix(".0")


def numbers(values: Any) -> str:
    """Numbers separated by commas."""
    return ", ".join(number(x) for x in values)


def shape_xml(name: str, material: str, corners: Array, radiance: str) -> tuple[str, str]:
    """A quad's XML, and its OBJ file if it is not a parallelogram (else "")."""
    matrix = rectangle_matrix(corners)
    ref = f'        <ref id="{material}"/>\n{radiance}    </shape>\n'
    if matrix is not None:
        rows = [*(" ".join(number(x) for x in row) for row in matrix), "0 0 0 1"]
        text = ("\n" + 27 * " ").join(rows)
        return (
            f'    <shape type="rectangle" id="{name}">\n        <transform name="to_world">\n'
            f'            <matrix value="{text}"/>\n        </transform>\n{ref}',
            "",
        )
    lines = ["v " + " ".join(number(x) for x in corner) for corner in corners]
    mesh = "\n".join(["# Cornell box, made by make.py", *lines, "f 1 2 3", "f 1 3 4", ""])
    return (
        f'    <shape type="obj" id="{name}">\n'
        f'        <string name="filename" value="meshes/{name}.obj"/>\n'
        f'        <boolean name="face_normals" value="true"/>\n{ref}',
        mesh,
    )


def make() -> dict[str, str]:
    """Contents of every file that this program makes, by path."""
    colours = derive()
    geometry = json.loads((HERE / "geometry.json").read_text())
    camera = json.loads((HERE / "camera.json").read_text())
    light = json.loads((HERE / "light.json").read_text())
    position, direction = np.array(camera["position_mm"]), np.array(camera["direction"])
    tangent = 0.5 * camera["film_width_m"] / camera["focal_length_m"]
    parts = [
        HEAD.format(
            fov=round(math.degrees(2.0 * math.atan(tangent)), 12),
            origin=numbers(position),
            target=numbers(position + direction),
            up=numbers(camera["up"]),
        )
    ]
    albedo = {p: colours["measured_light"][p]["rgb_over_light_rgb"] for p in PAINTS}
    albedo["light"] = [light["reflectance"]] * 3
    for name, value in albedo.items():
        parts.append(
            f'    <bsdf type="diffuse" id="{name if name != "light" else "lamp"}">\n'
            f'        <rgb name="reflectance" value="{numbers(round(x, 6) for x in value)}"/>\n'
            "    </bsdf>\n"
        )
    radiance = numbers(round(x, 6) for x in colours["light_emission"]["rgb_over_ybar"])
    emitter = (
        '        <emitter type="area">\n'
        f'            <rgb name="radiance" value="{radiance}"/>\n        </emitter>\n'
    )
    files = {}
    for name, (material, corners) in rectangles(geometry).items():
        lamp = material == "light"
        xml, mesh = shape_xml(name, "lamp" if lamp else material, corners, emitter if lamp else "")
        parts.append(xml)
        if mesh:
            files[f"meshes/{name}.obj"] = mesh
    files["cornell_box.xml"] = "\n".join(parts) + "</scene>\n"
    return files


def main() -> int:
    """Writes or checks the files; the exit status."""
    different = []
    for name, text in make().items():
        path = HERE / name
        if "--check" in sys.argv[1:]:
            if not path.is_file() or path.read_text(encoding="utf-8") != text:
                different.append(name)
        else:
            path.parent.mkdir(exist_ok=True)
            path.write_text(text, encoding="utf-8", newline="\n")
    if different:
        print("differ from the data:", ", ".join(different))
    return 1 if different else 0


if __name__ == "__main__":
    sys.exit(main())
