"""Textures in space: `volume` of a `gridvolume` on surfaces."""

import math
import struct
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import veriray as vr
from veriray import SceneError

Dict = dict[str, Any]
RNG = np.random.default_rng(5)
GREY = RNG.random((3, 4, 5, 1)).astype(np.float32)  # (Z, Y, X, channels)
COLOURS = RNG.random((4, 2, 3, 3)).astype(np.float32)


def volume(cells: Any, **more: Any) -> Dict:
    return {"type": "volume", "v": {"type": "gridvolume", "data": cells, **more}}


def seen(bsdf: Dict, size: int = 12, **shape: Any) -> vr.Scene:
    """A shape from above under an even sky of 1, which a matt surface shows as its reflectance."""
    turn = vr.transform.look_at([0, 0, 5], [0, 0, 0], [0, 1, 0])
    film = {"type": "hdrfilm", "width": size, "height": size, "rfilter": {"type": "box"}}
    return vr.load_dict({
        "type": "scene", "integrator": {"type": "path", "max_depth": 2},
        "sky": {"type": "constant"}, "camera": {"type": "orthographic", "to_world": turn,
                                                "film": film},
        "shape": {"type": "rectangle", "bsdf": bsdf, **shape},
    })  # fmt: skip


def interpolated(cells: np.ndarray, at: np.ndarray, wrap: str, nearest: bool) -> np.ndarray:
    """Cells (Z, Y, X, C) at points (N, 3) of the unit cube, in float64."""
    total = np.zeros((len(at), cells.shape[3]))
    for corner in np.ndindex(2, 2, 2):
        weight, index = np.ones(len(at)), []
        for axis in range(3):
            n = cells.shape[2 - axis]
            x = at[:, axis]
            if wrap == "repeat":
                x = x - np.floor(x)
            elif wrap == "mirror":
                x = 1 - np.abs((x / 2 - np.floor(x / 2)) * 2 - 1)
            x = np.clip(x, 0, 1) * n
            below = np.floor(x if nearest else x - 0.5)
            share = np.zeros(len(at)) if nearest else x - 0.5 - below
            weight = weight * (share if corner[axis] else 1 - share)
            place = below + corner[axis]
            index.append((place % n if wrap == "repeat" else np.clip(place, 0, n - 1)).astype(int))
        total += weight[:, None] * cells[index[2], index[1], index[0]]
    return total


@pytest.mark.parametrize("wrap", ["clamp", "repeat", "mirror"])
@pytest.mark.parametrize("nearest", [False, True], ids=["trilinear", "nearest"])
@pytest.mark.parametrize("cells", [GREY, COLOURS], ids=["grey", "colours"])
def test_a_plane_shows_a_cut_through_the_grid(
    cells: np.ndarray, nearest: bool, wrap: str, device: str
) -> None:
    """Each sample's value against interpolation in float64 at its place; a turned grid."""
    to_world = vr.transform.compose(
        vr.transform.translate([-0.4, -0.7, -0.3]),
        vr.transform.compose(
            vr.transform.rotate([0, 0, 1], 20), vr.transform.scale([0.9, 1.3, 0.7])
        ),
    )
    texture = volume(cells, wrap_mode=wrap, to_world=to_world,
                     filter_type="nearest" if nearest else "trilinear")  # fmt: skip
    scene = seen({"type": "diffuse", "reflectance": texture}, to_world=np.diag([1, 1, 1, 1.0]))
    image = vr.render(scene, 64, device=device, sampler="independent").image
    fine = 64
    steps = (np.arange(12 * fine) + 0.5) / (12 * fine) * 2 - 1
    x, y = np.meshgrid(steps, -steps)
    points = np.stack([x.ravel(), y.ravel(), 0 * x.ravel(), 1 + 0 * x.ravel()], 1)
    local = (points @ np.linalg.inv(to_world).T)[:, :3]
    exact = interpolated(cells.astype(np.float64), local, wrap, nearest)
    exact = exact.reshape(12, fine, 12, fine, -1)
    spread = exact.std(axis=(1, 3))
    wanted = exact.mean(axis=(1, 3))
    assert (np.abs(image - wanted) <= 6 * spread / 8 + 3e-3).all()
    assert np.abs(image - wanted).mean() < (0.03 if nearest else 0.011)


def test_each_shape_reads_it_where_it_is(device: str) -> None:
    """A grid of two cells along z: a ramp between their centres on every kind of shape, flat or in
    a tree, at any scale."""
    ramp = np.array([0.0, 1.0]).reshape(2, 1, 1, 1)
    to_world = vr.transform.compose(
        vr.transform.translate([0, 0, -2.0]), vr.transform.scale([1, 1, 4])
    )
    bsdf = {"type": "diffuse", "reflectance": volume(ramp, to_world=to_world)}
    at = vr.transform.translate([0.0, 0.0, 0.3])
    for shape, z in (
        ({"type": "rectangle", "to_world": at}, 0.3), ({"type": "disk", "to_world": at}, 0.3),
        ({"type": "cube", "to_world": vr.transform.scale([1, 1, 0.4])}, 0.4),
    ):  # fmt: skip
        image = vr.render(seen(bsdf, 2, **shape), 16, device=device).image
        wide = vr.transform.scale([0.1, 0.1, 1])
        scene = seen(bsdf, 2, **shape)
        scene = scene.with_(camera=vr.Camera.orthographic(
            vr.transform.compose(scene.camera.to_world, wide)))  # fmt: skip
        image = vr.render(scene, 16, device=device).image
        np.testing.assert_allclose(image, 0.5 + z / 2, rtol=2e-6)
        again = vr.render(scene.scaled(2.0**-12), 16, device=device).image
        assert (again == image).all()
    ball = seen(bsdf, 9, type="sphere", to_world=vr.transform.scale([0.8, 0.8, 0.8]))
    centre = vr.render(ball, 4096, device=device).image[4, 4, 0]
    # the mean of z over the middle ninth of the film's width, to its fourth order
    assert centre == pytest.approx(0.5 + 0.4 * (1 - (1 / 9) ** 2 / 0.64 / 3), abs=2e-4)
    tube = {"type": "cylinder", "p0": [-1, 0, 0], "p1": [1, 0, 0], "radius": 0.5}
    image = vr.render(seen(bsdf, 9, **tube), 4096, device=device).image
    assert image[4, 4, 0] == pytest.approx(0.5 + 0.25 * (1 - (1 / 9) ** 2 / 0.25 / 6), abs=1e-3)


def test_a_lamp_shines_by_it(device: str) -> None:
    """All of the sky is seen through a lamp of 3 and 5 in halves; numbers above 1."""
    cells = np.array([3.0, 5.0]).reshape(1, 1, 2, 1)
    lamp = {"type": "area", "radiance": volume(cells, filter_type="nearest",
            to_world=vr.transform.compose(vr.transform.translate([-1, -1, -1]),
                                          vr.transform.scale([2, 2, 2])))}  # fmt: skip
    scene = seen({"type": "diffuse", "reflectance": 0.0}, 2, emitter=lamp)
    image = vr.render(scene, 16, device=device).image
    assert image[:, 0, 0].tolist() == [3, 3] and image[:, 1, 0].tolist() == [5, 5]
    up = vr.transform.translate([0, 0, 2])
    floor = {"type": "rectangle", "bsdf": {"type": "diffuse", "reflectance": 1.0},
             "m": {"type": "irradiancemeter", "film": {"type": "hdrfilm", "width": 1, "height": 1,
                                                       "rfilter": {"type": "box"}}}}  # fmt: skip
    above = {"type": "rectangle", "to_world": up, "flip_normals": True, "emitter": lamp}
    parts = {"type": "scene", "floor": floor, "lamp": above}
    found = vr.render(vr.load_dict(parts), 1 << 18, device=device)
    error = float(found.stderr[0, 0, 0])
    assert abs(found.image[0, 0, 0] - 4 * math.pi * 0.1998249) < 5 * error < 0.1


def test_files_and_boxes(tmp_path: Path) -> None:
    z, y, x, c = COLOURS.shape
    data = struct.pack("<3sB5i6f", b"VOL", 3, 1, x, y, z, c, -1, -2, -3, 1, 2, 3)
    (tmp_path / "a.vol").write_bytes(data + COLOURS.tobytes())
    of_file = {"type": "volume", "v": {"type": "gridvolume", "filename": str(tmp_path / "a.vol"),
                                       "use_grid_bbox": True}}  # fmt: skip
    made = seen({"type": "diffuse", "reflectance": of_file})
    box = vr.transform.compose(vr.transform.translate([-1, -2, -3]), vr.transform.scale([2, 4, 6]))
    same = seen({"type": "diffuse", "reflectance": volume(COLOURS, to_world=box)})
    assert made.sha256 == same.sha256
    assert made.texture_to_world[0].tolist() == box[:3].tolist()
    assert (made.texture_width[0], made.texture_height[0], made.texture_depth[0]) == (x, y, z)


@pytest.mark.parametrize(("texture", "message"), [
    (volume(np.zeros((2, 2, 2, 2))), "2 numbers a cell; a texture takes 1 or 3"),
    ({"type": "volume"}, "volume"),
    (volume(GREY, to_world=np.diag([1.0, 1, 0, 1])), "to_world"),
])  # fmt: skip
def test_what_is_refused(texture: Dict, message: str) -> None:
    with pytest.raises(SceneError, match=message):
        seen({"type": "diffuse", "reflectance": texture})


def test_numbers_out_of_range() -> None:
    with pytest.warns(vr.SceneWarning, match="the grid holds 1 numbers above 1, up to 2"):
        bright = seen({"type": "diffuse", "reflectance": volume(np.array([[[0.5, 2.0]]]))})
    assert bright.texels.view(np.float32).tolist() == [0.5, 1.0]
    rough = {"type": "roughconductor", "alpha": volume(np.array([[[0.5, 2.0]]]))}
    assert seen(rough).texels.view(np.float32).tolist() == [0.5, 2.0]
    with pytest.raises(SceneError, match="texture_format"):
        bright._with_arrays(texture_format=np.zeros(1, np.uint32))
