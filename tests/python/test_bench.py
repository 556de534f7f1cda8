"""`veriray bench all` and `bench report`. No time is asserted."""

from __future__ import annotations

import importlib.util
import json
import math
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from scipy import stats

import veriray
from veriray.cli import main
from veriray.info import FEATURES
from veriray.shipped import SHIPPED
from veriray_bench import SCENARIOS, BenchError, peers, report, run, targets
from veriray_bench.measure import at_error, errors, mean, mean_error, slope
from veriray_bench.race import Veriray, compare, race
from veriray_bench.run import KINDS, choose, read
from veriray_bench.scenarios import BACKENDS, scene_file


@pytest.fixture(autouse=True)
def folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    monkeypatch.chdir(tmp_path)
    return tmp_path


# ---- the table ----


def test_scenarios_are_well_formed() -> None:
    assert len({s.name for s in SCENARIOS}) == len(SCENARIOS)
    for s in SCENARIOS:
        assert s.kind in KINDS and s.name.replace("-", "").replace(".", "").isalnum()
        assert s.scene in SHIPPED or s.scene.split()[0] in (
            "icosphere",
            "glass",
            "thin",
            "cornell",
            "image",
            "lamp",
            "medium",
        )
        assert bool(s.vary) == (s.kind in ("scaling", "adaptive", "roulette"))
        assert bool(s.reference_spp) == (s.kind in ("error", "roulette"))
        assert s.backends and set(s.backends) <= set(BACKENDS)
        for backend in s.backends:
            for quick in (False, True):
                used = s.settings(backend, quick)
                json.dumps(used)
                assert used["width"] == used["height"] <= 2048 and used["rounds"] >= 2
                assert used["spp"] == sorted(used["spp"]) and used["spp"][0] >= 1
        for target in s.targets:
            for goal, moonshot in target.goals.values():
                assert moonshot <= goal if target.below else moonshot >= goal


def test_every_target_is_there() -> None:
    """Its rows: box (rate, limit), box to relMSE 1e-3, mesh, medium, overhead, tree, start,
    surfaces.
    """
    having = {s.name for s in SCENARIOS if s.targets}
    assert having == {"cornell", "cornell-error", "mesh-1.3M", "medium", "scaling-spp", "build",
                      "cold-start", "surfaces-cornell"}  # fmt: skip


def test_the_files_of_a_scene_differ_in_the_sampler_alone(folder: Path) -> None:
    for name in ("cornell-box-mitsuba", "cornell spheres", "glass medium", "glass sphere",
                 "icosphere 1", "glass icosphere 1"):  # fmt: skip
        plain = scene_file(name, folder)
        other = scene_file(name, folder, "multijitter")
        assert veriray.load_file(plain, {"width": 8, "height": 8}).film.width == 8
        assert other.read_text().replace("multijitter", "independent") == plain.read_text()


def test_choose() -> None:
    assert [s.name for s in choose(["medium", "cornell"], "cpu")] == ["cornell", "medium"]
    assert "scaling-threads" not in {s.name for s in choose([], "cuda")}
    with pytest.raises(ValueError, match="'cornel' is unknown; expected some of: cornell, "):
        choose(["cornel"], "cpu")
    with pytest.raises(ValueError, match="is not for cuda; it is for: cpu"):
        choose(["scaling-threads"], "cuda")


# ---- numbers ----


def test_error_is_unbiased_by_the_reference() -> None:
    """Image and reference with known noise: the estimate is the image's own variance within 5
    standard deviations (false once in 1.7 million).
    """
    rng = np.random.default_rng(5)
    truth = np.linspace(0.1, 2, 64 * 64 * 3).reshape(64, 64, 3)
    stderr = np.full(truth.shape, 0.05)
    found = [
        errors(truth + rng.normal(0, 0.1, truth.shape), truth + rng.normal(0, 0.05, truth.shape),
               stderr)["mse"] for _ in range(50)
    ]  # fmt: skip
    assert abs(np.mean(found) - 0.01) < 5 * np.std(found) / math.sqrt(50)
    biased = np.mean([f + 0.05**2 for f in found])
    assert abs(biased - 0.01) > 5 * np.std(found) / math.sqrt(50)


def test_time_to_an_error_is_interpolated_in_logarithms() -> None:
    seconds, error = [1.0, 4.0, 16.0], [1e-2, 2.5e-3, 6.25e-4]
    assert at_error(seconds, error, 5e-3) == (pytest.approx(2), False)
    assert at_error(seconds, error, 1.25e-3) == (pytest.approx(8), False)
    assert at_error(seconds, error, 1e-4) == (pytest.approx(100), True)
    assert at_error(seconds, error, 4e-2) == (pytest.approx(0.25), True)
    assert at_error(seconds, [1e-2, 1e-2, 1e-2], 1e-3) == (None, False)
    assert at_error([1.0], [1e-2], 1e-3) == (None, False)
    assert slope(seconds, error) == (pytest.approx(-1), pytest.approx(0, abs=1e-12))
    assert slope([1, 1], [2, 3]) == (None, None)


def test_slope_has_the_standard_error_of_least_squares() -> None:
    x, y = [1.0, 4.0, 16.0, 64.0, 256.0], [1.1, 0.24, 0.07, 0.015, 0.0042]
    line = stats.linregress(np.log(x), np.log(y))
    assert slope(x, y) == (pytest.approx(line.slope), pytest.approx(line.stderr))
    assert slope([*x, 1024.0], [*y, -1e-6]) == slope(x, y)
    assert slope(x[:2], y[:2]) == (pytest.approx(math.log(0.24 / 1.1, 4)), None)


# ---- races ----


class Stand:
    """A peer whose picture is ours with other seeds, times `gain`; fails from round `dies` on."""

    def __init__(self, scene: veriray.Scene, gain: float = 1.0, dies: int = 99) -> None:
        self.own, self.gain, self.dies = Veriray(scene, device="cpu"), gain, dies

    def run(self, spp: int, seed: int) -> tuple[dict[str, Any], Any]:
        if seed >= self.dies:
            raise BenchError("stand: ended with status -9")
        row, image = self.own.run(spp, seed + 1000)
        return row, image * self.gain


def rows_of(scene: veriray.Scene, stand: Any) -> dict[str, Any]:
    field = {"veriray": Veriray(scene, device="cpu"), "stand": stand}
    return compare(field, race(field, 64, 3), 1e-5, "wall")


def test_same_pictures_are_raced(cornell: veriray.Scene) -> None:
    rows = rows_of(cornell, Stand(cornell))
    assert "void" not in rows["stand"] and rows["stand"]["agreement"]["agree"]
    ratio = rows["stand"]["times_faster"]["wall"]
    assert len(ratio["rounds"]) == 3 and ratio["median"] > 0
    assert rows["veriray"]["film_sha256"] and rows["veriray"]["live_rays"]


def test_a_planted_bias_voids_the_row(cornell: veriray.Scene) -> None:
    row = rows_of(cornell, Stand(cornell, gain=1.1))["stand"]
    assert max(abs(z) for z in row["agreement"]["z"]) > 8  # 4 voids it
    assert row["void"].startswith("the means of the pictures differ by -")
    assert "times_faster" not in row and "wall" not in row and len(row["rounds"]) == 3


def test_another_film_of_ours_voids_the_row(cornell: veriray.Scene) -> None:
    row = rows_of(cornell, Veriray(cornell, device="cpu", max_depth=3))["stand"]
    assert row["void"] == "the film differs from that of veriray"


def test_a_peer_that_fails_drops_out(cornell: veriray.Scene) -> None:
    row = rows_of(cornell, Stand(cornell, dies=2))["stand"]
    assert row == {"void": "stand: ended with status -9", "rounds": row["rounds"]}


def test_a_peer_that_cannot_start_is_a_row(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(peers.VARIANTS, "ghost", {"cpu": "none"})
    path = run("out", "cpu", only=["cold-start"], peers=["ghost"], quick=True)
    result = read(path)
    assert "No module named veriray_bench.ghost" in result["peers"]["ghost"]["missing"]
    row = result["scenarios"]["cold-start"]
    why = result["peers"]["ghost"]["missing"]
    assert list(targets.void_rows(row, absent=True)) == [("ghost", why)]
    assert not list(targets.void_rows(row))
    assert row["figures"]["seconds"] > 0 and "share_of_peer" not in row["figures"]


def test_mitsuba_in_its_process(folder: Path) -> None:
    pytest.importorskip("mitsuba", reason="the peer renderer: pip install mitsuba")
    film = {"width": 16, "height": 16, "max_depth": 8, "rr_depth": 5}
    peer = peers.Peer("mitsuba", "scalar_rgb")
    try:
        path = scene_file("cornell-box-mitsuba", folder)
        assert peer.load("box", path, film) > 0
        row, image = peer.run("box", 4, 1)
        assert image.shape == (16, 16, 3) and image.mean() > 0.1
        assert set(row) == {"seconds", "wall", "cpu", "foreign"}
        with pytest.raises(BenchError, match="mitsuba: KeyError"):
            peer.run("no such scene", 4, 1)
        assert peer.alive
    finally:
        peer.close()
    assert not peer.alive


def test_cycles_in_its_process(folder: Path) -> None:
    """Seeds change the picture, and its mean is within 5 of our standard errors of ours."""
    if importlib.util.find_spec("bpy") is None:
        pytest.skip("Cycles is compared by bpy, which is not installed")
    film = {"width": 32, "height": 32, "max_depth": 8, "rr_depth": 5}
    path = scene_file("cornell-box-mitsuba", folder)
    peer = peers.Peer("cycles", "cpu")
    try:
        peer.load("box", path, film)
        first, second = (peer.run("box", 256, seed)[1] for seed in (1, 2))
    finally:
        peer.close()
    ours = veriray.render(veriray.load_file(path, film), spp=256, device="cpu")
    assert not np.array_equal(first, second)
    far = mean(ours.image) - mean(first + second) / 2
    assert (np.abs(far) < 5 * mean_error(ours.stderr)).all()


def test_cycles_refuses_what_it_cannot_render(folder: Path) -> None:
    from veriray_bench.cycles import Cycles

    with pytest.raises(ValueError, match="spheres, media, dielectric: this peer takes"):
        Cycles(None).load("glass", str(scene_file("glass medium", folder)), {})
    with peers.Crew(["cycles"], "cuda") as crew:
        assert crew.about == {"cycles": {"missing": "not raced on cuda"}}
        assert not list(crew.names())


# ---- studies ----


def quick(name: str) -> dict[str, Any]:
    """The result of one scenario's smoke test."""
    result = read(run("out", "cpu", only=[name], quick=True, again=True))
    row: dict[str, Any] = result["scenarios"][name]
    return row


def test_slopes_of_both_samplers_are_reported() -> None:
    row = quick("sampler-error")
    assert list(row["rows"]) == ["veriray independent", "veriray sobol"]
    for entry in row["rows"].values():
        assert set(entry["slope"]) == set(entry["slope_error"]) == {"mse", "relmse"}
        assert entry["slope"]["relmse"] < 0 < entry["slope_error"]["relmse"]
    report.save(report.find(["out"]), "r.md")
    assert " \u00b1 " in Path("r.md").read_text("utf-8")


def test_variants_draw_one_film() -> None:
    row = quick("variants-cornell")
    exact, everything = row["rows"]["exact"], row["rows"]["everything"]
    assert exact["film_sha256"] == everything["film_sha256"]
    assert len(exact["variant"]) < len(everything["variant"]) == len(FEATURES)
    assert exact["path_bytes"] == row["path_bytes"]["of every path"] == 60
    assert everything["path_bytes"] == sum(row["path_bytes"].values())
    assert row["figures"]["times_faster"] > 0 and not list(targets.void_rows(row))


def test_variants_of_two_films_are_void(monkeypatch: pytest.MonkeyPatch) -> None:
    plain = Veriray.run

    def other(self: Veriray, spp: int, seed: int) -> Any:
        return plain(self, spp, seed + 100 * bool(self.settings.get("all_features")))

    monkeypatch.setattr(Veriray, "run", other)
    row = quick("variants-cornell")
    assert list(targets.void_rows(row)) == [("everything", "the film differs from that of exact")]
    assert row["figures"] == {}


def test_roulette_is_judged_against_its_own_rounds() -> None:
    row = quick("roulette-open")
    rows, figures = row["rows"], row["figures"]
    assert list(rows) == [*(f"rr_depth {d}" for d in (1, 2, 3, 5, 8, 16)), "no roulette"]
    assert rows["rr_depth 5"]["efficiency"] == {"mse": [1, 0], "relmse": [1, 0]}
    rays = [r["rays_per_path"] for r in rows.values()]
    assert rays == sorted(rays) and rays[0] < rays[-1]
    best = max(r["efficiency"]["mse"][0] for r in rows.values())
    assert rows[figures["winner"]]["efficiency"]["mse"][0] == figures["efficiency"] == best
    for r in rows.values():
        pairs = zip(rows["rr_depth 5"]["rounds"], r["rounds"], strict=True)
        gains = [b["wall"] * b["mse"] / (o["wall"] * o["mse"]) for b, o in pairs]
        assert r["efficiency"]["mse"][0] == pytest.approx(math.prod(gains) ** (1 / len(gains)))


def test_a_start_with_another_mean_is_void(monkeypatch: pytest.MonkeyPatch) -> None:
    plain = Veriray.run

    def dark(self: Veriray, spp: int, seed: int) -> Any:
        row, image = plain(self, spp, seed)
        return row, image * (0.8 if self.settings["rr_depth"] == 8 else 1)

    monkeypatch.setattr(Veriray, "run", dark)
    row = quick("roulette-open")
    assert row["rows"]["rr_depth 8"]["void"].startswith("the means of the pictures differ by 25")
    assert [who for who, _ in targets.void_rows(row)] == ["rr_depth 8"]
    assert row["figures"]["winner"] != "rr_depth 8"


# ---- the runner ----


def test_run_and_resume(monkeypatch: pytest.MonkeyPatch) -> None:
    names = ["cornell", "depth-open"]
    seen: list[tuple[str, bool]] = []

    def stop(scenario: Any, row: Any, kept: bool) -> None:
        raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        run("out", "cpu", only=names, quick=True, done=stop)
    first = read("out/bench_cpu.json")
    assert list(first["scenarios"]) == ["cornell"]
    row = first["scenarios"]["cornell"]
    assert row["rows"]["veriray"]["film_sha256"] == row["rows"]["veriray thrust"]["film_sha256"]
    assert 0 < row["figures"]["percent_of_limit"] < 200

    def note(scenario: Any, row: Any, kept: bool) -> None:
        seen.append((scenario.name, kept))

    run("out", "cpu", only=names, quick=True, done=note)
    assert seen == [("cornell", True), ("depth-open", False)]
    second = read("out/bench_cpu.json")
    assert second["scenarios"]["cornell"] == row
    for key in ("commit", "machine", "versions", "device", "build", "settings", "peers"):
        assert second[key] == first[key]
    run("out", "cpu", only=["depth-open"], quick=True, again=True, done=note)
    assert seen[-1] == ("depth-open", False)
    with pytest.raises(BenchError, match=r"of another run: settings was .*name another folder"):
        run("out", "cpu", only=names)
    assert read("out/bench_cpu.json")["scenarios"]["cornell"] == row


def test_a_scenario_in_error_is_kept_and_tried_again(monkeypatch: pytest.MonkeyPatch) -> None:
    def broken(*_: Any) -> dict[str, Any]:
        raise veriray.OutOfMemoryError("needed 1 TiB")

    with monkeypatch.context() as patch:
        patch.setitem(KINDS, "depth", broken)
        path = run("out", "cpu", only=["depth-open"], quick=True)
    row = read(path)["scenarios"]["depth-open"]
    assert row["error"] == "OutOfMemoryError: needed 1 TiB"
    assert list(targets.void_rows(row)) == [("", row["error"])]
    row = read(run("out", "cpu", only=["depth-open"], quick=True))["scenarios"]["depth-open"]
    assert "error" not in row and row["table"]["rows"][0]["live"] == 64 * 64


# ---- the report ----


def canned(ratio: float = 7.0) -> dict[str, Any]:
    """A result as the runner writes it, with a void row."""
    spread = {"seconds": 0.01, "wall": 0.01}
    times = {"seconds": 1.0, "wall": 1.0, "cpu": 2.0, "foreign": 0.0, "spread": spread}
    speed = {"seconds": 1.0, "mpaths_per_second": 20.0, "mpaths_per_cpu_second": 10.0, **times}
    faster = {key: {"median": ratio, "spread": 0.0, "rounds": [ratio]}
              for key in ("seconds", "wall", "cpu")}  # fmt: skip
    agreement = {"relative_difference": [1e-5, -3e-5, 0], "z": [0.2, -1.1, 0], "agree": True}
    settings = {"width": 512, "height": 512, "spp": [64]}
    common = {"kind": "speed", "settings": settings, "measured_seconds": 9.0}
    mitsuba = {**speed, "mpaths_per_second": 20 / ratio, "times_faster": faster,
               "agreement": agreement}  # fmt: skip
    points = [{"spp": n, **times, "wall": n / 64, "mse": 0.1 / n, "relmse": 0.16 / n}
              for n in (1, 16, 256)]  # fmt: skip
    curve = {"points": points, "slope": {"relmse": -1.0, "mse": -1.0}, "seconds_to_target": 2.5,
             "extrapolated": False, "efficiency": 3.0, "agreement": agreement}  # fmt: skip
    exact = {**speed, "kernel": {"registers": 96, "local_bytes": 0, "resident_threads": 640},
             "path_bytes": 60, "variant": ["quads"]}  # fmt: skip
    start = {**speed, "mse": 0.1, "relmse": 0.2, "rays_per_path": 5.5, "agreement": agreement,
             "efficiency": {"mse": [1.0, 0.0], "relmse": [1.0, 0.0]}}  # fmt: skip
    early = {**start, "efficiency": {"mse": [1.25, 0.0625], "relmse": [0.875, 0.03125]}}
    return {
        "benchmark": "bench", "time": "2026-01-01T00:00:00Z", "commit": "c0ffee", "modified": False,
        "versions": {"veriray": "0.1.0"}, "device": {"name": "cpu:avx512", "description": "a CPU"},
        "machine": {"processor": "x86_64", "cpus": 2, "system": "Linux"},
        "build": {"backend": "cpu"},
        "settings": {"quick": False, "ratio_by": "wall", "limit": "41 Mpaths/s"},
        "peers": {"mitsuba": {"version": "3.9.1", "variant": "llvm_ad_rgb"}},
        "scenarios": {
            "cornell": {**common, "title": "box", "rows": {"veriray": speed, "mitsuba": mitsuba},
                        "figures": {"times_faster": ratio}},
            "mesh-1.3M": {**common, "title": "mesh", "figures": {},
                          "rows": {"veriray": speed, "mitsuba": {"void": "the means differ"}}},
            "cornell-error": {**common, "kind": "error", "title": "curve", "target_relmse": 1e-3,
                              "rows": {"veriray independent": curve},
                              "figures": {"seconds_to_target": 2.5}},
            "variants-cornell": {
                **common, "kind": "variants", "title": "v", "path_bytes": {"of every path": 60},
                "figures": {"times_faster": 1.5},
                "rows": {"exact": exact,
                         "everything": {**exact, "variant": ["quads", "bvh"],
                                        "times_faster": faster}},
            },
            "roulette-open": {
                **common, "kind": "roulette", "title": "r",
                "rows": {"rr_depth 2": early, "rr_depth 5": start, "rr_depth 8": {"void": "means"}},
                "figures": {"winner": "rr_depth 2", "efficiency": 1.25, "error": 0.0625},
            },
        },
    }  # fmt: skip


def states(result: dict[str, Any]) -> dict[str, str]:
    return {t["scenario"].name: t["state"] for t in targets.targets([result])}


def test_targets_are_judged() -> None:
    judged = states(canned())
    assert judged["cornell"] == "met" and judged["mesh-1.3M"] == "void"
    assert judged["build"] == judged["cornell-error"] == "not measured"
    assert states(canned(5.9))["cornell"] == "missed"
    quick = canned()
    quick["settings"]["quick"] = True
    assert states(quick)["cornell"] == "quick"
    assert targets.verdict([canned(5.4)])[0] == "fail"
    assert "the farthest: cornell" in targets.verdict([canned(5.4)])[1]
    assert "at 90 % of its target" in targets.verdict([canned(5.4)])[1]
    assert targets.verdict([canned()])[0] == "inconclusive"


def test_a_busy_machine_puts_a_target_in_doubt() -> None:
    busy = canned()
    busy["scenarios"]["cornell"]["rows"]["mitsuba"]["foreign"] = 0.5
    judged = next(t for t in targets.targets([busy]) if t["scenario"].name == "cornell")
    assert (judged["state"], judged["doubt"]) == ("met", "others used 0.5 cores")
    assert "of those judged 1 in doubt" in targets.verdict([busy])[1]
    assert "in doubt" not in targets.verdict([canned()])[1]


def test_smaller_is_better_where_the_target_says_so() -> None:
    build = next(s for s in SCENARIOS if s.name == "build").targets[0]
    for value, state in ((0.3, "met"), (0.6, "met"), (0.61, "missed")):
        assert targets.judge(build, "cpu", {"figures": {build.figure: value}})["state"] == state


@pytest.mark.parametrize("suffix", [".html", ".md"])
def test_report_has_the_rows(folder: Path, suffix: str) -> None:
    (folder / "out").mkdir()
    (folder / "out" / "bench_cpu.json").write_text(json.dumps(canned()))
    path = folder / f"r{suffix}"
    report.save(report.find(["out"]), path)
    text = path.read_text("utf-8")
    for expected in (
        "1 of 8 targets met", "the means differ", "cornell, 512x512, 64 spp", "7 x", "2.5 s",
        "-3.0e-05, 1.1", "c0ffee", "llvm_ad_rgb", "at least 6 x",
        "-1.000", "640", "everything", "of every path 60", "rr_depth 2 (best)",
        "1.250 \u00b1 0.062", "0.875 \u00b1 0.031",
    ):  # fmt: skip
        assert expected in text, expected
    pictures = list((folder / "r_plots").glob("*.png")) if suffix == ".md" else []
    assert len(pictures) == (5 if suffix == ".md" else 0)
    assert all(f"(r_plots/{p.name})" in text for p in pictures)
    assert suffix == ".md" or text.count("data:image/svg+xml;base64,") == 5


def test_the_device_is_named_in_each_row_where_there_are_several() -> None:
    one, other = canned(), canned()
    other["device"] = {**other["device"], "name": "cpu:avx2"}
    for results in ([one], [one, other]):
        *parts, facts = report.sections(results)
        named = {"device" in table.columns for part in parts for table in part.tables}
        assert named == {len(results) == 2} and facts.tables[0].columns[0] == "device"
        for table in (table for part in parts for table in part.tables):
            assert {len(row) for row in table.rows} == {len(table.columns)}


# ---- the command ----


def test_commands(capsys: Any) -> None:
    arguments = ["--only", "depth-open", "--peers", "none", "--quick", "--device", "cpu"]
    assert main(["bench", "all", *arguments, "-o", "out"]) == 0
    assert "depth-open: done" in capsys.readouterr().out
    assert main(["bench", "report", "out", "-o", "r.html"]) == 0
    assert "targets met on cpu" in capsys.readouterr().out
    assert Path("r.html").read_text().startswith("<!doctype html>")


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (["all", "--only", "cornel"], "scenario 'cornel' is unknown"),
        (["all", "--peers", "arnold"], "peer 'arnold' is unknown; expected none or some of: mit"),
        (["all", "--peers", ","], "no peers named"),
        (["all", "--wait", "-1"], "wait = -1 is outside [0, 86400]"),
        (["all", "--device", "gpu"], "device = 'gpu' is unknown"),
        (["all", "--only", "depth-open", "--peers", "none", "-o", "file"], "file"),
        (["report"], "required: PATH"),
        (["report", "missing"], "missing: No such file"),
        (["report", "file"], "file: not JSON"),
        (["report", "other.json"], "other.json: not a result of"),
        (["report", "."], "no bench_*.json and no matrix_*.json inside"),
        (["report", "x", "-o", "r.pdf"], "r.pdf: unknown suffix; expected .html or .md"),
    ],
)
def test_errors(arguments: list[str], message: str, capsys: Any) -> None:
    Path("file").write_text("{")
    Path("other.json").write_text("[]")
    assert main(["bench", *arguments]) == 2
    assert message in capsys.readouterr().err
