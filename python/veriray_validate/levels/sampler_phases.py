"""Level 2: directions that phase functions by tables, of Rayleigh and blended scatter into.

Drawn directions are mapped to the unit square by the share of light that turns less, and by the
azimuth, and tested as in `samplers`.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
import numpy.typing as npt

from veriray_validate.dicts import NULL, Dict, cuboid, scene, sky, view
from veriray_validate.levels.samplers import N, hooked, random_numbers, replayed, uniform
from veriray_validate.oracles import azimuth, normalised, one_minus_cos, phase_inverse
from veriray_validate.trial import Trial, case

Array = npt.NDArray[Any]
#: The share of light that turns less, of directions about +z.
Share = Callable[[Array], Array]

STEEP = (4.0, 0.0, 0.0, 1.0, 0.25, 9.0)  # with a piece that scatters nothing
EVEN = (1.0, 3.0)


def hg(g: float) -> Share:
    """Henyey and Greenstein's."""
    return lambda p: phase_inverse(p, g)[0] if g >= 0 else 1 - phase_inverse(p, g)[0]


def rayleigh(p: Array) -> Array:
    """Rayleigh's: the integral of 3/8 (1 + c^2) from c to 1."""
    c = 1 - one_minus_cos(p)
    return np.asarray((4 - 3 * c - c**3) / 8)


def table(values: tuple[float, ...]) -> Share:
    """That of a table: trapezoids, the last one cut."""
    heights = np.array(values)[::-1]  # from straight on
    step = 2 / (len(heights) - 1)
    before = np.concatenate([[0.0], np.cumsum((heights[1:] + heights[:-1]) * step / 2)])

    def share(p: Array) -> Array:
        less = np.clip(one_minus_cos(p), 0, 2)
        k = np.minimum((less / step).astype(np.int64), len(heights) - 2)
        s = less - k * step
        cut = s * (heights[k] + (heights[k + 1] - heights[k]) * s / step / 2)
        return np.asarray((before[k] + cut) / before[-1])

    return share


def blend(weight: float, a: Share, b: Share) -> Share:
    """Shares add up."""
    return lambda p: (1 - weight) * a(p) + weight * b(p)


def _plugin(kind: str, **more: Any) -> Dict:
    return {"type": kind, **more}


def _tabphase(values: tuple[float, ...]) -> Dict:
    return _plugin("tabphase", values=", ".join(map(str, values)))


def _blendphase(weight: float, a: Dict, b: Dict) -> Dict:
    return _plugin("blendphase", weight=weight, a=a, b=b)


KINDS: dict[str, tuple[Dict, Share]] = {
    "rayleigh": (_plugin("rayleigh"), rayleigh),
    "steep table": (_tabphase(STEEP), table(STEEP)),
    "table of two": (_tabphase(EVEN), table(EVEN)),
    "g = .999 and rayleigh": (
        _blendphase(0.5, _plugin("hg", g=0.999), _plugin("rayleigh")),
        blend(0.5, hg(0.999), rayleigh),
    ),
    "g = -.999 and isotropic": (
        _blendphase(0.75, _plugin("isotropic"), _plugin("hg", g=-0.999)),
        blend(0.75, hg(0.0), hg(-0.999)),
    ),
    "nested": (
        _blendphase(0.375, _blendphase(0.25, _tabphase(STEEP), _plugin("hg", g=0.9)),
                    _blendphase(0.5, _tabphase(EVEN), _plugin("rayleigh"))),
        blend(0.375, blend(0.25, table(STEEP), hg(0.9)), blend(0.5, table(EVEN), rayleigh)),
    ),
}  # fmt: skip


@case(2)
def rayleigh_scattering(t: Trial) -> None:
    """Rayleigh's phase function about +z, by its cumulative distribution.

    10^5 directions: sees 1 % in scale, 4 % in tilt, in a full run half of that.
    """
    u, v = random_numbers(t, N * t.effort)[2:]
    wi = hooked(t, "rayleigh", 0, 0, 1, u, v)[:, :3]
    uniform(t, np.clip(rayleigh(wi), 0, 1), azimuth(wi), "directions")


@case(2, each={"kind": KINDS})
def phases_of_paths(t: Trial, kind: str) -> None:
    """Directions of whole paths in a thick medium, as the renderer takes them.

    Replayed on the CPU, 10^4 paths that all scatter, by the cumulative distribution of the sum:
    sees 3 % in scale, 12 % in tilt.
    """
    phase, share = KINDS[kind]
    fog = {"type": "homogeneous", "sigma_t": 1000.0, "albedo": 0.5, "phase": phase}
    body = cuboid([-1, -1, -1], [1, 1, 1], NULL, interior=fog)
    seen = scene(view([0, 0, 0], [0.3, -0.5, 1.0], medium=fog), body, sky(1), max_depth=2)
    n = 10_000 * t.effort
    paths = replayed(t, seen, n, 2)
    t.check(all(p[0]["event"] == "scattered" and p[0]["primitive"] < 0 for p in paths), "scattered")
    d, out = (normalised(np.array([p[k]["direction"] for p in paths])) for k in (0, 1))
    a = normalised(np.cross(d, [[0.0, 1.0, 0.0]]))
    wi = np.stack([(out * axis).sum(1) for axis in (a, np.cross(d, a), d)], axis=1)
    uniform(t, np.clip(share(wi), 0, 1), azimuth(wi), "directions")
