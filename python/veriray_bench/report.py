"""The report of benchmark results: verdict on the targets, tables, plots; HTML or Markdown."""

from __future__ import annotations

import os
from collections.abc import Sequence
from pathlib import Path

from veriray import html
from veriray.errors import visible
from veriray.files import replacing

from . import plots
from .matrix_report import matrix_line, matrix_sections
from .run import read
from .scenarios import Scenario
from .sections import (
    Section,
    Table,
    adaptive_section,
    compaction_section,
    cost_section,
    num,
    of_kind,
    ratio_by,
    roulette_section,
    variants_section,
    with_unit,
)
from .targets import DISTURBED, Result, disturbed, judge, targets, verdict, void_rows

SUFFIXES = (".html", ".md")
_TEMPLATE = Path(__file__).with_name("report.html.j2")


def find(paths: Sequence[str | os.PathLike[str]]) -> list[Result]:
    """The results in files and folders (bench_*.json, matrix_*.json); ValueError or OSError naming
    the path.
    """
    files: list[Path] = []
    for path in map(Path, paths):
        names = ("bench_*.json", "matrix_*.json")
        inside = [f for n in names for f in sorted(path.glob(n))] if path.is_dir() else [path]
        if not inside:
            raise ValueError(f"{path}: no bench_*.json and no matrix_*.json inside")
        files += inside
    return [read(path) for path in files]


def save(results: Sequence[Result], path: str | os.PathLike[str]) -> None:
    """Write the report by its suffix; each file appears whole or not at all.

    Markdown has its plots as PNG files in a folder beside it. Raises ValueError for another suffix.
    """
    target = Path(path)
    if target.suffix.lower() not in SUFFIXES:
        raise ValueError(f"{os.fspath(path)}: unknown suffix; expected {' or '.join(SUFFIXES)}")
    if target.suffix.lower() == ".html":
        text = to_html(results)
    else:
        text = to_markdown(results, target.with_name(f"{target.stem}_plots"))
    with replacing(target) as file:
        file.write(visible(text).encode())


# ---- sections ----


def sections(results: Sequence[Result]) -> list[Section]:
    """The report's parts; of one device its name is in the verdict and in the last part alone."""
    parts = [
        part
        for part in (
            *matrix_sections(results), _targets(results), _void(results), _speed(results),
            _error(results),
            _scaling(results), _depth(results), compaction_section(results),
            variants_section(results), roulette_section(results), cost_section(results),
            adaptive_section(results), _rest(results), _facts(results),
        )
        if part.tables or part.plots
    ]  # fmt: skip
    if len({result["device"]["name"] for result in results}) == 1:
        for part in parts[:-1]:
            part.tables = [table.without("device") for table in part.tables]
    return parts


def _targets(results: Sequence[Result]) -> Section:
    rows = []
    for t in targets(results):
        unit, sign = t["target"].unit, "at most " if t["target"].below else "at least "
        far = "-" if t["reached"] is None else f"{100 * t['reached']:.0f} %"
        rows.append([
            t["state"], t["device"], t["scenario"].name, t["target"].what,
            with_unit(t["value"], unit), far, sign + with_unit(t["goal"], unit),
            with_unit(t["moonshot"], unit),
            t["why"] or (f"in doubt: {t['doubt']}" if t["doubt"] else ""),
        ])  # fmt: skip
    columns = ("", "device", "scenario", "what", " measured", " reached", " target", " moonshot",
               "why")  # fmt: skip
    if not any(row[-1] for row in rows):
        columns, rows = columns[:-1], [row[:-1] for row in rows]
    return Section(
        "Targets",
        "Ratios compare renderers in one run, alternating, on the same scene file. Reached is the "
        "share of the target: it is met at 100 %.",
        [Table(columns, rows)] if rows else [],
    )


def _void(results: Sequence[Result]) -> Section:
    rows = []
    for result in results:
        device = result["device"]["name"]
        missing = {name: about["missing"] for name, about in result["peers"].items()
                   if "missing" in about}  # fmt: skip
        rows += [["absent", device, "all", name, why] for name, why in missing.items()]
        for name, row in result["scenarios"].items():
            rows += [["void", device, name, who or "all", why] for who, why in void_rows(row)]
            rows += [["absent", device, name, who, why] for who, why in void_rows(row, True)
                     if who.split()[0] not in missing]  # fmt: skip
            cores = disturbed(row)
            if result["build"]["backend"] == "cpu" and cores > DISTURBED:
                rows.append(["in doubt", device, name, "all", f"others used {cores:.2g} cores"])
    columns = ("", "device", "scenario", "renderer", "why")
    return Section(
        "Void, absent, in doubt",
        "A row is void where the means of the pictures differ by more than chance and the stated "
        "margin, where a film of ours is not the same, or where a renderer failed: no time is "
        f"quoted. Times on a CPU are in doubt where others used more than {DISTURBED} cores.",
        [Table(columns, rows)] if rows else [],
    )


def _speed(results: Sequence[Result]) -> Section:
    rows = []
    for device, name, result in of_kind(results, "speed"):
        s, by = result["settings"], ratio_by(results, device)
        label = f"{name}, {s['width']}x{s['height']}, {s['spp'][0]} spp"
        for who, row in result["rows"].items():
            if "void" in row:
                rows.append([device, label, who, _none(row), *["-"] * 7])
                continue
            ratio, by_cpu = (row.get("times_faster", {}).get(key, {}).get("median")
                             for key in (by, "cpu"))  # fmt: skip
            rows.append([
                device, label, who, num(row["mpaths_per_second"]),
                f"{100 * row['spread'][by]:.1f} %", num(row["mpaths_per_cpu_second"]),
                with_unit(ratio, "x"), with_unit(None if by == "seconds" else by_cpu, "x"),
                with_unit(row.get("percent_of_limit"), "%"),
                f"{row['seconds_to_first_sample']:.2f}" if "seconds_to_first_sample" in row else "",
                _agreement(row),
            ])  # fmt: skip
    columns = ("device", "scenario", "renderer", " Mpaths/s", " spread", " a CPU-s", " veriray",
               " by CPU time", " of limit", " first, s", " means")  # fmt: skip
    out = Section(
        "Samples per second",
        "Medians of alternating rounds; spread is largest less smallest over the median. Times end "
        "with the film in device memory on CUDA, with the picture in memory on the CPU. Means: the "
        "relative difference of the pictures' means and its largest |z|. Veriray: how many times "
        "faster it is; first: seconds to read the file and draw one sample per pixel.",
        [Table(columns, rows)] if rows else [],
    )
    if rows:
        out.plots.append((
            "Samples per second; void rows are left out",
            plots.dots([(device, name, {who: row["mpaths_per_second"]
                         for who, row in r["rows"].items() if "void" not in row})
                        for device, name, r in of_kind(results, "speed")], "Mpaths/s"),
        ))  # fmt: skip
    return out


def _none(row: Result) -> str:
    return "absent" if row.get("absent") else "void"


def _agreement(row: Result) -> str:
    known = row.get("agreement")
    if not known:
        return ""
    far = max(known["relative_difference"], key=abs)
    return f"{far:+.1e}, {max(abs(z) for z in known['z']):.1f}"


def _error(results: Sequence[Result]) -> Section:
    rows, out = [], Section("Time against error")
    for device, name, result in of_kind(results, "error"):
        curves = {}
        by = ratio_by(results, device)
        for who, row in result["rows"].items():
            if "void" in row:
                rows.append([device, name, who, _none(row), *["-"] * 5])
                continue
            last = row["points"][-1]
            slope, error = row["slope"]["relmse"], row.get("slope_error", {}).get("relmse")
            steep = (
                "-" if slope is None else f"{slope:.3f}" + (f" \u00b1 {error:.3f}" if error else "")
            )
            curves[who] = {
                "slope": steep,
                "spp": [p["spp"] for p in row["points"]],
                "seconds": [p[by] for p in row["points"]],
                "relmse": [p["relmse"] for p in row["points"]],
            }
            mark = " (extrapolated)" if row["extrapolated"] else ""
            rows.append([
                device, name, who, f"{last['relmse']:.3g} at {last['spp']} spp",
                f"{last['mse']:.3g}", steep,
                with_unit(row["seconds_to_target"], "s") + mark, num(row["efficiency"]),
                _agreement(row),
            ])  # fmt: skip
        ratio = result["figures"].get("times_faster_to_target")
        best = result["figures"].get("best_mitsuba")
        told = f"; time of {best} over ours to relMSE 1e-3: {ratio:.3g}" if ratio else ""
        out.plots.append((
            f"{result['title']}, {device}{told}", plots.curves(curves, result["target_relmse"])
        ))  # fmt: skip
    columns = ("device", "scenario", "renderer and sampler", " relMSE", " MSE", " slope",
               " to relMSE 1e-3", " 1/(MSE s)", " means")  # fmt: skip
    out.tables = [Table(columns, rows)] if rows else []
    out.text = (
        "relMSE = mean (I-R)^2/(R^2 + 0.01) against a converged picture R of ours, whose own "
        "variance is taken off. The slope is that of log relMSE against log spp by least squares, "
        "with its standard error: -1 for independent samples. Times the samples, relMSE shows it: "
        "level for -1, falling where a sampler does better. The time to relMSE 1e-3 is "
        "interpolated in logarithms."
    )
    return out


def _scaling(results: Sequence[Result]) -> Section:
    found = list(of_kind(results, "scaling"))
    out = Section("Scaling", "Samples per second along one setting, all else fixed.")
    rows = []
    panels = []
    for device, name, result in found:
        series: dict[str, list[tuple[float, float]]] = {}
        for point in result["points"]:
            good = {w: r for w, r in point["rows"].items() if "void" not in r}
            for who, row in good.items():
                series.setdefault(who, []).append((point["value"], row["mpaths_per_second"]))
            rates = ", ".join(f"{w} {num(r['mpaths_per_second'])}" for w, r in good.items())
            own = point["rows"]["veriray"]
            built = own["tree"].get("seconds")
            rows.append([device, name, f"{point['value']:,}", rates, num(own["seconds"]),
                         num(built), f"{own['memory'] / 2**20:,.1f}"])  # fmt: skip
        panels.append((f"{name}, {device}", result["varies"], series))
    if rows:
        columns = ("device", "scenario", " value", "Mpaths/s", " veriray s", " tree s", " MiB")
        out.tables.append(Table(columns, rows))
        out.plots.append(("Samples per second", plots.panels(panels, "Mpaths/s")))
    return out


def _depth(results: Sequence[Result]) -> Section:
    found = list(of_kind(results, "depth"))
    out = Section(
        "Live rays and time by depth",
        "One sample per pixel with the scheduler `thrust`, which compacts the rays after every "
        "bounce: rays alive after bounce d as a share of all paths, and the time of the bounce.",
    )
    rows = []
    for device, name, result in found:
        table = result["table"]["rows"]
        total = sum(row["seconds"] or 0 for row in table) / 100 or None
        for row in table[:10]:
            rows.append([device, name, str(row["depth"]), f"{row['live']:,}",
                         f"{row['blocks']:,}" if row["blocks"] else "-",
                         f"{100 * row['share']:.3g} %",
                         num(None if row["seconds"] is None else 1e3 * row["seconds"]),
                         with_unit(total and (row["seconds"] or 0) / total, "%")])  # fmt: skip
    if rows:
        columns = ("device", "scenario", " depth", " live rays", " blocks", " share", " ms",
                   " of the time")  # fmt: skip
        out.tables.append(Table(columns, rows))
        out.plots.append(("Live rays and time by depth", plots.depths(
            [(f"{name}, {device}", r["table"]["rows"]) for device, name, r in found]
        )))  # fmt: skip
    return out


def _rest(results: Sequence[Result]) -> Section:
    rows = []
    for device, _, result in of_kind(results, "cold"):
        for who, row in result["rows"].items():
            times = (_none(row), "") if "void" in row else (
                f"{row['seconds']:.2f} s", f"first run {row['first']:.2f} s"
            )  # fmt: skip
            rows.append([device, result["title"], who, *times])
    for device, _, result in of_kind(results, "build"):
        for who, row in result["rows"].items():
            more = f"scene with tables and copies {row['scene_seconds']:.3g} s"
            if "first_picture_seconds" in row:
                more += (f", to a picture of 1 spp {row['first_picture_seconds']:.3g} s, then "
                         f"{row['mpaths_per_second']:,.0f} Mpaths/s")  # fmt: skip
            rows.append([device, result["title"], f"veriray, {who}",
                         f"{row['tree_seconds']:.3g} s", more])  # fmt: skip
    for device, _, result in of_kind(results, "memory"):
        for spp, row in result["rows"].items():
            more = f"scene and film {row['runs'][0]['scene_and_film'] / 2**20:.1f} MiB"
            rows.append([device, result["title"], f"veriray, {spp} spp",
                         f"{row['peak_rss'] / 2**20:.1f} MiB", more])  # fmt: skip
    columns = ("device", "scenario", "renderer", " median", "")
    return Section("Start, build, memory", "", [Table(columns, rows)] if rows else [])


def _facts(results: Sequence[Result]) -> Section:
    rows = []
    for result in results:
        device, m, measured = result["device"], result["machine"], result["scenarios"]
        seconds = sum(row["measured_seconds"] for row in measured.values())
        rows += [[device["name"], name, text] for name, text in (
            ("device", device["description"]),
            ("machine", f"{m.get('model_name', m['processor'])}, {m['cpus']} processors, "
                        f"{m.get('memory_gib', '?')} GiB, {m['system']}"),
            ("commit", (result["commit"] or "unknown") + (" and changes" if result["modified"]
                                                          else "")),
            ("versions", ", ".join(f"{k} {v}" for k, v in result["versions"].items() if v)),
            ("peers", "; ".join(f"{k}: {v.get('missing') or ' '.join(map(str, v.values()))}"
                                for k, v in result["peers"].items()) or "none asked for"),
            ("measured", f"{result['time']}, {len(measured)} scenarios, {seconds:,.0f} s"),
            ("limit", result["settings"]["limit"]),
        )]  # fmt: skip
    return Section("What was run", "", [Table(("device", "", ""), rows)])


# ---- formats ----


def to_html(results: Sequence[Result]) -> str:
    """One page that loads nothing and has no script; the results are inside as JSON."""
    shown = [
        {"title": s.title, "text": s.text, "tables": s.tables,
         "plots": [(caption, [html.svg(f) for f in figures]) for caption, figures in s.plots]}
        for s in sections(results)
    ]  # fmt: skip
    return html.page(_TEMPLATE, *verdict(results), html.as_json(list(results)), sections=shown)


def to_markdown(results: Sequence[Result], folder: Path) -> str:
    """Markdown text; its plots are written to `folder`."""
    result, sentence = verdict(results)
    lines = ["# veriray bench", "", f"**{result.upper()}**: {sentence}"]
    count = 0
    for section in sections(results):
        lines += ["", f"## {section.title}", "", *([section.text, ""] if section.text else [])]
        for k, table in enumerate(section.tables):
            lines += [""] * (k > 0)
            lines.append("| " + " | ".join(c.strip() for c in table.columns) + " |")
            marks = ("--:" if c.startswith(" ") else "---" for c in table.columns)
            lines.append("| " + " | ".join(marks) + " |")
            for row in table.rows:
                cells = (c.replace("|", "\\|").replace("\n", " ") for c in row)
                lines.append("| " + " | ".join(cells) + " |")
        for caption, figures in section.plots:
            lines.append("")
            for figure in figures:
                count += 1
                folder.mkdir(exist_ok=True)
                name = f"{count:02}.png"
                with replacing(folder / name) as file:
                    figure.savefig(file, format="png")
                lines.append(f"![{caption}]({folder.name}/{name})")
            lines += ["", f"*{caption}.*"]
    return "\n".join(lines) + "\n"


def line(scenario: Scenario, row: Result, backend: str) -> str:
    """A scenario's result in one line, for the terminal."""
    if row["kind"] == "matrix":
        return matrix_line(scenario.name, row)
    parts = []
    for who, entry in row.get("rows", {}).items():
        if "mpaths_per_second" in entry:
            parts.append(f"{who} {num(entry['mpaths_per_second'])} Mpaths/s")
        elif entry.get("seconds_to_target"):
            parts.append(f"{who} {num(entry['seconds_to_target'])} s to relMSE 1e-3")
        elif "seconds" in entry:
            parts.append(f"{who} {num(entry['seconds'])} s")
    if "points" in row:
        rates = [p["rows"]["veriray"]["mpaths_per_second"] for p in row["points"]]
        parts.append(f"veriray {num(min(rates))} to {num(max(rates))} Mpaths/s")
    if row["kind"] in ("variants", "roulette", "cost"):
        parts += [f"{key} {v if isinstance(v, str) else num(v)}" for key, v in
                  row.get("figures", {}).items()]  # fmt: skip
    for target in scenario.targets:
        if backend in target.goals:
            t = judge(target, backend, row)
            parts.append(f"{target.what} {with_unit(t['value'], target.unit)}: {t['state']} "
                         f"(target {with_unit(t['goal'], target.unit)})")  # fmt: skip
    parts += [f"VOID {who}: {why}" if who else f"VOID: {why}" for who, why in void_rows(row)]
    parts += [f"no {who}: {why}" for who, why in void_rows(row, absent=True)]
    return f"{scenario.name}: " + "; ".join(parts or ["done"])
