"""The tree between a scene file and a scene: what was written, and where.

A reader turns its format into this tree; `build` checks the tree against `plugins` and makes the
scene. So every format has the same rules and the same messages.
"""

from __future__ import annotations

import difflib
import os
import re
from collections.abc import Iterable
from dataclasses import dataclass, field
from pathlib import Path, PurePath
from typing import Any

from ..errors import SceneError
from ..files import open_regular
from ..numeric import shown
from .report import Report

MAX_DEPTH = 32
_FLOAT = re.compile(r"[+-]?(?:[0-9]+(?:\.[0-9]*)?|\.[0-9]+)(?:[eE][+-]?[0-9]+)?")
_INTEGER = re.compile(r"[+-]?[0-9]{1,20}")


@dataclass(slots=True)
class Value:
    """A parameter: kind (float, integer, boolean, string, rgb, spectrum, vector, point, transform,
    array), its value (rgb and vector: tuple of float; transform: (4, 4) float64) and its place."""

    kind: str
    value: Any
    where: str


@dataclass(slots=True)
class Ref:
    """A use of an object that is defined elsewhere; name: what for, where that matters."""

    id: str
    where: str
    name: str = ""


@dataclass(slots=True)
class Node:
    """An object: plugin name, category if the file states it, parameters and nested objects;
    name: what it is for in the object around it; faulty: a part of it is missing, and in the
    report."""

    plugin: str
    where: str
    category: str = ""
    id: str = ""
    folder: str = ""
    values: dict[str, Value] = field(default_factory=dict)
    children: list[Node | Ref] = field(default_factory=list)
    name: str = ""
    faulty: bool = False

    def __str__(self) -> str:
        return f'{self.plugin} "{self.id}"' if self.id else self.plugin


@dataclass(slots=True)
class Tree:
    """A scene node, every object in it that has an id, and what is wrong with the file so far;
    orphans: objects in objects that are not supported."""

    scene: Node
    ids: dict[str, Node] = field(default_factory=dict)
    report: Report = field(default_factory=Report)
    orphans: list[Node] = field(default_factory=list)

    def add_id(self, node: Node, name: str = "", where: str = "") -> None:
        """Registers a node's id, or `name` as another; raises SceneError if another node has it."""
        name = name or node.id
        other = self.ids.setdefault(name, node)
        if other is not node:
            raise SceneError(f'id "{name}" is already used at {other.where}', where or node.where)


def shorten(value: object) -> str:
    """Text of a value for a message, at most about 90 characters; of a path 240, and its end."""
    if isinstance(value, PurePath):
        text = f'"{value}"'.replace("\n", " ")
        return text if len(text) <= 240 else f"{text[:40]}...{text[-190:]}"
    text = shown(value, 10_000) if not isinstance(value, str) else f'"{value}"'
    text = text.replace("\n", " ")
    return text if len(text) <= 80 else f"{text[:70]}...({len(text)} characters)"


def quoted(word: bytes) -> str:
    """A word of a foreign file for a message: no more of it than names the mistake."""
    text = word.decode("utf-8", "replace")
    return f'"{text}"' if len(text) <= 24 else f'"{text[:16]}..." ({len(text)} characters)'


def allowed(name: str, names: Iterable[str], what: str = "allowed") -> str:
    """End of a message about an unknown `name`: the known names, and the closest of them.

    At most 50 names are listed, each by 40 characters at most, and 1,000 compared.
    """
    known = [n if len(n) <= 40 else f"{n[:36]}..." for n in sorted(names)[:1000]]
    listed = known[:50] + ["..."] * (len(known) > 50)
    text = f"; {what}: {', '.join(listed)}" if known else f"; {what}: none"
    close = difflib.get_close_matches(name[:64], known, n=1)
    return f'{text}; did you mean "{close[0]}"?' if close else text


def read_bytes(path: Path, limit: int, where: str) -> bytes:
    """Contents of a regular file of at most `limit` bytes; anything else is a SceneError."""
    name = shorten(path)
    try:
        with open_regular(path) as file:
            size = os.fstat(file.fileno()).st_size  # read() asks for the memory first
            data = file.read(min(size, limit) + 1)
    except OSError as error:
        raise SceneError(f"cannot read {name}: {error.strerror}", where) from None
    except ValueError as error:  # a name with a null character
        raise SceneError(f"cannot read {name}: {error}", where) from None
    if len(data) > limit:
        raise SceneError(f"{name} exceeds {limit} bytes", where)
    if data.startswith(POINTER):
        raise SceneError(f"{name}: {NOT_FETCHED}", where)
    return data


#: The beginning of what stands for a large file that Git did not fetch, and what to say of it.
POINTER = b"version https://git-lfs.github.com/spec/"
NOT_FETCHED = "not the file, but a pointer of Git LFS to it; git lfs pull fetches it"


def parse_float(text: str, name: str, where: str) -> float:
    """A finite decimal number; independent of the locale, no underscores, no hexadecimal."""
    text = text.strip(" \t\r\n")
    if not _FLOAT.fullmatch(text):
        if text.lower().lstrip("+-") in ("nan", "inf", "infinity"):
            raise SceneError(f"{name} = {shorten(text)} must be finite", where)
        raise SceneError(f"{name} = {shorten(text)} is not a number", where)
    number = float(text)
    if number - number != 0.0:
        raise SceneError(f"{name} = {shorten(text)} exceeds the float64 range", where)
    return number


def parse_integer(text: str, name: str, where: str) -> int:
    """A decimal integer of at most 20 digits."""
    text = text.strip(" \t\r\n")
    if not _INTEGER.fullmatch(text):
        raise SceneError(f"{name} = {shorten(text)} is not an integer", where)
    return int(text)


def parse_floats(text: str, name: str, where: str, counts: tuple[int, ...]) -> tuple[float, ...]:
    """Numbers separated by blanks or commas, as many as one of `counts`."""
    tokens = [t for t in re.split(r"[\s,]+", text) if t]
    if len(tokens) not in counts:
        expected = " or ".join(str(n) for n in counts)
        raise SceneError(
            f"{name} = {shorten(text)} holds {len(tokens)} numbers, expected {expected}", where
        )
    return tuple(parse_float(t, name, where) for t in tokens)
