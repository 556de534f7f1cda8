# ruff: noqa: D103, E501 (elements by their names; tables of them)
"""The scenes of `beside_mitsuba.py`: a stage in which each parameter of tests/plugins shows, and more of them."""

from __future__ import annotations

import struct
import sys
import zlib
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from common import ROOT
from PIL import Image

sys.path.insert(0, str(ROOT))
from tests.plugins import scenes  # noqa: E402

SIZE = 32
_TURNED = "0.96 0 0.28 {} 0 1 0 {} -0.28 0 0.96 {} 0 0 0 1"
_SMALLER = "0.864 0 0.252 0.2 0 0.9 0 0.3 -0.252 0 0.864 0.4 0 0 0 1"
#: The tables' values, in this stage.
_OTHER = {
    '<vector name="direction" value="0.1 0.2 0.3"/>': '<vector name="direction" value="0.3 -1 0.5"/>',
    '<vector name="sun_direction" value="0 1 1"/>': '<vector name="sun_direction" value="-0.3 1 -0.6"/>',
    '<vector name="sun_direction" value="0.1 0.2 0.3"/>': '<vector name="sun_direction" value="0.6 0.7 -0.3"/>',
    '<float name="int_ior" value="0.3"/>': '<float name="int_ior" value="1.8"/>',
    '<float name="ext_ior" value="0.3"/>': '<float name="ext_ior" value="1.2"/>',
    '<float name="longitudinal_roughness" value="0.3"/>': '<float name="longitudinal_roughness" value="0.6"/>',
    '<float name="azimuthal_roughness" value="0.3"/>': '<float name="azimuthal_roughness" value="0.6"/>',
    '<float name="scale_tilt" value="0.3"/>': '<float name="scale_tilt" value="8"/>',
    '<float name="max_value" value="0.3"/>': '<float name="max_value" value="1.5"/>',
    '<texture type="bitmap" name="normalmap"><string name="filename" value="a.png"/></texture>':
        '<texture type="bitmap" name="normalmap"><string name="filename" value="normals.png"/><boolean name="raw" value="true"/></texture>',
}  # fmt: skip


@dataclass(frozen=True)
class Case:
    """A scene: its name, text, the case that it changes one thing of, pixels at the rim to leave out."""

    name: str
    text: str
    base: str | None = None
    border: int = 0


def film(width: int = SIZE, height: int = SIZE, rest: str = '<rfilter type="box"/>') -> str:
    return (f'<film type="hdrfilm"><integer name="width" value="{width}"/>'
            f'<integer name="height" value="{height}"/>{rest}</film>')  # fmt: skip


def at(*steps: str) -> str:
    return f'<transform name="to_world">{"".join(steps)}</transform>'


def scale(*s: float) -> str:
    return f'<scale value="{", ".join(map(str, s))}"/>'


def rotate(axis: str, angle: float) -> str:
    return f'<rotate {axis}="1" angle="{angle}"/>'


def move(x: float, y: float, z: float) -> str:
    return f'<translate x="{x}" y="{y}" z="{z}"/>'


def colour(name: str, *rgb: float) -> str:
    return f'<rgb name="{name}" value="{", ".join(map(str, rgb))}"/>'


def shape(kind: str, place: str, inside: str = "", filename: str = "") -> str:
    named = f'<string name="filename" value="{filename}"/>' if filename else ""
    return f'<shape type="{kind}">{named}{place}{inside}</shape>'


def matt(*rgb: float) -> str:
    return f'<bsdf type="diffuse">{colour("reflectance", *rgb)}</bsdf>'


CAMERA = f'<sensor type="perspective"><float name="fov" value="40"/>{film()}</sensor>'
FLOOR = shape("rectangle", at(scale(4), rotate("x", -90), move(0, -1.2, 5)), matt(0.5, 0.45, 0.4))
WALL = shape("rectangle", at(scale(3), rotate("y", 180), move(0, 0.5, 7.5)), matt(0.3, 0.5, 0.7))
SIDE = shape("rectangle", at(scale(3), rotate("y", 90), move(-2.5, 0, 5)), matt(0.7, 0.2, 0.15))
ROOM = FLOOR + WALL + SIDE
LAMP = shape("rectangle", at(scale(0.8), rotate("x", 90), move(0.8, 2.6, 4)),
             matt(0, 0, 0) + f'<emitter type="area">{colour("radiance", 12, 10, 8)}</emitter>')  # fmt: skip
SKY = f'<emitter type="constant">{colour("radiance", 0.3, 0.35, 0.4)}</emitter>'
RUN = '<integrator type="path"><integer name="max_depth" value="8"/></integrator>'
BALL = at(scale(0.75), rotate("x", -70), rotate("y", 40), move(-0.85, -0.3, 5))
PLATE = at(scale(0.7), rotate("x", 20), rotate("y", 155), move(0.9, 0.4, 5.3))
BACK = at(scale(0.45, 0.6, 1), rotate("y", 35), move(0.2, 0.8, 4.6))
HILLS = at(scale(0.7), rotate("x", -50), rotate("y", 190), move(0.55, -0.75, 4.3))


def subjects(inside: str) -> str:
    """A ball, a plate from both sides, and an uneven mesh."""
    return (shape("sphere", BALL, inside) + shape("rectangle", PLATE, inside)
            + shape("rectangle", BACK, inside) + shape("ply", HILLS, inside, "a.ply"))  # fmt: skip


def staged(rest: str, camera: str = CAMERA, light: str = LAMP + SKY, run: str = RUN) -> str:
    return f'<scene version="3.0.0">\n{run}{camera}{light}{rest}</scene>\n'


def _staged(case: scenes.Case) -> tuple[str, int]:
    """The text of a case of tests/plugins on the stage, and its border."""
    made, category, plugin = scenes.element(case), case.category, case.plugin
    for old, new in _OTHER.items():
        made = made.replace(old, new)
    turned = _TURNED.format(0.1, 0.05, 0.3)
    made = made.replace(scenes._MOVE, _SMALLER if category in ("shape", "volume") else turned)
    made = made.replace(scenes._TURN, turned)
    if plugin == "sdfgrid":
        made = made.replace("a.vol", "s.vol")
    if plugin == "hair":
        there = at(scale(0.8), rotate("y", 160), rotate("x", 15), move(0, 0, 5))
        return staged(ROOM + shape("bsplinecurve", there, made, "a.txt")), 0
    if category == "bsdf":
        return staged(ROOM + subjects(made)), 0
    if plugin == "bitmap" and case.parameter in ("filter_type", "wrap_mode"):
        large = "0.25" if case.parameter == "filter_type" else "1.6"
        made = made.replace(
            "</texture>", f'<transform name="to_uv"><scale value="{large}"/></transform></texture>'
        )
    if category == "texture":
        made = f'<bsdf type="diffuse">{made}</bsdf>'
        return staged(ROOM + subjects(made) if plugin != "mesh_attribute"
                      else ROOM + shape("ply", HILLS, made, "a.ply")), 0  # fmt: skip
    if category == "spectrum":
        inside = (f'<emitter type="area">{made}</emitter>' if 'name="radiance"' in made
                  else f'<bsdf type="diffuse">{made}</bsdf>')  # fmt: skip
        return staged(ROOM + subjects(inside)), 0
    if category == "emitter":
        if plugin in ("area", "directionalarea"):
            return staged(ROOM + subjects(made), light=""), 0
        if plugin in ("point", "spot", "projector"):
            nearer = ROOM + subjects(matt(0.6, 0.6, 0.6))
            return staged(nearer, light=made), 0
        light = made
        return staged(
            (FLOOR + WALL if plugin == "directional" else FLOOR) + subjects(matt(0.6, 0.6, 0.6)),
            light=light,
        ), 0
    subject = ROOM + subjects(matt(0.6, 0.6, 0.6))
    if category in ("film", "sampler"):
        if category == "film":
            for old, new in (('name="width" value="3"', 'name="width" value="40"'),
                             ('name="height" value="3"', 'name="height" value="24"')):  # fmt: skip
                made = made.replace(old, new)
            for name in ("width", "height"):
                if f'name="{name}"' not in made:
                    made = made.replace(
                        "</film>", f'<integer name="{name}" value="{SIZE}"/></film>'
                    )
            made = made.replace("</film>", '<rfilter type="box"/></film>')
            for name, value in zip(
                ("crop_width", "crop_height", "crop_offset_x", "crop_offset_y"),
                (20, 16, 9, 5),
                strict=True,
            ):
                made = _numbered(made, name, value)
        else:
            made = made + film()
        return staged(
            subject, f'<sensor type="perspective"><float name="fov" value="40"/>{made}</sensor>'
        ), 0
    if category == "rfilter":
        return staged(subject, CAMERA.replace('<rfilter type="box"/>', made)), 4
    if category == "sensor":
        made = made.replace(scenes._FILM.format(8, 8), film(36, 24))
        made = made.replace(scenes._FILM.format(1, 1), film(1, 1))
        if plugin == "irradiancemeter":
            return staged(ROOM + shape("rectangle", PLATE, made), ""), 0
        return staged(subject, made), 0
    if plugin in ("heterogeneous", "constvolume") and "gridvolume" not in made:
        if plugin == "constvolume":
            made = f'<medium type="heterogeneous" name="interior">{made}</medium>'
        cube = shape("cube", at(scale(0.5), move(0.5, 0.5, 0.5)), '<bsdf type="null"/>' + made)
        ground = shape(
            "rectangle", at(scale(4), rotate("x", -90), move(0, -0.1, 0)), matt(0.6, 0.4, 0.2)
        )
        eye = CAMERA.replace(
            "</sensor>",
            '<transform name="to_world"><lookat origin="1.8, 1.5, -2.5" target="0.5, 0.4, 0.5" up="0, 1, 0"/></transform></sensor>',
        )
        return staged(ground + cube, eye, run=RUN.replace('"path"', '"volpath"')), 0
    if category in ("medium", "phase", "volume"):
        if category == "phase":
            made = f'<medium type="homogeneous" name="interior"><float name="scale" value="2"/>{made}</medium>'
        if category == "volume":
            made = f'<medium type="heterogeneous" name="interior"><float name="scale" value="3"/>{made}</medium>'
        kind = "cube" if "gridvolume" in made else "sphere"
        spot = at(scale(0.9), rotate("y", 30), move(0.1, -0.2, 5))
        if kind == "cube":
            spot = at(scale(0.9), move(0, -0.2, 5))
            made = made.replace('<volume type="gridvolume"', '<volume type="gridvolume"')
            if 'name="to_world"' not in made:
                made = made.replace(
                    "</volume>", at(scale(1.8), move(-0.9, -1.1, 4.1)) + "</volume>"
                )
        return staged(ROOM + shape(kind, spot, '<bsdf type="null"/>' + made),
                      run=RUN.replace('"path"', '"volpath"')), 0  # fmt: skip
    if category == "shape":
        fog = "</shape>"
        place = at(scale(0.8), rotate("y", 160), rotate("x", 15), move(0, 0, 5))
        if plugin == "sdfgrid":
            place = at(scale(1.4), move(-0.7, -0.6, 4.4))
        if plugin in ("shapegroup", "instance"):
            group = f'<shape type="shapegroup" id="group">{shape("ply", HILLS, matt(0.6, 0.5, 0.2), "a.ply")}{shape("sphere", BALL)}</shape>'
            return staged(
                ROOM
                + group
                + (
                    '<shape type="instance"><ref id="group"/></shape>'
                    if plugin == "shapegroup"
                    else made
                )
            ), 0
        if plugin == "merge":
            made = (
                f'<shape type="merge">{shape("ply", HILLS, matt(0.6, 0.5, 0.2), "a.ply")}</shape>'
            )
        elif 'name="to_world"' in made:
            made = made.replace(
                '<transform name="to_world"><matrix',
                '<transform name="to_world"><scale value="0.7"/>'
                + rotate("y", 160)
                + move(0, 0, 5)
                + "<matrix",
            )
        else:
            made = made.replace(fog, place + fog, 1)
        if "<bsdf" not in made and "medium" not in made:
            made = made.replace(
                fog, f'<bsdf type="diffuse">{BITMAP.format("reflectance")}</bsdf></shape>', 1
            )
        return staged(ROOM + made), 0
    if category == "integrator":
        fogged = (
            shape(
                "sphere",
                at(scale(0.9), move(0.3, 0.2, 4.6)),
                '<bsdf type="null"/><medium type="homogeneous" name="interior"/>',
            )
            if "vol" in plugin
            else ""
        )
        seen = shape(
            "rectangle",
            at(scale(0.3), rotate("y", 180), move(-0.6, 0.9, 5)),
            f'<emitter type="area">{colour("radiance", 2, 3, 4)}</emitter>',
        )
        return staged(FLOOR + SIDE + subjects(matt(0.6, 0.6, 0.6)) + seen + fogged, run=made), 0
    return staged(subject + made), 0


def _numbered(text: str, name: str, value: int) -> str:
    head, found, tail = text.partition(f'name="{name}" value="')
    return head + found + str(value) + tail[tail.index('"') :] if found else text


BITMAP = '<texture type="bitmap" name="{}"><string name="filename" value="a.png"/></texture>'


def cases() -> Iterator[Case]:
    """Those of tests/plugins, then MORE."""
    for case in scenes.cases():
        text, border = _staged(case)
        base = f"{case.category}.{case.plugin}" if case.parameter else None
        yield Case(str(case), text, base, border)
    from beside_more import more

    yield from more()


def hills(n: int = 14) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Corners (n * n, 3), texture coordinates, faces of an uneven sheet in [-1, 1]^2."""
    u, v = np.meshgrid(np.linspace(0, 1, n), np.linspace(0, 1, n), indexing="ij")
    height = 0.25 * np.sin(5 * u + 1) * np.cos(4 * v)
    points = np.stack([2 * u - 1, 2 * v - 1, height], -1).reshape(-1, 3)
    k = np.arange(n * n).reshape(n, n)
    a, b, c, d = (x.ravel() for x in (k[:-1, :-1], k[1:, :-1], k[1:, 1:], k[:-1, 1:]))
    faces = np.concatenate([np.stack([a, b, c], -1), np.stack([a, c, d], -1)])
    return points, np.stack([u, v], -1).reshape(-1, 2), faces


def files(folder: Path) -> None:
    """Writes the files that the scenes name."""
    scenes.files(folder)
    y, x = np.mgrid[0:12, 0:16]
    rgb = np.stack(
        [100 + 90 * np.sin(x * 0.9 + y * 0.3), 90 + 80 * np.cos(y * 1.1), 60 + 10 * x], -1
    )
    Image.fromarray(np.clip(rgb, 0, 255).astype(np.uint8)).save(folder / "a.png")
    n = np.stack([0.45 * np.sin(x * 0.8 + 0.4), 0.4 * np.cos(y * 1.05), np.ones_like(x)], -1)
    n /= np.linalg.norm(n, axis=-1, keepdims=True)
    Image.fromarray(np.round(255 * (n + 1) / 2).astype(np.uint8)).save(folder / "normals.png")
    steep = np.stack([1.6 * np.sin(x * 0.8 + 0.4), 1.5 * np.cos(y * 1.05), np.ones_like(x)], -1)
    steep /= np.linalg.norm(steep, axis=-1, keepdims=True)
    Image.fromarray(np.round(255 * (steep + 1) / 2).astype(np.uint8)).save(folder / "steep.png")
    h = 127 + 60 * np.sin(2 * np.pi * x / 16 * 2) + 60 * np.cos(2 * np.pi * y / 12)
    Image.fromarray(np.round(h).astype(np.uint8)).save(folder / "heights.png")
    Image.fromarray(np.where((x // 2 + y // 2) % 2, 230, 20).astype(np.uint8)).save(
        folder / "bits.png"
    )
    points, uv, faces = hills()
    reds = 0.5 + 0.4 * np.sin(3 * points)
    head = f"ply\nformat ascii 1.0\nelement vertex {len(points)}\n"
    head += "".join(f"property float {a}\n" for a in ("x", "y", "z", "u", "v", "r", "g", "b"))
    head += f"element face {len(faces)}\nproperty list uchar int vertex_indices\n"
    head += "".join(f"property float {a}\n" for a in "rgb") + "end_header\n"
    rows = [
        " ".join(map(repr, map(float, (*p, *t, *r))))
        for p, t, r in zip(points, uv, reds, strict=True)
    ]
    rows += [
        f"3 {a} {b} {c} {0.2 + 0.6 * (k % 3 == 0)} {0.1 + 0.1 * (k % 7)} 0.4"
        for k, (a, b, c) in enumerate(faces)
    ]
    (folder / "a.ply").write_text(head + "\n".join(rows) + "\n")
    obj = ["v {} {} {}".format(*p) for p in points] + ["vt {} {}".format(*t) for t in uv]
    obj += ["f {0}/{0} {1}/{1} {2}/{2}".format(*(f + 1)) for f in faces]
    (folder / "a.obj").write_text("\n".join(obj) + "\n")
    numbers = (
        points.astype("<f4").tobytes() + uv.astype("<f4").tobytes() + faces.astype("<u4").tobytes()
    )
    packed = (
        struct.pack("<I", 0x1002) + b"m\0" + struct.pack("<QQ", len(points), len(faces)) + numbers
    )
    part = struct.pack("<HH", 0x041C, 4) + zlib.compress(packed)
    (folder / "a.serialized").write_bytes(part + struct.pack("<QI", 0, 1))
    (folder / "a.txt").write_text(
        "".join(
            f"{0.3 * k - 1} {0.5 * np.sin(1.3 * k)} {0.1 * k} {0.05 + 0.03 * k}\n" for k in range(8)
        )
    )
    z, yy, xx = np.mgrid[0:5, 0:6, 0:7]
    cells = (0.5 + 0.45 * np.sin(xx * 1.1 + 0.5 * yy) * np.cos(0.8 * z + 0.3)).astype("<f4")
    box = b"VOL\3" + struct.pack("<5i6f", 1, 7, 6, 5, 1, 0, 0, 0, 1, 1, 1)
    (folder / "a.vol").write_bytes(box + cells.tobytes())
    z, yy, xx = np.mgrid[0:12, 0:12, 0:12] / 11.0 - 0.5
    away = (np.sqrt(xx**2 + 1.4 * yy**2 + z**2) - 0.36).astype("<f4")
    (folder / "s.vol").write_bytes(
        b"VOL\3" + struct.pack("<5i6f", 1, 12, 12, 12, 1, 0, 0, 0, 1, 1, 1) + away.tobytes()
    )
