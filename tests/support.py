"""Small scenes, native hooks and the statistical rules shared by the tests.

Rules (of every statistical test here): a first stage at false-alarm rate 1e-3; if it fails, one
confirmation with four times the samples and a fresh seed at 1e-4; red means that both failed, which
a sound program does once in 1e7. A float32 renderer has a true bias of about 1e-6, so estimates may
differ from exact values by a relative margin, 1e-5 unless stated, on top.
"""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import numpy.typing as npt
from scipy import stats

import veriray
from veriray import device as device_module
from veriray.columns import COLUMNS, LIGHT_KINDS, MATERIAL_KINDS, REQUIRED
from veriray.render import native_scene_arguments

Array = npt.NDArray[Any]
_USABLE, _ = device_module.survey()
_CPU = [d.name for d in _USABLE if d.backend == "cpu"]
_CUDA = [d.name for d in _USABLE if d.backend == "cuda"]
#: The fastest CPU device and every GPU: enough where tests/equivalence proves the others equal.
FAST = _CPU[:1] + _CUDA

FIRST, SECOND = 1e-3, 1e-4
MARGIN = 1e-5


# ---- statistics ----


def confirm(p_value: Callable[[int, int], float]) -> None:
    """Two-stage test. p_value(effort, seed) runs the test with `effort` times its samples."""
    first = p_value(1, 1)
    if first < FIRST:
        second = p_value(4, 0x5EED)
        assert second >= SECOND, f"p = {first:.2g}, with 4 times the samples {second:.2g}"


def sidak(p: float, tests: int) -> float:
    """The p value of the smallest of `tests` independent p values."""
    return float(-np.expm1(tests * np.log1p(-min(p, 1.0)))) if p < 1 else 1.0


def max_z(z: Array) -> float:
    """p value of the largest |z| of independent standard normals."""
    return sidak(2 * float(stats.norm.sf(np.abs(z).max())), np.size(z))


def pooled(observed: Array, expected: Array, least: float = 10.0) -> tuple[Array, Array]:
    """Cells joined in order of expectation until each expects at least `least`; none is lost."""
    order = np.argsort(expected.ravel(), kind="stable")
    groups = np.floor(np.cumsum(expected.ravel()[order]) / least).astype(np.int64)
    starts = np.flatnonzero(np.diff(groups, prepend=-1))
    o = np.add.reduceat(observed.ravel()[order], starts).astype(np.float64)
    e = np.add.reduceat(expected.ravel()[order], starts).astype(np.float64)
    if len(e) > 1 and e[-1] < least:
        o[-2:], e[-2:] = o[-2:].sum(), e[-2:].sum()
        o, e = o[:-1], e[:-1]
    low = np.flatnonzero(e < least)
    if len(low) and len(e) > 1:  # a thin group joins its neighbour
        keep = np.ones(len(e), bool)
        for i in low:
            j = i + 1 if i + 1 < len(e) else i - 1
            o[j] += o[i]
            e[j] += e[i]
            keep[i] = False
        o, e = o[keep], e[keep]
    return o, e


def chi_square(observed: Array, expected: Array) -> float:
    """p value of counts against expectations with the same total; a hit in an empty cell is 0."""
    if (observed[expected == 0] > 0).any():
        return 0.0
    o, e = pooled(np.asarray(observed), np.asarray(expected))
    if len(e) < 2:
        return 1.0
    return float(stats.chi2.sf(((o - e) ** 2 / e).sum(), len(e) - 1))


def grids(u: Array, v: Array) -> float:
    """Uniformity of points in the unit square: three grids, coarse to fine, over the same points.

    Points outside the square are a failure. Sidak over the three.
    """
    if not ((u >= 0) & (u <= 1) & (v >= 0) & (v <= 1)).all():
        return 0.0
    worst = 1.0
    for m, n in ((1, 8), (8, 4), (16, 32)):
        i = np.minimum((u * m).astype(np.int64), m - 1)
        j = np.minimum((v * n).astype(np.int64), n - 1)
        counts = np.bincount(i * n + j, minlength=m * n)
        worst = min(worst, chi_square(counts, np.full(m * n, len(u) / (m * n))))
    return sidak(worst, 3)


def agrees(
    scene: veriray.Scene,
    exact: float | Sequence[float] | Array,
    device: str,
    spp: int,
    sees: float,
    margin: float = MARGIN,
    **settings: Any,
) -> veriray.Render:
    """Asserts that a render's pixels equal `exact` (broadcast to the image); returns the render.

    Statistic: the largest |z| over pixels and channels that differ in their expectation, Sidak.
    `sees`: relative bias of the image mean that is found with 90 % power; asserted, so that a test
    that has become too noisy is not taken for a pass.
    """
    truth = np.broadcast_to(np.asarray(exact, np.float64), (scene.film.height, scene.film.width, 3))
    results: list[veriray.Render] = []

    def p_value(effort: int, seed: int) -> float:
        r = veriray.render(scene, spp=spp * effort, seed=seed, device=device, **settings)
        results.append(r)
        assert r.stats["nonfinite_samples"] == 0
        ledger_adds_up(r)
        off = np.maximum(np.abs(r.image - truth) - margin * truth, 0)
        error = r.stderr.astype(np.float64)
        still = error == 0
        if (off[still] > 0).any():
            return 0.0
        # samples seen in effect, at least 1,000: the normal law holds
        mean, n = r.image[~still].astype(np.float64), spp * effort
        second = error[~still] ** 2 * (n - 1) + mean**2
        assert (n * mean**2 >= 1000 * second).all() or not mean.any(), "inconclusive: raise spp"
        if still.all():
            return 1.0
        z = off[~still] / error[~still]
        return sidak(2 * float(stats.norm.sf(z.max())), len(np.unique(z)))

    confirm(p_value)
    r = results[0]
    if truth.mean() > 0:
        error = math.sqrt(float((r.stderr.astype(np.float64) ** 2).mean()) / (r.image.size / 3))
        found = (3.29 + 1.28) * error / float(truth.mean()) + margin
        assert found <= sees, f"inconclusive: sees {found:.2g}, wanted {sees:.2g}"
    return r


def ledger_adds_up(r: veriray.Render) -> None:
    """live[d] = ends[d] + live[d + 1], and live[0] = pixels * spp, exactly."""
    ledger = r.stats["ledger"]
    ends = "escaped emitter_end absorbed rr_killed depth_cut invalid".split()
    live = [*ledger["live"], 0]
    assert live[0] == r.width * r.height * r.spp
    for d in range(len(live) - 1):
        assert live[d] == sum(ledger[name][d] for name in ends) + live[d + 1], f"depth {d}"


# ---- scenes ----


@dataclass(frozen=True)
class Medium:
    """A homogeneous medium: extinction per length, albedo (one number or three), asymmetry."""

    sigma_t: Any
    albedo: Any = 0.0
    g: float = 0.0

    def __post_init__(self) -> None:
        for name in ("sigma_t", "albedo"):
            value = np.broadcast_to(np.asarray(getattr(self, name), np.float64), 3)
            object.__setattr__(self, name, tuple(value.tolist()))


def material(kind: str, **columns: Any) -> dict[str, Any]:
    """A material by its kind, with columns of veriray.Scene: eta, k, specular_reflectance ...

    Given as `material=` of a Part; reflectance and two_sided stay the Part's.
    """
    return {"material_kind": MATERIAL_KINDS.index(kind), **columns}


MIRROR = material("conductor", eta=0.0, k=1.0)


class Part:
    """Primitives of one material: triangles, spheres (centre, radius, inward), disks.

    reflectance, emission: one number or three. normals: of the vertices. material: see `material`.
    interior, exterior: Medium or None; a part with neither does not change the medium.
    """

    def __init__(
        self,
        vertices: Any = (),
        faces: Any = (),
        reflectance: Any = 0.0,
        emission: Any = 0.0,
        two_sided: bool = False,
        *,
        normals: Any = None,
        spheres: Sequence[tuple[Any, float, bool]] = (),
        disks: Any = (),
        material: dict[str, Any] | None = None,
        interior: Medium | None = None,
        exterior: Medium | None = None,
    ) -> None:
        self.vertices = np.asarray(vertices, np.float64).reshape(-1, 3)
        self.faces = np.asarray(faces, np.int64).reshape(-1, 3)
        self.normals = np.zeros_like(self.vertices) if normals is None else np.asarray(normals)
        self.spheres = np.array([[*c, r] for c, r, _ in spheres], np.float64).reshape(-1, 4)
        self.inward = np.array([inward for _, _, inward in spheres], bool)
        self.disks = np.asarray(disks, np.float64).reshape(-1, 3, 3)
        self.reflectance = np.broadcast_to(np.asarray(reflectance, np.float64), 3)
        self.emission = np.broadcast_to(np.asarray(emission, np.float64), 3)
        self.two_sided = two_sided
        self.material = material or {}
        self.media = interior, exterior


def quad(corner: Any, e1: Any, e2: Any, reflectance: Any = 0.0, emission: Any = 0.0,
         two_sided: bool = False, **more: Any) -> Part:  # fmt: skip
    """A parallelogram; its front is on the side of cross(e1, e2). more: as Part's."""
    p, a, b = (np.asarray(x, np.float64) for x in (corner, e1, e2))
    return Part([p, p + a, p + a + b, p + b], [[0, 1, 2], [0, 2, 3]], reflectance, emission,
                two_sided, **more)  # fmt: skip


def box(lo: Any, hi: Any, inward: bool, reflectance: Any = 0.0, emission: Any = 0.0,
        **more: Any) -> Part:  # fmt: skip
    """An axis-aligned box of six quads whose fronts look inward or outward. more: as Part's."""
    lo, hi = np.asarray(lo, np.float64), np.asarray(hi, np.float64)
    parts = []
    for axis in range(3):
        u, v = np.zeros(3), np.zeros(3)
        u[(axis + 1) % 3] = (hi - lo)[(axis + 1) % 3]
        v[(axis + 2) % 3] = (hi - lo)[(axis + 2) % 3]
        top = np.array(lo)
        top[axis] = hi[axis]
        parts += [quad(lo, u, v), quad(top, v, u)]
    vertices = np.concatenate([p.vertices for p in parts])
    faces = np.concatenate([p.faces + 4 * i for i, p in enumerate(parts)])
    return Part(vertices, faces if inward else faces[:, ::-1], reflectance, emission, **more)


def sphere(centre: Any, radius: float, reflectance: Any = 0.0, emission: Any = 0.0,
           inward: bool = False, **more: Any) -> Part:  # fmt: skip
    """A sphere; its front is outside, or inside if `inward`. more: as Part's."""
    return Part((), (), reflectance, emission, spheres=[(centre, radius, inward)], **more)


def disk(centre: Any, a: Any, b: Any, reflectance: Any = 0.0, emission: Any = 0.0,
         **more: Any) -> Part:  # fmt: skip
    """An ellipse with half axes a and b; its front is on the side of cross(a, b)."""
    return Part((), (), reflectance, emission, disks=[[centre, a, b]], **more)


def point_light(position: Any, intensity: Any = 1.0) -> dict[str, Any]:
    """A row of the scene's lights, for `make`."""
    return {"light_kind": LIGHT_KINDS.index("point"), "light_position": position,
            "light_intensity": intensity}  # fmt: skip


def spot_light(position: Any, direction: Any, intensity: Any = 1.0, cutoff: float = 20.0,
               beam: float = 15.0) -> dict[str, Any]:  # fmt: skip
    """A row of the scene's lights, for `make`; angles in degrees."""
    return {**point_light(position, intensity), "light_kind": LIGHT_KINDS.index("spot"),
            "light_direction": direction / np.linalg.norm(direction),
            "light_angles": (cutoff, beam)}  # fmt: skip


def directional_light(direction: Any, irradiance: Any = 1.0) -> dict[str, Any]:
    """A row of the scene's lights, for `make`; direction: the way the light goes."""
    return {"light_kind": LIGHT_KINDS.index("directional"), "light_intensity": irradiance,
            "light_direction": direction / np.linalg.norm(direction)}  # fmt: skip


def camera(origin: Any, target: Any, fov: float = 0.01, up: Any = None, **more: Any) -> Any:
    """A camera at `origin`; the default field of view makes one pixel a point on the target."""
    eye = np.asarray(origin, np.float64)
    forward = np.asarray(target, np.float64) - eye
    forward /= np.linalg.norm(forward)
    helper = np.eye(3)[np.argmin(np.abs(forward))] if up is None else np.asarray(up, np.float64)
    left = np.cross(helper, forward)
    left /= np.linalg.norm(left)
    to_world = np.eye(4)
    to_world[:3, :4] = np.stack([left, np.cross(forward, left), forward, eye], axis=1)
    return veriray.Camera(to_world, fov, **more)


def make(parts: Sequence[Part], view: Any = None, environment: Any = 0.0, width: int = 1,
         height: int = 1, filter: str = "box", filter_parameter: Any = None,
         lights: Sequence[dict[str, Any]] = (), camera_medium: Medium | None = None,
         **settings: Any) -> veriray.Scene:  # fmt: skip
    """A scene of parts; every part has a material and, if it shines, an emission of its own.

    lights: from point_light, spot_light, directional_light. camera_medium: what the camera is in.
    """
    lit = [k for k, p in enumerate(parts) if p.emission.any()]
    emission = [lit.index(k) if k in lit else -1 for k in range(len(parts))]
    media = list(dict.fromkeys(
        m for m in (*(m for p in parts for m in p.media), camera_medium) if m is not None
    ))  # fmt: skip
    pairs = [tuple(media.index(m) if m else -1 for m in p.media) for p in parts]
    boundaries = [pair for pair in dict.fromkeys(pairs) if pair != (-1, -1)]
    boundary = [boundaries.index(pair) if pair in boundaries else -1 for pair in pairs]
    rows: dict[str, Any] = {}
    for name, lengths in (
        ("triangle", [len(p.faces) for p in parts]),
        ("sphere", [len(p.spheres) for p in parts]),
        ("disk", [len(p.disks) for p in parts]),
    ):
        for column, values in (
            ("material", range(len(parts))), ("emission", emission), ("boundary", boundary),
        ):  # fmt: skip
            rows[f"{name}_{column}"] = np.repeat(np.array(values, np.int64), lengths)
    firsts = np.cumsum([0, *(len(p.vertices) for p in parts)])[:-1]
    view = camera([0, 0, 0], [0, 0, 1]) if view is None else view
    if camera_medium is not None:
        view = dataclasses.replace(view, medium=media.index(camera_medium))
    return veriray.Scene(
        vertices=_joined([p.vertices for p in parts], (3,)),
        normals=_joined([p.normals for p in parts], (3,)),
        triangles=_joined([p.faces + n for p, n in zip(parts, firsts, strict=True)], (3,), int),
        spheres=_joined([p.spheres for p in parts], (4,)),
        sphere_inward=_joined([p.inward for p in parts], (), bool),
        disks=_joined([p.disks for p in parts], (3, 3)),
        reflectance=np.array([p.reflectance for p in parts]).reshape(-1, 3),
        two_sided=np.array([p.two_sided for p in parts], bool),
        **rows,
        **_columns([p.material for p in parts], "materials"),
        emissions=np.array([parts[k].emission for k in lit]).reshape(-1, 3),
        environment=np.broadcast_to(np.asarray(environment, np.float64), 3),
        boundaries=boundaries or None,
        **_columns(
            [{"sigma_t": m.sigma_t, "albedo": m.albedo, "phase_g": m.g} for m in media], "media"
        ),
        **_columns(lights, "lights"),
        camera=view,
        film=veriray.Film(width, height, filter, filter_parameter),
        **settings,
    )  # fmt: skip


def _joined(arrays: list[Array], shape: tuple[int, ...], dtype: Any = np.float64) -> Array:
    return np.concatenate(arrays) if arrays else np.zeros((0, *shape), dtype)


def _columns(rows: Sequence[dict[str, Any]], table: str) -> dict[str, Any]:
    """Columns of a table from rows that give some of them; one number stands for three alike."""
    result: dict[str, Any] = {}
    for name, column in COLUMNS.items():
        if column.table != table or not any(name in row for row in rows):
            continue
        default = None if column.default is REQUIRED else column.default
        values = [np.asarray(row.get(name, default), float) for row in rows]
        array = np.stack([np.broadcast_to(v, column.width) for v in values])
        result[name] = array.astype(np.int64) if name.endswith("_kind") else array
    return result


def furnace(albedo: Any, emission: Any, **settings: Any) -> veriray.Scene:
    """The unit cube from inside, every wall alike; the camera looks at a wall off its centre."""
    return make([box([0, 0, 0], [1, 1, 1], True, albedo, emission)],
                camera([0.4, 0.45, 0.3], [0.6, 0.3, 1.0], 30.0), **settings)  # fmt: skip


def without(scene: veriray.Scene, shapes: Callable[[str], bool]) -> veriray.Scene:
    """The scene less the primitives of the shapes whose name fulfils `shapes`."""
    changes: dict[str, Any] = {}
    for table in ("triangles", "spheres", "disks"):
        index = getattr(scene, f"{table[:-1]}_shape")
        keep = np.array([not shapes(scene.shape_names[k]) for k in index], bool)
        names = [name for name, column in COLUMNS.items() if column.table == table]
        for name in (*names, f"{table[:-1]}_shape"):
            changes[name] = getattr(scene, name)[keep]
    return dataclasses.replace(scene, **changes)


# ---- native modules ----


def native(device: str) -> Any:
    """The native module of a device."""
    return device_module.select(device)[0].native


def native_scene(scene: veriray.Scene, device: str) -> Any:
    """The scene as the native module of a device holds it."""
    chosen = device_module.select(device)[0]
    return chosen.native.Scene(**native_scene_arguments(scene), device=chosen.index)


def native_film(width: int, height: int, device: str) -> Any:
    """An empty film of a device."""
    chosen = device_module.select(device)[0]
    return chosen.native.Film(width, height, device=chosen.index)


# ---- closed forms ----


def lambert(point: Any, normal: Any, polygon: Any) -> float:
    """Form factor of a polygon from a point with a normal: J. H. Lambert, Photometria, 1760.

    1 / (2 pi) sum over edges of (angle subtended) (unit normal of the edge's plane . normal). The
    polygon must lie above the horizon; positive whichever way it runs.
    """
    v = np.asarray(polygon, np.float64) - np.asarray(point, np.float64)
    total = 0.0
    for a, b in zip(v, np.roll(v, -1, axis=0), strict=True):
        c = np.cross(a, b)
        angle = math.atan2(float(np.linalg.norm(c)), float(a @ b))
        total += angle * float(c @ np.asarray(normal)) / float(np.linalg.norm(c))
    return abs(total) / (2 * math.pi)
