"""geometry/sphere, geometry/disk and lights/sphere_light against long doubles, and no self-hits.

Radii run from 1e-6 to 1e6 with surfaces through [-1, 1]^3, as scenes are normalised.
"""

from __future__ import annotations

import numpy as np
import pytest

from tests.support import FAST, Part, make, native, native_scene

Array = np.ndarray
#: Sphere radii, lower ends of a decade; "ground": 0.5 to 1, seen from 5e-7 above.
RADII = [10.0**k for k in range(-6, 6)]


def evaluate(device: str, name: str, *columns: Array | float) -> Array:
    """Columns of float32, (n,) or (n, k), to rows of float32."""
    n = max(len(np.atleast_1d(np.asarray(c))) for c in columns)
    parts = [np.broadcast_to(np.asarray(c, np.float32), (n,)) if np.ndim(c) < 2 else c
             for c in columns]  # fmt: skip
    rows = np.concatenate([np.asarray(p, np.float32).reshape(n, -1) for p in parts], axis=1)
    out: Array = native(device).eval_function(name, rows)
    return out


def directions(rng: np.random.Generator, n: int) -> Array:
    v = rng.normal(size=(n, 3))
    return v / np.linalg.norm(v, axis=1)[:, None]


def unit(v: Array) -> Array:
    """float32 of unit length, to within rounding."""
    return (v / np.linalg.norm(v, axis=1)[:, None]).astype(np.float32)


class Spheres:
    """Spheres with a point of the surface uniform in [-reach, reach]^3 and its outward normal."""

    def __init__(self, rng: np.random.Generator, n: int, low: float, high: float,
                 reach: float = 1.0) -> None:  # fmt: skip
        self.radius = np.exp(rng.uniform(np.log(low), np.log(high), n))
        self.at, self.normal = rng.uniform(-reach, reach, (n, 3)), directions(rng, n)
        centre = self.at - self.normal * self.radius[:, None]
        exact = np.concatenate([centre, self.radius[:, None]], axis=1)
        high_part = exact.astype(np.float32)
        low_part = (exact - high_part).astype(np.float32)
        self.record = np.concatenate([high_part[:, :3], low_part[:, :3],
                                      high_part[:, 3:], low_part[:, 3:]], axis=1)  # fmt: skip
        sums = high_part.astype(np.longdouble) + low_part
        self.centre, self.r = sums[:, :3], sums[:, 3]


def dot(a: Array, b: Array) -> Array:
    total: Array = (a * b).sum(axis=1)
    return total


class Exact:
    """The line o + t d against spheres in long doubles: t of the first hit (infinite: none),
    normal there, square of half the chord over r^2, height of o over the surface."""

    def __init__(self, s: Spheres, o: Array, d: Array) -> None:
        f, d = o.astype(np.longdouble) - s.centre, d.astype(np.longdouble)
        a = dot(d, d)
        middle = -dot(f, d) / a
        nearest = f + middle[:, None] * d
        square = (s.r**2 - dot(nearest, nearest)) / a
        half = np.sqrt(np.maximum(square, 0))
        far = middle + np.where(middle < 0, -half, half)
        outside = (dot(f, f) - s.r**2) / a
        with np.errstate(divide="ignore", invalid="ignore"):
            near = outside / far
        t = np.where(near > 0, near, far)
        self.square = square / s.r**2
        self.t = np.where((square >= 0) & (t > 0), t, np.inf)
        self.normal = (f + np.where(np.isinf(self.t), 0, self.t)[:, None] * d) / s.r[:, None]
        self.height = outside / (np.sqrt(dot(f, f)) + s.r)


def aimed(rng: np.random.Generator, s: Spheres, o: Array) -> Array:
    """Half of the directions at points of the ball about each sphere, 1 % larger; half random."""
    n = len(o)
    target = s.centre + s.r[:, None] * directions(rng, n) * 1.01 * rng.random((n, 1)) ** (1 / 3)
    towards = (target - o.astype(np.longdouble)).astype(np.float64)
    return unit(np.where(np.arange(n)[:, None] % 2, towards, directions(rng, n)))


@pytest.mark.parametrize("radius", RADII[::3])
def test_first_hit(device: str, radius: float) -> None:
    """From 1e-6 to 1e6 radii off the surface, outside and inside: the same answer unless the ray
    passes within 1e-9 r^2 of tangency; t within 1e-6 of itself; normal within 3e-7."""
    rng = np.random.default_rng(1)
    for exponent in range(-6, 7, 2):
        for side in (1, -1) if exponent < 0 else (1,):
            s = Spheres(rng, 4_000, radius, 10 * radius)
            away = (s.r * (1 + side * 10.0**exponent))[:, None]
            tilt = s.normal + directions(rng, 4_000) / np.maximum(s.radius, 0.1)[:, None]
            o = (s.centre + unit(tilt) * away).astype(np.float32)
            d = aimed(rng, s, o)
            exact = Exact(s, o, d)
            got = evaluate(device, "sphere", s.record, o, d, np.inf).astype(np.float64)
            clear = np.abs(exact.square) > 1e-9
            assert (np.isinf(got[:, 0]) == np.isinf(exact.t))[clear].all()
            hit = clear & np.isfinite(exact.t) & np.isfinite(got[:, 0])
            assert hit.sum() > 1_000
            off_surface = hit & (np.abs(exact.height) > 5e-7 * s.r)
            assert np.abs(got[off_surface, 0] / exact.t[off_surface] - 1).max() < 1e-6
            if exponent <= 4:
                plain = hit & (exact.square > 1e-5)
                assert np.abs(got[:, 4:7] - exact.normal)[plain].max() < 3e-7
            assert np.abs(np.linalg.norm(got[hit, 4:7], axis=1) - 1).max() < 3e-7
            off = np.linalg.norm(got[:, 1:4] - s.centre, axis=1) - s.r
            if exponent <= 4:
                assert (np.abs(off) / got[:, 7])[hit].max() < 0.75


def test_ground_seen_from_above(device: str) -> None:
    """A radius of 0.5 to 1, the camera 5e-7 above: t within 1e-6 of the exact one."""
    rng = np.random.default_rng(2)
    s = Spheres(rng, 50_000, 0.5, 1.0, 1e-3)
    o = (s.at + 5e-7 * s.normal).astype(np.float32)
    d = unit(directions(rng, 50_000) - rng.random((50_000, 1)) * s.normal)
    exact = Exact(s, o, d)
    got = evaluate(device, "sphere", s.record, o, d, np.inf)[:, 0]
    clear = np.abs(exact.square) > 1e-12
    assert (np.isinf(got) == np.isinf(exact.t))[clear].all()
    hit = clear & np.isfinite(exact.t)
    assert hit.sum() > 25_000 and np.median(exact.t[hit]) < 1e-5
    assert np.abs(got[hit] / exact.t[hit] - 1).max() < 1e-6


def test_the_plain_quadratic_would_not_do() -> None:
    """Planted: b^2 - c in float32 errs by more than a tenth in 6 % of the hits of near ground, and
    in 28 % of those of spheres 10,000 radii away."""
    rng = np.random.default_rng(3)
    for s, away in ((Spheres(rng, 5_000, 0.5, 1.0), 1e-6), (Spheres(rng, 5_000, 1e-4, 1e-4), 1e4)):
        o = (s.centre + s.normal * s.r[:, None] * (1 + away)).astype(np.float32)
        d = aimed(rng, s, o)[1::2]
        exact = Exact(s, o, np.repeat(d, 2, axis=0))
        f = (o - s.record[:, :3])[1::2]
        b, c = dot(f, d), dot(f, f) - s.record[1::2, 6] ** 2
        t = -b - np.sqrt(np.maximum(b * b - c, np.float32(0)))
        hit = np.isfinite(exact.t[1::2]) & (exact.square[1::2] > 0.01)
        wrong = (b * b - c < 0) | (np.abs(t / exact.t[1::2] - 1) > 0.1)
        assert wrong[hit].mean() > 0.05


def test_tangents_and_limits(device: str) -> None:
    """Rays about the silhouette agree with the exact sign where it is clear; t_max is exclusive."""
    rng = np.random.default_rng(4)
    n = 20_000
    s = Spheres(rng, n, 1e-6, 1e6)
    away = s.r * (1 + 10 ** rng.uniform(-3, 3, n))
    o = (s.centre + s.normal * away[:, None]).astype(np.float32)
    f = o.astype(np.longdouble) - s.centre
    length = np.sqrt(dot(f, f))
    side = np.cross(f, directions(rng, n))
    side /= np.sqrt(dot(side, side))[:, None]
    sine = np.minimum(s.r / length * (1 + 10 ** rng.uniform(-9, -2, n) * rng.choice([-1, 1], n)), 1)
    d = unit(side * sine[:, None] - f / length[:, None] * np.sqrt(1 - sine**2)[:, None])
    exact = Exact(s, o, d)
    got = evaluate(device, "sphere", s.record, o, d, np.inf)
    clear = np.abs(exact.square) > 1e-9
    assert (np.isinf(got[:, 0]) == np.isinf(exact.t))[clear].all()
    hit = np.isfinite(got[:, 0])
    assert n // 4 < hit.sum() < 3 * n // 4
    t = got[hit, 0]
    for t_max, met in ((np.nextafter(t, np.float32(np.inf)), True), (t, False), (0.5 * t, False)):
        again = evaluate(device, "sphere", s.record[hit], o[hit], d[hit], t_max)[:, 0]
        assert (np.isfinite(again) == met).all()


def leave(device: str, s: Spheres, o: Array, d: Array, rng: np.random.Generator,
          share: float = 1.0) -> tuple[Array, Array, int]:  # fmt: skip
    """Rays that leave from where o + t d meets spheres: counts of self-hits going out and of lost
    far sides going in, and how many there were. share: of the offset."""
    got = evaluate(device, "sphere", s.record, o, d, np.inf)
    hit = np.isfinite(got[:, 0]) & (np.abs(got[:, 1:4]).max(axis=1) < 2)
    record, p, n, offset = s.record[hit], got[hit, 1:4], got[hit, 4:7], share * got[hit, 7:]
    count = len(p)
    cosine = np.where(np.arange(count) % 2, rng.random(count), 10 ** rng.uniform(-9, 0, count))
    side = np.cross(n, directions(rng, count))
    side /= np.linalg.norm(side, axis=1)[:, None]
    wi = unit(n * cosine[:, None] + side * np.sqrt(1 - cosine**2)[:, None])
    up = dot(wi.astype(np.float64), n.astype(np.float64))
    record, p, n, offset, wi = (a[up > 0] for a in (record, p, n, offset, wi))
    wide = p.astype(np.float64)
    above, below = ((wide + k * n * offset).astype(np.float32) for k in (1, -1))
    out = np.isfinite(evaluate(device, "sphere", record, above, wi, np.inf)[:, 0])
    t = evaluate(device, "sphere", record, below, -wi, np.inf)[:, 0].astype(np.float64)
    chord = 2 * record[:, 6] * up[up > 0]
    slack = 8 * offset[:, 0] + 1e-5 * record[:, 6] + 4 * offset[:, 0] / up[up > 0]
    lost = ~(np.abs(t - chord) <= slack)
    return out, lost, len(out)


def count_self_hits(device: str, rays: int, share: float = 1.0) -> tuple[int, int]:
    """Self-hits going out and far sides lost going in; every radius, and the ground."""
    rng = np.random.default_rng(5)
    out = lost = done = 0
    while done < rays:
        for radius in [*RADII, 0.0]:
            n = 16_384
            s = Spheres(rng, n, radius, 10 * radius) if radius else Spheres(rng, n, 0.5, 1, 1e-3)
            o = rng.uniform(-1, 1, (n, 3)) if radius else s.at + 5e-7 * s.normal
            near = np.minimum(1, s.radius)[:, None] * directions(rng, n) * rng.random((n, 1))
            o = o.astype(np.float32)
            a, b, count = leave(device, s, o, unit(s.at + near - o), rng, share)
            out, lost, done = out + int(a.sum()), lost + int(b.sum()), done + count
    return out, lost


@pytest.mark.parametrize("device", FAST)
def test_no_self_hits(device: str) -> None:
    assert count_self_hits(device, 400_000) == (0, 0)


@pytest.mark.parametrize("device", FAST)
def test_an_eighth_of_the_offset_would_not_do(device: str) -> None:
    """Planted: the count finds an offset that is too small."""
    out, lost = count_self_hits(device, 100_000, 0.125)
    assert out > 5_000 and lost > 1_000


@pytest.mark.slow
@pytest.mark.parametrize("device", FAST)
def test_no_self_hits_of_ten_million_rays(device: str) -> None:
    assert count_self_hits(device, 10_000_000) == (0, 0)


# ---- sphere lights ----


def light_points(rng: np.random.Generator, s: Spheres, exponent: int, side: int) -> Array:
    away = (s.r * (1 + side * 10.0**exponent))[:, None]
    return np.asarray(s.centre + directions(rng, len(s.r)) * away, np.float64).astype(np.float32)


@pytest.mark.parametrize("radius", [1e-6, 1e-3, 1.0, 1e3])
def test_sphere_lights_fill_their_cone(device: str, radius: float) -> None:
    """pdf times the exact solid angle is 1 within 1e-6; wi meets the sphere at `distance` and
    under `cos_light`; both pdf functions are equal to the bit."""
    rng = np.random.default_rng(6)
    for exponent in range(-6, 7, 2):
        n = 4_000
        s = Spheres(rng, n, radius, 10 * radius)
        p = light_points(rng, s, exponent, 1)
        u, v = (rng.integers(0, 2**24, (2, n)) / 2**24).astype(np.float32)
        got = evaluate(device, "sphere_light", s.record, p, u, v)
        assert (got[:, 3].view(np.uint32) == got[:, 6].view(np.uint32)).all()
        got = got.astype(np.float64)
        f = p.astype(np.longdouble) - s.centre
        d2 = dot(f, f)
        outside = d2 > s.r**2 * (1 + 1e-9)
        cosine2 = np.maximum(d2 - s.r**2, 0) / d2
        solid = 2 * np.pi * s.r**2 / d2 / (1 + np.sqrt(cosine2))
        assert outside.sum() > 1_000
        assert np.abs(got[:, 3] * solid - 1)[outside].max() < 1e-6
        wi = got[:, :3]
        assert np.abs(np.linalg.norm(wi, axis=1) - 1).max() < 5e-7
        exact = Exact(s, p, wi)
        assert ((got[:, 4] > 0) & (got[:, 4] <= np.sqrt(d2) * 1.000001))[outside].all()
        if exponent <= 0:  # beyond, the rounding of wi counts
            plain = outside & (exact.square > 1e-3)
            assert np.isfinite(exact.t[plain]).all()
            assert np.abs(got[:, 4] / exact.t - 1)[plain].max() < 2e-5
            assert np.abs(got[:, 5] + dot(exact.normal, wi))[plain].max() < 2e-5


def test_sphere_lights_from_inside(device: str) -> None:
    """All directions alike; the far side is met, its inside."""
    rng = np.random.default_rng(7)
    n = 20_000
    for radius in (1e-3, 1.0, 1e3):
        s = Spheres(rng, n, radius, 10 * radius)
        depth = np.where(np.arange(n) % 2, 1.0, rng.uniform(1e-3, 1, n)) * s.r
        p = (s.centre + directions(rng, n) * (s.r - depth)[:, None]).astype(np.float32)
        u, v = rng.random((2, n))
        got = evaluate(device, "sphere_light", s.record, p, u, v).astype(np.float64)
        assert np.allclose(got[:, 3], 1 / (4 * np.pi), rtol=2e-7) and (got[:, 3] == got[:, 6]).all()
        exact = Exact(s, p, got[:, :3])
        assert np.abs(got[:, 4] / exact.t - 1).max() < 1e-5
        assert np.abs(got[:, 5] + dot(exact.normal, got[:, :3])).max() < 1e-5
        assert (got[:, 5] < 0).all()


def test_same_bits_on_every_device(device: str) -> None:
    rng = np.random.default_rng(8)
    n = 20_000
    s = Spheres(rng, n, 1e-6, 1e6)
    o = rng.uniform(-1, 1, (n, 3))
    d = unit(s.at + s.radius[:, None].clip(0, 1) * directions(rng, n) - o)
    u, v = rng.random((2, n))
    for name, rest in (("sphere", (o, d, np.inf)), ("sphere_light", (o, u, v))):
        ours, theirs = (evaluate(x, name, s.record, *rest) for x in (device, FAST[0]))
        assert (ours.view(np.uint32) == theirs.view(np.uint32)).all()


# ---- in scenes ----


def disk_hits(disks: Array, o: Array, d: Array) -> tuple[Array, Array]:
    """t of each ray with each disk (infinite: none); how far inside its rim, 1 at the centre."""
    c, a, b = (disks[None, :, k] for k in range(3))
    n = np.cross(a, b)
    to = c - o[:, None]
    t = (n * to).sum(-1) / (n * d[:, None]).sum(-1)
    q = o[:, None] + t[..., None] * d[:, None] - c
    aa, bb, ab = ((x * y).sum(-1) for x, y in ((a, a), (b, b), (a, b)))
    qa, qb = (q * a).sum(-1), (q * b).sum(-1)
    x, y = (bb * qa - ab * qb) / (aa * bb - ab**2), (aa * qb - ab * qa) / (aa * bb - ab**2)
    rim = 1 - np.hypot(x, y)
    return np.where((rim >= 0) & (t > 0), t, np.inf), rim


@pytest.mark.parametrize("count", [20, 200])
def test_disks_in_scenes(device: str, count: int) -> None:
    """Sheared ellipses, tested one after the other and in a tree, against float64."""
    rng = np.random.default_rng(9)
    disks = rng.normal(0, 0.2, (count, 3, 3))
    disks[:, 0] = rng.uniform(-1, 1, (count, 3))
    scene = make([Part(disks=disks)])
    o, d = rng.uniform(-1, 1, (5_000, 3)), directions(rng, 5_000)
    hits, rim = disk_hits(disks, o, d)
    t, at = hits.min(1), hits.argmin(1)
    got_t, got = native(device).intersect(native_scene(scene, device), o, d)
    second = np.partition(hits, 1, axis=1)[:, 1]
    clear = (np.abs(rim) > 1e-4).all(1) & (np.isinf(t) | (second > t + 1e-4))
    assert clear.mean() > 0.8
    assert (got == np.where(np.isinf(t), -1, at))[clear].all()
    hit = clear & np.isfinite(t)
    assert hit.sum() > 300
    error = np.abs(got_t[hit] - t[hit])
    assert np.median(error / t[hit]) < 3e-7 and np.quantile(error, 0.99) < 1e-5


@pytest.mark.parametrize("count", [20, 200])
def test_spheres_in_scenes(device: str, count: int) -> None:
    """Radii of 0.001 to 0.5, many overlap; origins inside and outside."""
    rng = np.random.default_rng(10)
    spheres = np.concatenate(
        [rng.uniform(-1, 1, (count, 3)), 10 ** rng.uniform(-3, -0.3, (count, 1))], axis=1
    )
    scene = make([Part(spheres=[(c[:3], c[3], False) for c in spheres])])
    o, d = rng.uniform(-1, 1, (5_000, 3)), directions(rng, 5_000)
    f = o[:, None] - spheres[None, :, :3]
    b, c = (f * d[:, None]).sum(-1), (f * f).sum(-1) - spheres[:, 3] ** 2
    square = b * b - c
    root = np.sqrt(np.maximum(square, 0))
    near, far = -b - root, -b + root
    hits = np.where((square > 0) & (far > 0), np.where(near > 0, near, far), np.inf)
    t, at = hits.min(1), hits.argmin(1)
    got_t, got = native(device).intersect(native_scene(scene, device), o, d)
    second = np.partition(hits, 1, axis=1)[:, 1]
    clear = (np.abs(square) > 1e-6).all(1) & (np.isinf(t) | (second > t + 1e-5))
    clear &= (np.abs(c) > 1e-5).all(1)
    assert clear.mean() > 0.8
    assert (got == np.where(np.isinf(t), -1, at))[clear].all()
    hit = clear & np.isfinite(t)
    assert hit.sum() > 300
    assert np.abs(got_t[hit] - t[hit]).max() < 1e-4
    assert np.median(np.abs(got_t[hit] / t[hit] - 1)) < 3e-7
