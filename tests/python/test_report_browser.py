"""The reports' pages in Chromium: swipe, flicker, zoom, read-out; widths, colours, no network."""

from __future__ import annotations

import dataclasses
import json
import re
import time
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import veriray as vr
from tests.browser import CHROMIUM, Page, browser
from veriray.comparison import Report, pictures
from veriray.comparison.metrics import display_scale
from veriray.image import to_srgb8
from veriray_bench import report as bench_report
from veriray_validate import report as validate_report
from veriray_validate.run import Validation
from veriray_validate.trial import Outcome

pytestmark = pytest.mark.skipif(CHROMIUM is None, reason="there is no chromium on PATH")
ROOT = Path(__file__).resolve().parents[2]
WIDTH, HEIGHT = 60, 40
STAGE, BOX = "[data-panel=a] canvas", "document.querySelector('#pictures').dataset"


@pytest.fixture(scope="module")
def page(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Page]:
    with browser(tmp_path_factory.mktemp("downloads")) as opened:
        yield opened
        assert opened.errors == []


@pytest.fixture(scope="module")
def compared() -> Report:
    scene = vr.cornell_box()
    shape = {"width": WIDTH, "height": HEIGHT, "spp": 32, "batches": 16, "device": "cpu"}
    a, b = (vr.render(scene, seed=seed, **shape) for seed in (1, 2))
    return vr.compare(a, dataclasses.replace(b, image=b.image * np.float32(0.7)))


@pytest.fixture(scope="module")
def pages(compared: Report, tmp_path_factory: pytest.TempPathFactory) -> dict[str, Path]:
    folder = tmp_path_factory.mktemp("pages")
    names = {name: folder / f"{name}.html" for name in ("compare", "bench", "validate")}
    compared.save(names["compare"])
    results = ROOT / "benchmarks/results"
    stored = json.loads((results / "bench_cpu.json").read_text("utf-8"))
    kept = ("cornell", "cornell-error", "depth-open")
    stored["scenarios"] = {k: v for k, v in stored["scenarios"].items() if k in kept}
    (folder / "bench_cpu.json").write_text(json.dumps(stored))
    bench_report.save(bench_report.find([folder]), names["bench"])
    stored = json.loads((results / "validate_quick_cpu.json").read_text("utf-8"))
    outcomes = [Outcome(**case) for case in stored["cases"]][::40]
    outcomes[1] = dataclasses.replace(outcomes[1], verdict="fail", message="planted " + "x" * 200)
    validation = Validation(False, 1, stored["devices"], 1e-4, outcomes, 9.0, stored["facts"])
    validate_report.save(validation, names["validate"])
    return names


def opened(page: Page, path: Path, width: int = 1000, mode: str = "light") -> None:
    feature = {"name": "prefers-color-scheme", "value": mode}
    page.call("Emulation.setEmulatedMedia", features=[feature])
    page.resize(width, 900)
    page.open(path.as_uri())
    page.wait("document.readyState === 'complete' && document.title.startsWith('veriray')")
    if path.stem == "compare":
        page.wait(f"{BOX}.ready === 'true'")
        page.value("document.querySelector('#pictures').scrollIntoView()")
        settle(page)


def settle(page: Page) -> None:
    """Until what was asked for is drawn."""
    page.value("new Promise(f => requestAnimationFrame(() => requestAnimationFrame(() => f(1))))")


def spot(page: Page, x: float, y: float, selector: str = STAGE) -> tuple[float, float]:
    """The place on the screen of a place of the fitted picture, in pixels."""
    box = page.value("(({x, y, width, height}) => [x, y, width, height])"
                     f"(document.querySelector({selector!r}).getBoundingClientRect())")  # fmt: skip
    return box[0] + x / WIDTH * box[2], box[1] + y / HEIGHT * box[3]


def colour(page: Page, u: float, v: float, selector: str = STAGE) -> Any:
    """The drawn colour at a place of a canvas, in fractions of it."""
    settle(page)
    return np.array(page.value(
        f"(c => [...c.getContext('2d').getImageData({u} * c.width, {v} * c.height, 1, 1).data]"
        f".slice(0, 3))(document.querySelector({selector!r}))"
    ))  # fmt: skip


def expected(picture: Any, reference: Any, x: int, y: int) -> Any:
    return to_srgb8(np.asarray(picture, float) * display_scale(reference))[y, x].astype(int)


def choose(page: Page, what: str) -> None:
    page.value(f"document.querySelector('button[data-{what}]').click()")
    settle(page)


def text(page: Page, row: str) -> list[str]:
    found = page.value(f"[...document.querySelectorAll('[data-row={row}] td')]"
                       ".map(e => e.textContent)")  # fmt: skip
    return [cell.replace("\u2212", "-") for cell in found]


def key(page: Page, name: str, **more: Any) -> None:
    for kind in ("keyDown", "keyUp"):
        page.call("Input.dispatchKeyEvent", type=kind, key=name, **more)


def test_swipe(page: Page, pages: dict[str, Path], compared: Report) -> None:
    opened(page, pages["compare"])
    a, b = compared.maps.a, compared.maps.b
    left, right = (10.5 / WIDTH, 20.5 / HEIGHT), (50.5 / WIDTH, 20.5 / HEIGHT)
    assert (np.abs(expected(a, b, 10, 20) - expected(b, b, 10, 20)) > 2).any()  # can be told apart
    assert np.abs(colour(page, *left) - expected(a, b, 10, 20)).max() <= 1
    assert np.abs(colour(page, *right) - expected(b, b, 50, 20)).max() <= 1
    page.drag(spot(page, WIDTH / 2, 20), spot(page, 6, 20))
    assert float(page.value(f"{BOX}.split")) == pytest.approx(0.1, abs=0.01)
    assert np.abs(colour(page, *left) - expected(b, b, 10, 20)).max() <= 1
    page.drag(spot(page, 6, 20), spot(page, 58, 20))
    assert np.abs(colour(page, *right) - expected(a, b, 50, 20)).max() <= 1
    assert page.value(f"{BOX}.zoom ?? '1'") == "1"  # the line moved, not the picture


def test_flicker(page: Page, pages: dict[str, Path], compared: Report) -> None:
    opened(page, pages["compare"])
    page.value("window.delays = []; window.timer = setInterval; window.setInterval = (f, ms) => "
               "{ delays.push(ms); return timer(f, ms); }; 0")  # fmt: skip
    choose(page, "mode=flicker")
    assert page.value("delays") == [500]  # below three flashes a second
    at, seen = (10.5 / WIDTH, 20.5 / HEIGHT), []
    for side in "abab":
        page.wait(f"document.querySelector('{STAGE}').dataset.side === '{side}'")
        seen.append(colour(page, *at))
    for shown, picture in zip(seen, (compared.maps.a, compared.maps.b) * 2, strict=True):
        assert np.abs(shown - expected(picture, compared.maps.b, 10, 20)).max() <= 1
    choose(page, "mode=a")
    for _ in range(8):  # and it stops
        assert page.value(f"document.querySelector('{STAGE}').dataset.side") == "a"
        time.sleep(0.1)


def test_zoom_and_pan_of_all_pictures(page: Page, pages: dict[str, Path],
                                      compared: Report) -> None:  # fmt: skip
    opened(page, pages["compare"])
    choose(page, "mode=both")
    choose(page, 'zoom="2"')
    choose(page, 'zoom="2"')
    b = compared.maps.b
    # the picture's middle stays; the canvas shows 15 x 10 pixels, from (22.5, 15) on
    for name, picture in (("a", compared.maps.a), ("b", b)):
        selector = f"[data-panel={name}] canvas"
        for x, y in ((24, 17), (33, 22)):
            want = expected(picture, b, x, y)
            for within in (0.1, 0.5, 0.9):  # one colour all over the pixel: nearest neighbour
                u, v = (x + within - 22.5) / 15, (y + within - 15) / 10
                assert np.abs(colour(page, u, v, selector) - want).max() <= 1, (name, x, y)
    # a drag moves all of them
    page.drag(spot(page, 30, 20), spot(page, 34, 20))
    u, v = (22.5 - 21.5) / 15, (17.5 - 15) / 10
    for name, picture in (("a", compared.maps.a), ("b", b)):
        found = colour(page, u, v, f"[data-panel={name}] canvas")
        assert np.abs(found - expected(picture, b, 22, 17)).max() <= 1
    choose(page, 'zoom="0"')
    assert page.value(f"{BOX}.zoom") == "1"
    # the wheel scrolls the page, unless a picture was clicked
    page.value("document.activeElement.blur()")
    x, y = spot(page, 15, 10)
    wheel = {"type": "mouseWheel", "x": x, "y": y, "deltaX": 0, "deltaY": -240}
    page.call("Input.dispatchMouseEvent", **wheel)
    settle(page)
    assert page.value(f"{BOX}.zoom") == "1"
    page.value("document.querySelector('#pictures').scrollIntoView()")
    page.drag((x, y), (x, y), steps=1)
    page.call("Input.dispatchMouseEvent", **wheel)
    page.wait(f"Math.abs({BOX}.zoom - 2) < 1e-6", 5)


def test_read_out(page: Page, pages: dict[str, Path], compared: Report) -> None:
    opened(page, pages["compare"])
    maps = compared.maps
    assert maps.stderr_a is not None and maps.stderr_b is not None
    worst = pictures.packed(maps).stderr_error
    rng = np.random.default_rng(3)
    for x, y in [(0, 0), (WIDTH - 1, HEIGHT - 1), *rng.integers(0, (WIDTH, HEIGHT), (25, 2))]:
        page.mouse("mouseMoved", *spot(page, x + 0.5, y + 0.5), button="none")
        assert page.value(f"{BOX}.at") == f"{x} {y}"
        reads = {}
        for row, value, error in (("a", maps.a, maps.stderr_a), ("b", maps.b, maps.stderr_b)):
            cells = [[float(w) for w in re.split(" \u00b1 ", c)] for c in text(page, row)]
            found, e = np.array(cells).T
            reads[row] = found
            limit = pictures.VALUE_ERROR * np.abs(value[y, x]).max()
            # five digits are shown of a value, two of an error
            assert (np.abs(found - value[y, x]) <= limit + 6e-5 * np.abs(found)).all()
            assert np.abs(e / error[y, x] - 1).max() <= worst + 0.06
        cells = [[float(w) for w in re.split(" \u00b1 ", c)] for c in text(page, "d")]
        found, e = np.array(cells).T
        d = maps.a[y, x].astype(float) - maps.b[y, x]
        both = np.hypot(maps.stderr_a[y, x], maps.stderr_b[y, x])
        limit = pictures.VALUE_ERROR * (np.abs(maps.a[y, x]).max() + np.abs(maps.b[y, x]).max())
        assert (np.abs(found - d) <= limit + 6e-3 * np.abs(d)).all()
        assert np.abs(e / both - 1).max() <= worst + 0.06
        z = np.array([float(c) for c in text(page, "z")])
        assert np.abs(z - d / both).max() <= 0.05 + (worst + 0.001) * np.abs(z).max() + 0.05


def test_invalid_pixels(page: Page, compared: Report, tmp_path: Path) -> None:
    maps, image = compared.maps, compared.maps.b.copy()
    image[3, 5, 1] = np.nan
    broken = dataclasses.replace(compared, maps=dataclasses.replace(maps, b=image))
    broken.save(tmp_path / "compare.html")
    opened(page, tmp_path / "compare.html")
    choose(page, "mode=b")
    assert colour(page, 5.5 / WIDTH, 3.5 / HEIGHT).tolist() == [255, 0, 255]
    page.mouse("mouseMoved", *spot(page, 5.5, 3.5), button="none")
    assert text(page, "b")[1].startswith("not a number") and text(page, "z")[1] == "\u2013"
    assert not text(page, "a")[1].startswith("not a number")


def test_keys_and_exposure(page: Page, pages: dict[str, Path], compared: Report) -> None:
    opened(page, pages["compare"])
    page.value(f"document.querySelector('{STAGE}').focus()")
    key(page, "ArrowRight")
    assert page.value(f"{BOX}.at") == f"{WIDTH // 2 + 1} {HEIGHT // 2}"
    key(page, "ArrowUp", modifiers=8)  # shift
    assert page.value(f"{BOX}.at") == f"{WIDTH // 2 + 1} {HEIGHT // 2 - 10}"
    key(page, "+")
    assert page.value(f"{BOX}.zoom") == "2"
    for _ in range(WIDTH):  # it stops at the edge, which comes into sight
        key(page, "ArrowRight")
    assert page.value(f"{BOX}.at") == f"{WIDTH - 1} {HEIGHT // 2 - 10}"
    assert page.value("document.querySelector('[data-where]').textContent") == "59, 10"
    key(page, "0")
    assert page.value(f"{BOX}.zoom") == "1"
    for name, mode in (("f", "flicker"), ("s", "swipe"), (" ", "a"), (" ", "b"), (",", "swipe")):
        key(page, name)
        assert page.value(f"{BOX}.view") == mode
    assert float(page.value(f"{BOX}.split")) == pytest.approx(0.48)
    # each control can be reached with the tab key
    controls = "'button, input, figure:not([hidden]) canvas'"
    assert page.value(f"[...document.querySelector('#pictures').querySelectorAll({controls})]"
                      ".every(e => e.tabIndex === 0)")  # fmt: skip
    choose(page, "mode=a")
    page.value("(e => { e.value = 1.5; e.dispatchEvent(new Event('input')); })"
               "(document.querySelector('input[type=range]'))")  # fmt: skip
    bright = np.asarray(compared.maps.a, float) * 2**1.5
    found = colour(page, 10.5 / WIDTH, 20.5 / HEIGHT)
    assert np.abs(found - expected(bright, compared.maps.b, 10, 20)).max() <= 1


# ---- all three pages ----

#: Text whose contrast with what is behind it fails WCAG AA (4.5, or 3 for large or bold text).
FAINT = """
(() => {
  const parse = (c) => [...c.match(/[\\d.]+/g).map(Number), 1].slice(0, 4);
  const light = ([r, g, b]) => [r, g, b].map(v => v / 255)
    .map(v => v <= 0.04045 ? v / 12.92 : ((v + 0.055) / 1.055) ** 2.4)
    .reduce((s, v, k) => s + v * [0.2126, 0.7152, 0.0722][k], 0);
  const behind = (e) => {
    for (; e; e = e.parentElement) {
      const c = parse(getComputedStyle(e).backgroundColor);
      if (c[3] === 1) return c;
    }
    return [255, 255, 255, 1];
  };
  const found = [];
  for (const e of document.querySelectorAll("body, body *")) {
    if (![...e.childNodes].some(n => n.nodeType === 3 && n.data.trim())) continue;
    if (e.tagName === "SCRIPT" || !e.checkVisibility()) continue;
    const style = getComputedStyle(e), size = parseFloat(style.fontSize);
    const [a, b] = [light(parse(style.color)), light(behind(e))].sort((p, q) => q - p);
    const large = size >= 24 || (size >= 18.66 && style.fontWeight >= 700);
    if ((a + 0.05) / (b + 0.05) < (large ? 3 : 4.5)) found.push(e.outerHTML.slice(0, 120));
  }
  return found;
})()
"""


@pytest.mark.parametrize("name", ["compare", "bench", "validate"])
@pytest.mark.parametrize("mode", ["light", "dark"])
def test_contrast_and_widths(page: Page, pages: dict[str, Path], name: str, mode: str) -> None:
    for width in (420, 1400):
        opened(page, pages[name], width, mode)
        assert page.value("document.documentElement.scrollWidth") <= width
        out = page.value("[...document.querySelectorAll('body *')]"
                         ".filter(e => !e.closest('.scroll'))"
                         ".filter(e => e.getBoundingClientRect().right > innerWidth + 1)"
                         ".map(e => e.outerHTML.slice(0, 80))")  # fmt: skip
        assert out == []
    assert page.value(FAINT) == []
    ground = page.value("getComputedStyle(document.body).backgroundColor")
    assert ground == {"light": "rgb(255, 255, 255)", "dark": "rgb(20, 23, 27)"}[mode]


@pytest.fixture(scope="module")
def wide(pages: dict[str, Path]) -> dict[str, Path]:
    """The pages, and one with the widest tables of `veriray bench`."""
    folder = pages["bench"].with_name("wide")
    folder.mkdir()
    results = ROOT / "benchmarks/results"
    stored = json.loads((results / "bench_cuda.json").read_text("utf-8"))
    stored["scenarios"] = {
        name: row for name, row in stored["scenarios"].items()
        if row["kind"] in ("variants", "error", "roulette")
    }  # fmt: skip
    (folder / "bench_cuda.json").write_text(json.dumps(stored))
    found = bench_report.find([folder, results / "matrix_h200.json", results / "bench_cpu.json"])
    for name, part in (("two devices", found), ("one device", found[:2])):
        bench_report.save(part, folder / f"{name}.html")
    return {**pages, **{file.stem: file for file in folder.glob("*.html")}}


@pytest.mark.parametrize("name", ["compare", "one device", "two devices", "validate"])
def test_tables_are_whole_or_say_that_they_go_on(
    page: Page, wide: dict[str, Path], name: str
) -> None:
    tables = """
    [...document.querySelectorAll(".scroll")].filter(e => e.checkVisibility()).map(e => {
      const hint = getComputedStyle(e, "::before").height, more = e.scrollWidth - e.clientWidth;
      const cell = e.querySelector("tr:nth-child(2) > :first-child");
      e.scrollLeft = more;
      const at = cell.getBoundingClientRect().left - e.getBoundingClientRect().left;
      e.scrollLeft = 0;
      return { more, hint, at };
    })
    """
    opened(page, wide[name], 1400)
    for table in page.value(tables):
        assert table["more"] == 0 and table["hint"] == "0px"
    opened(page, wide[name], 420)
    found = page.value(tables)
    assert any(table["more"] > 0 for table in found)
    for table in found:
        assert (table["hint"] == "0px") == (table["more"] == 0)
        assert abs(table["at"]) < 1  # the first column stays


@pytest.mark.parametrize("name", ["compare", "bench", "validate"])
def test_plots_are_as_dark_as_the_page(page: Page, pages: dict[str, Path], name: str) -> None:
    """The least and the largest luminance of the first plot's pixels that are not clear."""
    ink = """
    (async () => {
      const image = document.querySelector(".panels img");
      await image.decode();
      const canvas = Object.assign(document.createElement("canvas"), { width: 400, height: 300 });
      const pen = canvas.getContext("2d");
      pen.drawImage(image, 0, 0, 400, 300);
      const data = pen.getImageData(0, 0, 400, 300).data;
      let sum = 0, count = 0;
      for (let k = 0; k < data.length; k += 4)
        if (data[k + 3] > 250 && Math.max(data[k], data[k + 1], data[k + 2])
            - Math.min(data[k], data[k + 1], data[k + 2]) < 20) { sum += data[k]; ++count; }
      return sum / count;
    })()
    """
    opened(page, pages[name], mode="light")
    light = page.value(ink)
    opened(page, pages[name], mode="dark")
    assert light < 110 and page.value(ink) > 145


@pytest.mark.parametrize("name", ["compare", "bench", "validate"])
def test_nothing_is_loaded_and_no_other_script_runs(page: Page, pages: dict[str, Path],
                                                    name: str) -> None:  # fmt: skip
    opened(page, pages[name])
    loaded = page.value("performance.getEntriesByType('resource').map(e => e.name)")
    assert all(address.startswith("data:") for address in loaded)
    page.value("(s => { s.textContent = 'window.planted = 1'; document.body.append(s); })"
               "(document.createElement('script'))")  # fmt: skip
    assert page.value("window.planted === undefined")
    assert [e for e in page.errors if "Content Security Policy" not in e] == []
    assert page.errors
    page.errors.clear()


def test_failures_come_first(page: Page, pages: dict[str, Path]) -> None:
    opened(page, pages["validate"], 420)
    heads = page.value("[...document.querySelectorAll('h2')].map(e => e.textContent)")
    assert heads[0] == "What did not pass"
    said = page.value("document.querySelector('.verdict').textContent")
    assert re.search(r"FAIL\s+1 of \d+ cases did not get the expected answer\.", said)
    assert page.value("document.querySelector('.failure').textContent").strip().startswith("fail")
