"""Lamps under something opaque that is closer than shadow rays resolve."""

from __future__ import annotations

import numpy as np
import pytest

import veriray as vr
from veriray.transform import compose, look_at, scale, translate
from veriray_validate.scenes import MIRROR, Part, camera, make, quad

PLACES = [*((gap, False) for gap in (0.0, 2.0**-24, 1e-7, 1e-6, 1e-5)), (1e-6, True), (1e-5, True)]


@pytest.mark.parametrize(("gap", "turned"), PLACES)
def test_no_light_comes_through_a_cover(device: str, gap: float, turned: bool) -> None:
    """A white cover on a lamp of radiance 50, below a white ceiling and a sky of 1, looks like 1.

    Of two turned planes closer than rays resolve either may be seen, so those are left out. Light
    through the cover would make it up to 50 times as bright; the test sees 0.5 %, with one false
    alarm in 1.7 million for each case.
    """
    tilt = np.eye(3)
    if turned:
        tilt = np.linalg.qr(np.random.default_rng(3).normal(size=(3, 3)))[0]
        tilt *= np.linalg.det(tilt)

    def sheet(low: list[float], a: list[float], b: list[float], *more: float) -> Part:
        return quad(tilt @ low, tilt @ a, tilt @ b, *more)

    parts = [
        sheet([-1, -1, 0], [2, 0, 0], [0, 2, 0], 1.0),
        sheet([-0.5, -0.5, -gap], [1, 0, 0], [0, 1, 0], 0.0, 50.0),
        sheet([-1, -1, 0.7], [0, 2, 0], [2, 0, 0], 1.0),
    ]
    eye = camera(tilt @ [2.5, 0.3, 0.4], tilt @ [0, 0, 0.1], fov=20)
    r = vr.render(make(parts, eye, 1.0, width=8, height=8), 4096, device=device)
    mean = float(r.image.mean(dtype=np.float64))
    error = float(np.sqrt((r.stderr.astype(np.float64) ** 2).sum())) / r.image.size
    assert error < 1e-3 and abs(mean - 1) < 5 * error + 1e-5, (mean, error)


@pytest.mark.parametrize("kinds", [("disk", "rectangle"), ("rectangle", "disk"), ("disk", "disk")])
@pytest.mark.parametrize("gap", [2.0**-20, 2.0**-19, 2.0**-18, 2.0**-17])
def test_no_light_comes_through_a_round_cover(
    device: str, kinds: tuple[str, str], gap: float
) -> None:
    """As above; a lamp of radiance 1e5 that is seen would make it thousands of times as bright."""

    def body(kind: str, z: float, size: float, grey: float, **more: object) -> dict[str, object]:
        place = compose(translate([0, 0, z]), scale([size, size, np.sign(0.5 - z)]))
        bsdf = {"type": "diffuse", "reflectance": grey}
        return {"type": kind, "to_world": place, "bsdf": bsdf, **more}

    lamp, cover = kinds
    view = look_at([2.5, 0.3, 0.4], [0, 0, 0.1], [0, 0, 1])
    film = {"type": "hdrfilm", "width": 8, "height": 8}
    scene = vr.load_dict(
        {
            "type": "scene",
            "sensor": {"type": "perspective", "fov": 20, "to_world": view, "film": film},
            "cover": body(cover, 0, 1, 1.0),
            "lamp": body(lamp, -gap, 0.5, 0.0, emitter={"type": "area", "radiance": 1e5}),
            "ceiling": body("rectangle", 0.7, 1, 1.0),
            "sky": {"type": "constant", "radiance": 1.0},
        }
    )
    image = vr.render(scene, 512, device=device).image
    assert abs(image.mean(dtype=np.float64) - 1) < 1e-5


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
