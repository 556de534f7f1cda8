"""`ellipsoids` and `ellipsoidsmesh`: their meshes, what is read and what is refused."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest

import veriray
from veriray import SceneError, SceneWarning
from veriray.formats import ellipsoids

RNG = np.random.default_rng(7)
CENTERS = RNG.uniform(-2, 2, (5, 3))
SCALES = RNG.uniform(0.1, 0.5, (5, 3))
TURNS = RNG.normal(size=(5, 4))
TURNS /= np.linalg.norm(TURNS, axis=1)[:, None]
OPACITIES = np.array([[0.005], [0.02], [0.3], [0.5], [1.0]])
ARRAYS = {"centers": CENTERS, "scales": SCALES, "quaternions": TURNS}
VIEW = {"type": "perspective", "film": {"type": "hdrfilm", "width": 4, "height": 4}}


def scene(kind: str = "ellipsoids", **values: Any) -> veriray.Scene:
    shape = {"type": kind, **{k: v for k, v in values.items() if v is not None}}
    return veriray.load_dict(
        {"type": "scene", "view": VIEW, "shape": shape, "sky": {"type": "constant"}}
    )


def local(found: veriray.Scene, k: int, count: int) -> np.ndarray:
    """The vertices of ellipsoid k of `count` in units of its scales."""
    return local_of(found.vertices.reshape(count, -1, 3)[k] - CENTERS[k], k)


def test_corners_are_on_the_ellipsoids() -> None:
    found = scene(**ARRAYS)
    normals = found.normals.reshape(5, -1, 3)
    for k in range(5):
        points = local(found, k, 5)
        assert np.abs(np.linalg.norm(points, axis=1) - 3).max() < 1e-9
        own = found.vertices.reshape(5, -1, 3)[k] - CENTERS[k]
        assert (np.einsum("ij,ij->i", own, normals[k]) > 0).all()
        step = 1e-6 * np.cross(normals[k], [0.3, -0.5, 0.8])
        assert np.abs(np.linalg.norm(points, axis=1)
                      - np.linalg.norm(local_of(own + step, k), axis=1)).max() < 1e-9  # fmt: skip
    triangles = found.vertices[found.triangles]
    faces = np.cross(triangles[:, 1] - triangles[:, 0], triangles[:, 2] - triangles[:, 0])
    centers = np.repeat(CENTERS, len(triangles) // 5, axis=0)
    assert (np.einsum("ij,ij->i", faces, triangles.mean(axis=1) - centers) > 0).all()
    assert any("5 ellipsoids rendered as meshes of 81920 triangles" in n for n in found.notes)


def local_of(own: np.ndarray, k: int) -> np.ndarray:
    x, y, z, w = TURNS[k]
    turn = np.array([
        [1 - 2 * (y * y + z * z), 2 * (x * y - z * w), 2 * (x * z + y * w)],
        [2 * (x * y + z * w), 1 - 2 * (x * x + z * z), 2 * (y * z - x * w)],
        [2 * (x * z - y * w), 2 * (y * z + x * w), 1 - 2 * (x * x + y * y)],
    ])  # fmt: skip
    return np.asarray(own @ turn / SCALES[k])


@pytest.mark.parametrize("level", ellipsoids.LEVELS)
def test_depth_of_the_faces(level: int) -> None:
    points, faces = ellipsoids.icosphere(level)
    assert len(faces) == 20 * 4**level and len(points) == len(faces) // 2 + 2
    a, b, c = (points[faces[:, k]] for k in range(3))
    normals = np.cross(b - a, c - a)
    depth = 1 - (normals * a).sum(axis=1) / np.linalg.norm(normals, axis=1)
    assert 0.9 * ellipsoids.DEPTHS[level] < depth.max() <= ellipsoids.DEPTHS[level]


@pytest.mark.parametrize(
    ("shell", "corners", "faces", "low", "high"),
    [
        ("box", 8, 12, 0.904534, 1.566699),
        ("ico_sphere", 12, 20, 1.0, 1.258409),
        ("uv_sphere", 38, 72, 0.986286, 1.103598),
    ],
)
def test_shells(shell: str, corners: int, faces: int, low: float, high: float) -> None:
    """Radii of Mitsuba's."""
    found = scene("ellipsoidsmesh", **ARRAYS, extent=1.0, shell=shell)
    assert len(found.triangles) == 5 * faces and len(found.vertices) == 5 * corners
    assert not found.normals.any() and not found.notes
    points = local(found, 2, 5)
    assert abs(np.linalg.norm(points, axis=1).max() - high) < 2e-5
    a, b, c = (points[found.triangles[:faces, k]] for k in range(3))
    normals = np.cross(b - a, c - a)
    assert abs((normals * a).sum(axis=1) / np.linalg.norm(normals, axis=1)).min() > low - 2e-5


def test_adaptive_clamping() -> None:
    found = scene("ellipsoidsmesh", **ARRAYS, opacities=OPACITIES, extent_adaptive_clamping=True)
    assert len(found.triangles) == 4 * 20
    assert any("1 of 5 ellipsoids are left out" in note for note in found.notes)
    for k in range(1, 5):
        own = found.vertices.reshape(4, -1, 3)[k - 1] - CENTERS[k]
        extent = np.linalg.norm(local_of(own, k), axis=1).mean() / 1.2584085722
        assert abs(extent - np.sqrt(2 * np.log(OPACITIES[k, 0] / 0.01))) < 1e-6


@pytest.mark.parametrize("kind", ["ellipsoids", "ellipsoidsmesh"])
def test_all_left_out(kind: str) -> None:
    found = scene(kind, **ARRAYS, opacities=0 * OPACITIES, extent_adaptive_clamping=True)
    assert not len(found.triangles)
    assert any("5 of 5 ellipsoids are left out, by their opacity" in note for note in found.notes)
    assert not any("0 ellipsoids" in note for note in found.notes)


def test_opacities_of_a_file_are_checked(tmp_path: Path) -> None:
    gaussians(tmp_path / "a.ply")
    data = (tmp_path / "a.ply").read_bytes()
    start = data.index(b"end_header\n") + 11 + 4 * 9  # after the centre, normal and colour
    bad = data[:start] + np.float32(np.nan).tobytes() + data[start + 4 :]
    (tmp_path / "a.ply").write_bytes(bad)
    with pytest.raises(SceneError, match=r"a\.ply.*opacity 0 is nan; expected a finite number"):
        scene("ellipsoidsmesh", filename=str(tmp_path / "a.ply"))


def gaussians(path: Path, text: bool = False) -> None:
    """A file like those of 3D Gaussians."""
    opacity = np.clip(OPACITIES[:, 0], 0, 1 - 1e-6)
    columns = {
        **{name: CENTERS[:, k] for k, name in enumerate("xyz")},
        **{f"n{name}": 0 * CENTERS[:, 0] for name in "xyz"},
        **{f"f_dc_{k}": CENTERS[:, 0] for k in range(3)},
        "opacity": np.log(opacity / (1 - opacity)),
        **{f"scale_{k}": np.log(SCALES[:, k]) for k in range(3)},
        **{f"rot_{k}": 1.7 * TURNS[:, (3, 0, 1, 2)[k]] for k in range(4)},
    }
    form = "ascii" if text else "binary_little_endian"
    head = f"ply\nformat {form} 1.0\nelement vertex 5\n"
    head += "".join(f"property float {name}\n" for name in columns) + "end_header\n"
    rows = np.stack(list(columns.values()), axis=1)
    body = "".join(" ".join(map(repr, row)) + "\n" for row in rows.tolist()).encode()
    path.write_bytes(head.encode() + (body if text else rows.astype("<f4").tobytes()))


@pytest.mark.parametrize("text", [False, True])
def test_files_of_gaussians(tmp_path: Path, text: bool) -> None:
    gaussians(tmp_path / "a.ply", text)
    name = str(tmp_path / "a.ply")
    whole = scene("ellipsoidsmesh", **ARRAYS)
    found = scene("ellipsoidsmesh", filename=name)
    assert np.abs(found.vertices - whole.vertices).max() < 1e-6
    half = scene("ellipsoidsmesh", filename=name, scale_factor=0.5)
    assert (
        np.abs(half.vertices - scene("ellipsoidsmesh", **ARRAYS, extent=1.5).vertices).max() < 1e-6
    )
    seen = scene("ellipsoidsmesh", filename=name, extent_adaptive_clamping=True)
    assert len(seen.triangles) == 4 * 20
    moved = np.diag([2.0, 2, 2, 1])
    moved[:3, 3] = 1, 2, 3
    placed = scene("ellipsoidsmesh", filename=name, to_world=moved)
    assert np.abs(placed.vertices - (2 * found.vertices + [1, 2, 3])).max() < 1e-9
    with pytest.warns(SceneWarning, match="Mitsuba scales its ellipsoids by the mean"):
        scene("ellipsoidsmesh", filename=name, to_world=np.diag([1.0, 2, 1, 1]))


def test_data_is_the_arrays_side_by_side() -> None:
    data = np.concatenate([CENTERS, SCALES, TURNS], axis=1)
    whole = scene(**ARRAYS)
    assert scene(data=data).sha256 == scene(data=data.ravel()).sha256 == whole.sha256
    assert scene(**ARRAYS, opacities=OPACITIES, sh_coeffs=np.zeros((5, 3))).sha256 == whole.sha256


def test_they_have_bsdfs_and_shine() -> None:
    lamp = {"type": "area", "radiance": 2.0}
    found = scene(**ARRAYS, emitter=lamp, bsdf={"type": "conductor"})
    assert (found.triangle_emission == 0).all() and found.emissions.tolist() == [[2.0] * 3]
    assert np.isfinite(veriray.render(found, 2, device="cpu").image).all()


@pytest.mark.parametrize(
    ("values", "words"),
    [
        ({}, "no ellipsoids given; expected one of filename, data and centers"),
        ({**ARRAYS, "data": np.zeros((1, 10))}, "data and centers given"),
        ({"centers": CENTERS}, '"scales" is missing'),
        ({**ARRAYS, "scales": SCALES[:4]}, "5, 4, 5 rows of centers, scales and quaternions"),
        ({**ARRAYS, "scales": SCALES[:, :2]}, r'"scales" is of shape \(5, 2\)'),
        ({**ARRAYS, "scales": 0 * SCALES}, "ellipsoid 0 has the center .*scales above 0"),
        ({**ARRAYS, "quaternions": 2 * TURNS}, "quaternion 0, .* is not of length 1"),
        ({**ARRAYS, "centers": CENTERS * np.nan}, "ellipsoid 0 has the center"),
        ({**ARRAYS, "extent_adaptive_clamping": True}, "clamping without opacities"),
        ({**ARRAYS, "opacities": OPACITIES[:2]}, "2 opacities of 5 ellipsoids"),
        ({**ARRAYS, "opacities": OPACITIES * np.nan}, "opacity 0 is nan; expected a finite number"),
        ({**ARRAYS, "opacities": [[1], [1], [-1], [1], [1]]}, "opacity 2 is -1; expected"),
        ({**ARRAYS, "opacities": [[1], [np.inf], [1], [1], [1]]}, "opacity 1 is inf; expected"),
        ({**ARRAYS, "scale_factor": 2.0}, "scale_factor is of files alone"),
        ({**ARRAYS, "extent": 0.0}, '"extent" = 0.0 is outside'),
        ({**ARRAYS, "shell": "box"}, 'unknown parameter "shell"'),
        ({"data": np.zeros((0, 10))}, "holds no ellipsoids"),
        ({"filename": "no.ply"}, "cannot read"),
    ],
)
def test_what_is_refused(values: dict[str, Any], words: str) -> None:
    with pytest.raises(SceneError, match=words):
        scene(**values)


def test_a_mesh_file_is_no_gaussians(tmp_path: Path) -> None:
    (tmp_path / "a.ply").write_text(
        "ply\nformat ascii 1.0\nelement vertex 1\nproperty float x\nproperty float y\n"
        "property float z\nend_header\n0 0 0\n"
    )
    with pytest.raises(SceneError, match="holds no Gaussians: its vertices have no scale_0"):
        scene(filename=str(tmp_path / "a.ply"))


def test_too_many_are_refused(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(ellipsoids, "FEW", 20 * 4**2 * 5)
    assert len(scene(**ARRAYS).triangles) == 20 * 4**2 * 5
    monkeypatch.setattr(ellipsoids, "MANY", 1000)
    with pytest.raises(SceneError, match="5 ellipsoids are 1600 triangles; at most 1000"):
        scene(**ARRAYS)
