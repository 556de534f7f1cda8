"""Tests of ledgers: what must add up, and whether paths of two programs end alike."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from .statistics import MARGIN

ENDS = ("escaped", "emitter_end", "absorbed", "rr_killed", "depth_cut")


def ledger_problems(ledger: dict[str, list[int]], paths: int) -> list[str]:
    """Violated identities: live[0] = paths, live[d] = sum of the ends + live[d+1]."""
    live = ledger["live"]
    out = [] if live[0] == paths else [f"live[0] = {live[0]}, expected {paths} paths"]
    columns = (ledger[c][: len(live)] for c in (*ENDS, "invalid"))
    rows = zip(live, map(sum, zip(*columns, strict=True)), [*live[1:], 0], strict=True)
    for d, (count, ends, following) in enumerate(rows):
        if count != ends + following:
            out.append(f"depth {d}: live {count}, ends {ends} + next {following}")
    return out


@dataclass(frozen=True)
class LedgerComparison:
    """Two ledgers side by side.

    Attributes:
        statistic, p, where: chi-square over its degrees of freedom, p, and the first cells that
            Holm names (or the most unusual one) for the ends of paths.
        shadow_p, shadow_where: the same for shadow rays, by the largest |z|.
        rows: per depth and column: depth, column, counts a and b, their fractions of all paths,
            z of the difference (margin subtracted), and whether Holm over the cells names it.
    """

    statistic: float
    p: float
    where: str
    shadow_p: float
    shadow_where: str
    rows: list[dict[str, Any]]


def ledger_test(a: dict[str, list[int]], r: dict[str, list[int]], alpha: float) -> LedgerComparison:
    """Do paths end alike? Two-sample test of the counts per (depth, end).

    Chi-square over the cells (those that expect fewer than 10 are pooled) and, for a tail that
    drifts the same way at every depth, the largest |z| of the fractions that reach each depth; p is
    twice the smaller one. A difference of `MARGIN` in a fraction of all paths does not count.
    """
    from scipy.stats import chi2, norm

    names = ("live", *ENDS, "shadow_visible", "shadow_occluded")
    depths = max(len(a["live"]), len(r["live"]))
    count = np.array([[x[c] + [0] * (depths - len(x[c])) for c in names] for x in (a, r)], float)
    paths = count[:, 0, 0]
    share = count / paths[:, None, None]
    pooled = count.sum(axis=0) / paths.sum()
    known = pooled * paths.min() >= 10
    known[0, 0] = False  # all paths
    noise = np.sqrt(np.clip(pooled * (1 - pooled), 0, 1) * (1 / paths).sum())
    difference = share[0] - share[1]
    excess = np.sign(difference) * np.maximum(np.abs(difference) - MARGIN, 0)
    z = np.where(excess == 0, 0.0, excess / np.maximum(noise, 1e-300))

    ends = slice(1, 1 + len(ENDS))
    used = known[ends]
    terms = excess[ends][used] ** 2 / pooled[ends][used]
    rare = float(pooled[ends][~used].sum())
    if rare * paths.min() >= 10:
        rest = max(abs(float(difference[ends][~used].sum())) - MARGIN, 0.0)
        terms = np.append(terms, rest**2 / rare)
    statistic = float(terms.sum() / (1 / paths).sum())
    dof = max(len(terms) - 1, 1)

    def place(column: int, depth: int) -> str:
        x, y = share[:, column, depth]
        return (
            f"{names[column]} at depth {depth}: {x:.6f} against {y:.6f} of all paths, "
            f"z = {z[column, depth]:+.2f}"
        )

    def largest(rows: slice) -> tuple[float, str]:
        score = np.where(known, np.abs(z), -1)[rows]
        column, depth = np.unravel_index(np.argmax(score), score.shape)
        p = 2 * float(norm.sf(max(score.max(), 0))) * max(int(known[rows].sum()), 1)
        return min(1.0, p), place(int(column) + (rows.start or 0), int(depth))

    p = min(1.0, 2 * min(float(chi2.sf(statistic, dof)), largest(slice(0, 1))[0]))
    body = slice(0, 1 + len(ENDS))
    tails = np.where(known[body], 2 * norm.sf(np.abs(z[body])), 2.0)
    order = np.argsort(tails, axis=None)[: int(known[body].sum())]
    named: list[tuple[int, int]] = []
    for rank, k in enumerate(order):
        if tails.flat[k] > alpha / (len(order) - rank):
            break
        named.append(divmod(int(k), depths))
    named.sort(key=lambda cell: cell[1])
    rows = [
        {
            "depth": d,
            "column": name,
            "a": int(count[0, c, d]),
            "b": int(count[1, c, d]),
            "share_a": float(share[0, c, d]),
            "share_b": float(share[1, c, d]),
            "z": float(z[c, d]),
            "named": (c, d) in named,
        }
        for d in range(depths)
        for c, name in enumerate(names)
    ]
    return LedgerComparison(
        statistic / dof,
        p,
        "; ".join(place(*cell) for cell in named[:3]) or largest(body)[1],
        *largest(slice(1 + len(ENDS), None)),
        rows,
    )
