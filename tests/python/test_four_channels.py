"""Closures do not care how many channels a colour has: four wavelengths are an instantiation."""

from __future__ import annotations

import shutil
import subprocess
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[2]
COMPILER = shutil.which("c++") or shutil.which("g++") or shutil.which("clang++")
ONE = "inline constexpr uint32_t kChannels = 3;"


@pytest.mark.skipif(COMPILER is None, reason="compiles C++: no c++, g++ or clang++ on PATH")
def test_closures_of_four_channels(tmp_path: Path) -> None:
    """The sources with another constant, in place of theirs on the path of includes; 1 s."""
    text = (ROOT / "cpp" / "spectrum" / "spectrum.h").read_text("utf-8")
    assert text.count(ONE) == 1
    header = tmp_path / "spectrum" / "spectrum.h"
    header.parent.mkdir()
    header.write_text(text.replace(ONE, ONE.replace("= 3", "= 4")), "utf-8")
    program = tmp_path / "four"
    words = [COMPILER, "-std=c++20", "-O0", "-ffp-contract=off", "-Wall", "-Wextra", "-Werror",
             f"-I{tmp_path}", f"-I{ROOT / 'cpp'}", ROOT / "tests" / "four_channels.cpp",
             "-o", program]  # fmt: skip
    for command in ([str(w) for w in words], [str(program)]):
        done = subprocess.run(command, capture_output=True, text=True)
        assert done.returncode == 0, done.stdout + done.stderr[-3000:]
