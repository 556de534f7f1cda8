"""Small scenes, native hooks and the statistical rules shared by the tests.

Rules (of every statistical test here): a first stage at false-alarm rate 1e-3; if it fails, one
confirmation with four times the samples and a fresh seed at 1e-4; red means that both failed, which
a sound program does once in 1e7. A float32 renderer has a true bias of about 1e-6, so estimates may
differ from exact values by a relative margin, 1e-5 unless stated, on top.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from typing import Any

import numpy as np
import numpy.typing as npt
from scipy import stats

import veriray
from veriray import device as device_module
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


class Part:
    """Triangles of one material. reflectance, emission: one number or three."""

    def __init__(
        self,
        vertices: Any,
        faces: Any,
        reflectance: Any = 0.0,
        emission: Any = 0.0,
        two_sided: bool = False,
    ) -> None:
        self.vertices = np.asarray(vertices, np.float64).reshape(-1, 3)
        self.faces = np.asarray(faces, np.int64).reshape(-1, 3)
        self.reflectance = np.broadcast_to(np.asarray(reflectance, np.float64), 3)
        self.emission = np.broadcast_to(np.asarray(emission, np.float64), 3)
        self.two_sided = two_sided


def quad(corner: Any, e1: Any, e2: Any, reflectance: Any = 0.0, emission: Any = 0.0,
         two_sided: bool = False) -> Part:  # fmt: skip
    """A parallelogram; its front is on the side of cross(e1, e2)."""
    p, a, b = (np.asarray(x, np.float64) for x in (corner, e1, e2))
    return Part([p, p + a, p + a + b, p + b], [[0, 1, 2], [0, 2, 3]], reflectance, emission,
                two_sided)  # fmt: skip


def box(lo: Any, hi: Any, inward: bool, reflectance: Any = 0.0, emission: Any = 0.0) -> Part:
    """An axis-aligned box of six quads whose fronts look inward or outward."""
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
    return Part(vertices, faces if inward else faces[:, ::-1], reflectance, emission)


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
         height: int = 1, filter: str = "box", filter_parameter: float | None = None,
         **settings: Any) -> veriray.Scene:  # fmt: skip
    """A scene of parts; every part has a material and, if it shines, an emission of its own."""
    counts = np.cumsum([0, *(len(p.vertices) for p in parts)])
    lengths = [len(p.faces) for p in parts]
    lit = [k for k, p in enumerate(parts) if p.emission.any()]
    emission = [lit.index(k) if k in lit else -1 for k in range(len(parts))]
    return veriray.Scene(
        vertices=np.concatenate([p.vertices for p in parts]) if parts else np.zeros((0, 3)),
        triangles=np.concatenate([p.faces + n for p, n in zip(parts, counts[:-1], strict=True)])
        if parts else np.zeros((0, 3), np.int64),
        triangle_material=np.repeat(np.arange(len(parts)), lengths),
        triangle_emission=np.repeat(np.array(emission, np.int64), lengths),
        reflectance=np.array([p.reflectance for p in parts]).reshape(-1, 3),
        two_sided=np.array([p.two_sided for p in parts], bool),
        emissions=np.array([parts[k].emission for k in lit]).reshape(-1, 3),
        environment=np.broadcast_to(np.asarray(environment, np.float64), 3),
        camera=camera([0, 0, 0], [0, 0, 1]) if view is None else view,
        film=veriray.Film(width, height, filter, filter_parameter),
        **settings,
    )  # fmt: skip


def furnace(albedo: Any, emission: Any, **settings: Any) -> veriray.Scene:
    """The unit cube from inside, every wall alike; the camera looks at a wall off its centre."""
    return make([box([0, 0, 0], [1, 1, 1], True, albedo, emission)],
                camera([0.4, 0.45, 0.3], [0.6, 0.3, 1.0], 30.0), **settings)  # fmt: skip


def without(scene: veriray.Scene, shapes: Callable[[str], bool]) -> veriray.Scene:
    """The scene less the triangles of the shapes whose name fulfils `shapes`."""
    import dataclasses

    keep = np.array([not shapes(scene.shape_names[k]) for k in scene.triangle_shape])
    columns = "triangles triangle_material triangle_emission triangle_shape".split()
    return dataclasses.replace(scene, **{name: getattr(scene, name)[keep] for name in columns})


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
