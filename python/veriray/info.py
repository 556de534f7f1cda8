"""`veriray info`: what a scene needs, what is compiled in for it, and what it costs."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

from . import device as device_module
from . import limits
from .columns import MATERIAL_KINDS
from .native_scene import native_scene
from .rendering import prepare
from .scene import Scene

#: Features by the native modules' names. A feature not listed here is shown without its meaning.
FEATURES = {
    "quads": "parallelograms tested one by one",
    "polygons": "other flat primitives tested one by one",
    "disks": "disks",
    "spheres": "spheres",
    "bvh": "a tree over the primitives",
    "smooth": "interpolated normals",
    "area_lights": "parallelograms that emit",
    "many_lights": "more than one light to choose from",
    "triangle_lights": "triangles that emit",
    "disk_lights": "disks that emit",
    "sphere_lights": "spheres that emit",
    "delta_lights": "point, spot and directional lights",
    "environment": "light from all around",
    "image_sky": "an image around the scene",
    "guided_sky": "a sky that is seen through openings, sampled by place",
    "projectors": "lights that throw an image",
    "clip": "near or far clipping",
    "lens": "a lens with an aperture",
    "refraction": "materials that change the direction of what goes through",
    "pass": "straight through: null, mask, thin dielectric",
    "media": "media that scatter and absorb",
    "chromatic": "media whose extinction depends on the colour",
    "phases": "phase functions other than one of Henyey and Greenstein",
    "albedo_grids": "media whose albedo a grid gives",
    "uneven_media": "media whose extinction a grid gives",
    "textures": "textures on surfaces",
    "light_textures": "textures of lights",
    "blend": "materials that are one of two at each hit",
    "attributes": "textures of numbers that meshes have",
    "tangents": "slopes by direction, normal and bump maps",
    "hidden": "light that the camera does not see directly",
    "rectangle_lights": "rectangles that emit, near to something: sampled by solid angle",
    **{name: f"materials of kind {name}" for name in MATERIAL_KINDS},
}


def examine(
    scene: Scene,
    device: str = "auto",
    width: int | None = None,
    height: int | None = None,
    progress: Callable[[float], object] | None = None,
) -> dict[str, Any]:
    """What `veriray info --json` prints, as plain data.

    Keys: device, device_reason, features (needed), variant (compiled in), unused (compiled in, not
    needed), skipped (not compiled in), path_bytes, primitives, tree and memory (as
    `rendering.prepare` gives them), counts (rows of the scene's tables), materials (count by
    kind), width, height, scene_sha256, cameras (count), notes (`Scene.notes`), warnings (texts
    about details too fine for float32, see `limits`). Raises as `veriray.render`.
    """
    chosen, reason = device_module.select(device)
    facts = prepare(scene, device, width, height, progress)
    used = scene.with_(width=width, height=height)
    with device_module.native_errors():
        origin, _ = native_scene(scene, used, chosen, progress, spp=used.spp).frame  # kept
    kinds: list[int] = used.material_kind.tolist() if used.material_kind is not None else []
    counts = {
        "vertices": used.vertices,
        "triangles": used.triangles,
        "spheres": used.spheres,
        "disks": used.disks,
        "materials": used.material_kind,
        "emissions": used.emissions,
        "lights": used.light_kind,
        "media": used.sigma_t,
    }
    return {
        "device": chosen.name,
        "device_reason": reason,
        **facts,
        "unused": [name for name in facts["variant"] if name not in facts["features"]],
        "skipped": [name for name in FEATURES if name not in facts["variant"]],
        "counts": {name: 0 if rows is None else len(rows) for name, rows in counts.items()},
        "materials": {name: kinds.count(k) for k, name in enumerate(MATERIAL_KINDS) if k in kinds},
        "width": used.film.width,
        "height": used.film.height,
        "scene_sha256": used.sha256,
        "cameras": len(used.cameras),
        "notes": list(used.notes),
        "warnings": limits.warnings(used, origin),
    }


def as_text(report: dict[str, Any]) -> str:
    """The report for people."""
    counts = ", ".join(f"{n:,} {name}" for name, n in report["counts"].items() if n)
    lines = [
        f"device      {report['device']} ({report['device_reason']})",
        f"scene       {report['width']} x {report['height']}; {counts or 'nothing'}",
        "materials   " + (", ".join(f"{n} {k}" for k, n in report["materials"].items()) or "none"),
        f"primitives  {primitives_text(report['primitives'])}",
        f"tree        {tree_text(report['tree'])}",
        f"memory      {report['memory']:,} bytes, and {report['path_bytes']} bytes per path",
        *([f"cameras     {report['cameras']}"] if report["cameras"] > 1 else []),
        *(f"note        {text}" for text in report["notes"]),
        *(f"warning     {text}" for text in report["warnings"]),
        "",
        f"{'feature':<16} {'needed':<7} {'compiled in':<12} meaning",
    ]
    for name in (*FEATURES, *(n for n in report["variant"] if n not in FEATURES)):
        needed = "yes" if name in report["features"] else "-"
        compiled = "yes" if name in report["variant"] else "skipped"
        lines.append(f"{name:<16} {needed:<7} {compiled:<12} {FEATURES.get(name, '')}".rstrip())
    return "\n".join(lines)


def primitives_text(primitives: dict[str, int]) -> str:
    """Counts by kind; triangles without area that were dropped come last."""
    parts = [f"{n:,} {name}" for name, n in primitives.items() if n and name != "dropped"]
    dropped = primitives.get("dropped", 0)
    if dropped:
        parts.append(f"{dropped:,} degenerate triangles dropped")
    return ", ".join(parts) or "none"


def tree_text(tree: dict[str, Any]) -> str:
    """One line about the tree."""
    if not tree:
        return "none: the primitives are tested one by one"
    return (
        f"{tree['width']} wide, {tree['nodes']:,} nodes, {tree['references']:,} references, depth "
        f"{tree['depth']}, built by {tree['builder']} in {tree['seconds']:.2g} s"
    )
