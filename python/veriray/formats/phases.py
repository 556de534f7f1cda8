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
#: The numbers of a node's volume of that name, the same everywhere; None without one.
Numbers = Callable[[Node, int, str], list[float] | None]
#: A lobe: its node, its row but for the place of its values, and these.
Lobe = tuple[Node, materials.Row, list[float]]
#: Least over greatest of the areas of flakes, squared.
_FLATTEST = 1e-6


def lobes(node: Node, check: Check, numbers: Numbers) -> tuple[list[Lobe], float]:
    """The lobes that a phase function is the sum of, none of share 0, and what the extinction of
    its medium is multiplied by: the greatest area of flakes, if they are all there is."""
    found: list[Lobe] = []
    area = _add(node, 1.0, check, numbers, 0, found)
    if node.plugin == "blendphase" and len(found) == 1 and "lobe_flakes" in found[0][1]:
        # Of a blend the extinction is even, also if it is all of one.
        found.append((replace(node, id=""), {"lobe_share": 0.0}, []))
    return found, area


def _add(
    node: Node, share: float, check: Check, numbers: Numbers, depth: int, found: list[Lobe]
) -> float:
    if depth > _DEEPEST:
        raise SceneError(f"{node}: blends are nested deeper than {_DEEPEST}", node.where)
    parts, values = check(node)
    if node.plugin == "blendphase":
        weight = values["weight"]
        if (volume := numbers(node, 1, "weight")) is not None:
            (weight,) = volume
        if weight is None:
            raise SceneError(f'{node}: "weight" (number) is missing', node.where)
        if not 0 <= weight <= 1:
            raise SceneError(f'{node}: "weight" = {weight:g} is outside [0, 1]', node.where)
        for child, part in zip(parts["phase"], (1 - weight, weight), strict=True):
            _add(child, share * part, check, numbers, depth + 1, found)
        return 1.0
    row: materials.Row = {"lobe_share": share}
    area = 1.0
    table: list[float] = []
    if node.plugin == "tabphase":
        table = _values(node, values["values"])
        row["lobe_size"] = len(table)
    elif node.plugin == "hg":
        row["lobe_g"] = values["g"]
    elif node.plugin == "sggx":
        row["lobe_flakes"], area = _flakes(node, numbers(node, 6, "S"))
    kind = "hg" if node.plugin == "isotropic" else node.plugin
    row["lobe_kind"] = PHASE_KINDS.index(kind)
    if np.float32(share):
        found.append((replace(node, id=""), row, table))
    if len(found) > MAX_LOBES:
        raise SceneError(f"{node}: more than {MAX_LOBES} phase functions in one", node.where)
    return area


def _flakes(node: Node, given: list[float] | None) -> tuple[tuple[float, ...], float]:
    """The six numbers of S over its greatest eigenvalue, and the root of that."""
    if given is None:
        raise SceneError(f'{node}: "S" (gridvolume of 6 numbers a cell) is missing', node.where)
    xx, yy, zz, xy, xz, yz = given
    areas = np.linalg.eigvalsh([[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]])
    least, most = float(areas[0]), float(areas[2])
    if not least >= _FLATTEST * most > 0:
        raise SceneError(
            f'{node}: "S" = {given} has eigenvalues from {least:.3g} to {most:.3g}; expected '
            f"numbers above 0, the least {_FLATTEST:g} of the greatest or more",
            node.where,
        )
    return tuple(x / most for x in given), most**0.5


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
