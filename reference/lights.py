"""Where the light comes from: choice of a light, a point or direction on it, densities.

One sample a vertex, of a light chosen in proportion to its power, the sum over channels:
area lights pi A L, points 4 pi I, spots the integral of I, directional lights pi R^2 E with R the
radius of a ball about the scene; light from far away gets half of the chances at most where there
is other light. On triangles and disks the point is uniform in area; on two
triangles that make a rectangle near to a surface, in solid angle where that is large; a sphere that
shines outwards is sampled uniformly in the cone that it fills; from within a sphere that shines
inwards every direction meets it, so directions are uniform. The power of what has a texture is
that of its mean, over all texels. The environment is not sampled: paths
that escape bring its light. An image of a sky is sampled (skies.py). Densities are per solid angle
at the vertex and include the choice of the light.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from reference.rectangles import Rectangles
from reference.scene import Light, Scene
from reference.textures import coordinates
from reference.tracer import Tracer
from reference.vectors import about, dot

GRAZING = 1e-10  # cosines below this are 0: a coplanar point's, after float64 rounding


@dataclass
class Sample:
    """n light samples: unit direction (3, n), radiance (3, n), distance (n,), density pdf (n,).

    Of a light without extent the radiance stands for f -> f (direction), over the probability of
    its choice, pdf is 1 and ``delta`` true. pdf 0: no light. target: the primitive sampled or -1.
    """

    direction: np.ndarray
    radiance: np.ndarray
    distance: np.ndarray
    pdf: np.ndarray
    target: np.ndarray
    delta: np.ndarray

    def keep(self, index: np.ndarray) -> None:
        """Drop all samples but those of ``index``."""
        for name, value in vars(self).items():
            setattr(self, name, value.take(index, axis=-1))


class Lights:
    """The lights of a scene. ``any`` is false if there is none to sample."""

    def __init__(self, scene: Scene, tracer: Tracer) -> None:
        self.tracer, self.quadrics = tracer, tracer.quadrics
        self.radiance = np.concatenate([scene.radiances, np.zeros((1, 3))]).T.copy()
        self.emission = scene.emission  # -1 picks the zero at the end
        self.scene, self.shine = scene, (*scene.shine, None)
        mean = np.array([1.0 if x is None else x.mean() for x in self.shine])
        area_power = math.pi * tracer.areas * (self.radiance.sum(axis=0) * mean)[self.emission]
        shining = np.flatnonzero(area_power > 0)
        self.check_overlaps(shining)
        self.delta = tuple(scene.lights)
        self.sky = scene.sky if scene.sky is not None and scene.sky.power > 0 else None
        others = [_power(x, tracer.extent) for x in self.delta]
        if self.sky is not None:
            others.append(self.sky.power * tracer.extent**2)
        far = [x.kind == "directional" for x in self.delta] + [True] * (self.sky is not None)
        distant = np.append(np.zeros(len(shining), bool), np.array(far, bool))
        power = np.append(area_power[shining], others)
        near, away = power[~distant].sum(), power[distant].sum()
        if 0 < near < away:
            power[distant] *= near / away
        self.primitive = np.append(shining, np.full(len(others), -1))[power > 0].astype(np.int32)
        number = np.append(np.full(len(shining), -1), np.arange(len(others)))
        self.number = number[power > 0].astype(np.int32)
        power = power[power > 0]
        environment = scene.environment
        self.environment = environment if environment is not None and environment.any() else None
        self.any = bool(len(power))
        self.rectangles = Rectangles(scene, tracer, shining)
        chance = power / max(power.sum(), 1e-300)
        self.cdf = np.cumsum(power[:-1]) / max(power.sum(), 1e-300)
        self.chance = np.zeros(len(tracer.areas))  # to sample a primitive
        self.chance[self.primitive[self.primitive >= 0]] = chance[self.primitive >= 0]
        self.delta_chance = chance
        with np.errstate(divide="ignore", invalid="ignore"):
            self.pdf_area = np.where(self.chance > 0, self.chance / tracer.areas, 0)

    def check_overlaps(self, shining: np.ndarray) -> None:
        """ValueError if a triangle shares a part of its plane with a shining one."""
        count = self.tracer.count
        shining = shining[shining < count]
        if len(shining) * count > 1 << 24:
            return  # a mesh that shines, too large to look for its author's errors
        for light in shining:
            if (other := self.tracer.overlapping(light)) >= 0:
                raise ValueError(
                    f"emitting triangle {light} and triangle {other} share a part of "
                    "one plane, so which of them is seen there is undefined"
                )

    def emitted(self, primitive: np.ndarray, point: np.ndarray) -> np.ndarray:
        """Radiance (3, n) of the fronts of primitives at points (3, n)."""
        emission = self.emission.take(primitive)
        out = self.radiance.take(emission, axis=1)
        for number, texture in enumerate(self.shine):
            if texture is not None and len(at := np.flatnonzero(emission == number)):
                uv = coordinates(self.scene.geometry, primitive[at], point[:, at])
                out[:, at] *= texture.at(uv)
        return out

    # -- densities of what a path meets --------------------------------------------------------

    def pdf_hit(
        self,
        source: np.ndarray,
        primitive: np.ndarray,
        distance: np.ndarray,
        cosine: np.ndarray,
    ) -> np.ndarray:
        """Density (n,) of a light sample at ``source`` that found the front of ``primitive``.

        distance from the source, cosine > 0 at the light.
        """
        pdf = self.pdf_area.take(primitive) * distance**2 / cosine
        wide, rectangle, solid = self.rectangles.wide(source, primitive)
        pdf[wide] = self.chance_of(rectangle) / solid
        if self.quadrics.spheres:
            at = np.flatnonzero(self.tracer.curved.take(primitive))
            sphere = primitive[at] - self.tracer.count
            solid = self.solid_angle(source[:, at], sphere)
            pdf[at] = self.chance.take(primitive[at]) / solid
        return pdf

    def sky_chance(self) -> float:
        """Probability that the sky is sampled: the last light."""
        return float(self.delta_chance[-1])

    def chance_of(self, rectangle: np.ndarray) -> np.ndarray:
        """Probability (n,) that one of the halves of a rectangle is sampled."""
        return self.chance.take(self.rectangles.halves[:, rectangle]).sum(axis=0)

    def solid_angle(self, source: np.ndarray, sphere: np.ndarray) -> np.ndarray:
        """Solid angle (n,) that a sphere light is sampled in: its cone, or 4 pi from within."""
        return 2 * math.pi * self._cap(source, sphere)[0]

    def _cap(
        self, source: np.ndarray, sphere: np.ndarray
    ) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """(1 - cosine of the cone (n,), axis (3, n) unit, distance of the centre (n,))."""
        axis = self.quadrics.centre.take(sphere, axis=1) - source
        distance = np.sqrt(dot(axis, axis))
        with np.errstate(divide="ignore"):
            sine2 = np.minimum((self.quadrics.radius.take(sphere) / distance) ** 2, 1)
        axis /= np.where(distance > 0, distance, 1)
        axis[2, distance == 0] = 1
        cap = sine2 / (1 + np.sqrt(1 - sine2))
        cap[self.quadrics.sign.take(sphere) < 0] = 2
        return cap, axis, distance

    # -- sampling ------------------------------------------------------------------------------

    def sample(self, rng: np.random.Generator, point: np.ndarray) -> Sample:
        """One light sample for each point (3, n)."""
        n = point.shape[1]
        u, v = rng.random(n), rng.random(n)
        choice = np.searchsorted(self.cdf, rng.random(n), side="right")
        primitive = self.primitive.take(choice)
        sample = self._area(primitive, u, v, point)
        if len(self.delta) or self.sky is not None:
            at = np.flatnonzero(primitive < 0)
            for light in np.unique(self.number[choice[at]]):
                self._delta(rng, sample, light, at[self.number[choice[at]] == light], point)
        return sample

    def _area(
        self, primitive: np.ndarray, u: np.ndarray, v: np.ndarray, point: np.ndarray
    ) -> Sample:
        """Samples of shapes; where ``primitive`` is -1 something to be overwritten."""
        tracer, n = self.tracer, len(primitive)
        count, spheres = tracer.count, self.quadrics.spheres
        place = np.zeros((3, n))
        if count and (primitive < count).any():
            triangle, root = np.clip(primitive, 0, count - 1), np.sqrt(u)
            place = tracer.v0.take(triangle, axis=1)
            place += tracer.e1.take(triangle, axis=1) * (root * (1 - v))
            place += tracer.e2.take(triangle, axis=1) * (root * v)
        if self.quadrics.disks and len(at := np.flatnonzero(primitive >= count + spheres)):
            disk, r, phi = primitive[at] - count - spheres, np.sqrt(u[at]), 2 * math.pi * v[at]
            place[:, at] = self.quadrics.place.take(disk, axis=1)
            place[:, at] += self.quadrics.a.take(disk, axis=1) * (r * np.cos(phi))
            place[:, at] += self.quadrics.b.take(disk, axis=1) * (r * np.sin(phi))
        wide, rectangle, solid = self.rectangles.wide(point, primitive)
        if len(wide):
            place[:, wide], half = self.rectangles.sample(
                point[:, wide], rectangle, u[wide], v[wide]
            )
            primitive = primitive.copy()
            primitive[wide] = self.rectangles.halves[half, rectangle]
        place -= point
        square = dot(place, place)
        distance = np.sqrt(square)
        with np.errstate(divide="ignore", invalid="ignore"):
            place /= distance
            cosine = -dot(tracer.normals.take(primitive, axis=1), place)
            pdf = self.pdf_area.take(primitive) * square / cosine
        pdf[wide] = self.chance_of(rectangle) / solid
        pdf[~(cosine > GRAZING)] = 0
        radiance = self.radiance.take(self.emission.take(primitive), axis=1)
        sample = Sample(place, radiance, distance, pdf, primitive, np.zeros(n, bool))
        if spheres:
            at = np.flatnonzero((primitive >= count) & (primitive < count + spheres))
            self._sphere(sample, at, u[at], v[at], point[:, at])
        at = np.flatnonzero((sample.target >= 0) & (sample.pdf > 0))
        where = point[:, at] + sample.direction[:, at] * sample.distance[at]
        sample.radiance[:, at] = self.emitted(sample.target[at], where)
        return sample

    def _sphere(
        self, sample: Sample, at: np.ndarray, u: np.ndarray, v: np.ndarray, point: np.ndarray
    ) -> None:
        sphere = sample.target[at] - self.tracer.count
        cap, axis, centre = self._cap(point, sphere)
        direction = about(axis, 1 - u * cap, 2 * math.pi * v)
        radius = self.quadrics.radius.take(sphere)
        inside = centre <= radius * (1 + 1e-9)  # or on it
        along = centre * (1 - u * cap)
        half = np.sqrt(np.maximum(radius**2 - (centre**2 - along**2), 0))
        right = inside == (self.quadrics.sign.take(sphere) < 0)
        sample.direction[:, at] = direction
        sample.distance[at] = np.where(inside, along + half, along - half)
        sample.pdf[at] = np.where(
            right, self.chance.take(sample.target[at]) / (2 * math.pi * cap), 0
        )

    def _delta(
        self,
        rng: np.random.Generator,
        sample: Sample,
        number: int,
        at: np.ndarray,
        point: np.ndarray,
    ) -> None:
        if number == len(self.delta) and self.sky is not None:
            direction, pdf = self.sky.sample(rng, len(at))
            sample.direction[:, at], sample.distance[at] = direction, np.inf
            sample.radiance[:, at] = self.sky.radiance(direction)
            sample.pdf[at], sample.target[at] = pdf * self.sky_chance(), -1
            sample.delta[at] = False
            return
        light, n = self.delta[number], len(at)
        radiance = light.intensity[:, None]
        scale = np.full(n, 1 / self.delta_chance[(self.number == number).argmax()])
        if light.kind == "directional":
            direction = np.broadcast_to(-light.direction[:, None], (3, n))
            distance = np.full(n, np.inf)
        else:
            direction = light.position[:, None] - point[:, at]
            square = dot(direction, direction)
            distance = np.sqrt(square)
            direction = direction / np.where(distance > 0, distance, 1)
            scale /= np.where(square > 0, square, np.inf)
            ahead = -(light.direction @ direction)
            if light.kind == "spot":
                scale *= falloff(light, ahead)
            elif light.kind == "projector":
                with np.errstate(divide="ignore"):
                    scale *= np.where(ahead > 0, 1 / ahead**3, 0)
            radiance = radiance * picture(light, -direction, ahead)
        sample.direction[:, at], sample.distance[at] = direction, distance
        sample.radiance[:, at] = radiance * scale
        lit = (sample.radiance[:, at] > 0).any(axis=0)
        sample.pdf[at], sample.target[at], sample.delta[at] = lit, -1, True


def falloff(light: Light, cosine: np.ndarray) -> np.ndarray:
    """Share of a spot's intensity: 1 within the beam, then linear in the angle to the cutoff."""
    angle = np.arccos(np.clip(cosine, -1, 1))
    if light.cutoff == light.beam:
        return (angle < light.cutoff).astype(float)
    return np.clip((light.cutoff - angle) / (light.cutoff - light.beam), 0, 1)


def picture(light: Light, direction: np.ndarray, ahead: np.ndarray) -> np.ndarray:
    """The factor (3 or 1, n) of a light's texture, and whether a projector lights there at all.

    direction (3, n): the way of the light; ahead: its cosine to the light's axis.
    """
    with np.errstate(divide="ignore", invalid="ignore"):
        x, y = light.frame[:, :2].T @ direction / ahead / np.array(light.tangents)[:, None]
    seen = (ahead > 0) & np.isfinite(x) & np.isfinite(y)
    if light.kind == "projector":
        seen &= (np.abs(x) <= 1) & (np.abs(y) <= 1)
        out = seen[None].astype(float)
    else:
        out = np.ones((1, len(ahead)))
    if light.texture is None:
        return out
    uv = np.where(seen, (1 + np.array([x, y])) / 2, 0)
    return out * light.texture.at(uv)


def _power(light: Light, extent: float) -> float:
    """Watts, summed over the channels."""
    total = float(light.intensity.sum())
    if light.texture is not None:
        total *= light.texture.mean()
    if light.kind == "projector":
        return 4 * light.tangents[0] * light.tangents[1] * total
    if light.kind == "point":
        return 4 * math.pi * total
    if light.kind == "directional":
        return math.pi * extent**2 * total
    a, b = light.beam, light.cutoff
    mean = (math.sin(b) - math.sin(a)) / (b - a) if b > a else math.cos(b)
    return 2 * math.pi * (1 - mean) * total
