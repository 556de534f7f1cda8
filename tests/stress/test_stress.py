"""Numbers at the edge: many samples, far indices, empty and strange scenes, huge and tiny values.

In every case the film is finite and the ledger adds up.
"""

from __future__ import annotations

import dataclasses
import resource
import subprocess
import sys
import warnings

import numpy as np
import pytest
from scipy import stats

import veriray
from tests.support import (
    FAST,
    Part,
    agrees,
    box,
    camera,
    confirm,
    furnace,
    lambert,
    ledger_adds_up,
    make,
    native,
    native_film,
    native_scene,
    quad,
)

pytestmark = pytest.mark.parametrize("device", FAST)


# ---- N14: many samples ----


def constant(spp: int, device: str) -> None:
    scene = make([], environment=0.1)
    r = veriray.render(scene, spp=spp, device=device)
    assert (r.image == np.float32(0.1)).all(), r.image
    assert (r.stderr == 0).all()


def test_n14_a_million_equal_samples(device: str) -> None:
    """The mean equals the constant to the bit (a float32 sum would be 1 % off), without error."""
    constant(10**6, device)


def test_n14_a_hundred_million_equal_samples(device: str) -> None:
    """As above, 10^8 (a float32 sum would be 79 % off)."""
    constant(10**8, device)


# ---- N15: far sample indices ----


def test_n15_indices_across_two_to_the_32(device: str) -> None:
    """A range over the boundary is its two halves, and no sample is one of another boundary."""
    scene = furnace(0.7, 0.5, width=4, height=3)
    module, host = native(device), native_scene(scene, device)

    def film(begin: int, end: int) -> np.ndarray:
        result = native_film(4, 3, device)
        done = module.render(host, result, sample_begin=begin, sample_end=end)
        assert done["ledger"][0, 0] == 12 * (end - begin)
        return result.words()

    seen = set()
    for at in (2**32, 2**33, 2**63):
        whole, low, high = film(at - 3, at + 5), film(at - 3, at), film(at, at + 5)
        total = low[..., 0::2] + high[..., 0::2]
        assert (total == whole[..., 0::2]).all()
        seen |= {film(k, k + 1).tobytes() for k in range(at - 3, at + 5)}
    seen |= {film(k, k + 1).tobytes() for k in range(8)}
    assert len(seen) == 32
    assert film(2**64 - 4, 2**64 - 1).any()


@pytest.mark.parametrize("begin", [2**32 - 100_000, 2**63 - 100_000])
def test_n15_same_statistics_far_out(device: str, begin: int) -> None:
    """A1 over samples 2^32 - 10^5 ... 2^32 + 10^5: sees 0.4 %."""
    scene = furnace(0.5, 0.5)
    module, host = native(device), native_scene(scene, device)

    def p_value(effort: int, seed: int) -> float:
        film, n = native_film(1, 1, device), 200_000 * effort
        module.render(host, film, seed=seed, sample_begin=begin, sample_end=begin + n)
        mean, error = (float(x[0, 0, 0]) for x in film.resolve())
        return 2 * float(stats.norm.sf(max(abs(mean - 1) - 1e-5, 0) / error))

    confirm(p_value)


# ---- N17: strange scenes ----


def test_n17_empty_and_dark(device: str) -> None:
    """No light: exactly black; no surface: the sky, exactly; nothing at all: black."""
    sky = [0.25, 1.0, 4.0]
    room = box([0, 0, 0], [1, 1, 1], True, 0.5)
    inside = camera([0.5, 0.5, 0.5], [1, 0.9, 0.8], 60)
    for parts, environment, exact in (
        ([], 0.0, 0.0), ([], sky, sky), ([room], 0.0, 0.0), ([room], sky, 0.0),
    ):  # fmt: skip
        r = veriray.render(make(parts, inside, environment, 7, 5), spp=20, device=device)
        ledger_adds_up(r)
        assert (r.image == np.float32(exact)).all() and not r.stderr.any()
        shadows = r.stats["ledger"]["shadow_visible"]
        assert not any(shadows)
        if not parts:
            assert r.stats["live_rays"] == [700]


def test_n17_camera_in_odd_places(device: str) -> None:
    """Inside an emitter's solid (backs do not shine), inside a black solid, on a surface."""
    view = camera([0, 0, 0], [1, 2, 3], 90)
    solid = box([-1, -1, -1], [1, 1, 1], False, 0.5, 3.0)
    r = veriray.render(make([solid], view, 1.0, 6, 6), spp=20, device=device)
    assert not r.image.any() and r.stats["ledger"]["absorbed"] == [720]
    shining = box([-1, -1, -1], [1, 1, 1], True, 0.0, 3.0)
    r = veriray.render(make([shining], view, 1.0, 6, 6), spp=20, device=device)
    assert (r.image == 3).all() and r.stats["ledger"]["emitter_end"] == [720]
    for part in (solid, shining, quad([-1, -1, 0], [2, 0, 0], [0, 2, 0], 0.5, two_sided=True)):
        for where in ([0, 0, 1.0], [1, 1, 1], [0, 0, 0]):
            r = veriray.render(
                make([part], camera(where, [3, 4, 5], 90), 1.0, 6, 6), spp=50, device=device
            )
            ledger_adds_up(r)
            assert r.stats["nonfinite_samples"] == 0 and np.isfinite(r.image).all()
            assert r.image.max() <= 4


def test_n17_mirrored_and_stretched(device: str) -> None:
    """A mirrored world and camera: the same picture. A box of 10^6 : 1 stays closed."""
    room = veriray.cornell_box().with_(width=24, height=24)
    flip = np.diag([-1.0, 1.0, 1.0])
    to_world = np.array(room.camera.to_world)
    to_world[:3] = flip @ to_world[:3]
    mirrored = dataclasses.replace(
        room, vertices=room.vertices @ flip, triangles=room.triangles[:, ::-1],
        camera=dataclasses.replace(room.camera, to_world=to_world),
    )  # fmt: skip

    def p_value(effort: int, seed: int) -> float:
        a, b = (veriray.render(s, spp=64 * effort, seed=seed + k, device=device, batches=64)
                for k, s in enumerate((room, mirrored)))  # fmt: skip
        d = (a.batch_means - b.batch_means).mean(axis=(1, 2))
        return float(min(1.0, 3 * stats.ttest_1samp(d, 0).pvalue.min()))

    confirm(p_value)
    thin = make([box([0, 0, 0], [1, 1, 1e-6], True, 0.5, 0.5)], camera(
        [0.4, 0.3, 0.5e-6], [0.9, 0.3, 0.6e-6], 1.0))  # fmt: skip
    r = agrees(thin, 1.0, device, 20_000, sees=0.05, margin=1e-3)
    assert sum(r.stats["ledger"]["escaped"]) == 0


def test_n17_singular_transform_is_refused(device: str) -> None:
    with pytest.raises(veriray.SceneError, match="singular"):
        veriray.load_dict({
            "type": "scene",
            "sensor": {"type": "perspective", "fov": 40.0},
            "flat": {"type": "rectangle", "to_world": np.diag([1.0, 0.0, 1.0, 1.0])},
        })  # fmt: skip


# ---- N18: film sizes and settings ----


def test_n18_sizes(device: str) -> None:
    scene = furnace(0.5, 0.5, max_depth=2)
    for width, height in ((1, 1), (1, 65536), (65536, 1), (8191, 3)):
        r = veriray.render(scene, spp=1, width=width, height=height, device=device)
        ledger_adds_up(r)
        assert r.image.shape == (height, width, 3)
        assert abs(r.image.mean(dtype=np.float64) - 0.75) < (0.2 if width * height < 9 else 0.02)
    for bad in ({"width": 0}, {"height": 0}, {"spp": 0}, {"width": -3}, {"spp": 2**63}):
        with pytest.raises(ValueError):
            veriray.render(scene, device=device, **{"spp": 1, **bad})


def test_n18_depth_zero_is_emission_alone(device: str) -> None:
    scene = furnace(0.5, 0.5, width=4, height=4)
    for depth in (0, 1):
        r = veriray.render(scene, spp=4, max_depth=depth, device=device)
        assert (r.image == 0.5).all() and r.stats["ledger"]["depth_cut"] == [64]


MEMORY = """
import resource, sys, veriray
resource.setrlimit(resource.RLIMIT_AS, (8 << 30, 8 << 30))
try:
    veriray.render(veriray.cornell_box(), spp=1, width=20000, height=20000, device=sys.argv[1])
except MemoryError as error:
    print("MemoryError:", error)
"""


def test_n18_a_film_beyond_memory_is_a_memory_error(device: str) -> None:
    """400 million pixels in 8 GiB of address space: refused before work starts, with the number."""
    if not device.startswith("cpu"):
        pytest.skip("the limit is on host memory")
    done = subprocess.run([sys.executable, "-c", MEMORY, device], capture_output=True, text=True)
    assert done.returncode == 0, done.stderr
    assert done.stdout.startswith("MemoryError:") and "38400000000" in done.stdout


# ---- N20: range of values ----


@pytest.mark.parametrize("radiance", [1e30, 1e-30])
def test_n20_extreme_radiance(device: str, radiance: float) -> None:
    """The furnace at 10^30 and 10^-30: finite and right, with finite errors; beyond: refused."""
    scene = furnace(0.5, radiance)
    agrees(scene, 2 * float(np.float32(radiance)), device, 100_000, sees=0.01)
    factor = 1e3 if radiance > 1 else 1e-3
    with pytest.raises(ValueError, match="radiance"):
        veriray.render(furnace(0.5, radiance * factor), spp=1, device=device)


def batches_agree(scene: veriray.Scene, exact: float, device: str, spp: int) -> None:
    """t-test of 64 batch means: the film's own errors end at 2^-38 of the largest radiance."""

    def p_value(effort: int, seed: int) -> float:
        r = veriray.render(scene, spp=spp * effort, seed=seed, device=device, batches=64)
        ledger_adds_up(r)
        means = r.batch_means[:, 0, 0, 0] / exact
        assert means.std() < 0.2
        return float(stats.ttest_1samp(means, 1).pvalue)

    confirm(p_value)


LIT = 0.5 * lambert([0, 0, 0], [0, 0, 1], [[-1, -1, 1], [1, -1, 1], [1, 1, 1], [-1, 1, 1]])


def test_n20_emission_ratio_of_a_trillion(device: str) -> None:
    """A lamp of 10^6 and one of 10^-6 that alone lights the point: it is found and not lost.

    Almost all light samples go to the bright one: the estimate is the BSDF's. Sees 0.5 %.
    """
    floor = quad([-5, -5, 0], [10, 0, 0], [0, 10, 0], 0.5)
    dim = quad([-1, -1, 1], [0, 2, 0], [2, 0, 0], 0, 1e-6)
    bright = quad([-1, -1, -1], [2, 0, 0], [0, 2, 0], 0, 1e6)  # below the floor
    view = camera([1.5, 1.2, 0.5], [0, 0, 0])
    batches_agree(make([floor, dim, bright], view), LIT * float(np.float32(1e-6)), device, 640_000)


def test_n20_albedo_zero_and_one(device: str) -> None:
    """Black walls end every path at once; white walls never do: max_depth does."""
    r = veriray.render(furnace(0.0, 2.0, width=4, height=4), spp=10, device=device)
    assert (r.image == 2).all() and r.stats["live_rays"] == [160]
    r = veriray.render(furnace(1.0, 1.0, max_depth=200), spp=100, device=device)
    assert r.stats["ledger"]["depth_cut"][-1] == 100
    assert abs(r.image.mean() / 200 - 1) < 0.01


def test_dark_surface_under_a_bright_light(device: str) -> None:
    """Reflectance 2^-60 under a radiance of 2^90: nothing is lost on the way. Sees 0.3 %."""
    floor = quad([-5, -5, 0], [10, 0, 0], [0, 10, 0], 2.0**-60)
    lamp = quad([-1, -1, 1], [0, 2, 0], [2, 0, 0], 0, 2.0**90)
    view = camera([1.5, 1.2, 0.5], [0, 0, 0])
    scene = make([floor, lamp], view, max_depth=2)
    batches_agree(scene, 2.0**30 * 2 * LIT, device, 640_000)


# ---- memory ----

PEAK = """
import resource, sys, veriray
scene = veriray.cornell_box().with_(width=32, height=32)
for scheduler in ("fused", "thrust") if sys.argv[3] == "all" else ("fused",):
    veriray.render(scene, spp=int(sys.argv[1]), device=sys.argv[2], scheduler=scheduler)
print(resource.getrusage(resource.RUSAGE_SELF).ru_maxrss)
"""


@pytest.mark.parametrize("which", ["all", "fused"])
def test_memory_does_not_depend_on_spp(device: str, which: str) -> None:
    """Peak resident memory at 16 and at 512 (both schedulers) or 4,096 spp is equal within 1 %."""
    if not device.startswith("cpu"):
        pytest.skip("a GPU's memory is not the process's: Film.memory and Scene.memory state it")

    def peak(spp: int) -> int:
        done = subprocess.run([sys.executable, "-c", PEAK, str(spp), device, which],
                              capture_output=True, text=True, check=True)  # fmt: skip
        return int(done.stdout)

    few, many = min(peak(16) for _ in range(2)), peak(512 if which == "all" else 4096)
    assert abs(many / few - 1) < 0.01, f"{few} and {many} KiB"


def test_degenerate_parts_of_a_scene_do_no_harm(device: str) -> None:
    """A thousand triangles in one place, and points and lines among them: bounded and finite."""
    corners = np.tile([[0.0, 0, 0], [1, 0, 0], [0, 1, 0]], (1000, 1))
    pile = Part(corners, np.arange(3000), 0.5)
    lines = Part([[0, 0, 1], [1, 1, 1], [2, 2, 1]], [[0, 1, 2], [0, 0, 0]], 0.5, 9.0)
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", veriray.SceneWarning)
        scene = make([pile, lines], camera([0.3, 0.3, 2], [0.3, 0.3, 0]), 1.0)
    host = native_scene(scene, device)
    assert {k: n for k, n in host.primitives.items() if n} == {"triangles": 1000, "dropped": 2}
    agrees(scene, 0.5, device, 50_000, sees=0.03)
    assert resource.getrusage(resource.RUSAGE_SELF).ru_maxrss < 8 << 20
