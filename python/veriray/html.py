"""Shared parts of the HTML reports: frame and style of the page, plots, pictures, JSON.

A report is one file that loads nothing. Its template extends `page.html.j2`; its style is
`page.css` in the colours of `COLOURS`, and its plots are SVG in the same.
"""

from __future__ import annotations

import base64
import hashlib
import io
import json
import math
import re
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from veriray.errors import visible
from veriray.extras import need

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure
    from numpy.typing import NDArray

    Array = NDArray[Any]

#: Colours by name: on a light page, on a dark one. Names in -ground are of areas behind text.
COLOURS = {
    "ground": ("#ffffff", "#14171b"), "ink": ("#1b1d21", "#e4e7eb"),
    "dim": ("#555b63", "#a3abb6"), "line": ("#dfe2e6", "#353b44"),
    "shade": ("#c9ced6", "#4a525e"), "field": ("#f1f3f5", "#22272e"),
    "edge": ("#848b96", "#6f7886"),
    "blue": ("#1f5fa8", "#6cb0ff"), "orange": ("#b84d10", "#f0955a"),
    "green": ("#2e7d32", "#6fcf78"), "red": ("#b3261e", "#ff8a80"),
    "amber": ("#855b00", "#e2b04a"), "violet": ("#6a3d9a", "#bb9aea"),
    "grey": ("#6b7280", "#9aa3af"),
    "green-ground": ("#eaf4ea", "#16291a"), "red-ground": ("#fcefee", "#371b1c"),
    "amber-ground": ("#fbf3dc", "#2f2712"), "orange-ground": ("#fae3cd", "#3a2614"),
}  # fmt: skip
#: Colours of plots, as they are on a light page.
INK, GREY, LINE = (COLOURS[name][0] for name in ("ink", "grey", "line"))
BLUE, ORANGE, GREEN = (COLOURS[name][0] for name in ("blue", "orange", "green"))
RED, VIOLET = (COLOURS[name][0] for name in ("red", "violet"))
#: Width and height of a plot's panel; inches.
PANEL = (4.3, 3.1)
_STYLE = {"font.size": 9, "font.family": "sans-serif",
          "axes.spines.top": False, "axes.spines.right": False, "svg.fonttype": "none",
          "svg.hashsalt": "veriray", "text.color": INK, "axes.labelcolor": INK,
          "axes.edgecolor": INK, "axes.titlecolor": INK, "xtick.color": INK, "ytick.color": INK,
          "legend.labelcolor": INK}  # fmt: skip


def theme() -> str:
    """The colours as CSS: custom properties, which follow the reader's choice of light or dark."""
    light, dark = (
        " ".join(f"--{name}: {pair[k]};" for name, pair in COLOURS.items()) for k in (0, 1)
    )
    return (
        f":root {{ {light} }}\n"
        f"@media screen and (prefers-color-scheme: dark) {{ :root {{ {dark} }} }}"
    )


def page(template: Path, result: str, verdict: str, json_text: str, script: str = "",
         **more: Any) -> str:  # fmt: skip
    """A page from a template, with the verdict, embedded JSON, and `more` for the template.

    script: the only one that the page's policy lets run. Nothing is loaded from anywhere.
    """
    need("a report", "compare", "jinja2")
    import jinja2

    folders = [template.parent, Path(__file__).parent]
    environment = jinja2.Environment(
        loader=jinja2.FileSystemLoader(folders), autoescape=True,
        undefined=jinja2.StrictUndefined, trim_blocks=True, lstrip_blocks=True,
        finalize=lambda value: visible(value) if type(value) is str else value,
    )  # fmt: skip
    environment.filters.update(percent=percent, number=number)
    text: str = environment.get_template(template.name).render(
        result=result, verdict=verdict, json=json_text.replace("<", "\\u003c"), theme=theme(),
        script=script, policy=_policy(script), **more,
    )  # fmt: skip
    return text


def _policy(script: str) -> str:
    """The page's content security policy: pictures that are inside, this script, nothing else."""
    digest = base64.b64encode(hashlib.sha256(script.encode()).digest()).decode()
    allowed = f"'sha256-{digest}'" if script else "'none'"
    return (
        "default-src 'none'; img-src data:; style-src 'unsafe-inline'; base-uri 'none'; "
        f"form-action 'none'; script-src {allowed}"
    )


# ---- numbers ----


def percent(value: float | None) -> str:
    """A fraction as per cent."""
    return "unknown" if value is None or not math.isfinite(value) else f"{100 * value:.3g} %"


def number(value: object) -> str:
    """A value in four digits; nothing for None."""
    if isinstance(value, float):
        return f"{value:.4g}"
    return "" if value is None else str(value)


def plain(value: Any) -> Any:
    """The value for JSON: numbers that are not finite become None, other objects text."""
    if isinstance(value, dict):
        return {str(k): plain(v) for k, v in value.items()}
    if isinstance(value, (list, tuple)):
        return [plain(v) for v in value]
    if isinstance(value, np.ndarray):
        return plain(value.tolist())
    if isinstance(value, np.generic):
        value = value.item()
    if isinstance(value, float) and not math.isfinite(value):
        return None
    return value if isinstance(value, (str, int, float, bool, type(None))) else str(value)


def as_json(values: Any) -> str:
    """`plain` values as JSON text."""
    return json.dumps(plain(values), indent=1, allow_nan=False)


# ---- pictures ----


def picture(pixels: Array) -> str:
    """Bytes (H, W, 3) as a PNG data URI."""
    from PIL import Image

    file = io.BytesIO()
    Image.fromarray(pixels).save(file, format="png")
    return _uri(file.getvalue())


def tint(values: Array, limit: float = 4.0) -> Array:
    """Values as colours, bytes (..., 3): white 0, red positive, blue negative, full at `limit`."""
    share = np.nan_to_num(np.asarray(values, np.float64) / limit)[..., None]
    high, low = np.clip(share, 0, 1), np.clip(-share, 0, 1)
    colours = 1 - high * [0.2, 0.85, 0.9] - low * [0.9, 0.65, 0.2]
    return np.asarray(np.round(255 * colours), np.uint8)


def signed_picture(values: Array, limit: float) -> str:
    """Values (H, W) in the colours of `tint`, in 255 steps, as a PNG data URI."""
    from PIL import Image

    share = np.clip(np.nan_to_num(np.asarray(values, np.float64) / limit), -1, 1)
    shown = Image.fromarray(np.asarray(np.rint(127 * share) + 127, np.uint8), "P")
    shown.putpalette(tint(np.arange(-127, 128) / 127, 1.0).tobytes())
    file = io.BytesIO()
    shown.save(file, format="png")
    return _uri(file.getvalue())


# ---- plots ----


def figure(width: float = PANEL[0], height: float = PANEL[1]) -> Figure:
    """An empty figure of one panel, by default as wide as a phone shows it; inches."""
    need("a plot", "compare", "matplotlib")
    import matplotlib
    from matplotlib.figure import Figure

    with matplotlib.rc_context(_STYLE):
        empty = Figure(figsize=(width, height), layout="constrained", dpi=160)
        empty.subplots()
    return empty


def legend(axes: Axes, columns: int = 2) -> None:
    """The legend above the axes, where it covers no curve."""
    axes.legend(frameon=False, fontsize=8, loc="lower left", bbox_to_anchor=(0, 1.01),
                borderaxespad=0, ncols=columns, handlelength=2.2, columnspacing=1.2,
                labelcolor=INK)  # fmt: skip


def svg(drawn: Figure) -> str:
    """A figure as an SVG data URI; its colours, of COLOURS alone, follow the page's."""
    import matplotlib

    file = io.StringIO()
    with matplotlib.rc_context(_STYLE):
        drawn.savefig(file, format="svg", transparent=True, metadata={"Date": None})
    names = {pair[0]: name for name, pair in COLOURS.items() if "-" not in name}
    text = re.sub(
        r"(fill|stroke): (#[0-9a-f]{6})",
        lambda m: f"{m[1]}: var(--{names[m[2]]})" if m[2] in names else m[0], file.getvalue(),
    )  # fmt: skip
    text = re.sub(  # hundredths of a point suffice
        r' (?:d|x|y)="[^"]*"', lambda m: re.sub(r"(\.\d\d)\d+", r"\1", m[0]), text
    )
    style = f"<style>{theme()} text {{ fill: var(--ink); }}</style>"
    text = re.sub(r"<defs>", f"{style}<defs>", text, count=1)
    return "data:image/svg+xml;base64," + base64.b64encode(text.encode()).decode()


def _uri(data: bytes) -> str:
    return "data:image/png;base64," + base64.b64encode(data).decode()


def z_plots(z: Array, dof: float = math.inf, law: str = "without a difference") -> list[Figure]:
    """z-scores against Student's distribution, by default the normal one: density and quantiles."""
    from scipy.stats import t as student

    z = np.sort(z, axis=None)
    left, right = figure(), figure()
    axes = left.axes[0]
    edge = max(4.5, float(np.abs(z).max()) * 1.05)
    grid = np.linspace(-edge, edge, 400)
    density, edges = np.histogram(z, bins=np.linspace(-edge, edge, 81), density=True)
    axes.stairs(density, edges, fill=True, color=BLUE, alpha=0.55, label="measured")
    axes.plot(grid, student.pdf(grid, dof), color=ORANGE, lw=1.5, label=law)
    axes.set_yscale("log")
    axes.set_ylim(bottom=0.3 / z.size)
    axes.set_xlabel("z")
    axes.set_ylabel("density")
    legend(axes)
    _quantiles(right.axes[0], z, dof)
    return [left, right]


def _quantiles(axes: Axes, z: Array, dof: float) -> None:
    from scipy.stats import beta
    from scipy.stats import t as student

    pick = np.unique(
        np.concatenate(
            [
                np.arange(min(200, z.size)),
                np.linspace(0, z.size - 1, 600).astype(int),
                np.arange(max(0, z.size - 200), z.size),
            ]
        )
    )
    expected = student.ppf((pick + 0.5) / z.size, dof)
    band = [student.ppf(beta.ppf(q, pick + 1, z.size - pick), dof) for q in (5e-4, 0.9995)]
    axes.fill_between(expected, *band, color=ORANGE, alpha=0.2, lw=0, label="99.9 %, one by one")
    axes.plot(expected, expected, color=ORANGE, lw=1)
    axes.plot(expected, z[pick], ".", ms=3, color=BLUE)
    axes.set_xlabel("expected z")
    axes.set_ylabel("measured z")
    legend(axes)
