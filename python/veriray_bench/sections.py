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

    def without(self, column: str) -> Table:
        """The table without a column of that name; as it is if there is none."""
        kept = [k for k, name in enumerate(self.columns) if name != column]
        columns = [self.columns[k] for k in kept]
        return Table(columns, [[row[k] for k in kept] for row in self.rows])


@dataclass
class Section:
    """A part of the report."""

    title: str
    text: str = ""
    tables: list[Table] = field(default_factory=list)
    plots: list[tuple[str, list[Figure]]] = field(default_factory=list)


def of_kind(results: Sequence[Result], kind: str) -> Iterator[tuple[str, str, Result]]:
    """(device, scenario, its result) of all results of a kind that have one."""
    for result in results:
        for name, row in result["scenarios"].items():
            if row["kind"] == kind and "error" not in row:
                yield result["device"]["name"], name, row


def ratio_by(results: Sequence[Result], device: str) -> str:
    """The time that ratios on a device are of."""
    found = next(r for r in results if r["device"]["name"] == device)
    by: str = found["settings"]["ratio_by"]
    return by


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
        "Compaction of ended paths",
        "Ways to handle the gaps that ended paths leave after a bounce (`veriray bench "
        "compaction`); lanes: share of the launched threads whose path was alive; closing gaps: "
        "share of the time.",
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
            "Milliseconds of each bounce of a wave of one sample per pixel, compaction "
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
    columns = ("device", "scenario", "samples", " paths per pixel", " seconds", " worst tile",
               " fewer paths, less time")  # fmt: skip
    return Section(
        "Adaptive sampling at equal error",
        "`--target-error` against as many uniform samples as bring the worst tile of 16 x 16 "
        "pixels to the same relative standard error.",
        [Table(columns, rows)] if rows else [],
    )


def variants_section(results: Sequence[Result]) -> Section:
    """Scenarios of kind "variants"."""
    out = Section("The scene's own code against code for everything")
    rows = []
    for device, name, result in of_kind(results, "variants"):
        for who, row in result["rows"].items():
            if "void" in row:
                rows.append([device, name, who, "void", *["-"] * 7])
                continue
            use, times = row["kernel"], row.get("times_faster")
            by = ratio_by(results, device)
            rows.append([
                device, name, who, num(row["mpaths_per_second"]),
                f"{100 * row['spread'][by]:.1f} %",
                with_unit(times and times[by]["median"], "x"),
                *(num(use.get(key)) for key in ("registers", "local_bytes", "resident_threads")),
                str(row["path_bytes"]),
                _short(row["variant"], result["rows"]["everything"]["variant"]),
            ])  # fmt: skip
        out.text = (
            "The smallest compiled variant that holds what the scene has, and the one that holds "
            "everything, in alternating rounds; both draw one film, bit for bit, or the row is "
            "void. Registers and local memory (spills, the tree's stack) are a thread's, resident "
            "threads a multiprocessor's, of the kernel that traces paths. Bytes that schedulers "
            "which store paths keep for each in flight, and for a feature more: "
            + ", ".join(f"{k} {n}" for k, n in result["path_bytes"].items()) + "."
        )  # fmt: skip
    columns = ("device", "scenario", "variant", " Mpaths/s", " spread", " exact is faster",
               " registers", " local bytes", " resident threads", " bytes per path",
               "compiled in")  # fmt: skip
    out.tables = [Table(columns, rows)] if rows else []
    return out


def cost_section(results: Sequence[Result]) -> Section:
    """Scenarios of kind "cost"."""
    rows = []
    for device, name, result in of_kind(results, "cost"):
        by = ratio_by(results, device)
        for who, row in result["rows"].items():
            if "void" in row:
                rows.append([device, name, who, "absent" if row.get("absent") else "void",
                             *["-"] * 3])  # fmt: skip
                continue
            ratio = row.get("times_faster", {}).get(by, {}).get("median")
            rows.append([device, name, who, num(1e3 * row[by]), num(row["mpaths_per_second"]),
                         num(row.get("rays_per_path")), with_unit(ratio, "x")])  # fmt: skip
    columns = ("device", "scenario", "renderer and surfaces", " ms", " Mpaths/s", " rays per path",
               " veriray is faster")  # fmt: skip
    return Section(
        "What surfaces cost",
        "The same box with matt, textured (every wall) and rough surfaces, in alternating rounds.",
        [Table(columns, rows)] if rows else [],
    )


def _short(names: Sequence[str], everything: Sequence[str]) -> str:
    """Features in words; those that are missing where they are fewer."""
    missing = [name for name in everything if name not in names]
    if not missing:
        return "everything"
    few = len(missing) < len(names)
    return "all but " + ", ".join(missing) if few else ", ".join(names)


def roulette_section(results: Sequence[Result]) -> Section:
    """Scenarios of kind "roulette"."""
    out = Section(
        "Where roulette starts",
        "Roulette by throughput from the vertex rr_depth on. Efficiency is 1 / (time x MSE) in "
        "multiples of that of rr_depth 5: geometric mean of the rounds, each against its own, and "
        "the standard error of that mean; MSE and relMSE against a converged picture. A row is "
        "void where its mean is not that picture's.",
    )
    rows, curves = [], []
    for device, name, result in of_kind(results, "roulette"):
        points = []
        for who, row in result["rows"].items():
            if "void" in row:
                rows.append([device, name, who, "void", *["-"] * 6])
                continue
            gain, error = row["efficiency"]["mse"]
            points.append((who.removeprefix("rr_depth "), gain, error))
            best = " (best)" if who == result["figures"].get("winner") else ""
            spp = result["settings"]["spp"][0]
            rows.append([
                device, name, who + best, num(1e3 * row[ratio_by(results, device)] / spp),
                f"{row['rays_per_path']:.2f}", num(row["mse"]), num(row["relmse"]),
                *("{:.3f} \u00b1 {:.3f}".format(*row["efficiency"][k]) for k in ("mse", "relmse")),
                f"{max(abs(z) for z in row['agreement']['z']):.1f}",
            ])  # fmt: skip
        curves.append((f"{name}, {device}", points))
    columns = ("device", "scenario", "start", " ms per sample", " rays per path", " MSE", " relMSE",
               " efficiency", " by relMSE", " |z| of means")  # fmt: skip
    if rows:
        out.tables.append(Table(columns, rows))
        out.plots.append(("Efficiency by start depth, with standard errors",
                          plots.efficiency(curves)))  # fmt: skip
    return out
