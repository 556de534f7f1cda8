"""Whether targets are met, and what is no result."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from typing import Any

from .matrix import cells, headline
from .scenarios import SCENARIOS, Scenario, Target

Result = dict[str, Any]
DISTURBED = 0.1  # cores used by others above which a time is doubted


def _goal(figure: str, what: str, **goals: tuple[float, float]) -> Target:
    return Target(figure, f"{what} against Mitsuba's", goals, unit="x")


#: What the matrix as a whole should reach.
MATRIX = Scenario(
    "matrix", "scenes made by rule", "", "matrix", {}, {},
    targets=(
        _goal("efficiency_mean", "efficiency, geometric mean", cpu=(10, 10), cuda=(15, 25)),
        _goal("efficiency_least", "efficiency, least", cpu=(1.3, 1.3), cuda=(2, 4)),
        _goal("wall_mean", "wall, geometric mean", cuda=(8, 8)),
        _goal("wall_least", "wall, least", cuda=(1.5, 1.5)),
    ),
)  # fmt: skip


def _whole_matrix(result: Result) -> Result | None:
    """The matrix as one row with figures; None where a scene was not measured."""
    rows = result["scenarios"]
    if any(cell.name not in rows for cell in cells()):
        return None
    head = headline(result, "mitsuba")
    figures = {f"{key}_{of}": head[key][of] for key in ("wall", "efficiency") if key in head
               for of in ("mean", "least")}  # fmt: skip
    own = {name: row["rows"]["veriray"] for name, row in rows.items() if "rows" in row}
    return {"figures": figures, "rows": own}


def judge(target: Target, backend: str, row: Result | None, quick: bool = False) -> dict[str, Any]:
    """A target on a back end against a scenario's result (None: not measured).

    Keys: state ("met", "missed", "void", "error", "not measured" or "quick"), value, goal,
    moonshot, reached (share of the goal, above 1 where met), why (for the other states) and doubt
    (why the value may be off, or "").
    """
    goal, moonshot = target.goals[backend]
    out: dict[str, Any] = {"value": None, "goal": goal, "moonshot": moonshot, "reached": None,
                           "why": "", "doubt": ""}  # fmt: skip
    if row is None:
        return {**out, "state": "not measured"}
    if "error" in row:
        return {**out, "state": "error", "why": row["error"]}
    value = row["figures"].get(target.figure)
    if value is None:
        for state, absent in (("void", False), ("not measured", True)):
            if why := "; ".join(f"{name}: {w}" for name, w in void_rows(row, absent)):
                return {**out, "state": state, "why": why}
        return {**out, "state": "not measured"}
    if backend == "cpu" and (cores := disturbed(row)) > DISTURBED:
        out["doubt"] = f"others used {cores:.2g} cores"
    if quick:
        return {**out, "state": "quick", "value": value}
    reached = goal / value if target.below else value / goal
    state = "met" if reached >= 1 else "missed"
    return {**out, "state": state, "value": value, "reached": reached}


def targets(results: Sequence[Result]) -> list[dict[str, Any]]:
    """Every target of the devices in the results, with its judgement."""
    found = []
    for result in results:
        backend = result["build"]["backend"]
        if result.get("benchmark") == "matrix":
            row = _whole_matrix(result)
            for target in MATRIX.targets:
                if backend in target.goals:
                    judged = judge(target, backend, row, result["settings"]["quick"])
                    found.append({"device": result["device"]["name"], "scenario": MATRIX,
                                  "target": target, **judged})  # fmt: skip
            continue
        for scenario in SCENARIOS:
            for target in scenario.targets:
                if backend in target.goals and backend in scenario.backends:
                    row = result["scenarios"].get(scenario.name)
                    judged = judge(target, backend, row, result["settings"]["quick"])
                    found.append({"device": result["device"]["name"], "scenario": scenario,
                                  "target": target, **judged})  # fmt: skip
    return found


def verdict(results: Sequence[Result]) -> tuple[str, str]:
    """("pass", "fail" or "inconclusive", one sentence)."""
    judged = targets(results)
    met, missed = ([t for t in judged if t["state"] == s] for s in ("met", "missed"))
    where = ", ".join(f"{r['device']['name']} ({r['device']['description']})" for r in results)
    text = f"{len(met)} of {len(judged)} targets met on {where}"
    if missed:
        worst = min(missed, key=lambda t: t["reached"])
        text += (
            f", {len(missed)} missed; the farthest: {worst['scenario'].name}, "
            f"{worst['target'].what}, at {100 * worst['reached']:.0f} % of its target"
        )
    states = {"void": "void", "error": "ended in an error", "not measured": "not measured",
              "quick": "of a quick run, which judges none"}  # fmt: skip
    for state, how in states.items():
        if count := sum(t["state"] == state for t in judged):
            text += f", {count} {how}"
    if doubt := sum(bool(t["doubt"]) for t in met + missed):
        text += f"; of those judged {doubt} in doubt"
    if missed:
        return "fail", text + "."
    sure = len(met) == len(judged) and not doubt
    return ("pass" if sure else "inconclusive"), text + "."


def void_rows(row: Result, absent: bool = False) -> Iterator[tuple[str, str]]:
    """(contestant, why) of what is no result in a scenario's result; "" for all of it.

    absent: list the peers that did not take part instead.
    """
    if not absent:
        for key in ("error", "void"):
            if key in row:
                yield "", row[key]
    seen = set()
    for point in row.get("points", [row]):
        for name, entry in point.get("rows", {}).items():
            if "void" in entry and entry.get("absent", False) == absent:
                at = f" at {row['varies']} {point['value']:,}" if "points" in row else ""
                if not absent or name not in seen:
                    yield name + ("" if absent else at), entry["void"]
                seen.add(name)


def disturbed(row: Result) -> float:
    """The most cores that others used while a contestant of a scenario ran, by its median.

    Runs below 0.2 s are left out: the clock of foreign load has ticks of 10 ms.
    """
    entries = [e for point in row.get("points", [row]) for e in point.get("rows", {}).values()]
    entries += [point for e in entries for point in e.get("points", [])]
    return max((e.get("foreign") or 0.0 for e in entries if e.get("wall", 0) >= 0.2), default=0.0)
