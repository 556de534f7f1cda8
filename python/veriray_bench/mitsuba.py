"""Mitsuba 3 as a peer: the same files; its sampler is the file's.

Its roulette survives with probability min(max throughput, 0.95), ours without the cap: the same
mean, slightly other noise.
"""

from __future__ import annotations

import os
import re
import time
from pathlib import Path
from typing import Any

import numpy as np

from .measure import Array, Meter
from .peers import serve

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


class Mitsuba:
    """The renderer of the peer's process; mi: the module from `start`."""

    def __init__(self, mi: Any) -> None:
        import drjit

        self._mi, self._dr = mi, drjit
        self._scenes: dict[str, Any] = {}

    def load(self, key: str, path: str, settings: dict[str, Any]) -> float:
        """Seconds to read a file, with its parameters as settings."""
        begin = time.perf_counter()
        self._scenes[key] = self._mi.load_file(path, **settings)
        self._dr.sync_thread()
        return time.perf_counter() - begin

    def run(self, key: str, spp: int, seed: int) -> tuple[dict[str, Any], Array]:
        """seconds: until the film is complete; wall, cpu, foreign: to the picture in NumPy."""
        self._dr.sync_thread()
        with Meter() as m:
            begin = time.perf_counter()
            film = self._mi.render(self._scenes[key], spp=spp, seed=seed)
            self._dr.eval(film)
            self._dr.sync_thread()
            seconds = time.perf_counter() - begin
            image = np.array(film, dtype=np.float32)[..., :3]
        return {"seconds": seconds, **m.row()}, image

    def forget(self) -> None:
        """Free all scenes and cached memory."""
        self._scenes.clear()
        self._dr.flush_malloc_cache()


def _start(variant: str) -> tuple[dict[str, Any], Mitsuba]:
    mi = start(variant)
    renderer = Mitsuba(mi)
    return {"version": mi.__version__}, renderer


if __name__ == "__main__":
    serve(_start)
