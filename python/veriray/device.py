"""Selection of the device that renders, with the reason.

A device name is one of

- `auto`: the first CUDA device if one can be used, else the CPU;
- `cuda`, `cuda:N`: the CUDA device of that index;
- `cpu`: the widest instruction set that both this processor and this build support, unless the
  environment variable VERIRAY_ISA names one; `cpu:avx512`, `cpu:avx2`, `cpu:portable`: that one.

Several with commas between them (`select_all`) render together; the CPU may be named several times,
and each then gets a part of its threads.

All of them give the same bits. No choice is silent: `select` returns its reason.
"""

from __future__ import annotations

import atexit
import contextlib
import functools
import importlib
import logging
import os
import platform
import threading
import time
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from .errors import DeviceError, OutOfMemoryError
from .numeric import shown

#: Instruction set -> native module, widest first.
CPU_MODULES = {"avx512": "_cpu_v4", "avx2": "_cpu_v3", "portable": "_cpu"}
#: Processor flags (as Linux names them) that a module's machine code needs.
FLAGS = {
    "portable": frozenset[str](),
    "avx2": frozenset("avx avx2 bmi1 bmi2 f16c fma abm movbe".split()),
}
FLAGS["avx512"] = FLAGS["avx2"] | set("avx512f avx512bw avx512cd avx512dq avx512vl".split())

_log = logging.getLogger("veriray")
_cuda_process: int | None = None
_END_WAIT = 60.0  # seconds
_inside: list[int] = []  # the threads that are in native code
_ending = False


@dataclass(frozen=True)
class Device:
    """One way to render on this machine.

    name: "cpu:avx512", "cuda:0"; description: the processor's or GPU's own name; lanes: paths in
    one vector (1 on CUDA); memory_total, memory_free: bytes; details: other facts from the native
    module (compute_capability, multiprocessors, driver).
    """

    name: str
    backend: str
    isa: str
    index: int
    description: str
    lanes: int
    memory_total: int
    memory_free: int
    details: dict[str, Any] = field(default_factory=dict)
    native: Any = field(default=None, repr=False, compare=False)


@functools.lru_cache(maxsize=1)
def processor_flags() -> frozenset[str] | None:
    """Flags of the first processor as the operating system reports them; None: unknown."""
    try:
        text = Path("/proc/cpuinfo").read_text(errors="replace")
    except OSError:
        return None
    for line in text.splitlines():
        key, _, value = line.partition(":")
        if key.strip() == "flags":
            return frozenset(value.split())
    return None


def load_native(module: str) -> Any:
    """The native module of that name (`_cpu`, `_cuda`, ...).

    Raises DeviceError with the exact reason if it is missing, cannot be loaded or cannot run here.
    A module whose instructions this processor lacks is never loaded.
    """
    isa = next((isa for isa, name in CPU_MODULES.items() if name == module), None)
    if isa is not None and FLAGS[isa]:
        flags = processor_flags()
        if platform.machine().lower() not in ("x86_64", "amd64"):
            raise DeviceError(f"this is a {platform.machine()} processor; {isa} is for x86-64")
        if flags is None:
            raise DeviceError("the processor's features are unknown: /proc/cpuinfo has no flags")
        missing = sorted(FLAGS[isa] - flags)
        if missing:
            raise DeviceError(f"this processor lacks {', '.join(missing)}")
    try:
        native = importlib.import_module(f"{__package__}.{module}")
    except ModuleNotFoundError as error:
        if error.name != f"{__package__}.{module}":
            raise DeviceError(f"module veriray.{module} cannot be loaded: {error}") from error
        wanted = "nvcc on PATH or VERIRAY_CUDA=1" if module == "_cuda" else "VERIRAY_CPU=all"
        raise DeviceError(f"module veriray.{module} was not built; build with {wanted}") from None
    except ImportError as error:
        raise DeviceError(f"module veriray.{module} cannot be loaded: {error}") from error
    if module == "_cuda":
        _check_fork()
    with native_errors():
        usable, reason = native.status()
    if not usable:
        hidden = os.environ.get("CUDA_VISIBLE_DEVICES")
        if module == "_cuda" and hidden is not None and hidden.strip() in ("", "-1"):
            reason = f"CUDA_VISIBLE_DEVICES={hidden!r} hides every device ({reason})"
        raise DeviceError(reason)
    return native


def _check_fork() -> None:
    """CUDA does not survive fork(): say so instead of failing somewhere inside the driver."""
    global _cuda_process
    if _cuda_process is None:
        _cuda_process = os.getpid()
    elif _cuda_process != os.getpid():
        raise DeviceError(
            f"CUDA was started in process {_cuda_process} before it was forked; start workers "
            'with multiprocessing.get_context("spawn")'
        )


@contextlib.contextmanager
def native_errors() -> Iterator[None]:
    """For calls of the native modules: translates their exceptions to those of `veriray.errors`.

    The interpreter would abort if it ended while another thread is in native code; see `_end`.
    """
    thread = threading.get_ident()
    _inside.append(thread)
    try:
        _stop_at_end()
        yield
    except MemoryError as error:
        text = "the host has too little memory" if str(error) == "std::bad_alloc" else str(error)
        raise OutOfMemoryError(text) from error
    except Exception as error:
        if type(error).__name__ == "DeviceError" and not isinstance(error, DeviceError):
            raise DeviceError(str(error)) from error
        raise
    finally:
        _inside.remove(thread)


def polled(callback: Callable[[float], object] | None) -> Callable[[float], object]:
    """A callback for native code: `callback`, unless the interpreter is ending."""

    def poll(share: float) -> None:
        _stop_at_end()
        if callback:
            callback(share)

    return poll


def _stop_at_end() -> None:
    if _ending and threading.current_thread() is not threading.main_thread():
        raise SystemExit  # ends a thread silently


def _end() -> None:
    """Stops daemon threads that are in native code, and waits until they have left it."""
    global _ending
    _ending = True
    last = time.monotonic() + _END_WAIT  # a progress callback may wait for ever
    while {*_inside} - {threading.get_ident()} and time.monotonic() < last:
        with contextlib.suppress(KeyboardInterrupt):
            time.sleep(0.005)


def _forked() -> None:
    """The other threads stay in the parent process."""
    _inside[:] = [thread for thread in _inside if thread == threading.get_ident()]


atexit.register(_end)
if hasattr(os, "register_at_fork"):
    os.register_at_fork(after_in_child=_forked)


#: What `_describe` found of a native module; the module is kept, so that its id stays its own.
_described: dict[int, tuple[Any, list[Device]]] = {}


def _describe(native: Any, backend: str, fresh: bool = True) -> list[Device]:
    """The module's devices; fresh: as they are now, with the memory that is free."""
    known = _described.get(id(native))
    if known is not None and not fresh:
        return known[1]
    info = native.build_info()
    result = []
    with native_errors():
        found = native.devices()
    for position, entry in enumerate(found):
        details = dict(entry)
        index = int(details.pop("index", position))
        if backend == "cpu" and "multiprocessors" in details:
            details["threads"] = details.pop("multiprocessors")
        isa = str(info.get("isa", ""))
        result.append(
            Device(
                name=f"cuda:{index}" if backend == "cuda" else f"cpu:{isa}",
                backend=backend,
                isa=isa,
                index=index,
                description=str(details.pop("name", "")),
                lanes=int(info.get("lanes", 1)),
                memory_total=int(details.pop("memory_total", 0)),
                memory_free=int(details.pop("memory_free", 0)),
                details={key: value for key, value in details.items() if value},
                native=native,
            )
        )
    if result:
        _described[id(native)] = native, result
    return result


def survey() -> tuple[list[Device], dict[str, str]]:
    """All devices that can render here, best first, and the reasons why the others cannot."""
    usable: list[Device] = []
    reasons: dict[str, str] = {}
    for name, module in {
        "cuda": "_cuda",
        **{f"cpu:{i}": m for i, m in CPU_MODULES.items()},
    }.items():
        try:
            found = _describe(load_native(module), name.split(":")[0])
            usable += found
            if not found:
                reasons[name] = "no device"
        except DeviceError as error:
            reasons[name] = str(error)
    return usable, reasons


def devices() -> list[Device]:
    """The devices that can render on this machine, best first."""
    return survey()[0]


def select(device: str = "auto", *, fresh: bool = True) -> tuple[Device, str]:
    """The device of that name (see the top of this module) and one line with the reason.

    fresh: ask the device for its free memory, which takes a good part of a small picture's time.
    Raises ValueError for an unknown name, DeviceError with the exact cause for a device that cannot
    be used here.
    """
    if not isinstance(device, str):
        raise ValueError(f"device = {shown(device)}; expected a string such as 'auto'")
    backend, _, detail = device.partition(":")
    if device == "auto":
        try:
            chosen = _cuda_device(0, fresh)
        except DeviceError as error:
            chosen, why = _cpu_device("", fresh)
            reason = f"{error}; {why}"
            level = logging.WARNING  # shown even where nobody set up logging
        else:
            reason = "auto takes a CUDA device if one can be used"
            level = logging.INFO
        _announce(level, f"{chosen.name} ({chosen.description}): {reason}")
        return chosen, reason
    if backend == "cuda" and (not detail or detail.isdecimal()) and not device.endswith(":"):
        return _cuda_device(int(detail or 0), fresh), "asked for"
    if backend == "cpu" and detail in ("", *CPU_MODULES) and not device.endswith(":"):
        chosen, why = _cpu_device(detail, fresh)
        return chosen, f"asked for; {why}" if why else "asked for"
    if "," in device:
        raise ValueError(f"device = {shown(device)} names several; one is expected here")
    raise ValueError(
        f"device = {shown(device)} is unknown; allowed: auto, cuda, cuda:N, cpu, "
        f"{', '.join(f'cpu:{isa}' for isa in CPU_MODULES)}"
    )


def cpu_module() -> Any:
    """The native module of the CPU, for what it does beside rendering; None where there is none."""
    try:
        return select("cpu", fresh=False)[0].native
    except (DeviceError, ValueError):  # of VERIRAY_ISA
        return None


def select_all(
    device: str | Sequence[str] = "auto", *, fresh: bool = True
) -> list[tuple[Device, str]]:
    """As `select`, of a name or several with commas between them, in their order.

    Raises ValueError also for a GPU that is named twice, and for "auto" beside others.
    """
    text: Any = ",".join(device) if isinstance(device, (list, tuple)) else device
    if not isinstance(text, str) or "," not in text:
        return [select(text, fresh=fresh)]
    names = [name.strip() for name in text.split(",")]
    if not all(names):
        raise ValueError(f"device = {shown(device)}: a name is empty")
    if "auto" in names:
        raise ValueError(f"device = {device!r}: auto stands alone")
    chosen = [select(name, fresh=fresh) for name in names]
    for k, (one, _) in enumerate(chosen):
        if one.backend == "cuda" and any(one.name == other.name for other, _ in chosen[:k]):
            raise ValueError(f"device = {device!r} names {one.name} twice")
    return chosen


@functools.lru_cache(maxsize=64)
def _announce(level: int, message: str) -> None:
    """Logs a choice once in a process."""
    _log.log(level, message)


def _cuda_device(index: int, fresh: bool) -> Device:
    try:
        found = _describe(load_native("_cuda"), "cuda", fresh)
    except DeviceError as error:
        raise DeviceError(f"CUDA cannot be used: {error}") from error
    for device in found:
        if device.index == index:
            return device
    names = ", ".join(device.name for device in found) or "none"
    raise DeviceError(f"cuda:{index} does not exist; CUDA devices here: {names}")


def _cpu_device(isa: str, fresh: bool) -> tuple[Device, str]:
    """The CPU with that instruction set; "" takes VERIRAY_ISA, else the widest that runs."""
    why = ""
    if not isa and os.environ.get("VERIRAY_ISA"):
        isa = os.environ["VERIRAY_ISA"]
        if isa not in CPU_MODULES:
            raise ValueError(f"VERIRAY_ISA = {isa!r}; allowed: {', '.join(CPU_MODULES)}")
        why = f"VERIRAY_ISA={isa}"
    if isa:
        try:
            return _describe(load_native(CPU_MODULES[isa]), "cpu", fresh)[0], why
        except DeviceError as error:
            raise DeviceError(f"cpu:{isa}: {error}") from error
    reasons = []
    for name, module in CPU_MODULES.items():
        try:
            device = _describe(load_native(module), "cpu", fresh)[0]
        except DeviceError as error:
            reasons.append(f"{name}: {error}")
            continue
        return device, f"{name} is the widest instruction set that runs here"
    raise DeviceError("no CPU module can be used: " + "; ".join(reasons))
