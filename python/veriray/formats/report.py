"""What a scene file asks for and does not get: faults, and notes on what changes no light."""

from __future__ import annotations

import warnings
from typing import NoReturn

from ..errors import SceneError, SceneWarning, printable

MAX_FAULTS = 200


class Full(Exception):  # noqa: N818
    """There are MAX_FAULTS faults: the search for more of them ends."""


class Listed(SceneError):  # noqa: N818
    """An object that cannot be made because of a fault that is in the report already."""


class Report:
    """Faults and notes of one scene, each once, in the order in which they were found.

    strict: notes are faults. notes: lines of text, each with its place. features: feature images
    that the scene asks for. warned: place and text of those notes that are warnings too. used:
    names of parameters that have an effect in this scene, and in most others none.
    """

    def __init__(self, strict: bool = False) -> None:
        self.strict = strict
        self.faults: dict[str, SceneError] = {}
        self.notes: dict[str, None] = {}
        self.features: tuple[str, ...] = ()
        self.warned: list[tuple[str, str]] = []
        self.count = 0
        self.used: tuple[str, ...] = ()

    def add(self, error: SceneError) -> None:
        """Adds a fault. Raises Full if there are too many."""
        if isinstance(error, Listed):
            return
        self.faults.setdefault(str(error), error)
        self.count += 1
        if len(self.faults) >= MAX_FAULTS or self.count >= 10 * MAX_FAULTS:
            raise Full

    def note(self, text: str, where: str) -> None:
        """Says what is taken without effect on the light, or not rendered beside it."""
        if self.strict:
            self.add(SceneError(f"{text} (an error by strict)", where))
        else:
            self.notes.setdefault(printable(f"{where}: {text}" if where else text))

    def warn(self, text: str, where: str) -> None:
        """Says what is rendered with other numbers than the file has: a note and a warning."""
        before = len(self.notes)
        self.note(text, where)
        if len(self.notes) > before:
            self.warned.append((where, text))
            warnings.warn(f"{where}: {text}", SceneWarning, stacklevel=8)

    def fail(self) -> NoReturn:
        """Raises the first fault; where there are more, as one SceneError that holds all."""
        first, *others = self.faults.values()
        if not others:
            raise first from None
        count = f"{len(self.faults)}{' or more' * (len(self.faults) >= MAX_FAULTS)}"
        error = SceneError(f"{first} (the first of {count} faults; `veriray info` lists them)")
        error.where, error.faults = first.where, tuple(self.faults)
        raise error from None
