"""The table of scenarios: what is rendered, what is measured, and what it should reach."""

from __future__ import annotations

import re
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from veriray.shipped import SHIPPED, find_shipped

from .measure import Array

NO_ROULETTE = 1000  # rr_depth beyond every max_depth used here
BACKENDS = ("cpu", "cuda")
TARGET_RELMSE = 1e-3


@dataclass(frozen=True)
class Target:
    """What a figure should reach.

    figure: key of the result's `figures`; goals: backend -> (target, moonshot); below: the figure
    is to be at most that, else at least.
    """

    figure: str
    what: str
    goals: Mapping[str, tuple[float, float]]
    below: bool = False
    unit: str = ""


@dataclass(frozen=True)
class Scenario:
    """One measurement.

    scene: a shipped scene or one that `scene_file` makes. kind: a function of `kinds` or `studies`.
    size: width and height by backend; spp: samples per pixel, by backend; several for kind "error".
    vary: (setting, values) for kinds "scaling", "adaptive" and "roulette". schedulers: raced beside
    "auto". peers: whether other renderers take part. margin: relative difference of means that is
    no disagreement. limit: whether the physical limit of the box is stated.
    """

    name: str
    title: str
    scene: str
    kind: str
    size: Mapping[str, int]
    spp: Mapping[str, tuple[int, ...]]
    max_depth: int | None = 8
    rr_depth: int | None = 5
    rounds: int = 5
    vary: tuple[str, tuple[float, ...]] | None = None
    schedulers: tuple[str, ...] = ()
    reference_spp: int = 0
    margin: float = 1e-5
    limit: bool = False
    peers: bool = True
    backends: tuple[str, ...] = BACKENDS
    targets: tuple[Target, ...] = ()

    def settings(self, backend: str, quick: bool) -> dict[str, Any]:
        """Settings on one backend as plain data; quick: a smoke test of a few seconds."""
        size, spp, rounds = self.size[backend], self.spp[backend], self.rounds
        vary, reference = self.vary, self.reference_spp
        scene = self.scene
        if quick:
            size, rounds, reference = min(size, 64), 2, min(reference, 1024)
            spp = spp[:3] if len(spp) > 1 else (min(spp[0], 16),)
            vary = (vary[0], vary[1][:3]) if vary and self.kind != "roulette" else vary
            scene = "icosphere 4" if scene.startswith("icosphere") else scene
        out = {
            "scene": scene, "width": size, "height": size, "spp": list(spp),
            "max_depth": self.max_depth, "rr_depth": self.rr_depth, "rounds": rounds,
        }  # fmt: skip
        if vary:
            out["vary"] = [vary[0], list(vary[1])]
        return out | ({"reference_spp": reference} if reference else {})


def _both(cpu: Any, cuda: Any | None = None) -> dict[str, Any]:
    return {"cpu": cpu, "cuda": cpu if cuda is None else cuda}


_SIZE = _both(512, 1024)
_SPP = _both((64,), (256,))
_ONE = _both((64,))
_FEW = _both((16,), (64,))
_CURVE = _both((1, 4, 16, 64, 256))
_BOX, _MEDIUM, _MESH = "cornell-box-mitsuba", "glass medium", "icosphere 8"
_STARTS = ("rr_depth", (1, 2, 3, 5, 8, 16, NO_ROULETTE))
_RATE = "samples/s against Mitsuba's"
_TIME = "time to relMSE 1e-3 against Mitsuba's best sampler"

SCENARIOS: tuple[Scenario, ...] = (
    Scenario(
        "cornell", "Mitsuba's Cornell box", _BOX, "speed", _SIZE, _SPP, limit=True,
        schedulers=("thrust",),
        targets=(
            Target("times_faster", _RATE, {"cpu": (6, 12), "cuda": (12, 20)}, unit="x"),
            Target("percent_of_limit", "share of the 18-quad limit", {"cuda": (60, 120)}, unit="%"),
        ),
    ),
    Scenario("cornell-no-roulette", "the same without roulette", _BOX, "speed", _SIZE, _ONE,
             rr_depth=NO_ROULETTE, limit=True),
    Scenario("cornell-unlimited", "the same with paths of any length", _BOX, "speed", _SIZE, _ONE,
             max_depth=-1, limit=True),
    Scenario(
        "cornell-error", "time against error, Mitsuba's Cornell box", _BOX, "error", _SIZE, _CURVE,
        rounds=3, reference_spp=16384,
        targets=(Target("times_faster_to_target", _TIME, {"cpu": (7, 14), "cuda": (14, 28)},
                        unit="x"),),
    ),
    Scenario("sampler-error", "error against samples, independent and sobol", _BOX, "error",
             _both(256), _both((1, 4, 16, 64, 256, 1024, 4096)), rounds=3, reference_spp=65536,
             peers=False),
    Scenario("mesh-82k", "displaced icosphere, 81,920 triangles", "icosphere 6", "speed", _SIZE,
             _ONE, margin=3e-4),
    Scenario(
        "mesh-1.3M", "displaced icosphere, 1,310,720 triangles", _MESH, "speed", _SIZE, _ONE,
        margin=3e-4,
        targets=(Target("times_faster", _RATE, {"cpu": (1.3, 1.8), "cuda": (2, 3)}, unit="x"),),
    ),
    Scenario("mesh-error", "time against error, 1,310,720 triangles", _MESH, "error", _both(256),
             _CURVE, rounds=3, reference_spp=8192, margin=3e-4),
    Scenario(
        "medium", "glass sphere with a medium", _MEDIUM, "speed", _both(512), _ONE, max_depth=128,
        rr_depth=64, margin=1e-4,
        targets=(Target("times_faster", _RATE, {"cuda": (10, 20)}, unit="x"),),
    ),
    Scenario("medium-error", "time against error, glass sphere with a medium", _MEDIUM, "error",
             _both(256), _CURVE, max_depth=128, rr_depth=64, rounds=3, reference_spp=8192,
             margin=1e-4),
    Scenario(
        "scaling-spp", "time against samples per pixel", _BOX, "scaling", _both(256, 1024), _ONE,
        rounds=3, vary=("spp", (1, 4, 16, 64, 256, 1024, 4096)), peers=False,
        targets=(Target("overhead_percent", "what 64 spp cost beyond 64 times one sample",
                        {"cuda": (5, 2)}, below=True, unit="%"),),
    ),
    Scenario("scaling-resolution", "time against width and height", _BOX, "scaling", _SIZE, _FEW,
             rounds=3, vary=("size", (64, 128, 256, 512, 1024, 2048))),
    Scenario("scaling-triangles", "time against triangles", _MESH, "scaling", _both(256, 1024),
             _FEW, rounds=3, vary=("icosphere", (3, 4, 5, 6, 7, 8, 9, 10)), margin=3e-4),
    Scenario("scaling-depth", "time against the longest path, no roulette", _BOX, "scaling",
             _both(256, 1024), _FEW, rr_depth=NO_ROULETTE, rounds=3,
             vary=("max_depth", (2, 3, 5, 8, 16, 32, 64))),
    Scenario("scaling-threads", "time against threads", _BOX, "scaling", _SIZE, _ONE, rounds=3,
             vary=("threads", (1, 2, 4, 8, 16, 32, 64, 128)), peers=False, backends=("cpu",)),
    Scenario("depth-cornell", "live rays and time by depth, measured Cornell box", "cornell-box",
             "depth", _SIZE, _both((1,)), max_depth=None, rr_depth=None, peers=False),
    Scenario("depth-open", "live rays and time by depth, open scene", "open", "depth", _SIZE,
             _both((1,)), max_depth=None, rr_depth=None, peers=False),
    Scenario("depth-medium", "live rays and time by depth, glass sphere with a medium", _MEDIUM,
             "depth", _both(512), _both((1,)), max_depth=128, rr_depth=64, peers=False),
    Scenario("compaction-cornell", "closing gaps, measured Cornell box", "cornell-box",
             "compaction", _SIZE, _FEW, max_depth=None, rr_depth=None, peers=False),
    Scenario("compaction-open", "closing gaps, open scene", "open", "compaction", _SIZE, _FEW,
             max_depth=None, rr_depth=None, peers=False),
    Scenario("compaction-medium", "closing gaps, glass sphere with a medium", _MEDIUM, "compaction",
             _both(256, 512), _FEW, max_depth=128, rr_depth=64, rounds=3, peers=False),
    Scenario("compaction-mesh", "closing gaps, 1,310,720 triangles", _MESH, "compaction", _SIZE,
             _both((4,), (64,)), rounds=3, peers=False),
    Scenario("adaptive-cornell", "to a worst tile of 5 %, measured Cornell box", "cornell-box",
             "adaptive", _both(256, 1024), _ONE, max_depth=None, rr_depth=None, rounds=3,
             vary=("target_error", (0.05,)), peers=False),
    Scenario("adaptive-open", "to a worst tile of 5 %, open scene", "open", "adaptive",
             _both(256, 1024), _ONE, max_depth=None, rr_depth=None, rounds=3,
             vary=("target_error", (0.05,)), peers=False),
    Scenario("adaptive-medium", "to a worst tile of 5 %, glass sphere with a medium", _MEDIUM,
             "adaptive", _both(128, 512), _ONE, max_depth=128, rr_depth=64, rounds=3,
             vary=("target_error", (0.05,)), peers=False),
    Scenario("variants-cornell", "the scene's code against everything, Mitsuba's Cornell box", _BOX,
             "variants", _SIZE, _SPP, peers=False),
    Scenario("variants-open", "the same, open scene", "open", "variants", _SIZE, _SPP, peers=False),
    Scenario("variants-mesh", "the same, 1,310,720 triangles", _MESH, "variants", _SIZE, _ONE,
             peers=False),
    Scenario("variants-glass", "the same, glass sphere", "glass sphere", "variants", _SIZE, _SPP,
             peers=False),
    Scenario("variants-medium", "the same, glass sphere with a medium", _MEDIUM, "variants",
             _both(512), _ONE, max_depth=128, rr_depth=64, peers=False),
    Scenario("variants-lit-medium", "the same under a lamp", "glass medium lit", "variants",
             _both(512), _ONE, max_depth=128, rr_depth=64, peers=False),
    Scenario("variants-spheres", "the same, box with a mirror and a glass sphere",
             "cornell spheres", "variants", _SIZE, _SPP, peers=False),
    Scenario("variants-thin", "the same, box with a mirror and a sphere of thin glass",
             "cornell thin", "variants", _SIZE, _SPP, peers=False),
    Scenario("variants-rough", "the same, box with a rough metal and a rough glass sphere",
             "cornell rough", "variants", _SIZE, _SPP, peers=False),
    Scenario("variants-thin-mesh", "the same, 81,920 triangles of thin glass", "thin icosphere 6",
             "variants", _SIZE, _ONE, max_depth=32, peers=False),
    Scenario("variants-glass-mesh", "the same, 81,920 triangles of glass", "glass icosphere 6",
             "variants", _SIZE, _ONE, max_depth=32, peers=False),
    Scenario("variants-sky", "the same, box with a mirror and a glass sphere under an image",
             "image sky", "variants", _SIZE, _SPP, peers=False),
    Scenario("variants-medium-mesh", "the same, 81,920 triangles of glass with a medium",
             "medium icosphere 6", "variants", _SIZE, _ONE, max_depth=32, peers=False),
    Scenario("variants-lamp", "the same, 81,920 triangles under a near lamp", "lamp icosphere 6",
             "variants", _SIZE, _ONE, peers=False),
    Scenario("variants-textures", "the same, Mitsuba's box with checkerboards on all walls",
             "cornell textured", "variants", _SIZE, _SPP, peers=False),
    Scenario("variants-textured-spheres", "the same with a mirror and a glass sphere",
             "cornell textured spheres", "variants", _SIZE, _SPP, peers=False),
    Scenario(
        "surfaces-cornell", "textured and rough against matt, Mitsuba's Cornell box", _BOX, "cost",
        _SIZE, _SPP,
        targets=(
            Target("textured_over_matt", "time with every wall textured over untextured",
                   {"cpu": (1.15, 1.05), "cuda": (1.15, 1.05)}, below=True),
            Target("rough_over_matt", "time per ray, all rough over matt",
                   {"cpu": (1.25, 1.1), "cuda": (1.25, 1.1)}, below=True),
        ),
    ),
    Scenario("roulette-cornell", "where roulette starts, Mitsuba's Cornell box", _BOX, "roulette",
             _both(256, 512), _SPP, max_depth=64, rounds=9, vary=_STARTS, reference_spp=8192,
             peers=False),
    Scenario("roulette-open", "where roulette starts, open scene", "open", "roulette",
             _both(256, 512), _SPP, max_depth=64, rounds=9, vary=_STARTS, reference_spp=8192,
             peers=False),
    Scenario("roulette-medium", "where roulette starts, glass sphere with a medium", _MEDIUM,
             "roulette", _both(256), _SPP, max_depth=128, rounds=9, vary=_STARTS,
             reference_spp=8192, peers=False),
    Scenario(
        "build", "the tree over 1,310,720 triangles", _MESH, "build", _SIZE, _FEW, peers=False,
        targets=(
            Target("cpu_seconds_per_million", "CPU seconds per million triangles",
                   {"cpu": (0.6, 0.6)}, below=True, unit="s"),
            Target("seconds_per_million", "seconds per million triangles", {"cuda": (5e-3, 1e-3)},
                   below=True, unit="s"),
        ),
    ),
    Scenario(
        "cold-start", "a new process to a saved picture, measured Cornell box, 16 spp",
        "cornell-box", "cold", _both(512), _both((16,)), max_depth=None, rr_depth=None,
        targets=(
            Target("seconds", "the whole process", {"cpu": (1, 1), "cuda": (1.5, 1.5)}, below=True,
                   unit="s"),
            Target("share_of_peer", "the same as a share of Mitsuba's",
                   {"cpu": (0.5, 0.5), "cuda": (0.5, 0.5)}, below=True),
        ),
    ),
    Scenario("memory", "peak memory against samples per pixel", "cornell-box", "memory", _both(256),
             _both((16, 4096)), max_depth=None, rr_depth=None, rounds=3, peers=False),
)  # fmt: skip


# ---- scene files ----


_SCENE = """<scene version="3.0.0">
    <default name="width" value="512"/>
    <default name="height" value="512"/>
    <default name="max_depth" value="8"/>
    <default name="rr_depth" value="5"/>
    <integrator type="{integrator}">
        <integer name="max_depth" value="$max_depth"/>
        <integer name="rr_depth" value="$rr_depth"/>
    </integrator>
    <sensor type="perspective">
        <float name="fov" value="40"/>
        <transform name="to_world">
            <lookat origin="0, 0, 4" target="0, 0, 0" up="0, 1, 0"/>
        </transform>
        <film type="hdrfilm">
            <integer name="width" value="$width"/>
            <integer name="height" value="$height"/>
            <rfilter type="box"/>
        </film>
        <sampler type="independent"/>
    </sensor>
    {sky}{shape}
</scene>
"""
_SKY = """<emitter type="constant">
        <rgb name="radiance" value="1, 1, 1"/>
    </emitter>
    """
_IMAGE_SKY = """<emitter type="envmap">
        <string name="filename" value="sky.pfm"/>
    </emitter>
"""
_PLY = """<shape type="ply">
        <string name="filename" value="{name}.ply"/>
        <boolean name="face_normals" value="true"/>
        {bsdf}
    </shape>"""
_WHITE = """<bsdf type="diffuse">
            <rgb name="reflectance" value="0.8, 0.8, 0.8"/>
        </bsdf>"""
_GLASS = """<bsdf type="dielectric">
            <float name="int_ior" value="1.3"/>
            <float name="ext_ior" value="1"/>
        </bsdf>"""
_THIN = _GLASS.replace("dielectric", "thindielectric")
_MEDIUM_INSIDE = """
        <medium type="homogeneous" name="interior">
            <float name="sigma_t" value="16"/>
            <rgb name="albedo" value="0.9, 0.9, 0.9"/>
            <phase type="isotropic"/>
        </medium>"""
_TWO_SPHERES = f"""<shape type="sphere">
        <point name="center" x="-0.42" y="-0.6" z="-0.3"/>
        <float name="radius" value="0.4"/>
        <bsdf type="conductor">
            <string name="material" value="none"/>
        </bsdf>
    </shape>
    <shape type="sphere">
        <point name="center" x="0.42" y="-0.65" z="0.3"/>
        <float name="radius" value="0.35"/>
        {_GLASS}
    </shape>
</scene>
"""
_NEAR_LAMP = """<shape type="rectangle">
        <transform name="to_world">
            <scale x="0.6" y="0.4"/>
            <rotate x="1" angle="90"/>
            <translate y="1.25"/>
        </transform>
        <emitter type="area"><rgb name="radiance" value="9, 8, 7"/></emitter>
    </shape>
    """
_BOARD = r"""<texture type="checkerboard" name="reflectance">
            <rgb name="color0" value="\1"/>
            <rgb name="color1" value="0.5, 0.5, 0.5"/>
            <transform name="to_uv"><scale value="4"/></transform>
        </texture>"""
_ALL_ROUGH = r"""<string name="material" value="none"/>
    <string name="distribution" value="ggx"/>
    <float name="alpha" value="0.3"/>
    <rgb name="specular_reflectance" value="\1"/>"""
_SAMPLER = 'sampler type="independent"'


def scene_file(name: str, folder: Path, sampler: str = "independent") -> Path:
    """The scene's file, made in `folder` where it is not shipped, its mesh beside it.

    Made are "icosphere N" (displaced, 20 * 4^N triangles), "glass icosphere N", "thin icosphere N"
    (of thin glass), "medium icosphere N" (of glass with a medium) and "lamp icosphere N" (in the
    dark, under a rectangle that shines, a quarter of its width away), "glass sphere" and "glass
    medium" (with one inside) under a constant sky, "glass medium lit" under a rectangle; "cornell
    spheres", Mitsuba's box with two of
    them for its boxes, "cornell thin" with one of thin glass, "cornell rough" with rough ones,
    "cornell all rough", the box with rough metal for its matt surfaces,
    "image sky" with an image around it; "cornell textured", the box with checkerboards for its
    colours, "cornell textured spheres" with the two spheres as well. Parameters of the
    file: width, height, max_depth and rr_depth. sampler: Mitsuba's name; the only word in which
    the files of a scene differ.
    """
    if name in SHIPPED:
        path = find_shipped(name)
        text = path.read_text("utf-8")
    else:
        path = folder / f"{name.replace(' ', '_')}.xml"
        text = _made(name, folder)
        path.write_text(text)
    if sampler == "independent":
        return path
    if text.count(_SAMPLER) != 1:
        raise ValueError(f"scene {name!r}: expected one {_SAMPLER}")
    other = folder / f"{path.stem}-{sampler}.xml"
    other.write_text(text.replace(_SAMPLER, f'sampler type="{sampler}"'))
    return other


def _made(name: str, folder: Path) -> str:
    """The text of a scene that is not shipped; its mesh is written to `folder`."""
    if name.startswith("cornell"):
        text = find_shipped(_BOX).read_text("utf-8")
        if "textured" in name:
            text = re.sub(r'<rgb name="reflectance" value="([^"]*)"/>', _BOARD, text)
        if name == "cornell textured":
            return text
        if name == "cornell all rough":
            rough = _ALL_ROUGH.replace("\n", "\n    ")
            text = text.replace('<bsdf type="diffuse"', '<bsdf type="roughconductor"')
            return re.sub(r'<rgb name="reflectance" value="([^"]*)"/>', rough, text)
        spheres = _TWO_SPHERES.replace(_GLASS, _THIN if name == "cornell thin" else _GLASS)
        if name == "cornell rough":
            spheres = spheres.replace('bsdf type="', 'bsdf type="rough')
        return text[: text.index('<shape type="cube"')] + spheres
    if name == "image sky":
        _write_sky(folder / "sky.pfm")
        text = find_shipped(_BOX).read_text("utf-8")
        spheres = _TWO_SPHERES.replace("</scene>", _IMAGE_SKY + "</scene>")
        return text[: text.index('<shape type="cube"')] + spheres
    if name.startswith("glass") and "icosphere" not in name:
        inside = _MEDIUM_INSIDE if "medium" in name else ""
        shape = f'<shape type="sphere">\n        {_GLASS}{inside}\n    </shape>'
        sky = _NEAR_LAMP if name.endswith("lit") else _SKY
        return _SCENE.format(sky=sky, shape=shape, integrator="volpath")
    stem, level = name.replace(" ", "_"), int(name.split()[-1])
    if not (folder / f"{stem}.ply").exists():
        from veriray_validate.leaks import displaced_icosphere

        write_ply(folder / f"{stem}.ply", *displaced_icosphere(level))
    kinds = {"glass": _GLASS, "thin": _THIN, "medium": _GLASS + _MEDIUM_INSIDE}
    bsdf = kinds.get(name.split()[0], _WHITE)
    shape = _PLY.format(name=stem, bsdf=bsdf)
    sky = _NEAR_LAMP if name.startswith("lamp") else _SKY
    return _SCENE.format(sky=sky, shape=shape, integrator="path")


def _write_sky(path: Path) -> None:
    """A PFM file of 32 x 16 texels: rows from the bottom, brighter above."""
    texels = np.linspace(0.2, 1, 16)[:, None, None] * np.ones((32, 3))
    path.write_bytes(b"PF\n32 16\n-1.0\n" + texels.astype("<f4").tobytes())


def write_ply(path: Path, vertices: Array, triangles: Array, uv: Array | None = None) -> None:
    """A binary PLY file with float32 vertices; uv: (V, 2), their texture coordinates."""
    rows = np.empty(len(triangles), dtype=[("n", "u1"), ("v", "<i4", 3)])
    rows["n"], rows["v"] = 3, triangles
    columns = vertices if uv is None else np.hstack([vertices, uv])
    properties = "".join(f"property float {name}\n" for name in "xyzuv"[: columns.shape[1]])
    header = (
        f"ply\nformat binary_little_endian 1.0\nelement vertex {len(vertices)}\n{properties}"
        f"element face {len(triangles)}\nproperty list uchar int vertex_indices\nend_header\n"
    )
    path.write_bytes(header.encode() + columns.astype("<f4").tobytes() + rows.tobytes())
