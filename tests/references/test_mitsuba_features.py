"""Feature images beside those of Mitsuba's integrator `aov`."""

from __future__ import annotations

import math
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt
import pytest

import veriray as vr

pytest.importorskip("mitsuba", reason="the peer renderer: pip install mitsuba")
from benchmarks import mitsuba_peer  # noqa: E402

Array = npt.NDArray[Any]
SCENES = Path(vr.__file__).parent / "scenes"
#: Our name, Mitsuba's, numbers.
AOVS = (("depth", "depth", 1), ("position", "position", 3), ("uv", "uv", 2),
        ("geo_normal", "geo_normal", 3), ("normal", "sh_normal", 3))  # fmt: skip
SEEDS, SPP, SIZE, BLOCK = 24, 16, 24, 4


def blocks(values: Array) -> Array:
    """Means over blocks of pixels, (..., blocks, C)."""
    n = SIZE // BLOCK
    parts = values.reshape(len(values), n, BLOCK, n, BLOCK, -1).mean(axis=(2, 4))
    return parts.reshape(len(values), n * n, -1)


def means(values: Array) -> tuple[Array, Array]:
    """Mean over seeds and its standard error."""
    return values.mean(0), values.std(0, ddof=1) / math.sqrt(len(values))


@pytest.mark.parametrize(
    "name", ["cornell/cornell_box_mitsuba.xml", "checks/smooth_normals.xml", "checks/textures.xml"]
)
def test_agrees_with_aov(name: str) -> None:
    """Means over all samples, by blocks of pixels and as a whole.

    432 blocks and numbers an image of Student's t with 46 degrees of freedom: |t| > 6 once in 8,000
    runs of the three scenes. Rounding gets a millionth of the largest number."""
    mi = mitsuba_peer.start("scalar_rgb")
    scene = vr.load_file(SCENES / name).with_(width=SIZE, height=SIZE)
    theirs = mi.load_file(str(SCENES / name), width=SIZE, height=SIZE)
    sensor = mi.traverse(theirs.sensors()[0])  # from whose near plane Mitsuba's depth counts
    sensor["near_clip"] = 1e-9 * sensor["far_clip"]
    sensor.update()
    aovs = [row for row in AOVS if row[0] != "uv" or scene.uv.any()]
    integrator = mi.load_dict(
        {"type": "aov", "aovs": ",".join(f"{ours}:{other}" for ours, other, _ in aovs)}
    )
    pictures = np.array(
        [np.array(mi.render(theirs, integrator=integrator, spp=SPP, seed=k)) for k in range(SEEDS)]
    ).astype(float)
    assert pictures.shape == (SEEDS, SIZE, SIZE, sum(n for _, _, n in aovs))
    names = tuple(ours for ours, _, _ in aovs)
    runs = [vr.feature_images(scene, names, spp=SPP, seed=k, device="cpu") for k in range(SEEDS)]
    at = 0
    for ours, _, n in aovs:
        share = np.array([run["alpha"] for run in runs], float)[..., None]
        mine = np.array([run[ours] for run in runs], float).reshape(SEEDS, SIZE, SIZE, n)
        mine = np.where(share > 0, mine, 0) * share
        other, at = pictures[..., at : at + n], at + n
        for reduce in (blocks, lambda v: blocks(v).mean(axis=1, keepdims=True)):
            (a, a_error), (b, b_error) = means(reduce(mine)), means(reduce(other))
            slack = 1e-6 * max(float(np.abs(b).max()), 1e-3)
            t = np.maximum(np.abs(a - b) - slack, 0) / np.maximum(np.hypot(a_error, b_error), slack)
            assert t.max() < 6, (ours, float(t.max()), np.unravel_index(t.argmax(), t.shape))
