"""What a change costs between two renders.

Wall time of `veriray.render` (512 x 512, 1 sample per pixel) over one mesh, in alternation: of the
same scene, with another camera, another colour and another size; and of 1,000 cameras of the
Cornell box (256 x 256, 16 samples) against the device's time. Uses the public interface alone, so
it runs with older versions too: python benchmarks/moves.py --device cuda:0
"""

from __future__ import annotations

import argparse
import json
import math
import tempfile
import time
from pathlib import Path

import numpy as np

import veriray as vr


def sphere(fine: int) -> tuple[np.ndarray, np.ndarray]:
    """Vertices and faces of an octahedron divided `fine` times: 8 * 4^fine faces."""
    vertices = np.array([[1, 0, 0], [-1, 0, 0], [0, 1, 0], [0, -1, 0], [0, 0, 1], [0, 0, -1.0]])
    faces = np.array([[a, b, c] for a in (0, 1) for b in (2, 3) for c in (4, 5)])
    for _ in range(fine):
        edges = np.sort(faces[:, [[0, 1], [1, 2], [2, 0]]].reshape(-1, 2), axis=1)
        pairs, place = np.unique(edges, axis=0, return_inverse=True)
        middle = vertices[pairs].sum(axis=1)
        middle /= np.linalg.norm(middle, axis=1, keepdims=True)
        m = place.reshape(-1, 3) + len(vertices)
        vertices = np.concatenate([vertices, middle])
        a, b, c = faces.T
        faces = np.concatenate([np.stack(f, axis=1) for f in (
            (a, m[:, 0], m[:, 2]), (m[:, 0], b, m[:, 1]), (m[:, 2], m[:, 1], c),
            (m[:, 0], m[:, 1], m[:, 2]),
        )])  # fmt: skip
    corners = vertices[faces]
    out = np.einsum("ij,ij->i", np.cross(corners[:, 1] - corners[:, 0],
                                         corners[:, 2] - corners[:, 0]), corners[:, 0])  # fmt: skip
    faces[out < 0] = faces[out < 0][:, ::-1]
    return vertices, faces


def mesh_scene(fine: int) -> vr.Scene:
    """The sphere under a constant sky."""
    vertices, faces = sphere(fine)
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "sphere.ply"
        header = (
            f"ply\nformat binary_little_endian 1.0\nelement vertex {len(vertices)}\n"
            "property float x\nproperty float y\nproperty float z\n"
            f"element face {len(faces)}\nproperty list uchar int vertex_indices\nend_header\n"
        )
        rows = np.empty(len(faces), np.dtype([("n", "u1"), ("v", "<i4", 3)]))
        rows["n"], rows["v"] = 3, faces
        path.write_bytes(header.encode() + vertices.astype("<f4").tobytes() + rows.tobytes())
        return vr.load_dict({
            "type": "scene",
            "integrator": {"type": "path"},
            "sensor": {
                "type": "perspective", "fov": 40.0,
                "to_world": vr.Camera.look_at([0, 1, 4], [0, 0, 0], fov=40).to_world,
                "film": {"type": "hdrfilm", "width": 512, "height": 512},
                "sampler": {"type": "independent", "sample_count": 1},
            },
            "sky": {"type": "constant", "radiance": 1.0},
            "ball": {
                "type": "ply", "filename": str(path), "face_normals": True,
                "bsdf": {"type": "diffuse", "id": "paint",
                         "reflectance": {"type": "rgb", "value": [0.5, 0.4, 0.3]}},
            },
        })  # fmt: skip


def around(angle: float) -> vr.Camera:
    """A camera on a circle about the sphere."""
    return vr.Camera.look_at([4 * math.sin(angle), 1, 4 * math.cos(angle)], [0, 0, 0], fov=40)


def wall(scene: vr.Scene, device: str) -> float:
    """Seconds of a render."""
    start = time.perf_counter()
    vr.render(scene, device=device)
    return time.perf_counter() - start


def mesh(device: str, fine: int, rounds: int) -> dict[str, object]:
    """Times of changes, in turn."""
    scene = mesh_scene(fine)
    first = wall(scene, device)
    names = scene.parameters()
    paint = next(name for name in names if name.endswith("reflectance"))
    cases = {
        "unmoved": lambda k: scene,
        "moved": lambda k: scene.with_(camera=around(0.01 * (k + 1))),
        "colour": lambda k: scene.with_({paint: 0.3 + 0.001 * k}),
        "light": lambda k: scene.with_({"environment.radiance": 1 + 0.001 * k}),
        "size": lambda k: scene.with_(width=500 + k % 8),
    }
    times: dict[str, list[float]] = {name: [] for name in cases}
    for k in range(rounds):
        for name, change in cases.items():
            start = time.perf_counter()
            changed = change(k)
            vr.render(changed, device=device)
            times[name].append(time.perf_counter() - start)
    medians = {name: 1e3 * float(np.median(t)) for name, t in times.items()}
    return {
        "triangles": len(scene.triangles), "first_ms": 1e3 * first,
        **{f"{name}_ms": ms for name, ms in medians.items()},
        **{f"{name}_over_unmoved_ms": ms - medians["unmoved"] for name, ms in medians.items()},
    }  # fmt: skip


def cornell(device: str, cameras: int) -> dict[str, object]:
    """Times of many cameras."""
    box = vr.load_file("cornell-box-mitsuba").with_(width=256, height=256, spp=16)
    rng = np.random.default_rng(1)
    old = box.camera.to_world[:3, 3]
    views = [
        vr.Camera.look_at(old + rng.uniform(-0.3, 0.3, 3), [0, 0, 0], fov=40)
        for _ in range(cameras)
    ]
    vr.render(box, device=device)
    start, seconds = time.perf_counter(), 0.0
    for view in views:
        seconds += vr.render(box.with_(camera=view), device=device).stats["seconds"]
    total = time.perf_counter() - start
    start = time.perf_counter()
    vr.render(box, device=device, cameras=views)
    listed = time.perf_counter() - start
    return {
        "cameras": cameras, "wall_ms_each": 1e3 * total / cameras,
        "native_ms_each": 1e3 * seconds / cameras, "ratio": total / seconds,
        "listed_ms_each": 1e3 * listed / cameras, "listed_ratio": listed / seconds,
    }  # fmt: skip


def main() -> None:
    """Prints the times as JSON."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--device", default="auto")
    parser.add_argument("--fine", type=int, default=9, help="of the mesh: 8 * 4^fine triangles")
    parser.add_argument("--rounds", type=int, default=15)
    parser.add_argument("--cameras", type=int, default=1000)
    given = parser.parse_args()
    print(json.dumps({
        "version": vr.__version__, "device": given.device,
        "mesh": mesh(given.device, given.fine, given.rounds),
        "cornell": cornell(given.device, given.cameras),
    }, indent=1))  # fmt: skip


if __name__ == "__main__":
    main()
