"""Stress of numbers and sizes: many samples, far indices, huge and tiny values, bad input, memory.

In every case no sample is non-finite and the ledger adds up, in addition to what the case states.
"""

from __future__ import annotations

import dataclasses
import math
import os
import subprocess
import sys
import tempfile
import warnings
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt
from scipy import stats

import veriray
from veriray.columns import COLUMNS
from veriray.gallery import pictures
from veriray.shipped import SHIPPED
from veriray_validate import dicts
from veriray_validate.form_factors import lambert
from veriray_validate.scenes import (
    Part,
    box,
    camera,
    checks,
    furnace,
    make,
    material,
    quad,
)
from veriray_validate.trial import Skipped, Trial, case

Array = npt.NDArray[Any]


# ---- many samples ----


@case(8, each={"spp": [10**6, 10**8, 10**9]}, quick=lambda spp: spp == 10**6)
def equal_samples(t: Trial, spp: int) -> None:
    """A sky of .1 in one pixel, 10^6, 10^8 and 10^9 samples (on a CPU 10^8).

    The mean equals the constant to the bit, without error (a float32 sum would be 1 % off, 79 %,
    98 %).
    """
    if spp > 10**8 and t.device.startswith("cpu"):
        raise Skipped("10^9 samples take minutes on a CPU; 10^8 are tested")
    r = t.render(make([], environment=0.1), -(-spp // t.effort))
    t.check(r.image == np.float32(0.1), str(r.image.ravel()))
    t.check(r.stderr == 0, "the samples differ")


# ---- far sample indices ----


@case(8)
def indices_across_two_to_the_32(t: Trial) -> None:
    """Sample ranges across 2^32, 2^33 and 2^63, and the last ones.

    A range equals its two halves bit for bit; no sample equals one elsewhere.
    """
    scene = furnace(0.7, 0.5, width=4, height=3)
    host = t.native_scene(scene)

    def film(begin: int, end: int) -> Array:
        result = t.native_film(4, 3)
        done = t.native.render(host, result, sample_begin=begin, sample_end=end)
        t.check(done["ledger"][0, 0] == 12 * (end - begin), "paths")
        words: Array = result.words()
        return words

    seen = set()
    for at in (2**32, 2**33, 2**63):
        whole, low, high = film(at - 3, at + 5), film(at - 3, at), film(at, at + 5)
        t.check(low[..., 0::2] + high[..., 0::2] == whole[..., 0::2], f"halves at {at}")
        seen |= {film(k, k + 1).tobytes() for k in range(at - 3, at + 5)}
    seen |= {film(k, k + 1).tobytes() for k in range(8)}
    t.check(len(seen) == 32, "a sample twice")
    t.check(film(2**64 - 4, 2**64 - 1).any(), "the last samples")


@case(8, each={"begin": [2**32 - 100_000, 2**63 - 100_000]})
def same_statistics_far_out(t: Trial, begin: int) -> None:
    """The furnace over samples 2^32 - 10^5 ... 2^32 + 10^5, and 2^63.

    E / (1 - rho) = 1; sees 0.4 %.
    """
    host, film, n = t.native_scene(furnace(0.5, 0.5)), t.native_film(1, 1), 200_000 * t.effort
    t.native.render(host, film, seed=t.fresh(), sample_begin=begin, sample_end=begin + n)
    mean, error = (float(x[0, 0, 0]) for x in film.resolve())
    t.p(2 * float(stats.norm.sf(max(abs(mean - 1) - 1e-5, 0) / error)), "furnace")
    t.sees(4.57 * error, 0.006)


@case(8)
def films_of_more_than_two_to_the_32_samples(t: Trial) -> None:
    """Two films of one sample, added to each other in turn until they hold 2^48.

    Each holds a Fibonacci number of either sample: sums and number of samples are those of Python's
    integers, exactly, at each step.
    """
    host = t.native_scene(furnace(0.7, 0.5, width=4, height=3))
    films = [t.native_film(4, 3), t.native_film(4, 3)]
    for k, film in enumerate(films):
        t.native.render(host, film, sample_begin=k, sample_end=k + 1)
    words = [film.words().astype(object) for film in films]
    sums = [w[..., 0::2] + (w[..., 1::2] << 64) for w in words]
    counts = [1, 1]
    while counts[0] < 2**48:
        films[0].add(films[1])
        sums[0], counts[0] = (sums[0] + sums[1]) % 2**128, counts[0] + counts[1]
        now = films[0].words().astype(object)
        t.check(films[0].samples == counts[0], f"{films[0].samples} of {counts[0]} samples")
        t.check(now[..., 0::2] + (now[..., 1::2] << 64) == sums[0], f"{counts[0]} samples")
        films, sums, counts = films[::-1], sums[::-1], counts[::-1]


@case(8, quick=False)
def more_than_two_to_the_32_paths_in_one_call(t: Trial) -> None:
    """16 x 16 pixels, 2^24 + 800 samples: 2^32 paths and 204,800 more.

    One call gives the ledger and the film of two that meet within a job, bit for bit; live[0] is
    the number of paths. Three lamps, narrow stripes. Minutes on one thread.
    """
    lamps = [quad([-9, y, 9], [0, 0.2, 0.1], [18, 0, 0], 0, y + 4) for y in (-2.1, -0.2, 1.6)]
    view = camera([0, 0, 0], [0.1, 0.2, 1], 40)
    host = t.native_scene(make(lamps, view, width=16, height=16))
    n, middle, seed = 2**24 + 800, 10_000_000, 2016  # a matter of counting, whatever the numbers

    def render(begin: int, end: int, film: Any) -> Array:
        done = t.native.render(host, film, seed=seed, sample_begin=begin, sample_end=end)
        ledger: Array = done["ledger"]
        return ledger

    whole, parts = t.native_film(16, 16), t.native_film(16, 16)
    ledger = render(0, n, whole)
    t.check(ledger[0, 0] == 256 * n and ledger[0, 0] > 2**32, f"{ledger[0, 0]} paths")
    again = render(0, middle, parts) + render(middle, n, parts)
    t.check(ledger == again, "another ledger")
    t.check(whole.words() == parts.words(), "different bits")


# ---- film sizes and settings ----


@case(8, each={"size": [(1, 1), (1, 16384), (16384, 1), (1, 65536), (65536, 1), (8191, 3)]})
def film_sizes(t: Trial, size: tuple[int, int]) -> None:
    """Films of 1 x 1, 16384 x 1, 1 x 65536 and odd sizes.

    The furnace, cut after direct light: .75 within .02, 40 standard errors, by one sample per pixel
    or 16384 of the only one; every pixel shows at least what its wall emits, also by one sample.
    """
    width, height = size
    room = furnace(0.5, 0.5, max_depth=2)
    for spp in sorted({1, max(1, 16384 // (width * height))}):
        r = t.render(room, spp, width=width, height=height)
        t.check(r.image.shape == (height, width, 3), "shape")
        t.check(r.image >= 0.5, "less than the wall emits")
    off = abs(r.image.mean(dtype=np.float64) - 0.75)
    t.check(off < 0.02, f"off by {off:.2g}")


@case(8)
def sizes_that_are_none(t: Trial) -> None:
    """Width, height or spp of 0, below 0 and beyond 2^40.

    ValueError.
    """
    scene = furnace(0.5, 0.5, max_depth=2)
    rows: list[dict[str, Any]] = [
        {"width": 0}, {"height": 0}, {"spp": 0}, {"width": -3}, {"spp": 2**63}, {"spp": -1},
    ]  # fmt: skip
    for bad in rows:
        settings = {"spp": 1, "device": t.device, **bad}
        t.raises(ValueError, lambda s=settings: veriray.render(scene, **s))  # type: ignore[misc]


@case(8)
def depth_zero_is_emission_alone(t: Trial) -> None:
    """max_depth 0 and 1.

    The walls' radiance exactly, all paths in depth_cut.
    """
    scene = furnace(0.5, 0.5, width=4, height=4)
    for depth in (0, 1):
        r = t.render(scene, 4, max_depth=depth)
        t.check(r.image == 0.5, "emission")
        t.check(r.stats["ledger"]["depth_cut"] == [16 * r.spp], "ends")


MEMORY = """
import resource, sys, veriray
with open("/proc/self/statm") as file:
    limit = int(file.read().split()[0]) * resource.getpagesize() + (8 << 30)
resource.setrlimit(resource.RLIMIT_AS, (limit, limit))
try:
    veriray.render(veriray.cornell_box(), spp=1, width=20000, height=20000, device=sys.argv[1])
except MemoryError as error:
    print("MemoryError:", error)
"""


@case(8)
def a_film_beyond_memory(t: Trial) -> None:
    """400 million pixels in 8 GiB more of address space.

    MemoryError before work starts, with the number of bytes.
    """
    if not t.device.startswith("cpu"):
        raise Skipped("the limit is on host memory")
    if "libasan" in os.environ.get("LD_PRELOAD", ""):
        raise Skipped("AddressSanitizer ends a process whose operator new fails")
    done = subprocess.run([sys.executable, "-c", MEMORY, t.device], capture_output=True, text=True)
    t.check(done.returncode == 0, done.stderr)
    t.check(done.stdout.startswith("MemoryError:") and "38400000000" in done.stdout, done.stdout)


PEAK = """
import resource, sys, veriray
scene = veriray.cornell_box().with_(width=32, height=32)
for scheduler in ("fused", "thrust", "wavefront") if sys.argv[3] == "all" else ("fused",):
    veriray.render(scene, spp=int(sys.argv[1]), device=sys.argv[2], scheduler=scheduler)
print(resource.getrusage(resource.RUSAGE_SELF).ru_maxrss)
"""


@case(8, each={"which": ["all", "fused"]}, quick=False)
def memory_does_not_depend_on_spp(t: Trial, which: str) -> None:
    """Peak resident memory at 16 and at 512 (all schedulers) or 4,096 spp.

    Equal within 1 %.
    """
    if not t.device.startswith("cpu"):
        raise Skipped("a GPU's memory is not the process's: Film.memory and Scene.memory state it")

    def peak(spp: int) -> int:
        done = subprocess.run([sys.executable, "-c", PEAK, str(spp), t.device, which],
                              capture_output=True, text=True, check=True)  # fmt: skip
        return int(done.stdout)

    few, many = min(peak(16) for _ in range(2)), peak(512 if which == "all" else 4096)
    t.check(abs(many / few - 1) < 0.01, f"{few} and {many} KiB")


# ---- range of values ----


@case(8, each={"radiance": [1e30, 1e-30]})
def extreme_radiance(t: Trial, radiance: float) -> None:
    """The furnace at 10^30 and 10^-30; beyond.

    2 E, sees 1 %, with finite errors; 10^33 and 10^-33 raise an error that names them.
    """
    t.agrees(furnace(0.5, radiance), 2 * float(np.float32(radiance)), 100_000, 0.01)
    factor = 1e3 if radiance > 1 else 1e-3
    t.raises(ValueError,
             lambda: veriray.render(furnace(0.5, radiance * factor), spp=1, device=t.device),
             "radiance")  # fmt: skip


@case(8, each={"exponent": [-60, 60]})
def emission_times_a_power_of_two(t: Trial, exponent: int) -> None:
    """The Cornell box with all its light times 2^60 and 2^-60.

    The picture and its errors times 2^k, to the bit: nothing is clamped, nothing is lost.
    """
    scene = veriray.cornell_box().with_(width=16, height=16)
    seed = t.fresh()
    a, b = (t.render(s, 16, seed=seed)
            for s in (scene, scene.with_emission_scaled(2.0**exponent)))  # fmt: skip
    for x, y in ((a.image, b.image), (a.stderr, b.stderr)):
        t.check(x * np.float32(2.0**exponent) == y, "a pixel differs")


def batches_agree(t: Trial, scene: veriray.Scene, exact: float, spp: int, sees: float) -> None:
    """Student's test of 64 batch means; the film's own errors end at 2^-38 of the brightest."""
    r = t.render(scene, spp, batches=64)
    means = np.asarray(r.batch_means, np.float64)[:, 0, 0, 0] / exact
    t.check(means.std() < 0.2, f"batches spread by {means.std():.2g}")
    t.p(float(stats.ttest_1samp(means, 1).pvalue), "batches")
    t.sees(4.57 * float(means.std(ddof=1)) / 8, sees)


LIT = 0.5 * lambert([0, 0, 0], [0, 0, 1], [[-1, -1, 1], [1, -1, 1], [1, 1, 1], [-1, 1, 1]])


@case(8)
def emission_ratio_of_a_trillion(t: Trial) -> None:
    """A lamp of 10^6, and one of 10^-6 that alone lights the point.

    Its light is not lost: almost all light samples go to the bright lamp, so the material's samples
    make the estimate. Sees 1 %.
    """
    floor = quad([-5, -5, 0], [10, 0, 0], [0, 10, 0], 0.5)
    dim = quad([-1, -1, 1], [0, 2, 0], [2, 0, 0], 0, 1e-6)
    bright = quad([-1, -1, -1], [2, 0, 0], [0, 2, 0], 0, 1e6)  # below the floor
    scene = make([floor, dim, bright], camera([1.5, 1.2, 0.5], [0, 0, 0]))
    batches_agree(t, scene, LIT * float(np.float32(1e-6)), 640_000, 0.01)


@case(8)
def albedo_zero_and_one(t: Trial) -> None:
    """Black walls, white walls to a depth of 200.

    Black walls end every path at once (exact). White walls never do: all paths are cut, except for
    the stated leaks at edges, and the sum is 200 within 1 %.
    """
    r = t.render(furnace(0.0, 2.0, width=4, height=4), 10)
    t.check(r.image == 2, "black walls")
    t.check(r.stats["live_rays"] == [16 * r.spp], "segments")
    r = t.render(furnace(1.0, 1.0, max_depth=200), 100)
    left = int(t.leaks(r).sum())
    t.check(r.stats["ledger"]["depth_cut"][-1] == r.spp - left, "ends")
    t.check(abs(r.image.mean() / 200 - 1) < 0.01 + left / r.spp, "white walls")


@case(8)
def dark_surface_under_a_bright_light(t: Trial) -> None:
    """Reflectance 2^-60 under a radiance of 2^90.

    Nothing is lost on the way. Sees 1 %.
    """
    floor = quad([-5, -5, 0], [10, 0, 0], [0, 10, 0], 2.0**-60)
    lamp = quad([-1, -1, 1], [0, 2, 0], [2, 0, 0], 0, 2.0**90)
    scene = make([floor, lamp], camera([1.5, 1.2, 0.5], [0, 0, 0]), max_depth=2)
    batches_agree(t, scene, 2.0**30 * 2 * LIT, 640_000, 0.01)


# ---- bad input ----


def bad_columns(
    scene: veriray.Scene,
) -> Iterator[tuple[str, Callable[[], object], tuple[str, ...]]]:
    """What is spoilt, the call that must fail, and what its message must hold."""
    for name, column in COLUMNS.items():
        values = np.asarray(getattr(scene, name))
        if not values.size:
            continue
        if values.dtype.kind == "f":
            for bad in (math.nan, math.inf, -math.inf):
                spoilt = np.array(values, np.float64)
                index = tuple(n - 1 for n in spoilt.shape)
                spoilt[index] = bad
                place = "".join(f"[{i}]" for i in index)
                yield (f"{name}{place} = {bad}",
                       lambda n=name, v=spoilt: dataclasses.replace(scene, **{n: v}),  # type: ignore[misc]
                       (f"{name}{place}",))  # fmt: skip
        elif column.indexes:
            for wrong in (2**31, -2):
                spoilt = np.array(values, np.int64)
                spoilt.flat[-1] = wrong
                yield (f"{name} = {wrong}",
                       lambda n=name, v=spoilt: dataclasses.replace(scene, **{n: v}),  # type: ignore[misc]
                       (name,))  # fmt: skip


@case(8, once=True)
def bad_numbers_are_refused(t: Trial) -> None:
    """NaN, infinities and indices out of range in every array, camera and film setting.

    SceneError or ValueError that names the array or setting, and the index; nothing is rendered.
    """
    fog = dicts.medium(1.0, 0.5)
    scene = dicts.scene(
        dicts.view([0, 0, 5], [0, 0, 0], 40, 4),
        dicts.sphere([0, 0, 0], 1, dicts.glass(1.5), interior=fog),
        dicts.flat("disk", [0, 0, 3], [0, 0, -1], 1, dicts.BLACK, 2),
        dicts.flat("rectangle", [0, 0, -2], [0, 0, 1], 3, dicts.diffuse(0.5)),
        {"type": "point", "position": np.array([0, 2.0, 0]), "intensity": dicts.rgb(1)},
        dicts.sky(1),
    )
    count = 0
    for what, call, words in bad_columns(scene):
        try:
            call()
        except veriray.SceneError as error:
            missing = [w for w in words if w not in str(error)]
            t.check(not missing, f"{what}: {error}")
        else:
            t.check(False, f"{what} is accepted")
        count += 1
    t.check(count > 80, f"only {count} arrays spoilt")
    view = scene.camera
    for name in ("fov", "near_clip", "far_clip", "aperture_radius", "focus_distance"):
        for bad in (math.nan, -1.0, -math.inf):
            t.raises(ValueError,
                     lambda n=name, b=bad: dataclasses.replace(view, **{n: b}))  # type: ignore[misc]  # fmt: skip
    matrix = np.array(view.to_world)
    for bad in (math.nan, math.inf):
        matrix[1, 3] = bad
        t.raises(ValueError, lambda: dataclasses.replace(view, to_world=matrix))
    for kind, parameter in (("tent", math.nan), ("gaussian", math.inf), ("gaussian", -1.0)):
        t.raises(ValueError, lambda k=kind, p=parameter: veriray.Film(4, 4, k, p))  # type: ignore[misc]
    for factor in (math.nan, math.inf, 0.0, -1.0):
        t.raises(ValueError, lambda f=factor: scene.scaled(f))  # type: ignore[misc]
        t.raises(ValueError, lambda f=factor: scene.with_emission_scaled(f))  # type: ignore[misc]


# ---- samples that are not finite ----


def too_bright() -> veriray.Scene:
    """Indices 1600, 40, 1 one behind the other before a sky of 1.9: radiance goes with the squared
    index, and all that is not reflected comes within 1/1600 of the axis, in the middle of 9 pixels.
    """
    sheets = [
        quad(
            [-500, -500, z], [1000, 0, 0], [0, 1000, 0], material=material("dielectric", eta=1 / 40)
        )
        for z in (0, -1)
    ]
    view = camera([0, 0, 4], [0, 0, 0], math.degrees(9 * 1.4e-3), up=[0, 1, 0])
    return make(sheets, view, 1.9, width=9, height=9, max_depth=3)


@case(8)
def a_sample_beyond_the_film_is_located(t: Trial) -> None:
    """Planted: the sky from within glass in glass, 2.6e6 times brighter, too bright for the film.

    The samples that the film cannot hold are counted and listed with pixel, sample and radiance.
    All belong to the one pixel that sees the spot; every other pixel is as it should be.
    """
    scene = too_bright()
    with warnings.catch_warnings(record=True) as warned:
        warnings.simplefilter("always")
        r = veriray.render(scene, spp=4_000, seed=t.fresh(), device=t.device)
    t.check([w.category is veriray.RefusedSamplesWarning for w in warned] == [True], "the warning")
    faults, listed = r.stats["nonfinite_samples"], r.stats["nonfinite"]
    t.check(faults > 0, "no sample is refused")
    t.check(sum(r.stats["ledger"]["invalid"]) == faults, "the ledger's count differs")
    t.check(len(listed) == min(faults, 64), "the list's length")
    t.check([row[:2] == [4, 4] for row in listed], "another pixel")
    t.check([max(row[3:]) > 2.0**14 for row in listed], "a radiance")
    t.check(np.isfinite(r.image) & np.isfinite(r.stderr), "the picture")
    t.figure("samples refused", faults)


def shipped() -> dict[str, Any]:
    """Scene files that come with veriray, by name."""
    return {**{name: name for name in SHIPPED}, **checks(),
            **{f"gallery/{name}": name for name in pictures.names()}}  # fmt: skip


@case(8, each={"name": shipped()}, quick=lambda name: not name.startswith("gallery/"))
def shipped_scenes_are_finite(t: Trial, name: str) -> None:
    """Every shipped scene, the gallery's pictures too, 24 x 24 pixels, 16 samples.

    No sample is refused, every path is accounted for.
    """
    file = shipped()[name]
    if name.startswith("gallery/"):
        with tempfile.TemporaryDirectory() as folder:
            scene = pictures.load(file, Path(folder))
    else:
        scene = veriray.load_file(file)
    r = t.render(scene.with_(width=24, height=24), 16)
    t.check(np.isfinite(r.image) & np.isfinite(r.stderr), "the picture")
    t.check(not any(r.stats["ledger"]["invalid"]), "invalid paths")


@case(8)
def room_full_of_everything(t: Trial) -> None:
    """Degenerate parts, extreme albedos and emissions of 1e-20 to 1e20 in one room.

    Finite, and nothing is refused.
    """
    parts = [box([-1, -1, -1], [1, 1, 1], True, 0.5, 1e-20),
             Part([[0, 0, 0], [1e-7, 0, 0], [0, 1e-7, 0]], [[0, 1, 2]], 1.0, 1e20)]  # fmt: skip
    for k in range(20):
        corner = t.rng.uniform(-0.8, 0.8, 3)
        sides = t.rng.normal(size=(2, 3)) * 10.0 ** t.rng.uniform(-6, -0.5, (2, 1))
        parts.append(quad(corner, *sides, [0.0, 1.0, 10.0**-k], 0.0, two_sided=True))
    r = t.render(make(parts, camera([0.1, 0.9, 0.2], [0, 0, 0], 90), width=16, height=16), 64)
    t.check(np.isfinite(r.image) & np.isfinite(r.stderr), "the picture")
