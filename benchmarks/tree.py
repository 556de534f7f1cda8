"""The tree over meshes: seconds to build it, and rays per second by the width of its nodes.

Meshes: two displaced icospheres (81,920 and 1,310,720 triangles) and those given with --mesh (PLY,
or PLY in gzip). Build: `tree` are the seconds that the native module states for the tree alone,
`scene` the wall time of the whole native scene with checks, tree, tables and copy to the device;
medians over --rounds. Rays: those of a camera (a million at --size 1024), diffuse ones from where
these arrive, and ones from there to points of a lamp. All are traced to the closest hit by the hook
`intersect_width` with nodes of 2, 4 and 8 boxes; the time is that of the kernel. Where the module
lacks the hook, `intersect` is timed as a whole, copies included, in the width that is built in.
Exit status 1 unless all widths and `intersect` give the same distances and primitives, bit for bit.
"""

from __future__ import annotations

import gzip
import sys
import time
from pathlib import Path
from typing import Any

import numpy as np
from common import Array, cpu_count, header, parser, spread, write

import veriray
from veriray.formats import ply
from veriray.native_scene import native_scene_arguments, scene_facts
from veriray_validate.leaks import displaced_icosphere, mesh_scene

WIDTHS = (2, 4, 8)
FOV = 40.0  # degrees


def load(path: Path) -> tuple[Array, Array]:
    """Vertices (V, 3) and triangles (T, 3) of a PLY file, plain or in gzip."""
    data = path.read_bytes()
    vertices, triangles, *_ = ply.read(gzip.decompress(data) if path.suffix == ".gz" else data)
    return vertices, triangles


def look(vertices: Array) -> veriray.Camera:
    """A camera that sees the whole mesh from the front, a little from above."""
    low, high = vertices.min(axis=0), vertices.max(axis=0)
    middle, size = (low + high) / 2, float((high - low).max())
    return veriray.Camera.look_at(middle + size * np.array([0, 0.15, 1.9]), middle, fov=FOV)


def build(
    device: veriray.Device, scene: veriray.Scene, rounds: int, builder: str
) -> tuple[Any, dict[str, Any]]:
    """The native scene and its times."""
    arguments, walls, trees = native_scene_arguments(scene), [], []
    calls: list[float] = []
    host = None
    for _ in range(rounds):
        host = None  # the memory of the one before is free again
        begin = time.perf_counter()
        host = device.native.Scene(
            **arguments, device=device.index, progress=calls.append, builder=builder
        )
        walls.append(time.perf_counter() - begin)
        trees.append(host.tree["seconds"])
    return host, {
        **scene_facts(host),
        "memory": host.memory,
        "tree_seconds": float(np.median(trees)),
        "scene_seconds": float(np.median(walls)),
        "spread": {"tree": spread(trees), "scene": spread(walls)},
        "progress_calls": len(calls) / rounds,
    }


def camera_rays(camera: veriray.Camera, size: int) -> tuple[Array, Array]:
    """Origins and directions (size^2, 3) through the pixels' centres."""
    side = (1 - (np.arange(size) + 0.5) / size * 2) * np.tan(np.radians(FOV / 2))
    y, x = np.meshgrid(side, side, indexing="ij")
    local = np.stack([x.ravel(), y.ravel(), np.ones(size * size)], axis=1)
    d = local @ camera.to_world[:3, :3].T
    d /= np.linalg.norm(d, axis=1, keepdims=True)
    return np.broadcast_to(camera.to_world[:3, 3], d.shape).copy(), d


def second_rays(
    scene: veriray.Scene, o: Array, d: Array, t: Array, primitive: Array
) -> dict[str, tuple[Array, Array]]:
    """Diffuse rays, and rays to a lamp, from the hits of the rays (o, d)."""
    met = primitive >= 0
    o, d, t = o[met], d[met], t[met].astype(np.float64)[:, None]
    v = scene.vertices[scene.triangles[primitive[met]]]
    n = np.cross(v[:, 1] - v[:, 0], v[:, 2] - v[:, 0])
    n /= np.linalg.norm(n, axis=1, keepdims=True)
    n *= -np.sign((n * d).sum(axis=1, keepdims=True))
    size = np.ptp(scene.vertices, axis=0).max()
    p = o + t * d + 1e-5 * size * n
    rng = np.random.default_rng(1)
    ball = rng.normal(size=p.shape)
    diffuse = n + 0.9999999 * ball / np.linalg.norm(ball, axis=1, keepdims=True)
    lamp = scene.vertices.mean(axis=0) + size * np.array([1.0, 2.0, 1.5])
    to_lamp = lamp + 0.3 * size * rng.uniform(-1, 1, p.shape) - p
    return {
        name: (p, w / np.linalg.norm(w, axis=1, keepdims=True))
        for name, w in (("diffuse", diffuse), ("to_lamp", to_lamp))
    }


def trace(device: veriray.Device, host: Any, o: Array, d: Array, rounds: int) -> dict[str, Any]:
    """Rates of one set of rays by width; whether all give the same hits."""
    native = device.native

    def plain() -> tuple[Array, Array, float]:
        begin = time.perf_counter()
        t, primitive = native.intersect(host, o, d)
        return t, primitive, time.perf_counter() - begin

    t0, primitive0, _ = plain()
    out: dict[str, Any] = {"rays": len(o), "hits": int((primitive0 >= 0).sum()), "same_hits": True}
    if hasattr(native, "intersect_width"):
        ways = {str(w): lambda w=w: native.intersect_width(host, w, o, d) for w in WIDTHS}
    else:
        ways = {"intersect": plain}
    for name, way in ways.items():
        t, primitive, _ = way()
        same = np.array_equal(primitive, primitive0) and t.tobytes() == t0.tobytes()
        out["same_hits"] &= same
        seconds = [way()[2] for _ in range(rounds)]
        middle = float(np.median(seconds))
        out[name] = {"seconds": middle, "spread": spread(seconds),
                     "mrays_per_second": len(o) / middle / 1e6, "same_hits": same}  # fmt: skip
    return out


def measure(
    device: veriray.Device, vertices: Array, triangles: Array, size: int, rounds: int, builder: str
) -> dict[str, Any]:
    """One mesh."""
    scene = mesh_scene(vertices, triangles, look(vertices))
    host, row = build(device, scene, rounds, builder)
    o, d = camera_rays(scene.camera, size)
    sets = {"camera": (o, d), **second_rays(scene, o, d, *device.native.intersect(host, o, d))}
    row["rays"] = {name: trace(device, host, *rays, rounds) for name, rays in sets.items()}
    return {"triangles": len(triangles), **row}


def main() -> int:
    """Command line."""
    p = parser(__doc__, "tree_DEVICE.json")
    p.add_argument("--mesh", type=Path, nargs="*", default=[], help="PLY files, or .ply.gz")
    p.add_argument("--levels", type=int, nargs="*", default=[6, 8], help="of the icospheres")
    p.add_argument("--device", default="cuda")
    p.add_argument("--size", type=int, default=1024, help="camera rays along a side")
    p.add_argument("--rounds", type=int, default=5)
    p.add_argument("--builder", default="sah", help="sah or ploc")
    args = p.parse_args()
    device, _ = veriray.device.select(args.device)
    result = header("tree")
    result["device"] = {"name": device.name, "description": device.description, **device.details}
    result["build"] = device.native.build_info()
    result["settings"] = {
        "size": args.size,
        "rounds": args.rounds,
        "threads": cpu_count(),
        "builder": args.builder,
    }
    meshes: dict[str, Any] = {
        f"icosphere_{20 * 4**n}": lambda n=n: displaced_icosphere(n) for n in args.levels
    }
    meshes |= {path.name.split(".")[0]: lambda path=path: load(path) for path in args.mesh}
    rows = {}
    for name, make in meshes.items():
        row = rows[name] = measure(device, *make(), args.size, args.rounds, args.builder)
        print(
            f"{name}: {row['triangles']} triangles, tree {row['tree_seconds']:.3f} s, native "
            f"scene {row['scene_seconds']:.3f} s, {row['progress_calls']:.0f} progress calls"
        )
        for kind, rays in row["rays"].items():
            rates = ", ".join(
                f"{way} {r['mrays_per_second']:.1f}"
                for way, r in rays.items()
                if isinstance(r, dict)
            )
            print(f"  {kind}: {rays['rays']} rays, Mrays/s by width: {rates}"
                  + ("" if rays["same_hits"] else "; THE HITS DIFFER"), flush=True)  # fmt: skip
    name = args.output.name.replace("DEVICE", device.backend)
    write({**result, "rows": rows}, args.output.with_name(name))
    same = all(rays["same_hits"] for row in rows.values() for rays in row["rays"].values())
    return 0 if same else 1


if __name__ == "__main__":
    sys.exit(main())
