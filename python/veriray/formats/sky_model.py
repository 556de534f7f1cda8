"""Radiance of a clear sky and of the sun, in linear RGB, and where the sun stands.

The model is L. Hosek and A. Wilkie's ("An Analytic Model for Full Spectral Sky-Dome Radiance",
SIGGRAPH 2012; "Adding a Solar-Radiance Function to the Hosek-Wilkie Skylight Model", IEEE CG&A
2013), as Mitsuba 3 uses it; its numbers are in sky_model.npz (benchmarks/make_sky_tables.py). The
sun's place follows M. Blanco-Muriel et al., "Computing the Solar Vector", Solar Energy 70, 2001.

Sums, products and roots alone, all in float64, so the values are the same on every machine; exp and
angles are computed here. Directions have z upwards.
"""

from __future__ import annotations

import math
from functools import lru_cache
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

from .colour_tables import X, Y, Z

Array = npt.NDArray[Any]

#: Diameter of the sun, degrees.
APERTURE = 0.5358
_Y_NORM = 106.7502593994140625  # of formats/spectra.py
_WAVELENGTHS = np.arange(320.0, 721.0, 40.0)
#: Mitsuba's weight of the mean over these wavelengths.
_SUN_WEIGHT = 467.069280386
_RGB = np.array(
    [
        [3.240479, -1.537150, -0.498535],
        [-0.969256, 1.875991, 0.041556],
        [0.055648, -0.204043, 1.057311],
    ]
)
_LN2_HIGH, _LN2_LOW = 0.6931471803691238, 1.9082149292705877e-10
_SEGMENTS = 45  # of the sun's functions of the elevation


@lru_cache(maxsize=1)
def _tables() -> dict[str, Array]:
    """Sky (turbidity, albedo, elevation, colour, 9), level (likewise, without the last), sun
    (turbidity, segment, wavelength, power), limb (wavelength, power)."""
    with np.load(Path(__file__).with_name("sky_model.npz")) as file:
        return {name: file[name].astype(np.float64) for name in file.files}


def exp(x: Array) -> Array:
    """e^x within 4e-16, for x from -700 to 700."""
    k = np.rint(x * 1.4426950408889634)
    r = (x - k * _LN2_HIGH) - k * _LN2_LOW
    total = np.ones_like(r)
    for n in range(13, 0, -1):
        total = 1.0 + total * r / n
    power: Array = np.ldexp(total, k.astype(np.int32))
    return power


def angle(chord: Array) -> Array:
    """The angle between unit vectors whose difference has this length: 2 asin(chord / 2).

    Within 1e-14, by the sine of an eighth of it.
    """
    sine = chord / 2
    for _ in range(2):
        sine = sine / np.sqrt(2 * (1 + np.sqrt(np.maximum(1 - sine * sine, 0.0))))
    square, total = sine * sine, np.ones_like(sine)
    for n in range(33, 0, -2):  # of the series of asin
        total = 1.0 + total * square * (n * n) / ((n + 1) * (n + 2))
    return 8 * sine * total


def _between(table: Array, turbidity: float) -> Array:
    """Rows of a table by turbidity, linear in between."""
    i = min(int(turbidity) - 1, len(table) - 2)
    part = turbidity - 1 - i
    mixed: Array = (1 - part) * table[i] + part * table[i + 1]
    return mixed


def _elevation(sun: Array) -> float:
    """Of a direction, in radians."""
    across = math.sqrt(float(sun[0]) * float(sun[0]) + float(sun[1]) * float(sun[1]))
    up = float(sun[2])
    lift = math.sqrt(across * across + (1 - up) * (1 - up))
    return math.pi / 2 - float(angle(np.array(lift)))


def _cube_root(x: float) -> float:
    """By Newton's method from above."""
    if x <= 0:
        return 0.0
    root = 1.0
    while (lower := root - (root - x / (root * root)) / 3) < root:
        root = lower
    return root


class Sky:
    """The sky's radiance for the sun in a direction (3,) above the horizon.

    turbidity: from 1 to 10; albedo: of the ground, (3,).
    """

    def __init__(self, turbidity: float, albedo: tuple[float, ...], sun: Array) -> None:
        x = _cube_root(_elevation(sun) / (math.pi / 2))
        bend = [1.0, 5.0, 10.0, 10.0, 5.0, 1.0]
        for k in range(6):
            for power, factor in ((k, x), (5 - k, 1 - x)):
                for _ in range(power):
                    bend[k] *= factor
        ground = np.array(albedo)

        def fitted(table: Array) -> Array:
            black, white = _between(table, turbidity)
            share = ground.reshape(3, *[1] * (black.ndim - 2))
            points = (1 - share) * black + share * white
            total = np.zeros(points.shape[1:])
            for k in range(6):
                total = total + bend[k] * points[k]
            return total

        self.sun = sun
        self.shape = fitted(_tables()["sky"])
        self.level = fitted(_tables()["level"]) / _Y_NORM

    def radiance(self, directions: Array) -> Array:
        """Of directions (..., 3) not below the horizon."""
        up = np.maximum(directions[..., 2], 0.0)
        chord = np.zeros(up.shape)
        for k in range(3):
            off = directions[..., k] - self.sun[k]
            chord = chord + off * off
        gamma, cosine = angle(np.minimum(np.sqrt(chord), 2.0)), 1 - chord / 2
        root, square = np.sqrt(up), cosine * cosine
        out = np.empty(directions.shape)
        for k, (a, b, c, d, e, f, g, h, i) in enumerate(self.shape.tolist()):
            near = 1 + i * i - 2 * i * cosine
            halo = (1 + square) / (near * np.sqrt(near))
            level = 1 + a * exp(b / (up + 0.01))
            out[..., k] = level * (c + d * exp(e * gamma) + f * square + g * halo + h * root)
        shone: Array = np.maximum(out * self.level, 0.0)
        return shone


def sun_radiance(turbidity: float, sun: Array) -> Array:
    """The mean radiance (3,) of the sun's disc in a direction above the horizon; 0 for colours
    outside of RGB."""
    elevation = _elevation(sun)
    segment = min(int(_cube_root(2 * elevation / math.pi) * _SEGMENTS), _SEGMENTS - 1)
    x = elevation - (segment / _SEGMENTS) ** 3 * math.pi / 2
    powers = _between(_tables()["sun"], turbidity)[segment]
    spectrum = ((powers[:, 3] * x + powers[:, 2]) * x + powers[:, 1]) * x + powers[:, 0]
    limb = _tables()["limb"]  # over the disc, of which powers of the cosine have the mean 2/(k + 2)
    spectrum = spectrum * sum(limb[:, k] * (2 / (k + 2)) for k in range(limb.shape[1]))
    wavelengths = 360 + 5.0 * np.arange(len(X))
    out = [0.0, 0.0, 0.0]
    for row, table in zip(_RGB.T, (X, Y, Z), strict=True):
        curve = np.interp(_WAVELENGTHS, wavelengths, table, left=0, right=0)
        mean = math.fsum((curve * spectrum).tolist()) / len(_WAVELENGTHS)
        for k in range(3):
            out[k] += float(row[k]) * mean * _SUN_WEIGHT / _Y_NORM
    shone: Array = np.maximum(np.array(out), 0.0)
    return shone


def sun_direction(when: dict[str, float], latitude: float, longitude: float) -> Array:
    """Where the sun stands, x southwards, y westwards, z upwards.

    when: year, month, day, hour, minute, second and timezone (hours ahead of universal time);
    degrees, north and east positive. Rounded to 9 decimals, because sines differ in the last bit
    between C libraries.
    """
    year, month, day = (int(when[name]) for name in ("year", "month", "day"))
    hours = when["hour"] - when["timezone"] + (when["minute"] + when["second"] / 60) / 60
    early = -1 if month < 3 else 0
    julian = (1461 * (year + 4800 + early)) // 4 + (367 * (month - 2 - 12 * early)) // 12
    julian += day - (3 * ((year + 4900 + early) // 100)) // 4 - 32075
    days = julian - 0.5 + hours / 24 - 2451545
    node = 2.1429 - 0.0010394594 * days
    anomaly = 6.2400600 + 0.0172019699 * days
    ecliptic = 4.8950630 + 0.017202791698 * days + 0.03341607 * math.sin(anomaly)
    ecliptic += 0.00034894 * math.sin(2 * anomaly) - 0.0001134 - 0.0000203 * math.sin(node)
    tilt = 0.4090928 - 6.2140e-9 * days + 0.0000396 * math.cos(node)
    ascension = math.atan2(math.cos(tilt) * math.sin(ecliptic), math.cos(ecliptic))
    decline = math.asin(math.sin(tilt) * math.sin(ecliptic))
    sidereal = 15 * (6.6974243242 + 0.0657098283 * days + hours) + longitude
    turn, north = math.radians(sidereal) - ascension, math.radians(latitude)
    cosine = math.cos(north) * math.cos(turn) * math.cos(decline)
    zenith = math.acos(max(-1.0, min(1.0, cosine + math.sin(decline) * math.sin(north))))
    azimuth = math.atan2(
        -math.sin(turn),
        math.tan(decline) * math.cos(north) - math.sin(north) * math.cos(turn),
    )
    zenith += 6371.01 / 149597890 * math.sin(zenith)  # seen from the earth's surface
    across = math.sin(zenith)
    place = (-across * math.cos(azimuth), -across * math.sin(azimuth), math.cos(zenith))
    return np.array([round(x, 9) for x in place])
