"""`veriray doctor`: describes this installation, what it can use, and whether it is correct."""

from __future__ import annotations

import os
import platform
import sys
import time
from typing import Any

from . import __version__, kernels
from . import device as device_module
from .device import CPU_MODULES, Device
from .errors import DeviceError
from .rendering import METHODS, render
from .scene import cornell_box

#: The self-test: the measured Cornell box at this size, seed 0, the scene file's depths.
SELF_TEST: dict[str, Any] = {"width": 64, "height": 64, "spp": 4}
#: Its film hash (`veriray.film_hash`) on every device.
EXPECTED_SHA256 = "a58ef30cc9d939e7c4e55a7ca98f31a956e7cb4469187411830754912ae4edb5"


def examine(self_test: bool = True) -> dict[str, Any]:
    """Everything that `veriray doctor --json` prints, as plain data.

    Keys: version, python, platform, processor, environment, modules (name -> build_info or the
    reason why it cannot be used), devices, unusable (name -> reason), auto (what "auto" would take
    and why), kernels_at_run_time (what makes them on CUDA, or why there are none), self_test
    (expected, runs, passed).
    """
    usable, unusable = device_module.survey()
    report: dict[str, Any] = {
        "version": __version__,
        "python": f"{platform.python_implementation()} {platform.python_version()}",
        "executable": sys.executable,
        "package": os.path.dirname(os.path.abspath(__file__)),
        "platform": platform.platform(),
        "cpus": len(os.sched_getaffinity(0))
        if hasattr(os, "sched_getaffinity")
        else os.cpu_count(),
        "environment": {
            name: os.environ[name]
            for name in (
                "VERIRAY_ISA",
                "VERIRAY_KERNELS",
                "VERIRAY_NVRTC",
                "CUDA_VISIBLE_DEVICES",
            )  # fmt: skip
            if name in os.environ
        },
        "modules": _modules(),
        "devices": [_plain(device) for device in usable],
        "unusable": unusable,
    }
    try:
        chosen, reason = device_module.select("auto")
        report["auto"] = {"device": chosen.name, "reason": reason}
    except (DeviceError, ValueError) as error:
        report["auto"] = {"device": None, "reason": str(error)}
    report["kernels_at_run_time"] = kernels.available() or f"made by {kernels.compiler()}"
    report["self_test"] = run_self_test(usable) if self_test else None
    return report


def _modules() -> dict[str, Any]:
    """build_info of each native module that can be loaded, else {"error": reason}."""
    found: dict[str, Any] = {}
    for module in ("_cuda", *CPU_MODULES.values()):
        try:
            found[module] = dict(device_module.load_native(module).build_info())
        except DeviceError as error:
            found[module] = {"error": str(error)}
    return found


def _plain(device: Device) -> dict[str, Any]:
    return {
        "name": device.name,
        "description": device.description,
        "isa": device.isa,
        "lanes": device.lanes,
        "memory_total": device.memory_total,
        "memory_free": device.memory_free,
        **device.details,
    }


def run_self_test(usable: list[Device]) -> dict[str, Any]:
    """Render the test picture with every device and scheduler; all hashes must be equal.

    Passed: at least one run, no failure, and every hash is EXPECTED_SHA256.
    """
    scene = cornell_box()
    runs = []
    for device in usable:
        for scheduler in METHODS:
            run: dict[str, Any] = {"device": device.name, "scheduler": scheduler}
            start = time.perf_counter()
            try:
                run["film_sha256"] = render(
                    scene, device=device.name, scheduler=scheduler, **SELF_TEST
                ).film_sha256
            except (RuntimeError, MemoryError, ValueError) as error:
                run["error"] = f"{type(error).__name__}: {error}"
            run["seconds"] = round(time.perf_counter() - start, 3)
            runs.append(run)
    hashes = {run.get("film_sha256") for run in runs}
    passed = hashes == {EXPECTED_SHA256}
    return {"expected": EXPECTED_SHA256, "runs": runs, "passed": passed}


def as_text(report: dict[str, Any]) -> str:
    """The report for people."""
    lines = [
        f"veriray {report['version']}, {report['python']}, {report['platform']}",
        f"installed in {report['package']}; {report['cpus']} CPUs",
    ]
    lines += [f"{name}={value!r}" for name, value in report["environment"].items()]
    lines += ["", "Native modules"]
    for name, info in report["modules"].items():
        if "error" not in info:
            lines.append(f"  {name:<8} {_module_line(info)}")
    lines += ["", "Devices"]
    for device in report["devices"]:
        gib = 1 << 30
        details = ", ".join(
            f"{key.replace('_', ' ')} {value}"
            for key, value in device.items()
            if key not in ("name", "description", "isa", "lanes", "memory_total", "memory_free")
        )
        memory = f"{device['memory_free'] / gib:.1f} of {device['memory_total'] / gib:.1f} GiB free"
        width = f"{device['lanes']} lanes, " if device["lanes"] > 1 else ""
        lines.append(
            f"  {device['name']:<13} {device['description']}: {width}{memory}"
            + (f", {details}" if details else "")
        )
    for name, reason in report["unusable"].items():
        lines.append(f"  {name:<13} not usable: {reason}")
    lines.append(f"  auto takes {report['auto']['device']}: {report['auto']['reason']}")
    if any(device["name"].startswith("cuda") for device in report["devices"]):
        lines.append(f"  kernels at run time: {report['kernels_at_run_time']}")
    test = report["self_test"]
    if test is not None:
        lines += ["", _self_test_title()]
        for run in test["runs"]:
            result = run.get("film_sha256") or f"FAILED: {run['error']}"
            lines.append(
                f"  {run['device']:<13} {run['scheduler']:<9} {run['seconds']:6.2f} s  {result}"
            )
        lines.append(f"  {'expected':<32} {test['expected']}")
        lines.append("  passed" if test["passed"] else "  FAILED: not the expected hash everywhere")
    return "\n".join(lines)


def _self_test_title() -> str:
    return "Self-test (cornell-box, {width} x {height}, {spp} spp, seed 0)".format(**SELF_TEST)


def _module_line(info: dict[str, Any]) -> str:
    parts = [f"{info.get('isa')}, {info.get('lanes')} lanes", str(info.get("compiler"))]
    parts.append(f"Thrust {info.get('thrust')}")
    if info.get("cuda_toolkit"):
        parts.append(f"CUDA {info['cuda_toolkit']} for {info.get('cuda_architectures')}")
    return ", ".join(parts)
