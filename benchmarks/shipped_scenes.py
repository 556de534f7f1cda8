"""Speed and film hash of every shipped scene on one device: two builds, scene by scene.

    python benchmarks/shipped_scenes.py --device cuda:0 -o after.json
    PYTHONPATH=OLD/python python benchmarks/shipped_scenes.py --device cuda:0 -o before.json
    python benchmarks/shipped_scenes.py --compare before.json after.json

A scene's speed is the best of the rounds, in paths per second of `stats["seconds"]`; to compare
builds, run them in turn on one machine (several files of one build may be given: `--compare A1,A2
B1,B2` takes the best of each). hashes: of a small film, by scheduler; equal on all devices of a
build. Scenes that need parameters without defaults are left out.
"""

from __future__ import annotations

import argparse
import json
import math
from pathlib import Path
from typing import Any

from common import ROOT, header, write

import veriray as vr

SIZE, SPP, ROUNDS = 512, 64, 3
CPU_SIZE, CPU_SPP = 192, 32
SCHEDULERS = ("fused", "wavefront", "thrust")


def measure(path: Path, device: str) -> dict[str, Any]:
    """Best of the rounds, in paths per second, and hashes."""
    scene = vr.load_file(path)
    size, spp = (SIZE, SPP) if device.startswith("cuda") else (CPU_SIZE, CPU_SPP)
    film: dict[str, Any] = {"width": size, "height": size, "device": device}
    vr.render(scene, spp=max(1, spp // 4), **film)
    seconds = min(vr.render(scene, spp=spp, **film).stats["seconds"] for _ in range(ROUNDS))
    small: dict[str, Any] = {"width": 32, "height": 32, "spp": 16, "device": device}
    hashes = {s: vr.render(scene, scheduler=s, **small).film_sha256 for s in SCHEDULERS}
    return {"paths_per_second": size * size * spp / seconds, "hashes": hashes}


def run(device: str) -> dict[str, Any]:
    """All scenes."""
    result = {**header("shipped scenes"), "device": device, "scenes": {}}
    for path in sorted((ROOT / "scenes").glob("**/*.xml")):
        try:
            row = measure(path, device)
        except vr.SceneError as error:
            print(f"left out: {path.name}: {error}")
            continue
        result["scenes"][path.relative_to(ROOT / "scenes").as_posix()] = row
    return result


def best(files: str) -> dict[str, float]:
    """Of several files of one build."""
    speeds: dict[str, float] = {}
    for name in files.split(","):
        for scene, row in json.loads(Path(name).read_text())["scenes"].items():
            speeds[scene] = max(speeds.get(scene, 0.0), row["paths_per_second"])
    return speeds


def compare(before: str, after: str) -> None:
    """A table of both and their ratio."""
    a, b = best(before), best(after)
    ratios = {scene: b[scene] / a[scene] for scene in sorted(a.keys() & b.keys())}
    for scene, ratio in ratios.items():
        print(f"{scene:40} {a[scene] / 1e6:9.1f} {b[scene] / 1e6:9.1f} Mpaths/s  {ratio:6.3f}")
    mean = math.exp(sum(map(math.log, ratios.values())) / len(ratios))
    print(f"{len(ratios)} scenes: least {min(ratios.values()):.3f}, geometric mean {mean:.3f}")


def main() -> None:
    """Measure or compare."""
    p = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    p.add_argument("--device", default="cpu")
    p.add_argument("-o", "--output", type=Path)
    p.add_argument("--compare", nargs=2, metavar=("BEFORE", "AFTER"))
    args = p.parse_args()
    if args.compare:
        compare(*args.compare)
    else:
        write(run(args.device), args.output or Path(f"shipped_scenes_{args.device[:4]}.json"))


if __name__ == "__main__":
    main()
