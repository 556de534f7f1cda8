"""From bsdf and medium objects to rows of a scene's tables."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass, replace
from math import sqrt
from typing import Any

import numpy as np

from ..columns import (
    DISTRIBUTIONS,
    INDICES,
    MATERIAL_KINDS,
    OPEN_KINDS,
    SHADOWINGS,
    TEXTURABLE,
    WHOLE_KINDS,
    blank_row,
)
from ..errors import SceneError
from . import metals
from .node import Node
from .plugins import PLUGINS
from .report import Report

Row = dict[str, Any]


@dataclass
class _Part:
    """A bsdf of a blend: its node, its row and its share."""

    node: Node
    row: Row
    share: float


#: Keys of a row that say whose numbers it holds: its bsdf; the masks around it; the blend whose
#: weight it has, and whether it holds 1 minus that; by part, a name from an object around it for
#: what has no id; the ids of these objects; the ids of what was merged into it, and with ".opacity"
#: or ".weight" the names of factors of its numbers; the parts whose numbers are none of the file's.
_WHOSE = ("bsdf", "masks", "weighs", "names", "holders", "merged", "products")
BLACK: Row = blank_row("materials")
_ALPHAS = ("alpha", "alpha_u", "alpha_v")
_LEAST_ALPHA = 1e-4  # smaller ones are taken for it, as by Mitsuba


def filled(node: Node, values: dict[str, Any]) -> Row:
    """The columns that an object's checked parameters fill by themselves."""
    params = PLUGINS[node.plugin].params.items()
    return {param.column: values[name] for name, param in params if param.column}


#: What stands for plugins that differ from others by polarisation alone.
_UNPOLARISED = {
    "pplastic": "roughplastic",
    **dict.fromkeys(("polarizer", "circular", "retarder"), "thindielectric"),
}


def material(node: Node, values: dict[str, Any], report: Report) -> Row:
    """The row of a bsdf that holds no other; values: its checked parameters."""
    kind = _UNPOLARISED.get(node.plugin, node.plugin)
    if kind != node.plugin:
        report.note(f"{node}: polarisation is not rendered", node.where)
    row = {**BLACK, **filled(node, values), "material_kind": MATERIAL_KINDS.index(kind)}
    if kind == "thindielectric" != node.plugin:  # of index 1, so that it reflects nothing
        share = 1.0 if node.plugin == "retarder" else 0.5
        through = (share * x for x in values["transmittance"])
        row |= {"eta": (1.0,) * 3, "specular_transmittance": tuple(through)}
    if "int_ior" in values:
        row["eta"] = (values["int_ior"] / values["ext_ior"],) * 3
    if node.plugin == "principled":
        row |= _principled(node, values)
    elif node.plugin == "principledthin":
        row["eta"] = (values["eta"],) * 3
    if "material" in values:
        row["eta"], row["k"] = _conductor(node, values)
    if "distribution" in values:
        if "int_ior" in values and values["int_ior"] == values["ext_ior"]:
            raise SceneError(
                f"{node}: int_ior and ext_ior are equal; a rough interface of equal indices has no "
                "small mirrors",
                node.where,
            )
        row["distribution"] = DISTRIBUTIONS.index(values["distribution"])
        row["shadowing"] = SHADOWINGS.index(values.get("shadowing", SHADOWINGS[0]))
        row["alpha_u"], row["alpha_v"] = _roughness(node, values)
    if values.get("energy_compensation"):
        _one_alpha(node, row)
        row["material_kind"] = MATERIAL_KINDS.index(WHOLE_KINDS[node.plugin])
    if node.plugin == "pplastic":
        row["k"] = (1.0,) * 3
        if not any(values["specular_reflectance"]):
            row["material_kind"] = MATERIAL_KINDS.index("plastic")
    return row


def objects(row: Row) -> dict[str, tuple[tuple[Node, ...], str]]:
    """The objects whose numbers a row holds by the part that they are of it, and how (`named.Use`);
    of several masks, whose numbers multiply, all."""
    found: dict[str, tuple[tuple[Node, ...], str]] = {}
    if "bsdf" in row:
        found["bsdf"] = (row["bsdf"],), ""
    if row.get("masks"):
        found["opacity"] = row["masks"], ""
    if "weighs" in row:
        node, rest = row["weighs"]
        found["weight"] = (node,), "rest" if rest else ""
    return found


def held_by(row: Row, name: str) -> Row:
    """A row with the id of an object around its bsdf, which names what has no id of its own."""
    names = dict(row.get("names", {}))
    for part, (nodes, _) in objects(row).items():
        if not nodes[-1].id:
            names.setdefault(part, name)
    return {**row, "names": names, "holders": (*row.get("holders", ()), name)}


def two_sided(row: Row) -> Row:
    """A bsdf's row, and that of a blend's other, for a bsdf that reflects on both sides."""
    row = {**row, "two_sided": True, "relief_mirrored": row["relief_texture"] >= 0}
    if "other" in row:
        node, other = row["other"]
        row["other"] = replace(node), two_sided(other)
    return row


def front(row: Row) -> Row:
    """The row of what a bsdf shows from its front, which is what a twosided shows on a side."""
    if not row.get("blend_sides"):
        return row
    row = {name: value for name, value in row.items() if name != "blend_sides"}
    node, other = row.pop("other")
    return {**row, "other": (node, front(other))} if other.get("blend_sides") else row


def of_sides(front: Row, back: tuple[Node, Row]) -> Row:
    """The row of a twosided with two bsdfs: a blend by sides, each of which may be a blend."""

    def before(row: Row) -> Row:
        node, other = row.get("other", back)
        other = before(other) if "other" in row else other
        return {**row, "blend_sides": True, "other": (replace(node), other)}

    return two_sided(before(front))


def changed(row: Row, columns: Row) -> Row:
    """A bsdf's row with other columns, which a blend's other row gets too."""
    row = {**row, **columns}
    if "other" in row:
        node, other = row["other"]
        row["other"] = replace(node), changed(other, columns)
    return row


def masked(row: Row, columns: Row, mask: Node) -> Row:
    """A bsdf's row with the columns of a mask around it; numbers of several masks multiply."""
    result = {**row, **columns, "opacity": columns["opacity"] * row["opacity"]}
    inside = row.get("masks", ())
    result["masks"] = (*inside, mask)
    if inside:
        names = {one.id or row.get("names", {}).get("opacity") for one in result["masks"]}
        result["merged"] = {*row.get("merged", ()), *(f"{name}.opacity" for name in names if name)}
        result["products"] = {*row.get("products", ()), "opacity"}
    if "other" in row:
        node, other = row["other"]
        result["other"] = replace(node), masked(other, columns, mask)
    return result


def blend(
    node: Node, values: dict[str, Any], nodes: list[Node], rows: list[Row], given: Row
) -> Row:
    """The row of a blendbsdf, whose "other" is the node and row of its second bsdf, which may be a
    blend itself; given: the columns of its textures, which give 1 less the weight if the first
    alone is a blend."""
    weight = values["weight"]
    if weight is None:
        if not any(item.name == "weight" for item in node.children):
            raise SceneError(f'{node}: "weight" (number or texture) is missing', node.where)
        weight = 0.0
    weight = min(max(weight, 0.0), 1.0)  # as Mitsuba
    inside = [one for row in rows for one in both(row)]
    textured = any(one.get("blend_weight_texture", -1) >= 0 for one in (*inside, given))
    sides = any(one.get("blend_sides") for one in inside)
    if len(inside) > 2 and not textured and not sides:
        shares = (1 - weight, weight)
        parts = [_parts(*one) for one in zip(nodes, rows, shares, strict=True)]
        return _of_all([part for of_one in parts for part in of_one])
    first, second = zip(nodes, rows, strict=True)
    swapped = "other" in first[1]
    if swapped:  # then the second comes first
        if "other" in second[1]:
            text = "holds two blends; allowed: one of two, or numbers are all weights"
            raise SceneError(f"{node} {text}", node.where)
        first, second, weight = second, first, 1 - weight
    other = replace(second[0]), second[1]
    weighs = node, swapped
    return {**first[1], "blend_weight": weight, "other": other, "weighs": weighs, **given}


#: Columns by which all that a material of a kind reflects and lets through grows.
_GROWS = {
    MATERIAL_KINDS.index(kind): columns
    for columns, kinds in {
        ("reflectance",): ("diffuse",),
        ("specular_reflectance",): ("conductor", "roughconductor"),
        ("specular_reflectance", "specular_transmittance"): (
            "dielectric", "thindielectric", "roughdielectric", "roughdielectric_whole",
        ),
    }.items()
    for kind in kinds
}  # fmt: skip
_DIFFUSE = MATERIAL_KINDS.index("diffuse")
#: Kinds with a direction along the surface, whatever their numbers are.
_DIRECTED = [
    i for i, name in enumerate(MATERIAL_KINDS) if name.startswith(("hair", "principled"))
]  # fmt: skip


def _parts(node: Node, row: Row, share: float) -> list[_Part]:
    """A bsdf's row with its share, or those of all that a blend shows."""
    if "other" not in row:
        return [_Part(replace(node), row, share)]
    first = {**row, "blend_weight": BLACK["blend_weight"]}
    weighs = first.pop("weighs", None)
    second, other = first.pop("other")
    weight = row["blend_weight"]
    parts = [
        _Part(replace(node), first, share * (1 - weight)),
        *_parts(second, other, share * weight),
    ]
    name = weighs and (weighs[0].id or row.get("names", {}).get("weight"))
    if not name:
        return parts
    return [_with_merged(part, {f"{name}.weight"}) for part in parts]


def _with_merged(part: _Part, names: Iterable[str]) -> _Part:
    merged = {*part.row.get("merged", ()), *names}
    return replace(part, row={**part.row, "merged": merged} if merged else part.row)


def _of_all(parts: list[_Part]) -> Row:
    """The row of a blend of more than two bsdfs; some are put together where one can be both."""
    parts = [part for part in parts if part.share > 0]
    pairs = [(i, j) for j in range(len(parts)) for i in range(j)]
    while len(parts) > 2:
        found = ((i, j, _together(parts[i], parts[j])) for i, j in pairs if j < len(parts))
        i, j, one = next(((i, j, one) for i, j, one in found if one), (0, 0, None))
        if one is None:
            break
        parts = [one if k == i else part for k, part in enumerate(parts) if k != j]
    last = parts[-1]
    row, share = last.row, last.share
    for part in reversed(parts[:-1]):
        whole = part.share + share
        row = {**part.row, "blend_weight": share / whole, "other": (last.node, row)}
        last, share = part, whole
    return row


def _together(one: _Part, other: _Part) -> _Part | None:
    """A bsdf that looks as two by their shares; None if there is none."""
    share = one.share + other.share
    for part in (one, other):
        row = part.row
        textured = any(row.get(f"{name}_texture", -1) >= 0 for name in TEXTURABLE)
        if textured or row.get("attributes") or row.get("relief_texture", -1) >= 0:
            return None
        if row["opacity"] < 1:
            return None
    a, b = ({k: x for k, x in part.row.items() if k not in _WHOSE} for part in (one, other))
    merged: set[str] = set()
    for row in (one.row, other.row):
        merged |= {node.id for nodes, _ in objects(row).values() for node in nodes if node.id}
        merged |= {*row.get("holders", ()), *row.get("merged", ())}
    whose = {"merged": merged, "products": {"bsdf"}}
    if {**a, "reflectance": ()} == {**b, "reflectance": ()}:
        if a["reflectance"] == b["reflectance"]:
            if objects(one.row) == objects(other.row):
                return _with_merged(replace(one, share=share), other.row.get("merged", ()))
            return _Part(one.node, a | whose, share)
        if a["material_kind"] == _DIFFUSE:
            pairs = zip(a["reflectance"], b["reflectance"], strict=True)
            mean = tuple((one.share * x + other.share * y) / share for x, y in pairs)
            return _Part(one.node, {**a, "reflectance": mean, **whose}, share)
    for lit, row, dark in ((one, a, b), (other, b, a)):
        if dark["material_kind"] == _DIFFUSE and not any(dark["reflectance"]):
            columns = _GROWS.get(row["material_kind"], ())
            less = {name: tuple(lit.share * x / share for x in row[name]) for name in columns}
            if less:
                return _Part(lit.node, {**row, **less, **whose}, share)
    return None


def both(row: Row) -> list[Row]:
    """The rows of a bsdf: two or more of a blend."""
    return [row, *both(row["other"][1])] if "other" in row else [row]


def _principled(node: Node, values: dict[str, Any]) -> Row:
    """The index and the kind: one that lets light through is another, of an index other than 1."""
    eta, specular = values["eta"], values["specular"]
    open_ = values["spec_trans"] or any(item.name == "spec_trans" for item in node.children)
    if eta is not None and specular is not None:
        raise SceneError(
            f"{node}: both eta and specular given, expected one of them",
            node.values["specular"].where,
        )
    if eta is None:
        specular = 0.5 if specular is None else specular
        if open_ and not specular:
            specular = 1e-3  # as Mitsuba
        eta = 2 / (1 - sqrt(0.08 * specular)) - 1
    elif open_ and eta == 1:
        eta = 1.001  # as Mitsuba
    row: Row = {"eta": (eta,) * 3}
    if open_:
        row["material_kind"] = MATERIAL_KINDS.index(OPEN_KINDS[node.plugin])
    return row


def _roughness(node: Node, values: dict[str, Any]) -> tuple[float, float]:
    textures = {item.name for item in node.children}
    both, u, v = (values[name] for name in _ALPHAS)
    given = [name for name in _ALPHAS if values[name] is not None or name in textures]
    if given not in ([], ["alpha"], ["alpha_u", "alpha_v"]):
        raise SceneError(
            f"{node}: {' and '.join(given)} given; expected alpha, or both alpha_u and alpha_v",
            node.where,
        )
    if node.plugin in ("roughplastic", "pplastic") and u != v:
        raise SceneError(
            f"{node}: alpha_u = {u:g} and alpha_v = {v:g}, but its coat has one alpha; give alpha",
            node.values["alpha_u"].where,
        )
    u, v = (both if x is None else x for x in (u, v))
    u, v = (0.1 if x is None else max(x, _LEAST_ALPHA) for x in (u, v))
    return u, v


def _one_alpha(node: Node, row: Row) -> None:
    """What energy compensation has tables for."""
    where = node.values["energy_compensation"].where
    u, v = row["alpha_u"], row["alpha_v"]
    if u != v:
        raise SceneError(
            f"{node}: energy_compensation = true with alpha_u = {u:g} and alpha_v = {v:g}; "
            "allowed: with one alpha",
            where,
        )
    for item in node.children:
        if item.name in (*_ALPHAS, *INDICES):
            raise SceneError(
                f"{node}: energy_compensation = true with a texture as {item.name}; allowed: with "
                "a number",
                where,
            )


def textured_alpha(columns: Row, rows: Row) -> Row:
    """The column of roughness that follows from the others; columns, rows: of the textures given.
    One texture, or two alike, stand for both directions."""
    alike = "alpha" in rows or ("alpha_u" in rows and rows["alpha_u"] == rows.get("alpha_v"))
    return {"alpha_v_texture": columns["alpha_u_texture"]} if alike else {}


def reads_uv(row: Row) -> bool:
    """Whether texture coordinates matter on surfaces of a material: it has textures, or depends on
    the direction in which u grows, or would if its `anisotropic` changed."""
    if row["material_kind"] in _DIRECTED:
        return True
    names = (*TEXTURABLE, "relief")
    textures = [row.get(f"{name}_texture", -1) for name in names]
    return bool(max(textures) >= 0 or row["alpha_u"] != row["alpha_v"])


def _conductor(node: Node, values: dict[str, Any]) -> tuple[Any, Any]:
    name, eta, k = values["material"], values["eta"], values["k"]
    textures = [item for item in node.children if item.name in INDICES]
    for item in textures:  # its texture's numbers take its place
        if values["ext_eta"] != 1:
            raise SceneError(f"{node}: ext_eta given, and a texture as {item.name}", item.where)
        eta, k = ((1.0,) * 3 if item.name == one else x for one, x in (("eta", eta), ("k", k)))
    if name is not None and (eta is not None or k is not None):
        given = [key for key in ("material", "eta", "k") if values[key] is not None]
        given += [item.name for item in textures]
        raise SceneError(
            f"{node}: {' and '.join(given)} given; expected either material, or eta and k",
            node.where,
        )
    if eta is not None or k is not None:  # one alone: the other as in Mitsuba
        eta = (0.0,) * 3 if eta is None else eta
        k = (1.0,) * 3 if k is None else k
    else:
        where = node.values["material"].where if name else node.where
        eta, k = metals.metal(name or "none", f'{node}: "material"', where)
    outside = values["ext_eta"]
    return tuple(x / outside for x in eta), tuple(x / outside for x in k)


def medium(node: Node, values: dict[str, Any], phase: Row) -> Row:
    """The row of a medium; phase: what its phase function fills."""
    total, albedo = (values[name] for name in ("sigma_t", "albedo"))
    scattering: Any = values.get("sigma_s")
    absorption: Any = values.get("sigma_a")
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
    return {"sigma_t": total, "albedo": albedo or (0.75,) * 3, **phase}
