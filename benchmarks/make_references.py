"""Makes python/veriray_validate/references: the reference renderer's results for level 5.

    python benchmarks/make_references.py --processes 64 [--scenes NAME ...]

Three independent runs a scene of scenes/checks (see veriray_validate.references). The small one has
16 samples in each of 32 batches; its noise says how many the other two need so that a bias of
--target of the whole picture is found, between --least and --most. Work is cut into pieces, each
with its own seed and a file in --parts, so a stopped run goes on where it was. A scene whose file
is there, made from the same scene, reference and settings, is left out. Needs embreex.
"""

from __future__ import annotations

import os

os.environ.update(dict.fromkeys(("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS"), "1"))

import argparse
import hashlib
import json
import sys
import time
from concurrent.futures import ProcessPoolExecutor, as_completed
from dataclasses import dataclass
from multiprocessing import get_context
from pathlib import Path
from typing import Any

import numpy as np

ROOT = Path(__file__).resolve().parents[1]
sys.path.insert(0, str(ROOT))

import reference  # noqa: E402
import veriray  # noqa: E402
from veriray.comparison.ledgers import ledger_problems  # noqa: E402
from veriray_validate import references as store  # noqa: E402
from veriray_validate.levels.stranger import power  # noqa: E402
from veriray_validate.scenes import checks  # noqa: E402

SMALL = 16  # samples of a batch in the small run
PIECE = 4  # batches of a piece of the other two
STEP = 8


@dataclass(frozen=True)
class Piece:
    """Batches `first` to `first + count` of a run: scene, samples a batch, where they are kept."""

    name: str
    run: str
    first: int
    count: int
    spp: int
    path: Path

    @property
    def seed(self) -> int:
        """Of this piece alone."""
        text = f"{self.name} {self.run} {self.first}"
        return int.from_bytes(hashlib.sha256(text.encode()).digest()[:8], "little")


def digest(path: Path) -> str:
    """Of the reference's sources, a scene file and the meshes."""
    files = [
        path,
        *path.parent.glob("meshes/*"),
        *path.parent.glob("images/*"),
        *path.parent.glob("volumes/*"),
        *(ROOT / "reference").glob("*.py"),
    ]
    contents = b"".join(f.read_bytes() for f in sorted(files))
    return hashlib.sha256(contents).hexdigest()


def make(piece: Piece, scene_file: Path) -> float:
    """Renders a piece into its file; returns processor seconds."""
    begin = time.process_time()
    scene = reference.load(scene_file)
    scene = reference.with_settings(scene, width=store.SIZE, height=store.SIZE)
    spp = piece.count * piece.spp
    done = reference.render(scene, spp=spp, seed=piece.seed, batches=piece.count)
    means, squares = store.reduced(
        done.batch_means, done.mean, done.stderr, spp, store.BLOCKS[piece.run]
    )
    seconds = time.process_time() - begin
    temporary = piece.path.with_suffix(".part")
    with open(temporary, "wb") as file:
        np.savez(file, means=means, squares=squares, ledger=done.ledger, seconds=seconds)
    temporary.replace(piece.path)
    return seconds


def collect(pieces: list[Piece]) -> tuple[store.Run, float]:
    """The run that finished pieces make up, and its processor seconds."""
    means, squares, ledgers, seconds = [], [], [], 0.0
    for piece in pieces:
        with np.load(piece.path) as data:
            means.append(data["means"])
            squares.append(data["squares"])
            columns = zip(reference.COLUMNS, data["ledger"].T, strict=True)
            ledgers.append({c: [int(n) for n in column] for c, column in columns})
            seconds += float(data["seconds"])
    run = store.Run(np.concatenate(means), np.mean(squares, axis=0), store.added(ledgers),
                    store.BLOCKS[pieces[0].run], pieces[0].spp)  # fmt: skip
    return run, seconds


def samples(small: store.Run, target: float, least: int, most: int) -> int:
    """Samples of a batch for which `target` is seen, by the noise of the small run."""
    noise = small.means - small.means.mean(axis=0)
    level = small.means.mean(axis=0)
    # the difference of two such pictures
    sees = power(np.sqrt(2) * noise, level, small.block)["whole picture"]
    needed = small.spp * (sees / target) ** 2
    return int(np.clip(STEP * np.ceil(needed / STEP), least, most))


def run_all(pieces: list[Piece], files: dict[str, Path], processes: int, say: Any) -> None:
    """Makes the pieces that are not there, the longest ones first."""
    missing = [p for p in pieces if not p.path.is_file()]
    missing.sort(key=lambda p: -p.spp * p.count)
    begin, spent = time.perf_counter(), 0.0
    with ProcessPoolExecutor(processes, get_context("spawn")) as pool:
        waiting = [pool.submit(make, p, files[p.name]) for p in missing]
        for done, future in enumerate(as_completed(waiting), 1):
            spent += future.result()
            if done % max(1, len(missing) // 20) == 0:
                say(f"{done}/{len(missing)} pieces, {spent:.0f} core-seconds, "
                    f"{time.perf_counter() - begin:.0f} s")  # fmt: skip


def main() -> int:
    """Command line."""
    p = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    p.add_argument("--processes", type=int, default=os.cpu_count())
    p.add_argument("--scenes", nargs="+", metavar="NAME", help="of scenes/checks (default: all)")
    p.add_argument("--output", type=Path, default=store.FOLDER)
    p.add_argument("--parts", type=Path, default=ROOT / "build" / "references")
    p.add_argument("--target", type=float, default=7e-4, help="relative bias of the whole picture")
    p.add_argument("--least", type=int, default=64, help="samples of a batch, at least")
    p.add_argument("--most", type=int, default=384, help="samples of a batch, at most")
    args = p.parse_args()
    files = checks()
    names = args.scenes or list(files)
    if set(names) - set(files):
        p.error(f"unknown scenes {sorted(set(names) - set(files))}; allowed: {', '.join(files)}")
    args.output.mkdir(parents=True, exist_ok=True)
    args.parts.mkdir(parents=True, exist_ok=True)
    settings = [args.target, args.least, args.most, store.SIZE, store.BATCHES, SMALL, PIECE]
    keys = {n: hashlib.sha256(f"{digest(files[n])} {settings}".encode()).hexdigest() for n in names}

    def finished(name: str) -> bool:
        path = args.output / f"{name}.npz"
        return path.is_file() and store.read(path).facts["key"] == keys[name]

    def part(name: str, run: str, first: int, count: int, spp: int) -> Piece:
        file = f"{name}-{run}-{first:02d}-{spp}-{keys[name][:16]}.npz"
        return Piece(name, run, first, count, spp, args.parts / file)

    def say(text: str) -> None:
        print(text, flush=True)

    names = [n for n in names if not finished(n)]
    say(f"{len(names)} scenes to make, {args.processes} processes")
    plan = {n: {"small": [part(n, "small", 0, store.BATCHES, SMALL)]} for n in names}
    run_all([p for runs in plan.values() for p in runs["small"]], files, args.processes, say)
    for name in names:
        spp = samples(collect(plan[name]["small"])[0], args.target, args.least, args.most)
        for run in ("first", "second"):
            plan[name][run] = [part(name, run, k, PIECE, spp)
                               for k in range(0, store.BATCHES, PIECE)]  # fmt: skip
    run_all([p for runs in plan.values() for r in ("first", "second") for p in runs[r]], files,
            args.processes, say)  # fmt: skip
    total = 0.0
    for name in names:
        runs, spent = {}, 0.0
        for run, pieces in plan[name].items():
            runs[run], seconds = collect(pieces)
            paths = store.SIZE**2 * store.BATCHES * runs[run].spp
            problems = ledger_problems(runs[run].ledger, paths)
            if problems or any(runs[run].ledger["invalid"]):
                raise RuntimeError(f"{name}, {run}: {problems or 'invalid samples'}")
            spent += seconds
        scene = veriray.load_file(files[name]).with_(width=store.SIZE, height=store.SIZE)
        facts = {"reference": reference.__version__, "files_sha256": digest(files[name]),
                 "key": keys[name], "core_seconds": round(spent, 1)}  # fmt: skip
        path = args.output / f"{name}.npz"
        store.save(store.Reference(name, scene.sha256, runs, facts), path)
        total += spent
        say(f"{name}: {runs['first'].spp} samples a batch, {spent:.0f} core-seconds, "
            f"{path.stat().st_size / 1e3:.0f} kB")  # fmt: skip
    size = sum((args.output / f"{n}.npz").stat().st_size for n in names)
    say(json.dumps({"scenes": len(names), "core_seconds": round(total), "bytes": size}))
    return 0


if __name__ == "__main__":
    sys.exit(main())
