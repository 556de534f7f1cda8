"""Which rows of a scene's tables the objects of its file became.

An object may have several rows: a material alone and in a mask, a texture as a colour and as a
number. A row of a material may be of several objects: the material, the mask around it, and the
blend whose first material it is.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from .scene import Scene


@dataclass(frozen=True)
class Use:
    """A row that holds numbers of an object; part: which, of a row of materials "bsdf", "opacity"
    or "weight". form: "" as they are; "mean": a checkerboard that gives one number holds the means
    of its two colours; "rest": likewise, but 1 minus each mean. Of a weight, "rest" means that the
    row holds 1 minus it. exchanged: a checkerboard's row holds its second colour first, as it does
    where one number is wanted, unless the colours are in order."""

    table: str
    row: int
    part: str = ""
    form: str = ""
    exchanged: bool = False


@dataclass(frozen=True)
class Object:
    """An object with its name, "" for none, and all of its uses."""

    name: str
    uses: tuple[Use, ...]


class Objects:
    """The objects of a scene; holders: by the ids of objects that hold a material, as `twosided`
    does, its row; merged: names of materials that blends of more than two put together, and
    names of numbers, as "NAME.opacity", that are factors of other numbers; products: rows of
    materials and parts of them ("bsdf" or "opacity") whose numbers are made of several."""

    def __init__(
        self,
        objects: Iterable[Object] = (),
        holders: Mapping[str, int] | None = None,
        merged: Iterable[str] = (),
        products: Iterable[tuple[int, str]] = (),
    ) -> None:
        self.objects = tuple(objects)
        self.holders = dict(holders or {})
        self.merged = frozenset(merged)
        self.products = frozenset(products)
        self._by_name: dict[str, list[Object]] = {}
        self._by_place: dict[tuple[str, int, str], Object] = {}
        for one in self.objects:
            if one.name:
                self._by_name.setdefault(one.name, []).append(one)
            for use in one.uses:
                self._by_place[use.table, use.row, use.part] = one

    def named(self, name: str) -> list[Object]:
        """The objects of a name: one, or a material and what holds it, which has no id."""
        return self._by_name.get(name, [])

    def of(self, table: str, row: int, part: str) -> Object | None:
        """The object whose numbers a part of a row holds."""
        return self._by_place.get((table, row, part))

    def use(self, table: str, row: int, part: str) -> Use:
        """The use that a part of a row is."""
        one = self.of(table, row, part)
        uses = () if one is None else one.uses
        places = (use for use in uses if (use.table, use.row, use.part) == (table, row, part))
        return next(places, Use(table, row, part))

    def names(self) -> dict[tuple[str, int], list[str]]:
        """The names of each row's objects; the material's own is first."""
        result: dict[tuple[str, int], list[str]] = {}
        for one in self.objects:
            for use in one.uses if one.name else ():
                known = result.setdefault((use.table, use.row), [])
                if one.name not in known:
                    known.insert(0 if use.part == "bsdf" else len(known), one.name)
        for name, row in self.holders.items():
            known = result.setdefault(("materials", row), [])
            if name not in known:
                known.append(name)
        return result


def objects(scene: Scene) -> Objects:
    """Which rows the objects of a scene's file became; none of a scene made of arrays."""
    found: Objects = scene.__dict__.get("_objects") or Objects()
    return found
