"""Metals by name: eta and k as linear RGB, of public data converted as Mitsuba converts its own."""

from __future__ import annotations

from ..errors import SceneError
from .colour_tables import METALS
from .node import allowed, shorten

RGB = tuple[float, float, float]
#: Those that no page with n and k over the visible range resembles: RGB of Mitsuba 3.9.1's own data
#: (`data/ior` of its package, BSD-3-Clause; luxpop.com). Zeros are where the data do not reach, or
#: negative numbers, which Mitsuba clamps.
MITSUBAS: dict[str, tuple[RGB, RGB]] = {
    "AlAs": ((3.605296, 3.232938, 2.216319), (0.000679, 0.0, 0.007513)),
    "AlSb": ((0.0, 4.139375, 4.669254), (0.0, 0.094009, 1.30057)),
    "Cu2O": ((3.551773, 2.94987, 2.751875), (0.114207, 0.193897, 0.606134)),
    "CuO": ((3.247541, 2.447805, 2.21022), (0.52109, 0.570031, 0.722179)),
    "HgTe": ((4.77904, 3.231196, 2.659901), (1.631613, 1.58081, 1.729287)),
    "Se": ((4.058311, 2.842935, 2.820853), (0.75405, 0.638444, 0.521808)),
    "Se-e": ((5.722849, 4.165736, 4.081338), (0.871136, 1.105157, 1.56532)),
    "SiC": ((3.172342, 2.525972, 2.479371), (1e-06, 0.0, 1e-05)),
    "SnTe": ((4.52425, 1.981645, 1.281591), (0.0, 0.0, 0.0)),
    "Ta": ((2.062721, 2.392939, 2.627929), (2.40836, 1.741486, 1.947028)),
    "ThF4": ((1.830714, 1.442229, 1.387648), (0.0, 0.0, 0.0)),
    "TiO2": ((3.45661, 2.801736, 2.905175), (0.000105, 0.0, 0.000653)),
    "TiO2-e": ((3.106565, 2.513168, 2.582444), (3e-05, 0.0, 0.000183)),
}
#: Mitsuba has these with this suffix alone.
_PALIK_ONLY = ("Na", "Ni", "V")
_NO_PALIK = ("Ag", "Al", "Au", "Cr", "W", "a-C")
_RGB = {**{name: (eta, k) for name, (eta, k, _) in METALS.items()}, **MITSUBAS}
#: Every name -> eta and k.
NAMES = {
    **{name: rgb for name, rgb in _RGB.items() if name not in _PALIK_ONLY},
    **{f"{name}_palik": rgb for name, rgb in _RGB.items() if name not in _NO_PALIK},
}


def metal(name: str, label: str, where: str) -> tuple[RGB, RGB]:
    """Both eta and k of a metal in vacuum; "none" is an ideal mirror. Raises SceneError."""
    if name.lower() == "none":
        return (0.0,) * 3, (1.0,) * 3
    if name not in NAMES:
        raise SceneError(f"{label} = {shorten(name)}: unknown{allowed(name, NAMES)}", where)
    return NAMES[name]
