"""What RGB rendering of the measured Cornell box costs: the numbers of docs/measured-box.md.

    python benchmarks/measured_box.py

renders the box in RGB, compares it with the spectral ground truth of level 7 of `veriray validate`
(benchmarks/make_spectral.py makes it), writes docs/images/measured_box*.png and the parts of the
page between its `<!-- ... -->` marks, and prints them.
"""

from __future__ import annotations

import argparse
import re
from pathlib import Path
from typing import Any

import matplotlib
import numpy as np
import numpy.typing as npt

import veriray
from veriray.image import to_srgb8
from veriray.scene import cornell_box
from veriray_validate import spectral
from veriray_validate.levels import measured_box as box

ROOT = Path(__file__).resolve().parents[1]
PAGE = ROOT / "docs" / "measured-box.md"
IMAGES = ROOT / "docs" / "images"
BLOCK = 2  # pixels a side, over which Delta E is taken

Array = npt.NDArray[Any]


def markdown(head: list[str], rows: list[list[Any]]) -> str:
    """A table."""
    lines = [head, ["---"] * len(head), *rows]
    return "\n".join("| " + " | ".join(str(x) for x in line) + " |" for line in lines)


def figure(render: veriray.Render, found: box.Difference, path: Path) -> None:
    """Truth, RGB render and Delta E above; relative errors of X, Y and Z below."""
    from matplotlib import pyplot as plt

    exact = box.truth()["xyz"].astype(np.float64)
    ours = render.image @ np.linalg.inv(spectral.to_rgb()).T
    _, columns = plt.subplots(2, 3, figsize=(9.6, 6.6), layout="constrained")
    shown = {"spectra, by the reference": exact @ spectral.to_rgb().T,
             "RGB, by veriray": render.image}  # fmt: skip
    for axes, (name, image) in zip(columns[0], shown.items(), strict=False):
        axes.imshow(to_srgb8(np.maximum(image, 0) / found.luminance))
        axes.set_title(name)
    top = float(np.ceil(np.nanpercentile(found.cells, 99.8) * 2) / 2)
    view = columns[0][2].imshow(found.cells, cmap="inferno", vmin=0, vmax=top)
    columns[0][2].set_title("CIE Delta E 2000")
    plt.colorbar(view, ax=columns[0][2])
    hidden = np.isnan(found.cells)
    for axes, name, k in zip(columns[1], "XYZ", range(3), strict=True):
        base = spectral.blocks(exact, BLOCK)[..., k]
        change = 100 * (spectral.blocks(ours, BLOCK)[..., k] / np.where(base > 0, base, 1) - 1)
        change[hidden] = np.nan
        limit = 5 * np.ceil(np.nanpercentile(np.abs(change), 98) / 5)
        view = axes.imshow(change, cmap="RdBu_r", vmin=-limit, vmax=limit)
        axes.set_title(f"{name}, error in %")
        plt.colorbar(view, ax=axes)
    for axes in columns.ravel():
        axes.set_xticks([])
        axes.set_yticks([])
    plt.savefig(path, dpi=110)
    plt.close()


def spectra(path: Path) -> None:
    """The measured spectra, and what is left after two reflections."""
    from matplotlib import pyplot as plt

    fine, lamp = spectral.reflectance(spectral.FINE), spectral.emission(spectral.FINE)
    colours = {"white": "0.6", "green": "tab:green", "red": "tab:red"}
    _, (left, right) = plt.subplots(1, 2, figsize=(9.6, 3.4), layout="constrained")
    for paint, colour in colours.items():
        left.plot(spectral.FINE, fine[paint], color=colour, label=paint)
    left.plot(spectral.FINE, lamp / lamp.max(), "k--", label="lamp, over its maximum")
    left.set(xlabel="nm", title="reflectance", ylim=(0, 1.02))
    left.legend(loc=(0.02, 0.44), fontsize="small")
    shown = {"red, white": "tab:red", "green, white": "tab:green", "red, red": "darkred",
             "red, green": "tab:orange"}  # fmt: skip
    for name, colour in shown.items():
        a, b = name.split(", ")
        right.plot(spectral.FINE, fine[a] * fine[b] * lamp, color=colour, label=name)
    right.set(xlabel="nm", title="light of the lamp after two reflections", ylim=(0, None))
    right.legend()
    plt.savefig(path, dpi=110)
    plt.close()


def numbers(found: box.Difference, with_model: bool) -> str:
    """Delta E by the parts of the box."""
    head = ["part", "Y", "X %", "Y %", "Z %", "Delta E", "its error"]
    rows, model = [], spectral.expected(found.luminance)
    for name, (a, b, e, noise) in found.rows.items():
        rows.append([name, f"{a[1]:.4f}", *(f"{x:+.2f}" for x in 100 * (b / a - 1)), f"{e:.2f}",
                     f"{noise:.2f}"])  # fmt: skip
        if with_model:
            k = spectral.WALLS.index(name) if name in spectral.WALLS else None
            rows[-1].append("" if k is None else f"{model['all'][k]:.2f}")
    return markdown(head + ["five plain walls"] * with_model, rows)


def renderer(renders: dict[str, veriray.Render]) -> str:
    """Our means against the reference's, at the same wavelengths and colours."""
    stored, rows = box.truth(), []
    for name, r in renders.items():
        theirs = stored["bands"][box.BANDS[name]].astype(np.float64).mean(axis=(1, 2))
        assert r.batch_means is not None
        ours = r.batch_means.mean(axis=(1, 2))
        a, b = ours.mean(axis=0), theirs.mean(axis=0)
        error = np.hypot(*(x.std(axis=0, ddof=1) / len(x) ** 0.5 for x in (ours, theirs)))
        for k, channel in enumerate("RGB" if name == "RGB" else name[:-3].split(", ")):
            nm = "" if name == "RGB" else " nm"
            off = f"{100 * (a[k] / b[k] - 1):+.3f} ± {100 * error[k] / b[k]:.3f}"
            rows.append([channel + nm, f"{b[k]:.6f}", f"{a[k]:.6f}", off])
    return markdown(["channel", "reference", "veriray", "difference %"], rows)


def products() -> str:
    """What RGB makes of light after two and three reflections."""
    fine, (paints, rgb) = spectral.reflectance(spectral.FINE), spectral.colours()
    lamp = spectral.emission(spectral.FINE)
    rows = []
    for name in ("white white", "white red", "white green", "red red", "red green", "green green",
                 "white red green"):  # fmt: skip
        spectrum, colour = lamp, rgb
        for paint in name.split():
            spectrum, colour = spectrum * fine[paint], colour * paints[paint]
        a, b = spectral.xyz(spectrum), np.linalg.inv(spectral.to_rgb()) @ colour
        rows.append([name.replace(" ", ", "), f"{a[1] / spectral.xyz(lamp)[1]:.3f}",
                     *(f"{x:+.1f}" for x in 100 * (b / a - 1))])  # fmt: skip
    return markdown(["reflections", "Y left", "X %", "Y %", "Z %"], rows)


def overall(found: dict[str, box.Difference]) -> str:
    """Delta E over the picture for each choice of paints."""
    names = list(next(iter(found.values())).numbers)
    rows = [[name, *(f"{f.numbers[key]:.2f}" for f in found.values())]
            for key, name in ((k, k) for k in names)]  # fmt: skip
    return markdown([f"Delta E of {BLOCK} x {BLOCK} pixels", *found], rows)


def exposures(render: veriray.Render, found: box.Difference) -> str:
    """How the choice of white changes Delta E."""
    exact = spectral.blocks(box.truth()["xyz"], BLOCK)
    ours = spectral.blocks(render.image @ np.linalg.inv(spectral.to_rgb()).T, BLOCK)
    rows, seen = [], np.isfinite(found.cells)
    for factor in (0.5, 1.0, 2.0, 4.0):
        e = spectral.delta_e(ours, exact, found.luminance * factor)[seen]
        rows.append([f"{found.luminance * factor:.3f}", f"{e.mean():.2f}",
                     f"{np.percentile(e, 95):.2f}", f"{e.max():.2f}"])  # fmt: skip
    return markdown(["Y of white", "mean", "95th percentile", "maximum"], rows)


def main() -> None:
    """Renders, writes pictures and page."""
    matplotlib.use("Agg")
    parse = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parse.add_argument("--device", default="auto")
    parse.add_argument("--spp", type=int, default=16384, help="multiple of 64")
    options = parse.parse_args()
    facts = box.truth()["facts"]
    settings: dict[str, Any] = {
        "spp": options.spp, "width": facts["size"], "height": facts["size"], "batches": 64,
        "device": options.device, "seed": 2016,
    }  # fmt: skip
    usual = spectral.repaint(cornell_box(), *spectral.colours(lit=False))
    triples = box.truth()["wavelengths"]
    scenes = {"RGB": cornell_box(), "usual": usual}
    scenes |= {n: box.at_wavelengths(triples[k]) for n, k in box.BANDS.items() if n != "RGB"}
    renders = {name: veriray.render(scene, **settings) for name, scene in scenes.items()}
    found = {"paints as the lamp's light has them": box.difference(renders["RGB"], BLOCK),
             "paints under equal energy": box.difference(renders["usual"], BLOCK)}  # fmt: skip
    ours, other = found.values()
    figure(renders["RGB"], ours, IMAGES / "measured_box.png")
    figure(renders["usual"], other, IMAGES / "measured_box_usual.png")
    spectra(IMAGES / "measured_box_spectra.png")
    texts = {
        "settings": f"Reference: {facts['paths']:.2g} paths, {facts['spp']:,} samples per pixel "
        f"and render, {facts['size']} x {facts['size']} pixels, reference {facts['reference']}. "
        f"Ours: {options.spp:,} samples per pixel. Y of white is {ours.luminance:.3f}.",
        "products": products(), "overall": overall(found), "parts": numbers(ours, True),
        "usual": numbers(other, False), "renderer": renderer({n: renders[n] for n in box.BANDS}),
        "exposures": exposures(renders["RGB"], ours),
    }  # fmt: skip
    page = PAGE.read_text(encoding="utf-8")
    for name, text in texts.items():
        mark = rf"(<!-- {name} -->\n).*?(<!-- end -->)"
        page, count = re.subn(mark, lambda m, t=text: f"{m[1]}\n{t}\n\n{m[2]}", page, flags=re.S)
        if count != 1:
            raise SystemExit(f"{PAGE}: {count} marks for {name}")
        print(f"\n{name}\n{text}")
    PAGE.write_text(page, encoding="utf-8")


if __name__ == "__main__":
    main()
