"""The viewer without its server: cameras, controls, pictures for the eye, the render thread."""

from __future__ import annotations

import dataclasses
import io
import json
import math
import shutil
import threading
import time
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import trimesh
from PIL import Image

import veriray as vr
from tests.viewers import done, rendering, wait
from veriray import native_scene
from veriray.camera import Camera, Film
from veriray.saving import to_srgb8
from veriray.viewer import display, moves
from veriray.viewer import renderer as renderer_module
from veriray.viewer.controls import (
    Action,
    ControlError,
    View,
    applied,
    parse,
    reach,
)
from veriray.viewer.source import Source

SMALL = {"width": 40, "height": 30, "spp": 24}
UP = np.array([0.0, 1.0, 0.0])


def do(what: str, **numbers: float) -> Any:
    return parse(json.dumps({"do": what, **numbers}))


def set_(name: str, value: Any) -> Any:
    return parse(json.dumps({"do": "set", "name": name, "value": value}))


@pytest.fixture
def camera() -> Camera:
    return Camera.look_at([1, 2, -5], [0.5, 1, 0], fov=50)


# ---- cameras ----


def test_orbit_keeps_what_is_ahead(camera: Camera) -> None:
    centre = moves.position(camera) + 3.0 * moves.forward(camera)
    for yaw, pitch in ((0.3, 0.2), (-2.0, -0.5), (0.0, 1.0), (5.0, 0.0)):
        camera = moves.orbited(camera, yaw, pitch, UP, 3.0)
        ahead = moves.position(camera) + 3.0 * moves.forward(camera)
        assert np.abs(ahead - centre).max() < 1e-12


def test_directions_of_moves(camera: Camera) -> None:
    left, top = camera.to_world[:3, 0], camera.to_world[:3, 1]
    assert np.dot(moves.forward(moves.turned(camera, 0.1, 0.0, UP)), left) > 0.05
    assert np.dot(moves.forward(moves.turned(camera, 0.0, 0.1, UP)), top) > 0.05
    moved = moves.position(moves.shifted(camera, 1.0, 2.0, 3.0)) - moves.position(camera)
    assert np.allclose(moved, left + 2 * top + 3 * moves.forward(camera))
    mirrored = dataclasses.replace(camera, to_world=camera.to_world @ np.diag([-1.0, 1, 1, 1]))
    turned = moves.turned(mirrored, 0.1, 0.0, UP)
    assert np.dot(moves.forward(turned), mirrored.to_world[:3, 0]) > 0.05
    assert np.linalg.det(turned.to_world[:3, :3]) < 0


def test_thousands_of_moves_stay_rigid(camera: Camera) -> None:
    rng = np.random.default_rng(1)
    for yaw, pitch in rng.normal(0, 0.3, (3000, 2)):
        camera = moves.orbited(camera, yaw, pitch, UP, 2.0)
        axes = camera.to_world[:3, :3]
        assert np.abs(axes.T @ axes - np.eye(3)).max() < 1e-12
        assert abs(axes[1, 0]) < 1e-12  # it leans to no side
        assert abs(moves.forward(camera)[1]) <= math.sin(moves.STEEPEST) + 1e-12


def test_straight_down() -> None:
    down = Camera.look_at([0, 9, 0], [0, 0, 0], up=[0, 0, 1])
    turned = moves.orbited(down, 0.0, -0.1, UP, 9.0)
    assert np.isfinite(turned.to_world).all()
    assert np.dot(turned.to_world[:3, 1], [0, 0, 1]) > 0.9  # its top stays its top


@pytest.mark.parametrize(("up", "axis"), [((0, 1, 0), UP), ((0, 0, 1), [0, 0, 1])])
def test_up_axis(up: tuple[float, ...], axis: Any) -> None:
    camera = Camera.look_at([3, 3, 3], [0, 0.0, 0], up=up)
    assert np.array_equal(moves.up_axis(camera), axis)
    leaning = Camera.look_at([3, 3, 3], [0, 0.0, 0], up=(0.3, 1, 0))
    assert np.array_equal(moves.up_axis(leaning), leaning.to_world[:3, 1])


def test_orthographic_cameras_zoom_by_scale() -> None:
    camera = Camera.orthographic(Camera.look_at([0, 0, -5], [0, 0, 0]).to_world @ np.diag(
        [2.0, 2.0, 1.0, 1.0]))  # fmt: skip
    film = Film(80, 40)
    closer, distance = moves.zoomed(camera, 0.5, 5.0)
    assert distance == 5.0 and moves.visible_height(camera, film, 5.0) == 2.0
    assert moves.visible_height(closer, film, 5.0) == 1.0
    turned = moves.orbited(camera, 0.4, 0.1, UP, 5.0)
    assert np.allclose(moves.scales(turned), [2, 2, 1])
    origin, direction, depth = moves.ray(camera, film, 0.0, 0.0)
    assert np.allclose(origin - moves.position(camera), 2 * camera.placed[:3, 0] + UP)
    assert np.allclose(direction, moves.forward(camera)) and depth == 1.0


def test_rays_are_those_of_the_picture(camera: Camera) -> None:
    """The ray through a pixel's middle hits what a pinhole's replayed path hits, to a pixel."""
    scene = vr.cornell_box().with_(width=64, height=48)
    for x, y in ((5, 7), (60, 40), (31, 10)):
        vertex = vr.trace_path(scene, x, y, 0, max_depth=2)[0]
        origin, direction, _ = moves.ray(scene.camera, scene.film, (x + 0.5) / 64, (y + 0.5) / 48)
        offset = np.asarray(vertex["position"]) - origin
        sine = np.linalg.norm(np.cross(offset, direction)) / np.linalg.norm(offset)
        assert sine < 1.5 * 2 * scene.camera.tan_half_x(64, 48) / 64


# ---- controls ----


@pytest.mark.parametrize(
    "message",
    [
        "", "null", "[]", "{}", "[" * 4000, "{" * 3000, '{"do":"quit"}', '{"do":["set"]}',
        b"\x00\xff", "x" * 4097, '{"do":"orbit"}', '{"do":"orbit","x":"1","y":0}',
        '{"do":"orbit","x":NaN,"y":0}', '{"do":"orbit","x":1e999,"y":0}',
        '{"do":"orbit","x":true,"y":0}', '{"do":"focus","x":2,"y":0}', '{"do":"set"}',
        '{"do":"set","name":"camera","value":1}', '{"do":"set","name":"__init__","value":1}',
        '{"do":"set","name":"spp","value":0}', '{"do":"set","name":"spp","value":1.5}',
        '{"do":"set","name":"sampler","value":"halton"}',
        '{"do":"set","name":"fov","value":180}', '{"do":"set","name":"fov","value":null}',
        '{"do":"set","name":"exposure","value":"bright"}',
        '{"do":"set","name":"channel","value":"__class__"}',
        '{"do":"set","name":"seed","value":-1}',
    ],
)  # fmt: skip
def test_nonsense_is_refused(message: str | bytes) -> None:
    with pytest.raises(ControlError):
        parse(message)


def test_settings_are_the_scenes_until_they_are_set() -> None:
    scene = vr.cornell_box()
    view = View()
    assert view.scene(scene).sha256 == scene.sha256
    view = applied(view, set_("max_depth", 3), scene)
    assert view.scene(scene).max_depth == 3 and view.picture() != View().picture()
    assert applied(view, set_("max_depth", None), scene) == View()
    view = applied(view, set_("fov", 20.0), scene)
    assert view.scene(scene).camera.fov == 20.0 and scene.camera.fov != 20.0
    bright = applied(view, set_("exposure", 2), scene)
    assert bright.picture() == view.picture() and bright.shown() != view.shown()
    assert applied(view, set_("spp", 7), scene).picture() == view.picture()
    assert applied(bright, do("reset"), scene) == View(exposure=2.0, max_depth=3)


def test_a_film_may_not_be_huge() -> None:
    scene = vr.cornell_box()
    with pytest.raises(ControlError, match="16777216 pixels"):
        applied(View(), set_("width", 1 << 20), scene)
    large = View(width=1 << 13, height=1 << 13)  # of the command line
    assert applied(large, set_("max_depth", 2), scene).max_depth == 2


def test_focus_and_aperture() -> None:
    scene = vr.cornell_box()
    view = applied(View(), do("focus", x=0.5, y=0.5), scene, 700.0)
    assert view.camera is None and view.distance == 700.0  # nothing to see of it
    view = applied(view, set_("aperture_radius", 10.0), scene)
    assert view.camera is not None and view.camera.focus_distance == 700.0
    view = applied(view, do("focus", x=0.5, y=0.5), scene, 900.0)
    assert view.camera is not None and view.camera.focus_distance == 900.0
    assert applied(view, do("focus", x=0.5, y=0.5), scene, None) == view


def test_moves_of_a_view() -> None:
    scene = vr.cornell_box()
    view = View(distance=1000.0)
    nearer = applied(view, do("zoom", x=math.log(0.5)), scene)
    assert nearer.distance == pytest.approx(500.0)
    assert nearer.camera.to_world[2, 3] == pytest.approx(scene.camera.to_world[2, 3] + 500)
    flown = applied(view, do("fly", x=0, y=0, z=0.1), scene)
    assert flown.camera.to_world[2, 3] == pytest.approx(scene.camera.to_world[2, 3] + 100)
    panned = applied(view, do("pan", x=0, y=1), scene)
    height = 2000 * scene.camera.tan_half_y(512, 512)
    assert panned.camera.to_world[1, 3] - scene.camera.to_world[1, 3] == pytest.approx(height)
    assert applied(view, do("orbit", x=0.1, y=0), scene).distance == 1000.0
    assert do("orbit", x=0, y=0).moves and set_("fov", 30).moves and not set_("seed", 3).moves


def test_reach_without_anything_ahead() -> None:
    assert 300 < reach(vr.cornell_box()) < 2000


# ---- pictures for the eye ----


@pytest.mark.parametrize("exposure", [0.0, -3.3, 5.1])
def test_tone_table(exposure: float) -> None:
    rng = np.random.default_rng(2)
    image = np.exp(rng.normal(-2, 3, (80, 90, 3))).astype(np.float32)
    image[0, 0] = 0, 1, 1e20
    odd = np.array([[[np.inf, np.nan, -1]]], np.float32)
    assert display.tone_mapped(odd, exposure).tolist() == [[[255, 0, 0]]]
    fast = display.tone_mapped(image, exposure).astype(int)
    exact = to_srgb8(image, exposure).astype(int)
    assert np.abs(fast - exact).max() <= 1 and (fast != exact).mean() < 0.05
    assert np.array_equal(display.exact_bytes(image, exposure, "standard"), exact)


@pytest.mark.parametrize("curve", display.CURVES)
def test_curves(curve: str) -> None:
    x = np.concatenate([[0.0], np.logspace(-6, 8, 500)])
    y = display.CURVES[curve](x)
    assert y[0] == pytest.approx(0, abs=1e-12) and y[-1] >= 0.999 and (np.diff(y) >= -1e-12).all()
    image = np.exp(np.random.default_rng(3).normal(-1, 3, (50, 50, 3))).astype(np.float32)
    fast = display.tone_mapped(image, 0.5, curve).astype(int)
    assert np.abs(fast - display.exact_bytes(image, 0.5, curve)).max() <= 1


def test_files_are_made_while_others_work(monkeypatch: pytest.MonkeyPatch) -> None:
    """Pillow keeps Python's lock as long as it writes to anything but a file of the system."""
    saved = Image.Image.save

    def save(image: Any, file: Any, **options: Any) -> None:
        assert file.fileno() > 2
        saved(image, file, **options)

    monkeypatch.setattr(Image.Image, "save", save)
    for quality in (None, 80, 92):
        assert display.encoded(np.zeros((9, 9, 3), np.uint8), quality)[1]


def test_false_colours() -> None:
    colours = display.false_colours(np.array([[1e-3, 1.0, 1e-9, 7.0, np.nan]]), 1e-3, 1.0)[0]
    ends = [tuple(int(c[i : i + 2], 16) for i in (1, 3, 5)) for c in display.COLOURS]
    assert tuple(colours[0]) == tuple(colours[2]) == ends[0]
    assert tuple(colours[1]) == tuple(colours[3]) == ends[-1]
    assert tuple(colours[4]) == (64, 64, 64)


def test_relative_error_channel() -> None:
    scene = vr.cornell_box().with_(width=32, height=24)
    render = vr.render(scene, 64, device="cpu")
    error = display.relative_error(render)
    brighter = vr.render(scene.with_emission_scaled(1024.0), 64, device="cpu")
    assert np.array_equal(error, display.relative_error(brighter))
    more = display.relative_error(vr.render(scene, 1024, device="cpu"))
    assert 2.5 < np.median(error) / np.median(more) < 6.0  # 4, by the square root of 16
    assert np.isnan(display.relative_error(vr.render(scene, 1, device="cpu"))).all()


@pytest.mark.parametrize("channel", display.CHANNELS)
def test_every_channel_is_shown(channel: str) -> None:
    for spp in (1, 4):
        render = vr.render(vr.cornell_box(), spp, width=16, height=12, device="cpu")
        look = display.CHANNELS[channel].of_scene
        scene = vr.cornell_box().with_(width=16, height=12)
        made = {channel: look(scene, "cpu")} if look else {}
        pixels, legend = display.as_bytes(render, channel, 0.0, "standard", made=made)
        assert pixels.shape == (12, 16, 3) and pixels.dtype == np.uint8
        assert (legend is None) == (display.CHANNELS[channel].ends is None)
        for quality, kind, loss in ((None, "png", 0), (80, "jpeg", 25), (92, "jpeg", 10)):
            found, data = display.encoded(pixels, quality)
            read = np.asarray(Image.open(io.BytesIO(data)))
            assert found == f"image/{kind}" and read.shape == pixels.shape
            assert np.abs(read.astype(int) - pixels).mean() <= loss


# ---- the render thread ----


def test_the_picture_is_the_batch_render(device: str) -> None:
    with rendering("cornell-box", device, **SMALL) as renderer:
        frame = done(renderer)
        renderer.submit(do("orbit", x=0.3, y=-0.1))
        renderer.submit(set_("sampler", "sobol"))
        renderer.submit(set_("max_depth", 5))
        moved = done(renderer)
        view = renderer.view
    scene = vr.cornell_box()
    assert frame.render.film_sha256 == vr.render(scene, device=device, **SMALL).film_sha256
    expected = vr.render(
        scene.with_(camera=view.camera), device=device, sampler="sobol", max_depth=5, **SMALL
    )
    assert moved.render.film_sha256 == expected.film_sha256 != frame.render.film_sha256
    assert moved.render.stats["scene_sha256"] == expected.stats["scene_sha256"]


def test_a_large_scene_keeps_its_tree_while_it_moves(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """And is made anew once it rests, so that the picture is the batch render."""
    trimesh.creation.icosphere(4).export(tmp_path / "ball.ply")
    look = Camera.look_at([0, 0.2, -1.5], [0, 0, 0], fov=40).to_world
    scene = {"type": "scene", "sky": {"type": "constant"},
             "sensor": {"type": "perspective", "fov": 40.0, "to_world": look},
             "ball": {"type": "ply", "filename": str(tmp_path / "ball.ply")}}  # fmt: skip
    monkeypatch.setattr(Source, "load", lambda _: vr.load_dict(scene))
    made: list[tuple[bool, bool]] = []
    make = native_scene._make

    def making(*arguments: Any) -> Any:
        native, exact = make(*arguments)
        made.append((native.family in {form.native.family for form in arguments[-1]}, exact))
        return native, exact

    monkeypatch.setattr(native_scene, "_make", making)
    with rendering("ball.xml", **SMALL) as renderer:
        done(renderer)
        made.clear()
        renderer.submit(do("zoom", x=-0.5))
        for _ in range(3):
            renderer.submit(do("zoom", x=-0.9))
            time.sleep(0.05)
        frame = done(renderer)
        moved = vr.load_dict(scene).with_(camera=renderer.view.camera)
    assert frame.render.film_sha256 == vr.render(moved, **SMALL, device="cpu").film_sha256
    assert made[0] == (True, False) and made[-1] == (False, True)


def test_samples_are_added_and_taken_away() -> None:
    with rendering("cornell-box", **SMALL) as renderer:
        first = done(renderer)
        renderer.submit(set_("spp", 50))
        wait(lambda: renderer.frame.render.spp == 50 and renderer.frame.done)
        grown = renderer.frame
        renderer.submit(set_("spp", 10))
        wait(lambda: renderer.frame.render.spp == 10 and renderer.frame.done)
        fewer = renderer.frame
    for frame, spp in ((first, 24), (grown, 50), (fewer, 10)):
        expected = vr.render(vr.cornell_box(), **{**SMALL, "spp": spp}, device="cpu")
        assert frame.render.film_sha256 == expected.film_sha256


def test_resolution_drops_while_it_moves(monkeypatch: pytest.MonkeyPatch) -> None:
    """On a device that seems slow: few pixels during moves, then all and the right bits."""
    monkeypatch.setattr(renderer_module.Renderer, "_slow", lambda *_: False)
    monkeypatch.setattr(renderer_module.Renderer, "_factor", lambda *_: 4)
    with rendering("cornell-box", **SMALL) as renderer:
        assert done(renderer).coarse == 1
        seen = set()
        for _ in range(40):
            renderer.submit(do("orbit", x=0.02, y=0.0))
            time.sleep(0.02)
            frame = renderer.frame
            seen.add((frame.coarse, frame.render.width, frame.render.height))
        assert (4, 10, 8) in seen
        frame = done(renderer)
        expected = vr.render(vr.cornell_box().with_(camera=renderer.view.camera), **SMALL,
                             device="cpu")  # fmt: skip
        assert frame.coarse == 1 and frame.render.film_sha256 == expected.film_sha256


def test_slow_pictures_come_back_in_steps(monkeypatch: pytest.MonkeyPatch) -> None:
    """A picture that takes long has an eighth of the pixels on a side, a fourth, a half, all."""
    monkeypatch.setattr(renderer_module.Renderer, "_slow", lambda *_: True)
    monkeypatch.setattr(renderer_module.Renderer, "_factor", lambda *_: 8)
    renderer = renderer_module.Renderer(Source("cornell-box"), "cpu", view=View(**SMALL))
    seen: list[Any] = []
    renderer.changed = lambda: seen.append(renderer.frame)
    renderer.start()
    try:
        assert done(renderer).render.spp == SMALL["spp"]
    finally:
        renderer.stop()
    factors = [frame.coarse for frame in seen if frame is not None]
    assert list(dict.fromkeys(factors)) == [8, 4, 2, 1]


@pytest.mark.parametrize("slow", [renderer_module.SLOW_SECONDS, 0.01])
def test_pictures_come_while_moves_never_end(monkeypatch: pytest.MonkeyPatch, slow: float) -> None:
    """A stream of moves starves no picture that takes longer than the device's polls. slow: from
    what time of a picture a device counts as slow; the pictures here take longer than the last."""
    monkeypatch.setattr(renderer_module, "MOVING_SECONDS", 0.3)
    monkeypatch.setattr(renderer_module, "SLOW_SECONDS", slow)
    with rendering("cornell-box", width=2048, height=1536, spp=4096) as renderer:
        wait(lambda: renderer.frame)
        first, end = renderer.frame.number, time.monotonic() + 60.0
        while renderer.frame.number - first < 4:
            assert time.monotonic() < end, "moves starve the pictures"
            renderer.submit(do("orbit", x=0.001, y=0.0))
            time.sleep(0.004)


@pytest.mark.parametrize(("x", "y", "depth"), [(0.5, 0.25, 1359.2), (0.2, 0.9, None)])
def test_focus_by_click(device: str, x: float, y: float, depth: float | None) -> None:
    """The back wall of the Cornell box is at z = 559.2, the camera at -800; depth is along z."""
    with rendering("cornell-box", device, width=64, height=64, spp=2) as renderer:
        renderer.submit(set_("aperture_radius", 5.0))
        done(renderer)
        before = renderer.view.camera.focus_distance
        renderer.submit(do("focus", x=x, y=y))
        if depth is None:  # the floor: its depth depends on the place alone
            wait(lambda: renderer.view.camera.focus_distance != before)
            direction = moves.ray(renderer.file.camera, Film(64, 64), x, y)[1]
            depth = 273.0 / abs(direction[1]) * direction[2]
        wait(lambda: renderer.view.camera.focus_distance == pytest.approx(depth, rel=1e-3))
        assert done(renderer).scene.camera.focus_distance == renderer.view.camera.focus_distance


def test_a_click_on_a_pinhole_keeps_the_picture() -> None:
    with rendering("cornell-box", **SMALL) as renderer:
        number = done(renderer).number
        renderer.submit(do("focus", x=0.5, y=0.25))
        wait(lambda: renderer.view.distance == pytest.approx(1359.2, rel=1e-3))
        time.sleep(0.2)
        assert renderer.frame.number == number


def test_it_stops_in_the_middle_of_a_pass() -> None:
    with rendering("cornell-box", width=2000, height=2000, spp=100000) as renderer:
        wait(lambda: renderer.frame)
        start = time.monotonic()
        renderer.stop()
        assert time.monotonic() - start < 5.0


def test_what_cannot_be_rendered_is_said(monkeypatch: pytest.MonkeyPatch) -> None:
    with rendering("cornell-box", **SMALL) as renderer:
        done(renderer)
        real = renderer._accumulation

        def failing(*arguments: Any) -> Any:
            if arguments[1].seed == 1:
                raise vr.OutOfMemoryError("the film does not fit")
            return real(*arguments)

        monkeypatch.setattr(renderer, "_accumulation", failing)
        renderer.submit(set_("seed", 1))
        wait(lambda: "the film does not fit" in renderer.message)
        renderer.submit(set_("seed", 2))
        assert done(renderer).render.seed == 2 and renderer.message == ""


def test_channels_of_the_scene(monkeypatch: pytest.MonkeyPatch) -> None:
    """They are made on the render thread while they are shown, once for each view and size."""
    made: list[tuple[int, int]] = []

    def columns(scene: vr.Scene, device: str) -> Any:
        assert threading.current_thread().name == "veriray-view" and device == "cpu"
        made.append((scene.film.width, scene.film.height))
        if scene.max_depth == 2:
            raise vr.SceneError("there are none")
        return np.broadcast_to(np.arange(40.0), (30, 40))

    channel = display.Channel("Columns", None, lambda x: (0.0, float(x.max())), of_scene=columns)
    monkeypatch.setitem(display.CHANNELS, "columns", channel)
    with rendering("cornell-box", **SMALL) as renderer:
        number = done(renderer).number
        renderer.submit(Action("set", "channel", "columns"))
        wait(lambda: "columns" in renderer.frame.made)
        frame = renderer.frame
        assert made == [(40, 30)] and frame.number == number + 1 and frame.render.spp == 24
        pixels, legend = display.as_bytes(frame.render, *renderer.view.shown(), made=frame.made)
        assert legend == display.Legend("Columns", ("0", "20", "39"))
        assert (pixels[:, 0] == pixels[0, 0]).all() and (pixels[0, 0] != pixels[0, 39]).any()
        renderer.submit(set_("spp", 30))
        wait(lambda: renderer.frame.done and renderer.frame.render.spp == 30)
        assert len(made) == 1
        renderer.submit(set_("max_depth", 2))
        wait(lambda: renderer.message == "Columns: there are none")
        assert np.isnan(done(renderer).made["columns"]).all()


# ---- the scene file ----

SAVED = ["cornell/cornell_box.xml", "checks/thinlens.xml", "checks/orthographic.xml",
         "checks/camera_in_medium.xml", "checks/hidden_light.xml", "checks/mitchell.xml",
         "checks/textures.xml", "checks/image_sky.xml"]  # fmt: skip


@pytest.mark.parametrize("name", SAVED)
def test_saved_scenes_render_the_same(name: str, root: Path, tmp_path: Path) -> None:
    """What is saved beside the scene has the film of what was shown, bit for bit."""
    folder = tmp_path / "scenes"
    shutil.copytree(root / "scenes" / Path(name).parent, folder)
    source = Source(str(folder / Path(name).name))
    file = source.load()
    view = applied(View(width=24, height=18, spp=5), do("orbit", x=0.2, y=0.05), file)
    view = applied(view, set_("max_depth", 6), file)
    view = applied(view, set_("seed", 11), file)
    if file.camera.projection == "perspective":
        view = applied(view, set_("aperture_radius", 0.01), file)
    if name.startswith("cornell"):
        view = applied(view, set_("sampler", "sobol"), file)
    shown = view.scene(file).with_(seed=11)
    (folder / "saved.xml").write_text(source.xml(shown), "utf-8")
    saved = vr.load_file(folder / "saved.xml")
    assert saved.sha256 == shown.sha256
    assert (saved.spp, saved.seed, saved.sampler) == (5, 11, shown.sampler)
    expected = vr.render(shown, seed=11, device="cpu").film_sha256
    assert vr.render(saved, seed=11, device="cpu").film_sha256 == expected


def test_a_scene_that_no_file_can_hold(root: Path) -> None:
    source = Source(str(root / "scenes" / "open.xml"))
    scene = source.load()
    camera = dataclasses.replace(
        scene.camera, aperture_radius=0.1, principal_point_offset=np.array([0.1, 0.0])
    )
    with pytest.raises(vr.SceneError, match="principal_point_offset"):
        source.xml(scene.with_(camera=camera))


def test_the_file_is_read_again(root: Path, tmp_path: Path) -> None:
    file = tmp_path / "scene.xml"
    part = tmp_path / "part.xml"
    part.write_text('<scene version="3.0.0"><shape type="sphere"/></scene>')
    text = """<scene version="3.0.0"><sensor type="perspective"><float name="fov" value="FOV"/>
        <transform name="to_world"><lookat origin="0,0,-5" target="0,0,0" up="0,1,0"/></transform>
        </sensor><include filename="part.xml"/><emitter type="constant"/></scene>"""
    file.write_text(text.replace("FOV", "40"))
    with rendering(str(file), width=16, height=12, spp=4, max_depth=3) as renderer:
        source = renderer.source
        first = done(renderer).render.film_sha256
        assert not source.changed()
        file.write_text(text.replace("FOV", "30"))
        assert source.changed()
        renderer.reload()
        wait(lambda: renderer.loads == 2)
        second = done(renderer)
        assert second.render.film_sha256 != first and second.scene.camera.fov == 30
        assert second.scene.max_depth == 3  # of the viewer, not of the file
        file.write_text("<scene")
        renderer.reload()
        wait(lambda: "scene.xml" in renderer.message)
        assert renderer.frame is second and not source.changed()
        file.write_text(text.replace("FOV", "40"))
        renderer.reload()
        wait(lambda: renderer.loads == 3)
        assert done(renderer).render.film_sha256 == first and not renderer.message
        part.write_text('<scene version="3.0.0"><shape type="cube"/></scene>')
        assert source.changed()
