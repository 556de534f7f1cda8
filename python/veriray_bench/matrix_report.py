"""The matrix's tables: the headline, the classes, and what voids a scene."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

from .matrix import FIGURES, by_class, headline
from .sections import Section, Table, num, with_unit

Result = dict[str, Any]
_NAMES = {"wall": "wall", "device": "device time", "cpu": "CPU time", "variance": "variance",
          "efficiency": "efficiency"}  # fmt: skip
_TEXT = (
    "Small scenes made by rule, three of each class. Wall: the whole public call until the picture "
    "is in NumPy, median of alternating rounds after one to warm up; variance: relative, of the "
    "pictures' pixels at equal samples; efficiency: 1 / (wall x variance). All are the peer's over "
    "ours (efficiency: ours over the peer's), so above 1 veriray is better. Means that differ by "
    "more than chance void a scene."
)


def matrix_sections(results: Sequence[Result]) -> list[Section]:
    """Headline and classes of each result of `bench matrix`."""
    out = []
    for result in results:
        if result.get("benchmark") != "matrix":
            continue
        device = result["device"]["name"]
        named = [peer for peer, about in result["peers"].items() if "missing" not in about]
        for peer in named:
            title = f"Matrix: veriray and {peer} on {device}"
            tables = [headline_table(result, peer), class_table(result, peer)]
            out.append(Section(title, _TEXT, [*tables, *_void_table(result, peer)]))
        if not named:
            out.append(Section(f"Matrix: veriray alone on {device}", _TEXT, [own_table(result)]))
    return out


def headline_table(result: Result, peer: str) -> Table:
    """Geometric mean, least and its scene of each figure."""
    head = headline(result, peer)
    rows = [
        [_NAMES[key], with_unit(head[key]["mean"], "x"), with_unit(head[key]["least"], "x"),
         head[key]["where"], str(head["scenes"])]
        for key in FIGURES if key in head
    ]  # fmt: skip
    return Table(("figure", " geometric mean", " least", "its scene", " scenes"), rows)


def class_table(result: Result, peer: str) -> Table:
    """A row for each class: geometric means over its scenes, the least efficiency."""
    rows = []
    for name, entry in by_class(result, peer).items():
        known = [entry[key]["mean"] if key in entry else None for key in FIGURES]
        least = entry["efficiency"]["least"] if "efficiency" in entry else None
        own = entry["own"][0]["wall"] if entry["own"] else None
        rows.append([name, entry["title"], *(num(value) for value in known), num(least),
                     num(None if own is None else 1e3 * own), str(len(entry["rows"])),
                     f"{len(entry['why'])}" if entry["why"] else ""])  # fmt: skip
    columns = ("class", "scenes", *(f" {_NAMES[key]}" for key in FIGURES), " least efficiency",
               " ours, ms", " measured", " void")  # fmt: skip
    return Table(columns, rows)


def own_table(result: Result) -> Table:
    """Where no peer took part: times and variance of ours."""
    rows = []
    for name, row in result["scenarios"].items():
        own = row.get("rows", {}).get("veriray")
        cells = ["-"] * 4 if own is None else [
            num(1e3 * own["wall"]), num(1e3 * own["device"]), num(own["variance"]),
            num(1e3 * own["first"]["wall"])]  # fmt: skip
        rows.append([name, row["title"], *cells])
    columns = ("scene", "what", " wall, ms", " device, ms", " variance", " first call, ms")
    return Table(columns, rows)


def _void_table(result: Result, peer: str) -> list[Table]:
    rows = [[name, why] for name, entry in by_class(result, peer).items() for why in entry["why"]]
    return [Table(("class", "no figure, because"), rows)] if rows else []


def matrix_line(name: str, row: Result) -> str:
    """A scene's result in one line, for the terminal."""
    if "error" in row:
        return f"{name}: FAILED: {row['error']}"
    own = row["rows"]["veriray"]
    parts = [f"{1e3 * own['wall']:,.1f} ms, {row['spp']} spp"]
    for who, entry in row["rows"].items():
        if "ratios" in entry:
            parts.append(f"{who}: " + ", ".join(f"{_NAMES[k]} {num(entry['ratios'][k])} x"
                                                for k in FIGURES))  # fmt: skip
        elif "void" in entry:
            mark = f"no {who}" if entry.get("absent") else f"VOID {who}"
            parts.append(f"{mark}: {entry['void']}")
    return f"{name}: " + "; ".join(parts)


def headline_text(result: Result, peer: str) -> str:
    """The headline in one paragraph."""
    head = headline(result, peer)
    text = f"{head['scenes']} scenes with figures, {head['void']} void, {head['failed']} failed"
    for key in FIGURES:
        if key in head:
            h = head[key]
            text += (f"; {_NAMES[key]} {num(h['mean'])} x (geometric mean), least {num(h['least'])}"
                     f" x ({h['where']})")  # fmt: skip
    return text
