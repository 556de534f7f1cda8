"""What compute-sanitizer watches: every compiled variant under a scheduler of each method, the
others, the Sobol sampler, lists of pixels, and the hooks.

compute-sanitizer --tool memcheck --error-exitcode 1 python benchmarks/sanitizer_target.py
(likewise --tool racecheck, --tool initcheck, --tool synccheck; names of scenes: those alone)
"""

from __future__ import annotations

import sys
from collections.abc import Callable
from typing import Any

import numpy as np
from common import ROOT

import veriray as vr
from veriray.native_scene import native_scene_arguments
from veriray.rendering import METHODS, SCHEDULERS
from veriray_validate.leaks import displaced_icosphere, mesh_scene

SIZE = {"width": 16, "height": 12}
SPP = 2
#: Scenes of scenes/checks that hold every shape, material, light, lens and filter, and media.
CHECKS = (
    "smooth_normals", "mesh_light", "near_lamps", "disk_light", "spheres_300", "sphere_light",
    "spot_light", "point_in_medium", "directional_light", "conductor_metal", "nested_dielectrics",
    "glass_mesh", "thindielectric", "plastic", "mask", "twosided", "chromatic_medium",
    "camera_in_medium", "medium_in_mesh", "thinlens", "mitchell", "blends", "principled_surfaces",
    "principled_glass", "rough_metal", "rough_glass", "rough_plastic", "relief", "textures",
    "textured_lamps", "albedo_grid", "smoke", "blended_fog", "image_sky", "daylight",
    "projected_images",
    "attributes", "orthographic", "instances",
)  # fmt: skip
ALL_FEATURES = ("cornell-box", "chromatic_medium", "medium_in_mesh")
MAIN = METHODS
#: Settings of further renders of EXTRA.
EXTRA = ("cornell-box-mitsuba", "medium_in_mesh")
FURTHER: tuple[dict[str, Any], ...] = (
    *({"scheduler": name} for name in SCHEDULERS if name not in ("auto", *MAIN)),
    *({"scheduler": name, "sampler": "sobol"} for name in MAIN),
    *({"scheduler": name, "target_error": 0.3, "spp": 64} for name in MAIN),
    {"scheduler": "fused", "batch_size": 128, "spp": 16},  # one block: its warps take in stock
    {"scheduler": "wavefront", "batch_size": 33, "spp": 16},  # refilled, warps not full
)


def cubes() -> vr.Scene:
    """Seventy cubes, more than the flat path holds: a tree."""
    scene: dict[str, Any] = {
        "type": "scene",
        "sensor": {"type": "perspective", "fov": 40.0, "film": {"type": "hdrfilm"}},
        "sky": {"type": "constant"},
    }
    rng = np.random.default_rng(1)
    for k in range(70):
        x, y, z = rng.uniform(-1, 1, 3)
        corner = np.eye(4)
        corner[:3, :3] *= 0.2
        corner[:3, 3] = (x, y, 4 + z)
        scene[f"cube{k}"] = {"type": "cube", "to_world": corner}
    return vr.load_dict(scene)


def glass() -> vr.Scene:
    """A medium in a glass ball under the sky."""
    medium = {"type": "homogeneous", "sigma_t": 16.0, "albedo": 0.9}
    ball = {"type": "sphere", "bsdf": {"type": "dielectric"}, "interior": medium}
    camera = {"type": "perspective", "fov": 40.0, "film": {"type": "hdrfilm"}}
    scene = vr.load_dict(
        {"type": "scene", "sensor": camera, "sky": {"type": "constant"}, "ball": ball}
    )
    return scene.with_(camera=vr.Camera.look_at((0, 0, 4), (0, 0, 0)), max_depth=64)


def check(path: str) -> Callable[[], vr.Scene]:
    """A maker of one of scenes/checks."""
    return lambda: vr.load_file(ROOT / "scenes" / "checks" / f"{path}.xml")


def makers() -> dict[str, Callable[[], vr.Scene]]:
    """All scenes by name."""
    shipped = ("cornell-box", "cornell-box-mitsuba", "open")
    scenes: dict[str, Callable[[], vr.Scene]] = {
        name: lambda name=name: vr.load_file(name) for name in shipped
    }
    return {**scenes, "cubes": cubes, "glass": glass, **{name: check(name) for name in CHECKS}}


def hooks() -> None:
    """The hooks that launch kernels of their own: the same answers on `cuda` and `cpu`."""
    vertices, triangles = displaced_icosphere(2)
    scene = mesh_scene(vertices, triangles, vr.Camera.look_at((0, 0, 4), (0, 0, 0)))
    rng = np.random.default_rng(1)
    o, d = rng.normal(size=(2, 200, 3))
    answers = []
    for name, builder in (("cuda", "sah"), ("cuda", "ploc"), ("cpu", "sah")):
        device, _ = vr.device.select(name)
        native = device.native
        host = native.Scene(**native_scene_arguments(scene), device=device.index, builder=builder)
        if hasattr(native, "device_tree") and builder == "ploc":
            trees = native.device_tree(host), native.host_ploc(host, 4)
            assert all(np.array_equal(a, b) for a, b in zip(*trees, strict=True)), "trees differ"
        found = [native.intersect(host, o, d)]
        if hasattr(native, "intersect_width"):
            found += [native.intersect_width(host, width, o, d)[:2] for width in (2, 4, 8)]
        leaks = native.count_leaks(host, np.zeros((1, 3)), 0, 500)
        assert tuple(leaks) == (0, 0), f"{name}: {leaks} leaks"
        answers += [tuple(array.tobytes() for array in pair) for pair in found]
    assert len(set(answers)) == 1, "CUDA and CPU, two widths or two builders differ"
    print("hooks agree")


def main() -> None:
    """Render small pictures on `cuda` and compare their bits with the CPU's."""
    scenes = makers()
    variants = set()
    for name in sys.argv[1:] or scenes:
        scene = scenes[name]().with_(**SIZE)
        renders: list[dict[str, Any]] = [
            {"scheduler": scheduler, "all_features": every}
            for scheduler in MAIN
            for every in ((False, True) if name in ALL_FEATURES else (False,))
        ]
        for settings in (*renders, *(FURTHER if name in EXTRA else ())):
            shas = set()
            for device in ("cuda", "cpu"):
                r = vr.render(scene, device=device, **{"spp": SPP, **settings})
                shas.add(r.film_sha256)
            variants.add((settings["scheduler"], *r.stats["variant"]))
            assert len(shas) == 1, f"{name}, {settings}: CUDA and CPU differ"
            print(f"{name:20} {settings} {shas.pop()[:16]}", flush=True)
    print(f"{len(variants)} pairs of scheduler and variant")
    hooks()


if __name__ == "__main__":
    main()
