"""Pictures that stay in memory of their device, and how they leave that of a GPU."""

from __future__ import annotations

import functools
import itertools
import os
import weakref
from collections.abc import Callable
from typing import TYPE_CHECKING, Any, TypeVar

import numpy.typing as npt

from .device import Device

if TYPE_CHECKING:
    from ._native import Picture

Array = npt.NDArray[Any]
T = TypeVar("T")

#: Kinds of devices in DLPack's numbers.
HOST = 1


class OnHost:
    """A copy of what a native `Picture` of a GPU held."""

    def __init__(self, picture: Picture) -> None:
        self._image, self._stderr = picture.image(), picture.stderr()
        for values in (self._image, self._stderr):
            values.setflags(write=False)

    def image(self) -> Array:
        """As `Picture.image`."""
        return self._image.copy()

    def stderr(self) -> Array:
        """As `Picture.stderr`."""
        return self._stderr.copy()

    def view(self) -> Array:
        """As `Picture.view`."""
        return self._image

    def dlpack_device(self) -> tuple[int, int]:
        """As `Picture.dlpack_device`."""
        return HOST, 0


class Held:
    """Holds one picture."""

    def __init__(self, picture: Picture) -> None:
        self._held: Picture | OnHost = picture
        keep(self)

    def image(self) -> Array:
        """A copy of the means, or of the integers."""
        return self._held.image()

    def stderr(self) -> Array:
        """A copy of the errors."""
        return self._held.stderr()


#: Objects that may hold a picture in memory of a GPU, as their attribute `_held`.
_holders: dict[int, weakref.ref[Any]] = {}
_numbers = itertools.count()
_sweep_at = 64


def keep(holder: Any) -> None:
    """From now on the picture in the attribute `_held` makes room and goes to child processes."""
    global _sweep_at
    if holder.__dict__["_held"].dlpack_device()[0] == HOST:
        return
    if len(_holders) >= _sweep_at:
        for key, reference in list(_holders.items()):
            if reference() is None:  # no callback does it: that would lose an interrupt
                _holders.pop(key, None)
        _sweep_at = max(64, 2 * len(_holders))
    _holders[next(_numbers)] = weakref.ref(holder)


def _on_gpu() -> list[tuple[Any, Picture]]:
    """The holders of pictures that are in memory of a GPU, and these pictures."""
    holders = [reference() for reference in list(_holders.values())]
    pairs = [(h, h.__dict__.get("_held")) for h in holders if h is not None]
    return [(h, held) for h, held in pairs if held is not None and not isinstance(held, OnHost)]


def move_to_host() -> bool:
    """Copies all pictures that are in memory of a GPU to the host's, and gives that memory back but
    for what was lent by `__cuda_array_interface__` or DLPack. False: there were none."""
    found = _on_gpu()
    for holder, held in found:
        holder.__dict__["_held"] = OnHost(held)
    return bool(found)


def with_room(device: Device, call: Callable[[], T], undo: Callable[[], object] | None = None) -> T:
    """The call's result. Where the device lacks memory, pictures make room and it is called again,
    after `undo`."""
    try:
        return call()
    except device.native.OutOfMemoryError:
        if not move_to_host():
            raise
    # Outside of the handler, whose traceback keeps what the first call had.
    if undo:
        undo()
    return call()


def _before_fork() -> None:
    """CUDA does not work in a child process: it gets copies in the host's memory."""
    for holder, held in _on_gpu():
        holder.__dict__["_for_child"] = OnHost(held)


def _after_fork(*, child: bool) -> None:
    for holder, _ in _on_gpu():
        copied = holder.__dict__.pop("_for_child", None)
        if child and copied is not None:
            holder.__dict__["_held"] = copied
            holder.__dict__.pop("_lent", None)


if hasattr(os, "register_at_fork"):
    os.register_at_fork(
        before=_before_fork,
        after_in_parent=functools.partial(_after_fork, child=False),
        after_in_child=functools.partial(_after_fork, child=True),
    )
