"""How surfaces run in space as u and v grow, and normals that textures turn, as in Mitsuba 3.9.

Source: Mitsuba 3 documentation, "Bump map", "Normal map"; what it leaves open was measured with
mitsuba 3.9.1. A point's frame: z the interpolated normal, x along the growth of u, y = z cross x.

=========== ======================================================================================
normalmap   the normal is 2 c - 1 in that frame, c the colour
bumpmap     heights h(u, v) raise the surface along z: the normal is that of p + h z
from behind the normal is the same, or inside of twosided its mirror image
flips       a normal on the other side of wo than the surface's is turned by half a turn about z
shades      light from wi by 2 / (1 + sqrt(1 + b tan^2 of (wi, z))), b = min(tan^2 of (normal, z) /
            8, 1)
=========== ======================================================================================

No light from where the two normals disagree about the side.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from reference.scene import Geometry, Material
from reference.textures import coordinates
from reference.vectors import cross, dot, unit


@dataclass(frozen=True, eq=False)
class Relief:
    """What turns the normals of a material; see above. heights: of a bump map, in world units."""

    heights: bool
    flips: bool
    shades: bool
    mirrored: bool
    scale: float


def derivatives(
    geometry: Geometry, primitive: np.ndarray, point: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """Of points (3, n) of primitives (n,) by u and by v (3, n)."""
    triangles, spheres, _ = geometry.counts
    out = np.zeros((2, 3, len(primitive)))
    at = np.flatnonzero(primitive < triangles)
    corners, uv = geometry.triangles[primitive[at]], geometry.uv[primitive[at]]
    edges, steps = corners[:, 1:] - corners[:, :1], uv[:, 1:] - uv[:, :1]
    good = np.linalg.det(steps) != 0
    out[:, :, at[good]] = np.linalg.solve(steps[good], edges[good]).transpose(1, 2, 0)
    if not good.all():
        normal = np.cross(*edges[~good].transpose(1, 0, 2)).T
        x = any_tangent(unit(normal))
        out[:, :, at[~good]] = x, cross(unit(normal), x)
    at = np.flatnonzero((primitive >= triangles) & (primitive < triangles + spheres))
    number = primitive[at] - triangles
    turn = geometry.frames[number]
    x, y, z = np.einsum("nij,jn->in", turn, point[:, at] - geometry.spheres[number, :3].T)
    flat = np.hypot(x, y)
    with np.errstate(invalid="ignore"):
        c, s = np.where(flat > 0, (x, y) / flat, [[1.0], [0.0]])
    local = 2 * np.pi * np.stack([-y, x, 0 * z]), np.pi * np.stack([z * c, z * s, -flat])
    for k in (0, 1):
        out[k][:, at] = np.linalg.solve(turn, local[k].T[:, :, None])[:, :, 0].T
    at = np.flatnonzero(primitive >= triangles + spheres)
    number = primitive[at] - triangles - spheres
    turned = geometry.turned[number]
    _, a, b = geometry.disks[number].transpose(1, 2, 0)
    a, b = np.where(turned, b, a), np.where(turned, a, b)
    radius, angle = coordinates(geometry, primitive[at], point[:, at])
    c, s = np.cos(2 * np.pi * angle), np.sin(2 * np.pi * angle)
    out[0][:, at], out[1][:, at] = c * a + s * b, 2 * np.pi * radius * (c * b - s * a)
    return out[0], out[1]


def any_tangent(n: np.ndarray) -> np.ndarray:
    """Mitsuba's first tangent (3, n) of unit normals (T. Duff et al., 2017)."""
    x, y, z = n
    sign = np.where(z < 0, -1.0, 1.0)
    a = -1 / (sign + z)
    return np.stack([1 + sign * x * x * a, sign * x * y * a, -sign * x])


def tangents(along: np.ndarray, normal: np.ndarray) -> np.ndarray:
    """``along`` made unit and perpendicular to unit normals (3, n)."""
    out = cross(cross(normal, along), normal)
    length = np.sqrt(dot(out, out))
    return np.where(length > 0, out / np.where(length > 0, length, 1), any_tangent(normal))


def turned(
    material: Material,
    geometry: Geometry,
    primitive: np.ndarray,
    point: np.ndarray,
    front: np.ndarray,
    normal: np.ndarray,
    wo: np.ndarray,
) -> tuple[np.ndarray, np.ndarray]:
    """The turned normals (3, n) on the front's side, and b (n,), -1 where nothing is turned; front,
    normal: ng and ns there."""
    relief, texture = material.relief, material.relief_texture
    by_u, by_v = derivatives(geometry, primitive, point)
    x = tangents(by_u, normal)
    y = cross(normal, x)
    uv = coordinates(geometry, primitive, point)
    if relief.heights:
        slope = relief.scale * texture.slope(uv)
        across = [d - dot(d, normal) * normal for d in (by_u, by_v)]
        new = cross(across[0] + slope[0] * normal, across[1] + slope[1] * normal)
        new *= np.where(dot(new, front) < 0, -1.0, 1.0)
        local = np.stack([dot(x, new), dot(y, new), dot(normal, new)])
    else:
        local = 2 * texture.at(uv) - 1
    back = dot(front, wo) < 0
    if relief.mirrored:  # as if wo were in front
        wo = wo - 2 * np.where(back, dot(wo, normal), 0) * normal
    if relief.flips:
        new = local[0] * x + local[1] * y + local[2] * normal
        away = dot(new, wo) * dot(normal, wo) <= 0
        local[:2] *= np.where(away, -1.0, 1.0)
    local /= np.sqrt(dot(local, local))
    with np.errstate(divide="ignore", invalid="ignore"):
        b = np.minimum((1 / local[2] ** 2 - 1) / 8, 1)
    if relief.mirrored:
        local[:2] *= np.where(back, -1.0, 1.0)
    b = np.where((local[:2] == 0).all(axis=0) & (local[2] > 0), -1.0, b * relief.shades)
    return local[0] * x + local[1] * y + local[2] * normal, b


def shade(
    own: np.ndarray, new: np.ndarray, b: np.ndarray, wi: np.ndarray, passes: np.ndarray | bool
) -> np.ndarray:
    """What is left (n,) of light from wi (3, n); own, new: normals on one side. b: -1 for none."""
    cosine = dot(own, wi)
    with np.errstate(divide="ignore", invalid="ignore"):
        left = 2 / (1 + np.sqrt(1 + np.maximum(b, 0) * (1 / np.minimum(cosine**2, 1) - 1)))
    left = np.where(cosine * dot(new, wi) > 0, left, 0)
    return np.where((b < 0) | passes, 1.0, left)
