"""Reading of the Mitsuba 3 plugins that veriray's scenes use.

Source: Mitsuba 3 documentation, "Plugin reference"; what the pages leave open (mirrored transforms,
defaults) was measured with mitsuba 3.9.1. Beyond Mitsuba: ``sigma_s`` with ``sigma_a`` in a
homogeneous medium, ``ext_eta`` of a conductor, <rgb> media above 1.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from lxml import etree

from reference import shapes, textures
from reference.grids import Grid, read_vol
from reference.hair import EUMELANIN, PHEOMELANIN
from reference.phases import Blend, Flakes, HenyeyGreenstein, Phase, Rayleigh, Tabulated
from reference.principled import SHARES
from reference.principled_thin import SHARES as SHEET_SHARES
from reference.relief import Relief
from reference.scene import Camera, Film, Geometry, Light, Material, Medium, Scene, SceneError
from reference.skies import Sky, read_texels
from reference.xml import Document

IOR = {
    "vacuum": 1.0,
    "helium": 1.000036,
    "hydrogen": 1.000132,
    "air": 1.000277,
    "carbon dioxide": 1.00045,
    "water ice": 1.31,
    "water": 1.333,
    "acetone": 1.36,
    "ethanol": 1.361,
    "fused quartz": 1.458,
    "carbon tetrachloride": 1.461,
    "pyrex": 1.47,
    "glycerol": 1.4729,
    "acrylic glass": 1.49,
    "polypropylene": 1.49,
    "benzene": 1.501,
    "bk7": 1.5046,
    "silicone oil": 1.52045,
    "sodium chloride": 1.544,
    "amber": 1.55,
    "pet": 1.575,
    "bromine": 1.661,
    "diamond": 2.419,
}
_NO_LIGHT = Material(reflectance=np.zeros(3))  # of a lamp without a bsdf


@dataclass(frozen=True, eq=False)
class _Shape:
    geometry: Geometry
    material: Material
    radiance: tuple[np.ndarray, textures.Texture | None] | None
    boundary: tuple[int, int] | None


def load(path: str | Path, parameters: Mapping[str, str] | None = None) -> Scene:
    """Read a scene file; ``parameters`` set its ``$names`` (command line: -D name=value)."""
    return _Reader(Path(path), dict(parameters or {})).scene()


class _Reader(Document):
    def scene(self) -> Scene:
        self.media: list[Medium] = []
        self.medium_index: dict[etree._Element, int] = {}
        self.lights: list[Light] = []
        self.environment: np.ndarray | None = None
        self.sky: Sky | None = None
        self.folder = self.path.parent
        sensor: tuple[Camera, Film, int] | None = None
        settings = {"max_depth": -1, "rr_depth": 5, "hide_emitters": False}
        found: list[_Shape] = []
        for element, folder in self.elements(self.root, self.path.parent):
            self.folder = folder
            if element.tag == "integrator":
                self.plugin(element, "path", "volpath")
                values = self.parameters(
                    element,
                    max_depth=self.integer(-1),
                    rr_depth=self.integer(1),
                    hide_emitters=self.boolean,
                )
                settings.update({k: v for k, v in values.items() if k in settings})
            elif element.tag == "sensor":
                if sensor is not None:
                    raise self.error(element, "second sensor")
                sensor = self.sensor(element)
            elif element.tag == "emitter":
                self.emitter(element)
            elif element.tag == "shape":
                found += self.shapes(element)
            elif element.tag == "bsdf":
                self.bsdf(element)  # checked even if nothing uses it
            elif element.tag == "medium":
                self.medium(element)
            else:
                raise self.error(element, f"unknown element <{element.tag}>")
        unknown = set(self.given) - self.used
        if unknown:
            raise SceneError(f"{self.path}: no such parameter: {', '.join(sorted(unknown))}")
        if sensor is None:
            raise SceneError(f"{self.path}: no sensor")
        camera, film, spp = sensor
        return Scene(
            **_tables(found),
            media=tuple(self.media),
            lights=tuple(self.lights),
            environment=self.environment,
            camera=camera,
            film=film,
            spp=spp,
            digest=self.hash.hexdigest(),
            sky=self.sky,
            **settings,
        )

    def elements(self, root: etree._Element, folder: Path) -> list[tuple[etree._Element, Path]]:
        """What the file and its includes hold, with the folder of the file it stands in."""
        out = []
        for child in self.children(root):
            if child.tag == "default":
                self.defaults.setdefault(self.text(child, "name"), self.text(child, "value"))
                self.used.add(child.get("name"))
            elif child.tag == "include":
                path = folder / self.text(child, "filename")
                out += self.elements(self.parse(path), path.parent)
            else:
                out.append((child, folder))
        return out

    # -- sensors and films ---------------------------------------------------------------------

    def sensor(self, element: etree._Element) -> tuple[Camera, Film, int]:
        kind = self.plugin(element, "perspective", "thinlens", "orthographic")
        common = dict(
            to_world=self.transform,
            near_clip=self.number(0),
            far_clip=self.number(0),
            film=self.hdrfilm,
            sampler=self.sampler,
            medium=self.medium,
        )
        if kind == "orthographic":
            values = self.parameters(element, **common)
            camera = Camera(
                to_world=values.get("to_world", np.eye(4)),
                fov=math.nan,
                fov_axis="x",
                near=values.get("near_clip", 0.0),
                far=values.get("far_clip", math.inf),
                medium=values.get("medium", -1),
                parallel=True,
            )
            return camera, values.get("film", Film()), values.get("sampler", 4)
        lens = dict(
            aperture_radius=self.number(0, open_low=True),
            focus_distance=self.number(0, open_low=True),
        )
        offset = dict(
            focus_distance=self.ignore,
            principal_point_offset_x=self.number(),
            principal_point_offset_y=self.number(),
        )
        values = self.parameters(
            element,
            fov=self.number(1e-6, 180 - 1e-6),
            fov_axis=self.choice("x", "y", "diagonal", "smaller", "larger"),
            focal_length=lambda e: self.text(e, "value"),
            **common,
            **(lens if kind == "thinlens" else offset),
        )
        if ("fov" in values) == ("focal_length" in values):
            raise self.error(element, "needs one of fov and focal_length")
        if missing := [k for k in lens if kind == "thinlens" and k not in values]:
            raise self.error(element, f"thinlens needs {' and '.join(missing)}")
        axis = values.get("fov_axis", "x")
        if "fov" not in values:  # millimetres on 36 x 24 film; its fov is along the diagonal
            text = values["focal_length"]
            length = float(text[:-2] if text.endswith("mm") else text)
            values["fov"] = math.degrees(2 * math.atan(math.hypot(36, 24) / 2 / length))
            axis = "diagonal"
        camera = Camera(
            to_world=values.get("to_world", np.eye(4)),
            fov=values["fov"],
            fov_axis=axis,
            near=values.get("near_clip", 0.0),
            far=values.get("far_clip", math.inf),
            principal=(
                values.get("principal_point_offset_x", 0.0),
                values.get("principal_point_offset_y", 0.0),
            ),
            aperture=values.get("aperture_radius", 0.0),
            focus=values.get("focus_distance") or 1.0,
            medium=values.get("medium", -1),
        )
        return camera, values.get("film", Film()), values.get("sampler", 4)

    def sampler(self, element: etree._Element) -> int:
        self.plugin(element, "independent")
        values = self.parameters(element, sample_count=self.integer(1), seed=self.integer(0))
        return values.get("sample_count", 4)

    def hdrfilm(self, element: etree._Element) -> Film:
        self.plugin(element, "hdrfilm")
        values = self.parameters(
            element,
            width=self.integer(1),
            height=self.integer(1),
            rfilter=self.rfilter,
            pixel_format=self.choice("rgb", "rgba"),
            file_format=self.ignore,
            component_format=self.ignore,
            banner=self.ignore,
        )
        kind, parameter = values.get("rfilter", ("gaussian", 0.5))
        return Film(values.get("width", 768), values.get("height", 576), kind, parameter)

    def rfilter(self, element: etree._Element) -> tuple[str, float | tuple[float, float]]:
        kind = self.plugin(element, "box", "tent", "gaussian", "mitchell")
        if kind == "gaussian":
            return kind, self.parameters(element, stddev=self.number(1e-6)).get("stddev", 0.5)
        if kind == "tent":
            return kind, self.parameters(element, radius=self.number(1e-6)).get("radius", 1.0)
        if kind == "mitchell":
            values = self.parameters(element, B=self.number(0, 1), C=self.number(0, 1))
            return kind, (values.get("B", 1 / 3), values.get("C", 1 / 3))
        self.parameters(element)
        return kind, 0.5

    # -- materials and media -------------------------------------------------------------------

    def bsdf(self, element: etree._Element) -> Material:
        kind = self.plugin(
            element, "diffuse", "conductor", "dielectric", "thindielectric", "plastic", "null",
            "mask", "twosided", "blendbsdf", "roughconductor", "roughplastic", "roughdielectric",
            "principled", "principledthin", "hair", "polarizer", "circular", "retarder",
            "bumpmap", "normalmap",
        )  # fmt: skip
        if kind in ("bumpmap", "normalmap"):
            return self.relief(element, kind)
        own = ("mask", "twosided", "blendbsdf", "polarizer", "circular", "retarder")
        if kind in own:
            return getattr(self, kind)(element)
        return Material(**{"kind": kind, **getattr(self, kind)(element)})

    def mask(self, element: etree._Element) -> Material:
        values = self.parameters(element, opacity=self.number(0, 1), bsdf=self.bsdf)
        inner = values.get("bsdf")
        if inner is None or inner.opacity < 1:
            raise self.error(element, "mask needs one bsdf that is no mask")
        if inner.other is not None:
            raise self.error(element, "mask of a blend is not supported")
        return replace(inner, opacity=values.get("opacity", 0.5))

    def polarizer(self, element: etree._Element) -> Material:
        """Half of the light goes straight on; a thin slab of index 1 reflects nothing."""
        return self.filter(element, 0.5)

    circular = polarizer

    def retarder(self, element: etree._Element) -> Material:
        return self.filter(element, 1.0)

    def filter(self, element: etree._Element, share: float) -> Material:
        values = self.parameters(element, transmittance=self.colour(1.0))
        through = share * values.get("transmittance", np.ones(3))
        return Material(kind="thindielectric", eta=np.ones(3), specular_transmittance=through)

    def blendbsdf(self, element: etree._Element) -> Material:
        number = self.number(0, 1)

        def read(e: etree._Element) -> float | textures.Texture:
            return self.texture(e) if e.tag == "texture" else number(e)

        values = self.parameters(element, weight=read, first=self.bsdf, second=self.bsdf)
        if len(values) != 3 or values["first"].other is not None:
            text = "blendbsdf needs a weight, and a first and a second bsdf, which may be a blend"
            raise self.error(element, text)
        return replace(values["first"], other=values["second"], weight=values["weight"])

    def twosided(self, element: etree._Element) -> Material:
        if [child.get("name") for child in element] == ["front", "back"]:
            both = self.parameters(element, front=self.bsdf, back=self.bsdf)
            front, back = (self.on_both(element, both[name]) for name in ("front", "back"))
            return replace(front, other=back, by_side=True)
        return self.on_both(element, self.parameters(element, bsdf=self.bsdf).get("bsdf"))

    def on_both(self, element: etree._Element, inner: Material | None) -> Material:
        """A bsdf of a twosided."""
        if inner is None or inner.opacity < 1 or inner.other is not None:
            raise self.error(element, "twosided needs bsdfs without mask and blend")
        if inner.kind not in ("diffuse", "conductor", "plastic", "roughconductor", "roughplastic",
                              "principled"):  # fmt: skip
            raise self.error(element, f"twosided {inner.kind}: it transmits light")
        if inner.relief is not None:
            inner = replace(inner, relief=replace(inner.relief, mirrored=True))
        return replace(inner, two_sided=True)

    def relief(self, element: etree._Element, kind: str) -> Material:
        """A bsdf with a texture, of any name, that turns normals."""
        inner, found = None, None
        for child in element:
            if child.tag == "bsdf":
                inner = self.bsdf(child)
            elif child.tag == "texture":
                found = self.texture(child)
        rest = [child for child in element if child.tag in ("bsdf", "texture")]
        numbers = {child.get("name"): child.get("value") for child in element
                   if child not in rest and isinstance(child.tag, str)}  # fmt: skip
        known = {"flip_invalid_normals", "use_shadowing_function", "scale"}
        if inner is None or found is None or len(rest) != 2 or not set(numbers) <= known:
            raise self.error(element, f"{kind}: expected a bsdf, a texture and known parameters")
        on = (numbers.get(name) != "false" for name in sorted(known)[:1] + sorted(known)[2:])
        flips, shades = on
        scale = float(numbers.get("scale", 1))
        relief = Relief(kind == "bumpmap", flips, shades, False, scale)
        return replace(inner, relief=relief, relief_texture=found)

    def diffuse(self, element: etree._Element) -> dict:
        colour = self.colour(1.0)

        def read(e: etree._Element) -> np.ndarray | textures.Texture:
            return self.texture(e) if e.tag == "texture" else colour(e)

        values = self.parameters(element, reflectance=read)
        if isinstance(values.get("reflectance"), textures.Texture):
            return {"texture": values["reflectance"], "reflectance": np.ones(3)}
        return values

    def texture(self, element: etree._Element) -> textures.Texture:
        kind = self.plugin(element, "bitmap", "checkerboard", "mesh_attribute")
        if kind == "mesh_attribute":
            values = self.parameters(
                element, name=lambda e: self.text(e, "value"), scale=self.number(0)
            )
            texels = np.full((1, 1, 3), values.get("scale", 1.0))
            return textures.Texture(kind, texels, np.eye(3)[:2], name=values["name"])
        frame = dict(to_uv=self.transform)
        if kind == "checkerboard":
            values = self.parameters(
                element, color0=self.colour(1.0), color1=self.colour(1.0), **frame
            )
            pair = values.get("color0", np.full(3, 0.4)), values.get("color1", np.full(3, 0.2))
            texels = np.array([pair])
        else:
            values = self.parameters(
                element,
                filename=lambda e: self.folder / self.text(e, "value"),
                raw=self.boolean,
                filter_type=self.choice("bilinear", "nearest"),
                wrap_mode=self.choice("repeat", "mirror", "clamp"),
                format=self.ignore,
                accel=self.ignore,
                **frame,
            )
            try:
                data = values["filename"].read_bytes()
                texels = textures.decoded(data, values.get("raw", False))
            except (KeyError, OSError) as error:
                raise self.error(element, f"bitmap: {error}") from error
            self.hash.update(data)
        return textures.Texture(
            kind,
            texels,
            values.get("to_uv", np.eye(4))[:2][:, [0, 1, 3]],
            values.get("wrap_mode", "repeat"),
            values.get("filter_type") == "nearest",
        )

    def null(self, element: etree._Element) -> dict:
        return self.parameters(element)

    def roughness(self, element: etree._Element, values: dict) -> dict:
        """Alpha along and across u; sample_visible changes no expectation."""
        values.pop("sample_visible", None)
        both = values.pop("alpha_u", None), values.pop("alpha_v", None)
        one = values.pop("alpha", None)
        if (one is not None or None in both) and both != (None, None):
            raise self.error(element, "expected alpha, or alpha_u and alpha_v")
        if None in both:
            both = (0.1 if one is None else one,) * 2
        return {**values, "alpha": (max(both[0], 1e-4), max(both[1], 1e-4))}

    def rough(self) -> dict:
        """The parameters of rough materials."""
        alphas = dict.fromkeys(("alpha", "alpha_u", "alpha_v"), self.number(0))
        return {**alphas, "distribution": self.choice("beckmann", "ggx"),
                "shadowing": self.choice("separable", "height_correlated"),
                "sample_visible": self.boolean}  # fmt: skip

    def whole(self, element: etree._Element, values: dict) -> dict:
        """Energy compensation, of one alpha."""
        whole = values.pop("energy_compensation", False)
        if whole and values["alpha"][0] != values["alpha"][1]:
            raise self.error(element, "energy_compensation is for one alpha")
        return {**values, "whole": whole}

    def roughconductor(self, element: etree._Element) -> dict:
        rough = {**self.rough(), "energy_compensation": self.boolean}
        return self.whole(element, self.roughness(element, self.conductor(element, **rough)))

    def roughplastic(self, element: etree._Element) -> dict:
        values = self.roughness(element, self.plastic(element, **self.rough()))
        if values["alpha"][0] != values["alpha"][1]:
            raise self.error(element, "a rough coat has one alpha")
        return values

    def roughdielectric(self, element: etree._Element) -> dict:
        rough = {**self.rough(), "energy_compensation": self.boolean}
        return self.whole(element, self.roughness(element, self.dielectric(element, **rough)))

    def principled(self, element: etree._Element) -> dict:
        numbers = dict.fromkeys(SHARES, self.number(0, 1))
        values = self.parameters(
            element, base_color=self.colour(1.0), eta=self.number(1e-3, 1e3),
            specular=self.number(0, 1), **numbers,
        )  # fmt: skip
        if "eta" in values and "specular" in values:
            raise self.error(element, "expected eta or specular")
        shares = {**SHARES, **{k: v for k, v in values.items() if k in SHARES}}
        specular = values.get("specular", 0.5)
        if shares["spec_trans"] and specular == 0:
            specular = 1e-3
        eta = values.get("eta", 2 / (1 - math.sqrt(0.08 * specular)) - 1)
        if shares["spec_trans"] and eta == 1:
            eta = 1.001
        return {
            "kind": "principled_open" if shares["spec_trans"] else "principled",
            "reflectance": values.get("base_color", np.full(3, 0.5)),
            "eta": np.full(3, eta),
            "shares": shares,
        }

    def principledthin(self, element: etree._Element) -> dict:
        numbers = {k: self.number(0, 2 if k == "diff_trans" else 1) for k in SHEET_SHARES}
        values = self.parameters(
            element, base_color=self.colour(1.0), eta=self.number(1e-3, 1e3), **numbers
        )
        return {
            "reflectance": values.get("base_color", np.full(3, 0.5)),
            "eta": np.full(3, values.get("eta", 1.5)),
            "shares": {**SHEET_SHARES, **{k: v for k, v in values.items() if k in SHEET_SHARES}},
        }

    def hair(self, element: etree._Element) -> dict:
        """On a curve; from within it is not there."""
        number, share = self.number(0), self.number(0.01, 1)
        values = self.parameters(
            element, eumelanin=number, pheomelanin=number, sigma_a=self.colour(), scale=number,
            int_ior=self.ior, ext_ior=self.ior, longitudinal_roughness=share,
            azimuthal_roughness=share, scale_tilt=self.number(-90, 90),
        )  # fmt: skip
        if "sigma_a" in values and values.keys() & {"eumelanin", "pheomelanin"}:
            raise self.error(element, "expected sigma_a, or eumelanin and pheomelanin")
        pigment = EUMELANIN * values.get("eumelanin", 1.3)
        pigment = pigment + PHEOMELANIN * values.get("pheomelanin", 0.2)
        index = values.get("int_ior", IOR["amber"]) / values.get("ext_ior", IOR["air"])
        if index < 1:
            raise self.error(element, "hair is denser than what is around it")
        names = {"longitudinal_roughness": 0.3, "azimuthal_roughness": 0.3, "scale_tilt": 2.0}
        return {
            "eta": np.full(3, index),
            "k": values["sigma_a"] * values.get("scale", 1.0) if "sigma_a" in values else pigment,
            "fibre": tuple(values.get(name, default) for name, default in names.items()),
            "other": Material(kind="null"),
            "by_side": True,
        }

    def conductor(self, element: etree._Element, **more: object) -> dict:
        values = self.parameters(
            element,
            **more,
            material=self.choice("none"),
            eta=self.colour(),
            k=self.colour(),
            ext_eta=self.ior,
            specular_reflectance=self.colour(1.0),
        )
        if "material" in values and values.keys() & {"eta", "k"}:
            raise self.error(element, "material and eta, k exclude each other")
        if ("eta" in values) != ("k" in values):
            raise self.error(element, "eta and k belong together")
        outside = values.pop("ext_eta", 1.0)
        values.pop("material", None)
        values["eta"] = values.get("eta", np.zeros(3)) / outside
        values["k"] = values.get("k", np.ones(3)) / outside
        return values

    def ior(self, element: etree._Element) -> float:
        if element.tag == "string":
            name = self.text(element, "value").lower()
            if name not in IOR:
                raise self.error(element, f"'{name}', known: {', '.join(IOR)}")
            return IOR[name]
        return self.number(0, open_low=True)(element)

    def dielectric(self, element: etree._Element, **more: object) -> dict:
        values = self.parameters(
            element,
            **more,
            int_ior=self.ior,
            ext_ior=self.ior,
            specular_reflectance=self.colour(1.0),
            specular_transmittance=self.colour(1.0),
        )
        inside, outside = values.pop("int_ior", IOR["bk7"]), values.pop("ext_ior", IOR["air"])
        return {**values, "eta": np.full(3, inside / outside)}

    thindielectric = dielectric

    def plastic(self, element: etree._Element, **more: object) -> dict:
        values = self.parameters(
            element,
            **more,
            int_ior=self.ior,
            ext_ior=self.ior,
            diffuse_reflectance=self.colour(1.0),
            specular_reflectance=self.colour(1.0),
            nonlinear=self.boolean,
        )
        inside = values.pop("int_ior", IOR["polypropylene"])
        values["eta"] = np.full(3, inside / values.pop("ext_ior", IOR["air"]))
        values["reflectance"] = values.pop("diffuse_reflectance", np.full(3, 0.5))
        return values

    def medium(self, element: etree._Element) -> int:
        """The index of the medium in the scene's list."""
        if element in self.medium_index:
            return self.medium_index[element]
        uneven = self.plugin(element, "homogeneous", "heterogeneous") == "heterogeneous"
        values = self.parameters(
            element,
            sigma_t=self.volume(self.colour()),
            albedo=self.volume(self.colour(1.0)),
            sigma_s=self.colour(),
            sigma_a=self.colour(),
            scale=self.number(0),
            phase=self.phase,
            sample_emitters=self.boolean,
        )
        if "sigma_s" in values or "sigma_a" in values:
            if "sigma_t" in values or "albedo" in values or not {"sigma_s", "sigma_a"} <= {*values}:
                raise self.error(element, "needs sigma_t and albedo, or sigma_s and sigma_a")
            sigma_t = values["sigma_s"] + values["sigma_a"]
            albedo = values["sigma_s"] / np.where(sigma_t > 0, sigma_t, 1)
        else:
            sigma_t = values.get("sigma_t", np.ones(3))
            albedo = values.get("albedo", np.full(3, 0.75))
        if uneven and not isinstance(sigma_t, Grid):
            sigma_t = Grid(sigma_t.reshape(1, 1, 1, 3), np.eye(4))
        grids = {}
        if isinstance(sigma_t, Grid):
            if not uneven:
                raise self.error(element, "sigma_t by a grid; heterogeneous takes one")
            grids["extinction_grid"], sigma_t = sigma_t, np.ones(3)
        if isinstance(albedo, Grid):
            grids["albedo_grid"], albedo = albedo, np.ones(3)
        sigma_t = sigma_t * values.get("scale", 1.0)
        if "extinction_grid" in grids and isinstance(values.get("phase"), Flakes):
            raise self.error(element, "uneven flakes are not implemented")
        self.media.append(
            Medium(sigma_t, albedo, values.get("phase", HenyeyGreenstein(0.0)), **grids)
        )
        self.medium_index[element] = len(self.media) - 1
        return len(self.media) - 1

    def volume(self, colour: Callable) -> Callable:
        """Reader of a grid, a constvolume, or a colour."""

        def read(element: etree._Element) -> np.ndarray | Grid:
            if element.tag != "volume":
                return colour(element)
            if self.plugin(element, "gridvolume", "constvolume") == "constvolume":
                values = self.parameters(element, value=colour)
                return values.get("value", np.ones(3))
            values = self.parameters(
                element,
                filename=lambda e: self.text(e, "value"),
                to_world=self.transform,
                wrap_mode=self.choice("repeat", "mirror", "clamp"),
                filter_type=self.choice("trilinear", "nearest"),
                use_grid_bbox=self.boolean,
                raw=self.boolean,
            )
            try:
                cells, (low, high) = read_vol(self.folder / values["filename"])
            except (OSError, KeyError, ValueError) as error:
                raise self.error(element, f"gridvolume: {error}") from error
            place = values.get("to_world", np.eye(4))
            if values.get("use_grid_bbox", False):
                box = np.diag([*(high - low), 1.0])
                box[:3, 3] = low
                place = place @ box
            return Grid(
                cells,
                place,
                values.get("wrap_mode", "clamp"),
                values.get("filter_type") == "nearest",
            )

        return read

    def phase(self, element: etree._Element) -> Phase:
        kind = self.plugin(element, "isotropic", "hg", "rayleigh", "tabphase", "sggx", "blendphase")
        if kind == "sggx":
            return self.sggx(element)
        if kind == "blendphase":
            return self.blendphase(element)
        if kind == "tabphase":
            return self.tabphase(element)
        if kind == "hg":
            values = self.parameters(element, g=self.number(-1 + 1e-9, 1 - 1e-9))
            return HenyeyGreenstein(values.get("g", 0.8))
        self.parameters(element)
        return Rayleigh() if kind == "rayleigh" else HenyeyGreenstein(0.0)

    def tabphase(self, element: etree._Element) -> Tabulated:
        given = self.parameters(element, values=lambda e: self.text(e, "value")).get("values", "")
        try:
            values = np.array([float(v) for v in given.replace(",", " ").split()])
        except ValueError as error:
            raise self.error(element, f"tabphase: {error}") from error
        if len(values) < 2 or not (np.isfinite(values) & (values >= 0)).all() or not values.any():
            raise self.error(
                element, "tabphase needs two or more values, none negative, some not 0"
            )
        return Tabulated(values)

    def sggx(self, element: etree._Element) -> Flakes:
        grid = self.parameters(element, S=self.volume(self.colour())).get("S")
        numbers = grid.cells.reshape(-1, grid.cells.shape[3]) if isinstance(grid, Grid) else None
        if numbers is None or numbers.shape[1] != 6 or (numbers != numbers[0]).any():
            raise self.error(element, "sggx needs a grid S of six numbers, the same in all cells")
        xx, yy, zz, xy, xz, yz = numbers[0]
        matrix = np.array([[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]])
        if np.linalg.eigvalsh(matrix)[0] <= 0:
            raise self.error(element, "S of an sggx has an eigenvalue that is not above 0")
        return Flakes(matrix)

    def blendphase(self, element: etree._Element) -> Blend:
        values = self.parameters(
            element, weight=self.number(0, 1), first=self.phase, second=self.phase
        )
        if len(values) != 3:
            raise self.error(element, "blendphase needs a weight and a first and a second phase")
        return Blend(**values)

    # -- lights and shapes ---------------------------------------------------------------------

    def emitter(self, element: etree._Element) -> None:
        kind = self.plugin(
            element, "constant", "envmap", "point", "directional", "spot", "projector"
        )
        light = self.colour(grey=False)
        if kind == "constant":
            self.only_environment(element)
            values = self.parameters(element, radiance=light)
            self.environment = values.get("radiance", np.ones(3))
            return
        if kind == "envmap":
            self.only_environment(element)
            self.sky = self.envmap(element)
            return
        frame = dict(to_world=self.transform)
        readers = {
            "point": dict(intensity=light, position=self.point),
            "directional": dict(irradiance=light, direction=self.point),
            "spot": dict(
                intensity=light,
                cutoff_angle=self.number(0, 180, open_low=True),
                beam_width=self.number(0, 180),
                texture=self.texture,
            ),
            "projector": dict(
                irradiance=self.colour_or_texture,
                scale=self.number(0),
                fov=self.number(0, 180, open_low=True),
                fov_axis=self.choice("x", "y", "diagonal", "smaller", "larger"),
            ),
        }[kind]
        values = self.parameters(element, **readers, **frame)
        if "to_world" in values and values.keys() & {"position", "direction"}:
            raise self.error(element, "to_world excludes position and direction")
        to_world = values.get("to_world", np.eye(4))
        direction = values.get("direction", to_world[:3, 2])
        if not np.linalg.norm(direction) > 0:
            raise self.error(element, "the direction has length 0")
        cutoff = values.get("cutoff_angle", 20.0)
        beam = values.get("beam_width", cutoff * 0.75)
        if beam > cutoff:
            raise self.error(element, f"beam_width {beam} above the cutoff_angle {cutoff}")
        image = dict(texture=values.get("texture"), tangents=(math.tan(math.radians(cutoff)),) * 2)
        if kind == "projector":
            values["irradiance"], image = self.projected(element, values)
        self.lights.append(
            Light(
                kind,
                frame=to_world[:3, :3] / np.linalg.norm(to_world[:3, :3], axis=0),
                **image,
                intensity=values.get("intensity", values.get("irradiance", np.ones(3))),
                position=values.get("position", to_world[:3, 3]),
                direction=direction / np.linalg.norm(direction),
                cutoff=math.radians(cutoff),
                beam=math.radians(beam),
            )
        )

    def colour_or_texture(
        self, element: etree._Element
    ) -> tuple[np.ndarray, textures.Texture | None]:
        """A colour, or white and the texture that it is multiplied by."""
        if element.tag == "texture":
            return np.ones(3), self.texture(element)
        return self.colour(grey=False)(element), None

    def projected(self, element: etree._Element, values: dict) -> tuple[np.ndarray, dict]:
        """Irradiance of a projector at distance 1, and the fields of its image.

        Its sides are as those of the texels, 1 without any; local +x is on its left, +y on top.
        """
        if "fov" not in values or "irradiance" not in values:
            raise self.error(element, "needs fov and irradiance")
        colour, texture = values["irradiance"]
        height, width = (1, 1)
        if texture is not None and texture.kind == "bitmap":
            height, width, _ = texture.texels.shape
        view = Camera(np.eye(4), values["fov"], values.get("fov_axis", "x"))
        x, y = view.tangents(width, height)
        return (
            math.pi * values.get("scale", 1.0) * colour,
            dict(texture=texture, tangents=(-x, -y)),
        )

    def only_environment(self, element: etree._Element) -> None:
        """SceneError if there is one already."""
        if self.environment is not None or self.sky is not None:
            raise self.error(element, "second environment")

    def envmap(self, element: etree._Element) -> Sky:
        """The image of an EXR file, which its sky is made of."""
        values = self.parameters(
            element,
            filename=lambda e: self.folder / self.text(e, "value"),
            scale=self.number(0),
            to_world=self.transform,
            mis_compensation=self.boolean,
        )
        path = values.get("filename")
        if path is None:
            raise self.error(element, "needs a filename")
        try:
            self.hash.update(path.read_bytes())
            texels = read_texels(path)
        except (OSError, RuntimeError, KeyError) as error:
            raise self.error(element, f"{path}: {error}") from error
        if not (np.isfinite(texels).all() and (texels >= 0).all()):
            raise self.error(element, f"{path}: radiance that is negative or not finite")
        turn = values.get("to_world", np.eye(4))[:3, :3]
        if np.abs(turn.T @ turn - np.eye(3)).max() > 1e-3:
            raise self.error(element, "to_world scales or shears")
        scale, compensated = values.get("scale", 1.0), values.get("mis_compensation", True)
        return Sky(texels * scale, turn, compensated)

    def area(self, element: etree._Element) -> tuple[np.ndarray, textures.Texture | None]:
        self.plugin(element, "area")
        values = self.parameters(element, radiance=self.colour_or_texture)
        return values.get("radiance", (np.ones(3), None))

    def shapes(self, element: etree._Element) -> list[_Shape]:
        """What a shape shows: a group by its instances alone."""
        kind = element.get("type")
        if kind == "shapegroup":
            return []
        if kind == "merge":
            return self.group(element)
        if kind == "instance":
            values = self.parameters(element, to_world=self.transform, shape=self.group)
            matrix = values.get("to_world", np.eye(4))
            return [replace(s, geometry=shapes.moved(s.geometry, matrix)) for s in values["shape"]]
        return [self.shape(element)]

    def group(self, element: etree._Element) -> list[_Shape]:
        """The shapes in a group or a merge."""
        return [s for child in self.children(element) for s in self.shapes(self.target(child))]

    def shape(self, element: etree._Element) -> _Shape:
        kind = self.plugin(
            element, "rectangle", "cube", "disk", "sphere", "cylinder", "obj", "ply", "stl",
            "serialized", "linearcurve", "bsplinecurve", "sdfgrid",
        )  # fmt: skip
        special: dict = {}
        if kind == "cylinder":
            special = dict(p0=self.point, p1=self.point, radius=self.number(0, open_low=True))
        elif kind in ("obj", "ply", "stl", "serialized"):
            special = dict(
                shape_index=self.integer(0),
                filename=lambda e: self.folder / self.text(e, "value"),
                face_normals=self.boolean,
                flip_tex_coords=self.ignore,
            )
        elif kind in ("linearcurve", "bsplinecurve"):
            special = dict(filename=lambda e: self.folder / self.text(e, "value"))
        elif kind == "sdfgrid":
            special = dict(
                filename=lambda e: self.folder / self.text(e, "value"),
                normals=lambda e: self.text(e, "value"),
            )
        elif kind == "sphere":
            special = dict(center=self.point, radius=self.number(0, open_low=True))
        values = self.parameters(
            element,
            to_world=self.transform,
            flip_normals=self.boolean,
            bsdf=self.bsdf,
            emitter=self.area,
            interior=self.medium,
            exterior=self.medium,
            **special,
        )
        boundary = None
        if "interior" in values or "exterior" in values:
            boundary = (values.get("interior", -1), values.get("exterior", -1))
        radiance = values.get("emitter")
        material = values.get("bsdf", Material() if radiance is None else _NO_LIGHT)
        found = [m.texture for m in (material, *material.others())]
        found += [m.weight for m in (material, *material.others())
                  if isinstance(m.weight, textures.Texture)]  # fmt: skip
        names = [texture.name for texture in found if texture is not None]
        if names and kind in _UNTEXTURED:
            if kind != "ply" or len(set(names)) > 1 or not names[0]:
                raise self.error(element, "textures on meshes: one mesh_attribute of a ply")
        elif any(names):
            raise self.error(element, "mesh_attribute: on a ply")
        values["attribute"] = names[0] if names else ""
        if radiance is not None and radiance[1] is not None and kind in _UNTEXTURED:
            raise self.error(element, "textures of lamps on meshes are not supported")
        return _Shape(self.geometry(element, kind, values), material, radiance, boundary)

    def geometry(self, element: etree._Element, kind: str, values: dict) -> Geometry:
        to_world, flip = values.get("to_world", np.eye(4)), values.get("flip_normals", False)
        if kind in ("rectangle", "cube", "disk"):
            return getattr(shapes, kind)(to_world, flip)
        try:
            if kind == "sphere":
                centre = values.get("center", np.zeros(3))
                return shapes.sphere(centre, values.get("radius", 1.0), to_world, flip)
            if kind == "cylinder":
                start, end = values.get("p0", np.zeros(3)), values.get("p1", np.array([0, 0, 1.0]))
                return shapes.cylinder(start, end, values.get("radius", 1.0), to_world, flip)
            path = values.get("filename")
            if path is None:
                raise self.error(element, "needs a filename")
            data = path.read_bytes()
            self.hash.update(data)
            if kind in ("linearcurve", "bsplinecurve"):
                make = shapes.linear_curve if kind == "linearcurve" else shapes.spline_curve
                return make(data, to_world, flip)
            if kind == "sdfgrid":
                smooth = values.get("normals", "smooth") == "smooth"
                return shapes.sdf_grid(data, to_world, smooth, flip)
            flat, index = values.get("face_normals", False), values.get("shape_index", 0)
            attribute = values["attribute"]
            return shapes.mesh(kind, data, to_world, flat, flip, index, attribute)
        except SceneError:
            raise
        except Exception as error:
            raise self.error(element, f"{values.get('filename', kind)}: {error}") from error


_UNTEXTURED = ("obj", "ply", "stl", "linearcurve", "bsplinecurve", "sdfgrid")


def _tables(found: list[_Shape]) -> dict:
    """The fields of Scene that list primitives: triangles, then spheres, then disks."""
    if not found:  # a triangle that nothing can hit
        point = Geometry(triangles=np.zeros((1, 3, 3)), normals=np.zeros((1, 3, 3)))
        found = [_Shape(point, Material(), None, None)]
    boundaries = list(dict.fromkeys(s.boundary for s in found if s.boundary))
    lit = [s for s in found if s.radiance is not None]
    rows = np.array(
        [
            (
                number,
                lit.index(s) if s.radiance is not None else -1,
                boundaries.index(s.boundary) if s.boundary else -1,
            )
            for number, s in enumerate(found)
        ],
        np.int32,
    ).reshape(-1, 3)
    counts = np.array([s.geometry.counts for s in found], int).reshape(-1, 3)
    columns = np.concatenate([np.repeat(rows, count, axis=0) for count in counts.T]).T
    return dict(
        geometry=shapes.joined([s.geometry for s in found]),
        **dict(zip(("material", "emission", "boundary"), columns.copy(), strict=True)),
        materials=(
            *(s.material for s in found),
            *(other for s in found for other in s.material.others()),
        ),
        radiances=np.array([s.radiance[0] for s in lit]).reshape(-1, 3),
        shine=tuple(s.radiance[1] for s in lit),
        boundaries=np.array(boundaries, np.int32).reshape(-1, 2),
    )
