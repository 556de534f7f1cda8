"""BSDFs of Mitsuba 0.x that have no counterpart today, by the nearest that there is.

- `phong`: `roughplastic` whose coat reflects at normal incidence what `specular_reflectance` says,
  and whose base then reflects `diffuse_reflectance`. Beckmann's slopes, alpha^2 = 2 / (4 n + 2), as
  a lobe of exponent n about the mirrored direction is one of 4 n about the mirrors' normals.
- `ward`: likewise; its alpha is Beckmann's, the root of alpha_u alpha_v.
- Either is `diffuse` if nothing mirrors, and `roughconductor` if there is no diffuse part.
- `coating` of `diffuse`: `plastic`, and `roughcoating`: `roughplastic`, of `bk7` if of no other
  index. Of another BSDF: that one. What lies below is darker by the coat's absorption at normal
  incidence, exp(-2 sigma_a thickness).
- `roughdiffuse`: `diffuse`. The distributions `phong` and `as` of rough surfaces: `beckmann`.

Each is a warning that names its line.
"""

from __future__ import annotations

import copy
import re
from collections.abc import Callable
from decimal import Decimal
from math import sqrt

from lxml import etree
from lxml.etree import _Element

from ..errors import SceneError
from . import spectra
from .node import _FLOAT

Warn = Callable[[str, str], None]
_DEEPEST = 8  # coats on each other; one that holds itself has no end
_MOST = 0.64  # of a coat's reflectance at normal incidence: an index of 9
_SCALABLE = ("bitmap", "checkerboard", "gridtexture", "wireframe", "mesh_attribute", "scale")
_TINTED = {
    "diffuse": ("reflectance", 0.5),
    "plastic": ("diffuse_reflectance", 0.5),
    "roughplastic": ("diffuse_reflectance", 0.5),
    "conductor": ("specular_reflectance", 1.0),
    "roughconductor": ("specular_reflectance", 1.0),
}


def approximate(
    element: _Element, where: str, root: _Element, warn: Warn, depth: int = _DEEPEST
) -> None:
    """Changes a bsdf to what stands for it, if it is one of these. root: of the file, where what it
    refers to is. warn: takes a text and its place. depth: of coats on it."""
    plugin = str(element.get("type"))
    if plugin == "roughdiffuse":
        if _named(element, "reflectance") is None:
            _set(element, "diffuse_reflectance", None, "reflectance")
        _keep(element, "reflectance")
        element.set("type", "diffuse")
        warn("bsdf roughdiffuse is rendered as diffuse", where)
    elif plugin in ("phong", "ward"):
        _glossy(element, plugin, where, root, warn)
    elif plugin in ("coating", "roughcoating"):
        if depth:  # else it is refused as an unknown bsdf
            _coating(element, plugin, where, root, warn, depth - 1)
    else:
        given = _named(element, "distribution")
        if given is not None and given.get("value") in ("phong", "as"):
            warn(f"bsdf {plugin}: slopes of {given.get('value')} are rendered as beckmann", where)
            given.set("value", "beckmann")


def _glossy(element: _Element, plugin: str, where: str, root: _Element, warn: Warn) -> None:
    base = _numbers(_named(element, "diffuse_reflectance"), 0.5)
    mirrors = _numbers(_named(element, "specular_reflectance"), 0.2)
    if plugin == "phong":
        exponent = (_numbers(_named(element, "exponent"), 30.0) or (30.0,))[0]
        alpha = sqrt(2 / (4 * max(exponent, 0.0) + 2))
    else:
        both = _numbers(_named(element, "alpha"), 0.1)
        u, v = (
            (_numbers(_named(element, f"alpha_{axis}"), (both or (0.1,))[0]) or (0.1,))[0]
            for axis in "uv"
        )
        alpha = sqrt(max(u * v, 0.0))
    if mirrors is not None and max(mirrors) <= 0:
        _keep(element, "diffuse_reflectance")
        _set(element, "diffuse_reflectance", base, "reflectance")
        element.set("type", "diffuse")
        return  # what it is
    told = ""
    if base is not None and max(base) <= 0:
        _keep(element, "specular_reflectance")
        _set(element, "specular_reflectance", mirrors)
        element.set("type", "roughconductor")
    else:
        _keep(element, "diffuse_reflectance", "specular_reflectance")
        normal = min(max(mirrors), _MOST) if mirrors else 0.2
        index = (1 + sqrt(normal)) / (1 - sqrt(normal))
        if mirrors:
            _set(element, "specular_reflectance", tuple(x / max(mirrors) for x in mirrors))
        if base:
            _set(element, "diffuse_reflectance", tuple(min(x / (1 - normal), 1.0) for x in base))
        elif (held := _named(element, "diffuse_reflectance")) is not None:
            told = _brighter(held, 1 / (1 - normal), root)
        element.set("type", "roughplastic")
        _add(element, "float", "int_ior", repr(index))
        _add(element, "float", "ext_ior", "1")
    _add(element, "float", "alpha", repr(alpha))
    _add(element, "string", "distribution", "beckmann")
    warn(f"bsdf {plugin} is rendered as {element.get('type')} of alpha {alpha:.4g}{told}", where)


def _brighter(given: _Element, factor: float, root: _Element) -> str:
    """Multiplies a texture or a spectrum, 1 at most; returns what to say if it cannot."""
    name, parent = str(given.get("name")), given.getparent()
    held = _resolved(given, root, "texture") if given.tag in ("texture", "ref") else None
    pairs = [w.split(":") for w in re.findall(r"[^\s,]+", str(given.get("value")))]
    known = ("color0", "color1", "scale")  # None of what a parameter of the file gives
    if held is not None and any(
        _numbers(e, 1.0) is None for e in held.iter() if e.get("name") in known
    ):
        held = None
    if held is not None and held.get("type") not in _SCALABLE:
        held = None
    if held is not None and parent is not None:
        made = etree.SubElement(parent, "texture", type="scale", name=name)
        made.sourceline = given.sourceline
        _add(made, "float", "gain", repr(factor))
        parent.replace(given, made)
        made.append(given)
        given.attrib.pop("name")
    elif all(len(pair) == 2 and all(map(_FLOAT.fullmatch, pair)) for pair in pairs):
        shown = (f"{w}:{min(float(v) * factor, 1.0)!r}" for w, v in pairs)
        given.set("value", " ".join(shown))
    else:
        return f", its base {1 / factor:.3g} times as bright"
    return ""


def _coating(
    element: _Element, plugin: str, where: str, root: _Element, warn: Warn, depth: int
) -> None:
    held = [_resolved(child, root) for child in element if child.tag in ("bsdf", "ref")]
    below = held[0] if len(held) == 1 else None
    if below is None:
        return  # refused as an unknown bsdf
    base = below
    sides = below.get("type") == "twosided"
    if sides:
        inner = [_resolved(child, root) for child in below if child.tag in ("bsdf", "ref")]
        if len(inner) != 1 or inner[0] is None:
            return
        base = inner[0]
    approximate(base, where, root, warn, depth)
    new, told = str(base.get("type")), _tint(element, base)
    if new == "diffuse":
        new = "roughplastic" if plugin == "roughcoating" else "plastic"
        names = ["int_ior", "ext_ior", "specular_reflectance"]
        names += ["alpha", "distribution"] if plugin == "roughcoating" else []
        _keep(element, *names)
        if _named(element, "int_ior") is None:
            _add(element, "string", "int_ior", "bk7")
        own = _named(base, "reflectance")
        if own is not None:
            own.set("name", "diffuse_reflectance")
            element.append(own)
        for child in list(element):
            if child.tag == "bsdf" or (child.tag == "ref" and not child.get("name")):
                element.remove(child)
        element.set("type", new)
        approximate(element, where, root, warn)  # its distribution
        told = f"as {new}{told}"
    else:
        element[:] = list(base)
        told = f"without its coat, as {new}{told}"
    element.set("type", new)
    parent = element.getparent()
    if sides and (parent is None or parent.get("type") != "twosided"):
        one = etree.Element("bsdf", {"type": new})
        one.sourceline = element.sourceline
        one[:] = list(element)
        element.set("type", "twosided")
        element.append(one)
    warn(f"bsdf {plugin} is rendered {told}", where)


def _resolved(child: _Element, root: _Element, tag: str = "bsdf") -> _Element | None:
    """A copy, without ids, of an object or of what a reference to one means; None if it is not in
    the file."""
    found: _Element | None = child
    if child.tag == "ref":
        found = next((e for e in root.iter(tag) if e.get("id") == child.get("id")), None)
    if found is None:
        return None
    result = copy.deepcopy(found)
    result.tail = None
    for element in result.iter():
        if isinstance(element.tag, str) and element.tag != "ref":
            element.attrib.pop("id", "")
    return result


def _tint(coat: _Element, base: _Element) -> str:
    """Darkens a bsdf by the absorption of the coat on it; returns what to say."""
    sigma = _numbers(_named(coat, "sigma_a"), 0.0)
    thickness = _numbers(_named(coat, "thickness"), 1.0)
    if sigma == (0.0,) * 3:
        return ""
    name, default = _TINTED.get(str(base.get("type")), ("", 0.0))
    colour = _numbers(_named(base, name), default) if name else None
    if sigma is None or thickness is None or colour is None:
        return " and without its absorption"
    path = [2 * s * t for s, t in zip(sigma, thickness, strict=True)]
    factors = [float((-Decimal(max(x, 0.0))).exp()) for x in path]
    _set(base, name, tuple(c * f for c, f in zip(colour, factors, strict=True)))
    return ", with its absorption at normal incidence"


def _named(element: _Element, name: str) -> _Element | None:
    found = [c for c in element if isinstance(c.tag, str) and c.get("name") == name]
    return found[0] if found else None


def _numbers(element: _Element | None, default: float) -> tuple[float, ...] | None:
    """Three numbers of a parameter; None if it gives others, as a texture does."""
    if element is None:
        return (default,) * 3
    text = str(element.get("value") or "")
    if element.tag == "srgb" or (element.tag == "rgb" and "#" in text):
        try:
            return spectra.srgb(text, "", "")
        except SceneError:
            return None
    words = re.findall(r"[^\s,]+", text)
    plain = element.tag in ("rgb", "spectrum", "float", "integer")
    if not plain or len(words) not in (1, 3) or not all(map(_FLOAT.fullmatch, words)):
        return None
    return tuple(float(word) for word in words) * (3 // len(words))


def _keep(element: _Element, *names: str) -> None:
    """Removes the parameters that are not among these."""
    for child in list(element):
        if isinstance(child.tag, str) and child.get("name") and child.get("name") not in names:
            element.remove(child)


def _set(element: _Element, name: str, colour: tuple[float, ...] | None, new: str = "") -> None:
    """Gives a parameter these numbers; None leaves what it is. new: its new name."""
    old = _named(element, name)
    if colour is None:
        if old is not None and new:
            old.set("name", new)
        return
    if old is not None:
        element.remove(old)
    _add(element, "rgb", new or name, " ".join(map(repr, colour)))


def _transform(element: _Element, name: str) -> _Element:
    """The transform of this name, or a new one."""
    found = _named(element, name)
    if found is None:
        found = etree.SubElement(element, "transform", name=name)
        found.sourceline = element.sourceline
    return found


def _add(element: _Element, tag: str, name: str, value: str) -> None:
    made = etree.SubElement(element, tag, name=name, value=value)
    made.sourceline = element.sourceline
