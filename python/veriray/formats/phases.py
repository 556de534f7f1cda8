"""From phase functions to the lobes of a medium."""

from __future__ import annotations

import re
from collections.abc import Callable
from dataclasses import replace
from typing import Any

import numpy as np

from ..columns import MAX_LOBES, MAX_PHASE_VALUES, PHASE_KINDS
from ..errors import SceneError
from . import materials
from .node import Node, parse_float

_DEEPEST = 16
#: A node's objects by category, and its checked parameters.
Check = Callable[[Node], tuple[dict[str, list[Node]], dict[str, Any]]]
#: A lobe: its node, its row but for the place of its values, and these.
Lobe = tuple[Node, materials.Row, list[float]]


def lobes(node: Node, check: Check) -> list[Lobe]:
    """The lobes that a phase function is the sum of; none of share 0."""
    found: list[Lobe] = []
    _add(node, 1.0, check, 0, found)
    return found


def _add(node: Node, share: float, check: Check, depth: int, found: list[Lobe]) -> None:
    if depth > _DEEPEST:
        raise SceneError(f"{node}: blends are nested deeper than {_DEEPEST}", node.where)
    parts, values = check(node)
    if node.plugin == "blendphase":
        weight = values["weight"]
        if weight is None:
            raise SceneError(f'{node}: "weight" (number) is missing', node.where)
        for child, part in zip(parts["phase"], (1 - weight, weight), strict=True):
            _add(child, share * part, check, depth + 1, found)
        return
    row: materials.Row = {"lobe_share": share}
    table: list[float] = []
    if node.plugin == "tabphase":
        table = _values(node, values["values"])
        row["lobe_size"] = len(table)
    elif node.plugin == "hg":
        row["lobe_g"] = values["g"]
    kind = "hg" if node.plugin == "isotropic" else node.plugin
    row["lobe_kind"] = PHASE_KINDS.index(kind)
    if np.float32(share):
        found.append((replace(node, id=""), row, table))
    if len(found) > MAX_LOBES:
        raise SceneError(f"{node}: more than {MAX_LOBES} phase functions in one", node.where)


def _values(node: Node, given: str) -> list[float]:
    where, label = node.values["values"].where, f'{node}: "values"'
    tokens = [token for token in re.split(r"[\s,]+", given) if token]
    if not 2 <= len(tokens) <= MAX_PHASE_VALUES:
        raise SceneError(
            f"{label} holds {len(tokens)} numbers, expected 2 to {MAX_PHASE_VALUES}", where
        )
    numbers = [parse_float(token, label, where) for token in tokens]
    if min(numbers) < 0:
        raise SceneError(f"{label} holds {min(numbers):g}, expected numbers of at least 0", where)
    largest = max(numbers)
    if not largest:
        raise SceneError(f"{label} holds zeros alone", where)
    return [number / largest for number in numbers]
