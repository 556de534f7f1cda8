"""Exceptions and warnings of veriray."""

from __future__ import annotations


class SceneError(ValueError):
    """Bad scene: names the place (file:line or key path), the value and what is allowed.

    `where` holds the place alone, "" when there is none (arrays given directly).
    """

    def __init__(self, message: str, where: str = "") -> None:
        super().__init__(f"{where}: {message}" if where else message)
        self.where = where


class SceneWarning(UserWarning):
    """A scene that renders, but hardly as meant: no light, for example."""


class DeviceError(RuntimeError):
    """A device is missing, failed, or cannot run this build."""


class OutOfMemoryError(MemoryError):
    """A device or the host has too little memory."""
