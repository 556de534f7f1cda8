"""Scene files of Mitsuba 0.3 to 1.x in today's terms, element by element, before they are read.

As Mitsuba 3 does for versions below 2: names of parameters in camelCase become snake_case, and
`diffuseReflectance` of a diffuse BSDF is its `reflectance`; uoffset, voffset, uscale, vscale are
the transform `to_uv`, here scale, then translation, as in 0.x (Mitsuba 3 exchanges them). Mitsuba 3
refuses the rest of what those versions had; where today's terms say the same, they are used:

- <lookAt>, <blackbody>, and spectra of three numbers, which are RGB; `intent` is left out;
- film `ldrfilm`, `mfilm`, `tiledhdrfilm`: `hdrfilm` of the same size and filter, of one pixel by
  default for `mfilm`;
- samplers `sobol`, `halton`, `hammersley`: `ldsampler`;
- integrators that compute what `path` computes, by other paths: `path`, or `volpath` where there
  is a medium, with the same depths;
- `adaptive` and `multichannel`: the integrator that they hold;
- `mixturebsdf` or `mixture`: `blendbsdf` in `blendbsdf`; `bump`: `bumpmap`; a bump map of a
  texture `scale`: its own `scale`; the texture of a `normalmap`, of any name, is its `normalmap`;
  `extEta` by name is a number;
- `bumpmap` and `normalmap`: without a function for shadows, and no normal flipped;
- `vpl` ends at depth 5 unless it says otherwise; `roughdiffuse` takes `diffuseReflectance`, too;
- version 0.3: cameras are mirrored, `fov` is of the smaller side, `intensity` of `constant` and
  `directional` is `radiance` and `irradiance`, `densityMultiplier` and `intensityScale` are
  `scale`, `focusDepth` is `focusDistance`. Older ones are refused;
- `vertexcolors`: `mesh_attribute`; bitmaps filtered by `trilinear` or `ewa`: bilinear;
- parameters that change no light are left out;
- `phong`, `ward`, `coating`, `roughcoating`, `roughdiffuse` by what is nearest: see `approximate`;
  much of the rest likewise: see `legacy`.

What has no counterpart stays as it is, and is refused by name as any unknown object.
"""

from __future__ import annotations

import re
from collections.abc import Callable, Iterable

from lxml import etree
from lxml.etree import _Element

from ..errors import SceneError
from . import legacy, spectra
from .approximate import _numbers, approximate
from .node import parse_floats, shorten
from .plugins import IORS

_HUMP = re.compile(r"(?<=[a-z])[A-Z]+")
_OBJECTS = (
    "integrator", "sensor", "film", "sampler", "rfilter", "bsdf", "emitter", "shape", "texture",
    "medium", "phase", "volume", "spectrum",
)  # fmt: skip
_PATHS = (
    "adaptive", "bdpt", "erpt", "irrcache", "mlt", "photonmapper", "ppm", "pssmlt", "sppm",
    "volpath_simple", "vpl",
)  # fmt: skip
#: Object -> its name today. Parameters stay, but of films and integrators only those in _KEPT.
_RENAMED = {
    ("film", "ldrfilm"): "hdrfilm", ("film", "mfilm"): "hdrfilm",
    ("film", "tiledhdrfilm"): "hdrfilm",
    ("sampler", "sobol"): "ldsampler", ("sampler", "halton"): "ldsampler",
    ("sampler", "hammersley"): "ldsampler",
    ("texture", "vertexcolors"): "mesh_attribute",
}  # fmt: skip
#: BSDFs' first names.
_OLDER = {"bump": "bumpmap", "mixture": "mixturebsdf"}
_KEPT = {
    "film": ("width", "height", "crop_width", "crop_height", "crop_offset_x", "crop_offset_y"),
    "integrator": ("max_depth", "rr_depth", "hide_emitters"),
}
#: What changes no light: category -> parameters.
_DROPPED = {
    "integrator": ("strict_normals",),
    "sampler": ("dimension", "scramble"),
    "film": ("banner", "attach_log", "high_quality_edges"),
    "texture": ("cache", "max_anisotropy"),
    "emitter": ("cache", "resolution", "sampling_weight"),
    "shape": ("collapse",),
}


#: Numbers of a spectrum in the spectral builds of version 0.x.
_BINS = 30


class Notes:
    """What was put in other words: text -> the first place and how often; and what is rendered by
    something else: text and place."""

    def __init__(self) -> None:
        self.found: dict[str, tuple[str, int]] = {}
        self.approximated: list[tuple[str, str]] = []

    def add(self, text: str, where: str) -> None:
        """Counts one more use of `text`."""
        place, count = self.found.get(text, (where, 0))
        self.found[text] = place, count + 1

    def listed(self) -> list[tuple[str, str]]:
        """Each text once, with how often it applied, and its first place."""
        return [
            (text if count == 1 else f"{text} ({count} times)", where)
            for text, (where, count) in self.found.items()
        ]


def upgrade(root: _Element, file: str, notes: Notes, early: bool = False) -> None:
    """Changes the elements under `root`, a file's, in place; early: of version 0.3. Raises
    SceneError."""
    legacy.elements(root, file, notes, early)
    media = root.find(".//medium") is not None
    for element in list(root.iter()):
        if isinstance(element.tag, str):
            _names(element, file, notes)
    for element in list(root.iter()):
        if isinstance(element.tag, str):
            where = f"{file}:{element.sourceline}"
            if element.tag in _OBJECTS and element.get("type") is not None:
                _object(element, where, notes, media)
            else:
                _value(element, where, notes)
    for element in reversed(list(root.iter("bsdf"))):  # what a bsdf holds comes before it
        told = f"{file}:{element.sourceline}"
        approximate(element, told, root, lambda *warned: notes.approximated.append(warned))
    legacy.parts(root, file, notes)
    legacy.unread(root, file, notes)


def snake(name: str) -> str:
    """A camelCase name as Mitsuba 3 writes it: toWorld, to_world; intIOR, int_ior."""
    return _HUMP.sub(lambda m: "_" + m[0].lower(), name)


def _names(element: _Element, file: str, notes: Notes) -> None:
    name = element.get("name")
    if name is None or element.tag == "default":
        return
    new = snake(str(name))
    if new != name:
        element.set("name", new)
        notes.add(f"{name} is {new}", f"{file}:{element.sourceline}")


def _value(element: _Element, where: str, notes: Notes) -> None:
    if element.tag == "lookAt":
        element.tag = "lookat"
    elif element.tag in ("spectrum", "rgb", "srgb"):
        element.attrib.pop("intent", "")
        text = element.get("value") or ""
        count = len(re.findall(r"[^\s,]+", text))
        parent = element.getparent()
        if element.tag == "spectrum" and ":" not in text and count == 3:
            element.tag = "rgb"
            notes.add("a spectrum of three numbers is RGB", where)
        elif element.tag == "spectrum" and ":" not in text and count == _BINS:
            step = (spectra.HIGH - spectra.LOW) / _BINS
            pairs = enumerate(re.findall(r"[^\s,]+", text))
            shown = (f"{spectra.LOW + (i + 0.5) * step!r}:{word}" for i, word in pairs)
            element.set("value", " ".join(shown))
            notes.add(f"a spectrum of {_BINS} numbers is one of as many equal bins", where)
        elif element.tag == "spectrum" and ":" not in text and count == 1:
            if parent is not None and parent.tag == "emitter":
                notes.add(
                    "light of one number is an even spectrum, as in Mitsuba 3: reddish", where
                )
    elif element.tag == "blackbody":
        _blackbody(element, where)


def _blackbody(element: _Element, where: str) -> None:
    """<blackbody name temperature="5000K" scale> as the spectrum of that name."""
    temperature = str(element.attrib.pop("temperature", "")).strip()
    if not temperature:
        raise SceneError('<blackbody> lacks the attribute "temperature"', where)
    _add(element, "float", "temperature", re.sub(r"\s*[kK]$", "", temperature))
    if "scale" in element.attrib:
        _add(element, "float", "scale", str(element.attrib.pop("scale")))
    element.tag = "spectrum"
    element.set("type", "blackbody")


def _object(element: _Element, where: str, notes: Notes, media: bool) -> None:
    category, plugin = str(element.tag), str(element.get("type"))
    if category == "bsdf" and plugin in _OLDER:
        plugin = _OLDER[plugin]
        element.set("type", plugin)
    left_out = _DROPPED.get(category, ())
    _drop(element, lambda name: name in left_out, where, notes)
    if category == "film":
        _drop(element, lambda name: name.startswith(("label[", "metadata[")), where, notes)
    if category == "integrator" and plugin in (*_PATHS, "multichannel"):
        _integrator(element, plugin, "volpath" if media else "path", where, notes)
    elif (category, plugin) in _RENAMED:
        new = _RENAMED[category, plugin]
        if category == "film":
            _drop(element, lambda name: name not in _KEPT["film"], where, notes)
        if plugin == "mfilm":
            given = [child.get("name") for child in element]
            for side in ("width", "height"):
                if side not in given:
                    _add(element, "integer", side, "1")
        if plugin == "vertexcolors":
            _add(element, "string", "name", "vertex_color")
        element.set("type", new)
        notes.add(f"{category} {plugin} is {new}", where)
    elif plugin == "mixturebsdf":
        _mixture(element, where, notes)
    elif (category, plugin) == ("bsdf", "diffuse"):
        for child in _parameters(element):
            if child.get("name") == "diffuse_reflectance":
                child.set("name", "reflectance")
    elif (category, plugin) == ("bsdf", "normalmap"):
        _unshaded(element)
        for child in element:
            if child.tag == "texture" or (child.tag == "ref" and child.get("name")):
                child.set("name", "normalmap")
    elif category == "bsdf" and plugin in ("conductor", "roughconductor"):
        _conductor(element, plugin, where, notes)
    elif (category, plugin) == ("bsdf", "bumpmap"):
        _bump(element, where, notes)
    elif (category, plugin) == ("bsdf", "mask"):
        _opacity(element, where, notes)
    elif category == "texture":
        _texture(element, plugin, where, notes)


def _integrator(element: _Element, plugin: str, new: str, where: str, notes: Notes) -> None:
    held = [c for c in element if c.tag == "integrator" and c.get("type") != "field"]
    inner = held[0] if held and plugin in ("adaptive", "multichannel") else None
    if inner is None and plugin == "multichannel":
        return  # it draws no light
    if inner is not None:  # what it holds is what it draws
        if inner.get("type") in _PATHS:
            _integrator(inner, str(inner.get("type")), new, where, notes)
        element[:] = list(inner)
        new = str(inner.get("type"))
    else:
        element[:] = [child for child in element if child.get("name") in _KEPT["integrator"]]
        if plugin == "vpl" and all(child.get("name") != "max_depth" for child in element):
            _add(element, "integer", "max_depth", "5")
    element.set("type", new)
    notes.add(f"integrator {plugin} runs as {new}, which has the same expectation", where)


def _mixture(element: _Element, where: str, notes: Notes) -> None:
    """The sum of weighted BSDFs as blends of two, with black for what the weights lack to 1."""
    given = [c for c in _parameters(element) if c.get("name") == "weights"]
    text = str(given[0].get("value", "")) if given else ""
    parts = [child for child in element if child.tag in ("bsdf", "ref")]
    label = 'mixturebsdf: "weights"'
    if not parts:
        raise SceneError("mixturebsdf holds no BSDF", where)
    weights = list(parse_floats(text, label, where, (len(parts),)))
    total = sum(weights)
    if min(weights) < 0 or not 0 < total <= 1 + 1e-6:
        raise SceneError(
            f"{label} = {shorten(text)}, expected numbers >= 0, of sum 1 at most", where
        )
    element[:] = []
    if total < 1 - 1e-6 or len(parts) == 1:
        black = _made(element, "bsdf", {"type": "diffuse"})
        _add(black, "rgb", "reflectance", "0")
        parts.append(black)
        weights.append(max(1 - total, 0.0))
    element.set("type", "blendbsdf")
    outer, left = element, sum(weights)
    while True:  # the weight of a blend is that of its second BSDF
        first, parts, share = parts[0], parts[1:], weights.pop(0)
        outer.append(first)
        _add(outer, "float", "weight", repr(min(max((left - share) / left, 0.0), 1.0)))
        left -= share
        if len(parts) == 1:
            outer.append(parts[0])
            break
        inner = _made(element, "bsdf", {"type": "blendbsdf"})
        outer.append(inner)
        outer = inner
    notes.add("bsdf mixturebsdf is blendbsdf", where)


def _opacity(element: _Element, where: str, notes: Notes) -> None:
    """A grey opacity as the number that it is; of a colour, today's mask takes the mean."""
    for child in _parameters(element):
        words = re.findall(r"[^\s,]+", str(child.get("value", "")))
        if child.get("name") == "opacity" and child.tag in ("rgb", "spectrum", "srgb"):
            if child.tag == "srgb" and (shares := _numbers(child, 1.0)):
                child.tag, words = "rgb", list(map(repr, shares))
                child.set("value", " ".join(words))
            if child.tag == "srgb":
                continue  # by a parameter
            if len(set(words)) == 1 and ":" not in words[0] and "#" not in words[0]:
                child.tag = "float"
                child.set("value", words[0])
            elif len(set(words)) > 1:
                text = "bsdf mask: the mean of its opacity counts for all colours"
                notes.approximated.append((text, where))


def _texture(element: _Element, plugin: str, where: str, notes: Notes) -> None:
    numbers = {"uoffset": "0", "voffset": "0", "uscale": "1", "vscale": "1"}
    found = False
    for child in list(_parameters(element)):
        name = child.get("name")
        if name in numbers:
            numbers[str(name)] = str(child.get("value"))
            element.remove(child)
            found = True
        elif name == "filter_type" and child.get("value") in ("trilinear", "ewa"):
            notes.add(f"texture {plugin}: filter {child.get('value')} is bilinear", where)
            child.set("value", "bilinear")
        elif name == "gamma" and _is(child, 1.0, -1.0):  # -1: as the file says
            element.remove(child)
            if _is(child, 1.0):
                _add(element, "boolean", "raw", "true")
    modes = {str(c.get("name")): c for c in _parameters(element) if c.tag == "string"}
    one, other = modes.get("wrap_mode_u"), modes.get("wrap_mode_v")
    if one is not None and other is not None and one.get("value") == other.get("value"):
        one.set("name", "wrap_mode")
        element.remove(other)
        notes.add(f"texture {plugin}: wrap_mode_u and wrap_mode_v are wrap_mode", where)
    if found:
        transform = _made(element, "transform", {"name": "to_uv"})
        element.append(transform)
        for tag, u, v in (("scale", "uscale", "vscale"), ("translate", "uoffset", "voffset")):
            axes = {"x": numbers[u], "y": numbers[v]}
            transform.append(_made(element, tag, axes))
        notes.add("uoffset, voffset, uscale and vscale are to_uv", where)


def _conductor(element: _Element, plugin: str, where: str, notes: Notes) -> None:
    given = {str(child.get("name")): child for child in _parameters(element)}
    outside = given.get("ext_eta")
    name = str(outside.get("value")).lower() if outside is not None else ""
    if outside is not None and outside.tag == "string" and name in IORS:
        outside.tag = "float"
        outside.set("value", repr(IORS[name]))
    if not {"material", "eta", "k"} & set(given):
        notes.add(f"bsdf {plugin} of no material is a mirror, as in Mitsuba 3 (once Cu)", where)


def _bump(element: _Element, where: str, notes: Notes) -> None:
    """A bump map of a texture times a number: the number is the bump map's own."""
    _unshaded(element)
    for child in list(element):
        if child.tag == "texture" and child.get("type") == "scale":
            factors = [c for c in _parameters(child) if c.get("name") == "scale"]
            inner = [c for c in child if c.tag in ("texture", "ref")]
            if len(factors) == len(inner) == 1 and factors[0].tag in ("float", "integer"):
                element.replace(child, inner[0])
                element.append(factors[0])
                notes.add("bsdf bumpmap: scale of its texture is its scale", where)


def _unshaded(element: _Element) -> None:
    """Normals as version 0.x turned them: none flipped, and no function for shadows."""
    for name in ("flip_invalid_normals", "use_shadowing_function"):
        _add(element, "boolean", name, "false")


def _is(element: _Element, *numbers: float) -> bool:
    """Whether an element's value is one of these numbers."""
    try:
        return float(str(element.get("value"))) in numbers
    except ValueError:
        return False


def _parameters(element: _Element) -> Iterable[_Element]:
    return [child for child in element if isinstance(child.tag, str) and child.get("name")]


def _drop(element: _Element, unwanted: Callable[[str], bool], where: str, notes: Notes) -> None:
    """Removes the parameters, but not the objects, whose name is unwanted."""
    for child in _parameters(element):
        name = str(child.get("name"))
        if child.tag not in (*_OBJECTS, "ref") and unwanted(name):
            notes.add(f"{element.tag} {element.get('type')}: {name} is left out", where)
            element.remove(child)


def _made(near: _Element, tag: str, attributes: dict[str, str]) -> _Element:
    """A new element, said to be where `near` is."""
    made: _Element = etree.Element(tag, attributes)
    made.sourceline = near.sourceline
    return made


def _add(element: _Element, tag: str, name: str, value: str) -> None:
    element.append(_made(element, tag, {"name": name, "value": value}))
