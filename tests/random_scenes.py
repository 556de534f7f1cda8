"""Random valid scenes as Mitsuba XML: hypothesis strategies, and their judgement.

Hypothesis draws the contents of a scene, so these shrink. The placement comes from a generator
seeded with a drawn integer, so that no two surfaces coincide by chance.
"""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt
from hypothesis import strategies as st
from scipy import stats

import reference
import veriray
from veriray.comparison.statistics import MARGIN
from veriray.rendering import METHODS
from veriray_validate.statistics import homogeneous, sidak

Array = npt.NDArray[Any]
SIZE, BATCHES = 6, 32
#: Columns of the ledger that end a path.
ENDS = ("escaped", "emitter_end", "absorbed", "rr_killed", "depth_cut", "invalid")


# ---- pieces of XML ----


def tag(what: str, kind: str, *content: str, **attributes: str) -> str:
    """An object."""
    more = "".join(f' {key}="{value}"' for key, value in attributes.items())
    return f'<{what} type="{kind}"{more}>{"".join(content)}</{what}>'


def value(kind: str, name: str, *numbers: Any) -> str:
    """A parameter; numbers in full."""
    text = ", ".join(repr(x.item() if isinstance(x, np.generic) else x) for x in numbers)
    return f'<{kind} name="{name}" value="{text.lower()}"/>'


def place(matrix: Array) -> str:
    """to_world."""
    numbers = " ".join(repr(float(x)) for x in matrix.ravel())
    return f'<transform name="to_world"><matrix value="{numbers}"/></transform>'


def xyz(kind: str, name: str, at: Array) -> str:
    """A point or vector."""
    x, y, z = (repr(float(c)) for c in at)
    return f'<{kind} name="{name}" x="{x}" y="{y}" z="{z}"/>'


# ---- strategies ----

share = st.sampled_from([0.1, 0.35, 0.6, 0.9, 1.0])
index = st.sampled_from([1.0, 1.0001, 1.33, 1.5, 2.4])


@st.composite
def colours(draw: st.DrawFn, name: str, top: float = 1.0) -> str:
    """One number or three, above 0 and at most `top`; an extinction and an intensity may be 0.

    Each renderer decides when and how a path of weight 0 ends, so there are none (nor coats of an
    index below 1, which reflect all light at grazing angles, nor lamps without light).
    """
    dark = name in ("sigma_t", "intensity", "irradiance")
    level = st.one_of(share, st.just(0.0)) if dark else share
    return value("rgb", name, *(top * draw(level) for _ in range(draw(st.sampled_from([1, 3])))))


@st.composite
def opaque(draw: st.DrawFn) -> str:
    """An opaque material."""
    kind = draw(st.sampled_from(["diffuse", "plastic", "conductor", "mirror", "black"]))
    if kind == "black":
        return tag("bsdf", "diffuse", value("rgb", "reflectance", 0.0))
    if kind == "diffuse":
        return tag("bsdf", "diffuse", draw(colours("reflectance")))
    if kind == "plastic":
        return tag("bsdf", "plastic", draw(colours("diffuse_reflectance")),
                   value("boolean", "nonlinear", draw(st.booleans())),
                   value("float", "int_ior", draw(index)),
                   value("float", "ext_ior", 1.0))  # fmt: skip
    if kind == "conductor":
        return tag("bsdf", "conductor", value("rgb", "eta", 0.2, 0.9, 1.4),
                   value("rgb", "k", 3.9, 2.4, 1.6))  # fmt: skip
    return tag("bsdf", "conductor", draw(colours("specular_reflectance")))


@st.composite
def clear(draw: st.DrawFn) -> str:
    """A material that transmits light."""
    kind = draw(st.sampled_from(["null", "dielectric", "thindielectric", "mask"]))
    if kind == "null":
        return tag("bsdf", "null")
    if kind == "mask":
        return tag(
            "bsdf",
            "mask",
            value("float", "opacity", draw(st.one_of(share, st.just(0.0)))),
            draw(opaque()),
        )
    return tag("bsdf", kind, value("float", "int_ior", draw(st.one_of(index, st.just(0.7)))),
               value("float", "ext_ior", 1.0), draw(colours("specular_transmittance")))  # fmt: skip


@st.composite
def media(draw: st.DrawFn, name: str) -> str:
    """A medium; `name`: interior, exterior or "" for the camera's."""
    phase = tag("phase", "isotropic")
    if draw(st.booleans()):
        phase = tag("phase", "hg", value("float", "g", draw(st.sampled_from([0.6, -0.5, 0.95]))))
    attribute = {"name": name} if name else {}
    return tag("medium", "homogeneous", draw(colours("sigma_t", 3.0)), draw(colours("albedo")),
               phase, **attribute)  # fmt: skip


def turn(rng: np.random.Generator) -> Array:
    """A random rotation."""
    q, r = np.linalg.qr(rng.normal(size=(3, 3)))
    q = q * np.sign(np.diag(r))
    q[:, 0] *= np.linalg.det(q)
    return q


@st.composite
def bodies(draw: st.DrawFn, rng: np.random.Generator, centre: Array, size: float, fog: str) -> str:
    """A shape about `centre` within the radius `size`. fog: the medium around, "" for none."""
    kind = draw(st.sampled_from(["sphere", "cube", "rectangle", "disk", "mesh", "smooth"]))
    solid = kind in ("sphere", "cube", "mesh", "smooth")
    through = draw(st.booleans())
    bsdf = draw(clear() if through else opaque())
    if not through and draw(st.booleans()):
        both = [bsdf] if draw(st.booleans()) else [
            one.replace("<bsdf ", f'<bsdf name="{side}" ', 1)
            for side, one in (("front", bsdf), ("back", draw(opaque())))
        ]  # fmt: skip
        bsdf = tag("bsdf", "twosided", *both)
    content = [bsdf]
    # An emitting clear mesh whose normals turn away may end paths in either of two ways: excluded.
    if draw(st.integers(0, 3)) == 0 and not (through and kind == "smooth"):
        content.append(tag("emitter", "area", draw(colours("radiance", 5.0))))
    inner = draw(media("interior")) if solid and draw(st.booleans()) else ""
    if inner or (fog and solid):
        content += [inner, fog]
    matrix = np.eye(4)
    matrix[:3, 3] = centre
    if kind == "sphere":
        content += [xyz("point", "center", centre), value("float", "radius", size)]
    else:
        stretch = rng.uniform(0.3, 1, 3) * size / (1 if kind == "disk" or not solid else 3**0.5)
        if kind in ("mesh", "smooth"):
            stretch = np.full(3, size)
        matrix[:3, :3] = turn(rng) * stretch
        content.append(place(matrix))
    if kind in ("mesh", "smooth"):
        content.append('<string name="filename" value="ball.obj"/>')
        content.append(value("boolean", "face_normals", kind == "mesh"))
        kind = "obj"
    elif not solid:
        content.append(value("boolean", "flip_normals", draw(st.booleans())))
    return tag("shape", kind, *content)


@st.composite
def lights(draw: st.DrawFn, rng: np.random.Generator) -> str:
    """A light without a surface, outside of all bodies' spheres."""
    kind = draw(st.sampled_from(["point", "spot", "directional"]))
    way = turn(rng)[:, 2]
    intensity = draw(colours("intensity" if kind != "directional" else "irradiance", 6.0))
    at = 1.9 * way
    if kind == "point":
        return tag("emitter", "point", xyz("point", "position", at), intensity)
    if kind == "directional":
        return tag("emitter", "directional", xyz("vector", "direction", way), intensity)
    matrix = np.eye(4)
    frame = turn(rng)
    frame[:, 2] = -way
    frame[:, 0] = np.cross(frame[:, 1], -way)
    frame[:, 0] /= np.linalg.norm(frame[:, 0])
    frame[:, 1] = np.cross(-way, frame[:, 0])
    matrix[:3, :3], matrix[:3, 3] = frame, at
    return tag("emitter", "spot", place(matrix), intensity, value("float", "cutoff_angle", 50.0),
               value("float", "beam_width", 20.0))  # fmt: skip


@st.composite
def sensors(draw: st.DrawFn, rng: np.random.Generator, fog: str) -> str:
    """A camera 2.2 from the middle, of SIZE x SIZE pixels."""
    way = turn(rng)
    matrix = np.eye(4)
    matrix[:3, :3] = way
    matrix[:3, 3] = -2.2 * way[:, 2] + rng.uniform(-0.1, 0.1, 3)
    rfilter = draw(st.sampled_from(["box", "tent", "gaussian", "mitchell"]))
    content = [
        value("float", "fov", draw(st.sampled_from([5.0, 40.0, 75.0, 120.0]))),
        place(matrix), fog.replace(' name="exterior"', ""),
        tag("film", "hdrfilm", value("integer", "width", SIZE), value("integer", "height", SIZE),
            tag("rfilter", rfilter)),
    ]  # fmt: skip
    if draw(st.booleans()):
        content += [value("float", "near_clip", 1.3), value("float", "far_clip", 3.1)]
    if draw(st.booleans()):
        lens = value("float", "aperture_radius", 0.1), value("float", "focus_distance", 2.0)
        return tag("sensor", "thinlens", *content, *lens)
    return tag("sensor", "perspective", *content)


@st.composite
def scenes(draw: st.DrawFn) -> str:
    """A scene file; it refers to ball.obj of `write_meshes`."""
    rng = np.random.default_rng(draw(st.integers(0, 2**32 - 1)))
    depth = draw(st.sampled_from([1, 2, 3, 6, 16]))
    parts = [tag("integrator", "volpath", value("integer", "max_depth", depth),
                 value("integer", "rr_depth", draw(st.sampled_from([1, 2, 5, 50]))))]  # fmt: skip
    fog = draw(media("exterior")) if draw(st.integers(0, 3)) == 0 else ""
    parts.append(draw(sensors(rng, fog)))
    around = draw(st.sampled_from(["nothing", "floor", "room"]))
    if around == "floor":
        matrix = np.diag([3.0, 3.0, 1.0, 1.0])
        matrix[2, 3] = -1.5
        parts.append(
            tag("shape", "rectangle", place(matrix), tag("bsdf", "twosided", draw(opaque())))
        )
    elif around == "room":
        parts.append(tag("shape", "cube", place(np.diag([3.1, 3.3, 3.2, 1.0])), draw(opaque()),
                         value("boolean", "flip_normals", True)))  # fmt: skip
    for _ in range(draw(st.integers(0, 4))):
        centre, size = rng.uniform(-1, 1, 3) * 0.8, float(rng.uniform(0.15, 0.7))
        parts.append(draw(bodies(rng, centre, size, fog)))
    parts += [draw(lights(rng)) for _ in range(draw(st.integers(0, 2)))]
    if draw(st.booleans()):
        parts.append(tag("emitter", "constant", draw(colours("radiance", 2.0))))
    return '<scene version="3.0.0">\n' + "\n".join(parts) + "\n</scene>\n"


def write_meshes(folder: Path) -> None:
    """ball.obj: an octahedron of radius 1 whose faces are split in four; no normals."""
    corners = [(1, 0, 0), (-1, 0, 0), (0, 1, 0), (0, -1, 0), (0, 0, 1), (0, 0, -1)]
    vertices: list[Array] = []
    faces = []
    for x in (0, 1):
        for y in (2, 3):
            for z in (4, 5):
                a, b, c = (np.array(corners[k], float) for k in (x, y, z))
                if np.cross(b - a, c - a) @ (a + b + c) < 0:
                    b, c = c, b
                ab, bc, ca = ((p + q) / np.linalg.norm(p + q) for p, q in ((a, b), (b, c), (c, a)))
                for face in ((a, ab, ca), (b, bc, ab), (c, ca, bc), (ab, bc, ca)):
                    row = []
                    for p in face:
                        same = [k for k, q in enumerate(vertices) if np.allclose(p, q)]
                        if not same:
                            vertices.append(p)
                        row.append(same[0] + 1 if same else len(vertices))
                    faces.append(row)
    lines = ["v {!r} {!r} {!r}".format(*map(float, v)) for v in vertices]
    lines += ["f {} {} {}".format(*face) for face in faces]
    (folder / "ball.obj").write_text("\n".join(lines) + "\n")


# ---- judgement ----


def ends(ledger: dict[str, Any], depth: int) -> Array:
    """How many paths ended at each depth from each cause, as one row; live paths count once."""
    columns = [np.asarray(ledger[name], np.int64) for name in ENDS]
    return np.concatenate([np.pad(c, (0, depth - len(c))) for c in columns])


def against_the_reference(path: Path, scene: veriray.Scene, seed: int, effort: int) -> float:
    """The p value of our picture and its ledger against the reference's, equal samples.

    Welch's test of the picture's mean by channel over BATCHES batches, Pearson's of the ends of
    paths; Sidak over the four. A difference below MARGIN of the mean does not count. Under wider
    filters than a box our paths are spread evenly over the pixels, the reference's by the filter:
    their ends are not compared.
    """
    spp = 256 * effort
    ours = veriray.render(scene, spp=spp, seed=seed, batches=BATCHES, device="cpu")
    theirs = reference.render(reference.load(path), spp=spp, seed=seed + 1, batches=BATCHES)
    a, b = (x.mean(axis=(1, 2)) for x in (ours.batch_means, theirs.batch_means))
    mean = (np.abs(a).mean(axis=0) + np.abs(b).mean(axis=0)) / 2
    off = np.maximum(np.abs(a.mean(axis=0) - b.mean(axis=0)) - MARGIN * mean, 0)
    va, vb = a.var(axis=0, ddof=1) / BATCHES, b.var(axis=0, ddof=1) / BATCHES
    worst = 1.0
    for d, x, y in zip(off, va, vb, strict=True):
        if d > 0:
            total = max(x + y, 1e-300)
            freedom = (BATCHES - 1) * total**2 / max(x**2 + y**2, 1e-300)
            worst = min(worst, 2 * float(stats.t.sf(d / total**0.5, freedom)))
    if scene.film.filter != "box":
        return sidak(worst, 3)
    ledger = {c: theirs.ledger[:, k] for k, c in enumerate(reference.COLUMNS)}
    depth = max(len(theirs.ledger), len(ours.stats["live_rays"]))
    rows = np.stack([ends(x, depth) for x in (ours.stats["ledger"], ledger)])
    worst = min(worst, homogeneous(rows[:, rows.sum(axis=0) > 0]))
    return sidak(worst, 4)


def judge(text: str, path: Path) -> None:
    """Renders the scene in three ways, with equal bits and no faults, and against the reference."""
    path.write_text(text)
    scene = veriray.load_file(path)
    first = veriray.render(scene, spp=16, seed=1, device="cpu", scheduler="fused", threads=1)
    assert first.stats["nonfinite_samples"] == 0, first.stats["nonfinite"]
    for scheduler in METHODS[1:]:
        again = veriray.render(scene, spp=16, seed=1, device="cpu", scheduler=scheduler, threads=2,
                               batch_size=100, all_features=True)  # fmt: skip
        assert first.film_sha256 == again.film_sha256, scheduler
        assert first.stats["ledger"] == again.stats["ledger"], scheduler
    p = against_the_reference(path, scene, 2, 1)
    if p < 1e-3:
        confirmed = against_the_reference(path, scene, 4, 4)
        assert confirmed >= 1e-4, f"p = {p:.2g}, with 4 times the samples {confirmed:.2g}"
