"""What feature images cost, as a share of a picture of 64 samples a pixel and 8 segments a path.

Depth, position, both normals, albedo and alpha with 8 samples, and a light group, each as a share
of the picture beside it, in two ways:

- `call`: what `veriray.render` takes, with and without. It returns once everything is made and in
  memory of its device, where others may read the picture. The target is of this: the six images
  cost 10 % at most. Status 0: they do.
- `numpy`: the same until all is in NumPy arrays: picture and images, each with its errors.

Calls with and without take turns; the least of the rounds counts, of the process's time on a CPU,
of the clock on CUDA.

    python benchmarks/feature_cost.py --device cuda:0 -o benchmarks/results/feature_cost_cuda.json
"""

from __future__ import annotations

import sys
import time
from collections.abc import Callable
from typing import Any

from common import ROOT, header, parser, write

import veriray as vr

SIX = "depth,position,normal,geo_normal,albedo,alpha"
SCENES = {
    "cornell-box": "cornell-box",
    "cornell-box-mitsuba": "cornell-box-mitsuba",
    **{f"checks/{n}": ROOT / "scenes" / "checks" / f"{n}.xml"
       for n in ("textures", "smooth_normals", "spheres_300")},
}  # fmt: skip
TARGET = 0.1


def least(rounds: int, clock: Callable[[], float], *calls: Callable[[], object]) -> list[float]:
    """Seconds of each call: the least of rounds in which they take turns."""
    found = [float("inf")] * len(calls)
    for _ in range(rounds + 1):  # the first warms up
        for k, call in enumerate(calls):
            start = clock()
            call()
            found[k] = min(found[k], clock() - start)
    return found


def main() -> int:
    """Writes and prints the result."""
    p = parser(__doc__, "feature_cost.json")
    p.add_argument("--device", default="auto")
    p.add_argument("--size", type=int, nargs="+", default=[256, 512])
    p.add_argument("--rounds", type=int, default=7)
    given = p.parse_args()
    clock = time.process_time if given.device.startswith("cpu") else time.perf_counter
    result = header("feature_cost", "numpy") | {"device": given.device, "rows": []}
    for name, file in SCENES.items():
        scene = vr.load_file(file)
        for size in given.size:
            settings: dict[str, Any] = {
                "spp": 64, "max_depth": 8, "width": size, "height": size, "device": given.device,
                "threads": 1 if given.device.startswith("cpu") else None,
            }  # fmt: skip

            def draw(arrays: bool, settings: dict[str, Any] = settings, scene: vr.Scene = scene,
                     **more: Any) -> None:  # fmt: skip
                made = vr.render(scene, **settings, **more)
                if arrays:
                    features = made.features
                    _ = made.image, made.stderr, [*features.values()], [*features.stderr.values()]

            row: dict[str, Any] = {"scene": name, "size": size}
            for way, arrays in (("call", False), ("numpy", True)):
                plain, six, lamp = least(
                    given.rounds, clock,
                    lambda draw=draw, arrays=arrays: draw(arrays),
                    lambda draw=draw, arrays=arrays: draw(arrays, features=SIX),
                    lambda draw=draw, arrays=arrays: draw(arrays, light_groups={"all": "*"}),
                )  # fmt: skip
                row[way] = {
                    "seconds": plain, "six": six / plain - 1, "light_group": lamp / plain - 1,
                }  # fmt: skip
            result["rows"].append(row)
            print(
                f"{name:22} {size:5}  "
                + "  ".join(
                    f"{way}: {row[way]['seconds']:.4f} s, six images {row[way]['six']:.1%}, "
                    f"light group {row[way]['light_group']:.1%}" for way in ("call", "numpy")
                ), flush=True,
            )  # fmt: skip
    worst = max(row["call"]["six"] for row in result["rows"])
    result["target"], result["worst"] = TARGET, worst
    write(result, given.output)
    return int(worst > TARGET)


if __name__ == "__main__":
    sys.exit(main())
