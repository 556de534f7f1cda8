"""Agreement with Mitsuba 3 on the same scene files, by the equal-effort tests of `veriray.compare`.

Scenes: all of scenes/checks and Mitsuba's Cornell box, or those of --scenes. 64 batches of --spp
samples from both, independent seeds, the sign-flip tests S0 to S3 at a family-wise false-alarm rate
of 1e-3 a scene; where the noise of the two differs too much for them, Welch t tests of the mean and
of the blocks. --depths makes the Cornell box run at several max_depth. Exit status 1 if one
differs. With --cache DIR Mitsuba's batch means are kept there and used again while the scene file,
settings and version of Mitsuba stay the same.

Under filters wider than a pixel Mitsuba's border pixels see samples of the film alone, ours those
around it too: two pixels at the border are left out there.
"""

from __future__ import annotations

import hashlib
import json
import sys
from pathlib import Path
from typing import Any

import mitsuba_peer
import numpy as np
from common import MITSUBA_BOX, ROOT, Meter, header, parser, write

import veriray
from veriray import Render, film_hash

CHECKS = ROOT / "scenes" / "checks"
BORDER = 2  # pixels


def peer_render(mi: Any, scene: Path, cache: Path | None, **settings: Any) -> tuple[Render, bool]:
    """Mitsuba's render, from the cache if it is there; whether it was."""
    files = sorted({scene, *(scene.parent / "meshes").glob("*")})
    key = hashlib.sha256(b"".join(f.read_bytes() for f in files))
    key.update(json.dumps([mi.__version__, mi.variant(), settings], sort_keys=True).encode())
    kept = cache / f"{scene.stem}-{key.hexdigest()[:16]}.npz" if cache else None
    if kept is None or not kept.is_file():
        done = mitsuba_peer.render(mi, scene, **settings)
        if kept is not None:
            kept.parent.mkdir(parents=True, exist_ok=True)
            np.savez(kept, means=np.asarray(done.batch_means, np.float32))
        return done, False
    with np.load(kept) as data:
        means = data["means"].astype(np.float64)
    return as_render(means, settings["spp"], settings["seed"], {
        "renderer": f"mitsuba {mi.__version__} {mi.variant()}",
        "max_depth": settings["max_depth"],
        "rr_depth": settings["rr_depth"],
    }), True  # fmt: skip


def as_render(means: Any, spp: int, seed: int, stats: dict[str, Any]) -> Render:
    """A Render from batch means (B, H, W, 3) of spp samples each."""
    image = means.mean(axis=0).astype(np.float32)
    stderr = (means.std(axis=0, ddof=1) / len(means) ** 0.5).astype(np.float32)
    total = spp * len(means)
    return Render(
        image=image, stderr=stderr, batch_means=means, stats=stats,
        film_sha256=film_hash(image, stderr, total), width=image.shape[1], height=image.shape[0],
        spp=total, seed=seed,
    )  # fmt: skip


def inner(render: Render, border: int) -> Render:
    """The render without `border` pixels on each side, and without its ledger."""
    if not border:
        return render
    assert render.batch_means is not None
    cut = slice(border, -border)
    stats = {k: v for k, v in render.stats.items() if k != "ledger"}
    batches = len(render.batch_means)
    return as_render(render.batch_means[:, cut, cut], render.spp // batches, render.seed, stats)


def agree(mi: Any, path: Path, max_depth: int | None, size: int, batches: int, spp: int,
          device: str, cache: Path | None = None) -> dict[str, Any]:  # fmt: skip
    """One comparison, roulette from depth 5; spp is a batch's; max_depth None: the file's."""
    scene = veriray.load_file(path)
    settings: dict[str, Any] = {
        "max_depth": scene.max_depth if max_depth is None else max_depth,
        "rr_depth": 5,
        "width": size,
        "height": size,
    }
    with Meter() as theirs:
        peer, kept = peer_render(mi, path, cache, batches=batches, spp=spp, seed=1000, **settings)
    with Meter() as mine:
        ours = veriray.render(
            scene, spp=batches * spp, seed=1, batches=batches, device=device, **settings
        )
    border = 0 if scene.film.filter == "box" else BORDER
    report = veriray.compare(inner(ours, border), inner(peer, border))
    whole = [row for row in report.power if row["scale"] == "whole picture"]
    return {
        "scene": path.stem,
        "max_depth": settings["max_depth"],
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
        "power": report.power,
        "mean_ours": ours.image.mean(axis=(0, 1), dtype=float).tolist(),
        "mean_mitsuba": peer.image.mean(axis=(0, 1), dtype=float).tolist(),
        "variance_ratio": report.figures.get("variance_ratio"),
        "film_sha256": ours.film_sha256,
        "scene_sha256": ours.stats["scene_sha256"],
        "device": ours.stats["device"],
        "notes": report.notes,
        "metered": {"ours": mine.row(), "mitsuba": None if kept else theirs.row()},
    }  # fmt: skip


def main() -> int:
    """Command line."""
    p = parser(__doc__, "agree_mitsuba.json")
    p.add_argument("--variant", default="llvm_ad_rgb", help="of Mitsuba (default: %(default)s)")
    p.add_argument("--scenes", nargs="+", metavar="NAME", help="of scenes/checks, or cornell")
    p.add_argument("--size", type=int, default=64, help="width and height")
    p.add_argument("--spp", type=int, default=64, help="samples of a batch")
    p.add_argument("--batches", type=int, default=64)
    p.add_argument("--depths", type=int, nargs="+", default=[2, 3, 8, -1])
    p.add_argument("--device", default="cpu")
    p.add_argument("--cache", type=Path, help="folder for Mitsuba's batch means")
    args = p.parse_args()
    try:
        mi = mitsuba_peer.start(args.variant)
    except (ImportError, RuntimeError) as error:
        print(f"no peer: {error}", file=sys.stderr)
        return 2
    files = {f.stem: f for f in sorted(CHECKS.glob("*.xml"))}
    names = args.scenes or ["cornell", *files]
    unknown = set(names) - {"cornell", *files}
    if unknown:
        p.error(f"unknown scenes {sorted(unknown)}; allowed: cornell, {', '.join(files)}")
    cases: list[tuple[Path, int | None]] = []
    for name in names:
        if name == "cornell":
            cases += [(MITSUBA_BOX, depth) for depth in args.depths]
        else:
            cases.append((files[name], None))
    result = header("agree_mitsuba", "mitsuba", "drjit")
    result["settings"] = {
        "variant": args.variant, "width": args.size, "height": args.size, "batches": args.batches,
        "spp_of_a_batch": args.spp, "rr_depth": 5, "sampler": "independent", "alpha": 1e-3,
        "seed_ours": 1, "seeds_mitsuba": [1000, 1000 + args.batches - 1],
    }  # fmt: skip
    result["rows"] = []
    for path, depth in cases:
        row = agree(mi, path, depth, args.size, args.batches, args.spp, args.device, args.cache)
        print(f"{row['scene']} at max_depth {row['max_depth']}: {row['result']}, smallest p "
              f"{row['smallest_p']}, {row['verdict']}", flush=True)  # fmt: skip
        result["rows"].append(row)
    agreed = sum(row["result"] == "pass" for row in result["rows"])
    result["agree"] = f"{agreed} of {len(cases)}"
    write(result, args.output)
    return 0 if agreed == len(cases) else 1


if __name__ == "__main__":
    sys.exit(main())
