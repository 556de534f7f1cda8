"""Brushed metal and turned normals against closed forms and quadrature.

A point of a surface is seen from afar; where the light is parallel, the answer has no noise.
"""

from __future__ import annotations

import functools
import math
from typing import Any

import numpy as np
import trimesh

from veriray_validate.dicts import (
    BLACK,
    Array,
    Dict,
    diffuse,
    flat,
    rgb,
    scene,
    sky,
    sphere,
    view,
)
from veriray_validate.fresnel import fresnel_conductor
from veriray_validate.rough import share
from veriray_validate.trial import Trial, case

ETA, K = 0.2, 3.0
#: Of maps without Mitsuba's shadows, which have closed forms.
PLAIN = {"use_shadowing_function": False, "flip_invalid_normals": False}
KINDS = ("normalmap", "bumpmap")


def mapped(kind: str, normal: Array, per: tuple[float, float] = (1.0, 1.0), **more: Any) -> Dict:
    """White with a normal, in the frame of u and v, everywhere.

    By an even normal map, or by heights that grow evenly with u and v; per: lengths of a unit of u
    and v on the surface.
    """
    white = diffuse(1.0)
    if kind == "normalmap":
        data = np.full((2, 2, 3), (normal + 1) / 2, np.float32)
        texture: Dict = {"type": "bitmap", "data": data, "raw": True}
        return {"type": kind, "normalmap": texture, "bsdf": white, **more}
    centres = (np.arange(16) + 0.5) / 16 - 0.5
    slope = -normal[:2] / normal[2] * per
    scale = 2 * float(np.abs(slope).sum()) or 1.0
    heights = 0.5 + (slope[0] * centres[None, :] + slope[1] * centres[:, None]) / scale
    data = heights[:, :, None].astype(np.float32)
    texture = {"type": "bitmap", "data": data, "raw": True, "wrap_mode": "clamp"}
    return {"type": kind, "heights": texture, "bsdf": white, "scale": scale, **more}


@case(3, each={"alpha": ((0.4, 0.1), (0.1, 0.4), (0.6, 0.03)), "ggx": (True, False),
               "azimuth": (0.0, 35.0, 90.0), "lit": ("sky", "lamp")},
      quick=lambda alpha, ggx, azimuth, lit: azimuth == 35 and (alpha[0] == 0.4) == ggx
      )  # fmt: skip
def brushed_metal(
    t: Trial, alpha: tuple[float, float], ggx: bool, azimuth: float, lit: str
) -> None:
    """A metal rougher along u than across: share of light that goes on, by quadrature.

    Seen at a cosine of 0.3. Sees 1 %.
    """
    turn = math.radians(azimuth)
    curve = functools.partial(fresnel_conductor, eta=complex(ETA, K))
    exact = share(0.3, alpha, ggx, curve, azimuth=turn)
    metal = {"type": "roughconductor", "eta": ETA, "k": K, "alpha_u": alpha[0],
             "alpha_v": alpha[1], "distribution": "ggx" if ggx else "beckmann"}  # fmt: skip
    light = sky(1) if lit == "sky" else sphere([0, 0, 0], 1000, BLACK, 1.0, flip_normals=True)
    eye = 5 * np.array([math.sqrt(0.91) * math.cos(turn), math.sqrt(0.91) * math.sin(turn), 0.3])
    plate = flat("rectangle", [0, 0, 0], [0, 0, 1], 100, metal)
    t.agrees(scene(view(eye, [0, 0, 0]), plate, light), exact, 400_000, sees=0.01)


@case(3, each={"angle": (20.0, 60.0, 80.0), "kind": KINDS, "shades": (False, True),
               "lit": ("sky", "lamp")},
      quick=lambda angle, kind, shades, lit: angle == 60)  # fmt: skip
def turned_plane_in_even_light(t: Trial, angle: float, kind: str, shades: bool, lit: str) -> None:
    """A white plane whose normals are turned by an angle: (1 + cos) / 2, as half of it is below.

    With shadows by quadrature over directions. Sees 0.5 %.
    """
    tilt = math.radians(angle)
    normal = np.array([math.sin(tilt) * 0.6, math.sin(tilt) * 0.8, math.cos(tilt)])
    exact = (1 + math.cos(tilt)) / 2
    if shades:
        z, turn = np.meshgrid((np.arange(1000) + 0.5) / 1000, (np.arange(1000) + 0.5) / 1000)
        cosine = math.sin(tilt) * np.sqrt(1 - z * z) * np.cos(2 * np.pi * turn)
        cosine = cosine + math.cos(tilt) * z
        slope = min(math.tan(tilt) ** 2 / 8, 1)
        left = 2 / (1 + np.sqrt(1 + slope * (1 / z**2 - 1)))
        exact = float((2 * np.maximum(cosine, 0) * left).mean())
    light = sky(1) if lit == "sky" else sphere([0, 0, 0], 100, BLACK, 1.0, flip_normals=True)
    bsdf = mapped(kind, normal, (2.0, 2.0), **({} if shades else PLAIN))
    plane = flat("rectangle", [0, 0, 0], [0, 0, 1], 1, bsdf)
    t.agrees(scene(view([0, 0, 3], [0, 0, 0]), plane, light, max_depth=2), exact, 800_000,
             sees=0.005)  # fmt: skip


#: Maps that turn no normal, or by what 8 bits cannot say better.
FLAT_MAPS: dict[str, Dict] = {
    "even heights": {"type": "bumpmap", "arbitrary": {
        "type": "bitmap", "raw": True, "data": np.full((2, 2, 1), 0.5, np.float32)}},
    "8 bits": {"type": "normalmap", "normalmap": {
        "type": "bitmap", "raw": True, "data": np.full((2, 2, 3), (128, 128, 255), np.uint8)}},
}  # fmt: skip


@case(3, each={"glass": ("dielectric", "thindielectric"), "map_": FLAT_MAPS})
def flat_maps_on_a_ball_of_faces(t: Trial, glass: str, map_: str) -> None:
    """Smooth glass with the normals of a ball on 80 faces, and a map that is flat, in a sky of 1.

    1, as without a map. 8 bits turn normals by 0.3 degrees: within 5e-3 per pixel. Sees 1 %.
    """
    body = trimesh.creation.icosphere(1)
    shape = {
        "type": "mesh",
        "vertices": body.vertices,
        "faces": body.faces,
        "normals": body.vertices,
        "bsdf": {**FLAT_MAPS[map_], "bsdf": {"type": glass}},
    }
    seen = scene(view([0, 1, 4], [0, 0, 0], 30, 16), shape, sky(1))
    sees, margin = (0.01, 5e-3) if map_ == "8 bits" else (0.002, 1e-6)
    t.agrees(seen, 1.0, 4000, sees=sees, margin=margin)


def place_on(shape: str) -> tuple[Dict, Array, Array, Array, tuple[float, float]]:
    """A shape, a point on it, its normal, the direction of u, and the lengths of u and v."""
    if shape == "sphere":
        polar, turn, radius = math.radians(50), math.radians(70), 2.0
        n = np.array([math.sin(polar) * math.cos(turn), math.sin(polar) * math.sin(turn),
                      math.cos(polar)])  # fmt: skip
        along = np.array([-math.sin(turn), math.cos(turn), 0])
        lengths = (2 * math.pi * radius * math.sin(polar), math.pi * radius)
        return {"type": "sphere", "radius": radius}, radius * n, n, along, lengths
    if shape == "disk":
        turn, radius = math.radians(70), 0.6
        along = np.array([math.cos(turn), math.sin(turn), 0])
        lengths = (2.0, 2 * math.pi * radius * 2)
        place = np.diag([2.0, 2.0, 2.0, 1.0])
        return ({"type": "disk", "to_world": place}, 2 * radius * along, np.array([0, 0, 1.0]),
                along, lengths)  # fmt: skip
    if shape == "mesh":  # u grows along y, v against x
        uv = [[0, 1], [0, 0], [1, 0], [1, 1]]
        corners = [[-1, -1, 0], [1, -1, 0], [1, 1, 0], [-1, 1, 0]]
        mesh = {"type": "mesh", "vertices": corners, "faces": [[0, 1, 2], [0, 2, 3]], "uv": uv}
        return mesh, np.array([0.2, 0.1, 0]), np.array([0, 0, 1.0]), np.eye(3)[1], (2.0, 2.0)
    radius, turn = 1.5, 2 * math.pi * 41 / 256  # of a cylinder about z: an edge of the prism
    n = np.array([math.cos(turn), math.sin(turn), 0])
    along = np.array([-math.sin(turn), math.cos(turn), 0])
    rod = {"type": "cylinder", "p0": [0, 0, -1], "p1": [0, 0, 2], "radius": radius}
    return rod, radius * n, n, along, (2 * math.pi * radius, 3.0)


@case(3, each={"shape": ("sphere", "disk", "mesh", "cylinder"), "kind": KINDS,
               "away": (False, True)})  # fmt: skip
def turned_normals_in_parallel_light(t: Trial, shape: str, kind: str, away: bool) -> None:
    """The cosine of parallel light to the turned normal, on each shape; within 3e-4.

    The frame: u on the surface, the normal, and v across both. away: the front faces inwards, and
    is seen from there.
    """
    made, point, n, along, lengths = place_on(shape)
    local = np.array([0.36, -0.48, 0.8])
    if away:
        n = -n
    across = np.cross(n, along)
    per = (lengths[0], lengths[1] * (-1.0 if _left_handed(shape) != away else 1.0))
    normal = local[0] * along + local[1] * across + local[2] * n
    ray = n + 0.4 * along - 0.2 * across
    ray /= np.linalg.norm(ray)
    eye = point + (0.5 if away else 4.0) * (n + 0.3 * across)
    bsdf = mapped(kind, local, per, **PLAIN)
    sun = {"type": "directional", "direction": (-ray).tolist(), "irradiance": rgb(math.pi)}
    lamp = {"type": "point", "position": (point + 0.25 * ray).tolist(),
            "intensity": rgb(math.pi / 16)}  # fmt: skip
    light = lamp if away and shape in ("sphere", "cylinder") else sun
    surface = {**made, "flip_normals": away, "bsdf": bsdf}
    seen = scene(view(eye, point), surface, light, max_depth=2)
    t.agrees(seen, float(normal @ ray), 20_000, sees=0.001, margin=3e-4)


def _left_handed(shape: str) -> bool:
    """Whether v grows against n x u in front: of a sphere v runs down from the pole."""
    return shape == "sphere"
