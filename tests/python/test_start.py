"""What a new process imports, in every order, and the thread that starts CUDA."""

from __future__ import annotations

import ast
import json
import pkgutil
import subprocess
import sys
import threading
from importlib import import_module
from pathlib import Path
from types import SimpleNamespace

import pytest

import veriray
from veriray import __main__ as command
from veriray import cli
from veriray import device as device_module

RENDER = ["render", "cornell-box", "--quiet", "--width", "16", "--height", "16", "--spp", "2"]
HEAVY = {"OpenEXR", "PIL", "colour", "jinja2", "lxml", "matplotlib", "numpy", "rich", "scipy",
         "skimage", "trimesh", "typing"}  # fmt: skip


def loaded(code: str) -> set[str]:
    """Modules that a new process has loaded after `code`."""
    script = f"import json, sys\n{code}\nprint(json.dumps(list(sys.modules)))"
    done = subprocess.run([sys.executable, "-c", script], capture_output=True, text=True)
    assert done.returncode == 0, done.stderr
    return set(json.loads(done.stdout.splitlines()[-1]))


# ---- names ----


def test_public_names_are_those_of_their_modules() -> None:
    homes = {module: tuple(names) for module, names in veriray._HOMES.items()}
    assert sorted(["__version__", *(n for names in homes.values() for n in names)]) == sorted(
        veriray.__all__
    )
    for module, names in homes.items():
        for name in names:
            assert getattr(veriray, name) is getattr(import_module(f"veriray.{module}"), name)
    assert set(veriray.__all__) <= set(dir(veriray))


def test_type_checkers_see_the_same_names() -> None:
    tree = ast.parse(Path(veriray.__file__).read_text("utf-8"))
    seen = {
        node.module: tuple(alias.name for alias in node.names)
        for node in ast.walk(tree)
        if isinstance(node, ast.ImportFrom) and node.level == 1
    }
    assert seen == veriray._HOMES


def test_no_module_bears_a_public_name() -> None:
    modules = {module.name for module in pkgutil.iter_modules(veriray.__path__)}
    assert "rendering" in modules and not modules & set(veriray.__all__)


def test_unknown_name() -> None:
    with pytest.raises(AttributeError, match="module 'veriray' has no attribute 'ghost'"):
        veriray.ghost  # noqa: B018
    with pytest.raises(ImportError, match="ghost"):
        from veriray import ghost  # noqa: F401


@pytest.mark.parametrize(
    "before",
    [
        "",
        "import veriray.comparison.report",
        "import veriray.comparison, veriray.rendering, veriray.image",
        "import veriray.rendering; from veriray import comparison",
        "import veriray.commands.compare, veriray.commands.render",
        "from veriray import *",
    ],
)
def test_functions_win_in_every_order(before: str) -> None:
    loaded(
        f"{before}\n"
        "import veriray\n"
        "from veriray import compare, render\n"
        "assert veriray.compare is compare and compare.__module__ == 'veriray.comparison'\n"
        "assert veriray.render is render and render.__module__ == 'veriray.rendering'\n"
    )


# ---- what is loaded ----


def test_import_loads_nothing_else() -> None:
    new = loaded("import veriray") - loaded("import importlib")
    assert new == {"veriray"}


def test_command_line_is_read_without_a_renderer() -> None:
    new = loaded("import veriray.cli; veriray.cli._parser().parse_args(['info', 'open'])")
    assert not new & (HEAVY - {"typing"})
    assert not new & {"veriray.scene", "veriray.rendering", "veriray.device"}


def test_render_loads_what_it_needs(tmp_path: Path) -> None:
    words = [*RENDER, "--device", "cpu", "-o", str(tmp_path / "a.exr")]
    new = loaded(f"sys.argv[1:] = {words!r}\nfrom veriray.__main__ import main\nassert main() == 0")
    assert new & HEAVY == {"OpenEXR", "lxml", "numpy", "typing"}
    assert len([name for name in new if name.startswith("veriray._c")]) == 1
    assert not new & {"veriray.comparison", "veriray.html"}
    assert not [name for name in new if name.startswith(("veriray_bench", "veriray_validate"))]


# ---- the thread ----


@pytest.mark.parametrize(
    "words, expected",
    [
        ("", True),
        ("--device auto", True),
        ("--device cuda", True),
        ("--device=cuda:1", True),
        ("--dev cuda", True),
        ("--device cpu --device cuda", True),
        ("--device cuda --device cpu", False),
        ("--device cpu", False),
        ("--device=cpu:avx2", False),
        ("--dev=cpu", False),
        ("--de cpu", False),
        ("--pixel 3 4", False),
    ],
)
def test_device_of_the_command_line(words: str, expected: bool) -> None:
    line = ["render", "open", "-o", "a.exr", *words.split()]
    arguments = cli._parser().parse_args(line)
    wanted = arguments.device.startswith(("auto", "cuda")) and arguments.pixel is None
    assert command.may_use_cuda(line) is wanted is expected


@pytest.mark.parametrize(
    "line", ["", "info open", "render --help", "render -h", "render open --device", "doctor"]
)
def test_lines_that_do_not_render_start_nothing(line: str) -> None:
    assert not command.may_use_cuda(line.split())


def test_cuda_that_fails_on_the_thread(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    """The same picture and the same words as without the thread."""
    asked = []

    def status() -> tuple[bool, str]:
        asked.append(threading.current_thread())
        if asked[-1] is not threading.main_thread():
            raise RuntimeError("lost on the thread")
        return False, "no such luck"

    monkeypatch.setitem(sys.modules, "veriray._cuda", SimpleNamespace(status=status))  # type: ignore[misc]
    monkeypatch.setattr(device_module, "_cuda_process", None)
    monkeypatch.setattr(command.gc, "freeze", lambda: None)
    outcome = []
    for words in (["--device", "auto"], ["--device", "cuda"]):
        line = [*RENDER[:2], *RENDER[3:], *words, "-o", str(tmp_path / "a.exr")]
        monkeypatch.setattr(sys, "argv", ["veriray", *line])
        for run in (lambda line=line: cli.main(line), command.main):
            status_of_command = run()
            for thread in {*asked} - {threading.main_thread()}:
                thread.join()
            out, err = capsys.readouterr()
            outcome.append((status_of_command, out[out.find("SHA-256") :], err))
    assert sum(thread is not threading.main_thread() for thread in asked) == 2
    assert outcome[0] == outcome[1] and outcome[0][0] == 0 and outcome[0][1]
    assert outcome[2] == outcome[3]
    assert outcome[2][0] == 2 and "CUDA cannot be used: no such luck" in outcome[2][2]


def test_without_a_cuda_module_no_thread_starts(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "veriray._cuda", None)  # type: ignore[arg-type]
    monkeypatch.setattr(threading, "Thread", None)
    command.start_cuda()
