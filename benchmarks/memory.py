"""Peak memory of a render against the number of samples: spp never enters the formula.

A process of its own per run; peak resident set size, medians over --repeat runs. On Linux that is
VmHWM: getrusage would also count the peak of the parent, which exec hands on. Exit status 1 if the
peaks differ by 1 % or more, or if scene and film differ by one byte.
"""

from __future__ import annotations

import json
import statistics
import subprocess
import sys
from typing import Any

from common import header, parser, write

_CHILD = """
import json, pathlib, resource, sys
import veriray
scene, spp, size, device, scheduler = sys.argv[1:]
size = int(size)
r = veriray.render(veriray.load_file(scene), spp=int(spp), width=size, height=size, device=device,
                   scheduler=scheduler)
status = pathlib.Path("/proc/self/status")
if status.exists():
    peak = int(status.read_text("utf-8").split("VmHWM:")[1].split()[0]) * 1024
else:
    unit = 1 if sys.platform == "darwin" else 1024
    peak = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss * unit
print(json.dumps({"peak_rss": peak,
                  "scene_and_film": r.stats["memory"], "seconds": r.stats["seconds"],
                  "device": r.stats["device"], "film_sha256": r.film_sha256}))
"""


def run(*arguments: object) -> dict[str, Any]:
    """One render in a process of its own."""
    words = [sys.executable, "-c", _CHILD, *map(str, arguments)]
    done = subprocess.run(words, check=True, capture_output=True, text=True)
    answer: dict[str, Any] = json.loads(done.stdout)
    return answer


def main() -> int:
    """Command line."""
    p = parser(__doc__, "memory.json")
    p.add_argument("--scene", default="cornell-box")
    p.add_argument("--spp", type=int, nargs="+", default=[16, 4096])
    p.add_argument("--size", type=int, default=256, help="width and height")
    p.add_argument("--device", default="auto")
    p.add_argument("--scheduler", default="fused")
    p.add_argument("--repeat", type=int, default=3)
    args = p.parse_args()
    result = header("memory")
    result["settings"] = {
        "scene": args.scene, "width": args.size, "height": args.size, "scheduler": args.scheduler,
        "repeat": args.repeat,
    }  # fmt: skip
    rows = []
    for spp in args.spp:
        runs = [
            run(args.scene, spp, args.size, args.device, args.scheduler) for _ in range(args.repeat)
        ]
        peak = statistics.median(r["peak_rss"] for r in runs)
        rows.append({"spp": spp, "peak_rss": peak, "runs": runs})
        print(f"{spp:6d} spp: peak {peak / 2**20:.2f} MiB, of which scene and film "
              f"{runs[0]['scene_and_film'] / 2**20:.2f} MiB")  # fmt: skip
    peaks = [row["peak_rss"] for row in rows]
    spread = max(peaks) / min(peaks) - 1
    own = {r["scene_and_film"] for row in rows for r in row["runs"]}
    print(f"largest over smallest peak: +{spread:.3%}")
    write({**result, "rows": rows, "spread": spread}, args.output)
    return 0 if spread < 0.01 and len(own) == 1 else 1


if __name__ == "__main__":
    sys.exit(main())
