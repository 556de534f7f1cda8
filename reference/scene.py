"""What a scene is, after its file has been read: plain arrays and small records, in world units.

Right-handed world; a sensor looks along local +Z with +X to the left of the picture; ``fov`` in
degrees. Primitives are numbered triangles first, then spheres, then disks. The front of a triangle
is the side that cross(v1 - v0, v2 - v0) points to, of a disk that of cross(a, b), of a sphere its
outside unless ``inward``. Colours are linear RGB (3,) float64.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from typing import TYPE_CHECKING

import numpy as np

from reference.grids import Grid
from reference.phases import HenyeyGreenstein, Phase
from reference.skies import Sky

if TYPE_CHECKING:
    from reference.relief import Relief
    from reference.textures import Texture

MATERIAL_KINDS = ("diffuse", "conductor", "dielectric", "plastic", "thindielectric", "null",
                  "roughconductor", "roughplastic", "roughdielectric", "principled",
                  "principled_open", "principledthin", "hair")  # fmt: skip
LIGHT_KINDS = ("point", "spot", "directional", "projector")


class SceneError(ValueError):
    """A scene file that cannot be used; the message starts with file:line."""


@dataclass(frozen=True)
class Camera:
    """Pinhole or, with ``aperture`` > 0 (a radius in world units), thin lens; or ``parallel``.

    parallel: all rays go along local Z, from points of x in [-1, 1] at z = near, for far - near
    world units; fov has no meaning.
    near, far: clipping distances along the view axis. focus: distance of the plane in focus.
    principal: offset of the picture's centre, in parts of its size. medium: what the camera is in,
    -1 for vacuum.
    """

    to_world: np.ndarray
    fov: float
    fov_axis: str
    near: float = 0.0
    far: float = math.inf
    principal: tuple[float, float] = (0.0, 0.0)
    aperture: float = 0.0
    focus: float = 1.0
    medium: int = -1
    parallel: bool = False

    def tangents(self, width: int, height: int) -> tuple[float, float]:
        """Half extents of the picture at unit distance for a film of width x height pixels."""
        half = math.tan(math.radians(self.fov) / 2)
        aspect = width / height
        axis = self.fov_axis
        if axis in ("smaller", "larger"):
            axis = "x" if (axis == "smaller") == (width < height) else "y"
        if axis == "x":
            tan_x = half
        elif axis == "y":
            tan_x = half * aspect
        else:
            tan_x = half * aspect / math.hypot(1.0, aspect)
        return tan_x, tan_x / aspect


@dataclass(frozen=True)
class Film:
    """Size in pixels and reconstruction filter.

    ``parameter`` is a radius (box, tent), the standard deviation (gaussian) or (B, C) (mitchell).
    """

    width: int = 768
    height: int = 576
    filter: str = "gaussian"
    parameter: float | tuple[float, float] = 0.5


def _colour(value: float) -> np.ndarray:
    return field(default_factory=lambda: np.full(3, value))


@dataclass(frozen=True)
class Material:
    """One of MATERIAL_KINDS.

    reflectance: of diffuse, or of plastic's base. eta: refractive index inside over outside, equal
    in all channels but for a conductor, whose extinction is k (relative to the outside, too).
    opacity: of a mask around the material, 1 without one. alpha, distribution, shadowing: of rough
    ones; alpha along and across the growth of u. whole: a rough one that loses no light. relief:
    what turns normals, by relief_texture. texture: in
    place of a diffuse reflectance. other: what a blend shows instead with the probability
    weight; by_side: from behind, and the material itself from the front. shares: of principled
    ones, of which the open let light through; their base colour is `reflectance`. fibre: of hair
    the roughness along and around it, and the tilt of its scales in degrees; k is its absorption
    over a radius.
    """

    kind: str = "diffuse"
    reflectance: np.ndarray = _colour(0.5)
    specular_reflectance: np.ndarray = _colour(1.0)
    specular_transmittance: np.ndarray = _colour(1.0)
    eta: np.ndarray = _colour(1.0)
    k: np.ndarray = _colour(0.0)
    opacity: float = 1.0
    two_sided: bool = False
    nonlinear: bool = False
    texture: Texture | None = None
    other: Material | None = None
    weight: float | Texture = 0.0
    by_side: bool = False
    alpha: tuple[float, float] = (0.1, 0.1)
    distribution: str = "beckmann"
    shadowing: str = "separable"
    whole: bool = False
    shares: Mapping[str, float] = field(default_factory=dict)
    fibre: tuple[float, float, float] = (0.3, 0.3, 2.0)
    relief: Relief | None = None
    relief_texture: Texture | None = None

    def others(self) -> list[Material]:
        """What a blend shows instead, and what that does if it is a blend, and so on."""
        return [] if self.other is None else [self.other, *self.other.others()]


@dataclass(frozen=True)
class Medium:
    """Extinction sigma_t (3,) per world unit, albedo (3,), phase function; by place factors on the
    first two, of the extinction only in the grid's box."""

    sigma_t: np.ndarray
    albedo: np.ndarray
    phase: Phase = HenyeyGreenstein(0.0)
    extinction_grid: Grid | None = None
    albedo_grid: Grid | None = None


@dataclass(frozen=True)
class Light:
    """A light without area, one of LIGHT_KINDS.

    direction: unit, the way that the light goes. intensity: W/sr (directional: irradiance on a
    surface that faces it; projector: that on a plane across its axis at distance 1). cutoff, beam:
    angles of a spot in radians. texture: a factor, read at (1 + x / (z width), 1 + y / (z height))
    / 2 for local x, y, z, whose axes are the columns of frame; tangents: the width and height.
    """

    kind: str
    intensity: np.ndarray
    position: np.ndarray = _colour(0.0)
    direction: np.ndarray = field(default_factory=lambda: np.array([0.0, 0.0, 1.0]))
    cutoff: float = math.pi
    beam: float = math.pi
    texture: Texture | None = None
    frame: np.ndarray = field(default_factory=lambda: np.eye(3))
    tangents: tuple[float, float] = (1.0, 1.0)


@dataclass(frozen=True)
class Geometry:
    """Shapes without their looks, float64.

    triangles (T, 3, 3); normals (T, 3, 3) unit at the corners, zero for none (a triangle is smooth
    if it has all three); spheres (S, 4) centre and radius; inward (S,) bool; disks (D, 3, 3)
    centre and half axes a, b. For textures: uv (T, 3, 2) at the corners; frames (S, 3, 3) to local
    space; turned (D,) bool: a is local y and b local x; colours (T, 3, 3): at corners.
    """

    triangles: np.ndarray = field(default_factory=lambda: np.zeros((0, 3, 3)))
    normals: np.ndarray = field(default_factory=lambda: np.zeros((0, 3, 3)))
    spheres: np.ndarray = field(default_factory=lambda: np.zeros((0, 4)))
    inward: np.ndarray = field(default_factory=lambda: np.zeros(0, bool))
    disks: np.ndarray = field(default_factory=lambda: np.zeros((0, 3, 3)))
    uv: np.ndarray = field(default_factory=lambda: np.zeros((0, 3, 2)))
    frames: np.ndarray = field(default_factory=lambda: np.zeros((0, 3, 3)))
    turned: np.ndarray = field(default_factory=lambda: np.zeros(0, bool))
    colours: np.ndarray = field(default_factory=lambda: np.zeros((0, 3, 3)))

    def __post_init__(self) -> None:
        if len(self.colours) != len(self.triangles):
            object.__setattr__(self, "colours", np.zeros((len(self.triangles), 3, 3)))

    @property
    def counts(self) -> tuple[int, int, int]:
        """Numbers of triangles, spheres and disks."""
        return len(self.triangles), len(self.spheres), len(self.disks)


@dataclass(frozen=True)
class Scene:
    """A scene in world units.

    Per primitive (P,) int32: material, an index; emission, of the radiances (E, 3), or -1, and of
    the textures that they are multiplied by, None for none;
    boundary, a row of boundaries (B, 2) int32, which holds the media inside and outside (-1
    vacuum), or -1. environment (3,) or None, sky its image or None; depths and hide_emitters as in
    Mitsuba's volpath integrator; digest is the SHA-256 of every file and parameter given.
    """

    geometry: Geometry
    material: np.ndarray
    emission: np.ndarray
    boundary: np.ndarray
    materials: tuple[Material, ...]
    radiances: np.ndarray
    boundaries: np.ndarray
    media: tuple[Medium, ...]
    lights: tuple[Light, ...]
    environment: np.ndarray | None
    camera: Camera
    film: Film
    max_depth: int
    rr_depth: int
    spp: int
    digest: str
    sky: Sky | None = None
    hide_emitters: bool = False
    shine: tuple[Texture | None, ...] = ()

    @property
    def triangles(self) -> np.ndarray:
        """The corners of the triangles (T, 3, 3)."""
        return self.geometry.triangles


def with_settings(
    scene: Scene,
    *,
    width: int | None = None,
    height: int | None = None,
    max_depth: int | None = None,
    rr_depth: int | None = None,
) -> Scene:
    """A copy of ``scene`` with other settings; None keeps the file's. ValueError if unusable."""
    film = scene.film
    new = replace(
        scene,
        film=replace(
            film,
            width=film.width if width is None else width,
            height=film.height if height is None else height,
        ),
        max_depth=scene.max_depth if max_depth is None else max_depth,
        rr_depth=scene.rr_depth if rr_depth is None else rr_depth,
    )
    if min(new.film.width, new.film.height, new.rr_depth) < 1 or new.max_depth < -1:
        raise ValueError(
            f"film {new.film.width} x {new.film.height}, rr_depth {new.rr_depth} must "
            f"be positive and max_depth {new.max_depth} at least -1"
        )
    return new
