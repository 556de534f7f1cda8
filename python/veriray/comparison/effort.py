"""Which tests a pair of renders gets: sign flips at equal effort, t or z tests otherwise."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, Any

import numpy as np

from veriray.camera import Film
from veriray.comparison import statistics as st
from veriray.comparison.sharing import reach, shared
from veriray.comparison.statistics import Cells, Partition, Test
from veriray.errors import SceneError

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from veriray.comparison.report import Report
    from veriray.picture import Render

    Array = NDArray[Any]
    Mask = NDArray[np.integer[Any]]

_OVERALL, _PART, _OBJECT = "overall bias", "bias of a part of the picture", "bias of one object"


def equal_effort(
    report: Report,
    a: Render,
    b: Render,
    regions: Mask | None,
    labels: dict[int, str],
    same_estimator: bool,
) -> None:
    """Adds the sign-flip tests S1 to S3 (S4 for one estimator) to the report."""
    assert a.batch_means is not None and b.batch_means is not None
    d = a.batch_means - b.batch_means
    level = 0.5 * (a.batch_means.mean(axis=0) + b.batch_means.mean(axis=0))
    _, height, width, _ = d.shape
    skew = report.figures["asymmetry"]
    pixels = same_estimator or abs(skew) <= st.MAX_ASYMMETRY
    wide = max(reach(film_of(x)) for x in (a, b)) > st.MOST_IN_BLOCKS
    if wide and same_estimator:
        same_estimator = False
        reason = f"needs blocks of pixels that share no samples: a filter of {st.MOST_IN_BLOCKS:g} "
        report.not_run.append(("S4 variance", reason + "pixels at most"))
    plans = _plans(d, level, pixels, regions, labels)
    family = len(plans) + pixels + same_estimator + sum(t.p is not None for t in report.tests)
    flips, share = st.flips_needed(report.alpha, family), report.alpha / family
    rng = np.random.default_rng(report.seed)
    for name, finds, groups in plans:
        statistic, where, p = st.max_t(groups, flips, rng)
        report.tests.append(Test(name, finds, "pass", statistic, p, where=where))
        count = sum(c.level.size for c in groups)
        for c in groups:
            error = c.values.std(axis=0, ddof=1) / math.sqrt(len(d))
            report.add_power(c.name, st.smallest_bias(c.level, error, len(d) - 1, share, count))
            if finds in (_OVERALL, _OBJECT):
                report.add_means(c, error, len(d) - 1)
    if pixels:
        z, p, bias, least = st.energy(d, level, flips, rng, share, whole=wide)
        finds, where = "local bias of changing sign", f"rms relative bias {bias:.3%}"
        report.tests.append(Test("S3 local-bias energy", finds, "pass", z, p, where=where))
        report.add_power("rms local bias (S3)", np.array([least]))
    if pixels and height * width * 3 > st.MAX_CELLS:
        report.not_run.append(("S2 smallest cells", f"more than {st.MAX_CELLS:,} of them"))
    if not pixels:
        reason = f"the noise of A and of B has different tails (skewness of A - B: {skew:.2f})"
        report.not_run += [("S2 pixels", reason), ("S3 local-bias energy", reason)]
    if same_estimator:
        ratio, _, q = st.variance_ratio(a.batch_means, b.batch_means)
        report.tests.append(
            Test(
                "S4 variance",
                "lost efficiency, samples used twice, wrong weights",
                "pass",
                ratio,
                st.variance_test(q, flips, rng),
                where="ratio of variances, A over B; equal within a factor 1.25",
            )
        )
    report.figures["flips"] = flips
    report.maps.t, report.maps.dof = st.t_values(d.mean(axis=-1)), len(d) - 1
    report.maps.t_blocks = st.t_values(st.block_means(d, 8).mean(axis=-1))


def _plans(
    d: Array, level: Array, pixels: bool, regions: Mask | None, labels: dict[int, str]
) -> list[tuple[str, str, list[Cells]]]:
    """Sign-flip tests S1 and S2: (name, what it finds, scales that share one maximum)."""
    _, height, width, _ = d.shape
    plans = [("S1 mean of the picture", _OVERALL, [st.whole_cells(d, level)])]
    coarse = []
    for size in st.block_sizes(height, width):
        if size > 1 or pixels:
            scale = st.cells(st.blocks(height, width, size), d, level)
            if size >= 16:
                coarse.append(scale)
            else:
                name = "pixels" if size == 1 else f"{scale.name} blocks"
                plans.append((f"S2 {name}", "local bias of one sign", [scale]))
    if coarse:
        plans.append((f"S2 {', '.join(c.name for c in coarse)} blocks", _PART, coarse))
    if regions is not None:
        plans.append(("S2 objects", _OBJECT, [st.cells(st.objects(regions, labels), d, level)]))
    return plans


def unequal_effort(
    report: Report,
    a: Render,
    b: Render,
    regions: Mask | None,
    labels: dict[int, str],
    same_estimator: bool,
) -> None:
    """Welch's t, or z if batch means are missing, of all cells with enough samples."""
    height, width, _ = a.image.shape
    plans = [("S1 mean of the picture", _OVERALL, st.whole(height, width))]
    plans += [
        (f"S2 {s}x{s} blocks", _PART, st.blocks(height, width, s))
        for s in st.block_sizes(height, width)
        if s >= 16
    ]
    if regions is not None:
        plans.append(("S2 objects", _OBJECT, st.objects(regions, labels)))
    share = report.alpha / (len(plans) + sum(t.p is not None for t in report.tests))
    for plan in plans:
        report.tests.append(_t_test(report, a, b, share, *plan))
    if a.batch_means is None or b.batch_means is None:
        report.notes.append(
            "without batch means the errors of means follow from those of the pixels, as of "
            "independent ones, or times what the filter makes of that at most: a weaker test"
        )
    report.not_run += [
        (
            "S2 pixels and 4x4 blocks",
            "few rare samples decide single pixels: against a picture "
            "of another effort such tests raise false alarms",
        ),
        ("S3 local-bias energy", "needs equal effort"),
        *([("S4 variance", "needs equal effort")] if same_estimator else []),
    ]
    noise = np.hypot(_error_of_mean(a), _error_of_mean(b))
    change = (a.image.astype(np.float64) - b.image).mean(axis=-1)
    report.maps.t = np.where(noise > 0, change / np.maximum(noise, 1e-300), 0.0)
    report.maps.dof = math.inf


def _t_test(
    report: Report,
    a: Render,
    b: Render,
    share: float,
    name: str,
    finds: str,
    partition: Partition,
) -> Test:
    both = a.batch_means is not None and b.batch_means is not None
    name += ", Welch t" if both else ", z"
    images = [np.asarray(x.image, np.float64) for x in (a, b)]
    enough = np.ones(partition.pixels.size, bool)
    errors: list[Array] = []
    dofs: list[float] = []
    for x, image in zip((a, b), images, strict=True):
        n = x.spp if x.samples is None else x.samples[..., None].astype(np.float64)
        # as of independent pixels with as large an error of their mean, at most
        alone = _error(x) * math.sqrt(together(x))
        enough &= st.effective_samples(image, alone, n, partition) >= st.MIN_EFFECTIVE_SAMPLES
        if x.batch_means is None:
            errors.append(np.sqrt(partition.mean(alone**2) / partition.pixels))
            dofs.append(math.inf)
        else:
            if finds != _OVERALL and len(x.batch_means) < st.MIN_BATCHES:
                enough[:] = False
            errors.append(
                partition.mean(x.batch_means).std(axis=0, ddof=1) / math.sqrt(len(x.batch_means))
            )
            dofs.append(len(x.batch_means) - 1)
    if not enough.any():
        return Test(
            name,
            finds,
            "inconclusive",
            where=(
                f"needs {st.MIN_EFFECTIVE_SAMPLES:,} effective samples per cell on both sides, "
                f"known standard errors, and for parts of the picture {st.MIN_BATCHES} batches"
            ),
        )
    change, level = (
        partition.mean(x) for x in (images[0] - images[1], (images[0] + images[1]) / 2)
    )
    margin = st.MARGIN + sum(st.HALF for x in (a, b) if x.stats.get("half"))
    t, p, dof = st.welch(change, level, errors[0], errors[1], dofs[0], dofs[1], margin)
    tested, best = int(enough.sum()), int(np.argmin(np.where(enough, p, 2.0)))
    error = np.hypot(errors[0], errors[1])
    report.add_power(
        partition.name, np.where(enough, st.smallest_bias(level, error, dof, share, tested), np.nan)
    )
    if finds in (_OVERALL, _OBJECT):
        report.add_means(Cells(partition.name, change[None], level, partition.label), error, dof)
    where = (
        f"{partition.label(best)}: {change[best] / max(level[best], 1e-300):+.3%}, "
        f"t = {t[best]:+.2f}"
    )
    if tested < enough.size:
        where += f"; {tested} of {enough.size} cells carry enough samples"
    return Test(
        name, finds, "pass", float(abs(t[best])), min(1.0, float(p[best]) * tested), where=where
    )


def film_of(x: Render) -> Film:
    """Its filter; a box for files that do not say, or nothing that is one."""
    name, parameter = x.stats.get("filter", "box"), x.stats.get("filter_parameter")
    try:
        return Film(x.width, x.height, name, parameter)
    except (SceneError, TypeError):
        return Film(x.width, x.height, "box")


def together(x: Render) -> float:
    """Variance of a mean of pixels, at most, over that of independent ones (`sharing.shared`)."""
    return shared(film_of(x))


def _error(x: Render) -> Array:
    """Standard error per pixel; NaN where the render does not provide it."""
    if x.batch_means is not None and not np.isfinite(x.stderr).all():
        return np.asarray(x.batch_means.std(axis=0, ddof=1) / math.sqrt(len(x.batch_means)))
    return np.asarray(x.stderr, np.float64)


def _error_of_mean(x: Render) -> Array:
    """Standard error of the mean of a pixel's channels; without batches its upper bound."""
    if x.batch_means is None:
        return np.asarray(_error(x).mean(axis=-1))
    return np.asarray(
        x.batch_means.mean(axis=-1).std(axis=0, ddof=1) / math.sqrt(len(x.batch_means))
    )
