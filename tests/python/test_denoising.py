"""Denoised pictures: marked, without error bars, refused by `compare`."""

from __future__ import annotations

import sys
import types
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import OpenEXR
import pytest

import veriray as vr
from veriray.cli import main
from veriray.comparison import CompareError
from veriray.denoising import DenoiserError


@pytest.fixture
def calls(monkeypatch: pytest.MonkeyPatch) -> list[dict[str, Any]]:
    """In place of pyoidn: what it was called with; it gives the mean of the picture."""
    seen: list[dict[str, Any]] = []
    library = types.ModuleType("pyoidn")

    def denoise(color: Any, **given: Any) -> Any:
        seen.append({"color": color, **given})
        if color.max() > 1e6:
            raise RuntimeError("out of memory")
        return np.broadcast_to(color.mean(axis=(0, 1)), color.shape)

    library.denoise = denoise  # type: ignore[attr-defined]
    library.version = types.SimpleNamespace(oidn_version="2.5.1")  # type: ignore[attr-defined]
    monkeypatch.setitem(sys.modules, "pyoidn", library)
    return seen


def test_it_is_marked_and_refused(
    cornell: vr.Scene, calls: list[dict[str, Any]], tmp_path: Path
) -> None:
    noisy = vr.render(cornell, 4, batches=2, device="cpu")
    made = noisy.denoised()
    assert calls[0]["hdr"] is True and np.array_equal(calls[0]["color"], noisy.image)
    assert made.stats["denoiser"] == "Open Image Denoise 2.5.1"
    assert made.stats["denoised_from"] == noisy.film_sha256
    assert made.film_sha256 == "" and made.batch_means is None and np.isnan(made.stderr).all()
    assert made.stats["scene_sha256"] == noisy.stats["scene_sha256"]
    made.save(tmp_path / "d.exr")
    with OpenEXR.File(str(tmp_path / "d.exr"), header_only=True) as file:
        assert file.header()["veriray.denoiser"] == "Open Image Denoise 2.5.1"
    for source in (made, tmp_path / "d.exr", [made, noisy]):
        with pytest.raises(CompareError, match="is denoised by Open Image Denoise 2.5.1"):
            vr.compare(source, noisy)
    with pytest.raises(ValueError, match="denoised already"):
        vr.Render.load(tmp_path / "d.exr").denoised()


def test_arrays_beside_the_picture(cornell: vr.Scene, calls: list[dict[str, Any]]) -> None:
    noisy = vr.render(cornell, 2, device="cpu")
    albedo = np.full((32, 32, 3), 0.5)
    noisy.denoised(albedo, -albedo)
    assert calls[0]["albedo"].dtype == np.float32 and (calls[0]["normal"] == -0.5).all()
    for arguments, text in (
        ((None, albedo), "normal without albedo"),
        ((albedo[:3],), "albedo is"),
        (("red",), "albedo is 'red'"),
        ((albedo * np.nan,), r"albedo\[0, 0, 0\] = nan; expected finite numbers"),
    ):
        with pytest.raises(ValueError, match=text):
            noisy.denoised(*arguments)  # type: ignore[arg-type]
    bright = vr.Render(noisy.image * 1e9, noisy.stderr, None, "", {}, 32, 32, 2, 0)
    with pytest.raises(DenoiserError, match="failed: out of memory"):
        bright.denoised()


def test_without_the_package(
    cornell: vr.Scene, monkeypatch: pytest.MonkeyPatch, tmp_path: Path,
    capsys: pytest.CaptureFixture[str],
) -> None:  # fmt: skip
    monkeypatch.setitem(sys.modules, "pyoidn", None)
    noisy = vr.render(cornell, 2, device="cpu")
    with pytest.raises(vr.MissingPackageError, match=r"pip install 'veriray\[denoise\]'"):
        noisy.denoised()
    noisy.save(tmp_path / "a.exr")
    assert main(["denoise", str(tmp_path / "a.exr"), str(tmp_path / "b.png")]) == 2
    assert "pip install" in capsys.readouterr().err and not (tmp_path / "b.png").exists()


def test_the_command(
    cornell: vr.Scene, calls: list[dict[str, Any]], tmp_path: Path,
    capsys: pytest.CaptureFixture[str],
) -> None:  # fmt: skip
    vr.render(cornell, 2, device="cpu").save(tmp_path / "a.exr")
    assert main(["denoise", str(tmp_path / "a.exr"), str(tmp_path / "b.exr")]) == 0
    assert "denoised by Open Image Denoise 2.5.1" in capsys.readouterr().out
    assert vr.Render.load(tmp_path / "b.exr").stats["denoiser"]


def test_the_command_names_the_file_and_the_pixel(
    tmp_path: Path, cornell: vr.Scene, calls: list[Any], capsys: pytest.CaptureFixture[str]
) -> None:
    path = tmp_path / "a.exr"
    made = vr.render(cornell, 2, device="cpu")
    image = made.image.copy()
    image[3, 4, 1] = np.inf
    replace(made, image=image, film_sha256="").save(path)
    assert main(["denoise", str(path), str(tmp_path / "b.exr")]) == 2
    wanted = f"{path}: image[3, 4, 1] = inf; expected finite numbers"
    assert capsys.readouterr().err == f"veriray: error: {wanted}\n"
    made.denoised().save(path)
    assert main(["denoise", str(path), str(tmp_path / "b.exr")]) == 2
    assert f"{path}: the picture is denoised already" in capsys.readouterr().err
    assert not (tmp_path / "b.exr").exists()


def test_the_package_itself(cornell: vr.Scene) -> None:
    """A quarter of the relative error at most, where 16 samples have 1.4 %; measured: a ninth."""
    pytest.importorskip("pyoidn", reason="pyoidn, an optional package, is not installed")
    scene = cornell.with_(width=128, height=128)
    noisy, truth = (vr.render(scene, spp, seed=spp, device="cpu") for spp in (16, 512))

    def error(x: vr.Render) -> float:
        square = (x.image.astype(np.float64) - truth.image) ** 2
        return float((square / (truth.image**2 + 1e-2)).mean())

    made = noisy.denoised()
    assert error(made) < error(noisy) / 4
    assert made.stats["denoiser"].startswith("Open Image Denoise 2.")
