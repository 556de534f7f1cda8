"""What Mitsuba 0.x had and today has not, in today's terms or by what is nearest: see `upgrade`.

Without loss: `sky`, whose up is +y and whose ground has the albedo 0.2 unless it says otherwise,
as `sunsky`; `difftrans` as a `principledthin` that only lets through; `vertexcolors` of PLY files,
sRGB unless `srgb` is false; a `gridvolume` in the box of its file, or from `min` to `max`, with its
outer samples on the box; checks in their order where one number is wanted, too; `volcache` as what
it holds; `density` of a medium as its `sigma_t`; samplers and films of any other name; a spectrum
of 30 numbers as bins from 360 to 830 nm; a shape with a medium and nothing that says what its
surface is as a `null` border.

With a warning that names the line, as the light differs:

- textures: `scale` of a bitmap, by a number or a colour, clips above 1, and of checks leaves a
  colour that is no number of the file; `gridtexture` and
  `wireframe` by the colour between their lines; `wrapMode` `zero` and `one` as `clamp`, two modes
  as that of u, a gamma as sRGB;
- emitters: `sun` and `sunsky`, whose sun is brighter; a `sky` and a `sun` that are unlike, as one
  `sunsky`; of a `gridvolume` half a cell beyond its box, where more than 0 is there and
  its shape reaches there;
- media: coefficients that are not given are those of `material`, or of `skin1`, in 1/mm, as the
  manual says; the program took 100 times as much;
- OBJ files without a bsdf, unless `loadMaterials` is false: the materials of their library are not
  read;
- bsdfs: `irawan` as `diffuse`, `hk` as `principledthin` of its albedo;
- a subsurface `dipole` as a diffuse surface of the same reflectance: (a / 2) (1 + e^(-4 A s / 3))
  e^(-s), s = sqrt(3 (1 - a)), a the albedo, A = (1 + F) / (1 - F), F = -1.440 / eta^2 +
  0.710 / eta + 0.668 + 0.0636 eta (Jensen, Marschner, Levoy and Hanrahan 2001); the albedo is the
  reduced one, by `g`, and eta is `intIOR` by `extIOR`, or 1.3 (marble: 1.5) if none is named;
- phase functions: `kkay` and `microflake` as `isotropic`; `mixturephase` as blends, without loss;
- sensors `perspective_rdist` and `telecentric` without distortion and blur; integrators `ao` and
  `field` by the light that `path` renders; an `animation` as its first transform;
- parameters that nothing here reads are left out, as Mitsuba 0.x only warned of them.
"""

from __future__ import annotations

from collections.abc import Callable
from math import inf
from typing import TYPE_CHECKING

from lxml import etree
from lxml.etree import _Element

from . import legacy_media
from .approximate import _add, _named, _numbers, _resolved, _set, _transform
from .node import _FLOAT, shorten
from .plugins import PLUGINS

if TYPE_CHECKING:
    from .upgrade import Notes

_VALUES = ("float", "integer", "boolean", "string", "rgb", "srgb", "spectrum", "point", "vector",
           "transform", "blackbody")  # fmt: skip
_ELEMENTS = {"luminaire": "emitter", "camera": "sensor", "lookAt": "lookat"}
#: From the axes of a sky, southwards, eastwards, upwards, to those of version 0.x, where east is x,
#: up y and south z.
_TURN = "0 1 0 0 0 0 1 0 1 0 0 0 0 0 0 1"
_APERTURE = 0.5358
#: Of version 0.3 -> of 0.4.
_EARLY = {"densityMultiplier": "scale", "intensityScale": "scale", "focusDepth": "focusDistance"}
_CHECKS = {"color0": 0.4, "color1": 0.2}
#: Parameters that a sky and a sun have each for itself, and those that change no light.
_OWN = ("scale", "sunRadiusScale", "albedo", "stretch", "extend", "resolution", "samplingWeight")
_SUN_LEFT_OUT = ("stretch", "extend", "resolution", "cache")


def elements(root: _Element, file: str, notes: Notes, early: bool) -> None:
    """Renames elements under `root`, and takes away those that have no counterpart. early: of
    version 0.3."""
    for element in list(root.iter()):
        where = f"{file}:{element.sourceline}"
        if element.tag in ("luminaire", "camera"):
            notes.add(f"<{element.tag}> is <{_ELEMENTS[element.tag]}>", where)
            element.tag = _ELEMENTS[element.tag]
        elif element.tag == "animation":
            _animation(element, where, notes)
    for element in list(root.iter("sensor", "emitter", "medium")) if early else ():
        _early(element)
    skies = [e for e in root.iter("emitter") if e.get("type") in ("sky", "sun")]
    if sorted(str(e.get("type")) for e in skies) == ["sky", "sun"]:
        _one_sky(skies, file, notes)


def parts(root: _Element, file: str, notes: Notes) -> None:
    """Puts objects under `root` into today's terms; their names are today's already."""
    for element in list(root.iter()):
        if isinstance(element.tag, str) and element.get("type") is not None:
            key = str(element.tag), str(element.get("type"))
            where = f"{file}:{element.sourceline}"
            _OBJECTS.get(key, _other)(element, where, notes)
            if element.tag == "medium":
                legacy_media.medium(element, where, notes)
            elif element.tag == "shape":
                legacy_media.border(element, where, notes)


def unread(root: _Element, file: str, notes: Notes) -> None:
    """Takes away parameters that nothing reads; the objects are in today's terms already."""
    for element in list(root.iter()):  # what is taken away ends a walk
        plugin = PLUGINS.get(str(element.get("type"))) if isinstance(element.tag, str) else None
        if plugin is None or plugin.category != element.tag or plugin.lenient:
            continue
        for child in list(element):
            name = "to_world" if child.tag == "transform" else ""
            name = str(child.get("name", name))
            plain = child.tag in _VALUES and child.get("type") is None
            if not name or not (plain or (child.tag == "texture" and element.tag == "emitter")):
                continue
            kept = name in plugin.params or name in plugin.noted
            if not kept and (element.tag, name) != ("medium", "material"):  # which is refused
                text = f"{element.tag} {element.get('type')}: {shorten(name)} is left out"
                if name in plugin.unsupported:
                    text += f": {plugin.unsupported[name]}"
                notes.approximated.append((text, f"{file}:{child.sourceline}"))
                element.remove(child)


def _warned(new: str, text: str = "") -> Callable[[_Element, str, Notes], None]:
    """A rule that gives an object another type, and what that type reads, with a warning."""

    def rule(element: _Element, where: str, notes: Notes) -> None:
        told = f"{element.tag} {element.get('type')} is rendered as {new}{text}"
        element.set("type", new)
        for child in list(element):
            name = child.get("name") if child.tag != "transform" else "to_world"
            if child.tag in (*_VALUES, "texture") and name not in PLUGINS[new].params:
                element.remove(child)
        notes.approximated.append((told, where))

    return rule


def _other(element: _Element, where: str, notes: Notes) -> None:
    """Samplers, films and filters that are not known."""
    plugin = str(element.get("type"))
    for tag, new in (("sampler", "independent"), ("film", "hdrfilm"), ("rfilter", "gaussian")):
        if element.tag == tag and plugin not in PLUGINS and "$" not in plugin:
            text = f"{tag} {shorten(plugin)} is not known: {new} is taken"
            if tag == "rfilter":
                notes.approximated.append((text, where))
            else:
                notes.add(text, where)
            element.set("type", new)


def _rename(element: _Element, old: str, new: str) -> None:
    child = _named(element, old)
    if child is not None and _named(element, new) is None:
        child.set("name", new)


def _animation(element: _Element, where: str, notes: Notes) -> None:
    parent, first = element.getparent(), element.find("transform")
    if parent is None or first is None:
        return  # refused as an unknown element
    first.attrib.clear()
    first.set("name", str(element.get("name", "toWorld")))
    parent.replace(element, first)
    notes.approximated.append(("animation: its first transform counts; nothing moves", where))


def _early(element: _Element) -> None:
    """What version 0.4 changed."""
    for old, new in _EARLY.items():
        _rename(element, old, new)
    lamp = element.get("type") if element.tag == "emitter" else ""
    if lamp in ("constant", "directional"):
        _rename(element, "intensity", "radiance" if lamp == "constant" else "irradiance")
    if element.tag != "sensor":
        return
    place = _transform(element, "toWorld")
    mirror = etree.Element("scale", x="-1")
    mirror.sourceline = element.sourceline
    place.insert(0, mirror)
    side = _named(element, "mapSmallerSide")
    if side is not None:
        element.remove(side)
    if str(element.get("type")).startswith(("perspective", "thinlens")):
        larger = side is not None and side.get("value") == "false"
        if _named(element, "fovAxis") is None:
            _add(element, "string", "fovAxis", "larger" if larger else "smaller")


def _said(element: _Element, name: str) -> list[str]:
    """What the parameter of a sky or a sun says, in words."""
    child = _named(element, name)
    if child is None:
        return ["3.0"] if name == "turbidity" else []
    words = [w for e in child.iter() for k, v in e.items() if k != "name" for w in (k, *v.split())]
    words = [repr(float(w)) if _FLOAT.fullmatch(w) else w for w in words]
    return words[1:] if name == "turbidity" else words


def _one_sky(skies: list[_Element], file: str, notes: Notes) -> None:
    """A sky and a sun as one sunsky."""
    sky, sun = sorted(skies, key=lambda e: str(e.get("type")))
    where = f"{file}:{sun.sourceline}"
    both = dict.fromkeys(str(c.get("name")) for c in (*sky, *sun))
    unlike = [n for n in both if n not in _OWN and _said(sky, n) != _said(sun, n)]
    if unlike:
        text = f"emitters sun and sky ({file}:{sky.sourceline}) are one sunsky, but unlike in "
        text += ", ".join(map(shorten, unlike))
        text += ": the sky's parameters are used, and the sun's where the sky has none"
        notes.approximated.append((text, where))
    for child in list(sun):
        name = str(child.get("name"))
        if name == "scale":
            child.set("name", "sunScale")
        if _named(sky, str(child.get("name"))) is None or name == "scale":
            sky.append(child)
    _rename(sky, "scale", "skyScale")
    sky.set("type", "sunsky")
    holder = sun.getparent()
    if holder is not None:
        holder.remove(sun)
    notes.add("emitters sky and sun are one sunsky", where)


def _sunsky(element: _Element, where: str, notes: Notes) -> None:
    plugin = str(element.get("type"))
    own = {"sky": "sky_scale", "sun": "sun_scale"}.get(plugin)
    if own:
        _rename(element, "scale", own)
        _add(element, "float", "sun_scale" if plugin == "sky" else "sky_scale", "0")
    element.set("type", "sunsky")
    if plugin != "sky":
        text = f"emitter {plugin}: version 0.x had another model of the sun; this one is brighter"
        notes.approximated.append((text, where))
    if plugin != "sun" and _named(element, "albedo") is None:
        _add(element, "rgb", "albedo", "0.2")
    radius = _named(element, "sun_radius_scale")
    if radius is not None:
        factor = (_numbers(radius, 1.0) or (1.0,))[0]
        element.remove(radius)
        if factor > 0:
            _add(element, "float", "sun_aperture", repr(_APERTURE * factor))
    for name in _SUN_LEFT_OUT:
        child = _named(element, name)
        if child is not None:
            element.remove(child)
            if name in ("stretch", "extend") and child.get("value") not in ("1", "1.0", "false"):
                notes.approximated.append((f"emitter {plugin}: {name} is left out", where))
    place = _transform(element, "to_world")
    turn = etree.Element("matrix", value=_TURN)
    turn.sourceline = element.sourceline
    place.insert(0, turn)
    _add(element, "boolean", "y_is_east", "true")
    notes.add(f"emitter {plugin} is sunsky, whose up is y", where)


def _grid(element: _Element, where: str, notes: Notes) -> None:
    """A texture of lines as the colour between them."""
    plugin, parent = str(element.get("type")), element.getparent()
    name = {"gridtexture": "color0", "wireframe": "interior_color"}[plugin]
    colour = _numbers(_named(element, name), 0.2 if plugin == "gridtexture" else 0.5)
    if colour is None or parent is None:
        return
    notes.approximated.append((f"texture {plugin} is rendered without its lines", where))
    element.set("type", "checkerboard")
    element[:] = []
    for one in ("color0", "color1"):
        _set(element, one, colour)


def _scaled(element: _Element, where: str, notes: Notes, depth: int = 8) -> None:
    """A texture times a number, `scale` or `gain`, as that texture. depth: of such in it; one in
    itself has no end."""
    parent = element.getparent()
    if not depth or parent is None:
        return  # refused as an unknown texture
    for child in list(element):
        _apart(child, element, where, notes, depth)
    inner = [c for c in element if c.tag == "texture"]
    colours = [c for c in element if c.tag in _VALUES and c.get("name") == "value"]
    name = "scale" if _named(element, "gain") is None else "gain"
    factor = _numbers(_named(element, name), 1.0)
    if factor is None or len(inner) + len(colours) != 1:
        return  # refused as an unknown texture
    if colours:
        made = _times(colours[0], 1.0, factor)
        if made is not None:
            element[:] = []
            element.set("type", "checkerboard")
            for one in _CHECKS:
                _set(element, one, made)
        return
    held = inner[0]
    if held.get("type") in ("gridtexture", "wireframe"):
        _grid(held, where, notes)
    if held.get("type") == "checkerboard":
        _scale_checks(held, factor, 1.0 if parent.tag == "bsdf" else inf, where, notes, name)
    elif not _scale_texels(held, factor, name):
        return
    for key in ("name", "id"):
        held.attrib.pop(key, "")
        if element.get(key) is not None:
            held.set(key, str(element.get(key)))
    parent.replace(element, held)
    if name == "scale":
        notes.add("a texture of type scale is its texture's own scale", where)


def _apart(child: _Element, element: _Element, where: str, notes: Notes, depth: int) -> None:
    """Makes what a texture `scale` holds its own: a copy where others may refer to it."""
    if child.tag not in ("ref", "texture"):
        return
    root = element.getroottree().getroot()
    copied = None
    if child.tag == "ref" or any(e.get("id") for e in child.iter() if e.tag != "ref"):
        copied = _resolved(child, root, "texture")
    if copied is not None:
        element.replace(child, copied)
        if child.tag == "texture":  # is read in its turn
            child.attrib.pop("name", "")
            root.append(child)
        child = copied
    if child.tag == "texture" and child.get("type") == "scale":
        _scaled(child, where, notes, depth - 1)
    elif copied is not None:
        _OBJECTS.get(("texture", str(child.get("type"))), _other)(child, where, notes)


def _times(
    given: _Element | None, default: float, factor: tuple[float, ...]
) -> tuple[float, ...] | None:
    """A parameter's numbers times others; None if it gives none."""
    own = _numbers(given, default)
    return own and tuple(a * b for a, b in zip(own, factor, strict=True))


def _scale_checks(
    held: _Element, factor: tuple[float, ...], most: float, where: str, notes: Notes, name: str
) -> None:
    """A checkerboard times a number: those of its colours that are numbers."""
    for one, default in _CHECKS.items():
        own = _numbers(_named(held, one), default)
        made, told = _times(_named(held, one), default, factor), ""
        if own is None or made is None:
            told = f"{one} is no number of the file, and stays as it is"
        else:
            if max(own if name == "gain" else made) > most:  # what a bsdf's gain clips is no news
                told = f"{one} above 1 is 1"
            made = tuple(min(x, most) for x in made)
        if told:
            kind = "scale" if name == "scale" else "checkerboard"
            notes.approximated.append((f"texture {kind}: {told}", where))
        _set(held, one, made)


def _scale_texels(held: _Element, factor: tuple[float, ...], name: str) -> bool:
    """Another texture times a number, as its own `scale` or `gain`; whether it can be."""
    even = name == "gain" or held.get("type") == "mesh_attribute"
    if held.get("type") not in ("bitmap", "mesh_attribute") or (even and len(set(factor)) > 1):
        return factor == (1.0,) * 3
    own = _named(held, name)
    made = _times(own, 1.0, factor)
    if made is None:
        return False
    if even:
        if own is not None:
            held.remove(own)
        _add(held, "float", name, repr(made[0]))
    else:
        _set(held, name, made)
    return True


def _bitmap(element: _Element, where: str, notes: Notes) -> None:
    for name in ("wrap_mode", "wrap_mode_u"):
        child = _named(element, name)
        if child is not None and child.get("value") in ("zero", "one"):
            text = f"texture bitmap: beyond its edge it is as at the edge, not {child.get('value')}"
            notes.approximated.append((text, where))
            child.set("value", "clamp")
    u, v = _named(element, "wrap_mode_u"), _named(element, "wrap_mode_v")
    one = v if u is None else u
    if one is not None:
        one.set("name", "wrap_mode")
        if u is not None and v is not None:
            element.remove(v)
        text = f"texture bitmap: wrap mode {one.get('value')} in u and v"
        notes.approximated.append((text, where))
    gamma = _named(element, "gamma")
    if gamma is not None:
        element.remove(gamma)
        text = f"texture bitmap: a gamma of {shorten(gamma.get('value'))} is read as sRGB"
        notes.approximated.append((text, where))


def _colours(element: _Element, where: str, notes: Notes) -> None:
    _add(element, "boolean", "bytes", "true")


def _checks(element: _Element, where: str, notes: Notes) -> None:
    _add(element, "boolean", "in_order", "true")


def _lamp(element: _Element, where: str, notes: Notes) -> None:
    _rename(element, "intensity", "radiance")


def _direct(element: _Element, where: str, notes: Notes) -> None:
    _rename(element, "luminaire_samples", "emitter_samples")


_OBJECTS: dict[tuple[str, str], Callable[[_Element, str, Notes], None]] = {
    **{("emitter", name): _sunsky for name in ("sky", "sun", "sunsky")},
    ("emitter", "area"): _lamp,
    ("integrator", "direct"): _direct,
    ("integrator", "ao"): _warned("path", ": light, not openness"),
    ("integrator", "field"): _warned("path", ": light, not the field"),
    ("bsdf", "difftrans"): legacy_media.transmitter,
    ("bsdf", "hk"): legacy_media.hanrahan,
    ("bsdf", "irawan"): _warned("diffuse", ", not as woven"),
    ("subsurface", "dipole"): legacy_media.subsurface,
    ("texture", "gridtexture"): _grid,
    ("texture", "wireframe"): _grid,
    ("texture", "scale"): _scaled,
    ("texture", "bitmap"): _bitmap,
    ("texture", "mesh_attribute"): _colours,
    ("texture", "checkerboard"): _checks,
    **{("phase", name): _warned("isotropic") for name in ("kkay", "microflake")},
    ("phase", "mixturephase"): legacy_media.mixed_phase,
    ("volume", "volcache"): legacy_media.cached,
    ("volume", "gridvolume"): legacy_media.grid,
    ("sensor", "perspective_rdist"): _warned("perspective", " without its distortion"),
    ("sensor", "telecentric"): _warned("orthographic", " without its blur"),
}
