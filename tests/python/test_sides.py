"""`compare` with pictures of other programs: their layouts, and N files as batches."""

from __future__ import annotations

import json
import warnings
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import OpenEXR
import pytest

import veriray as vr
from veriray.cli import main
from veriray.comparison import CompareError, sides
from veriray.errors import ImageError

Array = np.ndarray[Any, Any]
LAYOUTS: dict[str, tuple[dict[str, Any], str, str]] = {
    "plain": ({}, "", ""),
    "cycles": ({"cycles.ViewLayer.samples": "16"}, "ViewLayer.Combined.", "Cycles"),
    "blender": ({}, "Scene.Combined.", "Blender"),
    "mitsuba": ({"generatedBy": "Mitsuba version 3.9.1"}, "", "Mitsuba 3.9.1"),
    "pbrt": ({"samplesPerPixel": 16}, "", "pbrt"),
    "luxcore": ({"Software": "LuxCoreRender 2.10"}, "", "LuxCore"),
    "a layer": ({}, "beauty.", ""),
}


def write(
    path: Path, channels: dict[str, Array], header: dict[str, Any] | None = None, **parts: Any
) -> Path:
    """An EXR file; parts: channels of further ones."""
    plain = {"compression": OpenEXR.ZIP_COMPRESSION, "type": OpenEXR.scanlineimage}
    every = {"": channels, **parts}
    made = []
    for name, values in every.items():
        one = {n: np.ascontiguousarray(v) for n, v in values.items()}
        own = {**plain, **(header or {})} if not name else dict(plain)
        made.append(OpenEXR.Part(own, one, name or "first"))
    OpenEXR.File(made).write(str(path))
    return path


def rgb(image: Array, prefix: str = "", dtype: Any = np.float32) -> dict[str, Array]:
    return {prefix + c: image[..., k].astype(dtype) for k, c in enumerate("RGB")}


def pictures(count: int, seed: int = 0, bias: float = 0.0, shape: Any = (40, 48)) -> list[Array]:
    """Pictures of a known mean with gamma noise, as of `count` seeds."""
    rng = np.random.default_rng(seed)
    level = np.random.default_rng(99).uniform(0.2, 2.0, (*shape, 3)) * (1 + bias)
    return [level * rng.gamma(16.0, 1 / 16, (*shape, 3)) for _ in range(count)]


def files(
    folder: Path,
    images: list[Array],
    name: str = "a",
    layout: str = "plain",
    dtype: Any = np.float32,
) -> list[Path]:
    header, prefix, _ = LAYOUTS[layout]
    return [write(folder / f"{name}{k}.exr", rgb(x, prefix, dtype), header)
            for k, x in enumerate(images)]  # fmt: skip


def test_values_below_0_of_other_programs_are_no_faults(tmp_path: Path) -> None:
    """Their filters may have negative lobes; what is not finite is found, with its pixel."""
    sides = []
    for side in range(2):
        images = pictures(64, side)
        for image in images:
            image[3, 4] -= 2.5
        sides.append([write(tmp_path / f"{side}{k}.exr", rgb(v)) for k, v in enumerate(images)])
    report = vr.compare(*sides)
    assert report.passed, report.verdict
    assert any("values below 0, as filters with such weights give" in n for n in report.notes)
    worse = images[0]
    worse[7, 9, 1] = np.inf
    write(sides[1][0], rgb(worse))
    said = vr.compare(*sides).verdict
    assert "1 pixels hold values that are NaN or infinite" in said and "at (9, 7)" in said


@pytest.mark.parametrize("layout", LAYOUTS)
def test_layouts(tmp_path: Path, layout: str) -> None:
    header, prefix, renderer = LAYOUTS[layout]
    image = pictures(1)[0].astype(np.float32)
    more = {"Depth.Z": image[..., 0], f"{prefix}A": image[..., 1]}
    found = sides.read(write(tmp_path / "x.exr", {**rgb(image, prefix), **more}, header))
    assert np.array_equal(found.image, image) and found.renderer == renderer
    assert found.spp == (16 if layout in ("cycles", "pbrt") else None)
    assert not found.half and not found.luminance


def test_files_of_mitsuba(tmp_path: Path) -> None:
    mi = pytest.importorskip("mitsuba", reason="the peer renderer: pip install mitsuba")
    mi.set_variant("scalar_rgb")
    film = {"type": "hdrfilm", "width": 8, "height": 6, "rfilter": {"type": "box"}}
    sensor = {"type": "perspective", "film": film}
    scene = {"type": "scene", "sensor": sensor, "sky": {"type": "constant", "radiance": 0.25}}
    nested = {"type": "moment", "nested": {"type": "path"}}
    for integrator in ({"type": "path"}, nested):
        made = mi.load_dict({**scene, "integrator": integrator})
        mi.render(made, spp=2)
        made.sensors()[0].film().write(str(tmp_path / "m.exr"))
        found = sides.read(tmp_path / "m.exr")
        assert found.renderer == "Mitsuba 3.9.1" and found.half
        assert found.image.shape == (6, 8, 3) and np.allclose(found.image, 0.25, rtol=1e-3)


def test_choice_of_channels(tmp_path: Path) -> None:
    one, two = (x.astype(np.float32) for x in pictures(2))
    path = write(tmp_path / "x.exr", {**rgb(one, "left."), **rgb(two, "right.")})
    with pytest.raises(ImageError, match="several layers, left, right: choose one by channels"):
        sides.read(path)
    assert np.array_equal(sides.read(path, "right").image, two)
    assert np.array_equal(sides.read(path, "left.R,left.G,right.B").image[..., 2], two[..., 2])
    assert sides.read(path, "left.G").luminance
    with pytest.raises(ImageError, match="no layer or channels 'middle'; found left.B"):
        sides.read(path, "middle")
    chroma = {"Y": one[..., 0], "RY": one[..., 1], "BY": one[..., 2]}
    with pytest.raises(ImageError, match="luminance and chroma"):
        sides.read(write(tmp_path / "y.exr", chroma))
    with pytest.raises(ImageError, match="no channels R, G, B; found Z"):
        sides.read(write(tmp_path / "z.exr", {"Z": one[..., 0]}))


def test_parts(tmp_path: Path) -> None:
    one, two = (x.astype(np.float32) for x in pictures(2))
    path = write(tmp_path / "x.exr", {"Z": one[..., 0]}, None, beauty=rgb(one), other=rgb(two))
    with pytest.raises(ImageError, match="several layers, beauty, other"):
        sides.read(path)
    assert np.array_equal(sides.read(path, "beauty").image, one)


def test_the_first_part_by_name(tmp_path: Path) -> None:
    one, two = (x.astype(np.float32) for x in pictures(2))
    path = write(tmp_path / "x.exr", rgb(one), None, right=rgb(two))
    assert np.array_equal(sides.read(path, "first").image, one)
    assert np.array_equal(sides.read(path, "right").image, two)
    layers = rgb(one, "A.Combined.") | rgb(two, "B.Combined.")
    with pytest.raises(ImageError, match=r"\(several: A.Combined, B.Combined\)"):
        sides.read(write(tmp_path / "y.exr", layers), "Combined")


def test_variance_channels_need_samples(tmp_path: Path) -> None:
    image = pictures(1)[0]
    variance = rgb(np.full_like(image, 0.09), "Variance.") | rgb(image, "RelativeVariance.")
    path = write(tmp_path / "x.exr", {**rgb(image), **variance})
    assert sides.read(path).stderr is None
    found = sides.read(path, spp=36)
    assert found.renderer == "pbrt" and np.allclose(found.stderr, 0.3 / 6)


def test_parts_of_a_picture_that_lie_apart(tmp_path: Path) -> None:
    def cut(name: str, k: int, x: int, y: int, side: int = 99) -> Path:
        corners = [(x, y), (x + 47, y + 39)], [(0, 0), (side, side)]
        windows = [tuple(np.array(c, np.int32) for c in two) for two in corners]
        header = dict(zip(("dataWindow", "displayWindow"), windows, strict=True))
        return write(tmp_path / name, rgb(images[k]), header)

    images = pictures(4)
    here, too = cut("here.exr", 0, 10, 5), cut("too.exr", 1, 10, 5)
    there, own = cut("there.exr", 2, 20, 5), cut("own.exr", 3, 0, 0, 47)
    apart = r"of 100 x 100: .*here.exr begins at pixel \(10, 5\), .*there.exr at \(20, 5\)"
    for a, b in ((here, there), ([here, there], own)):
        with pytest.raises(CompareError, match=apart):
            vr.compare(a, b)
    assert vr.compare(here, too).result and vr.compare(here, own).result


# ---- verdicts ----


def test_files_agree_as_often_as_they_should(tmp_path: Path) -> None:
    """24 pairs, 16 files a side, at alpha 0.01: 4 or more fail with a chance of 1 in 11,000."""
    failed = 0
    for k in range(24):
        a, b = (files(tmp_path, pictures(16, 2 * k + s), f"{'ab'[s]}{k}-") for s in (0, 1))
        failed += vr.compare(a, b, alpha=0.01).result == "fail"
    assert failed < 4


@pytest.mark.parametrize("dtype", [np.float32, np.float16])
def test_a_bias_is_found(tmp_path: Path, dtype: Any) -> None:
    """2 % all over 40 x 48 x 16 values with noise of 25 %: 0.2 % of noise in the mean."""
    a = files(tmp_path, pictures(16, 1), "a", dtype=dtype)
    b = files(tmp_path, pictures(16, 2, 0.02), "b", dtype=dtype)
    report = vr.compare(a, b)
    assert report.result == "fail"
    assert ("half floats" in " ".join(report.notes)) == (dtype is np.float16)
    good = vr.compare(a, files(tmp_path, pictures(16, 3), "c", dtype=dtype))
    assert good.result == "pass" and "samples per pixel unknown" in good.reason


def test_rounding_of_half_floats_is_no_difference(tmp_path: Path) -> None:
    """1 + 3 2^-13 rounds to 1 as a half float: 3.7e-4 less, with noise of 10^-5 in the mean."""
    rng = np.random.default_rng(5)
    noise = np.full((40, 48, 1), 1e-6)
    noise[0] = 0.005  # so that no two files are the same

    def made() -> list[Array]:
        level = 1 + 3 * 2.0**-13
        return [level * (1 + noise * rng.standard_normal((40, 48, 3))) for _ in range(16)]

    exact, other = made(), made()
    half = files(tmp_path, exact, "h", dtype=np.float16)
    full = files(tmp_path, other, "f")
    assert vr.compare(half, full).result == "pass"
    moved = files(tmp_path, [x * (1 + 2.0**-9) for x in other], "m")
    assert vr.compare(half, moved).result == "fail"
    rounded = [x.astype(np.float16).astype(np.float64) for x in exact]
    assert vr.compare(files(tmp_path, rounded, "r"), full).result == "fail"


def test_our_render_against_files(tmp_path: Path, cornell: vr.Scene) -> None:
    ours = vr.render(cornell, 64, seed=9, batches=16, sampler="independent", device="cpu")
    theirs = []
    for k in range(16):
        picture = vr.render(cornell, 4, seed=k, sampler="independent", device="cpu").image
        theirs += files(tmp_path, [picture], f"m{k}-", "mitsuba")
    assert vr.compare(ours, theirs, spp=(None, 4)).effort == "equal"
    assert vr.compare(ours, theirs, spp=(None, 4)).passed
    assert vr.compare(theirs, ours, spp=(4, None)).passed
    dim = vr.render(
        cornell, 64, seed=9, batches=16, sampler="independent", device="cpu", max_depth=3
    )
    assert vr.compare(dim, theirs, spp=4).result == "fail"


def test_batches_that_cut_groups_are_joined(cornell: vr.Scene) -> None:
    """Sobol's groups of 16: batches of 4 are tested by fours, and as far apart as errors say.

    The ratio of the variances, of 64 batches in 2 million samples, is right to 2 %; that of
    batches as they come is at least 1.2.
    """
    scene = cornell.with_(width=48, height=48, filter="box")
    made = vr.render(scene, 1024, seed=5, batches=256, device="cpu")
    joined, _, _ = sides.opened(made, "A")
    assert made.batch_means is not None and joined.batch_means is not None
    assert joined.batch_means.shape == (64, 48, 48, 3)
    assert np.allclose(joined.batch_means.mean(axis=0), made.image, rtol=1e-5, atol=1e-7)
    ratio = []
    for means in (made.batch_means, joined.batch_means):
        spread = means.var(axis=0, ddof=1) / len(means)
        ratio.append(float(spread.sum() / (made.stderr.astype(np.float64) ** 2).sum()))
    assert ratio[0] > 1.2 and abs(ratio[1] - 1) < 0.1, ratio
    other = vr.render(scene, 1024, seed=6, batches=256, device="cpu")
    report = vr.compare(made, other)
    assert report.passed and report.a["batches"] == report.b["batches"] == 64
    assert "A: batches of 4 samples cut the groups of 16" in " ".join(report.notes)


@pytest.mark.parametrize(
    ("spp", "batches", "sampler", "left"),
    [(96, 12, "sobol", 6), (96, 12, "independent", 12), (96, 6, "sobol", 6), (34, 2, "sobol", 0)],
)
def test_batches_that_are_left(
    cornell: vr.Scene, spp: int, batches: int, sampler: str, left: int
) -> None:
    """Of batches that fill no groups together none is tested."""
    made = vr.render(cornell, spp, batches=batches, sampler=sampler, device="cpu")
    joined, _, _ = sides.opened(made, "A")
    assert left == (0 if joined.batch_means is None else len(joined.batch_means))
    assert ("batches_cut" in joined.stats) == (left != batches)


def test_luminance(tmp_path: Path, cornell: vr.Scene) -> None:
    ours = vr.render(cornell, 64, seed=9, batches=16, sampler="independent", device="cpu")
    grey = []
    for k in range(16):
        picture = vr.render(cornell, 4, seed=k, device="cpu").image.astype(np.float64)
        y = (picture @ np.array(sides.LUMINANCE)).astype(np.float32)
        grey.append(write(tmp_path / f"{k}.exr", {"Y": y}))
    report = vr.compare(ours, grey, spp=(None, 4))
    assert report.passed and "B holds luminance alone" in " ".join(report.notes)
    for path in grey:
        brighter = 1.1 * sides.read(path).image[..., 0]
        write(path, {"Y": brighter.astype(np.float32)})
    assert vr.compare(ours, grey, spp=(None, 4)).result == "fail"


def test_luminance_without_batches_has_an_upper_error() -> None:
    image = np.ones((2, 2, 3), np.float32)
    render = vr.Render(image, image * 0.1, None, "", {}, 2, 2, 4, 0)
    grey = vr.Render(image, image, None, "", {"luminance": True}, 2, 2, 4, 0)
    made, _ = sides.alike(render, grey)
    assert np.allclose(made.stderr, 0.1)


@pytest.mark.parametrize(
    ("layout", "text"),
    [("mitsuba", "mi.render(scene, seed=k)"), ("cycles", "scene.cycles.seed = k"),
     ("pbrt", "--seed k"), ("luxcore", "renderengine.seed = k"), ("plain", "another seed, and")],
)  # fmt: skip
def test_what_to_render_for_a_verdict(
    tmp_path: Path, cornell: vr.Scene, layout: str, text: str
) -> None:
    ours = vr.render(cornell, 32, batches=16, device="cpu")
    (path,) = files(tmp_path, [ours.image * 1.001], layout=layout)
    report = vr.compare(ours, path)
    assert report.result == "inconclusive"
    (note,) = [n for n in report.notes if n.startswith("B carries no error")]
    assert text in note and "--b FILE" in note


def test_refused_sides(tmp_path: Path, cornell: vr.Scene) -> None:
    images = pictures(4)
    good = files(tmp_path, images)
    with pytest.raises(CompareError, match="hold the same picture: each needs its own seed"):
        vr.compare([good[0], good[1], good[0]], good)
    (small,) = files(tmp_path, pictures(1, shape=(4, 4)), "s")
    with pytest.raises(CompareError, match="different sizes in B"):
        vr.compare(good, [good[0], small])
    ours = [vr.render(cornell, spp, device="cpu") for spp in (2, 4)]
    with pytest.raises(CompareError, match="different samples per pixel: 2, 4"):
        vr.compare(ours, good)
    with pytest.raises(CompareError, match="different scenes"):
        vr.compare([ours[0], vr.render(cornell.with_(max_depth=2), 2, device="cpu")], good)
    for wrong in ({"channels": 3}, {"spp": 0}, {"spp": (1, 2, 3)}, {"spp": "x"}):
        with pytest.raises(CompareError):
            vr.compare(good, good, **wrong)  # type: ignore[arg-type]
    for side in ([], [3]):
        with pytest.raises(TypeError, match="expected a Render"):
            vr.compare(side, good)  # type: ignore[arg-type]


def test_a_list_keeps_the_filter(cornell: vr.Scene) -> None:
    one = vr.render(cornell, 2, width=8, height=6, device="cpu")
    made = []
    for k in range(4):
        image = one.image + np.float32(k)
        image[0, 0] = -1 - k  # a weight of the filter below 0 beside a bright pixel
        stats = {**one.stats, "filter": "gaussian", "filter_parameter": 0.5}
        made.append(replace(one, image=image, stats=stats))
    side, _, _ = sides.opened(made, "A")
    assert (side.stats["filter"], side.stats["filter_parameter"]) == ("gaussian", 0.5)
    report = vr.compare(made[:2], made[2:])
    assert all(test.result == "pass" for test in report.tests if test.name.startswith("S0"))


def test_infinite_values_in_a_list_are_found(cornell: vr.Scene) -> None:
    made = [vr.render(cornell, 2, seed=k, width=8, height=6, device="cpu") for k in range(4)]
    bad = [replace(one, image=np.full_like(one.image, np.inf)) for one in made[:1]]
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        report = vr.compare([*bad, made[1]], made[2:])
    assert report.result == "fail" and "S0" in report.verdict


def test_an_empty_list(cornell: vr.Scene) -> None:
    one = vr.render(cornell, 2, width=8, height=6, device="cpu")
    with pytest.raises(TypeError, match="A is an empty list; expected a Render or a path"):
        vr.compare([], one)


def test_a_list_of_one_is_that_one(cornell: vr.Scene) -> None:
    one = vr.render(cornell, 32, batches=16, device="cpu")
    assert vr.compare([one], one).effort == "identical"


def test_the_command(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    a, b = (list(map(str, files(tmp_path, pictures(16, k), "ab"[k], "cycles"))) for k in (0, 1))
    assert main(["compare", "--a", *a, "--b", *b]) == 0
    assert main(["compare", a[0], "--b", *b, "--json"]) == 3
    report = json.loads(capsys.readouterr().out.partition("{")[2].join(["{", ""]))
    assert any("A carries no error" in note for note in report["notes"])
    assert main(["compare", "--channels-a", "Nothing", a[0], b[0]]) == 2
    assert "no layer or channels 'Nothing'" in capsys.readouterr().err
    for words in ([a[0]], [], [a[0], b[0], b[1]], [a[0], b[0], "--b", b[1]]):
        assert main(["compare", *words]) == 2
        assert "expected two pictures" in capsys.readouterr().err


# ---- Render.load ----


@pytest.mark.parametrize(
    "settings",
    [{"batches": 4}, {"sampler": "sobol", "max_depth": 3}, {"spp": 64, "target_error": 0.1}],
)
def test_a_render_comes_back_whole(
    tmp_path: Path, cornell: vr.Scene, settings: dict[str, Any]
) -> None:
    made = vr.render(cornell, **{"spp": 8, "seed": 5, "device": "cpu", **settings})
    made.save(tmp_path / "x.exr")
    back = vr.Render.load(tmp_path / "x.exr")
    assert back.image.tobytes() == made.image.tobytes()
    assert back.stderr.tobytes() == made.stderr.tobytes()
    assert back.film_sha256 == made.film_sha256
    assert vr.film_hash(back.image, back.stderr, back.spp, back.samples) == made.film_sha256
    assert (back.spp, back.seed, back.width, back.height) == (made.spp, 5, 32, 32)
    for name, value in made.stats.items():
        assert back.stats[name] == json.loads(json.dumps(value)), name
    if made.batch_means is not None:
        assert np.array_equal(back.batch_means, made.batch_means.astype(np.float32))
    if made.samples is not None:
        assert np.array_equal(back.samples, made.samples)


def test_a_changed_file_is_noticed(tmp_path: Path, cornell: vr.Scene) -> None:
    path = tmp_path / "x.exr"
    vr.render(cornell, 2, device="cpu").save(path)
    with OpenEXR.File(str(path), separate_channels=True) as file:
        file.channels()["R"].pixels[3, 4] *= 1.01
        file.write(str(tmp_path / "y.exr"))
    with pytest.raises(ImageError, match="changed since"):
        vr.Render.load(tmp_path / "y.exr")
    assert vr.Render.load(tmp_path / "y.exr", check=False).width == 32
