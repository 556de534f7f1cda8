"""Media, and what scatters below surfaces, of Mitsuba 0.x: see `legacy`."""

from __future__ import annotations

import re
from decimal import Decimal
from math import inf, sqrt
from typing import TYPE_CHECKING

from lxml import etree
from lxml.etree import _Element

from .approximate import _add, _named, _numbers, _set, _transform
from .node import _FLOAT
from .plugins import IORS

if TYPE_CHECKING:
    from .upgrade import Notes

_COEFFICIENTS = ("sigma_s", "sigma_a", "sigma_t", "albedo")
#: Reduced scattering and absorption of red, green and blue light in 1/mm: Jensen, Marschner, Levoy
#: and Hanrahan, "A practical model for subsurface light transport", 2001, figure 5. Mitsuba 0.6 has
#: a tenth of the red absorption of chicken1 and chicken2.
MATERIALS = {
    "apple": ((2.29, 2.39, 1.97), (0.0030, 0.0034, 0.046)),
    "chicken1": ((0.15, 0.21, 0.38), (0.015, 0.077, 0.19)),
    "chicken2": ((0.19, 0.25, 0.32), (0.018, 0.088, 0.20)),
    "cream": ((7.38, 5.47, 3.15), (0.0002, 0.0028, 0.0163)),
    "ketchup": ((0.18, 0.07, 0.03), (0.061, 0.97, 1.45)),
    "marble": ((2.19, 2.62, 3.00), (0.0021, 0.0041, 0.0071)),
    "potato": ((0.68, 0.70, 0.55), (0.0024, 0.0090, 0.12)),
    "skimmilk": ((0.70, 1.22, 1.90), (0.0014, 0.0025, 0.0142)),
    "skin1": ((0.74, 0.88, 1.01), (0.032, 0.17, 0.48)),
    "skin2": ((1.09, 1.59, 1.79), (0.013, 0.070, 0.145)),
    "spectralon": ((11.6, 20.4, 14.9), (0.0, 0.0, 0.0)),
    "wholemilk": ((2.55, 3.21, 3.77), (0.0011, 0.0024, 0.014)),
}


def border(element: _Element, where: str, notes: Notes) -> None:
    """A shape between media without a BSDF; one with a lamp, a sensor or a subsurface is black."""
    media = [c for c in element if c.get("name") in ("interior", "exterior")]
    other = [c for c in element if c.tag in ("bsdf", "emitter", "sensor", "subsurface", "ref")]
    if media and all(c in media for c in other):
        bsdf = etree.SubElement(element, "bsdf", type="null")
        bsdf.sourceline = element.sourceline
        notes.add("a shape with a medium and no bsdf is a null border", where)


def transmitter(element: _Element, where: str, notes: Notes) -> None:
    """A diffuse transmitter."""
    given = _named(element, "transmittance")
    if given is not None:
        given.set("name", "base_color")
    _sheet(element, 2.0)
    notes.add("bsdf difftrans is principledthin that lets everything through", where)


def hanrahan(element: _Element, where: str, notes: Notes) -> None:
    """A thin layer of Hanrahan and Krueger."""
    _preset(element, where, notes)
    albedo = _albedo(element)
    element[:] = []
    _sheet(element, 1.0)
    _set(element, "base_color", albedo or (0.5,) * 3)
    text = "bsdf hk is rendered as principledthin of its albedo, half of the light going through"
    notes.approximated.append((text, where))


def _sheet(element: _Element, through: float) -> None:
    element.set("type", "principledthin")
    _add(element, "float", "diff_trans", repr(through))
    _add(element, "float", "eta", "1")
    _add(element, "float", "roughness", "1")


def _preset(element: _Element, where: str, notes: Notes) -> str:
    """The name of the material, or skin1; gives the coefficients that its element lacks."""
    given = _named(element, "material")
    name = str(given.get("value", "")).lower() if given is not None else "skin1"
    if name not in MATERIALS:
        return name
    if given is not None:
        element.remove(given)
    s, a = MATERIALS[name]
    total = tuple(map(sum, zip(s, a, strict=True)))
    share = tuple(x / t for x, t in zip(s, total, strict=True))
    own = {n for n in _COEFFICIENTS if _named(element, n) is not None}
    pair = ("sigma_t", "albedo") if own & {"sigma_t", "albedo"} else ("sigma_s", "sigma_a")
    numbers = {"sigma_s": s, "sigma_a": a, "sigma_t": total, "albedo": share}
    lacked = [n for n in pair if n not in own] if len(own) < 2 else []
    for n in lacked:
        _set(element, n, numbers[n])
    text = f"{element.tag} {element.get('type')}: {' and '.join(lacked)} of material {name}"
    if element.tag == "medium" and set(lacked) - {"albedo"}:
        text += " in 1/mm, as the manual of version 0.x says; its program took 100 times as much"
        notes.approximated.append((text, where))
    elif lacked:
        notes.add(text, where)
    return name


def _albedo(element: _Element) -> tuple[float, ...] | None:
    """Scattering over extinction of what names its coefficients; None if it does not."""
    given = {name: _named(element, name) for name in _COEFFICIENTS}
    if given["albedo"] is not None:
        return _numbers(given["albedo"], 0.5)
    if given["sigma_s"] is None or (given["sigma_a"] is None and given["sigma_t"] is None):
        return None
    scattered = _numbers(given["sigma_s"], 0.0)
    other = _numbers(given["sigma_a"] if given["sigma_t"] is None else given["sigma_t"], 0.0)
    if scattered is None or other is None:
        return None
    total = other
    if given["sigma_t"] is None:
        total = tuple(s + a for s, a in zip(scattered, other, strict=True))
    return tuple(s / t if t > 0 else 0.0 for s, t in zip(scattered, total, strict=True))


def subsurface(element: _Element, where: str, notes: Notes) -> None:
    """A dipole below a surface, whose BSDF it replaces."""
    inside = 1.5 if _preset(element, where, notes) == "marble" else 1.3
    albedo, shape = _albedo(element), element.getparent()
    forward = _numbers(_named(element, "g"), 0.0)
    if element.get("type") != "dipole" or shape is None or shape.tag != "shape":
        return  # refused as an unknown element
    eta = inside
    if _named(element, "int_ior") is not None or _named(element, "ext_ior") is not None:
        eta = _index(element, "int_ior", inside) / _index(element, "ext_ior", IORS["air"])
    if albedo is None or not 0.1 <= eta <= 10:
        return
    if forward is None or not all(-1 < g < 1 for g in forward):
        return
    albedo = tuple(min(max(a, 0.0), 1.0) for a in albedo)
    albedo = tuple(a * (1 - g) / (1 - a * g) for a, g in zip(albedo, forward, strict=True))
    for child in list(shape):
        if child.tag == "bsdf" or (child.tag == "ref" and not child.get("name")):
            shape.remove(child)
    bsdf = etree.Element("bsdf", type="diffuse")
    bsdf.sourceline = element.sourceline
    _set(bsdf, "reflectance", tuple(dipole(a, eta) for a in albedo))
    shape.replace(element, bsdf)
    text = "subsurface dipole is rendered as a diffuse surface of the same reflectance"
    notes.approximated.append((text, where))


def _index(element: _Element, name: str, default: float) -> float:
    """An index of refraction; of an unknown name one without bounds."""
    given = _named(element, name)
    text = str(given.get("value")).lower() if given is not None else ""
    return IORS.get(text) or (_numbers(given, default) or (0.0,))[0] or inf


def dipole(albedo: float, eta: float) -> float:
    """The diffuse reflectance of a half space of an albedo and a relative index."""
    inside = -1.440 / (eta * eta) + 0.710 / eta + 0.668 + 0.0636 * eta if eta != 1 else 0.0
    a, s = (1 + inside) / (1 - inside), sqrt(3 * (1 - albedo))
    first, second = (float(Decimal(x).exp()) for x in (-4 * a * s / 3, -s))
    return albedo / 2 * (1 + first) * second


def mixed_phase(element: _Element, where: str, notes: Notes) -> None:
    """A mixture of phase functions."""
    weights = _named(element, "weights")
    words = re.findall(r"[^\s,]+", str(weights.get("value"))) if weights is not None else []
    held = [c for c in element if c.tag == "phase"]
    try:
        shares = [float(word) for word in words]
    except ValueError:
        return
    total = sum(shares)
    parent = element.getparent()
    if len(shares) != len(held) or not total > 0 or min(shares) < 0 or parent is None:
        return  # refused as an unknown phase function
    made, left = held[-1], shares[-1]
    for share, one in zip(shares[-2::-1], held[-2::-1], strict=True):
        blend = etree.Element("phase", type="blendphase")
        blend.sourceline = element.sourceline
        left += share
        _add(blend, "float", "weight", repr((left - share) / left if left > 0 else 0.0))
        blend.extend([one, made])
        made = blend
    for name in ("id", "name"):
        if value := element.get(name):
            made.set(name, value)
    parent.replace(element, made)


def cached(element: _Element, where: str, notes: Notes) -> None:
    """A volume that keeps another one."""
    held, parent = [c for c in element if c.tag == "volume"], element.getparent()
    if len(held) == 1 and parent is not None:
        held[0].set("name", str(element.get("name", "")))
        parent.replace(element, held[0])


def grid(element: _Element, where: str, notes: Notes) -> None:
    """A grid fills its file's box, or that from `min` to `max`; its outer samples lie on it."""
    given = [child for name in ("min", "max") if (child := _named(element, name)) is not None]
    low, high = [_point(child) for child in given] if len(given) == 2 else (None, None)
    _add(element, "boolean", "at_corners", "true")
    if low is None or high is None:
        _add(element, "boolean", "use_grid_bbox", "true")
        return
    place = _transform(element, "to_world")
    sides = [b - a for a, b in zip(low, high, strict=True)]
    for at, (tag, numbers) in enumerate((("scale", sides), ("translate", low))):
        step = etree.Element(tag, value=" ".join(map(repr, numbers)))
        step.sourceline = element.sourceline
        place.insert(at, step)
    for child in given:
        element.remove(child)


def _point(element: _Element) -> tuple[float, ...] | None:
    """The three numbers of a point; None if it gives others."""
    text = element.get("value") or " ".join(str(element.get(axis, "0")) for axis in "xyz")
    words = re.findall(r"[^\s,]+", text)
    if len(words) not in (1, 3) or not all(map(_FLOAT.fullmatch, words)):
        return None
    return tuple(float(word) for word in words) * (3 // len(words))


def medium(element: _Element, where: str, notes: Notes) -> None:
    """The names of a medium's coefficients and volumes."""
    for child in list(element):
        if child.tag == "volume" and child.get("name") == "density":
            child.set("name", "sigma_t")
        elif child.tag in ("volume", "ref") and child.get("name") == "orientation":
            element.remove(child)
            notes.approximated.append(("medium: orientation is left out", where))
        elif child.get("name") == "method":
            element.remove(child)
    if element.get("type") == "homogeneous":
        _preset(element, where, notes)
