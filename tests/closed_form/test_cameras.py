"""Thin lens, moving cameras and filters against geometry.

Rules as in test_analytic: false-alarm rate 1e-3, confirmed at 1e-4.
"""

from __future__ import annotations

import dataclasses
import math

import numpy as np
import numpy.typing as npt
import pytest
from scipy import stats

import veriray
from tests.closed_form.build import BLACK, flat, scene, sky, view
from tests.support import FAST, agrees, chi_square, confirm, ledger_adds_up, sidak

pytestmark = pytest.mark.parametrize("device", FAST)
Array = npt.NDArray[np.float64]


# ---- thin lens ----


def overlap(distance: Array, a: float, b: float) -> Array:
    """Area common to two circles of radii a > b whose centres are `distance` apart."""
    d = np.clip(distance, a - b, a + b)
    p = np.arccos(np.clip((d * d + a * a - b * b) / (2 * d * a), -1, 1))
    q = np.arccos(np.clip((d * d + b * b - a * a) / (2 * d * b), -1, 1))
    kite = np.sqrt(np.maximum((a + b - d) * (d + a - b) * (d - a + b) * (d + a + b), 0)) / 2
    return a * a * p + b * b * q - kite


@pytest.mark.parametrize("depth", [2.0, 8.0])
def test_circle_of_confusion(device: str, depth: float) -> None:
    """A small disk out of focus: the share of the lens that sees it, pixel by pixel.

    From a point p of the focal plane f the disk at distance z, seen through the lens point q, lies
    at q (1 - z/f) + p z/f. So the lens points that hit a disk of radius r are those within
    r / |1 - z/f| of a centre that moves with p. Three tests, Sidak: chi-square of all pixels; the
    energy, which focus does not change: pi r^2 f^2 / z^2 of the focal plane; the second moment
    (a^2 + r'^2) / 2 over the scale squared, which is the radius. Sees 2.5 % of either.
    """
    focus, aperture, size, fov = 4.0, 0.5, 48, 24.0
    r, spp = (0.03, 6_000) if depth < focus else (0.08, 12_000)
    lens = {"aperture_radius": aperture, "focus_distance": focus}
    disk = flat("disk", [0, 0, -depth], [0, 0, 1], r, BLACK, 1)
    seen = scene(view([0, 0, 0], [0, 0, -1], fov, size, "thinlens", **lens), disk)
    half = focus * math.tan(math.radians(fov / 2))
    pixel = 2 * half / size
    spot, scale = r / abs(1 - depth / focus), (depth / focus) / abs(1 - depth / focus)
    fine = ((np.arange(size * 32) + 0.5) / 32 - size / 2) * pixel
    radius = np.hypot(fine[:, None], fine)
    share = overlap(radius * scale, aperture, spot) / (math.pi * aperture**2)
    share = np.where(radius * scale < aperture + spot, share, 0.0)
    exact = share.reshape(size, 32, size, 32).mean((1, 3))
    rim = np.hypot(fine[16::32, None], fine[16::32]) * scale < aperture + spot + 2 * pixel * scale
    exact = np.where(rim, np.maximum(exact, 1e-12), 0.0)
    area = math.pi * (r * focus / depth) ** 2 / pixel**2  # in pixels
    assert abs(exact.sum() / area - 1) < 2e-3
    centre = (np.arange(size) + 0.5 - size / 2) * pixel
    squared = centre[:, None] ** 2 + centre**2 + pixel**2 / 6
    moment = (aperture**2 + spot**2) / (2 * scale**2)
    fine2 = fine[:, None] ** 2 + fine**2
    assert abs((share * fine2).sum() / share.sum() / moment - 1) < 2e-3
    moment = float((exact * squared).sum() / exact.sum())  # as the pixels see it

    def p_value(effort: int, seed: int) -> float:
        n = spp * effort
        image = veriray.render(seen, spp=n, seed=seed, device=device)
        ledger_adds_up(image)
        hits = np.rint(image.image[:, :, 0].astype(np.float64) * n)
        total, expected = float(hits.sum()), area * n
        blur = float((hits * squared).sum() / total)
        spread = math.sqrt(float((hits * (squared - blur) ** 2).sum())) / total
        assert 4.57 / math.sqrt(total) < 0.025
        z = [(total - expected) / math.sqrt(expected), (blur - moment) / spread]
        every = size * size * n
        fits = chi_square(np.append(hits, every - total), np.append(exact * n, every - expected))
        return sidak(min(fits, 2 * float(stats.norm.sf(np.abs(z).max()))), 3)

    confirm(p_value)


def test_a_lens_in_focus_is_a_pinhole(device: str) -> None:
    """What lies in the focal plane is sharp: each pixel its own radiance, without noise."""
    lens = {"aperture_radius": 0.7, "focus_distance": 3.0}
    half = math.tan(math.radians(20)) * 3
    lamp = flat("rectangle", [half / 2, 0, -3], [0, 0, 1], [half / 2, 2 * half], BLACK, 2)
    eye = view([0, 0, 0], [0, 0, -1], 40.0, 8, "thinlens", up=[0, 1, 0], **lens)
    seen = scene(eye, lamp, sky(1))
    r = veriray.render(seen, spp=2000, device=device)
    columns = r.image[:, :, 0]
    assert set(np.unique(columns).tolist()) == {1.0, 2.0} and not r.stderr.any()
    assert (columns[:, :4] == 1).all() and (columns[:, 4:] == 2).all()


def test_aperture_zero_is_the_pinhole(device: str) -> None:
    """The same film, bit for bit."""
    pinhole = scene(view([1, 2, 5], [0, 0, 0], 40.0, 8),
                    flat("disk", [0, 0, 0], [0, 0, 1], 1, BLACK, 2), sky(1))  # fmt: skip
    camera = dataclasses.replace(pinhole.camera, focus_distance=2.0)
    films = [veriray.render(s, spp=64, device=device).film_sha256
             for s in (pinhole, pinhole.with_(camera=camera))]  # fmt: skip
    assert films[0] == films[1]


# ---- moving cameras ----


def test_orbit_and_dolly(device: str) -> None:
    """Around a box whose faces shine in six radiances: the face that must be in view is."""
    faces = {(1, 0, 0): 1.0, (-1, 0, 0): 2.0, (0, 1, 0): 3.0, (0, -1, 0): 4.0, (0, 0, 1): 5.0,
             (0, 0, -1): 6.0}  # fmt: skip
    box = [flat("rectangle", n, n, 1, BLACK, value) for n, value in faces.items()]
    still = scene(view([0, 0, 5], [0, 0, 0], 30.0, 2), *box)
    start = veriray.Camera.look_at([0, 0, 5], [0, 0, 0], fov=10)
    for azimuth, elevation, value in ((0, 0, 5.0), (90, 0, 1.0), (180, 0, 6.0), (270, 0, 2.0),
                                      (-90, 0, 2.0), (30, 80, 3.0), (0, -80, 4.0)):  # fmt: skip
        camera = start.orbit(azimuth, elevation)
        position = camera.to_world[:3, 3]
        assert abs(np.linalg.norm(position) - 5) < 1e-12
        assert np.abs(camera.to_world[:3, 2] + position / 5).max() < 1e-12
        r = veriray.render(still.with_(camera=camera), spp=16, device=device)
        assert (r.image == value).all() and not r.stderr.any()
        near = camera.dolly(1.5)
        assert abs(np.linalg.norm(near.to_world[:3, 3]) - 3.5) < 1e-12
        r = veriray.render(still.with_(camera=near), spp=16, device=device)
        assert (r.image == value).all()
    assert (start.to_world[:3, 3] == [0, 0, 5]).all()  # the camera itself stands where it stood


def test_dolly_magnifies(device: str) -> None:
    """A disk's share of the picture grows as the inverse square of the distance."""
    disk = flat("disk", [0, 0, 0], [0, 0, 1], 1, BLACK, 1)
    still = scene(view([0, 0, 10], [0, 0, 0], 30.0), disk)
    for step in (0.0, 4.0, -5.0):
        half = (10 - step) * math.tan(math.radians(15))
        moved = still.with_(camera=still.camera.dolly(step))
        agrees(moved, math.pi / (2 * half) ** 2, device, 800_000, sees=0.03)


# ---- filters ----


def mitchell(x: float) -> float:
    """Mitchell and Netravali, 1988, with B = C = 1/3."""
    b = c = 1 / 3
    x = abs(x)
    if x < 1:
        return ((12 - 9 * b - 6 * c) * x**3 + (-18 + 12 * b + 6 * c) * x**2 + 6 - 2 * b) / 6
    if x < 2:
        return ((-b - 6 * c) * x**3 + (6 * b + 30 * c) * x**2 + (-12 * b - 48 * c) * x
                + 8 * b + 24 * c) / 6  # fmt: skip
    return 0.0


FILTERS = {
    "box": (lambda x: 1.0 * (abs(x) <= 0.5), 0.5),
    "tent": (lambda x: max(1 - abs(x), 0.0), 1.0),
    "gaussian": (lambda x: math.exp(-2 * x * x) - math.exp(-8), 2.0),
    "mitchell": (mitchell, 2.0),
}


@pytest.mark.parametrize("name", FILTERS)
def test_a24_edge_under_a_filter(device: str, name: str) -> None:
    """A lit half plane from pixel 5.65 on: 1 + 2 times the filter's integral over it.

    Mitchell's negative lobes over- and undershoot.
    """
    kernel, reach = FILTERS[name]
    width, height, edge = 12, 3, 5.65
    half = math.tan(math.radians(20))
    x = (2 * edge / width - 1) * half  # world +x is on the picture's right
    lamp = flat("rectangle", [x + 5, 0, -1], [0, 0, 1], 5, BLACK, 3)
    size = (width, height)
    eye = view([0, 0, 0], [0, 0, -1], 40.0, size, up=[0, 1, 0], rfilter={"type": name})
    at = (np.arange(200_000) + 0.5) / 100_000 * reach - reach
    weight = np.array([kernel(t) for t in at.tolist()])
    share = [float(weight[at > edge - i - 0.5].sum() / weight.sum()) for i in range(width)]
    exact = np.broadcast_to((1 + 2 * np.array(share))[None, :, None], (height, width, 3))
    assert name != "mitchell" or exact.min() < 0.97
    agrees(scene(eye, lamp, sky(1)), exact, device, 100_000, sees=0.005)
