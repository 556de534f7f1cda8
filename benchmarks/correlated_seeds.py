"""Correlated seeds (figure 2 of the 2016 report): its seeding re-made, beside ours.

The seeding of 2016: every bounce seeds a linear congruential generator (minstd) with a hash of the
pixel plus hashes of pass, clock and depth, and draws its numbers from it. What is added is the same
for all pixels and the generator is linear, so the numbers u, u' of a pixel in two bounces obey
u' = frac(u + c) with one constant c for the picture: over the pixels they have the correlation
1 - 6 c (1 - c). It is shown twice: with a clock that does not tick within a pass (c is the same in
all passes), and with one read at every bounce (c changes). Ours is pcg4d, from the native module.

The scene is an integrating sphere seen from inside: a lamp in its top cap, black, and bands of two
reflectances below. Whatever point of a sphere light leaves from, diffusely, it arrives evenly all
over it, so the radiance after n bounces is known in closed form:
    L(x) = E(x) + rho(x) mean(E) (1 + r + ... + r^(n - 1)),  r = mean(rho).
"""

from __future__ import annotations

import io
import math
import sys
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt
from common import ROOT, header, parser, write

from veriray_validate.generators import Numbers, native_numbers, seeded_2016

Array = npt.NDArray[Any]

BOUNCES = 8
LAMP, CAP = 10.0, 0.8  # radiance of the lamp, which is the part of the sphere above y = CAP
DARK, BRIGHT, BANDS = 0.5, 0.95, 9  # reflectances of the bands between y = -1 and y = CAP


# ---- scene ----


def emission(y: Array) -> Array:
    """Emitted radiance at height y of the unit sphere."""
    return np.where(y > CAP, LAMP, 0.0)


def reflectance(y: Array) -> Array:
    """Reflectance at height y: bands of equal height, hence of equal area; the lamp is black."""
    band = np.floor((y + 1) / (1 + CAP) * BANDS).astype(int)
    return np.where(y > CAP, 0.0, np.where(band % 2 == 0, BRIGHT, DARK))


def truth(y: Array) -> Array:
    """Radiance that leaves the point at height y after BOUNCES bounces, in closed form."""
    cap = (1 - CAP) / 2  # by Archimedes a zone's share of the area is its share of the height
    bright = (BANDS + 1) // 2
    r = (1 - cap) * (BRIGHT * bright + DARK * (BANDS - bright)) / BANDS
    series = sum(r**k for k in range(BOUNCES))
    return emission(y) + reflectance(y) * LAMP * cap * series


def first_points(size: int) -> Array:
    """Where the rays through the pixels' centres meet the sphere: (size^2, 3), row 0 on top.

    The camera is inside, at (0, 0, -0.7), looks along +z and sees 100 degrees.
    """
    tangent = math.tan(math.radians(50))
    side = (np.arange(size) + 0.5) / size * 2 - 1
    y, x = np.meshgrid(-side * tangent, side * tangent, indexing="ij")
    d = np.stack([x, y, np.ones_like(x)], axis=-1).reshape(-1, 3)
    d /= np.linalg.norm(d, axis=1, keepdims=True)
    b = -0.7 * d[:, 2]
    t = -b + np.sqrt(b * b - 0.7**2 + 1)
    return d * t[:, None] + [0.0, 0.0, -0.7]


def next_points(x: Array, u: Array) -> Array:
    """From points x of the sphere, along cosine-distributed directions, to the sphere again."""
    inward = -x
    helper = np.where(np.abs(inward[:, :1]) > 0.1, [[0.0, 1.0, 0.0]], [[1.0, 0.0, 0.0]])
    tangent = np.cross(helper, inward)
    tangent /= np.linalg.norm(tangent, axis=1, keepdims=True)
    radius, angle = np.sqrt(u[:, 0]), 2 * math.pi * u[:, 1]
    a, b = radius * np.cos(angle), radius * np.sin(angle)
    c = np.sqrt(np.maximum(1 - u[:, 0], 0))
    w = a[:, None] * tangent + b[:, None] * np.cross(inward, tangent) + c[:, None] * inward
    y = x + 2 * c[:, None] * w
    return y / np.linalg.norm(y, axis=1, keepdims=True)


def trace(numbers: Numbers, start: Array, pixel: Array, sample: int) -> tuple[Array, Array]:
    """One pass: radiance (P,) and the numbers drawn (BOUNCES, P, 2)."""
    x, throughput, radiance = start, np.ones(len(start)), emission(start[:, 1])
    drawn = np.empty((BOUNCES, len(start), 2))
    for bounce in range(BOUNCES):
        drawn[bounce] = numbers(pixel, sample, bounce)
        throughput = throughput * reflectance(x[:, 1])
        x = next_points(x, drawn[bounce])
        radiance = radiance + throughput * emission(x[:, 1])
    return radiance, drawn


# ---- measurement ----


def correlations(drawn: Array) -> Array:
    """Over the pixels, between the same number of consecutive bounces: (BOUNCES - 1, 2)."""
    centred = drawn - drawn.mean(axis=1, keepdims=True)
    spread = np.sqrt((centred**2).mean(axis=1))
    return (centred[1:] * centred[:-1]).mean(axis=1) / (spread[1:] * spread[:-1])


def measure(numbers: Numbers, size: int, passes: int) -> tuple[dict[str, Any], Array, Array]:
    """A picture of `passes` samples a pixel and what is wrong with it.

    Returns a table row, the picture (size, size), and the numbers of the first pass.
    The error of the picture's mean is judged against two standard errors: `claimed`, from the
    spread of the samples as if all were independent, and `seen`, from the spread of the passes'
    means. chi_squared is the mean over pixels of (error / claimed standard error)^2: 1 if the
    error bars are right.
    """
    start, pixel = first_points(size), np.arange(size * size, dtype=np.uint32)
    exact = truth(start[:, 1])
    total, squares = np.zeros(len(pixel)), np.zeros(len(pixel))
    means, r = np.empty(passes), []
    for sample in range(passes):
        radiance, drawn = trace(numbers, start, pixel, sample)
        total += radiance
        squares += radiance**2
        means[sample] = radiance.mean()
        r.append(correlations(drawn))
        if sample == 0:
            first = drawn
    mean = total / passes
    variance = (squares / passes - mean**2) * passes / (passes - 1)
    error = mean - exact
    lit = variance > 0
    claimed = math.sqrt(variance.sum() / passes) / len(pixel)
    seen = float(means.std(ddof=1)) / math.sqrt(passes)
    absolute = np.abs(np.array(r))
    level = float(exact.mean())
    row = {
        "relative_bias": float(error.mean()) / level,
        "relative_standard_error_claimed": claimed / level,
        "relative_standard_error_seen": seen / level,
        "z_claimed": float(error.mean()) / claimed,
        "z_seen": float(error.mean()) / seen,
        "chi_squared": float((error[lit] ** 2 / (variance[lit] / passes)).mean()),
        "rms_error_of_pixels": float(np.sqrt((error**2).mean())) / level,
        "rms_claimed": float(np.sqrt((variance / passes).mean())) / level,
        "mean_abs_r": float(absolute.mean()),
        "worst_abs_r": float(absolute.max()),
    }
    return row, mean.reshape(size, size), first


def picture(path: Path, rows: dict[str, Any], shown: dict[str, Any], exact: Array) -> None:
    """Per generator: the picture, its error, and the numbers of two consecutive bounces."""
    import matplotlib

    matplotlib.use("Agg")
    from matplotlib import pyplot as plt
    from PIL import Image

    size, count = exact.shape[0], len(shown)
    figure, axes = plt.subplots(3, count, figsize=(3.3 * count, 10.1), layout="constrained")
    limit = 0.25 * float(exact[exact < LAMP].mean())
    for k, (name, (mean, first)) in enumerate(shown.items()):
        row = rows[name]
        axes[0, k].imshow(np.clip(mean / 4.5, 0, 1) ** (1 / 2.2), cmap="gray", vmin=0, vmax=1)
        axes[0, k].set_title(name, fontsize=10)
        axes[1, k].imshow(mean - exact, cmap="RdBu_r", vmin=-limit, vmax=limit)
        axes[1, k].set_title(
            f"error: mean {100 * row['relative_bias']:+.2f} %, claimed +- "
            f"{100 * row['relative_standard_error_claimed']:.2f} %, seen +- "
            f"{100 * row['relative_standard_error_seen']:.2f} %\n"
            f"(error / standard error)$^2$ = {row['chi_squared']:.2f}",
            fontsize=8,
        )
        some = slice(0, size * size, max(size * size // 6000, 1))
        axes[2, k].plot(first[0, some, 0], first[1, some, 0], ",", color="black")
        axes[2, k].set_title(
            f"u of bounces 1 and 2; all: mean |r| {row['mean_abs_r']:.3f}, "
            f"worst {row['worst_abs_r']:.3f}",
            fontsize=8,
        )
        axes[2, k].set(xlim=(0, 1), ylim=(0, 1), aspect="equal")
    for axis in axes.ravel():
        axis.set(xticks=[], yticks=[])
    path.parent.mkdir(parents=True, exist_ok=True)
    file = io.BytesIO()
    figure.savefig(file, dpi=90)
    plt.close(figure)
    Image.open(file).convert("RGB").quantize(128).save(path, optimize=True)


def main() -> int:
    """Command line. Status 0: ours is unbiased and uncorrelated, and the 2016 seeding is not."""
    p = parser(__doc__, "correlated_seeds.json")
    p.add_argument("--size", type=int, default=160, help="pixels a side")
    p.add_argument("--passes", type=int, default=512, help="samples per pixel")
    p.add_argument("--image", type=Path, default=ROOT / "docs" / "images" / "correlated_seeds.png")
    args = p.parse_args()
    generators = {
        "2016, clock still within a pass": seeded_2016(ticks_a_pass=7, ticks_a_bounce=0),
        "2016, clock read each bounce": seeded_2016(ticks_a_pass=7_411, ticks_a_bounce=877),
        "ours (pcg4d)": native_numbers(),
    }
    rows, shown = {}, {}
    for name, numbers in generators.items():
        rows[name], mean, first = measure(numbers, args.size, args.passes)
        shown[name] = mean, first
        print(f"\n{name}")
        for key, value in rows[name].items():
            print(f"  {key:<32} {value:+.5f}")
    pixels = args.size**2
    expected = {
        "mean_abs_r_independent": math.sqrt(2 / (math.pi * pixels)),
        "mean_abs_r_2016": 2 / (3 * math.sqrt(3)),  # mean of |1 - 6 c (1 - c)| over c
    }
    print(f"\nexpected mean |r|: independent {expected['mean_abs_r_independent']:.5f}, one random "
          f"constant per pair {expected['mean_abs_r_2016']:.3f}")  # fmt: skip
    picture(args.image, rows, shown, truth(first_points(args.size)[:, 1]).reshape(args.size, -1))
    still, _, good = rows.values()
    n = args.passes * (BOUNCES - 1) * 2
    holds = {
        "ours unbiased (|z| < 4)": abs(good["z_claimed"]) < 4 and abs(good["z_seen"]) < 4,
        "ours: right error bars (within 4 standard errors)": abs(good["chi_squared"] - 1)
        < 4 * math.sqrt(2 / pixels) + 4 / args.passes,
        "ours uncorrelated": abs(good["mean_abs_r"] / expected["mean_abs_r_independent"] - 1)
        < 4 * 0.756 / math.sqrt(n),
        "2016 biased": abs(still["z_claimed"]) > 4 and still["chi_squared"] > 1.5,
    }
    for text, verdict in holds.items():
        print(f"{text}: {'yes' if verdict else 'NO'}")
    settings = {"size": args.size, "passes": args.passes, "bounces": BOUNCES}
    result = {**header("correlated_seeds", "matplotlib"), "settings": settings}
    write({**result, "expected": expected, "generators": rows, "checks": holds}, args.output)
    return 0 if all(holds.values()) else 1


if __name__ == "__main__":
    sys.exit(main())
