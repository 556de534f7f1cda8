"""`sobol` beside `independent` over the classes of `veriray bench matrix`: time, variance, errors.

    python benchmarks/samplers.py --device cuda:0 --size 512 --spp 64 --pictures 5 -o FILE

Of each class one scene by its rule. The two take turns, each picture with a seed of its own.
gain: variance of independent over sobol, over pictures, relative as in `veriray_bench.matrix`;
wall, device: seconds of sobol over independent, medians; efficiency: gain / wall; claimed: squared
standard errors over that variance, of each. Means are geometric.
"""

from __future__ import annotations

import argparse
import json
import tempfile
import time
import warnings
from pathlib import Path
from typing import Any

import numpy as np

import veriray
from veriray.errors import SceneWarning
from veriray_bench.matrix_rules import RULES, Rule

SAMPLERS = ("independent", "sobol")


def measured(rule: Rule, folder: Path, given: argparse.Namespace) -> dict[str, Any]:
    """The figures of one class."""
    scene = veriray.load_file(rule.write(1, folder, given.device.startswith("cuda")))
    scene = scene.with_(
        width=given.size, height=given.size, max_depth=rule.max_depth, rr_depth=rule.rr_depth
    )
    images: dict[str, list[Any]] = {name: [] for name in SAMPLERS}
    claims: dict[str, list[Any]] = {name: [] for name in SAMPLERS}
    seconds: dict[str, list[tuple[float, float]]] = {name: [] for name in SAMPLERS}
    for seed in range(given.pictures + 1):
        for name in SAMPLERS:
            start = time.perf_counter()
            made = veriray.render(scene, given.spp, seed, device=given.device, sampler=name)
            image = made.image
            wall = time.perf_counter() - start
            if seed:  # the first one loads kernels
                images[name].append(image.astype(np.float64))
                claims[name].append(made.stderr.astype(np.float64) ** 2)
                seconds[name].append((wall, made.stats["seconds"]))
    mean = np.mean([*images["independent"], *images["sobol"]], axis=0)
    weight = 1 / (mean**2 + 0.01 * mean.mean() ** 2)
    variance = {n: float((np.var(images[n], axis=0, ddof=1) * weight).mean()) for n in SAMPLERS}
    claimed = {n: float((np.mean(claims[n], axis=0) * weight).mean()) for n in SAMPLERS}
    wall, device = np.median(seconds["sobol"], axis=0) / np.median(seconds["independent"], axis=0)
    gain = variance["independent"] / variance["sobol"]
    return {
        "class": rule.name, "gain": gain, "wall": float(wall), "device": float(device),
        "efficiency": gain / float(wall), "scheduler": made.stats["scheduler"],
        "seconds": float(np.median(seconds["sobol"], axis=0)[0]),
        "claimed": {n: claimed[n] / variance[n] for n in SAMPLERS},
    }  # fmt: skip


def main() -> None:
    """Measures, prints and writes."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--device", default="cpu")
    parser.add_argument("--size", type=int, default=64)
    parser.add_argument("--spp", type=int, default=64)
    parser.add_argument("--pictures", type=int, default=10)
    parser.add_argument("--limit", type=float, default=1e9, help="seconds, after which no class")
    parser.add_argument("-o", "--output", type=Path, required=True)
    given = parser.parse_args()
    warnings.simplefilter("ignore", SceneWarning)
    rows, start = list[dict[str, Any]](), time.monotonic()
    with tempfile.TemporaryDirectory() as folder:
        for rule in RULES:
            if time.monotonic() - start > given.limit:
                break
            rows.append(row := measured(rule, Path(folder), given))
            print(
                f"{row['class']:16} gain {row['gain']:5.2f}  wall {row['wall']:5.2f}  efficiency "
                f"{row['efficiency']:5.2f}  claimed {row['claimed']['sobol']:.2f}", flush=True,
            )  # fmt: skip
    means = {
        name: float(np.exp(np.mean([np.log(row[name]) for row in rows])))
        for name in ("gain", "wall", "device", "efficiency")
    }
    print(means, "least efficiency", min(rows, key=lambda row: row["efficiency"])["class"])
    facts = {
        "version": veriray.__version__, "device": given.device, "size": given.size,
        "spp": given.spp, "pictures": given.pictures, "means": means, "classes": rows,
    }  # fmt: skip
    given.output.write_text(json.dumps(facts, indent=1) + "\n", "utf-8")


if __name__ == "__main__":
    main()
