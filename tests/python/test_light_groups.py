"""Light groups and indirect light: parts of a picture that add up to it, with their own errors."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt
import OpenEXR
import pytest
import trimesh

import veriray as vr
from veriray import cli, image
from veriray.device import survey
from veriray.light_groups import lamps, resolved

Array = npt.NDArray[Any]
DEVICES = [device.name for device in survey()[0]]
#: Many lamps; lamps with textures, hidden, in media and mirrored; skies; paths that pass through.
SCENES = [
    "spheres_300", "textured_lamps", "projected_images", "hidden_light", "image_sky", "spot_light",
    "lamp_in_medium", "near_lamps", "cylinders", "mask", "thin_sheets", "smoke", "null_medium",
    "mitchell", "mesh_light",
]  # fmt: skip
SIZE: dict[str, Any] = {"width": 16, "height": 12}


def load(name: str) -> vr.Scene:
    return vr.load_file(Path(vr.__file__).parent / "scenes" / "checks" / f"{name}.xml")


def room(**more: Any) -> vr.Scene:
    """A floor with a glass ball under two lamps, a point and a dim sky."""
    floor = np.array([[9.0, 0, 0, 0], [0, 0, 1, -1], [0, -9, 0, 0], [0, 0, 0, 1]])
    panel = np.array([[1.0, 0, 0, 2], [0, 0, -1, 3], [0, 1, 0, 0], [0, 0, 0, 1]])
    warm, cold = ({"type": "rgb", "value": v} for v in ([9.0, 3.0, 1.0], [1.0, 3.0, 9.0]))
    return vr.load_dict({
        "type": "scene", "integrator": {"type": "path", "max_depth": 6},
        "sensor": {
            "type": "perspective", "fov": 50.0, "film": {"type": "hdrfilm", **SIZE},
            "to_world": vr.Camera.look_at([0, 1, -6], [0, 0, 0], fov=50).to_world,
        },
        "sky": {"type": "constant", "radiance": 0.3},
        "floor": {"type": "rectangle", "to_world": floor},
        "glass": {"type": "sphere", "center": [1.0, 0.0, 0.0], "radius": 0.8,
                  "bsdf": {"type": "dielectric"}},
        "lamp_a": {"type": "sphere", "center": [-2.0, 2.0, 0.0], "radius": 0.3,
                   "emitter": {"type": "area", "radiance": warm}},
        "lamp_b": {"type": "rectangle", "to_world": panel,
                   "emitter": {"type": "area", "id": "panel", "radiance": cold}},
        "bulb": {"type": "point", "position": [0.0, 3.0, -3.0], "intensity": 5.0}, **more,
    })  # fmt: skip


GROUPS = {"key": "lamp_*", "fill": ["bulb", "sky"]}


def close(parts: list[Array], whole: Array) -> None:
    """Each sample is a sum of float32 numbers in another order: 2^-20 is 16 roundings."""
    total = np.sum(parts, axis=0, dtype=np.float64)
    assert np.abs(total - whole).max() > 0 or len(parts) == 1
    assert (np.abs(total - whole) <= 2.0**-20 * np.abs(whole)).all()


# ---- the parts of a picture ----


@pytest.mark.parametrize("name", SCENES)
def test_groups_add_up_to_the_picture(name: str, device: str) -> None:
    scene = load(name)
    given = {**SIZE, "spp": 16, "device": device, "seed": 3}
    got = vr.render(scene, **given, features="direct,indirect", light_groups="*")
    assert got.film_sha256 == vr.render(scene, **given).film_sha256
    groups = [name for name in got.features if name.startswith("light.")]
    assert len(groups) == len(lamps(scene)) == len(got.features.lamps)
    close([got.features[name] for name in groups], got.image)
    if name == "mitchell":  # whose weights are negative too
        return
    close([got.features["direct"], got.features["indirect"]], got.image)
    for name in (*groups, "direct", "indirect"):
        assert (got.features[name] >= 0).all() and got.features[name].any()


@pytest.mark.parametrize("weight", [0.9, 0.1])
def test_parts_of_what_light_passes_straight_on(weight: float, device: str) -> None:
    """Light samples at a blend count for the path, also where it goes straight on after them."""
    veil = {
        "type": "blendbsdf", "weight": weight, "a": {"type": "null"},
        "b": {"type": "twosided", "inner": {"type": "diffuse"}},
    }  # fmt: skip
    scene = room(veil={"type": "sphere", "center": [-1.0, 0.0, -1.0], "bsdf": veil})
    given = {**SIZE, "spp": 64, "device": device, "seed": 3}
    got = vr.render(scene, **given, features="direct,indirect", light_groups="*")
    close([got.features["direct"], got.features["indirect"]], got.image)
    close([got.features[name] for name in got.features if name[:6] == "light."], got.image)


def test_each_group_is_the_scene_without_the_other_lamps() -> None:
    """Means over the picture against scenes whose other lamps are black, which choose lights in
    other ways: 6 numbers within 5 standard errors, a false alarm in 290,000 seeds. The smallest
    bias that is seen: 5 of these, below 1.5 %."""
    scene, spp = room(), 1 << 16
    got = vr.render(scene, spp, light_groups=GROUPS, device="cpu").features
    point, sky, a, b = ("bulb.intensity", "environment.radiance", "lamp_a.emitter.radiance",
                        "panel.radiance")  # fmt: skip
    for group, dark in (("key", (point, sky)), ("fill", (a, b))):
        other = vr.render(scene.with_(dict.fromkeys(dark, 0.0)), spp, seed=9, device="cpu")
        error = [np.sqrt((x**2).sum((0, 1), dtype=np.float64)) / x[..., 0].size
                 for x in (got.stderr[f"light.{group}"], other.stderr)]  # fmt: skip
        off = got[f"light.{group}"].mean((0, 1)) - other.image.mean((0, 1))
        assert (np.abs(off) < 5 * np.hypot(*error)).all()
        assert (5 * np.hypot(*error) < 0.015 * other.image.mean((0, 1))).all()


def test_errors_are_those_over_seeds() -> None:
    """400 seeds: the relative error of a variance is sqrt((2 + excess) / 399), 0.07 for a normal
    one; with 16 pixels averaged and heavy tails 0.06. Within 5 of these, a factor of 1.3; the upper
    limit that picture and direct light give for `indirect` is off by more than 2."""
    scene = room().with_(width=4, height=4)
    names = ("light.key", "light.fill", "indirect")
    runs = [vr.render(scene, 64, seed, device="cpu", features="direct,indirect",
                      light_groups=GROUPS) for seed in range(400)]  # fmt: skip
    for name in names:
        spread = np.array([r.features[name] for r in runs], float).var(0, ddof=1)
        stated = np.array([r.features.stderr[name] for r in runs], float) ** 2
        assert 1 / 1.3 < spread.sum() / stated.mean(0).sum() < 1.3, name
    bound = np.array([r.stderr + r.features.stderr["direct"] for r in runs], float) ** 2
    assert bound.mean(0).sum() > 2 * spread.sum()


def test_the_same_bits_everywhere() -> None:
    scene, first = room(), None
    given: dict[str, Any] = {"spp": 8, "features": "direct,indirect", "light_groups": GROUPS}
    for device in DEVICES:
        for scheduler in ("fused", "wavefront", "thrust"):
            for threads in (1, 3):
                got = vr.render(scene, **given, device=device, scheduler=scheduler, threads=threads)
                data = {name: x.tobytes() for name, x in got.features.channels().items()}
                first = first or data
                assert data == first, (device, scheduler)
    both = vr.render(scene, **given, device=["cpu", "cpu"], threads=2)
    assert {name: x.tobytes() for name, x in both.features.channels().items()} == first


def test_the_tree_of_a_large_mesh_is_not_made_again(tmp_path: Path) -> None:
    mesh = trimesh.creation.icosphere(subdivisions=4)
    mesh.export(tmp_path / "ball.ply")
    ball = {"type": "ply", "filename": str(tmp_path / "ball.ply")}
    scene = room(ball=ball, glow={**ball, "emitter": {"type": "area"}})
    got = vr.render(scene, 1, device="cpu", features="indirect", light_groups="*")
    assert got.stats["tree"] and "glow" in got.features.lamps["light.glow"]
    assert len(scene.native_forms) == 7
    assert len({form.native.family for form in scene.native_forms}) == 1


def test_a_picture_that_was_stopped() -> None:
    got = vr.render(room(), 10**9, time=0.05, device="cpu", light_groups="*")
    assert got.stats["stopped"] == "time" and len(got.features.lamps) == 4
    close([got.features[name] for name in got.features], got.image)


def test_scenes_that_leave_light_out() -> None:
    """The arrays behind it: another hash, which no other scene has."""
    scene = room()
    dim = scene._with_arrays(light_muted=np.array([True]))
    assert dim.sha256 != scene.sha256
    groups = vr.render(dim, 4, device="cpu", light_groups={"a": "bulb"}).features
    assert not groups["light.a"].any() and groups["light.rest"].any()


# ---- names ----


def test_names_of_lamps() -> None:
    found = {lamp.names for lamp in lamps(room())}
    assert found == {
        ("lamp_a", "emission_0"), ("panel", "lamp_b", "emission_1"), ("bulb", "light_0"),
        ("sky", "environment"),
    }  # fmt: skip
    assert len(lamps(vr.cornell_box())) == 1


@pytest.mark.parametrize(
    "given, groups",
    [
        ("*", {"lamp_a": ["lamp_a"], "panel": ["panel"], "bulb": ["bulb"], "sky": ["sky"]}),
        ("key=lamp_b,key=light_0,sky", {"key": ["panel", "bulb"], "sky": ["sky"],
                                        "rest": ["lamp_a"]}),
        (["key=lamp_a", "all=*"], {"key": ["lamp_a"], "all": ["panel", "bulb", "sky"]}),
        ({"a": ["emission_[01]", "environment"]}, {"a": ["lamp_a", "panel", "sky"],
                                                   "rest": ["bulb"]}),
    ],
)  # fmt: skip
def test_groups(given: Any, groups: dict[str, list[str]]) -> None:
    settings = vr.settings.RenderSettings(light_groups=given)
    found = resolved(room(), [*settings.light_groups])
    assert {name: [lamp.names[0] for lamp in each] for name, each in found.items()} == groups


def test_one_emitter_of_several_shapes_and_names_that_are_no_layers(tmp_path: Path) -> None:
    file = tmp_path / "a.xml"
    sphere = '<shape type="sphere" id="{}"><point name="center" x="{}"/>{}</shape>'
    text = sphere.format("a b.c", 1, '<emitter type="area"/>')
    text += sphere.format("a b_c", 4, '<emitter type="area" id="rest"/>')
    text += sphere.format("d", 8, '<ref id="glow"/>') + sphere.format("e", 12, '<ref id="glow"/>')
    file.write_text(f'<scene version="3.0.0"><emitter type="area" id="glow"/>{text}</scene>')
    scene = vr.load_file(file)
    found = resolved(scene, ["*"])
    names = {name: each[0].names for name, each in found.items()}
    assert {n: {*names[n]} & {"glow", "d", "e", "a b.c", "a b_c"} for n in names} == {
        "glow": {"glow", "d", "e"}, "a_b_c": {"a b.c"}, "rest_2": {"a b_c"}
    }  # fmt: skip


@pytest.mark.parametrize(
    "given, message",
    [
        ("key=lamp", "no lamp is called 'lamp'; there are: bulb, lamp_a, panel, sky; did you"),
        ("a=*,b=bulb", "all that 'b=bulb' names is in other groups"),
        ("a.b=bulb", "a group cannot be called 'a.b'; expected 1 to 64 letters, digits"),
        ("rest=bulb", 'a group cannot be called \'rest\'; .*and not "rest"'),
        ("key=", "'key='; expected GROUP=LAMP or LAMP"),
        ("bulb,", "''; expected GROUP=LAMP or LAMP"),
        ({"key": []}, r"'key' = \[\] is no group of lamps"),
        ({3: "bulb"}, "3 = 'bulb' is no group of lamps"),
        (3, "light_groups = 3 is not a list of strings"),
        ([3], r"light_groups = \[3\] is not a list of strings"),
    ],
)  # fmt: skip
def test_what_is_refused(given: Any, message: str) -> None:
    with pytest.raises(ValueError, match=message):
        vr.render(room(), 1, light_groups=given, device="cpu")


def test_other_refusals() -> None:
    lamp = {"type": "sphere", "emitter": {"type": "area"}}
    with pytest.raises(ValueError, match=r"no lamp is called 'x'; there are: a\\udc80$"):
        vr.render(vr.load_dict({"type": "scene", "a\udc80": lamp}), 1, light_groups=["x"])
    with pytest.raises(ValueError, match="light_groups: not together with target_error"):
        vr.render(room(), 64, light_groups="*", target_error=0.1)
    for given in ({"light_groups": "*"}, {"motion_to": room().camera}):
        with pytest.raises(ValueError, match="light_groups, motion_to are settings of veriray.re"):
            vr.Accumulation(room(), **given)
    with pytest.raises(ValueError, match="images: 'light.a.b' is none of"):
        vr.FeatureImages({"light.a.b": np.ones((1, 1, 3), np.float32)})
    with pytest.raises(ValueError, match="lamps = 3 is not a mapping"):
        vr.FeatureImages(lamps=3)  # type: ignore[arg-type]


# ---- files and commands ----


def test_files(tmp_path: Path) -> None:
    got, path = vr.render(room(), 4, light_groups=GROUPS, device="cpu"), tmp_path / "a.exr"
    got.save(path)
    with OpenEXR.File(str(path), separate_channels=True) as file:
        names = {*file.channels()}
    assert {"light.key.R", "light.fill.B", "stderr.light.key.G"} <= names
    again = image.load(path)
    assert again.features.lamps == {"light.key": ("lamp_a", "panel"), "light.fill": ("bulb", "sky")}
    for name, values in got.features.items():
        assert np.array_equal(again.features[name], values)
        assert np.array_equal(again.features.stderr[name], got.features.stderr[name])


@pytest.mark.parametrize("text", ["[]", '{"light.key": 3}', '{"light.key": [3]}', "{"])
def test_files_that_say_something_else(text: str, tmp_path: Path) -> None:
    got, path = vr.render(room(), 1, light_groups=GROUPS, device="cpu"), tmp_path / "a.exr"
    got.save(path)
    with OpenEXR.File(str(path)) as file:
        header = {k: v for k, v in file.header().items() if k != "channels"}
        channels = file.channels()
        OpenEXR.File({**header, "veriray.light_groups": text}, channels).write(str(path))
    with pytest.raises(vr.ImageError, match="veriray.light_groups"):
        image.load(path)


def test_command(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    out = str(tmp_path / "a.exr")
    given = ["render", "open", "--width", "8", "--height", "6", "--spp", "2", "--device", "cpu"]
    assert cli.main([*given, "-o", out, "--light-groups", "lit=emission_0"]) == 0
    assert "features   light.lit, light.rest" in capsys.readouterr().out
    assert {*image.load(out).features.lamps} == {"light.lit", "light.rest"}
    assert cli.main([*given, "-o", out, "--light-groups", "no=such"]) != 0
    assert "light_groups: no lamp is called 'such'" in capsys.readouterr().err
    assert cli.main([*given, "-o", str(tmp_path / "a.png"), "--light-groups", "*"]) != 0
    assert "--light-groups needs an output FILE.exr" in capsys.readouterr().err


def test_dataset(tmp_path: Path) -> None:
    scene = room()
    given: dict[str, Any] = {"cameras": [scene.camera], "spp": 2, "device": "cpu"}
    vr.dataset(scene, tmp_path, **given, light_groups="*")
    vr.dataset(scene, tmp_path, **given, light_groups="*")
    with pytest.raises(vr.ImageError, match="other light groups"):
        vr.dataset(scene, tmp_path, **given, light_groups=GROUPS)
