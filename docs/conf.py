"""Sphinx makes the documentation site from `docs/`: `make docs`.

The pages are the Markdown files of this folder as they stand. `index.md` gives the order: its
sections and the pages that they link to are the navigation; a page that it does not name stands
under "More". Pages of other folders and those that are made from the program (the scene reference
with its pictures, the API) are written to `docs/generated/` at each build.
"""

from __future__ import annotations

import re
import sys
from pathlib import Path
from typing import Any

DOCS = Path(__file__).resolve().parent
ROOT = DOCS.parent
sys.path.insert(0, str(DOCS))

import scene_reference  # noqa: E402

import veriray  # noqa: E402

project = "veriray"
author = "the veriray authors"
version = release = veriray.__version__
extensions = ["myst_parser", "sphinx.ext.autodoc", "sphinx.ext.napoleon"]
root_doc = "index"
source_suffix = {".md": "markdown", ".rst": "restructuredtext"}
exclude_patterns = ["generated/README.md"]
default_role = "code"
nitpicky = False
myst_heading_anchors = 4
autodoc_typehints = "none"
autodoc_member_order = "groupwise"
napoleon_google_docstring = True
napoleon_use_rtype = False
html_theme = "furo"
html_title = "veriray"
html_static_path: list[str] = []
html_copy_source = False
html_show_sphinx = False
pygments_style = "friendly"
pygments_dark_style = "monokai"

#: Files of other folders that are pages of the site -> their page.
ELSEWHERE = {
    "cpp/README.md": "generated/architecture.md",
    "CONTRIBUTING.md": "generated/contributing.md",
    "CHANGELOG.md": "generated/changelog.md",
    "benchmarks/README.md": "generated/benchmarks.md",
    "scenes/checks/README.md": "generated/check-scenes.md",
    "scenes/cornell/README.md": "generated/cornell-data.md",
}
_LINK = re.compile(r"\]\(([^)#\s:]+)(#[^)\s]*)?\)")


def relinked(text: str, folder: Path, page: Path) -> str:
    """Markdown of a file in `folder`, with the links as they must be on the page `page`."""

    def link(match: re.Match[str]) -> str:
        target = (folder / match[1]).resolve()
        inside = target.relative_to(ROOT).as_posix() if target.is_relative_to(ROOT) else ""
        if inside in ELSEWHERE:
            target = DOCS / ELSEWHERE[inside]
        up = "../" * len(page.relative_to(DOCS).parent.parts)
        if target.is_relative_to(DOCS):
            new = up + target.relative_to(DOCS).as_posix()
        elif target.is_file():
            new = up + "../" + inside
        else:
            return match[0]
        return f"]({new}{match[2] or ''})"

    return _LINK.sub(link, text)


def sections() -> list[tuple[str, list[str]]]:
    """(caption, pages) of the navigation: what `index.md` links to, and "More" for the rest."""
    found: list[tuple[str, list[str]]] = []
    for line in (DOCS / "index.md").read_text("utf-8").splitlines():
        if line.startswith("## "):
            found.append((line[3:], []))
        elif found and (match := re.match(r"- \[[^\]]*\]\(([^)#]+\.md)\)", line)):
            page = match[1]
            if page.startswith("../"):
                page = ELSEWHERE[page[3:]]
            found[-1][1].append(page.removesuffix(".md"))
    named = {page for _, pages in found for page in pages} | {"index"}
    there = [p.relative_to(DOCS).with_suffix("").as_posix() for p in sorted(DOCS.rglob("*.md"))]
    return [*found, ("More", [page for page in there if page not in named])]


def make_pages(app: Any) -> None:
    """Write `docs/generated/`."""
    folder = DOCS / "generated"
    folder.mkdir(exist_ok=True)
    for file, page in ELSEWHERE.items():
        text = (ROOT / file).read_text("utf-8")
        write(DOCS / page, relinked(text, (ROOT / file).parent, DOCS / page))
    write(folder / "api.md", scene_reference.api_page())
    for name, text in scene_reference.pages(folder).items():
        write(folder / name, text)


def write(path: Path, text: str) -> None:
    """Write a page, if it is another than the one that is there."""
    if not path.exists() or path.read_text("utf-8") != text:
        path.write_text(text, "utf-8")


def read(app: Any, name: str, source: list[str]) -> None:
    """Links to files of other folders; the navigation of the index."""
    page = DOCS / f"{name}.md"
    if page.exists() and not name.startswith("generated/"):
        source[0] = relinked(source[0], page.parent, page)
    if name == "index":
        for caption, pages in sections():
            if pages:
                head = f"\n```{{toctree}}\n:hidden:\n:caption: {caption}\n\n"
                source[0] += head + "\n".join(pages) + "\n```\n"


def setup(app: Any) -> None:
    """Sphinx calls this."""
    app.connect("builder-inited", make_pages)
    app.connect("source-read", read)
