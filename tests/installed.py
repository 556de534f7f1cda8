"""Tries an installed veriray where nothing else is: `python -I tests/installed.py [--cuda]`.

For a fresh environment that holds the wheel and what it brings, with no compiler on PATH; `make
wheel` runs it. --cuda: the CUDA module must be inside; it needs no GPU.
"""

from __future__ import annotations

import contextlib
import io
import os
import shutil
import sys
import tempfile
from importlib.metadata import distributions
from pathlib import Path

#: Distributions that may be there.
ALLOWED = {"veriray", "numpy", "lxml", "openexr", "pillow", "pip", "setuptools", "wheel"}


def command(*words: str) -> tuple[int, str, str]:
    """Exit status and what `veriray` printed."""
    from veriray.cli import main

    out, err = io.StringIO(), io.StringIO()
    with contextlib.redirect_stdout(out), contextlib.redirect_stderr(err):
        status = main(words)
    return status, out.getvalue(), err.getvalue()


def check(truth: bool, text: str) -> None:
    """Ends the process where something does not hold."""
    if not truth:
        sys.exit(f"tests/installed.py: {text}")


def main() -> None:
    """Every step prints a line or ends the process."""
    tools = {name: shutil.which(name) for name in ("c++", "g++", "cc", "clang++", "nvcc", "cmake")}
    check(not any(tools.values()), f"there are compilers: {tools}")
    names = {d.metadata["Name"].lower() for d in distributions()}
    check(names <= ALLOWED, f"not bare: {sorted(names - ALLOWED)}")

    import veriray as vr
    from veriray.device import survey
    from veriray.shipped import SHIPPED

    folder = Path(vr.__file__).parent
    check("site-packages" in folder.parts, f"veriray is the one in {folder}")
    modules = sorted(path.name.partition(".")[0] for path in folder.glob("_c*.so"))
    check("_cpu" in modules, f"modules: {modules}")
    check("--cuda" not in sys.argv or "_cuda" in modules, f"no CUDA module among {modules}")
    usable = [device.name for device in survey()[0]]
    print(f"Python {sys.version.split()[0]}: {', '.join(modules)}; devices {', '.join(usable)}")

    status, out, err = command("doctor")
    check(status == 0, f"veriray doctor: {out}{err}")
    os.chdir(tempfile.mkdtemp())
    for name in SHIPPED:
        scene, films = vr.load_file(name), set()
        for device in usable:
            picture = vr.render(scene, 4, width=64, height=48, device=device)
            films.add(picture.film_sha256)
        picture.save("a.exr"), picture.save("a.png")
        check(vr.Render.load("a.exr").film_sha256 in films, f"{name}: another film in its file")
        check(len(films) == 1, f"{name}: the devices disagree: {films}")
        check(Path("a.png").read_bytes().startswith(b"\x89PNG"), f"{name}: no PNG")
        print(f"{name}: {films.pop()}")
    for words, extra in ((("compare", "a.exr", "a.exr"), "compare"), (("validate",), "proof"),
                         (("bench", "matrix"), "bench"), (("view", "open"), "view"),
                         (("denoise", "a.exr", "b.exr"), "denoise")):  # fmt: skip
        status, out, err = command(*words)
        check(status == 2 and err.endswith(f"pip install 'veriray[{extra}]'\n"), f"{words}: {err}")
    print("optional features say what to install")


main()
