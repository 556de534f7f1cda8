"""Blender's Cycles as a peer, by the package `bpy`: diffuse meshes, area lights, constant sky.

Built from our reading of the scene file. Tabulated Sobol pattern, box filter, paths of the same
length; no clamp, no adaptive sampling, no denoiser. Times hold the way over the file by which `bpy`
hands out a picture. Its roulette has another rule: the same mean, other noise.
"""

from __future__ import annotations

import math
import tempfile
import time
from pathlib import Path
from typing import Any

import numpy as np

from veriray.columns import MATERIAL_KINDS
from veriray.scene import Scene, load_file

from .measure import Array, Meter, cpu_count
from .peers import serve

_UNLIMITED = 1024  # bounces
_OFF = ("use_denoising", "use_adaptive_sampling", "use_fast_gi", "use_guiding")
_BOUNCES = ("max", "diffuse", "glossy", "transmission", "volume", "transparent_max")


class Cycles:
    """The renderer of the peer's process; one scene at a time is in Blender."""

    def __init__(self, bpy: Any) -> None:
        self._bpy = bpy
        self._scenes: dict[str, tuple[Scene, dict[str, Any]]] = {}
        self._shown = ""
        self._folder = tempfile.TemporaryDirectory()

    def load(self, key: str, path: str, settings: dict[str, Any]) -> float:
        """Seconds to read a file and make Blender's scene; ValueError for what is not supported."""
        begin = time.perf_counter()
        scene = load_file(path, settings)
        _check(scene)
        self._scenes[key] = scene, settings
        self._show(key)
        return time.perf_counter() - begin

    def run(self, key: str, spp: int, seed: int) -> tuple[dict[str, Any], Array]:
        """Seconds and wall are one: there is no film to wait for but the file."""
        if key != self._shown:
            self._show(key)
        scene = self._bpy.context.scene
        scene.cycles.samples, scene.cycles.seed = spp, seed
        scene.update_tag()  # or data that are kept keep the seed
        with Meter() as m:
            self._bpy.ops.render.render(write_still=True)
            image = _pixels(Path(scene.render.filepath))
        return {"seconds": m.wall, **m.row()}, image

    def forget(self) -> None:
        """Free all scenes."""
        self._scenes.clear()
        self._shown = ""
        self._bpy.ops.wm.read_factory_settings(use_empty=True)

    def _show(self, key: str) -> None:
        scene, settings = self._scenes[key]
        self._bpy.ops.wm.read_factory_settings(use_empty=True)
        _set_up(self._bpy.context.scene, settings, str(Path(self._folder.name) / "cycles.exr"))
        _add_camera(self._bpy, scene, settings)
        _add_meshes(self._bpy, scene)
        _add_sky(self._bpy, scene)
        self._shown = key


def _check(scene: Scene) -> None:
    kinds = scene.material_kind
    used = {MATERIAL_KINDS[k] for k in kinds.tolist()} if kinds is not None else {"diffuse"}
    others = {"spheres": scene.spheres, "disks": scene.disks, "lights": scene.light_kind,
              "media": scene.sigma_t}  # fmt: skip
    extra = [name for name, rows in others.items() if rows is not None and len(rows)]
    if extra or used != {"diffuse"}:
        names = ", ".join(extra + sorted(used - {"diffuse"}))
        raise ValueError(f"{names}: this peer takes diffuse meshes, area lights and a constant sky")


def _set_up(blender: Any, settings: dict[str, Any], path: str) -> None:
    """Render settings; settings: width, height and max_depth (rr_depth has no like)."""
    render, cycles = blender.render, blender.cycles
    render.engine, cycles.device = "CYCLES", "CPU"
    for name in _OFF:
        if hasattr(cycles, name):
            setattr(cycles, name, False)
    cycles.sampling_pattern = "TABULATED_SOBOL"
    cycles.pixel_filter_type, cycles.filter_width = "BOX", 1.0
    depth = settings["max_depth"]
    for name in _BOUNCES:
        setattr(cycles, f"{name}_bounces", _UNLIMITED if depth < 0 else max(depth - 2, 0))
    cycles.sample_clamp_direct = cycles.sample_clamp_indirect = 0
    cycles.light_sampling_threshold = 0
    render.resolution_x, render.resolution_y = settings["width"], settings["height"]
    render.resolution_percentage = 100
    render.threads_mode, render.threads = "FIXED", cpu_count()
    render.use_persistent_data = True
    render.use_compositing = render.use_sequencer = False
    render.image_settings.file_format = "OPEN_EXR"
    render.image_settings.color_mode, render.image_settings.color_depth = "RGB", "32"
    render.image_settings.exr_codec = "NONE"
    render.filepath = path


def _pixels(path: Path) -> Array:
    """(H, W, 3) float32 of an EXR file."""
    import OpenEXR

    return np.asarray(OpenEXR.File(str(path)).channels()["RGB"].pixels, np.float32)


def _add_camera(bpy: Any, scene: Scene, settings: dict[str, Any]) -> None:
    """Blender looks along local -Z with +X to the right."""
    from mathutils import Matrix

    camera = bpy.data.cameras.new("camera")
    camera.sensor_fit = "HORIZONTAL"
    tangent = scene.camera.tan_half_x(settings["width"], settings["height"])
    camera.angle = 2 * math.atan(tangent)
    camera.clip_start, camera.clip_end = 1e-3, 1e6
    to_world = scene.camera.to_world @ np.diag([-1.0, 1.0, -1.0, 1.0])
    thing = bpy.data.objects.new("camera", camera)
    thing.matrix_world = Matrix(to_world.tolist())
    bpy.context.scene.collection.objects.link(thing)
    bpy.context.scene.camera = thing


def _add_meshes(bpy: Any, scene: Scene) -> None:
    """A mesh with face normals for each pair of material and emission."""
    count = len(scene.triangles)
    emission = scene.triangle_emission
    pairs = np.stack([scene.triangle_material.astype(np.int64),
                      np.full(count, -1) if emission is None else emission], axis=1)  # fmt: skip
    kinds, which = np.unique(pairs, axis=0, return_inverse=True)
    for k, (material, light) in enumerate(kinds.tolist()):
        faces = scene.triangles[which.ravel() == k]
        corners, index = np.unique(faces, return_inverse=True)
        mesh = bpy.data.meshes.new(f"mesh {k}")
        mesh.vertices.add(len(corners))
        mesh.vertices.foreach_set("co", scene.vertices[corners].astype(np.float32).ravel())
        mesh.loops.add(faces.size)
        mesh.loops.foreach_set("vertex_index", index.astype(np.int32).ravel())
        mesh.polygons.add(len(faces))
        mesh.polygons.foreach_set("loop_start", np.arange(0, faces.size, 3, dtype=np.int32))
        mesh.update(calc_edges=True)
        mesh.shade_flat()
        radiance = None if light < 0 else scene.emissions[light].tolist()
        both = bool(scene.two_sided[material])
        mesh.materials.append(
            _material(bpy, f"material {k}", scene.reflectance[material].tolist(), radiance, both)
        )
        bpy.context.scene.collection.objects.link(bpy.data.objects.new(f"mesh {k}", mesh))


def _material(
    bpy: Any, name: str, colour: list[float], radiance: list[float] | None, both: bool
) -> Any:
    """Diffuse, and emission on the front; black from behind unless `both`."""
    material = bpy.data.materials.new(name)
    material.use_nodes = True
    tree = material.node_tree
    tree.nodes.clear()
    out, link = tree.nodes.new("ShaderNodeOutputMaterial"), tree.links.new
    diffuse = tree.nodes.new("ShaderNodeBsdfDiffuse")
    diffuse.inputs["Color"].default_value = (*colour, 1)
    shader = diffuse.outputs[0]
    if radiance is not None:
        strength = max(radiance)
        light = tree.nodes.new("ShaderNodeEmission")
        light.inputs["Color"].default_value = (*(c / strength for c in radiance), 1)
        light.inputs["Strength"].default_value = strength
        added = tree.nodes.new("ShaderNodeAddShader")
        link(shader, added.inputs[0])
        link(light.outputs[0], added.inputs[1])
        shader = added.outputs[0]
        material.cycles.emission_sampling = "FRONT"
    if not both:
        side, mix = (tree.nodes.new(n) for n in ("ShaderNodeNewGeometry", "ShaderNodeMixShader"))
        link(side.outputs["Backfacing"], mix.inputs[0])
        link(shader, mix.inputs[1])
        shader = mix.outputs[0]
    link(shader, out.inputs["Surface"])
    return material


def _add_sky(bpy: Any, scene: Scene) -> None:
    world = bpy.data.worlds.new("sky")
    world.use_nodes = True
    tree = world.node_tree
    tree.nodes.clear()
    sky, out = (tree.nodes.new(n) for n in ("ShaderNodeBackground", "ShaderNodeOutputWorld"))
    strength = float(scene.environment.max())
    sky.inputs["Color"].default_value = (*(scene.environment / (strength or 1)).tolist(), 1)
    sky.inputs["Strength"].default_value = strength
    tree.links.new(sky.outputs[0], out.inputs["Surface"])
    bpy.context.scene.world = world


def _start(variant: str) -> tuple[dict[str, Any], Cycles]:
    import bpy

    return {"version": bpy.app.version_string}, Cycles(bpy)


if __name__ == "__main__":
    serve(_start)
