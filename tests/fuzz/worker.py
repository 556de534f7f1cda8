"""One libFuzzer process; run by `tests.fuzz`.

    python -m tests.fuzz.worker FORMAT FINDINGS [libFuzzer's arguments]

Findings are written to FINDINGS, the smallest input of each key, and do not end the run.
"""

from __future__ import annotations

import contextlib
import hashlib
import itertools
import json
import os
import random
import resource
import sys
import tempfile
from pathlib import Path

import atheris

with atheris.instrument_imports(include=["veriray", "trimesh.exchange.stl"]):
    from tests.fuzz import contract, formats

    TARGET = formats.target(sys.argv[1])


def limit_memory() -> None:
    """Memory that an input may add to the process's own; the fuzzer grows with its corpus."""
    pages = int(Path("/proc/self/statm").read_text("utf-8").split()[0])
    limit = pages * resource.getpagesize() + contract.BYTES
    resource.setrlimit(resource.RLIMIT_AS, (limit, resource.RLIM_INFINITY))


def main(findings: Path, arguments: list[str]) -> None:
    """Fuzzes until libFuzzer's own limits end it."""
    shm = Path("/dev/shm")
    folder = Path(tempfile.mkdtemp(dir=shm if shm.is_dir() else None))
    path = TARGET.prepare(folder)
    found: dict[str, int] = {}
    with contextlib.suppress(contract.Finding):  # what it imports is not the first input's
        contract.judge(TARGET, b"", path)

    runs = itertools.count(1)

    def one(data: bytes) -> None:
        if next(runs) % 256 == 0:
            limit_memory()
        try:
            contract.judge(TARGET, data, path)
        except contract.Finding as finding:
            if len(data) < found.get(finding.key, 1 << 60):
                found[finding.key] = len(data)
                stem = findings / hashlib.sha256(finding.key.encode()).hexdigest()[:12]
                about = {"key": finding.key, "text": str(finding), "bytes": len(data)}
                stem.with_suffix(".bin").write_bytes(data)
                stem.with_suffix(".json").write_text(json.dumps(about))

    def mutated(data: bytes, most: int, seed: int) -> bytes:
        rng = random.Random(seed)
        if rng.random() < 0.02:
            return contract.repeated(data, rng, most)
        if TARGET.mutate is not None and rng.random() < 0.6:
            for _ in range(rng.choice((1, 1, 2, 4))):
                new = TARGET.mutate(data, rng)
                if new is None or len(new) > most:
                    break
                data = new
            else:
                return data
        return bytes(atheris.Mutate(data, most))

    os.dup2(os.open(os.devnull, os.O_WRONLY), 1)  # the parsers' libraries print
    atheris.Setup([sys.argv[0], *arguments], one, custom_mutator=mutated)
    limit_memory()
    atheris.Fuzz()


if __name__ == "__main__":
    main(Path(sys.argv[2]), sys.argv[3:])
