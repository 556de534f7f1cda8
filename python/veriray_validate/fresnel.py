"""Fresnel's equations for closed forms: by real amplitudes, and by complex ones as a second way."""

from __future__ import annotations

from typing import Any

import numpy as np
import numpy.typing as npt

Array = npt.NDArray[Any]


def fresnel(cosine: Any, eta: float) -> Array:
    """Unpolarised reflectance of a dielectric; eta: index behind over index in front."""
    c = np.abs(np.asarray(cosine, np.float64))
    inside = 1 - (1 - c * c) / eta**2
    c = np.where(inside > 0, c, 1.0)
    t = np.sqrt(np.maximum(inside, 0))
    r = ((c - eta * t) / (c + eta * t)) ** 2 + ((eta * c - t) / (eta * c + t)) ** 2
    return np.where(inside > 0, r / 2, 1.0)


def fresnel_conductor(cosine: Any, eta: complex) -> Any:
    """The same for a complex index n + ik."""
    t = np.sqrt(1 - (1 - cosine**2) / eta**2)
    s = abs((cosine - eta * t) / (cosine + eta * t)) ** 2
    p = abs((eta * cosine - t) / (eta * cosine + t)) ** 2
    return (s + p) / 2


def external_reflectance(eta: float) -> float:
    """Hemispherical reflectance for diffuse light from outside."""
    x, w = np.polynomial.legendre.leggauss(200)
    c = (x + 1) / 2
    return float((w * fresnel(c, eta) * c).sum())


def internal_reflectance(eta: float) -> float:
    """The same from inside: 1 - (1 - F_e) / eta^2."""
    return 1 - (1 - external_reflectance(eta)) / eta**2
