"""The reference renderer against closed forms, exact counts and Mitsuba.

Every statistical test runs at a false-alarm rate of 1e-3 (Sidak over its own comparisons; fixed
seeds, so a given build always gives the same answer). It compares 64 batch means with the exact
value by a t test with the margin 1e-5 and is inconclusive, which counts as failed, unless it
would see a relative bias of ``power`` in 90 of 100 runs. Where no rate is given a test is exact.
"""

from __future__ import annotations

import json
import math
import sys
from pathlib import Path

import numpy as np
import pytest
from scipy import special, stats

ROOT = Path(__file__).resolve().parents[2]
sys.path.insert(0, str(ROOT))

pytest.importorskip("embreex", reason="the reference renderer needs embreex")

from reference import COLUMNS, SceneError, load, read_exr, render, write_exr  # noqa: E402
from reference.__main__ import main  # noqa: E402
from reference.camera import camera_rays, filter_offsets  # noqa: E402
from reference.hair import Fibre  # noqa: E402
from reference.phases import Blend, HenyeyGreenstein, Rayleigh, Tabulated  # noqa: E402
from reference.scene import Film, with_settings  # noqa: E402

ALPHA = 1e-3
LIVE, ESCAPED, EMITTER, ABSORBED, RR, CUT, INVALID, VISIBLE, OCCLUDED = range(9)


# -- helpers ---------------------------------------------------------------------------------------


def camera(origin, target, up="0,1,0", fov=1e-4, width=1, height=1, rfilter="box", extra=""):
    """A perspective sensor; the default sees one point (footprint 1e-6 of the distance)."""
    return f"""<sensor type="perspective"><float name="fov" value="{fov}"/>{extra}
      <transform name="to_world"><lookat origin="{origin}" target="{target}" up="{up}"/></transform>
      <film type="hdrfilm"><integer name="width" value="{width}"/>
      <integer name="height" value="{height}"/><rfilter type="{rfilter}"/></film></sensor>"""


def rectangle(x, y, z, rho=0.0, radiance=None, down=False, two_sided=False):
    """An axis-parallel rectangle over the intervals x and y at height z, facing +z or -z."""
    bsdf = f'<bsdf type="diffuse"><rgb name="reflectance" value="{rho}"/></bsdf>'
    if two_sided:
        bsdf = f'<bsdf type="twosided">{bsdf}</bsdf>'
    return f"""<shape type="rectangle"><boolean name="flip_normals" value="{str(down).lower()}"/>
      <transform name="to_world"><scale x="{(x[1] - x[0]) / 2}" y="{(y[1] - y[0]) / 2}"/>
      <translate x="{(x[0] + x[1]) / 2}" y="{(y[0] + y[1]) / 2}" z="{z}"/></transform>
      {bsdf}{area(radiance)}</shape>"""


def area(radiance):
    if radiance is None:
        return ""
    return f'<emitter type="area"><rgb name="radiance" value="{radiance}"/></emitter>'


def constant(radiance):
    return f'<emitter type="constant"><rgb name="radiance" value="{radiance}"/></emitter>'


def cube(rho, radiance=None, inward=False, transform='<rotate x="0.6" z="0.8" angle="35"/>'):
    return f"""<shape type="cube"><boolean name="flip_normals" value="{str(inward).lower()}"/>
      <transform name="to_world">{transform}</transform>
      <bsdf type="diffuse"><rgb name="reflectance" value="{rho}"/></bsdf>{area(radiance)}</shape>"""


@pytest.fixture
def scene(tmp_path):
    def build(*parts, max_depth=-1, rr_depth=5):
        path = tmp_path / "scene.xml"
        path.write_text(
            f"""<scene version="3.0.0"><integrator type="path">
            <integer name="max_depth" value="{max_depth}"/>
            <integer name="rr_depth" value="{rr_depth}"/></integrator>{"".join(parts)}</scene>"""
        )
        return load(path)

    return build


def check_ledger(picture):
    """Every path is accounted for. Exact."""
    ledger = picture.ledger.astype(object)
    shape = picture.mean.shape
    assert ledger[0, LIVE] == shape[0] * shape[1] * picture.spp
    following = [*ledger[1:, LIVE], 0]
    assert (ledger[:, ESCAPED:VISIBLE].sum(axis=1) + following == ledger[:, LIVE]).all()
    assert ledger[:, INVALID].sum() == 0


def check_mean(batches, exact, power):
    """Batch means (B,) or (B, K) against exact values (K,): t tests, Sidak over K."""
    batches = np.asarray(batches, float).reshape(len(batches), -1)
    exact = np.broadcast_to(exact, batches.shape[1:])
    count = len(batches)
    error = batches.std(axis=0, ddof=1) / math.sqrt(count)
    limit = stats.t.isf((1 - (1 - ALPHA) ** (1 / len(exact))) / 2, count - 1)
    allowed = limit * error + 1e-5 * np.abs(exact)
    seen = ((limit + 1.28) * error / np.abs(exact)).max()
    print(f"mean {batches.mean(axis=0)} exact {exact} smallest bias seen {seen:.2%}")
    assert seen <= power, f"inconclusive: sees {seen:.2%} only"
    assert (np.abs(batches.mean(axis=0) - exact) <= allowed).all()


def image_means(picture):
    return picture.batch_means.mean(axis=(1, 2))


def form_factor(a, b):
    """Form factor of an element to an a x b rectangle, its corner overhead at 1 (Howell B-4)."""
    p, q = math.hypot(1, a), math.hypot(1, b)
    return (a / p * math.atan(b / p) + b / q * math.atan(a / q)) / (2 * math.pi)


def lambert(point, normal, polygon):
    """Irradiance over radiance: half the sum over edges of angle times edge normal."""
    rays = np.asarray(polygon, float) - point
    rays /= np.linalg.norm(rays, axis=1)[:, None]
    total = 0.0
    for a, b in zip(rays, np.roll(rays, -1, axis=0), strict=True):
        cross = np.cross(a, b)
        total += math.acos(a @ b) * (cross @ normal) / np.linalg.norm(cross)
    return abs(total) / 2


INSIDE = camera("0.1,0.2,-0.3", "0.4,-0.2,0.9", fov=60, width=8, height=8)
POINT = camera("3,0,0.5", "0,0,0", up="0,0,1")  # sees the origin of the plane z = 0
FLOOR = rectangle((-4, 5), (-4, 4), 0, rho=0.5)  # the origin is not on its diagonal


# -- closed forms ----------------------------------------------------------------------------------


@pytest.mark.parametrize("rho, emission, power", [(0.5, 0.5, 3e-3), (0.9, 1.0, 1.3e-2)])
def test_a1_furnace(scene, rho, emission, power):
    """E / (1 - rho) at every pixel; nothing can escape or be occluded (exact)."""
    furnace = scene(cube(rho, emission, inward=True), INSIDE)
    picture = render(furnace, spp=4096)
    check_ledger(picture)
    assert not picture.ledger[:, [ESCAPED, EMITTER, ABSORBED, CUT, OCCLUDED]].any()
    check_mean(image_means(picture), emission / (1 - rho), power)


@pytest.mark.parametrize("depth", range(1, 7))
def test_a2_truncated_furnace(scene, depth):
    """E (1 - rho^k) / (1 - rho) with k = max_depth terms; roulette off."""
    picture = render(
        scene(cube(0.5, 0.5, inward=True), INSIDE, max_depth=depth, rr_depth=99), spp=1024
    )
    check_ledger(picture)
    assert (picture.ledger[:, LIVE] == picture.ledger[0, LIVE]).all()
    assert len(picture.ledger) == depth
    exact = 1 - 0.5**depth
    if depth == 1:
        assert (picture.mean == exact).all() and not picture.ledger[:, VISIBLE:].any()
    else:
        check_mean(image_means(picture), exact, 3e-3)


@pytest.mark.parametrize("transform", ["", '<rotate x="0.6" z="0.8" angle="35"/>'])
def test_furnace_at_an_edge(scene, transform):
    """Hits within 1e-7 of an edge and of a corner: walls do not leak (exact); as a furnace."""
    walls = cube(0.5, 0.5, inward=True, transform=transform)
    first, second, _ = scene(walls, INSIDE).triangles[0]
    for share in (0, 0.35):
        target = (first + share * (second - first)).tolist()
        sensor = camera("0.1,0.2,-0.3", ",".join(map(repr, target)), fov=1e-5)
        picture = render(scene(walls, sensor), spp=16384)
        assert not picture.ledger[:, [ESCAPED, OCCLUDED, ABSORBED]].any()
        check_mean(image_means(picture), 1.0, 1.3e-2)


def test_a5_environment(scene):
    """A convex diffuse cube in constant light: rho L; its light is never blocked (exact)."""
    sensor = camera("3,2,2.5", "0,0,0", fov=5, width=4, height=4)
    sky = render(scene(cube(0.7), constant("1 2 0.5"), sensor), spp=65536)
    check_ledger(sky)
    assert sky.ledger[0, LIVE] == sky.ledger[1, LIVE] == sky.ledger[1, ESCAPED]
    assert len(sky.ledger) == 2 and not sky.ledger[:, OCCLUDED].any()
    check_mean(image_means(sky), [0.7, 1.4, 0.35], 3e-3)


def test_environment_seen_directly(scene):
    picture = render(scene(constant("1 2 0.5"), INSIDE), spp=64)
    assert (picture.mean == [1, 2, 0.5]).all() and (picture.stderr == 0).all()
    assert picture.ledger.tolist() == [[4096, 4096, 0, 0, 0, 0, 0, 0, 0]]


@pytest.mark.parametrize("a, b", [(1, 1), (2, 0.5)])
def test_a10_rectangle(scene, a, b):
    """Radiance rho F of a floor point under the corner, and under the centre."""
    assert form_factor(1, 1) == pytest.approx(0.138532, abs=5e-7)
    corner = scene(FLOOR, rectangle((0, a), (0, b), 1, radiance=1, down=True), POINT, max_depth=2)
    check_mean(image_means(render(corner, spp=2**19)), 0.5 * form_factor(a, b), 7e-3)
    centre = scene(FLOOR, rectangle((-a, a), (-b, b), 1, radiance=1, down=True), POINT, max_depth=2)
    check_mean(image_means(render(centre, spp=2**19)), 2 * form_factor(a, b), 5e-3)


def test_a11_wall(scene):
    """A perpendicular unit square at the edge: the light is in the plane x = 0, facing +x."""
    exact = (math.atan(1) - math.atan(1 / math.sqrt(2)) / math.sqrt(2)) / (2 * math.pi)
    assert exact == pytest.approx(0.055734, abs=5e-7)
    light = f"""<shape type="rectangle"><transform name="to_world"><scale value="0.5"/>
      <rotate y="1" angle="90"/><translate x="0" y="0.5" z="0.5"/></transform>
      <bsdf type="diffuse"><rgb name="reflectance" value="0"/></bsdf>{area(1)}</shape>"""
    sensor = camera("3,0,0.5", "1,0,0", up="0,0,1")
    picture = render(scene(FLOOR, light, sensor, max_depth=2), spp=2**19)
    check_mean(image_means(picture), 0.5 * exact, 5e-3)


def test_a12_two_lights(scene):
    """Radiances 3 and 1 in opposite quadrants, and a small bright one with a large dim one."""
    lights = (
        rectangle((0, 2), (0, 2), 1, radiance=3, down=True),
        rectangle((-2, 0), (-2, 0), 1, radiance=1, down=True),
    )
    picture = render(scene(FLOOR, *lights, POINT, max_depth=2), spp=2**19)
    assert 2 * form_factor(2, 2) == pytest.approx(0.415514, abs=5e-7)
    check_mean(image_means(picture), 2 * form_factor(2, 2), 7e-3)
    lights = (
        rectangle((0, 0.4), (0, 0.4), 1, radiance="60 0 20", down=True),
        rectangle((-3.6, 0), (-3.6, 0), 1, radiance="0 1 1", down=True),
    )
    picture = render(scene(FLOOR, *lights, POINT, max_depth=2), spp=2**19)
    small, large = form_factor(0.4, 0.4), form_factor(3.6, 3.6)
    exact = 0.5 * np.array([60 * small, large, 20 * small + large])
    check_mean(image_means(picture), exact, 1.5e-2)


def test_light_and_environment(scene):
    """A lamp that hides a part of the sky: rho (L_lamp F + L_sky (1 - F)); both are sampled."""
    lamp = rectangle((-1, 1), (-1, 1), 1, radiance="3 0 1", down=True)
    picture = render(scene(FLOOR, lamp, constant("1 1 0"), POINT, max_depth=2), spp=2**19)
    hidden = 4 * form_factor(1, 1)
    exact = 0.5 * np.array([3 * hidden + 1 - hidden, 1 - hidden, hidden])
    check_mean(image_means(picture), exact, 1e-2)


@pytest.mark.parametrize("height", [0.01, 0.5, 0.99])
def test_a17_screen(scene, height):
    """A black screen, near the floor or near the lamp, hides [0, 0.5] x [-1, 1] of a 2 x 2 lamp."""
    lamp = rectangle((-1, 1), (-1, 1), 1, radiance=1, down=True)
    screen = rectangle((0, 0.5 * height), (-height, height), height)
    sensor = camera("-3,0,0.5", "0,0,0", up="0,0,1")
    picture = render(scene(FLOOR, lamp, screen, sensor, max_depth=2), spp=2**19)
    exact = 4 * form_factor(1, 1) - 2 * form_factor(0.5, 1)
    check_mean(image_means(picture), 0.5 * exact, 7e-3)
    assert picture.ledger[0, OCCLUDED]


def test_light_choice(scene):
    """Area times radiance decides; counted by the shadow rays that a lamp facing away never gets.

    Binomial; sees a probability wrong by 0.5 %.
    """
    lamps = (
        rectangle((-1, 1), (-1, 1), 1, radiance="1 2 0", down=True),
        rectangle((-1, 1), (-1, 0), 2, radiance="4 1 1"),
    )
    picture = render(scene(FLOOR, *lamps, POINT, max_depth=2), spp=2**18, batches=1)
    p = 12 / (12 + 12)
    traced = int(picture.ledger[0, VISIBLE:].sum())
    assert stats.binomtest(traced, picture.spp, p).pvalue > ALPHA
    lamps = (lamps[0], lamps[1].replace('value="4 1 1"', 'value="0 0 1"'), constant(1))
    picture = render(scene(FLOOR, *lamps, POINT, max_depth=2), spp=2**18, batches=1)
    traced = int(picture.ledger[0, VISIBLE:].sum())
    # the sky takes no samples
    assert stats.binomtest(traced, picture.spp, 12 / 14).pvalue > ALPHA


CORNELL_LIGHT = [(343, 548.8, 227), (343, 548.8, 332), (213, 548.8, 332), (213, 548.8, 227)]


@pytest.mark.parametrize(
    "point, normal, exact",
    [
        ((278, 0, 279.5), (0, 1, 0), 0.044632475),
        ((100, 0, 100), (0, 1, 0), 0.030656670),
        ((278, 0, 500), (0, 1, 0), 0.033300261),
        ((0, 274.4, 279.6), (1, 0, 0), 0.044180738),
        ((278, 274.4, 559.2), (0, 0, -1), 0.043652624),
    ],
)
def test_a19_cornell_direct(scene, tmp_path, point, normal, exact):
    """Direct light of the empty Cornell box at five points: rho / pi times E / L."""
    assert lambert(point, normal, CORNELL_LIGHT) == pytest.approx(exact, rel=1e-6)
    (tmp_path / "light.obj").write_text(
        "".join("v {} {} {}\n".format(*v) for v in CORNELL_LIGHT) + "f 1 2 3\nf 1 3 4\n"
    )
    lamp = f'<shape type="obj"><string name="filename" value="light.obj"/>{area(1)}</shape>'
    # no opening is cut in the ceiling, so it lies a little above the lamp
    walls = cube(
        0.5,
        inward=True,
        transform='<scale x="278" y="274.5" z="279.6"/><translate x="278" y="274.5" z="279.6"/>',
    )
    eye = np.array(point) + 200.0 * np.array(normal) + (30, 20, -30)
    sensor = camera(",".join(map(str, eye)), ",".join(map(str, point)), up="0.3,0.2,0.9")
    picture = render(scene(walls, lamp, sensor, max_depth=2), spp=2**17)
    check_mean(image_means(picture), 0.5 / math.pi * exact, 4e-3)


def test_a22_small_bright_light(scene):
    """A 0.2 x 0.2 lamp of radiance 1e4: finds clamps."""
    lamp = rectangle((-0.1, 0.1), (-0.1, 0.1), 1, radiance=1e4, down=True)
    picture = render(scene(FLOOR, lamp, POINT, max_depth=2), spp=2**18)
    assert 2e4 * form_factor(0.1, 0.1) == pytest.approx(62.824862, rel=1e-7)
    check_mean(image_means(picture), 2e4 * form_factor(0.1, 0.1), 2e-3)


# -- exact zeros, sides, depths --------------------------------------------------------------------


def test_a23_zero(scene):
    """Back of a lamp, light below the horizon, full shadow: exactly 0, and no shadow ray."""
    back = scene(FLOOR, rectangle((-1, 1), (-1, 1), 1, radiance=9), POINT)
    below = scene(FLOOR, rectangle((-1, 1), (-1, 1), -1, radiance=9), POINT)
    shadow = scene(
        FLOOR,
        rectangle((-1, 1), (-1, 1), 1, radiance=9, down=True),
        rectangle((-2, 2), (-2, 2), 0.75),
        POINT,
    )
    seen = scene(rectangle((-1, 1), (-1, 1), 1, radiance=9), camera("0,0,0", "0,0,1"))
    for each in (back, below, shadow, seen):
        picture = render(each, spp=1024)
        check_ledger(picture)
        assert (picture.mean == 0).all()
        assert picture.ledger[:, VISIBLE].sum() == 0
        assert picture.ledger[:, OCCLUDED].any() == (each is shadow)
    assert picture.ledger.tolist() == [[1024, 0, 0, 1024, 0, 0, 0, 0, 0]]


def test_two_sided(scene):
    """From behind, a one-sided floor absorbs (exact) and a two-sided one reflects rho L."""
    below = camera("0.5,0.2,-2", "0,0,0", up="0,1,0")
    one = render(scene(FLOOR, constant(1), below), spp=1024)
    assert (one.mean == 0).all() and one.ledger[0, ABSORBED] == 1024
    floor = rectangle((-4, 4), (-4, 4), 0, rho="0.5 0.25 0", two_sided=True)
    two = render(scene(floor, constant(1), below), spp=2**18)
    assert (two.mean[..., 2] == 0).all()
    check_mean(image_means(two)[:, :2], [0.5, 0.25], 5e-3)
    below = camera("3,0,-0.5", "0,0,0", up="0,0,1")
    lamp = rectangle((-1, 1), (-1, 1), -1, radiance=1)
    two = render(scene(floor, lamp, below, max_depth=2), spp=2**18)
    check_mean(image_means(two)[:, :2], np.array([4, 2]) * form_factor(1, 1) / 2, 8e-3)


def test_ends_of_paths(scene):
    """Front of a black lamp, black wall, open sky, depth limit: one cause each (exact)."""
    lamp = rectangle((-9, 9), (-9, 9), 1, radiance=2)
    eye = camera("0,0,3", "0,0,0")

    def first(*parts, **settings):
        picture = render(scene(*parts, eye, **settings), spp=64)
        check_ledger(picture)
        return picture.ledger[0, LIVE:VISIBLE].tolist(), picture.mean[0, 0, 0]

    assert first(lamp) == ([64, 0, 64, 0, 0, 0, 0], 2)
    assert first(rectangle((-9, 9), (-9, 9), 1)) == ([64, 0, 0, 64, 0, 0, 0], 0)
    assert first(rectangle((1, 2), (1, 2), 1)) == ([64, 64, 0, 0, 0, 0, 0], 0)
    assert first() == ([64, 64, 0, 0, 0, 0, 0], 0)
    assert first(FLOOR, max_depth=1) == ([64, 0, 0, 0, 0, 64, 0], 0)
    assert first(lamp, max_depth=0) == ([64, 0, 64, 0, 0, 0, 0], 2)
    bright = rectangle((-9, 9), (-9, 9), 1, rho=0.5, radiance=2)
    assert first(bright, max_depth=1) == ([64, 0, 0, 0, 0, 64, 0], 2)


def test_clipping(scene):
    """Distances along the axis: a wall at depth 3 is seen only inside [near, far]."""
    wall = rectangle((-9, 9), (-9, 9), 0, radiance=1)
    for near, far, seen in ((0.1, 3.1, 1), (2.9, 9, 1), (3.1, 9, 0), (0.1, 2.9, 0)):
        clip = f'<float name="near_clip" value="{near}"/><float name="far_clip" value="{far}"/>'
        sensor = camera("0,0,3", "0,0,0", fov=60, width=4, height=4, extra=clip)
        assert (render(scene(wall, sensor), spp=64).mean == seen).all()


# -- phase functions ----


@pytest.mark.parametrize(
    "phase",
    [HenyeyGreenstein(-0.6), HenyeyGreenstein(0.95), Rayleigh(), Tabulated(np.array([3, 0, 1, 9])),
     Blend(HenyeyGreenstein(0.85), Blend(Tabulated(np.array([1, 0])), Rayleigh(), 0.4), 0.7)],
)  # fmt: skip
def test_phase_functions(phase):
    """Drawn cosines against the integral of the value, which is 1: chi-square, 40 cells."""
    x, w = np.polynomial.legendre.leggauss(300)
    edges = np.linspace(-1, 1, 241)  # among them the knots of the tables
    cells = edges[:-1, None] + (x + 1) / 240
    shares = (phase.value(cells) * w).sum(axis=1) * 2 * math.pi / 240
    assert shares.sum() == pytest.approx(1, abs=1e-12)
    shares = shares.reshape(40, 6).sum(axis=1)
    drawn = phase.draw(np.random.default_rng(11), 400_000)
    counts = np.histogram(drawn, edges[::6])[0]
    chi2 = ((counts - 400_000 * shares) ** 2 / (400_000 * shares)).sum()
    assert stats.chi2.sf(chi2, 39) > ALPHA


# -- camera and film -------------------------------------------------------------------------------


def half_planes(scene, right, bottom, width, height, rfilter):
    """An emitter that fills the picture's part left of ``right`` and above ``bottom`` (pixels)."""
    tan_x = math.tan(math.radians(20))
    tan_y = tan_x * height / width
    x, y = (1 - 2 * right / width) * tan_x, (1 - 2 * bottom / height) * tan_y
    lamp = rectangle((x, 9), (y, 9), 1, radiance=1, down=True)
    sensor = camera("0,0,0", "0,0,1", fov=40, width=width, height=height, rfilter=rfilter)
    return scene(lamp, sensor)


def test_hair_has_the_values_of_mitsuba(tmp_path):
    """hair.json: within 0.5 %, by which Mitsuba's series for a Bessel function is off."""
    kept = json.loads((ROOT / "tests" / "references" / "hair.json").read_text("utf-8"))
    (tmp_path / "a.txt").write_text("0 0 0 1\n" * 4)
    wi = np.array(kept["wi"]).T
    for row in kept["rows"]:
        parts = []
        for k, v in row["given"].items():
            kind, text = ("rgb", ", ".join(map(str, v))) if isinstance(v, list) else ("float", v)
            parts.append(f'<{kind} name="{k}" value="{text}"/>')
        (tmp_path / "a.xml").write_text(
            '<scene version="3.0.0"><sensor type="perspective"><float name="fov" value="40"/>'
            '</sensor><shape type="bsplinecurve"><string name="filename" value="a.txt"/>'
            f'<bsdf type="hair">{"".join(parts)}</bsdf></shape></scene>'
        )
        fibre = Fibre(load(tmp_path / "a.xml").materials[0])
        wo = np.repeat(np.array(row["wo"])[:, None], wi.shape[1], axis=1)
        told = np.array(row["f"]).T
        off = np.abs(fibre.evaluate(wo, wi)[0] - told)
        assert (off <= 5e-3 * np.maximum(told, 1e-4 * told.max())).all(), row["given"]


def test_a24_half_planes(scene):
    """Pixel coverage with edges at 9.3 and 7.7 (+X left, row 0 on top); binomial, 3 values."""
    picture = render(half_planes(scene, 9.3, 7.7, 14, 11, "box"), spp=16384)
    across, down = np.zeros(14), np.zeros(11)
    across[:9], across[9], down[:7], down[7] = 1, 0.3, 1, 0.7
    cover = np.outer(down, across)
    whole = (cover == 0) | (cover == 1)
    assert (picture.mean[whole, 0] == cover[whole]).all()
    hits = np.rint(picture.mean[..., 0] * picture.spp)[~whole]
    p = cover[~whole]
    z = (hits - p * picture.spp) / np.sqrt(picture.spp * p * (1 - p))
    assert np.abs(z).max() < stats.norm.isf(ALPHA / 2 / len(z))
    check_mean(picture.batch_means[:, 7, 9, 0], 0.21, 0.08)
    check_mean(picture.batch_means[:, :7, 9, 0].mean(axis=1), 0.3, 0.03)
    check_mean(picture.batch_means[:, 7, :9, 0].mean(axis=1), 0.7, 0.01)


def filter_integral(kind, x):
    """Share of the normalised filter that lies below x (pixels from the centre)."""
    if kind == "box":
        return np.clip(x + 0.5, 0, 1)
    if kind == "tent":
        x = np.clip(x, -1, 1)
        return np.where(x < 0, (1 + x) ** 2, 2 - (1 - x) ** 2) / 2
    s, x = 0.5, np.clip(x, -2, 2)
    raw = s * math.sqrt(math.pi / 2) * special.erf(x / s / math.sqrt(2)) - math.exp(-8) * x
    whole = s * math.sqrt(math.pi / 2) * special.erf(math.sqrt(8)) - math.exp(-8) * 2
    return (raw + whole) / (2 * whole)


@pytest.mark.parametrize("kind", ["box", "tent", "gaussian"])
def test_filter_samples(kind):
    """Chi-square of 2e6 offsets on 17 cells; sees 1 % in a cell of 5 %, 10 % beyond 3 stddev."""
    film = Film(1, 1, kind, {"box": 0.5, "tent": 1.0, "gaussian": 0.5}[kind])
    edges = np.array([-9, -1.5, -1.1, -0.9, -0.7, -0.45, -0.3, -0.15, 0])
    edges = np.concatenate([edges, -edges[-2::-1]])
    expected = 2_000_000 * np.diff(filter_integral(kind, edges))
    offsets = filter_offsets(np.random.Generator(np.random.Philox(1)), film, 2_000_000)
    counts = np.histogram(offsets, edges)[0]
    assert (counts[expected == 0] == 0).all() and counts.sum() == 2_000_000
    used = expected > 0
    assert stats.chisquare(counts[used], expected[used]).pvalue > ALPHA


@pytest.mark.parametrize("rfilter", ["tent", "gaussian"])
def test_filters(scene, rfilter):
    """A vertical edge at x = 8.3 blurred by the filter: each column is the filter's integral."""
    picture = render(half_planes(scene, 8.3, 99, 16, 12, rfilter), spp=8192)
    expected = filter_integral(rfilter, 8.3 - (np.arange(16) + 0.5))
    columns = picture.mean[..., 0].mean(axis=0)
    error = np.sqrt(expected * (1 - expected) / (12 * picture.spp))
    limit = stats.norm.isf(ALPHA / 2 / 16)
    assert (np.abs(columns - expected) <= limit * error + 1e-12).all()
    assert ((columns > 0) & (columns < 1)).sum() == (2 if rfilter == "tent" else 4)


def test_standard_error(scene):
    """stderr is the standard error: binomial pixels of known variance; chi-square over 11."""
    picture = render(half_planes(scene, 9.3, 99, 14, 11, "box"), spp=4096)
    assert picture.stderr[:, 9, 0] == pytest.approx(math.sqrt(0.3 * 0.7 / 4095), rel=0.05)
    between = picture.batch_means[:, :, 9, 0]
    statistic = (between.var(axis=0, ddof=1) * 63 / (0.21 / 64)).sum()
    assert stats.chi2.cdf(statistic, 63 * 11) == pytest.approx(0.5, abs=0.5 - ALPHA / 2)
    assert np.allclose(picture.batch_means.mean(axis=0), picture.mean, rtol=1e-12)


# -- the ledger ------------------------------------------------------------------------------------


@pytest.mark.parametrize("rho", [0.343, 0.7, 0.98])
@pytest.mark.parametrize("start", [1, 5])
def test_l3_furnace_counts(scene, rho, start):
    """Closed furnace: live[d] / N is 1 for d < rr_depth = s, then rho^d; chi-square of deaths.

    Roulette at vertex s - 1 sees the throughput rho^s, so a share 1 - rho^s ends there, and the
    throughput is 1 again; from then on every vertex ends a share 1 - rho. Smallest relative error
    of q seen in 90 of 100 runs, from the Fisher information: 1.3 %, 0.5 % and 0.1 %.
    """
    colour = f"{rho} {rho / 2} {rho / 3}"
    furnace = scene(cube(colour, 1, inward=True), INSIDE, rr_depth=start)
    picture = render(furnace, spp=1024 if rho > 0.9 else 4096, batches=1)
    check_ledger(picture)
    assert not picture.ledger[:, [ESCAPED, ABSORBED, OCCLUDED]].any()
    n = int(picture.ledger[0, LIVE])
    depth = np.arange(len(picture.ledger))
    live = np.where(depth < start, 1.0, rho**depth)
    deaths = picture.ledger[:, RR].astype(float)
    expected = n * np.append(live[:-1] - live[1:], live[-1])  # the last row takes the tail
    assert (deaths[expected == 0] == 0).all()
    keep = expected >= 10
    last = np.flatnonzero(keep)[-1]
    deaths, expected = deaths[: last + 1].copy(), expected.copy()
    deaths[last] += n - deaths.sum()
    expected = expected[: last + 1]
    expected[last] += n - expected.sum()
    used = expected > 0
    statistic = ((deaths - expected)[used] ** 2 / expected[used]).sum()
    p = stats.chi2.sf(statistic, used.sum() - 1)
    print(f"chi-square {statistic:.1f}, {used.sum() - 1} dof, p = {p:.3g}")
    assert p > ALPHA


def test_ledger_of_an_open_scene(scene):
    """Paths end by every cause and add up; 1 and 2 processes and a repeat give the same bits."""
    parts = (
        FLOOR,
        rectangle((-1, 1), (-1, 1), 2, radiance=3, down=True),
        rectangle((1, 3), (-1, 1), 1, rho=0.9, radiance="0 1 0", two_sided=True),
        rectangle((-3, -1), (-1, 1), 1, rho="0 0 0.7", down=True),
        constant("0.2 0.1 0.3"),
        camera("6,1,2.5", "0,0,0.5", up="0,0,1", fov=50, width=8, height=6),
    )
    each = scene(*parts, max_depth=7, rr_depth=3)
    one, two, again = (render(each, spp=256, seed=5, batches=4, processes=k) for k in (1, 2, 1))
    check_ledger(one)
    assert np.delete(one.ledger, INVALID, axis=1).any(axis=0).all()
    for other in (two, again):
        assert (one.batch_means == other.batch_means).all() and (one.mean == other.mean).all()
        assert (one.ledger == other.ledger).all() and (one.stderr == other.stderr).all()
    assert (render(each, spp=256, seed=6, batches=4).mean != one.mean).any()


def test_no_light_no_shadow_rays(scene):
    """Without a light, no shadow ray is cast; black walls end every path at depth 0."""
    dark = render(scene(cube(0.5, inward=True), INSIDE), spp=64)
    assert not dark.mean.any() and not dark.ledger[:, VISIBLE:].any()
    black = render(scene(cube(0, inward=True), constant(1), INSIDE), spp=64)
    assert black.ledger.tolist() == [[4096, 0, 0, 4096, 0, 0, 0, 0, 0]]


def test_lamp_in_a_ceiling(scene):
    """Coplanar with a wall: refused where it overlaps, the same light in an opening as without."""
    lamp = rectangle((-1, 1), (-1, 1), 1, radiance=1, down=True)
    whole = rectangle((-4, 4), (-4, 4), 1, rho=0.5, down=True)
    with pytest.raises(ValueError, match="share a part"):
        render(scene(FLOOR, whole, lamp, POINT), spp=64)
    opening = [
        rectangle(x, y, 1, rho=0.5, down=True)
        for x, y in (((-4, -1), (-4, 4)), ((1, 4), (-4, 4)), ((-1, 1), (-4, -1)), ((-1, 1), (1, 4)))
    ]
    for parts in ((*opening, lamp), (lamp, *opening)):
        picture = render(scene(FLOOR, *parts, POINT, max_depth=2), spp=2**18)
        assert not picture.ledger[:, OCCLUDED].any()
        check_mean(image_means(picture), 2 * form_factor(1, 1), 6e-3)


def test_scaling(scene):
    """Emission times 2^20 gives the picture times 2^20, exactly: there is no clamp."""
    parts = (FLOOR, camera("6,1,2.5", "0,0,0.5", up="0,0,1", fov=50, width=8, height=6))
    dim, bright = (
        render(scene(rectangle((-1, 1), (-1, 1), 2, radiance=k, down=True), *parts), spp=256)
        for k in (1, 2**20)
    )
    assert dim.mean.any() and (dim.mean * 2**20 == bright.mean).all()
    assert (dim.ledger == bright.ledger).all()


# -- scene files and output ------------------------------------------------------------------------


def test_scene_file_features(tmp_path):
    """Defaults, -D, include, references and a mesh with its own folder."""
    (tmp_path / "part").mkdir()
    (tmp_path / "part" / "quad.ply").write_text(
        "ply\nformat ascii 1.0\nelement vertex 4\nproperty float x\nproperty float y\n"
        "property float z\nelement face 1\nproperty list uchar int vertex_indices\nend_header\n"
        "-1 -1 0\n1 -1 0\n1 1 0\n-1 1 0\n4 0 1 2 3\n"
    )
    (tmp_path / "part" / "a.xml").write_text(
        '<scene version="3.0.0"><bsdf type="diffuse" id="grey">'
        '<rgb name="reflectance" value="$rho"/></bsdf><shape type="ply">'
        '<string name="filename" value="quad.ply"/><ref id="grey"/></shape></scene>'
    )
    main_file = tmp_path / "main.xml"
    main_file.write_text(
        '<scene version="3.0.0"><default name="rho" value="0.25"/>'
        '<include filename="part/a.xml"/>' + camera("0,0,3", "0,0,0") + constant(1) + "</scene>"
    )
    first, second = load(main_file), load(main_file, {"rho": "0.1, 0.2 0.3"})
    colours = [each.materials[each.material[0]].reflectance for each in (first, second)]
    assert (colours[0] == 0.25).all() and (colours[1] == [0.1, 0.2, 0.3]).all()
    assert first.triangles.shape == (2, 3, 3) and first.digest != second.digest
    assert (first.max_depth, first.rr_depth, first.spp) == (-1, 5, 4)


def test_mirrored_shapes(scene, tmp_path):
    """Fronts stay in front; Mitsuba 3.9.1 has it so for rectangle and cube, a mesh turns over."""
    (tmp_path / "q.obj").write_text("v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 3\n")

    def fronts(shape, scale, flip="false"):
        corners = scene(
            f"""<shape type="{shape}"><boolean name="flip_normals" value="{flip}"/>
            {'<string name="filename" value="q.obj"/>' * (shape == "obj")}<transform
            name="to_world"><scale {scale}="-2"/></transform></shape>""",
            INSIDE,
        ).triangles
        normals = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
        return normals, corners.mean(axis=1)

    for scale in "xyz":
        normals, centres = fronts("cube", scale)
        assert len(normals) == 12 and ((normals * centres).sum(axis=1) > 0).all()
        normals, centres = fronts("cube", scale, "true")
        assert ((normals * centres).sum(axis=1) < 0).all()
        up, mesh = fronts("rectangle", scale)[0][:, 2], fronts("obj", scale)[0][:, 2]
        assert (up < 0).all() if scale == "z" else (up > 0).all()
        assert (mesh < 0).all() if scale == "z" else (mesh > 0).all()


@pytest.mark.parametrize(
    "body, words",
    [
        ("<shape type='torus'/>", ["torus", "rectangle"]),
        ("<shape type='rectangle'><float name='size' value='1'/></shape>", ["size", "to_world"]),
        ("<shape type='rectangle'><ref id='no'/></shape>", ["no"]),
        ("<shape type='obj'><string name='filename' value='none.obj'/></shape>", ["none.obj"]),
        ("<bsdf type='diffuse' id='a'><rgb name='reflectance' value='1.5'/></bsdf>", ["1.5"]),
        ("<bsdf type='diffuse' id='a'><rgb name='reflectance' value='nan'/></bsdf>", ["nan"]),
        ("<bsdf type='diffuse' id='a'><rgb name='reflectance' value='$x'/></bsdf>", ["$x"]),
        ("<emitter type='constant'><rgb name='radiance' value='1 2'/></emitter>", ["1 2"]),
        ("<emitter type='constant'><spectrum name='radiance' value='1'/></emitter>", ["spectrum"]),
        ("<integrator type='direct'/>", ["direct", "path"]),
        (
            "<shape type='cube'><transform name='to_world'><scale x='0'/></transform></shape>",
            ["singular"],
        ),
        ("<banana/>", ["banana"]),
        ("<unclosed>", ["mismatch"]),
        ("", ["sensor"]),
    ],
)
def test_bad_scene_files(tmp_path, capsys, body, words):
    """An error names the file, the line (where there is one) and the value; no traceback."""
    path = tmp_path / "bad.xml"
    path.write_text(f'<scene version="3.0.0">\n{body}\n</scene>')
    with pytest.raises(SceneError) as caught:
        load(path)
    message = str(caught.value)
    assert str(path) in message and all(word in message for word in words)
    assert ":2:" in message or ":3:" in message or not body
    assert main(["render", str(path), "-o", str(tmp_path / "x.exr")]) == 2
    assert "error: " in capsys.readouterr().err and not (tmp_path / "x.exr").exists()


def test_exr_round_trip(scene, tmp_path):
    """Mean, standard error and batch means in float32, and the metadata."""
    picture = render(half_planes(scene, 2.5, 1.5, 4, 3, "tent"), spp=128, seed=9)
    path = tmp_path / "r.exr"
    write_exr(picture, path)
    channels, strings = read_exr(path)
    assert sorted(p.name for p in tmp_path.iterdir()) == ["r.exr", "scene.xml"]
    assert len(channels) == 3 * 66
    for c, name in enumerate("RGB"):
        assert (channels[name] == picture.mean[..., c].astype(np.float32)).all()
        assert (channels[f"stderr.{name}"] == picture.stderr[..., c].astype(np.float32)).all()
        assert (channels[f"batch.063.{name}"] == picture.batch_means[63, ..., c]).all()
    assert (strings["seed"], strings["spp"], strings["batches"]) == ("9", "128", "64")
    assert strings["device"].startswith("reference: embree")
    ledger = json.loads(strings["ledger"])
    assert list(ledger) == list(COLUMNS) and ledger["live"] == [4 * 3 * 128]
    for bad in (tmp_path / "none" / "r.exr", tmp_path):
        with pytest.raises(OSError, match="r.exr|cannot"):
            write_exr(picture, bad)
    assert sorted(p.name for p in tmp_path.iterdir()) == ["r.exr", "scene.xml"]


def test_command(scene, tmp_path, capsys):
    half_planes(scene, 2.5, 1.5, 4, 3, "box")
    out, numbers = tmp_path / "o.exr", tmp_path / "o.json"
    arguments = [
        "render",
        str(tmp_path / "scene.xml"),
        "-o",
        str(out),
        "--spp",
        "32",
        "--width",
        "6",
        "--height",
        "5",
        "--batches",
        "8",
        "--max-depth",
        "2",
        "--json",
        str(numbers),
    ]
    assert main(arguments) == 0
    channels, strings = read_exr(out)
    assert channels["R"].shape == (5, 6) and strings["max_depth"] == "2"
    assert json.loads(numbers.read_text("utf-8"))["ledger"]["live"][0] == 5 * 6 * 32
    assert "64/64" not in capsys.readouterr().err
    assert main([*arguments[:5], "33"]) == 2
    assert "multiple" in capsys.readouterr().err


# -- Mitsuba ---------------------------------------------------------------------------------------


@pytest.fixture(scope="module")
def mitsuba():
    module = pytest.importorskip("mitsuba", reason="the third voice: pip install mitsuba")
    module.set_variant("scalar_rgb")
    return module


@pytest.mark.parametrize("width, height", [(4, 7), (8, 3)])
@pytest.mark.parametrize("fov", ["x", "y", "diagonal", "smaller", "larger", "35mm"])
def test_mitsuba_camera(tmp_path, mitsuba, width, height, fov):
    """Directions of camera rays equal Mitsuba's to float32."""
    text = camera(
        "1,2,5",
        "0.3,0.1,-2",
        up="0.1,1,0",
        fov=40,
        width=width,
        height=height,
        extra=(
            f'<string name="fov_axis" value="{fov}"/><float name="principal_point_offset_x" '
            'value="0.1"/><float name="principal_point_offset_y" value="-0.2"/>'
        ),
    )
    if fov == "35mm":
        text = text.replace(
            '<float name="fov" value="40"/><string name="fov_axis" value="35mm"/>',
            '<string name="focal_length" value="35mm"/>',
        )
    text = f'<scene version="3.0.0">{text}</scene>'
    (tmp_path / "c.xml").write_text(text)

    class Recorder:
        drawn: list = []  # noqa: RUF012
        rng = np.random.default_rng(3)

        def random(self, n):
            self.drawn.append(self.rng.random(n))
            return self.drawn[-1]

    recorder = Recorder()
    recorder.drawn = []
    pixel = np.arange(width * height)
    ours = load(tmp_path / "c.xml")
    _, direction, *_ = camera_rays(ours.camera, ours.film, recorder, pixel)
    sensor = mitsuba.load_string(text).sensors()[0]
    for i, u, v in zip(pixel, *recorder.drawn, strict=True):
        place = [(i % width + u) / width, (i // width + v) / height]
        ray, _ = sensor.sample_ray(0, 0.5, place, [0.5, 0.5])
        assert np.abs(np.array(ray.d) - direction[:, i]).max() < 1e-6


@pytest.mark.parametrize("depth", [2, 8])
def test_mitsuba_cornell_box(tmp_path, mitsuba, depth):
    """16 blocks and the part below the lamp of cornell_box_mitsuba.xml at equal effort.

    64 batches each; Welch t tests, Sidak over 17 x 3. Mitsuba caps roulette at 0.95: same mean.
    """
    path = ROOT / "scenes" / "cornell" / "cornell_box_mitsuba.xml"
    if not path.exists():
        pytest.skip("scenes/cornell/cornell_box_mitsuba.xml is not there")
    spp = 64
    ours = with_settings(load(path), width=16, height=16, max_depth=depth)
    a = render(ours, spp=64 * spp).batch_means
    theirs = mitsuba.load_file(str(path), width=16, height=16, max_depth=depth)
    b = np.stack([np.array(mitsuba.render(theirs, spp=spp, seed=k)) for k in range(64)])
    assert a.shape == b.shape
    a, b = (
        np.concatenate(
            [
                x.reshape(64, 4, 4, 4, 4, 3).mean(axis=(2, 4)).reshape(64, -1),
                x[:, 4:].mean(axis=(1, 2)),
            ],
            axis=1,
        )
        for x in (a, b.astype(float))
    )
    difference = a.mean(axis=0) - b.mean(axis=0)
    error = np.sqrt((a.var(axis=0, ddof=1) + b.var(axis=0, ddof=1)) / 64)
    limit = stats.t.isf(ALPHA / 2 / difference.size, 63)
    seen = (limit + 1.28) * error[-3:] / a.mean(axis=0)[-3:]
    print("z", np.abs(difference / error).max(), "smallest bias seen", seen)
    assert (seen < 0.012).all()
    assert (np.abs(difference) <= limit * error).all()
