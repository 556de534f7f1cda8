"""The result of a comparison: as an object, as text, as JSON and as one HTML file."""

from __future__ import annotations

import math
import os
from dataclasses import asdict, dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from veriray import html, showing
from veriray.comparison import pictures
from veriray.comparison.statistics import Cells, Test
from veriray.errors import printable
from veriray.files import replacing
from veriray.html import BLUE, GREEN, GREY, ORANGE, RED, percent, plain
from veriray.numeric import path_text

if TYPE_CHECKING:
    from matplotlib.figure import Figure
    from numpy.typing import NDArray

    Array = NDArray[Any]

_TEMPLATE = Path(__file__).with_name("report.html.j2")
_SCRIPT = Path(__file__).with_name("pictures.js")


@dataclass
class Maps:
    """Pictures for the report: a, b (H, W, 3), their standard errors if they are known; t per pixel
    and per 8x8 block; dof of t; together: of a and b, the variance of a mean of pixels over that of
    independent ones, at most.
    """

    a: Array
    b: Array
    stderr_a: Array | None = None
    stderr_b: Array | None = None
    t: Array | None = None
    t_blocks: Array | None = None
    dof: float = math.inf
    together: tuple[float, float] = (1.0, 1.0)


@dataclass
class Report:
    """Verdict on two renders, with its evidence.

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
        metrics: error measures (`veriray.comparison.metrics`); not part of the verdict.
        maps: the pictures, and z-scores of their difference.
        figures: variance_ratio (A over B, of one sample) and its standard error, independence
            (variance of the picture's mean over that of independent pixels: about 1 under a box,
            and up to `statistics.shared` under wider filters) of A and B,
            correlation of their noise, asymmetry (skewness of A - B), number of flips.
        ledger: rows of `veriray.comparison.ledgers.LedgerComparison`.
        notes: remarks. `a`, `b`: where the pictures come from.
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
                f"No verdict: no difference found, but a bias of {percent(seen)} "
                f"all over the picture could hide; the target is {percent(target)}."
            )
        else:
            self.result = "pass"
            self.verdict = (
                f"The pictures agree: no difference found {rate}; a bias of "
                f"{percent(seen)} all over the picture would be found 9 times in 10."
            )

    def to_dict(self) -> dict[str, Any]:
        """Everything but the pictures, as plain dictionaries, lists, numbers and strings."""
        out = {"result": self.result, "passed": self.passed, "verdict": self.verdict}
        for name in ("effort", "reason", "alpha", "seed", "not_run", "power", "means", "metrics",
                     "figures", "ledger", "notes", "a", "b"):  # fmt: skip
            out[name] = getattr(self, name)
        out["tests"] = [asdict(t) for t in self.tests]
        return {str(k): plain(v) for k, v in out.items()}

    def to_json(self) -> str:
        """`to_dict` as JSON text; numbers that are not finite become null."""
        return html.as_json(self.to_dict())

    def __repr__(self) -> str:
        return showing.report_text(self)

    def _repr_html_(self) -> str:
        """The verdict and the tests as a table, for notebooks."""
        return showing.report_html(self)

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
            f"  sees         {row['scale']}: {percent(row['median'])} (median of {row['cells']})"
            for row in self.power
        ]
        shown = ", ".join(f"{k} {v:.4g}" for k, v in self.metrics.items() if v is not None)
        lines.append(f"figures, not part of the verdict: {shown}")
        return "\n".join(lines + [f"note: {note}" for note in self.notes])

    def save(self, path: str | os.PathLike[str]) -> None:
        """Write one self-contained HTML file that loads nothing, or JSON for `.json`.

        The JSON of `to_json` is inside the HTML, in `<script type="application/json">`.

        Raises:
            ValueError: another suffix, or a null character.
            TypeError: no path.
            OSError: the file cannot be written (the message names it).
        """
        suffix = Path(path_text("path", path, ValueError)).suffix.lower()
        if suffix not in (".html", ".json"):
            text = f"{os.fspath(path)}: suffix {suffix!r}; expected .html or .json"
            raise ValueError(printable(text))
        text = self.to_json() if suffix == ".json" else self.to_html()
        with replacing(path) as file:
            file.write(text.encode())

    def to_html(self) -> str:
        """The report as one HTML page."""
        maps, script = self.maps, _SCRIPT.read_text("utf-8")
        return html.page(
            _TEMPLATE, self.result, self.verdict, self.to_json(), script, r=self,
            plots=_plots(self), ledger=_by_depth(self.ledger), packed=pictures.packed(maps),
            stills=list(zip("ab", pictures.stills(maps), strict=True)),
            maps=pictures.signed_maps(maps), value_error=pictures.VALUE_ERROR,
            aspect=maps.a.shape[1] / maps.a.shape[0],
        )  # fmt: skip


def _plots(report: Report) -> list[tuple[str, list[str]]]:
    """(caption, panels) of all plots that the data allow."""
    out = []
    if report.maps.t is not None and np.isfinite(report.maps.t).all():
        text = (
            "Do the z-scores follow chance? One panel: their distribution; the other: "
            "quantiles. Under the curve and on the line: yes"
        )
        out.append((text, html.z_plots(report.maps.t, report.maps.dof)))
    if report.means:
        out.append(
            ("Relative difference of means, with 99.9 % intervals", [_means_plot(report.means)])
        )
    if report.ledger:
        text = "Live rays per depth as a fraction of all paths, and the z-score of their difference"
        out.append((text, _ledger_plots(report.ledger)))
    return [(caption, [html.svg(drawn) for drawn in panels]) for caption, panels in out]


def _means_plot(means: list[dict[str, Any]]) -> Figure:
    rows = means[:60]
    figure = html.figure(height=0.8 + 0.2 * len(rows))
    axes = figure.axes[0]
    colours = {"R": RED, "G": GREEN, "B": BLUE}
    for k, row in enumerate(rows):
        colour = colours.get(row["name"][-1], GREY)
        axes.errorbar(
            100 * row["relative"], k, xerr=329 * row["error"], fmt="o", ms=4, color=colour,
            elinewidth=1.5,
        )  # fmt: skip
    axes.axvline(0, color=GREY, lw=0.8)
    names = [row["name"] for row in rows]
    short = [n if len(n) <= 24 else f"{n[:14]}\u2026{n[-9:]}" for n in names]
    axes.set_yticks(range(len(rows)), short, parse_math=False)
    axes.invert_yaxis()
    axes.set_xlabel("A - B, per cent")
    return figure


def _ledger_plots(ledger: list[dict[str, Any]]) -> list[Figure]:
    live = [row for row in ledger if row["column"] == "live"]
    depth = [row["depth"] for row in live]
    left, right = html.figure(), html.figure()
    axes = left.axes[0]
    for key, colour, look in (("share_a", BLUE, {"marker": "o", "mfc": "none"}),
                              ("share_b", ORANGE, {"marker": "x"})):  # fmt: skip
        share = [row[key] or math.nan for row in live]
        axes.plot(depth, share, ls="", ms=6, color=colour, label=key[-1].upper(), **look)
    axes.set_yscale("log")
    axes.set_xlabel("depth")
    axes.set_ylabel("live rays / paths")
    html.legend(axes)
    axes = right.axes[0]
    axes.axhspan(-3.29, 3.29, color=GREY, alpha=0.2, lw=0, label="99.9 %, one by one")
    axes.plot(depth, [row["z"] for row in live], "o", ms=4, color=BLUE, label="measured")
    axes.axhline(0, color=GREY, lw=0.8)
    axes.set_xlabel("depth")
    axes.set_ylabel("z of the difference")
    html.legend(axes)
    return [left, right]


def _by_depth(rows: list[dict[str, Any]]) -> list[dict[str, Any]]:
    """Ledger rows by depth: depth, and per column its row."""
    depths: dict[int, dict[str, Any]] = {}
    for row in rows:
        depths.setdefault(row["depth"], {})[row["column"]] = row
    return [{"depth": depth, "columns": columns} for depth, columns in depths.items()]
