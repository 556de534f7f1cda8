"""Metals by name: eta and k as linear RGB, of public data converted as Mitsuba converts its own."""

from __future__ import annotations

from ..errors import SceneError
from .colour_tables import METALS
from .node import allowed, shorten

RGB = tuple[float, float, float]
#: Mitsuba has these with this suffix alone.
_PALIK_ONLY = ("Na", "Ni", "V")
_NO_PALIK = ("Ag", "Al", "Au", "Cr", "W", "a-C")
_PALIK = {f"{name}_palik": name for name in METALS if name not in _NO_PALIK}
#: Names of Mitsuba's that have no page with n and k over the visible range that resembles it.
MISSING = (
    "AlAs", "AlSb", "Cu2O", "CuO", "HgTe", "Se", "Se-e", "SiC", "SnTe", "Ta", "ThF4", "TiO2",
    "TiO2-e",
)  # fmt: skip
#: Every name -> its row in METALS.
NAMES = {**{name: name for name in METALS if name not in _PALIK_ONLY}, **_PALIK}


def metal(name: str, label: str, where: str) -> tuple[RGB, RGB]:
    """Both eta and k of a metal in vacuum; "none" is an ideal mirror. Raises SceneError."""
    if name.lower() == "none":
        return (0.0,) * 3, (1.0,) * 3
    if name not in NAMES:
        lacks = name.removesuffix("_palik") in MISSING
        why = "there is no public data for this metal; give eta and k" if lacks else "unknown"
        raise SceneError(f"{label} = {shorten(name)}: {why}{allowed(name, NAMES)}", where)
    eta, k, _ = METALS[NAMES[name]]
    return eta, k
