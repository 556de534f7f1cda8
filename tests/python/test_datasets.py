"""Many views of one scene: `render(scene, cameras=...)`, files of cameras, folders of pictures."""

from __future__ import annotations

import json
import math
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from PIL import Image

import veriray as vr
from veriray import rendering
from veriray.cli import main
from veriray.errors import ImageError
from veriray.formats import cameras
from veriray.image import to_srgb8

Array = np.ndarray[Any, Any]
WIDTH, HEIGHT, FOCAL = 80, 60, 70.0
#: Centre of projection off the middle, from the picture's corner.
CENTRE = (43.0, 27.5)
POINTS = np.array([[0.2, 0.1, 0.0], [-0.6, 0.3, 0.2], [0.5, -0.5, -0.4], [-0.3, -0.4, 0.5]])


def pose(seed: int) -> tuple[Array, Array]:
    """R and t of OpenCV, x_camera = R x + t, that sees the origin from 4 away, turned at random."""
    rng = np.random.default_rng(seed)
    ahead = rng.normal(size=3)
    ahead /= np.linalg.norm(ahead)
    right = np.cross(ahead, rng.normal(size=3))
    right /= np.linalg.norm(right)
    r = np.stack([right, np.cross(ahead, right), ahead])
    return r, np.array([0.05, -0.03, 4.0])


def projected(r: Array, t: Array, centre: tuple[float, float] = CENTRE) -> Array:
    """Where the points are, (n, 2), in pixels from the picture's corner."""
    seen = POINTS @ r.T + t
    found: Array = FOCAL * seen[:, :2] / seen[:, 2:] + centre
    return found


def places(view: cameras.View) -> Array:
    """Where our pictures show the points: the middle of the light of a small ball at each."""
    found = []
    for x, y, z in POINTS.tolist():
        lamp = {"type": "area", "radiance": 1.0}
        ball = {"type": "sphere", "center": [x, y, z], "radius": 0.06, "emitter": lamp}
        scene = vr.load_dict({"type": "scene", "a": ball}).with_(
            camera=view.camera, width=view.width, height=view.height, filter="box"
        )
        image = vr.render(scene, 256, device="cpu", max_depth=1).image[..., 0].astype(np.float64)
        v, u = np.mgrid[: view.height, : view.width] + 0.5
        found.append([(u * image).sum() / image.sum(), (v * image).sum() / image.sum()])
    return np.array(found)


def inverse(r: Array, t: Array, axes: tuple[float, float, float]) -> list[list[float]]:
    """Camera to world, with these signs of the camera's axes against OpenCV's."""
    matrix = np.eye(4)
    matrix[:3, :3] = r.T * axes
    matrix[:3, 3] = -r.T @ t
    result: list[list[float]] = matrix.tolist()
    return result


def K(shift: float = 0.5) -> list[list[float]]:
    return [[FOCAL, 0, CENTRE[0] - shift], [0, FOCAL, CENTRE[1] - shift], [0, 0, 1]]


def quaternion(r: Array) -> list[float]:
    w = math.sqrt(max(1 + np.trace(r), 1e-9)) / 2
    return [w, *((r[(k + 2) % 3, (k + 1) % 3] - r[(k + 1) % 3, (k + 2) % 3]) / (4 * w)
                 for k in range(3))]  # fmt: skip


def written(folder: Path, kind: str, r: Array, t: Array) -> Path:
    """A file of one camera in a convention."""
    size = {"width": WIDTH, "height": HEIGHT}
    gl = inverse(r, t, (1, -1, -1))
    if kind == "colmap":
        numbers = f"{FOCAL} {FOCAL} {CENTRE[0]} {CENTRE[1]}"
        text = f"# cameras\n3 PINHOLE {WIDTH} {HEIGHT} {numbers}\n"
        (folder / "cameras.txt").write_text(text)
        words = " ".join(map(str, [*quaternion(r), *t]))
        (folder / "images.txt").write_text(f"# images\n1 {words} 3 view.png\n\n")
        return folder
    if kind.startswith("nerf"):
        frame: dict[str, Any] = {"file_path": "./view.png", "transform_matrix": gl}
        pixels = {"fl_x": FOCAL, "fl_y": FOCAL, "cx": CENTRE[0], "cy": CENTRE[1]}
        pixels |= {"w": WIDTH, "h": HEIGHT}
        data = (
            {"frames": [{**frame, **pixels}]} if "each" in kind else {"frames": [frame], **pixels}
        )
    elif kind == "opencv":
        data = {"convention": "opencv", **size,
                "cameras": [{"name": "view", "K": K(), "R": r.tolist(), "t": [*t]}]}  # fmt: skip
    elif kind == "opencv matrix":
        matrix = np.eye(4)
        matrix[:3, :3], matrix[:3, 3] = r, t
        entry = {"name": "view", "K": K(), "matrix": matrix.tolist(), **size}
        data = {"convention": "opencv", "cameras": [entry]}
    else:
        assert kind == "opengl"
        data = {"convention": "opengl", **size,
                "cameras": [{"name": "view", "K": K(), "matrix": gl}]}  # fmt: skip
    path = folder / "cameras.json"
    path.write_text(json.dumps(data))
    return path


KINDS = ["colmap", "nerf", "nerf each", "opencv", "opencv matrix", "opengl"]


@pytest.mark.parametrize("kind", KINDS)
@pytest.mark.parametrize("seed", [1, 2])
def test_known_points_are_where_they_belong(tmp_path: Path, kind: str, seed: int) -> None:
    """Within 0.15 pixels, as light is counted at the pixels' middles; conventions differ by 0.5."""
    r, t = pose(seed)
    (view,) = cameras.load(written(tmp_path, kind, r, t), 7, 7)
    assert (view.name, view.width, view.height) == ("view", WIDTH, HEIGHT)
    assert np.abs(places(view) - projected(r, t)).max() < 0.15


@pytest.mark.parametrize("kind", ["angle", "fov", "mitsuba"])
def test_angles(tmp_path: Path, kind: str) -> None:
    r, t = pose(3)
    angle = 2 * math.atan(WIDTH / 2 / FOCAL)
    gl = inverse(r, t, (1, -1, -1))
    data = {
        "angle": {"camera_angle_x": angle, "frames": [{"transform_matrix": gl}]},
        "fov": {"convention": "opengl", "cameras": [{"matrix": gl, "fov": math.degrees(angle)}]},
        "mitsuba": {"convention": "mitsuba", "cameras": [
            {"matrix": inverse(r, t, (-1, -1, 1)), "fov": math.degrees(angle)}]},
    }[kind]  # fmt: skip
    path = tmp_path / "c.json"
    path.write_text(json.dumps(data))
    (view,) = cameras.load(path, WIDTH, HEIGHT)
    assert view.name == "0000"
    assert np.abs(places(view) - projected(r, t, (WIDTH / 2, HEIGHT / 2))).max() < 0.15


@pytest.mark.parametrize("kind", KINDS)
def test_what_is_written_is_read_back(tmp_path: Path, kind: str) -> None:
    views = cameras.load(written(tmp_path, kind, *pose(4)), 7, 7)
    path = tmp_path / "transforms.json"
    path.write_text(json.dumps(cameras.transforms(views)))
    (back,) = cameras.load(path, 9, 9)
    (view,) = views
    assert (back.name, back.width, back.height) == (view.name, WIDTH, HEIGHT)
    assert np.allclose(back.camera.to_world, view.camera.to_world, atol=1e-12)
    for k in "xy":
        tangents = (getattr(c, f"tan_half_{k}")(WIDTH, HEIGHT) for c in (back.camera, view.camera))
        assert math.isclose(*tangents, rel_tol=1e-12)
    shifts = (c.principal_point_offset for c in (back.camera, view.camera))
    assert np.allclose(*shifts, atol=1e-12)


def test_the_lens_is_the_scenes(tmp_path: Path) -> None:
    path = written(tmp_path, "nerf", *pose(1))
    lens = {"near_clip": 0.5, "far_clip": 9.0, "aperture_radius": 0.1, "focus_distance": 3.0}
    (view,) = cameras.load(path, 7, 7, **lens)
    assert {name: getattr(view.camera, name) for name in lens} == lens


GL = np.eye(4).tolist()
BAD = {
    "no JSON": ("{", "not JSON"),
    "a list": ([], "[] is not an object"),
    "unknown": ({"convention": "maya", "cameras": []}, '"convention" = \'maya\'; expected opencv'),
    "empty": ({"frames": []}, '"frames" is not a list of 1 to'),
    "number": ({"frames": [3]}, "frames[0]: 3 is not an object"),
    "no matrix": ({"frames": [{"fl_x": 3.0}]}, '"transform_matrix" is missing'),
    "a small matrix": ({"frames": [{"fl_x": 3.0, "transform_matrix": [1]}]}, '"transform_matrix"'),
    "no angle": ({"frames": [{"transform_matrix": GL}]}, 'neither "fl_x" nor "camera_angle_x"'),
    "mirrored": ({"frames": [{"fl_x": 3.0, "transform_matrix": np.diag([1.0, 1, -1, 1]).tolist()}]},
                 'frames[0]: "transform_matrix" = [[1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, '
                 "-1.0]] is not a rotation: it scales, shears or mirrors (determinant -1"),
    "sheared": ({"frames": [{"fl_x": 3.0, "transform_matrix": [[1, 0.6, 0, 0], [0, 0.8, 0, 0],
                                                               [0, 0, 1, 0], [0, 0, 0, 1]]}]},
                "is not a rotation"),
    "mirrored for OpenGL": ({"convention": "opengl", "cameras": [
        {"fov": 40.0, "matrix": np.diag([-1.0, 1, 1, 1]).tolist()}]},
        'cameras[0]: "matrix" = [[-1.0, '),
    "mirrored for OpenCV": ({"convention": "opencv", "cameras": [
        {"K": K(), "matrix": np.diag([-1.0, 1, 1, 1]).tolist()}]},
        "cameras[0]: R = [[-1.0, 0.0, 0.0], "),
    "scaled": ({"frames": [{"fl_x": 3.0, "transform_matrix": np.diag([2.0, 2, 2, 1]).tolist()}]},
               "scale"),
    "distorted": ({"k1": 0.1, "frames": [{"fl_x": 3.0, "transform_matrix": GL}]},
                  '"k1" = 0.1: lenses have no distortion'),
    "fisheye": ({"camera_model": "OPENCV_FISHEYE", "frames": [{"transform_matrix": GL}]},
                '"camera_model" = \'OPENCV_FISHEYE\''),
    "not square": ({"frames": [{"fl_x": 3.0, "fl_y": 3.1, "transform_matrix": GL}]},
                   "pixels must be square"),
    "twice": ({"fl_x": 3.0, "frames": [{"transform_matrix": GL, "file_path": "a.png"},
                                       {"transform_matrix": GL, "file_path": "a.exr"}]},
              "two views are named 'a'"),
    "out": ({"fl_x": 3.0, "frames": [{"transform_matrix": GL, "file_path": "../a"}]},
            "leads out of the folder"),
    "no file's": ({"fl_x": 3.0, "frames": [{"transform_matrix": GL, "file_path": "a\ud800"}]},
                  r"frames[0]: name 'a\ud800' is none of a file"),
    "absolute": ({"fl_x": 3.0, "frames": [{"transform_matrix": GL, "file_path": "/a"}]},
                 "leads out of the folder"),
    "size": ({"fl_x": 3.0, "w": 0, "frames": [{"transform_matrix": GL}]}, "width = 0 is outside"),
    "no K": ({"convention": "opencv", "cameras": [{"R": GL}]}, '"K" is missing'),
    "half a pose": ({"convention": "opencv", "cameras": [{"K": K(), "R": np.eye(3).tolist()}]},
                    "give either R and t or matrix"),
}  # fmt: skip


@pytest.mark.parametrize("name", BAD)
def test_bad_files(tmp_path: Path, name: str) -> None:
    data, text = BAD[name]
    path = tmp_path / "c.json"
    path.write_text(data if isinstance(data, str) else json.dumps(data))
    with pytest.raises(vr.SceneError) as caught:
        cameras.load(path, 8, 8)
    assert text in str(caught.value) and str(path) in str(caught.value)


DISTORTED = {
    "k6": 0.1, "p2": -1e-3, "dist": [0, 0.1], "D": [[0.1, 0, 0, 0]], "distCoeffs": [0, 0, 0, 0, 1],
    "distortion": {"k1": 0.2}, "distortion_params": [0.1], "is_fisheye": True, "fl_y": 90.0,
    "camera_angle_x": 0.5, "camera_angle_y": 1.5, "cx": 9.0, "cy": 9.0, "fx": 9.0, "skew": 0.1,
    "camera_model": "OPENCV_FISHEYE", "camera_type": "equirectangular", "shift_x": 0.2,
    "principal_point_offset_x": 0.3, "aperture_radius": 0.5,
}  # fmt: skip
LISTS = ["nerf", "nerf each", "opencv", "opencv matrix", "opengl", "mitsuba"]


def with_keys(folder: Path, kind: str, top: bool, keys: dict[str, Any]) -> Path:
    """A list of one camera, of 70 pixels of focal length, with more keys for all or for itself."""
    if kind == "mitsuba":
        path = folder / "cameras.json"
        fov = math.degrees(2 * math.atan(WIDTH / 2 / FOCAL))
        entry = {"matrix": GL, "fov": fov, "width": WIDTH, "height": HEIGHT}
        path.write_text(json.dumps({"convention": "mitsuba", "cameras": [entry]}))
    else:
        path = written(folder, kind, *pose(1))
    data = json.loads(path.read_text())
    (data if top else data["frames" if "frames" in data else "cameras"][0]).update(keys)
    path.write_text(json.dumps(data))
    return path


@pytest.mark.parametrize("kind", LISTS)
@pytest.mark.parametrize("key", DISTORTED)
def test_lenses_that_are_not_there(tmp_path: Path, kind: str, key: str) -> None:
    """All lists refuse them alike, or read them where the list has the key."""
    own = ("principal_point_offset_x",) if kind == "mitsuba" else ("cx", "cy")
    if key in own and kind in ("nerf", "nerf each", "mitsuba"):
        (view,) = cameras.load(with_keys(tmp_path, kind, False, {key: DISTORTED[key]}), 7, 7)
        assert view.camera.principal_point_offset.any()
        return
    for top in (False,) if kind == "nerf each" and key == "fl_y" else (False, True):
        path = with_keys(tmp_path, kind, top, {key: DISTORTED[key]})
        with pytest.raises(vr.SceneError, match="expected|pixels must be square") as caught:
            cameras.load(path, 7, 7)
        text = str(caught.value)
        place = "frames[0]" if kind.startswith("nerf") else "cameras[0]"
        assert f"{path}: {place}: " in text and "\n" not in text
        assert f'"{key}" = ' in text or "focal lengths 70 and 90" in text


@pytest.mark.parametrize("kind", LISTS)
def test_lenses_without_distortion(tmp_path: Path, kind: str) -> None:
    """Zeros, and the same thing said twice."""
    keys: dict[str, Any] = {
        "k1": 0, "k2": 0.0, "dist": [], "D": [[0, 0, 0, 0, 0.0]], "distCoeffs": None,
        "distortion": {"k1": 0.0}, "is_fisheye": False, "camera_model": "pinhole", "fl_y": FOCAL,
        "camera_angle_y": 2 * math.atan(HEIGHT / 2 / FOCAL), "aperture_radius": 0.0,
    }  # fmt: skip
    (view,) = cameras.load(with_keys(tmp_path, kind, True, keys), 7, 7)
    assert math.isclose(view.camera.tan_half_x(WIDTH, HEIGHT), WIDTH / 2 / FOCAL, rel_tol=1e-6)


def test_the_axis_of_an_angle(tmp_path: Path) -> None:
    path = tmp_path / "c.json"
    for name in ("opengl", "mitsuba"):
        entry = {"matrix": GL, "fov": 40.0, "fov_axis": "y"}
        path.write_text(json.dumps({"convention": name, "cameras": [entry]}))
        (view,) = cameras.load(path, 40, 20)
        assert math.isclose(view.camera.tan_half_y(40, 20), math.tan(math.radians(20)))


SEEN = "1 1 0 0 0 0 0 0 1 a.png"


@pytest.mark.parametrize(
    ("camera", "image", "text"),
    [
        ("1 FISHEYE 8 8 1", SEEN, "model 'FISHEYE' is unknown; expected SIMPLE_PINHOLE"),
        ("1 PINHOLE 8 8 1 1 4", SEEN, "PINHOLE with 3 numbers; expected 4"),
        ("1 PINHOLE 8 8 1 2 4 4", SEEN, "pixels must be square"),
        ("1 PINHOLE 8 x 1 1 4 4", SEEN, "height = 'x' is not an integer"),
        ("1 RADIAL 8 8 1 4 4 0.1 0", SEEN, "[0.1, 0.0]: lenses have no distortion"),
        ("1 PINHOLE 8 8 1 1 4 nan", SEEN, "nan is not finite"),
        ("1 PINHOLE 8 8 1 1 4 4", "1 1 0 0 0 0 0 0 2 a.png", "camera '2' is not in cameras.txt"),
        ("1 PINHOLE 8 8 1 1 4 4", "1 1 0 0 0 0 0", "7 words; expected ID QW"),
        ("1 PINHOLE 8 8 1 1 4 4", "1 2 0 0 0 0 0 0 1 a.png", "is not of length 1"),
        ("1 PINHOLE 8 8 1 1 4 4", "", "no views"),
    ],
)
def test_bad_folders_of_colmap(tmp_path: Path, camera: str, image: str, text: str) -> None:
    (tmp_path / "cameras.txt").write_text(camera + "\n")
    (tmp_path / "images.txt").write_text(image + "\n")
    with pytest.raises(vr.SceneError) as caught:
        cameras.load(tmp_path, 8, 8)
    assert text in str(caught.value) and str(tmp_path) in str(caught.value)


def test_names_of_colmap_may_have_spaces_and_folders(tmp_path: Path) -> None:
    (tmp_path / "cameras.txt").write_text("1 SIMPLE_PINHOLE 8 6 9 4 3\n")
    row = "1 0 0 0 0 0 1"
    lines = [f"1 {row} 1 left/one two.png", "1 2 3", f"2 {row} 1 right/b.png", ""]
    (tmp_path / "images.txt").write_text("\n".join(lines) + "\n")
    assert [v.name for v in cameras.load(tmp_path, 1, 1)] == ["left/one two", "right/b"]


def colmap(folder: Path, *lines: str, cameras: str = "1 SIMPLE_PINHOLE 8 6 9 4 3") -> Path:
    """A folder of COLMAP's with these lines in images.txt."""
    (folder / "cameras.txt").write_text(f"\ufeff# cameras\n{cameras}\n", "utf-8")
    (folder / "images.txt").write_text("\ufeff# images\n" + "\n".join(lines) + "\n", "utf-8")
    return folder


@pytest.mark.parametrize(
    "points", [[], [""], ["", ""], ["1 2 3"], ["1.5 2 -1 " * 40], ["1.5 2 1 " * 4]]
)
def test_lines_of_points_may_be_missing(tmp_path: Path, points: list[str]) -> None:
    names = ["a.png", "0002", "one two", "a b c.png", "e"]
    lines = [line for k, name in enumerate(names)
             for line in (f"{k} 1 0 0 0 0 0 {k} 1 {name}", *points)]  # fmt: skip
    views = cameras.load(colmap(tmp_path, *lines), 1, 1)
    assert [v.name for v in views] == ["a", "0002", "one two", "a b c", "e"]
    assert [v.camera.to_world[2, 3] for v in views] == [0, -1, -2, -3, -4]


def test_cameras_of_colmap_that_no_image_uses(tmp_path: Path) -> None:
    unused = "2 OPENCV_FISHEYE 8 6 9 9 4 3 0.1 0 0 0\n3 RADIAL 8 6 9 4 3 0.1 0"
    used = f"1 SIMPLE_PINHOLE 8 6 9 4 3\n{unused}"
    assert len(cameras.load(colmap(tmp_path, SEEN, cameras=used), 1, 1)) == 1


def test_binary_files_of_colmap(tmp_path: Path) -> None:
    for name in ("cameras.bin", "images.bin"):
        (tmp_path / name).write_bytes(b"\1")
    with pytest.raises(vr.SceneError, match="cameras.bin: .*model_converter --output_type TXT"):
        cameras.load(tmp_path, 8, 8)
    assert cameras.load(colmap(tmp_path, SEEN), 8, 8)
    (tmp_path / "images.txt").unlink()
    with pytest.raises(vr.SceneError, match="images.bin: .*expected images.txt"):
        cameras.load(tmp_path, 8, 8)


def test_byte_order_marks(tmp_path: Path) -> None:
    path = written(tmp_path, "nerf", *pose(1))
    path.write_bytes(b"\xef\xbb\xbf" + path.read_bytes())
    assert len(cameras.load(path, 7, 7)) == 1


# ---- render(cameras=...) ----


def test_views_have_the_bits_of_single_renders(device: str, cornell: vr.Scene) -> None:
    around = [cornell.camera.orbit(5 * k, centre=(278, 273, 280)) for k in range(3)]
    found = vr.render(cornell, 4, seed=3, device=device, cameras=around)
    alone = [vr.render(cornell.with_(camera=c), 4, seed=3, device=device) for c in around]
    assert [r.film_sha256 for r in found] == [r.film_sha256 for r in alone]
    assert len({r.film_sha256 for r in found}) == 3


def test_views_rendered_at_a_time(cornell: vr.Scene, monkeypatch: pytest.MonkeyPatch) -> None:
    """As on a GPU: pictures in the order of the cameras; an error ends the rest."""
    around = [cornell.camera.orbit(5 * k, centre=(278, 273, 280)) for k in range(9)]
    apart = vr.render(cornell, 4, seed=3, device="cpu", cameras=around)
    monkeypatch.setattr(rendering, "_brief", lambda *_: True)
    found = vr.render(cornell, 4, seed=3, device="cpu", cameras=around)
    assert [r.film_sha256 for r in found] == [r.film_sha256 for r in apart]
    begun: list[vr.Scene] = []

    def failing(scene: vr.Scene, *rest: object) -> None:
        begun.append(scene)
        raise vr.OutOfMemoryError("no memory")

    monkeypatch.setattr(rendering, "render_with", failing)
    with pytest.raises(vr.OutOfMemoryError, match="no memory"):
        vr.render(cornell, 4, device="cpu", cameras=around * 100)
    assert len(begun) < 900


def test_views_share_a_tree(cornell: vr.Scene) -> None:
    many = _many_spheres()
    around = [many.camera.dolly(0.1 * k) for k in range(3)]
    vr.render(many, 1, device="cpu", cameras=around)
    families = {form.native.family for form in many.native_forms}
    assert len(families) == 1


def _many_spheres() -> vr.Scene:
    balls = {f"s{k}": {"type": "sphere", "center": [k % 40, k // 40, 0.0], "radius": 0.4}
             for k in range(1200)}  # fmt: skip
    eye = {"type": "perspective", "to_world": vr.Camera.look_at((20, 15, 60), (20, 15, 0)).to_world,
           "film": {"type": "hdrfilm", "width": 8, "height": 8}}  # fmt: skip
    return vr.load_dict({"type": "scene", "eye": eye, "sky": {"type": "constant"}, **balls})


def test_progress_of_views(cornell: vr.Scene, capsys: pytest.CaptureFixture[str]) -> None:
    told: list[float] = []
    vr.render(cornell, 2, device="cpu", cameras=[cornell.camera] * 4, progress=told.append)
    assert told == sorted(told) and told[-1] == 1.0 and {0.25, 0.5, 0.75} <= {*told}
    vr.render(cornell, 2, device="cpu", cameras=[cornell.camera] * 4, progress=True)
    assert "8 spp in " in capsys.readouterr().err


def test_bad_lists_of_cameras(cornell: vr.Scene) -> None:
    assert vr.render(cornell, 1, cameras=[]) == []
    for wrong in (cornell.camera, "camera", 3, [cornell.camera, 3]):
        with pytest.raises(TypeError, match="cameras"):
            vr.render(cornell, 1, cameras=wrong)  # type: ignore[call-overload]


# ---- folders ----


@pytest.fixture
def turning(cornell: vr.Scene) -> list[vr.Camera]:
    return [cornell.camera.orbit(5 * k, centre=(278, 273, 280)) for k in range(3)]


def test_a_data_set(tmp_path: Path, cornell: vr.Scene, turning: list[vr.Camera]) -> None:
    files = vr.dataset(cornell, tmp_path / "out", turning, spp=2, device="cpu", png=True)
    assert [f.name for f in files] == ["0000.exr", "0001.exr", "0002.exr", "transforms.json"]
    for k, camera in enumerate(turning):
        render = vr.Render.load(files[k])
        alone = vr.render(cornell.with_(camera=camera), 2, seed=k, device="cpu")
        assert render.film_sha256 == alone.film_sha256
        assert files[k].with_suffix(".png").exists()
    views = cameras.load(files[-1], 1, 1)
    assert [view.name for view in views] == ["0000", "0001", "0002"]
    for view, camera in zip(views, turning, strict=True):
        assert np.allclose(view.camera.to_world, camera.to_world)


def test_it_goes_on_where_it_was_stopped(
    tmp_path: Path, cornell: vr.Scene, turning: list[vr.Camera]
) -> None:
    def stop(fraction: float) -> None:
        if fraction > 0.5:
            raise KeyboardInterrupt

    settings: dict[str, Any] = {"spp": 2, "device": "cpu"}
    with pytest.raises(KeyboardInterrupt):
        vr.dataset(cornell, tmp_path, turning, progress=stop, **settings)
    there = sorted(tmp_path.iterdir())
    assert [f.name for f in there] == ["0000.exr"]
    before = there[0].stat().st_mtime_ns
    files = vr.dataset(cornell, tmp_path, turning, **settings)
    assert files[0].stat().st_mtime_ns == before
    again = vr.dataset(cornell, tmp_path / "other", turning, **settings)
    for one, other in zip(files[:3], again[:3], strict=True):
        assert vr.Render.load(one).film_sha256 == vr.Render.load(other).film_sha256
    told: list[float] = []
    vr.dataset(cornell, tmp_path, turning, progress=told.append, png=True, **settings)
    assert not told and (tmp_path / "0002.png").exists()


@pytest.mark.parametrize(
    ("change", "name"),
    [({"spp": 4}, "spp is 2, not 4"), ({"seed": 5}, "seed is 0, not 5"),
     ({"max_depth": 3}, "scene_sha256 is"), ({"sampler": "independent"}, "sampler is 'sobol'"),
     ({"target_error": 0.5, "spp": 64}, "spp is 2")],
)  # fmt: skip
def test_files_of_other_settings_are_in_the_way(
    tmp_path: Path, cornell: vr.Scene, turning: list[vr.Camera], change: dict[str, Any], name: str
) -> None:
    settings: dict[str, Any] = {"spp": 2, "device": "cpu"}
    vr.dataset(cornell, tmp_path, turning[:1], **settings)
    with pytest.raises(ImageError, match=name):
        vr.dataset(cornell, tmp_path, turning[:1], **{**settings, **change})
    vr.dataset(cornell, tmp_path, turning[:1], again=True, **{**settings, **change})
    vr.dataset(cornell, tmp_path, turning[:1], **{**settings, **change})


def test_feature_images_of_views(tmp_path: Path, cornell: vr.Scene) -> None:
    small: dict[str, Any] = {"spp": 2, "width": 8, "height": 8, "device": "cpu"}
    file = vr.dataset(cornell, tmp_path, **small, features=("depth", "normal"))[0]
    kept = file.stat().st_mtime_ns
    assert {*vr.Render.load(file).features} == {"depth", "normal", "alpha"}
    vr.dataset(cornell, tmp_path, **small, features="depth")
    assert file.stat().st_mtime_ns == kept
    with pytest.raises(vr.ImageError, match=r"lacks albedo \(again replaces it\)"):
        vr.dataset(cornell, tmp_path, **small, features="albedo")


def test_motion_to_the_next_view(
    tmp_path: Path, cornell: vr.Scene, turning: list[vr.Camera]
) -> None:
    """The last view has none; a file whose motion is to another camera is in the way."""
    settings: dict[str, Any] = {"spp": 2, "device": "cpu", "features": ("motion", "depth")}
    files = vr.dataset(cornell, tmp_path, turning, **settings)
    for k in range(2):
        here = cornell.with_(camera=turning[k])
        alone = vr.feature_images(here, "motion", 2, seed=k, motion_to=turning[k + 1])
        assert np.array_equal(vr.Render.load(files[k]).features["motion"], alone["motion"])
    assert {*vr.Render.load(files[2]).features} == {"depth", "alpha"}
    before = [file.stat().st_mtime_ns for file in files[:3]]
    vr.dataset(cornell, tmp_path, turning, **settings)
    assert [file.stat().st_mtime_ns for file in files[:3]] == before
    with pytest.raises(ImageError, match="0000.exr is in the way: its motion is to another camera"):
        vr.dataset(cornell, tmp_path, turning, motion_to=turning[2], **settings)
    vr.dataset(cornell, tmp_path, turning, motion_to=turning[2], again=True, **settings)
    assert not vr.Render.load(files[2]).features["motion"].any()
    with pytest.raises(ValueError, match="is to the next view, and there is one"):
        vr.dataset(cornell, tmp_path / "one", turning[:1], **settings)
    size = {"K": K(), "matrix": np.eye(4).tolist(), "height": 8}
    entries = [{"name": f"v\udc80{width}", "width": width, **size} for width in (8, 9)]
    lists = tmp_path / "cameras.json"
    lists.write_text(json.dumps({"convention": "opencv", "cameras": entries}))
    with pytest.raises(ValueError, match=r"v\\udc808 has 8 x 8 pixels and .*v\\udc809, 9 x 8"):
        vr.dataset(cornell, tmp_path / "two", lists, **settings)


def test_damaged_files_are_in_the_way(tmp_path: Path, cornell: vr.Scene) -> None:
    (tmp_path / "0000.exr").write_bytes(b"text")
    with pytest.raises(ImageError, match="not an OpenEXR file"):
        vr.dataset(cornell, tmp_path, [cornell.camera], spp=1)
    vr.dataset(cornell, tmp_path, [cornell.camera], spp=1, again=True)


def test_bad_data_sets(tmp_path: Path, cornell: vr.Scene) -> None:
    for wrong in ([], [3], cornell.camera, 3):
        with pytest.raises((TypeError, ValueError), match="cameras"):
            vr.dataset(cornell, tmp_path, wrong, spp=1)  # type: ignore[arg-type]
    flat = vr.Camera.orthographic(cornell.camera.to_world)
    with pytest.raises(vr.SceneError, match="holds no orthographic camera"):
        vr.dataset(cornell, tmp_path, [flat], spp=1)
    with pytest.raises(ValueError, match="spp"):
        vr.dataset(cornell, tmp_path, [cornell.camera], spp=0)
    assert not list(tmp_path.iterdir())


def test_the_command(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    source = tmp_path / "transforms.json"
    frame = {"transform_matrix": np.diag([1.0, 1, 1, 1]).tolist(), "file_path": "train/r_0"}
    source.write_text(json.dumps({"camera_angle_x": 0.7, "w": 8, "h": 6, "frames": [frame]}))
    out = tmp_path / "out"
    words = ["dataset", "cornell-box", "--cameras", str(source), "-o", str(out), "--spp", "1"]
    assert main([*words, "--png"]) == 0
    assert "written    1 views" in capsys.readouterr().out
    assert vr.Render.load(out / "train/r_0.exr").image.shape == (6, 8, 3)
    assert (out / "train/r_0.png").exists()
    assert main([*words, "--seed", "4"]) == 2
    assert "is in the way: seed is 0, not 4" in capsys.readouterr().err
    assert main([*words, "--seed", "4", "--again", "--quiet"]) == 0
    assert main(["dataset", "cornell-box", "-o", str(out / "own"), "--width", "8", "--height",
                 "8", "--spp", "1", "--quiet"]) == 0  # fmt: skip
    assert (out / "own" / "0000.exr").exists()


@pytest.mark.parametrize("name", ["r_0.png", "transforms.json"])
def test_files_of_others_are_in_the_way(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], name: str
) -> None:
    """Found before the render; display copies of other commands are not the data set's either."""
    source, out = listed(tmp_path), tmp_path / "out"
    out.mkdir()
    words = ["dataset", "cornell-box", "--cameras", str(source), "-o", str(out), "--spp", "1",
             "--png", "--quiet"]  # fmt: skip
    if name == "r_0.png":
        vr.render(vr.cornell_box(), 1, width=4, height=4, device="cpu").save(out / name)
    else:
        (out / name).write_text(json.dumps({"camera_angle_x": 0.7, "frames": [], "mine": 1}))
    before = (out / name).read_bytes()
    for _ in range(2):
        assert main(words) == 2
        error = capsys.readouterr().err
        assert f"{out / name} is in the way: veriray dataset did not write it" in error
        assert error.count("\n") == 1
        assert [file.name for file in out.iterdir()] == [name]
        assert (out / name).read_bytes() == before
    assert main([*words, "--again"]) == 0 and main(words) == 0
    changed = json.loads((out / "transforms.json").read_text()) | {"aabb_scale": 16}
    (out / "transforms.json").write_text(json.dumps(changed))
    assert main(words) == 2


@pytest.mark.parametrize("link", [False, True])
def test_the_list_of_cameras_is_never_replaced(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], link: bool
) -> None:
    source, out = listed(tmp_path), tmp_path / "out"
    out.mkdir()
    given = out / "transforms.json"
    if link:
        given.symlink_to(source)
    else:
        source.rename(given)
    before = given.read_bytes()
    words = ["dataset", "cornell-box", "-o", str(out), "--spp", "1", "--quiet"]
    for more in ([], ["--again"]):
        assert main([*words, "--cameras", str(source if link else given), *more]) == 2
        error = capsys.readouterr().err
        assert f"{given} would replace the list of cameras: choose another folder (-o)" in error
        assert given.read_bytes() == before and [*out.iterdir()] == [given]


def listed(folder: Path) -> Path:
    """A transforms.json of one camera, with a key of another program's."""
    path = folder / "transforms.json"
    frame = {"transform_matrix": GL, "file_path": "r_0"}
    sizes = {"w": 8, "h": 6, "aabb_scale": 4}
    path.write_text(json.dumps({"camera_angle_x": 0.7, **sizes, "frames": [frame]}))
    return path


def test_display_copies_follow_picture_and_exposure(tmp_path: Path, cornell: vr.Scene) -> None:
    small: dict[str, Any] = {"spp": 1, "width": 8, "height": 8, "device": "cpu"}
    copy = tmp_path / "0000.png"

    def is_of(exposure: float) -> bool:
        picture = vr.Render.load(tmp_path / "0000.exr").image
        shown = np.asarray(Image.open(copy).convert("RGB"))
        return np.array_equal(shown, to_srgb8(picture, exposure))

    vr.dataset(cornell, tmp_path, **small, png=True)
    film = (tmp_path / "0000.exr").stat().st_mtime_ns
    for exposure in (3.0, 3.0000001, -1.0, 0.0):
        vr.dataset(cornell, tmp_path, **small, png=True, exposure=exposure)
        assert is_of(exposure) and (tmp_path / "0000.exr").stat().st_mtime_ns == film
    made = copy.stat().st_mtime_ns
    vr.dataset(cornell, tmp_path, **small, png=True)
    assert copy.stat().st_mtime_ns == made
    vr.dataset(cornell, tmp_path, **small | {"spp": 4}, again=True)
    vr.dataset(cornell, tmp_path, **small | {"spp": 4}, png=True)
    assert is_of(0.0)
