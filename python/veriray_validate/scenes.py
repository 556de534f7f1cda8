"""Small scenes with known answers, built from parts: arrays of `veriray.Scene`, without a reader.

`dicts` has those that go through the reader of dictionaries.
"""

from __future__ import annotations

import copy
import dataclasses
import functools
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

import veriray
from veriray.camera import Camera, Film
from veriray.columns import COLUMNS, LIGHT_KINDS, MATERIAL_KINDS, REQUIRED
from veriray.scene import Scene, load_file

Array = npt.NDArray[Any]


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
NULL = material("null")


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
    return Camera(to_world, fov, **more)


def make(parts: Sequence[Part], view: Any = None, environment: Any = 0.0, width: int = 1,
         height: int = 1, filter: str = "box", filter_parameter: Any = None,
         lights: Sequence[dict[str, Any]] = (), camera_medium: Medium | None = None,
         **settings: Any) -> Scene:  # fmt: skip
    """A scene of parts; every part has a material and, if it shines, an emission of its own.

    lights: from point_light, spot_light, directional_light. camera_medium: around the camera.
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
    return Scene(
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
        film=Film(width, height, filter, filter_parameter),
        **settings,
    )  # fmt: skip


def _joined(arrays: list[Array], shape: tuple[int, ...], dtype: Any = np.float64) -> Array:
    return np.concatenate(arrays) if arrays else np.zeros((0, *shape), dtype)


def _columns(rows: Sequence[dict[str, Any]], table: str) -> dict[str, Any]:
    """Columns of a table from rows that give some of them; one number stands for three."""
    result: dict[str, Any] = {}
    for name, column in COLUMNS.items():
        if column.table != table or not any(name in row for row in rows):
            continue
        default = None if column.default is REQUIRED else column.default
        values = [np.asarray(row.get(name, default), float) for row in rows]
        array = np.stack([np.broadcast_to(v, column.width) for v in values])
        result[name] = array.astype(np.int64) if name.endswith("_kind") else array
    return result


def furnace(albedo: Any, emission: Any, **settings: Any) -> Scene:
    """The unit cube from inside, all walls alike; the camera looks at a wall, off its centre."""
    return make([box([0, 0, 0], [1, 1, 1], True, albedo, emission)],
                camera([0.4, 0.45, 0.3], [0.6, 0.3, 1.0], 30.0), **settings)  # fmt: skip


def without(scene: Scene, shapes: Callable[[str], bool]) -> Scene:
    """The scene without the primitives of shapes whose name fulfils `shapes`."""
    changes: dict[str, Any] = {}
    for table in ("triangles", "spheres", "disks"):
        index = getattr(scene, f"{table[:-1]}_shape")
        keep = np.array([not shapes(scene.shape_names[k]) for k in index], bool)
        names = [name for name, column in COLUMNS.items() if column.table == table]
        for name in (*names, f"{table[:-1]}_shape"):
            changes[name] = getattr(scene, name)[keep]
    return dataclasses.replace(scene, **changes)


#: Check scenes of curves, which are tubes of 64 sides here and round in the reference: near their
#: rims, where the normals of faces and vertices disagree, 4e-4 of all paths more end.
TUBES = {"curves", "hair"}


def checks() -> dict[str, Path]:
    """The scene files of scenes/checks by name: of the installed package, else of the checkout."""
    package = Path(veriray.__file__).resolve().parent
    for root in (package / "scenes", package.parents[1] / "scenes"):
        files = {path.stem: path for path in sorted((root / "checks").glob("*.xml"))}
        if files:
            return files
    return {}


@functools.cache
def _read(path: Path) -> Scene:
    return load_file(path)


def check_scene(name: str, size: int) -> Scene:
    """A scene of scenes/checks, size x size pixels: read once in a process, built every time."""
    return copy.copy(_read(checks()[name])).with_(width=size, height=size)
