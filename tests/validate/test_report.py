"""The report: verdict in words, every figure drawn or shown as text, no input that breaks it."""

from __future__ import annotations

import json
import re
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from veriray_validate import report
from veriray_validate.run import Validation
from veriray_validate.trial import Outcome

OUTCOME = Outcome(
    "closed.furnace[0.5]", 3, "A furnace", "cpu:avx2", "pass", "", 0.3, None, 2, 1, 2e-3,
    1_500_000, 0.5,
)  # fmt: skip


def validation(*outcomes: Outcome) -> Validation:
    return Validation(False, 1, {"cpu:avx2": "Some <CPU>"}, 1e-5, list(outcomes), 12.5,
                      {"second": 1e-4, "cpus": 2, "commit": "abc123"})  # fmt: skip


def other(verdict: str, message: str = "because\nof <that>", **changes: Any) -> Outcome:
    return replace(OUTCOME, id=f"closed.other[{verdict}]", verdict=verdict, message=message,
                   **changes)  # fmt: skip


def test_verdicts_in_words() -> None:
    for outcomes, result, words in (
        ([OUTCOME], "pass", "passed all of 1 case, each with an answer known beforehand, on "
                            "cpu:avx2 (Some <CPU>), seed 1, 1.5 million samples; a sound"),
        ([OUTCOME, other("skip")], "pass", "1 case could not run here"),
        ([OUTCOME, other("fail")], "fail", "Of 2 cases on cpu:avx2 (Some <CPU>), 1 failed, the "
                                           "first closed.other[fail] (because)"),
        ([OUTCOME, other("error")], "fail", "1 ended in an error"),
        ([OUTCOME, other("inconclusive")], "inconclusive", "1 of 2 cases had too little data"),
        ([other("skip")], "inconclusive", "nothing could run"),
    ):  # fmt: skip
        found, sentence = report.verdict(validation(*outcomes))
        assert found == result and words in sentence and sentence.endswith(".")
        assert "once in 100,000 times" in sentence or result == "inconclusive" or "error" in words


def test_the_first_of_the_failures_is_named() -> None:
    _, sentence = report.verdict(validation(other("error"), other("fail"), OUTCOME))
    assert "1 failed and 1 ended in an error, the first closed.other[fail]" in sentence


def test_headline_for_a_newcomer() -> None:
    passes = [replace(OUTCOME, id=f"closed.c[{k}]") for k in range(1200)]
    for outcomes, said, counts in (
        ([OUTCOME], "The one case that ran agrees with its known answer", (1, 1, 0, 0, 0)),
        (passes, "All 1,200 cases agree with their known answers", (1200, 1200, 0, 0, 0)),
        ([OUTCOME, other("skip")], "The one case that ran agrees", (1, 1, 0, 0, 1)),
        ([*passes, other("fail"), other("error")],
         "2 of 1,202 cases did not get the expected answer", (1200, 1202, 2, 0, 0)),
        ([OUTCOME, other("inconclusive")], "Not decided: 1 of 2 cases agree so far",
         (1, 2, 0, 1, 0)),
        ([replace(o, p=5e-4) for o in passes[:30]], "No case failed alone, but taken together",
         (30, 30, 0, 0, 0)),
    ):  # fmt: skip
        found = report.headline(validation(*outcomes))
        assert found["said"].startswith(said)
        keys = ("agree", "of", "failed", "undecided", "skipped")
        assert tuple(found[key] for key in keys) == counts
        assert found["chance"] == "once in 100,000 runs"
    stopped = validation(OUTCOME)
    stopped.missing = ["closed.b on cpu", "closed.c on cpu"]
    assert report.headline(stopped)["said"] == "Not decided: 1 of 3 cases agree so far"
    assert report.headline(stopped)["undecided"] == 2


def page(**figures: Any) -> str:
    return report.to_html(validation(replace(OUTCOME, p=None, figures=figures)))


def test_known_figures_are_drawn() -> None:
    without = page().count("<img")
    rng = np.random.default_rng(1)
    for figures in (
        {"z": rng.standard_normal(90).tolist()},
        {"live": {"measured": [100, 50, 0], "expected": [100.0, 50.0, 25.0]}},
        {"live": [100, 50, 25]},
        {"slope": {"spp": [1, 4, 16], "mse": [1, 0.25, 0.06], "slope": -1.01, "expected": -1}},
        {"slope": {"spp": [1, 4], "error": [1, 0.5]}},
        {"cells": {"observed": [[9, 11], [8, 12]], "expected": [[10, 10], [10, 10]]}},
        {"cells": {"observed": [9, 11], "expected": [10, 0]}},
        {"picture": rng.random((4, 6, 3)).tolist()},
        {"picture of a wall": rng.random((4, 6)).tolist()},
        {"picture in a file": "data:image/png;base64,iVBORw0KGgo="},
        {"map of z": rng.standard_normal((4, 6)).tolist()},
    ):
        assert page(**figures).count("<img") > without, figures
    assert 'class="cell p3" title="fine: p = 0.0005"' in page(p={"coarse": 0.5, "fine": 5e-4})
    assert page(p=[0.5, 0.005]).count('class="cell p') == 2
    table = page(**{"table of errors": {"columns": ["wall", "dE"], "rows": [["red", 0.25]]}})
    assert "<th>dE</th>" in table and "<td>0.25</td>" in table
    assert '<span class="text">1.235 2</span>' in page(other=[1.23456, 2])
    assert "a: 1, b: 2" in page(pair={"a": 1, "b": 2})


@pytest.mark.parametrize(
    "value",
    [
        None, "text", 3, 1.5, float("nan"), [], {}, [[]], [[1], [2, 3]], ["a"], {"x": 1},
        {"spp": 3}, {"spp": [1, 2], "mse": [1]}, {"observed": [1]}, {"columns": 1, "rows": 2},
        {"observed": [[1, 2]], "expected": [[1], [2]]}, [float("inf"), 1.0], np.float32(2),
        np.zeros((2, 0)), object, "<script>alert(1)</script>", "x" * 10_000, {"a": {"b": [1]}},
        {"rows": [[]], "columns": []}, {"measured": [0, 0]}, {"measured": "many"}, [[[[1]]]], True,
    ],
    ids=lambda v: str(v)[:30],
)  # fmt: skip
def test_odd_figures_are_shown_as_text(value: Any) -> None:
    names = ("z", "p", "cells", "slope", "live", "picture", "map", "table", "other", "<b>")
    text = page(**dict.fromkeys(names, value))
    assert "<script>alert" not in text and "<b>" not in text
    json.loads(report.to_json(validation(replace(OUTCOME, figures=dict.fromkeys(names, value)))))


def test_page_is_whole_and_safe() -> None:
    text = report.to_html(validation(OUTCOME, other("fail"), other("inconclusive"), other("skip")))
    assert text.count("<details open") == 1 and "of &lt;that&gt;" in text
    assert "Some &lt;CPU&gt;" in text and "abc123" in text
    assert not re.findall(r"(?:src|href)=\"(?!data:|#)", text) and "url(" not in text
    assert text.count("<script") == 1 and text.rstrip().endswith("</html>")
    assert text.index("closed.other[fail]") < text.index("closed.other[inconclusive]")
    assert text.index("What did not pass") < text.index("In short") < text.index("Levels")
    for opened in ("table", "details", "tr", "figure", "div", "pre", "span"):
        assert len(re.findall(rf"<{opened}\b", text)) == text.count(f"</{opened}>"), opened


def test_file_appears_whole_or_not_at_all(tmp_path: Path) -> None:
    v = validation(OUTCOME)
    with pytest.raises(ValueError, match=r"suffix '.txt'"):
        report.save(v, tmp_path / "r.txt")
    with pytest.raises(OSError, match="missing"):
        report.save(v, tmp_path / "missing" / "r.html")
    report.save(v, tmp_path / "r.json")
    report.save(v, tmp_path / "r.html")
    assert sorted(p.name for p in tmp_path.iterdir()) == ["r.html", "r.json"]
    lines = (tmp_path / "r.json").read_text("utf-8").splitlines()
    assert sum("closed.furnace" in line for line in lines) == 1


def test_text_has_a_line_a_level() -> None:
    v = validation(OUTCOME, replace(OUTCOME, level=6, sees=None), other("fail", level=8, sees=0.5))
    lines = report.as_text(v).splitlines()
    assert [line.split()[0] for line in lines[1:-1]] == ["3", "6", "8"]
    assert "0.2 %" in lines[1] and " - " in lines[2] and "fail (1)" in lines[3]
    assert lines[-1].startswith("FAIL: ")


def test_many_live_plots_are_cut(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(report, "_PANELS", 4)
    live = {"live": [100, 50, 25]}
    many = [replace(OUTCOME, id=f"live.c[{k}]", figures=live) for k in range(10)]
    assert "6 more are not drawn" in report.to_html(validation(*many))
