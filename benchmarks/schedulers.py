"""Time of `fused` and `wavefront` on CUDA, scene by scene: where "auto" takes which.

    python benchmarks/schedulers.py --device cuda:0 -o schedulers_h200.json

The scenes of scenes/ and the gallery's with their generated meshes, each with 2^26, 2^22 and 2^18
paths; the films must be equal. ratio: seconds of `fused` over those of `wavefront`, best of three.
"""

from __future__ import annotations

import argparse
import tempfile
from pathlib import Path
from typing import Any

from common import ROOT, header, write

import veriray as vr
from veriray.gallery import pictures

SIZES = {"2^26": (1024, 64), "2^22": (1024, 4), "2^18": (512, 1)}  # side, samples per pixel
SCHEDULERS = ("fused", "wavefront")
ROUNDS = 3


def scenes(folder: Path) -> dict[str, vr.Scene]:
    """All that need no parameters, by name."""
    found = {f"gallery/{name}": pictures.load(name, folder) for name in pictures.names()}
    for path in sorted((ROOT / "scenes").glob("**/*.xml")):
        try:
            found.setdefault(path.relative_to(ROOT / "scenes").as_posix(), vr.load_file(path))
        except vr.SceneError:
            continue  # a value without a default
    return found


def measure(scene: vr.Scene, device: str) -> dict[str, Any]:
    """Seconds by paths and scheduler, and what ran."""
    row: dict[str, Any] = {}
    for paths, (side, spp) in SIZES.items():
        kept = {}
        for scheduler in SCHEDULERS:
            settings = {"width": side, "height": side, "device": device, "scheduler": scheduler}
            vr.render(scene, spp=1, **settings)
            done = [vr.render(scene, spp=spp, **settings) for _ in range(ROUNDS)]
            kept[scheduler] = min(r.stats["seconds"] for r in done)
            row.setdefault("sha256", {}).setdefault(paths, set()).add(done[0].film_sha256)
            row |= {"features": done[0].stats["features"], "variant": done[0].stats["variant"]}
        row[paths] = {**kept, "ratio": kept["fused"] / kept["wavefront"]}
    hashes = row.pop("sha256")
    row["equal"] = all(len(found) == 1 for found in hashes.values())
    return row


def main() -> None:
    """Command line."""
    p = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawTextHelpFormatter)
    p.add_argument("--device", default="cuda:0")
    p.add_argument("-o", "--output", type=Path, default=Path("schedulers.json"))
    arguments = p.parse_args()
    result = {**header("schedulers"), "device": arguments.device, "scenes": {}}
    with tempfile.TemporaryDirectory() as folder:
        for name, scene in scenes(Path(folder)).items():
            row = result["scenes"][name] = measure(scene, arguments.device)
            ratios = "  ".join(f"{paths} {row[paths]['ratio']:.2f}" for paths in SIZES)
            print(f"{name:<36} {ratios}  {'equal' if row['equal'] else 'FILMS DIFFER'}", flush=True)
    write(result, arguments.output)


if __name__ == "__main__":
    main()
