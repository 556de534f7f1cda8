"""Rays from inside closed meshes, aimed at their vertices and edges: none may leave.

Meshes of 12 to 81,920 triangles, convex ones, bumpy ones, a knot and one of slivers (1 : 2e6), at
scales 1e-3 to 1e6, around the origin and shifted by 1e6. The rays are made by the hook
`count_leaks` on the device, from points known to be inside: on the way from a kernel that sees the
whole mesh (of a sphere its middle, of the knot the middle of a section) towards the surface, up to
1e-4 of the way before it (of the knot 0.1). 1e9 rays on CUDA, 1e7 on a CPU. Exit status 1 if one
leaks.
"""

from __future__ import annotations

import sys
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np

sys.path.append(str(Path(__file__).resolve().parent))  # as benchmarks.leaks, too
from common import Array, displaced_icosphere, header, icosphere, mesh_scene, parser, write

import veriray
from veriray.gallery import meshes
from veriray.render import native_scene_arguments

SCALES = (1e-3, 1.0, 1e3, 1e6)
SHIFTS = (0.0, 1e6)
ORIGINS = 256  # a mesh
Mesh = tuple[Array, Array, Array]  # vertices (V, 3), triangles (T, 3), points inside (k, 3)


def _star(vertices: Array, triangles: Array) -> Mesh:
    """A mesh that its middle, the origin, sees whole."""
    rng = np.random.default_rng(2)
    faces = vertices[triangles[rng.integers(len(triangles), size=ORIGINS)]]
    weights = rng.dirichlet((1, 1, 1), ORIGINS)
    way = 1 - 10.0 ** rng.uniform(-4, 0, (ORIGINS, 1))
    way[0] = 0
    return vertices, triangles, (faces * weights[:, :, None]).sum(axis=1) * way


def _turned(mesh: Mesh) -> Mesh:
    """Turned by angles that no axis knows, and stretched."""
    turn, _ = np.linalg.qr(np.random.default_rng(3).normal(size=(3, 3)))
    matrix = turn @ np.diag([0.7, 1.0, 1.3])
    vertices, triangles, inside = mesh
    return vertices @ matrix.T, triangles, inside @ matrix.T


def cube(cells: int) -> Mesh:
    """The cube from -1 to 1 with cells x cells x 2 triangles a side, vertices shared."""
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


def is_closed(triangles: Array) -> bool:
    """Whether every edge belongs to two triangles."""
    edges = np.sort(np.concatenate([triangles[:, [k, (k + 1) % 3]] for k in range(3)]), axis=1)
    _, counts = np.unique(edges, axis=0, return_counts=True)
    return bool((counts == 2).all())


def run(device: str, rays: int, names: tuple[str, ...] = ()) -> dict[str, Any]:
    """About `rays` rays in all over the meshes of these names (default: all of MESHES).

    Returns rays, leaks, and rows with the counts of each mesh at each scale and shift. Raises what
    the native module raises.
    """
    chosen, _ = veriray.device.select(device)
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
                camera = veriray.Camera.look_at(move, move + scale * np.array([0.0, 0.0, 1.0]))
                scene = mesh_scene(vertices * scale + move, triangles, camera)
                host = chosen.native.Scene(**native_scene_arguments(scene), device=chosen.index)
                begin = time.perf_counter()
                vertex, edge = chosen.native.count_leaks(host, origins, len(rows) * each, each)
                rows.append({
                    "mesh": name, "triangles": len(triangles), "scale": scale, "shift": shift,
                    "tree": "bvh" in host.features, "dropped": host.primitives["dropped"],
                    "origins": len(origins), "rays": each, "vertex_misses": int(vertex),
                    "edge_misses": int(edge), "seconds": time.perf_counter() - begin,
                })  # fmt: skip
    leaks = sum(row["vertex_misses"] + row["edge_misses"] for row in rows)
    return {"rays": each * len(rows), "leaks": leaks, "rows": rows}


def main() -> int:
    """Command line."""
    p = parser(__doc__, "leaks_DEVICE.json")
    p.add_argument("meshes", nargs="*", help=f"of: {'; '.join(MESHES)}")
    p.add_argument("--device", default="cuda")
    p.add_argument("--rays", type=float, help="in all; default 1e9 on CUDA, 1e7 on a CPU")
    args = p.parse_args()
    unknown = set(args.meshes) - set(MESHES)
    if unknown:
        p.error(f"unknown meshes: {', '.join(unknown)}")
    chosen, _ = veriray.device.select(args.device)
    rays = int(args.rays or (1e9 if chosen.backend == "cuda" else 1e7))
    result = header("leaks")
    result["device"] = {"name": chosen.name, "description": chosen.description, **chosen.details}
    result["build"] = chosen.native.build_info()
    done = run(args.device, rays, tuple(args.meshes))
    for name in dict.fromkeys(row["mesh"] for row in done["rows"]):
        rows = [row for row in done["rows"] if row["mesh"] == name]
        total = {key: sum(row[key] for row in rows)
                 for key in ("rays", "vertex_misses", "edge_misses", "seconds")}  # fmt: skip
        print(f"{name}: {total['rays']:.3g} rays in {total['seconds']:.2f} s, misses at vertices "
              f"{total['vertex_misses']}, at edges {total['edge_misses']}")  # fmt: skip
    print(f"{done['leaks']} leaks in {done['rays']:.3g} rays")
    name = args.output.name.replace("DEVICE", chosen.backend)
    write({**result, **done}, args.output.with_name(name))
    return 1 if done["leaks"] else 0


if __name__ == "__main__":
    sys.exit(main())
