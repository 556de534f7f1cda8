"""Shapes, materials, media, lights and lenses of scene files: the array entries that they give."""

import cProfile
import dataclasses
import math

import numpy as np
import pytest

import veriray
from veriray import transform
from veriray.camera import Film
from veriray.columns import COLUMNS, LIGHT_KINDS, MATERIAL_KINDS, PRINCIPLED, TEXTURABLE
from veriray.errors import SceneError
from veriray.formats.plugins import IORS
from veriray.scene import load_dict, load_file

HEAD = (
    '<scene version="3.0.0">\n<sensor type="perspective"><float name="fov" value="40"/></sensor>\n'
    '<emitter type="constant"/>\n'
)


def load(folder, body, head=HEAD):
    path = folder / "scene.xml"
    path.write_text(f"{head}{body}</scene>\n", encoding="utf-8")
    return load_file(path)


def scene_dict(**values):
    sensor = {"type": "perspective", "fov": 40.0}
    return {"type": "scene", "sensor": sensor, "sky": {"type": "constant"}, **values}


def rgb(*value):
    return {"type": "rgb", "value": value}


def shape(**values):
    return load_dict(scene_dict(s=values))


def material(**bsdf):
    """The row of a bsdf: column -> value."""
    scene = shape(type="rectangle", bsdf=bsdf)
    columns = [name for name, column in COLUMNS.items() if column.table == "materials"]
    return {name: getattr(scene, name)[0].tolist() for name in columns}


# ---- shapes ----


def test_spheres():
    to_world = transform.compose(transform.translate((1, 2, 3)), transform.rotate((0, 0, 1), 90.0))
    to_world = transform.compose(to_world, transform.scale((2, 2, 2)))
    scene = shape(type="sphere", center=[1, 0, 0], radius=0.5, to_world=to_world)
    assert scene.spheres.tolist() == [[1, 4, 3, 1]]
    assert scene.shape_names == ("s",) and scene.sphere_shape.tolist() == [0]
    assert scene.triangles.shape == (0, 3) and scene.sphere_material.tolist() == [0]
    assert shape(type="sphere").spheres.tolist() == [[0, 0, 0, 1]]


@pytest.mark.parametrize("flip", [False, True])
def test_a_mirror_keeps_the_front_of_a_sphere(flip):
    def inward(scale):
        matrix = np.diag([*scale, 1.0])
        return shape(type="sphere", flip_normals=flip, to_world=matrix).sphere_inward.tolist()

    assert inward((2, 2, 2)) == inward((-2, -2, 2)) == [flip]
    assert inward((-2, 2, 2)) == inward((-2, -2, -2)) == [flip]


def test_disks():
    scene = shape(type="disk", to_world=np.diag([2.0, 3, 1, 1]))
    assert scene.disks.tolist() == [[[0, 0, 0], [2, 0, 0], [0, 3, 0]]]
    assert shape(type="disk", flip_normals=True).disks.tolist() == [
        [[0, 0, 0], [0, 1, 0], [1, 0, 0]]
    ]


def test_columns_of_mixed_shapes():
    lamp = {"type": "area", "radiance": 2.0}
    grey, red = {"type": "diffuse"}, {"type": "diffuse", "reflectance": rgb(0.5, 0, 0)}
    scene = load_dict(scene_dict(
        a={"type": "rectangle", "bsdf": red},
        b={"type": "sphere", "bsdf": grey, "light": lamp},
        c={"type": "cube", "bsdf": {"type": "ref", "id": "m"}},
        d={"type": "disk", "bsdf": {"type": "ref", "id": "m"}, "light": lamp},
        e={"type": "sphere", "bsdf": {"type": "ref", "id": "m"}},
        m={"type": "conductor"},
    ))  # fmt: skip
    assert scene.triangle_material.tolist() == [0] * 2 + [2] * 12
    assert scene.triangle_shape.tolist() == [0] * 2 + [2] * 12
    assert scene.sphere_material.tolist() == [1, 2] and scene.sphere_emission.tolist() == [0, -1]
    assert scene.sphere_shape.tolist() == [1, 4] and scene.disk_shape.tolist() == [3]
    assert scene.disk_material.tolist() == [2] and scene.disk_emission.tolist() == [1]
    assert (scene.triangle_emission == -1).all() and scene.shape_names == tuple("abcde")


def test_a_lamp_without_a_bsdf_reflects_nothing():
    lamp = {"type": "area"}
    assert shape(type="sphere", light=lamp).reflectance.tolist() == [[0, 0, 0]]
    assert shape(type="sphere").reflectance.tolist() == [[0.5] * 3]
    given = shape(type="sphere", light=lamp, bsdf={"type": "diffuse"})
    assert given.reflectance.tolist() == [[0.5] * 3]
    assert shape(type="rectangle", light=lamp, bsdf={"type": "null"}).emissions.tolist() == [
        [1] * 3
    ]


# ---- materials ----


def kind(name):
    return MATERIAL_KINDS.index(name)


def test_conductors():
    mirror = material(type="conductor")
    assert mirror["material_kind"] == kind("conductor")
    assert mirror["eta"] == [0] * 3 and mirror["k"] == [1] * 3
    assert material(type="conductor", material="none") == mirror
    gold = material(type="conductor", eta=rgb(0.2, 0.4, 1.5), k=3.0, ext_eta=2.0)
    assert gold["eta"] == np.float32([0.1, 0.2, 0.75]).tolist() and gold["k"] == [1.5] * 3
    assert material(type="conductor", specular_reflectance=0.5)["specular_reflectance"] == [0.5] * 3


@pytest.mark.parametrize("name", ["dielectric", "thindielectric"])
def test_dielectrics(name):
    glass = material(type=name)
    assert glass["material_kind"] == kind(name)
    assert glass["eta"] == [float(np.float32(1.5046 / 1.000277))] * 3
    assert material(type=name, int_ior=1.5, ext_ior=2)["eta"] == [0.75] * 3
    assert material(type=name, int_ior="Water", ext_ior="vacuum")["eta"][0] == np.float32(1.333)
    assert material(type=name, int_ior=1.0, ext_ior=1.0)["eta"] == [1] * 3
    dyed = material(type=name, specular_transmittance=rgb(1, 0.5, 0))
    assert dyed["specular_transmittance"] == [1, 0.5, 0]


def test_plastics():
    plastic = material(type="plastic")
    assert plastic["material_kind"] == kind("plastic") and not plastic["nonlinear"]
    assert plastic["reflectance"] == [0.5] * 3
    assert plastic["eta"] == [float(np.float32(1.49 / 1.000277))] * 3
    assert material(type="plastic", nonlinear=True)["nonlinear"] is True
    red = material(type="plastic", diffuse_reflectance=rgb(1, 0, 0), int_ior=1.3, ext_ior=1.3)
    assert red["reflectance"] == [1, 0, 0] and red["eta"] == [1] * 3


@pytest.mark.parametrize("name", ["roughconductor", "roughplastic", "roughdielectric"])
def test_rough_surfaces(name):
    rough, smooth = material(type=name), material(type=name.removeprefix("rough"))
    assert rough["material_kind"] == kind(name)
    assert rough["alpha_u"] == rough["alpha_v"] == np.float32(0.1) and rough["distribution"] == 0
    assert {**rough, "material_kind": smooth["material_kind"]} == smooth
    coarse = material(type=name, distribution="GGX", alpha_u=0.5, alpha_v=0.5)
    assert coarse["alpha_u"] == coarse["alpha_v"] == 0.5 and coarse["distribution"] == 1
    assert material(type=name, alpha=0.0)["alpha_u"] == np.float32(1e-4)
    assert material(type=name, sample_visible=False) == rough


def test_adapters():
    assert material(type="null")["material_kind"] == kind("null")
    both = material(type="twosided", b={"type": "plastic"})
    assert both["two_sided"] and both["material_kind"] == kind("plastic")
    assert material(type="mask", b={"type": "diffuse"})["opacity"] == 0.5
    veil = material(type="mask", opacity=0.25, b={"type": "twosided", "b": {"type": "conductor"}})
    assert veil["opacity"] == 0.25 and veil["two_sided"]
    assert material(type="diffuse")["opacity"] == 1


# ---- media ----


def test_media(tmp_path):
    body = (
        '<medium type="homogeneous" id="fog"><rgb name="sigma_t" value="1 2 3"/>'
        '<float name="albedo" value="0.5"/><float name="scale" value="2"/>'
        '<phase type="hg"><float name="g" value="-0.25"/></phase></medium>'
        '<shape type="sphere"><bsdf type="null"/><ref name="interior" id="fog"/></shape>'
        '<shape type="cube"><bsdf type="dielectric"/>'
        '<medium name="interior" type="homogeneous"/><ref name="exterior" id="fog"/></shape>'
        '<shape type="disk"><ref name="exterior" id="fog"/></shape>'
        '<shape type="sphere"><ref name="interior" id="fog"/></shape>'
    )
    scene = load(tmp_path, body)
    assert scene.sigma_t.tolist() == [[2, 4, 6], [1, 1, 1]]
    assert scene.albedo.tolist() == [[0.5] * 3, [0.75] * 3]
    assert scene.phase_g.tolist() == [-0.25, 0]
    assert scene.boundaries.tolist() == [[0, -1], [1, 0], [-1, 0]]
    assert scene.sphere_boundary.tolist() == [0, 0] and scene.disk_boundary.tolist() == [2]
    assert scene.triangle_boundary.tolist() == [1] * 12
    assert scene.camera.medium == -1
    fog = {"type": "homogeneous", "sigma_t": rgb(1, 2, 3), "albedo": 0.5, "scale": 2,
           "phase": {"type": "hg", "g": -0.25}}  # fmt: skip
    inside = {"type": "ref", "id": "fog"}
    same = load_dict(scene_dict(
        fog=fog,
        a={"type": "sphere", "bsdf": {"type": "null"}, "interior": inside},
        b={"type": "cube", "bsdf": {"type": "dielectric"}, "interior": {"type": "homogeneous"},
           "exterior": inside},
        c={"type": "disk", "exterior": inside},
        d={"type": "sphere", "interior": inside},
    ))  # fmt: skip
    assert same.sha256 == scene.sha256


def test_scattering_and_absorption_give_extinction_and_albedo():
    """The 2016 report's parameters: free flight -log(u) / sigma_s, absorption exp(-sigma_a d)."""
    milk = {"type": "homogeneous", "sigma_s": rgb(3, 0, 1), "sigma_a": rgb(1, 0, 0), "scale": 0.5}
    scene = shape(type="sphere", interior=milk)
    assert scene.sigma_t.tolist() == [[2, 0, 0.5]] and scene.albedo.tolist() == [[0.75, 0, 1]]


def test_a_camera_inside_a_medium(tmp_path):
    head = HEAD.replace("</sensor>", '<ref id="fog"/></sensor>')
    scene = load(tmp_path, '<medium type="homogeneous" id="fog"/>', head)
    assert scene.camera.medium == 0 and len(scene.sigma_t) == 1
    nested = scene_dict()
    nested["sensor"]["medium"] = {"type": "homogeneous"}
    assert load_dict(nested).sha256 == scene.sha256


# ---- lights ----


def light(**values):
    """The one row of the lights: kind, position, direction, intensity, angles."""
    scene = load_dict(scene_dict(light=values))
    assert len(scene.light_kind) == 1
    names = ("light_kind", "light_position", "light_direction", "light_intensity", "light_angles")
    row = [getattr(scene, name)[0].tolist() for name in names]
    return [LIGHT_KINDS[row[0]], *row[1:]]


def test_point_lights():
    name, position, _, intensity, _ = light(
        type="point", position=[1, 2, 3], intensity=rgb(1, 2, 3)
    )
    assert (name, position, intensity) == ("point", [1, 2, 3], [1, 2, 3])
    assert light(type="point", to_world=transform.translate((4, 5, 6)))[1] == [4, 5, 6]
    assert light(type="point")[1] == [0, 0, 0]


def test_spots():
    matrix = transform.look_at((1, 2, 3), (1, 2, 7), (0, 1, 0))
    name, position, direction, intensity, angles = light(type="spot", to_world=matrix)
    assert (name, position, direction) == ("spot", [1, 2, 3], [0, 0, 1])
    assert intensity == [1] * 3 and angles == [20, 15]
    assert light(type="spot", cutoff_angle=40)[4] == [40, 30]
    assert light(type="spot", cutoff_angle=40, beam_width=0)[4] == [40, 0]


def test_directional_lights():
    name, _, direction, irradiance, _ = light(
        type="directional", direction=[0, -2, 0], irradiance=3
    )
    assert (name, direction, irradiance) == ("directional", [0, -1, 0], [3] * 3)
    matrix = transform.look_at((1, 2, 3), (5, 2, 3), (0, 1, 0))
    assert light(type="directional", to_world=2 * matrix - np.diag([0, 0, 0, 1]))[2] == [1, 0, 0]
    assert light(type="directional")[2] == [0, 0, 1]


def test_black_lights_are_none_and_the_sky_is_one(tmp_path):
    body = '<emitter type="point"><float name="intensity" value="0"/></emitter>'
    with pytest.warns(UserWarning, match="no light"):
        scene = load(tmp_path, body, HEAD.replace('<emitter type="constant"/>', ""))
    assert len(scene.light_kind) == 0
    scene = load(tmp_path, '<emitter type="spot"/><emitter type="point"/>')
    assert scene.light_kind.tolist() == [1, 0] and scene.environment.tolist() == [1] * 3


# ---- lens, film, integrator ----


def test_thin_lens_mitchell_and_volpath(tmp_path):
    head = (
        '<scene version="3.0.0"><integrator type="volpath"><integer name="max_depth" value="7"/>'
        '</integrator><sensor type="thinlens"><float name="fov" value="40"/>'
        '<float name="aperture_radius" value="0.25"/><float name="focus_distance" value="3"/>'
        '<film type="hdrfilm"><rfilter type="mitchell"><float name="B" value="0"/>'
        '<float name="C" value="0.5"/></rfilter></film></sensor>'
    )
    scene = load(tmp_path, '<shape type="cube"><emitter type="area"/></shape>', head)
    assert (scene.camera.aperture_radius, scene.camera.focus_distance) == (0.25, 3)
    assert scene.film == Film(768, 576, "mitchell", (0, 0.5)) and scene.max_depth == 7


@pytest.mark.parametrize(
    ("clip", "distance"), [("", 1e4), ('<float name="far_clip" value="6"/>', 6)]
)
def test_a_lens_without_focus_distance_has_its_far_plane_in_focus(tmp_path, clip, distance):
    """As in Mitsuba, whose far plane is 10,000 away if none is given."""
    head = (
        f'<scene version="3.0.0"><sensor type="thinlens"><float name="fov" value="40"/>{clip}'
        '<float name="aperture_radius" value="0.25"/></sensor>'
    )
    scene = load(tmp_path, '<shape type="cube"><emitter type="area"/></shape>', head)
    assert (scene.camera.aperture_radius, scene.camera.focus_distance) == (0.25, distance)


def test_the_focus_of_parallel_rays_has_no_effect(tmp_path):
    head = '<scene version="3.0.0"><sensor type="orthographic">{}</sensor>'
    body = '<shape type="cube"><emitter type="area"/></shape>'
    scenes = [
        load(tmp_path, body, head.format(given))
        for given in ("", '<float name="focus_distance" value="3"/>')
    ]
    assert scenes[0].sha256 == scenes[1].sha256


@pytest.mark.parametrize("shape", ["rectangle", "cube"])
@pytest.mark.parametrize("flat", ["true", "false"])
def test_flat_shapes_take_face_normals(tmp_path, shape, flat):
    """As in Mitsuba, where they are meshes; their faces are flat anyway."""
    body = f'<shape type="{shape}">{{}}<emitter type="area"/></shape>'
    given = f'<boolean name="face_normals" value="{flat}"/>'
    assert load(tmp_path, body.format(given)).sha256 == load(tmp_path, body.format("")).sha256


def test_a_projector_without_irradiance_has_one_of_1(tmp_path):
    lights = [
        f'<emitter type="projector"><float name="scale" value="2"/>{given}</emitter>'
        for given in ("", '<rgb name="irradiance" value="1"/>')
    ]
    scenes = [load(tmp_path, f'<shape type="cube"/>{light}') for light in lights]
    assert scenes[0].sha256 == scenes[1].sha256
    assert np.allclose(scenes[0].light_intensity, 2 * np.pi)


def lobes_of(phase):
    scene = load_dict(scene_dict(ball={
        "type": "sphere", "bsdf": {"type": "null"},
        "interior": {"type": "homogeneous", "phase": phase},
    }))  # fmt: skip
    return scene


def test_phase_functions():
    table = {"type": "tabphase", "values": "1 0,4"}
    inner = {"type": "blendphase", "weight": 0.5, "a": {"type": "hg", "g": -0.5}, "b": table}
    scene = lobes_of({"type": "blendphase", "weight": 0.75, "a": {"type": "rayleigh"}, "b": inner})
    assert scene.lobe_kind.tolist() == [1, 0, 2]
    assert scene.lobe_share.tolist() == [0.25, 0.375, 0.375]
    assert scene.lobe_g.tolist() == [0, -0.5, 0] and scene.lobe_size.tolist() == [2, 2, 3]
    assert scene.phase_values.tolist() == [0.25, 0, 1]
    assert scene.phase_lobe.tolist() == [0] and scene.phase_lobes.tolist() == [3]
    assert "g" not in {name.rpartition(".")[2] for name in scene.parameters()}
    for volume in ({"type": "constvolume", "value": 0.75},
                   {"type": "gridvolume", "grid": np.full((2, 3, 1), 0.75)}):  # fmt: skip
        blend = {"type": "blendphase", "weight": volume, "a": {"type": "rayleigh"}, "b": inner}
        assert lobes_of(blend).lobe_share.tolist() == [0.25, 0.375, 0.375]
    assert lobes_of({"type": "hg", "g": 0.5}).phase_lobe.tolist() == [-1]


def test_a_blend_of_one_phase_function_has_its_bits():

    def film(phase):
        scene = dataclasses.replace(lobes_of(phase), environment=np.ones(3))
        return veriray.render(scene, width=8, height=8, spp=64, device="cpu").film_sha256

    hg = {"type": "hg", "g": 0.5}
    alone = film({"type": "blendphase", "weight": 0.0, "a": hg, "b": {"type": "rayleigh"}})
    assert alone == film(hg)


# ---- the whole scene ----


@pytest.fixture
def rich():
    """A scene with one of everything."""
    scene = load_dict(scene_dict(
        fog={"type": "homogeneous", "sigma_t": 2.0, "albedo": {
            "type": "gridvolume", "data": np.full((2, 2, 2, 3), 0.5, np.float32)},
            "phase": {"type": "blendphase", "weight": 0.25,
                      "a": {"type": "tabphase", "values": "1, 2, 4"},
                      "b": {"type": "tabphase", "values": "1 3"}}},
        haze={"type": "homogeneous", "albedo": {
            "type": "gridvolume", "data": np.full((2, 2, 1), 0.5, np.float32)}},
        ball={"type": "sphere", "bsdf": {"type": "dielectric"}, "light": {"type": "area"},
              "interior": {"type": "ref", "id": "fog"}, "exterior": {"type": "ref", "id": "haze"}},
        plate={"type": "disk", "bsdf": {"type": "plastic", "diffuse_reflectance": {
            "type": "bitmap", "bitmap": np.arange(12, dtype=np.uint8).reshape(2, 2, 3)}}},
        box={"type": "cube", "bsdf": {"type": "conductor", "eta": 0.5, "k": 2.0,
             "specular_reflectance": {"type": "checkerboard"}}},
        lamp={"type": "point", "position": [0, 1, 0], "intensity": 3.0},
        sun={"type": "directional", "irradiance": 3.0},
        spot={"type": "spot"},
        paint={"type": "mesh", "vertices": np.eye(3), "faces": [[0, 1, 2]],
               "vertex_color": np.full((3, 3), 0.5), "bsdf": {"type": "diffuse", "reflectance": {
                   "type": "mesh_attribute", "name": "vertex_color"}}},
    ))  # fmt: skip
    lens = {"aperture_radius": 0.5, "focus_distance": 4.0, "near_clip": 0.25, "far_clip": 100.0}
    return dataclasses.replace(scene, camera=dataclasses.replace(scene.camera, **lens))


#: Column -> (index of an entry, another valid value).
CHANGES = {
    "vertices": ((0, 1), 3), "normals": (0, (0, 0, 1)), "triangles": (0, (1, 2, 0)),
    "triangle_material": (0, 1), "triangle_emission": (0, 0), "triangle_boundary": (0, 0),
    "spheres": ((0, 3), 2), "sphere_material": (0, 1), "sphere_emission": (0, -1),
    "sphere_boundary": (0, -1), "sphere_inward": (0, True), "disks": ((0, 1, 2), 1),
    "disk_material": (0, 0), "disk_emission": (0, 0), "disk_boundary": (0, 0),
    "reflectance": ((1, 2), 0.25), "two_sided": (2, True), "material_kind": (2, 0),
    "specular_reflectance": ((0, 0), 0), "specular_transmittance": ((0, 0), 0),
    "eta": ((2, 0), 0.25), "k": ((2, 1), 0.25), "opacity": (0, 0.5), "nonlinear": (1, True),
    "emissions": ((0, 0), 7), "environment": (1, 7), "boundaries": ((0, 1), 0),
    "sigma_t": ((0, 2), 7), "albedo": ((0, 1), 0.5), "phase_g": (0, 0.5), "light_kind": (0, 1),
    "light_position": ((0, 0), 7), "light_direction": (0, (1, 0, 0)),
    "light_intensity": ((0, 0), 7), "light_angles": ((2, 1), 7),
    "alpha_u": (0, 0.5), "alpha_v": (0, 0.5), "distribution": (0, 1), "shadowing": (0, 1),
    **{name: (0, 0.25) for name in (*PRINCIPLED, "diff_trans")},
    "sky_texels": ((1, 2), 7), "sky_size": (slice(None), (1, 2)),
    "sky_to_world": (slice(None), -np.eye(3)), "sky_compensated": (0, False),
    "uv": ((0, 1), 7), "sphere_frame": (0, np.eye(3)[[1, 0, 2]]), "disk_turned": (0, True),
    "texture_kind": (0, 1), "texture_to_uv": ((0, 0, 2), 7), "texture_color0": ((1, 0), 0.25),
    "texture_color1": ((1, 1), 0.25), "texture_wrap": (0, 1), "texture_filter": (0, 1),
    "texture_format": (0, 1), "texture_width": (0, 1), "texture_height": (0, 1),
    "texture_depth": (0, 2), "texture_to_world": ((0, 0, 3), 0.5),
    "texture_grey": (0, True), "texture_first": (1, 1), "texels": (0, 7),
    **{f"{name}_texture": (0, 1) for name in (*TEXTURABLE, "relief")},
    "texture_field0": (1, 0), "texture_field1": (1, 0), "eta_texture": (2, 1), "k_texture": (2, 1),
    "hair_along": (0, 0.25), "hair_around": (0, 0.25), "hair_tilt": (0, 0.25),
    "relief_heights": (0, True), "relief_scale": (0, 0.5), "relief_flips": (0, False),
    "relief_shades": (0, False), "relief_mirrored": (0, True),
    "emission_texture": (0, 0), "light_texture": (2, 0), "light_image": ((2, 0, 0), 0.5),
    "grid_size": (0, (2, 1, 2)), "grid_first": (1, 0), "grid_grey": (0, True), "grid_wrap": (0, 0),
    "grid_filter": (0, 1), "grid_to_world": ((0, 0, 3), 0.5), "cells": (0, 0.25),
    "albedo_grid": (0, -1), "sigma_t_grid": (0, 0),
    "lobe_kind": (0, 1), "lobe_share": (slice(0, 2), (0.5, 0.5)), "lobe_g": (1, 0.5),
    "lobe_flakes": ((0, 5), 0.25),
    "lobe_values": (0, 1), "lobe_size": (0, 2), "phase_values": (0, 7), "phase_lobe": (0, -1),
    "phase_lobes": (1, 2),
    "attribute_values": ((0, 1), 0.25), "blend_material": (0, 1), "blend_weight": (0, 0.25),
    "blend_sides": (0, 1),
    "emission_muted": (0, True), "light_muted": (0, True), "sky_muted": (0, True),
    "muted_segments": (0, 2),
}  # fmt: skip


def test_every_array_is_in_the_hash(rich):
    assert CHANGES.keys() == COLUMNS.keys()
    image = {"environment": [0, 0, 0], "sky_texels": np.ones((2, 3)), "sky_size": [2, 1]}
    under_image = dataclasses.replace(rich, **image)
    hashes = {rich.sha256, under_image.sha256}
    for name, (index, value) in CHANGES.items():
        scene = under_image if name.startswith("sky") else rich
        values = np.array(getattr(scene, name))
        values[index] = value
        hashes.add(dataclasses.replace(scene, **{name: values}).sha256)
    for change in ({"aperture_radius": 0.4}, {"focus_distance": 3.0}, {"medium": 0}):
        hashes.add(rich.with_(camera=dataclasses.replace(rich.camera, **change)).sha256)
    for parameter in ((0, 0.5), (0.5, 0)):
        hashes.add(rich.with_(filter="mitchell", filter_parameter=parameter).sha256)
    assert len(hashes) == 2 + len(CHANGES) + 3 + 2


def test_focus_without_an_aperture_is_not_in_the_hash(rich):
    pinhole = dataclasses.replace(rich.camera, aperture_radius=0.0)
    other = dataclasses.replace(pinhole, focus_distance=7.0)
    assert rich.with_(camera=pinhole).sha256 == rich.with_(camera=other).sha256


def test_scaling_lengths(rich):
    large = rich.scaled(4.0)
    assert (large.spheres == 4 * rich.spheres).all() and (large.disks == 4 * rich.disks).all()
    assert (large.light_position == 4 * rich.light_position).all()
    assert (large.sigma_t == rich.sigma_t / 4).all()
    assert large.light_intensity[:, 0].tolist() == [48, 3, 16], "W / sr; the sun's irradiance stays"
    lens = ("aperture_radius", "focus_distance", "near_clip", "far_clip")
    assert [getattr(large.camera, name) for name in lens] == [2, 16, 1, 400]
    assert large.scaled(0.25).sha256 == rich.sha256


def test_scaling_emission(rich):
    bright = rich.with_emission_scaled(8.0)
    assert bright.light_intensity[:, 0].tolist() == [24, 24, 8]
    assert bright.environment.tolist() == [8] * 3
    assert bright.with_emission_scaled(0.125).sha256 == rich.sha256


# ---- against Mitsuba ----


@pytest.fixture(scope="module")
def mi():
    module = pytest.importorskip("mitsuba", reason="compares with Mitsuba 3 itself")
    module.set_variant("scalar_rgb")
    return module


@pytest.mark.parametrize("name", IORS)
def test_refractive_indices_are_mitsubas(mi, name):
    theirs = mi.traverse(mi.load_dict({"type": "dielectric", "int_ior": name, "ext_ior": 1.0}))
    assert theirs["eta"] == pytest.approx(IORS[name], rel=1e-6)


@pytest.mark.parametrize("name", ["dielectric", "thindielectric", "plastic"])
def test_default_indices_are_mitsubas(mi, name):
    params = mi.traverse(mi.load_dict({"type": name}))
    key = next(key for key in params.keys() if key.split(".")[-1] == "eta")  # noqa: SIM118
    assert params[key] == pytest.approx(material(type=name)["eta"][0], rel=1e-6)


ROUND = [
    np.eye(4),
    np.diag([-2.0, 2, 2, 1]),
    np.diag([-2.0, -2, -2, 1]),
    transform.compose(transform.translate((1, 2, 3)), transform.rotate((0.6, 0.8, 0), 70.0)),
]
SKEW = [
    *ROUND,
    np.array([[1, 0.5, 0, 0], [0, 1, 0, 0], [0.5, 0, 1, 0], [0, 0, 0, 1.0]]),
    np.diag([2.0, 3, -1, 1]),
]


@pytest.mark.parametrize("matrix", range(len(ROUND)))
@pytest.mark.parametrize("flip", [False, True])
def test_spheres_are_mitsubas(mi, matrix, flip):
    values = {"type": "sphere", "center": [0.5, 0, -1], "radius": 0.75, "flip_normals": flip}
    ours = shape(**values, to_world=ROUND[matrix])
    theirs = mi.load_dict({**values, "to_world": mi.ScalarTransform4f(ROUND[matrix])})
    *centre, radius = ours.spheres[0].tolist()
    box = theirs.bbox()
    assert np.array(box.min) == pytest.approx(np.array(centre) - radius, abs=1e-6)
    assert np.array(box.max) == pytest.approx(np.array(centre) + radius, abs=1e-6)
    scene = mi.load_dict({"type": "scene", "s": theirs})
    hit = scene.ray_intersect(mi.Ray3f((np.array(centre) + [5, 0, 0]).tolist(), [-1.0, 0.0, 0.0]))
    mirrored = np.linalg.det(ROUND[matrix][:3, :3]) < 0  # Mitsuba turns it inside out, and its fog
    assert (hit.wi.z < 0) == (bool(ours.sphere_inward[0]) != mirrored)


@pytest.mark.parametrize("matrix", range(len(SKEW)))
@pytest.mark.parametrize("flip", [False, True])
def test_disks_are_mitsubas(mi, matrix, flip):
    ours = shape(type="disk", flip_normals=flip, to_world=SKEW[matrix])
    theirs = mi.load_dict({
        "type": "scene",
        "s": {"type": "disk", "flip_normals": flip, "to_world": mi.ScalarTransform4f(SKEW[matrix])},
    })  # fmt: skip
    centre, a, b = ours.disks[0]
    front = np.cross(a, b) / np.linalg.norm(np.cross(a, b))
    for angle in np.linspace(0, 2 * math.pi, 12):
        for radius, inside in ((0.99, True), (1.01, False)):
            point = centre + radius * (math.cos(angle) * a + math.sin(angle) * b)
            ray = mi.Ray3f((point + 0.1 * front).tolist(), (-front).tolist())
            hit = theirs.ray_intersect(ray)
            assert (hit.t < 1) == inside
            if inside:
                assert np.array(hit.n) == pytest.approx(front, abs=1e-5) and hit.wi.z > 0


@pytest.mark.parametrize(
    "values",
    [
        {"type": "point", "position": [1.0, 2.0, 3.0]},
        {"type": "directional", "direction": [1.0, -2.0, 0.5]},
        {"type": "directional", "to_world": transform.look_at((0, 0, 0), (1, 2, 3), (0, 1, 0))},
        {"type": "spot", "to_world": transform.look_at((0, 3, 0), (1, 0, 1), (0, 0, 1))},
        {"type": "spot", "cutoff_angle": 70.0, "beam_width": 10.0},
    ],
    ids=lambda values: values["type"],
)
def test_lights_shine_as_mitsubas(mi, values):
    """Radiant intensity towards points, by this file's own formula for each kind."""
    name, position, direction, intensity, (cutoff, beam) = light(**values)
    given = dict(values)
    if "to_world" in given:
        given["to_world"] = mi.ScalarTransform4f(given["to_world"])
    scene = mi.load_dict({"type": "scene", "s": {"type": "sphere", "radius": 9.0}, "light": given})
    emitter = scene.emitters()[0]
    rng = np.random.default_rng(3)
    for point in rng.uniform(-1, 1, (40, 3)) + np.array(direction):
        at = mi.SurfaceInteraction3f()
        at.p = point.tolist()
        sample, value = emitter.sample_direction(at, [0.5, 0.5], True)
        if name == "directional":
            expected, way = 1.0, np.array(direction)
        else:
            way = point - position
            distance = np.linalg.norm(way)
            way, expected = way / distance, 1 / distance**2
        if name == "spot":
            angle = math.degrees(math.acos(np.clip(way @ direction, -1, 1)))
            expected *= min(max((cutoff - angle) / (cutoff - beam), 0), 1)
        assert np.array(value) == pytest.approx(expected, rel=2e-4, abs=1e-5)
        assert -np.array(sample.d) == pytest.approx(way, abs=1e-5)


# ---- many shapes ----


def calls(run):
    """Calls of Python and C functions during run()."""
    profile = cProfile.Profile()
    profile.runcall(run)
    return sum(entry.callcount for entry in profile.getstats())


def test_reading_does_little_for_each_shape(tmp_path):
    """Spheres are checked all at once; materials and childless objects are looked up."""
    counts = []
    for many in (100, 1100):
        (tmp_path / "many.xml").write_text(HEAD + '<shape type="sphere"/>\n' * many + "</scene>\n")
        counts.append(calls(lambda: load_file(tmp_path / "many.xml")))
    assert (counts[1] - counts[0]) / 1000 < 80


def test_the_first_bad_sphere_of_many_is_named(tmp_path):
    ball = '<shape type="sphere" id="s{}">{}</shape>\n'
    huge = (
        '<point name="center" x="1e100"/><transform name="to_world"><scale value="9"/></transform>'
    )
    body = "".join(ball.format(k, "") for k in range(5)) + ball.format(5, huge)
    with pytest.raises(SceneError, match="centre or radius exceeds") as caught:
        load(tmp_path, body + ball.format(6, "") + ball.format(7, huge))
    assert 'sphere "s5"' in str(caught.value) and caught.value.where.endswith("scene.xml:9")


def test_unused_vertices_change_no_picture() -> None:
    """Nor do those of triangles without an area: the extent of a scene is that of what is in it."""
    corners = [[-1, -1, 0], [1, -1, 0], [1, 1, 0], [-1, 1, 0]]
    to_world = transform.look_at((0, -4, 3), (0, 0, 0), (0, 0, 1))
    view = {"type": "perspective", "to_world": to_world}
    above = np.diag([0.1, 0.1, -1.0, 1.0])
    above[2, 3] = 1

    def film(vertices: list[list[float]], faces: list[list[int]]) -> str:
        mesh = {"type": "mesh", "vertices": np.array(vertices), "faces": np.array(faces)}
        light = {
            "type": "rectangle",
            "to_world": above,
            "emitter": {"type": "area"},
        }
        scene = veriray.load_dict({"type": "scene", "v": view, "m": mesh, "l": light})
        made = veriray.render(scene, width=8, height=8, spp=4, device="cpu")
        assert made.image.mean() > 1e-4
        return made.film_sha256

    faces, far = [[0, 1, 2], [0, 2, 3]], [1e8, 0.0, 0.0]
    known = film(corners, faces)
    assert film([*corners, far], faces) == known
    assert film([*corners, far], [*faces, [4, 4, 4]]) == known
