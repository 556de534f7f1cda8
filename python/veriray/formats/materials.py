"""From bsdf and medium objects to rows of a scene's tables."""

from __future__ import annotations

from typing import Any

import numpy as np

from ..columns import MATERIAL_KINDS
from ..errors import SceneError
from .node import Node, shorten

Row = dict[str, Any]
_COLUMNS: Row = {
    "material_kind": 0,
    "reflectance": (0.0,) * 3,
    "specular_reflectance": (1.0,) * 3,
    "specular_transmittance": (1.0,) * 3,
    "eta": (1.0,) * 3,
    "k": (0.0,) * 3,
    "opacity": 1.0,
    "two_sided": False,
    "nonlinear": False,
}
MATERIAL_COLUMNS = tuple(_COLUMNS)
BLACK: Row = _COLUMNS


def material(node: Node, values: dict[str, Any]) -> Row:
    """The row of a bsdf that holds no other; values: its checked parameters."""
    row = {**_COLUMNS, "material_kind": MATERIAL_KINDS.index(node.plugin)}
    for name in ("reflectance", "specular_reflectance", "specular_transmittance", "nonlinear"):
        row[name] = values.get(name, row[name])
    if node.plugin == "plastic":
        row["reflectance"] = values["diffuse_reflectance"]
    if "int_ior" in values:
        row["eta"] = (values["int_ior"] / values["ext_ior"],) * 3
    if node.plugin == "conductor":
        row["eta"], row["k"] = _conductor(node, values)
    return row


def _conductor(node: Node, values: dict[str, Any]) -> tuple[Any, Any]:
    name, eta, k = values["material"], values["eta"], values["k"]
    if name is not None and name.lower() != "none":
        raise SceneError(
            f'{node}: "material" = {shorten(name)}: metals by name are not supported; give eta and '
            "k (rgb)",
            node.values["material"].where,
        )
    if (eta is None) != (k is None) or (name is not None and eta is not None):
        given = [key for key in ("material", "eta", "k") if values[key] is not None]
        raise SceneError(
            f"{node}: {' and '.join(given)} given; expected both eta and k, or none of them",
            node.where,
        )
    if eta is None:
        return (0.0,) * 3, (1.0,) * 3
    outside = values["ext_eta"]
    return tuple(x / outside for x in eta), tuple(x / outside for x in k)


def medium(node: Node, values: dict[str, Any], phase: dict[str, Any]) -> Row:
    """The row of a homogeneous medium; phase: the checked parameters of its phase function."""
    total, albedo = (values[name] for name in ("sigma_t", "albedo"))
    scattering, absorption = (values[name] for name in ("sigma_s", "sigma_a"))
    if scattering is not None or absorption is not None:
        given = [n for n in ("sigma_t", "albedo", "sigma_s", "sigma_a") if values[n] is not None]
        if given != ["sigma_s", "sigma_a"]:
            raise SceneError(
                f"{node}: {', '.join(given)} given; expected sigma_t and albedo, or sigma_s and "
                "sigma_a",
                node.where,
            )
        total = tuple(s + a for s, a in zip(scattering, absorption, strict=True))
        albedo = tuple(s / t if t else 0.0 for s, t in zip(scattering, total, strict=True))
    total = tuple(x * values["scale"] for x in total or (1.0,) * 3)
    if max(total) > float(np.finfo(np.float32).max):
        raise SceneError(f"{node}: sigma_t = {total} exceeds the float32 range", node.where)
    return {"sigma_t": total, "albedo": albedo or (0.75,) * 3, "phase_g": phase.get("g", 0.0)}
