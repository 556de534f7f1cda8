"""Spheres and disks, met analytically in float64 by every ray.

A matrix product sorts out the spheres that a ray may meet, within a bound on its rounding; the rest
is decided by the stable formula of Haines et al. ("Precision improvements for ray/sphere
intersection", Ray Tracing Gems, 2019). A ray that starts on a sphere knows it: it can only meet the
sphere's other side, at t = -2 (o - c) . d. No epsilon is needed for spheres; a disk is not met by
rays that start in its plane.
"""

from __future__ import annotations

import numpy as np

from reference.vectors import cross, dot

_PAIRS = 1 << 16  # ray-shape pairs at a time


class Quadrics:
    """Spheres (S, 4) and disks (D, 3, 3), numbered spheres first; ray arrays are (3, n) float64.

    normals (3, S + D): of disks, unit; zero columns for spheres.
    """

    def __init__(self, spheres: np.ndarray, inward: np.ndarray, disks: np.ndarray) -> None:
        self.spheres, self.disks = len(spheres), len(disks)
        self.centre = np.ascontiguousarray(spheres[:, :3].T)
        self.radius = spheres[:, 3].copy()
        self.sign = np.where(inward, -1.0, 1.0)  # of the front's normal, outwards
        middle = self.centre.mean(axis=1, keepdims=True) if self.spheres else np.zeros((3, 1))
        self.middle = middle
        local = self.centre - middle
        square = (local**2).sum(axis=0)
        # |o - c|^2 - r^2 and (c - o) . d as products of rows for the ray and columns for the sphere
        self.power = np.concatenate(
            [-2 * local, np.ones((1, self.spheres)), [square - self.radius**2]]
        )
        self.along = np.concatenate([local, np.ones((1, self.spheres))])
        self.largest = max((square + self.radius**2).max(initial=0), 0.0)
        place, a, b = (np.ascontiguousarray(disks[:, i].T) for i in range(3))
        normal = cross(a, b)
        self.area = np.linalg.norm(normal, axis=0)  # over pi
        normal = normal / np.where(self.area > 0, self.area, 1)
        self.place, self.a, self.b, self.normal = place, a, b, normal
        with np.errstate(divide="ignore", invalid="ignore"):
            dual = [cross(b, normal), cross(normal, a)]  # in-plane coordinates along a and b
            dual = [x / dot(x, y) for x, y in zip(dual, (a, b), strict=True)]
        self.rows = np.concatenate([normal, *dual], axis=1)  # (3, 3 D)
        self.shift = np.concatenate([dot(x, place) for x in (normal, *dual)])
        self.normals = np.concatenate([np.zeros((3, self.spheres)), normal], axis=1)
        self.planes = np.concatenate([np.zeros(self.spheres), dot(normal, place)])

    def closest(
        self,
        origin: np.ndarray,
        direction: np.ndarray,
        own: np.ndarray | None,
        on_plane: float,
    ) -> tuple[np.ndarray, np.ndarray]:
        """Nearest (t (n,), number (n,) or -1); ``own`` (n,) is the number that a ray starts on."""
        n = origin.shape[1]
        best, number = np.full(n, np.inf), np.full(n, -1, np.int32)
        step = max(1, _PAIRS // max(self.spheres, self.disks, 1))
        for part in (slice(i, i + step) for i in range(0, n, step)):
            o, d = origin[:, part], direction[:, part]
            mine = None if own is None else own[part]
            if self.spheres:
                best[part], number[part] = self._spheres(o, d, mine)
            if self.disks:
                t, k = self._disks(o, d, mine, on_plane)
                nearer = t < best[part]
                best[part][nearer] = t[nearer]
                number[part][nearer] = k[nearer] + self.spheres
        return best, number

    def _spheres(
        self, o: np.ndarray, d: np.ndarray, own: np.ndarray | None
    ) -> tuple[np.ndarray, np.ndarray]:
        n = o.shape[1]
        local = o - self.middle
        square = dot(local, local)
        power = np.concatenate([local, [square], np.ones((1, n))]).T @ self.power
        along = np.concatenate([d, [-dot(local, d)]]).T @ self.along
        slack = (square + self.largest)[:, None] * 1e-13
        may = along * along - power >= -slack
        may &= (along >= 0) | (power <= slack)
        ray, sphere = np.nonzero(may)
        t = self.distance(o[:, ray], d[:, ray], sphere, None if own is None else own[ray])
        best, number = np.full(n, np.inf), np.full(n, -1, np.int32)
        np.minimum.at(best, ray, t)
        first = (t == best[ray]) & (t < np.inf)
        number[ray[first]] = sphere[first]
        return best, number

    def distance(
        self, o: np.ndarray, d: np.ndarray, sphere: np.ndarray, own: np.ndarray | None
    ) -> np.ndarray:
        """Distance of one sphere for each ray, inf if missed."""
        f = o - self.centre.take(sphere, axis=1)
        radius = self.radius.take(sphere)
        b = -dot(f, d)
        foot = f + b * d
        discriminant = radius * radius - dot(foot, foot)
        root = np.sqrt(np.maximum(discriminant, 0))
        power = dot(f, f) - radius * radius
        far = np.where(b >= 0, b + root, b - root)
        with np.errstate(divide="ignore", invalid="ignore"):
            near = power / far
        # the roots; both of b's sign from outside, of unlike sign from inside
        t = np.where(power > 0, np.where(b > 0, near, np.inf), np.where(b >= 0, far, near))
        t[~(discriminant >= 0)] = np.inf
        if own is not None:
            mine = own == sphere
            t[mine] = np.where(b > 0, 2 * b, np.inf)[mine]
        t[~(t > 0)] = np.inf
        return t

    def _disks(
        self, o: np.ndarray, d: np.ndarray, own: np.ndarray | None, on_plane: float
    ) -> tuple[np.ndarray, np.ndarray]:
        k = self.disks
        start = self.shift - o.T @ self.rows
        rise = d.T @ self.rows
        with np.errstate(divide="ignore", invalid="ignore"):
            t = start[:, :k] / rise[:, :k]
            u = start[:, k : 2 * k] - t * rise[:, k : 2 * k]
            v = start[:, 2 * k :] - t * rise[:, 2 * k :]
            ok = (t > 0) & (u * u + v * v <= 1) & (np.abs(start[:, :k]) > on_plane)
        if own is not None:
            ok &= own[:, None] != self.spheres + np.arange(k)
        t[~ok] = np.inf
        first = t.argmin(axis=1)
        return t[np.arange(len(t)), first], first

    def sphere_normals(self, point: np.ndarray, sphere: np.ndarray) -> np.ndarray:
        """Unit normals (3, n) on the front's side at points of spheres."""
        out = point - self.centre.take(sphere, axis=1)
        out *= self.sign.take(sphere) / np.sqrt(dot(out, out))
        return out
