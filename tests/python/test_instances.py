"""Shape groups, their instances, and merged shapes: as if written out, and against Mitsuba."""

import time

import numpy as np
import pytest
import trimesh

import veriray
from veriray import transform
from veriray.errors import SceneError, SceneWarning
from veriray.formats import shapes
from veriray.formats.node import Node
from veriray.scene import load_dict, load_file

SENSOR = {"type": "perspective", "fov": 40.0, "film": {"type": "hdrfilm", "width": 8, "height": 8}}
SCENE = {"type": "scene", "sensor": SENSOR, "sky": {"type": "constant"}}
GROUP = {"type": "ref", "id": "g"}
OBJ = "v 0 0 0\nv 1 0 0\nv 0 1 0\nv 0 0 1\nf 1 3 2\nf 1 2 4\nf 2 3 4\nf 3 1 4\n"
TURN = np.array([[0.8, 0, 0.6, 5], [0, 1, 0, 0], [-0.6, 0, 0.8, -7], [0, 0, 0, 1]])
MATRICES = {
    "rigid": TURN,
    "even": TURN @ np.diag([2.5, 2.5, 2.5, 1]),
    "mirror": TURN @ np.diag([-2, 2, 2, 1]),
}
UNEVEN = TURN @ np.array([[1, 0.3, 0, 0], [0, 2, 0, 0], [0.2, 0, 0.5, 0], [0, 0, 0, 1]])


def red(value=0.25):
    return {"type": "diffuse", "reflectance": value}


def members(folder):
    """Shapes of every kind, apart from each other."""
    (folder / "t.obj").write_text(OBJ)

    def at(x):
        return transform.translate([x, 0.25, 0])

    return {
        "a": {"type": "cube", "to_world": at(0), "bsdf": red()},
        "b": {"type": "sphere", "center": [4, 1, 1], "radius": 0.75},
        "c": {"type": "disk", "to_world": at(8) @ TURN, "flip_normals": True},
        "d": {"type": "rectangle", "to_world": at(12), "bsdf": red()},
        "e": {"type": "obj", "filename": folder / "t.obj", "to_world": at(16)},
        "f": {"type": "cylinder", "p0": [20, 0, 0], "p1": [21, 1, 1], "radius": 0.5},
    }


def instanced(group, *matrices, **more):
    """A scene of instances of one group."""
    named = {f"i{k}": {"type": "instance", "to_world": m, "r": GROUP}
             for k, m in enumerate(matrices)}  # fmt: skip
    return load_dict({**SCENE, "g": {"type": "shapegroup", **group}, **named, **more})


@pytest.mark.parametrize("matrix", MATRICES)
def test_an_instance_is_its_shapes_written_out(tmp_path, matrix):
    group, matrix = members(tmp_path), MATRICES[matrix]
    scene = instanced(group, matrix, np.eye(4))
    written = {
        f"{key}{k}": {**shape, "to_world": transform.compose(m, shape.get("to_world", np.eye(4)))}
        for k, m in enumerate((matrix, np.eye(4)))
        for key, shape in group.items()
    }
    same = load_dict({**SCENE, **written})
    for name in ("triangles", "triangle_shape", "sphere_shape", "disk_shape", "sphere_inward"):
        assert (getattr(scene, name) == getattr(same, name)).all(), name
    for name in ("vertices", "normals", "spheres", "disks"):
        assert np.abs(getattr(scene, name) - getattr(same, name)).max() < 1e-13, name
    # in the written scene each bsdf stands twice
    assert (scene.reflectance[scene.triangle_material] ==
            same.reflectance[same.triangle_material]).all()  # fmt: skip
    assert len(scene.reflectance) == 3 and len(same.reflectance) == 5
    boxes = scene.triangle_shape < 1
    assert (scene.vertices[scene.triangles[boxes]] == same.vertices[same.triangles[boxes]]).all()


def test_names_and_places(tmp_path):
    path = tmp_path / "a.xml"
    path.write_text(
        """<scene version="3.0.0">
    <sensor type="perspective"><float name="fov" value="40"/></sensor>
    <emitter type="constant"/>
    <shape type="shapegroup" id="pair"><shape type="cube" id="box"/><shape type="sphere"/></shape>
    <shape type="instance" id="left"><ref id="pair"/></shape>
    <shape type="rectangle"/>
    <shape type="instance"><ref id="pair"/>
        <transform name="to_world"><translate x="3"/></transform></shape>
    <shape type="merge"><shape type="disk"/><shape type="disk" id="d"/></shape>
</scene>"""
    )
    scene = load_file(path)
    assert scene.shape_names == (
        "left/box", "left/sphere_1", "rectangle_2", "instance_1/box", "instance_1/sphere_4",
        "disk_5", "d",
    )  # fmt: skip
    assert scene.triangle_shape.tolist() == [0] * 12 + [2, 2] + [3] * 12
    assert scene.sphere_shape.tolist() == [1, 4] and scene.disk_shape.tolist() == [5, 6]
    for row, line in (("triangles[3]", 5), ("spheres[1]", 7), ("triangles[13]", 6)):
        assert scene.place(row) == f"{path}:{line}"
    assert np.abs(scene.spheres[1] - [3, 0, 0, 1]).max() == 0


def test_a_group_alone_shows_nothing(tmp_path):
    scene = instanced(members(tmp_path))
    assert not len(scene.triangles) and not len(scene.spheres) and not len(scene.disks)
    scene = instanced({}, np.eye(4))
    assert not len(scene.triangles)


def test_a_lamp_in_a_group_shines_in_each_instance():
    lamp = {"type": "rectangle", "emitter": {"type": "area", "radiance": 2.0}}
    scene = instanced({"l": lamp}, np.eye(4), TURN)
    assert len(scene.emissions) == 1 and (scene.triangle_emission == 0).all()


def test_merged_shapes_are_shapes(tmp_path):
    group = members(tmp_path)
    merged = load_dict({**SCENE, "m": {"type": "merge", **group}})
    plain = load_dict({**SCENE, **group})
    assert merged.sha256 == plain.sha256
    nested = instanced({"m": {"type": "merge", **group}}, TURN)
    assert nested.sha256 == instanced(group, TURN).sha256
    inside = {"type": "merge", "i": {"type": "instance", "r": GROUP, "to_world": TURN}}
    assert instanced(group, m=inside).sha256 == nested.sha256


def test_a_mesh_of_a_group_is_read_once(tmp_path, monkeypatch):
    group, read = members(tmp_path), []
    original = shapes.mesh.read
    monkeypatch.setattr(shapes.mesh, "read", lambda *a, **k: read.append(a) or original(*a, **k))
    with pytest.warns(SceneWarning, match="is open"):
        (tmp_path / "t.obj").write_text(OBJ.replace("f 1 3 2\n", ""))
        group["e"]["bsdf"] = {"type": "dielectric"}
        scene = instanced(group, *[TURN] * 9)
    assert len(read) == 1 and len(scene.triangles) == 9 * (12 + 2 + 3 + 512)


def test_the_memory_of_instances_is_stated_and_bounded(tmp_path):
    ball = trimesh.creation.icosphere(subdivisions=6)
    (tmp_path / "ball.obj").write_text(ball.export(file_type="obj", include_normals=False))
    group = {"b": {"type": "obj", "filename": tmp_path / "ball.obj"}}
    begin = time.process_time()
    with pytest.raises(SceneError) as caught:
        instanced(group, *[TURN] * 700)
    assert str(caught.value) == (
        'scene.i610: instance "i610": with it, 611 instances make more than 50000000 triangles of '
        "their own; instances share no memory"
    )
    assert time.process_time() - begin < 20
    found = shapes.Shapes()
    values = {"to_world": np.eye(4), "flip_normals": False, "p0": (0, 0, 0), "p1": (1, 0, 0)}
    values["radius"] = 1.0
    box, tube = (
        (Node(kind, "there", "shape"), values, (0, -1, -1), "") for kind in ("cube", "cylinder")
    )
    found.add(tube)
    found.instance(Node("instance", "here"), TURN, [box, tube])
    found.instance(Node("instance", "then"), TURN, [box])
    text = (
        "2 instances are rendered as shapes of their own: 3 shapes with 536 triangles, about 1 MB"
    )
    assert found.notes() == [
        (text, "here"),
        ("2 cylinders are rendered as prisms of 256 sides", "there"),
    ]


def test_many_shapes_of_instances_are_bounded(monkeypatch):
    monkeypatch.setitem(shapes.MAX_INSTANCED, "shapes", 1000)
    group = {f"s{k}": {"type": "sphere", "center": [k, 0, 0]} for k in range(100)}
    assert len(instanced(group, *[TURN] * 10).spheres) == 1000
    with pytest.raises(SceneError, match="11 instances make more than 1000 shapes of their own"):
        instanced(group, *[TURN] * 11)


BALL = {"type": "sphere", "center": [0.2, 0.1, -0.3], "radius": 0.8}


@pytest.mark.parametrize("mirror", [1, -1])
@pytest.mark.parametrize("flip", [False, True])
def test_a_stretched_sphere_is_an_ellipsoid(mirror, flip):
    """Its points by the sphere's equation in local space, to 1.6e-4 of the radius, fronts outside;
    coordinates by angles there. Without stretch it is a sphere."""
    matrix = UNEVEN @ np.diag([mirror, 1, 1, 1])
    scene = instanced({"s": {**BALL, "flip_normals": flip}}, matrix)
    text = "1 spheres that instances stretch are rendered as meshes of 65024 triangles"
    assert any(text in note for note in scene.notes)
    assert len(scene.triangles) == 65024 and not len(scene.spheres)
    local = np.linalg.inv(matrix)
    corners = scene.vertices[scene.triangles]
    middle = corners.mean(axis=1) @ local[:3, :3].T + local[:3, 3] - BALL["center"]
    radii = np.linalg.norm(middle, axis=1) / 0.8
    assert radii.max() < 1 and radii.min() > 1 - 1.6e-4
    outward = middle @ local[:3, :3]
    facing = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    sides = (outward * facing).sum(axis=1) * (-1 if flip else 1)
    assert (sides > 0).all()
    cosines = (scene.normals[scene.triangles].mean(axis=1) * outward).sum(axis=1)
    cosines /= np.linalg.norm(outward, axis=1)
    assert (cosines * (-1 if flip else 1) > 0.99).all()
    edges = np.sort(scene.triangles[:, [[0, 1], [1, 2], [2, 0]]].reshape(-1, 2))
    points = np.unique(np.round(scene.vertices, 9), axis=0, return_inverse=True)[1].reshape(-1)
    pairs = np.unique(np.sort(points[edges]), axis=0, return_counts=True)[1]
    assert (pairs == 2).all(), "closed"
    assert len(instanced({"s": BALL}, TURN).spheres) == 1


def test_a_sphere_scaled_unevenly_in_a_group_is_one_before_instances():
    """As in Mitsuba: of the scale of x, then stretched."""
    own = np.diag([0.5, 2.0, 1.0, 1.0])
    with pytest.warns(SceneWarning, match="as in Mitsuba it is a sphere of radius 0.4"):
        even = instanced({"s": {**BALL, "to_world": own}}, TURN)
    radius = even.spheres[0, 3]
    assert radius == pytest.approx(0.4)
    with pytest.warns(SceneWarning, match="as in Mitsuba it is a sphere of radius 0.4"):
        scene = instanced({"s": {**BALL, "to_world": own}}, UNEVEN)
    local = np.linalg.inv(UNEVEN)
    points = scene.vertices @ local[:3, :3].T + local[:3, 3]
    centre = own[:3, :3] @ BALL["center"]
    np.testing.assert_allclose(np.linalg.norm(points - centre, axis=1), 0.4, rtol=1e-9)


@pytest.mark.parametrize("bsdf", ["diffuse", "dielectric"])
def test_a_stretched_sphere_is_mitsubas(bsdf, device):
    """Texture coordinates of matt ones, to 1e-4; of glass under an even sky all pixels are 1, which
    they are not in Mitsuba 3.9.1."""
    bitmap = {"type": "bitmap", "raw": True, "wrap_mode": "clamp"}
    matrix = np.linalg.inv(UNEVEN)
    rng = np.random.default_rng(1)
    for _ in range(6):
        towards = rng.normal(size=3)
        local = np.append(np.array(BALL["center"]) + 0.8 * towards / np.linalg.norm(towards), 1)
        hit = (UNEVEN @ local)[:3]
        outward = matrix[:3, :3].T @ towards
        eye = hit + 3 * outward / np.linalg.norm(outward)
        up = [0.6, 0.8, 0.0]
        view = {"type": "perspective", "fov": 1e-4,
                "to_world": transform.look_at(eye.tolist(), hit.tolist(), up),
                "film": {"type": "hdrfilm", "width": 1, "height": 1}}  # fmt: skip
        x, y, z = towards / np.linalg.norm(towards)
        expected = [np.arctan2(y, x) / (2 * np.pi) % 1, np.arccos(z) / np.pi]
        found = []
        for axis in range(2):
            texels = np.array([0.0, 1.0], np.float32).reshape((1, 2, 1) if axis == 0 else (2, 1, 1))
            material = {"type": bsdf}
            if bsdf == "diffuse":
                material["reflectance"] = {**bitmap, "bitmap": texels}
            scene = instanced({"s": {**BALL, "bsdf": material}}, UNEVEN, sensor=view)
            found.append(veriray.render(scene, 16, device=device, max_depth=64).image[0, 0, 0])
        if bsdf == "diffuse":
            np.testing.assert_allclose(
                found, np.clip(2 * np.array(expected) - 0.5, 0, 1), atol=2e-4
            )
        else:
            np.testing.assert_allclose(found, 1, atol=1e-6)


NEST = {"type": "merge", "i": {"type": "instance", "r": GROUP}}
BAD = {
    "nothing": ({"i": {"type": "instance"}}, "scene.i: instance \"i\" has no shape; .* shapegroup"),
    "a cube": ({"i": {"type": "instance", "c": {"type": "cube"}}}, "cannot hold a shape \"cube\""),
    "unknown": ({"i": {"type": "instance", "r": {"type": "ref", "id": "x"}}}, "no object .* \"x\""),
    "two": ({"i": {"type": "instance", "r": GROUP, "s": GROUP}}, "2 objects of category shape"),
    "bsdf": ({"i": {"type": "instance", "r": GROUP, "b": red()}}, "cannot hold a bsdf"),
    "flip": ({"i": {"type": "instance", "r": GROUP, "flip_normals": True}}, "unknown parameter"),
    "group moved": ({"h": {"type": "shapegroup", "to_world": TURN}}, "give it to the instances"),
    "nested": ({"h": {"type": "shapegroup", "i": {"type": "instance", "r": GROUP}}},
               "cannot hold a shape \"instance\""),
    "nested in merge": ({"h": {"type": "shapegroup", "m": NEST}},
                        "merge: a group cannot hold an instance"),
    "merge in merge": ({"m": {"type": "merge", "n": {"type": "merge"}}}, "cannot hold a shape"),
    "itself": ({"m": {"type": "merge", "n": {"type": "ref", "id": "m"}}}, "cannot hold a shape"),
    "merge moved": ({"m": {"type": "merge", "to_world": TURN}}, "unknown parameter"),
    "flat sphere": ({"i": {"type": "instance", "r": GROUP, "to_world": np.diag([1.0, 1, 0, 1])}},
                    "to_world"),
    "far": ({"i": {"type": "instance", "r": {"type": "ref", "id": "f"},
                   "to_world": np.diag([1e99, 1e99, 1e99, 1])}}, "a vertex exceeds 1e\\+100"),
    "far disk": ({"i": {"type": "instance", "r": {"type": "ref", "id": "k"},
                        "to_world": np.diag([1e99, 1e99, 1e99, 1])}}, "disks"),
}  # fmt: skip


@pytest.mark.parametrize("name", BAD)
def test_bad_instances(name):
    values, message = BAD[name]
    far = np.diag([100.0, 100, 100, 1])
    groups = {
        "g": {"type": "shapegroup", "s": {"type": "sphere"}},
        "f": {"type": "shapegroup", "s": {"type": "cylinder", "radius": 200.0}},
        "k": {"type": "shapegroup", "s": {"type": "disk", "to_world": far}},
    }
    with pytest.raises(SceneError, match=message):
        load_dict({**SCENE, **groups, **values})


# ---- against Mitsuba ----


@pytest.fixture(scope="module")
def mi():
    module = pytest.importorskip("mitsuba", reason="compares with Mitsuba 3 itself")
    module.set_variant("scalar_rgb")
    return module


def mitsubas(mi, content):
    """A dictionary with Mitsuba's own transforms."""
    if isinstance(content, dict):
        return {key: mitsubas(mi, value) for key, value in content.items()}
    if isinstance(content, np.ndarray):
        return mi.ScalarTransform4f(content)
    return str(content) if hasattr(content, "parent") else content


def shading_normal(scene, event):
    """At an event's place."""
    if event["primitive"] >= len(scene.triangles):
        return np.array(event["normal"])
    index = scene.triangles[event["primitive"]]
    if not scene.normals[index].any():
        return np.array(event["normal"])
    weights = np.linalg.lstsq(np.vstack([scene.vertices[index].T, np.ones(3)]),
                              [*event["position"], 1.0], rcond=None)[0]  # fmt: skip
    normal = weights @ scene.normals[index]
    return normal / np.linalg.norm(normal)


@pytest.mark.parametrize("matrix", [*MATRICES, "uneven"])
def test_instances_are_mitsubas(mi, tmp_path, matrix):
    """The rays of a camera meet the same places, normals and sides."""
    group, matrix = members(tmp_path), {**MATRICES, "uneven": UNEVEN}[matrix]
    if matrix is UNEVEN:
        del group["b"]
    middle = (matrix @ [10.5, 0.5, 0.5, 1])[:3]
    scale = max(1, np.linalg.det(matrix[:3, :3]) ** 2) ** (1 / 6)
    place = transform.look_at(middle + [13, 31, 60], middle, [0, 1, 0])
    sensor = {**SENSOR, "fov": 28.0 * scale, "to_world": place}
    film = {"type": "hdrfilm", "width": 64, "height": 64, "rfilter": {"type": "box"}}
    content = {**SCENE, "sensor": {**sensor, "film": film},
               "g": {"type": "shapegroup", **group},
               "i": {"type": "instance", "to_world": matrix, "r": GROUP}}  # fmt: skip
    ours, theirs = load_dict(content), mi.load_dict(mitsubas(mi, content))
    kinds = set()
    for k in range(64 * 64):
        event = veriray.trace_path(ours, k % 64, k // 64, 0)[0]
        origin = np.array(ours.camera.to_world)[:3, 3]
        if event["primitive"] < 0:
            continue
        place = np.array(event["position"])
        way = place - origin
        length = np.linalg.norm(way)
        hit = theirs.ray_intersect(mi.Ray3f(origin.tolist(), (way / length).tolist()))
        if not hit.is_valid() or abs(hit.t - length) > 2e-3 * length:
            kinds.add("edge")
            continue
        normal = shading_normal(ours, event)
        if not (matrix is UNEVEN and hit.shape.id() == "e"):
            # Mitsuba interpolates before it transforms, which matters where normals differ much
            assert np.abs(np.array(hit.sh_frame.n) - normal).max() < 2e-3
        assert np.array(hit.n) @ event["normal"] > 0.999
        kinds.add(hit.shape.id())
    assert kinds - {"edge"} == set(group)
