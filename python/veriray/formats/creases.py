"""Meshes with sharp edges: vertices are split where their faces differ by more than an angle."""

from __future__ import annotations

from typing import Any

import numpy as np
import numpy.typing as npt

from ..numeric import sin_cos_degrees
from .mesh import Mesh, face_normals

Array = npt.NDArray[Any]


def split(found: Mesh, angle: float) -> Mesh:
    """The mesh without normals, each vertex split into groups of faces that smooth shading joins.

    Corners at one place with the same texture coordinates are one vertex. The first of its faces
    takes all others within `angle` degrees of it, the next one that is left those that are left,
    and so on, as max_smooth_angle of Mitsuba 0.x does.
    """
    points = found.vertices if found.uv is None else np.hstack([found.vertices, found.uv])
    _, inverse = np.unique(points, axis=0, return_inverse=True)
    corners = inverse.reshape(-1)[found.triangles].reshape(-1)
    normals = np.repeat(face_normals(found.vertices, found.triangles), 3, axis=0)
    flat = np.asarray(~normals.any(axis=1))  # faces without area, which join any
    _, cosine = sin_cos_degrees(angle)
    group = np.empty(len(corners), np.int64)  # of each corner: its group's first corner
    left = np.argsort(corners, kind="stable")
    while len(left):
        begins = np.flatnonzero(np.diff(corners[left], prepend=-1))
        first = np.repeat(left[begins], np.diff(begins, append=len(left)))
        cosines: Array = (normals[left] * normals[first]).sum(axis=1)
        joined = (first == left) | (cosines >= cosine) | flat[left]
        group[left[joined]] = first[joined]
        left = left[~joined]
    kept, numbers = np.unique(group, return_inverse=True)
    vertex = found.triangles.reshape(-1)[kept]
    uv = None if found.uv is None else found.uv[vertex]
    return Mesh(found.vertices[vertex], numbers.reshape(-1, 3), None, uv, found.of_vertices(vertex))
