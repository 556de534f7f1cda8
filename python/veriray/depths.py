"""Rays alive, thread blocks and seconds at each depth of a render, as a table.

Row d: rays alive after bounce d (row 0: the camera rays), thread blocks launched for that bounce,
rays alive as a share of all paths, and the time of the bounce. A bounce is launched for the rays
that the one before left alive: blocks[d + 1] = ceil(live[d] / 256) when all paths fit in one batch.
"""

from __future__ import annotations

from typing import Any

from .picture import Render

BLOCK_SIZE = 256


def rows(result: Render) -> list[dict[str, Any]]:
    """The table of a render; blocks and seconds are None if the scheduler has none."""
    stats = result.stats
    live, blocks, seconds = stats["live_rays"], stats["blocks"], stats["depth_seconds"]
    table = []
    for depth in range(len(live) + (len(blocks) >= len(live) > 0)):
        before = depth - 1
        alive = live[depth] if depth < len(live) else 0
        table.append({
            "depth": depth,
            "live": alive,
            "blocks": blocks[before] if 0 <= before < len(blocks) else None,
            "share": alive / stats["paths"],
            "seconds": seconds[before] if 0 <= before < len(seconds) else None,
        })  # fmt: skip
    return table


def law_holds(result: Render) -> bool | None:
    """Whether the blocks of a bounce are ceil(live rays before it / 256); None: no blocks."""
    live, blocks = result.stats["live_rays"], result.stats["blocks"]
    if not blocks:
        return None
    return bool([-(-n // BLOCK_SIZE) for n in live] == blocks[: len(live)])


def as_text(table: list[dict[str, Any]], limit: int | None = None) -> str:
    """The table as aligned text; only the first `limit` rows and the last one when given.

    Columns that are empty in every row are left out.
    """
    headers = {
        "depth": "Depth",
        "live": "Live rays",
        "blocks": "Thread blocks",
        "share": "Share %",
        "seconds": "ms",
    }
    shown = [key for key in headers if any(row[key] is not None for row in table)]

    def cell(row: dict[str, Any], key: str) -> str:
        value = row[key]
        if value is None:
            return "-"
        if key == "share":
            return f"{100 * value:.4f}"
        return f"{1e3 * value:.3f}" if key == "seconds" else f"{value:,}"

    lines = [[headers[key] for key in shown]]
    for index, row in enumerate(table):
        if limit is None or index < limit or index == len(table) - 1:
            lines.append([cell(row, key) for key in shown])
        elif index == limit:
            lines.append(["..." for _ in shown])
    return aligned(lines)


def aligned(lines: list[list[str]]) -> str:
    """Lines with equal numbers of cells, right-aligned."""
    widths = [max(map(len, column)) for column in zip(*lines, strict=True)]
    return "\n".join(
        "  ".join(text.rjust(w) for text, w in zip(line, widths, strict=True)) for line in lines
    )
