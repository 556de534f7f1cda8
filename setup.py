"""Builds the native modules with CMake; ships scenes and C++ headers inside the package `veriray`.

Environment: VERIRAY_CPU, VERIRAY_CUDA, VERIRAY_CUDA_ARCH and VERIRAY_CCCL_DIR (see CMakeLists.txt);
VERIRAY_JOBS, the number of compilers that run at a time (default: all processors);
VERIRAY_BUILD_DIR, where CMake works (default: a folder in build/ for each Python). Builds for
several Pythons in one folder share what does not depend on Python: nearly all.
"""

from __future__ import annotations

import os
import shutil
import subprocess
import sys
from pathlib import Path
from sysconfig import get_config_var, get_platform

from setuptools import Extension, setup
from setuptools.command.build_ext import build_ext
from setuptools.command.build_py import build_py

ROOT = Path(__file__).resolve().parent
MODULES = f"_c*{get_config_var('EXT_SUFFIX')}"
SCENE_SUFFIXES = {
    ".xml", ".obj", ".ply", ".serialized", ".exr", ".png", ".csv", ".json", ".txt", ".md",
    ".vol",
}  # fmt: skip


def scene_files() -> list[Path]:
    """Shipped scene files relative to scenes/, without reference pictures."""
    root = ROOT / "scenes"
    files = (path.relative_to(root) for path in sorted(root.rglob("*")))
    kept = (f for f in files if "refs" not in f.parts)
    return [f for f in kept if f.suffix in SCENE_SUFFIXES]


def device_code() -> list[Path]:
    """What kernels made at run time are compiled from, relative to cpp/."""
    root = ROOT / "cpp"
    files = (path.relative_to(root) for path in sorted(root.rglob("*")) if path.is_file())
    return [f for f in files if f.suffix in {".h", ".def", ".cuh"} or f.parent.name == "run_time"]


def find_tools() -> dict[str, str | None]:
    """Paths of the build tools; ends the build when one that is needed is missing."""
    path = os.pathsep.join([str(Path(sys.executable).parent), os.environ.get("PATH", "")])
    os.environ["PATH"] = path
    tools = {name: shutil.which(name) for name in ("cmake", "ninja", "nvcc")}
    for name in ("cmake", "ninja"):
        if tools[name] is None:
            sys.exit(
                f"veriray: {name} not found. `pip install .` brings it along; with "
                f"--no-build-isolation, `pip install {name}` first."
            )
    return tools


def call(command: list[object]) -> None:
    """Run a build step; ends the build when it fails."""
    if subprocess.run([str(word) for word in command]).returncode:
        sys.exit("veriray: the native build failed; the reason is printed above.")


def build_modules(build: Path) -> list[Path]:
    """Configure and compile in `build`; returns the modules made."""
    tools = find_tools()
    jobs = os.environ.get("VERIRAY_JOBS") or ""
    if jobs and not (jobs.isdigit() and int(jobs) >= 1):
        sys.exit(f"veriray: VERIRAY_JOBS is {jobs!r}; allowed is an integer >= 1.")
    modules = build / "modules"
    found = {"CMAKE_MAKE_PROGRAM": tools["ninja"], "Python_EXECUTABLE": sys.executable}
    options = {
        "CMAKE_BUILD_TYPE": "Release",
        "VERIRAY_OUTPUT_DIRECTORY": modules,
        "VERIRAY_CPU": os.environ.get("VERIRAY_CPU") or "all",
        "VERIRAY_CUDA": os.environ.get("VERIRAY_CUDA") or "auto",
        "VERIRAY_CUDA_ARCH": os.environ.get("VERIRAY_CUDA_ARCH", ""),
        "VERIRAY_CCCL_DIR": os.environ.get("VERIRAY_CCCL_DIR", ""),
    }
    configure = ["cmake", "-S", ROOT, "-B", build, "-G", "Ninja"]
    # CMake keeps what it found, so another compiler or option needs a fresh start. Python it finds
    # anew: pip puts Ninja and pybind11 for a build into a folder of another name each time.
    names = ("Python*", "_Python*", "PYTHON*", "pybind11*", "PYBIND11*")
    configure += [f"-U{name}" for name in names]
    configure += [f"-D{key}={value}" for key, value in (found | options).items()]
    compilers = {
        name: os.environ.get(name) for name in ("CXX", "CUDACXX", "CUDA_HOME", "CUDAFLAGS")
    }
    key = repr((tools["nvcc"], compilers, str(ROOT), sorted(map(str, options.items()))))
    key_file = build / "configured-for.txt"
    if not key_file.exists() or key_file.read_text() != key:
        shutil.rmtree(build, ignore_errors=True)
        build.mkdir(parents=True)
    call(configure)
    key_file.write_text(key)
    call(["cmake", "--build", build, *(["--parallel", jobs] if jobs else [])])
    made = sorted(modules.glob(MODULES))
    if not made:
        sys.exit(f"veriray: the native build made no module {MODULES} in {modules}.")
    return made


class BuildPy(build_py):
    """Copies scenes/ to veriray/scenes/ in the built package, and headers to device_code/."""

    def run(self) -> None:
        """Start from empty folders, run the normal step, then add scenes and headers."""
        if self.editable_mode:
            return super().run()
        for name in ("veriray", "veriray_bench", "veriray_validate"):
            shutil.rmtree(Path(self.build_lib, name), ignore_errors=True)
        super().run()
        lists = (("scenes", "scenes", scene_files()), ("cpp", "device_code", device_code()))
        for source, folder, files in lists:
            for file in files:
                target = Path(self.build_lib, "veriray", folder, file)
                target.parent.mkdir(parents=True, exist_ok=True)
                shutil.copyfile(ROOT / source / file, target)


class CMakeBuild(build_ext):
    """Runs CMake once for all native modules."""

    outputs: list[str] = []

    def run(self) -> None:
        """Build, then copy the modules into the package."""
        inplace = self.inplace or self.editable_mode
        package = (ROOT / "python" if inplace else Path(self.build_lib)) / "veriray"
        package.mkdir(parents=True, exist_ok=True)
        for stale in package.glob(MODULES):
            stale.unlink()
        # An editable build gets a temporary folder; CMake works where other builds do.
        temp = f"temp.{get_platform()}-{sys.implementation.cache_tag}"
        own = ROOT / "build" / temp if self.editable_mode else Path(self.build_temp)
        folder = os.environ.get("VERIRAY_BUILD_DIR") or own / "cmake"
        modules = build_modules(Path(folder).resolve())
        self.outputs = [str(shutil.copy2(module, package)) for module in modules]

    def get_outputs(self) -> list[str]:
        """Paths of the modules that were built."""
        return self.outputs


setup(
    ext_modules=[Extension("veriray._cpu", sources=[])],
    cmdclass={"build_ext": CMakeBuild, "build_py": BuildPy},
)
