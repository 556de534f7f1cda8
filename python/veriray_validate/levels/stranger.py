"""Pictures against those of an independent renderer, at equal effort.

The stranger (reference/ in the source) is written from the specification alone: numpy in float64,
Embree for visibility, other random numbers. Its results on the scenes of scenes/checks come with
the package (veriray_validate.references): 64 x 64 pixels in 32 independent batches. Ours are
rendered anew with as many batches and samples, averaged over the same blocks of pixels, and the
differences d_b = A_b - R_b of the batches are tested:

- S1, mean of the picture, plain and weighted by the inverse of the noise: a bias of the whole.
- S2, blocks of 4, 16 and 32 pixels, and the parts of the picture that show one material: a local
  bias of one sign (Westfall and Young 1993: the largest |t| over all of a kind).
- S3, the energy of all blocks' biases: a bias that changes sign.
- S4, variance of A over that of R within 0.8 to 1.25: lost efficiency, samples used twice, wrong
  weights of multiple importance sampling. Both use the same estimator, so their noise is alike,
  but where lights are sampled otherwise (`references.lights_alike`): S4 and S6 are left out there.
- S5, covariance between blocks of A, and between its batches: streams used twice. Under filters
  other than the box pixels share samples, so S5 of blocks is left out there.
- S6, distribution over blocks of the effective samples (sum x)^2 / sum x^2, Kolmogorov and Smirnov:
  clamps and firefly filters.
- L4, ends of paths and shadow rays by depth.

Outliers. A bright rare sample is part of the expectation, so none is clamped, trimmed or left out.
It breaks the normal law of a pixel's mean, which S1 to S4 do not use. If nothing is wrong, A_b and
R_b have the same distribution, however heavy its tails. So d_b and -d_b have the same distribution
too, and the signs of whole batches can be flipped: the share of flips at least as extreme is an
exact p value (Fisher 1935). An outlier raises the spread of the statistic under flips as much as
the statistic itself, which costs power but never causes a false alarm; this requires equal effort.
A t test of each pixel against a better converged reference raises alarms in most sound renders with
fireflies. The remaining power is stated as the bias seen, from the noise of the data themselves.

Each judgement has reference data of its own (quick, full, confirmation), so a suspicion and its
confirmation are independent.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Callable, Mapping
from typing import Any

import numpy as np
import numpy.typing as npt
from scipy import stats

from veriray.columns import MATERIAL_KINDS
from veriray.comparison import ledgers
from veriray.comparison import statistics as st
from veriray.scene import Scene
from veriray_validate import references
from veriray_validate.references import Run
from veriray_validate.scenes import TUBES, check_scene, checks
from veriray_validate.statistics import max_z, sidak
from veriray_validate.trial import FIRST, Trial, case

Array = npt.NDArray[Any]
Judgement = list[tuple[float, str]]
#: A number for each block of the picture, and names of the numbers.
Parts = tuple[npt.NDArray[np.int64], dict[int, str]]

NAMES = tuple(checks())
#: Scenes of the quick run: fast ones that have each material, medium, light, shape and filter.
QUICK = {
    "blended_fog", "camera_in_medium", "conductor_metal", "directional_light", "disk_ellipse",
    "glass_cube", "hair", "hg_forward", "mask", "medium_in_glass", "mitchell", "plastic_nonlinear",
    "point_light", "rectangle_sheared", "rough_metal", "rough_plastic", "rough_shadows",
    "rough_whole", "smooth_normals",
    "sphere_light", "spot_light", "tent", "thindielectric", "thinlens", "twosided",
}  # fmt: skip
#: p values of one comparison, at most.
TESTS = 10
#: If p is above ROUGH, 999 flips decide; if it is above DOUBT, the first stage's number of flips;
#: otherwise as many as the second stage needs (J. Besag and P. Clifford, Sequential Monte Carlo
#: p-values, Biometrika 78, 1991). Flips are fresh each time, so no p value is too small.
ROUGH, DOUBT, FINE = 2e-2, 2e-3, 2e-5


# ---- statistics of a pair ----


def comparison(a: Run, r: Run, parts: Parts, rng: np.random.Generator, *,
               fine: bool = True) -> Judgement:  # fmt: skip
    """Tests S1 to S6 and L4 of ours against the reference's: p values with their places.

    fine: doubtful p values are recomputed from more flips, as many as the second stage needs.
    """
    d, level = a.means - r.means, (a.means.mean(axis=0) + r.means.mean(axis=0)) / 2

    def flipped(test: Callable[[int], float]) -> float:
        if (p := test(999)) > ROUGH:
            return p
        p = test(st.flips_needed(FIRST, TESTS))
        return test(st.flips_needed(FINE, TESTS)) if fine and p < DOUBT else p

    def largest(groups: list[st.Cells]) -> tuple[float, str]:
        p = flipped(lambda flips: st.max_t(groups, flips, rng)[2])
        group = max(groups, key=lambda g: float(np.abs(g.t).max()))
        return p, group.label(int(np.abs(group.t).argmax()))

    out: Judgement = []
    for name, groups in scales(d, level, a.block, parts).items():
        p, where = largest(groups)
        out.append((p, f"{name}: {where}"))
    p = flipped(lambda flips: st.energy(d, level, flips, rng, FIRST)[1])
    out.append((p, "S3: local bias of changing sign"))

    va, vr = a.means.var(axis=0, ddof=1), r.means.var(axis=0, ddof=1)
    noisy = va + vr > 2 * (1e-6 * level) ** 2  # more than rounding
    q = ((va - vr)[noisy] / (va + vr)[noisy]).ravel()
    if q.size:
        ratio = (1 + q.mean()) / (1 - q.mean())
        p = flipped(lambda flips: st.variance_test(q, flips, rng))
        out.append((p, f"S4: variance of ours over theirs {ratio:.3f}"))
        blocks, batches = independence(a.means, noisy.any(axis=-1), rng)
        out += [(blocks, "S5: noise of blocks hangs together"),
                (batches, "S5: noise of batches hangs together")]  # fmt: skip
        tails = [effective(x, level)[noisy] for x in (a, r)]
        out.append((float(stats.ks_2samp(*tails, method="asymp").pvalue), "S6: effective samples"))
    ends = ledgers.ledger_test(a.ledger, r.ledger, FIRST)
    out.append((ends.p, f"L4: {ends.where}"))
    return out


def scales(
    d: Array, level: Array, block: int, parts: Parts | None = None
) -> dict[str, list[st.Cells]]:
    """The cells of S1 and S2, from differences and level of blocks of `block` pixels."""
    fine = [x.repeat(block, axis=-3).repeat(block, axis=-2) for x in (d, level)]
    cells = {}
    for size in (block, 16, 32):
        cells[size] = st.cells(st.blocks(*level.shape[:2], size // block), d, level)
        cells[size].name, cells[size].label = f"{size}x{size}", places(size)
    out = {
        "S1 whole picture": [st.whole_cells(*fine)],  # its weights are those of 8 x 8 pixels
        f"S2 {block}x{block}": [cells[block]],
        "S2 16x16, 32x32": [cells[16], cells[32]],
    }
    if parts is not None:
        out["S2 materials"] = [st.cells(st.objects(*parts), d, level)]
        out["S2 materials"][0].name = "materials"
    return out


def places(size: int) -> Callable[[int], str]:
    """Names of the cells of blocks of `size` pixels."""

    def label(k: int) -> str:
        y, x = divmod(k // 3, references.SIZE // size)
        return f"{size}x{size} pixels at ({x * size}, {y * size}) {st.CHANNELS[k % 3]}"

    return label


def independence(x: Array, noisy: Array, rng: np.random.Generator) -> tuple[float, float]:
    """Tests that blocks (Sidak over two tests), and batches, are independent.

    All blocks: variance of the sum of the standardised blocks over their number, chi-square with
    B - 1. Neighbours: sum of their correlations, each of variance 1 / (B - 1). Batches: the sum of
    products of successive ones, normal with the moments that 2,000 permutations of them give.
    """
    y = x.mean(axis=-1)
    spread = np.where(noisy, y.std(axis=0, ddof=1), np.inf)
    y = (y - y.mean(axis=0)) / np.where(spread > 0, spread, np.inf)
    batches, used = len(y), int((y != 0).any(axis=0).sum())
    together = float(y.sum(axis=(1, 2)).var(ddof=1)) / used * (batches - 1)
    tails = stats.chi2.sf(together, batches - 1), stats.chi2.cdf(together, batches - 1)
    pairs = [(y[:, 1:], y[:, :-1]), (y[:, :, 1:], y[:, :, :-1])]
    number = sum(int(((a != 0) & (b != 0)).any(axis=0).sum()) for a, b in pairs)
    sums = sum(float((a * b).sum()) for a, b in pairs)
    gram = np.tensordot(y, y, axes=([1, 2], [1, 2]))
    orders = rng.permuted(np.tile(np.arange(batches), (2000, 1)), axis=1)
    chains = gram[orders, np.roll(orders, 1, axis=1)].sum(axis=1)
    chain = float(np.roll(gram, 1, axis=1).trace())
    beside = np.array([sums / np.sqrt(max(number, 1) * (batches - 1))])
    after = np.array([(chain - chains.mean()) / max(float(chains.std()), 1e-300)])
    return sidak(min(2 * float(min(tails)), max_z(beside)), 2), max_z(after)


def effective(x: Run, level: Array) -> Array:
    """(sum x)^2 / sum x^2 over the samples of a block, as a share of them."""
    return x.means.mean(axis=0) ** 2 / np.maximum(x.squares, 1e-300)


def power(d: Array, level: Array, block: int, parts: Parts | None = None) -> dict[str, float]:
    """Smallest relative bias found with 90 % power, by scale: the best channel, the median block.

    d: (B, H, W, 3) differences of batch means; level: (H, W, 3).
    """
    seen = {}
    for groups in scales(d, level, block, parts).values():
        for c in groups:
            error = c.values.std(axis=0, ddof=1) / np.sqrt(len(d))
            tests = sum(g.level.size for g in groups)
            bias = st.smallest_bias(c.level, error, len(d) - 1, FIRST / TESTS, tests)
            known = bias[np.isfinite(bias) & (bias > 0)]
            if known.size:
                seen[c.name] = float(known.min() if c.name == "whole picture" else np.median(known))
    return seen


# ---- the two sides ----


def theirs(t: Trial, name: str, scene: Scene) -> Run:
    """The reference's run for this trial, of this very scene."""
    path = references.FOLDER / f"{name}.npz"
    t.check(path.is_file(), f"no results of the reference: {path.name} is missing")
    kept = references.load(name)
    t.check(kept.sha256 == scene.sha256, f"{name} has changed since the reference rendered it")
    return kept.run(t.effort)


def ours(t: Trial, scene: Scene, run: Run) -> Run:
    """Our own run of the same effort; S0 is checked."""
    batches = len(run.means)
    once = Trial(t.device, t.fresh(), 1, t.threads)  # the effort is the run's
    r = once.render(scene, batches * run.spp, batches=batches, sampler="independent")
    t.checks, t.samples = t.checks + once.checks, t.samples + once.samples
    t.check(
        scene.film.filter in ("mitchell", "lanczos") or (r.image >= 0).all(), "S0: negative values"
    )
    means, squares = references.reduced(r.batch_means, r.image, r.stderr, r.spp, run.block)
    return Run(means, squares, r.stats["ledger"], run.block, run.spp)


def materials(t: Trial, scene: Scene, block: int) -> Parts:
    """Which material most of a block's pixels show, by a ray through each centre; 0 is none."""
    view, size = scene.camera, references.SIZE
    at = 1 - (2 * np.arange(size) + 1) / size
    x, y = np.meshgrid(at * view.tan_half_x(size, size), at * view.tan_half_y(size, size))
    parallel = view.projection == "orthographic"
    ahead = np.full_like(x, view.clip_depths[0] if parallel else 1.0)
    local = np.stack([x, y, ahead], axis=-1).reshape(-1, 3) @ view.placed[:3, :3].T
    directions = np.tile(view.placed[:3, 2], (len(local), 1)) if parallel else local
    directions = directions / np.linalg.norm(directions, axis=1)[:, None]
    origins = np.ascontiguousarray(view.to_world[:3, 3] + (local if parallel else 0 * local))
    _, primitive = t.native.intersect(
        t.native_scene(scene), np.ascontiguousarray(origins), directions
    )
    tables = (scene.triangle_material, scene.sphere_material, scene.disk_material)
    material = np.append(np.concatenate([np.asarray(v, np.int64) for v in tables]), -1)[primitive]
    pixels = (material + 1).reshape(size // block, block, size // block, block)
    groups = pixels.transpose(0, 2, 1, 3).reshape(size // block, size // block, -1)
    count = np.stack([(groups == k).sum(axis=-1) for k in range(material.max() + 2)])
    kinds = [MATERIAL_KINDS[k] for k in np.asarray(scene.material_kind)]
    names = {k + 1: f"{kind} (material {k})" for k, kind in enumerate(kinds)}
    return count.argmax(axis=0), {0: "background", **names}


def scaled(run: Run, factor: float) -> Run:
    """The same samples times a factor."""
    return dataclasses.replace(run, means=run.means * factor, squares=run.squares * factor**2)


def planted(t: Trial, scene: Scene, own: Run, run: Run) -> tuple[float, str]:
    """The p value that a case with a planted error would have, and the test that gave it."""
    judgement = comparison(own, run, materials(t, scene, run.block), t.rng, fine=False)
    p, where = min(judgement)
    return sidak(p, len(judgement)), where


# ---- cases ----


@case(5, once=True)
def every_scene_has_a_reference(t: Trial) -> None:
    """All scenes of scenes/checks are compared, in quick runs and in full ones.

    At least 42 scenes, each with a file of results of this very scene.
    """
    t.check(len(NAMES) >= 42, f"{len(NAMES)} scenes in scenes/checks")
    for name in NAMES:
        theirs(t, name, check_scene(name, references.SIZE))


@case(5, each={"name": NAMES}, quick=lambda name: name in QUICK)
def agrees_with_the_reference(t: Trial, name: str) -> None:
    """Our picture against the independent reference's, at equal effort.

    No difference; sees about 0.1 % of the whole picture at effort 4 and above, 0.5 % below.
    R. A. Fisher, The Design of Experiments, 1935; P. H. Westfall and S. S. Young,
    Resampling-Based Multiple Testing, 1993.
    """
    scene = check_scene(name, references.SIZE)
    run = theirs(t, name, scene)
    own, parts = ours(t, scene, run), materials(t, scene, run.block)
    # Under other filters than the box our pixels share samples, and have less noise.
    shared = scene.film.filter != "box"
    features = t.native_scene(scene).features
    alike = not shared and references.lights_alike(features)
    ends = name not in TUBES and references.roulette_alike(features)
    left_out = ("L4",) * (not ends) + ("S4", "S6") * (not alike)
    left_out += ("S5: noise of blocks",) * shared
    for p, what in comparison(own, run, parts, t.rng):
        if not what.startswith(left_out):
            t.p(p, what)
    d, level = own.means - run.means, (own.means.mean(axis=0) + run.means.mean(axis=0)) / 2
    coarse = references.SIZE // 8 // run.block or 1
    t.figure("t", st.t_values(st.block_means(d, coarse).mean(axis=-1)).round(3).ravel())
    t.figure("samples of a pixel", run.spp * len(run.means))
    seen = power(d, level, run.block, parts)
    t.figure("sees", {scale: round(bias, 6) for scale, bias in seen.items()})
    t.sees(seen["whole picture"], 2e-3 if references.full(t.effort) else 2e-2)


@case(5, each={"name": ("cube_affine", "gaussian", "point_light", "rectangle_sheared",
                        "spot_light", "tent")},
      quick=lambda name: name == "spot_light")  # fmt: skip
def finds_a_bias_of_the_whole_picture(t: Trial, name: str) -> None:
    """Planted: our picture times 1.001 is rejected, by its mean alone.

    At effort 4 and above; below it, times 1.005. The shift is above twelve standard errors in these
    scenes; what 90 % power sees in each scene is stated by agrees_with_the_reference.
    """
    scene = check_scene(name, references.SIZE)
    run = theirs(t, name, scene)
    bias = 1e-3 if references.full(t.effort) else 5e-3
    own = scaled(ours(t, scene, run), 1 + bias)
    found = comparison(own, run, materials(t, scene, run.block), t.rng, fine=False)
    p, where = next((p, where) for p, where in found if where.startswith("S1"))
    p = sidak(p, len(found))
    t.figure("p", p)
    t.check(p < FIRST, f"a bias of {bias} is not seen: p = {p:.2g}, {where}")


#: Material with a planted bias at full effort: scene, column of the scene, row of the column, bias.
#: Each shifts a statistic by ten standard errors or more.
MATERIALS: Mapping[str, tuple[str, str, int, float]] = {
    "floor": ("point_light", "reflectance", 0, 0.005),
    "walls": ("conductor_mirror", "reflectance", 0, 0.005),
    "red wall": ("plastic", "reflectance", 1, 0.005),
    "medium": ("null_medium", "albedo", 0, 0.005),
    "plastic": ("plastic", "reflectance", 4, 0.01),
    "tinted mirror": ("conductor_mirror", "specular_reflectance", 6, 0.01),
    "mesh": ("face_normals", "reflectance", 2, 0.01),
}


@case(5, each={"material": MATERIALS}, quick=lambda material: material == "mesh")
def finds_a_bias_of_one_material(t: Trial, material: str) -> None:
    """Planted: one material's reflectance times 1.005, or 1.01 where it is small: rejected.

    At effort 4 and above; below it six times the bias.
    """
    name, column, row, bias = MATERIALS[material]
    scene = check_scene(name, references.SIZE)
    run = theirs(t, name, scene)
    bias *= 1 if references.full(t.effort) else 6
    values = np.array(getattr(scene, column))
    values[row] *= 1 + bias
    t.check(values <= 1, "the planted value is above 1")
    other = dataclasses.replace(scene, **{column: values})
    p, where = planted(t, scene, ours(t, other, run), run)
    t.figure("p", p)
    t.check(p < FIRST, f"a bias of {bias} is not seen: p = {p:.2g}, {where}")


@case(5, each={"name": ("smooth_normals", "plastic_nonlinear")},
      quick=lambda name: name == "smooth_normals")  # fmt: skip
def finds_another_scene(t: Trial, name: str) -> None:
    """Planted: face normals for smooth ones, a plastic without colour shift: rejected.

    The power to see what a material or a normal does, not only how bright it is.
    """
    other = {"smooth_normals": "face_normals", "plastic_nonlinear": "plastic"}[name]
    scene = check_scene(other, references.SIZE)
    run = theirs(t, other, scene)
    own = ours(t, check_scene(name, references.SIZE), run)
    p, where = planted(t, scene, own, run)
    t.check(p < FIRST, f"{name} passes for {other}: p = {p:.2g}, {where}")
