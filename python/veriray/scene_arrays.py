"""The array fields of a scene. Made by cpp/schema/generate.py from python/veriray/columns.py."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy.typing as npt

Array = npt.NDArray[Any]
_NONE: Any = None  # until the scene is made


@dataclass(frozen=True, eq=False, kw_only=True)
class SceneArrays:
    """The arrays of a scene, read-only; None when given stands for an empty table or the default.

    vertices (V, 3) float64: world units
    normals (V, 3) float64: shading normals of unit length, or zero for none; a triangle is smooth
        if its three are not zero (default 0.0)
    triangles (T, 3) uint32: cross(v1 - v0, v2 - v0) is on the front side (index of vertices)
    triangle_material (T,) uint32: its material (index of materials)
    triangle_emission (T,) int32: what its front emits; -1 for nothing (index of emissions, default
        -1)
    triangle_boundary (T,) int32: the media on its sides; -1 for no change (index of boundaries,
        default -1)
    spheres (S, 4) float64: centre, and radius above 0
    sphere_material (S,) uint32: its material (index of materials)
    sphere_emission (S,) int32: what its front emits; -1 for nothing (index of emissions, default
        -1)
    sphere_boundary (S,) int32: the media on its sides; -1 for no change (index of boundaries,
        default -1)
    sphere_inward (S,) bool: the front is inside (default False)
    disks (D, 3, 3) float64: centre and half axes a and b of an ellipse; cross(a, b) is on the front
        side
    disk_material (D,) uint32: its material (index of materials)
    disk_emission (D,) int32: what its front emits; -1 for nothing (index of emissions, default -1)
    disk_boundary (D,) int32: the media on its sides; -1 for no change (index of boundaries, default
        -1)
    reflectance (M, 3) float32: of a diffuse surface, or of a plastic's base (in [0, 1])
    two_sided (M,) bool: the back scatters as the front does (default False)
    material_kind (M,) uint32: of MATERIAL_KINDS (default 0)
    specular_reflectance (M, 3) float32: factor on what a mirror would reflect (in [0, 1], default
        1.0)
    specular_transmittance (M, 3) float32: factor on what is refracted (in [0, 1], default 1.0)
    eta (M, 3) float32: of a conductor the refractive index over that outside (the ideal mirror: eta
        0, k 1); else the index inside over that outside, three times (in [0, 1e+06], default 1.0)
    k (M, 3) float32: of a conductor: the imaginary part of its index; of a plastic: above 0 if
        light enters and leaves its base once, as through a smooth coat; of hair: absorption per
        radius (in [0, 1e+06], default 0.0)
    opacity (M,) float32: share of the surface that is there (in [0, 1], default 1.0)
    nonlinear (M,) bool: colour shifts of a plastic's base by internal scattering (default False)
    emissions (E, 3) float32: radiance, emitted on the front side only (in [0, infinity))
    environment (3,) float32: constant radiance from far away (in [0, infinity), default 0.0)
    boundaries (B, 2) int32: media inside (behind the front) and outside of a surface; -1 for vacuum
        (index of media, default -1)
    sigma_t (K, 3) float32: extinction per unit length (in [0, infinity))
    albedo (K, 3) float32: share of the extinction that scatters (in [0, 1], default 0.0)
    phase_g (K,) float32: Henyey and Greenstein's asymmetry in (-1, 1); 0 is isotropic (in (-1, 1),
        default 0.0)
    light_kind (Q,) uint32: of LIGHT_KINDS
    light_position (Q, 3) float64: world units (default 0.0)
    light_direction (Q, 3) float64: of unit length: the way the light goes (default (0.0, 0.0, 1.0))
    light_intensity (Q, 3) float32: of a directional light the irradiance across it, of a projector
        that at distance 1 (in [0, infinity), default 1.0)
    light_angles (Q, 2) float64: a spot's cutoff and beam width, degrees from its axis (in [0, 180],
        default (20.0, 15.0))
    uv (V, 2) float32: texture coordinates u and v (in [-1e+30, 1e+30], default 0.0)
    sphere_frame (S, 3, 3) float32: unit axes x, y and z, a row each, across each other: u is the
        angle about z from x towards y over 2 pi, v that from z over pi (in [-1, 1], default ((1.0,
        0.0, 0.0), (0.0, 1.0, 0.0), (0.0, 0.0, 1.0)))
    disk_turned (D,) bool: v, the angle over 2 pi, runs from b to a; else from a to b; u is the
        distance from the centre (default False)
    texture_kind (X,) uint32: of TEXTURE_KINDS
    texture_to_uv (X, 2, 3) float32: what takes (u, v, 1) to the texture's own coordinates; rows of
        texels follow its v (in [-1e+06, 1e+06], default ((1.0, 0.0, 0.0), (0.0, 1.0, 0.0)))
    texture_color0 (X, 3) float32: of a checkerboard, where u and v are both in the first or both in
        the second half (in [0, infinity), default 0.4)
    texture_color1 (X, 3) float32: of its other fields (in [0, infinity), default 0.2)
    texture_field0 (X,) int32: of a checkerboard: a texture before it that stands in place of
        texture_color0; -1: none does (index of textures, default -1)
    texture_field1 (X,) int32: of a checkerboard: a texture before it that stands in place of
        texture_color1; -1: none does (index of textures, default -1)
    texture_wrap (X,) uint32: of TEXTURE_WRAPS (default 0)
    texture_filter (X,) uint32: of TEXTURE_FILTERS (default 0)
    texture_format (X,) uint32: of TEXTURE_FORMATS (default 0)
    texture_width (X,) uint32: in texels (in [1, 32768], default 1)
    texture_height (X,) uint32: in texels (in [1, 32768], default 1)
    texture_depth (X,) uint32: of a volume: texels along z; its height is along y, its format float
        (in [1, 32768], default 1)
    texture_to_world (X, 3, 4) float64: of a volume: what takes (x, y, z, 1) of the unit cube of its
        texels to world units (default ((1.0, 0.0, 0.0, 0.0), (0.0, 1.0, 0.0, 0.0), (0.0, 0.0, 1.0,
        0.0)))
    texture_grey (X,) bool: one number a texel; else three, and 8-bit and half texels have a fourth
        that is not used (default False)
    texture_first (X,) uint32: its first row of texels; of an attribute that of attribute_values,
        with one for each vertex or triangle (default 0)
    texels (W,) uint32: texels row by row, packed from the lowest bits; each texture begins a row
    attribute_values (A, 3) float32: numbers of vertices or triangles, zero for meshes without; one
        alone stands there three times (in [0, infinity))
    blend_material (M,) int32: a surface is of this material too, by the share blend_weight; a blend
        only if it comes after; -1: none (index of materials, default -1)
    blend_weight (M,) float32: the share of blend_material (in [0, 1], default 0.0)
    blend_sides (M,) bool: blend_material is all that is seen from behind; blend_weight counts in
        front (default False)
    reflectance_texture (M,) int32: gives reflectance; -1: none does (index of textures, default -1)
    specular_reflectance_texture (M,) int32: gives specular_reflectance; -1: none does (index of
        textures, default -1)
    specular_transmittance_texture (M,) int32: gives specular_transmittance; -1: none does (index of
        textures, default -1)
    opacity_texture (M,) int32: gives opacity; -1: none does (index of textures, default -1)
    alpha_u_texture (M,) int32: gives alpha_u; -1: none does (index of textures, default -1)
    alpha_v_texture (M,) int32: gives alpha_v; -1: none does (index of textures, default -1)
    roughness_texture (M,) int32: gives roughness; -1: none does (index of textures, default -1)
    metallic_texture (M,) int32: gives metallic; -1: none does (index of textures, default -1)
    spec_trans_texture (M,) int32: gives spec_trans; -1: none does (index of textures, default -1)
    spec_tint_texture (M,) int32: gives spec_tint; -1: none does (index of textures, default -1)
    sheen_texture (M,) int32: gives sheen; -1: none does (index of textures, default -1)
    sheen_tint_texture (M,) int32: gives sheen_tint; -1: none does (index of textures, default -1)
    flatness_texture (M,) int32: gives flatness; -1: none does (index of textures, default -1)
    clearcoat_texture (M,) int32: gives clearcoat; -1: none does (index of textures, default -1)
    clearcoat_gloss_texture (M,) int32: gives clearcoat_gloss; -1: none does (index of textures,
        default -1)
    anisotropic_texture (M,) int32: gives anisotropic; -1: none does (index of textures, default -1)
    diff_trans_texture (M,) int32: gives diff_trans; -1: none does (index of textures, default -1)
    blend_weight_texture (M,) int32: gives blend_weight; -1: none does (index of textures, default
        -1)
    eta_texture (M,) int32: gives eta; -1: none does (index of textures, default -1)
    k_texture (M,) int32: gives k; -1: none does (index of textures, default -1)
    emission_texture (E,) int32: what its radiance is multiplied by; -1: nothing (index of textures,
        default -1)
    light_texture (Q,) int32: what the intensity of a spot or projector is multiplied by (index of
        textures, default -1)
    light_image (Q, 2, 3) float64: rows a and b: along d, which is 1 along the light's direction, an
        image is read at u = 1/2 + a.d and v = 1/2 + b.d; a projector lights where both are in [0,
        1] (default 0.0)
    alpha_u (M,) float32: root mean square slope of a rough surface, along its tangent (in [5e-05,
        10], default 0.1)
    alpha_v (M,) float32: likewise, across its tangent (in [5e-05, 10], default 0.1)
    distribution (M,) uint32: of the slopes; of DISTRIBUTIONS (default 0)
    shadowing (M,) uint32: of small mirrors by each other, Smith's; of SHADOWINGS (default 0)
    roughness (M,) float32: of a principled: root of the slope of its mirrors, which is 0.001 at
        least (in [0, 1], default 0.5)
    metallic (M,) float32: of a principled: share of a metal of the base colour (in [0, 1], default
        0.0)
    spec_trans (M,) float32: of a principled: share of the rest that lets light through (in [0, 1],
        default 0.0)
    spec_tint (M,) float32: of a principled: share of the base colour's hue in what is not metal and
        reflects (in [0, 1], default 0.0)
    sheen (M,) float32: of a principled: light that it reflects at grazing angles (in [0, 1],
        default 0.0)
    sheen_tint (M,) float32: of a principled: share of the base colour's hue in that (in [0, 1],
        default 0.0)
    flatness (M,) float32: of a principled: share of the diffuse part that imitates scattering below
        the surface (in [0, 1], default 0.0)
    clearcoat (M,) float32: of a principled: amount of a clear coat (in [0, 1], default 0.0)
    clearcoat_gloss (M,) float32: of a principled: the coat's slope, from 0.1 to 0.001 (in [0, 1],
        default 0.0)
    anisotropic (M,) float32: of a principled: how much less its mirrors slope across the tangent
        than along it (in [0, 1], default 0.0)
    diff_trans (M,) float32: of a thin one: twice the share of the diffuse light that goes through
        (in [0, 2], default 0.0)
    hair_along (M,) float32: of hair: variance of the light that its surface reflects, along it (in
        [1e-06, 100], default 0.1)
    hair_around (M,) float32: of hair: scale of the logistic by which light spreads around it,
        radians (in [0.001, 10], default 0.2)
    hair_tilt (M,) float32: of hair: sine of the tilt of its scales (in [-1, 1], default 0.0)
    relief_texture (M,) int32: turns the surface's normals; -1: none does (index of textures,
        default -1)
    relief_heights (M,) bool: it gives heights (bilinear ones), whose slopes count; else normals n
        by colours (n + 1) / 2 (default False)
    relief_scale (M,) float32: of heights: world units for a height of 1 (in [-1e+06, 1e+06],
        default 1.0)
    relief_flips (M,) bool: a turned normal that looks away from the viewer is turned the other way
        (default True)
    relief_shades (M,) bool: what is turned reflects less light from grazing directions (default
        True)
    relief_mirrored (M,) bool: seen from behind, the turned normals are those of the front mirrored
        (default False)
    sky_texels (Y, 3) float32: radiance from far away by direction: an image in rows from the local
        pole +y to -y; in a row, azimuths from -z by +x (in [0, infinity))
    sky_size (2,) uint32: width and height of the image, 0 for none (in [0, 32768], default 0)
    sky_to_world (3, 3) float64: rotation or reflection of the image, acting on column vectors (in
        [-2, 2], default ((1.0, 0.0, 0.0), (0.0, 1.0, 0.0), (0.0, 0.0, 1.0)))
    sky_compensated (1,) bool: light samples are drawn by what the radiance exceeds its mean by;
        noise alone changes (default True)
    grid_size (G, 3) uint32: cells along x, y and z; cell k of n has its centre at (k + 1/2) / n (in
        [1, 32768])
    grid_first (G,) uint32: its first row of cells (default 0)
    grid_grey (G,) bool: one number a cell; else three (default False)
    grid_wrap (G,) uint32: of TEXTURE_WRAPS, along all axes (default 2)
    grid_filter (G,) uint32: of TEXTURE_FILTERS, the first in three dimensions (default 0)
    grid_to_world (G, 3, 4) float64: what takes (x, y, z, 1) of its unit cube to world units
        (default ((1.0, 0.0, 0.0, 0.0), (0.0, 1.0, 0.0, 0.0), (0.0, 0.0, 1.0, 0.0)))
    cells (C,) float32: numbers of grids: of a grid x by x, then by y and z, those of a cell side by
        side (in [0, 1])
    lobe_kind (L,) uint32: of PHASE_KINDS
    lobe_share (L,) float32: of its medium's phase function; those of a medium add up to 1 (in [0,
        1], default 1.0)
    lobe_g (L,) float32: of an hg; as phase_g (in (-1, 1), default 0.0)
    lobe_flakes (L, 6) float64: of an sggx: xx, yy, zz, xy, xz, yz of the matrix S of its flakes;
        where it is a medium's only lobe, the extinction along d is sigma_t times the root of d S d
        (in [-1, 1], default (1.0, 1.0, 1.0, 0.0, 0.0, 0.0))
    lobe_values (L,) uint32: of a tabphase: its first row of phase_values (default 0)
    lobe_size (L,) uint32: and how many it has (in [2, 65536], default 2)
    phase_values (P,) float32: at cosines of the turn from -1 (backward) to 1 in equal steps, linear
        between them; in proportion to what a tabphase scatters (in [0, infinity))
    phase_lobe (K,) int32: the first lobe of its phase function; -1: it is that of phase_g (index of
        lobes, default -1)
    phase_lobes (K,) uint32: and how many it has (in [1, 64], default 1)
    albedo_grid (K,) int32: a factor on albedo by place; -1: none (index of grids, default -1)
    sigma_t_grid (K,) int32: the share of sigma_t, then grey, that is there, and none outside of the
        box around the grid's unit cube; -1: all is everywhere (index of grids, default -1)
    emission_muted (E,) bool: paths are those with its light, which is left out of the picture
        (light groups) (default False)
    light_muted (Q,) bool: paths are those with its light, which is left out of the picture (light
        groups) (default False)
    sky_muted (1,) bool: paths are those with its light, which is left out of the picture (light
        groups) (default False)
    muted_segments (1,) uint32: light of paths of so many segments at most is left out, as of
        max_depth (in [0, 262144], default 0)
    """

    vertices: Array = _NONE
    normals: Array = _NONE
    triangles: Array = _NONE
    triangle_material: Array = _NONE
    triangle_emission: Array = _NONE
    triangle_boundary: Array = _NONE
    spheres: Array = _NONE
    sphere_material: Array = _NONE
    sphere_emission: Array = _NONE
    sphere_boundary: Array = _NONE
    sphere_inward: Array = _NONE
    disks: Array = _NONE
    disk_material: Array = _NONE
    disk_emission: Array = _NONE
    disk_boundary: Array = _NONE
    reflectance: Array = _NONE
    two_sided: Array = _NONE
    material_kind: Array = _NONE
    specular_reflectance: Array = _NONE
    specular_transmittance: Array = _NONE
    eta: Array = _NONE
    k: Array = _NONE
    opacity: Array = _NONE
    nonlinear: Array = _NONE
    emissions: Array = _NONE
    environment: Array = _NONE
    boundaries: Array = _NONE
    sigma_t: Array = _NONE
    albedo: Array = _NONE
    phase_g: Array = _NONE
    light_kind: Array = _NONE
    light_position: Array = _NONE
    light_direction: Array = _NONE
    light_intensity: Array = _NONE
    light_angles: Array = _NONE
    uv: Array = _NONE
    sphere_frame: Array = _NONE
    disk_turned: Array = _NONE
    texture_kind: Array = _NONE
    texture_to_uv: Array = _NONE
    texture_color0: Array = _NONE
    texture_color1: Array = _NONE
    texture_field0: Array = _NONE
    texture_field1: Array = _NONE
    texture_wrap: Array = _NONE
    texture_filter: Array = _NONE
    texture_format: Array = _NONE
    texture_width: Array = _NONE
    texture_height: Array = _NONE
    texture_depth: Array = _NONE
    texture_to_world: Array = _NONE
    texture_grey: Array = _NONE
    texture_first: Array = _NONE
    texels: Array = _NONE
    attribute_values: Array = _NONE
    blend_material: Array = _NONE
    blend_weight: Array = _NONE
    blend_sides: Array = _NONE
    reflectance_texture: Array = _NONE
    specular_reflectance_texture: Array = _NONE
    specular_transmittance_texture: Array = _NONE
    opacity_texture: Array = _NONE
    alpha_u_texture: Array = _NONE
    alpha_v_texture: Array = _NONE
    roughness_texture: Array = _NONE
    metallic_texture: Array = _NONE
    spec_trans_texture: Array = _NONE
    spec_tint_texture: Array = _NONE
    sheen_texture: Array = _NONE
    sheen_tint_texture: Array = _NONE
    flatness_texture: Array = _NONE
    clearcoat_texture: Array = _NONE
    clearcoat_gloss_texture: Array = _NONE
    anisotropic_texture: Array = _NONE
    diff_trans_texture: Array = _NONE
    blend_weight_texture: Array = _NONE
    eta_texture: Array = _NONE
    k_texture: Array = _NONE
    emission_texture: Array = _NONE
    light_texture: Array = _NONE
    light_image: Array = _NONE
    alpha_u: Array = _NONE
    alpha_v: Array = _NONE
    distribution: Array = _NONE
    shadowing: Array = _NONE
    roughness: Array = _NONE
    metallic: Array = _NONE
    spec_trans: Array = _NONE
    spec_tint: Array = _NONE
    sheen: Array = _NONE
    sheen_tint: Array = _NONE
    flatness: Array = _NONE
    clearcoat: Array = _NONE
    clearcoat_gloss: Array = _NONE
    anisotropic: Array = _NONE
    diff_trans: Array = _NONE
    hair_along: Array = _NONE
    hair_around: Array = _NONE
    hair_tilt: Array = _NONE
    relief_texture: Array = _NONE
    relief_heights: Array = _NONE
    relief_scale: Array = _NONE
    relief_flips: Array = _NONE
    relief_shades: Array = _NONE
    relief_mirrored: Array = _NONE
    sky_texels: Array = _NONE
    sky_size: Array = _NONE
    sky_to_world: Array = _NONE
    sky_compensated: Array = _NONE
    grid_size: Array = _NONE
    grid_first: Array = _NONE
    grid_grey: Array = _NONE
    grid_wrap: Array = _NONE
    grid_filter: Array = _NONE
    grid_to_world: Array = _NONE
    cells: Array = _NONE
    lobe_kind: Array = _NONE
    lobe_share: Array = _NONE
    lobe_g: Array = _NONE
    lobe_flakes: Array = _NONE
    lobe_values: Array = _NONE
    lobe_size: Array = _NONE
    phase_values: Array = _NONE
    phase_lobe: Array = _NONE
    phase_lobes: Array = _NONE
    albedo_grid: Array = _NONE
    sigma_t_grid: Array = _NONE
    emission_muted: Array = _NONE
    light_muted: Array = _NONE
    sky_muted: Array = _NONE
    muted_segments: Array = _NONE
