"""Objects of Mitsuba as values of a dictionary, beside Mitsuba, and beside files and arrays."""

from pathlib import Path
from typing import Any

import numpy as np
import pytest

import veriray as vr
from tests.python.test_meshes import PLY
from tests.python.test_sdf import vol
from veriray import SceneError
from veriray.formats import images, mitsuba_objects

Dict = dict[str, Any]
MATRIX = np.array([[1, 0.3, 0, 0], [0, 2, 0, 1], [0.2, 0, 1.5, 0], [0, 0, 0, 1]])
XYZ = np.array([0.5, 0.55, 0.45])
COLOUR = np.array([0.3, 0.5, 0.4])
BENT = PLY.replace("1 1 0\n0 1 0\n", "1 1 .25\n0 1 .125\n")
COLOURS = [".25 .5 .75", ".125 .5 .25", ".75 .875 1", "0 .25 .5"]
COLOURED = BENT.replace("float z\n", "float z\n" + "".join(f"property float {c}\n" for c in "rgb"))
for _corner, _colour in zip(("0 0 0", "1 0 0", "1 1 .25", "0 1 .125"), COLOURS, strict=True):
    COLOURED = COLOURED.replace(f"\n{_corner}\n", f"\n{_corner} {_colour}\n")


@pytest.fixture(scope="module")
def mi() -> Any:
    module = pytest.importorskip("mitsuba", reason="the peer renderer: pip install mitsuba")
    module.set_variant("scalar_rgb")
    return module


def scene(sky: Any = None, **shapes: Any) -> vr.Scene:
    """Shapes from above under a sky, an even one of 1 if none is given."""
    turn = vr.transform.look_at([0, 0, 5], [0, 0, 0], [0, 1, 0])
    film = {"type": "hdrfilm", "width": 1, "height": 1, "rfilter": {"type": "box"}}
    return vr.load_dict({
        "type": "scene", "integrator": {"type": "volpath", "max_depth": 2},
        "sky": sky or {"type": "constant"},
        "camera": {"type": "orthographic", "to_world": turn, "film": film}, **shapes,
    })  # fmt: skip


def plane(reflectance: Any) -> Dict:
    return {"type": "rectangle", "to_world": np.diag([2, 2, 1, 1]),
            "bsdf": {"type": "diffuse", "reflectance": reflectance}}  # fmt: skip


def image(**values: Any) -> Dict:
    return {"type": "bitmap", "filter_type": "nearest", **values}


def tolerance(name: str) -> float:
    """Mitsuba keeps 16 bits as half floats, and rounds what it makes of XYZ of 8 bits to 8 bits."""
    return {"XYZ uint8": 1e-2}.get(name, 1e-3 if "16" in name else 3e-6)


def seen(found: vr.Scene) -> Any:
    return vr.render(found, spp=16, device="cpu", threads=1).image[0, 0]


def even(colour: Any, form: Any) -> Any:
    """An image of one colour; of integers, the numbers are shares of the largest."""
    most = np.iinfo(form).max if np.dtype(form).kind == "u" else 1
    return np.full((4, 3, len(colour)), np.asarray(colour) * most).astype(form)


#: Texels, pixel format, and whether they are told to follow the sRGB curve.
BITMAPS: dict[str, tuple[Any, str, bool]] = {
    "uint8": (even(COLOUR, np.uint8), "RGB", True),
    "uint8 linear": (even(COLOUR, np.uint8), "RGB", False),
    "uint16": (even(COLOUR, np.uint16), "RGB", True),
    "uint16 linear": (even(COLOUR, np.uint16), "RGB", False),
    "uint32": (even(COLOUR, np.uint32), "RGB", True),
    "uint32 linear": (even(COLOUR, np.uint32), "RGB", False),
    "float16": (even(COLOUR, np.float16), "RGB", False),
    "float16 encoded": (even(COLOUR, np.float16), "RGB", True),
    "float32": (even(COLOUR, np.float32), "RGB", False),
    "float32 encoded": (even(COLOUR, np.float32), "RGB", True),
    "float64": (even(COLOUR, np.float64), "RGB", False),
    "float64 encoded": (even(COLOUR, np.float64), "RGB", True),
    "Y": (even([0.3], np.float32), "Y", False),
    "Y uint16": (even([0.3], np.uint16), "Y", True),
    "YA": (even([0.3, 0.5], np.float32), "YA", False),
    "YA uint8": (even([0.3, 0.5], np.uint8), "YA", True),
    "RGBA": (even([*COLOUR, 0.5], np.float32), "RGBA", False),
    "RGBA uint8": (even([*COLOUR, 0.5], np.uint8), "RGBA", True),
    "XYZ": (even(XYZ, np.float32), "XYZ", False),
    "XYZ float16": (even(XYZ, np.float16), "XYZ", False),
    "XYZ encoded": (even(XYZ, np.float32), "XYZ", True),
    "XYZ uint8": (even(XYZ, np.uint8), "XYZ", True),
    "XYZA": (even([*XYZ, 0.5], np.float32), "XYZA", False),
}


def bitmap(mi: Any, name: str) -> Any:
    """A bitmap of its own: Mitsuba's `raw` changes the flag of what it is given."""
    texels, form, encoded = BITMAPS[name]
    made = mi.Bitmap(texels, getattr(mi.Bitmap.PixelFormat, form))
    made.set_srgb_gamma(encoded)
    return made


@pytest.mark.parametrize("raw", [False, True])
@pytest.mark.parametrize("name", BITMAPS)
def test_bitmaps_of_textures_are_mitsubas(mi: Any, name: str, raw: bool) -> None:
    theirs = mi.load_dict(image(bitmap=bitmap(mi, name), raw=raw))
    at = mi.SurfaceInteraction3f()
    at.uv = [0.5, 0.5]
    grey = BITMAPS[name][1].startswith("Y")
    lookup = (theirs.eval_1 if grey else theirs.eval_3) if raw else theirs.eval
    found = seen(scene(a=plane(image(bitmap=bitmap(mi, name), raw=raw))))
    np.testing.assert_allclose(found, np.array(lookup(at)), rtol=tolerance(name))


@pytest.mark.parametrize("name", BITMAPS)
def test_bitmaps_of_skies_are_mitsubas(mi: Any, name: str) -> None:
    theirs = mi.load_dict({"type": "envmap", "bitmap": bitmap(mi, name)})
    at = mi.SurfaceInteraction3f()
    at.wi = [0, 0, 1]
    found = seen(scene({"type": "envmap", "bitmap": bitmap(mi, name)}))
    np.testing.assert_allclose(found, np.array(theirs.eval(at)), rtol=tolerance(name))


def test_the_curve_of_wide_texels_is_that_of_files() -> None:
    codes = np.arange(65536, dtype=np.uint16).reshape(256, 256, 1)
    found, encoded = mitsuba_objects.Bitmap(codes, True, False).plain(False)
    assert not encoded and (found == images._by_table(codes, 65535, False)).all()
    linear, _ = mitsuba_objects.Bitmap(codes, True, False).plain(True)
    assert (linear == images._by_table(codes, 65535, True)).all()
    bright = np.array([-1.0, 0.0, 0.04, 2.0, 1e30]).reshape(1, -1, 1)
    expected = [-1 / 12.92, 0, 0.04 / 12.92, (2.055 / 1.055) ** 2.4, 0]
    expected[4] = np.inf  # beyond float32, which is an error
    found, _ = mitsuba_objects.Bitmap(bright, True, False).plain(False)
    np.testing.assert_allclose(found.ravel(), np.float32(expected), rtol=1e-7)
    with pytest.raises(SceneError, match=r"texel \(x 4, y 0\) is inf; it must be finite"):
        images.from_array(mitsuba_objects.Bitmap(bright, True, False), "")


FILES = {
    "a.png": ("uint8", "RGB"), "b.png": ("uint8", "RGBA"), "c.png": ("uint8", "Y"),
    "d.png": ("uint16", "RGB"), "e.png": ("uint16", "Y"), "a.exr": ("float32", "RGB"),
    "b.exr": ("float16", "RGB"), "c.exr": ("float32", "Y"), "d.exr": ("float32", "YA"),
    "e.exr": ("float32", "XYZ"), "f.exr": ("float16", "RGBA"), "a.hdr": ("float32", "RGB"),
    "a.pfm": ("float32", "RGB"),
}  # fmt: skip


@pytest.mark.parametrize("name", FILES)
def test_a_bitmap_of_a_file_is_that_file(mi: Any, tmp_path: Path, name: str) -> None:
    kind, form = FILES[name]
    channels = {"Y": 1, "YA": 2}.get(form, len(form))
    shares = np.random.default_rng(5).random((5, 4, channels)) * 0.2 + [0.4]
    most = np.iinfo(kind).max if kind[0] == "u" else 1
    path = str(tmp_path / name)
    mi.Bitmap((shares * most).astype(kind), getattr(mi.Bitmap.PixelFormat, form)).write(path)
    for raw in (False, True):
        found = scene(a=plane(image(bitmap=mi.Bitmap(path), raw=raw)))
        assert found.sha256 == scene(a=plane(image(filename=path, raw=raw))).sha256
    found = scene({"type": "envmap", "bitmap": mi.Bitmap(path)})
    assert found.sha256 == scene({"type": "envmap", "filename": path}).sha256


def test_colours_outside_of_rgb(mi: Any, tmp_path: Path) -> None:
    path = str(tmp_path / "a.exr")
    mi.Bitmap(even([0.15, 0.5, 0.4], np.float32), mi.Bitmap.PixelFormat.XYZ).write(path)
    for place in ({"filename": path}, {"bitmap": mi.Bitmap(path)}):
        with pytest.warns(vr.SceneWarning, match="radiance is not negative: 0 is rendered"):
            assert seen(scene({"type": "envmap", **place}))[0] == 0
        with pytest.warns(vr.SceneWarning, match="below 0, down to -0.4"):
            assert seen(scene(a=plane(image(**place))))[0] == 0


def test_bitmaps_and_arrays_that_are_no_images(mi: Any) -> None:
    five = mi.Bitmap(np.zeros((2, 2, 5), np.float32))
    expected = "of pixel format MultiChannel; expected one of Y, YA, RGB, RGBA, XYZ, XYZA"
    for given in ({"sky": {"type": "envmap", "bitmap": five}}, {"a": plane(image(bitmap=five))}):
        with pytest.raises(SceneError, match=expected):
            scene(**given)
    with pytest.raises(
        SceneError, match=r"sky.bitmap: an image of shape \(4,\).*; expected \(H, W\)"
    ):
        scene({"type": "envmap", "bitmap": np.zeros(4)})
    with pytest.raises(SceneError, match="of type array, expected rgb"):
        scene(a=plane(mi.Bitmap(np.zeros((2, 2), np.float32))))


def test_the_box_of_a_volume_grid(mi: Any, tmp_path: Path) -> None:
    path = vol(tmp_path / "a.vol", np.random.default_rng(5).random((3, 4, 5)))
    data = bytearray(path.read_bytes())
    data[24:48] = np.array([-1, -2, -3, 2, 4, 6], "<f4").tobytes()
    path.write_bytes(data)

    def of(**given: Any) -> vr.Scene:
        place = np.diag([0.5, 0.5, 0.5, 1])
        grid = {"type": "gridvolume", "to_world": mi.ScalarTransform4f(place), **given}
        fog = {"type": "heterogeneous", "sigma_t": grid, "albedo": 0.3}
        return scene(a={"type": "cube", "bsdf": {"type": "null"}, "interior": fog})

    grid = mi.VolumeGrid(str(path))
    boxed = of(grid=grid, use_grid_bbox=True)
    assert boxed.sha256 == of(filename=str(path), use_grid_bbox=True).sha256
    assert boxed.grid_to_world[0].tolist() == [[1.5, 0, 0, -0.5], [0, 3, 0, -1], [0, 0, 4.5, -1.5]]
    unit = of(filename=str(path)).sha256
    assert of(grid=grid).sha256 == unit == of(grid=grid, use_grid_bbox=False).sha256
    cells = np.array(grid)
    assert of(data=cells).sha256 == unit
    assert of(grid=mi.VolumeGrid(cells), use_grid_bbox=True).sha256 == unit, "its box is the unit"
    with pytest.raises(SceneError, match="use_grid_bbox = true, but an array has no box"):
        of(data=cells, use_grid_bbox=True)
    theirs = {"type": "gridvolume", "raw": True, "use_grid_bbox": True}
    with pytest.raises(RuntimeError, match="use_grid_bbox is unsupported with tensor input"):
        mi.load_dict({**theirs, "data": mi.TensorXf(cells[..., None])})


def loaded(mi: Any, path: Path, text: str = BENT, **values: Any) -> Any:
    path.write_text(text)
    return mi.load_dict({"type": "ply", "filename": str(path), **values})


@pytest.mark.parametrize("flip", [False, True])
@pytest.mark.parametrize("flat", [False, True])
@pytest.mark.parametrize("mirror", [1, -1])
def test_meshes_are_mitsubas(mi: Any, tmp_path: Path, mirror: int, flat: bool, flip: bool) -> None:
    """Vertices, front and shading normals, which Mitsuba tells where a ray meets a face."""
    place = mi.ScalarTransform4f(MATRIX @ np.diag([mirror, 1, 1, 1]))
    mesh = loaded(mi, tmp_path / "a.ply", to_world=place, face_normals=flat, flip_normals=flip)
    ours = scene(a=mesh)
    corners = np.array(mesh.vertex_positions_buffer()).reshape(-1, 3)
    assert (ours.vertices == corners).all() and ours.shape_names == ("a",)
    theirs = mi.load_dict({"type": "scene", "a": mesh})
    for face in ours.triangles:
        a, b, c = ours.vertices[face]
        front = np.cross(b - a, c - a)
        front /= np.linalg.norm(front)
        weights = np.array([0.5, 0.3, 0.2])
        start = weights @ ours.vertices[face] + front
        hit = theirs.ray_intersect(mi.Ray3f(mi.Point3f(*start), mi.Vector3f(*-front)))
        smooth = weights @ ours.normals[face]
        shading = smooth / np.linalg.norm(smooth) if smooth.any() else front
        np.testing.assert_allclose(np.array(hit.n), front, atol=1e-5)
        np.testing.assert_allclose(np.array(hit.sh_frame.n), shading, atol=1e-5)
    assert ours.normals.any() != flat


def test_meshes_with_bsdfs_beside_them(mi: Any, tmp_path: Path) -> None:
    """A flat mesh with texture coordinates and attributes: the scene of its file."""
    file = {"type": "ply", "filename": str(tmp_path / "a.ply"), "face_normals": True}
    mesh = loaded(mi, tmp_path / "a.ply", COLOURED, face_normals=True)
    attribute = {"type": "mesh_attribute", "name": "vertex_color"}
    glossy = {"type": "principled", "base_color": attribute}
    for more in ({"bsdf": glossy}, {"e": {"type": "area", "radiance": 2.0}}, {}):
        given = {"type": "mesh", "mesh": mesh, "to_world": MATRIX, **more}
        assert scene(a=given).sha256 == scene(a={**file, "to_world": MATRIX, **more}).sha256
    assert scene(a=mesh).sha256 == scene(a=file).sha256
    group = {"type": "shapegroup", "id": "g", "mesh": mesh}
    assert (
        len(scene(g=group, i={"type": "instance", "g": {"type": "ref", "id": "g"}}).triangles) == 2
    )
    uv = [[0, 0.25], [1, 0.5], [-2, 3]]
    made = mi.Mesh("m", 3, 1, has_vertex_texcoords=True)
    params = mi.traverse(made)
    vertices = [[0.0, 0, 0], [1, 0, 0], [0, 1, 0]]
    params["vertex_positions"], params["faces"] = np.ravel(vertices), [0, 1, 2]
    params["vertex_texcoords"] = np.ravel(uv)
    params.update()
    arrays = {"type": "mesh", "vertices": vertices, "faces": [[0, 1, 2]], "face_normals": True}
    board = {"bsdf": {"type": "diffuse", "reflectance": {"type": "checkerboard"}}}
    assert scene(a=made).sha256 == scene(a=arrays).sha256
    found = scene(a={"type": "mesh", "mesh": made, **board})
    assert found.sha256 == scene(a={**arrays, "uv": uv, **board}).sha256


def test_what_cannot_be_read_of_a_mesh(mi: Any, tmp_path: Path) -> None:
    path = tmp_path / "a.ply"
    red = {"type": "diffuse", "reflectance": {"type": "rgb", "value": [0.5, 0.1, 0.1]}}
    lamp = {"type": "area", "radiance": 2.0}
    two = {"type": "twosided", "b": {"type": "diffuse"}}
    for more, told in (
        ({"bsdf": red}, "bsdf"),
        ({"bsdf": two}, "bsdf"),
        ({"emitter": lamp}, "emitter"),
        ({"bsdf": red, "emitter": lamp}, "bsdf and emitter"),
        ({"interior": {"type": "homogeneous"}}, "medium"),
    ):
        mesh = loaded(mi, path, **more)
        for given in (mesh, {"type": "mesh", "mesh": mesh}):
            with pytest.raises(SceneError, match=f"a mitsuba.Mesh with {told} that cannot be read"):
                scene(a=given)
        scene(a={"type": "mesh", "mesh": mesh, **more})
    with pytest.raises(SceneError, match=r"give \{'type': 'mesh', 'mesh': the mesh, 'medium': \{"):
        scene(a=mesh)
    scene(a=loaded(mi, path, bsdf={"type": "diffuse"}))
    scene(b={**red, "id": "b"}, a={"type": "mesh", "mesh": loaded(mi, path, bsdf=red),
                                   "bsdf": {"type": "ref", "id": "b"}})  # fmt: skip


def test_transforms_of_texture_coordinates(mi: Any) -> None:
    plane_of = mi.ScalarTransform3f().translate([0.25, 0.5]).rotate(30).scale([2, 3])
    space = mi.ScalarTransform4f().translate([0.25, 0.5, 0]).rotate([0, 0, 1], 30).scale([2, 3, 1])

    def of(to_uv: Any) -> vr.Scene:
        return scene(a=plane({"type": "checkerboard", "to_uv": to_uv}))

    theirs = mi.load_dict({"type": "checkerboard", "to_uv": plane_of})
    expected = np.array(mi.traverse(theirs)["to_uv"].matrix)
    np.testing.assert_allclose(of(plane_of).texture_to_uv[0], expected[:2], rtol=1e-6)
    np.testing.assert_allclose(of(space).texture_to_uv[0], expected[:2], rtol=1e-6)
    assert of(np.array(plane_of.matrix)).sha256 == of(plane_of).sha256
    with pytest.raises(SceneError, match=r"shape \(2, 3\), expected \(4, 4\) or \(3, 3\)"):
        of(np.zeros((2, 3)))
    with pytest.raises(SceneError, match=r"shape \(3, 3\), expected \(4, 4\) or \(3,\)"):
        scene(a={"type": "sphere", "to_world": plane_of})


def test_colours(mi: Any) -> None:
    expected = scene(a=plane({"type": "rgb", "value": [0.25, 0.5, 0.75]})).sha256
    for name in ("ScalarColor3f", "ScalarColor3d", "Color3f"):
        assert scene(a=plane(getattr(mi, name)(0.25, 0.5, 0.75))).sha256 == expected
    sky = {"type": "constant", "radiance": mi.ScalarColor3f(1, 2, 3)}
    rgb = {"type": "rgb", "value": [1, 2, 3]}
    assert scene(sky).sha256 == scene({**sky, "radiance": rgb}).sha256
    for given in ([0.1, 0.2, 0.3], mi.ScalarVector3f(0.1, 0.2, 0.3)):
        with pytest.raises(SceneError, match="of type vector, expected rgb"):
            scene(a=plane(given))
        with pytest.raises(RuntimeError, match="got vector"):
            mi.load_dict({"type": "diffuse", "reflectance": given})


def test_objects_that_cannot_be_read(mi: Any) -> None:
    for given in (
        {"a": {"type": "sphere", "bsdf": mi.load_dict({"type": "plastic"})}},
        {"a": plane(mi.load_dict({"type": "checkerboard"}))},
        {"a": mi.load_dict({"type": "sphere"})},
        {"integrator": mi.load_dict({"type": "direct"})},
    ):
        with pytest.raises(SceneError, match="give the dictionary that Mitsuba made it from$"):
            scene(**given)


def test_uneven_scales_of_lights() -> None:
    uneven = {"to_world": np.diag([2.0, 1, 1, 1])}
    with pytest.raises(SceneError, match="a spot may be scaled evenly, which is left out; else it"):
        scene(a={"type": "spot", **uneven})
    with pytest.raises(SceneError, match="rotated, mirrored, moved and scaled evenly"):
        scene({"type": "envmap", "bitmap": np.ones((2, 2, 3)), **uneven})
