"""Plots of the benchmark report."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Any

import numpy as np

from veriray.html import BLUE, GREEN, GREY, ORANGE, figure

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

_COLOURS = {"veriray": BLUE, "mitsuba": ORANGE}
_MARKS = "osd^v"
_LINES = ("-", "--", ":", "-.")


def _look(name: str, names: Sequence[str]) -> dict[str, Any]:
    """Colour by renderer, mark and line by its variant."""
    who = name.split()[0]
    same = [n for n in names if n.split()[0] == who].index(name)
    others = [w for w in dict.fromkeys(n.split()[0] for n in names) if w not in _COLOURS]
    colour = _COLOURS.get(who) or (GREEN, GREY)[others.index(who) % 2]
    return {"color": colour, "marker": _MARKS[same % 5], "ls": _LINES[same % 4], "ms": 4, "lw": 1.2}


def _log(axes: Axes, x: str, y: str) -> None:
    axes.set_xlabel(x)
    axes.set_ylabel(y)
    _decades(axes, "x")
    _decades(axes, "y")


def _decades(axes: Axes, which: str) -> None:
    """A logarithmic axis with plain numbers at 1, 2, 5 over a short range, at decades over a long
    one.
    """
    from matplotlib.ticker import FuncFormatter, LogLocator, NullLocator

    axes.set(**{f"{which}scale": "log"})
    axis, (low, high) = getattr(axes, f"{which}axis"), getattr(axes, f"get_{which}lim")()
    axis.set_major_locator(LogLocator(subs=(1, 2, 5) if high < 200 * low else (1,), numticks=12))
    axis.set_minor_locator(NullLocator())
    axis.set_major_formatter(FuncFormatter(lambda v, _: f"{v:g}"))


def dots(groups: Sequence[tuple[str, Mapping[str, float]]], unit: str) -> Figure:
    """A point for each contestant of each group, logarithmic, with its value."""
    names = list(dict.fromkeys(name for _, values in groups for name in values))
    drawn = figure(8.4, 0.7 + sum(0.2 * len(values) + 0.2 for _, values in groups))
    axes = drawn.axes[0]
    place, ticks = 0.0, []
    for label, values in groups:
        ticks.append((place + (len(values) - 1) / 2, label))
        for name, value in values.items():
            axes.plot([value], [place], **{**_look(name, names), "ms": 6})
            axes.annotate(f"{name} {value:,.3g}", (value, place), xytext=(7, 0), va="center",
                          textcoords="offset points", fontsize=8)  # fmt: skip
            place += 1
        place += 1
    shown = [v for _, values in groups for v in values.values()]
    axes.set_xlim(min(shown) / 1.5, max(shown) * 2.5)
    _decades(axes, "x")
    axes.set_yticks([p for p, _ in ticks], [label for _, label in ticks], fontsize=8)
    axes.grid(axis="x", color="#dddddd", lw=0.6)
    axes.invert_yaxis()
    axes.set_xlabel(unit)
    return drawn


def curves(rows: Mapping[str, Mapping[str, Sequence[float]]], target: float) -> Figure:
    """RelMSE against samples (left) and against seconds (right)."""
    drawn = figure(8.4, 3.6, columns=2)
    names = list(rows)
    for axes, key in zip(drawn.axes, ("spp", "seconds"), strict=True):
        for name, row in rows.items():
            y = np.array(row["relmse"])
            axes.plot(row[key], np.where(y > 0, y, np.nan), label=name, **_look(name, names))
        _log(axes, "samples per pixel" if key == "spp" else "seconds", "relMSE")
        axes.axhline(target, color=GREY, lw=0.8, ls="--")
    first = next(iter(rows.values()), None)
    if first is not None:
        spp = np.array(first["spp"], float)
        drawn.axes[0].plot(spp, first["relmse"][0] * spp[0] / spp, color=GREY, lw=0.8,
                           label="slope -1")  # fmt: skip
        drawn.axes[0].legend(frameon=False, fontsize=8)
    return drawn


def panels(
    groups: Sequence[tuple[str, str, Mapping[str, Sequence[tuple[float, float]]]]], unit: str
) -> Figure:
    """A logarithmic panel for each (title, name of x, series of points)."""
    columns = min(len(groups), 3)
    rows = -(-len(groups) // columns)
    drawn = figure(8.4, 0.4 + 2.5 * rows, columns, rows)
    for axes, (title, x, series) in zip(drawn.axes, groups, strict=False):
        names = list(series)
        for name, points in series.items():
            axes.plot(*zip(*points, strict=True), label=name, **_look(name, names))
        y = [value for points in series.values() for _, value in points]
        middle = (min(y) * max(y)) ** 0.5
        reach = max(1.3 * max(y) / middle, 10**0.5)  # a decade at least: noise is to look small
        axes.set_ylim(middle / reach, middle * reach)
        _log(axes, x, unit)
        axes.set_title(title, fontsize=8)
        axes.legend(frameon=False, fontsize=7)
    for axes in drawn.axes[len(groups) :]:
        axes.set_axis_off()
    return drawn


def depths(groups: Sequence[tuple[str, Sequence[Mapping[str, Any]]]]) -> Figure:
    """Share of live rays (left) and milliseconds (right) by depth."""
    drawn = figure(8.4, 3.4, columns=2)
    for k, (title, rows) in enumerate(groups):
        look = {"color": (BLUE, ORANGE, GREEN)[k % 3], "marker": _MARKS[k // 3 % 5], "ms": 3,
                "lw": 1.2, "label": title}  # fmt: skip
        depth = [row["depth"] for row in rows]
        for axes, key, scale in zip(drawn.axes, ("share", "seconds"), (100, 1e3), strict=True):
            values = [scale * row[key] if row[key] else np.nan for row in rows]
            axes.plot(depth, values, **look)
    for axes, label in zip(drawn.axes, ("live rays, %", "ms"), strict=True):
        axes.set_xlabel("depth")
        axes.set_ylabel(label)
        _decades(axes, "y")
    drawn.axes[0].legend(frameon=False, fontsize=8)
    return drawn


def gaps(groups: Sequence[tuple[str, Mapping[str, Sequence[float]], Sequence[float]]]) -> Figure:
    """A panel for each (title, milliseconds of each bounce by strategy, share of live rays)."""
    looks = ((GREY, "o"), (BLUE, "s"), (ORANGE, "^"), (GREEN, "d"), ("black", "v"))
    drawn = figure(8.4, 0.4 + 2.6 * -(-len(groups) // 2), 2, -(-len(groups) // 2))
    for axes, (title, strategies, share) in zip(drawn.axes, groups, strict=False):
        shown = range(1, min(len(share), 12) + 1)
        for (name, ms), (colour, mark) in zip(strategies.items(), looks, strict=False):
            axes.plot(shown, ms[: len(shown)], color=colour, marker=mark, ms=3, lw=1.2, label=name)
        # what the first strategy's first bounce would cost in proportion to the living rays
        first = next(iter(strategies.values()))[0]
        axes.plot(shown, [first * x or np.nan for x in share[: len(shown)]], color=GREY, lw=0.8,
                  ls="--", label="live rays, in scale")  # fmt: skip
        axes.set_xlabel("bounce")
        axes.set_ylabel("ms")
        axes.set_ylim(first / 60, first * 4)
        _decades(axes, "y")
        axes.set_xticks(shown)
        axes.set_title(title, fontsize=8)
    drawn.axes[0].legend(frameon=False, fontsize=7)
    for axes in drawn.axes[len(groups) :]:
        axes.set_axis_off()
    return drawn


def efficiency(groups: Sequence[tuple[str, Sequence[tuple[str, float, float]]]]) -> Figure:
    """A line for each (title, points); a point is a name, a number and its standard error."""
    drawn = figure(8.4, 3.4)
    axes = drawn.axes[0]
    names = list(dict.fromkeys(name for _, points in groups for name, _, _ in points))
    for k, (title, points) in enumerate(groups):
        at = [names.index(name) for name, _, _ in points]
        axes.errorbar(at, [y for _, y, _ in points], [e for _, _, e in points], label=title,
                      color=(BLUE, ORANGE, GREEN)[k % 3], marker=_MARKS[k // 3 % 5], ms=4, lw=1.2,
                      capsize=2)  # fmt: skip
    axes.set_xticks(range(len(names)), names)
    axes.set_ylim(0)
    axes.set_xlabel("roulette from vertex")
    axes.set_ylabel("efficiency against rr_depth 5")
    axes.legend(frameon=False, fontsize=8)
    return drawn
