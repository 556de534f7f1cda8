"""From a mesh file to the first picture: seconds and peak host memory, with Mitsuba beside it.

    python benchmarks/loading.py --device cuda:0 --sizes 82000 1300000 5200000 --formats ply
    python benchmarks/loading.py --device cpu --peer llvm_ad_rgb --repeats 3

Each measurement is a process of its own that has rendered a small mesh of the same format before,
so that modules, kernels and the device are ready. The file has just been written. Only the public
interface is used. Columns: seconds of load and of the first picture (1 sample per pixel, until it
is in NumPy), medians of the repeats, in which the renderers take turns; the peak of resident memory
above that before the file was loaded, as a multiple of the file's size.
"""

from __future__ import annotations

import argparse
import json
import resource
import statistics
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

Array = npt.NDArray[Any]
FORMATS = ("ply", "ply_normals", "ply_ascii", "obj", "stl", "serialized")
SIZES = (82_000, 1_300_000, 5_200_000)
_SMALL = 2_000


def mesh(triangles: int) -> tuple[Array, Array]:
    """A bumpy ball of about so many triangles: vertices (V, 3) float32, faces (T, 3) int32."""
    rows = max(3, round((triangles / 4) ** 0.5))
    around = 2 * rows
    polar = (np.arange(rows + 1) / rows * np.pi)[:, None]
    turn = (np.arange(around) / around * 2 * np.pi)[None]
    radius = 1 + 0.05 * np.sin(9 * turn) * np.sin(polar) * np.cos(7 * polar)
    x, y = np.sin(polar) * np.cos(turn), np.sin(polar) * np.sin(turn)
    z = np.broadcast_to(np.cos(polar), x.shape)
    vertices = (np.stack([x, y, z], axis=2) * radius[..., None]).astype(np.float32)
    a = np.arange(rows, dtype=np.int32)[:, None] * around + np.arange(around, dtype=np.int32)
    b = np.roll(a, -1, axis=1)
    faces = np.stack([a, a + around, b + around, a, b + around, b], axis=2)
    return vertices.reshape(-1, 3), faces.reshape(-1, 3)


def _ply(path: Path, vertices: Array, faces: Array, normals: bool) -> None:
    names = [*"xyz", "nx", "ny", "nz"][: 6 if normals else 3]
    head = f"ply\nformat binary_little_endian 1.0\nelement vertex {len(vertices)}\n"
    head += "".join(f"property float {name}\n" for name in names)
    head += f"element face {len(faces)}\nproperty list uchar int vertex_indices\nend_header\n"
    lists = np.empty(len(faces), [("n", "u1"), ("i", "<i4", 3)])
    lists["n"], lists["i"] = 3, faces
    if normals:
        lengths = np.sqrt((vertices**2).sum(axis=1, keepdims=True))
        vertices = np.hstack([vertices, vertices / lengths])
    with path.open("wb") as file:
        file.write(head.encode())
        vertices.astype("<f4").tofile(file)
        lists.tofile(file)


def _text(path: Path, vertices: Array, faces: Array, ply: bool) -> None:
    with path.open("w") as file:
        if ply:
            file.write(f"ply\nformat ascii 1.0\nelement vertex {len(vertices)}\n")
            file.write("".join(f"property float {name}\n" for name in "xyz"))
            file.write(f"element face {len(faces)}\nproperty list uchar int vertex_indices\n")
            file.write("end_header\n")
        before, face = ("", "3 ") if ply else ("v ", "f ")
        file.writelines(f"{before}{x:.7g} {y:.7g} {z:.7g}\n" for x, y, z in vertices.tolist())
        base = 0 if ply else 1
        file.writelines(f"{face}{a + base} {b + base} {c + base}\n" for a, b, c in faces.tolist())


def _stl(path: Path, vertices: Array, faces: Array) -> None:
    table = np.zeros(len(faces), [("n", "<f4", 3), ("v", "<f4", (3, 3)), ("a", "<u2")])
    table["v"] = vertices[faces]
    path.write_bytes(bytes(80) + np.uint32(len(faces)).tobytes() + table.tobytes())


def _serialized(path: Path, vertices: Array, faces: Array) -> None:
    import struct
    import zlib

    body = struct.pack("<I", 0x1000) + b"ball\0" + struct.pack("<QQ", len(vertices), len(faces))
    body += vertices.astype("<f4").tobytes() + faces.astype("<u4").tobytes()
    data = struct.pack("<HH", 0x041C, 4) + zlib.compress(body, 1)
    path.write_bytes(data + struct.pack("<QI", 0, 1))


WRITERS: dict[str, Callable[[Path, Array, Array], None]] = {
    "ply": lambda path, vertices, faces: _ply(path, vertices, faces, False),
    "ply_normals": lambda path, vertices, faces: _ply(path, vertices, faces, True),
    "ply_ascii": lambda path, vertices, faces: _text(path, vertices, faces, True),
    "obj": lambda path, vertices, faces: _text(path, vertices, faces, False),
    "stl": _stl,
    "serialized": _serialized,
}


def scene(path: Path, smooth: bool) -> dict[str, Any]:
    """The mesh under an even sky."""
    to_world = [[-1, 0, 0, 0], [0, 1, 0, 0], [0, 0, -1, 4], [0, 0, 0, 1]]
    film = {"type": "hdrfilm", "width": 512, "height": 512, "rfilter": {"type": "box"}}
    plugin = path.suffix[1:]
    ball: dict[str, Any] = {"type": plugin, "filename": str(path)}
    if not smooth:
        ball["face_normals"] = True
    return {
        "type": "scene",
        "integrator": {"type": "path", "max_depth": 3},
        "sensor": {"type": "perspective", "fov": 40, "to_world": to_world, "film": film},
        "sky": {"type": "constant"},
        "ball": ball,
    }


def _memory(key: str) -> float:
    """Bytes of this process by /proc/self/status: VmRSS now, VmHWM at most."""
    try:
        for line in Path("/proc/self/status").read_text().splitlines():
            if line.startswith(key):
                return float(line.split()[1]) * 1024
    except OSError:
        pass
    return float(resource.getrusage(resource.RUSAGE_SELF).ru_maxrss) * 1024


def worker(renderer: str, path: Path, small: Path, smooth: bool) -> dict[str, float]:
    """Seconds and bytes of one process; renderer: a device of veriray, or "mitsuba VARIANT"."""
    load: Callable[[Any], Any]
    picture: Callable[[Any], Any]
    if renderer.startswith("mitsuba "):
        import mitsuba as mi

        mi.set_variant(renderer.split()[1])

        def prepared(found: dict[str, Any]) -> Any:
            matrix = found["sensor"]["to_world"]
            found["sensor"]["to_world"] = mi.ScalarTransform4f(np.array(matrix, float))
            return mi.load_dict(found)

        load, picture = prepared, lambda made: np.array(mi.render(made, spp=1))
    else:
        import veriray

        load = veriray.load_dict

        def picture(made: Any) -> Any:
            return np.asarray(veriray.render(made, spp=1, device=renderer).image)

    picture(load(scene(small, smooth)))
    before = _memory("VmRSS")
    try:
        Path("/proc/self/clear_refs").write_text("5")  # the peak starts anew
    except OSError:
        pass
    start = time.perf_counter()
    made = load(scene(path, smooth))
    loaded = time.perf_counter()
    mean = float(picture(made).mean())
    end = time.perf_counter()
    peak = _memory("VmHWM") - before
    return {"load": loaded - start, "first": end - loaded, "peak": peak, "mean": mean}


def main() -> None:
    """Measures what the command line asks for, and prints a table."""
    parser = argparse.ArgumentParser(description=__doc__.split("\n")[0])
    parser.add_argument("--device", default="cpu")
    parser.add_argument("--peer", help="a variant of Mitsuba, for example cuda_ad_rgb")
    parser.add_argument("--sizes", nargs="+", type=int, default=SIZES, help="triangles")
    parser.add_argument("--formats", nargs="+", choices=FORMATS, default=["ply"])
    parser.add_argument("--smooth", action="store_true", help="with shading normals")
    parser.add_argument("--repeats", type=int, default=3)
    parser.add_argument("--json", type=Path, help="all measurements, written there")
    parser.add_argument("--worker", nargs=3, help=argparse.SUPPRESS)
    given = parser.parse_args()
    if given.worker:
        renderer, path, small = given.worker
        print(json.dumps(worker(renderer, Path(path), Path(small), given.smooth)))
        return
    renderers = [given.device] + ([f"mitsuba {given.peer}"] if given.peer else [])
    rows = []
    print("format      triangles      MB  renderer               load s  first s  sum s  peak/file")
    with tempfile.TemporaryDirectory() as folder:
        for form in given.formats:
            small = Path(folder) / f"small.{form.partition('_')[0]}"
            WRITERS[form](small, *mesh(_SMALL))
            for size in given.sizes:
                path = Path(folder) / f"mesh.{form.partition('_')[0]}"
                vertices, faces = mesh(size)
                WRITERS[form](path, vertices, faces)
                count, taken = len(faces), path.stat().st_size
                del vertices, faces
                smooth = ["--smooth"] * given.smooth
                taking = renderers[:1] if form == "stl" else renderers  # Mitsuba has no STL
                found: dict[str, list[dict[str, float]]] = {name: [] for name in taking}
                for _ in range(given.repeats):
                    for name in taking:
                        command = [sys.executable, __file__, "--worker", name, path, small]
                        run = subprocess.run(
                            list(map(str, [*command, *smooth])), capture_output=True, text=True
                        )
                        if run.returncode:
                            sys.exit(f"{name}: {run.stderr.strip().splitlines()[-1:]}")
                        at = run.stdout.rindex('{"load"')  # Mitsuba logs to stdout too
                        found[name].append(json.JSONDecoder().raw_decode(run.stdout, at)[0])
                for name, runs in found.items():
                    load, first, peak = (
                        statistics.median(run[key] for run in runs)
                        for key in ("load", "first", "peak")
                    )
                    rows.append({"format": form, "triangles": count, "bytes": taken,
                                 "renderer": name, "runs": runs})  # fmt: skip
                    print(
                        f"{form:11s} {count:9d} {taken / 1e6:7.1f}  {name:20s} {load:8.3f} "
                        f"{first:8.3f} {load + first:6.3f} {peak / taken:10.1f}",
                        flush=True,
                    )
                path.unlink()
    if given.json:
        given.json.write_text(json.dumps(rows, indent=1) + "\n")


if __name__ == "__main__":
    main()
