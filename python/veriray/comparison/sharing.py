"""Samples that count in several pixels: how far a filter reaches, and what that does to errors."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

import numpy as np

if TYPE_CHECKING:
    from veriray.camera import Film

#: Pixels that a filter reaches at most where samples are shared (kMostRim in cpp/film/filter.h).
MOST_SHARED = 16.5


def reach(film: Film) -> float:
    """Pixels from a pixel's centre to where its filter ends; 0.5 of a box."""
    size, _ = film.filter_parameters
    return {"gaussian": 4 * size, "mitchell": 2.0}.get(film.filter, size)


def shared(film: Film) -> float:
    """Variance of a mean of pixels, at most, over the one that independent pixels give.

    1, or where samples count in several pixels (cpp/film/shared.h) one over what a filter f of
    integral 1 leaves of noise that does not depend on the place in a pixel, in both dimensions:
    (integral of f^2)^2. A sample's weights in all pixels add up to 1, so means of many pixels have
    all of that noise. Differences between pixels make the pixels' errors larger, not the mean's.
    """
    b, c = film.filter_parameters
    end = reach(film)
    if not 0.5 < end <= MOST_SHARED:
        return 1.0
    x = (np.arange(2**14) + 0.5) * (end / 2**14)
    if film.filter == "tent":
        f = 1 - x / b
    elif film.filter == "gaussian":
        f = np.exp(-((x / b) ** 2) / 2) - math.exp(-8)
    elif film.filter == "mitchell":
        near = (12 - 9 * b - 6 * c) * x**3 + (-18 + 12 * b + 6 * c) * x**2 + 6 - 2 * b
        far = (((-b - 6 * c) * x + 6 * b + 30 * c) * x - 12 * b - 48 * c) * x + 8 * b + 24 * c
        f = np.where(x < 1, near, far)
    else:
        f = np.sinc(x) * np.sinc(x / b)
    square = (f**2).mean() / (2 * end)
    if square**2 >= 0.8 * np.abs(f).mean() ** 4:  # samples are then drawn for each pixel alone
        return 1.0
    return float(f.mean() ** 4 / square**2)
