"""Rays from inside closed meshes, aimed at their vertices and edges: none may leave.

Meshes of 12 to 81,920 triangles, convex ones, bumpy ones, a knot and one of slivers (1 : 2e6), at
scales 1e-3 to 1e6, around the origin and shifted by 1e6. The rays are made by the hook
`count_leaks` on the device, from points known to be inside. These lie between a point that sees the
whole mesh (the middle of a sphere, for the knot the middle of a section) and the surface, up to
1e-4 of the distance from it (for the knot 0.1).
"""

from __future__ import annotations

import math
import time
from collections.abc import Callable
from typing import Any

import numpy as np
import numpy.typing as npt

from veriray import device as device_module
from veriray.camera import Camera, Film
from veriray.gallery import meshes
from veriray.native_scene import BUILDERS, native_scene_arguments
from veriray.scene import Scene

Array = npt.NDArray[Any]
SCALES = (1e-3, 1.0, 1e3, 1e6)
SHIFTS = (0.0, 1e6)
ORIGINS = 256  # a mesh
Mesh = tuple[Array, Array, Array]  # vertices (V, 3), triangles (T, 3), points inside (k, 3)


# ---- meshes: the same numbers on every machine ----


def icosphere(levels: int) -> tuple[Array, Array]:
    """The unit sphere: vertices (V, 3) float64, triangles (20 * 4^levels, 3), fronts outside."""
    g = (1 + math.sqrt(5)) / 2
    v = _unit(np.array([
        (-1, g, 0), (1, g, 0), (-1, -g, 0), (1, -g, 0), (0, -1, g), (0, 1, g),
        (0, -1, -g), (0, 1, -g), (g, 0, -1), (g, 0, 1), (-g, 0, -1), (-g, 0, 1),
    ]))  # fmt: skip
    f = np.array([
        (0, 11, 5), (0, 5, 1), (0, 1, 7), (0, 7, 10), (0, 10, 11), (1, 5, 9), (5, 11, 4),
        (11, 10, 2), (10, 7, 6), (7, 1, 8), (3, 9, 4), (3, 4, 2), (3, 2, 6), (3, 6, 8),
        (3, 8, 9), (4, 9, 5), (2, 4, 11), (6, 2, 10), (8, 6, 7), (9, 8, 1),
    ])  # fmt: skip
    for _ in range(levels):
        edges = np.sort(np.concatenate([f[:, [0, 1]], f[:, [1, 2]], f[:, [2, 0]]]), axis=1)
        keys, which = np.unique(edges[:, 0] * len(v) + edges[:, 1], return_inverse=True)
        a, b, c = f.T
        ab, bc, ca = which.reshape(3, -1) + len(v)
        v = np.concatenate([v, _unit(v[keys // len(v)] + v[keys % len(v)])])
        faces = ((a, ab, ca), (b, bc, ab), (c, ca, bc), (ab, bc, ca))
        f = np.concatenate([np.stack(face, axis=1) for face in faces])
    return v, f


def displaced_icosphere(levels: int) -> tuple[Array, Array]:
    """An icosphere with bumps along the radius, 0.86 to 1.14 from the centre."""
    v, f = icosphere(levels)
    x, y, z = v.T
    bumps = 0.12 * _wave(1.9 * x) * _wave(1.75 * y) * _wave(2.1 * z)
    return v * (1 + bumps + 0.02 * _wave(14.3 * x) * _wave(12.7 * y))[:, None], f


def _unit(v: Array) -> Array:
    x, y, z = v.T
    unit: Array = v / np.sqrt(x * x + y * y + z * z)[:, None]
    return unit


def _wave(x: Array) -> Array:
    """A wave of parabolas between -1 and 1 with period 1, close to a sine."""
    u = x - np.floor(x + 0.5)
    wave: Array = 8 * u * (1 - 2 * np.abs(u))
    return wave


def _star(vertices: Array, triangles: Array) -> Mesh:
    """A mesh that is entirely visible from its middle, the origin."""
    rng = np.random.default_rng(2)
    faces = vertices[triangles[rng.integers(len(triangles), size=ORIGINS)]]
    weights = rng.dirichlet((1, 1, 1), ORIGINS)
    way = 1 - 10.0 ** rng.uniform(-4, 0, (ORIGINS, 1))
    way[0] = 0
    return vertices, triangles, (faces * weights[:, :, None]).sum(axis=1) * way


def _turned(mesh: Mesh) -> Mesh:
    """Rotated by angles that align with no axis, and stretched."""
    turn, _ = np.linalg.qr(np.random.default_rng(3).normal(size=(3, 3)))
    matrix = turn @ np.diag([0.7, 1.0, 1.3])
    vertices, triangles, inside = mesh
    return vertices @ matrix.T, triangles, inside @ matrix.T


def cube(cells: int) -> Mesh:
    """The cube from -1 to 1 with cells x cells x 2 triangles per side and shared vertices."""
    i, j = (a.ravel() for a in np.mgrid[0:cells, 0:cells])
    corners = np.stack([np.stack([i + a, j + b], axis=1) for a, b in
                        ((0, 0), (1, 0), (1, 1), (0, 1))], axis=1)  # fmt: skip
    quads = []
    for axis in range(3):
        for side in (0, cells):
            quads.append(np.insert(corners, axis, side, axis=2))
    lattice, which = np.unique(np.concatenate(quads).reshape(-1, 3), axis=0, return_inverse=True)
    quad = which.reshape(-1, 4)
    triangles = np.concatenate([quad[:, [0, 1, 2]], quad[:, [0, 2, 3]]])
    return _star(lattice * (2 / cells) - 1, triangles)


def slivers(pairs: int = 32, gap: float = 1e-6) -> Mesh:
    """A round bar of height 2 whose corners come in pairs, `gap` apart: triangles 2 long."""
    angle = 2 * np.pi * np.arange(pairs) / pairs
    angle = np.stack([angle, angle + gap], axis=1).ravel()
    n = len(angle)
    ring = np.stack([np.cos(angle), np.sin(angle)], axis=1)
    vertices = np.concatenate([np.insert(ring, 2, -1, axis=1), np.insert(ring, 2, 1, axis=1),
                               [(0, 0, -1), (0, 0, 1)]])  # fmt: skip
    a, b = np.arange(n), np.roll(np.arange(n), -1)
    low, high = np.full(n, 2 * n), np.full(n, 2 * n + 1)
    faces = ((a, b, b + n), (a, b + n, a + n), (b, a, low), (a + n, b + n, high))
    return _star(vertices, np.concatenate([np.stack(face, axis=1) for face in faces]))


def knot(section: int = 36) -> Mesh:
    """The gallery's torus knot; the points inside lie within its sections."""
    vertices, _, triangles = meshes.knot(section=section)
    rings = vertices.reshape(-1, section, 3)
    rng = np.random.default_rng(4)
    ring = rings[rng.integers(len(rings), size=ORIGINS)]
    middle = ring.mean(axis=1)
    outward = ring[np.arange(ORIGINS), rng.integers(section, size=ORIGINS)] - middle
    return vertices, triangles, middle + outward * rng.uniform(0, 0.9, (ORIGINS, 1))


MESHES: dict[str, Callable[[], Mesh]] = {
    "box of 12": lambda: cube(1),
    "box of 12, turned": lambda: _turned(cube(1)),
    "icosahedron, turned": lambda: _turned(_star(*icosphere(0))),
    "icosphere": lambda: _star(*icosphere(5)),
    "displaced icosphere": lambda: _star(*displaced_icosphere(6)),
    "cube of 49,152": lambda: cube(64),
    "cube of 3,072, turned": lambda: _turned(cube(16)),
    "knot": knot,
    "slivers": slivers,
    "slivers, turned": lambda: _turned(slivers()),
}


def mesh_scene(vertices: Array, triangles: Array, camera: Camera) -> Scene:
    """One grey mesh with face normals under a constant sky, one pixel."""
    return Scene(
        vertices=vertices, triangles=triangles,
        triangle_material=np.zeros(len(triangles), np.uint32), triangle_emission=None,
        reflectance=np.full((1, 3), 0.8), two_sided=np.zeros(1, bool), emissions=np.zeros((0, 3)),
        environment=np.ones(3), camera=camera, film=Film(1, 1, "box"),
    )  # fmt: skip


def is_closed(triangles: Array) -> bool:
    """Whether every edge belongs to two triangles."""
    edges = np.sort(np.concatenate([triangles[:, [k, (k + 1) % 3]] for k in range(3)]), axis=1)
    _, counts = np.unique(edges, axis=0, return_counts=True)
    return bool((counts == 2).all())


def run(device: str, rays: int, names: tuple[str, ...] = (), first: int = 0) -> dict[str, Any]:
    """About `rays` rays in all over the meshes of these names (default: all of MESHES).

    first: number of the first ray; a ray is a function of its number. Returns rays, leaks, and
    rows with the counts of each mesh at each scale and shift. Raises what the native module raises.
    """
    chosen, _ = device_module.select(device)
    names = names or tuple(MESHES)
    each = -(-rays // (len(names) * len(SCALES) * len(SHIFTS)))
    rows: list[dict[str, Any]] = []
    for name in names:
        vertices, triangles, inside = MESHES[name]()
        if not is_closed(triangles):
            raise ValueError(f"mesh {name!r} is not closed")
        for scale in SCALES:
            for shift in SHIFTS:
                move = shift * np.array([1.0, -1.0, 1.0])
                origins = np.ascontiguousarray(inside * scale + move)
                camera = Camera.look_at(move, move + scale * np.array([0.0, 0.0, 1.0]))
                scene = mesh_scene(vertices * scale + move, triangles, camera)
                builder = BUILDERS[1 + len(rows) % 2]
                host = chosen.native.Scene(
                    **native_scene_arguments(scene), device=chosen.index, builder=builder
                )
                begin = time.perf_counter()
                start = first + len(rows) * each
                vertex, edge = chosen.native.count_leaks(host, origins, start, each)
                rows.append({
                    "mesh": name, "triangles": len(triangles), "scale": scale, "shift": shift,
                    "tree": "bvh" in host.features, "builder": builder,
                    "dropped": host.primitives["dropped"],
                    "origins": len(origins), "rays": each, "vertex_misses": int(vertex),
                    "edge_misses": int(edge), "seconds": time.perf_counter() - begin,
                })  # fmt: skip
    leaks = sum(row["vertex_misses"] + row["edge_misses"] for row in rows)
    return {"rays": each * len(rows), "leaks": leaks, "rows": rows}
