"""Whole scene files beside Mitsuba: seconds to load them and to render a picture, and its variance.

    python benchmarks/rooms.py scene.xml ... --device cpu --peer llvm_ad_rgb
    python benchmarks/rooms.py scene.xml ... --device cuda:0 --peer cuda_ad_rgb --width 640 --spp 64

Both render the same file with --width columns and the file's aspect ratio, in turn, after one
picture each to warm up. Load: the second of two loads. Wall: median seconds until the picture is in
NumPy. Variance: as `veriray bench matrix`. Ratios are Mitsuba's over ours. For figures to quote,
nothing else may run.
"""

from __future__ import annotations

import time
from pathlib import Path
from statistics import median
from typing import Any

import numpy as np
from common import Array, header, parser, write

import veriray as vr
from veriray_bench.matrix import variance
from veriray_bench.mitsuba import start


def measured(path: Path, mi: Any, a: Any) -> dict[str, Any]:
    """A row."""
    loads: tuple[list[float], list[float]] = [], []
    for _ in range(2):
        begin = time.perf_counter()
        ours = vr.load_file(path)
        loads[0].append(time.perf_counter() - begin)
        begin = time.perf_counter()
        theirs = mi.load_file(str(path))
        loads[1].append(time.perf_counter() - begin)
    height = max(1, round(a.width * ours.film.height / ours.film.width))
    handles = mi.traverse(theirs.sensors()[0])
    handles["film.size"] = handles["film.crop_size"] = [a.width, height]
    handles.update()
    film = {"width": a.width, "height": height, "spp": a.spp, "device": a.device}
    walls: tuple[list[float], list[float]] = [], []
    pictures: tuple[list[Array], list[Array]] = [], []
    for k in range(a.rounds + 1):
        for which in range(2):
            begin = time.perf_counter()
            if which == 0:
                picture = np.asarray(vr.render(ours, seed=k, **film).image)
            else:
                picture = np.array(mi.render(theirs, spp=a.spp, seed=k))[..., :3]
            if k:
                walls[which].append(time.perf_counter() - begin)
                pictures[which].append(picture.astype(np.float64))
    stacks = [np.array(p) for p in pictures]
    mean = (stacks[0].mean(axis=0) + stacks[1].mean(axis=0)) / 2
    seconds = [median(w) for w in walls]
    wall = seconds[1] / seconds[0]
    noise = variance(stacks[1], mean)[0] / variance(stacks[0], mean)[0]
    row = {
        "file": f"{path.parent.name}/{path.name}", "size": [a.width, height],
        "load_seconds": [part[1] for part in loads], "wall_seconds": seconds,
        "wall": wall, "variance": noise, "efficiency": wall * noise,
        "means": [stack.mean(axis=(0, 1, 2)).tolist() for stack in stacks],
        "means_stderr": [
            (stack.mean(axis=(1, 2)).std(axis=0, ddof=1) / len(stack) ** 0.5).tolist()
            for stack in stacks
        ],
    }  # fmt: skip
    print({k: np.round(v, 3).tolist() if k != "file" else v for k, v in row.items()}, flush=True)
    return row


def main() -> None:
    """Measures all files and writes them."""
    p = parser(__doc__, "rooms.json")
    p.add_argument("files", nargs="+", type=Path)
    p.add_argument("--device", default="cpu")
    p.add_argument("--peer", default="llvm_ad_rgb", help="variant of Mitsuba")
    p.add_argument("--width", type=int, default=320)
    p.add_argument("--spp", type=int, default=32)
    p.add_argument("--rounds", type=int, default=6)
    a = p.parse_args()
    mi = start(a.peer)
    result = header("rooms", "mitsuba")
    result["settings"] = {
        k: getattr(a, k) for k in ("device", "peer", "width", "spp", "rounds")
    } | {"order": "veriray, mitsuba"}
    result["rooms"] = [measured(path, mi, a) for path in a.files]
    write(result, a.output)


if __name__ == "__main__":
    main()
