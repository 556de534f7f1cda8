"""Path tracing with next-event estimation, balance-heuristic MIS and Russian roulette.

Vertex 0 is what the camera ray hits; segment d ends at vertex d. A path scatters at vertex d if
max_depth < 0 or d + 1 < max_depth (Mitsuba's count: 1 = emission only, 2 = direct light). Roulette
acts after the scattering at vertex d if d + 1 >= rr_depth: the path goes on with probability
q = min(1, largest throughput component) and is divided by q. No clamp, no cap.

Light sampling, one sample a vertex: the environment (uniform over the sphere) with probability
1/2 if there are area lights too; else an emitting triangle with probability proportional to area
times summed radiance, and a uniform point on it. Balance heuristic: Veach and Guibas 1995, so a
light sample adds f cos L / (pdf_light + pdf_bsdf), densities per solid angle.

Random numbers: numpy's Philox with key (seed, batch); a batch is traced in chunks of fixed size,
so a picture depends on scene, settings, seed and the number of batches alone, not on processes.
"""

from __future__ import annotations

import math
import time
from collections.abc import Callable, Iterator
from concurrent.futures import ProcessPoolExecutor
from dataclasses import dataclass, replace
from multiprocessing import get_context

import numpy as np

from reference.scene import Film, Scene
from reference.tracer import Tracer, _dot

COLUMNS = (
    "live",
    "escaped",
    "emitter_end",
    "absorbed",
    "rr_killed",
    "depth_cut",
    "invalid",
    "shadow_visible",
    "shadow_occluded",
)
_LIVE, _ESCAPED, _EMITTER, _ABSORBED, _RR, _CUT, _INVALID, _VISIBLE, _OCCLUDED = range(9)
_CHUNK = 1 << 15
_GRAZING = 1e-10  # cosines below this are 0: a coplanar point's, after float64 rounding


@dataclass(frozen=True)
class Picture:
    """A finished render: linear radiance, float64.

    mean and stderr (standard error of the mean) (H, W, 3); batch_means (B, H, W, 3), each of
    spp / B samples; ledger (D, 9) uint64 with one row a depth and the columns of COLUMNS.
    """

    mean: np.ndarray
    stderr: np.ndarray
    batch_means: np.ndarray
    ledger: np.ndarray
    scene: Scene
    spp: int
    seed: int
    seconds: float


def render(
    scene: Scene,
    *,
    spp: int,
    seed: int = 0,
    batches: int = 64,
    processes: int = 1,
    progress: Callable[[int, int], None] | None = None,
) -> Picture:
    """Render ``spp`` samples a pixel in ``batches`` independent batches of equal size.

    progress(done, batches) is called after every batch. Memory: a fixed chunk of paths per
    process plus 9 float64 a pixel and batch. ValueError if spp is no multiple of batches.
    """
    if spp < 1 or batches < 1 or spp % batches:
        raise ValueError(f"spp {spp} must be a positive multiple of the batches ({batches})")
    if not 0 <= seed < 2**64:
        raise ValueError(f"seed {seed}, expected 0 to 2^64 - 1")
    start = time.perf_counter()
    shape = (scene.film.height, scene.film.width, 3)
    means, squares = np.empty((batches, *shape)), np.zeros(shape)
    ledger = np.zeros((0, len(COLUMNS)), np.uint64)
    jobs = [(seed, batch, spp // batches) for batch in range(batches)]
    for done, (batch, total, square, rows) in enumerate(_results(scene, jobs, processes), 1):
        means[batch] = total.T.reshape(shape) / (spp // batches)
        squares += square.T.reshape(shape)
        ledger = _add_rows(ledger, rows)
        if progress:
            progress(done, batches)
    mean = means.mean(axis=0)
    variance = np.maximum(squares / spp - mean**2, 0) / max(spp - 1, 1)
    return Picture(
        mean, np.sqrt(variance), means, ledger, scene, spp, seed, time.perf_counter() - start
    )


def _results(scene: Scene, jobs: list, processes: int) -> Iterator[tuple]:
    if processes == 1:
        _start(scene)
        yield from map(_batch, jobs)
        return
    with ProcessPoolExecutor(processes, get_context("spawn"), _start, (scene,)) as pool:
        futures = [pool.submit(_batch, job) for job in jobs]
        try:
            for future in futures:  # in order, so that sums are
                yield future.result()
        except BaseException:
            pool.shutdown(cancel_futures=True)
            raise


_integrator: Integrator


def _start(scene: Scene) -> None:
    global _integrator
    _integrator = Integrator(scene)


def _batch(job: tuple[int, int, int]) -> tuple[int, np.ndarray, np.ndarray, np.ndarray]:
    seed, batch, samples = job
    rng = np.random.Generator(np.random.Philox(key=np.array([seed, batch], np.uint64)))
    film = _integrator.scene.film
    pixels = film.width * film.height
    total, square = np.zeros((3, pixels)), np.zeros((3, pixels))
    ledger = np.zeros((0, len(COLUMNS)), np.uint64)
    for begin in range(0, pixels * samples, _CHUNK):
        pixel = np.arange(begin, min(begin + _CHUNK, pixels * samples)) % pixels
        radiance, rows = _integrator.paths(rng, pixel)
        for channel in range(3):
            total[channel] += np.bincount(pixel, radiance[channel], pixels)
            square[channel] += np.bincount(pixel, radiance[channel] ** 2, pixels)
        ledger = _add_rows(ledger, rows)
    return batch, total, square, ledger


def _add_rows(a: np.ndarray, b: np.ndarray) -> np.ndarray:
    longer, shorter = (a, b) if len(a) >= len(b) else (b, a)
    out = longer.copy()
    out[: len(shorter)] += shorter
    return out


class Integrator:
    """The estimator for one scene."""

    def __init__(self, scene: Scene) -> None:
        self.scene = scene
        self.tracer = tracer = Tracer(scene.triangles)
        self.reflectance = np.ascontiguousarray(scene.reflectance.T)
        self.black = (scene.reflectance == 0).all(axis=1)
        self.emission = np.ascontiguousarray(scene.emission.T)
        self.tangent, self.bitangent = _tangents(tracer.normals)
        power = tracer.areas * scene.emission.sum(axis=1)
        self.lights = np.flatnonzero(power > 0)
        for light in self.lights:
            if (other := tracer.overlapping(light)) >= 0:
                raise ValueError(
                    f"emitting triangle {light} and triangle {other} share a part of "
                    "one plane, so which of them is seen there is undefined"
                )
        environment = scene.environment
        self.environment = environment if environment is not None and environment.any() else None
        self.p_environment = (self.environment is not None) * (0.5 if len(self.lights) else 1.0)
        self.pdf_area = np.zeros(len(power))  # of a light sample, per unit area
        if len(self.lights):
            chance = power[self.lights] / power.sum()
            self.cdf = np.cumsum(chance)[:-1]
            self.pdf_area[self.lights] = (
                (1 - self.p_environment) * chance / tracer.areas[self.lights]
            )

    def paths(self, rng: np.random.Generator, pixel: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Trace one path for each entry of ``pixel`` (n,): radiance (3, n) and ledger rows."""
        scene, tracer = self.scene, self.tracer
        n = len(pixel)
        radiance = np.zeros((3, n))
        ended = np.zeros(n, np.int64)
        cause = np.zeros(n, np.int64)
        counts = []
        path = np.arange(n)
        origin, direction, far = self.camera_rays(rng, pixel)
        throughput = np.ones((3, n))
        pdf = own = side = edge = None
        depth = 0
        while len(path):
            triangle, t, near = tracer.closest(origin, direction, own, side, edge)
            if depth == 0:
                triangle[t > far] = -1
            counts.append([len(path), 0, 0])
            ended[path] = depth
            missed = np.flatnonzero(triangle < 0)
            cause[path[missed]] = _ESCAPED
            if self.environment is not None and len(missed):
                weight = 1.0
                if depth:
                    weight = pdf[missed] / (pdf[missed] + self.p_environment / (4 * math.pi))
                radiance[:, path[missed]] += (
                    throughput[:, missed] * self.environment[:, None] * weight
                )
            triangle = np.maximum(triangle, 0)
            hit = np.ones(len(path), bool)
            hit[missed] = False
            normal = tracer.normals.take(triangle, axis=1)
            cosine = _dot(normal, direction)
            front = cosine < 0
            emits = np.flatnonzero(scene.emitter.take(triangle) & front & hit)
            if len(emits):
                light, weight = triangle[emits], 1.0
                if depth:
                    pdf_light = self.pdf_area[light] * t[emits] ** 2 / -cosine[emits]
                    weight = pdf[emits] / (pdf[emits] + pdf_light)
                radiance[:, path[emits]] += throughput[:, emits] * self.emission[:, light] * weight
            black = self.black.take(triangle)
            black |= ~(front | scene.two_sided.take(triangle))
            cause[path[np.flatnonzero(black & hit)]] = _ABSORBED
            cause[path[emits[self.black[triangle[emits]]]]] = _EMITTER
            alive = np.flatnonzero(hit & ~black)
            if 0 <= scene.max_depth <= depth + 1:
                cause[path[alive]] = _CUT
                break
            if len(alive) < len(path):
                path, triangle, t, near, front = (
                    x.take(alive) for x in (path, triangle, t, near, front)
                )
                origin, direction, throughput, normal = (
                    x.take(alive, axis=1) for x in (origin, direction, throughput, normal)
                )
            direction *= t
            origin += direction
            side = normal
            side *= np.where(front, 1.0, -1.0)
            throughput *= self.reflectance.take(triangle, axis=1)
            self.light_sample(
                rng, radiance, path, origin, triangle, side, near, throughput, counts[-1]
            )
            if depth + 1 >= scene.rr_depth:
                survival = np.minimum(throughput.max(axis=0, initial=0), 1)
                lives = rng.random(len(path)) < survival
                alive = np.flatnonzero(lives)
                cause[path[~lives]] = _RR
                path, triangle, near, survival = (
                    x.take(alive) for x in (path, triangle, near, survival)
                )
                origin, side, throughput = (
                    x.take(alive, axis=1) for x in (origin, side, throughput)
                )
                throughput /= survival
            direction, pdf = self.cosine_sample(rng, triangle, side)
            own, edge = triangle, near
            depth += 1
        bad = ~(np.isfinite(radiance).all(axis=0) & (radiance >= 0).all(axis=0))
        radiance[:, bad] = 0
        cause[bad] = _INVALID
        return radiance, self.ledger_rows(counts, ended, cause)

    def ledger_rows(self, counts: list, ended: np.ndarray, cause: np.ndarray) -> np.ndarray:
        """Rows of COLUMNS from (live, visible, occluded) per depth and each path's end."""
        rows = np.zeros((len(counts), len(COLUMNS)), np.uint64)
        rows[:, [_LIVE, _VISIBLE, _OCCLUDED]] = counts
        ends = np.bincount(ended * len(COLUMNS) + cause, minlength=rows.size)
        rows[:, _ESCAPED:_VISIBLE] = ends.reshape(rows.shape)[:, _ESCAPED:_VISIBLE]
        return rows

    def camera_rays(
        self, rng: np.random.Generator, pixel: np.ndarray
    ) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """World origin and unit direction (3, n), and the distance of the far plane (n,)."""
        camera, film = self.scene.camera, self.scene.film
        x = (pixel % film.width + 0.5 + filter_offsets(rng, film, len(pixel))) / film.width
        y = (pixel // film.width + 0.5 + filter_offsets(rng, film, len(pixel))) / film.height
        tan_x, tan_y = camera.tangents(film.width, film.height)
        local = np.stack(
            [
                (1 - 2 * (x + camera.principal[0])) * tan_x,
                (1 - 2 * (y + camera.principal[1])) * tan_y,
                np.ones(len(pixel)),
            ]
        )
        direction = camera.to_world[:3, :3] @ local
        length = np.linalg.norm(direction, axis=0)
        origin = camera.to_world[:3, 3, None] + camera.near * direction
        return origin, direction / length, (camera.far - camera.near) * length

    def light_sample(
        self,
        rng: np.random.Generator,
        radiance: np.ndarray,
        path: np.ndarray,
        point: np.ndarray,
        own: np.ndarray,
        side: np.ndarray,
        edge: np.ndarray,
        throughput: np.ndarray,
        counts: list[int],
    ) -> None:
        """Add one light sample's share to ``radiance``; throughput includes the reflectance."""
        n = len(path)
        if not (n and (len(self.lights) or self.p_environment)):
            return
        u, v = rng.random(n), rng.random(n)
        if self.p_environment == 1:
            direction, emitted, distance, pdf = self.environment_sample(u, v)
        else:
            direction, emitted, distance, pdf = self.area_sample(rng.random(n), u, v, point)
            if self.p_environment:
                sky = rng.random(n) < self.p_environment
                mixed = self.environment_sample(u, v)
                direction, emitted, distance, pdf = (
                    np.where(sky, a, b)
                    for a, b in zip(mixed, (direction, emitted, distance, pdf), strict=True)
                )
        cosine = _dot(side, direction)
        use = np.flatnonzero((cosine > _GRAZING) & (pdf > 0))
        if len(use) < n:
            path, own, edge, cosine, pdf, distance = (
                x.take(use) for x in (path, own, edge, cosine, pdf, distance)
            )
            point, side, direction, throughput, emitted = (
                x.take(use, axis=1) for x in (point, side, direction, throughput, emitted)
            )
        visible = self.tracer.visible(point, direction, distance, own, side, edge)
        counts[1] = int(visible.sum())
        counts[2] = len(visible) - counts[1]
        seen = np.flatnonzero(visible)
        cosine = cosine.take(seen) / math.pi  # also the density of the cosine lobe
        share = throughput.take(seen, axis=1)
        share *= emitted.take(seen, axis=1)
        share *= cosine / (pdf.take(seen) + cosine)
        radiance[:, path.take(seen)] += share

    def environment_sample(self, u: np.ndarray, v: np.ndarray) -> tuple[np.ndarray, ...]:
        """Uniform direction; with radiance, distance and density per solid angle."""
        n = len(u)
        z = 1 - 2 * u
        r, phi = np.sqrt(np.maximum(1 - z * z, 0)), 2 * math.pi * v
        direction = np.stack([r * np.cos(phi), r * np.sin(phi), z])
        emitted = np.broadcast_to(self.environment[:, None], (3, n))
        return direction, emitted, np.full(n, np.inf), np.full(n, self.p_environment / 4 / math.pi)

    def area_sample(
        self, choice: np.ndarray, u: np.ndarray, v: np.ndarray, point: np.ndarray
    ) -> tuple[np.ndarray, ...]:
        """Uniform point on a chosen light; density per solid angle, 0 from behind the light."""
        tracer = self.tracer
        light = self.lights.take(np.searchsorted(self.cdf, choice, side="right"))
        root = np.sqrt(u)
        direction = tracer.v0.take(light, axis=1)
        direction += tracer.e1.take(light, axis=1) * (root * (1 - v))
        direction += tracer.e2.take(light, axis=1) * (root * v)
        direction -= point
        square = _dot(direction, direction)
        distance = np.sqrt(square)
        with np.errstate(divide="ignore", invalid="ignore"):
            direction /= distance
            cosine = -_dot(tracer.normals.take(light, axis=1), direction)
            pdf = self.pdf_area.take(light) * square / cosine
        pdf[~(cosine > _GRAZING)] = 0
        return direction, self.emission.take(light, axis=1), distance, pdf

    def cosine_sample(
        self, rng: np.random.Generator, triangle: np.ndarray, side: np.ndarray
    ) -> tuple[np.ndarray, np.ndarray]:
        """Unit directions with density cos / pi about ``side``, and that density."""
        n = len(triangle)
        u = rng.random(n)
        phi = rng.random(n)
        phi *= 2 * math.pi
        r = np.sqrt(u)
        cosine = np.sqrt(1 - u)
        direction = side * cosine
        direction += self.tangent.take(triangle, axis=1) * (r * np.cos(phi))
        direction += self.bitangent.take(triangle, axis=1) * (r * np.sin(phi))
        cosine /= math.pi
        return direction, cosine


def filter_offsets(rng: np.random.Generator, film: Film, n: int) -> np.ndarray:
    """Offsets from the pixel centre (n,), in pixels, drawn from the reconstruction filter.

    box |x| < 1/2; tent 1 - |x| / radius; gaussian exp(-x^2 / 2s^2) - exp(-8) on |x| < 4s.
    """
    if film.filter == "box":
        return rng.random(n) - 0.5
    if film.filter == "tent":
        return (rng.random(n) - rng.random(n)) * film.parameter
    out, todo = np.empty(n), np.arange(n)
    while len(todo):  # rejection: keep with probability 1 - exp(-8) / exp(-x^2 / 2)
        x = rng.standard_normal(len(todo))
        keep = rng.random(len(todo)) >= np.exp(np.minimum(x * x / 2 - 8, 0))
        out[todo[keep]] = x[keep]
        todo = todo[~keep]
    return out * film.parameter


def _tangents(normals: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Two unit vectors orthogonal to each normal and to each other (3, T)."""
    axis = np.eye(3)[:, np.abs(normals).argmin(axis=0)]
    tangent = np.cross(axis, normals, axis=0)
    tangent /= np.maximum(np.linalg.norm(tangent, axis=0), 1e-300)
    return tangent, np.cross(normals, tangent, axis=0)


def with_settings(
    scene: Scene,
    *,
    width: int | None = None,
    height: int | None = None,
    max_depth: int | None = None,
    rr_depth: int | None = None,
) -> Scene:
    """A copy of ``scene`` with other settings; None keeps the file's. ValueError if unusable."""
    film = scene.film
    new = replace(
        scene,
        film=replace(
            film,
            width=film.width if width is None else width,
            height=film.height if height is None else height,
        ),
        max_depth=scene.max_depth if max_depth is None else max_depth,
        rr_depth=scene.rr_depth if rr_depth is None else rr_depth,
    )
    if min(new.film.width, new.film.height, new.rr_depth) < 1 or new.max_depth < -1:
        raise ValueError(
            f"film {new.film.width} x {new.film.height}, rr_depth {new.rr_depth} must "
            f"be positive and max_depth {new.max_depth} at least -1"
        )
    return new
