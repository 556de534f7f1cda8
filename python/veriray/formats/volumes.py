"""From media and their volumes to rows of a scene's media and grids."""

from __future__ import annotations

from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

from .. import transform as tf
from ..columns import TEXTURE_WRAPS
from ..errors import SceneError
from . import materials, volume_grid
from .node import Node
from .plugins import VOLUME_FILTERS

Array = npt.NDArray[Any]
_SOURCES = ("filename", "grid", "data")
_NEAR = 1e-5  # of the side of a grid: what rounding moves
_UNIT = np.array([[0.0] * 3, [1.0] * 3], np.float32)
#: Volumes by the parameter that they give, with their checked parameters.
Given = dict[str, tuple[Node, dict[str, Any]]]


@dataclass(eq=False)
class Grid:
    """A volume in one use: its node there, its cells (Z, Y, X, 1 or 3) float32 in [0, 1], what
    they are shares of, and its row but for its place among the scene's cells."""

    node: Node
    cells: Array
    largest: float
    row: materials.Row

    def beyond(self, low: Array | None = None, high: Array | None = None) -> bool:
        """Whether more than 0 is up to half a cell beyond its box, as was not in version 0.x. low,
        high: the least and the largest coordinates of a shape in the unit cube of the cells; beyond
        them nothing counts."""
        if "at_corners" not in self.node.values or not self.node.values["at_corners"].value:
            return False
        for axis in range(3):  # x, y, z
            count = self.cells.shape[2 - axis]
            first, last = 0.5 / count - _NEAR, 1 - 0.5 / count + _NEAR
            if count == 1:
                continue
            if (low is None or low[axis] < first) and self.cells.take(0, 2 - axis).any():
                return True
            if (high is None or high[axis] > last) and self.cells.take(-1, 2 - axis).any():
                return True
        return False

    def reached(self, corners: Array) -> bool:
        """Whether a shape within the hull of these points (N, 3) is where `beyond` says."""
        matrix = np.array(self.row["grid_to_world"], np.float64).reshape(3, 4)
        try:
            inside = np.linalg.solve(matrix[:, :3], (corners - matrix[:, 3]).T)
        except np.linalg.LinAlgError:  # refused elsewhere
            return True
        return self.beyond(inside.min(axis=1), inside.max(axis=1))


class Grids:
    """The grids of a scene's media; each file is read once."""

    def __init__(self) -> None:
        self.files: dict[str, tuple[Array, Array]] = {}
        self.made: dict[tuple[int, str], tuple[Node, Grid]] = {}  # holds the node, and so its id
        self.numbers: list[Array] = []
        self.count = 0

    def array(self) -> Array | None:
        """The column `cells`; None without any."""
        return np.concatenate(self.numbers) if self.numbers else None

    def placed(self, grid: Grid) -> materials.Row:
        """The row of a grid that a medium has; its cells join the scene's."""
        if "grid_first" not in grid.row:
            grid.row["grid_first"] = self.count
            self.numbers.append(grid.cells.reshape(-1))
            self.count += grid.cells.size
        return grid.row

    def grid(self, node: Node, values: dict[str, Any], use: str) -> Grid:
        """A volume as "albedo" or "sigma_t"; values: its checked parameters."""
        found = self.made.get((id(node), use))
        if found is None:
            grid = self._shares(node, values, use)
            found = self.made[id(node), use] = node, grid
        return found[1]

    def _shares(self, node: Node, values: dict[str, Any], use: str) -> Grid:
        row: materials.Row = {}
        if node.plugin == "constvolume":
            matrix = np.eye(4) if values["to_world"] is None else values["to_world"]
            colour = np.array(values["color"] or values["value"], np.float32)
            cells = colour[None if len(set(colour.tolist())) > 1 else slice(1)].reshape(1, 1, 1, -1)
        else:
            cells, matrix = self.cells(node, values, use)
            row["grid_wrap"] = TEXTURE_WRAPS.index(values["wrap_mode"])
            row["grid_filter"] = VOLUME_FILTERS.index(values["filter_type"])
        z, y, x, channels = cells.shape
        largest = float(cells.max()) if use == "sigma_t" else 1.0
        bad = ~((cells >= 0) & (cells <= largest))
        if bad.any():
            k, j, i, c = (int(n) for n in np.argwhere(bad)[0])
            raise SceneError(
                f"{node}: the cell (x {i}, y {j}, z {k}) holds {cells[k, j, i, c]:g}; {use} is "
                + ("at least 0" if use == "sigma_t" else "in [0, 1]"),
                node.where,
            )
        row |= {
            "grid_size": (x, y, z),
            "grid_grey": channels == 1,
            "grid_to_world": matrix[:3].tolist(),
        }
        shares = cells if largest in (0.0, 1.0) else (cells / np.float32(largest)).astype("f4")
        return Grid(replace(node), shares, largest, row)

    def cells(self, node: Node, values: dict[str, Any], use: str) -> tuple[Array, Array]:
        """The cells (Z, Y, X, 1 or 3) float32 of a gridvolume, and what takes its unit cube to the
        world; use: what for, which an error names."""
        matrix = np.eye(4) if values["to_world"] is None else values["to_world"]
        cells, box = self._read(node, values)
        if values["use_grid_bbox"]:
            low, high = box.astype(np.float64).tolist()
            sides = [b - a for a, b in zip(low, high, strict=True)]
            matrix = tf.compose(matrix, tf.compose(tf.translate(low), tf.scale(sides)))
        if values["at_corners"]:
            sides = [n / (n - 1) if n > 1 else 1.0 for n in cells.shape[2::-1]]
            low = [(1 - side) / 2 for side in sides]
            matrix = tf.compose(matrix, tf.compose(tf.translate(low), tf.scale(sides)))
        channels = cells.shape[3]
        if channels not in (1, 3):
            raise SceneError(f"{node}: {channels} numbers a cell; {use} takes 1 or 3", node.where)
        return cells, matrix

    def numbers_of(self, node: Node, values: dict[str, Any], count: int, use: str) -> list[float]:
        """The numbers of a volume that are the same everywhere."""
        if node.plugin == "constvolume":
            found = list(values["color"] or values["value"])
            found = found[:1] if len(set(found)) == 1 else found
            if len(found) != count:
                raise SceneError(f"{node} holds {found}; {use} takes {count} numbers", node.where)
            return found
        cells = self._read(node, values)[0]
        if cells.shape[3] != count:
            raise SceneError(
                f"{node}: {cells.shape[3]} numbers a cell; {use} takes {count}", node.where
            )
        first = cells[0, 0, 0]
        other = np.argwhere((cells != first).any(axis=-1))
        if len(other):
            k, j, i = (int(n) for n in other[0])
            raise SceneError(
                f"{node}: the cell (x {i}, y {j}, z {k}) is unlike the first; {use} by place is "
                "not supported",
                node.where,
            )
        return [float(x) for x in first]

    def _read(self, node: Node, values: dict[str, Any]) -> tuple[Array, Array]:
        given = [name for name in _SOURCES if values[name] is not None]
        if len(given) != 1:
            raise SceneError(
                f"{node}: {' and '.join(given) or 'no grid'} given; expected one of "
                f"{', '.join(_SOURCES)}",
                node.where,
            )
        where = node.values[given[0]].where
        found = values[given[0]]
        if isinstance(found, tuple):  # of a mitsuba.VolumeGrid
            return found
        array = given[0] != "filename"
        if array and values["use_grid_bbox"]:
            raise SceneError(
                f"{node}: use_grid_bbox = true, but an array has no box; give to_world, or a .vol "
                "file or mitsuba.VolumeGrid",
                where,
            )
        if array:
            return volume_grid.from_array(found, where), _UNIT
        path = str(Path(node.folder) / values["filename"])
        if path not in self.files:
            self.files[path] = volume_grid.read_vol(path, where)
        return self.files[path]


def medium(
    node: Node, values: dict[str, Any], phase: materials.Row, given: Given, grids: Grids
) -> tuple[materials.Row, dict[str, Grid]]:
    """The row of a medium, and the grids that stand for its parameters; values: its checked
    parameters; given: its volumes by parameter, with theirs."""
    values, given = dict(values), dict(given)
    for name, (volume, of_volume) in list(given.items()):
        if volume.plugin == "constvolume" and (name, node.plugin) != ("sigma_t", "heterogeneous"):
            values[name] = of_volume.get("color") or of_volume["value"]
            if name == "albedo" and max(values[name]) > 1:
                raise SceneError(
                    f"{volume}: albedo = {list(values[name])} is outside [0, 1]", volume.where
                )
            del given[name]
    if node.plugin == "homogeneous" and "sigma_t" in given:
        raise SceneError(
            f"{node}: its sigma_t is the same everywhere; heterogeneous takes a gridvolume",
            given["sigma_t"][0].where,
        )
    if node.plugin == "heterogeneous":
        if values["density_scale"] is not None:
            if "scale" in node.values:
                raise SceneError(
                    f"{node}: both scale and density_scale given, expected one of them", node.where
                )
            values["scale"] = values["density_scale"]
        if "sigma_t" not in given:
            where = node.values["sigma_t"].where if "sigma_t" in node.values else node.where
            number = {"value": values["sigma_t"] or (1.0,) * 3, "color": None, "to_world": None}
            given["sigma_t"] = Node("constvolume", where, "volume"), number
    used = {name: grids.grid(*volume, name) for name, volume in given.items()}
    if "albedo" in used:
        values["albedo"] = (1.0,) * 3
    if "sigma_t" in used:
        values["sigma_t"] = (used["sigma_t"].largest,) * 3
        if not used["sigma_t"].largest * values["scale"]:
            del used["sigma_t"]
    return materials.medium(node, values, phase), used
