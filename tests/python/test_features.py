"""Feature images: closed forms, exact numbers, the same bits everywhere, files, what is refused."""

from __future__ import annotations

import json
import math
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt
import OpenEXR
import pytest

import veriray as vr
from veriray import cli, first_surface, image
from veriray.device import survey
from veriray.features import LAYERS, NUMBERS, OF_SURFACES
from veriray.settings import FEATURES

Array = npt.NDArray[Any]
DEVICES = {device.name: device for device in survey()[0]}
SINGLE = tuple(name for name in OF_SURFACES if name != "motion")
PLAIN = tuple(name for name in SINGLE if name != "uv")  # of meshes without texture coordinates
GREY = {"type": "diffuse", "reflectance": {"type": "rgb", "value": [0.25, 0.5, 0.75]}}


def look_at(origin: Any, target: Any, up: Any = (0, 1, 0)) -> dict[str, Any]:
    return {"type": "look_at", "origin": list(origin), "target": list(target), "up": list(up)}


def sensor(width: int, height: int, **more: Any) -> dict[str, Any]:
    return {
        "type": "perspective", "fov": 60.0, "fov_axis": "x",
        "film": {"type": "hdrfilm", "width": width, "height": height, "rfilter": {"type": "box"}},
        "sampler": {"type": "independent", "sample_count": 16}, **more,
    }  # fmt: skip


def matrix(columns: Any) -> Array:
    return np.array(columns, float)


def scene_of(shapes: dict[str, Any], to_world: Array | None = None, width: int = 24,
             height: int = 16, **more: Any) -> vr.Scene:  # fmt: skip
    view = sensor(width, height, **more)
    view["to_world"] = np.eye(4) if to_world is None else to_world
    return vr.load_dict({"type": "scene", "integrator": {"type": "path", "max_depth": 3},
                         "sensor": view, "sky": {"type": "constant"}, **shapes})  # fmt: skip


def plane(z: float, bsdf: dict[str, Any] = GREY, size: float = 50.0) -> dict[str, Any]:
    """A square across the axis of a camera at the origin that looks along z; its front towards it.

    Its u grows to the left of the picture."""
    to_world = np.diag([-size, size, -1.0, 1.0])
    to_world[2, 3] = z
    return {"type": "rectangle", "to_world": to_world, "bsdf": bsdf}


# ---- closed forms ----


@pytest.mark.parametrize("unit", [1.0, 2.0**-9, 1000.0])
def test_a_plane_across_the_axis(unit: float, device: str) -> None:
    """Depth along the axis, normals, albedo: the same number in every sample. The others are of
    points that are spread evenly over the pixel: their means are those of its centre, but for the
    depth along the ray, whose mean lies within a pixel's range."""
    z = 4 * unit
    even = {"type": "checkerboard", "color0": GREY["reflectance"], "color1": GREY["reflectance"]}
    wall = plane(z, {"type": "diffuse", "reflectance": even}, size=50 * unit)
    scene = scene_of({"wall": wall})
    got = vr.feature_images(scene, SINGLE, spp=64, seed=3, device=device)
    width, height = 24, 16
    half = math.tan(math.radians(30))
    x = half * (1 - 2 * (np.arange(width) + 0.5) / width)
    y = half * height / width * (1 - 2 * (np.arange(height) + 0.5) / height)
    x, y = np.meshgrid(x, y)
    ones = np.ones((height, width))
    assert np.abs(got["depth_axis"] / z - 1).max() < 4e-7
    assert np.abs(got.stderr["depth_axis"] / z).max() < 1e-7
    for name in ("normal", "geo_normal"):
        assert np.abs(got[name] - [0, 0, -1]).max() < 1e-6
    assert (got["albedo"] == np.float32([0.25, 0.5, 0.75])).all()
    assert not got.stderr["albedo"].any()
    assert (got["alpha"] == 1).all() and not got.stderr["alpha"].any()
    # Even points of a pixel 2 half z / width wide: the mean is off by w / sqrt(12 spp). Of 384
    # pixels and 2 coordinates none is off by 5.5 of these but once in 33,000 runs.
    spread = 2 * half * z / width / math.sqrt(12 * 64)
    assert np.abs(got["position"][..., :2] - z * np.stack([x, y], -1)).max() < 5.5 * spread
    assert np.abs(got.stderr["position"][..., :2] / spread - 1).max() < 0.5
    uv = np.stack([0.5 - x * z / (100 * unit), 0.5 + y * z / (100 * unit)], -1)
    assert np.abs(got["uv"] - uv).max() < 5.5 * spread / (100 * unit)
    reach = half / width
    low = z * np.sqrt(1 + np.maximum(np.abs(x) - reach, 0) ** 2
                      + np.maximum(np.abs(y) - reach, 0) ** 2)  # fmt: skip
    high = z * np.sqrt(1 + (np.abs(x) + reach) ** 2 + (np.abs(y) + reach) ** 2)
    assert (got["depth"] > low * (1 - 1e-6)).all() and (got["depth"] < high * (1 + 1e-6)).all()
    assert (got["object"] == ones).all() and (got["material"] == got["material"][0, 0]).all()


def test_a_sphere_in_a_narrow_view(device: str) -> None:
    """Positions lie on the sphere, normals point from its centre, and alpha is the cone's share."""
    centre, radius = np.array([0.3, -0.2, 5.0]), 1.0
    scene = scene_of(
        {"ball": {"type": "sphere", "center": centre.tolist(), "radius": radius, "bsdf": GREY}},
        width=64, height=64, fov=40.0,
    )  # fmt: skip
    got = vr.feature_images(scene, SINGLE, spp=1, seed=1, device=device)
    hit = got["alpha"] > 0
    assert 0.2 < hit.mean() < 0.4
    out = got["position"][hit].astype(float) - centre
    assert np.abs(np.linalg.norm(out, axis=1) - radius).max() < 2e-6
    assert np.abs(got["normal"][hit] - out / radius).max() < 4e-6
    assert np.abs(np.linalg.norm(got["position"][hit], axis=1) / got["depth"][hit] - 1).max() < 1e-6
    assert np.abs(got["position"][hit][:, 2] / got["depth_axis"][hit] - 1).max() < 1e-6
    assert np.isinf(got["depth"][~hit]).all() and np.isinf(got["depth_axis"][~hit]).all()
    for name in ("position", "normal", "geo_normal", "albedo", "uv"):
        assert not got[name][~hit].any()
    assert (got["object"][20:40, 25:35] == 1).all() and got["object"][0, 0] == 0
    assert (got["primitive"][got["object"] > 0] == 1).all()
    # The solid of the view that the cone takes, by the film's area; exact to a border of a pixel.
    many = vr.feature_images(scene, ("alpha",), spp=256, device=device)["alpha"]
    again = vr.feature_images(scene, ("alpha",), spp=256, seed=9, device=device)["alpha"]
    assert abs(float(many.mean()) - float(again.mean())) < 1e-3


def test_shares_and_errors_over_seeds(device: str) -> None:
    """Standard errors are those of the means over seeds, and means over hits do not depend on the
    share that hits: half of each pixel of a column sees the wall.

    400 seeds: the variance's relative error is sqrt(2 / 399) = 0.071; 5.5 of these, 64 pixels, two
    images: a false alarm in 200,000 runs. z of the mean over seeds: 5.5 likewise."""
    to_world = np.diag([-50.0, 50.0, -1.0, 1.0])
    to_world[:3, 3] = [50.0, 0, 4.0]  # x > 0: the left half
    wall = {"type": "rectangle", "to_world": to_world, "bsdf": GREY}
    scene = scene_of({"wall": wall}, width=5, height=4)
    seeds, spp = 400, 16
    runs = [vr.feature_images(scene, ("position", "alpha"), spp=spp, seed=k, device=device,
                              sampler="independent") for k in range(seeds)]  # fmt: skip
    alpha = np.array([r["alpha"] for r in runs], float)
    assert (alpha[:, :, :2] == 1).all() and not alpha[:, :, 3:].any()
    middle = alpha[:, :, 2]
    assert np.abs(middle.mean(0) - 0.5).max() < 5.5 * 0.5 / math.sqrt(seeds * spp)
    error = np.array([r.stderr["alpha"] for r in runs], float)[:, :, 2]
    assert abs((error**2).mean() / middle.var(0, ddof=1).mean() - 1) < 5.5 * 0.071
    x = np.array([r["position"][..., 0] for r in runs], float)
    stderr = np.array([r.stderr["position"][..., 0] for r in runs], float)
    width = 2 * math.tan(math.radians(30)) * 4 / 5
    for column, centre, wide in ((0, 2 * width, width), (1, width, width),
                                 (2, width / 4, width / 2)):  # fmt: skip
        off = (x[:, :, column] - centre).mean(0)
        assert np.abs(off).max() < 5.5 * wide / math.sqrt(12 * seeds * 7)
        ratio = (stderr[:, :, column] ** 2).mean(0) / x[:, :, column].var(0, ddof=1)
        assert np.abs(ratio - 1).max() < 5.5 * 0.09, (column, ratio)


def test_a_filter_that_ends_in_zeros_loses_no_sample(device: str) -> None:
    """Mitchell's of B = C = 0 is 0 beyond a pixel; 1 sample in 2,048 had no place."""
    scene = scene_of({"wall": plane(5.0)}).with_(filter="mitchell", filter_parameter=(0.0, 0.0))
    assert (vr.feature_images(scene, "alpha", spp=256, device=device)["alpha"] == 1).all()


def test_motion(device: str) -> None:
    """A camera that steps aside by d sees a point at depth z move by f d / z pixels."""
    scene = scene_of({"near": plane(4.0)})
    step = np.eye(4)
    step[:3, 3] = [0.125, -0.25, 0.5]
    other = vr.Camera(to_world=step, fov=60.0)
    got = vr.feature_images(scene, "motion, position", spp=1, device=device, motion_to=other)
    p = got["position"].astype(float)
    focal = 24 / 2 / math.tan(math.radians(30))
    for k, sign in ((0, -1), (1, -1)):
        there, here = (p[..., k] - step[k, 3]) / (p[..., 2] - 0.5), p[..., k] / p[..., 2]
        moved = sign * focal * (there - here)
        assert np.abs(got["motion"][..., k] - moved).max() < 1e-4
    same = vr.feature_images(scene, ("motion",), spp=4, device=device, motion_to=scene.camera)
    assert not same["motion"].any()


def test_motion_beside_a_picture(tmp_path: Path, device: str) -> None:
    """The bits of `feature_images`; the file says where the second camera sees a point."""
    scene = scene_of({"near": plane(4.0)})
    other = vr.Camera.look_at((0.5, -0.25, 0), (0, 0, 4), fov=50.0)
    settings: dict[str, Any] = {"spp": 8, "device": device, "motion_to": other}
    apart = vr.feature_images(scene, "motion,position", **settings)
    got = vr.render(scene, features="motion,position", **settings)
    got.save(tmp_path / "a.exr")
    read = image.load(tmp_path / "a.exr").features
    for found in (got.features, read):
        assert np.array_equal(found["motion"], apart["motion"])
        assert np.array_equal(found.motion_to, apart.motion_to)
    assert read.motion_to is not None
    points = np.concatenate([read["position"], np.ones((16, 24, 1))], axis=-1)
    x, y, w = np.einsum("ij,hwj->ihw", read.motion_to, points)
    here = np.stack(np.meshgrid(np.arange(24) + 0.5, np.arange(16) + 0.5), axis=-1)
    there = np.stack([x / w, y / w], axis=-1)  # the mean position is up to half a pixel off
    assert np.abs(there - here - read["motion"]).max() < 0.5


# ---- numbers ----


def test_numbers_are_exact(device: str) -> None:
    """Two triangles of a merged face, two shapes in one plane, a sphere and a disk."""
    shapes: dict[str, Any] = {}
    for k, shift in enumerate((-1.5, 1.5)):
        to_world = np.diag([-1.5, 3.0, -1.0, 1.0])
        to_world[:3, 3] = [shift, 0, 6]
        shapes[f"half{k}"] = {"type": "rectangle", "to_world": to_world,
                              "bsdf": {"type": "ref", "id": "grey"}}  # fmt: skip
    shapes["ball"] = {"type": "sphere", "center": [0.0, 0.5, 4.0], "radius": 0.5}
    disk = np.diag([-0.5, 0.5, -1.0, 1.0])
    disk[:3, 3] = [0, -1, 4]
    shapes["disk"] = {"type": "disk", "to_world": disk}
    scene = scene_of({"grey": {**GREY, "id": "grey"}, **shapes}, width=61, height=41)
    got = vr.feature_images(scene, NUMBERS, device=device)
    assert all(got[name].dtype == np.uint32 for name in NUMBERS)
    triangles = len(scene.triangles)
    tables = np.concatenate([scene.triangle_shape, scene.sphere_shape, scene.disk_shape])
    primitive, shape = got["primitive"].astype(int), got["object"].astype(int)
    hit = primitive > 0
    assert (tables[primitive[hit] - 1] + 1 == shape[hit]).all() and not shape[~hit].any()
    assert {*np.unique(primitive)} == {*range(triangles + 3)}  # all of them, and nothing
    assert scene.shape_names[shape[20, 15] - 1] == "half1"
    assert scene.shape_names[shape[20, 45] - 1] == "half0"
    # The triangle under a pixel, by its own corners.
    half = math.tan(math.radians(30))
    corners = scene.vertices[scene.triangles]
    for y, x in np.argwhere(hit & (primitive <= triangles))[::7]:
        way = np.array([half * (1 - 2 * (x + 0.5) / 61), half * (41 - 2 * (y + 0.5)) / 61, 1.0]) * 6
        a, b, c = corners[primitive[y, x] - 1]
        n = np.cross(b - a, c - a)
        inside = [np.cross(q - p, way - p) @ n for p, q in ((a, b), (b, c), (c, a))]
        assert min(inside) >= -1e-9 * (n @ n)


def test_what_rays_go_through(device: str) -> None:
    """Null surfaces and uncovered parts of masks are passed; glass and mirrors are not."""
    red = {"type": "diffuse", "reflectance": {"type": "rgb", "value": [1, 0, 0]}}
    for bsdf, seen in (
        ({"type": "null"}, 6.0),
        ({"type": "mask", "opacity": 0.0, "nested": red}, 6.0),
        ({"type": "mask", "opacity": 1.0, "nested": red}, 3.0),
        ({"type": "thindielectric"}, 3.0),
        ({"type": "dielectric"}, 3.0),
        ({"type": "conductor", "material": "none"}, 3.0),
    ):
        scene = scene_of({"first": plane(3.0, bsdf), "wall": plane(6.0)})
        got = vr.feature_images(scene, ("depth_axis", "object", "albedo"), spp=8, device=device)
        assert np.abs(got["depth_axis"] / seen - 1).max() < 1e-6, bsdf
        assert (got["object"] == (2 if seen > 3 else 1)).all(), bsdf
        if bsdf["type"] in ("thindielectric", "dielectric", "conductor"):
            assert np.abs(got["albedo"] - 1).max() < 1e-6
    half = {"type": "mask", "opacity": 0.25, "nested": red}
    scene = scene_of({"first": plane(3.0, half), "wall": plane(6.0)})
    got = vr.feature_images(scene, ("depth_axis", "albedo"), spp=256, device=device)
    share = (6 - got["depth_axis"].astype(float)) / 3  # 384 pixels, 256 samples: 5.5 sigma
    assert np.abs(share - 0.25).max() < 5.5 * math.sqrt(0.25 * 0.75 / 256)
    assert np.abs(got["albedo"][..., 0] - (0.25 + 0.75 * share)).max() < 1e-6


# ---- the picture beside them ----


@pytest.mark.parametrize(
    "name", ["cornell-box", "checks/thinlens", "checks/mask", "checks/mitchell"]
)
def test_the_picture_stays_as_it_is(name: str, device: str) -> None:
    scene = load(name)
    size = {"width": 16, "height": 12, "spp": 4, "device": device}
    alone = vr.render(scene, **size)
    with_them = vr.render(scene, **size, features=PLAIN)
    assert not alone.features and alone.film_sha256 == with_them.film_sha256
    assert {*with_them.features} == {*PLAIN} and with_them.features.spp == 4
    apart = vr.feature_images(scene, PLAIN, **size)
    for key in PLAIN:
        assert apart[key].tobytes() == with_them.features[key].tobytes()


def load(name: str) -> vr.Scene:
    if not name.startswith("checks/"):
        return vr.load_file(name)
    return vr.load_file(Path(vr.__file__).parent / "scenes" / f"{name}.xml")


def test_direct_and_indirect(device: str) -> None:
    """Direct is the picture of two segments, and both parts add up to the picture."""
    scene = vr.load_file("cornell-box")
    size = {"width": 16, "height": 16, "spp": 8, "device": device, "seed": 5}
    got = vr.render(scene, **size, features="direct,indirect")
    two = vr.render(scene, **size, max_depth=2)
    assert got.features["direct"].tobytes() == two.image.tobytes()
    assert got.features.stderr["direct"].tobytes() == two.stderr.tobytes()
    total = got.features["indirect"].astype(float) + two.image
    assert (np.abs(total - got.image) <= 2.0**-20 * got.image).all()
    assert (got.features["indirect"] >= 0).all() and got.features["indirect"].mean() > 0
    lamp = vr.render(scene, **size, max_depth=1, features=("direct", "indirect"))
    assert lamp.features["direct"].tobytes() == lamp.image.tobytes()
    assert not lamp.features["indirect"].any()


# ---- the same bits everywhere ----

SCENES = ["cornell-box", "checks/thinlens", "checks/spheres_300", "checks/mask", "checks/relief",
          "checks/blends", "checks/orthographic", "checks/attributes"]  # fmt: skip


@pytest.mark.parametrize("name", SCENES)
@pytest.mark.parametrize("spp", [1, 5, 8, 70])
def test_all_devices_agree(name: str, spp: int, monkeypatch: pytest.MonkeyPatch) -> None:
    """And so do thread counts, and bands of rows; every plane and error, bit for bit. On CUDA a
    warp has all samples of a pixel, some of them, or those of several pixels."""
    scene = load(name)
    names = SINGLE if scene.uv.any() else PLAIN
    size = {"width": 37, "height": 11, "spp": spp}
    first = None
    for device in DEVICES:
        for threads in (1, 3):
            got = vr.feature_images(scene, names, **size, device=device, threads=threads)
            data = {key: value.tobytes() for key, value in got.channels().items()}
            first = first or data
            assert data == first, device
        monkeypatch.setattr(first_surface, "band", lambda *_: 3)
        got = vr.feature_images(scene, names, **size, device=device)
        assert {key: value.tobytes() for key, value in got.channels().items()} == first
        monkeypatch.undo()


def test_the_code_for_some_features_gives_the_bits_of_that_for_all(device: str) -> None:
    """Of every check scene, as `test_variants` asks of pictures."""
    folder = Path(vr.__file__).parent / "scenes" / "checks"
    scenes = sorted(path.stem for path in folder.glob("*.xml"))
    assert len(scenes) > 50
    for name in scenes:
        scene = load(f"checks/{name}")
        names = SINGLE if scene.uv.any() else PLAIN
        size = {"width": 16, "height": 12, "device": device}
        some = vr.feature_images(scene, names, spp=3, **size).channels()
        every = vr.render(scene, 1, **size, features=names, feature_spp=3, all_features=True)
        for key, values in every.features.channels().items():
            assert values.tobytes() == some[key].tobytes(), (name, key)


@pytest.mark.parametrize("name", ["cornell-box", "checks/mask"])
def test_samples_in_parts_add_up(name: str, device: str) -> None:
    """Ranges in any order give the words of the whole; lane sums those of one sample at a time."""
    from veriray.native_scene import native_scene

    chosen = DEVICES[device]
    scene = load(name).with_(width=19, height=7)
    held = native_scene(scene, scene, chosen)
    planes = [
        {"name": key, "kind": "sums and squares", "channels": len(LAYERS[key]), "negative": True}
        for key in ("depth", "depth_axis", "position", "normal", "geo_normal", "albedo", "uv",
                    "motion")
    ]  # fmt: skip
    planes += [{"name": key, "kind": "integers", "channels": 1, "negative": False}
               for key in ("hits", "primitive")]  # fmt: skip

    def film(*ranges: tuple[int, int]) -> Any:
        made = chosen.native.Film(19, 7, device=chosen.index, planes=planes)
        for begin, end in ranges:
            chosen.native.render_features(
                held, made, sample_begin=begin, sample_end=end, motion=np.zeros((2, 3, 4)),
                seed=7, sampler="independent", threads=2, poll=None,
            )  # fmt: skip
        return made

    whole = film((0, 70))
    parts = film((3, 64), *((k, k + 1) for k in (0, 2, 1)))
    parts.add(film((64, 70)))
    for k in range(1, len(planes) + 1):
        assert whole.words(k).tobytes() == parts.words(k).tobytes()
    for bad, message in (
        ([{**planes[0], "name": "deep"}], "plane 'deep' is no feature image; allowed: hits, primi"),
        ([{**planes[0], "channels": 2}], "plane 'depth' must hold sums and squares of 1 channels"),
        ([planes[0]], "the film has no plane 'hits'"),
    ):
        planes = bad
        with pytest.raises(ValueError, match=message):
            film((0, 1))


def test_scaling_by_a_power_of_two_changes_no_bit(device: str) -> None:
    lists = {}
    for unit in (1.0, 2.0**20):
        scene = scene_of({"wall": plane(4.0 * unit, size=3 * unit)})
        lists[unit] = vr.feature_images(scene, PLAIN, spp=9, device=device)
    one, large = lists.values()
    for name in PLAIN:
        factor = 2.0**20 if name in ("depth", "depth_axis", "position") else 1
        assert np.array_equal(one[name] * np.float32(factor), large[name]), name


# ---- files and commands ----


def test_files(tmp_path: Path, device: str) -> None:
    scene = load("checks/attributes")
    got = vr.render(scene, 2, width=9, height=7, device=device, features=SINGLE)
    path = tmp_path / "a.exr"
    got.save(path)
    with OpenEXR.File(str(path), separate_channels=True) as file:
        channels = {key: np.array(c.pixels) for key, c in file.channels().items()}
    layers = {f"{name}.{letter}" for name in SINGLE for letter in LAYERS[name]}
    errors = {f"stderr.{layer}" for layer in layers if layer[:-2] not in NUMBERS}
    colours = {*"RGB", *(f"stderr.{c}" for c in "RGB")}
    assert {*channels} == layers | errors | colours
    assert {"depth.Z", "normal.X", "albedo.R", "uv.V", "alpha.A", "object.I"} <= layers
    assert channels["object.I"].dtype == np.uint32 and channels["depth.Z"].dtype == np.float32
    assert np.array_equal(channels["normal.Y"], got.features["normal"][..., 1])
    again = image.load(path)
    assert {*again.features} == {*SINGLE} and again.features.spp == 2
    for name, values in got.features.items():
        assert again.features[name].dtype == values.dtype
        assert np.array_equal(again.features[name], values)
        if name not in NUMBERS:
            assert np.array_equal(again.features.stderr[name], got.features.stderr[name])
    assert again.film_sha256 == got.film_sha256
    apart = vr.feature_images(scene, "depth", spp=2, width=9, height=7, device=device)
    apart.save(tmp_path / "b.exr")
    with OpenEXR.File(str(tmp_path / "b.exr"), separate_channels=True) as file:
        assert {*file.channels()} == {"depth.Z", "stderr.depth.Z", "alpha.A", "stderr.alpha.A"}
    with pytest.raises(vr.ImageError, match="expected the suffix .exr"):
        apart.save(tmp_path / "b.png")


def test_command(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    out = tmp_path / "a.exr"
    size = ["--width", "8", "--height", "6", "--spp", "2", "--device", "cpu"]
    assert cli.main(["render", "cornell-box", *size, "-o", str(out), "--features",
                     "depth,normal"]) == 0  # fmt: skip
    assert "features   depth, normal, alpha (2 spp)" in capsys.readouterr().out
    assert {*image.load(out).features} == {"depth", "normal", "alpha"}
    assert cli.main(["render", "cornell-box", *size, "-o", str(out), "--features", "dept"]) != 0
    assert f"features = 'dept' is unknown; allowed: {', '.join(FEATURES)}" in (
        capsys.readouterr().err
    )
    png = str(tmp_path / "a.png")
    assert cli.main(["render", "cornell-box", *size, "-o", png, "--features", "depth"]) != 0
    assert "--features needs an output FILE.exr" in capsys.readouterr().err


TWO_SENSORS = """<scene version="3.0.0"><emitter type="constant"/><shape type="rectangle">
    <transform name="to_world"><rotate y="1" angle="180"/><translate z="3"/></transform></shape>
    <sensor type="perspective"><float name="fov" value="20"/></sensor>
    <sensor type="perspective"><float name="fov" value="20"/><transform name="to_world">
    <translate x="0.125"/></transform></sensor></scene>"""


def cameras_file(path: Path, *names: str) -> str:
    """A list for Mitsuba whose cameras stand 0, 0.125, 0.25 ... beside the origin."""
    entries = [{"name": name, "fov": 20, "matrix": [[1, 0, 0, k / 8], [0, 1, 0, 0], [0, 0, 1, 0],
                                                    [0, 0, 0, 1]]}
               for k, name in enumerate(names)]  # fmt: skip
    path.write_text(json.dumps({"convention": "mitsuba", "cameras": entries}), "utf-8")
    return str(path)


def test_motion_on_the_command_line(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    scene, out = tmp_path / "scene.xml", tmp_path / "a.exr"
    scene.write_text(TWO_SENSORS, "utf-8")
    three = cameras_file(tmp_path / "three.json", "a", "b/c", "d:e")
    one = cameras_file(tmp_path / "one:0.json", "only")
    words = ["render", str(scene), "--width", "8", "--height", "6", "--spp", "1", "-o", str(out),
             "--device", "cpu", "--quiet", "--features", "motion"]  # fmt: skip
    # a step to the camera's +x, which is the picture's left, moves what is seen to the right
    step = 8 / 2 / math.tan(math.radians(10)) * 0.125 / 3
    moves = {"0": 0.0, "1": 1.0, f"{three}:b/c": 1.0, f"{three}:a": 0.0, one: 0.0,
             f"{one}:only": 0.0}  # fmt: skip
    for second, steps in moves.items():
        assert cli.main([*words, "--motion-to", second]) == 0, second
        motion = image.load(out).features["motion"]
        assert np.abs(motion - [steps * step, 0]).max() < 1e-4, second
    capsys.readouterr()
    refused = {
        "2": f"--motion-to 2 is outside [0, 1]: {scene} has 2 sensors (or name a file of cameras)",
        three: f"--motion-to {three}: expected {three}:NAME with one of a, b/c, d:e",
        f"{three}:f": f"--motion-to {three}:f: expected {three}:NAME with one of a, b/c, d:e",
        str(tmp_path / "none.json"): f"{tmp_path / 'none.json'}: No such file or directory",
    }
    for second, message in refused.items():
        assert cli.main([*words, "--motion-to", second]) == 2
        assert message in capsys.readouterr().err
    assert cli.main(words) == 2
    assert 'feature "motion" needs a second camera' in capsys.readouterr().err
    assert cli.main([*words[:-2], "--motion-to", "1"]) == 2
    assert 'motion_to is for the feature "motion", which is not asked' in capsys.readouterr().err


def test_aov_in_a_scene_file(tmp_path: Path) -> None:
    """Its planes that are feature images are written; the others are noted."""
    text = (Path(vr.__file__).parent / "scenes" / "open.xml").read_text("utf-8")
    begin, end = text.index("<integrator"), text.index("</integrator>") + len("</integrator>")
    kinds = "d:depth, n:sh_normal,u:uv,dp_du,i:shape_index"
    around = f'<integrator type="aov"><string name="aovs" value="{kinds}"/>{text[begin:end]}'
    path = tmp_path / "scene.xml"
    path.write_text(text[:begin] + around + "</integrator>" + text[end:], "utf-8")
    scene = vr.load_file(path)
    assert scene.features == ("depth", "normal", "object")
    assert any("no image of dp_du is written" in note for note in scene.notes)
    assert any("nothing is textured, so uv is not written" in note for note in scene.notes)
    assert scene.sha256 == vr.load_file("open").sha256
    size = ["--width", "8", "--height", "6", "--spp", "2", "--device", "cpu", "--quiet"]
    out, png = str(tmp_path / "a.exr"), str(tmp_path / "a.png")
    assert cli.main(["render", str(path), *size, "-o", out]) == 0
    assert {*image.load(out).features} == {"depth", "normal", "alpha", "object"}
    assert cli.main(["render", str(path), *size, "-o", png]) == 0
    assert cli.main(["render", str(path), *size, "-o", out, "--features", "albedo"]) == 0
    assert {*image.load(out).features} == {"albedo", "alpha"}


@pytest.mark.parametrize(
    ("line", "features"),
    [
        ('<integrator type="depth"/>', ("depth",)),
        (
            '<integrator type="aov"><string name="aovs" value="a:sh_normal,b:depth"/></integrator>',
            ("normal", "depth"),
        ),
    ],
)
def test_integrators_that_show_no_light(
    tmp_path: Path, line: str, features: tuple[str, ...]
) -> None:
    """Without another integrator in them: feature images are what they show."""
    text = f"""<scene version="3.0.0">{line}<emitter type="constant"/><shape type="rectangle">
        <transform name="to_world"><rotate y="1" angle="180"/><translate z="3"/></transform></shape>
        <sensor type="perspective"><float name="fov" value="20"/></sensor></scene>"""
    path = tmp_path / "scene.xml"
    path.write_text(text, "utf-8")
    with pytest.warns(vr.SceneWarning, match="the picture is the scene's light, as by path"):
        scene = vr.load_file(path)
    assert scene.features == features
    found = vr.render(scene, width=9, height=9, spp=4, device="cpu", features=scene.features)
    assert found.features is not None
    assert found.features["depth"][4, 4] == pytest.approx(3, rel=1e-3)


# ---- refused ----


@pytest.mark.parametrize(
    "names, message",
    [
        ("depht", r"names = 'depht' is unknown; allowed: depth, depth_axis, position, normal, "),
        (("depth", "ids"), "names = 'ids' is unknown; allowed: "),
        (3, "names = 3 is not a list of strings"),
        ((), r"names = \(\) is empty; allowed: depth, "),
        ("motion", 'feature "motion" needs a second camera: motion_to, on the command line --mo'),
        ("direct", r"direct are parts of a picture: render\(scene, features=...\)"),
    ],
)
def test_names_that_are_refused(names: Any, message: str) -> None:
    with pytest.raises(ValueError, match=message):
        vr.feature_images(vr.cornell_box(), names)


def test_numbers_of_a_scene_without_surfaces() -> None:
    parts = {"sky": {"type": "constant"}, "eye": {"type": "perspective", "fov": 40}}
    empty = vr.load_dict({"type": "scene", **parts})
    made = vr.render(
        empty, features=["object", "primitive", "material"], device="cpu", spp=1, width=4, height=4
    )
    for name, picture in made.features.items():
        assert not np.asarray(picture).any(), name


def test_what_a_render_refuses() -> None:
    scene = vr.cornell_box()
    patch = [[0, 1, 0, 0, 0, 1, 0, 0, 0, 1, 0]]
    meter = vr.Camera(np.eye(4), 90, projection="irradiance", patches=np.array(patch, float))
    for given, message in (
        ({"features": "dep"}, "features = 'dep' is unknown; allowed: depth, depth_axis"),
        ({"features": "motion"}, 'feature "motion" needs a second camera: motion_to'),
        ({"features": "depth", "motion_to": scene.camera}, 'motion_to is for the feature "motion"'),
        ({"features": "motion", "motion_to": 1}, "motion_to = 1 is not a Camera"),
        ({"features": "motion", "motion_to": meter}, "a camera of projection irradiance sees no"),
        (
            {"features": "direct", "target_error": 0.5, "spp": 64},
            "direct not together with target_error",
        ),
        ({"features": "depth", "feature_spp": 0}, "feature_spp = 0 is outside"),
    ):
        with pytest.raises(ValueError, match=message):
            vr.render(scene, **given)
    with pytest.raises(ValueError, match='feature "uv": the meshes of the scene have no texture'):
        vr.render(scene, 1, width=4, height=4, features="uv", device="cpu")
    with pytest.raises(KeyError, match="no feature image 'depth'; there are: alpha"):
        vr.FeatureImages({"alpha": np.ones((1, 1), np.float32)})["depth"]
    with pytest.raises(ValueError, match="images: 'uv' is none of"):
        vr.FeatureImages({"uv": np.ones((1, 1, 3), np.float32)})
