"""Media whose albedo or extinction a grid gives."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import numpy.typing as npt

from veriray_validate.dicts import (
    BLACK,
    NULL,
    Dict,
    cuboid,
    diffuse,
    direction,
    flat,
    glass,
    medium,
    rgb,
    scene,
    sky,
    sphere,
    view,
)
from veriray_validate.form_factors import gauss
from veriray_validate.levels.closed_media.slabs import ALBEDOS, at
from veriray_validate.transfer import chandrasekhar
from veriray_validate.trial import Trial, case

Array = npt.NDArray[Any]

WRAPS = ("clamp", "repeat", "mirror")
FILTERS = ("trilinear", "nearest")
#: Numbers along one axis, in three colours.
PROFILE = np.array([[0.9, 0.1, 0.4], [0.2, 0.3, 1.0], [0.7, 0.8, 0.0], [0.0, 1.0, 0.6]])
#: Where the grid's unit cube lies along z; the bodies of these cases reach beyond.
LOW, HIGH = 0.15, 0.75


def box_of(low: Any, high: Any, cells: Any, **more: Any) -> Dict:
    """A gridvolume whose unit cube is the box from low to high."""
    place = np.diag([*np.subtract(high, low).astype(float), 1.0])
    place[:3, 3] = low
    return {"type": "gridvolume", "data": np.asarray(cells, np.float32), "to_world": place, **more}


def along(axis: str, values: Array, wrap: str, filter_: str) -> Dict:
    """A gridvolume whose own axis of that name lies along z from LOW to HIGH, with `values` (N,) or
    (N, 3) along it and the same across; across it is 80 wide."""
    k = "xyz".index(axis)
    cells = np.moveaxis(np.broadcast_to(values.reshape(len(values), 1, 1, -1),
                                        (len(values), 1, 2, values.size // len(values))),
                        0, 2 - k)  # fmt: skip
    place = np.zeros((4, 4))
    place[2, k], place[3, 3] = HIGH - LOW, 1
    for row, column in enumerate(c for c in range(3) if c != k):
        place[row, column] = 80
    place[:3, 3] = -40, -40, LOW
    return {"type": "gridvolume", "grid": np.ascontiguousarray(cells, np.float32),
            "to_world": place, "wrap_mode": wrap, "filter_type": filter_}  # fmt: skip


def profile(z: Array, values: Array, wrap: str, filter_: str) -> Array:
    """The numbers (len(z), ...) of `along` at heights z."""
    n = len(values)
    x = (np.asarray(z) - LOW) / (HIGH - LOW)
    if wrap == "clamp":
        order = np.arange(-50 * n, 51 * n).clip(0, n - 1)
    elif wrap == "repeat":
        order = np.arange(-50 * n, 51 * n) % n
    else:
        order = np.arange(-50 * n, 51 * n) % (2 * n)
        order = np.minimum(order, 2 * n - 1 - order)
    centres = (np.arange(-50 * n, 51 * n) + 0.5) / n
    table = values[order]
    if filter_ == "nearest":
        return table[np.floor(x * n).astype(int) + 50 * n]
    columns = [np.interp(x, centres, column) for column in table.reshape(len(table), -1).T]
    return np.stack(columns, axis=-1).reshape(len(x), *values.shape[1:])


def pieces(low: float, high: float, n: int) -> tuple[Array, Array]:
    """Nodes and weights over [low, high] that are exact on each side of every cell's edges and
    centres."""
    step = (HIGH - LOW) / (2 * n)
    edges = LOW + step * np.arange(math.floor((low - LOW) / step) + 1, (high - LOW) / step)
    ends = [low, *edges, high]
    parts = [gauss(24, a, b) for a, b in zip(ends, ends[1:], strict=False) if b > a]
    x, w = (np.concatenate(part) for part in zip(*parts, strict=True))
    return x, w


EACH = {"axis": "xyz", "wrap": WRAPS, "filter_": FILTERS}
QUICK = (
    ("x", "clamp", "trilinear"), ("y", "mirror", "trilinear"), ("z", "repeat", "trilinear"),
    ("y", "repeat", "nearest"),
)  # fmt: skip


@case(3, each=EACH, quick=lambda **how: tuple(how.values()) in QUICK)
def albedo_along_an_axis(t: Trial, axis: str, wrap: str, filter_: str) -> None:
    """One scattering in a slab whose albedo a grid gives, three colours, under a sun overhead.

    The integral of w(z) / 4 pi / mu exp(-(1 - z) (1/mu + 1/mu0)) over the depth, with w by another
    interpolation, exact on each piece. Sees 1 %.
    """
    mu = 0.5
    z, weight = pieces(0, 1, len(PROFILE))
    w = profile(z, PROFILE, wrap, filter_)
    exact = (weight * np.exp(-(1 - z) * (1 / mu + 1))) @ w / (4 * math.pi) / mu
    fog = {**medium(1.0, 0.0), "albedo": along(axis, PROFILE, wrap, filter_)}
    slab = cuboid([-40, -40, 0], [40, 40, 1], NULL, interior=fog)
    sun = {"type": "directional", "direction": np.array([0, 0, -1.0]), "irradiance": rgb(1)}
    seen = scene(view(at(mu) + [0.1, 0.2, 1], [0.1, 0.2, 1], 1e-3), slab, sun, max_depth=2)
    t.agrees(seen, exact, 800_000, sees=0.015)


@case(3, each={"material": ("null", "glass")})
def white_furnace_of_uneven_media(t: Trial, material: str) -> None:
    """Albedo 1 by a grid and by a number, extinction uneven and coloured, in a sky of 1.

    Radiance 1 everywhere. Sees 0.2 %.
    """
    rng = np.random.default_rng(7)
    fog = heterogeneous(box_of([-1, -1, -1], [1, 1, 1], 9 * rng.random((3, 4, 5, 3)) ** 3), 1.0)
    fog["albedo"] = box_of([0, 0, 0], [1, 1, 1], np.ones((1, 2, 1)))
    other = heterogeneous(box_of([1, -1, -1], [3, 1, 1], 5 * rng.random((2, 2, 2))), 1.0, 0.5)
    outside = NULL if material == "null" else glass(1.3)
    bodies = [sphere([0, 0, 0], 1, outside, interior=fog), sphere([2.1, 0, 0], 1, outside,
                                                                  interior=other)]  # fmt: skip
    furnace = scene(view([2, 2, 6], [1, 0, 0], 30, 4), *bodies, sky(1))
    t.agrees(furnace, 1.0, 60_000, sees=3e-3)


def heterogeneous(sigma_t: Any, albedo: Any, g: float = 0.0, **more: Any) -> Dict:
    """A heterogeneous medium; g 0 is isotropic."""
    return {**medium(1.0, albedo, g), "type": "heterogeneous", "sigma_t": sigma_t, **more}


@case(3, each={**EACH, "colours": (1, 3)},
      quick=lambda colours, **how: tuple(how.values()) in QUICK[colours // 2:])  # fmt: skip
def beer_lambert_in_a_grid(t: Trial, axis: str, wrap: str, filter_: str, colours: int) -> None:
    """A lamp behind an absorbing slab whose extinction a grid gives; nothing is outside of its box.

    exp(-integral over the grid's box), which the slab reaches beyond. Sees 2 %.
    """
    values = PROFILE[:, 0] if colours == 1 else PROFILE
    z, weight = pieces(LOW, 0.6, len(PROFILE))
    tau = 4 * weight @ profile(z, values, wrap, filter_)
    fog = heterogeneous(along(axis, values, wrap, filter_), 0.0, scale=4.0)
    slab = cuboid([-50, -50, 0], [50, 50, 0.6], NULL, interior=fog)
    lamp = flat("rectangle", [0, 0, -1], [0, 0, 1], 50, BLACK, 1)
    seen = scene(view([0.1, 0.2, 5], [0.1, 0.2, 0], 1e-3), slab, lamp)
    t.agrees(seen, np.exp(-tau), 800_000, sees=0.02)


#: Panes one behind another: what each lets through.
PANES = {"red": [(1, 0, 0)], "black": [(0, 0, 0)], "red, then blue": [(1, 0, 0), (0, 0, 1)]}


@case(3, each={"panes": PANES, "fog": ("even", "grid"), "kind": ("thindielectric", "dielectric")})
def panes_in_coloured_ink(t: Trial, panes: str, fog: str, kind: str) -> None:
    """A lamp behind coloured ink in which there are panes of index 1: their product and
    exp(-tau). Exactly 0, and no sample refused, where nothing is left. Sees 2 %."""
    tau = np.array([0.5, 1.0, 2.0])
    ink = medium(tau, 0.0)
    if fog == "grid":
        cells = tau * np.array([[0.5], [1.5]])
        ink = heterogeneous(box_of([-50, -50, 0], [50, 50, 1], cells.reshape(2, 1, 1, 3)), 0.0)
    slab = cuboid([-50, -50, 0], [50, 50, 1], NULL, interior=ink)
    sheets = [flat("rectangle", [0, 0, z], [0, 0, 1], 40,
                   {**glass(1.0, kind=kind), "specular_transmittance": rgb(through)})
              for z, through in zip((0.7, 0.6), PANES[panes], strict=False)]  # fmt: skip
    if kind == "dielectric":  # the medium on both sides
        sheets = [{**sheet, "interior": ink, "exterior": ink} for sheet in sheets]
    lamp = flat("rectangle", [0, 0, -1], [0, 0, 1], 50, BLACK, 1)
    seen = scene(view([0.1, 0.2, 5], [0.1, 0.2, 0], 1e-3), slab, *sheets, lamp)
    exact = np.exp(-tau) * np.prod(PANES[panes], axis=0)
    if exact.any():
        t.agrees(seen, exact, 400_000, sees=0.02)
    else:
        t.check(not t.render(seen, 20_000).image.any(), "light from nowhere")


@case(3, each={"shells": (1, 3)})
def shadow_rays_in_a_grid(t: Trial, shells: int) -> None:
    """A point light in balls of uneven ink over a floor.

    I cos / d^2 rho / pi exp(-tau): the extinction along the way is 2 a (1 + z / 9) in each of three
    colours; in several shells, one in another, the same. Sees 1 %.
    """
    rho, up = 0.5, direction(35)
    a = np.array([0.1, 0.5, 1.2])
    cells = (a * np.array([[1.0], [3.0]])).reshape(2, 1, 1, 3)  # 2 a at z = 0; slope 2 a / 9
    ink = heterogeneous(box_of([-9, -9, -9], [9, 9, 9], cells), 0.0)
    tau = 2 * a * (2 + up[2] / 9 * 2**2 / 2)
    balls = [sphere([0, 0, 0], r, NULL, interior=ink, exterior=ink if k else None)
             for k, r in enumerate(np.linspace(2, 1, shells).tolist())]  # fmt: skip
    balls = [{k: v for k, v in ball.items() if v is not None} for ball in balls]
    floor = flat("rectangle", [0, 0, 0], [0, 0, 1], 0.01, diffuse(rho))
    lamp = {"type": "point", "position": 5 * up, "intensity": rgb(1)}
    eye = view([0, 0, 0.5], [0, 0, 0], 1e-3, medium=ink)
    exact = up[2] / 25 * rho / math.pi * np.exp(-tau) * np.exp(-2 * a * (0.5 + 0.125 / 9))
    t.agrees(scene(eye, *balls, floor, lamp, max_depth=2), exact, 800_000, sees=0.02)


@case(3, each={"mu": (1.0, 0.5)})
def half_space_in_a_grid(t: Trial, mu: float) -> None:
    """An isotropic half space whose grid is even where it is, and three times as dense beside it.

    Chandrasekhar's 1 - H(mu) sqrt(1 - w). Sees 2 %.
    """
    exact = [1 - chandrasekhar(w, [mu])[0] * math.sqrt(1 - w) for w in ALBEDOS.tolist()]
    sigma = box_of([-200, -200, -200], [600, 200, 0], [[[1.0, 3.0]]], filter_type="nearest")
    ground = cuboid([-200, -200, -200], [200, 200, 0], NULL, interior=heterogeneous(sigma, ALBEDOS))
    t.agrees(scene(view(at(mu), [0, 0, 0]), ground, sky(1)), exact, 200_000, sees=0.02)


@case(3)
def coloured_flights_in_a_grid(t: Trial) -> None:
    """One scattering in a slab, extinction 1, 2 and 4 by colour, beside denser cells.

    w / 4 pi mu0 / (mu + mu0) (1 - exp(-tau (1/mu + 1/mu0))) E. Sees 1 %.
    """
    w, mu, tau = np.array([0.5, 0.9, 0.7]), 0.5, np.array([1.0, 2.0, 4.0])
    exact = w / (4 * math.pi) / (mu + 1) * (1 - np.exp(-tau * (1 / mu + 1)))
    cells = np.array([tau, [7, 1, 1]]).reshape(1, 1, 2, 3)
    sigma = box_of([-40, -40, 0], [120, 40, 1], cells, filter_type="nearest")
    slab = cuboid([-40, -40, -0.5], [40, 40, 1.5], NULL, interior=heterogeneous(sigma, w))
    sun = {"type": "directional", "direction": np.array([0, 0, -1.0]), "irradiance": rgb(1)}
    seen = scene(view(at(mu), [0, 0, 0]), slab, sun, max_depth=2)
    t.agrees(seen, exact, 1_600_000, sees=0.015)


@case(3)
def turned_grid(t: Trial) -> None:
    """An absorbing grid turned by 45 degrees: it fills the box around its cube, as in Mitsuba.

    The ray goes where the cube is not. exp(-sigma d), d the box's side.
    """
    c = math.sqrt(0.5)
    place = np.array([[c, -c, 0, 0], [c, c, 0, 0], [0, 0, 1, 0], [0, 0, 0, 1.0]])
    sigma = {"type": "gridvolume", "grid": np.full((1, 1, 1), 1.5), "to_world": place}
    slab = cuboid([-9, -9, -9], [9, 9, 9], NULL, interior=heterogeneous(sigma, 0.0))
    lamp = flat("rectangle", [0, 0, -20], [0, 0, 1], 50, BLACK, 1)
    seen = scene(view([0.6, 0.05, 20], [0.6, 0.05, 0], 1e-4), slab, lamp)
    t.agrees(seen, math.exp(-1.5), 800_000, sees=0.02)
