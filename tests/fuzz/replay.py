"""Judges inputs again: `python -m tests.fuzz.replay FORMAT FILE...`; findings are raised."""

import sys
import tempfile
from pathlib import Path

from tests.fuzz.contract import judge
from tests.fuzz.formats import target

if __name__ == "__main__":
    of = target(sys.argv[1])
    with tempfile.TemporaryDirectory() as folder:
        path = of.prepare(Path(folder))
        for name in sys.argv[2:]:
            print(f"{name}: {judge(of, Path(name).read_bytes(), path)}")
