"""Adaptive sampling: `target_error`. That it is unbiased is a case of `veriray validate`."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest

import veriray
from veriray import image
from veriray.rendering import METHODS
from veriray.sampling import PILOTS, TILE, tile_errors

SIZE: dict[str, Any] = {"width": 40, "height": 36}


def picture(device: str = "cpu", **settings: Any) -> veriray.Render:
    settings = {"spp": 1024, "target_error": 0.2, **SIZE, **settings}
    return veriray.render(veriray.cornell_box(), device=device, **settings)


@pytest.mark.parametrize(("sampler", "target"), [("independent", 0.2), ("sobol", 0.06)])
def test_every_tile_gets_what_it_needs(sampler: str, target: float) -> None:
    r = picture(sampler=sampler, target_error=target)
    assert r.samples is not None and r.samples.dtype == np.uint32
    tiles = r.samples[::TILE, ::TILE]
    assert (r.samples == tiles.repeat(TILE, 0).repeat(TILE, 1)[:36, :40]).all()
    assert set(np.unique(tiles)) <= {2**k for k in range(4, 11)} | {3 * 2**k for k in range(3, 10)}
    assert len(np.unique(tiles)) > 1 and tiles.min() >= PILOTS[sampler]
    errors = np.sqrt(tile_errors(r.image, r.stderr))
    assert (errors < 1.3 * target).all() and r.stats["tile_error"][2] == errors.max()
    assert r.stats["tiles_above_target"] == (errors > target).sum() <= tiles.size // 3
    assert r.stats["mean_spp"] == pytest.approx(r.samples.mean())
    paths = PILOTS[sampler] * 40 * 36 + int(r.samples.sum())
    assert r.stats["paths"] == r.stats["live_rays"][0] == paths


def test_same_bits_whatever_the_way(device: str) -> None:
    wanted = picture().film_sha256
    ways = [{"scheduler": name} for name in METHODS]
    for way in (*ways, {"batch_size": 777}, {"all_features": True}):
        assert picture(device, **way).film_sha256 == wanted, way
    assert picture(device, threads=1).film_sha256 == wanted


def test_samples_do_not_depend_on_the_unit_of_light() -> None:
    scene = veriray.cornell_box()
    a, b = (
        veriray.render(s, spp=256, target_error=0.2, device="cpu", **SIZE)
        for s in (scene, scene.with_emission_scaled(2.0**40))
    )
    assert (a.samples == b.samples).all() and (a.image * 2.0**40 == b.image).all()


def test_the_limit_holds_and_is_reported() -> None:
    r = picture(spp=100, target_error=0.01)
    assert (r.samples == 100).all() and r.stats["tiles_at_limit"] == r.stats["tiles"] == 9


def test_black_pictures_stop_at_once() -> None:
    scene = veriray.cornell_box().with_(max_depth=1)  # emission alone; no noise but at the edges
    r = veriray.render(scene, spp=64, target_error=0.5, width=16, height=16, device="cpu")
    assert (r.samples == PILOTS["sobol"]).all()


def test_files_keep_the_samples(tmp_path: Path) -> None:
    r = picture()
    r.save(tmp_path / "a.exr")
    loaded = image.load(tmp_path / "a.exr")
    assert loaded.samples is not None and (loaded.samples == r.samples).all()
    assert veriray.film_hash(loaded.image, loaded.stderr, loaded.spp, loaded.samples) == (
        r.film_sha256
    )
    assert loaded.stats["target_error"] == 0.2


def test_compared_with_uniform_samples() -> None:
    size = {"width": 64, "height": 64}
    uniform = picture(seed=2, spp=256, target_error=None, **size)
    report = veriray.compare(picture(seed=1, target_error=0.06, **size), uniform)
    assert report.passed, report
    assert any("different numbers of samples" in why for _, why in report.not_run)


@pytest.mark.parametrize(
    ("settings", "words"),
    [
        ({"target_error": 0.0}, "target_error = 0 is outside (0, 1)"),
        ({"target_error": 1}, "target_error = 1 is outside (0, 1)"),
        ({"target_error": float("nan")}, "target_error = nan"),
        ({"target_error": "small"}, "target_error = 'small' is not a number"),
        ({"spp": 15}, "spp = 15; expected 64 to 2147483648 beside target_error = "),
        ({"batches": 4}, "batches = 4; expected 0 beside target_error = "),
    ],
)
def test_errors(settings: dict[str, Any], words: str) -> None:
    with pytest.raises(ValueError) as error:
        picture(**settings)
    assert words in str(error.value)


@pytest.mark.parametrize("pixels", [[1, 1], [2, 1], [40 * 36], []])
def test_lists_of_pixels_are_checked(pixels: list[int]) -> None:
    from veriray_validate.trial import Trial

    trial = Trial("cpu", 1, 1, 1)
    held = trial.native_scene(veriray.cornell_box().with_(**SIZE))
    with pytest.raises(ValueError, match="pixels"):
        trial.native.render(
            held, trial.native_film(40, 36), pixels=np.array(pixels, np.uint32), max_depth=3
        )
