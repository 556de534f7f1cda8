"""Kernels made at run time for exactly what a scene needs, on CUDA.

The compiled variants are few, so a scene's holds code that it does not need, and pays for it in
registers and instructions. Where NVRTC can be found (the CUDA toolkit or the package
`nvidia-cuda-nvrtc`), a scene that is rendered for long gets a kernel of its own: a child process
compiles it meanwhile (1 to 5 seconds), the rest of a long render and later renders of scenes with
the same features use it, and it is kept in a folder for the next process. Pictures do not depend
on it, to the bit.

Environment: VERIRAY_KERNELS is "auto", "off", or "wait" (each render waits for its kernel);
VERIRAY_CACHE is the folder (default: `veriray` in XDG_CACHE_HOME or ~/.cache); VERIRAY_NVRTC is the
library's file.
"""

from __future__ import annotations

import contextlib
import functools
import hashlib
import importlib.util
import logging
import os
import subprocess
import sys
import threading
from collections import Counter
from pathlib import Path
from typing import TYPE_CHECKING

from .device import Device
from .errors import DeviceError

if TYPE_CHECKING:
    from ._native import Scene as NativeScene

#: Paths with the same features from which on a kernel of their own pays for being compiled.
PATHS_THAT_PAY = 1 << 18
MODES = ("auto", "off", "wait")
METHODS = ("fused", "wavefront")
_WAIT = 300.0  # seconds for one compilation
#: Compilations at a time.
MOST_CHILDREN = max(1, min(4, (os.cpu_count() or 1) // 2))

#: Device, features, method of the scheduler.
Key = tuple[int, int, str]

_log = logging.getLogger("veriray")
_lock = threading.Lock()
_paths: Counter[Key] = Counter()
_settled: dict[Key, bool] = {}  # whether added; False: not to be had
_children: dict[Key, subprocess.Popen[bytes]] = {}


def _forget_parent() -> None:
    """A child process must wait for no thread and no child process of its parent."""
    global _lock
    _lock = threading.Lock()
    _children.clear()


if hasattr(os, "register_at_fork"):
    os.register_at_fork(after_in_child=_forget_parent)


def mode() -> str:
    """VERIRAY_KERNELS; DeviceError where it is none of MODES."""
    given = os.environ.get("VERIRAY_KERNELS") or "auto"
    if given not in MODES:
        raise DeviceError(f"VERIRAY_KERNELS = {given!r}; allowed: {', '.join(MODES)}")
    return given


@functools.lru_cache(maxsize=1)
def compiler() -> Path | None:
    """The file of libnvrtc, or None."""
    if given := os.environ.get("VERIRAY_NVRTC"):
        return Path(given)
    roots: list[Path] = []
    with contextlib.suppress(ImportError, ValueError):
        spec = importlib.util.find_spec("nvidia")
        roots += [Path(p) for p in (spec.submodule_search_locations or ())] if spec else []
    found = [f for root in roots for f in sorted(root.glob("*/lib/libnvrtc.so.*"))]
    for home in (os.environ.get("CUDA_HOME"), os.environ.get("CUDA_PATH"), "/usr/local/cuda"):
        if home:
            found += sorted(Path(home, "lib64").glob("libnvrtc.so.*"))
    return next((f for f in found if "alt" not in f.name), None)


@functools.lru_cache(maxsize=1)
def sources() -> Path | None:
    """The folder of the C++ headers: in the package, or in the checkout that it runs from."""
    here = Path(__file__).resolve().parent
    candidates = here / "device_code", here.parents[1] / "cpp"
    return next((f for f in candidates if (f / "backends/run_time/kernel.cuh").exists()), None)


def folder() -> Path:
    """Where kernels are kept between processes."""
    if given := os.environ.get("VERIRAY_CACHE"):
        return Path(given, "kernels")
    base = os.environ.get("XDG_CACHE_HOME") or Path.home() / ".cache"
    return Path(base, "veriray", "kernels")


@functools.lru_cache(maxsize=1)
def _origin() -> str:
    """Digest of what the code follows from, but for architecture and features."""
    library, root = compiler(), sources()
    assert library is not None and root is not None
    real = library.resolve()
    digest = hashlib.sha256(f"{real.name} {real.stat().st_size}".encode())
    files = [Path(__file__).with_name("kernel_compiler.py"), *sorted(root.rglob("*"))]
    for file in files:
        if file.is_file():
            digest.update(file.read_bytes())
    return digest.hexdigest()[:32]


@functools.lru_cache(maxsize=1)
def _edited() -> bool:
    """Whether a checkout's headers are newer than its module, which may have other structures."""
    root, module = sources(), importlib.util.find_spec(f"{__package__}._cuda")
    origin = module.origin if module else None
    if root is None or root.name == "device_code" or origin is None:
        return False
    built = Path(origin).stat().st_mtime
    headers = (f for form in ("*.h", "*.cuh", "*.def") for f in root.rglob(form))
    return any(f.stat().st_mtime > built for f in headers)


def available() -> str:
    """Why no kernels are made at run time; empty if they are."""
    if mode() == "off":
        return "VERIRAY_KERNELS is off"
    if compiler() is None:
        return "no libnvrtc (pip install nvidia-cuda-nvrtc)"
    if sources() is None:
        return "the package has no device code"
    if _edited():
        return "sources are newer than the module; build it again"
    return "" if sys.executable else "the Python interpreter is unknown"


def offer(device: Device, native: NativeScene, method: str, paths: int) -> bool:
    """Sees to kernels for a scene of which `paths` more are about to be rendered on a CUDA device.

    method: of the scheduler, one of METHODS; others have compiled kernels alone. Returns whether
    they are being compiled, so that it pays to ask again after a part of the render.

    Never fails for want of one: the compiled variant renders then.
    """
    features = int(native.feature_mask)
    key = device.index, features, method
    if key in _settled or method not in METHODS:
        return False
    how = mode()
    with _lock:
        _paths[key] += paths
        if key in _settled or (how != "wait" and _paths[key] < PATHS_THAT_PAY):
            return False
        try:
            if available():
                _settled[key] = False
            else:
                _advance(device, key, how == "wait")
        except (OSError, RuntimeError, MemoryError, subprocess.SubprocessError) as error:
            _give_up(key, str(error))
        return key in _children


def made(device: Device, native: NativeScene, method: str) -> bool:
    """Whether renders of the scene with this method run kernels of its own."""
    return _settled.get((device.index, int(native.feature_mask), method), False)


def _advance(device: Device, key: Key, wait: bool) -> None:
    """Adds the kernels if they exist, else starts their compilation, or looks how far it is."""
    architecture = "sm_" + str(device.details["compute_capability"]).replace(".", "")
    file = folder() / f"{key[2]}-{architecture}-{key[1]:x}-{_origin()}.cubin"
    for other in [k for k, child in _children.items() if child.poll() is not None]:
        _finish(other)
    if key not in _settled and not file.exists():
        if key not in _children and (wait or len(_children) < MOST_CHILDREN):
            _children[key] = _start(file, architecture, key)
        if wait:
            _children[key].wait(_WAIT)
            _finish(key)
    if key not in _settled and file.exists():
        code = file.read_bytes()
        if not code.startswith(b"\x7fELF"):  # power was lost before it reached the disk
            file.unlink()
            raise RuntimeError(f"{file} was damaged")
        device.native.add_kernels(*key[:2], code)
        _settled[key] = True


def _finish(key: Key) -> None:
    """Takes note of a compilation that has ended."""
    child = _children.pop(key)
    errors = b""
    if child.stderr:
        with child.stderr as stream:
            errors = stream.read() if child.returncode else b""
    if child.returncode:
        _give_up(key, errors.decode(errors="replace")[-2000:])


def _start(file: Path, architecture: str, key: Key) -> subprocess.Popen[bytes]:
    file.parent.mkdir(mode=0o700, parents=True, exist_ok=True)
    program = Path(__file__).with_name("kernel_compiler.py")
    arguments = [compiler(), sources(), architecture, *key[1:], file]
    return subprocess.Popen(
        [sys.executable, "-I", str(program), *map(str, arguments)],
        stdin=subprocess.DEVNULL, stdout=subprocess.DEVNULL, stderr=subprocess.PIPE,
    )  # fmt: skip


def _give_up(key: Key, why: str) -> None:
    _settled[key] = False
    _log.info("no kernel for features %x: %s", key[1], why)
