"""Lamps, spots and projectors with textures against quadrature in float64 and closed forms."""

from __future__ import annotations

import functools
import math
from collections.abc import Callable, Iterator
from typing import Any

import numpy as np
import numpy.typing as npt

import veriray
from veriray_validate.dicts import BLACK, Dict, diffuse, flat, look, rgb, scene, view
from veriray_validate.levels.closed_textures import KINDS, WINDOWS, WRAPS, box, placed, shares, tent
from veriray_validate.trial import Trial, case

Array = npt.NDArray[Any]
STEPS = 1200  # of the midpoint rule along an axis of a lamp
ALBEDO = 0.5


def one_texel() -> Array:
    """Black but for one texel, far above 1."""
    texels = np.zeros((6, 7, 3), np.float32)
    texels[4, 1] = 300, 200, 100
    return texels


IMAGES = {
    "noise": np.random.default_rng(9).uniform(0.1, 4, (3, 5, 3)).astype(np.float32),
    "one texel": one_texel(),
}


def bitmap(texels: Array, **more: Any) -> Dict:
    """A texture of these texels; those above 1 are for lights alone."""
    return {"type": "bitmap", "bitmap": texels, **more}


def between(at: Array, size: int) -> Array:
    """Weights (n, size) of the texels of a row at coordinates (n,), interpolated and repeated."""
    x = at * size - 0.5
    i, row = np.floor(x).astype(int), np.arange(len(at))
    weights = np.zeros((len(at), size))
    weights[row, i % size] += 1 - (x - i)
    weights[row, (i + 1) % size] += x - i
    return weights


#: Places (..., 3) of a lamp and their area vectors from u and v in [0, 1], its own texture
#: coordinates.
Surface = Callable[[Array, Array], tuple[Array, Array]]


def rectangle(m: Array) -> Surface:
    """Under to_world."""

    def at(u: Array, v: Array) -> tuple[Array, Array]:
        p = m[:3, 3] + (2 * u - 1)[..., None] * m[:3, 0] + (2 * v - 1)[..., None] * m[:3, 1]
        return p, np.broadcast_to(4 * np.cross(m[:3, 0], m[:3, 1]), p.shape)

    return at


def disk(m: Array) -> Surface:
    """Under to_world: u is the distance from the centre, v the angle."""

    def at(u: Array, v: Array) -> tuple[Array, Array]:
        x, y = u * np.cos(2 * math.pi * v), u * np.sin(2 * math.pi * v)
        p = m[:3, 3] + x[..., None] * m[:3, 0] + y[..., None] * m[:3, 1]
        return p, 2 * math.pi * u[..., None] * np.cross(m[:3, 0], m[:3, 1])

    return at


def ball(m: Array) -> Surface:
    """Under to_world, which scales alike in all directions."""

    def at(u: Array, v: Array) -> tuple[Array, Array]:
        polar, turn = math.pi * v, 2 * math.pi * u
        local = np.stack(
            [np.sin(polar) * np.cos(turn), np.sin(polar) * np.sin(turn), np.cos(polar)], axis=-1
        )
        away = local @ m[:3, :3].T
        radius = float(np.linalg.norm(m[:3, 0]))
        return m[:3, 3] + away, away * (2 * math.pi**2 * radius * np.sin(polar))[..., None]

    return at


def parts(lamp: str) -> Iterator[tuple[Array, Array, Array, Array]]:
    """Coordinates u (m,) and v (n,) of parts of a lamp, the places there (n, m, 3), and what they
    give, per radiance, to a patch at the origin with the normal +z: the midpoint rule."""
    middle = (np.arange(STEPS) + 0.5) / STEPS
    for v in np.array_split(middle, 48):
        u, rows = np.meshgrid(middle, v)
        p, area = LAMPS[lamp][1](u, rows)
        square, facing = (np.einsum("vuk,vuk->vu", p, q) for q in (p, area))
        given = np.maximum(p[..., 2], 0) * np.maximum(-facing, 0) / square**2
        yield middle, v, p, given / STEPS**2


@functools.cache
def irradiance(lamp: str, image: str) -> Array:
    """What a lamp gives to the patch, off by 2e-6."""
    texels = IMAGES[image].astype(np.float64)
    height, width, _ = texels.shape
    total = np.zeros((height, width))
    for u, v, _, given in parts(lamp):
        total += between(v, height).T @ given @ between(u, width)
    return np.einsum("vu,vuc->c", total, texels)


def turned(height: float, half: float, aside: float = 0.0) -> Array:
    """to_world of a lamp over the origin that faces down, turned about its normal."""
    c, s = math.cos(0.7), math.sin(0.7)
    m = np.eye(4)
    m[:3] = np.array([[c * half, s * half, 0, aside], [s * half, -c * half, 0, 0.1 * aside],
                      [0, 0, -half, height]])  # fmt: skip
    return m


def grid(m: Array, n: int) -> Dict:
    """A rectangle as a mesh of n x n squares, with its coordinates."""
    edge = np.linspace(0, 1, n + 1)
    uv = np.stack(np.meshgrid(edge, edge), axis=-1).reshape(-1, 2)
    local = np.column_stack([2 * uv - 1, np.zeros(len(uv)), np.ones(len(uv))])
    first = (np.arange(n)[:, None] * (n + 1) + np.arange(n)).ravel()
    corners = np.array([[0, 1, n + 2], [0, n + 2, n + 1]])
    faces = (first[:, None, None] + corners).reshape(-1, 3)
    return {"type": "mesh", "vertices": (local @ m.T)[:, :3], "faces": faces, "uv": uv,
            "face_normals": True}  # fmt: skip


FAR, NEAR, ASIDE = turned(3, 1), turned(0.25, 1), turned(1.2, 0.8, 1.5)
#: Lamps: the shape, and what it is in the quadrature. The near rectangles are sampled by solid
#: angle; a grid of 12 squares a side has a tree.
LAMPS: dict[str, tuple[Dict, Surface]] = {
    "rectangle": ({"type": "rectangle", "to_world": FAR}, rectangle(FAR)),
    "rectangle aside": ({"type": "rectangle", "to_world": ASIDE}, rectangle(ASIDE)),
    "near rectangle": ({"type": "rectangle", "to_world": NEAR}, rectangle(NEAR)),
    "disk": ({"type": "disk", "to_world": ASIDE}, disk(ASIDE)),
    "sphere": ({"type": "sphere", "to_world": ASIDE}, ball(ASIDE)),
    "mesh": (grid(ASIDE, 2), rectangle(ASIDE)),
    "mesh in a tree": (grid(ASIDE, 12), rectangle(ASIDE)),
    "near mesh in a tree": (grid(NEAR, 12), rectangle(NEAR)),
}


@case(3, each={"lamp": LAMPS, "image": IMAGES},
      quick=lambda lamp, image: (list(LAMPS).index(lamp) + (image == "noise")) % 2)  # fmt: skip
def textured_lamp_over_a_patch(t: Trial, lamp: str, image: str) -> None:
    """A point under a lamp with a bitmap: rho E / pi, with E by quadrature over the bitmap.

    Flat lamps by area and by solid angle, spheres, meshes, with and without a tree. Of the second
    image one texel of 42 shines. Sees 2 %.
    """
    light = {"type": "area", "radiance": bitmap(IMAGES[image])}
    shining = {**LAMPS[lamp][0], "bsdf": BLACK, "emitter": light}
    ground = flat("rectangle", [0, 0, 0], [0, 0, 1], 0.5, diffuse(ALBEDO))
    eye = view([-0.35, 0.2, 0.08], [0, 0, 0])
    exact = ALBEDO / math.pi * irradiance(lamp, image)
    spp = 1_000_000 if image == "noise" else 4_000_000
    t.agrees(scene(eye, ground, shining, max_depth=2), exact, spp, sees=0.02)


@case(3, each={"lamp": LAMPS}, quick=lambda lamp: list(LAMPS).index(lamp) % 2 == 0)
def lamp_in_a_grid(t: Trial, lamp: str) -> None:
    """A point under a lamp whose radiance a grid in space gives where each point of it is: rho E /
    pi, with E by quadrature. Eight cells around the lamp, interpolated. Sees 2 %."""
    cells = t.rng.uniform(0, 4, (2, 2, 2, 3)).astype(np.float32)  # (z, y, x, channels)
    low, size = np.array([0.2, -0.6, -0.7]), np.array([2.5, 1.4, 2.6])
    box = np.diag([*size, 1.0])
    box[:3, 3] = low
    exact = np.zeros(3)
    for _, _, p, given in parts(lamp):
        share = np.clip(2 * (p - low) / size - 0.5, 0, 1)  # of the upper cell of each axis
        for x, y, z in np.ndindex(2, 2, 2):
            weight = np.prod(np.where([x, y, z], share, 1 - share), axis=-1)
            exact += (given * weight).sum() * cells[z, y, x]
    light = {"type": "area", "radiance": {"type": "volume", "v": {
        "type": "gridvolume", "data": cells, "raw": True, "to_world": box}}}  # fmt: skip
    shining = {**LAMPS[lamp][0], "bsdf": BLACK, "emitter": light}
    ground = flat("rectangle", [0, 0, 0], [0, 0, 1], 0.5, diffuse(ALBEDO))
    seen = scene(view([-0.35, 0.2, 0.08], [0, 0, 0]), ground, shining, max_depth=2)
    t.agrees(seen, ALBEDO / math.pi * exact, 1_000_000, sees=0.02)


@case(3, each={"wrap": WRAPS, "window": WINDOWS, "kind": KINDS},
      quick=lambda wrap, window, kind: list(KINDS).index(kind) ==
      (2 * WRAPS.index(wrap) + list(WINDOWS).index(window)) % 6)  # fmt: skip
def textured_lamp_seen(t: Trial, wrap: str, window: str, kind: str) -> None:
    """A square that shines by a random bitmap, and no other light: the mean of what is seen of it.

    As `plane_with_a_bitmap`. Sees 1 %.
    """
    codes = t.rng.integers(20, 256, (3, 5, 3))
    image = KINDS[kind](codes)
    table = veriray.formats.images.BYTE_TO_SHARE
    texels = image.astype(np.float64)
    if image.dtype == np.uint8:
        table = table if kind == "raw" else veriray.formats.images.SRGB_TO_LINEAR
        texels = table[image].astype(np.float64)
    u, v, left, low = WINDOWS[window]
    kernels = shares(3, low, low + v, wrap, tent), shares(5, left, left + u, wrap, tent)
    exact = np.einsum("v,u,vuc->c", *kernels, texels)
    texture = placed(WINDOWS[window], bitmap(image, wrap_mode=wrap, raw=kind == "raw"))
    half = math.degrees(math.atan(1 / 3))
    square = flat("rectangle", [0, 0, 0], [0, 0, 1], 1, BLACK)
    square["emitter"] = {"type": "area", "radiance": texture}
    eye = view([0, 0, 3], [0, 0, 0], 2 * half)
    t.agrees(scene(eye, square, max_depth=2), exact, 2_000_000, sees=0.01)


@case(3, once=True)
def kernels_agree(t: Trial) -> None:
    """The interpolation here against the integral of its kernel, of closed_textures."""
    texels = np.random.default_rng(3).uniform(0, 1, (3, 5, 3))
    middle = (np.arange(2000) + 0.5) / 2000
    along, down = (between(middle, size).mean(axis=0) for size in (5, 3))
    mean = np.einsum("v,u,vuc->c", down, along, texels)
    exact = np.einsum(
        "v,u,vuc->c", shares(3, 0, 1, "repeat", tent), shares(5, 0, 1, "repeat", tent), texels
    )
    t.check(np.abs(mean - exact).max() < 1e-6, f"off by {np.abs(mean - exact).max():.2g}")
    t.check(np.abs(shares(4, 0, 1, "clamp", box) - 0.25).max() < 1e-12)


# ---- projectors ----

TEXELS = (np.arange(1, 16).reshape(3, 5, 1) * np.array([1.0, 0.5, 0.25]) / 8).astype(np.float32)


def projector(place: Array, fov: float, irradiance: Any, **more: Any) -> Dict:
    """A projector."""
    return {"type": "projector", "to_world": place, "fov": fov, "irradiance": irradiance, **more}


@case(
    3, each={"fov": (0.05, 2.0, 40.0, 165.0), "axis": ("x", "y"), "distance": (0.125, 1.0, 900.0)}
)
def projected_picture(t: Trial, fov: float, axis: str, distance: float) -> None:
    """A screen across a projector's axis, seen from where that stands: the picture itself.

    Each pixel is a texel over the squared distance, without noise; the film of 5 x 3 pixels is what
    the projector lights. The middles of pixels are seen, from a film of 15 x 9.
    """
    place = look([3, -2, 1], [3.6, -2, 1.8])
    to = place[:3, 2]
    screen = flat("rectangle", place[:3, 3] + distance * to, -to, 30 * distance, diffuse(1))
    lamp = projector(place, fov, bitmap(TEXELS, filter_type="nearest"), scale=3.0, fov_axis=axis)
    eye = {**view([0, 0, 0], [0, 0, 1], fov, (15, 9), fov_axis=axis), "to_world": place}
    image = t.render(scene(eye, screen, lamp, max_depth=2), 16).image[1::3, 1::3]
    exact = 3 * TEXELS / distance**2
    off = np.abs(image / exact - 1).max()
    t.check(off < 2e-5, f"off by {off:.2g}")


def shows(t: Trial, seen: veriray.Scene, exact: Array, margin: float) -> None:
    """Checks a picture of one point, which has no noise: to `margin`, relative; 0 exactly."""
    found = t.render(seen, 4).image[0, 0].astype(np.float64)
    t.check(np.abs(found - exact) <= margin * exact, f"{found} for {exact}")


@case(3, each={"fov": (0.05, 2.0, 60.0), "axis": ("x", "smaller", "larger", "diagonal")})
def edge_of_a_projection(t: Trial, fov: float, axis: str) -> None:
    """What a projector of one colour gives to a tilted screen, close to its edges: nothing beyond.

    The image is square, so that all but the diagonal agree. Inside by 1e-3 of its width, irradiance
    over pi is (1 + x^2 + y^2) / z^2 times the cosine there, for the point (x, y, 1) z.
    """
    half = math.tan(math.radians(fov) / 2) / (math.sqrt(2) if axis == "diagonal" else 1)
    normal = np.array([0.36, 0.48, -0.8])
    lamp = projector(np.eye(4), fov, rgb([1, 2, 3]), fov_axis=axis)
    screen = flat("rectangle", [0, 0, 2], normal, 9, diffuse(1))
    beyond = [(1.002, 0.0), (-1.002, 0.0), (0.0, 1.002), (0.0, -1.002)]
    for x, y in [(0.0, 0.0), (0.998, 0.3), (-0.998, 0.998), (0.2, -0.998), *beyond]:
        d = np.array([x * half, y * half, 1.0])
        p = d * (2 * normal[2] / (normal @ d))
        cosine = -(normal @ d) / np.linalg.norm(d)
        share = (d @ d) ** 1.5 / (p @ p) * cosine if max(abs(x), abs(y)) < 1 else 0.0
        eye = view(p + normal - 0.2 * p, p, 1e-6 * fov)
        shows(t, scene(eye, screen, lamp, max_depth=2), share * np.array([1, 2, 3]), 2e-5)


# ---- spots ----


@case(3, each={"cutoff": (0.1, 5.0, 30.0, 80.0), "mirrored": (False, True)})
def textured_spot(t: Trial, cutoff: float, mirrored: bool) -> None:
    """Points of a screen under a spot with a bitmap: its intensity times the texel there.

    The bitmap covers the square about the cone; mirrored: by a to_world with a reflection. To 2e-5;
    in the narrowest cone, whose edge is as wide as 7,000 units of a direction's rounding, to 1e-4.
    """
    place = look([0, 0, 0], [0.48, -0.64, 0.6])
    if mirrored:
        place = place @ np.diag([-1.0, 1, 1, 1])
    lamp = {"type": "spot", "to_world": place, "intensity": rgb([4, 5, 6]), "cutoff_angle": cutoff,
            "beam_width": 0.75 * cutoff,
            "texture": bitmap(TEXELS, filter_type="nearest", wrap_mode="clamp")}  # fmt: skip
    width, n = math.tan(math.radians(cutoff)), place[:3, 2]
    screen = flat("rectangle", 2 * n, -n, 30, diffuse(1))
    for x, y in ((0.1, 0.05), (-0.5, 0.1), (0.5, 0.6), (-0.1, -0.7), (0.8, -0.4), (0.8, 0.8)):
        local = np.array([x * width, y * width, 1.0])
        p = 2 * place[:3, :3] @ local
        angle = math.degrees(math.atan(width * math.hypot(x, y)))
        falloff = min(max((cutoff - angle) / (0.25 * cutoff), 0.0), 1.0)
        texel = TEXELS[min(int((1 + y) / 2 * 3), 2), min(int((1 + x) / 2 * 5), 4)]
        cosine = 1 / np.linalg.norm(local)
        exact = np.array([4, 5, 6]) * texel * falloff * cosine / (p @ p) / math.pi
        eye = view(p - 0.3 * n + 0.1 * p / np.linalg.norm(p), p, 1e-6 * cutoff)
        shows(t, scene(eye, screen, lamp, max_depth=2), exact, 1e-4 if cutoff < 1 else 2e-5)
