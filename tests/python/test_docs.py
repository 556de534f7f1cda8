"""The documentation: links lead somewhere, code runs, every parameter of a scene is described."""

from __future__ import annotations

import importlib.util
import re
import shlex
import shutil
import sys
import urllib.parse
from pathlib import Path
from types import ModuleType
from typing import Any

import numpy as np
import pytest
from PIL import Image

import veriray as vr
from veriray import cli

ROOT = Path(__file__).resolve().parents[2]
PAGES = [ROOT / "README.md", ROOT / "CONTRIBUTING.md", *sorted((ROOT / "docs").glob("*.md")),
         ROOT / "cpp/README.md", *sorted((ROOT / "benchmarks").glob("*.md"))]  # fmt: skip
#: All that has links.
LINKED = [*PAGES, ROOT / "CHANGELOG.md", *sorted((ROOT / "docs").glob("*.ipynb")),
          *sorted((ROOT / "scenes").rglob("*.md"))]  # fmt: skip
#: Written by `make docs`.
MADE = ("generated/scene-reference.md", "generated/api.md")


def code(page: Path, language: str) -> list[str]:
    return re.findall(rf"^```{language}\n(.*?)^```", page.read_text("utf-8"), re.M | re.S)


def prose(page: Path) -> str:
    return re.sub(r"^```.*?^```|`[^`\n]*`", "", page.read_text("utf-8"), flags=re.M | re.S)


def anchors(page: Path) -> set[str]:
    """As GitHub and MyST name the headings of a page."""
    text = re.sub(r"^```.*?^```", "", page.read_text("utf-8"), flags=re.M | re.S)
    titles = re.findall(r"^#+ (.*)$", text, re.M)
    return {re.sub(r"[^\w\- ]", "", t.lower()).strip().replace(" ", "-") for t in titles}


@pytest.mark.parametrize("page", LINKED, ids=lambda page: str(page.relative_to(ROOT)))
def test_links_lead_somewhere(page: Path) -> None:
    wrong = []
    for link in re.findall(r"\]\(([^)\s]+)\)", prose(page)):
        file, _, anchor = link.partition("#")
        if ":" in file or file in MADE:
            continue
        target = (page.parent / file).resolve() if file else page
        if not target.exists() or (anchor and anchor not in anchors(target)):
            wrong.append(link)
    assert not wrong


@pytest.mark.parametrize("page", LINKED, ids=lambda page: str(page.relative_to(ROOT)))
def test_addresses_are_well_formed(page: Path) -> None:
    """Other sites are not asked: the forms of their addresses are checked."""
    text = page.read_text("utf-8")
    links = re.findall(r"\]\((\w+:[^)\s]*)\)", prose(page))
    for address in [*links, *re.findall(r"\bhttps?://[^\s)>\"'`\\]*", text)]:
        parts = urllib.parse.urlsplit(address)
        if parts.hostname == "127.0.0.1":  # the viewer's
            continue
        assert parts.scheme == "https" and parts.port is None, address
        assert re.fullmatch(r"([a-z0-9-]+\.)+[a-z]{2,}", parts.netloc), address
        assert re.fullmatch(r"(/[\w.~%-]+)*/?", parts.path), address
        assert address[-1] not in ".,;:", address


def name_of(page: Path) -> str:
    return str(page.relative_to(ROOT))


@pytest.mark.parametrize("name", [name_of(page) for page in PAGES if code(page, "python")])
def test_code_runs(name: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """The Python of a page, block after block, with small pictures of few samples."""
    scene, render = vr.cornell_box(), vr.render

    def small(scene: vr.Scene, spp: int = 16, **settings: Any) -> Any:
        settings |= {"width": 16, "height": 12, "device": "cpu"}
        return render(scene, min(spp, 64), **settings)

    monkeypatch.chdir(tmp_path)
    if name != "docs/stop-and-go-on.md":  # which compares with an Accumulation of its size
        monkeypatch.setattr(vr, "render", small)
    if name == "docs/python.md":
        for k in range(32):
            small(scene, 4, seed=k).save(f"mitsuba-{k}.exr")
        made = vr.dataset(scene, "given", width=8, height=8, spp=1, device="cpu")
        shutil.copy(made[-1], "transforms.json")
    blocks = code(ROOT / name, "python")
    assert blocks
    values: dict[str, Any] = {"__name__": "page"}
    for block in blocks:
        exec(compile(block, name, "exec"), values)


def commands(page: Path, program: str) -> list[list[str]]:
    """Arguments of the program in the page's blocks for a shell, but for scripts with variables."""
    blocks = [block.replace("\\\n", " ") for block in code(page, "sh")]
    lines = [line for block in blocks for line in block.splitlines() if "$" not in line]
    words = [shlex.split(line, comments=True) for line in lines]
    return [found[1:] for found in words if found and Path(found[0]).name == program]


#: A synopsis, not commands.
SYNOPSIS = ROOT / "docs/commands.md"
SHELL = [page for page in PAGES if page != SYNOPSIS and code(page, "sh")]


@pytest.mark.parametrize("page", SHELL, ids=name_of)
def test_commands_are_understood(page: Path) -> None:
    for words in commands(page, "veriray"):
        cli._parser().parse_args(words)
    for words in commands(page, "python") + commands(page, "bash"):
        assert words[0].startswith("benchmarks/") and (ROOT / words[0]).is_file()


@pytest.mark.parametrize(
    "name", ["README.md", "docs/tutorial.md", "docs/stop-and-go-on.md", "docs/clusters.md"]
)
def test_commands_run(name: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Renders and merges, of small pictures, one after another."""
    monkeypatch.chdir(tmp_path)
    shutil.copy(Path(vr.__file__).parent / "scenes" / "open.xml", "scene.xml")
    ran = 0
    for words in commands(ROOT / name, "veriray"):
        if words[0] not in ("render", "merge") or {"--cluster", "part-*.film"} & {*words}:
            continue  # tests/python/test_cluster.py, test_farm.py
        if words[0] == "render":
            words += ["--width", "8", "--height", "6", "--device", "cpu", "--quiet"]
        assert cli.main(words) == 0, words
        ran += 1
    assert ran


@pytest.fixture(scope="module")
def reference() -> Any:
    """The module that makes the scene reference."""
    folder = ROOT / "docs"
    sys.path.insert(0, str(folder))
    try:
        spec = importlib.util.spec_from_file_location(
            "scene_reference", folder / "scene_reference.py"
        )
        assert spec and spec.loader
        module: ModuleType = importlib.util.module_from_spec(spec)
        spec.loader.exec_module(module)
        yield module
    finally:
        sys.path.remove(str(folder))


def test_every_parameter_is_described(reference: Any) -> None:
    assert not reference.undescribed()


def test_pictures_of_parameters_differ(reference: Any, tmp_path: Path) -> None:
    """Of each stage a strip, whose pictures are not all alike."""
    looks = {look.base: look for look in reference.LOOKS.values() if len(look.values) > 1}
    assert len(looks) > 5
    for look in looks.values():
        file = tmp_path / f"{look.base}.png"
        reference.draw(look, file)
        strip = np.asarray(Image.open(file))
        tiles = np.array_split(strip, len(look.values), axis=1)
        assert len({tile[:, :40].tobytes() for tile in tiles}) > 1, look.base
