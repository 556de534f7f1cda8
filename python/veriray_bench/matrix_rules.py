"""The matrix's scenes, by class: rules that make a scene from a seed.

A rule draws geometry, colours and places anew for each seed; what makes its class stays. Rules of
one `group` draw alike, so that their scenes differ only in what their names say.
"""

from __future__ import annotations

import zlib
from collections.abc import Callable
from dataclasses import dataclass
from functools import partial
from pathlib import Path

import numpy as np

from . import matrix_xml as x
from .matrix_xml import Three

SEEDS = 3


class Draw:
    """What a rule draws from.

    rng: the numbers; large: whether the device takes big scenes; `file` names one beside the scene.
    """

    def __init__(self, group: str, seed: int, folder: Path, stem: str, large: bool) -> None:
        self.rng = np.random.default_rng([zlib.crc32(group.encode()), seed])
        self.folder, self.stem, self.large = folder, stem, large

    def between(self, low: float, high: float) -> float:
        """A number."""
        return float(self.rng.uniform(low, high))

    def colour(self, low: float = 0.2, high: float = 0.8) -> Three:
        """Three numbers."""
        r, g, b = self.rng.uniform(low, high, 3)
        return float(r), float(g), float(b)

    def around(self, at: Three, by: float) -> Three:
        """A place at most so far away along each axis."""
        px, py, pz = np.asarray(at) + self.rng.uniform(-by, by, 3)
        return float(px), float(py), float(pz)

    def file(self, suffix: str) -> Path:
        """A file of the scene's own."""
        return self.folder / f"{self.stem}{suffix}"


@dataclass(frozen=True)
class Rule:
    """A class of scenes. make(draw): sensor, shapes and lights as XML.

    integrator: Mitsuba's name; margin: relative difference of the pictures' means that is none.
    """

    name: str
    title: str
    make: Callable[[Draw], str]
    max_depth: int = 8
    rr_depth: int = 5
    integrator: str = "path"
    margin: float = 3e-4
    group: str = ""

    def write(self, seed: int, folder: Path, large: bool) -> Path:
        """The scene's file for a seed, with what it reads beside it."""
        stem = f"{self.name}-{seed}"
        draw = Draw(self.group or self.name, seed, folder, stem, large)
        path = folder / f"{stem}.xml"
        path.write_text(x.scene(self.make(draw), self.integrator), "utf-8")
        return path


# ---- surfaces: (a draw, a colour) -> bsdf ----

Surface = Callable[[Draw, Three], str]


def _diffuse(d: Draw, colour: Three) -> str:
    return x.diffuse(colour)


def _board(d: Draw, colour: Three) -> str:
    return x.plugin("bsdf", "diffuse", x.board("reflectance", colour, (0.5, 0.5, 0.5), 4))


def _bitmap(d: Draw, colour: Three) -> str:
    path = d.file(".png")
    if not path.exists():
        x.write_noise(path, np.random.default_rng(d.rng.integers(2**32)), 1024)
    return x.plugin("bsdf", "diffuse", x.bitmap("reflectance", path.name))


def _rough_metal(d: Draw, colour: Three) -> str:
    # reflectance as drawn: the sheet of a mirror is tinted
    return x.plugin(
        "bsdf", "roughconductor", x.string("material", "none"), x.string("distribution", "ggx"),
        x.number("alpha", 0.15 + 0.3 * colour[0]), x.rgb("specular_reflectance", *colour),
    )  # fmt: skip


def _rough_plastic(d: Draw, colour: Three) -> str:
    return x.plugin(
        "bsdf", "roughplastic", x.string("distribution", "ggx"),
        x.number("alpha", 0.05 + 0.3 * colour[1]), x.rgb("diffuse_reflectance", *colour),
    )  # fmt: skip


def _rough_glass(d: Draw, colour: Three) -> str:
    return x.plugin(
        "bsdf", "roughdielectric", x.string("distribution", "ggx"),
        x.number("alpha", 0.1 + 0.2 * colour[0]), x.number("int_ior", 1.3 + 0.3 * colour[1]),
        x.number("ext_ior", 1),
    )  # fmt: skip


def _plastic(d: Draw, colour: Three) -> str:
    return x.plugin("bsdf", "plastic", x.rgb("diffuse_reflectance", *colour))


def _principled(d: Draw, colour: Three) -> str:
    return x.plugin(
        "bsdf", "principled", x.rgb("base_color", *colour), x.number("roughness", colour[1]),
        x.number("metallic", colour[2]), x.number("specular", 0.5), x.number("clearcoat", 0.5),
        x.number("sheen", 0.3),
    )  # fmt: skip


def _mirror(d: Draw, colour: Three) -> str:
    return x.plugin("bsdf", "conductor", x.string("material", "none"),
                    x.rgb("specular_reflectance", *(0.6 + c / 2 for c in colour)))  # fmt: skip


def _glass(d: Draw, colour: Three) -> str:
    return x.plugin("bsdf", "dielectric", x.number("int_ior", 1.3 + 0.3 * colour[0]),
                    x.number("ext_ior", 1))  # fmt: skip


def _thin(d: Draw, colour: Three) -> str:
    return x.plugin("bsdf", "thindielectric", x.number("int_ior", 1.3 + 0.3 * colour[0]),
                    x.number("ext_ior", 1))  # fmt: skip


def _blend(d: Draw, colour: Three) -> str:
    # by turns: rough metal of little roughness, plastic
    second = _plastic(d, colour)
    if d.rng.random() < 0.5:
        second = x.plugin(
            "bsdf", "roughconductor", x.string("material", "none"), x.string("distribution", "ggx"),
            x.number("alpha", 0.05 + 0.2 * colour[0]), x.rgb("specular_reflectance", *colour),
        )  # fmt: skip
    return x.plugin("bsdf", "blendbsdf", x.number("weight", d.between(0.3, 0.7)),
                    x.diffuse(d.colour(0.05, 0.9)), second)  # fmt: skip


# ---- places ----


def _room(d: Draw, walls: Surface = _diffuse, things: Surface | None = None,
          shapes: str = "boxes", high: float = 0.8) -> str:  # fmt: skip
    """Five walls, a lamp under the ceiling, and boxes or balls on the floor."""
    things = things or walls
    w, h, e = d.between(0.9, 1.4), d.between(0.8, 1.2), d.between(0.9, 1.4)
    places = (
        ((w, e), (x.turn("x", -90), x.move(0, -h, 0))),
        ((w, e), (x.turn("x", 90), x.move(0, h, 0))),
        ((w, h), (x.move(0, 0, -e),)),
        ((e, h), (x.turn("y", 90), x.move(-w, 0, 0))),
        ((e, h), (x.turn("y", -90), x.move(w, 0, 0))),
    )
    parts = [x.camera(d.around((0, 0, e + 2.6), 0.1), d.around((0, 0, 0), 0.1), 38)]
    parts += [x.rectangle(*place, walls(d, d.colour(0.3, high))) for place in places]
    parts += [x.lamp((0.3 * w, 0.25 * e), (d.between(-0.3, 0.3) * w, 0.98 * h, 0),
                     d.colour(8, 12))]  # fmt: skip
    for k in range(int(d.rng.integers(2, 5))):
        size, degrees = d.between(0.12, 0.3), d.between(0, 90)
        at_x, at_z = (-0.6 + 0.4 * k) * w, d.between(-0.5, 0.5) * e
        tall, colour = size * d.between(0.8, 1.8), d.colour(0.3, high)
        if shapes == "boxes":
            parts.append(x.box((size, tall, size), degrees, (at_x, tall - h, at_z),
                               things(d, colour)))  # fmt: skip
        else:
            parts.append(x.ball((at_x, 1.01 * size - h, at_z), size, things(d, colour)))
    return "".join(parts)


def _few_spheres(d: Draw) -> str:
    """Matt, mirroring and glass balls in a room."""
    turns = iter((_mirror, _glass, _diffuse, _mirror))
    return _room(d, _diffuse, lambda e, colour: next(turns)(e, colour), "balls")


def _stage(d: Draw, things: str, light: str = "lamp") -> str:
    """Things on a floor of half size 6, under a lamp, a sky or both; seen from in front."""
    parts = [x.camera(d.around((0, 2, 5.5), 0.4), d.around((0, 0.9, 0), 0.1), 35),
             x.floor(6, x.diffuse(d.colour(0.3, 0.7)))]  # fmt: skip
    place = d.around((0, 5, 1), 0.8)
    radiance, above = d.colour(9, 14), d.colour(0.5, 1)
    if "lamp" in light:
        parts.append(x.lamp((1.2, 0.9), place, radiance))
    if "sky" in light:
        parts.append(x.sky(above))
    return "".join([*parts, things])


def _blob(d: Draw, surface: Surface, smooth: bool = False, level: int = 5, bumps: float = 0.2,
          uv: bool = False, inside: str = "") -> str:  # fmt: skip
    """A mesh of 20 * 4^level triangles on the floor."""
    path = d.file(".ply")
    x.write_blob(path, d.rng, level, bumps, uv)
    return x.mesh(path.name, smooth, x.to_world(x.turn("y", d.between(0, 90)), x.move(0, 1.25, 0)),
                  surface(d, d.colour()), inside)  # fmt: skip


def _mesh(d: Draw, surface: Surface = _diffuse, light: str = "lamp", **how: object) -> str:
    return _stage(d, _blob(d, surface, **how), light)  # type: ignore[arg-type]


def _large_mesh(d: Draw) -> str:
    return _mesh(d, level=8 if d.large else 6)


def _mesh_under_image(d: Draw) -> str:
    """A mesh under an image of 4096 x 2048 texels, or 1024 x 512."""
    path = d.file(".pfm")
    x.write_sky(path, d.rng, 4096 if d.large else 1024)
    return _mesh(d, light="", smooth=True) + x.image_sky(path.name)


def _some_boxes(d: Draw, count: int = 4, spread: float = 1.6) -> str:
    parts = []
    for _ in range(count):
        half = d.between(0.2, 0.45)
        tall = half * d.between(0.7, 2.2)
        at = (d.between(-spread, spread), tall, d.between(-spread, spread))
        parts.append(x.box((half, tall, half), d.between(0, 90), at, x.diffuse(d.colour())))
    return "".join(parts)


def _objects(d: Draw, light: str) -> str:
    return _stage(d, _some_boxes(d), light)


def _image_sky(d: Draw) -> str:
    path = d.file(".pfm")
    x.write_sky(path, d.rng, 1024)
    return _stage(d, _some_boxes(d), "") + x.image_sky(path.name)


def _interior(d: Draw) -> str:
    """A closed room with six meshes of several materials, lit by an image through a window."""
    w, h, e, half = d.between(1.6, 2.2), d.between(1.2, 1.5), d.between(1.8, 2.4), 0.6
    right = x.turn("y", -90)
    aside, above = (e - half) / 2, (h - half) / 2
    places = (
        ((w, e), (x.turn("x", 90), x.move(0, h, 0))),
        ((w, h), (x.move(0, 0, -e),)),
        ((w, h), (x.turn("y", 180), x.move(0, 0, e))),
        ((e, h), (x.turn("y", 90), x.move(-w, 0, 0))),
        ((aside, h), (right, x.move(w, 0, -half - aside))),
        ((aside, h), (right, x.move(w, 0, half + aside))),
        ((half, above), (right, x.move(w, half + above, 0))),
        ((half, above), (right, x.move(w, -half - above, 0))),
    )
    parts = [x.camera((-0.8 * w, 0.2 * h, 0.85 * e), d.around((0.2 * w, -0.4 * h, 0), 0.1), 65)]
    parts += [x.rectangle(*place, x.diffuse(d.colour(0.5, 0.8))) for place in places]
    parts.append(x.rectangle((w, e), (x.turn("x", -90), x.move(0, -h, 0)), _board(d, d.colour())))
    surfaces = (_rough_plastic, _rough_metal, _bitmap, _plastic, _diffuse, _rough_plastic)
    for k, surface in enumerate(surfaces):
        path = d.file(f"-{k}.ply")
        x.write_blob(path, d.rng, 4, 0.2, True)
        size = d.between(0.25, 0.4)
        at = ((-0.5 + 0.5 * (k % 3)) * w, 1.2 * size - h, (-0.5 + 0.6 * (k // 3)) * e)
        place = x.to_world(x.scale(size), x.turn("y", d.between(0, 90)), x.move(*at))
        parts.append(x.mesh(path.name, True, place, surface(d, d.colour(0.3, 0.8))))
    path = d.file(".pfm")
    x.write_sky(path, d.rng, 1024)
    return "".join(parts) + x.image_sky(path.name)


def _many_spheres(d: Draw) -> str:
    parts = []
    for k in range(400):
        radius = d.between(0.05, 0.14)
        at = (d.between(-2.2, 2.2), radius * d.between(1.01, 5), d.between(-3, 1.6))
        surface = _mirror if k % 10 == 0 else _diffuse
        parts.append(x.ball(at, radius, surface(d, d.colour())))
    return _stage(d, "".join(parts), "lamp and sky")


def _bulb_alone(d: Draw) -> str:
    at = d.around((0, 3, 1), 0.5)
    return _stage(d, _some_boxes(d) + x.bulb(at, 0.15, d.colour(150, 250)), "")


def _three_deltas(d: Draw) -> str:
    """A point light, a spot and a sun over a wide floor."""
    away = d.around((0.4, -1, -0.3), 0.2)
    lights = (
        x.plugin("emitter", "point", x.point("position", d.around((-1.5, 2.5, 1), 0.4)),
                 x.rgb("intensity", *d.colour(6, 12)))
        + x.plugin("emitter", "spot", x.to_world(x.look(d.around((2, 4, 1.5), 0.4),
                                                        d.around((0.5, 0, 0), 0.4))),
                   x.rgb("intensity", *d.colour(30, 60)), x.number("cutoff_angle", 25),
                   x.number("beam_width", 18))
        + x.plugin("emitter", "directional",
                   f'<vector name="direction" value="{x.text(*away)}"/>',
                   x.rgb("irradiance", *d.colour(0.3, 0.8)))
    )  # fmt: skip
    ground = x.floor(200, x.diffuse(d.colour(0.3, 0.7)))
    return (x.camera(d.around((0, 3.5, 9), 0.4), d.around((0, 0.6, 0), 0.1), 40) + ground
            + _some_boxes(d, 6, 2.2) + lights)  # fmt: skip


def _lamps(d: Draw, count: int) -> str:
    """Spheres that shine, over a field that grows with their number, with boxes between them."""
    half = 0.45 * count**0.5
    parts = [x.camera((0, 0.5 * half + 1, 1.25 * half + 1), (0, 0, 0), 45),
             x.floor(1.3 * half, x.diffuse(d.colour(0.3, 0.7)))]  # fmt: skip
    places = d.rng.uniform((-half, 0.3, -half), (half, 1.5, half), (count, 3))
    radiance = d.rng.uniform(5, 40, (count, 1)) * d.rng.uniform(0.4, 1, (count, 3))
    for (px, py, pz), (r, g, b) in zip(places.tolist(), radiance.tolist(), strict=True):
        parts.append(x.bulb((px, py, pz), 0.05, (r, g, b)))
    return "".join([*parts, _some_boxes(d, 12, 0.8 * half)])


def _lens(d: Draw) -> str:
    eye = d.around((0, 2, 5.5), 0.4)
    lens = (x.number("aperture_radius", d.between(0.1, 0.2)),
            x.number("focus_distance", d.between(4.5, 6)))  # fmt: skip
    scene = _objects(d, "lamp and sky")
    return (x.camera(eye, d.around((0, 0.9, 0), 0.1), 35, *lens, kind="thinlens")
            + scene[scene.index("</sensor>") + len("</sensor>"):])  # fmt: skip


def _pane(d: Draw, thick: bool) -> str:
    """A pane between the camera and boxes."""
    size, degrees, z = (d.between(1.2, 1.6), d.between(1.2, 1.6)), d.between(-20, 20), 2.4
    colour = d.colour()
    pane = (
        x.box((*size, 0.04), degrees, (0, size[1] + 0.05, z), _glass(d, colour))
        if thick
        else x.rectangle(size, (x.turn("y", degrees), x.move(0, size[1] + 0.05, z)),
                         _thin(d, colour))
    )  # fmt: skip
    return _stage(d, _some_boxes(d) + pane, "lamp and sky")


def _masks(d: Draw) -> str:
    sheets = ""
    for k in range(4):
        steps = (x.turn("y", d.between(-40, 40)), x.move(-1.5 + k, 0.9, d.between(0, 1.5)))
        inner = x.plugin("bsdf", "twosided", x.diffuse(d.colour()))
        mask = x.plugin("bsdf", "mask", x.number("opacity", d.between(0.3, 0.8)), inner)
        sheets += x.rectangle((0.45, 0.8), steps, mask)
    return _stage(d, _some_boxes(d) + sheets, "lamp and sky")


# ---- media ----


def _medium(sigma_t: Three, albedo: Three, g: float) -> str:
    phase = x.plugin("phase", "hg", x.number("g", g)) if g else x.plugin("phase", "isotropic")
    most = max(sigma_t)  # Mitsuba takes colours up to 1
    return x.plugin(
        "medium", "homogeneous", x.rgb("sigma_t", *(s / most for s in sigma_t)),
        x.number("scale", most), x.rgb("albedo", *albedo), phase, name="interior",
    )  # fmt: skip


def _fog(d: Draw, sigma: tuple[float, float], chromatic: bool) -> str:
    """Boxes in a box of fog without a surface."""
    s = d.between(*sigma)
    sigma_t = tuple(s * d.between(0.5, 1.5) for _ in "rgb") if chromatic else (s, s, s)
    inside = _medium(sigma_t, d.colour(0.7, 0.95), d.between(0.1, 0.6))  # type: ignore[arg-type]
    bound = x.plugin("bsdf", "null")
    return _stage(d, _some_boxes(d) + x.box((2.4, 1.5, 2.4), 0, (0, 1.51, 0), bound, inside),
                  "lamp and sky")  # fmt: skip


def _cloud(d: Draw) -> str:
    """A dense ball without a surface."""
    s = d.between(6, 12)
    inside = _medium((s, s, s), d.colour(0.85, 0.97), d.between(0.3, 0.8))
    bulk = x.ball((0, 1.1, 0), 1, x.plugin("bsdf", "null"), inside)
    return _stage(d, bulk, "lamp and sky")


def _in_mesh(d: Draw) -> str:
    s = d.between(1, 3)
    inside = _medium((s, s, s), d.colour(0.6, 0.95), 0)
    return _mesh(d, _glass, "lamp and sky", inside=inside, bumps=0.1)


def _subsurface(d: Draw) -> str:
    s = d.between(12, 20)
    inside = _medium((s, s, s), d.colour(0.85, 0.97), 0)
    return _stage(d, x.ball((0, 1.1, 0), 1, _glass(d, d.colour(0, 0.3)), inside), "lamp and sky")


# ---- far away ----


def _far(d: Draw, shift: float, away: float) -> str:
    """A scene of some 100 units, `shift` from the origin in x and z, seen from 30 `away` units.

    Mitsuba cuts what is farther than 10,000 units.
    """
    grow = 30.0
    eye = np.asarray(d.around((0, 2, 5.5), 0.4))
    eye *= away / np.linalg.norm(eye)
    near = np.asarray((shift, 0, shift))
    fov = float(np.degrees(2 * np.arctan(2.0 / away)))
    at = [tuple(grow * p + near) for p in (eye, np.asarray((0, 0.8, 0)))]
    parts = [x.camera(at[0], at[1], fov),
             x.rectangle((6, 6), (x.turn("x", -90), x.scale(grow), x.move(*near)),
                         x.diffuse(d.colour(0.3, 0.7)))]  # fmt: skip
    for _ in range(5):
        half = d.between(0.2, 0.45)
        where = np.asarray((d.between(-1.6, 1.6), half, d.between(-1.6, 1.6))) * grow + near
        parts.append(x.box((half * grow,) * 3, d.between(0, 90), tuple(where),
                           x.diffuse(d.colour())))  # fmt: skip
    top = np.asarray(d.around((0, 5, 1), 0.8)) * grow + near
    parts.append(x.lamp((1.2 * grow, 0.9 * grow), tuple(top), d.colour(9, 14)))
    return "".join([*parts, x.sky(d.colour(0.5, 1))])


RULES: tuple[Rule, ...] = (
    Rule("room", "flat room with boxes", _room, group="room"),
    Rule("room-textured", "flat room with boxes, checkerboards on all",
         partial(_room, walls=_board), group="room"),
    Rule("room-rough", "flat room with boxes, all of rough plastic",
         partial(_room, walls=_rough_plastic), group="room"),
    Rule("room-plastic", "flat room with boxes, all of plastic",
         partial(_room, walls=_plastic), group="room"),
    Rule("deep", "white room, paths of up to 64 segments", partial(_room, high=0.95),
         max_depth=64, rr_depth=32),
    Rule("open", "boxes under a sky of one colour", partial(_objects, light="sky")),
    Rule("mesh-flat", "mesh of 20,480 flat triangles under a lamp", _mesh, group="mesh"),
    Rule("mesh-smooth", "smooth mesh of 20,480 triangles under a lamp",
         partial(_mesh, smooth=True), group="mesh"),
    Rule("mesh-mirror", "the smooth mesh, a mirror, under a lamp and a sky",
         partial(_mesh, surface=_mirror, smooth=True, light="lamp and sky"), group="mesh"),
    Rule("mesh-glass", "flat mesh of glass, 20,480 triangles",
         partial(_mesh, surface=_glass, light="lamp and sky", bumps=0.1), group="mesh"),
    Rule("mesh-textured", "the smooth mesh with a bitmap",
         partial(_mesh, surface=_bitmap, smooth=True, uv=True), group="mesh"),
    Rule("mesh-rough", "the smooth mesh of rough metal",
         partial(_mesh, surface=_rough_metal, smooth=True), group="mesh"),
    Rule("mesh-plastic", "the smooth mesh of plastic, under a lamp and a sky",
         partial(_mesh, surface=_plastic, smooth=True, light="lamp and sky"), group="mesh"),
    Rule("mesh-large", "mesh of 1,310,720 triangles (CPU: 81,920)", _large_mesh),
    Rule("mesh-image-sky", "smooth mesh under an image of 4096 x 2048 texels (CPU: 1024 x 512)",
         _mesh_under_image),
    Rule("interior", "room of meshes of several materials, lit by an image through a window",
         _interior),
    Rule("spheres-few", "matt, mirroring and glass balls in a room", _few_spheres),
    Rule("spheres-many", "400 balls on a floor", _many_spheres),
    Rule("lamp-ball", "boxes under one small ball that shines", _bulb_alone),
    Rule("lamps-delta", "point, spot and sun over a wide floor", _three_deltas),
    Rule("lamps-100", "100 shining balls over a field", partial(_lamps, count=100)),
    Rule("lamps-10000", "10,000 shining balls over a field", partial(_lamps, count=10000)),
    Rule("sky-and-lamp", "boxes under a lamp and a sky of one colour",
         partial(_objects, light="lamp and sky")),
    Rule("sky-image", "boxes under an image with a sun", _image_sky),
    Rule("lens", "boxes through a thin lens", _lens),
    Rule("pane-thin", "boxes behind a pane of thin glass", partial(_pane, thick=False)),
    Rule("pane-thick", "boxes behind a pane of glass", partial(_pane, thick=True)),
    Rule("mask", "boxes behind sheets with holes", _masks),
    Rule("rough-metal", "balls of rough metal in a room",
         partial(_room, things=_rough_metal, shapes="balls"), group="balls"),
    Rule("rough-plastic", "balls of rough plastic in a room",
         partial(_room, things=_rough_plastic, shapes="balls"), group="balls"),
    Rule("rough-glass", "balls of rough glass in a room",
         partial(_room, things=_rough_glass, shapes="balls"), group="balls"),
    Rule("plastic", "balls of plastic in a room",
         partial(_room, things=_plastic, shapes="balls"), group="balls"),
    Rule("principled", "principled balls in a room",
         partial(_room, things=_principled, shapes="balls"), group="balls"),
    Rule("blend", "boxes of matt surfaces blended with rough metal or plastic in a room",
         partial(_room, things=_blend)),
    Rule("fog-thin", "boxes in thin fog", partial(_fog, sigma=(0.1, 0.3), chromatic=False),
         integrator="volpath", max_depth=32),
    Rule("fog-dense", "a dense cloud", _cloud, integrator="volpath", max_depth=64, rr_depth=16),
    Rule("fog-chromatic", "boxes in fog whose density depends on colour",
         partial(_fog, sigma=(0.3, 0.6), chromatic=True), integrator="volpath", max_depth=32),
    Rule("medium-mesh", "mesh of glass with a thin medium inside", _in_mesh, integrator="volpath",
         max_depth=32, rr_depth=16),
    Rule("subsurface", "glass ball with a dense medium inside", _subsurface, integrator="volpath",
         max_depth=128, rr_depth=32),
    Rule("far-camera", "boxes from 7,500 units away", partial(_far, shift=0, away=250)),
    Rule("far-origin", "boxes 10,000 units from the origin", partial(_far, shift=1e4, away=6)),
)  # fmt: skip
