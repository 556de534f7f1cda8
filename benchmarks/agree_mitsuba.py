"""Agreement with Mitsuba 3 on the same scene files, by the equal-effort tests of `veriray.compare`.

Scenes: all of scenes/checks and Mitsuba's Cornell box, or those of --scenes. 64 batches of --spp
samples from both, independent seeds, the sign-flip tests S0 to S3 at a family-wise false-alarm rate
of 1e-3 a scene; where the noise of the two differs too much for them, Welch t tests of the mean and
of the blocks. --depths makes the Cornell box run at several max_depth. Exit status 1 if one
differs. With --cache DIR Mitsuba's batch means are kept there and used again while the scene file,
settings and version of Mitsuba stay the same.

--wild DIR takes other people's scenes instead (see `wild.py`): whole rooms, and the first file of
each repository that both renderers read and that is not dark, at its own depths. Rare bright
samples make the tests fail more often than they state, so a scene that fails there is judged by a
second run with six times the samples and other seeds. A difference that a decision explains is
named in DECISIONS. --table FILE writes a result's rows as Markdown.

Under filters wider than a pixel Mitsuba's border pixels see samples of the film alone, ours those
around it too: two pixels at the border are left out there.
"""

from __future__ import annotations

import hashlib
import json
import sys
import tempfile
from pathlib import Path
from typing import Any

import mitsuba_peer
import numpy as np
import wild
from common import MITSUBA_BOX, ROOT, Meter, header, parser, write

import veriray
from veriray import Render, film_hash

CHECKS = ROOT / "scenes" / "checks"
BORDER = 2  # pixels
DARK = 1e-4  # mean radiance below which a picture says nothing
#: Scene -> why it differs, in the words of README and of the notes of `veriray info`.
DECISIONS: dict[str, str] = {}


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
    row = judged(path.stem, scene, ours, peer)
    return {**row, "max_depth": settings["max_depth"],
            "metered": {"ours": mine.row(), "mitsuba": None if kept else theirs.row()}}  # fmt: skip


def agree_wild(
    mi: Any, name: str, path: Path, size: int, batches: int, spp: int, device: str,
    seeds: tuple[int, int] = (1, 1000),
) -> dict[str, Any] | None:  # fmt: skip
    """The same for a file as it stands, its longer side `size` pixels; None if it is dark.

    seeds: ours, and the first of Mitsuba's.
    """
    scene = veriray.load_file(path)
    scale = size / max(scene.film.width, scene.film.height)
    width, height = (max(1, round(scale * n)) for n in (scene.film.width, scene.film.height))
    film = {"width": width, "height": height, "device": device}
    if veriray.render(scene, spp=16, **film).image.mean() < DARK:
        return None
    theirs = mi.load_file(str(path))
    values = mi.traverse(theirs)
    (key,) = (k for k in values.keys() if k.endswith("film.size"))  # noqa: SIM118
    values[key] = [width, height]
    values.update()
    means = np.stack(list(mitsuba_peer.batch_means(mi, theirs, batches, spp, seeds[1])))
    stats = {"renderer": f"mitsuba {mi.__version__} {mi.variant()}", "max_depth": scene.max_depth,
             "rr_depth": scene.rr_depth}  # fmt: skip
    peer = as_render(means.astype(np.float64), spp, seeds[1], stats)
    ours = veriray.render(scene, spp=batches * spp, seed=seeds[0], batches=batches, **film)
    return {**judged(name, scene, ours, peer), "max_depth": scene.max_depth,
            "size": [width, height], "warnings": [str(note) for note in scene.notes]}  # fmt: skip


def judged(name: str, scene: veriray.Scene, ours: Render, peer: Render) -> dict[str, Any]:
    """The comparison of two renders as a row."""
    border = 0 if scene.film.filter == "box" else BORDER
    report = veriray.compare(inner(ours, border), inner(peer, border))
    whole = [row for row in report.power if row["scale"] == "whole picture"]
    return {
        "scene": name,
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
    }  # fmt: skip


def all_wild(mi: Any, source: Path, **how: Any) -> list[dict[str, Any]]:
    """Rows of the rooms, and of the first file of each repository that both renderers show."""
    rows, shown = [], set()
    with tempfile.TemporaryDirectory() as folder:
        work = Path(folder)
        files = {**wild.rooms(source, work), **wild.strangers(source, work)}
        for name, path in files.items():
            repository = "/".join(name.split("/")[:2])
            if repository in shown:
                continue
            try:
                row = agree_wild(mi, name, path, **how)
            except Exception as error:  # what either cannot read
                print(f"{name}: {type(error).__name__}: {str(error).splitlines()[0][:100]}")
                continue
            if row is not None and row["result"] == "fail":
                first = {"result": row["result"], "smallest_p": row["smallest_p"]}
                more = {**how, "batches": 2 * how["batches"], "spp": 3 * how["spp"]}
                row = agree_wild(mi, name, path, **more, seeds=(2, 5000))
                assert row is not None
                row["first_stage"] = first
            if row is not None:
                shown.add(repository)
                rows.append(row)
                print(f"{name}: {row['result']}, smallest p {row['smallest_p']}", flush=True)
    return rows


def table(result: dict[str, Any]) -> str:
    """The rows as Markdown."""
    lines = ["| scene | verdict | smallest p | smallest bias that would be seen | note |",
             "|---|---|--:|--:|---|"]  # fmt: skip
    for row in result["rows"]:
        p, seen = row["smallest_p"], row["smallest_detectable_bias"]
        agreed = {"pass": "agrees", "fail": "differs"}.get(row["result"], row["result"])
        name = row["scene"] + (f", max_depth {row['max_depth']}" if "cornell" in row["scene"]
                               and "size" not in row else "")  # fmt: skip
        lines.append(f"| `{name}` | {agreed} | {'' if p is None else f'{p:.2g}'} | "
                     f"{'' if seen is None else f'{100 * seen:.2g} %'} | "
                     f"{row.get('decision', '')} |")  # fmt: skip
    return "\n".join(lines) + "\n"


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
    p.add_argument("--wild", type=Path, metavar="DIR", help="other people's scenes instead")
    p.add_argument("--table", type=Path, metavar="FILE", help="write the rows as Markdown, too")
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
    if args.wild:
        cases = []
        result["settings"]["rr_depth"] = "the file's"
        result["rows"] = all_wild(mi, args.wild, size=args.size, batches=args.batches,
                                  spp=args.spp, device=args.device)  # fmt: skip
    for path, depth in cases:
        row = agree(mi, path, depth, args.size, args.batches, args.spp, args.device, args.cache)
        print(f"{row['scene']} at max_depth {row['max_depth']}: {row['result']}, smallest p "
              f"{row['smallest_p']}, {row['verdict']}", flush=True)  # fmt: skip
        result["rows"].append(row)
    for row in result["rows"]:
        if row["result"] != "pass" and row["scene"] in DECISIONS:
            row["decision"] = DECISIONS[row["scene"]]
    agreed = sum(row["result"] == "pass" for row in result["rows"])
    result["agree"] = f"{agreed} of {len(result['rows'])}"
    write(result, args.output)
    if args.table:
        args.table.write_text(table(result), "utf-8")
    explained = sum("decision" in row for row in result["rows"])
    return 0 if agreed + explained == len(result["rows"]) else 1


if __name__ == "__main__":
    sys.exit(main())
