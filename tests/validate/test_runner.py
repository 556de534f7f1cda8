"""The machinery of `veriray validate`: registration, two stages, verdicts, seeds, processes."""

from __future__ import annotations

import json
import os
import re
import shutil
import time
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from scipy import stats

import veriray
from veriray_validate import Inconclusive, Skipped, furnace, pool, validate
from veriray_validate.run import SEED, Validation, held_by
from veriray_validate.trial import (
    CASES,
    CONFIRM,
    FAMILY,
    FIRST,
    MANY,
    SECOND,
    Case,
    Outcome,
    Trial,
    case,
    judge,
)

Suite = dict[str, Case]
ROOT = Path(__file__).resolve().parents[2]


def only() -> Case:
    (result,) = CASES.values()
    return result


def run(**settings: Any) -> Validation:
    return validate(["cpu"], workers=0, **settings)


def likely(count: int, n: int, p: float) -> bool:
    """Whether a binomial count is plausible; wrong once in 100,000."""
    return bool(stats.binomtest(count, n, p).pvalue > 1e-5)


# ---- registration ----


def test_registration(suite: Suite) -> None:
    @case(2, each={"a": [1, 2], "b": {"x": 0, "y": 1}}, quick=lambda a, b: a == 1, once=True)
    def sampler(t: Trial, a: int, b: str) -> None:
        """A title.

        What is expected,
        and why.
        """
        t.check(True)

    name = "test_runner.sampler"
    assert list(suite) == [f"{name}[{a},{b}]" for a in (1, 2) for b in "xy"]
    c = suite[f"{name}[1,y]"]
    assert (c.title, c.expects) == ("A title.", "What is expected, and why.")
    assert (c.level, c.arguments, c.quick, c.once) == (2, {"a": 1, "b": "y"}, True, True)
    assert not suite[f"{name}[2,x]"].quick
    assert len(run().outcomes) == 2 and len(run(full=True, effort=1).outcomes) == 4
    assert len(run(pattern="*y?", full=True).outcomes) == 2
    assert len(run(pattern=f"{name}[1,y]").outcomes) == 1  # not as a set of characters
    with pytest.raises(ValueError, match="exists twice"):
        case(2, each={"a": [1], "b": ["x"]})(sampler)
    with pytest.raises(ValueError, match="no case fits"):
        run(levels=[3])


def test_the_fixture_leaves_no_trace() -> None:
    assert not any(name.startswith("test_runner") for name in CASES)


# ---- the two stages ----


def test_false_alarm_rate_of_the_two_stages(suite: Suite) -> None:
    """60,000 judgements of a sound case with three p values.

    The second threshold is raised to 0.3, or none would ever fail.
    """

    @case(1)
    def sound(t: Trial) -> None:
        for p in t.rng.random(3):
            t.p(p)

    n, second = 60_000, 0.3
    outcomes = [judge(only(), "cpu", seed=seed, second=second) for seed in range(n)]
    p = np.array([o.p for o in outcomes])
    first = int((p < FIRST).sum())
    failed = sum(o.verdict == "fail" for o in outcomes)
    assert likely(first, n, FIRST)
    assert likely(failed, first, second) and likely(failed, n, FIRST * second)
    assert stats.kstest(p, "uniform").pvalue > 1e-5
    assert {o.verdict for o in outcomes} == {"pass", "fail"}
    assert sum(o.confirmed is not None for o in outcomes) == first


def test_power_stays_that_of_the_first_stage(suite: Suite) -> None:
    """A bias that the first stage finds 9 times in 10 fails the case 9 times in 10."""
    bias = stats.norm.isf(FIRST / 2) + stats.norm.ppf(0.9)

    @case(1)
    def biased(t: Trial) -> None:
        z = t.rng.normal(bias * np.sqrt(t.effort))
        t.p(2 * stats.norm.sf(abs(z)))

    failed = sum(judge(only(), "cpu", seed=seed).verdict == "fail" for seed in range(2000))
    assert likely(failed, 2000, 0.9)


def test_second_stage_has_more_samples_and_fresh_numbers(suite: Suite) -> None:
    seen = []

    @case(1)
    def unlucky(t: Trial) -> None:
        seen.append((t.effort, t.seed, t.fresh(), t.fresh(), float(t.rng.random())))
        t.p(1e-4 if len(seen) == 1 else 1e-3, "noise")

    o = judge(only(), "cpu", effort=3)
    assert (o.verdict, o.p, o.confirmed) == ("pass", pytest.approx(1e-4), pytest.approx(1e-3))
    assert [effort for effort, *_ in seen] == [3, 3 * CONFIRM]
    assert len({x for row in seen for x in row[1:]}) == 8
    judge(only(), "cpu", effort=3)
    assert seen[2] == seen[0]


def test_exact_conditions_have_one_stage(suite: Suite) -> None:
    calls = []

    @case(1)
    def wrong(t: Trial) -> None:
        calls.append(t)
        t.p(1e-9)
        t.check([True, False], "the second element")

    o = judge(only(), "cpu")
    assert (o.verdict, o.message, len(calls)) == ("fail", "the second element", 1)


def test_an_error_in_the_second_stage_counts(suite: Suite) -> None:
    for k, problem in enumerate((ValueError("broken"), Inconclusive("thin"), Skipped("gone"))):

        @case(1, each={"k": [k]})
        def late(t: Trial, k: int, problem: Exception = problem) -> None:
            t.p(1e-9)
            if t.effort > 1:
                raise problem

    verdicts = [o.verdict for o in run().outcomes]
    assert verdicts == ["error", "inconclusive", "skip"] and not run().passed


def test_planted_failure_fails_and_says_why(suite: Suite) -> None:
    @case(3)
    def planted(t: Trial) -> None:
        """One per mille too bright."""
        t.p(1e-7, "the left pixel")

    @case(3)
    def sound(t: Trial) -> None:
        t.p(0.5)

    v = run()
    o = v.outcomes[0]
    assert o.verdict == "fail" and not v.passed and v.levels()[0]["verdict"] == "fail"
    assert "the left pixel" in o.message and "1e-07, then 1e-07" in o.message
    assert v.outcomes[1].verdict == "pass" and v.outcomes[1].message == ""


def test_conditions(suite: Suite) -> None:
    t = Trial("cpu")
    t.check(np.ones(3))
    t.raises(ValueError, lambda: int("x"), "invalid", "'x'")
    for wrong in (
        lambda: t.check(np.array([1, 0])),
        lambda: t.raises(ValueError, lambda: None),
        lambda: t.raises(ValueError, lambda: int("x"), "other words"),
        lambda: t.p(float("nan"), "mean"),
    ):
        with pytest.raises(Exception) as caught:
            wrong()
        assert type(caught.value).__name__ == "Failed" and str(caught.value)
    with pytest.raises(KeyError):
        t.raises(ValueError, lambda: {}["x"])
    assert t.checks == 6


# ---- no verdict is not a pass ----


@pytest.mark.parametrize("how", ["raised", "blind", "nan", "nothing", "skipped"])
def test_no_verdict_is_no_pass(suite: Suite, how: str) -> None:
    @case(1)
    def thin(t: Trial) -> None:
        if how == "nothing":
            return
        t.check(True)
        if how == "raised":
            raise Inconclusive("too few samples")
        if how == "blind":
            t.sees(0.02, 0.01)
        if how == "nan":
            t.sees(float("nan"), 0.01)
        if how == "skipped":
            raise Skipped("no GPU")

    v = run()
    assert v.outcomes[0].verdict == ("skip" if how == "skipped" else "inconclusive")
    assert v.outcomes[0].message and not v.passed
    assert v.levels()[0]["verdict"] == v.outcomes[0].verdict


def test_one_inconclusive_case_spoils_the_run(suite: Suite) -> None:
    @case(1, each={"k": range(3)})
    def mixed(t: Trial, k: int) -> None:
        t.check(True)
        if k == 1:
            raise Inconclusive("thin")

    v = run()
    assert not v.passed and v.levels()[0]["verdict"] == "inconclusive"


def test_skipped_cases_do_not_spoil_the_run(suite: Suite) -> None:
    @case(1, each={"k": range(3)})
    def mixed(t: Trial, k: int) -> None:
        t.check(True)
        if k == 1:
            raise Skipped("no GPU")

    assert run().passed and run().levels()[0]["skip"] == 1


def test_errors_are_reported_with_their_place(suite: Suite) -> None:
    @case(1)
    def broken(t: Trial) -> None:
        raise RuntimeError("the planted one")

    v = run()
    message = v.outcomes[0].message
    assert v.outcomes[0].verdict == "error" and not v.passed
    assert "RuntimeError: the planted one" in message and "in broken" in message


# ---- the run ----


def test_false_alarm_bound_of_the_run(suite: Suite) -> None:
    @case(1, each={"k": range(6000)})
    def sound(t: Trial, k: int) -> None:
        t.check(True)

    few, many = run(pattern="*[[]1[]]"), run()
    assert (len(few.outcomes), few.facts["second"]) == (1, SECOND)
    assert few.false_alarm == pytest.approx(FIRST * SECOND + MANY)
    assert many.facts["second"] < SECOND and many.false_alarm == pytest.approx(FAMILY / 2 + MANY)
    assert many.passed and many.false_alarm < FAMILY


@pytest.mark.parametrize(("rate", "passes"), [(1, True), (20, False)])
def test_a_first_stage_that_fires_too_often_fails_the_run(
    suite: Suite, rate: int, passes: bool
) -> None:
    """1,000 cases whose p values are sound, or 20 times too small; none fails by itself.

    Two devices with the same bits count once.
    """

    @case(1, each={"k": range(1000)})
    def drawn(t: Trial, k: int) -> None:
        t.p(float(t.rng.random()) / (rate if t.effort == 1 else 1))

    v = run(seed=3)
    stage = v.first_stage()
    assert {o.verdict for o in v.outcomes} == {"pass"} and v.passed == passes
    assert stage["of"] == 1000 and likely(stage["low"], 1000, rate * FIRST)
    assert stage["low"] == sum(o.confirmed is not None for o in v.outcomes)
    assert f"{stage['low']} of 1,000 statistical cases" in str(v)
    assert ("PASS" in str(v)) == passes and ("FAIL" in str(v)) != passes
    v.outcomes += [replace(o, device="cuda:0") for o in v.outcomes]
    assert v.first_stage() == stage


@pytest.mark.parametrize("n", [1, 2, 10, 100, 700, 1500, 10_000])
def test_so_many_first_stage_p_values_are_rare(n: int) -> None:
    """The count at which a run fails has a probability below MANY; one less does not."""
    outcome = Outcome("a", 1, "", "cpu", "pass", p=0.5)

    def crowded(low: int) -> bool:
        ps = [1e-4] * low + [0.5] * (n - low)
        return Validation(
            False, 1, {}, 0.0, [replace(outcome, id=str(k), p=p) for k, p in enumerate(ps)]
        ).crowded

    least = next((low for low in range(1, n + 1) if crowded(low)), n + 1)
    assert stats.binom.sf(least - 1, n, FIRST) < MANY <= stats.binom.sf(least - 2, n, FIRST)


def test_commit_of_a_checkout(suite: Suite) -> None:
    @case(1)
    def sound(t: Trial) -> None:
        t.check(True)

    commit = run().facts["commit"]
    inside = Path(veriray.__file__).resolve().is_relative_to(ROOT / "python")
    if inside and (ROOT / ".git").exists() and shutil.which("git"):
        assert re.fullmatch("[0-9a-f]{40}(-dirty)?", commit)
    else:
        assert commit is None


def test_save(suite: Suite, tmp_path: Path) -> None:
    @case(1)
    def sound(t: Trial) -> None:
        t.check(True)

    v = run()
    for suffix in ("html", "json"):
        v.save(tmp_path / f"report.{suffix}")
    assert json.loads((tmp_path / "report.json").read_text("utf-8"))["passed"]
    assert "<html" in (tmp_path / "report.html").read_text("utf-8")
    with pytest.raises(ValueError, match=r"suffix '\.txt'; expected \.html or \.json"):
        v.save(tmp_path / "report.txt")


def test_a_run_is_a_function_of_its_seed(suite: Suite) -> None:
    @case(1, each={"k": range(4)})
    def sound(t: Trial, k: int) -> None:
        t.p(t.rng.random())

    p = [[o.p for o in run(seed=seed).outcomes] for seed in (1, 1, 2)]
    assert p[0] == p[1] and len({*p[0], *p[2]}) == 8
    assert run(seed=1, pattern="*2]").outcomes[0].p == p[0][2]
    of_version = run(seed=SEED, pattern="*2]").outcomes[0].p
    assert run(pattern="*2]").outcomes[0].p == of_version != p[0][2]


def test_cases_tell_whether_their_seed_matters(suite: Suite) -> None:
    @case(1, each={"draws": ("nothing", "inputs", "a seed", "a render")})
    def draw(t: Trial, draws: str) -> None:
        """Draws."""
        t.check(True)
        if draws == "inputs":
            t.rng.random()
        elif draws == "a seed":
            t.fresh()
        elif draws == "a render":
            t.render(furnace(0.5, 1.0), 1)

    seeded = [judge(c, "cpu").seeded for c in suite.values()]
    assert seeded == [False, True, True, True]


def test_once(suite: Suite) -> None:
    @case(1, once=True)
    def machine(t: Trial) -> None:
        t.check(True)

    @case(1)
    def device(t: Trial) -> None:
        t.check(True)

    devices = [d.name for d in veriray.devices()]
    names = [(o.id, o.device) for o in validate(devices, workers=0).outcomes]
    assert names == [
        ("test_runner.machine", devices[0]), *(("test_runner.device", d) for d in devices)
    ]  # fmt: skip


def test_progress_and_counts(suite: Suite) -> None:
    @case(4)
    def counted(t: Trial) -> None:
        t.check(True)
        t.p(0.4)
        t.p(0.5)
        t.sees(0.01)
        t.sees(0.002)

    seen: list[tuple[Outcome, int, int]] = []
    v = run(progress=lambda *arguments: seen.append(arguments))
    assert [(done, total) for _, done, total in seen] == [(1, 1)]
    (row,) = v.levels()
    assert (row["level"], row["name"], row["checks"], row["tests"]) == (4, "Live rays", 1, 2)
    assert row["sees"] == [0.01, 0.01] and row["first_stage"] == 0
    assert v.outcomes[0].p == pytest.approx(1 - 0.6**2)


# ---- real renders ----


def test_agrees_finds_a_bias_and_says_what_it_sees(suite: Suite) -> None:
    @case(3, each={"error": [0.0, 0.01], "limit": [0.01, 1e-5]})
    def radiance(t: Trial, error: float, limit: float) -> None:
        t.agrees(furnace(0.5, 0.5), 1 + error, 30_000, sees=limit)

    verdict = {o.id.partition("[")[2]: o for o in run(full=True, effort=1).outcomes}
    assert verdict["0.0,0.01]"].verdict == "pass"
    assert 1e-4 < (verdict["0.0,0.01]"].sees or 0) < 0.01
    assert verdict["0.01,0.01]"].verdict == "fail"
    assert verdict["0.0,1e-05]"].verdict == "inconclusive"


def test_agrees_does_not_take_pixels_that_share_samples_for_independent() -> None:
    """Sidak's correction of three equal channels makes p < 0.05 of a sound mean 1.7 % likely.

    It is 12 % where pixels under a gaussian count as independent. Fails by chance with probability
    1e-4, and finds that with probability 0.97.
    """
    scene = furnace(0.5, 0.5, width=6, height=6, filter="gaussian")
    low = 0
    for seed in range(150):
        t = Trial("cpu", seed)
        t.agrees(scene, 1.0, 1500, sees=1.0, margin=0.0)
        low += {what: p for p, what in t.p_values}["picture"] < 0.05
    assert low <= stats.binom.isf(1e-4, 150, 1 - 0.95 ** (1 / 3))


def test_example_of_the_docs(suite: Suite, capsys: Any) -> None:
    text = (ROOT / "docs" / "how-we-know.md").read_text("utf-8")
    (example,) = re.findall(r"```python\n(.*?)```", text, re.S)
    exec(compile(example, "how-we-know.md", "exec"), {"__name__": "example"})
    assert capsys.readouterr().out.startswith("True ")
    assert list(suite) == ["example.grey_room"]


# ---- processes ----


def crash(k: int) -> int:
    if k == 2:
        os.kill(os.getpid(), 9)
    if k == 3:
        raise ValueError("planted")
    if k == 4:
        return lambda: k  # type: ignore[return-value]
    return k * k


def test_pool_survives_its_workers() -> None:
    got = dict(pool.results(crash, [(k,) for k in range(6)], 2))
    died = {k: str(v) for k, v in got.items() if isinstance(v, pool.Died)}
    assert {k: v for k, v in got.items() if k not in died} == {0: 0, 1: 1, 5: 25}
    assert "signal 9" in died[2] and "ValueError: planted" in died[3]
    assert "cannot be sent" in died[4]


def span(seconds: float) -> tuple[float, float]:
    begin = time.time()
    time.sleep(seconds)
    return begin, time.time()


def test_jobs_that_hold_the_same_take_turns() -> None:
    holds = ["gpu", "gpu", "gpu", None, "other", "gpu"]
    got = dict(pool.results(span, [(0.3,)] * 6, 3, holds))
    turns = sorted(got[k] for k, held in enumerate(holds) if held == "gpu")
    assert all(end <= begin for (_, end), (begin, _) in zip(turns, turns[1:], strict=False))
    assert len(got) == 6 and got[4][0] < turns[-1][0]  # it did not wait for them


def test_processes_share_a_gpu_where_cuda_lets_them(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("CUDA_MPS_PIPE_DIRECTORY", str(tmp_path))
    assert held_by("cuda:1") == "cuda:1" and held_by("cpu:avx2") is None
    (tmp_path / "control").touch()
    assert held_by("cuda:1") is None


def test_planted_bugs_come_first_with_all_processes_and_no_gpu(
    suite: Suite, monkeypatch: pytest.MonkeyPatch
) -> None:
    """They take minutes on CPUs, one after another with one process."""
    given = []

    def results(function: Any, jobs: Any, workers: int, holds: Any) -> Any:
        given.extend(
            (job[0].split(".")[-1], job[-1], held) for job, held in zip(jobs, holds, strict=True)
        )
        yield from ((k, Outcome(job[0], 1, "", "cpu", "pass", "")) for k, job in enumerate(jobs))

    @case(2)
    def quick(t: Trial) -> None:
        """Quick."""

    @case(3, quick=False)
    def full(t: Trial) -> None:
        """Full."""

    @case(9, quick=False, once=True)
    def bugs(t: Trial) -> None:
        """Bugs."""

    monkeypatch.setattr(pool, "results", results)
    monkeypatch.setattr("veriray_validate.run.held_by", lambda device: "it")
    validate(["cpu"], full=True, workers=5)
    assert given == [("bugs", 5, None), ("full", 1, "it"), ("quick", 1, "it")]


def test_pool_that_is_left_early_leaves_no_process() -> None:
    import multiprocessing

    answers = pool.results(time.sleep, [(0,), (1000,), (1000,)], 2)
    assert next(answers)[0] == 0
    begin = time.monotonic()
    answers.close()  # type: ignore[attr-defined]
    assert time.monotonic() - begin < 60 and multiprocessing.active_children() == []
