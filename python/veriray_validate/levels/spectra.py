"""Level 1: colours of spectra in scene files, against colour-science's observer at 1 nm.

The renderer's own tables have steps of 5 nm and its sums 1000 wavelengths, as Mitsuba's; so colours
agree within a few in a thousand, of a scene's largest channel.
"""

from __future__ import annotations

from typing import Any

import numpy as np
import numpy.typing as npt
from scipy.integrate import trapezoid

import veriray
from veriray_validate.trial import Trial, case

Array = npt.NDArray[np.float64]

#: Largest difference, as a share of the largest channel. Measured: 1.6e-3.
SHARE = 2.5e-3
_MATRIX = np.linalg.inv(
    [[0.4123908, 0.3575843, 0.1804808], [0.2126390, 0.7151687, 0.0721923],
     [0.0193308, 0.1191948, 0.9505322]]
)  # fmt: skip
_CAMERA = {"type": "perspective", "fov": 40.0}


def expected(spectrum: Any) -> Array:
    """Linear RGB of a spectrum, a function of the wavelength in nm, at Y = 1 for an even one."""
    import colour

    observer = colour.MSDS_CMFS["CIE 1931 2 Degree Standard Observer"]
    w, functions = observer.wavelengths, observer.values
    xyz = trapezoid(functions.T * spectrum(w), w) / trapezoid(functions[:, 1], w)
    rgb: Array = _MATRIX @ xyz
    return rgb


def sky(radiance: Any) -> Array:
    """Linear RGB of a sky in a scene."""
    scene = {"type": "scene", "camera": _CAMERA, "sky": {"type": "constant", "radiance": radiance}}
    return np.asarray(veriray.load_dict(scene).environment, np.float64)


def near(t: Trial, found: Array, exact: Array, what: str) -> None:
    """Checks a colour."""
    exact = np.maximum(exact, 0.0)
    t.check(np.abs(found - exact).max() <= SHARE * exact.max(), f"{what}: {found}, not {exact}")


@case(1, once=True, each={"kelvin": [1500.0, 2855.54, 5000.0, 6504.0, 20000.0]})
def blackbody(t: Trial, kelvin: float) -> None:
    """A blackbody's colour and brightness are Planck's law under the CIE observer."""

    def planck(w: Array) -> Array:
        metres = w * 1e-9
        power: Array = np.expm1(6.62607015e-34 * 299792458.0 / (1.380649e-23 * metres * kelvin))
        return 2e-9 * 6.62607015e-34 * 299792458.0**2 / (metres**5 * power)

    near(t, sky({"type": "blackbody", "temperature": kelvin}), expected(planck), f"{kelvin:g} K")


@case(1, once=True)
def daylight_is_white(t: Trial) -> None:
    """A lamp with the spectrum of D65 is as red as it is green and blue; an even one is not."""
    import colour

    table = colour.SDS_ILLUMINANTS["D65"]
    inside = (table.wavelengths >= 360) & (table.wavelengths <= 780)
    pairs = np.column_stack([table.wavelengths[inside], table.values[inside]])
    lamp = sky({"type": "spectrum", "value": pairs.tolist()})
    t.check(np.ptp(lamp) <= SHARE * lamp.max(), f"D65: {lamp}")
    even = sky({"type": "spectrum", "value": [(360.0, 1.0), (830.0, 1.0)]})
    near(t, even, expected(np.ones_like), "an even spectrum")


@case(1, once=True)
def reflectances_under_daylight(t: Trial) -> None:
    """A reflectance's colour is that of the light of D65 that it reflects; white is white."""
    import colour

    table = colour.SDS_ILLUMINANTS["D65"]
    for wavelengths, values in (
        ((360.0, 830.0), (0.8, 0.8)),
        ((400.0, 500.0, 700.0), (0.1, 0.3, 0.9)),
        ((400.0, 480.0, 560.0, 700.0), (0.05, 0.1, 0.5, 0.1)),
    ):
        scene = {
            "type": "scene",
            "camera": _CAMERA,
            "ball": {
                "type": "sphere",
                "bsdf": {
                    "type": "diffuse",
                    "reflectance": {
                        "type": "spectrum",
                        "value": list(zip(wavelengths, values, strict=True)),
                    },
                },
                "emitter": {"type": "area"},
            },
        }
        found = np.asarray(veriray.load_dict(scene).reflectance[-1], np.float64)

        def light(w: Array) -> Array:
            return np.interp(w, table.wavelengths, table.values)

        def reflected(w: Array, ends: Any = wavelengths, heights: Any = values) -> Array:
            return light(w) * np.interp(w, ends, heights, left=0.0, right=0.0)

        near(t, found, expected(reflected) / (expected(light) @ [0.2126390, 0.7151687, 0.0721923]),
             f"{values}")  # fmt: skip
