"""`compare`: do two renders show the same expected picture? A verdict with its error rates.

The tests are in `statistics`, which of them run in `effort`, error measures in `metrics`.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

import numpy as np

from veriray.comparison import statistics as st
from veriray.comparison.effort import equal_effort, together, unequal_effort
from veriray.comparison.ledgers import ENDS, ledger_problems, ledger_test
from veriray.comparison.report import Maps, Report
from veriray.comparison.sides import (
    CompareError,
    Source,
    advice,
    alike,
    check_windows,
    opened,
)
from veriray.comparison.statistics import Test
from veriray.errors import printable
from veriray.extras import need
from veriray.numeric import number, shown, texts, whole
from veriray.picture import LEDGER_COLUMNS, Render

if TYPE_CHECKING:
    from numpy.typing import NDArray

__all__ = ["CompareError", "Report", "Test", "compare"]

_MIN_FLIP_BATCHES = 16


def compare(
    a: Source,
    b: Source,
    *,
    channels: str | tuple[str | None, str | None] | None = None,
    spp: int | tuple[int | None, int | None] | None = None,
    alpha: float = 1e-3,
    seed: int = 0,
    regions: NDArray[np.integer[Any]] | None = None,
    region_names: Sequence[str] | None = None,
    same_estimator: bool = False,
    target: float | None = None,
) -> Report:
    """Test whether two renders have the same expected picture.

    Which tests run depends on what the renders carry; the report says which, and why:

    - equal effort (batch means on both sides, same number, same samples in each, noise within a
      factor 2 in variance): sign-flip tests S1 of the mean, S2 of pixels, blocks and objects,
      S3 of local bias of any sign; exact, no normal distribution assumed;
    - batch means on both sides otherwise: Welch t tests of the mean and of the blocks and
      objects that 10,000 effective samples carry;
    - else the same as z tests from the standard errors of pixels (weaker). Pixels of veriray under
      a filter wider than one share samples: errors of means are then taken for as large as they
      can be (`veriray.comparison.sharing.shared`). Others count as independent.

    Always: S0 invalid values, the identities of each ray ledger, and, when both have one and
    agree in max_depth and rr_depth, a test that paths end alike.

    Args:
        a: render under test, the path of an EXR file of it by any program, or a list of several
            with a seed each, which then are batches (`veriray.comparison.sides` lists layouts).
        b: reference, likewise. Independent of `a`: another seed or another program.
        channels: which layer or channels of other programs' files to read; a pair for a and b.
        spp: samples per pixel of each file that does not say; a pair for a and b.
        alpha: family-wise false-alarm rate, at which two correct renders are found to differ.
        seed: of the sign flips; the report is a function of the renders and this.
        regions: (H, W) integers >= 0, one value per object; default: the masks in `a` or `b`.
        region_names: name of value k + 1 at index k; value 0 is the background.
        same_estimator: both were made by the same algorithm, so that noise (S4) and shadow rays
            must agree too.
        target: the largest relative bias of the whole picture that may go unseen (90 % power); if
            the data are too noisy for it, finding no difference is "inconclusive", not a pass.

    Returns:
        The report; `.passed` is True if no test failed and the mean could be tested.

    Raises:
        CompareError: different sizes, bad masks or settings.
        ImageError, OSError: a file that cannot be read.
        MissingPackageError: without the packages of veriray[compare].
    """
    need("comparing pictures", "compare", "scipy", "skimage", "flip_evaluator")
    from veriray.comparison.metrics import figures

    alpha = number("alpha", alpha, 1e-6, 0.2, error=CompareError)
    seed = whole("seed", seed, 0, 2**64 - 1, error=CompareError)
    if target is not None:
        target = number("target", target, 0.0, np.inf, open_=True, error=CompareError)
    layers, counts = _pair("channels", channels, str), _pair("spp", spp, int)
    a, name_a, mask_a = opened(a, "A", layers[0], counts[0])
    b, name_b, mask_b = opened(b, "B", layers[1], counts[1])
    if a.image.shape != b.image.shape:
        raise CompareError(f"different sizes: {name_a} is {_size(a)}, {name_b} is {_size(b)}")
    check_windows(((a, name_a), (b, name_b)))
    a, b = alike(a, b)
    if regions is None:
        regions, names = mask_a if mask_a[0] is not None else mask_b
    else:
        names = list(
            texts("region_names", () if region_names is None else region_names, CompareError)
        )
    regions = None if regions is None else _checked(regions, a.image.shape[:2])
    labels = {0: "background", **{k + 1: printable(str(n)) for k, n in enumerate(names)}}

    report = Report(
        alpha=alpha,
        seed=seed,
        a=_facts(a, name_a),
        b=_facts(b, name_b),
        metrics=figures(a.image, b.image),
        maps=Maps(a.image, b.image, a.stderr, b.stderr, together=(together(a), together(b))),
    )
    report.notes += _notes(a, b)
    _exact(report, a, b)
    if report.effort == "none":
        _ledger(report, a, b, same_estimator)
        reason = _unequal(a, b, report)
        report.effort = "unequal" if reason else "equal"
        report.reason = reason or f"{_batches(a)} batches of {a.spp // _batches(a)} samples each"
        run = unequal_effort if reason else equal_effort
        run(report, a, b, regions, labels, same_estimator)
    report.tests = st.holm(report.tests, alpha)
    report.decide(target)
    if report.result == "inconclusive":
        report.notes += [text for x, letter in ((a, "A"), (b, "B")) if (text := advice(x, letter))]
    return report


def _pair(name: str, value: Any, kind: type) -> tuple[Any, Any]:
    """A value for both sides, or one for each."""
    pair = value if isinstance(value, tuple) else (value, value)
    if len(pair) != 2 or any(x is not None and not isinstance(x, kind) for x in pair):
        raise CompareError(
            f"{name} = {shown(value)}; expected {kind.__name__}, or a pair for A and B"
        )
    return pair[0], pair[1]


def _checked(regions: Any, shape: tuple[int, ...]) -> NDArray[np.integer[Any]]:
    try:
        mask = np.asarray(regions)
    except Exception as error:  # of any object's own conversion
        raise CompareError(f"regions: {error}") from None
    if mask.shape != shape or mask.dtype.kind not in "iu" or mask.min() < 0:
        raise CompareError(f"regions: {mask.dtype} {mask.shape}; expected integers >= 0 {shape}")
    if len(np.unique(mask)) > 4096:
        raise CompareError("regions: more than 4,096 values")
    return mask


def _size(x: Render) -> str:
    return f"{x.image.shape[1]} x {x.image.shape[0]}"


def _facts(x: Render, name: str) -> dict[str, Any]:
    keys = ("renderer", "version", "device", "scheduler", "features", "scene_sha256", "max_depth",
            "rr_depth", "seconds")  # fmt: skip
    facts = {
        "name": name,
        "width": x.image.shape[1],
        "height": x.image.shape[0],
        "spp": x.spp,
        "seed": x.seed,
        "batches": _batches(x),
        "film_sha256": x.film_sha256,
        **{key: x.stats.get(key) for key in keys},
    }
    return {key: _printable(value) for key, value in facts.items()}


def _printable(value: Any) -> Any:
    if isinstance(value, list):
        return [_printable(entry) for entry in value]
    return printable(value) if isinstance(value, str) else value


def _batches(x: Render) -> int:
    return 0 if x.batch_means is None else len(x.batch_means)


def _program(x: Render) -> str:
    return str(x.stats.get("renderer", "veriray"))


def _notes(a: Render, b: Render) -> list[str]:
    out = []
    known = [x for x in (a, b) if "max_depth" in x.stats]
    for key in ("max_depth", "rr_depth") if len(known) == 2 or not known else ():
        if a.stats.get(key) != b.stats.get(key):
            out.append(
                f"{key} differs: {a.stats.get(key)} against {b.stats.get(key)}"
                + ("; different pictures are to be expected" * (key == "max_depth"))
            )
    for letter, x in (("A", a), ("B", b)):
        if x.stats.get("half"):
            out.append(
                f"{letter} holds half floats, rounded by up to {st.HALF:.2g} of a value: smaller "
                "differences do not count; write 32 bits for a sharper test"
            )
        if x.stats.get("filter", "") is None and (below := int(np.count_nonzero(x.image < 0))):
            out.append(f"{letter} holds {below} values below 0, as filters with such weights give")
        if cut := x.stats.get("batches_cut"):
            out.append(f"{letter}: {cut}")
        if x.stats.get("luminance"):
            out.append(f"{letter} holds luminance alone: R, G and B stand for it")
    one = _program(a) == _program(b)
    if one and a.stats.get("scene_sha256") != b.stats.get("scene_sha256"):
        out.append("the scenes have different hashes")
    if one and a.seed == b.seed and not _identical(a, b):
        out.append(
            f"both have seed {a.seed} and come from one program: their noise is correlated. "
            "The tests stay valid and see smaller differences, but a fault of the random "
            "numbers, common to both, stays unseen; use independent seeds"
        )
    return out


def _exact(report: Report, a: Render, b: Render) -> None:
    """Conditions without statistics; sets `effort` if they leave nothing to test."""
    report.tests += [_valid(a, "A"), _valid(b, "B")]
    invalid = any(t.result == "fail" for t in report.tests)
    ledgers = [x.stats.get("ledger") or {} for x in (a, b)]
    for x, ledger, letter in zip((a, b), ledgers, "AB", strict=True):
        if all(ledger.get(column) for column in ("live", *ENDS, "invalid")):
            paths = a.image.shape[0] * a.image.shape[1] * x.spp
            if x.samples is not None:
                paths = x.stats.get("paths", paths)
            problems = ledger_problems(ledger, paths)
            report.tests.append(
                _condition(f"L1 ledger of {letter} adds up", "lost or invented paths", problems)
            )
    if _identical(a, b):
        report.effort, report.reason = "identical", "both hold the same bits"
        other = ["the ledgers"] if all(ledgers) and ledgers[0] != ledgers[1] else []
        report.tests.append(_condition("identical bits", "a difference in bits or counts", other))
        report.not_run.append(("statistics", "a picture has none against itself"))
    elif a.film_sha256 and a.film_sha256 == b.film_sha256:
        report.tests.append(
            _condition(
                "film hash", "pixels changed after rendering", ["one hash, different pixels"]
            )
        )
    if invalid:
        report.effort, report.reason = "invalid", "there are invalid values"
        report.not_run.append(("statistics", "invalid values in the pictures"))


def _condition(name: str, finds: str, problems: list[str]) -> Test:
    return Test(name, finds, "fail" if problems else "pass", where="; ".join(problems[:3]))


def _valid(x: Render, letter: str) -> Test:
    """S0: pictures and samples are finite, and >= 0 unless weights of the filter may lie below.

    The filter of other programs' pictures is not known: `_notes` says what lies below 0 there.
    """
    signed = x.stats.get("filter", "box") != "box"
    arrays = [x.image[None]] + ([] if x.batch_means is None else [x.batch_means])
    wrong = np.zeros(x.image.shape[:2], bool)
    for values in arrays:
        wrong |= ~(np.isfinite(values) & (signed | (values >= 0))).all(axis=(0, 3))
    bad = int(np.count_nonzero(wrong))
    samples = int(x.stats.get("nonfinite_samples") or 0)
    invalid = sum((x.stats.get("ledger") or {}).get("invalid") or [])
    count = max(samples, invalid)
    kinds = "NaN or infinite" if signed else "negative, NaN or infinite"
    problem = f"{bad} pixels hold values that are {kinds}; {count} such samples"
    if bad:
        row, column = np.argwhere(wrong)[0]
        problem += f"; the first at ({column}, {row})"
    return _condition(
        f"S0 valid values in {letter}", "invalid samples", [problem] * (bad + count > 0)
    )


def _identical(a: Render, b: Render) -> bool:
    return all(
        np.asarray(x).tobytes() == np.asarray(y).tobytes()
        for x, y in ((a.image, b.image), (a.stderr, b.stderr))
    )


def _unequal(a: Render, b: Render, report: Report) -> str:
    """Why the sign-flip tests do not apply; empty if they do."""
    if a.batch_means is None or b.batch_means is None:
        return "no batch means in " + " and ".join(
            letter for x, letter in ((a, "A"), (b, "B")) if x.batch_means is None
        )
    ratio, error, _ = st.variance_ratio(a.batch_means, b.batch_means)
    per_sample = (a.spp / len(a.batch_means)) / max(b.spp / len(b.batch_means), 1e-300)
    report.figures.update(
        variance_ratio=ratio * per_sample,
        variance_ratio_error=error * per_sample,
        independence_a=st.independence(a.batch_means),
        independence_b=st.independence(b.batch_means),
    )
    for letter, x in (("A", a), ("B", b)):
        ratio_sum = report.figures[f"independence_{letter.lower()}"]
        most = together(x)
        if ratio_sum > most * (1 + 6 * (2 / (_batches(x) - 1)) ** 0.5):
            report.notes.append(
                f"pixels of {letter} hang together: the variance of the picture's mean is "
                f"{ratio_sum:.3g} times that of independent ones, the filter explains {most:.3g}"
            )
    batches = len(a.batch_means)
    if batches != len(b.batch_means) or a.spp != b.spp:
        return (
            f"unequal effort: A has {a.spp} samples in {batches} batches, B {b.spp} in "
            f"{len(b.batch_means)}"
        )
    if a.stats.get("spp_unknown") or b.stats.get("spp_unknown"):
        return "samples per pixel unknown in " + " and ".join(
            letter for x, letter in ((a, "A"), (b, "B")) if x.stats.get("spp_unknown")
        )
    if a.stats.get("half") or b.stats.get("half"):
        return "half floats: differences up to their rounding do not count"
    report.figures["correlation"] = rho = st.correlation(a.batch_means, b.batch_means)
    report.figures["asymmetry"] = st.asymmetry(a.batch_means, b.batch_means)
    if abs(rho) > max(0.01, 6 / (a.width * a.height * (batches - 1)) ** 0.5):
        report.notes.append(
            f"the noise of A and B is correlated ({rho:+.3f}): they share random numbers"
        )
    if batches < _MIN_FLIP_BATCHES:
        return f"{batches} batches; sign flips need {_MIN_FLIP_BATCHES}"
    if not 0.5 <= ratio <= 2:
        return (
            f"equal samples, but the noise is not equal: variance of A / variance of B = "
            f"{ratio:.3g}, outside 0.5 to 2"
        )
    return ""


def _ledger(report: Report, a: Render, b: Render, same_estimator: bool) -> None:
    ledger_a, ledger_b = (x.stats.get("ledger") or {} for x in (a, b))
    name = "L4 ends of paths"
    if not all(x.get(c) for x in (ledger_a, ledger_b) for c in LEDGER_COLUMNS):
        report.not_run.append((name, "no complete ray ledger on both sides"))
        return
    result = ledger_test(ledger_a, ledger_b, report.alpha)
    report.ledger = result.rows
    for key in ("max_depth", "rr_depth"):
        if a.stats.get(key) != b.stats.get(key):
            report.not_run.append((name, f"{key} differs"))
            return
    if a.samples is not None or b.samples is not None:
        report.not_run.append((name, "pixels have different numbers of samples"))
        return
    finds = "another depth limit, roulette or visibility"
    report.tests.append(Test(name, finds, "pass", result.statistic, result.p, where=result.where))
    if same_estimator:
        finds = "another light sampling or visibility"
        report.tests.append(
            Test("L4 shadow rays", finds, "pass", None, result.shadow_p, where=result.shadow_where)
        )
