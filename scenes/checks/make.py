#!/usr/bin/env python3
"""Makes the scene files and meshes beside it: small bright scenes, each about one thing.

    python scenes/checks/make.py [--check]

--check compares with the files that are there and writes nothing (exit status 1 if they differ).
Every file but rough_shadows and rough_whole is valid for Mitsuba 3.9 (volpath) as it stands. Needs
numpy, OpenEXR and trimesh.
"""

from __future__ import annotations

import struct
import sys
import xml.etree.ElementTree as ET
import zlib
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt
import OpenEXR

HERE = Path(__file__).resolve().parent
SEED = 20160300
Array = npt.NDArray[np.float64]
SCENES: dict[str, Callable[[], str]] = {}


# ---- pieces of XML ----


def numbers(*values: float) -> str:
    """Values in at most 6 significant digits, separated as in Mitsuba's own files."""
    return ", ".join(f"{v:.6g}" for v in values)


def number(name: str, value: float) -> str:
    """A float."""
    return f'<float name="{name}" value="{value:.8g}"/>'


def flag(name: str, value: bool = True) -> str:
    """A boolean."""
    return f'<boolean name="{name}" value="{str(value).lower()}"/>'


def text(name: str, value: str) -> str:
    """A string."""
    return f'<string name="{name}" value="{value}"/>'


def rgb(name: str, *value: float) -> str:
    """A colour of one or three numbers."""
    return f'<rgb name="{name}" value="{numbers(*value)}"/>'


def point(name: str, *value: float) -> str:
    """A point."""
    return '<point name="{}" x="{:g}" y="{:g}" z="{:g}"/>'.format(name, *value)


def vector(name: str, *value: float) -> str:
    """A vector."""
    return '<vector name="{}" x="{:g}" y="{:g}" z="{:g}"/>'.format(name, *value)


def ref(id_: str, name: str = "") -> str:
    """A reference."""
    return f'<ref id="{id_}"' + (f' name="{name}"' if name else "") + "/>"


def transform(*steps: str) -> str:
    """to_world of steps, the first applied first."""
    return f'<transform name="to_world">{"".join(steps)}</transform>'


def scale(*v: float) -> str:
    """Scaling by one or three factors."""
    if len(v) == 1:
        return f'<scale value="{v[0]:g}"/>'
    return '<scale x="{:g}" y="{:g}" z="{:g}"/>'.format(*v)


def rotate(axis: str, angle: float) -> str:
    """Rotation about a coordinate axis, degrees."""
    return f'<rotate {axis}="1" angle="{angle:g}"/>'


def translate(*v: float) -> str:
    """Translation."""
    return '<translate x="{:g}" y="{:g}" z="{:g}"/>'.format(*v)


def matrix(*rows: float) -> str:
    """A 4x4 matrix, row by row."""
    return f'<matrix value="{" ".join(f"{v:g}" for v in rows)}"/>'


def look_at(origin: tuple[float, ...], target: tuple[float, ...], up: str = "0, 1, 0") -> str:
    """to_world of a camera or spot."""
    look = f'<lookat origin="{numbers(*origin)}" target="{numbers(*target)}" up="{up}"/>'
    return transform(look)


def sensor(
    origin: tuple[float, ...] = (0, 2.4, 6),
    target: tuple[float, ...] = (0, 0.8, 0),
    fov: float = 40,
    rfilter: str = '<rfilter type="box"/>',
    kind: str = "perspective",
    extra: str = "",
    placed: str = "",
) -> str:
    """A camera with film and sampler; placed: its parameters instead of the others'."""
    placed = placed or f"{number('fov', fov)}{extra}{look_at(origin, target)}"
    return (
        f'<sensor type="{kind}">{placed}'
        '<film type="hdrfilm"><integer name="width" value="$width"/>'
        f'<integer name="height" value="$height"/>{rfilter}</film>'
        '<sampler type="independent"><integer name="sample_count" value="$spp"/></sampler></sensor>'
    )


def bsdf(kind: str, *content: str, id_: str = "") -> str:
    """A material."""
    named = f' id="{id_}"' if id_ else ""
    return f'<bsdf type="{kind}"{named}>{"".join(content)}</bsdf>'


def diffuse(*value: float) -> str:
    """A Lambertian material."""
    return bsdf("diffuse", rgb("reflectance", *value))


def shape(kind: str, *content: str) -> str:
    """A shape."""
    return f'<shape type="{kind}">{"".join(content)}</shape>'


def sphere(x: float, y: float, z: float, radius: float, *content: str) -> str:
    """A sphere by centre and radius."""
    return shape("sphere", point("center", x, y, z), number("radius", radius), *content)


def area(*radiance: float) -> str:
    """An area emitter."""
    return f'<emitter type="area">{rgb("radiance", *radiance)}</emitter>'


def sky(*radiance: float) -> str:
    """A constant environment."""
    return f'<emitter type="constant">{rgb("radiance", *radiance)}</emitter>'


def emitter(kind: str, *content: str) -> str:
    """A point, spot or directional light, or an image of the sky."""
    return f'<emitter type="{kind}">{"".join(content)}</emitter>'


def floor(*value: float, size: float = 20) -> str:
    """The plane y = 0."""
    return shape("rectangle", transform(scale(size), rotate("x", -90)), diffuse(*value))


def lamp(*radiance: float, x: float = 1.5, y: float = 6, z: float = 1, half: float = 2) -> str:
    """A square that shines down and reflects nothing."""
    place = transform(scale(half), rotate("x", 90), translate(x, y, z))
    return shape("rectangle", place, diffuse(0), area(*radiance))


def phase_function(kind: str, *content: str, name: str = "") -> str:
    """A phase function."""
    head = f' name="{name}"' if name else ""
    body = "".join(content)
    return f'<phase type="{kind}"{head}' + (f">{body}</phase>" if body else "/>")


def medium(
    id_: str, extinction: tuple[float, ...], albedo: tuple[float, ...],
    g: float | str | None = None, name: str = "", scaling: float | None = None,
) -> str:  # fmt: skip
    """A homogeneous medium; g None: isotropic, a string: another phase function.

    Mitsuba takes no rgb extinction above 1.
    """
    phase = g if isinstance(g, str) else phase_function("isotropic")
    if isinstance(g, float):
        phase = phase_function("hg", number("g", g))
    head = (f' id="{id_}"' if id_ else "") + (f' name="{name}"' if name else "")
    if len(extinction) == 1:
        values = number("sigma_t", *extinction)
    else:
        scaling = max(extinction) if scaling is None else scaling
        values = rgb("sigma_t", *(v / scaling for v in extinction))
    values += rgb("albedo", *albedo)
    if scaling is not None:
        values += number("scale", scaling)
    return f'<medium type="homogeneous"{head}>{values}{phase}</medium>'


def inside(extinction: tuple[float, ...], albedo: tuple[float, ...],
           g: float | str | None = None, **more: Any) -> str:  # fmt: skip
    """A medium as a shape's interior."""
    return medium("", extinction, albedo, g, "interior", **more)


def striped() -> str:
    """Floor, sky, a large lamp and two coloured walls behind: something to see through glass."""
    left = shape("rectangle", transform(scale(1.5, 2, 1), rotate("y", 30), translate(-2, 2, -3)),
                 diffuse(0.8, 0.2, 0.1))  # fmt: skip
    right = shape("rectangle", transform(scale(1.5, 2, 1), rotate("y", -30), translate(2, 2, -3)),
                  diffuse(0.1, 0.3, 0.8))  # fmt: skip
    return floor(0.5, 0.5, 0.4) + left + right + sky(0.5, 0.6, 0.7) + lamp(4, 3.5, 3)


def scene(make: Callable[[], str]) -> Callable[[], str]:
    """Registers a scene under its function's name; the docstring is its line in the README."""
    SCENES[make.__name__] = make
    return make


def texture(kind: str, *content: str, name: str = "reflectance", to_uv: str = "") -> str:
    """A texture of a bsdf; bitmaps as they are, without a graphics card's filter."""
    exact = flag("accel", False) + text("format", "variant") if kind == "bitmap" else ""
    place = f'<transform name="to_uv">{to_uv}</transform>' if to_uv else ""
    return f'<texture type="{kind}" name="{name}">{"".join(content)}{exact}{place}</texture>'


# ---- emitters ----


@scene
def sphere_light() -> str:
    """A lamp that is a sphere, sampled by solid angle, and a small one near the floor."""
    return (
        sensor() + floor(0.5, 0.6, 0.5) + sphere(-1.2, 1, -0.5, 1, diffuse(0.7, 0.5, 0.3))
        + sphere(1.2, 2.2, 0.5, 0.8, diffuse(0), area(6, 5, 4))
        + sphere(0.9, 0.16, 1.5, 0.15, diffuse(0.2), area(2, 4, 8))
    )  # fmt: skip


@scene
def point_light() -> str:
    """A point light above a floor and a ball."""
    return (
        sensor() + floor(0.5, 0.6, 0.5) + sphere(-0.5, 0.8, 0, 0.8, diffuse(0.7, 0.5, 0.3))
        + emitter("point", point("position", 1.5, 2.5, 1.5), rgb("intensity", 18, 15, 12))
        + sky(0.2, 0.25, 0.3)
    )  # fmt: skip


@scene
def spot_light() -> str:
    """Two spot lights, one with the default beam width."""
    return (
        sensor() + floor(0.5, 0.6, 0.5) + sphere(0, 0.7, 0, 0.7, diffuse(0.7, 0.5, 0.3))
        + emitter("spot", look_at((-2, 4, 2), (-0.5, 0, 0)), rgb("intensity", 60, 40, 30),
                  number("cutoff_angle", 25), number("beam_width", 10))
        + emitter("spot", look_at((2.5, 4, 1), (0.8, 0, 0.3)), rgb("intensity", 20, 40, 60))
        + sky(0.2, 0.25, 0.3)
    )  # fmt: skip


@scene
def directional_light() -> str:
    """Parallel light from one side."""
    return (
        sensor() + floor(0.5, 0.6, 0.5) + sphere(-0.6, 0.8, 0, 0.8, diffuse(0.7, 0.5, 0.3))
        + shape("cube", transform(scale(0.4), rotate("y", 30), translate(1.2, 0.4, 0.4)),
                diffuse(0.3, 0.5, 0.7))
        + emitter("directional", vector("direction", -1, -1.5, -0.8), rgb("irradiance", 3, 2.5, 2))
        + sky(0.2, 0.25, 0.3)
    )  # fmt: skip


@scene
def disk_light() -> str:
    """A disk that shines, tilted, seen from both sides by the scene."""
    place = transform(scale(1.2), rotate("x", 70), translate(0.5, 2.2, -0.5))
    return (
        sensor() + floor(0.5, 0.6, 0.5) + sphere(-1, 0.7, 0.3, 0.7, diffuse(0.7, 0.5, 0.3))
        + shape("disk", place, diffuse(0.1), area(7, 6, 5)) + sky(0.2, 0.25, 0.3)
    )  # fmt: skip


@scene
def mesh_light() -> str:
    """A lamp that is a mesh, and one that is a cube."""
    return (
        sensor() + floor(0.5, 0.6, 0.5) + sphere(0, 0.6, 0.8, 0.6, diffuse(0.7, 0.5, 0.3))
        + shape("ply", text("filename", "meshes/bumps.ply"), flag("face_normals"),
                transform(scale(0.6), translate(-1.5, 1.4, 0)), diffuse(0.2), area(4, 3, 2))
        + shape("cube", transform(scale(0.3, 0.5, 0.2), rotate("z", 30), translate(1.5, 1.2, 0)),
                diffuse(0.2), area(4, 6, 8))
    )  # fmt: skip


@scene
def near_lamps() -> str:
    """Rectangles that shine, one behind a null sheet on the floor and one close over a box."""
    return (
        sensor() + floor(0.5, 0.6, 0.5)
        + shape("ply", text("filename", "meshes/bumps.ply"), flag("face_normals"),
                transform(scale(0.4), translate(0, 0.6, -0.8)), diffuse(0.8, 0.7, 0.4))
        + shape("rectangle",
                transform(scale(0.7, 0.4, 1), rotate("y", 40), translate(-1.1, 0.4, 0.2)),
                diffuse(0.1), area(5, 4, 3))
        + shape("rectangle",
                transform(scale(0.7, 0.4, 1), translate(0, 0, 0.2), rotate("y", 40),
                          translate(-1.1, 0.4, 0.2)), bsdf("null"))
        + shape("rectangle",
                transform(scale(0.5, 0.3, 1), rotate("x", 90), translate(1, 0.95, 0.3)),
                diffuse(0.1), area(4, 5, 6))
        + shape("cube", transform(scale(0.4), translate(1, 0.4, 0.3)), diffuse(0.7, 0.4, 0.5))
    )  # fmt: skip


@scene
def image_sky() -> str:
    """An image of a sky, turned and scaled, with a small bright sun on its seam."""
    turn = transform(rotate("z", 20), rotate("y", 110))
    return (
        sensor() + floor(0.5, 0.6, 0.5) + sphere(-1.1, 0.8, 0, 0.8, diffuse(0.7, 0.5, 0.3))
        + sphere(1.1, 0.7, 0.2, 0.7, bsdf("dielectric"))
        + shape("rectangle", transform(scale(2, 1, 1), translate(0, 1, -2)),
                bsdf("conductor", text("material", "none")))
        + emitter("envmap", text("filename", "skies/sun.exr"), number("scale", 0.8), turn)
    )  # fmt: skip


@scene
def compensated_sky() -> str:
    """The sky with the sun, whose light samples leave out what is below its mean."""
    return (
        sensor() + floor(0.5, 0.6, 0.5)
        + sphere(-1.1, 0.8, 0, 0.8, bsdf("roughplastic", number("alpha", 0.2)))
        + sphere(1.1, 0.7, 0.2, 0.7, bsdf("null"), inside((1, 1.5, 2), (0.9, 0.8, 0.6), 0.4))
        + shape("rectangle", transform(scale(2, 1, 1), translate(0, 1, -2)),
                bsdf("roughconductor", text("material", "none"), number("alpha", 0.1)))
        + emitter("envmap", text("filename", "skies/sun.exr"), number("scale", 0.8),
                  transform(rotate("y", 60)), flag("mis_compensation"))
    )  # fmt: skip


@scene
def daylight() -> str:
    """A room of several materials that sees the sky through a pane in its window."""
    wall = diffuse(0.7, 0.65, 0.6)

    def plane(x: float, y: float, *steps: str) -> str:
        return shape("rectangle", transform(scale(x, y, 1), *steps), wall)

    beside = [
        plane(x, y, rotate("y", -90), translate(2, up, along))
        for x, y, up, along in (
            (0.7, 1.5, 1.5, -1.5),
            (0.7, 1.5, 1.5, 1.5),
            (0.8, 0.4, 0.4, 0),
            (0.8, 0.35, 2.65, 0),
        )
    ]
    return (
        sensor(origin=(-1.6, 1.7, 2), target=(0.3, 0.9, -0.3), fov=60)
        + plane(2, 2.2, rotate("x", -90)) + plane(2, 2.2, rotate("x", 90), translate(0, 3, 0))
        + plane(2, 1.5, translate(0, 1.5, -2.2))
        + plane(2, 1.5, rotate("y", 180), translate(0, 1.5, 2.2))
        + plane(2.2, 1.5, rotate("y", 90), translate(-2, 1.5, 0)) + "".join(beside)
        + shape("rectangle", bsdf("thindielectric"),
                transform(scale(0.8, 0.75, 1), rotate("y", -90), translate(2, 1.55, 0)))
        + sphere(-0.4, 0.5, -0.6, 0.5, bsdf("roughplastic", number("alpha", 0.2)))
        + sphere(0.7, 0.4, 0.4, 0.4, bsdf("dielectric"))
        + shape("cube", transform(scale(0.3, 0.6, 0.3), rotate("y", 30), translate(0.6, 0.6, -1.3)),
                bsdf("roughconductor", text("material", "none"), number("alpha", 0.3)))
        + sphere(-0.5, 2.4, 0.8, 0.15, diffuse(0), area(2, 1.6, 1))
        + emitter("envmap", text("filename", "skies/sun.exr"), number("scale", 3),
                  transform(rotate("y", 150)))
    )  # fmt: skip


# ---- shapes ----


def cylinder(start: tuple[float, ...], end: tuple[float, ...], radius: float, *content: str) -> str:
    """A cylinder by the ends of its axis."""
    return shape("cylinder", point("p0", *start), point("p1", *end), number("radius", radius),
                 *content)  # fmt: skip


@scene
def cylinders() -> str:
    """Cylinders seen from within, shining, stretched, mirrored, of metal, and flipped."""
    return (
        sensor() + floor(0.5, 0.6, 0.5) + sky(0.2, 0.25, 0.3) + lamp(3, 3, 3)
        + cylinder((-1.6, 0.8, 0.2), (-0.6, 1.2, 0.6), 0.15, diffuse(0.1), area(5, 4, 3))
        + cylinder((-1, 0, -1), (-1, 1.4, -1), 0.5,
                   bsdf("twosided", diffuse(0.7, 0.5, 0.3)))
        + cylinder((0, 0, 0), (0, 0, 1), 0.3,
                   transform(scale(1, 1, 3), rotate("x", -60), translate(0.8, 0.3, -0.8)),
                   diffuse(0.3, 0.4, 0.8))
        + cylinder((0, 0, 0), (0.2, 0.5, 0.1), 0.4,
                   transform(scale(-1, 1, 1), translate(0, 0.1, 1)), diffuse(0.4, 0.7, 0.3))
        + cylinder((1.5, 0, 0.5), (1.5, 1.2, 0.5), 0.4, bsdf("conductor"))
        + cylinder((1.2, 1.6, -1), (2.2, 2.2, -1), 0.4, flag("flip_normals"),
                   diffuse(0.8, 0.3, 0.3))
    )  # fmt: skip


@scene
def curves() -> str:
    """Linear and B-spline curves: bent, tapered, of metal and plastic, stretched but for radii."""
    return (
        sensor() + floor(0.5, 0.6, 0.5) + sky(0.2, 0.25, 0.3) + lamp(3, 3, 3)
        + shape("linearcurve", text("filename", "meshes/zigzag.txt"), diffuse(0.7, 0.5, 0.3))
        + shape("linearcurve", text("filename", "meshes/zigzag.txt"),
                transform(scale(-1, 1.5, 0.7), translate(0, -0.4, 1)),
                bsdf("roughconductor", number("alpha", 0.3)))
        + shape("bsplinecurve", text("filename", "meshes/hooks.txt"),
                bsdf("twosided", diffuse(0.3, 0.4, 0.8)))
        + shape("bsplinecurve", text("filename", "meshes/hooks.txt"),
                transform(rotate("y", 200), translate(0.2, 0.2, -0.6)), bsdf("plastic"))
    )  # fmt: skip


@scene
def hair() -> str:
    """B-spline curves of hair: brown by its pigments, reddish and wide, clear with steep scales."""
    strand = text("filename", "meshes/hooks.txt")
    wide = (number("longitudinal_roughness", 0.6), number("azimuthal_roughness", 0.7))
    return (
        sensor() + floor(0.5, 0.6, 0.5) + sky(0.2, 0.25, 0.3) + lamp(3, 3, 3)
        + shape("bsplinecurve", strand, bsdf("hair"))
        + shape("bsplinecurve", strand,
                transform(rotate("y", 200), translate(0.2, 0.2, -0.6)),
                bsdf("hair", number("eumelanin", 0.1), number("pheomelanin", 0.6), *wide))
        + shape("bsplinecurve", strand,
                transform(scale(0.8), rotate("y", 90), translate(0.6, 0.1, 1.2)),
                bsdf("hair", rgb("sigma_a", 0, 0.02, 0.1), number("scale_tilt", 8)))
    )  # fmt: skip


#: Two linear curves, and two B-spline curves that end in points.
ZIGZAG = """-2 0.5 -0.5 0.3
-1.2 1.6 -0.5 0.15
-0.9 0.6 0 0.15
-0.2 1.2 -0.8 0.25

1 0.3 0.6 0.2
2 0.4 0.2 0.1
"""
HOOKS = """0.2 0.1 0.5 0
0.2 0.1 0.5 0
0.2 0.1 0.5 0
0.5 1.2 0.5 0.35
1.3 1.4 0.1 0.2
1.2 0.5 -0.4 0.3
1.9 0.9 -0.5 0
1.9 0.9 -0.5 0
1.9 0.9 -0.5 0

-1.8 0.2 0.9 0
-1.8 0.2 0.9 0
-1.8 0.2 0.9 0
-0.9 0.5 1.3 0.2
-0.1 0.2 1.1 0
-0.1 0.2 1.1 0
-0.1 0.2 1.1 0
"""


def instance(group: str, *steps: str) -> str:
    """A group once more."""
    return shape("instance", ref(group), transform(*steps))


@scene
def sdf_grid() -> str:
    """Grids of signed distances: a dented ring, its cells seen in flat shading and smooth."""
    rough, matt = bsdf("roughconductor", number("alpha", 0.3)), diffuse(0.7, 0.5, 0.3)
    groups = "".join(
        f'<shape type="shapegroup" id="{kind}">'
        + shape("sdfgrid", text("filename", "meshes/ring.vol"), text("normals", kind), content)
        + "</shape>"
        for kind, content in (("smooth", rough), ("analytic", matt))
    )
    middle = translate(-0.5, -0.5, -0.5)
    return (
        sensor() + floor(0.5, 0.6, 0.5) + sky(0.2, 0.25, 0.3) + lamp(3, 3, 3)
        + groups
        + instance("smooth", middle, scale(2.4), rotate("x", 60), translate(-1, 0.9, 0))
        + instance("analytic", middle, scale(2, 2, 2.6), rotate("y", 30), translate(1.1, 0.9, 0.2))
    )  # fmt: skip


def ring() -> bytes:
    """A grid of 12 x 12 x 12 distances to a dented ring."""
    z, y, x = np.meshgrid(*[np.linspace(0, 1, 12)] * 3, indexing="ij")
    around = np.sqrt((x - 0.5) ** 2 + (y - 0.5) ** 2)
    distance = np.sqrt((around - 0.28) ** 2 + (z - 0.5) ** 2) - 0.15
    distance += 0.25 * (x - 0.5) * (y - 0.5) - 0.4 * (x - 0.5) * (z - 0.5)
    head = struct.pack("<3sB5i6f", b"VOL", 3, 1, 12, 12, 12, 1, 0, 0, 0, 1, 1, 1)
    return head + distance.astype("<f4").tobytes()


@scene
def instances() -> str:
    """Groups of serialized meshes, a cube, a sphere and merged shapes, moved and mirrored."""
    meshes = text("filename", "meshes/bumps_egg.serialized")
    eggs = shape("serialized", meshes, '<integer name="shape_index" value="1"/>',
                 transform(scale(0.8, 1, 1), rotate("z", 15)), diffuse(0.7, 0.5, 0.3))  # fmt: skip
    ball = sphere(0, 1.2, 0, 0.4, bsdf("conductor"))
    flat = shape("serialized", meshes, flag("face_normals"), diffuse(0.4, 0.4, 0.7))
    smooth = eggs.replace("0.7, 0.5, 0.3", "0.3, 0.6, 0.6")
    merged = shape("merge", shape("cube", transform(scale(0.3), translate(0.9, 0.3, 0)),
                                  diffuse(0.3, 0.7, 0.4)),
                   shape("disk", transform(scale(0.5), rotate("y", 30), translate(-0.9, 0.6, 0)),
                         bsdf("twosided", diffuse(0.8, 0.2, 0.2))))  # fmt: skip
    group = '<shape type="shapegroup" id="{}">{}</shape>'.format
    return (
        sensor() + floor(0.5, 0.6, 0.5) + sky(0.4, 0.45, 0.5) + lamp(5, 5, 4.5)
        + group("pair", eggs + ball + merged) + group("flat", flat) + group("smooth", smooth)
        + instance("pair", scale(0.6), rotate("y", 70), translate(-1.3, 0.6, 0.4))
        + instance("pair", scale(-0.5, 0.5, 0.5), translate(1.3, 0.5, 0.6))
        + instance("flat", scale(-0.5, 0.9, 0.3), rotate("z", 20), translate(-0.6, 1, -1.2))
        + instance("smooth", scale(0.3, 0.9, 0.9), rotate("y", 40), translate(0.6, 1, -1.2))
    )  # fmt: skip


def mesh(name: str, *content: str) -> str:
    """A mesh on the floor under a lamp."""
    place = transform(scale(1.1), rotate("y", 40), translate(0, 1.2, 0))
    kind = name.rpartition(".")[2]
    return (
        sensor() + floor(0.5, 0.6, 0.5) + sky(0.3, 0.35, 0.4) + lamp(8, 7, 6)
        + shape(kind, text("filename", f"meshes/{name}"), place, diffuse(0.8, 0.6, 0.4), *content)
    )  # fmt: skip


@scene
def smooth_normals() -> str:
    """A closed mesh with vertex normals in the file, more bent than the mesh."""
    return mesh("bumps.ply")


@scene
def computed_normals() -> str:
    """The same mesh without vertex normals: they are computed, weighted by angle."""
    return mesh("bumps.obj")


@scene
def face_normals() -> str:
    """The same mesh, flat: vertex normals in the file are not used."""
    return mesh("bumps.ply", flag("face_normals"))


@scene
def flip_normals() -> str:
    """Flipped shapes: a room in a sphere, a lamp, and ones that are mirrored as well."""
    turned = flag("flip_normals")
    return (
        sensor((0, 0.5, 3.5), (0, 0, 0), 60)
        + sphere(0, 0, 0, 5, turned, diffuse(0.6, 0.5, 0.7), area(0.3, 0.3, 0.25))
        + shape("disk", transform(rotate("x", -90), scale(1.2), translate(0, 2.5, 0)), turned,
                diffuse(0.1), area(5, 4, 3))
        + shape("rectangle", turned, transform(scale(2), rotate("x", 90), translate(0, -1, 0)),
                diffuse(0.5, 0.6, 0.5))
        + shape("sphere", transform(scale(-0.6, 0.6, 0.6), translate(-1, -0.3, 0)),
                diffuse(0.8, 0.4, 0.3))
        + shape("cube", turned, transform(scale(-0.4, 0.4, 0.4), translate(1.2, -0.5, 0.2)),
                bsdf("twosided", diffuse(0.3, 0.4, 0.8)))
        + shape("obj", text("filename", "meshes/bumps.obj"),
                transform(scale(-0.4, 0.4, 0.4), translate(0.1, 0.5, 0.4)), diffuse(0.9, 0.7, 0.5))
        + shape("cube", turned, transform(scale(0.2), rotate("y", 30), translate(0, -0.6, 1.5)),
                diffuse(0.9))
    )  # fmt: skip


@scene
def disk_ellipse() -> str:
    """Disks sheared and scaled to ellipses, one of them a lamp."""
    shear = matrix(1, 0.8, 0, 0, 0, 0.5, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1)
    return (
        sensor() + floor(0.5, 0.6, 0.5) + sky(0.3, 0.35, 0.4)
        + shape("disk", transform(shear, rotate("x", 80), translate(0, 2.6, 0)), diffuse(0.1),
                area(8, 7, 6))
        + shape("disk", transform(scale(0.5, 1.2, 1), rotate("x", -40), translate(-1, 0.8, 0)),
                diffuse(0.8, 0.4, 0.3))
        + shape("disk", transform(shear, scale(0.7), rotate("y", 30), translate(1.2, 0.8, 0.5)),
                diffuse(0.3, 0.4, 0.8))
    )  # fmt: skip


@scene
def rectangle_sheared() -> str:
    """Rectangles sheared to parallelograms, one of them a lamp."""
    shear = matrix(1, 0.8, 0, 0, 0, 0.5, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1)
    return (
        sensor() + floor(0.5, 0.6, 0.5) + sky(0.3, 0.35, 0.4)
        + shape("rectangle", transform(shear, rotate("x", 80), translate(0, 2.6, 0)), diffuse(0.1),
                area(7, 6, 5))
        + shape("rectangle", transform(scale(0.5, 1, 1), rotate("x", -40), translate(-1, 0.8, 0)),
                diffuse(0.8, 0.4, 0.3))
        + shape("rectangle", transform(shear, scale(0.7), rotate("y", 30),
                                       translate(1.2, 0.8, 0.5)), diffuse(0.3, 0.4, 0.8))
    )  # fmt: skip


@scene
def cube_affine() -> str:
    """Cubes under affine maps, one of them mirrored."""
    shear = matrix(1, 0.5, 0.2, 0, 0, 1, 0.3, 0, 0, 0, 1, 0, 0, 0, 0, 1)
    return (
        sensor() + floor(0.5, 0.6, 0.5) + sky(0.3, 0.35, 0.4) + lamp(8, 7, 6)
        + shape("cube", transform(scale(0.6, 0.8, 0.3), shear, translate(-1, 0.8, 0)),
                diffuse(0.8, 0.4, 0.3))
        + shape("cube", transform(scale(-0.5, 0.3, 0.6), rotate("y", 50), translate(1.1, 0.3, 0.6)),
                diffuse(0.3, 0.4, 0.8))
    )  # fmt: skip


@scene
def large_small_spheres() -> str:
    """A ground sphere of radius 1,000 under spheres of radius 0.6 to 0.01."""
    parts = [sensor((0, 0.9, 2.4), (0, 0.2, 0), 40), sky(0.3, 0.35, 0.4), lamp(8, 7, 6)]
    parts.append(sphere(0, -1000, 0, 1000, diffuse(0.5, 0.6, 0.5)))
    for x, z, r in ((-0.6, -0.4, 0.6), (0.3, 0, 0.3), (0.1, 0.6, 0.1), (-0.2, 0.9, 0.03),
                    (0.25, 0.9, 0.03), (0.1, 1.1, 0.01)):  # fmt: skip
        parts.append(sphere(x, r, z, r, diffuse(0.4 + 0.5 * r, 0.8 - r, 0.9 - 1.2 * r)))
    return "".join(parts)


@scene
def spheres_300() -> str:
    """300 random spheres with diffuse colours, one in ten emits."""
    rng = np.random.default_rng(SEED)
    parts = [sensor((0, 3.2, 7.5), (0, 0.4, 0), 42), floor(0.5), sky(0.25, 0.3, 0.35)]
    placed: list[tuple[float, float, float]] = []
    while len(placed) < 300:
        x, z = (float(v) for v in rng.uniform(-4, 4, 2))
        radius = float(rng.uniform(0.07, 0.25))
        if any((x - a) ** 2 + (z - b) ** 2 < (radius + r) ** 2 for a, b, r in placed):
            continue
        x, z, radius = round(x, 3), round(z, 3), round(radius, 3)
        colour = [round(float(v), 2) for v in rng.uniform(0.1, 0.9, 3)]
        shine = [round(float(v), 2) for v in rng.uniform(0.5, 4, 3)]
        light = area(*shine) if len(placed) % 10 == 0 else ""
        parts.append(sphere(x, round(1.05 * radius, 3), z, radius, diffuse(*colour), light))
        placed.append((x, z, 1.05 * radius))
    return "".join(parts)


# ---- materials ----

MIRROR = bsdf("conductor", text("material", "none"))


@scene
def conductor_mirror() -> str:
    """Ideal mirrors: a ball, a tilted pane, a tinted cube."""
    pane = transform(scale(0.9), rotate("y", -35), rotate("x", -10), translate(1.3, 0.9, -0.6))
    tinted = bsdf("conductor", text("material", "none"), rgb("specular_reflectance", 0.9, 0.7, 0.3))
    return (
        sensor() + striped() + sphere(-0.7, 0.8, 0.3, 0.8, MIRROR)
        + shape("rectangle", pane, MIRROR)
        + shape("cube", transform(scale(0.25), rotate("y", 20), translate(0.8, 0.25, 1.3)), tinted)
    )  # fmt: skip


@scene
def conductor_metal() -> str:
    """Metals by eta and k: a ball, a two-sided pane, a smooth mesh."""
    gold = rgb("eta", 0.143, 0.375, 1.442) + rgb("k", 3.983, 2.386, 1.603)
    iron = rgb("eta", 2.9, 2.92, 2.53) + rgb("k", 3.05, 2.93, 2.73)
    pane = transform(scale(0.9), rotate("y", -35), rotate("x", -10), translate(1.5, 0.9, -0.6))
    return (
        sensor() + striped() + sphere(-0.7, 0.8, 0.3, 0.8, bsdf("conductor", gold))
        + shape("rectangle", pane, bsdf("twosided", bsdf("conductor", iron)))
        + shape("ply", text("filename", "meshes/bumps.ply"),
                transform(scale(0.4), translate(0.9, 0.5, 1)),
                bsdf("conductor", iron, rgb("specular_reflectance", 0.9, 0.6, 0.4)))
    )  # fmt: skip


@scene
def dielectric_sphere() -> str:
    """A glass ball, with indices by name and by number, one tinted."""
    tinted = bsdf("dielectric", number("int_ior", 1.5), number("ext_ior", 1),
                  rgb("specular_transmittance", 0.9, 0.7, 0.5),
                  rgb("specular_reflectance", 0.6, 0.9, 1))  # fmt: skip
    return (
        sensor() + striped() + sphere(-0.8, 0.9, 0.3, 0.8, bsdf("dielectric"))
        + sphere(0.9, 0.7, 0.6, 0.6, tinted)
        + sphere(0.1, 0.35, 1.5, 0.3,
                 bsdf("dielectric", text("int_ior", "diamond"), text("ext_ior", "water")))
    )  # fmt: skip


@scene
def nested_dielectrics() -> str:
    """A ball of index 1.5 and a bubble of air in a ball of water, with a matt core."""
    return (
        sensor() + striped()
        + sphere(0, 1.3, 0, 1.2, bsdf("dielectric", number("int_ior", 1.33), number("ext_ior", 1)))
        + sphere(-0.4, 1.4, 0.3, 0.5,
                 bsdf("dielectric", number("int_ior", 1.5), number("ext_ior", 1.33)))
        + sphere(0.5, 1.5, 0.2, 0.35,
                 bsdf("dielectric", number("int_ior", 1), number("ext_ior", 1.33)))
        + sphere(0.2, 0.7, 0.2, 0.25, diffuse(0.9, 0.6, 0.2))
    )  # fmt: skip


@scene
def glass_cube() -> str:
    """Cubes of glass, one given inside out, with total internal reflection."""
    return (
        sensor() + striped()
        + shape("cube", transform(scale(0.6), rotate("y", 25), translate(-0.7, 0.7, 0.3)),
                bsdf("dielectric", number("int_ior", 1.5)))
        + shape("cube", flag("flip_normals"),
                transform(scale(0.3), rotate("y", 40), rotate("x", 30), translate(0.9, 0.6, 1)),
                bsdf("dielectric", number("int_ior", 1), number("ext_ior", 1.5)))
    )  # fmt: skip


@scene
def glass_mesh() -> str:
    """A smooth mesh of glass: shading normals in refraction, on a mesh without concavities."""
    return (
        sensor() + striped()
        + shape("ply", text("filename", "meshes/egg.ply"),
                transform(scale(0.9), rotate("z", 25), translate(0, 1.1, 0.3)),
                bsdf("dielectric", number("int_ior", 1.5)))
    )  # fmt: skip


@scene
def thindielectric() -> str:
    """Thin panes and a thin shell before the walls."""
    pane = transform(scale(0.8), rotate("y", 25), translate(-0.9, 1, 0.5))
    colour = rgb("specular_transmittance", 0.9, 0.6, 0.4)
    tinted = bsdf("thindielectric", number("int_ior", 1.8), colour)
    return (
        sensor() + striped() + shape("rectangle", pane, bsdf("thindielectric"))
        + sphere(0.8, 0.8, 0.5, 0.7, bsdf("thindielectric", number("int_ior", 2.2)))
        + shape("disk", transform(scale(0.5), rotate("x", -60), translate(0, 0.5, 1.6)), tinted)
    )  # fmt: skip


@scene
def polarisers() -> str:
    """Filters one before the other, before a ball, a cube and the walls."""
    panes = [
        shape(
            "rectangle", transform(scale(0.7), rotate("y", 15), translate(x, 1.3, z)), bsdf(*what)
        )
        for x, z, what in (
            (-1.2, 0.6, ("polarizer",)),
            (-0.7, 1.2, ("circular", rgb("transmittance", 0.8, 0.9, 0.5))),
            (0.9, 1.2, ("retarder",)),
        )
    ]
    cube = transform(scale(0.5), rotate("y", 30), translate(0.8, 0.5, -0.2))
    return (
        sensor() + striped() + "".join(panes)
        + sphere(-0.7, 0.6, -0.2, 0.6, bsdf("plastic", rgb("diffuse_reflectance", 0.8, 0.3, 0.1)))
        + shape("cube", cube, bsdf("diffuse", rgb("reflectance", 0.2, 0.5, 0.9)))
    )  # fmt: skip


@scene
def plastic() -> str:
    """Plastic: a glossy ball and pane with the default indices and others."""
    pane = transform(scale(0.9), rotate("y", -35), rotate("x", -10), translate(1.3, 0.9, -0.6))
    return (
        sensor() + striped()
        + sphere(-0.7, 0.8, 0.3, 0.8, bsdf("plastic", rgb("diffuse_reflectance", 0.8, 0.3, 0.1)))
        + shape("rectangle", pane, bsdf("twosided", bsdf(
            "plastic", rgb("diffuse_reflectance", 0.1, 0.6, 0.3), number("int_ior", 1.9),
            rgb("specular_reflectance", 0.9, 0.8, 0.5))))
        + shape("ply", text("filename", "meshes/bumps.ply"),
                transform(scale(0.4), translate(0.8, 0.5, 1.1)), bsdf("plastic"))
    )  # fmt: skip


@scene
def plastic_nonlinear() -> str:
    """Plastic whose base takes the colour shift of internal reflections."""
    base = rgb("diffuse_reflectance", 0.9, 0.5, 0.2) + number("int_ior", 1.5)
    return (
        sensor() + striped()
        + sphere(-0.8, 0.8, 0.3, 0.8, bsdf("plastic", base, flag("nonlinear")))
        + sphere(0.9, 0.8, 0.3, 0.8, bsdf("plastic", base))
    )  # fmt: skip


@scene
def plastic_matt() -> str:
    """Plastic whose coat reflects nothing: paths end at it where they would be reflected."""
    base = rgb("diffuse_reflectance", 0.6, 0.7, 0.9) + rgb("specular_reflectance", 0, 0, 0)
    return (
        sensor() + striped()
        + sphere(-0.8, 0.8, 0.3, 0.8, bsdf("plastic", base))
        + sphere(0.9, 0.8, 0.3, 0.8, bsdf("plastic", base, number("int_ior", 2.2)))
    )  # fmt: skip


def rough(alpha: float, *more: str, ggx: bool = False) -> tuple[str, ...]:
    """Parameters of a rough surface; Beckmann, the default, is not named."""
    return (number("alpha", alpha), *([text("distribution", "ggx")] if ggx else []), *more)


@scene
def rough_metal() -> str:
    """Rough metal and rough mirrors: GGX and Beckmann, fine and coarse."""
    gold = rgb("eta", 0.2, 0.5, 1.4), rgb("k", 3.9, 2.4, 1.7)
    pane = transform(scale(0.8), rotate("y", -35), rotate("x", -10), translate(1.5, 0.9, -0.6))
    return (
        sensor() + striped()
        + sphere(-0.9, 0.8, 0.2, 0.7, bsdf("roughconductor", *gold, *rough(0.3, ggx=True)))
        + sphere(0.5, 0.5, 1, 0.45, bsdf("roughconductor", *gold))
        + shape("rectangle", pane, bsdf("twosided", bsdf(
            "roughconductor", *rough(0.05, rgb("specular_reflectance", 0.9, 0.8, 0.5)))))
        + shape("ply", text("filename", "meshes/bumps.ply"),
                transform(scale(0.4), translate(-0.4, 0.5, 1.3)),
                bsdf("roughconductor", *rough(0.6)))
    )  # fmt: skip


@scene
def rough_plastic() -> str:
    """Rough plastic: GGX and Beckmann, linear and not, from both sides."""
    red, green = (rgb("diffuse_reflectance", *c) for c in ((0.8, 0.3, 0.1), (0.1, 0.6, 0.3)))
    pane = transform(scale(0.9), rotate("y", -35), rotate("x", -10), translate(1.3, 0.9, -0.6))
    return (
        sensor() + striped()
        + sphere(-0.9, 0.8, 0.2, 0.7,
                 bsdf("roughplastic", red, *rough(0.3, flag("nonlinear"), ggx=True)))
        + sphere(0.5, 0.5, 1, 0.45, bsdf("roughplastic"))
        + shape("rectangle", pane, bsdf("twosided", bsdf(
            "roughplastic", green, *rough(0.5, number("int_ior", 1.9),
                                          rgb("specular_reflectance", 0.9, 0.8, 0.5)))))
    )  # fmt: skip


@scene
def rough_glass() -> str:
    """Rough glass: balls, a block and an egg, GGX and Beckmann."""
    tints = rgb("specular_reflectance", 0.7, 0.8, 0.9), rgb("specular_transmittance", 0.9, 0.8, 0.7)
    block = transform(scale(0.5, 0.6, 0.3), rotate("y", 30), translate(1.4, 0.61, 0.2))
    return (
        sensor() + striped()
        + sphere(-0.9, 0.8, 0.2, 0.7, bsdf("roughdielectric", *rough(0.3, *tints, ggx=True)))
        + sphere(0.3, 0.5, 1, 0.45, bsdf("roughdielectric"))
        + shape("cube", block, bsdf("roughdielectric", *rough(0.5, number("int_ior", 1.8))))
        + shape("ply", text("filename", "meshes/egg.ply"),
                transform(scale(0.4), rotate("z", 25), translate(-0.6, 0.5, 1.5)),
                bsdf("roughdielectric", *rough(0.2)))
    )  # fmt: skip


HEIGHTS, WHOLE = text("shadowing", "height_correlated"), flag("energy_compensation")


@scene
def rough_shadows() -> str:
    """Shadows of small mirrors correlated by height: metal, plastic and glass, GGX and Beckmann."""
    gold = rgb("eta", 0.2, 0.5, 1.4), rgb("k", 3.9, 2.4, 1.7)
    red = rgb("diffuse_reflectance", 0.8, 0.3, 0.1)
    block = transform(scale(0.5, 0.6, 0.3), rotate("y", 30), translate(1.4, 0.61, 0.2))
    return (
        sensor() + striped()
        + sphere(-0.9, 0.8, 0.2, 0.7, bsdf("roughdielectric", *rough(0.6, HEIGHTS, ggx=True)))
        + sphere(0.4, 0.5, 1, 0.45, bsdf("roughconductor", *gold, *rough(0.8, HEIGHTS)))
        + shape("cube", block,
                bsdf("roughdielectric", *rough(0.5, number("int_ior", 1.8), HEIGHTS)))
        + shape("ply", text("filename", "meshes/bumps.ply"),
                transform(scale(0.4), translate(-0.4, 0.5, 1.3)),
                bsdf("roughplastic", red, *rough(0.5, HEIGHTS, ggx=True)))
        + sphere(0.4, 1.5, -0.4, 0.45,
                 bsdf("roughconductor", *rough(0.7, HEIGHTS, ggx=True)))
    )  # fmt: skip


@scene
def rough_whole() -> str:
    """Rough metal and glass with energy compensation, by either kind of shadows."""
    gold = rgb("eta", 0.2, 0.5, 1.4), rgb("k", 3.9, 2.4, 1.7)
    tints = rgb("specular_reflectance", 0.7, 0.8, 0.9), rgb("specular_transmittance", 0.9, 0.8, 0.7)
    straw = rgb("specular_reflectance", 0.9, 0.8, 0.5)
    pane = transform(scale(0.7), rotate("y", -35), rotate("x", -10), translate(1.7, 0.9, -0.8))
    block = transform(scale(0.4, 0.5, 0.3), rotate("y", 30), translate(1.3, 0.51, 0.7))
    return (
        sensor() + striped()
        + sphere(-0.9, 0.8, 0.2, 0.7,
                 bsdf("roughconductor", *gold, *rough(0.7, WHOLE, ggx=True)))
        + sphere(0.3, 0.5, 1.1, 0.45,
                 bsdf("roughdielectric", *rough(0.6, WHOLE, HEIGHTS, ggx=True)))
        + shape("rectangle", pane, bsdf("twosided", bsdf(
            "roughconductor", *rough(1, WHOLE, HEIGHTS, straw))))
        + shape("cube", block, bsdf("roughdielectric", *tints,
                                    *rough(0.5, number("int_ior", 1.8), WHOLE)))
    )  # fmt: skip


@scene
def medium_in_rough_glass() -> str:
    """A scattering medium in a ball of rough glass."""
    glass = bsdf("roughdielectric", number("int_ior", 1.4), *rough(0.2))
    return sensor() + striped() + sphere(0, 1.1, 0.3, 1, glass, inside((2,), (0.9, 0.9, 0.9)))


def principled(base: tuple[float, ...], *more: str, **shares: float) -> str:
    """A principled surface of such shares."""
    given = (number(name, value) for name, value in shares.items())
    return bsdf("principled", rgb("base_color", *base), *given, *more)


@scene
def principled_surfaces() -> str:
    """Principled surfaces: cloth, lacquer, tinted and metallic ones, one of them on both sides."""
    pane = transform(scale(0.9), rotate("y", -35), rotate("x", -10), translate(1.3, 0.9, -0.6))
    cloth = principled((0.6, 0.2, 0.1), roughness=0.9, sheen=1, sheen_tint=0.6, flatness=0.4)
    lacquer = principled((0.1, 0.3, 0.7), roughness=0.6, clearcoat=1, clearcoat_gloss=0.3)
    metal = principled((0.9, 0.6, 0.2), roughness=0.4, metallic=0.8, spec_tint=0.5, specular=0.9)
    return (
        sensor() + striped()
        + sphere(-0.9, 0.8, 0.2, 0.7, cloth)
        + sphere(0.5, 0.5, 1, 0.45, lacquer)
        + sphere(-0.3, 0.35, 1.6, 0.3, bsdf("principled"))
        + shape("rectangle", pane, bsdf("twosided", metal))
    )  # fmt: skip


@scene
def principled_glass() -> str:
    """Principled surfaces that let light through: frosted glass, half glass and half metal."""
    block = transform(scale(0.5, 0.6, 0.3), rotate("y", 30), translate(1.4, 0.61, 0.2))
    frosted = principled((0.9, 0.8, 0.6), roughness=0.5, spec_trans=1)
    half = principled((0.3, 0.7, 0.4), roughness=0.6, spec_trans=0.6, eta=1.3, clearcoat=0.8)
    mixed = principled((0.8, 0.5, 0.3), roughness=0.7, spec_trans=0.7, metallic=0.3, sheen=0.5,
                       spec_tint=0.5)  # fmt: skip
    return (
        sensor() + striped()
        + sphere(-0.9, 0.8, 0.2, 0.7, frosted)
        + sphere(0.5, 0.5, 1, 0.45, half)
        + shape("cube", block, mixed)
    )  # fmt: skip


@scene
def thin_sheets() -> str:
    """Thin principled sheets: a leaf, a lampshade, a frosted pane and a tinted one, a ball."""

    def sheet(base: tuple[float, ...], **shares: float) -> str:
        given = (number(name, value) for name, value in shares.items())
        return bsdf("principledthin", rgb("base_color", *base), *given)

    leaf = sheet((0.4, 0.7, 0.2), diff_trans=1.2, roughness=0.6, sheen=0.5, sheen_tint=0.8)
    shade = sheet((0.9, 0.8, 0.6), diff_trans=1.6, flatness=0.5)
    frosted = sheet((0.9, 0.95, 1.0), spec_trans=1, roughness=0.8)
    tinted = sheet((0.9, 0.5, 0.3), spec_trans=0.7, spec_tint=0.6, roughness=0.6, eta=1.8,
                   diff_trans=0.8, anisotropic=0.6)  # fmt: skip
    near = transform(scale(0.6, 0.8, 1), rotate("y", 25), translate(-1.3, 0.9, 1.2))
    far = transform(scale(0.9), rotate("y", -35), rotate("x", -10), translate(1.3, 0.95, -0.6))
    leaning = transform(scale(0.7, 0.5, 1), rotate("x", -60), translate(-0.2, 1.6, 0.2))
    return (
        sensor() + striped()
        + shape("rectangle", near, frosted)
        + shape("rectangle", far, tinted)
        + shape("disk", leaning, leaf)
        + sphere(0.5, 0.45, 1.2, 0.45, shade)
        + sphere(-0.7, 0.5, -0.6, 0.45, diffuse(0.2, 0.3, 0.7))
    )  # fmt: skip


@scene
def mask() -> str:
    """Opacity 0.3, 0.6 and 0.9 over diffuse, plastic and mirror."""

    def masked(opacity: float, *inner: str) -> str:
        return bsdf("mask", number("opacity", opacity), bsdf(*inner))

    pane = transform(scale(0.8), rotate("y", 25), translate(-0.9, 1, 0.5))
    return (
        sensor() + striped()
        + shape("rectangle", pane, bsdf("mask", number("opacity", 0.6),
                                        bsdf("twosided", diffuse(0.8, 0.4, 0.2))))
        + sphere(0.9, 0.8, 0.4, 0.7, masked(0.3, "conductor", text("material", "none")))
        + sphere(0.1, 0.4, 1.5, 0.35, masked(0.9, "plastic"))
    )  # fmt: skip


@scene
def twosided() -> str:
    """Open surfaces that reflect on both sides, beside ones that are black from behind."""

    def pane(x: float, angle: float) -> str:
        return transform(scale(0.45, 0.9, 1), rotate("y", angle), translate(x, 1, 0.3))

    both = bsdf("twosided", diffuse(0.8, 0.4, 0.2))
    return (
        sensor() + striped() + shape("rectangle", pane(-1.8, 160), both)
        + shape("rectangle", pane(-0.6, 200), bsdf("twosided", bsdf("plastic")))
        + shape("rectangle", pane(0.6, 160), bsdf("twosided", MIRROR))
        + shape("rectangle", pane(1.8, 200), diffuse(0.8))
        + shape("disk", transform(scale(0.5), rotate("x", 80), translate(0, 0.6, 1.2)), both)
    )  # fmt: skip


# ---- media ----

NULL = bsdf("null")


@scene
def null_medium() -> str:
    """A scattering medium in an index-matched ball, beside a matt one."""
    return (
        sensor() + striped()
        + sphere(-0.7, 1, 0.2, 0.9, NULL, inside((1.5,), (0.8, 0.8, 0.8)))
        + sphere(0.9, 0.6, 0.8, 0.5, diffuse(0.7))
    )  # fmt: skip


@scene
def medium_in_glass() -> str:
    """A scattering medium in a glass ball: subsurface scattering."""
    glass = bsdf("dielectric", number("int_ior", 1.4))
    return sensor() + striped() + sphere(0, 1.1, 0.3, 1, glass, inside((3,), (0.9, 0.9, 0.9)))


@scene
def chromatic_medium() -> str:
    """Extinction and albedo by colour, index-matched and in glass."""
    glass = bsdf("dielectric", number("int_ior", 1.3))
    return (
        sensor() + striped()
        + sphere(-1, 1, 0.2, 0.9, NULL, inside((0.8, 1.6, 2.4), (0.95, 0.8, 0.5)))
        + sphere(1, 1, 0.2, 0.9, glass, inside((2.5, 1.5, 1), (0.6, 0.9, 0.95)))
    )  # fmt: skip


@scene
def absorbing_glass() -> str:
    """Clear and coloured glass that absorbs: albedo 0."""
    glass = bsdf("dielectric", number("int_ior", 1.5))
    return (
        sensor() + striped()
        + sphere(-0.9, 0.9, 0.2, 0.8, glass, inside((0.2, 0.6, 1.0), (0,)))
        + shape("cube", transform(scale(0.5), rotate("y", 30), translate(0.9, 0.6, 0.5)),
                NULL, inside((1, 0.5, 0.2), (0,)))
    )  # fmt: skip


@scene
def hg_forward() -> str:
    """Henyey-Greenstein forward scattering, g = 0.8."""
    return sensor() + striped() + sphere(0, 1.1, 0.2, 1, NULL, inside((2.5,), (0.95,), 0.8))


@scene
def hg_backward() -> str:
    """Henyey-Greenstein backward scattering, g = -0.6, with a scale."""
    return (
        sensor() + striped()
        + sphere(0, 1.1, 0.2, 1, NULL, inside((0.2,), (0.9,), -0.6, scaling=10))
    )  # fmt: skip


@scene
def rayleigh_air() -> str:
    """Air that scatters as Rayleigh says, blue most, around a ball under a low sun."""
    air = inside((0.12, 0.28, 0.6), (1, 0.98, 0.95), phase_function("rayleigh"))
    return (
        sensor() + floor(0.4, 0.35, 0.3) + sky(0.1, 0.12, 0.15)
        + shape("cube", transform(scale(2.4, 0.9, 2), translate(0, 1, 0)), NULL, air)
        + sphere(0.7, 0.7, 0.1, 0.5, diffuse(0.8, 0.6, 0.4))
        + emitter("directional", vector("direction", 0.8, -0.5, -0.4),
                  rgb("irradiance", 3, 2.7, 2.4))
    )  # fmt: skip


@scene
def blended_fog() -> str:
    """Phase functions by a table, in glass, and blended of Henyey-Greenstein, it and Rayleigh's."""
    table = text("values", "0.9, 0.3, 0.1, 0.2, 0.5, 2.5")
    inner = phase_function(
        "blendphase", number("weight", 0.4), phase_function("tabphase", table, name="first"),
        phase_function("rayleigh", name="second"), name="second",
    )  # fmt: skip
    outer = phase_function("hg", number("g", 0.85), name="first")
    blend = phase_function("blendphase", number("weight", 0.7), outer, inner)
    glass = bsdf("dielectric", number("int_ior", 1.3))
    return (
        sensor() + striped()
        + sphere(-0.9, 1, 0.2, 0.9, NULL, inside((2.2,), (0.95, 0.9, 0.8), blend))
        + sphere(1, 0.9, 0.3, 0.8, glass, inside((1.5,), (0.8, 0.9, 0.95),
                                                 phase_function("tabphase", table)))
    )  # fmt: skip


@scene
def camera_in_medium() -> str:
    """The camera stands in the medium, inside a null cube, and sees a lamp and a ball in it."""
    fog = medium("fog", (0.08, 0.1, 0.14), (0.9, 0.8, 0.7), 0.3)
    return (
        fog + sensor(extra=number("near_clip", 1e-5) + ref("fog", "medium")) + sky(0.5, 0.6, 0.7)
        + shape("cube", transform(scale(7)), NULL, ref("fog", "interior"))
        + shape("rectangle", transform(scale(5), rotate("x", -90)), diffuse(0.5, 0.6, 0.5))
        + shape("rectangle", transform(scale(1.5), rotate("x", 90), translate(1.5, 4, 0)),
                diffuse(0), area(5, 4, 3))
        + sphere(-0.6, 0.8, 0, 0.8, diffuse(0.8, 0.4, 0.2))
    )  # fmt: skip


@scene
def touching_media() -> str:
    """Two media that share a wall, one around a third, all index-matched."""
    media = (
        medium("left", (1.2,), (0.9, 0.6, 0.4)) + medium("right", (0.6, 0.9, 1.2), (0.5, 0.7, 0.9))
        + medium("core", (4,), (0.9,), 0.5)
    )  # fmt: skip

    def wall(x: float, y: float, z: float, turn: str, interior: str) -> str:
        place = transform(scale(0.7), turn, translate(x, y, z))
        return shape("rectangle", place, NULL, ref(interior, "interior"))

    parts = [media, sensor(), striped()]
    for side, name in ((-0.7, "left"), (0.7, "right")):
        parts += [
            wall(side, 1.1, 0.9, rotate("y", 0), name),
            wall(side, 1.1, -0.5, rotate("y", 180), name),
            wall(side, 1.8, 0.2, rotate("x", -90), name),
            wall(side, 0.4, 0.2, rotate("x", 90), name),
            wall(2 * side, 1.1, 0.2, rotate("y", 90 if side > 0 else -90), name),
        ]
    shared = transform(scale(0.7), rotate("y", 90), translate(0, 1.1, 0.2))
    outside = ref("right", "exterior")
    parts.append(shape("rectangle", shared, NULL, ref("left", "interior"), outside))
    parts.append(sphere(0.7, 1.1, 0.2, 0.35, NULL, ref("core", "interior"), outside))
    return "".join(parts)


@scene
def point_in_medium() -> str:
    """A point light in a hollow of a medium: shadow rays through two null boundaries."""
    haze = medium("haze", (0.5, 0.7, 0.9), (0.8, 0.6, 0.4))
    return (
        haze + sensor() + floor(0.5, 0.6, 0.5) + sky(0.15, 0.2, 0.25)
        + sphere(0, 1.4, 0, 1.3, NULL, ref("haze", "interior"))
        + sphere(0.2, 1.6, 0.2, 0.5, NULL, ref("haze", "exterior"))
        + sphere(-0.4, 0.5, 0.3, 0.2, diffuse(0.7))
        + emitter("point", point("position", 0.2, 1.7, 0.3), rgb("intensity", 12, 12, 12))
    )  # fmt: skip


@scene
def lamp_in_medium() -> str:
    """Lamps inside media: a sphere in fog in glass, a rectangle behind a null boundary."""
    glass = bsdf("dielectric", number("int_ior", 1.3))
    return (
        sensor() + floor(0.5, 0.6, 0.5) + sky(0.3, 0.35, 0.4)
        + sphere(-1, 1, 0.2, 0.9, glass, inside((1,), (0.9,)))
        + sphere(-1, 1, 0.2, 0.4, diffuse(0.3), area(5, 4, 2))
        + shape("cube", transform(scale(0.8), translate(1.1, 0.9, 0.2)), NULL,
                inside((0.8, 0.5, 0.3), (0.7,), 0.4))
        + shape("rectangle", transform(scale(0.4), rotate("x", 90), translate(1.1, 1.4, 0.2)),
                diffuse(0), area(4, 5, 8))
    )  # fmt: skip


@scene
def medium_in_mesh() -> str:
    """A mesh of wax: refractive smooth boundary, dense medium, scale."""
    return (
        sensor() + striped()
        + shape("ply", text("filename", "meshes/egg.ply"),
                transform(scale(0.9), rotate("z", 25), translate(0, 1.1, 0.3)),
                bsdf("dielectric", number("int_ior", 1.3)),
                inside((3.6, 4.8, 6), (0.99, 0.95, 0.8)))
    )  # fmt: skip


# ---- cameras and filters ----


@scene
def thinlens() -> str:
    """Depth of field: a thin lens focused on the middle ball."""
    lens = number("aperture_radius", 0.25) + number("focus_distance", 5.5)
    parts = [sensor((0, 1.6, 6), (0, 0.6, 0), 40, kind="thinlens", extra=lens), striped()]
    for x, z, colour in ((-1.2, -2, (0.8, 0.3, 0.2)), (0, 0.5, (0.3, 0.8, 0.2)),
                         (0.8, 2.5, (0.2, 0.3, 0.8))):  # fmt: skip
        parts.append(sphere(x, 0.5, z, 0.5, diffuse(*colour)))
    return "".join(parts)


@scene
def orthographic() -> str:
    """Parallel rays: a turned film of unequal scales, whose near and far planes cut the scene."""
    place = '<lookat origin="2, 3, 5" target="0, 0.7, 0" up="0.3, 1, 0"/>'
    film = transform(scale(2.2, 1.7, 0.5), place)
    clip = number("near_clip", 8.6) + number("far_clip", 11.8)
    return (
        sensor(kind="orthographic", placed=clip + film) + striped()
        + sphere(0.6, 0.8, 0.9, 0.8, diffuse(0.3, 0.5, 0.8))
        + sphere(-0.9, 0.6, -0.3, 0.6, bsdf("conductor"))
    )  # fmt: skip


@scene
def hidden_light() -> str:
    """Lamps and a sky that the camera does not see: behind a lamp, a pane, glass and a mirror."""
    return (
        sensor() + striped()
        + shape("rectangle", transform(scale(0.7), rotate("y", 20), translate(-0.9, 1.1, 1)),
                diffuse(0.5), area(2, 1.6, 1.2))
        + sphere(0.9, 1.6, 0.3, 0.4, diffuse(0.2), area(1, 2, 3))
        + shape("rectangle", transform(scale(0.6), rotate("y", -15), translate(0.9, 0.7, 1.4)),
                bsdf("thindielectric"))
        + sphere(0.3, 0.5, -0.4, 0.5, bsdf("dielectric"))
        + sphere(1.7, 0.6, -0.6, 0.6, bsdf("conductor"))
    )  # fmt: skip


def edges(rfilter: str) -> str:
    """A tilted edge and a ball of low contrast: no mean is negative under a signed filter."""
    return (
        sensor(rfilter=f'<rfilter type="{rfilter}"/>') + floor(0.7, 0.8, 0.7) + sky(1, 1, 1)
        + shape("rectangle", transform(scale(0.8), rotate("z", 20), translate(-1, 1.2, 0)),
                diffuse(0), area(2, 1.7, 1.4))
        + sphere(1, 0.8, 0.3, 0.8, diffuse(0.5, 0.6, 0.7))
    )  # fmt: skip


@scene
def tent() -> str:
    """Edges under the filter tent."""
    return edges("tent")


@scene
def gaussian() -> str:
    """Edges under the filter gaussian."""
    return edges("gaussian")


@scene
def mitchell() -> str:
    """Edges under the filter mitchell, which has negative lobes."""
    return edges("mitchell")


# ---- files ----


def displaced(level: int, bump: Callable[[Array], Array]) -> tuple[Array, Array]:
    """An icosphere whose vertices are moved to `bump` of their direction: vertices and faces."""
    import trimesh

    ball = trimesh.creation.icosphere(level)
    unit = np.asarray(ball.vertices, np.float64)
    unit /= np.linalg.norm(unit, axis=1, keepdims=True)
    return bump(unit), np.asarray(ball.faces, np.int64)


def bumps(d: Array, height: float = 0.09) -> Array:
    """A ball with waves."""
    wave = np.sin(5 * d[:, 0] + 1) * np.sin(5 * d[:, 1]) * np.sin(5 * d[:, 2] + 2)
    return d * (1 + height * wave)[:, None]


def egg(d: Array) -> Array:
    """A convex body without symmetry."""
    return d * [0.8, 1.1, 0.9] * (1 + 0.1 * d[:, 1:2])


def normals(surface: Callable[[Array], Array], d: Array) -> Array:
    """Unit normals of a surface over the sphere at directions d (N, 3), by differences."""
    helper = np.where(np.abs(d[:, :1]) < 0.5, [[1.0, 0, 0]], [[0, 1.0, 0]])
    u = np.cross(d, helper)
    u /= np.linalg.norm(u, axis=1, keepdims=True)
    v = np.cross(d, u)

    def slope(t: Array) -> Array:
        def at(step: float) -> Array:
            p = d + step * t
            return surface(p / np.linalg.norm(p, axis=1, keepdims=True))

        return (at(1e-5) - at(-1e-5)) / 2e-5

    n: Array = np.cross(slope(u), slope(v))
    return n / np.linalg.norm(n, axis=1, keepdims=True)


def ply(vertices: Array, faces: Array, normal: Array) -> str:
    """An ASCII PLY file with vertex normals."""
    head = (
        f"ply\nformat ascii 1.0\nelement vertex {len(vertices)}\n"
        + "".join(f"property float {name}\n" for name in "x y z nx ny nz".split())
        + f"element face {len(faces)}\nproperty list uchar int vertex_indices\nend_header\n"
    )
    rows = ["{:.5f} {:.5f} {:.5f} {:.4f} {:.4f} {:.4f}\n".format(*v, *n)
            for v, n in zip(vertices, normal, strict=True)]  # fmt: skip
    return (head + "".join(rows) + "".join("3 {} {} {}\n".format(*f) for f in faces)).replace(
        "-0.00000", "0.00000"
    ).replace("-0.0000 ", "0.0000 ")  # fmt: skip


def serialized(*meshes: tuple[Array, Array, Array | None]) -> bytes:
    """Mitsuba's own format, version 4, of vertices, faces and normals; stored, not compressed."""
    content, offsets = b"", []
    for vertices, faces, normal in meshes:
        flags = 0x1000 + (normal is not None)
        counts = np.array([len(vertices), len(faces)], "<u8").tobytes()
        body = np.uint32(flags).tobytes() + b"egg\0" + counts + vertices.astype("<f4").tobytes()
        body += b"" if normal is None else normal.astype("<f4").tobytes()
        body += faces.astype("<u4").tobytes()
        size = np.array([len(body), len(body) ^ 0xFFFF], "<u2").tobytes()
        offsets.append(len(content))
        content += b"\x1c\x04\x04\0" + b"\x78\x01" + b"\1" + size + body
        content += zlib.adler32(body).to_bytes(4, "big")
    table = np.array(offsets, "<u8").tobytes()
    return content + table + np.uint32(len(offsets)).tobytes()


def obj(vertices: Array, faces: Array) -> str:
    """An OBJ file without normals."""
    rows = ["v {:.5f} {:.5f} {:.5f}\n".format(*v) for v in vertices]
    rows += ["f {} {} {}\n".format(*(f + 1)) for f in faces]
    return "".join(rows).replace("-0.00000", "0.00000")


@scene
def textures() -> str:
    """Bitmaps and checkerboards on a plane, a ball, a cube, a disk: wrapped, filtered, turned."""
    image = text("filename", "images/weave.png")
    ground = bsdf(
        "diffuse",
        texture(
            "bitmap",
            image,
            text("wrap_mode", "mirror"),
            to_uv=scale(7, 11, 1) + rotate("z", 30) + translate(0.3, 0.1, 0),
        ),
    )
    ball = bsdf("diffuse", texture("bitmap", image, to_uv=scale(2, 1, 1)))
    crate = bsdf(
        "diffuse",
        texture(
            "checkerboard",
            rgb("color0", 0.8, 0.3, 0.2),
            rgb("color1", 0.2, 0.4, 0.7),
            to_uv=scale(3, 2, 1),
        ),
    )
    coin = bsdf(
        "diffuse",
        texture(
            "bitmap",
            image,
            flag("raw"),
            text("filter_type", "nearest"),
            text("wrap_mode", "clamp"),
            to_uv=scale(1.2, 1.2, 1) + translate(-0.1, -0.1, 0),
        ),
    )
    return (
        sensor() + shape("rectangle", transform(scale(20), rotate("x", -90)), ground)
        + shape("sphere", transform(rotate("x", -70), rotate("y", 40), translate(-1.3, 1, 0)), ball)
        + shape("cube", transform(scale(0.6), rotate("y", 30), translate(1.1, 0.6, 0.6)), crate)
        + shape("disk", transform(scale(0.9), rotate("x", -20), translate(0.9, 2.2, -1)), coin)
        + sky(0.5, 0.6, 0.7) + lamp(4, 3.5, 3)
    )  # fmt: skip


@scene
def textured_lamps() -> str:
    """Lamps with bitmaps and checkerboards: rectangles, a disk, a ball."""
    image = text("filename", "images/weave.png")

    def shining(kind: str, *content: str, to_uv: str = "") -> str:
        return diffuse(0.2) + emitter("area", texture(kind, *content, name="radiance", to_uv=to_uv))

    board = rgb("color0", 1, 0.3, 0.2), rgb("color1", 0, 0.2, 0.8)
    return (
        sensor() + floor(0.5, 0.6, 0.5) + sphere(0, 0.5, 0.6, 0.5, diffuse(0.7, 0.5, 0.3))
        + shape("rectangle", transform(scale(1.2, 0.8, 1), rotate("y", 60), translate(-2, 1.2, 0)),
                shining("checkerboard", *board, to_uv=scale(2, 3, 1) + rotate("z", 20)))
        + shape("disk", transform(scale(0.7), rotate("x", 100), translate(0.3, 2.2, -0.4)),
                shining("checkerboard", *board, to_uv=scale(2, 4, 1)))
        + shape("sphere", transform(scale(0.4), rotate("x", -70), translate(1.7, 1, 0.8)),
                shining("bitmap", image, text("filter_type", "nearest")))
        + shape("rectangle", transform(scale(0.4), rotate("y", 30), translate(-0.9, 0.45, 1.5)),
                shining("bitmap", image, to_uv=scale(1.5, 0.5, 1)))
    )  # fmt: skip


@scene
def projected_images() -> str:
    """A projector with a bitmap, one of a colour, and spot lights with a bitmap and a board."""
    image = text("filename", "images/weave.png")
    return (
        sensor() + floor(0.5, 0.6, 0.5) + sphere(0, 0.7, 0, 0.7, diffuse(0.7, 0.5, 0.3))
        + sky(0.05, 0.06, 0.07)
        + emitter("projector", look_at((-3, 3, 2), (-0.5, 0, 0)), number("fov", 40),
                  number("scale", 8), texture("bitmap", image, name="irradiance"))
        + emitter("projector", look_at((1, 4, -2), (1.2, 0, -0.4)), number("fov", 20),
                  text("fov_axis", "y"), rgb("irradiance", 1, 3, 4))
        + emitter("spot", look_at((2.5, 4, 1), (0.9, 0, 0.6)), rgb("intensity", 60, 40, 30),
                  texture("bitmap", image, text("wrap_mode", "clamp"), name="texture"))
        + emitter("spot", look_at((-1, 3, 3), (-1, 0, 1.4)), rgb("intensity", 20, 20, 30),
                  number("cutoff_angle", 25), number("beam_width", 24),
                  texture("checkerboard", rgb("color0", 1), rgb("color1", 0.1), name="texture",
                          to_uv=scale(2)))
    )  # fmt: skip


def brushed_by(along: float, across: float, *more: str, ggx: bool = False) -> tuple[str, ...]:
    """Parameters of a surface that is rougher in one direction than across."""
    named = [text("distribution", "ggx")] if ggx else []
    return (number("alpha_u", along), number("alpha_v", across), *named, *more)


@scene
def brushed() -> str:
    """Surfaces rougher in one direction than across: a ball, a sheared pane, a disk, a cube."""
    gold = rgb("eta", 0.2, 0.5, 1.4), rgb("k", 3.9, 2.4, 1.7)
    ball = transform(rotate("x", -70), rotate("y", 40), scale(0.7), translate(-0.9, 0.8, 0.2))
    pane = transform(scale(0.8), rotate("z", 30), rotate("y", 145), translate(1.5, 0.9, -0.6))
    coin = transform(scale(0.5, 0.4, 1), rotate("x", -30), translate(0.4, 0.6, 1.2))
    block = transform(scale(0.35), rotate("y", 30), translate(-0.7, 0.36, 1.5))
    orb = transform(rotate("z", 50), scale(0.4), translate(1.4, 0.5, 1.0))
    return (
        sensor() + striped()
        + shape("sphere", ball, bsdf("roughconductor", *brushed_by(0.4, 0.1, *gold, ggx=True)))
        + shape("rectangle", pane, bsdf("twosided", bsdf(
            "roughconductor", *brushed_by(0.08, 0.4, rgb("specular_reflectance", 0.9, 0.8, 0.5)))))
        + shape("disk", coin, bsdf("roughconductor", *brushed_by(0.5, 0.1)))
        + shape("cube", block, bsdf("roughdielectric", *brushed_by(0.1, 0.5, ggx=True)))
        + shape("sphere", orb, bsdf("principled", rgb("base_color", 0.8, 0.5, 0.3),
                                    number("metallic", 0.8), number("roughness", 0.5),
                                    number("anisotropic", 0.9)))
    )  # fmt: skip


@scene
def relief() -> str:
    """Normal and bump maps on a plane, balls, a cube, a disk: shaded and not, from both sides."""
    dents = texture("bitmap", text("filename", "images/dents.png"), flag("raw"), name="normalmap",
                    to_uv=scale(3, 2, 1) + rotate("z", 20))  # fmt: skip
    weft = texture("bitmap", text("filename", "images/weave.png"), flag("raw"), name="heights",
                   to_uv=scale(2, 1, 1))  # fmt: skip
    plain = flag("use_shadowing_function", False), flag("flip_invalid_normals", False)
    ball = transform(rotate("x", -70), rotate("y", 40), scale(0.7), translate(-0.9, 0.8, 0.2))
    pane = transform(scale(0.8), rotate("y", 145), translate(1.5, 0.9, -0.6))
    sheet = transform(scale(0.6, 0.5, 1), rotate("y", -150), translate(-0.6, 2.0, -0.5))
    coin = transform(scale(0.5), rotate("x", -30), translate(0.4, 0.6, 1.2))
    block = transform(scale(0.35), rotate("y", 30), translate(-0.7, 0.36, 1.5))
    soft = bsdf("roughconductor", *rough(0.2, ggx=True))
    brush = bsdf("roughconductor", *brushed_by(0.5, 0.1))
    return (
        sensor() + striped()
        + shape("sphere", ball, bsdf("bumpmap", weft, number("scale", 0.2), soft))
        + shape("rectangle", pane,
                bsdf("twosided", bsdf("normalmap", dents, brush)))
        + shape("rectangle", sheet, bsdf("normalmap", dents, bsdf("twosided", bsdf("plastic"))))
        + shape("disk", coin, bsdf("bumpmap", weft, number("scale", 0.1), *plain,
                                   bsdf("conductor")))
        + shape("cube", block, bsdf("normalmap", dents, *plain, bsdf("roughdielectric")))
        + sphere(1.4, 0.5, 1, 0.4, bsdf("bumpmap", weft, number("scale", -0.05),
                                        bsdf("roughplastic", *rough(0.2))))
    )  # fmt: skip


def gridvolume(name: str, file: str, to_world: str, *content: str) -> str:
    """A grid of a medium."""
    return (
        f'<volume type="gridvolume" name="{name}">{text("filename", file)}{"".join(content)}'
        f"{to_world}</volume>"
    )


@scene
def albedo_grid() -> str:
    """Grids that give the albedo of media, turned and repeated in glass, and nearest beside it."""
    glass = bsdf("dielectric", number("int_ior", 1.3))
    file = "volumes/colours.vol"
    turned = transform(scale(0.9, 0.7, 0.8), rotate("y", 30), translate(-1.2, 0.6, 0))
    box = transform(translate(1, 1, 0.2))
    return (
        sensor() + striped()
        + sphere(-1, 1, 0.2, 0.9, glass,
                 '<medium type="homogeneous" name="interior">' + number("sigma_t", 4)
                 + gridvolume("albedo", file, turned, text("wrap_mode", "repeat"))
                 + '<phase type="hg">' + number("g", 0.5) + "</phase></medium>")
        + shape("cube", transform(scale(0.7), translate(1, 0.9, 0.2)), NULL,
                '<medium type="homogeneous" name="interior">'
                + rgb("sigma_t", 0.8, 0.5, 1) + number("scale", 3)
                + gridvolume("albedo", file, box, flag("use_grid_bbox"),
                             text("filter_type", "nearest"))
                + '<phase type="isotropic"/></medium>')
    )  # fmt: skip


@scene
def smoke() -> str:
    """Uneven media: smoke in a null cube around a ball, coloured by a grid, and fog in glass."""
    glass = bsdf("dielectric", number("int_ior", 1.2))
    place = transform(scale(1.6), translate(-1.8, 0.2, -0.6))
    return (
        sensor() + striped()
        + shape("cube", transform(scale(0.8), translate(-1, 1, 0.2)), NULL,
                '<medium type="heterogeneous" name="interior">' + number("scale", 7)
                + gridvolume("sigma_t", "volumes/smoke.vol", place)
                + gridvolume("albedo", "volumes/colours.vol", place)
                + '<phase type="hg">' + number("g", 0.4) + "</phase></medium>")
        + sphere(-1, 0.7, 0.1, 0.3, diffuse(0.8, 0.3, 0.2))
        + sphere(1, 1, 0.2, 0.9, glass,
                 '<medium type="heterogeneous" name="interior">' + number("scale", 5)
                 + gridvolume("sigma_t", "volumes/smoke.vol",
                              transform(scale(1.4), rotate("y", 40), translate(0, 0.4, 0.1)))
                 + rgb("albedo", 0.9, 0.95, 0.8) + '<phase type="isotropic"/></medium>')
    )  # fmt: skip


@scene
def flakes() -> str:
    """Flakes: flat ones aslant in a ball, needles blended with haze in glass, under a low sun."""
    flat, needles = (
        phase_function("sggx", gridvolume("S", f"volumes/{name}.vol", "", flag("raw")), name=to)
        for name, to in (("flat", ""), ("needles", "first"))
    )
    haze = phase_function("hg", number("g", 0.5), name="second")
    blend = phase_function("blendphase", number("weight", 0.3), needles, haze)
    return (
        sensor() + floor(0.4, 0.35, 0.3) + sky(0.2, 0.25, 0.3)
        + sphere(-1, 1, 0.2, 0.95, NULL, inside((2.5, 1.8, 1.2), (0.95, 0.9, 0.8), flat))
        + sphere(1, 0.9, 0.3, 0.8, bsdf("dielectric", number("int_ior", 1.2)),
                 inside((1.8,), (0.8, 0.9, 0.95), blend))
        + emitter("directional", vector("direction", 0.8, -0.6, -0.4),
                  rgb("irradiance", 3, 2.7, 2.4))
    )  # fmt: skip


def matrix_cells(axis: tuple[float, ...], along: float, across: float) -> Array:
    """2 x 2 x 2 cells of the matrix of flakes whose areas are these along and across an axis."""
    n = np.array(axis) / np.linalg.norm(axis)
    s = along**2 * np.outer(n, n) + across**2 * (np.eye(3) - np.outer(n, n))
    numbers = [s[0, 0], s[1, 1], s[2, 2], s[0, 1], s[0, 2], s[1, 2]]
    return np.broadcast_to(np.array(numbers, np.float32), (2, 2, 2, 6))


def vol(cells: Array, low: tuple[float, ...], high: tuple[float, ...]) -> bytes:
    """A .vol file of cells (Z, Y, X, C), whose box is low to high."""
    z, y, x, channels = cells.shape
    head = struct.pack("<3sB5i6f", b"VOL", 3, 1, x, y, z, channels, *low, *high)
    return head + cells.astype("<f4").tobytes()


def colours() -> Array:
    """5 x 4 x 3 cells, different in all directions and channels, by integers."""
    z, y, x = np.mgrid[0:3, 0:4, 0:5]
    red, green = (x * 3 + y + 2 * z) % 7 / 6, (x * x + 2 * y + z) % 5 / 4
    return 0.1 + 0.9 * np.stack([red, green, (x + y * y + 3 * z) % 9 / 8], axis=-1)


def puff() -> Array:
    """9 x 8 x 7 cells of uneven density, none at the rim, by integers."""
    z, y, x = np.mgrid[0:7, 0:8, 0:9]
    inside = x * (8 - x) * y * (7 - y) * z * (6 - z)
    return (inside * (1 + (x * 5 + y * 3 + z * 7) % 4))[..., None] / 2048.0


@scene
def blends() -> str:
    """Blends: metal and matt by a texture, rough glass and matt, one with holes; their shadows."""
    image = text("filename", "images/weave.png")
    optics = rgb("eta", 0.2, 0.9, 1.1), rgb("k", 3.9, 2.4, 2.2)
    gold = bsdf("roughconductor", number("alpha", 0.3), *optics)
    matt = diffuse(0.2, 0.5, 0.6)
    weave = texture("bitmap", image, flag("raw"), name="weight", to_uv=scale(2, 1, 1))
    clear = bsdf("roughdielectric", number("alpha", 0.2), number("int_ior", 1.5))
    leaf = bsdf("mask", number("opacity", 0.4), diffuse(0.3, 0.7, 0.2))
    return (
        sensor() + shape("rectangle", transform(scale(20), rotate("x", -90)),
                         blend(number("weight", 0.35), diffuse(0.5, 0.5, 0.4), gold))
        + sphere(-1.3, 1, 0, 1, blend(weave, gold, matt))
        + sphere(1.1, 0.8, 0.6, 0.8, blend(number("weight", 0.4), clear, matt))
        + shape("disk", transform(scale(1.2), rotate("x", -60), translate(0.6, 2.9, -0.4)),
                blend(number("weight", 0.7), bsdf("twosided", matt), leaf))
        + sky(0.5, 0.6, 0.7) + lamp(4, 3.5, 3)
    )  # fmt: skip


def blend(weight: str, first: str, second: str) -> str:
    """Two bsdfs in one."""
    named = (
        part.replace("<bsdf ", f'<bsdf name="{name}" ', 1)
        for name, part in (("first", first), ("second", second))
    )
    return bsdf("blendbsdf", weight, *named)


@scene
def attributes() -> str:
    """Colours of vertices and faces of a mesh, with and without a scale, and one number of it."""
    file = text("filename", "meshes/painted.ply")

    def painted(name: str, of: str, *more: str) -> str:
        inner = text("name", name) + "".join(more)
        return f'<texture type="mesh_attribute" name="{of}">{inner}</texture>'

    def place(x: float, z: float, *steps: str) -> str:
        return transform(*steps, translate(x, 0.8, z))

    faces = painted("face_color", "reflectance", number("scale", 0.8))
    share = painted("vertex_share", "weight")
    return (
        sensor() + floor(0.5, 0.5, 0.4)
        + shape("ply", file, place(-1.6, 0.3, scale(0.8)),
                bsdf("diffuse", painted("vertex_color", "reflectance")))
        + shape("ply", file, flag("face_normals"),
                place(0, -0.6, scale(0.8), rotate("y", 70)), bsdf("diffuse", faces))
        + shape("ply", file, place(1.6, 0.5, scale(0.8), rotate("z", 50)),
                blend(share, diffuse(0.1, 0.2, 0.7), diffuse(0.8, 0.6, 0.1)))
        + sky(0.5, 0.6, 0.7) + lamp(4, 3.5, 3)
    )  # fmt: skip


def paint(content: str, vertices: Array, faces: Array) -> str:
    """A PLY file with colours of vertices and faces, and a number of vertices, by integers."""
    head, body = content.split("end_header\n")
    k = np.arange(len(vertices))
    shades = np.stack([20 + k * 7 % 80, 20 + k * 13 % 80, 20 + k * 29 % 80, k * 31 % 101])
    k = np.arange(len(faces))
    sides = np.stack([20 + k * 11 % 80, 20 + k * 17 % 80, 20 + k * 23 % 80])
    colour = "".join(f"property float {name}\n" for name in "rgb")
    share = "property float share_0\n"
    head = head.replace("element face", colour + share + "element face") + colour
    more = [" ".join(f"{x / 100:g}" for x in row) for row in (*shades.T, *sides.T)]
    rows = zip(body.splitlines(), more, strict=True)
    return head + "end_header\n" + "".join(f"{line} {new}\n" for line, new in rows)


def png(texels: npt.NDArray[np.uint8]) -> bytes:
    """A PNG file (H, W, 3), not compressed, so that every version of zlib makes the same."""

    def chunk(kind: bytes, data: bytes) -> bytes:
        body = kind + data
        return struct.pack(">I", len(data)) + body + struct.pack(">I", zlib.crc32(body))

    height, width, _ = texels.shape
    rows = b"".join(b"\0" + row.tobytes() for row in texels)
    stored = b"\x78\x01\x01" + struct.pack("<HH", len(rows), len(rows) ^ 0xFFFF) + rows
    return (
        b"\x89PNG\r\n\x1a\n"
        + chunk(b"IHDR", struct.pack(">IIBBBBB", width, height, 8, 2, 0, 0, 0))
        + chunk(b"IDAT", stored + struct.pack(">I", zlib.adler32(rows)))
        + chunk(b"IEND", b"")
    )


def weave() -> npt.NDArray[np.uint8]:
    """12 x 9 texels, different in all directions and channels, by integers."""
    y, x = np.mgrid[0:9, 0:12]
    red, green = 60 + 190 * ((x * 5 + y * 3) % 7) // 6, 60 + 190 * ((x * x + 2 * y) % 9) // 8
    return np.stack([red, green, 80 + 17 * ((x + y * y) % 11)], axis=-1).astype(np.uint8)


def dents() -> npt.NDArray[np.uint8]:
    """Normals at 10 x 7 texels, up to 45 degrees from z, by integers."""
    y, x = np.mgrid[0:7, 0:10]
    aside = 128 + 11 * ((x * 3 + y * 5) % 11) - 55, 128 + 13 * ((x * x + 3 * y) % 9) - 52
    return np.stack([*aside, 220 + (x + y) % 5], axis=-1).astype(np.uint8)


def sun() -> Array:
    """The texels of a sky, (9, 16, 3): brighter above, a sun in the first column, a dark corner."""
    height, turn = np.linspace(1, -1, 9)[:, None], np.arange(16) / 8
    blue = 0.3 + 0.13 * height * (1 + np.abs(1 - turn))
    texels = np.round(np.stack([0.6 * blue, 0.8 * blue, blue], axis=-1), 3)
    texels[3, 0] = 30, 25, 20
    texels[6:, 12:] = 0
    return texels


def xml(about: str, body: str, hides: str = "") -> str:
    """A scene file; hides: a parameter of its integrator."""
    defaults = {"spp": 64, "width": 64, "height": 64, "max_depth": 64, "rr_depth": 5}
    head = "".join(f'<default name="{k}" value="{v}"/>' for k, v in defaults.items())
    integrator = (
        '<integrator type="volpath"><integer name="max_depth" value="$max_depth"/>'
        f'<integer name="rr_depth" value="$rr_depth"/>{hides}</integrator>'
    )
    root = ET.fromstring(f'<scene version="3.0.0">{head}{integrator}{body}</scene>')
    ET.indent(root, "    ")
    comment = f"<!-- {about} Made by make.py. -->"
    content = ET.tostring(root, encoding="unicode").replace(" />", "/>")
    return f'<?xml version="1.0" encoding="utf-8"?>\n{comment}\n{content}\n'


README = """# Checks

Small bright scenes, each about one thing, in which every shape, material, medium, camera, light and
filter occurs. Mitsuba 3 reads the same files, except `rough_shadows` and `rough_whole`. `make.py`
makes them all, meshes, a sky and random spheres too (`--check` compares). Parameters: `spp`,
`width`, `height`, `max_depth`, `rr_depth`.

| scene | what it is about |
|---|---|
"""


def files() -> dict[str, str | bytes]:
    """Content by path."""
    ball, ball_faces = displaced(3, bumps)
    unit, _ = displaced(3, lambda d: d)
    body, body_faces = displaced(3, egg)
    result: dict[str, str | bytes] = {
        "images/weave.png": png(weave()),
        "volumes/colours.vol": vol(colours(), (-0.7, -0.8, -0.7), (0.7, 0.5, 0.8)),
        "volumes/smoke.vol": vol(puff(), (0, 0, 0), (1, 1, 1)),
        "volumes/flat.vol": vol(matrix_cells((1, 2, 0.5), 1, 0.25), (0, 0, 0), (1, 1, 1)),
        "volumes/needles.vol": vol(matrix_cells((1, -1, 2), 0.2, 0.9), (0, 0, 0), (1, 1, 1)),
        "meshes/zigzag.txt": ZIGZAG,
        "meshes/ring.vol": ring(),
        "meshes/hooks.txt": HOOKS,
        "meshes/bumps.ply": ply(ball, ball_faces, normals(lambda d: bumps(d, 0.13), unit)),
        "meshes/bumps.obj": obj(ball, ball_faces),
        "images/dents.png": png(dents()),
        "meshes/painted.ply": paint(ply(ball, ball_faces, unit), ball, ball_faces),
        "meshes/egg.ply": ply(body, body_faces, normals(egg, unit)),
        "meshes/bumps_egg.serialized": serialized(
            (ball, ball_faces, None), (body, body_faces, normals(egg, unit))
        ),
    }
    hides = {"hidden_light": flag("hide_emitters")}
    result |= {
        f"{name}.xml": xml(str(make.__doc__), make(), hides.get(name, ""))
        for name, make in SCENES.items()
    }
    rows = [f"| `{name}` | {str(make.__doc__)[:-1]} |\n" for name, make in SCENES.items()]
    result["README.md"] = README + "".join(rows)
    return result


def read_sky(path: Path) -> Array:
    """The texels of an EXR file."""
    with OpenEXR.File(str(path)) as file:
        return np.asarray(file.channels()["RGB"].pixels, np.float64)


def write_sky(path: Path, texels: Array) -> None:
    """An EXR file of half precision."""
    header = {"compression": OpenEXR.NO_COMPRESSION, "type": OpenEXR.scanlineimage}
    with OpenEXR.File(header, {"RGB": texels.astype(np.float16)}) as file:
        file.write(str(path))


def main() -> int:
    """Command line."""
    status = 0
    path, texels = HERE / "skies" / "sun.exr", sun()
    if "--check" in sys.argv[1:]:
        if not path.is_file() or (read_sky(path) != texels.astype(np.float16)).any():
            print("differs: skies/sun.exr")
            status = 1
    else:
        path.parent.mkdir(exist_ok=True)
        write_sky(path, texels)
    for name, content in files().items():
        path = HERE / name
        content = content.encode() if isinstance(content, str) else content
        if "--check" in sys.argv[1:]:
            if not path.is_file() or path.read_bytes() != content:
                print(f"differs: {name}")
                status = 1
        else:
            path.parent.mkdir(exist_ok=True)
            path.write_bytes(content)
    return status


if __name__ == "__main__":
    sys.exit(main())
