"""What works without the optional packages, and what says which of them to install.

The packages are hidden from new processes: they cannot be found, as if they were not installed.
"""

from __future__ import annotations

import os
import re
import subprocess
import sys
from pathlib import Path

import pytest

import veriray
from veriray import extras
from veriray.errors import MissingPackageError

tomllib = pytest.importorskip(
    "tomllib" if sys.version_info >= (3, 11) else "pip._vendor.tomli",
    reason="no reader of TOML: Python 3.11 has one, and pip",
)

ROOT = Path(__file__).resolve().parents[2]
TABLES = tomllib.loads((ROOT / "pyproject.toml").read_text("utf-8"))
PROJECT = TABLES["project"]
#: Modules that rendering and reading scenes import, of the packages that every install brings.
HARD = {"numpy": "numpy", "lxml": "lxml", "OpenEXR": "OpenEXR", "pillow": "PIL"}
OPTIONAL = sorted({*(name for names in extras.EXTRAS.values() for name in names), "rich", "embreex",
                   "mitsuba", "imageio", "networkx", "tifffile"})  # fmt: skip
#: A `sitecustomize` that hides packages.
HIDE = """
import sys
class Hidden:
    def find_spec(name, path=None, target=None):
        if name.partition(".")[0] in {names}:
            raise ModuleNotFoundError("No module named " + repr(name), name=name)
sys.meta_path.insert(0, Hidden)
"""
SMALL = "width=16, height=12, device='cpu'"


def required(lines: list[str]) -> set[str]:
    """The packages that requirements name, with those of the extras among them."""
    found: set[str] = set()
    for line in lines:
        name, more = re.match(r"([\w.-]+)(?:\[([^]]*)\])?", line).groups()  # type: ignore[union-attr]
        if name != "veriray":
            found.add(name)
            continue
        for extra in more.split(",") if more else ():
            found |= required(PROJECT["optional-dependencies"][extra])
    return found


@pytest.fixture
def bare(tmp_path: Path) -> dict[str, str]:
    """The environment of a process that finds none of the optional packages."""
    folder = tmp_path / "hiding"
    folder.mkdir()
    (folder / "sitecustomize.py").write_text(HIDE.format(names=set(OPTIONAL)))
    path = os.pathsep.join([str(folder), os.environ.get("PYTHONPATH", "")])
    return {**os.environ, "PYTHONPATH": path}


def run(code: str, environment: dict[str, str], folder: Path) -> subprocess.CompletedProcess[str]:
    return subprocess.run([sys.executable, "-c", f"import veriray as vr\n{code}"], cwd=folder,
                          env=environment, capture_output=True, text=True, timeout=300)  # fmt: skip


# ---- the lists ----


def test_extras_are_those_of_the_project() -> None:
    for extra, modules in extras.EXTRAS.items():
        names = {extras.PACKAGES.get(module, module) for module in modules}
        assert names == required([f"veriray[{extra}]"]), extra


def test_hard_dependencies() -> None:
    assert required(PROJECT["dependencies"]) == {*HARD}
    assert not required(["veriray[all]"]) & {*HARD}


def test_extras_are_documented() -> None:
    rows = re.findall(
        r"^\| `veriray\[(\w+)\]`", (ROOT / "docs/install.md").read_text("utf-8"), re.M
    )
    assert sorted(rows) == sorted(PROJECT["optional-dependencies"])


def test_workflows_name_every_python_and_pin_actions() -> None:
    lines = [line.rpartition(" ")[2] for line in PROJECT["classifiers"] if "Python :: 3." in line]
    pythons = ", ".join(f'"{name}"' for name in lines)
    for name in ("tests", "wheels"):
        assert f"python: [{pythons}]" in (ROOT / f".github/workflows/{name}.yml").read_text("utf-8")
    built = TABLES["tool"]["cibuildwheel"]["build"]
    assert built == " ".join(f"cp{name.replace('.', '')}-*" for name in lines)
    for path in sorted((ROOT / ".github/workflows").iterdir()):
        uses = re.findall(r"uses: (.*)", path.read_text("utf-8"))
        assert uses and all(re.fullmatch(r"[\w./-]+@v\d+\.\d+\.\d+", name) for name in uses), path


def test_citation_is_of_this_version() -> None:
    text = (ROOT / "CITATION.cff").read_text("utf-8")
    assert f"\nversion: {veriray.__version__}\n" in text
    assert f"\nlicense: {PROJECT['license']}\n" in text


# ---- what every install does ----


def test_rendering_needs_none_of_them(bare: dict[str, str], tmp_path: Path) -> None:
    code = f"""
import sys
from veriray.shipped import SHIPPED
for name in SHIPPED:
    picture = vr.render(vr.load_file(name), 2, {SMALL}, features=["depth"])
    picture.save("a.exr"), picture.save("a.png"), vr.Render.load("a.exr")
    vr.lint(vr.load_file(name))
found = {{name.partition(".")[0] for name in sys.modules}}
assert not found & {set(OPTIONAL)}, found
print(picture.film_sha256)
"""
    done = run(code, bare, tmp_path)
    assert done.returncode == 0, done.stderr
    other = run(code.replace("assert", "#"), {**os.environ}, tmp_path)
    assert len(done.stdout) == 65 and done.stdout == other.stdout


@pytest.mark.parametrize("arguments", [
    ["render", "cornell-box", "--width", "16", "--height", "12", "--spp", "2", "--device", "cpu",
     "-o", "a.exr", "-o", "a.png"],
    ["info", "cornell-box"], ["lint", "open"], ["gallery", "--list"],
], ids=lambda words: words[0])  # fmt: skip
def test_commands_that_need_none(
    bare: dict[str, str], tmp_path: Path, arguments: list[str]
) -> None:
    done = subprocess.run([sys.executable, "-m", "veriray", *arguments], cwd=tmp_path, env=bare,
                          capture_output=True, text=True, timeout=300)  # fmt: skip
    assert done.returncode in (0, 1) and "error" not in done.stderr, done.stderr


def test_scenes_of_every_kind_load(bare: dict[str, str], tmp_path: Path) -> None:
    """The scenes of the repository, but those with a distance field, which say what they need."""
    code = f"""
import warnings
from pathlib import Path
warnings.simplefilter("ignore")
count = 0
for path in sorted(Path({str(ROOT / "scenes")!r}).rglob("*.xml")):
    if "gallery" not in path.parts:  # they name meshes and maps that are generated
        try:
            vr.load_file(path)
            count += 1
        except vr.MissingPackageError as error:
            assert "sdfgrid" in path.read_text() and "veriray[formats]" in str(error), path
print(count)
"""
    done = run(code, bare, tmp_path)
    assert done.returncode == 0, done.stderr
    assert int(done.stdout) >= 30


def test_progress_without_rich_is_a_line(bare: dict[str, str], tmp_path: Path) -> None:
    code = f"""
import sys
class Terminal:
    def isatty(self): return True
    def write(self, text): sys.__stderr__.write(text)
    def flush(self): pass
sys.stderr = Terminal()
vr.render(vr.cornell_box(), 2, {SMALL}, progress=True)
from veriray.commands.common import show_progress
with show_progress("a title", False) as progress:
    assert progress is None
"""
    done = run(code, bare, tmp_path)
    assert done.returncode == 0, done.stderr
    assert "rendering 16 x 12" in done.stderr and "a title" in done.stderr


# ---- what says what to install ----

STL = "solid a\\nfacet normal 0 0 1\\nouter loop\\nvertex 0 0 0\\nvertex 1 0 0\\nvertex 0 1 0\\n"
STL += "endloop\\nendfacet\\nendsolid a\\n"
FEATURES = {
    "compare": ("a = vr.render(vr.cornell_box(), 2, " + SMALL + "); vr.compare(a, a)",
                "comparing pictures", "scipy, scikit-image and flip-evaluator"),
    "denoise": ("vr.render(vr.cornell_box(), 2, " + SMALL + ").denoised()", "denoising", "pyoidn"),
    "proof": ("import veriray_validate", "veriray validate", "colour-science"),
    "bench": ("import veriray_bench", "veriray bench", "matplotlib"),
    "formats": (f"open('a.stl', 'w').write('{STL}'); "
                "vr.load_dict({'type': 'scene', 'a': {'type': 'stl', 'filename': 'a.stl'}})",
                "an STL file of text", "trimesh"),
}  # fmt: skip


@pytest.mark.parametrize("extra", FEATURES)
def test_features_say_what_to_install(bare: dict[str, str], tmp_path: Path, extra: str) -> None:
    code, feature, package = FEATURES[extra]
    lines = ["try:", f"    {code}", "except vr.MissingPackageError as error:", "    print(error)"]
    done = run("\n".join(lines), bare, tmp_path)
    assert done.returncode == 0, done.stderr
    assert done.stdout.startswith(f"{feature} needs ") and package in done.stdout
    assert done.stdout.endswith(f"not installed: pip install 'veriray[{extra}]'\n")


def test_a_distance_field_says_what_to_install(bare: dict[str, str], tmp_path: Path) -> None:
    code = """
import numpy as np
grid = np.linspace(-1, 1, 27).reshape(3, 3, 3, 1)
vr.load_dict({"type": "scene", "a": {"type": "sdfgrid", "grid": grid}})
"""
    done = run(code, bare, tmp_path)
    assert "MissingPackageError: a distance field (sdfgrid) needs scikit-image" in done.stderr


@pytest.mark.parametrize(("extra", "arguments"), [
    ("compare", ["compare", "a.exr", "b.exr"]),
    ("proof", ["validate", "--quick"]),
    ("bench", ["bench", "all", "--quick"]),
    ("bench", ["bench", "matrix"]),
    ("bench", ["bench", "report", "nothing"]),
    ("bench", ["bench", "compaction", "cornell-box"]),
    ("bench", ["bench", "live-rays", "cornell-box"]),
    ("view", ["view", "cornell-box", "--port", "0"]),
    ("denoise", ["denoise", "a.exr", "b.exr"]),
    ("formats", ["gallery", "subsurface-1", "--mesh", "a.stl", "--width", "8"]),
], ids=lambda value: value if isinstance(value, str) else " ".join(value[:2]))  # fmt: skip
def test_commands_say_what_to_install(
    bare: dict[str, str], tmp_path: Path, extra: str, arguments: list[str]
) -> None:
    before = sorted(os.listdir(tmp_path))
    done = subprocess.run([sys.executable, "-m", "veriray", *arguments], cwd=tmp_path, env=bare,
                          capture_output=True, text=True, timeout=60)  # fmt: skip
    assert done.returncode == 2, done.stderr
    last = done.stderr.splitlines()[-1]
    assert last.startswith("veriray: error: ") and last.endswith(f"pip install 'veriray[{extra}]'")
    assert "Traceback" not in done.stderr and sorted(os.listdir(tmp_path)) == before


def test_one_package_and_several(monkeypatch: pytest.MonkeyPatch) -> None:
    for name in ("colour", "mpmath"):
        monkeypatch.setitem(sys.modules, name, None)  # type: ignore[misc]
    with pytest.raises(
        MissingPackageError, match=r"^it needs colour-science and mpmath, which are"
    ):
        extras.need("it", "proof", "numpy", "colour", "mpmath")
    with pytest.raises(MissingPackageError, match=r"needs mpmath, which is not installed: pip"):
        extras.need("it", "proof", "mpmath")
    extras.need("it", "proof", "numpy")
