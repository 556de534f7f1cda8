"""Level 7: the Cornell box from its measured spectra, and what RGB rendering of it costs.

The ground truth is XYZ by the independent reference renderer, three wavelengths a render
(benchmarks/make_spectral.py), kept in references/cornell_spectral.npz with its standard errors.
"""

from __future__ import annotations

import base64
import dataclasses
import functools
import hashlib
import io
import json
import math
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

from veriray.camera import Film
from veriray.comparison import statistics as pictures
from veriray.image import to_srgb8
from veriray.rendering import Render
from veriray.scene import Scene, cornell_box
from veriray.shipped import find_shipped
from veriray_validate import spectral
from veriray_validate.form_factors import lambert
from veriray_validate.scenes import camera, without
from veriray_validate.statistics import smallest_bias, welch
from veriray_validate.trial import EFFECTIVE, Inconclusive, Skipped, Trial, case

Array = npt.NDArray[Any]

#: SHA-256 of the data, as compared with its sources (scenes/cornell/README.md).
CHECKSUMS = {
    "camera.json": "c68c27ef430bac13c1ea3390fa7686fe23a18a50c57363037f05390836e8a3b3",
    "derived_rgb.json": "64d6af0a3920e8da73973e40328a3f6bd6731f7c52b2a1929714e5a0ce0800b9",
    "emission.csv": "db1a89a9ede23876adfcdf16701715ee90af0fe22dca06dd8d71d7dbf737cd87",
    "geometry.json": "b9425a5d83969c405f9c1ee251940608b24ff085c0870fa0d73955846fd18378",
    "light.json": "531cbf241b90b29715c21ea2a30c6c70e8e2ed6a8ce8d431ac3ac3caa0872a47",
    "reflectance.csv": "ca77cb5ad40b22fbeabc7ea9c75c695d9cf5d32e1a0bf5d597dcb2101b70a354",
}
#: Point, normal, shape, and irradiance over the lamp's radiance, without the blocks.
PLACES = {
    "floor": ((278, 0, 279.5), (0, 1, 0), "floor", 0.044632475),
    "floor in front": ((100, 0, 100), (0, 1, 0), "floor", 0.030656670),
    "floor behind": ((278, 0, 500), (0, 1, 0), "floor", 0.033300261),
    "green wall": ((0, 274.4, 279.6), (1, 0, 0), "right_wall", 0.044180738),
    "back wall": ((278, 274.4, 559.2), (0, 0, -1), "back_wall", 0.043652624),
}
#: Wavelengths in nm: blue, green and red light.
WAVELENGTHS = (444.0, 544.0, 644.0)
#: Renders of the reference whose batch means are kept, by their row.
BANDS = {"444, 544, 644 nm": 0, "500, 600, 700 nm": 1, "RGB": 2}
CELL, SMALL = 16, 8  # pixels a side of blocks: of the bands, of the coarse sums
LIGHT = list(spectral.PARTS).index("lamp")
#: Delta E allowed relative to that of five plain walls, which have no blocks and are lit uniformly.
SLACK = 2.0
REFERENCE = Path(__file__).parents[1] / "references" / "cornell_spectral.npz"


@functools.cache
def truth() -> dict[str, Any]:
    """The reference's file (benchmarks/make_spectral.py lists what it holds); facts as a dict.

    Raises Skipped if it is missing.
    """
    if not REFERENCE.is_file():
        raise Skipped(f"no {REFERENCE.name}: benchmarks/make_spectral.py makes it")
    with np.load(REFERENCE) as file:
        return {**{k: file[k] for k in file.files if k != "facts"},
                "facts": json.loads(str(file["facts"]))}  # fmt: skip


def at_wavelengths(wavelengths: Any) -> Scene:
    """The measured box with three wavelengths (nm) as its R, G and B."""
    return spectral.repaint(
        cornell_box(), spectral.reflectance(wavelengths), spectral.emission(wavelengths)
    )


def _near(mask: Array) -> Array:
    """The mask and the pixels next to it: a sliver of the lamp outshines a wall."""
    wide = np.pad(mask, 1)
    shifts = [wide[i : i + len(mask), j : j + mask.shape[1]] for i in range(3) for j in range(3)]
    return np.asarray(np.any(shifts, axis=0))


def _left_out(part: Array) -> Array:
    """Pixels that are in no statistic: the lamp with its edge, and those that look past the box."""
    return np.asarray((part == spectral.OUTSIDE) | _near(part == LIGHT))


def _touched(mask: Array, size: int) -> Array:
    """Blocks with any pixel of the mask."""
    return np.asarray(spectral.blocks(np.where(mask, 1.0, 0.0)[..., None], size)[..., 0] > 0)


# ---- the data ----


@case(7, once=True)
def data(t: Trial) -> None:
    """The measured numbers and the colours derived from them are those that were checked.

    Exact: SHA-256 of six files; 3 x 76 reflectances in (0, 1), 400 to 700 nm by 4 nm, with the
    published ends; four emissions. XYZ and RGB of every paint, under the lamp and under equal
    energy, equal those of derived_rgb.json, which another program made, to 1e-8; the shipped scene
    and the reference's file hold them.
    """
    folder = find_shipped("cornell-box").parent
    digest = {n: hashlib.sha256((folder / n).read_bytes()).hexdigest() for n in CHECKSUMS}
    for name, known in CHECKSUMS.items():
        t.check(digest[name] == known, f"{name} has another SHA-256")
    nodes = spectral.reflectance(spectral.NODES)
    for paint, (first, last) in {
        "white": (0.343, 0.737), "green": (0.092, 0.159), "red": (0.040, 0.642),
    }.items():  # fmt: skip
        t.check(len(nodes[paint]) == 76 and nodes[paint].min() > 0 and nodes[paint].max() < 1,
                f"{paint}: 76 reflectances in (0, 1)")  # fmt: skip
        t.check(nodes[paint][[0, -1]] == [first, last], f"{paint}: published ends")
    t.check(spectral.emission([400, 500, 600, 700]) == [0, 8, 15.6, 18.4], "emission")
    t.check(nodes["lamp"] == 0.78, "reflectance of the lamp")

    recorded = json.loads((folder / "derived_rgb.json").read_text("utf-8"))["values"]
    fine = spectral.reflectance(spectral.FINE)
    names = {**{p: p for p in spectral.PAINTS}, "lamp": "light_surface_0.78"}
    lamp = spectral.emission(spectral.FINE)
    for key, light in (("equal_energy_E", np.ones_like(lamp)), ("measured_light", lamp)):
        for paint, name in names.items():
            own = spectral.xyz(light * fine[paint]) / spectral.xyz(light)[1]
            rgb = spectral.to_rgb() @ own
            off = max(np.abs(own - recorded[key][name]["XYZ"]).max(),
                      np.abs(rgb - recorded[key][name]["rgb"]).max())  # fmt: skip
            t.check(off < 1e-8, f"{paint} under {key}: off by {off:.2g}")
    paints, rgb = spectral.colours()
    t.check(np.abs(rgb - recorded["light_emission"]["rgb_over_ybar"]) < 1e-8, "RGB of the lamp")
    sum_of_nodes = spectral.emission(spectral.NODES) @ spectral.weights(spectral.NODES)
    t.check(np.abs(spectral.to_rgb() @ sum_of_nodes / rgb - 1) < 1e-12, "lamp by 76 wavelengths")

    box, made = cornell_box(), spectral.repaint(cornell_box(), paints, rgb)
    t.check(np.abs(box.reflectance - made.reflectance) <= 6e-7, "the scene's reflectances")
    t.check(np.abs(box.emissions - made.emissions) <= 2e-6, "the scene's lamp")
    t.figure("table of colours", {
        "columns": ["", "R", "G", "B", "X", "Y", "Z"],
        "rows": [[p, *np.round(paints[p], 6).tolist(),
                  *np.round(spectral.xyz(lamp * fine[p]), 6).tolist()] for p in names],
    })  # fmt: skip
    if REFERENCE.is_file():
        known = {n: digest[n] for n in ("reflectance.csv", "emission.csv", "light.json")}
        known["cornell_box.xml"] = hashlib.sha256(
            find_shipped("cornell-box").read_bytes()
        ).hexdigest()
        t.check(truth()["facts"]["sha256"] == known, f"{REFERENCE.name} is of other data")


@case(7, each={"place": PLACES})
def lamp_light(t: Trial, place: str) -> None:
    """Direct light of the box without its blocks, at three wavelengths.

    rho e F with Lambert's polygon for F (J. H. Lambert, Photometria, 1760), which equals the
    known value to 1e-6. Finds a bias of 0.3 %.
    """
    point, normal, shape, value = PLACES[place]
    factor = lambert(point, normal, spectral.LAMP)
    t.check(abs(math.pi * factor / value - 1) < 1e-6, "the known value")
    paint = {"right_wall": "green"}.get(shape, "white")
    exact = spectral.reflectance(WAVELENGTHS)[paint] * spectral.emission(WAVELENGTHS) * factor
    empty = without(at_wavelengths(WAVELENGTHS), lambda name: "block" in name)
    view = camera([278, 200, 250], point)
    scene = dataclasses.replace(empty, camera=view, film=Film(1, 1, "box"), max_depth=2)
    t.agrees(scene, exact, 800_000, sees=0.003)


# ---- wavelengths ----


@case(7)
def channels(t: Trial) -> None:
    """R, G and B are three independent wavelengths.

    Exact, bit for bit: wavelengths in another order give the channels in that order, one wavelength
    three times gives three equal channels, and at 400 nm, where the lamp is dark, the picture is 0.
    """
    settings: dict[str, Any] = {"width": 48, "height": 48, "seed": t.fresh()}
    whole = t.render(at_wavelengths(WAVELENGTHS), 16, **settings).image
    for order in ([1, 2, 0], [2, 0, 1], [1, 0, 2]):
        turned = t.render(at_wavelengths(np.array(WAVELENGTHS)[order]), 16, **settings).image
        t.check(turned == whole[..., order], f"channels {order}")
    grey = t.render(at_wavelengths((544.0, 544.0, 544.0)), 16, **settings).image
    t.check((grey == grey[..., :1]) & (grey[..., :1].max() > 0), "one wavelength")
    dark = t.render(at_wavelengths((400.0, 544.0, 700.0)), 16, **settings).image
    t.check(dark[..., 0] == 0, "light at 400 nm")
    t.check(dark[..., 1:].max(axis=(0, 1)) > 0, "no light at 544 or 700 nm")


@case(7, each={"band": BANDS}, quick=lambda band: not band.startswith("5"), stored=True)
def against_reference(t: Trial, band: str) -> None:
    """Our box at three wavelengths, and in RGB, against the independent reference.

    Equal means, of the picture and of 64 blocks of 16 x 16 pixels, in every channel: Welch's t test
    of 64 batches from each, Sidak. Efforts differ, so blocks with fewer than 1,000 effective
    samples, which show an edge of the lamp, are left out, as is the lamp from the mean of the
    picture. Finds 0.5 % of the picture, and 3 % in a median block.
    """
    stored = truth()
    row, size = BANDS[band], stored["facts"]["size"]
    scene = cornell_box() if band == "RGB" else at_wavelengths(stored["wavelengths"][row])
    theirs = stored["bands"][row].astype(np.float64)
    r = t.render(scene, 256, width=size, height=size, batches=len(theirs))
    ours = spectral.blocks(r.batch_means, CELL)
    each = pictures.blocks(size, size, CELL)
    carried = pictures.effective_samples(
        r.image.astype(np.float64), r.stderr.astype(np.float64), r.spp, each
    )
    enough = np.flatnonzero(carried >= EFFECTIVE)
    if len(enough) < 0.95 * len(carried):
        raise Inconclusive(f"{len(enough)} of {len(carried)} blocks carry enough samples")
    unlit = ~_touched(_near(spectral.parts(cornell_box(), size) == LIGHT), CELL)

    def relative(a: Array, b: Array) -> tuple[Array, Array]:
        """Difference of the means of batches (B, n) and its standard error, over the mean."""
        level = b.mean(axis=0)
        error = np.sqrt((a.var(axis=0, ddof=1) + b.var(axis=0, ddof=1)) / len(a))
        return (a.mean(axis=0) - level) / level, error / level

    means = [x[:, unlit].mean(axis=1) for x in (ours, theirs)]
    change, error = relative(*means)
    t.p(welch(*means), f"mean of the picture: {np.array2string(100 * change, precision=3)} %")
    t.sees(smallest_bias(float(error.max()), 1.0, 1e-3 / 6), 0.005)
    t.figure("relative difference of the picture", change)
    t.figure("its standard error", error)
    cells = [x.reshape(len(x), -1)[:, enough] for x in (ours, theirs)]
    change, error = relative(*cells)
    worst = int(np.argmax(np.abs(change / error)))
    t.p(welch(*cells), f"{each.label(int(enough[worst]))}: {change[worst]:+.2%}")
    median = smallest_bias(float(np.median(error)), 1.0, 1e-3 / 2 / len(enough))
    t.figure("smallest bias seen in a median block", median)
    t.figure("z", change / error)
    t.figure("map of t, mean of the channels", pictures.t_values((ours - theirs).mean(axis=-1)))


@case(7, once=True)
def quadrature(t: Trial) -> None:
    """The sum over 76 wavelengths is as good as it needs to be.

    For 76 against 301 wavelengths the model of five plain walls predicts less than 1e-3 in X, Y and
    Z, which is less than 0.03 Delta E. The model is trusted because it predicts what 39 and 20
    wavelengths miss in the reference's picture (up to 1.4e-2), to 1e-3 and 2.5e-3 in the mean of
    every wall. In every block of 8 x 8 pixels these errors must lie between those of products of
    reflectances (8 at most, beyond which there is less than 1e-3 of the light), because light in
    the box is a sum of such products with weights >= 0. All within 4.5 standard errors.
    """
    stored = truth()
    size = stored["facts"]["size"]
    exact, part = stored["xyz"].astype(np.float64), spectral.parts(cornell_box(), size)
    luminance = spectral.brightest(exact, part)
    model = spectral.expected(luminance)
    t.check(np.abs(model["quadrature"]) < 1e-3, "76 wavelengths in the model of five walls")
    off = spectral.delta_e(model["xyz"] * (1 + model["quadrature"]), model["xyz"], luminance)
    t.check(off < 0.03, "Delta E of 76 wavelengths in the model")

    _, spectra = spectral.products(8)
    walls = spectral.radiosity(spectral.reflectance(spectral.FINE))[0]
    walls = walls.T * spectral.emission(spectral.FINE)[:, None]
    grid = spectral.same(part, SMALL)
    grid[_touched(_left_out(part), SMALL)] = spectral.MIXED
    fine, rows = spectral.blocks(exact, SMALL), []
    for k, (n, limit) in enumerate(((39, 1e-3), (20, 2.5e-3))):
        step = 2 ** (k + 1)
        ratio = _sum(spectra, step) / _sum(spectra, 1) - 1
        change, error = (stored[x][k].astype(np.float64) for x in ("coarse", "coarse_error"))
        inside = change > ratio.min(axis=0) * fine - 4.5 * error
        inside &= change < ratio.max(axis=0) * fine + 4.5 * error
        t.check(inside[fine[..., 1] > 0], f"{n} wavelengths: a block outside all products")
        told = _sum(walls, step) / _sum(walls, 1) - 1
        for i, wall in enumerate(spectral.WALLS):
            own = grid == i
            total = fine[own].sum(axis=0)
            seen = change[own].sum(axis=0) / total
            noise = np.sqrt((error[own] ** 2).sum(axis=0)) / total
            numbers = np.round(1e3 * np.ravel((seen, noise, told[i])), 3)
            rows.append([f"{n}, {wall}", *numbers.tolist()])
            t.check(np.abs(seen - told[i]) < limit + 4.5 * noise,
                    f"{n} wavelengths, {wall}: {seen}, and {told[i]} was predicted")  # fmt: skip
    for wall, told in zip(spectral.WALLS, model["quadrature"], strict=True):
        rows.append([f"301, {wall}", *[""] * 6, *np.round(-1e3 * told, 3).tolist()])
    head = [f"{kind} {c}" for kind in ("seen", "its error", "predicted") for c in "XYZ"]
    t.figure("table of XYZ by other numbers of wavelengths less that by 76, in 1e-3",
             {"columns": ["wavelengths", *head], "rows": rows})  # fmt: skip


def _sum(spectra: Array, step: int) -> Array:
    """XYZ (m, 3) of spectra (301, m) by every `step`-th of the measured wavelengths."""
    nodes = spectral.NODES[spectral.thinned(step)]
    return np.asarray(spectra[np.searchsorted(spectral.FINE, nodes)].T @ spectral.weights(nodes))


# ---- what RGB costs ----


@dataclasses.dataclass(frozen=True)
class Difference:
    """A render in RGB against the spectra, in CIE Delta E 2000.

    luminance: Y of white. cells: (H, W) of small blocks, NaN where they show the lamp or leave the
    box; noise: the part of their root mean square that is noise; coarse: of blocks of 8 x 8 pixels.
    rows: for each part of the box its XYZ by spectra and by RGB, Delta E of these means, and the
    standard error of our mean in Delta E.
    """

    luminance: float
    cells: Array
    noise: float
    coarse: Array
    rows: dict[str, tuple[Array, Array, float, float]]

    @property
    def numbers(self) -> dict[str, float]:
        """Mean, root mean square without noise, median, 95th percentile and maximum of cells."""
        seen = self.cells[np.isfinite(self.cells)]
        return {
            "mean": float(seen.mean()),
            "rms, noise taken off": math.sqrt(max(spectral.rms(seen) ** 2 - self.noise**2, 0.0)),
            "noise": self.noise,
            "median": float(np.median(seen)),
            "95th percentile": float(np.percentile(seen, 95)),
            "maximum": float(seen.max()),
            "maximum of 8 x 8 pixels": float(np.nanmax(self.coarse)),
        }


def difference(render: Render, cell: int) -> Difference:
    """The RGB render, with batches, against the reference's XYZ, in blocks of `cell` pixels."""
    if render.batch_means is None:
        raise ValueError("the render has no batch means")
    exact = truth()["xyz"].astype(np.float64)
    part = spectral.parts(cornell_box(), len(exact))
    beside, inner = _near(part == LIGHT), ~_near(part != LIGHT)
    luminance = spectral.brightest(exact, part)
    batches = render.batch_means @ np.linalg.inv(spectral.to_rgb()).T
    ours = batches.mean(axis=0)

    def noise(each: Array, mean: Array) -> Array:
        apart = spectral.delta_e(each, mean, luminance)
        return np.asarray(np.sqrt(np.square(apart).mean(axis=0) / (len(each) - 1)))

    def cells(size: int) -> tuple[Array, Array]:
        """Delta E of blocks, and which to leave out."""
        hidden = _touched(_left_out(part), size)
        values = spectral.delta_e(
            spectral.blocks(ours, size), spectral.blocks(exact, size), luminance
        )
        return np.where(hidden, np.nan, values), hidden

    small, hidden = cells(cell)
    of_noise = noise(*(spectral.blocks(x, cell)[..., ~hidden, :] for x in (batches, ours)))
    rows = {}
    for k, name in enumerate(spectral.PARTS):
        own = inner if k == LIGHT else (part == k) & ~beside
        theirs, mine = exact[own].mean(axis=0), ours[own].mean(axis=0)
        rows[name] = (theirs, mine, float(spectral.delta_e(mine, theirs, luminance)),
                      float(noise(batches[:, own].mean(axis=1), mine)))  # fmt: skip
    return Difference(luminance, small, spectral.rms(of_noise), cells(SMALL)[0], rows)


def panels(render: Render, found: Difference, top: float) -> Array:
    """Spectral truth, RGB render and Delta E (black 0, white `top`) side by side: sRGB bytes."""
    shown = [
        to_srgb8(np.maximum(x, 0) / found.luminance)
        for x in (truth()["xyz"] @ spectral.to_rgb().T, render.image)
    ]
    scale = render.image.shape[0] // len(found.cells)
    level = np.kron(np.nan_to_num(found.cells) / top, np.ones((scale, scale)))
    from matplotlib import colormaps

    heat = (colormaps["inferno"](np.clip(level, 0, 1))[..., :3] * 255).astype(np.uint8)
    return np.concatenate([*shown, heat], axis=1)


def png(image: Array) -> str:
    """Bytes (H, W, 3) as a data URL."""
    from PIL import Image

    file = io.BytesIO()
    Image.fromarray(image).save(file, format="png", optimize=True)
    return "data:image/png;base64," + base64.b64encode(file.getvalue()).decode("ascii")


def table(found: Difference) -> dict[str, Any]:
    """Rows for the report, one for each part of the box."""
    return {
        "columns": ["part", "Y by spectra", "X %", "Y %", "Z %", "Delta E", "its error"],
        "rows": [[name, round(float(a[1]), 5), *np.round(100 * (b / a - 1), 3).tolist(),
                  round(e, 3), round(noise, 3)] for name, (a, b, e, noise) in found.rows.items()],
    }  # fmt: skip


@case(7, each={"paints": ["of the lamp's light", "of equal energy"]})
def cost_of_rgb(t: Trial, paints: str) -> None:
    """The RGB picture of the box against its spectra, in XYZ and CIE Delta E 2000.

    Paints as the lamp's light has them make the first bounce exact; later bounces are not, least of
    all after two coloured walls. The radiosity of five plain walls alone predicts: red wall 0.55,
    green wall 0.38, white ones 0.06 to 0.11; in the shade, where no light comes directly from the
    lamp, 1.2, 0.8 and 0.13. Twice that is allowed for what the model leaves out (blocks, and the
    distribution of light on a wall): coloured walls below 2 x their value, white parts below 2 x
    that of the shade, the root mean square over the picture below 2 x the red wall's, and no block
    of 8 x 8 pixels above 2 x the red wall's shade. As a control, paints of equal energy, the usual
    choice, must fail all that. White is the lamp's colour, as bright as a perfect diffuser in the
    brightest place.
    """
    size = truth()["facts"]["size"]
    lit = paints == "of the lamp's light"
    scene = cornell_box() if lit else spectral.repaint(cornell_box(), *spectral.colours(lit=False))
    r = t.render(scene, 512 if lit else 64, width=size, height=size, batches=16)
    found = difference(r, 4)
    model = spectral.expected(found.luminance)
    red, green = (spectral.WALLS.index(w) for w in ("left wall", "right wall"))
    allowed = {spectral.WALLS[k]: SLACK * float(model["all"][k]) for k in (red, green)}
    white = SLACK * float(model["shade"][:3].max())
    numbers = found.numbers
    kept = {
        name: e < allowed.get(name, white) + 5 * noise
        for name, (_, _, e, noise) in found.rows.items() if name != "lamp"
    }  # fmt: skip
    rms, worst = numbers["rms, noise taken off"], numbers["maximum of 8 x 8 pixels"]
    kept["picture"] = rms < SLACK * model["all"][red]
    kept["worst block"] = worst < SLACK * model["shade"][red] + 2 * found.noise
    if lit:
        for name, within in kept.items():
            t.check(within, f"{name}: more Delta E than twice that of five plain walls")
        _, mine, _, _ = found.rows["lamp"]
        theirs = found.rows["lamp"][0]
        t.check(np.abs(mine / theirs - 1) < 1e-3, "the lamp has another colour")
        error = np.sqrt((r.stderr.astype(np.float64) ** 2).sum(axis=(0, 1))) / r.image.sum((0, 1))
        t.sees(smallest_bias(float(error.max()), 1.0), 0.005)
    else:
        t.check(not any(kept.values()), "paints of equal energy look right: the case is blind")
    t.figure("Delta E 2000", {k: round(v, 4) for k, v in numbers.items()})
    t.figure("Y of white", found.luminance)
    t.figure("table of the box", table(found))
    change = 100 * (model["rgb"] / model["xyz"] - 1)
    t.figure("table of five plain walls", {
        "columns": ["wall", "Delta E", "in the shade", "X %", "Y %", "Z %"],
        "rows": [[w, *np.round([model["all"][k], model["shade"][k], *change[k]], 3).tolist()]
                 for k, w in enumerate(spectral.WALLS)],
    })  # fmt: skip
    if lit:
        t.figure("picture of truth, RGB and their difference (Delta E, black 0, white 2)",
                 png(panels(r, found, 2.0)))  # fmt: skip
