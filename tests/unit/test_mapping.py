"""core/mapping: each map from the unit square times its density is 1, also in the corners."""

from __future__ import annotations

import itertools

import numpy as np
import pytest

from tests.support import FAST, native

CORNERS = (0.0, 2.0**-24, 0.5, 1 - 2.0**-24)
#: Asymmetries of the phase function; the smallest ones must be continuous with 0.
ASYMMETRIES = (0.0, 1e-4, -1e-4, 1e-7, 0.3, -0.5, 0.9, -0.99, 0.9999, -0.9999)


def evaluate(device: str, name: str, *columns: object) -> np.ndarray:
    """Columns (numbers are repeated) to rows, (n, outputs) float64."""
    rows = np.stack(np.broadcast_arrays(*(np.asarray(c, np.float32) for c in columns)), axis=-1)
    out: np.ndarray = native(device).eval_function(name, rows.reshape(-1, rows.shape[-1]))
    return out.astype(np.float64)


def single(x: object) -> np.ndarray:
    """Rounded to float32, as float64."""
    return np.asarray(x, np.float32).astype(np.float64)


def density(name: str, p: np.ndarray) -> np.ndarray:
    """Per solid angle; per unit of (b1, b2) for the triangle, of area for the disc."""
    if name == "cosine_hemisphere":
        return p[:, 2] / np.pi
    constant = {"uniform_sphere": 1 / (4 * np.pi), "uniform_triangle": 2.0}
    return np.full(len(p), constant.get(name, 1 / np.pi))


MAPPINGS = ("cosine_hemisphere", "uniform_sphere", "uniform_triangle", "uniform_disk")
FLAT = ("uniform_triangle", "uniform_disk")


@pytest.mark.parametrize("device", FAST)
@pytest.mark.parametrize("name", MAPPINGS)
def test_jacobian_times_density_is_one(device: str, name: str) -> None:
    """Central differences of 2^-8: truncation and float32 rounding leave 2e-3 of 1; a density
    wrong by 1 % at any of 400 places is seen."""
    h = 2.0**-8
    u, v = (g.ravel() for g in np.meshgrid(*[np.linspace(0.1, 0.9, 20)] * 2))
    du = (evaluate(device, name, u + h, v) - evaluate(device, name, u - h, v)) / (2 * h)
    dv = (evaluate(device, name, u, v + h) - evaluate(device, name, u, v - h)) / (2 * h)
    if name in FLAT:
        area = np.abs(du[:, 0] * dv[:, 1] - du[:, 1] * dv[:, 0])
    else:
        area = np.linalg.norm(np.cross(du, dv), axis=1)
    assert np.abs(area * density(name, evaluate(device, name, u, v)) - 1).max() < 5e-3


@pytest.mark.parametrize("name", MAPPINGS)
def test_corners(device: str, name: str) -> None:
    u, v = np.array(list(itertools.product(CORNERS, CORNERS))).T
    p = evaluate(device, name, u, v)
    assert np.isfinite(p).all()
    if name == "uniform_triangle":
        assert (p[:, :2] >= 0).all() and (p[:, :2].sum(1) <= 1 + 1e-6).all()
    elif name == "uniform_disk":
        assert (np.linalg.norm(p, axis=1) <= 1 + 1e-7).all()
    else:
        assert np.abs(np.linalg.norm(p, axis=1) - 1).max() < 1e-5
        assert (density(name, p) > 0).all() and np.isfinite(density(name, p)).all()


@pytest.mark.parametrize("one_minus_cos", [2.0, 1.0, 0.3, 1e-4, 1e-13, 1e-30])
def test_cones_of_every_width(device: str, one_minus_cos: float) -> None:
    """1e-13 is 6e-13 sr. x, y, z and the pdf within 3e-7 of the exact map, relatively."""
    rng = np.random.default_rng(5)
    u, v = single(rng.random((2, 20_000)))
    u[:4], v[:4] = CORNERS, CORNERS
    got = evaluate(device, "uniform_cone", u, v, one_minus_cos)
    h = u * single(one_minus_cos)
    sine = np.sqrt(h * (2 - h))
    assert (np.abs(np.hypot(got[:, 0], got[:, 1]) - sine) <= 3e-7 * sine).all()
    assert np.abs(got[:, 2] - (1 - h)).max() < 1e-7
    azimuth = np.arctan2(got[:, 1], got[:, 0]) / (2 * np.pi) - v
    assert np.abs(azimuth - np.rint(azimuth))[h > 0].max() < 2e-7
    assert np.allclose(got[:, 3] * 2 * np.pi * single(one_minus_cos), 1, rtol=3e-7, atol=0)


def test_frames_are_orthonormal_and_right_handed(device: str) -> None:
    rng = np.random.default_rng(6)
    n = rng.normal(size=(20_000, 3))
    n[:5_000, :2] *= np.exp(rng.uniform(-40, 0, (5_000, 1)))  # about both poles
    n[:6] = np.concatenate([np.eye(3), -np.eye(3)])
    n = single(n / np.linalg.norm(n, axis=1)[:, None])
    frame = evaluate(device, "orthonormal_frame", *n.T)
    a, b = frame[:, :3], frame[:, 3:]
    for p, q in ((a, b), (a, n), (b, n)):
        assert np.abs((p * q).sum(1)).max() < 4e-7
    for p in (a, b):
        assert np.abs(np.linalg.norm(p, axis=1) - 1).max() < 4e-7
    assert np.abs(np.cross(a, b) - n).max() < 5e-7


def phase(away: np.ndarray, g: float) -> np.ndarray:
    """Henyey and Greenstein, per solid angle, from half the squared distance of the two unit
    vectors (g < 0: of one and the opposite of the other), which is 1 - cos without cancellation."""
    a = abs(g)
    return (1 - a * a) / (4 * np.pi * ((1 - a) ** 2 + 2 * a * away) ** 1.5)


@pytest.mark.parametrize("g", ASYMMETRIES)
def test_phase_function_inverts_its_distribution(device: str, g: float) -> None:
    """About +z the angle to the favoured direction is within 1e-6 of itself."""
    g = float(single(g))
    a, rng = abs(g), np.random.default_rng(7)
    u, v = single(rng.random((2, 20_000)))
    u[:4], v[:4] = CORNERS, CORNERS
    x, y, z, pdf = evaluate(device, "henyey_greenstein", 0, 0, 1, g, u, v).T
    angle = np.arctan2(np.hypot(x, y), -z if g < 0 else z)
    q = 1 - a + 2 * a * u
    less = 2 * (1 - a) ** 2 * (1 - u) * (1 + a * u) / q**2  # 1 - cos
    more = 2 * (1 + a) ** 2 * u * (1 - a * (1 - u)) / q**2  # 1 + cos
    exact = 2 * np.arctan2(np.sqrt(less), np.sqrt(more))
    assert (np.abs(angle - exact) <= 1e-6 * exact).all()
    assert np.allclose(pdf, phase(2 * np.sin(angle / 2) ** 2, g), rtol=2e-6, atol=0)
    if a > 0.1:  # the textbook's form
        assert np.abs((1 + a * a - ((1 - a * a) / q) ** 2) / (2 * a) - (1 - less)).max() < 1e-10
    azimuth = np.arctan2(y, x) / (2 * np.pi) - v
    assert np.abs(azimuth - np.rint(azimuth))[1:].max() < 3e-7


@pytest.mark.parametrize("g", ASYMMETRIES)
def test_phase_function_of_vectors(device: str, g: float) -> None:
    """Sampled and arbitrary directions, as rounded; then the integral over the sphere."""
    g = float(single(g))
    rng, n = np.random.default_rng(8), 20_000
    d = rng.normal(size=(n, 3))
    d = single(d / np.linalg.norm(d, axis=1)[:, None])
    out = evaluate(device, "henyey_greenstein", *d.T, g, rng.random(n), rng.random(n))
    assert np.abs(np.linalg.norm(out[:, :3], axis=1) - 1).max() < 2e-7
    for w in (out[:, :3], np.roll(d, 1, axis=0), d, -d):
        got = evaluate(device, "henyey_greenstein_pdf", *d.T, *w.T, g)[:, 0]
        away = ((w - np.where(g < 0, -1, 1) * d) ** 2).sum(1) / 2
        assert np.allclose(got, phase(away, g), rtol=2e-6, atol=0)
    if abs(g) <= 0.9:
        cosine = (np.arange(2**16) + 0.5) * 2.0**-15 - 1
        w = np.stack([np.sqrt(1 - cosine**2), 0 * cosine, cosine])
        values = evaluate(device, "henyey_greenstein_pdf", 0, 0, 1, *w, g)
        assert abs(values.sum() * 2.0**-15 * 2 * np.pi - 1) < 1e-5


def test_free_flights_from_all_words(device: str) -> None:
    """-log((word + 1/2) 2^-32) within 2.4e-7 of itself, falling with the word, ends included."""
    rng = np.random.default_rng(9)
    words = rng.integers(0, 2**32, 100_000, dtype=np.uint64)
    ends = np.arange(4096, dtype=np.uint64)
    about = np.uint64(np.sqrt(0.5) * 2**32) - np.uint64(2048) + ends  # where the form changes
    words = np.unique(np.concatenate([words, ends, 2**32 - 1 - ends, about]))
    got = evaluate(device, "exponential", words >> 16, words & 65535)[:, 0]
    low, high = (words + 0.5) * 2.0**-32, (2**32 - 1 - words + 0.5) * 2.0**-32
    exact = np.where(low < 0.5, -np.log(low), -np.log1p(-high))
    assert (np.abs(got - exact) <= 2.4e-7 * exact).all()
    assert (np.diff(got) <= 0).all() and got[-1] > 0


def test_same_bits_on_every_device(device: str) -> None:
    rng = np.random.default_rng(4)
    u, v, g = rng.random((3, 5000))
    d = rng.normal(size=(5000, 3))
    d /= np.linalg.norm(d, axis=1)[:, None]
    arguments = {name: (u, v) for name in MAPPINGS}
    arguments |= {"uniform_cone": (u, v, 2 * g), "orthonormal_frame": tuple(d.T)}
    arguments |= {"henyey_greenstein": (*d.T, 1.999 * g - 1, u, v)}
    arguments |= {"henyey_greenstein_pdf": (*d.T, *np.roll(d, 1, axis=0).T, 1.999 * g - 1)}
    arguments |= {"exponential": (np.floor(u * 65536), np.floor(v * 65536))}
    for name, columns in arguments.items():
        assert (evaluate(device, name, *columns) == evaluate(FAST[0], name, *columns)).all()
