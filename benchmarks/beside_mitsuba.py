# ruff: noqa: E501 (what is said of differences)
"""Every parameter that docs/what-is-read.md marks as read, beside Mitsuba 3, in a scene where it counts.

The cases are those of `tests/plugins` (each plugin alone, each parameter with each kind of value) in
a stage of lamps, floor and wall, and MORE of this file: reliefs, blends and what files combine. Both
render the same file, Mitsuba with its integrator in `moment`, so both tell the variance of a pixel.
Means of 8 by 8 pixels and of the whole picture, each channel, are compared as z = difference /
standard error; |z| is over the bound by chance in one of 1,000 runs of the whole list (Bonferroni).
A case over it is judged by a second run with other seeds and eight times the samples, where
Mitsuba's variance is that of 16 pictures. `effect` is the largest |z| between a parameter's picture and the plugin's
alone: below the bound the case says little.

python benchmarks/beside_mitsuba.py [--only REGEX --add] [--variant scalar_rgb] [-o FILE]
"""

from __future__ import annotations

import json
import re
import sys
import tempfile
import time
import warnings
from pathlib import Path
from typing import Any

import mitsuba_peer
import numpy as np
from beside_scenes import SIZE, cases, files
from common import Array, header, parser, write
from scipy import stats

import veriray

BLOCK = 8
ALPHA = 1e-3
#: Cases that are not compared, and why.
NOT_COMPARED = {
    r"film.hdrfilm.pixel_format.*(xyz|luminance)": "Mitsuba's picture has other channels",
    r"film.specfilm|integrator.stokes|\.srf\.": "needs Mitsuba's spectral variants",
    r"spectrum.(blackbody|irregular|regular)": "Mitsuba's RGB variants do not render with it",
    r"emitter.directionalarea": "dark in both",
    r"emitter.timed_sunsky": "Mitsuba's JIT variants render it in evaluated mode alone",
    r"sensor.batch": "Mitsuba's picture has the sensors side by side",
    r"integrator.(depth|moment)": "another picture by decision: the scene's light",
}
#: Differences that docs/limits.md or docs/what-is-read.md explain.
DECISIONS = {
    r"(flips False|, plain)": "flip_invalid_normals off: a normal that looks away from the viewer is black here",
    r"bumpmap (of|on) brushed": "3.9.1 mixes coordinates of the world and of the surface in a bumpmap's frame",
    r"map of (null|thindielectric|mask)": "what goes straight through a relief is left as it is",
    r"blend.*conductor": "3.9.1 loses light of smooth lobes in a blend",
    r"shape.bsplinecurve": "the inside of a curve is seen through its open ends; in Mitsuba it is not there",
    r"lamp on cube": "a lamp of several faces with the same texture coordinates gives all of its light",
    r"prb_projective.hide_emitters": "the camera sees what is behind hidden lamps, with a warning",
    r"shape.sdfgrid.to_world": "Mitsuba misplaces a turned sdfgrid, and warns of it",
    r"shape.sphere.to_world": "an uneven scale of a sphere",
}


def blocks(image: Array, variance: Array) -> tuple[Array, Array]:
    """Means of BLOCK x BLOCK pixels and of the whole, and their variances: (n, 3) each."""
    height, width = image.shape[:2]
    down, across = max(1, height // BLOCK), max(1, width // BLOCK)
    means, errors = [image.mean(axis=(0, 1))], [variance.mean(axis=(0, 1)) / (height * width)]
    for rows in np.array_split(np.arange(height), down):
        for columns in np.array_split(np.arange(width), across):
            where = np.ix_(rows, columns)
            means.append(image[where].mean(axis=(0, 1)))
            errors.append(variance[where].mean(axis=(0, 1)) / (rows.size * columns.size))
    return np.stack(means), np.stack(errors)


def theirs(mi: Any, path: Path, spp: int, seed: int, batches: int) -> tuple[Array, Array]:
    """Mitsuba's picture (H, W, 3) and the variances of its pixels.

    Of `batches` pictures; if 0 from the moments that one picture has, which are those of XYZ: the
    relative error of a channel is taken as that of the same one of XYZ.
    """
    scene = mi.load_file(str(path))
    inner = scene.integrator()
    if not batches and isinstance(inner, mi.SamplingIntegrator) and not inner.aov_names():
        moment = mi.load_dict({"type": "moment", "inner": inner})
        found = np.array(mi.render(scene, integrator=moment, spp=spp, seed=seed), dtype=np.float64)
        image, xyz, second = found[..., -9:-6], found[..., -6:-3], found[..., -3:]
        if found.shape[-1] in (9, 10) and np.isfinite(found).all():
            image = found[..., :3]
            growth = np.maximum(1, image / np.maximum(xyz, 1e-30)) ** 2
            return image, growth * np.maximum(second - xyz**2, 0) / spp
    batches = batches or 8
    each = [mitsuba_peer.picture(mi, scene, spp // batches, seed + k) for k in range(batches)]
    means = np.stack(each).astype(np.float64)
    return means.mean(axis=0), means.var(axis=0, ddof=1) / batches


def ours(path: Path, spp: int, seed: int) -> tuple[Array, Array, list[str]]:
    """Our picture, the variances of its pixels, and what was warned of."""
    with warnings.catch_warnings(record=True) as told:
        warnings.simplefilter("always")
        scene = veriray.load_file(path)
        done = veriray.render(scene, spp=spp, seed=seed, batches=16, device="cpu")
    image, error = done.image.astype(np.float64), done.stderr.astype(np.float64)
    return (
        image,
        error**2,
        [str(one.message).replace(f"{path.parent}/", "").split(": ", 1)[-1] for one in told],
    )


def scores(a: tuple[Any, ...], b: tuple[Any, ...], border: int = 0) -> tuple[Array, Array]:
    """Z of each region and channel, and the relative difference of the whole."""
    cut = slice(border, -border or None)
    (x, vx), (y, vy) = (blocks(p[0][cut, cut], p[1][cut, cut]) for p in (a, b))
    with np.errstate(invalid="ignore", divide="ignore"):
        rounding = 1e-5 * np.maximum(np.abs(x), np.abs(y))
        z = (x - y) / np.sqrt(vx + vy + rounding**2)
        relative = x[0].mean() / y[0].mean() - 1
    return np.nan_to_num(z), relative


def judge(
    mi: Any, path: Path, spp: int, seed: int, border: int, batches: int = 0
) -> dict[str, Any]:
    """The row of a case."""
    mine = ours(path, spp, seed)
    peer = theirs(mi, path, spp, seed + 1000, batches)
    if mine[0].shape != peer[0].shape:
        return {"fault": f"sizes {mine[0].shape[:2]} and {peer[0].shape[:2]}"}
    z, relative = scores(mine, peer, border)
    (mean, error) = blocks(mine[0], mine[1])
    return {"z": float(np.abs(z).max()), "z_whole": float(np.abs(z[0]).max()), "relative": float(relative),
            "mean": float(mean[0].mean()), "error": float(np.sqrt(error[0].mean()) / max(mean[0].mean(), 1e-30)),
            "warnings": mine[2], "picture": mine}  # fmt: skip


def first(table: dict[str, str], name: str) -> str | None:
    """What a table of patterns says of a name."""
    return next((told for pattern, told in table.items() if re.search(pattern, name)), None)


def told(error: Exception, folder: Path) -> str:
    """The first words of an error, without the place of the file."""
    text = str(error).replace(f"{folder}/", "").split("; allowed:")[0]
    return text.split(": ", 1)[-1][:120]


def main() -> int:
    """Command line."""
    p = parser(__doc__, "beside_mitsuba.json")
    p.add_argument("--only", default="", metavar="REGEX", help="cases whose names it finds")
    p.add_argument("--variant", default="llvm_ad_rgb", help="of Mitsuba (default: %(default)s)")
    p.add_argument("--spp", type=int, default=128)
    p.add_argument("--seed", type=int, default=1)
    p.add_argument(
        "--second", type=int, default=8, help="times the samples of a second run; 0: none"
    )
    p.add_argument("--keep", type=Path, help="folder for the scenes")
    p.add_argument("--add", action="store_true", help="to the rows that the output has")
    args = p.parse_args()
    mi = mitsuba_peer.start(args.variant)
    mi.set_log_level(mi.LogLevel.Error)
    result = header("beside_mitsuba", "mitsuba", "drjit")
    rows: list[dict[str, Any]] = []
    with tempfile.TemporaryDirectory() as name:
        folder = args.keep or Path(name)
        folder.mkdir(exist_ok=True)
        files(folder)
        chosen = [case for case in cases() if re.search(args.only, case.name)]
        tests = 3 * (1 + (SIZE // BLOCK) ** 2) * len(list(cases()))
        bound = float(stats.norm.isf(ALPHA / 2 / tests))
        result["settings"] = {"variant": args.variant, "spp": args.spp, "seed": args.seed, "bound": bound,
                              "second": args.second, "cases": len(chosen)}  # fmt: skip
        alone: dict[str, Any] = {}
        for case in chosen:
            path = folder / f"{re.sub('[^a-zA-Z0-9_.=]', '_', case.name)}.xml"
            path.write_text(case.text, "utf-8")
            row: dict[str, Any] = {"case": case.name}
            begin = time.perf_counter()
            reason = first(NOT_COMPARED, case.name)
            if reason:
                rows.append({**row, "not_compared": reason})
                continue
            try:
                row.update(judge(mi, path, args.spp, args.seed, case.border))
                if row.get("z", 0) > bound and args.second:
                    row["first"] = {k: row[k] for k in ("z", "relative")}
                    row.update(
                        judge(mi, path, args.second * args.spp, args.seed + 1, case.border, 16)
                    )
            except veriray.SceneError as error:
                rows.append({**row, "not_compared": f"refused: {told(error, folder)}"})
                continue
            except Exception as error:
                row["fault"] = f"{type(error).__name__}: {str(error).splitlines()[0][:200]}"
            picture = row.pop("picture", None)
            if case.base is None and picture:
                alone[case.name] = picture
            elif picture and case.base in alone and alone[case.base][0].shape == picture[0].shape:
                row["effect"] = float(np.abs(scores(picture, alone[case.base])[0]).max())
            row["seconds"] = round(time.perf_counter() - begin, 2)
            row["over"] = row.get("z", 0.0) > bound
            decision = first(DECISIONS, case.name)
            if row["over"] and decision:
                row["decision"] = decision
            rows.append(row)
            print(f"{'***' if row['over'] else '   '} {case.name}: " + (row.get("fault") or
                  f"z {row['z']:.1f} whole {row['z_whole']:.1f} relative {row['relative']:+.2%} "
                  f"error {row['error']:.2%} effect {row.get('effect', 0):.0f}") + f" {row['seconds']} s {row.get('warnings') or ''}",
                  flush=True)  # fmt: skip
    if args.add and args.output.is_file():
        new = {row["case"] for row in rows}
        old = json.loads(args.output.read_text())["rows"]
        rows = [row for row in old if row["case"] not in new] + rows
    compared = [row for row in rows if "z" in row]
    effects = [row["effect"] for row in compared if "effect" in row]
    result["summary"] = {
        "compared": len(compared),
        "not_compared": sum("not_compared" in row for row in rows),
        "faults": sum("fault" in row for row in rows),
        "over": [row["case"] for row in compared if row["over"] and "decision" not in row],
        "over_by_decision": [row["case"] for row in compared if "decision" in row],
        "parameters_whose_effect_shows": f"{sum(x > bound for x in effects)} of {len(effects)}",
        "median_relative_error": float(np.median([row["error"] for row in compared])),
    }
    result["rows"] = rows
    write(result, args.output)
    return 1 if result["summary"]["over"] else 0


if __name__ == "__main__":
    sys.exit(main())
