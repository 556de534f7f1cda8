"""Parts of the report: tables and sections, and those of the studies of veriray alone."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field
from typing import TYPE_CHECKING

from . import compaction, plots
from .targets import Result

if TYPE_CHECKING:
    from matplotlib.figure import Figure


@dataclass
class Table:
    """Cells as text; columns whose name starts with a space hold numbers."""

    columns: Sequence[str]
    rows: list[list[str]]


@dataclass
class Section:
    """A part of the report."""

    title: str
    text: str = ""
    tables: list[Table] = field(default_factory=list)
    plots: list[tuple[str, Figure]] = field(default_factory=list)


def of_kind(results: Sequence[Result], kind: str) -> Iterator[tuple[str, str, Result]]:
    """(device, scenario, its result) of all results of a kind that have one."""
    for result in results:
        for name, row in result["scenarios"].items():
            if row["kind"] == kind and "error" not in row:
                yield result["device"]["name"], name, row


def num(value: float | None, digits: int = 3) -> str:
    """A number with so many digits; "-" for None."""
    if value is None:
        return "-"
    return f"{value:,.0f}" if abs(value) >= 10**digits else f"{value:.{digits}g}"


def with_unit(value: float | None, of: str) -> str:
    """The same with its unit."""
    return num(value) + (f" {of}" if of and value is not None else "")


def compaction_section(results: Sequence[Result]) -> Section:
    """Scenarios of kind "compaction"."""
    out = Section(
        "Closing the gaps of ended paths",
        "Ways to close the gaps that ended paths leave after a bounce (`veriray bench "
        "compaction`); lanes: share of the launched threads whose path lived; closing gaps: share "
        "of the time.",
    )
    rows: list[list[str]] = []
    columns: tuple[str, ...] = ()
    times = []
    for device, name, result in of_kind(results, "compaction"):
        study = result["study"]
        head, *lines = compaction.summary(study)
        columns = ("device", "scenario", head[0], *(f" {cell}" for cell in head[1:]))
        rows += [[device, name, *line] for line in lines]
        times.append((f"{name}, {device}", {
            row["strategy"]: [
                1e3 * sum(pair) / study["spp"]
                for pair in zip(row["bounce_seconds"], row["compaction_seconds"], strict=True)
            ]
            for row in study["rows"] if "bounce_seconds" in row
        }, [n / study["paths"] for n in study["live_rays"]]))  # fmt: skip
    if rows:
        out.tables.append(Table(columns, rows))
        out.plots.append((
            "Milliseconds of each bounce of a wave of one sample a pixel, closing the gaps "
            "included, and the live rays in proportion to the first bounce without compaction",
            plots.gaps(times),
        ))  # fmt: skip
    return out


def adaptive_section(results: Sequence[Result]) -> Section:
    """Scenarios of kind "adaptive"."""
    rows = []
    for device, name, result in of_kind(results, "adaptive"):
        for who, row in result["rows"].items():
            saved = result["figures"]
            ratio = f"{num(saved['paths_saved'])} x, {num(saved['time_saved'])} x"
            rows.append([device, name, who, f"{row['mean_spp']:,.1f}", num(row["seconds"]),
                         f"{100 * row['worst_tile']:.2f} %",
                         ratio if who == "adaptive" else ""])  # fmt: skip
    columns = ("device", "scenario", "samples", " paths a pixel", " seconds", " worst tile",
               " fewer paths, less time")  # fmt: skip
    return Section(
        "Adaptive sampling at equal error",
        "`--target-error` against as many uniform samples as bring the worst tile of 16 x 16 "
        "pixels to the same relative standard error.",
        [Table(columns, rows)] if rows else [],
    )
