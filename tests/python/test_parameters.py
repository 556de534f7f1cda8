# ruff: noqa: E501 (the table of messages)
"""Numbers of a scene by name: `Scene.parameters` and `Scene.with_`."""

from __future__ import annotations

import copy
import dataclasses
import gc
import pickle
import threading
import weakref
from typing import Any

import numpy as np
import pytest

import veriray as vr
from veriray.errors import SceneError


def rgb(*values: float) -> dict[str, Any]:
    return {"type": "rgb", "value": list(values)}


BOARD = {"type": "checkerboard", "id": "board"}
SCENE: dict[str, Any] = {
    "type": "scene",
    "view": {"type": "perspective"},
    "sky": {"type": "constant", "radiance": 0.5},
    "bulb": {"type": "point", "position": [0, 0, 3]},
    "sun": {"type": "directional"},
    "white": {"type": "twosided", "inner": {"type": "roughconductor", "alpha": 0.2}},
    "teapot": {"type": "sphere", "bsdf": {"type": "principled", "roughness": 0.25}},
    "pane": {"type": "sphere", "bsdf": {"type": "principled", "spec_trans": 0.5, "eta": 1.5}},
    "box": {"type": "cube", "ref": {"type": "ref", "id": "white"}},
    "lid": {"type": "disk", "ref": {"type": "ref", "id": "white"}},
    "fog": {
        "type": "sphere", "bsdf": {"type": "null"},
        "interior": {"type": "homogeneous", "phase": {"type": "hg", "g": 0.25}},
    },
    "wall": {
        "type": "rectangle", "lamp": {"type": "area", "radiance": 2.0},
        "bsdf": {"type": "mask", "held": {"type": "diffuse", "reflectance": BOARD}},
    },
}  # fmt: skip
#: A name -> where the dictionary has it, its value in SCENE, and another.
NAMES: dict[str, tuple[tuple[str, ...], Any, Any]] = {
    "white.alpha": (("white", "inner", "alpha"), 0.2, 0.5),
    "box.bsdf.alpha": (("white", "inner", "alpha"), 0.2, 0.5),
    "lid.bsdf.alpha": (("white", "inner", "alpha"), 0.2, 0.5),
    "white.specular_reflectance": (("white", "inner", "specular_reflectance"), (1, 1, 1), 0.5),
    "teapot.bsdf.roughness": (("teapot", "bsdf", "roughness"), 0.25, 1.0),
    "teapot.bsdf.base_color": (("teapot", "bsdf", "base_color"), (0.5, 0.5, 0.5), (1, 0, 0.25)),
    "teapot.bsdf.eta": (("teapot", "bsdf", "eta"), 1.5, 1.25),
    "pane.bsdf.spec_trans": (("pane", "bsdf", "spec_trans"), 0.5, 1.0),
    "fog.interior.sigma_t": (("fog", "interior", "sigma_t"), (1, 1, 1), (1, 2, 3)),
    "fog.interior.g": (("fog", "interior", "phase", "g"), 0.25, -0.25),
    "wall.emitter.radiance": (("wall", "lamp", "radiance"), (2, 2, 2), (0, 1, 5)),
    "wall.bsdf.opacity": (("wall", "bsdf", "opacity"), 0.5, 0.75),
    "board.color0": (("wall", "bsdf", "held", "reflectance", "color0"), (0.4, 0.4, 0.4), (1, 1, 0)),
    "bulb.intensity": (("bulb", "intensity"), (1, 1, 1), (3, 4, 5)),
    "bulb.position": (("bulb", "position"), (0, 0, 3), (1, 2, 3)),
    "sun.irradiance": (("sun", "irradiance"), (1, 1, 1), (3, 4, 5)),
    "environment.radiance": (("sky", "radiance"), (0.5, 0.5, 0.5), 2.0),
}


@pytest.fixture(scope="module")
def scene() -> vr.Scene:
    return vr.load_dict(SCENE)


@pytest.mark.parametrize("name", NAMES)
def test_a_changed_number_is_that_of_the_file(scene: vr.Scene, name: str) -> None:
    path, old, new = NAMES[name]
    other: Any = copy.deepcopy(SCENE)
    holder = other
    for key in path[:-1]:
        holder = holder[key]
    holder[path[-1]] = (
        list(new) if name.endswith("position") else rgb(*new) if np.ndim(new) else new
    )
    changed = scene.with_({name: new}, spp=9)
    assert changed.sha256 == vr.load_dict(other).sha256 != scene.sha256
    assert changed.spp == 9 and changed.cameras == scene.cameras
    assert changed.with_({name: old}).sha256 == scene.sha256
    listed = scene.parameters()
    if name.split(".")[0] not in ("box", "lid"):  # white by another name
        assert np.float32(listed[name]).tolist() == np.float32(old).tolist()


def test_the_list_is_whole(scene: vr.Scene) -> None:
    listed = scene.parameters()
    assert {name.rpartition(".")[0] for name in listed} == {
        "white", "teapot.bsdf", "pane.bsdf", "fog.interior", "wall.bsdf", "wall.emitter", "board",
        "bulb", "sun", "environment",
    }  # fmt: skip
    assert "wall.bsdf.reflectance" not in listed  # the checkerboard has it
    assert "teapot.bsdf.spec_trans" not in listed  # it would be another kind of material
    for name, value in listed.items():
        assert scene.with_({name: value}).sha256 == scene.sha256
    assert scene.with_(listed).sha256 == scene.sha256


@pytest.mark.parametrize("kinds", [("rectangle",), ("sphere",), ("disk",), ("rectangle", "disk")])
def test_scenes_without_some_kinds_of_shapes(kinds: tuple[str, ...]) -> None:
    shapes = {kind: {"type": kind, "bsdf": {"type": "diffuse"}} for kind in kinds}
    bare = vr.load_dict({"type": "scene", **shapes})
    for name, value in bare.parameters().items():
        assert bare.with_({name: value}).sha256 == bare.sha256


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"teapot.bsdf.rougness": 1}, 'there is no parameter "teapot.bsdf.rougness".*did you mean "teapot.bsdf.roughness"'),
        ({"nothing": 1}, 'there is no parameter "nothing"; there is: '),
        ({"teapot.bsdf.spec_trans": 1}, "there is no parameter"),
        ({"wall.bsdf.reflectance": 1}, '"wall.bsdf.reflectance" is given by a texture'),
        ({"teapot.bsdf.roughness": 2}, r'"teapot.bsdf.roughness": roughness\[\d\] = 2.0 is outside \[0, 1\]'),
        ({"teapot.bsdf.roughness": float("nan")}, '"teapot.bsdf.roughness": '),
        ({"teapot.bsdf.roughness": (1, 2, 3)}, r"\(1, 2, 3\), expected a number$"),
        ({"teapot.bsdf.base_color": (1, 2)}, "expected a number or three"),
        ({"teapot.bsdf.base_color": "red"}, "expected a number or three"),
        ({"teapot.bsdf.base_color": None}, "None, expected a number or three"),
        ({"teapot.bsdf.base_color": (1, None, 0)}, r"\(1, None, 0\), expected a number or three"),
        ({3: 1}, "3 is not the name of a parameter"),
        ([("white.alpha", 1)], "is not a dictionary of names"),
    ],
)  # fmt: skip
def test_bad_changes(scene: vr.Scene, changes: Any, message: str) -> None:
    with pytest.raises(SceneError, match=message):
        scene.with_(changes)


def test_names_of_copies_and_of_files(scene: vr.Scene) -> None:
    assert pickle.loads(pickle.dumps(scene)).parameters() == scene.parameters()
    assert scene.with_(spp=3).parameters() == scene.parameters()
    assert scene.scaled(2.0).parameters()["bulb.position"] == (0.0, 0.0, 6.0)
    assert scene.with_emission_scaled(2.0).parameters()["bulb.intensity"] == (2.0, 2.0, 2.0)
    box = vr.load_file("cornell-box")
    assert {"white.reflectance", "light.emitter.radiance"} <= box.parameters().keys()
    dark = box.with_({"white.reflectance": 0}, width=8, height=8)
    bright = box.with_(width=8, height=8)
    first, second = (vr.render(one, spp=16, device="cpu").image.mean() for one in (dark, bright))
    assert first < 0.9 * second


def test_objects_without_ids() -> None:
    scene = vr.load_dict({"type": "scene", "c": {"type": "perspective"}, "s": {"type": "sphere"}})
    assert scene.parameters() == {"s.bsdf.reflectance": (0.5, 0.5, 0.5)}
    bare = vr.Scene(
        **{name: getattr(scene, name) for name in ("spheres", "camera", "film")},
        sphere_material=[0],
        reflectance=[[0.5, 0.5, 0.5]],
        light_kind=[0],
    )
    assert set(bare.parameters()) == {
        "scene.bsdf.reflectance", "light_0.intensity", "light_0.position",
    }  # fmt: skip
    assert bare.with_({"light_0.intensity": 3}).light_intensity.tolist() == [[3.0, 3.0, 3.0]]


def test_a_change_shares_what_it_does_not_change() -> None:
    """Arrays of a copy are those of the scene, its hash that of the same scene made anew."""
    scene = vr.load_dict(SCENE)
    for first in (False, True):  # the scene's own hash is known, or not
        if first:
            assert scene.sha256 == vr.load_dict(SCENE).sha256
        for name, (_, _, value) in NAMES.items():
            changed = scene.with_({name: value})
            assert changed.vertices is scene.vertices and changed.triangles is scene.triangles
            fresh = vr.Scene(**{
                field.name: getattr(changed, field.name) for field in dataclasses.fields(vr.Scene)
            })  # fmt: skip
            again = changed.with_(spp=7)
            assert changed.sha256 == fresh.sha256 == again.sha256 != scene.sha256
    with pytest.raises(SceneError, match=r"reflectance\[0\]"):
        scene._with_arrays(reflectance=np.full(scene.reflectance.shape, 2.0))
    moved = scene.scaled(2.0)
    assert moved.sha256 != scene.sha256 and moved.scaled(0.5).sha256 == scene.sha256


def test_a_thread_hashes_large_arrays(monkeypatch: pytest.MonkeyPatch) -> None:
    """The same hash; one that fails in the thread is made again; copies wait for the same thread."""
    known = vr.load_dict(SCENE).sha256
    scene = vr.load_dict(SCENE)
    scene.hash_ahead()
    assert scene._hashes_kept.maker is None  # small
    monkeypatch.setattr("veriray.scene._LARGE", 0)
    scene.hash_ahead()
    copied = scene.with_(spp=9)
    assert copied._hashes_kept is scene._hashes_kept
    assert copied.sha256 == known == pickle.loads(pickle.dumps(scene)).sha256
    other = vr.load_dict(SCENE)
    faults = [MemoryError()]
    of = vr.Scene._hash

    def failing(*arguments: Any) -> None:
        if faults:
            raise faults.pop()
        of(*arguments)

    monkeypatch.setattr(vr.Scene, "_hash", failing)
    other.hash_ahead()
    assert other.sha256 == known and not faults


def test_a_picture_does_not_wait_for_the_hash(monkeypatch: pytest.MonkeyPatch) -> None:
    """It is there before; statistics wait for the hash, and hold the scene no longer than that."""
    scene, seen = vr.load_dict(SCENE), threading.Event()
    known, of = vr.load_dict(SCENE).sha256, vr.Scene._hash

    def late(*arguments: Any) -> None:
        assert seen.wait(60)
        of(*arguments)

    monkeypatch.setattr("veriray.scene._LARGE", 0)
    monkeypatch.setattr(vr.Scene, "_hash", late)
    made = vr.render(scene, width=8, height=8, spp=1, device="cpu")
    assert made.image.shape == (8, 8, 3)
    assert scene.hash_awaited
    seen.set()
    kept = weakref.ref(scene)
    del scene
    copied = pickle.loads(pickle.dumps(made))
    assert made.stats["scene_sha256"] == copied.stats["scene_sha256"]
    assert made.stats is made.stats and list(made.stats) == list(copied.stats)
    assert len(made.stats["scene_sha256"]) == len(known)
    gc.collect()
    assert kept() is None


def ball(x: float, bsdf: Any = None, **more: Any) -> dict[str, Any]:
    held = {} if bsdf is None else {"bsdf": bsdf}
    return {"type": "sphere", "center": [x, 0, 0], **held, **more}


def diffuse(*value: float) -> dict[str, Any]:
    return {"type": "diffuse", "reflectance": rgb(*value)}


AA, BOARD_REF = {"type": "ref", "id": "aa"}, {"type": "ref", "id": "c"}
GREY = {"type": "diffuse", "id": "bb"}
TWO = {"type": "blendbsdf", "weight": 0.25, "a": diffuse(0.25, 0, 0), "b": {"type": "plastic"}}
BUMPS = {"type": "bitmap", "raw": True, "bitmap": np.full((2, 2, 3), 0.6, np.float32)}
#: Objects that hold a material.
AROUND: dict[str, Any] = {
    "first of a blend": {"type": "blendbsdf", "weight": 0.5, "a": AA, "b": GREY},
    "second of a blend": {"type": "blendbsdf", "id": "bl", "weight": 0.5, "a": GREY, "b": AA},
    "mask": {"type": "mask", "opacity": 0.25, "held": AA},
    "mask with an id": {"type": "mask", "id": "mm", "opacity": 0.25, "held": AA},
    "twosided": {"type": "twosided", "held": AA},
    "front": {"type": "twosided", "held": AA, "other": diffuse(0)},
    "back": {"type": "twosided", "held": diffuse(0), "other": AA},
    "both": {"type": "twosided", "held": AA, "other": {"type": "twosided", "held": AA}},
    "map": {"type": "normalmap", "normalmap": BUMPS, "held": AA},
    "blend of blends": {"type": "blendbsdf", "weight": 0.5, "a": TWO, "b": AA},
    "mask of a blend": {
        "type": "mask", "held": {"type": "blendbsdf", "weight": 0.5, "a": AA, "b": GREY},
    },
    "nothing": AA,
}  # fmt: skip


def with_all(**parts: Any) -> dict[str, Any]:
    return {"type": "scene", "view": {"type": "perspective"}, "sky": {"type": "constant"}, **parts}


@pytest.mark.parametrize("around", AROUND)
@pytest.mark.parametrize("first", [False, True])
def test_materials_of_several_rows_change_in_all(around: str, first: bool) -> None:
    def file(value: float) -> dict[str, Any]:
        shapes = {"l": ball(-1, AA), "r": ball(1, AROUND[around])}
        shapes = shapes if first else dict(reversed(shapes.items()))
        aa = {"type": "roughplastic", "id": "aa", "diffuse_reflectance": rgb(value, 0.5, value)}
        return with_all(aa=aa, **shapes)

    scene, other = vr.load_dict(file(0.75)), vr.load_dict(file(0.25))
    assert other.sha256 != scene.sha256
    names = [name for name in scene.parameters() if name.endswith("diffuse_reflectance")]
    assert names == ["aa.diffuse_reflectance"]
    for name in ("aa.diffuse_reflectance", "l.bsdf.diffuse_reflectance"):
        assert scene.with_({name: (0.25, 0.5, 0.25)}).sha256 == other.sha256
    for name, value in scene.parameters().items():
        assert scene.with_({name: value}).sha256 == scene.sha256


#: A scene by one number, a name for it, and its values before and after.
USES: dict[str, Any] = {
    "opacity of all of a blend": (
        lambda v: {"l": ball(0, {"type": "mask", "opacity": v, "held": TWO})},
        "l.bsdf.opacity", 0.25, 0.75,
    ),
    "opacity by the id of a mask": (
        lambda v: {
            "aa": {"type": "diffuse", "id": "aa"},
            "mm": {"type": "mask", "id": "mm", "opacity": v, "held": AA},
            "l": ball(0, {"type": "ref", "id": "mm"}), "r": ball(1, AA),
        },
        "mm.opacity", 0.25, 0.75,
    ),
    "weight": (
        lambda v: {"l": ball(0, {"type": "blendbsdf", "id": "bl", "weight": v, "a": GREY,
                                 "b": diffuse(0.25)})},
        "bl.weight", 0.25, 0.7,
    ),
    "weight by a shape": (
        lambda v: {"l": ball(0, {"type": "twosided", "held": {**TWO, "weight": v}})},
        "l.bsdf.weight", 0.25, 0.7,
    ),
    "colour and opacity": (
        lambda v: {
            "c": {"type": "checkerboard", "id": "c", "color0": rgb(v, 0.5, 0.1), "color1": 0.25},
            "l": ball(-1, {"type": "diffuse", "reflectance": BOARD_REF}),
            "r": ball(1, {"type": "mask", "opacity": BOARD_REF, "held": diffuse(0)}),
        },
        "c.color0", (0.75, 0.5, 0.1), (0.3, 0.5, 0.1),
    ),
    "opacity alone": (
        lambda v: {
            "c": {"type": "checkerboard", "id": "c", "color0": v, "color1": 0.25},
            "r": ball(1, {"type": "mask", "opacity": BOARD_REF, "held": diffuse(0)}),
        },
        "c.color0", 0.75, 0.5,
    ),
    "weight of a blend that is turned round": (
        lambda v: {
            "c": {"type": "checkerboard", "id": "c", "color0": v, "color1": 0.25},
            "r": ball(1, {"type": "blendbsdf", "weight": BOARD_REF, "a": TWO, "b": diffuse(0)}),
        },
        "c.color0", 0.75, 0.5,
    ),
    "colour and opacity in order": (
        lambda v: {
            "c": {"type": "checkerboard", "id": "c", "color0": v, "color1": 0.25, "in_order": True},
            "l": ball(-1, {"type": "diffuse", "reflectance": BOARD_REF}),
            "r": ball(1, {"type": "mask", "opacity": BOARD_REF, "held": diffuse(0)}),
        },
        "c.color0", 0.75, 0.5,
    ),
    "opacity alone in order": (
        lambda v: {
            "c": {"type": "checkerboard", "id": "c", "color0": v, "color1": 0.25, "in_order": True},
            "r": ball(1, {"type": "mask", "opacity": BOARD_REF, "held": diffuse(0)}),
        },
        "c.color0", 0.75, 0.5,
    ),
    "weight in order of a blend that is turned round": (
        lambda v: {
            "c": {"type": "checkerboard", "id": "c", "color0": v, "color1": 0.25, "in_order": True},
            "r": ball(1, {"type": "blendbsdf", "weight": BOARD_REF, "a": TWO, "b": diffuse(0)}),
        },
        "c.color0", 0.75, 0.5,
    ),
    "colour and lamp": (
        lambda v: {
            "c": {"type": "checkerboard", "id": "c", "color0": v, "color1": 0.25},
            "l": ball(-1, {"type": "diffuse", "reflectance": BOARD_REF}),
            "r": {"type": "rectangle", "e": {"type": "area", "radiance": BOARD_REF}},
        },
        "c.color0", 0.75, 0.5,
    ),
    "colours of two materials": (
        lambda v: {
            "c": {"type": "checkerboard", "id": "c", "color0": 0.25, "color1": v},
            "l": ball(-1, {"type": "diffuse", "reflectance": BOARD_REF}),
            "r": ball(1, {"type": "roughplastic", "diffuse_reflectance": BOARD_REF}),
        },
        "c.color1", 0.75, 0.5,
    ),
    "inside of two shapes": (
        lambda v: {
            "m": {"type": "homogeneous", "id": "m", "sigma_t": v},
            "l": ball(-1, {"type": "null"}, interior={"type": "ref", "id": "m"}),
            "r": ball(1, {"type": "dielectric"}, interior={"type": "ref", "id": "m"}),
        },
        "m.sigma_t", 1.0, 0.25,
    ),
}  # fmt: skip


@pytest.mark.parametrize("use", USES)
def test_objects_of_several_rows_change_in_all(use: str) -> None:
    make, name, old, new = USES[use]
    one = (lambda v: v[0]) if np.ndim(old) else (lambda v: v)
    scene, other = (vr.load_dict(with_all(**make(one(value)))) for value in (old, new))
    assert scene.with_({name: new}).sha256 == other.sha256 != scene.sha256
    listed = scene.parameters()
    assert np.allclose(listed[name], old, rtol=1e-6)
    for key, value in listed.items():
        assert scene.with_({key: value}).sha256 == scene.sha256


def test_numbers_that_have_no_name() -> None:
    lamp = {"type": "area", "radiance": {"type": "checkerboard"}}
    scene = vr.load_dict(with_all(l={"type": "rectangle", "e": lamp}))
    assert "l.emitter.radiance" not in scene.parameters()
    with pytest.raises(SceneError, match="given by a texture"):
        scene.with_({"l.emitter.radiance": 1})
    three = {"type": "blendbsdf", "weight": 0.5, "b": AA,
             "a": {"type": "blendbsdf", "weight": 0.5, "a": diffuse(0.25), "b": {"type": "plastic"}}}  # fmt: skip
    scene = vr.load_dict(
        with_all(aa={"type": "diffuse", "id": "aa"}, l=ball(0, three), r=ball(1, AA))
    )
    assert "aa.reflectance" not in scene.parameters()
    for name in ("aa.reflectance", "r.bsdf.reflectance"):
        with pytest.raises(SceneError, match="a blend of more than two"):
            scene.with_({name: 0.25})
    masks = {
        "type": "mask",
        "id": "out",
        "opacity": 0.5,
        "held": {"type": "mask", "id": "in", "held": GREY},
    }
    scene = vr.load_dict(with_all(l=ball(0, masks)))
    assert not {"in.opacity", "out.opacity", "l.bsdf.opacity"} & scene.parameters().keys()


#: What a shape shows, without an id, and a number of it that is made of several.
PRODUCTS: dict[str, Any] = {
    "mask in a mask": (
        lambda v: {"type": "mask", "opacity": v,
                   "held": {"type": "mask", "opacity": 0.25, "held": GREY}},
        "opacity",
    ),
    "mask in a blend in a mask": (
        lambda v: {"type": "mask", "opacity": v,
                   "held": {"type": "blendbsdf", "weight": 0.5,
                            "a": {"type": "mask", "opacity": 0.25, "held": GREY},
                            "b": diffuse(0.125)}},
        "opacity",
    ),
    "mean of two": (
        lambda v: {"type": "blendbsdf", "weight": 0.5,
                   "a": {"type": "blendbsdf", "weight": 0.5, "a": diffuse(v),
                         "b": diffuse(0.125)},
                   "b": {"type": "conductor"}},
        "reflectance",
    ),
    "metal and black": (
        lambda v: {"type": "blendbsdf", "weight": 0.5,
                   "a": {"type": "blendbsdf", "weight": 0.5,
                         "a": {"type": "conductor", "specular_reflectance": v},
                         "b": diffuse(0.0)},
                   "b": diffuse(0.5)},
        "specular_reflectance",
    ),
}  # fmt: skip


@pytest.mark.parametrize("use", PRODUCTS)
@pytest.mark.parametrize("named", [False, True], ids=["held", "by id"])
def test_numbers_made_of_several_have_no_name(use: str, named: bool) -> None:
    make, key = PRODUCTS[use]
    one, other = (
        vr.load_dict(with_all(**({"m": make(v), "l": ball(0, ref("m"))} if named
                                 else {"l": ball(0, make(v))})))
        for v in (0.5, 0.75)
    )  # fmt: skip
    assert one.sha256 != other.sha256
    name = f"l.bsdf.{key}"
    assert name not in one.parameters()
    with pytest.raises(SceneError, match=f'"{name}" is also a '):
        one.with_({name: 0.75})
    for key, value in one.parameters().items():
        assert one.with_({key: value}).sha256 == one.sha256


def ref(name: str) -> dict[str, Any]:
    return {"type": "ref", "id": name}


#: Factors of other numbers, which hold a name: scenes by one number, and that name.
MASK = {"type": "mask", "id": "mm", "held": diffuse(0.25)}
FACTORS: dict[str, Any] = {
    "mask in a mask": (
        lambda v: {
            "mm": {**MASK, "opacity": v},
            "l": ball(0, ref("mm")),
            "r": ball(1, {"type": "mask", "opacity": 0.5, "held": ref("mm")}),
        },
        "mm.opacity",
    ),
    "mask around a mask": (
        lambda v: {
            "r": ball(1, {"type": "mask", "id": "out", "opacity": v, "held": MASK}),
        },
        "out.opacity",
    ),
    "mask without an id": (
        lambda v: {
            "bm": {"type": "bumpmap", "id": "bm", "height": {"type": "bitmap", "raw": True,
                                                                  "data": np.zeros((2, 2, 1), np.float32)},
                   "held": {"type": "mask", "opacity": v, "held": diffuse(0.25)}},
            "l": ball(0, ref("bm")),
            "r": ball(1, {"type": "mask", "opacity": 0.5, "held": ref("bm")}),
        },
        "bm.opacity",
    ),
    "blend without an id": (
        lambda v: {
            "ts": {"type": "twosided", "id": "ts", "held": {**TWO, "weight": v}},
            "l": ball(0, ref("ts")),
            "r": ball(1, {"type": "blendbsdf", "weight": 0.3, "a": {"type": "conductor"},
                          "b": ref("ts")}),
        },
        "ts.weight",
    ),
    **{
        f"blend of weight {weight} in a blend, {'first' if first else 'second'}": (
            lambda v, weight=weight, first=first: {
                "bl": {"type": "blendbsdf", "id": "bl", "weight": weight if v == 0.5 else v,
                       "a": diffuse(0.25), "b": {"type": "plastic"}},
                "l": ball(0, ref("bl")),
                "r": ball(1, {
                    "type": "blendbsdf", "weight": 0.3,
                    **({"a": ref("bl"), "b": {"type": "conductor"}} if first else
                       {"a": {"type": "conductor"}, "b": ref("bl")}),
                }),
            },
            "bl.weight",
        )
        for weight, first in ((0.5, True), (0.5, False), (0.0, True), (1.0, True))
    },
    "what is left of a blend becomes one with the same bsdf": (
        lambda v: {
            "aa": {"type": "diffuse", "id": "aa"},
            "bl": {"type": "blendbsdf", "id": "bl", "weight": 0.0 if v == 0.5 else v, "a": AA,
                   "b": {"type": "plastic"}},
            "r": ball(1, {"type": "blendbsdf", "weight": 0.3,
                          "a": {"type": "blendbsdf", "weight": 0.5, "a": AA,
                                "b": {"type": "conductor"}},
                          "b": ref("bl")}),
            "l": ball(0, ref("bl")),
        },
        "bl.weight",
    ),
}  # fmt: skip


@pytest.mark.parametrize("use", FACTORS)
def test_factors_of_other_numbers_have_no_name(use: str) -> None:
    make, name = FACTORS[use]
    scene = vr.load_dict(with_all(**make(0.5)))
    assert vr.load_dict(with_all(**make(0.75))).sha256 != scene.sha256
    assert name not in scene.parameters()
    words = "a factor of other numbers: of nested masks, or of a blend of more than two bsdfs"
    with pytest.raises(SceneError, match=f'"{name}" is also {words}'):
        scene.with_({name: 0.75})
    for key, value in scene.parameters().items():
        assert scene.with_({key: value}).sha256 == scene.sha256


def test_colours_within_factors_keep_their_names() -> None:
    make, _ = FACTORS["mask in a mask"]
    scene = vr.load_dict(with_all(**make(0.5)))
    assert scene.parameters()["mm.reflectance"] == (0.25, 0.25, 0.25)
    changed = scene.with_({"mm.reflectance": 0.75})
    assert np.count_nonzero(changed.reflectance == 0.75) == 6
    for shape in ("l", "r"):
        with pytest.raises(SceneError, match="factor"):
            scene.with_({f"{shape}.bsdf.opacity": 0.75})


@pytest.mark.parametrize("shape", ["cube", "rectangle", "sphere", "disk", "cylinder"])
def test_anisotropy_from_none(shape: str) -> None:
    """It depends on texture coordinates, which are there although nothing reads them before."""
    one, other = (
        vr.load_dict(with_all(s={"type": shape, "bsdf": {"type": "principled", "anisotropic": x}}))
        for x in (0.0, 0.75)
    )
    changed = one.with_({"s.bsdf.anisotropic": 0.75})
    assert changed.sha256 == other.sha256 != one.sha256
    given: dict[str, Any] = {"width": 4, "height": 4, "spp": 1, "device": "cpu"}
    assert vr.render(changed, **given).film_sha256 == vr.render(other, **given).film_sha256


def test_a_sky_from_none_is_hidden() -> None:
    def file(radiance: float) -> vr.Scene:
        return vr.load_dict({
            "type": "scene", "integrator": {"type": "path", "hide_emitters": True},
            "view": {"type": "perspective"}, "bulb": {"type": "point"},
            "sky": {"type": "constant", "radiance": radiance}, "l": ball(3),
        })  # fmt: skip

    dark = file(0.0)
    changed = dark.with_({"environment.radiance": 0.5})
    assert changed.sha256 == file(0.5).sha256
    assert not vr.render(changed, 4, width=2, height=2, device="cpu").image.any()
    assert dark.with_(hide_emitters=False).sha256 == dark.sha256  # there is nothing to hide


def test_the_same_names_after_a_change_of_anisotropy(scene: vr.Scene) -> None:
    """Either alpha or both of its axes are listed; all three are names."""
    brushed = scene.with_({"white.alpha_u": 0.5})
    assert "white.alpha" not in brushed.parameters()
    assert brushed.parameters()["white.alpha_v"] == scene.parameters()["white.alpha"]
    assert brushed.with_(scene.parameters()).sha256 == scene.sha256
    assert scene.with_(brushed.parameters()).sha256 == brushed.sha256
