"""The smallest inputs that together run the same code as a set of inputs; needs no fuzzer.

    python -m tests.fuzz.minimise FORMAT LIMIT TO FROM...

Copies to the folder TO inputs of at most LIMIT bytes in all, and prints as JSON how many, and the
lines of the parser's functions that they run. Measured are steps from line to line in the target's
modules. Inputs named found-* (they broke something once) and seed-* are always kept.
"""

from __future__ import annotations

import hashlib
import json
import sys
import tempfile
from collections.abc import Callable, Iterable
from pathlib import Path
from types import CodeType, FrameType
from typing import Any

import veriray
from tests.fuzz.contract import Finding, Target, judge
from tests.fuzz.formats import target

PACKAGE = Path(veriray.__file__).parent.resolve()
Step = tuple[str, int, int]  # module, line before (0: entry), line


def trace(modules: Iterable[str], call: Callable[[], object]) -> set[Step]:
    """Steps from line to line within the modules while `call` runs."""
    names = {str((PACKAGE / m).resolve()): m for m in modules}
    known: dict[str, str | None] = {}
    steps: set[Step] = set()

    def enter(frame: FrameType, event: str, _: Any) -> Any:
        file = frame.f_code.co_filename
        if file not in known:
            known[file] = names.get(str(Path(file).resolve()))
        module = known[file]
        if module is None:
            return None
        before = 0

        def line(frame: FrameType, event: str, _: Any) -> Any:
            nonlocal before
            if event == "line":
                steps.add((module, before, frame.f_lineno))
                before = frame.f_lineno
            return line

        return line

    sys.settrace(enter)
    try:
        call()
    finally:
        sys.settrace(None)
    return steps


def lines(modules: Iterable[str]) -> set[tuple[str, int]]:
    """Lines of the functions of modules."""
    result: set[tuple[str, int]] = set()

    def walk(module: str, code: CodeType, inside: bool) -> None:
        if inside:
            first = code.co_firstlineno
            result.update((module, n) for _, _, n in code.co_lines() if n and n != first)
        for constant in code.co_consts:
            if isinstance(constant, CodeType):
                optimised = bool(constant.co_flags & 1)  # a function, not the body of a class
                walk(module, constant, inside or optimised)

    for module in modules:
        walk(module, compile((PACKAGE / module).read_text("utf-8"), module, "exec"), False)
    return result


def steps(of: Target, data: bytes, path: Path) -> set[Step]:
    """What one input runs."""

    def call() -> None:
        try:
            judge(of, data, path)
        except Finding:
            pass

    return trace(of.modules, call)


def main(name: str, limit: int, to: Path, sources: list[Path]) -> dict[str, Any]:
    """See the top of the module."""
    of = target(name)
    inputs: dict[bytes, str] = {}
    for file in sorted(f for source in sources for f in source.iterdir() if f.is_file()):
        data = file.read_bytes()
        if data not in inputs or file.name.startswith(("found-", "seed-")):
            inputs[data] = file.name
    order = sorted(inputs, key=lambda d: (not inputs[d].startswith(("found-", "seed-")), len(d), d))
    seen: set[Step] = set()
    chosen: list[tuple[str, bytes]] = []
    total = 0
    with tempfile.TemporaryDirectory() as folder:
        path = of.prepare(Path(folder))
        steps(of, b"", path)  # imports
        for data in order:
            named = inputs[data].startswith(("found-", "seed-"))
            if not named and total + len(data) > limit:
                continue
            new = steps(of, data, path) - seen
            if new or named:
                seen |= new
                total += len(data)
                digest = hashlib.sha256(data).hexdigest()[:12]
                chosen.append((inputs[data] if named else digest, data))
    to.mkdir(parents=True, exist_ok=True)
    for old in to.iterdir():
        old.unlink()
    for file_name, data in chosen:
        (to / file_name).write_bytes(data)
    there = lines(of.modules)
    run = {(m, n) for m, _, n in seen} & there
    return {"inputs": len(chosen), "bytes": total, "lines_run": len(run), "lines": len(there)}


if __name__ == "__main__":
    print(json.dumps(main(sys.argv[1], int(sys.argv[2]), Path(sys.argv[3]),
                          [Path(p) for p in sys.argv[4:]])))  # fmt: skip
