"""Rules about materials: what they reflect, and from which side they are seen."""

from __future__ import annotations

import math
from collections.abc import Callable

import numpy as np

from .. import limits
from ..camera import Camera
from ..columns import COLUMNS, SCATTERING_KINDS, TEXTURE_FORMATS, TEXTURE_KINDS, WHOLE_KINDS
from ..scene import Scene
from .look import Array, Finding, Look

#: Cosines of the directions from which materials are lit, and samples for each of 8 x 8 pixels.
COSINES, FURNACE_SPP = (1.0, 0.7, 0.4, 0.2, 0.1), 256
#: Most materials that are tried in a furnace.
MOST_FURNACES = 64
#: Standard errors, and share, above 1 that count: one false alarm in 10^9 materials.
SIGMAS, SHARE = 7.0, 2e-3
#: Rays of a camera of SIDE x SIDE that must see a back.
BACKS = 12
#: Share of texels at the end of their range.
CLIPPED = 0.1
_KEEP = ("reflectance", "specular_reflectance", "specular_transmittance")


def changed(look: Look) -> list[Finding]:
    """What was rendered with other numbers, as the reader of the file warned."""
    reason = "the picture is that of the scene as read, not as written"
    found = []
    for place, text in look.scene.__dict__.get("_warned", ()):
        found.append(Finding("changed", "", place, text, reason))
    return found


def black(look: Look) -> list[Finding]:
    """Materials of surfaces that do not shine and give back no light at all."""
    scene, found = look.scene, []
    used = set(look.material[look.emission < 0].tolist())
    for row in sorted(used):
        names: tuple[str, ...] = _KEEP[:1]
        if look.kind[row] in ("conductor", "roughconductor", "roughconductor_whole"):
            names = ("specular_reflectance",)
        elif look.kind[row] in (
            "dielectric", "roughdielectric", "roughdielectric_whole", "thindielectric",
        ):  # fmt: skip
            names = _KEEP[1:]
        elif look.kind[row] not in ("diffuse", "plastic", "roughplastic"):
            continue
        if look.kind[row] in ("plastic", "roughplastic"):
            names = _KEEP[:2]
        if scene.opacity[row] < 1 or scene.opacity_texture[row] >= 0:
            continue
        if scene.blend_material[row] >= 0:
            continue
        dark = all(
            not np.asarray(getattr(scene, name))[row].any()
            and getattr(scene, f"{name}_texture")[row] < 0
            for name in names
        )
        if dark:
            text = f"{' and '.join(names)} {'is' if len(names) == 1 else 'are'} 0"
            reason = "it absorbs all light: only its outline can be seen"
            found.append(look.found("black-surface", "material_kind", row, text, reason))
    return found


def backs(look: Look) -> list[Finding]:
    """Opaque surfaces that scatter on their front alone, in view from behind."""
    _, primitive, behind = look.camera_hits
    seen = primitive >= 0
    one_sided = np.zeros(len(primitive), np.bool_)
    material = look.material[primitive[seen]]
    one_sided[seen] = look.opaque[material] & ~np.asarray(look.scene.two_sided)[material]
    one_sided[seen] &= look.emission[primitive[seen]] < 0
    bad = seen & one_sided & behind
    found = []
    for shape in np.unique(look.shape[primitive[bad]]).tolist():
        mine = bad & (look.shape[np.maximum(primitive, 0)] == shape)
        if mine.sum() >= BACKS:
            text = f"{mine.mean():.1%} of the picture shows its back, which is black"
            reason = (
                "an opaque surface scatters on its front alone: put it into twosided, or turn it "
                "by flip_normals"
            )
            first = int(primitive[np.flatnonzero(mine)[0]])
            found.append(look.of_primitive("black-back", first, text, reason))
    return found


def albedo(look: Look) -> list[Finding]:
    """Diffuse reflectances and albedos of media that are 1 or more in some channel."""
    scene, found = look.scene, []
    reason = (
        "no matter gives back all light (fresh snow 0.98); between such surfaces paths have no end "
        "but roulette, and the light of a closed room has none"
    )
    for row in np.unique(look.material[look.emission < 0]).tolist():
        if look.kind[row] not in SCATTERING_KINDS or look.kind[row] in (
            "roughconductor", "roughdielectric", *WHOLE_KINDS.values(),
        ):  # fmt: skip
            continue
        if scene.metallic[row] or scene.spec_trans[row]:
            continue  # a metal or glass may be clear
        value = np.asarray(scene.reflectance)[row]
        if value.max() >= 1 and scene.reflectance_texture[row] < 0:
            text = f"reflectance {_colour(value)} reflects all light"
            found.append(look.found("albedo", "material_kind", row, text, reason))
    for row in range(len(scene.sigma_t)):
        value = np.asarray(scene.albedo)[row]
        if value.max() >= 1 and scene.albedo_grid[row] < 0 and scene.sigma_t[row].any():
            text = f"albedo {_colour(value)} scatters all light"
            found.append(look.found("albedo", "sigma_t", row, text, reason))
    return found


def energy(look: Look) -> list[Finding]:
    """Principled materials in a furnace: a sky of 1, on a plate, must not look brighter than 1."""
    names = ("principled", "principledthin")
    rows = [row for row in np.unique(look.material).tolist() if look.kind[row] in names]
    if len(rows) > MOST_FURNACES:
        look.skipped.append(
            f"energy: the first {MOST_FURNACES} of {len(rows)} principled materials were examined"
        )
    found = []
    for row in rows[:MOST_FURNACES]:
        worst, at = max((furnace(look.scene, row, cosine), cosine) for cosine in COSINES)
        if worst > 1 + SHARE:
            degrees = math.degrees(math.acos(at))
            text = f"at {degrees:.0f} degrees it gives back {worst:.3g} of the light"
            reason = (
                "more than it gets: sheen and coats are added to what lies below; between such "
                "surfaces light grows"
            )
            found.append(look.found("energy", "material_kind", row, text, reason))
    return found


def furnace(scene: Scene, material: int, cosine: float) -> float:
    """A lower bound of the light that a plate of a material gives back under a sky of 1, seen at an
    angle of this cosine, in its brightest channel: the mean less SIGMAS standard errors."""
    from ..rendering import render

    sine = math.sqrt(1 - cosine * cosine)
    eye = (0.0, -4.0 * sine, 4.0 * cosine)
    matrix = Camera.look_at(eye, (0, 0, 0), (0, cosine, sine)).to_world @ np.diag(
        [0.9 * cosine, 0.9 * cosine, 1.0, 1.0]
    )
    kept = ("materials", "textures", "texels", "attributes")
    arrays = {n: getattr(scene, n) for n, column in COLUMNS.items() if column.table in kept}
    for name in arrays:
        if name.startswith("relief_texture"):  # a turned normal loses light, and gains none
            arrays[name] = np.full_like(arrays[name], -1)
    attributes = np.asarray(scene.texture_kind)
    if np.isin(
        attributes, [TEXTURE_KINDS.index(f"{x}_attribute") for x in ("vertex", "face")]
    ).any():
        return 0.0  # they belong to meshes that are not here
    corners = np.array([[-1, -1, 0], [1, -1, 0], [1, 1, 0], [-1, 1, 0]], np.float64)
    plate = Scene(
        **arrays,
        vertices=corners,
        uv=(corners[:, :2] + 1) / 2,
        triangles=np.array([[0, 1, 2], [0, 2, 3]]),
        triangle_material=np.array([material] * 2),
        environment=np.ones(3),
        camera=Camera.orthographic(matrix),
        film=scene.film,
    ).with_(width=8, height=8, filter="box")
    picture = render(plate, FURNACE_SPP, device="cpu", max_depth=-1)
    error = np.sqrt((picture.stderr.astype(np.float64) ** 2).sum(axis=(0, 1))) / 64
    return float((picture.image.mean(axis=(0, 1), dtype=np.float64) - SIGMAS * error).max())


def clipped(look: Look) -> list[Finding]:
    """Bitmaps of surfaces of which much is white: an overexposed photograph."""
    scene, found = look.scene, []
    if not len(scene.texture_kind):
        return []
    rows = np.unique(np.asarray(scene.reflectance_texture)[np.unique(look.material)])
    for row in rows[rows >= 0].tolist():
        if scene.texture_kind[row] != TEXTURE_KINDS.index("bitmap"):
            continue
        share = _share_of_ones(scene, row)
        if share > CLIPPED:
            text = f"{share:.0%} of its texels are 1 in some channel"
            reason = (
                "1 reflects all light, which no matter does; a photograph that is cut there has "
                "lost what was brighter"
            )
            found.append(look.found("clipped-texture", "texture_kind", row, text, reason))
    return found


def _share_of_ones(scene: Scene, row: int) -> float:
    """The share of a bitmap's texels whose largest channel is 1."""
    layout = TEXTURE_FORMATS[int(scene.texture_format[row])]
    kind, channels = {"half": ("<f2", 4), "float": ("<f4", 3)}.get(layout, ("u1", 4))
    channels = 1 if scene.texture_grey[row] else channels
    count = int(scene.texture_width[row]) * int(scene.texture_height[row])
    first, size = int(scene.texture_first[row]), count * channels * np.dtype(kind).itemsize
    words = np.ascontiguousarray(scene.texels[first : first + -(-size // 4)], "<u4")
    texels = words.view(kind)[: count * channels].reshape(count, channels)[:, :3]
    return float((texels.max(axis=1) >= (255 if kind == "u1" else 1)).mean())


def touching(look: Look) -> list[Finding]:
    """Opaque faces that look the same way in one plane, one over the other: the first is seen."""
    scene = look.scene
    if not 1 < len(scene.triangles) <= limits.MOST_TRIANGLES:
        if len(scene.triangles) > 1:
            look.skipped.append(f"touching: more than {limits.MOST_TRIANGLES:,} triangles")
        return []
    rows = np.flatnonzero(look.opaque[look.material[: look.counts[0]]])
    found: dict[tuple[int, int], Finding] = {}
    for a, b, _ in limits.parallel_pairs(scene, look.origin, rows, -1.0, 1e-12, same_side=True):
        first, second = min(a, b), max(a, b)
        shapes = int(look.shape[first]), int(look.shape[second])
        alike = look.material[first] == look.material[second]
        if shapes[0] == shapes[1] or shapes in found:
            continue
        if alike and look.emission[first] == look.emission[second] or _same(scene, first, second):
            continue  # nothing to see; or a duplicate
        text = (
            f"in one plane with {look.shape_name(shapes[0])}, and overlapping: where both are, "
            "that one is seen"
        )
        reason = "two surfaces cannot be in one place; the first in the file wins"
        found[shapes] = look.of_primitive("touching", second, text, reason)
    return list(found.values())


def _same(scene: Scene, a: int, b: int) -> bool:
    corners = [np.asarray(scene.vertices)[np.asarray(scene.triangles)[k]] for k in (a, b)]
    ordered: list[Array] = [x[np.lexsort(x.T)] for x in corners]
    return bool((ordered[0] == ordered[1]).all())


def _colour(value: Array) -> str:
    values = [f"{x:.4g}" for x in value.tolist()]
    return values[0] if len({*values}) == 1 else f"({', '.join(values)})"


CHECKS: tuple[Callable[[Look], list[Finding]], ...] = (
    black, backs, albedo, energy, clipped, touching,
)  # fmt: skip
