"""`veriray validate`: exit status, files, JSON; workers that crash, Ctrl-C."""

from __future__ import annotations

import json
import os
import re
import signal
import subprocess
import sys
import time
from pathlib import Path
from typing import Any

import pytest

import veriray
from veriray.cli import main
from veriray_validate.levels import LEVELS
from veriray_validate.run import SEED
from veriray_validate.trial import Case, Inconclusive, Skipped, Trial, case

ROOT = Path(__file__).resolve().parents[2]
Suite = dict[str, Case]
HERE = ["validate", "--device", "cpu", "--jobs", "0"]


@pytest.fixture(autouse=True)
def in_empty_folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    folder = tmp_path / "here"
    folder.mkdir()
    monkeypatch.chdir(folder)


def register(*kinds: str) -> None:
    """One case of each kind: pass, fail, inconclusive, skip, error."""

    @case(3, each={"kind": kinds})
    def synthetic(t: Trial, kind: str) -> None:
        """A planted verdict.

        What it is called.
        """
        t.p(1e-9 if kind == "fail" else 0.4, "the planted pixel")
        t.sees(0.002)
        t.figure("z", [0.1, -0.4, 1.2])
        t.figure("odd", {"nan": float("nan")})
        if kind == "inconclusive":
            raise Inconclusive("too few samples")
        if kind == "skip":
            raise Skipped("no such device")
        if kind == "error":
            raise RuntimeError("planted")


@pytest.mark.parametrize(
    ("kinds", "status", "word"),
    [
        (["pass"], 0, "PASS"),
        (["pass", "skip"], 0, "PASS"),
        (["pass", "fail"], 1, "FAIL"),
        (["fail", "inconclusive", "error"], 1, "FAIL"),
        (["error"], 1, "FAIL"),
        (["pass", "inconclusive"], 3, "INCONCLUSIVE"),
        (["skip"], 3, "INCONCLUSIVE"),
    ],
)
def test_exit_status_and_files(
    suite: Suite, kinds: list[str], status: int, word: str, capsys: Any
) -> None:
    register(*kinds)
    assert main([*HERE, "-o", "r.html", "-o", "r.json"]) == status
    out, err = capsys.readouterr()
    header, level, sentence, written = out.splitlines()
    assert header.split() == "level cases verdict smallest bias seen seconds".split()
    assert level.startswith("3 Closed forms") and "0.2 %" in level
    assert sentence.startswith(f"{word}: ") and "cpu" in sentence and written.endswith("r.json")
    for kind in kinds:
        shown = f"{kind}: test_command.synthetic[{kind}] on cpu" in err
        assert shown == (kind not in ("pass", "skip"))
    assert f"{len(kinds)} of {len(kinds)} cases" in err
    page = Path("r.html").read_text("utf-8")
    assert sentence.partition(": ")[2][:40] in page and "A planted verdict" in page
    start = page.index('<script type="application/json"')
    inside = json.loads(page[page.index(">", start) + 1 : page.index("</script>", start)])
    assert inside == json.loads(Path("r.json").read_text("utf-8"))
    assert sorted(os.listdir()) == ["r.html", "r.json"]


def test_the_seed_is_that_of_the_version(suite: Suite, capsys: Any) -> None:
    register("pass")
    assert main([*HERE, "--json"]) == 0
    assert json.loads(capsys.readouterr().out)["seed"] == SEED > 1


def test_json(suite: Suite, capsys: Any) -> None:
    register("pass", "fail")
    assert main([*HERE, "--json", "--seed", "7"]) == 1
    report = json.loads(capsys.readouterr().out)
    assert set(report) == {
        "result", "verdict", "veriray", "passed", "full", "seed", "devices", "false_alarm",
        "seconds", "first_stage", "facts", "missing", "levels", "cases",
    }  # fmt: skip
    assert (report["result"], report["passed"], report["full"]) == ("fail", False, False)
    assert (report["seed"], report["veriray"]) == (7, veriray.__version__)
    assert 0 < report["false_alarm"] < 1e-3
    assert set(report["levels"][0]) >= {"level", "name", "cases", "verdict", "sees", "seconds"}
    good, bad = report["cases"]
    assert (good["verdict"], bad["verdict"]) == ("pass", "fail")
    assert bad["confirmed"] == pytest.approx(1e-9) and "the planted pixel" in bad["message"]
    assert good["figures"]["z"] == [0.1, -0.4, 1.2] and good["figures"]["odd"] == {"nan": None}


def test_choice_of_cases(suite: Suite, capsys: Any) -> None:
    register("pass", "fail")

    @case(5, quick=False)
    def long(t: Trial) -> None:
        t.check(t.effort == 4)

    assert main([*HERE, "--case", "*pass?"]) == 0
    assert main([*HERE, "--case", "test_command.synthetic[pass]"]) == 0
    assert main([*HERE, "--full", "--level", "5"]) == 0
    assert "5 Stranger" in capsys.readouterr().out
    assert main([*HERE, "--level", "5"]) == 2
    assert "no case fits" in capsys.readouterr().err


def test_bad_arguments_before_any_work(suite: Suite, capsys: Any) -> None:
    @case(1)
    def never(t: Trial) -> None:
        raise AssertionError("work began")

    os.mkdir("folder.html")
    for arguments, message in (
        (["-o", "r.pdf"], "r.pdf: unknown suffix; expected .html or .json"),
        (["-o", "missing/r.html"], "missing/r.html: folder"),
        (["-o", "folder.html"], "folder.html: Is a directory"),
        (["-o", "r.html", "-o", "./r.html"], "the same output twice"),
        (["--level", "12"], "level = 12 is outside [1, 9]"),
        (["--level", "one"], "'one' is not an integer"),
        (["--seed", "-1"], "seed = -1 is outside"),
        (["--jobs", "-1"], "jobs = -1 is outside"),
        (["--quick", "--full"], "not allowed with"),
        (["--device", "gpu"], "device = 'gpu' is unknown"),
        (["--case", "nothing*"], "no case fits"),
    ):
        assert main([*HERE, *arguments]) == 2, arguments
        out, err = capsys.readouterr()
        assert err.startswith("veriray: error: ") and err.count("\n") == 1 and not out
        assert message in err
    assert os.listdir() == ["folder.html"]


CASES = '''
import os, signal, time
from veriray_validate.trial import case

@case(1, each={"k": range(5)})
def sound(t, k):
    """Fine."""
    t.p(float(t.rng.random()))

@case(2)
def crash(t):
    """Takes its process along."""
    os.kill(os.getpid(), signal.SIGKILL)

@case(3, each={"k": range(3)})
def endless(t, k):
    """Never ends."""
    time.sleep(1000)
'''


def test_a_worker_that_dies_is_an_error_of_its_case(command: Any) -> None:
    script = command(CASES)
    arguments = ["validate", "--device", "cpu", "--level", "1", "--level", "2", "--jobs", "2"]
    result = subprocess.run([sys.executable, script, *arguments, "--json"], capture_output=True,
                            text=True, timeout=300)  # fmt: skip
    report = json.loads(result.stdout)
    verdict = {c["id"]: c["verdict"] for c in report["cases"]}
    assert result.returncode == 1 and "Traceback" not in result.stderr
    assert verdict.pop("synthetic.crash") == "error" and set(verdict.values()) == {"pass"}
    assert len(verdict) == 5 and "signal 9" in result.stderr


def test_interrupt_leaves_no_process_and_says_what_is_missing(command: Any) -> None:
    script = command(CASES)
    arguments = ["validate", "--device", "cpu", "--level", "1", "--level", "3", "--jobs", "2"]
    process = subprocess.Popen(
        [sys.executable, script, *arguments, "-o", "r.json"], stdout=subprocess.PIPE,
        stderr=subprocess.PIPE, text=True,
        preexec_fn=lambda: signal.signal(signal.SIGINT, signal.default_int_handler),
    )  # fmt: skip
    try:
        assert process.stderr is not None
        while "5 of 8" not in process.stderr.readline():
            assert process.poll() is None
        time.sleep(1)
        process.send_signal(signal.SIGINT)
        out, err = process.communicate(timeout=60)  # a worker would hold the pipes open
    finally:
        process.kill()
    assert (
        process.returncode == 130 and "INCONCLUSIVE: No verdict: stopped with 3 cases to go" in out
    )
    assert err.endswith("veriray: error: interrupted\n") and "Traceback" not in err
    report = json.loads(Path("r.json").read_text("utf-8"))
    assert report["missing"] == [
        f"synthetic.endless[{k}] on {veriray.device.select('cpu')[0].name}" for k in range(3)
    ]
    assert not report["passed"] and len(report["cases"]) == 5 and os.listdir() == ["r.json"]


def test_levels_are_those_of_help_and_readme(capsys: Any) -> None:
    with pytest.raises(SystemExit):
        main(["validate", "--help"])
    assert f"{min(LEVELS)} to {max(LEVELS)}; repeatable" in capsys.readouterr().out
    rows = re.findall(r"^\| (\d) ([\w ]+) \|", (ROOT / "README.md").read_text("utf-8"), re.M)
    assert {int(number): name for number, name in rows} == {n: v.name for n, v in LEVELS.items()}
