"""Ctrl-C and SIGTERM, from the first module on."""

from __future__ import annotations

import signal
import subprocess
import sys
import time
from pathlib import Path

import pytest

BOTH = pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM])
#: Ctrl-C as on a terminal: a process in the background ignores it.
HEARD = {"preexec_fn": lambda: signal.signal(signal.SIGINT, signal.default_int_handler)}


def outcome(code: str, folder: Path) -> list[str]:
    """What a new process prints after installing the handlers."""
    start = "import os, signal, sys, time\nfrom veriray import interrupts\ninterrupts.install()\n"
    done = subprocess.run(
        [sys.executable, "-c", start + code], cwd=folder, text=True, capture_output=True,
        timeout=60, **HEARD,
    )  # fmt: skip
    assert done.stderr == ""
    return done.stdout.split()


@BOTH
@pytest.mark.parametrize(("times", "whole"), [(1, "True"), (2, "False")])
def test_they_wait_for_the_end_of_an_import(
    number: signal.Signals, times: int, whole: str, tmp_path: Path
) -> None:
    """The second one does not."""
    send = f"os.kill(os.getpid(), {int(number)})\n"
    (tmp_path / "slow.py").write_text(f"import os, time\n{send * times}time.sleep(0.1)\n")
    code = """
sys.path.insert(0, ".")
try:
    import slow
    time.sleep(10)
except KeyboardInterrupt:
    print("slow" in sys.modules, interrupts.status())
"""
    assert outcome(code, tmp_path) == [whole, str(128 + number)]


def test_ignored_ones_stay_ignored(tmp_path: Path) -> None:
    code = """
signal.signal(signal.SIGINT, signal.SIG_IGN)
signal.signal(signal.SIGTERM, signal.SIG_DFL)
interrupts.install()
print(signal.getsignal(signal.SIGINT) is signal.SIG_IGN)
print(signal.getsignal(signal.SIGTERM) is interrupts.interrupt)
interrupts.remove()
print(signal.getsignal(signal.SIGINT) is signal.SIG_IGN)
print(signal.getsignal(signal.SIGTERM) is signal.SIG_DFL)
"""
    assert outcome(code, tmp_path) == ["True"] * 4


@BOTH
def test_early_ones_end_the_command(number: signal.Signals, tmp_path: Path) -> None:
    """At 12 moments from the start of `main` to the first samples: one line, and a status of its
    own."""
    code = "from veriray.__main__ import main; import sys; print(flush=True); sys.exit(main())"
    words = ["render", "cornell-box", "--spp", "1000000", "-o", "a.exr", "--discard", "--quiet"]
    for k in range(12):
        process = subprocess.Popen(
            [sys.executable, "-c", code, *words, "--device", "cpu"], cwd=tmp_path, text=True,
            stdout=subprocess.PIPE, stderr=subprocess.PIPE, **HEARD,
        )  # fmt: skip
        try:
            assert process.stdout is not None and process.stdout.readline() == "\n"
            time.sleep(0.03 + 0.02 * k)
            process.send_signal(number)
            out, err = process.communicate(timeout=60)
        finally:
            process.kill()
        assert (process.returncode, out) == (128 + number, "")
        assert err == "veriray: error: interrupted\n"
    assert list(tmp_path.iterdir()) == []
