"""How scenes, renders and reports are displayed: a line of text, and HTML that loads nothing."""

from __future__ import annotations

import base64
import io
import re
import shutil
import subprocess
import sys
import types
import zlib
from html.parser import HTMLParser
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import veriray as vr
from veriray import bars, showing
from veriray.saving import to_srgb8
from veriray_validate import Validation


class Tags(HTMLParser):
    """Fails if the tags do not nest."""

    def __init__(self, text: str) -> None:
        super().__init__()
        self.open: list[str] = []
        self.addresses: list[str] = []
        self.feed(text)
        assert not self.open

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        self.addresses += [value or "" for name, value in attrs if name in ("src", "href")]
        if tag not in ("img", "input"):
            self.open.append(tag)

    def handle_endtag(self, tag: str) -> None:
        assert self.open.pop() == tag


@pytest.fixture(scope="module")
def pair(cornell: vr.Scene) -> tuple[vr.Render, vr.Render]:
    a, b = (vr.render(cornell, 256, seed=k, batches=16, device="cpu") for k in (1, 2))
    return a, b


def test_texts_are_short(cornell: vr.Scene, pair: tuple[vr.Render, vr.Render]) -> None:
    assert repr(cornell) == "<Scene 32 x 32: 38 triangles, 4 materials, 1 lamp>"
    assert re.fullmatch(
        r"<Render 32 x 32, 256 spp, seed 1, 16 batches, mean stderr [\d.e-]+, [\d.e-]+ s, on "
        r"cpu:\w+>",
        repr(pair[0]),
    )
    assert repr(vr.compare(*pair)).startswith("<Report pass: The pictures agree")
    empty = Validation(full=False, seed=0, devices={"cpu": "a CPU"}, false_alarm=1e-3)
    assert repr(empty) == "<Validation inconclusive: 0 cases on cpu>"
    Tags(empty._repr_html_())


def test_repr_computes_no_image(cornell: vr.Scene) -> None:
    made = vr.render(cornell, 2, device="cpu")
    repr(made)
    assert "image" not in made.__dict__


def test_html_is_whole_and_needs_no_network(
    cornell: vr.Scene, pair: tuple[vr.Render, vr.Render]
) -> None:
    for shown in (cornell, pair[0], vr.compare(*pair), vr.lint(cornell)):
        page = shown._repr_html_()
        assert "http" not in page and "color:#" not in page and "background:#" not in page
        assert all(a.startswith("data:") for a in Tags(page).addresses)


def test_names_of_files_are_escaped() -> None:
    assert "<script>" not in showing.table(("<script>",), [("<script>\x1b",)], "<script>")


def test_two_pictures_have_two_names(pair: tuple[vr.Render, vr.Render]) -> None:
    names = {re.search(r'id="([^"]+)"', pair[0]._repr_html_())[1] for _ in range(2)}  # type: ignore[index]
    assert len(names) == 2


def test_radiance_in_bytes() -> None:
    """Within 1/256 of the largest channel, over all exponents; what is not finite is marked."""
    rng = np.random.default_rng(1)
    image = rng.random((40, 50, 3)) * 2.0 ** rng.integers(-100, 100, (40, 50, 1))
    image[0, 0] = (0, 0, 0)
    image[0, 1] = (1, 1, 1)
    image[0, 2] = (255 / 256, 0.5, np.nextafter(1, 0))
    found = showing.shared_exponent(image).astype(np.float64)
    values = found[..., :3] * 2.0 ** (found[..., 3:] - 136)
    assert (np.abs(values - image) <= image.max(axis=-1, keepdims=True) / 256).all()
    image[1, 1, 0], image[1, 2, 1], image[1, 3] = np.nan, np.inf, -1.0
    found = showing.shared_exponent(image)
    assert (found[1, 1:3, 3] == 255).all() and (found[1, 3, :3] == 0).all()


@pytest.mark.parametrize(("size", "most"), [((7, 5), 8), ((64, 33), 16), ((2, 999), 100)])
def test_smaller_pictures_keep_the_mean(size: tuple[int, int], most: int) -> None:
    assert max(showing.smaller(np.zeros((*size, 3)), most).shape) <= most
    even = showing.smaller(np.full((*size, 3), 0.7), most)
    assert np.allclose(even, 0.7)


@pytest.mark.skipif(shutil.which("node") is None, reason="no node to run the page's script")
def test_the_script_shows_what_python_does(pair: tuple[vr.Render, vr.Render]) -> None:
    """The page's script, run by node on a stub, gives the display copy up to rounded radiance."""
    page = pair[0]._repr_html_()
    script = page[page.rindex("<script>") + 8 : page.rindex("</script>")]
    data = re.search(r'octet-stream">([^<]*)<', page)[1]  # type: ignore[index]
    stub = """
    const pixels = {data: new Uint8ClampedArray(32 * 32 * 4)};
    const pen = {createImageData: () => pixels, putImageData: () => {}};
    const slider = {value: "STOPS", addEventListener: () => {}};
    const box = {querySelector: name => ({input: slider, output: {}, script: {textContent: DATA},
      img: {replaceWith: () => process.stdout.write(JSON.stringify([...pixels.data]))}})[name]};
    globalThis.document = {getElementById: () => box,
      createElement: () => ({style: {}, getContext: () => pen})};
    """
    for stops in (0.0, 3.0, -2.0):
        text = stub.replace("STOPS", str(stops)).replace("DATA", f'"{data}"') + script
        done = subprocess.run(["node", "-e", text], capture_output=True, text=True, timeout=60)
        assert done.returncode == 0, done.stderr
        shown = np.array(eval(done.stdout)).reshape(32, 32, 4)[..., :3].astype(int)
        error = pair[0].image.max(axis=-1, keepdims=True) / 256
        low, high = (to_srgb8(pair[0].image + s * error, stops).astype(int) for s in (-1, 1))
        assert ((shown >= low - 1) & (shown <= high + 1)).all()


def test_data_in_a_page_is_the_picture(pair: tuple[vr.Render, vr.Render]) -> None:
    data = re.search(r'octet-stream">([^<]*)<', pair[0]._repr_html_())[1]  # type: ignore[index]
    found = np.frombuffer(zlib.decompress(base64.b64decode(data)), np.uint8)
    assert np.array_equal(found.reshape(32, 32, 4), showing.shared_exponent(pair[0].image))


# ---- the bar ----


class Terminal(io.StringIO):
    def isatty(self) -> bool:
        return True


def test_a_bar_in_a_terminal(cornell: vr.Scene, monkeypatch: pytest.MonkeyPatch) -> None:
    file = Terminal()
    monkeypatch.setattr(sys, "stderr", file)
    monkeypatch.setenv("COLUMNS", "200")
    done = vr.render(cornell, 16, device="cpu", progress=True)
    assert "rendering 32 x 32" in file.getvalue() and "samples/s" in file.getvalue()
    assert f"mean standard error {done.stats['mean_stderr']:.3g}" in file.getvalue()


def test_lines_where_nothing_can_be_drawn(
    cornell: vr.Scene, capsys: pytest.CaptureFixture[str]
) -> None:
    plain = vr.render(cornell, 16, device="cpu", progress=False)
    assert capsys.readouterr().err == ""
    done = vr.render(cornell, 16, device="cpu", progress=True)
    first, last = capsys.readouterr().err.splitlines()
    assert first == "rendering 32 x 32" and last.startswith("16 spp in ") and "MiB" in last
    assert done.film_sha256 == plain.film_sha256


def test_a_bar_in_a_notebook(cornell: vr.Scene, monkeypatch: pytest.MonkeyPatch) -> None:
    shown: list[str] = []

    class Handle:
        def update(self, page: str) -> None:
            shown.append(page)

    def display(page: str, display_id: bool) -> Handle:
        shown.append(page)
        return Handle()

    core, displays = types.ModuleType("IPython"), types.ModuleType("IPython.display")
    core.get_ipython = lambda: types.SimpleNamespace(kernel=1)  # type: ignore[attr-defined]
    displays.HTML, displays.display = str, display  # type: ignore[attr-defined]
    monkeypatch.setitem(sys.modules, "IPython", core)
    monkeypatch.setitem(sys.modules, "IPython.display", displays)
    vr.render(cornell, 16, device="cpu", progress=True)
    Tags(shown[-1])
    assert 'value="1.0000"' in shown[-1] and "mean standard error" in shown[-1]


def test_what_a_bar_says(monkeypatch: pytest.MonkeyPatch) -> None:
    now = [0.0]
    monkeypatch.setattr(bars.time, "perf_counter", lambda: now[0])
    said: list[tuple[float, str]] = []
    bar = bars.Bar(1000, 400, lambda fraction, text: said.append((fraction, text)))
    bar(0.01)
    assert not said  # too early
    now[0] = 10.0
    bar(0.25)
    assert said[0][0] == 0.25
    assert said[0][1].startswith("100 of 400 spp, 10 ksamples/s, 30 s left, ")
    now[0] = 20.0
    bar(0.0)
    assert "unknown time left" in said[1][1]


@pytest.mark.parametrize(
    ("seconds", "text"),
    [(0.0123, "0.012 s"), (9.9, "9.9 s"), (42.4, "42 s"), (600, "10 min"), (7500, "2 h 5 min")],
)
def test_durations(seconds: float, text: str) -> None:
    assert bars.duration(seconds) == text


def test_an_error_closes_the_bar(cornell: vr.Scene, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(sys, "stderr", Terminal())

    def stop(*_: Any) -> None:
        raise KeyboardInterrupt

    monkeypatch.setattr(bars.Bar, "__call__", stop)
    with pytest.raises(KeyboardInterrupt):
        vr.render(cornell, 4096, device="cpu", progress=True)
    monkeypatch.undo()
    vr.render(cornell, 2, device="cpu", progress=True)


# ---- the notebooks ----


@pytest.mark.parametrize("name", ["first-picture", "prove-it"])
def test_notebooks_run(
    root: Path, name: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """In a kernel of their own; what their cells show is well formed."""
    reason = "notebooks need a kernel: pip install nbclient ipykernel"
    nbclient = pytest.importorskip("nbclient", reason=reason)
    pytest.importorskip("ipykernel", reason=reason)
    import nbformat

    for variable in ("IPYTHONDIR", "JUPYTER_RUNTIME_DIR", "JUPYTER_DATA_DIR"):
        monkeypatch.setenv(variable, str(tmp_path / "jupyter"))
    book = nbformat.read(root / "docs" / f"{name}.ipynb", as_version=4)
    nbformat.validate(book)
    cells = [cell for cell in book.cells if cell.cell_type == "code"]
    assert not any(cell.outputs for cell in cells)
    place = {"metadata": {"path": str(tmp_path)}}
    nbclient.NotebookClient(book, timeout=300, resources=place).execute()
    shown = [output.data for cell in cells for output in cell.outputs if "data" in output]
    pages = [data["text/html"] for data in shown if "text/html" in data]
    assert len(pages) >= 2
    for page in pages:
        Tags(page)
    bars = [output for cell in cells for output in cell.outputs
            if output.output_type == "display_data"]  # fmt: skip
    assert len(bars) == (name == "first-picture")  # one, drawn anew
