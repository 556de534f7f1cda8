"""glTF files: meshes, nodes, cameras, lights and materials; against trimesh; damage."""

import base64
import copy
import io
import json
import math
import struct
import warnings

import numpy as np
import pytest
import trimesh
from PIL import Image

import veriray
from veriray.columns import LIGHT_KINDS, MATERIAL_KINDS
from veriray.errors import SceneError, SceneWarning
from veriray.formats import gltf_materials, gltf_tangents, images
from veriray.formats.plugins import PLUGINS

VERTICES = [[0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0.5]]
TYPES = {"i1": 5120, "u1": 5121, "i2": 5122, "u2": 5123, "u4": 5125, "f4": 5126}
FORMS = {1: "SCALAR", 2: "VEC2", 3: "VEC3", 4: "VEC4"}


class Model:
    """A file in the making."""

    def __init__(self, **content):
        self.data = b""
        self.content = {
            "asset": {"version": "2.0"}, "accessors": [], "bufferViews": [], "meshes": [],
            "nodes": [], **content,
        }  # fmt: skip

    def array(self, values, kind="f4", stride=0, **more):
        """Adds an accessor; its number."""
        table = np.array(values, "<" + kind)
        table = table.reshape(len(table), -1)
        self.data += bytes(-len(self.data) % 4)
        rows = [row.tobytes().ljust(stride, b"\xee") for row in table]
        view = {"buffer": 0, "byteOffset": len(self.data), "byteLength": len(b"".join(rows))}
        if stride:
            view["byteStride"] = stride
        self.data += b"".join(rows)
        self.content["bufferViews"].append(view)
        self.content["accessors"].append({
            "bufferView": len(self.content["bufferViews"]) - 1, "componentType": TYPES[kind],
            "count": len(table), "type": FORMS[table.shape[1]], **more,
        })  # fmt: skip
        return len(self.content["accessors"]) - 1

    def mesh(self, position, indices=None, node=None, **more):
        """Adds a mesh of one primitive, and a node that shows it."""
        attributes = {"POSITION": position, **more.pop("attributes", {})}
        part = {"attributes": attributes, **more}
        if indices is not None:
            part["indices"] = indices
        self.content["meshes"].append({"primitives": [part]})
        number = len(self.content["meshes"]) - 1
        self.content["nodes"].append({"mesh": number, **(node or {})})

    def text(self, uri=None):
        """As .gltf."""
        uri = uri or "data:application/octet-stream;base64," + base64.b64encode(self.data).decode()
        buffers = [{"byteLength": len(self.data), "uri": uri}]
        return json.dumps({**self.content, "buffers": buffers}).encode()

    def glb(self):
        """As .glb."""
        data = self.data + bytes(-len(self.data) % 4)
        head = json.dumps({**self.content, "buffers": [{"byteLength": len(self.data)}]}).encode()
        head += b" " * (-len(head) % 4)
        body = struct.pack("<I4s", len(head), b"JSON") + head
        body += struct.pack("<I4s", len(data), b"BIN\0") + data
        return b"glTF" + struct.pack("<II", 2, 12 + len(body)) + body


def load(folder, model, name="a.gltf"):
    """The scene of a model or of bytes, and what it warns of."""
    data = model if isinstance(model, bytes) else model.text()
    (folder / name).write_bytes(data)
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always")
        scene = veriray.load_file(folder / name)
    assert all(w.category is SceneWarning for w in caught)
    return scene, "; ".join(str(w.message) for w in caught)


def quad(**more):
    """A model of one mesh of two triangles."""
    model = Model()
    model.mesh(model.array(VERTICES), model.array([0, 1, 2, 0, 2, 3], "u2"), **more)
    return model


CORNERS = np.array(VERTICES, float)[[[0, 1, 2], [0, 2, 3]]]


def corners(scene):
    return scene.vertices[scene.triangles]


@pytest.mark.parametrize("kind", ["u1", "u2", "u4"])
@pytest.mark.parametrize(
    ("mode", "indices"),
    [(4, [0, 1, 2, 0, 2, 3]), (5, [1, 2, 0, 3]), (6, [0, 1, 2, 3]), (4, [0, 1, 2, 0, 2, 3, 1])],
)
def test_triangles(tmp_path, kind, mode, indices):
    model = Model()
    model.mesh(model.array(VERTICES, stride=20), model.array(indices, kind), mode=mode)
    scene, text = load(tmp_path, model)
    expected = CORNERS if mode != 5 else np.array(VERTICES)[[[1, 2, 0], [0, 2, 3]]]
    assert (corners(scene) == expected).all() and not scene.normals.any()
    assert "no camera" in text and "a white sky was added" in text
    assert scene.environment.tolist() == [1, 1, 1] and scene.shape_names == ("mesh",)


def test_without_indices_and_with_normals(tmp_path):
    model = Model()
    normals = model.array([[0, 0, 1], [0.6, 0, 0.8], [0, 0, 1]])
    model.mesh(model.array(VERTICES[:3]), attributes={"NORMAL": normals, "TEXCOORD_0": 0})
    with pytest.raises(SceneError, match=r'a.gltf: meshes\[0\].primitives\[0\]: .*"uv" has shape'):
        load(tmp_path, model)
    uv = model.array([[0, 0], [1, 0], [0.5, 2]])
    model.content["meshes"][0]["primitives"][0]["attributes"]["TEXCOORD_0"] = uv
    scene, _ = load(tmp_path, model)
    assert np.abs(scene.normals - [[0, 0, 1], [0.6, 0, 0.8], [0, 0, 1]]).max() < 1e-7


def test_forms_of_numbers(tmp_path):
    """Quantized, normalized, sparse, interleaved: the same vertices."""
    plain, _ = load(tmp_path, quad())
    sparse = quad()
    rows, new = sparse.array([1, 3], "u1"), sparse.array([VERTICES[1], VERTICES[3]])
    views = {
        "indices": {"bufferView": rows, "componentType": 5121},
        "values": {"bufferView": new, "componentType": 5126},
    }
    zeros = np.array(VERTICES) * [[1], [0], [1], [0]]
    sparse.content["accessors"][0] |= {"sparse": {"count": 2, **views}}
    start = sparse.content["bufferViews"][0]["byteOffset"]
    sparse.data = sparse.data[:start] + zeros.astype("<f4").tobytes() + sparse.data[start + 48 :]
    quantized = Model()
    place = quantized.array(np.array(VERTICES) * 2, "i2", stride=8)
    quantized.mesh(place, quantized.array([0, 1, 2, 0, 2, 3], "u1"), {"scale": [0.5] * 3})
    normalized = Model(extensionsRequired=["KHR_mesh_quantization"])
    place = normalized.array(np.array(VERTICES) * 254 // 2, "i1", stride=4, normalized=True)
    normalized.mesh(place, normalized.array([0, 1, 2, 0, 2, 3], "u1"))
    for model in (sparse, quantized):
        assert (corners(load(tmp_path, model)[0]) == corners(plain)).all()
    assert np.abs(corners(load(tmp_path, normalized)[0]) - corners(plain)).max() < 0.004


def test_glb_is_gltf(tmp_path):
    model = quad()
    one, _ = load(tmp_path, model)
    two, _ = load(tmp_path, model.glb(), "a.glb")
    (tmp_path / "the data.bin").write_bytes(model.data)
    three, _ = load(tmp_path, model.text("the%20data.bin"))
    assert one.sha256 == two.sha256 == three.sha256


def test_nodes_are_composed_as_trimesh_does(tmp_path):
    rng = np.random.default_rng(1)
    model = quad()
    model.content["nodes"] = []
    matrices = []
    for k in range(6):
        q = rng.normal(size=4)
        q /= np.linalg.norm(q)
        scale = rng.uniform(0.5, 2, 3) * [1, -1 if k == 3 else 1, 1]
        node = {"translation": rng.normal(size=3).tolist(), "rotation": q.tolist()}
        node["scale"] = scale.tolist()
        if k == 4:
            node = {"matrix": [*(2 * np.eye(4))[:3].ravel(), 1, 2, 3, 1]}
        if k in (1, 3, 5):
            node["mesh"] = 0
        if k < 4:
            node["children"] = [k + 1]
        model.content["nodes"].append(node)
        matrices.append(node)
    model.content["scenes"] = [{"nodes": [5]}, {"nodes": [0, 5]}]
    model.content["scene"] = 1
    scene, _ = load(tmp_path, model)
    assert scene.shape_names == ("mesh/mesh_0", "mesh.1/mesh_1", "mesh.2/mesh_2")
    theirs = trimesh.load_scene(tmp_path / "a.gltf").to_mesh()
    ours = np.sort(corners(scene).mean(axis=1), axis=0)
    assert np.abs(ours - np.sort(theirs.triangles.mean(axis=1), axis=0)).max() < 1e-6
    del model.content["scene"]
    assert len(load(tmp_path, model)[0].triangles) == 2
    del model.content["scenes"]  # all nodes without parents
    assert len(load(tmp_path, model)[0].triangles) == 6


def test_a_mesh_of_many_nodes_is_an_instance(tmp_path):
    model = quad(node={"name": "x"})
    model.content["meshes"][0]["primitives"] *= 2
    scene, _ = load(tmp_path, model)
    assert scene.shape_names == ("x/0", "x/1") and len(scene.triangles) == 4
    model.content["nodes"] += [{"mesh": 0, "name": "x"}, {"mesh": 0, "scale": [0, 1, 1]}]
    scene, text = load(tmp_path, model)
    assert len(scene.triangles) == 8 and "a mesh whose node flattens space is not shown" in text
    assert {name.rpartition("/")[0] for name in scene.shape_names} == {"x", "x.1"}


def test_the_camera(tmp_path):
    half = math.sqrt(0.5)
    camera = {"type": "perspective", "perspective": {"yfov": 1.0, "aspectRatio": 2.0, "znear": 1}}
    model = quad(node={"translation": [-5, 1, 0]})
    model.content["cameras"] = [camera]
    model.content["nodes"] += [
        {"camera": 0, "translation": [1, 2, 3], "rotation": [0, half, 0, half], "scale": [2] * 3}
    ]
    scene, text = load(tmp_path, model)
    assert "no camera" not in text and (scene.film.width, scene.film.height) == (1152, 576)
    assert scene.camera.fov == pytest.approx(math.degrees(1.0)) and scene.camera.fov_axis == "y"
    # turned by 90 degrees about y it looks along -x, its right is -z
    expected = np.array([[0, 0, -1, 1], [0, 1, 0, 2], [1, 0, 0, 3], [0, 0, 0, 1]])
    assert np.abs(scene.camera.to_world - expected).max() < 1e-15
    model.content["nodes"] += [{"children": [1], "scale": [1, 2, 1]}]
    assert "shears" not in load(tmp_path, model)[1]  # turned by a right angle
    model.content["nodes"][1]["rotation"] = [0, 0, math.sin(0.2), math.cos(0.2)]
    assert "cameras[0]: its node shears it, and so its picture" in load(tmp_path, model)[1]
    del model.content["nodes"][2]
    model.content["nodes"][1]["rotation"] = [0, half, 0, half]
    assert "shears" not in load(tmp_path, model)[1]
    parallel = {"xmag": 3.0, "ymag": 1.5, "znear": 0.0, "zfar": 9.0}
    model.content["cameras"] = [{"type": "orthographic", "orthographic": parallel}]
    scene, text = load(tmp_path, model)
    assert "no camera" not in text and scene.camera.projection == "orthographic"
    assert (scene.film.width, scene.film.height) == (1152, 576)
    ends = scene.camera.tan_half_x(1152, 576), scene.camera.tan_half_y(1152, 576)
    assert ends == pytest.approx((3.0, 1.5))
    assert np.abs(scene.camera.placed - expected).max() < 1e-15


def test_a_scene_without_camera_is_framed(tmp_path):
    """All of it is seen, and most of the picture is it."""
    model = Model()
    ball = trimesh.creation.icosphere(subdivisions=3)
    model.mesh(model.array(ball.vertices * [3, 1, 1] + 7), model.array(ball.faces.ravel(), "u2"))
    scene, _ = load(tmp_path, model)
    points = np.c_[scene.vertices, np.ones(len(scene.vertices))]
    seen = points @ np.linalg.inv(scene.camera.to_world).T
    reach = np.abs(seen[:, :2] / seen[:, 2:3]).max()
    assert (seen[:, 2] > 0).all() and 0.5 < reach / math.tan(math.radians(20)) < 1


def test_lights(tmp_path):
    quarter = [math.sqrt(0.5), 0, 0, math.sqrt(0.5)]
    lights = [
        {"type": "point", "color": [1, 0.5, 0], "intensity": 3, "range": 4},
        {"type": "directional", "intensity": 2},
        {"type": "spot", "spot": {"outerConeAngle": 0.5, "innerConeAngle": 0.25}},
        {"type": "spot", "intensity": 0},
    ]
    name = "KHR_lights_punctual"
    model = quad()
    model.content |= {"extensions": {name: {"lights": lights}}, "extensionsRequired": [name]}
    model.content["nodes"] += [
        {"extensions": {name: {"light": k}}, "translation": [k, 1, 2], "rotation": quarter,
         "scale": [3] * 3} for k in range(4)
    ]  # fmt: skip
    scene, text = load(tmp_path, model)
    assert "sky" not in text and not scene.environment.any() and "range of a light" in text
    kinds = [LIGHT_KINDS[k] for k in scene.light_kind]
    assert kinds == ["point", "directional", "spot"]
    assert scene.light_intensity.tolist() == [[3, 1.5, 0], [2, 2, 2], [1, 1, 1]]
    assert scene.light_position[[0, 2]].tolist() == [[0, 1, 2], [2, 1, 2]]
    # turned by 90 degrees about x, -z is +y
    assert np.abs(scene.light_direction[1:] - [0, 1, 0]).max() < 1e-15
    assert scene.light_angles[2] == pytest.approx([math.degrees(0.5), math.degrees(0.25)])


def test_materials(tmp_path):
    rough = {"baseColorFactor": [0.25, 0.5, 0.75, 0.125], "metallicFactor": 0}
    strength = {"KHR_materials_emissive_strength": {"emissiveStrength": 4}}
    materials = [
        {"pbrMetallicRoughness": rough},
        {"pbrMetallicRoughness": rough, "alphaMode": "BLEND"},
        {"pbrMetallicRoughness": rough, "alphaMode": "MASK", "alphaCutoff": 0.1},
        {"pbrMetallicRoughness": rough, "alphaMode": "MASK"},
        {"emissiveFactor": [1, 0.5, 0], "extensions": strength},
        {"emissiveFactor": [0, 0, 0]},
    ]
    model = Model(materials=materials)
    place = model.array(VERTICES)
    for k in range(7):
        model.mesh(place, model.array([0, 1, 2], "u1"), **({"material": k} if k < 6 else {}))
    scene, text = load(tmp_path, model)
    rows = scene.triangle_material
    assert scene.two_sided[rows].all()
    kinds = [MATERIAL_KINDS[k] for k in scene.material_kind[rows]]
    assert kinds == ["principled"] * 6 + ["diffuse"]
    colour = [0.25, 0.5, 0.75]
    assert scene.reflectance[rows].tolist() == [colour] * 4 + [[1, 1, 1]] * 3
    assert scene.metallic[rows[:6]].tolist() == [0] * 4 + [1, 1]
    assert (scene.roughness[rows[:6]] == 1).all()
    assert np.abs(scene.eta[rows[:6]] - 1.5).max() < 1e-6
    assert scene.opacity[rows].tolist() == [1, 0.125, 1, 0, 1, 1, 1]
    assert scene.triangle_emission.tolist() == [-1] * 4 + [0, -1, -1]
    assert scene.emissions.tolist() == [[4, 2, 0]]
    assert "not applied" not in text and "sky" not in text


def test_extensions_of_materials(tmp_path):
    """As numbers of `principled`, or panes; what is left out is said."""
    given = [
        {"ior": {"ior": 1.4}},
        {"specular": {"specularFactor": 0.5, "specularColorFactor": [1, 0.5, 1]}},
        {"clearcoat": {"clearcoatFactor": 0.5, "clearcoatRoughnessFactor": 0.1}},
        {"sheen": {"sheenColorFactor": [0.25, 0.5, 0]}},
        {"transmission": {"transmissionFactor": 0.75}, "volume": {"thicknessFactor": 1}},
        {"transmission": {"transmissionFactor": 0.75}, "ior": {"ior": 1.25}},
        {"unlit": {}},
        {"pbrSpecularGlossiness": {"diffuseFactor": [0.5, 0.25, 1, 1], "glossinessFactor": 0.75}},
        {"ior": {"ior": 2.0}},
        {"transmission": {"transmissionFactor": 0.25}},
    ]
    rough = {"baseColorFactor": [0.5, 0.25, 1, 1], "metallicFactor": 0, "roughnessFactor": 0.5}
    materials = [
        {"pbrMetallicRoughness": rough,
         "extensions": {f"KHR_materials_{name}": value for name, value in row.items()}}
        for row in given
    ]  # fmt: skip
    model = Model(materials=materials)
    place = model.array(VERTICES)
    for k in range(len(given)):
        model.mesh(place, model.array([0, 1, 2], "u1"), material=k)
    scene, text = load(tmp_path, model)
    rows = scene.triangle_material
    kinds = [MATERIAL_KINDS[k] for k in scene.material_kind[rows]]
    assert kinds[4:7] == ["principled_open", "thindielectric", "diffuse"]
    assert {*kinds[:4], *kinds[7:]} == {"principled"}
    assert scene.two_sided[rows].tolist() == [True] * 4 + [False] * 2 + [True] * 4
    eta = scene.eta[rows][:, 0]
    half = (1 + math.sqrt(0.02)) / (1 - math.sqrt(0.02))  # reflects half of 4 %
    most = (1 + math.sqrt(0.08)) / (1 - math.sqrt(0.08))
    assert eta == pytest.approx([1.4, half, 1.5, 1.5, 1.5, 1.25, 1, 1.5, most, 1.5], abs=1e-5)
    assert scene.clearcoat[rows[2]] == 0.5
    assert scene.clearcoat_gloss[rows[2]] == pytest.approx((0.1 - 0.01) / 0.099)
    assert scene.sheen[rows[3]] == 0.5 and scene.spec_trans[rows[4]] == 0.75
    assert scene.specular_transmittance[rows[5]].tolist() == [0.5, 0.25, 1]
    assert (scene.reflectance[np.delete(rows, 5)] == [0.5, 0.25, 1]).all()
    assert scene.roughness[rows[7]] == 0.25 and scene.roughness[rows[0]] == 0.5
    for said in ("specularColorFactor", "unlit", "specular and glossiness", "above 1.79",
                 "a smooth pane", "below a half"):  # fmt: skip
        assert said in text


def test_an_unlit_material_emits_nothing(tmp_path):
    """Its colour is that of its base alone."""
    model = quad(material=0)
    unlit = {"KHR_materials_unlit": {}}
    model.content["materials"] = [{"emissiveFactor": [1, 1, 1], "extensions": unlit}]
    scene, text = load(tmp_path, model)
    assert not len(scene.emissions) and "unlit" in text and "a white sky was added" in text


def png(texels, mode="RGBA"):
    stream = io.BytesIO()
    Image.fromarray(np.array(texels, np.uint8), mode).save(stream, "PNG")
    return stream.getvalue()


TEXELS = np.random.default_rng(3).integers(0, 256, (4, 6, 4))


def textured(rough, data=None, texture=None, uv=None, **more):
    """A quad with a texture 0."""
    model = quad()
    numbers = model.array(uv or [[0, 0], [1, 0], [1, 1], [0, 1]])
    part = model.content["meshes"][0]["primitives"][0]
    part["attributes"][more.pop("coordinates", "TEXCOORD_0")] = numbers
    part["material"] = 0
    model.data += bytes(-len(model.data) % 4)
    data = png(TEXELS) if data is None else data
    view = {"buffer": 0, "byteOffset": len(model.data), "byteLength": len(data)}
    model.content["bufferViews"].append(view)
    model.data += data
    sampler = more.pop("sampler", {})
    model.content |= {
        "images": [{"bufferView": len(model.content["bufferViews"]) - 1, "mimeType": "image/png"}],
        "textures": [{"source": 0, "sampler": 0} if texture is None else texture],
        "samplers": [sampler],
        "materials": [{"pbrMetallicRoughness": rough, **more}],
    }
    return model


def test_textures_of_colour_roughness_and_metal(tmp_path):
    both = {"baseColorTexture": {"index": 0}, "metallicRoughnessTexture": {"index": 0}}
    model = textured(both, sampler={"wrapS": 33071, "wrapT": 33071, "magFilter": 9728})
    scene, text = load(tmp_path, model)
    assert "not applied" not in text
    names = ("reflectance", "metallic", "roughness")
    rows = [int(getattr(scene, f"{name}_texture")[scene.triangle_material[0]]) for name in names]
    assert sorted(rows) == [0, 1, 2]
    assert [scene.texture_format[row] for row in rows] == [0, 1, 1]  # sRGB, 8 bits
    assert [bool(scene.texture_grey[row]) for row in rows] == [False, True, True]
    assert set(scene.texture_wrap) == {2} and set(scene.texture_filter) == {1}
    assert (scene.texture_width == 6).all() and (scene.texture_height == 4).all()
    words = [scene.texels[int(scene.texture_first[row]) :].view(np.uint8) for row in rows]
    assert (words[0][: 4 * 24].reshape(4, 6, 4)[..., :3] == TEXELS[..., :3]).all()
    assert (words[1][:24].reshape(4, 6) == TEXELS[..., 2]).all()  # blue
    assert (words[2][:24].reshape(4, 6) == TEXELS[..., 1]).all()  # green
    # row 0 of the image is at v = 0, and v of a file is v
    assert scene.uv.tolist() == [[0, 0], [1, 0], [1, 1], [0, 1]]
    glb, _ = load(tmp_path, model.glb(), "a.glb")
    assert glb.sha256 == scene.sha256
    uri = base64.b64encode(png(TEXELS)).decode()
    model.content["images"] = [{"uri": f"data:image/png;base64,{uri}"}]
    assert load(tmp_path, model)[0].sha256 == scene.sha256
    (tmp_path / "an image.png").write_bytes(png(TEXELS))
    model.content["images"] = [{"uri": "an%20image.png"}]
    assert load(tmp_path, model)[0].sha256 == scene.sha256


def test_factors_of_textures(tmp_path):
    factors = {"baseColorFactor": [1, 0.5, 0.25, 1], "metallicFactor": 0.5}
    model = textured({
        **factors, "baseColorTexture": {"index": 0}, "metallicRoughnessTexture": {"index": 0}
    })  # fmt: skip
    scene, _ = load(tmp_path, model)
    row = int(scene.reflectance_texture[scene.triangle_material[0]])
    first = int(scene.texture_first[row])
    found = scene.texels[first : first + 72].view(np.float32).reshape(4, 6, 3)
    expected = images.SRGB_TO_LINEAR[TEXELS[..., :3]] * np.array([1, 0.5, 0.25], np.float32)
    assert (found == expected).all()
    row = int(scene.metallic_texture[scene.triangle_material[0]])
    first = int(scene.texture_first[row])
    found = scene.texels[first : first + 24].view(np.float32).reshape(4, 6)
    assert (found == images.BYTE_TO_SHARE[TEXELS[..., 2]] * np.float32(0.5)).all()


def test_a_texture_that_is_one_colour_is_a_number(tmp_path):
    data = png(np.tile([[[188, 0, 255, 255]]], (3, 3, 1)))
    info = {"baseColorTexture": {"index": 0}, "metallicRoughnessTexture": {"index": 0}}
    scene, _ = load(tmp_path, textured(info, data))
    row = scene.triangle_material[0]
    assert scene.reflectance[row].tolist() == [images.SRGB_TO_LINEAR[188], 0, 1]
    assert scene.metallic[row] == 1 and scene.roughness[row] == 0
    assert not len(scene.texture_kind)


def test_alpha_of_textures(tmp_path):
    rough = {"baseColorTexture": {"index": 0}, "baseColorFactor": [1, 1, 1, 0.5]}
    for mode, cut in (("BLEND", None), ("MASK", 0.25), ("OPAQUE", None)):
        more = {"alphaMode": mode} | ({"alphaCutoff": cut} if cut else {})
        scene, _ = load(tmp_path, textured(rough, **more))
        row = int(scene.opacity_texture[scene.triangle_material[0]])
        if mode == "OPAQUE":
            assert row == -1
            continue
        first = int(scene.texture_first[row])
        if mode == "BLEND":
            found = scene.texels[first : first + 24].view(np.float32)
            assert (found == images.BYTE_TO_SHARE[TEXELS[..., 3]].ravel() * np.float32(0.5)).all()
        else:
            found = scene.texels[first:].view(np.uint8)[:24]
            assert (found == np.where(TEXELS[..., 3].ravel() * 0.5 / 255 >= 0.25, 255, 0)).all()


def test_texture_coordinates_are_moved(tmp_path):
    """Scaled, turned counter-clockwise as seen on the image, and moved; of another set."""
    moved = {"offset": [0.25, 0.5], "rotation": math.pi / 2, "scale": [2, 3], "texCoord": 1}
    info = {"index": 0, "extensions": {"KHR_texture_transform": moved}}
    model = textured({"baseColorTexture": info}, coordinates="TEXCOORD_1")
    scene, text = load(tmp_path, model)
    assert "TEXCOORD" not in text and scene.uv.any()
    assert scene.texture_to_uv[0] == pytest.approx(np.array([[0, 3, 0.25], [-2, 0, 0.5]]), abs=1e-6)
    info["texCoord"] = 1
    del moved["texCoord"]
    assert load(tmp_path, model)[0].sha256 == scene.sha256
    info["texCoord"] = 0
    scene, text = load(tmp_path, model)
    assert "a textured primitive without TEXCOORD_0 shows one texel" in text
    assert not scene.uv.any()
    info["texCoord"] = 1
    model.content["materials"][0]["pbrMetallicRoughness"]["metallicRoughnessTexture"] = {"index": 0}
    assert "texture coordinates 0 are not used, 1 are" in load(tmp_path, model)[1]


def test_a_texture_may_be_scaled_to_a_line(tmp_path):
    """A scale of 0 picks one column of texels."""
    moved = {"offset": [0.25, 0.5], "scale": [0, 3]}
    info = {"index": 0, "extensions": {"KHR_texture_transform": moved}}
    lamp = {"emissiveTexture": info, "emissiveFactor": [1, 1, 1]}
    for model in (textured({"baseColorTexture": info}), textured({}, **lamp)):
        scene, _ = load(tmp_path, model)
        assert scene.texture_to_uv[0].tolist() == [[0, 0, 0.25], [0, 3, 0.5]]
        picture = veriray.render(scene, spp=4, width=8, height=8, device="cpu")
        assert np.isfinite(picture.image).all()
    moved["scale"] = [0, 0]
    scene, _ = load(tmp_path, model)
    assert scene.texture_to_uv[0].tolist() == [[0, 0, 0.25], [0, 0, 0.5]]


def test_normals_of_textures(tmp_path):
    """The texels as they are, or their x and y scaled."""
    for scale in (1, 0.5):
        info = {"index": 0, "scale": scale}
        scene, text = load(tmp_path, textured({}, uv=UPRIGHT, normalTexture=info))
        assert "not applied" not in text
        at = int(scene.relief_texture[scene.triangle_material[0]])
        assert at == 0 and scene.texture_format[at] == (1 if scale == 1 else 3)
        if scale == 1:
            found = scene.texels.view(np.uint8).reshape(4, 6, 4)[..., :3]
            assert (found == TEXELS[..., :3]).all()
        else:
            given = (TEXELS[..., :3] / 127.5 - 1) * [0.5, 0.5, 1]
            assert (
                np.abs(2 * scene.texels.view(np.float32).reshape(4, 6, 3) - 1 - given).max() < 1e-6
            )


def shaded(folder, texel, uv, **more):
    """The normal that is seen of a square upright before the camera, and what is warned of."""
    texels = np.tile(np.array(texel), (2, 2, 1))
    texels[0, 0, 0] += more.pop("other", 0)
    node, tangent = more.pop("node", {}), more.pop("tangent", None)
    model = textured({}, png(texels, "RGB"), uv=uv, normalTexture={"index": 0, **more})
    part = model.content["meshes"][0]["primitives"][0]["attributes"]
    place = [[-1, -1, 0], [1, -1, 0], [1, 1, 0], [-1, 1, 0]]
    part |= {"POSITION": model.array(place), "NORMAL": model.array([[0, 0, 1]] * 4)}
    if tangent is not None:
        part["TANGENT"] = model.array([tangent] * 4)
    camera = {"type": "perspective", "perspective": {"yfov": 0.8, "aspectRatio": 1, "znear": 0.1}}
    model.content["cameras"] = [camera]
    model.content["nodes"][0] |= node
    model.content["nodes"] += [{"camera": 0, "translation": [0, 0, 5]}]
    scene, text = load(folder, model)
    found = veriray.feature_images(scene, ("normal",), spp=1, width=8, height=8, device="cpu")
    return found["normal"][3, 4], text


UPRIGHT = [[0, 1], [1, 1], [1, 0], [0, 0]]  # of a quad whose v is down, as in an image
MIRRORED = [[1, 1], [0, 1], [0, 0], [1, 0]]
TILTED = [178, 204, 218]
NORMAL = np.array(TILTED) / 127.5 - 1
NORMAL /= np.linalg.norm(NORMAL)


@pytest.mark.parametrize("other", [0, 1])
@pytest.mark.parametrize(
    ("uv", "scale", "signs"),
    [
        (UPRIGHT, [1, 1, 1], [1, 1, 1]),
        (MIRRORED, [1, 1, 1], [-1, 1, 1]),
        (UPRIGHT[::-1], [1, 1, 1], [1, -1, 1]),
        (UPRIGHT, [-1, 1, 1], [-1, 1, 1]),
        (MIRRORED, [-1, 1, 1], [1, 1, 1]),
        (UPRIGHT, [1, -1, 1], [1, -1, 1]),
    ],
)
def test_normals_are_turned_with_the_image(tmp_path, uv, scale, signs, other):
    """x along u and y up on the image, also where that is mirrored, and of an even image."""
    found, text = shaded(tmp_path, TILTED, uv, other=other, node={"scale": scale})
    assert np.abs(found - NORMAL * signs).max() < 5e-3 and "TANGENT" not in text


def test_an_image_is_mirrored_on_some_triangles(tmp_path):
    """On the right half, as of a face of which one half is painted; and once more in a node that
    mirrors."""
    xs, us = [0, 1, 1, 2], [0, 1, 1, 0]
    model = textured({}, uv=[[u, v] for v in (1, 0) for u in us], normalTexture={"index": 0})
    part = model.content["meshes"][0]["primitives"][0]
    part["attributes"]["POSITION"] = model.array([[x, y, 0] for y in (0, 1) for x in xs])
    part["indices"] = model.array([0, 1, 5, 0, 5, 4, 2, 3, 7, 2, 7, 6], "u2")
    scene, _ = load(tmp_path, model)
    assert len(scene.vertices) == 8 and len(scene.triangles) == 4
    middles = corners(scene)[..., 0].mean(axis=1)

    def green(triangle):
        at = int(scene.relief_texture[scene.triangle_material[triangle]])
        first = int(scene.texture_first[at])
        return scene.texels[first : first + 24].view(np.uint8).reshape(4, 6, 4)[..., 1]

    for k in range(4):
        given = TEXELS[..., 1]
        assert (green(k) == (given if middles[k] < 1 else 255 - given)).all()
    model.content["nodes"] += [{"mesh": 0, "scale": [-1, 1, 1]}]
    scene, _ = load(tmp_path, model)
    middles = corners(scene)[..., 0].mean(axis=1)
    assert len(middles) == 8
    for k in range(8):
        kept = -2 < middles[k] < -1 or 0 < middles[k] < 1
        assert (green(k) == (TEXELS[..., 1] if kept else 255 - TEXELS[..., 1])).all()


def halved():
    """A model of a node "nd" with two primitives: of the first an image lies mirrored on the right
    half, the second has a material of its own."""
    xs, us = [0, 1, 1, 2], [0, 1, 1, 0]
    model = textured({}, uv=[[u, v] for v in (1, 0) for u in us], normalTexture={"index": 0})
    mesh = model.content["meshes"][0]
    part = mesh["primitives"][0]
    part["attributes"]["POSITION"] = model.array([[x, y, 0] for y in (0, 1) for x in xs])
    part["indices"] = model.array([0, 1, 5, 0, 5, 4, 2, 3, 7, 2, 7, 6], "u2")
    rough = {"pbrMetallicRoughness": {"roughnessFactor": 0.75}}
    model.content["materials"].append(rough)
    second = {key: part["attributes"][key] for key in ("POSITION", "TEXCOORD_0")}
    mesh["primitives"].append({"attributes": second, "indices": part["indices"], "material": 1})
    model.content["nodes"][0]["name"] = "nd"
    return model


def test_names_do_not_depend_on_where_an_image_is_mirrored(tmp_path):
    """Numbers go by primitives, and one name reaches both halves of one."""
    model = halved()
    scene, _ = load(tmp_path, model)
    assert scene.shape_names == ("nd/0", "nd/0.mirrored", "nd/1")
    known = {name: value for name, value in scene.parameters().items() if "roughness" in name}
    assert known == {"nd/0.bsdf.roughness": 1, "nd/1.bsdf.roughness": 0.75}
    changed = scene.with_({"nd/0.bsdf.roughness": 0.25})
    assert changed.roughness[changed.triangle_material].tolist() == [0.25] * 4 + [0.75] * 4
    changed = scene.with_({"nd/0.mirrored.bsdf.roughness": 0.5})
    assert changed.roughness[changed.triangle_material].tolist() == [0.5] * 4 + [0.75] * 4
    del model.content["meshes"][0]["primitives"][1]
    model.content["nodes"].insert(0, {"mesh": 1, "name": "nd.mirrored"})
    model.content["meshes"].append(quad().content["meshes"][0])
    model.content["meshes"][1]["primitives"][0] = {
        **model.content["meshes"][0]["primitives"][0], "material": 1
    }  # fmt: skip
    assert load(tmp_path, model)[0].shape_names == ("nd.mirrored", "nd", "nd.mirrored.1")


def test_tangents_of_a_file_are_those_of_its_coordinates_or_said(tmp_path):
    turned = [math.cos(0.2), math.sin(0.2), 0, 1]
    for uv, tangent, said in (
        (UPRIGHT, [1, 0, 0, 1], False),
        (UPRIGHT, [math.cos(0.05), math.sin(0.05), 0, 1], False),
        (MIRRORED, [-1, 0, 0, -1], False),
        (UPRIGHT, turned, True),
        (UPRIGHT, [0, 1, 0, 1], True),
        (UPRIGHT, [1, 0, 0, -1], True),
        (MIRRORED, [-1, 0, 0, 1], True),
    ):
        _, text = shaded(tmp_path, TILTED, uv, tangent=tangent)
        assert ("TANGENT is not what texture coordinates give" in text) == said


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"indices": ([0.5, 1, 2], "f4")}, "faces"),
        ({"indices": ([0, 1, 9], "u2")}, "triangle 0 uses vertex 9"),
        ({"NORMAL": ([[0, 0, 1]] * 3, "f4")}, "has 3 rows for 4 vertices"),
        ({"NORMAL": ([[0, 1]] * 4, "f4")}, "has shape"),
    ],
)
def test_damaged_arrays_beside_a_normal_texture(tmp_path, change, message):
    model = textured({}, uv=UPRIGHT, normalTexture={"index": 0})
    part = model.content["meshes"][0]["primitives"][0]
    for key, given in change.items():
        (part if key == "indices" else part["attributes"])[key] = model.array(*given)
    with pytest.raises(SceneError, match=message):
        load(tmp_path, model)


def ball_of(rows, columns):
    """Places, which are normals, texture coordinates and triangles."""
    u, v = (x.ravel() for x in np.meshgrid(np.linspace(0, 1, columns + 1),
                                           np.linspace(0.1, 0.9, rows + 1)))  # fmt: skip
    east, south = 2 * math.pi * u, math.pi * v
    circle = np.stack([np.cos(east), 0 * east, -np.sin(east)], 1)
    ball = circle * np.sin(south)[:, None] + np.cos(south)[:, None] * [[0, 1, 0]]
    along = np.stack([-np.sin(east), 0 * east, -np.cos(east), east * 0 + 1], 1)
    a = ((columns + 1) * np.arange(rows)[:, None] + np.arange(columns)).reshape(-1, 1)
    faces = np.concatenate([a + [0, columns + 1, columns + 2], a + [0, columns + 2, 1]])
    return ball, np.stack([u, v], 1), along, faces


def averaged(places, uv, faces):
    """Tangents (V, 4) of a ball by MikkTSpace."""
    total = np.zeros_like(places)
    for face in faces:
        a, b = places[face[1:]] - places[face[0]]
        s, t = uv[face[1:], 1] - uv[face[0], 1]
        for k in range(3):
            normal = places[face[k]]
            own = b * s - a * t
            own -= normal * (normal @ own)
            one, other = places[face[[k - 1, k - 2]]] - normal
            cosine = one @ other / np.linalg.norm(one) / np.linalg.norm(other)
            total[face[k]] += own / np.linalg.norm(own) * math.acos(cosine)
    total /= np.linalg.norm(total, axis=1, keepdims=True)
    return np.insert(total, 3, 1, axis=1)


def test_tangents_of_vertices_that_are_apart():
    """Vertices are one where place, normal and texture coordinates are: without indices too. Those
    of triangles that show an image mirrored are others."""
    ball, uv, _, faces = ball_of(8, 12)
    hand = gltf_tangents.handedness(uv[faces])
    corners, own = faces.ravel(), np.arange(faces.size).reshape(-1, 3)
    apart = [table[corners] for table in (ball, uv, ball)]
    good = averaged(ball, uv, faces) * hand[0]
    assert (hand == 1).all()
    for tangents, said in ((good, True), (averaged(*apart[:2], own), False)):
        given = tangents[corners] if said else tangents
        assert gltf_tangents.agree(given, own, hand, *apart) == said
    assert gltf_tangents.agree(good, faces, hand, ball, uv, ball)
    both = np.concatenate([own, own[:, ::-1] + own.size])  # and the same triangles from behind
    given = np.concatenate([good[corners], good[corners] * [1, 1, 1, -1]])
    hand, twice = np.concatenate([hand, -hand]), (np.concatenate([table] * 2) for table in apart)
    assert gltf_tangents.agree(given, both, hand, *twice)


def test_tangents_of_many_triangles_are_sampled():
    ball, uv, along, faces = ball_of(300, 400)
    assert len(faces) > 2 * gltf_tangents._SAMPLE
    hand = gltf_tangents.handedness(uv[faces])
    assert gltf_tangents.agree(along, faces, hand, ball, uv, ball)
    bad = along.copy()
    bad[::20] *= -1
    assert not gltf_tangents.agree(bad, faces, hand, ball, uv, ball)


def test_tangents_of_a_ball(tmp_path):
    """Along its circles of latitude, which its triangles follow as far as they are fine."""
    ball, uv, along, faces = ball_of(12, 48)
    for tangent, said in ((along, False), (np.roll(along, 3, axis=0), True)):
        model = textured({}, uv=uv.tolist(), normalTexture={"index": 0})
        part = model.content["meshes"][0]["primitives"][0]
        part["attributes"] |= {"POSITION": model.array(ball), "NORMAL": model.array(ball),
                               "TANGENT": model.array(tangent)}  # fmt: skip
        part["indices"] = model.array(faces.ravel(), "u2")
        assert ("TANGENT" in load(tmp_path, model)[1]) == said


def test_normals_of_textures_are_copied_only_where_they_are_mirrored():
    given = TEXELS.copy()
    assert np.shares_memory(gltf_materials._normals(given, 1.0, False), given)
    found = gltf_materials._normals(given, 1.0, True)
    assert (given == TEXELS).all() and (found == TEXELS[..., :3] ^ np.uint8([0, 255, 0])).all()


def test_a_normal_texture_that_turns_nothing_is_left_out(tmp_path):
    for texel, scale in (([127, 200, 255], 0), ([128, 128, 255], 1)):
        data = png(np.tile(np.array(texel), (2, 2, 1)), "RGB")
        model = textured({}, data, uv=UPRIGHT, normalTexture={"index": 0, "scale": scale})
        scene, _ = load(tmp_path, model)
        row = scene.triangle_material[0]
        assert (scene.relief_texture[row] < 0) == (scale == 0)


def test_emission_of_textures(tmp_path):
    info = {"emissiveTexture": {"index": 0}, "emissiveFactor": [1, 0.5, 0.25]}
    strength = {"KHR_materials_emissive_strength": {"emissiveStrength": 4}}
    scene, text = load(tmp_path, textured({}, **info, extensions=strength))
    assert "not applied" not in text and "sky" not in text
    at = int(scene.emission_texture[scene.triangle_emission[0]])
    first = int(scene.texture_first[at])
    found = scene.texels[first : first + 72].view(np.float32).reshape(4, 6, 3)
    expected = images.SRGB_TO_LINEAR[TEXELS[..., :3]] * np.array([4, 2, 1], np.float32)
    assert (found == expected).all()


def lamp_texels(scene, shape=(4, 6, 3)):
    """The texels of the texture of the first triangle's emission."""
    at = int(scene.emission_texture[scene.triangle_emission[0]])
    first = int(scene.texture_first[at])
    count = math.prod(shape)
    return scene.texels[first : first + count].view(np.float32).reshape(shape)


@pytest.mark.parametrize("mode", ["MASK", "BLEND", "OPAQUE"])
@pytest.mark.parametrize("emissive", [False, True])
def test_what_alpha_cuts_away_does_not_shine(tmp_path, mode, emissive):
    factor = [1, 0.5, 0.25]
    more = {"emissiveFactor": factor, "alphaMode": mode}
    more |= {"emissiveTexture": {"index": 0}} if emissive else {}
    share = images.BYTE_TO_SHARE[TEXELS[..., 3:]] * np.float32(0.75)
    share = {"MASK": (share >= 0.5) * 1.0, "BLEND": share, "OPAQUE": share * 0 + 1}[mode]
    light = images.SRGB_TO_LINEAR[TEXELS[..., :3]] if emissive else np.ones((4, 6, 3))
    rough = {"baseColorTexture": {"index": 0}, "baseColorFactor": [1, 1, 1, 0.75]}
    scene, text = load(tmp_path, textured(rough, **more))
    assert "shines" not in text
    if mode == "OPAQUE" and not emissive:
        assert scene.emission_texture.tolist() == [-1]
        return
    assert np.allclose(lamp_texels(scene), light * factor * share, rtol=1e-6, atol=0)


def test_alpha_of_one_number_scales_emission(tmp_path):
    for mode, alpha, share in (("BLEND", 0.25, 0.25), ("MASK", 0.25, None), ("MASK", 0.75, 1.0),
                               ("BLEND", 0.0, None), ("OPAQUE", 0.25, 1.0)):  # fmt: skip
        more = {"alphaMode": mode, "emissiveFactor": [1, 0.5, 0.25]}
        rough = {"baseColorFactor": [1, 1, 1, alpha]}
        scene, text = load(tmp_path, textured(rough, **more))
        lit = [] if share is None else [[share, share / 2, share / 4]]
        assert scene.emissions.tolist() == lit
        assert ("a white sky was added" in text) == (share is None)
    more = {"alphaMode": "BLEND", "emissiveFactor": [1, 1, 1], "emissiveTexture": {"index": 0}}
    scene, _ = load(tmp_path, textured({"baseColorFactor": [1, 1, 1, 0.25]}, **more))
    light = images.SRGB_TO_LINEAR[TEXELS[..., :3]] * np.float32(0.25)
    assert (lamp_texels(scene) == light).all()


def test_alpha_of_another_place_than_the_emission_is_said(tmp_path):
    moved = {"KHR_texture_transform": {"offset": [0.5, 0]}}
    more = {"alphaMode": "BLEND", "emissiveFactor": [1, 1, 1],
            "emissiveTexture": {"index": 0, "extensions": moved}}  # fmt: skip
    scene, text = load(tmp_path, textured({"baseColorTexture": {"index": 0}}, **more))
    assert "what alpha cuts away still shines" in text
    assert any("still shines" in note for note in scene.notes)


def test_textures_that_are_left_out_are_said(tmp_path):
    info = {"normalTexture": {"index": 0}, "emissiveTexture": {"index": 0}}
    text = load(tmp_path, textured({}, **info, emissiveFactor=[1, 1, 1]))[1]
    assert ("normalTexture" in text) == ("normalmap" not in PLUGINS)
    assert ("emissiveTexture" in text) != PLUGINS["area"].params["radiance"].texturable


def test_what_textures_lack_is_said(tmp_path):
    rough = {"baseColorTexture": {"index": 0}}
    assert "in no format that is read" in load(tmp_path, textured(rough, texture={}))[1]
    text = load(tmp_path, textured(rough, sampler={"wrapS": 33648}))[1]
    assert "wrapT is shown as wrapS, mirror" in text
    model = textured(rough, occlusionTexture={"index": 0})
    scene, text = load(tmp_path, model)
    assert "occlusion" not in text and any("shadows are traced" in note for note in scene.notes)


BAD_TEXTURES = {
    "index": (textured({"baseColorTexture": {}}), 'baseColorTexture: "index" is missing'),
    "number": (textured({"baseColorTexture": {"index": 1}}), r'"index" = 1 is not .* \[0, 0\]'),
    "wrap": (textured({"baseColorTexture": {"index": 0}}, sampler={"wrapT": 1}),
             r'samplers\[0\]: "wrapT" = 1 is unknown'),
    "image": (textured({"baseColorTexture": {"index": 0}}, b"hello"),
              r"images\[0\]: the image is no readable PNG or JPEG"),
    "cut off": (textured({"baseColorTexture": {"index": 0}}, png(TEXELS)[:-40]), "no readable"),
    "alpha": (textured({}, alphaMode="HALF"), '"alphaMode" = "HALF", expected OPAQUE'),
}  # fmt: skip


@pytest.mark.parametrize("name", BAD_TEXTURES)
def test_bad_textures(tmp_path, name):
    model, message = BAD_TEXTURES[name]
    with pytest.raises(SceneError, match=message):
        load(tmp_path, model)


def test_what_is_left_out_is_said(tmp_path):
    model = quad(mode=1)
    model.content |= {"animations": [{}], "skins": [{}]}
    model.mesh(0, 1, targets=[{}], attributes={"COLOR_0": 0})
    scene, text = load(tmp_path, model)
    assert len(scene.triangles) == 2
    for said in ("skins are not applied", "animations are not", "LINES is not shown",
                 "targets of a primitive", "colours of vertices"):  # fmt: skip
        assert said in text


def change(path, value):
    """A quad's content with one value changed; None removes it."""

    def apply(content):
        *keys, last = path
        for key in keys:
            content = content[key]
        if value is None:
            del content[last]
        else:
            content[last] = value

    return apply  # fmt: skip


PART = ("meshes", 0, "primitives", 0)
BAD = {
    "version": (change(("asset", "version"), "1.0"), 'asset.version = "1.0", expected "2.0"'),
    "asset": (change(("asset",), []), r"a.gltf: asset: \[\] is not an object"),
    "no list": (change(("nodes",), {}), '"nodes" = {} is not a list'),
    "required": (change(("extensionsRequired",), ["KHR_draco_mesh_compression"]), "draco"),
    "mesh": (change(("nodes", 0, "mesh"), 1),
             r'a.gltf: nodes\[0\]: "mesh" = 1 is not an integer in \[0, 0\]'),
    "mesh type": (change(("nodes", 0, "mesh"), "x"), '"mesh" = "x" is not an integer'),
    "bool": (change(("nodes", 0, "mesh"), True), '"mesh" = True is not an integer'),
    "loop": (change(("nodes", 0, "children"), [0]), None),
    "twice": (change(("scenes",), [{"nodes": [0, 0]}]), r"nodes\[0\]: the node is met twice"),
    "rotation": (change(("nodes", 0, "rotation"), [0, 0, 0, 0]), "has the length 0, expected 1"),
    "scale": (change(("nodes", 0, "scale"), [1, 2]), '"scale" = .* is not 3 numbers'),
    "matrix": (change(("nodes", 0, "matrix"), [1] * 16), "has the last row"),
    "far": (change(("nodes", 0, "translation"), [1e31, 0, 0]), "is not 3 numbers in"),
    "position": (change((*PART, "attributes", "POSITION"), 9), r"9 is not .* \[0, 1\]"),
    "scalar": (change((*PART, "attributes", "POSITION"), 1), '"type" of a POSITION is not VEC3'),
    "mode": (change((*PART, "mode"), 7), '"mode" = 7 is not an integer'),
    "vec": (change(("accessors", 0, "type"), "VEC9"), '"type" = "VEC9", expected SCALAR'),
    "component": (change(("accessors", 0, "componentType"), 5), '"componentType" = 5 is unknown'),
    "count": (change(("accessors", 0, "count"), 5), "5 rows of 12 bytes every 12 bytes"),
    "many": (change(("accessors", 0), {"componentType": 5126, "count": 2**30, "type": "VEC3"}),
             '"count" = 1073741824 without a bufferView; at most 1048576'),
    "index": (change(("accessors", 0, "count"), 3), r"triangle 1 uses vertex 3, outside \[0, 2\]"),
    "stride": (change(("bufferViews", 0, "byteStride"), 4), "every 4 bytes"),
    "view": (change(("bufferViews", 0, "byteOffset"), 80), '"byteOffset" = 80 is not an integer'),
    "length": (change(("bufferViews", 0, "byteLength"), 800), '"byteLength" = 800 is not'),
    "buffer": (change(("bufferViews", 0, "buffer"), 1), '"buffer" = 1 is not'),
    "no view": (change(("bufferViews", 0, "buffer"), None), '"buffer" is missing'),
    "material": (change((*PART, "material"), 0), '"material" = 0 is not'),
    "colour": (change(("materials",), [{"pbrMetallicRoughness": {"baseColorFactor": [2] * 4}}]),
               None),
    "camera": (change(("nodes", 0, "camera"), 0), '"camera" = 0 is not'),
}  # fmt: skip


@pytest.mark.parametrize("name", BAD)
def test_bad_files(tmp_path, name):
    apply, message = BAD[name]
    model = quad()
    model.content = copy.deepcopy(model.content)
    apply(model.content)
    if name == "colour":
        model.content["meshes"][0]["primitives"][0]["material"] = 0
        message = r"materials\[0\].pbrMetallicRoughness: .baseColorFactor. .* in \[0, 1\]"
    if name == "loop":
        scene, _ = load(tmp_path, model)  # no node is without a parent
        assert not len(scene.triangles)
        return
    with pytest.raises(SceneError, match=message):
        load(tmp_path, model)


DAMAGED = {
    "no json": (b"hello", "not glTF"),
    "nan": (b'{"asset": {"version": "2.0"}, "x": NaN}', "NaN is no number of JSON"),
    "deep": (b"[" * 100_000, "nested too deeply"),
    "list": (b"[]", r"\[\] is not an object"),
    "short glb": (b"glTF\2\0\0\0", "it ends within its header"),
    "glb version": (b"glTF" + struct.pack("<II", 1, 20) + bytes(8), "version 1 and 20 bytes"),
    "glb length": (b"glTF" + struct.pack("<II", 2, 99) + bytes(8), "2 and at most 20"),
    "no chunk": (b"glTF" + struct.pack("<II", 2, 20) + bytes(8), "it has no JSON"),
    "chunk": (b"glTF" + struct.pack("<III4s", 2, 20, 9, b"JSON"), "it ends within a chunk"),
    "uri": (quad().text("http://x/y.bin"), "is no file beside this one"),
    "missing": (quad().text("missing.bin"), "cannot read .*missing.bin"),
    "base64": (quad().text("data:application/octet-stream;base64,!"), "holds no data in base64"),
    "too short": (quad().text("data:x;base64,AAAA"), "it has 3 bytes, less than its byteLength"),
    "no chunk of data": (quad().glb()[:-68], "it ends within a chunk|bytes stated"),
}  # fmt: skip


@pytest.mark.parametrize("name", DAMAGED)
def test_damaged_files(tmp_path, name):
    data, message = DAMAGED[name]
    with pytest.raises(SceneError, match=message):
        load(tmp_path, data)


def test_parameters_are_not_used(tmp_path):
    (tmp_path / "a.gltf").write_bytes(quad().text())
    with pytest.raises(SceneError, match='parameter "x" is not used by the scene'):
        veriray.load_file(tmp_path / "a.gltf", {"x": 1})


def test_it_renders(tmp_path):
    """Under a white sky a white mesh, seen from either side, sends back all that it gets."""
    model = Model()
    ball = trimesh.creation.icosphere(subdivisions=2)
    for faces in (ball.faces, ball.faces[:, ::-1]):
        model.content["meshes"], model.content["nodes"] = [], []
        model.mesh(model.array(ball.vertices), model.array(faces.ravel(), "u2"))
        scene, _ = load(tmp_path, model)
        picture = veriray.render(scene, spp=4, width=16, height=12, max_depth=-1, rr_depth=10**6,
                                 device="cpu")  # fmt: skip
        assert np.abs(picture.image - 1).max() < 1e-5


# ---- what is on both sides, hidden, clipped or unknown ----


@pytest.mark.parametrize("mode", ["OPAQUE", "MASK", "BLEND"])
@pytest.mark.parametrize("both", [True, False])
def test_double_sided_lamps_shine_backwards(tmp_path, mode, both):
    look = {"emissiveFactor": [1, 0.5, 0], "doubleSided": both, "alphaMode": mode}
    if mode == "BLEND":
        look["pbrMetallicRoughness"] = {"baseColorFactor": [1, 1, 1, 0.5]}
    model = quad(material=0)
    model.content["materials"] = [look]
    scene, text = load(tmp_path, model)
    behind = veriray.Camera.look_at((0.6, 0.4, -3), (0.6, 0.4, 0), fov=2)
    size = {"width": 4, "height": 4, "max_depth": 1}
    picture = veriray.render(scene.with_(camera=behind), **size, spp=4, device="cpu")
    shines = both and mode != "BLEND"
    assert (picture.image == (np.array([1, 0.5, 0]) if shines else 0)).all()
    assert ("shines on its front alone" in text) == (both and mode == "BLEND")
    assert scene.shape_names == (("mesh", "mesh.back") if shines else ("mesh",))
    assert len(scene.triangles) == (4 if shines else 2)


def test_hidden_nodes_and_unknown_extensions(tmp_path):
    hidden = {"extensions": {"KHR_node_visibility": {"visible": False}}}
    model = quad(node={"children": [1], **hidden})
    model.mesh(0, 1)
    model.content["nodes"].append({"mesh": 0, "extensions": {"MSFT_lod": {}}})
    model.content["scenes"] = [{"nodes": [0, 2], "extensions": {"EXT_lights_image_based": {}}}]
    model.content["meshes"][0]["extensions"] = {"A_mesh": {}}
    model.content["extensions"] = {"A_file": {}, "KHR_lights_punctual": {"lights": []}}
    scene, text = load(tmp_path, model)
    assert len(scene.triangles) == 2
    for name in ("MSFT_lod", "EXT_lights_image_based", "A_mesh", "A_file"):
        assert text.count(f'the extension "{name}" is not applied') == 1
    assert "KHR" not in text
    assert "shows no mesh" in load(tmp_path, Model())[1]


@pytest.mark.parametrize("kind", ["perspective", "orthographic"])
def test_cameras_clip(tmp_path, kind):
    lens = {"yfov": 0.5} if kind == "perspective" else {"xmag": 1, "ymag": 1}
    for clips, expected in (({"znear": 0.5, "zfar": 4}, (0.5, 4)), ({"znear": 2}, (2, np.inf))):
        model = quad()
        model.content["cameras"] = [{"type": kind, kind: {**lens, **clips}}]
        model.content["nodes"].append({"camera": 0})
        camera = load(tmp_path, model)[0].camera
        assert (camera.near_clip, camera.far_clip) == expected
