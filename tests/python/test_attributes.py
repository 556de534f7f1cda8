"""Numbers of meshes as textures, beside Mitsuba's, and blends of two materials.

Under an even sky of radiance 1 a convex diffuse surface sends out its reflectance, without noise:
so a picture of one narrow pixel is a lookup.
"""

from __future__ import annotations

import itertools
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import veriray
from tests.python.test_textures import diffuse, scene, seen
from veriray import transform as tf
from veriray.errors import SceneError, SceneWarning
from veriray.formats import ply
from veriray_validate.scenes import camera

RNG = np.random.default_rng(20161100)
POINTS = np.array([[-1, -1, 0], [1, -1, 0.2], [1, 1, 0.1], [-1.2, 1, 0], [0, 0, 0.3]])
FACES = np.array([[0, 1, 4], [1, 2, 4], [2, 3, 4], [3, 0, 4]])
VIEWS = [((x, y, 3.0), (x, y, 0.0)) for x, y in ((0.5, -0.3), (-0.4, 0.6), (0.1, 0.7), (-0.8, 0.1))]


def text(vertex: dict[str, Any], face: dict[str, Any], kind: str = "float", quads: bool = False,
         normals: bool = False) -> bytes:  # fmt: skip
    """An ASCII PLY file of POINTS with columns of vertices and faces."""
    rows = np.column_stack([POINTS, *([POINTS + [0, 0, 4]] if normals else []), *vertex.values()])
    lists = ["4 0 1 2 4", "4 2 3 0 4"] if quads else [f"3 {a} {b} {c}" for a, b, c in FACES]
    names = [*"xyz", *(["nx", "ny", "nz"] if normals else [])]
    lines = ["ply", "format ascii 1.0", f"element vertex {len(POINTS)}",
             *(f"property float {name}" for name in names),
             *(f"property {kind} {name}" for name in vertex), f"element face {len(lists)}",
             "property list uchar int vertex_indices", *(f"property {kind} {n}" for n in face),
             "end_header", *(" ".join(map(repr, row.tolist())) for row in rows),
             *(" ".join([line, *map(repr, (float(v[k]) for v in face.values()))])
               for k, line in enumerate(lists))]  # fmt: skip
    return "\n".join([*lines, ""]).encode()


def columns(names: str, rows: int) -> dict[str, Any]:
    """Random columns in [0.1, 0.9]."""
    return {name: np.round(RNG.uniform(0.1, 0.9, rows), 3) for name in names.split()}


def attribute(name: str, **more: Any) -> dict[str, Any]:
    return {"type": "mesh_attribute", "name": name, **more}


def blend(first: Any, second: Any, weight: Any) -> dict[str, Any]:
    return {"type": "blendbsdf", "weight": weight, "first": first, "second": second}


CASES: dict[str, tuple[dict[str, Any], dict[str, Any]]] = {
    "colours": ({}, {}),
    "smooth": ({"normals": True}, {}),
    "flipped": ({}, {"flip_normals": True}),
    "mirrored": ({"normals": True}, {"to_world": tf.scale((-1, 1, 1))}),
    "flat": ({}, {"face_normals": True}),
}


@pytest.mark.parametrize("case", CASES)
def test_lookups_are_mitsubas(case: str, tmp_path: Path, device: str) -> None:
    """To 1e-5: both round to float32."""
    mitsuba = pytest.importorskip("mitsuba", reason="the peer renderer: pip install mitsuba")
    mitsuba.set_variant("scalar_rgb")
    form, more = CASES[case]
    path = tmp_path / "a.ply"
    content = (columns("r g b foo_0", 5), columns("r g b foo_x", 4))
    path.write_bytes(text(*content, **form))
    shape = {"type": "ply", "filename": str(path), **more}
    theirs = mitsuba.load_dict({"type": "scene", "shape": {
        key: mitsuba.ScalarTransform4f(value) if key == "to_world" else value
        for key, value in shape.items()
    }})  # fmt: skip
    for texture in (attribute("vertex_color"), attribute("vertex_foo"), attribute("face_color"),
                    attribute("face_foo"), attribute("vertex_color", scale=0.5)):  # fmt: skip
        looked_up = mitsuba.load_dict(texture)
        for origin, target in VIEWS:
            side = -1.0 if case == "flipped" else 1.0
            origin = (origin[0], origin[1], side * origin[2])
            towards = np.subtract(target, origin)
            ray = mitsuba.Ray3f(list(origin), (towards / np.linalg.norm(towards)).tolist())
            hit = theirs.ray_intersect(ray)
            assert hit.is_valid()
            found = seen(shape, diffuse(texture), (origin, target), device)
            np.testing.assert_allclose(found, np.array(looked_up.eval(hit)), rtol=0, atol=1e-5)


@pytest.mark.parametrize(
    ("names", "expected"),
    [
        ("r g b", {"color": 3}), ("r g b a", {"color": 3}), ("b g r", {"color": 3}),
        ("red green blue", {"color": 3}), ("red green blue alpha", {"color": 3}), ("r g", {}),
        ("color_r color_g color_b", {"color_color": 3}), ("foo_0", {"foo": 1}),
        ("foo_x", {"foo": 1}), ("foo", {}), ("foo_x foo_y foo_z", {"foo": 3}),
        ("foo_0 foo_1 foo_2", {"foo": 3}), ("foo_1 foo_2 foo_3", {"foo": 3}),
        ("foo_0 foo_1", {}), ("foo_x foo_y foo_z foo_w", {}), ("foo_y foo_x foo_z", {}),
        ("foo_x foo_g foo_b", {}), ("r g b w_0", {"color": 3, "w": 1}), ("foo_red", {}),
        ("foo_u", {}), ("intensity s_x", {"s": 1}), ("a_b_r a_b_g a_b_b", {"a_b_color": 3}),
        ("foo_0 bar_0 foo_1 foo_2", {"foo": 1, "bar": 1}),
    ],
)  # fmt: skip
def test_names_are_mitsubas(names: str, expected: dict[str, int], tmp_path: Path) -> None:
    data = text(columns(names, 5), columns(names, 4))
    found = {name: values.shape for name, values in ply.read(data, attributes=True)[4].items()}
    assert found == {f"{of}_{name}": (rows, width) for name, width in expected.items()
                     for of, rows in (("vertex", 5), ("face", 4))}  # fmt: skip
    mitsuba = pytest.importorskip("mitsuba", reason="the peer renderer: pip install mitsuba")
    mitsuba.set_variant("scalar_rgb")
    (tmp_path / "a.ply").write_bytes(data)
    theirs = mitsuba.traverse(
        mitsuba.load_dict({"type": "ply", "filename": str(tmp_path / "a.ply")})
    )
    own = ("vertex_positions", "vertex_normals", "vertex_texcoords", "vertex_count", "face_count")
    assert {name for name in theirs.keys() if name.startswith(("vertex_", "face_"))} - set(
        own
    ) == set(found)


def test_dictionaries_hold_what_files_hold(tmp_path: Path) -> None:
    vertex, face = columns("r g b foo_0", 5), columns("r g b", 4)
    path = tmp_path / "a.ply"
    path.write_bytes(text(vertex, face))
    of_file = {"type": "ply", "filename": str(path), "face_normals": True}
    arrays = {
        "type": "mesh", "vertices": POINTS.astype(np.float32), "faces": FACES,
        "face_normals": True, "vertex_color": np.stack([vertex[c] for c in "rgb"], axis=1),
        "vertex_foo": vertex["foo_0"][:, None],
        "face_color": np.stack([face[c] for c in "rgb"], axis=1),
    }  # fmt: skip
    for name in ("vertex_color", "vertex_foo", "face_color"):
        bsdf = diffuse(attribute(name))
        one, two = (veriray.load_dict(scene(shape, bsdf)) for shape in (of_file, arrays))
        assert (one.attribute_values == two.attribute_values).all()
        assert one.texture_kind == two.texture_kind


def test_triangles_of_a_face_have_its_numbers() -> None:
    face = columns("r g b", 2)
    found = ply.read(text({}, face, quads=True), attributes=True)[4]
    assert (found["face_color"] == np.repeat(np.stack([*face.values()], axis=1), 2, axis=0)).all()


def picture(bsdf: Any, device: str, scheduler: str, **more: Any) -> str:
    """The hash of a room with a mesh of that bsdf and much interreflection."""
    balls = {
        f"ball_{k}": {"type": "sphere", "center": [0.3 * k - 2, 0.0, -1.5], "radius": 0.2,
                      "bsdf": diffuse(0.8)}
        for k in range(more.pop("balls", 40))
    }  # fmt: skip
    given = scene({"type": "mesh", "vertices": POINTS, "faces": FACES, **more}, bsdf, **balls)
    given["camera"] |= {"fov": 50.0, "film": {"type": "hdrfilm", "width": 16, "height": 16}}
    given["lamp"] = {"type": "sphere", "center": [0.0, 2.0, 2.0], "radius": 0.3,
                     "emitter": {"type": "area", "radiance": 5.0}}  # fmt: skip
    made = veriray.load_dict(given)
    return veriray.render(made, 8, device=device, scheduler=scheduler).film_sha256


def test_an_even_attribute_has_the_bits_of_its_colour(device: str) -> None:
    """Of a picture with interreflection, in a tree: interpolation leaves the colour as it is."""
    colour = [0.25, 0.5, 0.71875]
    values = {"vertex_color": np.tile(colour, (5, 1)), "face_color": np.tile(colour, (4, 1))}
    bsdfs = ({"type": "rgb", "value": colour}, attribute("vertex_color"), attribute("face_color"))
    hashes = {
        picture(diffuse(bsdf), device, scheduler, **values)
        for bsdf in bsdfs
        for scheduler in ("fused", "thrust", "wavefront")
    }
    assert len(hashes) == 1


@pytest.mark.parametrize("balls", [0, 40])
def test_blends_have_the_same_bits_everywhere(balls: int, device: str) -> None:
    """Without and with a tree, in which hits are sorted by kind; and at weights of 0 and 1 those of
    one material alone."""
    one, two = diffuse(0.6), {"type": "conductor"}
    weight = attribute("vertex_share")
    share = {"vertex_share": np.linspace(0, 1, 5)[:, None], "balls": balls}
    kinds = ("fused", "thrust", "wavefront")
    assert len({picture(blend(one, two, weight), device, s, **share) for s in kinds}) == 1
    for value, alone in ((0.0, one), (1.0, two), (-3.0, one), (7.0, two)):
        for scheduler in kinds:
            found = picture(blend(one, two, value), device, scheduler, balls=balls)
            assert found == picture(alone, device, scheduler, balls=balls)


def test_each_side_of_two_may_be_a_blend(device: str) -> None:
    """From its side each looks, to the bit, as alone on both sides.

    In a blend in a mask it looks as alone in the mean: false alarms 4e-6, sees 1 %.
    """
    board = {"type": "checkerboard", "color0": 0.25, "color1": 0.75}
    one, two, three = diffuse(0.6), {"type": "conductor"}, diffuse(0.2)
    fronts = (
        one,
        blend(one, two, 0.3),
        blend(one, two, board),
        blend(one, blend(two, three, 0.4), 0.3),
    )
    rough = {"type": "roughconductor", "alpha": 0.3}
    backs = three, blend(three, rough, 0.6), blend(rough, three, board)

    def drawn(bsdf: Any, side: float, kind: str, spp: int = 8) -> veriray.Render:
        eye = veriray.transform.look_at([1, 0.5, 4 * side], [0, 0, 0], [0, 1, 0])
        made = veriray.load_dict({
            "type": "scene", "sky": {"type": "constant", "radiance": 0.3},
            "lamp": {"type": "point", "position": [2, 2, 3 * side], "intensity": 20.0},
            "view": {"type": "perspective", "fov": 40.0, "to_world": eye},
            "plate": {"type": "rectangle", "bsdf": bsdf},
            "ball": {"type": "sphere", "radius": 0.3, "center": [0.5, 0.0, 0.6 * side]},
        }).with_(width=16, height=16, filter="box")  # fmt: skip
        return veriray.render(made, spp, device=device, scheduler=kind)

    def twosided(*sides: Any) -> Any:
        return {"type": "twosided", **{f"s{k}": side for k, side in enumerate(sides)}}

    def around(bsdf: Any) -> Any:
        return {"type": "mask", "opacity": 0.75, "b": blend(bsdf, twosided(one), 0.125)}

    for front, back in itertools.product(fronts, backs):
        for side, alone in ((1.0, front), (-1.0, back)):
            for kind in ("fused", "thrust", "wavefront"):
                found = drawn(twosided(front, back), side, kind).film_sha256
                assert found == drawn(twosided(alone), side, kind).film_sha256
            nested = twosided(twosided(front, three), twosided(back, one))
            assert drawn(nested, side, "fused").film_sha256 == found
    for side, alone in ((1.0, fronts[1]), (-1.0, backs[1])):
        pair = around(twosided(fronts[1], backs[1])), around(twosided(alone))
        found, told = (drawn(bsdf, side, "fused", 1024) for bsdf in pair)
        error = np.hypot(*(np.linalg.norm(r.stderr[..., 0]) for r in (found, told)))
        sums = [r.image[..., 0].sum(dtype=float) for r in (found, told)]
        assert abs(sums[0] - sums[1]) < 4.7 * error < 0.01 * sums[1]


def test_blends_in_other_materials() -> None:
    board = {"type": "checkerboard", "color0": 0.25, "color1": 0.5}
    one, two = diffuse(board), {"type": "conductor"}
    ball = {"type": "sphere"}

    def loaded(bsdf: Any, **more: Any) -> veriray.Scene:
        return veriray.load_dict(scene(ball, bsdf, **more))

    plain = loaded(blend(one, two, 0.25))
    assert plain.blend_material.tolist() == [1, -1] and plain.blend_weight.tolist() == [0.25, 0]
    assert plain.material_kind.tolist() == [0, 1] and plain.reflectance_texture.tolist() == [0, -1]
    assert not plain.two_sided.any()
    both = loaded({"type": "twosided", "bsdf": blend(one, two, board)})
    assert both.two_sided.tolist() == [True, True]
    assert both.blend_weight_texture.tolist() == [1, -1]
    assert (both.texture_color0[1] == 0.5).all()  # of one number its colours are exchanged
    for opacity, column in ((0.5, "opacity"), (board, "opacity_texture")):
        masked = loaded({"type": "mask", "opacity": opacity, "bsdf": blend(one, two, 0.25)})
        assert (getattr(masked, column) == (0.5 if column == "opacity" else 1)).all()
    inside = blend({"type": "mask", "opacity": 0.25, "b": one}, two, 0.25)
    masked = loaded({"type": "mask", "opacity": 0.5, "bsdf": inside})
    assert masked.opacity.tolist() == [0.125, 0.5]
    sides = loaded({"type": "twosided", "front": one, "back": two})
    assert sides.blend_sides.tolist() == [True, False] and sides.two_sided.all()
    assert sides.blend_material.tolist() == [1, -1] and not sides.blend_weight.any()
    mixed = blend(
        {"type": "twosided", "bsdf": one}, {"type": "mask", "bsdf": {"type": "null"}}, 0.5
    )
    assert loaded(mixed).opacity.tolist() == [1, 0.5]
    # One object, alone and in several others, each of which has a row of its own.
    shared = {"type": "twosided", "id": "shared", "bsdf": blend(one, two, 0.5)}
    again = loaded({"type": "mask", "bsdf": {"type": "ref", "id": "shared"}},
                   first={"type": "rectangle", "bsdf": shared})  # fmt: skip
    assert sorted(again.opacity.tolist()) == [0.5, 0.5, 1, 1] and again.two_sided.all()
    assert again.blend_material[again.sphere_material[0]] >= 0


@pytest.mark.parametrize(
    ("bsdf", "more", "message"),
    [
        (diffuse(attribute("color")), {}, 'expected one that begins with vertex_ or face_'),
        (diffuse(attribute("vertex_a", scale=2.0)), {}, r"in row 0; times scale = 2 it must be in"),
        ({"type": "mask", "opacity": attribute("vertex_a"), "in": diffuse(0.5)}, {},
         '"vertex_a" has 3 numbers, expected one for what stands at scene.shape.bsdf.opacity'),
        (diffuse(0.5), {"vertex_a": np.ones((4, 3))}, "has 4 rows for 5 vertices"),
        (diffuse(0.5), {"face_a": np.ones((5, 3))}, "has 5 rows for 4 faces"),
        (diffuse(0.5), {"face_a": np.ones((4, 2))}, r"has shape \(4, 2\)"),
        (diffuse(0.5), {"face_a": np.full((4, 3), np.inf)}, "must be finite"),
        (diffuse(0.5), {"edge_a": np.ones((4, 3))}, "edge_a"),
        ({"type": "blendbsdf", "a": diffuse(0.5), "b": diffuse(0.5)}, {}, '"weight" .* is missing'),
        ({"type": "blendbsdf", "weight": 0.5, "a": diffuse(0.5)}, {}, "blendbsdf"),
        (blend(blend(diffuse(0.5), {"type": "plastic"}, 0.5), {"type": "conductor"},
               attribute("vertex_a")), {}, "weight of a blend whose first bsdf is a blend"),
        (blend(blend(diffuse(0.5), diffuse(0.2), {"type": "checkerboard"}),
               blend(diffuse(0.1), {"type": "plastic"}, 0.5), 0.5), {}, "holds two blends"),
        ({"type": "twosided", "b": blend(diffuse(0.5), {"type": "null"}, 0.5)}, {},
         "cannot hold a blendbsdf that lets light through"),
        ({"type": "mask", "opacity": {"type": "checkerboard"},
          "b": blend({"type": "mask", "x": diffuse(0.5)}, {"type": "null"}, 0.5)},
         {}, "cannot hold a blendbsdf of masks"),
    ],
)  # fmt: skip
def test_refusals(bsdf: Any, more: dict[str, Any], message: str) -> None:
    mesh = {"type": "mesh", "vertices": POINTS, "faces": FACES, "vertex_a": np.full((5, 3), 0.75)}
    with pytest.raises(SceneError, match=message):
        veriray.load_dict(scene({**mesh, **more}, bsdf))


def test_attributes_are_on_meshes_alone() -> None:
    with pytest.raises(SceneError, match='reads "vertex_color"; allowed: on meshes'):
        veriray.load_dict(scene({"type": "sphere"}, diffuse(attribute("vertex_color"))))


@pytest.mark.parametrize("shape", ["mesh", "rectangle"])
def test_an_attribute_that_is_not_there_is_0_and_said(shape: str) -> None:
    """As in Mitsuba's variants for GPU and LLVM; its scalar ones end with an error."""
    mesh = {"type": "mesh", "vertices": POINTS, "faces": FACES, "vertex_a": np.full((5, 3), 0.75)}
    with pytest.warns(SceneWarning, match='reads "vertex_b", which the mesh has not; it counts as'):
        found = veriray.load_dict(
            scene(mesh if shape == "mesh" else {"type": shape}, diffuse(attribute("vertex_b")))
        )
    assert found.attribute_values.shape[0] > 0 and not found.attribute_values.any()


def test_arrays_that_no_scene_may_hold(cpu: str) -> None:
    good = {
        "vertices": POINTS, "triangles": FACES, "triangle_material": [0] * 4,
        "reflectance": [[0.5] * 3] * 2, "reflectance_texture": [0, -1], "texture_kind": [2],
        "attribute_values": np.full((5, 3), 0.5), "blend_material": [1, -1],
    }  # fmt: skip

    def made(**more: Any) -> veriray.Scene:
        return veriray.Scene(camera=camera([0, 0, 2], [0, 0, 0]), film=veriray.Film(1, 1),
                             **{**good, **more})  # fmt: skip

    veriray.rendering.prepare(made(), cpu)
    for more, message in (
        ({"texture_first": [1]}, r"texture_first\[0\] = 1: a row for each of 5 vertices ends at 6"),
        ({"texture_kind": [3], "texture_first": [2]}, "of 4 triangles ends at 6; there are 5"),
        ({"attribute_values": np.full((5, 3), 1.5)}, r"attribute_values\[0\]"),
        ({"blend_material": [1, 0]}, r"blend_material\[1\] = 0, which is a blend itself"),
        ({"blend_material": [0, -1]}, r"blend_material\[0\] = 0, which is a blend itself"),
        ({"blend_material": [2, -1]}, r"blend_material\[0\] = 2"),
        ({"blend_weight": [1.5, 0]}, r"blend_weight\[0\] = 1.5"),
    ):
        with pytest.raises(SceneError, match=message):
            made(**more)
    wrong = made()
    object.__setattr__(wrong, "texture_first", np.array([1], np.uint32))
    with pytest.raises(SceneError, match=r"texture_first\[0\] begins 5 rows of 5"):
        veriray.rendering.prepare(wrong, cpu)
    wrong = made()
    object.__setattr__(wrong, "blend_material", np.array([1, 0], np.int32))
    with pytest.raises(SceneError, match=r"blend_material\[1\] is a blend that does not come"):
        veriray.rendering.prepare(wrong, cpu)


@pytest.mark.parametrize("faces", [34, 41, 76, 93])
def test_lamps_of_attributes_among_many_in_fog(faces: int) -> None:
    """Lanes without a light sample have a row of the light table all the same."""
    turn = np.linspace(0, 2 * np.pi, faces + 1)
    rim = np.stack([np.cos(turn), np.sin(turn), 0.3 * np.sin(5 * turn)], axis=1)
    fan = np.stack([np.zeros(faces, int), np.arange(faces) + 1, np.arange(faces) + 2], axis=1)
    place = np.diag([0.3, 0.3, 0.3, 1.0])
    place[0, 3] = 2
    shine = {"type": "area", "radiance": {"type": "mesh_attribute", "name": "vertex_c"}}
    corners = np.array([[-1.0, -1, 0], [1, -1, 0], [1, 1, 0], [-1, 1, 0]])
    colours = np.array([[0.0, 0, 0], [3, 3, 1], [3, 3, 1], [0, 0, 0]])
    view = np.diag([-1.0, 1, -1, 1])
    view[:3, 3] = 0, 0.5, 5
    scene = veriray.load_dict({
        "type": "scene",
        "view": {"type": "perspective", "fov": 60.0, "to_world": view,
                 "medium": {"type": "ref", "id": "fog"}},
        "bound": {"type": "sphere", "radius": 7.0, "bsdf": {"type": "null"},
                  "interior": {"type": "homogeneous", "id": "fog", "sigma_t": 0.1}},
        "fan": {"type": "mesh", "vertices": np.vstack([[[0.0, 0, 0]], rim]), "faces": fan,
                "face_normals": True, "to_world": place,
                "emitter": {"type": "area", "radiance": 1.0}},
        "lamp": {"type": "mesh", "vertices": corners, "faces": np.array([[0, 1, 2], [0, 2, 3]]),
                 "face_normals": True, "vertex_c": colours, "emitter": shine},
    })  # fmt: skip
    image = veriray.render(scene, 64, width=16, height=16, max_depth=4, device="cpu").image
    assert np.isfinite(image).all() and 0.05 < image.mean() < 0.2
