"""How often does the verdict of `veriray compare` accuse a sound render?

Renders the Cornell box with --seeds seeds at the effort of the shipped reference and compares each
with it. At a family-wise rate of 1e-3 a failure is expected in 3 of 100 studies of 30 seeds. All
seeds share one reference, so they are not independent. Exit status 1 with more than one failure.
"""

from __future__ import annotations

import sys
from typing import Any

import numpy as np
from common import ROOT, Meter, header, parser, write

import veriray
from veriray.image import load

SCENE = ROOT / "scenes" / "cornell" / "cornell_box.xml"
REFERENCE = ROOT / "scenes" / "cornell" / "refs" / "cornell_box_128.exr"


def main() -> int:
    """Command line."""
    p = parser(__doc__, "false_alarms.json")
    p.add_argument("--seeds", type=int, default=30)
    p.add_argument("--first", type=int, default=1, help="first seed")
    p.add_argument("--device", default="auto")
    args = p.parse_args()
    reference = load(REFERENCE)
    if reference.batch_means is None:
        raise SystemExit(f"{REFERENCE.name} has no batch means")
    scene = veriray.load_file(SCENE)
    settings = {
        "spp": reference.spp, "batches": len(reference.batch_means), "width": reference.width,
        "height": reference.height, "max_depth": reference.stats["max_depth"],
        "rr_depth": reference.stats["rr_depth"],
    }  # fmt: skip
    result = header("false_alarms")
    result["settings"] = {"scene": SCENE.name, "reference": REFERENCE.name, "alpha": 1e-3,
                          **settings}  # fmt: skip
    rows: list[dict[str, Any]] = []
    for seed in range(args.first, args.first + args.seeds):
        with Meter() as m:
            render = veriray.render(scene, seed=seed, device=args.device, **settings)
        report = veriray.compare(render, reference)
        p_values = {t.name: t.p for t in report.tests if t.p is not None}
        failed = [t.name for t in report.tests if t.result == "fail"]
        rows.append({
            "seed": seed, "result": report.result, "failed": failed, "p": p_values,
            "figures": report.figures, "film_sha256": render.film_sha256,
            "device": render.stats["device"], **m.row(),
        })  # fmt: skip
        smallest = min(p_values, key=lambda name: p_values[name])
        print(f"seed {seed}: {report.result}, smallest p {p_values[smallest]:.4g} ({smallest})",
              flush=True)  # fmt: skip
    passed = sum(row["result"] == "pass" for row in rows)
    p_all = {name: [row["p"][name] for row in rows if name in row["p"]] for name in rows[0]["p"]}
    result["passed"], result["seeds"] = passed, len(rows)
    result["share_of_p_below"] = {
        name: {str(level): float(np.mean(np.array(v) <= level)) for level in (0.01, 0.05, 0.5)}
        for name, v in p_all.items()
    }
    result["mean_independence"] = float(np.mean([r["figures"]["independence_a"] for r in rows]))
    print(f"{passed} of {len(rows)} seeds pass")
    write({**result, "rows": rows}, args.output)
    return 0 if passed >= len(rows) - 1 else 1


if __name__ == "__main__":
    sys.exit(main())
