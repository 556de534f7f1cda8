"""The result of a comparison: as an object, as text, as JSON and as one HTML file."""

from __future__ import annotations

import base64
import io
import json
import math
import os
from dataclasses import asdict, dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from veriray.compare.statistics import Cells, Test
from veriray.image import replacing, to_srgb8

if TYPE_CHECKING:
    from matplotlib.figure import Figure
    from numpy.typing import NDArray

    Array = NDArray[Any]

_TEMPLATE = Path(__file__).with_name("report.html.j2")
_BLUE, _ORANGE, _GREY = "#1f5fa8", "#c8581a", "#888888"


@dataclass
class Maps:
    """Pictures for the report: a, b (H, W, 3); t per pixel and per 8x8 block; dof of t."""

    a: Array
    b: Array
    t: Array | None = None
    t_blocks: Array | None = None
    dof: float = math.inf


@dataclass
class Report:
    """Verdict on two renders, with what it rests on.

    Attributes:
        result: "pass" (no difference found), "fail" (they differ) or "inconclusive".
        verdict: one sentence.
        alpha: family-wise false-alarm rate of all tests together.
        seed: of the sign flips.
        effort: "equal", "unequal", "identical" or "none": which tests could run; `reason` why.
        tests: results, S0 first. `not_run`: (test, reason).
        power: per scale, the relative bias that is found with 90 % power: number of cells,
            median, smallest and largest over them.
        means: relative difference of the whole picture and of each object per channel, with its
            relative standard error, t and two-sided p (one by one, without Holm).
        metrics: error measures (`veriray.compare.metrics`); no part of the verdict.
        maps: the pictures, and z-scores of their difference.
        figures: variance_ratio (A over B, of one sample) and its standard error, independence
            (variance of the picture's mean over that of independent pixels, about 1) of A and B,
            correlation of their noise, asymmetry (skewness of A - B), number of flips.
        ledger: rows of `veriray.compare.statistics.LedgerComparison`.
        notes: things to know. `a`, `b`: where the pictures come from.
    """

    alpha: float
    seed: int
    a: dict[str, Any]
    b: dict[str, Any]
    metrics: dict[str, float | None]
    maps: Maps = field(repr=False)
    result: str = "inconclusive"
    verdict: str = ""
    effort: str = "none"
    reason: str = ""
    tests: list[Test] = field(default_factory=list)
    not_run: list[tuple[str, str]] = field(default_factory=list)
    power: list[dict[str, Any]] = field(default_factory=list)
    means: list[dict[str, Any]] = field(default_factory=list)
    figures: dict[str, float] = field(default_factory=dict)
    ledger: list[dict[str, Any]] = field(default_factory=list)
    notes: list[str] = field(default_factory=list)

    @property
    def passed(self) -> bool:
        """True if no test failed and the mean of the picture was tested well enough."""
        return self.result == "pass"

    def add_power(self, scale: str, bias: Array) -> None:
        """One row of `power` from the detectable relative bias of each cell (NaN: untested)."""
        known = bias[np.isfinite(bias)]
        if known.size:
            self.power.append(
                {
                    "scale": scale,
                    "cells": int(known.size),
                    "median": float(np.median(known)),
                    "smallest": float(known.min()),
                    "largest": float(known.max()),
                }
            )

    def add_means(self, cells: Cells, error: Array, dof: Array | float) -> None:
        """Rows of `means` from the cells and their standard errors."""
        from scipy.stats import t as student

        for k, (level, e) in enumerate(zip(cells.level, error, strict=True)):
            if level > 0:
                difference = float(cells.values[:, k].mean())
                t = difference / e if e > 0 else 0.0
                p = 2 * float(student.sf(abs(t), np.broadcast_to(dof, error.shape)[k]))
                self.means.append(
                    {
                        "name": cells.label(k),
                        "relative": difference / level,
                        "error": float(e / level),
                        "t": float(t),
                        "p": p,
                    }
                )

    def decide(self, target: float | None) -> None:
        """Set result and verdict from the tests."""
        failed = [t for t in self.tests if t.result == "fail"]
        mean = [t for t in self.tests if t.name.startswith("S1")]
        seen = next((r["smallest"] for r in self.power if r["scale"] == "whole picture"), None)
        rate = f"at a family-wise false-alarm rate of {self.alpha:g}"
        if failed:
            first = min(failed, key=lambda t: (-1.0 if t.p is None else t.p, -(t.statistic or 0)))
            more = f", and {len(failed) - 1} more failed" if len(failed) > 1 else ""
            exact = "" if first.p is None else f", p = {first.p:.1e}, {rate}"
            self.result = "fail"
            self.verdict = (
                f"The pictures differ: {first.name} found {first.finds} "
                f"({first.where or 'exact condition'}{exact}){more}."
            )
        elif self.effort == "identical":
            self.result, self.verdict = "pass", "The pictures are the same, bit for bit."
        elif not mean or mean[0].result != "pass":
            why = mean[0].where if mean else self.reason
            self.verdict = f"No verdict: the mean of the picture cannot be tested ({why})."
        elif target is not None and (seen is None or not seen <= target):
            self.verdict = (
                f"No verdict: no difference found, but a bias of {_percent(seen)} "
                f"all over the picture could hide; the target is {_percent(target)}."
            )
        else:
            self.result = "pass"
            self.verdict = (
                f"The pictures agree: no difference found {rate}; a bias of "
                f"{_percent(seen)} all over the picture would be found 9 times in 10."
            )

    def to_dict(self) -> dict[str, Any]:
        """Everything but the pictures, as plain dictionaries, lists, numbers and strings."""
        out = {"result": self.result, "passed": self.passed, "verdict": self.verdict}
        for name in ("effort", "reason", "alpha", "seed", "not_run", "power", "means", "metrics",
                     "figures", "ledger", "notes", "a", "b"):  # fmt: skip
            out[name] = getattr(self, name)
        out["tests"] = [asdict(t) for t in self.tests]
        return {str(k): _plain(v) for k, v in out.items()}

    def to_json(self) -> str:
        """`to_dict` as JSON text; numbers that are not finite become null."""
        return json.dumps(self.to_dict(), indent=1, allow_nan=False)

    def __str__(self) -> str:
        width = max((len(t.name) for t in self.tests), default=0)
        lines = [
            self.verdict,
            f"{self.effort} effort: {self.reason}" if self.effort in ("equal",) else self.reason,
        ]
        for t in self.tests:
            p = "" if t.p is None else f"  p = {t.p:.2g} (fails at {t.threshold:.2g})"
            lines.append(f"  {t.result:12} {t.name:{width}}{p}  {t.where}".rstrip())
        lines += [f"  not run      {name}: {why}" for name, why in self.not_run]
        lines += [
            f"  sees         {row['scale']}: {_percent(row['median'])} (median of {row['cells']})"
            for row in self.power
        ]
        shown = ", ".join(f"{k} {v:.4g}" for k, v in self.metrics.items() if v is not None)
        lines.append(f"figures, no part of the verdict: {shown}")
        return "\n".join(lines + [f"note: {note}" for note in self.notes])

    def save(self, path: str | os.PathLike[str]) -> None:
        """Write one self-contained HTML file (no network, no script), or JSON for `.json`.

        The JSON of `to_json` is inside the HTML, in `<script type="application/json">`.

        Raises:
            ValueError: another suffix.
            OSError: the file cannot be written (the message names it).
        """
        suffix = Path(path).suffix.lower()
        if suffix not in (".html", ".json"):
            raise ValueError(f"{os.fspath(path)}: suffix {suffix!r}; expected .html or .json")
        text = self.to_json() if suffix == ".json" else self.to_html()
        with replacing(path) as file:
            file.write(text.encode())

    def to_html(self) -> str:
        """The report as one HTML page."""
        import jinja2

        environment = jinja2.Environment(
            autoescape=True, undefined=jinja2.StrictUndefined, trim_blocks=True, lstrip_blocks=True
        )
        environment.filters.update(percent=_percent, number=_number)
        template = environment.from_string(_TEMPLATE.read_text(encoding="utf-8"))
        embedded = self.to_json().replace("<", "\\u003c")
        return template.render(
            r=self,
            pictures=_pictures(self),
            plots=_plots(self),
            json=embedded,
            ledger=_by_depth(self.ledger),
        )


def _percent(value: float | None) -> str:
    return "unknown" if value is None or not math.isfinite(value) else f"{100 * value:.3g} %"


def _number(value: object) -> str:
    if isinstance(value, float):
        return f"{value:.4g}"
    return "" if value is None else str(value)


def _plain(value: Any) -> Any:
    if isinstance(value, dict):
        return {str(k): _plain(v) for k, v in value.items()}
    if isinstance(value, (list, tuple)):
        return [_plain(v) for v in value]
    if isinstance(value, np.generic):
        value = value.item()
    if isinstance(value, float) and not math.isfinite(value):
        return None
    return value if isinstance(value, (str, int, float, bool, type(None))) else str(value)


def _uri(data: bytes) -> str:
    return "data:image/png;base64," + base64.b64encode(data).decode()


def _pictures(report: Report) -> list[tuple[str, str, str]]:
    """(title, caption, PNG data URI) of both pictures, on one display scale."""
    from PIL import Image

    from veriray.compare.metrics import display_scale

    out = []
    maps = report.maps
    for title, picture in (("A", maps.a), ("B", maps.b)):
        file = io.BytesIO()
        scaled = np.asarray(picture, np.float64) * display_scale(maps.b)
        Image.fromarray(to_srgb8(scaled)).save(file, format="png")
        facts = report.a if title == "A" else report.b
        out.append((title, f"{title}: {facts['name']}", _uri(file.getvalue())))
    return out


def _figure(width: float, height: float, columns: int = 1) -> Figure:
    import matplotlib
    from matplotlib.figure import Figure

    style = {"font.size": 9, "font.family": "sans-serif", "axes.spines.top": False,
             "axes.spines.right": False}  # fmt: skip
    with matplotlib.rc_context(style):
        figure = Figure(figsize=(width, height), layout="constrained", dpi=160)
        figure.subplots(1, columns)
    return figure


def _png(figure: Figure) -> str:
    file = io.BytesIO()
    figure.savefig(file, format="png")
    return _uri(file.getvalue())


def _plots(report: Report) -> list[tuple[str, str, str]]:
    """(identifier, caption, PNG data URI) of all plots that the data allow."""
    out = []
    maps = report.maps
    if np.isfinite(maps.a).all() and np.isfinite(maps.b).all():
        out.append(
            (
                "map",
                "Difference A - B (mean of the channels), per cent of B's mean; the "
                "colours end at the 99th percentile",
                _difference_map(maps),
            )
        )
        if maps.t is not None:
            limit = max(4.0, math.ceil(float(np.abs(maps.t).max())))
            out.append(("map", "z-score of the difference per pixel", _map(maps.t, limit, "z")))
            out.append(
                (
                    "plot",
                    "Do the z-scores follow chance? Left: their distribution; right: "
                    "quantiles. Under the curve and on the line: yes",
                    _quantiles(maps),
                )
            )
        if maps.t_blocks is not None and min(maps.t_blocks.shape) > 1:
            limit = max(4.0, math.ceil(float(np.abs(maps.t_blocks).max())))
            out.append(("map", "z-score per block of 8x8 pixels", _map(maps.t_blocks, limit, "z")))
    if report.means:
        out.append(
            (
                "plot",
                "Relative difference of means, with 99.9 % intervals",
                _means_plot(report.means),
            )
        )
    if report.ledger:
        out.append(
            (
                "plot",
                "Live rays per depth as a fraction of all paths, and the z-score of "
                "their difference",
                _ledger_plot(report.ledger),
            )
        )
    return out


def _difference_map(maps: Maps) -> str:
    a, b = (np.asarray(x, np.float64).mean(axis=-1) for x in (maps.a, maps.b))
    percent = 100 * (a - b) / max(float(b.mean()), 1e-300)
    limit = float(np.percentile(np.abs(percent), 99)) or float(np.abs(percent).max()) or 1.0
    return _map(percent, limit, "%")


def _map(values: Array, limit: float, unit: str) -> str:
    height, width = values.shape
    figure = _figure(4.6, min(max(4.0 * height / width, 1.2), 8))
    axes = figure.axes[0]
    shown = axes.imshow(values, cmap="RdBu_r", vmin=-limit, vmax=limit, interpolation="nearest")
    axes.set_axis_off()
    bar = figure.colorbar(shown, ax=axes, fraction=0.046, pad=0.02)
    bar.set_label(unit)
    bar.outline.set_visible(False)
    return _png(figure)


def _quantiles(maps: Maps) -> str:
    from scipy.stats import t as student

    assert maps.t is not None
    z = np.sort(maps.t, axis=None)
    figure = _figure(8.4, 3.2, columns=2)
    left, right = figure.axes
    edge = max(4.5, float(np.abs(z).max()) * 1.05)
    grid = np.linspace(-edge, edge, 400)
    left.hist(z, bins=np.linspace(-edge, edge, 81), density=True, color=_BLUE, alpha=0.55)
    left.plot(
        grid, student.pdf(grid, maps.dof), color=_ORANGE, lw=1.5, label="without a difference"
    )
    left.set_yscale("log")
    left.set_ylim(bottom=0.3 / z.size)
    left.set_xlabel("z")
    left.set_ylabel("density")
    left.legend(frameon=False, loc="lower center", bbox_to_anchor=(0.5, 1))
    pick = np.unique(
        np.concatenate(
            [
                np.arange(min(200, z.size)),
                np.linspace(0, z.size - 1, 600).astype(int),
                np.arange(max(0, z.size - 200), z.size),
            ]
        )
    )
    from scipy.stats import beta

    expected = student.ppf((pick + 0.5) / z.size, maps.dof)
    band = [student.ppf(beta.ppf(q, pick + 1, z.size - pick), maps.dof) for q in (5e-4, 0.9995)]
    right.fill_between(expected, *band, color=_ORANGE, alpha=0.2, lw=0, label="99.9 %, one by one")
    right.plot(expected, expected, color=_ORANGE, lw=1)
    right.plot(expected, z[pick], ".", ms=3, color=_BLUE)
    right.set_xlabel("expected z")
    right.set_ylabel("measured z")
    right.legend(frameon=False)
    return _png(figure)


def _means_plot(means: list[dict[str, Any]]) -> str:
    rows = means[:60]
    figure = _figure(8.4, 0.8 + 0.2 * len(rows))
    axes = figure.axes[0]
    colours = {"R": "#b3261e", "G": "#2e7d32", "B": _BLUE}
    for k, row in enumerate(rows):
        colour = colours.get(row["name"][-1], _GREY)
        axes.errorbar(
            100 * row["relative"],
            k,
            xerr=329 * row["error"],
            fmt="o",
            ms=4,
            color=colour,
            elinewidth=1.5,
        )
    axes.axvline(0, color=_GREY, lw=0.8)
    axes.set_yticks(range(len(rows)), [row["name"] for row in rows])
    axes.invert_yaxis()
    axes.set_xlabel("A - B, per cent")
    return _png(figure)


def _ledger_plot(ledger: list[dict[str, Any]]) -> str:
    live = [row for row in ledger if row["column"] == "live"]
    depth = [row["depth"] for row in live]
    figure = _figure(8.4, 3.2, columns=2)
    left, right = figure.axes
    for key, colour, marker in (("share_a", _BLUE, "o"), ("share_b", _ORANGE, "x")):
        share = [row[key] or math.nan for row in live]
        left.plot(depth, share, marker, ms=4, color=colour, label=key[-1].upper())
    left.set_yscale("log")
    left.set_xlabel("depth")
    left.set_ylabel("live rays / paths")
    left.legend(frameon=False)
    right.axhspan(-3.29, 3.29, color=_GREY, alpha=0.15, lw=0, label="99.9 %, one by one")
    right.plot(depth, [row["z"] for row in live], "o", ms=4, color=_BLUE)
    right.axhline(0, color=_GREY, lw=0.8)
    right.set_xlabel("depth")
    right.set_ylabel("z of the difference")
    right.legend(frameon=False)
    return _png(figure)


def _by_depth(rows: list[dict[str, Any]]) -> list[dict[str, Any]]:
    """Ledger rows by depth: depth, and per column its row."""
    depths: dict[int, dict[str, Any]] = {}
    for row in rows:
        depths.setdefault(row["depth"], {})[row["column"]] = row
    return [{"depth": depth, "columns": columns} for depth, columns in depths.items()]
