"""Grids of numbers in space: files, arrays, media that read them."""

from __future__ import annotations

import struct
from pathlib import Path

import numpy as np
import pytest

import veriray
from veriray import SceneError, transform
from veriray.formats import volume_grid


def vol(cells: np.ndarray, box=(0, 0, 0, 1, 1, 1), version=3, encoding=1) -> bytes:
    z, y, x, channels = cells.shape
    head = struct.pack("<3sB5i6f", b"VOL", version, encoding, x, y, z, channels, *box)
    return head + cells.astype("<f4").tobytes()


CELLS = np.arange(2 * 3 * 4 * 3, dtype=np.float32).reshape(2, 3, 4, 3) / 72


def test_file_gives_cells_and_box(tmp_path: Path):
    path = tmp_path / "a.vol"
    path.write_bytes(vol(CELLS, (-1, -2, -3, 4, 5, 6)) + b"more")
    cells, box = volume_grid.read_vol(path)
    assert cells.dtype == np.float32 and (cells == CELLS).all()
    assert box.tolist() == [[-1, -2, -3], [4, 5, 6]]


@pytest.mark.parametrize(
    ("data", "message"),
    [
        (b"VOL\x03", "no header"),
        (b"X" * 60, "no header"),
        (vol(CELLS, version=2), "version 2 and encoding 1; expected 3 and 1"),
        (vol(CELLS, encoding=3), "version 3 and encoding 3; expected 3 and 1"),
        (vol(CELLS)[:-1], "holds 335 bytes; 4 x 3 x 2 cells of 3 numbers take 336"),
        (vol(CELLS * np.nan), r"number 0 of cell \(x 0, y 0, z 0\) is nan"),
        (vol(CELLS, (0, 0, 0, np.inf, 1, 1)), "must be finite"),
        (vol(CELLS[:, :, :0]), "0 x 3 x 2 cells of 3 numbers"),
        (struct.pack("<3sB5i6f", b"VOL", 3, 1, *[2**15] * 3, 1, *[0] * 6), "numbers at most"),
        (struct.pack("<3sB5i6f", b"VOL", 3, 1, -1, 1, 1, 1, *[0] * 6), "-1 x 1 x 1 cells"),
    ],
)
def test_bad_files_are_named(tmp_path: Path, data: bytes, message: str):
    path = tmp_path / "a.vol"
    path.write_bytes(data)
    with pytest.raises(SceneError, match=message):
        volume_grid.read_vol(path, "s.xml:7")


def test_missing_file_is_named(tmp_path: Path):
    with pytest.raises(SceneError, match="cannot read .*none.vol.: No such file"):
        volume_grid.read_vol(tmp_path / "none.vol")


# ---- media ----


def scene(medium: dict, **parts) -> veriray.Scene:
    view = {"type": "perspective", "to_world": transform.look_at([0, 0, -5], [0, 0, 0], [0, 1, 0])}
    cube = {"type": "cube", "bsdf": {"type": "null"}, "interior": medium}
    return veriray.load_dict(
        {"type": "scene", "view": view, "cube": cube, "sky": {"type": "constant"}, **parts}
    )


def grid(cells, **more) -> dict:
    return {"type": "gridvolume", "data": cells, **more}


def test_albedo_by_a_grid_fills_its_columns():
    seen = scene({"type": "homogeneous", "sigma_t": 2.0, "albedo": grid(CELLS, wrap_mode="mirror")})
    assert seen.albedo.tolist() == [[1, 1, 1]] and seen.sigma_t.tolist() == [[2, 2, 2]]
    assert seen.albedo_grid.tolist() == [0] and seen.sigma_t_grid.tolist() == [-1]
    assert seen.grid_size.tolist() == [[4, 3, 2]] and not seen.grid_grey[0]
    assert (seen.cells == CELLS.ravel()).all()
    assert seen.grid_wrap.tolist() == [1] and seen.grid_filter.tolist() == [0]


def test_extinction_by_a_grid_is_shares_of_its_largest():
    cells = 3 * CELLS[..., 0]
    seen = scene({"type": "heterogeneous", "scale": 2.0, "sigma_t": grid(cells)})
    most = cells.max()
    assert seen.sigma_t.tolist() == [[np.float32(2 * float(most))] * 3]
    assert (seen.cells == (cells / most).ravel()).all() and seen.grid_grey[0]
    assert seen.albedo.tolist() == [[0.75] * 3]


def test_a_number_fills_the_unit_cube():
    seen = scene({"type": "heterogeneous", "sigma_t": 3.0})
    assert seen.sigma_t.tolist() == [[3, 3, 3]] and seen.cells.tolist() == [1]
    assert seen.grid_to_world[0].tolist() == np.eye(4)[:3].tolist()


def test_an_empty_grid_is_none():
    seen = scene({"type": "heterogeneous", "sigma_t": grid(np.zeros((2, 2, 2)))})
    assert seen.sigma_t_grid.tolist() == [-1] and not seen.sigma_t.any() and not len(seen.cells)


def test_box_of_the_file_and_to_world(tmp_path: Path):
    (tmp_path / "a.vol").write_bytes(vol(CELLS, (1, 2, 3, 2, 4, 6)))
    place = np.diag([10.0, 10, 10, 1])
    file = {"type": "gridvolume", "filename": str(tmp_path / "a.vol"), "to_world": place}
    seen = scene({"type": "homogeneous", "albedo": {**file, "use_grid_bbox": True}})
    expected = [[10, 0, 0, 10], [0, 20, 0, 20], [0, 0, 30, 30]]
    assert seen.grid_to_world[0].tolist() == expected
    seen = scene({"type": "homogeneous", "albedo": file})
    assert seen.grid_to_world[0].tolist() == place[:3].tolist()


def test_one_grid_in_two_media_is_stored_once():
    ink = {"type": "homogeneous", "id": "ink", "albedo": grid(CELLS)}
    ball = {"type": "sphere", "center": [3, 0, 0], "bsdf": {"type": "null"}}
    seen = scene(ink, ball={**ball, "interior": {"type": "ref", "id": "ink"}})
    assert len(seen.cells) == CELLS.size and len(seen.grid_size) == 1


def test_constvolume_is_a_number():
    value = {"type": "rgb", "value": [0.1, 0.2, 0.3]}
    medium = {"type": "homogeneous", "albedo": {"type": "constvolume", "value": value}}
    medium["sigma_t"] = {"type": "constvolume", "value": 2.0}
    seen = scene(medium)
    assert seen.sigma_t.tolist() == [[2, 2, 2]] and not len(seen.grid_size)
    assert np.allclose(seen.albedo, [[0.1, 0.2, 0.3]])


@pytest.mark.parametrize(
    ("medium", "message"),
    [
        ({"type": "homogeneous", "sigma_t": grid(CELLS)}, "heterogeneous takes a gridvolume"),
        ({"type": "homogeneous", "albedo": grid(2 * CELLS)}, r"cell \(x \d, y \d, z 1\) holds 1"),
        ({"type": "heterogeneous", "sigma_t": grid(CELLS - 1)}, "holds -1; sigma_t is at least 0"),
        ({"type": "heterogeneous", "sigma_t": grid(np.ones((1, 1, 1, 6)))}, "6 numbers a cell"),
        ({"type": "heterogeneous", "sigma_t": {"type": "gridvolume"}}, "no grid given"),
        ({"type": "heterogeneous", "sigma_t": grid(CELLS, grid=CELLS)}, "grid and data given"),
        ({"type": "heterogeneous", "density": grid(CELLS)}, 'named "density"; allowed'),
        ({"type": "heterogeneous", "sigma_t": grid([1.0])}, r"a grid of shape \(1,\)"),
        ({"type": "heterogeneous", "scale": 1.0, "density_scale": 1.0}, "both scale and density"),
        ({"type": "homogeneous", "albedo": {"type": "constvolume", "value": 2.0}}, "outside"),
        ({"type": "heterogeneous", "sigma_t": grid(CELLS, to_world=np.diag([1.0, 1, 0, 1]))},
         "flat"),
    ],
)  # fmt: skip
def test_bad_media_are_named(medium: dict, message: str):
    with pytest.raises(SceneError, match=message):
        scene(medium)


def test_too_dense_a_grid_is_named():
    seen = scene({"type": "heterogeneous", "scale": 1e6, "sigma_t": grid(CELLS)})
    with pytest.raises(
        SceneError, match=r"cube.interior.*sigma_t\[0\] .* is too dense for its grid"
    ):
        veriray.render(seen, spp=1, width=4, height=4, device="cpu")


def test_scaled_takes_grids_along():
    seen = scene({"type": "heterogeneous", "sigma_t": grid(CELLS)}).scaled(4.0)
    assert seen.grid_to_world[0].tolist() == (4 * np.eye(4)[:3]).tolist()
    assert seen.sigma_t[0, 0] == np.float32(CELLS.max()) / 4


def uneven() -> veriray.Scene:
    """Smoke coloured by a grid, in nested null boundaries, beside a matt ball under two lights."""
    rng = np.random.default_rng(5)
    place = np.diag([2.4, 2, 2, 1.0])
    place[:3, 3] = -1.1, -1, -1
    smoke = {
        "type": "heterogeneous",
        "scale": 6.0,
        "sigma_t": grid(rng.random((4, 3, 5, 3)) ** 2, to_world=place),
        "albedo": grid(rng.random((2, 3, 2, 3)), to_world=place, wrap_mode="repeat"),
    }
    ball = {"type": "sphere", "radius": 0.4, "bsdf": {"type": "null"}, "exterior": smoke}
    fog = {"type": "homogeneous", "albedo": grid(rng.random((2, 2, 2)), filter_type="nearest")}
    lamp = {"type": "point", "position": [2, 3, -2], "intensity": 9.0}
    return scene(smoke, ball={**ball, "interior": fog}, lamp=lamp)


def test_every_scheduler_gives_the_same_film():
    seen = uneven()
    films = {
        veriray.render(seen, spp=8, width=24, height=24, device="cpu", scheduler=name).film_sha256
        for name in ("fused", "thrust", "wavefront")
    }
    assert len(films) == 1


def test_film_does_not_depend_on_scale_or_cut():
    seen = uneven()
    first = veriray.render(seen, spp=8, width=24, height=24, device="cpu")
    other = veriray.render(seen.scaled(1024.0), spp=8, width=24, height=24, device="cpu", threads=1)
    point = veriray.render(seen.with_emission_scaled(4.0), spp=8, width=24, height=24, device="cpu")
    assert other.film_sha256 == first.film_sha256
    assert (point.image == 4 * first.image).all()
