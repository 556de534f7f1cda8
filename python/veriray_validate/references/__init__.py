"""Results of the independent reference renderer on the scenes of scenes/checks.

The renderer is reference/ in the source (Embree, numpy). One file a scene, made by
benchmarks/make_references.py. A file holds independent runs: "small" for
the quick level, "first" for the full one, and "second" for the confirmation of a suspicion, so that
no judgement leans on the same noise twice. A run has `BATCHES` batches of equal size, each averaged
over square blocks of pixels, in float32 without loss; the ledger; and the mean square of its
samples.
"""

from __future__ import annotations

import functools
import json
from collections.abc import Collection
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

from veriray.comparison.statistics import block_means
from veriray.files import replacing
from veriray.rendering import LEDGER_COLUMNS

Array = npt.NDArray[Any]

FOLDER = Path(__file__).resolve().parent
SIZE = 64  # pixels, width and height
BATCHES = 32
#: Pixels on a side of a block, by run.
BLOCKS = {"small": 8, "first": 4, "second": 4}


@dataclass(frozen=True)
class Run:
    """Batch means of blocks of pixels.

    means: (B, H, W, 3); squares: (H, W, 3), mean of the squared samples; ledger: column -> list;
    block: pixels on a side of a block; spp: samples a pixel and batch.
    """

    means: Array
    squares: Array
    ledger: dict[str, list[int]]
    block: int
    spp: int


@dataclass(frozen=True)
class Reference:
    """What the reference found for a scene.

    sha256: of the scene as veriray reads it (`Scene.sha256`, film SIZE x SIZE); facts: version,
    Embree's version, hash of the files, seconds.
    """

    name: str
    sha256: str
    runs: dict[str, Run]
    facts: dict[str, Any]

    def run(self, effort: int) -> Run:
        """The run for a trial of some effort: another one for four times the effort."""
        if not full(effort):
            return self.runs["small"]
        return self.runs["second" if (effort.bit_length() - 1) // 2 % 2 == 0 else "first"]


def full(effort: int) -> bool:
    """Whether a trial of this effort gets a large run."""
    return effort >= 4


def lights_alike(features: Collection[str]) -> bool:
    """Whether the reference samples a scene's lights as veriray does; features: of the scene.

    Of several lights it chooses by power, veriray by where the point is. Rectangles that are near
    to nothing it samples by area, veriray in a tree by solid angle. Of a blend it takes one bsdf,
    veriray all for light samples. It does not guide the samples of skies by place.
    """
    by_angle = "bvh" in features and "rectangle_lights" in features
    return not ({"many_lights", "blend", "guided_sky"} & set(features)) and not by_angle


def roulette_alike(features: Collection[str]) -> bool:
    """Whether roulette ends as many paths in both; features: of the scene.

    It goes by weights, which at blends are those of one bsdf in the reference, of all in veriray.
    """
    return "blend" not in features


def added(ledgers: list[dict[str, list[int]]]) -> dict[str, list[int]]:
    """The sum of ledgers, the longest one's depths."""
    depths = max(len(ledger["live"]) for ledger in ledgers)
    total = {c: np.zeros(depths, np.int64) for c in LEDGER_COLUMNS}
    for ledger in ledgers:
        for c in LEDGER_COLUMNS:
            total[c][: len(ledger[c])] += np.asarray(ledger[c], np.int64)
    return {c: [int(n) for n in column] for c, column in total.items()}


def reduced(means: Array, mean: Array, error: Array, spp: int, block: int) -> tuple[Array, Array]:
    """Means and squares of a `Run`, from a picture's.

    means: (B, H, W, 3) batch means; mean, error: (H, W, 3) of all spp samples of a pixel.
    """
    squares = (spp - 1) * np.asarray(error, np.float64) ** 2 + np.asarray(mean, np.float64) ** 2
    return block_means(means, block), block_means(squares, block)


def save(reference: Reference, path: Path) -> None:
    """Writes a file; the bytes of equal weight lie together, which compresses better."""
    arrays, runs = {}, {}
    for name, run in reference.runs.items():
        for part in ("means", "squares"):
            values = np.ascontiguousarray(getattr(run, part), "<f4")
            arrays[f"{name}.{part}"] = values.view(np.uint8).reshape(*values.shape, 4).T.copy()
        runs[name] = {"ledger": run.ledger, "block": run.block, "spp": run.spp}
    about = {"name": reference.name, "sha256": reference.sha256, "runs": runs,
             "facts": reference.facts}  # fmt: skip
    arrays["about"] = np.frombuffer(json.dumps(about).encode(), np.uint8)
    with replacing(path) as file:
        np.savez_compressed(file, **arrays)


def read(path: Path) -> Reference:
    """The contents of a file."""
    with np.load(path) as data:
        about = json.loads(data["about"].tobytes())
        runs = {}
        for name, facts in about["runs"].items():
            parts = {
                part: np.ascontiguousarray(data[f"{name}.{part}"].T).view("<f4")[..., 0]
                for part in ("means", "squares")
            }
            runs[name] = Run(**{p: v.astype(np.float64) for p, v in parts.items()}, **facts)
    return Reference(about["name"], about["sha256"], runs, about["facts"])


@functools.lru_cache(maxsize=128)  # all of them: 32 MB
def load(name: str) -> Reference:
    """The reference's results for a scene of scenes/checks.

    Raises FileNotFoundError where there are none.
    """
    return read(FOLDER / f"{name}.npz")
