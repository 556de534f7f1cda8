"""Path tracing with next-event estimation, power-heuristic MIS, media and Russian roulette.

Vertex 0 is what the camera ray meets; segment d, row d of the ledger, ends at vertex d of its path.
A vertex is a surface or a scattering in a medium; an event there is real or a pass (``materials``):
a pass changes no direction, counts for no depth, takes no roulette and leaves the density of the
last real event in force. With k real events before it, a path scatters at a vertex if
max_depth < 0 or k + 1 < max_depth (Mitsuba's count: 1 = emission only, 2 = direct light).

Order at a vertex: emission; the event, with its weight; a light sample if the event is diffuse or
in a medium; the new direction, with its weight (value 0 because of the shading normals: absorbed);
then roulette if k + 1 >= rr_depth: the path goes on with probability q = min(1, m eta^2), m its
largest throughput component, eta^2 what refraction has scaled radiance by so far, and is divided by
q. No clamp, no cap. A path ends after 65,535 segments at the latest (depth_cut).

Power heuristic, exponent 2: Veach and Guibas 1995, so a light sample adds f cos L pdf_light /
(pdf_light^2 + pdf_event^2), densities per solid angle at the last real event, whatever lies
between. Shadow rays go through passes with their transmittance, and media attenuate them. At a
crossing, by refraction or pass, of a surface with media the path is in its interior from then on if
it goes against ng, else in its exterior.
"""

from __future__ import annotations

import math

import numpy as np

from reference.camera import camera_rays
from reference.lights import GRAZING, Lights
from reference.materials import (
    BLACK,
    COATED,
    MIRROR,
    PASS,
    PHASE,
    REFRACT,
    ROUGH,
    Materials,
    mirrored,
    refracted,
)
from reference.media import Media
from reference.paths import ABSORBED, CUT, EMITTER, ESCAPED, RR, Paths, Tally, Vertices
from reference.relief import any_tangent, derivatives, shade, tangents, turned
from reference.rough import Rough
from reference.scene import Scene
from reference.shadows import Shadows
from reference.tracer import Start, Tracer
from reference.vectors import cross, dot, unit, unit_sphere

SEGMENTS = 262143


class Integrator:
    """The estimator for one scene."""

    def __init__(self, scene: Scene) -> None:
        self.scene = scene
        self.tracer = Tracer(scene.geometry)
        self.materials = Materials(scene.materials)
        self.rough = Rough(scene.materials, self.materials)
        self.media = Media(scene.media)
        self.lights = Lights(scene, self.tracer)
        self.shadows = Shadows(scene, self.tracer, self.materials, self.media)
        normals = scene.geometry.normals
        self.smooth = np.zeros(len(scene.material), bool)
        self.smooth[: len(normals)] = (normals != 0).any(axis=2).all(axis=1)
        self.any_smooth = bool(self.smooth.any() or self.materials.reliefs)
        self.corner_normals = np.ascontiguousarray(normals.transpose(1, 2, 0))
        self.any_shine = bool((scene.emission >= 0).any())

    def paths(self, rng: np.random.Generator, pixel: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Trace one path for each entry of ``pixel`` (n,): radiance (3, n) and ledger rows."""
        scene, n = self.scene, len(pixel)
        origin, direction, far, weight = camera_rays(scene.camera, scene.film, rng, pixel)
        live = Paths(np.arange(n), origin, direction, np.ones((3, n)), np.full(n, np.inf))
        if self.materials.passes or scene.hide_emitters:
            live.depth, live.travelled = np.zeros(n, np.int32), np.zeros(n)
        if self.materials.bends:
            live.eta2 = np.ones(n)
        if scene.media:
            live.medium = np.full(n, scene.camera.medium, np.int32)
        tally = Tally(n)
        while len(live.path):
            tally.segment(live.path)
            v = Vertices(*self.tracer.closest(live.origin, live.direction, live.start))
            left = self.to_far_plane(live, far)
            cut = v.t > left
            v.primitive[cut], v.t[cut] = -1, left[cut]
            self.fly(rng, live, v)
            self.escape(live, v, tally)
            self.arrive(rng, live, v)
            self.shine(live, v, tally)
            self.choose(rng, live, v)
            self.end(live, v, tally)
            if len(live.path):
                self.light_sample(rng, live, v, tally)
                self.leave(rng, live, v, tally)
        tally.close()
        return tally.radiance * weight, tally.rows()

    # -- to the vertex -------------------------------------------------------------------------

    def to_far_plane(self, live: Paths, far: np.ndarray) -> np.ndarray:
        """How far the rays go: those of the camera, also behind what they have passed, to `far`."""
        if live.depth is not None:
            return np.where(live.depth == 0, far[live.path] - live.travelled, np.inf)
        return far if live.own is None else np.full(len(live.path), np.inf)

    def fly(self, rng: np.random.Generator, live: Paths, v: Vertices) -> None:
        """Where a path in a medium scatters before it meets a surface, its vertex is there."""
        if live.medium is None or not len(at := np.flatnonzero(live.medium >= 0)):
            return
        v.scattered = np.zeros(len(v.t), bool)
        v.t[at], v.scattered[at], weight = self.media.flight(
            rng,
            live.medium[at],
            v.t[at],
            live.throughput[:, at],
            live.origin[:, at],
            live.direction[:, at],
        )
        live.throughput[:, at] *= weight
        v.primitive[v.scattered], v.near[v.scattered] = -1, False

    def escape(self, live: Paths, v: Vertices, tally: Tally) -> None:
        """Paths that leave the scene take the environment's light with them."""
        gone = v.primitive < 0
        if v.scattered is not None:
            gone &= ~v.scattered
        lost = np.flatnonzero(gone)
        if not len(lost):
            return
        tally.cause[live.path[lost]] = ESCAPED
        if self.scene.hide_emitters:
            lost = lost[live.depth[lost] > 0]
        if self.lights.environment is not None:
            tally.radiance[:, live.path[lost]] += (
                live.throughput[:, lost] * self.lights.environment[:, None]
            )
        if self.lights.sky is not None:
            d = live.direction[:, lost]
            pdf = self.lights.sky.pdf(d) * self.lights.sky_chance()
            tally.radiance[:, live.path[lost]] += (
                live.throughput[:, lost]
                * self.lights.sky.radiance(d)
                / (1 + (pdf / live.pdf[lost]) ** 2)
            )
        stay = np.flatnonzero(~gone)
        live.keep(stay)
        v.keep(stay)

    def arrive(self, rng: np.random.Generator, live: Paths, v: Vertices) -> None:
        """Move the paths to their vertices; normals and cosines there."""
        live.origin += live.direction * v.t
        if live.travelled is not None:
            live.travelled += v.t
        v.front = v.normal = self.tracer.front(live.origin, v.primitive)
        if v.scattered is not None:
            v.front[:, v.scattered] = 0
        v.facing = v.cosine = -dot(v.front, live.direction)
        if self.any_smooth:
            v.normal = self.shading_normals(live.origin, v)
            v.cosine = -dot(v.normal, live.direction)
        v.material = self.materials.chosen(
            rng,
            self.scene.geometry,
            v.primitive,
            live.origin,
            self.scene.material.take(v.primitive),
            v.facing < 0,
        )
        if self.materials.directed:
            at = np.flatnonzero(v.primitive >= 0)
            by_u, _ = derivatives(self.scene.geometry, v.primitive[at], live.origin[:, at])
            v.along = np.zeros((3, len(v.t)))
            v.along[:, at] = tangents(by_u, v.normal[:, at])
        if self.materials.reliefs:
            self.turn_normals(live, v)
        if self.any_smooth:
            self.face_viewer(live, v)

    def face_viewer(self, live: Paths, v: Vertices) -> None:
        """Normals of clear surfaces that look away: ng, or, of round ones, bent to cosine 2^-6."""
        away = self.materials.clear.take(v.material) & (v.cosine * v.facing <= 0)
        if not len(at := np.flatnonzero(away)):
            return
        side, wo = np.where(v.facing[at] < 0, -1.0, 1.0), -live.direction[:, at]
        front, normal = v.front[:, at] * side, v.normal[:, at] * side
        bent = unit(normal + (2**-6 - dot(normal, wo)) * wo)
        rounded = self.materials.refracts_as_round(v.material[at], normal, front)
        v.normal[:, at] = np.where(rounded, bent, front) * side
        v.cosine[at] = dot(v.normal[:, at], wo)

    def turn_normals(self, live: Paths, v: Vertices) -> None:
        """By the textures that do so."""
        v.own, v.normal = v.normal, v.normal.copy()
        v.low = np.full(len(v.t), -1.0)
        scattered = v.primitive < 0
        for number in self.materials.reliefs:
            at = np.flatnonzero((v.material == number) & ~scattered)
            v.normal[:, at], v.low[at] = turned(
                self.scene.materials[number], self.scene.geometry, v.primitive[at],
                live.origin[:, at], v.front[:, at], v.own[:, at], -live.direction[:, at],
            )  # fmt: skip
        v.cosine = -dot(v.normal, live.direction)

    def shading_normals(self, point: np.ndarray, v: Vertices) -> np.ndarray:
        """Normals interpolated over triangles (3, n), unit; ng where they vanish or are none."""
        out = v.front.copy()
        at = np.flatnonzero(self.smooth.take(v.primitive) & (v.primitive >= 0))
        triangle = v.primitive[at]
        s = point[:, at] - self.tracer.v0.take(triangle, axis=1)
        e1, e2 = (e.take(triangle, axis=1) for e in (self.tracer.e1, self.tracer.e2))
        a, b, c, p, q = dot(e1, e1), dot(e1, e2), dot(e2, e2), dot(s, e1), dot(s, e2)
        area = a * c - b * b
        u, w = (c * p - b * q) / area, (a * q - b * p) / area
        n0, n1, n2 = (x.take(triangle, axis=1) for x in self.corner_normals)
        normal = n0 * (1 - u - w) + n1 * u + n2 * w
        length = np.sqrt(dot(normal, normal))
        out[:, at] = np.where(length > 0, normal / np.where(length > 0, length, 1), out[:, at])
        return out

    def shine(self, live: Paths, v: Vertices, tally: Tally) -> None:
        """Add the light of area lights that paths meet in front."""
        if not self.any_shine:
            return
        emission = self.scene.emission.take(v.primitive)
        v.lit = (emission >= 0) & (v.facing > 0)
        if self.scene.hide_emitters:
            v.hidden = (emission >= 0) & (v.primitive >= 0) & (live.depth == 0)
            v.lit &= ~v.hidden
        at = np.flatnonzero(v.lit)
        length = (v.t if live.travelled is None else live.travelled)[at]
        source = live.origin[:, at] - live.direction[:, at] * length
        pdf = self.lights.pdf_hit(source, v.primitive[at], length, v.facing[at])
        tally.radiance[:, live.path[at]] += (
            live.throughput[:, at]
            * self.lights.emitted(v.primitive[at], live.origin[:, at])
            / (1 + (pdf / live.pdf[at]) ** 2)
        )

    # -- at the vertex -------------------------------------------------------------------------

    def choose(self, rng: np.random.Generator, live: Paths, v: Vertices) -> None:
        """Events. One-sided ones turn both normals to wo's side of ng."""
        turned = self.materials.two_sided.take(v.material) & (v.facing < 0)
        facing, cosine = (np.where(turned, -x, x) for x in (v.facing, v.cosine))
        geometry = self.scene.geometry
        before = None if v.hidden is None else live.throughput[:, v.hidden]
        base = self.materials.textured(geometry, v.primitive, live.origin, v.material)
        if v.scattered is None or not v.scattered.any():
            v.event = self.materials.events(rng, v.material, facing, cosine, live.throughput, base)
        else:
            inside, at = np.flatnonzero(v.scattered), np.flatnonzero(~v.scattered)
            v.event = np.empty(len(v.t), np.int8)
            black = self.media.black.take(live.medium[inside])
            v.event[inside] = np.where(black, BLACK, PHASE)
            throughput = live.throughput.take(at, axis=1)
            v.event[at] = self.materials.events(
                rng,
                v.material[at],
                facing[at],
                cosine[at],
                throughput,
                None if base is None else base[:, at],
            )
            live.throughput[:, at] = throughput
        if before is not None:
            live.throughput[:, v.hidden] = before
            v.event[v.hidden] = PASS

    def end(self, live: Paths, v: Vertices, tally: Tally) -> None:
        """Drop the paths that end at their vertices: black ones, and those at the depth limit."""
        black = v.event == BLACK
        ended = live.path[black]
        tally.cause[ended] = (
            ABSORBED if v.lit is None else np.where(v.lit[black], EMITTER, ABSORBED)
        )
        stop = np.zeros(len(black), bool)
        if self.scene.max_depth >= 0:
            depth = len(tally.counts) - 1 if live.depth is None else live.depth
            stop |= depth + 1 >= self.scene.max_depth
            stop &= v.event != PASS
        stop |= len(tally.counts) >= SEGMENTS
        stop &= ~black
        tally.cause[live.path[stop]] = CUT
        stop |= black
        if stop.any():
            alive = np.flatnonzero(~stop)
            live.keep(alive)
            v.keep(alive)

    def light_sample(
        self, rng: np.random.Generator, live: Paths, v: Vertices, tally: Tally
    ) -> None:
        """Add one light sample's share at diffuse and rough events and scatterings in media."""
        at = np.flatnonzero(v.event <= PHASE)
        if not self.lights.any or not len(at):
            return
        sample = self.lights.sample(rng, live.origin.take(at, axis=1))
        turn = np.where(v.facing < 0, -1.0, 1.0).take(at)
        cosine = dot(v.normal.take(at, axis=1), sample.direction) * turn
        use = cosine > GRAZING
        if self.any_smooth:
            use &= dot(v.front.take(at, axis=1), sample.direction) * turn > GRAZING
        pdf = cosine / math.pi  # of the event, and its value but for colour
        share = pdf.copy()
        event = v.event.take(at)
        if len(coated := np.flatnonzero(event == COATED)):
            share[coated] *= self.materials.coat(v.material[at[coated]], cosine[coated])
        if len(inside := np.flatnonzero(event == PHASE)):
            old, new = live.direction[:, at[inside]], sample.direction[:, inside]
            pdf[inside] = self.media.phase(live.medium[at[inside]], dot(old, new), old, new)
            share[inside], use[inside] = pdf[inside], True
        colour = None
        if len(rough := np.flatnonzero(event == ROUGH)):
            colour = np.ones((3, len(at)))
            behind = dot(v.front[:, at[rough]], sample.direction[:, rough]) * turn[rough]
            behind = (behind < -GRAZING) & (cosine[rough] < -GRAZING)
            colour[:, rough], pdf[rough] = self.rough_value(
                live, v, at[rough], sample.direction[:, rough]
            )
            share[rough], use[rough] = 1, use[rough] | behind
            use[rough] &= pdf[rough] > 0
        if v.own is not None:
            own, new = (x[:, at] * turn for x in (v.own, v.normal))
            left = shade(own, new, v.low[at], sample.direction, event == PHASE)
            share, use = share * left, use & (left > 0)
        use &= sample.pdf > 0
        use = np.flatnonzero(use)
        sample.keep(use)
        at, pdf, share, turn = at.take(use), pdf.take(use), share.take(use), turn.take(use)
        beyond = (event.take(use) == ROUGH) & (cosine.take(use) < 0)
        side = v.front.take(at, axis=1) * np.where(beyond, -turn, turn)
        start = Start(v.primitive.take(at), side, v.near.take(at))
        medium = None if live.medium is None else live.medium.take(at)
        if medium is not None and beyond.any():
            boundary = self.scene.boundary.take(v.primitive.take(at))
            inner = np.flatnonzero(beyond & (boundary >= 0))
            to = (turn[inner] < 0).astype(np.int64)  # from behind: to the front's side
            medium[inner] = self.scene.boundaries[boundary[inner], to]
        seen, through = self.shadows.light(live.origin.take(at, axis=1), start, sample, medium)
        tally.counts[-1][1] = len(seen)
        tally.counts[-1][2] = len(at) - len(seen)
        at = at.take(seen)
        share /= np.where(sample.delta, 1.0, sample.pdf + pdf**2 / sample.pdf)
        light = live.throughput.take(at, axis=1)
        light *= sample.radiance.take(seen, axis=1)
        light *= share.take(seen)
        light *= through
        if colour is not None:
            light *= colour.take(use.take(seen), axis=1)
        tally.radiance[:, live.path.take(at)] += light

    def leave(self, rng: np.random.Generator, live: Paths, v: Vertices, tally: Tally) -> None:
        """New directions with their weights, crossings, roulette; the start of the next segment."""
        turn = np.where(v.facing < 0, -1.0, 1.0)
        front = v.front * turn
        normal = front if v.normal is v.front else v.normal * turn
        old = live.direction
        self.turn(rng, live, v, normal)
        ahead = dot(front, live.direction)
        alive = np.ones(len(ahead), bool)
        if v.own is not None:
            passes = (v.event == PASS) | (v.event == PHASE)
            left = shade(v.own * turn, normal, v.low, live.direction, passes)
            live.throughput *= left
        lost = ~(live.throughput > 0).any(axis=0)
        tally.cause[live.path[lost]] = ABSORBED
        alive &= ~lost
        if self.any_smooth:
            below = np.where(v.event == REFRACT, ahead >= 0, ahead <= 0)
            if self.materials.rough:
                rough = v.event == ROUGH
                below = np.where(rough, ahead * dot(normal, live.direction) <= 0, below)
            below &= (v.event != PASS) & (v.event != PHASE)
            clear = below & ~lost & self.materials.clear.take(v.material) & (v.event != ROUGH)
            if len(at := np.flatnonzero(clear)):
                rounded = self.materials.refracts_as_round(
                    v.material[at], normal[:, at], front[:, at]
                )
                self.turn_along(live, v, at[rounded], front)
                self.turn_flat(live, v, at[~rounded], front[:, at[~rounded]], old[:, at[~rounded]])
                ahead[at] = dot(front[:, at], live.direction[:, at])
            below &= ~clear
            tally.cause[live.path[below]] = ABSORBED
            alive &= ~below
        if live.medium is not None:
            self.cross(live, v, ahead * turn)
        self.roulette(rng, live, v, tally, alive)
        front *= np.where(ahead < 0, -1.0, 1.0)
        if self.tracer.quadrics.spheres:
            front[:, self.tracer.curved.take(v.primitive)] = 0
        live.own, live.side, live.near = v.primitive, front, v.near
        if not alive.all():
            live.keep(np.flatnonzero(alive))

    def turn(self, rng: np.random.Generator, live: Paths, v: Vertices, normal: np.ndarray) -> None:
        """New directions; ``normal`` is ns (3, n), turned to wo's side at one-sided events."""
        old = live.direction
        at = np.flatnonzero(v.event <= COATED)
        if len(at) < len(v.event):
            live.direction = old.copy()
            normal = normal.take(at, axis=1)
        # a unit vector plus a uniform one is spread as the cosine, and as long as twice it
        new = unit_sphere(rng.random(len(at)), rng.random(len(at)))
        new += normal
        length = np.sqrt(dot(new, new))
        new /= length
        if len(at) == len(v.event):
            live.direction, live.pdf = new, length / (2 * math.pi)
        else:
            live.direction[:, at], live.pdf[at] = new, length / (2 * math.pi)
        if len(coated := at[v.event[at] == COATED]):
            cosine = length[v.event[at] == COATED] / 2
            live.throughput[:, coated] *= self.materials.coat(v.material[coated], cosine)
        if len(at := np.flatnonzero(v.event == PHASE)):
            live.direction[:, at], live.pdf[at] = self.media.scatter(
                rng, live.medium[at], old[:, at]
            )
        if len(at := np.flatnonzero(v.event == ROUGH)):
            self.turn_rough(rng, live, v, at)
        if len(at := np.flatnonzero(v.event == MIRROR)):
            live.direction[:, at] = mirrored(old[:, at], v.normal[:, at])
            live.pdf[at] = np.inf
        if len(at := np.flatnonzero(v.event == REFRACT)):
            eta = self.materials.relative(v.material[at], v.cosine[at])
            live.direction[:, at] = refracted(old[:, at], v.normal[:, at], eta)
            live.pdf[at] = np.inf
            live.eta2[at] *= eta * eta

    def rough_frame(self, v: Vertices, at: np.ndarray) -> np.ndarray:
        """Tangents and the normal towards wo at rough events (3 rows, 3, n)."""
        z = v.normal[:, at] * np.where(v.facing[at] < 0, -1.0, 1.0)
        if v.along is None:
            x = any_tangent(z)
        else:
            x = tangents(v.along[:, at], z)
        return np.stack([x, cross(z, x), z])

    def rough_value(
        self, live: Paths, v: Vertices, at: np.ndarray, wi: np.ndarray
    ) -> tuple[np.ndarray, np.ndarray]:
        """F cos (3, n) and density (n,) of directions wi at rough events."""
        frame = self.rough_frame(v, at)
        m, eta = v.material[at], self.rough.eta(v.material[at], v.facing[at])
        local = (np.stack([dot(row, w) for row in frame]) for w in (-live.direction[:, at], wi))
        return self.rough.evaluate(m, eta, *local)

    def turn_rough(
        self, rng: np.random.Generator, live: Paths, v: Vertices, at: np.ndarray
    ) -> None:
        """Directions of rough events, their weight and density."""
        frame = self.rough_frame(v, at)
        m, eta = v.material[at], self.rough.eta(v.material[at], v.facing[at])
        wo = np.stack([dot(row, -live.direction[:, at]) for row in frame])
        wi = self.rough.sample(rng, m, eta, wo)
        value, density = self.rough.evaluate(m, eta, wo, wi)
        good = density > 0
        live.throughput[:, at] *= np.where(good, value / np.where(good, density, 1), 0)
        wi[:, ~good] = [[0.0], [0.0], [1.0]]
        x, y, z = frame
        live.direction[:, at], live.pdf[at] = wi[0] * x + wi[1] * y + wi[2] * z, density
        if live.eta2 is not None:
            live.eta2[at] *= np.where(wi[2] < 0, eta * eta, 1)

    def turn_along(self, live: Paths, v: Vertices, at: np.ndarray, front: np.ndarray) -> None:
        """Directions of paths ``at`` onto the right side of their faces, 2^-10 from the plane."""
        normal, d = front[:, at], live.direction[:, at]
        rise = np.where(v.event[at] == REFRACT, -(2**-10), 2**-10)
        live.direction[:, at] = unit(d + (rise - dot(normal, d)) * normal)

    def turn_flat(
        self, live: Paths, v: Vertices, at: np.ndarray, normal: np.ndarray, old: np.ndarray
    ) -> None:
        """Clear events of paths ``at`` again, about ng turned to wo; mirrored where all is."""
        m, eta = v.material[at], self.materials.relative(v.material[at], v.cosine[at])
        cosine = dot(normal, old)
        bent = v.event[at] == REFRACT
        through = bent & (1 - (1 - cosine * cosine) / (eta * eta) > 0)
        live.direction[:, at] = np.where(
            through, refracted(old, normal, eta), mirrored(old, normal)
        )
        mirror = bent & ~through
        rows, m, eta2 = at[mirror], m[mirror], eta[mirror] ** 2
        colour = self.materials.specular_transmittance.take(m, axis=1)
        share = self.materials.specular_reflectance.take(m, axis=1) * eta2
        live.throughput[:, rows] *= np.divide(
            share, colour, out=np.zeros_like(colour), where=colour > 0
        )
        live.eta2[rows] /= eta2
        v.event[rows] = MIRROR

    def cross(self, live: Paths, v: Vertices, ahead: np.ndarray) -> None:
        """Media beyond the boundaries that paths cross; ahead: dot(ng, new direction)."""
        boundary = self.scene.boundary.take(v.primitive)
        through = (v.event == PASS) | (v.event == REFRACT)
        through |= (v.event == ROUGH) & (ahead * v.facing < 0)
        through &= boundary >= 0
        if v.hidden is not None:
            through &= ~v.hidden
        at = np.flatnonzero(through)
        side = (ahead[at] >= 0).astype(np.int64)
        live.medium[at] = self.scene.boundaries[boundary[at], side]

    def roulette(
        self,
        rng: np.random.Generator,
        live: Paths,
        v: Vertices,
        tally: Tally,
        alive: np.ndarray,
    ) -> None:
        """Count real events; clear ``alive`` (n,) where paths die, divide the rest by q."""
        depth = len(tally.counts) - 1
        real = alive
        if live.depth is not None:
            real = alive & (v.event != PASS)
            depth = live.depth.copy()
            live.depth += real
            live.travelled[real] = 0
        real = real & (depth + 1 >= self.scene.rr_depth)
        if not real.any():
            return
        survival = live.throughput.max(axis=0)
        if live.eta2 is not None:
            survival *= live.eta2
        survival = np.where(real, np.minimum(survival, 1), 1)
        dies = rng.random(len(survival)) >= survival
        tally.cause[live.path[dies]] = RR
        alive &= ~dies
        live.throughput /= np.where(survival > 0, survival, 1)
