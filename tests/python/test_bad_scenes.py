# ruff: noqa: E501 (the tables of messages)
"""Bad scenes: each gives a SceneError that says where, what, and what is allowed; never a picture.

In a second run files are damaged at random: they give a SceneError or a valid scene, nothing else.
"""

import math
import os
import random
import re
import warnings

import numpy as np
import pytest

from veriray.camera import Camera, Film
from veriray.errors import SceneError, SceneWarning
from veriray.formats import mitsuba_xml
from veriray.scene import Scene, load_dict, load_file
from veriray.shipped import SHIPPED, find_shipped

SENSOR = '<sensor type="perspective"><float name="fov" value="40"/></sensor>'
SKY = '<emitter type="constant"/>'
RECTANGLE = '<shape type="rectangle">{}</shape>'
DIFFUSE = '<bsdf type="diffuse">{}</bsdf>'
TO_WORLD = RECTANGLE.format('<transform name="to_world">{}</transform>')
OBJ = '<shape type="obj"><string name="filename" value="{}"/></shape>'
PLY = '<shape type="ply"><string name="filename" value="{}"/></shape>'
FILM = '<sensor type="perspective"><float name="fov" value="40"/><film type="hdrfilm">{}</film></sensor>'
LENS = '<sensor type="perspective">{}</sensor>'
THIN = '<sensor type="thinlens"><float name="fov" value="40"/>{}</sensor>'
SPHERE = '<shape type="sphere">{}</shape>'
BSDF = '<shape type="cube"><bsdf type="{}">{}</bsdf></shape>'
MEDIUM = '<medium type="homogeneous">{}</medium>'
STL = '<shape type="stl"><string name="filename" value="{}"/></shape>'
PLY_HEAD = (
    "ply\nformat ascii 1.0\nelement vertex 3\nproperty float x\nproperty float y\nproperty float z\n"
    "element face 1\nproperty list uchar int vertex_indices\nend_header\n"
)
TRIANGLE = "v 0 0 0\nv 1 0 0\nv 0 1 0\n"

# Line 3 of scene.xml -> fragments of the message. Every message begins with "scene.xml:3: " unless
# a file name is among the fragments. Line 1 is <scene>, line 2 the sky; a sensor is on line 4.
LINES = {
    "unknown plugin": ('<shape type="rectangel"/>', 'unknown shape "rectangel"', "allowed: bsplinecurve, cube, cylinder, disk, ellipsoids, ellipsoidsmesh, instance, linearcurve, merge, mesh, obj, ply, rectangle, sdfgrid, serialized, shapegroup, sphere, stl", 'did you mean "rectangle"?'),
    "plugin of another category": ('<shape type="diffuse"/>', 'unknown shape "diffuse"', "allowed: bsplinecurve, cube"),
    "motion": ('<shape type="sphere"><animation name="to_world"><transform time="0"/></animation></shape>', "<animation>: nothing moves here", '<transform name="to_world">'),
    "unknown element": ("<shap/>", "unknown element <shap>", 'did you mean "shape"?'),
    "object without type": ("<shape/>", '<shape> lacks the attribute "type"'),
    "unknown attribute": ('<shape type="cube" name="x" colour="red"/>', "unknown attribute", '"colour" = "red"', "allowed: id, name, type"),
    "unknown parameter": (DIFFUSE.format('<rgb name="reflectence" value="0.5"/>'), "diffuse: unknown parameter", '"reflectence" = (0.5, 0.5, 0.5)', 'did you mean "reflectance"?'),
    "parameter of a parameterless plugin": (RECTANGLE.format('<float name="radius" value="2"/>'), 'unknown parameter "radius" = 2.0', "allowed: face_normals, flip_normals, to_world"),
    "wrong type": (RECTANGLE.format('<float name="flip_normals" value="1"/>'), '"flip_normals" = 1.0 is of type float, expected boolean'),
    "vector for colour": (DIFFUSE.format('<vector name="reflectance" value="1 1 1"/>'), "of type vector, expected rgb, spectrum or number"),
    "string for a number": ('<integrator type="path"><string name="max_depth" value="8"/></integrator>', '"max_depth" = "8" is of type string, expected integer'),
    "float for integer": ('<integrator type="path"><float name="max_depth" value="8"/></integrator>', "is of type float, expected integer"),
    "not a number": (DIFFUSE.format('<float name="reflectance" value="half"/>'), '"reflectance" = "half" is not a number'),
    "underscore": (DIFFUSE.format('<float name="reflectance" value="0_1"/>'), '"0_1" is not a number'),
    "decimal comma": (DIFFUSE.format('<float name="reflectance" value="0,5"/>'), '"0,5" is not a number'),
    "NaN": (DIFFUSE.format('<float name="reflectance" value="nan"/>'), '"reflectance" = "nan" must be finite'),
    "infinity": (SKY.replace("/>", '><rgb name="radiance" value="1 -inf 1"/></emitter>'), '"-inf" must be finite'),
    "overflow": (DIFFUSE.format('<float name="reflectance" value="1e999"/>'), '"1e999" exceeds the float64 range'),
    "radiance beyond float32": (RECTANGLE.format('<emitter type="area"><float name="radiance" value="1e39"/></emitter>'), "exceeds the float32 range"),
    "not an integer": ('<integrator type="path"><integer name="max_depth" value="2.5"/></integrator>', '"2.5" is not an integer'),
    "not a boolean": (RECTANGLE.format('<boolean name="flip_normals" value="yes"/>'), '"yes", expected true or false'),
    "two numbers for a colour": (DIFFUSE.format('<rgb name="reflectance" value="0.1 0.2"/>'), "holds 2 numbers, expected 1 or 3"),
    "hexadecimal colour": (DIFFUSE.format('<rgb name="reflectance" value="#ff80"/>'), '"#ff80", expected #rrggbb'),
    "wavelengths that fall": (DIFFUSE.format('<spectrum name="reflectance" value="400:0.1, 300:0.2"/>'), "300 nm follows 400 nm; they must increase"),
    "one wavelength": (DIFFUSE.format('<spectrum name="reflectance" value="400:0.1"/>'), "holds 1 wavelength, expected 2 or more"),
    "half a pair": (DIFFUSE.format('<spectrum name="reflectance" value="400:0.1 500"/>'), '"500" is not wavelength:value'),
    "no value of a spectrum": (DIFFUSE.format('<spectrum name="reflectance"/>'), "give either value or filename"),
    "spectrum file that is not there": (DIFFUSE.format('<spectrum name="reflectance" filename="no.spd"/>'), "cannot read"),
    "unknown spectrum": (DIFFUSE.format('<spectrum name="reflectance" type="d56"/>'), 'unknown spectrum "d56"; allowed: blackbody, d65'),
    "cold blackbody": (DIFFUSE.format('<spectrum name="reflectance" type="blackbody"><float name="temperature" value="0"/></spectrum>'), 'blackbody: "temperature" = 0.0 is outside [1, 1e+09]'),
    "unknown parameter of a spectrum": (DIFFUSE.format('<spectrum name="reflectance" type="d65"><float name="size" value="0"/></spectrum>'), 'd65: unknown parameter "size"'),
    "spectrum of infinite power": (DIFFUSE.format('<spectrum name="reflectance" value="400:1e308 700:1e308"/>'), "must be finite"),
    "sRGB above 1": (DIFFUSE.format('<srgb name="reflectance" value="0.1 0.2 1.1"/>'), "is outside [0, 1]"),
    "reflectance above 1": (DIFFUSE.format('<rgb name="reflectance" value="0.5 1.5 0.5"/>'), "(0.5, 1.5, 0.5) is outside [0, 1]"),
    "negative reflectance": (DIFFUSE.format('<rgb name="reflectance" value="-0.1"/>'), "is outside [0, 1]"),
    "negative absorption": (MEDIUM.format('<rgb name="sigma_a" value="1 -1 1"/><float name="sigma_s" value="1"/>'), '"sigma_a" = (1.0, -1.0, 1.0) is outside [0, '),
    "hide_emitters": ('<integrator type="path"><boolean name="hide_emitters" value="maybe"/></integrator>', '"hide_emitters" = "maybe"', "true or false"),
    "max_depth": ('<integrator type="path"><integer name="max_depth" value="-2"/></integrator>', '"max_depth" = -2 is outside [-1, '),
    "rr_depth": ('<integrator type="path"><integer name="rr_depth" value="0"/></integrator>', '"rr_depth" = 0 is outside [1, '),
    "two integrators": ('<integrator type="path"/><integrator type="path"/>', "has 2 objects of category integrator, at most 1"),
    "two skies": (SKY, "a second emitter constant; at most 1 allowed"),
    "sky inside a shape": (RECTANGLE.format(SKY), 'rectangle cannot hold a emitter "constant"', "allowed: area"),
    "twosided without bsdf": ('<bsdf type="twosided"/>', "twosided has no bsdf; allowed: diffuse, conductor, plastic, roughconductor, roughplastic, principled"),
    "twosided thrice": (f'<bsdf type="twosided">{3 * DIFFUSE.format("")}</bsdf>', "has 3 objects of category bsdf"),
    "unknown reference": (RECTANGLE.format('<ref id="wite"/>') + '<bsdf type="diffuse" id="white"/>', 'no object with the id "wite"', 'did you mean "white"?'),
    "reference of another kind": ('<shape type="cube" id="c"/>' + RECTANGLE.format('<ref id="c"/>'), 'rectangle cannot hold a shape "cube"'),
    "id twice": ('<bsdf type="diffuse" id="w"/><shape type="cube" id="w"/>', 'id "w" is already used at ', "scene.xml:3"),
    "sampling weight": ('<emitter type="spot"><float name="sampling_weight" value="-1"/></emitter>', 'spot: "sampling_weight" = -1.0 is outside [0, inf]'),
    "parameter twice": (DIFFUSE.format('<float name="reflectance" value="1"/><float name="reflectance" value="0"/>'), '"reflectance" is given twice'),
    "undefined parameter": (DIFFUSE.format('<rgb name="reflectance" value="$albedo"/>'), 'parameter "$albedo" has no value', "-D albedo=..."),
    "lone dollar": (DIFFUSE.format('<rgb name="reflectance" value="5$"/>'), '"$" must be followed by the name'),
    "default without name": ('<default name="a b" value="1"/>', "bad name"),
    "content in a value": ('<float name="x" value="1">2</float>', "<float> must be empty"),
    "singular transform": (TO_WORLD.format('<scale x="0"/>'), '"to_world" is singular'),
    "singular matrix": (TO_WORLD.format('<matrix value="1 2 3 0 2 4 6 0 0 0 1 0 0 0 0 1"/>'), '"to_world" is singular'),
    "projective matrix": (TO_WORLD.format('<matrix value="1 0 0 0 0 1 0 0 0 0 1 0 0 0 1 1"/>'), "last row [0.0, 0.0, 1.0, 1.0], expected [0, 0, 0, 1]"),
    "matrix of 12": (TO_WORLD.format('<matrix value="1 0 0 0 0 1 0 0 0 0 1 0"/>'), "holds 12 numbers, expected 9 or 16"),
    "overflowing transform": (TO_WORLD.format('<scale value="1e300"/><scale value="1e300"/>'), '"to_world"', "must be finite"),
    "huge coordinates": (TO_WORLD.format('<translate x="1e200"/>'), "holds a number above 1e+100"),
    "NaN in a transform": (TO_WORLD.format('<translate x="nan"/>'), 'translate: "x" = "nan" must be finite'),
    "unknown transform": (TO_WORLD.format('<rotat x="1" angle="3"/>'), "unknown transform <rotat>", 'did you mean "rotate"?'),
    "rotation without angle": (TO_WORLD.format('<rotate x="1"/>'), '<rotate> lacks the attribute "angle"'),
    "lookat at itself": (TO_WORLD.format('<lookat origin="1,2,3" target="1,2,3" up="0,1,0"/>'), "origin and target are the same point"),
    "lookat along up": (TO_WORLD.format('<lookat origin="0,0,0" target="0,5,0" up="0,1,0"/>'), "up is parallel to the viewing direction"),
    "missing mesh": (OBJ.format("nowhere.obj"), "cannot read", "No such file or directory"),
    "mesh without file name": ('<shape type="obj"/>', 'obj: "filename" (string) is missing'),
    "folder as mesh": (OBJ.format("."), ": Is a directory"),
    "long file name": (OBJ.format("x" * 5000 + ".obj"), "File name too long"),
    "missing include": ('<include filename="nowhere.xml"/>', "cannot read", "No such file or directory"),
    "sphere of radius 0": (SPHERE.format('<float name="radius" value="0"/>'), 'sphere: "radius" = 0.0 is outside (0, '),
    "negative radius": (SPHERE.format('<float name="radius" value="-1"/>'), '"radius" = -1.0 is outside (0, '),
    "centre that is a number": (SPHERE.format('<float name="center" value="1"/>'), '"center" = 1.0 is of type float, expected point'),
    "centre with NaN": (SPHERE.format('<point name="center" x="nan"/>'), 'point: "x" = "nan" must be finite'),
    "sphere out of sight": (SPHERE.format('<float name="radius" value="1e60"/><transform name="to_world"><scale value="1e60"/></transform>'), "centre or radius exceeds 1e+100"),
    "disk with radius": ('<shape type="disk"><float name="radius" value="1"/></shape>', 'disk: unknown parameter "radius"'),
    "bsdf of Mitsuba": (BSDF.format("measured", ""), 'bsdf "measured" of Mitsuba is not supported yet; allowed: blendbsdf, bumpmap, circular, '),
    "alias of nothing": ('<alias id="a" as="b"/>', 'there is no id "a" before this; known: none'),
    "alias that is taken": ('<bsdf type="diffuse" id="a"/><bsdf type="diffuse" id="b"/><alias id="a" as="b"/>', 'id "b" is already used at '),
    "path in an object": (RECTANGLE.format('<path value="."/>'), "<path> must stand directly in <scene>"),
    "integrator": ('<integrator type="volprim_rf_basic"/>', 'integrator "volprim_rf_basic" of Mitsuba is not supported yet'),
    "moments of nothing": ('<integrator type="moment"/>', "moment has no integrator; allowed: path, volpath"),
    "moments of itself": ('<integrator type="moment" id="m"><ref id="m"/></integrator>', 'moment "m" holds itself'),
    "direct light by no samples": ('<integrator type="direct"><integer name="emitter_samples" value="0"/><integer name="bsdf_samples" value="0"/></integrator>', "direct: emitter_samples and bsdf_samples are 0"),
    "direct light by two rules": ('<integrator type="direct"><integer name="shading_samples" value="2"/><integer name="bsdf_samples" value="1"/></integrator>', "direct: both shading_samples and one of emitter_samples and bsdf_samples given"),
    "mirrors left out": ('<integrator type="direct"><integer name="bsdf_samples" value="0"/></integrator>' + BSDF.format("conductor", ""), 'direct: "bsdf_samples" = 0 leaves out the light of a mirror, glass or a mask'),
    "lamps left out": ('<integrator type="direct"><integer name="emitter_samples" value="0"/></integrator><emitter type="point"/>', 'direct: "emitter_samples" = 0 leaves out the light of a point'),
    "unknown metal": (BSDF.format("conductor", '<string name="material" value="gold"/>'), 'conductor: "material" = "gold": unknown; allowed: Ag, Al, AlAs'),
    "unknown bsdf": (BSDF.format("roughplastics", ""), 'unknown bsdf "roughplastics"; allowed: blendbsdf, bumpmap, circular, conductor, dielectric, diffuse, hair, mask, normalmap, null, plastic, polarizer, pplastic, principled, principledthin, retarder, roughconductor, roughdielectric, roughplastic, thindielectric, twosided', 'did you mean "roughplastic"?'),
    "unknown slopes": (BSDF.format("roughconductor", '<string name="distribution" value="phong"/>'), 'roughconductor: "distribution" = "phong" is not supported; allowed: beckmann, ggx'),
    "unknown shadows": (BSDF.format("roughdielectric", '<string name="shadowing" value="smith"/>'), 'roughdielectric: "shadowing" = "smith" is not supported; allowed: height_correlated, separable'),
    "shadows of a smooth metal": (BSDF.format("conductor", '<string name="shadowing" value="separable"/>'), 'conductor: unknown parameter "shadowing"'),
    "compensation of a number": (BSDF.format("roughconductor", '<float name="energy_compensation" value="1"/>'), '"energy_compensation"'),
    "compensation of a coat": (BSDF.format("roughplastic", '<boolean name="energy_compensation" value="true"/>'), 'roughplastic: "energy_compensation": not supported; allowed: on roughconductor, roughdielectric'),
    "brushed compensation": (BSDF.format("roughconductor", '<float name="alpha_u" value="0.1"/><float name="alpha_v" value="0.2"/><boolean name="energy_compensation" value="true"/>'), "roughconductor: energy_compensation = true with alpha_u = 0.1 and alpha_v = 0.2; allowed: with one alpha"),
    "textured compensation": (BSDF.format("roughdielectric", '<texture type="checkerboard" name="alpha"/><boolean name="energy_compensation" value="true"/>'), "roughdielectric: energy_compensation = true with a texture as alpha; allowed: with a number"),
    "compensation of a textured index": (BSDF.format("roughconductor", '<texture type="checkerboard" name="eta"/><boolean name="energy_compensation" value="true"/>'), "roughconductor: energy_compensation = true with a texture as eta; allowed: with a number"),
    "two roughnesses": (BSDF.format("roughplastic", '<float name="alpha" value="0.1"/><float name="alpha_u" value="0.1"/><float name="alpha_v" value="0.1"/>'), "roughplastic: alpha and alpha_u and alpha_v given; expected alpha, or both alpha_u and alpha_v"),
    "half a roughness": (BSDF.format("roughconductor", '<float name="alpha_u" value="0.1"/>'), "roughconductor: alpha_u given; expected alpha, or both alpha_u and alpha_v"),
    "anisotropic": (BSDF.format("roughplastic", '<float name="alpha_u" value="0.1"/><float name="alpha_v" value="0.2"/>'), "roughplastic: alpha_u = 0.1 and alpha_v = 0.2, but its coat has one alpha; give alpha"),
    "bumps without a texture": (BSDF.format("bumpmap", '<bsdf type="diffuse"/>'), "bumpmap has 0 textures, expected 1, a bitmap"),
    "blend of one": (BSDF.format("blendbsdf", '<float name="weight" value="0.5"/><bsdf type="diffuse"/>'), "blendbsdf has 1 of the 2 bsdfs that it needs; allowed: diffuse"),
    "blend of nothing": (BSDF.format("blendbsdf", '<float name="weight" value="0.5"/>'), "blendbsdf has no bsdf; allowed: diffuse"),
    "bumps of nothing": (BSDF.format("bumpmap", '<texture type="bitmap" name="x"/>'), "bumpmap has no bsdf; allowed: diffuse"),
    "bumps of a checkerboard": (BSDF.format("bumpmap", '<texture type="checkerboard" name="x"/><bsdf type="diffuse"/>'), "bumpmap cannot hold a texture checkerboard, only a bitmap"),
    "normals by another name": (BSDF.format("normalmap", '<texture type="bitmap" name="x"/><bsdf type="diffuse"/>'), "not supported on normalmap.x, but on normalmap.normalmap"),
    "bumps on bumps": (BSDF.format("bumpmap", '<bsdf type="bumpmap"/>'), "bumpmap cannot hold a bsdf \"bumpmap\""),
    "bumpy glass from both sides": (BSDF.format("twosided", '<bsdf type="bumpmap"><texture type="bitmap" name="x"><string name="filename" value="a.png"/></texture><bsdf type="dielectric"/></bsdf>'), "a.png"),
    "negative roughness": (BSDF.format("roughplastic", '<float name="alpha" value="-0.1"/>'), '"alpha" = -0.1 is outside [0, 10]'),
    "matched rough glass": (BSDF.format("roughdielectric", '<float name="int_ior" value="1.5"/><float name="ext_ior" value="1.5"/>'), "roughdielectric: int_ior and ext_ior are equal; a rough interface of equal indices has no small mirrors"),
    "mirror with eta": (BSDF.format("conductor", '<string name="material" value="none"/><float name="eta" value="2"/><float name="k" value="2"/>'), "conductor: material and eta and k given"),
    "huge k": (BSDF.format("conductor", '<float name="eta" value="2"/><float name="k" value="-2e6"/>'), '"k" = -2000000.0 is outside [0, 1e+06]'),
    "material without index": (BSDF.format("dielectric", '<string name="int_ior" value="glas"/>'), 'dielectric: "int_ior" = "glas" is unknown; allowed: acetone, acrylic glass, air'),
    "near miss of a name": (BSDF.format("dielectric", '<string name="ext_ior" value="watr"/>'), 'did you mean "water"?'),
    "index 0": (BSDF.format("plastic", '<float name="int_ior" value="0"/>'), '"int_ior" = 0.0 is outside [0.1, 10]'),
    "index that is a colour": (BSDF.format("thindielectric", '<rgb name="int_ior" value="1 2 3"/>'), "is of type rgb, expected number or name"),
    "specular above 1": (BSDF.format("plastic", '<rgb name="specular_reflectance" value="1.5"/>'), '"specular_reflectance" = (1.5, 1.5, 1.5) is outside [0, 1]'),
    "transmittance of plastic": (BSDF.format("plastic", '<float name="specular_transmittance" value="1"/>'), 'plastic: unknown parameter "specular_transmittance"'),
    "mask by an image of a mask": (BSDF.format("mask", '<texture type="checkerboard" name="opacity"/><bsdf type="mask"><bsdf type="diffuse"/></bsdf>'), 'mask cannot hold a mask, unless numbers are the opacity of all'),
    "mask of a mask by an image": (BSDF.format("mask", '<bsdf type="mask"><texture type="checkerboard" name="opacity"/><bsdf type="diffuse"/></bsdf>'), 'mask cannot hold a mask, unless numbers are the opacity of all'),
    "opacity": (BSDF.format("mask", '<float name="opacity" value="2"/><bsdf type="diffuse"/>'), 'mask: "opacity" = 2.0 is outside [0, 1]'),
    "mask of nothing": (BSDF.format("mask", ""), "mask has no bsdf; allowed: diffuse, conductor, plastic, roughconductor, roughplastic, principled, pplastic, twosided"),
    "twosided glass": (BSDF.format("twosided", '<bsdf type="dielectric"/>'), 'twosided cannot hold a bsdf "dielectric"; allowed: blendbsdf, bumpmap, conductor, diffuse, normalmap, plastic, pplastic, principled, roughconductor, roughplastic'),
    "twosided mask": (BSDF.format("twosided", '<bsdf type="mask"><bsdf type="diffuse"/></bsdf>'), 'twosided cannot hold a bsdf "mask"'),
    "null with a colour": (BSDF.format("null", '<float name="reflectance" value="1"/>'), 'null: unknown parameter "reflectance" = 1.0; allowed: none'),
    "medium without a side": (SPHERE.format(MEDIUM.format("")), 'sphere: a medium of a shape is named ""; allowed: exterior, interior'),
    "medium on another side": (SPHERE.format(MEDIUM.format("").replace("<medium", '<medium name="inside"')), 'named "inside"'),
    "two interiors": (SPHERE.format(MEDIUM.format("").replace("<medium", '<medium name="interior"') * 2), "two media are named interior"),
    "medium in a material": (DIFFUSE.format(MEDIUM.format("")), 'diffuse cannot hold a medium "homogeneous"'),
    "extinction and scattering": (MEDIUM.format('<float name="sigma_t" value="1"/><float name="sigma_s" value="1"/>'), "homogeneous: sigma_t, sigma_s given; expected sigma_t and albedo, or sigma_s and sigma_a"),
    "scattering alone": (MEDIUM.format('<float name="sigma_s" value="1"/>'), "homogeneous: sigma_s given; expected"),
    "negative extinction": (MEDIUM.format('<rgb name="sigma_t" value="1 -1 1"/>'), '"sigma_t" = (1.0, -1.0, 1.0) is outside [0, '),
    "extinction beyond float32": (MEDIUM.format('<float name="sigma_t" value="1e38"/><float name="scale" value="10"/>'), "sigma_t = (1e+39, 1e+39, 1e+39) exceeds the float32 range"),
    "albedo above 1": (MEDIUM.format('<float name="albedo" value="1.5"/>'), '"albedo" = 1.5 is outside [0, 1]'),
    "unknown phase function": (MEDIUM.format('<phase type="mist"/>'), 'unknown phase "mist"'),
    "flakes without a matrix": (MEDIUM.format('<phase type="sggx"/>'), 'sggx: "S" (gridvolume of 6 numbers a cell) is missing'),
    "table of one number": (MEDIUM.format('<phase type="tabphase"><string name="values" value="1"/></phase>'), 'tabphase: "values" holds 1 numbers, expected 2 to 65536'),
    "table below 0": (MEDIUM.format('<phase type="tabphase"><string name="values" value="1, -2"/></phase>'), 'tabphase: "values" holds -2, expected numbers of at least 0'),
    "table of zeros": (MEDIUM.format('<phase type="tabphase"><string name="values" value="0 0"/></phase>'), 'tabphase: "values" holds zeros alone'),
    "blend of one phase function": (MEDIUM.format('<phase type="blendphase"><float name="weight" value="0.5"/><phase type="hg"/></phase>'), "blendphase has 1 of the 2 phases that it needs; allowed: isotropic, hg, rayleigh, tabphase, sggx, blendphase"),
    "blend without weight": (MEDIUM.format('<phase type="blendphase"><phase type="hg"/><phase type="hg"/></phase>'), 'blendphase: "weight" (number) is missing'),
    "blend beyond 1": (MEDIUM.format('<phase type="blendphase"><float name="weight" value="1.5"/><phase type="hg"/><phase type="hg"/></phase>'), 'blendphase: "weight" = 1.5 is outside [0, 1]'),
    "coloured blend": (MEDIUM.format('<phase type="blendphase"><volume type="constvolume" name="weight"><rgb name="value" value="0.1 0.2 0.3"/></volume><phase type="hg"/><phase type="hg"/></phase>'), 'constvolume holds [0.1, 0.2, 0.3]; weight takes 1 numbers'),
    "volume beyond 1": (MEDIUM.format('<phase type="blendphase"><volume type="constvolume" name="weight"><float name="value" value="1.5"/></volume><phase type="hg"/><phase type="hg"/></phase>'), 'blendphase: "weight" = 1.5 is outside [0, 1]'),
    "two phase functions": (MEDIUM.format('<phase type="hg"/><phase type="hg"/>'), "has 2 objects of category phase"),
    "asymmetry 1": (MEDIUM.format('<phase type="hg"><float name="g" value="1"/></phase>'), 'hg: "g" = 1.0 is outside (-1, 1)'),
    "sphere as an emitter": ('<emitter type="sphere"/>', 'unknown emitter "sphere"; allowed: area, constant, directional, directionalarea, envmap, point, projector, spot, sunsky, timed_sunsky'),
    "lamp on a lamp": (RECTANGLE.format('<emitter type="point"/>'), 'rectangle cannot hold a emitter "point"; allowed: area'),
    "two places": ('<emitter type="point"><point name="position" x="1"/><transform name="to_world"><translate x="1"/></transform></emitter>', "point: both position and to_world given"),
    "radiance of a point": ('<emitter type="point"><rgb name="radiance" value="1"/></emitter>', 'point: unknown parameter "radiance"', "allowed: intensity, position, sampling_weight, to_world"),
    "no direction": ('<emitter type="directional"><vector name="direction" value="0"/></emitter>', "directional: direction has length 0"),
    "cutoff 0": ('<emitter type="spot"><float name="cutoff_angle" value="0"/></emitter>', "spot: cutoff_angle = 0, expected more than 0"),
    "cutoff above 180": ('<emitter type="spot"><float name="cutoff_angle" value="181"/></emitter>', '"cutoff_angle" = 181.0 is outside [0, 180]'),
    "textured spot": ('<emitter type="spot"><string name="texture" value="a.png"/></emitter>', 'spot: "texture" = "a.png" is of type string'),
    "coloured spot": ('<emitter type="spot"><rgb name="texture" value="1"/></emitter>', "spot: \"texture\" is a colour, expected a texture"),
    "smooth STL": (STL.format("a.stl").replace("/></shape>", '/><boolean name="face_normals" value="false"/></shape>'), '"face_normals" = False is not supported; allowed: true'),
    "include itself": ('<include filename="scene.xml"/>', '"scene.xml" includes itself'),
}  # fmt: skip

# Line 3 of scene.xml, in a scene with no other sensor.
SENSORS = {
    "no sensor": ("", "scene.xml:1: scene has no sensor; allowed: perspective"),
    "both fields of view": (LENS.format('<float name="fov" value="4"/><string name="focal_length" value="50mm"/>'), "both fov and focal_length given"),
    "fov 0": (LENS.format('<float name="fov" value="0"/>'), '"fov" = 0.0 is outside (0, 180)'),
    "fov 180": (LENS.format('<float name="fov" value="180"/>'), "is outside (0, 180)"),
    "fov axis": (LENS.format('<float name="fov" value="4"/><string name="fov_axis" value="z"/>'), '"fov_axis" = "z" is not supported', "allowed: diagonal, larger, smaller, x, y"),
    "focal length": (LENS.format('<string name="focal_length" value="50cm"/>'), '"50cm" is not a number'),
    "focal length 0": (LENS.format('<string name="focal_length" value="0mm"/>'), "outside [0.001, 1e+06] mm"),
    "near beyond far": (LENS.format('<float name="fov" value="4"/><float name="near_clip" value="5"/><float name="far_clip" value="2"/>'), "far_clip = 2 must be greater than near_clip = 5"),
    "near 0": (LENS.format('<float name="fov" value="4"/><float name="near_clip" value="0"/>'), '"near_clip" = 0.0 is outside (0, '),
    "camera that scales": (LENS.format('<float name="fov" value="4"/><transform name="to_world"><scale value="2"/></transform>'), "camera to_world scales by 2"),
    "film of width 0": (FILM.format('<integer name="width" value="0"/>'), '"width" = 0 is outside [1, '),
    "negative height": (FILM.format('<integer name="height" value="-5"/>'), '"height" = -5 is outside [1, '),
    "film too large": (FILM.format('<integer name="width" value="65536"/><integer name="height" value="65536"/>'), "film of 65536 x 65536 pixels has more than 2147483647"),
    "crop": (FILM.format('<integer name="crop_width" value="5"/><integer name="crop_offset_x" value="764"/>'), "hdrfilm: the crop window of 5 x 576 pixels at (764, 0) is not within the film of 768 x 576"),
    "filter": (FILM.format('<rfilter type="sinc"/>'), 'unknown rfilter "sinc"; allowed: box, catmullrom, gaussian, lanczos, mitchell, tent'),
    "mitchell's names": (FILM.format('<rfilter type="mitchell"><float name="A" value="0.3"/></rfilter>'), 'unknown parameter "A" = 0.3; allowed: B, C'),
    "mitchell's range": (FILM.format('<rfilter type="mitchell"><float name="B" value="1.5"/></rfilter>'), '"B" = 1.5 is outside [0, 1]'),
    "lobes": (FILM.format('<rfilter type="lanczos"><integer name="lobes" value="17"/></rfilter>'), '"lobes" = 17 is outside [1, 16]'),
    "lens without aperture": (THIN.format('<float name="focus_distance" value="2"/>'), 'thinlens: "aperture_radius" (float) is missing'),
    "negative aperture": (THIN.format('<float name="aperture_radius" value="-1"/><float name="focus_distance" value="2"/>'), '"aperture_radius" = -1.0 is outside [0, '),
    "focus 0": (THIN.format('<float name="aperture_radius" value="1"/><float name="focus_distance" value="0"/>'), '"focus_distance" = 0.0 is outside (0, '),
    "aperture of a pinhole": (LENS.format('<float name="fov" value="4"/><float name="aperture_radius" value="1"/>'), 'depth of field needs the sensor "thinlens"'),
    "unknown sensor": ('<sensor type="thinlense"/>', 'unknown sensor "thinlense"; allowed: batch, distant, irradiancemeter, orthographic, perspective, radiancemeter, thinlens', 'did you mean "thinlens"?'),
    "two media around the camera": (SENSOR.replace("</sensor>", '<medium type="homogeneous"/>' * 2 + "</sensor>"), "has 2 objects of category medium, at most 1"),
    "filter radius": (FILM.format('<rfilter type="tent"><float name="radius" value="0"/></rfilter>'), '"radius" = 0.0 is outside [0.001, 100]'),
    "sample count": (SENSOR.replace("</sensor>", '<sampler type="independent"><integer name="sample_count" value="0"/></sampler></sensor>'), '"sample_count" = 0 is outside [1, '),
    "seed": (SENSOR.replace("</sensor>", '<sampler type="independent"><integer name="seed" value="-1"/></sampler></sensor>'), '"seed" = -1 is outside [0, '),
    "sampler": (SENSOR.replace("</sensor>", '<sampler type="sobol"/></sensor>'), 'unknown sampler "sobol"; allowed: independent'),
}  # fmt: skip


def write(folder, line, sensor=SENSOR):
    path = folder / "scene.xml"
    path.write_text(f'<scene version="3.0.0">\n{SKY}\n{line}\n{sensor}</scene>\n', encoding="utf-8")
    return path


def message(path, parameters=None):
    with pytest.raises(SceneError) as caught:
        load_file(path, parameters or {})
    assert type(caught.value) is SceneError and isinstance(caught.value, ValueError)
    text = str(caught.value)
    assert "\n" not in text and len(text) < 1500
    return text


@pytest.mark.parametrize("name", LINES)
def test_bad_line(tmp_path, name):
    line, *fragments = LINES[name]
    text = message(write(tmp_path, line))
    where = f"{tmp_path}/scene.xml:"
    assert text.startswith(where + ("1: " if name == "text" else "3: ")), text
    for fragment in fragments:
        assert fragment in text.replace(str(tmp_path) + os.sep, ""), text


@pytest.mark.parametrize("name", SENSORS)
def test_bad_sensor(tmp_path, name):
    line, *fragments = SENSORS[name]
    text = message(write(tmp_path, line, sensor=""))
    assert text.startswith(f"{tmp_path}/scene.xml:{1 if name == 'no sensor' else 3}: "), text
    for fragment in fragments:
        assert fragment in text.replace(str(tmp_path) + os.sep, ""), text


FILES = {
    "empty": (b"", "not well-formed XML"),
    "cut": (b'<scene version="3.0.0"><shape', "scene.xml:1: not well-formed XML"),
    "not XML": (b"hello", "not well-formed XML"),
    "binary": (bytes(range(256)), "not UTF-8 text (byte 128)"),
    "half a UTF-16 character": ('<scene version="3.0.0"/>'.encode("utf-16-le") + b" ", "not UTF-16-LE text (byte 48)"),
    "lone surrogate": (b"\xfe\xff\xd8\x00", "not UTF-16-BE text (byte 2)"),
    "declared UTF-7": (b'<?xml version="1.0" encoding="utf-7"?><scene/>', "<scene> has no version"),
    "doctype": (b'<?xml version="1.0"?>\n<!DOCTYPE scene>\n<scene version="3.0.0"/>', "scene.xml:2: DOCTYPE and entities are not allowed"),
    "external entity": (b'<!DOCTYPE s [<!ENTITY x SYSTEM "file:///etc/hostname">]><scene version="3.0.0">&x;</scene>', "scene.xml:1: DOCTYPE and entities are not allowed"),
    "doctype behind a comment": (b'<!-- a\n -->\n<!DOCTYPE s [<!ENTITY a "b">]>\n<scene version="3.0.0"/>', "scene.xml:3: DOCTYPE"),
    "undeclared entity": (b'<scene version="3.0.0">\n&x;</scene>', "scene.xml:2: not well-formed XML"),
    "deep": (b'<scene version="3.0.0">' + b"<shape>" * 300, "not well-formed XML"),
    "another root": (b'<shape type="cube"/>', "the root element is <shape>, expected <scene>"),
    "no version": (b"<scene/>", '<scene> has no version; write version="3.0.0"'),
    "later version": (b'<scene version="10.0.0"/>', '"10.0.0", expected 0.x.x to 9.x.x'),
}  # fmt: skip


@pytest.mark.parametrize("name", FILES)
def test_bad_file(tmp_path, name):
    (tmp_path / "scene.xml").write_bytes(FILES[name][0])
    assert FILES[name][1] in message(tmp_path / "scene.xml")


def test_missing_files_and_names(tmp_path):
    assert "No such file or directory" in message(tmp_path / "none.xml")
    assert 'did you mean "cornell-box"?' in message("cornel-box")
    assert "neither a scene file (.xml, .gltf, .glb, .obj)" in message(tmp_path / "scene.usd")
    assert "Is a directory" in message(_folder(tmp_path / "folder.xml"))
    assert "cannot read" in message("nul\0.xml")
    os.mkfifo(tmp_path / "pipe.xml")
    assert "not a regular file" in message(tmp_path / "pipe.xml")
    (tmp_path / "loop.xml").symlink_to(tmp_path / "loop.xml")
    assert "cannot read" in message(tmp_path / "loop.xml")


def _folder(path):
    path.mkdir()
    return path


def test_parameters_that_do_not_exist(tmp_path):
    text = message("cornell-box", {"sp": 4})
    assert 'parameter "sp" = "4" is not used' in text and 'did you mean "spp"?' in text
    text = message("cornell-box", {"spp": "many"})
    assert re.search(r'cornell_box\.xml:\d+: "sample_count" = "many" is not an integer', text)
    assert '"width" = 0 is outside' in message("cornell-box", {"width": 0})


def test_parameters_do_not_explode(tmp_path):
    doubling = "".join(f'<default name="a{i + 1}" value="${{a{i}}}${{a{i}}}"/>' for i in range(60))
    text = message(write(tmp_path, f'<default name="a0" value="xxxxxxxx"/>{doubling}'))
    assert "parameters expand to more than" in text


def test_errors_in_included_files_name_them(tmp_path):
    (tmp_path / "part.xml").write_text('<scene version="3.0.0">\n\n<shape type="ball"/></scene>')
    text = message(write(tmp_path, '<include filename="part.xml"/>'))
    assert text.startswith(f'{tmp_path}/part.xml:3: unknown shape "ball"')
    (tmp_path / "part.xml").write_text('<rgb name="x" value="1"/>')
    assert "root element of an included file is <rgb>" in message(tmp_path / "scene.xml")


def test_include_bombs_end(tmp_path):
    for i in range(12):
        (tmp_path / f"{i}.xml").write_text(
            f'<scene version="3.0.0"><include filename="{i + 1}.xml"/></scene>'
        )
    assert "more than 8 nested" in message(write(tmp_path, '<include filename="0.xml"/>'))
    for i in range(4):
        inside = f'<include filename="{i + 1}.xml"/>' * 10 if i < 3 else ""
        (tmp_path / f"{i}.xml").write_text(f'<scene version="3.0.0">{inside}</scene>')
    assert "256 included files" in message(write(tmp_path, '<include filename="0.xml"/>'))
    (tmp_path / "0.xml").write_text('<scene version="3.0.0"><include filename="1.xml"/></scene>')
    (tmp_path / "1.xml").write_text('<scene version="3.0.0"><include filename="./0.xml"/></scene>')
    assert '"./0.xml" includes itself' in message(tmp_path / "scene.xml")


def test_files_have_a_largest_size(tmp_path, monkeypatch):
    monkeypatch.setattr(mitsuba_xml, "MAX_BYTES", 100)
    assert "exceeds 100 bytes" in message(write(tmp_path, " " * 100))


MESHES = {
    "obj: NaN": (TRIANGLE.replace("1 0 0", "nan 0 0") + "f 1 2 3\n", 'line 2: "nan" is not a finite number'),
    "obj: two coordinates": ("v 0 0\n", "line 1: v has 2 finite numbers, expected 3"),
    "obj: overflow": (TRIANGLE.replace("1 0 0", "1e999 0 0") + "f 1 2 3\n", "vertex 1 has the coordinate inf; it must be finite"),
    "obj: index too large": (TRIANGLE + "f 1 2 4\n", 'line 4: the index "4" is not within the 3 v lines before it'),
    "obj: index 0": (TRIANGLE + "f 0 1 2\n", 'the index "0" is not within'),
    "obj: negative index": (TRIANGLE + "f -1 -2 -4\n", 'the index "-4" is not within'),
    "obj: normal index": (TRIANGLE + "f 1//1 2//1 3//1\n", 'the index "1//1" is not within the 0 vn lines'),
    "obj: word": (TRIANGLE + "f a b c\n", 'the index "a" is not within'),
    "obj: edge": (TRIANGLE + "f 1 2\n", "line 4: a face needs at least 3 vertices"),
    "obj: no faces": (TRIANGLE, "holds no triangles"),
    "obj: empty": ("", "holds no triangles"),
    "obj: another format": (PLY_HEAD + "0 0 0\n1 0 0\n0 1 0\n3 0 1 2\n", "holds no triangles"),
    "ply: empty": ("", 'is not PLY: no header "ply" ... "end_header"'),
    "ply: another format": (TRIANGLE, "is not PLY"),
    "ply: endless header": ("ply\nformat ascii 1.0\n" + "comment x\n" * 9999, "is not PLY"),
    "ply: unknown format": (PLY_HEAD.replace("ascii", "ascii7") + "0 0 0\n", 'header line 2 states no known format; expected ascii 1.0'),
    "ply: NaN": (PLY_HEAD + "0 0 0\n1 nan 0\n0 1 0\n3 0 1 2\n", "vertex 1 has the coordinate nan"),
    "ply: index too large": (PLY_HEAD + "0 0 0\n1 0 0\n0 1 0\n3 0 1 3\n", "triangle 0 uses vertex 3, outside [0, 2]"),
    "ply: negative index": (PLY_HEAD + "0 0 0\n1 0 0\n0 1 0\n3 0 1 -1\n", "triangle 0 uses vertex -1, outside [0, 2]"),
    "ply: cut": (PLY_HEAD + "0 0 0\n1 0 0\n", "is damaged: 2 lines of data, 4 expected"),
    "ply: cut face": (PLY_HEAD + "0 0 0\n1 0 0\n0 1 0\n3 0 1", "is damaged: line 13 is no element face"),
    "ply: long face": (PLY_HEAD + "0 0 0\n1 0 0\n0 1 0\n3 0 1 2 0", "is no element face"),
    "ply: negative face": (PLY_HEAD + "0 0 0\n1 0 0\n0 1 0\n-3 0 1 2", "is no element face"),
    "ply: fraction": (PLY_HEAD + "0 0 0\n1 0 0\n0 1 0\n3 0 1.5 2", "face 0 is not of integers"),
    "ply: word": (PLY_HEAD + "0 0 0\n1 zero 0\n0 1 0\n3 0 1 2", "among the elements vertex"),
    "ply: no z": (PLY_HEAD.replace("property float z\n", "") + "0 0\n1 0\n0 1\n3 0 1 2", "the vertices have no x, y and z"),
    "ply: no faces": (PLY_HEAD.replace("vertex_indices", "corners") + "0 0 0\n1 0 0\n0 1 0\n3 0 1 2\n", "the faces have no list vertex_indices"),
    "ply: unknown type": (PLY_HEAD.replace("float y", "half y"), "bad header line 5"),
    "ply: list of floats long": (PLY_HEAD.replace("uchar int", "float int"), "bad header line"),
    "ply: NaN normal": (PLY_HEAD.replace("float z\n", "float z\nproperty float nx\nproperty float ny\nproperty float nz\n") + "0 0 0 0 0 1\n1 0 0 0 nan 1\n0 1 0 0 0 1\n3 0 1 2\n", "vertex 1 has the normal's component nan"),
    "obj: normal": (TRIANGLE + "vn 0 0\n", "line 4: vn has 2 finite numbers, expected 3"),
    "obj: texture": (TRIANGLE + "vt x\n", 'line 4: "x" is not a finite number'),
    "obj: texture index": (TRIANGLE + "vt 0 0\nf 1/1 2/1 3/2\n", 'the index "3/2" is not within the 1 vt lines'),
    "obj: four indices": (TRIANGLE + "vn 0 0 1\nvt 0 0\nf 1/1/1/1 2 3\n", 'the index "1/1/1/1" is not within'),
    "stl: empty": ("", "is not STL"),
    "stl: another format": (TRIANGLE, "is not STL"),
    "stl: no triangles": ("solid x\nendsolid x\n", "stl"),
    "stl: cut": ("solid x\nfacet normal 0 0 1\nouter loop\nvertex 0 0 0\nendloop\nendfacet\nendsolid\n", "stl"),
    "stl: NaN": ("solid x\nfacet normal 0 0 1\nouter loop\nvertex 0 0 0\nvertex 1 nan 0\nvertex 0 1 0\nendloop\nendfacet\nendsolid\n", "has the coordinate nan"),
    "ply: edge": (PLY_HEAD + "0 0 0\n1 0 0\n0 1 0\n2 0 1\n", "face 0 has 2 vertices, expected 3 or 4"),
    "ply: huge count": (PLY_HEAD.replace("vertex 3", "vertex 4000000000") + "0 0 0\n", "lines of data, 4000000001 expected"),
    "ply: negative count": (PLY_HEAD.replace("vertex 3", "vertex -3") + "0 0 0\n", "bad header line"),
    "ply: huge binary": (PLY_HEAD.replace("ascii", "binary_little_endian").replace("vertex 3", "vertex 4000000000"), "is damaged: 4000000001 elements in"),
}  # fmt: skip


@pytest.mark.parametrize("name", MESHES)
def test_bad_mesh(tmp_path, name):
    content, *fragments = MESHES[name]
    kind = name[:3]
    (tmp_path / f"mesh.{kind}").write_text(content)
    body = {"obj": OBJ, "ply": PLY, "stl": STL}[kind].format(f"mesh.{kind}")
    text = message(write(tmp_path, body))
    assert text.startswith(f"{tmp_path}/scene.xml:3: ")
    for fragment in fragments:
        assert fragment in text, text


# ---- dictionaries --------------------------------------------------------------------------------


class Strange:
    @property
    def matrix(self):
        raise RuntimeError("no")


def endless():
    shape = {"type": "rectangle"}
    shape["bsdf"] = shape
    return shape


DICTS = {
    "not a dictionary": ([1], "scene: [1] is not a dictionary"),
    "no type": ({}, 'scene: "type" = None, expected "scene"'),
    "not a scene": ({"type": "cube"}, '"type" = "cube", expected "scene"'),
    "unknown type": ({"s": {"type": "torus"}}, 'scene.s: unknown type "torus"; allowed: aov, area,'),
    "untyped object": ({"s": {"to_world": 1}}, 'scene.s: "type" = None is not the name of an object'),
    "unknown parameter": ({"white": {"type": "diffuse", "reflectence": 0.5}}, 'scene.white.reflectence: diffuse "white": unknown parameter "reflectence" = 0.5', 'did you mean "reflectance"?'),
    "reflectance": ({"white": {"type": "diffuse", "reflectance": {"type": "rgb", "value": [0, 2, 0]}}}, 'scene.white.reflectance: diffuse "white": "reflectance" = (0.0, 2.0, 0.0) is outside [0, 1]'),
    "NaN": ({"white": {"type": "diffuse", "reflectance": math.nan}}, "scene.white.reflectance", "must be finite"),
    "NaN in rgb": ({"w": {"type": "diffuse", "reflectance": {"type": "rgb", "value": [0, math.nan, 0]}}}, "scene.w.reflectance", "must be finite"),
    "list for colour": ({"w": {"type": "diffuse", "reflectance": [0.1, 0.2, 0.3]}}, "is of type vector, expected rgb, spectrum or number"),
    "rgb of two": ({"w": {"type": "diffuse", "reflectance": {"type": "rgb", "value": [1, 0]}}}, '"value" holds 2 numbers, expected 1 or 3'),
    "rgb key": ({"w": {"type": "diffuse", "reflectance": {"type": "rgb", "valeu": [1, 0]}}}, 'unknown key "valeu"'),
    "rgb without value": ({"w": {"type": "diffuse", "reflectance": {"type": "rgb"}}}, "None (NoneType) is not a value"),
    "string for number": ({"i": {"type": "path", "max_depth": "8"}}, "is of type string, expected integer"),
    "boolean for number": ({"i": {"type": "path", "max_depth": True}}, "is of type boolean, expected integer"),
    "huge integer": ({"i": {"type": "path", "max_depth": 10**400}}, "exceeds 64 bits"),
    "number key": ({"s": {"type": "cube", 3: 4}}, "the key 3 is not a string"),
    "array of 2": ({"s": {"type": "cube", "to_world": [1, 2]}}, "an array of shape (2,), expected (4, 4) or (3,)"),
    "object array": ({"s": {"type": "cube", "to_world": [[1], [2, 3]]}}, "is not a value that a scene can hold"),
    "strange object": ({"s": {"type": "cube", "to_world": Strange()}}, "scene.s.to_world", "(Strange) is not a value"),
    "NaN in a matrix": ({"s": {"type": "cube", "to_world": np.diag([1, math.nan, 1, 1])}}, 'scene.s.to_world: cube "s": "to_world"[1][1] is nan; it must be finite'),
    "singular matrix": ({"s": {"type": "cube", "to_world": np.diag([1, 0, 1, 1])}}, "scene.s.to_world", "is singular"),
    "unknown reference": ({"s": {"type": "cube", "bsdf": {"type": "ref", "id": "whit"}}, "white": {"type": "diffuse"}}, 'scene.s.bsdf: cube "s": there is no object with the id "whit"', 'did you mean "white"?'),
    "bad reference": ({"s": {"type": "cube", "bsdf": {"type": "ref", "id": 5}}}, '"id" = 5 is not a string'),
    "id twice": ({"a": {"type": "cube", "id": "x"}, "b": {"type": "cube", "id": "x"}}, 'scene.b: id "x" is already used at scene.a'),
    "id": ({"a": {"type": "cube", "id": 7}}, "scene.a.id: 7 is not a string"),
    "endless": ({"s": endless()}, "nested deeper than 32"),
    "missing file": ({"s": {"type": "ply", "filename": "nowhere.ply"}}, "scene.s.filename: cannot read", "No such file"),
    "medium on another side": ({"s": {"type": "sphere", "fog": {"type": "homogeneous"}}}, 'scene.s.fog: sphere "s": a medium of a shape is named "fog"; allowed: exterior, interior'),
    "medium by an unknown name": ({"s": {"type": "sphere", "interior": {"type": "ref", "id": "fog"}}}, 'scene.s.interior: sphere "s": there is no object with the id "fog"'),
    "material as a medium": ({"s": {"type": "sphere", "interior": {"type": "ref", "id": "m"}}, "m": {"type": "null"}, "t": {"type": "sphere", "exterior": {"type": "diffuse"}, "bsdf": {"type": "null"}}}, 'sphere "t" has 2 objects of category bsdf'),
    "index by an unknown name": ({"s": {"type": "cube", "bsdf": {"type": "dielectric", "int_ior": "glass"}}}, 'scene.s.bsdf.int_ior: dielectric: "int_ior" = "glass" is unknown'),
    "parameter of the scene": ({"max_depth": 3}, 'scene.max_depth: scene: unknown parameter "max_depth" = 3'),
}  # fmt: skip


@pytest.mark.parametrize("name", DICTS)
def test_bad_dictionary(name):
    content, *fragments = DICTS[name]
    if isinstance(content, dict) and name not in ("no type", "not a scene"):
        content = {
            "type": "scene",
            "cam": {"type": "perspective", "fov": 40},
            "sky": {"type": "constant"},
            **content,
        }
    with pytest.raises(SceneError) as caught:
        load_dict(content)
    for fragment in fragments:
        assert fragment in str(caught.value), str(caught.value)


# ---- arrays --------------------------------------------------------------------------------------


def arrays(**changes):
    values = {
        "vertices": [[0, 0, 0], [1, 0, 0], [0, 1, 0]],
        "triangles": [[0, 1, 2]],
        "triangle_material": [0],
        "triangle_emission": [-1],
        "reflectance": [[0.5, 0.5, 0.5]],
        "two_sided": [False],
        "emissions": np.zeros((0, 3)),
        "environment": [0, 0, 0],
        "camera": Camera(np.eye(4), 40.0),
        "film": Film(4, 4),
    }
    return {**values, **changes}


BALL = {"spheres": [[0, 0, 0, 1]], "sphere_material": [0]}
ARRAYS = {
    "NaN vertex": ({"vertices": [[0, 0, 0], [1, math.nan, 0], [0, 1, 0]]}, "vertices[1][1] is nan; it must be finite"),
    "infinite vertex": ({"vertices": [[0, 0, 0], [1, 0, 0], [-math.inf, 1, 0]]}, "vertices[2][0] is -inf"),
    "huge vertex": ({"vertices": [[0, 0, 0], [1, 0, 0], [1e101, 1, 0]]}, "vertices[2][0] = 1e+101 is outside"),
    "shape": ({"vertices": [0, 1, 2]}, "vertices has shape (3,), expected (n, 3)"),
    "ragged": ({"vertices": [[0], [1, 2]]}, "vertices cannot be read as numbers"),
    "strings": ({"vertices": [["a", "b", "c"]]}, "vertices cannot be read as numbers"),
    "index": ({"triangles": [[0, 1, 3]]}, "triangles[0][2] = 3 is outside [0, 2] (there are 3 vertices)"),
    "negative index": ({"triangles": [[0, 1, -1]]}, "triangles holds -1, outside [0, 4294967295]"),
    "index overflow": ({"triangles": [[0, 1, 2**32]]}, "triangles holds 4294967296, outside"),
    "float index": ({"triangles": [[0.0, 1.0, 2.0]]}, "triangles has dtype float64, expected integers"),
    "material": ({"triangle_material": [1]}, "triangle_material[0] = 1 is outside [0, 0] (there are 1 materials)"),
    "materials missing": ({"triangle_material": []}, "triangle_material has shape (0,), expected (1)"),
    "emission": ({"triangle_emission": [0]}, "triangle_emission[0] = 0 is outside [-1, -1]"),
    "emission -2": ({"triangle_emission": [-2]}, "triangle_emission[0] = -2 is outside"),
    "reflectance": ({"reflectance": [[0.5, 1.01, 0.5]]}, "reflectance[0][1] = 1.0"),
    "NaN reflectance": ({"reflectance": [[0.5, math.nan, 0.5]]}, "reflectance[0][1] is nan"),
    "radiance": ({"emissions": [[1, -1, 1]]}, "emissions[0][1] = -1.0 is outside [0, inf]"),
    "radiance beyond float32": ({"emissions": [[1, 1e39, 1]]}, "emissions (as float32)[0][1] is inf"),
    "environment": ({"environment": [0, -1, 0]}, "environment[1] = -1.0 is outside"),
    "camera": ({"camera": None}, "camera is NoneType, expected Camera"),
    "film": ({"film": (4, 4)}, "film is tuple, expected Film"),
    "max_depth": ({"max_depth": -2}, "max_depth = -2 is outside [-1, "),
    "max_depth 1.5": ({"max_depth": 1.5}, "max_depth = 1.5 is not an integer"),
    "rr_depth": ({"rr_depth": 0}, "rr_depth = 0 is outside [1, "),
    "spp": ({"spp": 0}, "spp = 0 is outside [1, "),
    "seed": ({"seed": -1}, "seed = -1 is outside [0, "),
    "shape index": ({"triangle_shape": [1]}, "triangle_shape[0] = 1 is outside [0, 0]"),
    "normal of length 2": ({"normals": [[0, 0, 2], [0, 0, 1], [0, 0, 0]]}, "normals[0] has length 2, expected 1, or 0 for none"),
    "normals missing": ({"normals": [[0, 0, 1]]}, "normals has shape (1, 3), expected (3, 3)"),
    "boundary": ({"triangle_boundary": [0]}, "triangle_boundary[0] = 0 is outside [-1, -1] (there are 0 boundaries)"),
    "sphere without material": ({"spheres": [[0, 0, 0, 1]]}, "sphere_material is missing; there are 1 spheres"),
    "radius 0": ({**BALL, "spheres": [[0, 0, 0, 0]]}, "spheres[0][3] = 0.0 is outside (0, "),
    "NaN radius": ({**BALL, "spheres": [[0, 0, 0, math.nan]]}, "spheres[0][3] is nan"),
    "sphere's emission": ({**BALL, "sphere_emission": [3]}, "sphere_emission[0] = 3 is outside [-1, -1] (there are 0 emissions)"),
    "sphere's shape": ({**BALL, "sphere_shape": [3]}, "sphere_shape[0] = 3 is outside [0, 0] (there are 1 shapes)"),
    "inward twice": ({**BALL, "sphere_inward": [True, False]}, "sphere_inward has shape (2,), expected (1)"),
    "flat disk": ({"disks": [[[0, 0, 0], [1, 0, 0], [2, 0, 0]]], "disk_material": [0]}, "disks[0] is flat"),
    "disk of a point": ({"disks": np.zeros((1, 3, 3)), "disk_material": [0]}, "disks[0] is flat"),
    "disk's shape": ({"disks": [[0, 0, 0]]}, "disks has shape (1, 3), expected (n, 3, 3)"),
    "material kind": ({"material_kind": [15]}, "material_kind[0] = 15 is outside [0, 14] (there are 15 material kinds)"),
    "kinds missing": ({"material_kind": [0, 0]}, "material_kind has shape (2,), expected (1)"),
    "specular": ({"specular_reflectance": [[0, 0, 2]]}, "specular_reflectance[0][2] = 2.0 is outside [0, 1]"),
    "index 0": ({"material_kind": [2], "eta": [[0, 0, 0]]}, "eta[0] = [0.0, 0.0, 0.0] of a dielectric; expected one number in [0.001, 1000]"),
    "matched rough glass": ({"material_kind": [8], "eta": [[1, 1, 1]]}, "eta[0] is 1 on a roughdielectric; equal indices have no small mirrors"),
    "matched principled glass": ({"material_kind": [10], "eta": [[1, 1, 1]]}, "eta[0] is 1 on a principled_open; equal indices have no small mirrors"),
    "more than all metal": ({"material_kind": [9], "metallic": [1.5]}, "metallic[0] = 1.5 is outside [0, 1]"),
    "no roughness": ({"material_kind": [6], "alpha_u": [0.0]}, "alpha_u[0] = 0.0 is outside [5e-05, 10]"),
    "anisotropic": ({"material_kind": [7], "eta": [[1.5] * 3], "alpha_u": [0.2]}, "alpha_u[0] = 0.2 and alpha_v[0] = 0.1: the coat of a roughplastic has one alpha"),
    "brushed compensation": ({"material_kind": [13], "alpha_u": [0.2]}, "alpha_u[0] = 0.2 and alpha_v[0] = 0.1: energy compensation of a roughconductor_whole is for one alpha"),
    "matched whole glass": ({"material_kind": [14], "eta": [[1, 1, 1]]}, "eta[0] is 1 on a roughdielectric_whole; equal indices have no small mirrors"),
    "shadows": ({"shadowing": [2]}, "shadowing[0] = 2 is outside [0, 1] (there are 2 shadowings)"),
    "slopes": ({"distribution": [2]}, "distribution[0] = 2 is outside [0, 1] (there are 2 distributions)"),
    "coloured index": ({"material_kind": [3], "eta": [[1.5, 1.5, 1.6]]}, "of a plastic; expected one number"),
    "k": ({"k": [[0, -1, 0]]}, "k[0][1] = -1.0 is outside [0, 1e+06]"),
    "opacity": ({"opacity": [1.5]}, "opacity[0] = 1.5 is outside [0, 1]"),
    "two-sided glass": ({"material_kind": [2], "two_sided": [True]}, "two_sided[0] is set on a dielectric; allowed: on diffuse, conductor, plastic, roughconductor, roughplastic, principled, roughconductor_whole"),
    "boundary of no medium": ({"boundaries": [[0, -1]]}, "boundaries[0][0] = 0 is outside [-1, -1] (there are 0 media)"),
    "extinction": ({"sigma_t": [[1, -1, 1]]}, "sigma_t[0][1] = -1.0 is outside [0, inf]"),
    "albedo": ({"sigma_t": [[1, 1, 1]], "albedo": [[0, 0, 1.1]]}, "albedo[0][2] = 1.1"),
    "albedo alone": ({"albedo": [[0, 0, 1]]}, "albedo has shape (1, 3), expected (0, 3)"),
    "asymmetry": ({"sigma_t": [[1, 1, 1]], "phase_g": [-1]}, "phase_g[0] = -1.0 is outside (-1, 1)"),
    "light kind": ({"light_kind": [4]}, "light_kind[0] = 4 is outside [0, 3] (there are 4 light kinds)"),
    "projector": ({"light_kind": [3]}, "light_image[0] = [[0.0, 0.0, 0.0], [0.0, 0.0, 0.0]] of a projector; expected"),
    "texture of a light": ({"light_kind": [0], "light_texture": [0]}, "light_texture[0] = 0 is outside"),
    "light direction": ({"light_kind": [1], "light_direction": [[0, 0, 2]]}, "light_direction[0] has length 2, expected 1"),
    "intensity": ({"light_kind": [0], "light_intensity": [[0, 0, -2]]}, "light_intensity[0][2] = -2.0 is outside"),
    "angles": ({"light_kind": [1], "light_angles": [[20, 30]]}, "light_angles[0] = [20.0, 30.0]; expected a cutoff in (0, 180] and a beam width"),
    "camera's medium": ({"camera": Camera(np.eye(4), 40.0, medium=0)}, "camera medium = 0 is outside [-1, -1]"),
}  # fmt: skip


@pytest.mark.parametrize("name", ARRAYS)
def test_bad_arrays(name):
    changes, fragment = ARRAYS[name]
    with pytest.raises(SceneError) as caught:
        Scene(**arrays(**changes))
    assert fragment in str(caught.value), str(caught.value)


def test_good_arrays():
    scene = Scene(**arrays())
    assert scene.shape_names == ("scene",) and scene.triangle_shape.tolist() == [0]


@pytest.mark.parametrize(
    ("make", "fragment"),
    [
        (lambda: Film(0, 4), "film width = 0 is outside"),
        (lambda: Film(4, 2.5), "film height = 2.5 is not an integer"),
        (lambda: Film(2**16, 2**16), "has more than 2147483647"),
        (lambda: Film(4, 4, "sinc"), "filter = 'sinc' is unknown; allowed: box, tent, gaussian, mitchell"),
        (lambda: Film(4, 4, "gaussian", math.nan), "filter_parameter = nan is outside"),
        (lambda: Film(4, 4, "box", 2.0), "of the box filter must be 0.5"),
        (lambda: Camera(np.eye(3), 40), "camera to_world has shape (3, 3), expected (4, 4)"),
        (lambda: Camera(np.zeros((4, 4)), 40), "last row"),
        (lambda: Camera(np.diag([1, 1, 0, 1]), 40), "camera to_world is singular"),
        (lambda: Camera(np.diag([1, math.inf, 1, 1]), 40), "camera to_world[1][1] is inf"),
        (lambda: Camera(np.eye(4), 0), "fov = 0 is outside (0, 180)"),
        (lambda: Camera(np.eye(4), math.nan), "fov = nan is outside"),
        (lambda: Camera(np.eye(4), "40"), "fov = '40' is not a number"),
        (lambda: Camera(np.eye(4), 40, "w"), "fov_axis = 'w' is unknown"),
        (lambda: Camera(np.eye(4), 40, near_clip=-1), "near_clip = -1 is outside"),
        (lambda: Camera(np.eye(4), 40, near_clip=2, far_clip=2), "must be greater than near_clip"),
        (lambda: Camera(np.eye(4), 40, aperture_radius=-1), "aperture_radius = -1 is outside"),
        (lambda: Camera(np.eye(4), 40, focus_distance=0), "focus_distance = 0 is outside (0, "),
        (lambda: Camera(np.eye(4), 40, medium=-2), "camera medium = -2 is outside"),
        (lambda: Camera(np.eye(4), 40, principal_point_offset=[0, math.nan]), "principal_point_offset[1] is nan"),
    ],
)  # fmt: skip
def test_bad_camera_and_film(make, fragment):
    with pytest.raises(SceneError) as caught:
        make()
    assert fragment in str(caught.value), str(caught.value)


# ---- damage at random ----------------------------------------------------------------------------

WORDS = (
    b'"', b"<", b">", b"/>", b"nan", b"inf", b"1e999", b"-1", b"0", b"", b"$x", b"$", b"${", b"&amp;", b"&x;",
    b"\0", b"\xff", b"99999999999999999999", b"-99999999999", b'type="obj"', b"<scene>", b"<!--", b"]]>",
    b"1e308", b"rectangle", b"transform", b"name", b"id=\"white\"", b"<include filename=\"scene.xml\"/>",
)  # fmt: skip


def damaged(data, rng):
    """A copy of data with up to four bytes, words, pieces or numbers changed, dropped or doubled."""
    for _ in range(rng.randint(1, 4)):
        a = rng.randrange(len(data) + 1)
        b = min(len(data), a + int(rng.expovariate(1 / 12)))
        kind = rng.randrange(7)
        if kind == 0:
            data = data[:a] + bytes([rng.randrange(256)]) + data[a + 1 :]
        elif kind == 1:
            data = data[:a] + data[b:]
        elif kind == 2:
            data = data[:b] + data[a:]
        elif kind == 3:
            data = data[:a] + rng.choice(WORDS) + data[b:]
        elif kind == 4:
            numbers = list(re.finditer(rb"[-+]?[0-9.]+", data))
            if numbers:
                match = rng.choice(numbers)
                data = data[: match.start()] + rng.choice(WORDS) + data[match.end() :]
        elif kind == 5:
            data = data[:a] if rng.random() < 0.2 else data
        else:
            values = list(re.finditer(rb'"[^"]*"', data))
            if len(values) > 1:
                one, two = sorted(rng.sample(values, 2), key=lambda m: m.start())
                between = data[one.end() : two.start()]
                data = data[: one.start()] + two[0] + between + one[0] + data[two.end() :]
    return data


def outcome(path):
    """Loads a file: SceneError, or a scene whose numbers are all in range."""
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", SceneWarning)
        try:
            scene = load_file(path)
        except SceneError as error:
            assert len(str(error)) < 2000
            return False
    assert np.isfinite(scene.spheres).all() and (scene.eta >= 0).all()
    assert np.isfinite(scene.vertices).all() and np.isfinite(scene.camera.to_world).all()
    assert not len(scene.triangles) or scene.triangles.max() < len(scene.vertices)
    assert ((scene.reflectance >= 0) & (scene.reflectance <= 1)).all()
    assert np.isfinite(scene.emissions).all() and (scene.emissions >= 0).all()
    assert scene.film.width * scene.film.height <= 2**31 and len(scene.sha256) == 64
    return True


@pytest.mark.parametrize("name", sorted(SHIPPED))
def test_damaged_scene_files(tmp_path, name):
    source = find_shipped(name)
    for mesh in (source.parent / "meshes").glob("*.obj"):
        (tmp_path / "meshes").mkdir(exist_ok=True)
        (tmp_path / "meshes" / mesh.name).write_bytes(mesh.read_bytes())
    data, path = source.read_bytes(), tmp_path / "scene.xml"
    rng = random.Random(name)
    valid = 0
    for _ in range(250):
        path.write_bytes(damaged(data, rng))
        valid += outcome(path)
    assert 5 < valid < 200, "the damage is neither nothing nor everything"


def test_scene_file_cut_at_every_byte(tmp_path):
    data = (
        b'<scene version="3.0.0">' + SENSOR.encode() + RECTANGLE.format("").encode() + b"</scene>\n"
    )
    path = tmp_path / "scene.xml"
    for length in range(len(data)):
        path.write_bytes(data[:length])
        assert outcome(path) == (length == len(data) - 1)


@pytest.mark.parametrize("kind", ["obj", "ply", "binary ply", "stl", "binary stl"])
def test_damaged_meshes(tmp_path, kind):
    vertices, faces = [[0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0]], [[0, 1, 2], [0, 2, 3]]
    if kind == "obj":
        data = b"".join(b"v %d %d %d\n" % tuple(v) for v in vertices) + b"f 1 2 3\nf 1/ 3 4\n"
    elif kind == "stl":
        data = b"solid\n" + b"".join(
            b"facet normal 0 0 1\nouter loop\n"
            + b"".join(b"vertex %d %d %d\n" % tuple(vertices[i]) for i in face)
            + b"endloop\nendfacet\n"
            for face in faces
        ) + b"endsolid\n"  # fmt: skip
    elif kind == "binary stl":
        data = b"x" * 80 + np.uint32(2).tobytes()
        for face in faces:
            corners = np.array([[0, 0, 1], *(vertices[i] for i in face)], "<f4")
            data += corners.tobytes() + b"\0\0"
    else:
        binary = "binary" in kind
        text = PLY_HEAD.replace("vertex 3", "vertex 4").replace("face 1", "face 2")
        data = (text.replace("ascii", "binary_little_endian") if binary else text).encode()
        if binary:
            data += np.array(vertices, "<f4").tobytes()
            data += b"".join(b"\3" + np.array(f, "<i4").tobytes() for f in faces)
        else:
            data += b"".join(b"%d %d %d\n" % tuple(v) for v in vertices)
            data += b"".join(b"3 %d %d %d\n" % tuple(f) for f in faces)
    suffix = kind[-3:]
    scene = write(tmp_path, {"obj": OBJ, "ply": PLY, "stl": STL}[suffix].format(f"m.{suffix}"))
    path = tmp_path / f"m.{suffix}"
    path.write_bytes(data)
    assert outcome(scene)
    for length in range(len(data)):
        path.write_bytes(data[:length])
        outcome(scene)
    rng = random.Random(kind)
    for _ in range(250):
        path.write_bytes(damaged(data, rng))
        outcome(scene)
