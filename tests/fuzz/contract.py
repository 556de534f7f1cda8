"""What every parser promises, whatever bytes it is given.

It returns a valid object, or raises one of its documented exceptions with a one-line message,
within `SECONDS` of processor time and `BYTES` of memory. Anything else is a `Finding`; a crash or a
hang ends the process.
"""

from __future__ import annotations

import random
import time
import traceback
import warnings
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

SECONDS = 2.0
BYTES = 1 << 30
MAX_INPUT = 1 << 16
MAX_MESSAGE = 4096


class Finding(Exception):  # noqa: N818
    """A broken promise. key: equal for all inputs that break it in the same way."""

    def __init__(self, key: str, text: str) -> None:
        super().__init__(text)
        self.key = key


@dataclass(frozen=True)
class Target:
    """A parser under test.

    load: from a file to an object. valid: what is wrong with that object, "" if nothing. errors:
    the documented exceptions. modules: its sources in the package, for the coverage. words: tokens
    of the format. mutate: a change that keeps the form, None where the input has none. beside:
    files that the input may name.
    """

    suffix: str
    load: Callable[[Path], object]
    valid: Callable[[Any], str]
    errors: tuple[type[Exception], ...]
    modules: tuple[str, ...]
    words: tuple[str, ...] = ()
    mutate: Callable[[bytes, random.Random], bytes | None] | None = None
    beside: Mapping[str, bytes] = field(default_factory=dict)

    def prepare(self, folder: Path) -> Path:
        """Writes the files beside the input; the input's own path."""
        for name, content in self.beside.items():
            (folder / name).write_bytes(content)
        return folder / f"input{self.suffix}"


def judge(target: Target, data: bytes, path: Path) -> str:
    """The word "valid", or the documented exception and its place; raises Finding."""
    path.write_bytes(data)
    begin, outcome = time.process_time(), "valid"
    texts: list[str] = []
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always")
        try:
            problem = target.valid(target.load(path))
            if problem:
                raise Finding(f"invalid {_shape(problem)}", f"loaded, but {problem}")
        except target.errors as error:
            outcome = f"{type(error).__name__} {_place(error)}"
            texts.append(str(error))
        except Finding:
            raise
        except Exception as error:
            text = f"{type(error).__name__}: {str(error)[:300]}"
            raise Finding(f"{type(error).__name__} {_place(error)}", text) from error
    seconds = time.process_time() - begin
    texts += [str(w.message) for w in caught]
    for text in texts:
        if not text.strip() or not text.isprintable() or len(text) > MAX_MESSAGE:
            raise Finding(f"message {outcome}", f"{text[:300]!r} ({len(text)} characters)")
    if seconds > SECONDS:
        raise Finding("slow", f"{seconds:.1f} s for {len(data)} bytes")
    return outcome


def repeated(data: bytes, rng: random.Random, most: int) -> bytes:
    """`data` with a short piece of it repeated up to `most` bytes: finds what takes too long."""
    begin = rng.randrange(len(data) + 1)
    piece = data[begin : begin + rng.randrange(1, 40)] or b"1"
    times = rng.randrange(1, max(2, (most - len(data)) // len(piece)))
    return (data[:begin] + piece * times + data[begin:])[:most]


def _place(error: BaseException) -> str:
    """The last function of the package that the exception passed through."""
    frames = traceback.extract_tb(error.__traceback__)
    own = [f for f in frames if "veriray" in Path(f.filename).parts and "tests" not in f.filename]
    last = (own or list(frames))[-1]
    return f"{Path(last.filename).name} {last.name}"


def _shape(text: str) -> str:
    return "".join("#" if c.isdigit() else c for c in text)[:60]
