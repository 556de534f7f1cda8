"""Exceptions and warnings of veriray."""

from __future__ import annotations

MAX_MESSAGE = 2000


def printable(text: str) -> str:
    """`text` as a message: control characters and the like as escapes, the middle cut if too long.

    Files may hold any character, and names of any length. Raises TypeError if it is not text.
    """
    _must_be_text("message", text)
    if len(text) > MAX_MESSAGE:
        half = MAX_MESSAGE // 2 - 4
        text = f"{text[:half]} [...] {text[-half:]}"
    return _escaped(text)


def visible(text: str) -> str:
    """`text` for a terminal or a report: as `printable`, but uncut and with its line breaks."""
    return "\n".join(map(_escaped, text.split("\n")))


def _must_be_text(name: str, value: object) -> None:
    if not isinstance(value, str):
        raise TypeError(f"{name} is {type(value).__name__}, expected str")


def _escaped(text: str) -> str:
    if text.isprintable():
        return text
    return "".join(c if c.isprintable() else ascii(c)[1:-1] for c in text)


class SceneError(ValueError):
    """Bad scene: names the place (file:line or key path), the value and what is allowed.

    One printable line. `where` holds only the place, "" if arrays were given directly. A file with
    several faults raises the first; `faults` holds the lines of all.
    """

    def __init__(self, message: str, where: str = "") -> None:
        _must_be_text("message", message)
        _must_be_text("where", where)
        super().__init__(printable(f"{where}: {message}" if where else message))
        self.where = where
        self.faults: tuple[str, ...] = (str(self),)


class SceneWarning(UserWarning):
    """A scene that renders, but probably not as intended: without light, for example."""

    def __init__(self, message: str) -> None:
        super().__init__(printable(message))


class RefusedSamplesWarning(UserWarning):
    """A picture lacks samples that the film could not hold; they count as black."""


class ImageError(ValueError):
    """A file that cannot be read as a render, or a picture that cannot be written as asked."""

    def __init__(self, message: str) -> None:
        super().__init__(printable(message))


class CheckpointError(ValueError):
    """A file that is no checkpoint, is damaged, or is one of another render."""

    def __init__(self, message: str) -> None:
        super().__init__(printable(message))


class CheckpointWarning(UserWarning):
    """A checkpoint that could not be written; the render goes on."""


class MissingPackageError(ImportError):
    """A feature needs packages that are not installed; the message says what brings them."""

    def __init__(self, message: str) -> None:
        super().__init__(printable(message))


class DeviceWarning(UserWarning):
    """A device or a node of a cluster that takes no part in a render; the others draw its share."""

    def __init__(self, message: str) -> None:
        super().__init__(printable(message))


class DeviceError(RuntimeError):
    """A device is missing, failed, or cannot run this build."""


class OutOfMemoryError(MemoryError):
    """A device or the host has too little memory."""
