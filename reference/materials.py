"""Materials: which event a path takes at a surface, with which weight, and where it goes.

Directions point away from the surface; wo to the camera's side, wi onwards. One lobe is chosen by
roulette, with the probability that makes its weight a colour (section 3.4 of the 2016 report), of
plastic in proportion to what lobes send on; the expectation is that of following all lobes.

=============== ==================================================================================
diffuse         LAMBERT
conductor       MIRROR, weight F of the complex index, per channel
dielectric      MIRROR with probability F, else REFRACT with 1 / eta^2: radiance is scaled
plastic         MIRROR or COATED, whose parts are F(wo) and 1 - F(wo): rho / (1 - Fi) / eta^2
                (1 - F(wi)) over pi, with rho Fi for Fi if nonlinear; Fi: diffuse reflectance from
                inside
thindielectric  MIRROR with probability 2F / (1 + F) (all inter-reflections), else PASS
null            PASS
blendbsdf       one of two, the second with probability weight
mask            PASS with probability 1 - opacity
roughconductor, roughplastic, roughdielectric: ROUGH (``reference/rough.py``); principled likewise
                (``reference/principled.py``, ``reference/principled_thin.py``), and hair
                (``reference/hair.py``)
=============== ==================================================================================

Normals: ng is geometric, ns the shading normal. Cosines are of ns. A value is 0 unless wo and wi
lie on the sides that both ask for: the same for a reflection, opposite for a transmission. Clear
materials (dielectric, thindielectric, null) lose nothing so: they are flat where the two disagree.
One-sided materials are black where wo is behind either; two-sided ones turn both normals to wo's
side of ng. F is Fresnel's reflectance of unpolarised light.
"""

from __future__ import annotations

import functools

import numpy as np

from reference.scene import MATERIAL_KINDS, Geometry, Material
from reference.textures import Texture
from reference.vectors import dot, unit

LAMBERT, COATED, ROUGH, PHASE, MIRROR, REFRACT, PASS, BLACK = range(8)
_DIFFUSE, _CONDUCTOR, _DIELECTRIC, _PLASTIC, _THIN, _NULL = range(6)
ROUGH_METAL, ROUGH_PLASTIC, ROUGH_GLASS, PRINCIPLED, OPEN, SHEET, HAIR = range(
    6, len(MATERIAL_KINDS)
)
_LUMINANCE = np.array([0.212671, 0.71516, 0.072169])  # of linear sRGB
_TWO_SIDED = (_DIELECTRIC, _THIN, _NULL, ROUGH_GLASS, OPEN, SHEET, HAIR)
_ONE_SIDED = ~np.isin(np.arange(len(MATERIAL_KINDS)), _TWO_SIDED)


def fresnel(cosine: np.ndarray, eta: np.ndarray | float) -> np.ndarray:
    """Reflectance of unpolarised light; cosine >= 0 of incidence, eta = n beyond / n before."""
    square = 1 - (1 - cosine * cosine) / (eta * eta)
    beyond = np.sqrt(np.maximum(square, 0))
    with np.errstate(invalid="ignore"):
        s = (cosine - eta * beyond) / (cosine + eta * beyond)
        p = (eta * cosine - beyond) / (eta * cosine + beyond)
    out = np.where(square > 0, (s * s + p * p) / 2, 1.0)
    return np.where(np.asarray(eta) == 1, 0.0, out)


def fresnel_conductor(cosine: np.ndarray, eta: np.ndarray, k: np.ndarray) -> np.ndarray:
    """Reflectance for the complex index eta + i k, relative to the outside."""
    square = (eta + 1j * k) ** 2
    root = np.sqrt(square - (1 - cosine * cosine))
    s = (cosine - root) / (cosine + root)
    p = (square * cosine - root) / (square * cosine + root)
    return (np.abs(s) ** 2 + np.abs(p) ** 2) / 2


def diffuse_fresnel(eta: float) -> float:
    """Reflectance of light that comes evenly from all sides: integral of 2 F(mu) mu dmu.

    eta = n beyond / n before. Gauss-Legendre over the angle, from outside; from inside by
    1 - F_i = (1 - F_e) eta^2 (reciprocity).
    """
    if eta < 1:
        return 1 - (1 - diffuse_fresnel(1 / eta)) * eta * eta
    x, weight = np.polynomial.legendre.leggauss(256)
    angle = (x + 1) * np.pi / 4
    value = fresnel(np.cos(angle), eta) * np.sin(2 * angle)
    return float((value * weight).sum() * np.pi / 4)


class Materials:
    """The materials of a scene as arrays; ``m`` in calls is an index of one for each path."""

    def __init__(self, materials: tuple[Material, ...]) -> None:
        self.others = np.full(len(materials), -1)
        self.weights: dict[int, float | Texture] = {}
        self.by_side = np.array([m.by_side for m in materials])
        for i, m in enumerate(materials):
            self.others[i] = (
                -1
                if m.other is None
                else next(k for k, other in enumerate(materials) if other is m.other)
            )
            if m.other is not None:
                self.weights[i] = m.weight
        self.kind = np.array([MATERIAL_KINDS.index(m.kind) for m in materials])
        for name in ("specular_reflectance", "specular_transmittance", "eta", "k"):
            setattr(self, name, np.array([getattr(m, name) for m in materials]).T.copy())
        self.index = self.eta[0].copy()
        self.opacity = np.array([m.opacity for m in materials])
        self.two_sided = np.array([m.two_sided for m in materials])
        self.one_sided = _ONE_SIDED[self.kind]
        self.clear = np.isin(self.kind, _TWO_SIDED)
        self.refracts = self.kind == _DIELECTRIC
        self.base = np.array([_base(m) for m in materials]).T.copy()
        lobes = [
            (self.base, (_DIFFUSE, _PLASTIC)),
            (self.specular_reflectance, (_CONDUCTOR, _DIELECTRIC, _PLASTIC, _THIN)),
            (self.specular_transmittance, (_DIELECTRIC, _THIN)),
        ]
        self.black = (self.kind != _NULL) & (self.kind < ROUGH_METAL)
        for colour, kinds in lobes:
            self.black &= ~(np.isin(self.kind, kinds) & (colour > 0).any(axis=0))
        self.textures = {i: m.texture for i, m in enumerate(materials) if m.texture is not None}
        self.reliefs = [i for i, m in enumerate(materials) if m.relief is not None]
        self.directed = any(
            m.alpha[0] != m.alpha[1] or m.shares.get("anisotropic") or m.kind == "hair"
            for m in materials
        )
        present = set(self.kind.tolist())
        self.has = {kind: kind in present for kind in range(len(MATERIAL_KINDS))}
        self.masked = bool((self.opacity < 1).any())
        self.passes = self.masked or self.has[_THIN] or self.has[_NULL]
        self.bends = self.has[_DIELECTRIC] or self.has[ROUGH_GLASS] or self.has[OPEN]
        self.rough = max(present) >= ROUGH_METAL
        self.plain = present == {_DIFFUSE} and not self.masked

    def events(
        self,
        rng: np.random.Generator,
        m: np.ndarray,
        front: np.ndarray,
        cosine: np.ndarray,
        throughput: np.ndarray,
        base: np.ndarray | None = None,
    ) -> np.ndarray:
        """One event for each path (n,) int8; multiplies ``throughput`` (3, n) by its weight.

        front, cosine: dot of wo with ng and ns, both turned round where the material has two equal
        sides; base (3, n): of LAMBERT and COATED, if not as in ``base``. BLACK: nothing is
        scattered.
        """
        event = np.zeros(len(m), np.int8)
        kind = self.kind.take(m)
        black = self.black.take(m)
        black |= self.one_sided.take(m) & ~((front > 0) & (cosine > 0))
        event[black] = BLACK
        if self.masked:
            event[rng.random(len(m)) >= self.opacity.take(m)] = PASS
        if not self.plain:
            for number, choose in (
                (_CONDUCTOR, self._conductor),
                (_DIELECTRIC, self._dielectric),
                (_PLASTIC, functools.partial(self._plastic, base=base)),
                (_THIN, self._thin),
                (_NULL, self._null),
                (ROUGH_METAL, self._rough),
                (ROUGH_PLASTIC, self._rough),
                (ROUGH_GLASS, self._rough),
                (PRINCIPLED, self._rough),
                (OPEN, self._rough),
                (SHEET, self._rough),
                (HAIR, self._rough),
            ):
                if self.has[number] and len(
                    at := np.flatnonzero((kind == number) & (event == LAMBERT))
                ):
                    event[at] = choose(rng, m[at], cosine[at], throughput, at)
        if self.plain:
            throughput *= self.base.take(m, axis=1) if base is None else base
        elif len(at := np.flatnonzero(event <= COATED)):
            throughput[:, at] *= self.base.take(m[at], axis=1) if base is None else base[:, at]
        return event

    def _conductor(self, rng, m, cosine, throughput, at) -> int:  # noqa: ANN001
        colour = fresnel_conductor(cosine, self.eta.take(m, axis=1), self.k.take(m, axis=1))
        throughput[:, at] *= colour * self.specular_reflectance.take(m, axis=1)
        return MIRROR

    def _dielectric(self, rng, m, cosine, throughput, at) -> np.ndarray:  # noqa: ANN001
        eta = self.relative(m, cosine)
        mirror = rng.random(len(m)) < fresnel(np.abs(cosine), eta)
        throughput[:, at] *= np.where(
            mirror,
            self.specular_reflectance.take(m, axis=1),
            self.specular_transmittance.take(m, axis=1) / (eta * eta),
        )
        return np.where(mirror, MIRROR, REFRACT)

    def _plastic(self, rng, m, cosine, throughput, at, base) -> np.ndarray:  # noqa: ANN001
        f, colour = fresnel(cosine, self.index.take(m)), self.specular_reflectance.take(m, axis=1)
        chance = of_coat(f, colour, self.base.take(m, axis=1) if base is None else base[:, at])
        mirror = rng.random(len(m)) < chance
        with np.errstate(divide="ignore", invalid="ignore"):
            coat, beneath = colour * (f / chance), (1 - f) / (1 - chance)
        throughput[:, at] *= np.where(mirror, coat, beneath)
        return np.where(mirror, MIRROR, COATED)

    def _thin(self, rng, m, cosine, throughput, at) -> np.ndarray:  # noqa: ANN001
        mirror = rng.random(len(m)) < self.pane(m, cosine)
        throughput[:, at] *= np.where(
            mirror,
            self.specular_reflectance.take(m, axis=1),
            self.specular_transmittance.take(m, axis=1),
        )
        return np.where(mirror, MIRROR, PASS)

    def _null(self, rng, m, cosine, throughput, at) -> int:  # noqa: ANN001
        return PASS

    def _rough(self, rng, m, cosine, throughput, at) -> int:  # noqa: ANN001
        return ROUGH

    def relative(self, m: np.ndarray, cosine: np.ndarray) -> np.ndarray:
        """N beyond / n on wo's side (n,), for wo on the side that the cosine's sign tells."""
        eta = self.index.take(m)
        return np.where(cosine > 0, eta, 1 / eta)

    def refracts_as_round(self, m: np.ndarray, ns: np.ndarray, ng: np.ndarray) -> np.ndarray:
        """(n,) whether smooth glass of these normals (3, n) stands for a round shape there."""
        return self.refracts.take(m) & (dot(ns, ng) > np.sqrt(0.5))

    def pane(self, m: np.ndarray, cosine: np.ndarray) -> np.ndarray:
        """Reflectance (n,) of a thin pane with all its inter-reflections."""
        f = fresnel(np.abs(cosine), self.index.take(m))
        return 2 * f / (1 + f)

    def textured(
        self, geometry: Geometry, primitive: np.ndarray, point: np.ndarray, m: np.ndarray
    ) -> np.ndarray | None:
        """The bases (3, n) at points of primitives; None without textures."""
        if not self.textures:
            return None
        base = self.base.take(m, axis=1)
        for number, texture in self.textures.items():
            if len(at := np.flatnonzero((m == number) & (primitive >= 0))):
                base[:, at] = texture.on(geometry, primitive[at], point[:, at])
        return base

    def weight(
        self, geometry: Geometry, primitive: np.ndarray, point: np.ndarray, m: np.ndarray
    ) -> np.ndarray:
        """The probabilities (n,) of the other materials of blends at points of primitives."""
        out = np.zeros(len(m))
        for number, weight in self.weights.items():
            if len(at := np.flatnonzero((m == number) & (primitive >= 0))):
                out[at] = (
                    weight
                    if isinstance(weight, float)
                    else _LUMINANCE @ weight.on(geometry, primitive[at], point[:, at])
                )
        return out

    def chosen(
        self,
        rng: np.random.Generator,
        geometry: Geometry,
        primitive: np.ndarray,
        point: np.ndarray,
        m: np.ndarray,
        behind: np.ndarray,
    ) -> np.ndarray:
        """The materials (n,) of vertices: of blends one of the two, which may be a blend in turn;
        behind: seen from there."""
        todo = np.full(len(m), bool(self.weights))
        while todo.any():
            other = rng.random(len(m)) < self.weight(geometry, primitive, point, m)
            other = np.where(self.by_side.take(m), behind, other)
            todo &= other & (self.others.take(m) >= 0)
            m = np.where(todo, self.others.take(m), m)
        return m

    def coat(self, m: np.ndarray, cosine: np.ndarray) -> np.ndarray:
        """1 - F(wi) (n,): the factor of COATED that depends on wi."""
        return 1 - fresnel(np.maximum(cosine, 0), self.index.take(m))

    def passing(
        self,
        m: np.ndarray,
        cosine: np.ndarray,
        geometry: Geometry,
        primitive: np.ndarray,
        point: np.ndarray,
    ) -> np.ndarray:
        """Transmittance (3, n) of PASS events at points of primitives, for shadow rays; cosine: of
        their directions with ng."""
        out = self._passing(m, cosine)
        if len(at := np.flatnonzero(self.others.take(m) >= 0)):
            weight = self.weight(geometry, primitive[at], point[:, at], m[at])
            weight = np.where(self.by_side.take(m[at]), cosine[at] > 0, weight)
            of_others = self.others.take(m[at])
            other = self.passing(of_others, cosine[at], geometry, primitive[at], point[:, at])
            out[:, at] += weight * (other - out[:, at])
        return out

    def _passing(self, m: np.ndarray, cosine: np.ndarray) -> np.ndarray:
        opacity = self.opacity.take(m)
        out = np.broadcast_to(1 - opacity, (3, len(m))).copy()
        kind = self.kind.take(m)
        out[:, kind == _NULL] = 1
        if len(at := np.flatnonzero(kind == _THIN)):
            share = opacity[at] * (1 - self.pane(m[at], cosine[at]))
            out[:, at] += share * self.specular_transmittance.take(m[at], axis=1)
        return out


def _base(material: Material) -> np.ndarray:
    """Weight (3,) of a LAMBERT or COATED event, but for the factor 1 - F(wi)."""
    rho = material.reflectance
    if material.kind == "plastic":
        eta = float(material.eta[0])
        inside = diffuse_fresnel(1 / eta)
        return rho / (1 - (rho * inside if material.nonlinear else inside)) / eta**2
    return rho if material.kind == "diffuse" else np.zeros(3)


def of_coat(part: np.ndarray, colour: np.ndarray, base: np.ndarray) -> np.ndarray:
    """The probability (n,) of a coat that reflects ``part`` (n,) in this colour (3, n), over a base
    (3, n) of which it lets 0.9 out."""
    coat, beneath = part * colour.mean(axis=0), 0.9 * (1 - part) * base.mean(axis=0)
    both = coat + beneath
    return np.divide(coat, both, out=np.zeros_like(both), where=both > 0)


def mirrored(direction: np.ndarray, normal: np.ndarray) -> np.ndarray:
    """``direction`` (3, n) reflected by planes with unit normals."""
    out = direction - 2 * dot(direction, normal) * normal
    return unit(out)


def refracted(direction: np.ndarray, normal: np.ndarray, eta: np.ndarray) -> np.ndarray:
    """Snell's law: eta = n beyond / n before, where there is no total reflection.

    ``normal`` is turned to the side that ``direction`` comes from.
    """
    cosine = dot(direction, normal)
    normal = normal * np.copysign(1.0, -cosine)
    cosine = np.abs(cosine)
    beyond = np.sqrt(np.maximum(1 - (1 - cosine * cosine) / (eta * eta), 0))
    out = direction / eta + (cosine / eta - beyond) * normal
    return unit(out)
