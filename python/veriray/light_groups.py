"""Light groups: the picture by the light of some lamps each, as Cycles' light groups give it.

`veriray.render(scene, light_groups={"key": "lamp_*", "fill": ["window", "sky"]})` gives the feature
images `light.key`, `light.fill` and, of the lamps in no group, `light.rest`. They add up to the
picture to float rounding: paths, random numbers and choices of lights are the picture's, and the
radiance of all other lamps is left out.

A lamp is an emitter of surfaces, a light without extent, or the sky. Its names are its id, those of
the shapes that it is on, and "emission_0", "light_0" by its row; the sky's are "sky" and
"environment". Shapes that refer to one emitter are one lamp.
"""

from __future__ import annotations

import fnmatch
import re
from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Any, NamedTuple

from .errors import printable
from .named import objects
from .numeric import distinct, shown, texts

if TYPE_CHECKING:
    from .scene import Scene

#: Of lamps in no group.
REST = "rest"
_GROUP = re.compile(r"[A-Za-z0-9_-]{1,64}")


class Lamp(NamedTuple):
    """names: all, the usual one first. row: of the scene's emissions or lights."""

    names: tuple[str, ...]
    table: str  # "emission", "light" or "sky", as of `Scene.emission_muted`
    row: int


def entries(name: str, value: Any, error: type[ValueError] = ValueError) -> tuple[str, ...]:
    """What a user gives as texts GROUP=PATTERN, or PATTERN for a group for each lamp.

    value: a dictionary of a pattern or a list of them by group, a list of such texts, or one with
    commas between them. Patterns are those of file names (`*`, `?`, `[ab]`). Raises `error`.
    """
    if isinstance(value, Mapping):
        listed = []
        for group, patterns in value.items():
            each = [patterns] if isinstance(patterns, str) else texts(name, patterns, error)
            if not isinstance(group, str) or not each:
                raise error(f"{name}: {shown(group)} = {shown(patterns)} is no group of lamps")
            listed += [f"{group}={pattern}" for pattern in each]
    else:
        listed = [*(value.split(",") if isinstance(value, str) else texts(name, value, error))]
    for text in listed:
        group, sign, pattern = text.strip().partition("=")
        if sign and (not _GROUP.fullmatch(group) or group == REST):
            raise error(
                f"{name}: a group cannot be called {shown(group)}; expected 1 to 64 letters, "
                f'digits, "_" and "-", and not "{REST}"'
            )
        if not (pattern if sign else group):
            raise error(f"{name}: {shown(text)}; expected GROUP=LAMP or LAMP")
    return tuple(text.strip() for text in listed)


def lamps(scene: Scene) -> list[Lamp]:
    """The lamps of a scene: emitters of surfaces, lights without extent, the sky."""
    import numpy as np

    shapes: dict[int, list[str]] = {}
    for kind in ("triangle", "sphere", "disk"):
        rows, of = getattr(scene, f"{kind}_emission"), getattr(scene, f"{kind}_shape")
        if distinct(rows) is not rows and len(rows) and rows[0] < 0:
            continue
        lit = np.flatnonzero(rows >= 0)
        _, first = np.unique(rows[lit].astype(np.int64) << 32 | of[lit], return_index=True)
        for at in lit[np.sort(first)]:
            shapes.setdefault(int(rows[at]), []).append(scene.shape_names[of[at]])
    ids = objects(scene).names()

    def lamp(table: str, row: int, *more: str) -> Lamp:
        names = (*ids.get((f"{table}s", row), ()), *more, f"{table}_{row}")
        return Lamp(tuple(dict.fromkeys(names)), table, row)

    found = [lamp("emission", row, *names) for row, names in sorted(shapes.items())]
    found += [lamp("light", row) for row in range(len(scene.light_kind))]
    if scene.environment.any() or scene.sky_size.any():
        found.append(Lamp(("sky", "environment"), "sky", 0))
    return found


def resolved(scene: Scene, given: Sequence[str]) -> dict[str, list[Lamp]]:
    """The lamps of each group, by the group's name. given: `entries`.

    A lamp is in the first group that names it. Raises ValueError for what names no lamp, or none
    that is not in a group already.
    """
    left = lamps(scene)
    every = tuple(left)
    groups: dict[str, list[Lamp]] = {}
    for text in given:
        group, sign, pattern = text.partition("=")
        pattern = pattern if sign else group

        def meant(lamp: Lamp, pattern: str = pattern) -> bool:
            return any(fnmatch.fnmatchcase(name, pattern) for name in lamp.names)

        taken = [lamp for lamp in left if meant(lamp)]
        if not taken:
            if any(map(meant, every)):
                raise ValueError(f"light_groups: all that {shown(text)} names is in other groups")
            from .formats.node import allowed

            known = allowed(pattern, (lamp.names[0] for lamp in every), "there are")
            raise ValueError(printable(f"light_groups: no lamp is called {shown(pattern)}{known}"))
        left = [lamp for lamp in left if lamp not in taken]
        if sign:
            groups.setdefault(group, []).extend(taken)
            continue
        for lamp in taken:
            groups[_free(lamp.names[0], groups)] = [lamp]
    if left:
        groups[REST] = left
    return groups


def layers(scene: Scene, given: Sequence[str]) -> dict[str, tuple[str, ...]]:
    """The lamps of each group, by the feature image's name, as `FeatureImages.lamps` has them."""
    return {
        f"light.{group}": tuple(lamp.names[0] for lamp in found)
        for group, found in resolved(scene, given).items()
    }


def _free(name: str, groups: Mapping[str, Any]) -> str:
    """A name for a group that is not taken, of the letters that groups have."""
    base = re.sub(r"[^A-Za-z0-9_-]", "_", name)[:56]
    number = 1
    while (name := f"{base}_{number}" if number > 1 else base) in groups or name == REST:
        number += 1
    return name


def alone(scene: Scene, shining: Sequence[Lamp]) -> Scene:
    """The scene with the light of these lamps alone, and the paths of all of them."""
    import numpy as np

    changes: dict[str, Any] = {}
    for table, count in (("emission", len(scene.emissions)), ("light", len(scene.light_kind))):
        column = f"{table}_muted"
        muted = np.ones(count, np.bool_)
        muted[[lamp.row for lamp in shining if lamp.table == table]] = False
        changes[column] = muted | getattr(scene, column)
    unseen = not any(lamp.table == "sky" for lamp in shining)
    changes["sky_muted"] = scene.sky_muted | unseen
    return scene._with_arrays(**changes)
