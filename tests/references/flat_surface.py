"""A flat surface for the scripts that record values of Mitsuba's bsdfs."""

from __future__ import annotations

from typing import Any

import mitsuba as mi
import numpy as np
import numpy.typing as npt


def interaction() -> mi.SurfaceInteraction3f:
    """A point of a surface whose normal is z; sets Mitsuba's variant to scalar_rgb."""
    mi.set_variant("scalar_rgb")
    si = mi.SurfaceInteraction3f()
    si.n = mi.Normal3f(0, 0, 1)
    si.sh_frame = mi.Frame3f(mi.Vector3f(0, 0, 1))
    return si


def unit(v: npt.NDArray[Any]) -> list[list[float]]:
    """Rows of v (n, 3) at unit length, to six digits."""
    rows: list[list[float]] = (v / np.linalg.norm(v, axis=1)[:, None]).round(6).tolist()
    return rows


def values(bsdf: mi.BSDF, si: mi.SurfaceInteraction3f, wi: list[list[float]]) -> list[list[float]]:
    """f cos of directions wi, in red, green and blue, to seven digits."""
    context = mi.BSDFContext()
    return [[float(f"{x:.7g}") for x in bsdf.eval(context, si, mi.Vector3f(*w))] for w in wi]
