"""Rays of the camera and samples of the reconstruction filter."""

from __future__ import annotations

import math

import numpy as np

from reference.scene import Camera, Film


def camera_rays(
    camera: Camera, film: Film, rng: np.random.Generator, pixel: np.ndarray
) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray | float]:
    """World origin and unit direction (3, n), distance of the far plane (n,), weight of the sample.

    A thin lens is a disk of the aperture's radius at z = 0 on which points are uniform; all rays of
    a film point meet in the plane z = focus.
    """
    n = len(pixel)
    dx, dy = filter_offsets(rng, film, n), filter_offsets(rng, film, n)
    x = (pixel % film.width + 0.5 + dx) / film.width
    y = (pixel // film.width + 0.5 + dy) / film.height
    weight = filter_weights(film, dx) * filter_weights(film, dy)
    if camera.parallel:
        place = [1 - 2 * x, (1 - 2 * y) * film.height / film.width, np.full(n, camera.near)]
        origin = camera.to_world[:3, :3] @ np.stack(place) + camera.to_world[:3, 3, None]
        axis = camera.to_world[:3, 2, None] / np.linalg.norm(camera.to_world[:3, 2])
        return origin, np.tile(axis, n), np.full(n, camera.far - camera.near), weight
    tan_x, tan_y = camera.tangents(film.width, film.height)
    local = np.stack(
        [
            (1 - 2 * (x + camera.principal[0])) * tan_x,
            (1 - 2 * (y + camera.principal[1])) * tan_y,
            np.ones(n),
        ]
    )
    origin = camera.to_world[:3, 3, None]
    if camera.aperture:
        r, phi = camera.aperture * np.sqrt(rng.random(n)), 2 * math.pi * rng.random(n)
        lens = np.stack([r * np.cos(phi), r * np.sin(phi), np.zeros(n)])
        local -= lens / camera.focus
        origin = camera.to_world[:3, :3] @ lens + origin
    direction = camera.to_world[:3, :3] @ local
    length = np.linalg.norm(direction, axis=0)
    far = (camera.far - camera.near) * length
    return origin + camera.near * direction, direction / length, far, weight


def filter_offsets(rng: np.random.Generator, film: Film, n: int) -> np.ndarray:
    """Offsets from the pixel centre (n,), in pixels, drawn from the filter's absolute value.

    box |x| < 1/2; tent 1 - |x| / radius; gaussian exp(-x^2 / 2s^2) - exp(-8) on |x| < 4s;
    mitchell as ``mitchell``.
    """
    if film.filter == "box":
        return rng.random(n) - 0.5
    if film.filter == "tent":
        return (rng.random(n) - rng.random(n)) * film.parameter
    out, todo = np.empty(n), np.arange(n)
    top = 1.01 * np.abs(_mitchell_table(film)).max() if film.filter == "mitchell" else 1.0
    while len(todo):  # rejection
        if film.filter == "mitchell":
            x = 4 * rng.random(len(todo)) - 2
            keep = rng.random(len(todo)) * top < np.abs(mitchell(x, *film.parameter))
        else:  # keep with probability 1 - exp(-8) / exp(-x^2 / 2)
            x = rng.standard_normal(len(todo))
            keep = rng.random(len(todo)) >= np.exp(np.minimum(x * x / 2 - 8, 0))
        out[todo[keep]] = x[keep]
        todo = todo[~keep]
    return out * film.parameter if film.filter == "gaussian" else out


def filter_weights(film: Film, offset: np.ndarray) -> np.ndarray | float:
    """Weight of samples at ``offset`` (n,): the filter's sign times the integral of |filter|."""
    if film.filter != "mitchell":
        return 1.0
    table = _mitchell_table(film)
    return np.sign(mitchell(offset, *film.parameter)) * np.abs(table).sum() / table.sum()


def mitchell(x: np.ndarray, b: float, c: float) -> np.ndarray:
    """Mitchell and Netravali 1988; its integral over |x| < 2 is 1."""
    x = np.abs(x)
    inner = (12 - 9 * b - 6 * c) * x**3 + (-18 + 12 * b + 6 * c) * x**2 + 6 - 2 * b
    outer = (-b - 6 * c) * x**3 + (6 * b + 30 * c) * x**2 + (-12 * b - 48 * c) * x + 8 * b + 24 * c
    return np.where(x < 1, inner, np.where(x < 2, outer, 0)) / 6


def _mitchell_table(film: Film) -> np.ndarray:
    return mitchell((np.arange(20000) + 0.5) / 10000, *film.parameter)
