"""`veriray bench matrix`: its rules, figures and tables. No time is asserted."""

from __future__ import annotations

import copy
import dataclasses
import math
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from scipy import stats

import veriray
from veriray.cli import main
from veriray_bench import BenchError, peers, report, run, targets
from veriray_bench import matrix as bench_matrix
from veriray_bench.matrix import (
    ALARMS,
    FIGURES,
    Lane,
    Taken,
    alarm_limit,
    by_class,
    cells,
    choose,
    headline,
    judge,
    noise_of_mean,
    take_turns,
    variance,
)
from veriray_bench.matrix_report import matrix_line, matrix_sections
from veriray_bench.matrix_rules import RULES, SEEDS, Rule
from veriray_bench.race import Veriray
from veriray_bench.run import read

SMALL = [rule for rule in RULES if rule.name != "lamps-10000"]


@pytest.fixture(autouse=True)
def folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    monkeypatch.chdir(tmp_path)
    return tmp_path


# ---- the rules ----


def test_the_classes_of_the_issue_are_there() -> None:
    names = [rule.name for rule in RULES]
    assert len(set(names)) == len(names) >= 24 and SEEDS == 3
    assert {c.name for c in cells()} == {f"{name}-{k}" for name in names for k in range(SEEDS)}
    assert [c.name for c in choose(["lens", "room"], 2)] == ["room-0", "lens-0", "room-1", "lens-1"]
    with pytest.raises(ValueError, match="class 'rom' is unknown; expected some of: room, "):
        choose(["rom"], 1)
    with pytest.raises(ValueError, match=r"seeds = 0 is outside \[1, 1000\]"):
        choose([], 0)


@pytest.mark.parametrize("rule", SMALL, ids=lambda rule: rule.name)
def test_a_seed_is_a_scene(rule: Rule, folder: Path) -> None:
    """The same files again, others for another seed; and it renders light."""
    written = {}
    for name, seed in (("a", 0), ("b", 0), ("c", 1)):
        (folder / name).mkdir()
        rule.write(seed, folder / name, large=False)
        files = sorted((folder / name).iterdir())
        written[name] = [file.read_bytes() for file in files]
    assert written["a"] == written["b"]
    assert len(written["a"]) == len(written["c"]) and written["a"] != written["c"]
    scene = veriray.load_file(folder / "a" / f"{rule.name}-0.xml", {"width": 8, "height": 8})
    depths = {"max_depth": rule.max_depth, "rr_depth": rule.rr_depth}
    assert scene.film.width == 8
    image = veriray.render(scene, spp=4, device="cpu", **depths).image
    assert np.isfinite(image).all() and image.mean() > 1e-3


def test_rules_of_a_group_draw_alike(folder: Path) -> None:
    """So their ratios are of their surfaces."""
    for group in {rule.group for rule in RULES if rule.group}:
        cameras = set()
        for rule in (r for r in RULES if r.group == group):
            text = rule.write(2, folder, large=False).read_text()
            cameras.add(text[text.index("<sensor") : text.index("</sensor>")])
        assert len(cameras) <= 1 + (group == "mesh"), group


def test_mitsuba_loads_the_same_files(folder: Path) -> None:
    pytest.importorskip("mitsuba", reason="the peer renderer: pip install mitsuba")
    peer = peers.Peer("mitsuba", "scalar_rgb")
    film = {"width": 4, "height": 4, "max_depth": 3, "rr_depth": 5}
    try:
        for rule in SMALL:
            path = rule.write(1, folder, large=False)
            assert peer.load(rule.name, path, film) > 0
    finally:
        peer.close()


# ---- figures ----


def pictures(seed: int, count: int, noise: float, gain: float = 1.0) -> list[Any]:
    rng = np.random.default_rng(seed)
    truth = gain * np.linspace(0.5, 2, 32 * 32 * 3).reshape(32, 32, 3)
    return [truth * (1 + noise * rng.normal(size=truth.shape)) for _ in range(count)]


def test_variance_is_that_of_known_noise() -> None:
    """Within 5 standard deviations: false once in 1.7 million. Scaled by 2^k: the same bits."""
    reference = np.mean(pictures(0, 1, 0.0), axis=0)
    expected = float((reference**2 * 0.01 / (reference**2 + 0.01 * reference.mean() ** 2)).mean())
    found = [variance(pictures(seed, 4, 0.1), reference)[0] for seed in range(50)]
    assert abs(np.mean(found) - expected) < 5 * np.std(found) / math.sqrt(50)
    assert abs(1.02 * np.mean(found) - expected) > 5 * np.std(found) / math.sqrt(50)
    one = variance(pictures(3, 4, 0.1), reference)
    scaled = variance([p * 2.0**20 for p in pictures(3, 4, 0.1)], reference * 2.0**20)
    assert one == scaled
    few = [variance(pictures(seed, 4, 0.1), reference) for seed in range(200)]
    claimed = math.sqrt(np.mean([error**2 for _, error in few]))
    assert 0.5 < claimed / np.std([v for v, _ in few]) < 2


def test_the_limit_of_z_is_bonferroni() -> None:
    assert 2 * 3 * 111 * stats.norm.sf(alarm_limit(111)) == pytest.approx(ALARMS)


def test_means_of_equal_pictures_have_unit_z() -> None:
    """Chi-square of 300 z values at 1e-6; a noise of 1.3 times the stated one fails."""
    z = []
    for seed in range(100):
        a, b = pictures(2 * seed, 8, 0.1), pictures(2 * seed + 1, 8, 0.1)
        noise = np.hypot(noise_of_mean(a), noise_of_mean(b))
        z += list((np.mean(a, axis=(0, 1, 2)) - np.mean(b, axis=(0, 1, 2))) / noise)
    low, high = stats.chi2.ppf([5e-7, 1 - 5e-7], 300)
    assert low < np.sum(np.square(z)) < high
    assert not low < np.sum(np.square(z)) * 1.3**2 < high


def lane(wall: float, seed: int, noise: float, gain: float = 1.0) -> Lane:
    row = {"seconds": wall / 2, "wall": wall, "cpu": wall, "foreign": 0.0}
    return Lane({"wall": 9.0, "spp": 4}, [row] * 4, pictures(seed, 4, noise, gain))


def judged(peer: Lane) -> dict[str, Any]:
    taken = Taken({"veriray": lane(1.0, 1, 0.1), "peer": peer}, 16)
    return judge(taken, alarm_limit(111), 3e-4)["peer"]


def test_efficiency_is_wall_times_variance() -> None:
    """The noise of the peer is twice ours, its wall three times: 4 x and 12 x, to 20 % (20 standard
    errors).
    """
    found = judged(lane(3.0, 2, 0.2))["ratios"]
    assert found["wall"] == found["device"] == found["cpu"] == 3.0
    assert found["variance"] == pytest.approx(4, rel=0.2)
    assert found["efficiency"] == found["wall"] * found["variance"]


def test_means_that_differ_void_the_scene() -> None:
    row = judged(lane(3.0, 2, 0.2, gain=1.05))
    assert row["void"].startswith("the means of the pictures differ by -") and "ratios" not in row
    assert judged(Lane({}, [], [], "peer: died")) == {
        "void": "peer: died", "first": {}, "rounds": [],
    }  # fmt: skip


class Slow:
    """A contestant that says that a sample takes a second; fails at some seed."""

    def __init__(self, dies: int = 99) -> None:
        self.asked: list[tuple[int, int]] = []
        self.dies = dies

    def run(self, spp: int, seed: int) -> tuple[dict[str, Any], Any]:
        self.asked.append((spp, seed))
        if seed == self.dies:
            raise BenchError("slow: died")
        return {"seconds": spp, "wall": spp, "cpu": spp, "foreign": 0.0}, np.ones((2, 2, 3))


def test_samples_are_halved_to_the_budget() -> None:
    field = {"veriray": Slow(), "peer": Slow(), "bad": Slow(dies=3)}
    taken = take_turns(field, 64, 4, 70.0)
    assert taken.spp == 16
    assert field["peer"].asked == [(64, 0), (64, 1), (16, 2), (16, 3), (16, 4), (16, 5)]
    assert taken.lanes["bad"].failed == "slow: died" and len(field["bad"].asked) == 4
    assert taken.lanes["peer"].first == {"spp": 64, "wall": 64}
    with pytest.raises(BenchError):
        take_turns({"veriray": Slow(dies=1)}, 4, 2, 70.0)


# ---- runs ----


def test_a_run_alone_and_a_scene_that_fails(monkeypatch: pytest.MonkeyPatch) -> None:
    def broken(draw: Any) -> str:
        raise ValueError("planted")

    bad = dataclasses.replace(RULES[0], make=broken)
    monkeypatch.setattr(bench_matrix, "RULES", (bad, *RULES[1:]))
    scenes = cells([r for r in RULES if r.name in ("room", "open")], 1)
    path = run("out", "cpu", scenes=scenes, quick=True)
    assert path == Path("out/matrix_cpu.json")
    result = read(path)
    assert result["benchmark"] == "matrix" and list(result["scenarios"]) == ["room-0", "open-0"]
    assert result["scenarios"]["room-0"]["error"] == "ValueError: planted"
    row = result["scenarios"]["open-0"]
    own = row["rows"]["veriray"]
    assert own["efficiency"] == pytest.approx(1 / (own["wall"] * own["variance"]))
    assert own["first"]["load"] > 0 and row["class"] == "open" and row["figures"] == {}
    assert headline(result, "mitsuba") == {"scenes": 0, "void": 0, "failed": 1}
    (section,) = matrix_sections([result])
    assert section.title.startswith("Matrix: veriray alone on cpu")
    assert [r[0] for r in section.tables[0].rows] == ["room-0", "open-0"]
    assert matrix_line("room-0", result["scenarios"]["room-0"]) == (
        "room-0: FAILED: ValueError: planted"
    )
    assert {t["state"] for t in targets.targets([result])} == {"not measured"}


def test_a_limit_begins_no_more_scenes() -> None:
    path = run("out", "cpu", scenes=cells(RULES[:1], 2), quick=True, limit=1e-9)
    assert not path.exists()


def test_the_command(capsys: pytest.CaptureFixture[str]) -> None:
    words = ["bench", "matrix", "--device", "cpu", "--peers", "none", "--quick", "--seeds", "1"]
    assert main([*words, "--classes", "lens", "-o", "out"]) == 0
    said = capsys.readouterr().out
    assert said.startswith("lens-0: ") and "boxes through a thin lens" in said
    assert main([*words, "--classes", "lent"]) == 2
    assert "class 'lent' is unknown" in capsys.readouterr().err
    assert main([*words, "--limit", "0"]) == 2


# ---- the report ----


def canned(efficiency: float = 20.0) -> dict[str, Any]:
    """A whole result: all scenes alike, but for a weak class and a void scene."""
    own = {"wall": 0.01, "device": 0.005, "cpu": 0.02, "variance": 0.1, "efficiency": 1000.0,
           "foreign": 0.0, "first": {"wall": 0.1}}  # fmt: skip
    found = {
        "wall": efficiency / 2,
        "device": 8.0,
        "cpu": 7.0,
        "variance": 2.0,
        "efficiency": efficiency,
    }
    scenes: dict[str, Any] = {}
    for cell in cells():
        mitsuba = {**own, "ratios": found}
        scenes[cell.name] = {"title": cell.title, "kind": "matrix", "spp": 64,
                             "settings": {"scene": cell.scene}, "measured_seconds": 1.0,
                             "rows": {"veriray": own, "mitsuba": mitsuba},
                             "figures": {"mitsuba": found}}  # fmt: skip
    weak = scenes["lens-1"]
    weak["figures"]["mitsuba"] = {**found, "wall": 0.5, "efficiency": 0.8}
    void = copy.deepcopy(scenes["mask-0"])
    why = "the means of the pictures differ by 3 %, 9.0 standard errors"
    void |= {"rows": {"veriray": own, "mitsuba": {"agreement": {}, "void": why}}, "figures": {}}
    scenes["mask-0"] = void
    return {
        "benchmark": "matrix", "time": "2026-01-01T00:00:00Z", "commit": "c0ffee",
        "modified": False, "versions": {"veriray": "0.1.0"},
        "device": {"name": "cpu:avx512", "description": "a CPU"}, "build": {"backend": "cpu"},
        "machine": {"processor": "x86_64", "cpus": 2, "system": "Linux"},
        "settings": {"quick": False, "ratio_by": "wall", "limit": "41 Mpaths/s"},
        "peers": {"mitsuba": {"version": "3.9.1", "variant": "llvm_ad_rgb"}}, "scenarios": scenes,
    }  # fmt: skip


def test_the_headline_names_the_weakest_scene() -> None:
    result = canned()
    head = headline(result, "mitsuba")
    count = len(RULES) * SEEDS - 1
    assert head["scenes"] == count and head["void"] == 1 and head["failed"] == 0
    assert set(FIGURES) < set(head)
    assert head["efficiency"]["where"] == "lens-1" and head["efficiency"]["least"] == 0.8
    mean = math.exp(((count - 1) * math.log(20) + math.log(0.8)) / count)
    assert head["efficiency"]["mean"] == pytest.approx(mean)
    lens = by_class(result, "mitsuba")["lens"]
    assert lens["efficiency"] == {"mean": pytest.approx((20 * 20 * 0.8) ** (1 / 3)), "least": 0.8}
    mask = by_class(result, "mitsuba")["mask"]
    assert len(mask["rows"]) == 2 and mask["why"][0].startswith("the means")


def test_the_page_shows_weak_classes_and_judges_targets(folder: Path) -> None:
    result = canned()
    report.save([result], folder / "page.md")
    text = (folder / "page.md").read_text()
    assert "| efficiency | 19" in text and "0.8 x | lens-1 |" in text
    assert "| mask | the means of the pictures differ by 3 %" in text
    assert "| lens | boxes through a thin lens |" in text
    states = {t["target"].figure: t["state"] for t in targets.targets([result])}
    assert states == {"efficiency_mean": "met", "efficiency_least": "missed"}
    assert "FAIL" in text
    report.save([result], folder / "page.html")
    del result["scenarios"]["lens-1"]
    assert {t["state"] for t in targets.targets([result])} == {"not measured"}
    void = list(targets.void_rows(result["scenarios"]["mask-0"]))
    assert void == [("mitsuba", "the means of the pictures differ by 3 %, 9.0 standard errors")]


def test_ours_ends_the_clock_with_a_picture(cornell: veriray.Scene) -> None:
    row, image = Veriray(cornell, device="cpu").run(1, 0)
    assert isinstance(image, np.ndarray) and 0 < row["seconds"] <= row["wall"]
