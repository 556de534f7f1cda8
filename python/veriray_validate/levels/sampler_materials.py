"""Level 2: materials: directions, weights, lobes, energy and reciprocity; Fresnel's equations."""

from __future__ import annotations

import itertools
import math
from dataclasses import astuple, dataclass, replace
from typing import Any

import numpy as np
import numpy.typing as npt

from veriray.columns import MATERIAL_KINDS, PRINCIPLED, PRINCIPLED_THIN
from veriray_validate.levels.samplers import (
    N,
    count,
    hooked,
    random_numbers,
    random_points,
    replayed,
    uniform,
)
from veriray_validate.oracles import (
    CORNERS,
    INVERSE,
    fresnel,
    gauss,
    normalised,
    refracted,
    single,
)
from veriray_validate.scenes import camera, make, material, quad
from veriray_validate.trial import Trial, case

Array = npt.NDArray[Any]


@dataclass(frozen=True)
class Grey:
    """A grey material; kind: of MATERIAL_KINDS, eta: inside over outside or of a conductor.

    albedo: of a diffuse material; of plastic, of its base within the coat. heights: shadows of
    small mirrors are correlated by height.
    """

    kind: str
    albedo: float = 0.0
    reflection: float = 1.0
    transmission: float = 1.0
    eta: float = 1.5
    k: float = 0.0
    alpha: float = 0.1
    across: float = 0.0  # the tangent; 0: alpha
    ggx: float = 0.0
    shares: tuple[float, ...] = tuple(
        default for default, _ in (PRINCIPLED | PRINCIPLED_THIN).values()
    )
    heights: bool = False

    def columns(self, front: bool = True) -> tuple[float, ...]:
        """As the hooks take them."""
        slopes = (2.0 if self.ggx else -2.0) if self.heights else self.ggx  # slopes_number
        all_ = astuple(replace(self, across=self.across or self.alpha, ggx=slopes))
        kind, *rest, shares, _ = all_
        return (MATERIAL_KINDS.index(kind), float(front), *rest, *shares)

    @property
    def slopes(self) -> Array:
        """Alpha along and across the tangent, and 1."""
        return np.array([*single(np.array([self.alpha, self.across or self.alpha])), 1.0])

    def relative(self, front: bool) -> float:
        """Index beyond over index on the side of wo."""
        eta = float(single(self.eta))
        two_sided = self.kind in (
            "dielectric", "roughdielectric", "roughdielectric_whole", "principled_open",
        )  # fmt: skip
        return 1 / eta if two_sided and not front else eta

    def mirror(self, cos_o: float, front: bool) -> float:
        """What the mirror lobe reflects of light, its colour aside."""
        if self.kind == "conductor":
            return 1.0
        if self.kind in ("diffuse", "null"):
            return 0.0
        r = float(fresnel(cos_o, self.relative(front)))
        return 2 * r / (1 + r) if self.kind == "thindielectric" and r < 1 else r

    def chosen(self, mirror: Any) -> Any:
        """Probability of a mirror lobe that reflects this: of plastic by what lobes send on."""
        if not self.kind.endswith("plastic"):
            return mirror
        coat = mirror * self.reflection
        return coat / (coat + 0.9 * (1 - mirror) * self.albedo)


def transmitted(eta: float) -> float:
    """1 - F_e: share of diffuse light that an interface lets in from outside."""
    c, w = gauss(200, 0, 1)
    return float(((1 - fresnel(c, eta)) * 2 * c * w).sum())


def hidden(eta: float, rho: float = 1.0) -> float:
    """Albedo of a plastic's base within its coat: rho / (1 - F_i) / eta^2 (linear plastic)."""
    return rho / transmitted(eta)  # as 1 - F_i = (1 - F_e) / eta^2


MATERIALS = {
    "diffuse": Grey("diffuse", 0.5),
    "white": Grey("diffuse", 1.0),
    "mirror": Grey("conductor", eta=0.0, k=1.0),
    "metal": Grey("conductor", reflection=0.8, eta=0.2, k=3.0),
    "glass": Grey("dielectric", eta=1.5),
    "tinted glass": Grey("dielectric", reflection=0.7, transmission=0.6, eta=1.33),
    "diamond": Grey("dielectric", eta=2.4),
    "almost no glass": Grey("dielectric", eta=1.0001),
    "no glass": Grey("dielectric", eta=1.0),
    "pane": Grey("thindielectric", eta=1.5),
    "tinted pane": Grey("thindielectric", reflection=0.9, transmission=0.5, eta=1.7),
    "plastic": Grey("plastic", hidden(1.5), eta=1.5),
    "dark plastic": Grey("plastic", hidden(1.9, 0.3), reflection=0.8, eta=1.9),
    "null": Grey("null"),
}
SMOOTH = ("diffuse", "white", "plastic", "dark plastic")
LOSSLESS = ("white", "mirror", "glass", "diamond", "almost no glass", "no glass", "pane", "plastic",
            "null")  # fmt: skip
#: Of incidence, degrees.
ANGLES = (0.0, 30.0, 60.0, 80.0, 89.0, 89.9)
NORMAL = single(normalised(np.array([[0.3, -0.5, 0.81]])))[0]


def view(angle: float) -> tuple[Array, Array]:
    """Direction wo at an angle to NORMAL, float32; a frame whose rows are tangents and NORMAL."""
    n = normalised(NORMAL[None])[0]
    a = normalised(np.cross(n, [[0.0, 1.0, 0.2]]))[0]
    frame = np.stack([a, np.cross(n, a), n])
    turn = math.radians(angle)
    wo = single(np.array([math.sin(turn) * 0.6, math.sin(turn) * 0.8, math.cos(turn)]) @ frame)
    return wo, frame


def sampled(t: Trial, grey: Grey, front: bool, wo: Array, u: Any, v: Any, lobe: Any,
            importance: bool = False) -> Array:  # fmt: skip
    """Rows of wi (3), weight, pdf, transmitted, pass, probability of the mirror, and, where
    `importance` is wanted, the weight if wo carries it."""
    name = "bsdf_sample" if importance else "bsdf_sample_radiance"
    return hooked(t, name, *grey.columns(front), *NORMAL, *wo, u, v, lobe)


def evaluated(t: Trial, grey: Grey, front: bool, wo: Array, wi: Array) -> Array:
    """Rows of f cos, pdf, the share that passes straight through, pdf of wo from wi, albedo."""
    return hooked(t, "bsdf_eval", *grey.columns(front), *NORMAL, *wo, *wi.T)


@case(2, each={"name": SMOOTH, "angle": ANGLES})
def material_directions(t: Trial, name: str, angle: float) -> None:
    """Directions of the smooth lobe, from normal to grazing incidence.

    Cosine-distributed; samples that go to the mirror instead are a cell of their own. 10^5
    samples: sees 1 % in scale, 4 % in tilt, and 2 % of a half lost.
    """
    grey, (wo, frame) = MATERIALS[name], view(angle)
    n = N * t.effort
    s = sampled(t, grey, True, wo, *random_numbers(t, n)[1:])
    local = s[s[:, 4] > 0, :3] @ frame.T
    t.check(local[:, 2] > 0, "below the surface")
    u, v = INVERSE["cosine_hemisphere"](local)
    smooth = 1 - grey.chosen(grey.mirror(float(wo @ frame[2]), True))
    uniform(t, np.clip(u, 0, 1), v, name, n, smooth)


@case(2, each={"name": MATERIALS, "front": [True, False]})
def material_weights(t: Trial, name: str, front: bool) -> None:
    """eval, sample and pdf of a material agree, six angles, both sides.

    Smooth: the two pdfs and weight = f cos / pdf within 1e-6 + 3e-7 / cos (below 1e-5 except for
    grazing directions, whose cosine is rounded), f >= 0, no light from below. Delta: the mirror's
    and Snell's directions within 1e-6 (2e-5 if a grazing ray is refracted), pdf 0, the weight equal
    to its colour, for transmission over the squared index, of plastic by how often it is selected.
    """
    grey = MATERIALS[name]
    relative = grey.relative(front)
    for angle in ANGLES:
        wo, frame = view(angle)
        cos_o = float(wo @ frame[2])
        s = sampled(t, grey, front, wo, *random_numbers(t, 2000)[1:], importance=True)
        wi, weight, pdf, through, passes = s[:, :3], s[:, 3], s[:, 4], s[:, 5] > 0, s[:, 6] > 0
        t.check(np.isfinite(s), "not finite")
        t.check(np.abs(np.linalg.norm(wi, axis=1) - 1).max() < 1e-6, "length")
        t.check(s[:, 7] >= 0)
        local = wi @ frame.T
        own = wo @ frame.T
        smooth = (pdf > 0) & ~passes
        mirror = ~smooth & ~through & ~passes
        t.check(smooth.any() == (grey.kind in ("diffuse", "plastic")), "smooth lobe")
        if smooth.any():
            e = evaluated(t, grey, front, wo, wi[smooth])
            slack = 1e-6 + 3e-7 / local[smooth, 2]
            t.check(np.abs(pdf[smooth] / e[:, 1] - 1) < slack, "pdf")
            t.check(np.abs(weight[smooth] * pdf[smooth] / e[:, 0] - 1) < slack, "weight")
            t.check(e[:, 0] >= 0, "negative")
            below = evaluated(t, grey, front, wo, -wi[smooth])
            t.check(below[:, :2] == 0, "from below")
        else:
            t.check(evaluated(t, grey, front, wo, wi)[:, :2] == 0, "eval of a delta lobe")
        off = np.abs(local[mirror] - own * [-1, -1, 1])
        t.check(off.max(initial=0) < 1e-6, f"mirror at {angle}")
        colour = grey.reflection
        if grey.kind == "conductor":
            colour *= float(fresnel(cos_o, grey.eta, grey.k))
        if grey.kind == "plastic":
            colour *= grey.mirror(cos_o, front) / grey.chosen(grey.mirror(cos_o, front))
        t.check(np.abs(weight[mirror] - colour).max(initial=0) < 2e-6, f"mirror's weight {angle}")
        if through.any():
            t.check(grey.kind == "dielectric", "transmitted")
            snell = refracted(normalised(own[None]), relative)
            steep = abs(float(snell[0, 2]))
            off = np.abs(local[through] - snell).max()
            t.check(off < 1e-6 / min(1.0, 20 * steep), f"refraction at {angle}: {off:.2g}")
            exact = grey.transmission / relative**2
            t.check(np.abs(weight[through] / exact - 1).max() < 1e-6, "weight of refraction")
        t.check(np.abs(wi[passes] + wo).max(initial=0) == 0, "passes are straight")
        if grey.kind in ("thindielectric", "null"):
            share = 1 - grey.mirror(cos_o, front)
            t.check(np.abs(weight[passes] - grey.transmission).max(initial=0) < 1e-6, "pass")
            passed = evaluated(t, grey, front, wo, wi)[:, 2]
            t.check(np.abs(passed - share * grey.transmission).max() < 2e-6, "share that passes")


GLASSY = ("glass", "tinted glass", "diamond", "almost no glass", "no glass", "pane", "tinted pane",
          "plastic", "dark plastic")  # fmt: skip


@case(2, each={"name": GLASSY, "front": [True, False]})
def lobe_choice(t: Trial, name: str, front: bool) -> None:
    """How often the mirror is selected, six angles.

    Exact binomial with the Fresnel reflectance of float64, of plastic with the part that the mirror
    has of what both lobes send on; 10^5 samples per angle: sees 0.7 % (absolute) at worst. Total
    reflection leaves no other choice.
    """
    grey, n = MATERIALS[name], N * t.effort
    for angle in ANGLES:
        wo, frame = view(angle)
        s = sampled(t, grey, front, wo, *random_numbers(t, n)[1:])
        mirror = int(((s[:, 5] == 0) & (s[:, 6] == 0) & (s[:, 4] == 0)).sum())
        cos_o = float(wo @ frame[2])
        p = grey.mirror(cos_o, front)
        slack = 2e-6 + steepness(cos_o, grey.relative(front))
        t.check(np.abs(s[:, 7] - p) < slack, f"reflectance at {angle}")
        if p in (0.0, 1.0):
            t.check(mirror == p * n, f"mirror at {angle}")
        else:
            count(t, mirror, n, grey.chosen(p), f"mirror at {angle}")


def steepness(cosine: Any, eta: Any, k: Any = 0.0) -> Array:
    """Change of Fresnel's reflectance when the index changes by two units in its last place."""
    near = [fresnel(cosine, eta * (1 + e), k) for e in (-1.2e-7, 0.0, 1.2e-7)]
    change: Array = np.abs(near[1] - near[0]) + np.abs(near[2] - near[1])
    return change


def hemisphere(frame: Array, n: int = 48) -> tuple[Array, Array]:
    """Quadrature over the hemisphere about frame[2]: directions (float32), weights."""
    c, w = gauss(n, 0, 1)
    turn = (np.arange(n) + 0.5) / n * 2 * np.pi
    sine = np.sqrt(1 - c**2)
    p = np.stack([np.outer(sine, np.cos(turn)), np.outer(sine, np.sin(turn)),
                  np.outer(c, np.ones(n))], axis=-1).reshape(-1, 3)  # fmt: skip
    return single(p @ frame), np.repeat(w * 2 * np.pi / n, n)


@case(2, each={"name": MATERIALS, "front": [True, False]})
def energy(t: Trial, name: str, front: bool) -> None:
    """The pdf integrates to its lobe's probability; no material returns more than it gets.

    Quadrature over the hemisphere at six angles, within 1e-4: of the pdf the probability, of f cos
    the albedo of float64. All lobes together at most 1, of lossless materials 1 within 2e-5.
    """
    grey = MATERIALS[name]
    for angle in ANGLES:
        wo, frame = view(angle)
        cos_o = float(wo @ frame[2])
        wi, weights = hemisphere(frame)
        f_cos, pdf, passed = evaluated(t, grey, front, wo, wi)[:, :3].T
        mirror = grey.mirror(cos_o, front)
        chosen, smooth_lobe = grey.chosen(mirror), grey.kind in ("diffuse", "plastic")
        chance = 1 - chosen if smooth_lobe else 0.0
        t.check(abs(weights @ pdf - chance) < 1e-4, f"pdf at {angle}: {weights @ pdf}")
        albedo = (1 - mirror) * grey.albedo if smooth_lobe else 0.0
        if grey.kind == "plastic":
            albedo *= transmitted(grey.eta)
        smooth = float(weights @ f_cos)
        t.check(abs(smooth - albedo) < 1e-4, f"albedo at {angle}: {smooth} for {albedo}")
        s = sampled(t, grey, front, wo, 0.5, 0.5, np.array([0.0, 1 - 2.0**-24]))
        total = smooth
        if mirror > 0:
            total += chosen * s[0, 3]
        if grey.kind == "dielectric" and mirror < 1:
            t.check(s[1, 5] == 1, "refraction")
            total += (1 - mirror) * s[1, 3] * grey.relative(front) ** 2
        total += float(passed[0])
        t.check(total <= 1 + 2e-5, f"{total} at {angle}")
        if name in LOSSLESS:
            t.check(abs(total - 1) < 2e-5, f"{total} at {angle}")


@case(2, each={"name": MATERIALS, "front": [True, False]})
def albedo_by_samples(t: Trial, name: str, front: bool) -> None:
    """At no incidence does a material return more than it gets, by the weights of samples.

    Lobes by their probability, the mean weight of each by quadrature over its random numbers, of
    refraction times the squared index: at most 1 + 1e-4, of lossless materials 1 within 1e-4;
    sixteen angles, four of them down to a cosine of 1e-4.
    """
    grey, (x, w) = MATERIALS[name], gauss(32, 0, 1)
    # nodes crowd at u = 1, where the base of plastic meets its horizon
    u, v = np.repeat(1 - x * x, 8), np.tile((np.arange(8) + 0.5) / 8, 32)
    weights = np.repeat(2 * x * w / 8, 8)
    for cosine in (*t.rng.random(12), 1e-1, 1e-2, 1e-3, 1e-4):
        wo, _ = view(math.degrees(math.acos(cosine)))
        albedo, left = 0.0, 1.0
        for lobe in (0.0, 1 - 2.0**-24):
            s = sampled(t, grey, front, wo, u, v, lobe)
            chance = float(grey.chosen(s[0, 7])) if lobe == 0 else left
            squared = np.where(s[:, 5] > 0, grey.relative(front) ** 2, 1)
            albedo, left = albedo + chance * float(weights @ (s[:, 3] * squared)), left - chance
        t.check(albedo <= 1 + 1e-4, f"{albedo} at a cosine of {cosine}")
        if name in LOSSLESS:
            t.check(albedo >= 1 - 1e-4, f"{albedo} at a cosine of {cosine}")


@case(2, each={"name": SMOOTH})
def reciprocity(t: Trial, name: str) -> None:
    """f(a, b) = f(b, a) for 10^5 pairs of directions.

    Relative 1e-5 for cosines above 0.01; the rounding of 1 - F counts below.
    """
    n = 100_000 * t.effort
    grey, (_, frame) = MATERIALS[name], view(0.0)
    p = random_points(t, "cosine_hemisphere", 2 * n)
    wo, wi = single(p @ frame).reshape(2, n, 3)
    columns = grey.columns(True)
    forth, back = (hooked(t, "bsdf_eval", *columns, *NORMAL, *a.T, *b.T)[:, 0] / (b @ frame[2])
                   for a, b in ((wo, wi), (wi, wo)))  # fmt: skip
    least = np.minimum(wo @ frame[2], wi @ frame[2])
    off = np.abs(forth / back - 1)
    t.check(off[least > 0.01].max() < 1e-5, f"off by {off[least > 0.01].max():.2g}")
    t.check(off.max() < 0.1, f"off by {off.max():.2g}")


@case(2, each={"name": SMOOTH})
def reverse_density(t: Trial, name: str) -> None:
    """The density of sampling wo from wi is that of sampling wi from wo with the roles changed.

    For 10^5 pairs of directions, to the bit, from both sides of the surface.
    """
    n = 100_000 * t.effort
    grey, (_, frame) = MATERIALS[name], view(0.0)
    wo, wi = single(random_points(t, "cosine_hemisphere", 2 * n) @ frame).reshape(2, n, 3)
    for front in (True, False):
        columns = grey.columns(front)
        forth, back = (hooked(t, "bsdf_eval", *columns, *NORMAL, *a.T, *b.T)
                       for a, b in ((wo, wi), (wi, wo)))  # fmt: skip
        t.check(bool((forth[:, 3] == back[:, 1]).all() and (back[:, 3] == forth[:, 1]).all()))
        t.check(float(forth[:, 1].min()) > 0, "no density")


@case(2, each={"name": tuple(MATERIALS)})
def importance_is_not_compressed(t: Trial, name: str) -> None:
    """What refraction scales radiance by, the squared relative index, importance does without.

    10^4 samples of each side: weights of importance are those of radiance, where light is refracted
    times the squared index within 4 units of 2^-24, elsewhere to the bit.
    """
    grey = MATERIALS[name]
    for front in (True, False):
        wo, _ = view(math.degrees(math.acos(t.rng.random())))
        u, v, lobe = single(t.rng.random((3, 10_000 * t.effort)) * (1 - 2.0**-24))
        s = sampled(t, grey, front, wo, u, v, lobe, importance=True)
        refracted = s[:, 5] > 0
        t.check(bool((s[~refracted, 8] == s[~refracted, 3]).all()))
        scaled = s[refracted, 3].astype(np.float64) * single(grey.relative(front)) ** 2
        t.check(bool((np.abs(s[refracted, 8] / scaled - 1) < 4 * 2.0**-24 + 1e-7).all()))


@case(2, each={"name": tuple(MATERIALS)})
def albedo_is_what_goes_on(t: Trial, name: str) -> None:
    """The albedo for feature images is the mean weight of importance over lobes and directions.

    By quadrature at 16 cosines: within 1e-5; of plastic, whose base it takes at one cosine, within
    0.01.
    """
    grey, (x, w) = MATERIALS[name], gauss(32, 0, 1)
    u, v = np.repeat(1 - x * x, 8), np.tile((np.arange(8) + 0.5) / 8, 32)
    weights = np.repeat(2 * x * w / 8, 8)
    margin = 0.01 if grey.kind == "plastic" else 1e-5
    for front in (True, False):
        for cosine in t.rng.random(16):
            wo, _ = view(math.degrees(math.acos(cosine)))
            total, left = 0.0, 1.0
            for lobe in (0.0, 1 - 2.0**-24):
                s = sampled(t, grey, front, wo, u, v, lobe, importance=True)
                chance = float(grey.chosen(s[0, 7])) if lobe == 0 else left
                total, left = total + chance * float(weights @ s[:, 8]), left - chance
            told = float(evaluated(t, grey, front, wo, wo[None])[0, 4])
            t.check(abs(told - total) < margin, f"{told} instead of {total} at {cosine}")


@case(2, each={"eta": [1.0001, 1.33, 1.5, 2.4]})
def reciprocity_of_refraction(t: Trial, eta: float) -> None:
    """Reflectance from both sides is the same, and so is f(a, b) / n_b^2.

    10^4 angles: R(cos_i, eta) = R(cos_t, 1 / eta) within 1e-5 / cos_i. A refracted direction, sent
    back, gives the original one within 1e-6 / cos, and weight times the squared index is equal
    within 1e-6: with the reflectances, f(a, b) / n_b^2 = f(b, a) / n_a^2.
    """
    cos_i = single(t.rng.random(10_000 * t.effort))
    r, cos_t = hooked(t, "fresnel_dielectric", cos_i, eta).T
    back, cos_again = hooked(t, "fresnel_dielectric", cos_t, 1 / single(eta)).T
    steep = cos_i > 0.01
    off = (np.abs(back - r) * cos_i)[steep].max()
    t.check(off < 1e-5, f"reflectance off by {off:.2g} / cos")
    t.check((np.abs(cos_again - cos_i) * cos_i)[steep].max() < 1e-6, "cosine")
    grey = Grey("dielectric", reflection=0.7, transmission=0.6, eta=eta)
    _, frame = view(0.0)
    wo = single(random_points(t, "cosine_hemisphere", 10_000 * t.effort) @ frame)
    for front in (True, False):
        columns = grey.columns(front), grey.columns(not front)
        forth = hooked(t, "bsdf_sample", *columns[0], *NORMAL, *wo.T, 0.5, 0.5, 1 - 2.0**-24)
        through = forth[:, 5] > 0
        t.check(through.mean() > 0.1, "nothing is refracted")
        forth, came = forth[through], wo[through]
        back = hooked(t, "bsdf_sample", *columns[1], *-NORMAL, *forth[:, :3].T, 0.5, 0.5,
                      1 - 2.0**-24)  # fmt: skip
        again = back[:, 5] > 0
        cosine = np.minimum(came @ NORMAL, -(forth[:, :3] @ NORMAL))
        t.check(again[cosine > 1e-3], "no way back")
        off = np.abs(back[:, :3] - came).max(axis=1) * cosine
        t.check(off[again].max() < 1e-6, f"direction off by {off[again].max():.2g} / cos")
        carried = [s[again, 3] * grey.relative(side) ** 2
                   for s, side in ((forth, front), (back, not front))]  # fmt: skip
        t.check(np.abs(carried[0] - carried[1]).max() < 1e-6, "squared index")


INDICES = (1e-3, 1 / 2.4, 1 / 1.5, 1 / 1.0001, 1.0, 1.0001, 1.33, 1.5, 2.4, 4.0, 1e3)


@case(2, each={"eta": INDICES})
def fresnel_dielectric(t: Trial, eta: float) -> None:
    """Fresnel's reflectance of a dielectric at 20,000 cosines against float64.

    Within 1e-6 and what two last places of the index make; total reflection is exactly 1, a matched
    index exactly 0.
    """
    cosine = single(np.concatenate([t.rng.random(20_000), [0, 1, 2.0**-24, 0.5]]))
    exact = single(eta)
    r, cos_t = hooked(t, "fresnel_dielectric", cosine, eta).T
    slack = 1e-6 + steepness(cosine, exact) * (exact != 1)
    t.check(np.abs(r - fresnel(cosine, exact)) <= slack, "reflectance")
    t.check((r >= 0) & (r <= 1), "range")
    sin2 = (1 - cosine**2) / exact**2
    if exact != 1:
        t.check(r[sin2 > 1 + 1e-6] == 1, "total reflection")
    else:
        t.check(r == 0, "matched")
    inside = sin2 < 1
    t.check(np.abs(cos_t**2 - (1 - sin2))[inside].max() < 1e-6, "Snell")


@case(2)
def fresnel_values(t: Trial) -> None:
    """Fresnel's reflectance at values from tables, index 1.5.

    0, 30, 45, 60, 75, 85 degrees: .040000 .041523 .050240 .089187 .253061 .612800 within 1e-6;
    of diffuse light .091778 from outside and .596346 from inside.
    """
    cosine = np.cos(np.radians([0, 30, 45, 60, 75, 85]))
    r = hooked(t, "fresnel_dielectric", cosine, 1.5)[:, 0]
    table = [0.040000, 0.041523, 0.050240, 0.089187, 0.253061, 0.612800]
    t.check(np.abs(r - table).max() < 1e-6, f"{r}")
    x, w = gauss(200, 0, 1)
    for eta, value in ((1.5, 0.091778), (1 / 1.5, 0.596346)):
        start = math.sqrt(max(1 - eta * eta, 0))  # of partial reflection; a root begins there
        c = start + (1 - start) * x * x
        r = hooked(t, "fresnel_dielectric", c, eta)[:, 0]
        mean = start**2 + (r * 2 * c * 2 * x * (1 - start) * w).sum()
        t.check(abs(mean - value) < 2e-6, f"{mean} for {value}")
    inside = hooked(t, "fresnel_dielectric", [0.5], 1 / 1.5)[:, 0]
    t.check(inside == 1, "total reflection at 60 degrees")


@case(2)
def fresnel_conductor(t: Trial) -> None:
    """Fresnel's reflectance of conductors at 50,000 (cosine, eta, k) against complex amplitudes.

    eta from 0.01 to 10, k from 0 to 20: within 1e-6 and what two last places of index and cosine
    make; eta = 0 reflects all.
    """
    n = 50_000 * t.effort
    c, eta = single(t.rng.random(n)), single(10 ** t.rng.uniform(-2, 1, n))
    k = single(np.where(t.rng.random(n) < 0.1, 0, t.rng.uniform(0, 20, n)))
    r = hooked(t, "fresnel_conductor", c, eta, k)[:, 0]
    exact = fresnel(c, eta, k)
    t.check(np.isfinite(r), "not finite")
    t.figure("largest error", float(np.abs(r - exact).max()))
    near = [fresnel(np.minimum(c + e, 1), eta, k) - exact for e in (-1.2e-7, 1.2e-7)]
    slack = 1e-6 + steepness(c, eta, k) + np.abs(near).sum(axis=0)
    off = np.abs(r - exact) / slack
    t.check(off.max() < 1, f"{off.max():.2g} times that at cos {c[off.argmax()]}")
    t.check((r >= -1e-6) & (r <= 1 + 1e-6), "range")
    perfect = hooked(t, "fresnel_conductor", c[:1000], 0.0, np.maximum(k[:1000], 0.1))[:, 0]
    t.check(np.abs(perfect - 1).max() < 2e-6, "eta 0")


@case(2, each={"name": MATERIALS})
def material_corners(t: Trial, name: str) -> None:
    """A material's samples for random numbers at the end of their range.

    u, v, lobe in {0, 2^-24, 1/2, 1 - 2^-24}, six angles, both sides: unit directions (1e-5), finite
    weights, pdf positive or that of a delta lobe, on the right side.
    """
    grey = MATERIALS[name]
    u, v, lobe = np.array(list(itertools.product(CORNERS, repeat=3))).T
    for angle, front in itertools.product(ANGLES, (True, False)):
        wo, _ = view(angle)
        s = sampled(t, grey, front, wo, u, v, lobe, importance=True)
        t.check(np.isfinite(s), f"not finite at {angle}")
        t.check(np.abs(np.linalg.norm(s[:, :3], axis=1) - 1).max() < 1e-5, "length")
        t.check((s[:, 3] >= 0) & (s[:, 4] >= 0), "negative")
        up = s[:, :3] @ NORMAL
        beyond = (s[:, 5] > 0) | (s[:, 6] > 0)
        t.check((up > 0) == ~beyond, f"wrong side at {angle}")


# ---- in renders ----


@case(2, each={"front": [True, False], "angle": [0.0, 40.0, 75.0]})
def mirrors_in_renders(t: Trial, front: bool, angle: float) -> None:
    """How often camera rays on glass are reflected, seen from both sides.

    Reflected ones escape, refracted ones end at a black wall: counts of the ledger by an exact
    binomial with the Fresnel reflectance; 10^5 rays: sees 0.7 % (absolute).
    """
    turn, size = math.radians(angle), 50.0
    eye = np.array([math.sin(turn), 0.0, math.cos(turn) * (1 if front else -1)])
    pane = quad([-size, -size, 0], [2 * size, 0, 0], [0, 2 * size, 0],
                material=material("dielectric", eta=1.5))  # fmt: skip
    beyond = -1.0 if front else 1.0
    wall = quad([-size, -size, beyond], [2 * size, 0, 0], [0, 2 * size, 0])
    scene = make([pane, wall], camera(eye, [0, 0, 0], 0.001), max_depth=3)
    n = N * t.effort
    ledger = t.render(scene, N, rr_depth=100).stats["ledger"]
    away, through = (ledger[name] + [0, 0] for name in ("escaped", "absorbed"))
    t.check(away[1] + through[1] == n, "counts")
    p = float(fresnel(math.cos(turn), 1.5 if front else 1 / 1.5))
    if p == 1:
        t.check(through[1] == 0, "total reflection")
    else:
        count(t, away[1], n, p, "reflected")


@case(2, each={"opacity": [0.0, 0.25, 0.7, 1.0]})
def masks_in_renders(t: Trial, opacity: float) -> None:
    """Camera rays on a black mask: opaque parts absorb them, open parts let them pass.

    Counts by an exact binomial; 10^5 rays: sees 0.7 % (absolute). 0 and 1 are exact.
    """
    plane = quad([-5, -5, 0], [10, 0, 0], [0, 10, 0], material={"opacity": opacity})
    ledger = t.render(make([plane], camera([0.2, 0.1, 3], [0, 0, 0])), N).stats["ledger"]
    absorbed, n = sum(ledger["absorbed"]), N * t.effort
    t.check(absorbed + sum(ledger["escaped"]) == n, "counts")
    if opacity in (0.0, 1.0):
        t.check(absorbed == opacity * n, "all or nothing")
    else:
        count(t, absorbed, n, float(single(opacity)), "absorbed")


@case(2, each={"name": ["diffuse", "plastic"]})
def directions_of_paths(t: Trial, name: str) -> None:
    """Directions and weights of whole paths at a wall, as the renderer takes them.

    Replayed on the CPU, 10^4 paths: cosine-distributed about the normal, the mirror a cell of its
    own; diffuse paths carry exactly the reflectance. Sees 3 % in scale, 12 % in tilt.
    """
    look = {} if name == "diffuse" else material("plastic", eta=1.5)
    floor = quad([-9, -9, 0], [18, 0, 0], [0, 18, 0], 0.5, material=look)
    n = 10_000 * t.effort
    paths = replayed(t, make([floor], camera([0.4, 0.6, 0.4], [0, 0, 0])), n, 3)
    wi = np.array([p[1]["direction"] for p in paths])
    weight = np.array([p[1]["throughput"][0] for p in paths])
    wo = -np.array([p[0]["direction"] for p in paths])
    if name == "diffuse":
        t.check(weight == 0.5, "weight")
        uniform(t, *INVERSE["cosine_hemisphere"](wi), "directions")
        return
    mirror = np.abs(wi - wo * [-1, -1, 1]).max(axis=1) < 1e-5
    reflected, base = fresnel(wo[:, 2], 1.5), hidden(1.5, 0.5)
    chosen = Grey("plastic", base).chosen(reflected)
    beneath = base * (1 - fresnel(wi[:, 2], 1.5)) * (1 - reflected) / (1 - chosen)
    off = np.abs(weight / np.where(mirror, reflected / chosen, beneath) - 1)
    t.check(off < 1e-4, f"weight off by {off.max():.2g}")
    u, v = INVERSE["cosine_hemisphere"](wi[~mirror])
    uniform(t, u, v, "directions", n, 1 - float(chosen.mean()))
