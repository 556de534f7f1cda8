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
    """Whether tangents (V, 4) are those of MikkTSpace, to 5 degrees at 99 % of the vertices: the
    directions of u of the triangles around, weighted by their angles."""
    if tangents.shape != (len(vertices), 4):
        return False
    along, hands = np.zeros_like(vertices), np.zeros(len(vertices))
    with np.errstate(all="ignore"):
        corners, places, normals = vertices[faces], uv[faces], mesh.unit(normals)
        a, b = (corners[:, k] - corners[:, 0] for k in (1, 2))
        v1, v2 = (places[:, k, 1:] - places[:, 0, 1:] for k in (1, 2))
        of_u = mesh.unit((b * v1 - a * v2) * hand[:, None])
        edges = [mesh.unit(corners[:, (k + 1) % 3] - corners[:, k]) for k in range(3)]
        for k in range(3):
            row = faces[:, k]
            across = mesh.unit(of_u - normals[row] * mesh.dot(of_u, normals[row])[:, None])
            np.add.at(along, row, across * mesh.angles(edges[k], -edges[k - 1])[:, None])
            np.add.at(hands, row, hand)
        near = mesh.dot(mesh.unit(along), mesh.unit(tangents[:, :3])) > math.cos(0.0873)
        near &= hands * tangents[:, 3] > 0
    return bool(near[along.any(axis=1)].mean() >= 0.99) if along.any() else True
