"""What the pictures of the scene reference show: stages, and values of parameters on them."""

from __future__ import annotations

import copy
import functools
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np

from veriray.columns import SHADOWINGS
from veriray.formats.plugins import PLUGINS
from veriray.transform import compose, look_at, translate
from veriray.transform import rotate as turn
from veriray.transform import scale as stretch

Dict = dict[str, Any]


@dataclass(frozen=True)
class Look:
    """Pictures side by side: `values` are (label, what `base`, a stage, is given)."""

    base: str
    values: list[tuple[str, Any]]
    exposure: float = 1.0
    spp: int = 0
    size: tuple[int, int] | None = None
    own_size: bool = False  # the scene's film says how large


def scale(factor: Any) -> Any:
    """Scaling, alike or by axis."""
    return stretch([factor] * 3 if isinstance(factor, (int, float)) else factor)


def move(*by: float) -> Any:
    """Translation."""
    return translate(by)


def rgb(*value: float) -> Dict:
    """A colour."""
    return {"type": "rgb", "value": list(value)}


def at(*steps: Any) -> Any:
    """Transforms one after another."""
    return functools.reduce(lambda a, b: compose(b, a), steps)


def matt(*value: float) -> Dict:
    """A diffuse material."""
    return {"type": "diffuse", "reflectance": rgb(*value)}


CHECKS = {
    "type": "checkerboard", "color0": rgb(0.6, 0.6, 0.6), "color1": rgb(0.25, 0.27, 0.3),
    "to_uv": scale(6),
}  # fmt: skip
GROUND = {
    "type": "rectangle",
    "to_world": at(scale(8), turn((1, 0, 0), -90)),
    "bsdf": {"type": "diffuse", "reflectance": CHECKS},
}
LAMP = {
    "type": "rectangle",
    "to_world": at(scale(1.4), look_at((-3, 5, 3), (0, 1, 0), (0, 1, 0))),
    "emitter": {"type": "area", "radiance": rgb(11, 10.4, 9.6)},
}
SKY = {"type": "constant", "radiance": rgb(0.35, 0.4, 0.48)}
WALL = {
    "type": "rectangle",
    "to_world": at(scale(8), move(0, 0, -5)),
    "bsdf": matt(0.35, 0.16, 0.1),
}
EYE = {"origin": (0, 2.2, 5.4), "target": (0, 0.92, 0)}


def camera(**more: Any) -> Dict:
    """The usual camera."""
    view = look_at(EYE["origin"], EYE["target"], (0, 1, 0))
    film = {"type": "hdrfilm", "width": 64, "height": 64, "rfilter": {"type": "box"}}
    return {"type": "perspective", "fov": 30.0, "to_world": view, "film": film, **more}


def stage(**objects: Any) -> Dict:
    """A ground, a wall, a lamp, a sky and a camera, with what is given in their places."""
    usual = {
        "type": "scene",
        "integrator": {"type": "volpath", "max_depth": 32},
        "camera": camera(),
        "ground": GROUND,
        "wall": WALL,
        "lamp": LAMP,
        "sky": SKY,
    }
    return {k: v for k, v in {**usual, **objects}.items() if v is not None}


def ball(**more: Any) -> Dict:
    """The usual ball."""
    return {"type": "sphere", "center": (0, 1, 0), "radius": 1.0, **more}


def of_material(bsdf: Dict) -> Dict:
    """A ball of a material."""
    return stage(ball=ball(bsdf=bsdf))


def of_sheet(bsdf: Dict) -> Dict:
    """A sheet of a material before a ball."""
    place = at(scale(0.95), turn((0, 1, 0), 25), move(-0.2, 1, 0.8))
    sheet = {"type": "rectangle", "to_world": place, "bsdf": bsdf}
    return stage(
        sheet=sheet, ball=ball(center=(0.5, 0.6, -0.8), radius=0.6, bsdf=matt(0.1, 0.35, 0.6))
    )


def of_shape(shape: Dict) -> Dict:
    """A shape of rather matt plastic."""
    coat = {"type": "roughplastic", "alpha": 0.15, "diffuse_reflectance": rgb(0.75, 0.35, 0.1)}
    if shape["type"] in ("shapegroup", "merge", "instance", "scene"):
        return stage(**shape["objects"])
    return stage(shape={"bsdf": {"type": "twosided", "inner": coat}, **shape})


def of_texture(texture: Dict) -> Dict:
    """A sheet with a texture."""
    place = at(scale(1.15), move(0, 1.15, 0))
    paper = {"type": "twosided", "inner": {"type": "diffuse", "reflectance": texture}}
    if "mesh" in texture:
        return stage(sheet={**texture["mesh"], "to_world": place})
    return stage(sheet={"type": "rectangle", "to_world": place, "bsdf": paper})


def of_light(light: Dict) -> Dict:
    """Two balls under one light."""
    lights = {"lamp": None, "sky": None}
    key = "lamp" if light["type"] == "rectangle" else "sky"
    return stage(
        **{**lights, key: light},
        ball=ball(center=(-0.75, 0.7, 0), radius=0.7, bsdf=matt(0.6, 0.6, 0.6)),
        mirror=ball(center=(0.8, 0.7, 0), radius=0.7,
                    bsdf={"type": "roughconductor", "material": "Al", "alpha": 0.05}),
        wall=None if light["type"] in ("envmap", "sunsky", "constant") else WALL,
    )  # fmt: skip


def of_medium(medium: Dict) -> Dict:
    """A body of a medium with invisible surfaces; a cube, where the medium is uneven."""
    if medium["type"] == "heterogeneous":
        cube = {"type": "cube", "to_world": at(scale(0.95), move(0, 1, 0)),
                "bsdf": {"type": "null"}, "interior": medium}  # fmt: skip
        return stage(body=cube)
    return stage(ball=ball(bsdf={"type": "null"}, interior=medium))


def of_camera(sensor: Dict) -> Dict:
    """Three balls in a row."""
    film = sensor.pop("film", camera()["film"])
    sensor = {"to_world": camera()["to_world"], "film": film, **sensor}
    if sensor.get("to_world") is None:
        del sensor["to_world"]
    colours = ((0.7, 0.2, 0.1), (0.2, 0.55, 0.2), (0.1, 0.25, 0.7))
    row = {
        f"ball{k}": ball(center=(0.9 * (k - 1), 0.5, 1.6 - 1.6 * k), radius=0.5, bsdf=matt(*c))
        for k, c in enumerate(colours)
    }
    return stage(camera=sensor, **row)


def of_filter(rfilter: Dict) -> Dict:
    """Few pixels, shown large."""
    film = {"type": "hdrfilm", "width": 28, "height": 28, "rfilter": rfilter}
    return stage(camera=camera(film=film), ball=ball(bsdf=matt(0.7, 0.3, 0.1)))


def of_integrator(integrator: Dict) -> Dict:
    """A glass ball, a matt one and a lamp that the camera sees."""
    seen = at(scale(0.5), look_at((0.9, 2.2, -1), (0, 0, 1), (0, 1, 0)))
    return stage(
        integrator=integrator,
        glass=ball(center=(-0.75, 0.7, 0), radius=0.7, bsdf={"type": "dielectric"}),
        ball=ball(center=(0.8, 0.7, 0), radius=0.7, bsdf=matt(0.6, 0.6, 0.6)),
        lamp={"type": "rectangle", "to_world": seen, "emitter": {"type": "area", "radiance": 12.0}},
        wall=None,
    )


def of_sampler(sampler: Dict) -> Dict:
    """Noise at few samples."""
    count = sampler.get("sample_count", 4)
    return {
        **of_material(matt(0.6, 0.6, 0.6)),
        "camera": camera(sampler={**sampler, "sample_count": count}),
    }


STAGES: dict[str, Callable[[Any], Dict]] = {
    name.removeprefix("of_"): function
    for name, function in globals().items()
    if name.startswith("of_")
}


def scene_of(base: str, change: Any) -> Dict:
    """The scene of a stage."""
    return STAGES[base](copy.deepcopy(change))


# ---- which values ----

LOOKS: dict[tuple[str, str], Look] = {}
#: (object, parameter) -> why it has no picture; "" or "*" stand for any.
PLAIN: dict[tuple[str, str], str] = {
    ("bitmap", "channel"): "one channel of the image, of files of Mitsuba 0.x",
    ("bitmap", "gain"): "a factor on the texels, of files of Mitsuba 0.x",
    ("bitmap", "scale"): "a factor on the texels, of files of Mitsuba 0.x",
    ("constvolume", "color"): "its number, under the name of Mitsuba 2",
    ("mesh", "disable_vertex_normals"): "`face_normals`, under the name of Mitsuba 2",
    ("mesh_attribute", "bytes"): "how a file of Mitsuba 0.x keeps colours",
    ("mesh_attribute", "gain"): "a factor on the numbers, of files of Mitsuba 0.x",
    ("obj", "load_materials"): "without effect, of files of Mitsuba 0.x",
    ("ply", "srgb"): "how a file of Mitsuba 0.x keeps colours",
    ("gridvolume", "at_corners"): "how a file of Mitsuba 0.x places cells",
    ("checkerboard", "in_order"): "how a file of Mitsuba 0.x orders colours",
    ("specfilm", "*"): "as of `hdrfilm`",
    ("sunsky", "y_is_east"): "the directions of files of Mitsuba 0.x",
}

_COLOURS = [("grey 0.2", 0.2), ("0.8", 0.8), ("rgb 0.8, 0.3, 0.1", rgb(0.8, 0.3, 0.1))]
_SLOPES = [("0.05", 0.05), ("0.2", 0.2), ("0.5", 0.5)]
_SHARES = [("0", 0.0), ("0.5", 0.5), ("1", 1.0)]
_SWITCH = [("false", False), ("true", True)]
_INDICES = [("1.1", 1.1), ("bk7", "bk7"), ("diamond", "diamond")]
#: Values of a parameter of materials, whatever the material.
_MATERIAL: dict[str, list[tuple[str, Any]]] = {
    **dict.fromkeys(("reflectance", "diffuse_reflectance", "specular_reflectance", "base_color",
                     "specular_transmittance", "transmittance"), _COLOURS),
    **dict.fromkeys(("alpha", "roughness"), _SLOPES),
    **dict.fromkeys(("metallic", "spec_trans", "spec_tint", "sheen", "sheen_tint", "flatness",
                     "clearcoat", "clearcoat_gloss", "anisotropic", "specular", "opacity"),
                    _SHARES),
    "int_ior": _INDICES,
    "ext_ior": [("air", "air"), ("water", "water"), ("1.45", 1.45)],
    "material": [("none", "none"), ("Au", "Au"), ("Cu", "Cu")],
    "eta": [("0.2", 0.2), ("1.5", 1.5), ("3", 3.0)],
    "k": [("1", 1.0), ("3", 3.0), ("rgb 4, 2.5, 2", rgb(4, 2.5, 2))],
    "ext_eta": [("1", 1.0), ("1.33", 1.33), ("2", 2.0)],
    "distribution": [("beckmann", "beckmann"), ("ggx", "ggx")],
    "shadowing": [(name, name) for name in SHADOWINGS],
    "energy_compensation": _SWITCH,
    "nonlinear": _SWITCH,
    "alpha_u": [("0.02", (0.02, 0.3)), ("0.1", (0.1, 0.3)), ("0.3", (0.3, 0.3))],
    "alpha_v": [("0.02", (0.3, 0.02)), ("0.1", (0.3, 0.1)), ("0.3", (0.3, 0.3))],
    "diff_trans": [("0", 0.0), ("1", 1.0), ("2", 2.0)],
}  # fmt: skip
#: What else a material has, so that the parameter shows.
_WITH: dict[tuple[str, str], Dict] = {
    ("principled", "spec_tint"): {
        "base_color": rgb(0.8, 0.2, 0.1),
        "roughness": 0.2,
        "specular": 1.0,
    },
    ("principled", "sheen"): {"base_color": rgb(0.3, 0.05, 0.05), "roughness": 0.9},
    ("principled", "sheen_tint"): {
        "base_color": rgb(0.5, 0.05, 0.05),
        "roughness": 0.9,
        "sheen": 1.0,
    },
    ("principled", "clearcoat"): {"base_color": rgb(0.4, 0.05, 0.05), "roughness": 0.8},
    ("principled", "clearcoat_gloss"): {"base_color": rgb(0.4, 0.05, 0.05), "clearcoat": 1.0},
    ("principled", "metallic"): {"base_color": rgb(0.8, 0.5, 0.2), "roughness": 0.25},
    ("principled", "anisotropic"): {
        "base_color": rgb(0.8, 0.5, 0.2),
        "roughness": 0.5,
        "metallic": 1.0,
    },
    ("principled", "eta"): {"base_color": rgb(0.9, 0.9, 0.9), "spec_trans": 1.0, "roughness": 0.1},
    ("principled", "spec_trans"): {"base_color": rgb(0.9, 0.7, 0.4), "roughness": 0.1},
    ("principled", "specular"): {"base_color": rgb(0.3, 0.05, 0.05), "roughness": 0.2},
    ("plastic", "nonlinear"): {"diffuse_reflectance": rgb(0.8, 0.4, 0.15)},
    ("roughplastic", "nonlinear"): {"diffuse_reflectance": rgb(0.8, 0.4, 0.15)},
    **{
        (name, key): {"alpha": 1.0, "distribution": "ggx"}
        for name in ("roughconductor", "roughdielectric", "roughplastic")
        for key in ("shadowing", "energy_compensation")
    },
    ("conductor", "eta"): {"k": 1.0},
    ("conductor", "k"): {"eta": 0.5},
    ("roughconductor", "eta"): {"k": 1.0},
    ("roughconductor", "k"): {"eta": 0.5},
    ("conductor", "ext_eta"): {"material": "Au"},
    ("roughconductor", "ext_eta"): {"material": "Au"},
}
_METAL = {"roughconductor": {"material": "Al", "alpha": 0.2}}
_SHEETS = ("thindielectric", "principledthin", "polarizer", "circular", "retarder", "mask")


def _materials() -> None:
    for name, plugin in PLUGINS.items():
        if plugin.category != "bsdf" or name == "hair":
            continue
        stage_name = "sheet" if name in _SHEETS else "material"
        inner = {"inner": matt(0.7, 0.3, 0.1)} if name == "mask" else {}
        for key in plugin.params:
            if name in ("blendbsdf", "bumpmap", "normalmap") or key not in _MATERIAL:
                continue
            if key[:-1] == "alpha_" and "plastic" in name:
                PLAIN[name, key] = "a coat has one alpha"
                continue
            fixed = {**_METAL.get(name, {}), **_WITH.get((name, key), {}), **inner}
            if (name, key) in _WITH and key in ("eta", "k") or key in ("material", "eta", "k"):
                fixed.pop("material", None)
            if key == "eta" and name.startswith("principled"):
                values = [("1.1", 1.1), ("1.5", 1.5), ("2.4", 2.4)]
                fixed.setdefault("spec_trans", 1.0)
            else:
                values = _MATERIAL[key]
            made = []
            for label, value in values:
                given = (
                    {"alpha_u": value[0], "alpha_v": value[1]}
                    if key[:-1] == "alpha_"
                    else {key: value}
                )
                if key[:-1] == "alpha_":
                    fixed.pop("alpha", None)
                if value == "none":
                    given = {}
                made.append((label, {"type": name, **fixed, **given}))
            LOOKS[name, key] = Look(stage_name, made)
    PLAIN["hair", "*"] = "of curves alone"
    PLAIN["directionalarea", "*"] = "dark"
    PLAIN["timed_sunsky", "*"] = "as of `sunsky`, or days"
    LOOKS["null", ""] = Look("material", [("nothing is seen of the ball", {"type": "null"})])
    inside = {"inner": matt(0.7, 0.3, 0.1)}
    LOOKS["twosided", ""] = Look("sheet", [
        ("a matt sheet from behind, without", matt(0.7, 0.3, 0.1)),
        ("with `twosided`", {"type": "twosided", **inside}),
    ])  # fmt: skip
    mirror = {"type": "roughconductor", "material": "Al", "alpha": 0.05}
    LOOKS["blendbsdf", "weight"] = Look("material", [
        (label, {"type": "blendbsdf", "weight": w, "first": matt(0.7, 0.3, 0.1), "second": mirror})
        for label, w in _SHARES
    ])  # fmt: skip
    x, y = np.meshgrid(np.arange(64) / 64, np.arange(64) / 64)
    waves = (0.5 + 0.5 * np.sin(2 * np.pi * 4 * x) * np.sin(2 * np.pi * 4 * y))[..., None]
    heights = {"type": "bitmap", "bitmap": waves, "raw": True}
    coat = {"type": "roughplastic", "alpha": 0.1, "diffuse_reflectance": rgb(0.7, 0.3, 0.1)}

    def bumpy(**more: Any) -> Dict:
        return {"type": "bumpmap", "heights": heights, "inner": coat, **more}

    LOOKS["bumpmap", "scale"] = Look(
        "material", [("0", bumpy(scale=0.0)), ("0.1", bumpy(scale=0.1)), ("0.3", bumpy(scale=0.3))]
    )
    slope = 0.8 * np.stack([np.sin(2 * np.pi * 4 * x), np.sin(2 * np.pi * 4 * y)], -1)
    normal = np.concatenate([slope, np.ones_like(x)[..., None]], -1)
    normal /= np.linalg.norm(normal, axis=-1, keepdims=True)
    colours = {"type": "bitmap", "bitmap": (normal + 1) / 2, "raw": True}

    def mapped(**more: Any) -> Dict:
        return {"type": "normalmap", "normalmap": colours, "inner": coat, **more}

    PLAIN["normalmap", "normalmap"] = "one colour in place of the map tilts all normals alike"
    LOOKS["normalmap", ""] = Look("material", [("plain", coat), ("with a map of waves", mapped())])
    for name, made in (("bumpmap", lambda **m: bumpy(scale=0.4, **m)), ("normalmap", mapped)):
        for key in ("flip_invalid_normals", "use_shadowing_function"):
            LOOKS[name, key] = Look("material", [(label, made(**{key: v})) for label, v in _SWITCH])


def _textures() -> None:
    grid = np.zeros((4, 4, 3))
    grid[..., 0] = np.linspace(0.1, 0.9, 4)[None]
    grid[..., 1] = np.linspace(0.1, 0.9, 4)[:, None]
    grid[0, 0] = 0.9
    image = {"type": "bitmap", "bitmap": grid, "raw": True}
    for key, values in {
        "filter_type": [("bilinear", "bilinear"), ("nearest", "nearest")],
        "wrap_mode": [(w, w) for w in ("repeat", "mirror", "clamp")],
    }.items():
        fixed = {"to_uv": scale(2.5)} if key == "wrap_mode" else {}
        LOOKS["bitmap", key] = Look("texture", [(v, {**image, **fixed, key: v}) for v, _ in values])
    bytes8 = np.round(255 * grid).astype(np.uint8)
    LOOKS["bitmap", "raw"] = Look(
        "texture", [(label, {**image, "bitmap": bytes8, "raw": v}) for label, v in _SWITCH]
    )
    turns = [("none", np.eye(4)), ("scale 3", scale(3)),
             ("rotate 30", turn((0, 0, 1), 30))]  # fmt: skip
    LOOKS["bitmap", "to_uv"] = Look("texture", [(t, {**image, "to_uv": m}) for t, m in turns])
    checks = {"type": "checkerboard"}
    for key in ("color0", "color1"):
        LOOKS["checkerboard", key] = Look("texture", [(t, {**checks, key: v}) for t, v in _COLOURS])
    LOOKS["checkerboard", "to_uv"] = Look(
        "texture", [(t, {**checks, "to_uv": m}) for t, m in turns]
    )
    corners = np.array([[-1, -1, 0], [1, -1, 0], [1, 1, 0], [-1, 1, 0]], float)

    def mesh(scale: float) -> Dict:
        attribute = {"type": "mesh_attribute", "name": "vertex_color", "scale": scale}
        paper = {"type": "twosided", "inner": {"type": "diffuse", "reflectance": attribute}}
        return {"mesh": {"type": "mesh", "vertices": corners, "faces": [[0, 1, 2], [0, 2, 3]],
                         "vertex_color": np.vstack([np.eye(3), np.ones(3)]),
                         "bsdf": paper}}  # fmt: skip

    LOOKS["mesh_attribute", "scale"] = Look("texture", [("0.3", mesh(0.3)), ("1", mesh(1.0))])
    PLAIN["bitmap", "filename"] = PLAIN["bitmap", "data"] = PLAIN["bitmap", "bitmap"] = "the image"
    PLAIN["bitmap", "format"] = PLAIN["bitmap", "accel"] = "without effect"
    PLAIN["mesh_attribute", "name"] = "a name"


def _shapes() -> None:
    up = move(0, 1, 0)
    turned = turn((0, 1, 0), 30)
    for name, size in (("rectangle", 1.0), ("disk", 1.0), ("cube", 0.75)):
        places = [("moved", at(scale(size), up)), ("turned", at(scale(size), turned, up)),
                  ("stretched", at(scale((size, 0.5 * size, size)), turned, up))]  # fmt: skip
        LOOKS[name, "to_world"] = Look(
            "shape", [(t, {"type": name, "to_world": m}) for t, m in places]
        )
    centre = {"center": (0, 1, 0)}
    LOOKS["sphere", "radius"] = Look(
        "shape",
        [
            (t, {"type": "sphere", **centre, "radius": r})
            for t, r in (("0.3", 0.3), ("0.6", 0.6), ("1", 1.0))
        ],
    )
    LOOKS["sphere", "center"] = Look(
        "shape",
        [
            (t, {"type": "sphere", "radius": 0.6, "center": c})
            for t, c in (("-0.6, 0.6, 0", (-0.6, 0.6, 0)), ("0, 1.2, 0", (0, 1.2, 0)))
        ],
    )
    tube = {"type": "cylinder", "p0": (-0.8, 0.4, 0), "p1": (0.8, 1.4, 0), "radius": 0.3}
    LOOKS["cylinder", "p0"] = Look(
        "shape",
        [
            (t, {**tube, "p0": p})
            for t, p in (("-0.8, 0.4, 0", (-0.8, 0.4, 0)), ("0, 0.3, 0", (0, 0.3, 0)))
        ],
    )
    LOOKS["cylinder", "p1"] = Look(
        "shape",
        [
            (t, {**tube, "p1": p})
            for t, p in (("0.8, 1.4, 0", (0.8, 1.4, 0)), ("-0.6, 2, 0", (-0.6, 2, 0)))
        ],
    )
    LOOKS["cylinder", "radius"] = Look(
        "shape", [(t, {**tube, "radius": r}) for t, r in (("0.1", 0.1), ("0.3", 0.3), ("0.5", 0.5))]
    )
    coarse, faces = ball_mesh(12, 6)
    mesh = {"type": "mesh", "vertices": coarse, "faces": faces, "to_world": up}
    LOOKS["mesh", "face_normals"] = Look(
        "shape", [(t, {**mesh, "face_normals": v}) for t, v in _SWITCH]
    )
    LOOKS["mesh", "max_smooth_angle"] = Look(
        "shape",
        [
            (t, {**mesh, "max_smooth_angle": a})
            for t, a in (("10", 10.0), ("31", 31.0), ("90", 90.0))
        ],
    )
    ball_field = (
        np.linalg.norm(np.stack(np.meshgrid(*[np.linspace(-1, 1, 6)] * 3), -1), axis=-1) - 0.8
    )
    field = {"type": "sdfgrid", "grid": ball_field[..., None],
             "to_world": at(move(-0.5, -0.5, -0.5), scale(2), up)}  # fmt: skip
    few = {
        "centers": np.array([[-0.4, 0.5, 0], [0.3, 0.7, 0.2], [0.1, 1.2, -0.3]]),
        "scales": np.array([[0.15, 0.08, 0.1], [0.06, 0.16, 0.08], [0.1, 0.05, 0.12]]),
        "quaternions": np.array([[0, 0, 0, 1], [0, 0, 0.6, 0.8], [0.48, 0.64, 0, 0.6]]),
        "opacities": np.array([[0.1], [0.5], [0.9]]),
    }
    for name in ("ellipsoids", "ellipsoidsmesh"):
        some = {"type": name, **few}
        LOOKS[name, "extent"] = Look(
            "shape", [(t, {**some, "extent": float(t)}) for t in ("1", "2", "3")]
        )
        LOOKS[name, "extent_adaptive_clamping"] = Look(
            "shape", [(t, {**some, "extent_adaptive_clamping": v}) for t, v in _SWITCH]
        )
        for key in ("filename", "data", "centers", "scales", "quaternions", "scale_factor"):
            PLAIN[name, key] = "where they are, and how large"
        PLAIN[name, "to_world"] = "as of other shapes"
        PLAIN[name, "opacities"] = "see `extent_adaptive_clamping`"
        PLAIN[name, "sh_coeffs"] = "without effect"
    PLAIN["ellipsoidsmesh", "face_normals"] = "without effect"
    LOOKS["ellipsoidsmesh", "shell"] = Look(
        "shape",
        [
            (t, {"type": "ellipsoidsmesh", **few, "shell": t})
            for t in ("box", "ico_sphere", "uv_sphere")
        ],
    )
    LOOKS["sdfgrid", "normals"] = Look(
        "shape", [(n, {**field, "normals": n}) for n in ("smooth", "analytic")]
    )
    cube = {"type": "cube", "to_world": scale(0.3), "bsdf": matt(0.7, 0.3, 0.1)}
    group = {"type": "shapegroup", "id": "group", "cube": cube}
    several = {"group": group, **{
        f"copy{k}": {"type": "instance", "group": {"type": "ref", "id": "group"},
                     "to_world": at(turn((0, 1, 0), 25 * k),
                                    move(0.8 * k - 0.8, 0.5 + 0.3 * k, 0))}
        for k in range(3)
    }}  # fmt: skip
    LOOKS["instance", "to_world"] = Look(
        "shape", [("three of one group", {"type": "shapegroup", "objects": several})]
    )
    PLAIN["rectangle", "face_normals"] = PLAIN["cube", "face_normals"] = "without effect"
    PLAIN["", "flip_normals"] = "swaps front and back: see `twosided`"
    PLAIN["", "flip_tex_coords"] = "turns textures upside down"
    PLAIN["", "shape_index"] = "which mesh of a file"
    for name in (
        "sphere",
        "cylinder",
        "linearcurve",
        "bsplinecurve",
        "sdfgrid",
        "obj",
        "ply",
        "stl",
        "mesh",
        "serialized",
    ):
        PLAIN[name, "to_world"] = "as of `cube`"
    for name in ("obj", "ply", "stl", "serialized"):
        PLAIN[name, "*"] = "as of `mesh`"
    for name in ("linearcurve", "bsplinecurve"):
        PLAIN[name, "filename"] = "the points"
    for key in ("vertices", "faces", "uv", "normals"):
        PLAIN["mesh", key] = "the mesh itself"
    PLAIN["sdfgrid", "filename"] = PLAIN["sdfgrid", "grid"] = "the field itself"


def ball_mesh(around: int, rings: int) -> tuple[np.ndarray[Any, Any], np.ndarray[Any, Any]]:
    """Vertices and faces of a coarse unit ball."""
    theta = np.pi * np.arange(1, rings) / rings
    phi = 2 * np.pi * np.arange(around) / around
    body = [(np.sin(t) * np.cos(p), np.cos(t), -np.sin(t) * np.sin(p)) for t in theta for p in phi]
    points = np.array([(0, 1, 0), *body, (0, -1, 0)], float)
    faces, last = [], len(points) - 1
    for k in range(around):
        n = (k + 1) % around
        faces.append((0, 1 + k, 1 + n))
        faces.append((last, last - around + n, last - around + k))
        for r in range(rings - 2):
            a, b = 1 + r * around, 1 + (r + 1) * around
            faces += [(a + k, b + k, b + n), (a + k, b + n, a + n)]
    return points, np.array(faces)


def _lights() -> None:
    down = look_at((-2, 4, 3), (0, 0.5, 0), (0, 1, 0))

    def lamp(value: Any) -> Dict:
        return {**LAMP, "emitter": {"type": "area", "radiance": value}}

    amounts = [("10", 10.0), ("30", 30.0), ("rgb 30, 15, 5", rgb(30, 15, 5))]
    LOOKS["area", "radiance"] = Look("light", [(t, lamp(v)) for t, v in amounts])
    LOOKS["constant", "radiance"] = Look(
        "light",
        [
            (t, {"type": "constant", "radiance": v})
            for t, v in (("0.3", 0.3), ("1", 1.0), ("rgb 0.3, 0.5, 1", rgb(0.3, 0.5, 1)))
        ],
    )
    sky = np.zeros((16, 32, 3)) + (0.15, 0.2, 0.35)
    sky[3:6, 5:9] = (14, 12, 9)
    sky[8:] = (0.2, 0.15, 0.1)
    image = {"type": "envmap", "bitmap": sky}
    LOOKS["envmap", "scale"] = Look(
        "light", [(t, {**image, "scale": s}) for t, s in (("0.5", 0.5), ("1", 1.0), ("2", 2.0))]
    )
    LOOKS["envmap", "to_world"] = Look(
        "light",
        [
            (t, {**image, "to_world": turn((0, 1, 0), a)})
            for t, a in (("0 degrees", 0), ("90 about y", 90), ("180", 180))
        ],
    )
    PLAIN["envmap", "filename"] = PLAIN["envmap", "bitmap"] = "the image"
    PLAIN["envmap", "mis_compensation"] = "changes noise alone"
    upright = turn((1, 0, 0), -90)
    sun = {"type": "sunsky", "to_world": upright, "sun_direction": (-2, 2, 1.5)}
    for key, values in {
        "turbidity": [("2", 2.0), ("8", 8.0)],
        "albedo": [("0", 0.0), ("1", 1.0)],
        "sun_scale": [("0", 0.0), ("1", 1.0)],
        "sky_scale": [("0", 0.0), ("4", 4.0)],
        "sun_aperture": [("0.5358", 0.5358), ("20", 20.0)],
        "sun_direction": [("-1, 4, 1", (-1, 4, 1)), ("3, 2, 1", (3, 2, 1))],
    }.items():
        LOOKS["sunsky", key] = Look(
            "light", [(t, {**sun, key: v}) for t, v in values], exposure=0.06
        )
    by_time = {"type": "sunsky", "to_world": at(upright, turn((0, 1, 0), 180))}
    for key, values in {
        "hour": [("8", 8.0), ("17", 17.0)],
        "month": [("1", 1), ("6", 6)],
        "latitude": [("0", 0.0), ("50", 50.0)],
        "longitude": [("100", 100.0), ("170", 170.0)],
        "timezone": [("6", 6.0), ("12", 12.0)],
    }.items():
        LOOKS["sunsky", key] = Look(
            "light", [(t, {**by_time, key: v}) for t, v in values], exposure=0.06
        )
    for key in ("year", "day", "minute", "second"):
        PLAIN["sunsky", key] = "see `month` and `hour`"
    PLAIN["sunsky", "to_world"] = "as of `envmap`"
    PLAIN["sunsky", "complex_sun"] = "without effect"
    near = {"type": "point", "position": (-1.5, 3, 2)}
    LOOKS["point", "position"] = Look(
        "light",
        [
            (t, {**near, "position": p, "intensity": 30.0})
            for t, p in (
                ("-1.5, 3, 2", (-1.5, 3, 2)),
                ("1.5, 3, 2", (1.5, 3, 2)),
                ("0, 4, 0", (0, 4, 0)),
            )
        ],
    )
    LOOKS["point", "intensity"] = Look("light", [(t, {**near, "intensity": v}) for t, v in amounts])
    spot = {"type": "spot", "to_world": down, "intensity": 80.0}
    for key, values in {
        "intensity": [("30", 30.0), ("80", 80.0), ("rgb 80, 40, 10", rgb(80, 40, 10))],
        "cutoff_angle": [("8", 8.0), ("14", 14.0), ("20", 20.0)],
        "beam_width": [("1", 1.0), ("8", 8.0), ("14", 14.0)],
    }.items():
        fixed = {"cutoff_angle": 14.0} if key == "beam_width" else {}
        LOOKS["spot", key] = Look("light", [(t, {**spot, **fixed, key: v}) for t, v in values])
    pattern = {"type": "checkerboard", "color0": 1.0, "color1": 0.05, "to_uv": scale(3)}
    LOOKS["spot", "texture"] = Look(
        "light", [("none", spot), ("a checkerboard", {**spot, "texture": pattern})]
    )
    throws = {
        "type": "projector",
        "to_world": down,
        "irradiance": pattern,
        "scale": 15.0,
        "fov": 35.0,
    }
    plain = {**throws, "scale": 1.0}
    LOOKS["projector", "irradiance"] = Look(
        "light", [("10", {**plain, "irradiance": 10.0}), ("a checkerboard", throws)]
    )
    LOOKS["projector", "scale"] = Look(
        "light", [(t, {**throws, "scale": s}) for t, s in (("5", 5.0), ("15", 15.0), ("40", 40.0))]
    )
    LOOKS["projector", "fov"] = Look(
        "light", [(t, {**throws, "fov": f}) for t, f in (("20", 20.0), ("35", 35.0), ("60", 60.0))]
    )
    PLAIN["projector", "fov_axis"] = PLAIN["projector", "focal_length"] = "as of `perspective`"
    beam = {"type": "directional", "direction": (1, -2, -1)}
    LOOKS["directional", "direction"] = Look(
        "light",
        [
            (t, {**beam, "direction": d, "irradiance": 3.0})
            for t, d in (
                ("1, -2, -1", (1, -2, -1)),
                ("-1, -1, 0", (-1, -1, 0)),
                ("0, -1, 0", (0, -1, 0)),
            )
        ],
    )
    LOOKS["directional", "irradiance"] = Look(
        "light",
        [
            (t, {**beam, "irradiance": v})
            for t, v in (("1", 1.0), ("4", 4.0), ("rgb 4, 2, 1", rgb(4, 2, 1)))
        ],
    )
    for name in ("point", "spot", "projector", "directional"):
        PLAIN[name, "to_world"] = "place and direction"
    PLAIN["", "sampling_weight"] = "without effect"


def _media() -> None:
    for name in ("homogeneous", "heterogeneous"):
        fog = {"type": name, "sigma_t": 2.0, "albedo": 0.9}
        if name == "heterogeneous":
            place = at(scale(1.9), move(-0.95, 0.05, -0.95))
            z, y, x = np.meshgrid(*[np.linspace(-1, 1, 12)] * 3, indexing="ij")
            cells = np.clip(1.2 - np.sqrt(x * x + y * y + z * z), 0, 1) * (
                1 + np.sin(9 * x) * np.cos(7 * y)
            )
            volume = {"type": "gridvolume", "grid": cells[..., None], "to_world": place}
            fog = {"type": name, "sigma_t": volume, "albedo": 0.9, "scale": 4.0}
            thick = [
                (t, {**volume, "grid": k * cells[..., None]})
                for t, k in (("thin", 0.3), ("thick", 2.0))
            ]
            LOOKS[name, "sigma_t"] = Look("medium", [(t, {**fog, "sigma_t": v}) for t, v in thick])
            for key, values in {
                "filter_type": ("trilinear", "nearest"),
                "wrap_mode": ("clamp", "repeat", "mirror"),
            }.items():
                LOOKS["gridvolume", key] = Look(
                    "medium", [(v, {**fog, "sigma_t": {**volume, key: v}}) for v in values]
                )
            LOOKS["gridvolume", "to_world"] = Look(
                "medium",
                [
                    (t, {**fog, "sigma_t": {**volume, "to_world": m}})
                    for t, m in (("the cube", place), ("half of it", at(place, scale((1, 0.5, 1)))))
                ],
            )
            whole = {"type": "constvolume", "to_world": place}
            for key, values in {
                "value": [("0.3", 0.3), ("1", 1.0), ("rgb 1, 0.3, 0.1", rgb(1, 0.3, 0.1))]
            }.items():
                LOOKS["constvolume", key] = Look(
                    "medium",
                    [(t, {**fog, "sigma_t": {**whole, key: v}, "scale": 2.0}) for t, v in values],
                )
            LOOKS["constvolume", "to_world"] = Look(
                "medium",
                [
                    (t, {**fog, "sigma_t": {**whole, "to_world": m}, "scale": 2.0})
                    for t, m in (("the cube", place), ("half of it", at(place, scale((1, 0.5, 1)))))
                ],
            )
        else:
            LOOKS[name, "sigma_t"] = Look(
                "medium",
                [
                    (t, {**fog, "sigma_t": v})
                    for t, v in (("0.5", 0.5), ("4", 4.0), ("rgb 1, 3, 8", rgb(1, 3, 8)))
                ],
            )
            for key, other in (("sigma_s", "sigma_a"), ("sigma_a", "sigma_s")):
                LOOKS[name, key] = Look(
                    "medium",
                    [
                        (t, {"type": name, key: v, other: 0.5})
                        for t, v in (("0.2", 0.2), ("2", 2.0), ("rgb 3, 1, 0.3", rgb(3, 1, 0.3)))
                    ],
                )
        LOOKS[name, "albedo"] = Look(
            "medium",
            [
                (t, {**fog, "albedo": v})
                for t, v in (("0", 0.0), ("0.8", 0.8), ("rgb 1, 0.6, 0.3", rgb(1, 0.6, 0.3)))
            ],
        )
        LOOKS[name, "scale"] = Look(
            "medium", [(t, {**fog, "scale": s}) for t, s in (("0.5", 0.5), ("2", 2.0), ("8", 8.0))]
        )
        PLAIN[name, "sample_emitters"] = PLAIN[name, "has_spectral_extinction"] = "without effect"
    PLAIN["heterogeneous", "density_scale"] = "the older name of `scale`"
    for key in ("filename", "grid", "data", "use_grid_bbox", "raw", "accel", "max_value"):
        PLAIN["gridvolume", key] = "the numbers, or without effect"

    def cloud(phase: Dict) -> Dict:
        return {"type": "homogeneous", "sigma_t": 3.0, "albedo": 0.95, "phase": phase}

    def peaked(g: float) -> Dict:
        return {"type": "hg", "g": g}

    def mixed(weight: float) -> Dict:
        return {"type": "blendphase", "weight": weight, "back": peaked(-0.8), "on": peaked(0.8)}

    LOOKS["hg", "g"] = Look("medium", [(t, cloud(peaked(float(t)))) for t in ("-0.8", "0", "0.8")])
    LOOKS["rayleigh", ""] = Look(
        "medium", [(name, cloud({"type": name})) for name in ("isotropic", "rayleigh")]
    )

    def flakes(*areas: float) -> Dict:
        numbers = np.array([a * a for a in areas] + [0.0] * 3, np.float32)
        cells = np.broadcast_to(numbers, (2, 2, 2, 6))
        return {"type": "sggx", "S": {"type": "gridvolume", "grid": cells}}

    LOOKS["sggx", ""] = Look(
        "medium",
        [
            ("round", cloud(flakes(1, 1, 1))),
            ("discs that lie", cloud(flakes(0.1, 1, 0.1))),
            ("needles that stand", cloud(flakes(1, 0.1, 1))),
        ],
    )
    LOOKS["blendphase", "weight"] = Look(
        "medium", [(t, cloud(mixed(float(t)))) for t in ("0", "0.5", "1")]
    )
    LOOKS["tabphase", "values"] = Look(
        "medium",
        [(v, cloud({"type": "tabphase", "values": v})) for v in ("8, 1, 1", "1, 8, 1", "1, 1, 8")],
    )


def _cameras() -> None:
    view = camera()["to_world"]
    pinhole = {"type": "perspective", "fov": 30.0}
    lens = {"type": "thinlens", "fov": 30.0, "aperture_radius": 0.25, "focus_distance": 5.0}
    wide = {"type": "hdrfilm", "width": 64, "height": 40, "rfilter": {"type": "box"}}
    for name, usual in (("perspective", pinhole), ("thinlens", lens)):
        LOOKS[name, "fov"] = Look(
            "camera",
            [(t, {**usual, "fov": f}) for t, f in (("15", 15.0), ("30", 30.0), ("60", 60.0))],
        )
        LOOKS[name, "fov_axis"] = Look(
            "camera",
            [(a, {**usual, "fov_axis": a, "film": wide}) for a in ("x", "y", "diagonal")],
            size=(84, 52),
        )
        without = {k: v for k, v in usual.items() if k != "fov"}
        LOOKS[name, "focal_length"] = Look(
            "camera", [(t, {**without, "focal_length": t}) for t in ("35mm", "50mm", "100mm")]
        )
        for key, values in {
            "near_clip": (("1", 1.0), ("4.5", 4.5)),
            "far_clip": (("4.5", 4.5), ("6", 6.0)),
        }.items():
            LOOKS[name, key] = Look("camera", [(t, {**usual, key: v}) for t, v in values])
        LOOKS[name, "to_world"] = Look(
            "camera",
            [
                (t, {**usual, "to_world": look_at(o, (0, 0.7, 0), (0, 1, 0))})
                for t, o in (
                    ("from the front", (0, 2.2, 5.4)),
                    ("from the left", (-4, 2, 3)),
                    ("from above", (0, 5.5, 0.5)),
                )
            ],
        )
    for axis in "xy":
        key = f"principal_point_offset_{axis}"
        LOOKS["perspective", key] = Look(
            "camera",
            [(t, {**pinhole, key: v}) for t, v in (("-0.25", -0.25), ("0", 0.0), ("0.25", 0.25))],
        )
    PLAIN["perspective", "focus_distance"] = "without effect"
    PLAIN["orthographic", "focus_distance"] = "without effect"
    LOOKS["thinlens", "aperture_radius"] = Look(
        "camera",
        [
            (t, {**lens, "aperture_radius": r})
            for t, r in (("0", 0.0), ("0.15", 0.15), ("0.4", 0.4))
        ],
        spp=128,
    )
    LOOKS["thinlens", "focus_distance"] = Look(
        "camera",
        [(t, {**lens, "focus_distance": d}) for t, d in (("4", 4.0), ("5.5", 5.5), ("7", 7.0))],
        spp=128,
    )
    flat = {"type": "orthographic"}
    LOOKS["orthographic", "to_world"] = Look(
        "camera",
        [
            (t, {**flat, "to_world": at(scale((s, s, 1)), view)})
            for t, s in (("scale 1", 1.0), ("scale 2", 2.0))
        ],
    )
    PLAIN["orthographic", "near_clip"] = PLAIN["orthographic", "far_clip"] = "as of `perspective`"
    PLAIN["radiancemeter", "*"] = PLAIN["distant", "*"] = PLAIN["irradiancemeter", "*"] = (
        "one number"
    )
    film = {"type": "hdrfilm", "width": 84, "height": 84, "rfilter": {"type": "box"}}
    sizes = [("84 x 84", {}), ("`crop_width` 42", {"crop_width": 42}),
             ("`crop_offset_x` 42 too", {"crop_width": 42, "crop_offset_x": 42})]  # fmt: skip
    LOOKS["hdrfilm", "crop_width"] = Look(
        "camera", [(t, {**pinhole, "film": {**film, **more}}) for t, more in sizes], own_size=True
    )
    for key in ("crop_height", "crop_offset_x", "crop_offset_y", "width", "height"):
        PLAIN["hdrfilm", key] = "see `crop_width`"
    for key in (
        "pixel_format",
        "component_format",
        "file_format",
        "sample_border",
        "high_quality_edges",
        "compensate",
        "banner",
    ):
        PLAIN["hdrfilm", key] = "without effect"
    for name in ("ldrfilm", "tiledhdrfilm", "mfilm"):
        PLAIN[name, "*"] = "as of `hdrfilm`"


def _rest() -> None:
    for name, key, values in (
        ("tent", "radius", (0.5, 1.0, 2.0)), ("gaussian", "stddev", (0.25, 0.5, 1.0)),
        ("mitchell", "B", (0.0, 1 / 3, 1.0)), ("mitchell", "C", (0.0, 1 / 3, 1.0)),
    ):  # fmt: skip
        LOOKS[name, key] = Look(
            "filter", [(f"{v:.2g}", {"type": name, key: v}) for v in values], own_size=True, spp=256
        )
    LOOKS["lanczos", "lobes"] = Look(
        "filter", [(str(n), {"type": "lanczos", "lobes": n}) for n in (1, 3, 8)],
        own_size=True, spp=256,
    )  # fmt: skip
    for name in ("box", "catmullrom"):
        LOOKS[name, ""] = Look("filter", [(name, {"type": name})], own_size=True, spp=256)
    for name in ("independent", "stratified"):
        LOOKS[name, "sample_count"] = Look(
            "sampler", [(str(n), {"type": name, "sample_count": n}) for n in (4, 16, 64)]
        )
    PLAIN["", "seed"] = "another noise"
    for name in ("multijitter", "orthogonal", "ldsampler"):
        PLAIN[name, "*"] = "as of `stratified`"
    path = {"type": "path"}
    LOOKS["path", "max_depth"] = Look(
        "integrator",
        [(str(d), {**path, "max_depth": d}) for d in (1, 2, 3)]
        + [("-1, unlimited", {**path, "max_depth": -1})],
    )
    LOOKS["path", "hide_emitters"] = Look(
        "integrator", [(t, {**path, "hide_emitters": v}) for t, v in _SWITCH]
    )
    PLAIN["", "rr_depth"] = "changes noise alone"
    PLAIN["", "sample_visible"] = "without effect"
    for name, plugin in PLUGINS.items():
        if plugin.category == "integrator" and name != "path":
            PLAIN[name, "*"] = "as of `path`"


for _fill in (_materials, _textures, _shapes, _lights, _media, _cameras, _rest):
    _fill()
