"""Mitsuba 3 on our scene files, its pictures as `veriray.Render`.

Mitsuba reads the same XML file. Its roulette survives with probability min(max throughput, 0.95),
ours without the cap: the same mean, slightly other noise.
"""

from __future__ import annotations

import math
import os
import re
import time
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

from veriray import Render, film_hash

Array = npt.NDArray[Any]
_LLVM_FOLDERS = ("/usr/lib", "/usr/lib64", "/usr/local/lib", "/opt/homebrew/opt/llvm/lib")
_OLDEST_LLVM = 17  # 15 ends the process: "Cannot select: fminimum"


def libllvm() -> Path | None:
    """The newest libLLVM that Mitsuba's llvm variants work with; DRJIT_LIBLLVM_PATH comes first."""
    if os.environ.get("DRJIT_LIBLLVM_PATH"):
        return Path(os.environ["DRJIT_LIBLLVM_PATH"])
    found = []
    for folder in map(Path, _LLVM_FOLDERS):
        for pattern in ("libLLVM*", "*-linux-gnu/libLLVM*", "llvm*/lib/libLLVM*"):
            for path in folder.glob(pattern):
                version = re.fullmatch(r"libLLVM(?:-|\.so\.)(\d+).*", path.name)
                if version and int(version[1]) >= _OLDEST_LLVM:
                    found.append((int(version[1]), path))
    return max(found)[1] if found else None


def start(variant: str) -> Any:
    """The module mitsuba with `variant` set; ImportError or RuntimeError says why not.

    variant: "scalar_rgb", "llvm_ad_rgb" or "cuda_ad_rgb".
    """
    if variant.startswith("llvm"):
        library = libllvm()
        if library is None:
            raise RuntimeError(
                f"no libLLVM >= {_OLDEST_LLVM}: install one (Debian: apt install libllvm19) or "
                "name it with DRJIT_LIBLLVM_PATH"
            )
        os.environ["DRJIT_LIBLLVM_PATH"] = str(library)
    import mitsuba

    try:
        mitsuba.set_variant(variant)
    except Exception as error:
        raise RuntimeError(f"Mitsuba cannot use {variant}: {error}") from error
    return mitsuba


def picture(mi: Any, scene: Any, spp: int, seed: int) -> Array:
    """(H, W, 3) float32."""
    return np.array(mi.render(scene, spp=spp, seed=seed), dtype=np.float32)[..., :3]


def batch_means(mi: Any, scene: Any, batches: int, spp: int, seed: int) -> Iterator[Array]:
    """`batches` pictures of spp samples each, with seeds seed, seed + 1 ..."""
    for k in range(batches):
        yield picture(mi, scene, spp, seed + k)


def render(
    mi: Any, path: Path, *, batches: int, spp: int, seed: int, max_depth: int, rr_depth: int,
    width: int, height: int,
) -> Render:  # fmt: skip
    """`batches` runs of spp samples a pixel each, as one Render with batch means, without ledger.

    The scene file must have the parameters max_depth, rr_depth, width and height.
    """
    scene = mi.load_file(
        str(path), max_depth=max_depth, rr_depth=rr_depth, width=width, height=height
    )
    begin = time.perf_counter()
    means = np.stack(list(batch_means(mi, scene, batches, spp, seed))).astype(np.float64)
    image = means.mean(axis=0).astype(np.float32)
    stderr = (means.std(axis=0, ddof=1) / math.sqrt(batches)).astype(np.float32)
    total = spp * batches
    return Render(
        image=image,
        stderr=stderr,
        batch_means=means,
        film_sha256=film_hash(image, stderr, total),
        stats={
            "renderer": f"mitsuba {mi.__version__} {mi.variant()}",
            "max_depth": max_depth,
            "rr_depth": rr_depth,
            "seconds": time.perf_counter() - begin,
        },
        width=width,
        height=height,
        spp=total,
        seed=seed,
    )
