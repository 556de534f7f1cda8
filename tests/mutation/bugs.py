"""The planted bugs, and the cases that they are judged by.

`old` and `new` of a mutant are both an expression, or both whole statements that end in a
semicolon, so that one build can hold all mutants and switch between them (`mutants.switched`).
"""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True)
class Case:
    """Scene and reference: the shipped picture, or one that `reference/` makes for the occasion.

    scene: in scenes/; options: of `python -m reference render`, none for the shipped picture;
    edits: (old, new) in a copy of the scene file; hidden: likewise, in the file that the mutant
    renders alone, which must not change the picture.
    """

    scene: str = "cornell/cornell_box.xml"
    options: tuple[str, ...] = ()
    edits: tuple[tuple[str, str], ...] = ()
    hidden: tuple[tuple[str, str], ...] = ()


@dataclass(frozen=True)
class Mutant:
    """A planted bug: `old` becomes `new` in cpp/`file`, or `shape` reflects `factor` times.

    also: further (old, new) in the same file; elsewhere: (file, old, new).
    """

    name: str
    file: str = ""
    old: str = ""
    new: str = ""
    case: str = "shipped"
    shape: str = ""
    factor: float = 1.0
    also: tuple[tuple[str, str], ...] = ()
    elsewhere: tuple[tuple[str, str, str], ...] = ()

    @property
    def edits(self) -> tuple[tuple[str, str, str], ...]:
        """All (file, old, new)."""
        if not self.file:
            return ()
        own = ((self.old, self.new), *self.also)
        return (*((self.file, old, new) for old, new in own), *self.elsewhere)


_QUICK = ("--width", "48", "--height", "48", "--spp", "1024")
_CHECK = ("--width", "32", "--height", "32", "--spp", "1024")
_CHECKS = (
    "chromatic_medium", "conductor_metal", "conductor_mirror", "dielectric_sphere",
    "disk_ellipse", "disk_light", "flip_normals", "glass_cube", "glass_mesh",
    "hg_forward", "lamp_in_medium", "mask", "medium_in_glass", "near_lamps", "null_medium",
    "plastic",
    "plastic_nonlinear", "rough_glass", "rough_metal", "rough_plastic", "medium_in_rough_glass",
    "rough_shadows", "rough_whole",
    "principled_surfaces", "principled_glass", "thin_sheets", "albedo_grid", "smoke",
    "brushed", "relief",
    "point_in_medium", "point_light", "projected_images", "smooth_normals", "sphere_light",
    "spheres_300", "spot_light", "textured_lamps", "textures", "blends", "attributes",
    "blended_fog", "rayleigh_air", "thindielectric", "thinlens", "twosided", "hair",
)  # fmt: skip
_SECOND_FLOOR = """<shape type="rectangle"><transform name="to_world"><scale value="20"/>
<rotate x="1" angle="-90"/></transform><bsdf type="diffuse"><rgb name="reflectance" value="0.9"/>
</bsdf></shape></scene>"""
CASES = {
    "shipped": Case(),
    "quick": Case(options=_QUICK),
    "depth 3": Case(options=(*_QUICK, "--max-depth", "3")),
    # In the box as measured no path can meet the back of the lamp.
    "lowered lamp": Case(
        options=_QUICK, edits=(("0 -65 0 278 0 0 -1 548.8", "0 -65 0 278 0 0 -1 400"),)
    ),
    **{name: Case(f"checks/{name}.xml", _CHECK) for name in _CHECKS},
    "mask, depth 3": Case("checks/mask.xml", (*_CHECK, "--max-depth", "3")),
    # The base is chosen rarely, so that its density matters.
    "plastic of high index": Case(
        "checks/plastic.xml", _CHECK, (('"int_ior" value="1.9"', '"int_ior" value="6"'),)
    ),
    # The edge of a ball in the plane of focus.
    "lens from near": Case(
        "checks/thinlens.xml", _CHECK,
        (('"fov" value="40"', '"fov" value="5"'),
         ('"aperture_radius" value="0.25"', '"aperture_radius" value="1"'),
         ('target="0, 0.6, 0"', 'target="0.5, 0.55, 0"')),
    ),
    # A sphere that shines behind a boundary without refraction.
    "sphere lamp in fog": Case(
        "checks/lamp_in_medium.xml", _CHECK,
        (('<bsdf type="dielectric"><float name="int_ior" value="1.3"/></bsdf>',
          '<bsdf type="null"/>'),),
    ),
    # Normals far from those of the facets, on a surface that lets light through.
    "bent glass": Case(
        "checks/smooth_normals.xml", _CHECK,
        (('<bsdf type="diffuse"><rgb name="reflectance" value="0.8, 0.6, 0.4"/></bsdf>',
          '<bsdf type="dielectric"/>'),),
    ),
    # Light of one scattering alone, nearly: it grows with the extinction.
    "thin fog": Case(
        "checks/null_medium.xml", ("--width", "32", "--height", "32", "--spp", "2048"),
        (('"fov" value="40"', '"fov" value="14"'),
         ('target="0, 0.8, 0"', 'target="-0.7, 1, 0.2"'),
         ('"sigma_t" value="1.5"', '"sigma_t" value="0.2"'),
         ('"radiance" value="0.5, 0.6, 0.7"', '"radiance" value="0"'),
         *((f'"reflectance" value="{rgb}"', '"reflectance" value="0"')
           for rgb in ("0.5, 0.5, 0.4", "0.8, 0.2, 0.1", "0.1, 0.3, 0.8"))),
    ),
    # Batch means below 0 count as invalid: long batches.
    "mitchell": Case(
        "checks/mitchell.xml",
        ("--width", "32", "--height", "32", "--spp", "4096", "--batches", "16"),
    ),
    "lanczos": Case(
        "checks/mitchell.xml",
        ("--width", "32", "--height", "32", "--spp", "4096", "--batches", "16"),
        (('<rfilter type="mitchell"/>', '<rfilter type="lanczos"/>'),),
    ),
    # The first of two surfaces in one place is the one that is seen.
    "two floors": Case("checks/smooth_normals.xml", _CHECK, hidden=(("</scene>", _SECOND_FLOOR),)),
}  # fmt: skip

_PATH, _VERTEX, _DIRECT, _BLEND, _RAY_MEDIA = (
    f"integrators/{n}.h" for n in ("path", "vertex", "direct", "blend", "ray_media")
)
_SURFACE, _BSDF = "integrators/surface.h", "bsdfs/bsdf.h"
_DIFFUSE, _DIELECTRIC, _PLASTIC, _SUM = (
    f"bsdfs/{n}.h" for n in ("diffuse", "dielectric", "plastic", "sum")
)
_THIN, _METAL = "bsdfs/thin_dielectric.h", "bsdfs/conductor.h"
_ROUGH_METAL, _ROUGH_PLASTIC, _ROUGH_GLASS = (
    f"bsdfs/rough_{n}.h" for n in ("conductor", "plastic", "dielectric")
)
_LOST, _WHOLE_METAL, _WHOLE_GLASS = (
    f"bsdfs/{n}.h" for n in ("lost_light", "whole_conductor", "whole_dielectric")
)
_PRINCIPLED, _COAT = "bsdfs/principled.h", "bsdfs/clear_coat.h"
_HAIR = "bsdfs/hair.h"
_BURLEYS, _SHEET = "bsdfs/principled_parts.h", "bsdfs/principled_thin.h"
_FACETS, _CLOSURE = "bsdfs/microfacet.h", "bsdfs/closure.h"
_FRESNEL, _MEDIUM, _TABLES = "bsdfs/fresnel.h", "media/medium.h", "scene/surfaces.cpp"
_MEDIA_TABLES = "scene/media.cpp"
_LAMP, _ROUND_LIGHT, _RECTANGLE = (f"lights/{n}.h" for n in ("flat", "sphere", "rectangle"))
_SPOT, _POINT, _PARALLEL = (f"lights/{n}.h" for n in ("spot", "point", "directional"))
_PROJECTOR, _TREE = "lights/projector.h", "lights/tree.h"
_CAMERA, _MAPPING = "camera/perspective.h", "core/mapping.h"
_TEXTURE, _TEXTURING = "textures/texture.h", "integrators/texturing.h"
_GRID, _VOLUMES = "textures/grid.h", "integrators/volumes.h"
_TANGENTS = "integrators/tangents.h"

_EVAL = "p.reflectance * pdf"
_PDF = "row(kLightInverse) * (inverse * inverse) * cos_light"
_Q = "min(F(1.f), to_float(to_uint(min(most, F(1.f)) * F(0x1p24f)) + U(1u)) * F(0x1p-24f))"
_DIVIDE = "path.throughput * (F(1.f) / q)"
_SURVIVE = "plays & (uniform(u) < q)"
_CUT = "deeper(scene, s.max_depth, path, segment, scatters)"
_HIT = "emitted * mis_weight(path.pdf_sa, ratio)"
_NEE = "light.inverse_pdf / fma(ratio, ratio, F(1.f))"
_SKY = "Sampler::sky(Direct::sky_row(scene), path.ray.d, path.ray.o, weight)"
_MET = "Direct::light_pdf(scene, path, prim, {path.ray.o, hit.t, cos_light, chance}, lit)"
_FLIGHT = "select(t < limit, albedo, Spectrum<F>::all(F(1.f)))"
_LIT = "hit_emitter(scene, path, place.hit, at, covered)"
_T_MAX = "shadow.t_max = light.distance;"
_ALBEDO = "m.parameters.reflectance"
_READ = "return m;"
_KEEP = "samples_[c][at[k]] = x[c][k];"
_JITTER_X = "F(0.5f) + filter_offset<L>(scene.filter, uniform(r.x))"
_PHASES = "media/phase.h"
_PHASE = "turned(d, henyey_greenstein(g, u), v)"


def _wall(shape: str, percent: float) -> Mutant:
    return Mutant(f"reflectance of {shape} +{percent} %", shape=shape, factor=1 + percent / 100)


_CORNELL = (
    *(_wall(shape, 0.5) for shape in ("floor", "back_wall", "right_wall", "left_wall")),
    Mutant("MIS weight missing on hit", _VERTEX, _HIT, "emitted"),
    Mutant("MIS weight missing on light sample", _DIRECT, _NEE, "light.inverse_pdf"),
    Mutant("cosine missing in eval", _DIFFUSE, _EVAL, "p.reflectance * F(kInvPi)"),
    Mutant("cosine squared in eval", _DIFFUSE, _EVAL, "p.reflectance * (pdf * cos_i)"),
    Mutant("roulette not divided out", _PATH, _DIVIDE, "path.throughput"),
    Mutant("roulette divided by q squared", _PATH, _DIVIDE,
           "path.throughput * (F(1.f) / (q * q))"),
    Mutant("roulette survives 2 % too rarely", _PATH, _SURVIVE,
           "plays & (uniform(u) < q * F(.98f))"),
    Mutant("light cosine missing", _LAMP, _PDF, "row(kLightInverse) * (inverse * inverse)"),
    Mutant("1/r for 1/r^2", _LAMP, _PDF, "row(kLightInverse) * inverse * cos_light"),
    Mutant("light pdf doubled", _LAMP, _PDF, f"F(.5f) * {_PDF}"),
    Mutant("emission doubled at depth 1", _VERTEX, _LIT,
           f"((void)(segment == 1 ? {_LIT} : valid), {_LIT})"),
    Mutant("samples clamped at 10", "schedulers/tile.h", _KEEP,
           "samples_[c][at[k]] = __builtin_fminf(x[c][k], 10.f * job.film.scale);"),
    Mutant("half-pixel shift", _PATH, _JITTER_X, _JITTER_X.replace("0.5f", "1.0f")),
    Mutant("albedo +1 %", _SURFACE, _READ,
           f"{{ {_ALBEDO} = {_ALBEDO} * F(1.01f); return m; }}"),
    Mutant("albedo +0.2 %", _SURFACE, _READ,
           f"{{ {_ALBEDO} = {_ALBEDO} * F(1.002f); return m; }}"),
    Mutant("albedo +1 % in the weight only", _DIFFUSE, "s.weight = p.reflectance;",
           "s.weight = p.reflectance * F(1.01f);"),
    Mutant("one segment more", _PATH, _CUT,
           "deeper(scene, s.max_depth + 1, path, segment, scatters)", "depth 3"),
    Mutant("one segment less", _PATH, _CUT,
           "deeper(scene, s.max_depth - 1, path, segment, scatters)", "depth 3"),
    Mutant("no light sample at the last vertex", _DIRECT, _T_MAX,
           _T_MAX + " if (segment + 2 >= s.max_depth) shadow.wanted = no_lanes(shadow.wanted);",
           "depth 3"),
    Mutant("back of the lamp emits when hit", _VERTEX, "valid & at.front & (chance > F(0.f))",
           "valid & (chance > F(0.f))", "lowered lamp",
           also=(("-dot(at.ng, path.ray.d)", "abs(dot(at.ng, path.ray.d))"),)),
    # The ray is shortened, or the lamp would shadow its own back.
    Mutant("back of the lamp emits when sampled", _LAMP, "-dot(n, s.wi)",
           "(s.distance = s.distance * select(dot(n, s.wi) > F(0.f), F(.99f), F(1.f)),"
           " abs(dot(n, s.wi)))", "lowered lamp"),
    Mutant("no 1/pi", _DIFFUSE, _EVAL, "p.reflectance * cos_i", "quick"),
    Mutant("albedo squared", _SURFACE, _READ,
           f"{{ {_ALBEDO} = {_ALBEDO} * {_ALBEDO}; return m; }}", "quick"),
    Mutant("hemisphere of half the azimuth", _MAPPING,
           "sincos_2pi(v, s, c); const F r = sqrt(u); return {r * c, r * s, sqrt(F(1.f) - u)};",
           "sincos_2pi(v * F(.5f), s, c); const F r = sqrt(u); "
           "return {r * c, r * s, sqrt(F(1.f) - u)};", "quick"),
    Mutant("u = v on the lamp", _DIRECT, "uniform(scatter.y)", "uniform(scatter.x)", "quick"),
    Mutant("roulette and direction share a number", _PATH,
           "random_block(s.key, path.pixel, path.sample, dimension_block(segment, kDecide)).y",
           "random_block(s.key, path.pixel, path.sample, dimension_block(segment, kScatter)).z",
           "quick"),
    Mutant("shadow rays meet nothing", _DIRECT, _T_MAX, "shadow.t_max = F(0.f);", "quick"),
    Mutant("shadow rays half as long", _DIRECT, _T_MAX,
           "shadow.t_max = light.distance * F(.5f);", "quick"),
    Mutant("roulette one vertex early", _PATH, "segment + 1 < s.rr_depth",
           "segment + 2 < s.rr_depth", "quick"),
    Mutant("roulette capped at 0.5", _PATH, _Q, _Q.replace("min(F(1.f), to", "min(F(.5f), to"),
           "quick"),
    Mutant("picture mirrored", _PATH,
           "camera_point(scene.camera, px, py, dx, dy)", "camera_point("
           "scene.camera, F(float(width)) - F(1.f) - px, py, dx, dy)", "quick"),
)  # fmt: skip

_MATERIALS = (
    Mutant("index not inverted from inside", _DIELECTRIC, "F(1.f) / p.eta[0]", "p.eta[0]",
           "dielectric_sphere"),
    Mutant("no total reflection", _FRESNEL, "select(total & !(eta == F(1.f)), F(1.f), r)",
           "select(total, F(0.f), r)", "glass_cube"),
    Mutant("Fresnel of one polarisation", _FRESNEL, "F(0.5f) * fma(s, s, p * p)", "s * s",
           "dielectric_sphere"),
    Mutant("reflection chosen 2 % too often", _DIELECTRIC, "r.lobe < view.fresnel.reflected",
           "r.lobe < view.fresnel.reflected + F(.02f)", "dielectric_sphere"),
    Mutant("radiance not scaled on refraction", _DIELECTRIC,
           "F(1.f) / (view.relative * view.relative)", "F(1.f)", "lamp_in_medium"),
    Mutant("tint of refraction left out", _DIELECTRIC,
           "p.specular_transmittance * compression(view)",
           "S::all(compression(view))", "dielectric_sphere"),
    Mutant("thin slab of one surface", _THIN, "(r + r) / (F(1.f) + r)", "r", "thindielectric"),
    Mutant("thin slab clear to light samples", _THIN,
           "p.specular_transmittance * (F(1.f) - view.fresnel.reflected)", "S::all(F(1.f))",
           "thindielectric"),
    Mutant("plastic's base lit through no coat", _PLASTIC,
           "(entering(view, cos_i) * part.share)", "(part.share)", "plastic"),
    Mutant("plastic's base seen through no coat", _PLASTIC,
           "(entering(view, cos_i) * part.share)", "(entering(view, cos_i))", "plastic"),
    Mutant("choice of plastic's base left out of its density", _PLASTIC, "pdf * part.chance",
           "pdf", "plastic of high index"),
    Mutant("lobes not weighed by how often they are chosen", _SUM,
           "one.weight = one.weight * (part.share / part.chance)", "one.weight = one.weight",
           "plastic"),
    Mutant("plastic's base sampled through no coat", _PLASTIC,
           "p.reflectance * entering(view, cos_i)", "p.reflectance",
           "plastic"),
    Mutant("no reflection within plastic", _TABLES,
           "once_for(diffuse_reflectance_inside, eta)", "0.0", "plastic"),
    Mutant("tables of another coat taken", "scene/kept.h", "values_.find(key)",
           "values_.lower_bound(key)", "rough_plastic"),
    Mutant("plastic never nonlinear", _TABLES, "in.nonlinear.data[m] ? rho : 1", "1",
           "plastic_nonlinear"),
    Mutant("mirror with a density for the heuristic", _METAL,
           "return delta(reflected(wo, view.n, view.cos_o), albedo(p, view), nobody);",
           "{ Sample s = delta(reflected(wo, view.n, view.cos_o), albedo(p, view), nobody);"
           " s.pdf_sa = F(1.f); return s; }", "conductor_mirror"),
    Mutant("conductor without k", _FRESNEL, "k * k", "F(0.f)", "conductor_metal"),
    Mutant("mask's opacity inverted", _VERTEX, "thin & !(uniform(u) < opacity)",
           "thin & (uniform(u) < opacity)", "mask"),
    Mutant("mask's opacity inverted for light samples", _DIRECT, "F(1.f) - opacity", "opacity",
           "mask"),
    Mutant("one-sided materials reflect on both sides", _TABLES,
           "in.two_sided.data[m] || closure.lets_through()", "true", "twosided"),
    Mutant("pass counted as a vertex", _PATH,
           "select(pass, path.vertices, path.vertices + U(1u))", "path.vertices + U(1u)",
           "mask, depth 3"),
    Mutant("pass forgets the density", _PATH, "select(pass, path.pdf_sa, next.pdf_sa)",
           "next.pdf_sa", "mask"),
    Mutant("way before a pass forgotten, flat lamp", _VERTEX, _MET,
           _MET.replace("hit.t", "hit.t - path.travelled"), "lamp_in_medium"),
    Mutant("way before a pass forgotten, sphere lamp", _VERTEX, _MET,
           _MET.replace("path.ray.o", "fma(path.ray.d, path.travelled, path.ray.o)"),
           "sphere lamp in fog"),
)  # fmt: skip

_ROUGH = (
    Mutant("slopes of GGX without their square", _FACETS, "F(1.f) / (q * q)", "F(1.f) / q",
           "rough_metal"),
    Mutant("slopes of Beckmann half as steep", _FACETS, "exp_minus(slope2 / z2)",
           "exp_minus(F(4.f) * slope2 / z2)", "rough_metal"),
    Mutant("light not hidden by small mirrors", _FACETS,
           "d * masking * lit * cos_i", "d * masking", "rough_metal"),
    Mutant("sampled light not hidden by small mirrors", _FACETS,
           "lit * masking / chance", "masking / chance", "rough_metal"),
    Mutant("opposite slopes at even chances", _FACETS, "(at < one_way) | !(other > none)",
           "coin < F(0.5f)", "rough_metal"),
    Mutant("density of visible slopes for Beckmann", _FACETS,
           "F(1.f) / max(wo.z, F(0.5f) * (wo.z + tilt))", "masking", "rough_metal"),
    Mutant("cap of GGX not about the stretched direction", _FACETS,
           "fma(r, cosine, w.x)", "r * cosine", "rough_metal"),
    Mutant("small mirrors reflect as the surface would", _ROUGH_METAL,
           "colour(p, one.cosine) * one.f_cos", "colour(p, view.cos_o) * one.f_cos", "rough_metal"),
    Mutant("density of light samples for rough metal doubled", _FACETS,
           "d * facets.drawn(o, m, masking)", "F(2.f) * d * facets.drawn(o, m, masking)",
           "rough_metal"),
    Mutant("rough base seen through no coat", _ROUGH_PLASTIC, "view.table.transmittance(cos_i)",
           "F(1.f)", "rough_plastic"),
    Mutant("rough coat chosen without its density", _ROUGH_PLASTIC,
           "one.pdf_sa * part.chance", "one.pdf_sa", "rough_plastic"),
    Mutant("rough coat reflects without Fresnel", _ROUGH_PLASTIC,
           "one.f_cos * reflectance(view, one.cosine)", "one.f_cos", "rough_plastic"),
    Mutant("table of rough coats one step off", _CLOSURE, "to_uint(min(x, F(kCoatCells - 1.f)))",
           "to_uint(max(x - F(1.f), F(0.f)))", "rough_plastic"),
    Mutant("nothing sent back inside a rough coat", _TABLES, "sum / (kCoatCells + 1)", "0.0",
           "rough_plastic"),
    Mutant("shadows across rough glass as on one side", _FACETS,
           "select(mirror, one / fma(b, one - a, a), open_both_ways(a, b))",
           "one / fma(b, one - a, a)",
           "rough_shadows"),
    Mutant("light lost by a rough metal tinted once", _WHOLE_METAL, "once * once * (F(1.f) - mean)",
           "once * (F(1.f) - mean)", "rough_whole"),
    Mutant("light lost by a rough metal drawn evenly", _LOST,
           "cosine = sqrt(c2)", "cosine = sqrt(F(1.f) - u)", "rough_whole"),
    Mutant("light lost by rough glass counted as from in front", _WHOLE_GLASS,
           "select(front, U(kLostAtCosine), U(kLostBehind))", "U(kLostAtCosine)", "rough_whole"),
    Mutant("mean of lost light without its cosine", "scene/lost_light.cpp", "2 * c * slope",
           "slope", "rough_whole"),
    Mutant("light behind rough glass left out", _BLEND, "a.lit = a.lit | a.behind;",
           "a.lit = a.lit;", "rough_glass"),
    Mutant("light behind rough glass not compressed", _ROUGH_GLASS,
           "(squared(view) * compression(view))", "(squared(view))", "rough_glass"),
    Mutant("refraction at small mirrors not compressed", _ROUGH_GLASS,
           "F(1.f) / squared(view)", "F(1.f)", "rough_glass"),
    Mutant("density of refraction at small mirrors lacks the index", _ROUGH_GLASS,
           "select(mirror, F(1.f), squared(view))", "F(1.f)", "rough_glass"),
    Mutant("shadow rays behind rough glass start in front", _DIRECT,
           "select(lanes, at.behind, shadow.ray.o)", "at.p", "rough_glass"),
    Mutant("light behind rough glass takes the medium in front", _DIRECT,
           "select(lanes, at.beyond, shadow.medium)", "shadow.medium", "medium_in_rough_glass"),
)  # fmt: skip

_BRUSHED = (
    Mutant("brushed along v", _FACETS, "select(turned, view.tangent, f.a)",
           "select(turned, cross(f.n, view.tangent), f.a)", "brushed",
           also=(("select(turned, cross(f.n, view.tangent), f.b)",
                  "select(turned, view.tangent, f.b)"),)),
    Mutant("brushed whichever way the normal asks", _FACETS, "select(turned, view.tangent, f.a)",
           "f.a", "brushed", also=(("select(turned, cross(f.n, view.tangent), f.b)", "f.b"),)),
    Mutant("anisotropy of principled surfaces left out", _BURLEYS,
           "sqrt(fma(F(-0.9f), p.anisotropic, F(1.f)))", "F(1.f)", "brushed"),
    Mutant("normal map's y the other way", _TANGENTS, "cross(ns, s)", "cross(s, ns)", "relief"),
    Mutant("heights twice as steep along u", _TANGENTS, "tilted(d.u, rise_u)",
           "tilted(d.u, F(2.f) * rise_u)", "relief"),
    Mutant("heights of spheres not by their radius", _TANGENTS, "of_u[3] * F(kInvPi)",
           "F(kInvPi)", "relief"),
    Mutant("no shadows at grazing angles", _TANGENTS, "min(slope, F(1.f))", "F(0.f)", "relief"),
    Mutant("turned normals see below the surface", "bsdfs/relief.h",
           "select(both, left, F(0.f))", "left", "relief"),
    Mutant("mirror image from behind left out", _TANGENTS,
           "behind & has(kReliefMirrored)", "behind & !behind", "relief"),
)  # fmt: skip

_BURLEY = (
    Mutant("retro-reflection left out", _BURLEYS, "retro * fma(o5 * i5, retro - one, o5 + i5)",
           "F(0.f)", "principled_surfaces"),
    Mutant("sheen without the base's hue", _PRINCIPLED, "mix(one, tint[k], p.sheen_tint)", "one",
           "principled_surfaces"),
    Mutant("flatness left out", _BURLEYS, "mix(rough, soft, p.flatness)", "rough",
           "principled_surfaces"),
    Mutant("sheen of the diffuse share alone", _PRINCIPLED, "p.sheen * shut * grazing(im) * cos_i",
           "p.sheen * base * grazing(im) * cos_i"),
    Mutant("metal without Schlick's rise", _PRINCIPLED, "mix(c, one, slant)", "c",
           "principled_surfaces"),
    Mutant("clear coat twice as strong", _PRINCIPLED, "F(0.25f) * p.clearcoat * mix(F(0.04f), one,"
           " slant)", "F(0.5f) * p.clearcoat * mix(F(0.04f), one, slant)", "principled_surfaces"),
    Mutant("clear coat drawn as if half as glossy", _COAT, "log(a2) * (u - F(1.f))",
           "F(0.5f) * log(a2) * (u - F(1.f))", "principled_surfaces"),
    Mutant("principled lobes chosen without their density", _PRINCIPLED,
           "fma(chosen.diffuse, cosine_hemisphere_pdf_sa(cos_i), "
           "chosen.coat * coat * m.z * F(0.25f) / im)",
           "fma(one, cosine_hemisphere_pdf_sa(cos_i), chosen.coat * coat * m.z * F(0.25f) / im)",
           "principled_surfaces"),
    Mutant("principled glass passes the base colour, not its root", _PRINCIPLED,
           "open * (one - r) * sqrt(c) * compression(view)",
           "open * (one - r) * c * compression(view)", "principled_glass"),
    Mutant("principled glass not compressed", _PRINCIPLED, "F(1.f) / squared(view)", "F(1.f)",
           "principled_glass"),
    Mutant("chance of principled refraction left out of its density", _PRINCIPLED,
           "select(up, one - through, through)", "one", "principled_glass"),
    Mutant("principled glass diffuse from behind", _PRINCIPLED, "up & front", "up",
           "principled_glass"),
    Mutant("sheet sends on light as wide as it mirrors it", _SHEET, "p.roughness * wide",
           "p.roughness", "thin_sheets"),
    Mutant("sheet's mirrors send light to their own near side", _SHEET,
           "select(dot(i, h) < none, lit * (one - r), none)", "lit * (one - r)", "thin_sheets"),
    Mutant("sheet's diffuse light behind not halved", _SHEET, "F(0.5f) * p.diff_trans",
           "p.diff_trans", "thin_sheets"),
    Mutant("sheet's mirrors weighed by the other side's chance", _SHEET,
           "select(up, chosen.mirror, chosen.through)", "chosen.mirror", "thin_sheets"),
)  # fmt: skip

_MEDIA = (
    Mutant("albedo of a medium squared", _MEDIUM, _FLIGHT,
           _FLIGHT.replace("albedo", "albedo * albedo"), "null_medium"),
    Mutant("albedo of a medium left out", _MEDIUM, _FLIGHT, "Spectrum<F>::all(F(1.f))",
           "null_medium"),
    Mutant("albedo of a coloured medium left out", _MEDIUM, "density * albedo", "density",
           "chromatic_medium"),
    Mutant("scattering for extinction", _MEDIA_TABLES, "put(kMediumSigma + k, scaled);",
           "put(kMediumSigma + k, scaled * static_cast<double>(in.albedo.data[3 * (m - 1) + k]));",
           "null_medium"),
    Mutant("free flight 2 % short", _MEDIUM, "exponential(flight)", "F(.98f) * exponential(flight)",
           "thin fog"),
    Mutant("channels weighted evenly, chosen by throughput", _MEDIUM, "inner(w, density)",
           "sum(density) * F(1.f / 3.f)", "chromatic_medium"),
    Mutant("Rayleigh's phase function drawn evenly", _PHASES,
           "fma(t, fma(t, F(0.1127f), F(0.23f)), F(0.6654f))", "F(1.f)", "rayleigh_air",
           also=(("k < 2", "k < 0"),)),
    Mutant("table of a phase function read from its end", _PHASES, "cosine + F(1.f)",
           "F(1.f) - cosine", "blended_fog"),
    Mutant("shares of a blended phase function left out of its sum", _PHASES,
           "fma(column(view, lobe, kLobeShare), value, sum.value)", "value + sum.value",
           "blended_fog"),
    Mutant("phase sampled for -g", _PHASES, _PHASE, _PHASE.replace("(g", "(-g"),
           "hg_forward"),
    Mutant("phase of light samples for -g", _DIRECT,
           "at.phase.eval(scene.phases, path.ray.d, light.wi, active & !at.surface)",
           "at.phase.eval(scene.phases, -path.ray.d, light.wi, active & !at.surface)",
           "hg_forward"),
    Mutant("phase isotropic for the heuristic", _VERTEX,
           "select(collided, drawn.pdf_sa, next.pdf_sa)",
           "select(collided, F(0.25f * kInvPi), next.pdf_sa)",
           "hg_forward"),
    Mutant("no transmittance to the light", _RAY_MEDIA,
           "transmittance(extinction(scene, shadow.medium, shadow.ray.d), distance)",
           "S::all(F(1.f))", "null_medium"),
    Mutant("medium of the wrong side", _RAY_MEDIA, "select(at.front, inside, outside)",
           "select(at.front, outside, inside)", "null_medium"),
    Mutant("medium kept on refraction", _PATH, "medium_beyond(scene, path, hit, at, through)",
           "medium_beyond(scene, path, hit, at, pass)", "medium_in_glass"),
    Mutant("medium kept by shadow rays", _DIRECT, "medium_beyond(scene, shadow, hit, at, todo)",
           "shadow.medium", "point_in_medium"),
    Mutant("albedo of a grid left out", _VERTEX, "path.throughput * albedo",
           "path.throughput", "albedo_grid"),
    Mutant("cells not mixed along x", _GRID, "start + x.second", "start + x.first", "albedo_grid"),
    Mutant("cells not mixed along y", _GRID, "y.second * width",
           "y.first * width", "albedo_grid"),
    Mutant("real collisions 5 % too rare", _VOLUMES, "below(r.y, r.z, share)",
           "below(r.y, r.z, F(.95f) * share)", "smoke"),
    Mutant("flights go on from the box's edge", _VOLUMES, "p.enter + way", "way", "smoke"),
    Mutant("every second step of a shadow ray without effect", _VOLUMES,
           "select(flying, through * rest, through)",
           "select(flying & ((random.step & U(1u)) == U(0u)), through * rest, through)", "smoke"),
    Mutant("roulette of shadow rays not divided out", _VOLUMES, "through * F(2.f)", "through",
           "smoke"),
    Mutant("half of a grid's box empty", "scene/grids.cpp", "put(kGridHigh + k, o[c] + above)",
           "put(kGridHigh + k, o[c] + 0.5 * above)", "smoke"),
)  # fmt: skip

_LIGHTS = (
    Mutant("sphere light's density halved", _ROUND_LIGHT, "F(2.f * kPi) * open",
           "F(4.f * kPi) * open", "sphere_light"),
    Mutant("sphere light's density halved when hit", _ROUND_LIGHT,
           "uniform_cone_pdf_sa(SphereView<F>(record, p).one_minus_cos)",
           "F(.5f) * uniform_cone_pdf_sa(SphereView<F>(record, p).one_minus_cos)",
           "sphere_light"),
    # Uniform on the cap that p sees; the density stays that of the cone.
    Mutant("sphere light sampled by area", _ROUND_LIGHT, "uniform_cone(u, v, open)",
           "[&] { const F r = F(record[6]) / d, c = F(1.f) - u * (F(1.f) - r);"
           " const F along = F(1.f) - r * c, s2 = r * r * (F(1.f) - c * c);"
           " const F z = along / sqrt(along * along + s2);"
           " return uniform_cone((F(1.f) - z) / open, v, open); }()", "sphere_light"),
    Mutant("chance of a lamp left out when hit", _DIRECT,
           "pdf.over * chance(scene, path, as_uint(row_of(scene, row)(kLightLeaf)), competes)",
           "pdf.over", "spheres_300"),
    Mutant("rectangle by area, weighted by solid angle", _RECTANGLE, "view.sample(u, v, a, b);",
           "a = u; b = v;", "near_lamps"),
    Mutant("rectangle's density by area when hit", _RECTANGLE,
           "return {select(by_angle, F(1.f), by_area.over),"
           " select(by_angle, row(kLightInverse) * view.share(), by_area.under)};",
           "return by_area;", "near_lamps"),
    Mutant("rectangle's solid angle 2 % too large", _RECTANGLE,
           "strip(x0 + F(1.f), y0, y1, z) - first",
           "F(1.02f) * (strip(x0 + F(1.f), y0, y1, z) - first)", "near_lamps"),
    Mutant("rectangle uniform along its second edge", _RECTANGLE,
           "h * sqrt(square / ((one - h) * (one + h)))", "fma(v, height, y0)", "near_lamps"),
    Mutant("rectangle with the area of its half", "scene/rectangles.cpp",
           "light.area += area_of(in, next);", "(void)next;", "near_lamps"),
    Mutant("spot without falloff", _SPOT,
           "max(min(edge, F(1.f)), F(0.f))", "select(edge > F(0.f), F(1.f), F(0.f))",
           "spot_light"),
    Mutant("spot's falloff linear in the squared angle", _SPOT,
           "(row(kSpotCutoff) - off) * row(kSpotInverse)",
           "(row(kSpotCutoff) * row(kSpotCutoff) - off * off) * row(kSpotInverse) /"
           " (F(2.f) * row(kSpotCutoff) - F(1.f) / row(kSpotInverse))", "spot_light"),
    Mutant("point light by 1/r", _POINT, "row.radiance() * (inverse * inverse)",
           "row.radiance() * (F(1.f) / distance)", "point_light"),
    Mutant("light without its chance", _DIRECT, "light.inverse_pdf / chance", "light.inverse_pdf",
           "spot_light"),
    Mutant("one light chosen, the chance of another", _TREE,
           "branch = select(here, first + U(k), branch);",
           "branch = select(here, first + U(s.n - 1u - k), branch);", "spot_light"),
    Mutant("lights behind a pane have no chance", _DIRECT,
           "select(both, U(kBothSides), U(kOneSide))", "U(kOneSide)", "rough_glass"),
    Mutant("lights without a chance where the normal looks away from the middle", _TREE,
           "cosine_less(select(at.both, abs(up), up), cosine, sine)", "up", "spheres_300"),
    Mutant("sky weighted as if it were sampled too", _VERTEX, _SKY,
           f"{_SKY} * mis_weight(path.pdf_sa, F(0.25f * kInvPi))", "null_medium"),
    Mutant("disk light with the area of its box", "scene/rectangles.cpp",
           "kPi * length(cross(a, b))", "4 * length(cross(a, b))", "disk_light"),
    Mutant("disk mapped without the root", _MAPPING, "x = r * c; y = r * s;",
           "x = u * c; y = u * s;", "disk_light"),
)  # fmt: skip

_TEXTURES = (
    Mutant("texture upside down", _TEXTURE, "taps(v, height, traits)",
           "taps(F(1.f) - v, height, traits)", "textures"),
    Mutant("repeated texture is mirrored", _TEXTURE, "x - floor(x)",
           "min(turn, F(2.f) - turn)", "textures"),
    Mutant("mirrored texture is repeated", _TEXTURE, "min(turn, F(2.f) - turn)",
           "x - floor(x)", "textures"),
    Mutant("clamped texture is repeated", _TEXTURE, "min(max(x, zero), one)", "x - floor(x)",
           "textures"),
    Mutant("texels half a texel off", _TEXTURE, "select(nearest, zero, F(-0.5f))", "zero",
           "textures"),
    Mutant("weights of texels swapped", _TEXTURE, "select(nearest, zero, place - below)",
           "select(nearest, zero, above - place)", "textures"),
    Mutant("sRGB taken for linear", _TEXTURE, "select(is(traits, kTraitSrgb), U(0u), U(256u))",
           "U(256u)", "textures"),
    Mutant("linear taken for sRGB", "scene/textures.cpp", "format == kSrgb8",
           "format <= kLinear8", "textures"),
    Mutant("checkerboard of one half", _TEXTURE, "(a & b) | !(a | b)", "a & b", "textures"),
    Mutant("texture turns the other way about a sphere", _TEXTURING,
           "dot(cross(b, a), outward) * last", "dot(cross(a, b), outward) * last", "textures"),
    Mutant("triangle's texture coordinates turned", "scene/textures.cpp",
           "cross(e2, m) * (value[1] - value[0])", "cross(e2, m) * (value[2] - value[0])",
           "textures"),
    Mutant("texture of a lamp left out of light samples", _DIRECT,
           "lanes & Sampler::template any_of<kLampShapes>(row, no_lanes(lanes))",
           "no_lanes(lanes)",
           "textured_lamps"),
    Mutant("texture of a lamp left out where it is met", _VERTEX,
           "Reader::Texturing::multiply(scene, index, at.uv, lit, emitted);",
           "Reader::Texturing::multiply(scene, index, at.uv, no_lanes(lit), emitted);",
           "textured_lamps"),
    Mutant("texture of a ball that shines turned round where it is sampled", _ROUND_LIGHT,
           "select(across, at.cos_light, -at.cos_light)",
           "select(across, -at.cos_light, at.cos_light)", "textured_lamps"),
    Mutant("image of a light off by a tenth of its height", _POINT,
           "v = fma(dot(row.vector(column_v), wi), ahead, F(0.5f));",
           "v = fma(dot(row.vector(column_v), wi), ahead, F(0.6f));", "projected_images"),
    Mutant("projector by the square of the cosine", _PROJECTOR,
           "one / (cosine * cosine * cosine)", "one / (cosine * cosine)", "projected_images"),
    Mutant("projector's picture repeated beyond its edge", _PROJECTOR, "(u <= one)",
           "(u <= one + one)", "projected_images"),
)  # fmt: skip

_BLENDS = (
    Mutant("blend's weight inverted", _BLEND, "blended & (u < weight)",
           "blended & (u >= weight)", "blends"),
    Mutant("blend's weight inverted for shadows", _DIRECT,
           "left * (F(1.f) - weight)", "left * weight", "blends"),
    Mutant("density of a blend without its other materials", _BLEND,
           "fma(one.value.pdf_sa, share, all.value.pdf_sa)", "all.value.pdf_sa", "blends"),
    Mutant("light on a blend by its chosen material alone", _BLEND,
           "fma(one.value.f_cos, share, all.value.f_cos)", "all.value.f_cos", "blends"),
    Mutant("blend by the number that the mask takes", _BLEND,
           "blended & (u < weight)",
           "blended & (uniform(random_block(s.key, path.pixel, path.sample, "
           "dimension_block(segment, kCross)).z) < weight)", "blends"),
    Mutant("attribute's corners turned", "scene/textures.cpp", "through(f, value)",
           "through(f, {value[0], value[2], value[1]})", "attributes"),
    Mutant("attribute of faces by vertices", "scene/textures.cpp",
           "rows[3 * size_t{s.row} + k]", "rows[3 * size_t{s.row / 2} + k]", "attributes"),
    Mutant("attribute's greatest value for its least", _TEXTURE, "max(x, number(4))",
           "max(x, number(5))", "attributes"),
)  # fmt: skip

_GEOMETRY = (
    Mutant("lens of double size", _CAMERA, "uniform_disk(u, v, x, y);",
           "uniform_disk(u, v, x, y); x = x + x; y = y + y;", "thinlens"),
    Mutant("focus 2 % too far", _CAMERA, "fma(at, F(c.focus), -o)",
           "fma(at, F(c.focus) * F(1.02f), -o)", "lens from near"),
    Mutant("mitchell's negative lobes positive", "film/filter.h",
           "select(x < F(2.f), cubic(f.far), none)", "select(x < F(2.f), abs(cubic(f.far)), none)",
           "mitchell"),
    Mutant("lanczos without its window", "film/filter.h",
           "narrow * wide / (away * away)", "narrow * F(f.slope * 2.f * kPi) / away", "lanczos"),
    Mutant("mitchell's lobes of the wrong weight", "scene/camera.cpp", "sum += parts[i];",
           "sum += std::abs(parts[i]);", "mitchell"),
    Mutant("cosine to the geometric normal in light samples", _BLEND, "dot(at.ns, wi)",
           "dot(at.ng, wi)", "smooth_normals"),
    Mutant("smooth lobe about the geometric normal", _BLEND,
           "bsdf.set_view(ns, cos_o, at.front);",
           "bsdf.set_view(ng, cos_o, at.front);", "smooth_normals"),
    Mutant("interpolated normal not normalised", _SURFACE, "ns * (F(1.f) / sqrt(d2))", "ns",
           "bent glass"),
    Mutant("front told by the shading normal", _SURFACE, "dot(at.ng, ray.d) < F(0.f)",
           "dot(at.ns, ray.d) < F(0.f)", "bent glass"),
    Mutant("side of a direction told by the shading normal", _VERTEX,
           "dot(place.vertex.ng, next.wi)", "dot(place.vertex.ns, next.wi)", "glass_mesh"),
    Mutant("sphere's side ignored", _SURFACE, "s.n * primitive_column(scene, prim, kPrimSide)",
           "s.n", "flip_normals"),
    Mutant("sphere's normal always towards the ray", _SURFACE,
           "s.n * primitive_column(scene, prim, kPrimSide)",
           "s.n * select(dot(s.n, ray.d) < F(0.f), F(1.f), F(-1.f))", "dielectric_sphere"),
    Mutant("disk's half axes of one length", "scene/scene.cpp",
           "cross(n, a) * (1 / (area * area))",
           "cross(n, a) * (length(b) / length(a) / (area * area))", "disk_ellipse"),
    Mutant("ties to the last primitive", "geometry/bvh.h",
           "(t == hit.t) & (primitive < hit.primitive)",
           "(t == hit.t) & (hit.primitive < primitive)",
           "two floors"),
)  # fmt: skip

_FIBRES = (
    Mutant("light through a fibre twice as wide along it", _HAIR, "F(0.25f) * p.hair_along",
           "F(0.5f) * p.hair_along", "hair"),
    Mutant("Fresnel of a fibre as from within", _HAIR, "fresnel_dielectric(min(o.z, one), eta)",
           "fresnel_dielectric(min(o.z, one), one / eta)", "hair"),
    Mutant("light in a fibre absorbed on half its way", _HAIR, "F(2.f) * within * eta / rest",
           "within * eta / rest", "hair"),
    Mutant("lobes of a fibre chosen evenly", _HAIR, "r.lobe < before + chances[lobe]",
           "r.lobe < F(0.25f * static_cast<float>(lobe + 1))", "hair"),
    Mutant("light through a fibre tilted the other way", _HAIR, "sines[1] = s, cosines[1] = c;",
           "sines[1] = -s, cosines[1] = c;", "hair"),
)  # fmt: skip

#: The bugs that the verdict against the reference must find, in this order.
MUTANTS = (*_CORNELL, *_MATERIALS, *_ROUGH, *_BRUSHED, *_BURLEY, *_MEDIA, *_LIGHTS, *_TEXTURES,
           *_BLENDS, *_GEOMETRY, *_FIBRES)  # fmt: skip
