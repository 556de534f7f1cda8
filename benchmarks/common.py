"""Shared by the benchmark scripts: folders, the header and the file of a result, arguments."""

from __future__ import annotations

import argparse
import json
from pathlib import Path
from typing import Any

from veriray_bench.measure import Array, Meter, cpu_count, spread
from veriray_bench.measure import header as _header

__all__ = ["MITSUBA_BOX", "RESULTS", "ROOT", "Array", "Meter", "cpu_count", "header", "parser",
           "spread", "write"]  # fmt: skip
ROOT = Path(__file__).resolve().parents[1]
RESULTS = ROOT / "benchmarks" / "results"
MITSUBA_BOX = ROOT / "scenes" / "cornell" / "cornell_box_mitsuba.xml"


def header(benchmark: str, *packages: str) -> dict[str, Any]:
    """What every result begins with."""
    return _header(benchmark, *packages, root=ROOT)


def write(result: dict[str, Any], path: Path) -> None:
    """Write a result as JSON."""
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_text(json.dumps(result, indent=1) + "\n")
    print(f"written: {path.name}")


def parser(text: str | None, name: str) -> argparse.ArgumentParser:
    """Argument parser with the options that all scripts share."""
    summary = (text or "").splitlines()[0]
    p = argparse.ArgumentParser(description=summary)
    p.add_argument("-o", "--output", type=Path, default=RESULTS / name, help="JSON file")
    return p
