"""Which files the gallery made: it may replace only those without being told to."""

from __future__ import annotations

import errno
from collections.abc import Iterable
from pathlib import Path

from ..files import open_regular

#: Appears near the beginning of every file that the gallery makes.
MARK = "made by veriray gallery"
_BEGINNING = 2**24


def is_foreign(path: Path) -> bool:
    """Whether a file exists that the gallery did not make."""
    try:
        with open_regular(path) as file:
            return MARK.encode() not in file.read(_BEGINNING)
    except FileNotFoundError:
        return False


def protect(paths: Iterable[Path], force: bool) -> None:
    """Raises FileExistsError for the first file that is foreign, unless `force`."""
    for path in () if force else paths:
        if is_foreign(path):
            reason = "exists and was not made by the gallery; --force replaces it"
            raise OSError(errno.EEXIST, reason, str(path))
