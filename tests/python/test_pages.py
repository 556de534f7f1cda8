"""What the pages of the reports share: colours, plots, policy; and the comparison's pictures."""

from __future__ import annotations

import base64
import itertools
import json
import re
import xml.etree.ElementTree as ET
import zlib
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from matplotlib.figure import Figure

from veriray import html
from veriray.comparison import pictures
from veriray.comparison.report import Maps

PACKAGE = Path(html.__file__).parent


def luminance(colour: str) -> float:
    """WCAG 2's relative luminance of #rrggbb."""
    levels = (int(colour[k : k + 2], 16) / 255 for k in (1, 3, 5))
    linear = [c / 12.92 if c <= 0.04045 else ((c + 0.055) / 1.055) ** 2.4 for c in levels]
    return 0.2126 * linear[0] + 0.7152 * linear[1] + 0.0722 * linear[2]


def contrast(a: str, b: str) -> float:
    high, low = sorted((luminance(a), luminance(b)), reverse=True)
    return (high + 0.05) / (low + 0.05)


@pytest.mark.parametrize("dark", [0, 1])
def test_contrast_passes_wcag_aa(dark: int) -> None:
    colours = {name: pair[dark] for name, pair in html.COLOURS.items()}
    grounds = [name for name in colours if name.endswith("ground") or name == "field"]
    for text, ground in itertools.product(("ink", "dim"), grounds):
        assert contrast(colours[text], colours[ground]) >= 4.5, (text, ground)
    for text, ground in itertools.product(("red", "amber", "green"), ("ground", "red-ground")):
        assert contrast(colours[text], colours[ground]) >= 4.5, (text, ground)
    for text in ("blue", "orange"):
        assert contrast(colours[text], colours["ground"]) >= 4.5, text
    for graphic in ("violet", "grey", "edge"):  # not text: curves, edges of controls
        assert contrast(colours[graphic], colours["ground"]) >= 3, graphic
    assert contrast("#000000", "#ffffff") == pytest.approx(21)


def test_one_style_with_these_colours_alone() -> None:
    templates = [PACKAGE / "page.html.j2", *PACKAGE.parent.glob("veriray*/**/report.html.j2")]
    assert len(templates) == 4
    used = set()
    for path in [PACKAGE / "page.css", *templates]:
        text = path.read_text("utf-8")
        used |= set(re.findall(r"var\(--([\w-]+)\)", text))
        colours = set(re.findall(r"#[0-9a-fA-F]{3,8}\b(?=[;,) ])", text))
        assert colours <= {"#fff", "#1959cc", "#cc2619"}, path  # the ramp of signed pictures
    assert used - {"aspect"} <= set(html.COLOURS)
    ends = html.tint(np.array([-4.0, 0.0, 4.0])).tolist()
    assert ends == [[0x19, 0x59, 0xCC], [255, 255, 255], [0xCC, 0x26, 0x19]]


def drawn_with_all_colours() -> Figure:
    drawn = html.figure()
    axes = drawn.axes[0]
    for k, colour in enumerate((html.BLUE, html.ORANGE, html.GREEN, html.GREY, html.RED)):
        axes.plot([1, 2], [k, k + 1], "o-", color=colour, label=f"<script>{k}</script>&")
    axes.fill_between([1, 2], [0, 0], [1, 1], color=html.VIOLET, alpha=0.2)
    axes.grid(color=html.LINE)
    html.legend(axes)
    return drawn


def test_plots_follow_the_page_and_hold_no_markup() -> None:
    drawn = drawn_with_all_colours()
    uri = html.svg(drawn)
    assert uri == html.svg(drawn_with_all_colours())
    text = base64.b64decode(uri.removeprefix("data:image/svg+xml;base64,")).decode()
    assert "<script" not in text and not re.search(r'href="(?!#)', text.partition("<style>")[2])
    style = text[text.index("<style>") : text.index("</style>")]
    assert "prefers-color-scheme: dark" in style
    assert not re.search(r"(fill|stroke): #", text.replace(style, ""))
    ET.fromstring(text)
    drawn.draw_without_rendering()
    axes = drawn.axes[0]
    legend, inside = axes.get_legend(), axes.get_window_extent()
    assert legend is not None and legend.get_window_extent().y0 >= inside.y1  # off the curves


def test_policy_names_the_script_alone(tmp_path: Path) -> None:
    template = tmp_path / "x.html.j2"
    template.write_text(
        '{% extends "page.html.j2" %}{% block title %}t{% endblock %}'
        "{% block content %}{{ text }}{% endblock %}"
    )
    hostile = "</script><script>alert(1)</script>{{ 7 * 7 }}"
    bare = html.page(template, "pass", hostile, json.dumps(hostile), text=hostile)
    assert bare.count("<script") == 1 and "script-src &#39;none&#39;" in bare
    assert "default-src &#39;none&#39;" in bare
    ours = html.page(template, "pass", "v", "{}", script="let a = 1 < 2 && 3;", text="")
    assert "<script>let a = 1 < 2 && 3;</script>" in ours
    assert "script-src &#39;sha256-" in ours and "script-src &#39;none&#39;" not in ours


# ---- the comparison's pictures ----


def decoded(planes: Any) -> Any:
    """What the page's script reads: (H, W, 3) from the planes of `pictures.values`."""
    exponent, high, low = planes[0].astype(int), planes[1:4].astype(int), planes[4:].astype(int)
    whole = (high << 8 | low) - 65536 * (high >= 128)
    values = np.ldexp(whole.astype(float), (exponent - 141)[None])
    for code, meaning in ((-32768, np.nan), (32767, np.inf), (-32767, -np.inf)):
        values[whole == code] = meaning
    return np.moveaxis(values, 0, -1)


def test_embedded_values_are_within_the_stated_error() -> None:
    rng = np.random.default_rng(5)
    scale = np.ldexp(1.0, rng.integers(-100, 127, (40, 50, 1)))
    picture = rng.standard_normal((40, 50, 3)) * 0.3 * scale
    picture[0, 0] = 0
    picture[0, 1] = np.float32(3.4028235e38), -1, 0  # the largest float32
    picture[0, 2] = 0.99999, 0.99999, -0.99999  # rounds up to a power of two
    picture[0, 3] = 1, np.nan, 0.5
    picture[0, 4] = np.inf, -np.inf, 2
    back = decoded(pictures.values(picture))
    finite = np.isfinite(picture)
    assert np.array_equal(np.isnan(back), np.isnan(picture))
    assert np.array_equal(back[~finite & ~np.isnan(back)], [np.inf, -np.inf])
    error = np.abs(np.where(finite, back, 0) - np.where(finite, picture, 0)).max(axis=-1)
    largest = np.abs(np.where(finite, picture, 0)).max(axis=-1)
    assert (error <= pictures.VALUE_ERROR * largest).all()
    assert error.max() > 0  # 16 bits do round


def test_embedded_errors_are_within_the_stated_error() -> None:
    rng = np.random.default_rng(6)
    stderr = np.exp(rng.uniform(-12, 2, (30, 20, 3)))
    stderr[0, :4, 0] = 0, np.nan, np.inf, 1e-6
    maps = Maps(np.ones((30, 20, 3)), np.ones((30, 20, 3)), stderr, None)
    packed = pictures.packed(maps)
    planes = np.frombuffer(zlib.decompress(base64.b64decode(packed.data)), np.uint8)
    planes = planes.reshape(2, 10, 30, 20)
    (low, interval), _ = json.loads(packed.about)["codes"]
    code = np.moveaxis(planes[0, 7:], 0, -1).astype(float)
    assert code[0, :3, 0].tolist() == [1, 0, 0] and not planes[1, 7:].any()
    known = np.isfinite(stderr) & (stderr > 0)
    found = 2 ** (low + (code - 2) * interval)
    error = np.abs(found[known] / stderr[known] - 1).max()
    assert 0 < error <= packed.stderr_error * (1 + 1e-9) < 0.05


def test_large_pictures_are_means_of_blocks() -> None:
    sizes = {(1024, 1024): 1, (1080, 1920): 2, (1025, 1024): 2, (1, 3_000_000): 3}
    for size, step in sizes.items():
        assert pictures.reduction(*size) == step
        assert (step == 1) or size[0] * size[1] > pictures.MOST_PIXELS
    rng = np.random.default_rng(7)
    a = rng.random((1101, 1000, 3))
    packed = pictures.packed(Maps(a, a, np.full(a.shape, 0.5), None))
    about = json.loads(packed.about)
    assert (packed.step, about["rows"], about["columns"]) == (2, 551, 500)
    planes = np.frombuffer(zlib.decompress(base64.b64decode(packed.data)), np.uint8)
    planes = planes.reshape(2, 10, 551, 500)
    values = decoded(planes[0, :7])
    assert values[3, 4] == pytest.approx(a[6:8, 8:10].mean((0, 1)), rel=1e-4)
    assert values[550, 4] == pytest.approx(a[1100:, 8:10].mean((0, 1)), rel=1e-4)
    low, interval = about["codes"][0]
    errors = 2 ** (low + (planes[0, 7].astype(float) - 2) * interval)
    assert errors[0, 0] == pytest.approx(0.25) and errors[550, 0] == pytest.approx(0.5 / 2**0.5)


def test_size_per_pixel() -> None:
    """About 20 bytes or less: noise that does not compress."""
    rng = np.random.default_rng(8)
    a, b, e, f = (np.exp(rng.standard_normal((256, 256, 3))) for _ in range(4))
    assert len(pictures.packed(Maps(a, b, 0.1 * e, 0.1 * f)).data) < 24 * 256 * 256
