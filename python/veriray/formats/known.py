"""Names of Mitsuba 3's plugins by category, so that one that is missing here is named as such."""

from __future__ import annotations

from .node import allowed, shorten
from .plugins import CATEGORIES, PLUGINS, of_category

#: Mitsuba 3.9.
MITSUBA: dict[str, tuple[str, ...]] = {
    name: tuple(plugins.split())
    for name, plugins in {
        "bsdf": "blendbsdf bumpmap circular conductor dielectric diffuse hair mask measured "
        "measured_polarized normalmap null plastic polarizer pplastic principled principledthin "
        "retarder roughconductor roughdielectric roughplastic thindielectric twosided",
        "emitter": "area constant directional directionalarea envmap point projector spot sunsky "
        "timed_sunsky",
        "film": "hdrfilm specfilm",
        "integrator": "aov depth direct direct_projective moment path prb prb_basic "
        "prb_projective prbvolpath ptracer stokes volpath volpathmis volprim_rf_basic",
        "medium": "heterogeneous homogeneous",
        "phase": "blendphase hg isotropic rayleigh sggx tabphase",
        "rfilter": "box catmullrom gaussian lanczos mitchell tent",
        "sampler": "independent ldsampler multijitter orthogonal stratified",
        "sensor": "batch distant irradiancemeter orthographic perspective radiancemeter thinlens",
        "shape": "blender bsplinecurve cube cylinder disk ellipsoids ellipsoidsmesh instance "
        "linearcurve merge obj ply rectangle sdfgrid serialized shapegroup sphere",
        "spectrum": "blackbody d65 irregular regular srgb uniform",
        "texture": "bitmap checkerboard mesh_attribute volume",
        "volume": "constvolume gridvolume",
    }.items()
}


_CATEGORIES = {plugin: name for name, plugins in MITSUBA.items() for plugin in plugins}


def category(plugin: str) -> str:
    """The category of a plugin of Mitsuba, "" if it has none of that name."""
    return _CATEGORIES.get(plugin, "")


def missing(kind: str, plugin: str, holder: str = "") -> str:
    """The message about a plugin that is not supported; holder: what it was to be a part of."""
    names = of_category(kind) if kind in CATEGORIES else []
    text = f"{kind} {shorten(plugin)}"
    if plugin in PLUGINS and PLUGINS[plugin].category == kind:
        return f"{text} is not supported in {holder}"
    if plugin not in MITSUBA.get(kind, ()):
        return f"unknown {text}{allowed(plugin, names)}"
    return f"{text} of Mitsuba is not supported yet{allowed(plugin, names) if names else ''}"
