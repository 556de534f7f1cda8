"""Textures against closed forms: a textured plane under an even sky is the mean of its texture.

The picture is one pixel, just the square that the texture lies on, so that the sample is a point of
the square with even density, and its radiance the texture there.
"""

from __future__ import annotations

import functools
import math
from collections.abc import Callable

import numpy as np

import veriray
from veriray.formats.images import BYTE_TO_SHARE, SRGB_TO_LINEAR
from veriray_validate.dicts import BLACK, Array, Dict, flat, rgb, scene, sky, view
from veriray_validate.trial import Trial, case

#: What takes the square's coordinates to the texture's, u and v: factors and offsets.
WINDOWS = {
    "whole": (1.0, 1.0, 0.0, 0.0),
    "corner": (0.5, 0.25, -0.25, -0.125),
    "far": (5.3, 2.2, -1.7, 3.4),
    "backwards": (-1.6, -2.3, 0.9, 1.4),
}
WRAPS = ("repeat", "mirror", "clamp")
KINDS: dict[str, Callable[[Array], Array]] = {  # codes 0 to 255 as an image
    "srgb": lambda codes: codes.astype(np.uint8),
    "raw": lambda codes: codes.astype(np.uint8),
    "grey": lambda codes: codes[..., :1].astype(np.uint8),
    "half": lambda codes: (codes / 256).astype(np.float16),
    "grey half": lambda codes: (codes[..., :1] / 256).astype(np.float16),
    "float": lambda codes: BYTE_TO_SHARE[codes],
}


def seen(bsdf: Dict, *more: Dict) -> veriray.Scene:
    """The square of a material from above, and nothing else."""
    half = math.degrees(math.atan(1 / 3))
    square = flat("rectangle", [0, 0, 0], [0, 0, 1], 1, bsdf)
    return scene(view([0, 0, 3], [0, 0, 0], 2 * half), square, *(more or (sky(1),)), max_depth=2)


def placed(window: tuple[float, ...], texture: Dict) -> Dict:
    """A texture seen through a window of its own coordinates."""
    to_uv = np.diag([window[0], window[1], 1.0, 1.0])
    to_uv[:2, 3] = window[2:]
    return {**texture, "to_uv": to_uv}


def tent(x: Array) -> Array:
    """Integral of max(0, 1 - |t|) up to x."""
    x = np.clip(x, -1, 1)
    return np.where(x < 0, (1 + x) ** 2, 2 - (1 - x) ** 2) / 2


def box(x: Array) -> Array:
    """Integral up to x of what is 1 within 1/2 of 0."""
    return np.clip(x + 0.5, 0, 1)


def shares(n: int, first: float, last: float, wrap: str, kernel: Callable[[Array], Array]) -> Array:
    """The mean weights (n,) of the texels of an axis over coordinates from first to last.

    By the kernel's integral over each texel of an endless row, of which every one is a copy.
    """
    a, b = sorted((first * n, last * n))
    places = np.arange(math.floor(a) - 2, math.ceil(b) + 3)
    weight = (kernel(b - places - 0.5) - kernel(a - places - 0.5)) / (b - a)
    folded = np.mod(places, 2 * n)
    copies = {
        "repeat": np.mod(places, n),
        "mirror": np.minimum(folded, 2 * n - 1 - folded),
        "clamp": np.clip(places, 0, n - 1),
    }[wrap]
    return np.bincount(copies, weight, n)


@case(3, each={"wrap": WRAPS, "filter_": ("bilinear", "nearest"),
               "window": WINDOWS, "kind": KINDS},
      quick=lambda wrap, filter_, window, kind: list(KINDS).index(kind) ==
      (2 * WRAPS.index(wrap) + list(WINDOWS).index(window)) % 6)  # fmt: skip
def plane_with_a_bitmap(t: Trial, wrap: str, filter_: str, window: str, kind: str) -> None:
    """A plane with a random bitmap of 5 x 3 texels in a sky of 1: sum of texels times shares.

    Shares are integrals of the tent or the box. Sees 1 %.
    """
    codes = t.rng.integers(20, 256, (3, 5, 3))
    image = KINDS[kind](codes)
    table = BYTE_TO_SHARE if kind == "raw" else SRGB_TO_LINEAR
    texels = table[image] if image.dtype == np.uint8 else image.astype(np.float64)
    u, v, left, low = WINDOWS[window]
    kernel = tent if filter_ == "bilinear" else box
    exact = np.einsum(
        "v,u,vuc->c",
        shares(3, low, low + v, wrap, kernel),
        shares(5, left, left + u, wrap, kernel),
        texels,
    )
    texture = {"type": "bitmap", "bitmap": image, "wrap_mode": wrap, "filter_type": filter_}
    texture["raw"] = kind == "raw"
    bsdf = {"type": "diffuse", "reflectance": placed(WINDOWS[window], texture)}
    t.agrees(seen(bsdf), exact, 2_000_000, sees=0.01)


def coverage(window: tuple[float, ...]) -> float:
    """Share of a window in which both coordinates are in the first or both in the second half."""
    parts = [
        shares(2, low, low + factor, "repeat", box)[0]
        for factor, low in zip(window[:2], window[2:], strict=True)
    ]
    return parts[0] * parts[1] + (1 - parts[0]) * (1 - parts[1])


@case(3, each={"window": WINDOWS})
def plane_with_a_checkerboard(t: Trial, window: str) -> None:
    """A plane with a checkerboard in a sky of 1: its colours by the areas of its fields.

    Sees 0.5 %.
    """
    colours = np.array([0.9, 0.6, 0.1]), np.array([0.2, 0.3, 0.7])
    board = {"type": "checkerboard", "color0": rgb(colours[0]), "color1": rgb(colours[1])}
    bsdf = {"type": "diffuse", "reflectance": placed(WINDOWS[window], board)}
    share = coverage(WINDOWS[window])
    exact = share * colours[0] + (1 - share) * colours[1]
    t.agrees(seen(bsdf), exact, 2_000_000, sees=0.005)


@case(3, each={"window": WINDOWS, "light": ("camera", "shadow")})
def plane_with_holes(t: Trial, window: str, light: str) -> None:
    """A black plane with a checkerboard for its opacity: 0.25 and 1, which Mitsuba exchanges. What
    comes through it.

    camera: from the sky of 1 behind it, to the eye. shadow: from the sun above to a white plane
    below it, which is seen from between them. Sees 0.5 %.
    """
    board = {"type": "checkerboard", "color0": 0.25, "color1": 1.0}
    plane = {"type": "mask", "opacity": placed(WINDOWS[window], board), "bsdf": BLACK}
    share = (1 - coverage(WINDOWS[window])) * 0.75
    if light == "camera":
        t.agrees(seen(plane), share, 2_000_000, sees=0.005)
        return
    sun = {"type": "directional", "direction": [0, 0, -1], "irradiance": rgb(math.pi)}
    white = {"type": "diffuse", "reflectance": 1.0}
    # The pixel is the shadow that the square casts.
    half = math.degrees(math.atan(1 / 3))
    holes = flat("rectangle", [0, 0, 4], [0, 0, 1], 1, plane)
    ground = flat("rectangle", [0, 0, 0], [0, 0, 1], 9, white)
    eye = view([0, 0, 3], [0, 0, 0], 2 * half)
    t.agrees(scene(eye, holes, ground, sun, max_depth=2), share, 2_000_000, sees=0.005)


def lines(window: tuple[float, ...], axis: int, n: int) -> Array:
    """Where in (0, 1) an axis of a window crosses multiples of 1/n."""
    factor, offset = window[axis], window[2 + axis]
    low, high = sorted((offset, offset + factor))
    multiples = np.arange(math.floor(low * n), math.ceil(high * n) + 1) / n
    return np.asarray((multiples - offset) / factor)


@case(3, each={"window": WINDOWS, "number": (False, True)})
def plane_with_a_board_of_textures(t: Trial, window: str, number: bool) -> None:
    """A plane in a sky of 1, with a checkerboard in one field of which is a bitmap, and in the
    other a checkerboard of a colour and the bitmap. All are even between lines of u and v.

    number: for its opacity, where Mitsuba exchanges the fields of both; what comes through.
    Sees 1 %.
    """
    codes = t.rng.integers(20, 256, (3, 5, 1 if number else 3)).astype(np.uint8)
    windows = WINDOWS[window], WINDOWS["far"], WINDOWS["backwards"]
    image = {"type": "bitmap", "bitmap": codes, "raw": True, "filter_type": "nearest"}
    image = placed(windows[2], image)
    inner = placed(windows[1], {"type": "checkerboard", "color0": 0.75, "color1": image})
    board = placed(windows[0], {"type": "checkerboard", "color0": image, "color1": inner})
    cuts = [
        np.concatenate([lines(w, k, n) for w, n in ((windows[0], 2), (windows[1], 2))]
                       + [lines(windows[2], k, (5, 3)[k]), np.array([0.0, 1.0])])
        for k in range(2)
    ]  # fmt: skip
    u, v = (np.unique(cut[(cut >= 0) & (cut <= 1)]) for cut in cuts)
    x, y = np.meshgrid((u[1:] + u[:-1]) / 2, (v[1:] + v[:-1]) / 2)
    area = np.diff(v)[:, None] * np.diff(u)

    def at(w: tuple[float, ...]) -> tuple[Array, Array]:
        return np.mod(w[0] * x + w[2], 1), np.mod(w[1] * y + w[3], 1)

    def first(w: tuple[float, ...]) -> Array:
        a, b = at(w)
        return ((a > 0.5) == (b > 0.5)) != number

    column, row = at(windows[2])
    texel = codes[np.floor(3 * row).astype(int), np.floor(5 * column).astype(int)] / 255
    shown = np.where(first(windows[1])[..., None], 0.75, texel)
    shown = np.where(first(windows[0])[..., None], texel, shown)
    mean = (area[..., None] * shown).sum(axis=(0, 1))
    if number:
        t.agrees(seen({"type": "mask", "opacity": board, "bsdf": BLACK}), 1 - mean[0], 2_000_000,
                 sees=0.01)  # fmt: skip
        return
    t.agrees(seen({"type": "diffuse", "reflectance": board}), mean, 2_000_000, sees=0.01)


#: Vertices of a mesh that its picture, the square of half side 1 about (0, 0), does not show whole.
CORNERS = np.array([[-3, -2], [2, -3], [3, 3], [-2, 2], [0.3, -0.2]], np.float64)
FACES = np.array([[0, 1, 4], [1, 2, 4], [2, 3, 4], [3, 0, 4]])


@functools.cache
def on_mesh(of: str, side: int = 2000) -> Array:
    """The weights of numbers of vertices or faces in the mean over the square, by midpoints, which
    miss edges of faces by 1e-4 at most."""
    ticks = (np.arange(side) + 0.5) * 2 / side - 1
    x, y = np.meshgrid(ticks, ticks)
    total = np.zeros(len(CORNERS if of == "vertex" else FACES))
    for number, corners in enumerate(FACES):
        (ax, ay), (bx, by), (cx, cy) = CORNERS[corners]
        area = (bx - ax) * (cy - ay) - (cx - ax) * (by - ay)
        b = ((x - ax) * (cy - ay) - (cx - ax) * (y - ay)) / area
        c = ((bx - ax) * (y - ay) - (x - ax) * (by - ay)) / area
        inside = (b >= 0) & (c >= 0) & (b + c < 1)
        if of == "face":
            total[number] = inside.sum()
            continue
        for weight, corner in zip((1 - b - c, b, c), corners, strict=True):
            total[corner] += weight[inside].sum()
    return total / side**2


@case(3, each={"of": ("vertex", "face"), "tree": (False, True), "one": (False, True)})
def plane_with_attributes(t: Trial, of: str, tree: bool, one: bool) -> None:
    """A plane of triangles with numbers of its vertices or faces in a sky of 1: their mean.

    tree: below other spheres, too many to be tested one by one. one: a number each. Sees 1 %.
    """
    values = t.rng.random((len(CORNERS if of == "vertex" else FACES), 1 if one else 3))
    name = f"{of}_color"
    mesh = {
        "type": "mesh",
        "vertices": np.column_stack([CORNERS, np.zeros(len(CORNERS))]),
        "faces": FACES,
        name: values,
        "bsdf": {"type": "diffuse", "reflectance": {"type": "mesh_attribute", "name": name}},
    }
    half = math.degrees(math.atan(1 / 3))
    balls = [
        {"type": "sphere", "center": [0.1 * k, 0.0, -1.0], "radius": 0.05} for k in range(99 * tree)
    ]
    shown = scene(view([0, 0, 3], [0, 0, 0], 2 * half), mesh, *balls, sky(1), max_depth=2)
    exact = on_mesh(of) @ np.broadcast_to(values, (len(values), 3))
    t.agrees(shown, exact, 2_000_000, sees=0.01, margin=2e-4)
