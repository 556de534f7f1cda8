"""The report of a validation: verdict, levels, cases, plots and numbers.

Figures that cases leave (`Trial.figure`) are drawn by their names:

- z: z values. One histogram and quantile plot per level.
- p: p values, or {label: p}. Cells coloured by p.
- cells: {"observed": counts, "expected": counts}, (n,) or (m, n). Chi-square cells.
- slope: {"spp": [...], name: [...] ..., "expected": number}. Error against samples, log-log.
- live: {name: numbers by depth}; "expected" is drawn as a line. Counts or shares, logarithmic.
- picture...: (H, W) or (H, W, 3), linear; or a PNG as a data URI. map...: (H, W), signed.
- table...: {"columns": [...], "rows": [[...], ...]}.

Figures of another name or form are shown as text.
"""

from __future__ import annotations

import json
import os
from collections.abc import Callable, Iterable
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from veriray import __version__, html, showing
from veriray.files import replacing
from veriray.html import BLUE, GREEN, GREY, INK, ORANGE, RED, VIOLET, number, percent
from veriray.image import to_srgb8
from veriray_validate.levels import LEVELS
from veriray_validate.trial import CASES, FIRST, MANY, SECOND, Outcome

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure
    from numpy.typing import NDArray

    from veriray_validate.run import Validation

    Array = NDArray[Any]

SUFFIXES = (".html", ".json")
_TEMPLATE = Path(__file__).with_name("report.html.j2")
_ORDER = ("fail", "error", "inconclusive", "skip", "pass")
_PANELS = 24  # plots of one kind in a level
_SHADES = (BLUE, GREEN, RED, VIOLET)
_TEXT = 400  # characters of a figure shown as text


# ---- verdict and text ----


def verdict(validation: Validation) -> tuple[str, str]:
    """("pass", "fail" or "inconclusive", one sentence)."""
    outcomes = validation.outcomes
    count = {v: [o for o in outcomes if o.verdict == v] for v in _ORDER}
    where = ", ".join(f"{name} ({about})" for name, about in validation.devices.items())
    total = sum(o.samples for o in outcomes)
    samples = f", {_large(total)} samples" if total else ""
    chance = f"once in {_floor(1 / validation.false_alarm):,} times"
    skipped = f"; {_cases(len(count['skip']))} could not run here" if count["skip"] else ""
    if bad := count["fail"] + count["error"]:
        parts = [f"{len(count[v])} {how}" for v, how in
                 (("fail", "failed"), ("error", "ended in an error")) if count[v]]  # fmt: skip
        so = (
            f"chance fails a run like this less than {chance}, so veriray {__version__} or an "
            "expectation of the suite is wrong" if count["fail"] else "nothing is proved"
        )  # fmt: skip
        return "fail", (
            f"Of {_cases(len(outcomes))} on {where}, {' and '.join(parts)}, the first "
            f"{bad[0].id} ({_first_line(bad[0].message)}){skipped}: {so}."
        )
    stage = validation.first_stage()
    how_many = (
        f"{stage['low']} of {stage['of']:,} statistical cases had p < {FIRST:g} in the first "
        f"stage, where chance makes {stage['of'] * FIRST:.2g}, and that many or more with "
        f"probability {stage['p']:.2g}"
    )
    if validation.crowded:
        return "fail", (
            f"No case failed on {where}{skipped}, but {how_many}. That is too many: veriray "
            f"{__version__} is wrong by less than the cases see, or their p values are too small."
        )
    if validation.missing:
        return "inconclusive", (
            f"No verdict: stopped with {_cases(len(validation.missing))} to go, the first "
            f"{validation.missing[0]}; {len(count['pass'])} passed on {where}{skipped}."
        )
    if count["inconclusive"]:
        first = count["inconclusive"][0]
        return "inconclusive", (
            f"No verdict: {len(count['inconclusive'])} of {_cases(len(outcomes))} had too little "
            f"data, the first {first.id} ({_first_line(first.message)}); {len(count['pass'])} "
            f"passed on {where}{skipped}."
        )
    if not count["pass"]:
        return "inconclusive", f"No verdict: nothing could run on {where}{skipped}."
    return "pass", (
        f"veriray {__version__} passed all of {_cases(len(count['pass']))}, each with an answer "
        f"known beforehand, on {where}, seed {validation.seed}{samples}{skipped}; a sound renderer "
        f"fails a run like this less than {chance}" + (f". {how_many}." if stage["of"] else ".")
    )


def headline(validation: Validation) -> dict[str, Any]:
    """The result for who meets the suite for the first time.

    said: the answer in a sentence; agree, failed, undecided, skipped: numbers of cases, of:
    those that ran; chance: what a failure by chance is like; means: what a failure means.
    """
    count = {v: sum(o.verdict == v for o in validation.outcomes) for v in _ORDER}
    agree, of = count["pass"], len(validation.outcomes) - count["skip"]
    failed = count["fail"] + count["error"]
    undecided = count["inconclusive"] + len(validation.missing)
    if failed:
        said = f"{failed:,} of {_cases(of)} did not get the expected answer"
    elif validation.crowded:
        said = "No case failed alone, but taken together too many came close to it"
    elif undecided or not agree:
        said = f"Not decided: {agree:,} of {_cases(of + len(validation.missing))} agree so far"
    elif of == 1:
        said = "The one case that ran agrees with its known answer"
    else:
        said = f"All {_cases(of)} agree with their known answers"
    return {
        "said": said, "agree": agree, "of": of, "failed": failed, "undecided": undecided,
        "skipped": count["skip"], "chance": f"once in {_floor(1 / validation.false_alarm):,} runs",
    }  # fmt: skip


def as_text(validation: Validation) -> str:
    """A line for each level and the verdict."""
    lines = [f"{'level':18} {'cases':>5}  {'verdict':12}  {'smallest bias seen':22} {'seconds':>8}"]
    for row in validation.levels():
        bad = row["fail"] + row["error"]
        shown = f"fail ({bad})" if bad else row["verdict"]
        lines.append(
            f"{row['level']} {row['name']:16} {row['cases']:5}  {shown:12}  "
            f"{_range(row['sees']) or '-':22} {row['seconds']:8.1f}"
        )
    result, sentence = verdict(validation)
    return "\n".join([*lines, f"{result.upper()}: {sentence}"])


def as_table(validation: Validation) -> str:
    """The verdict and a table of the levels, as HTML for notebooks."""
    rows = [
        (f"{row['level']} {row['name']}", row["cases"], row["verdict"], _range(row["sees"]) or "-",
         f"{row['seconds']:.1f}") for row in validation.levels()
    ]  # fmt: skip
    head = ("level", "cases", "verdict", "smallest bias seen", "seconds")
    return showing.table(head, rows, verdict(validation)[1])


def to_json(validation: Validation) -> str:
    """Everything as JSON text, one case per line; numbers that are not finite become null."""
    result, sentence = verdict(validation)
    values = {"result": result, "verdict": sentence, **validation.to_dict()}
    lines = []
    for key, value in html.plain(values).items():
        if key in ("levels", "cases"):
            rows = ",\n".join("  " + json.dumps(row, allow_nan=False) for row in value)
            lines.append(f"{json.dumps(key)}: [\n{rows}\n]")
        else:
            lines.append(f"{json.dumps(key)}: {json.dumps(value, allow_nan=False)}")
    return "{\n" + ",\n".join(lines) + "\n}\n"


def to_html(validation: Validation) -> str:
    """The report as one HTML page, which loads nothing and has no script; it contains `to_json`."""
    result, sentence = verdict(validation)
    outcomes = validation.outcomes
    rows = validation.levels()
    return html.page(
        _TEMPLATE, result, sentence, to_json(validation), head=headline(validation),
        facts=_facts(validation), rows=rows, plots=_plots(outcomes), about=LEVELS,
        first=validation.first_stage(), many=MANY, range=_range,
        threshold=validation.facts.get("second", SECOND),
        unclear=[o for v in _ORDER[:3] for o in outcomes if o.verdict == v][:20],
        levels=[
            _level(row, [o for o in outcomes if o.level == row["level"]]) for row in rows
        ],
    )  # fmt: skip


def save(validation: Validation, path: str | os.PathLike[str]) -> None:
    """Writes `to_html` or `to_json`, by the suffix; the file appears whole or not at all.

    Raises:
        ValueError: another suffix.
        OSError: the file cannot be written (the message names it).
    """
    suffix = Path(path).suffix.lower()
    if suffix not in SUFFIXES:
        raise ValueError(f"{os.fspath(path)}: suffix {suffix!r}; expected .html or .json")
    text = to_json(validation) if suffix == ".json" else to_html(validation)
    with replacing(path) as file:
        file.write(text.encode())


def _cases(count: int) -> str:
    return f"{count:,} case{'' if count == 1 else 's'}"


def _first_line(text: str) -> str:
    return (text.strip().splitlines() or ["no message"])[0]


def _large(count: float) -> str:
    for size, name in ((1e12, "trillion"), (1e9, "billion"), (1e6, "million")):
        if count >= size:
            return f"{count / size:.3g} {name}"
    return f"{count:,.0f}"


def _floor(value: float) -> int:
    """Down to two digits."""
    whole = int(value * (1 + 1e-9))
    step = 10 ** max(len(str(whole)) - 2, 0)
    return whole // step * step


def _range(sees: list[float] | None) -> str:
    if not sees:
        return ""
    low, high = (percent(s) for s in sees)
    return low if low == high else f"{low} to {high}"


# ---- what the page shows ----


def _facts(validation: Validation) -> list[tuple[str, str]]:
    outcomes, known = validation.outcomes, dict(validation.facts)
    commit, effort = known.pop("commit", None), known.pop("effort", 1)
    machine = [known.pop(key, None) for key in ("system", "machine", "cpus", "python")]
    known.pop("first", None), known.pop("second", None)  # the page explains them
    rows = [
        ("devices", "; ".join(f"{n}: {about}" for n, about in validation.devices.items())),
        ("version", __version__ + (f", commit {commit}" if commit else "")),
        ("run", f"{'full' if validation.full else 'quick'}, {effort} times the samples of a case, "
                f"{validation.seconds:.1f} s"),
        ("seed", str(validation.seed)),
        ("samples", f"{sum(o.samples for o in outcomes):,}"),
        ("judgements", f"{sum(o.checks for o in outcomes):,} exact conditions, "
                       f"{sum(o.tests for o in outcomes):,} p values"),
        ("false alarms", f"a sound program fails this run with probability below "
                         f"{validation.false_alarm:.2g}"),
    ]  # fmt: skip
    if any(machine):
        system, processor, cpus, python = machine
        rows.append(("machine", f"{system}, {processor}, {cpus} processors, Python {python}"))
    return rows + [(name, number(value)) for name, value in known.items()]


def _level(row: dict[str, Any], outcomes: list[Outcome]) -> dict[str, Any]:
    families: dict[str, list[Outcome]] = {}
    for o in outcomes:
        families.setdefault(o.id.partition("[")[0], []).append(o)
    blocks = [_family(name, own) for name, own in families.items()]
    blocks.sort(key=lambda block: _ORDER.index(block["verdict"]))
    plots = []
    if z := _z_values(outcomes):
        plots.append(
            (
                "z-scores of this level against the normal law",
                _drawn(html.z_plots(np.array(z), law="normal law")),
            )
        )
    plots += _panels("live", "Live rays by depth; line: expected", outcomes, _draw_live)
    plots += _panels("slope", "Error against samples per pixel", outcomes, _draw_slope)
    return {"row": row, "families": blocks, "plots": plots}


def _family(name: str, outcomes: list[Outcome]) -> dict[str, Any]:
    """The cases of one function."""
    outcomes = sorted(outcomes, key=lambda o: _ORDER.index(o.verdict))
    seen = [o.sees for o in outcomes if o.sees is not None]
    known = CASES.get(outcomes[0].id)
    return {
        "name": name, "title": outcomes[0].title, "expects": known.expects if known else "",
        "verdict": outcomes[0].verdict, "sees": _range([min(seen), max(seen)] if seen else None),
        "smallest": min((o.p for o in outcomes if o.p is not None), default=None),
        "seconds": sum(o.seconds for o in outcomes),
        "cases": [
            {"o": o, "label": o.id[len(name):].strip("[]"), "figures": _figures(o)}
            for o in outcomes
        ],
    }  # fmt: skip


def _figures(outcome: Outcome) -> list[dict[str, Any]]:
    """The figures of a case that are not drawn with those of its level."""
    return [
        drawn for name, value in outcome.figures.items()
        if not _on_level(name, value) for drawn in [_figure(name, value)]
    ]  # fmt: skip


def _on_level(name: str, value: Any) -> bool:
    read = {"z": _numbers, "live": _live, "slope": _slope}.get(name)
    return bool(read and read(value))


def _figure(name: str, value: Any) -> dict[str, Any]:
    """One figure as the template takes it; as text if its form does not fit its name."""
    kinds: tuple[tuple[str, Callable[[Any], dict[str, Any]]], ...] = (
        ("p", _p_cells), ("cells", _chi_cells), ("picture", _picture), ("map", _map),
        ("table", _table),
    )  # fmt: skip
    for prefix, draw in kinds:
        if name == prefix or (name.startswith(prefix) and prefix not in ("p", "cells")):
            try:
                return {"name": name, **draw(value)}
            except (TypeError, ValueError, KeyError, IndexError, AttributeError):
                break
    return {"name": name, "kind": "text", "text": _text(value)}


def _text(value: Any) -> str:
    if isinstance(value, dict):
        text = ", ".join(f"{k}: {_text(v)}" for k, v in value.items())
    elif isinstance(value, (list, tuple)):
        text = " ".join(_text(v) for v in value)
    else:
        text = number(value)
    return text if len(text) <= _TEXT else text[:_TEXT] + " ..."


def _p_cells(value: Any) -> dict[str, Any]:
    pairs = value.items() if isinstance(value, dict) else enumerate(value, 1)
    cells = []
    for label, p in pairs:
        low = [limit for limit in (0.05, 0.01, FIRST) if float(p) < limit]
        cells.append({"label": str(label), "p": f"{float(p):.2g}", "class": f"p{len(low)}"})
    return {"kind": "p", "cells": cells}


def _chi_cells(value: Any) -> dict[str, Any]:
    observed, expected = (np.atleast_2d(np.asarray(value[k], np.float64))
                          for k in ("observed", "expected"))  # fmt: skip
    with np.errstate(divide="ignore", invalid="ignore"):
        off = (observed - expected) / np.sqrt(expected)
    if off.ndim != 2 or not off.size:
        raise ValueError("chi-square cells are a row or a grid")
    return {"kind": "picture", "uri": html.picture(html.tint(off)), "wide": off.shape[1],
            "caption": "(observed - expected) / sqrt(expected), full colour at 4"}  # fmt: skip


def _picture(value: Any) -> dict[str, Any]:
    if isinstance(value, str) and value.startswith("data:image/png;base64,"):
        return {"kind": "picture", "uri": value, "wide": 62, "caption": ""}
    pixels = np.asarray(value, np.float64)
    if pixels.ndim == 2:
        pixels = np.repeat(pixels[..., None], 3, axis=-1)
    finite = pixels[np.isfinite(pixels)]
    if pixels.ndim != 3 or pixels.shape[-1] != 3 or not finite.size:
        raise ValueError("a picture is (H, W) or (H, W, 3)")
    top = float(np.percentile(finite, 95)) or 1.0
    return {"kind": "picture", "uri": html.picture(to_srgb8(pixels / top)),
            "wide": pixels.shape[1], "caption": "white: 95th percentile"}  # fmt: skip


def _map(value: Any) -> dict[str, Any]:
    values = np.atleast_2d(np.asarray(value, np.float64))
    if values.ndim != 2 or not values.size or not np.isfinite(values).all():
        raise ValueError("a map is (H, W)")
    top = float(np.abs(values).max()) or 1.0
    return {"kind": "picture", "uri": html.picture(html.tint(values, top)),
            "wide": values.shape[1], "caption": f"full colour at {top:.3g}"}  # fmt: skip


def _table(value: Any) -> dict[str, Any]:
    rows = [[_text(cell) for cell in row] for row in value["rows"]]
    return {"kind": "table", "columns": [str(c) for c in value["columns"]], "rows": rows}


# ---- plots ----


def _numbers(value: Any) -> list[float]:
    """A list of finite numbers, or nothing."""
    try:
        values = np.asarray(value, np.float64)
    except (TypeError, ValueError):
        return []
    return values.tolist() if values.ndim == 1 and values.size and np.isfinite(values).all() else []


def _z_values(outcomes: Iterable[Outcome]) -> list[float]:
    """All z values; channels of one case that share their noise count once."""
    found: list[float] = []
    for o in outcomes:
        found += np.unique(np.round(_numbers(o.figures.get("z", [])), 4)).tolist()
    return found


def _drawn(figures: Iterable[Figure]) -> list[str]:
    return [html.svg(figure) for figure in figures]


def _plots(outcomes: list[Outcome]) -> list[tuple[str, list[str]]]:
    """(caption, panels) of the plots of the whole run."""
    out = []
    p = np.sort([o.p for o in outcomes if o.p is not None])
    if p.size > 1:
        from scipy.stats import kstest

        small = kstest(p, "uniform", alternative="greater").pvalue
        out.append((
            f"Do the p values follow chance? First stage of {p.size:,} cases against the uniform "
            "law, with Kolmogorov's 99.9 % band; and the small ones, with 99.9 % bands one by "
            "one. Points above the line are careful tests (corrected for their number, or of "
            f"counts). That the p values are not too small has p = {small:.2g} (Kolmogorov)",
            _p_plot(p),
        ))  # fmt: skip
    if z := _z_values(outcomes):
        out.append((
            f"Do the z-scores follow chance? {len(z):,} pixels of scenes with exact answers; the "
            "channels of a pixel share noise, so the band is a guide and not part of the verdict",
            _drawn(html.z_plots(np.array(z), law="normal law")),
        ))  # fmt: skip
    return out


def _p_plot(p: Array) -> list[str]:
    """P values, sorted, against the uniform law: all of them, and the small ones."""
    from scipy.stats import beta, kstwo

    n = p.size
    place = np.arange(1, n + 1)
    expected = (place - 0.5) / n
    reach = float(kstwo.ppf(0.999, n))
    whole, small = html.figure(), html.figure()
    left, right = whole.axes[0], small.axes[0]
    grid = np.array([0.0, 1.0])
    left.fill_between(grid, np.clip(grid - reach, 0, 1), np.clip(grid + reach, 0, 1),
                      color=ORANGE, alpha=0.2, lw=0, label="Kolmogorov, 99.9 %")  # fmt: skip
    band = [beta.ppf(q, place, n + 1 - place) for q in (5e-4, 0.9995)]
    right.fill_between(expected, *band, color=ORANGE, alpha=0.2, lw=0, label="99.9 %, one by one")
    right.axhline(FIRST, color=GREY, lw=0.8, ls="--", label="second stage below")
    shown = np.maximum(p, 1e-12)
    right.set_xscale("log")
    right.set_yscale("log")
    for axes, values in ((left, p), (right, shown)):
        axes.plot(expected, expected, color=ORANGE, lw=1)
        axes.plot(expected, values, ".", ms=4, color=BLUE)
        axes.set_xlabel("expected p")
        axes.set_ylabel("measured p")
        html.legend(axes)
    return _drawn([whole, small])


def _panels(name: str, caption: str, outcomes: list[Outcome],
            draw: Callable[[Axes, Any], None]) -> list[tuple[str, list[str]]]:  # fmt: skip
    """A panel for each case that has the figure, failed cases first."""
    own = [o for o in outcomes if name in o.figures and _on_level(name, o.figures[name])]
    own.sort(key=lambda o: _ORDER.index(o.verdict))
    if not own:
        return []
    more = f"; {len(own) - _PANELS} more are not drawn" if len(own) > _PANELS else ""
    panels = []
    for o in own[:_PANELS]:
        drawn = html.figure()
        axes = drawn.axes[0]
        draw(axes, o.figures[name])
        label = o.id.partition(".")[2]
        failed = o.verdict == "fail"
        axes.set_xlabel(f"{axes.get_xlabel()}   [{o.device}]")
        html.legend(axes)
        drawn.suptitle(label if len(label) <= 48 else label[:47] + "\u2026", fontsize=9, x=0.02,
                       ha="left", color=RED if failed else INK, parse_math=False)  # fmt: skip
        panels.append(drawn)
    return [(caption + more, _drawn(panels))]


def _live(value: Any) -> dict[str, Array]:
    """Lists by depth, each with a positive number; empty if the value is something else."""
    series = value if isinstance(value, dict) else {"measured": value}
    lists = {str(k): np.array(_numbers(v)) for k, v in series.items()}
    return lists if all((v > 0).any() for v in lists.values()) else {}


def _slope(value: Any) -> dict[str, Array]:
    """Positive lists of one length, the first of them "spp"; empty for anything else."""
    if not isinstance(value, dict):
        return {}
    lists = {str(k): np.array(_numbers(v)) for k, v in value.items() if np.ndim(v)}
    spp = lists.pop("spp", np.zeros(0))
    right = lists and all(v.shape == spp.shape and (v > 0).all() for v in lists.values())
    return {"spp": spp, **lists} if right and (spp > 0).all() and spp.size else {}


def _draw_live(axes: Axes, value: Any) -> None:
    lists = _live(value)
    looks = zip("ox+sd^v*" * len(lists), _SHADES * len(lists), strict=False)
    for key, values in lists.items():
        shown = np.where(values > 0, values, np.nan)
        if key == "expected":
            axes.plot(shown, color=ORANGE, lw=1.2, label=key)
        else:
            mark, shade = next(looks)
            axes.plot(shown, mark, ms=4, color=shade, label=key, mfc="none")
    axes.set_yscale("log")
    axes.set_xlabel("depth")


def _draw_slope(axes: Axes, value: Any) -> None:
    lists = _slope(value)
    spp = lists.pop("spp")
    for (key, values), shade in zip(lists.items(), _SHADES * len(lists), strict=False):
        axes.plot(spp, values, "o", ms=4, color=shade, label=key)
    law, found = value.get("expected"), value.get("slope")
    if isinstance(law, (int, float)):
        first = next(iter(lists.values()))[0]
        line = first * (spp / spp[0]) ** law
        axes.plot(spp, line, color=ORANGE, lw=1.2, label=f"slope {law:g}")
    axes.set_xscale("log")
    axes.set_yscale("log")
    axes.set_xlabel("spp" if found is None else f"spp; slope {number(found)}")
