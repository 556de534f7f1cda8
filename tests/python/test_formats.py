"""Scene files and dictionaries: what they mean, also against Mitsuba itself."""

import dataclasses
import math
import random
import subprocess
import sys
import warnings

import numpy as np
import pytest

from veriray import transform
from veriray.camera import Camera, Film
from veriray.columns import COLUMNS
from veriray.errors import SceneError, SceneWarning
from veriray.formats.plugins import PLUGINS, describe
from veriray.numeric import sin_cos_degrees
from veriray.scene import Scene, load_dict, load_file
from veriray.shipped import SHIPPED, find_shipped

HEAD = (
    '<scene version="3.0.0">\n<sensor type="perspective"><float name="fov" value="40"/></sensor>\n'
)
SKY = '<emitter type="constant"/>\n'


def load(folder, body, parameters=None, head=HEAD + SKY):
    path = folder / "scene.xml"
    path.write_text(f"{head}{body}</scene>\n", encoding="utf-8")
    return load_file(path, parameters or {})


def cube(**values):
    return {"type": "cube", **values}


def scene_dict(**values):
    sensor = {"type": "perspective", "fov": 40.0}
    return {"type": "scene", "sensor": sensor, "sky": {"type": "constant"}, **values}


def normals(scene):
    a, b, c = (scene.vertices[scene.triangles[:, i]] for i in range(3))
    n = np.cross(b - a, c - a)
    return n / np.linalg.norm(n, axis=1, keepdims=True)


# ---- defaults and the scene object ---------------------------------------------------------------


def test_defaults_are_mitsubas(tmp_path):
    scene = load(tmp_path, '<shape type="cube"/>')
    assert (scene.max_depth, scene.rr_depth, scene.spp, scene.seed) == (-1, 5, 4, 0)
    assert scene.film == Film(768, 576, "gaussian", 0.5)
    assert scene.reflectance.tolist() == [[0.5] * 3] and scene.two_sided.tolist() == [False]
    assert scene.environment.tolist() == [1.0] * 3
    assert scene.camera.near_clip == 0 and scene.camera.far_clip == math.inf
    assert (scene.triangle_emission == -1).all() and scene.shape_names == ("cube_0",)


def test_arrays_have_the_promised_types_and_cannot_be_written(tmp_path):
    scene = load_file("cornell-box")
    types = {name: column.dtype for name, column in COLUMNS.items()}
    for name, dtype in {**types, "triangle_shape": np.uint32}.items():
        array = getattr(scene, name)
        assert array.dtype == dtype and array.flags["C_CONTIGUOUS"]
        with pytest.raises(ValueError):
            array[...] = 0


def test_hash_depends_on_the_picture_only(tmp_path):
    scene = load_file("cornell-box")
    assert len(scene.sha256) == 64 and load_file("cornell-box").sha256 == scene.sha256
    assert load_file("cornell-box", {"width": 512}).sha256 == scene.sha256
    same = [scene.with_(spp=7, seed=3), dataclasses.replace(scene, shape_names=("x",) * 19)]
    assert {s.sha256 for s in same} == {scene.sha256}
    reflectance = np.array(scene.reflectance)
    reflectance[0, 0] = np.nextafter(reflectance[0, 0], np.float32(1))
    two_sided = np.array(scene.two_sided)
    two_sided[0] = True
    others = [
        scene.with_(width=511),
        scene.with_(max_depth=3),
        scene.with_(rr_depth=6),
        scene.with_(filter="tent"),
        scene.with_(filter="gaussian", filter_parameter=0.6),
        scene.scaled(2),
        scene.with_emission_scaled(2),
        dataclasses.replace(scene, reflectance=reflectance),
        dataclasses.replace(scene, two_sided=two_sided),
        dataclasses.replace(scene, environment=[0, 0, 1]),
        dataclasses.replace(scene, camera=dataclasses.replace(scene.camera, fov=40)),
        dataclasses.replace(scene, camera=dataclasses.replace(scene.camera, near_clip=1)),
        dataclasses.replace(scene, triangles=scene.triangles[:, [1, 2, 0]]),
    ]
    assert len({s.sha256 for s in others} | {scene.sha256}) == len(others) + 1


def test_hash_is_the_same_in_another_process():
    code = "from veriray.scene import load_file; print(load_file('open').sha256)"
    out = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert out.stdout.strip() == load_file("open").sha256


def test_scaling(tmp_path):
    scene = load_file("cornell-box-mitsuba")
    large = scene.scaled(4.0)
    assert (large.vertices == 4 * scene.vertices).all()
    assert large.camera.to_world[2, 3] == 4 * scene.camera.to_world[2, 3]
    assert (large.camera.near_clip, large.camera.far_clip) == (0.004, 400)
    assert (large.camera.to_world[:3, :3] == scene.camera.to_world[:3, :3]).all()
    bright = load_file("open").with_emission_scaled(2**20)
    assert (bright.emissions == load_file("open").emissions * 2**20).all()
    assert (bright.environment == load_file("open").environment * 2**20).all()
    for factor in (0, -1, math.inf, math.nan, "2"):
        with pytest.raises(SceneError, match="factor"):
            scene.scaled(factor)


def test_with_keeps_and_changes():
    scene = load_file("cornell-box")
    other = scene.with_(width=64, max_depth=2)
    assert (other.film.width, other.film.height, other.max_depth) == (64, 512, 2)
    assert other.rr_depth == scene.rr_depth and other.film.filter == "box"
    assert scene.with_(filter="gaussian").film.filter_parameter == 0.5
    with pytest.raises(SceneError, match="film width = 0 is outside"):
        scene.with_(width=0)


def test_zero_area_triangles_are_kept(tmp_path):
    (tmp_path / "m.obj").write_text("v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 3\nf 1 2 2\nf 1 1 1\n")
    scene = load(tmp_path, '<shape type="obj"><string name="filename" value="m.obj"/></shape>')
    assert len(scene.triangles) == 3


def test_shipped_names_and_suffixes(tmp_path, monkeypatch):
    for name in SHIPPED:
        assert isinstance(load_file(name), Scene)
    monkeypatch.chdir(tmp_path)
    (tmp_path / "open").write_text("not a scene")
    assert load_file("open").sha256 == load_file(find_shipped("open")).sha256
    with pytest.raises(SceneError, match="neither a scene file"):
        load_file("./open")


def test_scenes_without_shapes_or_light(tmp_path):
    scene = load(tmp_path, "")
    assert scene.vertices.shape == (0, 3) and scene.triangles.shape == (0, 3)
    for body in (
        "",
        '<shape type="cube"/>',
        '<emitter type="constant"><float name="radiance" value="0"/></emitter>',
    ):
        with pytest.warns(SceneWarning, match="no light: the picture will be black"):
            load(tmp_path, body, head=HEAD)
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        load(tmp_path, '<shape type="cube"><emitter type="area"/></shape>', head=HEAD)


# ---- values, parameters, references --------------------------------------------------------------


@pytest.mark.parametrize(
    ("text", "expected"),
    [
        ("0.1, 0.2, 0.3", (0.1, 0.2, 0.3)),
        ("0.1 0.2 0.3", (0.1, 0.2, 0.3)),
        (".1,.2,\n 3e-1", (0.1, 0.2, 0.3)),
        ("+0.25", (0.25,) * 3),
        ("1E-2", (0.01,) * 3),
        ("-0.0", (0.0,) * 3),
    ],
)
def test_rgb(tmp_path, text, expected):
    body = (
        '<shape type="cube"><bsdf type="diffuse">'
        f'<rgb name="reflectance" value="{text}"/></bsdf></shape>'
    )
    assert load(tmp_path, body).reflectance[0].tolist() == np.float32(expected).tolist()


@pytest.mark.parametrize("tag", ["spectrum", "float"])
def test_one_number_is_a_colour(tmp_path, tag):
    body = (
        f'<shape type="cube"><emitter type="area"><{tag} name="radiance" value="2.5"/>'
        "</emitter></shape>"
    )
    even = np.float32([2.5 * 1.204794, 2.5 * 0.948291, 2.5 * 0.908916])  # of an even spectrum
    expected = even if tag == "spectrum" else np.float32([2.5] * 3)
    np.testing.assert_allclose(load(tmp_path, body).emissions, [expected], rtol=1e-6)


def test_numbers_do_not_depend_on_the_locale(tmp_path, monkeypatch):
    import locale

    for name in ("de_DE.UTF-8", "de_DE.utf8", "fr_FR.UTF-8"):
        try:
            locale.setlocale(locale.LC_ALL, name)
            break
        except locale.Error:
            continue
    try:
        assert load_file("cornell-box").camera.fov == 39.307648116107
    finally:
        locale.setlocale(locale.LC_ALL, "C")


def test_parameters(tmp_path):
    body = (
        '<default name="r" value="0.25"/><default name="n" value="$r"/>'
        '<bsdf type="diffuse" id="b"><rgb name="reflectance" value="$r, ${n}, 0.$digits"/></bsdf>'
        '<shape type="cube"><ref id="b"/></shape>'
    )
    scene = load(tmp_path, body, {"digits": 125})
    assert scene.reflectance.tolist() == [[0.25, 0.25, 0.125]]
    scene = load(tmp_path, body, {"digits": "5", "r": 0.75})
    assert scene.reflectance.tolist() == [[0.75, 0.75, 0.5]]
    assert load_file("cornell-box", {"spp": "16", "width": 64}).spp == 16
    assert load(tmp_path, body, {"digits": "5", "r": np.float64(0.75)}).sha256 == scene.sha256


def test_include_is_relative_to_the_including_file(tmp_path):
    (tmp_path / "parts" / "deep").mkdir(parents=True)
    (tmp_path / "parts" / "ünï çødé 1.xml").write_text(
        '<scene version="3.0.0"><default name="g" value="0.5"/>'
        '<include filename="deep/b.xml"/></scene>',
        encoding="utf-8",
    )
    (tmp_path / "parts" / "deep" / "b.xml").write_text(
        '<scene version="3.0.0"><bsdf type="diffuse" id="b">'
        '<float name="reflectance" value="$g"/></bsdf>'
        '<shape type="obj"><string name="filename" value="m.obj"/><ref id="b"/></shape></scene>'
    )
    (tmp_path / "parts" / "deep" / "m.obj").write_text("v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 3\n")
    (tmp_path / "one.xml").write_text('<shape type="cube" id="single"><ref id="b"/></shape>')
    scene = load(
        tmp_path,
        '<include filename="parts/ünï çødé 1.xml"/><include filename="one.xml"/>',
        {"g": 0.25},
    )
    assert scene.shape_names == ("obj_0", "single")
    assert scene.reflectance.tolist() == [[0.25] * 3]
    assert scene.triangle_material.tolist() == [0] * 13


def test_references_share_a_material_and_may_point_forward(tmp_path):
    body = (
        '<shape type="cube"><ref id="later"/></shape><shape type="rectangle">'
        '<ref id="later"/></shape>'
        '<bsdf type="twosided" id="later"><bsdf type="diffuse"/></bsdf>'
    )
    scene = load(tmp_path, body)
    assert len(scene.reflectance) == 1 and scene.two_sided.tolist() == [True]


def test_emission_per_emitter_and_black_lights(tmp_path):
    body = "".join(
        f'<shape type="rectangle"><emitter type="area"><rgb name="radiance" value="{v}"/>'
        "</emitter></shape>"
        for v in ("1 2 3", "0", "4")
    )
    scene = load(tmp_path, body)
    assert scene.emissions.tolist() == [[1, 2, 3], [4, 4, 4]]
    assert scene.triangle_emission.tolist() == [0, 0, -1, -1, 1, 1]


def test_filters(tmp_path):
    def film(rfilter):
        text = f'<film type="hdrfilm"><integer name="width" value="3"/>{rfilter}</film>'
        head = HEAD.replace("</sensor>", f"{text}</sensor>") + SKY
        return load(tmp_path, "", head=head).film

    assert film('<rfilter type="box"/>') == Film(3, 576, "box", 0.5)
    assert film('<rfilter type="tent"/>') == Film(3, 576, "tent", 1.0)
    assert (
        film('<rfilter type="tent"><float name="radius" value="1.5"/></rfilter>').filter_parameter
        == 1.5
    )
    assert (
        film(
            '<rfilter type="gaussian"><float name="stddev" value="0.4"/></rfilter>'
        ).filter_parameter
        == 0.4
    )


# ---- geometry ------------------------------------------------------------------------------------


def test_rectangle_and_cube_faces(tmp_path):
    scene = load(tmp_path, '<shape type="rectangle"/>')
    assert scene.vertices.tolist() == [[-1, -1, 0], [1, -1, 0], [1, 1, 0], [-1, 1, 0]]
    assert scene.triangles.tolist() == [[0, 1, 2], [0, 2, 3]]
    scene = load(tmp_path, '<shape type="cube"/>')
    centres = scene.vertices[scene.triangles].mean(axis=1)
    assert ((normals(scene) * centres).sum(axis=1) > 0.9).all()
    assert len(scene.triangles) == 12
    assert len({tuple(n) for n in normals(scene).round(9).tolist()}) == 6


@pytest.mark.parametrize("shape", ["rectangle", "cube"])
def test_mirrors_keep_the_front_and_flip_normals_swaps_it(shape):
    def normal(scale, flip):
        values = {"to_world": np.diag([*scale, 1.0]), "flip_normals": flip}
        scene = load_dict(scene_dict(s={"type": shape, **values}))
        centres = scene.vertices[scene.triangles].mean(axis=1)
        top = int(np.argmax(centres[:, 2] * np.sign(scale[2])))
        return normals(scene)[top, 2]

    assert normal((1, 1, 1), False) == 1 and normal((1, 1, 1), True) == -1
    assert normal((-2, 1, 1), False) == 1 and normal((-2, 1, 1), True) == -1
    assert normal((1, 1, -1), False) == -1 and normal((1, 1, -1), True) == 1


@pytest.mark.parametrize("flip", [False, True])
def test_a_mirrored_sphere_is_the_sphere(flip):
    values = {"to_world": np.diag([-1.0, 1, 1, 1]), "flip_normals": flip}
    scene = load_dict(scene_dict(s={"type": "sphere", **values}))
    assert scene.sphere_inward.tolist() == [flip]


def test_many_shapes_stand_as_each_alone(tmp_path):
    rng = random.Random(4)
    (tmp_path / "a.obj").write_text("v 0 0 0\nv 1 0 0\nv 0 1 1\nvn 0 0 1\nf 1//1 2//1 3//1\n")
    shapes = []
    for k in range(1500):  # more than are placed together
        kind = rng.choice(["cube", "rectangle", "disk", "sphere", "obj"])
        file = '<string name="filename" value="a.obj"/>' * (kind == "obj")
        flip = f'<boolean name="flip_normals" value="{rng.choice(["true", "false"])}"/>'
        size = f'<scale value="{rng.choice([-2, 3])}"/>'
        place = f'<rotate y="1" angle="{7 * k}"/><translate x="{rng.random()}" y="{k}"/>'
        inside = f'{file}{flip}<transform name="to_world">{size}{place}</transform>'
        shapes.append(f'<shape type="{kind}">{inside}</shape>\n')
    scene = load(tmp_path, "".join(shapes))
    for k in range(0, 1500, 19):
        alone = load(tmp_path, shapes[k])
        faces = scene.triangles[scene.triangle_shape == k]
        for name in ("vertices", "normals"):
            one = getattr(alone, name)[alone.triangles]
            np.testing.assert_array_equal(getattr(scene, name)[faces], one)
        for name in ("sphere", "disk"):
            rows = getattr(scene, f"{name}_shape") == k
            np.testing.assert_array_equal(
                getattr(scene, f"{name}s")[rows], getattr(alone, f"{name}s")
            )
        np.testing.assert_array_equal(
            scene.sphere_inward[scene.sphere_shape == k], alone.sphere_inward
        )
    steps = '<scale value="1e99"/><translate x="1e100"/>'
    far = f'<shape type="cube"><transform name="to_world">{steps}</transform></shape>'
    with pytest.raises(SceneError, match="scene.xml:604: cube: a vertex exceeds 1e\\+100"):
        load(tmp_path, "".join(f'<shape type="cube" id="c{k}"/>\n' for k in range(600)) + far)


@pytest.mark.parametrize("kind", ["sphere", "cube", "rectangle"])
def test_work_goes_with_the_number_of_shapes(tmp_path, kind):
    """Counted in calls, which a busy machine does not change."""

    def calls(shapes):
        count = 0

        def profile(frame, event, value):
            nonlocal count
            count += 1

        sys.setprofile(profile)
        try:
            load(tmp_path, f'<shape type="{kind}"/>\n' * shapes)
        finally:
            sys.setprofile(None)
        return count

    load(tmp_path, f'<shape type="{kind}"/>')  # fills the caches
    few, more, most = (calls(n) for n in (500, 1000, 2000))
    assert most - more <= 2.1 * (more - few)
    assert most - more < 120 * 1000


def test_transform_order(tmp_path):
    body = (
        '<shape type="rectangle"><transform name="to_world"><translate x="1"/><scale value="2"/>'
        '<rotate z="1" angle="90"/></transform></shape>'
    )
    scene = load(tmp_path, body)
    assert scene.vertices.tolist() == [[2, 0, 0], [2, 4, 0], [-2, 4, 0], [-2, 0, 0]]


def test_transforms_are_elementwise_and_exact_at_right_angles():
    quarter = transform.rotate((0, 1, 0), 90.0)
    assert quarter.tolist() == [[0, 0, 1, 0], [0, 1, 0, 0], [-1, 0, 0, 0], [0, 0, 0, 1]]
    rng = np.random.default_rng(1)
    a, b = rng.normal(size=(2, 4, 4))
    expected = [
        [
            ((a[i, 0] * b[0, j] + a[i, 1] * b[1, j]) + a[i, 2] * b[2, j]) + a[i, 3] * b[3, j]
            for j in range(4)
        ]
        for i in range(4)
    ]
    assert (transform.compose(a, b) == np.array(expected)).all()
    points = rng.normal(size=(1000, 3))
    m = rng.normal(size=(3, 4)).tolist()
    matrix = np.array([*m, [0, 0, 0, 1]])
    expected = [
        [((x * r[0] + y * r[1]) + z * r[2]) + r[3] for r in m] for x, y, z in points.tolist()
    ]
    assert (transform.apply(matrix, points) == np.array(expected)).all()


def test_sine_and_cosine_are_correctly_rounded():
    mpmath = pytest.importorskip("mpmath", reason="mpmath gives the correctly rounded values")
    rng = random.Random(1)
    with mpmath.workdps(60):
        for angle in [rng.uniform(-720, 720) for _ in range(300)] + [
            1e-300,
            45.0,
            30.0,
            89.99999,
            1e15,
        ]:
            radians = mpmath.mpf(angle) * mpmath.pi / 180
            assert sin_cos_degrees(angle) == (
                float(mpmath.sin(radians)),
                float(mpmath.cos(radians)),
            )


def test_sine_and_cosine_of_right_angles():
    table = {
        0: (0, 1),
        90: (1, 0),
        180: (0, -1),
        270: (-1, 0),
        -90: (-1, 0),
        450: (1, 0),
        36000.0: (0, 1),
    }
    for angle, expected in table.items():
        assert sin_cos_degrees(float(angle)) == expected
    for angle in range(-400, 401, 7):
        s, c = sin_cos_degrees(float(angle))
        assert abs(s - math.sin(math.radians(angle))) < 1e-15
        assert abs(c - math.cos(math.radians(angle))) < 1e-15


def test_look_at(tmp_path):
    camera = load_file("cornell-box").camera
    assert camera.to_world[:3].tolist() == [[1, 0, 0, 278], [0, 1, 0, 273], [0, 0, 1, -800]]
    camera = load_file("cornell-box-mitsuba").camera
    assert camera.to_world[:3].tolist() == [[-1, 0, 0, 0], [0, 1, 0, 0], [0, 0, -1, 3.9]]


def test_tangents_of_the_field_of_view():
    def tangent(axis, width, height, fov=90.0):
        return Camera(np.eye(4), fov, axis).tan_half_x(width, height)

    assert tangent("x", 40, 20) == 1 and tangent("y", 40, 20) == 2
    assert tangent("smaller", 40, 20) == 2 and tangent("larger", 40, 20) == 1
    assert tangent("smaller", 20, 40) == 1 and tangent("larger", 20, 40) == 0.5
    assert tangent("diagonal", 40, 30) == pytest.approx(0.8, rel=1e-15)
    camera = Camera(np.eye(4), 60.0, "y")
    assert camera.tan_half_y(1280, 720) == pytest.approx(math.tan(math.radians(30)), rel=1e-15)
    box = load_file("cornell-box").camera
    assert box.tan_half_x(512, 512) == pytest.approx(0.0125 / 0.035, rel=1e-14)


# ---- dictionaries --------------------------------------------------------------------------------


def test_file_and_dictionary_give_the_same_scene(tmp_path):
    body = (
        '<integrator type="path"><integer name="max_depth" value="3"/></integrator>'
        '<bsdf type="diffuse" id="red"><rgb name="reflectance" value="0.5 0.1 0.1"/></bsdf>'
        '<shape type="cube" id="box"><transform name="to_world">'
        '<translate x="1" y="2" z="3"/></transform>'
        '<ref id="red"/></shape>'
        '<shape type="rectangle" id="lamp"><emitter type="area">'
        '<rgb name="radiance" value="5"/></emitter></shape>'
    )
    to_world = np.eye(4)
    to_world[:3, 3] = 1, 2, 3
    as_dict = scene_dict(
        integrator={"type": "path", "max_depth": 3},
        red={"type": "diffuse", "reflectance": {"type": "rgb", "value": [0.5, 0.1, 0.1]}},
        box={"type": "cube", "to_world": to_world, "bsdf": {"type": "ref", "id": "red"}},
        lamp={
            "type": "rectangle",
            "light": {"type": "area", "radiance": {"type": "rgb", "value": 5}},
        },
    )
    a, b = load(tmp_path, body), load_dict(as_dict)
    assert a.sha256 == b.sha256 and a.shape_names == b.shape_names == ("box", "lamp")


def test_vectors_and_transforms_of_drjit():
    """Its vectors have any attribute by swizzling; those of a JIT have a last axis of one lane."""

    class Vector:
        def __init__(self, numbers):
            self.numbers = np.array(numbers, np.float32)
            self.matrix = np.ones(6)

        def __array__(self, dtype=None, copy=None):
            return self.numbers

    class Transform:
        def __init__(self, matrix):
            self.matrix = matrix

    moved = np.eye(4)
    moved[:3, 3] = 1, 2, 3
    for given in (
        {"center": Vector([1, 2, 3])}, {"center": Vector([[1], [2], [3]])},
        {"to_world": Transform(moved)}, {"to_world": Transform(moved[..., None])},
    ):  # fmt: skip
        scene = load_dict(
            {"type": "scene", "s": {"type": "sphere", **given}, "l": {"type": "constant"}}
        )
        assert scene.spheres.tolist() == [[1, 2, 3, 1]]
    colour = {"type": "rgb", "value": Vector([0.25, 0.5, 0.75])}
    light = {"type": "constant", "radiance": colour}
    scene = load_dict({"type": "scene", "s": {"type": "sphere"}, "l": light})
    assert scene.environment.tolist() == [0.25, 0.5, 0.75]


def test_dictionary_values():
    class Matrix:
        matrix = [[1, 0, 0, 5], [0, 1, 0, 0], [0, 0, 1, 0], [0, 0, 0, 1]]

    scene = load_dict(
        scene_dict(
            a=cube(to_world=Matrix(), bsdf={"type": "diffuse", "reflectance": np.float32(0.25)}),
            b=cube(
                bsdf={
                    "type": "diffuse",
                    "id": "x",
                    "reflectance": {"type": "spectrum", "value": 0.5},
                }
            ),
            c=cube(flip_normals=np.True_, other={"type": "ref", "id": "x"}),
        )
    )
    assert scene.vertices[:24, 0].mean() == 5
    assert scene.reflectance[:, 0].tolist() == [0.25, 0.5]
    assert scene.triangle_material[::12].tolist() == [0, 1, 1]


def test_table_covers_every_parameter_of_every_plugin():
    for plugin in PLUGINS.values():
        for name, param in plugin.params.items():
            assert name.isidentifier() and param.kind
            assert not set(plugin.params) & set(plugin.unsupported)
            assert f"| `{name}` |" in describe()


# ---- against Mitsuba -----------------------------------------------------------------------------


@pytest.fixture(scope="module")
def mi():
    module = pytest.importorskip("mitsuba", reason="compares with Mitsuba 3 itself")
    module.set_variant("scalar_rgb")
    return module


def test_mitsubas_cornell_box_loads_verbatim(mi):
    theirs, ours = load_dict(mi.cornell_box()), load_file("cornell-box-mitsuba")
    assert np.abs(theirs.vertices - ours.vertices).max() < 1e-7
    assert np.abs(theirs.camera.to_world - ours.camera.to_world).max() < 1e-6
    for (
        name
    ) in "triangles triangle_material triangle_emission reflectance two_sided emissions".split():
        assert (getattr(theirs, name) == getattr(ours, name)).all(), name
    for name in "max_depth rr_depth spp shape_names".split():
        assert getattr(theirs, name) == getattr(ours, name)
    assert (
        theirs.camera.fov == pytest.approx(ours.camera.fov) and theirs.camera.fov_axis == "smaller"
    )
    assert (theirs.film.width, theirs.film.height) == (256, 256)
    assert (theirs.film.filter, ours.film.filter) == ("gaussian", "box")


@pytest.mark.parametrize("name", sorted(SHIPPED))
def test_mitsuba_loads_the_shipped_scenes(mi, name):
    scene = mi.load_file(str(find_shipped(name)))
    bounds = scene.bbox()
    vertices = load_file(name).vertices
    assert np.allclose(np.array(bounds.min), vertices.min(axis=0), rtol=1e-6, atol=1e-6)
    assert np.allclose(np.array(bounds.max), vertices.max(axis=0), rtol=1e-6, atol=1e-6)


TRANSFORMS = [
    '<translate x="1" y="-2" z="3"/><scale value="2"/>',
    '<scale x="2" z="-3"/><rotate y="1" angle="33"/><translate value="4"/>',
    '<rotate value="0.6,0.8,0" angle="-75.5"/><translate z="2"/>',
    '<matrix value="0 2 0 1  -1 0.5 0 2  0 0 3 3  0 0 0 1"/><rotate x="1" angle="10"/>',
    '<matrix value="0 2 0 -1 0 0.5 0 0 3"/>',
    '<lookat origin="1,2,3" target="-2,4,1" up="0,1,0.2"/>',
    '<scale value="-1"/>',
]
MIRRORS = (TRANSFORMS[1], TRANSFORMS[-1])


@pytest.mark.parametrize("steps", TRANSFORMS)
@pytest.mark.parametrize("shape", ["rectangle", "cube", "obj"])
@pytest.mark.parametrize("flip", ["false", "true"])
def test_shapes_stand_and_face_as_in_mitsuba(mi, tmp_path, steps, shape, flip):
    (tmp_path / "m.obj").write_text("v 0 0 0\nv 2 0 0\nv 0 2 1\nv 3 3 3\nf 1 2 3\nf 2 4 3\n")
    mesh_file = (
        '<string name="filename" value="m.obj"/><boolean name="face_normals" value="true"/>'
        if shape == "obj"
        else ""
    )
    body = (
        f'<shape type="{shape}">{mesh_file}<transform name="to_world">{steps}</transform>'
        f'<boolean name="flip_normals" value="{flip}"/></shape>'
    )
    scene = load(tmp_path, body)
    theirs = mi.load_file(str(tmp_path / "scene.xml"))
    # Mitsuba turns a mirrored flat mesh inside out, but no rectangle and no cube.
    turned = -1 if shape == "obj" and steps in MIRRORS else 1
    facing = normals(scene)
    for corners, normal in zip(scene.vertices[scene.triangles], facing, strict=True):
        centre = corners.mean(axis=0)
        for side in (1, -1):
            ray = mi.Ray3f((centre + side * 0.01 * normal).tolist(), (-side * normal).tolist())
            hit = theirs.ray_intersect(ray)
            assert hit.t == pytest.approx(0.01, rel=1e-2)
            assert np.sign(hit.wi.z) == side * turned, "the shading frame's front is ours"
            assert np.abs(np.array(hit.sh_frame.n) * turned - normal).max() < 1e-5


def mitsuba_direction(mi, camera, u, v):
    ray, _ = camera.sample_ray(0.0, 0.5, [u, v], [0.5, 0.5])
    return np.array(ray.d)


@pytest.mark.parametrize("size", [(40, 20), (20, 40), (31, 31)])
@pytest.mark.parametrize(
    "lens",
    [f'<float name="fov" value="50"/><string name="fov_axis" value="{a}"/>'
     for a in ("x", "y", "diagonal", "smaller", "larger")]
    + ['<string name="focal_length" value="35mm"/>', '<integer name="fov" value="130"/>'],
)  # fmt: skip
@pytest.mark.parametrize("offset", [(0, 0), (0.1, -0.2)])
def test_cameras_look_as_mitsubas_do(mi, tmp_path, size, lens, offset):
    head = (
        f'<scene version="3.0.0"><sensor type="perspective">{lens}'
        f'<float name="principal_point_offset_x" value="{offset[0]}"/>'
        f'<float name="principal_point_offset_y" value="{offset[1]}"/>'
        '<transform name="to_world">'
        '<lookat origin="1,2,3" target="-2,4,1" up="0.1,1,0.2"/></transform>'
        f'<film type="hdrfilm"><integer name="width" value="{size[0]}"/>'
        f'<integer name="height" value="{size[1]}"/></film></sensor>'
    )
    scene = load(tmp_path, SKY, head=head)
    camera, film = scene.camera, scene.film
    theirs = mi.load_file(str(tmp_path / "scene.xml")).sensors()[0]
    for u, v in ((0.0, 0.0), (1.0, 0.0), (0.5, 0.5), (0.3, 0.9)):
        x = camera.tan_half_x(film.width, film.height) * (1 - 2 * (u + offset[0]))
        y = camera.tan_half_y(film.width, film.height) * (1 - 2 * (v + offset[1]))
        d = camera.to_world[:3, :3] @ np.array([x, y, 1.0])
        d /= np.linalg.norm(d)
        assert np.abs(d - mitsuba_direction(mi, theirs, u, v)).max() < 2e-6


def test_messages_keep_the_end_of_a_long_path(tmp_path):
    folder = tmp_path.joinpath(*["a folder with a long name"] * 12)
    folder.mkdir(parents=True)
    body = '<shape type="ply"><string name="filename" value="it_is_this_one.ply"/></shape>'
    with pytest.raises(SceneError, match=r'"/[^"]*\.\.\.[^"]*name/it_is_this_one\.ply": No such'):
        load(folder, body)
