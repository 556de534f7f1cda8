"""Lamps under something opaque that is closer than shadow rays resolve."""

from __future__ import annotations

import numpy as np
import pytest

import veriray as vr
from veriray_validate import dicts
from veriray_validate.scenes import MIRROR, Part, camera, disk, make, quad

PLACES = [*((gap, False) for gap in (0.0, 2.0**-24, 1e-7, 1e-6, 1e-5)), (1e-6, True), (1e-5, True)]
SHAPES = [("quad", "disk"), ("disk", "quad"), ("disk", "disk")]  # of cover and lamp
CASES = [
    *(("quad", "quad", *place) for place in PLACES),
    *((*kinds, gap, turned) for kinds in SHAPES for gap in (2e-6, 5e-6) for turned in (0, 1)),
]


@pytest.mark.parametrize(("cover", "lamp", "gap", "turned"), CASES)
def test_no_light_comes_through_a_cover(
    device: str, cover: str, lamp: str, gap: float, turned: bool | int
) -> None:
    """A white cover on a lamp of radiance 50, below a white ceiling and a sky of 1, looks like 1.

    Of two turned planes, or a disk and something in its plane, closer than rays resolve either may
    be seen, so those are left out. Light through the cover would make it up to 50 times as bright;
    the test sees 0.5 %, with one false alarm in 1.7 million for each case.
    """
    tilt = np.eye(3)
    if turned:
        tilt = np.linalg.qr(np.random.default_rng(3).normal(size=(3, 3)))[0]
        tilt *= np.linalg.det(tilt)

    def sheet(kind: str, height: float, half: float, *more: float) -> Part:
        a, b, c = tilt @ [half, 0, 0], tilt @ [0, abs(half), 0], tilt @ [0, 0, height]
        return disk(c, a, b, *more) if kind == "disk" else quad(c - a - b, 2 * a, 2 * b, *more)

    parts = [
        sheet(cover, 0.0, 1.0, 1.0),
        sheet(lamp, -gap, 0.5, 0.0, 50.0),
        sheet("quad", 0.7, -1.0, 1.0),  # faces down
    ]
    eye = camera(tilt @ [2.5, 0.3, 0.4], tilt @ [0, 0, 0.1], fov=20)
    r = vr.render(make(parts, eye, 1.0, width=8, height=8), 4096, device=device)
    mean = float(r.image.mean(dtype=np.float64))
    error = float(np.sqrt((r.stderr.astype(np.float64) ** 2).sum())) / r.image.size
    assert error < 1e-3 and abs(mean - 1) < 5 * error + 1e-5, (mean, error)


def grid(height: float, half: float, n: int, *more: float) -> Part:
    """A square of 2 n^2 triangles that faces up."""
    x, y = np.meshgrid(*[np.linspace(-half, half, n + 1)] * 2)
    first = (np.arange(n)[:, None] * (n + 1) + np.arange(n)).ravel()
    faces = [np.stack([first, first + 1, first + n + 2], 1),
             np.stack([first, first + n + 2, first + n + 1], 1)]  # fmt: skip
    vertices = np.stack([x.ravel(), y.ravel(), np.full(x.size, height)], 1)
    return Part(vertices, np.concatenate(faces), *more)


def test_no_light_comes_through_a_fine_cover(device: str) -> None:
    """A white cover of 2,592 triangles on a lamp of 512, below a sky of 1: 1, as above."""
    parts = [grid(0, 1, 36, 1.0), grid(-1e-7, 0.5, 16, 0.0, 50.0)]
    parts.append(quad([-1, -1, 0.7], [0, 2, 0], [2, 0, 0], 1.0))
    scene = make(parts, camera([2.5, 0.3, 0.4], [0, 0, 0.1], fov=20), 1.0, width=8, height=8)
    r = vr.render(scene, 1024, device=device)
    mean = float(r.image.mean(dtype=np.float64))
    error = float(np.sqrt((r.stderr.astype(np.float64) ** 2).sum())) / r.image.size
    assert error < 2e-3 and abs(mean - 1) < 5 * error + 1e-5, (mean, error)


def test_a_lamp_before_its_ceiling_in_number_is_sampled() -> None:
    """Of two faces in one plane the first is seen: a lamp in the plane of a ceiling stays one."""
    lamp = quad([-1, -1, 1], [0, 2, 0], [2, 0, 0], 0.0, 1.0)
    ceiling = quad([-3, -3, 1], [0, 6, 0], [6, 0, 0], 0.5)
    floor = quad([-3, -3, 0], [6, 0, 0], [0, 6, 0], 0.5)
    eye = camera([1.5, 1.2, 0.5], [0, 0, 0])
    seen, hidden = (
        vr.render(make(parts, eye), 256).stats["ledger"]["shadow_visible"][0]
        for parts in ([lamp, ceiling, floor], [ceiling, lamp, floor])
    )
    assert seen > 200 and hidden == 0


@pytest.mark.parametrize("beside", [False, True])
def test_a_lamp_that_is_partly_covered_is_found_in_full(device: str, beside: bool) -> None:
    """A white floor below a panel of radiance 1, a mirror on a part of it, and a sky of 1: 1.

    Rays find the panel, since it is not sampled; another lamp, as bright, is. Sees 0.5 %, with one
    false alarm in 1.7 million for each case.
    """
    parts = [
        quad([-1, -1, 0], [2, 0, 0], [0, 2, 0], 1.0),
        quad([-1, -1, 1], [0, 2, 0], [2, 0, 0], 0.0, 1.0),
        quad([-0.5, -0.5, 1 - 1e-6], [0, 1, 0], [1, 0, 0], material=MIRROR),
    ]
    if beside:
        parts.append(quad([-1, -1, 0], [0, 2, 0], [0, 0, 1], 0.0, 1.0))
    scene = make(parts, camera([2.5, 0.3, 0.6], [0, 0, 0.1], fov=20), 1.0, width=8, height=8)
    r = vr.render(scene, 4096, device=device)
    mean = float(r.image.mean(dtype=np.float64))
    error = float(np.sqrt((r.stderr.astype(np.float64) ** 2).sum())) / r.image.size
    assert error < 1e-3 and abs(mean - 1) < 5 * error + 1e-5, (mean, error)


def test_a_covered_lamp_blocks_the_light_of_another(device: str) -> None:
    """A panel over a floor, a lamp above the panel: the floor is dark, covered panel or not."""
    parts = [
        quad([-1, -1, 1], [0, 2, 0], [2, 0, 0], 0.0, 1e-3),
        quad([-2, -2, 0], [4, 0, 0], [0, 4, 0], 0.5),
        quad([-0.5, -0.5, 2], [0, 1, 0], [1, 0, 0], 0.0, 10.0),
        quad([-0.1, -0.1, 1 - 1e-6], [0, 0.2, 0], [0.2, 0, 0], 0.0),
    ]
    eye = camera([1.5, 0.3, 0.6], [0, 0, 0], fov=5)
    for count in (3, 4):
        r = vr.render(make(parts[:count], eye, width=8, height=8), 64, device=device)
        assert r.image.max() < 1e-3, count


@pytest.mark.parametrize("kind", ["rectangle", "disk"])
@pytest.mark.parametrize("order", [1, -1])
def test_faces_back_to_back_show_their_fronts(kind: str, order: int) -> None:
    """Two one-sided lamps in one plane that look in opposite directions, turned at random, without
    a tree: each is seen from its front with its own radiance, and lights the other side's wall as
    two lamps a thousandth apart do (within 2 %; without a place in the plane it is black)."""
    rng = np.random.default_rng(7)
    for _ in range(4):
        normal = dicts.direction(float(rng.uniform(0, 60)))
        pictures = []
        for gap in (0.0, 1e-3):
            faces = [
                dicts.flat(kind, (side * gap / 2 * normal).tolist(), (side * normal).tolist(), 0.4,
                           dicts.BLACK, radiance)
                for side, radiance in ((1, 2.0), (-1, 5.0))
            ]  # fmt: skip
            for side, radiance in ((1, 2.0), (-1, 5.0)):
                wall = dicts.flat("rectangle", (-1.5 * side * normal).tolist(),
                                  (side * normal).tolist(), 2, dicts.diffuse(0.5))  # fmt: skip
                near = dicts.scene(dicts.view(side * normal, [0, 0, 0]), *faces[::order], wall)
                image = np.asarray(vr.render(near, spp=16, device="cpu"))
                np.testing.assert_allclose(image, radiance, rtol=1e-6)
                eye = dicts.view((-0.5 * side * normal).tolist(), (-1.5 * side * normal).tolist())
                lit = dicts.scene(eye, *faces[::order], wall, max_depth=2)
                pictures.append(np.asarray(vr.render(lit, spp=4096, device="cpu")).mean())
        assert min(pictures) > 0
        np.testing.assert_allclose(pictures[:2], pictures[2:], rtol=0.02)
