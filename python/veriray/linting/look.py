"""A scene as the rules of `veriray.linting` look at it: primitives of all kinds in one list."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np
import numpy.typing as npt

from .. import device as device_module
from ..camera import PATCH_KINDS
from ..columns import MATERIAL_KINDS, OPAQUE_KINDS
from ..errors import printable
from ..named import objects
from ..native_scene import native_scene
from ..scene import Scene

Array = npt.NDArray[Any]
#: Rays of a camera that are followed: a grid of SIDE x SIDE over the film.
SIDE = 48


@dataclass(frozen=True)
class Finding:
    """rule: of `veriray.linting.RULES`. key: name of the object, "" for the scene. where: its
    place in the file, "" if unknown. text: what was found. reason: why it matters."""

    rule: str
    key: str
    where: str
    text: str
    reason: str

    def __str__(self) -> str:
        what = f"{self.key}: " if self.key else ""
        place = f"{self.where}: " if self.where else ""
        return printable(f"{place}{self.rule}: {what}{self.text} ({self.reason})")


class Look:
    """A scene with what several rules need.

    Primitives are numbered as the native modules do: triangles, then spheres, then discs.
    material, emission, boundary, shape: their columns, (N,). skipped: what rules left out.
    """

    def __init__(self, scene: Scene) -> None:
        self.scene = scene
        self.skipped: list[str] = []
        self.counts = [len(scene.triangles), len(scene.spheres), len(scene.disks)]
        self.material, self.emission, self.boundary, self.shape = (
            np.concatenate([np.asarray(getattr(scene, f"{kind}_{name}"), np.int64)
                            for kind in ("triangle", "sphere", "disk")])
            for name in ("material", "emission", "boundary", "shape")
        )  # fmt: skip
        kinds = np.asarray(scene.material_kind)
        self.kind = [MATERIAL_KINDS[k] for k in kinds.tolist()]
        opaque = np.isin(kinds, [MATERIAL_KINDS.index(name) for name in OPAQUE_KINDS])
        opaque &= (np.asarray(scene.opacity) == 1) & (np.asarray(scene.opacity_texture) < 0)
        blend = np.asarray(scene.blend_material)
        #: Materials through which nothing goes.
        self.opaque: Array = opaque
        while (blend >= 0).any():
            self.opaque = self.opaque & np.where(blend >= 0, opaque[blend], True)
            blend = np.where(blend >= 0, np.asarray(scene.blend_material)[blend], -1)
        self._ids = {place: names[0] for place, names in objects(scene).names().items()}
        self._device = device_module.select("cpu")[0]
        with device_module.native_errors():
            self._native = native_scene(scene, scene, self._device)
        origin, self.unit = self._native.frame
        self.origin: Array = np.array(origin)

    @property
    def total(self) -> int:
        """Number of primitives."""
        return sum(self.counts)

    @cached_property
    def dropped(self) -> int:
        """Triangles without area."""
        return int(self._native.primitives.get("dropped", 0))

    def found(self, rule: str, column: str, row: int, text: str, reason: str) -> Finding:
        """A finding about a row of a table; a primitive is known by its shape."""
        return Finding(rule, self.key(column, row), self.scene.place(f"{column}[{row}]"), text,
                       reason)  # fmt: skip

    def of_primitive(self, rule: str, primitive: int, text: str, reason: str) -> Finding:
        """A finding about a primitive by its number in the list of all."""
        row = primitive
        for name, count in zip(("triangles", "spheres", "disks"), self.counts, strict=True):
            if row < count:
                return self.found(rule, name, row, text, reason)
            row -= count
        raise IndexError(primitive)

    def shape_name(self, shape: int) -> str:
        """A shape's name in the file."""
        return self.scene.shape_names[shape]

    def key(self, column: str, row: int) -> str:
        """The id of a row's object, a shape's name, or "material 3"."""
        shapes = {"triangles": "triangle_shape", "spheres": "sphere_shape", "disks": "disk_shape"}
        if column in shapes:
            return self.shape_name(int(getattr(self.scene, shapes[column])[row]))
        table = {"material_kind": "materials", "emissions": "emissions", "sigma_t": "media",
                 "light_kind": "lights", "texture_kind": "textures"}[column]  # fmt: skip
        name = self._ids.get((table, row))
        if name is None and table in ("materials", "emissions"):
            users = np.flatnonzero(
                (self.material if table == "materials" else self.emission) == row
            )
            if len(users):
                return self.shape_name(int(self.shape[users[0]]))
        return name or f"{table.rstrip('s') if table != 'media' else 'medium'} {row}"

    # ---- rays ----

    def hits(self, origins: Array, directions: Array) -> tuple[Array, Array]:
        """Distance (n,) and primitive (n,), -1 for none, that rays (n, 3) meet first."""
        if not self.total or not len(origins):
            return np.full(len(origins), np.inf), np.full(len(origins), -1)
        with device_module.native_errors():
            t, primitive = self._device.native.intersect(
                self._native,
                np.ascontiguousarray(origins, np.float64),
                np.ascontiguousarray(directions, np.float64),
            )
        missed = primitive < 0
        return np.where(missed, np.inf, t).astype(np.float64), primitive.astype(np.int64)

    def normals(self, primitives: Array, points: Array) -> Array:
        """Geometric normals (n, 3), not of unit length, on the front side."""
        scene, (triangles, spheres, _) = self.scene, self.counts
        out = np.zeros((len(primitives), 3))
        which = np.asarray(primitives)
        flat = which < triangles
        a, b, c = (np.asarray(scene.vertices)[np.asarray(scene.triangles)[which[flat]][:, k]]
                   for k in range(3))  # fmt: skip
        out[flat] = np.cross(b - a, c - a)
        ball = (which >= triangles) & (which < triangles + spheres)
        rows = which[ball] - triangles
        sign = np.where(np.asarray(scene.sphere_inward)[rows], -1.0, 1.0)
        out[ball] = (points[ball] - np.asarray(scene.spheres)[rows, :3]) * sign[:, None]
        disk = which >= triangles + spheres
        axes = np.asarray(scene.disks)[which[disk] - triangles - spheres]
        out[disk] = np.cross(axes[:, 1], axes[:, 2])
        return out

    @cached_property
    def camera_rays(self) -> tuple[Array, Array]:
        """Origins and unit directions (SIDE^2, 3) of rays through the middle of the lens."""
        camera, film = self.scene.camera, self.scene.film
        # not through the middles of the cells: there are edges of what is symmetrical
        down, across = ((np.arange(SIDE) + shift) / SIDE for shift in (0.436, 0.618))
        v, u = (x.ravel() for x in np.meshgrid(down, across, indexing="ij"))
        dx, dy = np.asarray(camera.principal_point_offset)
        x = camera.tan_half_x(film.width, film.height) * (1 - 2 * (u + dx))
        y = camera.tan_half_y(film.width, film.height) * (1 - 2 * (v + dy))
        if camera.projection == "irradiance":
            return _off_patches(np.asarray(camera.patches), u, v)
        matrix, zero, one = np.asarray(camera.placed), np.zeros_like(u), np.ones_like(u)
        if camera.projection == "orthographic":
            near = camera.clip_depths[0]
            local, ahead = np.stack([x, y, zero + near], 1), np.stack([zero, zero, one], 1)
            origins = local @ matrix[:3, :3].T + matrix[:3, 3]
        else:
            ahead = np.stack([x, y, one], 1)
            ahead /= np.sqrt((ahead**2).sum(axis=1))[:, None]
            origins = np.repeat(matrix[None, :3, 3], len(u), axis=0)
        return origins, ahead @ matrix[:3, :3].T

    @cached_property
    def camera_hits(self) -> tuple[Array, Array, Array]:
        """Distance, primitive and "from behind" (SIDE^2,) of what the camera sees first."""
        origins, directions = self.camera_rays
        t, primitive = self.hits(origins, directions)
        return t, primitive, self.behind(origins, directions, t, primitive)

    def behind(self, origins: Array, directions: Array, t: Array, primitive: Array) -> Array:
        """Whether rays met the back of what they met."""
        back = np.zeros(len(t), np.bool_)
        hit = primitive >= 0
        points = origins[hit] + directions[hit] * t[hit, None]
        normals = self.normals(primitive[hit], points)
        back[hit] = (normals * directions[hit]).sum(axis=1) > 0
        return back

    @cached_property
    def bounds(self) -> tuple[Array, Array]:
        """Lowest and highest corner (3,) of all primitives."""
        boxes = [self.box(kind) for kind in range(3) if self.counts[kind]]
        low, high = (np.concatenate([box[k] for box in boxes]) for k in (0, 1))
        return low.min(axis=0), high.max(axis=0)

    def box(self, kind: int) -> Array:
        """Lowest and highest coordinates (2, n, 3) of triangles, spheres or discs."""
        from .. import limits

        return limits.primitive_boxes(self.scene, ("triangle", "sphere", "disk")[kind], np.zeros(3))


def row_keys(rows: Array) -> Array:
    """A number (n,) uint64 for each row (n, k) of float64: the same for equal rows, and for others
    with a probability of 2^-64."""
    words = np.ascontiguousarray(rows, np.float64).view(np.uint64)
    keys = np.zeros(len(words), np.uint64)
    for column in words.T:
        keys ^= column
        for shift, factor in ((32, 0xD6E8FEB86659FD93), (29, 0x9FB21C651E98DF25), (32, 1)):
            keys ^= keys >> np.uint64(shift)
            keys *= np.uint64(factor)
    return keys


def _off_patches(patches: Array, u: Array, v: Array) -> tuple[Array, Array]:
    """Origins just before a camera's patches, and their normals there, (N, 3) each."""
    rows = patches[np.arange(len(u)) * len(patches) // len(u)]
    point, a, b = rows[:, 2:5], rows[:, 5:8], rows[:, 8:11]
    around = np.sqrt(1 - (1 - 2 * v) ** 2)
    out = np.stack([around * np.cos(2 * np.pi * u), around * np.sin(2 * np.pi * u), 1 - 2 * v], 1)
    ball = (rows[:, 0] == PATCH_KINDS.index("sphere"))[:, None]
    normals = np.where(ball, out, np.cross(a, b)) * rows[:, 1:2]
    size = np.sqrt((normals**2).sum(axis=1))[:, None]
    normals = normals / np.where(size > 0, size, 1.0)
    inside = (rows[:, 0] < PATCH_KINDS.index("disk"))[:, None] / 3
    points = np.where(ball, point + a[:, :1] * out, point + inside * (a + b))
    reach = np.sqrt((a**2).sum(axis=1))[:, None]
    return points + 1e-6 * reach * normals, normals
