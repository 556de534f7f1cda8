"""The command `veriray`: outputs, exit status, one-line errors and nothing half-written."""

from __future__ import annotations

import json
import os
import shlex
import signal
import subprocess
import sys
import time
import warnings
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

import veriray as vr
from veriray import info
from veriray.cli import main
from veriray.image import load
from veriray.rendering import METHODS

SMALL = ["--width", "16", "--height", "16", "--spp", "2", "--device", "cpu"]
COMMAND = [sys.executable, "-m", "veriray"]


@pytest.fixture(autouse=True)
def in_empty_folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)


def run(*arguments: str, **options: Any) -> subprocess.CompletedProcess[str]:
    return subprocess.run([*COMMAND, *arguments], capture_output=True, text=True, timeout=300,
                          **options)  # fmt: skip


def test_render_writes_and_reports(capsys: Any) -> None:
    outputs = ["-o", "a.exr", "-o", "a.png", "--stats", "a.json"]
    assert main(["render", "cornell-box", *SMALL, *outputs]) == 0
    out = capsys.readouterr().out
    picture = load("a.exr")
    stats = json.loads(Path("a.json").read_text("utf-8"))
    assert stats["film_sha256"] in out and stats["device"] in out
    for word in ("samples/s", "Live rays", "mean standard error", "fused", stats["device_reason"]):
        assert word in out
    expected = vr.render(vr.cornell_box(), 2, width=16, height=16, device="cpu")
    assert stats["film_sha256"] == expected.film_sha256
    assert np.array_equal(picture.image, expected.image)
    assert picture.film_sha256 == expected.film_sha256
    assert Path("a.png").read_bytes().startswith(b"\x89PNG")
    assert sorted(os.listdir()) == ["a.exr", "a.json", "a.png"]


def test_quiet(capsys: Any) -> None:
    assert main(["render", "cornell-box", *SMALL, "--quiet", "-o", "a.exr"]) == 0
    assert capsys.readouterr() == ("", "")


def test_parameters_reach_the_scene_file() -> None:
    arguments = ["-D", "spp=3", "-D", "width=8", "-D", "height=8", "--device", "cpu"]
    assert main(["render", "cornell-box", *arguments, "-o", "a.exr", "--stats", "a.json"]) == 0
    stats = json.loads(Path("a.json").read_text("utf-8"))
    assert (stats["spp"], stats["width"], stats["height"]) == (3, 8, 8)


def test_replay_prints_the_path(capsys: Any) -> None:
    assert main(["render", "cornell-box", "--pixel", "5", "7", "--sample", "3"]) == 0
    out = capsys.readouterr().out
    assert "pixel (5, 7), sample 3, seed 0" in out and "vertex 0: " in out
    assert os.listdir() == []


def test_bench_live_rays(capsys: Any) -> None:
    arguments = ["--width", "64", "--height", "40", "--device", "cpu", "--json", "b.json"]
    assert main(["bench", "live-rays", "cornell-box", *arguments]) == 0
    out = capsys.readouterr().out
    for header in ("Depth", "Live rays", "Thread blocks", "Share %", "ms"):
        assert header in out
    result = json.loads(Path("b.json").read_text("utf-8"))
    assert result["law_holds"] is True
    rows = result["rows"]
    assert rows[0]["live"] == 64 * 40 and rows[1]["blocks"] == 10
    for before, row in zip(rows, rows[1:], strict=False):
        assert row["blocks"] == -(-before["live"] // 256)


DROPPING = """<scene version="3.0.0"><sensor type="perspective"><float name="fov" value="40"/>
<transform name="to_world"><lookat origin="0,0,5" target="0,0,0" up="0,1,0"/></transform>
<film type="hdrfilm"><integer name="width" value="8"/><integer name="height" value="8"/></film>
</sensor><emitter type="constant"/><shape type="obj"><string name="filename" value="m.obj"/></shape>
<shape type="sphere"><bsdf type="dielectric"/></shape></scene>"""


def test_info(capsys: Any) -> None:
    Path("m.obj").write_text("v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 3\nf 1 2 2\n")
    Path("s.xml").write_text(DROPPING)
    assert main(["info", "s.xml", "--json", "--device", "cpu", "--width", "16"]) == 0
    report = json.loads(capsys.readouterr().out)
    assert {"spheres", "dielectric", "diffuse", "environment"} <= set(report["features"])
    assert set(report["features"]) <= set(report["variant"])
    assert not set(report["skipped"]) & set(report["variant"])
    assert set(report["unused"]) == set(report["variant"]) - set(report["features"])
    assert report["primitives"]["dropped"] == 1 and report["primitives"]["spheres"] == 1
    assert report["counts"]["triangles"] == 2 and report["materials"]["dielectric"] == 1
    assert report["path_bytes"] > 0 and report["memory"] > 0 and report["width"] == 16
    assert main(["info", "s.xml", "--device", "cpu"]) == 0
    out = capsys.readouterr().out
    for word in (
        "1 degenerate triangles dropped",
        "bytes per path",
        "tree ",
        "skipped",
        "refraction",
    ):
        assert word in out
    assert main(["render", "s.xml", "--device", "cpu", "--spp", "1", "-o", "a.exr"]) == 0
    assert "1 degenerate triangles dropped" in capsys.readouterr().out


def test_info_names_every_feature() -> None:
    """The table knows the native modules' features, so it can say which were skipped."""
    scene = vr.cornell_box().with_(width=8, height=8)
    report = info.examine(scene, "cpu")
    whole = vr.render(scene, 1, device="cpu", all_features=True).stats
    assert set(whole["variant"]) == set(info.FEATURES)
    stats = vr.render(scene, 1, device="cpu").stats
    assert stats["path_bytes"] == report["path_bytes"] and stats["tree"] == report["tree"]


def test_gallery_options_reach_the_gallery(monkeypatch: pytest.MonkeyPatch, capsys: Any) -> None:
    calls: list[Any] = []

    def fake(names: Any, output: Any, *, show: Any, say: Any, **options: Any) -> list[Path]:
        with show("title"):
            calls.append((names, output, options))
        if say:
            say("fig3 done")
        return []

    module = SimpleNamespace(names=lambda: ("fig3", "fig4"), run=fake)
    monkeypatch.setitem(sys.modules, "veriray.gallery", module)
    monkeypatch.setattr(vr, "gallery", module, raising=False)
    assert main(["gallery", "--list"]) == 0 and capsys.readouterr().out == "fig3\nfig4\n"
    assert main(["gallery", "fig3", "-o", "out", "--spp", "4", "--mesh", "m.ply", "--force"]) == 0
    assert capsys.readouterr().out == "fig3 done\n"
    assert main(["gallery", "--quiet", "--scale", "0.5", "--sheet"]) == 0
    assert capsys.readouterr() == ("", "")
    defaults = {"mesh": None, "spp": None, "seed": 0, "width": None, "scale": 1.0,
                "device": "auto", "threads": None, "force": False, "docs": None,
                "sheet_only": False}  # fmt: skip
    assert calls == [
        (["fig3"], "out", {**defaults, "spp": 4, "mesh": "m.ply", "force": True}),
        ([], "gallery", {**defaults, "scale": 0.5, "sheet_only": True}),
    ]


def test_doctor(capsys: Any) -> None:
    assert main(["doctor"]) == 0
    out = capsys.readouterr().out
    assert vr.__version__ in out and "auto takes" in out and "passed" in out
    assert main(["doctor", "--json"]) == 0
    report = json.loads(capsys.readouterr().out)
    assert report["self_test"]["passed"]
    assert {run["film_sha256"] for run in report["self_test"]["runs"]} == {
        report["self_test"]["expected"] or report["self_test"]["runs"][0]["film_sha256"]
    }
    assert set(report["unusable"]) | {d["name"].split(":")[0] for d in report["devices"]}


def test_compare(capsys: Any) -> None:
    for seed in "12":
        arguments = ["--seed", seed, "--spp", "512", "--batches", "32", "-o", f"{seed}.exr"]
        assert main(["render", "cornell-box", *SMALL, "--quiet", *arguments]) == 0
    dim = vr.render(
        vr.cornell_box().with_emission_scaled(0.8), 512, width=16, height=16, batches=32
    )
    dim.save("dim.exr")
    assert main(["compare", "1.exr", "2.exr", "-o", "r.html"]) == 0
    assert Path("r.html").read_text("utf-8").lstrip().lower().startswith("<!doctype html")
    assert main(["compare", "1.exr", "dim.exr"]) == 1
    capsys.readouterr()
    assert main(["compare", "1.exr", "dim.exr", "--json"]) == 1
    assert json.loads(capsys.readouterr().out)
    assert main(["compare", "1.exr", "missing.exr"]) == 2
    assert "missing.exr" in capsys.readouterr().err


Path_ = str
RENDER = ["render", "cornell-box", *SMALL]
BAD: list[tuple[list[str], str]] = [
    ([], "required: COMMAND"),
    (["paint"], "invalid choice: 'paint'"),
    (["render"], "required: SCENE"),
    (["render", "cornell-box"], "no output: add -o"),
    (["render", "no-such-scene", "-o", "a.exr"], "no shipped scene of that name; shipped: cornell"),
    (["render", "missing.xml", "-o", "a.exr"], "missing.xml"),
    (["render", "folder", "-o", "a.exr"], "folder"),
    (["render", "empty.xml", "-o", "a.exr"], "empty.xml"),
    ([*RENDER, "-o", "a.jpg"], "a.jpg: unknown suffix; expected .exr or .png"),
    ([*RENDER, "-o", "a"], "a: unknown suffix"),
    ([*RENDER, "-o", ""], "unknown suffix"),
    ([*RENDER, "-o", "missing/a.exr"], "missing/a.exr: folder"),
    ([*RENDER, "-o", "empty.xml/a.exr"], "Not a directory"),
    ([*RENDER, "-o", "folder.exr"], "folder.exr: Is a directory"),
    ([*RENDER, "-o", "pipe.exr"], "pipe.exr: not a regular file"),
    ([*RENDER, "-o", "a.exr/"], "a.exr/: names a folder, not a file"),
    ([*RENDER, "-o", "x" * 300 + ".exr"], "File name too long"),
    ([*RENDER, "-o", "loop.exr/a.exr"], "loop.exr/a.exr: Too many levels"),
    ([*RENDER, "-o", "a.exr", "-o", "./a.exr"], "the same output twice"),
    ([*RENDER, "-o", "a.png", "--batches", "2"], "--batches needs an output FILE.exr: a PNG"),
    ([*RENDER, "-o", "a.exr", "--stats", "a.txt"], "a.txt: unknown suffix; expected .json"),
    ([*RENDER, "-o", "a.exr", "--spp", "0"], "spp = 0 is outside [1, "),
    ([*RENDER, "-o", "a.exr", "--spp", "many"], "argument --spp: 'many' is not an integer"),
    ([*RENDER, "-o", "a.exr", "--spp", "1e3"], "'1e3' is not an integer"),
    ([*RENDER, "-o", "a.exr", "--seed", "-1"], "seed = -1 is outside"),
    ([*RENDER, "-o", "a.exr", "--width", "0"], "width = 0 is outside"),
    ([*RENDER, "-o", "a.exr", "--width", "99999999", "--height", "99999"], "pixels has more than"),
    ([*RENDER, "-o", "a.exr", "--max-depth", "-5"], "max_depth = -5 is outside"),
    ([*RENDER, "-o", "a.exr", "--rr-depth", "0"], "rr_depth = 0 is outside"),
    ([*RENDER, "-o", "a.exr", "--threads", "0"], "threads = 0 is outside"),
    ([*RENDER, "-o", "a.exr", "--batches", "3"], "batches = 3; expected 0 or a divisor"),
    ([*RENDER, "-o", "a.exr", "--scheduler", "best"], "scheduler = 'best' is unknown"),
    ([*RENDER, "-o", "a.exr", "--device", "gpu"], "device = 'gpu' is unknown; allowed: auto"),
    ([*RENDER, "-o", "a.exr", "--device", "cuda:99"], "cuda"),
    ([*RENDER, "-o", "a.exr", "-D", "spp"], "-D spp: expected KEY=VALUE"),
    ([*RENDER, "-o", "a.exr", "-D", "colour=1"], '"colour"'),
    ([*RENDER, "-o", "a.exr", "-D", "spp=lots"], "lots"),
    ([*RENDER, "-o", "a.exr", "--sample", "3"], "--sample goes with --pixel"),
    ([*RENDER, "--pixel", "16", "0"], "x = 16 is outside [0, 15]"),
    ([*RENDER, "--pixel", "0", "0", "--sample", "-1"], "sample = -1 is outside"),
    ([*RENDER, "--pixel", "0", "0", "-o", "a.exr"], "writes no file"),
    (["compare", "missing.exr", "missing.exr"], "missing.exr"),
    (["compare", "empty.xml", "empty.xml"], "empty.xml"),
    (["compare", "pipe.exr", "pipe.exr"], "pipe.exr: not a regular file"),
    (["compare", "a.exr", "b.exr", "-o", "report.pdf"], "report.pdf: unknown suffix"),
    (["validate", "--level", "12"], "level = 12 is outside [1, 9]"),
    (["validate", "--quick", "--full"], "not allowed with"),
    (["validate", "--jobs", "-1"], "jobs = -1 is outside"),
    (["validate", "--device", "gpu"], "device = 'gpu' is unknown"),
    (["validate", "-o", "missing/r.html"], "missing/r.html: folder"),
    (["validate", "-o", "r.pdf"], "r.pdf: unknown suffix; expected .html or .json"),
    (["bench"], "required: KIND"),
    (["bench", "live-rays", "cornell-box", "--json", "missing/b.json"], "missing/b.json: folder"),
    (["info"], "required: SCENE"),
    (["info", "missing.xml"], "missing.xml"),
    (["info", "cornell-box", "--width", "0"], "width = 0 is outside"),
    (["info", "cornell-box", "--device", "gpu"], "device = 'gpu' is unknown"),
    (
        ["info", "cornell-box", "--device", "cpu,cpu"],
        "'cpu,cpu' names several; this command takes one",
    ),
    (["bench", "live-rays", "cornell-box", "--device", "cpu,cpu"], "names several"),
    (["info", "cornell-box", "--sensor", "1"], "sensor = 1 is outside [0, 0]"),
    (["convert", "cornell-box"], "required: OUT.xml"),
    (["convert", "missing.xml", "out.xml"], "cannot read"),
    (["convert", "cornell-box", "a.exr"], "a.exr: unknown suffix; expected .xml"),
    (["convert", "cornell-box", "missing/out.xml"], "missing/out.xml: folder"),
    (["gallery", "no-such-picture"], "no-such-picture"),
    (["gallery", "--scale", "big"], "'big' is not a number"),
    (["gallery", "--scale", "2", "--width", "8"], "not allowed with"),
    (["doctor", "now"], "unrecognized arguments: now"),
]


@pytest.mark.parametrize(
    ("arguments", "message"), BAD, ids=lambda x: " ".join(x)[-60:] if x else "-"
)
def test_bad_input(arguments: list[str], message: str, capsys: Any) -> None:
    os.mkdir("folder")
    os.mkdir("folder.exr")
    os.mkfifo("pipe.exr")
    os.symlink("loop.exr", "loop.exr")
    Path("empty.xml").touch()
    before = sorted(os.listdir())
    assert main(arguments) == 2
    out, err = capsys.readouterr()
    assert err.startswith("veriray: error: ") and err.count("\n") == 1, err
    assert message in err
    assert "internal error" not in err and "Traceback" not in err
    assert sorted(os.listdir()) == before


def test_folder_that_cannot_be_written(capsys: Any) -> None:
    os.mkdir("locked", 0o555)
    if os.access("locked", os.W_OK):
        pytest.skip("this user (root) may write into any folder")
    assert main([*RENDER, "-o", "locked/a.exr"]) == 2
    assert "locked/a.exr: folder not writable" in capsys.readouterr().err


def test_disk_full_keeps_the_earlier_file() -> None:
    assert main([*RENDER, "--quiet", "-o", "a.exr"]) == 0
    before = Path("a.exr").read_bytes()
    script = (
        "import resource, signal, sys; from veriray.cli import main; "
        "signal.signal(signal.SIGXFSZ, signal.SIG_IGN); "
        "resource.setrlimit(resource.RLIMIT_FSIZE, (1000, 1000)); sys.exit(main(sys.argv[1:]))"
    )
    result = subprocess.run(
        [sys.executable, "-c", script, *RENDER, "--quiet", "--seed", "9", "-o", "a.exr"],
        capture_output=True, text=True, timeout=300,
    )  # fmt: skip
    assert result.returncode == 2
    assert result.stderr.startswith("veriray: error: a.exr: ")
    assert Path("a.exr").read_bytes() == before and os.listdir() == ["a.exr"]


@pytest.mark.parametrize(
    "streams, status",
    [("2>&-", 0), (">&-", 0), (">&- 2>&- <&-", 0), ("2>/dev/full", 0), (">/dev/full", 2),
     (">/dev/full 2>/dev/full", 2), ("1</dev/null", 2), ("2>&1 | true", 141), ("| head -1", 141)],
)  # fmt: skip
def test_closed_and_broken_streams_keep_the_picture(streams: str, status: int) -> None:
    line = f"{shlex.join([*COMMAND, *RENDER, '-o', 'a.exr'])} {streams}; exit ${{PIPESTATUS[0]}}"
    done = subprocess.run(["bash", "-c", line], capture_output=True, text=True, timeout=300)
    assert os.listdir() == ["a.exr"]
    load("a.exr")
    assert "internal error" not in done.stderr
    # the reader may be as fast as the renderer
    assert done.returncode in ((0, 141) if status == 141 else (status,))
    if streams == ">/dev/full":
        assert "veriray: error: standard output: No space left" in done.stderr


@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM])
@pytest.mark.parametrize("scheduler", METHODS)
def test_interrupt_leaves_nothing(scheduler: str, number: signal.Signals) -> None:
    endless = ["render", "cornell-box", "--device", "cpu", "--spp", "1000000000", "-o", "a.exr"]
    endless += ["--scheduler", scheduler, "--width", "64", "--height", "64", "--discard"]
    process = subprocess.Popen(
        [*COMMAND, *endless], stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True,
        preexec_fn=lambda: signal.signal(signal.SIGINT, signal.default_int_handler),
    )  # fmt: skip
    try:
        assert process.stdout is not None and process.stdout.readline().startswith("device")
        time.sleep(1)
        process.send_signal(number)
        _, err = process.communicate(timeout=60)
    finally:
        process.kill()
    assert process.returncode == 128 + number
    assert err.endswith("veriray: error: interrupted\n") and "Traceback" not in err
    assert os.listdir() == []


def test_reader_that_goes_away() -> None:
    process = subprocess.Popen(
        [*COMMAND, "doctor"], stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True
    )
    assert process.stdout is not None and process.stderr is not None
    process.stdout.close()
    assert process.stderr.read() == ""
    assert process.wait(timeout=300) == 141


def test_full_standard_output() -> None:
    with open("/dev/full", "w") as full:
        result = subprocess.run(
            [*COMMAND, "doctor", "--no-self-test"], stdout=full, stderr=subprocess.PIPE, text=True
        )
    assert result.returncode == 2
    assert result.stderr == "veriray: error: standard output: No space left on device\n"


def test_without_gpu() -> None:
    environment = {**os.environ, "CUDA_VISIBLE_DEVICES": ""}
    result = run(*RENDER, "--device", "auto", "-o", "a.exr", env=environment)
    assert result.returncode == 0
    assert result.stdout.startswith("device     cpu:")
    result = run(*RENDER, "--device", "cuda", "-o", "b.exr", env=environment)
    assert result.returncode == 2
    assert result.stderr.startswith("veriray: error: CUDA cannot be used: ")


def test_version_and_help() -> None:
    assert run("--version").stdout == f"veriray {vr.__version__}\n"
    commands = ("", "render", "compare", "validate", "info", "convert", "gallery",
                "bench live-rays", "doctor")  # fmt: skip
    for command in map(str.split, commands):
        result = run(*command, "--help")
        assert result.returncode == 0 and result.stdout.startswith("usage: veriray")


@pytest.mark.parametrize(
    ("package", "arguments"),
    [
        ("veriray_validate", ["validate"]),
        ("veriray_bench", ["bench", "all"]),
        ("veriray_bench", ["bench", "report", "x.json"]),
        ("veriray_bench", ["bench", "compaction", "open"]),
        ("veriray_bench", ["bench", "live-rays", "open"]),
    ],
)
def test_a_missing_package_is_named(
    package: str, arguments: list[str], monkeypatch: pytest.MonkeyPatch, capsys: Any
) -> None:
    monkeypatch.setitem(sys.modules, package, None)
    assert main(arguments) == 2
    assert capsys.readouterr().err.startswith(
        f"veriray: error: the package {package} is not installed"
    )


@pytest.mark.parametrize("exposure", ["nan", "inf", "1e9", "-1001", "bright"])
def test_a_bad_exposure_is_found_before_the_render(
    exposure: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    path = tmp_path / "a.png"
    assert main(["render", "cornell-box", "-o", str(path), "--exposure", exposure]) == 2
    assert exposure in capsys.readouterr().err and not path.exists()


def test_a_warning_that_is_a_note_too_is_told_once(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: Any
) -> None:
    monkeypatch.chdir(tmp_path)
    size = "".join(f'<integer name="{name}" value="8"/>' for name in ("width", "height"))
    film = f'<film type="hdrfilm">{size}</film>'
    beam = '<float name="cutoff_angle" value="10"/><float name="beam_width" value="20"/>'
    body = f'<sensor type="perspective">{film}</sensor><emitter type="spot">{beam}</emitter>'
    Path("s.xml").write_text(f'<scene version="3.0.0">{body}</scene>')
    with warnings.catch_warnings():
        warnings.simplefilter("always")
        assert main(["render", "s.xml", "-o", "a.exr", "--device", "cpu", "--spp", "1"]) == 0
    assert capsys.readouterr().err.count("beam_width = 20 is rendered as") == 1
