"""What integrators ask for: the depths of paths, and what a scene must not have."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

from ..columns import MATERIAL_KINDS
from ..errors import SceneError
from .node import Node
from .plugins import PLUGINS
from .report import Report

Check = Callable[[Node], tuple[dict[str, list[Node]], dict[str, Any]]]
#: Kinds of material of which no light sample finds the light.
_SINGULAR = {"conductor", "dielectric", "plastic", "thindielectric", "null", "mask"}
_PASSES = {"thindielectric", "null", "mask"}
#: Integrators of Mitsuba that go through lamps that they hide, and of these those that hide them
#: behind masks, null and thin glass too, as all do here.
_GOES_THROUGH = {"path", "direct", "prb", "prb_basic"}
_GOES_ON = {"volpath", "volpathmis", "prbvolpath"}
#: Feature images by their names in `aov`.
_AOVS = {
    "depth": "depth", "position": "position", "uv": "uv", "geo_normal": "geo_normal",
    "sh_normal": "normal", "albedo": "albedo", "prim_index": "primitive", "shape_index": "object",
}  # fmt: skip
#: What integrators render otherwise than Mitsuba's, where there are materials of these kinds.
_OTHER_IN_MITSUBA = {
    "ptracer": (_SINGULAR, "what mirrors and glass show is rendered; Mitsuba's leaves it out"),
    "direct": (_PASSES, "what is seen through masks, null and thin glass is lit, not in Mitsuba"),
}


def depths(
    node: Node, check: Check, report: Report, around: tuple[Node, ...] = ()
) -> dict[str, int]:
    """max_depth, rr_depth and hide_emitters; check: gives a node's objects and parameters; around:
    those that hold the node."""
    if any(node is other for other in around):
        raise SceneError(f"{node} holds itself", node.where)
    parts, values = check(node)
    inner = parts.get("integrator")
    if inner:
        for other in inner[1:]:
            report.note(f"{node}: only its first integrator is rendered", other.where)
        report.note(f"{node} renders {inner[0]}: {PLUGINS[node.plugin].doc}", node.where)
        if node.plugin == "aov":
            _add_features(node, values["aovs"], report)
        if values["hide_emitters"]:
            report.note(
                f'{node}: "hide_emitters" counts in {inner[0]} alone',
                node.values["hide_emitters"].where,
            )
        return depths(inner[0], check, report, (*around, node))
    if "integrator" in parts:
        _add_features(node, values.get("aovs", "depth"), report)
        what = "feature images" if node.plugin == "aov" else 'the feature image "depth"'
        report.warn(
            f"{node}: what it shows is {what}; the picture is the scene's light, as by path",
            node.where,
        )
        plain = Node("path", node.where, "integrator")
        if "hide_emitters" in node.values:
            plain.values["hide_emitters"] = node.values["hide_emitters"]
        return depths(plain, check, report, (*around, node))
    if node.plugin == "direct":
        shorthand = "shading_samples" in node.values
        if shorthand and {"emitter_samples", "bsdf_samples"} & set(node.values):
            raise SceneError(
                f"{node}: both shading_samples and one of emitter_samples and bsdf_samples given",
                node.where,
            )
        if not values["emitter_samples"] + values["bsdf_samples"]:
            raise SceneError(f"{node}: emitter_samples and bsdf_samples are 0", node.where)
    depth = 1 if node.plugin == "emission_reparam" else 2
    default = {"max_depth": depth, "rr_depth": PLUGINS["path"].params["rr_depth"].default}
    given = {name: values.get(name, default[name]) for name in default}
    return given | {"hide_emitters": values["hide_emitters"]}


def _add_features(node: Node, aovs: str, report: Report) -> None:
    """Takes the feature images that an integrator asks for, and notes what is none."""
    kinds = [one.rpartition(":")[2].strip() for one in aovs.split(",") if one.strip()]
    found = [_AOVS[kind] for kind in kinds if kind in _AOVS]
    report.features = tuple(dict.fromkeys((*report.features, *found)))
    others = [kind for kind in kinds if kind not in _AOVS]
    if others:
        where = node.values["aovs"].where
        report.note(f"{node}: no image of {', '.join(dict.fromkeys(others))} is written", where)


def check_scene(
    node: Node,
    check: Check,
    report: Report,
    seen: bool,
    arrays: dict[str, Any],
    beams: Node | None = None,
    stated: bool = True,
) -> None:
    """Raises SceneError for what an integrator asks for and a scene with these arrays does not
    allow; seen: something shines that a camera can see; beams: a directionalarea; stated: the
    scene names the integrator."""
    parts, values = check(node)
    for inner in parts.get("integrator", [])[:1]:
        check_scene(inner, check, report, seen, arrays, beams, stated)
        return
    lamps = arrays["light_kind"] is not None
    if beams is not None:
        if node.plugin == "ptracer":
            raise SceneError(f"{beams}: its light by ptracer is not supported", beams.where)
        report.note(f"{beams}: dark, as only ptracer finds its light in Mitsuba", beams.where)
    rows = [MATERIAL_KINDS[kind] for kind in arrays["material_kind"] or ()]
    within = {arrays["blend_material"][k] for k, kind in enumerate(rows) if kind == "hair"}
    kinds = {kind for k, kind in enumerate(rows) if k not in within}
    kinds |= {"mask" for opacity in arrays["opacity"] or () if opacity < 1}
    for name, wrong, what in (
        ("bsdf_samples", bool(kinds & _SINGULAR), "a mirror, glass or a mask"),
        ("emitter_samples", lamps, "a point, spot or parallel lamp"),
    ):
        if wrong and values.get(name) == 0:
            raise SceneError(
                f'{node}: "{name}" = 0 leaves out the light of {what}, which the scene has; '
                "that is not supported",
                node.values[name].where,
            )
    if seen and values["hide_emitters"] and node.plugin not in _GOES_ON:
        where = node.values["hide_emitters"].where
        if node.plugin not in _GOES_THROUGH and arrays["emissions"] is not None:
            report.warn(
                f"{node}: the camera sees what is behind hidden lamps; in Mitsuba they are dark or "
                "shine",
                where,
            )
        elif node.plugin in _GOES_THROUGH and kinds & _PASSES:
            report.warn(
                f"{node}: what is seen through masks, null and thin glass hides its lamps and sky "
                "too, not in Mitsuba",
                where,
            )
    if node.plugin not in (*_GOES_ON, "ptracer") and lamps and kinds & _PASSES:
        report.warn(
            f"{node}: points, spots, projectors and parallel light shine through masks, null and "
            "thin glass, as by volpath; not by it in Mitsuba",
            node.where,
        )
    if stated and node.plugin not in _GOES_ON and arrays["sigma_t"] is not None:
        report.warn(f"{node}: media count, as by volpath; not by it in Mitsuba", node.where)
    other, text = _OTHER_IN_MITSUBA.get(node.plugin, (set(), ""))
    if kinds & other:
        report.warn(f"{node}: {text}", node.where)


def check_medium(node: Node, coloured: bool, report: Report, lamps: bool) -> None:
    """Warns of what a medium says about sampling by which Mitsuba's picture is another; coloured:
    its extinction; lamps: some light of the scene comes from a point or is parallel."""
    for name, matters, text in (
        ("sample_emitters", lamps, "leaves the light of points and parallel light in it out"),
        ("has_spectral_extinction", coloured, "takes a coloured extinction for one that is grey"),
    ):
        value = node.values.get(name)
        if matters and value is not None and value.value is False:
            told = f'{node}: "{name}" = false: Mitsuba {text}; here it is right'
            report.warn(told, value.where)
