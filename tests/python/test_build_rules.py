"""Rules of the source tree that a compiler does not check (CONTRIBUTING.md gives the reasons)."""

from __future__ import annotations

import ast
import re
from pathlib import Path

import pytest

import veriray
from veriray import device
from veriray.shipped import SHIPPED, find_shipped
from veriray_validate.levels import light_shapes

ROOT = Path(__file__).resolve().parents[2]
CPP = ROOT / "cpp"
BINDINGS = ROOT / "python" / "bindings"
PACKAGES = ("veriray", "veriray_bench", "veriray_validate")

#: A room (a layer of the C++ code) includes rooms of smaller rank and itself.
RANKS = {
    "core": 0, "schema": 0,
    "geometry": 1, "spectrum": 1,
    "bsdfs": 2, "media": 2, "lights": 2, "camera": 2, "film": 2, "textures": 2,
    "scene": 3,
    "integrators": 4,
    "schedulers": 5,
    "backends": 6,
    "api": 7,
}  # fmt: skip
#: Rooms whose code runs once per ray, on every device.
STAGE_ROOMS = {name for name, rank in RANKS.items() if rank <= 2} | {"integrators"}
LIBM = (
    "sin cos tan asin acos atan atan2 sincos sinpi cospi sinh cosh tanh asinh acosh atanh exp exp2 "
    "exp10 expm1 log log2 log10 log1p pow cbrt hypot erf erfc tgamma lgamma fmod remainder"
).split()

SOURCES = sorted(
    path
    for folder in (CPP, BINDINGS)
    for path in folder.rglob("*")
    if path.suffix in (".h", ".cpp", ".cu", ".cuh")
)
NAMES = [str(path.relative_to(ROOT)) for path in SOURCES]
each_source = pytest.mark.parametrize("path", SOURCES, ids=NAMES)


def code(path: Path) -> str:
    """The text without comments and string literals; line breaks stay."""
    text = path.read_text("utf-8")
    text = re.sub(r"/\*.*?\*/", lambda m: "\n" * m[0].count("\n"), text, flags=re.S)
    text = re.sub(r"//[^\n]*", "", text)
    return re.sub(r'(?<!include )"(?:\\.|[^"\\\n])*"', '""', text)


def room(path: Path) -> str:
    return "bindings" if BINDINGS in path.parents else path.relative_to(CPP).parts[0]


def test_sources_are_found() -> None:
    assert len(SOURCES) > 20


@each_source
def test_include_rule(path: Path) -> None:
    here = room(path)
    for target in re.findall(r'#\s*include\s+"([^"]+)"', code(path)):
        if here == "bindings":
            allowed = ("bindings.h", "api/testing.h", "schema/columns.def")
            assert target in allowed, "the bindings' includes"
            continue
        assert (CPP / target).is_file(), f"{target}: include paths start at cpp/"
        if here == "backends" and target.startswith("api/"):
            continue  # the interface that a back end implements
        there = target.split("/")[0]
        same_or_left = there == here or RANKS[there] < RANKS[here]
        assert same_or_left, f"{here} must not include {target}"


@each_source
def test_no_integrator_is_named_by_those_who_run_it(path: Path) -> None:
    if room(path) in ("schedulers", "backends", "api", "bindings"):
        found = re.findall(r"PathTracer|PathState|ShadowRequest|integrators/path\.h", code(path))
        assert not found, "schedulers and back ends know an Integrator (integrators/integrator.h)"


@each_source
def test_rooms_are_known(path: Path) -> None:
    assert room(path) in {*RANKS, "bindings"}


@each_source
def test_compiler_macros_stay_in_platform(path: Path) -> None:
    if path == CPP / "core" / "platform.h" or room(path) == "backends":
        return
    found = re.findall(r"__CUDACC\w*|__CUDA_ARCH__|__NVCC__", code(path))
    assert not found, "only core/platform.h and backends know which compiler is at work"


@each_source
def test_vendor_calls_stay_in_backends(path: Path) -> None:
    if path == CPP / "core" / "platform.h" or room(path) == "backends":
        return
    found = re.findall(
        r"\bcu(?:da)?[A-Z]\w+\s*\(|<<<|#\s*include\s*<cu(?:da|rand|b)\b[^>]*>", code(path)
    )
    assert not found


@each_source
def test_no_libm(path: Path) -> None:
    names = "|".join(LIBM)
    own = set(re.findall(r"\b(\w+)\s*\(", code(CPP / "core" / "math.h")))
    text = code(path)
    found = re.findall(rf"(?:std::|[^\w:]::|__builtin_|__)(?:{names})[fl]?\s*\(", text)
    found += re.findall(rf"(?<![\w.>:])(?:{names})[fl]\s*\(", text)
    found += [name for name in re.findall(rf"(?<![\w.>:])({names})\s*\(", text) if name not in own]
    assert not found, "elementary functions come from core/math.h, the same on every machine"


@each_source
def test_stage_code_uses_own_min_max(path: Path) -> None:
    if room(path) in STAGE_ROOMS:
        found = re.findall(r"std::f?(?:min|max)\b|\bf(?:min|max)f?\s*\(", code(path))
        assert not found, "min and max come from core/lane.h, which defines what NaN does"


@each_source
def test_no_process_wide_effects(path: Path) -> None:
    pattern = (
        r"\b(?:cudaMallocManaged|cudaDeviceReset|std::exit|std::abort|std::terminate|_exit|exit|abort|"
        r"std::rand|rand|srand|random_device|std::time|std::clock|gettimeofday|system_clock|setlocale)\s*\("
    )
    assert not re.findall(rf"(?<![.>\w]){pattern}", code(path))


@each_source
def test_no_floating_point_switches(path: Path) -> None:
    pattern = r"fast.?math|FP_CONTRACT|float_control|_MM_SET_|optimize\s*\(|__fdividef|use_fast"
    assert not re.findall(pattern, path.read_text("utf-8"), flags=re.I)


@each_source
def test_sizes(path: Path) -> None:
    lines = len(path.read_text("utf-8").splitlines())
    if path.suffix == ".h":
        assert lines < (200 if room(path) in ("bsdfs", "lights") else 400)
        assert "#pragma once" in path.read_text("utf-8")


def test_build_flags() -> None:
    text = "\n".join(
        re.sub(r"#.*", "", (ROOT / name).read_text("utf-8"))
        for name in ("CMakeLists.txt", "setup.py")
    )
    for banned in ("fast-math", "fast_math", "-Ofast", "march=native", "unsafe-math", "ftz=true"):
        assert banned not in text
    for needed in ("-ffp-contract=off", "-fmad=false", "-prec-div=true", "-prec-sqrt=true",
                   "-ftz=false"):  # fmt: skip
        assert needed in text


def test_the_best_instruction_set_is_chosen_as_the_package_chooses() -> None:
    text = (ROOT / "CMakeLists.txt").read_text("utf-8")
    found = re.findall(r"set\(isa_flags_(\w+) (.*)\)", text)
    added = {isa: set(flags.split()) for isa, flags in found}
    known: set[str] = set()
    for isa in ("portable", "avx2", "avx512"):
        known |= added.get(isa, set())
        assert known == device.FLAGS[isa], isa
        assert f"set(isa_module_{isa} {device.CPU_MODULES[isa]})" in text


def imported(path: Path) -> set[str]:
    """Top-level names that a Python file imports; relative imports do not count."""
    names: set[str] = set()
    for node in ast.walk(ast.parse(path.read_text("utf-8"))):
        if isinstance(node, ast.Import):
            names |= {alias.name.split(".")[0] for alias in node.names}
        elif isinstance(node, ast.ImportFrom) and not node.level and node.module:
            names.add(node.module.split(".")[0])
    return names


def test_reference_and_package_are_strangers() -> None:
    reference = sorted((ROOT / "reference").rglob("*.py"))
    assert reference
    for path in reference:
        assert not imported(path) & {*PACKAGES}, path
        assert not {*PACKAGES} & {
            *re.findall(r"import_module\(\W*(\w+)", path.read_text("utf-8"))
        }, path
    for name in PACKAGES:
        for path in (ROOT / "python" / name).rglob("*.py"):
            assert "reference" not in imported(path), path


def test_commands_print_by_say_alone() -> None:
    """`say` escapes what files and names could do to a terminal."""
    source = ROOT / "python" / "veriray"
    found = [
        f"{path.name}:{node.lineno}"
        for path in (source / "cli.py", *sorted((source / "commands").glob("*.py")))
        for node in ast.walk(ast.parse(path.read_text("utf-8")))
        if isinstance(node, ast.Call)
        and isinstance(node.func, ast.Name)
        and node.func.id == "print"
    ]
    assert len(found) == 1 and found[0].startswith("common.py:"), found


@pytest.mark.parametrize("name", PACKAGES)
def test_every_subpackage_is_installed(name: str) -> None:
    source, installed = ROOT / "python" / name, Path(veriray.__file__).parents[1] / name
    expected = {str(p.parent.relative_to(source)) for p in source.rglob("__init__.py")}
    assert expected == {
        str(p.parent.relative_to(installed)) for p in installed.rglob("__init__.py")
    }


@pytest.mark.parametrize("name", SHIPPED)
def test_shipped_scenes_load(name: str) -> None:
    assert find_shipped(name).is_file()
    assert len(veriray.load_file(name).triangles)


@pytest.mark.parametrize("path", sorted((ROOT / "tests").rglob("*.py")), ids=lambda p: p.name)
def test_what_is_skipped_says_why(path: Path) -> None:
    for node in ast.walk(ast.parse(path.read_text("utf-8"))):
        if not isinstance(node, ast.Call):
            continue
        called = ast.unparse(node.func)
        if called.endswith(("importorskip", "skipif", "mark.skip", "mark.xfail")):
            assert any(k.arg == "reason" for k in node.keywords), f"{path.name}:{node.lineno}"
        elif called == "pytest.skip":
            assert node.args, f"{path.name}:{node.lineno}"


def test_version_is_stated_once() -> None:
    from importlib.metadata import version

    assert version("veriray") == veriray.__version__
    assert f"## {veriray.__version__}" in (ROOT / "CHANGELOG.md").read_text("utf-8")


def test_nothing_outside_bsdfs_names_a_closure() -> None:
    text = (CPP / "bsdfs" / "closures.def").read_text("utf-8")
    names = re.findall(r"X\((\w+)\)", text)
    assert len(names) == len(veriray.columns.MATERIAL_KINDS)
    pattern = re.compile(rf"\bk(?:Kind)?(?:{'|'.join(names)})\b|\b(?:{'|'.join(names)})\s*<")
    for path in SOURCES:
        if room(path) != "bsdfs":
            assert not pattern.findall(code(path)), path


def test_kinds_are_those_of_the_closures() -> None:
    bsdfs = CPP / "bsdfs"
    listed = re.findall(r"X\((\w+)\)", (bsdfs / "closures.def").read_text("utf-8"))
    names = {}
    for path in bsdfs.glob("*.h"):
        found = re.search(
            r"struct (\w+) :(?:(?!struct).)*?kName = \"(\w+)\"", path.read_text(), re.DOTALL
        )
        if found:
            names[found[1]] = found[2]
    assert tuple(names[name] for name in listed) == veriray.columns.MATERIAL_KINDS


@pytest.mark.parametrize("header", ["bsdfs/closures.h", "integrators/surface.h"])
def test_host_code_has_no_stages(header: str) -> None:
    """An edited closure does not compile it again, and it walks no tree.

    The nodes of trees have another width in code for another instruction set (kCpuWidth).
    """

    def included(file: Path, seen: set[Path]) -> set[Path]:
        for name in re.findall(r'#include "([^"]+)"', file.read_text("utf-8")):
            found = next((f for f in (CPP / name, file.parent / name) if f.exists()), None)
            if found and found not in seen:
                seen.add(found)
                included(found, seen)
        return seen

    for part in (CPP / "scene", ROOT / "python" / "bindings"):
        for source in part.glob("*.cpp"):
            assert CPP / header not in included(source, set()), source


def shapes_of_lights() -> dict[str, tuple[str, str]]:
    """Types of the list in cpp/lights/shapes.h, in its order: name, feature."""
    members = r'struct (\w+) :(?:(?!struct).)*?kName = "(\w+)", \*kFeature = "(\w+)"'
    found = {}
    for path in (CPP / "lights").glob("*.h"):
        shapes = re.findall(members, path.read_text("utf-8"), re.DOTALL)
        assert len(shapes) <= 1, f"{path}: one shape a file"
        found.update({kind: (name, feature) for kind, name, feature in shapes})
    listed = re.findall(r"X\((\w+)\)", (CPP / "lights" / "shapes.h").read_text("utf-8"))
    assert {*listed} == {*found}
    return {kind: found[kind] for kind in listed}


def test_nothing_outside_lights_names_a_shape() -> None:
    """But scene/lights.cpp, which says once which lamp is of which shape."""
    pattern = re.compile(rf"\bk?(?:{'|'.join(shapes_of_lights())})\b")
    for path in SOURCES:
        if room(path) == "lights":
            continue
        found = pattern.findall(code(path))
        if path == CPP / "scene" / "lights.cpp":
            assert len(found) == len({*found})
        else:
            assert not found, path


def test_shapes_of_lights_are_tested_and_kinds_among_them() -> None:
    shapes = shapes_of_lights().values()
    assert [name for name, _ in shapes] == [*light_shapes.SHAPES] == [*light_shapes.LIGHT_SHAPES]
    unmet = tuple(name for name, feature in shapes if feature in ("delta_lights", "projectors"))
    assert unmet == veriray.columns.LIGHT_KINDS


@each_source
def test_kinds_are_no_numbers(path: Path) -> None:
    assert not re.findall(r"kind(?:\.data\[[^]]*\])?\s*[!=]=\s*\d", code(path))
