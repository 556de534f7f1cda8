"""The frames in which normal textures of glTF files are meant: those of MikkTSpace.

x lies along u, and y along the growth of v upwards on the image: of triangles that show the image
mirrored, against the normal's cross product with x.
"""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import numpy.typing as npt

from . import mesh

Array = npt.NDArray[Any]
_SAMPLE = 100_000  # triangles of a mesh that are looked at, about


def handedness(uv: Array) -> Array:
    """Of triangles with texture coordinates (T, 3, 2), v down: 1 where they show an image as it is,
    -1 where mirrored, 0 where neither."""
    with np.errstate(all="ignore"):
        a, b = (uv[:, k] - uv[:, 0] for k in (1, 2))
        result: Array = np.sign(a[:, 1] * b[:, 0] - a[:, 0] * b[:, 1])
    return result


def agree(
    tangents: Array, faces: Array, hand: Array, vertices: Array, uv: Array, normals: Array
) -> bool:
    """Whether tangents (V, 4) are those of MikkTSpace, to 5 degrees at 99 % of the triangles'
    corners: the directions of u of the triangles around, weighted by their angles. Corners are one
    where place, normal, texture coordinates and hand are equal. Of many triangles, those at some
    places are looked at."""
    if tangents.shape != (len(vertices), 4):
        return False
    chosen = np.ones(len(vertices), bool)
    if len(faces) > _SAMPLE:
        chosen = _hashes(vertices) % np.uint64(3 * len(faces) // _SAMPLE) == 0
        some = chosen[faces].any(axis=1)
        faces, hand = faces[some], hand[some]
    used, faces = np.unique(faces, return_inverse=True)
    faces, rows = faces.reshape(-1, 3), np.concatenate([vertices, normals, uv], axis=1)[used]
    _, welded = np.unique(_hashes(rows), return_inverse=True)
    groups = (2 * welded.reshape(-1)[faces] + (hand < 0)[:, None]).ravel()
    with np.errstate(all="ignore"):
        across = _across(rows[faces], hand)
        sums = [np.bincount(groups, column)[groups] for column in across.T]
        along, given = np.stack(sums, axis=1), tangents[used][faces.ravel()]
        near = mesh.dot(mesh.unit(along), mesh.unit(given[:, :3])) > math.cos(0.0873)
        near &= np.repeat(hand, 3) * given[:, 3] > 0
    judged = near[along.any(axis=1) & chosen[used][faces.ravel()]]
    return bool(judged.mean() >= 0.99) if len(judged) else True


def _across(rows: Array, hand: Array) -> Array:
    """At each corner (3 T, 3) the direction of u across the normal, as long as the angle there;
    rows (T, 3, 8): places, normals and texture coordinates."""
    corners, normals, places = np.split(rows, [3, 6], axis=2)
    a, b = (corners[:, k] - corners[:, 0] for k in (1, 2))
    v1, v2 = (places[:, k, 1:] - places[:, 0, 1:] for k in (1, 2))
    of_u = mesh.unit((b * v1 - a * v2) * hand[:, None])
    edges = [mesh.unit(corners[:, (k + 1) % 3] - corners[:, k]) for k in range(3)]
    result = []
    for k in range(3):
        normal = mesh.unit(normals[:, k])
        across = mesh.unit(of_u - normal * mesh.dot(of_u, normal)[:, None])
        result.append(across * mesh.angles(edges[k], -edges[k - 1])[:, None])
    return np.stack(result, axis=1).reshape(-1, 3)


def _hashes(rows: Array) -> Array:
    """Numbers (N,) uint64 of rows (N, K), equal where these are; else hardly ever."""
    result = np.zeros(len(rows), np.uint64)
    for column in rows.T:
        bits = (column.astype(np.float64) + 0.0).view(np.uint64)  # -0 is 0
        result = (result ^ bits) * np.uint64(0x9E3779B97F4A7C15)
        result ^= result >> np.uint64(29)
    return result
