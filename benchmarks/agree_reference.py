"""Agreement with the independent reference renderer on all scenes of scenes/checks.

64 batches of --spp samples from both, independent seeds, the tests S0 to S3 and L4 (ends of paths)
of `veriray.compare` at a family-wise false-alarm rate of 1e-3 a scene. Exit status 1 if one
differs. With --cache DIR the reference's batch means and ledgers are kept there and used again
while scene file, settings and reference stay the same.
"""

from __future__ import annotations

import hashlib
import json
import sys
from pathlib import Path
from typing import Any

import numpy as np
from agree_mitsuba import CHECKS, as_render
from common import ROOT, Meter, header, parser, write

import veriray
from veriray import Render

sys.path.insert(0, str(ROOT))


def stranger(path: Path, cache: Path | None, *, size: int, batches: int, spp: int, seed: int,
             processes: int) -> tuple[Render, bool]:  # fmt: skip
    """The reference's render, from the cache if it is there; whether it was."""
    import reference

    sources = sorted((ROOT / "reference").glob("*.py"))
    files = [path, *sorted((path.parent / "meshes").glob("*")), *sources]
    key = hashlib.sha256(b"".join(f.read_bytes() for f in files))
    key.update(json.dumps([size, batches, spp, seed]).encode())
    kept = cache / f"{path.stem}-{key.hexdigest()[:16]}.npz" if cache else None
    scene = reference.with_settings(reference.load(path), width=size, height=size)
    if kept is not None and kept.is_file():
        with np.load(kept) as data:
            means, ledger, found = data["means"], data["ledger"], True
    else:
        done = reference.render(
            scene, spp=batches * spp, seed=seed, batches=batches, processes=processes
        )
        means, ledger, found = done.batch_means, done.ledger, False
        if kept is not None:
            kept.parent.mkdir(parents=True, exist_ok=True)
            np.savez(kept, means=means, ledger=ledger)
    columns = {c: ledger[:, k].tolist() for k, c in enumerate(reference.COLUMNS)}
    stats = {"renderer": f"reference {reference.__version__}", "ledger": columns,
             "max_depth": scene.max_depth, "rr_depth": scene.rr_depth,
             "filter": scene.film.filter}  # fmt: skip
    return as_render(np.asarray(means, np.float64), spp, seed, stats), found


def agree(path: Path, size: int, batches: int, spp: int, device: str, processes: int,
          cache: Path | None) -> dict[str, Any]:  # fmt: skip
    """One comparison at the file's depths; spp is that of a batch."""
    with Meter() as theirs:
        other, kept = stranger(path, cache, size=size, batches=batches, spp=spp, seed=2,
                               processes=processes)  # fmt: skip
    with Meter() as mine:
        ours = veriray.render(veriray.load_file(path), spp=batches * spp, seed=1, batches=batches,
                              device=device, width=size, height=size)  # fmt: skip
    report = veriray.compare(ours, other)
    whole = [row for row in report.power if row["scale"] == "whole picture"]
    return {
        "scene": path.stem,
        "result": report.result,
        "effort": report.effort,
        "reason": report.reason,
        "verdict": report.verdict,
        "tests": [
            {"name": t.name, "result": t.result, "p": t.p, "threshold": t.threshold,
             "where": t.where}
            for t in report.tests
        ],
        "smallest_p": min((t.p for t in report.tests if t.p is not None), default=None),
        "smallest_detectable_bias": whole[0]["smallest"] if whole else None,
        "mean_ours": ours.image.mean(axis=(0, 1), dtype=float).tolist(),
        "mean_reference": other.image.mean(axis=(0, 1), dtype=float).tolist(),
        "variance_ratio": report.figures.get("variance_ratio"),
        "film_sha256": ours.film_sha256,
        "scene_sha256": ours.stats["scene_sha256"],
        "device": ours.stats["device"],
        "notes": report.notes,
        "metered": {"ours": mine.row(), "reference": None if kept else theirs.row()},
    }  # fmt: skip


def main() -> int:
    """Command line."""
    p = parser(__doc__, "agree_reference.json")
    p.add_argument("--scenes", nargs="+", metavar="NAME", help="of scenes/checks (default: all)")
    p.add_argument("--size", type=int, default=64, help="width and height")
    p.add_argument("--spp", type=int, default=16, help="samples of a batch")
    p.add_argument("--batches", type=int, default=64)
    p.add_argument("--device", default="cpu")
    p.add_argument("--processes", type=int, default=1, help="of the reference")
    p.add_argument("--cache", type=Path, help="folder for the reference's batch means")
    args = p.parse_args()
    files = {f.stem: f for f in sorted(CHECKS.glob("*.xml"))}
    names = args.scenes or list(files)
    if set(names) - set(files):
        p.error(f"unknown scenes {sorted(set(names) - set(files))}; allowed: {', '.join(files)}")
    result = header("agree_reference", "embreex")
    result["settings"] = {
        "width": args.size, "height": args.size, "batches": args.batches,
        "spp_of_a_batch": args.spp, "alpha": 1e-3, "seed_ours": 1, "seed_reference": 2,
    }  # fmt: skip
    result["rows"] = []
    for name in names:
        row = agree(files[name], args.size, args.batches, args.spp, args.device, args.processes,
                    args.cache)  # fmt: skip
        print(f"{name}: {row['result']}, smallest p {row['smallest_p']}, {row['verdict']}",
              flush=True)  # fmt: skip
        result["rows"].append(row)
    agreed = sum(row["result"] == "pass" for row in result["rows"])
    result["agree"] = f"{agreed} of {len(names)}"
    write(result, args.output)
    return 0 if agreed == len(names) else 1


if __name__ == "__main__":
    sys.exit(main())
