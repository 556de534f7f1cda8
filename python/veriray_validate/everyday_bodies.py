"""Random scenes of single bodies: invisible ones, mirrored ones, sheared ones, outlines."""

from __future__ import annotations

import math
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt
import trimesh
from trimesh.transformations import random_rotation_matrix

from veriray_validate import dicts
from veriray_validate.everyday import Question, decades, gridded, moved
from veriray_validate.everyday_scale import chosen, framed, square
from veriray_validate.fresnel import fresnel
from veriray_validate.scenes import NULL, Medium, Part, camera, disk, make, material, quad, sphere

Array = npt.NDArray[Any]

#: Materials that let all light straight through; those of the second table only lose none of it.
UNSEEN: dict[str, dict[str, Any]] = {
    "null": {"material": NULL},
    "glass of index 1": {"material": material("dielectric", eta=1.0)},
    "thin glass of index 1": {"material": material("thindielectric", eta=1.0)},
    "opacity 0": {"reflectance": 1.0, "material": material("diffuse", opacity=0.0)},
    "fog of 0": {"material": NULL, "interior": Medium(0.0, 0.5)},
}
LOSSLESS: dict[str, dict[str, Any]] = {
    "thin glass": {"material": material("thindielectric", eta=1.5)},
    "glass": {"material": material("dielectric", eta=1.5)},
    "fog": {"material": NULL, "interior": Medium(2.0, 1.0)},
    "mirror of index 0": {"material": material("conductor", eta=0.0, k=0.0)},
}


def mesh(rng: np.random.Generator, faces: float) -> tuple[Array, Array, str]:
    """Vertices, faces and name of a closed mesh with about that many faces, around the unit ball.

    It is a subdivided octahedron as a ball, a box or a lens; half of the draws are bumpy.
    """
    n = max(0, round(math.log(faces / 8, 4)))
    vertices = np.concatenate([np.eye(3), -np.eye(3)])
    index = [[0, 1, 2], [1, 3, 2], [3, 4, 2], [4, 0, 2], [1, 0, 5], [3, 1, 5], [4, 3, 5], [0, 4, 5]]
    body = trimesh.Trimesh(vertices, np.array(index), process=False)
    for _ in range(n):
        body = body.subdivide()
    v = np.array(body.vertices)
    form = chosen(rng, ("octahedron", "ball", "lens", "bumpy ball"))
    if form != "octahedron":
        v /= np.linalg.norm(v, axis=1)[:, None]
    if form == "lens":
        v[:, 2] *= 10 ** rng.uniform(-2, -0.5)
    if form == "bumpy ball":
        v *= 1 + rng.uniform(-0.1, 0.1, (len(v), 1))
    return v, np.array(body.faces), f"{form} of {len(body.faces)}"


def vertex_normals(vertices: Array, faces: Array) -> Array:
    """Normals of the vertices of a mesh, (V, 3)."""
    return np.array(trimesh.Trimesh(vertices, faces, process=False).vertex_normals)


def body(rng: np.random.Generator, kind: dict[str, Any], most: float = 4.9,
         convex: bool = False) -> tuple[Part, str]:  # fmt: skip
    """A rotated body of a material: a primitive, or a mesh of 8 to 10^most faces."""
    form = chosen(rng, ("mesh", "mesh", "cube", "cube of quads", "sphere"))
    turn = random_rotation_matrix(rng.random(3))
    if form == "sphere":
        return sphere([0, 0, 0], 1, **kind), form
    if form.startswith("cube"):
        n = 1 if form == "cube" else int(rng.integers(2, 8))
        part = gridded([-0.7, -0.7, -0.7], [0.7, 0.7, 0.7], n, **kind)
        form = f"cube {n} x {n}"
    else:
        vertices, faces, form = mesh(rng, 10 ** rng.uniform(0.9, most))
        part = Part(vertices, faces, **kind)
        if rng.random() < 0.6 and not convex:
            part.normals = vertex_normals(vertices, faces) @ turn[:3, :3].T
            form += ", smooth"
    moved([part], turn)
    return part, form


def unseen(rng: np.random.Generator) -> Question:
    """Under a sky of 1, around nothing, the camera or everything: 1. In front of a lit scene: that.

    Camera and shadow rays go straight on, so with the same random numbers hardly any noise is left.
    """
    name = chosen(rng, list(UNSEEN))
    part, form = body(rng, UNSEEN[name])
    where = chosen(rng, ("before", "around the camera", "around all"))
    size = {"before": 1.0, "around the camera": 0.05, "around all": 30.0}[where]
    eye = np.array([0, -4.0, 1.5])
    at = {"before": eye * 0.45, "around the camera": eye, "around all": [0, 0, 0]}[where]
    moved([part], np.diag([size, size, size, 1.0]))
    part.spheres *= size
    part.vertices, part.spheres = part.vertices + at, part.spheres + [*at, 0]
    view = camera(eye, [0, 0, 0.3], 40, [0, 0, 1])
    size16: dict[str, Any] = {"width": 16, "height": 16, "max_depth": 1000}
    drawn = f"{name}, {form}, {where}"
    if rng.random() < 0.4:
        return Question(drawn + ", sky", make([part], view, 1.0, **size16), 1.0)
    lit = [quad([-3, -3, 0], [6, 0, 0], [0, 6, 0], 0.6),
           quad([-1.5, 0, 2.5], [3, 0, 0], [0, -2, 2], 0, 3),
           sphere([0.3, 0, 0.5], 0.5, 0.8)]  # fmt: skip
    return Question(drawn + ", lit", make([*lit, part], view, 0.2, **size16),
                    make(lit, view, 0.2, **size16), 3e-4, 3e-3, 0.05)  # fmt: skip


def lossless(rng: np.random.Generator) -> Question:
    """A body that absorbs no light, under a sky of 1: 1, silhouette and all.

    Refraction by interpolated normals has no such truth: the shading normal decides the indices of
    the two sides, and light that enters by one side and leaves by the other gains or loses n^2.
    A mirror is seen head-on.
    """
    name = chosen(rng, list(LOSSLESS))
    if name == "mirror of index 0":
        part, w = square(1.0, **LOSSLESS[name]), decades(rng, -4, -0.3)
        form, view = f"square, {w:g} seen", framed(w, 4.0)
    else:
        part, form = body(rng, LOSSLESS[name], 4, name == "glass")
        view = camera([0, -4.0, 1.5], [0, 0, 0], 25, [0, 0, 1])
    seen = make([part], view, 1.0, width=16, height=16, max_depth=-1)
    return Question(f"{name}, {form}", seen, 1.0)


def smooth(rng: np.random.Generator, name: str) -> Question:
    """A body of 8 to 512 faces with interpolated normals, under a sky of 1: 1.

    Of such faces many normals look away from who sees them. Of a kind of UNSEEN, or thin glass.
    """
    kind = UNSEEN.get(name) or LOSSLESS[name]
    turn = random_rotation_matrix(rng.random(3))
    vertices, faces, form = mesh(rng, 10 ** rng.uniform(0.9, 2.7))
    normals = vertex_normals(vertices, faces) @ turn[:3, :3].T
    part = Part(vertices, faces, normals=normals, **kind)
    moved([part], turn)
    view = camera([0, -4.0, 1.5], [0, 0, 0], 25, [0, 0, 1])
    seen = make([part], view, 1.0, width=16, height=16, max_depth=-1)
    return Question(f"{name}, {form}", seen, 1.0)


def past_the_horizon(rng: np.random.Generator) -> Question:
    """Smooth glass whose normals are turned away from who looks: it mirrors along its face.

    A square with one normal for all of it, up to 40 degrees off its own, which shows a lamp that
    stands on its plane and ends below the mirror image that the square's own normal would show.
    The truth is Fresnel's reflectance at the normal's cosine to the view, at least 2^-6 before the
    normal bent to that has length 1 again.
    """
    rise = math.radians(rng.uniform(6, 35))
    turn = rise * (rng.uniform(1.1, 1.5) if rng.random() < 0.5 else rng.uniform(0.6, 0.9))
    turn = min(turn, math.radians(40))
    cosine = math.sin(rise - turn)
    if cosine <= 0:
        cosine = 2**-6 / math.sqrt(1 - cosine**2 + 2**-12)
    eta = rng.uniform(1.3, 1.8)
    plate = quad([-1, -1, 0], [2, 0, 0], [0, 2, 0], material=material("dielectric", eta=eta))
    lamp = quad([8, 40, 0], [0, -80, 0], [0, 0, 4 * math.tan(rise)], emission=1.0)
    whole = random_rotation_matrix(rng.random(3))
    moved([plate, lamp], whole)
    plate.normals = np.tile(whole[:3, :3] @ [math.sin(turn), 0, math.cos(turn)], (4, 1))
    eye = whole[:3, :3] @ [-10 * math.cos(rise), 0, 10 * math.sin(rise)]
    seen = make([plate, lamp], camera(eye, [0, 0, 0], 0.02), width=16, height=16, max_depth=4)
    told = f"rise {rise:.4g}, normal turned by {turn:.4g}, index {eta:.4g}"
    return Question(told, seen, float(fresnel(cosine, eta)), margin=2e-3, blocks=5e-3)


def folded(rng: np.random.Generator) -> Question:
    """A smooth ball so bumpy that vertex normals point through some faces, full of white fog.

    Under a sky of 1: 1; all light that enters leaves.
    """
    v, f, _ = mesh(np.random.default_rng(0), 10 ** rng.uniform(2.5, 4))
    v /= np.linalg.norm(v, axis=1)[:, None]
    bumps = decades(rng, -1, -0.3)
    part = Part(v * (1 + rng.uniform(-bumps, bumps, (len(v), 1))), f, **LOSSLESS["fog"])
    part.normals = vertex_normals(part.vertices, f)
    view = camera([0, -4.0, 1.5], [0, 0, 0], 35, [0, 0, 1])
    seen = make([part], view, 1.0, width=16, height=16, max_depth=-1)
    return Question(f"ball of {len(f)} with bumps of {bumps:g}", seen, 1.0)


def outline(rng: np.random.Generator) -> Question:
    """A convex white body with a black back, under a sky of 1: its back is not seen.

    It is stretched and sheared by small factors; no camera ray may end on the first surface. Much
    thinner bodies, or distant ones, are thin compared with rounding, and their faces change places
    at an edge.
    """
    part, form = body(rng, {"reflectance": 1.0}, 3, True)
    matrix = np.eye(4)
    if len(part.faces):
        while "bumpy" in form or "lens" in form:
            part, form = body(rng, {"reflectance": 1.0}, 3, True)
        matrix[:3, :3] = np.diag(10 ** rng.uniform(-0.5, 0, 3))
        matrix[:3, :3] += np.triu(rng.uniform(-0.5, 0.5, (3, 3)), 1)
        moved([part], matrix)
    distance = decades(rng, 0.6, 1)
    view = camera(distance * _way(rng), [0, 0, 0],
                  2 * math.degrees(math.atan(1.0 / distance)))  # fmt: skip
    more = [quad([0, 0, 0], [1e-5, 0, 0], [0, 1e-5, 0])] if rng.random() < 0.3 else []
    seen = make([part, *more], view, 1.0, width=32, height=32)
    axes = np.linalg.svd(matrix[:3, :3])[1].round(3)
    return Question(f"{form}, axes {axes}, {distance:g} away{', tree' if more else ''}", seen, 1.0,
                    spp=1024, backs=True)  # fmt: skip


def _way(rng: np.random.Generator) -> Array:
    v = rng.normal(size=3)
    return v / np.linalg.norm(v)


# ---- transforms ----

STUFF: dict[str, dict[str, Any]] = {
    "fog": {"bsdf": dicts.NULL, "interior": dicts.medium(1.5, 0.7)},
    "glass": {"bsdf": dicts.glass(1.5)},
    "milky glass": {"bsdf": dicts.glass(1.5), "interior": dicts.medium(1.5, 0.7)},
    "diffuse": {"bsdf": dicts.diffuse(0.6)},
    "plastic": {"bsdf": dicts.plastic(0.6, 1.5)},
    "lamp": {"bsdf": dicts.BLACK, "emitter": dicts.area(2)},
}


FORMS = ("cube", "sphere", "ball.ply", "normals.ply", "ball.obj", "octahedron.ply")


def files(folder: Path) -> None:
    """Symmetric meshes: an icosphere (PLY with and without normals, OBJ) and an octahedron."""
    ball = trimesh.creation.icosphere(subdivisions=2)
    ball.export(folder / "ball.ply", vertex_normal=False)
    ball.export(folder / "normals.ply", vertex_normal=True)
    lines = ["v {:.17g} {:.17g} {:.17g}".format(*v) for v in ball.vertices]
    lines += ["f {} {} {}".format(*(f + 1)) for f in ball.faces]
    (folder / "ball.obj").write_text("\n".join(lines) + "\n")
    v, f, _ = mesh(np.random.default_rng(0), 8)
    trimesh.Trimesh(np.sign(v) * (abs(v) > 0.5), f, process=False).export(folder / "octahedron.ply")


def mirrored(folder: Path) -> Callable[[np.random.Generator], Question]:
    """A symmetric body under a transform that mirrors, and under the same one without the mirror.

    It is rotated, stretched and sheared, except for spheres; its inside stays inside.
    """

    def draw(rng: np.random.Generator) -> Question:
        form = chosen(
            rng, ("cube", "sphere", "ball.ply", "normals.ply", "ball.obj", "octahedron.ply")
        )
        flat, name = bool(rng.random() < 0.5), chosen(rng, list(STUFF))
        matrix = random_rotation_matrix(rng.random(3))
        if form == "sphere":
            matrix[:3, :3] *= rng.uniform(0.4, 1.0)
        else:
            shear = np.diag(rng.uniform(0.4, 1.0, 3)) + np.triu(rng.uniform(-0.3, 0.3, (3, 3)), 1)
            matrix[:3, :3] @= shear
        mirror = np.diag([*(-np.eye(3)[int(rng.integers(3))] * 2 + 1), 1.0])
        if rng.random() < 0.3:
            mirror = np.diag([-1.0, -1, -1, 1])
        thing: dict[str, Any] = {"type": form}
        if "." in form:
            thing = {"type": form[-3:], "filename": str(folder / form), "face_normals": flat}
        eye = dicts.view([0, -4, 1.5], [0, 0, 0], 28, 16, up=[0, 0, 1])
        floor = dicts.flat("rectangle", [0, 0, -1.8], [0, 0, 1], 3, dicts.diffuse(0.5))
        pair = [dicts.scene(eye, {**thing, **STUFF[name], "to_world": m}, floor, dicts.sky(0.5),
                            max_depth=-1) for m in (matrix @ mirror, matrix)]  # fmt: skip
        how = "flat" if flat and "." in form else "smooth" if "." in form else ""
        drawn = f"{name}, {form} {how} by {np.diag(mirror)[:3]}"
        # interpolated normals can keep light in glass for long
        return Question(drawn, *pair, 5e-4, 5e-3, 0.05, ends=how != "smooth")

    return draw


def explicit(rng: np.random.Generator) -> Question:
    """A rectangle, disk or cube by a matrix that shears and mirrors, and by its points.

    The front of a flat shape follows its normal under the inverse transpose, as in Mitsuba.
    """
    form = chosen(rng, ("rectangle", "disk", "cube"))
    matrix = random_rotation_matrix(rng.random(3))
    matrix[:3, :3] @= np.diag(rng.uniform(0.4, 1.0, 3)) + rng.uniform(-0.25, 0.25, (3, 3))
    m = matrix[:3, :3]
    if np.linalg.det(m) < 0:
        m[:, 0] *= -1
    mirror = bool(rng.random() < 0.5) and form != "disk"
    eye = dicts.view([0, -4, 1.5], [0, 0, 0], 28, 16, up=[0, 0, 1])
    floor = dicts.flat("rectangle", [0, 0, -1.8], [0, 0, 1], 3, dicts.diffuse(0.5))
    glow = {"bsdf": dicts.diffuse(0.6), "emitter": dicts.area(0.7)}
    place = matrix @ np.diag([-1.0 if mirror else 1.0, 1, 1, 1])
    seen = dicts.scene(eye, {"type": form, **glow, "to_world": place}, floor, dicts.sky(0.3))
    x, y, z = m.T
    own = {"reflectance": 0.6, "emission": 0.7}
    if form == "rectangle":
        part = quad(-x - y, 2 * x, 2 * y, **own)
    elif form == "disk":
        part = disk([0, 0, 0], x, y, **own)
    else:
        part = gridded([-1, -1, -1], [1, 1, 1], 3, **own)
        part.vertices = part.vertices @ m.T
    ground = quad([-3, -3, -1.8], [6, 0, 0], [0, 6, 0], 0.5)
    other = make([part, ground], seen.camera, 0.3, width=16, height=16)
    drawn = f"{form}{' mirrored' if mirror else ''} by {m.round(3).tolist()}"
    return Question(drawn, seen, other, 5e-4, 5e-3, 0.05)
