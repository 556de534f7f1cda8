"""Plots of the benchmark report: lists of figures of one panel each, legends above the axes."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Any

import numpy as np

from veriray.html import BLUE, GREEN, GREY, INK, LINE, ORANGE, PANEL, figure, legend

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


def _fainter(axes: Axes) -> None:
    axes.grid(color=LINE, lw=0.6)
    axes.set_axisbelow(True)


def dots(groups: Sequence[tuple[str, str, Mapping[str, float]]], unit: str) -> list[Figure]:
    """A panel for each device, logarithmic: a point with its value for each contestant.

    groups: (device, scenario, value by contestant).
    """
    names = list(dict.fromkeys(name for _, _, values in groups for name in values))
    out = []
    for device in dict.fromkeys(device for device, _, _ in groups):
        own = [(label, values) for d, label, values in groups if d == device and values]
        if not own:
            continue
        out.append(figure(height=0.8 + sum(0.2 * len(values) + 0.2 for _, values in own)))
        axes = out[-1].axes[0]
        place, ticks = 0.0, []
        for label, values in own:
            ticks.append((place + (len(values) - 1) / 2, label))
            for name, value in values.items():
                axes.plot([value], [place], **{**_look(name, names), "ms": 6})
                axes.annotate(f"{name} {value:,.4g}" if value < 1e4 else f"{name} {value:,.0f}",
                              (value, place), xytext=(7, 0), va="center",
                              textcoords="offset points", fontsize=8)  # fmt: skip
                place += 1
            place += 1
        shown = [v for _, values in own for v in values.values()]
        low, high = min(shown), max(shown)
        # the rest of the panel is for the text of the largest
        axes.set_xlim(low / 1.5, high * max(4.0, 1.5 * (high / low) ** 0.9))
        _decades(axes, "x")
        axes.set_xticks([tick for tick in axes.get_xticks() if low / 1.5 <= tick <= high * 1.5])
        axes.set_yticks([p for p, _ in ticks], [label for _, label in ticks], fontsize=8)
        axes.grid(axis="x", color=LINE, lw=0.6)
        axes.set_axisbelow(True)
        axes.invert_yaxis()
        axes.set_xlabel(unit)
        axes.set_title(device, fontsize=9, loc="left")
    return out


def curves(rows: Mapping[str, Mapping[str, Any]], target: float) -> list[Figure]:
    """RelMSE against samples, times the samples, and against seconds.

    A row has lists spp, seconds and relmse, and the text of its slope. The second panel shows
    slopes: independent samples make a level line, a slope of -1.1 falls.
    """
    panels = [figure(height=3.5), figure(height=3.5), figure(height=3.5)]
    names = list(rows)
    keys = (("spp", "samples per pixel"), ("spp", "samples per pixel"), ("seconds", "seconds"))
    for k, (drawn, (key, x)) in enumerate(zip(panels, keys, strict=True)):
        axes = drawn.axes[0]
        largest = 0.0
        for name, row in rows.items():
            y, spp = np.array(row["relmse"]), np.array(row["spp"], float)
            y = np.where(y > 0, y, np.nan)
            known = np.flatnonzero(np.isfinite(y))
            if k == 1 and known.size:
                y = y * spp / (y * spp)[known[0]]
                largest = max(largest, float(np.nanmax(y)), 1 / float(np.nanmin(y)))
            label = f"{name}, slope {row['slope']}" if k == 1 else name
            axes.plot(row[key], y, label=label, **_look(name, names))
        if k == 1:
            axes.axhline(1, color=GREY, lw=0.8)
            reach = max(1.2 * largest, 2.0)
            axes.set_ylim(1 / reach, reach)
            _log(axes, x, "relMSE x spp, first point = 1")
        else:
            _log(axes, x, "relMSE")
            axes.axhline(target, color=GREY, lw=0.8, ls="--", label=f"target {target:g}")
        first = next((r for r in rows.values() if r["relmse"][0] > 0), None)
        if k == 0 and first is not None:
            spp = np.array(first["spp"], float)
            axes.plot(spp, first["relmse"][0] * spp[0] / spp, color=GREY, lw=0.8, label="slope -1")
        _fainter(axes)
        legend(axes, 1 if k == 1 else 2)
    return panels


def panels(
    groups: Sequence[tuple[str, str, Mapping[str, Sequence[tuple[float, float]]]]], unit: str
) -> list[Figure]:
    """A logarithmic panel for each (title, name of x, series of points)."""
    out = []
    for title, x, series in groups:
        names = list(series)
        out.append(figure())
        axes = out[-1].axes[0]
        for name, points in series.items():
            axes.plot(*zip(*points, strict=True), label=name, **_look(name, names))
        y = [value for points in series.values() for _, value in points]
        middle = (min(y) * max(y)) ** 0.5
        reach = max(1.3 * max(y) / middle, 10**0.5)  # a decade at least: noise is to look small
        axes.set_ylim(middle / reach, middle * reach)
        _log(axes, x, unit)
        _titled(out[-1], title)
    return out


def _titled(drawn: Figure, title: str) -> None:
    """A panel with a title, its legend below that, and a grid."""
    _fainter(drawn.axes[0])
    legend(drawn.axes[0])
    drawn.suptitle(title, fontsize=9, x=0.02, ha="left", color=INK, parse_math=False)


def depths(groups: Sequence[tuple[str, Sequence[Mapping[str, Any]]]]) -> list[Figure]:
    """Share of live rays, and milliseconds, by depth."""
    out = []
    for key, scale, label in (("share", 100, "live rays, %"), ("seconds", 1e3, "ms")):
        out.append(figure(PANEL[0], PANEL[1] + 0.12 * len(groups)))
        axes = out[-1].axes[0]
        for k, (title, rows) in enumerate(groups):
            values = [scale * row[key] if row[key] else np.nan for row in rows]
            axes.plot([row["depth"] for row in rows], values, color=(BLUE, ORANGE, GREEN)[k % 3],
                      marker=_MARKS[k // 3 % 5], ls=_LINES[k // 3 % 4], ms=3, lw=1.2,
                      label=title)  # fmt: skip
        axes.set_xlabel("depth")
        axes.set_ylabel(label)
        _decades(axes, "y")
        _fainter(axes)
        legend(axes)
    return out


def gaps(
    groups: Sequence[tuple[str, Mapping[str, Sequence[float]], Sequence[float]]],
) -> list[Figure]:
    """A panel for each (title, milliseconds of each bounce by strategy, share of live rays)."""
    looks = ((GREY, "o"), (BLUE, "s"), (ORANGE, "^"), (GREEN, "d"), (INK, "v"))
    out = []
    for title, strategies, share in groups:
        out.append(figure(height=3.6))
        axes = out[-1].axes[0]
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
        _titled(out[-1], title)
    return out


def efficiency(groups: Sequence[tuple[str, Sequence[tuple[str, float, float]]]]) -> list[Figure]:
    """A line for each (title, points); a point is a name, a number and its standard error."""
    drawn = figure(height=PANEL[1] + 0.12 * len(groups))
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
    _fainter(axes)
    legend(axes)
    return [drawn]
