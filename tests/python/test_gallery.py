"""The gallery: its meshes and scenes, and what the command does with files."""

from __future__ import annotations

import contextlib
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest
import trimesh
from PIL import Image

import veriray
from veriray import gallery, image
from veriray.cli import main
from veriray.columns import MATERIAL_KINDS
from veriray.gallery import meshes, pictures, sheet, spheres
from veriray.gallery.own import is_foreign

SMALL = {"scale": 0.05, "spp": 2, "device": "cpu"}


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Where generated meshes go."""
    return tmp_path_factory.mktemp("gallery")


def solid(mesh: meshes.Mesh) -> trimesh.Trimesh:
    vertices, _, triangles = mesh
    return trimesh.Trimesh(vertices.astype(np.float32), triangles, process=False)


@pytest.mark.parametrize(("name", "least"), [("hare", 50_000), ("knot", 50_000)])
def test_generated_solids_are_closed_manifolds(name: str, least: int) -> None:
    mesh = meshes.MAKERS[name]()
    made = solid(mesh)
    assert len(made.faces) >= least
    assert made.is_watertight and made.is_winding_consistent and made.volume > 0.5
    assert made.body_count == 1
    assert made.euler_number == {"hare": 2, "knot": 0}[name]
    assert made.area_faces.min() > 1e-8
    assert np.abs(np.linalg.norm(mesh[1], axis=1) - 1).max() < 1e-6
    normals = mesh[1][made.faces]
    assert (normals * made.face_normals[:, None]).sum(axis=2).min() > 0.5


@pytest.mark.parametrize("name", list(meshes.MAKERS))
def test_generated_meshes_are_the_same_every_time(name: str, folder: Path) -> None:
    for copy in "ab":
        meshes.write_ply(folder / f"{name}_{copy}.ply", meshes.MAKERS[name]())
    first = (folder / f"{name}_a.ply").read_bytes()
    assert first == (folder / f"{name}_b.ply").read_bytes()
    loaded = trimesh.load(folder / f"{name}_a.ply", process=False)
    assert np.isfinite(loaded.vertices).all() and len(loaded.faces) > 0


def test_hare_is_on_the_field_and_on_the_ground() -> None:
    vertices, _, _ = meshes.hare(cells=30)
    assert np.abs(meshes.hare_distance(vertices)).max() < 1e-4
    assert abs(vertices[:, 1].min()) < 1e-4 and 2.2 < vertices[:, 1].max() < 2.3


def test_backdrop_faces_the_camera() -> None:
    vertices, normals, triangles = meshes.sweep()
    corners = vertices[triangles]
    face = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    assert (face * normals[triangles[:, 0]]).sum(axis=1).min() > 0
    assert normals[0].tolist() == [0, 1, 0] and normals[-1].tolist() == [0, 0, -1]


def test_users_mesh_stands_and_must_be_closed(folder: Path) -> None:
    ball = trimesh.creation.icosphere(2, radius=7).apply_translation([3, 4, 5])
    ball.export(folder / "ball.ply")
    made = solid(meshes.standing(folder / "ball.ply"))
    assert made.is_watertight and made.volume > 0
    assert np.allclose(made.bounds[:, 1], [0, 2.25], atol=1e-5)
    assert np.allclose(made.bounds.mean(axis=0)[[0, 2]], 0, atol=1e-5)
    ball.update_faces(np.arange(len(ball.faces)) > 0)
    ball.export(folder / "open.ply")
    with pytest.raises(veriray.SceneError, match="not a closed mesh"):
        meshes.standing(folder / "open.ply")
    with pytest.raises(veriray.SceneError, match="not a file"):
        meshes.standing(folder / "none.ply")


def test_300_spheres_do_not_touch() -> None:
    placed = np.array(spheres.place(300, 2016))
    assert len(placed) == 300 and (placed[:, 1] > placed[:, 3]).all()
    gap = np.linalg.norm(placed[:, None, :3] - placed[None, :, :3], axis=-1)
    gap -= placed[:, None, 3] + placed[None, :, 3]
    assert gap[~np.eye(300, dtype=bool)].min() > 0.01
    assert spheres.scene_text() == spheres.scene_text()
    assert spheres.scene_text(seed=1) != spheres.scene_text(seed=2)


def test_medium_of_the_reports_coefficients() -> None:
    values = pictures.medium(4, (0.5, 1, 0))
    total = np.array([float(x) for x in values["sigma_t"].split(",")]) * float(values["scale"])
    albedo = np.array([float(x) for x in values["albedo"].split(",")])
    assert np.allclose(total, [4.5, 5, 4]) and np.allclose(albedo * total, 4)
    assert np.allclose((1 - albedo) * total, [0.5, 1, 0])


def test_names() -> None:
    assert {p.figure for p in pictures.PICTURES} == {0, 1, 3, 4, 5, 6, 7, 8}
    assert [p.name for p in pictures.select(["fig5"])] == [
        f"subsurface-{k}" for k in (64, 16, 4, 1)
    ]
    assert pictures.select([]) == list(pictures.PICTURES)
    assert [p.name for p in pictures.select(["room", "studio"])] == ["studio", "room"]
    for bad in ("fig2", "bunny", ""):
        with pytest.raises(ValueError, match="studio"):
            pictures.select([bad])


@pytest.mark.parametrize("name", gallery.names())
def test_every_scene_loads(name: str, folder: Path) -> None:
    scene = gallery.load(name, folder)
    assert scene.sha256 == gallery.load(name, folder).sha256
    assert len(scene.spheres) == (300 if name == "spheres-300" else len(scene.spheres))
    if name.startswith("subsurface"):
        assert scene.max_depth == -1 and len(scene.triangles) >= 50_000
    if name in ("studio", "room"):
        assert scene.max_depth == 40 and scene.camera.aperture_radius > 0


@pytest.mark.parametrize("name", [name for name in gallery.names() if name != "terrace"])
def test_mitsuba_loads_the_same_files(name: str, folder: Path) -> None:
    mitsuba = pytest.importorskip("mitsuba", reason="the peer renderer: pip install mitsuba")
    mitsuba.set_variant("scalar_rgb")
    gallery.load(name, folder)
    (picture,) = pictures.select([name])
    file = pictures.find(picture.file) if picture.file else folder / f"{name}.xml"
    values = picture.values | {m: str(folder / f"{m}.ply") for m in picture.meshes}
    values |= {Path(m).stem: str(folder / m) for m in picture.maps}
    assert mitsuba.load_file(str(file), **values).shapes()


def test_the_terrace_is_a_model_under_a_sky(tmp_path: Path) -> None:
    """A GLB file that others read, its materials, and the sky of `sunsky` above its own up."""
    scene = gallery.load("terrace", tmp_path)
    model = trimesh.load(tmp_path / "terrace.glb")
    faces = sum(len(mesh.faces) for mesh in model.geometry.values())
    assert faces == len(scene.triangles) > 100_000
    kinds = {MATERIAL_KINDS[k] for k in scene.material_kind}
    assert kinds == {"principled", "principled_open"} and len(scene.texture_kind) == 1
    assert scene.sky_size.tolist() == [2048, 1025] and not scene.environment.any()
    assert (scene.sky_to_world @ [0.0, 1.0, 0.0] == [0.0, 1.0, 0.0]).all()


def test_run_resumes_by_file(tmp_path: Path) -> None:
    def again(**settings: object) -> tuple[list[str], list[str]]:
        titles: list[str] = []

        @contextlib.contextmanager
        def show(title: str) -> Iterator[None]:
            titles.append(title)
            yield

        lines: list[str] = []
        done = ["spheres", "spheres-300"]
        gallery.run(done, tmp_path, show=show, say=lines.append, **{**SMALL, **settings})
        return titles, lines

    titles, _ = again()
    assert len(titles) == 2 and titles[0].startswith("picture 1 of 2 (0 %")
    names = {path.name for path in tmp_path.rglob("*") if path.is_file()}
    wanted = "spheres.exr spheres.png spheres-300.exr spheres-300.png gallery.md gallery.png"
    assert set(wanted.split()) | {"spheres.jpg", "spheres-300.jpg"} <= names
    assert not [name for name in names if "tmp" in name]
    before = (tmp_path / "spheres.exr").read_bytes()

    titles, lines = again()
    assert not titles and lines[0] == "picture 1 of 2: spheres exists"
    (tmp_path / "spheres.exr").write_bytes(before[:5000])
    (tmp_path / "spheres-300.png").unlink()
    titles, _ = again()
    assert len(titles) == 1 and (tmp_path / "spheres-300.png").is_file()
    assert len(again(seed=1)[0]) == 2
    assert len(again(spp=3, seed=1)[0]) == 2
    assert len(again(width=70, spp=3, seed=1)[0]) == 2
    assert image.load(tmp_path / "spheres.exr").width == 70
    assert len(again(width=70, spp=3, seed=1, force=True)[0]) == 2


def test_files_of_others_are_not_replaced(tmp_path: Path) -> None:
    """Found before anything is rendered; --force replaces them, and later runs may do so too."""
    folder, docs = tmp_path / "gallery", tmp_path / "docs"
    (docs / "images").mkdir(parents=True)
    folder.mkdir()
    settings = {**SMALL, "docs": docs}
    names = ["spheres-300", "room"]
    places = ["spheres-300.exr", "spheres-300.png", "spheres-300.xml", "room.exr", "hare.ply"]
    taken = [*(folder / name for name in places), docs / "gallery.md",
             docs / "images" / "gallery.png", docs / "images" / "room.jpg"]  # fmt: skip
    for path in taken:
        path.write_text("mine")
        titles: list[str] = []
        with pytest.raises(FileExistsError, match="was not made by the gallery; --force") as caught:
            gallery.run(names, folder, show=titles.append, **settings)  # type: ignore[arg-type]
        assert caught.value.filename == str(path) and path.read_text() == "mine" and not titles
        path.unlink()
    for path in taken:
        path.write_text("mine")
    assert main(["gallery", "spheres-300", "-o", str(folder), "--docs", str(docs)]) == 2
    assert all(path.read_text() == "mine" for path in taken)
    gallery.run(names, folder, **settings, force=True)
    gallery.run(names, folder, **{**settings, "spp": 3})
    assert image.load(folder / "spheres-300.exr").spp == 3
    own = image.load(folder / "spheres-300.exr")
    del own.stats["origin"]
    own.save(folder / "spheres-300.exr")  # as `veriray render` would have made it
    gallery.run(names, folder, **{**settings, "spp": 3})
    with pytest.raises(FileExistsError, match="spheres-300.exr"):
        gallery.run(names, folder, **settings)


def test_sheet_from_pngs_alone(tmp_path: Path) -> None:
    gallery.run(["spheres", "cornell"], tmp_path / "all", **SMALL)
    for file in (tmp_path / "all").glob("*.png"):
        (tmp_path / "png").mkdir(exist_ok=True)
        (tmp_path / "png" / file.name).write_bytes(file.read_bytes())
    lines: list[str] = []
    made = gallery.run(
        output=tmp_path / "png", sheet_only=True, docs=tmp_path / "docs", say=lines.append
    )
    assert {path.name for path in made} == {"gallery.md", "gallery.png", "spheres.jpg",
                                            "cornell.jpg"}  # fmt: skip
    text = (tmp_path / "docs" / "gallery.md").read_text("utf-8")
    render = image.load(tmp_path / "all" / "spheres.exr")
    assert f"`{render.film_sha256[:16]}`" in text and "## correlated-seeds" in text
    assert "(images/spheres.jpg)" in text and "Figure 7" in text and "| 2 |" in text
    assert Image.open(tmp_path / "docs" / "images" / "gallery.png").width == sheet.SHEET_WIDTH
    assert gallery.run(output=tmp_path / "docs", sheet_only=True, say=lines.append) == []
    assert "no pictures" in lines[-1]


def test_cornell_stands_beside_its_reference(
    root: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(root)
    if pictures.find(gallery.REFERENCE) is None:
        pytest.skip(f"{gallery.REFERENCE}, the reference's picture, is not there")
    lines: list[str] = []
    gallery.run(["cornell"], tmp_path, spp=64, device="cpu", say=lines.append)
    assert any(line.startswith("compare    ") for line in lines)
    assert not is_foreign(tmp_path / "cornell-report.html")
    assert Image.open(tmp_path / "cornell.png").size == (3 * 512, 512)
    assert "agree" in (tmp_path / "gallery.md").read_text("utf-8")


def test_bad_settings(tmp_path: Path) -> None:
    for settings in ({"scale": 0.0}, {"scale": 17.0}, {"width": 0}, {"spp": 0}):
        with pytest.raises(ValueError):
            gallery.run(["cornell"], tmp_path, **settings)
    with pytest.raises(ValueError, match="bunny"):
        gallery.run(["bunny"], tmp_path)
    (tmp_path / "file").write_text("")
    with pytest.raises(OSError):
        gallery.run(["cornell"], tmp_path / "file", **SMALL)
