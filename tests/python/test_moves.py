"""A moved camera or a changed number shows what a scene made anew shows, and shares its tree."""

from __future__ import annotations

import copy
import pickle
import time
from typing import Any

import numpy as np
import pytest
import trimesh

import veriray as vr
from veriray import native_scene
from veriray.camera import Camera
from veriray.device import select
from veriray.scene import Scene
from veriray_validate import dicts
from veriray_validate.everyday_heaps import tiled
from veriray_validate.levels.moves import windowed_room
from veriray_validate.scenes import Medium, Part, directional_light, make, material, point_light

SIZE = {"width": 8, "height": 8, "spp": 1}
MOVES = 1000


DEVICES = ["cpu", pytest.param("cuda", marks=pytest.mark.gpu)]


def film(scene: Scene, device: str = "cpu", **settings: Any) -> str:
    return vr.render(scene, device=device, threads=1, max_depth=5, **SIZE, **settings).film_sha256


def anew(scene: Scene) -> Scene:
    """The same scene, which shares nothing native with the original."""
    other = copy.copy(scene)
    assert not other.native_forms
    return other


def held(scene: Scene, device: str = "cpu") -> Any:
    """The native scene; while it is held, no other one has its number of a family."""
    chosen, _ = select(device)
    return native_scene.native_scene(scene, scene.with_(**SIZE), chosen)


def balls() -> Scene:
    """3,842 triangles of size 1 and a ground; far from the world's origin."""
    mesh = trimesh.creation.icosphere(3)
    middle = np.array([1000.0, -300.0, 77.0])
    ground = [[x, -1.2, z] for x, z in [(-40, -40), (-40, 40), (40, 40), (40, -40)]]
    parts = [
        Part(mesh.vertices + middle, mesh.faces, 0.5),
        Part(0.3 * mesh.vertices + middle + [1.2, 0.3, 1], mesh.faces, emission=2.0),
        Part(np.array(ground) + middle, [[0, 1, 2], [0, 2, 3]], 0.7),
        Part(
            0.4 * mesh.vertices + middle + [-0.9, 0.9, 0.9], mesh.faces,
            material=material("dielectric", eta=1.5),
            interior=Medium([1.0, 2.0, 3.0], [0.5, 0.6, 0.7], 0.2),
        ),
    ]  # fmt: skip
    lights = [point_light(middle + [0, 5, 0], [20, 10, 5])]
    return make(
        parts, Camera.look_at(middle + [0, 1, 4], middle, fov=40), environment=0.3, lights=lights
    )


def random_camera(rng: np.random.Generator) -> Camera:
    """Around and among the balls, at distances from 1e-3 to 1e4."""
    middle = np.array([1000.0, -300.0, 77.0])
    way = rng.normal(size=3)
    way *= np.array([1, 0.4, 1]) / np.linalg.norm(way)
    kind, away = rng.integers(8), 10.0 ** rng.uniform(0.3, 1.0)
    if kind == 0:
        away = 10.0 ** rng.uniform(-3, 4)
    lens = {"aperture_radius": 0.02, "focus_distance": away} if kind == 1 else {}
    clip = {"near_clip": 0.5 * away, "far_clip": 1.5 * away} if kind == 2 else {}
    fov = 10.0 ** rng.uniform(-3, 1) if kind == 3 else rng.uniform(20, 90)
    start, target = middle + way * away, middle + rng.normal(size=3) * 0.3
    if kind == 4:
        to_world = Camera.look_at(start, target, fov=40).to_world.copy()
        to_world[:3, :2] *= 3
        return Camera.orthographic(to_world, near_clip=0, far_clip=1e5)
    return Camera.look_at(start, target, fov=float(fov), **lens, **clip)


@pytest.mark.parametrize("device", DEVICES)
def test_a_moved_camera_shows_what_a_fresh_scene_shows(device: str) -> None:
    rng, scene = np.random.default_rng(1), balls()
    film(scene, device)
    known, shared = held(scene, device), 0
    for _ in range(MOVES):
        moved = scene.with_(camera=random_camera(rng))
        assert moved.vertices is scene.vertices
        assert film(moved, device) == film(anew(moved)), moved.camera
        now = held(moved, device)
        shared += now.family == known.family
        known = now
    assert shared > MOVES // 4
    forms = scene.native_forms
    assert len(forms) <= native_scene._KEPT_FORMS
    assert len({form.native.family for form in forms}) <= native_scene._KEPT_PER_SCENE


@pytest.mark.parametrize("device", DEVICES)
def test_rough_pictures_keep_the_tree(device: str) -> None:
    """However close to a surface a camera comes; they are as bright to 5 %, and none stays."""
    rng, scene, middle = np.random.default_rng(3), balls(), np.array([1000.0, -300.0, 77.0])
    wide: dict[str, Any] = {"width": 512, "height": 4, "spp": 1, "device": device, "max_depth": 5}
    vr.render(scene, **wide)
    family, others = held(scene, device).family, 0
    for _ in range(20):
        way = rng.normal(size=3) * [1, 0.4, 1]
        eye = middle + way / np.linalg.norm(way) * (1 + 10.0 ** rng.uniform(-4, -2))
        moved = scene.with_(camera=Camera.look_at(eye, eye + rng.normal(size=3), fov=40))
        with native_scene.roughly():
            rough = vr.render(moved, **wide)
            assert held(moved, device).family == family
        exact = vr.render(anew(moved), **wide)
        assert rough.image.mean() == pytest.approx(exact.image.mean(), rel=0.05)
        others += rough.film_sha256 != exact.film_sha256
    assert others > 5
    assert vr.render(moved, **wide).film_sha256 == exact.film_sha256


CHANGES = {  # column: the range of its new values
    "reflectance": (0.1, 0.9),
    "specular_transmittance": (0.1, 0.9),
    "emissions": (0.1, 9.0),
    "environment": (0.1, 9.0),
    "light_intensity": (0.1, 90.0),
    "light_position": (-1.0, 1.0),
    "sigma_t": (0.1, 9.0),
    "albedo": (0.1, 0.9),
    "phase_g": (-0.8, 0.8),
    "opacity": (0.1, 1.0),  # lets light through
    "vertices": (-1.0, 1.0),
}


def changed(scene: Scene, name: str, rng: np.random.Generator) -> Scene:
    old = getattr(scene, name)
    new = rng.uniform(*CHANGES[name], old.shape)
    if name in ("light_position", "vertices"):
        new = old + 1e-2 * new
    return scene._with_arrays(**{name: new})


@pytest.mark.parametrize("device", DEVICES)
@pytest.mark.parametrize("name", CHANGES)
def test_changed_numbers_show_what_a_fresh_scene_shows(name: str, device: str) -> None:
    rng, scene = np.random.default_rng(2), balls()
    pictures = {film(scene, device)}
    first = held(scene, device)
    for _ in range(6):
        other = changed(scene, name, rng)
        pictures.add(film(other, device, all_features=True))
        assert film(other, device) == film(anew(other))
        shares = held(other, device).family == first.family
        assert shares == (name not in ("vertices", "opacity"))
        assert other.sha256 == anew(other).sha256 != scene.sha256
        moved = changed(other, "reflectance", rng).with_(camera=random_camera(rng), height=3)
        assert film(moved, device) == film(anew(moved))
    assert len(pictures) > 1


def test_tables_of_rough_glass_are_made_once() -> None:
    rough = material("roughdielectric_whole", eta=1.5, alpha_u=0.3071, alpha_v=0.3071)
    ball = trimesh.creation.icosphere(1)
    part = Part(ball.vertices, ball.faces, 0.5, material=rough)
    scene = make([part], Camera.look_at([0, 0, 4], [0, 0, 0], fov=40), environment=1.0)
    seconds = []
    for k in range(6):
        colour = np.full((1, 3), 0.9 - 0.1 * k)
        begin = time.perf_counter()
        film(scene._with_arrays(reflectance=colour))
        seconds.append(time.perf_counter() - begin)
    assert min(seconds[1:]) < seconds[0] / 8  # 400 and 2 ms
    before = film(scene)
    assert film(scene._with_arrays(alpha_u=[0.31], alpha_v=[0.31])) != before == film(anew(scene))


def test_a_lamp_put_out_and_media_that_become_grey_show_what_fresh_scenes_show() -> None:
    scene = balls()
    film(scene)
    for columns in (
        {"emissions": np.zeros((1, 3))}, {"light_intensity": np.zeros((1, 3))},
        {"sigma_t": np.ones((1, 3))}, {"environment": np.zeros(3)},
    ):  # fmt: skip
        other = scene._with_arrays(**columns)
        fresh = anew(other)
        assert held(other).features == held(fresh).features
        assert film(other) == film(fresh)


def test_a_sky_seen_through_a_window_goes_out_and_on_again() -> None:
    eye = {"type": "perspective", "fov": 60.0, "to_world": dicts.look([0, 0, 1.8], [0, 0, 0])}
    parts = {"room": windowed_room(14), "sky": dicts.sky(1.0), "eye": eye}
    scene = vr.load_dict({"type": "scene", **parts})
    film(scene)
    for colour in ([0, 0, 0], [1, 1, 1], [0.3, 0.7, 0.1], [0, 0, 0], [0.2, 0, 0]):
        other = scene._with_arrays(environment=np.array(colour, np.float32))
        assert film(other) == film(anew(other))
        scene = other


def test_a_rough_metal_that_becomes_sharp_holds_parallel_light() -> None:
    metal = material("roughconductor", eta=0.0, k=1.0, alpha_u=0.3, alpha_v=0.3)
    eye = Camera.look_at([0, 0, 4], [0, 0, 0], fov=0.2)
    scene = make(
        [tiled(1.0, 0.0, 26, True, material=metal)], eye, lights=[directional_light([0, 0, -1])]
    )
    settings = {"width": 16, "height": 16, "spp": 64, "device": "cpu", "threads": 1}
    vr.render(scene, **settings)
    for alpha in (1e-4, 0.3):
        other = scene._with_arrays(alpha_u=[alpha], alpha_v=[alpha])
        made = [vr.render(s, **settings) for s in (other, anew(other))]
        assert made[0].film_sha256 == made[1].film_sha256
        scene = other


def test_copies_of_all_kinds_are_read_only() -> None:
    scene = balls()
    for other in (copy.copy(scene), copy.deepcopy(scene), pickle.loads(pickle.dumps(scene))):
        assert other.sha256 == scene.sha256
        for array in (other.reflectance, other.vertices, other.camera.to_world):
            assert not array.flags.writeable


def test_a_lamp_moved_into_fog_behind_glass_lights_it() -> None:
    """Walls that stop all light samples do not stop those to a lamp within; nor do clear walls."""
    glass = material("dielectric", eta=1.0)
    mesh = trimesh.creation.icosphere(4)
    fog = Part(mesh.vertices, mesh.faces, material=glass, interior=Medium(2.0, 0.9))
    far, near = [0.0, 5, 0], [0.1, 0, 0]
    scene = make([fog], Camera.look_at([0, 0, 5], [0, 0, 0], fov=15), lights=[point_light(far)])
    lit = []
    for changed in (
        scene,
        scene._with_arrays(light_position=np.array([near])),
        scene._with_arrays(light_position=np.array([near]))._with_arrays(
            light_position=np.array([far])
        ),
        scene._with_arrays(opacity=np.array([0.5])),
    ):
        r = vr.render(changed, device="cpu", threads=1, max_depth=5, **SIZE)
        assert r.film_sha256 == film(anew(changed))
        lit.append(sum(r.stats["ledger"]["shadow_visible"]))
    assert lit[0] == lit[2] == 0 and lit[1] > 0 and lit[3] > 0


def test_rounding_near_the_camera_is_small_beside_a_pixel() -> None:
    """2^8 roundings of a vertex, 2^-24 of its distance from the origin, do not exceed that of its
    distance from the camera and half a pixel there; see cpp/scene/frame.cpp."""
    rng, scene = np.random.default_rng(3), balls()
    chosen, _ = select("cpu")
    coarse = 0
    for _ in range(300):
        camera = random_camera(rng)
        near = camera.to_world[:3, 3]
        if camera.projection != "perspective" or camera.fov < 0.1:
            continue
        used = scene.with_(camera=camera, width=256, height=256)
        origin, unit = native_scene.native_scene(scene, used, chosen).frame
        away = np.abs(scene.vertices - origin).max(axis=1)
        assert away.max() < unit
        if np.linalg.norm(near - [1000.0, -300.0, 77.0]) > 300:
            continue  # a camera far from the scene: its rays start close to it
        distance = np.linalg.norm(scene.vertices - near, axis=1)
        pixel = 2 * camera.tan_half_x(256, 256) / 256
        assert (2.0**-16 * away <= 2.0**-16 * distance + pixel * distance / 2).all()
        coarse += bool((2.0**-16 * away > 2.0**-16 * distance + pixel * distance / 64).any())
    assert coarse > 3


@pytest.mark.parametrize("power", [-20, -1, 3, 20])
def test_scaling_a_large_scene_by_a_power_of_two_changes_no_bit(power: int) -> None:
    rng, scene = np.random.default_rng(4), balls()
    for _ in range(20):
        moved = scene.with_(camera=random_camera(rng))
        assert film(moved) == film(moved.scaled(2.0**power)), moved.camera


def test_copies_share_arrays_and_numbers_keep_their_checks() -> None:
    scene = balls()
    other = scene._with_arrays(reflectance=scene.reflectance * 0.5)
    same = [name for name in native_scene.COLUMNS if getattr(other, name) is getattr(scene, name)]
    assert set(native_scene.COLUMNS) - {*same} == {"reflectance"}
    with pytest.raises(vr.SceneError, match="reflectance"):
        scene._with_arrays(reflectance=scene.reflectance + 2)
    with pytest.raises(vr.SceneError, match="eta"):
        scene._with_arrays(eta=scene.eta * 0)
