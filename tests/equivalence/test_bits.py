"""The bit contract: a film depends on scene, settings, seed and sample range alone.

Compared are the film's exact words and the ray ledger, both whole, as one SHA-256.
`python -m tests.equivalence.test_bits` writes recorded.json anew.
"""

from __future__ import annotations

import dataclasses
import hashlib
import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from scipy import stats

import veriray
from tests.support import (
    FAST,
    Part,
    box,
    camera,
    confirm,
    furnace,
    make,
    max_z,
    native,
    native_film,
    native_scene,
    quad,
)

RECORDED = Path(__file__).with_name("recorded.json")
FOLDER = Path(__file__).resolve().parents[2] / "scenes" / "checks"
#: Small scenes that together hold every shape, material, medium, light, camera and filter.
CHECKS = tuple(sorted(path.stem for path in FOLDER.glob("*.xml")))


def check_scene(name: str, size: int = 16) -> veriray.Scene:
    """A scene of scenes/checks."""
    return veriray.load_file(FOLDER / f"{name}.xml").with_(width=size, height=size)


SCENES = {
    "cornell-box": lambda: veriray.cornell_box().with_(width=24, height=20),
    "open": lambda: veriray.load_file("open").with_(width=24, height=20),
    "mesh": lambda: mesh_scene(),
    "furnace, gaussian filter": lambda: furnace(0.9, 1.0, width=24, height=20, filter="gaussian"),
    "touching media": lambda: check_scene("touching_media"),
    "300 spheres": lambda: check_scene("spheres_300"),
    "thin lens": lambda: check_scene("thinlens"),
    "mitchell filter": lambda: check_scene("mitchell"),
}
SPP = 24


def mesh_scene() -> veriray.Scene:
    """A tree, triangle lights, an environment, a tent filter and clipping."""
    rng = np.random.default_rng(21)
    v = rng.uniform(-1, 1, (120, 1, 3)) + rng.normal(0, 0.2, (120, 3, 3))
    soup = Part(v, np.arange(360), [0.8, 0.5, 0.2], two_sided=True)
    lamp = Part(v[:6] + [0, 2, 0], np.arange(18), 0.1, [5, 4, 3])
    view = camera([0, 0, -4], [0, 0, 0], 50, near_clip=3.2, far_clip=5.0)
    return make([soup, lamp, quad([-3, -1.5, -3], [0, 0, 6], [6, 0, 0], 0.5)], view, 0.3, 24, 20,
                filter="tent")  # fmt: skip


def words(scene: veriray.Scene, device: str, begin: int = 0, end: int = SPP, **more: Any) -> Any:
    """Film and ledger of a sample range."""
    film = native_film(scene.film.width, scene.film.height, device)
    range_ = {"sample_begin": begin, "sample_end": end}
    depths = {"max_depth": scene.max_depth, "rr_depth": scene.rr_depth}
    done = native(device).render(native_scene(scene, device), film, **range_, **depths, **more)
    assert done["nonfinite_samples"] == 0
    return film, done["ledger"]


def sha(film: Any, ledger: Any) -> str:
    """Of the film's integers and the ledger's."""
    return hashlib.sha256(film.words().tobytes() + ledger.tobytes()).hexdigest()


@pytest.fixture(scope="module")
def expected() -> dict[str, str]:
    """By scene: the hash from the first device's fused scheduler with all defaults."""
    return {name: sha(*words(scene(), FAST[0])) for name, scene in SCENES.items()}


@pytest.mark.parametrize("scheduler", ["fused", "thrust"])
@pytest.mark.parametrize("name", SCENES)
def test_every_device_scheduler_thread_count_and_batch(
    device: str, scheduler: str, name: str, expected: dict[str, str]
) -> None:
    scene = SCENES[name]()
    for threads, batch in ((1, 0), (2, 1000), (2, 0), (1, 77)):
        settings = {"scheduler": scheduler, "threads": threads, "batch": batch}
        assert sha(*words(scene, device, **settings)) == expected[name], settings


@pytest.mark.parametrize("name", SCENES)
def test_features_forced_on(device: str, name: str, expected: dict[str, str]) -> None:
    """D9: code for what the scene does not have changes nothing."""
    assert sha(*words(SCENES[name](), device, all_features=True)) == expected[name]


@pytest.fixture(scope="module")
def check_hashes() -> dict[str, str]:
    """By check scene, 4 samples a pixel: the hash from the first device with all defaults."""
    return {name: sha(*words(check_scene(name), FAST[0], 0, 4)) for name in CHECKS}


@pytest.mark.parametrize("name", CHECKS)
def test_checks_in_every_way(device: str, name: str, check_hashes: dict[str, str]) -> None:
    """One hash over devices x schedulers x threads x batch sizes x code for absent features."""
    scene = check_scene(name)
    host = native_scene(scene, device)
    depths = {"max_depth": scene.max_depth, "rr_depth": scene.rr_depth}
    ways: list[dict[str, Any]] = [
        {"scheduler": scheduler, "threads": threads, "batch": batch}
        for scheduler in ("fused", "thrust")
        for threads, batch in ((1, 0), (2, 300), (2, 0), (1, 77))
    ]
    for way in (*ways, {"all_features": True}, {"scheduler": "thrust", "all_features": True}):
        film = native_film(16, 16, device)
        done = native(device).render(host, film, sample_begin=0, sample_end=4, **depths, **way)
        assert done["nonfinite_samples"] == 0
        assert sha(film, done["ledger"]) == check_hashes[name], way


@pytest.mark.parametrize("device", FAST)
@pytest.mark.parametrize("name", CHECKS)
def test_checks_scaled_by_powers_of_two(
    device: str, name: str, check_hashes: dict[str, str]
) -> None:
    """D10, N2: lengths or radiances times 2^k: the same integers. No clamp, no absolute epsilon."""
    scene = check_scene(name)
    for exponent in (10, -20):
        lengths = scene.scaled(2.0**exponent)
        assert sha(*words(lengths, device, 0, 4)) == check_hashes[name], f"lengths, {exponent}"
        light = scene.with_emission_scaled(2.0**exponent)
        assert sha(*words(light, device, 0, 4)) == check_hashes[name], f"light, {exponent}"


@pytest.mark.parametrize("name", ["cornell-box", "mesh"])
def test_repeats(name: str, expected: dict[str, str]) -> None:
    """D1."""
    for device in FAST:
        for _ in range(5):
            assert sha(*words(SCENES[name](), device)) == expected[name]


@pytest.mark.parametrize("device", FAST)
@pytest.mark.parametrize("name", SCENES)
def test_sample_ranges_merge_in_any_order(device: str, name: str, expected: dict[str, str]) -> None:
    """D2, D5, D11: any split, stop and resume, or merge gives the same film and ledger."""
    scene = SCENES[name]()
    ranges = [(11, 12), (0, 4), (12, SPP), (4, 11)]
    total = native_film(scene.film.width, scene.film.height, device)
    resumed = native_film(scene.film.width, scene.film.height, device)
    sums = np.zeros((0, 9), np.uint64)
    for begin, end in ranges:
        film, ledger = words(scene, device, begin, end, scheduler="thrust" if end < 12 else "fused")
        total.add(film)
        short, long = sorted((sums, ledger), key=len)
        sums = long + np.pad(short, ((0, len(long) - len(short)), (0, 0)))
        native(device).render(
            native_scene(scene, device),
            resumed,
            sample_begin=begin,
            sample_end=end,
            max_depth=scene.max_depth,
            rr_depth=scene.rr_depth,
        )
    assert total.samples == resumed.samples == SPP
    assert sha(total, sums) == expected[name]
    assert (resumed.words() == total.words()).all()


def test_films_add_across_devices() -> None:
    """Half of the samples on one device, half on another, through the files' exact sums."""
    scene = SCENES["cornell-box"]()
    whole = words(scene, FAST[0])[0].words()
    for device in {FAST[0], FAST[-1], "cpu:portable"}:
        a, b = words(scene, FAST[0], 0, 10)[0].words(), words(scene, device, 10, SPP)[0].words()
        low = a[..., 0::2] + b[..., 0::2]
        high = a[..., 1::2] + b[..., 1::2] + (low < a[..., 0::2])
        assert (low == whole[..., 0::2]).all() and (high == whole[..., 1::2]).all()


@pytest.mark.parametrize("device", FAST)
@pytest.mark.parametrize("name", SCENES)
@pytest.mark.parametrize("exponent", [20, -20])
def test_emission_times_a_power_of_two(device: str, name: str, exponent: int) -> None:
    """D10: the same integers, the image times 2^k: no clamp anywhere."""
    scene = SCENES[name]()
    scaled = scene.with_emission_scaled(2.0**exponent)
    film, ledger = words(scene, device)
    film_k, ledger_k = words(scaled, device)
    assert sha(film, ledger) == sha(film_k, ledger_k)
    for plain, times in zip(film.resolve(), film_k.resolve(), strict=True):
        assert (plain * np.float32(2.0**exponent) == times).all() and plain.any()


@pytest.mark.parametrize("device", FAST)
@pytest.mark.parametrize("name", SCENES)
def test_lengths_times_a_power_of_two(device: str, name: str, expected: dict[str, str]) -> None:
    """D10, N2: no absolute epsilon anywhere."""
    scene = SCENES[name]()
    for exponent in (7, -20, 20, 30):
        assert sha(*words(scene.scaled(2.0**exponent), device)) == expected[name], exponent


@pytest.mark.parametrize("device", FAST)
@pytest.mark.parametrize("factor", [1e-6, 1e-3, 1e3, 1e9])
def test_lengths_times_another_factor(device: str, factor: float) -> None:
    """N2: only rounding differs: 1 % of the pixels at most by more than 1e-4 of their value."""
    scene = SCENES["cornell-box"]()
    a = veriray.render(scene, spp=64, device=device).image
    b = veriray.render(scene.scaled(factor), spp=64, device=device).image
    assert (np.abs(b - a) > 1e-4 * a).mean() < 0.01
    assert abs(b.mean(dtype=np.float64) / a.mean(dtype=np.float64) - 1) < 1e-3


@pytest.mark.parametrize("device", FAST)
def test_moved_by_a_million(device: str) -> None:
    """N1: recentred in float64 before float32: the same picture but for rounding, as above."""
    scene = SCENES["cornell-box"]()
    to_world = np.array(scene.camera.to_world)
    to_world[:3, 3] += 1e6
    moved = dataclasses.replace(
        scene,
        vertices=scene.vertices + 1e6,
        camera=dataclasses.replace(scene.camera, to_world=to_world),
    )
    a, b = (veriray.render(s, spp=64, device=device).image for s in (scene, moved))
    assert (np.abs(b - a) > 1e-4 * a).mean() < 0.01
    assert abs(b.mean(dtype=np.float64) / a.mean(dtype=np.float64) - 1) < 1e-3


@pytest.mark.parametrize("device", FAST)
def test_an_object_that_no_ray_can_reach(device: str) -> None:
    """D12: a quad inside a closed block changes no bit, with a dark and with a bright surface."""
    room = [
        box([0, 0, 0], [1, 1, 1], True, 0.7, 0.4),
        box([0.6, 0.2, 0.6], [0.9, 0.5, 0.9], False, 0.5),
    ]
    hidden = quad([0.7, 0.3, 0.7], [0.1, 0, 0], [0, 0.1, 0], 0.9)
    view = camera([0.2, 0.4, 0.1], [0.6, 0.4, 0.8], 60)
    results = [sha(*words(make(p, view, width=16, height=16), device))
               for p in (room, [*room, hidden])]  # fmt: skip
    assert results[0] == results[1]


@pytest.mark.parametrize("device", FAST)
def test_replayed_paths_add_up_to_the_film(device: str) -> None:
    """The replay of single paths adds up to the film's sums."""
    if not device.startswith("cpu"):
        pytest.skip("paths are replayed on the CPU")
    for scene in (SCENES["open"](), *map(check_scene, ("touching_media", "mask", "thinlens"))):
        scene = scene.with_(width=4, height=3)
        r = veriray.render(scene, spp=8, device=device)
        for y in range(3):
            for x in range(4):
                paths = [veriray.trace_path(scene, x, y, k) for k in range(8)]
                total = np.sum([np.array(p[-1]["radiance"]) for p in paths], axis=0)
                assert np.allclose(total / 8, r.image[y, x], rtol=1e-6)


# ---- seeds ----


@pytest.mark.parametrize("device", FAST)
def test_seeds_are_independent(device: str) -> None:
    """D15, S5: noise of films of different seeds, and of neighbouring pixels, is uncorrelated.

    64 x 64 pixels: sees a correlation of 0.09 in any of 36 pairs or 3 neighbours of 9 films.
    """
    scene = furnace(0.5, 0.5, width=64, height=64)

    def p_value(effort: int, shift: int) -> float:
        seeds = [0, 1, 2, 3, 2**32, 2**32 + 1, 2**63, 2**64 - 2, 2**64 - 1]
        noise = []
        for seed in seeds:
            seed = (seed + 1000 * shift) % 2**64
            images = [veriray.render(scene, spp=2, seed=(seed + k * 2**20) % 2**64, device=device)
                      for k in range(effort)]  # fmt: skip
            noise.append(np.stack([r.image[:, :, 0] - 1.0 for r in images]))
        z = []
        for i, a in enumerate(noise):
            scale = a.std() ** 2 * np.sqrt(a.size)
            z += [(a * b).sum() / (a.std() * b.std() * np.sqrt(a.size)) for b in noise[:i]]
            z += [(a[:, 1:] * a[:, :-1]).sum() / scale, (a[:, :, 1:] * a[:, :, :-1]).sum() / scale]
            z += [(a[:, 1:, 1:] * a[:, :-1, :-1]).sum() / scale]
        return max_z(np.array(z))

    confirm(p_value)


@pytest.mark.parametrize("device", FAST)
def test_pixels_do_not_share_samples(device: str) -> None:
    """S5: variance of the image's mean against the mean of the pixels' variances; 48 seeds.

    The one killer of "the same seed in every pixel" (a ratio of 256). Sees a ratio of 2.2 or 0.4.
    """
    scene = furnace(0.5, 0.5, width=16, height=16)

    def p_value(effort: int, first: int) -> float:
        n = 48 * effort
        r = [veriray.render(scene, spp=4, seed=1000 * first + k, device=device) for k in range(n)]
        images = np.array([x.image[:, :, 0] for x in r], np.float64)
        ratio = images.mean((1, 2)).var(ddof=1) / (images.var(axis=0, ddof=1).mean() / 256)
        return 2 * float(min(stats.chi2.sf(ratio * (n - 1), n - 1),
                             stats.chi2.cdf(ratio * (n - 1), n - 1)))  # fmt: skip

    confirm(p_value)


# ---- recorded values ----


def record(device: str, name: str, width: int, spp: int, **settings: Any) -> dict[str, Any]:
    path = FOLDER / f"{name.removeprefix('checks/')}.xml" if name.startswith("checks/") else name
    scene = veriray.load_file(path).with_(width=width, height=width, max_depth=-1)
    r = veriray.render(scene, spp=spp, device=device, **settings)
    ledger = json.dumps(r.stats["ledger"], sort_keys=True).encode()
    return {
        "scene": name,
        "width": width,
        "spp": spp,
        "scene_sha256": r.stats["scene_sha256"],
        "film_sha256": r.film_sha256,
        "ledger_sha256": hashlib.sha256(ledger).hexdigest(),
        "live_rays": r.stats["live_rays"][:8],
    }


def check_recorded(device: str, entry: dict[str, Any], **settings: Any) -> None:
    size = entry["scene"], entry["width"], entry["spp"]
    assert record(device, *size, **settings) == entry, f"{device}, {settings}"


def test_every_check_is_recorded() -> None:
    """A new scene needs a line: python -m tests.equivalence.test_bits."""
    recorded = {entry["scene"] for entry in json.loads(RECORDED.read_text())}
    assert recorded >= {f"checks/{name}" for name in CHECKS}


def test_recorded_films(device: str) -> None:
    """The films of recorded.json, from every device; the large one not from slow CPU code."""
    for entry in json.loads(RECORDED.read_text()):
        small = entry["width"] ** 2 * entry["spp"] < 100_000
        if small or device != "cpu:portable":
            check_recorded(device, entry)
        if small or device.startswith("cuda"):
            check_recorded(device, entry, scheduler="thrust")
            check_recorded(device, entry, scheduler="thrust", batch_size=5000)
            check_recorded(device, entry, scheduler="fused", batch_size=1000)


def test_recorded_films_in_every_way(device: str) -> None:
    """The same, schedulers x threads x batch sizes; the checks have a test of their own."""
    for entry in json.loads(RECORDED.read_text()):
        if entry["scene"].startswith("checks/"):
            continue
        if device == "cpu:portable" and entry["width"] > 32:
            continue  # 40 s; the small films say the same of that code
        for scheduler in ("fused", "thrust"):
            for threads in (1, 2):
                for batch in (0, 3000):
                    check_recorded(
                        device, entry, scheduler=scheduler, threads=threads, batch_size=batch
                    )


if __name__ == "__main__":
    cases = [("cornell-box", 32, 16), ("open", 32, 16), ("cornell-box", 128, 64)]
    cases += [(f"checks/{name}", 24, 4) for name in CHECKS]
    rows = ",\n".join(json.dumps(record(FAST[0], *case)) for case in cases)
    RECORDED.write_text(f"[\n{rows}\n]\n")
