"""Spectral ground truth of the measured Cornell box, by the independent reference renderer.

    python benchmarks/make_spectral.py --processes 16

Writes python/veriray_validate/references/cornell_spectral.npz, which level 7 of `veriray validate`
compares with. The box is diffuse, so its radiance at a wavelength depends on the reflectances and
the emission there alone, and one render takes three wavelengths as its R, G and B. 75 of the 76
measured wavelengths are 25 renders of (404, 504, 604) + 4 k nm; at 400 nm the lamp is dark. One
more render has the colours of the RGB scene. Seeds differ, so their noise is independent; channels
of one render share their paths, which is why XYZ is summed batch by batch before its error is
taken. Each render is kept in --work, in 16 parts, and used again while scene, settings and
reference stay the same: a run that is stopped goes on where it was. 1.7e9 paths take 3,000 to
7,000 core-seconds.

The file holds, for 64 batches:
    xyz, xyz_error      (128, 128, 3) float32, XYZ of 76 wavelengths and its standard error
    coarse, coarse_error (2, 16, 16, 3) float32, XYZ of 39 and 20 wavelengths less that of 76, in
                        blocks of 8 x 8 pixels
    bands               (3, 64, 8, 8, 3) float32, batch means in blocks of 16 x 16 pixels: two of
                        the triples and the RGB scene
    wavelengths         (2, 3) float64 of those triples, in nm
    facts               JSON: settings, versions, SHA-256 of the data, seconds
"""

from __future__ import annotations

import argparse
import functools
import hashlib
import json
import os
import sys
import time
from concurrent.futures import ProcessPoolExecutor, as_completed
from multiprocessing import get_context
from pathlib import Path
from typing import Any
from xml.etree import ElementTree

import numpy as np
import numpy.typing as npt

from veriray_validate import spectral

ROOT = Path(__file__).resolve().parents[1]
sys.path.insert(0, str(ROOT))

FOLDER = ROOT / "scenes" / "cornell"
BOX = FOLDER / "cornell_box.xml"
TARGET = ROOT / "python" / "veriray_validate" / "references" / "cornell_spectral.npz"
TRIPLES = tuple((404.0 + 4 * k, 504.0 + 4 * k, 604.0 + 4 * k) for k in range(25))
#: Triples whose batch means are kept: a short-wave one, and one near the observer's peaks.
KEPT = (10, 24)
#: Triples, and None for the RGB scene.
RENDERS: tuple[tuple[float, ...] | None, ...] = (*TRIPLES, None)
CELL = 16  # pixels a side: blocks of the bands
SMALL = 8  # and of the coarse sums
PART = 4  # batches to a file

Array = npt.NDArray[Any]


def scene(triple: tuple[float, ...] | None, size: int) -> Any:
    """The reference's scene at three wavelengths, or with its own RGB colours for None."""
    from dataclasses import replace

    import reference

    box = reference.with_settings(reference.load(BOX), width=size, height=size)
    if triple is None:
        return box
    names = {}
    for bsdf in ElementTree.parse(BOX).getroot().iter("bsdf"):
        value = bsdf.find("rgb").get("value")  # type: ignore[union-attr]
        names[tuple(float(x) for x in str(value).split(","))] = bsdf.get("id")
    paints = spectral.reflectance(triple)
    materials = [
        replace(m, reflectance=paints[str(names[tuple(m.reflectance.tolist())])])
        for m in box.materials
    ]
    return replace(
        box, materials=tuple(materials), radiances=spectral.emission(triple)[None], digest=""
    )


def label(triple: tuple[float, ...] | None) -> str:
    """Of a file and of progress."""
    return "rgb" if triple is None else "-".join(f"{x:.0f}" for x in triple)


@functools.cache
def sources() -> bytes:
    """Hash of the box, its data and the reference."""
    data = ("reflectance.csv", "emission.csv", "light.json")
    files = [BOX, *(FOLDER / n for n in data), *sorted((FOLDER / "meshes").glob("*.obj")),
             *sorted((ROOT / "reference").glob("*.py"))]  # fmt: skip
    return hashlib.sha256(b"".join(f.read_bytes() for f in files)).digest()


def file_of(number: int, index: int, work: Path, settings: dict[str, int]) -> Path:
    """Where a part of a render is kept; its name has a hash of all that it depends on."""
    name = label(RENDERS[number])
    key = hashlib.sha256(sources() + json.dumps([name, index, settings]).encode()).hexdigest()
    return work / f"{name}-{index:02d}-{key[:12]}.npz"


def part(job: tuple[int, int, Path, dict[str, int]]) -> float:
    """Renders some batches of a render into their file, unless it is there; its core-seconds."""
    number, index, path, settings = job
    if not path.is_file():
        import reference

        before = time.process_time()
        own = PART * settings["spp"] // settings["batches"]
        picture = reference.render(
            scene(RENDERS[number], settings["size"]), spp=own, batches=PART,
            seed=1_000_000 * settings["seed"] + 1_000 * number + index,
        )  # fmt: skip
        if picture.ledger[:, reference.COLUMNS.index("invalid")].any():
            raise RuntimeError(f"{label(RENDERS[number])}: invalid samples")
        temporary = path.with_suffix(f".{os.getpid()}.tmp")
        with open(temporary, "wb") as file:
            np.savez(file, means=picture.batch_means.astype(np.float32),
                     seconds=time.process_time() - before)  # fmt: skip
        temporary.replace(path)
    with np.load(path) as kept:
        return float(kept["seconds"])


def render_all(work: Path, processes: int, settings: dict[str, int]) -> float:
    """Makes the files that are missing; core-seconds of all. Progress on stderr."""
    work.mkdir(parents=True, exist_ok=True)
    parts = settings["batches"] // PART
    jobs = [(n, k, file_of(n, k, work, settings), settings) for n in range(len(RENDERS))
            for k in range(parts)]  # fmt: skip
    spent, begin = 0.0, time.perf_counter()
    with ProcessPoolExecutor(processes, get_context("spawn")) as pool:
        waiting = [pool.submit(part, job) for job in jobs]
        try:
            for done, future in enumerate(as_completed(waiting), 1):
                spent += future.result()
                elapsed = time.perf_counter() - begin
                print(f"\r{done}/{len(jobs)}  {elapsed:.0f} s, "
                      f"{elapsed / done * (len(jobs) - done):.0f} s left ",
                      end="", file=sys.stderr, flush=True)  # fmt: skip
        except BaseException:
            pool.shutdown(cancel_futures=True)
            raise
    print(file=sys.stderr)
    return spent


def batch_means(number: int, work: Path, settings: dict[str, int]) -> Array:
    """Batch means (B, H, W, 3) float64 of a render, from its files."""
    parts = []
    for index in range(settings["batches"] // PART):
        with np.load(file_of(number, index, work, settings)) as kept:
            parts.append(kept["means"].astype(np.float64))
    return np.concatenate(parts)


def statistics(batches: Array) -> tuple[Array, Array]:
    """Mean and its standard error, over the first axis."""
    return batches.mean(axis=0), batches.std(axis=0, ddof=1) / len(batches) ** 0.5


def make(work: Path, processes: int, settings: dict[str, int]) -> dict[str, Any]:
    """Everything the file holds."""
    import reference
    from reference.tracer import embree_version

    size, count = settings["size"], settings["batches"]
    grids = [spectral.thinned(step) for step in (1, 2, 4)]
    fine = np.zeros((count, size, size, 3))
    rough = np.zeros((2, count, size // SMALL, size // SMALL, 3))
    table = np.zeros((3, len(spectral.NODES), 3))  # weights of each grid at all nodes
    for rows, grid in zip(table, grids, strict=True):
        rows[grid] = spectral.weights(spectral.NODES[grid])
    spent, kept = render_all(work, processes, settings), []
    for number, triple in enumerate(RENDERS):
        means = batch_means(number, work, settings)
        if triple is None or number in KEPT:
            kept.append(spectral.blocks(means, CELL))
        if triple is not None:
            at = np.searchsorted(spectral.NODES, triple)
            fine += means @ table[0, at]
            for k in (0, 1):
                rough[k] += spectral.blocks(means, SMALL) @ (table[k + 1, at] - table[0, at])
    xyz, xyz_error = statistics(fine)
    coarse, coarse_error = statistics(rough.swapaxes(0, 1))
    hashes = {
        f.name: hashlib.sha256(f.read_bytes()).hexdigest()
        for f in (FOLDER / "reflectance.csv", FOLDER / "emission.csv", FOLDER / "light.json", BOX)
    }
    facts = {
        **settings, "reference": reference.__version__, "embree": embree_version(),
        "numpy": np.__version__, "core_seconds": round(spent), "sha256": hashes,
        "nodes": [len(g) for g in grids], "max_depth": -1, "rr_depth": 5,
        "paths": len(RENDERS) * size * size * settings["spp"],
    }  # fmt: skip
    arrays = {"xyz": xyz, "xyz_error": xyz_error, "coarse": coarse, "coarse_error": coarse_error,
              "bands": np.stack(kept)}  # fmt: skip
    return {
        **{name: value.astype(np.float32) for name, value in arrays.items()},
        "wavelengths": np.array([TRIPLES[k] for k in KEPT]),
        "facts": json.dumps(facts),
    }


def main() -> int:
    """Writes the file; the exit status."""
    parse = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawTextHelpFormatter
    )
    parse.add_argument("--processes", type=int, default=len(os.sched_getaffinity(0)))
    parse.add_argument("--work", type=Path, default=ROOT / "build" / "spectral", metavar="DIR")
    parse.add_argument("--size", type=int, default=128, help="multiple of 16 (default 128)")
    parse.add_argument("--spp", type=int, default=4096, help="multiple of the batches")
    parse.add_argument("--batches", type=int, default=64, help="multiple of 4 (default 64)")
    parse.add_argument("--seed", type=int, default=7)
    parse.add_argument("-o", "--output", type=Path, default=TARGET)
    options = parse.parse_args()
    settings = {name: getattr(options, name) for name in ("size", "spp", "batches", "seed")}
    made = make(options.work, options.processes, settings)
    options.output.parent.mkdir(parents=True, exist_ok=True)
    temporary = options.output.with_suffix(".tmp")
    with open(temporary, "wb") as file:
        np.savez_compressed(file, **made)
    temporary.replace(options.output)
    error = float(np.median(made["xyz_error"][..., 1] / np.maximum(made["xyz"][..., 1], 1e-9)))
    spent = json.loads(made["facts"])["core_seconds"]
    print(f"{options.output}: {options.output.stat().st_size:,} bytes, {spent:,} core-s, "
          f"median error of Y {error:.2%}")  # fmt: skip
    return 0


if __name__ == "__main__":
    sys.exit(main())
