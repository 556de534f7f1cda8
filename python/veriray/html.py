"""Shared parts of the HTML reports: frame and style of the page, plots, pictures, JSON.

A report is one file that needs no network and no script. Its template extends `page.html.j2`.
"""

from __future__ import annotations

import base64
import io
import json
import math
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

BLUE, ORANGE, GREEN, GREY = "#1f5fa8", "#c8581a", "#2e7d32", "#888888"
_STYLE = {"font.size": 9, "font.family": "sans-serif", "axes.spines.top": False,
          "axes.spines.right": False}  # fmt: skip


def page(template: Path, result: str, verdict: str, json_text: str, **more: Any) -> str:
    """A page from a template, with the verdict, embedded JSON, and `more` for the template."""
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
        result=result, verdict=verdict, json=json_text.replace("<", "\\u003c"), **more
    )
    return text


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


def figure(width: float, height: float, columns: int = 1, rows: int = 1) -> Figure:
    """An empty figure of `rows` x `columns` axes; inches."""
    need("a plot", "compare", "matplotlib")
    import matplotlib
    from matplotlib.figure import Figure

    with matplotlib.rc_context(_STYLE):
        empty = Figure(figsize=(width, height), layout="constrained", dpi=160)
        empty.subplots(rows, columns)
    return empty


def png(drawn: Figure) -> str:
    """A figure as a PNG data URI."""
    file = io.BytesIO()
    drawn.savefig(file, format="png")
    return _uri(file.getvalue())


def _uri(data: bytes) -> str:
    return "data:image/png;base64," + base64.b64encode(data).decode()


def signed_map(values: Array, limit: float, unit: str) -> str:
    """Values (H, W) as a picture: white 0, red positive, blue negative, full colour at `limit`."""
    height, width = values.shape
    drawn = figure(4.6, min(max(4.0 * height / width, 1.2), 8))
    axes = drawn.axes[0]
    shown = axes.imshow(values, cmap="RdBu_r", vmin=-limit, vmax=limit, interpolation="nearest")
    axes.set_axis_off()
    bar = drawn.colorbar(shown, ax=axes, fraction=0.046, pad=0.02)
    bar.set_label(unit)
    bar.outline.set_visible(False)
    return png(drawn)


def z_plot(z: Array, dof: float = math.inf, law: str = "without a difference") -> str:
    """z-scores against Student's distribution, by default the normal one: density and quantiles."""
    from scipy.stats import t as student

    z = np.sort(z, axis=None)
    drawn = figure(8.4, 3.2, columns=2)
    left, right = drawn.axes
    edge = max(4.5, float(np.abs(z).max()) * 1.05)
    grid = np.linspace(-edge, edge, 400)
    left.hist(z, bins=np.linspace(-edge, edge, 81), density=True, color=BLUE, alpha=0.55)
    left.plot(grid, student.pdf(grid, dof), color=ORANGE, lw=1.5, label=law)
    left.set_yscale("log")
    left.set_ylim(bottom=0.3 / z.size)
    left.set_xlabel("z")
    left.set_ylabel("density")
    left.legend(frameon=False, loc="lower center", bbox_to_anchor=(0.5, 1))
    _quantiles(right, z, dof)
    return png(drawn)


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
    axes.legend(frameon=False)
